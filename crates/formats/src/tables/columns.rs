//! Names and units of the columns of a points table.

use radarllm_base::RadarPoint;

use crate::recordings::{
    Axes, MAX_COORDINATE_M, MAX_INTENSITY_DB, MAX_VELOCITY_MPS, Place, RecordedFrame,
    RecordingError, point,
};

/// A column that is used.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Column {
    Frame,
    TimeS,
    X,
    Y,
    Z,
    Velocity,
    Intensity,
}

/// Conversion of a value to the project's unit.
#[derive(Clone, Copy, PartialEq, Debug)]
enum Unit {
    /// Multiplication by a factor.
    Scale(f64),
    /// 20 log10 of an amplitude.
    Amplitude,
    /// 10 log10 of a power.
    Power,
}

/// Columns of tables without column names, in order.
pub const PLAIN_COLUMNS: [&str; 7] = ["frame", "t_s", "x", "y", "z", "velocity", "intensity"];

/// Determines the column and unit from a name. Case is ignored, and every run of other characters than letters and
/// digits is equivalent to `_`. The unit is a suffix.
fn meaning(name: &str) -> Option<(Column, Unit)> {
    let mut key = String::new();
    for c in name
        .trim_start_matches('\u{feff}')
        .chars()
        .flat_map(char::to_lowercase)
    {
        if c.is_alphanumeric() {
            key.push(c);
        } else if !key.ends_with('_') {
            key.push('_');
        }
    }
    let key = key.trim_matches('_');
    let si = Unit::Scale(1.0);
    Some(match key {
        "frame" | "frame_number" | "frame_num" | "frame_idx" => (Column::Frame, si),
        "t_s" | "t" | "time" | "time_s" | "timestamp" | "timestamp_s" | "stamp_s" => {
            (Column::TimeS, si)
        }
        "t_ms" | "time_ms" | "timestamp_ms" => (Column::TimeS, Unit::Scale(1e-3)),
        "t_us" | "time_us" | "timestamp_us" => (Column::TimeS, Unit::Scale(1e-6)),
        "t_ns" | "time_ns" | "timestamp_ns" => (Column::TimeS, Unit::Scale(1e-9)),
        "velocity"
        | "velocity_mps"
        | "velocity_m_s"
        | "v"
        | "v_mps"
        | "v_m_s"
        | "doppler"
        | "doppler_mps"
        | "doppler_m_s"
        | "radial_velocity"
        | "radial_velocity_mps" => (Column::Velocity, si),
        "velocity_cmps" | "velocity_cm_s" | "doppler_cm_s" => (Column::Velocity, Unit::Scale(0.01)),
        "intensity" | "intensity_db" | "snr" | "snr_db" | "power_db" => (Column::Intensity, si),
        "amplitude" | "peak" | "magnitude" => (Column::Intensity, Unit::Amplitude),
        "power" | "intensity_linear" | "snr_linear" => (Column::Intensity, Unit::Power),
        _ => {
            let (axis, unit) = key.split_once('_').unwrap_or((key, "m"));
            let column = match axis {
                "x" => Column::X,
                "y" => Column::Y,
                "z" => Column::Z,
                _ => return None,
            };
            let scale = match unit {
                "m" => 1.0,
                "cm" => 0.01,
                "mm" => 0.001,
                _ => return None,
            };
            (column, Unit::Scale(scale))
        }
    })
}

/// Whether a name denotes a column of a points table.
pub(crate) fn is_point_column(name: &str) -> bool {
    meaning(name).is_some()
}

/// Positions of the columns in a table.
#[derive(Debug)]
pub(super) struct Columns {
    places: Vec<(Column, Unit, usize)>,
}

impl Columns {
    /// Finds the columns from the column names of a table.
    ///
    /// # Errors
    /// Names the missing or duplicate columns.
    pub(super) fn find<'a>(
        place: Place,
        names: impl IntoIterator<Item = &'a str> + Clone,
    ) -> Result<Self, RecordingError> {
        let mut places: Vec<(Column, Unit, usize)> = Vec::new();
        for (i, name) in names.clone().into_iter().enumerate() {
            if let Some((column, unit)) = meaning(name) {
                if places.iter().any(|(c, ..)| *c == column) {
                    let expected = format!("one column for {column:?}");
                    return Err(RecordingError::new(place, expected, name));
                }
                places.push((column, unit, i));
            }
        }
        // TI's example script writes the firmware's integers: 0.1 dB.
        if names.clone().into_iter().any(|n| n.trim() == "DetObj#") {
            for (column, unit, _) in &mut places {
                if *column == Column::Intensity && *unit == Unit::Scale(1.0) {
                    *unit = Unit::Scale(0.1);
                }
            }
        }
        let has = |column| places.iter().any(|(c, ..)| *c == column);
        let mut missing: Vec<&str> = [
            (Column::X, "x"),
            (Column::Y, "y"),
            (Column::Z, "z"),
            (Column::Velocity, "velocity"),
            (Column::Intensity, "intensity"),
        ]
        .into_iter()
        .filter(|(column, _)| !has(*column))
        .map(|(_, name)| name)
        .collect();
        if !has(Column::Frame) && !has(Column::TimeS) {
            missing.push("frame or t_s");
        }
        if missing.is_empty() {
            return Ok(Self { places });
        }
        let names: Vec<&str> = names.into_iter().take(20).collect();
        Err(RecordingError::new(
            place,
            format!(
                "columns {} (see docs/guides/recordings.md)",
                missing.join(", ")
            ),
            &names.join(","),
        ))
    }
}

/// Groups rows into frames. Consecutive rows with equal frame numbers (or times, if there are no numbers) are one
/// frame.
pub(super) struct FrameBuilder {
    columns: Columns,
    axes: Axes,
    frames: Vec<RecordedFrame>,
}

impl FrameBuilder {
    pub(super) fn new(columns: Columns, axes: Axes) -> Self {
        Self {
            columns,
            axes,
            frames: Vec::new(),
        }
    }

    /// Adds a row; `value` returns the number in a column of the table.
    pub(super) fn push(
        &mut self,
        place: Place,
        value: impl Fn(usize) -> Result<f64, RecordingError>,
    ) -> Result<(), RecordingError> {
        let mut number = None;
        let mut stamp_s = None;
        let mut position_m = [0.0; 3];
        let (mut velocity_mps, mut intensity_db) = (0.0, 0.0);
        for (column, unit, at) in &self.columns.places {
            let raw = value(*at)?;
            let v = match unit {
                Unit::Scale(scale) => raw * scale,
                Unit::Amplitude => decibels(place, 20.0, raw)?,
                Unit::Power => decibels(place, 10.0, raw)?,
            };
            let limited = |limit: f64| {
                if v.abs() <= limit {
                    Ok(v)
                } else {
                    let expected = format!("{column:?} within +-{limit}");
                    Err(RecordingError::new(place, expected, &raw.to_string()))
                }
            };
            match column {
                Column::Frame => {
                    let v = limited(9e15)?;
                    if v < 0.0 || v.fract() != 0.0 {
                        let found = raw.to_string();
                        return Err(RecordingError::new(place, "a frame number", &found));
                    }
                    number = Some(v as u64);
                }
                Column::TimeS => stamp_s = Some(limited(1e12)?),
                Column::X => position_m[0] = limited(MAX_COORDINATE_M)?,
                Column::Y => position_m[1] = limited(MAX_COORDINATE_M)?,
                Column::Z => position_m[2] = limited(MAX_COORDINATE_M)?,
                Column::Velocity => velocity_mps = limited(MAX_VELOCITY_MPS)?,
                Column::Intensity => intensity_db = limited(MAX_INTENSITY_DB)?,
            }
        }
        let point: RadarPoint = point(self.axes.to_project(position_m), velocity_mps, intensity_db);
        match self.frames.last_mut() {
            Some(last)
                if number.map_or(last.stamp_s == stamp_s, |number| last.number == number) =>
            {
                last.points.push(point);
            }
            last => {
                let next = last.map_or(0, |l| l.number + 1);
                if number.is_some_and(|n| n < next) {
                    return Err(RecordingError::new(
                        place,
                        "frame numbers that do not decrease",
                        &number.unwrap_or_default().to_string(),
                    ));
                }
                self.frames.push(RecordedFrame {
                    number: number.unwrap_or(next),
                    stamp_s,
                    points: vec![point],
                    board: None,
                });
            }
        }
        Ok(())
    }

    /// Returns the frames.
    pub(super) fn finish(self) -> Vec<RecordedFrame> {
        self.frames
    }
}

fn decibels(place: Place, factor: f64, value: f64) -> Result<f64, RecordingError> {
    if value > 0.0 {
        return Ok(factor * value.log10());
    }
    Err(RecordingError::new(
        place,
        "a positive linear intensity",
        &value.to_string(),
    ))
}
