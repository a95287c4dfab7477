//! The built-in body, generated from tables; it needs no licence.

use super::anatomy::body_field;
use super::polygonize::polygonize;
use super::remesh::remesh;
use super::skin::Skin;
use super::topology::neighbours;
use super::weights::{N_BONES, skin_weights};
use super::{BodyError, BodyModel};
use crate::proportions::{canonical_skeleton, standing_pelvis_height_m};
use glam::{Affine3A, Quat, Vec3};
use radarllm_base::skeleton::N_JOINTS;
use radarllm_base::{Joint, Pose, Skeleton};

/// Angle of the arms below the T-pose in the bind pose, rad. It is between the two extremes that
/// the arms reach, and closer to hanging, their usual position.
const BIND_ARM_DROP_RAD: f32 = 0.60;

/// Shape parameters of a built-in body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyShape {
    /// Standing height, m, 1.0..=2.0.
    pub height_m: f32,
    /// Width of the trunk and thickness of the limbs.
    pub build: Build,
    /// Maximum edge length of a facet in the bind pose, m, 0.008..=0.05. The default 0.02 gives
    /// about 17,000 facets for an average adult.
    pub facet_edge_m: f32,
}

impl Default for BodyShape {
    fn default() -> Self {
        Self {
            height_m: 1.75,
            build: Build::Average,
            facet_edge_m: 0.02,
        }
    }
}

/// Girth of trunk and limbs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Build {
    /// Narrow trunk and thin limbs.
    Slim,
    /// Between the two others.
    Average,
    /// Wide trunk and thick limbs.
    Heavy,
}

/// A closed mesh of a person with hands, feet and head, skinned to the canonical skeleton.
///
/// Generation takes a few tenths of a second, so generate one body per shape and share it.
pub struct BuiltinBody {
    shape: BodyShape,
    skeleton: Skeleton,
    standing_pelvis_height_m: f32,
    triangles: Vec<[u32; 3]>,
    /// Bind-pose vertices, pelvis joint at the origin, rest axes, m.
    bind_vertices: Vec<Vec3>,
    skin: Skin,
    /// Transforms that map bind-pose positions into each joint's own axes.
    joint_from_bind: [Affine3A; N_JOINTS],
    /// The same for the half joints, whose axes are those of the parent in the bind pose.
    half_from_bind: [Affine3A; N_JOINTS],
}

impl BuiltinBody {
    /// Generates the body.
    ///
    /// # Errors
    /// [`BodyError::Height`] or [`BodyError::FacetEdge`] outside the supported range.
    pub fn new(shape: &BodyShape) -> Result<Self, BodyError> {
        if !(1.0..=2.0).contains(&shape.height_m) {
            return Err(BodyError::Height {
                height_m: shape.height_m,
            });
        }
        if !(0.008..=0.05).contains(&shape.facet_edge_m) {
            return Err(BodyError::FacetEdge {
                facet_edge_m: shape.facet_edge_m,
            });
        }
        let skeleton = canonical_skeleton(shape.height_m);
        let pelvis_height_m = standing_pelvis_height_m(&skeleton);
        let pelvis = Vec3::new(0.0, pelvis_height_m, 0.005 * shape.height_m);
        let bind = bind_pose(pelvis);
        let (joints, _) = skeleton.forward(&bind);

        let field = body_field(&joints, shape.height_m, shape.build);
        // The cells are small enough to resolve fingers and nose; remeshing then produces the final
        // facets.
        let cell_m = (0.75 * shape.facet_edge_m).min(0.0086 * shape.height_m);
        let (vertices, triangles) = polygonize(&field, cell_m);
        let (vertices, triangles) = largest_part(vertices, triangles);
        let detail = Detail::new(&joints, shape.height_m);
        let (vertices, triangles) = remesh(vertices, triangles, &field, shape.facet_edge_m, &|p| {
            detail.scale_at(p)
        });
        let rows = skin_weights(&vertices, &triangles, &joints, shape.height_m);
        let skin = Skin::new(rows.iter().map(Vec::as_slice));

        let bind_vertices = vertices.iter().map(|&v| v - pelvis).collect();
        let at_origin = bind_pose(Vec3::ZERO);
        let (joint_from_bind, half_from_bind) = inverse_bind(&skeleton, &at_origin);
        Ok(Self {
            shape: *shape,
            skeleton,
            standing_pelvis_height_m: pelvis_height_m,
            triangles,
            bind_vertices,
            skin,
            joint_from_bind,
            half_from_bind,
        })
    }

    /// The shape parameters of the body.
    pub fn shape(&self) -> &BodyShape {
        &self.shape
    }

    /// The pose in which the mesh was generated: arms halfway down, root at the origin, rest axes.
    pub fn bind_pose(&self) -> Pose {
        bind_pose(Vec3::ZERO)
    }

    /// Vertices in [`Self::bind_pose`], m.
    pub fn bind_vertices(&self) -> &[Vec3] {
        &self.bind_vertices
    }

    /// Weight of every joint on a vertex; a half joint counts half for its joint and half for the
    /// parent.
    pub fn joint_weights(&self, vertex: usize) -> [f32; N_JOINTS] {
        let mut weights = [0.0; N_JOINTS];
        for (bone, weight) in self.skin.row(vertex) {
            if bone < N_JOINTS {
                weights[bone] += weight;
            } else {
                let joint = Joint::ALL[bone - N_JOINTS];
                weights[joint as usize] += 0.5 * weight;
                weights[joint.parent().unwrap_or(joint) as usize] += 0.5 * weight;
            }
        }
        weights
    }
}

impl BodyModel for BuiltinBody {
    fn name(&self) -> &str {
        "builtin"
    }

    fn skeleton(&self) -> &Skeleton {
        &self.skeleton
    }

    fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    fn n_vertices(&self) -> usize {
        self.bind_vertices.len()
    }

    fn standing_pelvis_height_m(&self) -> f32 {
        self.standing_pelvis_height_m
    }

    fn pose_into(&self, pose: &Pose, out: &mut [Vec3]) {
        assert_eq!(
            out.len(),
            self.bind_vertices.len(),
            "one position per vertex"
        );
        let bones = bones(&self.skeleton, &bind_pose(Vec3::ZERO), pose);
        let mut world_from_bind = [Affine3A::IDENTITY; N_BONES];
        for j in 0..N_JOINTS {
            world_from_bind[j] = bones[j] * self.joint_from_bind[j];
            world_from_bind[N_JOINTS + j] = bones[N_JOINTS + j] * self.half_from_bind[j];
        }
        self.skin
            .apply(0, &world_from_bind, &self.bind_vertices, out);
    }
}

/// World transforms of the joints, then of the half joints.
fn bones(skeleton: &Skeleton, bind: &Pose, pose: &Pose) -> [Affine3A; N_BONES] {
    let (position, rotation) = skeleton.forward(pose);
    let mut bones = [Affine3A::IDENTITY; N_BONES];
    for joint in Joint::ALL {
        let j = joint as usize;
        bones[j] = Affine3A::from_rotation_translation(rotation[j], position[j]);
        bones[N_JOINTS + j] = match joint.parent() {
            None => bones[j],
            Some(parent) => {
                // Half of the rotation away from the bind pose.
                let turn = pose.rotations[j] * bind.rotations[j].inverse();
                let half = rotation[parent as usize] * half_turn(turn);
                Affine3A::from_rotation_translation(half, position[j])
            }
        };
    }
    bones
}

/// The rotation about the same axis by half the (shorter) angle. It fades to the identity as that
/// angle approaches half a turn, where the shorter direction changes sides. Without the fade, the
/// skin of a circling arm would jump across the joint between two radar chirps.
fn half_turn(q: Quat) -> Quat {
    /// Angle at which the fade begins, rad; of the joints in everyday motion only the shoulder
    /// exceeds it.
    const FADE_FROM_RAD: f32 = 2.0;
    let (axis, angle) = if q.w < 0.0 { -q } else { q }.to_axis_angle();
    let share = ((angle - FADE_FROM_RAD) / (std::f32::consts::PI - FADE_FROM_RAD)).clamp(0.0, 1.0);
    let fade = 1.0 - share * share * (3.0 - 2.0 * share);
    Quat::from_axis_angle(axis, 0.5 * angle * fade)
}

fn inverse_bind(skeleton: &Skeleton, bind: &Pose) -> ([Affine3A; N_JOINTS], [Affine3A; N_JOINTS]) {
    let bones = bones(skeleton, bind, bind);
    (
        std::array::from_fn(|j| bones[j].inverse()),
        std::array::from_fn(|j| bones[N_JOINTS + j].inverse()),
    )
}

fn bind_pose(root: Vec3) -> Pose {
    let mut rotations = [Quat::IDENTITY; N_JOINTS];
    rotations[Joint::LeftShoulder as usize] = Quat::from_rotation_z(-BIND_ARM_DROP_RAD);
    rotations[Joint::RightShoulder as usize] = Quat::from_rotation_z(BIND_ARM_DROP_RAD);
    Pose {
        root_in_world: root,
        rotations,
    }
}

/// Regions where the mesh needs smaller facets than elsewhere.
struct Detail {
    hand: Vec3,
    hand_radius_m: f32,
    face: Vec3,
    face_radius_m: f32,
}

impl Detail {
    fn new(joints: &[Vec3; N_JOINTS], height_m: f32) -> Self {
        let (elbow, wrist) = (
            joints[Joint::LeftElbow as usize],
            joints[Joint::LeftWrist as usize],
        );
        Self {
            hand: wrist + 0.06 * height_m * (wrist - elbow).normalize(),
            hand_radius_m: 0.07 * height_m,
            face: joints[Joint::Head as usize] + Vec3::new(0.0, 0.01, 0.07) * height_m,
            face_radius_m: 0.05 * height_m,
        }
    }

    fn scale_at(&self, p: Vec3) -> f32 {
        let folded = Vec3::new(p.x.abs(), p.y, p.z);
        let near = |center: Vec3, radius: f32| {
            // 1 inside the radius, 0 beyond 1.5 radii.
            (3.0 - 2.0 * folded.distance(center) / radius).clamp(0.0, 1.0)
        };
        1.0 - 0.25 * near(self.hand, self.hand_radius_m).max(near(self.face, self.face_radius_m))
    }
}

/// Keeps the connected component with the largest number of triangles.
fn largest_part(vertices: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let (offsets, list) = neighbours(vertices.len(), &triangles);
    let mut part = vec![u32::MAX; vertices.len()];
    let mut n_parts = 0;
    for start in 0..vertices.len() {
        if part[start] != u32::MAX {
            continue;
        }
        let mut stack = vec![start as u32];
        part[start] = n_parts;
        while let Some(v) = stack.pop() {
            for &u in &list[offsets[v as usize] as usize..offsets[v as usize + 1] as usize] {
                if part[u as usize] == u32::MAX {
                    part[u as usize] = n_parts;
                    stack.push(u);
                }
            }
        }
        n_parts += 1;
    }
    if n_parts <= 1 {
        return (vertices, triangles);
    }
    let mut size = vec![0usize; n_parts as usize];
    triangles
        .iter()
        .for_each(|t| size[part[t[0] as usize] as usize] += 1);
    let largest = (0..n_parts).max_by_key(|&p| size[p as usize]).unwrap_or(0);
    let mut new_index = vec![u32::MAX; vertices.len()];
    let mut kept = Vec::new();
    for (v, &at) in vertices.iter().enumerate() {
        if part[v] == largest {
            new_index[v] = kept.len() as u32;
            kept.push(at);
        }
    }
    let triangles = triangles
        .into_iter()
        .filter(|t| part[t[0] as usize] == largest)
        .map(|t| t.map(|v| new_index[v as usize]))
        .collect();
    (kept, triangles)
}

#[cfg(test)]
mod tests {
    use super::super::topology::{
        euler_characteristic, is_closed_and_oriented, longest_edge_m, volume_m3,
    };
    use super::*;

    #[test]
    fn the_half_turn_is_continuous_through_a_full_circle() {
        // 1 degree steps of a whole circle: the half joint never turns faster than five times the
        // joint (half the angle, times the slope of the fade), where a jump would be 180 degrees.
        let step_rad = 1_f32.to_radians();
        let mut before = half_turn(Quat::IDENTITY);
        for i in 1..=720 {
            let now = half_turn(Quat::from_rotation_x(i as f32 * step_rad));
            assert!(now.angle_between(before) < 5.0 * step_rad, "degree {i}");
            before = now;
        }
        // Below the start of the fade it is exactly half of the rotation.
        let half = half_turn(Quat::from_rotation_z(1.4));
        assert!(half.angle_between(Quat::from_rotation_z(0.7)) < 5e-3);
    }

    use radarllm_base::frames::world_from_rest_facing_radar;
    use std::sync::LazyLock;

    fn shape(height_m: f32, build: Build) -> BodyShape {
        BodyShape {
            height_m,
            build,
            ..Default::default()
        }
    }

    static ADULT: LazyLock<BuiltinBody> = LazyLock::new(|| {
        BuiltinBody::new(&BodyShape::default()).expect("the default shape is supported")
    });

    #[test]
    fn every_shape_is_one_closed_surface_of_the_asked_height_with_short_edges() {
        for build in [Build::Slim, Build::Average, Build::Heavy] {
            for height_m in [1.0, 1.5, 2.0] {
                let body = BuiltinBody::new(&shape(height_m, build)).expect("supported");
                let (v, t) = (body.bind_vertices(), body.triangles());
                assert!(is_closed_and_oriented(t), "{height_m} {build:?}");
                assert_eq!(euler_characteristic(v.len(), t), 2, "{height_m} {build:?}");
                assert!(longest_edge_m(v, t) <= 0.02);
                let low = v.iter().map(|p| p.y).fold(f32::INFINITY, f32::min);
                let high = v.iter().map(|p| p.y).fold(f32::NEG_INFINITY, f32::max);
                assert!(
                    ((high - low) / height_m - 1.0).abs() < 0.01,
                    "{height_m} {build:?}: {}",
                    high - low
                );
                // Soles on the floor within the rounding of their rim.
                assert!((low + body.standing_pelvis_height_m()).abs() < 0.003);
                // Flesh has about 1000 kg/m^3; body mass index kg/m^2 of thin to obese people.
                // Children scaled from an adult are too thin: mass scales with the cube, hence the
                // comparison at the height of an adult.
                let adult_mass_kg = 1000.0 * volume_m3(v, t) * f64::from(1.75 / height_m).powi(3);
                let index = adult_mass_kg / (1.75 * 1.75);
                let expected = match build {
                    Build::Slim => 17.0..20.0,
                    Build::Average => 21.0..24.0,
                    Build::Heavy => 26.0..31.0,
                };
                assert!(
                    expected.contains(&index),
                    "{height_m} {build:?}: body mass index {index}"
                );
            }
        }
    }

    #[test]
    fn the_default_adult_has_the_promised_number_of_facets() {
        let n = ADULT.triangles().len();
        assert!((10_000..18_000).contains(&n), "{n}");
        let coarse = BodyShape {
            facet_edge_m: 0.035,
            ..Default::default()
        };
        let coarse = BuiltinBody::new(&coarse).expect("supported");
        assert!(coarse.triangles().len() < n / 2);
        assert!(is_closed_and_oriented(coarse.triangles()));
        assert!(longest_edge_m(coarse.bind_vertices(), coarse.triangles()) <= 0.035);
    }

    #[test]
    fn shapes_out_of_range_are_refused() {
        for height_m in [0.9, 2.1, f32::NAN, -1.0, f32::INFINITY] {
            assert!(matches!(
                BuiltinBody::new(&shape(height_m, Build::Slim)),
                Err(BodyError::Height { .. })
            ));
        }
        for facet_edge_m in [0.0, 0.2, f32::NAN] {
            let shape = BodyShape {
                facet_edge_m,
                ..Default::default()
            };
            assert!(matches!(
                BuiltinBody::new(&shape),
                Err(BodyError::FacetEdge { .. })
            ));
        }
    }

    #[test]
    fn generation_is_deterministic() {
        let again = BuiltinBody::new(&BodyShape::default()).expect("supported");
        assert_eq!(again.triangles(), ADULT.triangles());
        assert_eq!(again.bind_vertices(), ADULT.bind_vertices());
    }

    #[test]
    fn left_and_right_halves_mirror_each_other() {
        // Facets differ, the surface does not: each mirrored vertex has a near one, and both
        // halves have the same first moments.
        let v = ADULT.bind_vertices();
        for p in v.iter().step_by(37) {
            let mirrored = Vec3::new(-p.x, p.y, p.z);
            let nearest = v
                .iter()
                .map(|q| q.distance(mirrored))
                .fold(f32::INFINITY, f32::min);
            assert!(nearest < 0.02, "{p}: {nearest}");
        }
        let volume = volume_m3(v, ADULT.triangles());
        let moment_x: f64 = ADULT
            .triangles()
            .iter()
            .map(|t| {
                let [a, b, c] = t.map(|i| v[i as usize].as_dvec3());
                a.dot(b.cross(c)) / 6.0 * (a.x + b.x + c.x) / 4.0
            })
            .sum();
        // The centre of mass is on the midline within the noise of 2 cm facets.
        assert!((moment_x / volume).abs() < 1e-3, "{}", moment_x / volume);
    }

    #[test]
    fn weights_sum_to_one_and_stay_on_their_side() {
        for v in 0..ADULT.n_vertices() {
            let weights = ADULT.joint_weights(v);
            let sum: f32 = weights.iter().sum();
            // Rounding of at most six f32.
            assert!((sum - 1.0).abs() < 1e-5 && weights.iter().all(|w| *w >= 0.0));
            let x = ADULT.bind_vertices()[v].x;
            for joint in Joint::ALL {
                let is_other_side = joint.name().starts_with("left_") && x < 0.0
                    || joint.name().starts_with("right_") && x > 0.0;
                assert!(
                    !is_other_side || weights[joint as usize] == 0.0,
                    "{} acts at x = {x}",
                    joint.name()
                );
            }
        }
    }

    #[test]
    fn the_flank_does_not_follow_the_arm_and_the_hand_does() {
        let (rest, _) = ADULT.skeleton().forward(&ADULT.bind_pose());
        let arm = [Joint::LeftShoulder, Joint::LeftElbow, Joint::LeftWrist];
        let arm_weight = |v: usize| {
            arm.iter()
                .map(|j| ADULT.joint_weights(v)[*j as usize])
                .sum::<f32>()
        };
        let hip = rest[Joint::LeftHip as usize];
        let wrist = rest[Joint::LeftWrist as usize];
        for (v, p) in ADULT.bind_vertices().iter().enumerate() {
            if p.y < hip.y + 0.3 && p.x.abs() < 0.2 {
                assert!(arm_weight(v) < 0.01, "{p}");
            }
            if p.x > wrist.x + 0.03 {
                // Past the transition at the wrist, a rigid hand.
                assert!(
                    ADULT.joint_weights(v)[Joint::LeftWrist as usize] > 0.99,
                    "{p}"
                );
            }
        }
    }

    #[test]
    fn the_bind_pose_reproduces_the_mesh_and_a_moved_root_is_rigid() {
        let mut out = vec![Vec3::ZERO; ADULT.n_vertices()];
        let mut pose = ADULT.bind_pose();
        ADULT.pose_into(&pose, &mut out);
        for (a, b) in out.iter().zip(ADULT.bind_vertices()) {
            assert!(a.distance(*b) < 1e-5, "f32 rounding of metre-sized numbers");
        }
        let turn = Quat::from_rotation_z(0.7) * world_from_rest_facing_radar();
        let shift = Vec3::new(1.5, -3.0, 0.9);
        pose.rotations[0] = turn;
        pose.root_in_world = shift;
        ADULT.pose_into(&pose, &mut out);
        for (a, b) in out.iter().zip(ADULT.bind_vertices()) {
            assert!(
                a.distance(turn * *b + shift) < 1e-5,
                "f32 rounding of metre-sized numbers"
            );
        }
    }

    #[test]
    fn a_bent_knee_keeps_its_volume() {
        // Flesh that only bends keeps its volume; 1.5 % of the body allows for the crease behind the
        // knee, where the surface folds into itself.
        let mut out = vec![Vec3::ZERO; ADULT.n_vertices()];
        let mut pose = ADULT.bind_pose();
        ADULT.pose_into(&pose, &mut out);
        let straight = volume_m3(&out, ADULT.triangles());
        for knee in [Joint::LeftKnee, Joint::RightKnee] {
            pose.rotations[knee as usize] = Quat::from_rotation_x(2.0);
        }
        ADULT.pose_into(&pose, &mut out);
        let bent = volume_m3(&out, ADULT.triangles());
        assert!((bent / straight - 1.0).abs() < 0.015, "{}", bent / straight);
    }

    #[test]
    fn every_joint_moves_what_hangs_on_it_and_nothing_else() {
        let (rest, _) = ADULT.skeleton().forward(&ADULT.bind_pose());
        let mut out = vec![Vec3::ZERO; ADULT.n_vertices()];
        for joint in Joint::ALL.into_iter().skip(1) {
            let mut pose = ADULT.bind_pose();
            pose.rotations[joint as usize] *= Quat::from_axis_angle(Vec3::new(0.6, 0.0, 0.8), 0.5);
            ADULT.pose_into(&pose, &mut out);
            let moved: Vec<f32> = out
                .iter()
                .zip(ADULT.bind_vertices())
                .map(|(a, b)| a.distance(*b))
                .collect();
            let n_moved = moved.iter().filter(|d| **d > 1e-3).count();
            // Toes are the smallest part.
            assert!(n_moved > 50, "{} moves {n_moved} vertices", joint.name());
            // Far from the joint on the root's side nothing moves: the pelvis itself.
            for (d, p) in moved.iter().zip(ADULT.bind_vertices()) {
                let is_pelvis = p.y.abs() < 0.02 && p.z < -0.05 && p.x.abs() < 0.05;
                if is_pelvis && rest[joint as usize].length() > 0.25 {
                    assert!(*d < 1e-4, "{} moves the pelvis by {d} m", joint.name());
                }
            }
        }
    }
}
