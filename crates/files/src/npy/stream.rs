//! Streams an npy array, for raw samples of many frames of which memory holds only one.

use std::io::Read;

use super::{NpyError, NpyHeader, Number, parse_header, read_prelude, wrong};

/// Size of the read buffer, bytes.
const CHUNK_BYTES: usize = 1 << 16;

/// An open array whose elements are read in file order.
#[derive(Debug)]
pub struct NpyStream<R> {
    header: NpyHeader,
    number: Number,
    source: R,
    /// Byte offset of the next element.
    at: usize,
    chunk: Vec<u8>,
}

impl<R: Read> NpyStream<R> {
    /// Opens an array and reads its header.
    ///
    /// # Errors
    /// [`NpyError`] for an invalid header, and for element types other than integers and real or complex floats of 32
    /// or 64 bits.
    pub fn open(mut source: R) -> Result<Self, NpyError> {
        let mut head = Vec::new();
        let mut read_up_to = |len: usize, head: &mut Vec<u8>| {
            let more = len.saturating_sub(head.len()) as u64;
            (&mut source)
                .take(more)
                .read_to_end(head)
                .map_err(|e| wrong(head.len(), "a readable file", &e.to_string()))
        };
        read_up_to(10, &mut head)?;
        // Later versions have a length field of four bytes instead of two.
        if head.get(6).is_some_and(|version| *version > 1) {
            read_up_to(12, &mut head)?;
        }
        let (length, start) = read_prelude(&head)?;
        read_up_to(start + length, &mut head)?;
        let text = head
            .get(start..start + length)
            .ok_or_else(|| wrong(start, format!("a header of {length} bytes"), "the end"))?;
        let header = parse_header(text, start)?;
        let number = match header.fields.as_slice() {
            [field] if field.name.is_empty() => field.number,
            _ => None,
        };
        let number = number.ok_or_else(|| {
            wrong(
                start,
                "one number per element, of 32 or 64 bits or an integer",
                &header.descr(),
            )
        })?;
        Ok(Self {
            at: header.data_at,
            header,
            number,
            source,
            chunk: Vec::new(),
        })
    }

    /// The header.
    pub fn header(&self) -> &NpyHeader {
        &self.header
    }

    /// Whether the elements are complex.
    pub fn is_complex(&self) -> bool {
        self.header.fields[0].is_complex()
    }

    /// Passes the next `n` elements to `take` as real and imaginary parts (0 for real arrays) and returns their number,
    /// which is less than `n` at the end of the file. The buffer has 64 KiB, regardless of `n`.
    ///
    /// # Errors
    /// A read error of the source, with its byte offset.
    pub fn read(&mut self, n: usize, mut take: impl FnMut(f64, f64)) -> Result<usize, NpyError> {
        let item_bytes = self.header.item_bytes;
        let field = &self.header.fields[0];
        let (number, is_complex) = (self.number, field.is_complex());
        let mut done = 0;
        while done < n {
            let wanted = (n - done).min(CHUNK_BYTES / item_bytes);
            self.chunk.clear();
            (&mut self.source)
                .take((wanted * item_bytes) as u64)
                .read_to_end(&mut self.chunk)
                .map_err(|e| wrong(self.at, "readable data", &e.to_string()))?;
            for item in self.chunk.chunks_exact(item_bytes) {
                let re = number.at(item, field.big_endian);
                let im = if is_complex {
                    number.at(&item[item_bytes / 2..], field.big_endian)
                } else {
                    0.0
                };
                take(re, im);
            }
            let found = self.chunk.len() / item_bytes;
            self.at += found * item_bytes;
            done += found;
            if found < wanted {
                break;
            }
        }
        Ok(done)
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::npy;
    use super::*;

    #[test]
    fn elements_come_in_pieces_and_the_end_is_noticed() {
        let data: Vec<u8> = (0..20_000_i32)
            .flat_map(|i| [i as f32, -0.5].map(f32::to_le_bytes))
            .flatten()
            .collect();
        let bytes = npy("'<c8'", "False", "(20000,)", &data);
        let mut stream = NpyStream::open(bytes.as_slice()).unwrap();
        assert!(stream.is_complex());
        let mut found = Vec::new();
        for n in [3, 9_000, 10_997] {
            let read = stream.read(n, |re, im| found.push((re, im))).unwrap();
            assert_eq!(read, n);
        }
        assert!(
            found
                .iter()
                .enumerate()
                .all(|(i, v)| *v == (i as f64, -0.5))
        );
        assert_eq!(stream.read(1, |_, _| {}).unwrap(), 0);
        let mut cut = NpyStream::open(&bytes[..bytes.len() - 1]).unwrap();
        assert_eq!(cut.read(30_000, |_, _| {}).unwrap(), 19_999);
    }

    #[test]
    fn headers_are_checked_before_anything_is_read() {
        for (descr, data) in [
            ("'<U4'", 4),
            ("'|O'", 1),
            ("[('x', '<f4')]", 4),
            ("'<f2'", 2),
        ] {
            let bytes = npy(descr, "False", "(1,)", &vec![0; data]);
            assert!(NpyStream::open(bytes.as_slice()).is_err(), "{descr}");
        }
        let good = npy("'>i2'", "False", "(1,)", &[0xff, 0xfe]);
        for end in 0..good.len() - 2 {
            assert!(NpyStream::open(&good[..end]).is_err(), "{end}");
        }
        let mut stream = NpyStream::open(good.as_slice()).unwrap();
        let mut found = Vec::new();
        stream.read(5, |re, _| found.push(re)).unwrap();
        assert_eq!(found, [-2.0]);
        // Version 2 has a length field of four bytes.
        let mut later = good.clone();
        later[6] = 2;
        later.splice(10..10, [0, 0]);
        assert!(NpyStream::open(later.as_slice()).is_ok());
    }
}
