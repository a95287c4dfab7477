//! The sentences of the motion library are understood as they were meant.

use radarllm_base::seed::derive_seed;
use radarllm_facts::parse;
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
