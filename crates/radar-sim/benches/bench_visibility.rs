//! What the visible shares of facets cost and leave of error in the cube: rasters of several kinds and
//! sizes against 256 rays a facet, for the built-in body in free space and in a room.
//!
//! `cargo bench -p radarllm-radar-sim --bench bench_visibility`

#![allow(clippy::print_stdout, reason = "a bench")]

use std::{error::Error, sync::Arc};

use glam::{DQuat, DVec3};
use radarllm_base::{MovingSurface, RadarConfig, frames::Placement};
use radarllm_body::{
    MotionSampler,
    mesh::{BodyModel, BodyShape, BuiltinBody, PosedBody, clothed_skin},
};
use radarllm_radar_sim::shapes::RigidSurface;
use radarllm_radar_sim::{Noise, Sampling, Scene, SimOptions, Simulator};

fn main() -> Result<(), Box<dyn Error>> {
    let config = RadarConfig::awr1843boost();
    let rendered = radarllm_motions::parse("builtin:walk")?.render(1);
    let body: Arc<dyn BodyModel> = Arc::new(BuiltinBody::new(&BodyShape::default())?);
    let walker = PosedBody::new(
        body,
        MotionSampler::new(&rendered.motion),
        Placement::default(),
        clothed_skin(),
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
    visibility(&config, "free space", vec![&walker])?;
    visibility(&config, "room", vec![&walker, &floor, &left, &back])
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
