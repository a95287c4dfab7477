//! MCAP files: records in order, most of them in chunks that may be compressed (lz4, Zstandard).
//!
//! The crate `mcap` finds the records and parses those that are used. Chunks are unpacked here, so that nothing is larger
//! than its header says, and no C library is needed.

use std::{collections::BTreeMap, io::Read, path::Path};

use mcap::{
    McapError,
    records::{Record, op},
    sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions},
};
use radarllm_formats::recordings::{
    Place, RecordingError, RosEncoding, RosMessages,
    ros::{MAX_CHUNK_BYTES, unpack},
};

use super::reading::{plain, zstd};
use crate::error::{Error, Result};

/// Number of bytes read at a time. The buffer grows with the bytes that are there, never with a stated length.
const PIECE_BYTES: usize = 1 << 20;
/// Bytes before the content of a record: its kind and its length.
const RECORD_HEADER_BYTES: usize = 9;

/// A message type.
struct Schema {
    name: String,
    /// The text of the type, if it is one of messages with single points.
    definition: Option<String>,
}

/// What the records so far say.
struct State<'a> {
    base: u64,
    schemas: BTreeMap<u16, Schema>,
    messages: &'a mut RosMessages,
}

/// Adds the messages of a file. `base` is added to the numbers of its channels. A file that ends too early, because its
/// recorder was stopped, is a warning.
pub(super) fn read(
    path: &Path,
    mut file: impl Read,
    base: u64,
    messages: &mut RosMessages,
    warnings: &mut Vec<String>,
) -> Result {
    let options = LinearReaderOptions::default()
        .with_emit_chunks(true)
        .with_skip_end_magic(true)
        .with_record_length_limit(MAX_CHUNK_BYTES as usize);
    let mut reader = LinearReader::new_with_options(options);
    let mut state = State {
        base,
        schemas: BTreeMap::new(),
        messages,
    };
    let mut at = 0_u64;
    let mut has_footer = false;
    while let Some(event) = reader.next_event() {
        match event {
            Ok(LinearReadEvent::ReadRequest(n)) => {
                let n = file
                    .read(reader.insert(n.clamp(1, PIECE_BYTES)))
                    .map_err(|e| Error::io(path, e))?;
                reader.notify_read(n);
                at += n as u64;
            }
            Ok(LinearReadEvent::Record { opcode, data }) => {
                has_footer |= opcode == op::FOOTER;
                state
                    .record(Place::Byte(at), opcode, data)
                    .map_err(|e| Error::wrap_in_file(path, e))?;
                if has_footer {
                    break;
                }
            }
            Err(McapError::UnexpectedEof) => break,
            Err(e) => return Err(Error::in_file(path, format!("before byte {at}: {e}"))),
        }
    }
    if !has_footer {
        warnings.push(format!(
            "{} ends after {at} bytes without its last records: the recorder was stopped",
            path.file_name().unwrap_or_default().to_string_lossy()
        ));
    }
    Ok(())
}

impl State<'_> {
    fn record(
        &mut self,
        at: Place,
        opcode: u8,
        data: &[u8],
    ) -> std::result::Result<(), RecordingError> {
        if opcode != op::CHUNK {
            return self.simple_record(at, opcode, data);
        }
        let Record::Chunk { header, data } = parse(at, opcode, data)? else {
            return Ok(());
        };
        let size = header.uncompressed_size;
        let chunk = match header.compression.as_str() {
            "" => data.into_owned(),
            "lz4" => unpack(at, lz4_flex::frame::FrameDecoder::new(&data[..]), size)?,
            "zstd" => {
                let decoder = zstd(&data).map_err(|e| wrong(at, "a whole compressed chunk", e))?;
                unpack(at, decoder, size)?
            }
            other => return Err(wrong(at, "compression lz4, zstd or none", printable(other))),
        };
        let crc = header.uncompressed_crc;
        if crc != 0 && crc32fast::hash(&chunk) != crc {
            return Err(wrong(
                at,
                "a chunk with the checksum of its header",
                "another".into(),
            ));
        }
        let mut rest = &chunk[..];
        while let Some((head, after)) = rest.split_first_chunk::<RECORD_HEADER_BYTES>() {
            let [opcode, length @ ..] = *head;
            let length = usize::try_from(u64::from_le_bytes(length)).unwrap_or(usize::MAX);
            let Some((data, after)) = after.split_at_checked(length) else {
                return Err(wrong(at, "whole records in a chunk", "its end".into()));
            };
            self.simple_record(at, opcode, data)?;
            rest = after;
        }
        match rest {
            [] => Ok(()),
            _ => Err(wrong(at, "whole records in a chunk", "its end".into())),
        }
    }

    /// Adds a record that is no chunk.
    fn simple_record(
        &mut self,
        at: Place,
        opcode: u8,
        data: &[u8],
    ) -> std::result::Result<(), RecordingError> {
        // Others are not parsed: they are indices, attachments and summaries.
        if ![op::SCHEMA, op::CHANNEL, op::MESSAGE].contains(&opcode) {
            return Ok(());
        }
        match parse(at, opcode, data)? {
            Record::Schema { header, data } => {
                let is_text = ["ros1msg", "ros2msg"].contains(&header.encoding.as_str());
                let is_wanted = is_text && header.name.ends_with("RadarScan");
                let schema = Schema {
                    definition: is_wanted.then(|| String::from_utf8_lossy(&data).into_owned()),
                    name: header.name,
                };
                self.schemas.insert(header.id, schema);
            }
            Record::Channel(channel) => {
                let schema = self.schemas.get(&channel.schema_id);
                let encoding = match channel.message_encoding.as_str() {
                    "cdr" => Some(RosEncoding::Cdr),
                    "ros1" => Some(RosEncoding::Ros1),
                    _ => None,
                };
                self.messages.connect(
                    at,
                    self.base + u64::from(channel.id),
                    &channel.topic,
                    schema.map_or("no type", |s| &s.name),
                    encoding,
                    schema.and_then(|s| s.definition.as_deref()),
                )?;
            }
            Record::Message { header, data } => {
                let id = self.base + u64::from(header.channel_id);
                let data = match self.messages.is_wanted(id) {
                    true => plain(at, &data)?,
                    false => data,
                };
                let recorded_s = seconds(header.log_time);
                self.messages.message(at, id, Some(recorded_s), &data)?;
            }
            _ => {}
        }
        Ok(())
    }
}

/// Nanoseconds in s.
pub(super) fn seconds(time_ns: u64) -> f64 {
    (time_ns / 1_000_000_000) as f64 + (time_ns % 1_000_000_000) as f64 * 1e-9
}

fn parse(at: Place, opcode: u8, data: &[u8]) -> std::result::Result<Record<'_>, RecordingError> {
    if !holds_its_texts(opcode, data) {
        return Err(wrong(
            at,
            "texts that end within their record",
            "a greater length".into(),
        ));
    }
    mcap::parse_record(opcode, data).map_err(|e| {
        let text = e.to_string();
        wrong(at, "a whole record", printable(&text))
    })
}

/// Whether the texts of a record end within it. The parser allocates what their lengths say before it reads them.
fn holds_its_texts(opcode: u8, data: &[u8]) -> bool {
    // Bytes before the first text, and the number of texts.
    let (before, n_texts) = match opcode {
        op::SCHEMA => (2, 2),
        op::CHANNEL => (4, 2),
        op::CHUNK => (28, 1),
        _ => return true,
    };
    let texts = || {
        let mut rest = data.get(before..)?;
        for _ in 0..n_texts {
            (_, rest) = split_counted(rest)?;
        }
        if opcode == op::CHANNEL {
            // Metadata: pairs of texts.
            let (mut pairs, _) = split_counted(rest)?;
            while !pairs.is_empty() {
                // The parser reads the second text of a pair behind the end of the others as well.
                let (_, value) = split_counted(pairs)?;
                (_, pairs) = split_counted(value)?;
            }
        }
        Some(())
    };
    texts().is_some()
}

/// As many bytes as a number of four bytes before them says, and what follows; `None` if there are fewer.
fn split_counted(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let (length, rest) = bytes.split_first_chunk()?;
    rest.split_at_checked(usize::try_from(u32::from_le_bytes(*length)).ok()?)
}

fn wrong(at: Place, expected: &str, found: String) -> RecordingError {
    RecordingError {
        at,
        expected: expected.into(),
        found: printable(&found),
    }
}

/// Foreign text without what a terminal would obey, in one line.
fn printable(text: &str) -> String {
    text.chars()
        .take(100)
        .map(|c| if c.is_control() { ' ' } else { c })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(text: &str) -> Vec<u8> {
        let length = u32::try_from(text.len()).unwrap();
        [&length.to_le_bytes()[..], text.as_bytes()].concat()
    }

    #[test]
    fn texts_that_are_longer_than_their_record_are_not_read() {
        let pair = [text("key"), text("value")].concat();
        let map = [&u32::try_from(pair.len()).unwrap().to_le_bytes()[..], &pair].concat();
        // Each with the places of the lengths of its texts.
        let records = [
            (
                op::SCHEMA,
                [vec![1, 0], text("a/B"), text("ros2msg"), text("")].concat(),
                &[2, 9][..],
            ),
            (
                op::CHANNEL,
                [vec![1, 0, 1, 0], text("/a"), text("cdr"), map].concat(),
                &[4, 10, 17, 21, 28],
            ),
            (
                op::CHUNK,
                [vec![0; 28], text("zstd"), vec![0; 8]].concat(),
                &[28],
            ),
        ];
        for (opcode, record, places) in records {
            assert!(holds_its_texts(opcode, &record));
            assert!(mcap::parse_record(opcode, &record).is_ok());
            // Every text, in turn, longer than the record by one byte.
            for &at in places {
                let left = u32::try_from(record.len() - at - 4).unwrap();
                let mut damaged = record.clone();
                damaged[at..at + 4].copy_from_slice(&(left + 1).to_le_bytes());
                assert!(
                    !holds_its_texts(opcode, &damaged),
                    "record {opcode}, byte {at}"
                );
            }
            // What follows the texts is read in place: the definition of a schema, the records of a chunk.
            let after_texts = match opcode {
                op::SCHEMA => 4,
                op::CHUNK => 8,
                _ => 0,
            };
            for length in 0..record.len() - after_texts {
                assert!(
                    !holds_its_texts(opcode, &record[..length]),
                    "{opcode}, {length}"
                );
            }
        }
        // Metadata that are no pairs: a key at the end of their length, whose value would begin behind it.
        let key = text("key");
        let map = [&u32::try_from(key.len()).unwrap().to_le_bytes()[..], &key].concat();
        let record = [vec![1, 0, 1, 0], text("/a"), text("cdr"), map].concat();
        assert!(!holds_its_texts(op::CHANNEL, &record));
    }
}
