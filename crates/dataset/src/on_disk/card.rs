//! Data set card: README.md of a data set directory, from its manifest alone.

use std::fmt::Write;

use crate::{Manifest, Split};

/// Markdown with the front matter by which Hugging Face `datasets` finds the splits and the Hub describes the data set.
pub(crate) fn dataset_card(manifest: &Manifest) -> String {
    let mut text = front_matter(manifest);
    let _ = write!(
        text,
        "\n# {name}\n\nmmWave radar points with sentences, one row a clip. Radar: {radar}, {rate} frames/s. \
         Built by radarllm {version} with seed {seed}; configuration {config}.\n\n\
         | split | clips | shards | bytes |\n|---|---|---|---|\n",
        name = one_line(&manifest.name),
        radar = one_line(&manifest.radar),
        rate = manifest.frame_rate_hz,
        version = one_line(&manifest.tool_version),
        seed = manifest.seed,
        config = one_line(&manifest.config_blake3),
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
         at `motion_fps`. `motion_features`: 263 HumanML3D values per motion frame. `rotations6d`: the first two columns of the 22 \
         joints' rotation matrices, the pelvis in the axes of the radar, others relative to their parents. \
         `body_height_m`: standing height. `captions`: reference \
         sentences. All clips of a `group` are in one split.\n\n\
         ## Sources and licences\n\n\
         The column `source` of a clip names its source. The licence is that of the motions and sentences; the radar \
         points of a source that is `synthetic` were simulated.\n\n\
         | source | licence | synthetic | attribution |\n|---|---|---|---|\n",
    );
    for l in &manifest.licences {
        let _ = writeln!(
            text,
            "| {} | {} | {} | {} |",
            cell(&l.source),
            cell(&l.licence),
            l.synthetic,
            cell(&l.attribution)
        );
    }
    text
}

/// The YAML between two lines of hyphens. Texts from outside are quoted.
fn front_matter(manifest: &Manifest) -> String {
    let mut text = format!(
        "---\npretty_name: {}\nlicense: other\nlicense_name: {}\ntask_categories:\n- other\n\
         tags:\n- radar\n- mmwave\n- point-cloud\n- human-motion\n",
        quoted(&one_line(&manifest.name)),
        license_name(manifest),
    );
    if manifest.licences.iter().any(|l| l.synthetic) {
        text.push_str("- synthetic\n");
    }
    let _ = write!(
        text,
        "size_categories:\n- {}\nconfigs:\n- config_name: default\n  data_files:\n",
        size_category(manifest.n_clips)
    );
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
    text.push_str("---\n");
    text
}

/// An identifier for the licences together: that of the only one, or a reference to the table of sources.
fn license_name(manifest: &Manifest) -> String {
    const MAX_BYTES: usize = 64;
    const SEVERAL: &str = "see-sources-and-licences";
    let mut names = manifest.licences.iter().map(|l| identifier(&l.licence));
    let first = names.next().unwrap_or_default();
    let is_one = names.all(|name| name == first) && !first.is_empty() && first.len() <= MAX_BYTES;
    if is_one { first } else { SEVERAL.into() }
}

/// Lower-case letters, digits and full stops with single hyphens between: `MIT OR Apache-2.0` becomes
/// `mit-or-apache-2.0`.
fn identifier(text: &str) -> String {
    text.to_ascii_lowercase()
        .split(|c: char| !c.is_ascii_alphanumeric() && c != '.')
        .filter(|word| !word.is_empty())
        .collect::<Vec<_>>()
        .join("-")
}

/// The Hub's name for the order of magnitude of a number of rows.
fn size_category(n_rows: u64) -> &'static str {
    match n_rows {
        ..1_000 => "n<1K",
        1_000..10_000 => "1K<n<10K",
        10_000..100_000 => "10K<n<100K",
        100_000..1_000_000 => "100K<n<1M",
        1_000_000..10_000_000 => "1M<n<10M",
        10_000_000..100_000_000 => "10M<n<100M",
        _ => "100M<n<1B",
    }
}

/// A text as a double-quoted YAML scalar, which is a JSON string.
fn quoted(text: &str) -> String {
    serde_json::Value::from(text).to_string()
}

/// Replaces characters by which a name could span several lines, and those that YAML does not allow.
fn one_line(text: &str) -> String {
    text.split(|c: char| c.is_whitespace() || c.is_control())
        .filter(|word| !word.is_empty())
        .collect::<Vec<_>>()
        .join(" ")
}

/// A text in a cell of a table.
fn cell(text: &str) -> String {
    one_line(text).replace('|', "\\|")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SourceLicence;

    fn manifest(name: &str, licences: &[(&str, &str, bool)]) -> Manifest {
        Manifest {
            schema_version: 1,
            name: name.into(),
            tool_version: "0".into(),
            radar: "r".into(),
            frame_rate_hz: 10.0,
            seed: 1,
            config_blake3: "0".into(),
            config_toml: String::new(),
            licences: licences
                .iter()
                .map(|&(source, licence, synthetic)| SourceLicence {
                    source: source.into(),
                    licence: licence.into(),
                    attribution: "a | b\nc".into(),
                    synthetic,
                })
                .collect(),
            skipped: Vec::new(),
            n_clips: 1000,
            n_failed: 0,
            shards: Vec::new(),
        }
    }

    #[test]
    fn the_card_states_name_licences_and_origin() {
        let one = dataset_card(&manifest("x", &[("procedural", "MIT OR Apache-2.0", true)]));
        for line in [
            "pretty_name: \"x\"",
            "license: other",
            "license_name: mit-or-apache-2.0",
            "- synthetic",
            "- 1K<n<10K",
            "| procedural | MIT OR Apache-2.0 | true | a \\| b c |",
        ] {
            assert!(one.lines().any(|l| l == line), "{line}: {one}");
        }
        let two = dataset_card(&manifest(
            "x",
            &[("a", "CC BY 4.0", false), ("b", "MIT", false)],
        ));
        assert!(
            two.contains("license_name: see-sources-and-licences\n"),
            "{two}"
        );
        assert!(
            two.contains("| a | CC BY 4.0 | false |") && !two.contains("- synthetic"),
            "{two}"
        );
        let long = "l".repeat(100);
        for licences in [&[][..], &[("a", "§", true)], &[("a", long.as_str(), true)]] {
            let card = dataset_card(&manifest("x", licences));
            assert!(
                card.contains("license_name: see-sources-and-licences\n"),
                "{card}"
            );
        }
    }

    #[test]
    fn names_cannot_leave_their_line_of_the_front_matter() {
        for name in [
            "a\n---\nlicense: mit",
            "\"}: &x *y",
            "#",
            "a: b\\",
            "\u{0}\u{7f}\u{85}é",
        ] {
            let card = front_matter(&manifest(name, &[("a", "x\nlicense: mit", true)]));
            assert_eq!(card.matches("\nlicense: ").count(), 1, "{card}");
            assert_eq!(card.lines().filter(|l| *l == "---").count(), 2, "{card}");
            let quoted = card
                .lines()
                .nth(1)
                .unwrap()
                .strip_prefix("pretty_name: ")
                .unwrap();
            assert!(!card.contains(|c: char| c.is_control() && c != '\n'));
            let back: String = serde_json::from_str(quoted).unwrap();
            assert_eq!(back, one_line(name));
        }
    }

    #[test]
    fn sizes_are_those_of_the_hub() {
        for (n, name) in [
            (0, "n<1K"),
            (999, "n<1K"),
            (1000, "1K<n<10K"),
            (5_000_000, "1M<n<10M"),
        ] {
            assert_eq!(size_category(n), name);
        }
    }
}
