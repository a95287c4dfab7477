use radarllm_metrics::ActionNamer;

const TRAIN: [(&str, &str); 6] = [
    ("A person walks forward.", "walk"),
    ("someone is walking slowly", "walk"),
    ("a person walks to the left", "walk"),
    ("a person falls down", "fall"),
    ("someone falls to the floor", "fall"),
    ("a person waves a hand", "wave"),
];

#[test]
fn names_actions_by_words() {
    let namer = ActionNamer::fit(&TRAIN).unwrap();
    assert_eq!(namer.name("the person WALKS!"), Some("walk"));
    assert_eq!(namer.name("falls down hard"), Some("fall"));
    assert_eq!(namer.name("waves a hand"), Some("wave"));
    assert_eq!(namer.name("quantum chromodynamics"), None);
    assert_eq!(namer.name(""), None);
    assert_eq!(namer.accuracy(&TRAIN), Some(1.0));
    assert_eq!(
        namer.accuracy(&[("walks", "fall"), ("falls", "fall")]),
        Some(0.5)
    );
    assert_eq!(namer.accuracy::<&str, &str>(&[]), None);
    assert!(ActionNamer::fit::<&str, &str>(&[]).is_none());
}

/// Two classes, worked by hand: class a has words {x: 2, y: 1}, class b {y: 1}; bigrams "x x",
/// "x y" belong to a. Vocabulary of 4 features, Laplace 1: P(y|a) = 2/9, P(y|b) = 2/5; priors are
/// equal, so "y" alone is b. P(x|a) = 3/9, P(x|b) = 1/5: "x" is a.
#[test]
fn likelihoods_are_those_of_laplace() {
    let namer = ActionNamer::fit(&[("x x y", "a"), ("y", "b")]).unwrap();
    assert_eq!(namer.name("y"), Some("b"));
    assert_eq!(namer.name("x"), Some("a"));
    // "y x": 2/9 * 3/9 = 0.0741 against 2/5 * 1/5 = 0.08 (the bigram "y x" is unknown).
    assert_eq!(namer.name("y x"), Some("b"));
}
