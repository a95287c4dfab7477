//! Joins the files of one recording: checks that they agree, orders frames, and collects notes for the user.

use radarllm_base::{RadarPoint, stats::median_upper};

use super::{
    PREFIX, VisualizerCounts, VisualizerFrame, VisualizerPart, VisualizerRecording, moved,
};
use crate::recordings::pieces::{PiecesError, left_over, ordered};
use crate::sensor_position::SensorPosition;

/// Demos whose display is based on that of people tracking. It rotates points by the tilts of `sensorPosition` and adds
/// its height, in place, in the array that is saved later.
const LEVELLING_DEMOS: [&str; 6] = [
    "3D People Tracking",
    "Vital Signs with People Tracking",
    "Small Obstacle Detection",
    "Exterior Intrusion Monitoring",
    "x432 Out of Box Demo",
    "x844 Out of Box Demo",
];

/// Joins files (number in the file name, content) in the order of their numbers.
///
/// # Errors
/// No files, two files with the same number, or files of different recordings, whose `cfg`, `demo` or `device` differ.
pub fn join_parts(parts: Vec<(u64, VisualizerPart)>) -> Result<VisualizerRecording, PiecesError> {
    let (parts, gaps) = ordered(parts, name)?;
    let mut notes: Vec<String> = gaps.into_iter().collect();
    let cfg = common(&parts, "`cfg`", |p| p.cfg.as_deref())?;
    let demo = common(&parts, "`demo`", |p| p.demo.as_deref())?;
    let device = common(&parts, "`device`", |p| p.device.as_deref())?;

    let sensor_position = match cfg.as_deref().map(SensorPosition::from_ti_cfg) {
        Some(Ok(position)) => position,
        Some(Err(error)) => {
            notes.push(format!(
                "`cfg`: {error}; the sensor's height and tilt are not known"
            ));
            None
        }
        None => None,
    };
    let levels = demo
        .as_deref()
        .is_some_and(|d| LEVELLING_DEMOS.contains(&d));
    // The visualizer starts without height and tilt. Without the chirp file, its settings are unknown.
    let z_above_floor = levels
        && match &sensor_position {
            Some(p) => p.height_m != 0.0,
            None => cfg.is_none(),
        };
    if levels && cfg.is_none() {
        notes.push(
            "the visualizer has raised the points by the sensor's height, which is not stored: there is no `cfg`".into(),
        );
    }

    let mut counts = VisualizerCounts::default();
    let mut frames: Vec<VisualizerFrame> = Vec::new();
    let mut n_repeated = 0;
    let mut n_levelled = 0;
    for (_, part) in parts {
        let mut part = part;
        if z_above_floor && let Some(position) = &sensor_position {
            n_levelled += u64::from(level_last(&mut part.frames, position));
        }
        let repeats = !frames.is_empty()
            && part.frames.len() >= frames.len()
            && frames.iter().zip(&part.frames).all(|(a, b)| {
                (a.frame.number, a.frame.stamp_s) == (b.frame.number, b.frame.stamp_s)
            });
        if repeats {
            // Some versions save all previous frames in every file.
            n_repeated += 1;
            frames = part.frames;
            counts = part.counts;
        } else {
            frames.append(&mut part.frames);
            counts.add(part.counts);
        }
    }
    if n_repeated > 0 {
        notes.push(format!(
            "{n_repeated} files start with all frames of those before them: every frame is used once"
        ));
    }
    if n_levelled > 0 {
        notes.push(format!(
            "{n_levelled} files were saved before the visualizer had turned and raised their last frame: it was turned \
             and raised like the others"
        ));
    }
    if let Some((n, note)) = left_over(frames.iter().map(|f| f.frame.number)) {
        frames.drain(..n);
        notes.push(note);
    }
    counts.describe(&mut notes);
    Ok(VisualizerRecording {
        cfg,
        demo,
        device,
        sensor_position,
        z_above_floor,
        frames,
        notes,
    })
}

fn name(number: u64) -> String {
    format!("{PREFIX}{number}.json")
}

/// The value of all parts that have one; an error if they differ.
fn common(
    parts: &[(u64, VisualizerPart)],
    what: &'static str,
    value: impl Fn(&VisualizerPart) -> Option<&str>,
) -> Result<Option<String>, PiecesError> {
    let mut found: Option<(u64, &str)> = None;
    for (number, part) in parts {
        match (found, value(part)) {
            (_, None) => {}
            (None, Some(text)) => found = Some((*number, text)),
            (Some((_, before)), Some(text)) if before == text => {}
            (Some((first, _)), Some(_)) => {
                return Err(PiecesError::SeveralRecordings {
                    what,
                    first: name(first),
                    second: name(*number),
                });
            }
        }
    }
    Ok(found.map(|(_, text)| text.to_owned()))
}

/// Rotates and raises the points of the last frame if the result agrees better with the frames before it; returns
/// whether it did. A file is saved by the thread that reads the port, as soon as its last frame is parsed. The points
/// of that frame are rotated and raised later, by the thread that draws, so that the file may contain them unchanged.
fn level_last(frames: &mut [VisualizerFrame], position: &SensorPosition) -> bool {
    /// Number of frames before the last one that it is compared with.
    const N_COMPARED: usize = 10;
    let Some((last, before)) = frames.split_last_mut() else {
        return false;
    };
    let recent = &before[before.len().saturating_sub(N_COMPARED)..];
    let mounting = position.mounting();
    let raised = |xyz: [f64; 3]| {
        let [x, y, z] = mounting.level(xyz);
        [x, y, z + position.height_m]
    };
    // Tracks decide where there are any: they are there without points, and move less.
    let by_tracks = is_raw(
        median_z(recent.iter().flat_map(|f| &f.tracks).map(|t| t.position_m)),
        median_z(last.tracks.iter().map(|t| t.position_m)),
        median_z(
            last.tracks
                .iter()
                .map(|t| as_f32(raised(t.position_m.map(f64::from)))),
        ),
        position,
    );
    let of_point = |p: &RadarPoint| [p.x_m, p.y_m, p.z_m];
    let by_points = || {
        is_raw(
            median_z(recent.iter().flat_map(|f| &f.frame.points).map(of_point)),
            median_z(last.frame.points.iter().map(of_point)),
            median_z(
                last.frame
                    .points
                    .iter()
                    .map(|p| as_f32(raised(of_point(p).map(f64::from)))),
            ),
            position,
        )
    };
    let is_raw = by_tracks.or_else(by_points).unwrap_or(false);
    if is_raw {
        for point in &mut last.frame.points {
            *point = moved(point, raised);
        }
        for track in &mut last.tracks {
            track.position_m = as_f32(raised(track.position_m.map(f64::from)));
            track.velocity_mps = as_f32(mounting.level(track.velocity_mps.map(f64::from)));
        }
    }
    is_raw
}

fn as_f32(xyz: [f64; 3]) -> [f32; 3] {
    xyz.map(|v| v as f32)
}

/// Whether stored heights agree worse with those known before than the raised ones; `None` if one is not known.
fn is_raw(
    known: Option<f64>,
    stored: Option<f64>,
    raised: Option<f64>,
    position: &SensorPosition,
) -> Option<bool> {
    let (known, stored, raised) = (known?, stored?, raised?);
    // Half of the height is the margin, because people move far less between two frames.
    Some((raised - known).abs() + 0.5 * position.height_m.abs() < (stored - known).abs())
}

fn median_z(positions: impl Iterator<Item = [f32; 3]>) -> Option<f64> {
    median_upper(positions.map(|p| p[2])).map(f64::from)
}

impl VisualizerCounts {
    fn add(&mut self, other: Self) {
        self.frames_with_error += other.frames_with_error;
        self.frames_without_number += other.frames_without_number;
        self.points_empty += other.points_empty;
        self.points_not_finite += other.points_not_finite;
        self.points_out_of_range += other.points_out_of_range;
        self.points_without_snr += other.points_without_snr;
        self.tracks_dropped += other.tracks_dropped;
        self.first_dropped = self.first_dropped.take().or(other.first_dropped);
    }

    fn describe(&self, notes: &mut Vec<String>) {
        let lines = [
            (
                self.frames_with_error,
                "frames are marked with an error and kept",
            ),
            (
                self.frames_without_number,
                "frames have no number (packets that the visualizer could not parse) and are dropped",
            ),
            (
                self.points_without_snr,
                "points have no SNR: intensity 0 dB",
            ),
            (
                self.tracks_dropped,
                "tracks or heights are not finite or out of range and dropped",
            ),
        ];
        for (n, text) in lines {
            if n > 0 {
                notes.push(format!("{n} {text}"));
            }
        }
        if let Some(first) = &self.first_dropped {
            notes.push(format!(
                "points dropped: {} not finite, {} out of range; the first in {first}",
                self.points_not_finite, self.points_out_of_range
            ));
        }
    }
}
