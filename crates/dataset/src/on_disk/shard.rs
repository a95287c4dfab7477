//! The columns of a shard: one Parquet row per clip.
//!
//! | column | type | content |
//! |---|---|---|
//! | `id`, `motion_id`, `group`, `split`, `action`, `source`, `radar` | utf8 | see [`ClipRecord`] |
//! | `captions` | list of utf8 | reference sentences |
//! | `radar_height_m` f32, `seed` u64 | | |
//! | `n_frames` u32, `n_points` u32, `duration_s` f32 | | sums over the next three columns |
//! | `frame_number` | list of u32 | radar frames |
//! | `frame_time_s` | list of f64 | s |
//! | `points` | list (frames) of list (points) of f32\[6\] | x, y, z, range in m, velocity in m/s, intensity in dB |
//! | `motion_fps` | f32 | rate of the next two |
//! | `joints` | list of f32\[22\]\[3\] | m, radar frame |
//! | `motion_features` | list of f32\[263\] | HumanML3D |
//! | `rotations6d` | list of f32\[22\]\[6\] | see [`ClipRecord::rotations6d`]; since version 2 |
//! | `body_height_m` | f32 | m; since version 2 |
//!
//! Shards of version 1 lack the last two columns; readers return them as unknown.
//!
//! The columns are plain nested lists with fixed-size inner lists, which Hugging Face `datasets` reads without a
//! schema of its own. Row groups are small ([`ROW_GROUP_CLIPS`]) so that a reader holds few clips.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use arrow_array::builder::{
    FixedSizeListBuilder, Float32Builder, Float64Builder, ListBuilder, StringBuilder, UInt32Builder,
};
use arrow_array::cast::AsArray;
use arrow_array::types::{Float32Type, Float64Type, UInt32Type, UInt64Type};
use arrow_array::{
    Array, ArrayRef, Float32Array, ListArray, RecordBatch, StringArray, UInt32Array, UInt64Array,
};
use arrow_schema::{DataType, Field, FieldRef, Schema, SchemaRef};
use parquet::arrow::arrow_reader::ParquetRecordBatchReader;
use parquet::arrow::{ArrowWriter, ProjectionMask};
use parquet::basic::Compression;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use radarllm_base::skeleton::N_JOINTS;
use radarllm_base::{PointFrame, RadarPoint};

use super::guard::{self, Limits};
use crate::{ClipRecord, DatasetError, MOTION_FEATURE_DIM, Split};

/// Column of [`ClipRecord::rotations6d`].
const ROTATIONS: &str = "rotations6d";
/// Column of [`ClipRecord::body_height_m`].
const BODY_HEIGHT: &str = "body_height_m";
/// Number of clips per row group.
pub const ROW_GROUP_CLIPS: usize = 32;
/// Limits of one shard.
const LIMITS: Limits = Limits {
    file_bytes: 16 << 30,
    rows: 1 << 20,
    chunk_values: 1 << 26,
};

/// Which columns a reader decodes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Columns {
    /// All columns.
    All,
    /// All columns except `joints`, `motion_features` and `rotations6d`, which are returned empty. This is several times
    /// faster.
    Points,
}

/// Summary of one clip that is available without decoding points.
#[derive(Clone, Debug, PartialEq)]
pub struct ClipSummary {
    /// See [`ClipRecord::id`].
    pub id: String,
    /// See [`ClipRecord::motion_id`].
    pub motion_id: String,
    /// See [`ClipRecord::split`].
    pub split: Split,
    /// See [`ClipRecord::action`].
    pub action: String,
    /// See [`ClipRecord::source`].
    pub source: String,
    /// See [`ClipRecord::captions`].
    pub captions: Vec<String>,
    /// Radar frames.
    pub n_frames: u32,
    /// Points of all frames.
    pub n_points: u32,
    /// Duration, s.
    pub duration_s: f32,
}

/// Writes clips as one Parquet file with the given key-value metadata. The bytes depend only on
/// the arguments.
pub(crate) fn write_shard(
    path: &Path,
    file: &mut File,
    records: &[ClipRecord],
    metadata: Vec<(String, String)>,
) -> Result<(), DatasetError> {
    let corrupt = |e: parquet::errors::ParquetError| DatasetError::of_writing(path, e);
    let metadata = metadata
        .into_iter()
        .map(|(key, value)| KeyValue::new(key, value))
        .collect();
    let mut properties = WriterProperties::builder()
        .set_created_by(format!("radarllm-dataset {}", env!("CARGO_PKG_VERSION")))
        .set_compression(Compression::SNAPPY)
        .set_key_value_metadata(Some(metadata));
    // Measured values rarely repeat: a dictionary would be built, found useless and dropped.
    for column in ["points", "joints", "motion_features", ROTATIONS] {
        let leaf = leaf_path(column);
        properties = properties.set_column_dictionary_enabled(leaf, false);
    }
    let mut writer = ArrowWriter::try_new(file, schema(Columns::All), Some(properties.build()))
        .map_err(corrupt)?;
    for clips in records.chunks(ROW_GROUP_CLIPS) {
        let batch = batch_of(clips).map_err(|e| DatasetError::corrupt(path, e))?;
        writer.write(&batch).map_err(corrupt)?;
        writer.flush().map_err(corrupt)?;
    }
    writer.close().map_err(corrupt)?;
    Ok(())
}

/// Streams the clips of one shard, in file order. Values are decoded but not checked: see
/// [`crate::check_record`].
pub struct ShardReader {
    path: PathBuf,
    reader: ParquetRecordBatchReader,
    /// Decoded rows not yet returned, last first.
    ready: Vec<ClipRecord>,
    n_rows: u64,
    next_row: u64,
    failed: bool,
}

impl Columns {
    fn has(self, name: &str) -> bool {
        match self {
            Self::All => true,
            Self::Points => !["joints", "motion_features", ROTATIONS].contains(&name),
        }
    }
}

impl ShardReader {
    /// Opens a shard.
    ///
    /// # Errors
    /// Missing or unexpected columns, sizes beyond the limits, damaged bytes.
    pub fn open(path: &Path, columns: Columns) -> Result<Self, DatasetError> {
        let (reader, n_rows) = open_projected(path, |name| columns.has(name))?;
        Ok(Self {
            path: path.into(),
            reader,
            ready: Vec::new(),
            n_rows,
            next_row: 0,
            failed: false,
        })
    }

    /// Rows of the file.
    pub fn n_rows(&self) -> u64 {
        self.n_rows
    }

    fn advance(&mut self) -> Result<Option<ClipRecord>, DatasetError> {
        if self.ready.is_empty() {
            let (path, reader) = (&self.path, &mut self.reader);
            let Some(batch) = guard::isolated(path, || next_batch(path, reader))? else {
                return Ok(None);
            };
            self.ready = guard::isolated(path, || clips_of(path, &batch, self.next_row))?;
            self.next_row += batch.num_rows() as u64;
            self.ready.reverse();
        }
        Ok(self.ready.pop())
    }
}

impl Iterator for ShardReader {
    type Item = Result<ClipRecord, DatasetError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.failed {
            return None;
        }
        let item = self.advance().transpose();
        self.failed = matches!(item, Some(Err(_)));
        item
    }
}

/// Streams the rows of one shard as Arrow batches with the columns of [`schema`].
pub(crate) struct BatchReader {
    path: PathBuf,
    columns: Columns,
    reader: ParquetRecordBatchReader,
}

impl BatchReader {
    pub(crate) fn open(path: &Path, columns: Columns) -> Result<Self, DatasetError> {
        let (reader, _) = open_projected(path, |name| columns.has(name))?;
        Ok(Self {
            path: path.into(),
            columns,
            reader,
        })
    }

    /// The next batch; `None` at the end.
    pub(crate) fn next_batch(&mut self) -> Result<Option<RecordBatch>, DatasetError> {
        let (path, reader) = (&self.path, &mut self.reader);
        let Some(batch) = guard::isolated(path, || next_batch(path, reader))? else {
            return Ok(None);
        };
        // The columns of the file may be in another order, and its schema may have metadata.
        let schema = schema(self.columns);
        let columns = schema
            .fields()
            .iter()
            .map(|field| {
                let column = batch.column_by_name(field.name()).cloned();
                let column = column.or_else(|| unknown_column(field.name(), batch.num_rows()));
                column.ok_or_else(|| {
                    DatasetError::corrupt(path, format!("no column `{}`", field.name()))
                })
            })
            .collect::<Result<Vec<ArrayRef>, _>>()?;
        let batch = RecordBatch::try_new(schema, columns);
        batch.map(Some).map_err(|e| DatasetError::corrupt(path, e))
    }
}

/// Reads the [`ClipSummary`] of every clip of a shard.
pub(crate) fn read_summaries(path: &Path) -> Result<Vec<ClipSummary>, DatasetError> {
    let wanted = [
        "id",
        "motion_id",
        "split",
        "action",
        "source",
        "captions",
        "n_frames",
        "n_points",
        "duration_s",
    ];
    let (mut reader, _) = open_projected(path, |name| wanted.contains(&name))?;
    let mut clips = Vec::new();
    while let Some(batch) = guard::isolated(path, || next_batch(path, &mut reader))? {
        let first_row = clips.len() as u64;
        clips.extend(guard::isolated(path, || {
            summaries_of(path, &batch, first_row)
        })?);
    }
    Ok(clips)
}

/// Radar time covered by a clip, s: from the first frame to the last plus one mean period. For
/// a single frame, it is the length of the motion.
pub(crate) fn duration_s(record: &ClipRecord) -> f32 {
    let n = record.frames.len();
    let from_frames = match (record.frames.first(), record.frames.last()) {
        (Some(first), Some(last)) if n > 1 => {
            (last.time_s - first.time_s) * n as f64 / (n - 1) as f64
        }
        _ => 0.0,
    };
    if from_frames > 0.0 {
        return from_frames as f32;
    }
    let n_poses = record
        .joints
        .len()
        .max(record.motion_features.len() / MOTION_FEATURE_DIM);
    n_poses as f32 / record.motion_fps
}

fn element(kind: DataType) -> FieldRef {
    Arc::new(Field::new("element", kind, false))
}

fn list(kind: DataType) -> DataType {
    DataType::List(element(kind))
}

fn fixed(kind: DataType, length: i32) -> DataType {
    DataType::FixedSizeList(element(kind), length)
}

/// The columns of a shard that are asked for.
pub(crate) fn schema(columns: Columns) -> SchemaRef {
    let field = |name: &str, kind| Field::new(name, kind, false);
    let mut fields = vec![
        field("id", DataType::Utf8),
        field("motion_id", DataType::Utf8),
        field("group", DataType::Utf8),
        field("split", DataType::Utf8),
        field("action", DataType::Utf8),
        field("captions", list(DataType::Utf8)),
        field("source", DataType::Utf8),
        field("radar", DataType::Utf8),
        field("radar_height_m", DataType::Float32),
        field("seed", DataType::UInt64),
        field("n_frames", DataType::UInt32),
        field("n_points", DataType::UInt32),
        field("duration_s", DataType::Float32),
        field("frame_number", list(DataType::UInt32)),
        field("frame_time_s", list(DataType::Float64)),
        field("points", list(list(fixed(DataType::Float32, 6)))),
        field("motion_fps", DataType::Float32),
        field(
            "joints",
            list(fixed(fixed(DataType::Float32, 3), N_JOINTS as i32)),
        ),
        field(
            "motion_features",
            list(fixed(DataType::Float32, MOTION_FEATURE_DIM as i32)),
        ),
        field(
            ROTATIONS,
            list(fixed(fixed(DataType::Float32, 6), N_JOINTS as i32)),
        ),
        field(BODY_HEIGHT, DataType::Float32),
    ];
    fields.retain(|field| columns.has(field.name()));
    Arc::new(Schema::new(fields))
}

/// The columns of a shard with the columns `has`: those of version 2, or those of version 1 if it lacks the new ones.
fn schema_of_file(has: impl Fn(&str) -> bool) -> SchemaRef {
    let all = schema(Columns::All);
    let is_there = |field: &&FieldRef| !is_new(field.name()) || has(field.name());
    let fields: Vec<FieldRef> = all.fields().iter().filter(is_there).cloned().collect();
    Arc::new(Schema::new(fields))
}

/// Whether shards of version 1 lack a column.
fn is_new(name: &str) -> bool {
    [ROTATIONS, BODY_HEIGHT].contains(&name)
}

/// A column that shards of version 1 lack, as unknown for `n` clips; `None` for other columns.
fn unknown_column(name: &str, n: usize) -> Option<ArrayRef> {
    match name {
        ROTATIONS => {
            let mut rotations = rotations_builder();
            (0..n).for_each(|_| rotations.append(true));
            Some(Arc::new(rotations.finish()))
        }
        BODY_HEIGHT => Some(Arc::new(Float32Array::from(vec![0.0; n]))),
        _ => None,
    }
}

/// Builder of a `list of f32[N_JOINTS][width]`.
type PoseBuilder = ListBuilder<FixedSizeListBuilder<FixedSizeListBuilder<Float32Builder>>>;

fn pose_builder(width: i32) -> PoseBuilder {
    let joint = FixedSizeListBuilder::new(Float32Builder::new(), width)
        .with_field(element(DataType::Float32));
    let pose = FixedSizeListBuilder::new(joint, N_JOINTS as i32)
        .with_field(element(fixed(DataType::Float32, width)));
    ListBuilder::new(pose).with_field(element(fixed(
        fixed(DataType::Float32, width),
        N_JOINTS as i32,
    )))
}

fn rotations_builder() -> PoseBuilder {
    pose_builder(6)
}

/// Appends the poses of one clip.
fn append_poses<const N: usize>(column: &mut PoseBuilder, poses: &[[[f32; N]; N_JOINTS]]) {
    for pose in poses {
        for joint in pose {
            column.values().values().values().append_slice(joint);
            column.values().values().append(true);
        }
        column.values().append(true);
    }
    column.append(true);
}

/// Parquet path of a nested column's only leaf.
fn leaf_path(column: &str) -> parquet::schema::types::ColumnPath {
    let depth = if column == "motion_features" { 2 } else { 3 };
    let mut parts = vec![column.to_string()];
    for _ in 0..depth {
        parts.push("list".into());
        parts.push("element".into());
    }
    parquet::schema::types::ColumnPath::new(parts)
}

fn batch_of(clips: &[ClipRecord]) -> Result<RecordBatch, arrow_schema::ArrowError> {
    let text = |f: fn(&ClipRecord) -> &str| -> ArrayRef {
        Arc::new(StringArray::from_iter_values(clips.iter().map(f)))
    };
    let n_points = |c: &ClipRecord| c.frames.iter().map(|f| f.points.len()).sum::<usize>() as u32;

    let mut captions = ListBuilder::new(StringBuilder::new()).with_field(element(DataType::Utf8));
    let mut frame_number =
        ListBuilder::new(UInt32Builder::new()).with_field(element(DataType::UInt32));
    let mut frame_time_s =
        ListBuilder::new(Float64Builder::new()).with_field(element(DataType::Float64));
    let point =
        FixedSizeListBuilder::new(Float32Builder::new(), 6).with_field(element(DataType::Float32));
    let frame = ListBuilder::new(point).with_field(element(fixed(DataType::Float32, 6)));
    let mut points = ListBuilder::new(frame).with_field(element(list(fixed(DataType::Float32, 6))));
    let (mut joints, mut rotations) = (pose_builder(3), rotations_builder());
    let dim = MOTION_FEATURE_DIM as i32;
    let vector = FixedSizeListBuilder::new(Float32Builder::new(), dim)
        .with_field(element(DataType::Float32));
    let mut features = ListBuilder::new(vector).with_field(element(fixed(DataType::Float32, dim)));

    for clip in clips {
        clip.captions
            .iter()
            .for_each(|c| captions.values().append_value(c));
        captions.append(true);
        for frame in &clip.frames {
            frame_number.values().append_value(frame.frame);
            frame_time_s.values().append_value(frame.time_s);
            let frame_points = points.values();
            for p in &frame.points {
                let row = [
                    p.x_m,
                    p.y_m,
                    p.z_m,
                    p.range_m,
                    p.velocity_mps,
                    p.intensity_db,
                ];
                frame_points.values().values().append_slice(&row);
                frame_points.values().append(true);
            }
            frame_points.append(true);
        }
        frame_number.append(true);
        frame_time_s.append(true);
        points.append(true);
        append_poses(&mut joints, &clip.joints);
        append_poses(&mut rotations, &clip.rotations6d);
        for vector in clip.motion_features.chunks_exact(MOTION_FEATURE_DIM) {
            features.values().values().append_slice(vector);
            features.values().append(true);
        }
        features.append(true);
    }

    RecordBatch::try_new(
        schema(Columns::All),
        vec![
            text(|c| &c.id),
            text(|c| &c.motion_id),
            text(|c| &c.group),
            text(|c| c.split.name()),
            text(|c| &c.action),
            Arc::new(captions.finish()),
            text(|c| &c.source),
            text(|c| &c.radar),
            Arc::new(Float32Array::from_iter_values(
                clips.iter().map(|c| c.radar_height_m),
            )),
            Arc::new(UInt64Array::from_iter_values(clips.iter().map(|c| c.seed))),
            Arc::new(UInt32Array::from_iter_values(
                clips.iter().map(|c| c.frames.len() as u32),
            )),
            Arc::new(UInt32Array::from_iter_values(clips.iter().map(n_points))),
            Arc::new(Float32Array::from_iter_values(clips.iter().map(duration_s))),
            Arc::new(frame_number.finish()),
            Arc::new(frame_time_s.finish()),
            Arc::new(points.finish()),
            Arc::new(Float32Array::from_iter_values(
                clips.iter().map(|c| c.motion_fps),
            )),
            Arc::new(joints.finish()),
            Arc::new(features.finish()),
            Arc::new(rotations.finish()),
            Arc::new(Float32Array::from_iter_values(
                clips.iter().map(|c| c.body_height_m),
            )),
        ],
    )
}

fn open_projected(
    path: &Path,
    wanted: impl Fn(&str) -> bool,
) -> Result<(ParquetRecordBatchReader, u64), DatasetError> {
    let builder = guard::open(path, LIMITS, |found| {
        let has = |name: &str| {
            found
                .root_schema()
                .get_fields()
                .iter()
                .any(|f| f.name() == name)
        };
        Some(schema_of_file(has))
    })?;
    let n_rows = builder.metadata().file_metadata().num_rows().max(0) as u64;
    let reader = guard::isolated(path, || {
        let columns = (0..)
            .zip(builder.schema().fields())
            .filter(|(_, f)| wanted(f.name()));
        let mask = ProjectionMask::roots(
            builder.parquet_schema(),
            columns.map(|(i, _)| i).collect::<Vec<usize>>(),
        );
        builder
            .with_projection(mask)
            .with_batch_size(ROW_GROUP_CLIPS)
            .build()
            .map_err(|e| DatasetError::corrupt(path, e))
    })?;
    Ok((reader, n_rows))
}

fn next_batch(
    path: &Path,
    reader: &mut ParquetRecordBatchReader,
) -> Result<Option<RecordBatch>, DatasetError> {
    reader
        .next()
        .transpose()
        .map_err(|e| DatasetError::corrupt(path, e))
}

/// Typed access to the columns of a batch.
struct Access<'a> {
    path: &'a Path,
    batch: &'a RecordBatch,
}

impl<'a> Access<'a> {
    fn column(&self, name: &str) -> Result<&'a ArrayRef, DatasetError> {
        let column = self
            .batch
            .column_by_name(name)
            .ok_or_else(|| self.wrong(name, "nothing"))?;
        if column.null_count() > 0 {
            return Err(self.wrong(name, "nulls"));
        }
        Ok(column)
    }

    fn wrong(&self, name: &str, found: &str) -> DatasetError {
        let expected = schema(Columns::All)
            .field_with_name(name)
            .map_or_else(|_| name.into(), |f| f.data_type().to_string());
        DatasetError::Column {
            path: self.path.into(),
            column: name.into(),
            expected,
            found: found.into(),
        }
    }

    fn text(&self, name: &str) -> Result<&'a StringArray, DatasetError> {
        self.column(name)?
            .as_string_opt::<i32>()
            .ok_or_else(|| self.wrong(name, "another type"))
    }

    fn u32(&self, name: &str) -> Result<&'a [u32], DatasetError> {
        let array = self.column(name)?.as_primitive_opt::<UInt32Type>();
        Ok(array
            .ok_or_else(|| self.wrong(name, "another type"))?
            .values())
    }

    fn u64(&self, name: &str) -> Result<&'a [u64], DatasetError> {
        let array = self.column(name)?.as_primitive_opt::<UInt64Type>();
        Ok(array
            .ok_or_else(|| self.wrong(name, "another type"))?
            .values())
    }

    fn f32(&self, name: &str) -> Result<&'a [f32], DatasetError> {
        let array = self.column(name)?.as_primitive_opt::<Float32Type>();
        Ok(array
            .ok_or_else(|| self.wrong(name, "another type"))?
            .values())
    }

    fn list(&self, name: &str) -> Result<&'a ListArray, DatasetError> {
        self.column(name)?
            .as_list_opt::<i32>()
            .ok_or_else(|| self.wrong(name, "another type"))
    }

    fn captions(&self) -> Result<Vec<Vec<String>>, DatasetError> {
        let lists = self.list("captions")?;
        let texts = lists
            .values()
            .as_string_opt::<i32>()
            .ok_or_else(|| self.wrong("captions", "another type"))?;
        Ok((0..lists.len())
            .map(|row| {
                range_of(lists, row)
                    .map(|i| texts.value(i).to_string())
                    .collect()
            })
            .collect())
    }

    fn splits(&self, first_row: u64) -> Result<Vec<Split>, DatasetError> {
        let names = self.text("split")?;
        (0..names.len())
            .map(|row| {
                Split::from_name(names.value(row)).ok_or_else(|| DatasetError::Value {
                    path: self.path.into(),
                    column: "split".into(),
                    row: first_row + row as u64,
                    problem: format!("{:?} is not train, val or test", names.value(row)),
                })
            })
            .collect()
    }

    /// A `list of f32[..]` column as its flat values and the lists that index blocks of them.
    fn blocks(
        &self,
        name: &str,
        n_fixed: usize,
    ) -> Result<(&'a ListArray, &'a [f32]), DatasetError> {
        let lists = self.list(name)?;
        Ok((lists, self.flat(name, lists.values(), n_fixed)?))
    }

    fn flat(
        &self,
        name: &str,
        array: &'a ArrayRef,
        n_fixed: usize,
    ) -> Result<&'a [f32], DatasetError> {
        let mut array = array;
        for _ in 0..n_fixed {
            let fixed = array
                .as_fixed_size_list_opt()
                .ok_or_else(|| self.wrong(name, "another type"))?;
            array = fixed.values();
        }
        let leaf = array
            .as_primitive_opt::<Float32Type>()
            .ok_or_else(|| self.wrong(name, "another type"))?;
        Ok(leaf.values())
    }
}

/// Children of one row of a list. Arrow guarantees increasing offsets within the child's length.
fn range_of(lists: &ListArray, row: usize) -> std::ops::Range<usize> {
    let offsets = lists.value_offsets();
    offsets[row] as usize..offsets[row + 1] as usize
}

fn clips_of(
    path: &Path,
    batch: &RecordBatch,
    first_row: u64,
) -> Result<Vec<ClipRecord>, DatasetError> {
    let access = Access { path, batch };
    let (id, motion_id, group) = (
        access.text("id")?,
        access.text("motion_id")?,
        access.text("group")?,
    );
    let (action, source, radar) = (
        access.text("action")?,
        access.text("source")?,
        access.text("radar")?,
    );
    let splits = access.splits(first_row)?;
    let mut captions = access.captions()?;
    let (radar_height_m, motion_fps) = (access.f32("radar_height_m")?, access.f32("motion_fps")?);
    let seed = access.u64("seed")?;
    let (n_frames, n_points) = (access.u32("n_frames")?, access.u32("n_points")?);
    let numbers = access.list("frame_number")?;
    let number_values = numbers
        .values()
        .as_primitive_opt::<UInt32Type>()
        .ok_or_else(|| access.wrong("frame_number", "another type"))?
        .values();
    let times = access.list("frame_time_s")?;
    let time_values = times
        .values()
        .as_primitive_opt::<Float64Type>()
        .ok_or_else(|| access.wrong("frame_time_s", "another type"))?
        .values();
    let clouds = access.list("points")?;
    let frames = clouds
        .values()
        .as_list_opt::<i32>()
        .ok_or_else(|| access.wrong("points", "another type"))?;
    let point_values = access.flat("points", frames.values(), 1)?;
    let has_motion = batch.column_by_name("joints").is_some();
    let joints = if has_motion {
        Some(access.blocks("joints", 2)?)
    } else {
        None
    };
    let features = if has_motion {
        Some(access.blocks("motion_features", 1)?)
    } else {
        None
    };
    // Shards of version 1 have neither of the next two.
    let has = |name: &str| batch.column_by_name(name).is_some();
    let rotations = match has(ROTATIONS) {
        true => Some(access.blocks(ROTATIONS, 2)?),
        false => None,
    };
    let body_height_m = match has(BODY_HEIGHT) {
        true => Some(access.f32(BODY_HEIGHT)?),
        false => None,
    };

    let mut clips = Vec::with_capacity(batch.num_rows());
    for row in 0..batch.num_rows() {
        let bad = |column: &str, problem: String| DatasetError::Value {
            path: path.into(),
            column: column.into(),
            row: first_row + row as u64,
            problem,
        };
        let (rows, row_numbers, row_times) = (
            range_of(clouds, row),
            range_of(numbers, row),
            range_of(times, row),
        );
        if row_numbers.len() != rows.len()
            || row_times.len() != rows.len()
            || n_frames[row] as usize != rows.len()
        {
            return Err(bad(
                "points",
                format!(
                    "{} frames, but {} numbers, {} times and n_frames = {}",
                    rows.len(),
                    row_numbers.len(),
                    row_times.len(),
                    n_frames[row]
                ),
            ));
        }
        let mut clip_frames = Vec::with_capacity(rows.len());
        for ((frame_row, &frame), &time_s) in rows
            .zip(&number_values[row_numbers])
            .zip(&time_values[row_times])
        {
            let block = range_of(frames, frame_row);
            let points = point_values[block.start * 6..block.end * 6]
                .chunks_exact(6)
                .map(|v| RadarPoint {
                    x_m: v[0],
                    y_m: v[1],
                    z_m: v[2],
                    range_m: v[3],
                    velocity_mps: v[4],
                    intensity_db: v[5],
                });
            clip_frames.push(PointFrame {
                frame,
                time_s,
                points: points.collect(),
                board: None,
            });
        }
        let counted: usize = clip_frames.iter().map(|f| f.points.len()).sum();
        if counted != n_points[row] as usize {
            return Err(bad(
                "n_points",
                format!("{} but the clip has {counted} points", n_points[row]),
            ));
        }
        let motion_features = features.map_or_else(Vec::new, |(lists, values)| {
            let block = range_of(lists, row);
            values[block.start * MOTION_FEATURE_DIM..block.end * MOTION_FEATURE_DIM].to_vec()
        });
        clips.push(ClipRecord {
            id: id.value(row).into(),
            motion_id: motion_id.value(row).into(),
            group: group.value(row).into(),
            split: splits[row],
            action: action.value(row).into(),
            captions: std::mem::take(&mut captions[row]),
            source: source.value(row).into(),
            radar: radar.value(row).into(),
            radar_height_m: radar_height_m[row],
            seed: seed[row],
            frames: clip_frames,
            motion_fps: motion_fps[row],
            joints: joints.map_or_else(Vec::new, |column| poses_of(column, row)),
            motion_features,
            rotations6d: rotations.map_or_else(Vec::new, |column| poses_of(column, row)),
            body_height_m: body_height_m.map_or(0.0, |values| values[row]),
        });
    }
    Ok(clips)
}

/// Poses of one clip, `[frame][joint][N]`.
fn poses_of<const N: usize>(
    (lists, values): (&ListArray, &[f32]),
    row: usize,
) -> Vec<[[f32; N]; N_JOINTS]> {
    let (block, width) = (range_of(lists, row), N_JOINTS * N);
    let poses = values[block.start * width..block.end * width].chunks_exact(width);
    poses
        .map(|v| std::array::from_fn(|j| std::array::from_fn(|i| v[j * N + i])))
        .collect()
}

fn summaries_of(
    path: &Path,
    batch: &RecordBatch,
    first_row: u64,
) -> Result<Vec<ClipSummary>, DatasetError> {
    let access = Access { path, batch };
    let (id, motion_id) = (access.text("id")?, access.text("motion_id")?);
    let (action, source) = (access.text("action")?, access.text("source")?);
    let splits = access.splits(first_row)?;
    let captions = access.captions()?;
    let (n_frames, n_points) = (access.u32("n_frames")?, access.u32("n_points")?);
    let duration_s = access.f32("duration_s")?;
    let rows = captions.into_iter().enumerate();
    Ok(rows
        .map(|(row, captions)| ClipSummary {
            id: id.value(row).into(),
            motion_id: motion_id.value(row).into(),
            split: splits[row],
            action: action.value(row).into(),
            source: source.value(row).into(),
            captions,
            n_frames: n_frames[row],
            n_points: n_points[row],
            duration_s: duration_s[row],
        })
        .collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn clip() -> ClipRecord {
        ClipRecord {
            id: "walk-1#0".into(),
            motion_id: "walk-1".into(),
            group: "walk-1".into(),
            split: Split::Train,
            action: "walk".into(),
            captions: vec!["a person walks".into()],
            source: "procedural".into(),
            radar: "awr1843boost".into(),
            radar_height_m: 1.0,
            seed: 3,
            frames: Vec::new(),
            motion_fps: 20.0,
            joints: vec![[[1.0, 2.0, 3.0]; N_JOINTS]; 2],
            motion_features: vec![0.5; MOTION_FEATURE_DIM],
            rotations6d: vec![[[1.0, 0.0, 0.0, 0.0, 1.0, 0.0]; N_JOINTS]; 2],
            body_height_m: 1.7,
        }
    }

    /// Shards of version 1 have neither rotations nor heights, and are read with both unknown.
    #[test]
    fn shards_of_version_1_are_read() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("old.parquet");
        let batch = batch_of(&[clip()]).unwrap();
        let old: Vec<usize> = (0..batch.num_columns())
            .filter(|i| !is_new(batch.schema().field(*i).name()))
            .collect();
        let batch = batch.project(&old).unwrap();
        assert_eq!(batch.num_columns(), schema(Columns::All).fields().len() - 2);
        let file = File::create(&path).unwrap();
        let mut writer = ArrowWriter::try_new(file, batch.schema(), None).unwrap();
        writer.write(&batch).unwrap();
        writer.close().unwrap();

        let read: Vec<ClipRecord> = ShardReader::open(&path, Columns::All)
            .unwrap()
            .map(Result::unwrap)
            .collect();
        let expected = ClipRecord {
            rotations6d: Vec::new(),
            body_height_m: 0.0,
            ..clip()
        };
        assert_eq!(read, [expected]);
        // Batches have the columns of today, so that data sets of both versions can be joined.
        let mut batches = BatchReader::open(&path, Columns::All).unwrap();
        let batch = batches.next_batch().unwrap().unwrap();
        assert_eq!(batch.schema(), schema(Columns::All));
        assert_eq!(read_summaries(&path).unwrap().len(), 1);
    }
}
