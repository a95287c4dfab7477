//! Errors of the library as Python exceptions.

use pyo3::{
    exceptions::{PyKeyboardInterrupt, PyRuntimeError},
    prelude::*,
    types::{PyDict, PyType},
};
use radarllm::{Error, ErrorKind};

/// Options of the library whose name in Python is another, because there it has its unit.
const RENAMED: [(&str, &str); 6] = [
    ("background_cell", "background_cell_m"),
    ("background_velocity", "background_velocity_mps"),
    ("frame_rate", "frame_rate_hz"),
    ("frames", "max_frames"),
    ("min_speed", "min_speed_mps"),
    ("remove_leakage", "remove_leakage_m"),
];
/// What parts a message of the library from a hint in the same line.
const HINT_MARK: &str = "; hint: ";

/// The exception of an error: `Error`, `NotFoundError`, `ExistsError` or `KeyboardInterrupt`.
pub fn to_py(error: Error) -> PyErr {
    Python::attach(|py| match error.kind {
        ErrorKind::Interrupted => PyKeyboardInterrupt::new_err(error.message),
        ErrorKind::NotFound => raised(py, "NotFoundError", error),
        ErrorKind::Exists => raised(py, "ExistsError", error),
        ErrorKind::Input | ErrorKind::Unsupported | ErrorKind::Locked => raised(py, "Error", error),
    })
}

/// An error about the arguments.
pub fn input(message: impl std::fmt::Display) -> PyErr {
    to_py(Error::input(message))
}

/// An error about the arguments, with a hint.
pub fn input_with_hint(message: impl std::fmt::Display, hint: impl std::fmt::Display) -> PyErr {
    to_py(Error::input(message).with_hint(hint))
}

/// The exception of a panic of the library.
pub fn bug(message: &str) -> PyErr {
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
    let (message, inner_hint) = match error.message.split_once(HINT_MARK) {
        Some((message, hint)) => (message.to_string(), Some(hint.to_string())),
        None => (error.message, None),
    };
    let hint = error.hint.or(inner_hint).map(|hint| in_python(&hint));
    let made = || -> PyResult<Bound<'_, PyAny>> {
        let named = PyDict::new(py);
        named.set_item("hint", hint)?;
        named.set_item("path", error.path.map(|p| p.display().to_string()))?;
        class(py, name)?.call((in_python(&message),), Some(&named))
    };
    made().map_or_else(|e| e, PyErr::from_value)
}

/// A text of the library with the names that options have in Python.
fn in_python(text: &str) -> String {
    let mut text = text.replace("--force", "`overwrite=True`");
    for (option, name) in RENAMED {
        text = text.replace(&format!("`{option}`"), &format!("`{name}`"));
    }
    text
}

/// An error that no input explains, for example a thread that the system refuses.
pub fn system(error: impl std::fmt::Display) -> PyErr {
    PyRuntimeError::new_err(error.to_string())
}
