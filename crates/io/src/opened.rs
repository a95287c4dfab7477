//! A capture that is opened and identified once, for everything that reads it.

use std::{
    fs::{self, File},
    io::{Read, Seek},
    path::{Path, PathBuf},
    sync::Arc,
};

use radarllm_base::{Message, message::option};
use radarllm_files::{bounded, npy::NPY_MAGIC};
use radarllm_formats::{
    DetectError, Detected, RecordingFormat, SampleFormat, detect,
    detect::{HEAD_BYTES, detect_folder},
    folder::raw_capture_folder,
};

use crate::{
    compressed::{Unpacked, plain_name},
    error::{Error, Result},
    options::{CaptureFormat, CaptureOptions},
    points::frames_folder,
    serial, udp, visualizer,
};

/// Maximum size of a file that is read at once, in bytes.
pub(crate) const MAX_FILE_BYTES: u64 = 1 << 30;

/// Content of a recording.
#[derive(Clone, Debug, PartialEq)]
pub enum RecordingKind {
    /// Raw samples.
    Samples(SampleFormat),
    /// Points that a radar's firmware detected.
    Points(Detected),
    /// A points file of this project.
    PointsFile,
}

/// A capture whose content is known. The file that was opened to look at its first bytes is the one that is read. A file
/// that is compressed as a whole is unpacked.
#[derive(Debug)]
pub struct Opened {
    captures: Vec<PathBuf>,
    kind: RecordingKind,
    first: FirstFile,
}

/// The first file of a capture.
#[derive(Debug, Default)]
struct FirstFile {
    /// The file, if it is open.
    file: Option<File>,
    /// What it became, if it is compressed and was opened before.
    unpacked: Option<Arc<Unpacked>>,
}

impl FirstFile {
    /// Opens a file, unpacked if it is compressed.
    fn open(path: &Path) -> Result<Self> {
        let mut file = File::open(path).map_err(|e| Error::io(path, e))?;
        let Some(unpacked) = Unpacked::of(path, &mut file)? else {
            return Ok(Self {
                file: Some(file),
                unpacked: None,
            });
        };
        let file = File::open(unpacked.path()).map_err(|e| Error::io(path, e))?;
        Ok(Self {
            file: Some(file),
            unpacked: Some(Arc::new(unpacked)),
        })
    }
}

/// A format, and the file that was opened to detect it.
type Identified = (Detected, FirstFile);

impl Opened {
    /// Opens a capture and determines its content from the named format, from options that only raw samples have, or from
    /// its first bytes. Several paths are parts of one recording of raw samples.
    ///
    /// # Errors
    /// A recording that cannot be read, or whose format is neither named nor detected.
    pub fn open(captures: &[PathBuf], options: &CaptureOptions) -> Result<Self> {
        let first = first(captures)?;
        Self::identify(captures, options)?.map_err(|e| detect_error(first, e))
    }

    /// As [`Self::open`]. The inner error describes why the format could not be detected.
    ///
    /// # Errors
    /// A recording that cannot be read.
    pub fn identify(
        captures: &[PathBuf],
        options: &CaptureOptions,
    ) -> Result<std::result::Result<Self, DetectError>> {
        let captures = match files_of_folder(captures)? {
            Ok(captures) => captures,
            Err(error) => return Ok(Err(error)),
        };
        let captures = &captures[..];
        let path = first(captures)?;
        let named = options.format;
        let holds_samples = udp::address(&path.to_string_lossy()).is_some()
            || named.is_some_and(CaptureFormat::holds_samples)
            || (named.is_none() && options.layout.is_given());
        if holds_samples {
            return Self::samples(captures, named).map(Ok);
        }
        let named_points = match named {
            Some(CaptureFormat::Format(format)) => Some(format),
            _ => None,
        };
        let has_columns = options.points.columns.is_some();
        let (detected, file) = match identify(path, named_points, has_columns)? {
            Ok(found) => found,
            Err(error) => return Ok(Err(error)),
        };
        let opened = |kind, first| Self {
            captures: captures.to_vec(),
            kind,
            first,
        };
        Ok(Ok(match detected.format {
            RecordingFormat::Adc | RecordingFormat::Dca1000 => {
                Self::samples_in(captures, named, file)?
            }
            RecordingFormat::Points => opened(RecordingKind::PointsFile, file),
            _ => opened(RecordingKind::Points(detected), file),
        }))
    }

    /// Opens a capture that holds raw samples, in the named format or in the one that its first bytes show.
    ///
    /// # Errors
    /// A file that cannot be read, that does not begin like the named format, or that is in none of the known formats.
    pub fn samples(captures: &[PathBuf], named: Option<CaptureFormat>) -> Result<Self> {
        Self::samples_in(captures, named, FirstFile::default())
    }

    fn samples_in(
        captures: &[PathBuf],
        named: Option<CaptureFormat>,
        first_file: FirstFile,
    ) -> Result<Self> {
        let path = first(captures)?;
        let mut opened = Self {
            captures: captures.to_vec(),
            kind: RecordingKind::Samples(SampleFormat::Udp),
            first: first_file,
        };
        if udp::address(&path.to_string_lossy()).is_some() {
            return Ok(opened);
        }
        let mut file = opened.take_first()?;
        let mut start = Vec::new();
        file.by_ref()
            .take(SampleFormat::HEAD_BYTES as u64)
            .read_to_end(&mut start)
            .map_err(|e| Error::io(path, e))?;
        opened.kind = RecordingKind::Samples(sample_format(path, &start, named)?);
        opened.first.file = Some(file);
        Ok(opened)
    }

    /// The same capture to be read once more: its content is known, and its files are opened when they are read.
    #[must_use]
    pub fn again(&self) -> Self {
        Self {
            captures: self.captures.clone(),
            kind: self.kind.clone(),
            first: FirstFile {
                file: None,
                unpacked: self.first.unpacked.clone(),
            },
        }
    }

    /// A file of a folder that is a ROS 2 bag.
    #[cfg(feature = "ros2")]
    pub(crate) fn ros2_bag(path: &Path) -> Self {
        let format = RecordingFormat::Ros2Bag;
        let reason = "a file of the folder".into();
        Self {
            captures: vec![path.into()],
            kind: RecordingKind::Points(Detected { format, reason }),
            first: FirstFile::default(),
        }
    }

    /// The content.
    pub fn kind(&self) -> &RecordingKind {
        &self.kind
    }

    /// The paths as named, at least one.
    pub fn captures(&self) -> &[PathBuf] {
        &self.captures
    }

    /// The first of the paths.
    pub fn path(&self) -> &Path {
        self.captures
            .first()
            .map_or(Path::new(""), PathBuf::as_path)
    }

    /// The storage format of raw samples.
    pub(crate) fn sample_format(&self) -> Result<SampleFormat> {
        match self.kind {
            RecordingKind::Samples(format) => Ok(format),
            _ => Err(Error::in_file(
                self.path(),
                "it holds points, not raw samples",
            )),
        }
    }

    /// The path of a recording in one file or folder.
    pub(crate) fn only_path(&self) -> Result<&Path> {
        match &self.captures[..] {
            [path] => Ok(path),
            _ => Err(Error::input(
                "recorded points are read one capture at a time",
            )),
        }
    }

    /// The path at which the first file can be read: that of the capture, or where it was unpacked once it was taken.
    #[cfg(feature = "ros2")]
    pub(crate) fn readable_path(&self) -> &Path {
        let unpacked = self.first.unpacked.as_deref();
        unpacked.map_or(self.path(), Unpacked::path)
    }

    /// The first file, unpacked, at its first byte.
    pub(crate) fn take_first(&mut self) -> Result<File> {
        let file = match (self.first.file.take(), &self.first.unpacked) {
            (Some(mut file), _) => file.rewind().map(|()| file),
            (None, Some(unpacked)) => File::open(unpacked.path()),
            (None, None) => {
                self.first = FirstFile::open(self.path())?;
                self.first
                    .file
                    .take()
                    .ok_or_else(|| std::io::ErrorKind::NotFound.into())
            }
        };
        file.map_err(|e| Error::io(self.path(), e))
    }

    /// All files, at their first bytes.
    pub(crate) fn take_all(&mut self) -> Result<Vec<File>> {
        let mut files = vec![self.take_first()?];
        for path in &self.captures[1..] {
            // An unpacked file is removed at once: it can be read as long as it is open.
            files.extend(FirstFile::open(path)?.file);
        }
        Ok(files)
    }

    /// All bytes of the first file.
    pub(crate) fn bytes(&mut self) -> Result<Vec<u8>> {
        let file = self.take_first()?;
        Ok(bounded::read_bytes_from(file, self.path(), MAX_FILE_BYTES)?)
    }

    /// The text of the first file.
    pub(crate) fn text(&mut self) -> Result<String> {
        Ok(bounded::text_of(self.bytes()?, self.path())?)
    }
}

/// The captures, or the files of a folder that holds a raw capture and no recording of points.
fn files_of_folder(captures: &[PathBuf]) -> Result<std::result::Result<Vec<PathBuf>, DetectError>> {
    let [folder] = captures else {
        return Ok(Ok(captures.to_vec()));
    };
    if !folder.is_dir() {
        return Ok(Ok(captures.to_vec()));
    }
    let names = visualizer::file_names(folder)?;
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let is_other = !matches!(
        detect_folder(names.iter().copied()),
        Err(DetectError::Unknown(_))
    );
    if is_other {
        return Ok(Ok(captures.to_vec()));
    }
    Ok(match raw_capture_folder(&names) {
        Ok(Some(files)) => Ok(files.into_iter().map(|name| folder.join(name)).collect()),
        Ok(None) => Ok(captures.to_vec()),
        Err(error) => Err(error),
    })
}

fn first(captures: &[PathBuf]) -> Result<&Path> {
    match captures.first() {
        Some(first) => Ok(first),
        None => Err(Error::input("no capture is named")),
    }
}

/// The format of a recording, as named or as detected. A file of which the caller names the columns is a table.
fn identify(
    path: &Path,
    named: Option<RecordingFormat>,
    has_columns: bool,
) -> Result<std::result::Result<Identified, DetectError>> {
    if let Some(format) = named {
        let reason = "as named".into();
        return Ok(Ok((Detected { format, reason }, FirstFile::default())));
    }
    let info = fs::metadata(path).map_err(|e| Error::io(path, e))?;
    if info.is_dir() {
        let names = visualizer::file_names(&frames_folder(path))?;
        let detected = detect_folder(names.iter().map(String::as_str));
        return Ok(detected.map(|detected| (detected, FirstFile::default())));
    }
    if serial::is_port(path) {
        let reason = "a serial port".into();
        let format = RecordingFormat::Uart;
        return Ok(Ok((Detected { format, reason }, FirstFile::default())));
    }
    if !info.is_file() {
        return Err(Error::in_file(path, "a pipe can be read only once")
            .with_hint(option("format").text(" names its format")));
    }
    let mut head = Vec::new();
    let first = FirstFile::open(path)?;
    if let Some(mut file) = first.file.as_ref() {
        file.by_ref()
            .take(HEAD_BYTES as u64)
            .read_to_end(&mut head)
            .map_err(|e| Error::io(path, e))?;
    }
    if has_columns {
        let format = match head.starts_with(NPY_MAGIC) {
            true => RecordingFormat::NpyPoints,
            false => RecordingFormat::Csv,
        };
        let reason = "its columns are named".into();
        return Ok(Ok((Detected { format, reason }, first)));
    }
    Ok(detect(&plain_name(path), &head).map(|detected| (detected, first)))
}

/// Turns an error of detection into one with the name of the file and a hint.
pub fn detect_error(path: &Path, error: DetectError) -> Error {
    if matches!(error, DetectError::UnknownTable { .. }) {
        return Error::wrap_in_file(path, error).with_hint(columns_hint());
    }
    let names = RecordingFormat::ALL.map(RecordingFormat::name).join(", ");
    Error::wrap_in_file(path, error).with_hint(option("format").text(format!(" names it: {names}")))
}

/// How a table whose columns are not known is read.
pub(crate) fn columns_hint() -> Message {
    option("columns").text(
        " names them in their order, for example frame,x,y,z,velocity,snr with - for a column to skip",
    )
}

/// The format of raw samples that begin with `start`.
fn sample_format(path: &Path, start: &[u8], named: Option<CaptureFormat>) -> Result<SampleFormat> {
    let found = SampleFormat::of_start(start);
    let unlike = |format: &str| Error::in_file(path, format!("does not begin like {format}"));
    let format_reads = |read: &'static str| option("format").text(read);
    match (named, found) {
        (Some(CaptureFormat::Npy), Some(SampleFormat::Npy)) => Ok(SampleFormat::Npy),
        (Some(CaptureFormat::Npy), _) => Err(unlike("an npy file")),
        (Some(CaptureFormat::Format(RecordingFormat::Adc)), found) => match found {
            Some(SampleFormat::Npy) => {
                Err(unlike("raw words, but an npy file").with_hint(format_reads(" npy reads it")))
            }
            Some(SampleFormat::Records) => Ok(SampleFormat::Records),
            _ => Ok(SampleFormat::Adc),
        },
        (Some(CaptureFormat::Format(RecordingFormat::Dca1000)), found) => match found {
            Some(format @ (SampleFormat::Records | SampleFormat::Pcap)) => Ok(format),
            _ => Err(
                unlike("packets: neither pcap nor records").with_hint(format_reads(
                    " adc reads adc_data.bin; udp:PORT listens to the card",
                )),
            ),
        },
        (Some(other), _) => Err(Error::input(
            option("format").text(format!(" {}: not a format of raw samples", other.name())),
        )
        .with_hint("adc, dca1000 and npy are")),
        (None, Some(format)) => Ok(format),
        (None, None) => match path.extension().and_then(|e| e.to_str()) {
            Some("bin") => Ok(SampleFormat::Adc),
            _ => Err(Error::in_file(
                path,
                "neither npy nor pcap nor records of packets, and not named .bin",
            )
            .with_hint(format_reads(" adc reads any file as raw words"))),
        },
    }
}
