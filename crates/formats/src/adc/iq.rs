//! Detects whether a capture was read with I and Q in the right order.
//!
//! Echoes come from in front of the radar, so their beat frequencies are positive, and close ones are by
//! far the strongest: power falls with R^4, and nothing is closer than the leakage from transmitter to
//! receiver. With I and Q swapped the spectrum is mirrored and all that is close appears at small negative
//! frequencies. So the energies at +k and -k cycles a chirp are compared for every k, weighted with
//! 1/k^2. What has no direction (offset, drift, noise) is the same on both sides.
//!
//! Limits: without leakage, a scene whose only strong target stands in the far half of the range looks swapped. The
//! weighting was chosen with two recorded frames of undocumented order (docs/captures.md) and was not tested with
//! captures of known order. The verdict reports how large the difference is, and in how many chirps.

use std::sync::Arc;

use num_complex::Complex32;
use radarllm_base::RadarCube;
use radarllm_simd::any_length::{self, Fft};

use super::{AdcError, CubeShape, FrameDecoder, IqOrder, LvdsLanes, SampleKind, SampleLayout};

/// Minimum difference of the two sides for an answer, dB.
const SURE_DB: f64 = 6.0;
/// Minimum share of the chirps that must agree.
const SURE_SHARE: f64 = 0.75;
/// Minimum number of samples of a chirp.
const MIN_SAMPLES: usize = 32;

/// Result of the check.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum IqAnswer {
    /// The order that was used is right.
    AsRead,
    /// The other order is right.
    Swapped,
    /// The signal does not determine the order.
    Unclear,
}

/// Result of the check with the figures behind it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IqVerdict {
    /// The answer; not [`IqAnswer::Unclear`] from 6 dB and three quarters of the chirps on.
    pub answer: IqAnswer,
    /// Weighted energy at positive over that at negative beat frequencies, dB; +-120 at most.
    pub positive_over_negative_db: f64,
    /// Share of chirps (of all receivers) with more of it at positive ones.
    pub positive_share: f64,
    /// Chirps looked at.
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
    /// For chirps of `n_samples`.
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

    /// Looks at every chirp of a frame; chirps that are too short, of another length or
    /// silent are ignored.
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

    /// The answer so far.
    pub fn verdict(&self) -> IqVerdict {
        let positive_over_negative_db = if self.n_chirps == 0 {
            0.0
        } else {
            // Noise-free signals reach the edge of f32: beyond 120 dB differences mean nothing.
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

/// How well a complex layout explains the words of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LayoutScore {
    /// The layout.
    pub layout: SampleLayout,
    /// Its verdict.
    pub verdict: IqVerdict,
}

/// Reads one frame in all four complex layouts (two and four lanes, both orders), best first: with the
/// wrong lanes, samples of different times or receivers stand side by side, and energy spreads to both
/// ends of the spectrum. Layouts that the shape rules out are left out, as are lengths that do not fit.
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
