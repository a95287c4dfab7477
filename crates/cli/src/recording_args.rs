//! Flags about recordings, shared by the verbs that open them, and the options of the library that they become.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use radarllm_formats::{Mounting, recordings::Axes, uart::Dialect};
use radarllm_io::{
    CaptureFormat, CaptureOptions, CellOptions, CleaningOptions, IqChoice, LayoutOptions,
    PointOptions, open_radar,
};
use radarllm_tracking::PeopleOptions;

use crate::error::{CliError, CliResult};

/// Layout of raw samples.
#[derive(Args, Clone, Debug, Default)]
pub(crate) struct LayoutArgs {
    /// Order of I and Q: mmWave Studio writes I first, SDK firmware with SampleSwap 1 writes Q first. `auto` takes the
    /// order that the samples themselves show, if they show it clearly.
    #[arg(long, value_enum, value_name = "ORDER")]
    pub iq: Option<IqArg>,
    /// LVDS lanes: 4 for xWR12xx and 14xx, 2 for the others; known for boards that have a name.
    #[arg(long, value_parser = clap::value_parser!(u8).range(2..=4))]
    pub lanes: Option<u8>,
    /// Samples are real numbers, not I and Q.
    #[arg(long, conflicts_with = "iq")]
    pub real: bool,
    /// Axes of an npy array, slowest first: frame, loop, tx, chirp, rx, virtual, sample, iq.
    #[arg(long, value_name = "A,B,...")]
    pub axes: Option<String>,
}

/// `--iq`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum IqArg {
    /// I, then Q.
    IFirst,
    /// Q, then I.
    QFirst,
    /// The order that the samples show.
    Auto,
}

impl LayoutArgs {
    /// As the library takes them.
    pub(crate) fn options(&self) -> LayoutOptions {
        LayoutOptions {
            iq: self.iq.map(|iq| match iq {
                IqArg::IFirst => IqChoice::IFirst,
                IqArg::QFirst => IqChoice::QFirst,
                IqArg::Auto => IqChoice::Auto,
            }),
            lanes: self.lanes,
            real: self.real,
            axes: self.axes.clone(),
        }
    }
}

/// How recorded points are read, placed and accumulated.
#[derive(Args, Clone, Debug)]
pub(crate) struct RecordingArgs {
    /// Frames per second of the recording, where neither its clock nor --radar gives it.
    #[arg(long, value_name = "HZ")]
    pub frame_rate: Option<f64>,
    /// Axes of the recording: right-forward-up or forward-left-up (ROS).
    #[arg(long)]
    pub orientation: Option<String>,
    /// UART dialect: sdk3, sdk2, sdk1, area-scanner, people-3d, people-2d, people-2d-compact, overhead-3d, people-6844;
    /// detected if omitted.
    #[arg(long)]
    pub dialect: Option<String>,
    /// Topic of a ROS bag that has points on several.
    #[arg(long)]
    pub topic: Option<String>,
    /// Which of several runs of a visualizer in one folder is read, counted from 1 for the oldest.
    #[arg(long, value_name = "N")]
    pub run: Option<usize>,
    /// Columns of a table without a header, or with one that is not known, in their order: frame, t_s, x, y, z, range,
    /// azimuth, elevation, velocity, snr, also with units as in x_mm or t_ms; - or _ skips a column.
    #[arg(long, value_name = "A,B,...", allow_hyphen_values = true)]
    pub columns: Option<String>,
    /// Baud rate of a serial port (/dev/tty...).
    #[arg(long, default_value_t = 921_600)]
    pub baud: u32,
    /// Seconds to listen to a serial port.
    #[arg(long, value_name = "S")]
    pub seconds: Option<f64>,
    /// Angle of the radar's boresight below the horizon, degrees.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    pub tilt_deg: f64,
    /// Angle by which the radar is turned to its right, degrees.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    pub yaw_deg: f64,
    /// Angle by which the radar's right side is lowered, degrees.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    pub roll_deg: f64,
    /// Remove points slower than this, m/s. Without it, `describe` removes static points where they are more than half
    /// of a recording, or where antenna coupling is reported; 0 keeps all points.
    #[arg(long, value_name = "MPS", alias = "slowest")]
    pub min_speed: Option<f32>,
    /// Accumulate this many frames into each, for radars that report few points.
    #[arg(long, value_name = "N", default_value_t = 1, alias = "merge")]
    pub accumulate: usize,
    /// Move accumulated points along their radial velocity to the time of their new frame.
    #[arg(long, alias = "follow")]
    pub motion_compensate: bool,
}

impl RecordingArgs {
    /// As the library takes them.
    pub(crate) fn options(&self) -> CliResult<PointOptions> {
        let orientation = self.orientation.as_deref().map(|name| {
            let names = Axes::ALL.map(Axes::name).join(" or ");
            Axes::from_name(name)
                .ok_or_else(|| CliError::new(format!("--orientation {name}: expected {names}")))
        });
        let dialect = self.dialect.as_deref().map(|name| {
            Dialect::from_name(name).ok_or_else(|| {
                CliError::new(format!("--dialect {name}: no such dialect"))
                    .hint(Dialect::ALL.map(Dialect::name).join(", "))
            })
        });
        Ok(PointOptions {
            frame_rate_hz: self.frame_rate,
            orientation: orientation.transpose()?,
            dialect: dialect.transpose()?,
            topic: self.topic.clone(),
            run: self.run,
            columns: self.columns.clone(),
            baud: self.baud,
            seconds: self.seconds,
            mounting: Mounting {
                tilt_rad: self.tilt_deg.to_radians(),
                yaw_rad: self.yaw_deg.to_radians(),
                roll_rad: self.roll_deg.to_radians(),
            },
            min_speed_mps: self.min_speed,
            accumulate: self.accumulate,
            motion_compensate: self.motion_compensate,
        })
    }
}

/// Background and leakage removal.
#[derive(Args, Clone, Debug, Default)]
pub(crate) struct CleaningArgs {
    /// Recording of the same scene without people, by the same radar. Of raw samples its mean is subtracted instead of
    /// each frame's own, so that a person who sits still stays visible. Of points its occupied cells are removed.
    #[arg(long, value_name = "EMPTY")]
    pub background: Option<PathBuf>,
    /// Recorded points: edge of the background's cells in x, y and z, m; 0.25 if omitted.
    #[arg(long, value_name = "M", requires = "background")]
    pub background_cell: Option<f64>,
    /// Recorded points: edge of the background's cells in velocity, m/s; 0.25 if omitted.
    #[arg(long, value_name = "MPS", requires = "background")]
    pub background_velocity: Option<f64>,
    /// Recorded points: a cell is background if more than this share of the empty frames have points in it; 0.1 if
    /// omitted.
    #[arg(long, value_name = "SHARE", requires = "background")]
    pub background_share: Option<f64>,
    /// Raw samples: channel gains, made by `radar calibrate`.
    #[arg(long, value_name = "CAL.toml")]
    pub calibration: Option<PathBuf>,
    /// Raw samples: remove each receiver's mean. It has an effect only together with --background, because clutter
    /// removal takes off all static echoes otherwise.
    #[arg(long)]
    pub remove_offset: bool,
    /// Raw samples: remove static echoes up to this range, m: leakage. It has an effect only together with
    /// --background.
    #[arg(long, value_name = "M")]
    pub remove_leakage: Option<f64>,
}

impl CleaningArgs {
    /// As the library takes them.
    pub(crate) fn options(&self) -> CleaningOptions {
        CleaningOptions {
            background: self.background.clone(),
            background_cells: CellOptions {
                cell_m: self.background_cell,
                cell_mps: self.background_velocity,
                share: self.background_share,
            },
            calibration: self.calibration.clone(),
            remove_offset: self.remove_offset,
            remove_leakage_m: self.remove_leakage,
        }
    }
}

/// How to read an input that may be a recording: its radar, format and everything about it.
#[derive(Args, Clone, Debug)]
pub(crate) struct InputArgs {
    /// Radar that recorded the input, or that simulates a motion: a built-in name, a TI .cfg, an export of mmWave
    /// Studio (.json) or a radar .toml.
    #[arg(long)]
    pub radar: Option<String>,
    /// Format of a recording: adc, dca1000 or npy for raw samples; uart, visualizer-json, visualizer-binary, radhar, mars,
    /// mmbody, mmfi, mat, csv, npy-points, track-csv, windows-json, bag or ros2-bag for points; detected if omitted.
    #[arg(long)]
    pub format: Option<String>,
    /// Sample layout of a raw capture.
    #[command(flatten)]
    pub layout: LayoutArgs,
    /// Recorded points.
    #[command(flatten)]
    pub recording: RecordingArgs,
    /// Background and leakage removal.
    #[command(flatten)]
    pub cleaning: CleaningArgs,
    /// Height of the radar above the floor, m; 1 m if omitted and the input does not give it.
    #[arg(long)]
    pub radar_height_m: Option<f32>,
}

impl InputArgs {
    /// As the library takes them; the radar is opened here, once.
    pub(crate) fn options(&self) -> CliResult<CaptureOptions> {
        let format = self.format.as_deref().map(CaptureFormat::from_name);
        Ok(CaptureOptions {
            radar: self.radar.as_deref().map(open_radar).transpose()?,
            format: format.transpose()?,
            layout: self.layout.options(),
            points: self.recording.options()?,
            cleaning: self.cleaning.options(),
            processing: None,
            max_frames: None,
            radar_height_m: self.radar_height_m,
        })
    }
}

/// Tracking of people.
#[derive(Args, Clone, Debug, Default)]
pub(crate) struct PeopleArgs {
    /// Track people and process the points of each: at most this many, those with the most points, or `auto`.
    #[arg(long, value_name = "N|auto", value_parser = max_people)]
    pub people: Option<MaxPeople>,
    /// Remove tracks that are multipath reflections of others (ghosts), and their points.
    #[arg(long)]
    pub drop_ghosts: bool,
}

/// `--people`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum MaxPeople {
    /// Everybody.
    Auto,
    /// At most this many.
    AtMost(usize),
}

fn max_people(text: &str) -> Result<MaxPeople, String> {
    match text.parse::<usize>() {
        _ if text == "auto" => Ok(MaxPeople::Auto),
        Ok(n) if (1..=100).contains(&n) => Ok(MaxPeople::AtMost(n)),
        _ => Err("must be 1 to 100, or auto".into()),
    }
}

impl PeopleArgs {
    /// Whether tracking is asked for.
    pub(crate) fn is_given(&self) -> bool {
        self.people.is_some() || self.drop_ghosts
    }

    /// As the library takes them.
    pub(crate) fn options(&self) -> PeopleOptions {
        PeopleOptions {
            max_people: match self.people {
                Some(MaxPeople::AtMost(n)) => Some(n),
                _ => None,
            },
            remove_ghosts: self.drop_ghosts,
            ..PeopleOptions::default()
        }
    }
}

/// Recordings of known activities, for `eval recordings` and `dataset recordings`.
#[derive(Args)]
pub(crate) struct LabelledArgs {
    /// TOML with the activities, the actions that state them, and the roles of the recordings.
    pub config: PathBuf,
    /// Folder with the recordings, or a data set where the configuration says `simulated = true`.
    #[arg(long)]
    pub recordings: PathBuf,
    /// Radar that recorded them: a built-in name, a TI .cfg or a radar .toml.
    #[arg(long)]
    pub radar: Option<String>,
    /// uart, radhar, mars, mmbody, mmfi, csv, npy-points, bag or ros2-bag; detected if omitted.
    #[arg(long)]
    pub format: Option<String>,
    /// Recorded points.
    #[command(flatten)]
    pub recording: RecordingArgs,
}
