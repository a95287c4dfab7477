//! The error type of this crate and of the library's public interface: kind, message, hint, path, source.

use std::{
    error::Error as StdError,
    fmt,
    path::{Path, PathBuf},
    sync::Arc,
};

use radarllm_base::message::{Message, text};
use radarllm_dataset::DatasetError;

/// Kind of an error, for programs that handle kinds differently.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ErrorKind {
    /// The input or an option is wrong, for example a damaged file or inconsistent values.
    Input,
    /// A file, folder, port or name does not exist.
    NotFound,
    /// The operating system refused or failed to read, write, connect or start something: permissions, a full disk, an
    /// address in use.
    Io,
    /// The input is fine, but this build or this system cannot process it.
    Unsupported,
    /// The output already exists.
    Exists,
    /// Another process holds a lock on the output.
    Locked,
    /// The user interrupted the work.
    Interrupted,
    /// The library contradicts itself; no input explains it.
    Bug,
}

/// An error that describes what happened, where, and how the user can resolve it.
///
/// Options are [pieces](radarllm_base::Piece) of the message and the hint, so that a program can write them as its
/// users know them ([`Message::with_options`]); [`fmt::Display`] writes their names in the library.
///
/// The message is complete: it contains the text of the source. [`std::error::Error::source`] leads to the error that
/// was wrapped, for programs that need its type.
///
/// A program whose `main` returns this error prints the message and the hint as readable text:
///
/// ```
/// use radarllm_base::message::option;
/// use radarllm_io::Error;
///
/// let hint = option("frame_rate").text(" sets it");
/// let error = Error::input("room.dat: no frame rate").with_hint(hint);
/// assert_eq!(format!("{error:?}"), "room.dat: no frame rate\nhint: `frame_rate` sets it");
/// ```
#[derive(Clone)]
#[non_exhaustive]
pub struct Error {
    /// Kind of the error.
    pub kind: ErrorKind,
    /// What happened, with the file and the position in it.
    pub message: Message,
    /// How the user can resolve the error.
    pub hint: Option<Message>,
    /// The file or folder concerned.
    pub path: Option<PathBuf>,
    /// The error of a parser, of the operating system or of another library that this one describes.
    pub source: Option<Arc<dyn StdError + Send + Sync>>,
}

/// Result type of this crate.
pub type Result<T = ()> = std::result::Result<T, Error>;

impl Error {
    /// Creates an error about the input or the options.
    pub fn input(message: impl Into<Message>) -> Self {
        Self {
            kind: ErrorKind::Input,
            message: message.into(),
            hint: None,
            path: None,
            source: None,
        }
    }

    /// Creates an error that no input explains.
    pub fn bug(message: impl Into<Message>) -> Self {
        Self::input(message).of_kind(ErrorKind::Bug)
    }

    /// Creates an error about a file. The message begins with the name of the file.
    pub fn in_file(path: &Path, problem: impl Into<Message>) -> Self {
        Self {
            path: Some(path.into()),
            ..Self::input(text(format!("{}: ", path.display())).then(problem.into()))
        }
    }

    /// Creates an error with the text of another one, which becomes its source. Where the operating system is behind
    /// that error, the kind is that of [`Self::io`], otherwise [`ErrorKind::Input`].
    pub fn wrap(source: impl StdError + Send + Sync + 'static) -> Self {
        Self::input(source.to_string()).caused_by(source)
    }

    /// As [`Self::wrap`], for an error in a file. The message begins with the name of the file.
    pub fn wrap_in_file(path: &Path, source: impl StdError + Send + Sync + 'static) -> Self {
        Self::in_file(path, source.to_string()).caused_by(source)
    }

    /// Creates an error from an error of the operating system on a file.
    pub fn io(path: &Path, source: std::io::Error) -> Self {
        Self::wrap_in_file(path, source)
    }

    /// Returns the same error with a source. Where the operating system is behind the source, the kind is that of
    /// [`Self::io`].
    #[must_use]
    pub fn caused_by(self, source: impl StdError + Send + Sync + 'static) -> Self {
        Self {
            kind: kind_of_cause(&source).unwrap_or(self.kind),
            source: Some(Arc::new(source)),
            ..self
        }
    }

    /// Returns the same error with another kind.
    #[must_use]
    pub fn of_kind(self, kind: ErrorKind) -> Self {
        Self { kind, ..self }
    }

    /// Returns the same error with a hint.
    #[must_use]
    pub fn with_hint(self, hint: impl Into<Message>) -> Self {
        Self {
            hint: Some(hint.into()),
            ..self
        }
    }

    /// Returns the same error with the name of the file before its message, unless the message already contains it.
    #[must_use]
    pub fn naming(self, path: &Path) -> Self {
        let name = path.display().to_string();
        if self.message.to_string().contains(&name) {
            return self;
        }
        Self {
            message: text(format!("{name}: ")).then(self.message),
            path: Some(path.into()),
            ..self
        }
    }
}

/// The kind of an error behind which is one of the operating system.
fn kind_of_cause(error: &(dyn StdError + 'static)) -> Option<ErrorKind> {
    let mut causes = std::iter::successors(Some(error), |&e| e.source());
    causes.find_map(|cause| {
        if let Some(error) = cause.downcast_ref::<std::io::Error>() {
            return Some(kind_of_system(error.kind()));
        }
        Some(cause.downcast_ref::<Error>()?.kind)
    })
}

fn kind_of_system(kind: std::io::ErrorKind) -> ErrorKind {
    use std::io::ErrorKind as System;
    match kind {
        System::NotFound => ErrorKind::NotFound,
        System::AlreadyExists => ErrorKind::Exists,
        System::Unsupported => ErrorKind::Unsupported,
        // Readers of the standard library and of archives say so about the content of files.
        System::InvalidData | System::InvalidInput | System::UnexpectedEof => ErrorKind::Input,
        _ => ErrorKind::Io,
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.message.fmt(f)
    }
}

impl fmt::Debug for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(&self.message, f)?;
        match &self.hint {
            Some(hint) => write!(f, "\nhint: {hint}"),
            None => Ok(()),
        }
    }
}

impl StdError for Error {
    fn source(&self) -> Option<&(dyn StdError + 'static)> {
        let source: &(dyn StdError + 'static) = self.source.as_deref()?;
        Some(source)
    }
}

/// Errors of the parser crates describe what is wrong with the input.
macro_rules! wrapped_errors {
    ($($error:ty),+ $(,)?) => {$(
        impl From<$error> for Error {
            fn from(error: $error) -> Self {
                Self::wrap(error)
            }
        }
    )+};
}

wrapped_errors!(
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
            DatasetError::Io { path, source, .. } => (kind_of_system(source.kind()), Some(path)),
            DatasetError::Corrupt { path, .. }
            | DatasetError::Changed { path, .. }
            | DatasetError::Column { path, .. }
            | DatasetError::Value { path, .. }
            | DatasetError::Limit { path, .. }
            | DatasetError::Metadata { path, .. }
            | DatasetError::Stray { path } => (ErrorKind::Input, Some(path)),
            _ => (ErrorKind::Input, None),
        };
        Self {
            path: path.cloned(),
            hint: error.hint(),
            ..Self::wrap(error).of_kind(kind)
        }
    }
}

impl From<radarllm_files::bounded::ReadError> for Error {
    fn from(error: radarllm_files::bounded::ReadError) -> Self {
        use radarllm_files::bounded::ReadError;
        match error {
            ReadError::Io { path, source } => Self::io(&path, source),
            ReadError::TooLarge { ref path, .. } | ReadError::NotUtf8 { ref path, .. } => Self {
                path: Some(path.clone()),
                ..Self::wrap(error)
            },
            other => Self::wrap(other),
        }
    }
}

#[cfg(test)]
mod tests {
    use radarllm_base::message::option;

    use super::*;

    fn causes(error: &Error) -> impl Iterator<Item = &(dyn StdError + 'static)> {
        std::iter::successors(error.source(), |&e| e.source())
    }

    #[test]
    fn the_source_of_a_missing_file_is_the_error_of_the_system() {
        let error = crate::read_recording(&["no/such/file.dat".into()], &Default::default());
        let error = error.err().unwrap();
        assert_eq!(error.kind, ErrorKind::NotFound);
        let system = causes(&error).find_map(|e| e.downcast_ref::<std::io::Error>());
        assert_eq!(system.unwrap().kind(), std::io::ErrorKind::NotFound);

        let missing = radarllm_dataset::Dataset::open(Path::new("no/such/folder"));
        let error = Error::from(missing.err().unwrap());
        let dataset = causes(&error).find_map(|e| e.downcast_ref::<DatasetError>());
        assert!(matches!(dataset, Some(DatasetError::Io { .. })));
        assert!(causes(&error).any(|e| e.is::<std::io::Error>()));
    }

    #[test]
    fn the_kind_of_a_wrapped_error_is_that_of_its_cause() {
        use std::io::ErrorKind as System;
        let of = |kind: System| Error::io(Path::new("a"), kind.into()).kind;
        assert_eq!(of(System::PermissionDenied), ErrorKind::Io);
        assert_eq!(of(System::NotFound), ErrorKind::NotFound);
        assert_eq!(of(System::UnexpectedEof), ErrorKind::Input);
        let outer = Error::wrap(Error::bug("two and two"));
        assert_eq!(outer.kind, ErrorKind::Bug);
        assert!(outer.source().is_some_and(|e| e.is::<Error>()));
    }

    /// Hints of data sets are fields, not the end of a message.
    #[test]
    fn hints_of_data_sets_are_fields_with_options() {
        let error = Error::from(DatasetError::Exists { path: "a".into() });
        assert_eq!(error.to_string(), "a: already exists");
        let hint = option("overwrite").text(" replaces it");
        assert_eq!(error.hint, Some(hint));
    }
}
