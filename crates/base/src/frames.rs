//! Coordinate frames.
//!
//! | frame | axes | used by |
//! |---|---|---|
//! | body rest | x to the person's left, y up, z forward (SMPL-X) | skeleton offsets, local rotations |
//! | world | z up, floor at z = 0; a canonical motion starts at x = y = 0 facing -y, so that its left is +x | [`crate::Motion`] |
//! | radar | x right, y boresight (away from the radar), z up, radar at the origin | surfaces, cubes, points |
//!
//! `radar_from_world` is a rotation about z and a translation: see [`Placement`].

use glam::{Quat, Vec3};

/// Root rotation of a person who stands upright in the T-pose and faces -y in the world. It maps rest y (up) to
/// world z, rest z (forward) to world -y, and rest x (left) to world x.
pub fn world_from_rest_facing_radar() -> Quat {
    Quat::from_rotation_x(std::f32::consts::FRAC_PI_2)
}

/// Pose of a motion's world frame relative to a radar.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// World origin on the floor, in the radar's horizontal axes, m. (0, 3) is 3 m on boresight.
    pub position_m: [f32; 2],
    /// Rotation of the person about the vertical, rad, counter-clockwise seen from above.
    /// 0 faces the radar.
    pub heading_rad: f32,
    /// Height of the radar above the floor, m.
    pub radar_height_m: f32,
}

impl Default for Placement {
    fn default() -> Self {
        Self {
            position_m: [0.0, 3.0],
            heading_rad: 0.0,
            radar_height_m: 1.0,
        }
    }
}

impl Placement {
    /// Maps a point from the motion's world frame into the radar frame, m.
    pub fn radar_from_world(&self, world: Vec3) -> Vec3 {
        let turned = self.radar_from_world_rotation() * world;
        turned + Vec3::new(self.position_m[0], self.position_m[1], -self.radar_height_m)
    }

    /// Rotation from the motion's world frame into the radar frame.
    pub fn radar_from_world_rotation(&self) -> Quat {
        Quat::from_rotation_z(self.heading_rad)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn canonical_person_faces_the_radar_with_left_at_positive_x() {
        let q = world_from_rest_facing_radar();
        assert!((q * Vec3::Y - Vec3::Z).length() < 1e-6, "up");
        assert!((q * Vec3::Z + Vec3::Y).length() < 1e-6, "forward");
        assert!((q * Vec3::X - Vec3::X).length() < 1e-6, "left");
    }

    #[test]
    fn quarter_turn_faces_positive_x() {
        // Facing -y turned by +90 degrees (counter-clockwise from above) faces +x.
        let p = Placement {
            heading_rad: std::f32::consts::FRAC_PI_2,
            ..Default::default()
        };
        let forward = p.radar_from_world(-Vec3::Y) - p.radar_from_world(Vec3::ZERO);
        assert!((forward - Vec3::X).length() < 1e-6);
    }
}
