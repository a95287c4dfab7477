//! Radar descriptions: a built-in name or a file, opened once.

use std::{
    fs::File,
    io::Read,
    path::{Path, PathBuf},
};

use radarllm_base::RadarConfig;
use radarllm_formats::{
    Board, BoardEvidence, PointRadar, TiCfg, TiCfgError,
    adc::{SampleLayout, StudioCapture, StudioSetup},
    builtin::{NameError, find_builtin},
    radar_from_toml,
};

use crate::error::{Error, ErrorKind, Result};

/// Maximum size of a radar description, bytes.
const MAX_RADAR_FILE_BYTES: u64 = 1 << 20;

/// A radar description that was opened once: what points need, the cube if there is one, its text, and its statements
/// about captures.
///
/// A chirp configuration need not describe a cube. Points are read with it all the same ([`OpenedRadar::points`]);
/// simulation and raw samples say why they cannot be ([`OpenedRadar::config`], [`OpenedRadar::sample_config`]).
///
/// ```
/// let radar = radarllm_io::open_radar("awr1843boost")?;
/// let config = radar.config()?;
/// assert_eq!((config.rx.len(), radar.points.frame_rate_hz()), (4, 10.0));
/// assert!((config.range_resolution_m() - 0.04293).abs() < 1e-5);
/// # Ok::<(), radarllm_io::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct OpenedRadar {
    /// What recorded points need, with the mounting that a chirp configuration states.
    pub points: PointRadar,
    /// Source of the description.
    pub source: RadarSource,
    /// Statements of the description about the layout of raw samples.
    pub hints: LayoutHints,
    /// How the board of a chirp configuration was found, if it has one.
    pub board_evidence: Option<BoardEvidence>,
    cube: Cube,
}

/// The cube of a radar.
#[derive(Clone, Debug)]
enum Cube {
    /// Recorded samples have the shape of this radar.
    Recorded(Box<RadarConfig>),
    /// Recorded samples have another shape; this radar has the same bins.
    Simulated(Box<RadarConfig>, NoCube),
    /// The description determines none.
    Unknown(NoCube),
}

/// Why a chirp configuration has no cube.
#[derive(Clone, Debug)]
struct NoCube {
    path: PathBuf,
    /// Not empty.
    reasons: Vec<TiCfgError>,
}

impl NoCube {
    fn error(&self) -> Error {
        match self.reasons.first() {
            Some(reason) => unusable(&self.path, reason.clone()),
            None => malformed(&self.path, "it describes no cube"),
        }
    }
}

impl OpenedRadar {
    fn new(config: RadarConfig, source: RadarSource, hints: LayoutHints) -> Self {
        Self {
            points: PointRadar::from(&config),
            source,
            hints,
            board_evidence: None,
            cube: Cube::Recorded(config.into()),
        }
    }

    /// The radar to simulate. That of an xWRL6432, whose recorded samples are real, has complex samples with the same
    /// bins.
    ///
    /// # Errors
    /// Why the chirp configuration describes no cube.
    pub fn config(&self) -> Result<&RadarConfig> {
        match &self.cube {
            Cube::Recorded(config) | Cube::Simulated(config, _) => Ok(config),
            Cube::Unknown(no_cube) => Err(no_cube.error()),
        }
    }

    /// As [`Self::config`], by value.
    ///
    /// # Errors
    /// As [`Self::config`].
    pub fn into_config(self) -> Result<RadarConfig> {
        match self.cube {
            Cube::Recorded(config) | Cube::Simulated(config, _) => Ok(*config),
            Cube::Unknown(no_cube) => Err(no_cube.error()),
        }
    }

    /// The radar whose recorded samples are processed.
    ///
    /// # Errors
    /// Why samples recorded with the chirp configuration cannot be read.
    pub fn sample_config(&self) -> Result<&RadarConfig> {
        match &self.cube {
            Cube::Recorded(config) => Ok(config),
            Cube::Simulated(_, no_cube) | Cube::Unknown(no_cube) => Err(no_cube.error()),
        }
    }

    /// Why recorded samples cannot be read; empty if they can.
    pub fn reasons(&self) -> &[TiCfgError] {
        match &self.cube {
            Cube::Recorded(_) => &[],
            Cube::Simulated(_, no_cube) | Cube::Unknown(no_cube) => &no_cube.reasons,
        }
    }
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

/// Parses the text of a chirp configuration, which may be stored inside a recording. Errors contain `path`, and the name
/// of the file may name the board.
///
/// # Errors
/// A text that gives neither a cube nor a frame rate.
pub fn open_radar_text(path: &Path, text: &str) -> Result<OpenedRadar> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let reading = TiCfg::read_named(&name, text);
    let source = RadarSource::TiCfg(text.into());
    if let Some(cfg) = reading.cfg {
        cfg.radar.validate().map_err(|e| unusable(path, e))?;
        let hints = LayoutHints {
            layout: None,
            receivers: Some(cfg.receivers),
            q_first: cfg.q_first,
        };
        let mut opened = OpenedRadar::new(cfg.radar, source, hints);
        opened.board_evidence = Some(cfg.board_evidence);
        opened.points = reading.points.unwrap_or(opened.points);
        return Ok(opened);
    }
    let no_cube = NoCube {
        path: path.into(),
        reasons: reading.errors,
    };
    let Some(points) = reading.points else {
        // A mistake explains more than a reason why there is no cube.
        let mistake = no_cube.reasons.iter().find(|e| !e.is_unsupported());
        return Err(match mistake {
            Some(mistake) => unusable(path, mistake.clone()),
            None => no_cube.error(),
        });
    };
    Ok(OpenedRadar {
        points,
        source,
        hints: LayoutHints::default(),
        board_evidence: reading.board_evidence,
        cube: match reading.equivalent {
            Some(radar) => Cube::Simulated(radar.into(), no_cube),
            None => Cube::Unknown(no_cube),
        },
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
/// An unknown name, a file that is unreadable, too large or malformed, or a radar that is physically impossible. A chirp
/// configuration without a cube is opened; [`OpenedRadar::config`] says why it has none.
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
            let hints = LayoutHints::default();
            return Ok(OpenedRadar::new(*config, RadarSource::BuiltIn, hints));
        }
        RadarText::TiCfg(text) => return open_radar_text(&path, &text),
        RadarText::Toml(text) => {
            let config = radar_from_toml(&text).map_err(|e| unusable(&path, e))?;
            OpenedRadar::new(config, RadarSource::Toml(text), LayoutHints::default())
        }
        RadarText::Studio { text, board } => {
            let capture = StudioCapture::parse(&text, board).map_err(|e| unusable(&path, e))?;
            let hints = LayoutHints {
                layout: capture.layout,
                ..LayoutHints::default()
            };
            OpenedRadar::new(capture.radar, RadarSource::Studio, hints)
        }
    };
    let config = opened.config()?;
    config.validate().map_err(|e| unusable(&path, e))?;
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
