//! Bodies that a pose network estimates. Builds without training have no networks that estimate.

use std::path::Path;

use radarllm_base::Motion;
use radarllm_dataset::ClipRecord;

use crate::error::CliResult;

/// The motions of clips of the data set `data`, estimated by the pose network in a folder.
#[cfg(feature = "train")]
pub(super) fn bodies(pose: &Path, data: &str, clips: &[ClipRecord]) -> CliResult<Vec<Motion>> {
    use crate::error::CliError;
    let estimator = radarllm_nn::pose::PoseEstimator::load(pose)?;
    if !estimator.data().iter().any(|name| name == data) {
        let problem = format!(
            "{}: trained on the data set {}, and the clips are of `{data}`",
            pose.display(),
            estimator
                .data()
                .iter()
                .map(|name| format!("`{name}`"))
                .collect::<Vec<_>>()
                .join(", ")
        );
        return Err(
            CliError::new(problem).hint("a pose network estimates clips of its own data set")
        );
    }
    let estimate = |clip: &ClipRecord| {
        let motion = estimator.estimate(&clip.frames, clip.radar_height_m);
        motion.map_err(|e| CliError::new(format!("clip {}: {e}", clip.id)))
    };
    clips.iter().map(estimate).collect()
}

/// The motions of clips, estimated.
#[cfg(not(feature = "train"))]
pub(super) fn bodies(_: &Path, _: &str, _: &[ClipRecord]) -> CliResult<Vec<Motion>> {
    Err(crate::error::needs_training("`baselines render --pose`"))
}

/// Hash of the weights of a pose network.
pub(super) fn hash(pose: &Path) -> CliResult<String> {
    use radarllm_inference::checkpoint::MODEL_FILE;
    const MAX_BYTES: u64 = 1 << 30;
    let bytes = radarllm_files::bounded::read_bytes(&pose.join(MODEL_FILE), MAX_BYTES)?;
    Ok(blake3::hash(&bytes).to_hex().to_string())
}
