//! Retargeting of other skeletons and of bare joint positions to the 22 joints of SMPL-X.
//!
//! The local axes of a rig are arbitrary. Every mapped joint therefore has one constant rotation
//! `source_from_rest` between its own axes and those of the SMPL-X joint:
//! `world_from_joint(t) = world_from_source(t) * source_from_rest`. This rotation is determined where the posture is
//! known. If the rest pose of the rig shows a standing person, the rest pose is used. Otherwise it
//! is the average over frames of the rotations that the joint positions alone require, snapped to
//! the rig's own axes if these are near. Each bone is then rotated by the remaining few degrees so
//! that it points exactly along the joints of the source, regardless of the joints in between. The
//! skeleton keeps the bone lengths of the person.

mod calibrate;
mod units;

use crate::error::{MotionError, excerpt};
use crate::ik::{bone_child, rest_of, rotations_from_positions, shortest};
use crate::loaders::names::{JointMap, map_joints};
use crate::loaders::source::{SourceMotion, SourcePose};
use crate::proportions::{DEFAULT_HEIGHT_M, canonical_skeleton, rest_positions, standing_height_m};
use crate::sample::ground;
use glam::{Quat, Vec3};
use radarllm_base::frames::world_from_rest_facing_radar;
use radarllm_base::skeleton::N_JOINTS;
use radarllm_base::stats::median_upper;
use radarllm_base::{Joint, Motion, Pose, Skeleton};

/// Number of frames evaluated to determine axes, lengths and unit, spread evenly over the motion.
const N_PROBES: usize = 128;

/// Maximum number of joint evaluations per file; ten minutes of a full rig at 120 fps take 7e6.
const MAX_EVALUATIONS: usize = 400_000_000;

/// Result of [`retarget`].
pub(crate) struct Retargeted {
    pub motion: Motion,
    pub unit: String,
    pub metres_per_unit: f64,
    pub skipped: Vec<String>,
    pub warnings: Vec<String>,
}

/// Positions and rotations of the mapped joints in one frame, world axes, m.
#[derive(Clone)]
pub(crate) struct Seen {
    positions: [Option<Vec3>; N_JOINTS],
    rotations: [Option<Quat>; N_JOINTS],
}

/// Reads one frame of the source at a time in world axes and metres.
pub(crate) struct Probe<'a> {
    source: &'a SourceMotion,
    map: JointMap,
    needed: Vec<bool>,
    world_from_file: Quat,
    metres_per_unit: f32,
    /// Joints that coincide with their parent and are moved along their own bone: (joint, next,
    /// share).
    shifts: Vec<(Joint, Joint, f32)>,
}

/// Retargets a motion to SMPL-X. `known_unit` is given by formats that state their unit.
///
/// # Errors
/// [`MotionError::Member`] if the file requires an excessive amount of computation.
/// [`MotionError::NotFinite`] if numbers within the limits produce results outside the range.
pub(crate) fn retarget(
    file: &str,
    source: &SourceMotion,
    known_unit: Option<(f64, String)>,
) -> Result<Retargeted, MotionError> {
    let mut warnings = Vec::new();
    let mut first = source.blank();
    source.forward(0, &vec![true; source.joints.len()], &mut first);
    let lengths: Vec<f32> = source
        .joints
        .iter()
        .zip(&first.positions)
        .map(|(j, p)| {
            j.parent
                .map_or(0.0, |parent| (*p - first.positions[parent]).length())
        })
        .collect();
    let map = map_joints(source, &lengths);
    let mut needed = vec![false; source.joints.len()];
    for joint in map.iter().flatten() {
        for above in source.path_to_root(*joint) {
            needed[above] = true;
        }
    }
    let evaluations = source.n_frames.saturating_mul(source.joints.len());
    if evaluations > MAX_EVALUATIONS {
        return Err(MotionError::Member {
            file: file.into(),
            member: "motion".into(),
            expected: format!("at most {MAX_EVALUATIONS} joints times frames"),
            found: evaluations.to_string(),
        });
    }

    let mut probe = Probe {
        source,
        map,
        needed,
        world_from_file: Quat::IDENTITY,
        metres_per_unit: 1.0,
        shifts: Vec::new(),
    };
    let skipped = unused_joints(source, &map);
    if !probe.is_person() {
        return Err(no_person(file, source, &map));
    }

    let frames = spread(source.n_frames, N_PROBES);
    let (metres_per_unit, unit) = probe.decide_unit(known_unit, &mut warnings);
    probe.metres_per_unit = metres_per_unit as f32;
    let rest = probe.person_at_rest();
    probe.world_from_file = probe.decide_up(rest.as_ref(), &frames, &mut warnings);
    let rest = rest.map(|pose| probe.seen(&pose));
    probe.shifts = coincident(rest.as_ref().unwrap_or(&probe.frame(frames[0])));
    let rest = rest.map(|_| probe.seen(&source.rest()));
    let start = usize::from(probe.has_lead_in());
    if start == 1 {
        warnings.push("frame 0 left out: a lead-in pose far from frame 1".into());
    }
    for joint in Joint::ALL {
        if map[joint as usize].is_none() {
            warnings.push(format!(
                "no joint for {}: it follows its parent",
                joint.name()
            ));
        }
    }

    let seen_frames: Vec<Seen> = frames.iter().map(|f| probe.frame(*f)).collect();
    let height_m = probe
        .leg_height_m()
        .unwrap_or(DEFAULT_HEIGHT_M)
        .clamp(0.3, 3.0);
    let canonical = canonical_skeleton(height_m);
    let source_from_rest = match &rest {
        Some(seen) => calibrate::from_rest_pose(seen, &canonical),
        None => calibrate::from_frames(&seen_frames, &canonical),
    };
    let skeleton = measure_skeleton(&seen_frames, &source_from_rest, &canonical);
    let rest_joints = rest_positions(&skeleton);

    let mut poses = Vec::with_capacity(source.n_frames - start);
    for frame in start..source.n_frames {
        let seen = probe.frame(frame);
        let world = world_rotations(&seen, &source_from_rest, &rest_joints);
        let root_in_world = seen.positions[0].unwrap_or(Vec3::ZERO);
        poses.push(pose_from_world(root_in_world, &world));
    }
    let mut motion = Motion {
        fps: source.fps,
        skeleton,
        poses,
    };
    check_finite(file, &motion)?;
    ground(&mut motion);
    Ok(Retargeted {
        motion,
        unit,
        metres_per_unit,
        skipped,
        warnings,
    })
}

/// Motion of a person from known joint positions `[frame][joint]` in world axes (z up), m.
///
/// Bone directions are preserved exactly where a joint has one bone. Bone lengths are the medians
/// over the frames. Roll is derived from hips, shoulders, knees and elbows. The floor is placed at
/// z = 0.
///
/// # Errors
/// [`MotionError::NotFinite`] for NaN, infinite or out-of-range coordinates.
/// [`MotionError::Member`] if there are no frames or the frame rate is unusable.
pub fn motion_from_positions(
    file: &str,
    frames: &[[Vec3; N_JOINTS]],
    fps: f64,
) -> Result<Motion, MotionError> {
    if frames.is_empty() || !(fps.is_finite() && fps > 0.0) {
        return Err(MotionError::Member {
            file: file.into(),
            member: "joints".into(),
            expected: "at least one frame and a positive rate".into(),
            found: format!("{} frames at {fps} fps", frames.len()),
        });
    }
    for (t, frame) in frames.iter().enumerate() {
        if let Some(bad) = frame
            .iter()
            .flat_map(|p| p.to_array())
            .find(|v| !v.is_finite() || v.abs() > 1e4)
        {
            return Err(MotionError::NotFinite {
                file: file.into(),
                place: format!("frame {t}"),
                value: f64::from(bad),
            });
        }
    }
    let probes: Vec<&[Vec3; N_JOINTS]> = spread(frames.len(), N_PROBES)
        .into_iter()
        .map(|f| &frames[f])
        .collect();
    let legs_m = [
        (Joint::LeftHip, Joint::LeftKnee),
        (Joint::LeftKnee, Joint::LeftAnkle),
        (Joint::RightHip, Joint::RightKnee),
        (Joint::RightKnee, Joint::RightAnkle),
    ]
    .map(|(a, b)| {
        let lengths_m = probes.iter().map(|p| p[a as usize].distance(p[b as usize]));
        median_upper(lengths_m).unwrap_or(0.0)
    });
    let height_m = (legs_m.iter().sum::<f32>() * 0.5 / units::LEG_SHARE).clamp(0.3, 3.0);
    let canonical = canonical_skeleton(height_m);
    let canonical_rest = rest_of(&canonical);

    let solve = |frame: &[Vec3; N_JOINTS]| {
        rotations_from_positions(
            &frame.map(Some),
            &canonical_rest,
            world_from_rest_facing_radar(),
        )
    };
    let mut skeleton = canonical.clone();
    let solved: Vec<[Quat; N_JOINTS]> = probes.iter().map(|p| solve(p)).collect();
    for joint in Joint::ALL {
        let Some(parent) = joint.parent() else {
            continue;
        };
        let (j, p) = (joint as usize, parent as usize);
        skeleton.offsets[j] = bone_vector(
            probes
                .iter()
                .zip(&solved)
                .map(|(frame, world)| world[p].conjugate() * (frame[j] - frame[p])),
            canonical.offsets[j],
        );
    }
    let poses = frames
        .iter()
        .map(|frame| pose_from_world(frame[0], &solve(frame)))
        .collect();
    let mut motion = Motion {
        fps,
        skeleton,
        poses,
    };
    check_finite(file, &motion)?;
    ground(&mut motion);
    Ok(motion)
}

impl Probe<'_> {
    /// Mapped joints of `frame`.
    fn frame(&self, frame: usize) -> Seen {
        let mut pose = self.source.blank();
        self.source.forward(frame, &self.needed, &mut pose);
        self.seen(&pose)
    }

    fn seen(&self, pose: &SourcePose) -> Seen {
        let mut seen = Seen {
            positions: [None; N_JOINTS],
            rotations: [None; N_JOINTS],
        };
        for (j, source) in self.map.iter().enumerate() {
            if let Some(s) = *source {
                seen.positions[j] =
                    Some(self.world_from_file * pose.positions[s] * self.metres_per_unit);
                seen.rotations[j] = Some((self.world_from_file * pose.rotations[s]).normalize());
            }
        }
        for (joint, next, share) in &self.shifts {
            if let (Some(here), Some(there)) = (
                seen.positions[*joint as usize],
                seen.positions[*next as usize],
            ) {
                seen.positions[*joint as usize] = Some(here.lerp(there, *share));
            }
        }
        seen
    }

    /// True if there are enough joints to retarget: a pelvis, one pair of limbs and a joint above.
    fn is_person(&self) -> bool {
        let all = |joints: &[Joint]| joints.iter().all(|j| self.map[*j as usize].is_some());
        let legs = all(&[
            Joint::LeftHip,
            Joint::RightHip,
            Joint::LeftKnee,
            Joint::RightKnee,
        ]);
        let arms = all(&[
            Joint::LeftShoulder,
            Joint::RightShoulder,
            Joint::LeftElbow,
            Joint::RightElbow,
        ]);
        legs && (arms || all(&[Joint::Head])) || arms && all(&[Joint::Spine3])
    }

    /// True if frame 0 is separate from all following frames, like the T-pose that some converters
    /// insert at the start. The criterion is a mean joint step over 5 cm and over eight times the
    /// next step.
    fn has_lead_in(&self) -> bool {
        if self.source.n_frames < 3 {
            return false;
        }
        let [a, b, c] = [0, 1, 2].map(|f| self.frame(f));
        let step = |a: &Seen, b: &Seen| {
            let moves: Vec<f32> = (1..N_JOINTS)
                .filter_map(|j| {
                    let from = a.positions[j]? - a.positions[0]?;
                    let to = b.positions[j]? - b.positions[0]?;
                    Some(from.distance(to))
                })
                .collect();
            moves.iter().sum::<f32>() / moves.len().max(1) as f32
        };
        let (first, second) = (step(&a, &b), step(&b, &c));
        first > 0.05 && first > 8.0 * (second + 1e-3)
    }
}

/// World rotations of all joints in one frame.
fn world_rotations(
    seen: &Seen,
    source_from_rest: &[Option<Quat>; N_JOINTS],
    rest: &[Vec3; N_JOINTS],
) -> [Quat; N_JOINTS] {
    let mut world = [world_from_rest_facing_radar(); N_JOINTS];
    for joint in Joint::ALL {
        let j = joint as usize;
        let mut rotation = match (seen.rotations[j], source_from_rest[j]) {
            (Some(source), Some(constant)) => source * constant,
            _ => joint.parent().map_or(world[0], |p| world[p as usize]),
        };
        if let (Some(here), Some(child)) = (seen.positions[j], next_seen(joint, &seen.positions)) {
            let bone = rest[child as usize] - rest[j];
            let actual = seen.positions[child as usize].unwrap_or(here) - here;
            // Below one centimetre the direction is dominated by rounding errors.
            if bone.length() > 0.01 && actual.length() > 0.01 {
                rotation = shortest(rotation * bone, actual) * rotation;
            }
        }
        world[j] = rotation.normalize();
    }
    world
}

/// The next joint along a joint's single bone that exists in the source.
pub(crate) fn next_seen(joint: Joint, positions: &[Option<Vec3>; N_JOINTS]) -> Option<Joint> {
    let mut child = bone_child(joint)?;
    while positions[child as usize].is_none() {
        child = bone_child(child).or((child == Joint::Spine3).then_some(Joint::Neck))?;
    }
    Some(child)
}

fn pose_from_world(root_in_world: Vec3, world: &[Quat; N_JOINTS]) -> Pose {
    let mut rotations = *world;
    for joint in Joint::ALL {
        if let Some(parent) = joint.parent() {
            rotations[joint as usize] =
                (world[parent as usize].conjugate() * world[joint as usize]).normalize();
        }
    }
    Pose {
        root_in_world,
        rotations,
    }
}

/// Bone vectors in the T-pose: means over frames in the parent's axes, scaled to the median length.
fn measure_skeleton(
    frames: &[Seen],
    source_from_rest: &[Option<Quat>; N_JOINTS],
    canonical: &Skeleton,
) -> Skeleton {
    let Some(first) = frames.first() else {
        return canonical.clone();
    };
    let present = |j: Joint| first.positions[j as usize].is_some();
    // Rotations before the final alignment of each bone; missing joints follow their parents.
    let world: Vec<[Quat; N_JOINTS]> = frames
        .iter()
        .map(|seen| world_rotations(seen, source_from_rest, &[Vec3::ZERO; N_JOINTS]))
        .collect();
    let mut skeleton = canonical.clone();
    let mut decided = [false; N_JOINTS];
    for joint in Joint::ALL
        .into_iter()
        .filter(|j| present(*j) && *j != Joint::Pelvis)
    {
        // The chain of joints missing in the source, starting from the nearest ancestor that
        // exists.
        let mut chain = vec![joint];
        let mut ancestor = joint.parent();
        while let Some(a) = ancestor.filter(|a| !present(*a)) {
            chain.push(a);
            ancestor = a.parent();
        }
        let Some(ancestor) = ancestor else { continue };
        chain.reverse();
        let (j, a) = (joint as usize, ancestor as usize);
        let whole: Vec3 = chain.iter().map(|c| canonical.offsets[*c as usize]).sum();
        let vector = bone_vector(
            frames.iter().zip(&world).filter_map(|(seen, world)| {
                Some(world[a].conjugate() * (seen.positions[j]? - seen.positions[a]?))
            }),
            whole,
        );
        // Lengths are distributed as in the average body; a joint set by an earlier child is not
        // changed.
        let total: f32 = chain
            .iter()
            .map(|c| canonical.offsets[*c as usize].length())
            .sum();
        let mut left = vector;
        for (i, link) in chain.iter().enumerate() {
            let l = *link as usize;
            if i + 1 == chain.len() {
                skeleton.offsets[l] = left;
            } else if !decided[l] {
                skeleton.offsets[l] = vector * (canonical.offsets[l].length() / total);
            }
            decided[l] = true;
            left -= skeleton.offsets[l];
        }
    }
    skeleton
}

/// Mean of vectors, scaled to their median length; uses `fallback` if there are no vectors.
fn bone_vector(vectors: impl Iterator<Item = Vec3>, fallback: Vec3) -> Vec3 {
    let vectors: Vec<Vec3> = vectors.collect();
    let sum: Vec3 = vectors.iter().copied().sum();
    match (sum / vectors.len().max(1) as f32).try_normalize() {
        Some(direction) if !vectors.is_empty() => {
            direction * median_upper(vectors.iter().map(|v| v.length())).unwrap_or(0.0)
        }
        // A bone of zero length would have no direction.
        _ => fallback * 0.01,
    }
}

/// Up to `count` frame indices spread evenly over `n_frames`.
fn spread(n_frames: usize, count: usize) -> Vec<usize> {
    let n = n_frames.min(count).max(1);
    (0..n)
        .map(|i| i * (n_frames.max(1) - 1) / (n - 1).max(1))
        .collect()
}

/// Trunk joints that coincide with their parent and are to be moved along their own bone. A bone of
/// zero length has no direction for a mesh. The shift by a share of the bone preserves the outgoing
/// direction.
fn coincident(seen: &Seen) -> Vec<(Joint, Joint, f32)> {
    let mut shifts = Vec::new();
    for (joint, share) in [
        (Joint::Spine1, 0.5),
        (Joint::Spine2, 0.5),
        (Joint::Spine3, 0.5),
        (Joint::Neck, 0.3),
        (Joint::LeftCollar, 0.25),
        (Joint::RightCollar, 0.25),
    ] {
        let mut ancestor = joint.parent();
        while let Some(a) = ancestor.filter(|a| seen.positions[*a as usize].is_none()) {
            ancestor = a.parent();
        }
        let next = match joint {
            Joint::Spine3 => Some(Joint::Neck).filter(|n| seen.positions[*n as usize].is_some()),
            _ => next_seen(joint, &seen.positions),
        };
        let (Some(here), Some(a), Some(next)) = (seen.positions[joint as usize], ancestor, next)
        else {
            continue;
        };
        let above = seen.positions[a as usize].unwrap_or(here);
        if here.distance(above) < 0.01 {
            shifts.push((joint, next, share));
        }
    }
    shifts
}

fn unused_joints(source: &SourceMotion, map: &JointMap) -> Vec<String> {
    let mut ancestors = vec![false; source.joints.len()];
    for joint in map.iter().flatten() {
        for above in source.path_to_root(*joint) {
            ancestors[above] = true;
        }
    }
    let used = |j: usize| map.contains(&Some(j));
    (0..source.joints.len())
        .filter(|j| !used(*j))
        .map(|j| {
            let name = &source.joints[j].name;
            // Joints between mapped joints still move their descendants.
            if ancestors[j] {
                format!("joint {name} (merged into the joints below it)")
            } else {
                format!("joint {name}")
            }
        })
        .collect()
}

/// The error of a skeleton that is not recognised. Only the travel of its root would be known, and a figure that glides in
/// one pose is no motion of a person.
fn no_person(file: &str, source: &SourceMotion, map: &JointMap) -> MotionError {
    /// Maximum number of names in the message.
    const MAX_NAMES: usize = 24;
    // The pelvis is the root where nothing else is known.
    let joints = Joint::ALL.into_iter().skip(1);
    let found: Vec<&str> = joints
        .filter(|joint| map[*joint as usize].is_some())
        .map(Joint::name)
        .collect();
    let names: Vec<String> = (source.joints.iter())
        .take(MAX_NAMES)
        .map(|joint| excerpt(&joint.name))
        .collect();
    let n_more = source.joints.len() - names.len();
    MotionError::NoPerson {
        file: file.into(),
        n_joints: source.joints.len(),
        found: match found.is_empty() {
            true => "none of them is known".into(),
            false => format!("known are only {}", found.join(", ")),
        },
        names: match n_more {
            0 => names.join(", "),
            n => format!("{} and {n} more", names.join(", ")),
        },
    }
}

/// Rejects motions with numbers that are not finite or are outside any recording space.
pub(crate) fn check_finite(file: &str, motion: &Motion) -> Result<(), MotionError> {
    let bad = |place: String, value: f32| {
        Err(MotionError::NotFinite {
            file: file.into(),
            place,
            value: f64::from(value),
        })
    };
    for offset in &motion.skeleton.offsets {
        // A bone longer than ten metres indicates an invalid number.
        if let Some(v) = offset
            .to_array()
            .into_iter()
            .find(|v| v.is_nan() || v.abs() >= 10.0)
        {
            return bad("bone length".into(), v);
        }
    }
    for (t, pose) in motion.poses.iter().enumerate() {
        if let Some(v) = pose
            .root_in_world
            .to_array()
            .into_iter()
            .find(|v| v.is_nan() || v.abs() >= 1e4)
        {
            return bad(format!("root position of frame {t}"), v);
        }
        if let Some(q) = pose
            .rotations
            .iter()
            .find(|q| !q.is_finite() || (q.length() - 1.0).abs() > 1e-2)
        {
            return bad(format!("rotation of frame {t}"), q.length());
        }
    }
    let height_m = standing_height_m(&motion.skeleton);
    if height_m.is_finite() {
        Ok(())
    } else {
        bad("height".into(), height_m)
    }
}
