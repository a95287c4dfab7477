//! Estimation of the length unit and vertical axis of a file that states neither.

use super::{Probe, Seen};
use crate::loaders::source::SourcePose;
use glam::{Quat, Vec3};
use radarllm_base::Joint;

/// Hip-to-ankle length along the bones as a share of the height, from the average body. This length
/// does not depend on the posture, and every rig has these joints.
pub(super) const LEG_SHARE: f32 = 0.465;
/// Shoulder-to-wrist length along the bones as a share of the height.
const ARM_SHARE: f32 = 0.302;

/// Units that files use, in order of likelihood, each with the range of heights accepted for it.
const UNITS: [(f64, &str); 7] = [
    (1.0, "metre"),
    (0.01, "centimetre"),
    (0.001, "millimetre"),
    (0.0254 / 0.45, "1/0.45 inch (CMU, 5.6444 cm)"),
    (0.0254, "inch"),
    (0.1, "decimetre"),
    (0.3048, "foot"),
];

impl Probe<'_> {
    /// Metres per file unit: the first candidate that makes the person 1.0 to 2.3 m tall.
    pub(super) fn decide_unit(
        &self,
        known: Option<(f64, String)>,
        warnings: &mut Vec<String>,
    ) -> (f64, String) {
        let height = self.leg_height_m().map_or(0.0, f64::from) / f64::from(self.metres_per_unit);
        let plausible = |metres: f64| (1.0..=2.3).contains(&(height * metres));
        if let Some((metres, name)) = known {
            if !plausible(metres) {
                warnings.push(format!(
                    "the stated unit makes the person about {:.2} m tall",
                    height * metres
                ));
            }
            return (metres, name);
        }
        if let Some((metres, name)) = UNITS.into_iter().find(|(metres, _)| plausible(*metres)) {
            return (metres, name.into());
        }
        if height < 1e-6 {
            warnings.push("no limb lengths to tell the unit from: metres are assumed".into());
            return (1.0, "unknown".into());
        }
        warnings.push(format!(
            "no known unit makes this person 1.0 to 2.3 m tall ({height:.3} units): scaled to 1.7 m"
        ));
        (1.7 / height, "scaled to 1.7 m".into())
    }

    /// Standing height estimated from the legs, or otherwise from the arms, m (in the current
    /// unit). Uses frame 0.
    pub(super) fn leg_height_m(&self) -> Option<f32> {
        let seen = self.frame(0);
        let length = |joints: [Joint; 3]| -> Option<f32> {
            let [a, b, c] = joints.map(|j| seen.positions[j as usize]);
            let length = a?.distance(b?) + b?.distance(c?);
            (length > 0.0).then_some(length)
        };
        let mean = |left: Option<f32>, right: Option<f32>, share: f32| match (left, right) {
            (Some(l), Some(r)) => Some(0.5 * (l + r) / share),
            (one, other) => one.or(other).map(|v| v / share),
        };
        let legs = mean(
            length([Joint::LeftHip, Joint::LeftKnee, Joint::LeftAnkle]),
            length([Joint::RightHip, Joint::RightKnee, Joint::RightAnkle]),
            LEG_SHARE,
        );
        legs.or_else(|| {
            mean(
                length([Joint::LeftShoulder, Joint::LeftElbow, Joint::LeftWrist]),
                length([Joint::RightShoulder, Joint::RightElbow, Joint::RightWrist]),
                ARM_SHARE,
            )
        })
    }

    /// The rest pose, if it shows a standing person whose left and right sides are not exchanged.
    pub(super) fn person_at_rest(&self) -> Option<SourcePose> {
        let pose = self.source.rest();
        let seen = self.seen(&pose);
        let up = body_up(&seen)?;
        let at = |j: Joint| seen.positions[j as usize];
        let left = (at(Joint::LeftHip)? - at(Joint::RightHip)?).try_normalize()?;
        let forward = left.cross(up);
        let straight = |a: Joint, b: Joint| -> Option<f32> {
            Some((at(b)? - at(a)?).try_normalize()?.dot(-up))
        };
        let legs_hang = straight(Joint::LeftHip, Joint::LeftKnee)? > 0.8
            && straight(Joint::RightHip, Joint::RightKnee)? > 0.8
            && straight(Joint::LeftKnee, Joint::LeftAnkle)? > 0.8
            && straight(Joint::RightKnee, Joint::RightAnkle)? > 0.8;
        let side = |shoulder: Joint, wrist: Joint| -> Option<f32> {
            Some((at(wrist)? - at(shoulder)?).try_normalize()?.dot(left))
        };
        // Arms may hang (0) or be spread (1), but must not cross over.
        let arms_out = side(Joint::LeftShoulder, Joint::LeftWrist).is_none_or(|s| s > -0.1)
            && side(Joint::RightShoulder, Joint::RightWrist).is_none_or(|s| s < 0.1);
        let toes = |ankle: Joint, foot: Joint| -> Option<f32> {
            Some((at(foot)? - at(ankle)?).try_normalize()?.dot(forward))
        };
        let feet_forward = toes(Joint::LeftAnkle, Joint::LeftFoot).is_none_or(|t| t > 0.2)
            && toes(Joint::RightAnkle, Joint::RightFoot).is_none_or(|t| t > 0.2);
        (left.dot(up).abs() < 0.3 && legs_hang && arms_out && feet_forward).then_some(pose)
    }

    /// Rotation from file axes to the world, whose z is up.
    pub(super) fn decide_up(
        &self,
        rest: Option<&SourcePose>,
        frames: &[usize],
        warnings: &mut Vec<String>,
    ) -> Quat {
        // Rest poses are upright. Moving bodies are upright on average unless they lie down all the
        // time.
        let mean = match rest {
            Some(pose) => body_up(&self.seen(pose)).unwrap_or(Vec3::ZERO),
            None => {
                let sum: Vec3 = frames.iter().filter_map(|f| body_up(&self.frame(*f))).sum();
                sum / frames.len().max(1) as f32
            }
        };
        let axes = [
            Vec3::Y,
            Vec3::Z,
            Vec3::NEG_Y,
            Vec3::NEG_Z,
            Vec3::X,
            Vec3::NEG_X,
        ];
        match axes.into_iter().find(|axis| axis.dot(mean) > 0.6) {
            Some(up) => Quat::from_rotation_arc(up, Vec3::Z),
            None => {
                warnings
                    .push("the vertical axis cannot be told from the posture: y is assumed".into());
                Quat::from_rotation_arc(Vec3::Y, Vec3::Z)
            }
        }
    }
}

/// Direction from the feet (or pelvis) to the head (or shoulders).
fn body_up(seen: &Seen) -> Option<Vec3> {
    let at = |j: Joint| seen.positions[j as usize];
    let middle = |l: Joint, r: Joint| Some(0.5 * (at(l)? + at(r)?));
    let low = middle(Joint::LeftAnkle, Joint::RightAnkle)
        .or_else(|| middle(Joint::LeftKnee, Joint::RightKnee))
        .or_else(|| at(Joint::Pelvis))?;
    let high = at(Joint::Head)
        .or_else(|| at(Joint::Neck))
        .or_else(|| middle(Joint::LeftShoulder, Joint::RightShoulder))
        .or_else(|| at(Joint::Spine3))
        .or_else(|| at(Joint::Pelvis))?;
    (high - low).try_normalize()
}
