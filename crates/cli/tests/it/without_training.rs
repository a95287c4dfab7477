//! A build without the feature `train`: what it lacks is listed, and says how to get it.

use crate::command::{radarllm, refused};

#[test]
fn missing_verbs_are_listed_and_say_how_to_get_them() {
    let help = radarllm(&["--help"]);
    let help = String::from_utf8_lossy(&help.stdout).into_owned();
    for (verb, args) in [
        ("train", &["train", "all", "model.toml"][..]),
        ("ablate", &["ablate", "grid.toml"]),
        (
            "reproduce",
            &["reproduce", "paper", "--scale", "small", "--out", "o"],
        ),
        (
            "lm",
            &["lm", "logits", "--weights", "w", "--ids", "i", "--out", "o"],
        ),
    ] {
        let listed = help
            .lines()
            .any(|line| line.split_whitespace().next() == Some(verb));
        assert!(listed, "{verb} in {help}");
        let said = refused(args);
        assert!(
            said.contains(&format!("`{verb}` needs a build with the feature `train`"))
                && said.contains(
                    "hint: cargo build --release --locked -p radarllm-cli --features train"
                ),
            "{said}"
        );
    }
}

#[test]
fn options_that_need_training_s_networks_say_so() {
    for args in [
        &["describe", "builtin:walk", "--decoder", "training"][..],
        &[
            "score",
            "--candidates",
            "c",
            "--references",
            "r",
            "--bert-score",
            "d",
            "--layer",
            "2",
        ],
    ] {
        let said = refused(args);
        assert!(said.contains("--features train"), "{said}");
    }
}
