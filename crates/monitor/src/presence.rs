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
//!
//! A person who sits still has no points, and the tracker forgets the person; this is why occupancy is held. Of each
//! person who disappeared it is known whether it was in a door. Whoever appears outside of the doors is one of those who
//! disappeared, as far as there are any.

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
}

/// A person who is tracked and counts.
#[derive(Clone, Copy, Debug)]
struct Inside {
    since_s: f64,
    /// Where the person was last detected.
    seen_m: [f64; 2],
}

/// A person who disappeared, but not in a door.
#[derive(Clone, Copy, Debug)]
struct Missing {
    person: u32,
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
        let before = self.presence;
        self.presence = self.next();
        if !self.presence.is_occupied() {
            self.missing.clear();
        }
        self.update(before, left)
    }

    /// A person is known to be there at `t_s` though unseen, for example because of a fall that has not ended: the hold
    /// time of this person starts again.
    pub fn hold(&mut self, t_s: f64, person: u32) {
        for missing in self.missing.iter_mut().filter(|m| m.person == person) {
            if t_s.is_finite() {
                missing.since_s = missing.since_s.max(t_s);
            }
        }
    }

    /// Points of somebody stay together at `t_s`, though nobody is tracked: somebody is there, for the hold time.
    pub fn notice(&mut self, t_s: f64, place_m: [f64; 2]) -> PresenceUpdate {
        let before = self.presence;
        if t_s.is_finite() && self.zones.counts(place_m) {
            self.now_s = self.now_s.max(t_s);
            self.missing.retain(|m| m.person != UNTRACKED);
            self.missing.push(Missing {
                person: UNTRACKED,
                since_s: self.now_s,
                seen_m: place_m,
            });
            if !before.is_occupied() {
                self.presence = Presence::Held;
            }
        }
        self.update(before, Vec::new())
    }

    /// Forgets everybody, as after the radar was silent: what happened meanwhile is unknown.
    pub fn reset(&mut self) -> PresenceUpdate {
        let before = self.presence;
        self.presence = Presence::Absent;
        self.inside.clear();
        self.missing.clear();
        self.update(before, Vec::new())
    }

    /// Removes those who are not tracked any more. Returns those who left through a door.
    fn disappear(&mut self, counting: &[&PersonFrame]) -> Vec<u32> {
        let there: BTreeSet<u32> = counting.iter().map(|p| p.person).collect();
        let mut left = Vec::new();
        let (zones, missing) = (&self.zones, &mut self.missing);
        let (now_s, is_occupied) = (self.now_s, self.presence.is_occupied());
        self.inside.retain(|&person, inside| {
            let stays = there.contains(&person);
            if !stays && zones.is_door(inside.seen_m) {
                left.push(person);
            } else if !stays && is_occupied {
                missing.push(Missing {
                    person,
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
            let is_seen = !one.points.is_empty();
            if let Some(inside) = self.inside.get_mut(&one.person) {
                if is_seen {
                    inside.seen_m = one.place_m;
                }
                continue;
            }
            let inside = Inside {
                since_s: self.now_s,
                seen_m: one.place_m,
            };
            self.inside.insert(one.person, inside);
            if let Some(found) = self.who_is_back(one) {
                self.missing.remove(found);
            }
        }
    }

    /// The one of those who disappeared who is a person that appeared now.
    fn who_is_back(&self, one: &PersonFrame) -> Option<usize> {
        let same = self.missing.iter().position(|m| m.person == one.person);
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
        } else if is_occupied && !self.missing.is_empty() {
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

    #[test]
    fn who_fell_is_held_until_the_fall_ends() {
        let mut monitor = monitor();
        run(&mut monitor, [0, 20], &[person(1, ROOM, 0.0)]);
        for i in 20..1_000 {
            let t_s = f64::from(i) * 0.1;
            for nothing in [f64::NAN, f64::INFINITY] {
                monitor.hold(nothing, 1);
            }
            monitor.hold(t_s, 1);
            monitor.hold(t_s, 2);
            assert_eq!(monitor.push(t_s, &[]).presence, Presence::Held);
        }
        // 30 s after the last time, in frame 999.
        let found = run(&mut monitor, [1_000, 1_500], &[]);
        assert_eq!(found, [(1_299, Presence::Absent)]);
        // Who is absent stays so.
        monitor.hold(151.0, 1);
        assert_eq!(monitor.push(151.0, &[]).presence, Presence::Absent);
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
