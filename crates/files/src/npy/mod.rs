//! NumPy arrays of numbers: in memory ([`NpyArray`]), as a stream ([`NpyStream`]), in archives ([`Npz`]), and written
//! ([`NpyWriter`]).
//!
//! Supported are plain arrays and structured arrays with named columns, in either byte order. Arrays in Fortran order
//! are converted to C order on access. Python objects are pickles, which can execute code when they are read. They are
//! therefore refused; archives skip them by name.
//!
//! The header is parsed here rather than by the crate `npyz`. That crate allocates
//! as many bytes as the length field declares (up to 4 GiB), does not limit the nesting depth, and reports no byte
//! offset. The checks that would have to precede it are longer than the parser, and literals must be parsed for
//! calibration files anyway.
//!
//! ```
//! use radarllm_files::npy::{NpyArray, read_npy_header};
//!
//! let text = "{'descr': [('x', '<f4'), ('n', '<u2')], 'fortran_order': False, 'shape': (1,)}";
//! let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
//! bytes.extend((text.len() as u16).to_le_bytes());
//! bytes.extend(text.bytes());
//! bytes.extend(0.25_f32.to_le_bytes());
//! bytes.extend(7_u16.to_le_bytes());
//! let array = NpyArray::new(&bytes)?;
//! assert_eq!(array.header.fields[1].name, "n");
//! assert_eq!((array.value(0, 0), array.value(0, 1)), (0.25, 7.0));
//!
//! // The file ends too early: the error says where the data should be.
//! let error = NpyArray::new(&bytes[..bytes.len() - 1]).unwrap_err();
//! assert_eq!(error.byte as usize, 10 + text.len());
//! # Ok::<(), radarllm_files::npy::NpyError>(())
//! ```

mod npz;
mod stream;
mod write;

pub use npz::{Npz, NpzError, Skipped};
pub use stream::NpyStream;
pub use write::{NpyElement, NpyWriter};

use std::borrow::Cow;

use crate::literal::{Literal, parse_literal};

/// Magic bytes at the start of every npy file.
pub const NPY_MAGIC: &[u8; 6] = b"\x93NUMPY";

/// Maximum length of a header, bytes. A column takes about 20 bytes; NumPy itself warns from 10,000 bytes on.
pub const MAX_HEADER_BYTES: usize = 1 << 16;
/// Maximum number of dimensions, as in NumPy.
const MAX_DIMENSIONS: usize = 64;

/// Content of a header. No number in it determines an allocation.
#[derive(Clone, Debug, PartialEq)]
pub struct NpyHeader {
    /// Length of each dimension.
    pub shape: Vec<u64>,
    /// Whether the data are in Fortran order (column-major).
    pub fortran: bool,
    /// Fields of an element: one unnamed field, or the columns of a structured array.
    pub fields: Vec<NpyField>,
    /// Size of one element, bytes.
    pub item_bytes: usize,
    /// Offset of the data, bytes.
    pub data_at: usize,
}

impl NpyHeader {
    /// Type of the elements in NumPy's notation; for a structured array, the types of its columns.
    pub fn descr(&self) -> String {
        let descr = |f: &NpyField| format!("{}{}", if f.big_endian { '>' } else { '<' }, f.code);
        match self.fields.as_slice() {
            [field] if field.name.is_empty() => descr(field),
            fields => {
                let fields: Vec<String> = fields.iter().take(8).map(descr).collect();
                format!("[{}]", fields.join(", "))
            }
        }
    }
}

/// A field of an element.
#[derive(Clone, Debug, PartialEq)]
pub struct NpyField {
    /// Column name; empty in plain arrays.
    pub name: String,
    /// NumPy's type code, for example `f4`, `c8` or `U4`.
    pub code: String,
    /// Whether values are big-endian.
    pub big_endian: bool,
    /// Offset in the element, bytes.
    pub offset: usize,
    /// Encoding of a real number, or of each part of a complex number; `None` for text and half floats.
    number: Option<Number>,
}

impl NpyField {
    fn is_complex(&self) -> bool {
        self.code.starts_with('c')
    }

    /// Encoding of the value if it is a real number.
    fn real(&self) -> Option<Number> {
        self.number.filter(|_| !self.is_complex())
    }
}

/// Encoding of a number.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Number {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    U64,
    I64,
    F32,
    F64,
}

/// Reason why bytes are not an array of numbers.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("byte {byte}: expected {expected}, found {found}")]
pub struct NpyError {
    /// Byte offset, from 0.
    pub byte: u64,
    /// What the format requires.
    pub expected: String,
    /// What was found, shortened and in backticks.
    pub found: String,
    /// Whether the array contains Python objects.
    pub is_pickled: bool,
}

fn wrong(byte: usize, expected: impl Into<String>, found: &str) -> NpyError {
    // Untrusted text is shortened and stripped of control characters before it can reach a terminal.
    let found: String = found
        .chars()
        .take(40)
        .map(|c| if c.is_control() { '?' } else { c })
        .collect();
    NpyError {
        byte: byte as u64,
        expected: expected.into(),
        found: format!("`{found}`"),
        is_pickled: false,
    }
}

/// Reads the length of the header text and its offset from the first twelve bytes of a file, or from all bytes of a
/// shorter one.
fn read_prelude(bytes: &[u8]) -> Result<(usize, usize), NpyError> {
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
    if length > MAX_HEADER_BYTES {
        return Err(wrong(
            8,
            format!("a header of at most {MAX_HEADER_BYTES} bytes"),
            &format!("{length} bytes"),
        ));
    }
    Ok((length, start))
}

/// Reads the header of an npy file. `bytes` may end anywhere after the header.
///
/// # Errors
/// [`NpyError`] for an invalid header and for arrays of Python objects.
pub fn read_npy_header(bytes: &[u8]) -> Result<NpyHeader, NpyError> {
    let (length, start) = read_prelude(bytes)?;
    let text = bytes
        .get(start..start + length)
        .ok_or_else(|| wrong(start, format!("a header of {length} bytes"), "the end"))?;
    parse_header(text, start)
}

/// Parses the text of a header, which starts at byte `start`.
fn parse_header(text: &[u8], start: usize) -> Result<NpyHeader, NpyError> {
    let text =
        std::str::from_utf8(text).map_err(|_| wrong(start, "a header in UTF-8", "other bytes"))?;
    let header =
        parse_literal(text).map_err(|e| wrong(start + e.byte, e.expected, "something else"))?;
    let shape = header
        .get("shape")
        .and_then(Literal::items)
        .filter(|dims| dims.len() <= MAX_DIMENSIONS)
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
                offset = offset
                    .checked_add(size)
                    .ok_or_else(|| wrong(start, "an element that fits into memory", text))?;
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
        data_at: start + text.len(),
    })
}

fn whole(value: &Literal) -> Option<u64> {
    let v = value.number()?;
    (v >= 0.0 && v.fract() == 0.0 && v < 9e15).then_some(v as u64)
}

/// Parses a type string such as `<f4`; returns the field and its size.
fn field(name: &str, descr: &str, offset: usize, at: usize) -> Result<(NpyField, usize), NpyError> {
    let (order, code) = descr.split_at_checked(1).unwrap_or(("", descr));
    if code.starts_with('O') {
        return Err(NpyError {
            is_pickled: true,
            ..wrong(
                at,
                "numbers; Python objects are pickles, which are never read. Save the numbers alone, for example with \
                 numpy.save(name, numpy.asarray(points, dtype=numpy.float32))",
                descr,
            )
        });
    }
    let text_bytes = |unit: usize| code.get(1..)?.parse::<usize>().ok()?.checked_mul(unit);
    let size = match code {
        "b1" | "i1" | "u1" => Some(1),
        "i2" | "u2" | "f2" => Some(2),
        "i4" | "u4" | "f4" => Some(4),
        "i8" | "u8" | "f8" | "c8" => Some(8),
        "c16" => Some(16),
        _ if code.starts_with('U') => text_bytes(4),
        _ if code.starts_with('S') => text_bytes(1),
        _ => None,
    };
    let Some(size) = size else {
        return Err(wrong(at, "a type of numbers as '<f4'", descr));
    };
    let big_endian = match order {
        "<" | "|" | "=" => false,
        ">" => true,
        _ => return Err(wrong(at, "a type that starts with <, > or |", descr)),
    };
    let number = match code {
        "b1" | "u1" => Some(Number::U8),
        "i1" => Some(Number::I8),
        "u2" => Some(Number::U16),
        "i2" => Some(Number::I16),
        "u4" => Some(Number::U32),
        "i4" => Some(Number::I32),
        "u8" => Some(Number::U64),
        "i8" => Some(Number::I64),
        "f4" | "c8" => Some(Number::F32),
        "f8" | "c16" => Some(Number::F64),
        _ => None,
    };
    let field = NpyField {
        name: name.into(),
        code: code.into(),
        big_endian,
        offset,
        number,
    };
    Ok((field, size))
}

/// A complete array in memory.
#[derive(Clone, Debug)]
pub struct NpyArray<'a> {
    /// The header.
    pub header: NpyHeader,
    bytes: Cow<'a, [u8]>,
}

impl<'a> NpyArray<'a> {
    /// Reads a file of real numbers, borrowed or owned.
    ///
    /// # Errors
    /// As [`Self::of_any_type`]; also for text, complex numbers and half floats.
    pub fn new(bytes: impl Into<Cow<'a, [u8]>>) -> Result<Self, NpyError> {
        let array = Self::of_any_type(bytes)?;
        match array.header.fields.iter().find(|f| f.real().is_none()) {
            Some(field) => Err(wrong(
                0,
                "integers, or floats of 32 or 64 bits",
                &field.code,
            )),
            None => Ok(array),
        }
    }

    /// Reads a file with elements of any supported type, borrowed or owned.
    ///
    /// # Errors
    /// As [`read_npy_header`]; also if the length of the data differs from that in the header.
    pub fn of_any_type(bytes: impl Into<Cow<'a, [u8]>>) -> Result<Self, NpyError> {
        let bytes = bytes.into();
        let header = read_npy_header(&bytes)?;
        let n_bytes = bytes.len() - header.data_at;
        let expected = header
            .shape
            .iter()
            .try_fold(header.item_bytes as u64, |n, dim| n.checked_mul(*dim));
        if expected != Some(n_bytes as u64) {
            return Err(wrong(
                header.data_at,
                format!(
                    "data of shape {:?}, {} bytes each",
                    header.shape, header.item_bytes
                ),
                &format!("{n_bytes} bytes"),
            ));
        }
        Ok(Self { header, bytes })
    }

    /// Length of each dimension. Because the data are in memory, every length fits into `usize` unless the array is
    /// empty.
    pub fn shape(&self) -> Vec<usize> {
        let fits = |dim: &u64| usize::try_from(*dim).unwrap_or(usize::MAX);
        self.header.shape.iter().map(fits).collect()
    }

    /// Number of elements.
    pub fn len(&self) -> usize {
        self.data().len() / self.header.item_bytes
    }

    /// Whether the array has no elements.
    pub fn is_empty(&self) -> bool {
        self.data().is_empty()
    }

    /// Field `field` of element `index` in C order as f64; both indices must be within bounds. Integers above 2^53 are
    /// rounded. NaN if the field is not a real number.
    pub fn value(&self, index: usize, field: usize) -> f64 {
        let field = &self.header.fields[field];
        let at = self.stored_at(index) * self.header.item_bytes + field.offset;
        match field.real() {
            Some(number) => number.at(&self.data()[at..], field.big_endian),
            None => f64::NAN,
        }
    }

    /// All values in C order; `None` for text, complex numbers, half floats and structured arrays.
    pub fn numbers(&self) -> Option<Vec<f64>> {
        self.numbers_as(|v| v)
    }

    /// As [`Self::numbers`], in single precision.
    pub fn numbers_f32(&self) -> Option<Vec<f32>> {
        self.numbers_as(|v| v as f32)
    }

    fn numbers_as<T>(&self, convert: impl Fn(f64) -> T) -> Option<Vec<T>> {
        let [field] = self.header.fields.as_slice() else {
            return None;
        };
        let number = field.real().filter(|_| field.name.is_empty())?;
        let (data, item_bytes) = (self.data(), self.header.item_bytes);
        let value = |i| convert(number.at(&data[i * item_bytes..], field.big_endian));
        let places = 0..self.len();
        Some(if self.header.fortran {
            places.map(|i| value(self.stored_at(i))).collect()
        } else {
            places.map(value).collect()
        })
    }

    /// Content of a text array, up to 40 characters; `None` for other arrays.
    pub fn text(&self) -> Option<String> {
        let [field] = self.header.fields.as_slice() else {
            return None;
        };
        let text: String = match field.code.get(..1)? {
            "U" => {
                let characters = self.data().chunks_exact(4).map(|c| {
                    let word = [c[0], c[1], c[2], c[3]];
                    char::from_u32(if field.big_endian {
                        u32::from_be_bytes(word)
                    } else {
                        u32::from_le_bytes(word)
                    })
                });
                characters.flatten().collect()
            }
            "S" => String::from_utf8_lossy(self.data()).into_owned(),
            _ => return None,
        };
        // Some writers converted bytes with `str()`, which gives `b'male'`.
        Some(
            text.trim_matches(['\0', ' ', '\''])
                .trim_start_matches("b'")
                .chars()
                .take(40)
                .collect(),
        )
    }

    fn data(&self) -> &[u8] {
        &self.bytes[self.header.data_at..]
    }

    /// Storage index of the element at `index` in C order.
    fn stored_at(&self, mut index: usize) -> usize {
        if !self.header.fortran {
            return index;
        }
        // The last axis varies fastest in `index`, the first axis in the file.
        let mut stored = 0;
        let mut stride = self.len();
        for dim in self.header.shape.iter().rev().map(|dim| *dim as usize) {
            stride /= dim;
            stored += index % dim * stride;
            index /= dim;
        }
        stored
    }
}

impl Number {
    /// Decodes the number at the start of `bytes`, which must be long enough. Integers above 2^53 are rounded.
    #[inline]
    fn at(self, bytes: &[u8], big_endian: bool) -> f64 {
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
        match self {
            Self::U8 => read!(u8),
            Self::I8 => read!(i8),
            Self::U16 => read!(u16),
            Self::I16 => read!(i16),
            Self::U32 => read!(u32),
            Self::I32 => read!(i32),
            Self::U64 => read!(u64),
            Self::I64 => read!(i64),
            Self::F32 => read!(f32),
            Self::F64 => read!(f64),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Builds an npy file.
    pub fn npy(descr: &str, fortran: &str, shape: &str, data: &[u8]) -> Vec<u8> {
        let text =
            format!("{{'descr': {descr}, 'fortran_order': {fortran}, 'shape': {shape}, }}\n");
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((text.len() as u16).to_le_bytes());
        bytes.extend(text.bytes());
        bytes.extend(data);
        bytes
    }

    #[test]
    fn fortran_order_is_undone() {
        // The array [[[0, 1], [2, 3], [4, 5]], [[6, 7], [8, 9], [10, 11]]] with the first axis fastest.
        let stored = [0, 6, 2, 8, 4, 10, 1, 7, 3, 9, 5, 11];
        let array = npy("'|u1'", "True", "(2, 3, 2)", &stored);
        let found = NpyArray::new(&array).unwrap().numbers().unwrap();
        assert_eq!(found, (0..12).map(f64::from).collect::<Vec<_>>());
        let empty = npy("'|u1'", "True", "(2, 0, 2)", &[]);
        assert_eq!(NpyArray::new(&empty).unwrap().numbers(), Some(vec![]));
    }

    #[test]
    fn every_kind_of_number_is_read_in_either_order() {
        let value = |descr: &str, data: &[u8]| {
            let bytes = npy(descr, "False", "(1,)", data);
            NpyArray::new(&bytes).unwrap().value(0, 0)
        };
        assert_eq!(value("'|b1'", &[1]), 1.0);
        assert_eq!(value("'|i1'", &[0xff]), -1.0);
        assert_eq!(value("'<i2'", &(-2_i16).to_le_bytes()), -2.0);
        assert_eq!(value("'>u2'", &40_000_u16.to_be_bytes()), 40_000.0);
        assert_eq!(value("'>i4'", &(-3_i32).to_be_bytes()), -3.0);
        assert_eq!(value("'<u4'", &u32::MAX.to_le_bytes()), f64::from(u32::MAX));
        assert_eq!(value("'<i8'", &(-4_i64).to_le_bytes()), -4.0);
        assert_eq!(value("'>u8'", &5_u64.to_be_bytes()), 5.0);
        assert_eq!(value("'>f4'", &0.5_f32.to_be_bytes()), 0.5);
        assert_eq!(value("'<f8'", &(-0.25_f64).to_le_bytes()), -0.25);
    }

    #[test]
    fn what_is_no_array_of_numbers_is_refused_with_its_byte() {
        let error = |bytes: &[u8]| NpyArray::new(bytes).unwrap_err();
        let good = npy("'<f4'", "False", "(2, 3)", &[0; 24]);
        for end in 0..good.len() {
            assert!(error(&good[..end]).byte as usize <= end.max(6));
        }
        let pickled = error(&npy("'|O'", "False", "(1,)", b"\x80\x04K\x01."));
        assert!(pickled.is_pickled && pickled.expected.contains("never read"));
        let hidden = error(&npy("[('x', '<f4'), ('y', '|O')]", "False", "(1,)", &[]));
        assert!(hidden.is_pickled);
        for (descr, shape) in [
            ("'<f2'", "(1,)"),
            ("'<c8'", "(1,)"),
            ("'<U4'", "(1,)"),
            ("'<M8[ns]'", "(1,)"),
            ("'f4'", "(1,)"),
            ("'<f4'", "(-1,)"),
            ("'<f4'", "(1.5,)"),
            ("'<f4'", "(4294967296, 4294967296, 4294967296)"),
            ("'|U18446744073709551615'", "(1,)"),
            ("[]", "(1,)"),
        ] {
            assert!(
                NpyArray::new(npy(descr, "False", shape, &[0; 8])).is_err(),
                "{descr} {shape}"
            );
        }
        // A length field of 4 GiB, and unlimited nesting.
        let mut long = b"\x93NUMPY\x02\x00\xff\xff\xff\xff".to_vec();
        long.extend([b' '; 64]);
        assert_eq!(error(&long).byte, 8);
        let deep = npy(&"[".repeat(50_000), "False", "(1,)", &[]);
        assert!(error(&deep).byte < 100);
    }

    #[test]
    fn texts_are_read_and_shortened() {
        let letters: Vec<u8> = "male"
            .chars()
            .flat_map(|c| (c as u32).to_le_bytes())
            .collect();
        let text = |bytes: &[u8]| NpyArray::of_any_type(bytes).unwrap().text();
        assert_eq!(
            text(&npy("'<U4'", "False", "()", &letters)).as_deref(),
            Some("male")
        );
        assert_eq!(
            text(&npy("'|S7'", "False", "()", b"b'male'")).as_deref(),
            Some("male")
        );
        assert_eq!(text(&npy("'|u1'", "False", "()", &[1])), None);
    }
}
