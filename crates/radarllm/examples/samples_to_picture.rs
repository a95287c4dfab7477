//! Raw samples to points to a picture.
//!
//! `cargo run --release -p radarllm --example samples_to_picture -- SAMPLES.npy RADAR OUT.svg`

#![allow(
    clippy::disallowed_methods,
    clippy::print_stdout,
    reason = "an example"
)]

use radarllm::{CaptureOptions, Error, SampleRecording, io::Opened, open_radar, render};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [samples, radar, out] = &args[..] else {
        return Err(Error::input("usage: samples_to_picture SAMPLES.npy RADAR OUT.svg").into());
    };
    let options = CaptureOptions {
        radar: Some(open_radar(radar)?),
        ..CaptureOptions::default()
    };
    let mut recording =
        SampleRecording::open(Opened::open(&[samples.into()], &options)?, &options)?;
    // The closure sees every cube of samples with its points.
    let extracted = recording.extract_points(|_, cube, frame| {
        println!("{:.1} s: {} points", cube.time_s, frame.points.len());
        Ok(())
    })?;
    let clip = recording.into_recording(extracted)?.clip;
    let points: Vec<_> = clip.frames.iter().flat_map(|f| f.points.clone()).collect();
    let svg = render::plot::point_cloud(&points, "Points of all frames").to_svg();
    std::fs::write(out, svg)?;
    Ok(())
}
