//! Numbers that several pages quote are those of docs/results/headline.toml.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::Path,
};

struct Number {
    name: String,
    /// The same value in the forms that pages use; a count first, if it is one.
    texts: Vec<String>,
    measured_on: String,
    quoted_on: Vec<String>,
}

fn read(page: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../..")
        .join(page);
    fs::read_to_string(&path).unwrap_or_else(|e| panic!("{page}: {e}"))
}

fn numbers() -> Vec<Number> {
    let table: toml::Table = read("docs/results/headline.toml").parse().unwrap();
    let text = |row: &toml::Value, key: &str| row[key].as_str().unwrap().to_string();
    let texts = |row: &toml::Value, key: &str| -> Vec<String> {
        let list = row[key].as_array().unwrap().iter();
        list.map(|v| v.as_str().unwrap().to_string()).collect()
    };
    let numbers: Vec<Number> = table["number"]
        .as_array()
        .unwrap()
        .iter()
        .map(|row| {
            assert!(!text(row, "meaning").is_empty() && !text(row, "command").is_empty());
            Number {
                name: text(row, "name"),
                texts: texts(row, "texts"),
                measured_on: text(row, "measured_on"),
                quoted_on: texts(row, "quoted_on"),
            }
        })
        .collect();
    assert!(numbers.len() >= 20, "{} numbers", numbers.len());
    numbers
}

/// Whether a page contains a text that is not a part of a longer number.
fn contains(page: &str, text: &str) -> bool {
    page.match_indices(text).any(|(at, _)| {
        let before = page[..at].chars().next_back();
        let after = page[at + text.len()..].chars().next();
        !before.is_some_and(|c| c.is_ascii_digit() || c == '.')
            && !after.is_some_and(|c| c.is_ascii_digit())
    })
}

/// `76 of 78` as two numbers.
fn count(text: &str) -> Option<(u32, u32)> {
    let (part, whole) = text.split_once(" of ")?;
    Some((part.parse().ok()?, whole.parse().ok()?))
}

#[test]
fn every_page_that_quotes_a_number_has_it() {
    let mut wrong = Vec::new();
    for number in numbers() {
        for page in number.quoted_on.iter().chain([&number.measured_on]) {
            let text = read(page);
            if !number.texts.iter().any(|t| contains(&text, t)) {
                wrong.push(format!(
                    "{page}: none of {:?} ({})",
                    number.texts, number.name
                ));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// A page with `74 of 78` contradicts one with `76 of 78`, unless both are listed.
#[test]
fn a_quoting_page_has_no_other_count_of_the_same_set() {
    let mut allowed: BTreeMap<String, BTreeSet<(u32, u32)>> = BTreeMap::new();
    let mut sets: BTreeMap<String, BTreeSet<u32>> = BTreeMap::new();
    for number in numbers() {
        let Some(of) = count(&number.texts[0]) else {
            continue;
        };
        for page in number.quoted_on.iter().chain([&number.measured_on]) {
            allowed.entry(page.clone()).or_default().insert(of);
        }
        for page in number.quoted_on {
            sets.entry(page).or_default().insert(of.1);
        }
    }
    let mut wrong = Vec::new();
    for (page, sets) in sets {
        let text = read(&page);
        for (at, _) in text.match_indices(" of ") {
            let digits = |c: char| c.is_ascii_digit();
            let part = text[..at].rsplit(|c| !digits(c)).next().unwrap();
            let whole = text[at + 4..].split(|c| !digits(c)).next().unwrap();
            let Some(found) = count(&format!("{part} of {whole}")) else {
                continue;
            };
            if sets.contains(&found.1) && !allowed[&page].contains(&found) {
                wrong.push(format!("{page}: {part} of {whole}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn percentages_are_those_of_the_counts() {
    for number in numbers() {
        let Some((part, whole)) = count(&number.texts[0]) else {
            continue;
        };
        let exact = 100.0 * f64::from(part) / f64::from(whole);
        for text in &number.texts[1..] {
            let percent = text.strip_suffix(" %").unwrap();
            let decimals = percent.split_once('.').map_or(0, |(_, d)| d.len());
            let off = (percent.parse::<f64>().unwrap() - exact).abs();
            // A half may be rounded either way.
            let limit = 0.5 * 0.1_f64.powi(decimals as i32) + 1e-9;
            assert!(off <= limit, "{}: {text} of {exact}", number.name);
        }
    }
}
