//! Errors of the library as Python exceptions.

use pyo3::{
    exceptions::{PyKeyboardInterrupt, PyRuntimeError},
    prelude::*,
    types::{PyDict, PyType},
};
use radarllm::{Error, ErrorKind, Message};

use crate::keywords::keyword;

/// The exception of an error: `Error`, `NotFoundError`, `ExistsError`, `Bug` or `KeyboardInterrupt`.
pub(crate) fn to_py(error: Error) -> PyErr {
    Python::attach(|py| match error.kind {
        ErrorKind::Interrupted => PyKeyboardInterrupt::new_err(in_python(&error.message)),
        ErrorKind::NotFound => raised(py, "NotFoundError", error),
        ErrorKind::Exists => raised(py, "ExistsError", error),
        ErrorKind::Bug => bug(&in_python(&error.message)),
        // Input, what the system refused, what this build lacks, locks, and kinds that are added later.
        _ => raised(py, "Error", error),
    })
}

/// An error about the arguments.
pub(crate) fn input(message: impl std::fmt::Display) -> PyErr {
    to_py(Error::input(message.to_string()))
}

/// An error about the arguments, with a hint.
pub(crate) fn input_with_hint(
    message: impl std::fmt::Display,
    hint: impl std::fmt::Display,
) -> PyErr {
    to_py(Error::input(message.to_string()).with_hint(hint.to_string()))
}

/// The exception of a panic of the library.
pub(crate) fn bug(message: &str) -> PyErr {
    Python::attach(|py| {
        let made = class(py, "Bug").and_then(|class| class.call1((message,)));
        made.map_or_else(|error| error, PyErr::from_value)
    })
}

fn class<'py>(py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyType>> {
    let module = py.import("radarllm._errors")?;
    Ok(module.getattr(name)?.cast_into()?)
}

fn raised(py: Python<'_>, name: &str, error: Error) -> PyErr {
    let made = || -> PyResult<Bound<'_, PyAny>> {
        let named = PyDict::new(py);
        named.set_item("hint", error.hint.as_ref().map(in_python))?;
        named.set_item("path", error.path.map(|p| p.display().to_string()))?;
        class(py, name)?.call((in_python(&error.message),), Some(&named))
    };
    made().map_or_else(|e| e, PyErr::from_value)
}

/// A text of the library with the names that options have in Python.
fn in_python(text: &Message) -> String {
    text.with_options(keyword)
}

/// An error that no input explains, for example a thread that the system refuses.
pub(crate) fn system(error: impl std::fmt::Display) -> PyErr {
    PyRuntimeError::new_err(error.to_string())
}
