//! Recorded joints through body, virtual radar and signal chain.

use std::f32::consts::TAU;
use std::path::Path;

use radarllm_base::{Motion, PointFrame, frames::Placement, seed::derive_seed, skeleton::N_JOINTS};
use radarllm_body::{mesh::BodyShape, retarget::motion_from_positions};
use radarllm_radar_sim::{Noise, Scene, SimOptions};
use radarllm_synth::{
    Method, SynthError, Synthesizer,
    synthesizer::{open_radar, posed_builtin},
};
use rayon::prelude::*;

use super::{Driver, RealismConfig, RealismError, Take};

/// Simulated frames of every take, one for each recorded frame; radar files are looked for in `base`.
///
/// The same bytes for any number of threads: a take's seed depends on its place alone.
///
/// # Errors
/// A configuration or a motion that the chain refuses.
pub fn replay(
    config: &RealismConfig,
    base: &Path,
    takes: &[Take],
) -> Result<Vec<Vec<PointFrame>>, RealismError> {
    for_each_job(config, base, takes.len(), |chain, plan, i| {
        let take = &takes[i];
        let seed = derive_seed(config.seed, &format!("take-{i:06}"));
        let mut frames = match &take.driver {
            // Scenes bring their own options, and with them a simulator of their own.
            Driver::Scene(owned, options) => {
                simulate_frames(&mut plan(options.clone())?, &owned.scene(), take, seed)?
            }
            Driver::Joints(joints) => simulate_take(config, chain, take, joints, seed)?,
        };
        lift(&mut frames, config.elevation_bias);
        Ok(frames)
    })
}

/// Plans a chain with other options of the simulator.
type Plan<'a> = &'a dyn Fn(SimOptions) -> Result<Synthesizer, RealismError>;

/// `job(chain, plan, i)` for i in 0..`n_jobs`, in order; threads do not share a chain.
pub(super) fn for_each_job<T: Send>(
    config: &RealismConfig,
    base: &Path,
    n_jobs: usize,
    job: impl Fn(&mut Synthesizer, Plan<'_>, usize) -> Result<T, RealismError> + Sync,
) -> Result<Vec<T>, RealismError> {
    let radar = open_radar(&config.radar, base)?;
    let impairments = config.impairments.resolve().map_err(SynthError::Config)?;
    let plan = |options: SimOptions| -> Result<Synthesizer, RealismError> {
        let dsp = config.processing.resolve(&radar);
        let chain = Synthesizer::with_simulation(&radar, Method::Fast, dsp, options)?;
        Ok(chain.with_impairments(impairments))
    };
    let first = || {
        plan(SimOptions {
            max_bounces: config.max_bounces,
            ..SimOptions::default()
        })
    };
    (0..n_jobs)
        .into_par_iter()
        .map_init(
            || None,
            |chain, i| {
                let chain = match chain {
                    Some(ready) => ready,
                    None => chain.insert(first()?),
                };
                job(chain, &plan, i)
            },
        )
        .collect()
}

fn simulate_take(
    config: &RealismConfig,
    synthesizer: &mut Synthesizer,
    take: &Take,
    joints: &[[glam::Vec3; N_JOINTS]],
    seed: u64,
) -> Result<Vec<PointFrame>, RealismError> {
    let name = format!("{} {} {}", take.subject, take.part, take.class + 1);
    let origin = glam::Vec3::from_array(config.joints_origin_m);
    let fps = synthesizer.radar().frame_rate_hz();
    let (mut motion, placement) = placed_motion(&name, joints, origin, fps)?;
    sway(&mut motion, config.sway_mps, derive_seed(seed, "sway"));
    let shape = BodyShape {
        height_m: radarllm_body::proportions::standing_height_m(&motion.skeleton).clamp(1.0, 2.0),
        facet_edge_m: config.facet_edge_m,
        ..BodyShape::default()
    };
    let surface = posed_builtin(&motion, shape, placement)?;
    let scene = Scene {
        surfaces: vec![&surface],
        points: Vec::new(),
        noise: Noise::Thermal,
    };
    simulate_frames(synthesizer, &scene, take, seed)
}

fn simulate_frames(
    synthesizer: &mut Synthesizer,
    scene: &Scene,
    take: &Take,
    seed: u64,
) -> Result<Vec<PointFrame>, RealismError> {
    let mut simulated = Vec::with_capacity(take.frames.len());
    for recorded in &take.frames {
        synthesizer.simulate(scene, recorded.frame as usize, seed)?;
        simulated.push(synthesizer.extract(recorded.frame as usize)?);
    }
    Ok(simulated)
}

/// Adds `bias` to z / range of every point; directions end at the edge of the half space.
pub(super) fn lift(frames: &mut [PointFrame], bias: f64) {
    for p in frames.iter_mut().flat_map(|f| &mut f.points) {
        let range_m = f64::from(p.range_m).max(1e-3);
        let u_x = f64::from(p.x_m) / range_m;
        let max = (1.0 - u_x * u_x).max(0.0).sqrt();
        let u_z = (f64::from(p.z_m) / range_m + bias).clamp(-max, max);
        p.z_m = (range_m * u_z) as f32;
        p.y_m = (range_m * (1.0 - u_x * u_x - u_z * u_z).max(0.0).sqrt()) as f32;
    }
}

/// Frequencies of the sway, Hz: quiet standing has most of its power below 1 Hz. No two beat within a
/// take.
const SWAY_HZ: [f32; 4] = [0.23, 0.41, 0.67, 1.03];

/// Moves the root to and fro along x and y with an rms speed of `rms_mps` each.
fn sway(motion: &mut Motion, rms_mps: f32, seed: u64) {
    let phase = |name: &str| {
        // The upper bits of a well-mixed seed are uniform.
        (derive_seed(seed, name) >> 40) as f32 / (1_u64 << 24) as f32 * TAU
    };
    let waves: Vec<[f32; 3]> = SWAY_HZ
        .iter()
        .map(|hz| [*hz, phase(&format!("x{hz}")), phase(&format!("y{hz}"))])
        .collect();
    // Four sines of equal speed: each has a mean square speed of half its amplitude's square.
    let speed_mps = rms_mps * (2.0 / SWAY_HZ.len() as f32).sqrt();
    for (i, pose) in motion.poses.iter_mut().enumerate() {
        let time_s = i as f32 / motion.fps as f32;
        for &[hz, x, y] in &waves {
            let length_m = speed_mps / (TAU * hz);
            pose.root_in_world.x += length_m * (TAU * hz * time_s + x).sin();
            pose.root_in_world.y += length_m * (TAU * hz * time_s + y).sin();
        }
    }
}

/// The motion around its own middle, and the placement that puts it where it was recorded.
///
/// Bodies scale a motion's path with their legs; a path around zero keeps its place in the room. The
/// floor is found under the recorded feet.
fn placed_motion(
    name: &str,
    joints: &[[glam::Vec3; N_JOINTS]],
    origin: glam::Vec3,
    fps: f64,
) -> Result<(Motion, Placement), RealismError> {
    let mut motion = motion_from_positions(name, joints, fps)?;
    let n = joints.len() as f32;
    let middle = origin + joints.iter().map(|j| j[0]).sum::<glam::Vec3>() / n;
    let grounded = motion
        .poses
        .iter()
        .map(|p| p.root_in_world)
        .sum::<glam::Vec3>()
        / n;
    for pose in &mut motion.poses {
        pose.root_in_world.x -= middle.x - origin.x;
        pose.root_in_world.y -= middle.y - origin.y;
    }
    let placement = Placement {
        position_m: [middle.x, middle.y],
        heading_rad: 0.0,
        radar_height_m: grounded.z - middle.z,
    };
    Ok((motion, placement))
}
