//! Prints the points of a UART stream as a table, for `studies/uart_streams.py`.
//!
//! `cargo run -p radarllm-formats --example uart_points -- STREAM [DOPPLER_STEP_MPS]`

#![allow(
    clippy::disallowed_methods,
    clippy::print_stderr,
    clippy::print_stdout,
    reason = "an example that reads one file and prints"
)]

use radarllm_formats::uart::{UartParser, recorded_frames};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut args = std::env::args().skip(1);
    let path = args.next().ok_or("a UART stream is needed")?;
    let step_mps: f32 = args.next().unwrap_or("0".into()).parse()?;
    let bytes = std::fs::read(path)?;
    let mut parser = UartParser::new(None).with_doppler_step(step_mps);
    let mut packets = parser.push(&bytes)?;
    let (last, report, guess) = parser.finish()?;
    packets.extend(last);
    if let Some(guess) = guess {
        eprintln!("{guess}");
    }
    eprintln!("{report:?}");
    println!("frame,x,y,z,velocity,snr");
    for frame in recorded_frames(packets) {
        println!("{},,,,,", frame.number);
        for p in frame.points {
            let (n, v, db) = (frame.number, p.velocity_mps, p.intensity_db);
            println!("{n},{},{},{},{v},{db}", p.x_m, p.y_m, p.z_m);
        }
    }
    Ok(())
}
