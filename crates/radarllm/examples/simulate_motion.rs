//! Simulates a motion for a radar of your own and writes its points.
//!
//! `cargo run --release -p radarllm --example simulate_motion -- points.parquet`

#![allow(clippy::print_stdout, reason = "an example")]

use radarllm::{Overwrite, SimulateOptions, open_radar, simulate_motion, write_clip};

fn main() -> Result<(), radarllm::Error> {
    let out = std::env::args().nth(1).unwrap_or("points.parquet".into());
    // A built-in radar with half the chirp slope: half the range resolution and twice the maximum range.
    let mut radar = open_radar("awr1843boost")?.into_config()?;
    radar.name = "half-slope".into();
    radar.slope_hz_per_s /= 2.0;
    println!(
        "range resolution {:.1} cm, maximum range {:.1} m",
        100.0 * radar.range_resolution_m(),
        radar.max_range_m()
    );
    let input = "builtin:walk?direction=backward";
    let clip = simulate_motion(input, &radar, &SimulateOptions::default())?.clip;
    write_clip(out.as_ref(), &clip, Overwrite::Replace)?;
    println!(
        "{} frames, {:.1} points per frame",
        clip.frames.len(),
        clip.points_per_frame()
    );
    Ok(())
}
