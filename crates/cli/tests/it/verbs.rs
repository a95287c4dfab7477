//! Names of verbs, and what `describe` prints for people.

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
    // The last line says whether there is a longer help, which the former names lack.
    let own = |line: &&str| !line.contains("-h, --help");
    flags.lines().filter(own).map(str::to_string).collect()
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
        let flags = flags_of(&[former, "-h"]);
        assert_eq!(flags, flags_of(&["eval", now, "-h"]), "{former}");
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

#[test]
fn a_description_is_a_line_about_the_source_and_the_sentence() {
    let input = "builtin:walk?direction=backward";
    let plain = radarllm(&["describe", input]);
    let text = String::from_utf8(plain.stdout).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(lines.len(), 2, "{text}");
    let source = format!("{input}: simulated, radar awr1843boost, ");
    assert!(
        lines[0].starts_with(&source) && lines[0].ends_with(" s"),
        "{text}"
    );
    assert!(
        lines[1].starts_with("    ") && lines[1].ends_with(')'),
        "{text}"
    );
    let detailed = stdout(&["describe", input, "-v"]);
    assert!(detailed.starts_with(&text), "{detailed}");
    assert!(
        detailed.contains("[model default (embedded), confidence 0."),
        "{detailed}"
    );
}

/// Inputs that cannot be described stop no other one, and every result is a line.
#[test]
fn an_input_that_fails_stops_no_other() {
    let inputs = ["builtin:walk", "builtin:moonwalk", "builtin:clap"];
    let output = radarllm(&[&["describe", "--json"], &inputs[..]].concat());
    assert_eq!(output.status.code(), Some(1));
    let text = String::from_utf8(output.stdout).unwrap();
    let rows: Vec<serde_json::Value> = text
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    let sources: Vec<_> = rows
        .iter()
        .map(|row| row["source"].as_str().unwrap())
        .collect();
    assert_eq!(sources, ["builtin:walk", "builtin:clap"]);
    let errors = String::from_utf8(output.stderr).unwrap();
    assert!(errors.contains("moonwalk"), "{errors}");
    assert!(
        errors.contains("1 of 3 inputs could not be described"),
        "{errors}"
    );
}

/// A device that is full and nothing else.
#[cfg(target_os = "linux")]
#[test]
fn results_that_cannot_be_written_are_an_error() {
    use std::process::{Command, Stdio};

    let folder = tempfile::tempdir().unwrap();
    let memory = folder.path().join("memory.json");
    let memory = memory.to_str().unwrap();
    let calls: [&[&str]; 11] = [
        &["describe", "builtin:walk", "--json"],
        &["describe", "builtin:walk"],
        &["radar", "list"],
        &["doctor"],
        &["man"],
        &["completions", "bash"],
        &["--help"],
        &["--version"],
        &["teach", "--list", "--memory", memory],
        &["live", "sim:", "--no-http", "--json"],
        &["live", "sim:", "--no-http"],
    ];
    for args in calls {
        let full = std::fs::OpenOptions::new().write(true).open("/dev/full");
        let output = Command::new(env!("CARGO_BIN_EXE_radarllm"))
            .args(args)
            .stdout(Stdio::from(full.unwrap()))
            .stderr(Stdio::piped())
            .output()
            .unwrap();
        let errors = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{args:?}: {errors}");
        assert!(
            errors.contains("standard output cannot be written"),
            "{args:?}: {errors}"
        );
    }
    // A reader that has gone is no error.
    let mut child = Command::new(env!("CARGO_BIN_EXE_radarllm"))
        .args(["man"])
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    assert_eq!(child.wait().unwrap().code(), Some(0));
}
