//! Whether somebody is there.
//!
//! | from | to | when |
//! |---|---|---|
//! | absent | present | somebody has been tracked for `occupancy_on_s` |
//! | present | held | nobody is tracked any more, and somebody did not leave through a door |
//! | held | present | somebody is tracked again |
//! | absent | held | points of somebody stay together, though nobody can be tracked |
//! | held | absent | `occupancy_hold_s` have passed since nobody is tracked |
//! | present | absent | everybody left through a door |
//! | any | held | somebody fell, has not risen and is not tracked |
//!
//! A person who sits still has no points, and the tracker forgets the person; this is why occupancy is held. Of each
//! person who disappeared it is known whether it was in a door. Whoever appears outside of the doors is one of those who
//! disappeared, as far as there are any; somebody else is remembered only after having been tracked for `occupancy_on_s`.

use std::collections::{BTreeMap, BTreeSet};

use crate::options::{OptionError, has_passed, within};
use crate::people::{PersonFrame, UNTRACKED};
use crate::zones::Zones;

/// Most people who are remembered after they disappeared. A room of a radar has fewer.
const MAX_MISSING: usize = 64;

/// Options of presence.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PresenceOptions {
    /// Time for which a person is tracked before somebody is present, s.
    pub occupancy_on_s: f64,
    /// Time for which occupancy is held while nobody is tracked, s. People who sit still move enough for a radar within
    /// this time.
    pub occupancy_hold_s: f64,
}

impl Default for PresenceOptions {
    fn default() -> Self {
        Self {
            occupancy_on_s: 1.0,
            occupancy_hold_s: 30.0,
        }
    }
}

impl PresenceOptions {
    /// Checks every field.
    ///
    /// # Errors
    /// Names the first field that is out of range.
    pub fn validate(&self) -> Result<(), OptionError> {
        within(
            "occupancy_on_s",
            self.occupancy_on_s,
            [0.0, 3_600.0],
            "0 to 3600 s",
        )?;
        within(
            "occupancy_hold_s",
            self.occupancy_hold_s,
            [0.0, 86_400.0],
            "0 to 86400 s",
        )
    }
}

/// Whether somebody is there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Presence {
    /// Nobody.
    #[default]
    Absent,
    /// Somebody is tracked.
    Present,
    /// Nobody is tracked, but somebody was and did not leave through a door.
    Held,
}

impl Presence {
    /// Whether the room counts as occupied.
    pub fn is_occupied(self) -> bool {
        self != Self::Absent
    }
}

/// Presence after a frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PresenceUpdate {
    /// Whether somebody is there.
    pub presence: Presence,
    /// Whether this is different from before.
    pub has_changed: bool,
    /// Number of people who are tracked and count.
    pub n_tracked: usize,
    /// Number of people who are held: they disappeared elsewhere than in a door.
    pub n_held: usize,
    /// Number of these who fell and have not risen.
    pub n_fallen: usize,
    /// People who have just left through a door.
    pub left: Vec<u32>,
}

/// Watches presence, frame by frame.
#[derive(Clone, Debug)]
pub struct PresenceMonitor {
    options: PresenceOptions,
    zones: Zones,
    presence: Presence,
    now_s: f64,
    inside: BTreeMap<u32, Inside>,
    missing: Vec<Missing>,
    fallen: Vec<Fallen>,
}

/// Somebody who fell and has not risen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fallen {
    /// Number of the fall.
    pub fall: u64,
    /// Number under which the person may be tracked, if there is one.
    pub person: Option<u32>,
    /// Where the person fell, m.
    pub place_m: [f64; 2],
}

/// A person who is tracked and counts.
#[derive(Clone, Copy, Debug)]
struct Inside {
    since_s: f64,
    /// Whether somebody who disappeared is back: noise that is tracked for a moment is nobody.
    is_back: bool,
    /// Where the person was last detected.
    seen_m: [f64; 2],
}

/// A person who disappeared, but not in a door.
#[derive(Clone, Copy, Debug)]
struct Missing {
    /// Number of the track that the person had, if it had one.
    person: Option<u32>,
    /// Number of the fall after which the person lies.
    fall: Option<u64>,
    since_s: f64,
    seen_m: [f64; 2],
}

impl PresenceMonitor {
    /// Nobody is there yet.
    ///
    /// # Errors
    /// If an option is out of range.
    pub fn new(options: PresenceOptions, zones: Zones) -> Result<Self, OptionError> {
        options.validate()?;
        Ok(Self {
            options,
            zones,
            presence: Presence::Absent,
            now_s: 0.0,
            inside: BTreeMap::new(),
            missing: Vec::new(),
            fallen: Vec::new(),
        })
    }

    /// Whether somebody is there.
    pub fn presence(&self) -> Presence {
        self.presence
    }

    /// The tracked people of the next frame, at `t_s`. A frame whose time is no number changes nothing; time does not go
    /// back.
    pub fn push(&mut self, t_s: f64, people: &[PersonFrame]) -> PresenceUpdate {
        if !t_s.is_finite() {
            return self.update(self.presence, Vec::new());
        }
        self.now_s = self.now_s.max(t_s);
        let zones = &self.zones;
        let counting = people.iter().filter(|p| zones.counts(p.place_m));
        let counting: Vec<&PersonFrame> = counting.collect();
        let left = self.disappear(&counting);
        self.appear(&counting);
        self.keep_fallen();
        let before = self.presence;
        self.presence = self.next();
        if !self.presence.is_occupied() {
            self.missing.clear();
        }
        self.update(before, left)
    }

    /// Those who fell and have not risen: whoever of them is not tracked is there all the same, from the next frame on. When a
    /// fall ends, the hold time of this person begins.
    pub fn hold(&mut self, fallen: Vec<Fallen>) {
        self.fallen = fallen;
    }

    /// As [`Self::hold`], with the numbers of people of an update that was made before.
    pub fn recount(&mut self, fallen: Vec<Fallen>, update: &mut PresenceUpdate) {
        self.hold(fallen);
        self.keep_fallen();
        let counted = self.update(self.presence, Vec::new());
        (update.n_held, update.n_fallen) = (counted.n_held, counted.n_fallen);
    }

    /// Points of somebody stay together at `t_s`, though nobody is tracked: somebody is there, for the hold time.
    pub fn notice(&mut self, t_s: f64, place_m: [f64; 2]) -> PresenceUpdate {
        let before = self.presence;
        if t_s.is_finite() && self.zones.counts(place_m) {
            self.now_s = self.now_s.max(t_s);
            self.missing.retain(|m| m.person != Some(UNTRACKED));
            self.missing.push(Missing {
                person: Some(UNTRACKED),
                fall: None,
                since_s: self.now_s,
                seen_m: place_m,
            });
            if !before.is_occupied() {
                self.presence = Presence::Held;
            }
        }
        self.update(before, Vec::new())
    }

    /// Forgets everybody but those who fell and have not risen, as after the radar was silent: what happened meanwhile is
    /// unknown.
    pub fn reset(&mut self) -> PresenceUpdate {
        let before = self.presence;
        self.inside.clear();
        self.missing.clear();
        self.presence = Presence::Absent;
        self.keep_fallen();
        self.presence = self.next();
        self.update(before, Vec::new())
    }

    /// Removes those who are not tracked any more. Returns those who left through a door.
    fn disappear(&mut self, counting: &[&PersonFrame]) -> Vec<u32> {
        let there: BTreeSet<u32> = counting.iter().map(|p| p.person).collect();
        let mut left = Vec::new();
        let (zones, missing) = (&self.zones, &mut self.missing);
        let (now_s, is_occupied) = (self.now_s, self.presence.is_occupied());
        let on_s = self.options.occupancy_on_s;
        // Whoever fell in a door disappears there without having left.
        let lies_in_door = |person: u32| {
            let mut fallen = self.fallen.iter().filter(|f| f.person == Some(person));
            fallen.any(|fallen| zones.is_door(fallen.place_m))
        };
        self.inside.retain(|&person, inside| {
            let stays = there.contains(&person);
            if !stays && zones.is_door(inside.seen_m) && !lies_in_door(person) {
                left.push(person);
            } else if !stays
                && is_occupied
                && (inside.is_back || has_passed(inside.since_s, now_s, on_s))
            {
                missing.push(Missing {
                    person: Some(person),
                    fall: None,
                    since_s: now_s,
                    seen_m: inside.seen_m,
                });
            }
            stays
        });
        let hold_s = self.options.occupancy_hold_s;
        missing.retain(|m| !has_passed(m.since_s, now_s, hold_s));
        let too_many = missing.len().saturating_sub(MAX_MISSING);
        missing.drain(..too_many);
        left
    }

    fn appear(&mut self, counting: &[&PersonFrame]) {
        for one in counting {
            let is_seen = !one.points.is_empty() || one.board.is_some();
            if let Some(inside) = self.inside.get_mut(&one.person) {
                if is_seen {
                    inside.seen_m = one.place_m;
                }
                continue;
            }
            let back = self.who_is_back(one);
            if let Some(found) = back {
                self.missing.remove(found);
            }
            let inside = Inside {
                since_s: self.now_s,
                is_back: back.is_some(),
                seen_m: one.place_m,
            };
            self.inside.insert(one.person, inside);
        }
    }

    /// Whoever fell is missing as long as the fall is open and nobody is tracked under the person's number.
    fn keep_fallen(&mut self) {
        let (now_s, inside, all) = (self.now_s, &self.inside, &self.fallen);
        for missing in &mut self.missing {
            let is_open = |fall: &u64| all.iter().any(|fallen| fallen.fall == *fall);
            missing.fall = missing.fall.filter(is_open);
        }
        for fallen in all {
            let Fallen {
                fall,
                person,
                place_m,
            } = *fallen;
            let of_fall =
                |m: &Missing| m.fall == Some(fall) || (person.is_some() && m.person == person);
            if person.is_some_and(|person| inside.contains_key(&person)) {
                self.missing.retain(|m| m.fall != Some(fall));
            } else if let Some(missing) = self.missing.iter_mut().find(|m| of_fall(m)) {
                (missing.fall, missing.since_s) = (Some(fall), now_s);
            } else {
                self.missing.push(Missing {
                    person,
                    fall: Some(fall),
                    since_s: now_s,
                    seen_m: place_m,
                });
            }
        }
    }

    /// The one of those who disappeared who is a person that appeared now.
    fn who_is_back(&self, one: &PersonFrame) -> Option<usize> {
        let mut missing = self.missing.iter();
        let same = missing.position(|m| m.person == Some(one.person));
        if same.is_some() || self.zones.is_door(one.place_m) {
            return same;
        }
        let apart_m =
            |m: &Missing| (m.seen_m[0] - one.place_m[0]).hypot(m.seen_m[1] - one.place_m[1]);
        let all = self.missing.iter().map(apart_m).enumerate();
        all.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(i, _)| i)
    }

    fn next(&self) -> Presence {
        let (now_s, on_s) = (self.now_s, self.options.occupancy_on_s);
        let is_occupied = self.presence.is_occupied();
        let mut inside = self.inside.values();
        if inside.any(|one| is_occupied || has_passed(one.since_s, now_s, on_s)) {
            Presence::Present
        } else if !self.fallen.is_empty() || (is_occupied && !self.missing.is_empty()) {
            Presence::Held
        } else {
            Presence::Absent
        }
    }

    fn update(&self, before: Presence, left: Vec<u32>) -> PresenceUpdate {
        PresenceUpdate {
            presence: self.presence,
            has_changed: self.presence != before,
            n_tracked: self.inside.len(),
            n_held: self.missing.len(),
            n_fallen: self.missing.iter().filter(|m| m.fall.is_some()).count(),
            left,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::people::tests::{person, unseen};
    use crate::zones::ZoneKind;
    use crate::zones::tests::rectangle;

    const ROOM: [f64; 2] = [0.0, 2.0];
    const DOOR: [f64; 2] = [2.2, 2.5];

    fn monitor() -> PresenceMonitor {
        let zones = vec![
            rectangle(ZoneKind::Door, [2.0, 2.0], [2.5, 3.0]),
            rectangle(ZoneKind::Ignore, [-2.0, 4.0], [-1.0, 5.0]),
        ];
        PresenceMonitor::new(PresenceOptions::default(), Zones::new(zones).unwrap()).unwrap()
    }

    /// Pushes the frames `from..until` at 10 Hz. Returns the changes with the number of their frame.
    fn run(
        monitor: &mut PresenceMonitor,
        [from, until]: [u32; 2],
        people: &[PersonFrame],
    ) -> Vec<(u32, Presence)> {
        let updates = (from..until).map(|i| (i, monitor.push(f64::from(i) * 0.1, people)));
        let changes = updates.filter(|(_, u)| u.has_changed);
        changes.map(|(i, u)| (i, u.presence)).collect()
    }

    #[test]
    fn present_after_a_second_and_held_for_thirty() {
        let mut monitor = monitor();
        let found = run(&mut monitor, [0, 100], &[person(1, ROOM, 0.0)]);
        assert_eq!(found, [(10, Presence::Present)]);
        // Tracked without points is still present.
        assert!(run(&mut monitor, [100, 120], &[unseen(1, ROOM)]).is_empty());
        let found = run(&mut monitor, [120, 500], &[]);
        assert_eq!(found, [(120, Presence::Held), (420, Presence::Absent)]);
    }

    #[test]
    fn who_is_back_within_the_hold_time_is_present_at_once() {
        let mut monitor = monitor();
        run(&mut monitor, [0, 20], &[person(1, ROOM, 0.0)]);
        run(&mut monitor, [20, 319], &[]);
        assert_eq!(monitor.presence(), Presence::Held);
        let update = monitor.push(31.9, &[person(2, ROOM, 0.0)]);
        assert_eq!((update.presence, update.n_held), (Presence::Present, 0));
    }

    #[test]
    fn who_cannot_be_tracked_is_held() {
        let mut monitor = monitor();
        run(&mut monitor, [0, 10], &[]);
        let update = monitor.notice(1.0, ROOM);
        assert_eq!(
            (update.presence, update.has_changed),
            (Presence::Held, true)
        );
        run(&mut monitor, [10, 30], &[]);
        let update = monitor.notice(3.0, ROOM);
        assert_eq!((update.has_changed, update.n_held), (false, 1));
        // Thirty seconds after the last notice, unless the same person is tracked.
        let found = run(&mut monitor, [30, 340], &[]);
        assert_eq!(found, [(330, Presence::Absent)]);
        monitor.notice(34.0, ROOM);
        let update = monitor.push(34.1, &[person(1, ROOM, 0.0)]);
        assert_eq!((update.presence, update.n_held), (Presence::Present, 0));
        // A fan in a zone that does not count.
        let mut monitor = self::monitor();
        assert_eq!(monitor.notice(1.0, [-1.5, 4.5]).presence, Presence::Absent);
    }

    #[test]
    fn a_flicker_is_nobody() {
        let mut monitor = monitor();
        // Different people of 0.9 s each, one after the other.
        for i in 0..10 {
            let people = [person(i + 1, ROOM, 0.0)];
            assert!(run(&mut monitor, [10 * i, 10 * i + 10], &people).is_empty());
        }
        assert!(run(&mut monitor, [100, 110], &[]).is_empty());
        // Beside somebody, it is not remembered either; whoever was there for longer is.
        let held_after = |n: u32| {
            let mut monitor = self::monitor();
            run(&mut monitor, [0, 50], &[person(1, ROOM, 0.0)]);
            let beside = [person(1, ROOM, 0.0), person(2, [-1.0, 3.0], 0.0)];
            run(&mut monitor, [50, 50 + n], &beside);
            let end_s = f64::from(50 + n) * 0.1;
            monitor.push(end_s, &[person(1, ROOM, 0.0)]).n_held
        };
        assert_eq!([held_after(3), held_after(20)], [0, 1]);
        // Somebody who sits and is seen for a moment every 20 s is there.
        let mut monitor = self::monitor();
        run(&mut monitor, [0, 20], &[person(1, ROOM, 0.0)]);
        for i in 1..10 {
            let at = 200 * i;
            run(&mut monitor, [at - 180, at], &[]);
            assert_eq!(monitor.presence(), Presence::Held);
            run(&mut monitor, [at, at + 3], &[person(i + 1, ROOM, 0.0)]);
            run(&mut monitor, [at + 3, at + 20], &[]);
        }
    }

    #[test]
    fn through_a_door_is_absent_at_once() {
        let mut monitor = monitor();
        run(&mut monitor, [0, 20], &[person(1, ROOM, 0.0)]);
        run(&mut monitor, [20, 25], &[person(1, DOOR, 0.0)]);
        // The estimate runs on without points; what counts is where the person was seen.
        run(&mut monitor, [25, 40], &[unseen(1, [3.5, 2.5])]);
        let update = monitor.push(4.0, &[]);
        assert_eq!(
            (update.presence, update.has_changed),
            (Presence::Absent, true)
        );
        assert_eq!((update.left, update.n_held), (vec![1], 0));
        // An estimate that runs into the door is no exit.
        run(&mut monitor, [50, 70], &[person(2, ROOM, 0.0)]);
        run(&mut monitor, [70, 80], &[unseen(2, DOOR)]);
        let update = monitor.push(8.0, &[]);
        assert_eq!((update.presence, update.left.len()), (Presence::Held, 0));
    }

    #[test]
    fn one_leaves_and_another_sits_still() {
        let mut monitor = monitor();
        run(
            &mut monitor,
            [0, 20],
            &[person(1, ROOM, 0.0), person(2, ROOM, 0.0)],
        );
        // The first sits still; the second leaves.
        run(&mut monitor, [20, 40], &[person(2, DOOR, 0.0)]);
        let update = monitor.push(4.0, &[]);
        assert_eq!((update.presence, update.n_held), (Presence::Held, 1));
        assert_eq!(update.left, [2]);
        // Somebody comes in by the door and leaves again: the first is still there.
        run(&mut monitor, [41, 60], &[person(3, DOOR, 0.0)]);
        let update = monitor.push(6.0, &[]);
        assert_eq!((update.presence, update.n_held), (Presence::Held, 1));
        // The first moves again, has a new number and leaves: nobody is held.
        run(&mut monitor, [61, 80], &[person(4, ROOM, 0.0)]);
        run(&mut monitor, [80, 90], &[person(4, DOOR, 0.0)]);
        assert_eq!(monitor.push(9.0, &[]).presence, Presence::Absent);
    }

    fn fallen(person: Option<u32>, place_m: [f64; 2]) -> Vec<Fallen> {
        vec![Fallen {
            fall: 1,
            person,
            place_m,
        }]
    }

    #[test]
    fn who_fell_is_held_until_the_fall_ends() {
        let mut monitor = monitor();
        run(&mut monitor, [0, 20], &[person(1, ROOM, 0.0)]);
        monitor.hold(fallen(Some(1), ROOM));
        assert_eq!(monitor.push(2.0, &[]).presence, Presence::Held);
        assert!(run(&mut monitor, [21, 999], &[]).is_empty());
        let update = monitor.push(99.9, &[]);
        assert_eq!((update.n_held, update.n_fallen), (1, 1));
        // 30 s after the last frame in which the fall was open, which is frame 999.
        monitor.hold(Vec::new());
        let found = run(&mut monitor, [1_000, 1_500], &[]);
        assert_eq!(found, [(1_299, Presence::Absent)]);
    }

    #[test]
    fn who_fell_is_there_in_a_door_beside_a_visitor_and_after_silence() {
        // In a door the person disappears without having left.
        let mut monitor = monitor();
        run(&mut monitor, [0, 20], &[person(1, DOOR, 0.0)]);
        monitor.hold(fallen(Some(1), DOOR));
        let update = monitor.push(2.0, &[]);
        assert_eq!(update.presence, Presence::Held);
        assert!(update.left.is_empty());
        // A visitor is somebody else, and leaves by the door.
        run(&mut monitor, [21, 40], &[person(2, ROOM, 0.0)]);
        let update = monitor.push(4.0, &[person(2, DOOR, 0.0)]);
        assert_eq!((update.n_tracked, update.n_held), (1, 1));
        let update = monitor.push(4.1, &[]);
        assert_eq!((update.presence, update.left), (Presence::Held, vec![2]));
        assert!(run(&mut monitor, [42, 900], &[]).is_empty());
        // The radar is silent, or the program was started anew.
        assert_eq!(monitor.reset().presence, Presence::Held);
        let mut monitor = self::monitor();
        monitor.hold(fallen(None, ROOM));
        let update = monitor.reset();
        assert_eq!(
            (update.presence, update.has_changed),
            (Presence::Held, true)
        );
        // Somebody else has the number of the person who lies.
        run(&mut monitor, [0, 20], &[person(1, ROOM, 0.0)]);
        let update = monitor.push(2.0, &[person(1, ROOM, 0.0)]);
        assert_eq!((update.presence, update.n_held), (Presence::Present, 1));
    }

    #[test]
    fn ignored_places_and_places_that_are_no_numbers_count_nobody() {
        let mut monitor = monitor();
        let fan = [-1.5, 4.5];
        assert!(run(&mut monitor, [0, 50], &[person(1, fan, 0.0)]).is_empty());
        let nowhere = [f64::NAN, 2.0];
        assert!(run(&mut monitor, [50, 90], &[person(2, nowhere, 0.0)]).is_empty());
        assert_eq!(
            run(&mut monitor, [90, 110], &[person(3, ROOM, 0.0)]).len(),
            1
        );
        // A frame at no time changes nothing, not even for a moment.
        for t_s in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let update = monitor.push(t_s, &[]);
            assert_eq!(
                (update.presence, update.has_changed),
                (Presence::Present, false)
            );
        }
        let update = monitor.reset();
        assert_eq!(
            (update.presence, update.has_changed),
            (Presence::Absent, true)
        );
        assert!(!monitor.reset().has_changed);
    }

    #[test]
    fn zero_hold_and_zero_on_are_immediate() {
        let options = PresenceOptions {
            occupancy_on_s: 0.0,
            occupancy_hold_s: 0.0,
        };
        let mut monitor = PresenceMonitor::new(options, Zones::default()).unwrap();
        assert_eq!(
            monitor.push(0.0, &[person(1, ROOM, 0.0)]).presence,
            Presence::Present
        );
        assert_eq!(monitor.push(0.1, &[]).presence, Presence::Absent);
        let options = PresenceOptions {
            occupancy_hold_s: f64::NAN,
            ..options
        };
        let error = PresenceMonitor::new(options, Zones::default()).unwrap_err();
        assert_eq!(error.field, "occupancy_hold_s");
    }

    #[test]
    fn a_day_of_frames_does_not_grow_the_monitor() {
        let options = PresenceOptions {
            occupancy_hold_s: 86_400.0,
            ..PresenceOptions::default()
        };
        let mut monitor = PresenceMonitor::new(options, Zones::default()).unwrap();
        // Two at a time, with new numbers every 5 s.
        for i in 0..864_000u32 {
            let n = i / 50;
            let people = [person(2 * n, ROOM, 0.0), person(2 * n + 1, ROOM, 0.0)];
            let there = if i % 50 < 20 {
                &people[..]
            } else {
                &people[..(n % 3) as usize]
            };
            monitor.push(f64::from(i) * 0.1, there);
            assert!(monitor.inside.len() <= 2 && monitor.missing.len() <= MAX_MISSING);
        }
        assert_eq!(monitor.presence(), Presence::Present);
    }
}
