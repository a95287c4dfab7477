//! What the parser reads in human sentences, beside what a person read in them.

#![allow(
    clippy::disallowed_methods,
    clippy::panic,
    clippy::unwrap_used,
    unreachable_pub,
    reason = "a test"
)]

mod corpora;

use std::{collections::BTreeMap, fs, path::Path};

use radarllm_facts::{Facts, Kind, facts, score::FactScores, score::compare, write::Writer};

/// Ids with their facts.
fn annotations(name: &str) -> Vec<(String, Facts)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/annotations");
    let text = fs::read_to_string(folder.join(name)).unwrap();
    text.lines()
        .map(|line| {
            let (id, facts) = line.split_once('\t').unwrap();
            (
                id.to_string(),
                facts.parse().unwrap_or_else(|e| panic!("{line}: {e}")),
            )
        })
        .collect()
}

fn scores(all: &BTreeMap<String, String>, name: &str) -> FactScores {
    let mut scores = FactScores::default();
    for (id, reference) in annotations(name) {
        scores.add(&compare(&facts(&all[&id]), &reference));
    }
    scores
}

#[test]
fn annotations_are_in_the_notation_and_of_different_sentences() {
    let mut ids: Vec<String> = Vec::new();
    for name in ["developing.tsv", "held-out.tsv"] {
        let half = annotations(name);
        assert_eq!(half.len(), 150, "{name}");
        ids.extend(half.into_iter().map(|(id, _)| id));
    }
    ids.sort();
    ids.dedup();
    assert_eq!(ids.len(), 300);
}

#[test]
fn human_sentences_are_read_as_people_read_them() {
    let Some(all) = corpora::sentences() else {
        println!(
            "skipped: no human sentences in {}",
            corpora::folder().display()
        );
        return;
    };
    let drawn = corpora::shuffled(all.clone(), corpora::SEED);
    let ids: Vec<&str> = drawn.iter().take(300).map(|s| s.id.as_str()).collect();
    let annotated = [annotations("developing.tsv"), annotations("held-out.tsv")].concat();
    assert!(
        annotated.iter().map(|a| a.0.as_str()).eq(ids),
        "another draw"
    );
    let all: BTreeMap<String, String> = all.into_iter().map(|s| (s.id, s.text)).collect();
    for (name, min) in [("developing.tsv", 0.9), ("held-out.tsv", 0.75)] {
        let scores = scores(&all, name);
        println!("{name}: kind, common, parser, annotator, precision, recall");
        for kind in Kind::ALL {
            let tally = scores.of(kind);
            let share = |s: Option<f64>| s.map_or("-".into(), |s| format!("{s:.3}"));
            println!(
                "{:10} {:4} {:4} {:4}  {} {}",
                kind.name(),
                tally.common,
                tally.candidate,
                tally.reference,
                share(tally.precision()),
                share(tally.recall())
            );
        }
        let f1 = scores.all().f1().unwrap();
        println!(
            "all but the subject: F1 {f1:.3}; contradictions {:?}",
            scores.contradictions
        );
        assert!(f1 > min, "{name}: {f1}");
    }
}

#[test]
fn what_is_written_is_read_again() {
    let writer = Writer::new();
    let mut n_mentioned = [0, 0];
    for (n, line) in annotations("developing.tsv").into_iter().enumerate() {
        for seed in 0..4 {
            let seed = 1000 * n as u64 + seed;
            let facts_in = &line.1;
            for (mode, written) in [
                writer.write(facts_in, seed),
                writer.write_fully(facts_in, seed),
            ]
            .into_iter()
            .enumerate()
            {
                let Some(written) = written else { continue };
                assert_eq!(facts(&written.text), written.mentioned, "{}", written.text);
                let names = |f: &Facts| f.actions().map(|a| a.name).collect::<Vec<_>>();
                assert_eq!(
                    names(&written.mentioned),
                    names(facts_in),
                    "{}",
                    written.text
                );
                let scores = compare(&written.mentioned, facts_in);
                assert!(
                    scores.contradictions.is_empty(),
                    "{}: {facts_in}",
                    written.text
                );
                n_mentioned[mode] += scores.all().common;
            }
        }
    }
    // What people omit is omitted.
    assert!(
        n_mentioned[0] > 0 && n_mentioned[0] < n_mentioned[1],
        "{n_mentioned:?}"
    );
}

#[test]
fn the_same_seed_writes_the_same_sentence_and_others_write_others() {
    let writer = Writer::new();
    let motion: Facts = "man: walk forward x4 slow; wave hand right 120/min 6s + look"
        .parse()
        .unwrap();
    let texts: Vec<String> = (0..50)
        .filter_map(|seed| writer.write_fully(&motion, seed))
        .map(|w| w.text)
        .collect();
    let again: Vec<String> = (0..50)
        .filter_map(|seed| writer.write_fully(&motion, seed))
        .map(|w| w.text)
        .collect();
    assert_eq!(texts, again);
    assert!(texts.len() > 40, "{}", texts.len());
    let mut different = texts.clone();
    different.sort();
    different.dedup();
    assert!(different.len() > 35, "{}", different.len());
    let has = |words: &str| texts.iter().any(|t| t.contains(words));
    assert!(
        has("about twice a second") && has("for six seconds"),
        "{texts:#?}"
    );
}
