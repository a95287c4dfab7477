//! Meaning of the 16-bit words of a capture, and their decoding into a cube.
//!
//! A frame is a sequence of chirps in firing order, so `[loop, tx, ...]`. Inside a chirp:
//!
//! | lanes | kind | words (little-endian i16) |
//! |---|---|---|
//! | two (xWR16xx, 18xx, 68xx) | complex | receiver by receiver; samples in pairs `I0 I1 Q0 Q1` or `Q0 Q1 I0 I1` |
//! | two | real | receiver by receiver, sample by sample |
//! | four (xWR12xx, 14xx) | complex | sample by sample: I of the four lanes, then Q of them; or Q first |
//! | four | real | sample by sample: the four lanes |
//!
//! With four lanes, lane k carries receiver k + 1, and the lane of a disabled receiver contains zeros.
//! Sources: TI SWRA581B "Mmwave Radar Device ADC Raw Data Capture", sections on the DCA1000's file
//! formats, and its readers for both families. mmWave Studio writes I first unless configured
//! otherwise; SDK firmware with `SampleSwap = 1` writes Q first.

use std::sync::Arc;

use num_complex::Complex32;
use radarllm_base::{RadarConfig, RadarCube};
use radarllm_simd::{
    SimdF32x16, SimdLevel,
    any_length::{self, Fft},
    dispatch,
};

use super::AdcError;

/// Maximum length of a frame, in bytes; the capture card transfers at most 88 MB/s.
pub const MAX_FRAME_BYTES: usize = 256 << 20;
/// Number of lanes of a four-lane capture, whether used or not.
const FOUR: usize = 4;

/// Which of the two numbers of a complex sample is written first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum IqOrder {
    /// I, then Q, as written by mmWave Studio.
    IFirst,
    /// Q, then I, as written by SDK firmware with `SampleSwap = 1`.
    QFirst,
}

impl IqOrder {
    /// Returns the opposite order.
    pub fn swapped(self) -> Self {
        match self {
            IqOrder::IFirst => IqOrder::QFirst,
            IqOrder::QFirst => IqOrder::IFirst,
        }
    }

    /// `I first` or `Q first`.
    pub fn name(self) -> &'static str {
        match self {
            IqOrder::IFirst => "I first",
            IqOrder::QFirst => "Q first",
        }
    }
}

/// Number of LVDS lanes of the device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LvdsLanes {
    /// xWR16xx, xWR18xx, xWR68xx: two lanes, receivers one after the other.
    Two,
    /// xWR12xx, xWR14xx: one lane per receiver, all four always present.
    Four {
        /// Enabled receivers as a bit mask, with RX1 in the lowest bit.
        receivers: u8,
    },
}

/// Kind of a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SampleKind {
    /// Complex samples, two words per sample.
    Complex {
        /// The number that is written first.
        order: IqOrder,
    },
    /// Real samples, one word per sample. The cube contains the analytic signal: the upper half of the spectrum is zero
    /// and its lower half doubled, so that ranges beyond half of [`RadarConfig::max_range_m`] remain empty.
    Real,
}

/// Order of the words.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SampleLayout {
    /// Lanes of the device.
    pub lanes: LvdsLanes,
    /// Complex or real.
    pub data: SampleKind,
}

impl SampleLayout {
    fn words_per_sample(self) -> usize {
        match self.data {
            SampleKind::Complex { .. } => 2,
            SampleKind::Real => 1,
        }
    }
}

/// Shape of a cube, `[loop, tx, rx, sample]`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CubeShape {
    /// Number of Doppler loops.
    pub n_loops: usize,
    /// Number of firing slots per loop.
    pub n_tx: usize,
    /// Number of receivers.
    pub n_rx: usize,
    /// Number of samples per chirp.
    pub n_samples: usize,
}

impl CubeShape {
    /// Returns the shape of a radar's frames.
    pub fn of(radar: &RadarConfig) -> Self {
        Self {
            n_loops: radar.n_loops,
            n_tx: radar.tx.len(),
            n_rx: radar.rx.len(),
            n_samples: radar.n_samples,
        }
    }

    /// Returns the number of chirps per frame; `None` if it overflows.
    pub fn n_chirps(&self) -> Option<usize> {
        self.n_loops.checked_mul(self.n_tx)
    }

    /// Returns the number of values of a cube, if one frame of them is no longer than [`MAX_FRAME_BYTES`].
    ///
    /// # Errors
    /// [`AdcError::Layout`] for an empty cube or one that is too large.
    pub fn n_values(&self) -> Result<usize, AdcError> {
        self.n_chirps()
            .and_then(|n| n.checked_mul(self.n_rx)?.checked_mul(self.n_samples))
            .filter(|n| (1..=MAX_FRAME_BYTES / 4).contains(n))
            .ok_or_else(|| {
                AdcError::Layout(format!(
                    "a cube of {} x {} x {} x {} samples is empty or larger than {} MiB",
                    self.n_loops,
                    self.n_tx,
                    self.n_rx,
                    self.n_samples,
                    MAX_FRAME_BYTES >> 20
                ))
            })
    }

    /// Allocates a cube of zeros.
    ///
    /// # Errors
    /// Those of [`Self::n_values`].
    pub fn zeros(&self) -> Result<RadarCube, AdcError> {
        self.n_values()?;
        let Self {
            n_loops,
            n_tx,
            n_rx,
            n_samples,
        } = *self;
        Ok(RadarCube::zeros(n_loops, n_tx, n_rx, n_samples))
    }
}

/// Decodes the bytes of a frame into a cube.
pub struct FrameDecoder {
    shape: CubeShape,
    layout: SampleLayout,
    frame_bytes: usize,
    /// Lane of each receiver, for four lanes.
    lanes: Vec<usize>,
    analytic: Option<AnalyticSignal>,
    level: SimdLevel,
}

impl FrameDecoder {
    /// Plans the decoding.
    ///
    /// # Errors
    /// [`AdcError::Layout`] if frame and layout are incompatible: an odd number of complex samples on two lanes, a
    /// number of receivers that differs from the lanes in use, or a frame that is empty or too large.
    pub fn new(shape: CubeShape, layout: SampleLayout) -> Result<Self, AdcError> {
        let n_values = shape.n_values()?;
        let mut lanes = Vec::new();
        let n_received = match layout.lanes {
            LvdsLanes::Two => {
                let complex = matches!(layout.data, SampleKind::Complex { .. });
                if complex && !shape.n_samples.is_multiple_of(2) {
                    return Err(AdcError::Layout(format!(
                        "two lanes carry complex samples in pairs, and a chirp has {}",
                        shape.n_samples
                    )));
                }
                n_values
            }
            LvdsLanes::Four { receivers } => {
                lanes.extend((0..8).filter(|lane| receivers >> lane & 1 == 1));
                if lanes.len() != shape.n_rx || lanes.iter().any(|lane| *lane >= FOUR) {
                    return Err(AdcError::Layout(format!(
                        "the radar has {} receivers, and the mask {receivers:#06b} of the four lanes names {}",
                        shape.n_rx,
                        lanes.len()
                    )));
                }
                n_values / shape.n_rx * FOUR
            }
        };
        let frame_bytes = n_received * layout.words_per_sample() * 2;
        let analytic = match layout.data {
            SampleKind::Real => Some(AnalyticSignal::new(shape.n_samples)),
            SampleKind::Complex { .. } => None,
        };
        Ok(Self {
            shape,
            layout,
            frame_bytes,
            lanes,
            analytic,
            level: SimdLevel::detect(),
        })
    }

    /// Size of a frame in bytes.
    pub fn frame_bytes(&self) -> usize {
        self.frame_bytes
    }

    /// Shape of the cubes.
    pub fn shape(&self) -> CubeShape {
        self.shape
    }

    /// Fills `cube` with the frame in `bytes`.
    ///
    /// # Errors
    /// [`AdcError::Layout`] if `bytes` is not one frame or `cube` is not of [`Self::shape`].
    pub fn decode(&mut self, bytes: &[u8], cube: &mut RadarCube) -> Result<(), AdcError> {
        let found = CubeShape {
            n_loops: cube.n_loops,
            n_tx: cube.n_tx,
            n_rx: cube.n_rx,
            n_samples: cube.n_samples,
        };
        if bytes.len() != self.frame_bytes || found != self.shape {
            return Err(AdcError::Layout(format!(
                "expected {} bytes for a cube of {:?}, found {} bytes and {found:?}",
                self.frame_bytes,
                self.shape,
                bytes.len()
            )));
        }
        let word = |i: usize| f32::from(i16::from_le_bytes([bytes[2 * i], bytes[2 * i + 1]]));
        let (n_rx, n_samples) = (self.shape.n_rx, self.shape.n_samples);
        match (self.layout.lanes, self.layout.data) {
            (LvdsLanes::Two, SampleKind::Real) => {
                for (i, value) in cube.data.iter_mut().enumerate() {
                    *value = Complex32::new(word(i), 0.0);
                }
            }
            (LvdsLanes::Two, SampleKind::Complex { order }) => match order {
                IqOrder::IFirst => i_first_pairs(self.level, bytes, &mut cube.data),
                IqOrder::QFirst => q_first_pairs(self.level, bytes, &mut cube.data),
            },
            (LvdsLanes::Four { .. }, data) => {
                let words_per_group = FOUR * self.layout.words_per_sample();
                for (chirp, values) in cube.data.chunks_exact_mut(n_rx * n_samples).enumerate() {
                    for (rx, &lane) in self.lanes.iter().enumerate() {
                        for sample in 0..n_samples {
                            let at = (chirp * n_samples + sample) * words_per_group + lane;
                            values[rx * n_samples + sample] = match data {
                                SampleKind::Real => Complex32::new(word(at), 0.0),
                                SampleKind::Complex { order } => {
                                    ordered(order, word(at), word(at + FOUR))
                                }
                            };
                        }
                    }
                }
            }
        }
        if let Some(analytic) = &mut self.analytic {
            for chirp in cube.data.chunks_exact_mut(n_samples) {
                analytic.run(chirp);
            }
        }
        Ok(())
    }
}

/// Samples in pairs, `I0 I1 Q0 Q1`.
#[expect(
    clippy::extra_unused_type_parameters,
    reason = "`dispatch!` compiles it for every instruction set"
)]
#[inline(always)]
fn i_first_pairs_body<L: SimdF32x16>(bytes: &[u8], samples: &mut [Complex32]) {
    for (words, pair) in bytes.chunks_exact(8).zip(samples.chunks_exact_mut(2)) {
        let [i0, i1, q0, q1] = four_words(words);
        pair[0] = Complex32::new(i0, q0);
        pair[1] = Complex32::new(i1, q1);
    }
}

/// Samples in pairs, `Q0 Q1 I0 I1`.
#[expect(
    clippy::extra_unused_type_parameters,
    reason = "`dispatch!` compiles it for every instruction set"
)]
#[inline(always)]
fn q_first_pairs_body<L: SimdF32x16>(bytes: &[u8], samples: &mut [Complex32]) {
    for (words, pair) in bytes.chunks_exact(8).zip(samples.chunks_exact_mut(2)) {
        let [q0, q1, i0, i1] = four_words(words);
        pair[0] = Complex32::new(i0, q0);
        pair[1] = Complex32::new(i1, q1);
    }
}

#[inline(always)]
fn four_words(bytes: &[u8]) -> [f32; 4] {
    let word = |i: usize| f32::from(i16::from_le_bytes([bytes[2 * i], bytes[2 * i + 1]]));
    [word(0), word(1), word(2), word(3)]
}

dispatch!(fn i_first_pairs => i_first_pairs_body(bytes: &[u8], samples: &mut [Complex32]));
dispatch!(fn q_first_pairs => q_first_pairs_body(bytes: &[u8], samples: &mut [Complex32]));

fn ordered(order: IqOrder, first: f32, second: f32) -> Complex32 {
    match order {
        IqOrder::IFirst => Complex32::new(first, second),
        IqOrder::QFirst => Complex32::new(second, first),
    }
}

/// Converts real samples to the analytic signal: no negative beat frequencies, positive ones doubled.
pub struct AnalyticSignal {
    forward: Arc<dyn Fft<f32>>,
    backward: Arc<dyn Fft<f32>>,
}

impl AnalyticSignal {
    /// For chirps of `n_samples`.
    pub fn new(n_samples: usize) -> Self {
        Self {
            forward: any_length::forward(n_samples),
            backward: any_length::inverse(n_samples),
        }
    }

    /// Replaces one chirp, of which the imaginary parts are ignored.
    pub fn run(&mut self, chirp: &mut [Complex32]) {
        let n = chirp.len();
        for value in chirp.iter_mut() {
            value.im = 0.0;
        }
        self.forward.process(chirp);
        let scale = 1.0 / n as f32;
        for (bin, value) in chirp.iter_mut().enumerate() {
            // Zero frequency and, for even n, the middle one are their own mirror images.
            *value *= match bin {
                0 => scale,
                _ if 2 * bin < n => 2.0 * scale,
                _ if 2 * bin == n => scale,
                _ => 0.0,
            };
        }
        self.backward.process(chirp);
    }
}
