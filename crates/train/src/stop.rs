//! Early stop of a training run.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Requests that a training run ends after the current update and writes a checkpoint from which it can be resumed.
/// Clones refer to the same run; the program that starts a run keeps one of them.
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
    /// Requests the stop. May be called from another thread and more than once.
    pub fn stop(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether the stop has been requested.
    pub fn is_stopped(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// Tokens are equal if they are in the same state, so that configurations that hold a token are compared by their
/// settings.
impl PartialEq for StopToken {
    fn eq(&self, other: &Self) -> bool {
        self.is_stopped() == other.is_stopped()
    }
}
