//! Tracks of the board, joined to people.

use std::collections::BTreeMap;

use radarllm_base::PointFrame;

use crate::Site;

/// A track that was absent for longer, s, is another person: firmware reuses the numbers of tracks.
const MAX_GAP_S: f64 = 2.0;
/// A track that is farther away in the next frame, m, is another person.
const MAX_JUMP_M: f32 = 2.0;

/// A track that begins so soon after another one ended, s, and so near to it, m, is the same person under another number:
/// firmware loses people who move suddenly, as in a fall, and finds them again at once.
const RENUMBERED_S: f64 = 0.6;
const RENUMBERED_M: f32 = 1.0;

/// Shorter tracks, s, are nobody.
pub const MIN_TRACKED_S: f64 = 1.5;

/// A person at one moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Time, s.
    pub t_s: f64,
    /// Place, m: right of the radar, away from the radar.
    pub place_m: [f32; 2],
    /// Height of the track above the radar, m, in level axes; `None` if the firmware tracks in a plane.
    pub height_m: Option<f32>,
    /// Velocity upward, m/s; `None` without a height.
    pub upward_mps: Option<f32>,
}

/// Who tracks a person.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tracker {
    /// The firmware of the board, by echoes that it does not report.
    Board,
    /// This program, by the points that the board reports.
    Points,
}

/// A person who was tracked, from the first to the last frame.
#[derive(Clone, Debug, PartialEq)]
pub struct TrackedPerson {
    /// Who tracks.
    pub tracker: Tracker,
    /// Number of the track.
    pub track: u32,
    /// In order of time.
    pub samples: Vec<Sample>,
}

impl TrackedPerson {
    /// Time of the first sample, s.
    pub fn start_s(&self) -> f64 {
        self.samples.first().map_or(0.0, |s| s.t_s)
    }

    /// Time of the last sample, s.
    pub fn end_s(&self) -> f64 {
        self.samples.last().map_or(0.0, |s| s.t_s)
    }

    /// Time from the first sample to the last, s.
    pub fn length_s(&self) -> f64 {
        self.end_s() - self.start_s()
    }

    /// The samples of a time.
    pub fn between(&self, from_s: f64, to_s: f64) -> &[Sample] {
        let first = self.samples.partition_point(|s| s.t_s < from_s);
        let last = self.samples.partition_point(|s| s.t_s <= to_s);
        &self.samples[first..last.max(first)]
    }
}

/// The people whom the board tracked, in the order in which they were first seen; `None` if the frames have no report of a
/// board. Heights are corrected by the site. Tracks with values that are not finite are left out.
pub fn tracked_people(frames: &[PointFrame], site: Option<&Site>) -> Option<Vec<TrackedPerson>> {
    if frames.iter().all(|f| f.board.is_none()) {
        return None;
    }
    let mut people: Vec<TrackedPerson> = Vec::new();
    let mut open: BTreeMap<u32, usize> = BTreeMap::new();
    for frame in frames.iter().filter(|f| f.time_s.is_finite()) {
        let ids: Vec<u32> = (frame.board.iter())
            .flat_map(|b| b.tracks.iter().map(|track| track.id))
            .collect();
        for track in frame.board.iter().flat_map(|b| &b.tracks) {
            let mut place_m = track.place_m;
            let mut height_m = track.height_m;
            if let (Some(site), Some(z_m)) = (site, height_m) {
                let [y_m, z_m] = site.level([place_m[1], z_m]);
                place_m[1] = y_m;
                height_m = Some(z_m);
            }
            let sample = Sample {
                t_s: frame.time_s,
                place_m,
                height_m,
                upward_mps: height_m.map(|_| track.velocity_mps[2]),
            };
            let values = place_m.iter().chain(&height_m).chain(&sample.upward_mps);
            if !values.into_iter().all(|v| v.is_finite()) {
                continue;
            }
            let is_near = |at: usize, gap_s: f64, jump_m: f32| {
                let last = people[at].samples.last();
                last.is_some_and(|last| {
                    let [x_m, y_m] = last.place_m;
                    let apart_m = (x_m - place_m[0]).hypot(y_m - place_m[1]);
                    sample.t_s - last.t_s <= gap_s && apart_m <= jump_m
                })
            };
            let known = open.get(&track.id).copied();
            let known = known.filter(|at| is_near(*at, MAX_GAP_S, MAX_JUMP_M));
            let renumbered = || {
                let mut lost = (open.iter())
                    .filter(|(id, at)| {
                        !ids.contains(id) && is_near(**at, RENUMBERED_S, RENUMBERED_M)
                    })
                    .map(|(id, at)| (*id, *at));
                match (lost.next(), lost.next()) {
                    (Some(one), None) => Some(one),
                    _ => None,
                }
            };
            let known = match known {
                Some(at) => Some(at),
                None => renumbered().map(|(id, at)| {
                    open.remove(&id);
                    open.insert(track.id, at);
                    at
                }),
            };
            match known {
                Some(at) => people[at].samples.push(sample),
                None => {
                    open.insert(track.id, people.len());
                    people.push(TrackedPerson {
                        tracker: Tracker::Board,
                        track: track.id,
                        samples: vec![sample],
                    });
                }
            }
        }
    }
    Some(people)
}

#[cfg(test)]
pub(crate) mod tests {
    use radarllm_base::{BoardReport, BoardTrack};

    use super::*;

    /// Frames at 10 Hz with a track at (0, y, z) of each time, and its velocity upward.
    pub(crate) fn frames(seconds: f64, at: impl Fn(f64) -> Option<[f32; 3]>) -> Vec<PointFrame> {
        let frame = |i: u32| {
            let time_s = f64::from(i) / 10.0;
            let track = |[y_m, z_m, up_mps]: [f32; 3]| BoardTrack {
                id: 3,
                place_m: [0.0, y_m],
                height_m: Some(z_m),
                velocity_mps: [0.0, 0.0, up_mps],
            };
            PointFrame {
                frame: i,
                time_s,
                board: Some(BoardReport {
                    tracks: at(time_s).into_iter().map(track).collect(),
                    is_present: None,
                }),
                ..PointFrame::default()
            }
        };
        (0..(seconds * 10.0) as u32).map(frame).collect()
    }

    #[test]
    fn numbers_that_are_reused_are_other_people() {
        let at = |t: f64| match t {
            t if t < 2.0 => Some([2.0, 0.5, 0.0]),
            t if t < 5.0 => None,
            t if t < 7.0 => Some([2.0, 0.5, 0.0]),
            // Farther than anybody moves in a tenth of a second.
            _ => Some([5.0, 0.5, 0.0]),
        };
        let people = tracked_people(&frames(9.0, at), None).unwrap();
        let spans: Vec<[f64; 2]> = people.iter().map(|p| [p.start_s(), p.end_s()]).collect();
        assert_eq!(spans, [[0.0, 1.9], [5.0, 6.9], [7.0, 8.9]]);
    }

    #[test]
    fn a_person_who_is_lost_and_found_at_once_under_another_number_is_the_same() {
        let renumbered = |gap_s: f64, apart_m: f32| {
            let mut frames = frames(8.0, |t| match t {
                t if t < 4.0 => Some([2.0, 0.5, 0.0]),
                t if t < 4.0 + gap_s => None,
                _ => Some([2.0 + apart_m, -0.5, 0.0]),
            });
            let after = frames.iter_mut().filter(|f| f.time_s >= 4.0);
            let tracks = after.flat_map(|f| &mut f.board).flat_map(|b| &mut b.tracks);
            tracks.for_each(|track| track.id = 9);
            tracked_people(&frames, None).unwrap().len()
        };
        assert_eq!(renumbered(0.0, 0.3), 1);
        assert_eq!(renumbered(0.4, 0.3), 1);
        // Somebody else, later or elsewhere.
        assert_eq!(renumbered(1.0, 0.3), 2);
        assert_eq!(renumbered(0.0, 1.5), 2);
        // Every frame another number.
        let mut frames = frames(3.0, |_| Some([2.0, 0.5, 0.0]));
        for (n, frame) in (0..).zip(&mut frames) {
            let tracks = frame.board.iter_mut().flat_map(|b| &mut b.tracks);
            tracks.for_each(|track| track.id = n);
        }
        assert_eq!(tracked_people(&frames, None).unwrap().len(), 1);
    }

    #[test]
    fn frames_without_a_report_say_nothing_and_values_that_are_no_numbers_are_left_out() {
        assert_eq!(tracked_people(&[PointFrame::default()], None), None);
        assert_eq!(
            tracked_people(&frames(1.0, |_| None), None),
            Some(Vec::new())
        );
        let broken = frames(1.0, |t| {
            Some([2.0, if t < 0.5 { f32::NAN } else { 0.5 }, 0.0])
        });
        assert_eq!(tracked_people(&broken, None).unwrap()[0].samples.len(), 5);
    }
}
