//! `lm logits` on a checkpoint folder made from the model's goldens.

use std::{fs, path::Path};

use radarllm_files::npy::NpyArray;

use crate::command::{json, refused};

/// `config.json` and `model.safetensors` of a tiny network; its golden file carries both.
pub fn folder(golden: &str, dir: &Path) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../nn/tests/goldens");
    let bytes = fs::read(path.join(golden)).unwrap();
    let len = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
    let mut header: serde_json::Value = serde_json::from_slice(&bytes[8..8 + len]).unwrap();
    let config = header["__metadata__"]["config"].take();
    fs::write(dir.join("config.json"), config.as_str().unwrap()).unwrap();
    // The golden's inputs and outputs are no weights.
    let entries = header.as_object_mut().unwrap();
    entries.remove("__metadata__");
    let mut kept = serde_json::Map::new();
    let mut data = Vec::new();
    for (name, entry) in entries.iter() {
        let inputs = ["input_ids", "attention_mask", "decoder_input_ids", "output"];
        if inputs.contains(&name.as_str()) {
            continue;
        }
        let at = |i: usize| entry["data_offsets"][i].as_u64().unwrap() as usize + 8 + len;
        let from = data.len();
        data.extend_from_slice(&bytes[at(0)..at(1)]);
        let mut entry = entry.clone();
        entry["data_offsets"] = serde_json::json!([from, data.len()]);
        kept.insert(name.clone(), entry);
    }
    let header = serde_json::to_vec(&kept).unwrap();
    let mut out = (header.len() as u64).to_le_bytes().to_vec();
    out.extend(header);
    out.extend(data);
    fs::write(dir.join("model.safetensors"), out).unwrap();
}

#[test]
fn logits_and_hidden_states_are_written() {
    for (golden, ids, shape) in [
        (
            "gpt2.safetensors",
            r#"{"input_ids": [[5, 6, 7]]}"#,
            [1, 3, 40],
        ),
        (
            "qwen2.safetensors",
            r#"{"input_ids": [[5, 6], [7, 8]]}"#,
            [2, 2, 40],
        ),
        (
            "bert.safetensors",
            r#"{"input_ids": [[5, 6, 7]]}"#,
            [1, 3, 16],
        ),
        (
            "t5_left.safetensors",
            r#"{"input_ids": [[5, 6, 7]], "decoder_input_ids": [[0, 9]]}"#,
            [1, 2, 40],
        ),
    ] {
        let dir = tempfile::tempdir().unwrap();
        folder(golden, dir.path());
        let (file, out) = (dir.path().join("ids.json"), dir.path().join("out.npy"));
        fs::write(&file, ids).unwrap();
        let arguments = [
            "lm",
            "logits",
            "--json",
            "--weights",
            dir.path().to_str().unwrap(),
            "--ids",
            file.to_str().unwrap(),
            "--out",
            out.to_str().unwrap(),
        ];
        let report = json(&arguments);
        assert_eq!(report["shape"], serde_json::json!(shape), "{golden}");
        let npy = NpyArray::new(fs::read(&out).unwrap()).unwrap();
        let values = npy.numbers_f32().unwrap();
        assert_eq!(values.len(), shape.iter().product::<usize>());
        assert!(values.iter().all(|v| v.is_finite()));
        // A second time: refused without --force.
        assert!(refused(&arguments).contains("exists already"));
    }
}

#[test]
fn what_is_no_model_is_not_packed() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("packed");
    let (folder, out_text) = (dir.path().to_str().unwrap(), out.to_str().unwrap());
    for verb in ["pack", "tokens"] {
        for model in ["features", "nowhere", folder] {
            let problem = refused(&["lm", verb, "--model", model, "--out", out_text]);
            for part in [model, "not a checkpoint", "`tokenizer` and `lm`"] {
                assert!(problem.contains(part), "{part}: {problem}");
            }
            assert!(!out.exists());
        }
        // Neither has an option that replaces anything.
        let problem = refused(&["lm", verb, "--model", folder, "--out", folder]);
        assert!(
            problem.contains("give another --out") && !problem.contains("--force"),
            "{problem}"
        );
    }
}

#[test]
fn folders_and_ids_that_do_not_fit_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let ids = dir.path().join("ids.json");
    let out = dir.path().join("out.npy");
    let run = |expected: &str| {
        let arguments = [
            "lm",
            "logits",
            "--weights",
            dir.path().to_str().unwrap(),
            "--ids",
            ids.to_str().unwrap(),
            "--out",
            out.to_str().unwrap(),
        ];
        let problem = refused(&arguments);
        assert!(problem.contains(expected), "{problem}");
        assert!(!out.exists());
    };
    fs::write(&ids, "{\"input_ids\": [[1, 2]]}").unwrap();
    run("config.json");
    folder("gpt2.safetensors", dir.path());
    fs::write(&ids, "{\"input_ids\": [[1, 99]]}").unwrap();
    run("id 99 is beyond the vocabulary of 40");
    fs::write(&ids, "{\"ids\": [[1]]}").unwrap();
    run("ids.json");
    fs::write(&ids, "{\"input_ids\": [[1, 2]]}").unwrap();
    fs::write(
        dir.path().join("config.json"),
        "{\"model_type\": \"llama\"}",
    )
    .unwrap();
    run("llama");
}
