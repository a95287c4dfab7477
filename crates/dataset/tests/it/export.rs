//! Copies for the Hugging Face Hub.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use radarllm_dataset::{DatasetError, Overwrite, build, export, validate};

use crate::support::{make, options, plan, tree};

/// Names the folder for the child process, which is a test in another role.
const CHILD_DIR: &str = "RADARLLM_EXPORT_TEST_DIR";

fn built(dir: &Path, n_items: usize) {
    build(dir, &plan(n_items), options(1), make, |_| {}).unwrap();
}

/// What of a data set belongs into the copy.
fn content(dir: &Path) -> std::collections::BTreeMap<String, Vec<u8>> {
    let mut files = tree(dir);
    files.retain(|name, _| !name.starts_with(".shards"));
    files
}

#[test]
fn the_copy_is_the_data_set_without_the_state_of_its_build() {
    let folder = tempfile::tempdir().unwrap();
    let [data, hub] = ["data", "hub"].map(|name| folder.path().join(name));
    built(&data, 40);
    fs::write(data.join("notes.txt"), "mine").unwrap();
    let manifest = export(&data, &hub, Overwrite::Refuse).unwrap();
    assert_eq!(manifest.n_clips, 40);
    fs::remove_file(data.join("notes.txt")).unwrap();
    assert!(tree(&hub) == content(&data));
    assert_eq!(validate(&hub).unwrap(), []);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);

    let error = export(&data, &hub, Overwrite::Refuse).unwrap_err();
    assert!(matches!(error, DatasetError::Exists { .. }), "{error}");

    // Fewer shards: those of the earlier copy go, what belongs to git stays.
    let fewer = folder.path().join("fewer");
    built(&fewer, 12);
    fs::create_dir(hub.join(".git")).unwrap();
    fs::write(hub.join(".git/HEAD"), "ref").unwrap();
    fs::write(hub.join("data/extra.txt"), "mine").unwrap();
    export(&fewer, &hub, Overwrite::Replace).unwrap();
    let mut expected = content(&fewer);
    expected.insert(".git/HEAD".into(), b"ref".to_vec());
    expected.insert("data/extra.txt".into(), b"mine".to_vec());
    assert!(tree(&hub) == expected);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 3);

    // An empty folder has nothing to lose.
    let empty = folder.path().join("empty");
    fs::create_dir(&empty).unwrap();
    export(&data, &empty, Overwrite::Refuse).unwrap();
    assert!(tree(&empty) == content(&data));
}

#[test]
fn a_changed_byte_is_noticed_and_nothing_is_copied() {
    let folder = tempfile::tempdir().unwrap();
    let [data, hub] = ["data", "hub"].map(|name| folder.path().join(name));
    built(&data, 40);
    let shard = data.join("data/val-00000-of-00001.parquet");
    let whole = fs::read(&shard).unwrap();
    let mut changed = whole.clone();
    changed[whole.len() / 2] ^= 1;
    let mut longer = whole.clone();
    longer.push(0);
    for bytes in [
        &changed,
        &longer,
        &whole[..whole.len() - 1].to_vec(),
        &Vec::new(),
    ] {
        fs::write(&shard, bytes).unwrap();
        let error = export(&data, &hub, Overwrite::Refuse)
            .unwrap_err()
            .to_string();
        assert!(error.contains("val-00000-of-00001.parquet"), "{error}");
        assert!(!hub.exists());
        assert_eq!(
            fs::read_dir(folder.path()).unwrap().count(),
            1,
            "nothing is left"
        );
    }
    fs::remove_file(&shard).unwrap();
    assert!(export(&data, &hub, Overwrite::Refuse).is_err());
    fs::write(&shard, &whole).unwrap();

    // A copy that is to be replaced stays as it was.
    export(&data, &hub, Overwrite::Refuse).unwrap();
    let before = tree(&hub);
    fs::write(&shard, &changed).unwrap();
    assert!(export(&data, &hub, Overwrite::Replace).is_err());
    assert!(tree(&hub) == before);
    fs::write(&shard, &whole).unwrap();

    // The manifest.
    let path = data.join("manifest.json");
    let text = fs::read_to_string(&path).unwrap();
    for (from, to, word) in [
        ("\"n_clips\": 40", "\"n_clips\": 41", "n_clips is 41"),
        ("\"rows\": 8", "\"rows\": 9", "has 8 ids"),
        ("\"blake3\": \"", "\"blake3\": \"0", "train-00000-of-"),
        ("data/train-00000", "../data/train-00000", "../data/train"),
        ("data/train-00001-", "data/train-00000-", "is listed twice"),
        ("\"bytes\": ", "\"bytes\": 1", "train-00000-of-"),
        (
            "\"schema_version\": 2",
            "\"schema_version\": 3",
            "3 is not in 1..=2",
        ),
        ("{", "", "manifest.json"),
    ] {
        assert!(text.contains(from), "{from}");
        fs::write(&path, text.replacen(from, to, 1)).unwrap();
        let error = export(&data, &folder.path().join("other"), Overwrite::Refuse).unwrap_err();
        assert!(error.to_string().contains(word), "{from} -> {to}: {error}");
        assert!(!folder.path().join("other").exists());
    }
    fs::remove_file(&path).unwrap();
    let error = export(&data, &folder.path().join("other"), Overwrite::Refuse).unwrap_err();
    assert!(error.to_string().contains("manifest.json"), "{error}");
}

#[test]
fn folders_that_hold_something_else_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let [data, thesis, file] = ["data", "thesis", "file"].map(|name| folder.path().join(name));
    built(&data, 20);
    let before = tree(&data);
    fs::create_dir(&thesis).unwrap();
    fs::write(thesis.join("thesis.tex"), "x").unwrap();
    fs::write(&file, "x").unwrap();
    let second = folder.path().join("second");
    built(&second, 20);
    for target in [
        thesis.clone(),
        file,
        data.clone(),
        data.join("hub"),
        data.join("data"),
        second,
        folder.path().to_path_buf(),
        folder.path().join("no/such/folder"),
        "s3://bucket/hub".into(),
    ] {
        for overwrite in [Overwrite::Refuse, Overwrite::Replace] {
            let refused = export(&data, &target, overwrite);
            assert!(refused.is_err(), "{}", target.display());
        }
    }
    assert!(tree(&data) == before);
    assert_eq!(tree(&thesis).len(), 1);
    let names = fs::read_dir(folder.path()).unwrap().count();
    assert_eq!(names, 4, "nothing is left");
}

#[test]
fn a_link_in_the_place_of_the_unfinished_copy_is_not_followed() {
    let folder = tempfile::tempdir().unwrap();
    let [data, precious] = ["data", "precious"].map(|name| folder.path().join(name));
    built(&data, 20);
    fs::create_dir_all(precious.join("copy")).unwrap();
    fs::write(precious.join("copy/thesis.tex"), "x").unwrap();
    std::os::unix::fs::symlink(&precious, folder.path().join(".hub.export.tmp")).unwrap();
    let error = export(&data, &folder.path().join("hub"), Overwrite::Refuse).unwrap_err();
    assert!(matches!(error, DatasetError::Target { .. }), "{error}");
    assert_eq!(tree(&precious).len(), 1);
}

#[test]
fn a_killed_export_leaves_nothing_under_the_final_name() {
    const NAME: &str = "export::a_killed_export_leaves_nothing_under_the_final_name";
    if let Some(dir) = std::env::var_os(CHILD_DIR) {
        let dir = Path::new(&dir);
        export(&dir.join("data"), &dir.join("hub"), Overwrite::Refuse).unwrap();
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let [data, hub, staging] =
        ["data", "hub", ".hub.export.tmp"].map(|name| folder.path().join(name));
    built(&data, 600);
    let n_files_of_copy = || fs::read_dir(staging.join("copy/data")).map_or(0, Iterator::count);
    let start = Instant::now();
    // A kill may come too late; then the next one is tried.
    loop {
        assert!(
            start.elapsed() < Duration::from_secs(120),
            "no kill in time"
        );
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", NAME])
            .env(CHILD_DIR, folder.path())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        while n_files_of_copy() < 3 {
            if child.try_wait().unwrap().is_some() {
                break;
            }
        }
        child.kill().unwrap(); // SIGKILL on Unix: no destructor runs.
        child.wait().unwrap();
        if !hub.exists() {
            break;
        }
        fs::remove_dir_all(&hub).unwrap();
    }
    assert!(n_files_of_copy() >= 3, "the kill came too early");
    export(&data, &hub, Overwrite::Refuse).unwrap();
    assert!(tree(&hub) == content(&data) && !staging.exists());
}

#[test]
fn a_replacement_that_was_interrupted_is_completed() {
    let folder = tempfile::tempdir().unwrap();
    let [data, hub] = ["data", "hub"].map(|name| folder.path().join(name));
    built(&data, 40);
    export(&data, &hub, Overwrite::Refuse).unwrap();
    // A folder in the place of the card cannot be replaced by a file: the shards are in place, the manifest is not.
    fs::remove_file(hub.join("README.md")).unwrap();
    fs::create_dir(hub.join("README.md")).unwrap();
    let error = export(&data, &hub, Overwrite::Replace).unwrap_err();
    assert!(error.to_string().contains("README.md"), "{error}");
    assert!(!hub.join("manifest.json").exists());
    fs::remove_dir(hub.join("README.md")).unwrap();

    let error = export(&data, &hub, Overwrite::Refuse).unwrap_err();
    assert!(matches!(error, DatasetError::Exists { .. }), "{error}");
    export(&data, &hub, Overwrite::Replace).unwrap();
    assert!(tree(&hub) == content(&data));
}

#[test]
fn what_a_killed_export_left_is_cleared() {
    let folder = tempfile::tempdir().unwrap();
    let [data, hub] = ["data", "hub"].map(|name| folder.path().join(name));
    built(&data, 20);
    let left = folder.path().join(".hub.export.tmp");
    let half = left.join("copy/data/train-00000-of-00009.parquet");
    fs::create_dir_all(half.parent().unwrap()).unwrap();
    fs::write(&half, "half").unwrap();
    // While another process exports to the same folder, it is busy.
    let lock = fs::File::create(left.join("lock")).unwrap();
    lock.lock().unwrap();
    let error = export(&data, &hub, Overwrite::Refuse).unwrap_err();
    assert!(matches!(error, DatasetError::Locked { .. }), "{error}");
    assert!(half.exists());
    drop(lock);
    export(&data, &hub, Overwrite::Refuse).unwrap();
    assert!(tree(&hub) == content(&data) && !left.exists());
}
