//! A sentence for a label: what a classifier of actions is worth as a description.

use std::collections::BTreeMap;

use radarllm_base::random::SplitMix64;
use radarllm_dataset::ClipRecord;

use super::medoid;
use crate::{EvalError, descriptor::descriptor, forest::Forest};

/// Trees of the forest.
pub(super) const N_TREES: usize = 300;
/// Most captions of an action among which the medoid is looked for.
const MAX_CAPTIONS: usize = 200;

/// For each clip, the medoid training caption of the action that a forest recognises by [`descriptor`], and the share of
/// clips whose action is recognised.
///
/// # Errors
/// Training clips from which nothing can be learned.
pub fn classified_captions(
    train: &[ClipRecord],
    clips: &[ClipRecord],
    seed: u64,
) -> Result<(Vec<String>, f64), EvalError> {
    let mut captions: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for clip in train {
        let of_action = captions.entry(&clip.action).or_default();
        of_action.extend(clip.captions.iter().map(String::as_str));
    }
    let mut rng = SplitMix64::new(seed);
    let actions: Vec<&str> = captions.keys().copied().collect();
    let medoids: Vec<&str> = captions
        .into_values()
        .map(|mut texts| {
            // The first ones of a random order.
            for i in 0..texts.len().min(MAX_CAPTIONS) {
                let j = i + rng.below(texts.len() - i);
                texts.swap(i, j);
            }
            texts.truncate(MAX_CAPTIONS);
            medoid(&texts).unwrap_or_default()
        })
        .collect();
    let label = |clip: &ClipRecord| actions.binary_search(&clip.action.as_str()).ok();
    let labels: Vec<usize> = train.iter().filter_map(label).collect();
    let of = |clip: &ClipRecord| descriptor(&clip.frames, clip.radar_height_m);
    let rows: Vec<Vec<f32>> = train.iter().map(of).collect();
    let forest = Forest::fit(&rows, &labels, actions.len(), N_TREES, seed)
        .ok_or_else(|| EvalError::Empty("no training clips for a classifier".into()))?;
    let mut right = 0;
    let texts = clips
        .iter()
        .map(|clip| {
            let class = likeliest(&forest.probabilities(&of(clip)));
            right += usize::from(label(clip) == Some(class));
            medoids[class].to_string()
        })
        .collect();
    Ok((texts, right as f64 / clips.len().max(1) as f64))
}

/// Index of the highest probability, the first on a tie.
pub(super) fn likeliest(probabilities: &[f32]) -> usize {
    let pairs = probabilities.iter().enumerate();
    pairs
        .reduce(|best, next| if next.1 > best.1 { next } else { best })
        .map_or(0, |best| best.0)
}

#[cfg(test)]
mod tests {
    use super::{super::retrieval::tests::clip, *};

    #[test]
    fn a_recognised_action_gets_its_sentence() {
        let make = |id: usize, action: &str| {
            let shift = 0.01 * id as f32;
            match action {
                "come" => clip(&format!("{id}"), action, 40, move |t| {
                    [shift, 4.0 - 2.0 * t, 0.0]
                }),
                _ => clip(&format!("{id}"), action, 40, move |t| {
                    [shift, 3.0, 0.4 - 0.8 * t]
                }),
            }
        };
        let train: Vec<ClipRecord> = (0..20).map(|i| make(i, ["come", "sit"][i % 2])).collect();
        let clips = [make(30, "come"), make(31, "sit")];
        let (texts, accuracy) = classified_captions(&train, &clips, 1).unwrap();
        assert_eq!(
            (texts, accuracy),
            (vec!["come".to_string(), "sit".into()], 1.0)
        );
        assert!(classified_captions(&[], &clips, 1).is_err());
    }
}
