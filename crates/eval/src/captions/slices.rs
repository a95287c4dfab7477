//! The model's captions by part of the split: by action, by length, by number of actions; confusions.

use std::collections::BTreeMap;

use radarllm_metrics::bootstrap::units_of_ids;

use super::{CaptionedClip, Confusion, Slice, facts::same_actions, mean};
use crate::EvalError;

/// Edges of the bins of clip lengths, s.
const LENGTH_EDGES_S: [f64; 4] = [2.0, 4.0, 6.0, 8.0];
/// Confusions that are listed.
const MAX_CONFUSIONS: usize = 30;

/// Slices by action.
pub(super) fn by_action(clips: &[CaptionedClip], seed: u64) -> Result<Vec<Slice>, EvalError> {
    slices(clips, seed, String::clone, |c| Some(c.action.clone()))
}

/// Slices by length of the clip.
pub(super) fn by_length(clips: &[CaptionedClip], seed: u64) -> Result<Vec<Slice>, EvalError> {
    slices(
        clips,
        seed,
        |bin| length_name(*bin),
        |c| Some(length_bin(c.clip.duration_s())),
    )
}

/// Slices by number of actions in the clip.
pub(super) fn by_n_actions(clips: &[CaptionedClip], seed: u64) -> Result<Vec<Slice>, EvalError> {
    slices(clips, seed, |n| n.to_string(), n_actions)
}

/// One slice for every key; clips without a key are left out.
fn slices<K: Ord>(
    clips: &[CaptionedClip],
    seed: u64,
    name: impl Fn(&K) -> String,
    key: impl Fn(&CaptionedClip) -> Option<K>,
) -> Result<Vec<Slice>, EvalError> {
    let mut groups: BTreeMap<K, Vec<&CaptionedClip>> = BTreeMap::new();
    for clip in clips {
        if let Some(key) = key(clip) {
            groups.entry(key).or_default().push(clip);
        }
    }
    let slice = |(key, members): (K, Vec<&CaptionedClip>)| {
        let units = units_of_ids(members.iter().map(|c| c.id.as_str()));
        let correct: Vec<f64> = members
            .iter()
            .map(|c| f64::from(u8::from(c.is_action_correct())))
            .collect();
        let same: Vec<f64> = members
            .iter()
            .map(|c| same_actions(&c.description.caption, &c.references))
            .collect();
        let rouge_l: Vec<f64> = members.iter().map(|c| c.rouge_l).collect();
        Ok(Slice {
            name: name(&key),
            clips: members.len(),
            action_accuracy: mean(&correct, &units, seed)?,
            same_actions: mean(&same, &units, seed)?,
            rouge_l: mean(&rouge_l, &units, seed)?,
        })
    };
    groups.into_iter().map(slice).collect()
}

/// Number of the bin of a clip's length.
fn length_bin(seconds: f64) -> usize {
    // A clip of 20 frames at 10 Hz lasts 2 s, whatever the division rounds to.
    LENGTH_EDGES_S
        .iter()
        .filter(|edge| seconds + 1e-9 >= **edge)
        .count()
}

fn length_name(bin: usize) -> String {
    let edge = |i: usize| LENGTH_EDGES_S.get(i).copied();
    match (bin.checked_sub(1).and_then(edge), edge(bin)) {
        (None, Some(high)) => format!("under {high} s"),
        (Some(low), Some(high)) => format!("{low} to {high} s"),
        (Some(low), None) => format!("{low} s and more"),
        (None, None) => "all".into(),
    }
}

/// Number of actions in a clip. Labels of built-in motions are composed with "then" and "while"; labels of other
/// sources do not show it.
fn n_actions(clip: &CaptionedClip) -> Option<usize> {
    let joined = |word: &str| clip.action.matches(word).count();
    (clip.source == "procedural").then(|| 1 + joined(" then ") + joined(" while "))
}

/// Clips whose captions are classified as another action, most frequent first.
pub(super) fn confusions(clips: &[CaptionedClip]) -> Vec<Confusion> {
    let mut counts: BTreeMap<(&str, Option<&str>), usize> = BTreeMap::new();
    for clip in clips.iter().filter(|c| !c.is_action_correct()) {
        let pair = (clip.action.as_str(), clip.classified_as.as_deref());
        *counts.entry(pair).or_default() += 1;
    }
    let mut confusions: Vec<Confusion> = counts
        .into_iter()
        .map(|((action, named), clips)| Confusion {
            action: action.into(),
            named: named.map(Into::into),
            clips,
        })
        .collect();
    confusions.sort_by_key(|c| std::cmp::Reverse(c.clips));
    confusions.truncate(MAX_CONFUSIONS);
    confusions
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::captions::tests::captioned;

    #[test]
    fn lengths_fall_into_their_bins() {
        let name = |seconds: f64| length_name(length_bin(seconds));
        assert_eq!(name(0.0), "under 2 s");
        assert_eq!(name(1.99), "under 2 s");
        assert_eq!(name(20.0 / 10.0), "2 to 4 s");
        // 60 frames at a rate that is no exact tenth of a second.
        assert_eq!(name(60.0 * 0.1_f32 as f64), "6 to 8 s");
        assert_eq!(name(9.6), "8 s and more");
    }

    #[test]
    fn actions_are_counted_where_the_label_shows_them() {
        let n = |action: &str, source: &str| {
            let mut clip = captioned("m#0", action, None);
            clip.source = source.into();
            n_actions(&clip)
        };
        assert_eq!(n("walk", "procedural"), Some(1));
        assert_eq!(n("walk then sit_down", "procedural"), Some(2));
        assert_eq!(n("march while clap then bow", "procedural"), Some(3));
        assert_eq!(n("walk then sit", "bandai-namco"), None);
    }

    #[test]
    fn confusions_leave_out_what_is_correct() {
        let clips = [
            captioned("a#0", "walk", Some("walk")),
            captioned("b#0", "sit", Some("walk")),
            captioned("c#0", "sit", Some("walk")),
            captioned("d#0", "walk", None),
        ];
        let found = confusions(&clips);
        let rows: Vec<_> = found
            .iter()
            .map(|c| (c.action.as_str(), c.named.as_deref(), c.clips))
            .collect();
        assert_eq!(rows, [("sit", Some("walk"), 2), ("walk", None, 1)]);
        let rows = by_action(&clips, 1).unwrap();
        let rows: Vec<_> = rows
            .iter()
            .map(|s| (s.name.as_str(), s.clips, s.action_accuracy.value))
            .collect();
        assert_eq!(rows, [("sit", 2, 0.0), ("walk", 2, 0.5)]);
    }

    /// The classifier has its own view; the facts of the sentence decide whether its actions are the reference's.
    #[test]
    fn same_actions_are_those_of_a_reference_in_order() {
        let clip = |id: &str, caption: &str| {
            let mut clip = captioned(id, "sit_down then wave", None);
            clip.description.caption = caption.into();
            clip.references = vec!["a person sits down, then waves".into()];
            clip
        };
        let clips = [
            clip(
                "a#0",
                "someone takes a seat and then waves with the left hand",
            ),
            clip("b#0", "a person waves, then sits down"),
            clip("c#0", "a person sits down"),
            clip("d#0", ""),
        ];
        let rows = by_action(&clips, 1).unwrap();
        assert_eq!(rows[0].same_actions.value, 0.25);
        // Words without a known action agree on nothing.
        assert_eq!(same_actions("hm", &["hm".into()]), 0.0);
    }
}
