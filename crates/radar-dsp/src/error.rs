//! Errors of the signal chain: the reasons for which a cube or an option is rejected.

use radarllm_base::radar_config::RadarConfigError;

/// Errors of this crate.
#[derive(Debug, thiserror::Error, PartialEq)]
#[non_exhaustive]
pub enum DspError {
    /// The radar configuration is invalid.
    #[error(transparent)]
    Radar(#[from] RadarConfigError),
    /// An option cannot be used with this radar.
    #[error("option `{field}`: {problem}")]
    Option {
        /// Name of the invalid option.
        field: &'static str,
        /// Description of the problem, with numbers.
        problem: String,
    },
    /// The cube has the shape of another radar.
    #[error("cube is [loop, tx, rx, sample] = {found:?}, the radar makes {expected:?}")]
    Shape {
        /// `[n_loops, n_tx, n_rx, n_samples]` of the plan.
        expected: [usize; 4],
        /// The shape of the cube, in the same order.
        found: [usize; 4],
    },
    /// The cube's data does not fill its shape.
    #[error("cube holds {found} samples, its shape {shape:?} needs {expected}")]
    Length {
        /// `[n_loops, n_tx, n_rx, n_samples]`.
        shape: [usize; 4],
        /// Number of samples that the shape requires.
        expected: usize,
        /// Number of samples found.
        found: usize,
    },
    /// A sample is NaN or infinite.
    #[error("sample [loop, tx, rx, sample] = {index:?} is not finite")]
    NotFinite {
        /// `[loop, tx, rx, sample]` of the first such sample of its channel.
        index: [usize; 4],
    },
    /// The frame time is not a number.
    #[error("frame time is not finite")]
    Time,
    /// Finite samples so large that their power leaves the range of `f32`.
    #[error(
        "the power at range bin {range_bin}, Doppler bin {doppler_bin} exceeds the range of f32"
    )]
    Overflow {
        /// Range bin, from 0.
        range_bin: usize,
        /// Signed Doppler bin.
        doppler_bin: i64,
    },
}
