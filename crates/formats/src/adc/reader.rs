//! Frames of a capture file, one at a time.

use std::{
    io::{self, Read},
    ops::Range,
};

use radarllm_base::RadarCube;

use super::{AdcError, FrameDecoder};

/// Reads `n` bytes into `buffer` and advances `offset`. Returns false if the input ends early. The buffer grows with
/// the bytes available, not with `n`.
pub(crate) fn fill(
    input: &mut impl Read,
    n: usize,
    buffer: &mut Vec<u8>,
    offset: &mut u64,
) -> Result<bool, AdcError> {
    buffer.clear();
    let read = input
        .take(n as u64)
        .read_to_end(buffer)
        .map_err(|source| AdcError::Read {
            offset: *offset,
            source,
        })?;
    *offset += read as u64;
    Ok(read == n)
}

/// Completeness of a frame.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FrameIntegrity {
    /// Number of the frame since the recorder was started, from 0.
    pub frame: u64,
    /// Size of the frame in bytes.
    pub frame_bytes: usize,
    /// Ranges of missing bytes, which are zero in the cube; ascending and not adjacent.
    pub missing: Vec<Range<usize>>,
    /// Number of packets that begin in this frame; 0 for plain files.
    pub packets: u32,
    /// Number of these packets that arrived after one with a higher number.
    pub out_of_order: u32,
    /// Number of these packets that contained no new data.
    pub duplicates: u32,
}

impl FrameIntegrity {
    /// Number of missing bytes.
    pub fn missing_bytes(&self) -> usize {
        self.missing.iter().map(Range::len).sum()
    }

    /// Returns true if no bytes are missing.
    pub fn is_complete(&self) -> bool {
        self.missing.is_empty()
    }
}

/// A source of consecutive frames.
pub trait FrameSource {
    /// Fills `cube` with the next frame, without changing the cube's time. Returns `None` at the end.
    ///
    /// # Errors
    /// [`AdcError`] with the offset in the input.
    fn next_frame(&mut self, cube: &mut RadarCube) -> Result<Option<FrameIntegrity>, AdcError>;

    /// Number of bytes after the last complete frame; known once [`Self::next_frame`] has returned `None`.
    fn trailing_bytes(&self) -> usize;
}

/// Reads `adc_data.bin`: consecutive frames without any headers.
pub struct AdcReader<R> {
    input: R,
    decoder: FrameDecoder,
    buffer: Vec<u8>,
    n_frames: u64,
    trailing_bytes: usize,
}

impl<R: Read> AdcReader<R> {
    /// Reads from the start of a frame.
    pub fn new(input: R, decoder: FrameDecoder) -> Self {
        Self {
            input,
            decoder,
            buffer: Vec::new(),
            n_frames: 0,
            trailing_bytes: 0,
        }
    }
}

impl<R: Read> FrameSource for AdcReader<R> {
    fn next_frame(&mut self, cube: &mut RadarCube) -> Result<Option<FrameIntegrity>, AdcError> {
        let frame_bytes = self.decoder.frame_bytes();
        self.buffer.clear();
        // The buffer grows with the bytes available, not with the size that a radar file declares.
        (&mut self.input)
            .take(frame_bytes as u64)
            .read_to_end(&mut self.buffer)
            .map_err(|source| AdcError::Read {
                offset: self
                    .n_frames
                    .saturating_mul(frame_bytes as u64)
                    .saturating_add(self.buffer.len() as u64),
                source,
            })?;
        if self.buffer.len() < frame_bytes {
            self.trailing_bytes = self.buffer.len();
            return Ok(None);
        }
        self.decoder.decode(&self.buffer, cube)?;
        let integrity = FrameIntegrity {
            frame: self.n_frames,
            frame_bytes,
            ..FrameIntegrity::default()
        };
        self.n_frames += 1;
        Ok(Some(integrity))
    }

    fn trailing_bytes(&self) -> usize {
        self.trailing_bytes
    }
}

/// Several inputs read as one. Recorders split long captures at any byte, even within a chirp.
pub struct Chained<R> {
    /// Remaining inputs in reverse order, the next one last.
    rest: Vec<R>,
}

impl<R> Chained<R> {
    /// In this order.
    pub fn new(mut inputs: Vec<R>) -> Self {
        inputs.reverse();
        Self { rest: inputs }
    }
}

impl<R: Read> Read for Chained<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        while let Some(input) = self.rest.last_mut() {
            let n = input.read(buffer)?;
            if n > 0 || buffer.is_empty() {
                return Ok(n);
            }
            self.rest.pop();
        }
        Ok(0)
    }
}
