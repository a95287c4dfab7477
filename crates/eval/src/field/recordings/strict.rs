//! The strict score: what do sentences state, by time?
//!
//! A sentence about ten seconds with two clauses states each for five. Actions of one clause share its time. An
//! activity is stated if its actions cover at least half of the recording and more than any rival; a rival is another
//! activity, or an action of no activity. A sentence that names everything states nothing.
//!
//! ```
//! use radarllm_eval::recordings::{Activity, strict::StatedTime};
//!
//! let walk = Activity { name: "walk".into(), actions: vec!["walk".into()], files: None, sides: Default::default(), says: None,
//!     judged: Default::default(),     says_of_side: Default::default() };
//! let mut time = StatedTime::default();
//! time.add("a person walks forward", 6.0);
//! time.add("a person bows, then walks", 4.0);
//! assert_eq!(time.of(&walk), 8.0);
//! assert_eq!(time.stated(&[walk.clone()], 10.0).as_deref(), Some("walk"));
//! // Most of a recording has no sentence.
//! assert_eq!(time.stated(&[walk], 20.0), None);
//! ```

use std::collections::BTreeMap;

use radarllm_facts::{Action, Direction, Side, parse};

use super::{Activity, ActivitySide};

/// Time for which sentences state each action, s.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StatedTime {
    of_action: Vec<(Action, f64)>,
}

impl StatedTime {
    /// Adds a sentence about `seconds` of a recording.
    pub fn add(&mut self, sentence: &str, seconds: f64) {
        let clauses = parse(sentence);
        for clause in &clauses {
            let share = seconds / clauses.len() as f64 / clause.actions.len().max(1) as f64;
            self.of_action
                .extend(clause.actions.iter().map(|action| (*action, share)));
        }
    }

    /// Time for which an activity is stated, s.
    pub fn of(&self, activity: &Activity) -> f64 {
        let times = self.of_action.iter();
        times
            .filter(|(action, _)| activity.is_stated_by(action))
            .map(|(_, time)| time)
            .sum()
    }

    /// Whether the sentences state the side of an activity, for longer than any other side.
    pub fn has_side(&self, activity: &Activity, side: ActivitySide) -> bool {
        let (mut own, mut other) = (0.0, 0.0);
        let times = self.of_action.iter();
        for (action, time) in times.filter(|(action, _)| activity.is_stated_by(action)) {
            match ActivitySide::of(action) {
                Some(stated) if stated == side => own += time,
                Some(_) => other += time,
                None => {}
            }
        }
        own > other
    }

    /// The activity, or the name of an action of no activity, that covers at least half of `seconds` and more than any
    /// other; `None` if there is none.
    pub fn stated(&self, activities: &[Activity], seconds: f64) -> Option<String> {
        let mut others: BTreeMap<&str, f64> = BTreeMap::new();
        for (action, time) in &self.of_action {
            if !activities
                .iter()
                .any(|activity| activity.is_stated_by(action))
            {
                *others.entry(action.name).or_default() += time;
            }
        }
        let mut times: Vec<(f64, &str)> = activities
            .iter()
            .map(|activity| (self.of(activity), activity.name.as_str()))
            .chain(others.into_iter().map(|(name, time)| (time, name)))
            .collect();
        times.sort_by(|a, b| b.0.total_cmp(&a.0));
        let (max, name) = *times.first()?;
        let second = times.get(1).map_or(0.0, |t| t.0);
        // Sums of thirds of seconds are not exact.
        let slack = 1e-6 * seconds;
        (max + slack >= 0.5 * seconds && max > second + slack).then(|| name.to_string())
    }
}

impl ActivitySide {
    /// The side of the body or of the direction that an action states.
    fn of(action: &Action) -> Option<Self> {
        match (action.side, action.direction) {
            (Some(Side::Left), _) | (None, Some(Direction::Left)) => Some(Self::Left),
            (Some(Side::Right), _) | (None, Some(Direction::Right)) => Some(Self::Right),
            (Some(Side::Both), _) => Some(Self::Both),
            _ => None,
        }
    }
}

impl Activity {
    /// Whether an action states this activity.
    fn is_stated_by(&self, action: &Action) -> bool {
        self.actions.iter().any(|own| {
            let mut words = own.split(' ');
            words.next() == Some(action.name) && words.all(|word| has_attribute(action, word))
        })
    }
}

/// Attributes that may follow the name of an action in a configuration.
pub(super) const ATTRIBUTES: [&str; 5] = ["one", "both", "forward", "backward", "sideways"];

fn has_attribute(action: &Action, word: &str) -> bool {
    match word {
        "one" => matches!(action.side, Some(Side::Left | Side::Right)),
        "both" => action.side == Some(Side::Both),
        "forward" => action.direction == Some(Direction::Forward),
        "backward" => action.direction == Some(Direction::Backward),
        "sideways" => matches!(action.direction, Some(Direction::Left | Direction::Right)),
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn activities() -> Vec<Activity> {
        [("boxing", &["punch"][..]), ("walk", &["walk", "march"])]
            .map(|(name, actions)| Activity {
                name: name.into(),
                actions: actions.iter().map(|a| (*a).into()).collect(),
                files: None,
                sides: BTreeMap::new(),
                says: None,
                judged: crate::recordings::Judged::Mostly,
                says_of_side: BTreeMap::new(),
            })
            .into()
    }

    fn stated(sentences: &[(&str, f64)], seconds: f64) -> Option<String> {
        let mut time = StatedTime::default();
        sentences
            .iter()
            .for_each(|(sentence, s)| time.add(sentence, *s));
        time.stated(&activities(), seconds)
    }

    #[test]
    fn half_of_the_time_and_more_than_any_rival() {
        let is = |sentences: &[(&str, f64)], expected: Option<&str>| {
            assert_eq!(
                stated(sentences, 10.0).as_deref(),
                expected,
                "{sentences:?}"
            );
        };
        is(&[("a person punches", 10.0)], Some("boxing"));
        is(&[("a person punches", 5.0)], Some("boxing"));
        is(&[("a person punches", 4.9)], None);
        // A tie is no answer, whether between sentences, clauses or actions of a clause.
        is(&[("a person punches", 5.0), ("a person bows", 5.0)], None);
        is(&[("a person punches, then marches", 10.0)], None);
        is(&[("a person punches while marching", 10.0)], None);
        is(
            &[("a person punches, then punches and then marches", 10.0)],
            Some("boxing"),
        );
        // The actions of one activity add up; those of none are rivals one by one.
        is(
            &[("a person walks, then marches, then bows", 10.0)],
            Some("walk"),
        );
        is(&[("a person claps", 9.0)], Some("clap"));
        is(&[], None);
    }

    #[test]
    fn attributes_separate_activities_of_one_action() {
        let arms = [
            ("one arm", "raise_arms one"),
            ("both arms", "raise_arms both"),
        ]
        .map(|(name, action)| Activity {
            name: name.into(),
            actions: vec![action.into()],
            files: None,
            sides: BTreeMap::new(),
            says: None,
            judged: crate::recordings::Judged::Mostly,
            says_of_side: BTreeMap::new(),
        });
        for (sentence, expected) in [
            ("a person raises the left arm", "one arm"),
            ("a person raises both arms", "both arms"),
            ("a person raises arms", "raise_arms"),
        ] {
            let mut time = StatedTime::default();
            time.add(sentence, 1.0);
            assert_eq!(
                time.stated(&arms, 1.0).as_deref(),
                Some(expected),
                "{sentence}"
            );
        }
    }

    #[test]
    fn a_side_is_stated_by_a_limb_or_by_a_direction() {
        let turning = Activity {
            name: "turning left".into(),
            actions: vec!["walk".into(), "turn".into(), "raise_arms".into()],
            files: None,
            sides: BTreeMap::new(),
            says: None,
            judged: crate::recordings::Judged::Mostly,
            says_of_side: BTreeMap::new(),
        };
        for (sentence, expected) in [
            ("a person walks forward, then turns to the left", true),
            ("a person raises the left arm", true),
            ("a person walks forward", false),
            ("a person turns to the right", false),
            ("a person raises both arms", false),
            // As long as the other side is no answer.
            ("a person turns to the left, then turns to the right", false),
            // Another action's side is none of this activity.
            ("a person kicks with the left leg", false),
        ] {
            let mut time = StatedTime::default();
            time.add(sentence, 1.0);
            assert_eq!(
                time.has_side(&turning, ActivitySide::Left),
                expected,
                "{sentence}"
            );
        }
    }
}
