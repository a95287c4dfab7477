//! Locks, modes, versions and damaged files.

use super::*;

fn path(dir: &TempDir) -> std::path::PathBuf {
    dir.path().join("live.db")
}

#[cfg(unix)]
#[test]
fn only_the_owner_reads_the_files() {
    use std::os::unix::fs::PermissionsExt;
    let (dir, mut store) = new_store();
    add(
        &mut store,
        &[activity(NOW_MS, NOW_MS, "walk", "a person walks")],
    );
    let modes = |dir: &TempDir| -> Vec<(String, u32)> {
        let mut modes: Vec<_> = fs::read_dir(dir.path())
            .unwrap()
            .map(|e| e.unwrap())
            .map(|e| {
                (
                    e.file_name().into_string().unwrap(),
                    e.metadata().unwrap().permissions().mode() & 0o777,
                )
            })
            .collect();
        modes.sort();
        modes
    };
    let expected =
        ["live.db", "live.db-shm", "live.db-wal", "live.db.lock"].map(|n| (n.to_string(), 0o600));
    assert_eq!(modes(&dir), expected);
    drop(store);
    // A file that others could read becomes private when it is opened.
    fs::set_permissions(path(&dir), fs::Permissions::from_mode(0o644)).unwrap();
    let _store = Store::open(&path(&dir), NOW_MS).unwrap();
    assert!(
        modes(&dir).iter().all(|(_, mode)| *mode == 0o600),
        "{:?}",
        modes(&dir)
    );
}

#[test]
fn settings_are_those_of_the_design() {
    let (_dir, store) = new_store();
    let value = |pragma: &str| -> rusqlite::types::Value {
        let read = store
            .timeline
            .connection
            .query_row(&format!("PRAGMA {pragma}"), [], |r| r.get(0));
        read.unwrap()
    };
    for (pragma, expected) in [
        ("synchronous", 1),
        ("auto_vacuum", 2),
        ("secure_delete", 1),
        ("foreign_keys", 1),
        ("trusted_schema", 0),
        ("user_version", 2),
        ("journal_size_limit", 8 << 20),
    ] {
        assert_eq!(value(pragma), expected.into(), "{pragma}");
    }
    assert_eq!(value("journal_mode"), "wal".to_string().into());
}

#[test]
fn there_is_one_writer_and_many_readers() {
    let (dir, mut store) = new_store();
    let error = Store::open(&path(&dir), NOW_MS).unwrap_err();
    assert!(matches!(error, StoreError::Locked { .. }), "{error}");
    let readers: Vec<Timeline> = (0..3)
        .map(|_| Timeline::open(&path(&dir)).unwrap())
        .collect();
    add(
        &mut store,
        &[activity(NOW_MS, NOW_MS, "walk", "a person walks")],
    );
    for reader in &readers {
        assert_eq!(ids(reader, &ActivityQuery::default()).len(), 1);
        assert!(
            reader
                .connection
                .execute("DELETE FROM activity", [])
                .is_err()
        );
    }
    drop(store);
    let opened = Store::open(&path(&dir), NOW_MS).unwrap();
    assert_eq!(
        ids(opened.store.timeline(), &ActivityQuery::default()).len(),
        1
    );
}

#[test]
fn a_lock_of_another_program_is_a_clear_error() {
    let (dir, mut store) = new_store();
    let other = Connection::open(path(&dir)).unwrap();
    other.execute_batch("BEGIN IMMEDIATE").unwrap();
    let error = store
        .write(|b| b.insert_activity(&activity(NOW_MS, NOW_MS, "walk", ""), &origin()))
        .unwrap_err();
    assert!(matches!(error, StoreError::Locked { .. }), "{error}");
    assert!(
        error.to_string().contains("in use by another process"),
        "{error}"
    );
    other.execute_batch("ROLLBACK").unwrap();
    add(&mut store, &[activity(NOW_MS, NOW_MS, "walk", "")]);
}

#[test]
fn a_full_disk_is_a_clear_error_and_passes() {
    let (_dir, mut store) = new_store();
    let write = |store: &mut Store| {
        store.write(|b| {
            for i in 0..200 {
                let caption = format!("{i}{}", "a long caption ".repeat(100));
                b.insert_activity(&activity(NOW_MS, NOW_MS, "walk", &caption), &origin())?;
            }
            Ok(())
        })
    };
    store.limit_pages(40).unwrap();
    let error = write(&mut store).unwrap_err();
    assert!(matches!(error, StoreError::Full { .. }), "{error}");
    assert_eq!(ids(store.timeline(), &ActivityQuery::default()), NO_IDS);
    store.limit_pages(4_000).unwrap();
    write(&mut store).unwrap();
    store.check_integrity().unwrap();
}

#[test]
fn newer_and_foreign_databases_are_refused_and_unchanged() {
    let (dir, store) = new_store();
    drop(store);
    sql(&path(&dir), "PRAGMA user_version = 3");
    for error in [
        Store::open(&path(&dir), NOW_MS).unwrap_err(),
        Timeline::open(&path(&dir)).unwrap_err(),
    ] {
        assert!(
            matches!(
                error,
                StoreError::Newer {
                    found: 3,
                    known: 2,
                    ..
                }
            ),
            "{error}"
        );
    }
    let foreign = dir.path().join("places.sqlite");
    sql(
        &foreign,
        "CREATE TABLE places (url TEXT); INSERT INTO places VALUES ('a')",
    );
    let before = fs::read(&foreign).unwrap();
    let error = Store::open(&foreign, NOW_MS).unwrap_err();
    assert!(matches!(error, StoreError::Unusable { .. }), "{error}");
    assert_eq!(fs::read(&foreign).unwrap(), before);
    assert!(Timeline::open(&foreign).is_err());
    let absent = Timeline::open(&dir.path().join("absent.db")).unwrap_err();
    assert!(
        matches!(
            absent,
            StoreError::Io {
                operation: "open",
                ..
            }
        ),
        "{absent}"
    );
    let empty = dir.path().join("empty.db");
    fs::write(&empty, b"").unwrap();
    assert!(matches!(
        Timeline::open(&empty).unwrap_err(),
        StoreError::Unusable { .. }
    ));
    Store::open(&empty, NOW_MS).unwrap();
}

#[test]
fn tables_that_are_not_ours_are_refused() {
    for statements in [
        "DROP TRIGGER activity_deleted",
        "CREATE TRIGGER more AFTER INSERT ON event BEGIN DELETE FROM activity; END",
        "DROP TABLE event; CREATE VIEW event AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i FROM n)
         SELECT i AS id, i AS at_ms, 'present' AS kind, i AS person, NULL AS data, 1 AS origin FROM n",
    ] {
        let (dir, store) = new_store();
        drop(store);
        sql(&path(&dir), statements);
        for error in [
            Store::open(&path(&dir), NOW_MS).unwrap_err(),
            Timeline::open(&path(&dir)).unwrap_err(),
        ] {
            assert!(matches!(error, StoreError::Unusable { .. }), "{statements}: {error}");
        }
    }
}

#[test]
fn a_path_is_never_a_uri() {
    let dir = tempdir().unwrap();
    let path = dir.path().join("file:live.db?mode=memory");
    let _opened = Store::open(&path, NOW_MS).unwrap();
    assert!(path.is_file());
    assert!(Store::open(Path::new(""), NOW_MS).is_err());
    assert!(Store::open(dir.path(), NOW_MS).is_err());
    assert!(Store::open(Path::new("nul\0byte"), NOW_MS).is_err());
}

#[test]
fn damaged_files_are_set_aside() {
    let dir = tempdir().unwrap();
    let garbage = b"This is no database, whatever its name says.".repeat(100);
    for n in 0..2 {
        fs::write(path(&dir), &garbage).unwrap();
        let opened = Store::open(&path(&dir), NOW_MS).unwrap();
        let aside = opened.set_aside.expect("set aside");
        let suffix = ["", "-2"][n];
        let expected = dir
            .path()
            .join(format!("live.db.damaged-20261123T173812Z{suffix}"));
        assert_eq!(aside.path, expected);
        assert!(!aside.problem.is_empty());
        assert_eq!(fs::read(&aside.path).unwrap(), garbage);
        assert_eq!(
            ids(opened.store.timeline(), &ActivityQuery::default()),
            NO_IDS
        );
        drop(opened.store);
        fs::remove_file(path(&dir)).unwrap();
    }
}

/// A database of some pages, closed, as bytes.
fn some_database(dir: &TempDir) -> Vec<u8> {
    let (from, mut store) = new_store();
    let rows: Vec<Activity> = (0..300)
        .map(|i| {
            activity(
                NOW_MS + i,
                NOW_MS + i,
                "walk",
                &format!("a person walks {i} steps"),
            )
        })
        .collect();
    let ids = add(&mut store, &rows);
    store
        .write(|b| b.store_points(PointsOf::Activity(ids[0]), NOW_MS, &frames(300)))
        .unwrap();
    store
        .write(|b| b.insert_event(&event(NOW_MS, EventKind::Present), &origin()))
        .unwrap();
    drop(store);
    let bytes = fs::read(path(&from)).unwrap();
    fs::write(path(dir), &bytes).unwrap();
    bytes
}

#[test]
fn a_page_of_zeros_is_found_and_set_aside() {
    let dir = tempdir().unwrap();
    let mut bytes = some_database(&dir);
    assert!(bytes.len() > 20 * 4096, "{}", bytes.len());
    // Page 3 is the root of a table, page 2 the map of pages.
    bytes[2 * 4096..3 * 4096].fill(0);
    fs::write(path(&dir), &bytes).unwrap();
    let opened = Store::open(&path(&dir), NOW_MS).unwrap();
    let aside = opened.set_aside.expect("set aside");
    assert_eq!(fs::read(aside.path).unwrap(), bytes);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn damaged_bytes_never_panic(damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..40), cut: Option<prop::sample::Index>) {
        let dir = tempdir().unwrap();
        let mut bytes = some_database(&dir);
        for (at, byte) in &damage {
            *at.get_mut(&mut bytes) = *byte;
        }
        if let Some(cut) = cut {
            bytes.truncate(cut.index(bytes.len()));
        }
        fs::write(path(&dir), &bytes).unwrap();
        // A reader does not check the file; it meets the damage while it reads.
        let read = |timeline: &Timeline| {
            let mut before = None;
            for _ in 0..10 {
                let page = timeline.activities(&ActivityQuery::default(), before, 100);
                before = page.ok().and_then(|p| p.next);
            }
            let text = Some("walks".to_string());
            let _ = timeline.tally(&ActivityQuery { text, ..ActivityQuery::default() });
            let _ = timeline.events(&EventQuery::default(), None, 10);
            let _ = timeline.points(PointsOf::Activity(1));
            let _ = timeline.oldest_ms();
        };
        if let Ok(timeline) = Timeline::open(&path(&dir)) {
            read(&timeline);
        }
        if let Ok(mut opened) = Store::open(&path(&dir), NOW_MS) {
            read(opened.store.timeline());
            let _ = opened.store.check_integrity();
            let _ = opened.store.prune(NOW_MS + 40 * DAY_MS, &Retention::default());
            let _ = opened.store.forget(None, NOW_MS + 100);
        }
    }
}
