//! One publisher side, many listeners, and nobody waits for anybody, but a replay for the program that started it.
//!
//! A [`Bus`] numbers messages, keeps the state that late comers need, and gives each [`Reader`] a queue of
//! [`QUEUE_MESSAGES`]. A reader that is too slow loses `frame`s and gets their number in a `lag`; if its queue is full of what must
//! not be lost, it is closed, and may come back for a new `hello`. The publisher waits for a reader of
//! [`Bus::subscribe_awaited`] instead. There is no runtime: readers block or are polled.

mod queue;
mod state;

use std::pin::Pin;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll};
use std::time::Duration;

use futures_core::Stream;
use radarllm_monitor::messages::{About, At, Body, Hello, Message, Stamp, VERSION};
use serde::Serialize;

use queue::Queue;
use state::State;

/// Most messages that wait for one reader.
pub const QUEUE_MESSAGES: usize = 64;

/// A message as text. It is shared by all readers.
#[derive(Clone, Debug, PartialEq)]
pub struct Published {
    /// The JSON text.
    pub json: String,
    seq: u64,
    stamp: Stamp,
    is_frame: bool,
}

/// Distributes messages.
#[derive(Debug)]
pub struct Bus {
    shared: Arc<Shared>,
}

#[derive(Debug)]
struct Shared {
    inner: Mutex<Inner>,
    counts: Counts,
}

#[derive(Debug)]
struct Inner {
    seq: u64,
    stamp: Stamp,
    state: State,
    queues: Vec<Arc<Queue>>,
    is_closed: bool,
}

/// A `hello` before it is text.
struct Snapshot {
    seq: u64,
    stamp: Stamp,
    hello: Box<Hello>,
}

#[derive(Debug, Default)]
struct Counts {
    published: [AtomicU64; Body::TYPES.len()],
    frames_dropped: AtomicU64,
    readers_closed: AtomicU64,
}

/// What went over a bus.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct BusCounts {
    /// Messages by type, in the order of [`Body::TYPES`].
    pub published: [u64; Body::TYPES.len()],
    /// `frame` messages that readers lost.
    pub frames_dropped: u64,
    /// Readers that were closed because they were too slow for what must not be lost.
    pub readers_closed: u64,
    /// Readers at present.
    pub readers: usize,
}

/// A listener.
#[derive(Debug)]
pub struct Reader {
    queue: Arc<Queue>,
    shared: Arc<Shared>,
}

/// Why a reader got nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Silence {
    /// Nothing was published in time.
    #[error("nothing was published in time")]
    Timeout,
    /// The bus is closed, or the reader was too slow.
    #[error("the bus is closed, or this reader was too slow")]
    Closed,
}

impl Bus {
    /// A bus without readers.
    pub fn new(about: About) -> Self {
        let inner = Inner {
            seq: 0,
            stamp: Stamp::default(),
            state: State::new(about),
            queues: Vec::new(),
            is_closed: false,
        };
        Self {
            shared: Arc::new(Shared {
                inner: Mutex::new(inner),
                counts: Counts::default(),
            }),
        }
    }

    /// Publishes a message to all readers. It waits for nobody but readers of [`Self::subscribe_awaited`].
    pub fn publish(&self, stamp: Stamp, body: Body) {
        let counts = &self.shared.counts;
        let awaited = {
            let inner = &mut *self.shared.lock();
            inner.seq += 1;
            inner.stamp = stamp;
            inner.state.update(stamp, &body);
            counts.published[body.index()].fetch_add(1, Ordering::Relaxed);
            let published = Arc::new(Published::new(inner.seq, stamp, body));
            inner.send(&published, counts);
            let awaited = inner.queues.iter().filter(|queue| queue.is_awaited());
            awaited.cloned().collect::<Vec<_>>()
        };
        // Others publish and subscribe meanwhile.
        for queue in awaited {
            queue.wait_for_room();
        }
    }

    /// A new reader. It gets `hello` first and then every message.
    pub fn subscribe(&self) -> Reader {
        self.reader(Queue::default())
    }

    /// As [`Self::subscribe`], for a reader that must not be too slow: [`Self::publish`] waits for it. For replays, of which
    /// nothing may be lost; who waits for a radar does not notice a fall.
    pub fn subscribe_awaited(&self) -> Reader {
        self.reader(Queue::awaited())
    }

    /// From now on, no reader is waited for.
    pub fn stop_waiting(&self) {
        for queue in &self.shared.lock().queues {
            queue.leave_behind();
        }
    }

    fn reader(&self, queue: Queue) -> Reader {
        let queue = Arc::new(queue);
        let snapshot = {
            let inner = &mut *self.shared.lock();
            match inner.is_closed {
                true => None,
                false => {
                    inner.queues.push(Arc::clone(&queue));
                    Some(inner.snapshot())
                }
            }
        };
        // The text is made while others publish. Nobody reads the queue before it is returned.
        match snapshot {
            None => queue.close(),
            Some(snapshot) => {
                queue.push_first(snapshot.published());
                self.shared.counts.published[0].fetch_add(1, Ordering::Relaxed);
            }
        }
        Reader {
            queue,
            shared: Arc::clone(&self.shared),
        }
    }

    /// The state of everything, as a new reader gets it.
    pub fn hello(&self) -> Arc<Published> {
        let snapshot = self.shared.lock().snapshot();
        snapshot.published()
    }

    /// What does not change.
    pub fn about(&self) -> About {
        self.shared.lock().state.about().clone()
    }

    /// Whether a fall is suspected or confirmed, and not over.
    pub fn has_fall(&self, id: u64) -> bool {
        self.shared.lock().state.has_fall(id)
    }

    /// Forgets activities and sentences that overlap with a range of time, and tells all readers the state without them.
    pub fn forget(&self, from_ms: i64, to_ms: i64) {
        let inner = &mut *self.shared.lock();
        inner.state.forget(from_ms, to_ms);
        let hello = inner.snapshot().published();
        inner.send(&hello, &self.shared.counts);
    }

    /// Closes the bus: readers get what waits for them and then the end.
    pub fn close(&self) {
        let inner = &mut *self.shared.lock();
        inner.is_closed = true;
        for queue in inner.queues.drain(..) {
            queue.close();
        }
    }

    /// What went over the bus so far.
    pub fn counts(&self) -> BusCounts {
        let counts = &self.shared.counts;
        BusCounts {
            published: std::array::from_fn(|i| counts.published[i].load(Ordering::Relaxed)),
            frames_dropped: counts.frames_dropped.load(Ordering::Relaxed),
            readers_closed: counts.readers_closed.load(Ordering::Relaxed),
            readers: self.shared.lock().queues.len(),
        }
    }
}

impl Shared {
    /// A panic of another thread while it held the lock leaves a state that is complete.
    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Inner {
    fn snapshot(&self) -> Snapshot {
        Snapshot {
            seq: self.seq,
            stamp: self.stamp,
            hello: Box::new(self.state.hello()),
        }
    }

    fn send(&mut self, published: &Arc<Published>, counts: &Counts) {
        self.queues.retain(|queue| {
            let pushed = queue.push(published);
            counts
                .frames_dropped
                .fetch_add(pushed.n_dropped, Ordering::Relaxed);
            if pushed.is_closed {
                counts.readers_closed.fetch_add(1, Ordering::Relaxed);
            }
            !pushed.is_closed
        });
    }
}

impl Snapshot {
    fn published(self) -> Arc<Published> {
        let body = Body::Hello(self.hello);
        Arc::new(Published::new(self.seq, self.stamp, body))
    }
}

impl Published {
    fn new(seq: u64, stamp: Stamp, body: Body) -> Self {
        let is_frame = matches!(body, Body::Frame(_));
        let message = Message {
            v: VERSION,
            seq,
            at: At::new(stamp, body),
        };
        Self {
            // Messages have no maps with keys other than strings, so that their JSON text always exists.
            json: serde_json::to_string(&message).unwrap_or_default(),
            seq,
            stamp,
            is_frame,
        }
    }
}

impl Reader {
    /// The next message. It waits at most `timeout`.
    ///
    /// # Errors
    /// [`Silence`].
    pub fn recv_timeout(&self, timeout: Duration) -> Result<Arc<Published>, Silence> {
        self.queue.pop_timeout(timeout)
    }
}

impl Stream for Reader {
    type Item = Arc<Published>;

    fn poll_next(self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Option<Arc<Published>>> {
        self.queue.poll_pop(context)
    }
}

impl Drop for Reader {
    fn drop(&mut self) {
        // Who waits for this reader goes on.
        self.queue.close();
        let queues = &mut self.shared.lock().queues;
        queues.retain(|queue| !Arc::ptr_eq(queue, &self.queue));
    }
}

#[cfg(test)]
pub(crate) mod tests;
