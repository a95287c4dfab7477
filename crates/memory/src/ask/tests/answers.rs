//! Answers from a memory.

use super::*;

/// A local time today, milliseconds since 1970 in UTC.
fn today(hour: i64, minute: i64) -> i64 {
    (NOW_MS + HOUR_MS).div_euclid(DAY_MS) * DAY_MS - HOUR_MS + hour * HOUR_MS + minute * MINUTE_MS
}

fn some_memory() -> (tempfile::TempDir, Store) {
    let (dir, mut store) = new_store();
    let row = |start_ms, seconds: i64, action, caption| {
        activity(start_ms, start_ms + seconds * 1_000, action, caption)
    };
    let yesterday = |hour, minute| today(hour, minute) - DAY_MS;
    add(
        &mut store,
        &[
            row(
                yesterday(9, 0),
                600,
                "sit_still",
                "a person sits on a chair",
            ),
            row(
                yesterday(23, 40),
                4,
                "stand_up",
                "a person stands up from lying on the floor",
            ),
            row(today(6, 50), 4, "stand_up", "a person gets up"),
            row(today(7, 12), 4, "stand_up", "a person gets up"),
            row(today(8, 0), 1_800, "sit_still", "a person sits on a chair"),
            row(today(9, 0), 5, "sit_down", "a person sits down on the sofa"),
            row(today(12, 0), 60, "walk", "a person walks with a cane"),
            row(today(14, 2), 3, "fall", "a person falls to the ground"),
        ],
    );
    watch(&mut store, yesterday(9, 0), NOW_MS);
    (dir, store)
}

fn says(store: &Store, question: &str) -> String {
    let answer = ask(store.timeline(), question, CLOCK).unwrap();
    assert!(answer.understood.is_some(), "{question}: {}", answer.answer);
    let end = " Nobody is identified: this is about whoever was there.";
    let (text, rest) = answer.answer.split_once(end).expect("nobody is identified");
    assert!(
        rest.is_empty() || rest == " This is not a medical device.",
        "{rest}"
    );
    text.to_string()
}

#[test]
fn answers_are_sentences() {
    let (_dir, store) = some_memory();
    let known = "from 09:00 yesterday to 00:00 today.";
    for (question, expected) in [
        ("when did she last get up today?", "Someone last got up at 07:12 today, twice in all today.".to_string()),
        ("when did she first get up?", "Someone first got up at 23:40 yesterday, 3 times in all.".into()),
        ("when did she get up today", "Someone got up twice today: at 06:50 today and 07:12 today.".into()),
        ("how often did she get up yesterday", format!("Someone got up once yesterday, at 23:40 yesterday. Known of that time: {known}")),
        ("did she get up today", "Yes: someone got up twice today, last at 07:12 today.".into()),
        ("did she get up since 10:00", "No: nobody was seen to get up since 10:00 today.".into()),
        ("how long did she sit today", "Someone sat for 30 min in all today, in 2 stretches, the longest of 30 min.".into()),
        ("how long did she sit since 08:20", "Someone sat for 10 min in all since 08:20 today, in 2 stretches, the longest of 10 min.".into()),
        ("did grandma jump or walk today", "Yes: someone jumped or walked once today, at 12:00 today. Not considered: \u{201c}grandma\u{201d}.".into()),
        ("when did she last fall", "Someone fell once, at 14:02 today.".into()),
        ("did she fall on Sunday", format!("No: nobody was seen to fall yesterday, as far as is known: {known}")),
    ] {
        assert_eq!(says(&store, question), expected, "{question}");
    }
    let answer = ask(store.timeline(), "when did she get up today", CLOCK).unwrap();
    let starts: Vec<i64> = answer.rows.iter().map(|r| r.activity.start_ms).collect();
    assert_eq!(starts, [today(6, 50), today(7, 12)]);
    assert_eq!(
        (answer.count, answer.first_ms, answer.last_ms),
        (2, Some(today(6, 50)), Some(today(7, 12)))
    );
    let json = serde_json::to_value(&answer).unwrap();
    assert_eq!(json["understood"]["what"]["kind"], "when");
    assert_eq!(json["understood"]["what"]["actions"][0], "stand_up");
    assert_eq!(json["understood"]["when"]["phrase"], "today");
    assert_eq!(json["rows"][0]["caption"], "a person gets up");
    assert_eq!(serde_json::from_value::<Answer>(json).unwrap(), answer);
    let (_dir, empty) = new_store();
    let expected = "Nothing is known of that time: the memory is empty.";
    assert_eq!(says(&empty, "how often did she get up today"), expected);
}

#[test]
fn a_fall_counts_once_whether_a_sentence_or_an_alarm_or_both_know_it() {
    let (_dir, mut store) = some_memory();
    let alarms = [
        // The one of the sentence at 14:02, and two that no sentence states.
        event(today(14, 2) + 21_000, EventKind::Confirmed),
        event(today(15, 30), EventKind::Confirmed),
        event(today(16, 45), EventKind::Confirmed),
        event(today(17, 0), EventKind::Dismissed),
    ];
    let write = |b: &Batch<'_>| {
        alarms
            .iter()
            .try_for_each(|e| b.insert_event(e, &origin()).map(drop))
    };
    store.write(write).unwrap();
    assert_eq!(
        says(&store, "when did she last fall today"),
        "Someone last fell at 16:45 today, 3 times in all today. The fall alarm was confirmed 3 times. \
         Whoever fell at 16:45 today was not seen to get up."
    );
    assert_eq!(
        says(&store, "when did she fall today"),
        "Someone fell 3 times today: at 14:02 today, 15:30 today and 16:45 today. The fall alarm was confirmed 3 times. \
         Whoever fell at 16:45 today was not seen to get up."
    );
    let answer = ask(store.timeline(), "did she fall since 15:00", CLOCK).unwrap();
    assert_eq!(
        (answer.count, answer.rows.len(), answer.events.len()),
        (2, 0, 2)
    );
    let answer = ask(store.timeline(), "did she get up today", CLOCK).unwrap();
    assert!(answer.events.is_empty() && !answer.answer.contains("medical"));
}

#[test]
fn what_is_not_understood_is_searched() {
    let (_dir, mut store) = some_memory();
    let searched = |store: &Store, q: &str| {
        let answer = ask(store.timeline(), q, CLOCK).unwrap();
        assert_eq!(answer.understood, None, "{q}");
        assert!(
            answer
                .answer
                .starts_with("The question was not understood: "),
            "{}",
            answer.answer
        );
        answer
    };
    let answer = searched(&store, "was the cane there today?");
    assert_eq!(answer.count, 1);
    assert_eq!(answer.rows[0].activity.action, "walk");
    assert!(
        answer
            .answer
            .contains("One sentence today has \u{201c}cane\u{201d}, of 12:00 today."),
        "{}",
        answer.answer
    );
    let answer = searched(&store, "chairs");
    assert_eq!(
        (answer.count, answer.searched.unwrap().words),
        (2, vec!["chairs".to_string()])
    );
    assert_eq!(searched(&store, "cane yesterday").count, 0);
    for question in ["", "???", "when", "\" OR 1=1 --", "caption:*"] {
        searched(&store, question);
    }
    // Simulated rows say so.
    let synthetic = Origin {
        synthetic: true,
        ..origin()
    };
    let row: Activity = activity(
        today(13, 0),
        today(13, 1),
        "dance",
        "a person dances with a hat",
    );
    store
        .write(|b| b.insert_activity(&row, &synthetic))
        .unwrap();
    for question in ["a hat", "did she dance"] {
        let answer = ask(store.timeline(), question, CLOCK).unwrap();
        assert!(
            answer.synthetic && answer.answer.contains("The radar was simulated."),
            "{}",
            answer.answer
        );
    }
}

#[test]
fn long_questions_are_refused_and_long_answers_bounded() {
    let (_dir, mut store) = new_store();
    let error = ask(store.timeline(), &"a".repeat(MAX_QUESTION_BYTES + 1), CLOCK).unwrap_err();
    assert!(
        matches!(
            error,
            StoreError::Invalid {
                field: "question",
                ..
            }
        ),
        "{error}"
    );
    let rows: Vec<Activity> = (0..120)
        .map(|i| NOW_MS - 50 * (i + 1))
        .map(|at_ms| activity(at_ms, at_ms + 20, "walk", "a person walks"))
        .collect();
    add(&mut store, &rows);
    let answer = ask(store.timeline(), "when did she walk", CLOCK).unwrap();
    assert_eq!((answer.count, answer.rows.len()), (120, MAX_ROWS));
    assert!(
        answer
            .answer
            .starts_with("Someone walked 120 times, first at 18:38 today and last at"),
        "{}",
        answer.answer
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn any_question_is_answered(text in "\\PC{0,80}", bytes in prop::collection::vec(any::<u8>(), 0..80)) {
        let (_dir, store) = some_memory();
        for question in [text, String::from_utf8_lossy(&bytes).into_owned()] {
            let answer = ask(store.timeline(), &question, CLOCK);
            prop_assert!(answer.is_ok(), "{answer:?}");
        }
    }
}
