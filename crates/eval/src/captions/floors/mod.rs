//! Captions without a language model, which a trained system must beat: retrieval by time warping, a sentence for a label,
//! a sentence for measured facts.
//!
//! All of them learn from training clips alone.

mod classes;
mod classifier;
mod facts;
mod retrieval;
mod rules;
mod windows;

pub use classifier::classified_captions;
pub use facts::{forest_facts_captions, measured_captions};
pub use retrieval::warped_captions;
pub use windows::window_facts_captions;

use radarllm_metrics::{rouge::rouge_l, tokens};

/// The text with the highest mean ROUGE-L with the others, the first on a tie; `None` without texts.
fn medoid<'a>(texts: &[&'a str]) -> Option<&'a str> {
    let words: Vec<Vec<String>> = texts.iter().map(|t| tokens::rouge_score(t)).collect();
    let mut best: Option<(f64, &str)> = None;
    for (i, text) in texts.iter().enumerate() {
        let others = words.iter().enumerate().filter(|(j, _)| *j != i);
        let sum: f64 = others
            .map(|(_, other)| rouge_l(&words[i], std::slice::from_ref(other)))
            .sum();
        if best.is_none_or(|(found, _)| sum > found) {
            best = Some((sum, text));
        }
    }
    best.map(|(_, text)| text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_medoid_is_the_most_ordinary_text() {
        let texts = [
            "a zebra sings",
            "a person walks forward",
            "a person walks",
            "a person walks slowly",
        ];
        assert_eq!(medoid(&texts), Some("a person walks"));
        assert_eq!(medoid(&["one"]), Some("one"));
        assert_eq!(medoid(&[]), None);
    }
}
