//! The queue between a radar and the pipeline.
//!
//! A radar does not wait: if the pipeline is late, the oldest frame is dropped and counted. A replay does wait, so that
//! nothing of a recording is lost.

use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use radarllm_base::PointFrame;

use crate::metrics::Metrics;
use crate::pipeline::Arrival;

/// Frames that may wait.
pub const QUEUE_FRAMES: usize = 64;

/// What a source reports.
#[derive(Clone, Debug, PartialEq)]
pub enum Item {
    /// A frame, and when it arrived.
    Frame(PointFrame, Arrival),
    /// The radar is silent.
    Lost {
        /// Since when, milliseconds since 1970 in UTC.
        at_ms: i64,
        /// Why.
        reason: String,
    },
    /// The radar is connected again.
    Back {
        /// Since when, milliseconds since 1970 in UTC.
        at_ms: i64,
    },
    /// Nothing more will come.
    End,
}

/// What a full queue does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WhenFull {
    /// Drops the oldest frame.
    DropOldest,
    /// Lets the source wait.
    Wait,
}

/// Frames between the thread of a source and that of the pipeline.
#[derive(Debug)]
pub struct FrameQueue {
    when_full: WhenFull,
    metrics: Arc<Metrics>,
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Debug, Default)]
struct State {
    items: VecDeque<Item>,
    is_closed: bool,
}

impl FrameQueue {
    /// An empty queue.
    pub fn new(when_full: WhenFull, metrics: Arc<Metrics>) -> Self {
        Self {
            when_full,
            metrics,
            state: Mutex::default(),
            changed: Condvar::new(),
        }
    }

    /// Adds something at the end. Returns false after the queue was closed: then nothing more is wanted.
    pub fn push(&self, item: Item) -> bool {
        let mut state = self.lock();
        while state.items.len() >= QUEUE_FRAMES && !state.is_closed {
            match self.when_full {
                WhenFull::Wait => {
                    state = self
                        .changed
                        .wait(state)
                        .unwrap_or_else(PoisonError::into_inner);
                }
                WhenFull::DropOldest => {
                    let is_frame = |item: &Item| matches!(item, Item::Frame(..));
                    let oldest = state.items.iter().position(is_frame).unwrap_or(0);
                    state.items.remove(oldest);
                    self.metrics.frames_dropped.add(1);
                }
            }
        }
        if state.is_closed {
            return false;
        }
        state.items.push_back(item);
        self.changed.notify_all();
        true
    }

    /// The next item; `None` if nothing came within `timeout` or the queue is closed.
    pub fn pop(&self, timeout: Duration) -> Option<Item> {
        let is_empty = |state: &mut State| state.items.is_empty() && !state.is_closed;
        let (mut state, _) = self
            .changed
            .wait_timeout_while(self.lock(), timeout, is_empty)
            .unwrap_or_else(PoisonError::into_inner);
        let item = state.items.pop_front();
        self.changed.notify_all();
        item
    }

    /// Whether more than half of the queue waits, so that sentences should be left out. A source that waits itself is
    /// never late.
    pub fn is_late(&self) -> bool {
        self.when_full == WhenFull::DropOldest && self.lock().items.len() > QUEUE_FRAMES / 2
    }

    /// Whether the queue was closed.
    pub fn is_closed(&self) -> bool {
        self.lock().is_closed
    }

    /// Closes the queue: sources that wait go on, and what is left is discarded.
    pub fn close(&self) {
        let mut state = self.lock();
        state.is_closed = true;
        state.items.clear();
        self.changed.notify_all();
    }

    /// A panic of another thread while it held the lock leaves a queue that is complete.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHORT: Duration = Duration::from_millis(1);

    fn frame(n: u32) -> Item {
        let frame = PointFrame {
            frame: n,
            ..PointFrame::default()
        };
        Item::Frame(frame, Arrival::Replayed(0))
    }

    fn number(item: Option<Item>) -> Option<u32> {
        match item {
            Some(Item::Frame(frame, _)) => Some(frame.frame),
            _ => None,
        }
    }

    #[test]
    fn the_oldest_frame_is_dropped_and_counted() {
        let metrics = Arc::new(Metrics::default());
        let queue = FrameQueue::new(WhenFull::DropOldest, Arc::clone(&metrics));
        let lost = Item::Lost {
            at_ms: 0,
            reason: "unplugged".into(),
        };
        assert!(queue.push(lost.clone()));
        assert!(!queue.is_late());
        for n in 0..100 {
            assert!(queue.push(frame(n)));
        }
        assert!(queue.is_late());
        assert_eq!(metrics.frames_dropped.get(), 37);
        assert_eq!(queue.pop(SHORT), Some(lost));
        assert_eq!(number(queue.pop(SHORT)), Some(37));
    }

    #[test]
    fn a_replay_waits_and_loses_nothing() {
        let metrics = Arc::new(Metrics::default());
        let queue = FrameQueue::new(WhenFull::Wait, Arc::clone(&metrics));
        let found: Vec<u32> = std::thread::scope(|threads| {
            threads.spawn(|| {
                for n in 0..1_000 {
                    queue.push(frame(n));
                }
                queue.push(Item::End);
            });
            let next = || number(queue.pop(Duration::from_secs(60)));
            std::iter::from_fn(next).collect()
        });
        assert_eq!(found, (0..1_000).collect::<Vec<u32>>());
        assert_eq!(metrics.frames_dropped.get(), 0);
        assert!(!queue.is_late());
    }

    #[test]
    fn closing_wakes_those_who_wait() {
        let queue = FrameQueue::new(WhenFull::Wait, Arc::default());
        std::thread::scope(|threads| {
            let pushing = threads.spawn(|| (0..100).all(|n| queue.push(frame(n))));
            while queue.lock().items.len() < QUEUE_FRAMES {
                std::thread::yield_now();
            }
            queue.close();
            assert!(!pushing.join().unwrap());
        });
        assert_eq!(queue.pop(Duration::from_secs(60)), None);
    }
}
