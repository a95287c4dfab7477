//! Data sets that several processes build, and their export.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    process::{Command, Output, Stdio},
    time::{Duration, Instant},
};

use crate::command::{json, refused};

/// A small data set: 10 training clips in 5 shards, and a shard each of validation and test clips.
const CONFIG: &str = "name = \"tiny\"\nseed = 5\nshard_clips = 2\nmax_frames = 3\nfacet_edge_m = 0.05\n\
    [[source]]\nkind = \"procedural\"\ntrain = 10\nval = 1\ntest = 1\n";
const N_SHARDS: usize = 7;

/// A folder with a configuration.
struct Bench(tempfile::TempDir);

impl Bench {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("data.toml"), CONFIG).unwrap();
        Self(folder)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// The arguments of `dataset VERB data.toml --out OUT MORE...`.
    fn args(&self, verb: &str, out: &str, more: &[&str]) -> Vec<String> {
        let [config, out] =
            [self.path("data.toml"), self.path(out)].map(|p| p.to_str().unwrap().into());
        let fixed = ["dataset".into(), verb.into(), config, "--out".into(), out];
        fixed
            .into_iter()
            .chain(more.iter().map(|s| s.to_string()))
            .collect()
    }

    fn command(&self, verb: &str, out: &str, more: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_radarllm"));
        command.args(self.args(verb, out, more));
        command
    }

    fn done(&self, verb: &str, out: &str, more: &[&str]) -> String {
        succeeded(self.command(verb, out, more).output().unwrap())
    }

    fn refused(&self, verb: &str, out: &str, more: &[&str]) -> String {
        let args = self.args(verb, out, more);
        refused(&args.iter().map(String::as_str).collect::<Vec<_>>())
    }

    /// Every file of a folder.
    fn tree(&self, name: &str) -> BTreeMap<PathBuf, Vec<u8>> {
        tree(&self.path(name))
    }
}

fn succeeded(output: Output) -> String {
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{stderr}");
    String::from_utf8(output.stdout).unwrap()
}

fn tree(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let (mut files, mut open) = (BTreeMap::new(), vec![folder.to_path_buf()]);
    while let Some(here) = open.pop() {
        for entry in fs::read_dir(here).unwrap() {
            let path = entry.unwrap().path();
            match path.is_dir() {
                true => open.push(path),
                false => {
                    let name = path.strip_prefix(folder).unwrap().to_path_buf();
                    files.insert(name, fs::read(&path).unwrap());
                }
            }
        }
    }
    files
}

#[test]
fn three_processes_at_once_build_the_bytes_of_one() {
    let bench = Bench::new();
    bench.done("build", "one", &["--threads", "2"]);
    let children: Vec<_> = ["1/3", "2/3", "3/3", "3/3"]
        .into_iter()
        .map(|part| {
            let mut command = bench.command(
                "build",
                "three",
                &["--shard", part, "--threads", "1", "--json"],
            );
            command.stdout(Stdio::piped()).stderr(Stdio::piped());
            command.spawn().unwrap()
        })
        .collect();
    let mut n_clips = Vec::new();
    for child in children {
        let text = succeeded(child.wait_with_output().unwrap());
        let report: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert_eq!(
            (&report["parts"], &report["failed"]),
            (&3.into(), &0.into())
        );
        n_clips.push(report["clips"].as_u64().unwrap());
    }
    // Shards 0, 3, 6; 1, 4; 2, 5: the last two are those of one clip.
    assert_eq!(n_clips, [5, 4, 3, 3]);
    let text = bench.done("finish", "three", &[]);
    assert!(text.contains("12 clips in 7 shards, 0 failed"), "{text}");
    assert!(bench.tree("one") == bench.tree("three"), "bytes differ");

    // What is there is kept, and a part may be empty.
    let text = bench.done("build", "three", &["--shard", "2/3"]);
    assert!(
        text.contains("part 2 of 3: 4 clips in 2 shards (0 made now)"),
        "{text}"
    );
    let text = bench.done("build", "three", &["--shard", "8/8"]);
    assert!(text.contains("0 clips in 0 shards"), "{text}");
    let report = json(
        &bench
            .args("finish", "three", &["--json"])
            .iter()
            .map(String::as_str)
            .collect::<Vec<_>>(),
    );
    assert_eq!(
        (&report["clips"], &report["shards"]),
        (&12.into(), &N_SHARDS.into())
    );
    assert!(
        bench.tree("one") == bench.tree("three"),
        "bytes differ afterwards"
    );
}

#[test]
fn parts_that_are_missing_wrong_or_do_not_agree_are_named() {
    let bench = Bench::new();
    for part in [
        "0/8",
        "9/8",
        "3",
        "3/0",
        "0/0",
        "-1/8",
        "1/8/9",
        "a/b",
        "",
        "99999999999999999999999/2",
    ] {
        let stderr = bench.refused("build", "out", &[&format!("--shard={part}")]);
        assert!(stderr.contains("--shard"), "{part}: {stderr}");
    }
    let stderr = bench.refused("build", "out", &["--shard", "9/8"]);
    assert!(stderr.contains("1/8 to 8/8"), "{stderr}");
    // Each process would remove what the others have built.
    let stderr = bench.refused("build", "out", &["--shard", "1/2", "--force"]);
    assert!(stderr.contains("--force"), "{stderr}");
    assert!(!bench.path("out").exists());

    let stderr = bench.refused("finish", "out", &[]);
    assert!(stderr.contains("not prepared"), "{stderr}");
    assert!(!bench.path("out").exists());

    bench.done("build", "out", &["--shard", "2/3"]);
    let stderr = bench.refused("finish", "out", &[]);
    assert!(stderr.contains("5 of 7 shards are missing"), "{stderr}");
    for name in [
        "train-00000-of-00005",
        "train-00002-of-00005",
        "test-00000-of-00001",
    ] {
        assert!(stderr.contains(name), "{stderr}");
    }
    assert!(!stderr.contains("train-00001-of-00005"), "{stderr}");
    assert!(!bench.path("out/manifest.json").exists());

    // Another configuration, and a folder that another version prepared.
    fs::write(
        bench.path("data.toml"),
        CONFIG.replace("seed = 5", "seed = 6"),
    )
    .unwrap();
    for stderr in [
        bench.refused("build", "out", &["--shard", "1/3"]),
        bench.refused("finish", "out", &[]),
    ] {
        assert!(stderr.contains("another configuration"), "{stderr}");
        assert!(
            stderr.contains("hint: all processes of a build need the same"),
            "{stderr}"
        );
    }
    fs::write(bench.path("data.toml"), CONFIG).unwrap();
    let plan = bench.path("out/.shards/plan.json");
    let text = fs::read_to_string(&plan).unwrap();
    let version = format!("\"tool_version\": \"{}\"", env!("CARGO_PKG_VERSION"));
    assert!(text.contains(&version), "{text}");
    fs::write(&plan, text.replace(&version, "\"tool_version\": \"0.0.9\"")).unwrap();
    for stderr in [
        bench.refused("build", "out", &["--shard", "1/3"]),
        bench.refused("finish", "out", &[]),
    ] {
        assert!(stderr.contains("version 0.0.9"), "{stderr}");
    }
}

#[test]
fn a_program_that_is_killed_while_it_writes_a_shard_is_run_again() {
    let bench = Bench::new();
    bench.done("build", "undisturbed", &[]);
    let start = Instant::now();
    let half_written = loop {
        assert!(
            start.elapsed() < Duration::from_secs(300),
            "no kill in mid-write"
        );
        let _ = fs::remove_dir_all(bench.path("out"));
        let mut child = bench
            .command("build", "out", &["--shard", "1/2", "--threads", "1"])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mine = format!(".{}.", child.id());
        let temporary = || -> Vec<PathBuf> {
            let entries = fs::read_dir(bench.path("out/data")).into_iter().flatten();
            entries
                .map(|e| e.unwrap().path())
                .filter(|p| p.to_string_lossy().contains(&mine))
                .collect()
        };
        // Without a pause: the file is there for a few milliseconds.
        while temporary().is_empty() && child.try_wait().unwrap().is_none() {}
        // SIGKILL on Unix: no destructor runs. It fails if the build has ended already.
        let _ = child.kill();
        let found = temporary();
        child.wait().unwrap();
        // The rename may have come first.
        if let Some(path) = found.into_iter().find(|p| p.exists()) {
            break path;
        }
    };
    bench.refused("finish", "out", &[]);
    assert!(
        half_written.exists(),
        "who is not alone removes nothing, who fails neither"
    );
    bench.done("build", "out", &["--shard", "2/2"]);
    bench.done("build", "out", &["--shard", "1/2"]);
    bench.done("finish", "out", &[]);
    assert!(
        bench.tree("out") == bench.tree("undisturbed"),
        "bytes differ"
    );
}

#[test]
fn object_stores_are_refused() {
    let bench = Bench::new();
    let config = bench.path("data.toml");
    for address in [
        "s3://bucket/data",
        "gs://bucket/data",
        "hf://datasets/me/data",
    ] {
        for more in [&[][..], &["--shard", "1/2"]] {
            let mut args = vec![
                "dataset",
                "build",
                config.to_str().unwrap(),
                "--out",
                address,
            ];
            args.extend(more);
            let stderr = refused(&args);
            assert!(
                stderr.contains(address) && stderr.contains("hint:"),
                "{stderr}"
            );
        }
    }
    assert!(!Path::new("s3:").exists());
}

/// File systems without locks or renames, imitated by a library that answers for the C library.
#[cfg(target_os = "linux")]
#[test]
fn file_systems_without_locks_or_renames_are_refused() {
    const LIBRARY: &str = r#"
        use std::ffi::{c_char, c_int};
        unsafe extern "C" { fn __errno_location() -> *mut c_int; }
        /// Fails if FAULT says so, and otherwise succeeds without an effect.
        fn answer(error: c_int) -> c_int {
            if std::env::var_os("FAULT").is_none_or(|f| f != "refused") { return 0; }
            // SAFETY: the C library gives the address of this thread's error number.
            unsafe { *__errno_location() = error; }
            -1
        }
    "#;
    const LOCKS: &str = "#[unsafe(no_mangle)]
        /// EOPNOTSUPP.
        pub extern \"C\" fn flock(_: c_int, _: c_int) -> c_int { answer(95) }";
    const RENAMES: &str = "#[unsafe(no_mangle)]
        /// EXDEV.
        pub extern \"C\" fn rename(_: *const c_char, _: *const c_char) -> c_int { answer(18) }";
    let bench = Bench::new();
    let mut libraries = Vec::new();
    for (name, function) in [("locks", LOCKS), ("renames", RENAMES)] {
        let file = bench.path(&format!("{name}.rs"));
        let library = bench.path(&format!("lib{name}.so"));
        fs::write(
            &file,
            format!("#![allow(unused_imports)]{LIBRARY}{function}"),
        )
        .unwrap();
        let compiled = Command::new("rustc")
            .args(["--edition=2024", "--crate-type=cdylib", "-o"])
            .args([&library, &file])
            .output()
            .unwrap();
        succeeded(compiled);
        libraries.push(library);
    }
    for (library, fault, word) in [
        (&libraries[0], "refused", "no locks"),
        (&libraries[0], "ignored", "locks have no effect"),
        (&libraries[1], "refused", "cannot be renamed"),
        (&libraries[1], "ignored", "renaming does not replace"),
    ] {
        for more in [&[][..], &["--shard", "1/2"]] {
            let output = bench
                .command("build", "new/out", more)
                .env("LD_PRELOAD", library)
                .env("FAULT", fault)
                .output()
                .unwrap();
            let stderr = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(1), "{word}: {stderr}");
            assert!(
                stderr.contains(word) && stderr.contains("hint:"),
                "{stderr}"
            );
            let found = fs::read_dir(bench.path("new"))
                .into_iter()
                .flatten()
                .count();
            assert_eq!(found, 0, "{word}: nothing is left behind");
        }
    }
}

#[test]
fn a_data_set_is_exported_with_checked_hashes() {
    let bench = Bench::new();
    bench.done("build", "data", &[]);
    let [data, hub] = ["data", "hub"].map(|name| bench.path(name).to_str().unwrap().to_string());
    let args = ["dataset", "export", &data, "--to", &hub];
    let report = json(&[&args[..], &["--json"]].concat());
    assert_eq!(
        (&report["clips"], &report["shards"]),
        (&12.into(), &N_SHARDS.into())
    );
    let mut expected = bench.tree("data");
    expected.retain(|name, _| !name.starts_with(".shards"));
    assert!(bench.tree("hub") == expected);
    let card = fs::read_to_string(bench.path("hub/README.md")).unwrap();
    for line in [
        "pretty_name: \"tiny\"",
        "license_name: mit-or-apache-2.0",
        "- n<1K",
        "| procedural | MIT OR Apache-2.0 | true | procedural motions of the RadarLLM project |",
    ] {
        assert!(card.lines().any(|l| l == line), "{line}: {card}");
    }

    let stderr = refused(&args);
    assert!(
        stderr.contains("hub: already exists") && stderr.contains("--force"),
        "{stderr}"
    );
    json(&[&args[..], &["--force", "--json"]].concat());
    assert!(bench.tree("hub") == expected);

    // One bit of one shard.
    let shard = bench.path("data/data/test-00000-of-00001.parquet");
    let mut bytes = fs::read(&shard).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(&shard, bytes).unwrap();
    let other = bench.path("other").to_str().unwrap().to_string();
    for args in [
        vec!["dataset", "export", &data, "--to", &hub, "--force"],
        vec!["dataset", "export", &data, "--to", &other],
    ] {
        let stderr = refused(&args);
        assert!(stderr.contains("test-00000-of-00001.parquet"), "{stderr}");
    }
    assert!(bench.tree("hub") == expected && !bench.path("other").exists());

    // A data set whose parts are not complete.
    bench.done("build", "parts", &["--shard", "1/2"]);
    let parts = bench.path("parts").to_str().unwrap().to_string();
    let stderr = refused(&["dataset", "export", &parts, "--to", &other]);
    assert!(stderr.contains("manifest.json"), "{stderr}");
}
