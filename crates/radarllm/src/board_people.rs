//! The people whom a board tracks, each with a clip of their own.

use radarllm_base::{BoardReport, BoardTrack, Clip, PointFrame};
use radarllm_measure::{
    TrackedPerson,
    people::{MIN_TRACKED_S, tracked_people},
};
use radarllm_tracking::{PeopleOptions, Person};

/// Points within this distance of a track on the floor, m, are the person's.
const BODY_M: f32 = 1.0;

/// The people of a clip in which a board tracks people, in the order in which they were first seen; `None` if no frame has
/// a report of a board. Of more than [`PeopleOptions::max_people`], those who were tracked for longest are kept.
///
/// Each clip has the track of one person and the points near it. People who are nearer to each other share points.
pub fn board_people(clip: &Clip, options: &PeopleOptions) -> Option<Vec<Person>> {
    let mut people = tracked_people(&clip.frames, None)?;
    people.retain(|p| p.length_s() >= MIN_TRACKED_S);
    if let Some(n) = options.max_people {
        people.sort_by(|a, b| b.length_s().total_cmp(&a.length_s()));
        people.truncate(n);
        people.sort_by(|a, b| a.start_s().total_cmp(&b.start_s()));
    }
    let people = (1_u32..).zip(&people);
    Some(
        people
            .map(|(id, person)| person_of(clip, id, person))
            .collect(),
    )
}

fn person_of(clip: &Clip, id: u32, person: &TrackedPerson) -> Person {
    let (start_s, end_s) = (person.start_s(), person.end_s());
    let inside = clip.frames.iter();
    let inside = inside.filter(|f| (start_s..=end_s).contains(&f.time_s));
    let mut samples = person.samples.iter().peekable();
    let mut place_m = person.samples.first().map_or([0.0; 2], |s| s.place_m);
    let own = |frame: &PointFrame| {
        while let Some(sample) = samples.next_if(|s| s.t_s <= frame.time_s) {
            place_m = sample.place_m;
        }
        let is_near = |x_m: f32, y_m: f32| (x_m - place_m[0]).hypot(y_m - place_m[1]) <= BODY_M;
        let points = frame.points.iter().filter(|p| is_near(p.x_m, p.y_m));
        PointFrame {
            frame: frame.frame,
            time_s: frame.time_s,
            points: points.copied().collect(),
            board: frame.board.as_ref().map(|report| BoardReport {
                // A track that is lost and found at once under another number is one person's.
                tracks: (report.tracks.iter())
                    .find(|t| t.place_m == place_m)
                    .map(|t| BoardTrack {
                        id: person.track,
                        ..*t
                    })
                    .into_iter()
                    .collect(),
                is_present: report.is_present,
            }),
        }
    };
    let clip = clip.with_frames(inside.map(own).collect());
    Person {
        id,
        start_s,
        end_s,
        n_points: clip.n_points(),
        clip,
    }
}

#[cfg(test)]
mod tests {
    use radarllm_base::{Clutter, RadarPoint};

    use super::*;

    /// A clip of 10 s.
    fn clip(frame: impl Fn(u32) -> PointFrame) -> Clip {
        Clip {
            frames: (0..100).map(frame).collect(),
            frame_rate_hz: 10.0,
            radar_height_m: 1.5,
            is_height_assumed: false,
            radar: "board".into(),
            provenance: "recorded:uart:x".parse().unwrap(),
            clutter: Clutter::Settled,
        }
    }

    #[test]
    fn a_person_keeps_the_track_under_other_numbers() {
        // Another number every two seconds.
        let frame = |i: u32| PointFrame {
            frame: i,
            time_s: f64::from(i) / 10.0,
            points: Vec::new(),
            board: Some(BoardReport {
                tracks: vec![BoardTrack {
                    id: i / 20,
                    place_m: [0.5, 2.0 + 0.01 * i as f32],
                    height_m: Some(0.2),
                    velocity_mps: [0.0; 3],
                }],
                is_present: None,
            }),
        };
        let clip = clip(frame);
        let people = board_people(&clip, &PeopleOptions::default()).unwrap();
        let [person] = &people[..] else {
            panic!("{} people", people.len())
        };
        let reports: Vec<&BoardReport> = person.clip.frames.iter().flat_map(|f| &f.board).collect();
        assert_eq!(reports.len(), 100);
        assert!(
            reports
                .iter()
                .all(|b| matches!(b.tracks[..], [t] if t.id == 0))
        );
    }

    #[test]
    fn each_person_has_their_own_track_and_points() {
        let frame = |i: u32| {
            let track = |id: u32, x_m: f32| BoardTrack {
                id,
                place_m: [x_m, 2.0],
                height_m: Some(0.2),
                velocity_mps: [0.0; 3],
            };
            let point = |x_m: f32| RadarPoint {
                x_m,
                y_m: 2.2,
                ..RadarPoint::default()
            };
            // The second comes after 5 s; a third flickers.
            let mut tracks = vec![track(4, -1.5)];
            tracks.extend((i >= 50).then(|| track(2, 1.5)));
            tracks.extend((i == 70).then(|| track(9, 0.0)));
            PointFrame {
                frame: i,
                time_s: f64::from(i) / 10.0,
                points: vec![point(-1.4), point(1.4), point(1.6)],
                board: Some(BoardReport {
                    tracks,
                    is_present: None,
                }),
            }
        };
        let clip = clip(frame);
        let people = board_people(&clip, &PeopleOptions::default()).unwrap();
        let found: Vec<(u32, f64, usize)> = people
            .iter()
            .map(|p| (p.id, p.start_s, p.n_points))
            .collect();
        assert_eq!(found, [(1, 0.0, 100), (2, 5.0, 100)]);
        for person in &people {
            let reports = person.clip.frames.iter().flat_map(|f| &f.board);
            assert!(
                reports.clone().count() > 0 && reports.into_iter().all(|b| b.tracks.len() == 1)
            );
        }
        let one = PeopleOptions {
            max_people: Some(1),
            ..PeopleOptions::default()
        };
        assert_eq!(board_people(&clip, &one).unwrap()[0].start_s, 0.0);
        let plain = clip.with_frames(vec![PointFrame::default()]);
        assert_eq!(board_people(&plain, &one), None);
    }
}
