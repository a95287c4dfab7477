//! Times in which nobody watched or the radar was silent, falls that are open or were dismissed, and the present.

use radarllm_monitor::rows::Event;

use super::*;
use crate::store::Run;

fn ago(minutes: i64) -> i64 {
    NOW_MS - minutes * MINUTE_MS
}

fn says(store: &Store, question: &str) -> String {
    let answer = ask(store.timeline(), question, CLOCK).unwrap();
    assert!(answer.understood.is_some(), "{question}: {}", answer.answer);
    let end = " Nobody is identified";
    let (text, _) = answer
        .answer
        .split_once(end)
        .unwrap_or((&answer.answer, ""));
    text.to_string()
}

fn check(store: &Store, expected: &[(&str, &str)]) {
    for (question, expected) in expected {
        assert_eq!(says(store, question), *expected, "{question}");
    }
}

/// An event of the first fall, some seconds after it was suspected, as `live` writes it.
fn add_fall(store: &mut Store, kind: EventKind, suspected_ms: i64, dwell_s: f64, ack: bool) {
    let mut data = serde_json::json!({ "fall": 1, "dwell_s": dwell_s, "place_m": [0.5, 2.0] });
    if ack {
        data["acknowledged"] = true.into();
    }
    let fall = Event {
        data: Some(data),
        ..event(suspected_ms + (1e3 * dwell_s) as i64, kind)
    };
    store.write(|b| b.insert_event(&fall, &origin())).unwrap();
}

#[test]
fn nothing_is_denied_of_a_time_in_which_nobody_watched() {
    let (_dir, mut store) = new_store();
    // From 13:38 to 14:38.
    watch(&mut store, ago(300), ago(240));
    add_events(
        &mut store,
        &[
            (ago(290), EventKind::Present),
            (ago(241), EventKind::Absent),
        ],
    );
    let ended = "Nothing is known of that time: `live` ended at 14:38 today.";
    check(
        &store,
        &[
            (
                "is anybody there?",
                "Nobody was there at 14:38 today. Nothing is known of the time since: `live` does not run.",
            ),
            ("was anybody there in the last hour?", ended),
            ("did she fall in the last hour?", ended),
            ("how often did she get up in the last 2 minutes?", ended),
            ("what happened in the last hour?", ended),
            (
                "did she fall yesterday?",
                "Nothing is known of that time: the memory begins at 13:38 today.",
            ),
            (
                "did she fall today?",
                "No: nobody was seen to fall today, as far as is known: from 13:38 to 14:38 today.",
            ),
            (
                "how often did she get up since 14:00?",
                "Nobody was seen to get up since 14:00 today, as far as is known: from 14:00 to 14:38 today.",
            ),
            (
                "did anybody come in since 14:00?",
                "No: nobody came since 14:00 today, as far as is known: from 14:00 to 14:38 today.",
            ),
            (
                "is the radar working?",
                "The radar is not watched: `live` ended at 14:38 today.",
            ),
        ],
    );
    let answer = ask(store.timeline(), "did she fall today?", CLOCK).unwrap();
    let range = Stretch {
        start_ms: ago(300),
        end_ms: ago(240),
    };
    assert_eq!(answer.known, [range]);
}

#[test]
fn presence_ends_with_the_run_that_saw_it() {
    let (_dir, mut store) = new_store();
    watch(&mut store, ago(300), ago(290));
    watch(&mut store, ago(60), ago(50));
    add_events(
        &mut store,
        &[
            (ago(299), EventKind::Present),
            (ago(59), EventKind::Present),
        ],
    );
    let stretches = "from 13:38 to 13:48 today and from 17:38 to 17:48 today.";
    let in_all = "in all, in 2 stretches, the longest of";
    check(
        &store,
        &[
            (
                "is anybody there?",
                "Somebody was there until 17:48 today. Nothing is known of the time since: `live` does not run.",
            ),
            (
                "how long was she there?",
                &format!(
                    "Somebody was there for 18 min {in_all} 9 min. Known of that time: {stretches}"
                ),
            ),
            (
                "how long was the room empty?",
                &format!(
                    "The room was empty for 2 min {in_all} 1 min. Known of that time: {stretches}"
                ),
            ),
            (
                "when did she leave?",
                &format!("Nobody left, as far as is known: {stretches}"),
            ),
        ],
    );
    // A program that was killed.
    let (_dir, mut store) = new_store();
    let killed = Run {
        start_ms: ago(60),
        end_ms: ago(10),
        is_over: false,
    };
    store.write(|b| b.write_run(None, &killed)).unwrap();
    add_events(&mut store, &[(ago(50), EventKind::Present)]);
    check(
        &store,
        &[(
            "is anybody there?",
            "Somebody was there until 18:28 today. \
             Nothing is known of the time since: the last sign of life of `live` was at 18:28 today.",
        )],
    );
}

#[test]
fn a_silent_radar_is_neither_an_empty_room_nor_a_full_one() {
    let (_dir, mut store) = new_store();
    watch(&mut store, ago(60), NOW_MS);
    add_events(
        &mut store,
        &[
            (ago(50), EventKind::Present),
            (ago(10), EventKind::Absent),
            (ago(10), EventKind::SourceLost),
        ],
    );
    check(
        &store,
        &[
            (
                "is anybody there?",
                "Whether somebody is there is not known: the radar is silent since 18:28 today. \
                 Somebody was there until 18:28 today.",
            ),
            (
                "when did she leave?",
                "Nobody left, as far as is known: from 17:38 to 18:28 today.",
            ),
            (
                "how long was the room empty?",
                "The room was empty for 10 min, from 17:38 to 17:48 today. \
                 Known of that time: from 17:38 to 18:28 today.",
            ),
            (
                "was anybody there in the last 5 minutes?",
                "Nothing is known of that time: the radar was silent.",
            ),
            (
                "is the radar working?",
                "The radar is silent since 18:28 today.",
            ),
        ],
    );
    add_events(
        &mut store,
        &[
            (ago(5), EventKind::SourceBack),
            (ago(5) + 2_000, EventKind::Present),
        ],
    );
    check(
        &store,
        &[
            (
                "is anybody there?",
                "Somebody is there, since 18:33 today (4 min 58 s).",
            ),
            // Whoever is detected at once was there before.
            (
                "when did she come in?",
                "Somebody came once, at 17:48 today. \
                 Known of that time: from 17:38 to 18:28 today and from 18:33 to 18:38 today.",
            ),
            (
                "is the radar working?",
                "The radar works: `live` runs since 17:38 today, and frames arrive.",
            ),
        ],
    );
}

#[test]
fn a_radar_that_was_never_heard_tells_nothing() {
    let (_dir, mut store) = new_store();
    watch(&mut store, ago(60), NOW_MS);
    add_events(&mut store, &[(ago(60), EventKind::SourceLost)]);
    check(
        &store,
        &[
            (
                "is anybody there?",
                "Whether somebody is there is not known: the radar is silent since 17:38 today.",
            ),
            ("did she fall?", "Nothing is known: the radar was silent."),
        ],
    );
}

#[test]
fn an_empty_room_has_time_while_it_is_watched() {
    let (_dir, mut store) = new_store();
    // The last sign of life was 20 s ago.
    let run = Run {
        start_ms: ago(60),
        end_ms: NOW_MS - 20_000,
        is_over: false,
    };
    store.write(|b| b.write_run(None, &run)).unwrap();
    check(
        &store,
        &[
            ("is anybody there?", "Nobody is there, and nobody was seen."),
            (
                "was anybody there in the last 10 minutes?",
                "No: nobody was there in the last 10 minutes.",
            ),
            (
                "how long was the room empty in the last 10 minutes?",
                "The room was empty for 10 min in the last 10 minutes, from 18:28 to 18:38 today.",
            ),
        ],
    );
    // Somebody stands there without another entry.
    add_events(&mut store, &[(ago(3), EventKind::Present)]);
    check(
        &store,
        &[(
            "how long was somebody there in the last 10 minutes?",
            "Somebody was there for 3 min in the last 10 minutes, from 18:35 to 18:38 today.",
        )],
    );
}

#[test]
fn a_suspicion_is_no_fall_and_is_not_denied() {
    let (_dir, mut store) = new_store();
    watch(&mut store, ago(60), NOW_MS);
    let fall = activity(ago(1) - 2_000, ago(1) + 4_000, "fall", "a person falls");
    add(&mut store, &[fall]);
    add_fall(&mut store, EventKind::Suspected, ago(1), 0.0, false);
    let suspected = "A fall is suspected since 18:37 today, and not confirmed.";
    check(
        &store,
        &[
            ("did she fall in the last hour?", suspected),
            ("how often did she fall in the last hour?", suspected),
            ("did she get up after she fell?", suspected),
            (
                "is anybody there?",
                &format!("Nobody is there, and nobody was seen. {suspected}"),
            ),
        ],
    );
    // A viewer said that it is none.
    add_fall(&mut store, EventKind::Dismissed, ago(1), 30.0, true);
    let dismissed = "A suspected fall at 18:37 today was dismissed as no fall.";
    check(
        &store,
        &[
            (
                "did she fall in the last hour?",
                &format!("No: nobody was seen to fall in the last hour. {dismissed}"),
            ),
            (
                "was there a false alarm in the last hour?",
                &format!("{dismissed} No: nobody was seen to fall in the last hour."),
            ),
            ("is anybody there?", "Nobody is there, and nobody was seen."),
        ],
    );
    let answer = ask(store.timeline(), "did she fall in the last hour?", CLOCK).unwrap();
    assert_eq!((answer.count, answer.rows.len()), (0, 0));
}

#[test]
fn whoever_rises_after_a_fall_got_up_and_lay_on_the_floor() {
    let (_dir, mut store) = new_store();
    watch(&mut store, ago(60), NOW_MS);
    // At 18:18:12.
    add_fall(&mut store, EventKind::Suspected, ago(20), 0.0, false);
    add_fall(&mut store, EventKind::Confirmed, ago(20), 20.0, false);
    check(
        &store,
        &[
            (
                "did she get up in the last hour?",
                "No: nobody was seen to get up in the last hour.",
            ),
            (
                "is she on the floor?",
                "Nobody is there, and nobody was seen. Whoever fell at 18:18 today was not seen to get up.",
            ),
            (
                "how long did she lie on the floor in the last hour?",
                "After a fall, someone lay on the floor for 20 min in the last hour, from 18:18 to 18:38 today.",
            ),
        ],
    );
    add_fall(&mut store, EventKind::Recovered, ago(20), 91.8, false);
    let fell = "Someone fell once in the last hour, at 18:18 today. The fall alarm was confirmed once. \
                Whoever fell at 18:18 today got up at 18:19 today, after 1 min 32 s.";
    check(
        &store,
        &[
            (
                "did she get up in the last hour?",
                "Yes: someone got up once in the last hour, at 18:19 today.",
            ),
            (
                "how long did she lie on the floor in the last hour?",
                "After a fall, someone lay on the floor for 1 min 32 s in the last hour, from 18:18 to 18:19 today.",
            ),
            ("how often did she fall in the last hour?", fell),
            (
                "did she fall in the last hour?",
                &fell.replace("Someone", "Yes: someone"),
            ),
        ],
    );
    let after = says(&store, "did she get up after she fell in the last hour?");
    assert!(after.starts_with("Yes, at 18:19 today."), "{after}");
    // A sentence about the same rising does not count again.
    let rising = activity(
        ago(20) + 88_000,
        ago(20) + 92_000,
        "stand_up",
        "a person gets up",
    );
    add(&mut store, &[rising]);
    let answer = ask(store.timeline(), "did she get up in the last hour?", CLOCK).unwrap();
    assert_eq!(answer.count, 1);
}

#[test]
fn a_fall_before_the_time_that_is_asked_about_is_told_while_it_is_open() {
    let (_dir, mut store) = new_store();
    watch(&mut store, ago(60), NOW_MS);
    // It was confirmed within the last 20 minutes.
    let suspected_ms = ago(20) - 10_000;
    add_fall(&mut store, EventKind::Suspected, suspected_ms, 0.0, false);
    add_fall(&mut store, EventKind::Confirmed, suspected_ms, 20.0, false);
    check(
        &store,
        &[
            (
                "did she fall in the last 20 minutes?",
                "Yes: someone fell once in the last 20 minutes, at 18:18 today. \
                 The fall alarm was confirmed once. Whoever fell at 18:18 today was not seen to get up.",
            ),
            (
                "did she fall in the last 10 minutes?",
                "No: nobody was seen to fall in the last 10 minutes. \
                 Whoever fell at 18:18 today was not seen to get up.",
            ),
            (
                "did she fall yesterday?",
                "Nothing is known of that time: the memory begins at 17:38 today.",
            ),
        ],
    );
    add_fall(&mut store, EventKind::Recovered, suspected_ms, 60.0, true);
    check(
        &store,
        &[(
            "did she fall in the last 10 minutes?",
            "No: nobody was seen to fall in the last 10 minutes.",
        )],
    );
}

#[test]
fn activities_that_were_deleted_are_not_denied() {
    let (_dir, mut store) = new_store();
    watch(&mut store, NOW_MS - 40 * DAY_MS, NOW_MS);
    store
        .prune(NOW_MS, &crate::store::Retention::default())
        .unwrap();
    check(
        &store,
        &[
            (
                "did she get up on 2026-10-20?",
                "Nothing is known of that time: what was kept of it was deleted.",
            ),
            (
                "did she fall on 2026-10-20?",
                "No: nobody was seen to fall on Tuesday, 2026-10-20.",
            ),
        ],
    );
}

#[test]
fn what_is_so_at_present_is_told_from_the_newest_sentence() {
    let (_dir, mut store) = new_store();
    watch(&mut store, ago(60), NOW_MS);
    add_events(&mut store, &[(ago(50), EventKind::Present)]);
    let sits = |from_ms, to_ms| activity(from_ms, to_ms, "sit_still", "a person sits");
    add(
        &mut store,
        &[
            sits(ago(40), ago(30)),
            activity(ago(30), ago(20), "walk", "a person walks"),
            sits(ago(20), ago(10)),
            sits(ago(10) + 20_000, NOW_MS - 5_000),
        ],
    );
    let there = "Somebody is there, since 17:48 today (50 min). \
                 The newest sentence is \u{201c}a person sits\u{201d}, from 18:28 to 18:38 today.";
    let since = "Yes: somebody has been seen to sit since 18:18 today (20 min).";
    check(
        &store,
        &[
            ("what is she doing?", there),
            ("where is she?", there),
            ("where was she last seen?", there),
            ("is she ok?", &format!("No fall is suspected. {there}")),
            ("how is she?", &format!("No fall is suspected. {there}")),
            ("is she sitting?", &format!("{since} {there}")),
            ("is she still sitting now?", &format!("{since} {there}")),
            (
                "how long has she been sitting?",
                &format!("{since} {there}"),
            ),
            (
                "has she been sitting for long?",
                &format!("{since} {there}"),
            ),
            (
                "is she walking?",
                &format!("Nobody is seen to walk at present. {there}"),
            ),
            (
                "how many people are there?",
                &format!("How many people are or were there is not remembered. {there}"),
            ),
        ],
    );
    // Somebody who may have left since.
    add_events(&mut store, &[(ago(0) - 1_000, EventKind::Absent)]);
    let nobody = says(&store, "is she sitting?");
    let expected = "Nobody is there, since 18:38 today (1 s). The newest sentence is";
    assert!(nobody.starts_with(expected), "{nobody}");
    // Nobody watches.
    let (_dir, mut store) = new_store();
    watch(&mut store, ago(60), ago(50));
    let unknown = says(&store, "is she sitting?");
    let expected =
        "Whether somebody is seen to sit at present is not known. Nobody was there at 17:48 today.";
    assert!(unknown.starts_with(expected), "{unknown}");
}

#[test]
fn at_present_everybody_counts_and_other_postures_end_a_stretch() {
    let (_dir, mut store) = new_store();
    watch(&mut store, ago(60), NOW_MS);
    add_events(&mut store, &[(ago(50), EventKind::Present)]);
    let of = |person, from_ms, to_ms, action: &str, text: &str| Activity {
        person,
        ..activity(from_ms, to_ms, action, text)
    };
    let walks = |from_ms, to_ms| of(1, from_ms, to_ms, "walk", "a person walks");
    let second = 1_000;
    add(
        &mut store,
        &[
            walks(ago(5), ago(4)),
            of(
                1,
                ago(4) - second,
                ago(4) + second,
                "sit_down",
                "a person sits down",
            ),
            of(
                1,
                ago(4),
                ago(4) + 20 * second,
                "sit_still",
                "a person sits",
            ),
            walks(ago(4) + 20 * second, NOW_MS),
            of(
                2,
                ago(2) - second,
                ago(2) + second,
                "lie_down",
                "a person lies down",
            ),
            of(2, ago(2), NOW_MS - 4 * second, "lie_still", "a person lies"),
        ],
    );
    for (question, expected) in [
        (
            "is she lying?",
            "Yes: somebody has been seen to lie since 18:36 today (1 min 57 s).",
        ),
        // Not since before the person sat.
        (
            "is she walking?",
            "Yes: somebody has been seen to walk since 18:34 today (3 min 40 s).",
        ),
        ("is she sitting?", "Nobody is seen to sit at present."),
        // The change to a posture is a part of it.
        ("how often did she lie?", "Someone lay once"),
        ("how often did she sit?", "Someone sat once"),
    ] {
        let found = says(&store, question);
        assert!(found.starts_with(expected), "{question} {found}");
    }
}

#[test]
fn a_time_is_told_in_outline() {
    let (_dir, mut store) = new_store();
    watch(&mut store, ago(60), NOW_MS);
    add_events(
        &mut store,
        &[(ago(50), EventKind::Present), (ago(20), EventKind::Absent)],
    );
    let rising = activity(ago(40), ago(40) + 4_000, "stand_up", "a person gets up");
    add(&mut store, &[rising]);
    let outline = "Somebody was there for 30 min in the last hour, from 17:48 to 18:18 today. \
                   Somebody came once in the last hour, at 17:48 today. \
                   Somebody left once in the last hour, at 18:18 today. \
                   Nobody was seen to fall in the last hour. \
                   Someone got up once in the last hour, at 17:58 today.";
    check(
        &store,
        &[
            ("what happened in the last hour?", outline),
            ("what did she do in the last hour?", outline),
            ("was there any movement in the last hour?", outline),
            (
                "anything unusual in the last hour?",
                &format!("{outline} What is usual is not known."),
            ),
        ],
    );
    let bed = says(&store, "did somebody fall out of bed in the last hour?");
    assert!(
        bed.starts_with("Whether somebody fell out of bed cannot be told"),
        "{bed}"
    );
}

#[test]
fn a_refusal_says_what_can_be_asked_and_which_times_are_known() {
    let (_dir, mut store) = new_store();
    watch(&mut store, ago(60), NOW_MS);
    for question in [
        "did she get up more often than yesterday?",
        "did she get up and walk today?",
        "how high is the ceiling?",
    ] {
        let answer = ask(store.timeline(), question, CLOCK).unwrap();
        assert_eq!(answer.understood, None, "{question}");
        for part in [
            "The question was not understood: ",
            "Understood are questions such as",
            "Known times are",
        ] {
            assert!(answer.answer.contains(part), "{}", answer.answer);
        }
        assert!(!answer.answer.contains("No sentence"), "{}", answer.answer);
    }
}
