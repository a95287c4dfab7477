//! Reflections of people over walls.

use radarllm_tracking::{TrackOptions, find_ghosts, track};

use crate::scenes::{off_line, points, summary, walker};

/// A concrete wall in the plane x = 1.5 m.
const WALL: &str = "max_bounces = 2\nbounce_rays = 128\n[[target]]\nkind = \"plate\"\nposition_m = [1.5, 3.0, 0.0]\n\
                    normal = [-1.0, 0.0, 0.0]\nsize_m = [6.0, 3.0]\nmaterial = \"concrete\"\nfacet_edge_m = 0.05\n";

#[test]
fn ghosts_over_a_wall_go_and_a_second_person_stays() {
    let starts = [([0.4, 4.2], 0.0), ([-1.2, 2.0], 170.0)];
    let people = starts.map(|(start, heading)| walker(start, heading, 2.4));
    for has_wall in [true, false] {
        let wall = if has_wall { WALL } else { "" };
        let scene = ["duration_s = 2.6\n", wall, &people[0], &people[1]].concat();
        let frames = points(&scene);
        let mut tracks = track(&frames, &TrackOptions::default()).unwrap();
        let ghosts = find_ghosts(&tracks, &frames);
        let text = format!("{:#?} {ghosts:#?}", summary(&tracks));
        if has_wall {
            assert!(
                tracks.len() > 2 && !ghosts.is_empty(),
                "there are ghosts: {text}"
            );
        } else {
            assert!(ghosts.is_empty(), "{text}");
        }
        // Who walks where, from nearest to the line of each.
        let walks = |t: &radarllm_tracking::Track, person: usize| {
            let (start, heading) = starts[person];
            let off = t.frames.iter().map(|f| off_line(f.place_m, start, heading));
            off.sum::<f64>() / (t.frames.len() as f64) < 0.3 && t.frames.len() > 20
        };
        for ghost in &ghosts {
            let of = tracks.iter().find(|t| t.id == ghost.of).unwrap();
            assert!(walks(of, 0), "the one beside the wall: {text}");
            // A wall beside somebody who walks straight ahead: ranges and velocities do not tell its side, and the
            // bearing of a ghost that takes it one way stays the person's. Planes are 0.1 m and 2 degrees apart; a
            // body is 0.2 m from its middle to its front.
            assert!((ghost.wall_m - 1.5).abs() < 0.5, "{text}");
            let azimuth_deg = ghost.wall_azimuth_rad.to_degrees().abs();
            assert!((azimuth_deg - 90.0).abs() < 20.0, "{text}");
        }
        tracks.retain(|t| ghosts.iter().all(|g| g.id != t.id));
        assert_eq!(tracks.len(), 2, "{text}");
        assert!((0..2).all(|p| tracks.iter().any(|t| walks(t, p))), "{text}");
    }
}
