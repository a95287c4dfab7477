//! Rows of a table into frames.

use radarllm_base::stats::median_upper;

use super::{
    PointsTable,
    clock::{self, CellTime},
    columns::{Column, Columns, Unit},
};
use crate::recordings::{
    Axes, MAX_COORDINATE_M, MAX_INTENSITY_DB, MAX_VELOCITY_MPS, Place, RecordedFrame,
    RecordingError, point,
};

/// The largest time of a clock in any unit: nanoseconds of the year 2255.
const MAX_TIME: f64 = 9e18;
/// An SNR above this is in another unit, dB: the radars of which recordings are known report up to 55 dB.
const MAX_SNR_DB: f32 = 60.0;

/// A step between frames above this is in another unit than the one that the column states, s.
const MAX_STEP_S: f64 = 10.0;

/// What a cell holds.
pub(super) enum Cell {
    /// Nothing, or something that is not a finite number.
    Empty,
    Number(f64),
    Time(CellTime),
}

/// Groups rows into frames. Consecutive rows with equal frame numbers (or times, if there are no numbers) are one
/// frame.
pub(super) struct FrameBuilder {
    columns: Columns,
    axes: Axes,
    frames: Vec<RecordedFrame>,
    /// How the first time was written.
    clock: Option<CellTime>,
    points_dropped: u64,
    points_at_radar: u64,
    rows_dropped: u64,
    restarts: u64,
    /// Whether every SNR is a whole number, as firmware sends tenths of dB.
    snr_is_whole: bool,
    noise_db: Vec<f32>,
    /// Range, azimuth and elevation of every point, where the unit of the angles is not stated.
    spherical: Vec<[f64; 3]>,
}

/// The values of a row in the project's units.
#[derive(Default)]
struct Row {
    number: Option<u64>,
    time: Option<f64>,
    position: [Option<f64>; 3],
    velocity_mps: Option<f64>,
    intensity_db: Option<f64>,
    noise_db: Option<f64>,
}

impl FrameBuilder {
    pub(super) fn new(columns: Columns, axes: Axes) -> Self {
        Self {
            columns,
            axes,
            frames: Vec::new(),
            clock: None,
            points_dropped: 0,
            points_at_radar: 0,
            rows_dropped: 0,
            restarts: 0,
            snr_is_whole: true,
            noise_db: Vec::new(),
            spherical: Vec::new(),
        }
    }

    /// Adds a row; `value` returns the content of a column of the table.
    pub(super) fn push(
        &mut self,
        place: Place,
        value: impl Fn(usize, Column) -> Result<Cell, RecordingError>,
    ) -> Result<(), RecordingError> {
        let row = self.row(place, value)?;
        let has = |column| self.columns.get(column).is_some();
        let continues = self.frames.last().is_some_and(|last| match row.number {
            Some(number) => last.number == number,
            None => last.stamp_s == row.time,
        });
        // A row that belongs to no frame.
        let has_no_frame = if has(Column::Frame) {
            row.number.is_none() || (has(Column::Time) && row.time.is_none() && !continues)
        } else {
            row.time.is_none()
        };
        if has_no_frame {
            self.rows_dropped += 1;
            return Ok(());
        }
        if !continues {
            let next = self.frames.last().map_or(0, |l| l.number.saturating_add(1));
            self.restarts += u64::from(row.number.is_some_and(|n| n < next));
            self.frames.push(RecordedFrame {
                number: row.number.unwrap_or(next),
                stamp_s: row.time,
                points: Vec::new(),
                board: None,
            });
        }
        // What no column has is 0, which the notes say.
        let or_zero = |value, columns: [Column; 2]| match columns.into_iter().any(has) {
            true => value,
            false => Some(0.0),
        };
        let [a, b, c] = row.position;
        let values = [
            a,
            b,
            or_zero(c, [Column::Z, Column::Elevation]),
            or_zero(row.velocity_mps, [Column::Velocity; 2]),
            or_zero(row.intensity_db, [Column::Intensity; 2]),
        ];
        let [
            Some(a),
            Some(b),
            Some(c),
            Some(velocity_mps),
            Some(intensity_db),
        ] = values
        else {
            return self.without_point(&row);
        };
        let angles = self.columns.get(Column::Azimuth);
        // Rows of zeros fill up frames.
        if a == 0.0 && (angles.is_some() || (b == 0.0 && c == 0.0)) {
            self.points_at_radar += 1;
            return Ok(());
        }
        let position_m = match angles {
            None => self.axes.to_project([a, b, c]),
            Some(angle) if angle.meaning.states_unit => self
                .axes
                .to_project(angles_to_position(self.axes, [a, b, c])),
            Some(_) => {
                self.spherical.push([a, b, c]);
                [0.0; 3]
            }
        };
        self.snr_is_whole &= intensity_db.fract() == 0.0;
        self.noise_db.extend(row.noise_db.map(|v| v as f32));
        if let Some(frame) = self.frames.last_mut() {
            frame
                .points
                .push(point(position_m, velocity_mps, intensity_db));
        }
        Ok(())
    }

    /// A row without a whole point: nothing but a frame without points if all its cells are empty.
    fn without_point(&mut self, row: &Row) -> Result<(), RecordingError> {
        let is_empty = row.position.iter().all(Option::is_none) && row.velocity_mps.is_none();
        self.points_dropped += u64::from(!is_empty);
        Ok(())
    }

    fn row(
        &mut self,
        place: Place,
        value: impl Fn(usize, Column) -> Result<Cell, RecordingError>,
    ) -> Result<Row, RecordingError> {
        let mut row = Row::default();
        for placed in &self.columns.placed {
            let (column, unit) = (placed.meaning.column, placed.meaning.unit);
            let raw = match value(placed.at, column)? {
                Cell::Empty => continue,
                Cell::Number(raw) if column == Column::Time => {
                    is_same_clock(place, &mut self.clock, CellTime::Number(raw))?;
                    raw
                }
                Cell::Number(raw) => raw,
                Cell::Time(time) => {
                    is_same_clock(place, &mut self.clock, time)?;
                    row.time = Some(time.value());
                    continue;
                }
            };
            let v = match unit {
                Unit::Scale(scale) => raw * scale,
                Unit::Amplitude => decibels(place, 20.0, raw)?,
                Unit::Power => decibels(place, 10.0, raw)?,
            };
            let limited = |limit: f64| {
                if v.abs() <= limit {
                    Ok(Some(v))
                } else {
                    let expected = format!("{} within +-{limit}", column.name());
                    Err(RecordingError::new(place, expected, &raw.to_string()))
                }
            };
            match column {
                Column::Frame => {
                    limited(9e15)?;
                    if v < 0.0 || v.fract() != 0.0 {
                        let found = raw.to_string();
                        return Err(RecordingError::new(place, "a frame number", &found));
                    }
                    row.number = Some(v as u64);
                }
                Column::Time => row.time = limited(MAX_TIME)?,
                Column::X | Column::Range => row.position[0] = limited(MAX_COORDINATE_M)?,
                // Angles in degrees are within the limit, too.
                Column::Y | Column::Azimuth => row.position[1] = limited(MAX_COORDINATE_M)?,
                Column::Z | Column::Elevation => row.position[2] = limited(MAX_COORDINATE_M)?,
                Column::Velocity => row.velocity_mps = limited(MAX_VELOCITY_MPS)?,
                Column::Intensity => row.intensity_db = limited(MAX_INTENSITY_DB)?,
                Column::Noise => row.noise_db = Some(v),
            }
        }
        Ok(row)
    }

    /// Returns the frames with what their values show about units and clock.
    ///
    /// # Errors
    /// Angles whose unit is not clear.
    pub(super) fn finish(mut self, place: Place) -> Result<PointsTable, RecordingError> {
        let mut table = PointsTable {
            notes: std::mem::take(&mut self.columns.notes),
            ..PointsTable::default()
        };
        let has = |column| self.columns.get(column).is_some();
        if !has(Column::Z) && !has(Column::Elevation) {
            table.warn("no column has a height: all points are at the height of the radar".into());
        }
        if !has(Column::Velocity) {
            table.warn("no column has a velocity".into());
        }
        self.resolve_angles(place, &mut table)?;
        self.resolve_intensities(&mut table);
        self.resolve_clock(place, &mut table);
        for (n, what) in [
            (
                self.points_dropped,
                "points were left out, because one of their cells is empty or not a number",
            ),
            (
                self.points_at_radar,
                "rows with a point at the place of the radar itself, as in rows of zeros that fill up frames, were left out",
            ),
            (
                self.rows_dropped,
                "rows were left out, because they state no frame and no time",
            ),
        ] {
            if n > 0 {
                table.warn(format!("{n} {what}"));
            }
        }
        table.frames = self.frames;
        Ok(table)
    }

    /// Positions from angles whose unit follows from their size.
    fn resolve_angles(
        &mut self,
        place: Place,
        table: &mut PointsTable,
    ) -> Result<(), RecordingError> {
        let angles = || self.spherical.iter().flat_map(|[_, az, el]| [*az, *el]);
        let Some(largest) = angles().map(f64::abs).max_by(f64::total_cmp) else {
            return Ok(());
        };
        // A radar sees what is in front of it: 90 degrees are 1.571 rad.
        let (unit, factor) = match largest {
            v if v <= 1.571 => ("radians", 1.0),
            v if v > 6.3 => ("degrees", std::f64::consts::PI / 180.0),
            _ => {
                return Err(RecordingError::new(
                    place,
                    "angles up to 1.571, which are radians, or beyond 6.3, which are degrees, or names such as \
                     `azimuth_deg`",
                    &largest.to_string(),
                ));
            }
        };
        table.notes.push(format!(
            "angles are taken for {unit}: the largest one is {largest:.3}"
        ));
        let points = self.frames.iter_mut().flat_map(|f| &mut f.points);
        for (p, [range_m, azimuth, elevation]) in points.zip(&self.spherical) {
            let spherical = [*range_m, azimuth * factor, elevation * factor];
            *p = point(
                self.axes
                    .to_project(angles_to_position(self.axes, spherical)),
                p.velocity_mps.into(),
                p.intensity_db.into(),
            );
        }
        Ok(())
    }

    fn resolve_intensities(&mut self, table: &mut PointsTable) {
        let n_points: usize = self.frames.iter().map(|f| f.points.len()).sum();
        let Some(placed) = self.columns.get(Column::Intensity) else {
            table.notes.push(format!(
                "no column has an intensity: {n_points} points have 0 dB"
            ));
            return;
        };
        if placed.meaning.unit != Unit::Scale(1.0) {
            return;
        }
        let points = self.frames.iter().flat_map(|f| &f.points);
        let Some(median_db) = median_upper(points.map(|p| p.intensity_db)) else {
            return;
        };
        let name = &self.columns.intensity_name;
        let noise_db = median_upper(std::mem::take(&mut self.noise_db));
        // TI's example script writes the firmware's whole numbers, for which a table of its kind speaks. Whoever divides
        // them by ten has fractions.
        let has_tenths = self.columns.is_of_ti_script
            || median_db > MAX_SNR_DB && noise_db.is_some_and(|noise_db| noise_db > MAX_SNR_DB);
        if has_tenths && self.snr_is_whole && !placed.meaning.states_unit {
            table.notes.push(format!(
                "`{name}` is taken for tenths of dB, as the firmware of TI's demos sends them (median {median_db})"
            ));
            for p in self.frames.iter_mut().flat_map(|f| &mut f.points) {
                p.intensity_db = (f64::from(p.intensity_db) / 10.0) as f32;
            }
        } else if median_db > MAX_SNR_DB {
            table.warn(unlikely(name, median_db));
        }
    }

    fn resolve_clock(&mut self, place: Place, table: &mut PointsTable) {
        table.number_restarts = self.restarts;
        let (Some(clock), Some(placed)) = (self.clock, self.columns.get(Column::Time)) else {
            return;
        };
        let name = &self.columns.time_name;
        let first = self.frames.iter().find_map(|f| f.stamp_s);
        if self.columns.get(Column::Frame).is_none() {
            let unit_s = match clock {
                CellTime::Number(_) if !placed.meaning.states_unit => {
                    first.and_then(clock::unix_unit_s)
                }
                _ => Some(1.0),
            };
            let n_rows = self.frames.len();
            if let Some(longest) = clock::join_rows(&mut self.frames, unit_s) {
                table.notes.push(format!(
                    "every row has a time of its own in `{name}`: {n_rows} rows of at most {longest:.3e} from one to the next \
                     are {} frames",
                    self.frames.len()
                ));
            }
        } else if let Some(rate_hz) = clock::coarse_rate_hz(&self.frames) {
            let unit = match clock {
                CellTime::Number(_) if !placed.meaning.states_unit => "unit of time",
                _ => "second",
            };
            table.clock_error = Some(RecordingError {
                at: place,
                expected: format!("a time in `{name}` for each frame"),
                found: format!(
                    "one for several frames: their numbers grow by {rate_hz:.2} in a {unit}"
                ),
            });
            for frame in &mut self.frames {
                frame.stamp_s = None;
            }
            return;
        }
        let times = self.frames.iter().filter_map(|f| f.stamp_s);
        if placed.meaning.states_unit {
            if let Some(step_s) = clock::median_step(times).filter(|s| *s > MAX_STEP_S) {
                table.warn(format!(
                    "the median step of the times in `{name}` is {step_s} s: their unit may be another one"
                ));
            }
        } else if matches!(clock, CellTime::Number(_)) {
            match clock::unit_of(place, name, times) {
                Ok(Some(unit)) => {
                    if unit.factor != 1.0 {
                        let step = unit.step.map(|s| format!(" (median step {s})"));
                        table.notes.push(format!(
                            "the times in `{name}` are {}{}",
                            unit.name,
                            step.unwrap_or_default()
                        ));
                    }
                    for frame in &mut self.frames {
                        frame.stamp_s = frame.stamp_s.map(|t| t * unit.factor);
                    }
                }
                Ok(None) => {}
                Err(error) => {
                    table.clock_error = Some(error);
                    for frame in &mut self.frames {
                        frame.stamp_s = None;
                    }
                    return;
                }
            }
        }
        let is_of_day = matches!(clock, CellTime::OfDay(_));
        if let Some((n, back_s, at)) = clock::continue_clock(&mut self.frames, is_of_day) {
            table.warn(format!(
                "the clock in `{name}` went back {n} times, first by {back_s:.3} s at frame {at}: the frames follow on"
            ));
        }
    }
}

fn unlikely(name: &str, median_db: f32) -> String {
    format!(
        "the median of `{name}` is {median_db:.0} dB, which no radar's SNR is: its unit is another one. Names such as \
         `snr_tenths`, `snr_linear` and `amplitude` state it"
    )
}

/// A warning about intensities in dB whose median is beyond that of any radar's SNR; `name` is what the recording calls them.
pub fn unlikely_snr(frames: &[RecordedFrame], name: &str) -> Option<String> {
    let points = frames.iter().flat_map(|f| &f.points);
    let median_db = median_upper(points.map(|p| p.intensity_db))?;
    (median_db > MAX_SNR_DB).then(|| unlikely(name, median_db))
}

/// Position of a range, an azimuth and an elevation in the axes of a recording. The azimuth grows from the boresight to the
/// second axis of the ground: to the right, or to the left in ROS.
pub(crate) fn angles_to_position(
    axes: Axes,
    [range_m, azimuth_rad, elevation_rad]: [f64; 3],
) -> [f64; 3] {
    let flat_m = range_m * elevation_rad.cos();
    let (side_m, forward_m) = (flat_m * azimuth_rad.sin(), flat_m * azimuth_rad.cos());
    let up_m = range_m * elevation_rad.sin();
    match axes {
        Axes::RightForwardUp => [side_m, forward_m, up_m],
        Axes::ForwardLeftUp => [forward_m, side_m, up_m],
    }
}

/// Checks that all times of a table are written in one way.
fn is_same_clock(
    place: Place,
    clock: &mut Option<CellTime>,
    time: CellTime,
) -> Result<(), RecordingError> {
    let first = *clock.get_or_insert(time);
    if first.is_like(time) {
        return Ok(());
    }
    let expected = match first {
        CellTime::Number(_) => "a time as a number, as in the first row",
        CellTime::Date(_) => "a date with time, as in the first row",
        CellTime::OfDay(_) => "a time of day, as in the first row",
    };
    Err(RecordingError::new(
        place,
        expected,
        &time.value().to_string(),
    ))
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
