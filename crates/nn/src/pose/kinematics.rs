//! Rotations to joints, with gradients.

use burn::tensor::{Device, Tensor, TensorData};
use radarllm_base::Joint;
use radarllm_base::skeleton::N_JOINTS;
use radarllm_body::canonical_skeleton;

/// Rotation matrices of all joints, as columns.
#[derive(Clone, Debug)]
pub struct Rotations {
    /// The three columns, each `[frames, N_JOINTS, 3]`.
    pub columns: [Tensor<3>; 3],
}

impl Rotations {
    /// The rotations nearest to `[frames, N_JOINTS, 6]` values: the first column is the direction of the first three, the
    /// second one that of the part of the last three perpendicular to it (Zhou et al., CVPR 2019).
    pub fn from_six(six: Tensor<3>) -> Self {
        let [n, joints, _] = six.dims();
        let part = |from: usize| six.clone().slice([0..n, 0..joints, from..from + 3]);
        let unit = |v: Tensor<3>| {
            let length = (v.clone().square().sum_dim(2) + 1e-12).sqrt();
            v / length
        };
        let x = unit(part(0));
        let y = part(3);
        let y = unit(y.clone() - x.clone() * (x.clone() * y).sum_dim(2));
        let z = cross(&x, &y);
        Self { columns: [x, y, z] }
    }

    /// Positions of the joints, `[frames, N_JOINTS, 3]`, m, of bodies with `root`, `[frames, 3]`, m, and `height`,
    /// `[frames, 1]`, m. The skeleton is the project's own, which grows with the height.
    pub fn joints(&self, root: Tensor<2>, height: Tensor<2>) -> Tensor<3> {
        let [n, _, _] = self.columns[0].dims();
        let device = root.device();
        let offsets = canonical_skeleton(1.0).offsets;
        let column = |joint: usize, axis: usize| {
            let columns = self.columns[axis].clone();
            columns
                .slice([0..n, joint..joint + 1, 0..3])
                .reshape([n, 3])
        };
        // Columns of the rotations from joint to radar axes, and positions; parents come before their children.
        let mut turned: Vec<[Tensor<2>; 3]> = Vec::with_capacity(N_JOINTS);
        let mut places: Vec<Tensor<2>> = Vec::with_capacity(N_JOINTS);
        for joint in Joint::ALL {
            let index = joint as usize;
            let own = [0, 1, 2].map(|axis| column(index, axis));
            let Some(parent) = joint.parent() else {
                turned.push(own);
                places.push(root.clone());
                continue;
            };
            let [x, y, z] = &turned[parent as usize];
            let through = |v: Tensor<2>| {
                let of = |i: usize| v.clone().slice([0..n, i..i + 1]);
                x.clone() * of(0) + y.clone() * of(1) + z.clone() * of(2)
            };
            let offset = offsets[index].to_array();
            let offset = row(offset, &device).repeat_dim(0, n);
            places.push(places[parent as usize].clone() + through(offset) * height.clone());
            turned.push(own.map(through));
        }
        let places: Vec<Tensor<3>> = places.into_iter().map(|p| p.reshape([n, 1, 3])).collect();
        Tensor::cat(places, 1)
    }
}

fn row(values: [f32; 3], device: &Device) -> Tensor<2> {
    Tensor::from_data(TensorData::new(values.to_vec(), [1, 3]), device)
}

fn cross(a: &Tensor<3>, b: &Tensor<3>) -> Tensor<3> {
    let [n, joints, _] = a.dims();
    let of = |t: &Tensor<3>, i: usize| t.clone().slice([0..n, 0..joints, i..i + 1]);
    let component = |i: usize, j: usize| of(a, i) * of(b, j) - of(a, j) * of(b, i);
    Tensor::cat(vec![component(1, 2), component(2, 0), component(0, 1)], 2)
}

#[cfg(test)]
mod tests {
    use glam::{Mat3, Quat, Vec3};
    use radarllm_base::Pose;

    use super::*;

    #[test]
    fn joints_are_those_of_the_body() {
        let turn = |i: usize, f: f32| {
            Quat::from_euler(
                glam::EulerRot::XYZ,
                0.3 * f + i as f32 * 0.1,
                -0.2 * f,
                0.05 * i as f32,
            )
        };
        let poses: Vec<Pose> = [1.0, -2.0]
            .map(|f| Pose {
                root_in_world: Vec3::new(0.3 * f, 2.0 + f, 0.9),
                rotations: std::array::from_fn(|i| turn(i, f)),
            })
            .to_vec();
        let heights = [1.6, 1.85];
        let device = Device::flex();
        let six: Vec<f32> = poses
            .iter()
            .flat_map(|p| p.rotations)
            .flat_map(|q| {
                let m = Mat3::from_quat(q);
                // Neither unit length nor perpendicular: the nearest rotation is the same.
                let y = 3.0 * m.y_axis + 0.5 * m.x_axis;
                [(2.0 * m.x_axis).to_array(), y.to_array()]
            })
            .flatten()
            .collect();
        let six = Tensor::<3>::from_data(TensorData::new(six, [2, N_JOINTS, 6]), &device);
        let root: Vec<f32> = poses
            .iter()
            .flat_map(|p| p.root_in_world.to_array())
            .collect();
        let root = Tensor::<2>::from_data(TensorData::new(root, [2, 3]), &device);
        let height = Tensor::<2>::from_data(TensorData::new(heights.to_vec(), [2, 1]), &device);
        let joints: Vec<f32> = Rotations::from_six(six)
            .joints(root, height)
            .into_data()
            .try_into_vec()
            .unwrap();
        for (frame, (pose, height)) in poses.iter().zip(heights).enumerate() {
            let (expected, _) = canonical_skeleton(height).forward(pose);
            for (joint, expected) in expected.iter().enumerate() {
                let at = 3 * (frame * N_JOINTS + joint);
                let found = Vec3::from_slice(&joints[at..at + 3]);
                assert!(
                    found.distance(*expected) < 1e-5,
                    "{frame} {joint}: {found} {expected}"
                );
            }
        }
    }
}
