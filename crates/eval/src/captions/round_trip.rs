//! Does a model describe what it generated?
//!
//! Radar points are generated from sentences of a data set and described by the same model. A description that agrees
//! with its sentence more than descriptions of other sentences do, shows that the points contain what the sentence says.
//! The captions of the nearest training clips show the same without the model's own reading.
//! The model's descriptions of the data set's own radar of the same motions show what agreement can be expected.

use radarllm_base::{Clip, PointFrame, random::SplitMix64};
use radarllm_dataset::{ClipRecord, Columns, Dataset, Split};
use radarllm_inference::{Captioner, Description, FRAME_RATE_HZ, tokenizer::FRAMES_PER_CODE};
use radarllm_metrics::{
    Candidate, Reference, ScoreOptions, Scores, bootstrap::units_of_ids, score,
};
use serde::Serialize;

use crate::{
    Estimate, EvalError,
    baselines::shuffled_assignment,
    captioner::caption_clips,
    captions::{
        MAX_REFERENCES,
        facts::{FactCounts, same_actions},
        nearest_captions, read, take_clip,
    },
    table::Table,
};

/// Sentences that are generated from, and how.
#[derive(Clone, Debug)]
pub struct RoundTripOptions {
    /// Split whose sentences are used.
    pub split: Split,
    /// Number of sentences, drawn at random: the first caption of each motion.
    pub count: usize,
    /// As [`DescribeOptions::beam`](radarllm_inference::DescribeOptions::beam); codes are generated greedily without it.
    pub beam: Option<usize>,
    /// Seed of the draw, of the shuffling and of the bootstrap.
    pub seed: u64,
}

/// Descriptions of the same sentences by one system.
#[derive(Clone, Debug, Serialize)]
pub struct RoundTripSystem {
    /// `generated`, `shuffled`, `nearest` or `data`.
    pub name: &'static str,
    /// What it is, in words.
    pub what: &'static str,
    /// Caption metrics; the references are the captions of the motion, of which the first was generated from.
    pub scores: Scores,
    /// Facts of the descriptions that the captions state, and those that they do not.
    pub facts: FactCounts,
    /// Share of descriptions that state exactly the actions of the sentence, in order, 0..=1.
    pub same_actions: Estimate,
}

/// A sentence, and what was described of it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RoundTripLine {
    /// Name of the clip whose caption it is.
    pub id: String,
    /// The sentence.
    pub sentence: String,
    /// Radar codes that were generated from it.
    pub codes: Vec<u32>,
    /// Mean number of points in a generated frame.
    pub points_per_frame: f64,
    /// Description of the generated points.
    pub described: String,
    /// Description of the data set's radar of the same motion.
    pub described_data: String,
}

/// Round trips of a model.
#[derive(Clone, Debug, Serialize)]
pub struct RoundTripReport {
    /// Name of the data set.
    pub data: String,
    /// Name of the split.
    pub split: String,
    /// Name of the model.
    pub model: String,
    /// Sentences that were generated from.
    pub sentences: usize,
    /// Sentences for which the model generated no radar code. Their clips have no points.
    pub empty: usize,
    /// Generated clips in which the model sees no person, with those of `empty`.
    pub abstained: usize,
    /// Mean length of the generated clips, s.
    pub mean_seconds: f64,
    /// Seed of the draw, of the shuffling and of the bootstrap.
    pub seed: u64,
    /// Generated radar, shuffled, the nearest training clips, the data set's radar.
    pub systems: Vec<RoundTripSystem>,
}

/// Generates radar from sentences of a data set and describes it. `points` makes a clip of the codes of a sentence.
///
/// # Errors
/// A data set that cannot be read, has no training clips or fewer than two motions in the split; a model that was not trained to generate;
/// errors of `points`.
pub fn evaluate_round_trip(
    captioner: &Captioner,
    model: &str,
    points: impl Fn(&[u32], &str) -> Result<Clip, EvalError>,
    data: &Dataset,
    options: &RoundTripOptions,
) -> Result<(RoundTripReport, Vec<RoundTripLine>), EvalError> {
    let RoundTripOptions {
        split,
        count,
        beam,
        seed,
    } = *options;
    let mut records = drawn(data, split, count, seed)?;
    if records.len() < 2 {
        return Err(EvalError::Empty(format!(
            "{}: {} motions with a caption in split `{split}`, at least 2 are needed",
            data.dir().display(),
            records.len()
        )));
    }
    let recorded: Vec<Clip> = records
        .iter_mut()
        .map(|r| take_clip(r, f64::from(FRAME_RATE_HZ)))
        .collect();
    let sentences: Vec<&str> = records.iter().map(|r| r.captions[0].as_str()).collect();
    let codes = captioner.codes_of_sentences(&sentences, beam.unwrap_or(1))?;
    let generated = codes.iter().zip(&sentences).zip(&recorded);
    let generated = generated.map(|((codes, sentence), recorded)| match codes.is_empty() {
        true => Ok(without_points(recorded)),
        false => points(codes, sentence),
    });
    let generated = generated.collect::<Result<Vec<Clip>, _>>()?;
    let describe = |clips: &[Clip]| -> Result<Vec<Description>, EvalError> {
        caption_clips(captioner, &clips.iter().collect::<Vec<_>>(), beam)
    };
    let described = describe(&generated)?;
    let of_data = describe(&recorded)?;
    let order = shuffled_assignment(records.len(), seed)
        .ok_or_else(|| EvalError::Empty("a single sentence cannot be shuffled".into()))?;
    let text = |d: &Description| d.caption.clone();
    let own: Vec<String> = described.iter().map(text).collect();
    let shuffled: Vec<String> = order.iter().map(|i| own[*i].clone()).collect();
    let data_texts: Vec<String> = of_data.iter().map(text).collect();
    let train = read(data, Split::Train)?;
    if train.is_empty() {
        return Err(EvalError::Empty(format!(
            "{}: no clips in split `train`, whose nearest ones are compared",
            data.dir().display()
        )));
    }
    let clips = generated
        .iter()
        .map(|clip| (clip.frames.as_slice(), clip.radar_height_m));
    let nearest = nearest_captions(&train, clips)?;
    let systems = vec![
        system(
            "generated",
            "the model on radar that it generated from the sentence",
            &records,
            &own,
            seed,
        )?,
        system(
            "shuffled",
            "baseline: the model on radar that it generated from another sentence",
            &records,
            &shuffled,
            seed,
        )?,
        system(
            "nearest",
            "a caption of the training clip that is nearest to the generated radar",
            &records,
            &nearest,
            seed,
        )?,
        system(
            "data",
            "for comparison: the model on the data set's radar of the motion",
            &records,
            &data_texts,
            seed,
        )?,
    ];
    let n = records.len() as f64;
    let report = RoundTripReport {
        data: data.manifest().name.clone(),
        split: split.to_string(),
        model: model.into(),
        sentences: records.len(),
        empty: codes.iter().filter(|codes| codes.is_empty()).count(),
        abstained: described.iter().filter(|d| d.abstained.is_some()).count(),
        mean_seconds: generated.iter().map(Clip::duration_s).sum::<f64>() / n,
        seed,
        systems,
    };
    let n_points = |clip: &Clip| {
        let n: usize = clip.frames.iter().map(|f| f.points.len()).sum();
        n as f64 / clip.frames.len().max(1) as f64
    };
    let lines = records
        .into_iter()
        .enumerate()
        .map(|(i, record)| RoundTripLine {
            id: record.id,
            sentence: record.captions.into_iter().next().unwrap_or_default(),
            codes: codes[i].clone(),
            points_per_frame: n_points(&generated[i]),
            described: own[i].clone(),
            described_data: data_texts[i].clone(),
        });
    Ok((report, lines.collect()))
}

/// The time of one radar code without any point, before the radar of a clip.
fn without_points(recorded: &Clip) -> Clip {
    let frame = |i: u32| PointFrame {
        frame: i,
        time_s: f64::from(i) / f64::from(FRAME_RATE_HZ),
        points: Vec::new(),
        board: None,
    };
    Clip {
        frames: (0..FRAMES_PER_CODE as u32).map(frame).collect(),
        ..recorded.clone()
    }
}

/// One clip of each of at most `count` motions, drawn at random, in the order of the data set.
fn drawn(
    data: &Dataset,
    split: Split,
    count: usize,
    seed: u64,
) -> Result<Vec<ClipRecord>, EvalError> {
    let mut records = Vec::<ClipRecord>::new();
    let mut seen = std::collections::BTreeSet::new();
    for record in data.iter_split(split, Columns::Points) {
        let record = record?;
        if !record.captions.is_empty() && seen.insert(record.motion_id.clone()) {
            records.push(record);
        }
    }
    let mut order: Vec<usize> = (0..records.len()).collect();
    let mut rng = SplitMix64::new(seed);
    for i in (1..order.len()).rev() {
        order.swap(i, rng.below(i + 1));
    }
    let mut is_drawn = vec![false; records.len()];
    order.iter().take(count).for_each(|i| is_drawn[*i] = true);
    let mut is_drawn = is_drawn.into_iter();
    records.retain(|_| is_drawn.next() == Some(true));
    Ok(records)
}

fn system(
    name: &'static str,
    what: &'static str,
    records: &[ClipRecord],
    texts: &[String],
    seed: u64,
) -> Result<RoundTripSystem, EvalError> {
    let ids = records.iter().map(|r| &r.id);
    let candidates: Vec<Candidate> = ids
        .zip(texts)
        .map(|(id, text)| Candidate {
            id: id.clone(),
            text: text.clone(),
        })
        .collect();
    let references: Vec<Reference> = records
        .iter()
        .map(|r| Reference {
            id: r.id.clone(),
            texts: r.captions.clone(),
        })
        .collect();
    let options = ScoreOptions {
        seed,
        max_references: MAX_REFERENCES,
        ..ScoreOptions::default()
    };
    let same: Vec<f64> = texts
        .iter()
        .zip(records)
        .map(|(text, record)| same_actions(text, &record.captions[..1]))
        .collect();
    let units = units_of_ids(records.iter().map(|r| r.id.as_str()));
    Ok(RoundTripSystem {
        name,
        what,
        scores: score(&candidates, &references, &options)?,
        facts: FactCounts::of(
            texts
                .iter()
                .zip(records)
                .map(|(text, record)| (text.as_str(), &record.captions[..])),
        ),
        same_actions: Estimate::of_mean(&same, &units, seed)
            .ok_or_else(|| EvalError::Empty("no descriptions to score".into()))?,
    })
}

/// Number of sentences that the Markdown report shows.
const N_SHOWN: usize = 20;

/// The report as Markdown, with the first sentences.
pub fn markdown(report: &RoundTripReport, lines: &[RoundTripLine]) -> String {
    let mut scores = Table::new(
        "Scores",
        format!(
            "Protocol plain, at max {MAX_REFERENCES} captions of the motion as references. Values are multiplied by 100, \
             except CIDEr-D and contradictions; 95 % bootstrap intervals over motions, seed {}. Facts by the parser; \
             \"same actions\" is the share of descriptions that state exactly the actions of the sentence, in order.",
            report.seed
        ),
        &[
            "system",
            "BLEU-1",
            "BLEU-4",
            "ROUGE-L",
            "METEOR",
            "CIDEr-D",
            "same actions",
            "facts F1",
            "contradictions",
        ],
    );
    for system in &report.systems {
        let s = &system.scores;
        let mut row = vec![system.what.to_string()];
        row.extend(Estimate::cells(
            s,
            &["bleu_1", "bleu_4", "rouge_l", "meteor", "cider_d"],
        ));
        row.push(system.same_actions.to_text(100.0, 1));
        let f1 = system.facts.all.f1().map(|f1| format!("{:.1}", f1 * 100.0));
        row.push(f1.unwrap_or_default());
        row.push(system.facts.contradictions.to_string());
        scores.rows.push(row);
    }
    let mut shown = Table::new(
        "Sentences",
        format!(
            "{} of {}, in the order of the data set.",
            lines.len().min(N_SHOWN),
            lines.len()
        ),
        &[
            "sentence",
            "described",
            "described from the data set's radar",
            "points/frame",
        ],
    );
    shown.rows = lines
        .iter()
        .take(N_SHOWN)
        .map(|line| {
            let cell = |text: &str| text.replace('|', "\\|");
            vec![
                cell(&line.sentence),
                cell(&line.described),
                cell(&line.described_data),
                format!("{:.1}", line.points_per_frame),
            ]
        })
        .collect();
    let mut text = format!(
        "# Round trips of `{}`, split `{}`\n\nModel {}: radar was generated from {} sentences and described. The generated \
         clips are {:.1} s long on average; in {} of them the model sees no person, {} of which have no radar code.\n",
        report.data,
        report.split,
        report.model,
        report.sentences,
        report.mean_seconds,
        report.abstained,
        report.empty
    );
    for table in [scores, shown] {
        text += &format!(
            "\n## {}\n\n{}\n\n{}",
            table.title,
            table.about,
            table.to_markdown()
        );
    }
    text
}
