//! Names of verbs.

use crate::command::{radarllm, refused};

fn stdout(args: &[&str]) -> String {
    let output = radarllm(args);
    assert!(output.status.success(), "{args:?}: {output:?}");
    String::from_utf8(output.stdout).unwrap()
}

/// Flags and arguments of a help text, without the lines about the verb itself.
fn flags_of(args: &[&str]) -> Vec<String> {
    let help = stdout(args);
    let (_, flags) = help.split_once("Arguments:").unwrap_or_else(|| {
        help.split_once("Options:")
            .unwrap_or_else(|| panic!("{args:?}: {help}"))
    });
    flags.lines().map(str::to_string).collect()
}

#[test]
fn verbs_of_eval_keep_their_former_names() {
    for (former, now) in [
        ("eval-recordings", "recordings"),
        ("eval-falls", "falls"),
        ("interventions", "interventions"),
        ("edits", "interventions"),
        ("robustness", "robustness"),
        ("realism", "realism"),
    ] {
        let flags = flags_of(&[former, "--help"]);
        assert_eq!(flags, flags_of(&["eval", now, "--help"]), "{former}");
        assert!(flags.len() > 5, "{former}: {flags:?}");
        // Only the new name is shown.
        let verbs = stdout(&["--help"]);
        let lists = |verb: &str| verbs.lines().any(|l| l.trim_start().starts_with(verb));
        assert!(lists("eval ") && !lists(former), "{verbs}");
        assert!(stdout(&["eval", "--help"]).contains(&format!("  {now} ")));
    }
}

#[test]
fn flags_after_eval_are_those_of_captions() {
    let rest = ["--data", "no such folder", "--out", "nowhere"];
    let former = refused(&[&["eval"], &rest[..]].concat());
    assert_eq!(
        former,
        refused(&[&["eval", "captions"], &rest[..]].concat())
    );
    assert!(former.contains("no such folder"), "{former}");
    assert!(refused(&["eval", "--data", "x"]).contains("--out"));
}
