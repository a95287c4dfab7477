//! The model as the pipeline uses it.

use radarllm::{Captioner, Clip};
use radarllm_serve::{
    activities::actions_of,
    pipeline::{Describe, Described},
};

/// Describes windows with a trained model.
pub struct Captions(pub Captioner);

impl Describe for Captions {
    fn describe(&mut self, clip: &Clip) -> Described {
        match self.0.describe(clip) {
            Ok(description) => match description.abstained {
                Some(reason) => Described::Abstained {
                    reason: reason.to_string(),
                },
                None => Described::Sentence {
                    actions: actions_of(&description.caption),
                    confidence: description.confidence.into(),
                    caption: description.caption,
                },
            },
            Err(error) => Described::Abstained {
                reason: error.to_string(),
            },
        }
    }
}

/// All actions that a sentence can state, in alphabetical order.
pub fn actions() -> Vec<String> {
    let patterns = radarllm_facts::lexicon::PATTERNS.iter();
    let mut actions: Vec<String> = patterns.map(|p| p.action.to_string()).collect();
    actions.sort();
    actions.dedup();
    actions
}
