//! Columns of what the firmware of a board states beside its points: tracks of people, and presence.
//!
//! Column `board_tracks` is a list of structs `id` u32, then `x_m, y_m, z_m, vx_mps, vy_mps, vz_mps` f32; `z_m` is null where
//! the firmware tracks in a plane. Column `board_present` is a nullable boolean. Both are stated in the first row of a frame
//! and null in the others; a list without tracks is a report of nobody, null is no report.

use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use arrow_array::{
    Array, ArrayRef, BooleanArray, Float32Array, LargeListArray, ListArray, RecordBatch,
    StructArray, UInt32Array,
    builder::{BooleanBuilder, Float32Builder, ListBuilder, StructBuilder, UInt32Builder},
};
use arrow_schema::{DataType, Field, Fields};
use radarllm_base::{BoardReport, BoardTrack};

use crate::DatasetError;

/// Names of the columns.
pub(super) const TRACKS: &str = "board_tracks";
pub(super) const PRESENT: &str = "board_present";
/// Members of a track after its number, f32.
const MEMBERS: [&str; 6] = ["x_m", "y_m", "z_m", "vx_mps", "vy_mps", "vz_mps"];
/// Largest place, m, and speed, m/s: no radar of rooms sees farther.
const MAX_VALUE: f32 = 10_000.0;
/// The member that may be null.
const HEIGHT: usize = 2;

fn track_fields() -> Fields {
    let members = MEMBERS.iter().enumerate();
    let members =
        members.map(|(i, name)| Arc::new(Field::new(*name, DataType::Float32, i == HEIGHT)));
    let id = Arc::new(Field::new("id", DataType::UInt32, false));
    std::iter::once(id).chain(members).collect()
}

fn element() -> Field {
    Field::new("element", DataType::Struct(track_fields()), false)
}

/// The fields of the columns.
pub(super) fn fields() -> [Field; 2] {
    [
        Field::new(TRACKS, DataType::List(Arc::new(element())), true),
        Field::new(PRESENT, DataType::Boolean, true),
    ]
}

/// Rows that are not written yet.
pub(super) struct BoardBuilder {
    tracks: ListBuilder<StructBuilder>,
    present: BooleanBuilder,
}

impl Default for BoardBuilder {
    fn default() -> Self {
        Self {
            tracks: ListBuilder::new(StructBuilder::from_fields(track_fields(), 0))
                .with_field(element()),
            present: BooleanBuilder::new(),
        }
    }
}

impl BoardBuilder {
    /// Adds a row.
    pub(super) fn push(&mut self, report: Option<&BoardReport>) {
        let Some(report) = report else {
            self.tracks.append_null();
            self.present.append_null();
            return;
        };
        for track in &report.tracks {
            let row = self.tracks.values();
            if let Some(ids) = row.field_builder::<UInt32Builder>(0) {
                ids.append_value(track.id);
            }
            for (i, value) in members_of(track).into_iter().enumerate() {
                if let Some(values) = row.field_builder::<Float32Builder>(1 + i) {
                    values.append_option(value);
                }
            }
            row.append(true);
        }
        self.tracks.append(true);
        self.present.append_option(report.is_present);
    }

    /// The columns, in the order of [`fields`].
    pub(super) fn finish(mut self) -> [ArrayRef; 2] {
        [
            Arc::new(self.tracks.finish()),
            Arc::new(self.present.finish()),
        ]
    }
}

fn members_of(track: &BoardTrack) -> [Option<f32>; 6] {
    let [x_m, y_m] = track.place_m;
    let [vx, vy, vz] = track.velocity_mps.map(Some);
    [Some(x_m), Some(y_m), track.height_m, vx, vy, vz]
}

/// Whether a value is one that is read again.
fn is_in_range(value: f32) -> bool {
    value.abs() <= MAX_VALUE
}

/// The first value of a report that would not be read again, with its name.
pub(super) fn out_of_range(report: &BoardReport) -> Option<(&'static str, f32)> {
    let members = report.tracks.iter().flat_map(|track| {
        let members = MEMBERS.into_iter().zip(members_of(track));
        members.filter_map(|(name, value)| Some((name, value?)))
    });
    members.into_iter().find(|(_, value)| !is_in_range(*value))
}

/// A column of lists, with offsets of 32 bits, or of 64, which some Arrow libraries make of them.
#[derive(Clone, Copy)]
enum Lists<'a> {
    Small(&'a ListArray),
    Large(&'a LargeListArray),
}

impl<'a> Lists<'a> {
    fn of(column: &'a ArrayRef) -> Option<Self> {
        let small = column.as_any().downcast_ref().map(Self::Small);
        small.or_else(|| column.as_any().downcast_ref().map(Self::Large))
    }

    fn values(self) -> &'a ArrayRef {
        match self {
            Self::Small(lists) => lists.values(),
            Self::Large(lists) => lists.values(),
        }
    }

    /// The elements of a row; `None` if it is null.
    fn at(self, row: usize) -> Option<Range<usize>> {
        match self {
            Self::Small(lists) => lists.is_valid(row).then(|| {
                let offsets = lists.value_offsets();
                offsets[row] as usize..offsets[row + 1] as usize
            }),
            Self::Large(lists) => lists.is_valid(row).then(|| {
                let offsets = lists.value_offsets();
                offsets[row] as usize..offsets[row + 1] as usize
            }),
        }
    }
}

/// The columns of a batch.
pub(super) struct BoardColumns<'a> {
    path: &'a Path,
    first_row: u64,
    lists: Lists<'a>,
    ids: &'a UInt32Array,
    members: [&'a Float32Array; 6],
    present: Option<&'a BooleanArray>,
}

impl<'a> BoardColumns<'a> {
    /// `None` if the batch has none.
    ///
    /// # Errors
    /// Columns of other types.
    pub(super) fn of(
        path: &'a Path,
        batch: &'a RecordBatch,
        first_row: u64,
    ) -> Result<Option<Self>, DatasetError> {
        let Some(column) = batch.column_by_name(TRACKS) else {
            return Ok(None);
        };
        let of_other_type = |name: &str, expected: &str, found: &ArrayRef| DatasetError::Column {
            path: path.to_path_buf(),
            column: name.into(),
            expected: expected.into(),
            found: found.data_type().to_string(),
        };
        let expected = "a list of structs of id (32-bit unsigned integer), x_m, y_m, z_m, vx_mps, vy_mps and vz_mps \
                        (32-bit floats)";
        let bad = || of_other_type(TRACKS, expected, column);
        let lists = Lists::of(column).ok_or_else(bad)?;
        let structs = lists.values().as_any().downcast_ref::<StructArray>();
        let structs = structs.ok_or_else(bad)?;
        let ids = structs.column_by_name("id");
        let ids = ids.and_then(|a| a.as_any().downcast_ref());
        let member = |name: &str| -> Result<&'a Float32Array, DatasetError> {
            let values = structs.column_by_name(name);
            let values = values.and_then(|a| a.as_any().downcast_ref());
            values.ok_or_else(bad)
        };
        let [x, y, z, vx, vy, vz] = MEMBERS;
        let present = batch.column_by_name(PRESENT).map(|column| {
            let values = column.as_any().downcast_ref::<BooleanArray>();
            values.ok_or_else(|| of_other_type(PRESENT, "a boolean", column))
        });
        Ok(Some(Self {
            path,
            first_row,
            lists,
            ids: ids.ok_or_else(bad)?,
            members: [
                member(x)?,
                member(y)?,
                member(z)?,
                member(vx)?,
                member(vy)?,
                member(vz)?,
            ],
            present: present.transpose()?,
        }))
    }

    /// The report in a row of the batch.
    ///
    /// # Errors
    /// Values that are null, but for heights, or not finite.
    pub(super) fn at(&self, row: usize) -> Result<Option<BoardReport>, DatasetError> {
        let Some(elements) = self.lists.at(row) else {
            return Ok(None);
        };
        let bad = |name: &str, problem: String| DatasetError::Value {
            path: self.path.to_path_buf(),
            column: TRACKS.into(),
            row: self.first_row + row as u64,
            problem: format!("{name} {problem}"),
        };
        let track = |at: usize| {
            if self.ids.is_null(at) {
                return Err(bad("id", "is null".into()));
            }
            let mut values = [None; 6];
            for (i, value) in values.iter_mut().enumerate() {
                let (name, member) = (MEMBERS[i], self.members[i]);
                *value = member.is_valid(at).then(|| member.value(at));
                match *value {
                    None if i != HEIGHT => return Err(bad(name, "is null".into())),
                    Some(v) if !is_in_range(v) => {
                        return Err(bad(name, format!("is {v}")));
                    }
                    _ => {}
                }
            }
            let [x_m, y_m, height_m, vx, vy, vz] = values;
            Ok(BoardTrack {
                id: self.ids.value(at),
                place_m: [x_m, y_m].map(Option::unwrap_or_default),
                height_m,
                velocity_mps: [vx, vy, vz].map(Option::unwrap_or_default),
            })
        };
        let is_present = self.present.filter(|column| column.is_valid(row));
        Ok(Some(BoardReport {
            tracks: elements.map(track).collect::<Result<_, _>>()?,
            is_present: is_present.map(|column| column.value(row)),
        }))
    }
}
