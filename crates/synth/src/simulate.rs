//! Simulates a motion, given as a file or a built-in motion, to a clip of points.

use std::path::Path;

use radarllm_base::{
    Clip, Clutter, Motion, PointFrame, Provenance, RadarConfig, RadarCube, frames::Placement,
    seed::derive_seed,
};
use radarllm_body::{
    loaders::load_motion_file,
    mesh::{BodyShape, PosedBody},
    sample::canonicalize,
};
use radarllm_io::{Error, ErrorKind, options::MAX_FRAMES};
use radarllm_radar_dsp::DspOptions;
use radarllm_radar_sim::{Noise, Scene};
use serde::Serialize;

use crate::{
    Method, SynthError, Synthesizer,
    placement::{PlacementRange, draw_placement},
    synthesizer::{builtin_shape, posed_builtin, scene_to_points_until},
};

/// A motion, the body that performs it, and information from its file or its parameters.
#[derive(Clone, Debug)]
pub struct MotionInput {
    /// The motion; it starts at the origin and faces the radar.
    pub motion: Motion,
    /// The body that performs it.
    pub shape: BodyShape,
    /// Information about the source.
    pub info: MotionInfo,
}

/// Information about the source of a motion.
#[derive(Clone, Debug, Serialize)]
pub struct MotionInfo {
    /// File format, or `builtin`.
    pub format: String,
    /// Number of poses.
    pub frames: usize,
    /// Poses per second.
    pub fps: f64,
    /// Length, s.
    pub duration_s: f64,
    /// Joints in the source.
    pub joints: usize,
    /// Unit of lengths in the source.
    pub unit: String,
    /// Standing height of the skeleton, m.
    pub height_m: f64,
    /// Contents of the source that this project does not use.
    pub skipped: Vec<String>,
    /// Warnings about suspicious content.
    pub warnings: Vec<String>,
    /// Captions of built-in motions.
    pub captions: Vec<String>,
}

/// Whether an input names a built-in motion rather than a file.
pub fn is_builtin(input: &str) -> bool {
    input.starts_with("builtin:")
}

/// Loads a motion file (BVH, AMC with its ASF, AMASS npz, HumanML3D npy) or renders a built-in motion
/// (`builtin:NAME?key=value`). The small variations of a built-in motion are drawn with `seed`.
///
/// ```
/// let walk = radarllm_synth::open_motion("builtin:walk?direction=backward", 1)?;
/// assert_eq!(walk.info.format, "builtin");
/// assert!(walk.info.captions.iter().any(|caption| caption.contains("backward")));
/// # Ok::<(), radarllm_io::Error>(())
/// ```
///
/// # Errors
/// An unknown motion or key, or a file that cannot be read, with its name and position.
pub fn open_motion(input: &str, seed: u64) -> Result<MotionInput, Error> {
    if is_builtin(input) {
        return open_builtin(input, seed);
    }
    let path = Path::new(input);
    let loaded = load_motion_file(path).map_err(|e| {
        let kind = match path.exists() {
            true => ErrorKind::Input,
            false => ErrorKind::NotFound,
        };
        Error::wrap(e).of_kind(kind).naming(path).with_hint(
            "motions: .bvh, .amc (with its .asf), AMASS .npz, HumanML3D .npy, or builtin:NAME",
        )
    })?;
    let info = MotionInfo {
        format: loaded.format.to_string(),
        frames: loaded.frames,
        fps: loaded.fps,
        duration_s: loaded.motion.duration_s(),
        joints: loaded.n_source_joints,
        unit: loaded.unit.clone(),
        height_m: f64::from(loaded.height_m),
        skipped: loaded.skipped.clone(),
        warnings: loaded.warnings.clone(),
        captions: Vec::new(),
    };
    let mut motion = loaded.motion;
    canonicalize(&mut motion);
    let shape = BodyShape {
        height_m: loaded.height_m.clamp(1.0, 2.0),
        ..BodyShape::default()
    };
    Ok(MotionInput {
        motion,
        shape,
        info,
    })
}

/// The motion files of a folder, sorted: BVH, AMC, npz and npy.
///
/// # Errors
/// A folder that cannot be read, or without a motion file.
pub fn motion_files(folder: &Path) -> Result<Vec<String>, Error> {
    let io = |e| Error::io(folder, e);
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(io)? {
        let file = entry.map_err(io)?.path();
        let is = |extension: &str| file.extension().is_some_and(|e| e == extension);
        if ["bvh", "amc", "npz", "npy"].into_iter().any(is) {
            files.push(file.display().to_string());
        }
    }
    if files.is_empty() {
        let problem = "no .bvh, .amc, .npz or .npy file in this folder";
        return Err(Error::in_file(folder, problem));
    }
    files.sort();
    Ok(files)
}

fn open_builtin(input: &str, seed: u64) -> Result<MotionInput, Error> {
    let request = radarllm_motions::parse(input).map_err(|e| {
        Error::input(format!("{input}: {e}"))
            .caused_by(e)
            .with_hint("`radarllm motion list` prints all motions with their keys")
    })?;
    let rendered = request.render(seed);
    let shape = builtin_shape(&rendered);
    let info = MotionInfo {
        format: "builtin".into(),
        frames: rendered.motion.len(),
        fps: rendered.motion.fps,
        duration_s: rendered.motion.duration_s(),
        joints: radarllm_base::skeleton::N_JOINTS,
        unit: "m".into(),
        height_m: f64::from(rendered.height_m),
        skipped: Vec::new(),
        warnings: Vec::new(),
        captions: rendered.captions,
    };
    Ok(MotionInput {
        motion: rendered.motion,
        shape,
        info,
    })
}

/// Simulation options for a motion.
#[derive(Clone, Debug, PartialEq)]
pub struct SimulateOptions {
    /// Seed of the noise and of a built-in motion's small variations.
    pub seed: u64,
    /// Distance from the radar to the middle of the motion's path, m.
    pub distance_m: f32,
    /// Height of the radar above the floor, m.
    pub radar_height_m: f32,
    /// Signal processing.
    pub processing: DspOptions,
    /// The fast simulator or the direct sum.
    pub method: Method,
    /// Draw the noise with [`noise_seed`] instead of the seed itself, so that the motions of a folder differ in their
    /// noise, and a motion has the same noise alone and in a folder.
    pub own_noise: bool,
}

impl SimulateOptions {
    /// Seed of the noise of an input.
    fn noise_seed(&self, input: &str) -> u64 {
        match self.own_noise {
            true => noise_seed(input, self.seed),
            false => self.seed,
        }
    }
}

/// Seed of a motion's own noise: it depends on the seed and on the name of the motion, not on its folder.
pub fn noise_seed(input: &str, seed: u64) -> u64 {
    let name = Path::new(input).file_stem().map(|s| s.to_string_lossy());
    derive_seed(seed, name.as_deref().unwrap_or(input))
}

impl Default for SimulateOptions {
    fn default() -> Self {
        Self {
            seed: 1,
            distance_m: 3.0,
            radar_height_m: 1.0,
            processing: DspOptions::default(),
            method: Method::Fast,
            own_noise: false,
        }
    }
}

/// A simulated clip and the performed motion.
#[derive(Clone, Debug)]
pub struct SimulatedClip {
    /// The radar points.
    pub clip: Clip,
    /// The motion.
    pub motion: MotionInput,
    /// Position and heading of the motion.
    pub placement: Placement,
}

/// Simulates a motion in front of a radar: body, virtual radar and signal chain.
///
/// # Errors
/// As [`open_motion`], or a radar that the simulator cannot serve.
pub fn simulate_motion(
    input: &str,
    radar: &RadarConfig,
    options: &SimulateOptions,
) -> Result<SimulatedClip, Error> {
    simulate_motion_until(input, radar, options, &|| false)
}

/// As [`simulate_motion`], but ends early once `stop` returns `true`, which is asked before every frame.
///
/// # Errors
/// As [`simulate_motion`]; an error of kind [`ErrorKind::Interrupted`] if it was stopped.
pub fn simulate_motion_until(
    input: &str,
    radar: &RadarConfig,
    options: &SimulateOptions,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<SimulatedClip, Error> {
    let motion = open_motion(input, options.seed)?;
    let placement = place(&motion.motion, options.distance_m, options.radar_height_m);
    let plan = || Synthesizer::new(radar, options.method, options.processing.clone());
    let n_frames = radar
        .frames_in(motion.motion.duration_s())
        .clamp(1, MAX_FRAMES);
    let body = posed_builtin(&motion.motion, motion.shape, placement)?;
    let scene = Scene {
        surfaces: vec![&body],
        points: Vec::new(),
        noise: Noise::Thermal,
    };
    let seed = options.noise_seed(input);
    let frames = scene_to_points_until(plan, &scene, n_frames, seed, stop)?;
    Ok(SimulatedClip {
        clip: clip(frames, input, radar, options.radar_height_m, seed),
        motion,
        placement,
    })
}

/// Raw samples of a motion before a radar, one frame after the other: those from which [`simulate_motion`] makes points.
///
/// # Errors
/// As [`simulate_motion`].
pub fn simulate_cubes(
    input: &str,
    radar: &RadarConfig,
    options: &SimulateOptions,
) -> Result<SimulatedCubes, Error> {
    let motion = open_motion(input, options.seed)?;
    let placement = place(&motion.motion, options.distance_m, options.radar_height_m);
    let n_frames = radar.frames_in(motion.motion.duration_s());
    Ok(SimulatedCubes {
        n_frames: n_frames.clamp(1, MAX_FRAMES),
        body: posed_builtin(&motion.motion, motion.shape, placement)?,
        synthesizer: Synthesizer::new(radar, options.method, options.processing.clone())?,
        next: 0,
        seed: options.noise_seed(input),
    })
}

/// Iterator over the frames of [`simulate_cubes`].
pub struct SimulatedCubes {
    body: PosedBody,
    synthesizer: Synthesizer,
    n_frames: usize,
    next: usize,
    seed: u64,
}

impl Iterator for SimulatedCubes {
    type Item = Result<RadarCube, Error>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.next == self.n_frames {
            return None;
        }
        let scene = Scene {
            surfaces: vec![&self.body],
            points: Vec::new(),
            noise: Noise::Thermal,
        };
        let cube = self.synthesizer.simulate(&scene, self.next, self.seed);
        self.next += 1;
        Some(cube.cloned().map_err(Error::from))
    }
}

fn clip(
    frames: Vec<PointFrame>,
    input: &str,
    radar: &RadarConfig,
    radar_height_m: f32,
    seed: u64,
) -> Clip {
    Clip {
        frames,
        frame_rate_hz: radar.frame_rate_hz(),
        radar_height_m,
        radar: radar.name.clone(),
        provenance: Provenance::simulated(input, seed),
        clutter: Clutter::Settled,
    }
}

/// Places a motion at a distance on boresight, with its own heading.
pub fn place(motion: &Motion, distance_m: f32, radar_height_m: f32) -> Placement {
    let range = PlacementRange {
        distance_m: [distance_m; 2],
        lateral_m: 0.0,
        heading_rad: 0.0,
        radar_height_m,
    };
    draw_placement(motion, &range, 0)
}

impl From<SynthError> for Error {
    fn from(error: SynthError) -> Self {
        match error {
            SynthError::Radar(error) => error,
            SynthError::Dataset(error) => error.into(),
            SynthError::Interrupted => Self::wrap(error).of_kind(ErrorKind::Interrupted),
            other => Self::wrap(other),
        }
    }
}
