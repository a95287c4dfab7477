//! What is measured: memory, open files, the write-ahead log, frames, and a viewer of the page.

use std::io::{self, BufRead, BufReader, Write};
use std::net::{SocketAddr, TcpStream};
use std::path::{Path, PathBuf};
use std::thread::JoinHandle;

use radarllm_live::metrics::Metrics;

use crate::script::frames;

/// Frames between two looks at the log.
const LOOK: u32 = 500;

/// The program at the end of an hour.
#[derive(Debug)]
pub struct Hour {
    pub memory_kb: u64,
    pub n_files: usize,
}

/// What was measured.
#[derive(Debug, Default)]
pub struct Figures {
    log: PathBuf,
    pub hours: Vec<Hour>,
    pub largest_log_bytes: u64,
    /// Frames that were used, lost and dropped.
    pub frames: [u64; 3],
    pub store_failures: u64,
    reconnects: u64,
    windows_left_out: u64,
    abstained: u64,
    pub answers: Vec<String>,
    pub wall_s: f64,
    pub simulated_s: f64,
    pub stop_s: f64,
    pub viewer: Viewed,
}

impl Figures {
    pub fn new(database: &Path) -> Self {
        let mut log = database.as_os_str().to_owned();
        log.push("-wal");
        Self {
            log: log.into(),
            ..Self::default()
        }
    }

    /// Looks at the program after a frame.
    pub fn look(&mut self, frame: u32) {
        if frame.is_multiple_of(LOOK) {
            let log_bytes = std::fs::metadata(&self.log).map_or(0, |m| m.len());
            self.largest_log_bytes = self.largest_log_bytes.max(log_bytes);
        }
        // The last minute of each hour, because the last frames of an hour may be lost.
        if frame + frames(60) >= (self.hours.len() as u32 + 1) * frames(3_600) {
            self.hours.push(Hour {
                memory_kb: memory_kb(),
                n_files: std::fs::read_dir("/proc/self/fd").map_or(0, Iterator::count),
            });
        }
    }

    pub fn count(&mut self, metrics: &Metrics) {
        self.frames = [
            metrics.monitor.frames_used.get(),
            metrics.monitor.frames_lost.get(),
            metrics.monitor.frames_dropped.get(),
        ];
        self.store_failures = metrics.store_failures.get();
        self.reconnects = metrics.reconnects.get();
        self.windows_left_out = metrics.monitor.windows_overwritten.get();
        self.abstained = metrics.monitor.abstained.get();
    }

    pub fn print(&self) {
        let [used, lost, dropped] = self.frames;
        println!(
            "simulated in {:.0} s, lived in {:.0} s, stopped in {:.1} s",
            self.simulated_s, self.wall_s, self.stop_s
        );
        for (i, hour) in self.hours.iter().enumerate() {
            println!(
                "hour {}: {} kB, {} open files",
                i + 1,
                hour.memory_kb,
                hour.n_files
            );
        }
        println!("largest log {} kB", self.largest_log_bytes / 1_024);
        println!("frames: used {used}, lost {lost}, dropped {dropped}");
        println!(
            "reconnects {}, rows not kept {}, windows left out {}, abstained {}",
            self.reconnects, self.store_failures, self.windows_left_out, self.abstained
        );
        println!(
            "viewer: {} messages, {} frames lost, came back {} times",
            self.viewer.n_messages, self.viewer.n_lost, self.viewer.n_returns
        );
        self.answers
            .iter()
            .for_each(|answer| println!("> {answer}"));
    }
}

/// Memory of this program, kB.
fn memory_kb() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status
        .lines()
        .find_map(|l| l.strip_prefix("VmRSS:"))
        .unwrap();
    line.trim().trim_end_matches(" kB").parse().unwrap()
}

/// Lets every write to a file fail, like a disk that is full, until the limit is taken away.
pub fn limit_file_size(bytes: Option<u64>) {
    // SAFETY: the signal of a write beyond the limit is ignored, so that the write fails instead. Both calls take plain
    // values and a pointer to a value that lives until they return.
    unsafe {
        libc::signal(libc::SIGXFSZ, libc::SIG_IGN);
        let mut limit: libc::rlimit = std::mem::zeroed();
        assert_eq!(libc::getrlimit(libc::RLIMIT_FSIZE, &raw mut limit), 0);
        limit.rlim_cur = bytes.unwrap_or(limit.rlim_max);
        assert_eq!(libc::setrlimit(libc::RLIMIT_FSIZE, &raw const limit), 0);
    }
}

/// What a viewer got.
#[derive(Debug, Default)]
pub struct Viewed {
    pub n_messages: u64,
    /// Frames that it was told it lost.
    pub n_lost: u64,
    /// Whether every number is there, but for what it was told it lost.
    pub is_in_order: bool,
    /// How often it came back after it had been too slow.
    pub n_returns: u64,
}

/// A viewer of the page, which reads as fast as it can, and comes back as a browser does.
pub struct Viewer(JoinHandle<Viewed>);

impl Viewer {
    pub fn start(address: SocketAddr) -> Self {
        let first = connect(address).unwrap();
        Self(std::thread::spawn(move || {
            let mut viewed = Viewed {
                is_in_order: true,
                ..Viewed::default()
            };
            read(first, &mut viewed);
            // Until the server has stopped.
            while let Ok(again) = connect(address) {
                viewed.n_returns += 1;
                read(again, &mut viewed);
            }
            viewed
        }))
    }

    /// What the viewer got until the server closed.
    pub fn end(self) -> Viewed {
        self.0.join().unwrap()
    }
}

fn connect(address: SocketAddr) -> io::Result<TcpStream> {
    let mut stream = TcpStream::connect(address)?;
    let request = format!("GET /api/live HTTP/1.1\r\nHost: {address}\r\n\r\n");
    stream.write_all(request.as_bytes())?;
    Ok(stream)
}

fn read(stream: TcpStream, viewed: &mut Viewed) {
    let (mut last, mut n_missing, mut n_lost) = (None::<u64>, 0, 0);
    for line in BufReader::new(stream).lines() {
        let Ok(line) = line else { break };
        let Some(json) = line.strip_prefix("data:") else {
            continue;
        };
        viewed.n_messages += 1;
        let seq = number(json, "\"seq\":");
        if json.contains("\"type\":\"lag\"") {
            n_lost += number(json, "\"dropped\":");
            continue;
        }
        if let Some(last) = last {
            n_missing += seq.saturating_sub(last + 1);
            viewed.is_in_order &= seq > last || json.contains("\"type\":\"hello\"");
        }
        last = Some(seq);
    }
    viewed.n_lost += n_lost;
    viewed.is_in_order &= n_missing == n_lost;
}

/// The number after a name.
pub fn number(json: &str, name: &str) -> u64 {
    let (_, after) = json
        .split_once(name)
        .unwrap_or_else(|| panic!("no {name} in {json}"));
    let end = after
        .find(|c: char| !c.is_ascii_digit())
        .unwrap_or(after.len());
    after[..end].parse().unwrap()
}
