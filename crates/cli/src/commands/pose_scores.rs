//! `score --pose`: compares an estimated body with the true one.

use std::path::Path;

use radarllm_body::loaders::load_arrays;
use radarllm_eval::{
    EvalError,
    pose_report::{BodyArrays, KINDS, compare_bodies},
};

use crate::{
    error::{CliError, CliResult},
    output,
};

/// Prints the errors of one file against another.
pub(crate) fn run(candidate: &Path, reference: &Path) -> CliResult {
    let [candidate, reference] = [read(candidate), read(reference)];
    output::print_json(&compare_bodies(&candidate?, &reference?).map_err(with_hint)?)
}

fn read(path: &Path) -> CliResult<BodyArrays> {
    let arrays = load_arrays(path, &KINDS)?;
    BodyArrays::new(&path.display().to_string(), arrays).map_err(with_hint)
}

fn with_hint(error: EvalError) -> CliError {
    match error {
        EvalError::Shape { expected, .. } => CliError::new(error).hint(expected),
        other => other.into(),
    }
}
