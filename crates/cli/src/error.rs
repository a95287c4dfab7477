//! Errors of the command: a cause, a hint, an exit code.

use std::{fmt::Display, path::Path};

/// What ends a command early.
#[derive(Debug)]
pub struct CliError {
    /// What happened, with file and place.
    pub cause: String,
    /// What to do about it.
    pub hint: Option<String>,
}

/// Result of a command.
pub type CliResult<T = ()> = Result<T, CliError>;

impl CliError {
    /// An error without a hint.
    pub fn new(cause: impl Display) -> Self {
        Self {
            cause: cause.to_string(),
            hint: None,
        }
    }

    /// Adds a hint.
    pub fn hint(mut self, hint: impl Display) -> Self {
        self.hint = Some(hint.to_string());
        self
    }

    /// An I/O error on a file.
    pub fn io(path: &Path, error: std::io::Error) -> Self {
        Self::new(format!("{}: {error}", path.display()))
    }
}

/// Refuses the first of these options that is given; `why` follows its name.
pub fn refuse_options(options: &[(&str, bool)], why: &str) -> CliResult {
    match options.iter().find(|(_, is_given)| *is_given) {
        Some((option, _)) => Err(CliError::new(format!("{option} {why}"))),
        None => Ok(()),
    }
}

impl<E: std::error::Error> From<E> for CliError {
    fn from(error: E) -> Self {
        Self::new(error)
    }
}

/// What was asked needs the networks in burn, which this binary was built without.
#[cfg(not(feature = "train"))]
pub fn needs_training(what: &str) -> CliError {
    CliError::new(format!(
        "{what} needs a build with the feature `train`, which this binary lacks"
    ))
    .hint("cargo build --release --locked -p radarllm-cli --features train")
}
