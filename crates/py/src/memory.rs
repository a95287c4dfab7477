//! `Memory`: taught activities.

use std::{
    path::{Path, PathBuf},
    sync::{Mutex, MutexGuard, PoisonError},
};

use pyo3::prelude::*;
use radarllm::{Error, Result, teach};

use crate::{errors, points::PyPoints, score::to_python, work};

/// Activities taught by a few recordings each. `Model(memory=...)` recognises them and says their sentences.
///
/// `Memory()` is empty; `Memory("memory.json")` reads a file that `save` or `radarllm teach` wrote.
///
/// >>> memory = Memory()
/// >>> warnings = memory.teach("wheelchair", simulate("builtin:sit_down"), says="a person sits down in the wheelchair")
/// >>> memory.activities[0]["name"]
/// 'wheelchair'
#[pyclass(frozen, name = "Memory", module = "radarllm")]
pub struct PyMemory {
    memory: Mutex<teach::Memory>,
    /// The file that this memory was read from or written to last, and what it held.
    file: Mutex<Option<(PathBuf, teach::Memory)>>,
}

impl PyMemory {
    fn lock(&self) -> MutexGuard<'_, teach::Memory> {
        self.memory.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub fn copy(&self) -> teach::Memory {
        self.lock().clone()
    }
}

/// Reads a memory file.
pub(crate) fn load(path: &Path) -> Result<teach::Memory> {
    if !path.exists() {
        let missing = std::io::Error::from(std::io::ErrorKind::NotFound);
        return Err(Error::io(path, missing));
    }
    teach::Memory::load(path).map_err(Error::wrap)
}

#[pymethods]
impl PyMemory {
    #[new]
    #[pyo3(signature = (path=None))]
    fn new(path: Option<PathBuf>) -> PyResult<Self> {
        let file = match path {
            Some(path) => Some((path.clone(), load(&path).map_err(errors::to_py)?)),
            None => None,
        };
        let memory = file.as_ref().map(|(_, memory)| memory.clone());
        Ok(Self {
            memory: Mutex::new(memory.unwrap_or_default()),
            file: Mutex::new(file),
        })
    }

    /// Adds points as an example of the activity `name`. `says` is its sentence; it may be left out of further examples.
    /// Returns warnings: another radar than before, another sentence, examples that contradict each other.
    #[pyo3(signature = (name, points, *, says=None))]
    fn teach(
        &self,
        py: Python<'_>,
        name: &str,
        points: &Bound<'_, PyPoints>,
        says: Option<String>,
    ) -> PyResult<Vec<String>> {
        let known = || {
            let memory = self.lock();
            let known = memory.activities().iter().find(|a| a.name == name);
            known.map(|a| a.says.clone())
        };
        let Some(says) = says.or_else(known) else {
            return Err(errors::input_with_hint(
                format!("what is said about `{name}`?"),
                "says=\"a person sits down in the wheelchair\"",
            ));
        };
        let recording = &points.get().recording;
        // A copy is taught, so that no lock is held without the interpreter's own.
        let mut memory = self.copy();
        let (memory, warnings) = work::run(py, |_| {
            let clip = recording.prepared()?.clip;
            let taught = memory
                .teach(name, &says, clip.moving())
                .map_err(Error::wrap)?;
            let all = taught.iter().map(ToString::to_string);
            let warnings: Vec<String> = all
                .chain(memory.doubts().iter().map(ToString::to_string))
                .collect();
            Ok((memory, warnings))
        })?;
        *self.lock() = memory;
        Ok(warnings)
    }

    /// Forgets an activity.
    fn forget(&self, name: &str) -> PyResult<()> {
        let forgotten = self.lock().forget(name);
        forgotten.map(|_| ()).map_err(errors::input)
    }

    /// The activities, their sentences and their examples.
    #[getter]
    fn activities<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let memory = self.copy();
        to_python(py, &memory.overview())
    }

    /// Writes the memory; the file is replaced as a whole or not at all. The file that the memory was read from is not replaced
    /// if another program has changed it since.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let memory = self.copy();
        // Another process may hold the lock of the file.
        work::run(py, |_| {
            let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
            let saved = match file.as_ref() {
                Some((own, read)) if *own == path => memory.save_over(&path, read),
                _ => memory.save(&path),
            };
            saved.map_err(Error::wrap)?;
            *file = Some((path, memory));
            Ok(())
        })
    }

    fn __repr__(&self) -> String {
        let memory = self.lock();
        let names: Vec<&str> = memory
            .activities()
            .iter()
            .map(|a| a.name.as_str())
            .collect();
        format!("Memory({})", names.join(", "))
    }
}
