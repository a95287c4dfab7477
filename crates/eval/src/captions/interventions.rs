//! Does a caption follow its cause? A causal probe: one parameter of a built-in motion is changed, everything else
//! stays, and the caption must change accordingly.
//!
//! Three kinds of interventions are applied in turn: left or right side, forward or backward walk, one action or
//! another. An intervention counts as followed only if both captions are right: before and after.

use std::collections::BTreeMap;

use radarllm_base::{Clip, RadarConfig, seed::derive_seed};
use radarllm_inference::Captioner;
use radarllm_motions::random_request;
use radarllm_synth::{SimulateOptions, simulate_motion};
use rayon::prelude::*;
use serde::Serialize;

use crate::{ActionClassifier, EvalError, captioner::caption_clips};

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
/// Changes of the action: the first motion becomes the second.
const ACTION_CHANGES: [(&str, &str); 4] = [
    ("walk", "sit_down"),
    ("walk", "run"),
    ("squat", "jumping_jack"),
    ("clap", "bow"),
];
/// Random motions whose captions the action classifier is fitted on.
const N_CLASSIFIER_MOTIONS: u64 = 3000;

/// Which interventions are applied.
#[derive(Clone, Debug)]
pub struct InterventionOptions {
    /// Number of interventions; the three kinds take turns.
    pub count: usize,
    /// Seed of motions, placement and noise.
    pub seed: u64,
}

/// One intervention and what became of the caption.
#[derive(Clone, Debug, Serialize)]
pub struct Intervention {
    /// Whether both captions are right.
    pub followed: bool,
    /// The motion before.
    pub from: String,
    /// Caption of the motion before.
    pub from_caption: String,
    /// `side`, `direction` or `action`.
    pub kind: &'static str,
    /// The motion after.
    pub to: String,
    /// Caption of the motion after.
    pub to_caption: String,
}

/// All interventions.
#[derive(Clone, Debug, Serialize)]
pub struct InterventionReport {
    /// Followed interventions and their number, by kind and for `all`.
    pub followed: BTreeMap<&'static str, [usize; 2]>,
    /// Each intervention.
    pub rows: Vec<Intervention>,
}

/// Simulates the motions before and after every intervention with the reference radar, and captions both. Simulations
/// run on the threads of the rayon pool from which this is called.
///
/// # Errors
/// A motion that cannot be simulated or a clip that the model refuses.
pub fn evaluate_interventions(
    captioner: &Captioner,
    options: &InterventionOptions,
) -> Result<InterventionReport, EvalError> {
    let classifier = library_classifier()?;
    let pairs: Vec<(&'static str, [String; 2], u64)> = (0..options.count)
        .map(|index| {
            let seed = derive_seed(options.seed, &format!("edit-{index}"));
            let (kind, from, to) = intervention(index, seed);
            (kind, [from, to], seed)
        })
        .collect();
    let motions: Vec<(&str, u64)> = pairs
        .iter()
        .flat_map(|(_, motions, seed)| motions.iter().map(|m| (m.as_str(), *seed)))
        .collect();
    let radar = RadarConfig::awr1843boost();
    let clips = motions
        .into_par_iter()
        .map(|(motion, seed)| simulate(motion, &radar, seed))
        .collect::<Result<Vec<Clip>, EvalError>>()?;
    let captions = caption_clips(captioner, &clips.iter().collect::<Vec<_>>(), None)?;
    let captions: Vec<[String; 2]> = captions
        .chunks_exact(2)
        .map(|pair| [0, 1].map(|i| pair[i].caption.clone()))
        .collect();
    let rows: Vec<Intervention> = pairs
        .into_iter()
        .zip(captions)
        .map(|((kind, [from, to], _), captions)| {
            let followed = is_followed(kind, [&from, &to], &captions, &classifier);
            let [from_caption, to_caption] = captions;
            Intervention {
                kind,
                from,
                to,
                from_caption,
                to_caption,
                followed,
            }
        })
        .collect();
    let mut followed: BTreeMap<&str, [usize; 2]> = BTreeMap::new();
    for row in &rows {
        for name in [row.kind, "all"] {
            let entry = followed.entry(name).or_default();
            entry[0] += usize::from(row.followed);
            entry[1] += 1;
        }
    }
    Ok(InterventionReport { followed, rows })
}

/// Simulates a built-in motion on boresight, 2.6 to 3.8 m away. The seed determines distance, variations and noise.
fn simulate(motion: &str, radar: &RadarConfig, seed: u64) -> Result<Clip, EvalError> {
    let options = SimulateOptions {
        seed,
        distance_m: 2.6 + (seed % 100) as f32 * 0.012,
        ..SimulateOptions::default()
    };
    Ok(simulate_motion(motion, radar, &options)?.clip)
}

/// The `index`-th intervention: kinds take turns, motions and speeds are drawn from the seed.
fn intervention(index: usize, seed: u64) -> (&'static str, String, String) {
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
            let (from, to) = ACTION_CHANGES[(seed % ACTION_CHANGES.len() as u64) as usize];
            let with = |motion: &str| format!("builtin:{motion}?speed={speed:.2}");
            ("action", with(from), with(to))
        }
    }
}

fn is_followed(
    kind: &str,
    motions: [&str; 2],
    captions: &[String; 2],
    classifier: &ActionClassifier,
) -> bool {
    let has_word = |index: usize, stem: &str| {
        captions[index]
            .split_whitespace()
            .any(|word| word.starts_with(stem))
    };
    match kind {
        "side" => {
            has_word(0, "left")
                && !has_word(0, "right")
                && has_word(1, "right")
                && !has_word(1, "left")
        }
        "direction" => !has_word(0, "back") && has_word(1, "back"),
        _ => motions.iter().zip(captions).all(|(motion, caption)| {
            let action = motion.trim_start_matches("builtin:").split('?').next();
            classifier.classify(caption) == action
        }),
    }
}

/// A classifier fitted on the captions of the motion library.
fn library_classifier() -> Result<ActionClassifier, EvalError> {
    let mut pairs = Vec::new();
    for index in 0..N_CLASSIFIER_MOTIONS {
        let request = random_request(derive_seed(index, "edits/namer"));
        let action = request.action();
        pairs.extend(
            request
                .captions(index)
                .into_iter()
                .map(|caption| (caption, action.clone())),
        );
    }
    ActionClassifier::fit(&pairs)
        .ok_or_else(|| EvalError::Empty("the motion library has no captions".into()))
}

#[cfg(test)]
mod tests {
    use radarllm_motions::parse;

    use super::*;

    #[test]
    fn every_intervention_names_two_motions_that_exist_and_differ() {
        for index in 0..60 {
            let (_, from, to) = intervention(index, derive_seed(3, &index.to_string()));
            assert_ne!(from, to);
            for motion in [&from, &to] {
                parse(motion).unwrap_or_else(|e| panic!("{motion}: {e}"));
            }
        }
    }

    #[test]
    fn an_intervention_is_followed_only_if_both_captions_are_right() {
        let classifier =
            ActionClassifier::fit(&[("a person walks", "walk"), ("a person sits", "sit_down")])
                .unwrap();
        let followed = |kind: &str, motions, a: &str, b: &str| {
            is_followed(kind, motions, &[a.to_string(), b.to_string()], &classifier)
        };
        let side = |a: &str, b: &str| followed("side", ["", ""], a, b);
        assert!(side("waves the left hand", "waves the right hand"));
        assert!(!side("waves the left hand", "waves the left hand"));
        assert!(!side(
            "waves both the left and right",
            "waves the right hand"
        ));
        let actions = ["builtin:walk?speed=1.00", "builtin:sit_down?speed=1.00"];
        assert!(followed(
            "action",
            actions,
            "someone walks",
            "a person sits"
        ));
        assert!(!followed(
            "action",
            actions,
            "someone walks",
            "someone walks"
        ));
        let back = |a: &str, b: &str| followed("direction", ["", ""], a, b);
        assert!(back("walks forward", "walks backward") && !back("walks back", "walks back"));
    }
}
