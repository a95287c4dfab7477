//! The error type of this crate and of the library's public interface: kind, message, hint, path.

use std::{
    fmt,
    path::{Path, PathBuf},
};

use radarllm_dataset::DatasetError;

/// Kind of an error, for programs that handle kinds differently.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ErrorKind {
    /// The input or an option is wrong, for example a damaged file or inconsistent values.
    Input,
    /// A file, folder, port or name does not exist.
    NotFound,
    /// The input is fine, but this build or this system cannot process it.
    Unsupported,
    /// The output already exists.
    Exists,
    /// Another process holds a lock on the output.
    Locked,
    /// The user interrupted the work.
    Interrupted,
}

/// An error that describes what happened, where, and how the user can resolve it.
///
/// Messages and hints name options of this library in backticks, as `` `frame_rate_hz` ``. Programs that use other
/// names for them (a command line, a language binding) may translate those.
///
/// A program whose `main` returns this error prints the message and the hint as readable text:
///
/// ```
/// use radarllm_io::Error;
///
/// let error = Error::input("room.dat: no frame rate").with_hint("`frame_rate` sets it");
/// assert_eq!(format!("{error:?}"), "room.dat: no frame rate\nhint: `frame_rate` sets it");
/// ```
#[derive(Clone, PartialEq, Eq)]
pub struct Error {
    /// Kind of the error.
    pub kind: ErrorKind,
    /// What happened, with the file and the position in it.
    pub message: String,
    /// How the user can resolve the error.
    pub hint: Option<String>,
    /// The file or folder concerned.
    pub path: Option<PathBuf>,
}

/// Result type of this crate.
pub type Result<T = ()> = std::result::Result<T, Error>;

impl Error {
    /// Creates an error about the input or the options.
    pub fn input(message: impl fmt::Display) -> Self {
        Self {
            kind: ErrorKind::Input,
            message: message.to_string(),
            hint: None,
            path: None,
        }
    }

    /// Creates an error about a file. The message begins with the name of the file.
    pub fn in_file(path: &Path, problem: impl fmt::Display) -> Self {
        Self {
            path: Some(path.into()),
            ..Self::input(format!("{}: {problem}", path.display()))
        }
    }

    /// Creates an error from an error of the operating system on a file.
    pub fn io(path: &Path, error: &std::io::Error) -> Self {
        use std::io::ErrorKind as Os;
        let kind = match error.kind() {
            Os::NotFound => ErrorKind::NotFound,
            Os::AlreadyExists => ErrorKind::Exists,
            Os::Unsupported => ErrorKind::Unsupported,
            _ => ErrorKind::Input,
        };
        Self {
            kind,
            ..Self::in_file(path, error)
        }
    }

    /// Returns the same error with another kind.
    #[must_use]
    pub fn of_kind(self, kind: ErrorKind) -> Self {
        Self { kind, ..self }
    }

    /// Returns the same error with a hint.
    #[must_use]
    pub fn with_hint(self, hint: impl fmt::Display) -> Self {
        Self {
            hint: Some(hint.to_string()),
            ..self
        }
    }

    /// Returns the same error with the name of the file before its message, unless the message already contains it.
    #[must_use]
    pub fn naming(self, path: &Path) -> Self {
        let name = path.display().to_string();
        if self.message.contains(&name) {
            return self;
        }
        Self {
            message: format!("{name}: {}", self.message),
            path: Some(path.into()),
            ..self
        }
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl fmt::Debug for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)?;
        match &self.hint {
            Some(hint) => write!(f, "\nhint: {hint}"),
            None => Ok(()),
        }
    }
}

impl std::error::Error for Error {}

/// Errors of the parser crates describe what is wrong with the input.
macro_rules! input_errors {
    ($($error:ty),+ $(,)?) => {$(
        impl From<$error> for Error {
            fn from(error: $error) -> Self {
                Self::input(error)
            }
        }
    )+};
}

input_errors!(
    radarllm_base::TimelineError,
    radarllm_formats::AdcError,
    radarllm_formats::TiCfgError,
    radarllm_radar_dsp::DspError,
    radarllm_tracking::OptionError,
);

impl From<DatasetError> for Error {
    fn from(error: DatasetError) -> Self {
        let (kind, path) = match &error {
            DatasetError::Exists { path } => (ErrorKind::Exists, Some(path)),
            DatasetError::Locked { dir } => (ErrorKind::Locked, Some(dir)),
            DatasetError::Interrupted { dir } => (ErrorKind::Interrupted, Some(dir)),
            DatasetError::Foreign { dir, .. }
            | DatasetError::Target { dir, .. }
            | DatasetError::NotADataset { dir } => (ErrorKind::Exists, Some(dir)),
            DatasetError::Unsuitable { dir, .. } => (ErrorKind::Unsupported, Some(dir)),
            DatasetError::NotPrepared { dir } => (ErrorKind::NotFound, Some(dir)),
            DatasetError::Disagreement { dir, .. } | DatasetError::Incomplete { dir, .. } => {
                (ErrorKind::Input, Some(dir))
            }
            DatasetError::Io { path, source, .. } => (Self::io(path, source).kind, Some(path)),
            DatasetError::Corrupt { path, .. }
            | DatasetError::Column { path, .. }
            | DatasetError::Value { path, .. }
            | DatasetError::Limit { path, .. }
            | DatasetError::Metadata { path, .. }
            | DatasetError::Stray { path } => (ErrorKind::Input, Some(path)),
            _ => (ErrorKind::Input, None),
        };
        let text = error.to_string();
        // Errors of data sets end with their hint.
        let (message, hint) = match text.split_once("; hint: ") {
            Some((message, hint)) => (message, Some(hint.to_string())),
            None => (text.as_str(), None),
        };
        Self {
            path: path.cloned(),
            hint,
            ..Self::input(message).of_kind(kind)
        }
    }
}

impl From<radarllm_files::bounded::ReadError> for Error {
    fn from(error: radarllm_files::bounded::ReadError) -> Self {
        use radarllm_files::bounded::ReadError;
        match error {
            ReadError::Io { path, source } => Self::io(&path, &source),
            ReadError::TooLarge { ref path, .. } | ReadError::NotUtf8 { ref path, .. } => Self {
                path: Some(path.clone()),
                ..Self::input(&error)
            },
        }
    }
}
