//! The empty room, learnt before anybody is looked for.
//!
//! A fan, a curtain or a plant moves as people do. For some time at the start the room must be empty; cells of position and
//! velocity in which it has points, and places on the floor where something moves, are removed afterwards, as
//! `--background` does with a recording of the empty room. While the room is learnt, nobody is seen.

use radarllm_base::PointFrame;
use radarllm_tracking::{BackgroundOptions, MAX_PLACES_M2, PointBackground};

use crate::options::{OptionError, within};

/// Longest time of learning, s.
const MAX_S: f64 = 300.0;
/// Most points that are learnt from, so that memory is bounded: 12 MB. After them, learning ends early.
const MAX_POINTS: usize = 400_000;

/// What is known of the empty room.
#[derive(Debug)]
pub enum EmptyRoom {
    /// Nothing is learnt, and nothing is removed.
    Unknown,
    /// The room is being learnt.
    Learning {
        /// How long, s.
        for_s: f64,
        /// When it ends, s; known with the first frame.
        until_s: Option<f64>,
        /// Frames so far.
        frames: Vec<PointFrame>,
        /// Number of their points.
        n_points: usize,
    },
    /// The room is known.
    Known(PointBackground),
}

impl EmptyRoom {
    /// Learns for some time, s; 0 to learn nothing.
    ///
    /// # Errors
    /// A time that is out of range.
    pub fn new(learn_s: f64) -> Result<Self, OptionError> {
        within("learn_empty_s", learn_s, [0.0, MAX_S], "0 to 300 s")?;
        Ok(match learn_s > 0.0 {
            true => Self::Learning {
                for_s: learn_s,
                until_s: None,
                frames: Vec::new(),
                n_points: 0,
            },
            false => Self::Unknown,
        })
    }

    /// Removes the points of the empty room from the next frame: all of them while it is learnt.
    pub fn clean(&mut self, frame: &mut PointFrame) {
        match self {
            Self::Unknown => {}
            Self::Known(background) => {
                background.remove(std::slice::from_mut(frame));
            }
            Self::Learning {
                for_s,
                until_s,
                frames,
                n_points,
            } => {
                let until_s = *until_s.get_or_insert(frame.time_s + *for_s);
                if frame.time_s < until_s && *n_points < MAX_POINTS {
                    *n_points += frame.points.len();
                    frames.push(frame.clone());
                    frame.points.clear();
                    return;
                }
                let learnt = PointBackground::learn(frames, BackgroundOptions::default());
                // The default options are valid.
                *self = learnt.map_or(Self::Unknown, Self::Known);
                self.clean(frame);
            }
        }
    }

    /// What whoever looks at the health should know at a time of the stream, s.
    pub fn problem(&self, t_s: f64) -> Option<String> {
        match self {
            Self::Unknown => None,
            Self::Learning { for_s, until_s, .. } => {
                let left_s = until_s.map_or(*for_s, |until_s| (until_s - t_s).max(0.0));
                Some(format!(
                    "the empty room is being learnt for another {left_s:.0} s, and nobody is seen"
                ))
            }
            Self::Known(background) => too_much(background),
        }
    }

    /// What was learnt, in words, once the room is known.
    pub fn summary(&self) -> Option<String> {
        let Self::Known(background) = self else {
            return None;
        };
        let what = match background.n_places() {
            0 => "nothing moves there".into(),
            1 => "1 place where something moves is ignored from now on".into(),
            n => format!("{n} places where something moves are ignored from now on"),
        };
        Some(too_much(background).unwrap_or_else(|| format!("the empty room was learnt: {what}")))
    }
}

/// Why nothing that moves is ignored, although something does.
fn too_much(background: &PointBackground) -> Option<String> {
    let moving_m2 = background.moving_m2();
    (moving_m2 > MAX_PLACES_M2).then(|| {
        format!(
            "what moves was not learnt: something moved on {moving_m2:.1} m2 of the floor while the room should have been empty, expected at most {MAX_PLACES_M2} m2"
        )
    })
}

#[cfg(test)]
mod tests {
    use radarllm_base::RadarPoint;

    use super::*;

    fn point(x_m: f32, velocity_mps: f32) -> RadarPoint {
        RadarPoint {
            x_m,
            y_m: 2.0,
            velocity_mps,
            ..RadarPoint::default()
        }
    }

    fn frame(number: u32, points: &[RadarPoint]) -> PointFrame {
        PointFrame {
            frame: number,
            time_s: 7.0 + f64::from(number) / 10.0,
            points: points.to_vec(),
            board: None,
        }
    }

    #[test]
    fn what_moves_in_the_empty_room_is_removed_afterwards_as_by_a_recording_of_it() {
        let (fan, walker) = (point(-1.0, 0.8), point(0.6, 0.8));
        let mut room = EmptyRoom::new(2.0).unwrap();
        assert!(room.problem(0.0).unwrap().contains("another 2 s"));
        let mut empty = Vec::new();
        for n in 0..20 {
            let seen = match n % 3 {
                0 => vec![fan],
                _ => Vec::new(),
            };
            empty.push(frame(n, &seen));
            let mut one = frame(n, &seen);
            room.clean(&mut one);
            assert!(one.points.is_empty(), "nobody is seen");
        }
        assert!(room.problem(8.5).unwrap().contains("another 0 s"));
        let batch = PointBackground::learn(&empty, BackgroundOptions::default()).unwrap();
        for n in 20..30 {
            let mut one = frame(n, &[fan, walker, point(-1.0, -2.0)]);
            let mut expected = [one.clone()];
            room.clean(&mut one);
            batch.remove(&mut expected);
            assert_eq!(one, expected[0]);
            // All that is where the fan moves.
            assert_eq!(one.points, [walker]);
            assert_eq!(room.problem(one.time_s), None);
        }
        let summary = room.summary().unwrap();
        assert!(
            summary.contains("1 place where something moves"),
            "{summary}"
        );
    }

    #[test]
    fn what_was_learnt_is_told_also_where_it_is_nothing_or_too_much() {
        let after = |points_of: &dyn Fn(u32) -> Vec<RadarPoint>| {
            let mut room = EmptyRoom::new(5.0).unwrap();
            assert_eq!(room.summary(), None);
            for n in 0..=50 {
                room.clean(&mut frame(n, &points_of(n)));
            }
            (room.summary().unwrap(), room.problem(12.0))
        };
        let (summary, problem) = after(&|_| Vec::new());
        assert!(summary.contains("nothing moves there") && problem.is_none());
        // Somebody walks about, 1 m with every frame and there again.
        let (summary, problem) = after(&|n| vec![point((n % 25) as f32, 0.8)]);
        assert!(summary.contains("was not learnt"), "{summary}");
        assert_eq!(problem, Some(summary));
    }

    #[test]
    fn nothing_is_learnt_without_being_asked_and_memory_is_bounded() {
        let mut room = EmptyRoom::new(0.0).unwrap();
        let mut one = frame(0, &[point(0.0, 1.0)]);
        room.clean(&mut one);
        assert_eq!((one.points.len(), room.problem(7.0)), (1, None));
        for wrong in [-1.0, f64::NAN, 301.0] {
            assert_eq!(EmptyRoom::new(wrong).unwrap_err().field, "learn_empty_s");
        }
        let mut room = EmptyRoom::new(300.0).unwrap();
        let crowded: Vec<RadarPoint> = (0..5_000u16).map(|i| point(f32::from(i), 1.0)).collect();
        for n in 0..=80 {
            room.clean(&mut frame(n, &crowded));
        }
        assert!(matches!(room, EmptyRoom::Known(_)));
    }
}
