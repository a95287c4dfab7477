//! Layout of HumanML3D features (Guo et al., CVPR 2022) and their mirror image.
//!
//! | values | content |
//! |---|---|
//! | 1 | root turn about the vertical |
//! | 2 | root velocity x, z |
//! | 1 | root height |
//! | 63 | positions of joints 1..=21, xyz |
//! | 126 | rotations of joints 1..=21: first two columns of the matrix |
//! | 66 | velocities of joints 0..=21, xyz |
//! | 4 | foot contacts: left ankle, left foot, right ankle, right foot |

use super::MOTION_DIM;

/// Joint that corresponds to joint i after mirroring, SMPL order.
pub const MIRRORED: [usize; 22] = [
    0, 2, 1, 3, 5, 4, 6, 8, 7, 9, 11, 10, 12, 14, 13, 15, 17, 16, 19, 18, 21, 20,
];

const POSITIONS: usize = 4;
const ROTATIONS: usize = POSITIONS + 63;
const VELOCITIES: usize = ROTATIONS + 126;
const CONTACTS: usize = VELOCITIES + 66;

/// Mirrors left and right (x to -x) in features of `[frame][263]` flattened. An incomplete last
/// frame is left unchanged.
pub fn mirror_motion_features(features: &mut [f32]) {
    for frame in features.chunks_exact_mut(MOTION_DIM) {
        let old: Vec<f32> = frame.to_vec();
        frame[0] = -old[0];
        frame[1] = -old[1];
        for (joint, &from) in MIRRORED.iter().enumerate().skip(1) {
            let (to_p, from_p) = (POSITIONS + 3 * (joint - 1), POSITIONS + 3 * (from - 1));
            copy_with_signs(&mut frame[to_p..], &old[from_p..], &[-1.0, 1.0, 1.0]);
            // M R M with M = diag(-1, 1, 1): entries with exactly one index x change sign.
            let (to_r, from_r) = (ROTATIONS + 6 * (joint - 1), ROTATIONS + 6 * (from - 1));
            copy_with_signs(
                &mut frame[to_r..],
                &old[from_r..],
                &[1.0, -1.0, -1.0, -1.0, 1.0, 1.0],
            );
        }
        for (joint, &from) in MIRRORED.iter().enumerate() {
            let (to, from) = (VELOCITIES + 3 * joint, VELOCITIES + 3 * from);
            copy_with_signs(&mut frame[to..], &old[from..], &[-1.0, 1.0, 1.0]);
        }
        for i in 0..4 {
            frame[CONTACTS + i] = old[CONTACTS + (i + 2) % 4];
        }
    }
}

fn copy_with_signs(to: &mut [f32], from: &[f32], signs: &[f32]) {
    for ((t, f), s) in to.iter_mut().zip(from).zip(signs) {
        *t = f * s;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mirroring_twice_is_the_identity_and_once_swaps_sides() {
        let original: Vec<f32> = (0..2 * MOTION_DIM).map(|i| i as f32 + 1.0).collect();
        let mut features = original.clone();
        mirror_motion_features(&mut features);
        assert_eq!(CONTACTS + 4, MOTION_DIM);
        // The left wrist (20) is at the former position of the right wrist (21), with x negated.
        let (left, right) = (POSITIONS + 3 * 19, POSITIONS + 3 * 20);
        assert_eq!(
            features[left..left + 3],
            [-original[right], original[right + 1], original[right + 2]]
        );
        // Forward speed and height do not change.
        assert_eq!(features[2..4], original[2..4]);
        mirror_motion_features(&mut features);
        assert_eq!(features, original);
    }
}
