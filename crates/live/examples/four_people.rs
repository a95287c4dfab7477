//! Four people who walk about before one radar: how much of a processor a running radar needs for them.
//!
//! The scene is simulated with physics and noise before the clock starts, and replayed at its own pace with the default
//! model, the page, a database and one listener.
//!
//! ```text
//! cargo run --release -p radarllm-live --example four_people
//! ```

#![allow(clippy::print_stdout, reason = "an example")]

use std::time::Duration;

use radarllm::radar_sim::{Noise, Scene};
use radarllm::{Captioner, Clip, DEFAULT_RADAR, DspOptions, Error, Result};
use radarllm_base::{Clutter, Provenance, frames::Placement};
use radarllm_live::{Input, Live, LiveOptions, Speed, http};
use radarllm_synth::synthesizer::{posed_builtin, scene_to_points_in_parallel};
use radarllm_synth::{Method, Synthesizer, open_motion};

/// Height of the radar above the floor, m.
const RADAR_M: f32 = 1.2;
/// What the four do, where, m, and in which direction, rad.
const PEOPLE: [(&str, [f32; 2], f32); 4] = [
    ("builtin:pace?repetitions=16", [-1.6, 3.0], 0.3),
    ("builtin:circle?repetitions=16", [-0.3, 4.6], 1.0),
    ("builtin:pace?repetitions=16&speed=slow", [0.9, 2.6], 1.4),
    (
        "builtin:circle?repetitions=16&direction=right",
        [1.9, 4.2],
        2.2,
    ),
];
/// Length of the scene, s.
const LENGTH_S: f64 = 60.0;

/// The allocator of the command.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> Result {
    let clip = scene()?;
    let n_points: usize = clip.frames.iter().map(|f| f.points.len()).sum();
    println!(
        "{} frames, {:.0} points a frame",
        clip.frames.len(),
        n_points as f64 / clip.frames.len() as f64
    );
    let length_s = clip.frames.len() as f64 / clip.frame_rate_hz;
    // A recording with other points.
    let mut recording = radarllm::open("builtin:stand_still?duration_s=0.5").points()?;
    recording.clip = clip;
    let folder = std::env::temp_dir().join(format!("four_people-{}", std::process::id()));
    std::fs::create_dir_all(&folder).map_err(Error::wrap)?;
    let options = LiveOptions {
        page: Some(http::Options::new(([127, 0, 0, 1], 0).into())),
        database: Some(folder.join("live.db")),
        ..LiveOptions::default()
    };
    let input = Input::replay("four people", recording, Speed::Times(1.0), false)?;
    let captioner = Captioner::bundled()?;
    let before_s = processor_s();
    let (live, messages) = Live::start_and_listen(input, captioner, options)?;
    let (mut n_sentences, mut max_people) = (0, 0);
    while !live.is_over() {
        let Ok(message) = messages.recv_timeout(Duration::from_millis(200)) else {
            continue;
        };
        let json = &message.json;
        n_sentences +=
            u32::from(json.contains("\"type\":\"now\"") && !json.contains("\"caption\":null"));
        if json.contains("\"type\":\"frame\"") {
            max_people = max_people.max(json.matches("\"id\":").count());
        }
    }
    let used_s = processor_s() - before_s;
    println!("{max_people} people at once, {n_sentences} sentences");
    println!(
        "{used_s:.1} s of a processor in {length_s:.0} s: {:.1} % of one core",
        100.0 * used_s / length_s
    );
    drop(live);
    std::fs::remove_dir_all(&folder).map_err(Error::wrap)
}

/// The four people, simulated together: who stands before another one hides that one.
fn scene() -> Result<Clip> {
    let radar = radarllm_io::open_radar(DEFAULT_RADAR)?.into_config()?;
    let mut bodies = Vec::new();
    for (i, (request, position_m, heading_rad)) in PEOPLE.into_iter().enumerate() {
        let input = open_motion(request, i as u64)?;
        let at = Placement {
            position_m,
            heading_rad,
            radar_height_m: RADAR_M,
        };
        bodies.push(posed_builtin(&input.motion, input.shape, at)?);
    }
    let mut scene = Scene {
        surfaces: Vec::new(),
        points: Vec::new(),
        noise: Noise::Thermal,
    };
    for body in &bodies {
        scene.surfaces.push(body);
    }
    let plan = || Synthesizer::new(&radar, Method::Fast, DspOptions::default());
    let frames = scene_to_points_in_parallel(plan, &scene, radar.frames_in(LENGTH_S), 1)?;
    Ok(Clip {
        frames,
        frame_rate_hz: radar.frame_rate_hz(),
        radar_height_m: RADAR_M,
        is_height_assumed: false,
        radar: radar.name.clone(),
        provenance: Provenance::simulated("four people", 1),
        clutter: Clutter::Settled,
    })
}

/// User and system time of this program, s.
fn processor_s() -> f64 {
    // SAFETY: the call fills a value that lives until it returns; all zeros is a valid value of it.
    let usage = unsafe {
        let mut usage: libc::rusage = std::mem::zeroed();
        libc::getrusage(libc::RUSAGE_SELF, &raw mut usage);
        usage
    };
    let seconds = |time: libc::timeval| time.tv_sec as f64 + 1e-6 * time.tv_usec as f64;
    seconds(usage.ru_utime) + seconds(usage.ru_stime)
}
