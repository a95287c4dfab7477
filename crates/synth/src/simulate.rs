//! Simulates a motion, given as a file or a built-in motion, or a scene file to a clip of points.

use std::path::{Path, PathBuf};

use radarllm_base::{
    Clip, Motion, RadarConfig, RadarCube, frames::Placement, message::option, seed::derive_seed,
};
use radarllm_body::{loaders::load_motion_file, mesh::BodyShape, sample::canonicalize};
use radarllm_io::{Error, ErrorKind, TiFirmware};
use radarllm_radar_dsp::DspOptions;
use serde::Serialize;

use crate::{
    Method, SynthError, Synthesizer,
    objects::ObjectsFile,
    placement::{PlacementRange, draw_placement},
    simulation::{Performed, Simulation},
    synthesizer::builtin_shape,
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
    if path.is_dir() {
        let error = Error::in_file(path, "is a folder, and no recording was found in it");
        return Err(error.with_hint(
            "of folders, those of TI's visualizers (replay_1.json, ...), of raw captures and of single frames are read as \
             one recording; name the files of other folders",
        ));
    }
    let loaded = load_motion_file(path).map_err(|e| {
        let (kind, hint) = if !path.exists() {
            let hint = "there is no such file, folder or port; built-in motions are builtin:NAME";
            (ErrorKind::NotFound, hint)
        } else {
            let hint = "recordings: --format names the format of one that is not recognised; motions: .bvh, .amc (with \
                        its .asf), AMASS .npz, HumanML3D .npy, or builtin:NAME";
            (ErrorKind::Input, hint)
        };
        Error::wrap(e).of_kind(kind).naming(path).with_hint(hint)
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

/// Options of a simulation. Motions use all of them; a scene names its own targets, so that [`Self::own_noise`] does not
/// concern it and another [`Self::distance_m`] than the default or a [`Self::body`] is refused.
#[derive(Clone, Debug, PartialEq)]
pub struct SimulateOptions {
    /// Seed of the noise and of a built-in motion's small variations.
    pub seed: u64,
    /// Distance from the radar to the middle of the motion's path, m, from [`MIN_DISTANCE_M`] to the radar's maximum
    /// range. A path whose near end would be nearer than [`MIN_DISTANCE_M`] is farther away; see [`Simulation::moved_to_m`].
    ///
    /// [`MIN_DISTANCE_M`]: crate::placement::MIN_DISTANCE_M
    pub distance_m: f32,
    /// Height of the radar above the floor, m. The `[room]` of a scene states its own, with which another height than the
    /// default must agree.
    pub radar_height_m: f32,
    /// Signal processing; the `[processing]` of a scene or the library's own chain if `None`.
    pub processing: Option<DspOptions>,
    /// The board's own firmware, in place of [`Self::processing`]: its signal chain, and the limits of what it reports.
    pub firmware: Option<TiFirmware>,
    /// A user's own SMPL-X file for the body that performs a motion; the built-in body if `None`.
    pub body: Option<PathBuf>,
    /// What stands still around the target, drawn with the seed of the noise. If `None`, a motion is simulated in a
    /// furnished room before firmware that reports its surroundings, and otherwise, as every scene, in free space.
    pub objects: Option<ObjectsFile>,
    /// The fast simulator or the direct sum.
    pub method: Method,
    /// Draw the noise with [`noise_seed`] instead of the seed itself, so that the motions of a folder differ in their
    /// noise, and a motion has the same noise alone and in a folder.
    pub own_noise: bool,
}

impl SimulateOptions {
    /// Seed of the noise of a motion.
    pub(crate) fn noise_seed(&self, input: &str) -> u64 {
        match self.own_noise {
            true => noise_seed(input, self.seed),
            false => self.seed,
        }
    }

    /// The signal chain, if it is not the target's own.
    pub(crate) fn chain(&self) -> Option<DspOptions> {
        let firmware = self.firmware.as_ref().map(|f| f.chain.clone());
        firmware.or_else(|| self.processing.clone())
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
            processing: None,
            firmware: None,
            body: None,
            objects: None,
            method: Method::Fast,
            own_noise: false,
        }
    }
}

/// Whether an input names a scene file rather than a motion.
pub fn is_scene(input: &str) -> bool {
    !is_builtin(input) && Path::new(input).extension().is_some_and(|e| e == "toml")
}

/// Simulated points, and the motion that they show.
#[derive(Clone, Debug)]
pub struct SimulatedClip {
    /// The radar points.
    pub clip: Clip,
    /// The motion and where it was performed; `None` for a scene.
    pub performed: Option<Performed>,
}

/// Simulates a motion or a scene file in front of a radar: body, virtual radar and signal chain.
///
/// # Errors
/// As [`Simulation::open`], or a radar that the simulator cannot serve.
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
    let simulation = Simulation::open(input, radar, options)?;
    Ok(SimulatedClip {
        clip: simulation.clip(simulation.points(stop)?),
        performed: simulation.performed().cloned(),
    })
}

/// Raw samples of a motion or a scene file, one frame after the other: those from which [`simulate_motion`] makes points.
///
/// # Errors
/// As [`simulate_motion`]; a firmware, which reports no samples.
pub fn simulate_cubes(
    input: &str,
    radar: &RadarConfig,
    options: &SimulateOptions,
) -> Result<SimulatedCubes, Error> {
    if options.firmware.is_some() {
        return Err(Error::input(
            option("firmware").text(" reports points, not samples"),
        ));
    }
    let simulation = Simulation::open(input, radar, options)?;
    Ok(SimulatedCubes {
        synthesizer: simulation.plan()?,
        simulation,
        next: 0,
    })
}

/// Iterator over the frames of [`simulate_cubes`].
pub struct SimulatedCubes {
    simulation: Simulation,
    synthesizer: Synthesizer,
    next: usize,
}

impl Iterator for SimulatedCubes {
    type Item = Result<RadarCube, Error>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.next == self.simulation.n_frames() {
            return None;
        }
        let cube = self.simulation.cube(&mut self.synthesizer, self.next);
        self.next += 1;
        Some(cube.cloned().map_err(Error::from))
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
