//! Frames through tracker, presence and falls, as a running radar does it, without a model.

use radarllm_base::PointFrame;
use radarllm_serve::{
    falls::{FallEvent, FallMonitor},
    people::PersonFrame,
    presence::{PresenceMonitor, PresenceOptions},
    zones::Zones,
};
use radarllm_tracking::{TrackOptions, Tracker};

use super::plan::{FRAME_PERIOD_S, fall_options};
use crate::EvalError;

/// Heights of the tracked people in a frame.
#[derive(Clone, Debug)]
pub(super) struct Seen {
    /// Time of the frame, s.
    pub t_s: f64,
    /// Everybody who is tracked: number and height above the floor, m, if there are enough points.
    pub people: Vec<(u32, Option<f64>)>,
}

/// Watches a room without doors and zones.
pub(super) struct Watch {
    tracker: Tracker,
    presence: PresenceMonitor,
    falls: FallMonitor,
    n_frames: u32,
    /// Events so far.
    pub events: Vec<FallEvent>,
}

impl Watch {
    pub fn new(radar_height_m: f32) -> Result<Self, EvalError> {
        let config = |problem: String| EvalError::Config(problem);
        let zones = Zones::default;
        let presence = PresenceMonitor::new(PresenceOptions::default(), zones());
        let falls = FallMonitor::new(fall_options(radar_height_m), zones());
        Ok(Self {
            tracker: Tracker::new(TrackOptions::default()).map_err(|e| config(e.to_string()))?,
            presence: presence.map_err(|e| config(e.to_string()))?,
            falls: falls.map_err(|e| config(e.to_string()))?,
            n_frames: 0,
            events: Vec::new(),
        })
    }

    /// The points of the next frame.
    pub fn push(&mut self, frame: &PointFrame) -> Seen {
        let t_s = f64::from(self.n_frames) * FRAME_PERIOD_S;
        let frame = PointFrame {
            frame: self.n_frames,
            time_s: t_s,
            points: frame.points.clone(),
        };
        self.n_frames += 1;
        let tracks = self.tracker.push(&frame);
        let people: Vec<PersonFrame> = tracks
            .iter()
            .map(|one| PersonFrame {
                person: one.id,
                place_m: one.place_m,
                points: one.points_of(&frame),
            })
            .collect();
        for fall in self.falls.open() {
            self.presence.hold(t_s, fall.person);
        }
        let update = self.presence.push(t_s, &people);
        let events = self.falls.push(t_s, &people, &update.left);
        self.events.extend(events);
        let height = |one: &PersonFrame| (one.person, self.falls.height_m(one.person));
        Seen {
            t_s,
            people: people.iter().map(height).collect(),
        }
    }

    /// Whether a fall is suspected, but neither confirmed nor ended.
    pub fn is_undecided(&self) -> bool {
        self.falls.open().iter().any(|fall| !fall.is_confirmed)
    }
}
