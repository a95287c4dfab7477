//! A build in three steps, by several processes.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Barrier;
use std::time::{Duration, Instant};

use radarllm_dataset::builder::{Builder, BuiltShards, no_recipe};
use radarllm_dataset::{BuildPlan, DatasetError, ItemId, Overwrite, build, validate};

use crate::support::{make, options, plan, tree};

/// Names the directory for the child process, which is a test in another role.
const CHILD_DIR: &str = "RADARLLM_STEPS_TEST_DIR";

fn shards(
    plan: &BuildPlan,
    dir: &Path,
    shards: impl IntoIterator<Item = usize>,
) -> Result<BuiltShards, DatasetError> {
    Builder::new(plan.clone())?.build_shards(dir, shards, options(1), make, |_| {}, &|| false)
}

fn undisturbed(plan: &BuildPlan) -> std::collections::BTreeMap<String, Vec<u8>> {
    let dir = tempfile::tempdir().unwrap();
    build(dir.path(), plan, options(1), make, |_| {}).unwrap();
    tree(dir.path())
}

#[test]
fn parts_in_any_order_and_at_once_give_the_bytes_of_one_build() {
    let plan = plan(100);
    let expected = undisturbed(&plan);
    let builder = Builder::new(plan.clone()).unwrap();
    assert_eq!(builder.n_shards(), 14);

    let dir = tempfile::tempdir().unwrap();
    builder
        .prepare(dir.path(), Overwrite::Refuse, &no_recipe)
        .unwrap();
    // Backwards, with 1 to 7 threads.
    for shard in (0..14).rev() {
        let options = options(1 + shard % 7);
        let built = builder
            .build_shards(dir.path(), [shard], options, make, |_| {}, &|| false)
            .unwrap();
        assert_eq!((built.entries.len(), built.n_kept), (1, 0));
    }
    let again = shards(&plan, dir.path(), 0..14).unwrap();
    assert_eq!((again.entries.len(), again.n_kept), (14, 14));
    assert_eq!(again.entries[13].file, "data/test-00002-of-00003.parquet");
    let manifest = builder.finish(dir.path()).unwrap();
    assert_eq!(manifest.n_clips, 100);
    assert!(tree(dir.path()) == expected, "one after the other");
    assert_eq!(validate(dir.path()).unwrap(), []);
    // Finishing twice changes nothing.
    builder.finish(dir.path()).unwrap();
    assert!(tree(dir.path()) == expected, "finished twice");

    // All parts at once, nobody prepares before, and everybody builds everything.
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("new/data");
    let start = Barrier::new(4);
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| {
                let builder = Builder::new(plan.clone()).unwrap();
                start.wait();
                builder.prepare_once(&out, &no_recipe).unwrap();
                shards(&plan, &out, 0..14).unwrap();
            });
        }
    });
    builder.finish(&out).unwrap();
    assert!(tree(&out) == expected, "all at once");
}

#[test]
fn an_early_finish_names_what_is_missing_and_writes_nothing() {
    let plan = plan(100);
    let builder = Builder::new(plan.clone()).unwrap();
    let dir = tempfile::tempdir().unwrap();
    builder
        .prepare(dir.path(), Overwrite::Refuse, &no_recipe)
        .unwrap();
    shards(&plan, dir.path(), (0..14).filter(|i| ![3, 9].contains(i))).unwrap();
    let before = tree(dir.path());
    let error = builder.finish(dir.path()).unwrap_err();
    let text = error.to_string();
    let DatasetError::Incomplete { missing, .. } = error else {
        panic!("{error}")
    };
    assert_eq!(missing, ["train-00003-of-00008", "val-00001-of-00003"]);
    assert!(
        text.contains("2 of 14") && text.contains("train-00003-of-00008, val-00001-of-00003"),
        "{text}"
    );
    assert!(
        tree(dir.path()) == before,
        "an early finish changes nothing"
    );

    // A shard that was changed after it was built counts as missing.
    shards(&plan, dir.path(), [3, 9]).unwrap();
    let path = dir.path().join("data/train-00000-of-00008.parquet");
    let mut bytes = std::fs::read(&path).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(&path, bytes).unwrap();
    let error = builder.finish(dir.path()).unwrap_err().to_string();
    assert!(error.contains("train-00000-of-00008"), "{error}");
    let again = shards(&plan, dir.path(), 0..14).unwrap();
    assert_eq!(again.n_kept, 13);
    builder.finish(dir.path()).unwrap();
    assert!(tree(dir.path()) == undisturbed(&plan));

    // Many names are cut.
    let dir = tempfile::tempdir().unwrap();
    let mut plan = plan.clone();
    plan.shard_size = 1;
    let builder = Builder::new(plan).unwrap();
    builder
        .prepare(dir.path(), Overwrite::Refuse, &no_recipe)
        .unwrap();
    let error = builder.finish(dir.path()).unwrap_err().to_string();
    assert!(error.contains("and 80 more"), "{error}");
}

#[test]
fn shards_of_another_place_or_build_are_named() {
    let plan = plan(100);
    let expected = undisturbed(&plan);
    let builder = Builder::new(plan.clone()).unwrap();
    let dir = tempfile::tempdir().unwrap();
    builder
        .prepare(dir.path(), Overwrite::Refuse, &no_recipe)
        .unwrap();
    shards(&plan, dir.path(), 0..14).unwrap();
    let data = |name: &str| dir.path().join(format!("data/{name}.parquet"));
    let sidecar = |name: &str| dir.path().join(format!(".shards/{name}.json"));
    let [first, second] = ["train-00000-of-00008", "train-00001-of-00008"];

    let named_and_built_again = |what: &str| {
        let error = builder.finish(dir.path()).unwrap_err();
        let DatasetError::Incomplete { missing, .. } = &error else {
            panic!("{what}: {error}")
        };
        assert_eq!(missing, &[second], "{what}");
        assert_eq!(shards(&plan, dir.path(), 0..14).unwrap().n_kept, 13);
        builder.finish(dir.path()).unwrap();
        assert!(tree(dir.path()) == expected, "{what}");
    };

    // Truncated.
    let whole = std::fs::read(data(second)).unwrap();
    std::fs::write(data(second), &whole[..whole.len() - 1]).unwrap();
    named_and_built_again("truncated");

    // A copy of its neighbour, and one whose sidecar has been made to fit.
    std::fs::copy(data(first), data(second)).unwrap();
    named_and_built_again("doubled");
    std::fs::copy(data(first), data(second)).unwrap();
    let text = std::fs::read_to_string(sidecar(first)).unwrap();
    std::fs::write(sidecar(second), &text).unwrap();
    named_and_built_again("doubled with its sidecar");
    std::fs::copy(data(first), data(second)).unwrap();
    std::fs::write(sidecar(second), text.replace(first, second)).unwrap();
    named_and_built_again("doubled with a changed sidecar");

    // The shard of another seed.
    let mut other = plan.clone();
    other.seed += 1;
    let elsewhere = tempfile::tempdir().unwrap();
    build(elsewhere.path(), &other, options(1), make, |_| {}).unwrap();
    for file in [data(second), sidecar(second)] {
        let name = file.strip_prefix(dir.path()).unwrap();
        std::fs::copy(elsewhere.path().join(name), &file).unwrap();
    }
    named_and_built_again("of another configuration");

    // A shard that the plan does not have. Readers would load it, because the card names shards by a pattern.
    for name in ["train-00008-of-00009", "train-00000-of-00008 (copy)"] {
        std::fs::copy(data(first), data(name)).unwrap();
        let before = tree(dir.path());
        for error in [
            builder.finish(dir.path()).unwrap_err(),
            build(dir.path(), &plan, options(1), make, |_| {}).unwrap_err(),
        ] {
            assert!(matches!(error, DatasetError::Stray { .. }), "{error}");
            assert!(error.to_string().contains(name), "{error}");
        }
        assert!(tree(dir.path()) == before, "nothing is removed");
        std::fs::remove_file(data(name)).unwrap();
    }
    builder.finish(dir.path()).unwrap();
    assert!(tree(dir.path()) == expected);
}

#[test]
fn processes_that_do_not_agree_are_refused() {
    let ours = plan(40);
    let dir = tempfile::tempdir().unwrap();
    let unprepared = shards(&ours, dir.path(), [0]).unwrap_err();
    assert!(
        matches!(unprepared, DatasetError::NotPrepared { .. }),
        "{unprepared}"
    );
    assert_eq!(tree(dir.path()).len(), 0);

    let builder = Builder::new(ours.clone()).unwrap();
    builder
        .prepare(dir.path(), Overwrite::Refuse, &no_recipe)
        .unwrap();
    shards(&ours, dir.path(), [0]).unwrap();
    let before = tree(dir.path());

    let other_version = BuildPlan {
        tool_version: "99.0.0".into(),
        ..ours.clone()
    };
    let other_seed = BuildPlan {
        seed: 8,
        ..ours.clone()
    };
    for (other, word) in [
        (&other_version, "version 99.0.0"),
        (&other_seed, "another configuration"),
    ] {
        let builder = Builder::new(other.clone()).unwrap();
        for error in [
            shards(other, dir.path(), [1]).unwrap_err(),
            builder.finish(dir.path()).unwrap_err(),
        ] {
            assert!(
                matches!(error, DatasetError::Disagreement { .. }),
                "{error}"
            );
            assert!(error.to_string().contains(word), "{error}");
        }
        let error = builder
            .prepare(dir.path(), Overwrite::Refuse, &no_recipe)
            .unwrap_err();
        assert!(matches!(error, DatasetError::Foreign { .. }), "{error}");
        assert!(error.to_string().contains(word), "{error}");
    }

    // Another processor may finish and keep what is there, but not compute.
    let elsewhere = BuildPlan {
        arithmetic: "abacus".into(),
        ..ours.clone()
    };
    let error = shards(&elsewhere, dir.path(), [0, 1]).unwrap_err();
    assert!(error.to_string().contains("`abacus`"), "{error}");
    assert!(
        tree(dir.path()) == before,
        "a refused process changes nothing"
    );
    assert_eq!(shards(&elsewhere, dir.path(), [0]).unwrap().n_kept, 1);
    let error = build(dir.path(), &elsewhere, options(1), make, |_| {}).unwrap_err();
    assert!(error.to_string().contains("`abacus`"), "{error}");
    shards(&ours, dir.path(), 0..builder.n_shards()).unwrap();
    Builder::new(elsewhere).unwrap().finish(dir.path()).unwrap();
    assert!(tree(dir.path()) == undisturbed(&ours));

    let error = shards(&ours, dir.path(), [14]).unwrap_err().to_string();
    assert!(error.contains("no shard 14"), "{error}");

    // A plan that does not fit its own configuration was changed by somebody.
    let path = dir.path().join(".shards/plan.json");
    let text = std::fs::read_to_string(&path).unwrap();
    let n_shards = format!("\"n_shards\": {}", builder.n_shards());
    assert!(text.contains(&n_shards), "{text}");
    std::fs::write(&path, text.replace(&n_shards, "\"n_shards\": 1000000")).unwrap();
    let error = shards(&ours, dir.path(), [0]).unwrap_err().to_string();
    assert!(error.contains("1000000 shards"), "{error}");
    for damaged in ["", "{", "[]", "{\"schema_version\": -1}"] {
        std::fs::write(&path, damaged).unwrap();
        let error = shards(&ours, dir.path(), [0]).unwrap_err().to_string();
        assert!(error.contains("plan.json"), "{error}");
    }
}

#[test]
fn folders_of_earlier_versions_of_the_program_are_resumed() {
    let plan = plan(40);
    let dir = tempfile::tempdir().unwrap();
    build(dir.path(), &plan, options(1), make, |_| {}).unwrap();
    let expected = tree(dir.path());
    // Their plan has three fields.
    let path = dir.path().join(".shards/plan.json");
    let text = std::fs::read_to_string(&path).unwrap();
    let hash = text
        .lines()
        .find(|line| line.contains("config_blake3"))
        .unwrap()
        .trim_end_matches(',');
    std::fs::write(
        &path,
        format!("{{\n  \"schema_version\": 2,\n  \"name\": \"test\",\n{hash}\n}}\n"),
    )
    .unwrap();
    let again = build(dir.path(), &plan, options(1), make, |_| {}).unwrap();
    assert_eq!(again.n_made_shards, 0);
    assert!(tree(dir.path()) == expected);
}

#[test]
fn who_is_alone_in_the_folder_waits_for_nobody_and_disturbs_nobody() {
    let plan = plan(40);
    let dir = tempfile::tempdir().unwrap();
    let builder = Builder::new(plan.clone()).unwrap();
    builder
        .prepare(dir.path(), Overwrite::Refuse, &no_recipe)
        .unwrap();
    // Left by a process that was killed; only those that are alone may remove it.
    let leftover = dir.path().join("data/.train.somewhere.1.0.tmp");
    std::fs::write(&leftover, b"half").unwrap();
    let while_others_build = |item: &ItemId| {
        for overwrite in [Overwrite::Refuse, Overwrite::Replace] {
            let error = builder
                .prepare(dir.path(), overwrite, &no_recipe)
                .unwrap_err();
            assert!(matches!(error, DatasetError::Locked { .. }), "{error}");
        }
        let error = builder.finish(dir.path()).unwrap_err();
        assert!(matches!(error, DatasetError::Locked { .. }), "{error}");
        let error = build(dir.path(), &plan, options(1), make, |_| {}).unwrap_err();
        assert!(matches!(error, DatasetError::Locked { .. }), "{error}");
        assert!(leftover.exists());
        make(item)
    };
    // The first item's assertions would be a failed clip, not a failed test.
    let built = builder
        .build_shards(
            dir.path(),
            [0, 1],
            options(2),
            while_others_build,
            |_| {},
            &|| false,
        )
        .unwrap();
    let failed: Vec<_> = built.entries.iter().flat_map(|e| &e.failed).collect();
    assert!(failed.is_empty(), "{failed:?}");
    shards(&plan, dir.path(), 0..builder.n_shards()).unwrap();
    assert!(leftover.exists());
    builder.finish(dir.path()).unwrap();
    assert!(tree(dir.path()) == undisturbed(&plan));
}

#[test]
fn a_stopped_process_leaves_complete_shards() {
    let plan = plan(40);
    let dir = tempfile::tempdir().unwrap();
    let builder = Builder::new(plan.clone()).unwrap();
    builder
        .prepare(dir.path(), Overwrite::Refuse, &no_recipe)
        .unwrap();
    let shards_done = std::sync::atomic::AtomicUsize::new(0);
    let order = std::sync::atomic::Ordering::Relaxed;
    let error = builder
        .build_shards(
            dir.path(),
            0..builder.n_shards(),
            options(1),
            make,
            |p| shards_done.store(p.n_shards_done, order),
            &|| shards_done.load(order) == 2,
        )
        .unwrap_err();
    assert!(matches!(error, DatasetError::Interrupted { .. }), "{error}");
    let again = shards(&plan, dir.path(), 0..builder.n_shards()).unwrap();
    assert_eq!(again.n_kept, 2);
    builder.finish(dir.path()).unwrap();
    assert!(tree(dir.path()) == undisturbed(&plan));
}

/// Clips in one shard: writing it takes some time, so that it can be interrupted.
fn large_plan() -> BuildPlan {
    let mut plan = plan(1500);
    plan.shard_size = 300;
    plan
}

/// Temporary files that process `pid` writes in the folder of shards.
fn being_written(dir: &Path, pid: u32) -> Vec<PathBuf> {
    let Ok(entries) = std::fs::read_dir(dir.join("data")) else {
        return Vec::new();
    };
    entries
        .map(|e| e.unwrap().path())
        .filter(|p| p.to_string_lossy().contains(&format!(".{pid}.")))
        .collect()
}

#[test]
fn a_process_that_is_killed_while_it_writes_loses_one_shard_at_most() {
    let plan = large_plan();
    let builder = Builder::new(plan.clone()).unwrap();
    if let Some(dir) = std::env::var_os(CHILD_DIR) {
        shards(&plan, Path::new(&dir), 0..builder.n_shards()).unwrap();
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    builder
        .prepare(dir.path(), Overwrite::Refuse, &no_recipe)
        .unwrap();
    let start_child = || -> Child {
        Command::new(std::env::current_exe().unwrap())
            .args([
                "--exact",
                "steps::a_process_that_is_killed_while_it_writes_loses_one_shard_at_most",
            ])
            .env(CHILD_DIR, dir.path())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap()
    };
    let mut n_leftovers = 0;
    let start = Instant::now();
    // A kill may come too late; then the next one is tried.
    while n_leftovers == 0 {
        assert!(
            start.elapsed() < Duration::from_secs(120),
            "no kill in mid-write"
        );
        for shard in complete_shards(dir.path()) {
            std::fs::remove_file(shard).unwrap();
        }
        let mut child = start_child();
        while being_written(dir.path(), child.id()).is_empty() {
            if child.try_wait().unwrap().is_some() {
                break;
            }
        }
        child.kill().unwrap(); // SIGKILL on Unix: no destructor runs.
        child.wait().unwrap();
        n_leftovers = being_written(dir.path(), child.id()).len();
    }
    let error = builder.finish(dir.path()).unwrap_err();
    assert!(matches!(error, DatasetError::Incomplete { .. }), "{error}");
    shards(&plan, dir.path(), 0..builder.n_shards()).unwrap();
    builder.finish(dir.path()).unwrap();
    assert!(tree(dir.path()) == undisturbed(&plan));
}

/// Shards under their final names.
fn complete_shards(dir: &Path) -> Vec<PathBuf> {
    std::fs::read_dir(dir.join("data"))
        .unwrap()
        .map(|e| e.unwrap().path())
        .filter(|p| p.extension().is_some_and(|e| e == "parquet"))
        .collect()
}
