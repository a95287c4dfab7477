//! Sentences with times against labelled times: temporal intersection over union, and SODA.
//!
//! SODA (Fujita, Hirao, Kamigaito, Okumura and Nagata, ECCV 2020) aligns the sentences of a recording with the references
//! in order of time, such that the sum of the products of overlap and similarity is largest, and divides this sum by the
//! number of sentences (precision) and of references (recall). A recording that is cut into more sentences than it has
//! events therefore loses precision, which the mean over matched pairs does not show.
//!
//! ```
//! use radarllm_metrics::dense::{Timed, soda, temporal_iou};
//!
//! assert_eq!(temporal_iou([0.0, 6.0], [4.0, 8.0]), 0.25);
//! let timed = |span_s, sentence| Timed { span_s, sentence };
//! let said = [timed([0.0, 5.0], "sits"), timed([5.0, 10.0], "walks")];
//! let truth = [timed([0.0, 10.0], "sits")];
//! let score = soda(&said, &truth, |a, b| f64::from(u8::from(a == b))).unwrap();
//! // One pair with an overlap of a half, of two sentences and one reference.
//! assert_eq!((score.precision, score.recall), (0.25, 0.5));
//! ```

use serde::Serialize;

/// A sentence and its time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Timed<'a> {
    /// Beginning and end, s.
    pub span_s: [f64; 2],
    /// The sentence.
    pub sentence: &'a str,
}

/// How well sentences with times agree with references.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Dense {
    /// Sum over the aligned pairs, divided by the number of sentences.
    pub precision: f64,
    /// The same sum, divided by the number of references.
    pub recall: f64,
    /// Harmonic mean of both, which SODA reports.
    pub f1: f64,
}

/// Length of the common time of two spans, divided by that of the time of either; 0 for spans without a length.
pub fn temporal_iou(a_s: [f64; 2], b_s: [f64; 2]) -> f64 {
    let common_s = (a_s[1].min(b_s[1]) - a_s[0].max(b_s[0])).max(0.0);
    let either_s = (a_s[1] - a_s[0]).max(0.0) + (b_s[1] - b_s[0]).max(0.0) - common_s;
    match either_s > 0.0 {
        true => common_s / either_s,
        false => 0.0,
    }
}

/// SODA of the sentences of one recording: with METEOR as similarity it is SODA_c of the paper, with 1 for every pair the
/// agreement of the times alone. `None` without references; all values are 0 without sentences.
pub fn soda(
    said: &[Timed],
    references: &[Timed],
    mut similarity: impl FnMut(&str, &str) -> f64,
) -> Option<Dense> {
    if references.is_empty() {
        return None;
    }
    let in_order = |sentences: &[Timed]| {
        let mut sorted: Vec<_> = sentences
            .iter()
            .map(|s| (s.span_s, s.sentence.to_string()))
            .collect();
        sorted.sort_by(|(a, _), (b, _)| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
        sorted
    };
    let (said, references) = (in_order(said), in_order(references));
    // The best sum of the first sentences and each number of references; one row at a time.
    let mut best = vec![0.0; references.len() + 1];
    for (span_s, sentence) in &said {
        let before = best.clone();
        for (j, (reference_s, reference)) in references.iter().enumerate() {
            let overlap = temporal_iou(*span_s, *reference_s);
            let gain = match overlap > 0.0 {
                true => overlap * similarity(sentence, reference),
                false => 0.0,
            };
            best[j + 1] = f64::max(before[j] + gain, f64::max(before[j + 1], best[j]));
        }
    }
    let sum: f64 = best.last().copied().unwrap_or_default();
    let precision = sum / said.len().max(1) as f64;
    let recall = sum / references.len() as f64;
    let f1 = match precision + recall > 0.0 {
        true => 2.0 * precision * recall / (precision + recall),
        false => 0.0,
    };
    Some(Dense {
        precision,
        recall,
        f1,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn timed(start_s: f64, end_s: f64, sentence: &str) -> Timed<'_> {
        Timed {
            span_s: [start_s, end_s],
            sentence,
        }
    }

    fn same(a: &str, b: &str) -> f64 {
        f64::from(u8::from(a == b))
    }

    #[test]
    fn overlap_of_spans() {
        assert_eq!(temporal_iou([0.0, 10.0], [0.0, 10.0]), 1.0);
        assert_eq!(temporal_iou([0.0, 10.0], [10.0, 20.0]), 0.0);
        assert_eq!(temporal_iou([2.0, 4.0], [0.0, 8.0]), 0.25);
        assert_eq!(temporal_iou([3.0, 3.0], [3.0, 3.0]), 0.0);
    }

    #[test]
    fn a_perfect_timeline_has_one_and_another_order_does_not_matter() {
        let truth = [
            timed(0.0, 5.0, "a"),
            timed(5.0, 9.0, "b"),
            timed(9.0, 20.0, "c"),
        ];
        let mut said = truth;
        said.reverse();
        let score = soda(&said, &truth, same).unwrap();
        assert_eq!((score.precision, score.recall, score.f1), (1.0, 1.0, 1.0));
    }

    /// Every alignment that keeps the order is tried instead.
    #[test]
    fn the_alignment_is_the_best_one() {
        fn best(said: &[Timed], truth: &[Timed]) -> f64 {
            let ([first, said @ ..], [reference, truth @ ..]) = (said, truth) else {
                return 0.0;
            };
            let gain = temporal_iou(first.span_s, reference.span_s)
                * same(first.sentence, reference.sentence);
            let with = gain + best(said, truth);
            let skip_said = best(said, &[&[*reference], truth].concat());
            let skip_truth = best(&[&[*first], said].concat(), truth);
            with.max(skip_said).max(skip_truth)
        }
        let words = ["a", "b"];
        let timeline = |seed: u64, n: usize| -> Vec<Timed<'static>> {
            let mut state = seed;
            let mut next = |below: u64| {
                state = state
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1);
                (state >> 33) % below
            };
            let mut out: Vec<Timed> = (0..n)
                .map(|_| {
                    let start_s = next(20) as f64;
                    timed(
                        start_s,
                        start_s + 1.0 + next(10) as f64,
                        words[next(2) as usize],
                    )
                })
                .collect();
            out.sort_by(|a, b| {
                a.span_s[0]
                    .total_cmp(&b.span_s[0])
                    .then(a.span_s[1].total_cmp(&b.span_s[1]))
            });
            out
        };
        for seed in 0..40 {
            let (said, truth) = (timeline(seed, 5), timeline(seed + 100, 4));
            let score = soda(&said, &truth, same).unwrap();
            assert!(
                (score.precision * 5.0 - best(&said, &truth)).abs() < 1e-9,
                "{seed}"
            );
            assert!(
                (score.recall * 4.0 - best(&said, &truth)).abs() < 1e-9,
                "{seed}"
            );
        }
    }

    #[test]
    fn nothing_said_is_nothing_and_nothing_labelled_is_no_score() {
        let truth = [timed(0.0, 5.0, "a")];
        let nothing = soda(&[], &truth, same).unwrap();
        assert_eq!(
            (nothing.precision, nothing.recall, nothing.f1),
            (0.0, 0.0, 0.0)
        );
        assert_eq!(soda(&truth, &[], same), None);
    }
}
