//! Points that somebody else's radar found: any format of `radarllm-formats`, opened, put on a clock and levelled.

use std::{
    fs::{self, File},
    io::{BufReader, Read},
    path::{Path, PathBuf},
};

use clap::Args;
use radarllm_base::{PointFrame, RecordedFrame, Timeline, TimelineError, timeline::MAX_FRAMES};
use radarllm_formats::{
    DetectError, Detected, Format, Mounting, detect,
    detect::{HEAD_BYTES, detect_folder, numbered, stated_rate_hz},
    recordings::{
        Axes, mmbody, read_bag, read_mars_features, read_mars_points, read_mmbody_frame,
        read_mmfi_frame, read_radhar_points,
    },
    tables::{npy::NPY_MAGIC, read_points_csv, read_points_npy},
    uart::{Dialect, UartParser, UartReport, recorded_frames},
};

use crate::{
    commands::radar,
    error::{CliError, CliResult, refuse_options},
    files, serial,
};

/// Largest file read whole, bytes.
const MAX_FILE_BYTES: u64 = 1 << 30;
/// Radial speeds below this are called standing, m/s: less than one velocity bin of any radar that is built in.
pub const STANDING_MPS: f32 = 0.05;
/// Most frames joined into one.
const MAX_MERGE: usize = 100;
/// Bytes read from a stream at a time.
const PIECE_BYTES: usize = 64 << 10;

/// How a recording is to be understood.
#[derive(Args, Clone, Debug)]
pub struct RecordingArgs {
    /// Frames per second of the recording, where neither its clock nor --radar says.
    #[arg(long, value_name = "HZ")]
    pub frame_rate: Option<f64>,
    /// Axes of the recording: right-forward-up or forward-left-up (ROS).
    #[arg(long)]
    pub orientation: Option<String>,
    /// UART dialect: sdk3, area-scanner, people-3d, people-2d, people-2d-compact; guessed without it.
    #[arg(long)]
    pub dialect: Option<String>,
    /// Topic of a ROS bag, where it has clouds on several.
    #[arg(long)]
    pub topic: Option<String>,
    /// Baud rate when the capture is a serial port (/dev/tty...).
    #[arg(long, default_value_t = 921_600)]
    pub baud: u32,
    /// Seconds to listen to a serial port.
    #[arg(long, value_name = "S")]
    pub seconds: Option<f64>,
    /// Radar's boresight below the horizon, degrees.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    pub tilt_deg: f64,
    /// Radar turned to its right, degrees.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    pub yaw_deg: f64,
    /// Radar's right side down, degrees.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    pub roll_deg: f64,
    /// Leave out points slower than this, m/s: the static surroundings that some firmware reports. `describe` leaves out
    /// what stands still without it, where that is most of a recording; 0 keeps everything.
    #[arg(long, value_name = "MPS")]
    pub slowest: Option<f32>,
    /// Join so many frames into each, for radars that report few points.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub merge: usize,
    /// Move points along their radial velocity to the time of the frame they join.
    #[arg(long)]
    pub follow: bool,
}

impl RecordingArgs {
    /// Refuses what says how recorded points are to be read: raw samples have the radar's clock and axes.
    pub fn check_for_samples(&self) -> CliResult {
        refuse_options(
            &[
                ("--frame-rate", self.frame_rate.is_some()),
                ("--orientation", self.orientation.is_some()),
                ("--dialect", self.dialect.is_some()),
                ("--topic", self.topic.is_some()),
                ("--seconds", self.seconds.is_some()),
            ],
            "is for recorded points; the capture holds raw samples, whose clock and axes are the radar's",
        )
    }
}

impl Default for RecordingArgs {
    fn default() -> Self {
        Self {
            frame_rate: None,
            orientation: None,
            dialect: None,
            topic: None,
            baud: 921_600,
            seconds: None,
            tilt_deg: 0.0,
            yaw_deg: 0.0,
            roll_deg: 0.0,
            slowest: None,
            merge: 1,
            follow: false,
        }
    }
}

/// Recorded points with what is known about them.
pub struct Recording {
    /// Frames, level, strongest points first.
    pub timeline: Timeline,
    /// Radar name, `unknown` where nothing says it.
    pub radar: String,
    /// Provenance for points files: `recorded:FORMAT:PATH`.
    pub source: String,
    /// What a user should know: how things were told, what was dropped.
    pub notes: Vec<String>,
}

/// The format of a capture: as named, or as detected.
///
/// # Errors
/// The capture is unreadable, the name unknown, or the format not clear.
pub fn format_of(path: &Path, named: Option<&str>) -> CliResult<Result<Detected, DetectError>> {
    if let Some(name) = named {
        let format = Format::from_name(name).ok_or_else(|| {
            let names: Vec<&str> = Format::ALL.iter().map(|f| f.name()).collect();
            CliError::new(format!("--format {name}: no such format"))
                .hint(format!("one of {}", names.join(", ")))
        })?;
        let reason = "--format".into();
        return Ok(Ok(Detected { format, reason }));
    }
    let info = fs::metadata(path).map_err(|e| CliError::io(path, e))?;
    if info.is_dir() {
        let names = file_names(&frames_folder(path))?;
        return Ok(detect_folder(names.iter().map(String::as_str)));
    }
    if serial::is_port(path) {
        let reason = "a serial port".into();
        let format = Format::Uart;
        return Ok(Ok(Detected { format, reason }));
    }
    if !info.is_file() {
        return Err(
            CliError::new(format!("{}: a pipe can be read only once", path.display()))
                .hint("--format names its format"),
        );
    }
    let mut head = Vec::new();
    File::open(path)
        .and_then(|file| file.take(HEAD_BYTES as u64).read_to_end(&mut head))
        .map_err(|e| CliError::io(path, e))?;
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    Ok(detect(&name, &head))
}

/// An error of detection with the file and what to do.
pub fn detect_error(path: &Path, error: &DetectError) -> CliError {
    let names = Format::ALL.map(Format::name).join(", ");
    CliError::new(format!("{}: {error}", path.display()))
        .hint(format!("--format names it: {names}"))
}

/// Opens a capture of points.
///
/// # Errors
/// Whatever is wrong with the file or the arguments, with the file's name.
pub fn open(
    path: &Path,
    detected: &Detected,
    radar: Option<&str>,
    args: &RecordingArgs,
) -> CliResult<Recording> {
    let format = detected.format;
    let mut notes = vec![format!("format {} ({})", format.name(), detected.reason)];
    refuse_idle_options(format, args)?;
    let axes = axes(format, args)?;
    let wrong = |e: String| CliError::new(format!("{}: {e}", path.display()));
    let frames = match format {
        Format::Uart => uart(path, args, &mut notes)?,
        Format::RadHar => {
            read_radhar_points(&read_text(path)?).map_err(|e| wrong(e.to_string()))?
        }
        Format::Mars => mars(path)?,
        Format::Csv => {
            read_points_csv(&read_text(path)?, axes).map_err(|e| wrong(e.to_string()))?
        }
        Format::NpyPoints => {
            read_points_npy(&read_whole(path)?, axes).map_err(|e| wrong(e.to_string()))?
        }
        Format::Bag => {
            let file = File::open(path).map_err(|e| CliError::io(path, e))?;
            let bag = read_bag(BufReader::new(file), args.topic.as_deref(), axes).map_err(|e| {
                wrong(e.to_string()).hint("--topic names one of several topics with clouds")
            })?;
            notes.push(format!(
                "topic {}, {} points dropped (NaN or beyond belief)",
                bag.topic, bag.points_dropped
            ));
            bag.frames
        }
        Format::MmFi => folder_of_frames(path, "frame", |bytes| read_mmfi_frame(bytes, axes))?,
        Format::MmBody => folder_of_frames(path, "frame_", read_mmbody_frame)?,
        Format::Adc | Format::Dca1000 | Format::Points => {
            return Err(wrong(format!("{} holds no recorded points", format.name())));
        }
    };
    if frames.is_empty() {
        return Err(wrong(format!(
            "no frame that can be used; {}",
            notes.join("; ")
        )));
    }
    let timeline = timeline(path, format, frames, radar, args)?;
    if timeline.restarts > 0 {
        notes.push(format!(
            "frame numbers went back {} times: the frames follow on",
            timeline.restarts
        ));
    }
    let subset = (format == Format::MmBody)
        .then(|| mmbody::subset(&path.to_string_lossy()))
        .flatten()
        .map(|name| format!("({name})"));
    Ok(Recording {
        timeline,
        radar: radar_name(format, radar)?,
        source: format!(
            "recorded:{}{}:{}",
            format.name(),
            subset.unwrap_or_default(),
            path.display()
        ),
        notes,
    })
}

/// An option that the format does not use would be ignored silently.
fn refuse_idle_options(format: Format, args: &RecordingArgs) -> CliResult {
    let with_axes = [Format::Csv, Format::NpyPoints, Format::Bag, Format::MmFi];
    let idle = [
        (
            "--orientation",
            args.orientation.is_some() && !with_axes.contains(&format),
        ),
        (
            "--dialect",
            args.dialect.is_some() && format != Format::Uart,
        ),
        (
            "--seconds",
            args.seconds.is_some() && format != Format::Uart,
        ),
        ("--topic", args.topic.is_some() && format != Format::Bag),
    ];
    match idle.iter().find(|(_, idle)| *idle) {
        Some((option, _)) => Err(CliError::new(format!(
            "{option} has no meaning for format {}",
            format.name()
        ))),
        None => Ok(()),
    }
}

fn axes(format: Format, args: &RecordingArgs) -> CliResult<Axes> {
    let names = Axes::ALL.map(Axes::name).join(" or ");
    if let Some(name) = &args.orientation {
        return Axes::from_name(name)
            .ok_or_else(|| CliError::new(format!("--orientation {name}: expected {names}")));
    }
    match format {
        // What the data set leaves open is not guessed.
        Format::MmFi => Err(CliError::new(
            "MM-Fi does not say which way its axes point: --orientation is needed",
        )
        .hint(format!("--orientation {names}"))),
        Format::Bag => Ok(Axes::ForwardLeftUp),
        _ => Ok(Axes::RightForwardUp),
    }
}

/// The radar of a data set, or the one named.
fn radar_name(format: Format, radar: Option<&str>) -> CliResult<String> {
    if let Some(name) = radar {
        return Ok(radar::open(name)?.name);
    }
    Ok(match format {
        Format::RadHar | Format::Mars => "iwr1443",
        Format::MmBody => "arbe",
        _ => "unknown",
    }
    .into())
}

fn timeline(
    path: &Path,
    format: Format,
    frames: Vec<RecordedFrame>,
    radar: Option<&str>,
    args: &RecordingArgs,
) -> CliResult<Timeline> {
    let has_clock = frames.len() > 1 && frames.iter().all(|f| f.stamp_s.is_some());
    let rate_hz = match (args.frame_rate, radar) {
        (Some(rate_hz), _) => Some(rate_hz),
        (None, _) if has_clock => None,
        (None, Some(name)) => Some(radar::open(name)?.frame_rate_hz()),
        (None, None) => stated_rate_hz(format),
    };
    let line = Timeline::new(frames, rate_hz).map_err(|e| {
        let error = CliError::new(format!("{}: {e}", path.display()));
        match e {
            TimelineError::NoRate => {
                error.hint("--frame-rate HZ, or --radar with the chirp file of the recording")
            }
            _ => error,
        }
    })?;
    shape(line, args)
}

/// Leaves out slow points, joins frames and turns points into level axes, as asked for; strongest points first.
pub fn shape(line: Timeline, args: &RecordingArgs) -> CliResult<Timeline> {
    let mut line = line;
    let slowest_mps = args.slowest.unwrap_or(0.0);
    if !(0.0..=100.0).contains(&slowest_mps) {
        return Err(CliError::new("--slowest: expected 0 to 100 m/s"));
    }
    retain_faster(&mut line.frames, slowest_mps);
    if !(1..=MAX_MERGE).contains(&args.merge) {
        return Err(CliError::new(format!(
            "--merge: expected 1 to {MAX_MERGE} frames"
        )));
    }
    if args.merge > 1 {
        line = line.accumulate(args.merge, args.follow);
    }
    let mounting = Mounting {
        tilt_rad: args.tilt_deg.to_radians(),
        yaw_rad: args.yaw_deg.to_radians(),
        roll_rad: args.roll_deg.to_radians(),
    };
    if ![mounting.tilt_rad, mounting.yaw_rad, mounting.roll_rad]
        .iter()
        .all(|v| v.is_finite())
    {
        return Err(CliError::new(
            "--tilt-deg, --yaw-deg, --roll-deg: must be finite",
        ));
    }
    mounting.apply(&mut line.frames);
    sort(&mut line.frames);
    Ok(line)
}

fn retain_faster(frames: &mut [PointFrame], slowest_mps: f32) {
    for frame in frames {
        frame.points.retain(|p| p.velocity_mps.abs() >= slowest_mps);
    }
}

/// Leaves out what stands still where that is most of the points: models learn from radars that take the surroundings
/// out of their samples, and firmware that does not reports little else. Says what it did.
pub fn leave_out_surroundings(frames: &mut [PointFrame]) -> Option<String> {
    let note = surroundings(frames)?;
    retain_faster(frames, STANDING_MPS);
    Some(format!(
        "{note} and are left out as surroundings (--slowest 0 keeps them)"
    ))
}

/// Says so if most of the points stand still, slower than [`STANDING_MPS`].
pub fn surroundings(frames: &[PointFrame]) -> Option<String> {
    let points = || frames.iter().flat_map(|f| &f.points);
    let n_still = points()
        .filter(|p| p.velocity_mps.abs() < STANDING_MPS)
        .count();
    let n_points = points().count();
    (2 * n_still > n_points).then(|| format!("{n_still} of {n_points} points stand still"))
}

/// Frames at another rate; see [`Timeline::resample`].
pub fn resample(line: &Timeline, rate_hz: f64, follow: bool) -> CliResult<Timeline> {
    let mut line = line.resample(rate_hz, follow)?;
    sort(&mut line.frames);
    Ok(line)
}

/// Points files list the strongest points first.
fn sort(frames: &mut [PointFrame]) {
    for frame in frames {
        frame
            .points
            .sort_by(|a, b| b.intensity_db.total_cmp(&a.intensity_db));
    }
}

fn read_whole(path: &Path) -> CliResult<Vec<u8>> {
    files::read_bytes(path, MAX_FILE_BYTES)
}

fn read_text(path: &Path) -> CliResult<String> {
    files::read_text(path, MAX_FILE_BYTES)
}

fn mars(path: &Path) -> CliResult<Vec<RecordedFrame>> {
    let bytes = read_whole(path)?;
    let frames = if bytes.starts_with(NPY_MAGIC) {
        read_mars_features(&bytes)
    } else {
        read_mars_points(&read_text(path)?)
    };
    frames.map_err(|e| CliError::new(format!("{}: {e}", path.display())))
}

/// `radar/` inside a sequence, or the folder itself.
fn frames_folder(path: &Path) -> PathBuf {
    let inside = path.join("radar");
    if inside.is_dir() {
        inside
    } else {
        path.to_path_buf()
    }
}

fn file_names(folder: &Path) -> CliResult<Vec<String>> {
    let mut names = Vec::new();
    for entry in fs::read_dir(folder).map_err(|e| CliError::io(folder, e))? {
        let entry = entry.map_err(|e| CliError::io(folder, e))?;
        // A name that is no text is no name of a frame.
        if let Ok(name) = entry.file_name().into_string() {
            names.push(name);
        }
    }
    Ok(names)
}

/// Frames of a folder by the numbers in their names; one file is one frame.
fn folder_of_frames<E: std::fmt::Display>(
    path: &Path,
    prefix: &str,
    read: impl Fn(&[u8]) -> Result<Vec<radarllm_base::RadarPoint>, E>,
) -> CliResult<Vec<RecordedFrame>> {
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
            return Err(CliError::new(format!(
                "{}: no {prefix}NUMBER.npy or .bin",
                folder.display()
            )));
        }
    } else {
        files.push((0, path.to_path_buf()));
    }
    files.sort();
    if let Some(pair) = files.windows(2).find(|w| w[0].0 == w[1].0) {
        return Err(CliError::new(format!(
            "{} and {} are the same frame",
            pair[0].1.display(),
            pair[1].1.display()
        )));
    }
    if files.len() as u64 > MAX_FRAMES {
        return Err(CliError::new(TimelineError::TooLong(files.len() as u64)));
    }
    let mut frames = Vec::with_capacity(files.len());
    for (number, file) in files {
        let points = read(&read_whole(&file)?)
            .map_err(|e| CliError::new(format!("{}: {e}", file.display())))?;
        frames.push(RecordedFrame {
            number,
            stamp_s: None,
            points,
        });
    }
    Ok(frames)
}

/// Parses a file, a pipe or a serial port as it is read.
fn uart(
    path: &Path,
    args: &RecordingArgs,
    notes: &mut Vec<String>,
) -> CliResult<Vec<RecordedFrame>> {
    let dialect = args
        .dialect
        .as_deref()
        .map(|name| {
            Dialect::from_name(name).ok_or_else(|| {
                CliError::new(format!("--dialect {name}: no such dialect"))
                    .hint(Dialect::ALL.map(Dialect::name).join(", "))
            })
        })
        .transpose()?;
    let mut source: Box<dyn Read> = if serial::is_port(path) {
        let seconds = args.seconds.filter(|s| *s > 0.0 && *s <= 86_400.0);
        let seconds = seconds.ok_or_else(|| {
            CliError::new("a serial port has no end: --seconds is needed, at most a day")
        })?;
        Box::new(serial::Port::open(path, args.baud, seconds).map_err(|e| CliError::io(path, e))?)
    } else {
        Box::new(File::open(path).map_err(|e| CliError::io(path, e))?)
    };
    let wrong = |e: radarllm_formats::UartError| {
        CliError::new(format!("{}: {e}", path.display())).hint("--dialect names it")
    };
    let mut parser = UartParser::new(dialect);
    let mut frames = Vec::new();
    let mut piece = vec![0; PIECE_BYTES];
    loop {
        let n = match source.read(&mut piece) {
            Ok(0) => break,
            Ok(n) => n,
            Err(e) if e.kind() == std::io::ErrorKind::Interrupted => continue,
            Err(e) => return Err(CliError::io(path, e)),
        };
        frames.extend(parser.push(&piece[..n]).map_err(wrong)?);
        if frames.len() as u64 > MAX_FRAMES {
            return Err(CliError::new(TimelineError::TooLong(frames.len() as u64)));
        }
    }
    let (last, report, guess) = parser.finish().map_err(wrong)?;
    frames.extend(last);
    if let Some(guess) = guess {
        notes.push(format!("dialect {guess}"));
    }
    notes.push(counts(&report));
    Ok(recorded_frames(frames))
}

fn counts(r: &UartReport) -> String {
    format!(
        "UART: {} bytes = {} in packets + {} skipped + {} at the end; {} packets, {} cut short, {} bad headers, \
         {} bad checksums; {} lost frames, {} restarts; TLVs {} used, {} not used, {} unknown, {} of wrong length; \
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
        r.tlvs_unknown,
        r.tlvs_wrong_length,
        r.points,
        r.points_without_snr,
        r.points_not_finite,
        r.points_out_of_range,
        r.frames_without_points
    )
}

#[cfg(test)]
mod tests {
    use radarllm_base::{PointFrame, RadarPoint};

    use super::leave_out_surroundings;

    fn frames(velocities: &[f32]) -> Vec<PointFrame> {
        let points = velocities.iter().map(|v| RadarPoint {
            velocity_mps: *v,
            ..RadarPoint::default()
        });
        vec![PointFrame {
            frame: 0,
            time_s: 0.0,
            points: points.collect(),
        }]
    }

    #[test]
    fn surroundings_go_only_where_they_are_most_of_a_recording() {
        let mut room = frames(&[0.0, 0.0, -0.6, 0.0, 0.6]);
        let note = leave_out_surroundings(&mut room).unwrap();
        assert!(note.contains("3 of 5 points"), "{note}");
        assert_eq!(room, frames(&[-0.6, 0.6]));
        // A person who pauses is no surroundings: half of the points may stand still.
        let mut person = frames(&[0.0, 0.0, -0.6, 0.6]);
        assert_eq!(leave_out_surroundings(&mut person), None);
        assert_eq!(person, frames(&[0.0, 0.0, -0.6, 0.6]));
        assert_eq!(leave_out_surroundings(&mut []), None);
    }
}
