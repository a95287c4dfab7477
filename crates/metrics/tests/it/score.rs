use radarllm_metrics::{Candidate, Protocol, Reference, ScoreError, ScoreOptions, score};

fn candidates(texts: &[(&str, &str)]) -> Vec<Candidate> {
    texts
        .iter()
        .map(|(id, text)| Candidate {
            id: (*id).into(),
            text: (*text).into(),
        })
        .collect()
}

fn references(texts: &[(&str, &[&str])]) -> Vec<Reference> {
    let owned = |t: &[&str]| t.iter().map(|s| (*s).to_string()).collect();
    texts
        .iter()
        .map(|(id, texts)| Reference {
            id: (*id).into(),
            texts: owned(texts),
        })
        .collect()
}

#[test]
fn perfect_captions_score_one() {
    let texts = [
        "a person walks forward",
        "someone sits down on a chair",
        "the man waves his left hand",
    ];
    let c: Vec<_> = texts
        .iter()
        .map(|t| Candidate {
            id: (*t).into(),
            text: (*t).into(),
        })
        .collect();
    let r: Vec<_> = texts
        .iter()
        .map(|t| Reference {
            id: (*t).into(),
            texts: vec![(*t).into()],
        })
        .collect();
    let s = score(&c, &r, &ScoreOptions::default()).unwrap();
    for v in [
        s.bleu_1,
        s.bleu_2,
        s.bleu_3,
        s.bleu_4,
        s.rouge_1,
        s.rouge_l,
        s.rouge_l_coco,
    ] {
        // COCO's BLEU divides by guesses + 1e-9.
        assert!((v - 1.0).abs() < 1e-8, "{v}");
    }
    // All four cosines are 1 and there is no length difference: CIDEr is exactly 10.
    assert!((s.cider_d - 10.0).abs() < 1e-9 && (s.cider - 10.0).abs() < 1e-9);
    // Every resample is perfect, except that CIDEr's weights stay those of the corpus.
    assert!(s.ci95.values().all(|i| i[0] <= i[1]));
    assert!((s.ci95["bleu_4"][0] - 1.0).abs() < 1e-8);
}

#[test]
fn mismatched_ids_are_errors_that_name_them() {
    let c = candidates(&[("a", "x"), ("b", "y")]);
    let r = references(&[("a", &["x"]), ("b", &["y"])]);
    let o = ScoreOptions::default();
    assert!(score(&c, &r, &o).is_ok());
    assert_eq!(score(&[], &[], &o), Err(ScoreError::Empty));
    let missing = |list, id: &str| {
        Err(ScoreError::Missing {
            list,
            n: 1,
            ids: vec![id.into()],
        })
    };
    assert_eq!(score(&c[..1], &r, &o), missing("candidates", "b"));
    assert_eq!(score(&c, &r[1..], &o), missing("references", "a"));
    let duplicate = |list| {
        Err(ScoreError::Duplicate {
            list,
            n: 1,
            id: "a".into(),
        })
    };
    assert_eq!(
        score(&candidates(&[("a", "x"), ("a", "y")]), &r, &o),
        duplicate("candidates")
    );
    assert_eq!(
        score(&c, &references(&[("a", &["x"]), ("a", &["x"])]), &o),
        duplicate("references")
    );
    let none = references(&[("a", &[]), ("b", &["y"])]);
    assert_eq!(
        score(&c, &none, &o),
        Err(ScoreError::NoReference {
            n: 1,
            id: "a".into()
        })
    );
    let two = ScoreOptions {
        protocol: Protocol::MotionGpt,
        max_references: 2,
        ..o
    };
    assert_eq!(
        score(&c, &r, &two),
        Err(ScoreError::FixedReferences { max_references: 2 })
    );
    let long = "x ".repeat(1001);
    let too_long = |list| {
        Err(ScoreError::TooLong {
            list,
            id: "b".into(),
            words: 1001,
            bytes: 2002,
        })
    };
    assert_eq!(
        score(&candidates(&[("a", "x"), ("b", &long)]), &r, &o),
        too_long("candidates")
    );
    assert_eq!(
        score(&c, &references(&[("a", &["x"]), ("b", &[&long])]), &o),
        too_long("references")
    );
}

#[test]
fn empty_candidates_are_counted_named_and_scored() {
    let c = candidates(&[("a", "walks"), ("b", " "), ("c", "...")]);
    let r = references(&[("a", &["walks"]), ("b", &["falls"]), ("c", &["sits"])]);
    let s = score(&c, &r, &ScoreOptions::default()).unwrap();
    assert_eq!(
        (s.empty_candidates, s.empty_candidate_ids),
        (2, vec!["b".to_string(), "c".into()])
    );
    assert!((s.rouge_1 - 1.0 / 3.0).abs() < 1e-12);
    let raw = ScoreOptions {
        protocol: Protocol::NlgEval,
        ..Default::default()
    };
    assert_eq!(score(&c, &r, &raw).unwrap().empty_candidates, 1);
}

#[test]
fn max_references_takes_the_first() {
    let c = candidates(&[("a", "d"), ("b", "x")]);
    let r = references(&[("a", &["a", "b", "c", "d"]), ("b", &["x"])]);
    let at = |max_references| {
        score(
            &c,
            &r,
            &ScoreOptions {
                max_references,
                ..Default::default()
            },
        )
        .unwrap()
        .rouge_1
    };
    assert_eq!((at(3), at(4), at(0)), (0.5, 1.0, 1.0));
}

#[test]
fn json_has_the_contracted_fields_and_reasons() {
    let c = candidates(&[("a", "a person walks")]);
    let r = references(&[("a", &["a person walks"])]);
    let json = serde_json::to_value(score(&c, &r, &ScoreOptions::default()).unwrap()).unwrap();
    for field in [
        "bleu_1",
        "bleu_2",
        "bleu_3",
        "bleu_4",
        "rouge_1",
        "rouge_l",
        "rouge_l_coco",
        "cider_d",
        "cider",
        "meteor",
    ] {
        assert!(json[field].is_number(), "{field}");
        assert_eq!(json["ci95"][field].as_array().unwrap().len(), 2, "{field}");
    }
    for field in ["bert_score", "sim_cse", "self_bleu"] {
        assert!(
            json[field].is_null() && json["reason"][field].is_string(),
            "{field}"
        );
    }
    assert_eq!(json["protocol"], "plain");
}

/// The weight of an n-gram that is in all items is ln 1: a perfect caption of a single item has a CIDEr of 0.
#[test]
fn a_single_item_has_no_cider_and_says_why() {
    let text = "a person walks forward and sits down";
    let of = |n: usize| {
        let ids: Vec<String> = (0..n).map(|i| i.to_string()).collect();
        let texts: Vec<String> = (0..n).map(|i| format!("{text} {i}")).collect();
        let pairs = || ids.iter().zip(&texts);
        let c: Vec<Candidate> = pairs()
            .map(|(id, text)| Candidate {
                id: id.clone(),
                text: text.clone(),
            })
            .collect();
        let r: Vec<Reference> = pairs()
            .map(|(id, text)| Reference {
                id: id.clone(),
                texts: vec![text.clone()],
            })
            .collect();
        score(&c, &r, &ScoreOptions::default()).unwrap()
    };
    let one = of(1);
    assert_eq!((one.cider, one.cider_d), (0.0, 0.0));
    for field in ["cider", "cider_d"] {
        assert!(one.reason[field].starts_with("0 by definition"), "{field}");
    }
    let two = of(2);
    assert!((two.cider_d - 10.0).abs() < 1e-9);
    assert!(!two.reason.contains_key("cider") && !two.reason.contains_key("cider_d"));
}

#[test]
fn results_do_not_depend_on_the_order_of_candidates_and_repeat() {
    let texts: Vec<(String, String)> = (0..1500)
        .map(|i| {
            (
                format!("m{}#{}", i / 2, i % 2),
                format!("person {} walks {} and {}", i % 7, i % 11, i % 13),
            )
        })
        .collect();
    let mut c: Vec<_> = texts
        .iter()
        .map(|(id, t)| Candidate {
            id: id.clone(),
            text: t.clone(),
        })
        .collect();
    let r: Vec<_> = texts
        .iter()
        .enumerate()
        .map(|(i, (id, _))| Reference {
            id: id.clone(),
            texts: vec![format!("person {} walks", i % 5)],
        })
        .collect();
    let first = score(&c, &r, &ScoreOptions::default()).unwrap();
    c.reverse();
    assert_eq!(score(&c, &r, &ScoreOptions::default()).unwrap(), first);
    assert_eq!((first.bootstrap.units, first.items), (750, 1500));
    assert!(first.self_bleu.is_some() && first.ci95.contains_key("self_bleu"));
    let other = score(
        &c,
        &r,
        &ScoreOptions {
            seed: 1,
            ..Default::default()
        },
    )
    .unwrap();
    assert_eq!(other.bleu_4, first.bleu_4);
    assert_ne!(other.ci95["bleu_4"], first.ci95["bleu_4"]);
}
