//! Packets in a file: mmWave Studio's `*_Raw_0.bin` before its own post-processing.
//!
//! The samples of each packet are preceded by a header of 14 bytes: packet number (u32, from 1), length of the samples
//! (u32), number of sample bytes sent before (u48). Interpreted as samples, such a file starts with the words 1, 0,
//! 1456, 0, ...

use std::io::Read;

use super::{DataPacket, MAX_PAYLOAD, source::PacketSource, u48};
use crate::adc::{AdcError, reader::fill};

/// Bytes before the samples of a record.
const HEADER_BYTES: usize = 14;

/// Returns whether a file begins with a record rather than with samples: packet 1 with at most [`MAX_PAYLOAD`] bytes
/// and nothing sent before it. Samples would have to match seven given words in a row.
pub fn starts_with_record(start: &[u8]) -> bool {
    start
        .first_chunk::<HEADER_BYTES>()
        .map(header)
        .is_some_and(|(sequence, length, count)| {
            sequence == 1 && (1..=MAX_PAYLOAD as u32).contains(&length) && count == 0
        })
}

fn header(b: &[u8; HEADER_BYTES]) -> (u32, u32, u64) {
    (
        u32::from_le_bytes([b[0], b[1], b[2], b[3]]),
        u32::from_le_bytes([b[4], b[5], b[6], b[7]]),
        u48([b[8], b[9], b[10], b[11], b[12], b[13]]),
    )
}

/// Reads consecutive records.
pub struct RecordReader<R> {
    input: R,
    /// Bytes read so far.
    offset: u64,
    buffer: Vec<u8>,
    cut_bytes: usize,
}

impl<R: Read> RecordReader<R> {
    /// Reads from the start of a record.
    pub fn new(input: R) -> Self {
        Self {
            input,
            offset: 0,
            buffer: Vec::new(),
            cut_bytes: 0,
        }
    }

    /// Number of bytes of an incomplete last record.
    pub fn cut_bytes(&self) -> usize {
        self.cut_bytes
    }

    /// Reads `n` bytes into the buffer; false if the input ends before.
    fn fill(&mut self, n: usize) -> Result<bool, AdcError> {
        fill(&mut self.input, n, &mut self.buffer, &mut self.offset)
    }
}

impl<R: Read> PacketSource for RecordReader<R> {
    fn next_packet(&mut self) -> Result<Option<DataPacket<'_>>, AdcError> {
        let start = self.offset;
        let whole = self.fill(HEADER_BYTES)?;
        let Some((sequence, length, byte_count)) = self.buffer.first_chunk().map(header) else {
            debug_assert!(!whole);
            self.cut_bytes = self.buffer.len();
            return Ok(None);
        };
        if !(1..=MAX_PAYLOAD as u32).contains(&length) {
            return Err(AdcError::format(
                start + 4,
                format!("the length of a packet's samples, 1 to {MAX_PAYLOAD} bytes"),
                length.to_string(),
            ));
        }
        if !self.fill(length as usize)? {
            self.cut_bytes = HEADER_BYTES + self.buffer.len();
            return Ok(None);
        }
        Ok(Some(DataPacket {
            sequence,
            byte_count,
            payload: &self.buffer,
        }))
    }

    fn skipped(&self) -> u64 {
        u64::from(self.cut_bytes > 0)
    }
}
