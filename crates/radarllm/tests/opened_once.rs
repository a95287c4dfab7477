//! A capture is opened and identified once, whatever it holds.
#![allow(clippy::disallowed_methods, clippy::unwrap_used, reason = "a test")]
#![cfg(target_os = "linux")]

use std::{
    ffi::CString,
    fs::{self, File},
    io::Read,
    os::{fd::FromRawFd, unix::ffi::OsStrExt},
    path::{Path, PathBuf},
};

use radarllm::{
    CaptureOptions, IqChoice, LayoutOptions, Overwrite, SimulateOptions, open_radar,
    simulate_cubes, simulate_motion, write_clip,
};

/// Reports what happens to a file from now on.
struct Observer(File);

impl Observer {
    fn new(path: &Path) -> Self {
        // Reads and ends between two openings keep the kernel from merging their events.
        let mask = libc::IN_OPEN | libc::IN_ACCESS | libc::IN_CLOSE;
        let name = CString::new(path.as_os_str().as_bytes()).unwrap();
        // SAFETY: it takes a number and returns a new descriptor or an error.
        let fd = unsafe { libc::inotify_init1(libc::IN_NONBLOCK | libc::IN_CLOEXEC) };
        assert!(fd >= 0, "{}", std::io::Error::last_os_error());
        // SAFETY: the name ends with a zero and lives until the call returns.
        let watched = unsafe { libc::inotify_add_watch(fd, name.as_ptr(), mask) };
        assert!(watched >= 0, "{}", std::io::Error::last_os_error());
        // SAFETY: the descriptor is open and belongs to nobody else.
        Self(unsafe { File::from_raw_fd(fd) })
    }

    /// How often the file was opened.
    fn n_opened(mut self) -> usize {
        let (mut events, mut piece) = (Vec::new(), [0; 4096]);
        while let Ok(n) = self.0.read(&mut piece) {
            events.extend_from_slice(&piece[..n]);
        }
        // Of a watched file: watch, mask, cookie and length of the name, which is absent; 32 bits each.
        let masks = events
            .chunks_exact(16)
            .map(|event| u32::from_ne_bytes([event[4], event[5], event[6], event[7]]));
        masks.filter(|mask| mask & libc::IN_OPEN != 0).count()
    }
}

fn n_opened(path: &Path, options: CaptureOptions) -> usize {
    let observer = Observer::new(path);
    let recording = radarllm::open(path).with_options(options).points().unwrap();
    assert!(!recording.clip.frames.is_empty());
    observer.n_opened()
}

/// A table of points, a points file, an array of samples and raw words.
fn captures(folder: &Path) -> Vec<(PathBuf, CaptureOptions)> {
    let radar = open_radar(radarllm::DEFAULT_RADAR).unwrap();
    let input = "builtin:clap";
    let mut table = String::from("frame,t_s,x,y,z,velocity,intensity\n");
    for frame in 0..30 {
        let time_s = f64::from(frame) * 0.1;
        table += &format!("{frame},{time_s:.1},0.1,2.0,0.3,0.5,20\n");
    }
    let csv = folder.join("points.csv");
    fs::write(&csv, table).unwrap();

    let options = SimulateOptions::default();
    let clip = simulate_motion(input, radar.config().unwrap(), &options)
        .unwrap()
        .clip;
    let parquet = folder.join("points.parquet");
    write_clip(&parquet, &clip, Overwrite::Refuse).unwrap();

    let cubes = simulate_cubes(input, radar.config().unwrap(), &options).unwrap();
    let cubes: Vec<_> = cubes.take(2).map(Result::unwrap).collect();
    let [a, b, c, d] = [
        cubes[0].n_loops,
        cubes[0].n_tx,
        cubes[0].n_rx,
        cubes[0].n_samples,
    ];
    let header = format!(
        "{{'descr': '<c8', 'fortran_order': False, 'shape': ({}, {a}, {b}, {c}, {d}), }}\n",
        cubes.len()
    );
    let mut array = b"\x93NUMPY\x01\x00".to_vec();
    array.extend((header.len() as u16).to_le_bytes());
    array.extend(header.as_bytes());
    for sample in cubes.iter().flat_map(|cube| &cube.data) {
        array.extend(sample.re.to_le_bytes());
        array.extend(sample.im.to_le_bytes());
    }
    let npy = folder.join("samples.npy");
    fs::write(&npy, array).unwrap();

    let words = folder.join("adc_data.bin");
    fs::write(&words, vec![0; 2 * a * b * c * d * 4]).unwrap();
    let as_words = CaptureOptions {
        radar: Some(radar),
        layout: LayoutOptions {
            iq: Some(IqChoice::IFirst),
            ..LayoutOptions::default()
        },
        ..CaptureOptions::default()
    };
    let detected = CaptureOptions::default;
    vec![
        (csv, detected()),
        (parquet, detected()),
        (npy, detected()),
        (words, as_words),
    ]
}

#[test]
fn a_capture_is_opened_once() {
    let folder = tempfile::tempdir().unwrap();
    for (path, options) in captures(folder.path()) {
        assert_eq!(n_opened(&path, options), 1, "{}", path.display());
    }
}

#[test]
fn an_observer_counts_every_opening() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("file");
    fs::write(&path, "text").unwrap();
    let observer = Observer::new(&path);
    for _ in 0..3 {
        fs::read(&path).unwrap();
    }
    assert_eq!(observer.n_opened(), 3);
}
