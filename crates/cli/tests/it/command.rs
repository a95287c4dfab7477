//! Runs the built command and looks at what a user would see.

use std::process::{Command, Output};

/// Runs `radarllm` with the arguments.
pub fn radarllm(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_radarllm"))
        .args(args)
        .output()
        .expect("the binary runs")
}

/// Runs it, insists on exit code 0 and returns stdout.
fn succeeded(args: &[&str]) -> String {
    let output = radarllm(args);
    assert!(
        output.status.success(),
        "{args:?} ended with {:?}: {}",
        output.status.code(),
        String::from_utf8_lossy(&output.stderr)
    );
    String::from_utf8(output.stdout).expect("UTF-8 on stdout")
}

/// Runs it, insists on exit code 0 and parses stdout as one JSON document.
pub fn json(args: &[&str]) -> serde_json::Value {
    serde_json::from_str(&succeeded(args)).expect("one JSON document on stdout")
}

/// Runs it, insists on exit code 0 and parses every line of stdout as a JSON document.
pub fn json_lines(args: &[&str]) -> serde_json::Value {
    let text = succeeded(args);
    let documents = text.lines().map(serde_json::from_str::<serde_json::Value>);
    documents
        .collect::<Result<_, _>>()
        .expect("JSON lines on stdout")
}

/// Runs it, insists on exit code 1 and an `error:` line, and returns stderr.
pub fn refused(args: &[&str]) -> String {
    let output = radarllm(args);
    let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{args:?}: {stderr}");
    assert!(stderr.contains("error:"), "{args:?}: {stderr}");
    assert!(!stderr.contains("panicked"), "{args:?}: {stderr}");
    stderr
}
