//! Questions and their meaning, and answers from a memory.

use proptest::prelude::*;
use radarllm_base::civil::{self, DAY_MS, HOUR_MS, MINUTE_MS};
use radarllm_monitor::rows::{Activity, Origin};

use super::words::split;
use super::*;
use crate::store::tests::{NOW_MS, activity, add, add_events, event, new_store, origin, watch};
use crate::store::{Batch, Store};

/// Monday, 2026-11-23, 18:38:12, an hour east of UTC.
const CLOCK: Clock = Clock {
    now_ms: NOW_MS,
    offset_s: 3_600,
};

mod answers;
mod meaning;
mod unknown;

/// Local time of a range: `2026-11-23 00:00 to now`.
fn range(when: &When) -> String {
    let local = |ms: i64| {
        let local_ms = ms + HOUR_MS;
        format!(
            "{} {}",
            civil::date_text(local_ms.div_euclid(DAY_MS)),
            CLOCK.time_of_day(ms)
        )
    };
    let to = match when.to_ms {
        NOW_MS => "now".to_string(),
        ms => local(ms),
    };
    match when.from_ms {
        None => format!("always to {to}"),
        Some(ms) => format!("{} to {to}", local(ms)),
    }
}

#[test]
fn words_that_were_not_considered_are_named() {
    let ignored = |q: &str| what::understand(q, &CLOCK).unwrap().ignored;
    assert_eq!(
        ignored("When did Anna last slowly get up in the kitchen?"),
        ["anna", "slowly", "kitchen"]
    );
    assert_eq!(ignored("did she wave with the left hand"), ["left", "hand"]);
    // When somebody fell is told, and not where or how.
    assert_eq!(ignored("where did she fall?"), ["where"]);
    assert_eq!(ignored("who fell last night?"), ["who"]);
}

#[test]
fn the_local_time_decides_what_today_is() {
    // 23:30 UTC on Sunday is Monday an hour east and still Sunday an hour west.
    let now_ms = NOW_MS.div_euclid(DAY_MS) * DAY_MS - 30 * MINUTE_MS;
    let today = |offset_s| {
        what::understand("did she fall today", &Clock { now_ms, offset_s })
            .unwrap()
            .when
    };
    assert_eq!(today(3_600).from_ms, Some(now_ms - 30 * MINUTE_MS));
    assert_eq!(
        today(-3_600).from_ms,
        Some(now_ms - 22 * HOUR_MS - 30 * MINUTE_MS)
    );
    for clock in [
        Clock {
            now_ms: -1,
            offset_s: 0,
        },
        Clock {
            now_ms: i64::MAX,
            offset_s: 0,
        },
        Clock {
            now_ms: 0,
            offset_s: i32::MIN,
        },
    ] {
        let (_dir, store) = new_store();
        let error = ask(store.timeline(), "did she fall", clock).unwrap_err();
        assert!(matches!(error, StoreError::Invalid { .. }), "{error}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2_000))]

    #[test]
    fn any_bytes_have_a_meaning_or_none(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        let text = String::from_utf8_lossy(&bytes).into_owned();
        let _ = what::understand(&text, &CLOCK);
        let _ = split(&text);
    }

    #[test]
    fn any_words_have_a_meaning_or_none(
        picked in prop::collection::vec(prop::sample::select(VOCABULARY), 0..12),
        now_ms in 0i64..=crate::store::limits::MAX_TIME_MS,
        offset_s in -86_400i32..=86_400,
    ) {
        let clock = Clock { now_ms, offset_s };
        if let Ok(understood) = what::understand(&picked.join(" "), &clock) {
            prop_assert!(!understood.what.actions.is_empty() && understood.what.n_asked > 0);
            prop_assert!(understood.when.to_ms <= now_ms);
            prop_assert!(understood.when.from_ms.is_none_or(|from_ms| from_ms < understood.when.to_ms));
        }
    }
}

const VOCABULARY: &[&str] = &[
    "when",
    "did",
    "she",
    "last",
    "first",
    "how",
    "often",
    "long",
    "get",
    "up",
    "fall",
    "fell",
    "walk",
    "or",
    "today",
    "yesterday",
    "since",
    "7",
    "07:30",
    "pm",
    "on",
    "monday",
    "2026-11-20",
    "in",
    "the",
    "past",
    "3",
    "hours",
    "week",
    "night",
    "morning",
    "this",
    "tonight",
    "9999-12-31",
    "10000",
    "sit",
    "down",
    "not",
    "ago",
    "midnight",
];
