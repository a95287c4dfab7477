//! Points of one recording or simulation: Parquet, one row per point.
//!
//! Columns `frame` u32, `t_s` f64, then `x_m, y_m, z_m, range_m, velocity_mps, intensity_db` f32.
//! Axes: x right, y away from the radar, z up. The velocity is positive when receding. Properties of
//! the whole file are in the key-value metadata, see [`PointsMeta`].

use std::collections::HashMap;
use std::fs::File;
use std::path::Path;
use std::sync::Arc;

use arrow_array::{
    Array, ArrayRef, ArrowPrimitiveType, Float32Array, Float64Array, RecordBatch, UInt32Array,
    types,
};
use arrow_schema::{DataType, Field, Schema};
use parquet::arrow::ArrowWriter;
use parquet::basic::Compression;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use radarllm_base::{Clip, PointFrame, RadarPoint, stats::median_upper};

use super::atomic::write_atomic;
use super::guard::{self, Limits};
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
/// Rows decoded at a time.
const BATCH_ROWS: usize = 8192;
/// Rows encoded at a time: a multiple of the 1,024 rows after which the writer of Parquet files decides about pages, so that
/// the bytes of a file do not depend on it.
const WRITTEN_ROWS: usize = 64 << 10;

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
/// that trailing empty frames survive), `t0_s` (nominal time of frame 0) and, if any,
/// `missing_frames` (numbers absent from `frames`, as `3,7-9`).
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
    check_frames(path, meta, frames)?;
    let metadata = metadata_of(meta, frames)
        .into_iter()
        .map(|(key, value)| KeyValue::new(key.to_string(), value))
        .collect();
    let properties = WriterProperties::builder()
        .set_created_by(format!("radarllm-dataset {}", env!("CARGO_PKG_VERSION")))
        .set_compression(Compression::SNAPPY)
        .set_key_value_metadata(Some(metadata))
        .build();

    write_atomic(path, overwrite, |file| {
        let corrupt = |e: parquet::errors::ParquetError| DatasetError::of_writing(path, e);
        let mut writer =
            ArrowWriter::try_new(file, points_schema(), Some(properties)).map_err(corrupt)?;
        let mut rows = rows(frames).peekable();
        while rows.peek().is_some() {
            let batch = points_batch(rows.by_ref().take(WRITTEN_ROWS));
            let batch = batch.map_err(|e| DatasetError::corrupt(path, e))?;
            writer.write(&batch).map_err(corrupt)?;
        }
        writer.close().map_err(corrupt)?;
        Ok(())
    })
}

/// The points of frames as one Arrow batch with the columns of a points file. The metadata of its schema is that of
/// [`write_points`], so that [`points_from_batches`] restores frames without points.
///
/// # Errors
/// Frames that [`write_points`] would refuse.
pub fn points_to_batch(
    meta: &PointsMeta,
    frames: &[PointFrame],
) -> Result<RecordBatch, DatasetError> {
    let name = Path::new("points");
    check_frames(name, meta, frames)?;
    let corrupt = |e: arrow_schema::ArrowError| DatasetError::corrupt(name, e);
    let batch = points_batch(rows(frames)).map_err(corrupt)?;
    let metadata: HashMap<String, String> = metadata_of(meta, frames)
        .into_iter()
        .map(|(key, value)| (key.to_string(), value))
        .collect();
    let schema = batch.schema().as_ref().clone().with_metadata(metadata);
    batch.with_schema(Arc::new(schema)).map_err(corrupt)
}

/// Points from Arrow batches with the columns of a points file, of any program. `metadata` is that of their schema, or
/// what the caller states instead. `name` takes the place of the file in errors.
///
/// # Errors
/// As [`read_points`].
pub fn points_from_batches(
    name: &Path,
    metadata: &HashMap<String, String>,
    batches: impl IntoIterator<Item = Result<RecordBatch, arrow_schema::ArrowError>>,
) -> Result<PointsFile, DatasetError> {
    let mut frames: Vec<PointFrame> = Vec::new();
    let mut n_rows = 0_u64;
    for batch in batches {
        let batch = batch.map_err(|e| DatasetError::corrupt(name, e))?;
        let found = n_rows + batch.num_rows() as u64;
        if found > LIMITS.rows {
            return Err(DatasetError::Limit {
                path: name.into(),
                what: "number of points".into(),
                found,
                max: LIMITS.rows,
            });
        }
        append_batch(name, &batch, n_rows, &mut frames)?;
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
    let builder = guard::open_file(path, file, LIMITS, |_| None)?;
    let metadata: HashMap<String, String> = builder
        .metadata()
        .file_metadata()
        .key_value_metadata()
        .into_iter()
        .flatten()
        .filter_map(|kv| Some((kv.key.clone(), kv.value.clone()?)))
        .collect();
    let reader = guard::isolated(path, || {
        builder
            .with_batch_size(BATCH_ROWS)
            .build()
            .map_err(|e| DatasetError::corrupt(path, e))
    })?;

    let mut reader = reader;
    let mut frames: Vec<PointFrame> = Vec::new();
    let mut first_row = 0_u64;
    let mut saw_schema = false;
    while let Some(batch) = guard::isolated(path, || {
        reader
            .next()
            .transpose()
            .map_err(|e| DatasetError::corrupt(path, e))
    })? {
        saw_schema = true;
        append_batch(path, &batch, first_row, &mut frames)?;
        first_row += batch.num_rows() as u64;
    }
    if !saw_schema {
        // The file has no rows, but the columns must exist nevertheless.
        use arrow_array::RecordBatchReader as _;
        append_batch(
            path,
            &RecordBatch::new_empty(reader.schema()),
            0,
            &mut frames,
        )?;
    }
    complete(path, &metadata, frames)
}

/// The metadata of points: see [`write_points`].
fn metadata_of(meta: &PointsMeta, frames: &[PointFrame]) -> Vec<(&'static str, String)> {
    let n_frames = frames.last().map_or(0, |f| u64::from(f.frame) + 1);
    let t0_s = frames
        .first()
        .map_or(0.0, |f| f.time_s - f64::from(f.frame) / meta.frame_rate_hz);
    let mut metadata = vec![
        ("radar", meta.radar.clone()),
        ("source", meta.source.clone()),
        ("version", meta.version.clone()),
        ("n_frames", n_frames.to_string()),
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
    let missing = missing_frames(frames);
    if !missing.is_empty() {
        metadata.push(("missing_frames", missing));
    }
    metadata
}

fn check_frames(path: &Path, meta: &PointsMeta, frames: &[PointFrame]) -> Result<(), DatasetError> {
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
    let limit = |what: &str, found: u64, max: u64| {
        Err(DatasetError::Limit {
            path: path.to_path_buf(),
            what: what.into(),
            found,
            max,
        })
    };
    let mut row = 0_u64;
    for (i, frame) in frames.iter().enumerate() {
        let value = |column: &str, problem: String| {
            Err(DatasetError::Value {
                path: path.to_path_buf(),
                column: column.into(),
                row,
                problem,
            })
        };
        if u64::from(frame.frame) >= MAX_FRAMES {
            return limit("frame number", u64::from(frame.frame), MAX_FRAMES - 1);
        }
        if !frame.time_s.is_finite() {
            return value(
                "t_s",
                format!("frame {}: time is {}", frame.frame, frame.time_s),
            );
        }
        if let Some(before) = i.checked_sub(1).and_then(|b| frames.get(b))
            && (frame.frame <= before.frame || frame.time_s < before.time_s)
        {
            return value(
                "frame",
                format!(
                    "frame {} at {} s follows frame {} at {} s",
                    frame.frame, frame.time_s, before.frame, before.time_s
                ),
            );
        }
        for point in &frame.points {
            for (column, v) in VALUE_COLUMNS.into_iter().zip(fields_of(point)) {
                if !v.is_finite() {
                    return Err(DatasetError::Value {
                        path: path.to_path_buf(),
                        column: column.into(),
                        row,
                        problem: format!("is {v}"),
                    });
                }
            }
            row += 1;
        }
    }
    if row > LIMITS.rows {
        return limit("number of points", row, LIMITS.rows);
    }
    Ok(())
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

/// Numbers between 0 and the last frame that are not in `frames`, as `3,7-9`.
fn missing_frames(frames: &[PointFrame]) -> String {
    let mut gaps = Vec::new();
    let mut expected = 0_u32;
    for frame in frames {
        if frame.frame > expected {
            let last = frame.frame - 1;
            gaps.push(if last == expected {
                last.to_string()
            } else {
                format!("{expected}-{last}")
            });
        }
        expected = frame.frame.saturating_add(1);
    }
    gaps.join(",")
}

/// Inverse of [`missing_frames`]: inclusive ranges, increasing, below `n_frames`.
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

/// The points of frames, each with its frame.
fn rows(frames: &[PointFrame]) -> impl Iterator<Item = (&PointFrame, &RadarPoint)> {
    frames
        .iter()
        .flat_map(|f| f.points.iter().map(move |p| (f, p)))
}

fn points_schema() -> Arc<Schema> {
    let mut fields = vec![
        Field::new("frame", DataType::UInt32, false),
        Field::new("t_s", DataType::Float64, false),
    ];
    let values = VALUE_COLUMNS.into_iter();
    fields.extend(values.map(|name| Field::new(name, DataType::Float32, false)));
    Arc::new(Schema::new(fields))
}

fn points_batch<'a>(
    rows: impl Iterator<Item = (&'a PointFrame, &'a RadarPoint)>,
) -> Result<RecordBatch, arrow_schema::ArrowError> {
    let (mut frames, mut times_s) = (Vec::new(), Vec::new());
    let mut values: [Vec<f32>; VALUE_COLUMNS.len()] = Default::default();
    for (frame, point) in rows {
        frames.push(frame.frame);
        times_s.push(frame.time_s);
        for (column, value) in values.iter_mut().zip(fields_of(point)) {
            column.push(value);
        }
    }
    let mut columns: Vec<ArrayRef> = vec![
        Arc::new(UInt32Array::from(frames)),
        Arc::new(Float64Array::from(times_s)),
    ];
    for column in values {
        columns.push(Arc::new(Float32Array::from(column)));
    }
    RecordBatch::try_new(points_schema(), columns)
}

fn append_batch(
    path: &Path,
    batch: &RecordBatch,
    first_row: u64,
    frames: &mut Vec<PointFrame>,
) -> Result<(), DatasetError> {
    let number = numbers(path, batch, "frame", first_row)?;
    let time_s = numbers(path, batch, "t_s", first_row)?;
    let mut values = Vec::with_capacity(VALUE_COLUMNS.len());
    for name in VALUE_COLUMNS {
        values.push(numbers(path, batch, name, first_row)?);
    }
    for row in 0..batch.num_rows() {
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
        let mut v = [0.0_f32; 6];
        for (i, column) in values.iter().enumerate() {
            v[i] = column[row] as f32;
            if !v[i].is_finite() {
                return Err(bad(
                    VALUE_COLUMNS[i],
                    format!("{} does not fit a 32-bit float", column[row]),
                ));
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

/// A numeric column as f64, finite and without nulls. f64 holds every f32, i32 and u32 exactly.
fn numbers(
    path: &Path,
    batch: &RecordBatch,
    name: &str,
    first_row: u64,
) -> Result<Vec<f64>, DatasetError> {
    let expected = match name {
        "frame" => "a 32-bit unsigned integer",
        "t_s" => "a 64-bit float",
        _ => "a 32-bit float",
    };
    let column = batch
        .column_by_name(name)
        .ok_or_else(|| DatasetError::Column {
            path: path.to_path_buf(),
            column: name.into(),
            expected: expected.into(),
            found: "nothing".into(),
        })?;
    let bad = |row: usize, problem: String| DatasetError::Value {
        path: path.to_path_buf(),
        column: name.into(),
        row: first_row + row as u64,
        problem,
    };
    if let Some(row) = (0..column.len()).find(|&row| column.is_null(row)) {
        return Err(bad(row, "is null".into()));
    }
    let values = match column.data_type() {
        DataType::Float32 => primitive::<types::Float32Type>(column, f64::from),
        DataType::Float64 => primitive::<types::Float64Type>(column, |v| v),
        DataType::Int32 => primitive::<types::Int32Type>(column, f64::from),
        DataType::UInt32 => primitive::<types::UInt32Type>(column, f64::from),
        DataType::Int64 => primitive::<types::Int64Type>(column, |v| v as f64),
        DataType::UInt64 => primitive::<types::UInt64Type>(column, |v| v as f64),
        _ => None,
    }
    .ok_or_else(|| DatasetError::Column {
        path: path.to_path_buf(),
        column: name.into(),
        expected: expected.into(),
        found: column.data_type().to_string(),
    })?;
    match values.iter().position(|v| !v.is_finite()) {
        Some(row) => Err(bad(row, format!("is {}", values[row]))),
        None => Ok(values),
    }
}

fn primitive<T: ArrowPrimitiveType>(
    column: &ArrayRef,
    to_f64: impl Fn(T::Native) -> f64,
) -> Option<Vec<f64>> {
    let array = column
        .as_any()
        .downcast_ref::<arrow_array::PrimitiveArray<T>>()?;
    Some(array.values().iter().map(|&v| to_f64(v)).collect())
}

/// Adds the empty frames and the metadata.
fn complete(
    path: &Path,
    metadata: &HashMap<String, String>,
    found: Vec<PointFrame>,
) -> Result<PointsFile, DatasetError> {
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
    let frame_rate_hz = match number("frame_rate")? {
        Some(rate) if rate > 0.0 => rate,
        Some(rate) => return Err(bad("frame_rate", format!("must be positive, found {rate}"))),
        None => rate_from_times(&found).ok_or_else(|| {
            bad(
                "frame_rate",
                "absent, and the times of the frames do not tell it either".into(),
            )
        })?,
    };
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
    let seen = found.last().map_or(0, |f| u64::from(f.frame) + 1);
    let n_frames = match metadata.get("n_frames") {
        None => seen,
        Some(s) => s
            .trim()
            .parse()
            .map_err(|_| bad("n_frames", format!("{s:?} is not a count")))?,
    };
    if n_frames > MAX_FRAMES || n_frames < seen {
        return Err(bad(
            "n_frames",
            format!("{n_frames} is not in {seen}..={MAX_FRAMES}"),
        ));
    }
    let missing = match metadata.get("missing_frames") {
        None => Vec::new(),
        Some(s) => parse_missing(s, n_frames).ok_or_else(|| {
            bad(
                "missing_frames",
                "not increasing ranges below n_frames".into(),
            )
        })?,
    };
    let t0_s = match number("t0_s")? {
        Some(t0_s) => t0_s,
        None => found
            .first()
            .map_or(0.0, |f| f.time_s - f64::from(f.frame) / frame_rate_hz),
    };

    let mut frames = Vec::with_capacity(n_frames as usize);
    let mut found = found.into_iter().peekable();
    let mut missing = missing.into_iter().peekable();
    let mut latest_s = f64::NEG_INFINITY;
    for frame in 0..n_frames as u32 {
        if missing
            .next_if(|&(_, last)| last < u64::from(frame))
            .is_some()
        {
            // This range has passed; the next one, if any, starts later.
        }
        let lost = missing
            .peek()
            .is_some_and(|&(first, _)| first <= u64::from(frame));
        let next = match found.next_if(|f| f.frame == frame) {
            Some(_) if lost => {
                return Err(bad(
                    "missing_frames",
                    format!("frame {frame} has points but is listed as lost"),
                ));
            }
            Some(next) => next,
            None if lost => continue,
            // Nominal time of an empty frame, kept in order between measured times that jitter.
            None => {
                let nominal_s = t0_s + f64::from(frame) / frame_rate_hz;
                let upper_s = found.peek().map_or(f64::INFINITY, |f| f.time_s);
                PointFrame {
                    frame,
                    time_s: nominal_s.min(upper_s).max(latest_s),
                    points: Vec::new(),
                    board: None,
                }
            }
        };
        latest_s = next.time_s;
        frames.push(next);
    }
    let meta = PointsMeta {
        radar: text("radar"),
        source: text("source"),
        seed,
        version: text("version"),
        radar_height_m,
        frame_rate_hz,
    };
    Ok(PointsFile { meta, frames })
}

/// Median of the ratio of frame number steps to time steps, 1/s.
fn rate_from_times(frames: &[PointFrame]) -> Option<f64> {
    let rates = frames
        .windows(2)
        .map(|w| f64::from(w[1].frame - w[0].frame) / (w[1].time_s - w[0].time_s))
        .filter(|r| r.is_finite() && *r > 0.0);
    median_upper(rates)
}
