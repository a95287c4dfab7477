//! What can go wrong in the engine.

/// Errors of weights and inputs.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum EngineError {
    /// A shape that cannot be.
    #[error("engine: {field}: {problem}")]
    Shape {
        /// The field.
        field: &'static str,
        /// What is wrong, with numbers.
        problem: String,
    },
    /// A weight that the network needs is not there.
    #[error("engine: weight `{name}` of shape {expected:?} is missing")]
    MissingWeight {
        /// Its name.
        name: String,
        /// Shape it should have.
        expected: Vec<usize>,
    },
    /// A weight of another shape than the network's.
    #[error("engine: weight `{name}`: shape {found:?} with {values} values, expected {expected:?}")]
    WeightShape {
        /// Its name.
        name: String,
        /// Shape it should have.
        expected: Vec<usize>,
        /// Shape found.
        found: Vec<usize>,
        /// Values found.
        values: usize,
    },
    /// A weight that is NaN or infinite.
    #[error("engine: weight `{name}`: value {index} is not finite")]
    NotFinite {
        /// Its name.
        name: String,
        /// Index of the first such value.
        index: usize,
    },
    /// A weight that the network lacks.
    #[error("engine: weight `{name}` is not part of this network")]
    UnknownWeight {
        /// Its name.
        name: String,
    },
    /// An input that does not fit the network.
    #[error("engine: input {index}: {problem}")]
    Input {
        /// Position among the inputs.
        index: usize,
        /// What is wrong, with numbers.
        problem: String,
    },
    /// An option out of range.
    #[error("engine: option {field}: {problem}")]
    Option {
        /// The option.
        field: &'static str,
        /// What is wrong, with numbers.
        problem: String,
    },
    /// The network gave a value that is not finite.
    #[error("engine: input {index}: the network's output is not finite")]
    Output {
        /// Position among the inputs.
        index: usize,
    },
    /// The caller asked to stop.
    #[error("engine: cancelled")]
    Cancelled,
}
