//! `process`: recorded radar to points.

use std::path::{Path, PathBuf};

use clap::Args;
use radarllm::{
    Clip, Overwrite, PointFrame, PointsMeta, PointsWriter, SampleRecording, write_points,
    write_points_with,
};
use radarllm_base::Clutter;
use radarllm_files::bounded::{self, MAX_CONFIG_BYTES};
use radarllm_io::{
    CaptureOptions, ExtractedPoints, Opened, PointStream, RecordingKind, StreamEnd,
    options::{NEEDS_SAMPLES, refuse_options},
    recording::read_recorded_points,
};
use radarllm_synth::processing::ProcessingFile;
use radarllm_tracking::{People, find_people};
use serde::Serialize;

use crate::{
    commands::pictures::{self, PICTURES_HEADING, PictureArgs, Pictures},
    error::{CliError, CliResult},
    output,
    person_report::{GhostReport, PersonReport},
    progress::Progress,
    radar_file,
    recording_args::{CleaningArgs, LayoutArgs, PeopleArgs, RecordingArgs},
};

/// `process`.
#[derive(Args)]
pub(crate) struct ProcessArgs {
    /// Raw words (adc_data.bin), records or pcap of a DCA1000, npy, where several files are parts of one
    /// recording; UART stream or port, data set file or folder, ROS bag, points table. `udp:4098` or
    /// `udp:ADDRESS:PORT` listens to a capture card.
    #[arg(required = true)]
    pub capture: Vec<PathBuf>,
    /// Radar that recorded it: a built-in name, a TI .cfg, an export of mmWave Studio (.json) or a radar .toml. Required
    /// for raw samples.
    #[arg(long)]
    pub radar: Option<String>,
    /// Output file of points, Parquet.
    #[arg(long)]
    pub out: PathBuf,
    /// Raw samples: adc, dca1000 or npy; points: uart, visualizer-json, visualizer-binary, radhar, mars, mmbody, mmfi,
    /// mat, csv, npy-points or bag; detected if omitted.
    #[arg(long)]
    pub format: Option<String>,
    /// Sample layout of a raw capture.
    #[command(flatten)]
    pub layout: LayoutArgs,
    /// Read only this many frames of raw samples.
    #[arg(long)]
    pub frames: Option<usize>,
    /// Signal processing of raw samples: a TOML file with a `[processing]` table, such as a scene or a data set
    /// configuration; the default chain if omitted.
    #[arg(long, value_name = "F.toml")]
    pub processing: Option<PathBuf>,
    /// Frame rate of the points file, frames/s; that of the recording if omitted.
    #[arg(long, value_name = "HZ")]
    pub resample: Option<f64>,
    /// Recorded points.
    #[command(flatten)]
    pub recording: RecordingArgs,
    /// Background and leakage removal.
    #[command(flatten)]
    pub cleaning: CleaningArgs,
    /// Tracking of people. The points of each person are written to OUT.person-1.parquet and so on.
    #[command(flatten)]
    pub people: PeopleArgs,
    /// Plots to write.
    #[command(flatten)]
    pub pictures: PictureArgs,
    /// Histogram of ADC values with saturation, offset and I/Q balance of each receiver, of raw samples; .svg.
    #[arg(long, value_name = "F.svg", help_heading = PICTURES_HEADING)]
    pub adc_statistics: Option<PathBuf>,
    /// Folder for all plots that the capture allows, as .svg.
    #[arg(long, value_name = "DIR", help_heading = PICTURES_HEADING)]
    pub all_pictures: Option<PathBuf>,
    /// Height of the radar above the floor, m; 1 m if omitted and the recording does not give it.
    #[arg(long)]
    pub radar_height_m: Option<f32>,
    /// Replace an existing file.
    #[arg(long)]
    pub force: bool,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

#[derive(Serialize)]
struct Report {
    frames: usize,
    points_per_frame: f64,
    frame_rate_hz: f64,
    radar: String,
    out: String,
    format: &'static str,
    /// Number of frames with missing bytes, which are zero in the samples.
    damaged_frames: usize,
    /// Number of lost frames, which are empty in the points file.
    lost_frames: usize,
    /// Number of bytes after the last complete frame.
    trailing_bytes: usize,
    /// Packet counts, if the recording consists of packets.
    transfer: Option<Transfer>,
    /// Notes on the capture for the user.
    notes: Vec<String>,
    /// Files of the people, if `--people` is given.
    #[serde(skip_serializing_if = "Option::is_none")]
    people: Option<Vec<PersonFile>>,
    /// Ghosts, if `--drop-ghosts` is given.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    ghosts: Vec<GhostReport>,
}

/// Packet counts of a recording.
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

/// Runs the command.
pub(crate) fn run(args: &ProcessArgs) -> CliResult {
    let mut options = options(args)?;
    let opened = Opened::open(&args.capture, &options)?;
    let has_samples = matches!(opened.kind(), RecordingKind::Samples(_));
    let plots = PictureRequest::of(args, has_samples);
    plots.check()?;
    output::check_extension(&args.out, "parquet")?;
    for path in std::iter::once(&args.out).chain(plots.paths()) {
        output::check_free(path, args.force)?;
    }
    match opened.kind() {
        RecordingKind::Samples(_) => {
            if let (Some(path), Some(radar)) = (&args.processing, &options.radar) {
                options.processing = Some(processing(path)?.resolve(radar.config()?));
            }
            process_samples(args, &options, &plots, opened)
        }
        RecordingKind::Points(_) => process_points(args, &options, &plots, opened),
        RecordingKind::PointsFile => Err(CliError::new(format!(
            "{}: a points file already",
            args.capture[0].display()
        ))),
    }
}

/// Converts the flags to options of the library.
fn options(args: &ProcessArgs) -> CliResult<CaptureOptions> {
    let format = args
        .format
        .as_deref()
        .map(radarllm::CaptureFormat::from_name);
    let opened = args.radar.as_deref().map(radar_file::open).transpose()?;
    Ok(CaptureOptions {
        radar: opened,
        format: format.transpose()?,
        layout: args.layout.options(),
        points: args.recording.options()?,
        cleaning: args.cleaning.options(),
        processing: None,
        max_frames: args.frames,
        radar_height_m: args.radar_height_m,
    })
}

/// Processes raw samples with the signal chain.
fn process_samples(
    args: &ProcessArgs,
    options: &CaptureOptions,
    plots: &PictureRequest,
    opened: Opened,
) -> CliResult {
    let mut samples = SampleRecording::open(opened, options)?;
    let format = samples.format();
    if let Some(address) = samples.frames().listening_address() {
        note!("listening at {address}");
    }
    let mut pictures = Pictures::new(&plots.pictures);
    // Without plots and people, no frame is needed after it was written.
    let taken =
        match needs_all(args, plots) {
            true => Taken::Kept(samples.extract_points(|extractor, cube, frame| {
                Ok(pictures.push(extractor, cube, frame)?)
            })?),
            false => Taken::Written(convert_samples(args, &mut samples)?),
        };
    let [damaged_frames, lost_frames] = samples.n_damaged_and_lost();
    let trailing_bytes = samples.trailing_bytes();
    let transfer = samples.frames().transfer().map(|(t, skipped)| Transfer {
        packets: t.packets,
        lost: t.lost,
        out_of_order: t.out_of_order,
        duplicates: t.duplicates,
        late: t.late,
        refused: t.refused,
        skipped,
    });
    let (mut people, mut files) = (People::default(), None);
    let (written, radar, notes) = match taken {
        Taken::Written(written) => (written, samples.about().radar, samples.notes()),
        Taken::Kept(extracted) => {
            let stats = samples.stats().clone();
            let radarllm_io::Recording {
                clip, mut notes, ..
            } = samples.into_recording(extracted)?;
            let tracked = resample_and_track(args, clip, &mut notes)?;
            let clip = tracked.0;
            people = tracked.1;
            let tracks = args.people.is_given().then_some(&people.tracks[..]);
            pictures.finish(&clip.frames, tracks)?;
            let has_counts = stats.channels().iter().any(|c| c.rms >= 1.0);
            match &plots.adc_statistics {
                Some(path) if has_counts => pictures::write_adc_statistics(path, &stats)?,
                Some(_) if args.adc_statistics.is_some() => {
                    return Err(CliError::new(format!(
                        "{}: the samples stay below one count: they are not those of an ADC, and --adc-statistics has \
                         nothing to draw",
                        args.capture[0].display()
                    )));
                }
                _ => {}
            }
            files = write_all(args, &clip, &people)?;
            (Written::of(&clip), clip.radar, notes)
        }
    };
    let report = Report {
        frames: written.frames,
        points_per_frame: written.points_per_frame(),
        frame_rate_hz: written.frame_rate_hz,
        radar,
        out: args.out.display().to_string(),
        format: format.name(),
        damaged_frames,
        lost_frames,
        trailing_bytes,
        transfer,
        notes,
        people: files,
        ghosts: people.ghosts.iter().map(GhostReport::from).collect(),
    };
    print_notes(&report.notes);
    print_losses(&report);
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

/// Frames of points that were extracted from raw samples.
enum Taken {
    /// All of them, for plots or the tracking of people.
    Kept(ExtractedPoints),
    /// Written already.
    Written(Written),
}

/// A points file that was written.
struct Written {
    frames: usize,
    points: usize,
    frame_rate_hz: f64,
}

impl Written {
    fn of(clip: &Clip) -> Self {
        Self {
            frames: clip.frames.len(),
            points: clip.n_points(),
            frame_rate_hz: clip.frame_rate_hz,
        }
    }

    fn points_per_frame(&self) -> f64 {
        self.points as f64 / self.frames.max(1) as f64
    }
}

/// Whether all frames are needed at once: for plots, for tracking or for another frame rate.
fn needs_all(args: &ProcessArgs, plots: &PictureRequest) -> bool {
    args.people.is_given() || args.resample.is_some() || plots.paths().next().is_some()
}

/// Writes frames one by one, so that the length of a recording needs no memory. `first` is the first of them.
fn write_each(
    args: &ProcessArgs,
    about: &Clip,
    mut next: impl FnMut(&mut PointsWriter<'_>) -> radarllm::Result<Option<PointFrame>>,
) -> CliResult<Written> {
    let mut written = Written::of(about);
    let meta = PointsMeta::of(about);
    write_points_with(&args.out, &meta, Overwrite::Replace, |writer| {
        while let Some(frame) = next(writer)? {
            written.frames += 1;
            written.points += frame.points.len();
            writer.write(&frame)?;
        }
        Ok::<_, radarllm::Error>(())
    })?;
    Ok(written)
}

/// Extracts the points of raw samples and writes them, frame by frame.
fn convert_samples(args: &ProcessArgs, samples: &mut SampleRecording) -> CliResult<Written> {
    let mut placing = samples.placing()?;
    let mut first = samples.next_points(|_, _, _| Ok(()))?;
    samples.check_has_frames()?;
    let about = samples.about();
    let name = args.capture[0].display().to_string();
    let mut progress = Progress::new(&name);
    let mut n_frames = 0;
    write_each(args, &about, |_| {
        let frame = match first.take() {
            Some(frame) => Some(frame),
            None => samples.next_points(|_, _, _| Ok(()))?,
        };
        n_frames += 1;
        progress.show(args.frames.map(|all| f64::from(n_frames) / all as f64));
        Ok(frame.map(|frame| placing.apply(frame)))
    })
}

/// The plots to write: individually named ones, or all plots in a folder.
struct PictureRequest {
    pictures: PictureArgs,
    adc_statistics: Option<PathBuf>,
}

impl PictureRequest {
    fn of(args: &ProcessArgs, has_samples: bool) -> Self {
        let folder = args.all_pictures.as_deref();
        let in_folder = folder.filter(|_| has_samples);
        Self {
            pictures: args
                .pictures
                .in_folder(folder, has_samples, args.people.is_given()),
            adc_statistics: args
                .adc_statistics
                .clone()
                .or_else(|| in_folder.map(|f| f.join("adc-statistics.svg"))),
        }
    }

    /// Checks the extensions of the file names.
    fn check(&self) -> CliResult {
        self.pictures.check()?;
        match &self.adc_statistics {
            Some(path) => pictures::check_adc_statistics(path),
            None => Ok(()),
        }
    }

    fn paths(&self) -> impl Iterator<Item = &PathBuf> {
        self.pictures.paths().chain(&self.adc_statistics)
    }
}

/// The file of a person for the JSON output.
#[derive(Serialize)]
struct PersonFile {
    #[serde(flatten)]
    person: PersonReport,
    out: String,
}

/// Writes all points and, with `--people`, those of each person. Returns `None` without `--people`.
fn write_all(
    args: &ProcessArgs,
    clip: &Clip,
    people: &People,
) -> CliResult<Option<Vec<PersonFile>>> {
    let tracks = match args.people.people {
        Some(_) => &people.tracks[..],
        None => &[],
    };
    for track in tracks {
        output::check_free(&person_path(&args.out, track.id), args.force)?;
    }
    let meta = PointsMeta::of(clip);
    write_points(&args.out, &meta, &clip.frames, Overwrite::Replace)?;
    let mut files = Vec::new();
    for track in tracks {
        let path = person_path(&args.out, track.id);
        let meta = PointsMeta {
            source: format!("{} (person {})", meta.source, track.id),
            ..meta.clone()
        };
        let frames = track.only_points(&clip.frames);
        write_points(&path, &meta, &frames, Overwrite::Replace)?;
        files.push(PersonFile {
            person: PersonReport::of_track(track, &clip.frames),
            out: path.display().to_string(),
        });
    }
    Ok(args.people.people.map(|_| files))
}

/// Path of the points of one person, beside the file of all points.
fn person_path(out: &Path, id: u32) -> PathBuf {
    out.with_extension(format!("person-{id}.parquet"))
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
        output::print_line(&ghost.to_string());
    }
}

/// Resamples the clip to the requested frame rate and tracks the people in it.
fn resample_and_track(
    args: &ProcessArgs,
    clip: Clip,
    notes: &mut Vec<String>,
) -> CliResult<(Clip, People)> {
    let mut clip = match args.resample {
        Some(rate_hz) => clip.resample(rate_hz, args.recording.motion_compensate)?,
        None => clip,
    };
    if !args.people.is_given() {
        return Ok((clip, People::default()));
    }
    if args.cleaning.background.is_some() {
        // Where the static points of the empty scene are removed, the remaining ones may be people.
        clip.clutter = Clutter::Settled;
    }
    let people = find_people(&mut clip, &args.people.options())?;
    if let Some(excluded) = people.excluded {
        notes.push(format!(
            "{excluded}: excluded from tracking as clutter (--min-speed 0 keeps them)"
        ));
    }
    Ok((clip, people))
}

/// The `[processing]` table of a file.
fn processing(path: &Path) -> CliResult<ProcessingFile> {
    let text = bounded::read_text(path, MAX_CONFIG_BYTES)?;
    ProcessingFile::from_toml(&text).map_err(|e| {
        CliError::new(format!("{}: {e}", path.display()))
            .hint("docs/reference/scenes.md lists the fields of [processing]")
    })
}

/// Prints notes on a recording to stderr.
fn print_notes(notes: &[String]) {
    for note in notes {
        note!("note: {note}");
    }
}

/// Prints what is missing in the samples to stderr.
fn print_losses(report: &Report) {
    if report.damaged_frames + report.lost_frames > 0 {
        note!(
            "note: {} frames have missing bytes (zero in the samples), {} never came (empty in the points)",
            report.damaged_frames,
            report.lost_frames
        );
    }
    if report.trailing_bytes > 0 {
        note!(
            "note: {} bytes after the last whole frame",
            report.trailing_bytes
        );
    }
    if let Some(t) = &report.transfer {
        note!(
            "note: {} packets, {} lost, {} out of order, {} repeated, {} too late, {} refused, {} that were none",
            t.packets,
            t.lost,
            t.out_of_order,
            t.duplicates,
            t.late,
            t.refused,
            t.skipped
        );
    }
}

#[derive(Serialize)]
struct RecordedReport {
    frames: usize,
    points_per_frame: f64,
    frame_rate_hz: f64,
    radar: String,
    source: String,
    /// What should be known before the points are trusted, and is not among the notes.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    warnings: Vec<String>,
    notes: Vec<String>,
    out: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    people: Option<Vec<PersonFile>>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    ghosts: Vec<GhostReport>,
}

/// Processes points that the firmware of a radar detected.
fn process_points(
    args: &ProcessArgs,
    options: &CaptureOptions,
    plots: &PictureRequest,
    opened: Opened,
) -> CliResult {
    if plots.adc_statistics.is_some() || plots.pictures.need_samples() {
        return Err(
            CliError::new("this plot is made from raw samples; the capture holds points")
                .hint("--point-cloud, --points-over-time and --tracks are made from points"),
        );
    }
    refuse_options(&[("processing", args.processing.is_some())], NEEDS_SAMPLES)?;
    if !needs_all(args, plots) {
        options.check_for_points()?;
        if let Some(stream) = PointStream::open(opened.again(), options)? {
            let report = convert_stream(args, stream)?;
            return print_recorded(args, &report);
        }
    }
    let recording = read_recorded_points(opened, options)?;
    let (mut notes, mut warnings) = (recording.notes, recording.warnings);
    warnings.retain(|warning| !notes.contains(warning));
    let (clip, people) = resample_and_track(args, recording.clip, &mut notes)?;
    let tracks = args.people.is_given().then_some(&people.tracks[..]);
    Pictures::new(&plots.pictures).finish(&clip.frames, tracks)?;
    let files = write_all(args, &clip, &people)?;
    let report = RecordedReport {
        frames: clip.frames.len(),
        points_per_frame: clip.points_per_frame(),
        frame_rate_hz: clip.frame_rate_hz,
        source: clip.provenance.to_string(),
        radar: clip.radar,
        warnings,
        notes,
        out: args.out.display().to_string(),
        people: files,
        ghosts: people.ghosts.iter().map(GhostReport::from).collect(),
    };
    print_recorded(args, &report)
}

/// Converts a recording frame by frame, so that its length needs no memory.
fn convert_stream(args: &ProcessArgs, mut stream: PointStream) -> CliResult<RecordedReport> {
    // What is wrong with the stream is told before what is not known of it.
    let first = stream.next_frame()?;
    let about = stream.about()?;
    let name = args.capture[0].display().to_string();
    let mut progress = Progress::new(&name);
    let mut end = None;
    let mut next = first;
    let mut open = Some(stream);
    let written = write_each(args, &about, |writer| {
        let frame = next.take();
        if let Some(stream) = &mut open {
            next = stream.next_frame()?;
            progress.show(stream.share_read());
        }
        // Whether speeds were measured is known at the end.
        if next.is_none()
            && let Some(stream) = open.take()
        {
            let found = end.insert(stream.finish()?);
            if !found.has_speeds {
                writer.without_speeds();
            }
        }
        Ok(frame)
    })?;
    drop(progress);
    let StreamEnd {
        notes,
        mut warnings,
        ..
    } = end.unwrap_or_default();
    warnings.retain(|warning| !notes.contains(warning));
    Ok(RecordedReport {
        frames: written.frames,
        points_per_frame: written.points_per_frame(),
        frame_rate_hz: about.frame_rate_hz,
        source: about.provenance.to_string(),
        radar: about.radar,
        warnings,
        notes,
        out: args.out.display().to_string(),
        people: None,
        ghosts: Vec::new(),
    })
}

/// Prints what was made of recorded points.
fn print_recorded(args: &ProcessArgs, report: &RecordedReport) -> CliResult {
    for warning in &report.warnings {
        note!("warning: {warning}");
    }
    print_notes(&report.notes);
    if args.json {
        return output::print_json(report);
    }
    output::print_line(&format!(
        "{}: {} frames at {:.2} Hz, {:.1} points a frame",
        report.out, report.frames, report.frame_rate_hz, report.points_per_frame
    ));
    print_people(report.people.as_deref(), &report.ghosts);
    Ok(())
}
