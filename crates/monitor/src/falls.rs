//! Falls, by the height of a person's points. This is not a medical device.
//!
//! The height of a person is that of the board's track, if the board tracks heights. Otherwise it is the 90 % quantile of
//! the heights above the floor of the points of the last 0.3 s, of which there must be eight.
//!
//! | from | to | when |
//! |---|---|---|
//! | – | suspected | the height was below `fall_height_m` in two successive frames, within 1.0 s after it was above 1.0 m |
//! | – | suspected | the height was below 0.7 m, within 1.5 s after it was above 1.0 m, and has been unknown for 0.5 s since |
//! | – | suspected | the model says `fall`, and the height is below 0.7 m |
//! | – | suspected | a fall was measured by the board's tracks or the points of the person (`radarllm-measure`) |
//!
//! Where falls are measured, the first two lines hold only for heights that mean something ([`SuspectBy`]).
//!
//! | from | to | when |
//! |---|---|---|
//! | suspected | dismissed | the person is up, or left through a door |
//! | suspected | confirmed | `fall_dwell_s` have passed |
//! | confirmed | recovered | the person is up, or left through a door |
//!
//! Somebody is **up** whose height was above 0.9 m for 1 s, or who walked: 1.5 m within 3 s, mostly above 0.6 m; also who is
//! measured to stand, or to walk so far, unless the height shows that the person crawls.
//!
//! Whoever is unseen counts as down, because a person who lies has 0 to 6 points a frame. For the same reason many who
//! fall are not seen any more before they are seen below `fall_height_m`, most of all by a radar that is high up. A person
//! who was not tracked while lying has a new number afterwards: whoever is new and appears within 1 m of where somebody
//! lies unseen is that person. Points of a helper who bends over somebody may count as those of the fallen person, who
//! then seems to rise.
//!
//! A tracker may also give the number of somebody who lies unseen to somebody else who passes. Where two people were seen at
//! once, or somebody came in by a door, whoever is up must therefore have become so within 1.5 m of where the person was last
//! down; otherwise the number is another person's from then on. Where one person was alone, that person may get up
//! unseen and be tracked elsewhere: the fall ends when one person alone was up for 20 s, which is longer than somebody
//! needs who looks in.
//!
//! Heights and times are from falls of the simulator. `docs/results/falls.md` has recall, delay and false alarms for other
//! simulated falls and for recordings without falls; nobody has fallen in front of a real radar for it.

use std::collections::{BTreeMap, VecDeque};

use radarllm_base::stats::{median_upper, quantile_linear};

use crate::options::{OptionError, has_passed, is_over, within};
use crate::people::PersonFrame;
use crate::rows::EventKind;
use crate::zones::Zones;

/// Time over which points are collected, s.
pub(crate) const POINTS_S: f64 = 0.3;
/// Fewest points that have a height.
pub(crate) const MIN_POINTS: usize = 8;
/// Quantile of the heights that is the height of a person. The largest heights are noise of the elevation angle.
const QUANTILE: f64 = 0.9;
/// Height above which a person is up before a fall, m.
pub const HIGH_M: f64 = 1.0;
/// Longest time from [`HIGH_M`] to the second low frame, s. A fall passes through this half metre within a fraction of a
/// second; who lies down sits on the floor on the way, and needs longer. The points of the last 0.3 s delay both heights.
/// `docs/results/falls.md` compares limits.
pub(crate) const DROP_S: f64 = 1.0;
/// Longest time from [`HIGH_M`] to the last height of somebody who is not seen any more, s.
pub(crate) const SINK_S: f64 = 1.5;
/// Height above which a person has risen, m.
pub(crate) const RISEN_M: f64 = 0.9;
/// Time above [`RISEN_M`], s.
const RISE_S: f64 = 1.0;
/// Longest time without a height within [`RISE_S`], s: that of a few frames with too few points.
const RISE_GAP_S: f64 = 0.5;
/// Time within which somebody walks so far, m, and the height above which the person mostly is meanwhile, m: who crawls is
/// slower or lower. Where the height of the radar is assumed, nobody may seem to be above [`RISEN_M`].
const WALK_S: f64 = 3.0;
const WALK_M: f64 = 1.5;
const WALK_HEIGHT_M: f64 = 0.6;
/// A track that moves farther from one frame to the next than this, m and m/s, jumps: nobody walks so fast in a room.
const JUMP_M: f64 = 0.2;
const JUMP_MPS: f64 = 3.0;
/// Largest distance from where somebody was last down to where the same number rises, m: a body is 1.7 m long.
const RISE_PLACE_M: f64 = 1.5;
/// Time for which the only person of a room must be up before a fall elsewhere ends, s, and the longest time between parts of
/// it, s. A visitor who looks in is not longer in sight.
const ALONE_UP_S: f64 = 20.0;
const ALONE_GAP_S: f64 = 30.0;
/// Time for which two people are seen at once before somebody has company, s: noise is shorter.
const COMPANY_S: f64 = 1.0;
/// Time after which company that was not seen any more before a fall has gone, s.
const COMPANY_MEMORY_S: f64 = 600.0;
/// Height below which the model's word `fall` counts, m, and below which a person who is not seen any more has fallen.
pub(crate) const SUNK_M: f64 = 0.7;
/// Time without a height after which a person is not seen any more, s.
const UNSEEN_S: f64 = 0.5;
/// Oldest height that counts for the model's word, s: the distance of two windows.
const LABEL_AGE_S: f64 = 2.0;
/// Time after the end of a fall for which the model's word does not count, s: the length of a window, which may still
/// contain the former fall.
const LABEL_REST_S: f64 = 6.0;
/// Largest distance of a new person from where somebody lies unseen, m: the length of a body is twice that.
const SAME_PLACE_M: f64 = 1.0;
/// Time for which a person is remembered who is not tracked any more, s; longer than [`SINK_S`] and [`LABEL_AGE_S`].
const MEMORY_S: f64 = 10.0;
/// Time for which the place of a fall is remembered that a user ended, s. Whoever is tracked anew there must have been up
/// for [`RISE_S`] before a fall counts, which costs somebody else who comes by nothing.
const ACKNOWLEDGED_S: f64 = 600.0;
/// Most falls that have not ended. If there are more, the oldest one is dropped.
pub const MAX_OPEN: usize = 64;
/// The model's word.
pub(crate) const FALL: &str = "fall";

/// By which heights falls are suspected.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SuspectBy {
    /// By all.
    #[default]
    Heights,
    /// By those of points: tracks of boards sink by themselves, and falls that they show are measured.
    HeightsOfPoints,
    /// By none, because nobody states the height of the radar: falls are measured.
    Measuring,
}

/// Options of falls.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FallOptions {
    /// Height below which somebody is down, m above the floor.
    pub fall_height_m: f64,
    /// Time for which a person must not rise before a fall is confirmed, s.
    pub fall_dwell_s: f64,
}

impl Default for FallOptions {
    /// A height of 0.5 m and a dwell of 20 s.
    fn default() -> Self {
        Self {
            fall_height_m: 0.5,
            fall_dwell_s: 20.0,
        }
    }
}

impl FallOptions {
    /// Checks every field.
    ///
    /// # Errors
    /// Names the first field that is out of range.
    pub fn validate(&self) -> Result<(), OptionError> {
        within(
            "fall_height_m",
            self.fall_height_m,
            [0.1, RISEN_M],
            "0.1 to 0.9 m",
        )?;
        within(
            "fall_dwell_s",
            self.fall_dwell_s,
            [1.0, 3_600.0],
            "1 to 3600 s",
        )
    }
}

/// What is known about a fall.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FallState {
    /// Somebody may have fallen.
    Suspected,
    /// The person has not risen for the dwell time.
    Confirmed,
    /// The person rose within the dwell time.
    Dismissed,
    /// The person rose later.
    Recovered,
}

impl FallState {
    /// The kind of event that the memory keeps.
    pub fn event_kind(self) -> EventKind {
        match self {
            Self::Suspected => EventKind::Suspected,
            Self::Confirmed => EventKind::Confirmed,
            Self::Dismissed => EventKind::Dismissed,
            Self::Recovered => EventKind::Recovered,
        }
    }
}

/// A change of a fall.
#[derive(Clone, Debug, PartialEq)]
pub struct FallEvent {
    /// Number of the fall, from 1.
    pub fall: u64,
    /// Number of the person, at present.
    pub person: u32,
    /// The new state.
    pub state: FallState,
    /// Time of the change, s.
    pub at_s: f64,
    /// Time since the fall was suspected, s.
    pub dwell_s: f64,
    /// Where the person fell, m.
    pub place_m: [f64; 2],
}

/// A fall that has not ended.
#[derive(Clone, Debug, PartialEq)]
pub struct Fall {
    /// Number of the fall, from 1.
    pub fall: u64,
    /// Number of the person, at present.
    pub person: u32,
    /// Whether it is confirmed, or only suspected.
    pub is_confirmed: bool,
    /// Time at which it was suspected, s.
    pub since_s: f64,
    /// Where the person fell, m.
    pub place_m: [f64; 2],
    /// Where the person was last seen down, m.
    down_m: [f64; 2],
    /// Whether the number is not that of the person any more: another one has it, or the program was started anew.
    is_renumbered: bool,
    /// Whether others may be in the room.
    has_company: bool,
    /// For how long one person alone has been up since, s, and when last.
    alone_up_s: f64,
    alone_up_at_s: f64,
}

/// A fall of which another run of the program knew when it ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EarlierFall {
    /// Number of the fall.
    pub fall: u64,
    /// Number that the person had.
    pub person: u32,
    /// Whether it is confirmed, or only suspected.
    pub is_confirmed: bool,
    /// Time since it was suspected, s.
    pub age_s: f64,
    /// Where the person fell, m.
    pub place_m: [f64; 2],
}

/// A height above [`RISEN_M`] from one time to another, and where it began.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Rise {
    since_s: f64,
    until_s: f64,
    from_m: [f64; 2],
}

/// Watches for falls, frame by frame.
#[derive(Clone, Debug)]
pub struct FallMonitor {
    options: FallOptions,
    suspect_by: SuspectBy,
    /// Height of the radar above the floor, m.
    radar_height_m: f64,
    zones: Zones,
    now_s: f64,
    /// Whether a frame was pushed.
    has_begun: bool,
    bodies: BTreeMap<u32, Body>,
    /// Since when two people are seen at once, and until when, s.
    together_s: Option<[f64; 2]>,
    /// When somebody last had company, s.
    company_s: Option<f64>,
    open: Vec<Fall>,
    n_falls: u64,
    /// Largest number of a person so far.
    newest: Option<u32>,
    /// Falls that a user ended a short time ago: where, and when, s.
    acknowledged: VecDeque<([f64; 2], f64)>,
}

/// What is remembered of a tracked person.
#[derive(Clone, Debug)]
struct Body {
    /// Heights of the points of the last [`POINTS_S`], with the times of their frames.
    recent: VecDeque<(f64, Vec<f64>)>,
    /// Height in this frame, and whether it is that of the board's track.
    height_m: Option<f64>,
    is_height_of_board: bool,
    /// The last height, and its time.
    last: Option<(f64, f64)>,
    place_m: [f64; 2],
    was_low: bool,
    high_s: Option<f64>,
    tracked_s: f64,
    /// End of the last fall.
    ended_s: Option<f64>,
    /// A user ended a fall of this person, who has not risen since. Whoever is down cannot fall.
    must_rise: bool,
    rise: Option<Rise>,
    /// Times, places and heights of the last [`WALK_S`] in which the person was seen.
    path: VecDeque<(f64, [f64; 2], Option<f64>)>,
}

impl FallMonitor {
    /// Nobody has fallen yet.
    ///
    /// # Errors
    /// If an option is out of range.
    pub fn new(
        options: FallOptions,
        radar_height_m: f64,
        zones: Zones,
    ) -> Result<Self, OptionError> {
        options.validate()?;
        within(
            "radar_height_m",
            radar_height_m,
            [-10.0, 100.0],
            "-10 to 100 m",
        )?;
        Ok(Self {
            options,
            suspect_by: SuspectBy::default(),
            radar_height_m,
            zones,
            now_s: 0.0,
            has_begun: false,
            bodies: BTreeMap::new(),
            together_s: None,
            company_s: None,
            open: Vec::new(),
            n_falls: 0,
            newest: None,
            acknowledged: VecDeque::new(),
        })
    }

    /// Suspects falls by these heights from now on.
    pub fn suspect_by(&mut self, heights: SuspectBy) {
        self.suspect_by = heights;
    }

    /// Falls that have not ended.
    pub fn open(&self) -> &[Fall] {
        &self.open
    }

    /// Whether somebody has fallen and not risen.
    pub fn has_fallen(&self) -> bool {
        self.open.iter().any(|fall| fall.is_confirmed)
    }

    /// Height of a person in the last frame, m above the floor, if enough points were seen.
    pub fn height_m(&self, person: u32) -> Option<f64> {
        self.bodies.get(&person)?.height_m
    }

    /// The tracked people of the next frame, at `t_s`, and those who have just left through a door. A frame whose time is
    /// no number changes nothing; time does not go back. Frames without people must be pushed as well. While a radar is
    /// silent, time passes and nobody rises.
    pub fn push(&mut self, t_s: f64, people: &[PersonFrame], left: &[u32]) -> Vec<FallEvent> {
        if !t_s.is_finite() {
            return Vec::new();
        }
        let before_s = self.now_s;
        self.now_s = self.now_s.max(t_s);
        if !std::mem::replace(&mut self.has_begun, true) {
            // Times of earlier falls are relative to the first frame.
            let open = self.open.iter_mut();
            open.for_each(|fall| fall.since_s += self.now_s);
        }
        let (now_s, floor_m) = (self.now_s, -self.radar_height_m);
        self.meet(people, left);
        for body in self.bodies.values_mut() {
            body.height_m = None;
        }
        for one in people {
            if self.zones.counts(one.place_m) {
                self.recognise(one, people);
                let was_acknowledged = || {
                    let mut places = self.acknowledged.iter();
                    places.any(|(place_m, _)| is_near(*place_m, one.place_m))
                };
                let body = self.bodies.entry(one.person);
                let body = body.or_insert_with(|| Body::new(one.place_m, was_acknowledged()));
                body.see(now_s, one, floor_m);
                // Whoever goes down in a bed has not fallen.
                if self.zones.is_bed(one.place_m) {
                    body.high_s = None;
                }
            } else if let Some(body) = self.bodies.get_mut(&one.person) {
                // Whoever disappears into an ignored place, such as a bed, has not fallen.
                body.high_s = None;
            }
        }
        let mut events = self.suspect();
        let mut counting = people.iter().filter(|one| self.zones.counts(one.place_m));
        let alone = match (counting.next(), counting.next()) {
            (Some(one), None) => Some(one.person),
            _ => None,
        };
        self.follow(left, alone, now_s - before_s, &mut events);
        self.bodies
            .retain(|_, body| !is_over(body.tracked_s, now_s, MEMORY_S));
        self.acknowledged
            .retain(|(_, at_s)| !is_over(*at_s, now_s, ACKNOWLEDGED_S));
        events
    }

    /// The model named a person's action in a window that has just ended.
    pub fn label(&mut self, person: u32, action: &str) -> Option<FallEvent> {
        let (height_m, at_s) = self.bodies.get(&person)?.last?;
        let is_low = height_m < SUNK_M && !is_over(at_s, self.now_s, LABEL_AGE_S);
        let place_m = self.bodies.get(&person)?.place_m;
        (action == FALL && is_low).then(|| self.stated(person, place_m))?
    }

    /// A fall of a person was measured in a window that has just ended, at a place if the person is not tracked here. The
    /// heights of this monitor need not show it: they need a stated height of the radar and many points.
    pub fn measured(&mut self, person: u32, place_m: [f64; 2]) -> Option<FallEvent> {
        let tracked = self.bodies.get(&person).map(|body| body.place_m);
        self.stated(person, tracked.unwrap_or(place_m))
    }

    /// A person was measured to stand, or to walk, for a time that has just ended. A fall of this person ends, if the person has
    /// gone 1.5 m within three seconds while walking. The heights of this monitor need not show it: they need a stated height of
    /// the radar, and a board that is not tilted.
    pub fn measured_up(&mut self, person: u32, stands: bool) -> Option<FallEvent> {
        let now_s = self.now_s;
        let body = self.bodies.get_mut(&person)?;
        let from_m = match stands {
            true => body.place_m,
            // Whoever goes as low as on the floor crawls, if the height means something.
            false if self.suspect_by != SuspectBy::Measuring && body.goes_low() => return None,
            false => body.went_from_m(now_s)?,
        };
        let is_own = |fall: &Fall| fall.tracked_as() == Some(person);
        let at = self.open.iter().position(is_own)?;
        if !self.open[at].may_rise_at([from_m, body.place_m]) {
            // Somebody else, who was given the number of the person who lies.
            self.open[at].is_renumbered = true;
            return None;
        }
        body.ended_s = Some(now_s);
        let fall = self.open.remove(at);
        Some(fall.event(fall.ended(), now_s))
    }

    /// Begins a fall that something else than the heights states.
    fn stated(&mut self, person: u32, place_m: [f64; 2]) -> Option<FallEvent> {
        let is_recent = |end_s: f64| !is_over(end_s, self.now_s, LABEL_REST_S);
        let has_ended = match self.bodies.get(&person) {
            Some(body) => body.must_rise || body.ended_s.is_some_and(is_recent),
            None => (self.acknowledged.iter())
                .any(|(place, at_s)| is_near(*place, place_m) && is_recent(*at_s)),
        };
        let counts = !has_ended && !self.zones.is_bed(place_m) && !self.is_open(person);
        counts.then(|| self.begin(person, place_m))
    }

    /// Ends a fall on a user's word. Returns whether there was such a fall. The person is not suspected again before they
    /// have risen, even if the tracker gives them a new number.
    pub fn acknowledge(&mut self, fall: u64) -> bool {
        let Some(at) = self.open.iter().position(|open| open.fall == fall) else {
            return false;
        };
        let ended = self.open.remove(at);
        if let Some(body) = self.bodies.get_mut(&ended.person) {
            body.ended_s = Some(self.now_s);
            body.must_rise = true;
            body.rise = None;
        }
        if self.acknowledged.len() >= MAX_OPEN {
            self.acknowledged.pop_front();
        }
        self.acknowledged.push_back((ended.place_m, self.now_s));
        true
    }

    /// Takes falls over that an earlier run of the program knew and that have not ended: nobody has risen because a program
    /// was started anew. To be called before the first frame.
    pub fn restore(&mut self, falls: &[EarlierFall]) {
        for earlier in falls {
            if self.open.len() >= MAX_OPEN {
                self.open.remove(0);
            }
            self.n_falls = self.n_falls.max(earlier.fall);
            self.open.push(Fall {
                fall: earlier.fall,
                person: earlier.person,
                is_confirmed: earlier.is_confirmed,
                since_s: self.now_s - earlier.age_s,
                place_m: earlier.place_m,
                down_m: earlier.place_m,
                is_renumbered: true,
                has_company: false,
                alone_up_s: 0.0,
                alone_up_at_s: self.now_s,
            });
        }
    }

    fn is_open(&self, person: u32) -> bool {
        self.open
            .iter()
            .any(|fall| fall.tracked_as() == Some(person))
    }

    /// Remembers whether people have company.
    fn meet(&mut self, people: &[PersonFrame], left: &[u32]) {
        let now_s = self.now_s;
        if !left.is_empty() {
            self.company_s = self.company_s.filter(|_| people.len() > 1);
            for fall in &mut self.open {
                let is_other = |one: &u32| fall.tracked_as() != Some(*one);
                let others_stay = people.iter().any(|one| is_other(&one.person));
                fall.has_company &= others_stay || !left.iter().any(is_other);
            }
        }
        let is_seen = |one: &&PersonFrame| {
            (!one.points.is_empty() || one.board.is_some()) && self.zones.counts(one.place_m)
        };
        let n_seen = people.iter().filter(is_seen).count();
        let together_s = self.together_s.take();
        self.together_s = together_s.filter(|[_, until_s]| !is_over(*until_s, now_s, RISE_GAP_S));
        if n_seen > 1 {
            let since_s = self.together_s.map_or(now_s, |[since_s, _]| since_s);
            self.together_s = Some([since_s, now_s]);
            if has_passed(since_s, now_s, COMPANY_S) {
                self.company_s = Some(now_s);
            }
        }
        // Whoever appears in a door comes in.
        let is_entry = |one: &PersonFrame| {
            self.newest.is_none_or(|n| one.person > n) && self.zones.is_door(one.place_m)
        };
        if !self.open.is_empty() && people.iter().any(is_entry) {
            self.company_s = Some(now_s);
        }
        if self.company_s == Some(now_s) {
            self.open
                .iter_mut()
                .for_each(|fall| fall.has_company = true);
        }
    }

    /// A new person who appears where somebody lies unseen is that person.
    fn recognise(&mut self, one: &PersonFrame, people: &[PersonFrame]) {
        if self.newest.is_some_and(|newest| one.person <= newest) {
            return;
        }
        self.newest = Some(one.person);
        let is_unseen_here = |fall: &Fall| {
            let is_there = |p: &PersonFrame| {
                fall.tracked_as() == Some(p.person)
                    && is_within(fall.down_m, p.place_m, RISE_PLACE_M)
            };
            is_near(fall.down_m, one.place_m) && !people.iter().any(is_there)
        };
        let mut near = self.open.iter_mut().filter(|fall| is_unseen_here(fall));
        if let (Some(fall), None) = (near.next(), near.next()) {
            fall.person = one.person;
            fall.is_renumbered = false;
        }
    }

    /// Suspects falls by height.
    fn suspect(&mut self) -> Vec<FallEvent> {
        let (now_s, low_m) = (self.now_s, self.options.fall_height_m);
        let suspect_by = self.suspect_by;
        let counts = |body: &Body| match suspect_by {
            SuspectBy::Heights => true,
            SuspectBy::HeightsOfPoints => !body.is_height_of_board,
            SuspectBy::Measuring => false,
        };
        let mut fallen = Vec::new();
        for (&person, body) in &mut self.bodies {
            let is_low = body.height_m.is_some_and(|h| h < low_m);
            let dropped = |high_s: f64| !is_over(high_s, now_s, DROP_S);
            let has_dropped = is_low && body.was_low && body.high_s.is_some_and(dropped);
            body.was_low = is_low;
            if counts(body) && (has_dropped || body.has_sunk_and_vanished(now_s)) {
                fallen.push((person, body.place_m));
            }
            if body.height_m.is_some_and(|h| h > HIGH_M) && !body.must_rise {
                body.high_s = Some(now_s);
            }
        }
        fallen.retain(|(person, _)| !self.is_open(*person));
        fallen
            .into_iter()
            .map(|(person, place_m)| self.begin(person, place_m))
            .collect()
    }

    fn begin(&mut self, person: u32, place_m: [f64; 2]) -> FallEvent {
        self.n_falls += 1;
        if let Some(body) = self.bodies.get_mut(&person) {
            // One suspicion for every time the person was up, which was before.
            body.high_s = None;
            body.rise = None;
            body.path.clear();
        }
        let is_company = |at_s: f64| !is_over(at_s, self.now_s, COMPANY_MEMORY_S);
        let fall = Fall {
            fall: self.n_falls,
            person,
            is_confirmed: false,
            since_s: self.now_s,
            place_m,
            down_m: place_m,
            is_renumbered: false,
            has_company: self.company_s.is_some_and(is_company),
            alone_up_s: 0.0,
            alone_up_at_s: self.now_s,
        };
        let event = fall.event(FallState::Suspected, self.now_s);
        if self.open.len() >= MAX_OPEN {
            self.open.remove(0);
        }
        self.open.push(fall);
        event
    }

    /// Confirms falls and ends them. `alone` is the only person of this frame, `passed_s` the time since the last one.
    fn follow(
        &mut self,
        left: &[u32],
        alone: Option<u32>,
        passed_s: f64,
        events: &mut Vec<FallEvent>,
    ) {
        let (now_s, bodies, zones) = (self.now_s, &mut self.bodies, &self.zones);
        let dwell_s = self.options.fall_dwell_s;
        let only = alone.and_then(|person| bodies.get(&person));
        let is_only_up = only.is_some_and(|body| body.up_m(now_s).is_some());
        let up_s = passed_s.min(RISE_GAP_S);
        self.open.retain_mut(|fall| {
            let tracked = fall.tracked_as();
            let body = tracked.and_then(|person| bodies.get_mut(&person));
            let up_m = body.as_ref().and_then(|body| body.up_m(now_s));
            let is_up_here = up_m.is_some_and(|places_m| fall.may_rise_at(places_m));
            if up_m.is_some() && !is_up_here {
                // Somebody else, who was given the number of the person who lies.
                fall.is_renumbered = true;
            } else if let Some(body) = &body
                && body.is_low_at(now_s)
            {
                fall.down_m = body.place_m;
            }
            // Whoever fell in a door disappears there without having left.
            let has_left =
                tracked.is_some_and(|one| left.contains(&one)) && !zones.is_door(fall.place_m);
            if is_up_here || has_left || fall.is_over_by_only(is_only_up, up_s, now_s) {
                events.push(fall.event(fall.ended(), now_s));
                if let Some(body) = body {
                    body.ended_s = Some(now_s);
                }
                return false;
            }
            if !fall.is_confirmed && has_passed(fall.since_s, now_s, dwell_s) {
                fall.is_confirmed = true;
                events.push(fall.event(FallState::Confirmed, now_s));
            }
            true
        });
    }
}

impl Fall {
    /// Number under which the person may be tracked; `None` if that number is another person's.
    pub fn tracked_as(&self) -> Option<u32> {
        (!self.is_renumbered).then_some(self.person)
    }

    /// The state of the fall when the person is up.
    pub fn ended(&self) -> FallState {
        match self.is_confirmed {
            true => FallState::Recovered,
            false => FallState::Dismissed,
        }
    }

    /// Whether whoever has the number of the person, and was at these places when getting up, is the person.
    fn may_rise_at(&self, places_m: [[f64; 2]; 2]) -> bool {
        let is_here = |place_m| is_within(self.down_m, place_m, RISE_PLACE_M);
        !self.has_company || places_m.into_iter().all(is_here)
    }

    /// Whether one person alone has been up for so long that it is the one who fell. `is_up` tells whether one person alone
    /// is up in this frame, `up_s` for how long since the last one.
    fn is_over_by_only(&mut self, is_up: bool, up_s: f64, now_s: f64) -> bool {
        if self.has_company || is_over(self.alone_up_at_s, now_s, ALONE_GAP_S) {
            self.alone_up_s = 0.0;
        }
        if is_up && !self.has_company {
            self.alone_up_s += up_s;
            self.alone_up_at_s = now_s;
        }
        has_passed(0.0, self.alone_up_s, ALONE_UP_S)
    }

    fn event(&self, state: FallState, now_s: f64) -> FallEvent {
        FallEvent {
            fall: self.fall,
            person: self.person,
            state,
            at_s: now_s,
            dwell_s: now_s - self.since_s,
            place_m: self.place_m,
        }
    }
}

impl Rise {
    /// The rise after the height in the next frame.
    fn next(
        rise: Option<Self>,
        height_m: Option<f64>,
        now_s: f64,
        place_m: [f64; 2],
    ) -> Option<Self> {
        let rise = rise.filter(|rise| !is_over(rise.until_s, now_s, RISE_GAP_S));
        match height_m {
            Some(h) if h > RISEN_M => Some(Self {
                since_s: rise.map_or(now_s, |rise| rise.since_s),
                until_s: now_s,
                from_m: rise.map_or(place_m, |rise| rise.from_m),
            }),
            Some(_) => None,
            None => rise,
        }
    }

    fn is_complete(&self) -> bool {
        has_passed(self.since_s, self.until_s, RISE_S)
    }
}

/// Whether two places may be of the same person.
fn is_near(a_m: [f64; 2], b_m: [f64; 2]) -> bool {
    is_within(a_m, b_m, SAME_PLACE_M)
}

/// Whether two places are not farther apart than a distance, m.
fn is_within(a_m: [f64; 2], b_m: [f64; 2], distance_m: f64) -> bool {
    let [dx, dy] = [0, 1].map(|i| a_m[i] - b_m[i]);
    dx.hypot(dy) <= distance_m
}

impl Body {
    fn new(place_m: [f64; 2], must_rise: bool) -> Self {
        Self {
            recent: VecDeque::new(),
            height_m: None,
            is_height_of_board: false,
            last: None,
            place_m,
            was_low: false,
            high_s: None,
            tracked_s: 0.0,
            ended_s: None,
            must_rise,
            rise: None,
            path: VecDeque::new(),
        }
    }

    /// Where the person, who is up, began to be so and is, or began to walk. The estimate of a track that was given to
    /// somebody else arrives there within a second.
    fn up_m(&self, now_s: f64) -> Option<[[f64; 2]; 2]> {
        let is_now = |rise: &Rise| rise.is_complete() && !is_over(rise.until_s, now_s, RISE_GAP_S);
        let rise = self.rise.filter(is_now);
        let places_m = rise.map(|rise| [rise.from_m, self.place_m]);
        places_m.or_else(|| self.walks_from_m(now_s).map(|from_m| [from_m; 2]))
    }

    /// Where the person was at the beginning of the last [`WALK_S`], who walks.
    fn walks_from_m(&self, now_s: f64) -> Option<[f64; 2]> {
        let is_high = self.path_height_m()? > WALK_HEIGHT_M;
        self.went_from_m(now_s).filter(|_| is_high)
    }

    /// Whether the person was mostly not above [`WALK_HEIGHT_M`] in the last [`WALK_S`].
    fn goes_low(&self) -> bool {
        (self.path_height_m()).is_some_and(|height_m| height_m <= WALK_HEIGHT_M)
    }

    fn path_height_m(&self) -> Option<f64> {
        median_upper(self.path.iter().filter_map(|(_, _, height_m)| *height_m))
    }

    /// Where the person was at the beginning of the last [`WALK_S`], who went [`WALK_M`] since at any height.
    fn went_from_m(&self, now_s: f64) -> Option<[f64; 2]> {
        let ((_, from_m, _), (at_s, to_m, _)) = self.path.front().zip(self.path.back())?;
        let went = !is_within(*from_m, *to_m, WALK_M) && !is_over(*at_s, now_s, RISE_GAP_S);
        went.then_some(*from_m)
    }

    /// Whether the height in a frame is that of somebody who is down.
    fn is_low_at(&self, now_s: f64) -> bool {
        self.last
            .is_some_and(|(height_m, at_s)| at_s == now_s && height_m < SUNK_M)
    }

    /// Whether the height was below [`SUNK_M`] soon after [`HIGH_M`], and has been unknown since.
    fn has_sunk_and_vanished(&self, now_s: f64) -> bool {
        let (Some((height_m, at_s)), Some(high_s)) = (self.last, self.high_s) else {
            return false;
        };
        self.height_m.is_none()
            && height_m < SUNK_M
            && !is_over(high_s, at_s, SINK_S)
            && has_passed(at_s, now_s, UNSEEN_S)
    }

    fn see(&mut self, now_s: f64, one: &PersonFrame, floor_m: f64) {
        let heights = one.points.iter().map(|p| f64::from(p.z_m) - floor_m);
        let heights = heights.filter(|h| h.is_finite()).collect();
        self.recent.push_back((now_s, heights));
        while let Some((at_s, _)) = self.recent.front()
            && has_passed(*at_s, now_s, POINTS_S)
        {
            self.recent.pop_front();
        }
        let all = self.recent.iter().flat_map(|(_, heights)| heights);
        let tracked = one.board.and_then(|track| track.height_m);
        let tracked = tracked.map(|z_m| f64::from(z_m) - floor_m);
        self.is_height_of_board = tracked.is_some();
        self.height_m = tracked.or_else(|| quantile(all.copied().collect()));
        if let Some(h) = self.height_m {
            self.last = Some((h, now_s));
        }
        self.rise = Rise::next(self.rise, self.height_m, now_s, one.place_m);
        self.must_rise &= !self.rise.is_some_and(|rise| rise.is_complete());
        // A walk is seen all the way. Where the tracker only expects somebody, it may go on with somebody else.
        let reach_m = JUMP_M + JUMP_MPS * (now_s - self.tracked_s);
        let is_gap = |(at_s, ..): &(f64, [f64; 2], Option<f64>)| is_over(*at_s, now_s, RISE_GAP_S);
        if !is_within(self.place_m, one.place_m, reach_m) || self.path.back().is_some_and(is_gap) {
            self.path.clear();
        }
        if !one.points.is_empty() || one.board.is_some() {
            self.path.push_back((now_s, one.place_m, self.height_m));
        }
        while let Some((at_s, ..)) = self.path.front()
            && is_over(*at_s, now_s, WALK_S)
        {
            self.path.pop_front();
        }
        self.place_m = one.place_m;
        self.tracked_s = now_s;
    }
}

/// The [`QUANTILE`] of at least [`MIN_POINTS`] values, interpolated between its neighbours.
pub(crate) fn quantile(mut values: Vec<f64>) -> Option<f64> {
    if values.len() < MIN_POINTS {
        return None;
    }
    values.sort_by(f64::total_cmp);
    quantile_linear(&values, QUANTILE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::people::tests::{person, unseen};
    use crate::zones::ZoneKind;
    use crate::zones::tests::rectangle;

    const PLACE: [f64; 2] = [0.0, 2.0];
    /// Height of the radar, m.
    const RADAR_M: f64 = 1.0;

    /// Pushes frames at 10 Hz and remembers the number of the next one.
    struct Scene {
        monitor: FallMonitor,
        frame: u32,
    }

    impl Scene {
        fn new() -> Self {
            Self::with(Vec::new())
        }

        fn with(zones: Vec<crate::zones::Zone>) -> Self {
            let zones = Zones::new(zones).unwrap();
            let monitor = FallMonitor::new(FallOptions::default(), RADAR_M, zones).unwrap();
            Self { monitor, frame: 0 }
        }

        fn push(&mut self, people: &[PersonFrame], left: &[u32]) -> Vec<FallEvent> {
            let t_s = f64::from(self.frame) * 0.1;
            self.frame += 1;
            self.monitor.push(t_s, people, left)
        }

        /// Frames of person 1 at a height above the floor. Returns the states with the numbers of their frames.
        fn at(&mut self, height_m: f32, n_frames: u32) -> Vec<(u32, FallState)> {
            let people = [at_height(1, height_m)];
            self.frames(&people, n_frames)
        }

        fn frames(&mut self, people: &[PersonFrame], n_frames: u32) -> Vec<(u32, FallState)> {
            let mut found = Vec::new();
            for _ in 0..n_frames {
                let frame = self.frame;
                let events = self.push(people, &[]);
                found.extend(events.into_iter().map(|e| (frame, e.state)));
            }
            found
        }

        /// Three frames to forget the points of before.
        fn fall(&mut self) {
            self.at(1.5, 10);
            let found = self.at(0.2, 5);
            // At the third frame no point from above is left; the fourth is the second low one.
            assert_eq!(found, [(self.frame - 2, FallState::Suspected)]);
        }
    }

    fn at_height(number: u32, height_m: f32) -> PersonFrame {
        person(number, PLACE, height_m - RADAR_M as f32)
    }

    #[test]
    fn where_falls_are_measured_heights_that_mean_nothing_suspect_none() {
        let suspected = |suspect_by: SuspectBy, of_board: bool| {
            let mut scene = Scene::new();
            scene.monitor.suspect_by(suspect_by);
            let at = |height_m: f32| {
                let mut one = at_height(1, height_m);
                one.board = of_board.then_some(radarllm_base::BoardTrack {
                    id: 1,
                    place_m: [0.0, 2.0],
                    height_m: Some(height_m - RADAR_M as f32),
                    velocity_mps: [0.0; 3],
                });
                [one]
            };
            scene.frames(&at(1.5), 10);
            !scene.frames(&at(0.2), 5).is_empty()
        };
        assert!(suspected(SuspectBy::Heights, true) && suspected(SuspectBy::Heights, false));
        assert!(!suspected(SuspectBy::HeightsOfPoints, true));
        assert!(suspected(SuspectBy::HeightsOfPoints, false));
        assert!(!suspected(SuspectBy::Measuring, false));
    }

    #[test]
    fn the_height_is_the_quantile_of_eight_points_of_three_frames() {
        let mut scene = Scene::new();
        let frame = |heights: &[f32]| {
            let mut one = at_height(1, 0.0);
            let point = one.points[0];
            let with = |h: &f32| radarllm_base::RadarPoint {
                z_m: h - 1.0,
                ..point
            };
            one.points = heights.iter().map(with).collect();
            one
        };
        let mut height = |heights: &[f32]| {
            scene.push(&[frame(heights)], &[]);
            scene.monitor.height_m(1)
        };
        assert_eq!(height(&[0.1, 0.2, 0.3]), None);
        assert_eq!(height(&[0.4, 0.5, f32::NAN, 0.6, f32::INFINITY]), None);
        // Eight: 0.1 to 0.8, of which the quantile is 0.7 + 0.3 x 0.1.
        let found = height(&[0.7, 0.8]).unwrap();
        assert!((found - 0.73).abs() < 1e-6, "{found}");
        // The first frame is 0.3 s old.
        assert_eq!(height(&[0.9]), None);
        assert_eq!(height(&[]), None);
        assert_eq!(height(&[1.0; 8]), Some(1.0));
        assert_eq!(scene.monitor.height_m(7), None);
    }

    #[test]
    fn two_successive_low_frames_within_the_time_are_a_suspicion() {
        // High until frame 9, then unknown, then low. The second low frame may be 1.0 s after the last high one.
        let drop = |n_unknown: u32| {
            let mut scene = Scene::new();
            scene.at(1.1, 10);
            scene.frames(&[], n_unknown);
            scene.at(0.49, 20)
        };
        // With 8 frames between, the low ones are 9 and 10 frames after the last high one.
        assert_eq!(drop(8), [(19, FallState::Suspected)]);
        assert!(drop(9).is_empty());
        // A frame without a height, or one that is not low, between two low ones.
        let mut scene = Scene::new();
        scene.at(1.1, 10);
        scene.frames(&[], 3);
        for _ in 0..4 {
            assert!(scene.at(0.2, 1).is_empty());
            assert!(scene.frames(&[], 3).is_empty());
        }
    }

    #[test]
    fn who_sinks_fast_and_is_not_seen_any_more_is_suspected() {
        // The frame after the last one with a height, and the suspicions.
        let sink = |height_m: f32, n_between: u32, n_low: u32| {
            let mut scene = Scene::new();
            scene.at(1.25, 10);
            scene.frames(&[], n_between);
            let low = scene.frame;
            assert!(scene.at(height_m, n_low).is_empty());
            let found = scene.frames(&[], 100);
            (low + n_low, found)
        };
        // Half a second after the last height.
        let (end, found) = sink(0.625, 3, 2);
        assert_eq!(found, [(end + 4, FallState::Suspected)]);
        // Not low enough, not fast enough.
        assert!(sink(0.75, 3, 2).1.is_empty());
        assert!(sink(0.625, 3, 13).1.is_empty());
        assert!(sink(0.625, 14, 2).1.is_empty());
        // Seen again in time.
        let mut scene = Scene::new();
        scene.at(1.25, 10);
        scene.frames(&[], 3);
        for _ in 0..4 {
            assert!(scene.at(0.625, 1).is_empty());
            assert!(scene.frames(&[], 4).is_empty());
        }
        // A fall that a user has ended does not begin again.
        let mut scene = Scene::new();
        scene.at(1.25, 10);
        scene.frames(&[], 3);
        scene.at(0.625, 2);
        assert_eq!(scene.frames(&[], 10).len(), 1);
        assert!(scene.monitor.acknowledge(1));
        assert!(scene.frames(&[], 10).is_empty());
        // Into an ignored place, or into bed.
        for kind in [ZoneKind::Ignore, ZoneKind::Bed] {
            let bed = rectangle(kind, [-0.5, 2.5], [0.5, 3.5]);
            let mut scene = Scene::with(vec![bed]);
            scene.at(1.25, 10);
            scene.frames(&[], 3);
            scene.at(0.625, 2);
            scene.frames(&[person(1, [0.0, 3.0], -0.375)], 5);
            assert!(scene.frames(&[], 100).is_empty(), "{kind:?}");
        }
    }

    /// The same fall beside a bed, in it, and as the model's word in it.
    #[test]
    fn going_down_in_bed_is_no_fall() {
        for (zone_m, is_fall) in [([1.0, 2.0], true), ([-0.5, 0.5], false)] {
            let bed = rectangle(ZoneKind::Bed, [zone_m[0], 1.0], [zone_m[1], 3.0]);
            let mut scene = Scene::with(vec![bed]);
            scene.at(1.25, 10);
            scene.frames(&[], 3);
            assert_eq!(!scene.at(0.25, 10).is_empty(), is_fall, "{zone_m:?}");
            assert_eq!(scene.monitor.label(1, FALL), None);
        }
    }

    #[test]
    fn heights_at_the_limits_are_not_beyond_them() {
        // Binary fractions, so that the sums are exact; limits of 0.5 and 1.0 m.
        let run = |high_m: f32, low_m: f32| {
            let mut scene = Scene::new();
            scene.at(high_m, 10);
            scene.frames(&[], 3);
            scene.at(low_m, 10).len()
        };
        assert_eq!(run(1.125, 0.375), 1);
        assert_eq!(run(1.0, 0.375), 0);
        assert_eq!(run(1.125, 0.5), 0);
    }

    #[test]
    fn a_fall_is_confirmed_after_the_dwell_and_recovered_later() {
        let mut scene = Scene::new();
        scene.fall();
        let since = scene.frame - 2;
        // Unseen, and not tracked: down.
        let found = scene.frames(&[unseen(1, PLACE)], 20);
        assert!(found.is_empty());
        let found = scene.frames(&[], 300);
        assert_eq!(found, [(since + 200, FallState::Confirmed)]);
        assert!(scene.monitor.has_fallen());
        // Up for a second: from the first frame above 0.9 m on, which is the first one with points.
        let up = scene.frame;
        assert_eq!(scene.at(1.0, 20), [(up + 10, FallState::Recovered)]);
        assert!(!scene.monitor.has_fallen() && scene.monitor.open().is_empty());
    }

    #[test]
    fn who_rises_within_the_dwell_is_dismissed() {
        let mut scene = Scene::new();
        scene.fall();
        scene.frames(&[], 10);
        // 0.9 m itself, and less than a second above it, are not up.
        assert!(scene.at(0.875, 30).is_empty());
        // Eight frames, and two more that contain points of the eighth.
        assert!(scene.at(1.25, 8).is_empty());
        assert!(scene.at(0.875, 5).is_empty());
        scene.frames(&[], 3);
        let up = scene.frame;
        assert_eq!(scene.at(1.25, 11), [(up + 10, FallState::Dismissed)]);
        // A few frames without points do not count against it; many do.
        let mut scene = Scene::new();
        scene.fall();
        scene.frames(&[], 3);
        let up = scene.frame;
        scene.at(1.25, 4);
        scene.frames(&[], 4);
        assert_eq!(scene.at(1.25, 4), [(up + 10, FallState::Dismissed)]);
        let mut scene = Scene::new();
        scene.fall();
        scene.frames(&[], 3);
        scene.at(1.25, 4);
        scene.frames(&[], 5);
        assert!(scene.at(1.25, 8).is_empty());
    }

    #[test]
    fn rising_at_the_end_of_the_dwell_is_in_time() {
        let run = |n_down: u32| {
            let mut scene = Scene::new();
            scene.fall();
            let since = scene.frame - 2;
            scene.frames(&[], n_down);
            let found = scene.at(1.25, 30);
            found
                .into_iter()
                .map(|(at, state)| (at - since, state))
                .collect::<Vec<_>>()
        };
        // Frame 200 after the suspicion is 20 s after it.
        assert_eq!(run(188), [(200, FallState::Dismissed)]);
        assert_eq!(
            run(189),
            [(200, FallState::Confirmed), (201, FallState::Recovered)]
        );
    }

    #[test]
    fn the_word_of_the_model_counts_below_seventy_centimetres() {
        let mut scene = Scene::new();
        // Slowly down: no suspicion by height.
        assert!(scene.at(0.6, 30).is_empty());
        assert_eq!(scene.monitor.label(1, "lie_down"), None);
        assert_eq!(scene.monitor.label(2, "fall"), None);
        let event = scene.monitor.label(1, "fall").unwrap();
        assert_eq!(
            (event.state, event.fall, event.person),
            (FallState::Suspected, 1, 1)
        );
        assert_eq!(
            scene.monitor.label(1, "fall"),
            None,
            "the fall is known already"
        );
        assert!(scene.monitor.acknowledge(1) && !scene.monitor.acknowledge(1));
        // Not when the person is higher, nor when the height is old.
        let mut scene = Scene::new();
        scene.at(0.75, 30);
        assert_eq!(scene.monitor.label(1, "fall"), None);
        scene.at(0.6, 30);
        scene.frames(&[unseen(1, PLACE)], 23);
        assert_eq!(scene.monitor.label(1, "fall"), None);
        // Not of a window that still contains a fall that has ended.
        let mut scene = Scene::new();
        scene.fall();
        scene.frames(&[], 3);
        assert_eq!(scene.at(1.25, 11).len(), 1);
        scene.at(0.6, 60);
        assert_eq!(scene.monitor.label(1, "fall"), None);
        scene.at(0.6, 1);
        assert!(scene.monitor.label(1, "fall").is_some());
    }

    #[test]
    fn a_fall_that_a_user_ended_at_once_is_not_suspected_again() {
        let mut scene = Scene::new();
        scene.fall();
        assert!(scene.monitor.acknowledge(1));
        // Still within a second of the drop, and still down.
        assert!(scene.at(0.2, 58).is_empty());
        // Whoever is down does not fall, whatever the model says.
        scene.at(0.2, 30);
        assert_eq!(scene.monitor.label(1, "fall"), None);
        // Noise of a few frames is no rising, neither of the same number nor of a new one at the same place.
        for number in [1, 2] {
            for _ in 0..3 {
                scene.frames(&[at_height(number, 1.5)], 3);
                assert!(scene.frames(&[at_height(number, 0.2)], 8).is_empty());
                scene.frames(&[unseen(number, PLACE)], 3);
            }
        }
        // The former number, after the tracker has given a new one: it sank and is not seen any more.
        let mut scene = Scene::new();
        scene.fall();
        assert!(scene.monitor.acknowledge(1));
        assert!(scene.frames(&[at_height(2, 0.2)], 50).is_empty());
        // The same without a user's word.
        let mut scene = Scene::new();
        scene.fall();
        assert!(scene.frames(&[at_height(2, 0.2)], 50).is_empty());
        assert_eq!(scene.monitor.open()[0].person, 2);
        // Whoever rises and falls again is suspected again.
        let mut scene = Scene::new();
        scene.fall();
        assert!(scene.monitor.acknowledge(1));
        scene.frames(&[], 3);
        scene.fall();
        // Nobody is remembered who is not tracked any more.
        scene.frames(&[], 150);
        assert!(scene.monitor.acknowledge(2) && !scene.monitor.acknowledge(2));
    }

    #[test]
    fn who_leaves_through_a_door_has_risen_but_not_who_fell_in_it() {
        let mut scene = Scene::new();
        scene.fall();
        let events = scene.push(&[], &[1]);
        assert_eq!(events[0].state, FallState::Dismissed);
        let door = rectangle(ZoneKind::Door, [-0.5, 1.5], [0.5, 2.5]);
        let mut scene = Scene::with(vec![door]);
        scene.fall();
        assert!(scene.push(&[], &[1]).is_empty());
        assert_eq!(scene.frames(&[], 250).len(), 1);
    }

    #[test]
    fn who_gets_up_with_a_new_number_has_recovered_but_a_helper_is_somebody_else() {
        let mut scene = Scene::new();
        scene.fall();
        scene.frames(&[], 250);
        // A helper appears 3 m away and comes near.
        let helper = |y: f64| person(2, [0.0, y], 0.5);
        scene.frames(&[helper(5.0)], 10);
        assert!(scene.frames(&[helper(2.2)], 30).is_empty());
        // Lost and found again near the fallen person, with the former number.
        scene.frames(&[], 150);
        assert!(scene.frames(&[helper(2.2)], 30).is_empty());
        let up = scene.frame;
        let found = scene.frames(&[helper(3.0), at_height(3, 1.5)], 30);
        assert_eq!(found, [(up + 10, FallState::Recovered)]);
        // The event speaks of the new number.
        assert!(scene.monitor.open().is_empty());
    }

    /// Somebody of 1.5 m at a place.
    fn upright(number: u32, place_m: [f64; 2]) -> PersonFrame {
        person(number, place_m, 1.5 - RADAR_M as f32)
    }

    #[test]
    fn the_only_person_who_is_up_elsewhere_for_long_has_risen_but_a_visitor_is_somebody_else() {
        let mut scene = Scene::new();
        scene.fall();
        assert_eq!(scene.frames(&[], 250).len(), 1);
        // 2.5 m away, twice for less than 20 s, with more than 30 s between.
        let elsewhere = [0.0, 4.5];
        assert!(scene.frames(&[upright(2, elsewhere)], 150).is_empty());
        assert!(scene.frames(&[], 320).is_empty());
        assert!(scene.frames(&[upright(3, elsewhere)], 150).is_empty());
        assert!(scene.frames(&[], 320).is_empty());
        // Up after 1 s, and for 20 s from this frame on, which counts itself.
        let up = scene.frame;
        let found = scene.frames(&[upright(4, elsewhere)], 250);
        assert_eq!(found, [(up + 209, FallState::Recovered)]);
        // The same for somebody who came in by a door.
        let door = rectangle(ZoneKind::Door, [-0.5, 4.0], [0.5, 5.0]);
        let mut scene = Scene::with(vec![door]);
        scene.fall();
        assert_eq!(scene.frames(&[], 250).len(), 1);
        assert!(scene.frames(&[upright(2, elsewhere)], 600).is_empty());
        // When the visitor has left, the person gets up elsewhere.
        scene.push(&[], &[2]);
        scene.frames(&[], 20);
        let up = scene.frame;
        let found = scene.frames(&[upright(3, [1.5, 3.0])], 250);
        assert_eq!(found, [(up + 209, FallState::Recovered)]);
    }

    #[test]
    fn with_others_only_who_rises_at_the_place_of_the_fall_ends_it() {
        let other = |number: u32| upright(number, [-1.8, 2.0]);
        let mut scene = Scene::new();
        scene.frames(&[at_height(1, 1.5), other(2)], 20);
        let found = scene.frames(&[at_height(1, 0.2), other(2)], 5);
        assert_eq!(found, [(23, FallState::Suspected)]);
        // The tracker gives the number of the person who lies to the other one.
        let found = scene.frames(&[other(1)], 250);
        assert_eq!(found, [(223, FallState::Confirmed)]);
        assert_eq!(scene.monitor.open()[0].tracked_as(), None);
        // That one may fall, too.
        scene.frames(&[other(1)], 3);
        let lies = person(1, [-1.8, 2.0], 0.2 - RADAR_M as f32);
        let found = scene.frames(std::slice::from_ref(&lies), 5);
        assert_eq!(found.len(), 1);
        assert_eq!(scene.monitor.open().len(), 2);
        // Whoever rises where the first one lies is the first one.
        let up = scene.frame;
        let found = scene.frames(&[lies, at_height(3, 1.5)], 30);
        assert_eq!(found, [(up + 10, FallState::Recovered)]);
        assert_eq!(scene.monitor.open()[0].tracked_as(), Some(1));
    }

    /// As the tracker did it in a scene of two people: the estimate of somebody who lies unseen goes over to somebody who
    /// passes 1.7 m away.
    #[test]
    fn a_track_that_goes_over_to_somebody_else_has_not_risen() {
        let other = |y_m: f64| upright(2, [-1.65, y_m]);
        let mut scene = Scene::new();
        scene.frames(&[at_height(1, 1.5), other(4.0)], 20);
        let found = scene.frames(&[at_height(1, 0.2), other(3.0)], 5);
        assert_eq!(found, [(23, FallState::Suspected)]);
        scene.frames(&[unseen(1, PLACE), other(2.0)], 10);
        let mut found = Vec::new();
        for x_m in [
            -0.8, -1.1, -1.3, -1.4, -1.5, -1.55, -1.6, -1.6, -1.65, -1.65,
        ] {
            found.extend(scene.push(&[upright(1, [x_m, 2.0])], &[]));
        }
        assert!(found.is_empty(), "{found:?}");
        let found = scene.frames(&[upright(1, [-1.65, 2.0])], 100);
        assert!(found.is_empty(), "{found:?}");
        assert_eq!(scene.monitor.open()[0].tracked_as(), None);
    }

    #[test]
    fn who_walks_has_risen_also_where_the_heights_are_too_small() {
        // Steps of 5 cm at 10 Hz: 1.5 m within 3 s. At a height of 0.7 m, then of somebody who crawls, then more slowly.
        let walk = |height_m: f32, step_m: f64| {
            let mut scene = Scene::new();
            scene.fall();
            let mut found = Vec::new();
            let began = scene.frame;
            for n in 1..=60_u32 {
                let place_m = [0.0, PLACE[1] + step_m * f64::from(n)];
                let one = person(1, place_m, height_m - RADAR_M as f32);
                let states = scene.push(&[one], &[]);
                found.extend(
                    states
                        .iter()
                        .map(|event| (scene.frame - 1 - began, event.state)),
                );
            }
            found
        };
        let found = walk(0.7, 0.055);
        assert!(
            matches!(found[..], [(at, FallState::Dismissed)] if (25..=31).contains(&at)),
            "{found:?}"
        );
        assert!(walk(0.5, 0.055).is_empty());
        assert!(walk(0.7, 0.03).is_empty());
    }

    #[test]
    fn falls_of_an_earlier_run_stay_open_until_somebody_rises_there() {
        let earlier = |fall, is_confirmed, age_s| EarlierFall {
            fall,
            person: 7,
            is_confirmed,
            age_s,
            place_m: PLACE,
        };
        // The first frame of this run is at a time of its own.
        let mut monitor = Scene::new().monitor;
        monitor.restore(&[earlier(3, true, 60.0)]);
        assert!(monitor.has_fallen());
        assert!(monitor.push(5_000.0, &[], &[]).is_empty());
        assert_eq!(monitor.open()[0].since_s, 4_940.0);
        // One that was suspected is confirmed when the dwell has passed.
        let mut scene = Scene::new();
        scene.monitor.restore(&[earlier(5, false, 10.0)]);
        assert_eq!(scene.frames(&[], 150), [(100, FallState::Confirmed)]);
        // Numbers begin anew, and the next fall has a number of its own.
        let up = scene.frame;
        let found = scene.frames(&[at_height(1, 1.5)], 11);
        assert_eq!(found, [(up + 10, FallState::Recovered)]);
        scene.frames(&[], 3);
        scene.fall();
        assert_eq!(scene.monitor.open()[0].fall, 6);
        // A user may end it as any other.
        let mut scene = Scene::new();
        scene.monitor.restore(&[earlier(3, true, 60.0)]);
        scene.frames(&[], 5);
        assert!(scene.monitor.acknowledge(3) && scene.monitor.open().is_empty());
    }

    #[test]
    fn ignored_places_have_no_falls_and_empty_frames_no_heights() {
        let bed = rectangle(ZoneKind::Ignore, [-0.5, 1.5], [0.5, 2.5]);
        let mut scene = Scene::with(vec![bed]);
        scene.at(1.5, 10);
        assert!(scene.at(0.2, 300).is_empty());
        let mut scene = Scene::new();
        assert!(scene.frames(&[], 100).is_empty());
        let nowhere = person(1, [f64::NAN; 2], 0.5);
        assert!(scene.frames(&[nowhere], 10).is_empty());
        assert!(
            scene
                .monitor
                .push(f64::NAN, &[at_height(1, 1.5)], &[])
                .is_empty()
        );
        assert!(scene.monitor.bodies.is_empty());
        let mut nan = at_height(1, 1.5);
        nan.points.iter_mut().for_each(|p| p.z_m = f32::NAN);
        scene.frames(&[nan], 10);
        assert_eq!(scene.monitor.height_m(1), None);
        for wrong in [f64::NAN, 0.95, 0.0] {
            let options = FallOptions {
                fall_height_m: wrong,
                ..FallOptions::default()
            };
            let error = FallMonitor::new(options, RADAR_M, Zones::default()).unwrap_err();
            assert_eq!(error.field, "fall_height_m");
        }
    }

    #[test]
    fn a_day_of_frames_does_not_grow_the_monitor() {
        let mut scene = Scene::new();
        let mut n_suspected = 0;
        // Every 20 s somebody new falls 3 m from the last one, is not seen any more and never gets up.
        for turn in 0..4_320u32 {
            let at = |height_m: f32| {
                let mut one = at_height(turn + 1, height_m);
                one.place_m = [3.0 * f64::from(turn % 100), 2.0];
                [one]
            };
            scene.frames(&at(1.5), 10);
            let found = scene.frames(&at(0.2), 10);
            n_suspected += found
                .iter()
                .filter(|(_, s)| *s == FallState::Suspected)
                .count();
            scene.frames(&[], 180);
            let monitor = &scene.monitor;
            assert!(monitor.bodies.len() <= 1 && monitor.open.len() <= MAX_OPEN);
            assert!(monitor.bodies.values().all(|b| b.recent.len() <= 4));
        }
        assert_eq!(n_suspected, 4_320);
    }
}
