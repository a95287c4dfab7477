//! A forest whose classes have names.

use super::classifier::{N_TREES, likeliest};
use crate::{EvalError, forest::Forest};

/// A forest with the names of its classes.
pub(super) struct Classes {
    names: Vec<String>,
    forest: Forest,
}

impl Classes {
    /// Learns the names of rows, which are the facts of training captions.
    ///
    /// # Errors
    /// No rows.
    pub(super) fn fit(rows: &[Vec<f32>], of_rows: &[String], seed: u64) -> Result<Self, EvalError> {
        let mut names = of_rows.to_vec();
        names.sort();
        names.dedup();
        let labels: Vec<usize> = of_rows
            .iter()
            .filter_map(|name| names.binary_search(name).ok())
            .collect();
        let forest = Forest::fit(rows, &labels, names.len(), N_TREES, seed)
            .ok_or_else(|| EvalError::Empty("no training caption states an action".into()))?;
        Ok(Self { names, forest })
    }

    /// The probability of each class.
    pub(super) fn probabilities(&self, row: &[f32]) -> Vec<f32> {
        self.forest.probabilities(row)
    }

    /// The name of a class.
    pub(super) fn name(&self, class: usize) -> Option<&str> {
        self.names.get(class).map(String::as_str)
    }

    /// The likeliest class among those that are `allowed`.
    pub(super) fn recognise(&self, row: &[f32], allowed: impl Fn(&str) -> bool) -> &str {
        let mut probabilities = self.probabilities(row);
        for (p, name) in probabilities.iter_mut().zip(&self.names) {
            if !allowed(name) {
                *p = -1.0;
            }
        }
        self.name(likeliest(&probabilities)).unwrap_or_default()
    }
}
