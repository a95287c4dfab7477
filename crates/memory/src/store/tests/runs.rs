//! Of which time something is known.

use super::*;
use crate::store::lanes::Stretch;
use crate::store::runs::{Known, Watched};

fn at(minutes: i64) -> i64 {
    NOW_MS + minutes * MINUTE_MS
}

fn stretch(from: i64, to: i64) -> Stretch {
    Stretch {
        start_ms: at(from),
        end_ms: at(to),
    }
}

fn known(watched: &Watched) -> Vec<(Stretch, Vec<Stretch>, bool)> {
    let of = |known: &Known| {
        let presence = known.presence.clone();
        (known.stretch, presence, known.is_present_at_end)
    };
    watched.known.iter().map(of).collect()
}

#[test]
fn runs_grow_and_the_newest_one_is_told() {
    let (_dir, mut store) = new_store();
    assert_eq!(store.timeline().newest_run().unwrap(), None);
    let mut run = Run {
        start_ms: at(0),
        end_ms: at(1),
        is_over: false,
    };
    let write = |store: &mut Store, id, run: &Run| store.write(|batch| batch.write_run(id, run));
    let id = write(&mut store, None, &run).unwrap();
    run.end_ms = at(5);
    assert_eq!(write(&mut store, Some(id), &run).unwrap(), id);
    assert_eq!(store.timeline().newest_run().unwrap(), Some(run));
    assert!(run.is_alive(at(5) + 30_000) && !run.is_alive(at(5) + 30_001));
    run.is_over = true;
    write(&mut store, Some(id), &run).unwrap();
    assert_eq!(store.timeline().newest_run().unwrap(), Some(run));
    assert!(!run.is_alive(at(5)));
    // One that is gone is added again.
    store.forget(None, at(6)).unwrap();
    assert_eq!(store.timeline().newest_run().unwrap(), None);
    assert!(write(&mut store, Some(id), &run).unwrap() > id);
    run.end_ms = at(-1);
    let refused = write(&mut store, None, &run).unwrap_err();
    assert!(matches!(
        refused,
        StoreError::Invalid {
            field: "end_ms",
            ..
        }
    ));
}

#[test]
fn presence_is_known_while_a_radar_is_watched_and_heard() {
    use EventKind::{Absent, Present, SourceBack, SourceLost};
    let (_dir, mut store) = new_store();
    watch(&mut store, at(0), at(10));
    watch(&mut store, at(20), at(60));
    add_events(
        &mut store,
        &[
            // Somebody is there until the run ends, and again in the next one.
            (at(2), Present),
            (at(25), Present),
            (at(30), Absent),
            (at(30), SourceLost),
            (at(35), SourceBack),
            // Whoever is detected at once may have been there.
            (at(35) + 5_000, Present),
            (at(40), Absent),
            (at(50), SourceLost),
        ],
    );
    let watched = store.timeline().watched([at(-5), at(100)], None).unwrap();
    let detected = Stretch {
        start_ms: at(35) + 5_000,
        end_ms: at(40),
    };
    let after_silence = Stretch {
        end_ms: at(50),
        ..detected
    };
    assert_eq!(
        known(&watched),
        [
            (stretch(0, 10), vec![stretch(2, 10)], true),
            (stretch(20, 30), vec![stretch(25, 30)], true),
            (after_silence, vec![detected], false),
        ]
    );
    assert_eq!(watched.silence, [stretch(30, 35), stretch(50, 60)]);
    // A part of it, in which it is known what was so before.
    let watched = store.timeline().watched([at(5), at(28)], None).unwrap();
    assert_eq!(
        known(&watched),
        [
            (stretch(5, 10), vec![stretch(5, 10)], true),
            (stretch(20, 28), vec![stretch(25, 28)], true),
        ]
    );
    let silent = store.timeline().watched([at(52), at(55)], None).unwrap();
    assert_eq!(
        (known(&silent), silent.silence),
        (vec![], vec![stretch(52, 55)])
    );
    // A run that goes on lasts until the present time.
    let (_dir, mut store) = new_store();
    watch(&mut store, at(-10), NOW_MS);
    let later_ms = NOW_MS + 9_000;
    let watched = store
        .timeline()
        .watched([at(-10), later_ms], Some(later_ms));
    let lasting = Stretch {
        start_ms: at(-10),
        end_ms: later_ms,
    };
    assert_eq!(known(&watched.unwrap()), [(lasting, vec![], false)]);
}

#[test]
fn nothing_is_known_of_what_was_forgotten() {
    use EventKind::{Absent, Present};
    let (_dir, mut store) = new_store();
    watch(&mut store, at(0), at(60));
    add_events(&mut store, &[(at(12), Present), (at(50), Absent)]);
    store.forget(Some(at(10)), at(20)).unwrap();
    let whole = [at(0), at(100)];
    let watched = store.timeline().watched(whole, None).unwrap();
    assert_eq!(
        known(&watched),
        [
            (stretch(0, 10), vec![], false),
            // Who was there at the end of what was forgotten is still there.
            (stretch(20, 60), vec![stretch(20, 50)], false),
        ]
    );
    store.forget(Some(at(40)), i64::MAX).unwrap();
    let watched = store.timeline().watched(whole, None).unwrap();
    assert_eq!(
        known(&watched),
        [
            (stretch(0, 10), vec![], false),
            (stretch(20, 40), vec![stretch(20, 40)], true),
        ]
    );
    store.forget(None, at(30)).unwrap();
    let watched = store.timeline().watched(whole, None).unwrap();
    assert_eq!(
        known(&watched),
        [(stretch(30, 40), vec![stretch(30, 40)], true)]
    );
}

#[test]
fn a_database_of_the_version_before_has_runs_where_it_has_entries() {
    let (dir, mut store) = new_store();
    let path = dir.path().join("live.db");
    add_events(
        &mut store,
        &[
            (at(0), EventKind::Present),
            (at(50), EventKind::Absent),
            (at(200), EventKind::Present),
        ],
    );
    add(
        &mut store,
        &[activity(at(45), at(70), "walk", "a person walks")],
    );
    drop(store);
    sql(&path, "DROP TABLE run; PRAGMA user_version = 1");
    // A reader adds them as well.
    let timeline = Timeline::open(&path).unwrap();
    let watched = timeline.watched([at(-10), at(300)], None).unwrap();
    assert_eq!(
        known(&watched),
        [
            (stretch(0, 70), vec![stretch(0, 50)], false),
            (stretch(200, 200), vec![stretch(200, 200)], true),
        ]
    );
    assert!(timeline.connection.execute("DELETE FROM run", []).is_err());
    drop(timeline);
    Store::open(&path, NOW_MS).unwrap();
}

#[test]
fn runs_are_deleted_with_what_they_tell() {
    let (_dir, mut store) = new_store();
    watch(&mut store, NOW_MS - 500 * DAY_MS, NOW_MS - 400 * DAY_MS);
    watch(&mut store, NOW_MS - 380 * DAY_MS, NOW_MS);
    store.prune(NOW_MS, &Retention::default()).unwrap();
    let watched = store.timeline().watched([0, NOW_MS], None).unwrap();
    let [one] = &watched.known[..] else {
        panic!("{watched:?}");
    };
    // Events are kept for 365 days, activities for 30.
    assert_eq!(one.stretch.start_ms, NOW_MS - 365 * DAY_MS);
    assert_eq!(one.activities_ms, NOW_MS - 30 * DAY_MS);
}
