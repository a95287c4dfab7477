//! `edits`: change one parameter of a built-in motion and see whether the sentence follows.

use std::collections::BTreeMap;

use radarllm_base::seed::derive_seed;
use radarllm_body::procedural::random_request;
use radarllm_metrics::ActionNamer;
use serde::Serialize;

use crate::{
    args::EditsArgs,
    commands::describe,
    error::{CliError, CliResult},
    input::{self, ClipOptions},
    output,
    recording::RecordingArgs,
};

/// Motions that take a side.
const SIDED: [&str; 8] = [
    "wave",
    "raise_arms",
    "punch",
    "kick",
    "throw",
    "knock",
    "point",
    "lunge",
];
/// Action changes that are tried: the first motion becomes the second.
const SWAPS: [(&str, &str); 4] = [
    ("walk", "sit_down"),
    ("walk", "run"),
    ("squat", "jumping_jack"),
    ("clap", "bow"),
];
/// Captions that the action namer learns from.
const NAMER_REQUESTS: u64 = 3000;

#[derive(Serialize)]
struct Row {
    kind: &'static str,
    from: String,
    to: String,
    from_caption: String,
    to_caption: String,
    followed: bool,
}

/// Runs the verb.
pub fn run(args: &EditsArgs) -> CliResult {
    let captioner = describe::load_captioner(args.model.as_deref())?;
    let namer = action_namer()?;
    let mut rows = Vec::new();
    for index in 0..args.count {
        let seed = derive_seed(args.seed, &format!("edit-{index}"));
        let (kind, from, to) = edit(index, seed);
        let mut captions = Vec::new();
        for motion in [&from, &to] {
            let options = ClipOptions {
                radar: None,
                format: None,
                recording: &RecordingArgs::default(),
                radar_height_m: 1.0,
                distance_m: 2.6 + (seed % 100) as f32 * 0.012,
                seed,
            };
            let clip = input::clip(motion, &options)?;
            captions.push(describe::describe(&captioner, &clip, String::new(), 1)?.caption);
        }
        let followed = follows(kind, &from, &to, &captions, &namer);
        let [from_caption, to_caption] = <[String; 2]>::try_from(captions).unwrap_or_default();
        rows.push(Row {
            kind,
            from,
            to,
            from_caption,
            to_caption,
            followed,
        });
    }
    let mut shares: BTreeMap<&str, [usize; 2]> = BTreeMap::new();
    for row in &rows {
        for name in [row.kind, "all"] {
            let entry = shares.entry(name).or_default();
            entry[0] += usize::from(row.followed);
            entry[1] += 1;
        }
    }
    if args.json {
        return output::print_json(&serde_json::json!({ "followed": shares, "rows": rows }));
    }
    for row in &rows {
        let mark = if row.followed { "yes" } else { "NO " };
        output::print_line(&format!(
            "{mark} {}\n      {}\n    {}\n      {}",
            row.from, row.from_caption, row.to, row.to_caption
        ));
    }
    for (name, [hits, count]) in shares {
        output::print_line(&format!(
            "{name}: the sentence followed {hits} of {count} edits"
        ));
    }
    Ok(())
}

/// The `index`-th edit: kinds in turn, motions and speeds drawn from the seed.
fn edit(index: usize, seed: u64) -> (&'static str, String, String) {
    let speed = 0.85 + (seed / 7 % 31) as f32 * 0.01;
    match index % 3 {
        0 => {
            let motion = SIDED[(seed % SIDED.len() as u64) as usize];
            let with = |side: &str| format!("builtin:{motion}?side={side}&speed={speed:.2}");
            ("side", with("left"), with("right"))
        }
        1 => {
            let with =
                |direction: &str| format!("builtin:walk?direction={direction}&speed={speed:.2}");
            ("direction", with("forward"), with("backward"))
        }
        _ => {
            let (from, to) = SWAPS[(seed % SWAPS.len() as u64) as usize];
            let with = |motion: &str| format!("builtin:{motion}?speed={speed:.2}");
            ("action", with(from), with(to))
        }
    }
}

fn follows(kind: &str, from: &str, to: &str, captions: &[String], namer: &ActionNamer) -> bool {
    let says = |index: usize, stem: &str| {
        captions[index]
            .split_whitespace()
            .any(|word| word.starts_with(stem))
    };
    match kind {
        "side" => says(0, "left") && !says(0, "right") && says(1, "right") && !says(1, "left"),
        "direction" => !says(0, "back") && says(1, "back"),
        _ => {
            let action = |motion: &str| {
                motion
                    .trim_start_matches("builtin:")
                    .split('?')
                    .next()
                    .unwrap_or("")
                    .to_string()
            };
            namer.name(&captions[0]) == Some(&action(from))
                && namer.name(&captions[1]) == Some(&action(to))
        }
    }
}

/// Learns to name actions from the library's own captions.
fn action_namer() -> CliResult<ActionNamer> {
    let mut pairs = Vec::new();
    for index in 0..NAMER_REQUESTS {
        let request = random_request(derive_seed(index, "edits/namer"));
        let action = request.action();
        pairs.extend(
            request
                .captions(index)
                .into_iter()
                .map(|caption| (caption, action.clone())),
        );
    }
    ActionNamer::fit(&pairs).ok_or_else(|| CliError::new("the motion library has no captions"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use radarllm_body::procedural::parse;

    #[test]
    fn every_edit_names_two_motions_that_exist_and_differ() {
        for index in 0..60 {
            let (_, from, to) = edit(index, derive_seed(3, &index.to_string()));
            assert_ne!(from, to);
            for motion in [&from, &to] {
                parse(motion).unwrap_or_else(|e| panic!("{motion}: {e}"));
            }
        }
    }

    #[test]
    fn a_sentence_follows_only_when_both_sides_are_right() {
        let namer =
            ActionNamer::fit(&[("a person walks", "walk"), ("a person sits", "sit_down")]).unwrap();
        let both =
            |a: &str, b: &str| follows("side", "", "", &[a.to_string(), b.to_string()], &namer);
        assert!(both("waves the left hand", "waves the right hand"));
        assert!(!both("waves the left hand", "waves the left hand"));
        assert!(!both(
            "waves both the left and right",
            "waves the right hand"
        ));
    }
}
