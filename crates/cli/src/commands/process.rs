//! `process`: recorded radar to points.

use std::path::{Path, PathBuf};

use radarllm_base::{PointFrame, RadarConfig, RadarCube, Timeline};
use radarllm_dataset::{Overwrite, PointsMeta, write_points};
use radarllm_formats::{
    Detected,
    adc::{AdcStats, CubeShape, FrameSource, IqAnswer, IqCheck},
};
use radarllm_radar_dsp::{DspOptions, PointExtractor};
use radarllm_synth::processing::ProcessingFile;
use serde::Serialize;

use crate::{
    args::ProcessArgs,
    capture::{self, Format, Frames, NpyFrames},
    clean::NEEDS_SAMPLES,
    commands::{
        pictures::{self, PictureArgs, Pictures},
        radar,
    },
    error::{CliError, CliResult, refuse_options},
    files::{self, MAX_CONFIG_BYTES},
    input::MAX_FRAMES,
    output,
    people::{self, Found, GhostReport, Person},
    recording, udp,
};

#[derive(Serialize)]
struct Report {
    frames: usize,
    points_per_frame: f64,
    frame_rate_hz: f64,
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
    /// With `--people`.
    #[serde(skip_serializing_if = "Option::is_none")]
    people: Option<Vec<PersonFile>>,
    /// With `--drop-ghosts`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    ghosts: Vec<GhostReport>,
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
    let asked = match &kind {
        Kind::Samples(_) => Asked::of_samples(args),
        Kind::Points(_) => Asked::of_points(args),
    };
    for path in std::iter::once(&args.out).chain(asked.paths()) {
        output::check_free(path, args.force)?;
    }
    let format = match kind {
        Kind::Samples(format) => format,
        Kind::Points(detected) => return recorded_points(args, &asked, &detected),
    };
    let radar_name = samples_radar(args)?;
    let radar = radar::open(radar_name)?;
    let mut notes = Vec::new();
    let named = args.format.as_deref();
    args.recording.check_for_samples()?;
    let corrector = args
        .clean
        .of_samples(&radar, radar_name, named, &args.layout, &mut notes)?;
    let options = match &args.processing {
        Some(path) => processing(path)?.resolve(&radar),
        None => DspOptions::default(),
    };
    let mut extractor = PointExtractor::new(&radar, args.clean.chain(options))?;
    let mut pictures = Pictures::new(&asked.pictures);
    let mut frames = Frames::open(
        format,
        &args.capture,
        &radar,
        radar_name,
        &args.layout,
        &mut notes,
    )?;
    let mut health = Health::new(&radar, format);
    let first = &args.capture[0];
    let taken = extract_all(
        &mut frames,
        first,
        &radar,
        args.frames,
        &mut extractor,
        |cube| {
            health.push(cube);
            Ok(corrector.apply(cube)?)
        },
        |extractor, cube, frame| pictures.push(extractor, cube, frame),
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
    let line = Timeline::from_frames(taken.points, radar.frame_rate_hz());
    let line = recording::shape(line, &args.recording)?;
    let (line, found) = resampled(args, line, &mut notes)?;
    let tracks = args.people.is_given().then_some(&found.tracks[..]);
    pictures.finish(&line.frames, tracks)?;
    let has_counts = health.stats.channels().iter().any(|c| c.rms >= 1.0);
    match &asked.adc_statistics {
        Some(path) if has_counts => pictures::draw_adc_statistics(path, &health.stats)?,
        Some(_) if args.adc_statistics.is_some() => {
            return Err(CliError::new(format!(
                "{}: the samples stay below one count: they are no ADC's, and --adc-statistics has nothing to draw",
                first.display()
            )));
        }
        _ => {}
    }
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
        frame_rate_hz: line.frame_rate_hz,
    };
    let people = write_all(args, &meta, &line.frames, &found)?;
    let report = Report {
        frames: line.frames.len(),
        points_per_frame: points_per_frame(&line.frames),
        frame_rate_hz: line.frame_rate_hz,
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
        people,
        ghosts: found.ghosts,
    };
    say(&report);
    if args.json {
        return output::print_json(&report);
    }
    output::print_line(&format!(
        "{}: {} frames, {:.1} points a frame",
        report.out, report.frames, report.points_per_frame
    ));
    print_people(report.people.as_deref(), &report.ghosts);
    Ok(())
}

/// Pictures that are asked for, by name or all.
struct Asked {
    pictures: PictureArgs,
    adc_statistics: Option<PathBuf>,
}

impl Asked {
    fn of_samples(args: &ProcessArgs) -> Self {
        let folder = args.all_pictures.as_deref();
        Self {
            pictures: args
                .pictures
                .in_folder(folder, true, args.people.is_given()),
            adc_statistics: args
                .adc_statistics
                .clone()
                .or_else(|| folder.map(|f| f.join("adc-statistics.png"))),
        }
    }

    fn of_points(args: &ProcessArgs) -> Self {
        Self {
            pictures: args.pictures.in_folder(
                args.all_pictures.as_deref(),
                false,
                args.people.is_given(),
            ),
            adc_statistics: args.adc_statistics.clone(),
        }
    }

    fn paths(&self) -> impl Iterator<Item = &PathBuf> {
        self.pictures.paths().chain(&self.adc_statistics)
    }
}

/// A person's file, as scripts read it.
#[derive(Serialize)]
struct PersonFile {
    #[serde(flatten)]
    person: Person,
    out: String,
}

/// Writes all points, and with `--people` those of each; `None` without.
fn write_all(
    args: &ProcessArgs,
    meta: &PointsMeta,
    frames: &[PointFrame],
    found: &Found,
) -> CliResult<Option<Vec<PersonFile>>> {
    let tracks = match args.people.people {
        Some(_) => &found.tracks[..],
        None => &[],
    };
    for track in tracks {
        output::check_free(&people::path_of(&args.out, track.id), args.force)?;
    }
    write_points(&args.out, meta, frames, Overwrite::Replace)?;
    let mut files = Vec::new();
    for track in tracks {
        let path = people::path_of(&args.out, track.id);
        let meta = PointsMeta {
            source: format!("{} (person {})", meta.source, track.id),
            ..meta.clone()
        };
        let alone = people::alone(track, frames);
        write_points(&path, &meta, &alone, Overwrite::Replace)?;
        files.push(PersonFile {
            person: Person::of(track, frames),
            out: path.display().to_string(),
        });
    }
    Ok(args.people.people.map(|_| files))
}

fn print_people(people: Option<&[PersonFile]>, ghosts: &[GhostReport]) {
    if people.is_some_and(<[_]>::is_empty) {
        output::print_line("no person found");
    }
    for file in people.unwrap_or_default() {
        let p = &file.person;
        output::print_line(&format!(
            "{}: person {}, {:.1} s to {:.1} s, {} points",
            file.out, p.id, p.start_s, p.end_s, p.points
        ));
    }
    for ghost in ghosts {
        output::print_line(&people::describe_ghost(ghost));
    }
}

/// Frames at the rate that was asked for, and who is in them.
fn resampled(
    args: &ProcessArgs,
    line: Timeline,
    notes: &mut Vec<String>,
) -> CliResult<(Timeline, Found)> {
    let mut line = match args.resample {
        Some(rate_hz) => recording::resample(&line, rate_hz, args.recording.follow)?,
        None => line,
    };
    // What stands still may be people where it was asked for, and where an empty room's share of it was taken off.
    let keep_still = args.recording.slowest.is_some() || args.clean.background.is_some();
    let found = args.people.find(&mut line.frames, keep_still, notes)?;
    Ok((line, found))
}

/// The `[processing]` table of a file.
fn processing(path: &Path) -> CliResult<ProcessingFile> {
    let text = files::read_text(path, MAX_CONFIG_BYTES)?;
    ProcessingFile::from_toml(&text).map_err(|e| {
        CliError::new(format!("{}: {e}", path.display()))
            .hint("docs/scenes.md lists the fields of [processing]")
    })
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
        radarllm_formats::Format::Adc | radarllm_formats::Format::Dca1000 => {
            capture::format_of(&args.capture, named).map(Kind::Samples)
        }
        radarllm_formats::Format::Points => Err(CliError::new(format!(
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
            "note: {} frames have missing bytes (zero in the samples), {} never came (empty in the points)",
            report.damaged_frames, report.lost_frames
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

/// One frame in this many is asked for the order of I and Q.
const IQ_STEP: usize = 8;

/// Adds up what the samples say about themselves.
struct Health {
    n_frames: usize,
    iq: IqCheck,
    stats: AdcStats,
    /// Whether the samples are counts of an ADC.
    are_counts: bool,
}

impl Health {
    fn new(radar: &RadarConfig, format: Format) -> Self {
        Self {
            n_frames: 0,
            iq: IqCheck::new(radar.n_samples),
            stats: AdcStats::new(radar.rx.len(), 16),
            are_counts: format != Format::Npy,
        }
    }

    fn push(&mut self, cube: &RadarCube) {
        // The order does not change within a capture.
        if self.n_frames.is_multiple_of(IQ_STEP) {
            self.iq.push(cube);
        }
        self.n_frames += 1;
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
    #[serde(skip_serializing_if = "Option::is_none")]
    people: Option<Vec<PersonFile>>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    ghosts: Vec<GhostReport>,
}

/// Points that another radar's firmware found.
fn recorded_points(args: &ProcessArgs, asked: &Asked, detected: &Detected) -> CliResult {
    if asked.adc_statistics.is_some() || asked.pictures.need_samples() {
        return Err(CliError::new(
            "this picture is made from raw samples; the capture holds points",
        )
        .hint("--point-cloud, --points-over-time and --tracks are made from points"));
    }
    refuse_options(
        &[
            ("--processing", args.processing.is_some()),
            ("--frames", args.frames.is_some()),
        ],
        NEEDS_SAMPLES,
    )?;
    let [path] = &args.capture[..] else {
        return Err(CliError::new(
            "recorded points are read one capture at a time",
        ));
    };
    let mut opened = recording::open(path, detected, args.radar.as_deref(), &args.recording)?;
    args.clean.of_points(
        &mut opened.timeline.frames,
        args.radar.as_deref(),
        args.format.as_deref(),
        &args.recording,
        &mut opened.notes,
    )?;
    let (line, found) = resampled(args, opened.timeline, &mut opened.notes)?;
    let tracks = args.people.is_given().then_some(&found.tracks[..]);
    Pictures::new(&asked.pictures).finish(&line.frames, tracks)?;
    let meta = PointsMeta {
        radar: opened.radar,
        source: opened.source,
        seed: None,
        version: env!("CARGO_PKG_VERSION").into(),
        radar_height_m: Some(args.radar_height_m),
        frame_rate_hz: line.frame_rate_hz,
    };
    let people = write_all(args, &meta, &line.frames, &found)?;
    let report = RecordedReport {
        frames: line.frames.len(),
        points_per_frame: points_per_frame(&line.frames),
        frame_rate_hz: line.frame_rate_hz,
        radar: meta.radar,
        source: meta.source,
        notes: opened.notes,
        out: args.out.display().to_string(),
        people,
        ghosts: found.ghosts,
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
    print_people(report.people.as_deref(), &report.ghosts);
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

/// Extracts points of at most `n_frames` frames. `before` gets every cube as it was read and may correct it; `each` sees
/// what came of it with its points.
pub fn extract_all(
    frames: &mut Frames,
    path: &Path,
    radar: &RadarConfig,
    n_frames: Option<usize>,
    extractor: &mut PointExtractor,
    mut before: impl FnMut(&mut RadarCube) -> CliResult,
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
        before(&mut cube)?;
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
    let taken = extract_all(
        &mut frames,
        path,
        radar,
        None,
        extractor,
        |_| Ok(()),
        |_, _, _| Ok(()),
    )?;
    Ok(taken.points)
}
