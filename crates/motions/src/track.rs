//! Keyframes joined by smooth interpolation curves.
//!
//! Between two keyframes every channel follows a quintic polynomial with zero acceleration at the
//! keyframes. This is the minimum-jerk curve where the velocity at the keyframes is also zero. The
//! slope at a keyframe is zero where the channel reverses or rests. Where the channel passes
//! through, the slope is the monotone (Fritsch-Carlson) value. The curves therefore never
//! overshoot: a foot keyed on the floor never dips below it.

use crate::control::{Control, N_CHANNELS, is_upper};

/// Frame rate of all procedural motions, Hz.
pub(crate) const FPS: f64 = 60.0;
/// Minimum time between keyframes, s: two frames.
const MIN_STEP_S: f32 = 2.0 / FPS as f32;

/// A sequence of keyframes under construction.
#[derive(Clone, Debug)]
pub(crate) struct Track {
    keys: Vec<(f32, Control)>,
}

impl Track {
    /// Creates a track with this pose as the keyframe at time 0.
    pub(crate) fn new(start: Control) -> Self {
        Self {
            keys: vec![(0.0, start)],
        }
    }

    /// Adds a keyframe `after_s` later: the previous keyframe, modified by `edit`.
    pub(crate) fn to(&mut self, after_s: f32, edit: impl FnOnce(&mut Control)) -> &mut Self {
        let (time, mut control) = self.keys[self.keys.len() - 1];
        edit(&mut control);
        self.keys.push((time + after_s.max(MIN_STEP_S), control));
        self
    }

    /// Holds the last pose.
    pub(crate) fn hold(&mut self, for_s: f32) -> &mut Self {
        self.to(for_s, |_| {})
    }

    /// Time of the last keyframe, s.
    pub(crate) fn end_s(&self) -> f32 {
        self.keys[self.keys.len() - 1].0
    }

    /// Samples the curves at [`FPS`]; the head and arms are delayed by `upper_lag_s` relative to
    /// the rest of the body.
    pub(crate) fn render(&self, upper_lag_s: f32) -> Vec<Control> {
        let n_frames = ((self.end_s() + upper_lag_s.max(0.0)) as f64 * FPS).ceil() as usize + 1;
        let slopes = self.slopes();
        let times: Vec<f32> = self.keys.iter().map(|k| k.0).collect();
        let values: Vec<[f32; N_CHANNELS]> = self.keys.iter().map(|k| k.1.channels()).collect();
        // All channels of a time lie between the same keys: before the first one, after the last one, or at a share of the
        // way from one to the next.
        let place = |time: f32| {
            let next = times.partition_point(|t| *t <= time);
            let (k, next) = (next.saturating_sub(1), next.min(times.len() - 1));
            let span = times[next] - times[k];
            let u = if next == k {
                0.0
            } else {
                (time - times[k]) / span
            };
            (k, next, span, u)
        };
        let at = |(k, next, span, u): (usize, usize, f32, f32), channel: usize| {
            let (p, q) = (values[k][channel], values[next][channel]);
            if next == k {
                return p;
            }
            let (v, w) = (slopes[k][channel] * span, slopes[next][channel] * span);
            let d = q - p;
            let (u2, u3) = (u * u, u * u * u);
            // Quintic Hermite polynomial with zero second derivative at both ends.
            p + v * u
                + u3 * ((10.0 * d - 6.0 * v - 4.0 * w)
                    + u * (-15.0 * d + 8.0 * v + 7.0 * w)
                    + u2 * (6.0 * d - 3.0 * v - 3.0 * w))
        };
        (0..n_frames)
            .map(|frame| {
                let time = (frame as f64 / FPS) as f32;
                let (lower, upper) = (place(time), place(time - upper_lag_s));
                let channels =
                    std::array::from_fn(|c| at(if is_upper(c) { upper } else { lower }, c));
                Control::from_channels(&channels)
            })
            .collect()
    }

    fn slopes(&self) -> Vec<[f32; N_CHANNELS]> {
        let n = self.keys.len();
        let values: Vec<[f32; N_CHANNELS]> = self.keys.iter().map(|k| k.1.channels()).collect();
        let mut slopes = vec![[0.0; N_CHANNELS]; n];
        for k in 1..n.saturating_sub(1) {
            let (before, after) = (
                self.keys[k].0 - self.keys[k - 1].0,
                self.keys[k + 1].0 - self.keys[k].0,
            );
            for c in 0..N_CHANNELS {
                let d0 = (values[k][c] - values[k - 1][c]) / before;
                let d1 = (values[k + 1][c] - values[k][c]) / after;
                if d0 * d1 > 0.0 {
                    let (w0, w1) = (2.0 * after + before, after + 2.0 * before);
                    slopes[k][c] = (w0 + w1) / (w0 / d0 + w1 / d1);
                }
            }
        }
        slopes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_pass_the_keys_and_never_overshoot() {
        let mut track = Track::new(Control::default());
        track
            .to(0.5, |c| c.hip.y = 1.0)
            .to(0.25, |c| c.hip.y = 3.0)
            .hold(0.5)
            .to(0.25, |c| c.hip.y = 0.0);
        let heights: Vec<f32> = track.render(0.0).iter().map(|c| c.hip.y).collect();
        assert_eq!(heights.len(), 91);
        for (frame, expected) in [
            (0, 0.0),
            (30, 1.0),
            (45, 3.0),
            (60, 3.0),
            (75, 3.0),
            (90, 0.0),
        ] {
            assert!(
                (heights[frame] - expected).abs() < 1e-4,
                "{frame}: {}",
                heights[frame]
            );
        }
        // The tolerance covers rounding only: the curve is monotone between keyframes.
        assert!(heights.iter().all(|h| (-1e-4..=3.0001).contains(h)));
        assert!(heights[..45].windows(2).all(|w| w[1] > w[0] - 1e-4));
    }
}
