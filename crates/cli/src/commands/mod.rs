//! One file a verb.

#[cfg(feature = "train")]
pub mod ablate;
pub mod calibrate;
pub mod dataset;
pub mod demo;
pub mod describe;
pub mod doctor;
pub mod edits;
pub mod eval;
pub mod eval_page;
pub mod eval_recordings;
pub mod judge;
#[cfg(feature = "train")]
pub mod lm;
#[cfg(feature = "train")]
pub mod model_scores;
pub mod motion;
pub mod pictures;
pub mod pose_scores;
pub mod process;
pub mod radar;
pub mod realism;
pub mod robustness;
pub mod score;
pub mod simulate;
#[cfg(feature = "train")]
pub mod train;
pub mod view;

/// `--threads`, or one for every core.
pub fn threads(asked: Option<usize>) -> usize {
    asked.unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from))
}

/// Runs `work`, and all that it divides among threads, on so many; one for every core without a number.
pub fn on_threads<R: Send>(
    asked: Option<usize>,
    work: impl FnOnce() -> R + Send,
) -> crate::error::CliResult<R> {
    // As deep as a main thread's: differentiation follows a network's whole graph.
    const STACK_BYTES: usize = 8 << 20;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(asked.unwrap_or(0))
        .stack_size(STACK_BYTES)
        .build()?;
    Ok(pool.install(work))
}
