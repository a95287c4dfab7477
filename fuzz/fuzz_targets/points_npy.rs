//! npy arrays: points tables, frames of mmBody and MM-Fi, and detection by header.
#![no_main]

use libfuzzer_sys::fuzz_target;
use radarllm_formats::{
    detect,
    recordings::{Axes, read_mmbody_frame, read_mmfi_frame},
    tables::read_points_npy,
};

fuzz_target!(|bytes: &[u8]| {
    let _ = read_points_npy(bytes, Axes::RightForwardUp, None);
    let _ = read_mmbody_frame(bytes);
    let _ = read_mmfi_frame(bytes, Axes::RightForwardUp);
    let _ = detect("frame_1.npy", bytes);
});
