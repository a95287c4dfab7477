//! BLEU by the rules of nltk, nmt and sacrebleu, and ROUGE with stems; see goldens/captions.py.

use radarllm_metrics::bleu::{self, BleuStats, Rules};
use radarllm_metrics::{rouge, tokens};

use super::captions::Captions;

fn close(name: &str, found: [f64; 4], expected: [f64; 4]) -> f64 {
    let differences = found.iter().zip(expected).map(|(f, e)| (f - e).abs());
    let largest = differences.fold(0.0, f64::max);
    assert!(largest < 1e-9, "{name}: {found:?} but {expected:?}");
    largest
}

fn sum(items: &[BleuStats]) -> BleuStats {
    let mut total = BleuStats::default();
    items.iter().for_each(|s| total.add(s));
    total
}

#[test]
fn every_rule_agrees_with_its_package() {
    let goldens = Captions::load();
    let pairs = goldens.pairs();
    let stats_of = |split: fn(&str) -> Vec<String>| -> Vec<BleuStats> {
        let references =
            |r: &[String]| -> Vec<Vec<String>> { r.iter().map(|t| split(t)).collect() };
        pairs
            .iter()
            .map(|(c, r)| bleu::stats(&split(c), &references(r)))
            .collect()
    };
    let plain = stats_of(tokens::plain);
    let mut largest = 0.0_f64;
    let golden = &goldens.bleu;
    for (name, rules, expected) in [
        ("nltk", Rules::Nltk, golden.nltk),
        ("nmt", Rules::Nmt, golden.nmt),
        ("nmt smoothed", Rules::NmtSmoothed, golden.nmt_smoothed),
    ] {
        largest = largest.max(close(name, sum(&plain).by(rules), expected));
    }
    let sacrebleu = sum(&stats_of(tokens::thirteen_a)).by(Rules::Sacrebleu);
    largest = largest.max(close("sacrebleu", sacrebleu, golden.sacrebleu));
    for (rules, sentences) in [
        (Rules::Nltk, &golden.nltk_sentences),
        (Rules::NltkMethod1, &golden.nltk_sentences_method1),
        (Rules::Nmt, &golden.nmt_sentences),
        (Rules::Coco, &golden.coco_sentences),
    ] {
        assert_eq!(sentences.len(), plain.len());
        for ((stats, expected), (text, _)) in plain.iter().zip(sentences).zip(&pairs) {
            largest = largest.max(close(
                &format!("{rules:?} {text:?}"),
                stats.by(rules),
                *expected,
            ));
        }
    }
    println!("{} items, largest difference {largest:.1e}", plain.len());
}

#[test]
fn rouge_with_stems_agrees_with_rouge_score() {
    let goldens = Captions::load();
    for ((candidate, references), expected) in goldens.pairs().iter().zip(&goldens.rouge_stemmed) {
        let c = tokens::rouge_score_stemmed(candidate);
        let r: Vec<_> = references
            .iter()
            .map(|t| tokens::rouge_score_stemmed(t))
            .collect();
        let found = [rouge::rouge_1(&c, &r), rouge::rouge_l(&c, &r)];
        for (f, e) in found.iter().zip(expected) {
            assert!(
                (f - e).abs() < 1e-9,
                "{candidate:?} {references:?}: {found:?} but {expected:?}"
            );
        }
    }
}
