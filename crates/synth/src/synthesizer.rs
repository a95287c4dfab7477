//! Converts one motion or scene to points with the body model, the virtual radar and the signal chain.

use std::{
    collections::HashMap,
    path::Path,
    sync::{Arc, Mutex, OnceLock},
};

use radarllm_base::{Motion, PointFrame, RadarConfig, RadarCube, frames::Placement};
use radarllm_body::{
    MotionSampler,
    mesh::{BodyModel, BodyShape, BuiltinBody, PosedBody, clothed_skin},
};
use radarllm_motions::Procedural;
use radarllm_radar_dsp::{DspError, DspOptions, PointExtractor};
use radarllm_radar_sim::{
    Impairments, Noise, PointTarget, Scene, SimError, SimOptions, Simulator, reference,
    shapes::RigidSurface,
};

use rayon::prelude::*;

use crate::corpus::CorpusError;

/// Why a record cannot be computed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SynthError {
    /// The data set configuration is invalid.
    #[error("configuration: {0}")]
    Config(String),
    /// The radar description is invalid.
    #[error("{0}")]
    Radar(#[from] radarllm_io::Error),
    /// A source of motions is invalid.
    #[error("{0}")]
    Corpus(#[from] CorpusError),
    /// The body cannot be generated.
    #[error("body: {0}")]
    Body(String),
    /// The simulator returned an error.
    #[error("simulator: {0}")]
    Sim(#[from] SimError),
    /// The signal chain returned an error.
    #[error("signal chain: {0}")]
    Dsp(#[from] DspError),
    /// The caller stopped the work.
    #[error("stopped")]
    Interrupted,
    /// The data set returned an error.
    #[error("{0}")]
    Dataset(#[from] radarllm_dataset::DatasetError),
}

/// Opens a radar: a built-in name, or a path relative to `base`.
///
/// # Errors
/// As [`radarllm_io::open_radar`].
pub fn open_radar(name: &str, base: &Path) -> Result<RadarConfig, SynthError> {
    Ok(radarllm_io::open_radar_in(name, base)?.into_config()?)
}

/// The built-in body of a shape. It is generated once and kept, because polygonising takes a large fraction of one
/// second.
///
/// # Errors
/// A shape out of range.
pub fn builtin_body(shape: BodyShape) -> Result<Arc<BuiltinBody>, SynthError> {
    static BODIES: OnceLock<Mutex<HashMap<String, Arc<BuiltinBody>>>> = OnceLock::new();
    let key = format!("{shape:?}");
    let bodies = BODIES.get_or_init(Mutex::default);
    let mut bodies = bodies
        .lock()
        .unwrap_or_else(std::sync::PoisonError::into_inner);
    if let Some(body) = bodies.get(&key) {
        return Ok(Arc::clone(body));
    }
    let body = Arc::new(BuiltinBody::new(&shape).map_err(|e| SynthError::Body(e.to_string()))?);
    bodies.insert(key, Arc::clone(&body));
    Ok(body)
}

/// Which of the simulator's two implementations is used.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Method {
    /// Range gridding.
    #[default]
    Fast,
    /// The direct sum in double precision, which is hundreds of times slower.
    Reference,
}

/// A planned chain for one radar. Each thread needs its own.
pub struct Synthesizer {
    radar: RadarConfig,
    sim: SimOptions,
    impairments: Impairments,
    walls: Vec<RigidSurface>,
    /// Noise of [`Self::motion_to_points`].
    noise: Noise,
    /// Samples of what stands still, the same in every frame.
    still: Option<RadarCube>,
    method: Method,
    simulator: Simulator,
    extractor: PointExtractor,
    cube: RadarCube,
}

impl Synthesizer {
    /// Plans the simulator and the signal chain.
    ///
    /// # Errors
    /// A radar that either of them does not support.
    pub fn new(radar: &RadarConfig, method: Method, dsp: DspOptions) -> Result<Self, SynthError> {
        Self::with_simulation(radar, method, dsp, SimOptions::default())
    }

    /// As [`Self::new`], with simulator options.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with_simulation(
        radar: &RadarConfig,
        method: Method,
        dsp: DspOptions,
        sim: SimOptions,
    ) -> Result<Self, SynthError> {
        // For the reference method it generates the noise, which does not depend on the transmitters.
        let simulator = Simulator::new(radar, sim.clone())?;
        let extractor = PointExtractor::new(radar, dsp)?;
        let cube = simulator.new_cube();
        Ok(Self {
            radar: radar.clone(),
            sim,
            impairments: Impairments::default(),
            walls: Vec::new(),
            noise: Noise::Thermal,
            still: None,
            method,
            simulator,
            extractor,
            cube,
        })
    }

    /// The same chain with receiver impairments.
    #[must_use]
    pub fn with_impairments(self, impairments: Impairments) -> Self {
        Self {
            impairments,
            ..self
        }
    }

    /// The same chain in a room: [`Self::motion_to_points`] simulates these walls in addition to the body.
    #[must_use]
    pub fn with_walls(self, walls: Vec<RigidSurface>) -> Self {
        Self { walls, ..self }
    }

    /// The same chain with other noise in [`Self::motion_to_points`] than the radar's thermal noise.
    #[must_use]
    pub fn with_noise(self, noise: Noise) -> Self {
        Self { noise, ..self }
    }

    /// Replaces the signal chain.
    ///
    /// # Errors
    /// Options that do not suit the radar.
    pub fn set_processing(&mut self, dsp: DspOptions) -> Result<(), SynthError> {
        self.extractor = PointExtractor::new(&self.radar, dsp)?;
        Ok(())
    }

    /// Sets the static objects that all later frames contain, in radar axes. Their samples are simulated once, by
    /// [`Method::Fast`].
    ///
    /// # Errors
    /// Objects that cannot be simulated.
    pub fn set_objects(&mut self, objects: Vec<PointTarget>) -> Result<(), SynthError> {
        self.still = None;
        if objects.is_empty() {
            return Ok(());
        }
        let scene = Scene {
            points: objects,
            noise: Noise::Off,
            ..Scene::default()
        };
        let mut still = self.simulator.new_cube();
        self.simulator
            .simulate_frame(&scene, 0, 0.0, 0, &mut still)?;
        self.still = Some(still);
        Ok(())
    }

    /// The radar.
    pub fn radar(&self) -> &RadarConfig {
        &self.radar
    }

    /// Simulates a motion performed by the built-in body, as points.
    ///
    /// # Errors
    /// A frame that cannot be simulated or processed.
    pub fn motion_to_points(
        &mut self,
        motion: &Motion,
        shape: BodyShape,
        placement: Placement,
        max_frames: usize,
        seed: u64,
    ) -> Result<Vec<PointFrame>, SynthError> {
        let body = posed_builtin(motion, shape, placement)?;
        // The walls are taken out temporarily, so that the scene does not borrow the chain.
        let walls = std::mem::take(&mut self.walls);
        let mut scene = Scene {
            surfaces: vec![&body],
            points: Vec::new(),
            noise: self.noise,
        };
        for wall in &walls {
            scene.surfaces.push(wall);
        }
        let n_frames = self
            .radar
            .frames_in(motion.duration_s())
            .clamp(1, max_frames);
        let frames = self.scene_to_points(&scene, n_frames, seed);
        self.walls = walls;
        frames
    }

    /// Simulates a scene as points.
    ///
    /// # Errors
    /// A frame that cannot be simulated or processed.
    pub fn scene_to_points(
        &mut self,
        scene: &Scene,
        n_frames: usize,
        seed: u64,
    ) -> Result<Vec<PointFrame>, SynthError> {
        let mut frames = Vec::with_capacity(n_frames);
        for frame_idx in 0..n_frames {
            self.simulate(scene, frame_idx, seed)?;
            frames.push(self.extract(frame_idx)?);
        }
        Ok(frames)
    }

    /// Raw samples of one frame of a scene; the cube is overwritten by the next call.
    ///
    /// # Errors
    /// A frame that cannot be simulated.
    pub fn simulate(
        &mut self,
        scene: &Scene,
        frame_idx: usize,
        seed: u64,
    ) -> Result<&RadarCube, SynthError> {
        let planned_s = frame_idx as f64 * self.radar.frame_period_s;
        let frame = frame_idx as u64;
        let time_s = planned_s + self.impairments.start_delay_s(seed, frame);
        match self.method {
            Method::Fast => {
                self.simulator
                    .simulate_frame(scene, frame, time_s, seed, &mut self.cube)?;
            }
            Method::Reference => self.simulate_reference(scene, frame_idx, time_s, seed)?,
        }
        if let Some(still) = &self.still {
            for (sample, still) in self.cube.data.iter_mut().zip(&still.data) {
                *sample += still;
            }
        }
        self.impairments
            .apply(&self.radar, &mut self.cube, seed, frame)?;
        // The time stamp is the radar's nominal time.
        self.cube.time_s = planned_s;
        Ok(&self.cube)
    }

    /// The direct sum does not simulate noise: its result is added to the noise of an empty scene.
    fn simulate_reference(
        &mut self,
        scene: &Scene,
        frame_idx: usize,
        time_s: f64,
        seed: u64,
    ) -> Result<(), SynthError> {
        if let Noise::SnrDb(_) = scene.noise {
            return Err(SynthError::Config(
                "the reference path has thermal noise or none, not snr_db".into(),
            ));
        }
        let empty = Scene {
            noise: scene.noise,
            ..Scene::default()
        };
        self.simulator
            .simulate_frame(&empty, frame_idx as u64, time_s, seed, &mut self.cube)?;
        let noise = self.cube.data.clone();
        let loops = 0..self.radar.n_loops;
        reference::simulate_loops(
            &self.radar,
            &self.sim,
            scene,
            time_s,
            seed,
            loops,
            &mut self.cube,
        )?;
        for (sample, noise) in self.cube.data.iter_mut().zip(noise) {
            *sample += noise;
        }
        Ok(())
    }

    /// Extracts the points of the last cube of [`Self::simulate`].
    ///
    /// # Errors
    /// A cube that cannot be processed.
    pub fn extract(&mut self, frame_idx: usize) -> Result<PointFrame, SynthError> {
        let mut frame = self.extractor.extract(&self.cube)?;
        frame.frame = frame_idx as u32;
        Ok(frame)
    }

    /// The extractor and the last cube, for plots of the same cube.
    pub fn extractor(&mut self) -> (&mut PointExtractor, &RadarCube) {
        (&mut self.extractor, &self.cube)
    }
}

/// Simulates the first frames of a scene, as [`scene_to_points_until`] does.
///
/// # Errors
/// A chain that cannot be planned, or a frame that cannot be simulated or processed.
pub fn scene_to_points_in_parallel(
    plan: impl Fn() -> Result<Synthesizer, SynthError> + Sync,
    scene: &Scene,
    n_frames: usize,
    seed: u64,
) -> Result<Vec<PointFrame>, SynthError> {
    scene_to_points_until(plan, scene, n_frames, seed, &|| false)
}

/// Simulates the first frames of a scene on all threads of the current pool. `plan` creates the chain of one thread.
///
/// The points do not depend on the number of threads: a frame depends only on its number and the seed.
///
/// `stop` is asked before every frame and ends the work when it returns `true`.
///
/// # Errors
/// A chain that cannot be planned, a frame that cannot be simulated or processed, or [`SynthError::Interrupted`].
pub fn scene_to_points_until(
    plan: impl Fn() -> Result<Synthesizer, SynthError> + Sync,
    scene: &Scene,
    n_frames: usize,
    seed: u64,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Vec<PointFrame>, SynthError> {
    // One piece for each thread: planning a chain takes milliseconds.
    let frames_per_thread = n_frames.div_ceil(rayon::current_num_threads()).max(1);
    let pieces: Result<Vec<Vec<PointFrame>>, SynthError> = (0..n_frames)
        .step_by(frames_per_thread)
        .collect::<Vec<usize>>()
        .into_par_iter()
        .map(|first| {
            let mut synthesizer = plan()?;
            (first..(first + frames_per_thread).min(n_frames))
                .map(|frame_idx| {
                    if stop() {
                        return Err(SynthError::Interrupted);
                    }
                    synthesizer.simulate(scene, frame_idx, seed)?;
                    synthesizer.extract(frame_idx)
                })
                .collect()
        })
        .collect();
    Ok(pieces?.into_iter().flatten().collect())
}

/// The built-in body performing a motion at a placement.
///
/// # Errors
/// A body shape out of range.
pub fn posed_builtin(
    motion: &Motion,
    shape: BodyShape,
    placement: Placement,
) -> Result<PosedBody, SynthError> {
    let body: Arc<dyn BodyModel> = builtin_body(shape)?;
    Ok(PosedBody::new(
        body,
        MotionSampler::new(motion),
        placement,
        clothed_skin(),
    ))
}

/// The body shape that a built-in motion requires.
pub fn builtin_shape(rendered: &Procedural) -> BodyShape {
    BodyShape {
        height_m: rendered.height_m,
        build: rendered.build,
        ..BodyShape::default()
    }
}
