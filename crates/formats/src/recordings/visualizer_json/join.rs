//! Joins the files of one recording: checks that they agree, orders frames, and collects notes for the user.

use radarllm_base::{RadarPoint, stats::median_upper};

use super::demos::Demo;
use super::{
    PREFIX, SnrUnit, VisualizerCounts, VisualizerFrame, VisualizerPart, VisualizerRecording, moved,
};
use crate::mounting::Mounting;
use crate::recordings::pieces::{Pieces, PiecesError, Run, Runs, gaps, left_over, ordered};
use crate::recordings::printable;
use crate::sensor_position::SensorPosition;

/// Steps of the computer's clock that are smaller than this do not begin a new run, s: time services set clocks back by
/// fractions of a second, while the shortest run that leaves a file lasts 100 frames.
const MAX_CLOCK_STEP_S: f64 = 1.0;

/// No radar reports a median SNR above this, dB.
const MAX_MEDIAN_SNR_DB: f32 = 60.0;

/// Joins files (number in the file name, content) in the order of their numbers.
///
/// # Errors
/// No files, two files with the same number, files of several runs (see [`join_run`]), or files of different recordings,
/// whose `cfg`, `demo` or `device` differ.
pub fn join_parts(parts: Vec<(u64, VisualizerPart)>) -> Result<VisualizerRecording, PiecesError> {
    join_run(parts, None)
}

/// [`join_parts`] for one of several runs that wrote into the same folder, counted from 1 for the oldest. A new run begins
/// at a file whose first time stamp is earlier than the last one of the file before it, or, where stamps are missing,
/// whose first frame number is smaller.
///
/// # Errors
/// As [`join_parts`]; also if there is no such run.
pub fn join_run(
    parts: Vec<(u64, VisualizerPart)>,
    run: Option<usize>,
) -> Result<VisualizerRecording, PiecesError> {
    let (mut parts, chosen) = runs(ordered(parts)?).choose(run)?;
    let mut notes: Vec<String> = chosen.into_iter().chain(gaps(&parts, name)).collect();
    let mut warnings = Vec::new();
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
    let known = demo.as_deref().and_then(Demo::named);
    // All displays with a view in three dimensions level their points, so demos that are not known probably do.
    let levels = known.is_none_or(|demo| demo.levels);
    // The visualizer starts without height and tilt. Without the chirp file, its settings are unknown.
    let z_above_floor = levels
        && match &sensor_position {
            Some(p) => p.height_m != 0.0 || p.mounting() != Mounting::default(),
            None => known.is_some() && cfg.is_none(),
        };
    if z_above_floor && cfg.is_none() {
        notes.push(
            "the visualizer has raised the points by the sensor's height, which is not stored: there is no `cfg`".into(),
        );
    }
    let snr = settle_snr(&mut parts, known, device.as_deref());
    if known.is_none() {
        warnings.push(assumptions(
            demo.as_deref(),
            z_above_floor,
            &sensor_position,
            &snr,
        ));
    } else if snr.is_doubtful() {
        warnings.push(format!(
            "the SNR of the points has a median of {:.0} dB, more than any radar reports: it is probably a ratio",
            snr.median
        ));
    }

    let mut counts = VisualizerCounts::default();
    let mut frames: Vec<VisualizerFrame> = Vec::new();
    let mut n_repeated = 0;
    let mut n_levelled = 0;
    let position = sensor_position.as_ref();
    let raised_by = position.filter(|p| z_above_floor && p.height_m != 0.0);
    let are_raw = raised_by.map(|position| last_frames_are_raw(&parts, position));
    for (at, (_, part)) in parts.into_iter().enumerate() {
        let mut part = part;
        if let (Some(position), Some(are_raw)) = (raised_by, &are_raw)
            && are_raw[at]
        {
            n_levelled += u64::from(level_last(&mut part.frames, position));
        }
        if repeats(&frames, &part.frames) {
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
    warnings.extend(counts.unread(frames.iter().all(|f| f.frame.points.is_empty())));
    warnings.extend(clock_steps_back(&frames));
    Ok(VisualizerRecording {
        cfg,
        demo,
        device,
        sensor_position,
        z_above_floor,
        frames,
        notes,
        warnings,
    })
}

/// Splits sorted files where the clock falls back.
fn runs(parts: Pieces<VisualizerPart>) -> Runs<VisualizerPart> {
    let mut runs: Vec<Pieces<VisualizerPart>> = Vec::new();
    let mut evidence = None;
    for (number, part) in parts {
        let last_with_frames = runs
            .last()
            .and_then(|run| run.iter().rev().find(|(_, p)| !p.frames.is_empty()));
        let fall = last_with_frames.and_then(|(before, last)| {
            let fall = match repeats(&last.frames, &part.frames) {
                true => None,
                false => fall(&last.frames, &part.frames),
            };
            fall.map(|fall| format!("{fall} from {} to {}", name(*before), name(number)))
        });
        match (runs.last_mut(), &fall) {
            (Some(run), None) => run.push((number, part)),
            _ => runs.push(vec![(number, part)]),
        }
        evidence = evidence.or(fall);
    }
    let described = |run: Pieces<VisualizerPart>| (describe_run(&run), run);
    Runs {
        runs: runs.into_iter().map(described).collect(),
        evidence,
    }
}

/// Whether frames begin with all of those before them.
fn repeats(before: &[VisualizerFrame], frames: &[VisualizerFrame]) -> bool {
    let key = |f: &VisualizerFrame| (f.frame.number, f.frame.stamp_s);
    !before.is_empty()
        && frames.len() >= before.len()
        && before.iter().zip(frames).all(|(a, b)| key(a) == key(b))
}

/// How far the clock falls back between two files, if that shows that they are of different runs.
fn fall(before: &[VisualizerFrame], after: &[VisualizerFrame]) -> Option<String> {
    let (last, first) = (&before.last()?.frame, &after.first()?.frame);
    let number_falls = first.number < last.number;
    match (last_stamp_s(before), first_stamp_s(after)) {
        (Some(last_s), Some(first_s)) => {
            let fall_s = last_s - first_s;
            let is_fall = fall_s > MAX_CLOCK_STEP_S || fall_s > 0.0 && number_falls;
            is_fall.then(|| format!("the time stamps fall back by {fall_s:.1} s"))
        }
        _ => number_falls.then(|| {
            format!(
                "the frame numbers fall back from {} to {}",
                last.number, first.number
            )
        }),
    }
}

fn first_stamp_s(frames: &[VisualizerFrame]) -> Option<f64> {
    frames.iter().find_map(|f| f.frame.stamp_s)
}

fn last_stamp_s(frames: &[VisualizerFrame]) -> Option<f64> {
    frames.iter().rev().find_map(|f| f.frame.stamp_s)
}

fn describe_run(parts: &Pieces<VisualizerPart>) -> Run {
    let piece =
        |part: Option<&(u64, VisualizerPart)>| part.map(|(n, _)| name(*n)).unwrap_or_default();
    let first = parts.iter().find_map(|(_, p)| p.frames.first());
    let last = parts.iter().rev().find_map(|(_, p)| p.frames.last());
    let first_s = parts.iter().find_map(|(_, p)| first_stamp_s(&p.frames));
    let last_s = parts
        .iter()
        .rev()
        .find_map(|(_, p)| last_stamp_s(&p.frames));
    let mut n_frames = 0;
    let mut before: &[VisualizerFrame] = &[];
    for (_, part) in parts {
        if repeats(before, &part.frames) {
            n_frames -= before.len();
        }
        n_frames += part.frames.len();
        before = &part.frames;
    }
    let ms = |stamp_s: f64| (stamp_s * 1e3).round() as i64;
    Run {
        first_piece: piece(parts.first()),
        last_piece: piece(parts.last()),
        n_frames,
        frame_numbers: first
            .zip(last)
            .map(|(a, b)| (a.frame.number, b.frame.number)),
        stamps_ms: first_s.zip(last_s).map(|(a, b)| (ms(a), ms(b))),
    }
}

/// A warning if time stamps fall back within the recording, where frame numbers may hide it.
fn clock_steps_back(frames: &[VisualizerFrame]) -> Option<String> {
    let mut last: Option<(u64, f64)> = None;
    let mut falls: Vec<(u64, f64)> = Vec::new();
    for frame in frames {
        let Some(stamp_s) = frame.frame.stamp_s else {
            continue;
        };
        if let Some((number, before_s)) = last
            && before_s - stamp_s > MAX_CLOCK_STEP_S
        {
            falls.push((number, before_s - stamp_s));
        }
        last = Some((frame.frame.number, stamp_s));
    }
    let (number, first_s) = falls.first()?;
    Some(format!(
        "the clock of the time stamps falls back {} times within the files, first by {first_s:.1} s after frame {number}: \
         the frames are used in the order of the files",
        falls.len()
    ))
}

/// How the SNR of the files was read.
struct SnrReading {
    unit: SnrUnit,
    /// Whether a noise other than 0 is stored beside the SNR of a point.
    has_noise: bool,
    /// Median of the numbers in the files that are not 0; 0 without any.
    median: f32,
}

impl SnrReading {
    fn is_doubtful(&self) -> bool {
        self.unit == SnrUnit::Decibels && self.median > MAX_MEDIAN_SNR_DB
    }
}

/// Decides the unit of the SNR where the demo does not tell it, and converts the points to dB. Compressed points have a
/// ratio and no noise, others decibels with a noise beside them; and no radar has a median of more than
/// [`MAX_MEDIAN_SNR_DB`].
fn settle_snr(
    parts: &mut Pieces<VisualizerPart>,
    demo: Option<&Demo>,
    device: Option<&str>,
) -> SnrReading {
    let has_noise = parts.iter().any(|(_, p)| p.has_noise);
    let stored = parts
        .iter()
        .filter(|(_, p)| p.snr_unit != Some(SnrUnit::Ratio));
    let points = stored.flat_map(|(_, p)| p.frames.iter().flat_map(|f| &f.frame.points));
    let median = median_upper(points.map(|p| p.intensity_db).filter(|snr| *snr != 0.0));
    let median = median.unwrap_or(0.0);
    let stated = demo.and_then(|demo| demo.snr_unit(device));
    let unit = stated.unwrap_or(match has_noise && median <= MAX_MEDIAN_SNR_DB {
        true => SnrUnit::Decibels,
        false => SnrUnit::Ratio,
    });
    for (_, part) in parts {
        if part.snr_unit.is_none() {
            part.finish_points(unit);
        }
    }
    SnrReading {
        unit,
        has_noise,
        median,
    }
}

/// What is assumed of a demo that is not known.
fn assumptions(
    demo: Option<&str>,
    is_level: bool,
    position: &Option<SensorPosition>,
    snr: &SnrReading,
) -> String {
    let demo = match demo {
        Some(name) => format!("the demo `{}` is not known", printable(name)),
        None => "the files name no demo".into(),
    };
    let axes = match position {
        Some(position) if is_level => format!(
            "as turned and raised by the visualizer (sensorPosition: {} m high)",
            position.height_m
        ),
        _ => "as in the axes of the sensor".into(),
    };
    let reason = match (snr.has_noise, snr.unit) {
        (true, SnrUnit::Ratio) => "its median would be too high for dB",
        (true, SnrUnit::Decibels) => "noise is stored beside it",
        (false, _) => "no noise is stored beside it",
    };
    let unit = match snr.unit {
        SnrUnit::Ratio => "a ratio",
        SnrUnit::Decibels => "dB",
    };
    format!("{demo}: its points are taken {axes}, and the SNR as {unit}, because {reason}")
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

/// Whether the last frame of each file is neither rotated nor raised. A file is saved by the thread that reads the port, as soon
/// as its last frame is parsed. The points of that frame are rotated and raised later, by the thread that draws, so that the
/// file may contain them unchanged. Where the frames before it do not tell, it is as in most other files.
fn last_frames_are_raw(parts: &Pieces<VisualizerPart>, position: &SensorPosition) -> Vec<bool> {
    let found: Vec<Option<bool>> = parts
        .iter()
        .map(|(_, part)| last_is_raw(&part.frames, position))
        .collect();
    let n = |raw: bool| found.iter().filter(|one| **one == Some(raw)).count();
    let is_usual = n(true) > n(false);
    found
        .into_iter()
        .map(|one| one.unwrap_or(is_usual))
        .collect()
}

/// Whether the last frame agrees better with the frames before it if it is rotated and raised; `None` if they do not tell.
fn last_is_raw(frames: &[VisualizerFrame], position: &SensorPosition) -> Option<bool> {
    /// Number of frames before the last one that it is compared with.
    const N_COMPARED: usize = 10;
    let (last, before) = frames.split_last()?;
    let recent = &before[before.len().saturating_sub(N_COMPARED)..];
    let raised = |xyz: [f32; 3]| as_f32(raise(position, xyz.map(f64::from)));
    let tracks = || last.tracks.iter().map(|t| t.position_m);
    let points = || last.frame.points.iter().map(xyz_of);
    // Tracks decide where there are any: they are there without points, and move less.
    let by_tracks = is_raw(
        median_z(recent.iter().flat_map(|f| &f.tracks).map(|t| t.position_m)),
        median_z(tracks()),
        median_z(tracks().map(raised)),
    );
    let by_points = || {
        is_raw(
            median_z(recent.iter().flat_map(|f| &f.frame.points).map(xyz_of)),
            median_z(points()),
            median_z(points().map(raised)),
        )
    };
    by_tracks.or_else(by_points)
}

/// Rotates and raises the points and tracks of the last frame; returns whether there are any.
fn level_last(frames: &mut [VisualizerFrame], position: &SensorPosition) -> bool {
    let Some(last) = frames.last_mut() else {
        return false;
    };
    for point in &mut last.frame.points {
        *point = moved(point, |xyz| raise(position, xyz));
    }
    for track in &mut last.tracks {
        track.position_m = as_f32(raise(position, track.position_m.map(f64::from)));
        track.velocity_mps = as_f32(position.mounting().level(track.velocity_mps.map(f64::from)));
    }
    !last.frame.points.is_empty() || !last.tracks.is_empty()
}

/// What the visualizer makes of a place in the axes of the sensor, m.
fn raise(position: &SensorPosition, xyz: [f64; 3]) -> [f64; 3] {
    let [x, y, z] = position.mounting().level(xyz);
    [x, y, z + position.height_m]
}

fn xyz_of(point: &RadarPoint) -> [f32; 3] {
    [point.x_m, point.y_m, point.z_m]
}

fn as_f32(xyz: [f64; 3]) -> [f32; 3] {
    xyz.map(|v| v as f32)
}

/// Whether stored heights agree worse with those known before than the raised ones; `None` if one is not known.
fn is_raw(known: Option<f64>, stored: Option<f64>, raised: Option<f64>) -> Option<bool> {
    let (known, stored, raised) = (known?, stored?, raised?);
    // Half of what turning and raising changes is the margin: far away, turning lowers by nearly as much as raising raises.
    Some((raised - known).abs() + 0.5 * (raised - stored).abs() < (stored - known).abs())
}

fn median_z(positions: impl Iterator<Item = [f32; 3]>) -> Option<f64> {
    median_upper(positions.map(|p| p[2])).map(f64::from)
}

impl VisualizerCounts {
    fn add(&mut self, other: Self) {
        self.frames_with_error += other.frames_with_error;
        self.frames_without_number += other.frames_without_number;
        self.points_empty += other.points_empty;
        self.points_minor += other.points_minor;
        self.points_not_finite += other.points_not_finite;
        self.points_out_of_range += other.points_out_of_range;
        self.points_without_snr += other.points_without_snr;
        self.tracks_dropped += other.tracks_dropped;
        self.first_dropped = self.first_dropped.take().or(other.first_dropped);
        self.unread_clouds.extend(other.unread_clouds);
    }

    /// Warnings about points that the frames lack.
    fn unread(&self, is_empty: bool) -> Vec<String> {
        let mut warnings = Vec::new();
        if !self.unread_clouds.is_empty() {
            let names: Vec<String> = self
                .unread_clouds
                .iter()
                .map(|n| format!("`{n}`"))
                .collect();
            warnings.push(format!(
                "{} are not read: they are not known",
                names.join(", ")
            ));
        }
        let dropped = self.points_empty + self.points_not_finite + self.points_out_of_range;
        if is_empty && dropped > 0 {
            warnings.push(format!(
                "none of the {dropped} points in the files can be used: that no point is left does not mean that nobody \
                 was there"
            ));
        }
        warnings
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
                self.points_empty,
                "points are zero in every number (the visualizer did not parse them) and are dropped",
            ),
            (
                self.points_minor,
                "points are of slow motion (`pointCloudMinor`) and kept with the others",
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
