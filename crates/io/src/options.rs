//! Options for opening recordings, as plain structs that any caller can fill: from a command line, from Python or from
//! a configuration file.

use std::path::PathBuf;

use radarllm_base::{
    Clutter, Message,
    message::{option, text},
};
use radarllm_formats::{Mounting, RecordingFormat, recordings::Axes, uart::Dialect};
use radarllm_radar_dsp::DspOptions;
use radarllm_tracking::BackgroundOptions;

use crate::{
    error::{Error, Result},
    radar::OpenedRadar,
};

/// Maximum number of radar frames processed from raw samples: as many as a timeline has.
pub const MAX_FRAMES: u64 = radarllm_base::timeline::MAX_FRAMES;
/// Maximum number of frames accumulated into one.
const MAX_ACCUMULATE: usize = 100;
/// Maximum speed below which points may be removed, m/s.
const MAX_MIN_SPEED_MPS: f32 = 100.0;
/// Maximum time to record from a serial port: one day, in s.
const MAX_LISTEN_S: f64 = 86_400.0;

/// Options for opening a recording.
#[derive(Clone, Debug, Default)]
pub struct CaptureOptions {
    /// The radar that made the recording. Raw samples require it. Points use its frame rate and its name.
    pub radar: Option<OpenedRadar>,
    /// Format of the recording; detected if `None`.
    pub format: Option<CaptureFormat>,
    /// Layout of raw samples.
    pub layout: LayoutOptions,
    /// Reading and placement of recorded points.
    pub points: PointOptions,
    /// Background and leakage removal.
    pub cleaning: CleaningOptions,
    /// Signal processing of raw samples; the default chain if `None`.
    pub processing: Option<DspOptions>,
    /// Maximum number of frames of raw samples to read.
    pub max_frames: Option<usize>,
    /// Height of the radar above the floor, m. If `None`, the height that the recording states, or
    /// [`DEFAULT_RADAR_HEIGHT_M`].
    pub radar_height_m: Option<f32>,
}

impl CaptureOptions {
    /// Refuses the options that only raw samples have.
    ///
    /// # Errors
    /// The name of the option.
    pub fn check_for_points(&self) -> Result {
        let given = [
            ("processing", self.processing.is_some()),
            ("frames", self.max_frames.is_some()),
        ];
        refuse_options(&given, NEEDS_SAMPLES)
    }
}

/// Height of the radar above the floor where neither the recording nor the options give it, m.
pub const DEFAULT_RADAR_HEIGHT_M: f32 = 1.0;

/// A recording format named by a caller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CaptureFormat {
    /// A NumPy array of raw samples.
    Npy,
    /// Any other format, by its standard name.
    Format(RecordingFormat),
}

impl CaptureFormat {
    /// Returns the format with that name.
    ///
    /// # Errors
    /// An unknown name; the hint lists the known ones.
    pub fn from_name(name: &str) -> Result<Self> {
        if name == "npy" {
            return Ok(Self::Npy);
        }
        RecordingFormat::from_name(name)
            .map(Self::Format)
            .ok_or_else(|| {
                let names: Vec<&str> = RecordingFormat::ALL.iter().map(|f| f.name()).collect();
                Error::input(option("format").text(format!(" {name}: no such format")))
                    .with_hint(format!("one of {}, npy", names.join(", ")))
            })
    }

    /// Returns the name of the format.
    pub fn name(self) -> &'static str {
        match self {
            Self::Npy => "npy",
            Self::Format(format) => format.name(),
        }
    }

    /// Returns whether recordings of this format contain raw samples.
    pub fn holds_samples(self) -> bool {
        matches!(
            self,
            Self::Npy | Self::Format(RecordingFormat::Adc | RecordingFormat::Dca1000)
        )
    }
}

/// Layout of raw samples, as far as the caller knows it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LayoutOptions {
    /// Order of I and Q.
    pub iq: Option<IqChoice>,
    /// Number of LVDS lanes of the device, 2 or 4; known for boards that have a name.
    pub lanes: Option<u8>,
    /// Samples are real numbers, not I and Q.
    pub real: bool,
    /// Axes of an npy array, slowest first, as in `frame,loop,tx,rx,sample`.
    pub axes: Option<String>,
}

impl LayoutOptions {
    /// Returns whether any option is set, in which case the recording contains raw samples.
    pub fn is_given(&self) -> bool {
        *self != Self::default()
    }
}

/// Order of I and Q in raw words.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum IqChoice {
    /// I, then Q, as written by mmWave Studio.
    IFirst,
    /// Q, then I, as written by SDK firmware with `SampleSwap` 1.
    QFirst,
    /// The order is determined from the samples, provided that they show it clearly.
    Auto,
}

/// How recorded points are read, placed in space and accumulated.
#[derive(Clone, Debug, PartialEq)]
pub struct PointOptions {
    /// Frame rate in Hz, used if neither the recording's clock nor the radar determines it.
    pub frame_rate_hz: Option<f64>,
    /// Axes of the recording.
    pub orientation: Option<Axes>,
    /// UART dialect; detected if `None`.
    pub dialect: Option<Dialect>,
    /// Topic of a ROS bag that has point clouds on several topics.
    pub topic: Option<String>,
    /// Which of several runs of a visualizer in one folder is read, counted from 1 for the oldest.
    pub run: Option<usize>,
    /// Names of the columns of a table, in order, as in `frame,-,x,y,z,velocity,snr`; `-` or `_` skips a column. They
    /// replace the names of its header, if it has one. A file is read as a table if they are given.
    pub columns: Option<String>,
    /// Baud rate of a serial port.
    pub baud: u32,
    /// Time to record from a serial port, in s.
    pub seconds: Option<f64>,
    /// Mounting angles of the sensor.
    pub mounting: Mounting,
    /// Remove points slower than this, in m/s. The value 0 keeps every point, including those that are removed as
    /// static clutter if it is `None`.
    pub min_speed_mps: Option<f32>,
    /// Number of frames accumulated into each output frame, for radars that report few points.
    pub accumulate: usize,
    /// Move accumulated points along their radial velocity to the time of their new frame.
    pub motion_compensate: bool,
}

impl Default for PointOptions {
    fn default() -> Self {
        Self {
            frame_rate_hz: None,
            orientation: None,
            dialect: None,
            topic: None,
            run: None,
            columns: None,
            baud: 921_600,
            seconds: None,
            mounting: Mounting::default(),
            min_speed_mps: None,
            accumulate: 1,
            motion_compensate: false,
        }
    }
}

impl PointOptions {
    /// The state of clutter in the points: settled if the slowest points to keep were requested explicitly, so that no
    /// later step removes more.
    pub fn clutter(&self) -> Clutter {
        match self.min_speed_mps {
            Some(_) => Clutter::Settled,
            None => Clutter::Unchecked,
        }
    }

    /// Refuses options about recorded points, because raw samples use the radar's own clock and axes.
    pub(crate) fn check_for_samples(&self) -> Result {
        refuse_options(
            &[
                ("frame_rate", self.frame_rate_hz.is_some()),
                ("orientation", self.orientation.is_some()),
                ("dialect", self.dialect.is_some()),
                ("topic", self.topic.is_some()),
                ("run", self.run.is_some()),
                ("columns", self.columns.is_some()),
                ("seconds", self.seconds.is_some()),
            ],
            "is for recorded points; the capture holds raw samples, whose clock and axes are the radar's",
        )
    }

    /// Refuses options that recorded points of a format do not use. Otherwise they would be ignored silently.
    pub(crate) fn check_for_format(&self, format: RecordingFormat) -> Result {
        let with_axes = [
            RecordingFormat::Csv,
            RecordingFormat::NpyPoints,
            RecordingFormat::Bag,
            RecordingFormat::Ros2Bag,
            RecordingFormat::MmFi,
        ];
        let has = |formats: &[RecordingFormat]| formats.contains(&format);
        let idle = [
            (
                "orientation",
                self.orientation.is_some() && !has(&with_axes),
            ),
            (
                "dialect",
                self.dialect.is_some()
                    && !has(&[RecordingFormat::Uart, RecordingFormat::VisualizerBinary]),
            ),
            (
                "seconds",
                self.seconds.is_some() && !has(&[RecordingFormat::Uart]),
            ),
            (
                "topic",
                self.topic.is_some() && !has(&[RecordingFormat::Bag, RecordingFormat::Ros2Bag]),
            ),
            (
                "run",
                self.run.is_some()
                    && !has(&[
                        RecordingFormat::VisualizerJson,
                        RecordingFormat::VisualizerBinary,
                    ]),
            ),
            (
                "columns",
                self.columns.is_some() && !has(&[RecordingFormat::Csv, RecordingFormat::NpyPoints]),
            ),
        ];
        refuse_options(
            &idle,
            &format!("has no meaning for format {}", format.name()),
        )
    }

    /// Speed below which points are removed, in m/s.
    pub(crate) fn min_speed(&self) -> Result<f32> {
        let min_speed_mps = self.min_speed_mps.unwrap_or(0.0);
        if (0.0..=MAX_MIN_SPEED_MPS).contains(&min_speed_mps) {
            Ok(min_speed_mps)
        } else {
            Err(Error::input(
                option("min_speed").text(": expected 0 to 100 m/s"),
            ))
        }
    }

    /// Number of frames to accumulate.
    pub(crate) fn n_accumulated(&self) -> Result<usize> {
        if (1..=MAX_ACCUMULATE).contains(&self.accumulate) {
            Ok(self.accumulate)
        } else {
            Err(Error::input(
                option("accumulate").text(format!(": expected 1 to {MAX_ACCUMULATE} frames")),
            ))
        }
    }

    /// Mounting angles of the sensor.
    pub(crate) fn mounting(&self) -> Result<Mounting> {
        let m = self.mounting;
        if [m.tilt_rad, m.yaw_rad, m.roll_rad]
            .iter()
            .all(|v| v.is_finite())
        {
            Ok(m)
        } else {
            Err(Error::input(mounting_angles().text(": must be finite")))
        }
    }

    /// Time to record from a serial port, in s.
    pub(crate) fn listening_time_s(&self) -> Result<f64> {
        self.seconds
            .filter(|s| *s > 0.0 && *s <= MAX_LISTEN_S)
            .ok_or_else(|| {
                Error::input(
                    text("a serial port has no end: ")
                        .option("seconds")
                        .text(" is needed, at most a day"),
                )
            })
    }
}

/// Background and leakage removal.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CleaningOptions {
    /// Recording of the same scene without people, made by the same radar. For raw samples, its mean is subtracted
    /// instead of the mean of each frame, so that a person who sits still remains visible. For points, its occupied
    /// cells are removed.
    pub background: Option<PathBuf>,
    /// Recorded points: which cells of the empty scene count as occupied; the default if `None`.
    pub background_cells: CellOptions,
    /// Raw samples: channel gains from a calibration file.
    pub calibration: Option<PathBuf>,
    /// Raw samples: remove the mean of each receiver.
    pub remove_offset: bool,
    /// Raw samples: remove static echoes up to this range, m: leakage from transmitters to receivers.
    pub remove_leakage_m: Option<f64>,
}

/// Criteria for occupied cells of an empty scene's points; see [`BackgroundOptions`] for the defaults.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CellOptions {
    /// Edge length of a cell in x, y and z, in m.
    pub cell_m: Option<f64>,
    /// Edge length of a cell in velocity, in m/s.
    pub cell_mps: Option<f64>,
    /// Minimum fraction of frames that have a point in the cell.
    pub share: Option<f64>,
}

impl CellOptions {
    /// Returns the options with defaults for unset values.
    pub(crate) fn resolve(self) -> BackgroundOptions {
        let defaults = BackgroundOptions::default();
        BackgroundOptions {
            cell_m: self.cell_m.unwrap_or(defaults.cell_m),
            cell_mps: self.cell_mps.unwrap_or(defaults.cell_mps),
            share: self.share.unwrap_or(defaults.share),
        }
    }
}

impl CleaningOptions {
    /// Refuses options that need raw samples.
    pub(crate) fn check_for_points(&self) -> Result {
        refuse_options(
            &[
                ("calibration", self.calibration.is_some()),
                ("remove_offset", self.remove_offset),
                ("remove_leakage", self.remove_leakage_m.is_some()),
            ],
            NEEDS_SAMPLES,
        )
    }

    /// Refuses options that need points.
    pub(crate) fn check_for_samples(&self) -> Result {
        refuse_options(
            &[
                ("background_cell", self.background_cells.cell_m.is_some()),
                (
                    "background_velocity",
                    self.background_cells.cell_mps.is_some(),
                ),
                ("background_share", self.background_cells.share.is_some()),
            ],
            "has no meaning for raw samples: their mean is subtracted",
        )
    }
}

/// Reason why an option is refused for points.
pub const NEEDS_SAMPLES: &str = "needs raw samples; this capture holds points";

/// Refuses the first of these options that is set. `why` follows its name in the message.
///
/// # Errors
/// If one of the options is set.
pub fn refuse_options(options: &[(&'static str, bool)], why: &str) -> Result {
    match options.iter().find(|(_, is_given)| *is_given) {
        Some((name, _)) => Err(Error::input(option(name).text(format!(" {why}")))),
        None => Ok(()),
    }
}

/// The options of the mounting angles, as the beginning of a message.
pub(crate) fn mounting_angles() -> Message {
    option("tilt_deg")
        .text(", ")
        .option("yaw_deg")
        .text(", ")
        .option("roll_deg")
}
