//! Errors of motions that are estimated from points, over a split: a pose network beside two floors.
//!
//! Definitions as in [`super::pose`]; nothing is aligned first. The floors are the mean pose of the training motions at the
//! true place, and the motion of the training clip whose points are nearest by [`descriptor`], at the true place too.

use std::{
    collections::{BTreeMap, btree_map::Entry},
    fmt::Write as _,
};

use glam::{Mat3, Quat, Vec3};
use radarllm_base::{Motion, Pose, skeleton::N_JOINTS};
use radarllm_body::{
    canonical_skeleton,
    mesh::{BodyModel, BodyShape, BuiltinBody},
    proportions::standing_height_m,
};
use radarllm_dataset::ClipRecord;
use serde::Serialize;

use super::pose::{mean_distance_cm, mean_rotation_angle_deg};
use crate::{Estimate, EvalError, baselines::NearestNeighbour, descriptor::descriptor};

/// Longest edge of the mesh on which vertices are compared, m.
const EDGE_M: f32 = 0.05;

/// Errors of one system.
#[derive(Clone, Debug, Serialize)]
pub struct PoseRow {
    /// `model`, `mean_pose` or `nearest`.
    pub name: &'static str,
    /// What it is, in words.
    pub what: &'static str,
    /// Mean angle between joint rotations, degrees.
    pub mpjre_deg: Estimate,
    /// Mean distance of joints, cm.
    pub mpjpe_cm: Estimate,
    /// Mean distance of vertices, cm.
    pub mpvpe_cm: Estimate,
    /// Mean distance of the pelvis, cm.
    pub mte_cm: Estimate,
    /// Mean distance of joints by action of the clip, cm.
    pub mpjpe_cm_by_action: BTreeMap<String, f64>,
}

/// The table.
#[derive(Clone, Debug, Serialize)]
pub struct PoseTable {
    /// Name of the data set.
    pub data: String,
    /// Split.
    pub split: String,
    /// Clips.
    pub clips: usize,
    /// Rows.
    pub rows: Vec<PoseRow>,
}

/// The true motion of a clip at its radar frames: axes of the radar, z above the floor, 10 poses a second.
///
/// # Errors
/// A clip without rotations.
pub fn true_motion(record: &ClipRecord) -> Result<Motion, EvalError> {
    record
        .known_rotations()
        .map_err(|e| EvalError::Config(format!("clip {}: {e}", record.id)))?;
    let poses = record
        .frames
        .iter()
        .map(|frame| pose_at(record, record.motion_frame_at(frame.time_s)));
    Ok(Motion {
        fps: 10.0,
        skeleton: canonical_skeleton(record.body_height_m),
        poses: poses.collect(),
    })
}

/// The pose of a motion frame of a clip whose rotations are known: axes of the radar, z above the floor.
pub fn pose_at(record: &ClipRecord, frame: usize) -> Pose {
    let root = Vec3::from_array(record.joints[frame][0]);
    let rotation = |six: [f32; 6]| {
        let [x, y] = [&six[..3], &six[3..]].map(Vec3::from_slice);
        Quat::from_mat3(&Mat3::from_cols(x, y, x.cross(y))).normalize()
    };
    Pose {
        root_in_world: root + Vec3::Z * record.radar_height_m,
        rotations: record.rotations6d[frame].map(rotation),
    }
}

/// Compares the estimated motions of clips with the true ones, beside two floors from `train`.
///
/// # Shapes
/// - `estimated`: one motion for each clip, one pose for each of its radar frames
///
/// # Errors
/// Clips without rotations, motions of other lengths, bodies that cannot be built.
pub fn pose_table(
    data: &str,
    split: &str,
    clips: &[ClipRecord],
    train: &[ClipRecord],
    estimated: &[Motion],
    seed: u64,
) -> Result<PoseTable, EvalError> {
    let truth: Vec<Motion> = clips.iter().map(true_motion).collect::<Result<_, _>>()?;
    let train_truth: Vec<Motion> = train.iter().map(true_motion).collect::<Result<_, _>>()?;
    let mean = mean_rotations(&train_truth);
    let mean_height =
        train.iter().map(|c| c.body_height_m).sum::<f32>() / train.len().max(1) as f32;
    let mean_motions = truth.iter().map(|motion| Motion {
        fps: motion.fps,
        skeleton: canonical_skeleton(mean_height),
        poses: motion
            .poses
            .iter()
            .map(|pose| Pose {
                root_in_world: pose.root_in_world,
                rotations: mean,
            })
            .collect(),
    });
    let of = |c: &ClipRecord| descriptor(&c.frames, c.radar_height_m);
    let neighbours = NearestNeighbour::fit(&train.iter().map(of).collect::<Vec<_>>())?;
    let mut nearest = Vec::with_capacity(clips.len());
    for (clip, motion) in clips.iter().zip(&truth) {
        let found = &train_truth[neighbours.nearest(&of(clip))?];
        let last = found.poses.len().saturating_sub(1);
        let poses = motion.poses.iter().enumerate().map(|(frame, pose)| Pose {
            root_in_world: pose.root_in_world,
            rotations: found.poses[frame.min(last)].rotations,
        });
        nearest.push(Motion {
            poses: poses.collect(),
            ..found.clone()
        });
    }
    let systems = [
        ("model", "pose network", estimated.to_vec()),
        (
            "mean_pose",
            "floor: the mean training pose at the true place",
            mean_motions.collect(),
        ),
        (
            "nearest",
            "floor: the motion of the nearest training clip at the true place",
            nearest,
        ),
    ];
    let mut bodies = Bodies::default();
    let mut rows = Vec::new();
    for (name, what, motions) in systems {
        rows.push(row(name, what, clips, &truth, &motions, &mut bodies, seed)?);
    }
    Ok(PoseTable {
        data: data.into(),
        split: split.into(),
        clips: clips.len(),
        rows,
    })
}

/// Bodies by height in mm.
#[derive(Default)]
struct Bodies(BTreeMap<u32, BuiltinBody>);

impl Bodies {
    fn of(&mut self, height_m: f32) -> Result<&BuiltinBody, EvalError> {
        let key = (height_m * 1000.0).round() as u32;
        match self.0.entry(key) {
            Entry::Occupied(known) => Ok(known.into_mut()),
            Entry::Vacant(free) => {
                let shape = BodyShape {
                    height_m,
                    facet_edge_m: EDGE_M,
                    ..BodyShape::default()
                };
                let body = BuiltinBody::new(&shape);
                Ok(free.insert(body.map_err(|e| EvalError::Config(e.to_string()))?))
            }
        }
    }
}

fn row(
    name: &'static str,
    what: &'static str,
    clips: &[ClipRecord],
    truth: &[Motion],
    motions: &[Motion],
    bodies: &mut Bodies,
    seed: u64,
) -> Result<PoseRow, EvalError> {
    let mut errors: [Vec<f64>; 4] = Default::default();
    let mut by_action: BTreeMap<String, Vec<f64>> = BTreeMap::new();
    if motions.len() != clips.len() {
        let problem = format!("{name}: {} motions of {} clips", motions.len(), clips.len());
        return Err(EvalError::Config(problem));
    }
    for ((clip, truth), motion) in clips.iter().zip(truth).zip(motions) {
        if motion.poses.len() != truth.poses.len() {
            return Err(EvalError::Config(format!(
                "clip {}: {} estimated poses of {} frames",
                clip.id,
                motion.poses.len(),
                truth.poses.len()
            )));
        }
        let body = bodies.of(clip.body_height_m)?;
        let of_clip = clip_errors(body, truth, motion)?;
        for (all, error) in errors.iter_mut().zip(of_clip) {
            all.push(error);
        }
        by_action
            .entry(clip.action.clone())
            .or_default()
            .push(of_clip[1]);
    }
    let units: Vec<usize> = (0..clips.len()).collect();
    let estimate = |values: &[f64]| {
        Estimate::of_mean(values, &units, seed)
            .ok_or_else(|| EvalError::Empty("no clips whose pose is estimated".into()))
    };
    let [rotation, joints, vertices, root] = &errors;
    Ok(PoseRow {
        name,
        what,
        mpjre_deg: estimate(rotation)?,
        mpjpe_cm: estimate(joints)?,
        mpvpe_cm: estimate(vertices)?,
        mte_cm: estimate(root)?,
        mpjpe_cm_by_action: by_action
            .into_iter()
            .map(|(action, v)| (action, v.iter().sum::<f64>() / v.len() as f64))
            .collect(),
    })
}

/// MPJRE in degrees, MPJPE, MPVPE and MTE in cm of one clip.
fn clip_errors(body: &BuiltinBody, truth: &Motion, motion: &Motion) -> Result<[f64; 4], EvalError> {
    let joints = |motion: &Motion| -> Vec<[f64; 3]> {
        let frames = motion.joints_in_world();
        frames
            .iter()
            .flatten()
            .map(|p| p.as_dvec3().to_array())
            .collect()
    };
    let rotations = |motion: &Motion| -> Vec<[f64; 9]> {
        let all = motion.poses.iter().flat_map(|pose| pose.rotations);
        let rows = |q: Quat| {
            Mat3::from_quat(q)
                .transpose()
                .to_cols_array()
                .map(f64::from)
        };
        all.map(rows).collect()
    };
    let roots = |motion: &Motion| -> Vec<[f64; 3]> {
        let roots = motion.poses.iter().map(|pose| pose.root_in_world);
        roots.map(|p| p.as_dvec3().to_array()).collect()
    };
    let mut buffer = vec![Vec3::ZERO; body.n_vertices()];
    let own = standing_height_m(body.skeleton());
    // A skeleton that grows with the height carries a mesh that does so too, about the pelvis.
    let mut vertices = |motion: &Motion| -> Vec<[f64; 3]> {
        let scale = standing_height_m(&motion.skeleton) / own;
        let mut all = Vec::with_capacity(motion.poses.len() * buffer.len());
        for pose in &motion.poses {
            body.pose_into(pose, &mut buffer);
            let root = pose.root_in_world;
            let scaled = buffer.iter().map(|v| root + scale * (*v - root));
            all.extend(scaled.map(|v| v.as_dvec3().to_array()));
        }
        all
    };
    let problem = |array: &'static str| move |source| EvalError::Pose { array, source };
    Ok([
        mean_rotation_angle_deg(&rotations(motion), &rotations(truth))
            .map_err(problem("rotations"))?,
        mean_distance_cm(&joints(motion), &joints(truth)).map_err(problem("joints"))?,
        mean_distance_cm(&vertices(motion), &vertices(truth)).map_err(problem("vertices"))?,
        mean_distance_cm(&roots(motion), &roots(truth)).map_err(problem("root"))?,
    ])
}

/// The mean rotation of every joint: the rotation nearest to the mean of the quaternions, all on the side of the first.
fn mean_rotations(motions: &[Motion]) -> [Quat; N_JOINTS] {
    let mut sums = [Quat::from_xyzw(0.0, 0.0, 0.0, 0.0); N_JOINTS];
    for pose in motions.iter().flat_map(|m| &m.poses) {
        for (sum, q) in sums.iter_mut().zip(pose.rotations) {
            *sum += if sum.dot(q) < 0.0 { -q } else { q };
        }
    }
    sums.map(|sum| match sum.length() > 0.0 {
        true => sum.normalize(),
        false => Quat::IDENTITY,
    })
}

/// The table as Markdown.
pub fn markdown(table: &PoseTable) -> String {
    let mut text = format!(
        "## Errors of the estimated bodies\n\n{} clips of `{}`, split `{}`; nothing is aligned; 95 % bootstrap intervals over \
         clips. Both floors are given the true place.\n\n\
         | system | MPJRE, degrees | MPJPE, cm | MPVPE, cm | MTE, cm |\n|---|---|---|---|---|\n",
        table.clips, table.data, table.split
    );
    for row in &table.rows {
        let cells = [row.mpjre_deg, row.mpjpe_cm, row.mpvpe_cm, row.mte_cm];
        let cells = cells.map(|e| e.to_text(1.0, 1)).join(" | ");
        let _ = writeln!(text, "| {} | {cells} |", row.what);
    }
    text += "| *reported: mmMesh on the paper's virtual radar* | *19.74* | *15.87* | *18.70* | *11.27* |\n";
    text += "| *reported: mmMesh on mmBody* | *22.08* | *28.91* | *21.60* | *15.46* |\n";
    text += "| *reported: mmMesh on MRI* | *9.94* | *11.55* | - | *8.25* |\n";
    text += "\nMPJPE of the pose network by action, cm: ";
    if let Some(model) = table.rows.first() {
        let of = |(action, cm): (&String, &f64)| format!("{action} {cm:.0}");
        text += &model
            .mpjpe_cm_by_action
            .iter()
            .map(of)
            .collect::<Vec<_>>()
            .join(", ");
    }
    text += ".\n";
    text
}

#[cfg(test)]
mod tests {
    use radarllm_base::PointFrame;
    use radarllm_dataset::Split;

    use super::*;

    /// A clip of a person who stands upright at (0, 2) m and turns, with points that move with `shift`.
    fn clip(id: &str, turn: f32, shift: f32) -> ClipRecord {
        let upright = Quat::from_rotation_x(std::f32::consts::FRAC_PI_2);
        let frames = (0..5).map(|f| PointFrame {
            frame: f,
            time_s: f64::from(f) * 0.1,
            points: vec![radarllm_base::RadarPoint {
                x_m: shift,
                y_m: 2.0,
                z_m: 0.0,
                range_m: 2.0,
                velocity_mps: shift,
                intensity_db: 20.0,
            }],
            board: None,
        });
        let height = 1.7;
        let pose = |i: usize| Pose {
            root_in_world: Vec3::new(0.0, 2.0, 0.9),
            rotations: std::array::from_fn(|j| match j {
                0 => Quat::from_rotation_z(turn * i as f32) * upright,
                _ => Quat::IDENTITY,
            }),
        };
        let poses: Vec<Pose> = (0..10).map(pose).collect();
        let skeleton = canonical_skeleton(height);
        ClipRecord {
            id: id.into(),
            motion_id: id.into(),
            group: id.into(),
            split: Split::Test,
            action: "turn".into(),
            captions: vec!["a person turns".into()],
            source: "test".into(),
            radar: "awr1843boost".into(),
            radar_height_m: 1.0,
            seed: 1,
            frames: frames.collect(),
            motion_fps: 20.0,
            joints: poses
                .iter()
                .map(|p| skeleton.forward(p).0.map(|v| (v - Vec3::Z).to_array()))
                .collect(),
            motion_features: Vec::new(),
            rotations6d: poses
                .iter()
                .map(|p| {
                    p.rotations.map(|q| {
                        let m = Mat3::from_quat(q);
                        let (x, y) = (m.x_axis, m.y_axis);
                        [x.x, x.y, x.z, y.x, y.y, y.z]
                    })
                })
                .collect(),
            body_height_m: height,
        }
    }

    #[test]
    fn errors_are_those_of_the_closed_form() {
        let (clips, train) = (
            [clip("a", 0.1, 0.5)],
            [clip("b", 0.0, 0.4), clip("c", 0.1, -9.0)],
        );
        let truth = true_motion(&clips[0]).unwrap();
        // Shifted by 3 cm, and every rotation right.
        let mut shifted = truth.clone();
        shifted
            .poses
            .iter_mut()
            .for_each(|p| p.root_in_world.x += 0.03);
        let table = pose_table("d", "test", &clips, &train, &[shifted], 1).unwrap();
        let [model, mean, nearest] = &table.rows[..] else {
            panic!()
        };
        assert!(model.mpjre_deg.value < 0.1, "{:?}", model.mpjre_deg);
        for cm in [model.mpjpe_cm, model.mpvpe_cm, model.mte_cm] {
            assert!((cm.value - 3.0).abs() < 1e-2, "{cm:?}");
        }
        // Both floors have the true place. The nearest clip does not turn: the pelvis is off by 0, 0.2, .. 0.8 rad.
        assert_eq!((mean.mte_cm.value, nearest.mte_cm.value), (0.0, 0.0));
        let expected = 0.4_f64.to_degrees() / N_JOINTS as f64;
        assert!(
            (nearest.mpjre_deg.value - expected).abs() < 0.05,
            "{:?}",
            nearest.mpjre_deg
        );
        assert!(mean.mpjpe_cm.value > 0.0);
        let fewer = Motion {
            poses: truth.poses[..3].to_vec(),
            ..truth
        };
        assert!(pose_table("d", "test", &clips, &train, &[fewer], 1).is_err());
    }

    #[test]
    fn a_clip_without_rotations_is_named() {
        let mut old = clip("old#0", 0.0, 0.0);
        old.rotations6d.clear();
        let error = true_motion(&old).unwrap_err().to_string();
        assert!(
            error.contains("old#0") && error.contains("rotations"),
            "{error}"
        );
    }
}
