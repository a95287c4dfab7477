//! `score --pose`: an estimated body beside the true one.

use std::{collections::BTreeMap, path::Path};

use radarllm_body::loaders::{NumberArray, load_arrays};
use radarllm_metrics::pose::{mean_distance_cm, mean_rotation_angle_deg};
use serde::Serialize;

use crate::{
    error::{CliError, CliResult},
    output,
};

/// Members of the npz that are compared, with their dimensions after frame and joint or vertex.
const MEMBERS: [(&str, &[usize]); 3] =
    [("joints", &[3]), ("vertices", &[3]), ("rotations", &[3, 3])];

#[derive(Serialize)]
struct Report {
    frames: usize,
    /// Mean geodesic angle of joint rotations, degrees.
    mpjre_deg: Option<f64>,
    /// Mean distance of joints, cm.
    mpjpe_cm: Option<f64>,
    /// Mean distance of vertices, cm.
    mpvpe_cm: Option<f64>,
    /// Mean distance of the root (joint 0), cm.
    mte_cm: Option<f64>,
    /// Why a value is null.
    reason: BTreeMap<&'static str, String>,
}

/// Prints the errors of one file against another.
pub fn run(candidate: &Path, reference: &Path) -> CliResult {
    let (a, b) = (read(candidate)?, read(reference)?);
    let mut frames = None;
    let mut reason = BTreeMap::new();
    let mut pair = |name: &'static str| -> CliResult<Option<(&NumberArray, &NumberArray)>> {
        let (Some(x), Some(y)) = (a.get(name), b.get(name)) else {
            let absent = if a.contains_key(name) {
                reference
            } else {
                candidate
            };
            reason.insert(name, format!("{}: holds no `{name}`", absent.display()));
            return Ok(None);
        };
        if x.shape != y.shape {
            return Err(CliError::new(format!(
                "`{name}`: {} has shape {:?}, {} has {:?}",
                candidate.display(),
                x.shape,
                reference.display(),
                y.shape
            ))
            .hint("both need the same frames and joints or vertices; nothing is aligned"));
        }
        let n = *frames.get_or_insert(x.shape[0]);
        if n != x.shape[0] {
            return Err(CliError::new(format!(
                "{}: `{name}` has {} frames, the members before it {n}",
                candidate.display(),
                x.shape[0]
            )));
        }
        Ok(Some((x, y)))
    };
    let with_name = |name: &'static str| move |e| CliError::new(format!("`{name}`: {e}"));
    let distance = |name, x: &[[f64; 3]], y: &[[f64; 3]]| {
        mean_distance_cm(x, y).map(Some).map_err(with_name(name))
    };
    let (mut mpjpe_cm, mut mte_cm, mut mpvpe_cm, mut mpjre_deg) = (None, None, None, None);
    if let Some((x, y)) = pair("joints")? {
        mpjpe_cm = distance("joints", items(x), items(y))?;
        // The root is joint 0 of every frame.
        let roots = |array: &NumberArray| -> Vec<[f64; 3]> {
            items(array)
                .iter()
                .copied()
                .step_by(array.shape[1])
                .collect()
        };
        mte_cm = distance("joints", &roots(x), &roots(y))?;
    }
    if let Some((x, y)) = pair("vertices")? {
        mpvpe_cm = distance("vertices", items(x), items(y))?;
    }
    if let Some((x, y)) = pair("rotations")? {
        mpjre_deg = mean_rotation_angle_deg(items(x), items(y))
            .map(Some)
            .map_err(with_name("rotations"))?;
    }
    let Some(frames) = frames else {
        return Err(CliError::new(format!(
            "{} and {} have nothing in common to compare",
            candidate.display(),
            reference.display()
        ))
        .hint("npz with joints, vertices or rotations in both, or npy of the same kind"));
    };
    // Values are named by metric, members by file: a missing member leaves its metrics out.
    let reason = [
        ("mpjre_deg", "rotations"),
        ("mpjpe_cm", "joints"),
        ("mpvpe_cm", "vertices"),
        ("mte_cm", "joints"),
    ]
    .into_iter()
    .filter_map(|(metric, member)| Some((metric, reason.get(member)?.clone())))
    .collect();
    output::print_json(&Report {
        frames,
        mpjre_deg,
        mpjpe_cm,
        mpvpe_cm,
        mte_cm,
        reason,
    })
}

/// Arrays by what they are, with their shapes checked.
fn read(path: &Path) -> CliResult<BTreeMap<&'static str, NumberArray>> {
    let wanted = MEMBERS.map(|(name, _)| name);
    let mut found = BTreeMap::new();
    for array in load_arrays(path, &wanted)? {
        let inner = array.shape.get(2..).unwrap_or_default();
        let kind = MEMBERS.into_iter().find(|(name, dimensions)| {
            // An npy has no name: joints and rotations differ by their shapes.
            array.name == *name || (array.name.is_empty() && inner == *dimensions)
        });
        let fits =
            |dimensions: &[usize]| inner == dimensions && array.shape[..2].iter().all(|n| *n > 0);
        match kind {
            Some((name, dimensions)) if fits(dimensions) => {
                found.insert(name, array);
            }
            _ => {
                let name = if array.name.is_empty() {
                    "the array"
                } else {
                    &array.name
                };
                return Err(CliError::new(format!(
                    "{}: {name} has shape {:?}",
                    path.display(),
                    array.shape
                ))
                .hint("expected joints (T, J, 3), vertices (T, V, 3) or rotations (T, J, 3, 3), none of them empty"));
            }
        }
    }
    Ok(found)
}

/// Values in groups of N; the shape was checked.
fn items<const N: usize>(array: &NumberArray) -> &[[f64; N]] {
    array.values.as_chunks().0
}
