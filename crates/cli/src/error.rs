//! Errors of the command: a cause, a hint, an exit code.

use std::{fmt::Display, path::Path};

/// An error that ends a command early.
#[derive(Debug)]
pub struct CliError {
    /// What happened, with file and place.
    pub cause: String,
    /// How the user can resolve it.
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

impl<E: std::error::Error + 'static> From<E> for CliError {
    /// Errors of the library bring their hint along; their options are named as the flags of the command.
    fn from(error: E) -> Self {
        match (&error as &dyn std::any::Any).downcast_ref::<radarllm_io::Error>() {
            Some(error) => Self {
                cause: with_flags(&error.message),
                hint: error.hint.as_deref().map(with_flags),
            },
            None => Self::new(error),
        }
    }
}

/// Options of the library whose flag has the same name with dashes.
const FLAGS: [&str; 27] = [
    "accumulate",
    "axes",
    "background",
    "background_cell",
    "background_share",
    "background_velocity",
    "calibration",
    "dialect",
    "format",
    "frame_rate",
    "frames",
    "iq",
    "lanes",
    "min_speed",
    "model",
    "orientation",
    "processing",
    "radar",
    "real",
    "remove_leakage",
    "remove_offset",
    "roll_deg",
    "seconds",
    "tilt_deg",
    "topic",
    "yaw_deg",
    "radar_height_m",
];

/// A text of the library with its options, which stand in backticks, as flags: `` `frame_rate` `` becomes
/// `--frame-rate`.
fn with_flags(text: &str) -> String {
    let mut flagged = text.to_string();
    for option in FLAGS {
        let flag = format!("--{}", option.replace('_', "-"));
        flagged = flagged.replace(&format!("`{option}`"), &flag);
    }
    flagged
}

/// The requested operation needs the networks in burn, which are not part of this binary.
#[cfg(not(feature = "train"))]
pub fn needs_training(what: &str) -> CliError {
    CliError::new(format!(
        "{what} needs a build with the feature `train`, which this binary lacks"
    ))
    .hint("cargo build --release --locked -p radarllm-cli --features train")
}

/// A processor that cannot be used, after `what`.
#[cfg(feature = "train")]
pub fn processor_error(what: &str, error: &radarllm_nn::device::ProcessorError) -> CliError {
    let cause = CliError::new(format!("{what}{error}"));
    match error {
        radarllm_nn::device::ProcessorError::NotBuilt { feature, .. } => cause.hint(format!(
            "cargo build --release --locked -p radarllm-cli --features {feature}"
        )),
        _ => cause,
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    /// A flag that is renamed must be renamed in the list too: hints would name a flag that does not exist.
    #[test]
    fn every_named_flag_exists() {
        fn flags(command: &clap::Command, found: &mut Vec<String>) {
            found.extend(
                command
                    .get_arguments()
                    .filter_map(|a| a.get_long())
                    .map(Into::into),
            );
            command.get_subcommands().for_each(|c| flags(c, found));
        }
        let mut found = Vec::new();
        flags(&crate::args::Cli::command(), &mut found);
        for option in FLAGS {
            let flag = option.replace('_', "-");
            assert!(
                found.contains(&flag),
                "--{flag} is not a flag of any command"
            );
        }
    }

    #[test]
    fn options_of_the_library_become_flags() {
        let error = radarllm_io::Error::input("`iq` is needed for radar `mine`")
            .with_hint("`frame_rate` HZ, or `radarllm radar list`");
        let error = CliError::from(error);
        assert_eq!(error.cause, "--iq is needed for radar `mine`");
        assert_eq!(
            error.hint.as_deref(),
            Some("--frame-rate HZ, or `radarllm radar list`")
        );
    }
}
