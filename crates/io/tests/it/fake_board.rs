//! A board on one or two pseudo-terminals. Nothing here waits longer than [`PATIENCE`].

use std::{
    ffi::CStr,
    fs::File,
    io::{ErrorKind, Read as _, Write as _},
    os::fd::{AsRawFd as _, FromRawFd as _},
    path::{Path, PathBuf},
    sync::{
        Arc, Mutex,
        atomic::{AtomicBool, Ordering},
    },
    thread::{self, JoinHandle},
    time::{Duration, Instant},
};

use radarllm_formats::uart::Dialect;

use crate::{events::PATIENCE, make_uart};

/// One pseudo-terminal in raw mode.
pub struct Pty {
    /// The side of the board. Reads and writes do not wait.
    pub board: File,
    /// Keeps the port alive while nobody has it open.
    _port: File,
    pub path: PathBuf,
}

fn check(result: libc::c_int) -> libc::c_int {
    assert!(result >= 0, "{}", std::io::Error::last_os_error());
    result
}

impl Pty {
    pub fn new() -> Self {
        let flags = libc::O_RDWR | libc::O_NOCTTY | libc::O_NONBLOCK | libc::O_CLOEXEC;
        // SAFETY: the call takes flags and returns a new descriptor or -1.
        let fd = check(unsafe { libc::posix_openpt(flags) });
        // SAFETY: `fd` was just opened and has no other owner.
        let board = unsafe { File::from_raw_fd(fd) };
        let mut name = [0; 128];
        // SAFETY: `fd` is an open pseudo-terminal; `name` has the stated length; termios is plain data for which all
        // zeros is a valid value.
        unsafe {
            check(libc::grantpt(fd));
            check(libc::unlockpt(fd));
            check(libc::ptsname_r(fd, name.as_mut_ptr(), name.len()));
        }
        // SAFETY: ptsname_r terminated the name with a zero.
        let name = unsafe { CStr::from_ptr(name.as_ptr()) };
        let path = PathBuf::from(name.to_str().unwrap());
        let mut options = File::options();
        let port = options.read(true).write(true).open(&path).unwrap();
        // SAFETY: as above; the settings were filled by tcgetattr.
        unsafe {
            let mut settings: libc::termios = std::mem::zeroed();
            check(libc::tcgetattr(port.as_raw_fd(), &raw mut settings));
            libc::cfmakeraw(&raw mut settings);
            check(libc::tcsetattr(
                port.as_raw_fd(),
                libc::TCSANOW,
                &raw const settings,
            ));
        }
        Self {
            board,
            _port: port,
            path,
        }
    }

    /// Writes as the reader makes room. Returns false if `is_over` becomes true before the end.
    pub fn write(&mut self, mut bytes: &[u8], is_over: &AtomicBool) -> bool {
        let end = Instant::now() + PATIENCE;
        while !bytes.is_empty() && !is_over.load(Ordering::Relaxed) {
            assert!(Instant::now() < end, "nobody reads the port");
            match self.board.write(bytes) {
                Ok(n) => bytes = &bytes[n..],
                Err(e) if e.kind() == ErrorKind::WouldBlock => {
                    thread::sleep(Duration::from_millis(1));
                }
                Err(e) => panic!("{e}"),
            }
        }
        bytes.is_empty()
    }
}

/// How a board answers its command line and what it sends.
pub struct Behaviour {
    /// The answer to a command that was sent for the n-th time, n from 0.
    pub answer: fn(&str, usize) -> String,
    /// First number of the packets after `sensorStart`.
    pub first_number: u32,
    /// Number of packets after each `sensorStart`.
    pub n_packets: u32,
    /// Content of the n-th packet after `sensorStart`, n from 0.
    pub content: fn(u32) -> Vec<(u32, Vec<u8>)>,
    /// Time between two packets.
    pub pause: Duration,
}

impl Default for Behaviour {
    fn default() -> Self {
        Self {
            answer: |command, _| format!("{command}\r\nDone\n\rmmwDemo:/>"),
            first_number: 1,
            n_packets: 20,
            content: |_| make_uart::one_point(Dialect::Sdk3),
            pause: Duration::ZERO,
        }
    }
}

/// A board that runs until it is dropped, which unplugs it.
pub struct FakeBoard {
    pub data: PathBuf,
    pub cli: PathBuf,
    commands: Arc<Mutex<Vec<String>>>,
    is_over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl FakeBoard {
    pub fn new(behaviour: Behaviour) -> Self {
        Self::on(Some(Pty::new()), Pty::new(), behaviour)
    }

    /// A board that sends its packets and answers its command line on one port.
    pub fn with_one_port(behaviour: Behaviour) -> Self {
        Self::on(None, Pty::new(), behaviour)
    }

    fn on(data: Option<Pty>, cli: Pty, behaviour: Behaviour) -> Self {
        let is_over = Arc::new(AtomicBool::new(false));
        let commands = Arc::new(Mutex::new(Vec::new()));
        Self {
            data: data.as_ref().unwrap_or(&cli).path.clone(),
            cli: cli.path.clone(),
            commands: Arc::clone(&commands),
            is_over: Arc::clone(&is_over),
            thread: Some(thread::spawn(move || {
                run(data, cli, &behaviour, &commands, &is_over);
            })),
        }
    }

    /// The commands received so far.
    pub fn commands(&self) -> Vec<String> {
        self.commands.lock().unwrap().clone()
    }

    /// Makes `data` and `cli` in a folder the names of this board's ports, as udev does.
    pub fn plug_into(&self, folder: &Path) {
        for (port, name) in [(&self.data, "data"), (&self.cli, "cli")] {
            let (link, new) = (folder.join(name), folder.join(format!("{name}.new")));
            std::os::unix::fs::symlink(port, &new).unwrap();
            std::fs::rename(new, link).unwrap();
        }
    }
}

impl Drop for FakeBoard {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let outcome = thread.join();
            assert!(outcome.is_ok() || thread::panicking());
        }
    }
}

fn run(
    mut data: Option<Pty>,
    mut cli: Pty,
    behaviour: &Behaviour,
    commands: &Mutex<Vec<String>>,
    is_over: &AtomicBool,
) {
    let end = Instant::now() + 3 * PATIENCE;
    let mut line = Vec::new();
    while !is_over.load(Ordering::Relaxed) && Instant::now() < end {
        let mut byte = [0];
        match cli.board.read(&mut byte) {
            Ok(1) if byte[0] == b'\n' => {}
            Ok(1) => {
                line.push(byte[0]);
                continue;
            }
            _ => {
                thread::sleep(Duration::from_millis(1));
                continue;
            }
        }
        let command = String::from_utf8(std::mem::take(&mut line)).unwrap();
        let n_before = {
            let mut commands = commands.lock().unwrap();
            commands.push(command.clone());
            commands.iter().filter(|c| **c == command).count() - 1
        };
        let answer = (behaviour.answer)(&command, n_before);
        if !cli.write(answer.as_bytes(), is_over) {
            return;
        }
        if command.starts_with("sensorStart") && answer.contains("Done") {
            for n in 0..behaviour.n_packets {
                let number = behaviour.first_number + n;
                let packet = make_uart::packet(Dialect::Sdk3, number, &(behaviour.content)(n));
                if !data.as_mut().unwrap_or(&mut cli).write(&packet, is_over) {
                    return;
                }
                thread::sleep(behaviour.pause);
            }
        }
    }
}
