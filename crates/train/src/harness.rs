//! The training loop that every stage shares.
//!
//! A stage says what a batch is and what its loss is ([`Stage`]); [`run`] does the rest: warm-up and
//! cosine, AdamW, clipping, logs, validation, checkpoints, resuming, time budget, NaN guard.
//!
//! Output directory:
//!
//! | name | holds |
//! |---|---|
//! | `log.jsonl` | one JSON object per logged step and per validation |
//! | `events.out.tfevents.radarllm` | the same numbers for TensorBoard |
//! | `step-00001234/` | checkpoint to resume from: weights, moments, counters, stage state |
//! | `best/` | weights with the lowest validation score, for inference |
//! | `final/` | weights at the end of the run, for inference |
//!
//! Every random choice is drawn from a seed derived from (run seed, epoch or step), so a resumed run
//! continues bit for bit as if it had never stopped, on any number of CPU threads.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use burn::module::{Module, ModuleMapper, Param};
use burn::tensor::{Device, Tensor};
use radarllm_base::seed::derive_seed;
use radarllm_inference::checkpoint::{
    CONFIG_FILE, Checkpoint, CheckpointFiles, MODEL_FILE, NamedTensors,
};
use radarllm_nn::device::Processor;
use radarllm_nn::params::{collect_params, load_model, param_shapes, replace_params};
use radarllm_nn::tokenizer::codebook::EmaCodebook;
use serde::{Deserialize, Serialize};

use crate::adamw::{AdamW, GradientSum, ParamRule};
pub use crate::error::TrainError;
use crate::log::{Log, json_number};
pub use crate::loop_config::{LoopConfig, Schedule, print_config, read_config};
use crate::loss_scale::LossScale;
pub use crate::stop::StopToken;

/// Loss of one batch.
pub struct StepLoss {
    /// Scalar to minimise, shape `[1]`, tracked.
    pub total: Tensor<1>,
    /// Named parts for the log, already numbers.
    pub parts: Vec<(&'static str, f64)>,
}

/// Where the run stands; a stage may use it for schedules of its own.
#[derive(Clone, Copy, Debug)]
pub struct StepInfo {
    /// Updates done.
    pub step: u64,
    /// Epoch, from 0.
    pub epoch: u64,
    /// Share of the run behind this batch, 0..=1.
    pub progress: f64,
    /// Seed for this batch's random choices.
    pub seed: u64,
}

/// Result of a validation.
pub struct Validation {
    /// Lower is better; the best checkpoint has the lowest.
    pub score: f64,
    /// Named values for the log.
    pub values: Vec<(&'static str, f64)>,
}

/// What one kind of training has to say.
pub trait Stage {
    /// The trained network; lives on an autodiff device.
    type Model: Module;

    /// Name in logs.
    fn name(&self) -> &'static str;

    /// Batches of an epoch as item numbers: a function of `epoch_seed` alone, at least one batch,
    /// and the same count every epoch.
    fn plan_epoch(&self, epoch_seed: u64) -> Vec<Vec<usize>>;

    /// Ids of a batch, for error messages.
    fn ids(&self, batch: &[usize]) -> Vec<String>;

    /// Forward pass and loss of one batch.
    ///
    /// # Errors
    /// If the batch cannot be used.
    fn loss(
        &mut self,
        model: &Self::Model,
        batch: &[usize],
        info: StepInfo,
    ) -> Result<StepLoss, TrainError>;

    /// Called after every update; codebooks kept by moving averages change here.
    ///
    /// # Errors
    /// If the stage cannot go on.
    fn after_step(
        &mut self,
        model: Self::Model,
        _info: StepInfo,
    ) -> Result<Self::Model, TrainError> {
        Ok(model)
    }

    /// Score on the validation data; `model` is off autodiff.
    ///
    /// # Errors
    /// If the data cannot be used.
    fn validate(&mut self, model: &Self::Model) -> Result<Validation, TrainError>;

    /// How a parameter is updated.
    fn rule(&self, _path: &str, shape: &[usize]) -> ParamRule {
        ParamRule::by_shape(shape)
    }

    /// `config.json` of the checkpoints: all that inference needs to rebuild the network.
    fn config(&self) -> serde_json::Value;

    /// Whether small gradients vanish in the stage's precision.
    fn needs_loss_scale(&self) -> bool {
        false
    }

    /// Whether a parameter is trained; the others are frozen.
    fn is_trained(&self, _path: &str) -> bool {
        true
    }

    /// The weights that inference uses, where they are not those of the last update.
    fn for_inference(&self, model: &Self::Model) -> Self::Model {
        model.clone()
    }

    /// Adds the weights to a checkpoint.
    ///
    /// # Errors
    /// If they cannot be encoded.
    fn add_weights(
        &self,
        model: &Self::Model,
        files: &mut CheckpointFiles,
    ) -> Result<(), TrainError> {
        Ok(files.tensors(MODEL_FILE, &collect_params(model))?)
    }

    /// Takes back what [`Self::add_weights`] added.
    ///
    /// # Errors
    /// If it does not fit.
    fn load_weights(
        &self,
        model: Self::Model,
        checkpoint: &Checkpoint,
    ) -> Result<Self::Model, TrainError> {
        Ok(load_model(checkpoint, model)?)
    }

    /// Further files for inference checkpoints (vocabularies, tensors).
    ///
    /// # Errors
    /// If they cannot be made.
    fn add_files(&self, _files: &mut CheckpointFiles) -> Result<(), TrainError> {
        Ok(())
    }

    /// State outside the weights that resuming needs.
    fn state(&self) -> NamedTensors {
        NamedTensors::new()
    }

    /// Takes back what [`Self::state`] gave.
    ///
    /// # Errors
    /// If it does not fit.
    fn load_state(&mut self, _state: NamedTensors) -> Result<(), TrainError> {
        Ok(())
    }
}

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Ending {
    /// All steps done.
    Done,
    /// The time budget is used up.
    TimeUp,
    /// Validations have long found nothing better.
    NoBetter,
    /// [`LoopConfig::stop`] asked for it. The run is not finished; it can be resumed.
    Stopped,
}

/// Result of a run.
#[derive(Debug)]
pub struct Outcome<M> {
    /// Network after the last update, on the autodiff device.
    pub model: M,
    /// Why it ended.
    pub ending: Ending,
    /// Updates in all sessions.
    pub steps: u64,
    /// Training time in all sessions, s.
    pub seconds: f64,
    /// Lowest validation score, if any validation ran.
    pub best_score: Option<f64>,
    /// Checkpoint to use for inference: `best/`, or `final/` when nothing was validated. A stopped run may have neither.
    pub checkpoint: PathBuf,
}

/// The device for what is decoded or prepared beside training.
pub fn cpu_device() -> Device {
    Device::flex()
}

/// A network on the run's processor, with gradients. Its weights are drawn on the CPU from `purpose`'s own seed, so that
/// they are the same whatever it is trained on.
///
/// # Errors
/// [`TrainError::Processor`].
pub fn seeded_network<M: Module>(
    config: &LoopConfig,
    purpose: &str,
    make: impl Fn(&Device) -> M,
) -> Result<M, TrainError> {
    let device = cpu_device().autodiff();
    device.seed(derive_seed(config.seed, purpose));
    let model = make(&device);
    // Weights are drawn when they are first looked at: now, before another seed is set.
    let weights = collect_params(&model);
    let processor = config.processors.first();
    if processor == Processor::Cpu {
        return Ok(model);
    }
    let moved = make(&processor.device()?.autodiff());
    Ok(replace_params(moved, weights))
}

/// Refuses the result of a run that has ended, but was too short to have a codebook.
///
/// # Errors
/// Says what to change.
pub fn require_codebook(
    stage: &'static str,
    codebook: &EmaCodebook,
    ending: Ending,
) -> Result<(), TrainError> {
    match codebook.is_initialised() || ending == Ending::Stopped {
        true => Ok(()),
        false => Err(TrainError::Codebook { stage }),
    }
}

#[derive(Clone, Debug, Serialize, Deserialize)]
struct TrainState {
    stage: String,
    step: u64,
    epoch: u64,
    next_batch: u64,
    n_updates: u64,
    seconds: f64,
    /// Bits, because JSON text may lose the last digit.
    best_score_bits: Option<u64>,
    seed: u64,
    #[serde(default)]
    loss_scale: LossScale,
    /// Validations since the best one.
    #[serde(default)]
    since_best: u64,
}

const STATE_FILE: &str = "train_state.json";
const OPTIMIZER_FILE: &str = "optimizer.safetensors";
const STAGE_STATE_FILE: &str = "stage_state.safetensors";

/// Trains until a limit is met.
///
/// With `resume`, continues from the newest usable checkpoint in `out_dir`; without, `out_dir` must
/// not hold a run.
///
/// # Errors
/// See [`TrainError`]. On [`TrainError::NotFinite`] the checkpoints before the bad batch remain.
pub fn run<S: Stage>(
    stage: &mut S,
    model: S::Model,
    config: &LoopConfig,
    out_dir: &Path,
    resume: bool,
) -> Result<Outcome<S::Model>, TrainError> {
    config.validate()?;
    fs::create_dir_all(out_dir).map_err(|source| TrainError::Io {
        path: out_dir.into(),
        source,
    })?;
    let mut run = Run {
        state: TrainState {
            stage: stage.name().into(),
            step: 0,
            epoch: 0,
            next_batch: 0,
            n_updates: 0,
            seconds: 0.0,
            best_score_bits: None,
            seed: config.seed,
            loss_scale: match stage.needs_loss_scale() {
                true => LossScale::start(),
                false => LossScale::default(),
            },
            since_best: 0,
        },
        optimizer: AdamW::default(),
        log: Log::of(out_dir),
        out_dir,
        config,
    };
    let existing = step_checkpoints(out_dir);
    let mut model = freeze(model, &|path| stage.is_trained(path));
    if resume {
        model = run.resume(stage, model, &existing)?;
    } else if !existing.is_empty() || run.log.exists() {
        return Err(TrainError::OutputExists {
            path: out_dir.into(),
        });
    }
    run.train(stage, model)
}

/// Removes the log of a run that was stopped before its first checkpoint, so that the run can start again.
///
/// # Errors
/// If it cannot be removed.
pub fn forget(out_dir: &Path) -> Result<(), TrainError> {
    Log::of(out_dir).remove()
}

/// Takes parameters that are not trained out of differentiation, so that they cost no gradient.
fn freeze<M: Module>(model: M, is_trained: &dyn Fn(&str) -> bool) -> M {
    struct Freeze<'a> {
        path: Vec<String>,
        is_trained: &'a dyn Fn(&str) -> bool,
    }
    impl ModuleMapper for Freeze<'_> {
        fn enter_module(&mut self, name: &str, _container: &str) {
            self.path.push(name.to_string());
        }
        fn exit_module(&mut self, _name: &str, _container: &str) {
            self.path.pop();
        }
        fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
            match (self.is_trained)(&self.path.join(".")) {
                true => param,
                false => param.set_require_grad(false),
            }
        }
    }
    model.map(&mut Freeze {
        path: Vec::new(),
        is_trained,
    })
}

struct Run<'a> {
    state: TrainState,
    optimizer: AdamW,
    log: Log,
    out_dir: &'a Path,
    config: &'a LoopConfig,
}

impl Run<'_> {
    fn train<S: Stage>(
        &mut self,
        stage: &mut S,
        mut model: S::Model,
    ) -> Result<Outcome<S::Model>, TrainError> {
        let config = self.config;
        let started = Instant::now();
        let seconds_before = self.state.seconds;
        let devices: Vec<Device> = (config.processors.devices()?.into_iter())
            .map(Device::autodiff)
            .collect();
        let mut batches = self.plan(stage)?;
        let n_batches = batches.len() as u64;
        let total = config.total_steps(n_batches);
        let mut last_save = Instant::now();
        let mut last_log = (Instant::now(), 0usize);
        let mut saved_step = None;
        let mut validated_step = None;
        let ending = loop {
            self.state.seconds = seconds_before + started.elapsed().as_secs_f64();
            let out_of_time =
                config.max_minutes > 0.0 && self.state.seconds >= config.max_minutes * 60.0;
            if total.is_some_and(|t| self.state.step >= t) {
                break Ending::Done;
            } else if out_of_time {
                break Ending::TimeUp;
            } else if config.patience > 0 && self.state.since_best >= config.patience {
                break Ending::NoBetter;
            } else if config.stop.is_stopped() {
                break Ending::Stopped;
            }
            let progress = match (config.schedule, total) {
                (Schedule::Time, _) | (_, None) => self.state.seconds / (config.max_minutes * 60.0),
                (Schedule::Steps, Some(total)) => self.state.step as f64 / total as f64,
            };
            let step = self.state.step;
            let mut sum = GradientSum::scaled(self.state.loss_scale.factor);
            let mut losses: Vec<(&'static str, f64)> = Vec::new();
            let mut info = StepInfo {
                step,
                epoch: self.state.epoch,
                progress,
                seed: 0,
            };
            let mut epoch_ended = false;
            let mut last_ids = Vec::new();
            let replicas: Vec<S::Model> = (devices.iter().skip(1))
                .map(|device| model.clone().fork(device))
                .collect();
            let models: Vec<&S::Model> = [&model].into_iter().chain(&replicas).collect();
            while (sum.n_batches() as u64) < config.batches_per_update() && !epoch_ended {
                // Every processor is given its work before the first result is waited for.
                let mut begun = Vec::new();
                for (device, model) in devices.iter().zip(&models) {
                    if epoch_ended {
                        break;
                    }
                    let batch_idx = self.state.next_batch;
                    info.seed = derive_seed(
                        config.seed,
                        &format!("{}/batch/{}/{batch_idx}", stage.name(), self.state.epoch),
                    );
                    device.seed(info.seed);
                    let batch = &batches[batch_idx as usize];
                    last_log.1 += batch.len();
                    let loss = stage.loss(model, batch, info)?;
                    let total = match self.state.loss_scale {
                        scale if scale.is_adaptive() => loss.total.clone() * scale.factor,
                        _ => loss.total.clone(),
                    };
                    let grads = total.backward();
                    begun.push((model, loss, grads, stage.ids(batch)));
                    self.state.next_batch += 1;
                    epoch_ended = self.state.next_batch >= n_batches;
                }
                for (model, loss, grads, ids) in begun {
                    let total_loss = f64::from(loss.total.into_scalar::<f32>());
                    if !total_loss.is_finite() {
                        return Err(TrainError::NotFinite {
                            step,
                            what: "loss".into(),
                            value: total_loss,
                            ids,
                        });
                    }
                    add_parts(&mut losses, &[("loss", total_loss)]);
                    add_parts(&mut losses, &loss.parts);
                    sum.add(*model, grads);
                    last_ids = ids;
                }
            }
            let n = sum.n_batches() as f64;
            let norm = sum.norm();
            let Some(is_usable) = self.state.loss_scale.usable(norm) else {
                let ids = last_ids;
                return Err(TrainError::NotFinite {
                    step,
                    what: "gradient norm".into(),
                    value: norm,
                    ids,
                });
            };
            let learning_rate = config.learning_rate_at(step, progress);
            drop(replicas);
            // An update whose gradient overflowed in half precision is left out.
            if is_usable {
                let rule = |path: &str, shape: &[usize]| stage.rule(path, shape);
                model = self
                    .optimizer
                    .step(&config.adamw, learning_rate, &rule, model, sum, norm);
                model = stage.after_step(model, info)?;
            }
            self.state.step += 1;
            self.state.seconds = seconds_before + started.elapsed().as_secs_f64();
            if epoch_ended {
                self.state.epoch += 1;
                self.state.next_batch = 0;
                batches = self.plan(stage)?;
            }
            if self.state.step.is_multiple_of(config.log_every.max(1))
                || total == Some(self.state.step)
            {
                let rate = last_log.1 as f64 / last_log.0.elapsed().as_secs_f64().max(1e-9);
                last_log = (Instant::now(), 0);
                losses.iter_mut().for_each(|(_, v)| *v /= n);
                self.log_step(stage.name(), &losses, norm, learning_rate, rate, total)?;
            }
            let validate_now = match config.validate_every {
                0 => epoch_ended,
                every => self.state.step.is_multiple_of(every),
            };
            if validate_now {
                self.validate(stage, &model)?;
                validated_step = Some(self.state.step);
                last_log = (Instant::now(), 0);
            }
            let by_steps = config.checkpoint_every_steps > 0
                && self
                    .state
                    .step
                    .is_multiple_of(config.checkpoint_every_steps);
            let by_time = config.checkpoint_every_s > 0.0
                && last_save.elapsed().as_secs_f64() >= config.checkpoint_every_s;
            if by_steps || by_time {
                self.save(stage, &model)?;
                saved_step = Some(self.state.step);
                last_save = Instant::now();
            }
        };
        // A run that was stopped before its first update starts afresh.
        let is_begun = self.state.step > 0 || ending != Ending::Stopped;
        if saved_step != Some(self.state.step) && is_begun {
            self.save(stage, &model)?;
        }
        if ending == Ending::Stopped {
            // No validation and no `final/`: the resumed run must go on as if it had never stopped.
            return Ok(self.outcome(model, ending));
        }
        if validated_step != Some(self.state.step) {
            self.validate(stage, &model)?;
        }
        let final_dir = self.out_dir.join("final");
        self.write_inference(stage, &model, &final_dir)?;
        Ok(self.outcome(model, ending))
    }

    fn outcome<M>(&self, model: M, ending: Ending) -> Outcome<M> {
        let [best, last] = ["best", "final"].map(|name| self.out_dir.join(name));
        Outcome {
            model,
            ending,
            steps: self.state.step,
            seconds: self.state.seconds,
            best_score: self.state.best_score_bits.map(f64::from_bits),
            checkpoint: if best.exists() { best } else { last },
        }
    }

    fn plan<S: Stage>(&self, stage: &S) -> Result<Vec<Vec<usize>>, TrainError> {
        let seed = derive_seed(
            self.config.seed,
            &format!("{}/epoch/{}", stage.name(), self.state.epoch),
        );
        let batches = stage.plan_epoch(seed);
        if batches.is_empty() || self.state.next_batch as usize >= batches.len() {
            return Err(TrainError::NoData("no batch could be formed"));
        }
        Ok(batches)
    }

    fn validate<S: Stage>(&mut self, stage: &mut S, model: &S::Model) -> Result<(), TrainError> {
        let result = stage.validate(&model.valid())?;
        let best = self.state.best_score_bits.map(f64::from_bits);
        let improved = result.score.is_finite() && best.is_none_or(|b| result.score < b);
        self.state.since_best = match improved {
            true => 0,
            false => self.state.since_best + 1,
        };
        let mut line = serde_json::Map::new();
        line.insert("validation".into(), true.into());
        line.insert("step".into(), self.state.step.into());
        line.insert("epoch".into(), self.state.epoch.into());
        line.insert("score".into(), json_number(result.score));
        for (name, value) in &result.values {
            line.insert((*name).into(), json_number(*value));
        }
        line.insert("seconds".into(), json_number(self.state.seconds));
        line.insert("best".into(), improved.into());
        self.log.append(&line)?;
        let values: Vec<String> = result
            .values
            .iter()
            .map(|(n, v)| format!("{n} {v:.4}"))
            .collect();
        tracing::info!(
            "{} step {} validation: score {:.4}{} {}",
            stage.name(),
            self.state.step,
            result.score,
            if improved { " (best)" } else { "" },
            values.join(" ")
        );
        if improved {
            self.state.best_score_bits = Some(result.score.to_bits());
            self.write_inference(stage, model, &self.out_dir.join("best"))?;
        }
        Ok(())
    }

    fn write_inference<S: Stage>(
        &self,
        stage: &S,
        model: &S::Model,
        dir: &Path,
    ) -> Result<(), TrainError> {
        let mut files = CheckpointFiles::default();
        files.json(CONFIG_FILE, &stage.config())?;
        stage.add_weights(&stage.for_inference(model), &mut files)?;
        stage.add_files(&mut files)?;
        Ok(files.write(dir)?)
    }

    fn save<S: Stage>(&mut self, stage: &S, model: &S::Model) -> Result<(), TrainError> {
        let (moments, n_updates) = self.optimizer.state();
        self.state.n_updates = n_updates;
        let mut files = CheckpointFiles::default();
        files.json(CONFIG_FILE, &stage.config())?;
        stage.add_weights(model, &mut files)?;
        stage.add_files(&mut files)?;
        files.json(STATE_FILE, &self.state)?;
        files.tensors(OPTIMIZER_FILE, &moments)?;
        files.tensors(STAGE_STATE_FILE, &stage.state())?;
        files.write(&self.out_dir.join(format!("step-{:08}", self.state.step)))?;
        let all = step_checkpoints(self.out_dir);
        let keep = self.config.keep_last.max(1);
        for (_, old) in all.iter().take(all.len().saturating_sub(keep)) {
            fs::remove_dir_all(old).map_err(|source| TrainError::Io {
                path: old.clone(),
                source,
            })?;
        }
        Ok(())
    }

    fn resume<S: Stage>(
        &mut self,
        stage: &mut S,
        model: S::Model,
        existing: &[(u64, PathBuf)],
    ) -> Result<S::Model, TrainError> {
        let mut problem = None;
        for (_, dir) in existing.iter().rev() {
            let checkpoint = match Checkpoint::open(dir) {
                Ok(checkpoint) => checkpoint,
                Err(e) => {
                    tracing::warn!("{e}; trying an older checkpoint");
                    problem = Some(e);
                    continue;
                }
            };
            let mut state: TrainState = checkpoint.json(STATE_FILE)?;
            // A run may go on in another precision.
            let fresh = self.state.loss_scale;
            if state.loss_scale.is_adaptive() != fresh.is_adaptive() {
                state.loss_scale = fresh;
            }
            let mismatch = |message: String| TrainError::ResumeMismatch {
                path: dir.clone(),
                message,
            };
            if state.stage != stage.name() {
                return Err(mismatch(format!(
                    "is of stage `{}`, not `{}`",
                    state.stage,
                    stage.name()
                )));
            }
            if state.seed != self.config.seed {
                return Err(mismatch(format!(
                    "has seed {}, not {}",
                    state.seed, self.config.seed
                )));
            }
            let saved: serde_json::Value = checkpoint.json(CONFIG_FILE)?;
            // Through text, as the saved one went: JSON may round the last digit of a float.
            let present: Option<serde_json::Value> =
                serde_json::from_str(&stage.config().to_string()).ok();
            if Some(&saved) != present.as_ref() {
                return Err(mismatch(format!(
                    "{CONFIG_FILE} differs from the present configuration"
                )));
            }
            let model = stage.load_weights(model, &checkpoint)?;
            let moments = checkpoint.tensors(OPTIMIZER_FILE)?;
            self.optimizer = AdamW::from_state(moments, state.n_updates, &param_shapes(&model))
                .map_err(|name| {
                    mismatch(format!("{OPTIMIZER_FILE}: `{name}` fits no parameter"))
                })?;
            stage.load_state(checkpoint.tensors(STAGE_STATE_FILE)?)?;
            self.log.truncate_after(state.step)?;
            tracing::info!("{} resumes at step {}", stage.name(), state.step);
            self.state = state;
            return Ok(model);
        }
        match problem {
            Some(e) => Err(e.into()),
            None => Err(TrainError::NothingToResume {
                path: self.out_dir.into(),
            }),
        }
    }

    fn log_step(
        &self,
        name: &str,
        losses: &[(&'static str, f64)],
        norm: f64,
        learning_rate: f64,
        rate: f64,
        total: Option<u64>,
    ) -> Result<(), TrainError> {
        let state = &self.state;
        let mut line = serde_json::Map::new();
        line.insert("step".into(), state.step.into());
        line.insert("epoch".into(), state.epoch.into());
        for (part, value) in losses {
            line.insert((*part).into(), json_number(*value));
        }
        line.insert("gradient_norm".into(), json_number(norm));
        line.insert("lr".into(), json_number(learning_rate));
        line.insert("items_per_s".into(), json_number(rate));
        line.insert("seconds".into(), json_number(state.seconds));
        self.log.append(&line)?;
        // Time left by steps and by budget, whichever ends the run first.
        let by_steps = total
            .map(|t| state.seconds / state.step as f64 * (t.saturating_sub(state.step)) as f64);
        let by_time = (self.config.max_minutes > 0.0)
            .then(|| (self.config.max_minutes * 60.0 - state.seconds).max(0.0));
        let left = match (by_steps, by_time) {
            (Some(a), Some(b)) => Some(a.min(b)),
            (a, b) => a.or(b),
        };
        let parts: Vec<String> = losses.iter().map(|(n, v)| format!("{n} {v:.4}")).collect();
        tracing::info!(
            "{name} step {}{} epoch {} {} |g| {norm:.3} lr {learning_rate:.2e} {rate:.1}/s{}",
            state.step,
            total.map(|t| format!("/{t}")).unwrap_or_default(),
            state.epoch,
            parts.join(" "),
            left.map(|s| format!(" left {:.1} min", s / 60.0))
                .unwrap_or_default(),
        );
        Ok(())
    }
}

fn add_parts(sums: &mut Vec<(&'static str, f64)>, parts: &[(&'static str, f64)]) {
    for (name, value) in parts {
        match sums.iter_mut().find(|(n, _)| n == name) {
            Some((_, sum)) => *sum += value,
            None => sums.push((name, *value)),
        }
    }
}

/// Resume checkpoints in a directory, oldest first.
fn step_checkpoints(out_dir: &Path) -> Vec<(u64, PathBuf)> {
    let Ok(entries) = fs::read_dir(out_dir) else {
        return Vec::new();
    };
    let mut found: Vec<(u64, PathBuf)> = entries
        .flatten()
        .filter_map(|e| {
            let step = e
                .file_name()
                .to_str()?
                .strip_prefix("step-")?
                .parse()
                .ok()?;
            Some((step, e.path()))
        })
        .collect();
    found.sort();
    found
}
