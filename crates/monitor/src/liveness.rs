//! Whether the program is alive: frames arrive, and the pipeline moves.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// How long frames may be missing, beside three frame periods.
const SILENCE: Duration = Duration::from_secs(2);
/// How long the pipeline may take for one step.
const STUCK: Duration = Duration::from_secs(5);

/// When a running radar last sent a frame, and when its pipeline last finished a step. All methods may be called from any thread.
#[derive(Debug)]
pub struct Liveness {
    began: Instant,
    frame_period: Duration,
    last_frame_ms: AtomicU64,
    last_step_ms: AtomicU64,
}

impl Liveness {
    /// Begins to watch. The first frame and the first step have the same time as later ones.
    pub fn new(frame_period: Duration) -> Self {
        Self {
            began: Instant::now(),
            frame_period,
            last_frame_ms: AtomicU64::new(0),
            last_step_ms: AtomicU64::new(0),
        }
    }

    /// A frame arrived from the radar.
    pub fn frame_arrived(&self) {
        self.last_frame_ms
            .store(self.elapsed_ms(), Ordering::Relaxed);
    }

    /// The pipeline finished a step, or found nothing to do.
    pub fn step_finished(&self) {
        self.last_step_ms
            .store(self.elapsed_ms(), Ordering::Relaxed);
    }

    /// Whether the pipeline finished a step in the last seconds. A silent radar does not stop it.
    pub fn is_moving(&self) -> bool {
        self.is_moving_at(self.elapsed_ms())
    }

    fn is_moving_at(&self, elapsed_ms: u64) -> bool {
        since(&self.last_step_ms, elapsed_ms) <= STUCK
    }

    /// Present problems in words; none if all is well.
    pub fn problems(&self) -> Vec<String> {
        self.problems_at(self.elapsed_ms())
    }

    fn problems_at(&self, elapsed_ms: u64) -> Vec<String> {
        let mut problems = Vec::new();
        let silence = since(&self.last_frame_ms, elapsed_ms);
        if silence > SILENCE.saturating_add(self.frame_period.saturating_mul(3)) {
            let s = silence.as_secs();
            problems.push(format!("no frame arrived from the radar for {s} s"));
        }
        if !self.is_moving_at(elapsed_ms) {
            let s = since(&self.last_step_ms, elapsed_ms).as_secs();
            problems.push(format!("the pipeline has been stuck for {s} s"));
        }
        problems
    }

    fn elapsed_ms(&self) -> u64 {
        u64::try_from(self.began.elapsed().as_millis()).unwrap_or(u64::MAX)
    }
}

fn since(last_ms: &AtomicU64, elapsed_ms: u64) -> Duration {
    Duration::from_millis(elapsed_ms.saturating_sub(last_ms.load(Ordering::Relaxed)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn silence_and_a_stuck_pipeline_are_problems() {
        let liveness = Liveness::new(Duration::from_millis(100));
        assert!(liveness.problems_at(2_300).is_empty());
        assert_eq!(
            liveness.problems_at(2_301),
            ["no frame arrived from the radar for 2 s"]
        );
        assert_eq!(liveness.problems_at(5_001).len(), 2);
        assert!(liveness.is_moving_at(5_000) && !liveness.is_moving_at(5_001));
        liveness.frame_arrived();
        liveness.step_finished();
        assert!(liveness.problems().is_empty());
    }
}
