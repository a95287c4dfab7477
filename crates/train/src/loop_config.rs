//! Settings of the training loop, and reading of settings files.

use std::path::Path;

use radarllm_files::bounded::{self, MAX_CONFIG_BYTES};
use radarllm_nn::device::Processors;
use serde::{Deserialize, Serialize};

use crate::adamw::AdamWConfig;
use crate::error::TrainError;
use crate::inputs::Inputs;
use crate::stop::StopToken;

/// Measure of progress for the cosine of the learning rate schedule.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Schedule {
    /// Number of updates. The result is reproducible.
    Steps,
    /// Used share of `max_minutes`. The cosine reaches its end regardless of the speed of the machine.
    Time,
}

/// Settings of the loop, the same for every stage.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LoopConfig {
    /// Seed of all random choices in the run.
    pub seed: u64,
    /// Number of epochs; 0 means no limit.
    pub epochs: u64,
    /// Maximum number of updates; 0 means no limit.
    pub max_steps: u64,
    /// Maximum training time over all sessions of the run, minutes; 0 means no limit.
    pub max_minutes: f64,
    /// Peak learning rate.
    pub learning_rate: f64,
    /// Learning rate at the end, as a share of the peak.
    pub final_lr_factor: f64,
    /// Number of updates of linear warm-up.
    pub warmup_steps: u64,
    /// Measure of progress for the cosine.
    pub schedule: Schedule,
    /// Number of batches per processor whose gradients are averaged for one update.
    pub accumulate: u64,
    /// Optimiser.
    pub adamw: AdamWConfig,
    /// Updates between log lines.
    pub log_every: u64,
    /// Updates between validations; 0 validates after every epoch.
    pub validate_every: u64,
    /// Ends the run after this number of validations without a better score; 0 disables this.
    pub patience: u64,
    /// Seconds between checkpoints; 0 disables this rule, so that only `checkpoint_every_steps` applies.
    pub checkpoint_every_s: f64,
    /// Updates between checkpoints; 0 disables this rule, so that only `checkpoint_every_s` applies.
    pub checkpoint_every_steps: u64,
    /// Number of checkpoints for resuming that are kept.
    pub keep_last: usize,
    /// Processors that compute the stage. They are not part of the compared settings: a run may be resumed on others.
    #[serde(skip)]
    pub processors: Processors,
    /// What the run learns from besides its settings. It is resumed only with the same.
    #[serde(skip)]
    pub inputs: Inputs,
    /// Stops the run early. It is not part of the compared settings either.
    #[serde(skip)]
    pub stop: StopToken,
}

impl Default for LoopConfig {
    fn default() -> Self {
        Self {
            seed: 0,
            epochs: 100,
            max_steps: 0,
            max_minutes: 0.0,
            learning_rate: 3.5e-4,
            final_lr_factor: 0.05,
            warmup_steps: 100,
            schedule: Schedule::Steps,
            accumulate: 1,
            adamw: AdamWConfig::default(),
            log_every: 10,
            validate_every: 0,
            patience: 0,
            checkpoint_every_s: 300.0,
            checkpoint_every_steps: 0,
            keep_last: 2,
            processors: Processors::default(),
            inputs: Inputs::new(),
            stop: StopToken::default(),
        }
    }
}

impl LoopConfig {
    /// Number of batches whose gradients are averaged for one update.
    pub fn batches_per_update(&self) -> u64 {
        self.accumulate.max(1) * self.processors.count().max(1) as u64
    }

    /// Checks that the loop can run and that it ends.
    ///
    /// # Errors
    /// Names the first field that cannot be used.
    pub fn validate(&self) -> Result<(), TrainError> {
        let fail =
            |field: &str, problem: &str| Err(TrainError::config(field, problem).in_table("loop"));
        let unit = 0.0..1.0;
        if self.epochs == 0 && self.max_steps == 0 && self.max_minutes <= 0.0 {
            return fail(
                "epochs",
                "no limit at all: set epochs, max_steps or max_minutes",
            );
        }
        if !(self.learning_rate.is_finite() && self.learning_rate > 0.0) {
            return fail("learning_rate", "must be finite and positive");
        }
        if !(0.0..=1.0).contains(&self.final_lr_factor) {
            return fail("final_lr_factor", "must be in 0..=1");
        }
        if !unit.contains(&self.adamw.beta_1) || !unit.contains(&self.adamw.beta_2) {
            return fail("adamw.beta_1", "betas must be in 0..1");
        }
        if !(self.adamw.epsilon > 0.0
            && self.adamw.weight_decay >= 0.0
            && self.adamw.clip_norm >= 0.0)
        {
            return fail(
                "adamw.epsilon",
                "epsilon must be positive, decay and clip_norm not negative",
            );
        }
        if self.schedule == Schedule::Time && self.max_minutes <= 0.0 {
            return fail("schedule", "`time` needs max_minutes");
        }
        if self.schedule == Schedule::Steps && self.epochs == 0 && self.max_steps == 0 {
            return fail("schedule", "`steps` needs epochs or max_steps");
        }
        if !self.max_minutes.is_finite() || !self.checkpoint_every_s.is_finite() {
            return fail("max_minutes", "times must be finite");
        }
        Ok(())
    }

    /// Number of updates of the whole run, if it is limited by epochs or steps.
    pub(crate) fn total_steps(&self, batches_per_epoch: u64) -> Option<u64> {
        let per_epoch = batches_per_epoch.div_ceil(self.batches_per_update());
        let by_epochs = (self.epochs > 0).then(|| self.epochs.saturating_mul(per_epoch));
        let by_steps = (self.max_steps > 0).then_some(self.max_steps);
        match (by_epochs, by_steps) {
            (Some(a), Some(b)) => Some(a.min(b)),
            (a, b) => a.or(b),
        }
    }

    /// Learning rate of an update; `progress` in 0..=1 is the share of the run completed before it.
    pub(crate) fn learning_rate_at(&self, step: u64, progress: f64) -> f64 {
        let warm = if self.warmup_steps == 0 {
            1.0
        } else {
            ((step + 1) as f64 / self.warmup_steps as f64).min(1.0)
        };
        let cosine = 0.5 * (1.0 + (std::f64::consts::PI * progress.clamp(0.0, 1.0)).cos());
        let floor = self.final_lr_factor;
        self.learning_rate * warm * (floor + (1.0 - floor) * cosine)
    }
}

/// Checks that a number of items is in `1..=max`.
///
/// # Errors
/// [`TrainError::Config`] with the number.
pub(crate) fn check_count(field: &str, value: usize, max: usize) -> Result<(), TrainError> {
    match (1..=max).contains(&value) {
        true => Ok(()),
        false => {
            let problem = format!("must be in 1..={max}, found {value}");
            Err(TrainError::config(field, problem))
        }
    }
}

/// Checks that a weight, or a standard deviation, is finite and not negative.
///
/// # Errors
/// [`TrainError::Config`] with the value.
pub(crate) fn check_weight(field: &str, value: f64) -> Result<(), TrainError> {
    match value.is_finite() && value >= 0.0 {
        true => Ok(()),
        false => {
            let problem = format!("must be finite and not negative, found {value}");
            Err(TrainError::config(field, problem))
        }
    }
}

/// Returns every setting of `T` with its default value, as TOML.
///
/// # Errors
/// If a default cannot be expressed in TOML, which would be a bug.
pub fn print_config<T: Serialize + Default>() -> Result<String, TrainError> {
    toml::to_string_pretty(&T::default()).map_err(|e| TrainError::Config {
        field: "defaults".into(),
        problem: e.to_string(),
    })
}

/// Reads settings from a TOML file. Unknown fields are errors; missing fields get their default value.
///
/// # Errors
/// If the file cannot be read or its contents do not fit.
pub fn read_config<T: for<'de> Deserialize<'de>>(path: &Path) -> Result<T, TrainError> {
    let text = bounded::read_text(path, MAX_CONFIG_BYTES).map_err(|e| TrainError::Io {
        path: path.into(),
        source: e.into_io(),
    })?;
    toml::from_str(&text).map_err(|e| TrainError::ConfigFile {
        path: path.into(),
        message: e.to_string(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn schedule_warms_up_and_ends_at_the_floor() {
        let c = LoopConfig {
            learning_rate: 1.0,
            warmup_steps: 10,
            final_lr_factor: 0.1,
            ..Default::default()
        };
        assert!((c.learning_rate_at(0, 0.0) - 0.1).abs() < 1e-12);
        assert!((c.learning_rate_at(9, 0.0) - 1.0).abs() < 1e-12);
        // Half-way through the cosine, the learning rate is the mean of the peak and the final value.
        assert!((c.learning_rate_at(100, 0.5) - 0.55).abs() < 1e-12);
        assert!((c.learning_rate_at(100, 1.0) - 0.1).abs() < 1e-12);
    }

    #[test]
    fn defaults_print_and_read_back() {
        let text = print_config::<LoopConfig>().unwrap();
        let back: LoopConfig = toml::from_str(&text).unwrap();
        assert_eq!(back, LoopConfig::default());
        assert!(toml::from_str::<LoopConfig>("learning_rat = 1.0").is_err());
        let partial: LoopConfig = toml::from_str("epochs = 3").unwrap();
        assert_eq!(
            partial,
            LoopConfig {
                epochs: 3,
                ..Default::default()
            }
        );
    }

    #[test]
    fn runs_without_an_end_are_refused() {
        let endless = LoopConfig {
            epochs: 0,
            ..Default::default()
        };
        assert!(endless.validate().is_err());
        assert!(
            LoopConfig {
                learning_rate: f64::NAN,
                ..Default::default()
            }
            .validate()
            .is_err()
        );
    }
}
