//! ROS 2 bags: SQLite databases (`*.db3`) and MCAP files (`*.mcap`), one or a folder of them.
//!
//! The files are read here, their messages by `radarllm_formats::recordings::ros`. Reading needs the feature `ros2`, because
//! SQLite needs a C compiler and takes long to build.

#[cfg(feature = "ros2")]
mod mcap;
#[cfg(feature = "ros2")]
mod sqlite;

use radarllm_formats::recordings::{Axes, Bag, BagError};

#[cfg(not(feature = "ros2"))]
use crate::error::ErrorKind;
use crate::{
    error::{Error, Result},
    opened::Opened,
};

/// Reads the points of a bag. The inner error is about its messages. What is missing at the end of a file is a warning.
#[cfg(not(feature = "ros2"))]
pub(crate) fn read(
    capture: &mut Opened,
    _: Option<&str>,
    _: Axes,
    _: &mut Vec<String>,
) -> Result<std::result::Result<Bag, BagError>> {
    Err(Error::in_file(
        capture.path(),
        "a ROS 2 bag, which this build does not read: it lacks the feature `ros2` of the crate radarllm-io",
    )
    .of_kind(ErrorKind::Unsupported))
}

#[cfg(feature = "ros2")]
pub(crate) use reading::read;

#[cfg(feature = "ros2")]
mod reading {
    use std::{
        borrow::Cow,
        io::{Read, Seek},
        path::PathBuf,
    };

    use radarllm_formats::{
        folder::ros2_bag_folder,
        recordings::{Place, RecordingError, RosMessages, ros::MAX_CHUNK_BYTES},
    };

    use super::*;
    use crate::{compressed::ZSTD_MAGIC, opened::detect_error, visualizer};

    /// Magic bytes at the start of an MCAP file.
    const MCAP_MAGIC: &[u8] = b"\x89MCAP0\r\n";
    /// Largest window of a Zstandard frame, bytes: what level 19 uses. More is memory for nothing.
    const MAX_WINDOW_BYTES: u64 = 8 << 20;

    /// Reads the points of a bag. The inner error is about its messages. What is missing at the end of a file is a warning.
    pub(crate) fn read(
        capture: &mut Opened,
        topic: Option<&str>,
        axes: Axes,
        warnings: &mut Vec<String>,
    ) -> Result<std::result::Result<Bag, BagError>> {
        let path = capture.path().to_path_buf();
        let files: Vec<PathBuf> = if path.is_dir() {
            let names = visualizer::file_names(&path)?;
            let names: Vec<&str> = names.iter().map(String::as_str).collect();
            let files = ros2_bag_folder(&names).map_err(|e| detect_error(&path, e))?;
            let files = files.unwrap_or_default();
            files.into_iter().map(|name| path.join(name)).collect()
        } else {
            vec![path.clone()]
        };
        if files.is_empty() {
            return Err(Error::in_file(&path, "no *.db3 or *.mcap in the folder"));
        }
        let mut messages = RosMessages::new(topic, axes);
        for (n, file) in files.iter().enumerate() {
            // Numbers of topics are those of their file.
            let base = (n as u64) << 32;
            // The bag itself, or a file of the folder.
            let part = &mut match *file == path {
                true => capture.again(),
                false => Opened::ros2_bag(file),
            };
            let mut opened = part.take_first()?;
            let mut start = Vec::new();
            opened
                .by_ref()
                .take(MCAP_MAGIC.len() as u64)
                .read_to_end(&mut start)
                .and_then(|_| opened.rewind())
                .map_err(|e| Error::io(file, e))?;
            match start == MCAP_MAGIC {
                true => mcap::read(file, opened, base, &mut messages, warnings)?,
                false => sqlite::read(file, part.readable_path(), base, &mut messages)?,
            }
        }
        Ok(messages.finish(Place::Byte(0)))
    }

    /// A message as it was before the recorder compressed it. Messages of CDR begin with a zero byte.
    pub(super) fn plain(
        at: Place,
        message: &[u8],
    ) -> std::result::Result<Cow<'_, [u8]>, RecordingError> {
        if !message.starts_with(&ZSTD_MAGIC) {
            return Ok(Cow::Borrowed(message));
        }
        let wrong = |found: &str| RecordingError {
            at,
            expected: "a message that Zstandard unpacks".into(),
            found: found.into(),
        };
        let decoder = zstd(message).map_err(|e| wrong(&e))?;
        let mut plain = Vec::new();
        let read = decoder.take(MAX_CHUNK_BYTES + 1).read_to_end(&mut plain);
        match read {
            Ok(n) if n as u64 <= MAX_CHUNK_BYTES => Ok(Cow::Owned(plain)),
            Ok(_) => Err(wrong("more than 256 MiB")),
            Err(e) => Err(wrong(&e.to_string())),
        }
    }

    /// A decoder of one Zstandard frame.
    pub(super) fn zstd(bytes: &[u8]) -> std::result::Result<impl Read + '_, String> {
        ruzstd::decoding::StreamingDecoder::new_with_max_window_size(bytes, MAX_WINDOW_BYTES)
            .map_err(|e| e.to_string())
    }
}
