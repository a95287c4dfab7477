//! Tracks of the people in a clip, without multipath ghosts and static clutter, and a clip for each person.

use radarllm_base::{Clip, Clutter, PointFrame, StaticCells, StaticClutter};

use crate::{
    OptionError,
    ghosts::{Ghost, find_ghosts},
    tracker::{Track, TrackFrame, TrackOptions, track},
};

/// Options for finding people.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PeopleOptions {
    /// Maximum number of people; those with the highest number of points are kept. `None` means no limit.
    pub max_people: Option<usize>,
    /// Remove tracks that are multipath reflections of others, together with their points.
    pub remove_ghosts: bool,
    /// Options of the tracker.
    pub track: TrackOptions,
}

/// Result of tracking.
#[derive(Clone, Debug, Default)]
pub struct People {
    /// People, in the order in which they were first seen.
    pub tracks: Vec<Track>,
    /// Multipath reflections that were removed; they are not among the tracks.
    pub ghosts: Vec<Ghost>,
    /// Static points that were excluded from tracking as clutter.
    pub excluded: Option<StaticClutter>,
}

/// A person's part of a clip.
#[derive(Clone, Debug, PartialEq)]
pub struct Person {
    /// Number of the track, from 1.
    pub id: u32,
    /// Start of the first frame in which the person was seen, s.
    pub start_s: f64,
    /// Start of the last frame in which the person was seen, s.
    pub end_s: f64,
    /// Points over all frames.
    pub n_points: usize,
    /// The person's points, from the first to the last frame in which the person was seen.
    pub clip: Clip,
}

/// Tracks people through a clip. Multipath reflections are removed from its frames if [`PeopleOptions::remove_ghosts`]
/// is set.
///
/// Static points of a [`Clutter::Unchecked`] clip are excluded from tracking, but kept in the clip, if they are
/// clutter: [`StaticCells::clutter`].
///
/// # Errors
/// If an option is out of range.
pub fn find_people(clip: &mut Clip, options: &PeopleOptions) -> Result<People, OptionError> {
    let frames = clip.frames.as_mut_slice();
    let (cells, excluded) = match clip.clutter {
        Clutter::Settled => (StaticCells::default(), None),
        Clutter::Unchecked => {
            let cells = StaticCells::of(frames);
            let excluded = cells.clutter(frames);
            (cells, excluded)
        }
    };
    let mut tracks = match excluded {
        Some(_) => track_moving(frames, &cells, &options.track)?,
        None => track(frames, &options.track)?,
    };
    let mut ghosts = Vec::new();
    if options.remove_ghosts {
        ghosts = find_ghosts(&tracks, frames);
        remove_ghosts(&ghosts, &mut tracks, frames);
    }
    if let Some(n) = options.max_people {
        let mut counts: Vec<(usize, u32)> = tracks.iter().map(|t| (t.n_points(), t.id)).collect();
        counts.sort_by(|a, b| b.0.cmp(&a.0).then(a.1.cmp(&b.1)));
        counts.truncate(n);
        tracks.retain(|t| counts.iter().any(|(_, id)| *id == t.id));
    }
    Ok(People {
        tracks,
        ghosts,
        excluded,
    })
}

/// Tracks people by the points that are not static. The indices of the tracks are those of all points.
fn track_moving(
    frames: &[PointFrame],
    cells: &StaticCells,
    options: &TrackOptions,
) -> Result<Vec<Track>, OptionError> {
    let moving: Vec<Vec<u32>> = frames
        .iter()
        .map(|frame| {
            let all = (0_u32..).zip(&frame.points);
            let kept = all.filter(|(_, p)| !cells.is_static(p));
            kept.map(|(i, _)| i).collect()
        })
        .collect();
    let without: Vec<PointFrame> = frames
        .iter()
        .zip(&moving)
        .map(|(frame, kept)| {
            frame.with_points(kept.iter().map(|i| frame.points[*i as usize]).collect())
        })
        .collect();
    let mut tracks = track(&without, options)?;
    for at in tracks.iter_mut().flat_map(|t| &mut t.frames) {
        let kept = &moving[at.frame];
        at.points.iter_mut().for_each(|i| *i = kept[*i as usize]);
    }
    Ok(tracks)
}

/// Returns the clip of each person in a clip; empty if no person is found.
///
/// ```
/// use radarllm_base::{Clip, Clutter, Provenance};
/// use radarllm_tracking::{PeopleOptions, track_people};
///
/// let empty = Clip {
///     frames: Vec::new(),
///     frame_rate_hz: 10.0,
///     radar_height_m: 1.0,
///     is_height_assumed: false,
///     radar: "iwr6843isk".into(),
///     provenance: Provenance::recorded("uart", "empty.dat"),
///     clutter: Clutter::Unchecked,
/// };
/// assert!(track_people(empty, &PeopleOptions::default())?.is_empty());
/// # Ok::<(), radarllm_tracking::OptionError>(())
/// ```
///
/// # Errors
/// If an option is out of range.
pub fn track_people(mut clip: Clip, options: &PeopleOptions) -> Result<Vec<Person>, OptionError> {
    let people = find_people(&mut clip, options)?;
    Ok(people.tracks.iter().map(|t| Person::of(t, &clip)).collect())
}

impl Person {
    /// Extracts the person of a track from a clip.
    pub fn of(track: &Track, clip: &Clip) -> Self {
        let (start_s, end_s) = track.span_s(&clip.frames);
        Self {
            id: track.id,
            start_s,
            end_s,
            n_points: track.n_points(),
            clip: clip.with_frames(track.points(&clip.frames)),
        }
    }
}

impl Track {
    /// Start times of the first and the last frame of the track, s.
    pub fn span_s(&self, frames: &[PointFrame]) -> (f64, f64) {
        let time_s = |at: Option<&TrackFrame>| {
            at.and_then(|at| frames.get(at.frame))
                .map_or(0.0, |f| f.time_s)
        };
        (time_s(self.frames.first()), time_s(self.frames.last()))
    }

    /// Returns all frames with only the points of this track.
    pub fn only_points(&self, frames: &[PointFrame]) -> Vec<PointFrame> {
        let mut only: Vec<PointFrame> = frames.iter().map(|f| f.with_points(Vec::new())).collect();
        for (at, points) in self.frames.iter().zip(self.points(frames)) {
            only[at.frame].points = points.points;
        }
        only
    }
}

/// Removes ghost tracks, and their points from the frames. Updates the point indices of the other tracks.
fn remove_ghosts(ghosts: &[Ghost], tracks: &mut Vec<Track>, frames: &mut [PointFrame]) {
    let is_ghost = |track: &Track| ghosts.iter().any(|g| g.id == track.id);
    let mut removed: Vec<Vec<u32>> = vec![Vec::new(); frames.len()];
    for at in tracks
        .iter()
        .filter(|t| is_ghost(t))
        .flat_map(|t| &t.frames)
    {
        removed[at.frame].extend(&at.points);
    }
    tracks.retain(|t| !is_ghost(t));
    for at in tracks.iter_mut().flat_map(|t| &mut t.frames) {
        let removed = &removed[at.frame];
        for point in &mut at.points {
            *point -= removed.iter().filter(|r| *r < point).count() as u32;
        }
    }
    for (frame, removed) in frames.iter_mut().zip(&removed) {
        let mut index = 0;
        frame.points.retain(|_| {
            index += 1;
            !removed.contains(&(index - 1))
        });
    }
}

#[cfg(test)]
mod tests {
    use radarllm_base::{Provenance, RadarPoint};

    use super::*;

    /// A wall that fills three Doppler bins, and a person in front of it.
    #[test]
    fn static_cells_are_no_people_and_points_keep_their_indices() {
        let at = |x_m: f32, y_m: f32, velocity_mps: f32| RadarPoint {
            x_m,
            y_m,
            velocity_mps,
            ..RadarPoint::default()
        };
        let frame = |i: u32| {
            let y_m = 2.0 + 0.06 * i as f32;
            let wall = [-0.13, 0.0, 0.13].map(|v| at(1.6, 4.0, v));
            let person = [0.5, 0.6, 0.7].map(|v| at(-0.5, y_m, v));
            PointFrame {
                frame: i,
                time_s: f64::from(i) / 10.0,
                points: [wall, wall, person].concat(),
                board: None,
            }
        };
        let mut clip = Clip {
            frames: (0..40).map(frame).collect(),
            frame_rate_hz: 10.0,
            radar_height_m: 1.0,
            is_height_assumed: false,
            radar: "unknown".into(),
            provenance: Provenance::recorded("uart", "room.dat"),
            clutter: Clutter::Unchecked,
        };
        let people = find_people(&mut clip, &PeopleOptions::default()).unwrap();
        assert_eq!(people.excluded.map(|e| e.n_static), Some(240));
        let [person] = &people.tracks[..] else {
            panic!("{:?}", people.tracks)
        };
        assert!(person.frames.iter().any(|f| f.points == [6, 7, 8]));
        assert!(
            person
                .frames
                .iter()
                .all(|f| f.points.iter().all(|i| *i >= 6))
        );
    }
}
