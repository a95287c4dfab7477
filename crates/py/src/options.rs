//! Options that several functions share.

use std::path::{Path, PathBuf};

use pyo3::prelude::*;
use radarllm::{
    CaptureFormat, CaptureOptions, CleaningOptions, DEFAULT_RADAR, Error, IqChoice, LayoutOptions,
    OpenedRadar, PointOptions, Result,
    io::CellOptions,
    open_radar,
    synth::{objects::ObjectsFile, processing::ProcessingFile},
};
use radarllm_files::bounded::{self, MAX_CONFIG_BYTES};
use radarllm_formats::{Mounting, recordings::Axes, uart::Dialect};

use crate::{errors, radar::RadarArgument};

/// The radar of an argument, or the one that simulates where none is named.
pub(crate) fn radar_or_default(radar: Option<RadarArgument>) -> PyResult<OpenedRadar> {
    match radar {
        Some(RadarArgument(radar)) => Ok(radar),
        None => open_radar(DEFAULT_RADAR).map_err(errors::to_py),
    }
}

/// Refuses a number out of range.
pub(crate) fn check_range(
    name: &str,
    value: usize,
    range: std::ops::RangeInclusive<usize>,
) -> Result {
    match range.contains(&value) {
        true => Ok(()),
        false => Err(Error::input(format!(
            "`{name}` {value}: must be {} to {}",
            range.start(),
            range.end()
        ))),
    }
}

/// The `[processing]` table of a file.
pub(crate) fn processing(path: &Path) -> Result<ProcessingFile> {
    let text = bounded::read_text(path, MAX_CONFIG_BYTES)?;
    ProcessingFile::from_toml(&text).map_err(|e| {
        Error::wrap_in_file(path, e)
            .with_hint("docs/reference/scenes.md lists the fields of [processing]")
    })
}

/// What stands still around a simulated target: "none", "furnished", or a file with a table `[objects]`.
pub(crate) fn objects(name_or_file: &Path) -> Result<ObjectsFile> {
    match name_or_file.to_str() {
        Some("none") => return Ok(ObjectsFile::none()),
        Some("furnished") => return Ok(ObjectsFile::furnished()),
        _ => {}
    }
    let text = bounded::read_text(name_or_file, MAX_CONFIG_BYTES)?;
    ObjectsFile::from_toml(&text).map_err(|e| {
        Error::wrap_in_file(name_or_file, e)
            .with_hint("docs/guides/dataset.md lists the fields of [objects]")
    })
}

/// The keywords of `open_capture`.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct CaptureKeywords {
    radar: Option<RadarArgument>,
    format: Option<String>,
    iq: Option<String>,
    lanes: Option<u8>,
    real: bool,
    axes: Option<String>,
    frame_rate_hz: Option<f64>,
    orientation: Option<String>,
    dialect: Option<String>,
    topic: Option<String>,
    run: Option<usize>,
    columns: Option<String>,
    baud: u32,
    seconds: Option<f64>,
    tilt_deg: f64,
    yaw_deg: f64,
    roll_deg: f64,
    min_speed_mps: Option<f32>,
    accumulate: usize,
    motion_compensate: bool,
    background: Option<PathBuf>,
    background_cell_m: Option<f64>,
    background_velocity_mps: Option<f64>,
    background_share: Option<f64>,
    calibration: Option<PathBuf>,
    remove_offset: bool,
    remove_leakage_m: Option<f64>,
    max_frames: Option<usize>,
    radar_height_m: Option<f32>,
}

impl CaptureKeywords {
    /// As the library takes them.
    pub(crate) fn options(self) -> Result<CaptureOptions> {
        let iq = self.iq.as_deref().map(|name| match name {
            "i-first" => Ok(IqChoice::IFirst),
            "q-first" => Ok(IqChoice::QFirst),
            "auto" => Ok(IqChoice::Auto),
            other => Err(unknown("iq", other, "i-first, q-first or auto")),
        });
        let orientation = self.orientation.as_deref().map(|name| {
            Axes::from_name(name)
                .ok_or_else(|| unknown("orientation", name, Axes::ALL.map(Axes::name).join(" or ")))
        });
        let dialect = self.dialect.as_deref().map(|name| {
            Dialect::from_name(name)
                .ok_or_else(|| unknown("dialect", name, Dialect::ALL.map(Dialect::name).join(", ")))
        });
        let format = self.format.as_deref().map(CaptureFormat::from_name);
        if let Some(lanes) = self.lanes
            && !(2..=4).contains(&lanes)
        {
            return Err(unknown("lanes", &lanes.to_string(), "2 or 4"));
        }
        Ok(CaptureOptions {
            radar: self.radar.map(|RadarArgument(radar)| radar),
            format: format.transpose()?,
            layout: LayoutOptions {
                iq: iq.transpose()?,
                lanes: self.lanes,
                real: self.real,
                axes: self.axes,
            },
            points: PointOptions {
                frame_rate_hz: self.frame_rate_hz,
                orientation: orientation.transpose()?,
                dialect: dialect.transpose()?,
                topic: self.topic,
                run: self.run,
                columns: self.columns,
                baud: self.baud,
                seconds: self.seconds,
                mounting: Mounting {
                    tilt_rad: self.tilt_deg.to_radians(),
                    yaw_rad: self.yaw_deg.to_radians(),
                    roll_rad: self.roll_deg.to_radians(),
                },
                min_speed_mps: self.min_speed_mps,
                accumulate: self.accumulate,
                motion_compensate: self.motion_compensate,
            },
            cleaning: CleaningOptions {
                background: self.background,
                background_cells: CellOptions {
                    cell_m: self.background_cell_m,
                    cell_mps: self.background_velocity_mps,
                    share: self.background_share,
                },
                calibration: self.calibration,
                remove_offset: self.remove_offset,
                remove_leakage_m: self.remove_leakage_m,
            },
            processing: None,
            max_frames: self.max_frames,
            radar_height_m: self.radar_height_m,
        })
    }
}

fn unknown(option: &str, name: &str, known: impl std::fmt::Display) -> Error {
    Error::input(format!("`{option}` {name}: unknown")).with_hint(known.to_string())
}
