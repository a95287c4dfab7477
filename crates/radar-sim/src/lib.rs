//! The virtual radar: moving triangles in, FMCW radar cubes out.
//!
//! Enters: a [`Scene`] of [`radarllm_base::MovingSurface`]s and point targets in the radar frame.
//! Leaves: a [`radarllm_base::RadarCube`] in square-root watts, one frame at a time.
//!
//! The signal of a path with delay tau is `a exp j[2 pi f0 tau + 2 pi S t tau - pi S tau^2]`, `t`
//! from the ramp start. tau follows the exact TX-facet-RX distances at the centre of each chirp's
//! ADC window and its rate there (within the 58 us of one window the carrier turns with the moving
//! target, f_c v / S of beat frequency; the sweep's own part, 0.01 rad at 4.5 m/s, is left out), so TDM
//! timing, range walk and near-field wave fronts are exact.
//!
//! Two implementations of the same model: [`Simulator`] (fast) and [`mod@reference`] (direct sum in
//! f64, slow), tested against each other. Reading order: [`scene`], [`link`] (radar equation),
//! [`scatter`] (one triangle), [`visibility`] (tested by [`rays`]), [`simulator`] (the pipeline and how it is fast),
//! then its stages: `motion` and `facets` (polynomials over a segment), `bounce` (paths over several
//! surfaces), `slow_time` (Doppler groups),
//! `gridding` and `spread` (range grid), `transform` (range FFT), [`weather`], [`noise`], [`impairments`] (of real
//! receivers, laid over a finished cube).
//!
//! Deliberately absent: polarisation, diffraction, the notion of a human.

mod bounce;
pub mod error;
mod facets;
mod gridding;
mod groups;
pub mod impairments;
pub mod link;
mod motion;
pub mod noise;
pub mod rays;
pub mod reference;
pub mod scatter;
pub mod scene;
pub mod shapes;
pub mod simulator;
mod slow_time;
mod spread;
mod transform;
pub mod visibility;
pub mod weather;

pub use error::SimError;
pub use impairments::Impairments;
pub use radarllm_simd::SimdLevel;
pub use scene::{Noise, PointTarget, Scene};
pub use simulator::{FrameStats, SimOptions, Simulator, StageSeconds};
pub use visibility::Sampling;
pub use weather::Weather;
