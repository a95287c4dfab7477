//! Agreement with the Python packages; see goldens/generate.py for their versions.

use std::collections::BTreeMap;

use radarllm_metrics::{Candidate, Protocol, Reference, ScoreOptions, score};
use serde::Deserialize;

use super::captions::Captions;

#[derive(Deserialize)]
struct Goldens {
    items: Vec<Item>,
    cases: Vec<Case>,
}

#[derive(Deserialize)]
struct Item {
    candidate: String,
    references: Vec<String>,
}

#[derive(Deserialize)]
struct Case {
    protocol: String,
    max_references: usize,
    indices: Vec<usize>,
    values: BTreeMap<String, Option<f64>>,
}

#[test]
fn values_agree_with_the_python_packages() {
    let goldens: Goldens = serde_json::from_str(include_str!("../goldens/goldens.json")).unwrap();
    let (mut n_compared, mut largest) = (0, 0.0_f64);
    for case in &goldens.cases {
        let id = |i: &usize| format!("item {i}");
        let candidates: Vec<_> = case
            .indices
            .iter()
            .map(|i| Candidate {
                id: id(i),
                text: goldens.items[*i].candidate.clone(),
            })
            .collect();
        let references: Vec<_> = case
            .indices
            .iter()
            .map(|i| Reference {
                id: id(i),
                texts: goldens.items[*i].references.clone(),
            })
            .collect();
        let options = ScoreOptions {
            protocol: Protocol::from_name(&case.protocol).unwrap(),
            max_references: case.max_references,
            n_resamples: 0,
            seed: 0,
        };
        let scores = score(&candidates, &references, &options).unwrap();
        let json = serde_json::to_value(&scores).unwrap();
        assert_eq!(case.values.len(), 10);
        for (field, expected) in &case.values {
            let found = json[field].as_f64();
            let context = || {
                format!(
                    "{field}, {} {} {:?}",
                    case.protocol, case.max_references, case.indices
                )
            };
            match (found, expected) {
                (Some(found), Some(expected)) => {
                    // Both sides are f64; sums run in another order. 1e-9 leaves room for a few
                    // hundred terms of order 10 and is far below any printed digit.
                    let difference = (found - expected).abs();
                    assert!(difference < 1e-9, "{}: {found} but {expected}", context());
                    largest = largest.max(difference);
                    n_compared += 1;
                }
                (None, None) => {}
                other => panic!("{}: {other:?}", context()),
            }
        }
    }
    println!("{n_compared} values, largest difference {largest:.1e}");
    // 220 corpora of 10 values, less Self-BLEU of the 108 single items.
    assert_eq!(n_compared, 4 * 55 * 10 - 4 * 27);
}

/// The whole of `score` under the protocols whose tokens and METEOR goldens.json does not have.
#[test]
fn protocols_agree_with_the_packages_they_stand_for() {
    let goldens = Captions::load();
    let id = |i: usize| format!("item {i}");
    let candidates: Vec<_> = (goldens.items.iter().enumerate())
        .map(|(i, item)| Candidate {
            id: id(i),
            text: item.candidate.clone(),
        })
        .collect();
    let references: Vec<_> = (goldens.items.iter().enumerate())
        .map(|(i, item)| Reference {
            id: id(i),
            texts: item.references.clone(),
        })
        .collect();
    for (name, n_fields) in [("coco", 9), ("motiongpt", 8)] {
        let options = ScoreOptions {
            protocol: Protocol::from_name(name).unwrap(),
            n_resamples: 0,
            ..ScoreOptions::default()
        };
        let json =
            serde_json::to_value(score(&candidates, &references, &options).unwrap()).unwrap();
        let mut largest = 0.0_f64;
        assert_eq!(goldens.protocols[name].len(), n_fields);
        for (field, expected) in &goldens.protocols[name] {
            let difference = (json[field].as_f64().unwrap() - expected).abs();
            assert!(
                difference < 1e-9,
                "{name} {field}: {} but {expected}",
                json[field]
            );
            largest = largest.max(difference);
        }
        println!(
            "{name}: {} items, largest difference {largest:.1e}",
            candidates.len()
        );
    }
}
