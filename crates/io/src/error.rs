//! The error of everything that opens files and of the library's face: kind, message, hint, path.

use std::{
    fmt,
    path::{Path, PathBuf},
};

/// What kind of error it is, for programs that react to it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ErrorKind {
    /// The input or an option is wrong: a damaged file, values that do not fit together.
    Input,
    /// A file, folder, port or name does not exist.
    NotFound,
    /// The input is fine, but this build or this system cannot process it.
    Unsupported,
    /// The output exists already.
    Exists,
    /// Somebody else holds a lock on the output.
    Locked,
    /// The user interrupted the work.
    Interrupted,
}

/// An error that tells people what happened, where, and what they can do about it.
///
/// Messages and hints name options of this library in backticks, as `` `frame_rate_hz` ``; programs with other names
/// for them (a command line, a language binding) may translate those.
///
/// A program whose `main` returns this error prints message and hint as people read them:
///
/// ```
/// use radarllm_io::Error;
///
/// let error = Error::input("room.dat: no frame rate").with_hint("`frame_rate` sets it");
/// assert_eq!(format!("{error:?}"), "room.dat: no frame rate\nhint: `frame_rate` sets it");
/// ```
#[derive(Clone, PartialEq, Eq)]
pub struct Error {
    /// What kind of error it is.
    pub kind: ErrorKind,
    /// What happened, with the file and the place in it.
    pub message: String,
    /// What to do about it.
    pub hint: Option<String>,
    /// The file or folder concerned.
    pub path: Option<PathBuf>,
}

/// Result of everything that opens files.
pub type Result<T = ()> = std::result::Result<T, Error>;

impl Error {
    /// An error in the input or the options.
    pub fn input(message: impl fmt::Display) -> Self {
        Self {
            kind: ErrorKind::Input,
            message: message.to_string(),
            hint: None,
            path: None,
        }
    }

    /// An error in a file; the message begins with the file's name.
    pub fn in_file(path: &Path, problem: impl fmt::Display) -> Self {
        Self {
            path: Some(path.into()),
            ..Self::input(format!("{}: {problem}", path.display()))
        }
    }

    /// An error of the operating system on a file.
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

    /// The same error of another kind.
    #[must_use]
    pub fn of_kind(self, kind: ErrorKind) -> Self {
        Self { kind, ..self }
    }

    /// The same error with a hint.
    #[must_use]
    pub fn with_hint(self, hint: impl fmt::Display) -> Self {
        Self {
            hint: Some(hint.to_string()),
            ..self
        }
    }

    /// The same error with the file's name before its message, unless the message has it.
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

/// Errors of the crates below say what is wrong with the input.
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

impl From<radarllm_dataset::DatasetError> for Error {
    fn from(error: radarllm_dataset::DatasetError) -> Self {
        let kind = match &error {
            radarllm_dataset::DatasetError::Exists { .. } => ErrorKind::Exists,
            _ => ErrorKind::Input,
        };
        Self::input(error).of_kind(kind)
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
