//! Errors of the simulator: the reasons for which a frame cannot be simulated.

use radarllm_base::radar_config::RadarConfigError;

/// Errors of planning and of simulating a frame. Indices count from 0 in the scene's order.
#[derive(Debug, thiserror::Error, PartialEq)]
#[non_exhaustive]
pub enum SimError {
    /// The radar configuration is invalid.
    #[error(transparent)]
    Config(#[from] RadarConfigError),
    /// An option is out of its range.
    #[error("simulation option {option}: {problem}")]
    Option {
        /// Field name.
        option: &'static str,
        /// What is wrong, with numbers.
        problem: String,
    },
    /// The caller's cube does not have the radar's shape.
    #[error(
        "cube has shape {found:?} and {found_len} samples, the radar needs {expected:?} \
         [loop, tx, rx, sample]"
    )]
    CubeShape {
        /// Shape the radar needs.
        expected: [usize; 4],
        /// Shape of the cube.
        found: [usize; 4],
        /// Length of the cube's data.
        found_len: usize,
    },
    /// Frame time is NaN or infinite.
    #[error("frame time {time_s} s is not finite")]
    Time {
        /// The time, s.
        time_s: f64,
    },
    /// A triangle refers to a vertex that does not exist.
    #[error(
        "surface {surface}, triangle {triangle}: vertex {vertex} of a surface with {n_vertices}"
    )]
    TriangleIndex {
        /// Surface index.
        surface: usize,
        /// Triangle index.
        triangle: usize,
        /// Index of the missing vertex.
        vertex: u32,
        /// Number of vertices.
        n_vertices: usize,
    },
    /// A vertex position is NaN or infinite, or farther than a kilometre.
    #[error(
        "surface {surface}, vertex {vertex}, time {time_s} s: position {position:?} m is not usable"
    )]
    Position {
        /// Surface index.
        surface: usize,
        /// Vertex index.
        vertex: usize,
        /// Time, s.
        time_s: f64,
        /// The position, m.
        position: [f32; 3],
    },
    /// Something is inside the antenna.
    #[error(
        "{what} {index} is {range_m:.4} m from the array at {time_s} s, less than {min_range_m} m"
    )]
    TooClose {
        /// "surface" or "point target".
        what: &'static str,
        /// Index of it.
        index: usize,
        /// Distance from the array centre, m.
        range_m: f64,
        /// Minimum allowed distance, m.
        min_range_m: f64,
        /// Time, s.
        time_s: f64,
    },
    /// A material field is NaN, infinite or out of range.
    #[error("surface {surface}: material {field} = {value}")]
    Material {
        /// Surface index.
        surface: usize,
        /// Field name.
        field: &'static str,
        /// Its value.
        value: f32,
    },
    /// A point target's field is NaN, infinite or out of range.
    #[error("point target {point}: {field} is not usable")]
    Point {
        /// Point index.
        point: usize,
        /// Field name.
        field: &'static str,
    },
    /// Something moves through the whole range in one frame.
    #[error("a target's range changes by {change_m:.1} m during a frame, more than {limit_m:.1} m")]
    TooFast {
        /// Range change, m.
        change_m: f64,
        /// Maximum allowed value, m.
        limit_m: f64,
    },
    /// Requested signal-to-noise ratio is not usable.
    #[error("signal-to-noise ratio {snr_db} dB is not usable")]
    Snr {
        /// The ratio, dB.
        snr_db: f64,
    },
    /// More facets or vertices than 32-bit indices hold.
    #[error("the scene has {count} facets or vertices, more than {limit}")]
    TooMany {
        /// How many.
        count: usize,
        /// Maximum allowed value.
        limit: usize,
    },
}
