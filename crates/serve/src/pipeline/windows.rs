//! The last seconds of each person's points.

use std::collections::{BTreeMap, VecDeque};

use radarllm_base::PointFrame;

use crate::options::{OptionError, within};
use crate::people::PersonFrame;

/// Rounding of times of frames, s.
const ROUNDING_S: f64 = 1e-6;

/// Options of windows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WindowOptions {
    /// Length of a window, s.
    pub window_s: f64,
    /// Time between the starts of two windows, s.
    pub stride_s: f64,
    /// Time for which a person is tracked before the first window, s.
    pub least_s: f64,
}

impl Default for WindowOptions {
    fn default() -> Self {
        Self {
            window_s: 6.0,
            stride_s: 2.0,
            least_s: 3.0,
        }
    }
}

/// A person's points over a window.
#[derive(Clone, Debug, PartialEq)]
pub struct Window {
    /// Number of the track.
    pub person: u32,
    /// All frames of the window, with this person's points; without points where the person was not detected.
    pub frames: Vec<PointFrame>,
    /// Where the person is, m, to the right of the radar and away from it.
    pub place_m: [f64; 2],
}

impl Window {
    /// Time of the first frame, s.
    pub fn start_s(&self) -> f64 {
        self.frames.first().map_or(0.0, |f| f.time_s)
    }

    /// Time of the last frame, s.
    pub fn end_s(&self) -> f64 {
        self.frames.last().map_or(0.0, |f| f.time_s)
    }

    /// Number of points.
    pub fn n_points(&self) -> u32 {
        let n = self.frames.iter().map(|f| f.points.len()).sum::<usize>();
        u32::try_from(n).unwrap_or(u32::MAX)
    }
}

/// The last seconds of everybody.
#[derive(Debug)]
pub struct Windows {
    options: WindowOptions,
    people: BTreeMap<u32, Track>,
    /// Number of the last stride that was described.
    stride: Option<f64>,
    /// Whether frames came after the last windows were taken.
    is_partly_new: bool,
}

#[derive(Debug, Default)]
struct Track {
    frames: VecDeque<PointFrame>,
    place_m: [f64; 2],
}

impl Windows {
    /// Nobody has been seen.
    ///
    /// # Errors
    /// If an option is out of range.
    pub fn new(options: WindowOptions) -> Result<Self, OptionError> {
        within("window_s", options.window_s, [1.0, 9.6], "1 to 9.6 s")?;
        within("stride_s", options.stride_s, [0.1, 60.0], "0.1 to 60 s")?;
        within("least_s", options.least_s, [0.0, 9.6], "0 to 9.6 s")?;
        Ok(Self {
            options,
            people: BTreeMap::new(),
            stride: None,
            is_partly_new: false,
        })
    }

    /// The points of the people who are tracked in the next frame. Returns those who are not tracked any more.
    pub fn push(&mut self, frame: &PointFrame, people: &[PersonFrame]) -> Vec<u32> {
        let oldest_s = frame.time_s - self.options.window_s + ROUNDING_S;
        for person in people {
            let track = self.people.entry(person.person).or_default();
            track.place_m = person.place_m;
            track.frames.push_back(PointFrame {
                frame: frame.frame,
                time_s: frame.time_s,
                points: person.points.clone(),
            });
            while track.frames.front().is_some_and(|f| f.time_s < oldest_s) {
                track.frames.pop_front();
            }
        }
        self.is_partly_new |= !people.is_empty();
        let is_gone = |id: &u32| people.iter().all(|p| p.person != *id);
        let gone: Vec<u32> = self.people.keys().copied().filter(is_gone).collect();
        self.people.retain(|id, _| !is_gone(id));
        gone
    }

    /// Whether windows end with the frame at `t_s`: the first one in every stride of the stream.
    pub fn is_due(&mut self, t_s: f64) -> bool {
        let stride = ((t_s + ROUNDING_S) / self.options.stride_s).floor();
        self.stride.replace(stride) != Some(stride)
    }

    /// Whether somebody was seen after the last windows were taken.
    pub fn is_partly_new(&self) -> bool {
        self.is_partly_new
    }

    /// The windows that end with the last frame, of all who have been tracked for long enough.
    pub fn take(&mut self) -> Vec<Window> {
        self.is_partly_new = false;
        let windows = self.people.iter().map(|(person, track)| Window {
            person: *person,
            frames: track.frames.iter().cloned().collect(),
            place_m: track.place_m,
        });
        windows
            .filter(|w| w.end_s() - w.start_s() >= self.options.least_s - ROUNDING_S)
            .collect()
    }

    /// Forgets everybody.
    pub fn clear(&mut self) {
        self.people.clear();
        self.is_partly_new = false;
    }
}

#[cfg(test)]
mod tests {
    use radarllm_base::RadarPoint;

    use super::*;

    fn frame(n: u32) -> PointFrame {
        PointFrame {
            frame: n,
            time_s: f64::from(n) / 10.0,
            points: Vec::new(),
        }
    }

    fn person(person: u32, n_points: usize) -> PersonFrame {
        PersonFrame {
            person,
            place_m: [0.5, 2.0],
            points: vec![RadarPoint::default(); n_points],
        }
    }

    #[test]
    fn windows_are_six_seconds_long_and_begin_every_two() {
        let mut windows = Windows::new(WindowOptions::default()).unwrap();
        let mut found = Vec::new();
        for n in 0..121 {
            let gone = windows.push(&frame(n), &[person(1, 3)]);
            assert!(gone.is_empty());
            if windows.is_due(f64::from(n) / 10.0) {
                found.extend(windows.take());
            }
        }
        let spans: Vec<(f64, f64, usize)> = found
            .iter()
            .map(|w| (w.start_s(), w.end_s(), w.frames.len()))
            .collect();
        let expected = [
            (0.0, 4.0, 41),
            (0.1, 6.0, 60),
            (2.1, 8.0, 60),
            (4.1, 10.0, 60),
            (6.1, 12.0, 60),
        ];
        assert_eq!(spans, expected);
        assert_eq!((found[1].n_points(), found[1].place_m), (180, [0.5, 2.0]));
        assert!(!windows.is_partly_new());
    }

    #[test]
    fn whoever_is_not_tracked_any_more_is_forgotten() {
        let mut windows = Windows::new(WindowOptions::default()).unwrap();
        for n in 0..50 {
            windows.push(&frame(n), &[person(1, 3), person(2, 0)]);
        }
        assert_eq!(windows.take().len(), 2);
        assert_eq!(windows.push(&frame(50), &[person(2, 0)]), [1]);
        assert!(windows.is_partly_new());
        let left = windows.take();
        assert_eq!((left.len(), left[0].person, left[0].n_points()), (1, 2, 0));
        windows.clear();
        assert!(windows.take().is_empty());
    }

    #[test]
    fn options_are_checked() {
        let long = WindowOptions {
            window_s: 10.0,
            ..WindowOptions::default()
        };
        assert_eq!(Windows::new(long).unwrap_err().field, "window_s");
    }
}
