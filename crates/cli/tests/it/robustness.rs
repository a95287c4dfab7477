//! `robustness`: cells are kept, unchanged clips stay unchanged, bad configurations are named.

use std::{collections::BTreeMap, fs};

use crate::command::{json, radarllm, refused};

#[test]
fn cells_are_made_once_and_scored_against_the_unchanged_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    fs::write(
        path("data.toml"),
        "seed = 3\nmax_frames = 12\nfacet_edge_m = 0.05\n[[source]]\nkind = \"procedural\"\ntrain = 6\nval = 1\ntest = 3\n",
    )
    .unwrap();
    let config = |axes: &str| {
        let text = format!("data = \"data.toml\"\nclips = 3\n{axes}");
        fs::write(path("robustness.toml"), text).unwrap();
    };
    let points = "[[axis]]\nkind = \"points\"\nat_most = [100000, 1]\n";
    let turned = "[[axis]]\nkind = \"aspect\"\nheading_deg = [180]\n";
    config(&format!("{points}{turned}"));
    let (file, out) = (path("robustness.toml"), path("out"));
    let args = ["robustness", &file, "--out", &out, "--json"];
    let first = json(&args);
    let axes = first["axes"].as_array().unwrap();
    assert_eq!(axes.len(), 2);
    let cells = axes[0]["cells"].as_array().unwrap();
    let names: Vec<_> = cells
        .iter()
        .map(|c| c["condition"].as_str().unwrap())
        .collect();
    assert_eq!(names, ["nothing changed", "100000 points", "1 points"]);
    // No frame has so many points: nothing may differ.
    for field in [
        "bleu_1",
        "rouge_l",
        "meteor",
        "cider_d",
        "action_accuracy",
        "points_per_frame",
    ] {
        assert_eq!(cells[0][field], cells[1][field], "{field}");
        assert_eq!(cells[0][field], axes[1]["cells"][0][field], "{field}");
    }
    assert_eq!(cells[1]["action_accuracy_change"]["value"], 0.0);
    assert!(cells[2]["points_per_frame"].as_f64().unwrap() <= 1.0);
    let seen = axes[1]["cells"][1]["points_per_frame"].as_f64().unwrap();
    assert!(seen > 1.0 && cells[0]["points_per_frame"] != axes[1]["cells"][1]["points_per_frame"]);
    assert!(
        fs::read_to_string(path("out/robustness.md"))
            .unwrap()
            .contains("Darkness")
    );
    assert!(
        fs::metadata(path("out/robustness-points.svg"))
            .unwrap()
            .len()
            > 0
    );

    let made = || -> BTreeMap<_, _> {
        fs::read_dir(path("out/cells"))
            .unwrap()
            .map(|entry| entry.unwrap())
            .map(|e| (e.file_name(), e.metadata().unwrap().modified().unwrap()))
            .collect()
    };
    let before = made();
    assert_eq!(before.len(), 4);
    let again = radarllm(&args);
    assert!(
        again.status.success() && again.stderr.is_empty(),
        "nothing is made twice"
    );
    assert_eq!(made(), before);
    // One condition more makes one cell more; --plan makes none.
    config(&format!(
        "{points}{turned}[[axis]]\nkind = \"frame-loss\"\nprobability = [1.0]\n"
    ));
    let plan = radarllm(&["robustness", &file, "--out", &out, "--plan"]);
    let plan = String::from_utf8(plan.stdout).unwrap();
    assert_eq!(
        (plan.matches("done ").count(), plan.matches("to do").count()),
        (4, 1),
        "{plan}"
    );
    // Another way of describing is another model.
    let other = radarllm(&[
        "robustness",
        &file,
        "--out",
        &out,
        "--plan",
        "--decoder",
        "int8",
    ]);
    let other = String::from_utf8(other.stdout).unwrap();
    assert_eq!(other.matches("to do").count(), 5, "{other}");

    for (axes, word) in [
        ("", "axis"),
        ("[[axis]]\nkind = \"fog\"\n", "fog"),
        (
            "[[axis]]\nkind = \"radar\"\nradars = [\"abacus\"]\n",
            "abacus",
        ),
        (
            "split = \"exam\"\n[[axis]]\nkind = \"rain\"\nrain_mm_per_h = [1]\n",
            "exam",
        ),
        // Beyond the maximum range of the radar, and nearer than a body can be.
        (
            "[[axis]]\nkind = \"distance\"\ndistance_m = [8.0, 12.0]\n",
            "10.99 m",
        ),
        (
            "[[axis]]\nkind = \"distance\"\ndistance_m = [1.0, 3.0]\n",
            "1.3 m",
        ),
    ] {
        config(axes);
        let stderr = refused(&args);
        assert!(stderr.contains(word), "{stderr} should name {word}");
    }
}
