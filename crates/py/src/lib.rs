//! The native module of the Python package `radarllm`.
//!
//! Python objects enter, NumPy arrays, Arrow streams and small immutable objects leave. Everything is done by the crate
//! `radarllm`, and the command by `radarllm-cli`; here are conversions, errors and threads. Reading order: [`work`] (how the library runs beside Python),
//! [`errors`], [`points`] with [`arrow`] and [`html`], then one module for each function group.
//!
//! Absent: learning frameworks, the allocator of the command, and any state but the threads of [`work`].

#![cfg_attr(
    test,
    allow(clippy::disallowed_methods, unreachable_pub, reason = "tests")
)]

mod arrow;
mod capture;
mod clip_points;
mod command;
mod dataset;
mod errors;
mod html;
mod keywords;
mod memory;
mod model;
mod options;
mod people;
mod points;
mod process;
mod radar;
mod score;
mod simulate;
mod work;

use pyo3::prelude::*;

#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<radar::PyRadar>()?;
    module.add_class::<points::PyPoints>()?;
    module.add_class::<simulate::PyCubes>()?;
    module.add_class::<capture::PyCapture>()?;
    module.add_class::<people::PyPerson>()?;
    module.add_class::<model::PyModel>()?;
    module.add_class::<model::Sentence>()?;
    module.add_class::<model::PySegment>()?;
    module.add_class::<memory::PyMemory>()?;
    module.add_class::<dataset::PyDatasetPlan>()?;
    module.add_class::<dataset::PyDataset>()?;
    module.add_class::<dataset::PySplit>()?;
    module.add_class::<dataset::PyClips>()?;
    module.add_class::<dataset::PyClip>()?;
    module.add_class::<clip_points::PyClipPoints>()?;
    module.add_function(wrap_pyfunction!(command::command, module)?)?;
    module.add_function(wrap_pyfunction!(simulate::simulate, module)?)?;
    module.add_function(wrap_pyfunction!(process::process, module)?)?;
    module.add_function(wrap_pyfunction!(people::people, module)?)?;
    module.add_function(wrap_pyfunction!(score::score, module)?)?;
    module.add_function(wrap_pyfunction!(work::panic_for_tests, module)?)
}
