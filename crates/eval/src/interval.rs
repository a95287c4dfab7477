//! Estimates with confidence intervals.
//!
//! All intervals are 95 % bootstrap intervals that resample whole units (motions, people), because several clips of one
//! motion are not independent.

use radarllm_metrics::{
    Scores,
    bootstrap::{Interval, mean_interval},
};
use serde::Serialize;

/// Number of bootstrap resamples, as for the caption metrics.
pub const N_RESAMPLES: usize = 1000;

/// An estimate with its 95 % interval: a mean, a proportion, a difference of proportions or a caption metric.
///
/// ```
/// use radarllm_eval::Estimate;
///
/// // 7 of 10 captions name the right action; every clip is a unit of its own.
/// let correct = [1.0, 1.0, 0.0, 1.0, 1.0, 1.0, 0.0, 1.0, 0.0, 1.0];
/// let units: Vec<usize> = (0..10).collect();
/// let proportion = Estimate::of_mean(&correct, &units, 1).unwrap();
/// assert_eq!(proportion.value, 0.7);
/// assert!(proportion.low >= 0.3 && proportion.low < 0.7);
/// assert!(proportion.high > 0.7 && proportion.high <= 1.0);
/// assert_eq!(proportion.to_text(100.0, 0), "70 [40, 100]");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Estimate {
    /// The estimate.
    pub value: f64,
    /// 2.5 % quantile of the resampled estimates.
    pub low: f64,
    /// 97.5 % quantile of the resampled estimates.
    pub high: f64,
}

impl Estimate {
    /// Mean of `values`, resampling whole `units` (one number a value); `None` without values.
    pub fn of_mean(values: &[f64], units: &[usize], seed: u64) -> Option<Self> {
        let interval = mean_interval(values, units, N_RESAMPLES, seed)?;
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        Some(Self::with_interval(mean, interval))
    }

    /// A caption metric with the interval that `scores` has for it; NaN where it has none.
    pub fn of_metric(scores: &Scores, name: &str, value: f64) -> Self {
        let interval = scores.ci95.get(name).copied();
        Self::with_interval(value, interval.unwrap_or([f64::NAN; 2]))
    }

    /// Cells of a table with caption metrics and their intervals: CIDEr-D in its own scale, the others multiplied by 100.
    pub(crate) fn cells(scores: &Scores, names: &[&str]) -> Vec<String> {
        let cell = |name: &&str| {
            let (value, scale, digits) = match *name {
                "bleu_1" => (scores.bleu_1, 100.0, 1),
                "bleu_4" => (scores.bleu_4, 100.0, 1),
                "rouge_1" => (scores.rouge_1, 100.0, 1),
                "rouge_l" => (scores.rouge_l, 100.0, 1),
                "meteor" => (scores.meteor.unwrap_or(f64::NAN), 100.0, 1),
                "cider_d" => (scores.cider_d, 1.0, 3),
                "bert_score" => (scores.bert_score.unwrap_or(f64::NAN), 100.0, 1),
                "sim_cse" => (scores.sim_cse.unwrap_or(f64::NAN), 100.0, 1),
                other => unreachable!("no caption metric {other}"),
            };
            Self::of_metric(scores, name, value).to_text(scale, digits)
        };
        names.iter().map(cell).collect()
    }

    fn with_interval(value: f64, [low, high]: Interval) -> Self {
        Self { value, low, high }
    }

    /// `value [low, high]`, multiplied by `scale`, with so many digits after the point.
    pub fn to_text(self, scale: f64, digits: usize) -> String {
        let [value, low, high] = [self.value, self.low, self.high].map(|v| v * scale);
        format!("{value:.digits$} [{low:.digits$}, {high:.digits$}]")
    }

    /// As [`Self::to_text`], with signs, for differences.
    pub fn to_signed_text(self, scale: f64, digits: usize) -> String {
        let [value, low, high] = [self.value, self.low, self.high].map(|v| v * scale);
        format!("{value:+.digits$} [{low:+.digits$}, {high:+.digits$}]")
    }
}
