//! Errors of the engine.

/// Errors in weights, inputs and options.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum EngineError {
    /// The shape is invalid.
    #[error("engine: {field}: {problem}")]
    Shape {
        /// The field.
        field: &'static str,
        /// What is wrong, with numbers.
        problem: String,
    },
    /// A weight that the network needs is missing.
    #[error("engine: weight `{name}` of shape {expected:?} is missing")]
    MissingWeight {
        /// Name of the weight.
        name: String,
        /// Expected shape.
        expected: Vec<usize>,
    },
    /// A weight does not have the shape that the network needs.
    #[error("engine: weight `{name}`: shape {found:?} with {values} values, expected {expected:?}")]
    WeightShape {
        /// Name of the weight.
        name: String,
        /// Expected shape.
        expected: Vec<usize>,
        /// Shape found.
        found: Vec<usize>,
        /// Number of values found.
        values: usize,
    },
    /// A weight is NaN or infinite.
    #[error("engine: weight `{name}`: value {index} is not finite")]
    NotFinite {
        /// Name of the weight.
        name: String,
        /// Index of the first such value.
        index: usize,
    },
    /// A weight that the network does not have.
    #[error("engine: weight `{name}` is not part of this network")]
    UnknownWeight {
        /// Name of the weight.
        name: String,
    },
    /// An input does not fit the network.
    #[error("engine: input {index}: {problem}")]
    Input {
        /// Index among the inputs.
        index: usize,
        /// What is wrong, with numbers.
        problem: String,
    },
    /// An option is out of range.
    #[error("engine: option {field}: {problem}")]
    Option {
        /// Name of the option.
        field: &'static str,
        /// What is wrong, with numbers.
        problem: String,
    },
    /// The network produced a value that is not finite.
    #[error("engine: input {index}: the network's output is not finite")]
    Output {
        /// Index among the inputs.
        index: usize,
    },
    /// The caller cancelled the work.
    #[error("engine: cancelled")]
    Cancelled,
}
