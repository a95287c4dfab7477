//! Numeric arrays of MATLAB v5 files, and recordings of MARS-like points in them.
//!
//! A file is a header of 128 bytes and elements, each a tag (type, length) and data; a variable is an element
//! `miMATRIX` with elements in it, often within a zlib stream (`miCOMPRESSED`). Of classes other than numbers (cells,
//! structures, text, sparse arrays) only the name is read. Source: MathWorks, MAT-File Format, level 5. Version 7.3
//! is HDF5 and is refused.

use std::io::Read;

use flate2::read::ZlibDecoder;

use super::{Axes, Place, RecordedFrame, RecordingError, checked_point};

/// First bytes of a version 5 file.
pub const MAT_MAGIC: &[u8] = b"MATLAB 5.0 MAT-file";
/// First bytes of a version 7.3 file, before its HDF5 part.
pub const MAT_73_MAGIC: &[u8] = b"MATLAB 7.3 MAT-file";
/// First bytes of an HDF5 file without MATLAB's header.
pub const HDF5_MAGIC: &[u8] = b"\x89HDF\r\n";
/// Why version 7.3 is refused, and the way out.
pub const MAT_73_ADVICE: &str = "a MATLAB v7.3 file (HDF5), which is not read: save it again with save(file, 'marsData', '-v7')";
/// Frames per second of recordings that were made as MARS was.
pub const FRAME_RATE_HZ: f64 = 10.0;

/// Name of the variable with the points.
const VARIABLE: &str = "marsData";
/// Smallest number other than 0 that a radar reports: its steps are of the order of a millimetre. Bytes read at the
/// wrong place give such numbers half of the time.
const MIN_MAGNITUDE: f64 = 1e-15;
const HEADER_BYTES: usize = 128;
/// Maximum length of an inflated variable, bytes: 50,000 frames of 64 points of 5 f32, 80 minutes.
const MAX_INFLATED_BYTES: u64 = 64 << 20;
/// Maximum number of variables looked at.
const MAX_VARIABLES: usize = 1000;
/// Maximum number of dimensions of an array.
const MAX_DIMENSIONS: usize = 8;
/// Maximum length of a variable's name, bytes: MATLAB itself allows 63.
const MAX_NAME_BYTES: usize = 255;
/// Values of a point: x, y, z, velocity, SNR.
const POINT_VALUES: usize = 5;
/// Points of a frame, empty ones included.
const FRAME_POINTS: usize = 64;

const MI_INT8: u32 = 1;
const MI_INT32: u32 = 5;
const MI_UINT32: u32 = 6;
const MI_MATRIX: u32 = 14;
const MI_COMPRESSED: u32 = 15;
/// Flag of complex arrays, in the array flags.
const FLAG_COMPLEX: u32 = 0x0800;
/// double to uint64, in the array flags.
const NUMERIC_CLASSES: std::ops::RangeInclusive<u32> = 6..=15;
/// Last class of version 5; later ones have another head.
const LAST_CLASS: u32 = 15;
/// Bytes of a compressed variable that hold its head: flags, dimensions and name.
const HEAD_BYTES: u64 = 1024;

/// Reads a number from its bytes; true for big-endian.
type ReadNumber = fn(&[u8], bool) -> f64;

/// A numeric array.
#[derive(Clone, Debug, PartialEq)]
pub struct MatArray {
    /// Lengths of the dimensions.
    pub shape: Vec<usize>,
    /// Values with the **first** index fastest, as MATLAB stores them.
    pub values: Vec<f64>,
}

/// Reads one numeric, real array by its name.
///
/// # Errors
/// [`RecordingError`] with the byte: no version 5 file, a damaged or cut element, an array that is not real numbers, no
/// variable of that name (the message lists those that there are).
pub fn read_mat_array(bytes: &[u8], name: &str) -> Result<MatArray, RecordingError> {
    let is_big_endian = is_big_endian(bytes)?;
    let mut names = Vec::new();
    let mut file = Elements {
        bytes,
        at: HEADER_BYTES,
        origin: Origin::File(0),
        is_big_endian,
    };
    while let Some(element) = file.advance()? {
        if names.len() == MAX_VARIABLES {
            let expected = format!("at most {MAX_VARIABLES} variables");
            let place = Place::Byte(element.at as u64);
            return Err(RecordingError::new(place, expected, "more"));
        }
        match element.kind {
            MI_MATRIX => {
                let origin = Origin::File(element.at);
                let head = MatrixHead::read(element.data, origin, is_big_endian)?;
                if head.name != name {
                    names.push(head.name);
                    continue;
                }
                let start = head.len.min(element.data.len());
                let origin = Origin::File(element.at + start);
                return head.values(&element.data[start..], origin, is_big_endian);
            }
            MI_COMPRESSED => match inflated(&element, name, is_big_endian)? {
                Ok(array) => return Ok(array),
                Err(other) => names.push(other),
            },
            // Anything else on the top level is no variable.
            _ => {}
        }
    }
    Err(RecordingError::new(
        Place::Byte(bytes.len() as u64),
        format!("a variable `{name}`"),
        &names.join(", "),
    ))
}

/// Points of a file.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct MatlabRecording {
    /// Frames; they count from 0 and have no clock: [`FRAME_RATE_HZ`] of them a second.
    pub frames: Vec<RecordedFrame>,
    /// Rows dropped because a torn packet left no numbers of a radar in them.
    pub points_dropped: u64,
    /// Frames with such rows.
    pub frames_damaged: u64,
    /// What a user should know about it.
    pub notes: Vec<String>,
}

/// Reads points as MARS-like recorders store them: variable `marsData` of shape (frames, 64, 5), the last axis x, y, z
/// in m (right, away from the radar, up), velocity in m/s and SNR in dB. Rows of five zeros are empty.
///
/// Such recorders do not notice when the serial port loses bytes: the rest of the packet is then read at the wrong
/// place. So the first row with a value that is not finite, out of range or next to nothing (but not 0) ends the points
/// of its frame, and what is dropped is counted.
///
/// # Errors
/// As [`read_mat_array`]; another shape.
pub fn read_matlab_points(bytes: &[u8]) -> Result<MatlabRecording, RecordingError> {
    let array = read_mat_array(bytes, VARIABLE)?;
    let &[n_frames, FRAME_POINTS, POINT_VALUES] = array.shape.as_slice() else {
        return Err(RecordingError::new(
            Place::Byte(0),
            format!("`{VARIABLE}` of shape (frames, {FRAME_POINTS}, {POINT_VALUES})"),
            &format!("{:?}", array.shape),
        ));
    };
    let value = |frame: usize, place: usize, k: usize| {
        array.values[frame + n_frames * (place + FRAME_POINTS * k)]
    };
    let mut recording = MatlabRecording::default();
    let mut first_damaged = None;
    for frame in 0..n_frames {
        let mut points = Vec::new();
        let mut n_dropped = 0;
        for place in 0..FRAME_POINTS {
            let values: [f64; POINT_VALUES] = std::array::from_fn(|k| value(frame, place, k));
            if values == [0.0; POINT_VALUES] {
                continue;
            }
            let is_tiny = values.iter().any(|v| *v != 0.0 && v.abs() < MIN_MAGNITUDE);
            match checked_point(Place::Row(frame), Axes::RightForwardUp, values) {
                Ok(point) if n_dropped == 0 && !is_tiny => points.push(point),
                _ => n_dropped += 1,
            }
        }
        if n_dropped > 0 {
            recording.points_dropped += n_dropped;
            recording.frames_damaged += 1;
            first_damaged.get_or_insert(frame);
        }
        recording.frames.push(RecordedFrame {
            number: frame as u64,
            stamp_s: None,
            points,
        });
    }
    if let Some(frame) = first_damaged {
        recording.notes.push(format!(
            "torn packets in {} frames, the first in frame {frame}: {} rows after the tear are dropped",
            recording.frames_damaged, recording.points_dropped
        ));
    }
    Ok(recording)
}

/// Checks the header; true for a file of a big-endian machine.
fn is_big_endian(bytes: &[u8]) -> Result<bool, RecordingError> {
    let error =
        |expected: &str, found: &str| Err(RecordingError::new(Place::Byte(0), expected, found));
    if bytes.starts_with(MAT_73_MAGIC) || bytes.starts_with(HDF5_MAGIC) {
        return Err(RecordingError {
            at: Place::Byte(0),
            expected: "a MATLAB v5 file".into(),
            found: MAT_73_ADVICE.into(),
        });
    }
    let Some(header) = bytes.get(..HEADER_BYTES) else {
        return error(
            "a MATLAB v5 file with a header of 128 bytes",
            &format!("{} bytes", bytes.len()),
        );
    };
    if !header.starts_with(b"MATLAB 5.0") {
        let start = String::from_utf8_lossy(&header[..19]);
        return error(
            "a MATLAB v5 file, which starts with `MATLAB 5.0 MAT-file`",
            &start,
        );
    }
    match &header[124..] {
        // Version 0x0100, then "MI" written as a 16-bit word.
        [_, 1, b'I', b'M'] => Ok(false),
        [1, _, b'M', b'I'] => Ok(true),
        _ => error("version 1 and an endian mark in the header", "others"),
    }
}

/// Where bytes come from, for places in errors.
#[derive(Clone, Copy)]
enum Origin {
    /// From this byte of the file on.
    File(usize),
    /// A compressed element at this byte of the file.
    Compressed(usize),
}

impl Origin {
    fn place(self, at: usize) -> Place {
        Place::Byte(match self {
            Self::File(start) => start.saturating_add(at) as u64,
            Self::Compressed(start) => start as u64,
        })
    }
}

struct Element<'a> {
    kind: u32,
    data: &'a [u8],
    /// Byte of the file at which `data` starts.
    at: usize,
}

/// Walks over elements that follow each other.
struct Elements<'a> {
    bytes: &'a [u8],
    at: usize,
    origin: Origin,
    is_big_endian: bool,
}

impl<'a> Elements<'a> {
    /// The next element; `None` at the end.
    fn advance(&mut self) -> Result<Option<Element<'a>>, RecordingError> {
        let Some(rest) = self.bytes.get(self.at..).filter(|r| !r.is_empty()) else {
            return Ok(None);
        };
        let place = self.origin.place(self.at);
        let cut = |n: usize| {
            let found = format!("{} bytes", rest.len());
            RecordingError::new(place, format!("an element of {n} bytes"), &found)
        };
        let tag = rest.get(..8).ok_or_else(|| cut(8))?;
        let word = u32_at(tag, 0, self.is_big_endian);
        // Up to four bytes of data lie in the tag itself; the upper half of its first word is their number then.
        let (kind, start, len): (u32, usize, usize) = match word >> 16 {
            0 => (word, 8, u32_at(tag, 4, self.is_big_endian) as usize),
            n => (word & 0xffff, 4, n as usize),
        };
        if start == 4 && len > 4 {
            let found = len.to_string();
            return Err(RecordingError::new(
                place,
                "at most 4 bytes in a tag",
                &found,
            ));
        }
        let end = start.saturating_add(len);
        let data = rest.get(start..end).ok_or_else(|| cut(end))?;
        let at = self.at + start;
        // Data are padded to 8 bytes, but for compressed ones.
        let padded = match kind {
            MI_COMPRESSED => end,
            _ => end.next_multiple_of(8),
        };
        self.at = self.at.saturating_add(padded);
        Ok(Some(Element { kind, data, at }))
    }

    /// The next element, which must be there.
    fn expect(&mut self, what: &str) -> Result<Element<'a>, RecordingError> {
        let place = self.origin.place(self.at);
        self.advance()?
            .ok_or_else(|| RecordingError::new(place, what, "the end"))
    }
}

/// What stands before the values of a variable.
struct MatrixHead {
    name: String,
    class: u32,
    is_complex: bool,
    shape: Vec<usize>,
    /// Length of the head, bytes.
    len: usize,
}

impl MatrixHead {
    fn read(bytes: &[u8], origin: Origin, is_big_endian: bool) -> Result<Self, RecordingError> {
        let mut elements = Elements {
            bytes,
            at: 0,
            origin,
            is_big_endian,
        };
        let error = |expected: &str, found: &str| {
            Err(RecordingError::new(origin.place(0), expected, found))
        };
        let flags = elements.expect("array flags")?;
        if flags.kind != MI_UINT32 || flags.data.len() != 8 {
            return error(
                "array flags, 8 bytes",
                &format!("{} bytes", flags.data.len()),
            );
        }
        let flags = u32_at(flags.data, 0, is_big_endian);
        let class = flags & 0xff;
        if class > LAST_CLASS {
            // Objects of later versions have no dimensions here.
            return Ok(Self {
                name: "(an object)".into(),
                class,
                is_complex: false,
                shape: Vec::new(),
                len: 0,
            });
        }
        let dimensions = elements.expect("dimensions")?;
        let n = dimensions.data.len() / 4;
        if dimensions.kind != MI_INT32 || !(2..=MAX_DIMENSIONS).contains(&n) {
            return error("2 to 8 dimensions", &n.to_string());
        }
        let shape = (0..n)
            .map(|i| u32_at(dimensions.data, 4 * i, is_big_endian) as usize)
            .collect();
        let name = elements.expect("a name")?;
        if name.kind != MI_INT8 || name.data.len() > MAX_NAME_BYTES {
            return error(
                "a name of up to 255 bytes",
                &format!("{} bytes", name.data.len()),
            );
        }
        Ok(Self {
            name: String::from_utf8_lossy(name.data).into_owned(),
            class,
            is_complex: flags & FLAG_COMPLEX != 0,
            shape,
            len: elements.at,
        })
    }

    /// The values of a real numeric array, from the bytes behind the head.
    fn values(
        self,
        bytes: &[u8],
        origin: Origin,
        is_big_endian: bool,
    ) -> Result<MatArray, RecordingError> {
        let error = |expected: &str, found: &str| {
            Err(RecordingError::new(origin.place(0), expected, found))
        };
        if !NUMERIC_CLASSES.contains(&self.class) || self.is_complex {
            let found = match (self.class, self.is_complex) {
                (1, _) => "a cell array",
                (2 | 3, _) => "a structure or an object",
                (4, _) => "text",
                (5, _) => "a sparse array",
                (_, true) => "complex numbers",
                _ => "another class",
            };
            return error("an array of real numbers", found);
        }
        let mut elements = Elements {
            bytes,
            at: 0,
            origin,
            is_big_endian,
        };
        let part = elements.expect("values")?;
        // The numbers may be stored in a smaller type than the array's, if they fit.
        let (width, read): (usize, ReadNumber) = match part.kind {
            1 => (1, |b, _| f64::from(b[0] as i8)),
            2 => (1, |b, _| f64::from(b[0])),
            3 => (2, |b, e| f64::from(word(b, e) as u16 as i16)),
            4 => (2, |b, e| word(b, e) as f64),
            5 => (4, |b, e| f64::from(word(b, e) as u32 as i32)),
            6 => (4, |b, e| word(b, e) as f64),
            7 => (4, |b, e| f64::from(f32::from_bits(word(b, e) as u32))),
            9 => (8, |b, e| f64::from_bits(word(b, e))),
            12 => (8, |b, e| word(b, e) as i64 as f64),
            13 => (8, |b, e| word(b, e) as f64),
            kind => return error("values of a numeric type", &format!("type {kind}")),
        };
        let n = self
            .shape
            .iter()
            .try_fold(1_usize, |n, d| n.checked_mul(*d));
        if n.and_then(|n| n.checked_mul(width)) != Some(part.data.len()) {
            let expected = format!("values of an array of {:?}", self.shape);
            return error(&expected, &format!("{} bytes", part.data.len()));
        }
        let values = part.data.chunks_exact(width);
        Ok(MatArray {
            values: values.map(|bytes| read(bytes, is_big_endian)).collect(),
            shape: self.shape,
        })
    }
}

/// The array of that name in a compressed element, or the name of another one. Only the wanted one is inflated whole.
fn inflated(
    element: &Element<'_>,
    name: &str,
    is_big_endian: bool,
) -> Result<Result<MatArray, String>, RecordingError> {
    let origin = Origin::Compressed(element.at);
    let error =
        |expected: &str, found: &str| Err(RecordingError::new(origin.place(0), expected, found));
    let mut decoder = ZlibDecoder::new(element.data);
    let mut bytes = Vec::new();
    let mut inflate = |bytes: &mut Vec<u8>, limit: u64| {
        (&mut decoder)
            .take(limit)
            .read_to_end(bytes)
            .map_err(|e| RecordingError::new(origin.place(0), "zlib data", &e.to_string()))
    };
    inflate(&mut bytes, HEAD_BYTES)?;
    if bytes.len() < 8 {
        return error("a compressed variable", &format!("{} bytes", bytes.len()));
    }
    let (kind, stated) = (
        u32_at(&bytes, 0, is_big_endian),
        u32_at(&bytes, 4, is_big_endian),
    );
    if kind != MI_MATRIX {
        return error(
            "a compressed variable",
            &format!("an element of type {kind}"),
        );
    }
    let head = MatrixHead::read(&bytes[8..], origin, is_big_endian)?;
    if head.name != name {
        return Ok(Err(head.name));
    }
    if u64::from(stated) > MAX_INFLATED_BYTES {
        return error("a variable of at most 64 MiB", &format!("{stated} bytes"));
    }
    inflate(&mut bytes, u64::from(stated).saturating_sub(HEAD_BYTES) + 8)?;
    let at = 8 + head.len;
    match bytes.get(at..) {
        Some(rest) => head.values(rest, origin, is_big_endian).map(Ok),
        None => error("values", "the end"),
    }
}

fn u32_at(bytes: &[u8], at: usize, is_big_endian: bool) -> u32 {
    bytes
        .get(at..at.saturating_add(4))
        .map_or(0, |b| word(b, is_big_endian) as u32)
}

/// An unsigned number of up to eight bytes.
fn word(bytes: &[u8], is_big_endian: bool) -> u64 {
    let add = |sum: u64, byte: &u8| sum << 8 | u64::from(*byte);
    match is_big_endian {
        true => bytes.iter().fold(0, add),
        false => bytes.iter().rev().fold(0, add),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An element, padded.
    fn element(kind: u32, data: &[u8], is_big_endian: bool) -> Vec<u8> {
        let mut bytes = words(&[kind, data.len() as u32], is_big_endian);
        bytes.extend(data);
        bytes.resize(bytes.len().next_multiple_of(8), 0);
        bytes
    }

    fn words(values: &[u32], is_big_endian: bool) -> Vec<u8> {
        let bytes = |v: &u32| match is_big_endian {
            true => v.to_be_bytes(),
            false => v.to_le_bytes(),
        };
        values.iter().flat_map(bytes).collect()
    }

    fn header(is_big_endian: bool) -> Vec<u8> {
        let mut bytes = b"MATLAB 5.0 MAT-file, made by a test".to_vec();
        bytes.resize(124, b' ');
        bytes.extend(match is_big_endian {
            true => b"\x01\x00MI",
            false => b"\x00\x01IM",
        });
        bytes
    }

    /// A matrix element with a name in the long form.
    fn matrix(name: &str, class: u32, shape: &[u32], values: &[u8], be: bool) -> Vec<u8> {
        let data = [
            element(MI_UINT32, &words(&[class, 0], be), be),
            element(MI_INT32, &words(shape, be), be),
            element(MI_INT8, name.as_bytes(), be),
            values.to_vec(),
        ];
        element(MI_MATRIX, &data.concat(), be)
    }

    #[test]
    fn numbers_of_every_type_and_both_byte_orders_are_read() {
        let cases: [(u32, Vec<u8>, Vec<u8>); 6] = [
            (1, vec![1, 0xfe], vec![1, 0xfe]),
            (3, vec![1, 0, 0xfe, 0xff], vec![0, 1, 0xff, 0xfe]),
            (
                5,
                vec![1, 0, 0, 0, 0xfe, 0xff, 0xff, 0xff],
                vec![0, 0, 0, 1, 0xff, 0xff, 0xff, 0xfe],
            ),
            (
                7,
                [1_f32, -2.0].iter().flat_map(|v| v.to_le_bytes()).collect(),
                [1_f32, -2.0].iter().flat_map(|v| v.to_be_bytes()).collect(),
            ),
            (
                9,
                [1_f64, -2.0].iter().flat_map(|v| v.to_le_bytes()).collect(),
                [1_f64, -2.0].iter().flat_map(|v| v.to_be_bytes()).collect(),
            ),
            (
                12,
                [1_i64, -2].iter().flat_map(|v| v.to_le_bytes()).collect(),
                [1_i64, -2].iter().flat_map(|v| v.to_be_bytes()).collect(),
            ),
        ];
        for (kind, little, big) in cases {
            for (be, data) in [(false, little), (true, big)] {
                let x = matrix("x", 6, &[1, 2], &element(kind, &data, be), be);
                let file = [header(be), x].concat();
                let array = read_mat_array(&file, "x").unwrap();
                assert_eq!(
                    (array.shape, array.values),
                    (vec![1, 2], vec![1.0, -2.0]),
                    "{kind}"
                );
            }
        }
    }

    /// Names and values of up to four bytes lie in the tag.
    #[test]
    fn short_elements_are_read() {
        let data = [
            element(MI_UINT32, &words(&[6, 0], false), false),
            element(MI_INT32, &words(&[1, 3], false), false),
            vec![1, 0, 1, 0, b'x', 0, 0, 0],
            vec![2, 0, 3, 0, 7, 8, 9, 0],
        ];
        let file = [header(false), element(MI_MATRIX, &data.concat(), false)].concat();
        assert_eq!(read_mat_array(&file, "x").unwrap().values, [7.0, 8.0, 9.0]);
    }

    #[test]
    fn what_is_no_array_of_real_numbers_is_named() {
        let text = element(4, &[0, 65], false);
        let of = |class, name: &str| {
            let file = [
                header(false),
                matrix("marsData", class, &[1, 1], &text, false),
            ]
            .concat();
            read_mat_array(&file, name).unwrap_err()
        };
        assert!(of(4, "marsData").to_string().contains("text"));
        assert!(of(1, "marsData").to_string().contains("a cell array"));
        assert!(
            of(6 | FLAG_COMPLEX, "marsData")
                .to_string()
                .contains("complex")
        );
        let error = of(6, "other");
        assert!(
            error.expected.contains("`other`") && error.found.contains("marsData"),
            "{error}"
        );
        // An object of a later version is passed over.
        assert!(of(17, "marsData").found.contains("(an object)"));
    }

    #[test]
    fn other_versions_and_kinds_are_refused_with_the_way_out() {
        let mut hdf5 = MAT_73_MAGIC.to_vec();
        hdf5.resize(600, 0);
        for bytes in [hdf5, b"\x89HDF\r\n\x1a\n".to_vec()] {
            let error = read_matlab_points(&bytes).unwrap_err();
            assert!(error.to_string().contains("'-v7'"), "{error}");
        }
        for bytes in [&b""[..], b"MATLAB", &[0; 128], &[b' '; 200]] {
            assert!(read_matlab_points(bytes).is_err());
        }
        let mut version = header(false);
        version[125] = 2;
        assert!(read_matlab_points(&version).is_err());
    }
}
