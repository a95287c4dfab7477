//! Ending a training early.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Asks a training to end after the present update and to write a checkpoint that it can be resumed from. Clones ask
/// the same training; the program that starts a training keeps one.
///
/// ```
/// use radarllm_train::harness::StopToken;
///
/// let token = StopToken::default();
/// let of_the_training = token.clone();
/// assert!(!of_the_training.is_stopped());
/// token.stop();
/// assert!(of_the_training.is_stopped());
/// ```
#[derive(Clone, Debug, Default)]
pub struct StopToken(Arc<AtomicBool>);

impl StopToken {
    /// Asks for the end. Safe to call from another thread and more than once.
    pub fn stop(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether the end was asked for.
    pub fn is_stopped(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// Tokens are equal if they are in the same state: configurations that hold one compare by their settings.
impl PartialEq for StopToken {
    fn eq(&self, other: &Self) -> bool {
        self.is_stopped() == other.is_stopped()
    }
}
