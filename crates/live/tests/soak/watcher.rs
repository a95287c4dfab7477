//! What was told, and whether it is what happened.

use std::collections::BTreeSet;

use radarllm_monitor::messages::{Body, FallState, Message, PresenceState};

use crate::broker;
use crate::script::{Script, frames};

/// What was told.
#[derive(Default)]
pub struct Watcher {
    pub captions: BTreeSet<String>,
    /// States of falls, with their frames.
    falls: Vec<(u32, u64, FallState)>,
    pub is_occupied: bool,
    pub n_readings_lost: u64,
    n_occupied: u32,
    n_sentences: u32,
    /// Transitions of falls that the broker got.
    n_published: usize,
}

impl Watcher {
    /// Takes a message. Returns the number of a frame.
    pub fn take(&mut self, json: &str) -> Option<u32> {
        let head = json.get(..200).unwrap_or(json);
        if head.contains("\"type\":\"frame\"") {
            return Some(frame_of(head));
        }
        let message: Message = serde_json::from_str(json).unwrap();
        let frame = (message.at.t_s * 10.0).round() as u32;
        match message.at.what {
            Body::Now(now) => {
                self.n_sentences += u32::from(now.caption.is_some());
                self.captions.extend(now.caption);
            }
            Body::Activity(row) => {
                self.captions.insert(row.activity.caption);
            }
            Body::Fall(fall) => self.falls.push((frame, fall.id, fall.state)),
            Body::Presence(presence) => {
                let is_occupied = presence.state != PresenceState::Absent;
                self.n_occupied += u32::from(is_occupied && !self.is_occupied);
                self.is_occupied = is_occupied;
            }
            Body::Lag(lag) => self.n_readings_lost += lag.dropped,
            Body::Hello(_) | Body::Frame(_) | Body::Health(_) => {}
        }
        None
    }

    /// Takes what the broker got.
    pub fn heard(&mut self, messages: Vec<broker::Message>) {
        let falls = messages.iter().filter(|m| m.topic.ends_with("/fall"));
        self.n_published += falls.count();
    }

    /// Frames in which falls came into a state, one for each fall.
    fn frames_of(&self, state: FallState) -> Vec<u32> {
        let of_state = self.falls.iter().filter(|(_, _, s)| *s == state);
        of_state.map(|(frame, _, _)| *frame).collect()
    }

    pub fn print(&self, truth: &[u32], script: &Script) {
        let count = |state| self.frames_of(state).len();
        println!(
            "falls: {} suspected, {} confirmed, {} dismissed, {} recovered; {} transitions on the broker",
            count(FallState::Suspected),
            count(FallState::Confirmed),
            count(FallState::Dismissed),
            count(FallState::Recovered),
            self.n_published,
        );
        println!(
            "occupied {} times, {} sentences",
            self.n_occupied, self.n_sentences
        );
        let suspected = self.frames_of(FallState::Suspected);
        for missed in truth
            .iter()
            .filter(|t| !suspected.iter().any(|s| is_near(**t, *s)))
        {
            println!("missed: {}", script.what(*missed));
        }
        for wrong in suspected
            .iter()
            .filter(|s| !truth.iter().any(|t| is_near(*t, **s)))
        {
            println!("wrong: {}", script.what(*wrong));
        }
    }

    /// Every fall was suspected and confirmed, and no other.
    pub fn check_falls(&self, truth: &[u32]) {
        let suspected = self.frames_of(FallState::Suspected);
        let confirmed = self.frames_of(FallState::Confirmed);
        assert_eq!(suspected.len(), truth.len(), "{suspected:?}: {truth:?}");
        for ((fall, suspected), confirmed) in truth.iter().zip(&suspected).zip(&confirmed) {
            assert!(is_near(*fall, *suspected), "{fall}: {suspected}");
            let dwell = confirmed - suspected;
            assert!((frames(20)..=frames(20) + 2).contains(&dwell), "{dwell}");
        }
        assert_eq!(confirmed.len(), truth.len());
        assert_eq!(self.frames_of(FallState::Recovered).len(), truth.len());
    }
}

/// Whether a fall may be suspected in a frame: from 2 s before the impact to 3 s after it.
fn is_near(impact: u32, suspected: u32) -> bool {
    (impact.saturating_sub(frames(2))..=impact + frames(3)).contains(&suspected)
}

/// Number of the frame of a message.
fn frame_of(head: &str) -> u32 {
    let (_, after) = head.split_once("\"t_s\":").unwrap();
    let end = after.find([',', '}']).unwrap();
    let t_s: f64 = after[..end].parse().unwrap();
    (t_s * 10.0).round() as u32
}
