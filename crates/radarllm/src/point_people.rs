//! People before a board that sends points alone: tracked by this program, with the heights of their points.
//!
//! Boards that track people put the track into the middle of the points, so that the middle of the points of somebody is as
//! high as the track of such a board, and says posture as it does.

use radarllm_base::{PointFrame, stats::quantile_nearest};
use radarllm_measure::{
    Site, SiteError, SiteLearner, TrackedPerson,
    people::{Sample, Tracker},
};
use radarllm_tracking::{Track, TrackOptions, track};

use crate::gaps::follows;

/// Time before and after a moment whose points show a height, s, and the points that it needs.
const AROUND_S: f64 = 1.0;
const MIN_POINTS: usize = 4;

/// The people whom the tracker of this program sees in points. Heights are corrected by the site. Nobody is followed through a
/// time without frames.
pub(crate) fn people_in_points(frames: &[PointFrame], site: Option<&Site>) -> Vec<TrackedPerson> {
    let runs = frames.chunk_by(follows);
    runs.flat_map(|frames| people_of_run(frames, site))
        .collect()
}

fn people_of_run(frames: &[PointFrame], site: Option<&Site>) -> Vec<TrackedPerson> {
    let mut options = TrackOptions::default();
    if !frames
        .iter()
        .flat_map(|f| &f.points)
        .any(|p| p.velocity_mps != 0.0)
    {
        // Speeds are not known.
        options.confirm_moving_frames = 0;
    }
    let tracks = track(frames, &options).unwrap_or_default();
    tracks
        .iter()
        .map(|track| person(frames, track, site))
        .collect()
}

fn person(frames: &[PointFrame], track: &Track, site: Option<&Site>) -> TrackedPerson {
    let level = |y_m: f32, z_m: f32| site.map_or(z_m, |site| site.level([y_m, z_m])[1]);
    let mut heights: Vec<(f64, f32)> = Vec::new();
    for at in &track.frames {
        let frame = &frames[at.frame];
        let points = at
            .points
            .iter()
            .filter_map(|i| frame.points.get(*i as usize));
        heights.extend(points.map(|p| (frame.time_s, level(p.y_m, p.z_m))));
    }
    // Zeros are heights that are not measured.
    if heights.iter().all(|(_, z_m)| *z_m == 0.0) {
        heights.clear();
    }
    let height_m = |t_s: f64| {
        let first = heights.partition_point(|(at_s, _)| *at_s < t_s - AROUND_S);
        let last = heights.partition_point(|(at_s, _)| *at_s <= t_s + AROUND_S);
        let around = &heights[first..last.max(first)];
        (around.len() >= MIN_POINTS)
            .then(|| quantile_nearest(around.iter().map(|(_, z_m)| *z_m), 0.5))?
    };
    let sample = |at: &radarllm_tracking::TrackFrame| {
        let t_s = frames[at.frame].time_s;
        Sample {
            t_s,
            place_m: at.place_m.map(|v| v as f32),
            height_m: height_m(t_s),
            upward_mps: None,
        }
    };
    TrackedPerson {
        tracker: Tracker::Points,
        track: track.id,
        samples: track.frames.iter().map(sample).collect(),
    }
}

/// Learns a site from people who walk before it, whom the board tracks or the points show.
///
/// # Errors
/// [`SiteError`]: no heights, or nobody walked for long enough.
pub fn learn_site(radar: &str, frames: &[PointFrame]) -> Result<Site, SiteError> {
    let mut learner = SiteLearner::default();
    learn_from(&mut learner, frames);
    learner.site(radar)
}

/// Adds frames to what is learned of a site.
pub fn learn_from(learner: &mut SiteLearner, frames: &[PointFrame]) {
    match frames.iter().all(|frame| frame.board.is_none()) {
        true => learner.add_people(&people_in_points(frames, None)),
        false => learner.add(frames),
    }
}
