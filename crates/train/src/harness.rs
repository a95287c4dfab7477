//! The training loop that all stages share.
//!
//! A stage defines its batches and its loss ([`Stage`]). [`run`] does everything else: learning rate schedule (linear
//! warm-up and cosine), AdamW, gradient clipping, logs, validation, checkpoints, resuming, the time budget, and errors
//! for values that are not finite.
//!
//! Output directory:
//!
//! | name | contents |
//! |---|---|
//! | `log.jsonl` | one JSON object per logged step and per validation |
//! | `events.out.tfevents.radarllm` | the same numbers for TensorBoard |
//! | `step-00001234/` | checkpoint to resume from: weights, moments, counters, stage state |
//! | `best/` | weights with the lowest validation score, for inference |
//! | `final/` | weights at the end of the run, for inference |
//!
//! Every random choice is drawn from a seed that is derived from the seed of the run and the epoch or step. A resumed
//! run therefore continues bit for bit as if it had not been interrupted, on any number of CPU threads.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use burn::module::{Module, ModuleMapper, Param};
use burn::tensor::{Device, Tensor};
use radarllm_base::seed::derive_seed;
use radarllm_inference::checkpoint::{
    CONFIG_FILE, Checkpoint, CheckpointFiles, MODEL_FILE, NamedTensors, REPLACED_SUFFIX,
    UNFINISHED_SUFFIX, remove_checkpoint,
};
use radarllm_nn::device::Processor;
use radarllm_nn::params::{collect_params, load_model, param_shapes, replace_params};
use radarllm_nn::tokenizer::codebook::EmaCodebook;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::adamw::{AdamW, GradientSum, ParamRule};
pub use crate::error::TrainError;
use crate::inputs::Inputs;
use crate::log::{Log, json_number};
pub use crate::loop_config::{LoopConfig, Schedule, print_config, read_config};
use crate::loss_scale::LossScale;
pub use crate::stop::StopToken;

/// Loss of one batch.
pub struct StepLoss {
    /// Scalar to minimise, shape `[1]`, on the autodiff graph.
    pub total: Tensor<1>,
    /// Named terms for the log, as numbers.
    pub parts: Vec<(&'static str, f64)>,
}

/// Progress of the run. A stage may use it for schedules of its own.
#[derive(Clone, Copy, Debug)]
pub struct StepInfo {
    /// Number of updates done.
    pub step: u64,
    /// Epoch, from 0.
    pub epoch: u64,
    /// Share of the run completed before this batch, 0..=1.
    pub progress: f64,
    /// Seed for the random choices of this batch.
    pub seed: u64,
}

/// Result of a validation.
pub struct Validation {
    /// Score; lower is better. The best checkpoint has the lowest score.
    pub score: f64,
    /// Named values for the log.
    pub values: Vec<(&'static str, f64)>,
}

/// Definition of one kind of training.
pub trait Stage {
    /// The network to train, on an autodiff device.
    type Model: Module;

    /// Name of the stage in logs.
    fn name(&self) -> &'static str;

    /// Batches of an epoch as item numbers. The result depends on `epoch_seed` only. There is at least one batch, and
    /// every epoch has the same number of batches.
    fn plan_epoch(&self, epoch_seed: u64) -> Vec<Vec<usize>>;

    /// Ids of the clips in a batch, for error messages.
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

    /// Called after every update. Codebooks that are updated by moving averages change here.
    ///
    /// # Errors
    /// If the stage cannot continue.
    fn after_step(
        &mut self,
        model: Self::Model,
        _info: StepInfo,
    ) -> Result<Self::Model, TrainError> {
        Ok(model)
    }

    /// Returns the score on the validation data; `model` is not on an autodiff device.
    ///
    /// # Errors
    /// If the data cannot be used.
    fn validate(&mut self, model: &Self::Model) -> Result<Validation, TrainError>;

    /// Returns the update rule of a parameter.
    fn rule(&self, _path: &str, shape: &[usize]) -> ParamRule {
        ParamRule::by_shape(shape)
    }

    /// Contents of `config.json` in the checkpoints: everything that inference needs to rebuild the network.
    fn config(&self) -> Value;

    /// Whether small gradients underflow in the stage's precision.
    fn needs_loss_scale(&self) -> bool {
        false
    }

    /// Whether a parameter is trained; other parameters are frozen.
    fn is_trained(&self, _path: &str) -> bool {
        true
    }

    /// Returns the weights that inference uses, if they differ from those after the last update.
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

    /// Restores the weights that [`Self::add_weights`] added.
    ///
    /// # Errors
    /// If the weights do not fit.
    fn load_weights(
        &self,
        model: Self::Model,
        checkpoint: &Checkpoint,
    ) -> Result<Self::Model, TrainError> {
        Ok(load_model(checkpoint, model)?)
    }

    /// Adds further files to inference checkpoints (vocabularies, tensors).
    ///
    /// # Errors
    /// If the files cannot be created.
    fn add_files(&self, _files: &mut CheckpointFiles) -> Result<(), TrainError> {
        Ok(())
    }

    /// Returns the state, other than the weights, that resuming needs.
    fn state(&self) -> NamedTensors {
        NamedTensors::new()
    }

    /// Restores the result of [`Self::state`].
    ///
    /// # Errors
    /// If the state does not fit.
    fn load_state(&mut self, _state: NamedTensors) -> Result<(), TrainError> {
        Ok(())
    }
}

/// Reason for the end of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Ending {
    /// All steps are done.
    Done,
    /// The time budget is used up.
    TimeUp,
    /// The validation score has not improved for the number of validations in [`LoopConfig::patience`].
    NoBetter,
    /// The run was stopped by [`LoopConfig::stop`]. It is not finished and can be resumed.
    Stopped,
}

/// Result of a run.
#[derive(Debug)]
pub struct Outcome<M> {
    /// Network after the last update, on the autodiff device.
    pub model: M,
    /// Reason for the end.
    pub ending: Ending,
    /// Number of updates in all sessions.
    pub steps: u64,
    /// Training time in all sessions, s.
    pub seconds: f64,
    /// Lowest validation score, if any validation ran.
    pub best_score: Option<f64>,
    /// Checkpoint to use for inference: `best/`, or `final/` if there was no validation. A stopped run may have
    /// neither.
    pub checkpoint: PathBuf,
}

impl<M> Outcome<M> {
    /// The same outcome with a part of its network.
    pub fn map<N>(self, part: impl FnOnce(M) -> N) -> Outcome<N> {
        Outcome {
            model: part(self.model),
            ending: self.ending,
            steps: self.steps,
            seconds: self.seconds,
            best_score: self.best_score,
            checkpoint: self.checkpoint,
        }
    }
}

/// Device for decoding and for data preparation during training.
pub fn cpu_device() -> Device {
    Device::flex()
}

/// Creates a network on the processor of the run, with gradients. Its weights are drawn on the CPU from a seed that is
/// specific to `purpose`, so that they are the same on every processor.
///
/// # Errors
/// [`TrainError::Processor`].
pub fn seeded_network<M: Module>(
    config: &LoopConfig,
    purpose: &str,
    make: impl Fn(&Device) -> M,
) -> Result<M, TrainError> {
    // The generator of a device is shared by the process: two runs that start at the same time would draw from each
    // other's seed.
    static GENERATOR: Mutex<()> = Mutex::new(());
    let _generator = GENERATOR.lock().unwrap_or_else(PoisonError::into_inner);
    let device = cpu_device().autodiff();
    device.seed(derive_seed(config.seed, purpose));
    let model = make(&device);
    // Weights are drawn on first access. This is done here, before another seed is set.
    let weights = collect_params(&model);
    let processor = config.processors.first();
    if processor == Processor::Cpu {
        return Ok(model);
    }
    let moved = make(&processor.device()?.autodiff());
    Ok(replace_params(moved, weights))
}

/// Returns an error for a run that has ended but was too short to initialise the codebook.
///
/// # Errors
/// The message states which settings to change.
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
    /// The score is stored as bits, because JSON text may lose the last digit.
    best_score_bits: Option<u64>,
    seed: u64,
    #[serde(default)]
    loss_scale: LossScale,
    /// Number of validations since the best one.
    #[serde(default)]
    since_best: u64,
    /// [`LoopConfig::inputs`]; empty where they were not recorded.
    #[serde(default)]
    inputs: Inputs,
}

/// Beginning of the names of checkpoints for resuming, before the number of the step.
const STEP_PREFIX: &str = "step-";
const STATE_FILE: &str = "train_state.json";
const OPTIMIZER_FILE: &str = "optimizer.safetensors";
const STAGE_STATE_FILE: &str = "stage_state.safetensors";

/// Trains until a limit is reached.
///
/// With `resume`, training continues from the newest usable checkpoint in `out_dir`. Without it, `out_dir` must not
/// contain a run.
///
/// # Errors
/// See [`TrainError`]. After [`TrainError::NotFinite`], the checkpoints from before the failing batch are kept.
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
            inputs: config.inputs.clone(),
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

/// Whether the folder of a run contains a checkpoint from which it can continue.
pub fn has_checkpoint(out_dir: &Path) -> bool {
    !step_checkpoints(out_dir).is_empty()
}

/// Removes what a run left that was stopped before its first checkpoint was complete, so that the run can start again.
///
/// # Errors
/// If something cannot be removed.
pub fn forget(out_dir: &Path) -> Result<(), TrainError> {
    remove_unfinished(out_dir)?;
    Log::of(out_dir).remove()
}

/// Removes the checkpoints that were being written or removed when the process ended.
fn remove_unfinished(out_dir: &Path) -> Result<(), TrainError> {
    let Ok(entries) = fs::read_dir(out_dir) else {
        return Ok(());
    };
    for entry in entries.flatten() {
        let name = entry.file_name();
        let name = name.to_string_lossy();
        if name.starts_with(STEP_PREFIX) && name.ends_with(UNFINISHED_SUFFIX) {
            let path = entry.path();
            fs::remove_dir_all(&path).map_err(|source| TrainError::Io { path, source })?;
        }
    }
    Ok(())
}

/// Removes all checkpoints for resuming but the `keep` newest.
fn remove_old(out_dir: &Path, keep: usize) -> Result<(), TrainError> {
    let all = step_checkpoints(out_dir);
    for (_, old) in all.iter().take(all.len().saturating_sub(keep)) {
        remove_checkpoint(old)?;
    }
    Ok(())
}

/// Excludes parameters that are not trained from differentiation, so that no gradients are computed for them.
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
                // Work is submitted to all processors before the first result is waited for.
                let mut begun = Vec::new();
                for model in &models {
                    if epoch_ended {
                        break;
                    }
                    let batch_idx = self.state.next_batch;
                    info.seed = derive_seed(
                        config.seed,
                        &format!("{}/batch/{}/{batch_idx}", stage.name(), self.state.epoch),
                    );
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
            // An update whose gradient overflowed in half precision is skipped.
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
        // A run that was stopped before its first update starts from the beginning.
        let is_begun = self.state.step > 0 || ending != Ending::Stopped;
        if saved_step != Some(self.state.step) && is_begun {
            self.save(stage, &model)?;
        }
        if ending == Ending::Stopped {
            // There is no validation and no `final/`: the resumed run must continue as if it had not been interrupted.
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
        files.write(
            &self
                .out_dir
                .join(format!("{STEP_PREFIX}{:08}", self.state.step)),
        )?;
        remove_old(self.out_dir, self.config.keep_last.max(1))
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
            // A run may be resumed in another precision.
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
            if let Some(problem) = changed_input(&state.inputs, &self.config.inputs) {
                return Err(mismatch(problem));
            }
            state.inputs.clone_from(&self.config.inputs);
            let saved: Value = checkpoint.json(CONFIG_FILE)?;
            // Converted to text and back, as the saved configuration was: JSON may round the last digit of a float.
            let present: Value =
                serde_json::from_str(&stage.config().to_string()).unwrap_or_default();
            if let Some(problem) = difference(&saved, &present) {
                return Err(mismatch(format!("{CONFIG_FILE}: {problem}")));
            }
            remove_unfinished(self.out_dir)?;
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
        // Remaining time by steps and by time budget, whichever ends the run first.
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

/// Maximum length of a value in an error message, characters.
const MAX_SHOWN: usize = 60;

/// The first key in which two configurations differ, with both values.
fn difference(saved: &Value, present: &Value) -> Option<String> {
    let (key, was, is) = first_difference(saved, present)?;
    let shown = |value: Option<&Value>| {
        let text = value.map_or("absent".into(), Value::to_string);
        match text.char_indices().nth(MAX_SHOWN) {
            Some((end, _)) => format!("{}...", &text[..end]),
            None => text,
        }
    };
    let key = key.trim_start_matches('.');
    Some(format!(
        "`{key}` is {} in the checkpoint, and {} in the present configuration",
        shown(was),
        shown(is)
    ))
}

/// The dotted key and the values of the first difference, each key after a dot.
fn first_difference<'a>(
    saved: &'a Value,
    present: &'a Value,
) -> Option<(String, Option<&'a Value>, Option<&'a Value>)> {
    if saved == present {
        return None;
    }
    let (Value::Object(was), Value::Object(is)) = (saved, present) else {
        return Some((String::new(), Some(saved), Some(present)));
    };
    let keys: BTreeSet<&String> = was.keys().chain(is.keys()).collect();
    keys.into_iter()
        .find_map(|key| match (was.get(key), is.get(key)) {
            (Some(was), Some(is)) => {
                let (inner, was, is) = first_difference(was, is)?;
                Some((format!(".{key}{inner}"), was, is))
            }
            (was, is) => Some((format!(".{key}"), was, is)),
        })
}

/// The first input that is not the one of the checkpoint.
fn changed_input(saved: &Inputs, present: &Inputs) -> Option<String> {
    // Earlier versions recorded none.
    if saved.is_empty() {
        return None;
    }
    let names: BTreeSet<&String> = saved.keys().chain(present.keys()).collect();
    let name = (names.into_iter()).find(|name| saved.get(*name) != present.get(*name))?;
    let hash = |of: &Inputs| of.get(name).map_or("none".into(), String::clone);
    Some(format!(
        "what it learned from has changed: `{name}` had the hash {}, and has {}",
        hash(saved),
        hash(present)
    ))
}

/// Checkpoints for resuming in a directory, oldest first.
fn step_checkpoints(out_dir: &Path) -> Vec<(u64, PathBuf)> {
    let Ok(entries) = fs::read_dir(out_dir) else {
        return Vec::new();
    };
    let step_of = |name: &str| {
        let name = name.strip_prefix(STEP_PREFIX)?;
        // A process that ended while it replaced a checkpoint left the earlier one under this name.
        name.strip_suffix(REPLACED_SUFFIX)
            .unwrap_or(name)
            .parse()
            .ok()
    };
    let mut found: Vec<(u64, PathBuf)> = entries
        .flatten()
        .filter_map(|e| Some((step_of(e.file_name().to_str()?)?, e.path())))
        .collect();
    found.sort();
    found.dedup_by_key(|(step, _)| *step);
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_removal_that_is_interrupted_leaves_no_checkpoint_of_a_step() {
        let dir = std::env::temp_dir().join(format!("radarllm-harness-{}", std::process::id()));
        let _ = fs::remove_dir_all(&dir);
        let step = |step: u64| dir.join(format!("{STEP_PREFIX}{step:08}"));
        let names = || {
            let entries = fs::read_dir(&dir).unwrap();
            let mut names: Vec<String> = entries
                .map(|e| e.unwrap().file_name().into_string().unwrap())
                .collect();
            names.sort();
            names
        };
        let steps = || -> Vec<u64> {
            let found = step_checkpoints(&dir).into_iter();
            found.map(|(step, _)| step).collect()
        };
        let mut files = CheckpointFiles::default();
        files.json(CONFIG_FILE, &"a configuration").unwrap();
        for n in [2, 3] {
            files.write(&step(n)).unwrap();
        }
        // A plain file cannot be removed as a directory, so that the removal ends as if the process were killed.
        fs::write(step(1), "").unwrap();
        assert_eq!(steps(), [1, 2, 3]);
        assert!(remove_old(&dir, 2).is_err());
        assert_eq!(steps(), [2, 3]);
        // A killed process leaves a directory with some of the files, which the next run removes.
        let unfinished = dir.join("step-00000001.tmp");
        fs::remove_file(&unfinished).unwrap();
        fs::create_dir(&unfinished).unwrap();
        fs::write(unfinished.join(CONFIG_FILE), "").unwrap();
        remove_unfinished(&dir).unwrap();
        assert_eq!(names(), ["step-00000002", "step-00000003"]);
        remove_old(&dir, 1).unwrap();
        assert_eq!(names(), ["step-00000003"]);
        fs::remove_dir_all(&dir).unwrap();
    }
}
