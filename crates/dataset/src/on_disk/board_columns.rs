//! Columns of what the firmware of a board states beside its points: tracks of people, and presence.
//!
//! Column `board_tracks` is a list of structs `id` u32, then `x_m, y_m, z_m, vx_mps, vy_mps, vz_mps` f32; `z_m` is null where
//! the firmware tracks in a plane. Column `board_present` is a nullable boolean. Both are stated in the first row of a frame
//! and null in the others; a list without tracks is a report of nobody, null is no report.

use std::path::Path;

use radarllm_base::{BoardReport, BoardTrack};

use super::table::{Column, List, Offsets, Table, Values};
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

/// Rows that are not written yet.
pub(super) struct BoardBuilder {
    /// Where the tracks of each row begin.
    offsets: Offsets,
    has_report: Vec<bool>,
    ids: Vec<u32>,
    members: [Vec<f32>; MEMBERS.len()],
    has_height: Vec<bool>,
    present: Vec<bool>,
    knows_presence: Vec<bool>,
}

impl Default for BoardBuilder {
    fn default() -> Self {
        Self {
            offsets: Offsets::new(),
            has_report: Vec::new(),
            ids: Vec::new(),
            members: Default::default(),
            has_height: Vec::new(),
            present: Vec::new(),
            knows_presence: Vec::new(),
        }
    }
}

impl BoardBuilder {
    /// Adds a row.
    pub(super) fn push(&mut self, report: Option<&BoardReport>) {
        let tracks = report.map_or(&[][..], |report| &report.tracks);
        for track in tracks {
            self.ids.push(track.id);
            self.has_height.push(track.height_m.is_some());
            for (column, value) in self.members.iter_mut().zip(members_of(track)) {
                column.push(value.unwrap_or_default());
            }
        }
        self.offsets.push(tracks.len());
        self.has_report.push(report.is_some());
        let is_present = report.and_then(|report| report.is_present);
        self.present.push(is_present.unwrap_or_default());
        self.knows_presence.push(is_present.is_some());
    }

    /// The columns.
    pub(super) fn finish(self) -> [Column; 2] {
        let mut members = vec![Column::new("id", Values::U32(self.ids))];
        for (i, (name, values)) in MEMBERS.into_iter().zip(self.members).enumerate() {
            let values = Values::F32(values);
            members.push(match i == HEIGHT {
                true => Column::nullable(name, values, self.has_height.clone()),
                false => Column::new(name, values),
            });
        }
        let tracks = Column::element(Values::Struct(members));
        [
            Column::nullable(TRACKS, self.offsets.lists(tracks), self.has_report),
            Column::nullable(PRESENT, Values::Bool(self.present), self.knows_presence),
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

/// The columns in some rows.
pub(super) struct BoardColumns<'a> {
    path: &'a Path,
    first_row: u64,
    tracks: &'a Column,
    lists: &'a List,
    ids: (&'a Column, &'a [u32]),
    members: [(&'a Column, &'a [f32]); MEMBERS.len()],
    present: Option<(&'a Column, &'a [bool])>,
}

impl<'a> BoardColumns<'a> {
    /// `None` if the table has none.
    ///
    /// # Errors
    /// Columns of other types.
    pub(super) fn of(
        path: &'a Path,
        rows: &'a Table,
        first_row: u64,
    ) -> Result<Option<Self>, DatasetError> {
        let Some(tracks) = rows.column(TRACKS) else {
            return Ok(None);
        };
        let of_other_type = |expected: &str, found: &Column| DatasetError::Column {
            path: path.to_path_buf(),
            column: found.name.clone(),
            expected: expected.into(),
            found: found.type_name(),
        };
        let expected = "a list of structs of id (32-bit unsigned integer), x_m, y_m, z_m, vx_mps, vy_mps and vz_mps \
                        (32-bit floats)";
        let bad = || of_other_type(expected, tracks);
        let lists = tracks.as_list().ok_or_else(bad)?;
        let Values::Struct(of_track) = &lists.element().values else {
            return Err(bad());
        };
        let member = |name: &str| of_track.iter().find(|column| column.name == name);
        let numbers = |name: &str| -> Result<(&'a Column, &'a [f32]), DatasetError> {
            let column = member(name).ok_or_else(bad)?;
            Ok((column, column.as_f32().ok_or_else(bad)?))
        };
        let ids = member("id").and_then(|column| Some((column, column.as_u32()?)));
        let [x, y, z, vx, vy, vz] = MEMBERS;
        let present = rows.column(PRESENT).map(|column| {
            let values = column.as_bool();
            let values = values.ok_or_else(|| of_other_type("a boolean", column))?;
            Ok::<_, DatasetError>((column, values))
        });
        Ok(Some(Self {
            path,
            first_row,
            tracks,
            lists,
            ids: ids.ok_or_else(bad)?,
            members: [
                numbers(x)?,
                numbers(y)?,
                numbers(z)?,
                numbers(vx)?,
                numbers(vy)?,
                numbers(vz)?,
            ],
            present: present.transpose()?,
        }))
    }

    /// The report in a row.
    ///
    /// # Errors
    /// Values that are null, but for heights, or not finite.
    pub(super) fn at(&self, row: usize) -> Result<Option<BoardReport>, DatasetError> {
        if self.tracks.is_null(row) {
            return Ok(None);
        }
        let bad = |name: &str, problem: String| DatasetError::Value {
            path: self.path.to_path_buf(),
            column: TRACKS.into(),
            row: self.first_row + row as u64,
            problem: format!("{name} {problem}"),
        };
        let track = |at: usize| {
            let (ids, id_numbers) = self.ids;
            if ids.is_null(at) || self.lists.element().is_null(at) {
                return Err(bad("id", "is null".into()));
            }
            let mut values = [None; 6];
            for (i, value) in values.iter_mut().enumerate() {
                let (name, (member, numbers)) = (MEMBERS[i], self.members[i]);
                *value = (!member.is_null(at)).then(|| numbers[at]);
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
                id: id_numbers[at],
                place_m: [x_m, y_m].map(Option::unwrap_or_default),
                height_m,
                velocity_mps: [vx, vy, vz].map(Option::unwrap_or_default),
            })
        };
        let is_present = self.present.filter(|(column, _)| !column.is_null(row));
        Ok(Some(BoardReport {
            tracks: self.lists.range(row).map(track).collect::<Result<_, _>>()?,
            is_present: is_present.map(|(_, values)| values[row]),
        }))
    }
}
