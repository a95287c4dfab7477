//! The virtual radar: simulates the raw samples that an FMCW TDM-MIMO radar would record of moving surfaces.
//!
//! It replaces a radar board where none is available. It also provides what recordings lack: the exact motion, and the
//! signal that a different radar in a different position would have recorded.
//!
//! ```
//! use glam::DVec3;
//! use radarllm_base::RadarConfig;
//! use radarllm_radar_sim::{Noise, PointTarget, Scene, SimOptions, Simulator};
//!
//! // A reflector of 1 m^2, 3 m in front of the radar, receding at 1 m/s.
//! let target = PointTarget {
//!     position_m: DVec3::new(0.0, 3.0, 0.0),
//!     velocity_mps: DVec3::new(0.0, 1.0, 0.0),
//!     rcs_m2: 1.0,
//! };
//! let scene = Scene { surfaces: vec![], points: vec![target], noise: Noise::Thermal };
//!
//! // Plan a radar once, then simulate frame after frame into the same cube.
//! let radar = RadarConfig::awr1843boost();
//! let mut simulator = Simulator::new(&radar, SimOptions::default())?;
//! let mut cube = simulator.new_cube();
//! for frame_idx in 0..2 {
//!     let time_s = frame_idx as f64 * radar.frame_period_s;
//!     let stats = simulator.simulate_frame(&scene, frame_idx, time_s, 42, &mut cube)?;
//!     assert!(stats.signal_power_w > stats.noise_power_w);
//! }
//! // [loop, transmitter slot, receiver, sample]
//! assert_eq!(cube.data.len(), 128 * 3 * 4 * 256);
//! # Ok::<(), radarllm_radar_sim::SimError>(())
//! ```
//!
//! Surfaces are triangle meshes with a material. A metal sphere of 10 cm radius that crosses the view:
//!
//! ```
//! use glam::DVec3;
//! use radarllm_base::{Material, RadarConfig};
//! use radarllm_radar_sim::{Impairments, Noise, Scene, SimOptions, Simulator, shapes::RigidSurface};
//!
//! let metal = Material { power_reflection: 1.0, roughness_m: 0.0, rough_albedo: 0.0, power_transmission: 0.0 };
//! let sphere = RigidSurface::sphere(0.1, 0.02)
//!     .at(DVec3::new(-0.5, 2.0, 0.0))
//!     .moving(DVec3::new(0.8, 0.0, 0.0))
//!     .of(metal);
//! let scene = Scene { surfaces: vec![&sphere], points: vec![], noise: Noise::Thermal };
//!
//! let radar = RadarConfig::awr1843boost();
//! let mut simulator = Simulator::new(&radar, SimOptions::default())?;
//! let mut cube = simulator.new_cube();
//! let stats = simulator.simulate_frame(&scene, 0, 0.0, 42, &mut cube)?;
//! // Only the hemisphere that faces the radar is visible.
//! assert!(0 < stats.n_visible && stats.n_visible < stats.n_facets);
//!
//! // Add the impairments of a real receiver: leakage, phase noise, channel mismatch, a 12-bit ADC.
//! Impairments::typical().apply(&radar, &mut cube, 42, 0)?;
//! # Ok::<(), radarllm_radar_sim::SimError>(())
//! ```
//!
//! # Units, axes, signs
//!
//! Input: a [`Scene`] of [`radarllm_base::MovingSurface`]s and point targets in the radar frame: x right, y along the
//! boresight, z up, metres.
//! Output: a [`radarllm_base::RadarCube`] in square-root watts, one frame at a time. Receding targets have positive
//! Doppler, and a longer delay advances the phase. CONVENTIONS.md at the repository root has a worked number for each
//! convention.
//!
//! # Model
//!
//! The IF signal of a path with delay tau is `a exp j[2 pi f0 tau + 2 pi S t tau - pi S tau^2]`, with `t` measured from
//! the ramp start. The delay tau and its rate follow from the exact TX-facet-RX distances at the centre of each chirp's
//! ADC window. TDM timing, range migration and near-field wave fronts are therefore exact.
//!
//! During an ADC window (58 us for the reference radar), the delay of a moving target changes. The resulting change of
//! the carrier phase shifts the beat frequency, which corresponds to a range offset of f_c v / S (range-Doppler
//! coupling). The change of the sweep term, 0.01 rad at 4.5 m/s, is neglected.
//!
//! # Reading order
//!
//! There are two implementations of the same model: [`Simulator`] (fast) and [`mod@reference`] (direct sum in f64,
//! slow). They are tested against each other.
//!
//! Reading order: [`scene`], [`link`] (radar equation), [`scatter`] (scattering by one triangle), [`visibility`]
//! (tested by [`rays`]), [`simulator`] (the pipeline and its optimisations). Its stages follow: `motion` and `facets`
//! (polynomials over a segment), `bounce` (paths over several surfaces), `still` (surfaces that stand still), `slow_time`
//! (Doppler groups), `gridding` and `spread` (range grid), `transform` (range FFT), [`weather`], [`noise`], and
//! [`impairments`] (effects of real receivers, applied to a finished cube).
//!
//! Out of scope: polarisation, diffraction, and any notion of a human.

#![cfg_attr(
    test,
    allow(clippy::disallowed_methods, unreachable_pub, reason = "tests")
)]

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
mod still;
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
