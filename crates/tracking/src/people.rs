//! Tracks of the people in a clip, without multipath ghosts and static clutter, and a clip for each person.

use radarllm_base::{Clip, Clutter, PointFrame, STATIC_SPEED_MPS, StaticClutter};

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
/// Static points of a [`Clutter::Unchecked`] clip are excluded from tracking, but kept in the clip, if they are more
/// than half of all points: they are clutter then.
///
/// # Errors
/// If an option is out of range.
pub fn find_people(clip: &mut Clip, options: &PeopleOptions) -> Result<People, OptionError> {
    let mut track_options = options.track;
    let excluded = match clip.clutter {
        Clutter::Settled => None,
        Clutter::Unchecked => clip.static_clutter(),
    };
    let frames = clip.frames.as_mut_slice();
    if excluded.is_some() {
        track_options.cluster.slowest_mps = f64::from(STATIC_SPEED_MPS);
    }
    let mut tracks = track(frames, &track_options)?;
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
        let mut only: Vec<PointFrame> = frames
            .iter()
            .map(|f| PointFrame {
                points: Vec::new(),
                ..*f
            })
            .collect();
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
