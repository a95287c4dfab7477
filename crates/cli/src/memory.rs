//! Memory of this process.

use std::path::Path;

use radarllm_files::bounded::{self, MAX_CONFIG_BYTES};

/// Peak resident memory of this process, MB, where the system reports it.
pub(crate) fn peak_memory_mb() -> Option<f64> {
    let status = bounded::read_text(Path::new("/proc/self/status"), MAX_CONFIG_BYTES).ok()?;
    let line = status.lines().find(|l| l.starts_with("VmHWM:"))?;
    line.split_whitespace()
        .nth(1)?
        .parse::<f64>()
        .ok()
        .map(|kb| kb / 1024.0)
}
