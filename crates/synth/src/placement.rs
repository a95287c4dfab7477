//! Position of a person in front of the radar.

use glam::{Quat, Vec3};
use radarllm_base::{Motion, frames::Placement};
use rand::{RngExt, SeedableRng, rngs::ChaCha8Rng};

/// Minimum and maximum distance of the pelvis from the radar along boresight, m. The maximum range of the reference
/// radar is 10.99 m. Nearer than 1.3 m, a body extends beyond the antenna pattern.
const PELVIS_Y_M: [f32; 2] = [1.3, 9.0];

/// Ranges of clip placements: the distance to the middle of the path and the heading are drawn uniformly.
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

/// Draws a placement for a canonical motion (first pose at the origin facing -y) such that the
/// whole path is in front of the radar, as far as it fits.
pub fn draw_placement(motion: &Motion, range: &PlacementRange, seed: u64) -> Placement {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut uniform = |low: f32, high: f32| low + (high - low) * rng.random::<f32>();
    let heading_rad = uniform(-range.heading_rad, range.heading_rad);
    let distance_m = uniform(range.distance_m[0], range.distance_m[1]);
    let lateral_m = uniform(-range.lateral_m, range.lateral_m);

    let turn = Quat::from_rotation_z(heading_rad);
    let (mut low, mut high) = (Vec3::splat(f32::MAX), Vec3::splat(f32::MIN));
    for pose in &motion.poses {
        let p = turn * pose.root_in_world;
        low = low.min(p);
        high = high.max(p);
    }
    let middle = 0.5 * (low + high);
    let half_depth = 0.5 * (high.y - low.y);
    // A long path moves away from the radar until its near end keeps the distance.
    let near_enough = PELVIS_Y_M[0] + half_depth;
    let far_enough = (PELVIS_Y_M[1] - half_depth).max(near_enough);
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
