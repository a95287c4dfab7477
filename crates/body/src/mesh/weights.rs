//! Skinning weights of the built-in body.
//!
//! Every joint first claims the vertices beyond a plane through the joint, which gives 0 or 1. The
//! planes are gated so that those of one limb never affect another. These indicator fields then
//! diffuse over the mesh along its edges. The transitions become smooth with a chosen width and
//! follow the surface, so the arm is not attached to the flank beside it. The weight of a joint is
//! its field minus those of its children.
//!
//! Half joints: blending a parent and a child bent by 120 degrees makes the joint collapse. Each
//! joint therefore has a companion bone at the same position that rotates by half the angle. The
//! transition runs from parent to half joint to child, and no two neighbours differ by more than
//! half the angle.

use super::topology::neighbours;
use glam::Vec3;
use radarllm_base::Joint;
use radarllm_base::skeleton::N_JOINTS;

/// Bones of the built-in body: the joints, then a half joint for each (the root's is unused).
pub(super) const N_BONES: usize = 2 * N_JOINTS;
/// Maximum number of influences per vertex.
const MAX_INFLUENCES: usize = 6;
/// Share by which a vertex value moves to the mean of its neighbours in one diffusion step.
const DIFFUSION: f32 = 0.8;

/// Sparse `(bone, weight)` rows, one per vertex, each summing to one.
///
/// `vertices` and `joints` are in the bind pose with the soles at y = 0, m.
pub(super) fn skin_weights(
    vertices: &[Vec3],
    triangles: &[[u32; 3]],
    joints: &[Vec3; N_JOINTS],
    height_m: f32,
) -> Vec<Vec<(usize, f32)>> {
    let (offsets, list) = neighbours(vertices.len(), triangles);
    let around = |v: usize| &list[offsets[v] as usize..offsets[v + 1] as usize];
    let mean_square_edge = {
        let sum: f32 = (0..vertices.len())
            .flat_map(|v| around(v).iter().map(move |&u| (v, u)))
            .map(|(v, u)| vertices[v].distance_squared(vertices[u as usize]))
            .sum();
        sum / list.len().max(1) as f32
    };
    let regions = Regions::new(joints, height_m);

    // beyond[joint][vertex]: degree to which the vertex belongs to the joint or its descendants.
    let beyond: Vec<Vec<f32>> = Joint::ALL
        .iter()
        .map(|&joint| {
            let mut field: Vec<f32> = vertices
                .iter()
                .map(|&p| if regions.claims(joint, p) { 1.0 } else { 0.0 })
                .collect();
            // A step of the diffusion has variance DIFFUSION * edge^2 / 2 per axis of the surface.
            let sigma = transition_m(joint) * height_m / 1.75;
            let n_steps = (sigma * sigma / (DIFFUSION * mean_square_edge / 2.0)).round() as usize;
            if joint != Joint::Pelvis {
                for _ in 0..n_steps {
                    field = (0..vertices.len())
                        .map(|v| {
                            let own = around(v);
                            let mean = own.iter().map(|&u| field[u as usize]).sum::<f32>()
                                / own.len().max(1) as f32;
                            field[v] + DIFFUSION * (mean - field[v])
                        })
                        .collect();
                }
            }
            // The limbs of one side must not influence the other side.
            let side = side_of(joint);
            if side != 0.0 {
                for (f, p) in field.iter_mut().zip(vertices) {
                    *f *= (side * p.x / (0.006 * height_m)).clamp(0.0, 1.0);
                }
            }
            field
        })
        .collect();

    (0..vertices.len())
        .map(|v| row(std::array::from_fn(|j| beyond[j][v])))
        .collect()
}

/// Weights of one vertex from its `beyond` values.
fn row(beyond: [f32; N_JOINTS]) -> Vec<(usize, f32)> {
    // Diffusion with different widths can leave a child slightly above its parent.
    let mut beyond = beyond;
    for joint in Joint::ALL {
        if let Some(parent) = joint.parent() {
            beyond[joint as usize] = beyond[joint as usize].min(beyond[parent as usize]);
        }
    }
    let mut weight = [0.0f32; N_BONES];
    weight[..N_JOINTS].copy_from_slice(&beyond);
    for joint in Joint::ALL {
        if let Some(parent) = joint.parent() {
            weight[parent as usize] -= beyond[joint as usize];
        }
    }
    // Siblings may together exceed their parent (crotch, neck); the sum is restored below.
    weight.iter_mut().for_each(|w| *w = w.max(0.0));

    // Move the share common to parent and child to the half joint.
    let plain: [f32; N_JOINTS] = std::array::from_fn(|j| weight[j]);
    let mut claimed = [0.0f32; N_JOINTS];
    let mut half = [0.0f32; N_JOINTS];
    for joint in Joint::ALL {
        if let Some(parent) = joint.parent() {
            let s = beyond[joint as usize];
            half[joint as usize] = 2.0 * s.min(1.0 - s).max(0.0);
            claimed[joint as usize] += 0.5 * half[joint as usize];
            claimed[parent as usize] += 0.5 * half[joint as usize];
        }
    }
    for joint in Joint::ALL {
        if let Some(parent) = joint.parent() {
            let (j, p) = (joint as usize, parent as usize);
            let room = |k: usize| {
                if claimed[k] > plain[k] {
                    plain[k] / claimed[k]
                } else {
                    1.0
                }
            };
            let h = half[j] * room(j).min(room(p));
            weight[N_JOINTS + j] += h;
            weight[j] -= 0.5 * h;
            weight[p] -= 0.5 * h;
        }
    }

    let mut row: Vec<(usize, f32)> = weight
        .iter()
        .copied()
        .enumerate()
        .filter(|&(_, w)| w > 0.004)
        .collect();
    row.sort_by(|a, b| b.1.total_cmp(&a.1));
    row.truncate(MAX_INFLUENCES);
    let sum: f32 = row.iter().map(|&(_, w)| w).sum();
    row.iter_mut().for_each(|(_, w)| *w /= sum);
    row
}

/// Standard deviation of the transition at a joint, m, for a height of 1.75 m. It is about half the
/// limb's radius at hinges, and larger where several bones share one soft part.
fn transition_m(joint: Joint) -> f32 {
    match joint {
        Joint::Pelvis => 0.0,
        Joint::LeftHip | Joint::RightHip => 0.045,
        Joint::Spine1 | Joint::Spine2 => 0.045,
        Joint::Spine3 => 0.035,
        Joint::LeftKnee | Joint::RightKnee => 0.030,
        Joint::LeftAnkle | Joint::RightAnkle => 0.020,
        Joint::LeftFoot | Joint::RightFoot => 0.015,
        Joint::Neck => 0.025,
        Joint::Head => 0.022,
        Joint::LeftCollar | Joint::RightCollar => 0.040,
        Joint::LeftShoulder | Joint::RightShoulder => 0.040,
        Joint::LeftElbow | Joint::RightElbow => 0.025,
        Joint::LeftWrist | Joint::RightWrist => 0.015,
    }
}

/// +1 for left limbs, -1 for right ones, 0 for the midline.
fn side_of(joint: Joint) -> f32 {
    let name = joint.name();
    if name.starts_with("left_") {
        1.0
    } else if name.starts_with("right_") {
        -1.0
    } else {
        0.0
    }
}

/// Boundaries of each joint's body region in the bind pose.
struct Regions<'a> {
    joints: &'a [Vec3; N_JOINTS],
    scale: f32,
}

impl<'a> Regions<'a> {
    fn new(joints: &'a [Vec3; N_JOINTS], height_m: f32) -> Self {
        Self {
            joints,
            scale: height_m / 1.75,
        }
    }

    fn at(&self, joint: Joint) -> Vec3 {
        self.joints[joint as usize]
    }

    /// True if `p` belongs to `joint` or a descendant.
    fn claims(&self, joint: Joint, p: Vec3) -> bool {
        // The right half is evaluated as the mirror image of the left.
        let side = side_of(joint);
        let mirrored = Vec3::new(if side < 0.0 { -p.x } else { p.x }, p.y, p.z);
        let folded = Vec3::new(p.x.abs(), p.y, p.z);
        let is_arm = self.is_arm(folded);
        let above = |j: Joint| is_arm || (!self.is_leg(folded) && p.y > self.at(j).y);
        match joint {
            Joint::Pelvis => true,
            Joint::Spine1 | Joint::Spine2 | Joint::Spine3 => above(joint),
            Joint::Neck => self.is_neck(folded),
            Joint::Head => self.is_head(folded),
            Joint::LeftHip | Joint::RightHip => self.is_leg(mirrored),
            Joint::LeftKnee | Joint::RightKnee => {
                self.is_leg(mirrored) && p.y < self.at(Joint::LeftKnee).y
            }
            Joint::LeftAnkle | Joint::RightAnkle => self.is_leg(mirrored) && self.is_foot(mirrored),
            Joint::LeftFoot | Joint::RightFoot => {
                let (ankle, ball) = (self.at(Joint::LeftAnkle), self.at(Joint::LeftFoot));
                let forward = Vec3::new(ball.x - ankle.x, 0.0, ball.z - ankle.z).normalize();
                self.is_leg(mirrored)
                    && self.is_foot(mirrored)
                    && (mirrored - ball).dot(forward) > 0.0
            }
            Joint::LeftCollar | Joint::RightCollar => {
                self.is_arm(mirrored) || self.is_collar(mirrored)
            }
            Joint::LeftShoulder | Joint::RightShoulder => self.is_arm(mirrored),
            Joint::LeftElbow | Joint::RightElbow => {
                self.is_arm(mirrored)
                    && self.is_past(
                        mirrored,
                        Joint::LeftShoulder,
                        Joint::LeftElbow,
                        Joint::LeftWrist,
                    )
            }
            Joint::LeftWrist | Joint::RightWrist => {
                self.is_arm(mirrored)
                    && self.is_past(
                        mirrored,
                        Joint::LeftElbow,
                        Joint::LeftWrist,
                        Joint::LeftWrist,
                    )
            }
        }
    }

    /// True if `p` is beyond the bisecting plane of the bones that meet in `middle`.
    fn is_past(&self, p: Vec3, before: Joint, middle: Joint, after: Joint) -> bool {
        let along = (self.at(middle) - self.at(before)).normalize()
            + (self.at(after) - self.at(middle)).normalize_or_zero();
        (p - self.at(middle)).dot(along) > 0.0
    }

    /// True if `p` is outside the shoulder and close to the arm's line (the flank is also below the
    /// shoulder).
    fn is_arm(&self, p: Vec3) -> bool {
        let [shoulder, elbow, wrist] =
            [Joint::LeftShoulder, Joint::LeftElbow, Joint::LeftWrist].map(|joint| self.at(joint));
        let fingertips = wrist + 0.2 * self.scale * (wrist - elbow).normalize();
        let distance =
            segment_distance(p, shoulder, elbow).min(segment_distance(p, elbow, fingertips));
        let is_outside = (p - shoulder).dot(elbow - shoulder) > 0.0 && p.x > 0.6 * shoulder.x;
        is_outside && distance < 0.085 * self.scale
    }

    /// True if `p` is on the collar bone or shoulder blade.
    fn is_collar(&self, p: Vec3) -> bool {
        let from = p - self.at(Joint::LeftCollar);
        from.x > 0.01 * self.scale
            && 0.8 * from.x + 0.6 * (from.y + 0.02 * self.scale) > 0.0
            && !self.is_neck(p)
    }

    /// True if `p` is below the line of the groin, which rises from the crotch to the hip bone. The
    /// buttocks belong to the pelvis further down than the front.
    fn is_leg(&self, p: Vec3) -> bool {
        let crotch_y = 0.815 * self.scale;
        let rise = if p.z > -0.03 * self.scale { 0.80 } else { 0.55 };
        p.x > 0.0 && p.x < 0.30 * self.scale && p.y < crotch_y + rise * p.x && !self.is_arm(p)
    }

    fn is_foot(&self, p: Vec3) -> bool {
        let from = p - self.at(Joint::LeftAnkle);
        from.y - 0.35 * from.z < 0.0
    }

    fn is_neck(&self, p: Vec3) -> bool {
        let neck = self.at(Joint::Neck);
        p.y > neck.y + 0.010 * self.scale && p.x < 0.085 * self.scale
    }

    /// True if `p` is above a plane through the base of the skull that slopes down towards the
    /// chin.
    fn is_head(&self, p: Vec3) -> bool {
        let from = p - self.at(Joint::Head);
        from.y + from.z > 0.0 && self.is_neck(p)
    }
}

/// Distance from `p` to the segment from `a` to `b`, m.
fn segment_distance(p: Vec3, a: Vec3, b: Vec3) -> f32 {
    let t = ((p - a).dot(b - a) / a.distance_squared(b)).clamp(0.0, 1.0);
    p.distance(a.lerp(b, t))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_transition_goes_parent_half_child() {
        let mut beyond = [0.0; N_JOINTS];
        for joint in [Joint::Pelvis, Joint::LeftHip] {
            beyond[joint as usize] = 1.0;
        }
        let bones = |s: f32| {
            let mut b = beyond;
            b[Joint::LeftKnee as usize] = s;
            row(b)
        };
        let (thigh, shin) = (Joint::LeftHip as usize, Joint::LeftKnee as usize);
        assert_eq!(bones(0.0), vec![(thigh, 1.0)]);
        assert_eq!(bones(0.5), vec![(N_JOINTS + shin, 1.0)]);
        assert_eq!(bones(1.0), vec![(shin, 1.0)]);
        assert_eq!(bones(0.25), vec![(thigh, 0.5), (N_JOINTS + shin, 0.5)]);
    }
}
