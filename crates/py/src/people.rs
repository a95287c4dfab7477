//! `people`.

use pyo3::prelude::*;
use radarllm::PeopleOptions;

use crate::{errors, options::check_range, points::PyPoints, work};

/// Most people that may be asked for, as in the command.
const MAX_PEOPLE: usize = 100;

/// A tracked person.
#[pyclass(frozen, get_all, name = "Person", module = "radarllm")]
pub struct PyPerson {
    /// Number of the track, from 1.
    id: u32,
    /// Start of the first frame in which the person was seen, s.
    start_s: f64,
    /// Start of the last frame in which the person was seen, s.
    end_s: f64,
    /// The person's points, from the first to the last frame in which the person was seen.
    points: Py<PyPoints>,
}

#[pymethods]
impl PyPerson {
    fn __repr__(&self) -> String {
        format!(
            "Person({}, {:.1} s to {:.1} s, {} points)",
            self.id,
            self.start_s,
            self.end_s,
            self.points.get().clip().n_points()
        )
    }
}

/// Tracks the people in points and returns each of them, with their own points at the frame rate of the model.
///
/// At most `max_people`, those with the most points; all if None. `remove_ghosts` leaves out tracks that are multipath
/// reflections of others.
///
/// >>> [person.id for person in people(simulate("builtin:walk"))]
/// [1]
#[pyfunction]
#[pyo3(signature = (points, *, max_people=None, remove_ghosts=false))]
pub(crate) fn people(
    py: Python<'_>,
    points: &Bound<'_, PyPoints>,
    max_people: Option<usize>,
    remove_ghosts: bool,
) -> PyResult<Vec<PyPerson>> {
    if let Some(n) = max_people {
        check_range("max_people", n, 1..=MAX_PEOPLE).map_err(errors::to_py)?;
    }
    let options = PeopleOptions {
        max_people,
        remove_ghosts,
        ..PeopleOptions::default()
    };
    let recording = &points.get().recording;
    let found = work::run(py, |_| recording.track_people(&options))?;
    let person = |found: radarllm::Person| {
        Ok(PyPerson {
            id: found.id,
            start_s: found.start_s,
            end_s: found.end_s,
            points: Py::new(py, PyPoints::from(found.clip))?,
        })
    };
    found.into_iter().map(person).collect()
}
