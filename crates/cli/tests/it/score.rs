//! `score`: bad input is named, counted and refused; the JSON's fields; METEOR with its own data.

use std::{fs, path::PathBuf};

use crate::command::{json, refused};

const GOOD_C: &str =
    "{\"id\": \"a\", \"text\": \"a person walks\"}\n{\"id\": 2, \"text\": \"a person sits\"}\n";
const GOOD_R: &str = "{\"id\": \"a\", \"texts\": [\"someone walks\"]}\n\n{\"id\": \"2\", \"texts\": [\"someone sits\", \"a\"]}\n";

struct Files {
    folder: tempfile::TempDir,
}

impl Files {
    fn new(candidates: impl AsRef<[u8]>, references: impl AsRef<[u8]>) -> Self {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("c.jsonl"), candidates).unwrap();
        fs::write(folder.path().join("r.jsonl"), references).unwrap();
        Self { folder }
    }

    fn args(&self, more: &[&str]) -> Vec<String> {
        let path = |name: &str| self.folder.path().join(name).display().to_string();
        let start = [
            "score",
            "--candidates",
            &path("c.jsonl"),
            "--references",
            &path("r.jsonl"),
        ];
        start.iter().chain(more).map(|s| (*s).to_string()).collect()
    }

    fn scores(&self, more: &[&str]) -> serde_json::Value {
        let args = self.args(more);
        json(&args.iter().map(String::as_str).collect::<Vec<_>>())
    }

    fn refused(&self, more: &[&str]) -> String {
        let args = self.args(more);
        refused(&args.iter().map(String::as_str).collect::<Vec<_>>())
    }
}

#[test]
fn bad_input_is_named_and_counted() {
    let c = |lines: &str| Files::new(lines, GOOD_R).refused(&[]);
    let r = |lines: &str| Files::new(GOOD_C, lines).refused(&[]);
    for (stderr, parts) in [
        (
            c("{\"id\": \"a\", \"text\": 5}\n"),
            vec!["c.jsonl:1", "expected a string"],
        ),
        (
            c("{\"id\": null, \"text\": \"x\"}\n"),
            vec!["c.jsonl:1", "text or a whole number"],
        ),
        (
            c("{\"id\": \"a\"}\nnonsense\n[]\n"),
            vec!["c.jsonl:1", "missing field `text`", "3 lines are wrong"],
        ),
        (
            c("{\"id\": \"a\", \"text\": \"x\"}\n"),
            vec!["1 ids are missing from the candidates", "\"2\""],
        ),
        (
            c(&GOOD_C.replace("\"a\"", "\"2\"")),
            vec!["candidates", "1 ids occur more than once", "`2`"],
        ),
        (
            r(&GOOD_R.replace("\"2\"", "\"b\"")),
            vec!["missing from the references", "\"2\""],
        ),
        (
            r(&GOOD_R.replace("[\"someone walks\"]", "[]")),
            vec!["1 items have no text", "`a`"],
        ),
        (
            r(&GOOD_R.replace("[\"someone walks\"]", "\"someone walks\"")),
            vec!["r.jsonl:1", "expected a sequence"],
        ),
        (
            r(&GOOD_R.replace("\"someone walks\"", "null")),
            vec!["r.jsonl:1", "expected a string"],
        ),
        (
            Files::new(b"{\"id\": \"a\", \"text\": \"\xff\"}\n", GOOD_R).refused(&[]),
            vec!["c.jsonl:1", "not UTF-8"],
        ),
        (
            Files::new("", "").refused(&[]),
            vec!["no candidates and no references"],
        ),
        (
            c(&GOOD_C.replace("walks", &"x ".repeat(2000))),
            vec!["`a`", "2002 words", "at most 1000"],
        ),
    ] {
        for part in parts {
            assert!(stderr.contains(part), "{part:?} is not in {stderr}");
        }
    }
    let good = Files::new(GOOD_C, GOOD_R);
    assert!(
        good.refused(&["--protocol", "bleu"])
            .contains("hint: plain")
    );
    assert!(
        good.refused(&["--protocol", "motiongpt", "--max-references", "2"])
            .contains("3 references")
    );
    let empty = good.folder.path().display().to_string();
    assert!(
        good.refused(&["--meteor-data", &empty])
            .contains("none of METEOR's files")
    );
    let data = good.folder.path().join("data");
    fs::create_dir(&data).unwrap();
    fs::write(data.join("paraphrase-en.gz"), b"no gzip").unwrap();
    assert!(
        good.refused(&["--meteor-data", &empty])
            .contains("paraphrase-en.gz")
    );
}

#[test]
fn every_protocol_gives_every_value() {
    let files = Files::new(GOOD_C, GOOD_R);
    let fields =
        "bleu_1 bleu_2 bleu_3 bleu_4 rouge_1 rouge_l rouge_l_coco meteor cider_d cider self_bleu";
    for protocol in ["plain", "nlg-eval", "coco", "motiongpt"] {
        let scores = files.scores(&["--protocol", protocol]);
        for field in fields.split(' ') {
            assert!(scores[field].is_number(), "{protocol} {field}: {scores}");
        }
        assert_eq!(scores["protocol"], protocol);
        assert_eq!(
            scores["meteor_matchers"],
            serde_json::json!(["exact", "stem", "synonym"])
        );
        for field in ["bert_score", "sim_cse"] {
            assert!(scores[field].is_null() && scores["reason"][field].is_string());
        }
    }
    let empty = Files::new(
        GOOD_C.replace("a person walks", "..."),
        GOOD_R.replace("\"a\"]", "\" \"]"),
    );
    let scores = empty.scores(&[]);
    assert_eq!(scores["empty_candidate_ids"], serde_json::json!(["a"]));
    assert_eq!(scores["empty_references"], 1);
}

#[test]
fn facts_are_compared_and_contradictions_counted() {
    let files = Files::new(
        concat!(
            "{\"id\":1,\"text\":\"a person waves three times with the left hand\"}\n",
            "{\"id\":2,\"text\":\"a person walks forward, then sits down\"}\n"
        ),
        concat!(
            "{\"id\":1,\"texts\":[\"somebody sits\",\"a man waves with his right hand\"]}\n",
            "{\"id\":2,\"texts\":[\"a person walks backward\"]}\n"
        ),
    );
    let facts = &files.scores(&[])["facts"];
    let row = |kind: &str| {
        let row = &facts["by_kind"][kind];
        ["common", "candidate", "reference"].map(|field| row[field].as_u64().unwrap())
    };
    assert_eq!(row("action"), [2, 3, 2]);
    assert_eq!(row("side"), [0, 1, 1]);
    assert_eq!(row("count"), [0, 1, 0]);
    assert_eq!(row("subject"), [1, 2, 2]);
    assert_eq!(facts["by_kind"]["action"]["precision"], 2.0 / 3.0);
    assert!(facts["by_kind"]["count"]["recall"].is_null());
    assert_eq!(
        facts["contradictions"],
        serde_json::json!({"direction": 1, "side": 1})
    );
}

/// METEOR as pycocoevalcap runs it, with all the data of its jar, which are LGPL and not part of this
/// repository: RADARLLM_METEOR_DATA names a folder made as docs/reference/metrics.md says.
#[test]
fn meteor_with_its_own_data_is_that_of_the_jar() {
    let Some(folder) = std::env::var_os("RADARLLM_METEOR_DATA") else {
        println!("skipped: RADARLLM_METEOR_DATA is not set");
        return;
    };
    let path =
        PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../metrics/tests/goldens/captions.json");
    let goldens: serde_json::Value = serde_json::from_slice(&fs::read(path).unwrap()).unwrap();
    let items = goldens["items"].as_array().unwrap();
    let lines = |key: &str, name: &str| -> String {
        let line = |(i, item): (usize, &serde_json::Value)| {
            serde_json::json!({"id": i, name: item[key]}).to_string() + "\n"
        };
        items.iter().enumerate().map(line).collect()
    };
    let files = Files::new(lines("candidate", "text"), lines("references", "texts"));
    let folder = folder.to_string_lossy().into_owned();
    let scores = files.scores(&[
        "--protocol",
        "nlg-eval",
        "--max-references",
        "0",
        "--meteor-data",
        &folder,
    ]);
    let (found, expected) = (
        scores["meteor"].as_f64().unwrap(),
        goldens["meteor"]["jar"]["corpus"].as_f64().unwrap(),
    );
    println!(
        "{found} and {expected}, difference {:.1e}",
        (found - expected).abs()
    );
    assert!((found - expected).abs() < 1e-9);
    assert_eq!(scores["meteor_matchers"].as_array().unwrap().len(), 4);
}

/// The tiny BERT of the goldens with a tokenizer of words w3 to w39: sentences equal to a reference score 1,
/// others less, and what made the figures is said.
#[cfg(feature = "train")]
#[test]
fn a_named_checkpoint_gives_bert_score_and_similarity() {
    let dir = tempfile::tempdir().unwrap();
    let weights = dir.path().join("bert");
    fs::create_dir(&weights).unwrap();
    crate::lm::folder("bert.safetensors", &weights);
    let words: Vec<String> = (3..40).map(|i| format!("\"w{i}\":{i}")).collect();
    let tokenizer = format!(
        r#"{{"version":"1.0","truncation":null,"padding":null,"added_tokens":[],"normalizer":null,
        "pre_tokenizer":{{"type":"Whitespace"}},"post_processor":{{"type":"BertProcessing","sep":["[SEP]",2],
        "cls":["[CLS]",1]}},"decoder":null,"model":{{"type":"WordLevel","unk_token":"[UNK]",
        "vocab":{{"[UNK]":0,"[CLS]":1,"[SEP]":2,{}}}}}}}"#,
        words.join(",")
    );
    fs::write(weights.join("tokenizer.json"), tokenizer).unwrap();
    let (c, r) = (dir.path().join("c.jsonl"), dir.path().join("r.jsonl"));
    let score = |said: &str, extra: &[&str]| {
        fs::write(&c, format!("{{\"id\":\"a\",\"text\":\"{said}\"}}\n")).unwrap();
        fs::write(&r, "{\"id\":\"a\",\"texts\":[\"w9 w8\",\"w3 w4 w5\"]}\n").unwrap();
        let (c, r, w) = (
            c.to_str().unwrap(),
            r.to_str().unwrap(),
            weights.to_str().unwrap(),
        );
        let mut args = vec![
            "score",
            "--candidates",
            c,
            "--references",
            r,
            "--bert-score",
            w,
        ];
        args.extend(["--layer", "2", "--sim-cse", w, "--pooling", "pooler"]);
        args.extend(extra);
        json(&args)
    };
    for extra in [&[][..], &["--protocol", "motiongpt"]] {
        let same = score("w3 w4 w5", extra);
        for field in ["bert_score", "sim_cse"] {
            assert!(
                (same[field].as_f64().unwrap() - 1.0).abs() < 1e-5,
                "{field} {extra:?}"
            );
            assert!(same["reason"].get(field).is_none());
            assert!(same["ci95"][field].is_array());
        }
        let other = score("w30 w31 w32 w33", extra);
        assert!(other["bert_score"].as_f64().unwrap() < 0.999);
        assert!(other["sim_cse"].as_f64().unwrap() < 0.9999);
    }
    let plain = score("w30 w31", &[]);
    let rescaled = score("w30 w31", &["--bert-baseline", "0.5"]);
    let expected = (plain["bert_score"].as_f64().unwrap() - 0.5) / 0.5;
    assert!((rescaled["bert_score"].as_f64().unwrap() - expected).abs() < 1e-12);
    assert!(
        rescaled["bert_score_rules"]
            .as_str()
            .unwrap()
            .contains("layer 2")
    );
}

/// An npy file of f32.
fn npy(shape: &str, values: &[f32]) -> Vec<u8> {
    let mut header =
        format!("{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}").into_bytes();
    // Header, magic and lengths fill whole blocks of 64 bytes, the last of which is a line end.
    while (header.len() + 11) % 64 != 0 {
        header.push(b' ');
    }
    header.push(b'\n');
    let mut out = b"\x93NUMPY\x01\x00".to_vec();
    out.extend((header.len() as u16).to_le_bytes());
    out.extend(header);
    out.extend(values.iter().flat_map(|v| v.to_le_bytes()));
    out
}

#[test]
fn poses_are_compared_in_the_layout_that_motion_mesh_writes() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let pose = |candidate: &str, reference: &str| {
        let (candidate, reference) = (path(candidate), path(reference));
        [
            "score",
            "--pose",
            "--candidates",
            &candidate,
            "--references",
            &reference,
        ]
        .map(String::from)
    };
    let scores = |c: &str, r: &str| json(&pose(c, r).each_ref().map(String::as_str));
    let refusal = |c: &str, r: &str| refused(&pose(c, r).each_ref().map(String::as_str));
    json(&[
        "motion",
        "mesh",
        "builtin:wave",
        "--out",
        &path("wave.npz"),
        "--json",
    ]);
    let same = scores("wave.npz", "wave.npz");
    for metric in ["mpjre_deg", "mpjpe_cm", "mpvpe_cm", "mte_cm"] {
        assert_eq!(same[metric], 0.0, "{metric}");
    }
    // Six joints in two frames, moved by 3 and 4 cm; the root of the second frame by 12 cm more, upright.
    let reference: Vec<f32> = (0..36).map(|i| 0.1 * i as f32).collect();
    let mut moved: Vec<f32> = reference
        .iter()
        .enumerate()
        .map(|(i, v)| v + [0.03, 0.04, 0.0][i % 3])
        .collect();
    moved[18 + 2] += 0.12;
    fs::write(path("r.npy"), npy("(2, 6, 3)", &reference)).unwrap();
    fs::write(path("c.npy"), npy("(2, 6, 3)", &moved)).unwrap();
    let found = scores("c.npy", "r.npy");
    let close = |metric: &str, value: f64| {
        let found = found[metric].as_f64().unwrap();
        assert!(
            (found - value).abs() < 1e-4,
            "{metric}: {found}, expected {value}"
        );
    };
    // f32 coordinates of a few metres hold 1e-5 cm. Roots: 5 and 13 cm; eleven joints of 5 and one of 13.
    close("mte_cm", 9.0);
    close("mpjpe_cm", (11.0 * 5.0 + 13.0) / 12.0);
    assert!(found["mpjre_deg"].is_null() && found["mpvpe_cm"].is_null());
    assert!(
        found["reason"]["mpvpe_cm"]
            .as_str()
            .unwrap()
            .contains("vertices")
    );
    // A quarter turn about z against none.
    let unit = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    let quarter = [0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
    fs::write(path("unit.npy"), npy("(1, 1, 3, 3)", &unit)).unwrap();
    fs::write(path("quarter.npy"), npy("(1, 1, 3, 3)", &quarter)).unwrap();
    let turned = scores("quarter.npy", "unit.npy");
    assert!((turned["mpjre_deg"].as_f64().unwrap() - 90.0).abs() < 1e-9);

    fs::write(path("short.npy"), npy("(1, 6, 3)", &reference[..18])).unwrap();
    fs::write(path("flat.npy"), npy("(12, 3)", &reference)).unwrap();
    fs::write(path("none.npy"), npy("(0, 6, 3)", &[])).unwrap();
    fs::write(
        path("stretched.npy"),
        npy("(1, 1, 3, 3)", &unit.map(|v| 2.0 * v)),
    )
    .unwrap();
    fs::write(path("nan.npy"), npy("(2, 6, 3)", &[f32::NAN; 36])).unwrap();
    fs::write(path("text.npz"), "joints").unwrap();
    for (candidate, reference, word) in [
        ("short.npy", "r.npy", "[1, 6, 3]"),
        ("flat.npy", "r.npy", "[12, 3]"),
        ("none.npy", "none.npy", "[0, 6, 3]"),
        ("stretched.npy", "unit.npy", "no rotation"),
        ("nan.npy", "r.npy", "not finite"),
        ("unit.npy", "r.npy", "nothing in common"),
        ("text.npz", "r.npy", "text.npz"),
        ("absent.npz", "r.npy", "absent.npz"),
    ] {
        let stderr = refusal(candidate, reference);
        assert!(
            stderr.contains(word),
            "{candidate}: {stderr} should name {word}"
        );
    }
}

#[test]
fn a_byte_order_mark_is_skipped_in_both_files() {
    let scores = |mark: &str| {
        let files = Files::new(format!("{mark}{GOOD_C}"), format!("{mark}{GOOD_R}"));
        files.scores(&[])
    };
    assert_eq!(scores("\u{feff}"), scores(""));
}
