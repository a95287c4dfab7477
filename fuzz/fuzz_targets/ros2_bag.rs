//! A file of a ROS 2 bag: SQLite or MCAP, by its first bytes.
#![no_main]

use std::io::Write;

use libfuzzer_sys::fuzz_target;
use radarllm_formats::RecordingFormat;
use radarllm_io::{CaptureFormat, CaptureOptions, read_recording};

fuzz_target!(|bytes: &[u8]| {
    let mut file = tempfile::NamedTempFile::new().expect("a temporary file");
    file.write_all(bytes).expect("a temporary file");
    let options = CaptureOptions {
        format: Some(CaptureFormat::Format(RecordingFormat::Ros2Bag)),
        ..CaptureOptions::default()
    };
    let _ = read_recording(&[file.path().to_path_buf()], &options);
});
