use radarllm_eval::ActionClassifier;

const TRAIN: [(&str, &str); 6] = [
    ("A person walks forward.", "walk"),
    ("someone is walking slowly", "walk"),
    ("a person walks to the left", "walk"),
    ("a person falls down", "fall"),
    ("someone falls to the floor", "fall"),
    ("a person waves a hand", "wave"),
];

#[test]
fn actions_are_recognised_by_words() {
    let classifier = ActionClassifier::fit(&TRAIN).unwrap();
    assert_eq!(classifier.classify("the person WALKS!"), Some("walk"));
    assert_eq!(classifier.classify("falls down hard"), Some("fall"));
    assert_eq!(classifier.classify("waves a hand"), Some("wave"));
    assert_eq!(classifier.classify("quantum chromodynamics"), None);
    assert_eq!(classifier.classify(""), None);
    assert_eq!(classifier.accuracy(&TRAIN), Some(1.0));
    assert_eq!(
        classifier.accuracy(&[("walks", "fall"), ("falls", "fall")]),
        Some(0.5)
    );
    assert_eq!(classifier.accuracy::<&str, &str>(&[]), None);
    assert!(ActionClassifier::fit::<&str, &str>(&[]).is_none());
}

/// Two classes, worked by hand: class a has words {x: 2, y: 1}, class b {y: 1}; bigrams "x x",
/// "x y" belong to a. Vocabulary of 4 features, Laplace 1: P(y|a) = 2/9, P(y|b) = 2/5; priors are
/// equal, so "y" alone is b. P(x|a) = 3/9, P(x|b) = 1/5: "x" is a.
#[test]
fn likelihoods_are_those_of_laplace() {
    let classifier = ActionClassifier::fit(&[("x x y", "a"), ("y", "b")]).unwrap();
    assert_eq!(classifier.classify("y"), Some("b"));
    assert_eq!(classifier.classify("x"), Some("a"));
    // "y x": 2/9 * 3/9 = 0.0741 against 2/5 * 1/5 = 0.08 (the bigram "y x" is unknown).
    assert_eq!(classifier.classify("y x"), Some("b"));
}
