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

/// METEOR as pycocoevalcap runs it, with all the data of its jar, which are LGPL and not part of this
/// repository: RADARLLM_METEOR_DATA names a folder made as docs/metrics.md says.
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
