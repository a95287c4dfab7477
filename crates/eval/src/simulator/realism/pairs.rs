//! A user's own recordings: `NAME.parquet` (points, as `process` writes them) beside `NAME.toml`, the
//! scene file that says what happened in front of the radar.

use std::{fs, path::Path};

use radarllm_dataset::read_points;
use radarllm_synth::{
    SynthError,
    scene::{OwnedScene, SceneFile},
    synthesizer::open_radar,
};

use super::{Driver, RealismConfig, RealismError, Take, read_text};

/// All pairs of a folder, by name. `base` is where the configuration's radar file is looked for.
///
/// # Errors
/// Unreadable or malformed files, or no pair at all.
pub fn read_takes(
    config: &RealismConfig,
    base: &Path,
    folder: &Path,
) -> Result<Vec<Take>, RealismError> {
    let carrier_hz = open_radar(&config.radar, base)?.carrier_hz();
    let mut recordings: Vec<_> = fs::read_dir(folder)
        .map_err(|e| RealismError::io(folder, &e))?
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| path.extension().is_some_and(|e| e == "parquet"))
        .collect();
    recordings.sort();
    let mut takes = Vec::new();
    for recording in recordings {
        let scene = recording.with_extension("toml");
        if !scene.is_file() {
            continue;
        }
        let wrong = |problem: String| RealismError::File {
            file: scene.display().to_string(),
            problem,
        };
        let text = read_text(&scene)?;
        let file = SceneFile::from_toml(&text).map_err(|e| wrong(e.to_string()))?;
        let owned =
            OwnedScene::open(&file, folder, carrier_hz).map_err(|e| wrong(e.to_string()))?;
        let name = recording
            .file_stem()
            .map(|s| s.to_string_lossy().into_owned())
            .unwrap_or_default();
        takes.push(Take {
            subject: "own".into(),
            part: name,
            class: takes.len(),
            frames: read_points(&recording).map_err(SynthError::from)?.frames,
            driver: Driver::Scene(Box::new(owned), file.sim_options()),
        });
    }
    if takes.is_empty() {
        return Err(RealismError::File {
            file: folder.display().to_string(),
            problem: "neither a NAME.parquet beside a NAME.toml, nor folders subjectN".into(),
        });
    }
    Ok(takes)
}
