//! A build killed with SIGKILL at several moments and resumed gives the bytes of an undisturbed one.

use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use radarllm_dataset::shard::ShardReader;
use radarllm_dataset::{Columns, ItemId, build, validate};

use crate::support::{make, options, plan, tree};

/// Names the directory for the child process, which is this test in another role.
const CHILD_DIR: &str = "RADARLLM_KILL_TEST_DIR";

#[test]
fn killed_builds_resume_to_the_same_bytes() {
    let plan = plan(120);
    let slowly = |item: &ItemId| {
        std::thread::sleep(Duration::from_millis(2));
        make(item)
    };
    if let Some(dir) = std::env::var_os(CHILD_DIR) {
        build(&PathBuf::from(dir), &plan, options(2), slowly, |_| {}).unwrap();
        return;
    }

    let undisturbed = tempfile::tempdir().unwrap();
    build(undisturbed.path(), &plan, options(1), make, |_| {}).unwrap();
    let expected = tree(undisturbed.path());

    let dir = tempfile::tempdir().unwrap();
    let data_dir = dir.path().join("data");
    let shards_there = || -> Vec<PathBuf> {
        let Ok(entries) = std::fs::read_dir(&data_dir) else {
            return Vec::new();
        };
        entries
            .map(|e| e.unwrap().path())
            .filter(|p| p.extension().is_some_and(|e| e == "parquet"))
            .collect()
    };
    let mut n_kills_in_mid_build = 0;
    // The plan has 16 shards. Kill once more than `n` are there, plus a little, to hit other phases.
    for (n, extra_ms) in [(0, 0), (2, 1), (5, 3), (8, 5), (11, 2)] {
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args([
                "--exact",
                "kill::killed_builds_resume_to_the_same_bytes",
                "--test-threads=1",
            ])
            .env(CHILD_DIR, dir.path())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let start = Instant::now();
        while shards_there().len() <= n && start.elapsed() < Duration::from_secs(20) {
            if child.try_wait().unwrap().is_some() {
                break;
            }
            std::thread::sleep(Duration::from_micros(300));
        }
        std::thread::sleep(Duration::from_millis(extra_ms));
        child.kill().unwrap(); // SIGKILL on Unix: no destructor runs.
        child.wait().unwrap();
        // Whatever has a final name is whole.
        for path in shards_there() {
            let reader = ShardReader::open(&path, Columns::All).unwrap();
            let n_rows = reader.n_rows();
            assert_eq!(reader.map(Result::unwrap).count() as u64, n_rows);
        }
        n_kills_in_mid_build += usize::from(!dir.path().join("manifest.json").exists());
    }
    assert!(
        n_kills_in_mid_build >= 3,
        "the child was too fast: {n_kills_in_mid_build} kills in mid-build"
    );

    let report = build(dir.path(), &plan, options(2), make, |_| {}).unwrap();
    assert!(report.n_kept_shards > 0, "nothing was resumed");
    let found = tree(dir.path());
    assert_eq!(
        found.keys().collect::<Vec<_>>(),
        expected.keys().collect::<Vec<_>>()
    );
    assert!(found == expected, "bytes differ");
    assert_eq!(validate(dir.path()).unwrap(), []);
}
