//! `--threads`.

use crate::error::CliResult;

/// Number of threads: as given, or one for each core.
pub fn threads(requested: Option<usize>) -> usize {
    requested.unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from))
}

/// Runs `work`, and everything that it runs in parallel, on this many threads; one for each core without a number.
pub fn on_threads<R: Send>(
    requested: Option<usize>,
    work: impl FnOnce() -> R + Send,
) -> CliResult<R> {
    // As deep as a main thread's: differentiation follows a network's whole graph.
    const STACK_BYTES: usize = 8 << 20;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(requested.unwrap_or(0))
        .stack_size(STACK_BYTES)
        .build()?;
    Ok(pool.install(work))
}
