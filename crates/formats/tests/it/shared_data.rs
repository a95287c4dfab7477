//! Recordings that lie beside the repository and are not part of it.

use crate::ti_files::shared;

/// A file of the shared data, or `None` and a line that says that the test is skipped.
pub fn shared_file(name: &str) -> Option<Vec<u8>> {
    let bytes = shared().and_then(|folder| std::fs::read(folder.join("data").join(name)).ok());
    if bytes.is_none() {
        println!("skipped: {name} is not in the shared data (RADARLLM_SHARED)");
    }
    bytes
}
