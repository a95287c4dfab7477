//! Writes npy arrays element by element.

use std::io::{self, Write};

use super::NPY_MAGIC;

/// Size after which buffered elements are written, bytes.
const CHUNK_BYTES: usize = 1 << 16;
/// NumPy aligns the data to this many bytes.
const ALIGNMENT: usize = 64;

/// A type of elements.
pub trait NpyElement: Copy {
    /// NumPy's notation of the type.
    const DESCR: &'static str;

    /// Appends the bytes of the element.
    fn push(self, bytes: &mut Vec<u8>);
}

macro_rules! element {
    ($type:ty, $descr:literal) => {
        impl NpyElement for $type {
            const DESCR: &'static str = $descr;

            fn push(self, bytes: &mut Vec<u8>) {
                bytes.extend(self.to_le_bytes());
            }
        }
    };
}

element!(f32, "<f4");
element!(f64, "<f8");
element!(i32, "<i4");
element!(i64, "<i8");
element!(u32, "<u4");

/// A complex number: real and imaginary part.
impl NpyElement for [f32; 2] {
    const DESCR: &'static str = "<c8";

    fn push(self, bytes: &mut Vec<u8>) {
        self.into_iter().for_each(|part| part.push(bytes));
    }
}

/// Writes one array in C order, version 1.0, as `numpy.save` does. The number of elements is compared with the shape.
///
/// ```
/// use radarllm_files::npy::{NpyArray, NpyWriter};
///
/// let mut bytes = Vec::new();
/// let mut writer = NpyWriter::new(&mut bytes, &[2, 2])?;
/// writer.extend([1.0_f32, 2.0, 3.0, 4.0])?;
/// writer.finish()?;
/// assert_eq!(NpyArray::new(&bytes).unwrap().value(2, 0), 3.0);
/// # Ok::<(), std::io::Error>(())
/// ```
#[derive(Debug)]
pub struct NpyWriter<W, T> {
    sink: W,
    buffer: Vec<u8>,
    n_missing: u64,
    element: std::marker::PhantomData<T>,
}

impl<W: Write, T: NpyElement> NpyWriter<W, T> {
    /// Starts an array of a shape.
    ///
    /// # Errors
    /// Errors of the sink; a shape of more elements or dimensions than a file can have.
    pub fn new(sink: W, shape: &[usize]) -> io::Result<Self> {
        let too_large =
            || io::Error::other(format!("an npy array cannot have the shape {shape:?}"));
        let n = shape
            .iter()
            .try_fold(1_u64, |n, side| n.checked_mul(u64::try_from(*side).ok()?));
        let n_missing = n.ok_or_else(too_large)?;
        let sides: Vec<String> = shape.iter().map(ToString::to_string).collect();
        // A tuple of one element needs a comma.
        let comma = if sides.len() == 1 { "," } else { "" };
        let text = format!(
            "{{'descr': '{}', 'fortran_order': False, 'shape': ({}{comma}), }}",
            T::DESCR,
            sides.join(", "),
        );
        // Magic, version and length are 10 bytes, the line end is one.
        let header_bytes = (11 + text.len()).next_multiple_of(ALIGNMENT) - 10;
        let length = u16::try_from(header_bytes).map_err(|_| too_large())?;
        let mut buffer = NPY_MAGIC.to_vec();
        buffer.extend([1, 0]);
        buffer.extend(length.to_le_bytes());
        buffer.extend(format!("{text:<width$}\n", width = header_bytes - 1).bytes());
        Ok(Self {
            sink,
            buffer,
            n_missing,
            element: std::marker::PhantomData,
        })
    }

    /// Writes elements in C order.
    ///
    /// # Errors
    /// Errors of the sink; more elements than the shape has.
    pub fn extend(&mut self, values: impl IntoIterator<Item = T>) -> io::Result<()> {
        for value in values {
            let more = || io::Error::other("more elements than the shape of the npy array has");
            self.n_missing = self.n_missing.checked_sub(1).ok_or_else(more)?;
            value.push(&mut self.buffer);
            if self.buffer.len() >= CHUNK_BYTES {
                self.sink.write_all(&self.buffer)?;
                self.buffer.clear();
            }
        }
        Ok(())
    }

    /// Writes what is buffered.
    ///
    /// # Errors
    /// Errors of the sink; fewer elements than the shape has.
    pub fn finish(mut self) -> io::Result<()> {
        if self.n_missing > 0 {
            return Err(io::Error::other(format!(
                "the npy array lacks {} of its elements",
                self.n_missing
            )));
        }
        self.sink.write_all(&self.buffer)?;
        self.sink.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::super::NpyArray;
    use super::*;

    /// What NumPy 2.3 writes for `numpy.save(file, numpy.arange(3, dtype='<i4'))`.
    #[test]
    fn the_bytes_are_those_of_numpy() {
        let mut bytes = Vec::new();
        let mut writer = NpyWriter::new(&mut bytes, &[3]).unwrap();
        writer.extend([0, 1, 2]).unwrap();
        writer.finish().unwrap();
        let text = "{'descr': '<i4', 'fortran_order': False, 'shape': (3,), }";
        let mut expected = b"\x93NUMPY\x01\x00v\x00".to_vec();
        expected.extend(format!("{text:<117}\n").bytes());
        expected.extend([0, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0]);
        assert_eq!(bytes, expected);
    }

    #[test]
    fn what_is_written_is_read() {
        let numbers: Vec<f32> = (0..100_000).map(|i| i as f32 / 3.0).collect();
        let mut bytes = Vec::new();
        let mut writer = NpyWriter::new(&mut bytes, &[50, 40, 50]).unwrap();
        writer.extend(numbers.iter().copied()).unwrap();
        writer.finish().unwrap();
        let array = NpyArray::new(&bytes).unwrap();
        assert_eq!(array.shape(), [50, 40, 50]);
        assert_eq!(array.numbers_f32().unwrap(), numbers);
    }

    #[test]
    fn a_count_that_does_not_fit_the_shape_is_an_error() {
        let mut writer = NpyWriter::new(Vec::new(), &[2]).unwrap();
        writer.extend([1.0_f32]).unwrap();
        assert!(writer.finish().is_err());
        let mut writer = NpyWriter::new(Vec::new(), &[2]).unwrap();
        writer.extend([[1.0, 0.0]; 2]).unwrap();
        assert!(writer.extend([[1.0, 0.0]]).is_err());
        assert!(NpyWriter::<_, f32>::new(Vec::new(), &[usize::MAX, 2]).is_err());
        assert!(NpyWriter::<_, f32>::new(Vec::new(), &[1; 40_000]).is_err());
        // One number has no dimension.
        let mut scalar = Vec::new();
        let mut writer = NpyWriter::new(&mut scalar, &[]).unwrap();
        writer.extend([1_i32]).unwrap();
        writer.finish().unwrap();
        assert!(scalar.windows(12).any(|w| w == b"'shape': (),"));
    }
}
