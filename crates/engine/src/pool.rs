//! A thread pool that runs the loops of one session. Its threads sleep between loops.
//!
//! A loop of a decoding step takes some tens of microseconds, less than starting a thread takes. The threads therefore
//! outlive the loops and access borrowed data through pointers. This lifetime handling is confined to this file. The
//! methods are safe, because [`Pool::run`] does not return before every thread has released what it borrowed.

use std::marker::PhantomData;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;

/// Number of times that a worker polls the counter before it sleeps: some tens of microseconds, the pause between two
/// matrix products.
const SPINS: usize = if cfg!(miri) { 1 } else { 4000 };

/// A fixed number of threads, including the caller's.
pub(crate) struct Pool {
    shared: Arc<Shared>,
    workers: Vec<JoinHandle<()>>,
}

struct Shared {
    state: Mutex<State>,
    /// Number of the latest loop. It is changed under the lock and polled without it.
    epoch: AtomicUsize,
    /// Number of workers that have not finished the latest loop.
    busy: AtomicUsize,
    wake: Condvar,
    /// A body panicked in a worker.
    panicked: AtomicBool,
}

struct State {
    /// Body of the latest loop. The pointer dangles between loops.
    body: Option<Body>,
    stop: bool,
}

/// Called with a range of items, a part of the scratch buffer and the part of the output that belongs to the items.
type BufferBody<'a> = dyn Fn(Range<usize>, &mut [f32], &mut [f32]) + Sync + 'a;

/// A borrowed closure with its type and lifetime erased. The threads outlive every loop and cannot name them.
#[derive(Clone, Copy)]
struct Body {
    closure: *const (),
    /// Calls `closure`, which must be alive.
    call: unsafe fn(*const (), usize),
}

// SAFETY: `Body::new` takes closures that are `Sync`: any thread may call them by reference.
unsafe impl Send for Body {}

impl Body {
    fn new<F: Fn(usize) + Sync>(body: &F) -> Self {
        /// # Safety
        /// `closure` must come from a `&F` whose referent is alive.
        unsafe fn call<F: Fn(usize)>(closure: *const (), part: usize) {
            // SAFETY: guaranteed by the caller.
            let body = unsafe { &*closure.cast::<F>() };
            body(part);
        }
        Self {
            closure: std::ptr::from_ref(body).cast(),
            call: call::<F>,
        }
    }
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, State> {
        // No code panics while it holds the lock, so the state is consistent even if the lock is poisoned.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn work(&self, part: usize) {
        let mut seen = 0;
        loop {
            for _ in 0..SPINS {
                if self.epoch.load(Ordering::Acquire) != seen {
                    break;
                }
                std::hint::spin_loop();
            }
            let mut state = self.lock();
            while self.epoch.load(Ordering::Acquire) == seen && !state.stop {
                state = self
                    .wake
                    .wait(state)
                    .unwrap_or_else(PoisonError::into_inner);
            }
            if state.stop {
                return;
            }
            seen = self.epoch.load(Ordering::Acquire);
            let body = state.body;
            drop(state);
            if let Some(Body { closure, call }) = body {
                let call = std::panic::AssertUnwindSafe(|| {
                    // SAFETY: the closure belongs to the loop in progress, whose `run` keeps it borrowed until `busy`
                    // is 0. This worker has not yet decremented `busy`.
                    unsafe { call(closure, part) }
                });
                if std::panic::catch_unwind(call).is_err() {
                    self.panicked.store(true, Ordering::Release);
                }
            }
            // Releases the writes of this worker to the caller, who waits for 0 with an acquiring load.
            self.busy.fetch_sub(1, Ordering::AcqRel);
        }
    }
}

impl Pool {
    /// Starts `threads` threads, including the caller's. There are fewer if the system refuses to start one.
    pub(crate) fn new(threads: usize) -> Self {
        let shared = Arc::new(Shared {
            state: Mutex::new(State {
                body: None,
                stop: false,
            }),
            epoch: AtomicUsize::new(0),
            busy: AtomicUsize::new(0),
            wake: Condvar::new(),
            panicked: AtomicBool::new(false),
        });
        let mut workers = Vec::new();
        for part in 1..threads {
            let shared = Arc::clone(&shared);
            let builder = std::thread::Builder::new().name(format!("engine-{part}"));
            let Ok(worker) = builder.spawn(move || shared.work(part)) else {
                break;
            };
            workers.push(worker);
        }
        Self { shared, workers }
    }

    /// Number of threads, including the caller's.
    pub(crate) fn threads(&self) -> usize {
        self.workers.len() + 1
    }

    /// Calls `body` concurrently with every part `0..threads()` and waits for all of them.
    ///
    /// # Panics
    /// If a body panics, after all parts have ended.
    pub(crate) fn run<F: Fn(usize) + Sync>(&mut self, body: &F) {
        if self.workers.is_empty() {
            return body(0);
        }
        {
            // Because of `&mut self` and the wait below, no worker is in a loop. `busy` is therefore 0 and no thread
            // reads the old body.
            let mut state = self.shared.lock();
            state.body = Some(Body::new(body));
            self.shared
                .busy
                .store(self.workers.len(), Ordering::Release);
            self.shared.epoch.fetch_add(1, Ordering::AcqRel);
        }
        self.shared.wake.notify_all();
        // Waits for the workers when dropped, also if the caller's own part panics, because `body` must outlive their
        // calls.
        let wait = WaitForWorkers(&self.shared);
        body(0);
        drop(wait);
        assert!(
            !self.shared.panicked.swap(false, Ordering::AcqRel),
            "a worker of the engine panicked"
        );
    }

    /// Splits `0..n` into one range per thread and calls `body` with the number of the thread and its range. If the
    /// work (approximately this many operations) is too small to justify waking other threads, it runs on the caller's
    /// thread alone.
    pub(crate) fn split(
        &mut self,
        n: usize,
        work: usize,
        body: &(dyn Fn(usize, Range<usize>) + Sync),
    ) {
        let threads = self.threads();
        if threads == 1 || work < MIN_WORK {
            return body(0, 0..n);
        }
        self.run(&|part| {
            let range = n * part / threads..n * (part + 1) / threads;
            if !range.is_empty() {
                body(part, range);
            }
        });
    }

    /// Like [`Self::split`], and lends each thread its own buffers: an equal part of `scratch`, and the part of `out`
    /// that belongs to its range, with `out.len() / n` values per item.
    ///
    /// `body` receives the range, the part of `scratch` and the part of `out`.
    pub(crate) fn split_buffers(
        &mut self,
        n: usize,
        work: usize,
        scratch: &mut [f32],
        out: &mut [f32],
        body: &BufferBody<'_>,
    ) {
        let per_thread = scratch.len() / self.threads();
        let per_item = out.len().checked_div(n).unwrap_or(0);
        let (scratch, out) = (SharedBuffer::new(scratch), SharedBuffer::new(out));
        self.split(n, work, &|thread, items| {
            // SAFETY: `split` calls with the number of each thread at most once.
            let scratch = unsafe { scratch.piece(thread * per_thread, per_thread) };
            // SAFETY: `split` calls with ranges that do not overlap.
            let out = unsafe { out.piece(items.start * per_item, items.len() * per_item) };
            body(items, scratch, out);
        });
    }
}

/// A buffer whose parts are written by different threads.
#[derive(Clone, Copy)]
pub(crate) struct SharedBuffer<'a> {
    start: *mut f32,
    len: usize,
    /// Keeps the buffer borrowed for as long as parts can be taken.
    buffer: PhantomData<&'a mut [f32]>,
}

// SAFETY: a `SharedBuffer` represents a `&mut [f32]`, which may be sent to another thread. It accesses nothing by
// itself: the caller of `piece` guarantees that no other thread has the same part.
unsafe impl Send for SharedBuffer<'_> {}
// SAFETY: as above; `piece` is the only method.
unsafe impl Sync for SharedBuffer<'_> {}

impl<'a> SharedBuffer<'a> {
    pub(crate) fn new(buffer: &'a mut [f32]) -> Self {
        Self {
            start: buffer.as_mut_ptr(),
            len: buffer.len(),
            buffer: PhantomData,
        }
    }

    /// The `len` values that begin at `start`.
    ///
    /// # Safety
    /// While the part is in use, no overlapping part may be taken.
    ///
    /// # Panics
    /// If the part extends beyond the buffer.
    pub(crate) unsafe fn piece(self, start: usize, len: usize) -> &'a mut [f32] {
        assert!(start <= self.len && len <= self.len - start);
        // SAFETY: the range is inside the buffer, which `'a` borrows mutably. The caller guarantees that no other code
        // has this part.
        unsafe { std::slice::from_raw_parts_mut(self.start.add(start), len) }
    }
}

/// Number of multiply-adds below which one thread is faster than several: some 20 microseconds of work. The limit is
/// lower under Miri, so that its small tests use several threads too.
const MIN_WORK: usize = if cfg!(miri) { 1 << 8 } else { 1 << 18 };

struct WaitForWorkers<'a>(&'a Shared);

impl Drop for WaitForWorkers<'_> {
    fn drop(&mut self) {
        let mut spins = 0_usize;
        while self.0.busy.load(Ordering::Acquire) != 0 {
            spins += 1;
            if spins < SPINS {
                std::hint::spin_loop();
            } else {
                // With more threads than cores, the worker needs this core.
                std::thread::yield_now();
            }
        }
    }
}

impl Drop for Pool {
    fn drop(&mut self) {
        self.shared.lock().stop = true;
        self.shared.wake.notify_all();
        // A worker that spins sees `stop` when it next acquires the lock.
        for worker in self.workers.drain(..) {
            let _ = worker.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROUNDS: usize = if cfg!(miri) { 20 } else { 500 };

    #[test]
    fn every_part_runs_once_in_every_loop() {
        for threads in [1, 2, 3] {
            let mut pool = Pool::new(threads);
            let counts: Vec<AtomicUsize> = (0..pool.threads()).map(|_| 0.into()).collect();
            for round in 0..ROUNDS {
                if round % (ROUNDS / 5) == 0 {
                    std::thread::sleep(std::time::Duration::from_millis(2)); // Workers fall asleep.
                }
                pool.run(&|part| {
                    counts[part].fetch_add(1, Ordering::Relaxed);
                });
            }
            assert!(counts.iter().all(|c| c.load(Ordering::Relaxed) == ROUNDS));
        }
    }

    #[test]
    fn ranges_cover_everything_once() {
        let mut pool = Pool::new(3);
        for n in [0, 1, 2, 3, 100] {
            let counts: Vec<AtomicUsize> = (0..n).map(|_| 0.into()).collect();
            pool.split(n, usize::MAX, &|_, range| {
                for i in range {
                    counts[i].fetch_add(1, Ordering::Relaxed);
                }
            });
            assert!(counts.iter().all(|c| c.load(Ordering::Relaxed) == 1));
        }
    }

    #[test]
    fn every_thread_has_its_own_scratch_and_its_items_of_the_output() {
        for threads in [1, 2, 3] {
            let mut pool = Pool::new(threads);
            for (n, work) in [(0, usize::MAX), (1, usize::MAX), (7, usize::MAX), (7, 0)] {
                let (mut scratch, mut out) = (vec![0.0; 2 * pool.threads()], vec![-1.0; 3 * n]);
                pool.split_buffers(n, work, &mut scratch, &mut out, &|items, scratch, out| {
                    assert_eq!((scratch.len(), out.len()), (2, 3 * items.len()));
                    for (item, out) in items.zip(out.chunks_exact_mut(3)) {
                        scratch[0] += 1.0;
                        out.fill(item as f32);
                    }
                });
                // Every item is processed once, by any thread.
                assert_eq!(scratch.iter().sum::<f32>(), n as f32);
                for (item, out) in out.chunks_exact(3).enumerate() {
                    assert_eq!(out, [item as f32; 3]);
                }
            }
        }
    }

    #[test]
    fn a_panic_in_a_worker_reaches_the_caller() {
        let mut pool = Pool::new(2);
        let caught = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            pool.run(&|part| assert!(part == 0, "wanted"));
        }));
        assert!(caught.is_err());
        pool.run(&|_| {});
    }
}
