//! ROS 1 bags (format 2.0): the messages with points of one topic, which [`super::ros`] reads.
//!
//! The file is read from front to back, so any reader is sufficient and the index is not needed. Chunks may be
//! compressed (bz2, lz4).

use std::collections::BTreeMap;
use std::io::Read;

use super::{
    Axes, Place, RecordingError,
    ros::{Bag, BagError, MAX_CHUNK_BYTES, RosEncoding, RosMessages, unpack},
};

/// Magic bytes at the start of a bag.
pub const BAG_MAGIC: &[u8; 13] = b"#ROSBAG V2.0\n";
/// Maximum length of a record, bytes; chunks are usually 768 KiB.
const MAX_RECORD_BYTES: u32 = MAX_CHUNK_BYTES as u32;
/// Reads the points of a topic. If no topic is given, the bag must have only one topic with points, or with clouds.
///
/// # Errors
/// [`BagError`] with the byte offset in the file (for messages, that of their record; within a compressed chunk,
/// that of the chunk): damage, no matching topic or several, or clouds without a required field.
pub fn read_bag(mut reader: impl Read, topic: Option<&str>, axes: Axes) -> Result<Bag, BagError> {
    let mut magic = [0; BAG_MAGIC.len()];
    let whole = read_up_to(&mut reader, &mut magic);
    if whole != magic.len() || &magic != BAG_MAGIC {
        return Err(wrong(0, "#ROSBAG V2.0", &String::from_utf8_lossy(&magic)).into());
    }
    let mut messages = RosMessages::new(topic, axes);
    let mut at = BAG_MAGIC.len() as u64;
    while let Some((header, data)) = read_record(&mut reader, at)? {
        let next = at + 8 + header.len() as u64 + data.len() as u64;
        read_into(&mut messages, at, &header, &data, 0)?;
        at = next;
    }
    messages.finish(Place::Byte(at))
}

fn wrong(byte: u64, expected: impl Into<String>, found: &str) -> RecordingError {
    RecordingError::new(Place::Byte(byte), expected, found)
}

fn read_up_to(reader: &mut impl Read, buffer: &mut [u8]) -> usize {
    let mut done = 0;
    while done < buffer.len() {
        match reader.read(&mut buffer[done..]) {
            Ok(n) if n > 0 => done += n,
            Err(e) if e.kind() == std::io::ErrorKind::Interrupted => {}
            _ => break,
        }
    }
    done
}

/// Reads one length-prefixed block. The buffer grows with the bytes available, never with the declared length.
fn read_block(reader: &mut impl Read, at: u64) -> Result<Option<Vec<u8>>, RecordingError> {
    let mut length = [0; 4];
    match read_up_to(reader, &mut length) {
        0 => return Ok(None),
        4 => {}
        _ => return Err(wrong(at, "a length of 4 bytes", "the end")),
    }
    let length = u32::from_le_bytes(length);
    if length > MAX_RECORD_BYTES {
        let expected = format!("a record of at most {MAX_RECORD_BYTES} bytes");
        return Err(wrong(at, expected, &length.to_string()));
    }
    let mut block = Vec::new();
    reader
        .take(u64::from(length))
        .read_to_end(&mut block)
        .map_err(|e| wrong(at, "a readable file", &e.to_string()))?;
    if block.len() != length as usize {
        let found = format!("{} bytes, then the end", block.len());
        return Err(wrong(at, format!("{length} bytes"), &found));
    }
    Ok(Some(block))
}

type Record = (Vec<u8>, Vec<u8>);

fn read_record(reader: &mut impl Read, at: u64) -> Result<Option<Record>, RecordingError> {
    let Some(header) = read_block(reader, at)? else {
        return Ok(None);
    };
    let data_at = at + 4 + header.len() as u64;
    match read_block(reader, data_at)? {
        Some(data) => Ok(Some((header, data))),
        None => Err(wrong(data_at, "the data of the record", "the end")),
    }
}

/// Parses the `name=value` fields of a record or connection header.
fn fields(at: u64, header: &[u8]) -> Result<BTreeMap<&[u8], &[u8]>, RecordingError> {
    let mut out = BTreeMap::new();
    let mut rest = header;
    while !rest.is_empty() {
        let field = rest.split_first_chunk::<4>().and_then(|(n, after)| {
            let (field, after) = after.split_at_checked(u32::from_le_bytes(*n) as usize)?;
            let equals = field.iter().position(|b| *b == b'=')?;
            Some((&field[..equals], &field[equals + 1..], after))
        });
        let Some((name, value, after)) = field else {
            return Err(wrong(at, "header fields `name=value`", "other bytes"));
        };
        out.insert(name, value);
        rest = after;
    }
    Ok(out)
}

fn read_into(
    messages: &mut RosMessages,
    at: u64,
    header: &[u8],
    data: &[u8],
    depth: usize,
) -> Result<(), RecordingError> {
    let fields = fields(at, header)?;
    let number = |name: &[u8]| {
        let value: [u8; 4] = (*fields.get(name)?).try_into().ok()?;
        Some(u32::from_le_bytes(value))
    };
    let Some([op]) = fields.get(&b"op"[..]) else {
        return Err(wrong(at, "a record with `op`", "none"));
    };
    match op {
        0x02 => {
            let id = number(b"conn").ok_or_else(|| wrong(at, "`conn` of 4 bytes", "none"))?;
            let time = fields.get(&b"time"[..]).and_then(|time| {
                let (secs, nsecs) = time.split_first_chunk::<4>()?;
                let nsecs = u32::from_le_bytes(nsecs.try_into().ok()?);
                let secs = u32::from_le_bytes(*secs);
                Some(f64::from(secs) + f64::from(nsecs) * 1e-9)
            });
            messages.message(Place::Byte(at), id.into(), time, data)?;
        }
        0x05 => {
            if depth > 0 {
                return Err(wrong(at, "a chunk outside of chunks", "one inside"));
            }
            let compression = fields.get(&b"compression"[..]).copied().unwrap_or(b"");
            let size = || number(b"size").ok_or_else(|| wrong(at, "`size` of 4 bytes", "none"));
            let unpacked;
            let chunk = match compression {
                b"none" => data,
                b"bz2" => {
                    unpacked = unpack(
                        Place::Byte(at),
                        bzip2::read::BzDecoder::new(data),
                        size()?.into(),
                    )?;
                    &unpacked
                }
                b"lz4" => {
                    let decoder = lz4_flex::frame::FrameDecoder::new(data);
                    unpacked = unpack(Place::Byte(at), decoder, size()?.into())?;
                    &unpacked
                }
                other => {
                    let found = String::from_utf8_lossy(other);
                    return Err(wrong(at, "compression none, bz2 or lz4", &found));
                }
            };
            let mut rest = chunk;
            while !rest.is_empty() {
                let inside = match compression {
                    b"none" => at + (chunk.len() - rest.len()) as u64,
                    _ => at,
                };
                if let Some((header, data)) = read_record(&mut rest, inside)? {
                    read_into(messages, inside, &header, &data, depth + 1)?;
                }
            }
        }
        0x07 => {
            let topic = fields.get(&b"topic"[..]).copied().unwrap_or(b"");
            let description = self::fields(at, data)?;
            let kind = description.get(&b"type"[..]).copied().unwrap_or(b"");
            let id = number(b"conn").ok_or_else(|| wrong(at, "`conn` of 4 bytes", "none"))?;
            let definition = description.get(&b"message_definition"[..]);
            let definition = definition.map(|d| String::from_utf8_lossy(d));
            messages.connect(
                Place::Byte(at),
                id.into(),
                &String::from_utf8_lossy(topic),
                &String::from_utf8_lossy(kind),
                Some(RosEncoding::Ros1),
                definition.as_deref(),
            )?;
        }
        // Bag header, index data and chunk info are not needed.
        0x03 | 0x04 | 0x06 => {}
        _ => return Err(wrong(at, "a record of a bag", &format!("op {op}"))),
    }
    Ok(())
}
