//! A damaged memory: the bytes of a database; values of any type in the columns of a right one; blobs of points; and
//! questions in English to a right one. The first byte says which.
#![no_main]

use std::fs;
use std::path::Path;
use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;
use radarllm_fuzz::{NOW_MS, only_our_panics, pieces, write_memory};
use radarllm_memory::store::{ActivityQuery, EventQuery, PointsOf};
use radarllm_memory::{Clock, Store, Timeline, ask};
use rusqlite::types::Value;

const QUESTIONS: [&str; 4] = [
    "How often did she get up today?",
    "When did somebody fall this week?",
    "Was anybody there yesterday?",
    "What happened last night?",
];
/// Columns that may hold a value of another type.
const COLUMNS: [(&str, &str); 27] = [
    ("origin", "source"),
    ("origin", "radar"),
    ("origin", "synthetic"),
    ("activity", "start_ms"),
    ("activity", "end_ms"),
    ("activity", "person"),
    ("activity", "action"),
    ("activity", "caption"),
    ("activity", "confidence"),
    ("activity", "windows"),
    ("activity", "points"),
    ("activity", "place"),
    ("activity", "origin"),
    ("event", "at_ms"),
    ("event", "kind"),
    ("event", "person"),
    ("event", "data"),
    ("event", "origin"),
    ("points", "start_ms"),
    ("points", "end_ms"),
    ("points", "activity"),
    ("points", "event"),
    ("points", "blob"),
    ("run", "start_ms"),
    ("run", "end_ms"),
    ("run", "is_over"),
    ("run", "activities_ms"),
];
const CLOCK: Clock = Clock {
    now_ms: NOW_MS,
    offset_s: 3_600,
};

/// A right memory.
static MEMORY: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("live.db");
    write_memory(&path);
    fs::read(&path).expect("a memory")
});

fuzz_target!(init: only_our_panics(), |bytes: &[u8]| {
    let Some((kind, bytes)) = bytes.split_first() else {
        return;
    };
    if kind % 4 == 2 {
        let _ = radarllm_monitor::points::decode(bytes);
        return;
    }
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("live.db");
    match kind % 4 {
        0 => fs::write(&path, bytes).expect("a temporary file"),
        _ => fs::write(&path, &*MEMORY).expect("a temporary file"),
    }
    match kind % 4 {
        1 => change(&path, bytes),
        3 => {
            let timeline = Timeline::open(&path).expect("a memory");
            let _ = ask(&timeline, &String::from_utf8_lossy(bytes), CLOCK);
            return;
        }
        _ => {}
    }
    if let Ok(timeline) = Timeline::open(&path) {
        read(&timeline);
    }
    if let Ok(mut opened) = Store::open(&path, NOW_MS) {
        read(opened.store.timeline());
        let _ = opened.store.check_integrity();
        let _ = opened.store.timeline().newest_run();
        let _ = opened.store.forget(Some(0), NOW_MS);
    }
});

fn read(timeline: &Timeline) {
    for question in QUESTIONS {
        let _ = ask(timeline, question, CLOCK);
    }
    let _ = timeline.activities(&ActivityQuery::default(), None, 100);
    let text = ActivityQuery {
        text: Some("gets up".into()),
        ..ActivityQuery::default()
    };
    let _ = timeline.activities(&text, None, 100);
    let _ = timeline.tally(&ActivityQuery::default());
    let _ = timeline.events(&EventQuery::default(), None, 100);
    for id in 1..3 {
        let _ = timeline.points(PointsOf::Activity(id));
        let _ = timeline.points(PointsOf::Event(id));
    }
    let _ = timeline.lanes(NOW_MS - 86_400_000, NOW_MS);
    let _ = timeline.newest_ms();
    let _ = timeline.oldest_ms();
}

/// Changes columns of all rows: the name of a piece is the number of a column and the type of its value.
fn change(path: &Path, bytes: &[u8]) {
    let connection = rusqlite::Connection::open(path).expect("a memory");
    for (name, piece) in pieces(bytes) {
        let [column, kind, ..] = *name.as_bytes() else {
            continue;
        };
        let number = || {
            let mut number = [0; 8];
            let n = piece.len().min(8);
            number[..n].copy_from_slice(&piece[..n]);
            number
        };
        let value = match kind % 5 {
            0 => Value::Null,
            1 => Value::Integer(i64::from_le_bytes(number())),
            2 => Value::Real(f64::from_le_bytes(number())),
            3 => Value::Text(String::from_utf8_lossy(piece).into_owned()),
            _ => Value::Blob(piece.to_vec()),
        };
        let (table, column) = COLUMNS[usize::from(column) % COLUMNS.len()];
        // A value that the table refuses is not there.
        let _ = connection.execute(&format!("UPDATE {table} SET {column} = ?1"), [value]);
    }
}
