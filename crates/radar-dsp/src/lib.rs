//! The signal chain of an FMCW radar: raw samples to a point cloud with positions, radial velocities and intensities.
//!
//! It performs the processing of a radar board's firmware on recorded or simulated samples: window, range FFT, clutter
//! removal, Doppler FFT, detection, and angle estimation.
//!
//! ```
//! use radarllm_base::RadarConfig;
//! use radarllm_radar_dsp::{DspOptions, PointExtractor};
//! # use radarllm_radar_sim::{Noise, PointTarget, Scene, SimOptions, Simulator};
//! # fn recorded_cube(radar: &RadarConfig) -> radarllm_base::RadarCube {
//! #     let target = PointTarget {
//! #         position_m: [0.8, 2.0, 0.3].into(),
//! #         velocity_mps: [0.0, 1.0, 0.0].into(),
//! #         rcs_m2: 1.0,
//! #     };
//! #     let scene = Scene { surfaces: vec![], points: vec![target], noise: Noise::Thermal };
//! #     let mut simulator = Simulator::new(radar, SimOptions::default()).unwrap();
//! #     let mut cube = simulator.new_cube();
//! #     simulator.simulate_frame(&scene, 0, 0.0, 1, &mut cube).unwrap();
//! #     cube
//! # }
//!
//! let radar = RadarConfig::awr1843boost();
//! // A frame in which a reflector at (0.8, 2.0, 0.3) m recedes at 1 m/s.
//! let cube = recorded_cube(&radar);
//!
//! // Plan the chain once, then extract frame after frame.
//! let mut extractor = PointExtractor::new(&radar, DspOptions::default())?;
//! let frame = extractor.extract(&cube)?;
//! let strongest = frame.points[0];
//! for (found, expected) in [
//!     (strongest.x_m, 0.8),
//!     (strongest.y_m, 2.0),
//!     (strongest.z_m, 0.3),
//!     // The radial part of 1 m/s along y.
//!     (strongest.velocity_mps, 0.92),
//! ] {
//!     assert!((found - expected).abs() < 0.07, "{found}, expected {expected}");
//! }
//! # Ok::<(), radarllm_radar_dsp::DspError>(())
//! ```
//!
//! The input is a [`radarllm_base::RadarCube`]. The signal chain does not distinguish simulated cubes from captured
//! ones.
//! The output is a [`radarllm_base::PointFrame`], or the data of a picture as a [`Map`].
//!
//! # Conventions
//!
//! - **Cube order**: `[loop, transmitter slot, receiver, sample]`, sample fastest.
//! - **Doppler sign**: receding is positive.
//! - **Transforms**: forward and not normalised. The windows are symmetric and not normalised either.
//! - **Decibels**: `intensity_db` is relative to one squared sample unit in the detection map.
//!
//! CONVENTIONS.md at the repository root fixes these with worked numbers and the tests that check them.
//!
//! The chain is planned once and run many times: [`PointExtractor::new`] builds the windows, the FFT plans, the virtual
//! array and the detection threshold. [`PointExtractor::extract`] then allocates nothing but its result.
//!
//! Reading order: [`extractor`] (the chain), [`options`], [`spectrum`] (range and Doppler), [`detect`] (detection),
//! [`mod@array`] and [`direction`] (angle estimation), [`capon`] (detection of another firmware), [`pictures`]. Two modules precede the chain: [`mod@correct`]
//! (background subtraction, offset and leakage removal) and [`mod@calibrate`] (channel gains from a reflector).
//!
//! Out of scope: anything about people, files, or the origin of a cube.

#![cfg_attr(
    test,
    allow(clippy::disallowed_methods, unreachable_pub, reason = "tests")
)]

pub mod array;
pub mod calibrate;
pub mod capon;
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
pub use capon::{CaponDetection, CaponScan, MapCfar};
pub use correct::{Background, Corrections, Corrector, EmptyRoom};
pub use error::DspError;
pub use extractor::PointExtractor;
pub use options::{
    CfarSides, ClutterFilter, Detector, DopplerCfar, DspOptions, ImpossibleDirection, MapKind,
    PeakGrouping,
};
pub use pictures::{Axis, Map, MicroDoppler};
pub use window::Window;

#[cfg(test)]
mod tests {
    /// Uniform pseudo-random numbers in -1..1 for tests.
    pub fn uniform(seed: u32) -> impl FnMut() -> f32 {
        let mut state = seed;
        move || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 23) as f32 - 1.0
        }
    }
}
