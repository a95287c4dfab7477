//! Videos: AVI files with Motion JPEG, which FFmpeg and what is built on it (decord, OpenCV, PyAV) read.
//!
//! Layout by Microsoft's "AVI RIFF File Reference": headers (`hdrl`), frames (`movi`) and an index (`idx1`); every frame is a
//! complete baseline JPEG file. The same images give the same bytes on every machine: the encoder's SIMD is not compiled.

use jpeg_encoder::{ColorType, Encoder, EncodingError, SamplingFactor};
use thiserror::Error;

use crate::raster::Image;

/// Maximum size of a file, bytes: readers without the extensions for long files take larger ones for damaged.
pub const MAX_BYTES: usize = 1_000_000_000;
/// Quality of the frames, 1 to 100: high enough that thin limbs have no visible artefacts.
const QUALITY: u8 = 90;
/// Main header, stream header and format, bytes.
const MAIN_BYTES: u32 = 56;
const STREAM_BYTES: u32 = 56;
const FORMAT_BYTES: u32 = 40;
/// Name and length of a chunk, bytes.
const CHUNK_HEAD_BYTES: u32 = 8;
/// An entry of the index, bytes.
const ENTRY_BYTES: u32 = 16;
/// Contents of the list of headers, with the names of the two lists.
const HEADERS_BYTES: u32 = 4
    + CHUNK_HEAD_BYTES
    + MAIN_BYTES
    + CHUNK_HEAD_BYTES
    + 4
    + CHUNK_HEAD_BYTES
    + STREAM_BYTES
    + CHUNK_HEAD_BYTES
    + FORMAT_BYTES;
/// Everything but the frames and the entries of the index.
const FIXED_BYTES: u32 = 12 + 8 + HEADERS_BYTES + 12 + 8;
/// A flag of the main header: the file has an index.
const HAS_INDEX: u32 = 0x10;
/// A flag of an entry of the index: the frame needs no other one.
const KEY_FRAME: u32 = 0x10;
/// The code of Motion JPEG.
const CODEC: &[u8; 4] = b"MJPG";
/// The name of a chunk with a compressed frame of the first stream.
const FRAME: &[u8; 4] = b"00dc";

/// Reason why images are no video, or bytes no video of this project.
#[derive(Debug, Error)]
pub enum VideoError {
    /// No frames, or no time.
    #[error("a video of {frames} frames at {fps}/s")]
    Empty {
        /// Frames.
        frames: usize,
        /// Frames per second.
        fps: u32,
    },
    /// The images are not of one size, or that size is no image's.
    #[error("a frame of {found:?} pixels in a video of {expected:?}")]
    Size {
        /// Width and height of the video.
        expected: [usize; 2],
        /// Width and height of the frame.
        found: [usize; 2],
    },
    /// Too many frames.
    #[error("a video of more than {MAX_BYTES} bytes")]
    TooLarge,
    /// A frame cannot be encoded.
    #[error("jpeg: {0}")]
    Jpeg(#[from] EncodingError),
    /// Bytes that [`frames`] cannot read.
    #[error("no AVI file with Motion JPEG: byte {byte}: expected {expected}")]
    Damaged {
        /// Offset from the start of the file.
        byte: usize,
        /// What should be there.
        expected: &'static str,
    },
}

/// A video under construction.
///
/// ```
/// use radarllm_render::{avi::{Video, frames}, raster::Image};
///
/// let mut video = Video::new([32, 16], 20);
/// for grey in [0, 128, 255] {
///     video.push(&Image::filled(32, 16, [grey; 3]))?;
/// }
/// let file = video.finish()?;
/// assert!(file.starts_with(b"RIFF"));
/// assert_eq!(frames(&file)?.len(), 3);
/// # Ok::<(), radarllm_render::avi::VideoError>(())
/// ```
pub struct Video {
    size: [usize; 2],
    fps: u32,
    /// Chunks of the frames.
    chunks: Vec<u8>,
    /// Length of every frame, bytes.
    lengths: Vec<u32>,
}

impl Video {
    /// A video without frames, of `[width, height]` pixels and `fps` frames per second.
    pub fn new(size: [usize; 2], fps: u32) -> Self {
        Self {
            size,
            fps,
            chunks: Vec::new(),
            lengths: Vec::new(),
        }
    }

    /// Appends a frame.
    ///
    /// # Errors
    /// An image of another size, or more than [`MAX_BYTES`].
    pub fn push(&mut self, image: &Image) -> Result<(), VideoError> {
        let found = [image.width(), image.height()];
        let size = || VideoError::Size {
            expected: self.size,
            found,
        };
        let [Ok(width), Ok(height)] = found.map(u16::try_from) else {
            return Err(size());
        };
        if found != self.size || width == 0 || height == 0 {
            return Err(size());
        }
        let mut jpeg = Vec::new();
        let mut encoder = Encoder::new(&mut jpeg, QUALITY);
        // What cameras write, and every reader of Motion JPEG expects.
        encoder.set_sampling_factor(SamplingFactor::R_4_2_0);
        encoder.encode(image.rgb(), width, height, ColorType::Rgb)?;
        let n_frames = self.lengths.len() + 1;
        let total = FIXED_BYTES as usize
            + n_frames.saturating_mul(ENTRY_BYTES as usize)
            + self.chunks.len()
            + CHUNK_HEAD_BYTES as usize
            + jpeg.len().next_multiple_of(2);
        let length = u32::try_from(jpeg.len()).map_err(|_| VideoError::TooLarge)?;
        if total > MAX_BYTES {
            return Err(VideoError::TooLarge);
        }
        self.chunks.extend(FRAME);
        self.chunks.extend(length.to_le_bytes());
        self.chunks.extend(&jpeg);
        self.chunks.resize(self.chunks.len().next_multiple_of(2), 0);
        self.lengths.push(length);
        Ok(())
    }

    /// The file.
    ///
    /// # Errors
    /// A video without frames or time.
    pub fn finish(self) -> Result<Vec<u8>, VideoError> {
        if self.lengths.is_empty() || self.fps == 0 {
            return Err(VideoError::Empty {
                frames: self.lengths.len(),
                fps: self.fps,
            });
        }
        // `push` bounds all of these, so that nothing is cut.
        let [width, height] = self.size.map(|n| n as u32);
        let n_frames = self.lengths.len() as u32;
        let largest = self.lengths.iter().copied().max().unwrap_or(0);
        let movie = 4 + self.chunks.len() as u32;
        let index = ENTRY_BYTES * n_frames;
        let mut file = Writer::default();
        file.bytes(b"RIFF");
        file.words(&[FIXED_BYTES - CHUNK_HEAD_BYTES + self.chunks.len() as u32 + index]);
        file.bytes(b"AVI ");
        file.list(HEADERS_BYTES, b"hdrl");
        file.chunk(b"avih", MAIN_BYTES);
        file.words(&[
            1_000_000 / self.fps,
            // Bytes per second, at most.
            largest.saturating_mul(self.fps),
            // Alignment.
            0,
            HAS_INDEX,
            n_frames,
            // Frames before the start.
            0,
            // Streams.
            1,
            // Size of a buffer.
            largest,
            width,
            height,
            // Reserved.
            0,
            0,
            0,
            0,
        ]);
        let stream = 4 + CHUNK_HEAD_BYTES + STREAM_BYTES + CHUNK_HEAD_BYTES + FORMAT_BYTES;
        file.list(stream, b"strl");
        file.chunk(b"strh", STREAM_BYTES);
        file.bytes(b"vids");
        file.bytes(CODEC);
        file.words(&[
            // Flags; priority and language; frames before the start.
            0,
            0,
            0,
            // The rate, as a fraction of two numbers.
            1,
            self.fps,
            // Start and length.
            0,
            n_frames,
            // Size of a buffer; quality, unknown; size of a sample, which varies.
            largest,
            u32::MAX,
            0,
        ]);
        // The rectangle: left, top, right, bottom.
        file.words(&[0]);
        file.bytes(&(width as u16).to_le_bytes());
        file.bytes(&(height as u16).to_le_bytes());
        file.chunk(b"strf", FORMAT_BYTES);
        file.words(&[FORMAT_BYTES, width, height]);
        // Planes, and bits of a pixel.
        file.bytes(&1_u16.to_le_bytes());
        file.bytes(&24_u16.to_le_bytes());
        file.bytes(CODEC);
        file.words(&[width.saturating_mul(height).saturating_mul(3), 0, 0, 0, 0]);
        file.list(movie, b"movi");
        file.bytes(&self.chunks);
        file.chunk(b"idx1", index);
        // Offsets count from the name of the list.
        let mut offset = 4;
        for length in self.lengths {
            file.bytes(FRAME);
            file.words(&[KEY_FRAME, offset, length]);
            offset += CHUNK_HEAD_BYTES + length.next_multiple_of(2);
        }
        Ok(file.0)
    }
}

/// Bytes of a file; numbers are little-endian.
#[derive(Default)]
struct Writer(Vec<u8>);

impl Writer {
    fn bytes(&mut self, bytes: &[u8]) {
        self.0.extend(bytes);
    }

    fn words(&mut self, words: &[u32]) {
        words
            .iter()
            .for_each(|word| self.bytes(&word.to_le_bytes()));
    }

    /// The head of a chunk whose contents have this length.
    fn chunk(&mut self, name: &[u8; 4], length: u32) {
        self.bytes(name);
        self.words(&[length]);
    }

    /// The head of a list whose contents, its name included, have this length.
    fn list(&mut self, length: u32, name: &[u8; 4]) {
        self.chunk(b"LIST", length);
        self.bytes(name);
    }
}

/// The frames of a file that [`Video`] wrote, each a JPEG file.
///
/// # Errors
/// [`VideoError::Damaged`] for other bytes.
pub fn frames(file: &[u8]) -> Result<Vec<&[u8]>, VideoError> {
    let damaged = |byte: usize, expected: &'static str| VideoError::Damaged { byte, expected };
    if !(file.starts_with(b"RIFF") && file.get(8..12) == Some(b"AVI ")) {
        return Err(damaged(0, "RIFF and AVI"));
    }
    let Some((_, contents)) = chunk_at(file, 0) else {
        return Err(damaged(4, "the length of the file"));
    };
    let mut at = 12;
    while at < 8 + contents.len() {
        let (name, list) = chunk_at(file, at).ok_or(damaged(at, "a chunk"))?;
        if name == b"LIST" && list.starts_with(b"movi") {
            return frames_of(list, at + 8);
        }
        at += 8 + list.len().next_multiple_of(2);
    }
    Err(damaged(at, "the list of frames"))
}

/// The frames of the list `movi`, whose contents begin at byte `start` of the file.
fn frames_of(list: &[u8], start: usize) -> Result<Vec<&[u8]>, VideoError> {
    let mut found = Vec::new();
    let mut at = 4;
    while at < list.len() {
        match chunk_at(list, at) {
            Some((name, frame)) if name == FRAME && frame.starts_with(&[0xff, 0xd8]) => {
                found.push(frame);
                at += 8 + frame.len().next_multiple_of(2);
            }
            _ => {
                return Err(VideoError::Damaged {
                    byte: start + at,
                    expected: "a frame in JPEG",
                });
            }
        }
    }
    Ok(found)
}

/// Name and contents of the chunk that begins at a byte; `None` where there is no complete one.
fn chunk_at(bytes: &[u8], at: usize) -> Option<(&[u8], &[u8])> {
    let head = bytes.get(at..)?.get(..8)?;
    let (name, length) = head.split_at(4);
    let length = u32::from_le_bytes(length.try_into().ok()?);
    let contents = bytes[at + 8..].get(..usize::try_from(length).ok()?)?;
    Some((name, contents))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Three frames that differ.
    fn file() -> Vec<u8> {
        let mut video = Video::new([48, 32], 20);
        for grey in [10, 130, 250] {
            let images = [
                Image::filled(24, 32, [grey; 3]),
                Image::filled(22, 32, [0, grey, 9]),
            ];
            video.push(&Image::contact_sheet(&images, 2)).unwrap_err();
            let images = [
                Image::filled(23, 32, [grey; 3]),
                Image::filled(20, 32, [0, grey, 9]),
            ];
            video.push(&Image::contact_sheet(&images, 2)).unwrap();
        }
        video.finish().unwrap()
    }

    fn word(bytes: &[u8], at: usize) -> u32 {
        u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
    }

    /// Chunks between two bytes: name, start of the contents, length.
    fn chunks(bytes: &[u8], mut at: usize, end: usize) -> Vec<(&[u8], usize, usize)> {
        let mut found = Vec::new();
        while at < end {
            let (name, contents) = chunk_at(bytes, at).unwrap();
            found.push((name, at + 8, contents.len()));
            at += 8 + contents.len().next_multiple_of(2);
        }
        assert_eq!(at, end, "chunks end where their list ends");
        found
    }

    #[test]
    fn every_chunk_ends_where_the_next_one_begins() {
        let file = file();
        assert_eq!(word(&file, 4) as usize + 8, file.len());
        let top = chunks(&file, 12, file.len());
        assert_eq!(
            top.iter().map(|c| c.0).collect::<Vec<_>>(),
            [&b"LIST"[..], b"LIST", b"idx1"]
        );
        let (_, start, length) = top[0];
        assert_eq!(&file[start..start + 4], b"hdrl");
        let headers = chunks(&file, start + 4, start + length);
        assert_eq!((headers[0].0, headers[0].2), (&b"avih"[..], 56));
        // Microseconds a frame, flags, frames, streams, width, height.
        let main = [0, 12, 16, 24, 32, 36].map(|at| word(&file, headers[0].1 + at));
        assert_eq!(main, [50_000, 0x10, 3, 1, 48, 32]);
        let (_, start, length) = headers[1];
        assert_eq!(&file[start..start + 4], b"strl");
        let stream = chunks(&file, start + 4, start + length);
        assert_eq!([stream[0].2, stream[1].2], [56, 40]);
        assert_eq!(&file[stream[0].1..stream[0].1 + 8], b"vidsMJPG");
        // Scale, rate and number of frames.
        assert_eq!(
            [20, 24, 32].map(|at| word(&file, stream[0].1 + at)),
            [1, 20, 3]
        );
        assert_eq!([4, 8].map(|at| word(&file, stream[1].1 + at)), [48, 32]);
        assert_eq!(&file[stream[1].1 + 16..stream[1].1 + 20], b"MJPG");
        let (_, movie, length) = top[1];
        assert_eq!(&file[movie..movie + 4], b"movi");
        let shown = chunks(&file, movie + 4, movie + length);
        assert_eq!((shown.len(), top[2].2), (3, 3 * 16));
        for (i, (name, at, length)) in shown.into_iter().enumerate() {
            assert_eq!(
                (name, word(&file, top[2].1 + 16 * i + 4)),
                (&b"00dc"[..], 0x10)
            );
            assert_eq!(movie + word(&file, top[2].1 + 16 * i + 8) as usize, at - 8);
            assert_eq!(word(&file, top[2].1 + 16 * i + 12) as usize, length);
        }
    }

    #[test]
    fn frames_are_complete_jpegs_and_the_same_twice() {
        let file = file();
        let shown = frames(&file).unwrap();
        assert_eq!(shown.len(), 3);
        for frame in &shown {
            assert!(frame.starts_with(&[0xff, 0xd8, 0xff]) && frame.ends_with(&[0xff, 0xd9]));
        }
        assert_ne!(shown[0], shown[1]);
        assert_eq!(self::file(), file);
    }

    #[test]
    fn what_is_no_video_is_refused() {
        assert!(Video::new([48, 32], 20).finish().is_err());
        let mut still = Video::new([8, 8], 0);
        still.push(&Image::filled(8, 8, [1; 3])).unwrap();
        assert!(still.finish().is_err());
        assert!(
            Video::new([0, 8], 20)
                .push(&Image::filled(0, 8, [1; 3]))
                .is_err()
        );
        let wide = Image::filled(65_536, 1, [1; 3]);
        assert!(Video::new([65_536, 1], 20).push(&wide).is_err());
    }

    #[test]
    fn truncated_files_are_damaged_and_none_panics() {
        let file = file();
        for end in 0..file.len() {
            assert!(frames(&file[..end]).is_err(), "{end}");
        }
    }

    proptest! {
        #[test]
        fn damaged_bytes_never_panic(at in 0_usize..1000, byte: u8) {
            let mut file = file();
            let at = at % file.len();
            file[at] = byte;
            let _ = frames(&file);
        }
    }
}
