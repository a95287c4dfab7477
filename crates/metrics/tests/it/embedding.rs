//! BERTScore and SimCSE arithmetic against bert_score's functions; see goldens/embeddings.py.

use std::collections::BTreeMap;

use radarllm_metrics::embedding::{BertScore, Idf, Padding, Sentence, bert_score, cosine, padding};
use serde::Deserialize;

#[derive(Deserialize)]
struct Goldens {
    dimension: usize,
    pairs: Vec<Pair>,
    /// Score of every pair of `pairs` where all of them, over and over, are compared in batches of 64.
    batches: Vec<[f64; 3]>,
    documents: Vec<Vec<u32>>,
    idf: BTreeMap<u32, f64>,
    vectors: Vec<Vec<f32>>,
    cosines: Vec<f64>,
}

#[derive(Deserialize)]
struct Pair {
    candidate: Vec<f32>,
    candidate_weights: Vec<f64>,
    reference: Vec<f32>,
    reference_weights: Vec<f64>,
    score: [f64; 3],
}

impl Pair {
    fn candidate(&self) -> Sentence<'_> {
        Sentence {
            embeddings: &self.candidate,
            weights: &self.candidate_weights,
        }
    }

    fn reference(&self) -> Sentence<'_> {
        Sentence {
            embeddings: &self.reference,
            weights: &self.reference_weights,
        }
    }
}

#[test]
fn agrees_with_bert_score() {
    let goldens: Goldens =
        serde_json::from_str(include_str!("../goldens/embeddings.json")).unwrap();
    let mut largest = 0.0_f64;
    let mut compare = |found: f64, expected: f64| {
        assert!((found - expected).abs() < 1e-9, "{found} but {expected}");
        largest = largest.max((found - expected).abs());
    };
    assert_eq!(goldens.pairs.len(), 9);
    for p in &goldens.pairs {
        let alone = Padding::default();
        let found = bert_score(p.candidate(), p.reference(), goldens.dimension, alone).unwrap();
        compare(found.precision, p.score[0]);
        compare(found.recall, p.score[1]);
        compare(found.f1, p.score[2]);
    }
    let idf = Idf::of(goldens.documents.iter().map(Vec::as_slice));
    for (id, expected) in &goldens.idf {
        compare(idf.weight(*id), *expected);
    }
    for (pair, expected) in goldens.vectors.windows(2).zip(&goldens.cosines) {
        compare(cosine(&pair[0], &pair[1]).unwrap(), *expected);
    }
    let pairs: Vec<&Pair> = goldens.pairs.iter().cycle().take(70).collect();
    let lengths = |p: &&Pair| (p.candidate_weights.len(), p.reference_weights.len());
    let lengths: Vec<(usize, usize)> = pairs.iter().map(lengths).collect();
    let mut n_changed = 0;
    assert_eq!(goldens.batches.len(), 70);
    for ((p, padding), expected) in pairs.iter().zip(padding(&lengths)).zip(&goldens.batches) {
        let found = bert_score(p.candidate(), p.reference(), goldens.dimension, padding).unwrap();
        compare(found.precision, expected[0]);
        compare(found.recall, expected[1]);
        compare(found.f1, expected[2]);
        n_changed += usize::from((found.f1 - p.score[2]).abs() > 1e-6);
    }
    // Padding matters only to tokens that are similar to nothing.
    assert!(n_changed > 0 && n_changed < 70, "{n_changed}");
    println!("largest difference {largest:.1e}");
}

#[test]
fn references_and_baseline_act_on_each_value_by_itself() {
    let score = |precision, recall, f1| BertScore {
        precision,
        recall,
        f1,
    };
    let best = BertScore::best([score(0.9, 0.2, 0.3), score(0.5, 0.6, 0.55)]);
    assert_eq!(best, Some(score(0.9, 0.6, 0.55)));
    assert_eq!(BertScore::best([]), None);
    let rescaled = score(0.75, 0.5, 0.25).rescaled(score(0.5, 0.5, 0.5));
    assert_eq!(rescaled, score(0.5, 0.0, -0.5));
}

#[test]
fn the_longest_sentence_of_each_side_of_a_batch_is_not_padded() {
    let padded = |candidate, reference| Padding {
        candidate,
        reference,
    };
    let found = padding(&[(3, 9), (5, 4), (5, 9)]);
    assert_eq!(
        found,
        [
            padded(true, false),
            padded(false, true),
            padded(false, false)
        ]
    );
    // The 65th pair is in a batch of its own.
    let mut lengths = vec![(7, 7); 64];
    lengths.push((3, 3));
    assert_eq!(padding(&lengths), [Padding::default(); 65]);
    assert!(padding(&[]).is_empty());
}

#[test]
fn broken_embeddings_are_errors() {
    let weights = [0.0, 1.0, 0.0];
    let sentence = |embeddings| Sentence {
        embeddings,
        weights: &weights,
    };
    let good = [1.0, 0.0, 0.0, 1.0, 1.0, 1.0];
    let score = |a, b, dimension| bert_score(a, b, dimension, Padding::default());
    assert!(score(sentence(&good), sentence(&good), 2).is_ok());
    for (bad, dimension) in [
        (&good[..5], 2),
        (&good[..], 0),
        (&good[..], usize::MAX),
        (&[1.0, 0.0, f32::NAN, 1.0, 1.0, 1.0][..], 2),
        (&[1.0, 0.0, 0.0, 0.0, 1.0, 1.0][..], 2),
    ] {
        assert!(score(sentence(bad), sentence(&good), dimension).is_err());
    }
    assert!(
        cosine(&[1.0], &[1.0, 2.0]).is_err()
            && cosine(&[0.0], &[1.0]).is_err()
            && cosine(&[], &[]).is_err()
    );
}
