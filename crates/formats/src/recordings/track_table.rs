//! Tables of TI's low-power people tracking (IWRL6432): a row for each frame and track, with the points of the frame.
//!
//! | column | content |
//! |---|---|
//! | `Frame_count`, `Frame count` or `frame` | number of the frame; rows without it are counted |
//! | `tid` | number of the track |
//! | `posx`, `posy`, `posz` | position of the track, m: right, away, above the radar; `posx` is 0 if it is absent |
//! | `velx`, `vely`, `velz` | its velocity, m/s |
//! | `pointxN`, `pointyN`, `pointzN`, `dopplerN`, `snrN` | point N of the frame: position, m, radial speed, m/s, SNR, dB |
//! | `Session_ID`, `Recording_Number` | where one of them changes, another recording begins |
//!
//! Empty cells end the points of a row. A table in which all `posz` are 0 was recorded without heights. The period of the
//! frames is not stated. Recordings that follow each other in one table are separated by [`RUN_GAP_FRAMES`] frames, so that
//! nothing is joined across them.

use std::collections::BTreeMap;

use radarllm_base::{BoardReport, BoardTrack};

use super::{
    MAX_COORDINATE_M, MAX_INTENSITY_DB, MAX_VELOCITY_MPS, Place, RecordedFrame, RecordingError,
    point,
};

/// Frames between the recordings of one table.
pub const RUN_GAP_FRAMES: u64 = 100;
/// Points of a row that are read; the firmware sends fewer.
const MAX_POINTS: usize = 512;

/// Content of a table.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TrackTable {
    /// Frames in order.
    pub frames: Vec<RecordedFrame>,
    /// Notes for the user: several recordings, dropped tracks and points.
    pub notes: Vec<String>,
}

/// Columns by their places in a row.
#[derive(Default)]
struct Columns {
    frame: Option<usize>,
    track: Option<usize>,
    run: Vec<usize>,
    position: [Option<usize>; 3],
    velocity: [Option<usize>; 3],
    /// Places of x, y, z, radial speed and SNR of each point.
    points: Vec<[Option<usize>; 5]>,
}

/// A name and the number at its end.
fn numbered(name: &str) -> Option<(&str, usize)> {
    let stem = name.trim_end_matches(|c: char| c.is_ascii_digit());
    Some((stem, name[stem.len()..].parse().ok()?))
}

/// Whether the names of columns are those of such a table.
pub fn is_track_table<'a>(names: impl IntoIterator<Item = &'a str>) -> bool {
    let names: Vec<String> = names.into_iter().map(|n| n.trim().to_lowercase()).collect();
    ["tid", "posy", "posz"]
        .iter()
        .all(|name| names.iter().any(|n| n == name))
}

impl Columns {
    fn find(names: &[&str]) -> Self {
        let mut columns = Self::default();
        for (at, name) in names.iter().enumerate() {
            let name = name
                .trim_start_matches('\u{feff}')
                .trim()
                .to_lowercase()
                .replace(' ', "_");
            let axis = |prefix: &str| {
                let rest = name.strip_prefix(prefix)?;
                ["x", "y", "z"].iter().position(|axis| *axis == rest)
            };
            match name.as_str() {
                "frame_count" | "frame" => columns.frame = Some(at),
                "tid" => columns.track = Some(at),
                "session_id" | "recording_number" => columns.run.push(at),
                _ => {}
            }
            if let Some(axis) = axis("pos") {
                columns.position[axis] = Some(at);
            } else if let Some(axis) = axis("vel") {
                columns.velocity[axis] = Some(at);
            } else if let Some((stem, number)) = numbered(&name)
                && let Some(value) = ["pointx", "pointy", "pointz", "doppler", "snr"]
                    .iter()
                    .position(|s| *s == stem)
                && number < MAX_POINTS
            {
                if columns.points.len() <= number {
                    columns.points.resize(number + 1, [None; 5]);
                }
                columns.points[number][value] = Some(at);
            }
        }
        // Some tables count from 1.
        columns.points.retain(|p| p[1].is_some() && p[2].is_some());
        columns
    }
}

/// Reads a table.
///
/// # Errors
/// [`RecordingError`] with the line: missing columns, or cells that are neither numbers nor empty.
pub fn read_track_table(text: &str) -> Result<TrackTable, RecordingError> {
    let mut lines = text.lines().enumerate();
    let (_, header) = lines.next().unwrap_or_default();
    let names: Vec<&str> = header.split(',').collect();
    if !is_track_table(names.iter().copied()) {
        return Err(RecordingError::new(
            Place::Line(1),
            "columns tid, posy and posz",
            header,
        ));
    }
    let columns = Columns::find(&names);
    let mut table = TrackTable::default();
    let (mut n_tracks_dropped, mut n_heights_dropped) = (0, 0);
    let (mut n_points_dropped, mut n_runs) = (0, 1);
    let mut run: Option<Vec<&str>> = None;
    // What is added to the numbers of a recording so that they follow those of the one before.
    let mut shift = 0;
    for (i, row) in lines {
        if row.trim().is_empty() {
            continue;
        }
        let line = i + 1;
        let cells: Vec<&str> = row.split(',').map(str::trim).collect();
        let cell = |at: Option<usize>| at.and_then(|at| cells.get(at)).filter(|c| !c.is_empty());
        let value = |at: Option<usize>| -> Result<Option<f64>, RecordingError> {
            let Some(text) = cell(at) else {
                return Ok(None);
            };
            let number = text.parse::<f64>().map_err(|_| {
                let name = at.and_then(|at| names.get(at)).map_or("", |n| n.trim());
                RecordingError::new(Place::Line(line), format!("a number for `{name}`"), text)
            })?;
            Ok(Some(number))
        };
        let this_run: Vec<&str> = columns
            .run
            .iter()
            .map(|at| cells.get(*at).copied().unwrap_or(""))
            .collect();
        let is_new_run = run.as_ref().is_some_and(|run| *run != this_run);
        run = Some(this_run);
        let last = table.frames.last().map(|f| f.number);
        let stated = value(columns.frame)?;
        let stated = match stated {
            Some(n) if n >= 0.0 && n.fract() == 0.0 && n < 9e15 => Some(n as u64),
            Some(n) => {
                return Err(RecordingError::new(
                    Place::Line(line),
                    "a frame number",
                    &n.to_string(),
                ));
            }
            None => None,
        };
        let number = match (stated, last) {
            (stated, None) => stated.unwrap_or(0),
            (Some(n), Some(last)) => {
                // A counter that goes back is another recording, whatever the other columns say.
                let goes_back = n.saturating_add(shift) < last;
                if is_new_run || goes_back {
                    n_runs += 1;
                    shift = (last + RUN_GAP_FRAMES).saturating_sub(n);
                }
                n.saturating_add(shift)
            }
            (None, Some(last)) if is_new_run => {
                n_runs += 1;
                last + RUN_GAP_FRAMES
            }
            (None, Some(last)) => last + 1,
        };
        let mut position = [0.0; 3];
        let mut velocity = [0.0; 3];
        for axis in 0..3 {
            position[axis] = value(columns.position[axis])?.unwrap_or(0.0);
            velocity[axis] = value(columns.velocity[axis])?.unwrap_or(0.0);
        }
        // Where there is no height, the place holds. What is impossible shows that the row is damaged.
        let has_height = cell(columns.position[2]).is_some();
        let is_height = has_height && !position[2].is_nan();
        if !is_height {
            n_heights_dropped += u64::from(has_height);
            position[2] = 0.0;
        }
        let within = |values: &[f64; 3], limit: f64| values.iter().all(|v| v.abs() <= limit);
        let id = value(columns.track)?.filter(|n| *n >= 0.0 && *n < f64::from(u32::MAX));
        let has_track = id.is_some() && cell(columns.position[1]).is_some();
        let track = match id {
            Some(id)
                if has_track
                    && within(&position, MAX_COORDINATE_M)
                    && within(&velocity, MAX_VELOCITY_MPS) =>
            {
                Some(BoardTrack {
                    id: id as u32,
                    place_m: [position[0] as f32, position[1] as f32],
                    height_m: is_height.then_some(position[2] as f32),
                    velocity_mps: velocity.map(|v| v as f32),
                })
            }
            _ => {
                n_tracks_dropped += u64::from(has_track);
                None
            }
        };
        if let Some(open) = table.frames.last_mut().filter(|f| f.number == number) {
            // Another track of the same frame.
            if let Some(board) = &mut open.board {
                board.tracks.extend(track);
            }
            continue;
        }
        let mut points = Vec::new();
        for places in &columns.points {
            let mut values = [0.0; 5];
            if cell(places[1]).is_none() || cell(places[2]).is_none() {
                continue;
            }
            for (value_of, at) in values.iter_mut().zip(places) {
                *value_of = value(*at)?.unwrap_or(0.0);
            }
            let [x, y, z, speed, snr] = values;
            let is_possible = within(&[x, y, z], MAX_COORDINATE_M)
                && speed.abs() <= MAX_VELOCITY_MPS
                && snr.abs() <= MAX_INTENSITY_DB;
            match is_possible {
                true => points.push(point([x, y, z], speed, snr)),
                false => n_points_dropped += 1,
            }
        }
        table.frames.push(RecordedFrame {
            number,
            stamp_s: None,
            points,
            board: Some(BoardReport {
                tracks: track.into_iter().collect(),
                is_present: None,
            }),
        });
    }
    without_flat_heights(&mut table);
    if n_runs > 1 {
        table.notes.push(format!(
            "{n_runs} recordings follow each other in the table: they are {RUN_GAP_FRAMES} frames apart here"
        ));
    }
    if n_heights_dropped > 0 {
        table.notes.push(format!(
            "{n_heights_dropped} heights of tracks are no numbers and were left out"
        ));
    }
    if n_tracks_dropped + n_points_dropped > 0 {
        table.notes.push(format!(
            "{n_tracks_dropped} tracks and {n_points_dropped} points are impossible and were left out"
        ));
    }
    Ok(table)
}

/// Takes away heights that are all 0: the tracker worked in a plane.
fn without_flat_heights(table: &mut TrackTable) {
    /// Nobody's track stays this near to the height of the radar, m.
    const FLAT_M: f32 = 0.05;
    let is_flat = |track: &BoardTrack| track.height_m.is_none_or(|z_m| z_m.abs() < FLAT_M);
    let tracks = || {
        table
            .frames
            .iter()
            .flat_map(|f| &f.board)
            .flat_map(|b| &b.tracks)
    };
    let n_flat = tracks().filter(|t| is_flat(t)).count();
    if n_flat * 10 >= tracks().count() * 9 {
        table
            .notes
            .push("all tracks are at the height of the radar: the board tracked in a plane".into());
        for track in tracks_of(table) {
            track.height_m = None;
        }
        return;
    }
    without_flat_stretches(table);
}

/// Takes away heights that are 0 for seconds: some tables join recordings of a tracker in a plane with others.
fn without_flat_stretches(table: &mut TrackTable) {
    /// Heights of people change by more within as many frames.
    const FLAT_M: f32 = 0.02;
    const MIN_FRAMES: usize = 20;
    let is_flat = |z_m: Option<f32>| z_m.is_some_and(|z_m| z_m.abs() < FLAT_M);
    let mut n_flat = 0;
    let mut heights: BTreeMap<u32, Vec<&mut Option<f32>>> = BTreeMap::new();
    for track in tracks_of(table) {
        let of_track = heights.entry(track.id).or_default();
        of_track.push(&mut track.height_m);
    }
    for of_track in heights.values_mut() {
        for stretch in of_track.chunk_by_mut(|a, b| is_flat(**a) == is_flat(**b)) {
            let has_none = stretch.first().is_some_and(|z_m| is_flat(**z_m));
            if has_none && stretch.len() >= MIN_FRAMES {
                n_flat += stretch.len();
                stretch.iter_mut().for_each(|z_m| **z_m = None);
            }
        }
    }
    if n_flat > 0 {
        table.notes.push(format!(
            "{n_flat} tracks are at the height of the radar for {MIN_FRAMES} frames or more: the board tracked in a plane \
             meanwhile"
        ));
    }
}

/// The tracks of all frames.
fn tracks_of(table: &mut TrackTable) -> impl Iterator<Item = &mut BoardTrack> {
    let boards = table.frames.iter_mut().flat_map(|f| &mut f.board);
    boards.flat_map(|b| &mut b.tracks)
}

#[cfg(test)]
mod tests {
    use super::*;

    const TABLE: &str = "Session_ID,Recording_Number,Frame_count,tid,posy,posz,vely,velz,pointy0,pointz0,snr0,pointy1,pointz1,snr1\n\
        7,1,65,0,2.5,-0.5,0.1,-1.2,2.4,-0.6,16.5,2.6,-0.4,12\n\
        7,1,66,0,2.5,-0.6,0.1,-1.3,2.4,-0.6,16.5,,,\n\
        7,1,66,1,4,0.3,0,0,,,,,,\n\
        7,2,10,0,2.5,-1.3,0,0,,,,,,\n";

    #[test]
    fn tracks_points_and_recordings_are_read() {
        let table = read_track_table(TABLE).unwrap();
        let numbers: Vec<u64> = table.frames.iter().map(|f| f.number).collect();
        assert_eq!(numbers, [65, 66, 166]);
        let counts: Vec<usize> = table.frames.iter().map(|f| f.points.len()).collect();
        assert_eq!(counts, [2, 1, 0]);
        let board = table.frames[1].board.as_ref().unwrap();
        assert_eq!(board.tracks.len(), 2);
        assert_eq!(
            board.tracks[0],
            BoardTrack {
                id: 0,
                place_m: [0.0, 2.5],
                height_m: Some(-0.6),
                velocity_mps: [0.0, 0.1, -1.3]
            }
        );
        assert_eq!(table.frames[0].points[1].intensity_db, 12.0);
        assert!(
            table.notes[0].starts_with("2 recordings"),
            "{:?}",
            table.notes
        );
    }

    #[test]
    fn impossible_values_are_counted_and_flat_heights_are_none() {
        let text = TABLE.replace("-1.2", "-3.8e19").replace("16.5", "1e9");
        let table = read_track_table(&text).unwrap();
        assert!(table.frames[0].board.as_ref().unwrap().tracks.is_empty());
        assert_eq!(table.frames[0].points.len(), 1);
        assert!(
            table.notes[1].starts_with("1 tracks and 2 points"),
            "{:?}",
            table.notes
        );
        // A height that is none leaves the place.
        let table = read_track_table("tid,posy,posz\n0,2,NaN\n0,2,\n0,2,0.4\n").unwrap();
        let tracks = table
            .frames
            .iter()
            .flat_map(|f| &f.board)
            .flat_map(|b| &b.tracks);
        let found: Vec<(f32, Option<f32>)> = tracks.map(|t| (t.place_m[1], t.height_m)).collect();
        assert_eq!(found, [(2.0, None), (2.0, None), (2.0, Some(0.4))]);
        assert!(
            table.notes.iter().any(|n| n.starts_with("1 heights")),
            "{:?}",
            table.notes
        );
        let flat = "tid,posy,posz\n0,2,0\n0,2,0.01\n0,2,0\n";
        let table = read_track_table(flat).unwrap();
        let heights = table
            .frames
            .iter()
            .flat_map(|f| &f.board)
            .flat_map(|b| &b.tracks);
        assert!(heights.clone().count() == 3 && heights.into_iter().all(|t| t.height_m.is_none()));
    }

    #[test]
    fn damage_is_named_with_its_line() {
        let error = read_track_table("tid,posx\n0,1\n").unwrap_err();
        assert_eq!(error.at, Place::Line(1));
        let error = read_track_table(&TABLE.replace("2.6", "far")).unwrap_err();
        assert_eq!(
            error.to_string(),
            "line 2: expected a number for `pointy1`, found `far`"
        );
        let error = read_track_table(&TABLE.replace("7,1,65", "7,1,6.5")).unwrap_err();
        assert_eq!(error.at, Place::Line(2));
        assert_eq!(read_track_table("tid,posy,posz\n").unwrap().frames, []);
    }

    /// A table of two recordings, of which the first one was tracked in a plane.
    #[test]
    fn heights_that_are_nearly_zero_for_seconds_are_none() {
        let table = |n_flat: usize| {
            let mut text = String::from("frame,tid,posy,posz\n");
            for n in 0..n_flat {
                text += &format!("{n},0,2.5,{}\n", [0.001, -0.004][n % 2]);
            }
            for n in n_flat..n_flat + 30 {
                text += &format!("{n},0,2.5,{}\n", 0.3 + 0.01 * (n % 7) as f32);
            }
            let table = read_track_table(&text).unwrap();
            let boards = table.frames.iter().flat_map(|f| &f.board);
            let heights: Vec<Option<f32>> =
                boards.flat_map(|b| &b.tracks).map(|t| t.height_m).collect();
            (heights, table.notes)
        };
        let (heights, notes) = table(40);
        assert!(heights[..40].iter().all(Option::is_none));
        assert!(heights[40..].iter().all(Option::is_some));
        assert!(notes.iter().any(|n| n.contains("40 tracks")), "{notes:?}");
        // For a second, somebody may be at that height.
        assert!(table(10).0.iter().all(Option::is_some));
    }
}
