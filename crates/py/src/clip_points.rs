//! The points of several clips in one piece of memory, from which batches for training are gathered.

use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use radarllm::{
    Error, Result,
    table::{Column, List, Table, Values},
};

use crate::points::view;

/// Values of a point.
const N_VALUES: usize = 6;

/// Points and sentences of at most 32 clips, as they lie in the file.
#[pyclass(frozen, name = "_ClipPoints", module = "radarllm._native")]
pub struct PyClipPoints {
    /// All points one after the other.
    values: Vec<f32>,
    /// Points of frame i are those from `frame_offsets[i]` to `frame_offsets[i + 1]`.
    frame_offsets: Vec<i64>,
    /// Frames of clip i are those from `clip_offsets[i]` to `clip_offsets[i + 1]`.
    clip_offsets: Vec<i64>,
    ids: Vec<String>,
    actions: Vec<String>,
    captions: Vec<Vec<String>>,
}

impl PyClipPoints {
    /// Takes the points out of rows of a shard.
    pub fn new(mut rows: Table) -> Result<Self> {
        let at = rows.columns.iter().position(|c| c.name == "points");
        let frames = list(at.map(|at| rows.columns.swap_remove(at)))?;
        let (clip_offsets, points) = frames.into_parts();
        let (frame_offsets, values) = list(Some(points))?.into_parts();
        let (_, leaf) = list(Some(values))?.into_parts();
        let Values::F32(values) = leaf.values else {
            return Err(unexpected());
        };
        let n_points = frame_offsets.last().copied().unwrap_or_default();
        if values.len() != n_points * N_VALUES {
            return Err(unexpected());
        }
        if let Some(at) = values.iter().position(|v| !v.is_finite()) {
            let value = values[at];
            return Err(Error::input(format!(
                "column `points`, point {}: a value is {value}",
                at / N_VALUES
            )));
        }
        let captions = rows.column("captions").and_then(Column::as_list);
        let captions = captions.ok_or_else(unexpected)?;
        let texts_of = captions.element().as_text().ok_or_else(unexpected)?;
        let of_clips = (0..captions.n_rows()).map(|row| match captions.range(row) {
            none if none.is_empty() => {
                Err(Error::input(format!("column `captions`, row {row}: none")))
            }
            some => Ok(texts_of[some].to_vec()),
        });
        Ok(Self {
            frame_offsets: offsets(frame_offsets),
            clip_offsets: offsets(clip_offsets),
            ids: texts(&rows, "id")?,
            actions: texts(&rows, "action")?,
            captions: of_clips.collect::<Result<_>>()?,
            values,
        })
    }
}

fn list(column: Option<Column>) -> Result<List> {
    match column.map(|column| column.values) {
        Some(Values::List(lists)) => Ok(lists),
        _ => Err(unexpected()),
    }
}

fn texts(rows: &Table, name: &str) -> Result<Vec<String>> {
    let texts = rows.column(name).and_then(Column::as_text);
    Ok(texts.ok_or_else(unexpected)?.to_vec())
}

/// The reader compares the columns with those of the data set, so that no file leads here.
fn unexpected() -> Error {
    Error::input("the columns are not those of a data set")
}

fn offsets(offsets: Vec<usize>) -> Vec<i64> {
    offsets.into_iter().map(|o| o as i64).collect()
}

#[pymethods]
impl PyClipPoints {
    fn __len__(&self) -> usize {
        self.ids.len()
    }

    /// x, y, z, range in m, velocity in m/s, intensity in dB: float32, shape (n_points, 6), read-only, without a copy.
    #[getter]
    fn points<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let values = &this.get().values;
        // SAFETY: the object is frozen and keeps the column, whose buffer nobody changes.
        let flat = unsafe { view(values, this.clone().into_any()) };
        flat.reshape([values.len() / N_VALUES, N_VALUES])
    }

    /// Where the points of each frame begin: int64, shape (n_frames + 1,).
    #[getter]
    fn frame_offsets<'py>(this: &Bound<'py, Self>) -> Bound<'py, PyArray1<i64>> {
        // SAFETY: the object is frozen and keeps the vector.
        unsafe { view(&this.get().frame_offsets, this.clone().into_any()) }
    }

    /// Where the frames of each clip begin: int64, shape (n_clips + 1,).
    #[getter]
    fn clip_offsets<'py>(this: &Bound<'py, Self>) -> Bound<'py, PyArray1<i64>> {
        // SAFETY: the object is frozen and keeps the vector.
        unsafe { view(&this.get().clip_offsets, this.clone().into_any()) }
    }

    /// Ids of the clips.
    #[getter]
    fn ids(&self) -> Vec<String> {
        self.ids.clone()
    }

    /// Actions of the clips.
    #[getter]
    fn actions(&self) -> Vec<String> {
        self.actions.clone()
    }

    /// Sentences about each clip, at least one.
    #[getter]
    fn captions(&self) -> Vec<Vec<String>> {
        self.captions.clone()
    }
}
