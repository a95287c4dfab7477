//! Frames per second of the fast path on one core, for a walking figure of ellipsoids with about
//! 11,000 facets at 3 m, and its ratio to the direct sum.
//!
//! `cargo run --release -p radarllm-radar-sim --example bench_sim [n_frames] [raster_size]`

use std::error::Error;
use std::time::Instant;

use glam::{DQuat, DVec3, Vec3};
use radarllm_base::{Material, MovingSurface, RadarConfig};
use radarllm_radar_sim::shapes::RigidSurface;
use radarllm_radar_sim::{Noise, Scene, SimOptions, Simulator, StageSeconds, reference};

/// Clothed skin: -4.7 dB, 0.5 mm rough, diffuse as radar.md asks for.
const CLOTH: Material = Material {
    power_reflection: 0.34,
    roughness_m: 0.5e-3,
    rough_albedo: 0.1,
    power_transmission: 0.0,
};

/// Limbs that swing like pendulums, as one surface (a skinned mesh would come as one too).
struct Figure {
    parts: Vec<(RigidSurface, Swing)>,
    triangles: Vec<[u32; 3]>,
    n_vertices: usize,
}

/// Rotation about the x axis through `pivot` with the angle `amplitude sin(2 pi f t + phase)`.
#[derive(Clone, Copy)]
struct Swing {
    pivot: DVec3,
    amplitude_rad: f64,
    phase_rad: f64,
}

impl Figure {
    fn new(edge_m: f64) -> Self {
        let part = |at: [f64; 3], radii: [f64; 3], pivot: [f64; 3], amplitude_rad, phase_rad| {
            let swing = Swing {
                pivot: DVec3::from(pivot),
                amplitude_rad,
                phase_rad,
            };
            (
                RigidSurface::ellipsoid(DVec3::from(radii), edge_m).at(DVec3::from(at)),
                swing,
            )
        };
        let pi = std::f64::consts::PI;
        let mut parts = vec![
            part([0.0, 0.0, 0.1], [0.17, 0.11, 0.32], [0.0; 3], 0.05, 0.0),
            part(
                [0.0, 0.0, 0.57],
                [0.08, 0.1, 0.12],
                [0.0, 0.0, 0.45],
                0.1,
                0.0,
            ),
        ];
        for (side, phase) in [(-1.0, 0.0), (1.0, pi)] {
            let (arm, leg) = (side * 0.23, side * 0.1);
            parts.push(part(
                [arm, 0.0, 0.2],
                [0.05, 0.05, 0.17],
                [arm, 0.0, 0.35],
                0.5,
                phase,
            ));
            parts.push(part(
                [arm, 0.0, -0.1],
                [0.04, 0.04, 0.16],
                [arm, 0.0, 0.35],
                0.7,
                phase,
            ));
            parts.push(part(
                [leg, 0.0, -0.4],
                [0.08, 0.08, 0.23],
                [leg, 0.0, -0.2],
                0.5,
                phase + pi,
            ));
            parts.push(part(
                [leg, 0.0, -0.8],
                [0.06, 0.06, 0.22],
                [leg, 0.0, -0.2],
                0.6,
                phase + pi,
            ));
        }
        let (mut triangles, mut n_vertices) = (Vec::new(), 0);
        for (part, _) in &parts {
            triangles.extend(
                part.triangles()
                    .iter()
                    .map(|t| t.map(|i| i + n_vertices as u32)),
            );
            n_vertices += part.n_vertices();
        }
        Self {
            parts,
            triangles,
            n_vertices,
        }
    }
}

impl MovingSurface for Figure {
    fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }
    fn n_vertices(&self) -> usize {
        self.n_vertices
    }
    fn positions_at(&self, time_s: f64, out: &mut [Vec3]) {
        let mut out = out;
        for (part, swing) in &self.parts {
            let (mine, rest) = std::mem::take(&mut out).split_at_mut(part.n_vertices());
            part.positions_at(0.0, mine);
            let angle = swing.amplitude_rad
                * (std::f64::consts::TAU * 0.9 * time_s + swing.phase_rad).sin();
            let turn = DQuat::from_rotation_x(angle).as_quat();
            let pivot = swing.pivot.as_vec3();
            // Walks towards the radar at 1.2 m/s.
            let place = Vec3::new(0.1, 3.0 - 1.2 * time_s as f32, 0.0) + pivot;
            for p in mine {
                *p = turn * (*p - pivot) + place;
            }
            out = rest;
        }
    }
    fn material(&self) -> Material {
        CLOTH
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut args = std::env::args().skip(1);
    let n_frames: u64 = args.next().map_or(Ok(100), |a| a.parse())?;
    let raster_size = args
        .next()
        .map_or(Ok(SimOptions::default().raster_size), |a| a.parse())?;
    let options = SimOptions {
        raster_size,
        ..Default::default()
    };
    let figure = Figure::new(0.0238);
    let config = RadarConfig::awr1843boost();
    let scene = Scene {
        surfaces: vec![&figure],
        points: vec![],
        noise: Noise::Thermal,
    };
    let mut simulator = Simulator::new(&config, options.clone())?;
    let mut cube = simulator.new_cube();
    let time_s = |frame: u64| (frame % 10) as f64 * config.frame_period_s;
    for frame in 0..5 {
        simulator.simulate_frame(&scene, frame, time_s(frame), 1, &mut cube)?;
    }
    let mut total = StageSeconds::default();
    let mut fastest_s = f64::INFINITY;
    let (mut visible, mut groups, mut nodes) = (0, 0, 0);
    let cpu_before_s = cpu_s();
    let clock = Instant::now();
    for frame in 0..n_frames {
        let one = Instant::now();
        let stats = simulator.simulate_frame(&scene, frame, time_s(frame), 1, &mut cube)?;
        fastest_s = fastest_s.min(one.elapsed().as_secs_f64());
        let s = stats.seconds;
        total.positions += s.positions;
        total.visibility += s.visibility;
        total.sources += s.sources;
        total.spread += s.spread;
        total.transform += s.transform;
        visible += stats.n_visible;
        groups += stats.n_groups;
        nodes += stats.n_nodes;
    }
    let busy_s = cpu_s()
        .zip(cpu_before_s)
        .map(|(after, before)| (after - before) / n_frames as f64);
    let frame_s = clock.elapsed().as_secs_f64() / n_frames as f64;
    let per = |x: usize| x as f64 / n_frames as f64;
    let ms = |x: f64| 1e3 * x / n_frames as f64;
    println!(
        "facets {}, visible {:.0}, Doppler groups {:.0}, slow-time nodes per source {:.1}",
        figure.triangles.len(),
        per(visible),
        per(groups),
        nodes as f64 / visible as f64
    );
    println!(
        "fast: {:.1} frames/s mean of {n_frames}, {:.1} frames/s best frame",
        1.0 / frame_s,
        1.0 / fastest_s
    );
    if let Some(busy_s) = busy_s {
        println!(
            "      {:.1} frames per second of processor time (other programs excluded)",
            1.0 / busy_s
        );
    }
    println!(
        "ms: positions {:.2}, visibility {:.2}, sources {:.2}, spread {:.2}, FFT and noise {:.2}",
        ms(total.positions),
        ms(total.visibility),
        ms(total.sources),
        ms(total.spread),
        ms(total.transform)
    );
    let clock = Instant::now();
    let mut direct = simulator.new_cube();
    reference::simulate_loops(&config, &options, &scene, 0.0, 1, 0..1, &mut direct)?;
    let direct_s = clock.elapsed().as_secs_f64() * config.n_loops as f64;
    println!(
        "direct sum: {direct_s:.1} s/frame (one loop measured), {:.0} times slower",
        direct_s / frame_s
    );
    println!(
        "peak memory: {} MB",
        peak_rss_mb().map_or("unknown".into(), |m| m.to_string())
    );
    Ok(())
}

/// Peak resident set of this process from /proc, where there is one.
fn peak_rss_mb() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with("VmHWM"))?;
    Some(line.split_whitespace().nth(1)?.parse::<u64>().ok()? / 1024)
}

/// Processor time of this thread so far from /proc, where there is one.
fn cpu_s() -> Option<f64> {
    let line = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    Some(line.split_whitespace().next()?.parse::<f64>().ok()? * 1e-9)
}
