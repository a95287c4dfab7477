//! Falls: what the events of an alarm, and the sentences about it, say together.

use radarllm_monitor::rows::{Activity, EventKind, EventRow};

use super::Timeline;
use super::timeline::{ActivityQuery, Order};
use crate::error::StoreError;

/// The action of which alarms speak as well.
pub(crate) const FALL: &str = "fall";
/// Time around a range in which events of its falls are looked for, ms: falls that were suspected before, and what became
/// of those that were suspected in it.
const AROUND_MS: i64 = 86_400_000;
/// Longest time from a fall that a sentence states to an alarm of which nobody knows when it was suspected, ms.
const ALARM_DELAY_MS: i64 = 120_000;
/// Longest time between a sentence and the suspicion of the same fall, ms: that of several windows.
const SENTENCE_MS: i64 = 30_000;
/// Longest time from the end of a fall to the beginning of a sentence that still tells it, ms: the length of a window.
const WINDOW_MS: i64 = 6_000;
/// Most sentences about falls that are looked at; earlier ones are left out.
const MAX_SENTENCES: usize = 10_000;

/// A fall, or the suspicion of one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Fall {
    /// When it happened, milliseconds since 1970 in UTC: when it was suspected, or when a sentence tells it.
    pub at_ms: i64,
    /// When it was suspected, as far as that is known.
    pub suspected_ms: Option<i64>,
    /// When the alarm was confirmed.
    pub confirmed_ms: Option<i64>,
    /// How it ended.
    pub end: Option<FallEnd>,
    /// Whether a sentence tells it.
    pub is_reported: bool,
    /// Whether the radar was simulated.
    pub synthetic: bool,
}

/// The end of a fall.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct FallEnd {
    /// When, milliseconds since 1970 in UTC.
    pub at_ms: i64,
    /// Whether a user ended it; otherwise the person rose.
    pub is_acknowledged: bool,
    /// Whether it was dismissed: nobody fell.
    pub is_dismissed: bool,
}

impl Fall {
    /// Whether it was suspected and is neither confirmed nor ended.
    pub(crate) fn is_suspicion(&self) -> bool {
        self.suspected_ms.is_some() && self.confirmed_ms.is_none() && self.end.is_none()
    }

    /// Whether it happened, was suspected or was confirmed in a range of time. A sentence was found by its overlap with one.
    pub(crate) fn is_of(&self, [from_ms, to_ms]: [i64; 2]) -> bool {
        let alarm = [self.suspected_ms, self.confirmed_ms];
        let mut times = alarm.into_iter().flatten().chain([self.at_ms]);
        alarm == [None, None] || times.any(|ms| (from_ms..to_ms).contains(&ms))
    }

    /// Whether an alarm about it has not ended.
    pub(crate) fn is_open(&self) -> bool {
        self.end.is_none() && (self.suspected_ms.is_some() || self.confirmed_ms.is_some())
    }

    /// Whether it was suspected and turned out to be none.
    pub(crate) fn is_dismissed(&self) -> bool {
        self.end.is_some_and(|end| end.is_dismissed)
    }

    /// When the person rose, if that was seen.
    pub(crate) fn risen_ms(&self) -> Option<i64> {
        let end = self
            .end
            .filter(|end| !end.is_acknowledged && !end.is_dismissed)?;
        Some(end.at_ms)
    }

    /// Whether a sentence about a fall is about this one.
    fn is_reported_by(&self, activity: &Activity) -> bool {
        let (first_ms, last_ms) = match (self.suspected_ms, self.confirmed_ms) {
            (None, Some(confirmed_ms)) => (confirmed_ms - ALARM_DELAY_MS, confirmed_ms),
            _ => (self.at_ms - SENTENCE_MS, self.at_ms + SENTENCE_MS),
        };
        let ended_ms = self
            .end
            .map_or(last_ms, |end| end.at_ms.min(last_ms + SENTENCE_MS));
        activity.end_ms >= first_ms && activity.start_ms <= last_ms.max(ended_ms + WINDOW_MS)
    }
}

impl Timeline {
    /// Falls and suspicions of a range of time, and those of the day before whose end is in it, in order of time.
    pub(crate) fn falls(&self, [from_ms, to_ms]: [i64; 2]) -> Result<Vec<Fall>, StoreError> {
        let around_ms = [
            from_ms.saturating_sub(AROUND_MS),
            to_ms.saturating_add(AROUND_MS),
        ];
        let kinds = [
            EventKind::Suspected,
            EventKind::Confirmed,
            EventKind::Dismissed,
            EventKind::Recovered,
        ];
        let mut falls: Vec<(Option<u64>, Fall)> = Vec::new();
        for row in self.all_events(&kinds, around_ms)? {
            add_event(&mut falls, &row);
        }
        let mut falls: Vec<Fall> = falls.into_iter().map(|(_, fall)| fall).collect();
        let query = ActivityQuery {
            from_ms: Some(from_ms),
            to_ms: Some(to_ms),
            actions: vec![FALL.into()],
            ..ActivityQuery::default()
        };
        for row in self.some_activities(&query, Order::NewestFirst, MAX_SENTENCES)? {
            let (activity, synthetic) = (&row.activity, row.origin.synthetic);
            let reported = falls
                .iter_mut()
                .filter(|fall| fall.is_reported_by(activity));
            match reported.min_by_key(|fall| (fall.at_ms - activity.start_ms).abs()) {
                Some(fall) => {
                    fall.is_reported = true;
                    fall.synthetic |= synthetic;
                    fall.at_ms = fall.at_ms.min(activity.start_ms);
                }
                None => falls.push(Fall {
                    at_ms: activity.start_ms,
                    suspected_ms: None,
                    confirmed_ms: None,
                    end: None,
                    is_reported: true,
                    synthetic,
                }),
            }
        }
        let is_in = |at_ms: i64| (from_ms..to_ms).contains(&at_ms);
        falls.retain(|fall| {
            fall.is_of([from_ms, to_ms]) || fall.end.is_some_and(|end| is_in(end.at_ms))
        });
        falls.sort_by_key(|fall| fall.at_ms);
        Ok(falls)
    }
}

/// Adds what an event says about a fall. The numbers of falls begin anew with every run.
fn add_event(falls: &mut Vec<(Option<u64>, Fall)>, row: &EventRow) {
    let event = &row.event;
    let data = |key: &str| event.data.as_ref().and_then(|data| data.get(key));
    let number = data("fall").and_then(serde_json::Value::as_u64);
    let at_ms = event.at_ms;
    let open = falls
        .iter_mut()
        .rev()
        .find(|(other, fall)| number.is_some() && *other == number && fall.end.is_none());
    let open = match event.kind {
        EventKind::Suspected => None,
        _ => open.map(|(_, fall)| fall),
    };
    let dwell_ms = data("dwell_s")
        .and_then(serde_json::Value::as_f64)
        .filter(|dwell_s| (0.0..=1e6).contains(dwell_s))
        .map(|dwell_s| (1e3 * dwell_s).round() as i64);
    let suspected_ms = match event.kind {
        EventKind::Suspected => Some(at_ms),
        _ => dwell_ms.map(|dwell_ms| at_ms.saturating_sub(dwell_ms)),
    };
    let mut fall = open.as_deref().copied().unwrap_or(Fall {
        at_ms: suspected_ms.unwrap_or(at_ms),
        suspected_ms,
        confirmed_ms: None,
        end: None,
        is_reported: false,
        synthetic: row.origin.synthetic,
    });
    let is_acknowledged = data("acknowledged").and_then(serde_json::Value::as_bool) == Some(true);
    match event.kind {
        EventKind::Suspected => {}
        EventKind::Confirmed => fall.confirmed_ms = fall.confirmed_ms.or(Some(at_ms)),
        // The end of a fall of which nothing else is known.
        _ if open.is_none() && suspected_ms.is_none() => return,
        kind => {
            let is_dismissed = kind == EventKind::Dismissed;
            if !is_dismissed {
                fall.confirmed_ms = fall.confirmed_ms.or(Some(at_ms));
            }
            fall.end = Some(FallEnd {
                at_ms,
                is_acknowledged,
                is_dismissed,
            });
        }
    }
    match open {
        Some(open) => *open = fall,
        None => falls.push((number, fall)),
    }
}
