//! Detects whether a person is present: many points per frame, or few points that are close together.

use radarllm_base::{PointFrame, stats::median_upper};

/// Number of frames that are analysed together: one second.
const BLOCK_FRAMES: usize = 10;
/// Maximum distance of a person's points from their centre on the floor plane, m.
const GATE_M: f32 = 0.75;
/// Minimum number of points near their centre per second. False alarms do not reach it: one or two per frame, spread
/// over 6 m by 6 m, put less than one point per second in the gate.
const MIN_TOGETHER: usize = 5;

/// Minimum number of points of a window in one place, where fewer than [`LEAST_TOGETHER`] come in a second. Firmware with
/// a high threshold reports as few of people who exercise in place.
const MIN_IN_PLACE: usize = 11;
/// Minimum share of them near their centre. Of false alarms, about 5 % are.
const SHARE_IN_PLACE: f32 = 0.7;

/// Median number of points per frame, without leakage.
pub(super) fn median_points(window: &[PointFrame]) -> usize {
    let n_points = |f: &PointFrame| f.points.iter().filter(|p| !p.is_leakage()).count();
    median_upper(window.iter().map(n_points)).unwrap_or(0)
}

/// Returns whether most points are near one place in at least a third of the seconds, or nearly all are near one place in
/// the whole window. People appear in this way to radars whose firmware reports few points.
pub(super) fn points_stay_together(window: &[PointFrame]) -> bool {
    let blocks = window.chunks(BLOCK_FRAMES);
    let n_blocks = blocks.len();
    let is_together = |block: &&[PointFrame]| {
        let (near, all) = near_centre(block);
        near >= MIN_TOGETHER && 2 * near >= all
    };
    let together = blocks.filter(is_together).count();
    let (near, all) = near_centre(window);
    together > 0 && 3 * together >= n_blocks
        || near >= MIN_IN_PLACE && near as f32 >= SHARE_IN_PLACE * all as f32
}

/// Number of points within [`GATE_M`] of their median position, and of all points.
fn near_centre(frames: &[PointFrame]) -> (usize, usize) {
    let all = || frames.iter().flat_map(|f| &f.points);
    let points = || all().filter(|p| !p.is_leakage());
    let (Some(x_m), Some(y_m)) = (
        median_upper(points().map(|p| p.x_m)),
        median_upper(points().map(|p| p.y_m)),
    ) else {
        return (0, 0);
    };
    let near = points().filter(|p| (p.x_m - x_m).hypot(p.y_m - y_m) <= GATE_M);
    (near.count(), points().count())
}

#[cfg(test)]
mod tests {
    use super::*;
    use radarllm_base::RadarPoint;
    use rand::{RngExt, SeedableRng, rngs::ChaCha8Rng};

    fn window(frames: usize, mut points: impl FnMut(usize) -> Vec<RadarPoint>) -> Vec<PointFrame> {
        (0..frames)
            .map(|i| PointFrame {
                frame: i as u32,
                time_s: i as f64 / 10.0,
                points: points(i),
                board: None,
            })
            .collect()
    }

    fn at(x_m: f32, y_m: f32) -> RadarPoint {
        RadarPoint {
            x_m,
            y_m,
            ..RadarPoint::default()
        }
    }

    /// One point per frame along a walk at 0.5 m/s is a person. Five false alarms per frame at random places are not.
    #[test]
    fn few_points_of_a_walker_stay_together_and_false_alarms_do_not() {
        let walker = window(60, |i| vec![at(0.3, 4.0 - 0.1 * i as f32 / 2.0)]);
        assert!(points_stay_together(&walker));
        assert_eq!(median_points(&walker), 1);
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        for n in [1, 2, 5] {
            let mut place = || at(rng.random_range(-3.0..3.0), rng.random_range(0.5..6.5));
            let noise = window(60, |_| (0..n).map(|_| place()).collect());
            assert!(!points_stay_together(&noise), "{n}");
        }
    }

    /// Two points a second in one place are a person, beside some false alarms.
    #[test]
    fn few_points_in_one_place_are_a_person() {
        let jumps = |n_false: usize| {
            window(60, move |i| match i % 5 {
                0 => vec![at(0.2, 2.0)],
                1 if i < n_false * 5 => vec![at(2.5, 5.0)],
                _ => vec![],
            })
        };
        assert!(points_stay_together(&jumps(0)));
        assert!(points_stay_together(&jumps(4)));
        assert!(!points_stay_together(&jumps(10)));
    }

    #[test]
    fn a_person_who_is_seen_in_few_seconds_is_none_and_nothing_is_nothing() {
        // Points in one of six seconds only.
        let brief = window(60, |i| if i < 10 { vec![at(0.0, 2.0)] } else { vec![] });
        assert!(!points_stay_together(&brief));
        assert!(!points_stay_together(&window(60, |_| vec![])));
        assert!(!points_stay_together(&[]));
        assert_eq!(median_points(&[]), 0);
    }
}
