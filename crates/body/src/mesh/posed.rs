//! A moving body in front of a radar.

use super::BodyModel;
use crate::proportions::standing_pelvis_height_m;
use crate::sample::MotionSampler;
use glam::{Quat, Vec3};
use radarllm_base::frames::Placement;
use radarllm_base::{Material, MovingSurface, Pose, Skeleton};
use std::sync::Arc;

/// A body that performs a motion at a given placement: the surface that the simulator uses.
///
/// Local joint rotations are applied to the body unchanged. The root path is scaled uniformly by
/// the ratio of the two standing pelvis heights. Soles that touch the floor in the motion therefore
/// touch it on the body, and the stride length matches the legs.
pub struct PosedBody {
    body: Arc<dyn BodyModel>,
    sampler: MotionSampler,
    placement: Placement,
    material: Material,
    /// Ratio of the body's lengths to those of the motion.
    root_scale: f32,
}

impl PosedBody {
    /// A body that performs a motion at a place.
    pub fn new(
        body: Arc<dyn BodyModel>,
        sampler: MotionSampler,
        placement: Placement,
        material: Material,
    ) -> Self {
        let root_scale = root_scale(body.as_ref(), sampler.skeleton());
        Self {
            body,
            sampler,
            placement,
            material,
            root_scale,
        }
    }

    /// The body.
    pub fn body(&self) -> &dyn BodyModel {
        self.body.as_ref()
    }

    /// The body's pose at `time_s` in the radar frame.
    fn pose_in_radar_frame(&self, time_s: f64) -> Pose {
        let mut pose = self.pose_in_world(time_s);
        // Transforming the root transforms every vertex, because skinning is linear in the root's
        // transform.
        pose.root_in_world = self.placement.radar_from_world(pose.root_in_world);
        pose.rotations[0] = Quat::from_rotation_z(self.placement.heading_rad) * pose.rotations[0];
        pose
    }

    /// The body's pose at `time_s` in the motion's world frame, with the scaled root path.
    pub fn pose_in_world(&self, time_s: f64) -> Pose {
        let mut pose = self.sampler.sample(time_s);
        pose.root_in_world *= self.root_scale;
        pose
    }
}

/// Transfers a pose of a motion on `motion_skeleton` to `body`; see [`PosedBody`].
pub fn pose_on_body(pose: &Pose, motion_skeleton: &Skeleton, body: &dyn BodyModel) -> Pose {
    let root_in_world = pose.root_in_world * root_scale(body, motion_skeleton);
    Pose {
        root_in_world,
        rotations: pose.rotations,
    }
}

/// Scale factor of a motion's root path that keeps the body's feet on the floor.
fn root_scale(body: &dyn BodyModel, motion_skeleton: &Skeleton) -> f32 {
    let ratio = body.standing_pelvis_height_m() / standing_pelvis_height_m(motion_skeleton);
    // A skeleton without legs does not determine a scale.
    if ratio.is_finite() && ratio > 0.0 {
        ratio
    } else {
        1.0
    }
}

impl MovingSurface for PosedBody {
    fn triangles(&self) -> &[[u32; 3]] {
        self.body.triangles()
    }

    fn n_vertices(&self) -> usize {
        self.body.n_vertices()
    }

    fn positions_at(&self, time_s: f64, out: &mut [Vec3]) {
        self.body.pose_into(&self.pose_in_radar_frame(time_s), out);
    }

    fn positions_at_times(&self, times_s: &[f64], out: &mut [&mut [Vec3]]) {
        // Batch size: the number of poses that a frame of the simulator needs, without an
        // allocation.
        const AT_ONCE: usize = 5;
        for (times_s, out) in times_s.chunks(AT_ONCE).zip(out.chunks_mut(AT_ONCE)) {
            let last = times_s.len() - 1;
            let poses: [Pose; AT_ONCE] =
                std::array::from_fn(|i| self.pose_in_radar_frame(times_s[i.min(last)]));
            self.body.pose_many_into(&poses[..=last], out);
        }
    }

    fn material(&self) -> Material {
        self.material
    }
}

/// Power reflection coefficient of skin at normal incidence at 77 GHz, for a permittivity of
/// 6.6 - j8.9 (-4.7 dB). The permittivity is quoted from memory and still needs a source.
pub const SKIN_POWER_REFLECTION_77_GHZ: f32 = 0.34;
/// RMS roughness of clothes and skin, m. It reduces the coherent return at 77 GHz by 11 dB relative
/// to a smooth body, so that a walking person is mostly diffuse with a few highlights.
pub const CLOTHED_ROUGHNESS_M: f32 = 0.0005;
/// Albedo of the diffuse term, chosen so that a standing adult has about -8 dBsm averaged over
/// azimuth (an unverified figure for 76 to 77 GHz). A test recomputes it from the mesh.
pub const CLOTHED_ROUGH_ALBEDO: f32 = 0.11;

/// Material of a clothed person at 77 GHz.
pub fn clothed_skin() -> Material {
    Material {
        power_reflection: SKIN_POWER_REFLECTION_77_GHZ,
        roughness_m: CLOTHED_ROUGHNESS_M,
        rough_albedo: CLOTHED_ROUGH_ALBEDO,
        power_transmission: 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::super::{BodyShape, Build, BuiltinBody};
    use super::*;
    use crate::proportions::canonical_skeleton;
    use radarllm_base::frames::world_from_rest_facing_radar;
    use radarllm_base::skeleton::N_JOINTS;
    use radarllm_base::{Joint, Motion};

    fn standing(height_m: f32) -> Motion {
        let skeleton = canonical_skeleton(height_m);
        let mut rotations = [Quat::IDENTITY; N_JOINTS];
        rotations[0] = world_from_rest_facing_radar();
        rotations[Joint::LeftShoulder as usize] = Quat::from_rotation_z(-1.2);
        rotations[Joint::RightShoulder as usize] = Quat::from_rotation_z(1.2);
        let root_in_world = Vec3::Z * standing_pelvis_height_m(&skeleton);
        Motion {
            fps: 30.0,
            skeleton,
            poses: vec![
                Pose {
                    root_in_world,
                    rotations
                };
                2
            ],
        }
    }

    fn posed(body_height_m: f32, motion: &Motion, placement: Placement) -> PosedBody {
        let shape = BodyShape {
            height_m: body_height_m,
            build: Build::Average,
            facet_edge_m: 0.03,
        };
        let body = Arc::new(BuiltinBody::new(&shape).expect("supported shape"));
        PosedBody::new(body, MotionSampler::new(motion), placement, clothed_skin())
    }

    #[test]
    fn soles_stay_on_the_floor_on_a_body_of_another_height() {
        let placement = Placement::default();
        for body_height_m in [1.2, 1.9] {
            let surface = posed(body_height_m, &standing(1.6), placement);
            let mut out = vec![Vec3::ZERO; surface.n_vertices()];
            surface.positions_at(0.01, &mut out);
            let low = out.iter().map(|p| p.z).fold(f32::INFINITY, f32::min);
            let high = out.iter().map(|p| p.z).fold(f32::NEG_INFINITY, f32::max);
            // The rim of the sole is rounded over a few millimetres.
            assert!((low + placement.radar_height_m).abs() < 0.004, "{low}");
            assert!(((high - low) / body_height_m - 1.0).abs() < 0.01);
            let motion = standing(1.6);
            let on_body = pose_on_body(&motion.poses[0], &motion.skeleton, surface.body());
            assert_eq!(
                on_body.root_in_world,
                surface.pose_in_world(0.0).root_in_world
            );
        }
    }

    #[test]
    fn placing_the_root_equals_placing_every_vertex() {
        let placement = Placement {
            position_m: [0.5, 4.0],
            heading_rad: 0.8,
            radar_height_m: 1.2,
        };
        let surface = posed(1.7, &standing(1.7), placement);
        let (mut direct, mut slow) = (
            vec![Vec3::ZERO; surface.n_vertices()],
            vec![Vec3::ZERO; surface.n_vertices()],
        );
        surface.positions_at(0.0, &mut direct);
        surface
            .body()
            .pose_into(&surface.pose_in_world(0.0), &mut slow);
        for (a, b) in direct.iter().zip(&slow) {
            assert!(
                a.distance(placement.radar_from_world(*b)) < 1e-5,
                "f32 rounding of metre-sized numbers"
            );
        }
    }

    #[test]
    fn several_times_at_once_are_the_same_positions() {
        let mut motion = standing(1.7);
        motion.poses[1].root_in_world.x += 0.05;
        let surface = posed(1.7, &motion, Placement::default());
        // More than one batch.
        let times_s = [0.0, 0.005, 0.01, 0.015, 0.02, 0.025, 0.03];
        let n = surface.n_vertices();
        let mut many = vec![Vec3::ZERO; times_s.len() * n];
        let mut parts: Vec<&mut [Vec3]> = many.chunks_exact_mut(n).collect();
        surface.positions_at_times(&times_s, &mut parts);
        for (&time_s, part) in times_s.iter().zip(many.chunks_exact(n)) {
            let mut one = vec![Vec3::ZERO; n];
            surface.positions_at(time_s, &mut one);
            assert_eq!(one, part, "{time_s}");
        }
        assert_ne!(many[..n], many[6 * n..]);
    }

    #[test]
    fn the_diffuse_term_gives_the_intended_mean_cross_section() {
        // Sum of 4 rho A cos^2 over facets that face a distant radar, averaged over azimuth;
        // hidden facets are counted too, which adds about half a decibel.
        let surface = posed(1.75, &standing(1.75), Placement::default());
        let mut out = vec![Vec3::ZERO; surface.n_vertices()];
        surface.positions_at(0.0, &mut out);
        let n_azimuths = 24;
        let mean_m2 = (0..n_azimuths)
            .map(|i| {
                let to_radar =
                    Quat::from_rotation_z(std::f32::consts::TAU * i as f32 / n_azimuths as f32)
                        * Vec3::X;
                surface
                    .triangles()
                    .iter()
                    .map(|t| {
                        let [a, b, c] = t.map(|v| out[v as usize]);
                        let normal = (b - a).cross(c - a);
                        let area = 0.5 * normal.length();
                        let cos = normal.normalize_or_zero().dot(to_radar).max(0.0);
                        4.0 * surface.material().rough_albedo * area * cos * cos
                    })
                    .sum::<f32>()
            })
            .sum::<f32>()
            / n_azimuths as f32;
        let mean_dbsm = 10.0 * mean_m2.log10();
        // -8 dBsm plus half a decibel for hidden facets. The tolerance of one decibel is smaller
        // than the uncertainty of the -8 dBsm figure.
        assert!((mean_dbsm + 7.5).abs() < 1.0, "{mean_dbsm}");
    }
}
