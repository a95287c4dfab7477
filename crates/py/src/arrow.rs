//! Arrow's C stream interface in Python capsules, so that no Arrow library is needed on either side.

use std::{collections::HashMap, ffi::CStr, path::Path};

use arrow_array::{
    RecordBatch, RecordBatchIterator, RecordBatchReader,
    ffi_stream::{FFI_ArrowArrayStream, RecordBatchStreamReader},
};
use pyo3::{prelude::*, types::PyCapsule};
use radarllm::{PointsFile, points_from_batches};

use crate::errors;

/// Name that Arrow gives capsules with a stream.
const STREAM: &CStr = c"arrow_array_stream";

/// A capsule with a stream. Whoever takes the stream marks it as released, so that the capsule frees it only if nobody
/// did.
pub(crate) fn capsule<'py>(
    py: Python<'py>,
    batches: Box<dyn RecordBatchReader + Send>,
) -> PyResult<Bound<'py, PyCapsule>> {
    PyCapsule::new_with_value(py, FFI_ArrowArrayStream::new(batches), STREAM)
}

/// A stream of one batch, which shares its memory.
pub(crate) fn capsule_of_batch<'py>(
    py: Python<'py>,
    batch: &RecordBatch,
) -> PyResult<Bound<'py, PyCapsule>> {
    let batches = RecordBatchIterator::new([Ok(batch.clone())], batch.schema());
    capsule(py, Box::new(batches))
}

/// Reads points from any object with `__arrow_c_stream__`. `complete` may add to the metadata of its schema.
pub(crate) fn points_from(
    table: &Bound<'_, PyAny>,
    complete: impl FnOnce(&mut HashMap<String, String>) -> PyResult<()>,
) -> PyResult<PointsFile> {
    let Ok(export) = table.getattr("__arrow_c_stream__") else {
        return Err(errors::input_with_hint(
            format!(
                "from_arrow: {} has no __arrow_c_stream__",
                table.get_type().name()?
            ),
            "a pyarrow table, a polars frame, or anything else with Arrow's C stream interface",
        ));
    };
    let stream = export.call0()?;
    let capsule = stream.cast::<PyCapsule>()?;
    let pointer = capsule.pointer_checked(Some(STREAM))?;
    // SAFETY: a capsule of this name holds an `ArrowArrayStream` by Arrow's C stream interface, and `pointer_checked`
    // compared the name. The reader moves the stream out and marks it as released.
    let reader = unsafe { RecordBatchStreamReader::from_raw(pointer.as_ptr().cast()) }
        .map_err(|e| errors::input(format!("from_arrow: {e}")))?;
    let schema = reader.schema();
    let metadata = schema.metadata().iter();
    let mut metadata: HashMap<String, String> = metadata
        .map(|(key, value)| (key.to_string(), value.to_string()))
        .collect();
    complete(&mut metadata)?;
    points_from_batches(Path::new("from_arrow"), &metadata, reader)
        .map_err(|e| errors::to_py(e.into()))
}
