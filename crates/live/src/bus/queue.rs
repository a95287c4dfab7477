//! The bounded queue of one reader.

use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll, Waker};
use std::time::Duration;

use radarllm_monitor::messages::{Body, Lag};

use super::{Published, QUEUE_MESSAGES, Silence};

/// Messages that wait for one reader.
#[derive(Debug, Default)]
pub(super) struct Queue {
    waiting: Mutex<Waiting>,
    arrived: Condvar,
    taken: Condvar,
}

#[derive(Debug, Default)]
struct Waiting {
    messages: VecDeque<Arc<Published>>,
    /// Frames that were lost since the last `lag`.
    n_dropped: u64,
    is_closed: bool,
    /// Whether the publisher waits for this reader instead of closing its queue.
    is_awaited: bool,
    waker: Option<Waker>,
}

/// What happened to a message.
#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct Pushed {
    /// Frames that the reader lost by it.
    pub n_dropped: u64,
    /// Whether the queue is closed now.
    pub is_closed: bool,
}

impl Queue {
    /// The queue of a reader for whom the publisher waits.
    pub(super) fn awaited() -> Self {
        let queue = Self::default();
        queue.lock().is_awaited = true;
        queue
    }

    /// Whether the publisher waits for this reader.
    pub(super) fn is_awaited(&self) -> bool {
        self.lock().is_awaited
    }

    /// Waits until there is room, if the publisher waits for this reader.
    pub(super) fn wait_for_room(&self) {
        let is_full =
            |w: &mut Waiting| w.is_awaited && !w.is_closed && w.messages.len() >= QUEUE_MESSAGES;
        let waited = self.taken.wait_while(self.lock(), is_full);
        drop(waited.unwrap_or_else(PoisonError::into_inner));
    }

    /// From now on the publisher does not wait for this reader.
    pub(super) fn leave_behind(&self) {
        self.lock().is_awaited = false;
        self.taken.notify_all();
    }

    /// Adds a message. In a full queue the oldest frame makes room; a queue for whose reader the publisher waits grows
    /// beyond the limit by what must not be lost.
    pub(super) fn push(&self, message: &Arc<Published>) -> Pushed {
        let mut waiting = self.lock();
        let mut pushed = Pushed {
            n_dropped: 0,
            is_closed: waiting.is_closed,
        };
        if waiting.is_closed {
            return pushed;
        }
        if waiting.messages.len() >= QUEUE_MESSAGES {
            match waiting.messages.iter().position(|m| m.is_frame) {
                Some(oldest) => {
                    waiting.messages.remove(oldest);
                    pushed.n_dropped = 1;
                }
                None if message.is_frame => {
                    waiting.n_dropped += 1;
                    pushed.n_dropped = 1;
                    return pushed;
                }
                None if waiting.is_awaited => {}
                None => {
                    waiting.messages.clear();
                    waiting.is_closed = true;
                    pushed.is_closed = true;
                }
            }
        }
        waiting.n_dropped += pushed.n_dropped;
        if !waiting.is_closed {
            waiting.messages.push_back(Arc::clone(message));
        }
        self.wake(waiting);
        pushed
    }

    /// Adds a message before all others, beyond the limit if need be.
    pub(super) fn push_first(&self, message: Arc<Published>) {
        self.lock().messages.push_front(message);
    }

    /// Ends the queue after the messages that wait in it.
    pub(super) fn close(&self) {
        let mut waiting = self.lock();
        waiting.is_closed = true;
        self.taken.notify_all();
        self.wake(waiting);
    }

    pub(super) fn poll_pop(&self, context: &mut Context<'_>) -> Poll<Option<Arc<Published>>> {
        let mut waiting = self.lock();
        self.taken.notify_all();
        match waiting.pop() {
            Ok(message) => Poll::Ready(Some(message)),
            Err(Silence::Closed) => Poll::Ready(None),
            Err(Silence::Timeout) => {
                waiting.waker = Some(context.waker().clone());
                Poll::Pending
            }
        }
    }

    pub(super) fn pop_timeout(&self, timeout: Duration) -> Result<Arc<Published>, Silence> {
        let is_empty = |w: &mut Waiting| w.messages.is_empty() && !w.is_closed;
        let waited = self
            .arrived
            .wait_timeout_while(self.lock(), timeout, is_empty);
        let (mut waiting, _) = waited.unwrap_or_else(PoisonError::into_inner);
        self.taken.notify_all();
        waiting.pop()
    }

    fn wake(&self, mut waiting: MutexGuard<'_, Waiting>) {
        let waker = waiting.waker.take();
        drop(waiting);
        self.arrived.notify_one();
        if let Some(waker) = waker {
            waker.wake();
        }
    }

    fn lock(&self) -> MutexGuard<'_, Waiting> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Waiting {
    /// The next message, and a `lag` before it if frames were lost.
    fn pop(&mut self) -> Result<Arc<Published>, Silence> {
        let Some(next) = self.messages.front() else {
            return Err(match self.is_closed {
                true => Silence::Closed,
                false => Silence::Timeout,
            });
        };
        if self.n_dropped > 0 {
            let dropped = std::mem::take(&mut self.n_dropped);
            let before = next.seq.saturating_sub(1);
            let lag = Published::new(before, next.stamp, Body::Lag(Lag { dropped }));
            return Ok(Arc::new(lag));
        }
        self.messages.pop_front().ok_or(Silence::Timeout)
    }
}
