//! Chirp files of TI's mmWave SDK: one CLI command per line, `%` starts a comment.
//!
//! Read are the commands that say what the samples are: `channelCfg`, `adcCfg`, `adcbufCfg`,
//! `profileCfg`, `chirpCfg`, `frameCfg`, `dfeDataOutputMode`, `bpmCfg`, `clutterRemoval`,
//! `lvdsStreamCfg`, `compRangeBiasAndRxChanPhase`, `antGeometry0/1`, `antPhaseRot`. Everything else
//! tunes on-chip detection and is listed in [`TiCfg::unused`]. Argument order: SDK 3 user guide,
//! "Configuration (.cfg) File Format".

use std::collections::BTreeMap;
use std::ops::Range;

use radarllm_base::RadarConfig;
use radarllm_base::radar_config::RadarConfigError;

use crate::boards::Board;

/// Longest piece of the file quoted in an error, characters.
const MAX_QUOTE: usize = 40;
/// Chirps a device can hold.
const MAX_CHIRPS: u32 = 512;

/// What a chirp file says.
#[derive(Clone, Debug, PartialEq)]
pub struct TiCfg {
    /// The radar; `tx` in firing order.
    pub radar: RadarConfig,
    /// The board whose antennas were assumed.
    pub board: Board,
    /// Whether the board is a guess: no `% Platform:` line and no `antGeometry` lines name it.
    pub board_guessed: bool,
    /// Transmitter (from 1) of every TDM slot.
    pub slots: Vec<u8>,
    /// Receivers (from 1) in use.
    pub receivers: Vec<u8>,
    /// Frames to send; 0 means until stopped.
    pub n_frames: u32,
    /// `SampleSwap` of `adcbufCfg`: true means Q before I in the recording of SDK firmware.
    pub q_first: Option<bool>,
    /// Whether the firmware itself removes static clutter.
    pub firmware_clutter_removal: Option<bool>,
    /// Whether raw samples go out over LVDS.
    pub lvds_samples: Option<bool>,
    /// Calibration: range bias, m, and (re, im) factors of the virtual channels, TX1's receivers first.
    pub calibration: Option<(f64, Vec<(f64, f64)>)>,
    /// Sign of each virtual channel's feed (`antPhaseRot`), TX1's receivers first; empty if not given.
    pub phase_rotation: Vec<f64>,
    /// Commands that do not shape the samples: line (from 1) and name.
    pub unused: Vec<(usize, String)>,
}

/// Why a chirp file is refused.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum TiCfgError {
    /// One argument or command is wrong.
    #[error("line {line}, columns {start} to {end}: `{text}`: {problem}", start = columns.start, end = columns.end)]
    Line {
        /// Line, from 1.
        line: usize,
        /// Columns, from 1, end exclusive, in characters.
        columns: Range<usize>,
        /// The offending text, shortened.
        text: String,
        /// What is wrong.
        problem: String,
    },
    /// A needed command is absent.
    #[error("there is no `{0}` line")]
    Missing(&'static str),
    /// The values are readable, but no radar can do that.
    #[error(transparent)]
    Radar(#[from] RadarConfigError),
}

/// Reads the radar of a chirp file; [`TiCfg::parse`] gives the rest of it too.
///
/// # Errors
/// As [`TiCfg::parse`].
pub fn radar_from_ti_cfg(text: &str) -> Result<RadarConfig, TiCfgError> {
    Ok(TiCfg::parse(text, None)?.radar)
}

impl TiCfg {
    /// Reads a chirp file.
    ///
    /// `board` names the board; `None` takes it from `antGeometry` lines, or else from
    /// `% Platform:`, or else guesses: 60 GHz is the 6843 ISK; at 77 GHz a `channelCfg` with only TX1
    /// and TX2 enabled is the 1642 board, anything else the 1843 board.
    ///
    /// # Errors
    /// [`TiCfgError::Line`] for anything unreadable or that a [`RadarConfig`] cannot express (advanced
    /// frames, continuous wave, real samples, two transmitters at once, chirps that differ),
    /// [`TiCfgError::Missing`], and [`TiCfgError::Radar`] for timing that cannot be.
    pub fn parse(text: &str, board: Option<Board>) -> Result<Self, TiCfgError> {
        let mut file = File::default();
        for (i, raw) in text.lines().enumerate() {
            file.read_line(i + 1, raw)?;
        }
        file.finish(board)
    }
}

/// One argument with its place.
#[derive(Clone, Debug)]
struct Word {
    line: usize,
    columns: Range<usize>,
    text: String,
}

impl Word {
    fn error(&self, problem: impl Into<String>) -> TiCfgError {
        let mut text: String = self.text.chars().take(MAX_QUOTE).collect();
        if text.len() < self.text.len() {
            text.push('…');
        }
        TiCfgError::Line {
            line: self.line,
            columns: self.columns.clone(),
            text,
            problem: problem.into(),
        }
    }

    fn number(&self, what: &str) -> Result<f64, TiCfgError> {
        match self.text.parse::<f64>() {
            Ok(v) if v.is_finite() => Ok(v),
            _ => Err(self.error(format!("{what} must be a number"))),
        }
    }

    /// A whole number in the range; TI writes some as `96.00`.
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
struct Command {
    name: Word,
    args: Vec<Word>,
}

impl Command {
    fn arg(&self, index: usize, what: &str) -> Result<&Word, TiCfgError> {
        self.args.get(index).ok_or_else(|| {
            let problem = format!("argument {} ({what}) is missing", index + 1);
            self.name.error(problem)
        })
    }

    fn number(&self, index: usize, what: &str) -> Result<f64, TiCfgError> {
        self.arg(index, what)?.number(what)
    }

    fn whole(&self, index: usize, what: &str, range: Range<u32>) -> Result<u32, TiCfgError> {
        self.arg(index, what)?.whole(what, range)
    }
}

struct Profile {
    start_hz: f64,
    idle_s: f64,
    adc_start_s: f64,
    ramp_end_s: f64,
    /// One byte of dB per transmitter, TX1 lowest.
    backoff_code: u32,
    slope_hz_per_s: f64,
    n_samples: usize,
    sample_rate_hz: f64,
}

struct Chirp {
    profile: u32,
    /// Added to start (Hz), slope (Hz/s), idle (s) and ADC start (s) of the profile.
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
    name: Word,
}

#[derive(Default)]
struct File {
    platform: Option<Board>,
    rx_mask: Option<u32>,
    tx_mask: Option<u32>,
    profiles: BTreeMap<u32, Profile>,
    chirps: BTreeMap<u32, Chirp>,
    frame: Option<Frame>,
    geometry: [Option<(Word, Vec<f64>)>; 2],
    q_first: Option<bool>,
    clutter: Option<bool>,
    lvds: Option<bool>,
    calibration: Option<(f64, Vec<(f64, f64)>)>,
    phase_rotation: Vec<f64>,
    unused: Vec<(usize, String)>,
}

impl File {
    fn read_line(&mut self, line: usize, raw: &str) -> Result<(), TiCfgError> {
        let (code, comment) = raw.split_once('%').unwrap_or((raw, ""));
        if let Some(board) = platform_board(comment) {
            self.platform = Some(board);
        }
        let mut words = split_words(line, code);
        if words.is_empty() {
            return Ok(());
        }
        let args = words.split_off(1);
        let Some(name) = words.pop() else {
            return Ok(());
        };
        let command = Command { name, args };
        match command.name.text.as_str() {
            "flushCfg" => {
                let unused = std::mem::take(&mut self.unused);
                *self = File {
                    platform: self.platform,
                    unused,
                    ..File::default()
                };
            }
            "dfeDataOutputMode" => {
                if command.whole(0, "mode", 0..5)? != 1 {
                    return Err(command.args[0].error(
                        "only mode 1 (frames of chirps) has a cube; 2 is continuous, 3 are advanced frames",
                    ));
                }
            }
            "advFrameCfg" | "subFrameCfg" => {
                return Err(command
                    .name
                    .error("advanced frames have no single cube shape"));
            }
            "channelCfg" => {
                self.rx_mask = Some(command.whole(0, "receiver mask", 1..16)?);
                self.tx_mask = Some(command.whole(1, "transmitter mask", 1..8)?);
                if let Some(word) = command.args.get(2)
                    && word.whole("cascading", 0..3)? != 0
                {
                    return Err(word.error("cascaded devices are not supported"));
                }
            }
            "adcCfg" => {
                command.whole(0, "ADC bits", 0..3)?;
                let format = command.whole(1, "output format", 0..4)?;
                if format != 1 && format != 2 {
                    return Err(
                        command.args[1].error("samples must be complex (1 or 2), these are real")
                    );
                }
            }
            "adcbufCfg" => self.read_adc_buffer(&command)?,
            "profileCfg" => self.read_profile(&command)?,
            "chirpCfg" => self.read_chirps(&command)?,
            "frameCfg" => {
                self.frame = Some(Frame {
                    first: command.whole(0, "first chirp", 0..MAX_CHIRPS)?,
                    last: command.whole(1, "last chirp", 0..MAX_CHIRPS)?,
                    n_loops: command.whole(2, "loops", 1..256)?,
                    n_frames: command.whole(3, "frames", 0..65_536)?,
                    period_s: command.number(4, "frame period, ms")? * 1e-3,
                    name: command.name,
                });
            }
            "bpmCfg" => {
                if command.whole(1, "enabled", 0..2)? == 1 {
                    return Err(command.name.error("binary phase modulation is not TDM"));
                }
            }
            "clutterRemoval" => {
                // Older files have no sub-frame number in front.
                let index = command.args.len().saturating_sub(1).min(1);
                self.clutter = Some(command.whole(index, "enabled", 0..2)? == 1);
            }
            "lvdsStreamCfg" => self.lvds = Some(command.whole(2, "data format", 0..8)? == 1),
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
            _ => self.unused.push((line, command.name.text)),
        }
        Ok(())
    }

    fn read_adc_buffer(&mut self, command: &Command) -> Result<(), TiCfgError> {
        // SDK 2 and later put the sub-frame first and have five arguments, SDK 1 has four.
        let first = usize::from(command.args.len() >= 5);
        if command.whole(first, "output format", 0..2)? != 0 {
            return Err(command.args[first].error("samples must be complex (0), these are real"));
        }
        self.q_first = Some(command.whole(first + 1, "sample swap", 0..2)? == 1);
        Ok(())
    }

    fn read_profile(&mut self, c: &Command) -> Result<(), TiCfgError> {
        let profile = Profile {
            start_hz: c.number(1, "start frequency, GHz")? * 1e9,
            idle_s: c.number(2, "idle time, us")? * 1e-6,
            adc_start_s: c.number(3, "ADC start, us")? * 1e-6,
            ramp_end_s: c.number(4, "ramp end, us")? * 1e-6,
            backoff_code: c.whole(5, "power back-off", 0..1 << 24)?,
            slope_hz_per_s: c.number(7, "slope, MHz/us")? * 1e12,
            n_samples: c.whole(9, "samples", 1..8193)? as usize,
            sample_rate_hz: c.number(10, "sample rate, ksps")? * 1e3,
        };
        self.profiles.insert(c.whole(0, "profile", 0..4)?, profile);
        Ok(())
    }

    fn read_chirps(&mut self, c: &Command) -> Result<(), TiCfgError> {
        let first = c.whole(0, "first chirp", 0..MAX_CHIRPS)?;
        let last = c.whole(1, "last chirp", 0..MAX_CHIRPS)?;
        if last < first {
            return Err(c.args[1].error(format!("the last chirp comes before the first, {first}")));
        }
        for index in first..=last {
            let chirp = Chirp {
                profile: c.whole(2, "profile", 0..4)?,
                variation: [
                    c.number(3, "start frequency variation, Hz")?,
                    c.number(4, "slope variation, kHz/us")? * 1e9,
                    c.number(5, "idle variation, us")? * 1e-6,
                    c.number(6, "ADC start variation, us")? * 1e-6,
                ],
                tx_mask: c.whole(7, "transmitter mask", 0..8)?,
                mask_word: c.arg(7, "transmitter mask")?.clone(),
            };
            self.chirps.insert(index, chirp);
        }
        Ok(())
    }

    fn finish(self, board: Option<Board>) -> Result<TiCfg, TiCfgError> {
        let rx_mask = self.rx_mask.ok_or(TiCfgError::Missing("channelCfg"))?;
        let tx_mask = self.tx_mask.ok_or(TiCfgError::Missing("channelCfg"))?;
        if self.profiles.is_empty() {
            return Err(TiCfgError::Missing("profileCfg"));
        }
        let frame = self.frame.as_ref().ok_or(TiCfgError::Missing("frameCfg"))?;
        if frame.last < frame.first {
            return Err(frame.name.error("the last chirp comes before the first"));
        }

        // The chirps the frame really uses, not all that are defined, are the TDM slots.
        let mut slots = Vec::new();
        let mut common: Option<&Chirp> = None;
        for index in frame.first..=frame.last {
            let chirp = self.chirps.get(&index).ok_or_else(|| {
                frame
                    .name
                    .error(format!("chirp {index} is used, but no chirpCfg defines it"))
            })?;
            if chirp.tx_mask.count_ones() != 1 {
                let problem = "one transmitter at a time (mask 1, 2 or 4) is supported";
                return Err(chirp.mask_word.error(problem));
            }
            if chirp.tx_mask & tx_mask == 0 {
                let problem = format!("channelCfg enables only transmitter mask {tx_mask}");
                return Err(chirp.mask_word.error(problem));
            }
            if let Some(other) = common
                && (other.profile != chirp.profile || other.variation != chirp.variation)
            {
                let problem =
                    format!("chirp {index} differs from the others in more than its transmitter");
                return Err(chirp.mask_word.error(problem));
            }
            common = Some(chirp);
            slots.push(chirp.tx_mask.trailing_zeros() as u8 + 1);
        }
        let chirp = common.ok_or(TiCfgError::Missing("chirpCfg"))?;
        let profile = self.profiles.get(&chirp.profile).ok_or_else(|| {
            chirp
                .mask_word
                .error(format!("profile {} is not defined", chirp.profile))
        })?;

        let (board, board_guessed) = self.board(board, profile.start_hz, tx_mask)?;
        let figures = board.figures();
        let mut tx = Vec::with_capacity(slots.len());
        for slot in &slots {
            let place = figures.tx.get(usize::from(*slot) - 1).ok_or_else(|| {
                chirp
                    .mask_word
                    .error(format!("the {} has no TX{slot}", board.name()))
            })?;
            tx.push(*place);
        }
        let receivers: Vec<u8> = (1..=4).filter(|r| rx_mask >> (r - 1) & 1 == 1).collect();
        let rx = receivers
            .iter()
            .map(|r| figures.rx[usize::from(*r) - 1])
            .collect();
        let first_tx = u32::from(slots[0]) - 1;
        let backoff_db = f64::from(profile.backoff_code >> (8 * first_tx) & 0xff);
        let radar = RadarConfig {
            name: board.name().into(),
            start_hz: profile.start_hz + chirp.variation[0],
            slope_hz_per_s: profile.slope_hz_per_s + chirp.variation[1],
            idle_s: profile.idle_s + chirp.variation[2],
            adc_start_s: profile.adc_start_s + chirp.variation[3],
            ramp_end_s: profile.ramp_end_s,
            n_samples: profile.n_samples,
            sample_rate_hz: profile.sample_rate_hz,
            n_loops: frame.n_loops as usize,
            frame_period_s: frame.period_s,
            tx,
            rx,
            tx_power_dbm: figures.tx_power_dbm - backoff_db,
            antenna_gain_dbi: figures.antenna_gain_dbi,
            azimuth_half_width_rad: figures.azimuth_half_width_rad,
            elevation_half_width_rad: figures.elevation_half_width_rad,
            noise_figure_db: figures.noise_figure_db,
        };
        radar.validate()?;
        Ok(TiCfg {
            radar,
            board,
            board_guessed,
            slots,
            receivers,
            n_frames: frame.n_frames,
            q_first: self.q_first,
            firmware_clutter_removal: self.clutter,
            lvds_samples: self.lvds,
            calibration: self.calibration,
            phase_rotation: self.phase_rotation,
            unused: self.unused,
        })
    }

    fn board(
        &self,
        stated: Option<Board>,
        start_hz: f64,
        tx_mask: u32,
    ) -> Result<(Board, bool), TiCfgError> {
        if let Some(board) = stated {
            return Ok((board, false));
        }
        if let [Some((word, columns)), Some((_, rows))] = &self.geometry {
            let boards = [Board::Xwr6843Isk, Board::Xwr6843IskOds, Board::Xwr6843Aop];
            return match boards.into_iter().find(|b| has_geometry(*b, columns, rows)) {
                Some(board) => Ok((board, false)),
                None => Err(word.error("this antenna geometry is of no known board")),
            };
        }
        let is_60_ghz = start_hz < 70e9;
        if let Some(board) = self.platform
            && board.is_60_ghz() == is_60_ghz
        {
            // `xWR68xx` stands for three antenna layouts, so even this is a guess there.
            return Ok((board, is_60_ghz));
        }
        let guess = match (is_60_ghz, tx_mask) {
            (true, _) => Board::Xwr6843Isk,
            (false, 3) => Board::Xwr1642Boost,
            (false, _) => Board::Xwr1843Boost,
        };
        Ok((guess, true))
    }
}

/// Whether `antGeometry` lines (columns and rows, both counted downwards from 0) are the board's.
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
    // Half a wavelength at 62 GHz is 2.4 mm; a tenth of it separates any two layouts.
    let half_m = 0.5 * radarllm_base::SPEED_OF_LIGHT_MPS / 62e9;
    (0..all.len()).all(|i| {
        let x = ((columns[0] - columns[i]) * half_m).abs() - (all[i].0 - all[0].0).abs();
        let z = (rows[i] - rows[0]) * half_m - (all[i].1 - all[0].1);
        x.abs() < 0.1 * half_m && z.abs() < 0.1 * half_m
    })
}

/// The board of a comment like ` Platform:xWR18xx`.
fn platform_board(comment: &str) -> Option<Board> {
    let (_, value) = comment.split_once("Platform:")?;
    let value = value.trim().to_ascii_lowercase();
    match value.get(..7)? {
        "xwr14xx" => Some(Board::Xwr1443Boost),
        "xwr16xx" => Some(Board::Xwr1642Boost),
        "xwr18xx" => Some(Board::Xwr1843Boost),
        "xwr68xx" => Some(Board::Xwr6843Isk),
        _ => None,
    }
}

fn number_list(command: &Command) -> Result<(Word, Vec<f64>), TiCfgError> {
    let values: Result<Vec<f64>, _> = command
        .args
        .iter()
        .map(|w| w.number("each value"))
        .collect();
    Ok((command.name.clone(), values?))
}

/// Words separated by white space, with columns counted in characters from 1.
fn split_words(line: usize, code: &str) -> Vec<Word> {
    let mut words: Vec<Word> = Vec::new();
    let mut open = false;
    for (i, c) in code.chars().enumerate() {
        // Byte order marks come from Windows editors.
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
