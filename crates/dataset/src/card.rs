//! Data set card: README.md of a data set directory, from its manifest alone.

use std::fmt::Write;

use crate::{Manifest, Split};

/// Markdown with the front matter by which Hugging Face `datasets` finds the splits.
pub(crate) fn dataset_card(manifest: &Manifest) -> String {
    let mut text =
        String::from("---\nlicense: other\nconfigs:\n- config_name: default\n  data_files:\n");
    for split in Split::ALL {
        if manifest.shards.iter().any(|s| s.split == split.name()) {
            let name = if split == Split::Val {
                "validation"
            } else {
                split.name()
            };
            let _ = writeln!(text, "  - split: {name}\n    path: data/{split}-*.parquet");
        }
    }
    let _ = write!(
        text,
        "---\n\n# {name}\n\nmmWave radar points with sentences, one row a clip. Radar: {radar}, {rate} frames/s. \
         Built by radarllm {version} with seed {seed}; configuration {config}.\n\n\
         | split | clips | shards | bytes |\n|---|---|---|---|\n",
        name = one_line(&manifest.name),
        radar = one_line(&manifest.radar),
        rate = manifest.frame_rate_hz,
        version = one_line(&manifest.tool_version),
        seed = manifest.seed,
        config = manifest.config_blake3,
    );
    for split in Split::ALL {
        let shards: Vec<_> = manifest
            .shards
            .iter()
            .filter(|s| s.split == split.name())
            .collect();
        let _ = writeln!(
            text,
            "| {split} | {} | {} | {} |",
            shards.iter().map(|s| s.rows).sum::<u64>(),
            shards.len(),
            shards.iter().map(|s| s.bytes).sum::<u64>()
        );
    }
    if manifest.n_failed > 0 {
        let _ = writeln!(
            text,
            "\n{} items could not be made; manifest.json says why.",
            manifest.n_failed
        );
    }
    if !manifest.skipped.is_empty() {
        let _ = writeln!(
            text,
            "\n{} motions of the sources are left out; manifest.json says why.",
            manifest.skipped.len()
        );
    }
    text.push_str(
        "\n## Columns\n\n\
         `points`: per radar frame a list of `[x, y, z, range, velocity, intensity]` in m, m/s and dB; \
         x right, y away from the radar, z up, radar at the origin, velocity positive when receding. \
         `frame_number`, `frame_time_s`: of each radar frame. `joints`: 22 SMPL-X body joints in m, same axes, \
         at `motion_fps`. `motion_features`: 263 HumanML3D values per motion frame. `captions`: reference \
         sentences. All clips of a `group` are in one split.\n\n## Sources and licences\n\n",
    );
    for l in &manifest.licences {
        let _ = writeln!(
            text,
            "- {}: {}. {}",
            one_line(&l.source),
            one_line(&l.licence),
            one_line(&l.attribution)
        );
    }
    text
}

/// Replaces characters by which a name could span several lines.
fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}
