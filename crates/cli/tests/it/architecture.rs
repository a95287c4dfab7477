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

/// The folder of one of our crates: its name without `radarllm-`, or `radarllm` itself.
fn folder_of(package: &str) -> Option<&str> {
    match package {
        "radarllm" => Some(package),
        other => other.strip_prefix("radarllm-"),
    }
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
            .filter_map(|name| folder_of(name))
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

/// What a crate of ours can link: our crates by their folders, and all others by the lock file. `is_on` decides about the
/// optional dependencies of each of our crates; those of others count, so the set is never too small.
fn linked(
    start: &str,
    is_on: impl Fn(&str, &toml::Table, &str) -> bool,
) -> (BTreeSet<String>, BTreeSet<String>) {
    let manifest = |folder: &str| -> toml::Table {
        let path = root().join("crates").join(folder).join("Cargo.toml");
        fs::read_to_string(path).unwrap().parse().unwrap()
    };
    let (mut ours, mut others) = (BTreeSet::new(), BTreeSet::new());
    let mut open = vec![start.to_string()];
    while let Some(folder) = open.pop() {
        if !ours.insert(folder.clone()) {
            continue;
        }
        let manifest = manifest(&folder);
        let everywhere = manifest["dependencies"].as_table().unwrap().clone();
        let targets = manifest.get("target").and_then(|t| t.as_table()).cloned();
        let of_targets = targets
            .into_iter()
            .flatten()
            .flat_map(|(_, target)| target["dependencies"].as_table().cloned().unwrap());
        for (name, how) in everywhere.into_iter().chain(of_targets) {
            let optional = how.get("optional").and_then(|o| o.as_bool()) == Some(true);
            if optional && !is_on(&folder, &manifest, &name) {
                continue;
            }
            match folder_of(&name) {
                Some(own) => open.push(own.to_string()),
                None => {
                    others.insert(name);
                }
            }
        }
    }
    let lock: toml::Table = fs::read_to_string(root().join("Cargo.lock"))
        .unwrap()
        .parse()
        .unwrap();
    let mut edges: BTreeMap<&str, BTreeSet<&str>> = BTreeMap::new();
    for package in lock["package"].as_array().unwrap() {
        let uses = package.get("dependencies").and_then(|d| d.as_array());
        let names = uses.into_iter().flatten().filter_map(|d| d.as_str());
        // "name", or "name version" where there are several.
        let names = names.filter_map(|d| d.split(' ').next());
        let name = package["name"].as_str().unwrap();
        edges.entry(name).or_default().extend(names);
    }
    let mut reached: BTreeSet<String> = BTreeSet::new();
    let mut open: Vec<String> = others.into_iter().collect();
    while let Some(name) = open.pop() {
        if reached.insert(name.clone()) {
            open.extend(edges[&*name].iter().map(ToString::to_string));
        }
    }
    (ours, reached)
}

/// The dependencies that the default features of a manifest switch on.
fn on_by_default(manifest: &toml::Table) -> BTreeSet<String> {
    let features = manifest.get("features").and_then(|f| f.as_table());
    let mut open = vec!["default".to_string()];
    let mut on = BTreeSet::new();
    while let Some(name) = open.pop() {
        if let Some(dependency) = name.strip_prefix("dep:") {
            on.insert(dependency.to_string());
        } else if let Some(parts) = features.and_then(|f| f.get(&name)?.as_array()) {
            open.extend(parts.iter().filter_map(|p| p.as_str()).map(Into::into));
        }
    }
    on
}

/// Invariant 9.
#[test]
fn the_default_build_links_no_learning_framework() {
    let (ours, reached) = linked("cli", |folder, manifest, name| {
        folder != "cli" || on_by_default(manifest).contains(name)
    });
    assert!(
        ours.contains("inference") && !ours.contains("nn") && !ours.contains("train"),
        "{ours:?}"
    );
    assert!(reached.contains("parquet"), "the walk reaches something");
    let burn: Vec<_> = reached.iter().filter(|n| n.starts_with("burn")).collect();
    assert!(burn.is_empty(), "{burn:?}");
    for name in ["tokenizers", "npyz", "png", "tar"] {
        assert!(!reached.contains(name), "{name}");
    }
}

/// The README's first command is quick to build. `clap` is reached by benches of a dependency, which nobody builds.
#[test]
fn the_demo_links_neither_a_command_line_nor_a_database_nor_a_server() {
    let (ours, reached) = linked("demo", |_, _, _| false);
    assert!(
        ours.contains("inference") && ours.contains("synth"),
        "{ours:?}"
    );
    for name in ["cli", "eval", "live", "memory", "nn", "train"] {
        assert!(!ours.contains(name), "{name}");
    }
    assert!(reached.contains("rustfft"), "the walk reaches something");
    for name in [
        "arrow-array",
        "axum",
        "libsqlite3-sys",
        "mcap",
        "parquet",
        "rumqttc",
        "tokenizers",
    ] {
        assert!(!reached.contains(name), "{name}");
    }
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

/// docs/concepts/validation.md: every test it names is one, every scene it names is there, and none is left out.
#[test]
fn the_table_of_closed_forms_names_tests_and_scenes_that_exist() {
    let text = fs::read_to_string(root().join("docs/concepts/validation.md")).unwrap();
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
    let files: BTreeSet<String> = fs::read_dir(root().join("studies/closed-forms"))
        .unwrap()
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .filter(|name| name.ends_with(".toml"))
        .collect();
    assert!(scenes.is_subset(&files), "{scenes:?}");
    // `screen` is what `hidden` is compared with; `point_1m` stands in two rows.
    let unnamed: Vec<_> = files.difference(&scenes).collect();
    assert_eq!(unnamed, ["screen.toml"]);
}
