//! Points of one recording or simulation: Parquet, one row per point.
//!
//! Columns `frame` u32, `t_s` f64, then `x_m, y_m, z_m, range_m, velocity_mps, intensity_db` f32.
//! Axes: x right, y away from the radar, z up. The velocity is positive when receding. Properties of
//! the whole file are in the key-value metadata, see [`PointsMeta`].
//!
//! What the board itself states of the frames, such as the people whom it tracks, is in two more columns
//! (`board_columns.rs`), which only recordings have whose board can state something. A frame without points has a row
//! there if the board stated something; its values of points are null.

use std::collections::{HashMap, VecDeque};
use std::fs::File;
use std::iter::Peekable;
use std::path::{Path, PathBuf};

use parquet::basic::Compression;
use parquet::file::properties::WriterProperties;
use radarllm_base::{BoardReport, Clip, PointFrame, RadarPoint, stats::median_upper};

use super::atomic::write_atomic;
use super::board_columns::{self, BoardBuilder, BoardColumns};
use super::guard::{self, Limits};
use super::levels::{TableReader, TableWriter};
use super::table::{Column, Table, Values};
use crate::{DatasetError, Overwrite, PointsFile, PointsMeta};

/// Limits of one points file. Half an hour at 10 frames/s with 1,000 points per frame is 18 M points.
const LIMITS: Limits = Limits {
    file_bytes: 4 << 30,
    rows: 20_000_000,
    chunk_values: 20_000_000,
};
/// Maximum number of frames in one file: two days at 10 frames/s.
const MAX_FRAMES: u64 = 2_000_000;
/// Value columns, in the order of [`RadarPoint`]'s fields.
const VALUE_COLUMNS: [&str; 6] = [
    "x_m",
    "y_m",
    "z_m",
    "range_m",
    "velocity_mps",
    "intensity_db",
];
/// Those among them that have no value twice, so that a dictionary of values would only cost time.
const PLACE_COLUMNS: [&str; 4] = ["x_m", "y_m", "z_m", "range_m"];
/// Rows of a row group, which is kept in memory until it is complete.
const GROUP_ROWS: usize = 256 << 10;
/// Rows decoded at a time.
const BATCH_ROWS: usize = 8192;

/// Writes a clip as a points file, atomically.
///
/// # Errors
/// As [`write_points`].
pub fn write_clip(path: &Path, clip: &Clip, overwrite: Overwrite) -> Result<(), DatasetError> {
    write_points(path, &PointsMeta::of(clip), &clip.frames, overwrite)
}

/// Writes a points file atomically.
///
/// Besides the fields of [`PointsMeta`] the metadata holds `n_frames` (last frame number + 1, so
/// that trailing empty frames survive), `t0_s` (nominal time of frame 0) and, if any, `missing_frames` (numbers absent from
/// `frames`, as `3,7-9`) and `speeds` (`unknown` if no point has a measured speed).
///
/// # Errors
/// Frames out of order, values that are not finite, more than 20 M points or 2 M frames, an
/// existing file without [`Overwrite::Replace`], or a file system error.
pub fn write_points(
    path: &Path,
    meta: &PointsMeta,
    frames: &[PointFrame],
    overwrite: Overwrite,
) -> Result<(), DatasetError> {
    write_frames(path, meta, with_board(meta, frames), overwrite, |writer| {
        frames.iter().try_for_each(|frame| writer.write(frame))
    })
}

/// Whether the columns of a board are needed.
fn with_board(meta: &PointsMeta, frames: &[PointFrame]) -> bool {
    meta.board_can_report() || frames.iter().any(|frame| frame.board.is_some())
}

/// As [`write_points`], of frames that `write` hands over one by one, so that memory for all of them is not needed.
///
/// # Errors
/// As [`write_points`], and those of `write`; also a frame with a report of its board if recordings of this source have none
/// ([`PointsMeta::board_can_report`]). The file is not written then.
pub fn write_points_with<E: From<DatasetError>>(
    path: &Path,
    meta: &PointsMeta,
    overwrite: Overwrite,
    write: impl FnOnce(&mut PointsWriter<'_>) -> Result<(), E>,
) -> Result<(), E> {
    write_frames(path, meta, meta.board_can_report(), overwrite, write)
}

fn write_frames<E: From<DatasetError>>(
    path: &Path,
    meta: &PointsMeta,
    with_board: bool,
    overwrite: Overwrite,
    write: impl FnOnce(&mut PointsWriter<'_>) -> Result<(), E>,
) -> Result<(), E> {
    check_meta(path, meta)?;
    write_atomic(path, overwrite, |file| {
        let mut writer = PointsWriter::new(path, file, with_board)?;
        write(&mut writer)?;
        Ok(writer.finish(meta)?)
    })
}

/// Writes the frames of a points file one by one.
pub struct PointsWriter<'a> {
    path: &'a Path,
    writer: TableWriter<&'a mut File>,
    columns: Columns,
    span: FrameSpan,
    has_speeds: bool,
}

impl<'a> PointsWriter<'a> {
    fn new(path: &'a Path, file: &'a mut File, with_board: bool) -> Result<Self, DatasetError> {
        let mut properties = WriterProperties::builder()
            .set_created_by(format!("radarllm-dataset {}", env!("CARGO_PKG_VERSION")))
            .set_compression(Compression::SNAPPY);
        for name in PLACE_COLUMNS {
            properties = properties.set_column_dictionary_enabled(name.into(), false);
        }
        let no_rows = Columns::new(with_board).into_table();
        let writer = TableWriter::new(file, &no_rows, properties.build())
            .map_err(|e| DatasetError::of_writing(path, e))?;
        Ok(Self {
            path,
            writer,
            columns: Columns::new(with_board),
            span: FrameSpan::default(),
            has_speeds: true,
        })
    }

    /// States that the speeds of the points are not known, which is seen at the end of some recordings.
    pub fn without_speeds(&mut self) {
        self.has_speeds = false;
    }

    /// Writes the next frame.
    ///
    /// # Errors
    /// A frame out of order, values that are not finite, more than 20 M points or 2 M frames, or a file system error.
    pub fn write(&mut self, frame: &PointFrame) -> Result<(), DatasetError> {
        self.span.add(self.path, frame)?;
        self.columns.check(self.path, frame)?;
        for row in rows_of(frame) {
            self.columns.push(frame, row);
            if self.columns.frames.len() == GROUP_ROWS {
                self.write_rows()?;
            }
        }
        Ok(())
    }

    fn write_rows(&mut self) -> Result<(), DatasetError> {
        let next = Columns::new(self.columns.board.is_some());
        let rows = std::mem::replace(&mut self.columns, next).into_table();
        let written = self.writer.write(&rows);
        written.map_err(|e| DatasetError::of_writing(self.path, e))
    }

    fn finish(mut self, meta: &PointsMeta) -> Result<(), DatasetError> {
        if !self.columns.frames.is_empty() {
            self.write_rows()?;
        }
        let meta = PointsMeta {
            has_speeds: meta.has_speeds && self.has_speeds,
            ..meta.clone()
        };
        for (key, value) in metadata_of(&meta, &self.span) {
            self.writer.add_metadata(key, value);
        }
        let closed = self.writer.close();
        closed.map_err(|e| DatasetError::of_writing(self.path, e))?;
        Ok(())
    }
}

/// The points of frames as a table with the columns of a points file. Its metadata is that of [`write_points`], so that
/// [`points_from_tables`] restores frames without points.
///
/// # Errors
/// Frames that [`write_points`] would refuse.
pub fn points_to_table(meta: &PointsMeta, frames: &[PointFrame]) -> Result<Table, DatasetError> {
    let name = Path::new("points");
    check_meta(name, meta)?;
    let mut span = FrameSpan::default();
    let mut columns = Columns::new(with_board(meta, frames));
    for frame in frames {
        span.add(name, frame)?;
        columns.check(name, frame)?;
        rows_of(frame).for_each(|row| columns.push(frame, row));
    }
    let metadata = metadata_of(meta, &span).into_iter();
    Ok(Table {
        metadata: metadata.map(|(k, v)| (k.to_string(), v)).collect(),
        ..columns.into_table()
    })
}

/// The points of frames alone as a table, a row for each point: the columns of a points file without those of a board.
///
/// # Errors
/// As [`points_to_table`].
pub fn point_columns(meta: &PointsMeta, frames: &[PointFrame]) -> Result<Table, DatasetError> {
    let name = Path::new("points");
    check_meta(name, meta)?;
    let mut span = FrameSpan::default();
    let mut columns = Columns::new(false);
    for frame in frames {
        span.add(name, frame)?;
        for point in &frame.points {
            let row = Row {
                point: Some(point),
                board: None,
            };
            columns.push(frame, row);
        }
    }
    Ok(columns.into_table())
}

/// Whether a column of a points file has this name; others are ignored.
pub fn is_points_column(name: &str) -> bool {
    let of_board = [board_columns::TRACKS, board_columns::PRESENT];
    ["frame", "t_s"].contains(&name) || VALUE_COLUMNS.contains(&name) || of_board.contains(&name)
}

/// Points from pieces of a table with the columns of a points file, of any program. `metadata` is what is stated of the whole;
/// that of the pieces is ignored. `name` takes the place of the file in errors.
///
/// # Errors
/// As [`read_points`], and those of the pieces.
pub fn points_from_tables<E: ToString>(
    name: &Path,
    metadata: &HashMap<String, String>,
    pieces: impl IntoIterator<Item = Result<Table, E>>,
) -> Result<PointsFile, DatasetError> {
    let mut frames: Vec<PointFrame> = Vec::new();
    let mut n_rows = 0_u64;
    for rows in pieces {
        let rows = rows.map_err(|e| DatasetError::corrupt(name, e))?;
        let found = n_rows + rows.n_rows() as u64;
        if found > LIMITS.rows {
            return Err(DatasetError::Limit {
                path: name.into(),
                what: "number of points".into(),
                found,
                max: LIMITS.rows,
            });
        }
        append_rows(name, &rows, n_rows, &mut frames)?;
        n_rows = found;
    }
    complete(name, metadata, frames)
}

/// Reads a points file, written by this crate or any Parquet file with the same columns (integers and doubles are
/// converted, the column order is arbitrary, other columns are ignored).
///
/// # Errors
/// The error names the file and, where applicable, the column and row: missing columns, nulls, values that
/// are not finite, frame numbers that decrease, different times within a frame, sizes beyond the
/// limits, damaged bytes. The function never panics on file content.
pub fn read_points(path: &Path) -> Result<PointsFile, DatasetError> {
    let file = File::open(path).map_err(DatasetError::io(path, "open"))?;
    read_points_from(file, path)
}

/// As [`read_points`], from a file that is open; `path` names it in errors.
///
/// # Errors
/// As [`read_points`].
pub fn read_points_from(file: File, path: &Path) -> Result<PointsFile, DatasetError> {
    let mut reader = reader_of(path, file)?;
    let metadata = reader.metadata().into_iter().collect();
    // A file without rows must have the columns nevertheless.
    let mut frames: Vec<PointFrame> = Vec::new();
    append_rows(path, &reader.no_rows(), 0, &mut frames)?;
    let mut first_row = 0_u64;
    while let Some(rows) = reader.next_batch()? {
        append_rows(path, &rows, first_row, &mut frames)?;
        first_row += rows.n_rows() as u64;
    }
    complete(path, &metadata, frames)
}

/// The metadata of points: see [`write_points`].
fn metadata_of(meta: &PointsMeta, span: &FrameSpan) -> Vec<(&'static str, String)> {
    let first = span.first.unwrap_or_default();
    let t0_s = first.1 - f64::from(first.0) / meta.frame_rate_hz;
    let mut metadata = vec![
        ("radar", meta.radar.clone()),
        ("source", meta.source.clone()),
        ("version", meta.version.clone()),
        ("n_frames", span.n_frames.to_string()),
        ("frame_rate", meta.frame_rate_hz.to_string()),
        ("t0_s", t0_s.to_string()),
        (
            "axes",
            "x right, y away from the radar, z up; metres; velocity positive when receding".into(),
        ),
    ];
    if let Some(seed) = meta.seed {
        metadata.push(("seed", seed.to_string()));
    }
    if let Some(height_m) = meta.radar_height_m {
        metadata.push(("radar_height_m", height_m.to_string()));
    }
    if !span.missing.is_empty() {
        metadata.push(("missing_frames", span.missing.clone()));
    }
    if !meta.has_speeds {
        metadata.push(("speeds", UNKNOWN_SPEEDS.into()));
    }
    metadata
}

fn check_meta(path: &Path, meta: &PointsMeta) -> Result<(), DatasetError> {
    let field = |field: &str, problem: String| {
        Err(DatasetError::Metadata {
            path: path.to_path_buf(),
            field: field.into(),
            problem,
        })
    };
    if !(meta.frame_rate_hz.is_finite() && meta.frame_rate_hz > 0.0) {
        return field(
            "frame_rate",
            format!("must be finite and positive, found {}", meta.frame_rate_hz),
        );
    }
    if let Some(height_m) = meta.radar_height_m
        && !height_m.is_finite()
    {
        return field("radar_height_m", format!("is {height_m}"));
    }
    Ok(())
}

/// What the metadata say about frames, which are checked while they are added.
#[derive(Debug, Default)]
struct FrameSpan {
    /// Number and time of the first frame and of the last one, s.
    first: Option<(u32, f64)>,
    last: Option<(u32, f64)>,
    /// Number of the last frame + 1.
    n_frames: u64,
    /// Number of rows.
    n_rows: u64,
    /// Numbers between 0 and the last frame that no frame has, as `3,7-9`.
    missing: String,
}

impl FrameSpan {
    fn add(&mut self, path: &Path, frame: &PointFrame) -> Result<(), DatasetError> {
        let limit = |what: &str, found: u64, max: u64| {
            Err(DatasetError::Limit {
                path: path.to_path_buf(),
                what: what.into(),
                found,
                max,
            })
        };
        let value = |row: u64, column: &str, problem: String| {
            Err(DatasetError::Value {
                path: path.to_path_buf(),
                column: column.into(),
                row,
                problem,
            })
        };
        let (number, time_s) = (frame.frame, frame.time_s);
        if u64::from(number) >= MAX_FRAMES {
            return limit("frame number", u64::from(number), MAX_FRAMES - 1);
        }
        if !time_s.is_finite() {
            let problem = format!("frame {number}: time is {time_s}");
            return value(self.n_rows, "t_s", problem);
        }
        if let Some((before, before_s)) = self.last
            && (number <= before || time_s < before_s)
        {
            let problem =
                format!("frame {number} at {time_s} s follows frame {before} at {before_s} s");
            return value(self.n_rows, "frame", problem);
        }
        for (row, point) in (self.n_rows..).zip(&frame.points) {
            let mut fields = VALUE_COLUMNS.into_iter().zip(fields_of(point));
            if let Some((column, v)) = fields.find(|(_, v)| !v.is_finite()) {
                return value(row, column, format!("is {v}"));
            }
        }
        if let Some((member, v)) = frame.board.as_ref().and_then(board_columns::out_of_range) {
            let problem = format!("frame {number}: {member} is {v}");
            return value(self.n_rows, board_columns::TRACKS, problem);
        }
        self.n_rows += rows_of(frame).count() as u64;
        if self.n_rows > LIMITS.rows {
            return limit("number of points", self.n_rows, LIMITS.rows);
        }
        let expected = self.n_frames as u32;
        if number > expected {
            if !self.missing.is_empty() {
                self.missing.push(',');
            }
            self.missing += &match number - 1 {
                last if last == expected => last.to_string(),
                last => format!("{expected}-{last}"),
            };
        }
        self.first.get_or_insert((number, time_s));
        self.last = Some((number, time_s));
        self.n_frames = u64::from(number) + 1;
        Ok(())
    }
}

fn fields_of(p: &RadarPoint) -> [f32; 6] {
    [
        p.x_m,
        p.y_m,
        p.z_m,
        p.range_m,
        p.velocity_mps,
        p.intensity_db,
    ]
}

/// Inverse of [`FrameSpan::missing`]: inclusive ranges, increasing, below `n_frames`.
fn parse_missing(text: &str, n_frames: u64) -> Option<Vec<(u64, u64)>> {
    let mut ranges: Vec<(u64, u64)> = Vec::new();
    for part in text.split(',').filter(|p| !p.is_empty()) {
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        let (first, last): (u64, u64) = (first.parse().ok()?, last.parse().ok()?);
        let after_previous = ranges.last().is_none_or(|&(_, end)| first > end);
        if first > last || last >= n_frames || !after_previous {
            return None;
        }
        ranges.push((first, last));
    }
    Some(ranges)
}

/// A row of a frame: a point, and in the first one what the board states.
struct Row<'a> {
    point: Option<&'a RadarPoint>,
    board: Option<&'a BoardReport>,
}

/// The rows of a frame. Without points it has one if the board states something.
fn rows_of(frame: &PointFrame) -> impl Iterator<Item = Row<'_>> {
    let board = frame.board.as_ref();
    let points = frame.points.iter().enumerate().map(move |(i, point)| Row {
        point: Some(point),
        board: board.filter(|_| i == 0),
    });
    let alone = board.filter(|_| frame.points.is_empty());
    points.chain(alone.map(|board| Row {
        point: None,
        board: Some(board),
    }))
}

/// Rows of a points file that are not written yet.
struct Columns {
    frames: Vec<u32>,
    times_s: Vec<f64>,
    values: [Vec<f32>; VALUE_COLUMNS.len()],
    board: Option<BoardRows>,
}

/// What a board states in rows, and whether they are points.
#[derive(Default)]
struct BoardRows {
    builder: BoardBuilder,
    are_points: Vec<bool>,
}

impl Columns {
    fn new(with_board: bool) -> Self {
        Self {
            frames: Vec::new(),
            times_s: Vec::new(),
            values: Default::default(),
            board: with_board.then(BoardRows::default),
        }
    }

    /// Refuses a report of a board where the source of the recording says that there are none.
    fn check(&self, path: &Path, frame: &PointFrame) -> Result<(), DatasetError> {
        match (&self.board, &frame.board) {
            (None, Some(_)) => Err(DatasetError::Metadata {
                path: path.into(),
                field: "source".into(),
                problem: format!(
                    "no recording whose board reports more than points, but frame {} has such a report",
                    frame.frame
                ),
            }),
            _ => Ok(()),
        }
    }

    fn push(&mut self, frame: &PointFrame, row: Row) {
        self.frames.push(frame.frame);
        self.times_s.push(frame.time_s);
        let fields = row.point.map_or([0.0; VALUE_COLUMNS.len()], fields_of);
        for (column, value) in self.values.iter_mut().zip(fields) {
            column.push(value);
        }
        if let Some(board) = &mut self.board {
            board.builder.push(row.board);
            board.are_points.push(row.point.is_some());
        }
    }

    fn into_table(self) -> Table {
        let mut columns = vec![
            Column::new("frame", Values::U32(self.frames)),
            Column::new("t_s", Values::F64(self.times_s)),
        ];
        for (name, values) in VALUE_COLUMNS.into_iter().zip(self.values) {
            let values = Values::F32(values);
            columns.push(match &self.board {
                Some(board) => Column::nullable(name, values, board.are_points.clone()),
                None => Column::new(name, values),
            });
        }
        columns.extend(self.board.into_iter().flat_map(|b| b.builder.finish()));
        Table {
            columns,
            metadata: Vec::new(),
        }
    }
}

fn append_rows(
    path: &Path,
    rows: &Table,
    first_row: u64,
    frames: &mut Vec<PointFrame>,
) -> Result<(), DatasetError> {
    let board = BoardColumns::of(path, rows, first_row)?;
    let number = numbers(path, rows, "frame", first_row, false)?;
    let time_s = numbers(path, rows, "t_s", first_row, false)?;
    let mut values = Vec::with_capacity(VALUE_COLUMNS.len());
    for name in VALUE_COLUMNS {
        values.push(numbers(path, rows, name, first_row, true)?);
    }
    for row in 0..rows.n_rows() {
        let bad = |column: &str, problem: String| DatasetError::Value {
            path: path.to_path_buf(),
            column: column.into(),
            row: first_row + row as u64,
            problem,
        };
        let (raw, time_s) = (number[row], time_s[row]);
        if !(raw >= 0.0 && raw.fract() == 0.0 && raw < MAX_FRAMES as f64) {
            return Err(bad(
                "frame",
                format!("{raw} is not a whole number in 0..{MAX_FRAMES}"),
            ));
        }
        let frame = raw as u32;
        match frames.last() {
            Some(last) if last.frame > frame => {
                return Err(bad(
                    "frame",
                    format!("{frame} follows {}: frames must not decrease", last.frame),
                ));
            }
            Some(last) if last.frame == frame && last.time_s != time_s => {
                return Err(bad(
                    "t_s",
                    format!("{time_s} differs from {} in the same frame", last.time_s),
                ));
            }
            Some(last) if last.time_s > time_s => {
                return Err(bad(
                    "t_s",
                    format!("{time_s} follows {}: time must not decrease", last.time_s),
                ));
            }
            Some(last) if last.frame == frame => {}
            _ => frames.push(PointFrame {
                frame,
                time_s,
                points: Vec::new(),
                board: None,
            }),
        }
        let report = board.as_ref().map_or(Ok(None), |board| board.at(row))?;
        if let (Some(report), Some(last)) = (report, frames.last_mut()) {
            if last.board.is_some() || !last.points.is_empty() {
                let problem = format!("frame {frame} has one already, or points before it");
                return Err(bad(board_columns::TRACKS, problem));
            }
            last.board = Some(report);
        }
        // A frame without points.
        if values.iter().all(|column| column[row].is_nan()) {
            continue;
        }
        let mut v = [0.0_f32; 6];
        for (i, column) in values.iter().enumerate() {
            v[i] = column[row] as f32;
            if !v[i].is_finite() {
                let problem = match column[row].is_nan() {
                    true => "is null".into(),
                    false => format!("{} does not fit a 32-bit float", column[row]),
                };
                return Err(bad(VALUE_COLUMNS[i], problem));
            }
        }
        if let Some(last) = frames.last_mut() {
            last.points.push(RadarPoint {
                x_m: v[0],
                y_m: v[1],
                z_m: v[2],
                range_m: v[3],
                velocity_mps: v[4],
                intensity_db: v[5],
            });
        }
    }
    Ok(())
}

/// A numeric column as f64. f64 holds every f32, i32 and u32 exactly. All values are finite; nulls, if there may be some, are
/// NaN.
fn numbers(
    path: &Path,
    rows: &Table,
    name: &str,
    first_row: u64,
    may_be_null: bool,
) -> Result<Vec<f64>, DatasetError> {
    let expected = match name {
        "frame" => "a 32-bit unsigned integer",
        "t_s" => "a 64-bit float",
        _ => "a 32-bit float",
    };
    let wrong = |found: String| DatasetError::Column {
        path: path.to_path_buf(),
        column: name.into(),
        expected: expected.into(),
        found,
    };
    let column = rows.column(name).ok_or_else(|| wrong("nothing".into()))?;
    let bad = |row: usize, problem: String| DatasetError::Value {
        path: path.to_path_buf(),
        column: name.into(),
        row: first_row + row as u64,
        problem,
    };
    let is_null = |row: usize| column.is_null(row);
    if let Some(row) = (0..column.len()).find(|&row| !may_be_null && is_null(row)) {
        return Err(bad(row, "is null".into()));
    }
    fn to_f64<T: Copy>(values: &[T], convert: impl Fn(T) -> f64) -> Vec<f64> {
        values.iter().map(|v| convert(*v)).collect()
    }
    let mut values = match &column.values {
        Values::F32(v) => to_f64(v, f64::from),
        Values::F64(v) => v.clone(),
        Values::I32(v) => to_f64(v, f64::from),
        Values::U32(v) => to_f64(v, f64::from),
        Values::I64(v) => to_f64(v, |v| v as f64),
        Values::U64(v) => to_f64(v, |v| v as f64),
        _ => return Err(wrong(column.type_name())),
    };
    let not_finite = (0..values.len()).find(|&row| !values[row].is_finite() && !is_null(row));
    if let Some(row) = not_finite {
        return Err(bad(row, format!("is {}", values[row])));
    }
    for (row, value) in values.iter_mut().enumerate() {
        if is_null(row) {
            *value = f64::NAN;
        }
    }
    Ok(values)
}

/// Adds the empty frames and the metadata.
fn complete(
    path: &Path,
    metadata: &HashMap<String, String>,
    found: Vec<PointFrame>,
) -> Result<PointsFile, DatasetError> {
    let stated = Stated::of(path, metadata)?;
    let Some(frame_rate_hz) = stated.frame_rate_hz.or_else(|| rate_from_times(&found)) else {
        return Err(stated.bad(
            "frame_rate",
            "absent, and the times of the frames do not tell it either".into(),
        ));
    };
    let seen = found.last().map_or(0, |f| u64::from(f.frame) + 1);
    let n_frames = stated.n_frames.unwrap_or(seen);
    let mut filler = Filler::new(&stated, frame_rate_hz, n_frames)?;
    let mut frames = Vec::with_capacity(found.len());
    for frame in found {
        frames.extend(std::iter::from_fn(|| filler.next_before(&frame)));
        filler.pass(&frame)?;
        frames.push(frame);
    }
    frames.extend(std::iter::from_fn(|| filler.next_at_end()));
    Ok(PointsFile {
        meta: stated.meta(frame_rate_hz),
        frames,
    })
}

/// What the metadata `speeds` of points without speeds say.
const UNKNOWN_SPEEDS: &str = "unknown";

/// What the metadata of a points file state; see [`write_points`].
struct Stated {
    path: PathBuf,
    /// Radar, source and version.
    texts: [String; 3],
    seed: Option<u64>,
    frame_rate_hz: Option<f64>,
    radar_height_m: Option<f32>,
    n_frames: Option<u64>,
    t0_s: Option<f64>,
    missing: Option<String>,
    has_speeds: bool,
}

impl Stated {
    fn of(path: &Path, metadata: &HashMap<String, String>) -> Result<Self, DatasetError> {
        let bad = |field: &str, problem: String| DatasetError::Metadata {
            path: path.to_path_buf(),
            field: field.into(),
            problem,
        };
        let text = |key: &str| {
            metadata
                .get(key)
                .cloned()
                .unwrap_or_else(|| "unknown".into())
        };
        let number = |key: &str| -> Result<Option<f64>, DatasetError> {
            let Some(text) = metadata.get(key) else {
                return Ok(None);
            };
            match text.trim().parse::<f64>() {
                Ok(v) if v.is_finite() => Ok(Some(v)),
                _ => Err(bad(key, format!("{text:?} is not a finite number"))),
            }
        };
        let seed = match metadata.get("seed").map(|s| s.trim()) {
            None | Some("" | "none") => None,
            Some(s) => Some(
                s.parse()
                    .map_err(|_| bad("seed", format!("{s:?} is not a 64-bit number")))?,
            ),
        };
        let frame_rate_hz = number("frame_rate")?;
        if let Some(rate) = frame_rate_hz.filter(|rate| *rate <= 0.0) {
            return Err(bad("frame_rate", format!("must be positive, found {rate}")));
        }
        let radar_height_m = match number("radar_height_m")? {
            Some(height_m) if (height_m as f32).is_finite() => Some(height_m as f32),
            Some(height_m) => {
                return Err(bad(
                    "radar_height_m",
                    format!("{height_m} m is out of range"),
                ));
            }
            None => None,
        };
        let n_frames: Option<u64> = match metadata.get("n_frames") {
            None => None,
            Some(s) => Some(
                s.trim()
                    .parse()
                    .map_err(|_| bad("n_frames", format!("{s:?} is not a count")))?,
            ),
        };
        let stated = Self {
            path: path.into(),
            texts: ["radar", "source", "version"].map(text),
            seed,
            frame_rate_hz,
            radar_height_m,
            n_frames,
            t0_s: number("t0_s")?,
            missing: metadata.get("missing_frames").cloned(),
            has_speeds: metadata.get("speeds").is_none_or(|s| s != UNKNOWN_SPEEDS),
        };
        match n_frames {
            Some(n) if n > MAX_FRAMES => {
                Err(stated.bad("n_frames", format!("{n} is not in 0..={MAX_FRAMES}")))
            }
            _ => Ok(stated),
        }
    }

    fn bad(&self, field: &str, problem: String) -> DatasetError {
        DatasetError::Metadata {
            path: self.path.clone(),
            field: field.into(),
            problem,
        }
    }

    fn meta(&self, frame_rate_hz: f64) -> PointsMeta {
        let [radar, source, version] = self.texts.clone();
        PointsMeta {
            radar,
            source,
            seed: self.seed,
            version,
            radar_height_m: self.radar_height_m,
            frame_rate_hz,
            has_speeds: self.has_speeds,
        }
    }
}

/// Adds the frames in which nothing was detected, and which have no rows, to those that have.
struct Filler {
    path: PathBuf,
    n_frames: u64,
    frame_rate_hz: f64,
    /// Time of frame 0, s; that of the first frame with points gives it, if it is not stated.
    t0_s: Option<f64>,
    /// Frames that the recording lost, as ranges in order.
    missing: Peekable<std::vec::IntoIter<(u64, u64)>>,
    /// Number of the next frame.
    next: u32,
    latest_s: f64,
}

impl Filler {
    fn new(stated: &Stated, frame_rate_hz: f64, n_frames: u64) -> Result<Self, DatasetError> {
        let missing = match &stated.missing {
            None => Vec::new(),
            Some(s) => parse_missing(s, n_frames).ok_or_else(|| {
                stated.bad(
                    "missing_frames",
                    "not increasing ranges below n_frames".into(),
                )
            })?,
        };
        Ok(Self {
            path: stated.path.clone(),
            n_frames,
            frame_rate_hz,
            t0_s: stated.t0_s,
            missing: missing.into_iter().peekable(),
            next: 0,
            latest_s: f64::NEG_INFINITY,
        })
    }

    /// The next empty frame before frame `end`, which is at `upper_s`.
    fn next_empty(&mut self, end: u32, upper_s: f64) -> Option<PointFrame> {
        while self.next < end {
            let frame = self.next;
            self.next += 1;
            if self.is_lost(frame) {
                continue;
            }
            // Nominal time of an empty frame, kept in order between measured times that jitter.
            let nominal_s = self.t0_s.unwrap_or_default() + f64::from(frame) / self.frame_rate_hz;
            let time_s = nominal_s.min(upper_s).max(self.latest_s);
            self.latest_s = time_s;
            return Some(PointFrame {
                frame,
                time_s,
                points: Vec::new(),
                board: None,
            });
        }
        None
    }

    /// The next empty frame before one with points.
    fn next_before(&mut self, found: &PointFrame) -> Option<PointFrame> {
        let first_s = found.time_s - f64::from(found.frame) / self.frame_rate_hz;
        self.t0_s.get_or_insert(first_s);
        self.next_empty(found.frame, found.time_s)
    }

    /// The next empty frame at the end.
    fn next_at_end(&mut self) -> Option<PointFrame> {
        self.next_empty(self.n_frames as u32, f64::INFINITY)
    }

    /// Takes note of a frame with points, before which nothing is missing any more.
    fn pass(&mut self, found: &PointFrame) -> Result<(), DatasetError> {
        let (frame, n_frames) = (found.frame, self.n_frames);
        let (field, problem) = match u64::from(frame) + 1 {
            seen if seen > n_frames => (
                "n_frames",
                format!("{n_frames} is not in {seen}..={MAX_FRAMES}"),
            ),
            _ if self.is_lost(frame) => (
                "missing_frames",
                format!("frame {frame} has points but is listed as lost"),
            ),
            _ => {
                self.next = frame + 1;
                self.latest_s = found.time_s;
                return Ok(());
            }
        };
        Err(DatasetError::Metadata {
            path: self.path.clone(),
            field: field.into(),
            problem,
        })
    }

    /// Whether the recording lost a frame, of frames in order.
    fn is_lost(&mut self, frame: u32) -> bool {
        let frame = u64::from(frame);
        while self.missing.next_if(|&(_, last)| last < frame).is_some() {}
        self.missing
            .peek()
            .is_some_and(|&(first, _)| first <= frame)
    }
}

/// Reads the frames of a points file one by one, so that memory for all of them is not needed.
pub struct PointsReader {
    path: PathBuf,
    reader: TableReader,
    meta: PointsMeta,
    filler: Filler,
    n_read: u64,
    /// Frames with points.
    found: VecDeque<PointFrame>,
    is_over: bool,
}

impl PointsReader {
    /// Begins to read a file; `path` names it in errors. `None` if its metadata do not state the frame rate and the number
    /// of frames, which follow from all of its rows then ([`read_points`]).
    ///
    /// # Errors
    /// As [`read_points`].
    pub fn open(file: File, path: &Path) -> Result<Option<Self>, DatasetError> {
        let reader = reader_of(path, file)?;
        let stated = Stated::of(path, &reader.metadata().into_iter().collect())?;
        let (Some(frame_rate_hz), Some(n_frames)) = (stated.frame_rate_hz, stated.n_frames) else {
            return Ok(None);
        };
        // The columns must exist also in a file without rows.
        append_rows(path, &reader.no_rows(), 0, &mut Vec::new())?;
        Ok(Some(Self {
            path: path.into(),
            reader,
            meta: stated.meta(frame_rate_hz),
            filler: Filler::new(&stated, frame_rate_hz, n_frames)?,
            n_read: 0,
            found: VecDeque::new(),
            is_over: false,
        }))
    }

    /// Provenance and timing.
    pub fn meta(&self) -> &PointsMeta {
        &self.meta
    }

    /// Share of the rows that were read, 0..=1.
    pub fn share_read(&self) -> f64 {
        // The number of rows in a damaged file may be another one.
        (self.n_read as f64 / self.reader.n_rows().max(1) as f64).min(1.0)
    }

    /// The next frame; `None` at the end.
    ///
    /// # Errors
    /// As [`read_points`].
    pub fn next_frame(&mut self) -> Result<Option<PointFrame>, DatasetError> {
        loop {
            if let Some(frame) = self.found.front()
                // More rows of the last frame may follow.
                && (self.found.len() > 1 || self.is_over)
            {
                if let Some(empty) = self.filler.next_before(frame) {
                    return Ok(Some(empty));
                }
                self.filler.pass(frame)?;
                return Ok(self.found.pop_front());
            }
            if self.is_over {
                return Ok(self.filler.next_at_end());
            }
            match self.reader.next_batch()? {
                Some(rows) => {
                    let mut frames: Vec<PointFrame> = self.found.drain(..).collect();
                    append_rows(&self.path, &rows, self.n_read, &mut frames)?;
                    self.found = frames.into();
                    self.n_read += rows.n_rows() as u64;
                }
                None => self.is_over = true,
            }
        }
    }
}

fn reader_of(path: &Path, file: File) -> Result<TableReader, DatasetError> {
    let file = guard::open_file(path, file, LIMITS)?;
    TableReader::new(path, file, BATCH_ROWS, is_points_column)
}

/// Median of the ratio of frame number steps to time steps, 1/s.
fn rate_from_times(frames: &[PointFrame]) -> Option<f64> {
    let rates = frames
        .windows(2)
        .map(|w| f64::from(w[1].frame - w[0].frame) / (w[1].time_s - w[0].time_s))
        .filter(|r| r.is_finite() && *r > 0.0);
    median_upper(rates)
}
