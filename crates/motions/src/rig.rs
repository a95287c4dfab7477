//! Conversion of [`Control`] to joint rotations: balance, spine and two-bone inverse kinematics of
//! the limbs.
//!
//! Knees and elbows are hinges, so they bend only in the anatomical direction for any target. The
//! legs are solved from the feet, so a foot whose target is fixed does not slide.

use std::f32::consts::{FRAC_PI_2, PI};

use glam::{Mat3, Quat, Vec3};
use radarllm_base::skeleton::N_JOINTS;
use radarllm_base::{Joint, Pose, Skeleton};

use crate::control::{Arm, Control, Foot, SIDE_SIGN};
use radarllm_body::proportions::{canonical_skeleton, rest_positions, standing_pelvis_height_m};

/// Body height at which [`Rig::scale`] is 1, so that authored distances are in metres, m.
pub(crate) const AUTHORED_HEIGHT_M: f32 = 1.75;
/// Minimum height of all joints except those of the feet above the floor, m (half the thickness of
/// a limb).
const CLEARANCE_M: f32 = 0.035;
/// Minimum height of the knees above the floor, m. Knees are thicker but also rest on the floor, so
/// only positions that would be below it are swivelled away.
const KNEE_CLEARANCE_M: f32 = 0.01;

/// Share of a limb's length over which the approach to full extension is softened. The knee or
/// elbow angle has a square-root singularity there and would otherwise snap.
const SOFT_REACH: f32 = 0.02;

const HIPS: [Joint; 2] = [Joint::LeftHip, Joint::RightHip];
const KNEES: [Joint; 2] = [Joint::LeftKnee, Joint::RightKnee];
const ANKLES: [Joint; 2] = [Joint::LeftAnkle, Joint::RightAnkle];
const TOES: [Joint; 2] = [Joint::LeftFoot, Joint::RightFoot];
const COLLARS: [Joint; 2] = [Joint::LeftCollar, Joint::RightCollar];
const SHOULDERS: [Joint; 2] = [Joint::LeftShoulder, Joint::RightShoulder];
const ELBOWS: [Joint; 2] = [Joint::LeftElbow, Joint::RightElbow];
const WRISTS: [Joint; 2] = [Joint::LeftWrist, Joint::RightWrist];

/// Share of the body mass at each joint or midpoint of two joints; from segment tables (Winter).
const MASSES: [(Joint, Joint, f32); 14] = [
    (Joint::Head, Joint::Head, 0.081),
    (Joint::Neck, Joint::Spine3, 0.216),
    (Joint::Spine2, Joint::Spine1, 0.139),
    (Joint::Pelvis, Joint::Pelvis, 0.142),
    (Joint::LeftShoulder, Joint::LeftElbow, 0.028),
    (Joint::RightShoulder, Joint::RightElbow, 0.028),
    (Joint::LeftElbow, Joint::LeftWrist, 0.022),
    (Joint::RightElbow, Joint::RightWrist, 0.022),
    (Joint::LeftHip, Joint::LeftKnee, 0.100),
    (Joint::RightHip, Joint::RightKnee, 0.100),
    (Joint::LeftKnee, Joint::LeftAnkle, 0.047),
    (Joint::RightKnee, Joint::RightAnkle, 0.047),
    (Joint::LeftAnkle, Joint::LeftFoot, 0.014),
    (Joint::RightAnkle, Joint::RightFoot, 0.014),
];

/// A skeleton with the derived lengths used for motion planning.
pub(crate) struct Rig {
    /// Bone vectors.
    pub skeleton: Skeleton,
    /// Scale factor for authored distances.
    pub scale: f32,
    /// Pelvis height when standing straight, m.
    pub pelvis_m: f32,
    /// Height of the ankle above the sole, m.
    pub ankle_m: f32,
    /// Lateral distance of a relaxed foot from the midline, m.
    pub stance_m: f32,
    /// Maximum hip-to-ankle distance, m.
    pub leg_m: f32,
    /// Shoulder-to-wrist distance of the straight arm, m.
    pub arm_m: f32,
    /// Ankle position relative to the pelvis along z in the rest pose, m.
    ankle_z_m: f32,
    heel: Vec3,
    ball: Vec3,
}

struct TwoBone {
    upper: Vec3,
    lower: Vec3,
    hinge: Vec3,
    max_bend: f32,
}

impl Rig {
    /// Creates the rig of the canonical skeleton with the given height.
    pub(crate) fn new(height_m: f32) -> Self {
        let skeleton = canonical_skeleton(height_m);
        let rest = rest_positions(&skeleton);
        let pelvis_m = standing_pelvis_height_m(&skeleton);
        let ankle = rest[Joint::LeftAnkle as usize];
        let ankle_m = pelvis_m + ankle.y;
        let toe = skeleton.offsets[Joint::LeftFoot as usize];
        let length = |a: Joint, b: Joint| {
            (skeleton.offsets[a as usize] + skeleton.offsets[b as usize]).length()
        };
        Self {
            scale: height_m / AUTHORED_HEIGHT_M,
            pelvis_m,
            ankle_m,
            stance_m: ankle.x * 1.15,
            leg_m: length(Joint::LeftKnee, Joint::LeftAnkle),
            arm_m: length(Joint::LeftElbow, Joint::LeftWrist),
            ankle_z_m: ankle.z,
            heel: Vec3::new(0.0, -ankle_m, -0.025 * height_m),
            ball: Vec3::new(0.0, -ankle_m, toe.z),
            skeleton,
        }
    }

    /// Position of the ankles along z when standing with the pelvis at z = 0, m.
    pub(crate) fn foot_z_m(&self) -> f32 {
        self.ankle_z_m
    }

    /// Returns the control with its pelvis balanced over the feet and clear of the floor. The
    /// second value is the distance by which the pelvis must still be lowered for the legs to reach
    /// the feet on the floor, m.
    pub(crate) fn settle(&self, control: &Control, sway: Vec3) -> (Control, f32) {
        let mut control = *control;
        for _ in 0..2 {
            let mut lowered = control;
            lowered.hip.y -= self.drop_m(&control);
            let pose = self.pose(&lowered);
            let (at, _) = self.skeleton.forward(&pose);
            let com: Vec3 = MASSES
                .iter()
                .map(|(a, b, m)| (at[*a as usize] + at[*b as usize]) * (0.5 * m))
                .sum::<Vec3>()
                / MASSES.iter().map(|m| m.2).sum::<f32>();
            // In quiet standing the centre of pressure is a third of the way from the ankle to the
            // ball of the foot.
            let support = |side: usize| {
                let foot = &control.feet[side];
                foot.at + Quat::from_rotation_y(foot.yaw) * Vec3::Z * (self.ball.z * 0.35)
            };
            let goal = support(1).lerp(support(0), control.bias);
            let shift = (goal + sway - com) * control.balance;
            control.hip += Vec3::new(shift.x, 0.0, shift.z);
            let lowest = Joint::ALL
                .iter()
                .filter(|j| {
                    !TOES.contains(j)
                        && !ANKLES.contains(j)
                        && !WRISTS.contains(j)
                        && !ELBOWS.contains(j)
                })
                .map(|j| at[*j as usize].y)
                .fold(f32::MAX, f32::min);
            control.hip.y += (CLEARANCE_M - lowest).max(0.0);
        }
        let drop_m = self.drop_m(&control);
        (control, drop_m)
    }

    /// Joint rotations of a settled control in the stage frame; the root of the pose is the pelvis.
    pub(crate) fn pose(&self, control: &Control) -> Pose {
        let mut rotations = [Quat::IDENTITY; N_JOINTS];
        let root = root_turn(control);
        rotations[0] = root;
        let third = Quat::from_rotation_x(control.flex / 3.0)
            * Quat::from_rotation_z(-control.side / 3.0)
            * Quat::from_rotation_y(control.twist / 3.0);
        for joint in [Joint::Spine1, Joint::Spine2, Joint::Spine3] {
            rotations[joint as usize] = third;
        }
        let half = Quat::from_rotation_y(control.look / 2.0)
            * Quat::from_rotation_x(control.nod / 2.0)
            * Quat::from_rotation_z(-control.tilt / 2.0);
        rotations[Joint::Neck as usize] = half;
        rotations[Joint::Head as usize] = half;
        for side in 0..2 {
            let rise = control.arms[side].elevation.sin().clamp(-1.0, 1.0).asin();
            // The collar bone hangs slightly below its T-pose direction and contributes to every
            // arm raise.
            let lift = control.arms[side].shrug - 0.14 + 0.52 * smooth((rise + 0.8) / 2.3);
            let reach_forward =
                rise.cos() * control.arms[side].azimuth.cos() * control.arms[side].reach;
            rotations[COLLARS[side] as usize] = Quat::from_rotation_z(SIDE_SIGN[side] * lift)
                * Quat::from_rotation_y(-SIDE_SIGN[side] * 0.16 * reach_forward.clamp(-0.6, 1.0));
        }
        let mut pose = Pose {
            root_in_world: control.hip,
            rotations,
        };
        let (at, turn) = self.skeleton.forward(&pose);
        for side in 0..2 {
            self.solve_leg(control, side, &mut pose, root);
            let shoulder = at[SHOULDERS[side] as usize];
            let chest = turn[Joint::Spine3 as usize];
            let collar = turn[COLLARS[side] as usize];
            self.solve_arm(
                &control.arms[side],
                side,
                &mut pose,
                shoulder,
                chest,
                collar,
            );
        }
        pose
    }

    /// Ankle position and world rotation of a foot.
    pub(crate) fn ankle(&self, foot: &Foot) -> (Vec3, Quat) {
        let flat = Quat::from_rotation_y(foot.yaw);
        let turn = flat * Quat::from_rotation_x(-foot.pitch) * Quat::from_rotation_z(foot.roll);
        let pivot = if foot.pitch >= 0.0 {
            self.heel
        } else {
            self.ball
        };
        let mut ankle = foot.at + Vec3::Y * self.ankle_m + flat * pivot - turn * pivot;
        let half_width = 0.022 * AUTHORED_HEIGHT_M * self.scale;
        let lowest = [self.heel, self.ball]
            .iter()
            .flat_map(|p| [-half_width, half_width].map(|x| (turn * (*p + Vec3::X * x)).y))
            .fold(f32::MAX, f32::min);
        ankle.y = foot.at.y - lowest;
        (ankle, turn)
    }

    /// Returns the foot control whose ankle is over `ankle` (y ignored), with the lowest point of
    /// the sole on the floor.
    pub(crate) fn foot_for_ankle(&self, ankle: Vec3, yaw: f32, pitch: f32, roll: f32) -> Foot {
        let mut foot = Foot {
            yaw,
            pitch,
            roll,
            ..Foot::default()
        };
        let (at_origin, _) = self.ankle(&foot);
        foot.at = Vec3::new(ankle.x - at_origin.x, 0.0, ankle.z - at_origin.z);
        foot
    }

    fn drop_m(&self, control: &Control) -> f32 {
        let root = root_turn(control);
        let mut drop_m = 0.0_f32;
        for side in 0..2 {
            let foot = &control.feet[side];
            let planted = 1.0 - smooth(foot.at.y / (0.05 * self.scale));
            let (ankle, _) = self.ankle(foot);
            let hip = control.hip + root * self.skeleton.offsets[HIPS[side] as usize];
            let level = Vec3::new(hip.x - ankle.x, 0.0, hip.z - ankle.z).length_squared();
            let reach = (1.0 - 0.6 * SOFT_REACH) * self.leg_m;
            let highest = ankle.y + (reach * reach - level).max(0.0).sqrt();
            drop_m = drop_m.max((hip.y - highest) * planted);
        }
        drop_m.clamp(0.0, 0.25 * self.scale)
    }

    fn solve_leg(&self, control: &Control, side: usize, pose: &mut Pose, root: Quat) {
        let foot = &control.feet[side];
        let hip = pose.root_in_world + root * self.skeleton.offsets[HIPS[side] as usize];
        let (ankle, foot_turn) = self.ankle(foot);
        let bones = TwoBone {
            upper: self.skeleton.offsets[KNEES[side] as usize],
            lower: self.skeleton.offsets[ANKLES[side] as usize],
            hinge: Vec3::X,
            max_bend: 2.75,
        };
        let line = (ankle - hip).normalize_or(Vec3::NEG_Y);
        let mut splay = foot.knee_out * SIDE_SIGN[side];
        let facing = wrap(foot.yaw - control.yaw);
        splay += 0.6 * facing.clamp(-1.2, 1.2);
        let knee_frame = root * Quat::from_rotation_y(splay);
        let (lateral, forward) = (knee_frame * Vec3::X, knee_frame * Vec3::Z);
        // The hinge axis follows the lateral axis of the pelvis. Where the leg itself points
        // sideways, the forward direction of the knee determines it instead.
        let along = lateral.dot(line);
        let hinge = (lateral - line * along) + forward.cross(line) * (along * along);
        let goal = soften(ankle - hip, self.leg_m);
        let solve = |turn: f32| {
            let (thigh, bend) = bones.solve(goal, Quat::from_axis_angle(line, turn) * hinge);
            (thigh, bend, hip + thigh * bones.upper)
        };
        let mut best = solve(0.0);
        if best.2.y < KNEE_CLEARANCE_M {
            // Swivel the knee outward by the minimum that clears the floor, as is done for the
            // elbows.
            let outward = line.cross(best.2 - hip).dot(lateral) * SIDE_SIGN[side];
            let max = FRAC_PI_2.copysign(outward);
            let clears = |share: f32| solve(share * max).2.y >= KNEE_CLEARANCE_M;
            best = solve(min_share(clears) * max);
        }
        let (thigh, bend, _) = best;
        let shin = thigh * Quat::from_rotation_x(bend);
        pose.rotations[HIPS[side] as usize] = root.inverse() * thigh;
        pose.rotations[KNEES[side] as usize] = Quat::from_rotation_x(bend);
        pose.rotations[ANKLES[side] as usize] = shin.inverse() * foot_turn;
        // The toes remain on the floor while the heel rises.
        let planted = 1.0 - smooth(foot.at.y / (0.14 * self.scale));
        let toes = (-foot.pitch).clamp(0.0, 0.65) * planted * smooth((1.9 + foot.pitch) / 0.6);
        pose.rotations[TOES[side] as usize] = Quat::from_rotation_x(-toes);
    }

    fn solve_arm(
        &self,
        arm: &Arm,
        side: usize,
        pose: &mut Pose,
        shoulder: Vec3,
        chest: Quat,
        collar: Quat,
    ) {
        let sign = SIDE_SIGN[side];
        let mirror = |v: Vec3| chest * Vec3::new(v.x * sign, v.y, v.z);
        let (sin_el, cos_el) = arm.elevation.sin_cos();
        let direction = Vec3::new(
            cos_el * arm.azimuth.sin(),
            sin_el,
            cos_el * arm.azimuth.cos(),
        );
        // Keep a hanging arm clear of the hip.
        let direction = Quat::from_rotation_z(0.13 * smooth(-1.6 * sin_el - 0.4)) * direction;
        let relative = shoulder + mirror(direction) * (arm.reach * self.arm_m);
        let mut wrist = relative.lerp(arm.world, arm.world_weight);
        wrist.y = wrist.y.max(CLEARANCE_M);
        let bones = TwoBone {
            upper: self.skeleton.offsets[ELBOWS[side] as usize],
            lower: self.skeleton.offsets[WRISTS[side] as usize],
            hinge: Vec3::Y * -sign,
            max_bend: 2.6,
        };
        let goal = soften(wrist - shoulder, self.arm_m);
        let line = goal.normalize_or(Vec3::NEG_Y);
        let across = |v: Vec3| v - line * v.dot(line);
        let pole = across(mirror(arm.pole)) + across(mirror(Vec3::new(0.5, -0.3, -0.8))) * 0.12;
        let solve = |pole: Vec3| {
            let (upper, bend) = bones.solve(goal, pole.cross(line));
            (upper, bend, (shoulder + upper * bones.upper).y)
        };
        let mut best = solve(pole);
        if best.2 < CLEARANCE_M {
            // Swivel the elbow upward by the minimum that clears the floor.
            let start = pole.normalize_or(across(Vec3::Y));
            let up = across(Vec3::Y) + mirror(Vec3::X) * 1e-3;
            let clears = |share: f32| solve(start.lerp(up, share)).2 >= CLEARANCE_M;
            best = solve(start.lerp(up, min_share(clears)));
        }
        let (upper, bend, _) = best;
        pose.rotations[SHOULDERS[side] as usize] = collar.inverse() * upper;
        pose.rotations[ELBOWS[side] as usize] = Quat::from_rotation_y(-sign * bend);
        pose.rotations[WRISTS[side] as usize] =
            Quat::from_rotation_z(-sign * arm.flex) * Quat::from_rotation_y(-sign * arm.deviate);
    }
}

impl TwoBone {
    /// World rotation of the upper bone and flexion of the hinge (rad, >= 0) that place the end of
    /// the limb at `goal`, given relative to the joint. The goal is clamped to the reach of the
    /// bones, and the hinge axis is near `hinge_in_world`.
    fn solve(&self, goal: Vec3, hinge_in_world: Vec3) -> (Quat, f32) {
        let h = self.hinge;
        let along = |v: Vec3| v.dot(h);
        let flat = |v: Vec3| v - h * along(v);
        let (u, l) = (flat(self.upper), flat(self.lower));
        let (a, b) = (u.length(), l.length());
        // Angle from u to l about the hinge in the T-pose.
        let rest = u.cross(l).dot(h).atan2(u.dot(l));
        let offset = along(self.upper) + along(self.lower);
        let wanted = (goal.length_squared() - offset * offset).max(0.0);
        let cos_bend = ((wanted - a * a - b * b) / (2.0 * a * b)).clamp(-1.0, 1.0);
        let bend = (cos_bend.acos() - rest).clamp(0.0, self.max_bend);
        let end = self.upper + Quat::from_axis_angle(h, bend) * self.lower;
        let from = frame(end, h);
        let to = frame(goal, hinge_in_world);
        (Quat::from_mat3(&(to * from.transpose())).normalize(), bend)
    }
}

/// Minimum share of a swivel, 0..=1, that clears the floor; 1 if no share does.
fn min_share(clears: impl Fn(f32) -> bool) -> f32 {
    let (mut low, mut high) = (0.0_f32, 1.0_f32);
    for _ in 0..14 {
        let mid = 0.5 * (low + high);
        if clears(mid) { high = mid } else { low = mid }
    }
    high
}

/// Rotation of the pelvis in the stage frame.
fn root_turn(control: &Control) -> Quat {
    Quat::from_rotation_y(control.yaw)
        * Quat::from_rotation_x(control.pitch)
        * Quat::from_rotation_z(control.roll)
}

/// Orthonormal axes: the first along `main`, the second as close to `second` as possible.
fn frame(main: Vec3, second: Vec3) -> Mat3 {
    let x = main.normalize_or(Vec3::NEG_Y);
    let mut y = second - x * second.dot(x);
    if y.length_squared() < 1e-10 {
        y = x.any_orthonormal_vector();
    }
    let y = y.normalize();
    Mat3::from_cols(x, y, x.cross(y))
}

/// Pulls the goal slightly inward where it is near the maximum reach of the limb.
fn soften(goal: Vec3, limb_m: f32) -> Vec3 {
    let (distance, soft) = (goal.length(), SOFT_REACH * limb_m);
    let linear = limb_m - soft;
    if distance <= linear {
        return goal;
    }
    goal * ((linear + soft * (1.0 - (-(distance - linear) / soft).exp())) / distance)
}

/// Cubic smoothstep from 0 to 1 on 0..1, constant outside.
pub(crate) fn smooth(x: f32) -> f32 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

/// Wraps an angle to -pi..pi.
pub(crate) fn wrap(angle: f32) -> f32 {
    angle - 2.0 * PI * (angle / (2.0 * PI)).round()
}
