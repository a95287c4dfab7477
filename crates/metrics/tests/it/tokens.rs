//! Tokenisers and stemmers against the tools they are named after; see goldens/captions.py.

use radarllm_metrics::{ptb::ptb, stem, tokens};

use super::captions::Captions;

#[test]
fn ptb_tokens_are_those_of_the_java_tokenizer() {
    let goldens = Captions::load();
    for t in &goldens.tokens {
        assert_eq!(ptb(&t.text).join(" "), t.ptb, "{:?}", t.text);
    }
    println!("{} texts", goldens.tokens.len());
    assert!(goldens.tokens.len() > 1500);
}

#[test]
fn tokens_13a_are_those_of_sacrebleu() {
    for t in &Captions::load().tokens {
        assert_eq!(
            tokens::thirteen_a(&t.text).join(" "),
            t.thirteen_a,
            "{:?}",
            t.text
        );
    }
}

#[test]
fn porter_stems_are_those_of_nltk() {
    let goldens = Captions::load();
    assert!(goldens.porter.len() > 100);
    for (word, expected) in &goldens.porter {
        assert_eq!(&stem::porter(word), expected, "{word}");
    }
}

/// Any text gives tokens without a panic, and no token is empty or of white space.
#[test]
fn any_text_is_tokenised() {
    let alphabet: Vec<char> =
        "aZ0'\u{2019}.,-/&;<>()@#$:! \t\n\u{ad}\u{e9}\u{4e2d}\u{1f3c3}\u{301}\u{10ffff}\0\\*_\""
            .chars()
            .collect();
    let mut state = 1_u64;
    for _ in 0..20_000 {
        let mut text = String::new();
        for _ in 0..12 {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            text.push(alphabet[(state >> 33) as usize % alphabet.len()]);
        }
        let tokens = ptb(&text);
        assert!(
            tokens
                .iter()
                .all(|t| !t.is_empty() && !t.contains([' ', '\n'])),
            "{text:?}: {tokens:?}"
        );
    }
}
