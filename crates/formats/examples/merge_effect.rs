//! What moving points along their radial velocity does to merged frames, measured on recordings.
//!
//! `cargo run --release -p radarllm-formats --example merge_effect -- FRAMES_PER_S FILE...` takes MARS tables and RadHAR
//! text. For every moving point and every lag it prints the mean distance to the nearest moving point of the
//! frame that the point would join: with the point where it was, moved, and moved the wrong way.

#![allow(
    clippy::disallowed_methods,
    clippy::print_stderr,
    clippy::print_stdout,
    reason = "an example"
)]

use std::process::ExitCode;

use radarllm_base::{RadarPoint, RecordedFrame, Timeline, timeline::moved};
use radarllm_formats::{RecordingFormat, detect, read_mars_points, read_radhar_points};

/// Slower points say nothing about motion, m/s.
const SLOWEST_MPS: f32 = 0.3;
/// Farther than this there is no counterpart in the frame, m.
const FARTHEST_M: f32 = 0.5;

fn main() -> ExitCode {
    let mut args = std::env::args().skip(1);
    let rate = args.next().and_then(|r| r.parse::<f64>().ok());
    let files: Vec<String> = args.collect();
    let (Some(rate_hz), false) = (rate, files.is_empty()) else {
        eprintln!("usage: merge_effect FRAMES_PER_S FILE...");
        return ExitCode::FAILURE;
    };
    let mut lines = Vec::new();
    for file in &files {
        match read(file).and_then(|f| Timeline::new(f, Some(rate_hz)).map_err(|e| e.to_string())) {
            Ok(line) => lines.push(line),
            Err(problem) => {
                eprintln!("{file}: {problem}");
                return ExitCode::FAILURE;
            }
        }
    }
    println!("lag, frames | points | still, m | moved, m | moved the wrong way, m");
    for lag in 1..=5_u32 {
        let mut sums = [0.0_f64; 3];
        let mut n = 0;
        for line in &lines {
            for (i, frame) in line.frames.iter().enumerate() {
                let before = line.frames[..i]
                    .iter()
                    .rev()
                    .take(lag as usize)
                    .find(|f| f.frame + lag == frame.frame);
                let Some(before) = before else {
                    continue;
                };
                let ahead_s = frame.time_s - before.time_s;
                for point in before.points.iter().filter(|p| is_moving(p)) {
                    let places = [*point, moved(point, ahead_s), moved(point, -ahead_s)];
                    let distances = places.map(|p| nearest(&p, &frame.points));
                    if distances[0] > FARTHEST_M {
                        continue;
                    }
                    n += 1;
                    for (sum, d) in sums.iter_mut().zip(distances) {
                        *sum += f64::from(d);
                    }
                }
            }
        }
        let [still, moved, wrong] = sums.map(|s| s / f64::from(n.max(1)));
        println!("{lag} | {n} | {still:.4} | {moved:.4} | {wrong:.4}");
    }
    ExitCode::SUCCESS
}

fn read(file: &str) -> Result<Vec<RecordedFrame>, String> {
    let text = std::fs::read_to_string(file).map_err(|e| e.to_string())?;
    let format = detect(file, text.as_bytes())
        .map_err(|e| e.to_string())?
        .format;
    match format {
        RecordingFormat::Mars => read_mars_points(&text).map_err(|e| e.to_string()),
        RecordingFormat::RadHar => read_radhar_points(&text).map_err(|e| e.to_string()),
        other => Err(format!("{} is not measured here", other.name())),
    }
}

fn is_moving(point: &RadarPoint) -> bool {
    point.velocity_mps.abs() >= SLOWEST_MPS
}

/// Distance to the nearest moving point of like direction, m; infinite if there is none.
fn nearest(point: &RadarPoint, others: &[RadarPoint]) -> f32 {
    others
        .iter()
        .filter(|o| is_moving(o) && o.velocity_mps.signum() == point.velocity_mps.signum())
        .map(|o| {
            let d = [point.x_m - o.x_m, point.y_m - o.y_m, point.z_m - o.z_m];
            d.iter().map(|v| v * v).sum::<f32>().sqrt()
        })
        .fold(f32::INFINITY, f32::min)
}
