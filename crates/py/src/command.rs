//! The command `radarllm` of the package.

use std::ffi::OsString;

use pyo3::prelude::*;

/// Runs the command with the arguments of a process, of which the first is the name of the program, and returns the exit
/// code: 0 done, 1 the user can fix it, 2 unexpected.
#[pyfunction]
#[pyo3(name = "_command")]
pub(crate) fn command(py: Python<'_>, arguments: Vec<OsString>) -> u8 {
    py.detach(|| radarllm_cli::run(arguments))
}
