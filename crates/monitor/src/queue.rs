//! The queue between a radar and the pipeline.
//!
//! A radar does not wait: if the pipeline is late, the oldest frame is dropped and counted. A replay does wait, so that
//! nothing of a recording is lost.
//!
//! Every frame of the radar is counted once: as lost if its number is missing where frames arrive, as used if it leaves the
//! queue, as dropped if it does not. A frame of the queue counts as often as frames of the radar were merged to it.

use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use radarllm_base::PointFrame;

use crate::counters::Counters;
use crate::pipeline::Arrival;

/// Frames that may wait.
pub const QUEUE_FRAMES: usize = 64;

/// A frame for the pipeline.
#[derive(Clone, Debug, PartialEq)]
pub struct QueuedFrame {
    /// The frame.
    pub frame: PointFrame,
    /// When the newest of its points arrived.
    pub arrival: Arrival,
    /// Frames of the radar that were merged to it.
    pub n_merged: u32,
}

/// What a source reports.
#[derive(Clone, Debug, PartialEq)]
pub enum Item {
    /// A frame.
    Frame(QueuedFrame),
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
    counters: Arc<Counters>,
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Debug, Default)]
struct State {
    items: VecDeque<Item>,
    is_closed: bool,
    /// Number of the frame of the radar that arrived last.
    last_number: Option<u32>,
}

impl Item {
    /// Frames of the radar in it.
    fn n_frames(&self) -> u64 {
        match self {
            Self::Frame(queued) => queued.n_merged.into(),
            _ => 0,
        }
    }
}

impl FrameQueue {
    /// An empty queue.
    pub fn new(when_full: WhenFull, counters: Arc<Counters>) -> Self {
        Self {
            when_full,
            counters,
            state: Mutex::default(),
            changed: Condvar::new(),
        }
    }

    /// A frame of the radar arrived, which may be merged with others before it is pushed. Counts those that are missing
    /// between the one before and this one. A radar that counts anew has lost nothing that is known.
    pub fn arrived(&self, number: u32) {
        let before = self.lock().last_number.replace(number);
        let expected = before.and_then(|before| before.checked_add(1));
        if let Some(lost) = expected.and_then(|expected| number.checked_sub(expected)) {
            self.counters.frames_lost.add(lost.into());
        }
    }

    /// Adds something at the end. Returns false after the queue was closed: then nothing more is wanted, and a frame is
    /// dropped.
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
                    let oldest = state.items.iter().position(|item| item.n_frames() > 0);
                    let dropped = state.items.remove(oldest.unwrap_or(0));
                    let n_dropped = dropped.map_or(0, |item| item.n_frames());
                    self.counters.frames_dropped.add(n_dropped);
                }
            }
        }
        if state.is_closed {
            self.counters.frames_dropped.add(item.n_frames());
            return false;
        }
        state.items.push_back(item);
        self.changed.notify_all();
        true
    }

    /// The next item, whose frames count as used; `None` if nothing came within `timeout` or the queue is closed.
    pub fn pop(&self, timeout: Duration) -> Option<Item> {
        let is_empty = |state: &mut State| state.items.is_empty() && !state.is_closed;
        let (mut state, _) = self
            .changed
            .wait_timeout_while(self.lock(), timeout, is_empty)
            .unwrap_or_else(PoisonError::into_inner);
        let item = state.items.pop_front()?;
        self.counters.frames_used.add(item.n_frames());
        self.changed.notify_all();
        Some(item)
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

    /// Closes the queue: sources that wait go on, and frames that are left are dropped.
    pub fn close(&self) {
        let mut state = self.lock();
        state.is_closed = true;
        let n_frames = state.items.iter().map(Item::n_frames).sum();
        self.counters.frames_dropped.add(n_frames);
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
    use crate::counters::Counter;

    const SHORT: Duration = Duration::from_millis(1);

    fn merged(n: u32, n_merged: u32) -> Item {
        let frame = PointFrame {
            frame: n,
            ..PointFrame::default()
        };
        Item::Frame(QueuedFrame {
            frame,
            arrival: Arrival::Replayed(0),
            n_merged,
        })
    }

    fn frame(n: u32) -> Item {
        merged(n, 1)
    }

    fn number(item: Option<Item>) -> Option<u32> {
        match item {
            Some(Item::Frame(queued)) => Some(queued.frame.frame),
            _ => None,
        }
    }

    #[test]
    fn the_oldest_frame_is_dropped_and_counted() {
        let counters = Arc::new(Counters::default());
        let queue = FrameQueue::new(WhenFull::DropOldest, Arc::clone(&counters));
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
        assert_eq!(counters.frames_dropped.get(), 37);
        assert_eq!(queue.pop(SHORT), Some(lost));
        assert_eq!(number(queue.pop(SHORT)), Some(37));
    }

    #[test]
    fn every_frame_of_the_radar_is_used_lost_or_dropped() {
        let counters = Arc::new(Counters::default());
        let queue = FrameQueue::new(WhenFull::DropOldest, Arc::clone(&counters));
        // Every seventh frame does not arrive. Of 172 frames 40 are used, 68 find no room,
        // and 64 wait when the queue is closed.
        let numbers = (100..300).filter(|n| n % 7 != 0);
        for (i, n) in numbers.enumerate() {
            queue.arrived(n);
            assert!(queue.push(frame(n)));
            if (30..70).contains(&i) {
                assert!(queue.pop(SHORT).is_some());
            }
        }
        queue.close();
        let counts = || {
            let counters = [
                &counters.frames_used,
                &counters.frames_lost,
                &counters.frames_dropped,
            ];
            counters.map(Counter::get)
        };
        assert_eq!(counts(), [40, 28, 132]);
        // One that comes too late.
        queue.arrived(301);
        assert!(!queue.push(frame(301)));
        assert_eq!(counts(), [40, 29, 133]);
        // A radar that counts anew has lost nothing that is known.
        let queue = FrameQueue::new(WhenFull::DropOldest, Arc::clone(&counters));
        for n in [5, 0, 2, u32::MAX, 0] {
            queue.arrived(n);
        }
        assert_eq!(counts()[1], 29 + 1 + u64::from(u32::MAX - 3));
    }

    #[test]
    fn a_merged_frame_counts_as_often_as_frames_were_merged() {
        let counters = Arc::new(Counters::default());
        let queue = FrameQueue::new(WhenFull::DropOldest, Arc::clone(&counters));
        for n in 0..66 {
            assert!(queue.push(merged(n, 3)));
        }
        assert_eq!(counters.frames_dropped.get(), 6);
        assert!(queue.pop(SHORT).is_some());
        assert_eq!(counters.frames_used.get(), 3);
        queue.close();
        assert!(!queue.push(merged(66, 2)));
        assert_eq!(counters.frames_dropped.get(), 6 + 63 * 3 + 2);
    }

    #[test]
    fn a_replay_waits_and_loses_nothing() {
        let counters = Arc::new(Counters::default());
        let queue = FrameQueue::new(WhenFull::Wait, Arc::clone(&counters));
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
        assert_eq!(counters.frames_dropped.get(), 0);
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
