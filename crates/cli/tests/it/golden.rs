//! What users get is what they got: points, sentences and scores of inputs that the test makes, beside stored ones.
//!
//! `tests/goldens/outputs.json` has two parts for every input. `everywhere` is the same on every processor: points of
//! recorded formats, sentences, tokens, confidences to three digits, scores, and how many points a simulation gives.
//! `fused` has hashes of what is computed from samples, whose last bits depend on whether the processor fuses multiply
//! and add. AVX-512 and AVX2 give the same bits; a processor without both leaves this part out and says so.
//! Hashes are BLAKE3 of the decoded content of a points file: every value of every frame, and the metadata but for
//! the version of the program. `bytes` are hashes of whole files, compared only with files of the same version.
//! Values are of release builds.
//!
//! A change that is meant is named in CHANGELOG.md, and
//!
//! ```text
//! RADARLLM_GOLDENS=write cargo test --release --locked -p radarllm-cli --features train --test it -- golden
//! ```
//!
//! stores what the program does now. On a processor that leaves `fused` out, that part stays as it was.

mod cases;
mod inputs;

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use cases::CASES;
use inputs::SMALL_CFG;
use radarllm_dataset::read_points;
use serde_json::{Map, Value, json};

/// Fields of one input.
type Fields = Map<String, Value>;

/// Whether this processor fuses multiply and add in what is computed from samples.
fn is_fused() -> bool {
    #[cfg(target_arch = "x86_64")]
    {
        is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma")
    }
    #[cfg(not(target_arch = "x86_64"))]
    {
        false
    }
}

/// What became of one input.
#[derive(Default)]
struct Outcome {
    /// The same on every processor.
    everywhere: Fields,
    /// The same on processors that fuse multiply and add.
    fused: Fields,
}

impl Outcome {
    fn everywhere(mut self, field: &str, value: Value) -> Self {
        self.everywhere.insert(field.into(), value);
        self
    }

    fn fused(mut self, field: &str, value: Value) -> Self {
        self.fused.insert(field.into(), value);
        self
    }

    /// Points that were computed from samples: counts everywhere, values where they are the same.
    fn computed(self, field: &str, mut points: Value) -> Self {
        let hash = points.as_object_mut().unwrap().remove("hash");
        self.fused(field, json!({ "hash": hash }))
            .everywhere(field, points)
    }
}

/// A scratch folder in which the program runs with relative names, so that sources read the same everywhere. It is a folder
/// within one of its own: the program also looks for a radar's .cfg in the folder above a recording.
struct Scratch(tempfile::TempDir);

impl Scratch {
    fn new() -> Self {
        let scratch = Self(tempfile::tempdir().unwrap());
        fs::create_dir(scratch.folder()).unwrap();
        scratch
    }

    fn folder(&self) -> PathBuf {
        self.0.path().join("here")
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder().join(name)
    }

    fn write(&self, name: &str, bytes: impl AsRef<[u8]>) {
        let path = self.at(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, bytes).unwrap();
    }

    /// Runs the program and parses the document that it prints.
    fn json(&self, args: &[&str]) -> Value {
        serde_json::from_str(&self.printed(args)).expect("one JSON document on stdout")
    }

    /// Runs the program and parses the lines that it prints.
    fn json_lines(&self, args: &[&str]) -> Value {
        let printed = self.printed(args);
        let lines = printed.lines().map(serde_json::from_str::<Value>);
        lines
            .collect::<Result<_, _>>()
            .expect("JSON lines on stdout")
    }

    fn printed(&self, args: &[&str]) -> String {
        let output = Command::new(env!("CARGO_BIN_EXE_radarllm"))
            .args(args)
            .arg("--json")
            .current_dir(self.folder())
            .output()
            .expect("the binary runs");
        assert!(
            output.status.success(),
            "{args:?} ended with {:?}: {}",
            output.status.code(),
            String::from_utf8_lossy(&output.stderr)
        );
        String::from_utf8(output.stdout).expect("UTF-8 on stdout")
    }

    /// Counts and hash of the content of a points file.
    fn points(&self, name: &str) -> Value {
        let file = read_points(&self.at(name)).unwrap();
        let meta = &file.meta;
        let mut hasher = blake3::Hasher::new();
        let head = format!(
            "{}\n{}\n{:?}\n{:?}\n{:?}\n",
            meta.radar, meta.source, meta.seed, meta.radar_height_m, meta.frame_rate_hz
        );
        hasher.update(head.as_bytes());
        let mut n_points = 0;
        for frame in &file.frames {
            hasher.update(&frame.frame.to_le_bytes());
            hasher.update(&frame.time_s.to_le_bytes());
            hasher.update(&(frame.points.len() as u64).to_le_bytes());
            for p in &frame.points {
                let values = [
                    p.x_m,
                    p.y_m,
                    p.z_m,
                    p.range_m,
                    p.velocity_mps,
                    p.intensity_db,
                ];
                hasher.update(values.map(f32::to_le_bytes).as_flattened());
            }
            n_points += frame.points.len();
        }
        json!({
            "source": meta.source,
            "frames": file.frames.len(),
            "points": n_points,
            "hash": hasher.finalize().to_hex()[..32].to_string(),
        })
    }

    /// Hash of the bytes of a file, with the version that wrote them.
    fn bytes(&self, name: &str) -> Value {
        let hash = blake3::hash(&fs::read(self.at(name)).unwrap());
        json!({"version": env!("CARGO_PKG_VERSION"), "hash": hash.to_hex()[..32].to_string()})
    }

    /// Names in a folder that end so, sorted.
    fn names(&self, folder: &str, end: &str) -> Vec<String> {
        let entries = fs::read_dir(self.at(folder)).unwrap();
        let mut names: Vec<String> = entries
            .map(|e| e.unwrap().file_name().into_string().unwrap())
            .filter(|name| name.ends_with(end))
            .collect();
        names.sort();
        names
    }

    fn describe(&self, args: &[&str]) -> Value {
        let rows = self.json_lines(&[&["describe"], args].concat());
        let row = |row: &Value| {
            let mut kept = chosen(
                row,
                "caption source radar synthetic model tokens frames clip_seconds person",
            );
            let confidence = row["confidence"].as_f64().unwrap();
            kept["confidence"] = json!((confidence * 1000.0).round() / 1000.0);
            rounded(&kept)
        };
        rows.as_array().unwrap().iter().map(row).collect()
    }

    /// A motion through the virtual radar, and its sentence.
    fn motion(&self, input: &str, options: &[&str]) -> Outcome {
        let args = ["simulate", input, "--out", "points.parquet"];
        self.json(&[&args, options].concat());
        let info = self.json(&["motion", "info", input]);
        Outcome::default()
            .everywhere("motion info", motion_info(&info))
            .computed("points", self.points("points.parquet"))
            .fused("bytes", self.bytes("points.parquet"))
            .everywhere("describe", self.describe(&["points.parquet"]))
    }

    /// Recorded points: no sample is computed, so the points are the same everywhere.
    fn recording(&self, input: &str, options: &[&str]) -> Outcome {
        let args = ["process", input, "--out", "points.parquet"];
        let report = self.json(&[&args, options].concat());
        Outcome::default()
            .everywhere("process", chosen(&report, "format frames frame_rate_hz"))
            .everywhere("points", self.points("points.parquet"))
            .everywhere("bytes", self.bytes("points.parquet"))
            .everywhere("describe", self.describe(&[&[input], options].concat()))
    }

    /// Raw samples of the small radar.
    fn samples(&self, input: &str, options: &[&str]) -> Outcome {
        self.write("small.cfg", SMALL_CFG);
        let args = [
            "process",
            input,
            "--radar",
            "small.cfg",
            "--out",
            "points.parquet",
        ];
        let report = self.json(&[&args, options].concat());
        let fields = "format frames frame_rate_hz trailing_bytes damaged_frames transfer";
        let mut outcome = Outcome::default()
            .everywhere("process", chosen(&report, fields))
            .everywhere("describe", self.describe(&["points.parquet"]));
        for name in self.names(".", ".parquet") {
            let points = self.points(&name);
            outcome = outcome.computed(&name, points);
        }
        outcome
    }

    /// Raw samples that the virtual radar makes of a scene.
    fn simulate_samples(&self, scene: &str, out: &str) {
        self.write("small.cfg", SMALL_CFG);
        self.write("scene.toml", scene);
        self.json(&[
            "simulate",
            "scene.toml",
            "--radar",
            "small.cfg",
            "--emit",
            "adc",
            "--out",
            out,
        ]);
    }
}

/// Fields of an object, those that it has.
fn chosen(object: &Value, fields: &str) -> Value {
    let pick = |field: &str| Some((field.to_string(), object.get(field)?.clone()));
    rounded(&Value::Object(fields.split(' ').filter_map(pick).collect()))
}

fn motion_info(info: &Value) -> Value {
    chosen(
        info,
        "format frames fps duration_s joints unit height_m captions",
    )
}

/// Numbers to six digits: a 32-bit value has seven, and the last one is the mathematical library's.
fn rounded(value: &Value) -> Value {
    match value {
        Value::Number(n) if n.is_f64() => {
            let text = format!("{:.5e}", n.as_f64().unwrap());
            json!(text.parse::<f64>().unwrap())
        }
        Value::Array(items) => items.iter().map(rounded).collect(),
        Value::Object(fields) => Value::Object(
            fields
                .iter()
                .map(|(k, v)| (k.clone(), rounded(v)))
                .collect(),
        ),
        other => other.clone(),
    }
}

/// Appends what of `expected` is not so in `found`; fields that were added since are left out.
fn compare(place: &str, expected: &Value, found: &Value, differences: &mut Vec<String>) {
    match (expected, found) {
        (Value::Object(fields), Value::Object(_)) => {
            // Bytes name the version that wrote them.
            if fields.contains_key("version") && fields["version"] != found["version"] {
                println!("skipped: {place}: bytes of another version");
                return;
            }
            for (field, value) in fields {
                compare(
                    &format!("{place}, {field}"),
                    value,
                    &found[field],
                    differences,
                );
            }
        }
        _ if expected == found => {}
        _ => differences.push(format!(
            "{place}:\n  expected {expected}\n  found    {found}"
        )),
    }
}

#[test]
fn outputs_are_those_that_were_stored() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/goldens/outputs.json");
    let is_writing = std::env::var("RADARLLM_GOLDENS").is_ok_and(|v| v == "write");
    let mut stored: BTreeMap<String, Fields> = match fs::read(&path) {
        Ok(bytes) => serde_json::from_slice(&bytes).unwrap(),
        Err(e) => {
            assert!(is_writing, "{}: {e}", path.display());
            BTreeMap::new()
        }
    };
    let is_fused = is_fused();
    if !is_fused {
        println!(
            "skipped: hashes of computed points, which are stored for processors with AVX2 and FMA"
        );
    }
    let mut differences = Vec::new();
    for (name, run) in CASES {
        let outcome = run(&Scratch::new());
        if is_writing {
            let entry = stored.entry(name.into()).or_default();
            entry.insert("everywhere".into(), Value::Object(outcome.everywhere));
            if is_fused {
                entry.insert("fused".into(), Value::Object(outcome.fused));
            }
            continue;
        }
        let Some(expected) = stored.remove(name) else {
            differences.push(format!("{name}: nothing is stored"));
            continue;
        };
        let mut parts = vec![("everywhere", outcome.everywhere)];
        if is_fused {
            parts.push(("fused", outcome.fused));
        }
        for (part, found) in parts {
            match expected.get(part) {
                Some(expected) => {
                    compare(name, expected, &Value::Object(found), &mut differences);
                }
                None => differences.push(format!("{name}: nothing is stored for {part}")),
            }
        }
    }
    if is_writing {
        let mut text = serde_json::to_string_pretty(&stored).unwrap();
        text.push('\n');
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(&path, text).unwrap();
        println!("wrote {}", path.display());
        return;
    }
    differences.extend(
        stored
            .keys()
            .map(|name| format!("{name}: is stored and has no test")),
    );
    assert!(
        differences.is_empty(),
        "{} differences from {}:\n{}",
        differences.len(),
        path.display(),
        differences.join("\n")
    );
}
