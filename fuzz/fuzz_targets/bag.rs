//! A ROS bag.
#![no_main]

use libfuzzer_sys::fuzz_target;
use radarllm_formats::recordings::{Axes, read_bag};

fuzz_target!(|bytes: &[u8]| {
    let _ = read_bag(bytes, None, Axes::ForwardLeftUp);
});
