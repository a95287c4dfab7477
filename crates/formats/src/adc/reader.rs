//! Frames of a capture file, one at a time.

use std::{
    io::{self, Read},
    ops::Range,
};

use radarllm_base::RadarCube;

use super::{AdcError, FrameDecoder};

/// Reads `n` bytes into `buffer` and moves `offset` on; false if the input ends before. The buffer grows
/// with what is there, not with `n`.
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

/// How much of a frame arrived.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FrameIntegrity {
    /// Number of the frame since the recorder was started, from 0.
    pub frame: u64,
    /// Its size, bytes.
    pub frame_bytes: usize,
    /// Bytes that never arrived, which are zero in the cube; ascending and apart from each other.
    pub missing: Vec<Range<usize>>,
    /// Packets that begin in this frame; 0 for plain files.
    pub packets: u32,
    /// Of these, how many came after one with a higher number.
    pub out_of_order: u32,
    /// Of these, how many held nothing new.
    pub duplicates: u32,
}

impl FrameIntegrity {
    /// Bytes that never arrived.
    pub fn missing_bytes(&self) -> usize {
        self.missing.iter().map(Range::len).sum()
    }

    /// True when nothing is missing.
    pub fn is_complete(&self) -> bool {
        self.missing.is_empty()
    }
}

/// Anything that gives one frame after the other.
pub trait FrameSource {
    /// Fills `cube` with the next frame (its time is left alone); `None` at the end.
    ///
    /// # Errors
    /// [`AdcError`] with the place in the input.
    fn next_frame(&mut self, cube: &mut RadarCube) -> Result<Option<FrameIntegrity>, AdcError>;

    /// Bytes after the last whole frame; known once [`Self::next_frame`] gave `None`.
    fn trailing_bytes(&self) -> usize;
}

/// Reads `adc_data.bin`: frames without anything between them.
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
        // The buffer grows with what is there, not with what a radar file claims.
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

/// Several inputs read as one: recorders split long captures wherever they stand, in mid-chirp too.
pub struct Chained<R> {
    /// Still to be read, the next one last.
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
