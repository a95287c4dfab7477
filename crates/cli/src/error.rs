//! Errors of the command: a cause, a hint, an exit code.

use std::{error::Error as StdError, fmt::Display, path::Path};

use radarllm_dataset::DatasetError;
use radarllm_io::{Error, ErrorKind};

/// An error that ends a command early.
#[derive(Debug)]
pub struct CliError {
    /// What happened, with file and place.
    pub cause: String,
    /// How the user can resolve it.
    pub hint: Option<String>,
    /// Whether no input explains it.
    pub is_bug: bool,
}

/// Result of a command.
pub(crate) type CliResult<T = ()> = Result<T, CliError>;

impl CliError {
    /// An error without a hint.
    pub fn new(cause: impl Display) -> Self {
        Self {
            cause: cause.to_string(),
            hint: None,
            is_bug: false,
        }
    }

    /// Adds a hint.
    pub fn hint(mut self, hint: impl Display) -> Self {
        self.hint = Some(hint.to_string());
        self
    }

    /// Writes cause and hint to stderr.
    pub(crate) fn report(&self) {
        note!("error: {}", self.cause);
        if let Some(hint) = &self.hint {
            note!("hint: {hint}");
        }
    }

    /// An I/O error on a file.
    pub fn io(path: &Path, error: std::io::Error) -> Self {
        Self::new(format!("{}: {error}", path.display()))
    }
}

impl<E: StdError + 'static> From<E> for CliError {
    /// Errors of the library bring their hint along; their options are named as the flags of the command.
    fn from(error: E) -> Self {
        let error: &(dyn StdError + 'static) = &error;
        let (cause, is_bug) = match error.downcast_ref::<Error>() {
            Some(error) => (
                error.message.with_options(flag),
                error.kind == ErrorKind::Bug,
            ),
            None => (error.to_string(), false),
        };
        Self {
            cause,
            hint: hint(error),
            is_bug,
        }
    }
}

/// For callbacks of the library that run code of the command. The flags are text by then.
impl From<CliError> for Error {
    fn from(error: CliError) -> Self {
        let cause = match error.is_bug {
            true => Self::bug(error.cause),
            false => Self::input(error.cause),
        };
        match error.hint {
            Some(hint) => cause.with_hint(hint),
            None => cause,
        }
    }
}

/// The first hint of an error and those behind it.
fn hint(error: &(dyn StdError + 'static)) -> Option<String> {
    let mut causes = std::iter::successors(Some(error), |&e| e.source());
    let hint = causes.find_map(|cause| {
        if let Some(error) = cause.downcast_ref::<Error>() {
            return error.hint.clone();
        }
        #[cfg(feature = "train")]
        if let Some(error) = cause.downcast_ref::<radarllm_train::harness::TrainError>() {
            return error.hint();
        }
        cause.downcast_ref::<DatasetError>()?.hint()
    })?;
    Some(hint.with_options(flag))
}

/// The flag that sets an option of the library: `--frame-rate` for `frame_rate`.
fn flag(option: &str) -> String {
    match option {
        "overwrite" => "--force".into(),
        _ => format!("--{}", option.replace('_', "-")),
    }
}

/// The requested operation needs the networks in burn, which are not part of this binary.
#[cfg(not(feature = "train"))]
pub(crate) fn needs_training(what: &str) -> CliError {
    CliError::new(format!(
        "{what} needs a build with the feature `train`, which this binary lacks"
    ))
    .hint("cargo build --release --locked -p radarllm-cli --features train")
}

/// A processor that cannot be used, after `what`.
#[cfg(feature = "train")]
pub(crate) fn processor_error(what: &str, error: &radarllm_nn::device::ProcessorError) -> CliError {
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
    use std::{collections::BTreeSet, fs};

    use clap::CommandFactory;
    use radarllm_base::message::{option, text};

    use super::*;

    fn flags(command: &clap::Command, found: &mut BTreeSet<String>) {
        let longs = command.get_arguments().filter_map(|a| a.get_long());
        found.extend(longs.map(|long| format!("--{long}")));
        command.get_subcommands().for_each(|c| flags(c, found));
    }

    /// The options that the source text of a folder names in messages: arguments of `option` and, in files that call
    /// `refuse_options`, the names in its tables.
    fn named_options(folder: &Path, found: &mut BTreeSet<String>) {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                named_options(&path, found);
                continue;
            }
            let text: String = fs::read_to_string(&path).unwrap_or_default();
            let text: String = text.split_whitespace().collect();
            let names = |mark: &str, end: &str| -> Vec<String> {
                let after = text.split(mark).skip(1);
                let names = after
                    .filter_map(|rest| rest.split_once(end))
                    .map(|(n, _)| n);
                let is_name = |n: &&str| {
                    !n.is_empty() && n.bytes().all(|b| b.is_ascii_lowercase() || b == b'_')
                };
                names.filter(is_name).map(Into::into).collect()
            };
            found.extend(names("option(\"", "\")"));
            if text.contains("refuse_options(") {
                found.extend(names("(\"", "\","));
            }
        }
    }

    /// A flag that is renamed must be renamed in the library too: hints would name a flag that does not exist.
    #[test]
    fn every_option_that_the_library_names_is_a_flag() {
        let mut known = BTreeSet::new();
        flags(&crate::args::Cli::command(), &mut known);
        let mut named = BTreeSet::new();
        let crates = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
        for folder in ["dataset", "io", "radarllm", "synth", "live"] {
            named_options(&crates.join(folder).join("src"), &mut named);
        }
        for expected in ["frame_rate", "iq", "lanes", "model", "overwrite", "topic"] {
            assert!(named.contains(expected), "{expected} in {named:?}");
        }
        for option in named {
            let flag = flag(&option);
            assert!(known.contains(&flag), "{flag} is not a flag of any command");
        }
    }

    #[test]
    fn options_of_the_library_become_flags() {
        let error = Error::input(option("iq").text(" is needed for radar `lanes`"))
            .with_hint(option("frame_rate").text(" HZ, or `radarllm radar list`"));
        let error = CliError::from(error);
        // A radar whose name is that of an option keeps it.
        assert_eq!(error.cause, "--iq is needed for radar `lanes`");
        assert_eq!(
            error.hint.as_deref(),
            Some("--frame-rate HZ, or `radarllm radar list`")
        );
    }

    #[test]
    fn hints_arrive_through_callbacks_and_wrapping_errors() {
        let cause = CliError::new("t.gif: unknown file type").hint("end the name in .svg");
        let error = CliError::from(Error::from(cause));
        assert_eq!(error.cause, "t.gif: unknown file type");
        assert_eq!(error.hint.as_deref(), Some("end the name in .svg"));

        let exists = || DatasetError::Exists { path: "a".into() };
        let errors = [
            CliError::from(exists()),
            CliError::from(Error::from(exists())),
            #[cfg(feature = "eval")]
            CliError::from(radarllm_eval::EvalError::from(exists())),
            CliError::from(radarllm_synth::SynthError::from(exists())),
        ];
        for error in errors {
            assert_eq!(error.cause, "a: already exists");
            assert_eq!(error.hint.as_deref(), Some("--force replaces it"));
        }
    }

    #[test]
    fn a_bug_is_called_one() {
        let error = CliError::from(Error::bug(text("shard 3 was not built")));
        assert_eq!(error.cause, "shard 3 was not built");
        assert!(error.is_bug && !CliError::from(Error::input("n")).is_bug);
    }
}
