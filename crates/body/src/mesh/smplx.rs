//! SMPL-X and SMPL models from the `.npz` files that their authors license.
//!
//! Vertices follow Loper et al., "SMPL: a skinned multi-person linear model" (2015), equations 2 to
//! 10: template, plus shape blend shapes, plus pose blend shapes linear in R - I, then linear blend
//! skinning. The first 22 joints are those of this project. All others (jaw, eyes, hands) keep
//! their rest pose, so their weights move exactly to the nearest ancestor among the 22.

use super::skin::Skin;
use super::{BodyError, BodyModel};
use glam::{Affine3A, Mat3, Vec3};
use radarllm_base::skeleton::N_JOINTS;
use radarllm_base::{Joint, Pose, Skeleton};
use radarllm_files::bounded;
use radarllm_files::npy::{NpyArray, Npz, NpzError};
use std::io::{Read, Seek};
use std::path::Path;

/// Number of pose blend shapes used: nine entries of R - I for each joint except the root.
const N_POSE_FEATURES: usize = 9 * (N_JOINTS - 1);
/// Maximum number of vertices and joints of a model (SMPL-X: 10,475 and 55).
const MAX_VERTICES: usize = 200_000;
const MAX_JOINTS: usize = 256;
/// Number of vertices blended together: as many as fit into the registers for a few poses.
const BLOCK_VERTICES: usize = 8;
/// Number of poses blended together: the pose blend shapes (24 MB for SMPL-X) are read once for all
/// of them.
const BATCH_POSES: usize = 5;
/// Minimum weight; smaller weights are noise of the model's optimisation.
const MIN_WEIGHT: f32 = 1e-6;

/// A body from a model file, with a fixed shape.
pub struct SmplxBody {
    name: String,
    skeleton: Skeleton,
    standing_pelvis_height_m: f32,
    triangles: Vec<[u32; 3]>,
    /// Shaped template, pelvis joint at the origin, m.
    template: Vec<Vec3>,
    /// `[block][feature]`, coordinates of the block's vertices, m; zero beyond the last vertex.
    pose_shapes: Vec<Block>,
    skin: Skin,
    joint_from_rest: [Affine3A; N_JOINTS],
    skipped: Vec<String>,
}

impl SmplxBody {
    /// Reads a model file. `betas` are shape coefficients; missing ones are zero.
    ///
    /// # Errors
    /// Any [`BodyError`] except the two of the built-in body. A file whose required members are
    /// pickled is rejected with the names of these members.
    pub fn open(path: &Path, betas: &[f32]) -> Result<Self, BodyError> {
        let file = bounded::open(path).map_err(|e| BodyError::Io {
            path: path.into(),
            source: e.into_io(),
        })?;
        let name = path
            .file_stem()
            .map_or_else(|| "smplx".into(), |s| s.to_string_lossy().into_owned());
        Self::read(std::io::BufReader::new(file), &name, betas)
    }

    /// Reads a model from any source.
    ///
    /// # Shapes
    /// `v_template` (V, 3); `f` (F, 3); `shapedirs` (V, 3, B); `posedirs` (V, 3, P) or (P, 3 V)
    /// with P = 9 (J - 1); `J_regressor` (J, V); `weights` (V, J); `kintree_table` (2, J). J is at
    /// least 22, and the first 22 joints are in the order of SMPL.
    pub fn read(source: impl Read + Seek, name: &str, betas: &[f32]) -> Result<Self, BodyError> {
        const WANTED: [&str; 7] = [
            "v_template",
            "f",
            "shapedirs",
            "posedirs",
            "J_regressor",
            "weights",
            "kintree_table",
        ];
        let mut npz = Npz::read(source, &WANTED).map_err(|e| match e {
            NpzError::Archive { expected, found } => BodyError::Archive {
                reason: format!("expected {expected}, found {found}"),
            },
            NpzError::Member { member, source } => BodyError::Member {
                member,
                reason: source.to_string(),
            },
        })?;
        let skipped: Vec<String> = npz.pickled().map(String::from).collect();
        let mut member = |name: &'static str| match npz.take(name) {
            Some(array) => Array::of(name, &array),
            None => Err(BodyError::Missing {
                member: name,
                skipped: skipped.clone(),
            }),
        };
        let model = RawModel {
            v_template: member("v_template")?,
            f: member("f")?,
            shapedirs: member("shapedirs")?,
            posedirs: member("posedirs")?,
            j_regressor: member("J_regressor")?,
            weights: member("weights")?,
            kintree_table: member("kintree_table")?,
        };
        let sizes = model.sizes()?;
        model.build(sizes, name, betas, skipped)
    }

    /// Pickled members of the file that were not read.
    pub fn skipped_members(&self) -> &[String] {
        &self.skipped
    }

    /// World-from-rest transforms, and R - I in row-major order for all joints except the root.
    fn prepare(&self, pose: &Pose) -> ([Affine3A; N_JOINTS], [f32; N_POSE_FEATURES]) {
        let (position, rotation) = self.skeleton.forward(pose);
        let world_from_rest = std::array::from_fn(|j| {
            Affine3A::from_rotation_translation(rotation[j], position[j]) * self.joint_from_rest[j]
        });
        let mut features = [0.0; N_POSE_FEATURES];
        for j in 1..N_JOINTS {
            // glam stores columns: the transpose's columns are R's rows, as SMPL flattens them.
            let rows = (Mat3::from_quat(pose.rotations[j]) - Mat3::IDENTITY).transpose();
            features[9 * (j - 1)..9 * j].copy_from_slice(&rows.to_cols_array());
        }
        (world_from_rest, features)
    }
}

impl BodyModel for SmplxBody {
    fn name(&self) -> &str {
        &self.name
    }

    fn skeleton(&self) -> &Skeleton {
        &self.skeleton
    }

    fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    fn n_vertices(&self) -> usize {
        self.template.len()
    }

    fn standing_pelvis_height_m(&self) -> f32 {
        self.standing_pelvis_height_m
    }

    fn pose_into(&self, pose: &Pose, out: &mut [Vec3]) {
        self.pose_many_into(std::slice::from_ref(pose), &mut [out]);
    }

    fn pose_many_into(&self, poses: &[Pose], out: &mut [&mut [Vec3]]) {
        assert_eq!(out.len(), poses.len(), "one slice of vertices per pose");
        assert!(
            out.iter().all(|out| out.len() == self.template.len()),
            "one position per vertex"
        );
        for (poses, out) in poses.chunks(BATCH_POSES).zip(out.chunks_mut(BATCH_POSES)) {
            self.pose_batch(poses, out);
        }
    }
}

impl SmplxBody {
    /// Poses the body in up to [`BATCH_POSES`] poses.
    fn pose_batch(&self, poses: &[Pose], out: &mut [&mut [Vec3]]) {
        let mut features = [[0.0; BATCH_POSES]; N_POSE_FEATURES];
        let mut world_from_rest = [[Affine3A::IDENTITY; N_JOINTS]; BATCH_POSES];
        for (i, pose) in poses.iter().enumerate() {
            let (bones, of_pose) = self.prepare(pose);
            world_from_rest[i] = bones;
            for (row, feature) in features.iter_mut().zip(of_pose) {
                row[i] = feature;
            }
        }
        // Joints in their rest pose, about half of the joints in typical motions, contribute
        // nothing.
        let mut moving = [0; N_POSE_FEATURES];
        let mut n_moving = 0;
        for (i, row) in features.iter().enumerate() {
            if *row != [0.0; BATCH_POSES] {
                moving[n_moving] = i;
                n_moving += 1;
            }
        }
        for (block, rest) in self.template.chunks(BLOCK_VERTICES).enumerate() {
            let first = block * BLOCK_VERTICES;
            let shapes = &self.pose_shapes[block * N_POSE_FEATURES..][..N_POSE_FEATURES];
            let bent = bend(shapes, &features, &moving[..n_moving]);
            for ((bent, bones), out) in bent.iter().zip(&world_from_rest).zip(out.iter_mut()) {
                let mut at = [Vec3::ZERO; BLOCK_VERTICES];
                for ((at, rest), bend) in at.iter_mut().zip(rest).zip(bent.chunks_exact(3)) {
                    *at = *rest + Vec3::from_slice(bend);
                }
                let last = first + rest.len();
                self.skin
                    .apply(first, bones, &at[..rest.len()], &mut out[first..last]);
            }
        }
    }
}

/// Coordinates of a block's vertices.
type Block = [f32; 3 * BLOCK_VERTICES];

/// Displacements of a block in every pose, computed as a matrix product: transposed features by
/// pose, times shapes by feature.
fn bend(
    shapes: &[Block],
    features: &[[f32; BATCH_POSES]],
    moving: &[usize],
) -> [Block; BATCH_POSES] {
    #[cfg(target_arch = "x86_64")]
    {
        #[target_feature(enable = "avx2")]
        fn compiled_for_avx2(
            shapes: &[Block],
            features: &[[f32; BATCH_POSES]],
            moving: &[usize],
        ) -> [Block; BATCH_POSES] {
            bend_body(shapes, features, moving)
        }
        if is_x86_feature_detected!("avx2") {
            // SAFETY: just detected. Nothing is fused, so the results are those of the other path.
            return unsafe { compiled_for_avx2(shapes, features, moving) };
        }
    }
    bend_body(shapes, features, moving)
}

#[inline(always)]
fn bend_body(
    shapes: &[Block],
    features: &[[f32; BATCH_POSES]],
    moving: &[usize],
) -> [Block; BATCH_POSES] {
    const TILE: usize = 8;
    let mut out = [[0.0; 3 * BLOCK_VERTICES]; BATCH_POSES];
    for first in (0..3 * BLOCK_VERTICES).step_by(TILE) {
        let mut sums = [[0.0_f32; TILE]; BATCH_POSES];
        for &i in moving {
            let shape = &shapes[i][first..first + TILE];
            for (sum, feature) in sums.iter_mut().zip(features[i]) {
                for (sum, s) in sum.iter_mut().zip(shape) {
                    *sum += s * feature;
                }
            }
        }
        for (out, sum) in out.iter_mut().zip(&sums) {
            out[first..first + TILE].copy_from_slice(sum);
        }
    }
    out
}

/// A member of real numbers, in C order.
#[derive(Clone, Debug, PartialEq)]
struct Array {
    shape: Vec<usize>,
    values: Vec<f32>,
}

impl Array {
    fn of(member: &str, array: &NpyArray) -> Result<Self, BodyError> {
        let fail = |reason: String| BodyError::Member {
            member: member.into(),
            reason,
        };
        let values = array.numbers_f32().ok_or_else(|| {
            fail(format!(
                "numbers of type {}; floats of 32 or 64 bits and integers are read",
                array.header.descr()
            ))
        })?;
        match values.iter().position(|v| !v.is_finite()) {
            Some(at) => Err(fail(format!("entry {at} is {}", values[at]))),
            None => Ok(Self {
                shape: array.shape(),
                values,
            }),
        }
    }
}

/// Members as read, before they are checked against each other.
struct RawModel {
    v_template: Array,
    f: Array,
    shapedirs: Array,
    posedirs: Array,
    j_regressor: Array,
    weights: Array,
    kintree_table: Array,
}

#[derive(Clone, Copy)]
struct Sizes {
    n_vertices: usize,
    n_joints: usize,
    n_betas: usize,
    n_pose_features: usize,
}

impl RawModel {
    fn sizes(&self) -> Result<Sizes, BodyError> {
        let wrong = |member: &'static str, array: &Array, expected: String| BodyError::Shape {
            member,
            found: array.shape.clone(),
            expected,
        };
        let &[n_vertices, 3] = self.v_template.shape.as_slice() else {
            return Err(wrong("v_template", &self.v_template, "(V, 3)".into()));
        };
        if n_vertices == 0 || n_vertices > MAX_VERTICES {
            return Err(wrong(
                "v_template",
                &self.v_template,
                format!("1 to {MAX_VERTICES} vertices"),
            ));
        }
        if !matches!(self.f.shape.as_slice(), &[n_faces, 3] if n_faces > 0) {
            return Err(wrong("f", &self.f, "(F, 3)".into()));
        }
        let &[2, n_joints] = self.kintree_table.shape.as_slice() else {
            return Err(wrong("kintree_table", &self.kintree_table, "(2, J)".into()));
        };
        if !(N_JOINTS..=MAX_JOINTS).contains(&n_joints) {
            return Err(wrong(
                "kintree_table",
                &self.kintree_table,
                format!("{N_JOINTS} to {MAX_JOINTS} joints"),
            ));
        }
        let n_betas = match self.shapedirs.shape.as_slice() {
            &[v, 3, n_betas] if v == n_vertices => n_betas,
            _ => {
                return Err(wrong(
                    "shapedirs",
                    &self.shapedirs,
                    format!("({n_vertices}, 3, B)"),
                ));
            }
        };
        let n_pose_features = 9 * (n_joints - 1);
        let is_vertex_major = self.posedirs.shape == [n_vertices, 3, n_pose_features];
        if !is_vertex_major && self.posedirs.shape != [n_pose_features, 3 * n_vertices] {
            let expected = format!(
                "({n_vertices}, 3, {n_pose_features}) or ({n_pose_features}, {})",
                3 * n_vertices
            );
            return Err(wrong("posedirs", &self.posedirs, expected));
        }
        if self.j_regressor.shape != [n_joints, n_vertices] {
            return Err(wrong(
                "J_regressor",
                &self.j_regressor,
                format!("({n_joints}, {n_vertices})"),
            ));
        }
        if self.weights.shape != [n_vertices, n_joints] {
            return Err(wrong(
                "weights",
                &self.weights,
                format!("({n_vertices}, {n_joints})"),
            ));
        }
        Ok(Sizes {
            n_vertices,
            n_joints,
            n_betas,
            n_pose_features,
        })
    }

    fn build(
        self,
        sizes: Sizes,
        name: &str,
        betas: &[f32],
        skipped: Vec<String>,
    ) -> Result<SmplxBody, BodyError> {
        let body_joint = self.body_joint_of_each(sizes)?;
        let triangles = self.triangles(sizes)?;
        let mut template = self.shaped(sizes, betas)?;
        let rest: [Vec3; N_JOINTS] = std::array::from_fn(|j| {
            let row = &self.j_regressor.values[j * sizes.n_vertices..(j + 1) * sizes.n_vertices];
            row.iter()
                .zip(&template)
                .map(|(w, v)| v.as_dvec3() * f64::from(*w))
                .sum::<glam::DVec3>()
                .as_vec3()
        });
        // All positions are relative to the pelvis, whose position is given by a pose.
        let pelvis = rest[0];
        template.iter_mut().for_each(|v| *v -= pelvis);
        let mut offsets = [Vec3::ZERO; N_JOINTS];
        for joint in Joint::ALL {
            if let Some(parent) = joint.parent() {
                offsets[joint as usize] = rest[joint as usize] - rest[parent as usize];
            }
        }
        let joint_from_rest = rest.map(|at| Affine3A::from_translation(pelvis - at));
        let lowest_m = template.iter().map(|v| v.y).fold(0.0, f32::min);
        let rows = self.sparse_weights(sizes, &body_joint)?;
        Ok(SmplxBody {
            name: name.into(),
            skeleton: Skeleton { offsets },
            standing_pelvis_height_m: -lowest_m,
            pose_shapes: self.pose_shapes(sizes),
            skin: Skin::new(rows.iter().map(Vec::as_slice)),
            triangles,
            template,
            joint_from_rest,
            skipped,
        })
    }

    /// For every joint of the model, the joint among the 22 with which it moves.
    fn body_joint_of_each(&self, sizes: Sizes) -> Result<Vec<usize>, BodyError> {
        let wrong = |index: usize, reason: String| BodyError::Value {
            member: "kintree_table",
            index,
            reason,
        };
        let mut body_joint: Vec<usize> = (0..N_JOINTS).collect();
        let parents = &self.kintree_table.values[..sizes.n_joints];
        for (j, &parent) in parents.iter().enumerate() {
            if j < N_JOINTS {
                let expected = Joint::ALL[j].parent().map(|p| p as usize);
                // The root's parent is written as -1 or 2^32 - 1.
                let found = (parent >= 0.0 && parent < j as f32).then_some(parent as usize);
                if found != expected {
                    let reason = format!(
                        "parent {parent}; the first 22 joints must be SMPL's ({expected:?})"
                    );
                    return Err(wrong(j, reason));
                }
            } else if parent >= 0.0 && parent < j as f32 {
                body_joint.push(body_joint[parent as usize]);
            } else {
                return Err(wrong(
                    j,
                    format!("parent {parent} does not come before joint {j}"),
                ));
            }
        }
        Ok(body_joint)
    }

    fn triangles(&self, sizes: Sizes) -> Result<Vec<[u32; 3]>, BodyError> {
        let is_index = |v: &f32| *v >= 0.0 && *v < sizes.n_vertices as f32 && v.fract() == 0.0;
        if let Some(index) = self.f.values.iter().position(|v| !is_index(v)) {
            let reason = format!(
                "{} is no index below {}",
                self.f.values[index], sizes.n_vertices
            );
            return Err(BodyError::Value {
                member: "f",
                index,
                reason,
            });
        }
        Ok(self
            .f
            .values
            .chunks_exact(3)
            .map(|t| [t[0] as u32, t[1] as u32, t[2] as u32])
            .collect())
    }

    /// Template plus shape blend shapes (SMPL equation 8).
    fn shaped(&self, sizes: Sizes, betas: &[f32]) -> Result<Vec<Vec3>, BodyError> {
        if let Some(index) = betas.iter().position(|b| !b.is_finite()) {
            return Err(BodyError::Value {
                member: "betas",
                index,
                reason: "not a finite number".into(),
            });
        }
        if betas.len() > sizes.n_betas {
            let expected = format!("at least {} shapes for as many betas", betas.len());
            return Err(BodyError::Shape {
                member: "shapedirs",
                found: self.shapedirs.shape.clone(),
                expected,
            });
        }
        let coordinate = |i: usize| {
            let shapes = &self.shapedirs.values[i * sizes.n_betas..(i + 1) * sizes.n_betas];
            self.v_template.values[i] + shapes.iter().zip(betas).map(|(s, b)| s * b).sum::<f32>()
        };
        Ok((0..sizes.n_vertices)
            .map(|v| {
                Vec3::new(
                    coordinate(3 * v),
                    coordinate(3 * v + 1),
                    coordinate(3 * v + 2),
                )
            })
            .collect())
    }

    /// The pose blend shapes of the 22 joints, in the block layout that [`bend`] reads.
    fn pose_shapes(&self, sizes: Sizes) -> Vec<Block> {
        let is_vertex_major = self.posedirs.shape.len() == 3;
        let n = 3 * sizes.n_vertices;
        let at = |feature: usize, coordinate: usize| {
            if coordinate >= n {
                return 0.0;
            }
            self.posedirs.values[if is_vertex_major {
                coordinate * sizes.n_pose_features + feature
            } else {
                feature * n + coordinate
            }]
        };
        (0..n)
            .step_by(3 * BLOCK_VERTICES)
            .flat_map(|first| (0..N_POSE_FEATURES).map(move |feature| (first, feature)))
            .map(|(first, feature)| std::array::from_fn(|i| at(feature, first + i)))
            .collect()
    }

    fn sparse_weights(
        &self,
        sizes: Sizes,
        body_joint: &[usize],
    ) -> Result<Vec<Vec<(usize, f32)>>, BodyError> {
        let rows = self.weights.values.chunks_exact(sizes.n_joints);
        rows.enumerate()
            .map(|(v, row)| {
                let mut merged = [0.0f32; N_JOINTS];
                row.iter()
                    .zip(body_joint)
                    .for_each(|(w, &joint)| merged[joint] += w);
                let sum: f32 = merged.iter().sum();
                // Files of f32 weights sum to one within rounding; SMPL's own within 1e-3.
                if (sum - 1.0).abs() > 0.01 || row.iter().any(|w| *w < -0.01) {
                    let reason = format!("weights sum to {sum}, or one is negative");
                    return Err(BodyError::Value {
                        member: "weights",
                        index: v,
                        reason,
                    });
                }
                let kept = merged
                    .iter()
                    .copied()
                    .enumerate()
                    .filter(|(_, w)| w.abs() > MIN_WEIGHT);
                Ok(kept.map(|(j, w)| (j, w / sum)).collect())
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DVec3, Quat};
    use radarllm_files::npy::{NpyElement, NpyWriter};
    use std::io::{Cursor, Write};

    const N_VERTICES: usize = 150;
    const N_BETAS: usize = 4;

    /// Uniform noise in -1..1; any fixed sequence is suitable.
    struct Noise(u64);
    impl Noise {
        fn next(&mut self) -> f32 {
            self.0 = self
                .0
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (self.0 >> 40) as f32 / (1u64 << 23) as f32 - 1.0
        }
        fn array(&mut self, shape: &[usize], scale: f32) -> Array {
            let values = (0..shape.iter().product())
                .map(|_| scale * self.next())
                .collect();
            Array {
                shape: shape.to_vec(),
                values,
            }
        }
    }

    /// A model of random numbers with `n_joints` joints; its extra joints are children of the
    /// wrists.
    fn raw(n_joints: usize) -> RawModel {
        let mut noise = Noise(7);
        let v_template = noise.array(&[N_VERTICES, 3], 1.0);
        let mut weights = noise.array(&[N_VERTICES, n_joints], 1.0);
        for row in weights.values.chunks_exact_mut(n_joints) {
            // Four influences a vertex, as real models have.
            let sum: f32 = row
                .iter_mut()
                .enumerate()
                .map(|(j, w)| {
                    *w = if (j * 7 + 3) % 6 == 0 {
                        w.abs() + 0.1
                    } else {
                        0.0
                    };
                    *w
                })
                .sum();
            row.iter_mut().for_each(|w| *w /= sum);
        }
        let mut j_regressor = noise.array(&[n_joints, N_VERTICES], 1.0);
        for row in j_regressor.values.chunks_exact_mut(N_VERTICES) {
            let sum: f32 = row
                .iter_mut()
                .map(|w| {
                    *w = w.abs();
                    *w
                })
                .sum();
            row.iter_mut().for_each(|w| *w /= sum);
        }
        let parents = (0..n_joints).map(|j| match Joint::ALL.get(j) {
            Some(joint) => joint
                .parent()
                .map_or(4_294_967_295.0, |p| p as usize as f32),
            None => (20 + j % 2) as f32,
        });
        let kintree: Vec<f32> = parents.chain((0..n_joints).map(|j| j as f32)).collect();
        RawModel {
            v_template,
            f: Array {
                shape: vec![N_VERTICES - 2, 3],
                values: (0..N_VERTICES - 2)
                    .flat_map(|i| [i as f32, (i + 1) as f32, (i + 2) as f32])
                    .collect(),
            },
            shapedirs: noise.array(&[N_VERTICES, 3, N_BETAS], 0.05),
            posedirs: noise.array(&[N_VERTICES, 3, 9 * (n_joints - 1)], 0.02),
            j_regressor,
            weights,
            kintree_table: Array {
                shape: vec![2, n_joints],
                values: kintree,
            },
        }
    }

    fn members(model: &RawModel) -> [(&'static str, &Array); 7] {
        [
            ("v_template", &model.v_template),
            ("f", &model.f),
            ("shapedirs", &model.shapedirs),
            ("posedirs", &model.posedirs),
            ("J_regressor", &model.j_regressor),
            ("weights", &model.weights),
            ("kintree_table", &model.kintree_table),
        ]
    }

    /// The model as an archive: floats as f64, indices as u32 and i64 as in the licensed files, and
    /// one pickled member.
    fn archive(model: &RawModel, leave_out: &str) -> Vec<u8> {
        let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
        let options = zip::write::SimpleFileOptions::default();
        for (name, array) in members(model) {
            if name == leave_out {
                continue;
            }
            zip.start_file(format!("{name}.npy"), options)
                .expect("memory");
            let shape = &array.shape;
            let mut bytes = Vec::new();
            match name {
                "f" => write_npy(&mut bytes, shape, array.values.iter().map(|&v| v as u32)),
                "kintree_table" => {
                    write_npy(&mut bytes, shape, array.values.iter().map(|&v| v as i64))
                }
                _ => write_npy(
                    &mut bytes,
                    shape,
                    array.values.iter().map(|&v| f64::from(v)),
                ),
            }
            zip.write_all(&bytes).expect("memory");
        }
        zip.start_file("part2num.npy", options).expect("memory");
        let mut header = b"{'descr': '|O', 'fortran_order': False, 'shape': (), }".to_vec();
        header.resize(118 - 1, b' ');
        header.push(b'\n');
        zip.write_all(b"\x93NUMPY\x01\x00v\x00").expect("memory");
        zip.write_all(&header).expect("memory");
        zip.write_all(b"\x80\x03}q\x00.").expect("memory");
        zip.finish().expect("memory").into_inner()
    }

    fn write_npy<T: NpyElement>(
        to: &mut Vec<u8>,
        shape: &[usize],
        values: impl Iterator<Item = T>,
    ) {
        let mut writer = NpyWriter::new(to, shape).expect("memory");
        writer.extend(values).expect("memory");
        writer.finish().expect("memory");
    }

    fn random_pose(noise: &mut Noise) -> Pose {
        let rotations = std::array::from_fn(|j| {
            // Every third joint remains in its rest pose, so that the skipping of zero features is
            // tested.
            if j % 3 == 2 {
                return Quat::IDENTITY;
            }
            let axis = Vec3::new(noise.next(), noise.next(), noise.next()).normalize_or(Vec3::X);
            Quat::from_axis_angle(axis, 1.5 * noise.next())
        });
        Pose {
            root_in_world: Vec3::new(noise.next(), noise.next(), 1.0),
            rotations,
        }
    }

    /// Reference implementation of SMPL in f64 over all joints of the model, directly from the
    /// arrays.
    fn slow(model: &RawModel, betas: &[f32], pose: &Pose) -> Vec<DVec3> {
        let n_joints = model.weights.shape[1];
        let number = |a: &Array, i: usize| f64::from(a.values[i]);
        let shaped: Vec<DVec3> = (0..N_VERTICES)
            .map(|v| {
                DVec3::from_array([0, 1, 2].map(|k| {
                    let i = 3 * v + k;
                    number(&model.v_template, i)
                        + betas
                            .iter()
                            .enumerate()
                            .map(|(b, beta)| {
                                f64::from(*beta) * number(&model.shapedirs, i * N_BETAS + b)
                            })
                            .sum::<f64>()
                }))
            })
            .collect();
        let joint: Vec<DVec3> = (0..n_joints)
            .map(|j| {
                (0..N_VERTICES)
                    .map(|v| shaped[v] * number(&model.j_regressor, j * N_VERTICES + v))
                    .sum()
            })
            .collect();
        let local = |j: usize| {
            if j < N_JOINTS {
                DMat3::from_quat(pose.rotations[j].as_dquat())
            } else {
                DMat3::IDENTITY
            }
        };
        let (mut rotation, mut position) =
            (vec![DMat3::IDENTITY; n_joints], vec![DVec3::ZERO; n_joints]);
        for j in 0..n_joints {
            if j == 0 {
                (rotation[0], position[0]) = (local(0), pose.root_in_world.as_dvec3());
            } else {
                let p = model.kintree_table.values[j] as usize;
                position[j] = position[p] + rotation[p] * (joint[j] - joint[p]);
                rotation[j] = rotation[p] * local(j);
            }
        }
        let n_features = 9 * (n_joints - 1);
        (0..N_VERTICES)
            .map(|v| {
                let mut bent = shaped[v];
                for j in 1..n_joints {
                    let difference = local(j) - DMat3::IDENTITY;
                    for (row, column) in (0..3).flat_map(|r| (0..3).map(move |c| (r, c))) {
                        let feature = 9 * (j - 1) + 3 * row + column;
                        let r = difference.col(column)[row];
                        bent +=
                            DVec3::from_array([0, 1, 2].map(|k| {
                                number(&model.posedirs, (3 * v + k) * n_features + feature)
                            })) * r;
                    }
                }
                (0..n_joints)
                    .map(|j| {
                        (rotation[j] * (bent - joint[j]) + position[j])
                            * number(&model.weights, v * n_joints + j)
                    })
                    .sum()
            })
            .collect()
    }

    #[test]
    fn posing_equals_the_formulas_written_out() {
        for n_joints in [22, 24, 55] {
            let model = raw(n_joints);
            let betas = [0.7, -1.2, 0.0, 2.0];
            let body = SmplxBody::read(Cursor::new(archive(&model, "")), "test", &betas)
                .expect("a valid model");
            assert_eq!(body.skipped_members(), ["part2num"]);
            let mut noise = Noise(n_joints as u64);
            // More than one batch.
            let poses: Vec<Pose> = (0..7).map(|_| random_pose(&mut noise)).collect();
            let mut many = vec![Vec3::ZERO; poses.len() * N_VERTICES];
            let mut slices: Vec<&mut [Vec3]> = many.chunks_exact_mut(N_VERTICES).collect();
            body.pose_many_into(&poses, &mut slices);
            for (pose, batched) in poses.iter().zip(many.chunks_exact(N_VERTICES)) {
                let mut out = vec![Vec3::ZERO; N_VERTICES];
                body.pose_into(pose, &mut out);
                assert_eq!(
                    out, batched,
                    "one by one and batched are the same arithmetic"
                );
                for (fast, exact) in out.iter().zip(slow(&model, &betas, pose)) {
                    // A few hundred f32 terms of order 0.1 and coordinates of a few metres.
                    assert!(fast.as_dvec3().distance(exact) < 2e-5, "{fast} {exact}");
                }
            }
        }
    }

    #[test]
    fn pose_shapes_stored_by_feature_are_the_same_model() {
        let mut model = raw(24);
        let n_features = 9 * 23;
        let vertex_major =
            SmplxBody::read(Cursor::new(archive(&model, "")), "a", &[]).expect("a valid model");
        let by_feature = (0..n_features * 3 * N_VERTICES)
            .map(|i| {
                model.posedirs.values[(i % (3 * N_VERTICES)) * n_features + i / (3 * N_VERTICES)]
            })
            .collect();
        model.posedirs = Array {
            shape: vec![n_features, 3 * N_VERTICES],
            values: by_feature,
        };
        let feature_major =
            SmplxBody::read(Cursor::new(archive(&model, "")), "b", &[]).expect("a valid model");
        assert_eq!(vertex_major.pose_shapes, feature_major.pose_shapes);
    }

    #[test]
    fn the_rest_pose_is_the_template_about_the_pelvis() {
        let model = raw(22);
        let body =
            SmplxBody::read(Cursor::new(archive(&model, "")), "test", &[]).expect("a valid model");
        let pose = Pose {
            root_in_world: Vec3::ZERO,
            rotations: [Quat::IDENTITY; N_JOINTS],
        };
        let mut out = vec![Vec3::ZERO; N_VERTICES];
        body.pose_into(&pose, &mut out);
        let shift = out[0] - Vec3::from_slice(&model.v_template.values[..3]);
        for (a, b) in out.iter().zip(model.v_template.values.chunks_exact(3)) {
            assert!(
                a.distance(Vec3::from_slice(b) + shift) < 1e-5,
                "f32 rounding"
            );
        }
    }

    #[test]
    fn members_that_do_not_fit_are_refused_by_name() {
        let spoil = |change: &dyn Fn(&mut RawModel)| {
            let mut model = raw(24);
            change(&mut model);
            SmplxBody::read(Cursor::new(archive(&model, "")), "test", &[])
                .err()
                .map(|e| e.to_string())
                .unwrap_or_default()
        };
        let cut = |a: &mut Array| {
            a.shape[0] -= 1;
            let n = a.shape.iter().product();
            a.values.truncate(n);
        };
        for (name, text) in [
            ("weights", spoil(&|m| cut(&mut m.weights))),
            ("shapedirs", spoil(&|m| cut(&mut m.shapedirs))),
            ("posedirs", spoil(&|m| cut(&mut m.posedirs))),
            ("J_regressor", spoil(&|m| cut(&mut m.j_regressor))),
            ("kintree_table", spoil(&|m| cut(&mut m.kintree_table))),
            ("f", spoil(&|m| m.f.values[5] = N_VERTICES as f32)),
            ("weights", spoil(&|m| m.weights.values[0] += 0.5)),
            ("kintree_table", spoil(&|m| m.kintree_table.values[4] = 0.0)),
            (
                "kintree_table",
                spoil(&|m| m.kintree_table.values[23] = 23.0),
            ),
            ("v_template", spoil(&|m| m.v_template.values[7] = f32::NAN)),
            ("posedirs", spoil(&|m| m.posedirs.values[7] = f32::INFINITY)),
        ] {
            assert!(text.contains(&format!("`{name}`")), "{name}: {text}");
        }
        let model = raw(24);
        assert!(matches!(
            SmplxBody::read(
                Cursor::new(archive(&model, "")),
                "test",
                &[0.0; N_BETAS + 1]
            ),
            Err(BodyError::Shape {
                member: "shapedirs",
                ..
            })
        ));
        let Err(BodyError::Missing { member, skipped }) =
            SmplxBody::read(Cursor::new(archive(&model, "posedirs")), "test", &[])
        else {
            panic!("a model without posedirs was accepted");
        };
        assert_eq!(
            (member, skipped),
            ("posedirs", vec!["part2num".to_string()])
        );
    }

    #[test]
    fn truncated_and_flipped_archives_never_panic() {
        let bytes = archive(&raw(22), "");
        for length in (0..bytes.len()).step_by(bytes.len() / 40 + 1) {
            assert!(SmplxBody::read(Cursor::new(bytes[..length].to_vec()), "test", &[]).is_err());
        }
        let mut noise = Noise(3);
        for _ in 0..60 {
            let mut changed = bytes.clone();
            let at = ((noise.next() * 0.5 + 0.5) * bytes.len() as f32) as usize % bytes.len();
            changed[at] ^= 0x41;
            // Whether it is rejected depends on the byte, but the call must return.
            if let Ok(body) = SmplxBody::read(Cursor::new(changed), "test", &[]) {
                assert_eq!(body.n_vertices(), N_VERTICES);
            }
        }
    }
}
