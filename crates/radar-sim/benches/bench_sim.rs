//! Frames per second of the whole chain on the reference radar: pose, skinning, visibility,
//! scattering, noise, FFTs, clutter, detection, angles, 128 points.
//!
//! The built-in body walks towards the radar. First one thread, then one thread a core, each with a
//! chain of its own; then loops of four frames by the direct sum, for its time and for what the fast path is off; then the same
//! walk in a room with reflections, whose walls stand still or are computed in every frame. Times are of one
//! run on whatever else the machine does: the best frame and the processor time are less sensitive to neighbours.
//!
//! `cargo bench -p radarllm-radar-sim --bench bench_sim [-- frames, at least 20 [longest facet edge, m]]`

#![allow(clippy::disallowed_methods, clippy::print_stdout, reason = "a bench")]

use std::{error::Error, sync::Arc, time::Instant};

use radarllm_base::{MovingSurface, RadarConfig, frames::Placement};
use radarllm_body::{
    MotionSampler,
    mesh::{BodyModel, BodyShape, BuiltinBody, PosedBody, clothed_skin},
};
use radarllm_radar_dsp::{DspOptions, PointExtractor};
use radarllm_radar_sim::{Noise, Scene, SimOptions, Simulator, reference};
use radarllm_simd::{InstructionSet, SimdLevel};

/// The program's allocator: its large blocks begin on cache lines.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// Frames before the clock starts: they fill caches and buffers.
const N_WARM: usize = 3;

const N_STAGES: usize = 6;

/// Frames of the walk, repeated over and over.
const N_PHASES: usize = 20;

/// What one thread measured, sums over its frames.
#[derive(Default)]
struct Run {
    /// Positions, visibility, sources, spread, FFT and noise, signal chain: sums, and the least of
    /// every frame of the walk's.
    stages_s: [f64; N_STAGES],
    min_s: [[f64; N_STAGES]; N_PHASES],
    wall_s: f64,
    processor_s: Option<f64>,
    fastest_s: [f64; N_PHASES],
    n_visible: usize,
    n_points: usize,
    n_groups: usize,
    n_nodes: usize,
}

impl Run {
    /// Mean over the frames of the walk, each at its fastest.
    fn fastest_frame_s(&self) -> f64 {
        self.fastest_s.iter().sum::<f64>() / N_PHASES as f64
    }
}

fn main() -> Result<(), Box<dyn Error + Send + Sync>> {
    let mut args = std::env::args().skip(1).filter(|a| a != "--bench");
    let n_frames = args.next().map_or(Ok(200), |a| a.parse::<usize>())?;
    let n_frames = n_frames.max(N_PHASES);
    let facet_edge_m: f32 = args.next().map_or(Ok(0.02), |a| a.parse())?;
    let config = RadarConfig::awr1843boost();
    let shape = BodyShape {
        facet_edge_m,
        ..BodyShape::default()
    };
    let walk = radarllm_motions::parse("builtin:walk")?.render(0);
    let body = Arc::new(BuiltinBody::new(&shape)?);
    let n_facets = body.triangles().len();
    let sampler = MotionSampler::new(&walk.motion);
    let body = PosedBody::new(body, sampler, Placement::default(), clothed_skin());

    let one = run(&config, &body, n_frames, SimdLevel::detect())?;
    // What other programs took is in the mean, not in the least of many repetitions of a frame.
    let mut min_s = [0.0; N_STAGES];
    for phase in &one.min_s {
        for (sum, s) in min_s.iter_mut().zip(phase) {
            *sum += s / N_PHASES as f64;
        }
    }
    let fastest_s = one.fastest_frame_s();
    let per = |x: usize| x as f64 / n_frames as f64;
    println!(
        "facets {n_facets}, visible {:.0}, points {:.0}, Doppler groups {:.1}, slow-time nodes per source {:.1}",
        per(one.n_visible),
        per(one.n_points),
        per(one.n_groups),
        one.n_nodes as f64 / one.n_visible as f64,
    );
    for (name, s) in [
        ("mean", one.stages_s.map(|s| s / n_frames as f64)),
        ("every frame of the walk at its minimum", min_s),
    ] {
        let [positions, visibility, sources, spread, transform, dsp] = s.map(|s| 1e3 * s);
        println!(
            "ms, {name}: positions {positions:.2}, visibility {visibility:.2}, sources {sources:.2}, \
             spread {spread:.2}, FFT and noise {transform:.2}, signal chain {dsp:.2}, \
             sum {:.2}",
            1e3 * s.iter().sum::<f64>()
        );
    }
    let rate = n_frames as f64 / one.wall_s;
    let simulator_s = one.stages_s[..N_STAGES - 1].iter().sum::<f64>() / n_frames as f64;
    println!(
        "one thread: {rate:.1} frames/s mean of {n_frames}, {:.1} with every frame of the walk at its fastest; simulator \
         alone {:.1}",
        1.0 / fastest_s,
        1.0 / simulator_s,
    );
    if let Some(processor_s) = one.processor_s {
        println!(
            "            {:.1} frames per second of processor time (other programs excluded)",
            n_frames as f64 / processor_s
        );
    }
    for set in [InstructionSet::Avx2, InstructionSet::Portable] {
        if let Some(level) = SimdLevel::new(set).filter(|level| *level != SimdLevel::detect()) {
            let run = run(&config, &body, 2 * N_PHASES, level)?;
            println!(
                "{level:?} (the signal chain as before): {:.1} frames/s with every frame at its fastest",
                1.0 / run.fastest_frame_s()
            );
        }
    }
    let n_threads = std::thread::available_parallelism()?.get();
    let clock = Instant::now();
    let runs = std::thread::scope(|scope| {
        let runs: Vec<_> = (0..n_threads)
            .map(|_| scope.spawn(|| run(&config, &body, n_frames, SimdLevel::detect())))
            .collect();
        let results = runs
            .into_iter()
            .map(|r| r.join().map_err(|_| "a thread panicked")?);
        results.collect::<Result<Vec<_>, _>>()
    })?;
    let all = (n_threads * n_frames) as f64 / clock.elapsed().as_secs_f64();
    let all_fastest = runs.iter().map(|r| 1.0 / r.fastest_frame_s()).sum::<f64>();
    println!(
        "{n_threads} threads: {all:.1} frames/s, {:.2} times one; with every frame at its fastest {all_fastest:.1}, {:.2} \
         times one",
        all / rate,
        all_fastest * fastest_s,
    );

    let (direct_s, errors_db) = against_direct_sum(&config, &body)?;
    println!(
        "direct sum: {direct_s:.1} s/frame ({} loops measured), {:.0} times slower; largest difference of a loop {:.1} dB of \
         its frame's peak at the worst, {:.1} dB on average",
        errors_db.len(),
        direct_s / simulator_s,
        errors_db.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        errors_db.iter().sum::<f64>() / errors_db.len() as f64,
    );
    for max_bounces in [1, 3] {
        in_a_room(&config, &body, max_bounces)?;
    }
    println!(
        "peak memory: {} MB",
        peak_rss_mb().map_or("unknown".into(), |m| m.to_string())
    );
    Ok(())
}

/// Prints the time of a frame of the walk in a room, and of one whose walls have a speed of 1e-12 m/s, so that they are at the
/// same places but computed in every frame.
fn in_a_room(
    config: &RadarConfig,
    body: &PosedBody,
    max_bounces: usize,
) -> Result<(), Box<dyn Error + Send + Sync>> {
    let still = radarllm_synth::room::RoomFile::default().walls(config.carrier_hz())?;
    let mut moving = still.clone();
    for wall in &mut moving {
        wall.velocity_mps = glam::DVec3::splat(1e-12);
    }
    let mut frame_s = [f64::INFINITY; 2];
    let mut first_s = 0.0;
    for (walls, fastest_s) in [&still, &moving].into_iter().zip(&mut frame_s) {
        let scene = Scene {
            surfaces: (walls.iter().map(|w| w as &dyn MovingSurface))
                .chain([body as &dyn MovingSurface])
                .collect(),
            points: vec![],
            noise: Noise::Thermal,
        };
        let options = SimOptions {
            max_bounces,
            ..SimOptions::default()
        };
        let mut simulator = Simulator::new(config, options)?;
        let mut cube = simulator.new_cube();
        for i in 0..6 {
            let clock = Instant::now();
            let stats = simulator.simulate_frame(&scene, i, 1.0, 1, &mut cube)?;
            let s = clock.elapsed().as_secs_f64();
            if i == 0 && std::ptr::eq(walls, &still) {
                first_s = s;
                println!(
                    "room: {} facets, {} paths over several surfaces",
                    stats.n_facets, stats.n_bounces
                );
            } else {
                *fastest_s = fastest_s.min(s);
            }
        }
    }
    println!(
        "room, up to {max_bounces} surfaces on a path: {:.1} ms a frame, the first {:.1} ms; {:.1} ms if the walls are computed \
         in every frame, {:.1} times",
        1e3 * frame_s[0],
        1e3 * first_s,
        1e3 * frame_s[1],
        frame_s[1] / frame_s[0],
    );
    Ok(())
}

fn scene_of(body: &PosedBody) -> Scene<'_> {
    Scene {
        surfaces: vec![body],
        points: vec![],
        noise: Noise::Thermal,
    }
}

/// Time of a frame by the direct sum, s, and the largest differences that the fast path leaves in loops of four frames
/// of the walk, dB of the frame's largest sample.
fn against_direct_sum(
    config: &RadarConfig,
    body: &PosedBody,
) -> Result<(f64, Vec<f64>), Box<dyn Error + Send + Sync>> {
    let scene = Scene {
        noise: Noise::Off,
        ..scene_of(body)
    };
    let options = SimOptions::default();
    let mut simulator = Simulator::new(config, options.clone())?;
    let mut fast = simulator.new_cube();
    let mut direct = simulator.new_cube();
    let loop_len = direct.data.len() / config.n_loops;
    let mut errors_db = vec![];
    let mut direct_s = 0.0;
    for time_s in [0.2, 0.5, 1.0, 1.5] {
        simulator.simulate_frame(&scene, 0, time_s, 1, &mut fast)?;
        let peak = fast.data.iter().map(|z| z.norm()).fold(0.0, f32::max);
        // The first, and others with no regular distance.
        for l in [0.0, 0.1, 0.31, 0.6].map(|share| (share * config.n_loops as f64) as usize) {
            let clock = Instant::now();
            reference::simulate_loops(config, &options, &scene, time_s, 1, l..l + 1, &mut direct)?;
            direct_s += clock.elapsed().as_secs_f64();
            let samples = l * loop_len..(l + 1) * loop_len;
            let pairs = fast.data[samples.clone()].iter().zip(&direct.data[samples]);
            let error = pairs.map(|(f, d)| (f - d).norm()).fold(0.0, f32::max);
            errors_db.push(20.0 * f64::from(error / peak).log10());
        }
    }
    let loops = errors_db.len() as f64;
    Ok((direct_s / loops * config.n_loops as f64, errors_db))
}

fn run(
    config: &RadarConfig,
    body: &PosedBody,
    n_frames: usize,
    level: SimdLevel,
) -> Result<Run, Box<dyn Error + Send + Sync>> {
    let scene = scene_of(body);
    let options = SimOptions {
        simd: Some(level),
        ..SimOptions::default()
    };
    let mut simulator = Simulator::new(config, options)?;
    let mut extractor = PointExtractor::new(config, DspOptions::default())?;
    let mut cube = simulator.new_cube();
    let mut run = Run {
        fastest_s: [f64::INFINITY; N_PHASES],
        min_s: [[f64::INFINITY; N_STAGES]; N_PHASES],
        ..Run::default()
    };
    let (mut clock, mut processor_s) = (Instant::now(), processor_s_so_far());
    for i in 0..N_WARM + n_frames {
        if i == N_WARM {
            (clock, processor_s) = (Instant::now(), processor_s_so_far());
        }
        let frame = Instant::now();
        let phase = i % N_PHASES;
        let time_s = phase as f64 * config.frame_period_s;
        let stats = simulator.simulate_frame(&scene, i as u64, time_s, 1, &mut cube)?;
        let dsp = Instant::now();
        let n_points = extractor.extract(&cube)?.points.len();
        if i < N_WARM {
            continue;
        }
        let dsp_s = dsp.elapsed().as_secs_f64();
        let fastest_s = &mut run.fastest_s[phase];
        *fastest_s = fastest_s.min(frame.elapsed().as_secs_f64());
        let s = stats.seconds;
        let stages_s = [
            s.positions,
            s.visibility,
            s.sources,
            s.spread,
            s.transform,
            dsp_s,
        ];
        for (stage, s) in stages_s.into_iter().enumerate() {
            run.stages_s[stage] += s;
            let min_s = &mut run.min_s[phase][stage];
            *min_s = min_s.min(s);
        }
        run.n_visible += stats.n_visible;
        run.n_groups += stats.n_groups;
        run.n_nodes += stats.n_nodes;
        run.n_points += n_points;
    }
    run.wall_s = clock.elapsed().as_secs_f64();
    run.processor_s = processor_s_so_far()
        .zip(processor_s)
        .map(|(after, before)| after - before);
    Ok(run)
}

/// Peak resident set of this process from /proc, where there is one.
fn peak_rss_mb() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with("VmHWM"))?;
    Some(line.split_whitespace().nth(1)?.parse::<u64>().ok()? / 1024)
}

/// Processor time of this thread so far from /proc, where there is one.
fn processor_s_so_far() -> Option<f64> {
    let line = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    Some(line.split_whitespace().next()?.parse::<f64>().ok()? * 1e-9)
}
