//! `baselines run` from end to end, with the configuration of `configs/eval/baselines-tiny.toml`.
#![cfg(feature = "train")]

use std::{fs, path::Path};

use serde_json::Value;

use crate::command::{radarllm, refused};

/// Copies the configurations into `folder`, so that what they name relative to themselves lies there.
fn configs(folder: &Path) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    for name in [
        "configs/eval/baselines-tiny.toml",
        "configs/train/baselines-tiny-model.toml",
        "configs/data/baselines-tiny.toml",
    ] {
        let to = folder.join(name);
        fs::create_dir_all(to.parent().unwrap()).unwrap();
        fs::copy(root.join(name), to).unwrap();
    }
}

fn done(args: &[&str]) -> String {
    let output = radarllm(args);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{args:?}: {stderr}");
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn every_row_is_scored_or_says_why_not_and_a_second_run_changes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    configs(folder.path());
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    let config = path("configs/eval/baselines-tiny.toml");
    let plan = done(&["baselines", "run", &config, "--plan"]);
    assert!(plan.contains("stages, 0 done"), "{plan}");

    // Only one row first, as if the rest had been interrupted.
    let row = "mmMesh and MotionGPT style";
    done(&["baselines", "run", &config, "--only", row]);
    let table =
        |name: &str| fs::read_to_string(path(&format!("work/baselines-tiny/{name}"))).unwrap();
    assert!(table("table.md").contains("not run: left out by --only"));
    let first: Value = serde_json::from_str(&table("table.json")).unwrap();

    done(&["baselines", "run", &config]);
    let report: Value = serde_json::from_str(&table("table.json")).unwrap();
    let rows = report["rows"].as_array().unwrap();
    assert_eq!((report["clips"].as_u64(), rows.len()), (Some(10), 21));
    for row in rows {
        let (name, kind) = (&row["name"], row["kind"].as_str().unwrap());
        let is_run = !["not_run", "answers"].contains(&kind);
        assert_eq!(row["result"].is_object(), is_run, "{name}");
        assert_eq!(row["not_run"].is_string(), !is_run, "{name}");
        if ["radar", "estimated_motion", "true_motion"].contains(&kind) {
            assert!(
                row["cost"]["parameters"].as_u64().unwrap() > 10_000,
                "{name}"
            );
            assert!(
                row["cost"]["training_minutes"].as_f64().unwrap() > 0.0,
                "{name}"
            );
        }
    }
    // What was run alone stands in the whole table too.
    let of = |report: &Value, name: &str| {
        let rows = report["rows"].as_array().unwrap();
        rows.iter().find(|r| r["name"] == name).unwrap().clone()
    };
    for name in ["RadarLLM (ours)", row] {
        assert_eq!(of(&first, name), of(&report, name));
    }
    // A bad copy cannot state what the references state: shuffled captions are other clips' captions.
    let pose: Value = serde_json::from_str(&table("pose.json")).unwrap();
    let systems = pose["table"]["rows"].as_array().unwrap();
    assert_eq!(systems.len(), 3);
    for system in &systems[1..] {
        assert_eq!(
            system["mte_cm"]["value"], 0.0,
            "floors are given the true place"
        );
    }

    let before = (table("table.md"), table("table.json"), table("pose.json"));
    done(&["baselines", "run", &config]);
    assert_eq!(
        before,
        (table("table.md"), table("table.json"), table("pose.json"))
    );
    let plan = done(&["baselines", "run", &config, "--plan"]);
    assert!(
        !plan.contains("to do  config")
            && plan.contains("done   captions: facts by rules to sentence"),
        "{plan}"
    );

    // `score` on the captions of a row gives the row.
    let lines = |name: &str| table(&format!("captions/{name}.jsonl"));
    let captions = lines("nearest-training-clip");
    assert_eq!(captions.lines().count(), 10);
    let [candidates, references] = ["captions/nearest-training-clip.jsonl", "references.jsonl"]
        .map(|name| path(&format!("work/baselines-tiny/{name}")));
    let scored = done(&[
        "score",
        "--candidates",
        &candidates,
        "--references",
        &references,
        "--max-references",
        "3",
    ]);
    let scored: Value = serde_json::from_str(&scored).unwrap();
    let row = of(&report, "nearest training clip");
    for metric in ["rouge_1", "rouge_l", "bleu_1", "bleu_4", "cider_d"] {
        assert_eq!(scored[metric], row["result"]["scores"][metric], "{metric}");
    }

    // Captions without their head, as of a run that was killed between the two, are made again and are the same.
    fs::remove_file(path(
        "work/baselines-tiny/captions/nearest-training-clip.json",
    ))
    .unwrap();
    fs::write(
        path("work/baselines-tiny/captions/nearest-training-clip.jsonl"),
        "{\"id\"",
    )
    .unwrap();
    done(&["baselines", "run", &config]);
    assert_eq!(lines("nearest-training-clip"), captions);

    // Captions of other clips are refused, with the file and the clip.
    let file = path("work/baselines-tiny/captions/nearest-training-clip.jsonl");
    fs::write(&file, captions.replacen("\"id\":\"", "\"id\":\"other-", 1)).unwrap();
    let problem = refused(&["baselines", "run", &config]);
    assert!(
        problem.contains("nearest-training-clip.jsonl") && problem.contains("clip"),
        "{problem}"
    );

    // Built anew in the same folder, the data are other data: nothing that was made of the earlier ones counts.
    let data = path("configs/data/baselines-tiny.toml");
    let text = fs::read_to_string(&data).unwrap();
    fs::write(&data, text.replace("seed = 41", "seed = 42")).unwrap();
    let folder = path("work/baselines-tiny-data");
    done(&["dataset", "build", &data, "--out", &folder, "--force"]);
    let plan = done(&["baselines", "run", &config, "--plan"]);
    assert!(
        plan.contains("stages, 0 done") && !plan.contains("done   captions"),
        "{plan}"
    );
}

#[test]
fn slips_in_a_comparison_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    configs(folder.path());
    let config = folder.path().join("configs/eval/baselines-tiny.toml");
    let text = fs::read_to_string(&config).unwrap();
    let config = config.to_str().unwrap();
    let problem = refused(&["baselines", "run", config, "--only", "nobody", "--plan"]);
    assert!(
        problem.contains("nobody") && problem.contains("rows are"),
        "{problem}"
    );
    for (from, to, expected) in [
        (
            "set = { \"pretrain.codes\" = \"motion\" }",
            "",
            "pretrain.codes",
        ),
        (
            "\"pretrain.projected\" = true",
            "\"pretrain.projectd\" = true",
            "projectd",
        ),
        ("kind = \"radar\"", "kind = \"facts\"", "first row"),
        ("out = ", "split = \"tset\"\nout = ", "tset"),
        (
            "\"mmMesh and MotionGPT style\"",
            "\"RadarLLM, ours\"",
            "captions/radarllm-ours.jsonl",
        ),
    ] {
        fs::write(config, text.replacen(from, to, 1)).unwrap();
        let problem = refused(&["baselines", "run", config, "--plan"]);
        assert!(problem.contains(expected), "{expected}: {problem}");
    }
}
