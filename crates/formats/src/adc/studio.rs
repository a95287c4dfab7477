//! Exports of mmWave Studio beside a capture: `*.mmwave.json` (chirps and data format of the device) and `*.setup.json`
//! (device and file names).
//!
//! The export has the content of a chirp file in another form. It is therefore converted to one and parsed by
//! [`TiCfg`]; errors name their position in the JSON. Field names are those of TI's mmWaveLink (`rlProfileCfg_t`, ...).
//! Numbers may be written as hexadecimal text.

use radarllm_base::RadarConfig;
use serde_json::Value;

use super::{IqOrder, LvdsLanes, SampleKind, SampleLayout};
use crate::{
    boards::Board,
    ti_cfg::{TiCfg, TiCfgError},
};

/// Maximum length of a list. A device has 4 profiles and 512 chirps.
const MAX_LIST: usize = 512;
/// Maximum number of files of a setup.
const MAX_FILES: usize = 1024;

/// An error in an export.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{path}: {problem}")]
pub struct StudioError {
    /// Position in the document, such as `mmWaveDevices[0].rfConfig.rlFrameCfg_t.numLoops`.
    pub path: String,
    /// What is wrong.
    pub problem: String,
}

fn error(path: impl Into<String>, problem: impl Into<String>) -> StudioError {
    StudioError {
        path: path.into(),
        problem: problem.into(),
    }
}

/// Content of `*.mmwave.json`.
#[derive(Clone, Debug, PartialEq)]
pub struct StudioCapture {
    /// The radar; `tx` in firing order.
    pub radar: RadarConfig,
    /// The board whose antennas were assumed.
    pub board: Board,
    /// Whether the board is a guess.
    pub board_guessed: bool,
    /// Storage format of the samples, if the export has a `rawDataCaptureConfig`.
    pub layout: Option<SampleLayout>,
    /// Bits of the ADC.
    pub adc_bits: u32,
    /// Number of frames to send; 0 means until stopped.
    pub n_frames: u32,
}

/// A value with its position.
#[derive(Clone)]
struct Node<'a> {
    value: &'a Value,
    path: String,
}

impl<'a> Node<'a> {
    fn get(&self, name: &str) -> Result<Node<'a>, StudioError> {
        self.find(name)
            .ok_or_else(|| error(&self.path, format!("`{name}` is missing")))
    }

    fn find(&self, name: &str) -> Option<Node<'a>> {
        let value = self.value.get(name).filter(|v| !v.is_null())?;
        let dot = if self.path.is_empty() { "" } else { "." };
        Some(Node {
            value,
            path: format!("{}{dot}{name}", self.path),
        })
    }

    /// The entries of a list.
    fn list(&self, name: &str, max: usize) -> Result<Vec<Node<'a>>, StudioError> {
        let list = self.get(name)?;
        let values = list
            .value
            .as_array()
            .ok_or_else(|| error(&list.path, "must be a list"))?;
        if values.is_empty() || values.len() > max {
            let problem = format!("must have 1 to {max} entries, found {}", values.len());
            return Err(error(&list.path, problem));
        }
        Ok(values
            .iter()
            .enumerate()
            .map(|(i, value)| Node {
                value,
                path: format!("{}[{i}]", list.path),
            })
            .collect())
    }

    fn number(&self, name: &str) -> Result<f64, StudioError> {
        let node = self.get(name)?;
        node.as_number()
            .ok_or_else(|| error(&node.path, "must be a number"))
    }

    fn as_number(&self) -> Option<f64> {
        let number = match self.value {
            Value::Number(n) => n.as_f64(),
            Value::String(s) => match s.trim().strip_prefix("0x") {
                Some(digits) => u32::from_str_radix(digits, 16).ok().map(f64::from),
                None => s.trim().parse().ok(),
            },
            _ => None,
        };
        number.filter(|n| n.is_finite())
    }

    fn text(&self, name: &str) -> Option<String> {
        Some(self.find(name)?.value.as_str()?.to_string())
    }
}

/// Lines of a chirp file, each with its position in the export.
#[derive(Default)]
struct Lines {
    text: String,
    paths: Vec<String>,
}

impl Lines {
    fn push(&mut self, node: &Node, command: &str, arguments: &[f64]) {
        self.text += command;
        for argument in arguments {
            self.text += &format!(" {argument}");
        }
        self.text.push('\n');
        self.paths.push(node.path.clone());
    }
}

impl StudioCapture {
    /// Reads `*.mmwave.json`. `board` names the board, as [`StudioSetup`] may; otherwise it is guessed as
    /// for chirp files.
    ///
    /// # Errors
    /// [`StudioError`] for input that cannot be read or that a [`RadarConfig`] cannot express: several devices,
    /// waveforms other than frames of chirps, phase modulation, packets that contain more than samples.
    pub fn parse(text: &str, board: Option<Board>) -> Result<Self, StudioError> {
        let document: Value =
            serde_json::from_str(text).map_err(|e| error("document", e.to_string()))?;
        let root = Node {
            value: &document,
            path: String::new(),
        };
        let mut devices = root.list("mmWaveDevices", 16)?;
        if devices.len() > 1 {
            return Err(error("mmWaveDevices", "cascaded devices are not supported"));
        }
        let device = devices.remove(0);
        let rf = device.get("rfConfig")?;
        if let Some(waveform) = rf.find("waveformType")
            && waveform.value.as_str() != Some("legacyFrameChirp")
        {
            let problem = "only `legacyFrameChirp` (frames of chirps) has a cube";
            return Err(error(waveform.path, problem));
        }
        if let Some(bpm) = rf.find("rlBpmChirps")
            && bpm.value.as_array().is_none_or(|list| !list.is_empty())
        {
            return Err(error(bpm.path, "phase-modulated chirps are not supported"));
        }
        let mut lines = Lines::default();
        let channels = rf.get("rlChanCfg_t")?;
        let receivers = channels.number("rxChannelEn")?;
        let cascading = channels.find("cascading").and_then(|n| n.as_number());
        lines.push(
            &channels,
            "channelCfg",
            &[
                receivers,
                channels.number("txChannelEn")?,
                cascading.unwrap_or(0.0),
            ],
        );
        let adc = rf.get("rlAdcOutCfg_t")?.get("fmt")?;
        let (bits, output) = (adc.number("b2AdcBits")?, adc.number("b2AdcOutFmt")?);
        // Values 1 and 2 are complex, 0 and 3 are real. Real samples are converted to the analytic signal, so the
        // chirps are those of a complex capture.
        let is_real = output == 0.0 || output == 3.0;
        lines.push(&adc, "adcCfg", &[bits, if is_real { 1.0 } else { output }]);
        for entry in rf.list("rlProfiles", MAX_LIST)? {
            push_profile(&mut lines, &entry.get("rlProfileCfg_t")?)?;
        }
        for entry in rf.list("rlChirps", MAX_LIST)? {
            push_chirp(&mut lines, &entry.get("rlChirpCfg_t")?)?;
        }
        let frame = rf.get("rlFrameCfg_t")?;
        let mut arguments = Vec::new();
        for name in [
            "chirpStartIdx",
            "chirpEndIdx",
            "numLoops",
            "numFrames",
            "framePeriodicity_msec",
        ] {
            arguments.push(frame.number(name)?);
        }
        lines.push(&frame, "frameCfg", &arguments);

        let cfg = TiCfg::parse(&lines.text, board).map_err(|e| match e {
            TiCfgError::Line {
                line,
                text,
                problem,
                ..
            } => {
                let path = lines.paths.get(line.saturating_sub(1));
                error(
                    path.map_or("rfConfig", String::as_str),
                    format!("`{text}`: {problem}"),
                )
            }
            other => error(&rf.path, other.to_string()),
        })?;
        let layout = match device.find("rawDataCaptureConfig") {
            Some(capture) => Some(read_layout(&capture, receivers as u8, is_real)?),
            None => None,
        };
        Ok(Self {
            radar: cfg.radar,
            board: cfg.board,
            board_guessed: cfg.board_evidence.is_guess(),
            layout,
            adc_bits: [12, 14, 16][(bits as usize).min(2)],
            n_frames: cfg.n_frames,
        })
    }
}

fn push_profile(lines: &mut Lines, profile: &Node) -> Result<(), StudioError> {
    let backoff = profile.find("txOutPowerBackoffCode");
    let arguments = [
        profile.number("profileId")?,
        profile.number("startFreqConst_GHz")?,
        profile.number("idleTimeConst_usec")?,
        profile.number("adcStartTimeConst_usec")?,
        profile.number("rampEndTime_usec")?,
        backoff.and_then(|n| n.as_number()).unwrap_or(0.0),
        0.0,
        profile.number("freqSlopeConst_MHz_usec")?,
        0.0,
        profile.number("numAdcSamples")?,
        profile.number("digOutSampleRate")?,
    ];
    lines.push(profile, "profileCfg", &arguments);
    Ok(())
}

fn push_chirp(lines: &mut Lines, chirp: &Node) -> Result<(), StudioError> {
    let variation = |name: &str| match chirp.find(name) {
        Some(_) => chirp.number(name),
        None => Ok(0.0),
    };
    let arguments = [
        chirp.number("chirpStartIdx")?,
        chirp.number("chirpEndIdx")?,
        chirp.number("profileId")?,
        variation("startFreqVar_MHz")? * 1e6,
        variation("freqSlopeVar_KHz_usec")?,
        variation("idleTimeVar_usec")?,
        variation("adcStartTimeVar_usec")?,
        chirp.number("txEnable")?,
    ];
    lines.push(chirp, "chirpCfg", &arguments);
    Ok(())
}

/// Reads the lanes and the order of I and Q, and checks that packets contain only samples.
fn read_layout(capture: &Node, receivers: u8, is_real: bool) -> Result<SampleLayout, StudioError> {
    if let Some(path) = capture.find("rlDevDataPathCfg_t")
        && let Some(content) = path.find("transferFmtPkt0")
        && content.as_number() != Some(1.0)
    {
        return Err(error(content.path, "only 0x1 (samples alone) is supported"));
    }
    let format = capture.get("rlDevDataFmtCfg_t")?;
    let enabled = capture.get("rlDevLaneEnable_t")?;
    let mask = enabled.number("laneEn")?;
    let interleave = format.number("chInterleave")?;
    let lanes = match (mask as u64, interleave) {
        (0xf, 0.0) => LvdsLanes::Four { receivers },
        (0x3, 1.0) => LvdsLanes::Two,
        _ => {
            let problem = format!(
                "lanes {mask:.0} with chInterleave {interleave:.0}: only 15 with 0 (xWR12xx, 14xx) and 3 with 1 \
                 (xWR16xx, 18xx, 68xx) are known"
            );
            return Err(error(&enabled.path, problem));
        }
    };
    let data = match (is_real, format.number("iqSwapSel")?) {
        (true, _) => SampleKind::Real,
        (false, 0.0) => SampleKind::Complex {
            order: IqOrder::IFirst,
        },
        (false, 1.0) => SampleKind::Complex {
            order: IqOrder::QFirst,
        },
        (false, other) => {
            let problem = format!("iqSwapSel must be 0 (I first) or 1 (Q first), found {other}");
            return Err(error(&format.path, problem));
        }
    };
    Ok(SampleLayout { lanes, data })
}

/// Content of `*.setup.json`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct StudioSetup {
    /// Device as written, such as `awr1843`.
    pub device: Option<String>,
    /// Its evaluation board, if known. ODS and AOP variants cannot be distinguished: a 6843 is taken as the ISK.
    pub board: Option<Board>,
    /// File name of the `*.mmwave.json`, without the folders of the recording machine.
    pub config: Option<String>,
    /// File names of the captures after mmWave Studio's own reordering, without folders.
    pub processed: Vec<String>,
    /// File names of the captures as recorded.
    pub raw: Vec<String>,
}

impl StudioSetup {
    /// Reads `*.setup.json`.
    ///
    /// # Errors
    /// [`StudioError`] for input that is not JSON or not a setup, and for a capture in a mode other than raw.
    pub fn parse(text: &str) -> Result<Self, StudioError> {
        let document: Value =
            serde_json::from_str(text).map_err(|e| error("document", e.to_string()))?;
        let root = Node {
            value: &document,
            path: String::new(),
        };
        if root.find("mmWaveDevice").is_none() && root.find("capturedFiles").is_none() {
            let problem = "neither `mmWaveDevice` nor `capturedFiles`: no setup of mmWave Studio";
            return Err(error("document", problem));
        }
        if let Some(mode) = root
            .find("DCA1000Config")
            .and_then(|c| c.find("dataLoggingMode"))
            && mode.value.as_str() != Some("raw")
        {
            return Err(error(mode.path, "only `raw` is supported"));
        }
        let mut setup = Self {
            device: root.text("mmWaveDevice"),
            config: root.text("configUsed").map(|path| file_name(&path)),
            ..Self::default()
        };
        setup.board = setup.device.as_deref().and_then(board_of);
        if let Some(captured) = root.find("capturedFiles")
            && captured.find("files").is_some()
        {
            for file in captured.list("files", MAX_FILES)? {
                setup
                    .processed
                    .extend(file.text("processedFileName").map(|n| file_name(&n)));
                setup
                    .raw
                    .extend(file.text("rawFileName").map(|n| file_name(&n)));
            }
        }
        Ok(setup)
    }
}

/// The last component of a path of any operating system.
fn file_name(path: &str) -> String {
    path.rsplit(['/', '\\']).next().unwrap_or_default().into()
}

fn board_of(device: &str) -> Option<Board> {
    let device = device.to_ascii_lowercase();
    let boards = [
        ("6843aop", Board::Xwr6843Aop),
        ("6843ods", Board::Xwr6843IskOds),
        ("6843", Board::Xwr6843Isk),
        ("6443", Board::Xwr6843Isk),
        ("1843", Board::Xwr1843Boost),
        ("1642", Board::Xwr1642Boost),
        ("1443", Board::Xwr1443Boost),
        ("1243", Board::Xwr1443Boost),
    ];
    boards
        .into_iter()
        .find(|(name, _)| device.contains(name))
        .map(|(_, board)| board)
}
