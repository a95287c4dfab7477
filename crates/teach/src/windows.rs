//! Windows of a recording, in steps of a tenth of a second, and the spectrum of a series of such steps.

use radarllm_base::{Clip, PointFrame, RadarPoint};

/// Length of a step of the series, s.
pub const STEP_S: f64 = 0.1;
/// Length of a window, s. A shorter recording is one window.
pub const WINDOW_S: f64 = 6.7;
/// Distance of two windows, s.
pub const HOP_S: f64 = 1.0;
/// Length of the transform that gives the spectrum of a series.
pub const N_TRANSFORM: usize = 256;
/// Windows with fewer points have no features.
pub const MIN_POINTS: usize = 5;

/// A window and its features.
#[derive(Clone, Debug, PartialEq)]
pub struct Window {
    /// Start on the clock of the recording's frames, s.
    pub start_s: f64,
    /// End, s.
    pub end_s: f64,
    /// The features; `None` for a window with fewer than [`MIN_POINTS`] points.
    pub features: Option<Vec<f32>>,
}

/// How a recording is divided into windows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Division {
    /// Length of a window, s. A shorter recording is one window.
    pub length_s: f64,
    /// Distance of two windows, s.
    pub hop_s: f64,
}

impl Default for Division {
    fn default() -> Self {
        Self {
            length_s: WINDOW_S,
            hop_s: HOP_S,
        }
    }
}

/// The windows of a clip, in order. `features` has the frames, the start and the length of a window, s; a window with
/// fewer than [`MIN_POINTS`] points has none.
pub fn windows_with(
    clip: &Clip,
    division: Division,
    features: impl Fn(&[PointFrame], f64, f64) -> Vec<f32>,
) -> Vec<Window> {
    let Some(first) = clip.frames.first() else {
        return Vec::new();
    };
    let start_s = first.time_s;
    let seconds = clip.duration_s();
    let length_s = division.length_s.min(seconds);
    let n_windows = ((seconds - length_s) / division.hop_s + 1e-6).floor() as usize + 1;
    let one = |i: usize| {
        let window_start_s = start_s + i as f64 * division.hop_s;
        // Frames are in order of time.
        let at = |t: f64| {
            let before = |f: &PointFrame| f.time_s - window_start_s < t - 1e-6;
            clip.frames.partition_point(before)
        };
        let frames = clip.frames.get(at(0.0)..at(length_s)).unwrap_or_default();
        let n_points: usize = frames.iter().map(|f| f.points.len()).sum();
        Window {
            start_s: window_start_s,
            end_s: window_start_s + length_s,
            features: (n_points >= MIN_POINTS).then(|| features(frames, window_start_s, length_s)),
        }
    };
    (0..n_windows).map(one).collect()
}

/// The points of each step of [`STEP_S`].
pub fn steps(frames: &[PointFrame], start_s: f64, length_s: f64) -> Vec<Vec<&RadarPoint>> {
    let n_steps = ((length_s / STEP_S).round() as usize).max(1);
    let mut steps: Vec<Vec<&RadarPoint>> = vec![Vec::new(); n_steps];
    for frame in frames {
        let step = ((frame.time_s - start_s) / STEP_S + 1e-6) as usize;
        steps[step.min(n_steps - 1)].extend(&frame.points);
    }
    steps
}

/// Squared magnitudes of the bins of a transform of length [`N_TRANSFORM`] after a Hann window, without the mean.
pub fn power_spectrum(values: &[f64], mean: f64) -> Vec<f64> {
    let n = values.len();
    let hann = |i: usize| match n {
        1 => 1.0,
        _ => 0.5 - 0.5 * (std::f64::consts::TAU * i as f64 / (n - 1) as f64).cos(),
    };
    let windowed: Vec<f64> = values
        .iter()
        .enumerate()
        .map(|(i, v)| (v - mean) * hann(i))
        .collect();
    let turn = std::f64::consts::TAU / N_TRANSFORM as f64;
    let bin = |k: usize| {
        let (mut re, mut im) = (0.0, 0.0);
        for (i, v) in windowed.iter().enumerate() {
            let (sin, cos) = (turn * (k * i % N_TRANSFORM) as f64).sin_cos();
            re += v * cos;
            im -= v * sin;
        }
        re * re + im * im
    };
    (0..=N_TRANSFORM / 2).map(bin).collect()
}

#[cfg(test)]
mod tests {
    use radarllm_base::{Clutter, Provenance};

    use super::*;

    #[test]
    fn windows_lie_in_the_recording() {
        let clip = |seconds: f64| Clip {
            frames: (0..(seconds * 10.0) as u32)
                .map(|i| PointFrame {
                    frame: i,
                    time_s: f64::from(i) / 10.0,
                    points: vec![RadarPoint::default()],
                    board: None,
                })
                .collect(),
            frame_rate_hz: 10.0,
            radar_height_m: 1.0,
            is_height_assumed: false,
            radar: "test".into(),
            provenance: Provenance::recorded("csv", "test.csv"),
            clutter: Clutter::Settled,
        };
        for (seconds, n) in [(4.0, 1), (6.7, 1), (7.6, 1), (7.7, 2), (20.0, 14)] {
            let all = windows_with(&clip(seconds), Division::default(), |frames, _, _| {
                vec![frames.len() as f32]
            });
            assert_eq!(all.len(), n, "{seconds}");
            assert!(all.iter().all(|w| w.end_s <= seconds + 1e-6));
            assert!(all.iter().all(|w| w.features.is_some()));
        }
        assert!(windows_with(&clip(0.0), Division::default(), |_, _, _| Vec::new()).is_empty());
    }
}
