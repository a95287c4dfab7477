//! How far is an estimated body from the true one? Errors of joints, vertices and rotations over all frames.

use std::collections::BTreeMap;

use radarllm_body::loaders::NumberArray;
use serde::Serialize;

use crate::{
    EvalError,
    pose::{mean_distance_cm, mean_rotation_angle_deg},
};

/// Arrays that are compared.
pub const KINDS: [&str; 3] = ["joints", "vertices", "rotations"];
/// Their dimensions after frame and joint or vertex.
const DIMENSIONS: [&[usize]; 3] = [&[3], &[3], &[3, 3]];

/// The arrays of one body, with their shapes checked.
#[derive(Clone, Debug)]
pub struct BodyArrays {
    /// Name of the file in errors.
    file: String,
    arrays: BTreeMap<&'static str, NumberArray>,
}

impl BodyArrays {
    /// Sorts arrays by kind: by name, or by shape where an array has no name.
    ///
    /// # Errors
    /// An array that is neither joints (T, J, 3) nor vertices (T, V, 3) nor rotations (T, J, 3, 3), or is empty.
    pub fn new(file: &str, arrays: Vec<NumberArray>) -> Result<Self, EvalError> {
        let mut known = BTreeMap::new();
        for array in arrays {
            let inner = array.shape.get(2..).unwrap_or_default();
            let kind = KINDS.into_iter().zip(DIMENSIONS).find(|(name, dims)| {
                array.name == *name || (array.name.is_empty() && inner == *dims)
            });
            let fits = |dims: &[usize]| inner == dims && array.shape[..2].iter().all(|n| *n > 0);
            match kind {
                Some((name, dims)) if fits(dims) => {
                    known.insert(name, array);
                }
                _ => {
                    let name = if array.name.is_empty() {
                        "the array"
                    } else {
                        &array.name
                    };
                    return Err(EvalError::Shape {
                        problem: format!("{file}: {name} has shape {:?}", array.shape),
                        expected: "expected joints (T, J, 3), vertices (T, V, 3) or rotations (T, J, 3, 3), none of \
                                   them empty",
                    });
                }
            }
        }
        Ok(Self {
            file: file.into(),
            arrays: known,
        })
    }
}

/// Errors of an estimated body. Nothing is aligned first.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PoseReport {
    /// Frames compared.
    pub frames: usize,
    /// Mean geodesic angle of joint rotations, degrees.
    pub mpjre_deg: Option<f64>,
    /// Mean distance of joints, cm.
    pub mpjpe_cm: Option<f64>,
    /// Mean distance of vertices, cm.
    pub mpvpe_cm: Option<f64>,
    /// Mean distance of the root (joint 0), cm.
    pub mte_cm: Option<f64>,
    /// Why a value is null.
    pub reason: BTreeMap<&'static str, String>,
}

/// Compares what both bodies have.
///
/// # Errors
/// Unlike shapes, values that cannot be compared, nothing in common.
pub fn compare_bodies(
    candidate: &BodyArrays,
    reference: &BodyArrays,
) -> Result<PoseReport, EvalError> {
    let mut frames = None;
    let mut absent = BTreeMap::new();
    let mut pair = |name: &'static str| -> Result<Option<[&NumberArray; 2]>, EvalError> {
        let (Some(x), Some(y)) = (candidate.arrays.get(name), reference.arrays.get(name)) else {
            let without = match candidate.arrays.contains_key(name) {
                true => reference,
                false => candidate,
            };
            absent.insert(name, format!("{}: holds no `{name}`", without.file));
            return Ok(None);
        };
        if x.shape != y.shape {
            return Err(EvalError::Shape {
                problem: format!(
                    "`{name}`: {} has shape {:?}, {} has {:?}",
                    candidate.file, x.shape, reference.file, y.shape
                ),
                expected: "both need the same frames and joints or vertices; nothing is aligned",
            });
        }
        let n = *frames.get_or_insert(x.shape[0]);
        if n != x.shape[0] {
            return Err(EvalError::Config(format!(
                "{}: `{name}` has {} frames, the members before it {n}",
                candidate.file, x.shape[0]
            )));
        }
        Ok(Some([x, y]))
    };
    let distance = |array, x: &[[f64; 3]], y: &[[f64; 3]]| {
        mean_distance_cm(x, y)
            .map(Some)
            .map_err(|source| EvalError::Pose { array, source })
    };
    let (mut mpjpe_cm, mut mte_cm, mut mpvpe_cm, mut mpjre_deg) = (None, None, None, None);
    if let Some([x, y]) = pair("joints")? {
        mpjpe_cm = distance("joints", items(x), items(y))?;
        // The root is joint 0 of every frame.
        let roots = |array: &NumberArray| -> Vec<[f64; 3]> {
            let joints = items(array).iter().copied();
            joints.step_by(array.shape[1]).collect()
        };
        mte_cm = distance("joints", &roots(x), &roots(y))?;
    }
    if let Some([x, y]) = pair("vertices")? {
        mpvpe_cm = distance("vertices", items(x), items(y))?;
    }
    if let Some([x, y]) = pair("rotations")? {
        mpjre_deg = mean_rotation_angle_deg(items(x), items(y))
            .map(Some)
            .map_err(|source| EvalError::Pose {
                array: "rotations",
                source,
            })?;
    }
    let Some(frames) = frames else {
        return Err(EvalError::Shape {
            problem: format!(
                "{} and {} have nothing in common to compare",
                candidate.file, reference.file
            ),
            expected: "npz with joints, vertices or rotations in both, or npy of the same kind",
        });
    };
    // Values are named by metric, arrays by kind: a missing array leaves its metrics out.
    let reason = [
        ("mpjre_deg", "rotations"),
        ("mpjpe_cm", "joints"),
        ("mpvpe_cm", "vertices"),
        ("mte_cm", "joints"),
    ]
    .into_iter()
    .filter_map(|(metric, kind)| Some((metric, absent.get(kind)?.clone())))
    .collect();
    Ok(PoseReport {
        frames,
        mpjre_deg,
        mpjpe_cm,
        mpvpe_cm,
        mte_cm,
        reason,
    })
}

/// Values in groups of N; the shape was checked.
fn items<const N: usize>(array: &NumberArray) -> &[[f64; N]] {
    array.values.as_chunks().0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn body(arrays: &[(&str, &[usize], f64)]) -> Result<BodyArrays, EvalError> {
        let arrays = arrays.iter().map(|(name, shape, value)| NumberArray {
            name: (*name).into(),
            shape: shape.to_vec(),
            values: vec![*value; shape.iter().product()],
        });
        BodyArrays::new("f.npz", arrays.collect())
    }

    #[test]
    fn what_both_have_is_compared_and_the_rest_is_explained() {
        let a = body(&[("joints", &[2, 3, 3], 0.0), ("vertices", &[2, 9, 3], 0.0)]).unwrap();
        let b = body(&[("joints", &[2, 3, 3], 0.1)]).unwrap();
        let report = compare_bodies(&a, &b).unwrap();
        // The diagonal of a cube of 10 cm.
        let expected = 10.0 * 3.0_f64.sqrt();
        assert!((report.mpjpe_cm.unwrap() - expected).abs() < 1e-9);
        assert!((report.mte_cm.unwrap() - expected).abs() < 1e-9);
        assert_eq!((report.frames, report.mpvpe_cm), (2, None));
        let names: Vec<_> = report.reason.keys().copied().collect();
        assert_eq!(names, ["mpjre_deg", "mpvpe_cm"]);
    }

    #[test]
    fn wrong_shapes_are_named() {
        for arrays in [
            vec![("joints", &[2, 3][..], 0.0)],
            vec![("joints", &[0, 3, 3], 0.0)],
            vec![("", &[2, 3, 4], 0.0)],
        ] {
            assert!(matches!(body(&arrays), Err(EvalError::Shape { .. })));
        }
        let [a, b] = [2, 3].map(|n| body(&[("", &[n, 3, 3], 0.0)]).unwrap());
        assert!(compare_bodies(&a, &b).is_err());
        assert!(compare_bodies(&a, &body(&[]).unwrap()).is_err());
    }
}
