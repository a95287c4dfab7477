//! `demo`: built-in motions and the recording of a simulated board, through the whole chain with the default model.

use std::path::PathBuf;

use clap::Args;
use radarllm::{
    Captioner, DescribeOptions, PeopleOptions, Provenance, Recording, Segment, SimulateOptions,
    Verdict,
};
use radarllm_demo::{BOARD, CHIRPS, MOTIONS, SEED, STREAM, performed_in};
use serde::{Serialize, Serializer};

use crate::{
    commands::{
        describe::{self, Row},
        view,
    },
    error::CliResult,
    model,
    model_args::DecoderName,
    output,
};

/// `demo`.
#[derive(Args)]
pub(crate) struct DemoArgs {
    /// Also write points and pages into this folder.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Motions to show instead of the default motions and the recording.
    #[arg(value_name = "BUILTIN")]
    pub motions: Vec<String>,
    /// Model folder, or a bundled model: `features` (the default) or `tokens`.
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// Seed of placement, motion variations and noise.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Replace files in --out.
    #[arg(long)]
    pub force: bool,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

#[derive(Serialize)]
struct DemoRow {
    #[serde(flatten)]
    described: Row,
    /// Whether this is a recording of a simulated board.
    simulated_board: bool,
    /// The parts of the sentence, each beside what was performed.
    parts: Vec<Part>,
    points_per_frame: f64,
    /// Path of the page, if `--out` is given.
    #[serde(skip_serializing_if = "Option::is_none")]
    page: Option<String>,
}

/// A sentence and what was performed for most of its time.
#[derive(Serialize)]
struct Part {
    start_s: f64,
    end_s: f64,
    performed: String,
    described: String,
    confidence: f32,
    /// `right`, or what is wrong.
    #[serde(serialize_with = "as_text")]
    verdict: Verdict,
}

fn as_text<S: Serializer>(verdict: &Verdict, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(verdict)
}

/// Runs the command.
pub(crate) fn run(args: &DemoArgs) -> CliResult {
    let captioner = model::captioner(args.model.as_deref(), DecoderName::F32)?;
    let mut rows = Vec::new();
    let motions: Vec<&str> = match args.motions.is_empty() {
        true => MOTIONS.to_vec(),
        false => args.motions.iter().map(String::as_str).collect(),
    };
    let say = |text: &str| {
        if !args.json {
            output::print_line(text);
        }
    };
    say("Motions in front of a simulated radar; the model sees nothing but the points.\n");
    let simulation = SimulateOptions {
        seed: args.seed,
        ..SimulateOptions::default()
    };
    for motion in motions {
        let recording = radarllm::open(motion)
            .with_simulation(simulation.clone())
            .points()?;
        let captions = recording
            .performed
            .as_ref()
            .map(|p| &p.motion.info.captions);
        let caption = captions
            .and_then(|c| c.first().cloned())
            .unwrap_or_default();
        let row = row(&captioner, motion, &recording, args, rows.len(), |_, _| {
            caption.clone()
        })?;
        rows.push(row);
    }
    if args.motions.is_empty() {
        say(BOARD);
        let recording = recorded()?;
        let row = row(
            &captioner,
            STREAM.0,
            &recording,
            args,
            rows.len(),
            |from, to| performed_in(from, to).into(),
        )?;
        rows.push(DemoRow {
            simulated_board: true,
            ..row
        });
    }
    if args.json {
        return output::print_json(&rows);
    }
    let verdicts = || rows.iter().flat_map(|row| &row.parts).map(|p| p.verdict);
    let n_right = verdicts().filter(|v| *v == Verdict::Right).count();
    output::print_line(&format!(
        "{n_right} of {} sentences are right.",
        verdicts().count()
    ));
    Ok(())
}

/// The one person of the recording.
fn recorded() -> CliResult<Recording> {
    let folder = std::env::temp_dir().join(format!("radarllm-demo-{}", std::process::id()));
    let read = || -> CliResult<Recording> {
        let [stream, chirps] = [STREAM, CHIRPS].map(|(name, bytes)| (folder.join(name), bytes));
        for (path, bytes) in [&stream, &chirps] {
            output::write_atomic(path, bytes)?;
        }
        let source = radarllm::open(&stream.0).radar(&chirps.0.display().to_string())?;
        Ok(source.points()?)
    };
    let recording = read();
    // What is left in the folder of temporary files does no harm.
    let _ = std::fs::remove_dir_all(&folder);
    let mut recording = recording?;
    // The stream does not say that its board was simulated.
    recording.clip.provenance = Provenance::simulated(STREAM.0, SEED);
    let one_person = PeopleOptions {
        max_people: Some(1),
        ..PeopleOptions::default()
    };
    if let Some(person) = recording.track_people(&one_person)?.into_iter().next() {
        recording.clip = person.clip;
    }
    Ok(recording)
}

/// Describes a recording, writes its page and prints both; `performed` gives what was done between two times, s.
fn row(
    captioner: &Captioner,
    name: &str,
    recording: &Recording,
    args: &DemoArgs,
    index: usize,
    performed: impl Fn(f64, f64) -> String,
) -> CliResult<DemoRow> {
    let clip = &recording.clip;
    let prepared = recording.prepared()?.clip;
    let described = describe::describe(captioner, name, &prepared, &DescribeOptions::default())?;
    let part = |segment: &Segment| {
        let performed = performed(segment.start_s, segment.end_s);
        Part {
            start_s: segment.start_s,
            end_s: segment.end_s,
            verdict: Verdict::of(&segment.caption, &performed),
            performed,
            described: segment.caption.clone(),
            confidence: segment.confidence,
        }
    };
    let parts: Vec<Part> = described.segments.iter().map(part).collect();
    let page = match &args.out {
        Some(folder) => {
            let path = folder.join(format!("demo-{}.html", index + 1));
            output::check_free(&path, args.force)?;
            view::write_page(&path, clip, recording.performed.as_ref(), &described)?;
            Some(path.display().to_string())
        }
        None => None,
    };
    let row = DemoRow {
        points_per_frame: clip.points_per_frame(),
        simulated_board: false,
        described,
        parts,
        page,
    };
    if !args.json {
        print(&row);
    }
    Ok(row)
}

fn print(row: &DemoRow) {
    output::print_line(&format!(
        "{} ({:.0} points a frame)",
        row.described.source.source, row.points_per_frame
    ));
    if row.parts.is_empty() {
        output::print_line(&format!("    {}", row.described.caption));
    }
    for part in &row.parts {
        let times = format!("{:.0} to {:.0} s", part.start_s, part.end_s);
        output::print_line(&format!("    {times:<11} performed: {}", part.performed));
        output::print_line(&format!("                described: {}", part.described));
        output::print_line(&format!(
            "                {}, confidence {:.2}",
            part.verdict, part.confidence
        ));
    }
    if let Some(page) = &row.page {
        output::print_line(&format!("    page: {page}"));
    }
    output::print_line("");
}
