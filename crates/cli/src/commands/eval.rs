//! `eval`: captions for a split, all metrics with intervals, and the floors beside them.

use std::{collections::BTreeMap, fmt::Write as _, path::Path, time::Instant};

use radarllm_dataset::{ClipRecord, Columns, Dataset, Split, descriptor};
use radarllm_metrics::{
    ActionNamer, Candidate, NearestNeighbour, Reference, ScoreOptions, Scores,
    bootstrap::{mean_interval, units_of_ids},
    majority_caption, score, shuffled_assignment,
};
use serde::Serialize;

use crate::{
    args::EvalArgs,
    commands::describe,
    error::{CliError, CliResult},
    output,
};

/// One system on one split.
#[derive(Serialize)]
struct System {
    name: &'static str,
    what: &'static str,
    scores: Scores,
    /// Share of captions that name the right action, 0..1.
    right_action: Share,
}

/// A share with its 95 % interval.
#[derive(Serialize)]
struct Share {
    value: f64,
    low: f64,
    high: f64,
}

/// What report.json says.
#[derive(Serialize)]
pub struct Report {
    data: String,
    split: String,
    model: String,
    protocol: &'static str,
    max_references: usize,
    clips: usize,
    abstained: usize,
    train_clips: usize,
    beam: usize,
    seed: u64,
    systems: Vec<System>,
    /// Share of reference captions of this split whose action the namer finds: the ceiling of
    /// `right_action`.
    action_namer_on_references: f64,
    /// Share of the model's captions that name the right action, by action.
    right_action_by_action: BTreeMap<String, (usize, f64)>,
    parameters: usize,
    seconds: f64,
    captions_per_s: f64,
    radar_frames_per_s: f64,
    peak_memory_mb: Option<f64>,
}

#[derive(Serialize)]
struct CaptionLine<'a> {
    id: &'a str,
    action: &'a str,
    text: &'a str,
    confidence: f32,
    nearest: &'a str,
    references: &'a [String],
}

/// Runs the verb.
pub fn run(args: &EvalArgs) -> CliResult {
    let report = evaluate(args)?;
    if args.json {
        return output::print_json(&report);
    }
    output::print_line(markdown(&report)?.trim_end());
    Ok(())
}

/// Describes, scores and writes report.json, report.md and captions.jsonl.
pub fn evaluate(args: &EvalArgs) -> CliResult<Report> {
    output::check_free(&args.out.join("report.json"), args.force)?;
    let split = Split::from_name(&args.split).ok_or_else(|| {
        CliError::new(format!("--split {}: unknown", args.split)).hint("train, val or test")
    })?;
    let (captioner, model) = describe::load_decoder(args.model.as_deref(), args.decoder)?;
    let data = Dataset::open(&args.data)?;
    let clips = read(&data, split)?;
    let train = read(&data, Split::Train)?;
    if clips.is_empty() || train.is_empty() {
        return Err(CliError::new(format!(
            "{}: no clips in split `{}` or `train`",
            args.data.display(),
            args.split
        )));
    }

    let started = Instant::now();
    let inputs: Vec<_> = clips
        .iter()
        .map(|c| (c.frames.as_slice(), c.radar_height_m))
        .collect();
    let described = captioner.describe_batch(&inputs, args.beam)?;
    let seconds = started.elapsed().as_secs_f64();
    let texts: Vec<String> = described.iter().map(|d| d.caption.clone()).collect();

    let namer = ActionNamer::fit(&captions_with_actions(&train))
        .ok_or_else(|| CliError::new("the training captions hold no words"))?;
    let references: Vec<Reference> = clips
        .iter()
        .map(|c| Reference {
            id: c.id.clone(),
            texts: c.captions.clone(),
        })
        .collect();
    let units = units_of_ids(clips.iter().map(|c| c.id.as_str()));
    let options = ScoreOptions {
        seed: args.seed,
        ..ScoreOptions::default()
    };
    let names = |caption: &str, action: &str| namer.name(caption) == Some(action);
    let nearest = nearest_captions(&train, &clips)?;
    let judge = |name, what, texts: &[String]| -> CliResult<System> {
        let candidates: Vec<Candidate> = clips
            .iter()
            .zip(texts)
            .map(|(c, t)| Candidate {
                id: c.id.clone(),
                text: t.clone(),
            })
            .collect();
        let right: Vec<f64> = clips
            .iter()
            .zip(texts)
            .map(|(c, t)| f64::from(u8::from(names(t, &c.action))))
            .collect();
        let [low, high] =
            mean_interval(&right, &units, options.n_resamples, args.seed).unwrap_or([0.0; 2]);
        Ok(System {
            name,
            what,
            scores: score(&candidates, &references, &options)?,
            right_action: Share {
                value: right.iter().sum::<f64>() / right.len() as f64,
                low,
                high,
            },
        })
    };
    let train_captions: Vec<&str> = train
        .iter()
        .flat_map(|c| &c.captions)
        .map(String::as_str)
        .collect();
    let majority = majority_caption(&train_captions)
        .unwrap_or_default()
        .to_string();
    let order = shuffled_assignment(clips.len(), args.seed)
        .ok_or_else(|| CliError::new("one clip alone cannot be shuffled"))?;
    let shuffled: Vec<String> = order.iter().map(|&i| texts[i].clone()).collect();
    let systems = vec![
        judge("model", "the model on its own radar", &texts)?,
        judge(
            "shuffled",
            "floor: the model on another clip's radar",
            &shuffled,
        )?,
        judge(
            "majority",
            "floor: the most frequent training caption",
            &vec![majority; clips.len()],
        )?,
        judge(
            "nearest",
            "floor: a caption of the nearest training clip",
            &nearest,
        )?,
    ];

    let reference_hits: Vec<bool> = clips
        .iter()
        .flat_map(|c| c.captions.iter().map(|caption| names(caption, &c.action)))
        .collect();
    let mut by_action: BTreeMap<String, (usize, f64)> = BTreeMap::new();
    for (clip, text) in clips.iter().zip(&texts) {
        let entry = by_action.entry(clip.action.clone()).or_default();
        entry.0 += 1;
        entry.1 += f64::from(u8::from(names(text, &clip.action)));
    }
    for (count, hits) in by_action.values_mut() {
        *hits /= *count as f64;
    }
    let n_frames: usize = clips.iter().map(|c| c.frames.len()).sum();
    let report = Report {
        data: data.manifest().name.clone(),
        split: args.split.clone(),
        model,
        protocol: "plain",
        max_references: 3,
        clips: clips.len(),
        abstained: described.iter().filter(|d| d.abstained.is_some()).count(),
        train_clips: train.len(),
        beam: args.beam,
        seed: args.seed,
        systems,
        action_namer_on_references: reference_hits.iter().filter(|h| **h).count() as f64
            / reference_hits.len() as f64,
        right_action_by_action: by_action,
        parameters: captioner.n_params(),
        seconds,
        captions_per_s: clips.len() as f64 / seconds,
        radar_frames_per_s: n_frames as f64 / seconds,
        peak_memory_mb: peak_memory_mb(),
    };

    let mut lines = String::new();
    for ((clip, description), nearest) in clips.iter().zip(&described).zip(&nearest) {
        let line = CaptionLine {
            id: &clip.id,
            action: &clip.action,
            text: &description.caption,
            confidence: description.confidence,
            nearest,
            references: &clip.captions,
        };
        writeln!(lines, "{}", serde_json::to_string(&line)?)?;
    }
    let markdown = markdown(&report)?;
    write(&args.out.join("captions.jsonl"), lines.as_bytes())?;
    write(&args.out.join("report.md"), markdown.as_bytes())?;
    write(
        &args.out.join("report.json"),
        serde_json::to_string_pretty(&report)?.as_bytes(),
    )?;
    Ok(report)
}

fn write(path: &Path, bytes: &[u8]) -> CliResult {
    output::write_atomic(path, bytes)
}

/// A split without what evaluation does not need; one variant a motion.
fn read(data: &Dataset, split: Split) -> CliResult<Vec<ClipRecord>> {
    let mut clips: Vec<ClipRecord> = data
        .iter_split(split, Columns::Points)
        .collect::<Result<_, _>>()?;
    if split != Split::Train {
        let mut seen = std::collections::BTreeSet::new();
        clips.retain(|c| seen.insert(c.motion_id.clone()));
    }
    Ok(clips)
}

fn captions_with_actions(clips: &[ClipRecord]) -> Vec<(&str, &str)> {
    clips
        .iter()
        .flat_map(|c| {
            c.captions
                .iter()
                .map(|caption| (caption.as_str(), c.action.as_str()))
        })
        .collect()
}

/// The first caption of the training clip whose hand-made descriptor is nearest.
fn nearest_captions(train: &[ClipRecord], clips: &[ClipRecord]) -> CliResult<Vec<String>> {
    let describe = |c: &ClipRecord| descriptor(&c.frames, c.radar_height_m);
    let train_vectors: Vec<Vec<f32>> = train.iter().map(describe).collect();
    let neighbours = NearestNeighbour::fit(&train_vectors)?;
    clips
        .iter()
        .map(|c| Ok(train[neighbours.nearest(&describe(c))?].captions[0].clone()))
        .collect()
}

/// Peak resident memory of this process, MB, where the system tells.
pub fn peak_memory_mb() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with("VmHWM:"))?;
    line.split_whitespace()
        .nth(1)?
        .parse::<f64>()
        .ok()
        .map(|kb| kb / 1024.0)
}

fn markdown(report: &Report) -> CliResult<String> {
    let mut text = String::new();
    writeln!(
        text,
        "# Captions of `{}`, split `{}`\n",
        report.data, report.split
    )?;
    writeln!(
        text,
        "Model: {} ({:.2} M parameters), beam {}. {} clips ({} abstained); floors from {} training clips.",
        report.model,
        report.parameters as f64 / 1e6,
        report.beam,
        report.clips,
        report.abstained,
        report.train_clips
    )?;
    writeln!(
        text,
        "Protocol `{}`, at most {} references. Values x100 (CIDEr-D in its own scale), 95 % bootstrap intervals over motions.\n",
        report.protocol, report.max_references
    )?;
    writeln!(
        text,
        "| system | BLEU-1 | BLEU-4 | ROUGE-1 | ROUGE-L | METEOR | CIDEr-D | right action |"
    )?;
    writeln!(text, "|---|---|---|---|---|---|---|---|")?;
    for system in &report.systems {
        let s = &system.scores;
        write!(text, "| {}", system.what)?;
        for (name, value, scale) in [
            ("bleu_1", s.bleu_1, 100.0),
            ("bleu_4", s.bleu_4, 100.0),
            ("rouge_1", s.rouge_1, 100.0),
            ("rouge_l", s.rouge_l, 100.0),
            ("meteor", s.meteor.unwrap_or(f64::NAN), 100.0),
            ("cider_d", s.cider_d, 1.0),
        ] {
            let [low, high] = s.ci95.get(name).copied().unwrap_or([f64::NAN; 2]);
            let digits = if scale == 1.0 { 3 } else { 1 };
            write!(
                text,
                " | {:.digits$} [{:.digits$}, {:.digits$}]",
                value * scale,
                low * scale,
                high * scale
            )?;
        }
        let r = &system.right_action;
        writeln!(
            text,
            " | {:.1} [{:.1}, {:.1}] |",
            r.value * 100.0,
            r.low * 100.0,
            r.high * 100.0
        )?;
    }
    writeln!(
        text,
        "\nThe action namer (naive Bayes on training captions) is right on {:.1} % of this split's own references.",
        report.action_namer_on_references * 100.0
    )?;
    writeln!(text, "\n| action | clips | right action % |\n|---|---|---|")?;
    for (action, (count, share)) in &report.right_action_by_action {
        writeln!(text, "| {action} | {count} | {:.0} |", share * 100.0)?;
    }
    writeln!(
        text,
        "\nSpeed on this machine: {:.1} captions/s, {:.0} radar frames/s (tokenizer and language model, beam {}).",
        report.captions_per_s, report.radar_frames_per_s, report.beam
    )?;
    if let Some(mb) = report.peak_memory_mb {
        writeln!(text, "Peak memory {mb:.0} MB.")?;
    }
    writeln!(
        text,
        "\nMETEOR 1.5 with exact, stem and WordNet matches (docs/metrics.md). BERTScore and SimCSE: not run."
    )?;
    Ok(text)
}
