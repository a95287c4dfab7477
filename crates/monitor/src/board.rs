//! People by the tracks of the board, where its firmware tracks them.

use std::collections::BTreeMap;

use radarllm_base::{BoardReport, PointFrame};
use radarllm_tracking::LiveTrack;

/// A track that was absent for longer, s, is another person: firmware reuses the numbers of tracks.
const MAX_GAP_S: f64 = 2.0;
/// A track that is farther away in the next frame, m, is another person.
const MAX_JUMP_M: f64 = 2.0;
/// A track that begins so soon after another one was last reported, s, and so near to it, m, is the same person under another
/// number: firmware loses people who move suddenly, as in a fall, and finds them again at once.
const RENUMBERED_S: f64 = 0.6;
const RENUMBERED_M: f64 = 1.0;
/// Points within this distance of a track on the floor, m, are the person's.
const BODY_M: f64 = 1.0;

/// Numbers of people by the numbers of the board's tracks.
#[derive(Debug, Default)]
pub(crate) struct BoardPeople {
    known: BTreeMap<u32, Known>,
    newest: u32,
}

#[derive(Clone, Copy, Debug)]
struct Known {
    person: u32,
    seen_s: f64,
    place_m: [f64; 2],
}

impl BoardPeople {
    /// The people of a report. Those who were numbered by others before keep their numbers below `numbered`.
    pub(crate) fn push(
        &mut self,
        frame: &PointFrame,
        report: &BoardReport,
        numbered: u32,
    ) -> Vec<LiveTrack> {
        let t_s = frame.time_s;
        self.newest = self.newest.max(numbered);
        self.known
            .retain(|_, known| t_s - known.seen_s <= MAX_GAP_S);
        let mut people: Vec<LiveTrack> = Vec::new();
        for track in &report.tracks {
            let place_m = track.place_m.map(f64::from);
            let velocity_mps = [track.velocity_mps[0], track.velocity_mps[1]].map(f64::from);
            if !place_m.iter().chain(&velocity_mps).all(|v| v.is_finite()) {
                continue;
            }
            let apart_m = |known: &Known| {
                let [dx, dy] = [0, 1].map(|axis| known.place_m[axis] - place_m[axis]);
                dx.hypot(dy)
            };
            let same = self.known.get(&track.id);
            let same = same.filter(|known| apart_m(known) <= MAX_JUMP_M).copied();
            let is_reported = |id: &u32| report.tracks.iter().any(|other| other.id == *id);
            let mut lost = self.known.iter().filter(|(id, known)| {
                !is_reported(id)
                    && t_s - known.seen_s <= RENUMBERED_S
                    && apart_m(known) <= RENUMBERED_M
            });
            let renumbered = match (same, lost.next(), lost.next()) {
                (None, Some((id, known)), None) => Some((*id, *known)),
                _ => None,
            };
            if let Some((id, _)) = renumbered {
                self.known.remove(&id);
            }
            let same = same.or(renumbered.map(|(_, known)| known));
            let person = same.map_or(self.newest + 1, |known| known.person);
            if people.iter().any(|other| other.id == person) {
                // The number of a track stands twice in the report.
                continue;
            }
            self.newest = self.newest.max(person);
            self.known.insert(
                track.id,
                Known {
                    person,
                    seen_s: t_s,
                    place_m,
                },
            );
            people.push(LiveTrack {
                id: person,
                place_m,
                velocity_mps,
                points: Vec::new(),
            });
        }
        share_points(frame, &mut people);
        people
    }
}

/// Gives each point to the nearest person, if that is near enough.
fn share_points(frame: &PointFrame, people: &mut [LiveTrack]) {
    for (i, point) in (0_u32..).zip(&frame.points) {
        let away_m = |one: &LiveTrack| {
            (f64::from(point.x_m) - one.place_m[0]).hypot(f64::from(point.y_m) - one.place_m[1])
        };
        let nearest = people
            .iter_mut()
            .min_by(|a, b| away_m(a).total_cmp(&away_m(b)));
        if let Some(nearest) = nearest.filter(|one| away_m(one) <= BODY_M) {
            nearest.points.push(i);
        }
    }
}

#[cfg(test)]
mod tests {
    use radarllm_base::{BoardTrack, RadarPoint};

    use super::*;

    fn frame(t_s: f64, tracks: &[(u32, f32)], points: &[f32]) -> PointFrame {
        let track = |(id, y_m): &(u32, f32)| BoardTrack {
            id: *id,
            place_m: [0.0, *y_m],
            height_m: Some(0.5),
            velocity_mps: [0.0; 3],
        };
        let point = |y_m: &f32| RadarPoint {
            y_m: *y_m,
            range_m: *y_m,
            ..RadarPoint::default()
        };
        PointFrame {
            frame: 0,
            time_s: t_s,
            points: points.iter().map(point).collect(),
            board: Some(BoardReport {
                tracks: tracks.iter().map(track).collect(),
                is_present: None,
            }),
        }
    }

    fn ids(people: &mut BoardPeople, frame: &PointFrame) -> Vec<u32> {
        let report = frame.board.as_ref().unwrap();
        people.push(frame, report, 4).iter().map(|p| p.id).collect()
    }

    #[test]
    fn people_keep_their_numbers_and_reused_tracks_are_new_people() {
        let mut people = BoardPeople::default();
        assert_eq!(
            ids(&mut people, &frame(0.0, &[(7, 2.0), (3, 4.0)], &[])),
            [5, 6]
        );
        assert_eq!(
            ids(&mut people, &frame(0.1, &[(3, 4.1), (7, 2.1)], &[])),
            [6, 5]
        );
        // Farther than anybody moves, twice in one report, and absent for long.
        assert_eq!(
            ids(&mut people, &frame(0.2, &[(3, 9.0), (3, 9.0)], &[])),
            [7]
        );
        assert_eq!(ids(&mut people, &frame(9.0, &[(7, 2.1)], &[])), [8]);
        assert!(ids(&mut people, &frame(9.1, &[(7, f32::NAN)], &[])).is_empty());
    }

    #[test]
    fn points_belong_to_the_nearest_person() {
        let frame = frame(0.0, &[(1, 2.0), (2, 3.0)], &[1.5, 2.4, 2.6, 6.0]);
        let report = frame.board.clone().unwrap();
        let people = BoardPeople::default().push(&frame, &report, 0);
        assert_eq!(
            (&people[0].points[..], &people[1].points[..]),
            (&[0, 1][..], &[2][..])
        );
    }
}
