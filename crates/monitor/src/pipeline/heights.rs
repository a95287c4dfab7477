//! What the heights of a person's points say about a sentence.
//!
//! A model reads motion, and most of what it takes for a fall or for rising is another motion near the floor: somebody
//! lies, breathes, or begins to get up. Heights are the other witness, as they are for falls ([`crate::falls`]):
//!
//! | action | is believed if, within the window |
//! |---|---|
//! | `fall` | the height was above 1.0 m for 1 s, and below 0.7 m within 1.5 s after it |
//! | `stand_up` | the height was above 0.9 m for 0.5 s, and not below 0.7 m in two successive frames after it |
//!
//! Somebody who lies has some points a frame, which are now and then at the height of somebody who stands, or far above it,
//! but not for long. A radar without elevation sees no heights, and its sentences are believed.

use radarllm_base::PointFrame;

use crate::falls::{FALL, HIGH_M, MIN_POINTS, POINTS_S, RISEN_M, SINK_S, SUNK_M, quantile};
use crate::options::{has_passed, is_over};

/// Time for which somebody must be up before a fall, s. The noise of the few points of somebody who lies is shorter.
const UP_BEFORE_FALL_S: f64 = 1.0;
/// Time for which somebody must be up after rising, s.
const UP_AFTER_RISING_S: f64 = 0.5;
/// Height above which there is no person, m.
const TALLEST_M: f64 = 2.2;
/// Smallest range of the heights of a radar that measures elevation, m.
const FLAT_M: f64 = 0.01;
/// The model's word for somebody who gets up.
const STAND_UP: &str = "stand_up";

/// Heights of a person in a window.
#[derive(Clone, Debug, PartialEq)]
pub struct Heights {
    /// Times, s, and heights above the floor, m, where there are enough points.
    frames: Vec<(f64, Option<f64>)>,
    has_elevation: bool,
}

impl Heights {
    /// The heights of a person's points, for a radar at a height above the floor, m.
    pub fn of(frames: &[PointFrame], radar_height_m: f64) -> Self {
        let of_frame = |frame: &PointFrame| -> Vec<f64> {
            let heights = frame
                .points
                .iter()
                .map(|p| f64::from(p.z_m) + radar_height_m);
            heights.filter(|h| h.is_finite()).collect()
        };
        let points: Vec<Vec<f64>> = frames.iter().map(of_frame).collect();
        let mut range_m = [f64::INFINITY, f64::NEG_INFINITY];
        for h in points.iter().flatten() {
            range_m = [range_m[0].min(*h), range_m[1].max(*h)];
        }
        let mut first = 0;
        let height = |n: usize| {
            while has_passed(frames[first].time_s, frames[n].time_s, POINTS_S) {
                first += 1;
            }
            let recent = &points[first..=n];
            let n_points = recent.iter().map(Vec::len).sum::<usize>();
            let height_m = match n_points < MIN_POINTS {
                true => None,
                false => quantile(recent.concat()),
            };
            (frames[n].time_s, height_m)
        };
        Self {
            frames: (0..frames.len()).map(height).collect(),
            has_elevation: range_m[1] - range_m[0] > FLAT_M,
        }
    }

    /// Whether the heights permit an action.
    pub fn permit(&self, action: &str) -> bool {
        match action {
            _ if !self.has_elevation => true,
            FALL => self.show_a_fall(),
            STAND_UP => self.end_upright(),
            _ => true,
        }
    }

    /// Whether the heights show an action by themselves.
    pub fn show(&self, action: &str) -> bool {
        self.has_elevation && action == FALL && self.show_a_fall()
    }

    fn show_a_fall(&self) -> bool {
        let (mut up, mut up_s) = (Up::above(HIGH_M, UP_BEFORE_FALL_S), None);
        self.frames.iter().any(|&(t_s, height_m)| {
            if up.push(t_s, height_m) {
                up_s = Some(t_s);
            }
            let is_low = height_m.is_some_and(|h| h < SUNK_M);
            is_low && up_s.is_some_and(|up_s| !is_over(up_s, t_s, SINK_S))
        })
    }

    fn end_upright(&self) -> bool {
        let (mut up, mut is_up, mut was_low) =
            (Up::above(RISEN_M, UP_AFTER_RISING_S), false, false);
        for &(t_s, height_m) in &self.frames {
            let is_low = height_m.is_some_and(|h| h < SUNK_M);
            is_up = up.push(t_s, height_m) || (is_up && !(is_low && was_low));
            was_low = is_low;
        }
        is_up
    }
}

/// Whether somebody has been up for long enough.
struct Up {
    above_m: f64,
    min_s: f64,
    since_s: Option<f64>,
}

impl Up {
    fn above(above_m: f64, min_s: f64) -> Self {
        Self {
            above_m,
            min_s,
            since_s: None,
        }
    }

    fn push(&mut self, t_s: f64, height_m: Option<f64>) -> bool {
        if height_m.is_none_or(|h| h <= self.above_m || h > TALLEST_M) {
            self.since_s = None;
            return false;
        }
        let since_s = *self.since_s.get_or_insert(t_s);
        has_passed(since_s, t_s, self.min_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use radarllm_base::RadarPoint;

    const RADAR_M: f64 = 1.2;

    /// A window at 10 Hz of somebody with these heights, m, for so many frames; NaN for nobody.
    fn heights(parts: &[(f32, u32)]) -> Heights {
        let points = |height_m: f32| match height_m.is_nan() {
            true => Vec::new(),
            false => (1..=10)
                .map(|i| RadarPoint {
                    z_m: height_m * (0.9 + 0.01 * i as f32) - RADAR_M as f32,
                    ..RadarPoint::default()
                })
                .collect(),
        };
        let all = parts.iter().flat_map(|&(h, n)| (0..n).map(move |_| h));
        let frames: Vec<PointFrame> = (0u32..)
            .zip(all)
            .map(|(n, height_m)| PointFrame {
                frame: n,
                time_s: 100.0 + f64::from(n) / 10.0,
                points: points(height_m),
                board: None,
            })
            .collect();
        Heights::of(&frames, RADAR_M)
    }

    #[test]
    fn a_fall_is_up_and_low_soon_after() {
        let fall = heights(&[(1.6, 20), (1.2, 3), (0.3, 5), (f32::NAN, 30)]);
        assert!(fall.permit("fall") && fall.show("fall"));
        // Lies down: 2.5 s between; the points of the last 0.3 s shorten it.
        let lies_down = heights(&[(1.6, 20), (0.9, 25), (0.3, 15)]);
        assert!(!lies_down.permit("fall") && !lies_down.show("fall"));
        // Rises.
        assert!(!heights(&[(0.3, 30), (1.6, 30)]).permit("fall"));
        // Lies and breathes, with a noisy frame.
        let noisy = heights(&[(0.4, 20), (1.5, 2), (0.4, 30)]);
        assert!(!noisy.permit("fall") && !noisy.permit("stand_up"));
        let noisy = heights(&[(1.5, 6), (3.1, 2), (1.9, 6), (0.4, 30)]);
        assert!(!noisy.permit("fall"));
        // Walks out of sight.
        assert!(!heights(&[(1.6, 20), (f32::NAN, 40)]).permit("fall"));
        assert!(!heights(&[]).show("fall"));
    }

    #[test]
    fn rising_ends_upright() {
        assert!(heights(&[(0.3, 30), (1.6, 30)]).permit("stand_up"));
        // From a chair, where nobody was seen, and then stands still.
        let chair = heights(&[(f32::NAN, 30), (1.2, 5), (1.6, 10), (f32::NAN, 15)]);
        assert!(chair.permit("stand_up"));
        assert!(!heights(&[(1.6, 30), (0.3, 30)]).permit("stand_up"));
        assert!(!heights(&[(f32::NAN, 60)]).show("stand_up"));
        assert!(heights(&[(0.3, 60)]).permit("lie_down"));
    }

    #[test]
    fn without_elevation_sentences_are_believed() {
        let frame = |n: u32| PointFrame {
            frame: n,
            time_s: f64::from(n) / 10.0,
            points: vec![RadarPoint::default(); 10],
            board: None,
        };
        let flat = Heights::of(&(0..60).map(frame).collect::<Vec<_>>(), RADAR_M);
        assert!(flat.permit("fall") && flat.permit("stand_up") && !flat.show("fall"));
    }
}
