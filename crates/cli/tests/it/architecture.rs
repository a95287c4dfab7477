//! The table in ARCHITECTURE.md is the real dependency graph of the workspace.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Path, PathBuf},
};

type Edges = BTreeMap<String, BTreeSet<String>>;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn edges_of_manifests() -> Edges {
    let mut edges = Edges::new();
    for entry in fs::read_dir(root().join("crates")).unwrap() {
        let folder = entry.unwrap().path();
        let manifest: toml::Table = fs::read_to_string(folder.join("Cargo.toml"))
            .unwrap()
            .parse()
            .unwrap();
        // Development dependencies are tests' business and may point anywhere.
        let uses = manifest["dependencies"]
            .as_table()
            .unwrap()
            .keys()
            .filter_map(|name| name.strip_prefix("radarllm-"))
            .map(String::from)
            .collect();
        edges.insert(
            folder.file_name().unwrap().to_str().unwrap().to_string(),
            uses,
        );
    }
    edges
}

fn edges_of_table() -> Edges {
    let text = fs::read_to_string(root().join("ARCHITECTURE.md")).unwrap();
    let (_, rest) = text
        .split_once("<!-- edges:begin -->")
        .expect("table start");
    let (table, _) = rest.split_once("<!-- edges:end -->").expect("table end");
    table
        .lines()
        .filter(|line| line.starts_with('|'))
        .skip(2)
        .map(|line| {
            let cells: Vec<&str> = line.split('|').map(str::trim).collect();
            (
                cells[1].to_string(),
                cells[2].split_whitespace().map(String::from).collect(),
            )
        })
        .collect()
}

#[test]
fn the_table_is_the_real_dependency_graph() {
    assert_eq!(edges_of_table(), edges_of_manifests());
}

#[test]
fn every_entry_point_of_the_map_exists() {
    let text = fs::read_to_string(root().join("ARCHITECTURE.md")).unwrap();
    let mut seen = 0;
    for path in text
        .split('`')
        .filter(|s| s.starts_with("crates/") && s.ends_with(".rs"))
    {
        if path.contains('<') {
            continue;
        }
        seen += 1;
        assert!(
            root().join(path).is_file(),
            "ARCHITECTURE.md names {path}, which does not exist"
        );
    }
    assert!(seen > 5, "the map names its files");
}

/// docs/validation.md: every test it names is one, every scene it names is there, and none is left out.
#[test]
fn the_table_of_closed_forms_names_tests_and_scenes_that_exist() {
    let text = fs::read_to_string(root().join("docs/validation.md")).unwrap();
    let mut tests = String::new();
    for folder in ["radar-sim", "radar-dsp", "synth"] {
        for entry in fs::read_dir(root().join("crates").join(folder).join("tests/it")).unwrap() {
            tests += &fs::read_to_string(entry.unwrap().path()).unwrap();
        }
    }
    let mut scenes = BTreeSet::new();
    for row in text
        .lines()
        .filter(|l| l.starts_with("| ") && l.ends_with(" |"))
    {
        let cells: Vec<&str> = row.trim_matches('|').split(" | ").map(str::trim).collect();
        let [.., test, scene] = cells[..] else {
            panic!("{row}")
        };
        if scene == "scene" {
            continue;
        }
        let test = test.trim_matches('`');
        assert!(tests.contains(&format!("fn {test}()")), "no test {test}");
        if scene != "-" {
            scenes.insert(scene.trim_matches('`').to_string());
        }
    }
    let files: BTreeSet<String> = fs::read_dir(root().join("docs/validation"))
        .unwrap()
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .filter(|name| name.ends_with(".toml"))
        .collect();
    assert!(scenes.is_subset(&files), "{scenes:?}");
    // `screen` is what `hidden` is compared with; `point_1m` stands in two rows.
    let unnamed: Vec<_> = files.difference(&scenes).collect();
    assert_eq!(unnamed, ["screen.toml"]);
}
