//! ROS 1 bags (format 2.0): the `sensor_msgs/PointCloud2` messages of one topic.
//!
//! The file is read from front to back, so any reader is sufficient and the index is not needed. Chunks may be
//! compressed (bz2, lz4). Fields are read by the name, offset and type that every message declares: x, y, z, a velocity
//! (`velocity`, `v`, `doppler`) and an intensity in dB (`intensity`, `snr`, `power`).

use std::collections::BTreeMap;
use std::io::Read;

use super::{
    Axes, MAX_COORDINATE_M, MAX_INTENSITY_DB, MAX_VELOCITY_MPS, Place, RecordedFrame,
    RecordingError, point,
};

/// Magic bytes at the start of a bag.
pub const BAG_MAGIC: &[u8; 13] = b"#ROSBAG V2.0\n";
/// Maximum length of a record, bytes; chunks are usually 768 KiB.
const MAX_RECORD_BYTES: u32 = 256 << 20;
/// Maximum number of connections of a bag.
const MAX_CONNECTIONS: usize = 4096;

/// Content of a bag.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Bag {
    /// Topic of the frames.
    pub topic: String,
    /// Frames in the order of the file.
    pub frames: Vec<RecordedFrame>,
    /// Points dropped because they are NaN or out of range. Clouds that are not dense contain NaN.
    pub points_dropped: u64,
    /// Number of messages on other topics.
    pub other_messages: u64,
}

/// Reads the point clouds of a topic. If no topic is given, the bag must have only one topic with point clouds.
///
/// # Errors
/// [`RecordingError`] with the byte offset in the file (for messages, that of their record; within a compressed chunk,
/// that of the chunk): damage, no matching topic or several, or clouds without a required field.
pub fn read_bag(
    mut reader: impl Read,
    topic: Option<&str>,
    axes: Axes,
) -> Result<Bag, RecordingError> {
    let mut magic = [0; BAG_MAGIC.len()];
    let whole = read_up_to(&mut reader, &mut magic);
    if whole != magic.len() || &magic != BAG_MAGIC {
        return Err(wrong(0, "#ROSBAG V2.0", &String::from_utf8_lossy(&magic)));
    }
    let mut state = State {
        topic: topic.map(str::to_owned),
        axes,
        connections: BTreeMap::new(),
        bag: Bag::default(),
    };
    let mut at = BAG_MAGIC.len() as u64;
    while let Some((header, data)) = read_record(&mut reader, at)? {
        let next = at + 8 + header.len() as u64 + data.len() as u64;
        state.record(at, &header, &data, 0)?;
        at = next;
    }
    if state.bag.topic.is_empty() {
        return Err(match topic {
            Some(topic) => wrong(
                at,
                format!("PointCloud2 messages on {topic}"),
                &state.clouds(),
            ),
            None => wrong(at, "a topic with PointCloud2 messages", &state.topics()),
        });
    }
    Ok(state.bag)
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

/// Decompresses a chunk, which must have `size` bytes. Surplus bytes are not decompressed.
fn unpack(at: u64, decoder: impl Read, size: u32) -> Result<Vec<u8>, RecordingError> {
    if size > MAX_RECORD_BYTES {
        let expected = format!("a chunk of at most {MAX_RECORD_BYTES} bytes");
        return Err(wrong(at, expected, &size.to_string()));
    }
    let mut chunk = Vec::new();
    let read = decoder.take(u64::from(size) + 1).read_to_end(&mut chunk);
    read.map_err(|e| wrong(at, "a whole compressed chunk", &e.to_string()))?;
    if chunk.len() == size as usize {
        return Ok(chunk);
    }
    let found = match chunk.len() > size as usize {
        true => "more".to_owned(),
        false => chunk.len().to_string(),
    };
    let expected = format!("a chunk that unpacks to {size} bytes, as its header says");
    Err(wrong(at, expected, &found))
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

struct Connection {
    topic: String,
    is_cloud: bool,
}

struct State {
    /// The requested topic.
    topic: Option<String>,
    axes: Axes,
    connections: BTreeMap<u32, Connection>,
    bag: Bag,
}

impl State {
    fn topics(&self) -> String {
        let all: Vec<&str> = self
            .connections
            .values()
            .map(|c| c.topic.as_str())
            .collect();
        all.join(" ")
    }

    fn clouds(&self) -> String {
        let clouds = self.connections.values().filter(|c| c.is_cloud);
        clouds
            .map(|c| c.topic.as_str())
            .collect::<Vec<_>>()
            .join(" ")
    }

    fn record(
        &mut self,
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
                let connection = number(b"conn")
                    .and_then(|id| self.connections.get(&id))
                    .ok_or_else(|| wrong(at, "a message of a known connection", "another"))?;
                let wanted = self.topic.as_ref().is_none_or(|t| *t == connection.topic);
                if !connection.is_cloud || !wanted {
                    self.bag.other_messages += 1;
                    return Ok(());
                }
                if self.bag.topic.is_empty() {
                    self.bag.topic = connection.topic.clone();
                } else if self.bag.topic != connection.topic {
                    let expected = "one topic with PointCloud2 messages, or a topic to be named";
                    return Err(wrong(at, expected, &self.clouds()));
                }
                let (frame, dropped) = cloud(at, data, self.axes)?;
                self.bag.points_dropped += dropped;
                self.bag.frames.push(RecordedFrame {
                    number: self.bag.frames.len() as u64,
                    ..frame
                });
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
                        unpacked = unpack(at, bzip2::read::BzDecoder::new(data), size()?)?;
                        &unpacked
                    }
                    b"lz4" => {
                        let decoder = lz4_flex::frame::FrameDecoder::new(data);
                        unpacked = unpack(at, decoder, size()?)?;
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
                        self.record(inside, &header, &data, depth + 1)?;
                    }
                }
            }
            0x07 => {
                let topic = fields.get(&b"topic"[..]).copied().unwrap_or(b"");
                let description = self::fields(at, data)?;
                let kind = description.get(&b"type"[..]).copied().unwrap_or(b"");
                let id = number(b"conn").ok_or_else(|| wrong(at, "`conn` of 4 bytes", "none"))?;
                if self.connections.len() >= MAX_CONNECTIONS {
                    let expected = format!("at most {MAX_CONNECTIONS} connections");
                    return Err(wrong(at, expected, "more"));
                }
                self.connections.insert(
                    id,
                    Connection {
                        topic: String::from_utf8_lossy(topic).into_owned(),
                        is_cloud: kind == b"sensor_msgs/PointCloud2",
                    },
                );
            }
            // Bag header, index data and chunk info are not needed.
            0x03 | 0x04 | 0x06 => {}
            _ => return Err(wrong(at, "a record of a bag", &format!("op {op}"))),
        }
        Ok(())
    }
}

/// Reads a message from front to back.
struct Cursor<'a> {
    at: u64,
    rest: &'a [u8],
}

impl<'a> Cursor<'a> {
    fn bytes(&mut self, n: usize) -> Result<&'a [u8], RecordingError> {
        let (head, rest) = self
            .rest
            .split_at_checked(n)
            .ok_or_else(|| wrong(self.at, "a whole PointCloud2 message", "its end"))?;
        self.rest = rest;
        Ok(head)
    }

    fn u32(&mut self) -> Result<u32, RecordingError> {
        let raw = self.bytes(4)?;
        Ok(u32::from_le_bytes([raw[0], raw[1], raw[2], raw[3]]))
    }

    fn block(&mut self) -> Result<&'a [u8], RecordingError> {
        let n = self.u32()? as usize;
        self.bytes(n)
    }
}

/// Offset and type of a value in a point.
#[derive(Clone, Copy)]
struct Field {
    offset: usize,
    datatype: u8,
}

impl Field {
    fn size(self) -> Option<usize> {
        Some(match self.datatype {
            1 | 2 => 1,
            3 | 4 => 2,
            5..=7 => 4,
            8 => 8,
            _ => return None,
        })
    }

    /// Decodes the value. The caller has checked that the point is long enough.
    fn value(self, point: &[u8], big_endian: bool) -> f64 {
        let size = self.size().unwrap_or(1);
        let mut raw = [0_u8; 8];
        let source = &point[self.offset..self.offset + size];
        for (i, out) in raw[..size].iter_mut().enumerate() {
            *out = source[if big_endian { size - 1 - i } else { i }];
        }
        let bits = u64::from_le_bytes(raw);
        match self.datatype {
            1 => f64::from(bits as i8),
            2 => f64::from(bits as u8),
            3 => f64::from(bits as i16),
            4 => f64::from(bits as u16),
            5 => f64::from(bits as i32),
            6 => f64::from(bits as u32),
            7 => f64::from(f32::from_bits(bits as u32)),
            _ => f64::from_bits(bits),
        }
    }
}

/// Accepted field names of each value.
const FIELD_NAMES: [&[&[u8]]; 5] = [
    &[b"x"],
    &[b"y"],
    &[b"z"],
    &[b"velocity", b"v", b"doppler"],
    &[b"intensity", b"snr", b"power"],
];

fn cloud(at: u64, message: &[u8], axes: Axes) -> Result<(RecordedFrame, u64), RecordingError> {
    let mut cursor = Cursor { at, rest: message };
    cursor.u32()?;
    let stamp_s = f64::from(cursor.u32()?) + f64::from(cursor.u32()?) * 1e-9;
    cursor.block()?;
    let (height, width) = (cursor.u32()? as usize, cursor.u32()? as usize);
    let mut used: [Option<Field>; 5] = [None; 5];
    for _ in 0..cursor.u32()? {
        let name = cursor.block()?;
        let offset = cursor.u32()? as usize;
        let datatype = cursor.bytes(1)?[0];
        cursor.u32()?;
        if let Some(k) = FIELD_NAMES.iter().position(|names| names.contains(&name)) {
            used[k] = Some(Field { offset, datatype });
        }
    }
    let big_endian = cursor.bytes(1)?[0] != 0;
    let (point_step, row_step) = (cursor.u32()? as usize, cursor.u32()? as usize);
    let data = cursor.block()?;
    let mut places = [Field {
        offset: 0,
        datatype: 0,
    }; 5];
    for ((place, field), names) in places.iter_mut().zip(used).zip(FIELD_NAMES) {
        let name = || String::from_utf8_lossy(names[0]).into_owned();
        let field = field.ok_or_else(|| wrong(at, format!("a field `{}`", name()), "none"))?;
        let end = field.size().and_then(|size| field.offset.checked_add(size));
        if end.is_none_or(|end| end > point_step) {
            let found = format!("offset {}, type {}", field.offset, field.datatype);
            let expected = format!("`{}` within point_step {point_step}", name());
            return Err(wrong(at, expected, &found));
        }
        *place = field;
    }
    let row_fits = width.checked_mul(point_step).is_some_and(|n| n <= row_step);
    if !row_fits || row_step.checked_mul(height) != Some(data.len()) {
        let expected = format!(
            "row_step at least {width} x {point_step}, {height} rows in {} bytes",
            data.len()
        );
        return Err(wrong(at, expected, &format!("row_step {row_step}")));
    }
    let mut points = Vec::new();
    let mut dropped = 0;
    if width > 0 && height > 0 {
        for raw in data
            .chunks_exact(row_step)
            .flat_map(|row| row.chunks_exact(point_step).take(width))
        {
            let [x, y, z, velocity_mps, intensity_db] =
                places.map(|place| place.value(raw, big_endian));
            let is_plausible = [x, y, z].iter().all(|v| v.abs() <= MAX_COORDINATE_M)
                && velocity_mps.abs() <= MAX_VELOCITY_MPS
                && intensity_db.abs() <= MAX_INTENSITY_DB;
            if is_plausible {
                points.push(point(
                    axes.to_project([x, y, z]),
                    velocity_mps,
                    intensity_db,
                ));
            } else {
                dropped += 1;
            }
        }
    }
    let frame = RecordedFrame {
        number: 0,
        stamp_s: Some(stamp_s),
        points,
        board: None,
    };
    Ok((frame, dropped))
}
