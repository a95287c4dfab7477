//! Position of a person in front of the radar.

use glam::{Quat, Vec3};
use radarllm_base::{Motion, RadarConfig, frames::Placement};
use rand::{RngExt, SeedableRng, rngs::ChaCha8Rng};

/// Minimum distance of the pelvis from the radar along boresight, m. Nearer, a body extends beyond the antenna pattern.
pub const MIN_DISTANCE_M: f32 = 1.3;

/// Distance along boresight within which the far ends of paths stay that are placed at random, m, unless a larger distance
/// is asked for. The maximum range of the reference radar is 10.99 m.
const FAR_END_M: f32 = 9.0;

/// Ranges of clip placements: the distance to the middle of the path and the heading are drawn uniformly.
///
/// A path whose near end would be nearer than [`MIN_DISTANCE_M`] is moved away until it is there. A path that is drawn from
/// a range of distances is moved nearer, as far as that allows, until its far end is within 9 m or within the largest
/// distance of the range. A single distance is kept otherwise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlacementRange {
    /// Distance of the path's middle along boresight, m.
    pub distance_m: [f32; 2],
    /// Sideways offset of the path's middle, m, drawn from +- this value.
    pub lateral_m: f32,
    /// Heading of the first pose, rad, drawn from +- this value; 0 faces the radar.
    pub heading_rad: f32,
    /// Height of the radar above the floor, m.
    pub radar_height_m: f32,
}

impl Default for PlacementRange {
    fn default() -> Self {
        Self {
            distance_m: [2.5, 4.0],
            lateral_m: 0.3,
            heading_rad: 25_f32.to_radians(),
            radar_height_m: 1.0,
        }
    }
}

impl PlacementRange {
    /// Checks that a person can be seen at the distances.
    ///
    /// # Errors
    /// Distances that are all nearer than [`MIN_DISTANCE_M`], or a distance beyond the radar's maximum range, with both
    /// limits.
    pub fn check(&self, radar: &RadarConfig) -> Result<(), String> {
        let [near_m, far_m] = self.distance_m;
        let max_m = radar.max_range_m();
        if far_m >= MIN_DISTANCE_M && near_m <= far_m && f64::from(far_m) <= max_m {
            return Ok(());
        }
        let found = match near_m == far_m {
            true => format!("{far_m} m"),
            false => format!("{near_m} to {far_m} m"),
        };
        Err(format!(
            "{found}, but a person is seen from {MIN_DISTANCE_M} m on, where the body is within the antenna pattern, up to \
             {max_m:.2} m, the maximum range of the radar `{}`",
            radar.name
        ))
    }
}

/// Smallest and largest coordinates of the pelvis over a motion that is turned about the vertical.
fn extent(motion: &Motion, heading_rad: f32) -> (Vec3, Vec3) {
    let turn = Quat::from_rotation_z(heading_rad);
    let (mut low, mut high) = (Vec3::splat(f32::MAX), Vec3::splat(f32::MIN));
    for pose in &motion.poses {
        let p = turn * pose.root_in_world;
        low = low.min(p);
        high = high.max(p);
    }
    (low, high)
}

/// Nearest distance of the middle of a motion's path at a heading, m: its near end is at [`MIN_DISTANCE_M`].
pub fn min_middle_m(motion: &Motion, heading_rad: f32) -> f32 {
    let (low, high) = extent(motion, heading_rad);
    MIN_DISTANCE_M + 0.5 * (high.y - low.y)
}

/// Draws a placement for a canonical motion (first pose at the origin facing -y) such that the
/// whole path is in front of the radar, as far as it fits; see [`PlacementRange`].
pub fn draw_placement(motion: &Motion, range: &PlacementRange, seed: u64) -> Placement {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut uniform = |low: f32, high: f32| low + (high - low) * rng.random::<f32>();
    let heading_rad = uniform(-range.heading_rad, range.heading_rad);
    let distance_m = uniform(range.distance_m[0], range.distance_m[1]);
    let lateral_m = uniform(-range.lateral_m, range.lateral_m);

    let (low, high) = extent(motion, heading_rad);
    let middle = 0.5 * (low + high);
    let half_depth = 0.5 * (high.y - low.y);
    let near_enough = MIN_DISTANCE_M + half_depth;
    let [near_m, far_m] = range.distance_m;
    let far_enough = match near_m == far_m {
        true => f32::INFINITY,
        false => (FAR_END_M.max(far_m) - half_depth).max(near_enough),
    };
    let centre_y_m = distance_m.clamp(near_enough, far_enough);
    Placement {
        position_m: [lateral_m - middle.x, centre_y_m - middle.y],
        heading_rad,
        radar_height_m: range.radar_height_m,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use radarllm_base::{Pose, Skeleton, skeleton::N_JOINTS};

    fn straight_walk(length_m: f32) -> Motion {
        let pose = |y: f32| Pose {
            root_in_world: Vec3::new(0.0, -y, 0.9),
            rotations: [Quat::IDENTITY; N_JOINTS],
        };
        Motion {
            fps: 10.0,
            skeleton: Skeleton {
                offsets: [Vec3::ZERO; N_JOINTS],
            },
            poses: (0..=20).map(|i| pose(length_m * i as f32 / 20.0)).collect(),
        }
    }

    #[test]
    fn paths_stay_in_front_of_the_radar() {
        for (length_m, seed) in [(0.0, 1), (2.0, 2), (5.0, 3), (7.5, 4)] {
            let motion = straight_walk(length_m);
            let placement = draw_placement(&motion, &PlacementRange::default(), seed);
            for pose in &motion.poses {
                let y = placement.radar_from_world(pose.root_in_world).y;
                assert!(
                    (1.29..=9.01).contains(&y),
                    "{length_m} m walk reaches y = {y}"
                );
            }
        }
    }

    #[test]
    fn a_single_distance_is_kept_and_a_range_reaches_as_far_as_it_says() {
        let middle_m = |length_m: f32, distance_m: [f32; 2], seed: u64| {
            let motion = straight_walk(length_m);
            let range = PlacementRange {
                distance_m,
                heading_rad: 0.0,
                ..PlacementRange::default()
            };
            let placement = draw_placement(&motion, &range, seed);
            let y_m = |i: usize| placement.radar_from_world(motion.poses[i].root_in_world).y;
            0.5 * (y_m(0) + y_m(20))
        };
        for distance_m in [2.0, 8.0, 12.0, 40.0] {
            let found = middle_m(1.4, [distance_m; 2], 1);
            assert!((found - distance_m).abs() < 1e-4, "{distance_m}: {found}");
        }
        // The near end of a path of 4 m is at 1.3 m.
        assert!((middle_m(4.0, [2.0; 2], 1) - 3.3).abs() < 1e-4);
        assert!((min_middle_m(&straight_walk(4.0), 0.0) - 3.3).abs() < 1e-4);
        let drawn = |length_m: f32, distance_m: [f32; 2]| -> Vec<f32> {
            let of_seed = |seed| middle_m(length_m, distance_m, seed);
            (0..100).map(of_seed).collect()
        };
        // Somebody who stands is anywhere within the range; the path of a walk of 4 m ends at its far end.
        let standing = drawn(0.0, [9.0, 20.0]);
        assert!(standing.iter().all(|m| (9.0..=20.0).contains(m)));
        assert!(standing.iter().any(|m| *m > 18.5));
        let walking = drawn(4.0, [9.0, 20.0]);
        assert!(walking.iter().all(|m| (9.0..=18.001).contains(m)));
        // Up to 9 m for smaller distances.
        let walking = drawn(7.0, [1.5, 6.0]);
        assert!(walking.iter().all(|m| (4.799..=5.501).contains(m)));
    }

    #[test]
    fn distances_where_nobody_is_seen_are_refused_with_the_limits() {
        let radar = RadarConfig::awr1843boost();
        let check = |distance_m: [f32; 2]| {
            let range = PlacementRange {
                distance_m,
                ..PlacementRange::default()
            };
            range.check(&radar)
        };
        // The maximum range is 10.99 m. A range may begin nearer than the minimum distance.
        for distance_m in [[1.3, 1.3], [3.0, 3.0], [1.0, 3.5], [9.0, 10.9]] {
            assert_eq!(check(distance_m), Ok(()), "{distance_m:?}");
        }
        for distance_m in [
            [0.0, 0.0],
            [0.2, 1.2],
            [9.0, 11.0],
            [200.0, 200.0],
            [f32::NAN, f32::NAN],
            [4.0, 2.0],
        ] {
            let error = check(distance_m).unwrap_err();
            assert!(
                error.contains("1.3 m") && error.contains("10.99 m"),
                "{error}"
            );
        }
    }

    #[test]
    fn the_same_seed_gives_the_same_place() {
        let motion = straight_walk(3.0);
        let range = PlacementRange::default();
        assert_eq!(
            draw_placement(&motion, &range, 7),
            draw_placement(&motion, &range, 7)
        );
        assert_ne!(
            draw_placement(&motion, &range, 7),
            draw_placement(&motion, &range, 8)
        );
    }
}
