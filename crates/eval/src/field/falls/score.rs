//! Events against the truth.

use radarllm_base::Motion;
use radarllm_monitor::falls::{FallEvent, FallState, HIGH_M};
use serde::Serialize;

use super::watch::Heights;

/// Longest time after the impact at which a suspicion is that of the fall, s.
pub(super) const LATEST_S: f64 = 3.0;
/// How far before the onset the middle of a sentence that states the fall may be, s.
const DESCRIBED_S: f64 = 1.0;
/// Share of the height of a standing person's pelvis below which the person is falling.
const FALLING_SHARE: f64 = 0.9;
/// Height of the pelvis above its lowest one below which it has arrived, m.
const ARRIVED_M: f64 = 0.05;

/// When somebody really falls.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TrueFall {
    /// Last time at which the pelvis is at 90 % of its height in the first pose, s.
    pub onset_s: f64,
    /// First time at which the pelvis is at most 5 cm above its lowest height, s.
    pub impact_s: f64,
}

impl TrueFall {
    /// The fall at the end of a motion that begins upright.
    pub fn of(motion: &Motion) -> Self {
        let pelvis = |i: usize| f64::from(motion.poses[i].root_in_world.z);
        let n = motion.poses.len();
        let lowest_m = (0..n).map(pelvis).fold(f64::INFINITY, f64::min);
        let arrives = |&i: &usize| pelvis(i) <= lowest_m + ARRIVED_M;
        let impact = (0..n).find(arrives).unwrap_or_default();
        let stands = |&i: &usize| pelvis(i) >= FALLING_SHARE * pelvis(0);
        let onset = (0..impact).rev().find(stands).unwrap_or_default();
        Self {
            onset_s: onset as f64 / motion.fps,
            impact_s: impact as f64 / motion.fps,
        }
    }

    /// Whether a fall that is stated at a time, s, is this one.
    pub fn includes(&self, at_s: f64) -> bool {
        (self.onset_s - DESCRIBED_S..=self.impact_s + LATEST_S).contains(&at_s)
    }
}

/// What the monitor said in a trial.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Score {
    /// When the fall was suspected, s.
    pub suspected_s: Option<f64>,
    /// When the fall was confirmed, s.
    pub confirmed_s: Option<f64>,
    /// Suspicions without a fall.
    pub false_suspected: usize,
    /// Confirmed suspicions without a fall.
    pub false_confirmed: usize,
    /// Further suspicions of the same fall.
    pub repeated: usize,
}

/// Scores the events of a trial. The first suspicion from the onset to [`LATEST_S`] after the impact is that of the fall;
/// later ones repeat it. All others are false, and so is everything without a fall.
pub(super) fn score(truth: Option<TrueFall>, events: &[FallEvent]) -> Score {
    let confirmed_s = |fall: u64| {
        let confirmed = |e: &&FallEvent| e.fall == fall && e.state == FallState::Confirmed;
        events.iter().find(confirmed).map(|e| e.at_s)
    };
    let mut score = Score::default();
    for event in events.iter().filter(|e| e.state == FallState::Suspected) {
        let is_after_onset = truth.is_some_and(|t| event.at_s >= t.onset_s);
        let is_in_time = truth.is_some_and(|t| event.at_s <= t.impact_s + LATEST_S);
        if is_after_onset && score.suspected_s.is_some() {
            score.repeated += 1;
        } else if is_after_onset && is_in_time {
            score.suspected_s = Some(event.at_s);
            score.confirmed_s = confirmed_s(event.fall);
        } else {
            score.false_suspected += 1;
            score.false_confirmed += usize::from(confirmed_s(event.fall).is_some());
        }
    }
    score
}

/// Why a fall was not suspected.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Missed {
    /// Nobody was tracked from the onset on.
    NotTracked,
    /// Nobody was seen above [`HIGH_M`] from a second and a half before the onset on.
    NotSeenUp,
    /// Nobody was seen below the fall height in two successive frames.
    NotSeenDown,
    /// Both were seen, but not within the time limit, or not of the same person.
    TooLate,
}

impl Missed {
    /// In words.
    pub fn label(self) -> &'static str {
        match self {
            Self::NotTracked => "nobody was tracked",
            Self::NotSeenUp => "no height above 1.0 m just before",
            Self::NotSeenDown => "no two successive heights below 0.5 m",
            Self::TooLate => "too long between the two, or another track",
        }
    }
}

/// Why a fall was missed, from what was seen.
pub(super) fn why_missed(truth: TrueFall, seen: &[Heights], fall_height_m: f64) -> Missed {
    let from_s = truth.onset_s - 1.5;
    let near: Vec<&Heights> = seen
        .iter()
        .filter(|s| (from_s..=truth.impact_s + LATEST_S).contains(&s.t_s))
        .collect();
    let heights = |s: &Heights| s.people.clone().into_iter();
    let is_up = |s: &&Heights| heights(s).any(|(_, h)| h.is_some_and(|h| h > HIGH_M));
    let is_low = |h: Option<f64>| h.is_some_and(|h| h < fall_height_m);
    let stays_low = |pair: &[&Heights]| {
        heights(pair[0]).any(|(person, h)| {
            let later = heights(pair[1]).find(|(other, _)| *other == person);
            is_low(h) && later.is_some_and(|(_, h)| is_low(h))
        })
    };
    let after_onset = |s: &&Heights| s.t_s >= truth.onset_s && !s.people.is_empty();
    if !near.iter().any(after_onset) {
        Missed::NotTracked
    } else if !near.iter().any(is_up) {
        Missed::NotSeenUp
    } else if !near.windows(2).any(stays_low) {
        Missed::NotSeenDown
    } else {
        Missed::TooLate
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TRUTH: TrueFall = TrueFall {
        onset_s: 5.0,
        impact_s: 5.8,
    };

    fn event(fall: u64, state: FallState, at_s: f64) -> FallEvent {
        FallEvent {
            fall,
            person: 1,
            state,
            at_s,
            dwell_s: 0.0,
            place_m: [0.0, 2.0],
        }
    }

    #[test]
    fn the_first_suspicion_in_time_is_the_fall() {
        use FallState::{Confirmed, Dismissed, Suspected};
        let events = [
            event(1, Suspected, 3.0),
            event(1, Dismissed, 4.5),
            event(2, Suspected, 6.0),
            event(3, Suspected, 7.0),
            event(2, Confirmed, 26.0),
            event(3, Confirmed, 27.0),
        ];
        let expected = Score {
            suspected_s: Some(6.0),
            confirmed_s: Some(26.0),
            false_suspected: 1,
            false_confirmed: 0,
            repeated: 1,
        };
        assert_eq!(score(Some(TRUTH), &events), expected);
        let expected = Score {
            false_suspected: 3,
            false_confirmed: 2,
            ..Score::default()
        };
        assert_eq!(score(None, &events), expected);
        // A dismissed fall is suspected and not confirmed.
        let dismissed = [event(1, Suspected, 8.8), event(1, Dismissed, 12.0)];
        let found = score(Some(TRUTH), &dismissed);
        assert_eq!((found.suspected_s, found.confirmed_s), (Some(8.8), None));
        // Before the onset, and too late.
        for at_s in [4.9, 8.9] {
            let found = score(Some(TRUTH), &[event(1, Suspected, at_s)]);
            assert_eq!((found.suspected_s, found.false_suspected), (None, 1));
        }
        assert_eq!(score(Some(TRUTH), &[]), Score::default());
    }

    fn seen(heights: &[(f64, u32, Option<f64>)]) -> Vec<Heights> {
        let one = |&(t_s, person, height): &(f64, u32, Option<f64>)| Heights {
            t_s,
            people: vec![(person, height)],
        };
        heights.iter().map(one).collect()
    }

    #[test]
    fn a_missed_fall_has_a_reason() {
        let why = |heights: &[(f64, u32, Option<f64>)]| why_missed(TRUTH, &seen(heights), 0.5);
        assert_eq!(why(&[]), Missed::NotTracked);
        assert_eq!(why(&[(4.9, 1, Some(1.5))]), Missed::NotTracked);
        let low = [(5.9, 1, Some(0.3)), (6.0, 1, Some(0.3))];
        assert_eq!(why(&low), Missed::NotSeenUp);
        let up = (4.5, 1, Some(1.4));
        // Low only once, low without a height between, low with two numbers.
        assert_eq!(why(&[up, low[0]]), Missed::NotSeenDown);
        assert_eq!(
            why(&[up, low[0], (6.0, 1, None), (6.1, 1, Some(0.3))]),
            Missed::NotSeenDown
        );
        assert_eq!(why(&[up, low[0], (6.0, 2, Some(0.3))]), Missed::NotSeenDown);
        assert_eq!(why(&[up, low[0], low[1]]), Missed::TooLate);
    }

    #[test]
    fn onset_and_impact_are_those_of_the_pelvis() {
        let request =
            radarllm_motions::parse("walk+then+fall?fall.direction=forward&after_s=2").unwrap();
        let motion = request.render(1).motion;
        let truth = TrueFall::of(&motion);
        // The fall itself takes 0.9 s; afterwards come a second of rest and the two seconds.
        let falls_s = truth.impact_s - truth.onset_s;
        assert!((0.3..1.2).contains(&falls_s), "{truth:?}");
        let rests_s = motion.duration_s() - truth.impact_s;
        assert!((2.5..4.0).contains(&rests_s), "{truth:?}");
    }
}
