//! The points of several clips in one piece of memory, from which batches for training are gathered.

use arrow_array::{
    Array, FixedSizeListArray, Float32Array, ListArray, RecordBatch, StringArray, cast::AsArray,
    types::Float32Type,
};
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use radarllm::{Error, Result};

use crate::points::view;

/// Values of a point.
const N_VALUES: usize = 6;

/// Points and sentences of at most 32 clips, as they lie in the file.
#[pyclass(frozen, name = "_ClipPoints", module = "radarllm._native")]
pub struct PyClipPoints {
    /// All points one after the other; the array keeps the memory of the file's column.
    values: Float32Array,
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
    pub fn new(batch: RecordBatch) -> Result<Self> {
        let frames = list(&batch, "points")?;
        let points: &ListArray = inner(frames.values().as_list_opt::<i32>())?;
        let values: &FixedSizeListArray = inner(points.values().as_fixed_size_list_opt())?;
        let leaf: &Float32Array = inner(values.values().as_primitive_opt::<Float32Type>())?;
        if values.value_length() as usize != N_VALUES || leaf.len() != values.len() * N_VALUES {
            return Err(unexpected());
        }
        if leaf.null_count() > 0 {
            return Err(Error::input("column `points`: a value is null"));
        }
        if let Some(at) = leaf.values().iter().position(|v| !v.is_finite()) {
            let value = leaf.value(at);
            return Err(Error::input(format!(
                "column `points`, point {}: a value is {value}",
                at / N_VALUES
            )));
        }
        let captions = list(&batch, "captions")?;
        let captions = (0..captions.len()).map(|row| {
            let of_row = captions.value(row);
            let texts: &StringArray = inner(of_row.as_string_opt::<i32>())?;
            let texts: Vec<String> = texts.iter().flatten().map(str::to_string).collect();
            match texts.is_empty() {
                true => Err(Error::input(format!("column `captions`, row {row}: none"))),
                false => Ok(texts),
            }
        });
        Ok(Self {
            frame_offsets: offsets(points),
            clip_offsets: offsets(frames),
            ids: texts(&batch, "id")?,
            actions: texts(&batch, "action")?,
            captions: captions.collect::<Result<_>>()?,
            values: leaf.clone(),
        })
    }
}

fn list<'a>(batch: &'a RecordBatch, name: &str) -> Result<&'a ListArray> {
    inner(
        batch
            .column_by_name(name)
            .and_then(|column| column.as_list_opt::<i32>()),
    )
}

fn texts(batch: &RecordBatch, name: &str) -> Result<Vec<String>> {
    let column = batch.column_by_name(name);
    let texts: &StringArray = inner(column.and_then(|c| c.as_string_opt::<i32>()))?;
    Ok(texts.iter().flatten().map(str::to_string).collect())
}

/// The reader compares the columns with those of the data set, so that no file leads here.
fn inner<T>(found: Option<T>) -> Result<T> {
    found.ok_or_else(unexpected)
}

fn unexpected() -> Error {
    Error::input("the columns are not those of a data set")
}

fn offsets(list: &ListArray) -> Vec<i64> {
    list.value_offsets().iter().map(|&o| i64::from(o)).collect()
}

#[pymethods]
impl PyClipPoints {
    fn __len__(&self) -> usize {
        self.ids.len()
    }

    /// x, y, z, range in m, velocity in m/s, intensity in dB: float32, shape (n_points, 6), read-only, without a copy.
    #[getter]
    fn points<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let values = this.get().values.values();
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
