//! Simulates a board that watches a minute of exercise, and writes the stream of its serial port.
//!
//! The points are those of TI's out-of-box firmware as `simulate --firmware out-of-box` models it. Made
//! `crates/demo/recording/simulated-uart.dat`, which the demo reads:
//!
//! `cargo run --release -p radarllm --example simulate_board -- RADAR.cfg OUT.dat`

#![allow(
    clippy::disallowed_methods,
    clippy::print_stdout,
    reason = "an example"
)]

use radarllm::radar_sim::{Noise, Scene};
use radarllm::synth::simulate::{open_motion, place};
use radarllm::synth::synthesizer::{posed_builtin, scene_to_points_in_parallel};
use radarllm::synth::{Method, Synthesizer};
use radarllm::{Error, PointFrame, io::TiFirmware};

/// What the person does, and for how many seconds each. `simulated-uart.txt` of the demo has the same list.
const MINUTE: &str = "builtin:pace+then+squat+then+jumping_jack+then+punch\
    ?pace.duration_s=16&pace.repetitions=3\
    &squat.duration_s=14&squat.repetitions=5\
    &jumping_jack.duration_s=14&jumping_jack.repetitions=10\
    &punch.duration_s=16&punch.repetitions=16&punch.side=both";
const SEED: u64 = 1;
const RADAR_HEIGHT_M: f32 = 1.0;

fn main() -> Result<(), Error> {
    let mut args = std::env::args().skip(1);
    let (Some(cfg), Some(out)) = (args.next(), args.next()) else {
        return Err(Error::input("usage: simulate_board RADAR.cfg OUT.dat"));
    };
    let radar = radarllm::open_radar(&cfg)?;
    let firmware = TiFirmware::out_of_box(&radar)?;
    let motion = open_motion(MINUTE, SEED)?;
    let placement = place(&motion.motion, 3.0, RADAR_HEIGHT_M);
    let body = posed_builtin(&motion.motion, motion.shape, placement)?;
    let scene = Scene {
        surfaces: vec![&body],
        points: Vec::new(),
        noise: Noise::Thermal,
    };
    let config = radar.config()?;
    let n_frames = config.frames_in(motion.motion.duration_s());
    let plan = || Synthesizer::new(config, Method::Fast, firmware.chain.clone());
    let mut frames = scene_to_points_in_parallel(plan, &scene, n_frames, SEED)?;
    frames.iter_mut().for_each(|f| firmware.limit(f));
    let stream: Vec<u8> = frames.iter().flat_map(packet).collect();
    println!("{n_frames} frames, {} bytes", stream.len());
    std::fs::write(&out, stream).map_err(|e| Error::io(out.as_ref(), e))
}

/// One frame as the out-of-box demo of SDK 3 sends it: header, points (type 1), SNR and noise in 0.1 dB (type 7), and
/// zeros up to a multiple of 32 bytes.
fn packet(frame: &PointFrame) -> Vec<u8> {
    const MAGIC: [u8; 8] = [2, 1, 4, 3, 6, 5, 8, 7];
    const HEADER_LEN: usize = 40;
    let n = frame.points.len();
    let len = (HEADER_LEN + 8 + 16 * n + 8 + 4 * n).next_multiple_of(32);
    let mut bytes = MAGIC.to_vec();
    let mut words = |words: &[u32]| bytes.extend(words.iter().flat_map(|w| w.to_le_bytes()));
    // Version, length, platform, frame, time in processor cycles, number of points, of TLVs, subframe.
    let number = frame.frame + 1;
    words(&[0x0306_0000, len as u32, 0xA_6843, number, 0, n as u32, 2, 0]);
    words(&[1, 16 * n as u32]);
    for p in &frame.points {
        words(&[p.x_m, p.y_m, p.z_m, p.velocity_mps].map(f32::to_bits));
    }
    words(&[7, 4 * n as u32]);
    for p in &frame.points {
        words(&[(10.0 * p.intensity_db).round().clamp(0.0, 65535.0) as u32]);
    }
    bytes.resize(len, 0);
    bytes
}
