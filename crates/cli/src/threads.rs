//! `--threads`.

use crate::error::CliResult;

/// Number of threads: the requested number, or one per core.
pub(crate) fn threads(requested: Option<usize>) -> usize {
    requested.unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from))
}

/// Runs `work`, including everything that it runs in parallel, on the requested number of threads, or on one per core.
pub(crate) fn on_threads<R: Send>(
    requested: Option<usize>,
    work: impl FnOnce() -> R + Send,
) -> CliResult<R> {
    // Stack size of a main thread, because automatic differentiation recurses through the whole graph of a network.
    const STACK_BYTES: usize = 8 << 20;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(requested.unwrap_or(0))
        .stack_size(STACK_BYTES)
        .build()?;
    Ok(pool.install(work))
}
