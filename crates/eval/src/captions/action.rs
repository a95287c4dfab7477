//! Action accuracy: the share of captions in which a text classifier recognises the clip's action.
//!
//! The classifier is fitted on training captions. It also makes mistakes on reference captions; its accuracy on the
//! references of the evaluated split is the highest action accuracy that captions like them can reach.
//!
//! ```
//! use radarllm_eval::ActionClassifier;
//!
//! let training = [
//!     ("a person walks forward", "walk"),
//!     ("someone is walking slowly", "walk"),
//!     ("a person waves the left hand", "wave"),
//! ];
//! let classifier = ActionClassifier::fit(&training).unwrap();
//! assert_eq!(classifier.classify("the person is walking"), Some("walk"));
//! // No word of this caption occurs in training.
//! assert_eq!(classifier.classify("zebra"), None);
//! // Two captions for two clips in which somebody waves: one names the action.
//! let captions = [("waves a hand", "wave"), ("walks forward", "wave")];
//! assert_eq!(classifier.accuracy(&captions), Some(0.5));
//! ```

use std::collections::{BTreeMap, HashMap};

use radarllm_metrics::tokens;

/// Multinomial naive Bayes over word unigrams and bigrams with Laplace smoothing.
#[derive(Clone, Debug)]
pub struct ActionClassifier {
    /// Labels, sorted.
    actions: Vec<String>,
    /// ln of the share of captions, per action.
    ln_prior: Vec<f64>,
    /// Row of each feature in `ln_likelihood`.
    features: HashMap<String, usize>,
    /// `[feature][action]`.
    ln_likelihood: Vec<f64>,
}

impl ActionClassifier {
    /// Fits the classifier to (caption, action) pairs, in any order; `None` without pairs.
    pub fn fit<C: AsRef<str>, A: AsRef<str>>(pairs: &[(C, A)]) -> Option<Self> {
        let mut n_captions: BTreeMap<&str, f64> = BTreeMap::new();
        for (_, action) in pairs {
            *n_captions.entry(action.as_ref()).or_default() += 1.0;
        }
        if pairs.is_empty() {
            return None;
        }
        let actions: Vec<String> = n_captions.keys().map(|a| (*a).to_string()).collect();
        let n_actions = actions.len();
        let number: HashMap<&str, usize> = n_captions
            .keys()
            .enumerate()
            .map(|(i, a)| (*a, i))
            .collect();

        let mut features: HashMap<String, usize> = HashMap::new();
        let mut counts: Vec<f64> = Vec::new();
        let mut totals = vec![0.0; n_actions];
        for (caption, action) in pairs {
            let action = number[action.as_ref()];
            for feature in features_of(caption.as_ref()) {
                let next = features.len();
                let row = *features.entry(feature).or_insert(next);
                if row == next {
                    counts.resize((next + 1) * n_actions, 0.0);
                }
                counts[row * n_actions + action] += 1.0;
                totals[action] += 1.0;
            }
        }
        let n_features = features.len() as f64;
        let ln_likelihood = counts
            .iter()
            .enumerate()
            .map(|(i, count)| ((count + 1.0) / (totals[i % n_actions] + n_features)).ln())
            .collect();
        let ln_prior = n_captions
            .values()
            .map(|n| (n / pairs.len() as f64).ln())
            .collect();
        Some(Self {
            actions,
            ln_prior,
            features,
            ln_likelihood,
        })
    }

    /// The most probable action, the first by name on a tie; `None` if no word of the caption was
    /// seen in training, because the prior alone does not depend on the caption.
    pub fn classify(&self, caption: &str) -> Option<&str> {
        let n_actions = self.actions.len();
        let mut scores = self.ln_prior.clone();
        let mut n_known = 0;
        for feature in features_of(caption) {
            let Some(row) = self.features.get(&feature) else {
                continue;
            };
            n_known += 1;
            for (score, ln) in scores
                .iter_mut()
                .zip(&self.ln_likelihood[row * n_actions..])
            {
                *score += ln;
            }
        }
        let best = scores
            .iter()
            .enumerate()
            .reduce(|a, b| if b.1 > a.1 { b } else { a })?;
        (n_known > 0).then(|| self.actions[best.0].as_str())
    }

    /// Share of (caption, action) pairs whose caption is classified as its action, 0..=1; `None` without pairs.
    pub fn accuracy<C: AsRef<str>, A: AsRef<str>>(&self, pairs: &[(C, A)]) -> Option<f64> {
        let is_correct =
            |(caption, action): &&(C, A)| self.classify(caption.as_ref()) == Some(action.as_ref());
        (!pairs.is_empty())
            .then(|| pairs.iter().filter(is_correct).count() as f64 / pairs.len() as f64)
    }
}

fn features_of(caption: &str) -> Vec<String> {
    let words = tokens::plain(caption);
    let bigrams: Vec<String> = words.windows(2).map(|w| w.join(" ")).collect();
    words.into_iter().chain(bigrams).collect()
}
