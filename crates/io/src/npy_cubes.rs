//! Raw samples in a NumPy array, read frame by frame.

use std::{fs::File, io::BufReader, path::Path};

use num_complex::Complex32;
use radarllm_base::{RadarConfig, RadarCube, message::option};
use radarllm_files::npy::NpyStream;
use radarllm_formats::adc::{
    AdcError, AxisOrder, CubeShape, FrameIntegrity, FrameLayout, FrameSource, axes,
};

use crate::error::{Error, Result};

/// The numbers of an array, frame by frame, to cubes: the same for arrays in files and in memory.
#[derive(Clone, Debug)]
pub struct ArrayDecoder {
    layout: FrameLayout,
    is_real: bool,
    /// Whether complex numbers are unsigned words; known after the first frame.
    words: Option<bool>,
}

impl ArrayDecoder {
    /// A decoder of arrays of `shape`, whose axes are `axes`, or `frame,loop,tx,rx,sample`. `code` is the NumPy code of
    /// the elements: `c8`, `c16`, `i2`, `u2`, `f4` or `f8`. `name` takes the place of the file in errors.
    ///
    /// # Errors
    /// A shape that does not fit the radar, or other elements.
    pub fn new(
        name: &Path,
        shape: &[u64],
        is_fortran: bool,
        code: &str,
        radar: &RadarConfig,
        axes: Option<&str>,
    ) -> Result<Self> {
        let order = AxisOrder::parse(axes.unwrap_or("frame,loop,tx,rx,sample")).map_err(|e| {
            let hint = option("axes").text(" frame,chirp,rx,sample, for example");
            Error::wrap(e).with_hint(hint)
        })?;
        let layout = order
            .fit(shape, is_fortran, CubeShape::of(radar))
            .map_err(|e| {
                let radar = &radar.name;
                Error::wrap_in_file(name, e).with_hint(
                    option("radar")
                        .text(format!(
                            " is the radar that recorded the file (here {radar}), "
                        ))
                        .option("axes")
                        .text(" the order of its axes"),
                )
            })?;
        if !matches!(code, "c8" | "c16" | "i2" | "u2" | "f4" | "f8") {
            return Err(Error::in_file(
                name,
                format!(
                    "elements {code}, expected complex64, complex128, int16, uint16, float32 or float64"
                ),
            ));
        }
        Ok(Self {
            layout,
            is_real: !code.starts_with('c'),
            words: None,
        })
    }

    /// Number of frames of the array.
    pub fn n_frames(&self) -> u64 {
        self.layout.n_frames()
    }

    /// Number of elements of a frame.
    pub fn n_numbers(&self) -> usize {
        self.layout.n_numbers()
    }

    /// Whether the numbers were unsigned words and were converted to signed ones; known after the first frame.
    pub fn were_words(&self) -> bool {
        self.words == Some(true)
    }

    /// Fills a cube from the numbers of a frame in the order of memory. Elements `u2` must have been read as signed.
    ///
    /// # Errors
    /// A wrong number of elements, or complex numbers with an axis `iq`.
    pub fn decode(
        &mut self,
        numbers: &mut [Complex32],
        cube: &mut RadarCube,
    ) -> std::result::Result<(), AdcError> {
        let is_real = self.is_real;
        let are_words = *self
            .words
            .get_or_insert_with(|| !is_real && axes::are_unsigned_words(numbers));
        if are_words {
            axes::sign_words(numbers)?;
        }
        self.layout.fill(numbers, is_real, cube)
    }
}

/// Frames of an npy array. Memory holds one frame, regardless of the size that the file declares.
pub struct NpyFrames {
    numbers: NpyStream<BufReader<File>>,
    decoder: ArrayDecoder,
    buffer: Vec<Complex32>,
    next: u64,
}

impl NpyFrames {
    /// Begins to read an array whose axes are `axes`, or `frame,loop,tx,rx,sample`. `path` names the file in errors.
    ///
    /// # Errors
    /// A file that is not an npy array, or one whose shape does not fit the radar.
    pub fn open(file: File, path: &Path, radar: &RadarConfig, axes: Option<&str>) -> Result<Self> {
        let numbers = NpyStream::open(BufReader::new(file));
        let numbers = numbers.map_err(|e| Error::wrap_in_file(path, e))?;
        let header = numbers.header();
        let code = header.fields[0].code.as_str();
        let decoder = ArrayDecoder::new(path, &header.shape, header.fortran, code, radar, axes)?;
        Ok(Self {
            numbers,
            decoder,
            buffer: Vec::new(),
            next: 0,
        })
    }

    /// Number of frames of the array.
    pub fn n_frames(&self) -> u64 {
        self.decoder.n_frames()
    }

    /// Whether the numbers were unsigned words and were converted to signed ones; known after the first frame.
    pub fn were_words(&self) -> bool {
        self.decoder.were_words()
    }
}

impl FrameSource for NpyFrames {
    fn next_frame(
        &mut self,
        cube: &mut RadarCube,
    ) -> std::result::Result<Option<FrameIntegrity>, AdcError> {
        if self.next == self.decoder.n_frames() {
            return Ok(None);
        }
        let n = self.decoder.n_numbers();
        self.buffer.clear();
        // Samples are signed. Recorders that declare them as unsigned write the same bits.
        let is_unsigned = self.numbers.header().fields[0].code == "u2";
        let found = self.numbers.read(n, |re, im| {
            self.buffer.push(if is_unsigned {
                Complex32::from(f32::from(re as u16 as i16))
            } else {
                Complex32::new(re as f32, im as f32)
            });
        });
        match found {
            Err(e) => return Err(AdcError::Layout(format!("frame {}: {e}", self.next))),
            Ok(found) if found < n => {
                return Err(AdcError::Layout(format!(
                    "frame {}, number {found}: expected {n} numbers in each of {} frames, found the end",
                    self.next,
                    self.decoder.n_frames()
                )));
            }
            Ok(_) => {}
        }
        self.decoder.decode(&mut self.buffer, cube)?;
        let integrity = FrameIntegrity {
            frame: self.next,
            ..FrameIntegrity::default()
        };
        self.next += 1;
        Ok(Some(integrity))
    }

    fn trailing_bytes(&self) -> usize {
        0
    }
}
