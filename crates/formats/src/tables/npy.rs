//! npy arrays of real numbers, plain or with named columns, over bytes in memory. Pickled objects are refused.

use super::py_literal::{Literal, parse_literal};
use crate::recordings::{Place, RecordingError};

/// First bytes of every npy file.
pub const NPY_MAGIC: &[u8; 6] = b"\x93NUMPY";

/// What a header says. Nothing is allocated by its numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct NpyHeader {
    /// Extents.
    pub shape: Vec<u64>,
    /// True for column-major data.
    pub fortran: bool,
    /// Element: one unnamed field, or the columns of a structured array.
    pub fields: Vec<NpyField>,
    /// Bytes of one element.
    pub item_bytes: usize,
    /// Where the data starts, bytes.
    pub data_at: usize,
}

/// A number within an element.
#[derive(Clone, Debug, PartialEq)]
pub struct NpyField {
    /// Column name; empty in plain arrays.
    pub name: String,
    /// numpy's code, as `f4` or `c8`.
    pub code: String,
    /// True for big-endian values.
    pub big_endian: bool,
    /// Place in the element, bytes.
    pub offset: usize,
}

fn wrong(byte: usize, expected: impl Into<String>, found: &str) -> RecordingError {
    RecordingError::new(Place::Byte(byte as u64), expected, found)
}

/// Reads the header of an npy file; `bytes` may end anywhere after it.
///
/// # Errors
/// [`RecordingError`] for anything that is no npy header, and for arrays of Python objects.
pub fn read_npy_header(bytes: &[u8]) -> Result<NpyHeader, RecordingError> {
    if !bytes.starts_with(NPY_MAGIC) {
        return Err(wrong(0, "\\x93NUMPY", "other bytes"));
    }
    let (length, start) = match (bytes.get(6), bytes.len()) {
        (Some(1), 10..) => (usize::from(u16::from_le_bytes([bytes[8], bytes[9]])), 10),
        (Some(2 | 3), 12..) => {
            let length = u32::from_le_bytes([bytes[8], bytes[9], bytes[10], bytes[11]]);
            (length as usize, 12)
        }
        _ => {
            return Err(wrong(
                6,
                "npy version 1 to 3",
                "another version, or the end",
            ));
        }
    };
    let data_at = start + length;
    let text = bytes
        .get(start..data_at)
        .ok_or_else(|| wrong(start, format!("a header of {length} bytes"), "the end"))?;
    let text =
        std::str::from_utf8(text).map_err(|_| wrong(start, "a header in UTF-8", "other bytes"))?;
    let header =
        parse_literal(text).map_err(|e| wrong(start + e.byte, e.expected, "something else"))?;
    let shape = header
        .get("shape")
        .and_then(Literal::items)
        .and_then(|dims| dims.iter().map(whole).collect::<Option<Vec<u64>>>())
        .ok_or_else(|| wrong(start, "'shape': (whole numbers)", text))?;
    let Some(Literal::Bool(fortran)) = header.get("fortran_order") else {
        return Err(wrong(start, "'fortran_order': True or False", text));
    };
    let (fields, item_bytes) = match header.get("descr") {
        Some(Literal::Text(code)) => {
            let (field, size) = field("", code, 0, start)?;
            (vec![field], size)
        }
        Some(Literal::List(columns)) => {
            let mut fields = Vec::new();
            let mut offset = 0_usize;
            for column in columns {
                let (name, code) = match column.items() {
                    Some([Literal::Text(name), Literal::Text(code)]) => (name, code),
                    _ => return Err(wrong(start, "columns of ('name', 'type')", text)),
                };
                let (field, size) = field(name, code, offset, start)?;
                offset += size;
                fields.push(field);
            }
            (fields, offset)
        }
        _ => return Err(wrong(start, "'descr'", text)),
    };
    if item_bytes == 0 {
        return Err(wrong(start, "a type with at least one byte", text));
    }
    Ok(NpyHeader {
        shape,
        fortran: *fortran,
        fields,
        item_bytes,
        data_at,
    })
}

fn whole(value: &Literal) -> Option<u64> {
    let v = value.number()?;
    (v >= 0.0 && v.fract() == 0.0 && v < 9e15).then_some(v as u64)
}

/// A field and its size from a type string like `<f4`.
fn field(
    name: &str,
    descr: &str,
    offset: usize,
    at: usize,
) -> Result<(NpyField, usize), RecordingError> {
    let (order, code) = descr.split_at_checked(1).unwrap_or(("", descr));
    if code.starts_with('O') {
        return Err(wrong(
            at,
            "numbers; Python objects are pickles, which are never read. Save the numbers alone, for example with \
             numpy.save(name, numpy.asarray(points, dtype=numpy.float32))",
            descr,
        ));
    }
    let size = match code {
        "b1" | "i1" | "u1" => 1,
        "i2" | "u2" | "f2" => 2,
        "i4" | "u4" | "f4" => 4,
        "i8" | "u8" | "f8" | "c8" => 8,
        "c16" => 16,
        _ => return Err(wrong(at, "a type of numbers as '<f4'", descr)),
    };
    let big_endian = match order {
        "<" | "|" | "=" => false,
        ">" => true,
        _ => return Err(wrong(at, "a type that starts with <, > or |", descr)),
    };
    let field = NpyField {
        name: name.into(),
        code: code.into(),
        big_endian,
        offset,
    };
    Ok((field, size))
}

/// A whole array of real numbers in C order.
#[derive(Clone, Debug)]
pub struct NpyArray<'a> {
    /// The header.
    pub header: NpyHeader,
    data: &'a [u8],
}

impl<'a> NpyArray<'a> {
    /// Wraps a file.
    ///
    /// # Errors
    /// What [`read_npy_header`] refuses; also Fortran order, and data of another length than the header says.
    pub fn new(bytes: &'a [u8]) -> Result<Self, RecordingError> {
        let header = read_npy_header(bytes)?;
        if header.fortran && header.shape.len() > 1 {
            return Err(wrong(
                header.data_at,
                "C order (numpy.ascontiguousarray)",
                "Fortran order",
            ));
        }
        if let Some(field) = header
            .fields
            .iter()
            .find(|f| f.code.starts_with('c') || f.code == "f2")
        {
            return Err(wrong(
                0,
                "integers, or floats of 32 or 64 bits",
                &field.code,
            ));
        }
        let data = &bytes[header.data_at..];
        let expected = header
            .shape
            .iter()
            .try_fold(header.item_bytes as u64, |n, dim| n.checked_mul(*dim));
        if expected != Some(data.len() as u64) {
            return Err(wrong(
                header.data_at,
                format!(
                    "data of shape {:?}, {} bytes each",
                    header.shape, header.item_bytes
                ),
                &format!("{} bytes", data.len()),
            ));
        }
        Ok(Self { header, data })
    }

    /// Elements.
    pub fn len(&self) -> usize {
        self.data.len() / self.header.item_bytes
    }

    /// True when there is no element.
    pub fn is_empty(&self) -> bool {
        self.data.is_empty()
    }

    /// Field `field` of element `index`, both within bounds, as f64; integers above 2^53 are rounded.
    pub fn value(&self, index: usize, field: usize) -> f64 {
        let field = &self.header.fields[field];
        let at = index * self.header.item_bytes + field.offset;
        number_at(&self.data[at..], &field.code, field.big_endian)
    }
}

/// The number at the start of `bytes`; NaN for a code that [`NpyArray::new`] does not let through.
fn number_at(bytes: &[u8], code: &str, big_endian: bool) -> f64 {
    macro_rules! read {
        ($t:ty) => {{
            let mut raw = [0; size_of::<$t>()];
            raw.copy_from_slice(&bytes[..size_of::<$t>()]);
            (if big_endian {
                <$t>::from_be_bytes(raw)
            } else {
                <$t>::from_le_bytes(raw)
            }) as f64
        }};
    }
    match code {
        "b1" | "u1" => f64::from(bytes[0]),
        "i1" => read!(i8),
        "i2" => read!(i16),
        "u2" => read!(u16),
        "i4" => read!(i32),
        "u4" => read!(u32),
        "i8" => read!(i64),
        "u8" => read!(u64),
        "f4" => read!(f32),
        "f8" => read!(f64),
        _ => f64::NAN,
    }
}
