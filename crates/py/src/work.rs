//! Long work beside Python: without its lock, interruptible, and safe after a fork.
//!
//! The work runs on a thread of its own. The calling thread waits without the interpreter's lock and looks for signals
//! now and then, so that Ctrl-C reaches the work whatever threads it uses itself.

use std::{
    any::Any,
    panic::resume_unwind,
    sync::{
        atomic::{AtomicBool, AtomicPtr, Ordering},
        mpsc::{self, RecvTimeoutError},
    },
    thread,
    time::Duration,
};

use pyo3::prelude::*;
use radarllm::{Error, ErrorKind, Result};

use crate::errors;

/// Time between two looks for signals.
const POLL: Duration = Duration::from_millis(50);
/// Stack of the thread, that of a main thread.
const STACK_BYTES: usize = 8 << 20;
/// Most threads that a caller may ask for.
const MAX_THREADS: usize = 1024;

/// Set once the work is to end early.
#[derive(Default)]
pub(crate) struct Stop(AtomicBool);

impl Stop {
    /// Whether the work is to end.
    pub(crate) fn is_set(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// An error of kind [`ErrorKind::Interrupted`] if the work is to end.
    pub(crate) fn check(&self) -> Result {
        match self.is_set() {
            true => Err(Error::input("interrupted").of_kind(ErrorKind::Interrupted)),
            false => Ok(()),
        }
    }
}

/// Runs work without the interpreter's lock. A panic in it becomes `Bug`, a signal whose handler raises (Ctrl-C) stops
/// it and raises.
pub(crate) fn run<T: Send>(
    py: Python<'_>,
    work: impl FnOnce(&Stop) -> Result<T> + Send,
) -> PyResult<T> {
    let stop = Stop::default();
    let (outcome, signal) = py
        .detach(|| watched(&stop, work))
        .map_err(|e| errors::system(format!("no thread for the work: {e}")))?;
    match (signal, outcome) {
        (Some(signal), _) => Err(signal),
        (None, Ok(done)) => done.map_err(errors::to_py),
        (None, Err(panic)) => Err(errors::bug(panic_message(&*panic))),
    }
}

type Watched<T> = (thread::Result<Result<T>>, Option<PyErr>);

fn watched<T: Send>(
    stop: &Stop,
    work: impl FnOnce(&Stop) -> Result<T> + Send,
) -> std::io::Result<Watched<T>> {
    thread::scope(|scope| {
        let (working, ended) = mpsc::channel::<()>();
        let worker = thread::Builder::new()
            .name("radarllm".into())
            .stack_size(STACK_BYTES)
            .spawn_scoped(scope, move || {
                // Dropped when the work ends, also by a panic: the channel closes then.
                let _working = working;
                work(stop)
            })?;
        let mut signal = None;
        while let Err(RecvTimeoutError::Timeout) = ended.recv_timeout(POLL) {
            if signal.is_none()
                && let Err(raised) = Python::attach(|py| py.check_signals())
            {
                stop.0.store(true, Ordering::Relaxed);
                signal = Some(raised);
            }
        }
        Ok((worker.join(), signal))
    })
}

fn panic_message(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<&str>().copied();
    text.or_else(|| panic.downcast_ref::<String>().map(String::as_str))
        .unwrap_or("panicked")
}

/// Runs work, with everything that it does in parallel, on `threads` threads, or on one for each core.
pub(crate) fn on_threads<T: Send>(
    threads: Option<usize>,
    work: impl FnOnce() -> Result<T> + Send,
) -> Result<T> {
    match threads {
        None => pool()?.install(work),
        Some(n) if (1..=MAX_THREADS).contains(&n) => new_pool(n)?.install(work),
        Some(n) => Err(Error::input(format!(
            "`threads` {n}: must be 1 to {MAX_THREADS}"
        ))),
    }
}

fn new_pool(threads: usize) -> Result<rayon::ThreadPool> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .stack_size(STACK_BYTES)
        .build()
        .map_err(Error::wrap)
}

/// The threads of one process.
struct Slot {
    process: u32,
    pool: rayon::ThreadPool,
}

/// Slots are leaked, so that this pointer is null or valid for ever. No lock guards it: a lock that another thread
/// holds during a fork would stay locked in the child.
static SLOT: AtomicPtr<Slot> = AtomicPtr::new(std::ptr::null_mut());

/// The threads of this process. A child of a fork has none of its parent's threads and would wait for them for ever, so
/// it gets its own.
fn pool() -> Result<&'static rayon::ThreadPool> {
    let process = std::process::id();
    let found = SLOT.load(Ordering::Acquire);
    // SAFETY: the pointer is null or that of a leaked slot, which nobody changes.
    if let Some(slot) = unsafe { found.as_ref() }
        && slot.process == process
    {
        return Ok(&slot.pool);
    }
    let made = Box::into_raw(Box::new(Slot {
        process,
        pool: new_pool(0)?,
    }));
    let winner = match SLOT.compare_exchange(found, made, Ordering::AcqRel, Ordering::Acquire) {
        Ok(_) => made,
        Err(other) => {
            // SAFETY: another thread was faster, and nobody else has seen this slot.
            drop(unsafe { Box::from_raw(made) });
            other
        }
    };
    // SAFETY: the slot of this process, leaked by this thread or by the faster one.
    Ok(unsafe { &(*winner).pool })
}

/// Panics, so that tests can see what becomes of it.
#[pyfunction]
#[pyo3(name = "_panic")]
pub(crate) fn panic_for_tests(py: Python<'_>, message: String) -> PyResult<()> {
    run(py, move |_| resume_unwind(Box::new(message)))
}
