//! Choosing among named activities instead of describing freely.

use std::collections::BTreeSet;

use radarllm_facts::{Action, parse};
use radarllm_inference::{Chosen, DescribeOptions, Description, PreparedClip, Segment, actions};
use radarllm_io::{Error, Result};
use radarllm_motions::people_request;

use crate::Captioner;

/// Most sentences by which an activity is scored.
const MAX_SENTENCES: usize = 24;
/// Number of random motions whose captions are searched for sentences of an activity.
const MOTIONS: u64 = 4000;

/// Activities to choose among, each with sentences that state it.
pub struct Choices {
    activities: Vec<(String, Vec<String>)>,
    unknown: Vec<String>,
}

impl Choices {
    /// Reads names of activities: "boxing", "jumping jacks", "waving with the left hand". An activity is scored by the
    /// sentences of the motion library that state the same action, with the same side and direction where the name states
    /// them. A name without an action of the library is scored as text: "a person is NAME"; see [`Self::unknown`].
    ///
    /// # Errors
    /// Fewer than two names, an empty name, or the same name twice.
    pub fn new<'a>(names: impl IntoIterator<Item = &'a str>) -> Result<Self> {
        let names: Vec<&str> = names.into_iter().map(str::trim).collect();
        let different: BTreeSet<_> = names.iter().filter(|name| !name.is_empty()).collect();
        if names.len() < 2 || different.len() < names.len() {
            return Err(Error::input("at least two different activities are needed")
                .with_hint("for example `boxing,squats,walking`"));
        }
        let first_action = |name: &&str| parse(name).iter().flat_map(|c| c.actions.clone()).next();
        let wanted: Vec<Option<Action>> = names.iter().map(first_action).collect();
        let mut sentences = vec![BTreeSet::new(); names.len()];
        for seed in 0..MOTIONS {
            let request = people_request(seed).request;
            for caption in request.captions(seed) {
                let clauses = parse(&caption);
                let [clause] = &clauses[..] else { continue };
                let [stated] = &clause.actions[..] else {
                    continue;
                };
                for (wanted, sentences) in wanted.iter().zip(&mut sentences) {
                    let matches = wanted.as_ref().is_some_and(|w| states(stated, w));
                    if matches && sentences.len() < MAX_SENTENCES {
                        sentences.insert(caption.clone());
                    }
                }
            }
            let is_done = |(w, s): (&Option<Action>, &BTreeSet<String>)| {
                w.is_none() || s.len() == MAX_SENTENCES
            };
            if wanted.iter().zip(&sentences).all(is_done) {
                break;
            }
        }
        let mut choices = Self {
            activities: Vec::with_capacity(names.len()),
            unknown: Vec::new(),
        };
        for (name, mut sentences) in names.into_iter().zip(sentences) {
            if sentences.is_empty() {
                sentences.insert(format!("a person is {name}"));
                choices.unknown.push(name.into());
            }
            let sentences = sentences.into_iter().collect();
            choices.activities.push((name.into(), sentences));
        }
        Ok(choices)
    }

    /// Names that state no action of the motion library. The model has not learned them, so that their probabilities mean
    /// little.
    pub fn unknown(&self) -> &[String] {
        &self.unknown
    }
}

/// Whether an action is the wanted one, with its side and direction if they are given. Walking without a direction is
/// also walking back and forth or in a circle.
fn states(stated: &Action, wanted: &Action) -> bool {
    let is_walking = wanted.name == "walk" && wanted.direction.is_none();
    (stated.name == wanted.name || is_walking && ["pace", "circle"].contains(&stated.name))
        && (wanted.side.is_none() || stated.side == wanted.side)
        && (wanted.direction.is_none() || stated.direction == wanted.direction)
}

impl Captioner {
    /// Replaces a description by the most probable sentence of the activity that fits a clip best. A description
    /// without a person stays as it is.
    pub(crate) fn choose(
        &self,
        clip: &PreparedClip,
        choices: &Choices,
        options: &DescribeOptions,
        description: &mut Description,
    ) -> Result<()> {
        if description.abstained.is_some() {
            return Ok(());
        }
        let activities = &choices.activities;
        let texts: Vec<String> = activities.iter().flat_map(|(_, s)| s.clone()).collect();
        let scored = self.model().networks()?.score_texts(clip, &texts, options);
        let windows = scored.map_err(Error::wrap)?;
        // Windows overlap and err alike, so that their probabilities are averaged instead of multiplied.
        let mut probability = vec![0.0_f32; activities.len()];
        let mut sums = vec![0.0_f32; texts.len()];
        for window in &windows {
            let mut rest = &window[..];
            let mut evidence = Vec::with_capacity(activities.len());
            for (_, sentences) in activities {
                let (own, others) = rest.split_at(sentences.len());
                evidence.push(log_mean_exp(own));
                rest = others;
            }
            let total = log_mean_exp(&evidence) + (evidence.len() as f32).ln();
            for (probability, evidence) in probability.iter_mut().zip(evidence) {
                *probability += (evidence - total).exp() / windows.len() as f32;
            }
            sums.iter_mut().zip(window).for_each(|(s, p)| *s += p);
        }
        let mut chosen: Vec<(usize, f32)> = probability.into_iter().enumerate().collect();
        chosen.sort_by(|a, b| b.1.total_cmp(&a.1));
        let (best, probability) = chosen[0];
        let first: usize = activities[..best].iter().map(|(_, s)| s.len()).sum();
        let sentences = &activities[best].1;
        let of = |i: &usize| -> f32 { sums[first + i] };
        let sentence = (0..sentences.len()).max_by(|a, b| of(a).total_cmp(&of(b)));
        let caption = sentence.map_or(String::new(), |i| sentences[i].clone());
        if let (Some(first), Some(last)) =
            (description.segments.first(), description.segments.last())
        {
            let segment = Segment {
                start_s: first.start_s,
                end_s: last.end_s,
                actions: actions(&caption),
                caption,
                confidence: probability,
                side_confidence: None,
                taught: None,
                guess: None,
            };
            description.set_segments(vec![segment]);
        }
        let chosen = chosen.into_iter().map(|(i, probability)| Chosen {
            activity: activities[i].0.clone(),
            probability,
        });
        description.choices = chosen.collect();
        Ok(())
    }
}

/// ln(mean(exp(x))).
fn log_mean_exp(x: &[f32]) -> f32 {
    let max = x.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    if max == f32::NEG_INFINITY {
        return max;
    }
    let sum: f32 = x.iter().map(|x| (x - max).exp()).sum();
    max + (sum / x.len() as f32).ln()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_become_sentences_that_state_them() {
        let choices = Choices::new([
            "boxing",
            "jumping jacks",
            "jumping",
            "squats",
            "walking",
            "waving with the left hand",
        ])
        .unwrap();
        let names = ["punch", "jumping_jack", "jump", "squat", "walk", "wave"];
        for ((activity, sentences), name) in choices.activities.iter().zip(names) {
            assert!(sentences.len() >= 8, "{activity}: {sentences:?}");
            let names = match name {
                "walk" => &["walk", "pace", "circle"][..],
                _ => &[name],
            };
            assert!(
                sentences
                    .iter()
                    .all(|s| matches!(&actions(s)[..], [a] if names.contains(a))),
                "{activity}: {sentences:?}"
            );
        }
        assert!(choices.activities[5].1.iter().all(|s| s.contains("left")));
        assert!(choices.unknown().is_empty());
        let choices = Choices::new(["boxing", "xyz"]).unwrap();
        assert_eq!(choices.unknown(), ["xyz"]);
        assert_eq!(choices.activities[1].1, ["a person is xyz"]);
        for wrong in [&["boxing"][..], &["boxing", "boxing"], &["boxing", ""]] {
            assert!(Choices::new(wrong.iter().copied()).is_err());
        }
    }

    #[test]
    fn mean_of_probabilities() {
        let logs = [0.5_f32.ln(), 0.25_f32.ln()];
        assert!((log_mean_exp(&logs).exp() - 0.375).abs() < 1e-6);
        assert_eq!(log_mean_exp(&[f32::NEG_INFINITY; 2]), f32::NEG_INFINITY);
    }
}
