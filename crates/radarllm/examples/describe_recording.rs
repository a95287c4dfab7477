//! Describes every person in a recording of any format: a UART stream, raw samples, a visualizer's folder, a points
//! file.
//!
//! `cargo run --release -p radarllm --example describe_recording -- RECORDING [RADAR]`

#![allow(clippy::print_stdout, reason = "an example")]

fn main() -> Result<(), radarllm::Error> {
    let mut args = std::env::args().skip(1);
    let path = args
        .next()
        .ok_or_else(|| radarllm::Error::input("usage: describe_recording RECORDING [RADAR.cfg]"))?;
    let mut source = radarllm::open(path);
    if let Some(radar) = args.next() {
        source = source.radar(&radar)?;
    }
    let captioner = radarllm::Captioner::bundled()?;
    for person in source.points()?.track_people(&Default::default())? {
        println!("{}", captioner.describe(&person.clip)?.caption);
    }
    Ok(())
}
