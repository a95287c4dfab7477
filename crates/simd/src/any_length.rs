//! FFTs of single rows of any length, by `rustfft`. They are planned only in this module, because every crate that
//! plans FFTs compiles all of them.

use std::sync::Arc;

pub use rustfft::Fft;
use rustfft::FftPlanner;

/// The FFT of `n` numbers, `exp(-j 2 pi k n / N)`, not normalised.
pub fn forward(n: usize) -> Arc<dyn Fft<f32>> {
    FftPlanner::new().plan_fft_forward(n)
}

/// The inverse FFT of `n` numbers, not normalised.
pub fn inverse(n: usize) -> Arc<dyn Fft<f32>> {
    FftPlanner::new().plan_fft_inverse(n)
}
