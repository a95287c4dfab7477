//! Any input, opened: a recording of any radar, or a motion that the virtual radar simulates.

use std::path::{Path, PathBuf};

use radarllm_base::Clip;
use radarllm_inference::{PrepareOptions, Prepared, prepare_for_model};
use radarllm_io::{
    CaptureFormat, CaptureOptions, DetectError, Error, Opened, OpenedRadar, PointStream,
    RecordingKind, Result, SampleFormat, open_radar, opened::detect_error,
};
use radarllm_synth::{
    Performed, SimulateOptions, SimulatedClip, simulate::is_builtin, simulate_motion,
};
use radarllm_tracking::{PeopleOptions, Person, track_people};

use crate::{Input, board_people, parts::is_read_twice};

/// Radar that simulates motions, and that recorded complex npy arrays, where none is named.
pub const DEFAULT_RADAR: &str = "awr1843boost";
/// Extensions that only motions and scenes have.
const MOTION_EXTENSIONS: [&str; 5] = ["bvh", "amc", "asf", "npz", "toml"];

/// An input that is about to be opened; see [`open`].
#[derive(Clone, Debug)]
pub struct Source {
    inputs: Vec<PathBuf>,
    options: CaptureOptions,
    simulation: SimulateOptions,
}

/// Names an input: a recording of any format, a points file, a motion file, a scene file or a built-in motion
/// (`builtin:NAME?key=value`). Nothing is read until [`Source::points`].
///
/// ```
/// let recording = radarllm::open("builtin:wave?side=left&repetitions=2").points()?;
/// assert!(recording.clip.provenance.is_simulated());
/// assert_eq!(recording.clip.frame_rate_hz, 10.0);
/// # Ok::<(), radarllm::Error>(())
/// ```
pub fn open(input: impl AsRef<Path>) -> Source {
    open_parts([input])
}

/// Names an input in several files, which are read as one recording of raw samples.
pub fn open_parts(inputs: impl IntoIterator<Item = impl AsRef<Path>>) -> Source {
    Source {
        inputs: inputs.into_iter().map(|p| p.as_ref().into()).collect(),
        options: CaptureOptions::default(),
        simulation: SimulateOptions::default(),
    }
}

impl Source {
    /// Names the radar that recorded the input, or that simulates it: a built-in name or a file.
    ///
    /// # Errors
    /// An unknown name or a file that cannot be read.
    pub fn radar(self, name_or_file: &str) -> Result<Self> {
        let radar = open_radar(name_or_file)?;
        Ok(self.with_radar(radar))
    }

    /// Sets the radar to one that is open already.
    #[must_use]
    pub fn with_radar(mut self, radar: OpenedRadar) -> Self {
        self.options.radar = Some(radar);
        self
    }

    /// Names the recording's format, which is detected otherwise.
    ///
    /// # Errors
    /// An unknown name.
    pub fn format(mut self, name: &str) -> Result<Self> {
        self.options.format = Some(CaptureFormat::from_name(name)?);
        Ok(self)
    }

    /// Sets all options of recordings.
    #[must_use]
    pub fn with_options(mut self, options: CaptureOptions) -> Self {
        self.options = options;
        self
    }

    /// Sets all options of simulated motions. The radar is that of the recording's options.
    #[must_use]
    pub fn with_simulation(mut self, simulation: SimulateOptions) -> Self {
        self.simulation = simulation;
        self
    }

    /// Reads the recording, or simulates the motion.
    ///
    /// # Errors
    /// Whatever is wrong with the input or the options, with the file's name, the place and a hint.
    pub fn points(self) -> Result<Recording> {
        let prepare = self.prepare();
        match self.identify()? {
            None => self.simulated(prepare),
            Some((opened, options)) => Ok(Recording::of(
                radarllm_io::read_opened(opened, &options)?,
                prepare,
            )),
        }
    }

    /// As [`Self::points`], but a recording that is too long to be kept in memory is to be read in parts.
    ///
    /// # Errors
    /// Those of [`Self::points`].
    pub fn read(self) -> Result<Input> {
        let prepare = self.prepare();
        let recording = match self.identify()? {
            None => self.simulated(prepare)?,
            Some((opened, options)) => {
                if is_read_twice(&opened) {
                    options.check_for_points()?;
                    if let Some(stream) = PointStream::open(opened.again(), &options)? {
                        return Input::of_stream(stream, opened, &options, prepare);
                    }
                }
                Recording::of(radarllm_io::read_opened(opened, &options)?, prepare)
            }
        };
        Ok(Input::of(recording, prepare))
    }

    fn prepare(&self) -> PrepareOptions {
        PrepareOptions {
            motion_compensate: self.options.points.motion_compensate,
        }
    }

    /// Opens the recording; `None` if the input is a motion.
    fn identify(&self) -> Result<Option<(Opened, CaptureOptions)>> {
        let first = self.first()?;
        if self.names_motion(first) {
            return Ok(None);
        }
        let opened = match Opened::identify(&self.inputs, &self.options)? {
            // What no recording looks like may be a motion; the loader says what it expects.
            Err(DetectError::Unknown(_)) if self.may_be_motion(first) => return Ok(None),
            opened => opened.map_err(|e| detect_error(first, e))?,
        };
        let mut options = self.options.clone();
        // Complex npy arrays are what `simulate` writes, so the default radar is a good first guess for them; it is
        // checked against the array's shape.
        if *opened.kind() == RecordingKind::Samples(SampleFormat::Npy) {
            options.radar = Some(self.radar_or_default()?);
        }
        Ok(Some((opened, options)))
    }

    fn first(&self) -> Result<&PathBuf> {
        let first = self.inputs.first();
        first.ok_or_else(|| Error::input("no input is named"))
    }

    fn simulated(&self, prepare: PrepareOptions) -> Result<Recording> {
        let radar = self.radar_or_default()?;
        let input = self.first()?.to_string_lossy();
        let simulated = simulate_motion(&input, radar.config()?, &self.simulation)?;
        Ok(Recording::simulated(simulated, prepare))
    }

    fn radar_or_default(&self) -> Result<OpenedRadar> {
        match &self.options.radar {
            Some(radar) => Ok(radar.clone()),
            None => open_radar(DEFAULT_RADAR),
        }
    }

    /// Whether the input may be a motion: nothing says that it is a recording.
    fn may_be_motion(&self, path: &Path) -> bool {
        let is_address = radarllm_io::udp::address(&path.to_string_lossy()).is_some();
        let is_recording = self.options.format.is_some() || self.options.layout.is_given();
        !is_recording && !is_address && path.extension().is_none_or(|e| e != "parquet")
    }

    /// Whether the name alone says that the input is a motion.
    fn names_motion(&self, path: &Path) -> bool {
        if self.options.format.is_some() || self.options.layout.is_given() {
            return false;
        }
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("");
        is_builtin(&path.to_string_lossy())
            || MOTION_EXTENSIONS.contains(&extension.to_lowercase().as_str())
            // The loader of motions lists what an input may be.
            || self.may_be_motion(path) && !path.exists()
    }
}

/// Points of an input, with everything needed to track, describe or draw them.
#[derive(Clone, Debug)]
pub struct Recording {
    /// The points at the recording's own frame rate.
    pub clip: Clip,
    /// Notes for the user: how the format was detected, what was dropped.
    pub notes: Vec<String>,
    /// What a user should know before trusting the points, a sentence each.
    pub warnings: Vec<String>,
    /// The motion, if the points were simulated just now.
    pub performed: Option<Performed>,
    prepare: PrepareOptions,
}

impl Recording {
    /// A recording of a clip from elsewhere: a program's own radar, an array, a data set.
    pub fn new(clip: Clip, notes: Vec<String>, prepare: PrepareOptions) -> Self {
        Self {
            clip,
            notes,
            warnings: Vec::new(),
            performed: None,
            prepare,
        }
    }

    /// A recording that was read.
    pub(crate) fn of(recording: radarllm_io::Recording, prepare: PrepareOptions) -> Self {
        Self {
            warnings: recording.warnings,
            ..Self::new(recording.clip, recording.notes, prepare)
        }
    }

    /// A motion that was simulated.
    pub fn simulated(simulated: SimulatedClip, prepare: PrepareOptions) -> Self {
        Self {
            performed: simulated.performed,
            ..Self::new(simulated.clip, Vec::new(), prepare)
        }
    }

    /// The clip as the model expects it: at the model's frame rate and, of a recording, without static clutter.
    ///
    /// # Errors
    /// A frame rate that cannot be resampled.
    pub fn prepared(&self) -> Result<Prepared> {
        prepare_for_model(self.clip.clone(), &self.prepare).map_err(Error::wrap)
    }

    /// Tracks people and returns the clip of each, prepared for the model; empty if nobody is seen. Where the board tracks
    /// people, its tracks count.
    ///
    /// # Errors
    /// An option out of range, or a frame rate that cannot be resampled.
    pub fn track_people(&self, options: &PeopleOptions) -> Result<Vec<Person>> {
        let clip = self.prepared()?.clip.into_clip();
        match board_people(&clip, options) {
            Some(people) => Ok(people),
            None => Ok(track_people(clip, options)?),
        }
    }
}
