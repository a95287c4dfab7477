//! Recordings of points in any format of `radarllm-formats`: opened, assigned to a clock and rotated into level axes.

use std::{
    fs,
    io::BufReader,
    path::{Path, PathBuf},
};

use radarllm_base::{
    PointFrame, Provenance, RadarPoint, RecordedFrame, Timeline, TimelineError,
    message::{option, text},
    timeline::MAX_FRAMES,
};
use radarllm_files::{bounded, npy::NPY_MAGIC};
use radarllm_formats::{
    Mounting, RecordingFormat, SensorPosition,
    detect::{numbered, stated_rate_hz},
    recordings::{
        Axes, Bag, BagError, mmbody, read_bag, read_mars_features, read_mars_points,
        read_matlab_points, read_mmbody_frame, read_mmfi_frame, read_radhar_points,
        read_track_table, read_windows_json, windows_json::WINDOW_GAP_S,
    },
    tables::{PointsTable, read_points_csv, read_points_npy, unlikely_snr},
    uart::{Guess, UartReport},
};

use crate::{
    error::{Error, Result},
    opened::{MAX_FILE_BYTES, Opened, RecordingKind, columns_hint},
    options::{CaptureOptions, PointOptions, mounting_angles},
    radar::{OpenedRadar, RadarSource},
    ros2,
    stream::UartStream,
    visualizer,
};

/// Recorded points with their metadata.
#[derive(Debug)]
pub struct RecordedPoints {
    /// Frames in level axes, strongest points first.
    pub timeline: Timeline,
    /// Name of the radar, `unknown` if it is not stated.
    pub radar: String,
    /// Format and path of the recording.
    pub provenance: Provenance,
    /// Height of the radar above the floor, m, if the recording's chirp file states it.
    pub radar_height_m: Option<f32>,
    /// Whether the speeds of the points are known, as far as the format tells; see [`radarllm_base::Clip::has_speeds`].
    pub has_speeds: bool,
    /// Notes for the user: how the format was detected, which data were dropped.
    pub notes: Vec<String>,
    /// What a user should know before trusting the points, a sentence each.
    pub warnings: Vec<String>,
}

/// Opens a recording of points whose format is known.
///
/// # Errors
/// Any error in the file or the options, with the name of the file.
pub fn open_points(
    mut capture: Opened,
    radar: Option<&OpenedRadar>,
    options: &PointOptions,
) -> Result<RecordedPoints> {
    let path = &capture.only_path()?.to_path_buf();
    let RecordingKind::Points(detected) = capture.kind() else {
        return Err(Error::in_file(path, "it holds no recorded points"));
    };
    if UartStream::can_read(&capture) {
        let options = CaptureOptions {
            radar: radar.cloned(),
            points: options.clone(),
            ..CaptureOptions::default()
        };
        return UartStream::open(capture, &options)?.read_all();
    }
    // MATLAB files of MARS are recordings of its board, as its tables are.
    let mut format = detected.format;
    let mut notes = vec![format!("format {} ({})", format.name(), detected.reason)];
    let mut warnings = Vec::new();
    options.check_for_format(format)?;
    let axes = axes(format, options)?;
    let from_firmware = [
        RecordingFormat::VisualizerBinary,
        RecordingFormat::VisualizerJson,
    ]
    .contains(&format);
    // The radar is the one named by the caller, or that of the chirp file in the recording or beside it.
    let mut opened = radar.cloned();
    let mut is_level = false;
    let mut position = None;
    let frames = match format {
        RecordingFormat::RadHar => {
            read_radhar_points(&capture.text()?).map_err(|e| Error::wrap_in_file(path, e))?
        }
        RecordingFormat::Mars => mars(&mut capture)?,
        RecordingFormat::Csv | RecordingFormat::NpyPoints => {
            let columns = options.columns.as_deref();
            let table = match format {
                RecordingFormat::Csv => read_points_csv(&capture.text()?, axes, columns),
                _ => read_points_npy(&capture.bytes()?, axes, columns),
            };
            let table =
                table.map_err(|e| Error::wrap_in_file(path, e).with_hint(columns_hint()))?;
            table_frames(
                path,
                table,
                options,
                opened.as_ref(),
                &mut notes,
                &mut warnings,
            )?
        }
        RecordingFormat::TrackCsv => {
            let table =
                read_track_table(&capture.text()?).map_err(|e| Error::wrap_in_file(path, e))?;
            notes.extend(table.notes);
            doubt_snr(&table.frames, "snrN", &mut notes, &mut warnings);
            table.frames
        }
        RecordingFormat::WindowsJson => {
            let frames =
                read_windows_json(&capture.text()?).map_err(|e| Error::wrap_in_file(path, e))?;
            notes.push(about_windows(&frames));
            frames
        }
        RecordingFormat::Bag => {
            let file = BufReader::new(capture.take_first()?);
            let bag = read_bag(file, options.topic.as_deref(), axes);
            bag_frames(path, bag, options, &mut notes, &mut warnings)?
        }
        RecordingFormat::Ros2Bag => {
            let bag = ros2::read(&mut capture, options.topic.as_deref(), axes, &mut warnings)?;
            notes.extend_from_slice(&warnings);
            bag_frames(path, bag, options, &mut notes, &mut warnings)?
        }
        RecordingFormat::MmFi => {
            folder_of_frames(&mut capture, "frame", |bytes| read_mmfi_frame(bytes, axes))?
        }
        RecordingFormat::MmBody => folder_of_frames(&mut capture, "frame_", read_mmbody_frame)?,
        RecordingFormat::Mat => {
            let recording =
                read_matlab_points(&capture.bytes()?).map_err(|e| Error::wrap_in_file(path, e))?;
            notes.extend(recording.notes);
            if recording.is_mars {
                format = RecordingFormat::Mars;
            }
            recording.frames
        }
        RecordingFormat::VisualizerBinary => {
            let (dialect, run) = (options.dialect, options.run);
            visualizer::read_binary(&mut capture, dialect, run, &mut notes, &mut warnings)?
        }
        RecordingFormat::VisualizerJson => {
            let recording =
                visualizer::read_json(&mut capture, options.run, &mut notes, &mut warnings)?;
            opened = opened.or(recording.radar);
            is_level = recording.is_level;
            position = recording.position;
            recording.frames
        }
        RecordingFormat::Uart
        | RecordingFormat::Adc
        | RecordingFormat::Dca1000
        | RecordingFormat::Points => {
            return Err(Error::in_file(
                path,
                format!("{} holds no recorded points", format.name()),
            ));
        }
    };
    if frames.is_empty() {
        return Err(Error::in_file(
            path,
            format!("no frame that can be used; {}", notes.join("; ")),
        ));
    }
    if opened.is_none() && from_firmware {
        let n_notes = notes.len();
        let has_stamps = frames.iter().all(|f| f.stamp_s.is_some());
        let is_needed = options.frame_rate_hz.is_none() && !has_stamps;
        opened = visualizer::radar_beside(path, is_needed, &mut notes)?;
        if opened.is_none() {
            warnings.extend_from_slice(&notes[n_notes..]);
        }
    }
    let radar = opened.as_ref();
    if let Some(radar) = radar {
        explain_reasons(radar, &mut notes, &mut warnings);
    }
    let position = position.or_else(|| radar?.points.position);
    let timeline = timeline(path, format, frames, radar, options)?;
    if options.frame_rate_hz.is_none()
        && let Some(text) = other_rate(radar, timeline.frame_rate_hz)
    {
        notes.push(text.clone());
        warnings.push(text);
    }
    let mounting = match is_level {
        true if options.mounting()? != Mounting::default() => {
            return Err(Error::in_file(
                path,
                mounting_angles()
                    .text(": the visualizer has turned these points into level axes already"),
            ));
        }
        true => Mounting::default(),
        false => {
            let n_notes = notes.len();
            let position = position.filter(|_| from_firmware || in_axes_of_radar(format));
            let mounting = mounting(options, position, &mut notes)?;
            // Angles of the chirp file that are not used, or used for a table that may be level already.
            if mounting == options.mounting()? || !from_firmware {
                warnings.extend_from_slice(&notes[n_notes..]);
            }
            mounting
        }
    };
    let timeline = place(timeline, options, mounting)?;
    for text in about_numbers(timeline.mended_numbers, timeline.restarts) {
        warnings.push(text.clone());
        notes.push(text);
    }
    let subset = (format == RecordingFormat::MmBody)
        .then(|| mmbody::subset(&path.to_string_lossy()))
        .flatten()
        .map(|name| format!("({name})"));
    let format_name = format!("{}{}", format.name(), subset.unwrap_or_default());
    Ok(RecordedPoints {
        timeline,
        radar: radar_name(format, radar),
        radar_height_m: position
            .filter(|_| from_firmware || in_axes_of_radar(format))
            .map(|p| p.height_m as f32),
        provenance: Provenance::recorded(&format_name, path.display()),
        has_speeds: true,
        notes,
        warnings,
    })
}

/// Whether the points of a table or a bag are in the axes of a radar, so that its mounting counts: that of data sets is their
/// own.
fn in_axes_of_radar(format: RecordingFormat) -> bool {
    [
        RecordingFormat::Csv,
        RecordingFormat::NpyPoints,
        RecordingFormat::Bag,
        RecordingFormat::Ros2Bag,
    ]
    .contains(&format)
}

/// How often a recording of windows was stopped, and what its times are then.
fn about_windows(frames: &[RecordedFrame]) -> String {
    let is_next = |pair: &&[RecordedFrame]| {
        let [before, after] = [&pair[0], &pair[1]].map(|frame| frame.stamp_s.unwrap_or_default());
        after - before >= WINDOW_GAP_S
    };
    let n_windows = 1 + frames.windows(2).filter(is_next).count();
    format!(
        "{n_windows} windows: their times are put {WINDOW_GAP_S} s apart, because windows need not be in order of time"
    )
}

/// What a user should know of frame numbers that were damaged, and of those that went back.
pub(crate) fn about_numbers(mended: u64, restarts: u64) -> Vec<String> {
    let mut about = Vec::new();
    if mended > 0 {
        about.push(format!(
            "{mended} frame numbers fit neither the frame before nor the one after: damaged, and replaced by a number between"
        ));
    }
    if restarts > 0 {
        about.push(format!(
            "frame numbers went back {restarts} times: the frames follow on"
        ));
    }
    about
}

/// Says why a chirp file has no cube, which points do not need. Mistakes in it are warnings.
pub(crate) fn explain_reasons(
    radar: &OpenedRadar,
    notes: &mut Vec<String>,
    warnings: &mut Vec<String>,
) {
    let reasons = radar.reasons();
    let mistake = reasons.iter().find(|e| !e.is_unsupported());
    let Some(reason) = mistake.or(reasons.first()) else {
        return;
    };
    let note = format!("the chirp file gives frame rate and mounting, and no cube: {reason}");
    if mistake.is_some() {
        warnings.push(note.clone());
    }
    notes.push(note);
}

/// The frames of a table, with what it says about its clock.
fn table_frames(
    path: &Path,
    table: PointsTable,
    options: &PointOptions,
    radar: Option<&OpenedRadar>,
    notes: &mut Vec<String>,
    warnings: &mut Vec<String>,
) -> Result<Vec<RecordedFrame>> {
    notes.extend(table.notes);
    warnings.extend(table.warnings);
    if let Some(error) = table.clock_error {
        if options.frame_rate_hz.is_none() && radar.is_none() {
            return Err(Error::wrap_in_file(path, error).with_hint(
                columns_hint()
                    .text("; ")
                    .option("frame_rate")
                    .text(" HZ gives the frames their times by their numbers"),
            ));
        }
        let text = format!("the times of the table are not used: {error}");
        notes.push(text.clone());
        warnings.push(text);
    }
    let has_clock = table.frames.iter().all(|f| f.stamp_s.is_some());
    if has_clock && options.frame_rate_hz.is_none() && table.number_restarts > 0 {
        notes.push(format!(
            "frame numbers went back {} times: the clock gives the times",
            table.number_restarts
        ));
    }
    if let Some(frame_rate_hz) = options.frame_rate_hz
        && let Some(text) = contradiction(&table.frames, frame_rate_hz)
    {
        notes.push(text.clone());
        warnings.push(text);
    }
    Ok(table.frames)
}

/// Says where intensities cannot be dB.
fn doubt_snr(
    frames: &[RecordedFrame],
    name: &str,
    notes: &mut Vec<String>,
    warnings: &mut Vec<String>,
) {
    if let Some(text) = unlikely_snr(frames, name) {
        notes.push(text.clone());
        warnings.push(text);
    }
}

/// The frames of a bag, with what it says about them.
fn bag_frames(
    path: &Path,
    bag: std::result::Result<Bag, BagError>,
    options: &PointOptions,
    notes: &mut Vec<String>,
    warnings: &mut Vec<String>,
) -> Result<Vec<RecordedFrame>> {
    let bag = bag.map_err(|e| {
        let choices = e.choices.join(", ");
        let error = Error::wrap_in_file(path, e);
        match choices.is_empty() {
            true => error,
            false => error.with_hint(option("topic").text(format!(" names one of {choices}"))),
        }
    })?;
    notes.push(format!(
        "topic {}, {} points dropped (NaN or beyond belief)",
        bag.topic, bag.points_dropped
    ));
    if bag.points_without_intensity > 0 {
        notes.push(format!(
            "the messages have no intensity: {} points have 0 dB",
            bag.points_without_intensity
        ));
    }
    notes.extend(bag.notes);
    doubt_snr(&bag.frames, "intensity", notes, warnings);
    if let Some(frame_rate_hz) = options.frame_rate_hz
        && let Some(text) = contradiction(&bag.frames, frame_rate_hz)
    {
        notes.push(text.clone());
        warnings.push(text);
    }
    Ok(bag.frames)
}

/// What the clock of a recording says against the frame rate that the caller names: more than a tenth and a second less or
/// more from the first to the last frame.
fn contradiction(frames: &[RecordedFrame], frame_rate_hz: f64) -> Option<String> {
    let by_number = Timeline::new(
        frames
            .iter()
            .map(|f| RecordedFrame {
                points: Vec::new(),
                board: None,
                ..*f
            })
            .collect(),
        Some(frame_rate_hz),
    );
    let number_s = by_number.ok()?.frames.last()?.time_s;
    let (first, last) = (frames.first()?.stamp_s?, frames.last()?.stamp_s?);
    let clock_s = last - first;
    if (clock_s - number_s).abs() <= (0.1 * number_s).max(1.0) {
        return None;
    }
    Some(format!(
        "the clock of the recording has {clock_s:.1} s from the first to the last frame, the frame numbers at \
         {frame_rate_hz} Hz have {number_s:.1} s, which are used"
    ))
}

fn axes(format: RecordingFormat, options: &PointOptions) -> Result<Axes> {
    if let Some(axes) = options.orientation {
        return Ok(axes);
    }
    match format {
        // Properties that the data set does not document are not guessed.
        RecordingFormat::MmFi => Err(Error::input(
            text("MM-Fi does not say which way its axes point: ")
                .option("orientation")
                .text(" is needed"),
        )
        .with_hint(
            option("orientation").text(format!(" {}", Axes::ALL.map(Axes::name).join(" or "))),
        )),
        RecordingFormat::Bag | RecordingFormat::Ros2Bag => Ok(Axes::ForwardLeftUp),
        _ => Ok(Axes::RightForwardUp),
    }
}

/// The radar of a data set, or the one named by the caller.
pub(crate) fn radar_name(format: RecordingFormat, radar: Option<&OpenedRadar>) -> String {
    if let Some(radar) = radar {
        return radar.points.name.clone();
    }
    match format {
        RecordingFormat::RadHar | RecordingFormat::Mars => "iwr1443",
        RecordingFormat::MmBody => "arbe",
        _ => "unknown",
    }
    .into()
}

fn timeline(
    path: &Path,
    format: RecordingFormat,
    frames: Vec<RecordedFrame>,
    radar: Option<&OpenedRadar>,
    options: &PointOptions,
) -> Result<Timeline> {
    // A visualizer's time stamps come from the PC, which reads the port in bursts. Frame numbers have no jitter.
    let by_number = format == RecordingFormat::VisualizerJson && radar.is_some();
    let has_clock = !by_number && frames.len() > 1 && frames.iter().all(|f| f.stamp_s.is_some());
    let frame_rate_hz = match (options.frame_rate_hz, radar) {
        (Some(frame_rate_hz), _) => Some(frame_rate_hz),
        (None, _) if has_clock => None,
        (None, Some(radar)) => Some(radar.points.frame_rate_hz()),
        (None, None) => stated_rate_hz(format),
    };
    Timeline::new(frames, frame_rate_hz).map_err(|e| no_rate(path, e))
}

/// What the clock of a recording says against its chirp file, where it is used instead: the file may be that of another one.
fn other_rate(radar: Option<&OpenedRadar>, clock_hz: f64) -> Option<String> {
    /// Clocks of computers lose frames and jitter by less.
    const TOLERANCE: f64 = 0.2;
    let radar = radar.filter(|radar| matches!(radar.source, RadarSource::TiCfg(_)))?;
    let file_hz = radar.points.frame_rate_hz();
    ((clock_hz / file_hz - 1.0).abs() > TOLERANCE).then(|| {
        format!(
            "the clock of the recording has {clock_hz:.2} frames/s and is used, and the chirp file has {file_hz:.2}: it may be \
             that of another recording"
        )
    })
}

/// The error of frames that get no times, with a hint where their rate is missing.
pub(crate) fn no_rate(path: &Path, error: TimelineError) -> Error {
    let has_no_rate = matches!(error, TimelineError::NoRate);
    let error = Error::wrap_in_file(path, error);
    match has_no_rate {
        true => error.with_hint(
            option("frame_rate")
                .text(" HZ, or ")
                .option("radar")
                .text(" with the chirp file of the recording"),
        ),
        false => error,
    }
}

/// Returns the mounting angles: those of the options if any is set, otherwise those of the chirp file, which adds a
/// note.
pub(crate) fn mounting(
    options: &PointOptions,
    position: Option<SensorPosition>,
    notes: &mut Vec<String>,
) -> Result<Mounting> {
    let named = options.mounting()?;
    let Some(position) = position else {
        return Ok(named);
    };
    let stated = position.mounting();
    if stated == Mounting::default() || named == stated {
        return Ok(named);
    }
    let [tilt_deg, yaw_deg] = [stated.tilt_rad, stated.yaw_rad].map(f64::to_degrees);
    let text = format!("sensorPosition: tilt {tilt_deg:.1} degrees, yaw {yaw_deg:.1} degrees");
    if named != Mounting::default() {
        notes.push(format!("{text}; not used, because other angles are given"));
        return Ok(named);
    }
    if !position.elevation_sign_is_certain {
        // Levelling with a tilt of the wrong sign would be worse than no levelling.
        notes.push(format!(
            "{text}; not used, because chirp files of this kind differ in the sign of the tilt: `tilt_deg` sets it"
        ));
        return Ok(named);
    }
    notes.push(text);
    Ok(stated)
}

/// Removes slow points, accumulates frames and rotates points into level axes, according to the options. The strongest
/// points come first.
pub(crate) fn place(
    timeline: Timeline,
    options: &PointOptions,
    mounting: Mounting,
) -> Result<Timeline> {
    Ok(place_with(timeline, &Placement::new(options, mounting)?))
}

/// What [`place`] does, with checked options.
#[derive(Clone, Debug)]
pub(crate) struct Placement {
    min_speed_mps: f32,
    pub n_accumulated: usize,
    motion_compensate: bool,
    mounting: Mounting,
}

impl Placement {
    pub(crate) fn new(options: &PointOptions, mounting: Mounting) -> Result<Self> {
        Ok(Self {
            min_speed_mps: options.min_speed()?,
            n_accumulated: options.n_accumulated()?,
            motion_compensate: options.motion_compensate,
            mounting,
        })
    }

    /// What is done to every frame alone.
    pub(crate) fn of_frame(&self, mut frame: PointFrame) -> PointFrame {
        frame.remove_slower_than(self.min_speed_mps);
        self.mounting.apply(std::slice::from_mut(&mut frame));
        frame.sort_by_intensity();
        frame
    }
}

/// [`place`] with checked options.
pub(crate) fn place_with(mut timeline: Timeline, placement: &Placement) -> Timeline {
    if placement.n_accumulated > 1 {
        for frame in &mut timeline.frames {
            frame.remove_slower_than(placement.min_speed_mps);
        }
        timeline = timeline.accumulate(placement.n_accumulated, placement.motion_compensate);
    }
    let frames = std::mem::take(&mut timeline.frames).into_iter();
    timeline.frames = frames.map(|frame| placement.of_frame(frame)).collect();
    timeline
}

fn read_whole(path: &Path) -> Result<Vec<u8>> {
    Ok(bounded::read_bytes(path, MAX_FILE_BYTES)?)
}

fn mars(capture: &mut Opened) -> Result<Vec<RecordedFrame>> {
    let bytes = capture.bytes()?;
    let frames = if bytes.starts_with(NPY_MAGIC) {
        read_mars_features(&bytes)
    } else {
        read_mars_points(&bounded::text_of(bytes, capture.path())?)
    };
    frames.map_err(|e| Error::wrap_in_file(capture.path(), e))
}

/// Returns the subfolder `radar/` of a sequence, or the folder itself.
pub(crate) fn frames_folder(path: &Path) -> PathBuf {
    let inside = path.join("radar");
    if inside.is_dir() {
        inside
    } else {
        path.to_path_buf()
    }
}

fn file_names(folder: &Path) -> Result<Vec<String>> {
    let mut names = Vec::new();
    for entry in fs::read_dir(folder).map_err(|e| Error::io(folder, e))? {
        let entry = entry.map_err(|e| Error::io(folder, e))?;
        // A name that is not valid text is not the name of a frame.
        if let Ok(name) = entry.file_name().into_string() {
            names.push(name);
        }
    }
    Ok(names)
}

/// Returns the frames of a folder by the numbers in their names. Each file is one frame.
fn folder_of_frames<E: std::error::Error + Send + Sync + 'static>(
    capture: &mut Opened,
    prefix: &str,
    read: impl Fn(&[u8]) -> std::result::Result<Vec<RadarPoint>, E>,
) -> Result<Vec<RecordedFrame>> {
    let path = &capture.path().to_path_buf();
    let mut files: Vec<(u64, PathBuf)> = Vec::new();
    if path.is_dir() {
        let folder = frames_folder(path);
        for name in file_names(&folder)? {
            let lower = name.to_lowercase();
            if let Some(number) = numbered(&lower, prefix)
                && (lower.ends_with(".npy") || lower.ends_with(".bin"))
            {
                files.push((number, folder.join(name)));
            }
        }
        if files.is_empty() {
            return Err(Error::input(format!(
                "{}: no {prefix}NUMBER.npy or .bin",
                folder.display()
            )));
        }
    } else {
        let points = read(&capture.bytes()?).map_err(|e| Error::wrap_in_file(path, e))?;
        return Ok(vec![RecordedFrame {
            number: 0,
            stamp_s: None,
            points,
            board: None,
        }]);
    }
    files.sort();
    if let Some(pair) = files.windows(2).find(|w| w[0].0 == w[1].0) {
        return Err(Error::input(format!(
            "{} and {} are the same frame",
            pair[0].1.display(),
            pair[1].1.display()
        )));
    }
    if files.len() as u64 > MAX_FRAMES {
        return Err(Error::wrap(TimelineError::TooLong(files.len() as u64)));
    }
    let mut frames = Vec::with_capacity(files.len());
    for (number, file) in files {
        let points = read(&read_whole(&file)?).map_err(|e| Error::wrap_in_file(&file, e))?;
        frames.push(RecordedFrame {
            number,
            stamp_s: None,
            points,
            board: None,
        });
    }
    Ok(frames)
}

/// Adds what a user should know of a stream of packets, in which the board tracked somebody or not.
///
/// # Errors
/// A stream in which objects were detected and nothing of them can be read: it would look like an empty room.
pub(crate) fn check_stream(
    path: &Path,
    report: &UartReport,
    guess: Option<&Guess>,
    has_tracks: bool,
    notes: &mut Vec<String>,
    warnings: &mut Vec<String>,
) -> Result {
    if let Some(guess) = guess {
        notes.push(format!("dialect {guess}"));
    }
    notes.push(counts(report));
    warnings.extend(problems(report));
    if let Some(guess) = guess.filter(|guess| guess.is_assumed) {
        warnings.push(format!(
            "no packet shows the dialect of the stream: {}, the usual one, is assumed",
            guess.dialect.name()
        ));
    }
    let Some(reason) = report.no_points_because() else {
        return Ok(());
    };
    if has_tracks {
        // The board states where somebody is.
        warnings.push(reason);
        return Ok(());
    }
    Err(Error::in_file(path, reason).with_hint(
        text("the demo must send points in a format that is known; ")
            .option("dialect")
            .text(" names another dialect"),
    ))
}

/// What a stream lacks, in the words of a user; nothing if it is whole.
pub(crate) fn problems(r: &UartReport) -> Vec<String> {
    let damaged = r.short_packets - r.short_packets_used + r.bad_headers + r.bad_checksums;
    let unusable = r.points_not_finite + r.points_out_of_range;
    let misread = r.is_misread().then(|| {
        format!(
            "the dialect is probably another one: {} blocks of data are of wrong length or impossible, {} are not",
            r.tlvs_wrong_length + r.tlvs_impossible,
            r.tlvs
        )
    });
    let lines = [
        (damaged, "packets are damaged"),
        (
            r.unclear_packets,
            "packets were skipped, because their dialect was not clear",
        ),
        (r.lost_frames, "frames were lost"),
        (r.tlvs_wrong_length, "blocks of data have a wrong length"),
        (
            r.tlvs_impossible,
            "blocks of data have impossible values and were left out",
        ),
        (
            r.count_mismatches,
            "packets have not as many points as their headers count and were left out",
        ),
        (
            r.counts_never_right,
            "headers count another number of objects than there are points",
        ),
        (unusable, "points are impossible and were left out"),
    ];
    let lines = lines.into_iter().filter(|(n, _)| *n > 0);
    let lines = lines.map(|(n, what)| format!("{n} {what}"));
    misread.into_iter().chain(lines).collect()
}

pub(crate) fn counts(r: &UartReport) -> String {
    let with = |numbers: Option<String>| match numbers {
        Some(numbers) => format!(": {numbers}"),
        None => String::new(),
    };
    let mut text = format!(
        "UART: {} bytes = {} in packets + {} skipped + {} at the end; {} packets, {} cut short, {} bad headers, \
         {} bad checksums; {} lost frames, {} restarts; TLVs {} used, {} not used{}, {} unknown{}, {} of wrong length; \
         points {} kept ({} without SNR), {} not finite, {} out of range; {} frames without points",
        r.bytes,
        r.packet_bytes,
        r.skipped_bytes,
        r.trailing_bytes,
        r.packets,
        r.short_packets,
        r.bad_headers,
        r.bad_checksums,
        r.lost_frames,
        r.restarts,
        r.tlvs,
        r.tlvs_unused,
        with(r.unused_tlvs()),
        r.tlvs_unknown,
        with(r.unknown_tlvs()),
        r.tlvs_wrong_length,
        r.points,
        r.points_without_snr,
        r.points_not_finite,
        r.points_out_of_range,
        r.frames_without_points
    );
    for (n, what) in [
        (r.short_packets_used, "packets cut short and used"),
        (r.unclear_packets, "packets of unclear dialect"),
        (r.tlvs_impossible, "TLVs with impossible values"),
        (r.tlvs_uncertain, "TLVs after a loss"),
        (
            r.count_mismatches,
            "packets with another number of points than counted",
        ),
    ] {
        if n > 0 {
            text += &format!("; {n} {what}");
        }
    }
    text
}
