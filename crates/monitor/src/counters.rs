//! Counters of frames and windows.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::Duration;

/// What happened to frames and windows so far. All methods may be called from any thread.
#[derive(Debug, Default)]
pub struct Counters {
    /// Frames that were used.
    pub frames_used: Counter,
    /// Frames that the radar sent and that did not arrive.
    pub frames_lost: Counter,
    /// Frames that arrived and were dropped because a queue was full.
    pub frames_dropped: Counter,
    /// Windows in which the model abstained.
    pub abstained: Counter,
    /// Windows for which the model reported an error.
    pub model_errors: Counter,
    /// Windows that were replaced by a newer one before the model described them.
    pub windows_overwritten: Counter,
    /// Windows that the model described, or from which it abstained.
    pub windows_described: Counter,
    /// Time that the model took for them, ns.
    pub describe_ns: Counter,
    /// Why the model could not describe the newest window.
    pub model_problem: Problem,
    /// What was learnt of the empty room, in words, once it is known.
    pub room_learnt: OnceLock<String>,
}

impl Counters {
    /// Counts a window that the model described or from which it abstained, and the time for it.
    pub fn described(&self, time: Duration) {
        self.windows_described.add(1);
        self.describe_ns
            .add(u64::try_from(time.as_nanos()).unwrap_or(u64::MAX));
        self.model_problem.set(None);
    }

    /// Counts a window for which the model reported an error.
    pub fn model_failed(&self, problem: String) {
        self.model_errors.add(1);
        self.model_problem.set(Some(problem));
    }
}

/// A number that only rises.
#[derive(Debug, Default)]
pub struct Counter(AtomicU64);

impl Counter {
    /// Adds to the number.
    pub fn add(&self, n: u64) {
        self.0.fetch_add(n, Ordering::Relaxed);
    }

    /// Raises the number to one that is counted elsewhere.
    pub fn raise_to(&self, n: u64) {
        self.0.fetch_max(n, Ordering::Relaxed);
    }

    /// The number.
    pub fn get(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
    }
}

/// A problem in words, as long as it lasts.
#[derive(Debug, Default)]
pub struct Problem(Mutex<Option<String>>);

impl Problem {
    /// Sets the problem; `None` when it is over.
    pub fn set(&self, problem: Option<String>) {
        *self.lock() = problem;
    }

    /// The present problem.
    pub fn get(&self) -> Option<String> {
        self.lock().clone()
    }

    /// A panic of another thread while it held the lock leaves a text that is complete.
    fn lock(&self) -> MutexGuard<'_, Option<String>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
