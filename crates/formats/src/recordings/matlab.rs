//! Numeric arrays of MATLAB files, and recordings of MARS and of MARS-like recorders in them.
//!
//! A file consists of a header of 128 bytes and elements, each of which has a tag (type, length) and data. A variable
//! is an element `miMATRIX` that contains further elements; it is often compressed as a zlib stream (`miCOMPRESSED`).
//! Variables that are not numeric (cells, structures, text, sparse arrays) are skipped; only their names are read.
//! Source: MathWorks, MAT-File Format, level 5.
//!
//! Version 7.3 is HDF5 with a header of MATLAB. Its variables are the data sets of the root group, with the dimensions in
//! reverse order. It is read with the feature `hdf5` of this crate and refused without it.

use std::io::Read;

use flate2::read::ZlibDecoder;

use super::{
    Axes, Place, RecordedFrame, RecordingError, checked_point,
    mars::{peak_db, push_point},
};

/// Start of a version 5 file.
pub const MAT_MAGIC: &[u8] = b"MATLAB 5.0 MAT-file";
/// Start of a version 7.3 file, which is followed by its HDF5 part.
pub const MAT_73_MAGIC: &[u8] = b"MATLAB 7.3 MAT-file";
/// Start of an HDF5 file without MATLAB's header.
pub const HDF5_MAGIC: &[u8] = b"\x89HDF\r\n";
/// Error text for version 7.3 without the feature `hdf5`, with the lines that convert a file.
pub const MAT_73_ADVICE: &str = "a MATLAB v7.3 file (HDF5), which this build does not read. MATLAB converts it: s = \
    load('FILE.mat'); save('FILE-v7.mat', '-struct', 's', '-v7'). So does Python: scipy.io.savemat('FILE-v7.mat', {k: v[()].T \
    for k, v in h5py.File('FILE.mat').items() if isinstance(v, h5py.Dataset)})";
/// Frame rate of recordings made like those of MARS.
pub const FRAME_RATE_HZ: f64 = 10.0;

/// Name of the variable that contains the points.
const VARIABLE: &str = "marsData";
/// Name of the variable in the files of MARS itself.
const MARS_VARIABLE: &str = "radar_data_cropped";
/// Number of columns of [`MARS_VARIABLE`]: frame, points of the frame, x, y, z, velocity, peak, time.
const MARS_COLUMNS: usize = 8;
/// Smaller non-zero magnitudes are implausible, because the resolution of a radar is of the order of a millimetre.
/// About half of the numbers that are read at a wrong offset are smaller.
const MIN_MAGNITUDE: f64 = 1e-15;
const HEADER_BYTES: usize = 128;
/// Maximum size of a decompressed variable, bytes: 50,000 frames of 64 points of 5 f32, 80 minutes.
const MAX_INFLATED_BYTES: u64 = 64 << 20;
/// Maximum number of variables in a file.
const MAX_VARIABLES: usize = 1000;
/// Maximum number of dimensions of an array.
const MAX_DIMENSIONS: usize = 8;
/// Maximum length of a variable name, bytes. MATLAB itself allows 63.
const MAX_NAME_BYTES: usize = 255;
/// Number of values of a point: x, y, z, velocity, SNR.
const POINT_VALUES: usize = 5;
/// Number of points of a frame, including empty ones.
const FRAME_POINTS: usize = 64;

const MI_INT8: u32 = 1;
const MI_INT32: u32 = 5;
const MI_UINT32: u32 = 6;
const MI_MATRIX: u32 = 14;
const MI_COMPRESSED: u32 = 15;
/// Bit of the array flags that marks complex arrays.
const FLAG_COMPLEX: u32 = 0x0800;
/// Numeric classes in the array flags, from double to uint64.
const NUMERIC_CLASSES: std::ops::RangeInclusive<u32> = 6..=15;
/// Last class of version 5. Later classes have a different header.
const LAST_CLASS: u32 = 15;
/// Number of decompressed bytes that contain the header of a variable: flags, dimensions and name.
const HEAD_BYTES: u64 = 1024;

/// Decodes a number from its bytes; the flag is true for big-endian.
type ReadNumber = fn(&[u8], bool) -> f64;

/// A numeric array.
#[derive(Clone, Debug, PartialEq)]
pub struct MatArray {
    /// Length of each dimension.
    pub shape: Vec<usize>,
    /// Values with the **first** index fastest, as in MATLAB.
    pub values: Vec<f64>,
}

/// Reads a real numeric array by its name.
///
/// # Errors
/// [`RecordingError`] with the byte offset: neither a version 5 nor a version 7.3 file, a damaged or truncated element, an
/// array that is not real and numeric, or no variable of this name (the message lists the existing ones).
pub fn read_mat_array(bytes: &[u8], name: &str) -> Result<MatArray, RecordingError> {
    #[cfg(feature = "hdf5")]
    if bytes.starts_with(MAT_73_MAGIC) || bytes.starts_with(HDF5_MAGIC) {
        return hdf5::read_array(bytes, name);
    }
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
            // Other top-level elements are not variables.
            _ => {}
        }
    }
    Err(RecordingError::new(
        Place::Byte(bytes.len() as u64),
        format!("a variable `{name}`"),
        &names.join(", "),
    ))
}

/// Points of a MATLAB file.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct MatlabRecording {
    /// Frames, numbered from 0 and without time stamps. The frame rate is [`FRAME_RATE_HZ`].
    pub frames: Vec<RecordedFrame>,
    /// Number of rows dropped because a truncated packet left implausible numbers in them.
    pub points_dropped: u64,
    /// Number of frames with such rows.
    pub frames_damaged: u64,
    /// Notes for the user.
    pub notes: Vec<String>,
    /// Whether it is a file of the data set MARS.
    pub is_mars: bool,
}

/// Reads points in the format of MARS-like recorders: a variable `marsData` of shape (frames, 64, 5), whose last axis
/// contains x, y, z in m (right, away from the radar, up), velocity in m/s and SNR in dB. Rows of five zeros are empty.
///
/// Such recorders do not notice when the serial port loses bytes; the rest of the packet is then read at a wrong
/// offset. The first row with a value that is not finite, out of range, or non-zero but implausibly small therefore
/// ends the points of its frame. Dropped rows are counted.
///
/// Without such a variable, one named `radar_data_cropped` is read as in the files of MARS: of shape (points, 8), with the
/// columns of [`super::read_mars_points`] and frames of equal numbers.
///
/// # Errors
/// As [`read_mat_array`]; also for another shape, and for a value of MARS out of range.
pub fn read_matlab_points(bytes: &[u8]) -> Result<MatlabRecording, RecordingError> {
    let array = match read_mat_array(bytes, VARIABLE) {
        Ok(array) => array,
        Err(error) => match read_mat_array(bytes, MARS_VARIABLE) {
            Ok(array) => return mars_recording(&array),
            Err(_) => return Err(error),
        },
    };
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
            board: None,
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

/// The points of MARS in a matrix of [`MARS_COLUMNS`] columns.
fn mars_recording(array: &MatArray) -> Result<MatlabRecording, RecordingError> {
    let &[n_points, MARS_COLUMNS] = array.shape.as_slice() else {
        return Err(RecordingError::new(
            Place::Byte(0),
            format!("`{MARS_VARIABLE}` of shape (points, {MARS_COLUMNS})"),
            &format!("{:?}", array.shape),
        ));
    };
    let mut frames: Vec<RecordedFrame> = Vec::new();
    for row in 0..n_points {
        let value = |column: usize| array.values[row + n_points * column];
        let frame = value(0);
        // Whole numbers up to 2^53 are exact.
        if !(0.0..=9e15).contains(&frame) || frame.fract() != 0.0 {
            let (place, found) = (Place::Row(row), frame.to_string());
            return Err(RecordingError::new(place, "a frame number", &found));
        }
        let [x, y, z, velocity_mps, peak] = std::array::from_fn(|k| value(k + 2));
        let values = [x, y, z, velocity_mps, peak_db(peak)];
        let point = checked_point(Place::Row(row), Axes::RightForwardUp, values)?;
        push_point(&mut frames, frame as u64, point);
    }
    Ok(MatlabRecording {
        frames,
        is_mars: true,
        ..MatlabRecording::default()
    })
}

/// Variables of version 7.3.
#[cfg(feature = "hdf5")]
mod hdf5 {
    use hdf5_pure::File;

    use super::{MAX_DIMENSIONS, MAX_INFLATED_BYTES, MAX_VARIABLES, MatArray};
    use crate::recordings::{Place, RecordingError};

    fn error(expected: impl Into<String>, found: &str) -> RecordingError {
        RecordingError::new(Place::Byte(0), expected, found)
    }

    /// A real numeric array by its name.
    pub(super) fn read_array(bytes: &[u8], name: &str) -> Result<MatArray, RecordingError> {
        let damaged = |e: hdf5_pure::Error| {
            let expected = "a whole MATLAB v7.3 file (HDF5)";
            error(expected, &e.to_string())
        };
        let file = File::from_bytes(bytes.to_vec()).map_err(damaged)?;
        let names = file.root().datasets().map_err(damaged)?;
        if names.len() > MAX_VARIABLES {
            let expected = format!("at most {MAX_VARIABLES} variables");
            return Err(error(expected, &names.len().to_string()));
        }
        if !names.iter().any(|n| n == name) {
            return Err(error(format!("a variable `{name}`"), &names.join(", ")));
        }
        let data = file.dataset(name).map_err(damaged)?;
        let dimensions = data.shape().map_err(damaged)?;
        let size = |n: usize, d: &u64| n.checked_mul(usize::try_from(*d).ok()?);
        let n_values = dimensions.iter().try_fold(1_usize, size);
        let max_values = (MAX_INFLATED_BYTES / size_of::<f64>() as u64) as usize;
        let n_values = n_values.filter(|n| *n <= max_values && dimensions.len() <= MAX_DIMENSIONS);
        let Some(n_values) = n_values else {
            let expected = format!(
                "`{name}` of at most {max_values} values in at most {MAX_DIMENSIONS} dimensions"
            );
            return Err(error(expected, &format!("{dimensions:?}")));
        };
        let not_numeric = |e: hdf5_pure::Error| {
            error(
                format!("`{name}` as a whole array of real numbers"),
                &e.to_string(),
            )
        };
        let values = data.read_f64().map_err(not_numeric)?;
        if values.len() != n_values {
            let expected = format!("{n_values} values of `{name}`");
            return Err(error(expected, &values.len().to_string()));
        }
        // MATLAB counts dimensions from the fastest one, HDF5 from the slowest.
        let shape = dimensions.iter().rev().map(|d| *d as usize).collect();
        Ok(MatArray { shape, values })
    }
}

/// Checks the header. Returns true if the file is big-endian.
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
        // Version 0x0100, followed by "MI" as a 16-bit word.
        [_, 1, b'I', b'M'] => Ok(false),
        [1, _, b'M', b'I'] => Ok(true),
        _ => error("version 1 and an endian mark in the header", "others"),
    }
}

/// Origin of bytes, for positions in errors.
#[derive(Clone, Copy)]
enum Origin {
    /// The bytes start at this offset of the file.
    File(usize),
    /// The bytes were decompressed from the element at this offset of the file.
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
    /// Offset of `data` in the file.
    at: usize,
}

/// Iterates over consecutive elements.
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
        // Data of up to four bytes are stored in the tag itself. In that case, the upper half of its first word is
        // their length.
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
        // All elements except compressed ones are padded to 8 bytes.
        let padded = match kind {
            MI_COMPRESSED => end,
            _ => end.next_multiple_of(8),
        };
        self.at = self.at.saturating_add(padded);
        Ok(Some(Element { kind, data, at }))
    }

    /// Returns the next element; an error if there is none.
    fn expect(&mut self, what: &str) -> Result<Element<'a>, RecordingError> {
        let place = self.origin.place(self.at);
        self.advance()?
            .ok_or_else(|| RecordingError::new(place, what, "the end"))
    }
}

/// Header of a variable, which precedes its values.
struct MatrixHead {
    name: String,
    class: u32,
    is_complex: bool,
    shape: Vec<usize>,
    /// Length of the header, bytes.
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
            // Objects of later versions have no dimensions at this position.
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

    /// Reads the values of a real numeric array from the bytes after the header.
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
        // MATLAB stores numbers in a smaller type than that of the array if they fit.
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

/// The array in a compressed element if it has the requested name, and otherwise the name. Only the requested array is
/// decompressed completely.
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

/// Decodes an unsigned number of up to eight bytes.
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

    /// Builds a padded element.
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

    /// Builds a matrix element whose name is not stored in the tag.
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

    /// Names and values of up to four bytes are stored in the tag.
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
        // An object of a later version is skipped.
        assert!(of(17, "marsData").found.contains("(an object)"));
    }

    #[test]
    fn other_versions_and_kinds_are_refused_with_the_way_out() {
        let mut hdf5 = MAT_73_MAGIC.to_vec();
        hdf5.resize(600, 0);
        for bytes in [hdf5, b"\x89HDF\r\n\x1a\n".to_vec()] {
            let error = read_matlab_points(&bytes).unwrap_err();
            let way_out = match cfg!(feature = "hdf5") {
                true => "a whole MATLAB v7.3 file",
                false => "'-v7'",
            };
            assert!(error.to_string().contains(way_out), "{error}");
        }
        for bytes in [&b""[..], b"MATLAB", &[0; 128], &[b' '; 200]] {
            assert!(read_matlab_points(bytes).is_err());
        }
        let mut version = header(false);
        version[125] = 2;
        assert!(read_matlab_points(&version).is_err());
    }
}
