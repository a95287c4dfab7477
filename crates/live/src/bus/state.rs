//! What a late comer has to know.

use std::collections::BTreeMap;

use radarllm_monitor::messages::{
    About, At, Body, Fall, FallState, Health, Hello, Now, Presence, Stamp,
};
use radarllm_monitor::rows::ActivityRow;

/// How long a sentence is the newest one of somebody who says nothing new, ms.
const NOW_MS: i64 = 15_000;
/// Most people whose sentences are kept.
const MAX_PEOPLE: usize = 32;
/// Most falls that are kept.
const MAX_FALLS: usize = 32;
/// How long activities are kept, ms.
const ROWS_MS: i64 = 3_600_000;
/// Most activities that are kept.
const MAX_ROWS: usize = 500;

/// The state of everything. Its size is bounded.
#[derive(Debug)]
pub(super) struct State {
    about: About,
    now: Vec<(Stamp, Now)>,
    presence: Option<(Stamp, Presence)>,
    falls: BTreeMap<u64, (Stamp, Fall)>,
    health: Option<(Stamp, Health)>,
    rows: BTreeMap<i64, ActivityRow>,
}

impl State {
    pub(super) fn new(about: About) -> Self {
        Self {
            about,
            now: Vec::new(),
            presence: None,
            falls: BTreeMap::new(),
            health: None,
            rows: BTreeMap::new(),
        }
    }

    pub(super) fn about(&self) -> &About {
        &self.about
    }

    /// Whether a fall is suspected or confirmed, and not over.
    pub(super) fn has_fall(&self, id: u64) -> bool {
        self.falls.contains_key(&id)
    }

    /// Takes a message into account.
    pub(super) fn update(&mut self, stamp: Stamp, body: &Body) {
        let oldest_ms = stamp.utc_ms.saturating_sub(NOW_MS);
        self.now.retain(|(at, _)| at.utc_ms >= oldest_ms);
        match body {
            Body::Now(now) => self.set_now(stamp, now),
            Body::Presence(presence) => self.presence = Some((stamp, presence.clone())),
            Body::Health(health) => self.health = Some((stamp, health.clone())),
            Body::Fall(fall) => self.set_fall(stamp, fall),
            Body::Activity(row) => {
                self.rows.insert(row.id, (**row).clone());
                let oldest_ms = stamp.utc_ms.saturating_sub(ROWS_MS);
                self.rows.retain(|_, row| row.activity.end_ms >= oldest_ms);
                while self.rows.len() > MAX_ROWS {
                    self.rows.pop_first();
                }
            }
            Body::Hello(_) | Body::Frame(_) | Body::Lag(_) => {}
        }
    }

    /// Forgets sentences and activities of a range of time. Falls that are not over stay.
    pub(super) fn forget(&mut self, from_ms: i64, to_ms: i64) {
        let range = from_ms..to_ms;
        self.now.retain(|(at, _)| !range.contains(&at.utc_ms));
        self.rows.retain(|_, row| {
            let (start_ms, end_ms) = (row.activity.start_ms, row.activity.end_ms);
            start_ms >= to_ms || (start_ms < from_ms && end_ms <= from_ms)
        });
    }

    pub(super) fn hello(&self) -> Hello {
        let mut rows: Vec<ActivityRow> = self.rows.values().cloned().collect();
        rows.sort_by_key(|row| (row.activity.start_ms, row.id));
        Hello {
            about: self.about.clone(),
            now: self.now.iter().map(at).collect(),
            presence: self.presence.as_ref().map(at),
            falls: self.falls.values().map(at).collect(),
            health: self.health.as_ref().map(at),
            rows,
        }
    }

    fn set_now(&mut self, stamp: Stamp, now: &Now) {
        // A sentence about nobody ends those about people, and the reverse.
        self.now
            .retain(|(_, n)| n.person.is_some() == now.person.is_some() && n.person != now.person);
        if self.now.len() >= MAX_PEOPLE {
            self.now.remove(0);
        }
        self.now.push((stamp, now.clone()));
    }

    fn set_fall(&mut self, stamp: Stamp, fall: &Fall) {
        match fall.state {
            FallState::Suspected | FallState::Confirmed => {
                self.falls.insert(fall.id, (stamp, fall.clone()));
                while self.falls.len() > MAX_FALLS {
                    self.falls.pop_first();
                }
            }
            FallState::Dismissed | FallState::Recovered => {
                self.falls.remove(&fall.id);
            }
        }
    }
}

fn at<T: Clone>((stamp, what): &(Stamp, T)) -> At<T> {
    At::new(*stamp, what.clone())
}
