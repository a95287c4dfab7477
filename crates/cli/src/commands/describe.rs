//! `describe`: generates sentences from recordings, points files or motions.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    time::Instant,
};

use clap::Args;
use radarllm::{
    BundledModel, Captioner, Clip, DescribeOptions, Description, Input, LongRecording, Person,
    PrepareOptions, PreparedClip, Recording, SimulateOptions, Site, SiteError, board_people,
    is_general, prepare_for_model, teach::Warning,
};
use radarllm_base::StaticClutter;
use radarllm_formats::folder::raw_part;
use radarllm_inference::{
    Chosen, Segment,
    lm::{AnswerPart, Instruction},
};
use radarllm_io::options::DEFAULT_RADAR_HEIGHT_M;
use radarllm_tracking::find_people;
use rayon::prelude::*;
use serde::Serialize;

use crate::{
    commands::generate,
    error::{CliError, CliResult},
    memory::peak_memory_mb,
    model,
    model_args::DecoderName,
    output,
    person_report::{GhostReport, PersonReport},
    progress::Progress,
    recording_args::{InputArgs, PeopleArgs},
    threads::{on_threads, threads},
    user_memory::load_memory,
};

/// `describe`.
#[derive(Args)]
pub(crate) struct DescribeArgs {
    /// Recordings of any format, points files, motion files or builtin:NAME?key=value.
    #[arg(required = true)]
    pub inputs: Vec<String>,
    /// Model folder, or a bundled model: `features` (the default) or `tokens`.
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// Decoder of the language model.
    #[arg(long, value_enum, default_value = "f32")]
    pub decoder: DecoderName,
    /// Search for the most probable sentence with N beams (1 is greedy) instead of a vote among drawn sentences.
    #[arg(long, value_name = "N")]
    pub beam: Option<usize>,
    /// File with taught activities; the user's own if omitted and there is one.
    #[arg(long, value_name = "FILE")]
    pub memory: Option<PathBuf>,
    /// Choose among these activities instead of describing freely: "boxing,squats,walking".
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    pub choose: Vec<String>,
    /// Follow this instruction instead of describing: a question about the motion ("which way does she go?", "did he fall?"),
    /// or a request for its description, length or continuation. The model is the bundled `tokens` unless --model names another
    /// that was tuned.
    #[arg(long, value_name = "TEXT", conflicts_with_all = ["choose", "memory"])]
    pub instruct: Option<String>,
    /// File of the site, by `radarllm site`: tilt of the radar and height of a standing person. Learned from each recording in
    /// which somebody walks if omitted.
    #[arg(long, value_name = "FILE")]
    pub site: Option<PathBuf>,
    /// How to read the inputs.
    #[command(flatten)]
    pub input: InputArgs,
    /// Tracking of people: one sentence for each, with the track's number and time.
    #[command(flatten)]
    pub people: PeopleArgs,
    /// Threads; all cores if omitted.
    #[arg(long)]
    pub threads: Option<usize>,
    /// Seed of simulated inputs.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Print also how the input was read, byte by byte, and how the sentences were made.
    #[arg(short, long)]
    pub verbose: bool,
    /// Print a JSON document for each described input or person, on a line of its own (JSON lines).
    #[arg(long)]
    pub json: bool,
}

/// Inputs per thread that are described before their results are printed.
const INPUTS_PER_THREAD: usize = 4;

/// How much is printed about an input.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Detail {
    /// What a user should know before trusting the result.
    Warnings,
    /// Also how the input was read, and how the result was made.
    All,
}

/// Where a described clip comes from, as scripts read it.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct SourceReport {
    /// The input as named.
    pub source: String,
    /// Name of the radar.
    pub radar: String,
    /// Whether a simulator made the points, now or earlier.
    pub synthetic: bool,
    /// `simulated` or `recorded`.
    pub provenance: &'static str,
}

/// One described input, as scripts read it.
#[derive(Serialize)]
pub(crate) struct Row {
    /// The sentence, or `no person seen`.
    pub caption: String,
    /// Why there is no sentence, when there is none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// Mean of the confidences of the segments, 0..1; 0 when nothing was described.
    pub confidence: f32,
    /// The input and its provenance.
    #[serde(flatten)]
    pub source: SourceReport,
    /// Model name.
    pub model: String,
    /// The sentences with their times.
    pub segments: Vec<Segment>,
    /// Activities in order of their probability, with `--choose`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub choices: Vec<Chosen>,
    /// Radar tokens read.
    pub tokens: Vec<u32>,
    /// Radar frames read.
    pub frames: usize,
    /// Length of the clip, s.
    pub clip_seconds: f64,
    /// What to know before trusting the sentences: what was lost, removed or assumed. Absent if there is nothing.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
    /// Time from points to sentence, s.
    pub seconds: f64,
    /// Peak memory of this process, MB (Linux).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub peak_memory_mb: Option<f64>,
    /// The person described, with `--people`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub person: Option<PersonReport>,
}

fn source_of(input: &str, clip: &Clip) -> SourceReport {
    SourceReport {
        source: input.into(),
        radar: clip.radar.clone(),
        synthetic: clip.provenance.is_simulated(),
        provenance: clip.provenance.kind(),
    }
}

/// Describes a clip.
pub(crate) fn describe(
    captioner: &Captioner,
    input: &str,
    clip: &PreparedClip,
    options: &DescribeOptions,
) -> CliResult<Row> {
    describe_at(captioner, input, clip, options, None)
}

/// Describes a clip, of a site if the recording of which it is a part shows one.
fn describe_at(
    captioner: &Captioner,
    input: &str,
    clip: &PreparedClip,
    options: &DescribeOptions,
    site: Option<&Site>,
) -> CliResult<Row> {
    let started = Instant::now();
    let described = captioner.describe_at(clip, options, site)?;
    let length = (clip.frames.len(), length_s(clip));
    Ok(row(
        captioner,
        source_of(input, clip),
        described,
        length,
        started,
    ))
}

/// Length of a clip, s: from its first frame to its last one where frames are missing.
fn length_s(clip: &Clip) -> f64 {
    /// Times of frames jitter by less, s.
    const GAP_S: f64 = 1.0;
    let times = clip.frames.first().zip(clip.frames.last());
    let span_s = times.map_or(0.0, |(first, last)| last.time_s - first.time_s);
    match span_s > clip.duration_s() + GAP_S {
        true => span_s + 1.0 / clip.frame_rate_hz,
        false => clip.duration_s(),
    }
}

/// The row of a description that was begun at `started`, of a number of frames and seconds.
fn row(
    captioner: &Captioner,
    source: SourceReport,
    described: Description,
    (frames, clip_seconds): (usize, f64),
    started: Instant,
) -> Row {
    Row {
        caption: described.caption,
        reason: described.abstained.map(|why| why.to_string()),
        confidence: described.confidence,
        source,
        model: captioner.name().into(),
        segments: described.segments,
        choices: described.choices,
        tokens: described.tokens,
        frames,
        clip_seconds,
        warnings: Vec::new(),
        seconds: started.elapsed().as_secs_f64(),
        peak_memory_mb: peak_memory_mb(),
        person: None,
    }
}

/// The clip of a recording as the model expects it, and what to know before trusting its points; both go to stderr, too.
pub(crate) fn prepared(
    input: &str,
    recording: &Recording,
    detail: Detail,
) -> CliResult<(PreparedClip<'static>, Vec<String>)> {
    let mut warnings = recording.warnings.clone();
    print_about(input, &recording.notes, &warnings, detail);
    let prepared = recording.prepared()?;
    note_removed(input, prepared.removed_static, &mut warnings);
    let gaps = radarllm::gaps(&prepared.clip);
    note_gaps(input, &gaps, detail, &mut warnings);
    Ok((prepared.clip, warnings))
}

/// Prints what is known about a recording: with [`Detail::All`] its notes, which include the reasons of the warnings with all
/// counts.
fn print_about(input: &str, notes: &[String], warnings: &[String], detail: Detail) {
    let (mark, lines) = match detail {
        Detail::Warnings => ("warning: ", warnings),
        Detail::All => ("", notes),
    };
    for line in lines {
        note!("{mark}{input}: {line}");
    }
}

fn note_removed(input: &str, removed: Option<StaticClutter>, warnings: &mut Vec<String>) {
    if let Some(clutter) = removed {
        let text = format!("{clutter} and are removed as clutter (--min-speed 0 keeps them)");
        note!("{input}: {text}");
        warnings.push(text);
    }
}

fn note_gaps(input: &str, gaps: &[[f64; 2]], detail: Detail, warnings: &mut Vec<String>) {
    let mark = match detail {
        Detail::Warnings => "warning: ",
        Detail::All => "",
    };
    if let Some([from_s, to_s]) = gaps.first() {
        let others = match gaps.len() {
            1 => String::new(),
            n => format!(", and {} more times of more than 2 s", n - 1),
        };
        let text =
            format!("no frames from {from_s:.1} s to {to_s:.1} s{others}; nothing is said of them");
        note!("{mark}{input}: {text}");
        warnings.push(text);
    }
}

/// What a recording shows of its site; `None` if no board tracks people in it.
fn site_of(clip: &Clip) -> Option<Result<Site, SiteError>> {
    let mut reports = clip.frames.iter().flat_map(|f| &f.board);
    let has_tracks = reports.any(|report| !report.tracks.is_empty());
    has_tracks.then(|| Site::learn(&clip.radar, &clip.frames))
}

/// Says why postures of a recording in which a board tracks people are less sure, if they are.
fn doubt_about_site(input: &str, site: Option<&Result<Site, SiteError>>, about: &Clip) {
    let Some(Err(error)) = site else {
        return;
    };
    match error {
        SiteError::NoHeights => {
            note!("warning: {input}: the board tracks no heights: postures are not told");
        }
        error if about.is_height_assumed => {
            note!(
                "warning: {input}: {error} to learn the site, and the height of the radar is not stated: postures are told \
                 only where they leave no doubt (--radar-height-m states it, `radarllm site` learns it from other recordings)"
            );
        }
        error => {
            note!(
                "warning: {input}: {error} to learn the site: postures are told by the stated height and tilt of the radar, \
                 where these leave no doubt (`radarllm site` learns them from other recordings)"
            );
        }
    }
}

/// Describes a recording that is too long to be kept in memory.
fn describe_long(
    captioner: &Captioner,
    input: &str,
    recording: LongRecording,
    options: &DescribeOptions,
    detail: Detail,
    mut progress: Option<Progress<'_>>,
) -> CliResult<Row> {
    let mut warnings = recording.warnings.clone();
    print_about(input, &recording.notes, &warnings, detail);
    let source = source_of(input, &recording.about);
    let started = Instant::now();
    let long = captioner.describe_long(recording, options, |share| {
        progress
            .iter_mut()
            .for_each(|progress| progress.show(share));
    })?;
    drop(progress);
    note_removed(input, long.removed_static, &mut warnings);
    note_gaps(input, &long.gaps, detail, &mut warnings);
    let length = (long.frames, long.seconds);
    let row = row(captioner, source, long.description, length, started);
    Ok(Row { warnings, ..row })
}

/// Prints a row for people: a line about the source, then the sentences.
pub(crate) fn print_row(row: &Row, detail: Detail) {
    let who = row.person.as_ref().map_or(String::new(), |p| {
        format!(
            ", person {} from {:.1} s to {:.1} s",
            p.id, p.start_s, p.end_s
        )
    });
    output::print_line(&format!(
        "{}: {}, radar {}, {:.1} s{who}",
        row.source.source, row.source.provenance, row.source.radar, row.clip_seconds
    ));
    /// What begins or ends so near the beginning or the end, s, is of the whole recording.
    const NEAR_S: f64 = 1.0;
    let is_whole = |s: &Segment| s.start_s < NEAR_S && s.end_s > row.clip_seconds - NEAR_S;
    let is_plain =
        |s: &Segment| s.taught.is_none() && !is_general(s) && s.guess.is_none() && is_whole(s);
    if row.segments.len() < 2 && row.segments.iter().all(is_plain) {
        let remark = match &row.reason {
            Some(reason) => format!(": {reason}"),
            None => format!(" ({:.2})", row.confidence),
        };
        output::print_line(&format!("    {}{remark}", row.caption));
    } else {
        row.segments.iter().for_each(|s| print_segment(s, detail));
    }
    for choice in &row.choices {
        output::print_line(&format!(
            "    {:.2} {}",
            choice.probability, choice.activity
        ));
    }
    if detail == Detail::All {
        output::print_line(&format!(
            "    [model {}, confidence {:.2}, {} frames, {} tokens, {:.2} s]",
            row.model,
            row.confidence,
            row.frames,
            row.tokens.len(),
            row.seconds
        ));
    }
}

/// A segment with the confidence of its sentence. What was withheld is printed only with all detail, and its confidence with
/// it: of such guesses on unknown boards, hardly any is right (docs/results/boards.md).
fn print_segment(s: &Segment, detail: Detail) {
    let remark = match (&s.taught, &s.guess) {
        (Some(_), _) => format!(" ({:.2}, taught)", s.confidence),
        (None, Some(guess)) if detail == Detail::All => {
            format!(" ({:.2}, perhaps {guess})", s.confidence)
        }
        (None, Some(_)) => String::new(),
        (None, None) if is_general(s) => String::new(),
        (None, None) => format!(" ({:.2})", s.confidence),
    };
    output::print_line(&format!(
        "    {:6.1} s to {:5.1} s  {}{remark}",
        s.start_s, s.end_s, s.caption
    ));
}

/// Refuses a number of beams that the search does not have.
pub(crate) fn check_beam(beam: Option<usize>) -> CliResult {
    match beam {
        None | Some(1..=64) => Ok(()),
        Some(beam) => Err(CliError::new(format!("--beam {beam}: must be in 1..=64"))),
    }
}

/// The answer to an instruction about one input, as scripts read it.
#[derive(Serialize)]
struct AnswerRow {
    /// The input and its provenance.
    #[serde(flatten)]
    source: SourceReport,
    /// Model name.
    model: String,
    /// The instruction.
    instruction: String,
    /// Task that was understood.
    task: &'static str,
    /// Wording of instruction tuning that is most like the instruction.
    nearest_wording: &'static str,
    /// Likeness to it, 0..1; 1 for the same words.
    likeness: f32,
    /// Answers in order of time.
    answers: Vec<AnswerPart>,
    /// The person, with `--people`.
    #[serde(skip_serializing_if = "Option::is_none")]
    person: Option<PersonReport>,
}

/// Follows an instruction about a clip.
fn answer(
    captioner: &Captioner,
    input: &str,
    clip: &PreparedClip,
    text: &str,
    instruction: &Instruction,
    options: &DescribeOptions,
) -> CliResult<AnswerRow> {
    let answer = captioner
        .model()
        .networks()?
        .answer(clip, instruction, options);
    let answer = answer.map_err(|e| generate::not_learned(captioner.name(), e))?;
    Ok(AnswerRow {
        source: source_of(input, clip),
        model: captioner.name().into(),
        instruction: text.into(),
        task: answer.task.name(),
        nearest_wording: instruction.nearest(),
        likeness: instruction.likeness(),
        answers: answer.parts,
        person: None,
    })
}

/// Prints an answer for people.
fn print_answer(row: &AnswerRow) {
    output::print_line(&row.source.source);
    let several = row.answers.len() > 1;
    for part in &row.answers {
        let when = match several {
            true => format!("{:6.1} s to {:5.1} s  ", part.start_s, part.end_s),
            false => String::new(),
        };
        let what = match part.codes.len() {
            0 => part.text.clone(),
            n => format!("{n} more radar tokens: {:?}", part.codes),
        };
        output::print_line(&format!("    {when}{what} ({:.2})", part.confidence));
    }
    output::print_line(&format!(
        "    [{}, radar {}, model {}; task {}, most like `{}`]",
        row.source.provenance, row.source.radar, row.model, row.task, row.nearest_wording
    ));
}

/// Runs the command.
pub(crate) fn run(args: &DescribeArgs) -> CliResult {
    check_beam(args.beam)?;
    let instruction = args.instruct.as_deref().map(|text| {
        let parsed = Instruction::parse(text);
        parsed.map(|instruction| (text, instruction))
    });
    let instruction = instruction
        .transpose()
        .map_err(|e| CliError::new(format!("--instruct: {e}")))?;
    // Of the bundled models only one follows instructions.
    let named = args.model.as_deref();
    let model = match instruction {
        Some(_) => named.or(Some(Path::new(BundledModel::Tokens.name()))),
        None => named,
    };
    let mut captioner = model::captioner(model, args.decoder)?;
    if let Some(memory) = load_memory(args.memory.as_deref())? {
        // What is recognised by a single activity says little.
        let is_alone = |w: &Warning| matches!(w, Warning::OnlyActivity { .. });
        for warning in memory.doubts().into_iter().filter(is_alone) {
            note!("warning: {warning}");
        }
        captioner = captioner.with_memory(&memory);
    }
    let site = args.site.as_deref().map(radarllm::read_site).transpose()?;
    captioner = model::restricted(captioner.with_site(site), &args.choose)?;
    let options = args.input.options()?;
    let simulation = SimulateOptions {
        seed: args.seed,
        radar_height_m: options.radar_height_m.unwrap_or(DEFAULT_RADAR_HEIGHT_M),
        ..SimulateOptions::default()
    };
    let describing = DescribeOptions {
        beam: args.beam,
        // Nobody sees the guesses about boards that the model did not learn otherwise.
        guesses: args.verbose || args.json,
        ..DescribeOptions::default()
    };
    let detail = match args.verbose {
        true => Detail::All,
        false => Detail::Warnings,
    };
    let source = |input: &Capture| {
        radarllm::open_parts(&input.files)
            .with_options(options.clone())
            .with_simulation(simulation.clone())
    };
    let clips_of = |input: &str, recording: Recording| {
        let site = site_of(&recording.clip);
        if args.site.is_none() {
            doubt_about_site(input, site.as_ref(), &recording.clip);
        }
        let (clip, warnings) = prepared(input, &recording, detail)?;
        let asks_model = instruction.is_some() || !args.choose.is_empty();
        if asks_model && !captioner.knows_board(&clip) {
            note!(
                "warning: {input}: the model did not learn this board: its answer is a guess, and nearly always wrong; without \
                 --choose and --instruct, what is measured is stated"
            );
        }
        let clips = clips_of_people(input, clip, &args.people)?;
        // A person shows less of the site than all of them.
        let site = site.and_then(Result::ok).filter(|_| args.people.is_given());
        Ok::<_, CliError>((site, clips, warnings))
    };
    if let Some((text, instruction)) = &instruction {
        let one = |capture: &Capture| -> CliResult<Vec<AnswerRow>> {
            let input = &capture.name;
            clips_of(input, source(capture).points()?)?
                .1
                .into_iter()
                .map(|(person, clip)| {
                    let row = answer(&captioner, input, &clip, text, instruction, &describing)?;
                    Ok(AnswerRow { person, ..row })
                })
                .collect()
        };
        return in_order(args, one, |row| match args.json {
            true => output::print_json_line(row),
            false => {
                print_answer(row);
                Ok(())
            }
        });
    }
    // People are followed, and activities chosen, in a recording as a whole.
    let needs_whole = args.people.is_given() || !args.choose.is_empty();
    let one = |capture: &Capture| -> CliResult<Vec<Row>> {
        let input = &capture.name;
        let recording = match needs_whole {
            true => source(capture).points()?,
            false => match source(capture).read()? {
                Input::Whole(recording) => *recording,
                Input::Long(long) => {
                    if args.site.is_none() {
                        doubt_about_site(input, long.site.as_ref(), &long.about);
                    }
                    let progress = (args.inputs.len() == 1).then(|| Progress::new(input));
                    let row =
                        describe_long(&captioner, input, *long, &describing, detail, progress)?;
                    return Ok(vec![row]);
                }
            },
        };
        let (site, clips, warnings) = clips_of(input, recording)?;
        clips
            .into_iter()
            .map(|(person, clip)| {
                let row = describe_at(&captioner, input, &clip, &describing, site.as_ref())?;
                // The clip of nobody has no points.
                let is_nobody = args.people.people.is_some() && person.is_none();
                let reason = match row.reason {
                    Some(_) if is_nobody => Some("no track of points is that of a person".into()),
                    reason => reason,
                };
                Ok(Row {
                    person,
                    reason,
                    warnings: warnings.clone(),
                    ..row
                })
            })
            .collect()
    };
    in_order(args, one, |row| match args.json {
        true => output::print_json_line(row),
        false => {
            print_row(row, detail);
            Ok(())
        }
    })
}

/// An input: one file or folder, or the parts of a raw capture.
struct Capture {
    /// Its name in reports.
    name: String,
    files: Vec<String>,
}

/// The inputs as named; the parts of a raw capture, which mmWave Studio numbers, are one input.
fn captures(inputs: &[String]) -> Vec<Capture> {
    /// The folder and what the names of the parts have in common, and the number of a part.
    fn part_of(input: &str) -> Option<(PathBuf, u64)> {
        let path = Path::new(input);
        let (common, number) = raw_part(path.file_name()?.to_str()?)?;
        Some((path.with_file_name(common), number))
    }
    let mut captures: Vec<Capture> = Vec::new();
    let mut place_of: BTreeMap<PathBuf, usize> = BTreeMap::new();
    for input in inputs {
        let known = part_of(input).and_then(|(common, _)| {
            let new = captures.len();
            let place = *place_of.entry(common).or_insert(new);
            captures.get_mut(place)
        });
        match known {
            Some(capture) => capture.files.push(input.clone()),
            None => captures.push(Capture {
                name: String::new(),
                files: vec![input.clone()],
            }),
        }
    }
    for capture in &mut captures {
        capture
            .files
            .sort_by_key(|file| part_of(file).map(|part| part.1));
        capture.name = capture.files.join("+");
    }
    captures
}

/// Describes the inputs on several threads, and prints the results in the order of the inputs, soon after they are there. An
/// input that cannot be described is named and does not stop the others.
fn in_order<Row: Send>(
    args: &DescribeArgs,
    describe: impl Fn(&Capture) -> CliResult<Vec<Row>> + Sync,
    print: impl Fn(&Row) -> CliResult + Sync,
) -> CliResult {
    let block = INPUTS_PER_THREAD * threads(args.threads);
    let captures = captures(&args.inputs);
    let mut failed = on_threads(args.threads, || -> CliResult<Vec<CliError>> {
        let mut failed = Vec::new();
        for inputs in captures.chunks(block) {
            let described: Vec<_> = inputs.par_iter().map(&describe).collect();
            for described in described {
                match described {
                    Ok(rows) => rows.iter().try_for_each(&print)?,
                    Err(error) => failed.push(error),
                }
            }
        }
        Ok(failed)
    })??;
    if captures.len() == 1 {
        return failed.pop().map_or(Ok(()), Err);
    }
    if failed.is_empty() {
        return Ok(());
    }
    failed.iter().for_each(CliError::report);
    Err(CliError {
        is_bug: failed.iter().any(|error| error.is_bug),
        ..CliError::new(format!(
            "{} of {} inputs could not be described",
            failed.len(),
            captures.len()
        ))
    })
}

/// The clips to describe: one for each person with `--people`, otherwise the clip itself. If no person is detected, it
/// is the clip without points.
fn clips_of_people(
    input: &str,
    clip: PreparedClip<'static>,
    args: &PeopleArgs,
) -> CliResult<Vec<(Option<PersonReport>, PreparedClip<'static>)>> {
    if !args.is_given() {
        return Ok(vec![(None, clip)]);
    }
    let mut clip = clip.into_clip();
    if args.people.is_some()
        && let Some(people) = board_people(&clip, &args.options())
    {
        let prepared = |person: Person| -> CliResult<_> {
            let report = PersonReport::from(&person);
            let clip = prepare_for_model(person.clip, &PrepareOptions::default())?.clip;
            Ok((Some(report), clip))
        };
        return match people.is_empty() {
            true => Ok(vec![(
                None,
                prepare_for_model(clip, &PrepareOptions::default())?.clip,
            )]),
            false => people.into_iter().map(prepared).collect(),
        };
    }
    let found = find_people(&mut clip, &args.options())?;
    let prepare =
        |clip| -> CliResult<_> { Ok(prepare_for_model(clip, &PrepareOptions::default())?.clip) };
    for ghost in &found.ghosts {
        note!("{input}: {}", GhostReport::from(ghost));
    }
    if args.people.is_none() {
        return Ok(vec![(None, prepare(clip)?)]);
    }
    if found.tracks.is_empty() {
        clip.frames.iter_mut().for_each(|f| f.points.clear());
        return Ok(vec![(None, prepare(clip)?)]);
    }
    let person = |track| {
        let person = radarllm::Person::of(track, &clip);
        Ok((Some(PersonReport::from(&person)), prepare(person.clip)?))
    };
    found.tracks.iter().map(person).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_parts_of_a_raw_capture_are_one_input() {
        let named = [
            "a.csv",
            "x/b_Raw_10.bin",
            "y/b_Raw_0.bin",
            "x/b_Raw_2.bin",
            "a.csv",
        ];
        let captures = captures(&named.map(String::from));
        let names: Vec<&str> = captures.iter().map(|c| c.name.as_str()).collect();
        assert_eq!(
            names,
            [
                "a.csv",
                "x/b_Raw_2.bin+x/b_Raw_10.bin",
                "y/b_Raw_0.bin",
                "a.csv"
            ]
        );
        assert_eq!(captures[1].files, ["x/b_Raw_2.bin", "x/b_Raw_10.bin"]);
    }
}
