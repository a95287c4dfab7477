//! The chain end to end, small: data set, training of every stage, captions, report.

use std::fs;

use crate::command::{json, radarllm};

#[test]
fn radar_lint_points_into_the_file_and_fails_on_errors() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("profile.cfg");
    let path = path.to_str().unwrap();
    let good = "% Platform:xWR18xx\nchannelCfg 15 7 0\nadcCfg 2 1\n\
        profileCfg 0 77 7 7 58 0 0 67 1 256 5500 0 0 30\nchirpCfg 0 0 0 0 0 0 0 1\n\
        chirpCfg 1 1 0 0 0 0 0 4\nchirpCfg 2 2 0 0 0 0 0 2\nframeCfg 0 2 40 0 55 1 0\n";
    std::fs::write(path, good).unwrap();
    let output = radarllm(&["radar", "lint", path]);
    assert_eq!(output.status.code(), Some(0), "warnings are no errors");
    let text = String::from_utf8(output.stdout).unwrap();
    let expected = format!(
        "{path}:8:19: note[model-frame-rate]: 18.18 frames/s, but the default model reads 10: \
         `describe` joins frames\n    \
         8 | frameCfg 0 2 40 0 55 1 0\n      |                   ^^ frameCfg frame period, ms\n"
    );
    assert!(text.contains(&expected), "{text}");
    let rows = json(&["radar", "lint", path, "--json"]);
    let mut rows = rows.as_array().unwrap().iter();
    let row = rows.find(|r| r["rule"] == "model-frame-rate").unwrap();
    assert_eq!(
        (&row["field"], &row["severity"]),
        (&"frame_period_s".into(), &"note".into())
    );
    assert_eq!(
        (&row["line"], &row["column"], &row["length"]),
        (&8.into(), &19.into(), &2.into())
    );

    std::fs::write(path, good.replace("7 7 58", "7 7 50")).unwrap();
    let output = radarllm(&["radar", "lint", path, "--json"]);
    assert_eq!(output.status.code(), Some(1));
    let rows: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(rows[0]["rule"], "adc-window");
}

#[test]
fn radar_show_prints_the_reference_radar() {
    let radar = json(&["radar", "show", "awr1843boost", "--json"]);
    let close = |field: &str, value: f64| {
        let found = radar[field].as_f64().unwrap();
        assert!(
            (found / value - 1.0).abs() < 1e-3,
            "{field}: {found}, expected {value}"
        );
    };
    // By hand from the chirp: see CONVENTIONS.md.
    close("range_resolution_m", 0.042_93);
    close("max_range_m", 10.99);
    close("max_velocity_mps", 4.386);
    close("frame_rate_hz", 10.0);
    close("sampled_bandwidth_hz", 3.4916e9);
    assert_eq!(radar["n_tx"], 3);
    assert_eq!(radar["n_loops"], 128);
}

#[test]
fn a_data_set_is_the_same_whatever_the_thread_count() {
    let folder = tempfile::tempdir().unwrap();
    let config = folder.path().join("data.toml");
    fs::write(
        &config,
        "name = \"tiny\"\nseed = 5\nshard_clips = 2\nmax_frames = 12\n[[source]]\nkind = \"procedural\"\ntrain = 4\nval = 1\ntest = 1\n",
    )
    .unwrap();
    let mut listings = Vec::new();
    for threads in ["1", "2"] {
        let out = folder.path().join(format!("data{threads}"));
        let done = radarllm(&[
            "dataset",
            "build",
            config.to_str().unwrap(),
            "--out",
            out.to_str().unwrap(),
            "--threads",
            threads,
        ]);
        assert!(
            done.status.success(),
            "{}",
            String::from_utf8_lossy(&done.stderr)
        );
        json(&["dataset", "validate", out.to_str().unwrap(), "--json"]);
        let info = json(&["dataset", "info", out.to_str().unwrap(), "--json"]);
        assert_eq!(info["total"]["clips"], 6);
        let mut files: Vec<_> = [out.clone(), out.join("data")]
            .iter()
            .flat_map(|folder| fs::read_dir(folder).unwrap())
            .map(|e| e.unwrap().path())
            .filter(|p| p.is_file())
            .map(|p| (p.file_name().unwrap().to_owned(), fs::read(&p).unwrap()))
            .collect();
        files.sort();
        listings.push(files);
    }
    assert!(
        listings[0] == listings[1],
        "one and two threads give the same bytes"
    );
}

#[test]
fn demo_describes_motions_and_the_recording_of_a_simulated_board() {
    let demo = json(&["demo", "--json"]);
    let rows = demo.as_array().unwrap();
    let (board, motions) = rows.split_last().unwrap();
    assert_eq!(motions.len(), 3);
    for row in motions {
        assert_eq!(row["synthetic"], true);
        assert_eq!(row["simulated_board"], false);
        assert!(row["source"].as_str().unwrap().starts_with("builtin:"));
        assert_eq!(row["parts"][0]["verdict"], "right", "{row}");
        assert!(row["model"].as_str().is_some());
    }
    assert_eq!(board["provenance"], "simulated");
    assert_eq!(board["simulated_board"], true);
    assert_eq!(board["source"], "simulated-uart.dat");
    let parts = board["parts"].as_array().unwrap();
    let performed: std::collections::BTreeSet<_> = parts
        .iter()
        .map(|part| part["performed"].as_str().unwrap())
        .collect();
    assert_eq!(performed.len(), 4, "{parts:?}");
    for row in rows {
        assert!(row["confidence"].as_f64().unwrap() > 0.0);
    }

    let one = json(&["demo", "builtin:squat", "--json"]);
    assert_eq!(one.as_array().unwrap().len(), 1);
}

/// A few updates of every stage on a few clips: not a good model, but the whole path from a data
/// set to a report, twice, with an interruption in between.
#[cfg(feature = "train")]
#[test]
fn every_stage_trains_resumes_and_is_evaluated() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    fs::write(
        path("data.toml"),
        "seed = 2\nmax_frames = 24\nfacet_edge_m = 0.05\n[[source]]\nkind = \"procedural\"\ntrain = 8\nval = 2\ntest = 4\n",
    )
    .unwrap();
    fs::write(
        path("model.toml"),
        r#"
        data = "data"
        out = "trained"
        [motion]
        batch_size = 4
        codebook = { init_after = 1, init_inputs_per_code = 1 }
        model = { width = 16, codebook_size = 8 }
        [motion.loop]
        epochs = 0
        max_steps = 8
        [tokenizer]
        batch_size = 4
        codebook = { init_after = 1, init_inputs_per_code = 1 }
        model = { width = 16, heads = 2, layers = 1, code_dim = 16, codebook_size = 8 }
        [tokenizer.loop]
        epochs = 0
        max_steps = 8
        [pretrain]
        batch = 8
        sampling = { text_to_radar = 3.0 }
        [pretrain.loop]
        epochs = 0
        max_steps = 120
        [instruct]
        batch = 8
        sampling = { text_to_radar = 4.0 }
        [instruct.loop]
        epochs = 0
        max_steps = 10
        [points]
        model = { points = 16, width = 8, hidden = 32 }
        [points.loop]
        epochs = 0
        max_steps = 20
        "#,
    )
    .unwrap();
    let done = |args: &[&str]| {
        let output = radarllm(args);
        assert!(
            output.status.success(),
            "{args:?}: {}",
            String::from_utf8_lossy(&output.stderr)
        );
    };
    done(&[
        "dataset",
        "build",
        &path("data.toml"),
        "--out",
        &path("data"),
    ]);
    done(&["train", "motion", &path("model.toml")]);
    // Begun without --resume or --force, a finished stage is not touched.
    crate::command::refused(&["train", "motion", &path("model.toml")]);
    // Nor is it removed for a processor that cannot be used.
    for device in [
        "toaster",
        #[cfg(not(feature = "gpu"))]
        "gpu",
    ] {
        let model = path("model.toml");
        crate::command::refused(&["train", "motion", &model, "--force", "--device", device]);
        assert!(fs::exists(path("trained/motion/final")).unwrap());
    }
    // Stopped before its first checkpoint was complete, a stage starts afresh.
    fs::create_dir_all(path("trained/tokenizer/step-00000004.tmp")).unwrap();
    fs::write(
        path("trained/tokenizer/step-00000004.tmp/model.safetensors"),
        "half a file",
    )
    .unwrap();
    fs::write(
        path("trained/tokenizer/log.jsonl"),
        "{\"left\": \"over\"}\n",
    )
    .unwrap();
    done(&["train", "all", &path("model.toml"), "--resume"]);
    let log = fs::read_to_string(path("trained/tokenizer/log.jsonl")).unwrap();
    assert!(!log.contains("over") && log.contains("loss"), "{log}");
    assert!(!fs::exists(path("trained/tokenizer/step-00000004.tmp")).unwrap());
    // What is finished is resumed without a change.
    let weights = || fs::read(path("trained/model/lm/model.safetensors")).unwrap();
    let before = weights();
    done(&["train", "all", &path("model.toml"), "--resume"]);
    assert!(weights() == before);
    let model = path("trained/model");
    done(&[
        "eval",
        "--model",
        &model,
        "--data",
        &path("data"),
        "--out",
        &path("report"),
    ]);
    let report: serde_json::Value =
        serde_json::from_slice(&fs::read(path("report/report.json")).unwrap()).unwrap();
    assert_eq!(report["clips"], 4);
    let in_bins = |field: &str| -> u64 {
        let slices = report[field].as_array().unwrap();
        slices.iter().map(|s| s["clips"].as_u64().unwrap()).sum()
    };
    assert_eq!((in_bins("by_length"), in_bins("by_n_actions")), (4, 4));
    assert!(report["tokens_per_s"].as_f64().unwrap() > 0.0);
    assert!(report["model_bytes"].as_u64().unwrap() > 4 * report["parameters"].as_u64().unwrap());
    let page = fs::read_to_string(path("report/report.html")).unwrap();
    // Best, median and worst are the same four clips, and every action has one.
    let actions = report["by_action"].as_array().unwrap().len();
    assert_eq!(page.matches("class=\"example\"").count(), 12 + actions);
    let names: Vec<_> = report["systems"]
        .as_array()
        .unwrap()
        .iter()
        .map(|s| s["name"].as_str().unwrap())
        .collect();
    let cut = ["tokens_only", "without_tokens", "permuted_tokens"];
    let names_of_all = [&["model"][..], &cut, &["shuffled", "majority", "nearest"]].concat();
    assert_eq!(names, names_of_all);
    assert_eq!(
        fs::read_to_string(path("report/captions.jsonl"))
            .unwrap()
            .lines()
            .count(),
        4
    );

    uses_what_was_tuned(&model, &path);
    reads_two_codes_a_step(&model, &path);
    makes_whole_models_only(&model, &path);

    // A decoder alone on the same tokenizer.
    fs::create_dir(path("alone")).unwrap();
    for stage in ["motion", "tokenizer"] {
        fs::rename(
            path(&format!("trained/{stage}")),
            path(&format!("alone/{stage}")),
        )
        .unwrap();
    }
    let recipe = fs::read_to_string(path("model.toml")).unwrap();
    let recipe = recipe
        .replace("out = \"trained\"", "out = \"alone\"")
        .replace(
            "[pretrain]",
            "[pretrain]\nbackbone = \"gpt2\"\npreset = \"tiny\"",
        );
    fs::write(path("alone.toml"), recipe).unwrap();
    done(&["train", "pretrain", &path("alone.toml")]);
    done(&["train", "instruct", &path("alone.toml")]);
    let alone = path("alone/model");
    let rows =
        crate::command::json_lines(&["describe", "builtin:clap", "--model", &alone, "--json"]);
    assert_eq!(rows[0]["model"].as_str(), Some(alone.as_str()));
    assert!(rows[0]["confidence"].as_f64().unwrap() > 0.0);
    let (data, report) = (path("data"), path("report-alone"));
    let evaluated = [
        "eval", "--model", &alone, "--data", &data, "--out", &report, "--beam", "2",
    ];
    done(&evaluated);
    let int8 = [
        "describe",
        "builtin:clap",
        "--model",
        &alone,
        "--decoder",
        "int8",
    ];
    let problem = crate::command::refused(&int8);
    assert!(problem.contains("T5 only"), "{problem}");
    // Only a T5 is written as bytes, and only a model.
    let refused_packing = |model: &str, expected: &str| {
        let problem =
            crate::command::refused(&["lm", "pack", "--model", model, "--out", &path("packed")]);
        assert!(problem.contains(expected), "{problem}");
        assert!(!fs::exists(path("packed")).unwrap());
    };
    refused_packing(&alone, "its backbone is not t5");
    refused_packing(&path("alone/model/lm"), "`tokenizer` and `lm`");
    // Other programs read the same folder.
    fs::write(path("ids.json"), "{\"input_ids\": [[5, 6, 7]]}").unwrap();
    let (lm, ids, out) = (path("alone/model/lm"), path("ids.json"), path("l.npy"));
    let arguments = [
        "lm",
        "logits",
        "--json",
        "--weights",
        &lm,
        "--ids",
        &ids,
        "--out",
        &out,
    ];
    assert_eq!(json(&arguments)["architecture"], "gpt2");

    // Trained anew, a tokenizer has other codes: what learned from the earlier ones is not resumed.
    let recipe = fs::read_to_string(path("alone.toml")).unwrap();
    let reseeded = recipe.replace("[tokenizer.loop]", "[tokenizer.loop]\nseed = 7");
    fs::write(path("alone.toml"), reseeded).unwrap();
    let recipe = path("alone.toml");
    done(&["train", "tokenizer", &recipe, "--force"]);
    for stage in ["pretrain", "instruct"] {
        let problem = crate::command::refused(&["train", stage, &recipe, "--resume"]);
        let checkpoint = format!("alone/{stage}/step-");
        for part in [&checkpoint, "`tokenizer` had the hash", "hint: remove"] {
            assert!(problem.contains(part), "{part}: {problem}");
        }
    }

    // A damaged weight file is refused by name.
    let weights = folder.path().join("trained/model/lm/model.safetensors");
    let bytes = fs::read(&weights).unwrap();
    fs::write(&weights, &bytes[..bytes.len() / 2]).unwrap();
    let stderr = crate::command::refused(&["describe", "builtin:clap", "--model", &model]);
    assert!(stderr.contains("model.safetensors"), "{stderr}");
}

/// Instructions, generation and round trips with a model that learned all tasks, if briefly.
#[cfg(feature = "train")]
/// A second codebook, fitted to the training clips: what the model says depends on codes alone.
fn reads_two_codes_a_step(model: &str, path: &dyn Fn(&str) -> String) {
    let (data, two) = (path("data"), path("two"));
    let tokens = |model: &str, n_codes: &str, out: &str| {
        let verb = [
            "lm",
            "tokens",
            "--model",
            model,
            "--residual-codes",
            n_codes,
        ];
        [&verb[..], &["--data", &data, "--out", out]]
            .concat()
            .into_iter()
            .map(String::from)
            .collect::<Vec<_>>()
    };
    let run =
        |arguments: &[String]| radarllm(&arguments.iter().map(String::as_str).collect::<Vec<_>>());
    let refused = |arguments: &[String]| {
        crate::command::refused(&arguments.iter().map(String::as_str).collect::<Vec<_>>())
    };
    let output = run(&tokens(model, "4", &two));
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let config = fs::read(format!("{two}/tokenizer/config.json")).unwrap();
    let config: serde_json::Value = serde_json::from_slice(&config).unwrap();
    assert_eq!(config["model"]["residual_codes"], 4);
    // Everything that the model reads is its tokens: cutting the rest changes no score.
    let report = path("report-two");
    let evaluated = ["eval", "--model", &two, "--data", &data, "--out", &report];
    assert!(radarllm(&evaluated).status.success());
    let report = fs::read(path("report-two/report.json")).unwrap();
    let report: serde_json::Value = serde_json::from_slice(&report).unwrap();
    let scores = |name: &str| {
        let systems = report["systems"].as_array().unwrap();
        systems.iter().find(|s| s["name"] == name).unwrap()["scores"].clone()
    };
    assert_eq!(scores("model"), scores("tokens_only"));
    assert!(
        scores("model")["bleu_1"].as_f64().unwrap() > 0.0,
        "{report}"
    );
    // Neither a second codebook of a second one, nor one of more codes than steps.
    let problem = refused(&tokens(&two, "4", &path("three")));
    assert!(
        problem.contains("has a second codebook already"),
        "{problem}"
    );
    let problem = refused(&tokens(model, "60000", &path("three")));
    assert!(
        problem.contains("60000 codes need as many steps"),
        "{problem}"
    );
    assert!(!fs::exists(path("three")).unwrap());
    // A second codebook that is missing, and one of another size.
    let checksums = format!("{two}/tokenizer/checksums.json");
    let listed = fs::read_to_string(&checksums).unwrap();
    let mut without: serde_json::Value = serde_json::from_str(&listed).unwrap();
    forget(&mut without, "residual.safetensors");
    fs::write(&checksums, without.to_string()).unwrap();
    let problem = crate::command::refused(&["describe", "builtin:clap", "--model", &two]);
    assert!(problem.contains("residual.safetensors"), "{problem}");
}

/// A new model that cannot be completed leaves neither a part of it under its name nor a temporary folder.
#[cfg(feature = "train")]
fn makes_whole_models_only(model: &str, path: &dyn Fn(&str) -> String) {
    let copy = |from: String, to: &str| {
        fs::create_dir_all(to).unwrap();
        for entry in fs::read_dir(from).unwrap() {
            let from = entry.unwrap().path();
            fs::copy(
                &from,
                format!("{to}/{}", from.file_name().unwrap().display()),
            )
            .unwrap();
        }
    };
    let (broken, out) = (path("broken"), path("whole"));
    let [member, evidence] = ["member-2", "evidence"].map(|name| format!("{broken}/{name}"));
    for part in ["lm", "tokenizer"] {
        copy(format!("{model}/{part}"), &format!("{broken}/{part}"));
        // A checkpoint, but of no radar tokenizer.
        copy(format!("{model}/lm"), &format!("{member}/{part}"));
    }
    // Not a checkpoint.
    fs::create_dir(&evidence).unwrap();
    let left = || {
        let names = fs::read_dir(path("")).unwrap().map(|entry| {
            let name = entry.unwrap().file_name();
            name.into_string().unwrap()
        });
        let mut left: Vec<String> = names.filter(|name| name.contains("whole")).collect();
        left.sort();
        left
    };
    let arguments = |verb: &'static str| ["lm", verb, "--model", &broken, "--out", &out];
    // Both verbs write the first two parts before they find what is wrong.
    for (verb, problem) in [
        ("tokens", "broken/member-2/tokenizer"),
        ("pack", "broken/evidence: not a checkpoint"),
    ] {
        let refused = crate::command::refused(&arguments(verb));
        assert!(refused.contains(problem), "{refused}");
        assert_eq!(left(), [""; 0], "{verb}");
    }
    fs::remove_dir_all(member).unwrap();
    fs::remove_dir(evidence).unwrap();
    for verb in ["tokens", "pack"] {
        let output = radarllm(&arguments(verb));
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{verb}: {stderr}");
        assert_eq!(left(), ["whole"], "{verb}");
        for part in ["lm", "tokenizer"] {
            assert!(fs::exists(format!("{out}/{part}/checksums.json")).unwrap());
        }
        fs::remove_dir_all(&out).unwrap();
    }
}

/// Removes a key wherever it is.
#[cfg(feature = "train")]
fn forget(value: &mut serde_json::Value, key: &str) {
    if let Some(object) = value.as_object_mut() {
        object.remove(key);
        object.values_mut().for_each(|value| forget(value, key));
    }
}

#[cfg(feature = "train")]
fn uses_what_was_tuned(model: &str, path: &dyn Fn(&str) -> String) {
    let card: serde_json::Value =
        serde_json::from_slice(&fs::read(format!("{model}/lm/config.json")).unwrap()).unwrap();
    assert_eq!(card["learned"]["pretrained"].as_array().unwrap().len(), 3);
    assert_eq!(card["learned"]["tuned"].as_array().unwrap().len(), 6);

    let ask = |text: &str| {
        crate::command::json_lines(&[
            "describe",
            "builtin:walk",
            "--model",
            model,
            "--instruct",
            text,
            "--json",
        ])
    };
    let rows = ask("Which way is she heading?");
    assert_eq!(rows[0]["task"], "question");
    let rows = ask("Tell us what you saw.");
    assert_eq!(rows[0]["task"], "radar_to_text");
    assert!(rows[0]["likeness"].as_f64().unwrap() < 1.0);
    assert!(rows[0]["answers"][0]["text"].is_string(), "{rows}");
    let rows = ask("how many seconds does it last?");
    assert_eq!(rows[0]["task"], "radar_to_length");
    let rows = ask("continue the motion");
    assert_eq!(rows[0]["task"], "continuation");
    let codes = rows[0]["answers"][0]["codes"].as_array();
    assert!(codes.is_none_or(|codes| codes.iter().all(|c| c.as_u64().unwrap() < 8)));
    let strange = [
        "describe",
        "builtin:walk",
        "--model",
        model,
        "--instruct",
        "green ideas",
    ];
    let problem = crate::command::refused(&strange);
    assert!(problem.contains("like none"), "{problem}");

    let (points, page) = (path("generated.parquet"), path("generated.html"));
    let text = "a person walks forward and waves";
    let arguments = [
        "generate", text, "--model", model, "--out", &points, "--view", &page, "--json",
    ];
    let generated = json(&arguments);
    let tokens = generated["tokens"].as_array().unwrap().len();
    assert!((1..=24).contains(&tokens), "{generated}");
    assert_eq!(generated["frames"].as_u64().unwrap() as usize, 4 * tokens);
    assert!(crate::command::refused(&arguments).contains("exists already"));
    assert!(fs::read_to_string(&page).unwrap().contains(text));
    // The file says where its points come from, and is described as any other.
    let rows = crate::command::json_lines(&["describe", &points, "--model", model, "--json"]);
    assert_eq!(rows[0]["provenance"], "simulated");
    assert_eq!(rows[0]["caption"], generated["described"]["caption"]);
    let nothing = [
        "generate",
        "?!",
        "--model",
        model,
        "--out",
        &path("no.parquet"),
    ];
    assert!(crate::command::refused(&nothing).contains("no words"));

    let (data, out) = (path("data"), path("round-trip"));
    let trips = [
        "eval",
        "--model",
        model,
        "--data",
        &data,
        "--out",
        &out,
        "--round-trip",
        "3",
        "--json",
    ];
    let report = json(&trips);
    assert_eq!(report["sentences"], 3);
    let names: Vec<&str> = report["systems"]
        .as_array()
        .unwrap()
        .iter()
        .map(|s| s["name"].as_str().unwrap())
        .collect();
    assert_eq!(names, ["generated", "shuffled", "nearest", "data"]);
    let lines = fs::read_to_string(format!("{out}/round-trip.jsonl")).unwrap();
    assert_eq!(lines.lines().count(), 3);
    assert!(
        fs::read_to_string(format!("{out}/round-trip.md"))
            .unwrap()
            .contains("same actions")
    );

    // Without the decoder, or with that of other codes, nothing is generated.
    let (decoder, aside) = (format!("{model}/points"), path("aside"));
    fs::rename(&decoder, &aside).unwrap();
    let again = [
        "generate",
        text,
        "--model",
        model,
        "--out",
        &path("no.parquet"),
    ];
    let problem = crate::command::refused(&again);
    assert!(
        problem.contains("no decoder") && problem.contains("train points"),
        "{problem}"
    );
    fs::rename(&aside, &decoder).unwrap();
}

/// The default model learned radar to text alone, and says so instead of generating nonsense.
#[test]
fn the_default_model_refuses_what_it_did_not_learn() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("walk.parquet");
    let generate = ["generate", "a person walks", "--out", out.to_str().unwrap()];
    let problem = crate::command::refused(&[&generate[..], &["--model", "features"]].concat());
    for part in ["did not learn text_to_radar", "hint:", "[points]"] {
        assert!(problem.contains(part), "{problem}");
    }
    assert!(!out.exists());
    let ask = [
        "describe",
        "builtin:walk",
        "--instruct",
        "Tell us what you saw.",
    ];
    let problem = crate::command::refused(&[&ask[..], &["--model", "features"]].concat());
    for part in [
        "did not learn radar_to_text in other words",
        "it was not tuned on instructions of this task",
        "`radarllm train instruct RECIPE`",
    ] {
        assert!(problem.contains(part), "{problem}");
    }
}

/// The bundled model `tokens` is the one for instructions and generation, without being named.
#[test]
fn the_bundled_model_of_tokens_answers_and_generates() {
    let answer = |text: &str| {
        let rows = crate::command::json_lines(&[
            "describe",
            "builtin:walk?direction=backward",
            "--instruct",
            text,
            "--json",
        ]);
        assert_eq!(rows[0]["model"], "tokens (embedded)");
        rows[0]["answers"][0]["text"].as_str().unwrap().to_string()
    };
    assert_eq!(answer("Which way is she heading?"), "backward");
    assert_eq!(answer("Did she walk?"), "yes");
    assert_eq!(answer("Did somebody sit down there?"), "no");
    // A request for a description is answered by the sentence of both members.
    let walk = "builtin:walk?direction=backward";
    let described = crate::command::json_lines(&["describe", walk, "--model", "tokens", "--json"]);
    assert_eq!(answer("Tell us what you saw."), described[0]["caption"]);
    let problem =
        crate::command::refused(&["describe", "builtin:walk", "--instruct", "Who is it?"]);
    assert!(problem.contains("not who it is"), "{problem}");

    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("walk.parquet");
    let generated = crate::command::json(&[
        "generate",
        "a person walks forward",
        "--out",
        out.to_str().unwrap(),
        "--json",
    ]);
    assert_eq!(generated["model"], "tokens (embedded)");
    assert!(generated["points"].as_u64().unwrap() > 500, "{generated}");
    assert!(out.is_file());
}

/// Ctrl-C in a training that runs: it ends by itself with exit code 130, and resumed it ends where it would have ended.
#[cfg(all(feature = "train", target_os = "linux"))]
#[test]
fn an_interrupted_training_resumes_to_the_same_weights() {
    use std::{
        process::{Command, Stdio},
        time::{Duration, Instant},
    };

    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    fs::write(
        path("data.toml"),
        "seed = 2\nmax_frames = 12\nfacet_edge_m = 0.05\n[[source]]\nkind = \"procedural\"\ntrain = 4\nval = 1\ntest = 1\n",
    )
    .unwrap();
    let recipe = |out: &str| {
        format!(
            "data = \"data\"\nout = \"{out}\"\n[motion]\nbatch_size = 4\n\
             codebook = {{ init_after = 1, init_inputs_per_code = 1 }}\nmodel = {{ width = 16, codebook_size = 8 }}\n\
             [motion.loop]\nepochs = 0\nmax_steps = 200\nlog_every = 1\nvalidate_every = 50\n"
        )
    };
    for out in ["whole", "stopped"] {
        fs::write(path(&format!("{out}.toml")), recipe(out)).unwrap();
    }
    let done = |args: &[&str]| {
        let output = radarllm(args);
        let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{args:?}: {stderr}");
        stderr
    };
    done(&[
        "dataset",
        "build",
        &path("data.toml"),
        "--out",
        &path("data"),
    ]);
    let stderr = done(&["train", "motion", &path("whole.toml")]);
    assert!(stderr.contains("motion step 200/200 epoch"), "{stderr}");

    let child = Command::new(env!("CARGO_BIN_EXE_radarllm"))
        .args(["train", "motion", &path("stopped.toml")])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let log = folder.path().join("stopped/motion/log.jsonl");
    let started = Instant::now();
    while fs::read_to_string(&log).map_or(0, |text| text.lines().count()) < 3 {
        assert!(started.elapsed() < Duration::from_secs(300), "no progress");
        std::thread::sleep(Duration::from_millis(1));
    }
    // SAFETY: `kill` has no memory to get wrong; the child is ours and was not waited for yet.
    assert_eq!(unsafe { libc::kill(child.id() as i32, libc::SIGINT) }, 0);
    let ended = child.wait_with_output().unwrap();
    let stderr = String::from_utf8_lossy(&ended.stderr);
    assert_eq!(ended.status.code(), Some(130), "{stderr}");
    let stdout = String::from_utf8_lossy(&ended.stdout);
    assert_eq!(
        stdout.trim(),
        "stage motion stopped early; --resume continues it"
    );
    assert!(stderr.contains("Ctrl-C again ends at once"), "{stderr}");
    assert!(!folder.path().join("stopped/motion/final").exists());
    let stderr = done(&["train", "motion", &path("stopped.toml"), "--resume"]);
    assert!(stderr.contains("motion resumes at step"), "{stderr}");
    for file in ["best/model.safetensors", "final/model.safetensors"] {
        let weights = |out: &str| fs::read(path(&format!("{out}/motion/{file}"))).unwrap();
        assert!(weights("whole") == weights("stopped"), "{file}");
    }
}

/// A recording that the same radar and scene made, with another seed: the table finds them alike.
#[test]
fn realism_compares_own_recordings_with_their_scenes() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    std::fs::create_dir(path("own")).unwrap();
    std::fs::write(
        path("own/walk.toml"),
        "duration_s = 1.5\nmax_bounces = 1\n[[target]]\nkind = \"motion\"\nfile = \"builtin:walk?distance_m=1.5\"\n\
         position_m = [0.2, 3.0, -1.0]\n",
    )
    .unwrap();
    let (scene, recording) = (path("own/walk.toml"), path("own/walk.parquet"));
    let done = radarllm(&["simulate", &scene, "--out", &recording, "--seed", "9"]);
    assert!(done.status.success());
    std::fs::write(
        path("config.toml"),
        "radar = \"awr1843boost\"\ncrop_m = [[-3.0, 3.0], [0.0, 8.0], [-3.0, 3.0]]\n",
    )
    .unwrap();
    let config = path("config.toml");
    let report = json(&["realism", &config, "--recordings", &path("own"), "--json"]);
    assert_eq!(report["frames"], 15);
    let rows = report["distributions"].as_array().unwrap();
    let speed = rows.iter().find(|r| r["quantity"] == "speed").unwrap();
    // About 1,500 points each, in clusters of ten: 0.11 is the 95 % point of equal distributions.
    assert!(
        speed["kolmogorov_smirnov"].as_f64().unwrap() < 0.11,
        "{speed}"
    );
    assert!(report["chamfer_other_m"].is_null());

    let refused = radarllm(&["realism", &config, "--recordings", &path("nowhere")]);
    assert_eq!(refused.status.code(), Some(1));
    let stderr = String::from_utf8_lossy(&refused.stderr);
    assert!(stderr.contains("nowhere"), "{stderr}");
}

#[test]
fn captions_follow_interventions_whatever_the_verb_is_called() {
    let report = json(&["interventions", "--count", "3", "--json"]);
    let rows = report["rows"].as_array().unwrap();
    let kinds: Vec<_> = rows.iter().map(|r| r["kind"].as_str().unwrap()).collect();
    assert_eq!(kinds, ["side", "direction", "action"]);
    assert_eq!(report["followed"]["all"][1], 3);
    // The earlier name, and another number of threads.
    let earlier = json(&["edits", "--count", "3", "--threads", "1", "--json"]);
    assert_eq!(earlier, report);
}

#[test]
fn people_tracking_firmware_reports_some_points_of_who_moves_and_fewer_of_who_sits() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (chirps, _) = DEMO_CFG.split_once("cfarCfg").unwrap();
    let cfg = format!(
        "{chirps}dynamicRACfarCfg -1 4 4 2 2 8 12 4 8 5.0 8.0 0.4 1 1\ndynamicRangeAngleCfg -1 0.75 0.001 1 0\n\
         dynamic2DAngleCfg -1 1.5 0.03 1 0 1 0.3 0.85 8.0\nfovCfg -1 70 20\n"
    );
    fs::write(path("people.cfg"), cfg).unwrap();
    let points_a_frame = |motion: &str| {
        let (cfg, out) = (path("people.cfg"), path("points.parquet"));
        let args = [
            "simulate",
            motion,
            "--radar",
            &cfg,
            "--firmware",
            "people-tracking",
        ];
        json(&[&args[..], &["--out", &out, "--force", "--json"]].concat());
        let frames = radarllm_dataset::read_points(std::path::Path::new(&out))
            .unwrap()
            .frames;
        let n: usize = frames.iter().map(|f| f.points.len()).sum();
        n as f64 / frames.len() as f64
    };
    let walks = points_a_frame("builtin:walk?distance_m=1.2");
    let sits = points_a_frame("builtin:sit_still");
    assert!(
        (1.0..30.0).contains(&walks) && sits < 0.5 * walks,
        "{walks} {sits}"
    );
}

/// A chirp of ±1 m/s with both passes of CFAR, as TI's visualizer writes it.
const DEMO_CFG: &str = "% Platform:xWR68xx\nchannelCfg 15 7 0\nadcCfg 2 1\n\
    profileCfg 0 60.25 355 6 58 0 0 60 1 224 4500 0 0 30\nchirpCfg 0 0 0 0 0 0 0 1\n\
    chirpCfg 1 1 0 0 0 0 0 4\nchirpCfg 2 2 0 0 0 0 0 2\nframeCfg 0 2 16 0 100 1 0\n\
    cfarCfg -1 0 2 8 4 3 0 15 0\ncfarCfg -1 1 0 4 2 3 1 15 0\ncfarFovCfg -1 1 -0.8 0.8\n";

#[test]
fn out_of_box_firmware_reports_the_room_unless_it_removes_clutter() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let simulate = |name: &str, cfg: &str| {
        fs::write(path("demo.cfg"), cfg).unwrap();
        let out = path(name);
        let (cfg, walk) = (path("demo.cfg"), "builtin:walk?distance_m=1.2");
        let args = [
            "simulate",
            walk,
            "--radar",
            &cfg,
            "--firmware",
            "out-of-box",
        ];
        json(&[&args[..], &["--out", &out, "--json"]].concat());
        radarllm_dataset::read_points(std::path::Path::new(&out))
            .unwrap()
            .frames
    };
    let room = simulate("room.parquet", DEMO_CFG);
    let quiet = simulate("quiet.parquet", &format!("{DEMO_CFG}clutterRemoval -1 1\n"));
    let count = |frames: &[radarllm_base::PointFrame], of: fn(f32) -> bool| {
        let points = frames.iter().flat_map(|f| &f.points);
        points.filter(|p| of(p.velocity_mps.abs())).count()
    };
    let all = |_| true;
    let is_static = |speed| speed < 0.05;
    // Without clutter, only what folds to zero is left: limbs at twice the largest speed.
    let (in_room, without) = (count(&room, is_static), count(&quiet, is_static));
    assert!(
        in_room > 5 * room.len() && without < 3 * quiet.len(),
        "{in_room} {without}"
    );
    for frames in [&room, &quiet] {
        // Someone walks at more than 1 m/s, which folds; the field of view ends at 0.8 m/s.
        assert!(count(frames, |speed| (0.2..=0.8).contains(&speed)) > frames.len());
        assert_eq!(count(frames, |speed| speed <= 0.8), count(frames, all));
    }

    let out = path("refused.parquet");
    let builtin = ["simulate", "builtin:walk", "--radar", "awr1843boost"];
    let refused =
        |more: &[&str]| crate::command::refused(&[&builtin[..], more, &["--out", &out]].concat());
    for firmware in ["out-of-box", "people-tracking"] {
        let message = refused(&["--firmware", firmware]);
        assert!(message.contains(".cfg"), "{message}");
    }
    let message = refused(&["--firmware", "out-of-box", "--emit", "adc"]);
    assert!(message.contains("points, not samples"), "{message}");
}
