//! Errors of an estimated body pose, over plain slices: nothing is aligned first, neither in place nor
//! in heading nor in scale.
//!
//! Definitions as in mmMesh (Xue et al., MobiSys 2021) and the work that follows it: MPJPE and MPVPE are
//! mean distances over joints and vertices, MTE the mean distance of the root, MPJRE the mean angle
//! between joint rotations.

/// Why two poses cannot be compared.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PoseError {
    /// Different numbers of things.
    #[error("{candidate} in the candidate, {reference} in the reference")]
    Lengths {
        /// Found in the candidate.
        candidate: usize,
        /// Found in the reference.
        reference: usize,
    },
    /// Nothing to compare.
    #[error("nothing to compare")]
    Empty,
    /// A value that is not finite.
    #[error("item {index} of the {whose} is not finite")]
    NotFinite {
        /// `candidate` or `reference`.
        whose: &'static str,
        /// Item, from 0.
        index: usize,
    },
    /// A matrix that turns nothing without stretching or mirroring it.
    #[error("item {index} of the {whose} is no rotation: it stretches or mirrors by {off}")]
    NotARotation {
        /// `candidate` or `reference`.
        whose: &'static str,
        /// Item, from 0.
        index: usize,
        /// Largest deviation of R^T R from the identity, or of the determinant from 1.
        off: f64,
    },
}

/// How far R^T R may be from the identity: matrices in f32 keep 1e-6, files with two decimals do not
/// hold rotations.
const ROTATION_TOLERANCE: f64 = 1e-3;

/// Mean distance between points in cm: MPJPE over joints, MPVPE over vertices, MTE over roots.
///
/// # Shapes
/// - `candidate`, `reference`: `[item][xyz]`, m, frames and joints flattened in the same order
///
/// # Errors
/// Unlike or no items; a coordinate that is not finite.
pub fn mean_distance_cm(candidate: &[[f64; 3]], reference: &[[f64; 3]]) -> Result<f64, PoseError> {
    check(candidate, reference)?;
    let sum: f64 = candidate
        .iter()
        .zip(reference)
        .map(|(a, b)| {
            let square: f64 = a.iter().zip(b).map(|(u, v)| (u - v) * (u - v)).sum();
            square.sqrt()
        })
        .sum();
    Ok(100.0 * sum / candidate.len() as f64)
}

/// Mean angle in degrees of the rotation that takes one matrix to the other: MPJRE.
///
/// # Shapes
/// - `candidate`, `reference`: `[item][row-major 3 x 3]`, frames and joints flattened in the same order
///
/// # Errors
/// Unlike or no items; values that are not finite; matrices that are no rotations.
pub fn mean_rotation_angle_deg(
    candidate: &[[f64; 9]],
    reference: &[[f64; 9]],
) -> Result<f64, PoseError> {
    check(candidate, reference)?;
    for (whose, matrices) in [("candidate", candidate), ("reference", reference)] {
        for (index, r) in matrices.iter().enumerate() {
            let off = deviation(r);
            if off > ROTATION_TOLERANCE {
                return Err(PoseError::NotARotation { whose, index, off });
            }
        }
    }
    let sum: f64 = candidate
        .iter()
        .zip(reference)
        .map(|(a, b)| angle_rad(a, b))
        .sum();
    Ok((sum / candidate.len() as f64).to_degrees())
}

fn check<const N: usize>(candidate: &[[f64; N]], reference: &[[f64; N]]) -> Result<(), PoseError> {
    if candidate.len() != reference.len() {
        return Err(PoseError::Lengths {
            candidate: candidate.len(),
            reference: reference.len(),
        });
    }
    if candidate.is_empty() {
        return Err(PoseError::Empty);
    }
    for (whose, items) in [("candidate", candidate), ("reference", reference)] {
        let broken = |item: &[f64; N]| item.iter().any(|v| !v.is_finite());
        if let Some(index) = items.iter().position(broken) {
            return Err(PoseError::NotFinite { whose, index });
        }
    }
    Ok(())
}

/// Angle of A^T B. The arc tangent of its sine and cosine keeps small angles, which the arc cosine of
/// the trace alone would lose below 1e-8.
fn angle_rad(a: &[f64; 9], b: &[f64; 9]) -> f64 {
    let m = |row: usize, column: usize| -> f64 {
        (0..3).map(|k| a[3 * k + row] * b[3 * k + column]).sum()
    };
    let twice_sine = [m(2, 1) - m(1, 2), m(0, 2) - m(2, 0), m(1, 0) - m(0, 1)]
        .iter()
        .map(|v| v * v)
        .sum::<f64>()
        .sqrt();
    let twice_cosine = m(0, 0) + m(1, 1) + m(2, 2) - 1.0;
    twice_sine.atan2(twice_cosine)
}

fn deviation(r: &[f64; 9]) -> f64 {
    let mut off = 0.0_f64;
    for i in 0..3 {
        for j in 0..3 {
            let dot: f64 = (0..3).map(|k| r[3 * k + i] * r[3 * k + j]).sum();
            off = off.max((dot - f64::from(u8::from(i == j))).abs());
        }
    }
    let determinant = r[0] * (r[4] * r[8] - r[5] * r[7]) - r[1] * (r[3] * r[8] - r[5] * r[6])
        + r[2] * (r[3] * r[7] - r[4] * r[6]);
    off.max((determinant - 1.0).abs())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{FRAC_PI_2, PI};

    /// About a unit axis by Rodrigues' formula.
    fn rotation(axis: [f64; 3], angle: f64) -> [f64; 9] {
        let [x, y, z] = axis;
        let (s, c) = angle.sin_cos();
        let d = 1.0 - c;
        [
            c + x * x * d,
            x * y * d - z * s,
            x * z * d + y * s,
            y * x * d + z * s,
            c + y * y * d,
            y * z * d - x * s,
            z * x * d - y * s,
            z * y * d + x * s,
            c + z * z * d,
        ]
    }

    #[test]
    fn a_known_translation_is_its_length() {
        let reference: Vec<[f64; 3]> = (0..66)
            .map(|i| [f64::from(i) * 0.1, (f64::from(i)).sin(), 1.0])
            .collect();
        // 3, 4 and 12 cm: 13 cm.
        let moved: Vec<[f64; 3]> = reference
            .iter()
            .map(|p| [p[0] + 0.03, p[1] - 0.04, p[2] + 0.12])
            .collect();
        assert!((mean_distance_cm(&moved, &reference).unwrap() - 13.0).abs() < 1e-9);
        assert_eq!(mean_distance_cm(&reference, &reference).unwrap(), 0.0);
        // A mean of distances, not the distance of means: +-5 cm is 5 cm.
        let apart = [[0.05, 0.0, 0.0], [-0.05, 0.0, 0.0]];
        assert!((mean_distance_cm(&apart, &[[0.0; 3]; 2]).unwrap() - 5.0).abs() < 1e-12);
    }

    #[test]
    fn a_known_rotation_is_its_angle() {
        let axis = [2.0 / 7.0, -3.0 / 7.0, 6.0 / 7.0];
        let start = rotation([0.6, 0.0, 0.8], 0.7);
        let product = |a: &[f64; 9], b: &[f64; 9]| -> [f64; 9] {
            std::array::from_fn(|i| (0..3).map(|k| a[3 * (i / 3) + k] * b[3 * k + i % 3]).sum())
        };
        for angle in [0.0, 1e-9, 1e-4, 0.3, FRAC_PI_2, 2.0, PI - 1e-6, PI] {
            let turned = product(&start, &rotation(axis, angle));
            let found = mean_rotation_angle_deg(&[turned], &[start]).unwrap();
            // Matrices in f64 hold an angle to about 1e-16.
            assert!(
                (found.to_radians() - angle).abs() < 1e-14 * 10.0,
                "{angle}: {found} degrees"
            );
            // The same both ways, and whatever frame both are seen from.
            let back = mean_rotation_angle_deg(&[start], &[turned]).unwrap();
            assert!((found - back).abs() < 1e-12);
        }
        // The mean over joints: 10 and 30 degrees.
        let two = [10.0_f64, 30.0].map(|a| rotation(axis, a.to_radians()));
        let mean = mean_rotation_angle_deg(&two, &[rotation(axis, 0.0); 2]).unwrap();
        assert!((mean - 20.0).abs() < 1e-12);
    }

    #[test]
    fn what_cannot_be_compared_is_named() {
        let unit = rotation([1.0, 0.0, 0.0], 0.0);
        assert_eq!(
            mean_distance_cm(&[[0.0; 3]], &[]),
            Err(PoseError::Lengths {
                candidate: 1,
                reference: 0
            })
        );
        assert_eq!(mean_distance_cm(&[], &[]), Err(PoseError::Empty));
        assert_eq!(
            mean_distance_cm(&[[0.0; 3]], &[[f64::NAN; 3]]),
            Err(PoseError::NotFinite {
                whose: "reference",
                index: 0
            })
        );
        let mirror = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0];
        for wrong in [mirror, unit.map(|v| 2.0 * v), [0.0; 9]] {
            let error = mean_rotation_angle_deg(&[unit, wrong], &[unit, unit]).unwrap_err();
            assert!(matches!(
                error,
                PoseError::NotARotation {
                    whose: "candidate",
                    index: 1,
                    ..
                }
            ));
        }
    }
}
