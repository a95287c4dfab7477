//! The sentences of the motion library are understood as they were meant.

use radarllm_base::hash::Fnv1a;
use radarllm_base::seed::derive_seed;
use radarllm_facts::tables::stated_actions;
use radarllm_facts::write::Writer;
use radarllm_facts::{Facts, Kind, facts, parse, score::FactScores, score::compare};
use radarllm_motions::random_request;

/// Sentences that state another action than the motion's own name, in the field's and the everyday sense of the words.
fn same(action: &str, stated: &str) -> bool {
    action == stated
        || matches!(
            (action, stated),
            // "Squats down low, pauses and rises"; "sits on a chair" after sitting down.
            ("crouch", "squat") | ("sit_down", "sit_still") | ("lie_down", "lie_still")
        )
}

#[test]
fn actions_of_library_captions_are_recognised() {
    let (mut n_right, mut n_all) = (0, 0);
    let mut wrong = Vec::new();
    for index in 0..4000 {
        let request = random_request(derive_seed(index, "facts"));
        // `walk then wave`, `walk+wave`: actions in order, simultaneous ones joined by a plus sign.
        let expected = request.action();
        let expected: Vec<&str> = expected
            .split(" then ")
            .flat_map(|part| part.split([' ', '+']))
            .filter(|name| !name.is_empty() && *name != "while")
            .collect();
        for caption in request.captions(index) {
            let clauses = parse(&caption);
            let stated: Vec<&str> = clauses
                .iter()
                .flat_map(|c| &c.actions)
                .map(|a| a.name)
                .collect();
            n_all += 1;
            if stated.len() == expected.len()
                && expected.iter().zip(&stated).all(|(a, b)| same(a, b))
            {
                n_right += 1;
            } else if wrong.len() < 25 {
                wrong.push(format!("{expected:?} {caption}: {stated:?}"));
            }
        }
    }
    let share = f64::from(n_right) / f64::from(n_all);
    assert!(share > 0.99, "{share:.4}\n{}", wrong.join("\n"));
}

#[test]
fn library_captions_do_not_contradict_their_motions() {
    let mut scores = FactScores::default();
    for index in 0..1000 {
        let request = random_request(derive_seed(index, "attributes"));
        let motion = request.facts();
        for caption in request.captions(index) {
            let found = compare(&facts(&caption), &motion);
            assert!(
                found.contradictions.is_empty(),
                "{motion}: {caption}: {:?}",
                found.contradictions
            );
            scores.add(&found);
        }
    }
    // Sides, directions and tempos are stated, so that they could have been contradicted.
    for kind in [Kind::Side, Kind::Direction, Kind::Tempo, Kind::Count] {
        assert!(
            scores.of(kind).common > 300,
            "{kind:?} {:?}",
            scores.of(kind)
        );
    }
}

/// Trained weights depend on the sentences of the writer and on what the parser reads. The hashes change when words
/// change; then the changelog has to say so.
#[test]
fn sentences_change_only_on_purpose() {
    const ATTRIBUTES: [&str; 8] = [
        "",
        "left",
        "hand both x3",
        "forward slow",
        "to_right 90deg careful",
        "large high x1",
        "small 120/min 6s",
        "back_and_forth arms_out xmany fast",
    ];
    let writer = Writer::new();
    let (mut n_written, mut hash) = (0, Fnv1a::new());
    for (i, action) in stated_actions().enumerate() {
        for (k, attributes) in ATTRIBUTES.iter().enumerate() {
            let motion: Facts = format!("person: {action} {attributes}").parse().unwrap();
            let seed = (100 * i + k) as u64;
            let written = match seed % 2 {
                0 => writer.write(&motion, seed),
                _ => writer.write_fully(&motion, seed),
            };
            if let Some(written) = written {
                n_written += 1;
                hash.write(format!("{}\n{}\n", written.text, written.mentioned).as_bytes());
            }
        }
    }
    let mut of_library = Fnv1a::new();
    for index in 0..300 {
        let request = random_request(derive_seed(index, "hash"));
        for caption in request.captions(index) {
            of_library.write(format!("{}\n", facts(&caption)).as_bytes());
        }
        if let Some(written) = writer.write(&request.facts(), index) {
            of_library.write(format!("{}\n", written.text).as_bytes());
        }
    }
    let hashes = (n_written, hash.finish(), of_library.finish());
    assert_eq!(
        hashes,
        (1031, 17_555_610_964_956_192_343, 10_938_613_229_402_440_643)
    );
}
