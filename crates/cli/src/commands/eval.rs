//! `eval`: captions for a split, all metrics with intervals, and the floors beside them.

use std::{collections::BTreeMap, fmt::Write as _, path::Path, time::Instant};

use radarllm_dataset::{ClipRecord, Columns, Dataset, Split, descriptor};
use radarllm_metrics::{
    ActionNamer, Candidate, NearestNeighbour, Reference, ScoreOptions, Scores,
    bootstrap::units_of_ids, majority_caption, score, shuffled_assignment,
};
use serde::Serialize;

use crate::{
    args::EvalArgs,
    commands::{
        describe, eval_page,
        judge::{ModelFiles, Share, rouge_l_of},
    },
    error::{CliError, CliResult},
    output,
};

/// References counted of each clip.
const MAX_REFERENCES: usize = 3;
/// Edges of the bins of clip lengths, s.
const LENGTH_EDGES_S: [f64; 4] = [2.0, 4.0, 6.0, 8.0];
/// Mistaken actions that are listed.
const MAX_CONFUSIONS: usize = 30;

/// One system on one split.
#[derive(Serialize)]
pub struct System {
    name: &'static str,
    pub what: &'static str,
    pub scores: Scores,
    /// Share of captions that name the right action, 0..1.
    pub right_action: Share,
}

/// The model on a part of the split.
#[derive(Serialize)]
pub struct Slice {
    pub name: String,
    pub clips: usize,
    /// Share of captions that name the right action, 0..1.
    pub right_action: Share,
    /// Mean ROUGE-L of the captions, 0..1.
    pub rouge_l: Share,
}

/// Clips of one action whose captions name another.
#[derive(Serialize)]
pub struct Confusion {
    pub action: String,
    /// What the namer reads in the caption; nothing when it knows no word of it.
    pub named: Option<String>,
    pub clips: usize,
}

/// What report.json says.
#[derive(Serialize)]
pub struct Report {
    pub data: String,
    pub split: String,
    pub model: String,
    pub decoder: &'static str,
    pub protocol: &'static str,
    pub max_references: usize,
    pub clips: usize,
    pub abstained: usize,
    pub train_clips: usize,
    pub beam: usize,
    pub seed: u64,
    pub systems: Vec<System>,
    /// Share of reference captions of this split whose action the namer finds: the ceiling of
    /// `right_action`.
    pub action_namer_on_references: f64,
    /// Clips and share of the model's captions that name the right action, by action.
    pub right_action_by_action: BTreeMap<String, (usize, f64)>,
    /// By length of the clip.
    pub by_length: Vec<Slice>,
    /// By number of actions in the clip, where the label tells (built-in motions).
    pub by_n_actions: Vec<Slice>,
    /// Most frequent first.
    pub confusions: Vec<Confusion>,
    pub parameters: usize,
    /// Size of the model's files.
    pub model_bytes: u64,
    pub seconds: f64,
    pub captions_per_s: f64,
    pub radar_frames_per_s: f64,
    /// Tokens of the written sentences with their end marks, divided by the whole time.
    pub tokens_per_s: f64,
    pub peak_memory_mb: Option<f64>,
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

/// Describes, scores and writes report.json, report.md, report.html and captions.jsonl.
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
        max_references: MAX_REFERENCES,
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
        Ok(System {
            name,
            what,
            scores: score(&candidates, &references, &options)?,
            right_action: share(&right, &units, args.seed)?,
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
    let rouge: Vec<f64> = clips
        .iter()
        .zip(&texts)
        .map(|(clip, text)| rouge_l_of(text, &clip.captions, MAX_REFERENCES))
        .collect();
    let right: Vec<f64> = clips
        .iter()
        .zip(&texts)
        .map(|(clip, text)| f64::from(u8::from(names(text, &clip.action))))
        .collect();
    let slice = |name: String, members: &[usize]| -> CliResult<Slice> {
        let of = |values: &[f64]| members.iter().map(|&i| values[i]).collect::<Vec<f64>>();
        let units = units_of_ids(members.iter().map(|&i| clips[i].id.as_str()));
        Ok(Slice {
            name,
            clips: members.len(),
            right_action: share(&of(&right), &units, args.seed)?,
            rouge_l: share(&of(&rouge), &units, args.seed)?,
        })
    };
    let frame_rate_hz = data.manifest().frame_rate_hz;
    let by_length = groups(&clips, |clip| {
        Some(length_bin(clip.frames.len() as f64 / frame_rate_hz))
    });
    let by_length = by_length
        .iter()
        .map(|(bin, members)| slice(length_name(*bin), members))
        .collect::<CliResult<Vec<_>>>()?;
    let by_n_actions = groups(&clips, n_actions)
        .iter()
        .map(|(n, members)| slice(n.to_string(), members))
        .collect::<CliResult<Vec<_>>>()?;
    let n_frames: usize = clips.iter().map(|c| c.frames.len()).sum();
    let mut n_tokens = 0;
    for text in &texts {
        n_tokens += captioner.vocab().text_ids(text)?.len() + 1;
    }
    let report = Report {
        data: data.manifest().name.clone(),
        split: args.split.clone(),
        model,
        decoder: args.decoder.name(),
        protocol: "plain",
        max_references: MAX_REFERENCES,
        clips: clips.len(),
        abstained: described.iter().filter(|d| d.abstained.is_some()).count(),
        train_clips: train.len(),
        beam: args.beam,
        seed: args.seed,
        systems,
        action_namer_on_references: reference_hits.iter().filter(|h| **h).count() as f64
            / reference_hits.len() as f64,
        right_action_by_action: by_action,
        by_length,
        by_n_actions,
        confusions: confusions(&clips, &texts, &namer),
        parameters: captioner.n_params(),
        model_bytes: ModelFiles::of(args.model.as_deref())?.bytes,
        seconds,
        captions_per_s: clips.len() as f64 / seconds,
        radar_frames_per_s: n_frames as f64 / seconds,
        tokens_per_s: n_tokens as f64 / seconds,
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
    let shown: Vec<eval_page::Shown> = (0..clips.len())
        .map(|i| eval_page::Shown {
            clip: &clips[i],
            description: &described[i],
            nearest: &nearest[i],
            rouge_l: rouge[i],
            named: namer.name(&texts[i]),
        })
        .collect();
    let page = eval_page::html(&report, &shown, frame_rate_hz);
    write(&args.out.join("report.html"), page.as_bytes())?;
    write(
        &args.out.join("report.json"),
        serde_json::to_string_pretty(&report)?.as_bytes(),
    )?;
    Ok(report)
}

fn write(path: &Path, bytes: &[u8]) -> CliResult {
    output::write_atomic(path, bytes)
}

fn share(values: &[f64], units: &[usize], seed: u64) -> CliResult<Share> {
    Share::of(values, units, seed).ok_or_else(|| CliError::new("no captions to judge"))
}

/// Indices of clips by a key; clips without one are left out.
fn groups(
    clips: &[ClipRecord],
    key: impl Fn(&ClipRecord) -> Option<usize>,
) -> BTreeMap<usize, Vec<usize>> {
    let mut groups: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (i, clip) in clips.iter().enumerate() {
        if let Some(key) = key(clip) {
            groups.entry(key).or_default().push(i);
        }
    }
    groups
}

/// Number of the bin of a clip's length.
fn length_bin(seconds: f64) -> usize {
    // A clip of 20 frames at 10 Hz lasts 2 s, whatever the division says.
    LENGTH_EDGES_S
        .iter()
        .filter(|edge| seconds + 1e-9 >= **edge)
        .count()
}

fn length_name(bin: usize) -> String {
    let edge = |i: usize| LENGTH_EDGES_S.get(i).copied();
    match (bin.checked_sub(1).and_then(edge), edge(bin)) {
        (None, Some(high)) => format!("under {high} s"),
        (Some(low), Some(high)) => format!("{low} to {high} s"),
        (Some(low), None) => format!("{low} s and more"),
        (None, None) => "all".into(),
    }
}

/// Actions in a clip: labels of built-in motions are composed with "then" and "while", other sources'
/// labels do not tell.
fn n_actions(clip: &ClipRecord) -> Option<usize> {
    let joined = |word: &str| clip.action.matches(word).count();
    (clip.source == "procedural").then(|| 1 + joined(" then ") + joined(" while "))
}

/// Captions that name another action than the clip's, most frequent first.
fn confusions(clips: &[ClipRecord], texts: &[String], namer: &ActionNamer) -> Vec<Confusion> {
    let mut counts: BTreeMap<(&str, Option<&str>), usize> = BTreeMap::new();
    for (clip, text) in clips.iter().zip(texts) {
        let named = namer.name(text);
        if named != Some(&clip.action) {
            *counts.entry((&clip.action, named)).or_default() += 1;
        }
    }
    let mut confusions: Vec<Confusion> = counts
        .into_iter()
        .map(|((action, named), clips)| Confusion {
            action: action.into(),
            named: named.map(Into::into),
            clips,
        })
        .collect();
    confusions.sort_by_key(|c| std::cmp::Reverse(c.clips));
    confusions.truncate(MAX_CONFUSIONS);
    confusions
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

/// Headings of [`system_row`].
pub const SYSTEM_HEAD: [&str; 8] = [
    "system",
    "BLEU-1",
    "BLEU-4",
    "ROUGE-1",
    "ROUGE-L",
    "METEOR",
    "CIDEr-D",
    "right action",
];

/// A system's values with intervals, x100 but for CIDEr-D.
pub fn system_row(system: &System) -> Vec<String> {
    let s = &system.scores;
    let mut row = vec![system.what.to_string()];
    for (name, value, scale) in [
        ("bleu_1", s.bleu_1, 100.0),
        ("bleu_4", s.bleu_4, 100.0),
        ("rouge_1", s.rouge_1, 100.0),
        ("rouge_l", s.rouge_l, 100.0),
        ("meteor", s.meteor.unwrap_or(f64::NAN), 100.0),
        ("cider_d", s.cider_d, 1.0),
    ] {
        let [low, high] = s.ci95.get(name).copied().unwrap_or([f64::NAN; 2]);
        row.push(with_interval(Share { value, low, high }, scale));
    }
    row.push(with_interval(system.right_action, 100.0));
    row
}

/// A slice's name, clips and values with intervals, x100.
pub fn slice_row(slice: &Slice) -> Vec<String> {
    vec![
        slice.name.clone(),
        slice.clips.to_string(),
        with_interval(slice.right_action, 100.0),
        with_interval(slice.rouge_l, 100.0),
    ]
}

fn with_interval(share: Share, scale: f64) -> String {
    let digits = if scale == 1.0 { 3 } else { 1 };
    let [value, low, high] = [share.value, share.low, share.high].map(|v| v * scale);
    format!("{value:.digits$} [{low:.digits$}, {high:.digits$}]")
}

/// What was evaluated on what.
pub fn model_line(report: &Report) -> String {
    format!(
        "Model {}: {:.2} M parameters, {:.2} MB on disk, decoder {}, beam {}. {} clips, {} of them without a sentence (too \
         few points or frames); floors from {} training clips.",
        report.model,
        report.parameters as f64 / 1e6,
        report.model_bytes as f64 / 1e6,
        report.decoder,
        report.beam,
        report.clips,
        report.abstained,
        report.train_clips
    )
}

fn markdown(report: &Report) -> CliResult<String> {
    let mut text = String::new();
    writeln!(
        text,
        "# Captions of `{}`, split `{}`\n",
        report.data, report.split
    )?;
    writeln!(text, "{}", model_line(report))?;
    writeln!(
        text,
        "Protocol `{}`, at most {} references. Values x100 (CIDEr-D in its own scale), 95 % bootstrap intervals over motions.\n",
        report.protocol, report.max_references
    )?;
    writeln!(text, "| {} |", SYSTEM_HEAD.join(" | "))?;
    writeln!(text, "|{}", "---|".repeat(SYSTEM_HEAD.len()))?;
    for system in &report.systems {
        writeln!(text, "| {} |", system_row(system).join(" | "))?;
    }
    writeln!(
        text,
        "\nThe action namer (naive Bayes on training captions) is right on {:.1} % of this split's own references.",
        report.action_namer_on_references * 100.0
    )?;
    for (title, slices) in [
        ("clip length", &report.by_length),
        ("actions in the clip", &report.by_n_actions),
    ] {
        if slices.is_empty() {
            continue;
        }
        writeln!(
            text,
            "\n| {title} | clips | right action % | ROUGE-L |\n|---|---|---|---|"
        )?;
        for slice in slices {
            writeln!(text, "| {} |", slice_row(slice).join(" | "))?;
        }
    }
    writeln!(text, "\n| action | clips | right action % |\n|---|---|---|")?;
    for (action, (count, share)) in &report.right_action_by_action {
        writeln!(text, "| {action} | {count} | {:.0} |", share * 100.0)?;
    }
    if !report.confusions.is_empty() {
        writeln!(
            text,
            "\n| action | the caption names | clips |\n|---|---|---|"
        )?;
        for confusion in &report.confusions {
            let named = confusion.named.as_deref().unwrap_or("nothing known");
            writeln!(
                text,
                "| {} | {named} | {} |",
                confusion.action, confusion.clips
            )?;
        }
    }
    writeln!(
        text,
        "\nSpeed on this machine: {:.1} captions/s, {:.0} radar frames/s, {:.0} tokens/s (tokenizer and language model, beam {}).",
        report.captions_per_s, report.radar_frames_per_s, report.tokens_per_s, report.beam
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

#[cfg(test)]
mod tests {
    use super::*;

    fn clip(action: &str, source: &str) -> ClipRecord {
        ClipRecord {
            id: "m#0".into(),
            motion_id: "m".into(),
            group: "m".into(),
            split: Split::Test,
            action: action.into(),
            captions: vec!["a person moves".into()],
            source: source.into(),
            radar: "awr1843boost".into(),
            radar_height_m: 1.0,
            seed: 1,
            frames: Vec::new(),
            motion_fps: 20.0,
            joints: Vec::new(),
            motion_features: Vec::new(),
        }
    }

    #[test]
    fn lengths_fall_into_their_bins() {
        let name = |seconds: f64| length_name(length_bin(seconds));
        assert_eq!(name(0.0), "under 2 s");
        assert_eq!(name(1.99), "under 2 s");
        assert_eq!(name(20.0 / 10.0), "2 to 4 s");
        // 60 frames at a rate that is no exact tenth of a second.
        assert_eq!(name(60.0 * 0.1_f32 as f64), "6 to 8 s");
        assert_eq!(name(9.6), "8 s and more");
    }

    #[test]
    fn actions_are_counted_where_the_label_tells() {
        let n = |action: &str, source: &str| n_actions(&clip(action, source));
        assert_eq!(n("walk", "procedural"), Some(1));
        assert_eq!(n("walk then sit_down", "procedural"), Some(2));
        assert_eq!(n("march while clap then bow", "procedural"), Some(3));
        assert_eq!(n("walk then sit", "bandai-namco"), None);
    }

    #[test]
    fn confusions_leave_out_what_is_right() {
        let namer =
            ActionNamer::fit(&[("a person walks", "walk"), ("a person sits", "sit")]).unwrap();
        let clips = ["walk", "sit", "sit", "walk"].map(|action| clip(action, "procedural"));
        let texts = ["walks", "walks", "walks", "zebra"].map(String::from);
        let found = confusions(&clips, &texts, &namer);
        let rows: Vec<_> = found
            .iter()
            .map(|c| (c.action.as_str(), c.named.as_deref(), c.clips))
            .collect();
        assert_eq!(rows, [("sit", Some("walk"), 2), ("walk", None, 1)]);
    }
}
