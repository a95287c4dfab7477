//! `process`: recorded radar to points.

use std::path::Path;

use radarllm_base::{PointFrame, RadarConfig, RadarCube};
use radarllm_capture::{
    Detected,
    adc::{AdcStats, CubeShape, FrameSource, IqAnswer, IqCheck, SampleKind},
};
use radarllm_dataset::{Overwrite, PointsMeta, write_points};
use radarllm_radar_dsp::{DspOptions, PointExtractor};
use serde::Serialize;

use crate::{
    args::ProcessArgs,
    capture::{self, Format, Frames, NpyFrames},
    commands::{pictures::Pictures, radar},
    error::{CliError, CliResult},
    input::MAX_FRAMES,
    output, recording, udp,
};

#[derive(Serialize)]
struct Report {
    frames: usize,
    points_per_frame: f64,
    radar: String,
    out: String,
    format: &'static str,
    /// Frames of which bytes are missing, which are zero in the samples.
    damaged_frames: usize,
    /// Frames that never came: empty in the points.
    lost_frames: usize,
    /// Bytes after the last whole frame.
    trailing_bytes: usize,
    /// Packets, where there were some.
    transfer: Option<Transfer>,
    /// What was noticed about the capture.
    notes: Vec<String>,
}

/// What happened to packets.
#[derive(Serialize)]
struct Transfer {
    packets: u64,
    lost: u64,
    out_of_order: u64,
    duplicates: u64,
    late: u64,
    refused: u64,
    skipped: u64,
}

/// Runs the verb.
pub fn run(args: &ProcessArgs) -> CliResult {
    let kind = kind_of(args)?;
    for path in std::iter::once(&args.out).chain(args.pictures.paths()) {
        output::check_free(path, args.force)?;
    }
    let format = match kind {
        Kind::Samples(format) => format,
        Kind::Points(detected) => return recorded_points(args, &detected),
    };
    let radar = radar::open(samples_radar(args)?)?;
    let mut extractor = PointExtractor::new(&radar, DspOptions::default())?;
    let mut pictures = Pictures::new(&args.pictures);
    let mut notes = Vec::new();
    let mut frames = open(format, args, &radar, &mut notes)?;
    let mut health = Health::new(&radar, format);
    let first = &args.capture[0];
    let taken = extract_all(
        &mut frames,
        first,
        &radar,
        args.frames,
        &mut extractor,
        |extractor, cube, frame| {
            health.push(cube);
            pictures.push(extractor, cube, frame)
        },
    )?;
    health.finish(&frames, &mut notes);
    if frames.overruns() > 0 {
        notes.push(format!(
            "{} packets came faster than they were processed",
            frames.overruns()
        ));
    }
    if taken.points.is_empty() {
        return Err(CliError::new(format!(
            "{}: not one whole frame of radar `{}` ({} bytes of one)",
            first.display(),
            radar.name,
            frames.trailing_bytes()
        )));
    }
    pictures.finish()?;
    let names: Vec<String> = args
        .capture
        .iter()
        .map(|p| p.display().to_string())
        .collect();
    let meta = PointsMeta {
        radar: radar.name.clone(),
        source: format!("recorded:{}", names.join("+")),
        seed: None,
        version: env!("CARGO_PKG_VERSION").into(),
        radar_height_m: Some(args.radar_height_m),
        frame_rate_hz: radar.frame_rate_hz(),
    };
    write_points(&args.out, &meta, &taken.points, Overwrite::Replace)?;
    let report = Report {
        frames: taken.points.len(),
        points_per_frame: points_per_frame(&taken.points),
        radar: radar.name,
        out: args.out.display().to_string(),
        format: format.name(),
        damaged_frames: taken.damaged,
        lost_frames: taken.lost,
        trailing_bytes: frames.trailing_bytes(),
        transfer: frames.transfer().map(|(t, skipped)| Transfer {
            packets: t.packets,
            lost: t.lost,
            out_of_order: t.out_of_order,
            duplicates: t.duplicates,
            late: t.late,
            refused: t.refused,
            skipped,
        }),
        notes,
    };
    say(&report);
    if args.json {
        return output::print_json(&report);
    }
    output::print_line(&format!(
        "{}: {} frames, {:.1} points a frame",
        report.out, report.frames, report.points_per_frame
    ));
    Ok(())
}

/// What a capture holds.
enum Kind {
    /// Raw samples.
    Samples(Format),
    /// Points that another radar's firmware found.
    Points(Detected),
}

/// What the capture is: as named, or as it begins.
fn kind_of(args: &ProcessArgs) -> CliResult<Kind> {
    let first = args
        .capture
        .first()
        .ok_or_else(|| CliError::new("no capture is named"))?;
    let named = args.format.as_deref();
    let is_samples = udp::address(&first.to_string_lossy()).is_some()
        || matches!(named, Some("adc" | "dca1000" | "npy"))
        || (named.is_none() && args.layout.is_given());
    if is_samples {
        return capture::format_of(&args.capture, named).map(Kind::Samples);
    }
    let detected =
        recording::format_of(first, named)?.map_err(|e| recording::detect_error(first, &e))?;
    match detected.format {
        radarllm_capture::Format::Adc | radarllm_capture::Format::Dca1000 => {
            capture::format_of(&args.capture, named).map(Kind::Samples)
        }
        radarllm_capture::Format::Points => Err(CliError::new(format!(
            "{}: a points file already",
            first.display()
        ))),
        _ => Ok(Kind::Points(detected)),
    }
}

fn samples_radar(args: &ProcessArgs) -> CliResult<&str> {
    args.radar.as_deref().ok_or_else(|| {
        CliError::new("raw samples need --radar").hint("the radar that recorded them")
    })
}

/// Everything that a user should know about a capture, on stderr.
fn say(report: &Report) {
    for note in &report.notes {
        eprintln!("note: {note}");
    }
    if report.damaged_frames + report.lost_frames > 0 {
        eprintln!(
            "note: of {} frames {} have missing bytes (zero in the samples), {} never came (empty in the points)",
            report.frames, report.damaged_frames, report.lost_frames
        );
    }
    if report.trailing_bytes > 0 {
        eprintln!(
            "note: {} bytes after the last whole frame",
            report.trailing_bytes
        );
    }
    if let Some(t) = &report.transfer {
        eprintln!(
            "note: {} packets, {} lost, {} out of order, {} repeated, {} too late, {} refused, {} that were none",
            t.packets, t.lost, t.out_of_order, t.duplicates, t.late, t.refused, t.skipped
        );
    }
}

fn open(
    format: Format,
    args: &ProcessArgs,
    radar: &RadarConfig,
    notes: &mut Vec<String>,
) -> CliResult<Frames> {
    if format == Format::Npy {
        let [path] = &args.capture[..] else {
            return Err(CliError::new("npy arrays are read one at a time"));
        };
        return Ok(Frames::Npy(Box::new(NpyFrames::open(
            path,
            radar,
            args.layout.axes.as_deref(),
        )?)));
    }
    let chosen = capture::choose_layout(
        format,
        &args.capture,
        radar,
        samples_radar(args)?,
        &args.layout,
    )?;
    notes.extend(chosen.notes);
    if let (SampleKind::Complex { order }, Some(verdict)) = (chosen.layout.data, chosen.verdict) {
        notes.push(format!(
            "read with {}; {}",
            order.name(),
            capture::explain(chosen.tried, &verdict)
        ));
    }
    if format != Format::Udp {
        notes.extend(capture::log_notes(&args.capture[0])?);
    }
    Frames::open_raw(format, &args.capture, CubeShape::of(radar), chosen.layout)
}

/// Adds up what the samples say about themselves.
struct Health {
    iq: IqCheck,
    stats: AdcStats,
    /// Whether the samples are counts of an ADC.
    are_counts: bool,
}

impl Health {
    fn new(radar: &RadarConfig, format: Format) -> Self {
        Self {
            iq: IqCheck::new(radar.n_samples),
            stats: AdcStats::new(radar.rx.len(), 16),
            are_counts: format != Format::Npy,
        }
    }

    fn push(&mut self, cube: &RadarCube) {
        self.iq.push(cube);
        self.stats.push(cube);
    }

    fn finish(&self, frames: &Frames, notes: &mut Vec<String>) {
        if let Frames::Npy(npy) = frames
            && npy.were_words()
        {
            notes.push("numbers were unsigned 16-bit words: they got their sign back".into());
        }
        let verdict = self.iq.verdict();
        if verdict.answer == IqAnswer::Swapped {
            notes.push(format!(
                "I/Q order looks swapped: {:+.1} dB at positive against negative range",
                verdict.positive_over_negative_db
            ));
        }
        if self.are_counts {
            notes.extend(self.stats.problems());
        }
    }
}

#[derive(Serialize)]
struct RecordedReport {
    frames: usize,
    points_per_frame: f64,
    frame_rate_hz: f64,
    radar: String,
    source: String,
    notes: Vec<String>,
    out: String,
}

/// Points that another radar's firmware found.
fn recorded_points(args: &ProcessArgs, detected: &Detected) -> CliResult {
    if args.pictures.paths().next().is_some() {
        return Err(CliError::new(
            "pictures are made from raw samples; this capture holds points",
        ));
    }
    let [path] = &args.capture[..] else {
        return Err(CliError::new(
            "recorded points are read one capture at a time",
        ));
    };
    let opened = recording::open(path, detected, args.radar.as_deref(), &args.recording)?;
    let line = match args.resample {
        Some(rate_hz) => recording::resample(&opened.timeline, rate_hz, args.recording.follow)?,
        None => opened.timeline,
    };
    let meta = PointsMeta {
        radar: opened.radar,
        source: opened.source,
        seed: None,
        version: env!("CARGO_PKG_VERSION").into(),
        radar_height_m: Some(args.radar_height_m),
        frame_rate_hz: line.rate_hz,
    };
    write_points(&args.out, &meta, &line.frames, Overwrite::Replace)?;
    let report = RecordedReport {
        frames: line.frames.len(),
        points_per_frame: points_per_frame(&line.frames),
        frame_rate_hz: line.rate_hz,
        radar: meta.radar,
        source: meta.source,
        notes: opened.notes,
        out: args.out.display().to_string(),
    };
    if args.json {
        return output::print_json(&report);
    }
    for note in &report.notes {
        output::print_line(note);
    }
    output::print_line(&format!(
        "{}: {} frames at {:.2} Hz, {:.1} points a frame",
        report.out, report.frames, report.frame_rate_hz, report.points_per_frame
    ));
    Ok(())
}

/// Mean number of points.
pub fn points_per_frame(frames: &[PointFrame]) -> f64 {
    frames.iter().map(|f| f.points.len()).sum::<usize>() as f64 / frames.len().max(1) as f64
}

/// Frames of points, and how many of them are not what they should be.
pub struct Taken {
    /// One a frame period from the first one on; lost ones are empty.
    pub points: Vec<PointFrame>,
    /// Frames with missing bytes.
    pub damaged: usize,
    /// Frames that never came.
    pub lost: usize,
}

/// Extracts points of at most `n_frames` frames. `each` sees every cube with its points.
pub fn extract_all(
    frames: &mut Frames,
    path: &Path,
    radar: &RadarConfig,
    n_frames: Option<usize>,
    extractor: &mut PointExtractor,
    mut each: impl FnMut(&mut PointExtractor, &RadarCube, &PointFrame) -> CliResult,
) -> CliResult<Taken> {
    let most = n_frames.unwrap_or(MAX_FRAMES).min(MAX_FRAMES);
    let too_many = |n: u64| {
        CliError::new(format!(
            "{}: {n} frames, at most {MAX_FRAMES} are handled",
            path.display()
        ))
        .hint("--frames N reads only the first ones")
    };
    if let Frames::Npy(npy) = frames
        && n_frames.is_none()
        && npy.n_frames() > MAX_FRAMES as u64
    {
        return Err(too_many(npy.n_frames()));
    }
    let mut cube = CubeShape::of(radar).zeros()?;
    let mut taken = Taken {
        points: Vec::new(),
        damaged: 0,
        lost: 0,
    };
    let mut first = None;
    while taken.points.len() < most {
        let integrity = match frames.next_frame(&mut cube) {
            Ok(Some(integrity)) => integrity,
            Ok(None) => return Ok(taken),
            Err(e) => return Err(capture::naming(path, e)),
        };
        let index = integrity.frame - *first.get_or_insert(integrity.frame);
        if index >= MAX_FRAMES as u64 {
            return Err(too_many(index.saturating_add(1)));
        }
        let time_s = |index: usize| index as f64 * radar.frame_period_s;
        while taken.points.len() < index as usize {
            let lost = taken.points.len();
            taken.lost += 1;
            taken.points.push(PointFrame {
                frame: lost as u32,
                time_s: time_s(lost),
                points: Vec::new(),
            });
        }
        taken.damaged += usize::from(!integrity.is_complete());
        cube.time_s = time_s(index as usize);
        let mut frame = extractor
            .extract(&cube)
            .map_err(|e| CliError::new(format!("{}: frame {index}: {e}", path.display())))?;
        frame.frame = index as u32;
        each(extractor, &cube, &frame)?;
        taken.points.push(frame);
    }
    if n_frames.is_none() && frames.next_frame(&mut cube).is_ok_and(|f| f.is_some()) {
        return Err(too_many(MAX_FRAMES as u64 + 1));
    }
    Ok(taken)
}

/// Points of an npy array in our own order, for verbs that only want those.
pub fn points_of_npy(
    path: &Path,
    radar: &RadarConfig,
    extractor: &mut PointExtractor,
) -> CliResult<Vec<PointFrame>> {
    let mut frames = Frames::Npy(Box::new(NpyFrames::open(path, radar, None)?));
    let taken = extract_all(&mut frames, path, radar, None, extractor, |_, _, _| Ok(()))?;
    Ok(taken.points)
}
