//! Selection and paging.

use super::*;

#[test]
fn queries_select_by_time_person_action_and_words() {
    let (_dir, mut store) = new_store();
    let t = NOW_MS;
    let mut rows = vec![
        activity(t, t + 10_000, "walk", "a person walks forward"),
        activity(
            t + 10_000,
            t + 20_000,
            "sit_down",
            "a person sits down slowly",
        ),
        activity(t + 20_000, t + 20_000, "fall", "a person falls"),
        activity(t + 30_000, t + 40_000, "walk", "a person walks backwards"),
    ];
    rows[3].person = 2;
    let [a, b, c, d] = add(&mut store, &rows)[..] else {
        panic!()
    };
    let timeline = store.timeline();
    let all = ActivityQuery::default;
    let between = |from, to| ActivityQuery {
        from_ms: from,
        to_ms: to,
        ..all()
    };
    let words = |text: &str| ActivityQuery {
        text: Some(text.into()),
        ..all()
    };
    let actions = |names: &[&str]| ActivityQuery {
        actions: names.iter().map(|n| n.to_string()).collect(),
        ..all()
    };
    for (query, expected) in [
        (all(), vec![d, c, b, a]),
        (between(Some(t + 10_000), None), vec![d, c, b]),
        (between(Some(t + 9_999), Some(t + 10_001)), vec![b, a]),
        (between(None, Some(t + 10_000)), vec![a]),
        // An activity without duration is at its time.
        (between(Some(t + 20_000), Some(t + 20_001)), vec![c]),
        (between(Some(t + 20_001), Some(t + 30_000)), vec![]),
        (
            ActivityQuery {
                person: Some(2),
                ..all()
            },
            vec![d],
        ),
        (actions(&["walk"]), vec![d, a]),
        (actions(&["fall", "sit_down", "'; --"]), vec![c, b]),
        (
            ActivityQuery {
                from_ms: Some(t + 25_000),
                ..actions(&["walk"])
            },
            vec![d],
        ),
        (words("WALKING"), vec![d, a]),
        (words("walk forwards"), vec![a]),
        (words("sit"), vec![b]),
        (words("\"sits\" OR falls"), vec![]),
        (words("*"), vec![]),
        (words(""), vec![]),
    ] {
        assert_eq!(ids(timeline, &query), expected, "{query:?}");
        let tally = timeline.tally(&query).unwrap();
        assert_eq!(tally.count, expected.len() as u64, "{query:?}");
    }
    let tally = timeline
        .tally(&between(Some(t + 5_000), Some(t + 31_000)))
        .unwrap();
    let expected = Tally {
        count: 4,
        first_ms: Some(t),
        last_ms: Some(t + 30_000),
        total_ms: 5_000 + 10_000 + 1_000,
        longest_ms: 10_000,
        synthetic: false,
    };
    assert_eq!(tally, expected);
    let many = ActivityQuery {
        actions: vec!["walk".into(); 33],
        ..all()
    };
    assert!(matches!(
        timeline.activities(&many, None, 1),
        Err(StoreError::Invalid { .. })
    ));
}

#[test]
fn two_activities_of_one_person_at_once_count_and_last_as_one() {
    let (_dir, mut store) = new_store();
    let at = |seconds: i64| NOW_MS + 1_000 * seconds;
    let walks = |from_s: i64, to_s: i64| activity(at(from_s), at(to_s), "walk", "a person walks");
    let paces = |from_s: i64, to_s: i64| activity(at(from_s), at(to_s), "pace", "a person paces");
    let other = |one: Activity| Activity {
        person: one.person + 1,
        ..one
    };
    // Within each other, across each other, apart; and of another person at the same time.
    let rows = [
        paces(0, 20),
        walks(5, 10),
        walks(12, 30),
        walks(40, 50),
        other(walks(0, 20)),
    ];
    add(&mut store, &rows);
    let query = ActivityQuery {
        actions: vec!["walk".into(), "pace".into()],
        ..ActivityQuery::default()
    };
    let tally = store.timeline().tally(&query).unwrap();
    assert_eq!((tally.count, tally.total_ms), (3, 30_000 + 10_000 + 20_000));
    assert_eq!(tally.longest_ms, 20_000);
}

#[test]
fn a_range_is_told_as_lanes() {
    use crate::store::lanes::{ActionStretch, FallAt, Stretch};

    let (_dir, mut store) = new_store();
    let at = |minutes: i64| NOW_MS + minutes * MINUTE_MS;
    let rows = [
        // Nearer to each other than a thousandth of the range, and not.
        activity(at(10), at(20) - 2, "walk", "a person walks"),
        activity(at(20), at(30), "walk", "a person walks"),
        activity(at(31), at(32), "walk", "a person walks"),
        activity(at(20), at(40), "sit_still", "a person sits"),
        // Before the range begins, and after it ends.
        activity(at(-10), at(2), "lie_still", "a person lies"),
        activity(at(95), at(200), "stand_still", "a person stands still"),
        activity(at(101), at(102), "wave", "a person waves"),
    ];
    add(&mut store, &rows);
    let events = [
        event(at(-20), EventKind::Present),
        event(at(40), EventKind::Absent),
        event(at(41), EventKind::SourceLost),
        event(at(43), EventKind::SourceBack),
        event(at(90), EventKind::Present),
        event(at(91), EventKind::Suspected),
        event(at(92), EventKind::Confirmed),
        event(at(120), EventKind::Absent),
    ];
    let write = |b: &Batch<'_>| {
        let written = events.iter().map(|e| b.insert_event(e, &origin()));
        written.collect::<Result<Vec<i64>, _>>()
    };
    store.write(write).unwrap();
    watch(&mut store, at(-30), at(98));
    let lanes = store.timeline().lanes(at(0), at(100)).unwrap();
    let stretch = |from: i64, to: i64| Stretch {
        start_ms: at(from),
        end_ms: at(to),
    };
    // Nothing is known of the time after the last sign of life.
    assert_eq!(lanes.presence, [stretch(0, 40), stretch(90, 98)]);
    assert_eq!(lanes.silence, [stretch(41, 43)]);
    let action = |name: &str, from, to| ActionStretch {
        action: name.into(),
        stretch: stretch(from, to),
    };
    assert_eq!(
        lanes.actions,
        [
            action("lie_still", 0, 2),
            action("walk", 10, 30),
            action("sit_still", 20, 40),
            action("walk", 31, 32),
            action("stand_still", 95, 100),
        ]
    );
    let fall = |minutes, is_confirmed| FallAt {
        at_ms: at(minutes),
        is_confirmed,
    };
    assert_eq!(lanes.falls, [fall(91, false), fall(92, true)]);
    assert!(!lanes.synthetic);
    for [from, to] in [[0, 0], [1, 0], [0, 33 * 24 * 60]] {
        let refused = store.timeline().lanes(at(from), at(to));
        assert!(matches!(refused, Err(StoreError::Invalid { .. })));
    }
    let extremes = store.timeline().lanes(i64::MIN, i64::MAX);
    assert!(matches!(extremes, Err(StoreError::Invalid { .. })));
}

#[test]
fn events_select_by_kind_time_and_person() {
    let (_dir, mut store) = new_store();
    let events = [
        event(NOW_MS, EventKind::Present),
        event(NOW_MS + 1, EventKind::Suspected),
        Event {
            person: None,
            ..event(NOW_MS + 2, EventKind::SourceLost)
        },
        event(NOW_MS + 3, EventKind::Confirmed),
    ];
    let write = |b: &Batch<'_>| {
        events
            .iter()
            .map(|e| b.insert_event(e, &origin()))
            .collect()
    };
    let ids: Vec<i64> = store.write(write).unwrap();
    let found = |query: &EventQuery| -> Vec<i64> {
        let page = store.timeline().events(query, None, 100).unwrap();
        page.rows.iter().map(|row| row.id).collect()
    };
    let all = EventQuery::default;
    assert_eq!(found(&all()), [ids[3], ids[2], ids[1], ids[0]]);
    let kinds = vec![
        EventKind::Confirmed,
        EventKind::Suspected,
        EventKind::Confirmed,
    ];
    assert_eq!(found(&EventQuery { kinds, ..all() }), [ids[3], ids[1]]);
    assert_eq!(
        found(&EventQuery {
            from_ms: Some(NOW_MS + 3),
            ..all()
        }),
        [ids[3]]
    );
    assert_eq!(
        found(&EventQuery {
            to_ms: Some(NOW_MS + 1),
            ..all()
        }),
        [ids[0]]
    );
    assert_eq!(
        found(&EventQuery {
            person: Some(2),
            ..all()
        }),
        NO_IDS
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn paging_returns_every_row_once(starts in prop::collection::vec(0i64..6, 0..40), limit in 1usize..9) {
        let (_dir, mut store) = new_store();
        let rows: Vec<Activity> = starts
            .iter()
            .map(|s| activity(NOW_MS + s, NOW_MS + s + 1, "walk", "a person walks"))
            .collect();
        let expected: BTreeSet<i64> = add(&mut store, &rows).into_iter().collect();
        let (mut seen, mut times, mut before) = (Vec::new(), Vec::new(), None);
        loop {
            let page = store.timeline().activities(&ActivityQuery::default(), before, limit).unwrap();
            prop_assert!(page.rows.len() <= limit);
            seen.extend(page.rows.iter().map(|row| row.id));
            times.extend(page.rows.iter().map(|row| row.activity.start_ms));
            // A page goes over the network as text.
            match page.next {
                Some(next) => before = Some(next.to_string().parse().unwrap()),
                None => break,
            }
        }
        prop_assert!(times.is_sorted_by(|a, b| a >= b));
        prop_assert_eq!(seen.len(), expected.len());
        prop_assert_eq!(seen.into_iter().collect::<BTreeSet<_>>(), expected);
    }

    #[test]
    fn any_text_is_searched_without_an_error(text in "\\PC{0,60}", bytes in prop::collection::vec(any::<u8>(), 0..60)) {
        let (_dir, mut store) = new_store();
        add(&mut store, &[activity(NOW_MS, NOW_MS, "walk", "a person walks")]);
        for text in [text, String::from_utf8_lossy(&bytes).into_owned()] {
            let query = ActivityQuery { text: Some(text), ..ActivityQuery::default() };
            prop_assert!(store.timeline().activities(&query, None, 10).is_ok());
            prop_assert!(store.timeline().tally(&query).is_ok());
        }
    }
}

#[test]
fn pages_are_bounded() {
    let (_dir, mut store) = new_store();
    let rows: Vec<Activity> = (0..600)
        .map(|i| activity(NOW_MS + i, NOW_MS + i, "walk", "a person walks"))
        .collect();
    add(&mut store, &rows);
    let page = store
        .timeline()
        .activities(&ActivityQuery::default(), None, usize::MAX)
        .unwrap();
    assert_eq!(page.rows.len(), 500);
    assert!(page.next.is_some());
    let none = store
        .timeline()
        .activities(&ActivityQuery::default(), None, 0)
        .unwrap();
    assert_eq!(none.rows.len(), 0);
}
