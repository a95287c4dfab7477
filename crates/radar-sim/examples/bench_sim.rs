//! Frames per second of the fast path on one core, for a walking figure of ellipsoids with about
//! 11,000 facets at 3 m, and its ratio to the direct sum; then what the rasters' visible shares cost
//! and leave of error in the cube, against 256 rays a facet.
//!
//! `cargo run --release -p radarllm-radar-sim --example bench_sim [n_frames] [raster_size]`

use std::error::Error;
use std::time::Instant;

use glam::{DQuat, DVec3, Vec3};
use radarllm_base::{Material, MovingSurface, RadarConfig};
use radarllm_radar_sim::shapes::RigidSurface;
use radarllm_radar_sim::{Noise, Sampling, Scene, SimOptions, Simulator, StageSeconds, reference};

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
    let half_pi = std::f64::consts::FRAC_PI_2;
    let floor = RigidSurface::graded_plate([-2.5, 2.5], [0.0, 6.0], [0.0; 2], 0.02)
        .turned(DQuat::from_rotation_x(-half_pi))
        .at(DVec3::NEG_Z);
    let left = RigidSurface::graded_plate([0.0, 6.0], [-1.0, 1.5], [0.0; 2], 0.02)
        .turned(DQuat::from_rotation_z(half_pi))
        .at(DVec3::NEG_X * 2.5);
    let back =
        RigidSurface::graded_plate([-2.5, 2.5], [-1.0, 1.5], [0.0; 2], 0.02).at(DVec3::Y * 6.0);
    visibility(&config, "free space", vec![&figure])?;
    visibility(&config, "room", vec![&figure, &floor, &left, &back])?;
    println!(
        "peak memory: {} MB",
        peak_rss_mb().map_or("unknown".into(), |m| m.to_string())
    );
    Ok(())
}

/// Time and error of the visible shares over a few frames.
fn visibility(
    config: &RadarConfig,
    name: &str,
    surfaces: Vec<&dyn MovingSurface>,
) -> Result<(), Box<dyn Error>> {
    let scene = Scene {
        surfaces,
        points: vec![],
        noise: Noise::Off,
    };
    let cubes = |sampling, raster_size| -> Result<_, Box<dyn Error>> {
        let options = SimOptions {
            sampling,
            raster_size,
            ..Default::default()
        };
        let mut simulator = Simulator::new(config, options)?;
        let (mut cubes, mut fastest_s) = (Vec::new(), f64::INFINITY);
        let repeat = if sampling == Sampling::Rays(16) { 1 } else { 5 };
        for frame in 0..6 {
            let mut cube = simulator.new_cube();
            for _ in 0..repeat {
                let time_s = 0.13 * frame as f64;
                let stats = simulator.simulate_frame(&scene, frame, time_s, 1, &mut cube)?;
                fastest_s = fastest_s.min(stats.seconds.visibility);
            }
            cubes.push(cube);
        }
        Ok((cubes, fastest_s))
    };
    let (exact, exact_s) = cubes(Sampling::Rays(16), 320)?;
    println!("visibility, {name}: rays {:.0} ms", 1e3 * exact_s);
    for (sampling, size) in [
        (Sampling::Uniform, 160),
        (Sampling::Uniform, 320),
        (Sampling::Uniform, 640),
        (Sampling::Windows, 320),
        (Sampling::Windows, 640),
    ] {
        let (found, fastest_s) = cubes(sampling, size)?;
        let (mut error, mut power, mut power_found) = (0.0, 0.0, 0.0);
        let mut worst_db = 0.0_f64;
        for (found, exact) in found.iter().zip(&exact) {
            let (mut frame, mut frame_found) = (0.0, 0.0);
            for (f, e) in found.data.iter().zip(&exact.data) {
                error += f64::from((f - e).norm_sqr());
                frame += f64::from(e.norm_sqr());
                frame_found += f64::from(f.norm_sqr());
            }
            worst_db = worst_db.max((10.0 * (frame_found / frame).log10()).abs());
            power += frame;
            power_found += frame_found;
        }
        println!(
            "  {sampling:?} {size}: {:.2} ms, cube error {:.1} dB, power {:+.3} dB, worst frame {worst_db:.3} dB",
            1e3 * fastest_s,
            10.0 * (error / power).log10(),
            10.0 * (power_found / power).log10(),
        );
    }
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
