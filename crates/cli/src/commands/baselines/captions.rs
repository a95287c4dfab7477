//! Captions of one row of a comparison.

use std::{path::Path, time::Instant};

use radarllm::Model;
use radarllm_dataset::ClipRecord;
use radarllm_eval::{
    captions::{captions_of, nearest_captions},
    comparison::{Cost, Embedded, RowCaptions, RowKind},
    floors,
};
use radarllm_files::bounded::{self as files, MAX_CONFIG_BYTES};
use radarllm_inference::{lm::GenerateOptions, tokenizer::Encoded};
use radarllm_nn::{
    lm::RadarLm, motion_vqvae::MotionTeacher, params::n_params, pose::PoseEstimator,
};
use radarllm_train::{
    harness::cpu_device,
    lm::retrieval::{embed_codes, embed_texts},
    motion,
    motion_codes::{estimated_features, motion_codes},
    pictures::pictures,
    recipe::RecipeStage,
};

use crate::{
    commands::trainings::Run,
    error::{CliError, CliResult},
    model,
    model_args::DecoderName,
};

/// Motions that are described at once.
const BATCH: usize = 32;

/// Minutes that the stages of a training took, from their logs.
pub(super) fn training_minutes(run: &Run, stages: &[RecipeStage]) -> CliResult<f64> {
    let mut seconds = 0.0;
    for &stage in stages {
        let log = run.recipe.stage_dir(stage).join("log.jsonl");
        let text = files::read_text(&log, MAX_CONFIG_BYTES)?;
        let of_line = |line: &str| {
            let line: serde_json::Value = serde_json::from_str(line).ok()?;
            line["seconds"].as_f64()
        };
        seconds += text.lines().rev().find_map(of_line).unwrap_or(0.0);
    }
    Ok(three_digits(seconds / 60.0))
}

/// Clips for each second since `started`.
fn per_second(clips: usize, started: Instant) -> f64 {
    three_digits(clips as f64 / started.elapsed().as_secs_f64())
}

/// Rounded to three digits after the point, so that a value read from a file is the one that was written.
fn three_digits(value: f64) -> f64 {
    (value * 1000.0).round() / 1000.0
}

/// Captions of a model on radar codes.
pub(super) fn of_radar(run: &Run, clips: &[ClipRecord]) -> CliResult<RowCaptions> {
    run.assemble()?;
    let model = model::open(Some(&run.recipe.model_dir()), DecoderName::F32)?;
    let started = Instant::now();
    let texts = captions_of(model.networks()?, clips, Some(1))?;
    Ok(RowCaptions {
        texts: Ok(texts),
        cost: Cost {
            parameters: Some(model.networks()?.n_params()),
            training_minutes: Some(training_minutes(run, &run.stages)?),
            clips_per_s: Some(per_second(clips.len(), started)),
        },
    })
}

/// Captions of a finished model, by a vote.
pub(super) fn of_model(model: &Model, clips: &[ClipRecord]) -> CliResult<RowCaptions> {
    let started = Instant::now();
    let texts = captions_of(model.networks()?, clips, None)?;
    Ok(RowCaptions {
        texts: Ok(texts),
        cost: Cost {
            parameters: Some(model.networks()?.n_params()),
            training_minutes: None,
            clips_per_s: Some(per_second(clips.len(), started)),
        },
    })
}

/// What a language model without radar codes reads.
#[derive(Clone, Copy)]
pub(super) enum Read<'a> {
    /// Codes of the motion that the pose network of a training estimates from the points.
    EstimatedMotion(&'a Run),
    /// Codes of the true motion.
    TrueMotion,
    /// Pictures of range, velocity and azimuth over time.
    Pictures,
}

/// Encodes what a language model reads of a clip.
struct Reader {
    /// Of motions.
    teacher: Option<MotionTeacher>,
    estimator: Option<PoseEstimator>,
}

impl Reader {
    fn open(run: &Run, read: Read) -> CliResult<Self> {
        let teacher = match read {
            Read::Pictures => None,
            _ => Some(motion::load_teacher(
                &run.recipe.result(RecipeStage::Motion)?,
            )?),
        };
        let estimator = match read {
            Read::EstimatedMotion(pose) => Some(PoseEstimator::load(
                &pose.recipe.result(RecipeStage::Pose)?,
            )?),
            _ => None,
        };
        Ok(Self { teacher, estimator })
    }

    fn encode(&self, clip: &ClipRecord) -> Result<Encoded, String> {
        let Some(teacher) = &self.teacher else {
            return Ok(pictures(&clip.frames));
        };
        match &self.estimator {
            Some(estimator) => motion_codes(teacher, &estimated_features(estimator, clip)?),
            None => motion_codes(teacher, &clip.motion_features),
        }
    }

    fn n_params(&self) -> usize {
        let of_teacher = self
            .teacher
            .as_ref()
            .map_or(0, MotionTeacher::n_encoder_params);
        of_teacher + self.estimator.as_ref().map_or(0, PoseEstimator::n_params)
    }
}

/// Captions of a language model that reads something else than radar codes.
pub(super) fn of_codes(run: &Run, read: Read, clips: &[ClipRecord]) -> CliResult<RowCaptions> {
    let last = *run.stages.last().unwrap_or(&RecipeStage::Instruct);
    let lm = RadarLm::load(&run.recipe.result(last)?, &cpu_device())?;
    let reader = Reader::open(run, read)?;
    let started = Instant::now();
    let mut texts = Vec::with_capacity(clips.len());
    for batch in clips.chunks(BATCH) {
        let mut prompts = Vec::with_capacity(batch.len());
        for clip in batch {
            let codes = reader.encode(clip);
            let codes = codes.map_err(|e| CliError::new(format!("clip {}: {e}", clip.id)))?;
            prompts.push(lm.describe_prompt(&codes)?);
        }
        let written = lm.generate(&prompts, &GenerateOptions::default())?;
        texts.extend(written.iter().map(|w| lm.vocab.text(&w.ids)));
    }
    let clips_per_s = per_second(clips.len(), started);
    let mut minutes = training_minutes(run, &run.stages)?;
    if let Read::EstimatedMotion(pose) = read
        && !run.stages.contains(&RecipeStage::Pose)
    {
        minutes = three_digits(minutes + training_minutes(pose, &[RecipeStage::Pose])?);
    }
    Ok(RowCaptions {
        texts: Ok(texts),
        cost: Cost {
            parameters: Some(n_params(&lm.net) + reader.n_params()),
            training_minutes: Some(minutes),
            clips_per_s: Some(clips_per_s),
        },
    })
}

/// True motions and the captions of all rows, embedded by the encoder of a language model on true motions.
pub(super) fn embedded(
    name: &str,
    run: &Run,
    clips: &[ClipRecord],
    rows: &[RowCaptions],
) -> CliResult<Embedded> {
    let last = *run.stages.last().unwrap_or(&RecipeStage::Instruct);
    let lm = RadarLm::load(&run.recipe.result(last)?, &cpu_device())?;
    let reader = Reader::open(run, Read::TrueMotion)?;
    let codes = clips
        .iter()
        .map(|clip| {
            let problem = |e: String| CliError::new(format!("clip {}: {e}", clip.id));
            reader.encode(clip).map_err(problem)
        })
        .collect::<CliResult<Vec<_>>>()?;
    let references: Vec<&str> = clips
        .iter()
        .map(|clip| clip.captions.first().map_or("", String::as_str))
        .collect();
    let of_row = |row: &RowCaptions| -> CliResult<Option<Vec<Vec<f32>>>> {
        match &row.texts {
            Ok(texts) => Ok(Some(embed_texts(&lm, texts)?)),
            Err(_) => Ok(None),
        }
    };
    Ok(Embedded {
        by: name.into(),
        motions: embed_codes(&lm, &codes)?,
        references: embed_texts(&lm, &references)?,
        rows: rows.iter().map(of_row).collect::<CliResult<_>>()?,
    })
}

/// Captions of a floor.
pub(super) fn of_floor(
    kind: RowKind,
    clips: &[ClipRecord],
    train: &[ClipRecord],
    ours: &[String],
    seed: u64,
) -> CliResult<RowCaptions> {
    use radarllm_eval::baselines::{majority_caption, shuffled_assignment};
    let started = Instant::now();
    let texts = match kind {
        RowKind::Shuffled => {
            let order = shuffled_assignment(ours.len(), seed)
                .ok_or_else(|| CliError::new("a single clip cannot be shuffled"))?;
            order.iter().map(|&i| ours[i].clone()).collect()
        }
        RowKind::Majority => {
            let all = train.iter().flat_map(|c| &c.captions).map(String::as_str);
            let majority = majority_caption(&all.collect::<Vec<_>>()).unwrap_or_default();
            vec![majority.to_string(); clips.len()]
        }
        RowKind::Nearest => {
            let clips = clips
                .iter()
                .map(|r| (r.frames.as_slice(), r.radar_height_m));
            nearest_captions(train, clips)?
        }
        RowKind::Dtw => floors::warped_captions(train, clips, 1)?,
        RowKind::DtwMedoid => floors::warped_captions(train, clips, 5)?,
        RowKind::Classifier => floors::classified_captions(train, clips, seed)?.0,
        RowKind::Facts => floors::measured_captions(clips, seed),
        RowKind::WindowFacts => floors::window_facts_captions(train, clips, seed)?,
        RowKind::ForestFacts => floors::forest_facts_captions(train, clips, seed)?,
        other => return Err(CliError::new(format!("{other:?}: not a floor"))),
    };
    let needs_no_points = matches!(kind, RowKind::Shuffled | RowKind::Majority);
    let clips_per_s = per_second(clips.len(), started);
    Ok(RowCaptions {
        texts: Ok(texts),
        cost: Cost {
            clips_per_s: (!needs_no_points).then_some(clips_per_s),
            ..Cost::default()
        },
    })
}

/// Captions that `baselines answers` wrote.
pub(super) fn of_answers(
    path: &Path,
    reason: Option<&str>,
    clips: &[ClipRecord],
) -> CliResult<RowCaptions> {
    let cost = Cost::default();
    if !path.is_file() {
        let reason = reason
            .unwrap_or("needs answers of a video language model")
            .to_string();
        return Ok(RowCaptions {
            texts: Err(reason),
            cost,
        });
    }
    let lines = super::run::read_lines(path)?;
    let texts = super::run::in_order(path, lines, clips)?;
    Ok(RowCaptions {
        texts: Ok(texts),
        cost,
    })
}
