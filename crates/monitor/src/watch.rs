//! Who is there, and who fell: tracker, presence and falls, frame by frame.
//!
//! A running radar and the evaluation of falls watch a room with this type, so that what is measured is what runs.

use radarllm_base::PointFrame;
use radarllm_tracking::{LiveTrack, TrackOptions, Tracker};

use crate::board::BoardPeople;
use crate::falls::{EarlierFall, Fall, FallEvent, FallMonitor, FallOptions, SuspectBy};
use crate::options::OptionError;
use crate::people::PersonFrame;
use crate::presence::{Fallen, PresenceMonitor, PresenceOptions, PresenceUpdate};
use crate::statures::Statures;
use crate::zones::Zones;

/// Options of tracker, presence and falls.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WatchOptions {
    /// Options of the tracker.
    pub track: TrackOptions,
    /// Options of presence.
    pub presence: PresenceOptions,
    /// Options of falls.
    pub falls: FallOptions,
    /// Zones of the room.
    pub zones: Zones,
}

/// What was seen in a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Seen {
    /// Confirmed tracks of people.
    pub tracks: Vec<LiveTrack>,
    /// The people of these tracks, with their points.
    pub people: Vec<PersonFrame>,
    /// Indices of the points of whoever a zone ignores because of the height, in ascending order.
    pub low_points: Vec<u32>,
    /// Whether somebody is there.
    pub presence: PresenceUpdate,
    /// Falls that began, were confirmed or ended.
    pub falls: Vec<FallEvent>,
}

/// Watches a room.
#[derive(Debug)]
pub struct Watch {
    tracker: Tracker,
    /// Instead of the tracker where the board tracks.
    board: BoardPeople,
    /// Largest number of a person of the tracker.
    numbered: u32,
    /// If zones have heights.
    statures: Option<Statures>,
    zones: Zones,
    presence: PresenceMonitor,
    falls: FallMonitor,
}

impl Watch {
    /// A room in which nobody has been seen yet, with a radar at a height above the floor, m.
    ///
    /// # Errors
    /// If an option is out of range.
    pub fn new(options: &WatchOptions, radar_height_m: f64) -> Result<Self, OptionError> {
        let zones = &options.zones;
        Ok(Self {
            tracker: Tracker::new(options.track)?,
            board: BoardPeople::default(),
            numbered: 0,
            statures: zones.have_heights().then(|| Statures::new(radar_height_m)),
            zones: zones.clone(),
            presence: PresenceMonitor::new(options.presence, zones.clone())?,
            falls: FallMonitor::new(options.falls, radar_height_m, zones.clone())?,
        })
    }

    /// The next frame, without static points of the room.
    pub fn push(&mut self, frame: &PointFrame) -> Seen {
        let t_s = frame.time_s;
        let mut tracks = match &frame.board {
            Some(report) => self.board.push(frame, report, self.numbered),
            None => self.tracker.push(frame),
        };
        let stated = frame.board.iter().flat_map(|report| &report.tracks);
        let person = |track: &LiveTrack| PersonFrame {
            person: track.id,
            place_m: track.place_m,
            points: track.points_of(frame),
            board: stated
                .clone()
                .find(|board| board.place_m.map(f64::from) == track.place_m)
                .copied(),
        };
        let mut people: Vec<PersonFrame> = tracks.iter().map(person).collect();
        if frame.board.is_none() {
            let newest = tracks.iter().map(|track| track.id).max();
            self.numbered = self.numbered.max(newest.unwrap_or(0));
        }
        let low_points = self.remove_low(t_s, &mut tracks, &mut people);
        self.presence.hold(self.fallen());
        let mut presence = self.presence.push(t_s, &people);
        let falls = self.falls.push(t_s, &people, &presence.left);
        // Whoever lay and is tracked again is counted once.
        self.presence.recount(self.fallen(), &mut presence);
        Seen {
            tracks,
            people,
            low_points,
            presence,
            falls,
        }
    }

    /// Removes whoever a zone ignores because of the height. Returns the indices of their points.
    fn remove_low(
        &mut self,
        t_s: f64,
        tracks: &mut Vec<LiveTrack>,
        people: &mut Vec<PersonFrame>,
    ) -> Vec<u32> {
        let Some(statures) = &mut self.statures else {
            return Vec::new();
        };
        statures.push(t_s, people);
        let mut low_points = Vec::new();
        people.retain(|one| {
            let is_low = statures.is_low(one, &self.zones);
            if is_low && let Some(at) = tracks.iter().position(|track| track.id == one.person) {
                low_points.extend(tracks.remove(at).points);
            }
            !is_low
        });
        low_points.sort_unstable();
        low_points
    }

    /// Who lies on the floor is hardly detected, but is there.
    fn fallen(&self) -> Vec<Fallen> {
        let fallen = self.falls.open().iter().map(|fall| Fallen {
            fall: fall.fall,
            person: fall.tracked_as(),
            place_m: fall.place_m,
        });
        fallen.collect()
    }

    /// Takes falls over that an earlier run of the program knew and that have not ended. To be called before the first
    /// frame.
    pub fn restore(&mut self, falls: &[EarlierFall]) -> PresenceUpdate {
        self.falls.restore(falls);
        self.reset_presence()
    }

    /// Points of somebody stay together at `t_s`, though nobody is tracked.
    pub fn notice(&mut self, t_s: f64, place_m: [f64; 2]) -> PresenceUpdate {
        self.presence.notice(t_s, place_m)
    }

    /// A sentence states an action of a person. Returns the fall that is suspected because of it.
    pub fn label(&mut self, person: u32, action: &str) -> Option<FallEvent> {
        self.falls.label(person, action)
    }

    /// A fall of a person was measured, at a place if the person is not tracked here. Returns the fall that is suspected
    /// because of it.
    pub fn measured_fall(&mut self, person: u32, place_m: [f64; 2]) -> Option<FallEvent> {
        self.falls.measured(person, place_m)
    }

    /// A person was measured to stand or to walk. Returns the fall that ends because of it.
    pub fn measured_up(&mut self, person: u32, stands: bool) -> Option<FallEvent> {
        self.falls.measured_up(person, stands)
    }

    /// Ends a fall on a user's word. Returns whether there was such a fall.
    pub fn acknowledge(&mut self, fall: u64) -> bool {
        self.falls.acknowledge(fall)
    }

    /// Suspects falls by these heights from now on.
    pub fn suspect_by(&mut self, heights: SuspectBy) {
        self.falls.suspect_by(heights);
    }

    /// Falls that have not ended.
    pub fn open_falls(&self) -> &[Fall] {
        self.falls.open()
    }

    /// Height of a person above the floor, m, if there are enough points for it.
    pub fn height_m(&self, person: u32) -> Option<f64> {
        self.falls.height_m(person)
    }

    /// The radar is silent: whether somebody is there is unknown from now on, but for whoever fell and has not risen.
    pub fn reset_presence(&mut self) -> PresenceUpdate {
        self.presence.hold(self.fallen());
        self.presence.reset()
    }
}
