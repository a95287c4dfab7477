//! The names that CONTRIBUTING.md rules out do not come back.

use std::{
    fs,
    path::{Path, PathBuf},
};

/// Parts of identifiers, with what to write instead. `at_most` and `AtLeast` are English and stay.
const PARTS: [(&str, &str); 4] = [
    ("firing", "multiplexing, slot"),
    ("told", "what was reported, published, recognised"),
    ("most", "max"),
    ("least", "min"),
];
/// Names that are ordinary English or those of other libraries.
const ALLOWED: [&str; 13] = [
    "AtLeast",
    "AtLeastOnce",
    "AtMost",
    "AtMostOnce",
    "AtMostPoints",
    "at_least",
    "at_most",
    "definitions_at_most",
    "MOST_FREQUENT",
    "most_alike",
    "most_confident",
    "most_frequent",
    "most_probable",
];
/// Phrases in comments, help and documents, in lower case.
const PHRASES: [(&str, &str); 5] = [
    ("graphics processor", "GPU"),
    ("sweep group", "chirp, loop or slot"),
    ("people followed", "tracks"),
    ("what is taken off", "clutter"),
    ("what is told", "targets, supervision"),
];
/// Test functions are sentences and have at least this many parts.
const SENTENCE_PARTS: usize = 5;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn files(folder: &Path, extension: &str, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if path.is_dir() {
            if !name.starts_with('.') && name != "target" && name != "log" {
                files(&path, extension, found);
            }
        } else if path.extension().is_some_and(|e| e == extension) {
            found.push(path);
        }
    }
}

/// The parts of an identifier in lower case: `min_share`, `MinShare` and `MIN_SHARE` are `min`, `share`.
fn parts(identifier: &str) -> Vec<String> {
    let mut parts = vec![String::new()];
    let mut was_lower = false;
    for c in identifier.chars() {
        let begins = c.is_uppercase() && was_lower;
        if c == '_' || begins {
            parts.push(String::new());
        }
        if c != '_' {
            parts.last_mut().unwrap().extend(c.to_lowercase());
        }
        was_lower = c.is_lowercase() || c.is_numeric();
    }
    parts.retain(|p| !p.is_empty());
    parts
}

/// Identifiers of a line of code, without its comment and its strings.
fn identifiers(line: &str) -> Vec<String> {
    let mut code = String::new();
    let (mut in_string, mut escaped) = (false, false);
    let mut chars = line.chars().peekable();
    while let Some(c) = chars.next() {
        match c {
            _ if escaped => escaped = false,
            '\\' if in_string => escaped = true,
            '"' => in_string = !in_string,
            '/' if !in_string && chars.peek() == Some(&'/') => break,
            _ if !in_string => code.push(c),
            _ => {}
        }
        if in_string {
            code.push(' ');
        }
    }
    code.split(|c: char| !c.is_alphanumeric() && c != '_')
        .filter(|word| word.starts_with(|c: char| c.is_alphabetic()))
        .map(Into::into)
        .collect()
}

fn problem(identifier: &str) -> Option<String> {
    let parts = parts(identifier);
    if parts.len() >= SENTENCE_PARTS || ALLOWED.contains(&identifier) {
        return None;
    }
    let found = PARTS
        .iter()
        .find(|(part, _)| parts.iter().any(|p| p == part));
    found.map(|(_, instead)| format!("`{identifier}`: write {instead}"))
}

#[test]
fn identifiers_use_the_terms_of_the_field() {
    let mut sources = Vec::new();
    for entry in fs::read_dir(root().join("crates")).unwrap() {
        files(&entry.unwrap().path().join("src"), "rs", &mut sources);
    }
    assert!(sources.len() > 500, "{}", sources.len());
    let mut problems = Vec::new();
    for path in sources {
        for (i, line) in fs::read_to_string(&path).unwrap().lines().enumerate() {
            let of_line = identifiers(line).into_iter().filter_map(|w| problem(&w));
            problems.extend(of_line.map(|p| format!("{}:{}: {p}", path.display(), i + 1)));
        }
    }
    assert!(problems.is_empty(), "{}", problems.join("\n"));
}

#[test]
fn prose_uses_the_terms_of_the_field() {
    let mut texts = Vec::new();
    files(&root().join("crates"), "rs", &mut texts);
    files(&root().join("docs"), "md", &mut texts);
    for name in [
        "README.md",
        "ARCHITECTURE.md",
        "CONVENTIONS.md",
        "SPECIFICATION.md",
    ] {
        texts.push(root().join(name));
    }
    let mut problems = Vec::new();
    for path in texts {
        if path.ends_with("words.rs") {
            continue;
        }
        for (i, line) in fs::read_to_string(&path).unwrap().lines().enumerate() {
            let line = line.to_lowercase();
            let found = PHRASES.iter().filter(|(phrase, _)| line.contains(phrase));
            problems.extend(found.map(|(phrase, instead)| {
                format!("{}:{}: `{phrase}`: write {instead}", path.display(), i + 1)
            }));
        }
    }
    assert!(problems.is_empty(), "{}", problems.join("\n"));
}

#[test]
fn what_is_ruled_out_is_found() {
    assert_eq!(parts("MAX_SHARE_M2"), ["max", "share", "m2"]);
    assert_eq!(parts("TxFiring"), ["tx", "firing"]);
    let of = |line| identifiers(line).iter().filter_map(|w| problem(w)).count();
    assert_eq!(
        of("let least_share = most(told, \"least_x\"); // most_y"),
        3
    );
    assert_eq!(of("fn at_most(almost: usize, MOST_ROWS: FiringName) {"), 2);
    assert_eq!(of("fn the_room_has_the_label_of_most_points() {"), 0);
}
