//! Retention, size and deletion.

use super::*;

/// Words that occur in no other text of the database.
const SECRETS: [&str; 3] = ["Zanzibar", "xylophone", "quokka"];

fn secret_rows(from_ms: i64, n: i64) -> Vec<Activity> {
    (0..n)
        .map(|i| {
            let word = SECRETS[i as usize % 3];
            let start_ms = from_ms + i * 1_000;
            activity(
                start_ms,
                start_ms + 500,
                "walk",
                &format!("a person carries a {word} number {i}"),
            )
        })
        .collect()
}

fn plain_rows(from_ms: i64, n: i64) -> Vec<Activity> {
    (0..n)
        .map(|i| {
            activity(
                from_ms + i * 1_000,
                from_ms + i * 1_000,
                "sit_down",
                &format!("a person sits down {i} times"),
            )
        })
        .collect()
}

/// Terms of the full-text index, as its own reader gives them.
fn terms(store: &Store) -> BTreeSet<String> {
    let connection = &store.timeline.connection;
    connection
        .execute_batch("CREATE VIRTUAL TABLE IF NOT EXISTS temp.terms USING fts5vocab (main, activity_fts, row)")
        .unwrap();
    let mut statement = connection.prepare("SELECT term FROM temp.terms").unwrap();
    let terms = statement.query_map([], |row| row.get(0)).unwrap();
    terms.map(Result::unwrap).collect()
}

#[test]
fn forgetting_leaves_no_bytes_behind() {
    let (dir, mut store) = new_store();
    let yesterday = NOW_MS - DAY_MS;
    // Between others, so that the pages have both.
    for i in 0..40 {
        add(&mut store, &plain_rows(NOW_MS + i * 50_000, 50));
        add(&mut store, &secret_rows(yesterday + i * 50_000, 50));
    }
    let secret_origin = Origin {
        source: "/home/quokka".into(),
        ..origin()
    };
    let secret_event = Event {
        data: Some(serde_json::json!({"room": "xylophone"})),
        ..event(yesterday, EventKind::Present)
    };
    store
        .write(|b| b.insert_event(&secret_event, &secret_origin))
        .unwrap();
    for secret in SECRETS {
        assert!(files_contain(dir.path(), secret), "{secret} was written");
    }
    assert!(terms(&store).contains("quokka"));
    let deleted = store.forget(None, NOW_MS).unwrap();
    let expected = Deleted {
        activities: 2_000,
        events: 1,
        points: 0,
    };
    assert_eq!(deleted, expected);
    for secret in SECRETS {
        assert!(
            !files_contain(dir.path(), secret),
            "{secret} is still there"
        );
    }
    // The index shortens words to stems and to what differs from the word before.
    let terms = terms(&store);
    assert!(
        terms.contains("sit")
            && !terms
                .iter()
                .any(|t| t.starts_with('z') || t.starts_with('q') || t == "carri"),
        "{terms:?}"
    );
    assert_eq!(
        fs::metadata(dir.path().join("live.db-wal")).unwrap().len(),
        0
    );
    let tally = store.timeline().tally(&ActivityQuery::default()).unwrap();
    assert_eq!(tally.count, 2_000);
    store.check_integrity().unwrap();
    // The rest is still found by its words.
    let text = Some("sits 7".to_string());
    let found = ids(
        store.timeline(),
        &ActivityQuery {
            text,
            ..ActivityQuery::default()
        },
    );
    assert_eq!(found.len(), 40);
}

#[test]
fn forgetting_a_range_keeps_what_is_outside() {
    let (dir, mut store) = new_store();
    let t = NOW_MS;
    let rows = [
        activity(t, t + 10, "walk", "a person walks before"),
        activity(t + 5, t + 15, "walk", "a person walks into it, zanzibar"),
        activity(t + 12, t + 12, "walk", "a person walks inside, zanzibar"),
        activity(t + 19, t + 30, "walk", "a person walks out of it, zanzibar"),
        activity(t + 20, t + 30, "walk", "a person walks after"),
    ];
    let added = add(&mut store, &rows);
    for at in [t + 9, t + 10, t + 19, t + 20] {
        store
            .write(|b| b.insert_event(&event(at, EventKind::Present), &origin()))
            .unwrap();
    }
    let deleted = store.forget(Some(t + 10), t + 20).unwrap();
    assert_eq!((deleted.activities, deleted.events), (3, 2));
    assert_eq!(
        ids(store.timeline(), &ActivityQuery::default()),
        [added[4], added[0]]
    );
    assert!(!files_contain(dir.path(), "zanzibar"));
    // Numbers are not used again.
    let next = add(&mut store, &rows[..1])[0];
    assert!(next > added[4]);
    for (from, to) in [(Some(5), 5), (Some(6), 5), (None, i64::MIN)] {
        let error = store.forget(from, to).unwrap_err();
        assert!(matches!(error, StoreError::Invalid { .. }), "{error}");
    }
}

#[test]
fn numbers_are_not_used_again_after_everything_is_forgotten() {
    let (_dir, mut store) = new_store();
    let last = add(&mut store, &plain_rows(NOW_MS, 5))[4];
    store.forget(None, i64::MAX).unwrap();
    assert!(add(&mut store, &plain_rows(NOW_MS, 1))[0] > last);
}

#[test]
fn a_reader_that_prevents_forgetting_is_named() {
    let (dir, mut store) = new_store();
    add(&mut store, &secret_rows(NOW_MS, 50));
    let reader = Connection::open(dir.path().join("live.db")).unwrap();
    reader.execute_batch("BEGIN").unwrap();
    let read = || -> i64 {
        reader
            .query_row("SELECT count(*) FROM activity", [], |r| r.get(0))
            .unwrap()
    };
    assert_eq!(read(), 50);
    let error = store.forget(None, i64::MAX).unwrap_err();
    assert!(matches!(error, StoreError::LogInUse { .. }), "{error}");
    assert_eq!(store.checkpoint().unwrap(), Checkpoint::ReaderActive);
    assert_eq!(read(), 50);
    reader.execute_batch("COMMIT").unwrap();
    store.forget(None, i64::MAX).unwrap();
    assert!(SECRETS.iter().all(|s| !files_contain(dir.path(), s)));
}

#[test]
fn old_rows_are_pruned_each_after_its_time() {
    let (_dir, mut store) = new_store();
    let ages_days = [400, 100, 40, 29, 1];
    let rows: Vec<Activity> = ages_days
        .iter()
        .map(|d| {
            activity(
                NOW_MS - d * DAY_MS,
                NOW_MS - d * DAY_MS + MINUTE_MS,
                "walk",
                "a person walks",
            )
        })
        .collect();
    let added = add(&mut store, &rows);
    for (days, id) in ages_days.iter().zip(&added) {
        let at_ms = NOW_MS - days * DAY_MS;
        store
            .write(|b| {
                let e = b.insert_event(&event(at_ms, EventKind::Confirmed), &origin())?;
                b.store_points(PointsOf::Event(e), at_ms, &frames(3))?;
                b.store_points(PointsOf::Activity(*id), at_ms, &frames(3))
            })
            .unwrap();
    }
    let retention = Retention {
        points_ms: 10 * DAY_MS,
        ..Retention::default()
    };
    let deleted = store.prune(NOW_MS, &retention).unwrap();
    assert_eq!(
        deleted,
        Deleted {
            activities: 3,
            events: 1,
            points: 4
        }
    );
    let timeline = store.timeline();
    assert_eq!(
        ids(timeline, &ActivityQuery::default()),
        [added[4], added[3]]
    );
    let events = timeline
        .events(&EventQuery::default(), None, 10)
        .unwrap()
        .rows;
    assert_eq!(events.len(), 4);
    // Points around events live as long as these.
    assert!(
        events
            .iter()
            .all(|e| timeline.points(PointsOf::Event(e.id)).unwrap().is_some())
    );
    assert!(
        timeline
            .points(PointsOf::Activity(added[3]))
            .unwrap()
            .is_none()
    );
    assert!(
        timeline
            .points(PointsOf::Activity(added[4]))
            .unwrap()
            .is_some()
    );
    assert_eq!(store.prune(NOW_MS, &retention).unwrap(), Deleted::default());
    store.check_integrity().unwrap();
}

#[test]
fn many_old_rows_are_pruned_in_batches() {
    let (_dir, mut store) = new_store();
    add(&mut store, &plain_rows(NOW_MS - 60 * DAY_MS, 2_500));
    let deleted = store.prune(NOW_MS, &Retention::default()).unwrap();
    assert_eq!(deleted.activities, 2_500);
    let n: i64 = store
        .timeline
        .connection
        .query_row("SELECT count(*) FROM origin", [], |r| r.get(0))
        .unwrap();
    assert_eq!(n, 0, "origins without rows go too");
}

#[test]
fn above_the_size_points_go_first_then_old_captions_never_events() {
    let (dir, mut store) = new_store();
    let added = add(&mut store, &plain_rows(NOW_MS, 3_000));
    let points_of = |store: &mut Store, ids: &[i64]| {
        let write = |b: &Batch<'_>| {
            ids.iter().try_for_each(|id| {
                b.store_points(PointsOf::Activity(*id), NOW_MS + id, &frames(400))
                    .map(drop)
            })
        };
        store.write(write).unwrap();
    };
    let without_points = store.used_bytes().unwrap();
    // 8 kB each.
    points_of(&mut store, &added[..200]);
    store
        .write(|b| b.insert_event(&event(0, EventKind::Confirmed), &origin()))
        .unwrap();
    let keep = Retention {
        activities_ms: i64::MAX,
        events_ms: i64::MAX,
        points_ms: i64::MAX,
        max_bytes: 0,
    };
    let enough = Retention {
        max_bytes: without_points + (600 << 10),
        ..keep
    };
    let deleted = store.prune(NOW_MS, &enough).unwrap();
    assert!(deleted.points > 0 && deleted.points < 200, "{deleted:?}");
    assert_eq!(deleted.activities, 0);
    assert!(store.used_bytes().unwrap() <= enough.max_bytes);
    // The oldest went.
    let timeline = store.timeline();
    assert!(
        timeline
            .points(PointsOf::Activity(added[0]))
            .unwrap()
            .is_none()
    );
    assert!(
        timeline
            .points(PointsOf::Activity(added[199]))
            .unwrap()
            .is_some()
    );
    // The file itself becomes smaller with the next checkpoint.
    store.checkpoint().unwrap();
    let length = fs::metadata(dir.path().join("live.db")).unwrap().len();
    assert!(length <= enough.max_bytes, "{length}");
    let little = Retention {
        max_bytes: without_points / 2,
        ..keep
    };
    let deleted = store.prune(NOW_MS, &little).unwrap();
    assert!(
        deleted.activities >= 1_000 && deleted.activities < 3_000,
        "{deleted:?}"
    );
    let left = ids(store.timeline(), &ActivityQuery::default());
    assert_eq!(left[0], added[2_999], "the newest stays");
    // With no space at all, events stay.
    store.prune(NOW_MS, &keep).unwrap();
    assert_eq!(ids(store.timeline(), &ActivityQuery::default()), NO_IDS);
    assert_eq!(
        store
            .timeline()
            .events(&EventQuery::default(), None, 9)
            .unwrap()
            .rows
            .len(),
        1
    );
    store.check_integrity().unwrap();
}

#[test]
fn a_checkpoint_empties_the_log() {
    let (dir, mut store) = new_store();
    add(&mut store, &plain_rows(NOW_MS, 100));
    let log = dir.path().join("live.db-wal");
    assert!(fs::metadata(&log).unwrap().len() > 0);
    assert_eq!(store.checkpoint().unwrap(), Checkpoint::Complete);
    assert_eq!(fs::metadata(&log).unwrap().len(), 0);
}
