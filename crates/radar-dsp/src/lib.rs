//! Radar cubes in, points out: range, Doppler, clutter, angle, point selection.
//!
//! What enters is a [`radarllm_base::RadarCube`], simulated or captured: nothing here can tell.
//! What leaves is a [`radarllm_base::PointFrame`], or a picture's data as a [`Map`].
//!
//! Plan once, run many: [`PointExtractor::new`] builds windows, FFT plans, the virtual array and the
//! detection threshold; [`PointExtractor::extract`] then runs without allocating anything but its
//! result. Signs, axes and references are fixed in CONVENTIONS.md at the repository root.
//!
//! Reading order: [`extractor`] (the chain), [`options`], [`spectrum`] (range and Doppler),
//! [`detect`] (which cells), [`mod@array`] and [`direction`] (where they are), [`pictures`]; before the chain
//! [`mod@correct`] (what is taken off raw samples) and [`mod@calibrate`] (channel gains from a reflector).
//!
//! Deliberately absent: anything about people, files, or how a cube came to be.

pub mod array;
pub mod calibrate;
pub mod correct;
pub mod detect;
pub mod direction;
pub mod error;
pub mod extractor;
pub mod options;
pub mod pictures;
pub mod spectrum;
pub mod stats;
pub mod window;

mod doppler_fft;
mod kernels;
mod row_fft;

pub use array::VirtualArray;
pub use calibrate::{CalibrateError, ChannelGains, CornerCalibrator, Reflector};
pub use correct::{Background, Corrections, Corrector, EmptyRoom};
pub use error::DspError;
pub use extractor::PointExtractor;
pub use options::{
    CfarSides, ClutterFilter, Detector, DspOptions, ImpossibleDirection, MapKind, PeakGrouping,
};
pub use pictures::{Axis, Map, MicroDoppler};
pub use window::Window;

#[cfg(test)]
mod tests {
    /// Numbers in -1..1 for tests.
    pub fn uniform(seed: u32) -> impl FnMut() -> f32 {
        let mut state = seed;
        move || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 23) as f32 - 1.0
        }
    }
}
