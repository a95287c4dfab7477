//! Captions of one row of a comparison.

use std::{path::Path, time::Instant};

use radarllm_dataset::ClipRecord;
use radarllm_eval::{
    captions::{captions_of, nearest_captions},
    comparison::{Cost, RowCaptions, RowKind},
};
use radarllm_files::bounded::{self as files, MAX_CONFIG_BYTES};
use radarllm_inference::lm::GenerateOptions;
use radarllm_nn::{lm::RadarLm, params::n_params, pose::PoseEstimator};
use radarllm_train::{
    harness::cpu_device,
    motion,
    motion_codes::{estimated_features, motion_codes},
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
    Ok(seconds / 60.0)
}

/// Captions of a model on radar codes.
pub(super) fn of_radar(run: &Run, clips: &[ClipRecord]) -> CliResult<RowCaptions> {
    run.assemble()?;
    let model = model::open(Some(&run.recipe.model_dir()), DecoderName::F32)?;
    let started = Instant::now();
    let texts = captions_of(model.networks(), clips, Some(1))?;
    Ok(RowCaptions {
        texts: Ok(texts),
        cost: Cost {
            parameters: Some(model.networks().n_params()),
            training_minutes: Some(training_minutes(run, &run.stages)?),
            clips_per_s: Some(clips.len() as f64 / started.elapsed().as_secs_f64()),
        },
    })
}

/// Captions of a model on codes of motions: of the true ones, or of those that `pose` estimates from the points.
pub(super) fn of_motion(
    run: &Run,
    pose: Option<&Run>,
    clips: &[ClipRecord],
) -> CliResult<RowCaptions> {
    let last = *run.stages.last().unwrap_or(&RecipeStage::Instruct);
    let lm = RadarLm::load(&run.recipe.result(last)?, &cpu_device())?;
    let teacher = motion::load_teacher(&run.recipe.result(RecipeStage::Motion)?)?;
    let estimator = match pose {
        Some(pose) => Some(PoseEstimator::load(
            &pose.recipe.result(RecipeStage::Pose)?,
        )?),
        None => None,
    };
    let started = Instant::now();
    let mut texts = Vec::with_capacity(clips.len());
    for batch in clips.chunks(BATCH) {
        let mut prompts = Vec::with_capacity(batch.len());
        for clip in batch {
            let problem = |e: String| CliError::new(format!("clip {}: {e}", clip.id));
            let estimated;
            let features = match &estimator {
                Some(estimator) => {
                    estimated = estimated_features(estimator, clip).map_err(problem)?;
                    &estimated
                }
                None => &clip.motion_features,
            };
            let codes = motion_codes(&teacher, features).map_err(problem)?;
            prompts.push(lm.describe_prompt(&codes)?);
        }
        let written = lm.generate(&prompts, &GenerateOptions::default())?;
        texts.extend(written.iter().map(|w| lm.vocab.text(&w.ids)));
    }
    let mut stages = run.stages.clone();
    let mut minutes = training_minutes(run, &stages)?;
    if let Some(pose) = pose.filter(|_| !stages.contains(&RecipeStage::Pose)) {
        stages = vec![RecipeStage::Pose];
        minutes += training_minutes(pose, &stages)?;
    }
    let of_pose = estimator.as_ref().map_or(0, PoseEstimator::n_params);
    Ok(RowCaptions {
        texts: Ok(texts),
        cost: Cost {
            parameters: Some(n_params(&lm.net) + teacher.n_encoder_params() + of_pose),
            training_minutes: Some(minutes),
            clips_per_s: Some(clips.len() as f64 / started.elapsed().as_secs_f64()),
        },
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
        other => return Err(CliError::new(format!("{other:?}: not a floor"))),
    };
    let needs_no_points = matches!(kind, RowKind::Shuffled | RowKind::Majority);
    let clips_per_s = clips.len() as f64 / started.elapsed().as_secs_f64();
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
