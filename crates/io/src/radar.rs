//! Radar descriptions: a built-in name or a file, opened once.

use std::{fs::File, io::Read, path::Path};

use radarllm_base::RadarConfig;
use radarllm_formats::{
    Board, SensorPosition, TiCfg,
    adc::{SampleLayout, StudioCapture, StudioSetup},
    builtin::{NameError, find_builtin},
    radar_from_toml,
};

use crate::error::{Error, ErrorKind, Result};

/// Maximum size of a radar description, bytes.
const MAX_RADAR_FILE_BYTES: u64 = 1 << 20;

/// A radar description that was opened once: the radar, its text, and its statements about captures.
///
/// ```
/// let radar = radarllm_io::open_radar("awr1843boost")?;
/// assert_eq!(radar.config.rx.len(), 4);
/// assert!((radar.config.range_resolution_m() - 0.04293).abs() < 1e-5);
/// # Ok::<(), radarllm_io::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct OpenedRadar {
    /// The radar.
    pub config: RadarConfig,
    /// Source of the description.
    pub source: RadarSource,
    /// Statements of the description about the layout of raw samples.
    pub hints: LayoutHints,
    /// Height and angles of the sensor, if a chirp configuration states them.
    pub position: Option<SensorPosition>,
}

/// Source of a radar description, with the text of a file.
#[derive(Clone, Debug, PartialEq)]
pub enum RadarSource {
    /// A built-in radar.
    BuiltIn,
    /// A chirp configuration for TI's command-line interface.
    TiCfg(String),
    /// A radar file in this project's format.
    Toml(String),
    /// An export of mmWave Studio.
    Studio,
}

/// Statements of a radar description about the layout of raw samples.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LayoutHints {
    /// The complete layout, from an export of mmWave Studio.
    pub layout: Option<SampleLayout>,
    /// Enabled receivers, counted from 1, from a chirp configuration.
    pub receivers: Option<Vec<u8>>,
    /// `SampleSwap` of a chirp configuration: whether SDK firmware writes Q first. mmWave Studio ignores it.
    pub q_first: Option<bool>,
}

/// Parses the text of a chirp configuration, which may be stored inside a recording. Errors contain `path`.
///
/// # Errors
/// A text that is malformed, or a radar that is physically impossible.
pub fn open_radar_text(path: &Path, text: &str) -> Result<OpenedRadar> {
    let cfg = TiCfg::parse(text, None).map_err(|e| unusable(path, e))?;
    cfg.radar.validate().map_err(|e| unusable(path, e))?;
    Ok(OpenedRadar {
        config: cfg.radar,
        hints: LayoutHints {
            layout: None,
            receivers: Some(cfg.receivers),
            q_first: cfg.q_first,
        },
        position: SensorPosition::from_ti_cfg(text).map_err(|e| unusable(path, e))?,
        source: RadarSource::TiCfg(text.into()),
    })
}

/// The text of a radar description that was found but not yet read.
enum RadarText {
    BuiltIn(Box<RadarConfig>),
    TiCfg(String),
    Toml(String),
    Studio { text: String, board: Option<Board> },
}

/// Opens a radar: a built-in name, which may be abbreviated if it is unambiguous, or a `.cfg` (TI), `.toml` (this
/// project) or `.json` (mmWave Studio) file.
///
/// # Errors
/// An unknown name, a file that is unreadable, too large or malformed, or a radar that is physically impossible.
pub fn open_radar(name_or_file: &str) -> Result<OpenedRadar> {
    open_radar_in(name_or_file, Path::new(""))
}

/// Like [`open_radar`], with file names relative to `base`.
///
/// # Errors
/// Those of [`open_radar`].
pub fn open_radar_in(name_or_file: &str, base: &Path) -> Result<OpenedRadar> {
    let path = base.join(name_or_file);
    let opened = match read_text(name_or_file, base)? {
        RadarText::BuiltIn(config) => {
            return Ok(OpenedRadar {
                config: *config,
                source: RadarSource::BuiltIn,
                hints: LayoutHints::default(),
                position: None,
            });
        }
        RadarText::TiCfg(text) => return open_radar_text(&path, &text),
        RadarText::Toml(text) => OpenedRadar {
            config: radar_from_toml(&text).map_err(|e| unusable(&path, e))?,
            source: RadarSource::Toml(text),
            hints: LayoutHints::default(),
            position: None,
        },
        RadarText::Studio { text, board } => {
            let capture = StudioCapture::parse(&text, board).map_err(|e| unusable(&path, e))?;
            OpenedRadar {
                config: capture.radar,
                source: RadarSource::Studio,
                hints: LayoutHints {
                    layout: capture.layout,
                    ..LayoutHints::default()
                },
                position: None,
            }
        }
    };
    opened.config.validate().map_err(|e| unusable(&path, e))?;
    Ok(opened)
}

/// Returns the text of a radar file, for tools that check it line by line; `None` for built-in radars and for exports
/// of mmWave Studio, which are not edited by hand. A malformed text is returned too.
///
/// # Errors
/// An unknown name, or a file that is unreadable, too large or not text.
pub fn read_radar_text(name_or_file: &str) -> Result<Option<RadarSource>> {
    Ok(match read_text(name_or_file, Path::new(""))? {
        RadarText::TiCfg(text) => Some(RadarSource::TiCfg(text)),
        RadarText::Toml(text) => Some(RadarSource::Toml(text)),
        RadarText::BuiltIn(_) | RadarText::Studio { .. } => None,
    })
}

fn malformed(path: &Path, problem: &str) -> Error {
    Error {
        path: Some(path.into()),
        ..Error::input(format!("radar: {}: {problem}", path.display()))
    }
}

fn unusable(path: &Path, error: impl std::error::Error + Send + Sync + 'static) -> Error {
    malformed(path, &error.to_string()).caused_by(error)
}

fn read_text(name: &str, base: &Path) -> Result<RadarText> {
    match find_builtin(name) {
        Ok(radar) => return Ok(RadarText::BuiltIn(radar.into())),
        Err(error @ NameError::Ambiguous(_)) => {
            return Err(Error::input(format!("radar: {error}"))
                .caused_by(error)
                .of_kind(ErrorKind::NotFound));
        }
        // The name may be that of a file.
        Err(_) => {}
    }
    let path = base.join(name);
    let extension = path
        .extension()
        .and_then(|e| e.to_str())
        .unwrap_or_default()
        .to_ascii_lowercase();
    if !["cfg", "toml", "json"].contains(&extension.as_str()) {
        return Err(Error::input(format!(
            "radar: `{name}` is neither a built-in radar nor a .cfg, .toml or .json file"
        ))
        .of_kind(ErrorKind::NotFound));
    }
    let text = read_file(&path)?;
    Ok(match extension.as_str() {
        "cfg" => RadarText::TiCfg(text),
        "json" => match StudioSetup::parse(&text) {
            // A setup file names the device and the file beside it that contains the chirps.
            Ok(setup) => {
                let config = setup
                    .config
                    .ok_or_else(|| malformed(&path, "configUsed, the *.mmwave.json, is missing"))?;
                RadarText::Studio {
                    text: read_file(&path.with_file_name(config))?,
                    board: setup.board,
                }
            }
            Err(_) => RadarText::Studio { text, board: None },
        },
        _ => RadarText::Toml(text),
    })
}

fn read_file(path: &Path) -> Result<String> {
    let fail = |e: std::io::Error| unusable(path, e);
    let file = File::open(path).map_err(fail)?;
    let mut text = String::new();
    file.take(MAX_RADAR_FILE_BYTES + 1)
        .read_to_string(&mut text)
        .map_err(fail)?;
    if text.len() as u64 > MAX_RADAR_FILE_BYTES {
        let problem = format!("more than the {MAX_RADAR_FILE_BYTES} bytes accepted");
        return Err(malformed(path, &problem));
    }
    Ok(text)
}
