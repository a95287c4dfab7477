//! The timeline over HTTP.

use radarllm_base::RadarPoint;
use radarllm_memory::store::PointsOf;
use radarllm_monitor::points::FramePoints;
use radarllm_monitor::rows::{Activity, Event, EventKind};

use super::*;
use crate::bus::tests::about;

fn activity(minutes_ago: i64, action: &str, caption: &str) -> Activity {
    let start_ms = NOW_MS - 60_000 * minutes_ago;
    Activity {
        start_ms,
        end_ms: start_ms + 4_000,
        person: 1,
        action: action.into(),
        caption: caption.into(),
        confidence: Some(0.6),
        windows: 2,
        points: 90,
        place_m: None,
    }
}

fn remembering(folder: &Path) -> Fixture {
    let path = folder.join("live.db");
    let mut store = Store::open(&path, NOW_MS).unwrap().store;
    let origin = about().origin;
    store
        .write(|batch| {
            batch.insert_activity(&activity(50, "walk", "a person walks"), &origin)?;
            batch.insert_activity(
                &activity(40, "sit_down", "a person sits <b>down</b>"),
                &origin,
            )?;
            let id =
                batch.insert_activity(&activity(30, "stand_up", "a person gets up"), &origin)?;
            let points = vec![RadarPoint::default(); 3];
            batch.store_points(
                PointsOf::Activity(id),
                NOW_MS,
                &[FramePoints {
                    offset_ms: 0,
                    points,
                }],
            )?;
            let event = Event {
                at_ms: NOW_MS - 60_000 * 35,
                kind: EventKind::Confirmed,
                person: Some(1),
                data: None,
            };
            batch.insert_event(&event, &origin)
        })
        .unwrap();
    with_memory(loopback(), Some((&path, store)))
}

#[test]
fn history_is_paged_and_searched() {
    let folder = tempfile::tempdir().unwrap();
    let fixture = remembering(folder.path());
    let all = fixture.get("/api/history").json();
    assert_eq!(all["rows"].as_array().unwrap().len(), 3);
    assert_eq!(all["rows"][0]["action"], "stand_up");
    assert_eq!(all["rows"][0]["origin"]["radar"], "awr1843boost");
    assert_eq!(all["events"][0]["kind"], "confirmed");
    assert_eq!(all["synthetic"], true);

    // Pages have every row and every event once.
    let (mut target, mut rows, mut events) = ("/api/history?limit=1".to_string(), 0, 0);
    loop {
        let page = fixture.get(&target).json();
        rows += page["rows"].as_array().unwrap().len();
        events += page["events"].as_array().unwrap().len();
        match page["next"].as_str() {
            Some(next) => target = format!("/api/history?limit=1&before={next}"),
            None => break,
        }
    }
    assert_eq!((rows, events), (3, 1));

    let n_rows = |parameters: &str| {
        let reply = fixture.get(&format!("/api/history?{parameters}"));
        assert_eq!(reply.status, 200, "{parameters}");
        reply.json()["rows"].as_array().unwrap().len()
    };
    assert_eq!(n_rows("q=walking"), 1);
    assert_eq!(n_rows("q=%22%20OR%20*"), 0);
    assert_eq!(n_rows("q="), 3);
    assert_eq!(n_rows("action=walk,stand_up"), 2);
    assert_eq!(n_rows("person=2"), 0);
    assert_eq!(
        n_rows(&format!(
            "from={}&to={}",
            NOW_MS - 2_450_000,
            NOW_MS - 2_350_000
        )),
        1
    );
    assert_eq!(n_rows("limit=100000"), 3);
}

#[test]
fn wrong_parameters_are_refused_with_their_name() {
    let folder = tempfile::tempdir().unwrap();
    let fixture = remembering(folder.path());
    for target in [
        "/api/history?form=1",
        "/api/history?from=yesterday",
        "/api/history?limit=0",
        "/api/history?limit=-1",
        "/api/history?before=x",
        "/api/history?from=1&from=2",
        "/api/history?person=99999999999",
        "/api/lanes",
        "/api/lanes?from=1",
        "/api/lanes?from=2&to=1",
        "/api/lanes?from=1&to=9000000000000",
        "/api/ask",
        "/api/ask?question=x",
        "/api/history?q=%ff%fe&before=",
    ] {
        let reply = fixture.get(target);
        assert_eq!(reply.status, 400, "{target}");
        assert!(!reply.json()["error"].as_str().unwrap().is_empty());
    }
    let actions = format!("/api/history?action={}", "a,".repeat(40));
    assert_eq!(fixture.get(&actions).status, 400);
    let question = format!("/api/ask?q={}", "x".repeat(2_000));
    assert_eq!(fixture.get(&question).status, 400);
    for target in [
        "/api/history",
        "/api/history?from=1",
        "/api/history?from=2&to=1",
        "/api/history?from=1&to=2&q=x",
    ] {
        assert_eq!(fixture.ask("DELETE", target, "").status, 400, "{target}");
    }
}

#[test]
fn a_range_is_told_as_lanes() {
    let folder = tempfile::tempdir().unwrap();
    let fixture = remembering(folder.path());
    let from = NOW_MS - 3_600_000;
    let lanes = fixture
        .get(&format!("/api/lanes?from={from}&to={NOW_MS}"))
        .json();
    let actions = lanes["actions"].as_array().unwrap();
    let names: Vec<&str> = actions
        .iter()
        .map(|a| a["action"].as_str().unwrap())
        .collect();
    assert_eq!(names, ["walk", "sit_down", "stand_up"]);
    assert_eq!(actions[0]["start_ms"], NOW_MS - 50 * 60_000);
    assert_eq!(actions[0]["end_ms"], NOW_MS - 50 * 60_000 + 4_000);
    assert_eq!(lanes["falls"][0]["is_confirmed"], true);
    assert_eq!(lanes["presence"].as_array().map(Vec::len), Some(0));
    assert_eq!(lanes["synthetic"], true);
}

#[test]
fn questions_are_answered() {
    let folder = tempfile::tempdir().unwrap();
    let fixture = remembering(folder.path());
    let answer = fixture
        .get("/api/ask?q=how+often+did+she+get+up+today%3F")
        .json();
    assert_eq!(answer["count"], 1);
    assert!(
        answer["answer"]
            .as_str()
            .unwrap()
            .starts_with("Someone got up once today")
    );
    assert_eq!(answer["synthetic"], true);
}

#[test]
fn points_of_an_activity_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let fixture = remembering(folder.path());
    let frames = fixture.get("/api/activity/3/points").json();
    assert_eq!(frames["frames"][0]["points"].as_str().unwrap().len(), 40);
    for id in ["1", "99", "x", "-1", "99999999999999999999", "%00"] {
        let reply = fixture.get(&format!("/api/activity/{id}/points"));
        assert_eq!(reply.status, 404, "{id}");
    }
}

#[test]
fn what_is_forgotten_is_gone_everywhere() {
    let folder = tempfile::tempdir().unwrap();
    let fixture = remembering(folder.path());
    // A foreign page cannot delete.
    let range = format!("/api/history?from=0&to={}", NOW_MS - 60_000 * 34);
    let foreign = fixture.ask("DELETE", &range, "Origin: http://evil.example\r\n");
    assert_eq!(foreign.status, 403);
    let deleted = fixture.ask("DELETE", &range, "");
    assert_eq!(deleted.status, 200, "{}", deleted.body);
    assert_eq!(deleted.json()["deleted"]["activities"], 2);
    assert_eq!(deleted.json()["deleted"]["events"], 1);
    let rest = fixture.get("/api/history").json();
    assert_eq!(rest["rows"].as_array().unwrap().len(), 1);
    assert!(rest["events"].as_array().unwrap().is_empty());
    let database = std::fs::read(folder.path().join("live.db")).unwrap();
    let contains = |text: &[u8]| database.windows(text.len()).any(|w| w == text);
    assert!(!contains(b"sits") && contains(b"gets up"));
}

#[test]
fn without_a_memory_there_is_none() {
    let fixture = fixture(loopback());
    for target in ["/api/history", "/api/ask?q=x", "/api/activity/1/points"] {
        let reply = fixture.get(target);
        assert_eq!(reply.status, 404, "{target}");
    }
    assert_eq!(
        fixture.ask("DELETE", "/api/history?from=0&to=1", "").status,
        404
    );
    let bundle = fixture.get("/api/bug-bundle").json();
    assert_eq!(bundle["has_memory"], false);
}

#[test]
fn a_damaged_memory_is_an_error_without_a_path() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(&folder.path().join("live.db"), NOW_MS).unwrap();
    let damaged = folder.path().join("secret-name.db");
    std::fs::write(&damaged, vec![7; 9_000]).unwrap();
    let fixture = with_memory(loopback(), Some((&damaged, store.store)));
    let reply = fixture.get("/api/history");
    assert_eq!(reply.status, 503);
    assert!(!reply.body.contains("secret"), "{}", reply.body);
}
