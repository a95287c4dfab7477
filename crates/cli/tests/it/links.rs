//! Every path that documents, comments, help texts and configurations name exists.

use std::{
    collections::BTreeSet,
    fs,
    path::{Path, PathBuf},
};

/// Folders of the repository whose paths are checked in code spans.
const FOLDERS: [&str; 6] = [
    "configs/",
    "crates/",
    "docs/",
    "examples/",
    "scripts/",
    "studies/",
];

/// Files of these types are searched for names of pages and configurations.
const SOURCES: [&str; 7] = ["md", "py", "rs", "service", "sh", "toml", "yaml"];

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Files of the repository with their paths from its root. Build outputs and hidden folders are left out.
fn files() -> Vec<(PathBuf, String)> {
    let mut found = Vec::new();
    let mut open = vec![(root(), String::new())];
    while let Some((folder, name)) = open.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let entry = entry.unwrap();
            let part = entry.file_name().into_string().unwrap();
            let kind = entry.file_type().unwrap();
            let ignored = ["target", "work", "data", "dist", "shared"];
            if kind.is_dir() && name.is_empty() && ignored.contains(&part.as_str())
                || kind.is_dir() && (part == "target" || part.starts_with('.'))
            {
                continue;
            }
            let name = format!("{name}{part}");
            match kind.is_dir() {
                true => open.push((entry.path(), format!("{name}/"))),
                false => found.push((entry.path(), name)),
            }
        }
    }
    found.sort();
    found
}

/// Pages that speak of today. The changelog speaks of what was there.
fn pages() -> Vec<(PathBuf, String, String)> {
    let pages: Vec<_> = files()
        .into_iter()
        .filter(|(_, name)| name.ends_with(".md") && name != "CHANGELOG.md")
        .map(|(path, name)| {
            let text = fs::read_to_string(&path).unwrap();
            (path, name, text)
        })
        .collect();
    assert!(pages.len() > 40, "{} pages", pages.len());
    pages
}

/// Lines of a page with whether they stand in a fenced block.
fn lines(text: &str) -> impl Iterator<Item = (bool, &str)> {
    let mut fenced = false;
    text.lines().map(move |line| {
        if line.trim_start().starts_with("```") {
            fenced = !fenced;
        }
        (fenced, line)
    })
}

/// The names by which a page's headings can be linked to.
fn anchors(text: &str) -> BTreeSet<String> {
    lines(text)
        .filter(|(fenced, line)| !fenced && line.starts_with('#'))
        .map(|(_, line)| {
            let heading = line.trim_start_matches('#').trim().to_lowercase();
            // A link in a heading counts with its text alone.
            let mut shown = String::new();
            let mut rest = heading.as_str();
            while let Some((before, after)) = rest.split_once("](") {
                shown += before;
                rest = after.split_once(')').map_or("", |(_, rest)| rest);
            }
            shown += rest;
            shown
                .chars()
                .filter_map(|c| match c {
                    ' ' => Some('-'),
                    c if c.is_alphanumeric() || c == '-' || c == '_' => Some(c),
                    _ => None,
                })
                .collect()
        })
        .collect()
}

#[test]
fn every_relative_link_of_a_page_leads_somewhere() {
    let mut wrong = Vec::new();
    let mut n_links = 0;
    for (path, name, text) in pages() {
        for (_, line) in lines(&text).filter(|(fenced, _)| !fenced) {
            for link in line.split("](").skip(1) {
                let link = link.split([')', ' ']).next().unwrap();
                if link.contains(':') || link.starts_with('/') {
                    continue;
                }
                n_links += 1;
                let (file, anchor) = link.split_once('#').unwrap_or((link, ""));
                let target = match file {
                    "" => path.clone(),
                    file => path.parent().unwrap().join(file),
                };
                let exists = match anchor {
                    "" => target.exists(),
                    anchor => fs::read_to_string(&target)
                        .is_ok_and(|text| anchors(&text).contains(anchor)),
                };
                if !exists {
                    wrong.push(format!("{name}: {link}"));
                }
            }
        }
    }
    assert!(n_links > 200, "{n_links} links");
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn every_path_in_a_code_span_of_a_page_exists() {
    let mut wrong = Vec::new();
    let mut n_paths = 0;
    for (_, name, text) in pages() {
        for (fenced, line) in lines(&text) {
            let spans: Vec<&str> = match fenced {
                true => vec![line],
                false => line.split('`').skip(1).step_by(2).collect(),
            };
            for word in spans.iter().flat_map(|span| span.split_whitespace()) {
                let word = word.trim_end_matches([',', '.', ';', ':', ')']);
                let plain = |c: char| c.is_alphanumeric() || "_./-".contains(c);
                if !word.chars().all(plain) {
                    continue;
                }
                // SPECIFICATION.md leaves out `crates/`.
                let of_crate = word.split('/').nth(1).is_some_and(|part| {
                    let folder = root().join("crates").join(word.split('/').next().unwrap());
                    (part == "src" || part == "tests") && folder.is_dir()
                });
                let target = match of_crate {
                    true => root().join("crates").join(word),
                    false => root().join(word),
                };
                if of_crate || FOLDERS.iter().any(|folder| word.starts_with(folder)) {
                    n_paths += 1;
                    if !target.exists() {
                        wrong.push(format!("{name}: {word}"));
                    }
                }
            }
        }
    }
    assert!(n_paths > 100, "{n_paths} paths");
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Comments, help texts, hints and examples name pages and configurations, too.
#[test]
fn every_page_and_configuration_that_a_source_names_exists() {
    let mut wrong = Vec::new();
    let mut n_names = 0;
    for (path, name) in files() {
        let kind = name.rsplit('.').next().unwrap();
        if !SOURCES.contains(&kind) || name == "CHANGELOG.md" || name.starts_with("fuzz/corpus/") {
            continue;
        }
        let Ok(text) = fs::read_to_string(&path) else {
            continue;
        };
        let inside = |c: char| c.is_ascii_alphanumeric() || "_./-".contains(c);
        for word in text.split(|c: char| !inside(c)) {
            let word = word.trim_end_matches('.');
            let ends = [".md", ".toml", ".cfg", ".py", ".csv", ".svg", ".png"];
            let begins = ["docs/", "configs/", "studies/"];
            if begins.iter().any(|b| word.starts_with(b)) && ends.iter().any(|e| word.ends_with(e))
            {
                n_names += 1;
                if !root().join(word).exists() {
                    wrong.push(format!("{name}: {word}"));
                }
            }
        }
    }
    assert!(n_names > 100, "{n_names} names");
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// A configuration that names a radar or another configuration names it from its own folder.
#[test]
fn every_file_that_a_configuration_names_exists() {
    fn strings<'a>(value: &'a toml::Value, found: &mut Vec<&'a str>) {
        match value {
            toml::Value::String(text) => found.push(text),
            toml::Value::Array(values) => values.iter().for_each(|v| strings(v, found)),
            toml::Value::Table(table) => table.values().for_each(|v| strings(v, found)),
            _ => {}
        }
    }
    let mut n_names = 0;
    for (path, name) in files() {
        if !name.starts_with("configs/") || !name.ends_with(".toml") {
            continue;
        }
        let table: toml::Table = fs::read_to_string(&path).unwrap().parse().unwrap();
        let value = toml::Value::Table(table);
        let mut found = Vec::new();
        strings(&value, &mut found);
        for file in found {
            if file.ends_with(".toml") || file.ends_with(".cfg") {
                n_names += 1;
                let target = path.parent().unwrap().join(file);
                assert!(target.is_file(), "{name} names {file}");
            }
        }
    }
    assert!(n_names > 10, "{n_names} names");
}
