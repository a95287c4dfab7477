//! Tests of the memory as a whole.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use proptest::prelude::*;
use radarllm_base::RadarPoint;
use radarllm_monitor::points::FramePoints;
use radarllm_monitor::rows::{Activity, ActivityRow, Event, EventKind, Growth, Origin};
use rusqlite::Connection;
use tempfile::{TempDir, tempdir};

use super::limits::{MAX_ACTIVITY_MS, MAX_CAPTION_BYTES};
use super::*;

/// 2026-11-23 17:38:12 UTC, a Monday.
pub(crate) const NOW_MS: i64 = 1_795_455_492_000;
const NO_IDS: [i64; 0] = [];
const MINUTE_MS: i64 = 60_000;
const DAY_MS: i64 = 86_400_000;

pub(crate) fn origin() -> Origin {
    Origin {
        source: "/dev/serial/by-id/radar".into(),
        radar: "awr1843boost".into(),
        model: "default".into(),
        decoder: "greedy".into(),
        version: "0.1.0".into(),
        synthetic: false,
    }
}

pub(crate) fn activity(start_ms: i64, end_ms: i64, action: &str, caption: &str) -> Activity {
    Activity {
        start_ms,
        end_ms,
        person: 1,
        action: action.into(),
        caption: caption.into(),
        confidence: Some(0.625),
        windows: 3,
        points: 120,
        place_m: Some([0.5, 2.25]),
    }
}

pub(crate) fn add_events(store: &mut Store, events: &[(i64, EventKind)]) {
    let insert = |batch: &Batch<'_>| {
        let mut events = events.iter();
        events.try_for_each(|(at_ms, kind)| {
            let event = event(*at_ms, *kind);
            batch.insert_event(&event, &origin()).map(drop)
        })
    };
    store.write(insert).unwrap();
}

pub(crate) fn event(at_ms: i64, kind: EventKind) -> Event {
    Event {
        at_ms,
        kind,
        person: Some(1),
        data: None,
    }
}

/// A radar was watched from one time to another. A run that ends now goes on.
pub(crate) fn watch(store: &mut Store, start_ms: i64, end_ms: i64) {
    let run = Run {
        start_ms,
        end_ms,
        is_over: end_ms != NOW_MS,
    };
    store.write(|batch| batch.write_run(None, &run)).unwrap();
}

pub(crate) fn new_store() -> (TempDir, Store) {
    let dir = tempdir().unwrap();
    let opened = Store::open(&dir.path().join("live.db"), NOW_MS).unwrap();
    assert_eq!(opened.set_aside, None);
    (dir, opened.store)
}

pub(crate) fn add(store: &mut Store, activities: &[Activity]) -> Vec<i64> {
    let insert = |batch: &Batch<'_>| {
        let ids = activities
            .iter()
            .map(|a| batch.insert_activity(a, &origin()));
        ids.collect()
    };
    store.write(insert).unwrap()
}

fn frames(n_points: usize) -> Vec<FramePoints> {
    let point = RadarPoint {
        x_m: 0.5,
        y_m: 2.0,
        ..RadarPoint::default()
    };
    let frame = |offset_ms| FramePoints {
        offset_ms,
        points: vec![point; n_points],
    };
    vec![frame(0), frame(100)]
}

fn ids(timeline: &Timeline, query: &ActivityQuery) -> Vec<i64> {
    let page = timeline.activities(query, None, 500).unwrap();
    page.rows.iter().map(|row| row.id).collect()
}

/// Whether a word stands in the database or its log, in any case.
fn files_contain(dir: &Path, word: &str) -> bool {
    let word = word.to_lowercase();
    fs::read_dir(dir).unwrap().any(|entry| {
        let bytes = fs::read(entry.unwrap().path()).unwrap();
        let lower = bytes.to_ascii_lowercase();
        lower.windows(word.len()).any(|w| w == word.as_bytes())
    })
}

#[test]
fn rows_come_back_as_they_were_written() {
    let (dir, mut store) = new_store();
    let mut first = activity(NOW_MS, NOW_MS + 4_000, "sit_down", "a person sits down");
    first.confidence = None;
    first.place_m = None;
    let second = activity(NOW_MS + 1, NOW_MS + 1, "wave", "a person waves \"hello\" ☺");
    let fall = Event {
        data: Some(serde_json::json!({"id": 7, "dwell_s": 20.0})),
        ..event(NOW_MS + 5, EventKind::Confirmed)
    };
    let (a, b, e) = store
        .write(|batch| {
            let a = batch.insert_activity(&first, &origin())?;
            let b = batch.insert_activity(&second, &origin())?;
            Ok((a, b, batch.insert_event(&fall, &origin())?))
        })
        .unwrap();
    // Another connection reads what was committed.
    let timeline = Timeline::open(&dir.path().join("live.db")).unwrap();
    let row = |id, activity| ActivityRow {
        id,
        activity,
        origin: origin(),
    };
    assert_eq!(timeline.activity(a).unwrap(), Some(row(a, first.clone())));
    assert_eq!(timeline.activity(99).unwrap(), None);
    let page = timeline
        .activities(&ActivityQuery::default(), None, 10)
        .unwrap();
    assert_eq!(page.rows, [row(b, second), row(a, first)]);
    assert_eq!(page.next, None);
    let events = timeline.events(&EventQuery::default(), None, 10).unwrap();
    assert_eq!((events.rows[0].id, &events.rows[0].event), (e, &fall));
    assert_eq!(timeline.oldest_ms().unwrap(), Some(NOW_MS));
    let json = serde_json::to_value(&page).unwrap();
    assert_eq!(json["rows"][0]["action"], "wave");
    assert_eq!(json["rows"][0]["origin"]["synthetic"], false);
    // Two rows, one origin.
    let n: i64 = store
        .timeline
        .connection
        .query_row("SELECT count(*) FROM origin", [], |r| r.get(0))
        .unwrap();
    assert_eq!(n, 1);
}

#[test]
fn activities_grow_and_are_found_by_their_new_words_only() {
    let (_dir, mut store) = new_store();
    let id = add(
        &mut store,
        &[activity(NOW_MS, NOW_MS + 2_000, "walk", "a person walks")],
    )[0];
    let growth = |end_ms| Growth {
        end_ms,
        caption: "a person strolls".into(),
        confidence: Some(0.5),
        windows: 4,
        points: 200,
        place_m: Some([-1.0, 3.0]),
    };
    let extend =
        |store: &mut Store, id, end_ms| store.write(|b| b.extend_activity(id, &growth(end_ms)));
    extend(&mut store, id, NOW_MS + 6_000).unwrap();
    let row = store.timeline().activity(id).unwrap().unwrap().activity;
    let expected = Activity {
        windows: 4,
        points: 200,
        confidence: Some(0.5),
        place_m: Some([-1.0, 3.0]),
        ..activity(NOW_MS, NOW_MS + 6_000, "walk", "a person strolls")
    };
    assert_eq!(row, expected);
    let with = |text: &str| ActivityQuery {
        text: Some(text.into()),
        ..ActivityQuery::default()
    };
    assert_eq!(ids(store.timeline(), &with("strolling")), [id]);
    // "walk" is the action, "walks" was in the former caption as well.
    assert_eq!(ids(store.timeline(), &with("walk")), [id]);
    assert_eq!(ids(store.timeline(), &with("person walk strolls")), [id]);
    assert_eq!(ids(store.timeline(), &with("sits")), NO_IDS);
    let error = extend(&mut store, id, NOW_MS + 5_999).unwrap_err();
    assert!(
        matches!(
            error,
            StoreError::Invalid {
                field: "end_ms",
                ..
            }
        ),
        "{error}"
    );
    let error = extend(&mut store, id, NOW_MS + MAX_ACTIVITY_MS + 1).unwrap_err();
    assert!(
        matches!(
            error,
            StoreError::Invalid {
                field: "end_ms",
                ..
            }
        ),
        "{error}"
    );
    let error = extend(&mut store, 77, NOW_MS).unwrap_err();
    assert!(
        matches!(error, StoreError::Missing { id: 77, .. }),
        "{error}"
    );
    store.check_integrity().unwrap();
}

#[test]
fn values_that_are_not_kept_are_named() {
    let (_dir, mut store) = new_store();
    let good = activity(NOW_MS, NOW_MS, "walk", "a person walks");
    for (field, bad) in [
        ("start_ms", activity(-1, 5, "walk", "")),
        ("end_ms", activity(5, 4, "walk", "")),
        ("end_ms", activity(0, MAX_ACTIVITY_MS + 1, "walk", "")),
        ("end_ms", activity(0, i64::MAX, "walk", "")),
        ("action", activity(0, 1, "", "")),
        ("action", activity(0, 1, &"a".repeat(251), "")),
        ("caption", activity(0, 1, "walk", "two\nlines")),
        ("caption", activity(0, 1, "walk", "nul\0")),
        (
            "caption",
            activity(0, 1, "walk", &"c".repeat(MAX_CAPTION_BYTES + 1)),
        ),
        (
            "confidence",
            Activity {
                confidence: Some(f64::NAN),
                ..good.clone()
            },
        ),
        (
            "confidence",
            Activity {
                confidence: Some(1.01),
                ..good.clone()
            },
        ),
        (
            "place_m",
            Activity {
                place_m: Some([0.0, f64::INFINITY]),
                ..good.clone()
            },
        ),
    ] {
        let error = store
            .write(|b| b.insert_activity(&bad, &origin()))
            .unwrap_err();
        assert!(
            matches!(&error, StoreError::Invalid { field: found, .. } if *found == field),
            "{field}: {error}"
        );
        assert!(error.to_string().len() < 200, "{error}");
    }
    let data = Some("x".repeat(5_000).into());
    let bad = Event {
        data,
        ..event(NOW_MS, EventKind::Present)
    };
    assert!(store.write(|b| b.insert_event(&bad, &origin())).is_err());
    assert!(
        store
            .timeline()
            .activities(&ActivityQuery::default(), None, 9)
            .unwrap()
            .rows
            .is_empty()
    );
}

#[test]
fn a_failed_batch_leaves_nothing() {
    let (_dir, mut store) = new_store();
    let error = store
        .write(|batch| {
            batch.insert_activity(
                &activity(NOW_MS, NOW_MS, "walk", "a person walks"),
                &origin(),
            )?;
            batch.insert_activity(&activity(NOW_MS, 0, "walk", ""), &origin())
        })
        .unwrap_err();
    assert!(matches!(error, StoreError::Invalid { .. }), "{error}");
    assert_eq!(ids(store.timeline(), &ActivityQuery::default()), NO_IDS);
}

#[test]
fn points_belong_to_a_row_and_go_with_it() {
    let (_dir, mut store) = new_store();
    let id = add(
        &mut store,
        &[activity(NOW_MS, NOW_MS, "walk", "a person walks")],
    )[0];
    let put = |store: &mut Store, of, n| store.write(|b| b.store_points(of, NOW_MS, &frames(n)));
    assert_eq!(put(&mut store, PointsOf::Activity(id), 5).unwrap(), 0);
    // Stored again, they replace the former ones.
    put(&mut store, PointsOf::Activity(id), 9).unwrap();
    let stored = store
        .timeline()
        .points(PointsOf::Activity(id))
        .unwrap()
        .unwrap();
    assert_eq!(
        stored.iter().map(|f| f.points.len()).collect::<Vec<_>>(),
        [9, 9]
    );
    assert_eq!(store.timeline().points(PointsOf::Event(id)).unwrap(), None);
    let error = put(&mut store, PointsOf::Event(5), 1).unwrap_err();
    assert!(
        matches!(
            error,
            StoreError::Missing {
                table: "event",
                id: 5
            }
        ),
        "{error}"
    );
    store.forget(None, NOW_MS + 1).unwrap();
    let n: i64 = store
        .timeline
        .connection
        .query_row("SELECT count(*) FROM points", [], |r| r.get(0))
        .unwrap();
    assert_eq!(n, 0);
}

mod files;
mod forgetting;
mod queries;
mod runs;

fn sql(path: &Path, statements: &str) {
    Connection::open(path)
        .unwrap()
        .execute_batch(statements)
        .unwrap();
}
