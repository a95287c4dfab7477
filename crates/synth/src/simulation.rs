//! One motion or scene in front of a radar, opened once and simulated frame by frame.

use std::{path::Path, sync::Arc};

use glam::Vec3;
use radarllm_base::{
    Clip, Clutter, MovingSurface, PointFrame, Provenance, RadarConfig, RadarCube,
    SPEED_OF_LIGHT_MPS,
    frames::Placement,
    message::{option, text},
    seed::derive_seed,
};
use radarllm_body::{
    MotionSampler,
    mesh::{PosedBody, SmplxBody, clothed_skin},
};
use radarllm_files::bounded::{self, MAX_CONFIG_BYTES};
use radarllm_io::{Error, TiFirmware};
use radarllm_radar_dsp::DspOptions;
use radarllm_radar_sim::{Impairments, Noise, PointTarget, Scene, SimOptions};

use crate::{
    Method, SynthError, Synthesizer,
    objects::ObjectsFile,
    placement::{PlacementRange, min_middle_m},
    processing::ProcessingFile,
    scene::{OwnedScene, SceneFile},
    simulate::{MotionInput, SimulateOptions, is_scene, open_motion, place},
    synthesizer::{posed_builtin, scene_to_points_until},
};

/// Maximum number of radar frames of a simulation: about 17 minutes at 10 frames/s.
const MAX_FRAMES: usize = 10_000;

/// No part of a body is farther from its pelvis, m: more than a raised arm of somebody 2 m tall.
const BODY_REACH_M: f32 = 1.5;

/// A motion that is simulated, and where.
#[derive(Clone, Debug)]
pub struct Performed {
    /// The motion and the body that performs it.
    pub motion: MotionInput,
    /// Where the person stands in front of the radar.
    pub placement: Placement,
}

/// A motion or a scene in front of a radar. The command, [`crate::simulate_motion`] and [`crate::simulate_cubes`]
/// simulate through this type, so that the same input and options give the same samples everywhere.
pub struct Simulation {
    input: String,
    target: Target,
    chain: Chain,
    firmware: Option<TiFirmware>,
    /// As asked for.
    distance_m: f32,
    radar_height_m: f32,
    n_frames: usize,
    /// Seed of the noise.
    seed: u64,
}

/// What the radar sees.
enum Target {
    Person {
        body: Box<PosedBody>,
        performed: Box<Performed>,
    },
    Scene(OwnedScene),
}

/// What is needed to plan the chain of a thread.
struct Chain {
    radar: RadarConfig,
    method: Method,
    processing: DspOptions,
    simulator: SimOptions,
    impairments: Impairments,
    /// What stands still around the target.
    objects: Vec<PointTarget>,
}

impl Simulation {
    /// Opens a motion, as [`open_motion`] does, or a scene file (`.toml`).
    ///
    /// # Errors
    /// As [`open_motion`]; a scene or a body that cannot be read; more frames than are handled; a firmware together with
    /// another signal chain; a distance at which nobody can be seen; options that a scene does not use or contradicts.
    pub fn open(
        input: &str,
        radar: &RadarConfig,
        options: &SimulateOptions,
    ) -> Result<Self, Error> {
        if options.firmware.is_some() && options.processing.is_some() {
            return Err(Error::input(
                option("firmware")
                    .text(" and ")
                    .option("processing")
                    .text(" each state a signal chain: only one is possible"),
            ));
        }
        if let Some(objects) = &options.objects {
            objects.check().map_err(Error::input)?;
        }
        let Opened {
            target,
            chain,
            seed,
            duration_s,
            radar_height_m,
        } = match is_scene(input) {
            true => scene(input, radar, options)?,
            false => person(input, radar, options)?,
        };
        let n_frames = chain.radar.frames_in(duration_s).max(1);
        if n_frames > MAX_FRAMES {
            return Err(Error::input(format!(
                "{input}: {n_frames} radar frames, at most {MAX_FRAMES} are handled"
            )));
        }
        Ok(Self {
            input: input.into(),
            target,
            chain,
            firmware: options.firmware.clone(),
            distance_m: options.distance_m,
            radar_height_m,
            n_frames,
            seed,
        })
    }

    /// Radar frames: as many as the motion or the scene lasts.
    pub fn n_frames(&self) -> usize {
        self.n_frames
    }

    /// Seed of the noise.
    pub fn seed(&self) -> u64 {
        self.seed
    }

    /// The radar, with the noise figure of the scene.
    pub fn radar(&self) -> &RadarConfig {
        &self.chain.radar
    }

    /// Height of the radar above the floor, m: that of the scene's room, or the one asked for.
    pub fn radar_height_m(&self) -> f32 {
        self.radar_height_m
    }

    /// Distance of the middle of the motion's path, m, if it is not the one asked for: the path is so deep that its near
    /// end would have been nearer than [`crate::placement::MIN_DISTANCE_M`].
    pub fn moved_to_m(&self) -> Option<f32> {
        let Performed { motion, placement } = self.performed()?;
        let min_m = min_middle_m(&motion.motion, placement.heading_rad);
        // Half a centimetre is rounding.
        (min_m > self.distance_m + 0.005).then_some(min_m)
    }

    /// Number of frames in whose middle a part of a body or a target is farther than the radar's maximum range. The radar
    /// receives nothing of such parts. The walls of a room do not count.
    pub fn frames_beyond_range(&self) -> usize {
        let radar = &self.chain.radar;
        let max_m = radar.max_range_m() as f32;
        if let Some(Performed { motion, placement }) = self.performed() {
            let pelvis_m = |p| placement.radar_from_world(p).length();
            let poses = motion.motion.poses.iter();
            let farthest_m = poses.map(|pose| pelvis_m(pose.root_in_world));
            if farthest_m.fold(0.0, f32::max) + BODY_REACH_M < max_m {
                return 0;
            }
        }
        let scene = self.scene();
        let n_targets = match &self.target {
            Target::Person { .. } => 1,
            Target::Scene(scene) => scene.n_targets(),
        };
        let mut positions = Vec::new();
        let mut reaches = |surface: &dyn MovingSurface, time_s: f64| {
            positions.resize(surface.n_vertices(), Vec3::ZERO);
            surface.positions_at(time_s, &mut positions);
            positions.iter().any(|p| p.length() > max_m)
        };
        let middle_s = 0.5 * radar.n_loops as f64 * radar.loop_period_s();
        (0..self.n_frames)
            .map(|frame_idx| frame_idx as f64 * radar.frame_period_s + middle_s)
            .filter(|&time_s| {
                let mut surfaces = scene.surfaces.iter().take(n_targets);
                let mut points = scene.points.iter();
                surfaces.any(|&surface| reaches(surface, time_s))
                    || points.any(|p| p.position_at(time_s).length() > f64::from(max_m))
            })
            .count()
    }

    /// The motion, if it is none of a scene.
    pub fn performed(&self) -> Option<&Performed> {
        match &self.target {
            Target::Person { performed, .. } => Some(performed),
            Target::Scene(_) => None,
        }
    }

    /// Plans the simulator and the signal chain. Every thread needs its own.
    ///
    /// # Errors
    /// A radar that either of them does not support.
    pub fn plan(&self) -> Result<Synthesizer, SynthError> {
        let chain = &self.chain;
        let mut synthesizer = Synthesizer::with_simulation(
            &chain.radar,
            chain.method,
            chain.processing.clone(),
            chain.simulator.clone(),
        )?
        .with_impairments(chain.impairments);
        synthesizer.set_objects(chain.objects.clone())?;
        Ok(synthesizer)
    }

    /// Raw samples of a frame, with a chain of [`Self::plan`]; the cube is overwritten by the next call.
    ///
    /// # Errors
    /// A frame that cannot be simulated.
    pub fn cube<'a>(
        &self,
        chain: &'a mut Synthesizer,
        frame_idx: usize,
    ) -> Result<&'a RadarCube, SynthError> {
        chain.simulate(&self.scene(), frame_idx, self.seed)
    }

    /// Points of all frames on all threads of the current pool, as the firmware reports them. `stop` is asked before every
    /// frame and ends the work when it returns `true`.
    ///
    /// # Errors
    /// A frame that cannot be simulated or processed; an error of kind [`radarllm_io::ErrorKind::Interrupted`] if it was
    /// stopped.
    pub fn points(&self, stop: &(dyn Fn() -> bool + Sync)) -> Result<Vec<PointFrame>, Error> {
        let scene = self.scene();
        let plan = || self.plan();
        let mut frames = scene_to_points_until(plan, &scene, self.n_frames, self.seed, stop)?;
        frames.iter_mut().for_each(|frame| self.limit(frame));
        Ok(frames)
    }

    /// Removes the points of a frame that the firmware does not report, which [`Self::points`] has done.
    pub fn limit(&self, frame: &mut PointFrame) {
        if let Some(firmware) = &self.firmware {
            firmware.limit(frame);
        }
    }

    /// Frames of points with all that is known of them.
    pub fn clip(&self, frames: Vec<PointFrame>) -> Clip {
        let radar = &self.chain.radar;
        Clip {
            frames,
            frame_rate_hz: radar.frame_rate_hz(),
            radar_height_m: self.radar_height_m,
            is_height_assumed: false,
            radar: radar.name.clone(),
            provenance: Provenance::simulated(&self.input, self.seed),
            clutter: match self.firmware {
                Some(_) => Clutter::Unchecked,
                None => Clutter::Settled,
            },
        }
    }

    /// What the radar sees, in the simulator's form.
    fn scene(&self) -> Scene<'_> {
        match &self.target {
            Target::Person { body, .. } => Scene {
                surfaces: vec![&**body],
                points: Vec::new(),
                noise: Noise::Thermal,
            },
            Target::Scene(scene) => scene.scene(),
        }
    }
}

/// What an input consists of.
struct Opened {
    target: Target,
    chain: Chain,
    /// Seed of the noise.
    seed: u64,
    duration_s: f64,
    radar_height_m: f32,
}

/// A body that performs a motion.
fn person(input: &str, radar: &RadarConfig, options: &SimulateOptions) -> Result<Opened, Error> {
    let motion = open_motion(input, options.seed)?;
    let range = PlacementRange {
        distance_m: [options.distance_m; 2],
        ..PlacementRange::default()
    };
    range
        .check(radar)
        .map_err(|problem| Error::input(option("distance_m").text(format!(": {problem}"))))?;
    let placement = place(&motion.motion, options.distance_m, options.radar_height_m);
    let body = match &options.body {
        Some(path) => PosedBody::new(
            Arc::new(SmplxBody::open(path, &[]).map_err(Error::wrap)?),
            MotionSampler::new(&motion.motion),
            placement,
            clothed_skin(),
        ),
        None => posed_builtin(&motion.motion, motion.shape, placement)?,
    };
    let firmware = options.firmware.as_ref();
    let furnished = match firmware.is_some_and(TiFirmware::reports_surroundings) {
        true => Some(ObjectsFile::furnished()),
        false => None,
    };
    let seed = options.noise_seed(input);
    let chain = Chain {
        radar: radar.clone(),
        method: options.method,
        processing: options.chain().unwrap_or_default(),
        simulator: SimOptions::default(),
        impairments: Impairments::default(),
        objects: objects(
            options.objects.as_ref().or(furnished.as_ref()),
            options.radar_height_m,
            seed,
        ),
    };
    Ok(Opened {
        chain,
        seed,
        duration_s: motion.motion.duration_s(),
        radar_height_m: options.radar_height_m,
        target: Target::Person {
            body: Box::new(body),
            performed: Box::new(Performed { motion, placement }),
        },
    })
}

/// The targets of a scene file, whose noise is drawn from the seed itself.
fn scene(input: &str, radar: &RadarConfig, options: &SimulateOptions) -> Result<Opened, Error> {
    let path = Path::new(input);
    let toml = bounded::read_text(path, MAX_CONFIG_BYTES)?;
    let file = SceneFile::from_toml(&toml).map_err(|e| Error::wrap_in_file(path, e))?;
    let usual = SimulateOptions::default();
    for (name, is_stated) in [
        ("distance_m", options.distance_m != usual.distance_m),
        ("body", options.body.is_some()),
    ] {
        if is_stated {
            let problem = option(name).text(" is for motions; a scene states what stands where");
            return Err(Error::in_file(path, problem).with_hint("leave it out"));
        }
    }
    if options.firmware.is_some() && file.processing != ProcessingFile::default() {
        let problem = option("firmware")
            .text(" and [processing] each state a signal chain: only one is possible");
        return Err(Error::in_file(path, problem));
    }
    let radar_height_m = match &file.room {
        None => options.radar_height_m,
        Some(room) => {
            let (room_m, asked_m) = (room.radar_height_m as f32, options.radar_height_m);
            if asked_m != usual.radar_height_m && asked_m != room_m {
                let problem = text(format!("[room] radar_height_m is {room_m} m, but "))
                    .option("radar_height_m")
                    .text(format!(" is {asked_m} m"));
                return Err(Error::in_file(path, problem).with_hint("state it in [room] alone"));
            }
            room_m
        }
    };
    let base = path.parent().unwrap_or(Path::new(""));
    // Not `carrier_hz`, from which it differs by rounding: the samples of scenes with walls would change in their last bit.
    let frequency_hz = SPEED_OF_LIGHT_MPS / radar.wavelength_m();
    let targets = OwnedScene::open(&file, base, frequency_hz);
    let targets = targets.map_err(|e| Error::wrap_in_file(path, e))?;
    let impairments = file.impairments.resolve();
    let radar = file.radar(radar);
    let chain = Chain {
        method: options.method,
        processing: options
            .chain()
            .unwrap_or_else(|| file.processing.resolve(&radar)),
        simulator: file.sim_options(),
        impairments: impairments.map_err(|e| Error::in_file(path, e))?,
        objects: objects(options.objects.as_ref(), radar_height_m, options.seed),
        radar,
    };
    Ok(Opened {
        target: Target::Scene(targets),
        chain,
        seed: options.seed,
        duration_s: file.duration_s,
        radar_height_m,
    })
}

/// What stands still around the target.
fn objects(file: Option<&ObjectsFile>, radar_height_m: f32, noise_seed: u64) -> Vec<PointTarget> {
    let height_m = f64::from(radar_height_m);
    let drawn = file.map(|file| file.draw(height_m, derive_seed(noise_seed, "objects")));
    drawn.unwrap_or_default()
}
