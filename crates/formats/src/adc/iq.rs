//! Detects whether a capture was read with I and Q in the right order.
//!
//! Echoes come from in front of the radar, so their beat frequencies are positive. Close echoes are by far the
//! strongest: power falls with R^4, and nothing is closer than the leakage from transmitter to receiver. If I and Q are
//! swapped, the spectrum is mirrored and all close echoes appear at small negative frequencies. The detector therefore
//! compares the energies at +k and -k cycles per chirp for every k, weighted with 1/k^2. Contributions without a
//! direction (offset, drift, noise) are equal on both sides.
//!
//! Limits: without leakage, a scene whose only strong target is in the far half of the range appears swapped. The
//! weighting was chosen with two recorded frames of undocumented order (docs/guides/captures.md) and was not tested with
//! captures of known order. The verdict reports the size of the difference and the fraction of chirps that show it.

use std::sync::Arc;

use num_complex::Complex32;
use radarllm_base::RadarCube;
use radarllm_simd::any_length::{self, Fft};

use super::{AdcError, CubeShape, FrameDecoder, IqOrder, LvdsLanes, SampleKind, SampleLayout};

/// Minimum difference of the two sides for a verdict, dB.
const SURE_DB: f64 = 6.0;
/// Minimum fraction of the chirps that must agree.
const SURE_SHARE: f64 = 0.75;
/// Minimum number of samples of a chirp.
const MIN_SAMPLES: usize = 32;

/// Result of the check.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum IqAnswer {
    /// The order used is correct.
    AsRead,
    /// The opposite order is correct.
    Swapped,
    /// The signal does not determine the order.
    Unclear,
}

/// Result of the check with its measurements.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IqVerdict {
    /// The verdict. It is not [`IqAnswer::Unclear`] from a difference of 6 dB and three quarters of the chirps on.
    pub answer: IqAnswer,
    /// Ratio of the weighted energy at positive to that at negative beat frequencies, dB; limited to +-120.
    pub positive_over_negative_db: f64,
    /// Fraction of chirps (of all receivers) with more energy at positive beat frequencies.
    pub positive_share: f64,
    /// Number of chirps analysed.
    pub n_chirps: usize,
}

/// Collects the energies of many chirps.
pub struct IqCheck {
    fft: Arc<dyn Fft<f32>>,
    window: Vec<f32>,
    buffer: Vec<Complex32>,
    positive: f64,
    negative: f64,
    n_positive: usize,
    n_chirps: usize,
}

impl IqCheck {
    /// Creates a detector for chirps of `n_samples`.
    pub fn new(n_samples: usize) -> Self {
        let step = std::f32::consts::TAU / n_samples.max(1) as f32;
        Self {
            fft: any_length::forward(n_samples),
            window: (0..n_samples)
                .map(|i| 0.5 - 0.5 * (step * (i as f32 + 0.5)).cos())
                .collect(),
            buffer: vec![Complex32::ZERO; n_samples],
            positive: 0.0,
            negative: 0.0,
            n_positive: 0,
            n_chirps: 0,
        }
    }

    /// Analyses every chirp of a frame. Chirps that are too short, of another length or silent are ignored.
    pub fn push(&mut self, cube: &RadarCube) {
        let n = self.buffer.len();
        if cube.n_samples != n || n < MIN_SAMPLES {
            return;
        }
        for chirp in cube.data.chunks_exact(n) {
            let mean = chirp.iter().sum::<Complex32>() / n as f32;
            for ((out, value), weight) in self.buffer.iter_mut().zip(chirp).zip(&self.window) {
                *out = (value - mean) * weight;
            }
            self.fft.process(&mut self.buffer);
            let (mut positive, mut negative) = (0.0, 0.0);
            for k in 1..n.div_ceil(2) {
                let weight = 1.0 / (k * k) as f64;
                positive += weight * f64::from(self.buffer[k].norm_sqr());
                negative += weight * f64::from(self.buffer[n - k].norm_sqr());
            }
            if positive + negative > 0.0 {
                self.positive += positive;
                self.negative += negative;
                self.n_positive += usize::from(positive > negative);
                self.n_chirps += 1;
            }
        }
    }

    /// Returns the current verdict.
    pub fn verdict(&self) -> IqVerdict {
        let positive_over_negative_db = if self.n_chirps == 0 {
            0.0
        } else {
            // Noise-free signals reach the limits of f32: differences beyond 120 dB are meaningless.
            let floor = 1e-12 * (self.positive + self.negative);
            10.0 * (self.positive.max(floor) / self.negative.max(floor)).log10()
        };
        let positive_share = self.n_positive as f64 / self.n_chirps.max(1) as f64;
        let answer = if self.n_chirps == 0 || positive_over_negative_db.abs() < SURE_DB {
            IqAnswer::Unclear
        } else if positive_over_negative_db > 0.0 && positive_share >= SURE_SHARE {
            IqAnswer::AsRead
        } else if positive_over_negative_db < 0.0 && positive_share <= 1.0 - SURE_SHARE {
            IqAnswer::Swapped
        } else {
            IqAnswer::Unclear
        };
        IqVerdict {
            answer,
            positive_over_negative_db,
            positive_share,
            n_chirps: self.n_chirps,
        }
    }
}

/// Result of reading a frame with one complex layout.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LayoutScore {
    /// The layout.
    pub layout: SampleLayout,
    /// Verdict for this layout.
    pub verdict: IqVerdict,
}

/// Reads one frame in all four complex layouts (two and four lanes, both orders), and returns them best first. With the
/// wrong number of lanes, samples of different times or receivers become adjacent, and energy spreads to both ends of
/// the spectrum. Layouts that the shape rules out are omitted, as are lengths that do not fit.
pub fn compare_layouts(frame: &[u8], shape: CubeShape) -> Result<Vec<LayoutScore>, AdcError> {
    let mut cube = shape.zeros()?;
    let receivers = u8::try_from((1_u32 << shape.n_rx.min(8)) - 1).unwrap_or(u8::MAX);
    let mut scores = Vec::new();
    for lanes in [LvdsLanes::Two, LvdsLanes::Four { receivers }] {
        for order in [IqOrder::IFirst, IqOrder::QFirst] {
            let layout = SampleLayout {
                lanes,
                data: SampleKind::Complex { order },
            };
            let Ok(mut decoder) = FrameDecoder::new(shape, layout) else {
                continue;
            };
            if decoder.frame_bytes() != frame.len() {
                continue;
            }
            decoder.decode(frame, &mut cube)?;
            let mut check = IqCheck::new(shape.n_samples);
            check.push(&cube);
            scores.push(LayoutScore {
                layout,
                verdict: check.verdict(),
            });
        }
    }
    scores.sort_by(|a, b| {
        b.verdict
            .positive_over_negative_db
            .total_cmp(&a.verdict.positive_over_negative_db)
    });
    Ok(scores)
}
