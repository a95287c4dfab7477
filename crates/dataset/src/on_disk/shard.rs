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
//! The columns are plain nested lists, which Hugging Face `datasets` reads without a schema of its own; Parquet has no type
//! for lists of fixed length, so that readers check it. Row groups are small ([`ROW_GROUP_CLIPS`]) so that a reader holds few clips.

use std::fs::File;
use std::ops::Range;
use std::path::{Path, PathBuf};

use parquet::basic::Compression;
use parquet::file::properties::WriterProperties;
use radarllm_base::skeleton::N_JOINTS;
use radarllm_base::{PointFrame, RadarPoint};

use super::guard::{self, Limits};
use super::levels::{TableReader, TableWriter};
use super::table::{Column, List, Offsets, Table, Values};
use crate::{ClipRecord, DatasetError, MOTION_FEATURE_DIM, Split};

/// Column of [`ClipRecord::rotations6d`].
const ROTATIONS: &str = "rotations6d";
/// Column of [`ClipRecord::body_height_m`].
const BODY_HEIGHT: &str = "body_height_m";
/// Values of a point.
const N_VALUES: usize = 6;
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
    let failed = |e: parquet::errors::ParquetError| DatasetError::of_writing(path, e);
    let mut properties = WriterProperties::builder()
        .set_created_by(format!("radarllm-dataset {}", env!("CARGO_PKG_VERSION")))
        .set_compression(Compression::SNAPPY);
    // Measured values rarely repeat: a dictionary would be built, found useless and dropped.
    for column in ["points", "joints", "motion_features", ROTATIONS] {
        let leaf = leaf_path(column);
        properties = properties.set_column_dictionary_enabled(leaf, false);
    }
    let mut writer = TableWriter::new(file, &table_of(&[]), properties.build()).map_err(failed)?;
    for (key, value) in metadata {
        writer.add_metadata(&key, value);
    }
    for clips in records.chunks(ROW_GROUP_CLIPS) {
        writer.write(&table_of(clips)).map_err(failed)?;
    }
    writer.close().map_err(failed)
}

/// Streams the clips of one shard, in file order. Values are decoded but not checked: see
/// [`crate::check_record`].
pub struct ShardReader {
    path: PathBuf,
    reader: TableReader,
    /// Decoded rows not yet returned, last first.
    ready: Vec<ClipRecord>,
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
        Ok(Self {
            path: path.into(),
            reader: reader_of(path, |name| columns.has(name))?,
            ready: Vec::new(),
            next_row: 0,
            failed: false,
        })
    }

    /// Rows of the file.
    pub fn n_rows(&self) -> u64 {
        self.reader.n_rows()
    }

    fn advance(&mut self) -> Result<Option<ClipRecord>, DatasetError> {
        if self.ready.is_empty() {
            let Some(rows) = self.reader.next_batch()? else {
                return Ok(None);
            };
            self.ready = clips_of(&self.path, &rows, self.next_row)?;
            self.next_row += rows.n_rows() as u64;
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

/// Streams the rows of one shard as tables with the columns of today.
pub(crate) struct BatchReader {
    path: PathBuf,
    columns: Columns,
    reader: TableReader,
}

impl BatchReader {
    pub(crate) fn open(path: &Path, columns: Columns) -> Result<Self, DatasetError> {
        Ok(Self {
            path: path.into(),
            columns,
            reader: reader_of(path, |name| columns.has(name))?,
        })
    }

    /// The next rows; `None` at the end.
    pub(crate) fn next_batch(&mut self) -> Result<Option<Table>, DatasetError> {
        let Some(mut rows) = self.reader.next_batch()? else {
            return Ok(None);
        };
        let n = rows.n_rows();
        // The columns of the file may be in another order, and lists in it have no fixed length.
        let columns =
            no_rows(self.columns).columns.into_iter().map(|expected| {
                let name = &expected.name;
                let found = rows.columns.iter().position(|column| column.name == *name);
                match found.map(|i| rows.columns.swap_remove(i)) {
                    Some(column) => conform(column, &expected)
                        .map_err(|found| wrong(&self.path, &expected, &found)),
                    None => unknown_column(name, n)
                        .ok_or_else(|| wrong(&self.path, &expected, "nothing")),
                }
            });
        Ok(Some(Table {
            columns: columns.collect::<Result<_, _>>()?,
            metadata: Vec::new(),
        }))
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
    let mut reader = reader_of(path, |name| wanted.contains(&name))?;
    let mut clips = Vec::new();
    while let Some(rows) = reader.next_batch()? {
        let first_row = clips.len() as u64;
        clips.extend(summaries_of(path, &rows, first_row)?);
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

/// The columns of a shard that are asked for, without rows.
pub(crate) fn no_rows(columns: Columns) -> Table {
    let mut table = table_of(&[]);
    table.columns.retain(|column| columns.has(&column.name));
    table
}

/// A column that shards of version 1 lack, as unknown for `n` clips; `None` for other columns.
fn unknown_column(name: &str, n: usize) -> Option<Column> {
    match name {
        ROTATIONS => {
            let mut rotations = FixedLists::default();
            (0..n).for_each(|_| rotations.offsets.push(0));
            Some(rotations.column(ROTATIONS, &[6, N_JOINTS]))
        }
        BODY_HEIGHT => Some(Column::new(BODY_HEIGHT, Values::F32(vec![0.0; n]))),
        _ => None,
    }
}

/// A column of a file with the type of `expected`: lists get the length that they must have. The type that was found instead
/// is the error.
fn conform(column: Column, expected: &Column) -> Result<Column, String> {
    match () {
        () if column.has_nulls() => Err("nulls".into()),
        () if fits(&column, expected) => Ok(conformed(column, expected)),
        () => Err(column.type_name()),
    }
}

fn fits(column: &Column, expected: &Column) -> bool {
    let is_like = match (&column.values, &expected.values) {
        (Values::List(lists), Values::List(expected)) => {
            let length_fits = expected.length().is_none_or(|n| lists.all_have(n));
            length_fits && fits(lists.element(), expected.element())
        }
        (found, expected) => std::mem::discriminant(found) == std::mem::discriminant(expected),
    };
    is_like && !column.has_nulls()
}

/// A column that [`fits`], with the names and lengths of `expected`.
fn conformed(column: Column, expected: &Column) -> Column {
    let values = match (column.values, &expected.values) {
        (Values::List(lists), Values::List(expected)) => {
            Values::List(lists.map_element(expected.length(), |element| {
                conformed(element, expected.element())
            }))
        }
        (values, _) => values,
    };
    Column::new(&expected.name, values)
}

fn wrong(path: &Path, expected: &Column, found: &str) -> DatasetError {
    DatasetError::Column {
        path: path.into(),
        column: expected.name.clone(),
        expected: expected.type_name(),
        found: found.into(),
    }
}

/// Lists of a number of elements of fixed length each, as which poses and vectors are stored.
struct FixedLists {
    offsets: Offsets,
    values: Vec<f32>,
}

impl Default for FixedLists {
    fn default() -> Self {
        Self {
            offsets: Offsets::new(),
            values: Vec::new(),
        }
    }
}

impl FixedLists {
    /// Adds the poses of one clip.
    fn push_poses<const N: usize>(&mut self, poses: &[[[f32; N]; N_JOINTS]]) {
        let values = poses.iter().flatten().flatten();
        self.values.extend(values);
        self.offsets.push(poses.len());
    }

    /// The column, whose elements have the lengths `inner`, from the innermost outwards.
    fn column(self, name: &str, inner: &[usize]) -> Column {
        let element = fixed(self.values, inner);
        Column::new(name, self.offsets.lists(element))
    }
}

/// Values as nested lists of the lengths `inner`, from the innermost outwards, whose product divides their number.
fn fixed(values: Vec<f32>, inner: &[usize]) -> Column {
    inner
        .iter()
        .fold(Column::element(Values::F32(values)), |element, length| {
            let lists = List::of_length(*length, element);
            debug_assert!(lists.is_some());
            Column::element(lists.map_or_else(|| Values::F32(Vec::new()), Values::List))
        })
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

/// The rows of clips.
fn table_of(clips: &[ClipRecord]) -> Table {
    let text = |f: fn(&ClipRecord) -> &str| {
        Values::Text(clips.iter().map(|clip| f(clip).to_string()).collect())
    };
    let f32s = |f: fn(&ClipRecord) -> f32| Values::F32(clips.iter().map(f).collect());
    let n_points = |c: &ClipRecord| c.frames.iter().map(|f| f.points.len()).sum::<usize>() as u32;

    let (mut of_captions, mut captions) = (Offsets::new(), Vec::new());
    let (mut of_frames, mut numbers, mut times_s) = (Offsets::new(), Vec::new(), Vec::new());
    let (mut of_points, mut points) = (Offsets::new(), Vec::new());
    let (mut joints, mut rotations) = (FixedLists::default(), FixedLists::default());
    let mut features = FixedLists::default();
    for clip in clips {
        captions.extend(clip.captions.iter().cloned());
        of_captions.push(clip.captions.len());
        for frame in &clip.frames {
            numbers.push(frame.frame);
            times_s.push(frame.time_s);
            for p in &frame.points {
                points.extend([
                    p.x_m,
                    p.y_m,
                    p.z_m,
                    p.range_m,
                    p.velocity_mps,
                    p.intensity_db,
                ]);
            }
            of_points.push(frame.points.len());
        }
        of_frames.push(clip.frames.len());
        joints.push_poses(&clip.joints);
        rotations.push_poses(&clip.rotations6d);
        let vectors = clip.motion_features.chunks_exact(MOTION_FEATURE_DIM);
        features.offsets.push(vectors.len());
        features.values.extend(vectors.flatten());
    }

    let captions = Column::element(Values::Text(captions));
    let clouds = Column::element(of_points.lists(fixed(points, &[N_VALUES])));
    let frames_of = |values: Values| of_frames.clone().lists(Column::element(values));
    let columns = vec![
        Column::new("id", text(|c| &c.id)),
        Column::new("motion_id", text(|c| &c.motion_id)),
        Column::new("group", text(|c| &c.group)),
        Column::new("split", text(|c| c.split.name())),
        Column::new("action", text(|c| &c.action)),
        Column::new("captions", of_captions.lists(captions)),
        Column::new("source", text(|c| &c.source)),
        Column::new("radar", text(|c| &c.radar)),
        Column::new("radar_height_m", f32s(|c| c.radar_height_m)),
        Column::new("seed", Values::U64(clips.iter().map(|c| c.seed).collect())),
        Column::new(
            "n_frames",
            Values::U32(clips.iter().map(|c| c.frames.len() as u32).collect()),
        ),
        Column::new(
            "n_points",
            Values::U32(clips.iter().map(n_points).collect()),
        ),
        Column::new("duration_s", f32s(duration_s)),
        Column::new("frame_number", frames_of(Values::U32(numbers))),
        Column::new("frame_time_s", frames_of(Values::F64(times_s))),
        Column::new("points", of_frames.lists(clouds)),
        Column::new("motion_fps", f32s(|c| c.motion_fps)),
        joints.column("joints", &[3, N_JOINTS]),
        features.column("motion_features", &[MOTION_FEATURE_DIM]),
        rotations.column(ROTATIONS, &[6, N_JOINTS]),
        Column::new(BODY_HEIGHT, f32s(|c| c.body_height_m)),
    ];
    Table {
        columns,
        metadata: Vec::new(),
    }
}

fn reader_of(path: &Path, is_wanted: impl Fn(&str) -> bool) -> Result<TableReader, DatasetError> {
    let file = guard::open(path, LIMITS)?;
    TableReader::new(path, file, ROW_GROUP_CLIPS, is_wanted)
}

/// Typed access to the columns of some rows.
struct Access<'a> {
    path: &'a Path,
    rows: &'a Table,
}

impl<'a> Access<'a> {
    fn column(&self, name: &str) -> Result<&'a Column, DatasetError> {
        let column = self.rows.column(name);
        let column = column.ok_or_else(|| self.wrong(name, "nothing"))?;
        match column.has_nulls() {
            true => Err(self.wrong(name, "nulls")),
            false => Ok(column),
        }
    }

    fn wrong(&self, name: &str, found: &str) -> DatasetError {
        let expected = no_rows(Columns::All);
        match expected.column(name) {
            Some(expected) => wrong(self.path, expected, found),
            None => wrong(
                self.path,
                &Column::new(name, Values::Text(Vec::new())),
                found,
            ),
        }
    }

    /// The values of a column, of which `get` takes those of the right type.
    fn values<T>(
        &self,
        name: &str,
        get: impl Fn(&'a Column) -> Option<T>,
    ) -> Result<T, DatasetError> {
        let column = self.column(name)?;
        get(column).ok_or_else(|| self.wrong(name, &column.type_name()))
    }

    fn text(&self, name: &str) -> Result<&'a [String], DatasetError> {
        self.values(name, Column::as_text)
    }

    fn u32(&self, name: &str) -> Result<&'a [u32], DatasetError> {
        self.values(name, Column::as_u32)
    }

    fn f32(&self, name: &str) -> Result<&'a [f32], DatasetError> {
        self.values(name, Column::as_f32)
    }

    /// A column of lists, and the elements of all of them, of which `get` takes those of the right type.
    fn lists<T>(
        &self,
        name: &str,
        get: impl Fn(&'a Column) -> Option<T>,
    ) -> Result<(&'a List, T), DatasetError> {
        self.values(name, |column| {
            let lists = column.as_list()?;
            Some((lists, get(without_nulls(lists.element())?)?))
        })
    }

    /// A column of lists of blocks of numbers of the lengths `inner`, from the outermost inwards.
    fn blocks(&self, name: &str, inner: &[usize]) -> Result<(&'a List, &'a [f32]), DatasetError> {
        self.lists(name, |element| flat(element, inner))
    }

    fn captions(&self) -> Result<Vec<Vec<String>>, DatasetError> {
        let (lists, texts) = self.lists("captions", Column::as_text)?;
        let rows = 0..lists.n_rows();
        Ok(rows.map(|row| texts[lists.range(row)].to_vec()).collect())
    }

    fn splits(&self, first_row: u64) -> Result<Vec<Split>, DatasetError> {
        let names = (first_row..).zip(self.text("split")?);
        names
            .map(|(row, name)| {
                Split::from_name(name).ok_or_else(|| DatasetError::Value {
                    path: self.path.into(),
                    column: "split".into(),
                    row,
                    problem: format!("{name:?} is not train, val or test"),
                })
            })
            .collect()
    }
}

fn without_nulls(column: &Column) -> Option<&Column> {
    (!column.has_nulls()).then_some(column)
}

/// The numbers in nested lists of the lengths `inner`, from the outermost inwards.
fn flat<'a>(column: &'a Column, inner: &[usize]) -> Option<&'a [f32]> {
    let leaf = inner.iter().try_fold(column, |column, length| {
        let lists = without_nulls(column)?.as_list()?;
        lists.all_have(*length).then(|| lists.element())
    });
    without_nulls(leaf?)?.as_f32()
}

fn clips_of(path: &Path, rows: &Table, first_row: u64) -> Result<Vec<ClipRecord>, DatasetError> {
    let access = Access { path, rows };
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
    let seed = access.values("seed", Column::as_u64)?;
    let (n_frames, n_points) = (access.u32("n_frames")?, access.u32("n_points")?);
    let (of_numbers, numbers) = access.lists("frame_number", Column::as_u32)?;
    let (of_times, times_s) = access.lists("frame_time_s", Column::as_f64)?;
    let (clouds, (frames, point_values)) = access.lists("points", |element| {
        let frames = element.as_list()?;
        Some((frames, flat(frames.element(), &[N_VALUES])?))
    })?;
    // They are left out where only points are asked for, and shards of version 1 lack the last two.
    let has = |name: &str| rows.column(name).is_some();
    let blocks = |name: &str, inner: &[usize]| match has(name) {
        true => access.blocks(name, inner).map(Some),
        false => Ok(None),
    };
    let joints = blocks("joints", &[N_JOINTS, 3])?;
    let features = blocks("motion_features", &[MOTION_FEATURE_DIM])?;
    let rotations = blocks(ROTATIONS, &[N_JOINTS, 6])?;
    let body_height_m = match has(BODY_HEIGHT) {
        true => Some(access.f32(BODY_HEIGHT)?),
        false => None,
    };

    let mut clips = Vec::with_capacity(rows.n_rows());
    for row in 0..rows.n_rows() {
        let bad = |column: &str, problem: String| DatasetError::Value {
            path: path.into(),
            column: column.into(),
            row: first_row + row as u64,
            problem,
        };
        let of_row = clouds.range(row);
        let (row_numbers, row_times) = (of_numbers.range(row), of_times.range(row));
        if row_numbers.len() != of_row.len()
            || row_times.len() != of_row.len()
            || n_frames[row] as usize != of_row.len()
        {
            return Err(bad(
                "points",
                format!(
                    "{} frames, but {} numbers, {} times and n_frames = {}",
                    of_row.len(),
                    row_numbers.len(),
                    row_times.len(),
                    n_frames[row]
                ),
            ));
        }
        let mut clip_frames = Vec::with_capacity(of_row.len());
        for ((frame_row, &frame), &time_s) in
            of_row.zip(&numbers[row_numbers]).zip(&times_s[row_times])
        {
            let block = scaled(frames.range(frame_row), N_VALUES);
            let points = point_values[block]
                .chunks_exact(N_VALUES)
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
            values[scaled(lists.range(row), MOTION_FEATURE_DIM)].to_vec()
        });
        clips.push(ClipRecord {
            id: id[row].clone(),
            motion_id: motion_id[row].clone(),
            group: group[row].clone(),
            split: splits[row],
            action: action[row].clone(),
            captions: std::mem::take(&mut captions[row]),
            source: source[row].clone(),
            radar: radar[row].clone(),
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

/// The values of blocks of `width` values.
fn scaled(blocks: Range<usize>, width: usize) -> Range<usize> {
    blocks.start * width..blocks.end * width
}

/// Poses of one clip, `[frame][joint][N]`.
fn poses_of<const N: usize>(
    (lists, values): (&List, &[f32]),
    row: usize,
) -> Vec<[[f32; N]; N_JOINTS]> {
    let width = N_JOINTS * N;
    let poses = values[scaled(lists.range(row), width)].chunks_exact(width);
    poses
        .map(|v| std::array::from_fn(|j| std::array::from_fn(|i| v[j * N + i])))
        .collect()
}

fn summaries_of(
    path: &Path,
    rows: &Table,
    first_row: u64,
) -> Result<Vec<ClipSummary>, DatasetError> {
    let access = Access { path, rows };
    let (id, motion_id) = (access.text("id")?, access.text("motion_id")?);
    let (action, source) = (access.text("action")?, access.text("source")?);
    let splits = access.splits(first_row)?;
    let captions = access.captions()?;
    let (n_frames, n_points) = (access.u32("n_frames")?, access.u32("n_points")?);
    let duration_s = access.f32("duration_s")?;
    let rows = captions.into_iter().enumerate();
    Ok(rows
        .map(|(row, captions)| ClipSummary {
            id: id[row].clone(),
            motion_id: motion_id[row].clone(),
            split: splits[row],
            action: action[row].clone(),
            source: source[row].clone(),
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
        let mut old = table_of(&[clip()]);
        old.columns
            .retain(|column| unknown_column(&column.name, 0).is_none());
        assert_eq!(old.columns.len(), no_rows(Columns::All).columns.len() - 2);
        let file = File::create(&path).unwrap();
        let mut writer = TableWriter::new(file, &old, WriterProperties::default()).unwrap();
        writer.write(&old).unwrap();
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
        assert_eq!(read, std::slice::from_ref(&expected));
        // Batches have the columns of today, so that data sets of both versions can be joined.
        let mut batches = BatchReader::open(&path, Columns::All).unwrap();
        let rows = batches.next_batch().unwrap().unwrap();
        assert_eq!(rows, table_of(&[expected]));
        assert_eq!(read_summaries(&path).unwrap().len(), 1);
    }
}
