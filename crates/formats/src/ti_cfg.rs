//! Chirp files of TI's mmWave SDK: one CLI command per line; `%` starts a comment.
//!
//! The reader uses the commands that determine the samples: `channelCfg`, `adcCfg`, `adcbufCfg`, `profileCfg`,
//! `chirpCfg`, `frameCfg`, `dfeDataOutputMode`, `bpmCfg`, `clutterRemoval`, `lvdsStreamCfg`,
//! `compRangeBiasAndRxChanPhase`, `antGeometry0/1`, `antPhaseRot`. All other commands configure on-chip detection and
//! are listed in [`TiCfg::unused`]. `guiMonitor` is read in addition, because it determines the load of the serial
//! port. [`crate::SensorPosition`] reads `sensorPosition`, [`crate::TiDetection`] the detection. Argument order: SDK 3 user
//! guide, "Configuration (.cfg) File Format".
//!
//! Not every file describes a cube. [`TiCfg::read`] recognises the dialect first and gives what points need
//! ([`PointRadar`]) of every one of them:
//!
//! | dialect | frame period | cube |
//! |---|---|---|
//! | SDK 1 to 3 | `frameCfg` | if all chirps are equal but for their transmitter |
//! | advanced frames (`advFrameCfg`, `subFrameCfg`) | sum of the sub-frames | none |
//! | MCU+ SDK (xWR2944): eight or nine values in `frameCfg`, the fifth is the number of samples | the sixth value | none |
//! | low-power SDK (`chirpComnCfg`, `chirpTimingCfg`) | fifth value of `frameCfg` | none: samples are real |

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use radarllm_base::RadarConfig;
use radarllm_base::radar_config::{RadarConfigError, TxMultiplexing};

use crate::boards::{Board, Platform};
use crate::low_power;
use crate::point_radar::{ChirpDialect, PointRadar, Sampling};
use crate::sensor_position::SensorPosition;
use crate::span::{Places, Span};

/// Maximum length of a quotation in an error, characters.
const MAX_QUOTE: usize = 40;
/// Maximum number of chirps of a device.
const MAX_CHIRPS: u32 = 512;
/// Maximum number of sub-frames of an advanced frame.
const MAX_SUBFRAMES: u32 = 4;

/// How the board of a chirp file was found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum BoardEvidence {
    /// The caller named it.
    Stated,
    /// `antGeometry0` and `antGeometry1` are those of the board.
    Geometry,
    /// A line `% Platform:` names the board.
    Platform,
    /// The name of the file names the board, which is a weaker sign.
    FileName,
    /// Guess: this name in a line `% Platform:` or in the name of the file stands for several boards.
    Family(String),
    /// Guess by the band and the enabled transmitters.
    Guess,
}

impl BoardEvidence {
    /// Whether the antennas may be those of another board.
    pub fn is_guess(&self) -> bool {
        matches!(self, Self::Family(_) | Self::Guess)
    }
}

/// Content of a chirp file.
#[derive(Clone, Debug, PartialEq)]
pub struct TiCfg {
    /// The radar, with `tx` in firing order.
    pub radar: RadarConfig,
    /// The board whose antennas were assumed.
    pub board: Board,
    /// How the board was found.
    pub board_evidence: BoardEvidence,
    /// Transmitter (from 1) of every slot. With binary phase modulation, both transmitters, of which the inverted one
    /// is last.
    pub slots: Vec<u8>,
    /// Enabled receivers (from 1).
    pub receivers: Vec<u8>,
    /// Number of frames to send; 0 means until stopped.
    pub n_frames: u32,
    /// `SampleSwap` of `adcbufCfg`: true means Q before I in the recording of SDK firmware.
    pub q_first: Option<bool>,
    /// Whether the firmware removes static clutter.
    pub firmware_clutter_removal: Option<bool>,
    /// Whether raw samples are sent over LVDS.
    pub lvds_samples: Option<bool>,
    /// Calibration: range bias, m, and (re, im) factors of the virtual channels, starting with the receivers of TX1.
    pub calibration: Option<(f64, Vec<(f64, f64)>)>,
    /// Sign of the feed of each virtual channel (`antPhaseRot`), starting with the receivers of TX1; empty if not
    /// given.
    pub phase_rotation: Vec<f64>,
    /// Data that TI's demo sends over its serial port, if the file has a `guiMonitor` of a known form.
    pub gui_monitor: Option<GuiMonitor>,
    /// Commands that do not affect the samples: line (from 1) and name.
    pub unused: Vec<(usize, String)>,
}

/// `guiMonitor`: data that TI's out-of-box demo sends for every frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GuiMonitor {
    /// Points.
    pub points: bool,
    /// SNR and noise of each point.
    pub side_info: bool,
    /// Range profile at zero Doppler.
    pub range_profile: bool,
    /// Noise floor profile.
    pub noise_profile: bool,
    /// Range-azimuth map of static clutter.
    pub azimuth_map: bool,
    /// Range-Doppler map.
    pub doppler_map: bool,
    /// Timing statistics.
    pub stats: bool,
}

/// The readable part of a chirp file.
#[derive(Debug)]
pub struct TiCfgReading {
    /// The content, if the file has no errors.
    pub cfg: Option<TiCfg>,
    /// All errors and reasons why there is no cube; empty if and only if `cfg` is present. Files without a cube that a
    /// device accepts have only reasons ([`TiCfgError::is_unsupported`]).
    pub errors: Vec<TiCfgError>,
    /// The dialect.
    pub dialect: ChirpDialect,
    /// What recorded points need, if the frame period could be read and is possible.
    pub points: Option<PointRadar>,
    /// For files of the low-power SDK of a device with known antennas: a radar with the same range and Doppler bins, to
    /// be simulated. Recorded samples of such a device are real and do not fit it.
    pub equivalent: Option<RadarConfig>,
    /// The radar as written, which may be impossible, if profile and frame could be read; `tx` may be empty.
    pub draft: Option<RadarConfig>,
    /// As in [`TiCfg`]; `None` if no board was determined.
    pub board_evidence: Option<BoardEvidence>,
    /// As in [`TiCfg`].
    pub lvds_samples: Option<bool>,
    /// As in [`TiCfg`].
    pub gui_monitor: Option<GuiMonitor>,
    /// Positions of the values: by field of [`RadarConfig`], and `lvds_samples`, `azimuth_map`, `doppler_map`, `points`
    /// for other commands.
    pub places: Places,
}

/// Reason why a chirp file is refused.
#[derive(Clone, Debug, thiserror::Error, PartialEq)]
#[non_exhaustive]
pub enum TiCfgError {
    /// An argument or command is wrong.
    #[error("line {line}, columns {start} to {end}: `{text}`: {problem}", start = columns.start, end = columns.end)]
    Line {
        /// Kind of error in kebab case: `syntax`, `unsupported`, `unknown-antennas`, `tx-mask`, `undefined-chirp`,
        /// `undefined-profile`, `undefined-subframe` or `antenna-geometry`.
        rule: &'static str,
        /// Line, from 1.
        line: usize,
        /// Columns, from 1, end exclusive, in characters.
        columns: Range<usize>,
        /// The offending text, shortened.
        text: String,
        /// What is wrong.
        problem: String,
    },
    /// A required command is absent.
    #[error("there is no `{0}` line")]
    Missing(&'static str),
    /// The values are readable, but the radar is impossible.
    #[error(transparent)]
    Radar(#[from] RadarConfigError),
}

impl TiCfgError {
    /// Whether a device accepts what is refused here, so that it is a reason why there is no cube and no mistake.
    pub fn is_unsupported(&self) -> bool {
        matches!(
            self,
            Self::Line { rule, .. } if ["unsupported", "unknown-antennas"].contains(rule)
        )
    }
}

/// Reads only the radar of a chirp file; [`TiCfg::parse`] reads the complete content.
///
/// # Errors
/// As [`TiCfg::parse`].
pub fn radar_from_ti_cfg(text: &str) -> Result<RadarConfig, TiCfgError> {
    Ok(TiCfg::parse(text, None)?.radar)
}

impl TiCfg {
    /// Reads a chirp file.
    ///
    /// `board` specifies the board. With `None`, it is determined from the `antGeometry` lines or from `% Platform:`.
    /// Without these, it is guessed: 60 GHz is the 6843 ISK; at 77 GHz, a `channelCfg` with only TX1 and TX2 enabled is
    /// the 1642 board, anything else the 1843 board. A platform whose antennas are unknown is never taken for another.
    ///
    /// # Errors
    /// [`TiCfgError::Line`] for input that is unreadable or that a [`RadarConfig`] cannot express (other dialects,
    /// continuous wave, real samples, two simultaneous transmitters without `bpmCfg`, chirps that differ, unknown
    /// antennas); [`TiCfgError::Missing`]; [`TiCfgError::Radar`] for impossible timing.
    pub fn parse(text: &str, board: Option<Board>) -> Result<Self, TiCfgError> {
        let reading = Self::read(text, board);
        match (reading.errors.into_iter().next(), reading.cfg) {
            (None, Some(cfg)) => Ok(cfg),
            (first, _) => Err(first.unwrap_or(TiCfgError::Missing("frameCfg"))),
        }
    }

    /// Reads a chirp file and continues after errors, to report all of them; otherwise as [`Self::parse`].
    pub fn read(text: &str, board: Option<Board>) -> TiCfgReading {
        Self::read_with(text, board, None)
    }

    /// As [`Self::read`], for a file whose name may name the board, as the names that TI's visualizer gives do
    /// ([`Platform::from_file_name`]).
    pub fn read_named(file_name: &str, text: &str) -> TiCfgReading {
        Self::read_with(text, None, Some(file_name))
    }

    fn read_with(text: &str, board: Option<Board>, file_name: Option<&str>) -> TiCfgReading {
        let named = file_name.and_then(Platform::from_file_name);
        let stated = text
            .lines()
            .filter_map(|line| platform_of_comment(line.split_once('%')?.1))
            .next_back();
        let position = SensorPosition::from_ti_cfg(text);
        let platform = low_power::platform_name(stated.as_ref().or(named.as_ref()));
        if let Some(found) = low_power::read(text, platform) {
            return found.into_reading(position);
        }
        let mut file = File {
            file_name: named,
            ..File::default()
        };
        let mut errors = Vec::new();
        for (i, raw) in text.lines().enumerate() {
            if let Err((name, error)) = file.read_line(i + 1, raw) {
                file.broken.insert(name);
                errors.push(error);
            }
        }
        let mut reading = file.finish(board, errors);
        reading.set_position(position);
        reading
    }
}

impl TiCfgReading {
    /// Adds the mounting. Points are not read with a mounting that is malformed.
    fn set_position(&mut self, position: Result<Option<SensorPosition>, TiCfgError>) {
        match position {
            Ok(position) => {
                if let Some(points) = &mut self.points {
                    points.position = position;
                }
            }
            Err(error) => {
                (self.cfg, self.points, self.equivalent) = (None, None, None);
                self.errors.push(error);
            }
        }
    }
}

impl low_power::LowPowerReading {
    fn into_reading(self, position: Result<Option<SensorPosition>, TiCfgError>) -> TiCfgReading {
        let mut reading = TiCfgReading {
            cfg: None,
            errors: self.errors,
            dialect: ChirpDialect::LowPower,
            points: self.points,
            draft: None,
            board_evidence: self
                .equivalent
                .is_some()
                .then_some(match self.antennas_assumed {
                    true => BoardEvidence::Guess,
                    false => BoardEvidence::Geometry,
                }),
            equivalent: self.equivalent,
            lvds_samples: None,
            gui_monitor: None,
            places: self.places,
        };
        reading.set_position(position);
        reading
    }
}

/// An argument with its position.
#[derive(Clone, Debug)]
pub(crate) struct Word {
    line: usize,
    columns: Range<usize>,
    pub text: String,
}

impl Word {
    pub(crate) fn error(&self, problem: impl Into<String>) -> TiCfgError {
        self.refuse("syntax", problem)
    }

    pub(crate) fn refuse(&self, rule: &'static str, problem: impl Into<String>) -> TiCfgError {
        let mut text: String = self.text.chars().take(MAX_QUOTE).collect();
        if text.len() < self.text.len() {
            text.push('…');
        }
        TiCfgError::Line {
            rule,
            line: self.line,
            columns: self.columns.clone(),
            text,
            problem: problem.into(),
        }
    }

    pub(crate) fn number(&self, what: &str) -> Result<f64, TiCfgError> {
        match self.text.parse::<f64>() {
            Ok(v) if v.is_finite() => Ok(v),
            _ => Err(self.error(format!("{what} must be a number"))),
        }
    }

    /// Parses a mask, which may be hexadecimal.
    fn mask(&self, what: &str, range: Range<u32>) -> Result<u32, TiCfgError> {
        let digits = self.text.strip_prefix("0x");
        let Some(digits) = digits.or_else(|| self.text.strip_prefix("0X")) else {
            return self.whole(what, range);
        };
        match u32::from_str_radix(digits, 16) {
            Ok(v) if range.contains(&v) => Ok(v),
            _ => Err(self.error(format!(
                "{what} must be from {:#x} to {:#x}",
                range.start,
                range.end - 1
            ))),
        }
    }

    /// Parses an integer in the given range. TI writes some integers as `96.00`.
    fn whole(&self, what: &str, range: Range<u32>) -> Result<u32, TiCfgError> {
        let v = self.number(what)?;
        if v.fract() == 0.0 && v >= f64::from(range.start) && v < f64::from(range.end) {
            Ok(v as u32)
        } else {
            let last = range.end - 1;
            Err(self.error(format!(
                "{what} must be a whole number from {} to {last}",
                range.start
            )))
        }
    }
}

/// A command and its arguments.
#[derive(Clone, Debug)]
pub(crate) struct Command {
    pub name: Word,
    pub args: Vec<Word>,
}

impl Command {
    /// Parses a line (numbered from 1), which may contain a comment.
    pub(crate) fn of_line(line: usize, raw: &str) -> Option<Self> {
        let code = raw.split_once('%').map_or(raw, |(code, _)| code);
        let mut words = split_words(line, code);
        if words.is_empty() {
            return None;
        }
        let args = words.split_off(1);
        let name = words.pop()?;
        Some(Self { name, args })
    }

    fn arg(&self, index: usize, what: &str) -> Result<&Word, TiCfgError> {
        self.args.get(index).ok_or_else(|| {
            let problem = format!("argument {} ({what}) is missing", index + 1);
            self.name.error(problem)
        })
    }

    /// Returns the position of argument `index`, or that of the command's name if the argument is missing.
    pub(crate) fn span(&self, index: usize, what: &str) -> Span {
        let word = self.args.get(index).unwrap_or(&self.name);
        Span {
            line: word.line,
            columns: word.columns.clone(),
            what: format!("{} {what}", self.name.text),
        }
    }

    pub(crate) fn number(&self, index: usize, what: &str) -> Result<f64, TiCfgError> {
        self.arg(index, what)?.number(what)
    }

    pub(crate) fn whole(
        &self,
        index: usize,
        what: &str,
        range: Range<u32>,
    ) -> Result<u32, TiCfgError> {
        self.arg(index, what)?.whole(what, range)
    }

    pub(crate) fn mask(
        &self,
        index: usize,
        what: &str,
        range: Range<u32>,
    ) -> Result<u32, TiCfgError> {
        self.arg(index, what)?.mask(what, range)
    }

    /// A number above zero.
    pub(crate) fn positive(&self, index: usize, what: &str) -> Result<f64, TiCfgError> {
        let value = self.number(index, what)?;
        match value > 0.0 {
            true => Ok(value),
            false => Err(self.args[index].error(format!("{what}, must be positive"))),
        }
    }

    /// Whether `clutterRemoval` enables it. Older files have no leading sub-frame number.
    pub(crate) fn clutter_removal(&self) -> Result<bool, TiCfgError> {
        let index = self.args.len().saturating_sub(1).min(1);
        Ok(self.whole(index, "enabled", 0..2)? == 1)
    }
}

struct Profile {
    start_hz: f64,
    idle_s: f64,
    adc_start_s: f64,
    ramp_end_s: f64,
    /// Back-off of the transmitters, one byte of dB each, with TX1 in the lowest byte.
    backoff_code: u32,
    /// Phase shift of the transmitters, in the same bytes.
    phase_code: u32,
    slope_hz_per_s: f64,
    n_samples: usize,
    sample_rate_hz: f64,
    command: Command,
}

impl Profile {
    /// Everything that determines the samples.
    fn figures(&self) -> ([f64; 6], [u32; 2], usize) {
        let timing = [
            self.start_hz,
            self.idle_s,
            self.adc_start_s,
            self.ramp_end_s,
            self.slope_hz_per_s,
            self.sample_rate_hz,
        ];
        let codes = [self.backoff_code, self.phase_code];
        (timing, codes, self.n_samples)
    }
}

/// Arguments of `profileCfg` that become fields of the radar: index, field, description.
const PROFILE_FIELDS: [(usize, &str, &str); 7] = [
    (1, "start_hz", "start frequency, GHz"),
    (2, "idle_s", "idle time, us"),
    (3, "adc_start_s", "ADC start, us"),
    (4, "ramp_end_s", "ramp end, us"),
    (7, "slope_hz_per_s", "slope, MHz/us"),
    (9, "n_samples", "samples"),
    (10, "sample_rate_hz", "sample rate, ksps"),
];

#[derive(Clone)]
struct Chirp {
    profile: u32,
    profile_word: Word,
    /// Values that are added to start (Hz), slope (Hz/s), idle (s) and ADC start (s) of the profile.
    variation: [f64; 4],
    tx_mask: u32,
    mask_word: Word,
}

struct Frame {
    first: u32,
    last: u32,
    n_loops: u32,
    n_frames: u32,
    period_s: f64,
    /// Position of the period among the arguments.
    period_index: usize,
    command: Command,
}

/// `subFrameCfg`: one kind of chirps within an advanced frame.
struct SubFrame {
    first: u32,
    n_chirps: u32,
    n_loops: u32,
    period_s: f64,
    word: Word,
}

/// An enabled `bpmCfg`: the chirp with both transmitters in phase, and the chirp with the second one inverted. In which
/// of the two chirps TX2 is inverted was not verified on a device.
struct PhaseModulation {
    in_phase: u32,
    inverted: u32,
    command: Command,
}

#[derive(Default)]
struct File {
    platform: Option<(Platform, Word)>,
    /// Platform that the name of the file states.
    file_name: Option<Platform>,
    /// `dfeDataOutputMode 3`.
    advanced_mode: Option<Word>,
    /// `advFrameCfg` and the number of sub-frames that it states.
    advanced: Option<(Word, u32)>,
    subframes: BTreeMap<u32, SubFrame>,
    rx_mask: Option<(u32, Word)>,
    tx_mask: Option<(u32, Word)>,
    profiles: BTreeMap<u32, Profile>,
    chirps: BTreeMap<u32, Chirp>,
    frame: Option<Frame>,
    phase_modulation: Option<PhaseModulation>,
    geometry: [Option<(Word, Vec<f64>)>; 2],
    /// Whether `adcCfg` or `adcbufCfg` asks for real samples.
    is_real: Option<bool>,
    q_first: Option<bool>,
    clutter: Option<bool>,
    lvds: Option<bool>,
    calibration: Option<(f64, Vec<(f64, f64)>)>,
    phase_rotation: Vec<f64>,
    gui_monitor: Option<GuiMonitor>,
    places: Places,
    /// Commands with an unreadable line. Their absence is not reported as a second error.
    broken: BTreeSet<String>,
    unused: Vec<(usize, String)>,
}

impl File {
    /// Reads a line. An error is returned with the name of the command that is missing because of it.
    fn read_line(&mut self, line: usize, raw: &str) -> Result<(), (String, TiCfgError)> {
        if let Some((code, comment)) = raw.split_once('%')
            && let Some(platform) = platform_of_comment(comment)
        {
            let start = code.chars().count() + 1;
            let word = Word {
                line,
                columns: start..start + 1 + comment.chars().count(),
                text: comment.trim().into(),
            };
            self.platform = Some((platform, word));
        }
        let Some(command) = Command::of_line(line, raw) else {
            return Ok(());
        };
        let name_text = command.name.text.clone();
        self.read_command(command).map_err(|error| {
            let lost = match name_text.as_str() {
                "dfeDataOutputMode" | "advFrameCfg" | "subFrameCfg" => "frameCfg".into(),
                _ => name_text,
            };
            (lost, error)
        })
    }

    fn read_command(&mut self, command: Command) -> Result<(), TiCfgError> {
        match command.name.text.as_str() {
            "flushCfg" => {
                let unused = std::mem::take(&mut self.unused);
                *self = File {
                    platform: self.platform.take(),
                    file_name: self.file_name.take(),
                    unused,
                    ..File::default()
                };
            }
            "dfeDataOutputMode" => {
                self.advanced_mode = None;
                match command.whole(0, "mode", 0..5)? {
                    1 => {}
                    3 => self.advanced_mode = command.args.into_iter().next(),
                    _ => {
                        return Err(command.args[0].refuse(
                            "unsupported",
                            "only mode 1 (frames of chirps) has a cube; 2 is continuous, 3 are advanced frames",
                        ));
                    }
                }
            }
            "advFrameCfg" => {
                let n = command.whole(0, "sub-frames", 1..MAX_SUBFRAMES + 1)?;
                self.advanced = Some((command.name, n));
            }
            "subFrameCfg" => {
                let subframe = SubFrame {
                    first: command.whole(2, "first chirp", 0..MAX_CHIRPS)?,
                    n_chirps: command.whole(3, "chirps", 1..MAX_CHIRPS + 1)?,
                    n_loops: command.whole(4, "loops", 1..65_536)?,
                    period_s: command.positive(9, "sub-frame period, ms")? * 1e-3,
                    word: command.args[0].clone(),
                };
                let index = command.whole(0, "sub-frame", 0..MAX_SUBFRAMES)?;
                self.subframes.insert(index, subframe);
            }
            "channelCfg" => {
                // The devices of SDK 1 to 3 have four receivers and three transmitters; others are named later.
                let rx_mask = command.mask(0, "receiver mask", 1..1 << 16)?;
                let tx_mask = command.mask(1, "transmitter mask", 1..1 << 16)?;
                self.rx_mask = Some((rx_mask, command.args[0].clone()));
                self.tx_mask = Some((tx_mask, command.args[1].clone()));
                self.place(&command, "rx", 0, "receiver mask");
                self.place(&command, "tx", 1, "transmitter mask");
                if let Some(word) = command.args.get(2)
                    && word.whole("cascading", 0..3)? != 0
                {
                    return Err(word.refuse("unsupported", "cascaded devices are not supported"));
                }
            }
            "adcCfg" => {
                command.whole(0, "ADC bits", 0..3)?;
                let format = command.whole(1, "output format", 0..4)?;
                self.is_real = Some(format != 1 && format != 2);
                if format != 1 && format != 2 {
                    let problem = "samples must be complex (1 or 2), these are real";
                    return Err(command.args[1].refuse("unsupported", problem));
                }
            }
            "adcbufCfg" => self.read_adc_buffer(&command)?,
            "profileCfg" => self.read_profile(command)?,
            "chirpCfg" => self.read_chirps(&command)?,
            "frameCfg" => {
                // The MCU+ SDK has the number of samples before the period, and one or two values more than SDK 3; the
                // trigger behind the period is 1 or 2 in both. Words of comments do not count.
                let is_number = |word: &&Word| word.text.parse::<f64>().is_ok();
                let n_values = command.args.iter().take_while(is_number).count();
                let is_trigger = |index| command.whole(index, "trigger", 1..3).is_ok();
                let has_samples = n_values >= 8 && is_trigger(6) && !is_trigger(5);
                let period_index = if has_samples { 5 } else { 4 };
                let max_loops = if has_samples { 65_536 } else { 256 };
                self.frame = Some(Frame {
                    first: command.whole(0, "first chirp", 0..MAX_CHIRPS)?,
                    last: command.whole(1, "last chirp", 0..MAX_CHIRPS)?,
                    n_loops: command.whole(2, "loops", 1..max_loops)?,
                    n_frames: command.whole(3, "frames", 0..65_536)?,
                    period_s: command.number(period_index, "frame period, ms")? * 1e-3,
                    period_index,
                    command,
                });
            }
            "bpmCfg" => {
                self.phase_modulation = match command.whole(1, "enabled", 0..2)? {
                    1 => Some(PhaseModulation {
                        in_phase: command.whole(2, "chirp in phase", 0..MAX_CHIRPS)?,
                        inverted: command.whole(3, "inverted chirp", 0..MAX_CHIRPS)?,
                        command,
                    }),
                    _ => None,
                };
            }
            "clutterRemoval" => {
                self.clutter = Some(command.clutter_removal()?);
            }
            "lvdsStreamCfg" => {
                self.lvds = Some(command.whole(2, "data format", 0..8)? == 1);
                self.place(&command, "lvds_samples", 2, "data format");
            }
            "compRangeBiasAndRxChanPhase" => {
                let bias_m = command.number(0, "range bias, m")?;
                let mut values = Vec::with_capacity(command.args.len());
                for word in &command.args[1..] {
                    values.push(word.number("channel factor")?);
                }
                if values.is_empty() || values.len() % 2 != 0 {
                    return Err(command.name.error("needs pairs of real and imaginary part"));
                }
                self.calibration = Some((bias_m, values.chunks(2).map(|p| (p[0], p[1])).collect()));
            }
            "antGeometry0" => self.geometry[0] = Some(number_list(&command)?),
            "antGeometry1" => self.geometry[1] = Some(number_list(&command)?),
            "antPhaseRot" => self.phase_rotation = number_list(&command)?.1,
            name => {
                if name == "guiMonitor" {
                    self.read_gui_monitor(&command);
                }
                self.unused.push((command.name.line, command.name.text));
            }
        }
        Ok(())
    }

    fn place(&mut self, command: &Command, key: &'static str, index: usize, what: &str) {
        self.places.insert(key, command.span(index, what));
    }

    /// Reads a `guiMonitor`. SDK 2 and later have seven arguments that start with the sub-frame; SDK 1 has six. Other
    /// demos have commands of this name with different arguments, which are ignored.
    fn read_gui_monitor(&mut self, command: &Command) {
        let first = match command.args.len() {
            6 => 0,
            7 => 1,
            _ => return,
        };
        let mut values = [0; 6];
        for (i, value) in values.iter_mut().enumerate() {
            match command.whole(first + i, "output", 0..3) {
                Ok(v) => *value = v,
                Err(_) => return,
            }
        }
        let [points, range, noise, azimuth, doppler, stats] = values;
        self.gui_monitor = Some(GuiMonitor {
            points: points > 0,
            // The value 2 sends points without side information.
            side_info: points == 1,
            range_profile: range > 0,
            noise_profile: noise > 0,
            azimuth_map: azimuth > 0,
            doppler_map: doppler > 0,
            stats: stats > 0,
        });
        self.place(command, "points", first, "detected objects");
        self.place(command, "azimuth_map", first + 3, "range-azimuth heat map");
        self.place(command, "doppler_map", first + 4, "range-Doppler heat map");
    }

    fn read_adc_buffer(&mut self, command: &Command) -> Result<(), TiCfgError> {
        // SDK 2 and later have five arguments that start with the sub-frame; SDK 1 has four.
        let first = usize::from(command.args.len() >= 5);
        if command.whole(first, "output format", 0..2)? != 0 {
            self.is_real = Some(true);
            let problem = "samples must be complex (0), these are real";
            return Err(command.args[first].refuse("unsupported", problem));
        }
        self.q_first = Some(command.whole(first + 1, "sample swap", 0..2)? == 1);
        Ok(())
    }

    fn read_profile(&mut self, c: Command) -> Result<(), TiCfgError> {
        let id = c.whole(0, "profile", 0..4)?;
        let profile = Profile {
            start_hz: c.number(1, "start frequency, GHz")? * 1e9,
            idle_s: c.number(2, "idle time, us")? * 1e-6,
            adc_start_s: c.number(3, "ADC start, us")? * 1e-6,
            ramp_end_s: c.number(4, "ramp end, us")? * 1e-6,
            backoff_code: c.whole(5, "power back-off", 0..1 << 24)?,
            phase_code: c.whole(6, "phase shift", 0..1 << 24)?,
            slope_hz_per_s: c.number(7, "slope, MHz/us")? * 1e12,
            n_samples: c.whole(9, "samples", 1..8193)? as usize,
            sample_rate_hz: c.number(10, "sample rate, ksps")? * 1e3,
            command: c,
        };
        self.profiles.insert(id, profile);
        Ok(())
    }

    fn read_chirps(&mut self, c: &Command) -> Result<(), TiCfgError> {
        let first = c.whole(0, "first chirp", 0..MAX_CHIRPS)?;
        let last = c.whole(1, "last chirp", 0..MAX_CHIRPS)?;
        if last < first {
            return Err(c.args[1].error(format!("the last chirp comes before the first, {first}")));
        }
        let chirp = Chirp {
            profile: c.whole(2, "profile", 0..4)?,
            profile_word: c.arg(2, "profile")?.clone(),
            variation: [
                c.number(3, "start frequency variation, Hz")?,
                c.number(4, "slope variation, kHz/us")? * 1e9,
                c.number(5, "idle variation, us")? * 1e-6,
                c.number(6, "ADC start variation, us")? * 1e-6,
            ],
            tx_mask: c.mask(7, "transmitter mask", 0..256)?,
            mask_word: c.arg(7, "transmitter mask")?.clone(),
        };
        for index in first..=last {
            self.chirps.insert(index, chirp.clone());
        }
        Ok(())
    }

    fn dialect(&self) -> ChirpDialect {
        let is_mcu_plus = |name: &str| {
            let name = name.to_ascii_lowercase();
            ["2944", "2x44"].iter().any(|part| name.contains(part))
        };
        let platform = self.platform.as_ref().map(|(platform, _)| platform);
        let platform = platform.or(self.file_name.as_ref());
        if self.advanced_mode.is_some() || self.advanced.is_some() {
            return ChirpDialect::AdvancedFrames;
        }
        match (platform, &self.frame) {
            (_, Some(frame)) if frame.period_index == 5 => ChirpDialect::McuPlus,
            (Some(Platform::UnknownAntennas { name }), _) if is_mcu_plus(name) => {
                ChirpDialect::McuPlus
            }
            _ => ChirpDialect::Sdk,
        }
    }

    fn finish(mut self, board: Option<Board>, errors: Vec<TiCfgError>) -> TiCfgReading {
        let mut reading = TiCfgReading {
            cfg: None,
            errors,
            dialect: self.dialect(),
            points: None,
            equivalent: None,
            draft: None,
            board_evidence: None,
            lvds_samples: self.lvds,
            gui_monitor: self.gui_monitor,
            places: std::mem::take(&mut self.places),
        };
        let is_advanced = reading.dialect == ChirpDialect::AdvancedFrames;
        let missing = [
            ("channelCfg", self.rx_mask.is_none()),
            ("profileCfg", self.profiles.is_empty()),
            ("frameCfg", self.frame.is_none() && !is_advanced),
        ];
        for (name, is_missing) in missing {
            if is_missing && !self.broken.contains(name) {
                reading.errors.push(TiCfgError::Missing(name));
            }
        }
        let found = match (&self.frame, is_advanced) {
            (_, true) => self.advanced_points(board, &mut reading.errors),
            (Some(frame), false) => self.frame_points(frame, reading.dialect, board),
            (None, false) => return reading,
        };
        let impossible = match found {
            Ok(points) => {
                reading.points = points;
                None
            }
            Err(error) => Some(error),
        };
        if !is_advanced {
            self.finish_frames(board, &mut reading);
        }
        // A radar with an impossible frame period has been reported as such.
        let is_reported =
            |e: &TiCfgError| matches!(e, TiCfgError::Radar(e) if e.field == "frame_period_s");
        if let Some(error) = impossible
            && !reading.errors.iter().any(is_reported)
        {
            reading.cfg = None;
            reading.errors.push(error);
        }
        reading
    }

    /// Name of the board or device for points, which do not need its antennas.
    fn device_name(&self, stated: Option<Board>) -> String {
        let start_hz = self.profiles.values().next().map(|p| p.start_hz);
        let tx_mask = self.tx_mask.as_ref().map_or(0, |(mask, _)| *mask);
        let platform = self.platform.as_ref().map(|(platform, _)| platform);
        match (platform.or(self.file_name.as_ref()), self.dialect()) {
            (Some(Platform::UnknownAntennas { name }), _) => name.clone(),
            (_, ChirpDialect::McuPlus) => "xwr2944".into(),
            _ if self.has_other_masks() => "unknown".into(),
            _ => match self.board(stated, start_hz.unwrap_or(0.0), tx_mask) {
                Ok((board, _)) if start_hz.is_some() => board.name().into(),
                _ => "unknown".into(),
            },
        }
    }

    /// Whether the masks enable antennas that no device of SDK 1 to 3 has.
    fn has_other_masks(&self) -> bool {
        self.rx_mask.as_ref().is_some_and(|(mask, _)| *mask > 15)
            || self.tx_mask.as_ref().is_some_and(|(mask, _)| *mask > 7)
    }

    /// The ramp of a chirp and the time that the chirp takes, s.
    fn ramp(&self, chirp: &Chirp) -> Option<(Sampling, f64)> {
        let profile = self.profiles.get(&chirp.profile)?;
        let [start_hz, slope_hz_per_s, idle_s, adc_start_s] = chirp.variation;
        let is_real = self
            .is_real
            .unwrap_or(self.dialect() == ChirpDialect::McuPlus);
        let sampling = Sampling {
            start_hz: profile.start_hz + start_hz,
            slope_hz_per_s: profile.slope_hz_per_s + slope_hz_per_s,
            adc_start_s: profile.adc_start_s + adc_start_s,
            n_samples: profile.n_samples as u32,
            sample_rate_hz: profile.sample_rate_hz,
            is_real,
        };
        Some((sampling, profile.idle_s + idle_s + profile.ramp_end_s))
    }

    /// The ramp that the chirps from `first` to `last` share, if they do, and the time that they take together, s.
    /// `None` if one of them is not defined.
    fn loop_of(&self, first: u32, last: u32) -> Option<(Option<Sampling>, f64)> {
        let ramps: Option<Vec<_>> = (first..=last)
            .map(|index| self.ramp(self.chirps.get(&index)?))
            .collect();
        let ramps = ramps.filter(|ramps| !ramps.is_empty())?;
        let (shared, _) = ramps[0];
        let is_shared = ramps.iter().all(|(sampling, _)| *sampling == shared);
        let duration_s = ramps.iter().map(|(_, s)| s).sum();
        Some((is_shared.then_some(shared), duration_s))
    }

    /// What points need of a file with a `frameCfg`.
    fn frame_points(
        &self,
        frame: &Frame,
        dialect: ChirpDialect,
        board: Option<Board>,
    ) -> Result<Option<PointRadar>, TiCfgError> {
        let word = frame.command.args.get(frame.period_index);
        let word = word.unwrap_or(&frame.command.name);
        let mut points = PointRadar::new(self.device_name(board), dialect, frame.period_s)
            .map_err(|problem| word.error(problem))?;
        let Some((sampling, loop_s)) = self.loop_of(frame.first, frame.last) else {
            return Ok(Some(points));
        };
        check_duration(word, loop_s * f64::from(frame.n_loops), frame.period_s)?;
        if let Some(sampling) = sampling {
            points.set_range(&sampling);
            // The transmitters of the MCU+ SDK share Doppler bins, so that loops do not determine the velocity.
            if dialect == ChirpDialect::Sdk {
                points.set_velocity(loop_s, frame.n_loops);
            }
        }
        Ok(Some(points))
    }

    /// What points need of a file with advanced frames. Adds why there is no cube.
    fn advanced_points(
        &self,
        board: Option<Board>,
        errors: &mut Vec<TiCfgError>,
    ) -> Result<Option<PointRadar>, TiCfgError> {
        let Some((word, n)) = &self.advanced else {
            if let Some(mode) = &self.advanced_mode {
                errors.push(mode.refuse(
                    "unsupported",
                    "mode 3 is that of advanced frames, whose sub-frames have no single cube; mode 1 has one",
                ));
            }
            if !self.broken.contains("frameCfg") {
                errors.push(TiCfgError::Missing("advFrameCfg"));
            }
            return Ok(None);
        };
        errors.push(word.refuse(
            "unsupported",
            "these are advanced frames, whose sub-frames have no single cube: points can be read, raw samples cannot",
        ));
        let mut period_s = 0.0;
        let mut figures = Vec::new();
        for index in 0..*n {
            let Some(subframe) = self.subframes.get(&index) else {
                // An unreadable line has been reported.
                if !self.broken.contains("frameCfg") {
                    let problem = format!("{n} sub-frames are stated, but no subFrameCfg {index}");
                    return Err(word.refuse("undefined-subframe", problem));
                }
                return Ok(None);
            };
            period_s += subframe.period_s;
            let last = subframe.first + subframe.n_chirps - 1;
            let Some((sampling, loop_s)) = self.loop_of(subframe.first, last) else {
                let problem = format!(
                    "chirps {} to {last} are used, but not all of them are defined",
                    subframe.first
                );
                errors.push(subframe.word.refuse("undefined-chirp", problem));
                continue;
            };
            let active_s = loop_s * f64::from(subframe.n_loops);
            check_duration(&subframe.word, active_s, subframe.period_s)?;
            figures.push((sampling, loop_s, subframe.n_loops));
        }
        if let Some((index, subframe)) = self.subframes.range(*n..).next() {
            let problem = format!("sub-frame {index} is defined, but advFrameCfg states {n}");
            return Err(subframe.word.refuse("undefined-subframe", problem));
        }
        let name = self.device_name(board);
        let mut points = PointRadar::new(name, ChirpDialect::AdvancedFrames, period_s)
            .map_err(|problem| word.error(problem))?;
        // Sub-frames with different figures have none in common.
        if let Some((sampling, loop_s, n_loops)) = figures.first()
            && figures.len() == *n as usize
            && let Some(sampling) = sampling
        {
            if figures.iter().all(|f| f.0.as_ref() == Some(sampling)) {
                points.set_range(sampling);
            }
            if figures.iter().all(|f| (f.1, f.2) == (*loop_s, *n_loops)) {
                points.set_velocity(*loop_s, *n_loops);
            }
        }
        Ok(Some(points))
    }

    /// Adds the cube of a file with a `frameCfg`, or why there is none.
    fn finish_frames(self, board: Option<Board>, reading: &mut TiCfgReading) {
        let (Some((rx_mask, rx_word)), Some((tx_mask, tx_word)), Some(frame)) =
            (&self.rx_mask, &self.tx_mask, self.frame.as_ref())
        else {
            return;
        };
        let (rx_mask, tx_mask) = (*rx_mask, *tx_mask);
        if reading.dialect == ChirpDialect::McuPlus {
            let word = frame.command.args.get(4).unwrap_or(&frame.command.name);
            let reason = word.refuse(
                "unsupported",
                "this is a chirp file of the MCU+ SDK (xWR2944), whose antennas are not known: points can be read, raw \
                 samples cannot",
            );
            reading.errors.insert(0, reason);
            return;
        }
        if self.has_other_masks() {
            let (word, mask) = match rx_mask > 15 {
                true => (rx_word, rx_mask),
                false => (tx_word, tx_mask),
            };
            reading.errors.push(word.refuse(
                "unknown-antennas",
                format!(
                    "the mask {mask} is of a device with more antennas than the three transmitters and four receivers of \
                     SDK 1 to 3, which are not known: points can be read, raw samples cannot"
                ),
            ));
            return;
        }
        let n_errors = reading.errors.len();
        let (slots, common) = self.slots(frame, tx_mask, &mut reading.errors);
        // Without a usable chirp, the first profile provides the chirp parameters.
        let profile = match &common {
            Some(chirp) => self.profiles.get(&chirp.profile),
            None => self.profiles.values().next(),
        };
        let Some(profile) = profile else {
            return;
        };
        for (index, field, what) in PROFILE_FIELDS {
            let span = profile.command.span(index, what);
            reading.places.insert(field, span);
        }
        for (index, field, what) in [
            (2, "n_loops", "loops"),
            (4, "frame_period_s", "frame period, ms"),
        ] {
            reading
                .places
                .insert(field, frame.command.span(index, what));
        }

        let (board, evidence) = match self.board(board, profile.start_hz, tx_mask) {
            Ok(found) => found,
            Err(error) => {
                reading.errors.push(error);
                return;
            }
        };
        reading.board_evidence = Some(evidence.clone());
        let figures = board.figures();
        let mut tx = Vec::with_capacity(slots.len());
        for (slot, word) in &slots {
            match figures.tx.get(usize::from(*slot) - 1) {
                Some(place) => tx.push(*place),
                None => {
                    let problem = format!("the {} has no TX{slot}", board.name());
                    push_once(&mut reading.errors, word.refuse("tx-mask", problem));
                }
            }
        }
        let used = slots
            .iter()
            .fold(0, |mask, (slot, _)| mask | 1 << (slot - 1));
        if used != tx_mask {
            // The frame omits chirps of some enabled transmitters.
            let span = frame.command.span(1, "last chirp");
            reading.places.insert("tx", span);
        }
        let receivers: Vec<u8> = (1..=4).filter(|r| rx_mask >> (r - 1) & 1 == 1).collect();
        let rx = receivers
            .iter()
            .filter_map(|r| figures.rx.get(usize::from(*r) - 1).copied())
            .collect();
        let first_tx = slots.first().map_or(0, |s| u32::from(s.0) - 1);
        let backoff_db = f64::from(profile.backoff_code >> (8 * first_tx) & 0xff);
        let variation = common.map_or([0.0; 4], |chirp| chirp.variation);
        let radar = RadarConfig {
            name: board.name().into(),
            start_hz: profile.start_hz + variation[0],
            slope_hz_per_s: profile.slope_hz_per_s + variation[1],
            idle_s: profile.idle_s + variation[2],
            adc_start_s: profile.adc_start_s + variation[3],
            ramp_end_s: profile.ramp_end_s,
            n_samples: profile.n_samples,
            sample_rate_hz: profile.sample_rate_hz,
            n_loops: frame.n_loops as usize,
            frame_period_s: frame.period_s,
            tx,
            multiplexing: match self.phase_modulation {
                Some(_) => TxMultiplexing::Bpm,
                None => TxMultiplexing::Tdm,
            },
            rx,
            tx_power_dbm: figures.tx_power_dbm - backoff_db,
            antenna_gain_dbi: figures.antenna_gain_dbi,
            azimuth_half_width_rad: figures.azimuth_half_width_rad,
            elevation_half_width_rad: figures.elevation_half_width_rad,
            noise_figure_db: figures.noise_figure_db,
        };
        // Errors in chirps have been reported. A lack of usable chirps follows from them and is not reported again.
        let chirps_are_wrong = reading.errors.len() > n_errors;
        reading.errors.extend(
            radar
                .problems()
                .into_iter()
                .filter(|p| !(chirps_are_wrong && ["tx", "firing"].contains(&p.field)))
                .map(TiCfgError::Radar),
        );
        reading.draft = Some(radar.clone());
        if reading.errors.is_empty() {
            reading.cfg = Some(TiCfg {
                radar,
                board,
                board_evidence: evidence,
                slots: slots.iter().map(|s| s.0).collect(),
                receivers,
                n_frames: frame.n_frames,
                q_first: self.q_first,
                firmware_clutter_removal: self.clutter,
                lvds_samples: self.lvds,
                calibration: self.calibration,
                phase_rotation: self.phase_rotation,
                gui_monitor: self.gui_monitor,
                unused: self.unused,
            });
        }
    }

    /// Whether two chirps differ in no more than their transmitter and in the number of an equal profile.
    fn are_alike(&self, a: &Chirp, b: &Chirp) -> bool {
        let profiles = || {
            Some((
                self.profiles.get(&a.profile)?,
                self.profiles.get(&b.profile)?,
            ))
        };
        let equal_profiles = || profiles().is_some_and(|(a, b)| a.figures() == b.figures());
        a.variation == b.variation && (a.profile == b.profile || equal_profiles())
    }

    /// Transmitter of every slot with the argument that specifies it, and the first of these chirps. Slots are the
    /// chirps that the frame uses, not all that are defined.
    fn slots(
        &self,
        frame: &Frame,
        tx_mask: u32,
        errors: &mut Vec<TiCfgError>,
    ) -> (Vec<(u8, Word)>, Option<&Chirp>) {
        let mut slots = Vec::new();
        let mut common: Option<&Chirp> = None;
        let end = frame.command.args.get(1).unwrap_or(&frame.command.name);
        if frame.last < frame.first {
            errors.push(end.error("the last chirp comes before the first"));
        }
        let undefined = (frame.first..=frame.last).find(|i| !self.chirps.contains_key(i));
        if let Some(index) = undefined
            && !self.broken.contains("chirpCfg")
        {
            let problem = format!("chirp {index} is used, but no chirpCfg defines it");
            errors.push(end.refuse("undefined-chirp", problem));
        }
        let is_pair = frame.last == frame.first + 1;
        if let Some(bpm) = &self.phase_modulation
            && !(is_pair && (frame.first, frame.last) == (bpm.in_phase, bpm.inverted))
        {
            let problem = format!(
                "binary phase modulation takes a frame of its two chirps, {} and {}, and no others; this frame has chirps {} \
                 to {}: points can be read, raw samples cannot",
                bpm.in_phase, bpm.inverted, frame.first, frame.last
            );
            errors.push(bpm.command.name.refuse("unsupported", problem));
            return (slots, self.chirps.get(&frame.first));
        }
        for (index, chirp) in self.chirps.range(frame.first..=frame.last.max(frame.first)) {
            if !self.profiles.contains_key(&chirp.profile) && !self.broken.contains("profileCfg") {
                let problem = format!("profile {} is not defined", chirp.profile);
                let error = chirp.profile_word.refuse("undefined-profile", problem);
                push_once(errors, error);
            }
            if let Some(other) = common
                && !self.are_alike(other, chirp)
            {
                let problem =
                    format!("chirp {index} differs from the others in more than its transmitter");
                push_once(errors, chirp.mask_word.refuse("unsupported", problem));
            }
            let (n_wanted, problem) = match self.phase_modulation {
                None => (
                    1,
                    "one transmitter at a time (mask 1, 2 or 4) is supported without bpmCfg",
                ),
                Some(_) => (
                    2,
                    "binary phase modulation takes two transmitters (mask 3, 5 or 6)",
                ),
            };
            if chirp.tx_mask.count_ones() != n_wanted {
                push_once(errors, chirp.mask_word.refuse("tx-mask", problem));
                continue;
            }
            if chirp.tx_mask & !tx_mask != 0 {
                let problem = format!("channelCfg enables only transmitter mask {tx_mask}");
                push_once(errors, chirp.mask_word.refuse("tx-mask", problem));
                continue;
            }
            if self.phase_modulation.is_some()
                && let Some(other) = common
                && other.tx_mask != chirp.tx_mask
            {
                let problem =
                    "binary phase modulation takes the same two transmitters in both chirps";
                push_once(errors, chirp.mask_word.refuse("tx-mask", problem));
            }
            common = common.or(Some(chirp));
            let transmitter = match self.phase_modulation {
                // The first slot represents the lower-numbered transmitter, the second slot the higher-numbered one.
                Some(_) if !slots.is_empty() => chirp.tx_mask.ilog2(),
                _ => chirp.tx_mask.trailing_zeros(),
            };
            slots.push((transmitter as u8 + 1, chirp.mask_word.clone()));
        }
        (slots, common)
    }

    fn board(
        &self,
        stated: Option<Board>,
        start_hz: f64,
        tx_mask: u32,
    ) -> Result<(Board, BoardEvidence), TiCfgError> {
        if let Some(board) = stated {
            return Ok((board, BoardEvidence::Stated));
        }
        let is_60_ghz = start_hz < 70e9;
        if let [Some((word, columns)), Some((_, rows))] = &self.geometry {
            // Boards with equal antennas are told apart by the platform.
            let named = match &self.platform {
                Some((Platform::Board(board), _)) => Some(*board),
                _ => None,
            };
            let mut boards = named
                .into_iter()
                .chain(Board::ALL.into_iter().rev())
                .filter(|b| b.is_60_ghz() == is_60_ghz);
            return match boards.find(|b| has_geometry(*b, columns, rows)) {
                Some(board) => Ok((board, BoardEvidence::Geometry)),
                None => Err(word.refuse(
                    "antenna-geometry",
                    "this antenna geometry is of no known board",
                )),
            };
        }
        let unknown = |word: &Word, name: &str| {
            word.refuse(
                "unknown-antennas",
                format!(
                    "the antennas of {name} are not known: points can be read, raw samples cannot"
                ),
            )
        };
        let fits = |board: Board| board.is_60_ghz() == is_60_ghz;
        let by_file_name = self.file_name.as_ref();
        match &self.platform {
            Some((Platform::Board(board), _)) if fits(*board) => {
                return Ok((*board, BoardEvidence::Platform));
            }
            Some((Platform::UnknownAntennas { name }, word)) => return Err(unknown(word, name)),
            Some((Platform::Family { name, assumed }, _)) if fits(*assumed) => {
                return Ok(match by_file_name {
                    Some(Platform::Board(board)) if fits(*board) => {
                        (*board, BoardEvidence::FileName)
                    }
                    _ => (*assumed, BoardEvidence::Family(name.clone())),
                });
            }
            _ => {}
        }
        match by_file_name {
            Some(Platform::Board(board)) if fits(*board) => {
                return Ok((*board, BoardEvidence::FileName));
            }
            Some(Platform::UnknownAntennas { name }) => {
                return Err(match &self.rx_mask {
                    Some((_, word)) => {
                        unknown(word, &format!("{name}, which the file is named after,"))
                    }
                    None => TiCfgError::Missing("channelCfg"),
                });
            }
            Some(Platform::Family { name, assumed }) if fits(*assumed) => {
                return Ok((*assumed, BoardEvidence::Family(name.clone())));
            }
            _ => {}
        }
        let guess = match (is_60_ghz, tx_mask) {
            (true, _) => Board::Xwr6843Isk,
            (false, 3) => Board::Xwr1642Boost,
            (false, _) => Board::Xwr1843Boost,
        };
        Ok((guess, BoardEvidence::Guess))
    }
}

/// Refuses chirps that take longer than their frame or sub-frame, s.
fn check_duration(word: &Word, active_s: f64, period_s: f64) -> Result<(), TiCfgError> {
    // The tolerance covers the rounding of microseconds.
    match active_s <= period_s * (1.0 + 1e-9) {
        true => Ok(()),
        false => Err(word.error(format!(
            "chirps take {:.2} ms but the frame lasts {:.2} ms",
            active_s * 1e3,
            period_s * 1e3
        ))),
    }
}

/// A line can define several chirps, but its error is reported once.
fn push_once(errors: &mut Vec<TiCfgError>, error: TiCfgError) {
    if errors.last() != Some(&error) {
        errors.push(error);
    }
}

/// Whether `antGeometry` lines (columns and rows, both counting downwards from 0) match the board.
fn has_geometry(board: Board, columns: &[f64], rows: &[f64]) -> bool {
    let figures = board.figures();
    let all: Vec<(f64, f64)> = figures
        .tx
        .iter()
        .flat_map(|t| {
            figures
                .rx
                .iter()
                .map(move |r| (t.x_m + r.x_m, t.z_m + r.z_m))
        })
        .collect();
    if columns.len() != all.len() || rows.len() != all.len() {
        return false;
    }
    // Half a wavelength is 2.4 or 1.9 mm; a tenth of it is a sufficient tolerance to distinguish all layouts.
    let half_m =
        0.5 * radarllm_base::SPEED_OF_LIGHT_MPS / if board.is_60_ghz() { 62e9 } else { 77e9 };
    (0..all.len()).all(|i| {
        let x = ((columns[0] - columns[i]) * half_m).abs() - (all[i].0 - all[0].0).abs();
        let z = (rows[i] - rows[0]) * half_m - (all[i].1 - all[0].1);
        x.abs() < 0.1 * half_m && z.abs() < 0.1 * half_m
    })
}

/// Parses the platform from a comment such as ` Platform:xWR18xx`.
fn platform_of_comment(comment: &str) -> Option<Platform> {
    Platform::from_name(comment.split_once("Platform:")?.1)
}

fn number_list(command: &Command) -> Result<(Word, Vec<f64>), TiCfgError> {
    let values: Result<Vec<f64>, _> = command
        .args
        .iter()
        .map(|w| w.number("each value"))
        .collect();
    Ok((command.name.clone(), values?))
}

/// Splits a line into words separated by white space. Columns are counted in characters from 1.
fn split_words(line: usize, code: &str) -> Vec<Word> {
    let mut words: Vec<Word> = Vec::new();
    let mut open = false;
    for (i, c) in code.chars().enumerate() {
        // Windows editors insert byte order marks.
        if c.is_whitespace() || c == '\u{feff}' {
            open = false;
        } else if open && let Some(word) = words.last_mut() {
            word.text.push(c);
            word.columns.end = i + 2;
        } else {
            words.push(Word {
                line,
                columns: i + 1..i + 2,
                text: c.to_string(),
            });
            open = true;
        }
    }
    words
}
