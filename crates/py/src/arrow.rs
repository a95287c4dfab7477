//! Tables to and from Arrow: by its C stream interface in Python capsules, so that no Arrow library is needed on either side.

use std::{collections::HashMap, ffi::CStr, ops::Range, path::Path, sync::Arc};

use arrow_array::{
    Array, ArrayRef, ArrowPrimitiveType, BooleanArray, FixedSizeListArray, GenericListArray,
    LargeListArray, ListArray, OffsetSizeTrait, PrimitiveArray, RecordBatch, RecordBatchIterator,
    RecordBatchReader, StringArray, StructArray,
    cast::AsArray,
    ffi_stream::{FFI_ArrowArrayStream, RecordBatchStreamReader},
    types,
};
use arrow_buffer::OffsetBuffer;
use arrow_schema::{ArrowError, DataType, Field, Schema};
use pyo3::{prelude::*, types::PyCapsule};
use radarllm::{
    PointsFile, is_points_column, points_from_tables,
    table::{Column, List, Table, Values},
};

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
    let name = Path::new("from_arrow");
    let pieces = reader.map(|batch| table_of(&batch?));
    points_from_tables(name, &metadata, pieces).map_err(|e| errors::to_py(e.into()))
}

/// A table as an Arrow batch, which takes over its memory, but for texts and where lists begin.
pub(crate) fn batch_of(table: Table) -> Result<RecordBatch, ArrowError> {
    let schema = schema_of(&table);
    let columns = table.columns.into_iter().map(array_of);
    RecordBatch::try_new(Arc::new(schema), columns.collect::<Result<_, _>>()?)
}

/// The Arrow schema of a table.
pub(crate) fn schema_of(table: &Table) -> Schema {
    let fields: Vec<Field> = table.columns.iter().map(field_of).collect();
    let metadata: HashMap<String, String> = table.metadata.iter().cloned().collect();
    Schema::new(fields).with_metadata(metadata)
}

fn field_of(column: &Column) -> Field {
    let kind = match &column.values {
        Values::Bool(_) => DataType::Boolean,
        Values::I32(_) => DataType::Int32,
        Values::U32(_) => DataType::UInt32,
        Values::I64(_) => DataType::Int64,
        Values::U64(_) => DataType::UInt64,
        Values::F32(_) => DataType::Float32,
        Values::F64(_) => DataType::Float64,
        Values::Text(_) => DataType::Utf8,
        Values::List(lists) => {
            let element = Arc::new(field_of(lists.element()));
            match lists.length() {
                Some(length) => DataType::FixedSizeList(element, length as i32),
                None => DataType::List(element),
            }
        }
        Values::Struct(members) => DataType::Struct(members.iter().map(field_of).collect()),
    };
    Field::new(&column.name, kind, column.validity.is_some())
}

fn array_of(column: Column) -> Result<ArrayRef, ArrowError> {
    fn numbers<T: ArrowPrimitiveType>(
        values: Vec<T::Native>,
        validity: Option<Vec<bool>>,
    ) -> Result<ArrayRef, ArrowError> {
        let nulls = validity.map(Into::into);
        Ok(Arc::new(PrimitiveArray::<T>::try_new(
            values.into(),
            nulls,
        )?))
    }
    let kind = field_of(&column).data_type().clone();
    let validity = column.validity;
    match column.values {
        Values::Bool(v) => Ok(Arc::new(BooleanArray::new(
            v.into(),
            validity.map(Into::into),
        ))),
        Values::I32(v) => numbers::<types::Int32Type>(v, validity),
        Values::U32(v) => numbers::<types::UInt32Type>(v, validity),
        Values::I64(v) => numbers::<types::Int64Type>(v, validity),
        Values::U64(v) => numbers::<types::UInt64Type>(v, validity),
        Values::F32(v) => numbers::<types::Float32Type>(v, validity),
        Values::F64(v) => numbers::<types::Float64Type>(v, validity),
        Values::Text(v) => {
            let valid = validity
                .into_iter()
                .flatten()
                .chain(std::iter::repeat(true));
            let texts = v
                .iter()
                .zip(valid)
                .map(|(text, valid)| valid.then_some(text));
            Ok(Arc::new(StringArray::from_iter(texts)))
        }
        Values::List(lists) => {
            let nulls = validity.map(Into::into);
            let length = lists.length();
            let (offsets, element) = lists.into_parts();
            let elements = array_of(element)?;
            match (kind, length) {
                (DataType::FixedSizeList(field, n), Some(_)) => Ok(Arc::new(
                    FixedSizeListArray::try_new(field, n, elements, nulls)?,
                )),
                (DataType::List(field), None) => {
                    let offsets: Option<Vec<i32>> =
                        offsets.into_iter().map(|o| i32::try_from(o).ok()).collect();
                    let offsets = offsets.ok_or(ArrowError::OffsetOverflowError(elements.len()))?;
                    let offsets = OffsetBuffer::new(offsets.into());
                    Ok(Arc::new(ListArray::try_new(
                        field, offsets, elements, nulls,
                    )?))
                }
                (kind, _) => Err(unsupported(&kind)),
            }
        }
        Values::Struct(members) => match kind {
            DataType::Struct(fields) => {
                let arrays = members.into_iter().map(array_of);
                Ok(Arc::new(StructArray::try_new(
                    fields,
                    arrays.collect::<Result<_, _>>()?,
                    validity.map(Into::into),
                )?))
            }
            kind => Err(unsupported(&kind)),
        },
    }
}

fn unsupported(kind: &DataType) -> ArrowError {
    ArrowError::NotYetImplemented(format!("columns of type {kind}"))
}

/// The columns of points in a batch.
fn table_of(batch: &RecordBatch) -> Result<Table, ArrowError> {
    let schema = batch.schema();
    let columns = schema.fields().iter().zip(batch.columns());
    let wanted = columns.filter(|(field, _)| is_points_column(field.name()));
    let columns = wanted.map(|(field, array)| {
        let column = column_of(field.name(), array, 0..array.len());
        column.map_err(|e| match e {
            ArrowError::NotYetImplemented(what) => {
                ArrowError::SchemaError(format!("column `{}`: {what} are not read", field.name()))
            }
            e => e,
        })
    });
    Ok(Table {
        columns: columns.collect::<Result<_, _>>()?,
        metadata: Vec::new(),
    })
}

/// Rows of an array.
fn column_of(name: &str, array: &ArrayRef, rows: Range<usize>) -> Result<Column, ArrowError> {
    fn numbers<T: ArrowPrimitiveType>(array: &ArrayRef, rows: Range<usize>) -> Vec<T::Native> {
        array.as_primitive::<T>().values()[rows].to_vec()
    }
    let texts = |text: &dyn Fn(usize) -> String| Values::Text(rows.clone().map(text).collect());
    let at = rows.clone();
    let values = match array.data_type() {
        DataType::Boolean => {
            let booleans = array.as_boolean();
            Values::Bool(at.map(|row| booleans.value(row)).collect())
        }
        DataType::Int32 => Values::I32(numbers::<types::Int32Type>(array, at)),
        DataType::UInt32 => Values::U32(numbers::<types::UInt32Type>(array, at)),
        DataType::Int64 => Values::I64(numbers::<types::Int64Type>(array, at)),
        DataType::UInt64 => Values::U64(numbers::<types::UInt64Type>(array, at)),
        DataType::Float32 => Values::F32(numbers::<types::Float32Type>(array, at)),
        DataType::Float64 => Values::F64(numbers::<types::Float64Type>(array, at)),
        DataType::Utf8 => texts(&|row| array.as_string::<i32>().value(row).into()),
        DataType::LargeUtf8 => texts(&|row| array.as_string::<i64>().value(row).into()),
        DataType::List(_) => lists_of(array.as_list::<i32>(), at)?,
        DataType::LargeList(_) => {
            let lists: &LargeListArray = array.as_list::<i64>();
            lists_of(lists, at)?
        }
        DataType::Struct(fields) => {
            let structs = array.as_struct();
            let members = fields.iter().zip(structs.columns());
            let members = members.map(|(f, member)| column_of(f.name(), member, at.clone()));
            Values::Struct(members.collect::<Result<_, _>>()?)
        }
        kind => return Err(unsupported(kind)),
    };
    let has_nulls = array.null_count() > 0;
    Ok(Column {
        name: name.into(),
        values,
        validity: has_nulls.then(|| rows.map(|row| array.is_valid(row)).collect()),
    })
}

fn lists_of<O: OffsetSizeTrait>(
    lists: &GenericListArray<O>,
    rows: Range<usize>,
) -> Result<Values, ArrowError> {
    let offsets = &lists.value_offsets()[rows.start..=rows.end];
    let first = offsets.first().map_or(0, |o| o.as_usize());
    let last = offsets.last().map_or(0, |o| o.as_usize());
    let element = column_of("element", lists.values(), first..last)?;
    let offsets = offsets.iter().map(|o| o.as_usize() - first).collect();
    let lists = List::new(offsets, element);
    let lists = lists.ok_or_else(|| ArrowError::CDataInterface("offsets of lists decrease".into()));
    Ok(Values::List(lists?))
}
