//! Recordings that were compressed as a whole: gzip (`*.gz`) and Zstandard (`*.zst`, `*.zstd`), as `ros2 bag`, `logrotate`
//! and people write them.
//!
//! Readers seek in files, and SQLite opens them by name, so that a compressed file is unpacked into a temporary file, which
//! is removed when nobody reads it any more.

use std::{
    ffi::OsStr,
    fs::{self, File, OpenOptions},
    io::{self, BufRead, BufReader, Read, Seek, Write},
    path::{Path, PathBuf},
};

use flate2::read::MultiGzDecoder;
use radarllm_files::atomic;

use crate::error::{Error, Result};

/// Name of the temporary files, which also names those that a killed run left behind.
const NAME: &str = "radarllm-unpacked";
/// Number of bytes that are unpacked at a time.
const PIECE_BYTES: usize = 64 << 10;
/// A file may become this many times as large. Recordings become five to fifty times as large; a file of zeros that
/// becomes a thousand times as large is no recording.
const MAX_RATIO: u64 = 200;
/// Any file may become this large, in bytes: in small ones the ratio says little.
const ALWAYS_BYTES: u64 = 1 << 30;

/// A way in which a whole file was compressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Compression {
    Gzip,
    Zstandard,
}

/// A file without the compression. The temporary file is removed when this is dropped.
#[derive(Debug)]
pub(crate) struct Unpacked {
    path: PathBuf,
}

impl Drop for Unpacked {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.path);
    }
}

impl Unpacked {
    /// The path of the temporary file.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Unpacks an opened file; `None` if it is not compressed, and then it is at its first byte.
    ///
    /// # Errors
    /// A file that cannot be read or unpacked, that becomes too large, or a temporary file that cannot be written.
    pub(crate) fn of(path: &Path, file: &mut File) -> Result<Option<Self>> {
        let Some(compression) = Compression::named_by(path) else {
            return Ok(None);
        };
        let mut magic = [0; 4];
        let n = read_start(file, &mut magic).map_err(|e| Error::io(path, e))?;
        if !compression.begins(&magic[..n]) {
            return Ok(None);
        }
        let packed_bytes = file.metadata().map_err(|e| Error::io(path, e))?.len();
        let folder = std::env::temp_dir();
        let name = OsStr::new(NAME);
        atomic::remove_leftovers(&folder, name);
        let unpacked = Self {
            path: folder.join(atomic::temporary_name(name)),
        };
        let mut target = Target {
            packed: path,
            file: new_file(&unpacked.path).map_err(|e| Error::io(&unpacked.path, e))?,
            path: &unpacked.path,
            compression,
            packed_bytes,
            n_bytes: 0,
        };
        match compression {
            // Files may be joined, as `cat` and `pigz` do.
            Compression::Gzip => target.copy(&mut MultiGzDecoder::new(file))?,
            Compression::Zstandard => unpack_zstd(BufReader::new(file), &mut target)?,
        }
        Ok(Some(unpacked))
    }
}

impl Compression {
    /// The compression that the ending of a name states.
    fn named_by(path: &Path) -> Option<Self> {
        match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
            "gz" | "gzip" => Some(Self::Gzip),
            "zst" | "zstd" => Some(Self::Zstandard),
            _ => None,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Gzip => "gzip",
            Self::Zstandard => "Zstandard",
        }
    }

    fn begins(self, start: &[u8]) -> bool {
        match self {
            Self::Gzip => start.starts_with(&[0x1F, 0x8B, 8]),
            // `pzstd` begins with a skippable frame.
            Self::Zstandard => {
                start.starts_with(&ZSTD_MAGIC)
                    || matches!(start, [0x50..=0x5F, 0x2A, 0x4D, 0x18, ..])
            }
        }
    }
}

/// The temporary file while it is written.
struct Target<'a> {
    /// Path and size of the compressed file.
    packed: &'a Path,
    packed_bytes: u64,
    compression: Compression,
    path: &'a Path,
    file: File,
    /// Number of bytes that were written.
    n_bytes: u64,
}

impl Target<'_> {
    /// Adds what a decoder unpacks.
    fn copy(&mut self, source: &mut dyn Read) -> Result {
        let max_bytes = self.packed_bytes.saturating_mul(MAX_RATIO);
        let max_bytes = max_bytes.max(ALWAYS_BYTES);
        let mut piece = vec![0; PIECE_BYTES];
        loop {
            let n = match source.read(&mut piece) {
                Ok(0) => return Ok(()),
                Ok(n) => n,
                Err(e) if e.kind() == io::ErrorKind::Interrupted => continue,
                Err(e) => return Err(self.damaged(&e)),
            };
            self.n_bytes += n as u64;
            if self.n_bytes > max_bytes {
                return Err(Error::in_file(
                    self.packed,
                    format!(
                        "its {} bytes become more than {max_bytes}, as no recording does: unpack it first if it is one",
                        self.packed_bytes
                    ),
                ));
            }
            let written = self.file.write_all(&piece[..n]);
            written.map_err(|e| Error::io(self.path, e))?;
        }
    }

    fn damaged(&self, error: &dyn std::fmt::Display) -> Error {
        Error::in_file(
            self.packed,
            format!(
                "damaged or cut short: {} unpacks {} bytes of it, and then {error}",
                self.compression.name(),
                self.n_bytes
            ),
        )
    }
}

/// Magic bytes of a Zstandard frame.
pub(crate) const ZSTD_MAGIC: [u8; 4] = [0x28, 0xB5, 0x2F, 0xFD];

/// Maximum window of the frames of a file, bytes: what `zstd -d` accepts unless it is told otherwise. It is held in memory.
#[cfg(feature = "ros2")]
const MAX_WINDOW_BYTES: u64 = 128 << 20;

/// Unpacks the Zstandard frames of a file, one after the other; `pzstd` writes several, and skippable ones between them.
#[cfg(feature = "ros2")]
fn unpack_zstd(mut source: impl BufRead, target: &mut Target<'_>) -> Result {
    use ruzstd::decoding::{
        StreamingDecoder,
        errors::{FrameDecoderError, ReadFrameHeaderError},
    };

    loop {
        let rest = source.fill_buf().map_err(|e| Error::io(target.packed, e))?;
        if rest.is_empty() {
            return Ok(());
        }
        let opened = StreamingDecoder::new_with_max_window_size(&mut source, MAX_WINDOW_BYTES);
        let mut decoder = match opened {
            Ok(decoder) => decoder,
            Err(FrameDecoderError::ReadFrameHeaderError(ReadFrameHeaderError::SkipFrame {
                length,
                ..
            })) => {
                let mut skipped = source.by_ref().take(length.into());
                io::copy(&mut skipped, &mut io::sink()).map_err(|e| Error::io(target.packed, e))?;
                continue;
            }
            Err(e) => return Err(target.damaged(&e)),
        };
        target.copy(&mut decoder)?;
        let decoder = decoder.into_frame_decoder();
        if let Some(stated) = decoder.get_checksum_from_data()
            && decoder.get_calculated_checksum() != Some(stated)
        {
            return Err(target.damaged(&"the checksum is that of other bytes"));
        }
    }
}

#[cfg(not(feature = "ros2"))]
fn unpack_zstd(_: impl BufRead, target: &mut Target<'_>) -> Result {
    Err(Error::in_file(
        target.packed,
        "it is compressed by Zstandard, which this build does not unpack: it lacks the feature `ros2` of the crate radarllm-io",
    )
    .of_kind(crate::error::ErrorKind::Unsupported))
}

/// The name that a file has once it is unpacked.
pub(crate) fn plain_name(path: &Path) -> String {
    let name = match Compression::named_by(path) {
        Some(_) => path.file_stem(),
        None => path.file_name(),
    };
    name.unwrap_or_default().to_string_lossy().into_owned()
}

/// Fills `start` as far as the file reaches, and goes back to the first byte.
fn read_start(file: &mut File, start: &mut [u8]) -> io::Result<usize> {
    let mut bytes = Vec::new();
    Read::by_ref(file)
        .take(start.len() as u64)
        .read_to_end(&mut bytes)?;
    file.rewind()?;
    start[..bytes.len()].copy_from_slice(&bytes);
    Ok(bytes.len())
}

/// Creates a file that other users cannot read: the folder is shared, and the recording may not be for everybody.
fn new_file(path: &Path) -> io::Result<File> {
    let mut options = OpenOptions::new();
    options.write(true).create_new(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    options.open(path)
}
