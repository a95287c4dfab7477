use std::sync::atomic::{AtomicUsize, Ordering};

use radarllm_dataset::{
    BatchIter, Columns, Dataset, DatasetError, ItemId, Overwrite, Progress, Split, Table, build,
    builder::{Builder, no_recipe},
    validate,
};

use crate::support::{clip, make, options, plan, tree};

#[test]
fn what_was_built_is_read_back_exactly_and_is_valid() {
    let dir = tempfile::tempdir().unwrap();
    // 100 items: 60 train in 8 shards, 20 val in 3, 20 test in 3; more than one row group none.
    let plan = plan(100);
    let report = build(dir.path(), &plan, options(2), make, |_: Progress| {}).unwrap();
    assert_eq!((report.n_made_shards, report.n_kept_shards), (14, 0));
    let dataset = Dataset::open(dir.path()).unwrap();
    for split in Split::ALL {
        let expected: Vec<_> = plan
            .items
            .iter()
            .filter(|i| i.split == split)
            .map(clip)
            .collect();
        assert_eq!(dataset.read_split(split).unwrap(), expected);
        assert_eq!(dataset.n_clips(split), expected.len() as u64);
        let light: Vec<_> = dataset
            .iter_split(split, Columns::Points)
            .map(Result::unwrap)
            .collect();
        for (light, full) in light.iter().zip(&expected) {
            assert_eq!(
                (&light.frames, &light.captions),
                (&full.frames, &full.captions)
            );
            assert!(light.joints.is_empty() && light.motion_features.is_empty());
            assert!(light.rotations6d.is_empty());
            assert_eq!(light.body_height_m, full.body_height_m);
        }
        assert_eq!(light.len(), expected.len());
        let rows: usize = dataset
            .iter_batches(split)
            .map(|batch| {
                let batch = batch.unwrap();
                let types = |t: &Table| {
                    t.columns
                        .iter()
                        .map(|c| (c.name.clone(), c.type_name()))
                        .collect::<Vec<_>>()
                };
                assert_eq!(types(&batch), types(&BatchIter::no_rows()));
                batch.n_rows()
            })
            .sum();
        assert_eq!(rows, expected.len());
    }
    assert_eq!(validate(dir.path()).unwrap(), []);

    let info = dataset.info().unwrap();
    let clips: Vec<_> = plan.items.iter().map(clip).collect();
    assert_eq!(info.total.clips, 100);
    assert_eq!(info.total.motions, 50);
    let points: usize = clips
        .iter()
        .flat_map(|c| &c.frames)
        .map(|f| f.points.len())
        .sum();
    assert_eq!(info.total.points, points as u64);
    // Frames are 0.1 s apart; clips of one frame last as long as their poses, at 20/s.
    let seconds: f64 = clips
        .iter()
        .map(|c| {
            if c.frames.len() > 1 {
                c.frames.len() as f64 / 10.0
            } else {
                c.joints.len() as f64 / 20.0
            }
        })
        .sum();
    // f32 durations, summed in f64: relative error below 1e-6.
    assert!((info.total.hours * 3600.0 / seconds - 1.0).abs() < 1e-6);
    assert_eq!(info.actions.values().sum::<u64>(), 100);
}

#[test]
fn shards_with_several_row_groups_keep_their_order() {
    let dir = tempfile::tempdir().unwrap();
    let mut plan = plan(100);
    plan.shard_size = 1000;
    plan.items.iter_mut().for_each(|i| i.split = Split::Train);
    build(dir.path(), &plan, options(2), make, |_| {}).unwrap();
    let expected: Vec<_> = plan.items.iter().map(clip).collect();
    assert_eq!(
        Dataset::open(dir.path())
            .unwrap()
            .read_split(Split::Train)
            .unwrap(),
        expected
    );
}

#[test]
fn a_stopped_build_goes_on_where_it_stopped() {
    let plan = plan(60);
    let [whole, stopped] = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    build(whole.path(), &plan, options(1), make, |_| {}).unwrap();
    // After 30 of 60 items: some shards are complete, one is not.
    let n_asked = AtomicUsize::new(0);
    let stop = || n_asked.fetch_add(1, Ordering::Relaxed) >= 30;
    let builder = Builder::new(plan.clone()).unwrap();
    let found = builder.build(stopped.path(), options(1), &no_recipe, make, |_| {}, &stop);
    assert!(
        matches!(found, Err(DatasetError::Interrupted { .. })),
        "{found:?}"
    );
    assert!(Dataset::open(stopped.path()).is_err());
    let report = build(stopped.path(), &plan, options(1), make, |_| {}).unwrap();
    assert!(report.n_kept_shards > 0 && report.n_made_shards > 0);
    assert!(tree(whole.path()) == tree(stopped.path()));
}

#[test]
fn bytes_do_not_depend_on_the_thread_count() {
    let plan = plan(60);
    let trees: Vec<_> = [1, 2, 7]
        .into_iter()
        .map(|threads| {
            let dir = tempfile::tempdir().unwrap();
            build(dir.path(), &plan, options(threads), make, |_| {}).unwrap();
            tree(dir.path())
        })
        .collect();
    assert!(trees[0] == trees[1] && trees[0] == trees[2]);
}

#[test]
fn failures_and_panics_are_recorded_and_counted() {
    let dir = tempfile::tempdir().unwrap();
    let plan = plan(20);
    let bad = |item: &ItemId| match item.id.as_str() {
        "m1#0" => Err("no such motion".to_string()),
        "m2#1" => panic!("deliberate"),
        "m3#0" => {
            let mut c = clip(item);
            c.captions[0] = " ".into();
            Ok(c)
        }
        _ => Ok(clip(item)),
    };
    let last = std::sync::Mutex::new(None);
    let report = build(dir.path(), &plan, options(2), bad, |p| {
        *last.lock().unwrap() = Some(p)
    })
    .unwrap();
    assert_eq!((report.manifest.n_clips, report.manifest.n_failed), (17, 3));
    assert_eq!(last.lock().unwrap().unwrap().n_failed, 3);
    let reasons: Vec<_> = report
        .manifest
        .shards
        .iter()
        .flat_map(|s| &s.failed)
        .map(|f| (f.id.as_str(), f.reason.as_str()))
        .collect();
    assert_eq!(
        reasons,
        [
            ("m1#0", "no such motion"),
            ("m2#1", "panicked: deliberate"),
            ("m3#0", "clip `m3#0`: caption 0 is empty")
        ]
    );
    assert_eq!(validate(dir.path()).unwrap(), []);

    // Kept by a plain rerun, remade on request.
    let again = build(dir.path(), &plan, options(2), make, |_| {}).unwrap();
    assert_eq!((again.n_made_shards, again.manifest.n_failed), (0, 3));
    let retry = radarllm_dataset::BuildOptions {
        retry_failed: true,
        ..options(2)
    };
    let again = build(dir.path(), &plan, retry, make, |_| {}).unwrap();
    assert_eq!((again.manifest.n_clips, again.manifest.n_failed), (20, 0));
}

#[test]
fn only_missing_or_damaged_shards_are_remade() {
    let dir = tempfile::tempdir().unwrap();
    let plan = plan(40);
    let first = build(dir.path(), &plan, options(2), make, |_| {}).unwrap();
    let before = tree(dir.path());
    let shards = &first.manifest.shards;
    std::fs::remove_file(shards[0].path(dir.path())).unwrap();
    let mut bytes = std::fs::read(shards[1].path(dir.path())).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(shards[1].path(dir.path()), bytes).unwrap();
    std::fs::write(
        dir.path().join("data/.train-00000.parquet.1.tmp"),
        b"left by a killed build",
    )
    .unwrap();

    let n_calls = AtomicUsize::new(0);
    let counting = |item: &ItemId| {
        n_calls.fetch_add(1, Ordering::Relaxed);
        make(item)
    };
    let again = build(dir.path(), &plan, options(2), counting, |_| {}).unwrap();
    assert_eq!(
        (again.n_made_shards, again.n_kept_shards),
        (2, shards.len() - 2)
    );
    assert_eq!(
        n_calls.load(Ordering::Relaxed) as u64,
        shards[0].rows + shards[1].rows
    );
    assert!(tree(dir.path()) == before);
}

#[test]
fn another_configuration_or_foreign_files_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let plan_a = plan(10);
    build(dir.path(), &plan_a, options(1), make, |_| {}).unwrap();
    let mut plan_b = plan(10);
    plan_b.config_toml = "variants = 3\n".into();
    let error = build(dir.path(), &plan_b, options(1), make, |_| {}).unwrap_err();
    assert!(matches!(error, DatasetError::Foreign { .. }), "{error}");
    assert_eq!(
        error.hint().unwrap().to_string(),
        "choose another directory, or `overwrite` starts over"
    );
    assert_eq!(
        Dataset::open(dir.path()).unwrap().manifest().config_toml,
        plan_a.config_toml
    );
    let force = radarllm_dataset::BuildOptions {
        overwrite: Overwrite::Replace,
        ..options(1)
    };
    build(dir.path(), &plan_b, force, make, |_| {}).unwrap();
    assert_eq!(
        Dataset::open(dir.path()).unwrap().manifest().config_toml,
        plan_b.config_toml
    );
    assert_eq!(validate(dir.path()).unwrap(), []);

    // Even `Overwrite::Replace` does not touch a directory that is something else.
    let other = tempfile::tempdir().unwrap();
    std::fs::write(other.path().join("thesis.tex"), "x").unwrap();
    let error = build(other.path(), &plan_a, force, make, |_| {}).unwrap_err();
    assert!(matches!(error, DatasetError::NotADataset { .. }), "{error}");
    assert_eq!(tree(other.path()).len(), 1);
}

#[test]
fn contradictory_plans_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let mut twice = plan(4);
    twice.items[1].id = twice.items[0].id.clone();
    let mut torn = plan(4);
    torn.items[1].split = Split::Test;
    for (plan, word) in [(twice, "twice"), (torn, "both")] {
        let error = build(dir.path(), &plan, options(1), make, |_| {})
            .unwrap_err()
            .to_string();
        assert!(error.contains(word), "{error}");
    }
}

#[test]
fn validation_names_what_is_wrong() {
    let dir = tempfile::tempdir().unwrap();
    let mut plan = plan(20);
    plan.licences.clear();
    // One motion in two groups that sit in two splits: legal for the plan, caught here.
    let shared = |item: &ItemId| {
        let mut c = clip(item);
        if item.id == "m0#0" || item.id == "m3#0" {
            c.motion_id = "shared".into();
        }
        Ok::<_, String>(c)
    };
    let report = build(dir.path(), &plan, options(1), shared, |_| {}).unwrap();
    let problems = validate(dir.path()).unwrap();
    assert!(
        problems
            .iter()
            .any(|p| p.problem.contains("no licence line"))
    );
    assert!(problems.iter().any(|p| {
        p.problem
            .contains("motion `shared` is in both train and val")
    }));
    assert_eq!(problems.len(), 2, "{problems:?}");

    // A value changed in place: the hash tells even though the file still decodes.
    let path = report.manifest.shards[0].path(dir.path());
    let mut bytes = std::fs::read(&path).unwrap();
    bytes[6] ^= 1;
    std::fs::write(&path, bytes).unwrap();
    assert!(
        validate(dir.path())
            .unwrap()
            .iter()
            .any(|p| p.problem.contains("BLAKE3"))
    );

    // A manifest that points outside is not followed.
    let manifest_path = dir.path().join("manifest.json");
    let text = std::fs::read_to_string(&manifest_path).unwrap();
    let evil = text.replacen(
        "data/train-00000-of-00002.parquet",
        "data/../../secret.parquet",
        1,
    );
    assert_ne!(text, evil);
    std::fs::write(&manifest_path, evil).unwrap();
    assert!(matches!(
        Dataset::open(dir.path()),
        Err(DatasetError::Metadata { .. })
    ));
}
