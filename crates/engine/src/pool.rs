//! Threads that share the loops of one session, and sleep between them.

use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;

/// A loop body: called once with every part's number.
type Body = dyn Fn(usize) + Sync;

/// Looks at the counter this often before sleeping: some tens of microseconds, the pause between two
/// matrix products.
const SPINS: usize = 4000;

/// A fixed number of threads, the caller's among them.
pub(crate) struct Pool {
    shared: Arc<Shared>,
    workers: Vec<JoinHandle<()>>,
}

struct Shared {
    state: Mutex<State>,
    /// Number of the latest loop; changed under the lock, watched without it.
    epoch: AtomicUsize,
    /// Workers that have not finished the latest loop.
    busy: AtomicUsize,
    wake: Condvar,
    /// A body panicked in a worker.
    panicked: AtomicBool,
}

struct State {
    body: Option<*const Body>,
    stop: bool,
}

// SAFETY: the pointer is to a `Sync` closure and is followed only while `Pool::run`, which borrows
// the closure, waits for the workers.
unsafe impl Send for State {}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, State> {
        // The state is whole whenever the lock is free.
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
            if let Some(body) = body {
                // SAFETY: `run` keeps the closure alive until `busy` is 0.
                let body = unsafe { &*body };
                let call = std::panic::AssertUnwindSafe(|| body(part));
                if std::panic::catch_unwind(call).is_err() {
                    self.panicked.store(true, Ordering::Release);
                }
            }
            self.busy.fetch_sub(1, Ordering::AcqRel);
        }
    }
}

impl Pool {
    /// `threads` threads, at least the caller's own; fewer if the system refuses one.
    pub fn new(threads: usize) -> Self {
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

    /// Threads, the caller's included.
    pub fn threads(&self) -> usize {
        self.workers.len() + 1
    }

    /// Calls `body` with every part `0..threads()` at once and waits for all.
    pub fn run(&mut self, body: &(dyn Fn(usize) + Sync)) {
        if self.workers.is_empty() {
            return body(0);
        }
        // SAFETY: only the lifetime is dropped; the guard waits for the workers, also on unwinding.
        let erased =
            unsafe { std::mem::transmute::<*const (dyn Fn(usize) + Sync), *const Body>(body) };
        {
            let mut state = self.shared.lock();
            state.body = Some(erased);
            self.shared
                .busy
                .store(self.workers.len(), Ordering::Release);
            self.shared.epoch.fetch_add(1, Ordering::AcqRel);
        }
        self.shared.wake.notify_all();
        let wait = WaitForWorkers(&self.shared);
        body(0);
        drop(wait);
        assert!(
            !self.shared.panicked.swap(false, Ordering::AcqRel),
            "a worker of the engine panicked"
        );
    }

    /// Splits `0..n` into one range a thread and calls `body` with the thread's number and its range; on
    /// the caller's thread alone when the work (about this many operations) is too little to be worth
    /// waking others.
    pub fn split(&mut self, n: usize, work: usize, body: &(dyn Fn(usize, Range<usize>) + Sync)) {
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
}

/// Multiply-adds below which one thread is faster than several: some 20 microseconds.
const MIN_WORK: usize = 1 << 18;

struct WaitForWorkers<'a>(&'a Shared);

impl Drop for WaitForWorkers<'_> {
    fn drop(&mut self) {
        let mut spins = 0_usize;
        while self.0.busy.load(Ordering::Acquire) != 0 {
            spins += 1;
            if spins < SPINS {
                std::hint::spin_loop();
            } else {
                // More threads than cores: the worker needs this one.
                std::thread::yield_now();
            }
        }
    }
}

impl Drop for Pool {
    fn drop(&mut self) {
        self.shared.lock().stop = true;
        self.shared.wake.notify_all();
        // A worker that spins sees `stop` when it next takes the lock.
        for worker in self.workers.drain(..) {
            let _ = worker.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_part_runs_once_in_every_loop() {
        for threads in [1, 2, 3] {
            let mut pool = Pool::new(threads);
            let counts: Vec<AtomicUsize> = (0..pool.threads()).map(|_| 0.into()).collect();
            for round in 0..500 {
                if round % 100 == 0 {
                    std::thread::sleep(std::time::Duration::from_millis(2)); // Workers fall asleep.
                }
                pool.run(&|part| {
                    counts[part].fetch_add(1, Ordering::Relaxed);
                });
            }
            assert!(counts.iter().all(|c| c.load(Ordering::Relaxed) == 500));
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
    fn a_panic_in_a_worker_reaches_the_caller() {
        let mut pool = Pool::new(2);
        let caught = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            pool.run(&|part| assert!(part == 0, "wanted"));
        }));
        assert!(caught.is_err());
        pool.run(&|_| {});
    }
}
