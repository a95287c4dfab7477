//! How high everybody has been, so that pets and robot vacuums do not count where a zone ignores what is low.
//!
//! A person who lies on the floor was higher before, under the same number. Whoever is new and low, as after falling out of
//! sight of the tracker, does not count in such a zone until it rises; a fall that is open goes on meanwhile, because falls
//! do not end by somebody who is not seen.

use std::collections::{BTreeMap, VecDeque};

use radarllm_base::stats::quantile_linear;

use crate::options::is_over;
use crate::people::PersonFrame;
use crate::zones::Zones;

/// Longest time over which points are collected, s: a pet has few.
const POINTS_S: f64 = 1.0;
/// Points after which no older ones are needed.
const ENOUGH_POINTS: usize = 8;
/// Fewest points that have a height.
const MIN_POINTS: usize = 4;
/// Quantile of the heights that is the height of a body. The largest heights are noise of the elevation angle.
const QUANTILE: f64 = 0.75;
/// Time for which a height must be kept, s: one that is kept for less is noise, or the jump of a cat.
const KEPT_S: f64 = 0.8;
/// Longest time without a height within [`KEPT_S`], s.
const GAP_S: f64 = 0.5;
/// Time for which somebody may be tracked before an unknown height is no reason not to count any more, s.
const UNKNOWN_S: f64 = 3.0;
/// Time for which somebody is remembered who is not tracked any more, s.
const MEMORY_S: f64 = 10.0;

/// The heights of everybody who is tracked.
#[derive(Debug)]
pub(crate) struct Statures {
    /// Height of the floor above the radar, m.
    floor_m: f64,
    bodies: BTreeMap<u32, Body>,
}

#[derive(Debug, Default)]
struct Body {
    /// Heights of points, m above the floor, of the last [`POINTS_S`].
    points: VecDeque<(f64, Vec<f64>)>,
    /// Heights of the body, m above the floor, of the last [`KEPT_S`].
    heights: VecDeque<(f64, f64)>,
    /// Since when heights follow each other without a gap, s.
    since_s: f64,
    /// The greatest height that was kept, m above the floor.
    highest_m: Option<f64>,
    /// Time at which the body was first tracked, s, and last.
    tracked_s: Option<[f64; 2]>,
}

impl Statures {
    pub(crate) fn new(radar_height_m: f64) -> Self {
        Self {
            floor_m: -radar_height_m,
            bodies: BTreeMap::new(),
        }
    }

    /// The tracked people of the next frame.
    pub(crate) fn push(&mut self, t_s: f64, people: &[PersonFrame]) {
        for one in people {
            let body = self.bodies.entry(one.person).or_default();
            body.see(t_s, one, self.floor_m);
        }
        let is_remembered = |body: &Body| {
            let tracked_s = body.tracked_s;
            tracked_s.is_some_and(|[_, last_s]| !is_over(last_s, t_s, MEMORY_S))
        };
        self.bodies.retain(|_, body| is_remembered(body));
    }

    /// Whether a zone ignores whoever was tracked in the last frame, who was never higher. So it is as long as the height is
    /// unknown, but not for long: there are boards without heights.
    pub(crate) fn is_low(&self, one: &PersonFrame, zones: &Zones) -> bool {
        let Some(body) = self.bodies.get(&one.person) else {
            return false;
        };
        let is_new = |[first_s, last_s]: [f64; 2]| !is_over(first_s, last_s, UNKNOWN_S);
        match body.highest_m {
            Some(highest_m) => zones.is_low(one.place_m, highest_m),
            None => zones.is_low(one.place_m, 0.0) && body.tracked_s.is_some_and(is_new),
        }
    }
}

impl Body {
    fn see(&mut self, t_s: f64, one: &PersonFrame, floor_m: f64) {
        let first_s = self.tracked_s.map_or(t_s, |[first_s, _]| first_s);
        self.tracked_s = Some([first_s, t_s]);
        let tracked = one.board.and_then(|track| track.height_m);
        let height_m = match tracked {
            Some(z_m) => Some(f64::from(z_m) - floor_m),
            None => self.height_of_points(t_s, one, floor_m),
        };
        let Some(height_m) = height_m.filter(|h| h.is_finite()) else {
            return;
        };
        let last_s = self.heights.back().map(|(at_s, _)| *at_s);
        if last_s.is_none_or(|last_s| is_over(last_s, t_s, GAP_S)) {
            self.heights.clear();
            self.since_s = t_s;
        }
        self.heights.push_back((t_s, height_m));
        while let Some((at_s, _)) = self.heights.front()
            && is_over(*at_s, t_s, KEPT_S)
        {
            self.heights.pop_front();
        }
        if is_over(self.since_s, t_s, KEPT_S) {
            let heights = self.heights.iter().map(|(_, height_m)| *height_m);
            let kept_m = heights.fold(f64::INFINITY, f64::min);
            self.highest_m = Some(self.highest_m.map_or(kept_m, |h| h.max(kept_m)));
        }
    }

    fn height_of_points(&mut self, t_s: f64, one: &PersonFrame, floor_m: f64) -> Option<f64> {
        let heights = one.points.iter().map(|p| f64::from(p.z_m) - floor_m);
        let heights: Vec<f64> = heights.filter(|h| h.is_finite()).collect();
        if heights.is_empty() {
            return None;
        }
        self.points.push_back((t_s, heights));
        while let Some((at_s, _)) = self.points.front()
            && is_over(*at_s, t_s, POINTS_S)
        {
            self.points.pop_front();
        }
        let mut newest: Vec<f64> = Vec::new();
        for (_, heights) in self.points.iter().rev() {
            if newest.len() >= ENOUGH_POINTS {
                break;
            }
            newest.extend(heights);
        }
        upper_height_m(newest.into_iter())
    }
}

/// The height of a body by the heights of its points; `None` of too few.
pub(crate) fn upper_height_m(heights: impl Iterator<Item = f64>) -> Option<f64> {
    let mut heights: Vec<f64> = heights.collect();
    if heights.len() < MIN_POINTS {
        return None;
    }
    heights.sort_by(f64::total_cmp);
    quantile_linear(&heights, QUANTILE)
}

#[cfg(test)]
mod tests {
    use radarllm_base::BoardTrack;

    use super::*;
    use crate::people::tests::{person, unseen};
    use crate::zones::tests::rectangle;
    use crate::zones::{Zone, ZoneKind};

    const PLACE: [f64; 2] = [0.0, 2.0];

    /// The greatest height of person 1 before a radar at 1 m, of heights above the floor at 10 Hz.
    fn highest_m(heights: &[Option<f32>]) -> Option<f64> {
        let mut statures = Statures::new(1.0);
        for (n, height) in heights.iter().enumerate() {
            let one = match height {
                Some(height_m) => person(1, PLACE, height_m - 1.0),
                None => unseen(1, PLACE),
            };
            statures.push(n as f64 * 0.1, &[one]);
        }
        statures.bodies.get(&1)?.highest_m
    }

    #[test]
    fn a_height_counts_that_is_kept() {
        assert_eq!(highest_m(&[Some(0.3); 8]), None);
        let low = highest_m(&[Some(0.3); 20]).unwrap();
        assert!((low - 0.3).abs() < 1e-6, "{low}");
        // A leap of half a second, and then a rise that stays.
        let mut heights = vec![Some(0.3); 20];
        heights.extend([Some(1.2); 4]);
        heights.extend([Some(0.3); 20]);
        assert!(highest_m(&heights).unwrap() < 0.5);
        heights.extend([Some(1.5); 20]);
        heights.extend([Some(0.2); 50]);
        assert!((highest_m(&heights).unwrap() - 1.5).abs() < 1e-6);
        // A height that is not finite is none.
        assert_eq!(highest_m(&[Some(f32::NAN); 20]), None);
    }

    #[test]
    fn few_points_tell_a_height_and_a_gap_begins_anew() {
        // Two points every fifth of a second.
        let mut statures = Statures::new(1.0);
        for n in 0..40 {
            let mut one = person(1, PLACE, -0.8);
            one.points.truncate(if n % 2 == 0 { 2 } else { 0 });
            statures.push(f64::from(n) * 0.1, &[one]);
        }
        assert!((statures.bodies[&1].highest_m.unwrap() - 0.2).abs() < 1e-6);
        // 0.6 s, a second without anything, 0.6 s: no height is kept long enough.
        let mut heights = vec![Some(1.5); 4];
        heights.extend([None; 16]);
        heights.extend([Some(1.5); 4]);
        assert_eq!(highest_m(&heights), None);
    }

    #[test]
    fn the_height_of_the_board_comes_first_and_numbers_are_forgotten() {
        let mut statures = Statures::new(1.0);
        for n in 0..20 {
            let mut one = person(7, PLACE, 0.9);
            one.board = Some(BoardTrack {
                id: 1,
                place_m: [0.0, 2.0],
                height_m: Some(-0.7),
                velocity_mps: [0.0; 3],
            });
            statures.push(f64::from(n) * 0.1, &[one]);
        }
        assert!((statures.bodies[&7].highest_m.unwrap() - 0.3).abs() < 1e-6);
        statures.push(13.0, &[]);
        assert!(statures.bodies.is_empty());
    }

    #[test]
    fn an_unknown_height_is_low_for_three_seconds() {
        let zone = Zone {
            below_m: Some(0.5),
            ..rectangle(ZoneKind::Ignore, [-1.0, 1.0], [1.0, 3.0])
        };
        let zones = Zones::new(vec![zone]).unwrap();
        let mut statures = Statures::new(1.0);
        let low_at = |n: u32, statures: &mut Statures| {
            let one = unseen(1, PLACE);
            statures.push(f64::from(n) * 0.1, std::slice::from_ref(&one));
            statures.is_low(&one, &zones)
        };
        let low: Vec<bool> = (0..40).map(|n| low_at(n, &mut statures)).collect();
        assert_eq!(low.iter().filter(|is_low| **is_low).count(), 31);
        assert!(low[30] && !low[31]);
        assert!(!statures.is_low(&unseen(2, PLACE), &zones));
    }
}
