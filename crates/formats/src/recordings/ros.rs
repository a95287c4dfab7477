//! Messages of ROS with the points of a radar, as bags hold them: `sensor_msgs/PointCloud2`, `radar_msgs/RadarScan`, a frame of
//! returns each, and `RadarScan` of TI's driver (`ti_mmwave_rospkg`), a message for each point.
//!
//! Two encodings are read: that of ROS 1, little-endian without padding, and CDR of ROS 2 in both byte orders, where numbers
//! stand at multiples of their size. Clouds state the name, offset and type of their fields; the names are those of tables
//! ([`crate::tables`]), in any case. `power` is in dB here, as drivers send it, and angles are in rad. Clouds without an
//! intensity have 0 dB.

use std::{collections::BTreeMap, io::Read};

use radarllm_base::RadarPoint;

use super::{
    Axes, MAX_INTENSITY_DB, MAX_VELOCITY_MPS, Place, RecordedFrame, RecordingError, is_in_range,
    listed, point, printable, radhar,
};
use crate::tables::{Column, Meaning, Unit, angles_to_position, meaning, missing_of_point};

/// Maximum length of a chunk, a record or a message of a bag, packed or unpacked, bytes; chunks are usually 768 KiB to 4 MiB.
pub const MAX_CHUNK_BYTES: u64 = 256 << 20;
/// Maximum number of topics of a bag.
const MAX_TOPICS: usize = 4096;

/// Decompresses a chunk, which must have `size` bytes. Surplus bytes are not decompressed.
///
/// # Errors
/// A size beyond [`MAX_CHUNK_BYTES`], damage, or another size.
pub fn unpack(at: Place, decoder: impl Read, size: u64) -> Result<Vec<u8>, RecordingError> {
    let wrong = |expected: String, found: &str| Err(RecordingError::new(at, expected, found));
    if size > MAX_CHUNK_BYTES {
        let expected = format!("a chunk of at most {MAX_CHUNK_BYTES} bytes");
        return wrong(expected, &size.to_string());
    }
    let mut chunk = Vec::new();
    if let Err(e) = decoder.take(size + 1).read_to_end(&mut chunk) {
        return wrong("a whole compressed chunk".into(), &e.to_string());
    }
    let found = match chunk.len() as u64 {
        n if n == size => return Ok(chunk),
        n if n > size => "more".to_owned(),
        n => n.to_string(),
    };
    let expected = format!("a chunk that unpacks to {size} bytes, as its header says");
    wrong(expected, &found)
}

/// How the messages of a topic are encoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RosEncoding {
    /// ROS 1.
    Ros1,
    /// CDR, ROS 2.
    Cdr,
}

/// Content of a bag.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Bag {
    /// Topic of the frames.
    pub topic: String,
    /// Frames in the order of the file.
    pub frames: Vec<RecordedFrame>,
    /// Points dropped because they are NaN or out of range. Clouds that are not dense contain NaN.
    pub points_dropped: u64,
    /// Points without an intensity, which have 0 dB.
    pub points_without_intensity: u64,
    /// Number of messages on other topics.
    pub other_messages: u64,
    /// Notes for the user: which clock was used, which topics of points were not.
    pub notes: Vec<String>,
}

/// Reason why a bag is refused.
#[derive(Clone, Debug, thiserror::Error, PartialEq, Eq)]
#[error("{error}")]
pub struct BagError {
    /// What is wrong.
    #[source]
    pub error: RecordingError,
    /// The topics with points, if the bag has several and the caller can name one.
    pub choices: Vec<String>,
}

impl From<RecordingError> for BagError {
    fn from(error: RecordingError) -> Self {
        Self {
            error,
            choices: Vec::new(),
        }
    }
}

/// What the messages of a topic are.
#[derive(Clone, Debug)]
enum Payload {
    /// `PointCloud2`.
    Cloud,
    /// `radar_msgs/RadarScan`: a list of range, azimuth, elevation, velocity and amplitude of each return.
    Returns,
    /// `RadarScan` of TI's driver with its fields after the header.
    Scan(Vec<(String, Primitive)>),
    Other,
}

/// A topic with the points read from it.
struct Topic {
    name: String,
    kind: String,
    encoding: RosEncoding,
    payload: Payload,
    frames: Vec<RecordedFrame>,
    /// When the recorder received the first message of each frame, s.
    recorded_s: Vec<Option<f64>>,
    points_dropped: u64,
    points_without_intensity: u64,
    messages: u64,
    /// The first error of a message; later ones are not read.
    error: Option<RecordingError>,
}

/// Collects the messages of a bag, one after the other, into frames.
pub struct RosMessages {
    /// The topic that the caller names.
    wanted: Option<String>,
    axes: Axes,
    topics: Vec<Topic>,
    /// Places of the connections in `topics`.
    connections: BTreeMap<u64, usize>,
}

impl RosMessages {
    /// Collects the points of a topic. If no topic is given, the bag must have one topic with points only, or one with
    /// clouds only.
    pub fn new(topic: Option<&str>, axes: Axes) -> Self {
        Self {
            wanted: topic.map(str::to_owned),
            axes,
            topics: Vec::new(),
            connections: BTreeMap::new(),
        }
    }

    /// Adds a connection: the topic and the type (`sensor_msgs/PointCloud2`, `sensor_msgs/msg/PointCloud2`) of the messages
    /// with this number. `definition` is the text of the message type, if the bag has it.
    ///
    /// # Errors
    /// Too many topics.
    pub fn connect(
        &mut self,
        at: Place,
        id: u64,
        topic: &str,
        kind: &str,
        encoding: Option<RosEncoding>,
        definition: Option<&str>,
    ) -> Result<(), RecordingError> {
        let known = |t: &Topic| t.name == topic && t.kind == kind;
        if let Some(place) = self.topics.iter().position(known) {
            self.connections.insert(id, place);
            return Ok(());
        }
        if self.topics.len() >= MAX_TOPICS {
            let expected = format!("at most {MAX_TOPICS} topics");
            return Err(RecordingError::new(at, expected, "more"));
        }
        let (package, name) = kind.split_once('/').unwrap_or(("", kind));
        let name = name.strip_prefix("msg/").unwrap_or(name);
        let mut error = None;
        let payload = match (package, name) {
            _ if encoding.is_none() => Payload::Other,
            ("sensor_msgs", "PointCloud2") => Payload::Cloud,
            ("radar_msgs", "RadarScan") => Payload::Returns,
            (package, "RadarScan") if package.starts_with("ti_mmwave") => {
                let definition = definition.filter(|text| !text.trim().is_empty());
                let fields = definition.map_or_else(|| Ok(scan_fields()), scan_fields_of);
                Payload::Scan(fields.unwrap_or_else(|line| {
                    error = Some(RecordingError::new(at, "a known type in RadarScan", &line));
                    Vec::new()
                }))
            }
            _ => Payload::Other,
        };
        self.connections.insert(id, self.topics.len());
        self.topics.push(Topic {
            name: topic.to_owned(),
            kind: kind.to_owned(),
            encoding: encoding.unwrap_or(RosEncoding::Cdr),
            payload,
            frames: Vec::new(),
            recorded_s: Vec::new(),
            points_dropped: 0,
            points_without_intensity: 0,
            messages: 0,
            error,
        });
        Ok(())
    }

    /// Whether messages of this connection are read.
    pub fn is_wanted(&self, id: u64) -> bool {
        let topic = self
            .connections
            .get(&id)
            .and_then(|at| self.topics.get(*at));
        topic.is_some_and(|t| self.reads(t))
    }

    fn reads(&self, topic: &Topic) -> bool {
        let is_named = self.wanted.as_ref().is_none_or(|name| *name == topic.name);
        is_named && !matches!(topic.payload, Payload::Other) && topic.error.is_none()
    }

    /// Adds a message with the time at which it was recorded, s. An error in it is returned by [`Self::finish`], if no other
    /// topic has points.
    ///
    /// # Errors
    /// A connection that was not added.
    pub fn message(
        &mut self,
        at: Place,
        id: u64,
        recorded_s: Option<f64>,
        data: &[u8],
    ) -> Result<(), RecordingError> {
        let place = self.connections.get(&id).copied();
        let is_wanted = self.is_wanted(id);
        let axes = self.axes;
        let Some(topic) = place.and_then(|place| self.topics.get_mut(place)) else {
            return Err(RecordingError::new(
                at,
                "a message of a known connection",
                "another",
            ));
        };
        topic.messages += 1;
        if is_wanted && let Err(error) = topic.read(at, recorded_s, data, axes) {
            topic.error = Some(error);
        }
        Ok(())
    }

    /// Returns the frames of the topic that was named, or of the only one with points: whole frames before single points, which
    /// the driver of TI sends both.
    ///
    /// # Errors
    /// No topic with points or several, or an error in the messages of the only one.
    pub fn finish(self, at: Place) -> Result<Bag, BagError> {
        let of_points: Vec<&Topic> = self
            .topics
            .iter()
            .filter(|t| !matches!(t.payload, Payload::Other))
            .collect();
        let names =
            |topics: &[&Topic]| -> Vec<String> { topics.iter().map(|t| t.name.clone()).collect() };
        let with_kind: Vec<String> = self
            .topics
            .iter()
            .map(|t| format!("{} ({})", t.name, t.kind))
            .collect();
        let with_kind: Vec<&str> = with_kind.iter().map(String::as_str).collect();
        let choices = match of_points.len() {
            0 | 1 => Vec::new(),
            _ => names(&of_points),
        };
        let wrong = |expected: String| BagError {
            error: RecordingError {
                at,
                expected,
                found: listed(&with_kind),
            },
            choices: choices.clone(),
        };
        let asked: Vec<&Topic> = match &self.wanted {
            Some(name) => of_points
                .iter()
                .copied()
                .filter(|t| t.name == *name)
                .collect(),
            None => of_points.clone(),
        };
        let whole = |t: &&&Topic| t.error.is_none() && !t.frames.is_empty();
        let mut candidates: Vec<&Topic> = asked.iter().filter(whole).copied().collect();
        let has_frames = |t: &&Topic| !matches!(t.payload, Payload::Scan(_));
        if candidates.iter().any(has_frames) {
            candidates.retain(has_frames);
        }
        let chosen = match candidates[..] {
            [chosen] => chosen,
            [] => {
                if let Some(error) = asked.iter().find_map(|t| t.error.clone()) {
                    return Err(BagError { error, choices });
                }
                let what =
                    "PointCloud2 messages, or RadarScan messages of radar_msgs or of TI's driver,";
                return Err(wrong(match &self.wanted {
                    Some(name) => format!("{what} on {}", printable(name)),
                    None => format!("a topic with {what} of a radar"),
                }));
            }
            _ => {
                let names = names(&candidates);
                let listed_names: Vec<&str> = names.iter().map(String::as_str).collect();
                return Err(BagError {
                    error: RecordingError {
                        at,
                        expected: "one topic with points, or a topic to be named".into(),
                        found: listed(&listed_names),
                    },
                    choices: names,
                });
            }
        };
        let mut notes = Vec::new();
        for other in of_points.iter().filter(|t| t.name != chosen.name) {
            if let Some(error) = &other.error {
                notes.push(format!(
                    "topic {} is not read: {error}",
                    printable(&other.name)
                ));
            }
        }
        let all: u64 = self.topics.iter().map(|t| t.messages).sum();
        let place = self.topics.iter().position(|t| std::ptr::eq(t, chosen));
        let chosen = place.and_then(|place| self.topics.into_iter().nth(place));
        let Some(mut chosen) = chosen else {
            return Ok(Bag::default());
        };
        settle_clock(&mut chosen.frames, &chosen.recorded_s, &mut notes);
        Ok(Bag {
            topic: chosen.name,
            frames: chosen.frames,
            points_dropped: chosen.points_dropped,
            points_without_intensity: chosen.points_without_intensity,
            other_messages: all - chosen.messages,
            notes,
        })
    }
}

/// Puts frames into the order of their recording, and uses the times of the recorder where the stamps in the messages are
/// zero or do not advance.
fn settle_clock(
    frames: &mut Vec<RecordedFrame>,
    recorded_s: &[Option<f64>],
    notes: &mut Vec<String>,
) {
    let mut with_time: Vec<(Option<f64>, RecordedFrame)> = recorded_s
        .iter()
        .copied()
        .zip(std::mem::take(frames))
        .collect();
    if with_time.iter().all(|(t, _)| t.is_some()) {
        // Files and chunks of a recording can overlap.
        with_time.sort_by(|a, b| a.0.unwrap_or(0.0).total_cmp(&b.0.unwrap_or(0.0)));
    }
    let advances = |times: &mut dyn Iterator<Item = Option<f64>>| {
        let times: Option<Vec<f64>> = times.collect();
        times.filter(|t| t.iter().all(|t| *t > 0.0) && (t.len() < 2 || t.first() < t.last()))
    };
    if advances(&mut with_time.iter().map(|(_, f)| f.stamp_s)).is_none() {
        let recorded = advances(&mut with_time.iter().map(|(t, _)| *t));
        notes.push(match recorded {
            Some(_) => {
                "the stamps of the messages are zero or do not advance: the times are those of the recorder".into()
            }
            None => "neither the messages nor the recorder have times that advance".into(),
        });
        for (time, frame) in &mut with_time {
            frame.stamp_s = recorded.as_ref().and(*time);
        }
    }
    *frames = with_time.into_iter().map(|(_, frame)| frame).collect();
    for (number, frame) in frames.iter_mut().enumerate() {
        frame.number = number as u64;
    }
}

impl Topic {
    fn read(
        &mut self,
        at: Place,
        recorded_s: Option<f64>,
        data: &[u8],
        axes: Axes,
    ) -> Result<(), RecordingError> {
        let mut cursor = Cursor::new(at, self.encoding, data)?;
        let n_frames = self.frames.len();
        match &self.payload {
            Payload::Cloud => self.add(read_cloud(&mut cursor, axes)?),
            Payload::Returns => self.add(read_returns(&mut cursor, axes)?),
            Payload::Scan(fields) => {
                let scan = read_scan(&mut cursor, fields)?;
                let point = within_limits(axes, scan.values);
                self.points_dropped += u64::from(point.is_none());
                radhar::add_point(&mut self.frames, scan.point_id, Some(scan.stamp_s), point);
            }
            Payload::Other => {}
        }
        if self.frames.len() > n_frames {
            self.recorded_s.push(recorded_s);
        }
        Ok(())
    }

    fn add(&mut self, cloud: Cloud) {
        self.points_dropped += cloud.dropped;
        if !cloud.has_intensity {
            self.points_without_intensity += cloud.points.len() as u64;
        }
        self.frames.push(RecordedFrame {
            number: 0,
            stamp_s: Some(cloud.stamp_s),
            points: cloud.points,
            board: None,
        });
    }
}

/// A point from three coordinates, a velocity and an intensity; `None` if one is not a number or beyond belief.
fn within_limits(
    axes: Axes,
    [x, y, z, velocity_mps, intensity_db]: [f64; 5],
) -> Option<RadarPoint> {
    let is_plausible = is_in_range([x, y, z])
        && velocity_mps.abs() <= MAX_VELOCITY_MPS
        && intensity_db.abs() <= MAX_INTENSITY_DB;
    is_plausible.then(|| point(axes.to_project([x, y, z]), velocity_mps, intensity_db))
}

/// Reads a message from front to back.
struct Cursor<'a> {
    at: Place,
    data: &'a [u8],
    /// Number of bytes read of `data`. Of CDR, `data` begins after the four bytes that state the byte order.
    read: usize,
    is_aligned: bool,
    big_endian: bool,
}

impl<'a> Cursor<'a> {
    fn new(at: Place, encoding: RosEncoding, data: &'a [u8]) -> Result<Self, RecordingError> {
        let mut cursor = Self {
            at,
            data,
            read: 0,
            is_aligned: false,
            big_endian: false,
        };
        if encoding == RosEncoding::Ros1 {
            return Ok(cursor);
        }
        // The representation: 0 and 1 are CDR, 6 and 7 its second version, which pads these messages alike. Odd ones are
        // little-endian.
        let [high, low, _, _] = cursor.array()?;
        if high != 0 || !matches!(low, 0 | 1 | 6 | 7) {
            return Err(RecordingError::new(
                at,
                "CDR in plain representation, 0, 1, 6 or 7",
                &format!("{}", u16::from_be_bytes([high, low])),
            ));
        }
        cursor.data = &data[4..];
        cursor.read = 0;
        cursor.is_aligned = true;
        cursor.big_endian = low % 2 == 0;
        Ok(cursor)
    }

    fn bytes(&mut self, n: usize) -> Result<&'a [u8], RecordingError> {
        let end = self.read.checked_add(n);
        let bytes = end.and_then(|end| self.data.get(self.read..end));
        let bytes =
            bytes.ok_or_else(|| RecordingError::new(self.at, "a whole message", "its end"))?;
        self.read += n;
        Ok(bytes)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], RecordingError> {
        if self.is_aligned && N > 1 {
            let padding = self.read.next_multiple_of(N) - self.read;
            self.bytes(padding)?;
        }
        let mut array = [0; N];
        array.copy_from_slice(self.bytes(N)?);
        if self.big_endian {
            array.reverse();
        }
        Ok(array)
    }

    fn u8(&mut self) -> Result<u8, RecordingError> {
        Ok(u8::from_le_bytes(self.array()?))
    }

    fn u32(&mut self) -> Result<u32, RecordingError> {
        Ok(u32::from_le_bytes(self.array()?))
    }

    /// A length and as many bytes: a string, or the data of a cloud.
    fn block(&mut self) -> Result<&'a [u8], RecordingError> {
        let n = self.u32()? as usize;
        self.bytes(n)
    }

    /// A string. That of CDR ends with a zero byte.
    fn string(&mut self) -> Result<String, RecordingError> {
        let bytes = self.block()?;
        let bytes = bytes.strip_suffix(&[0]).unwrap_or(bytes);
        Ok(String::from_utf8_lossy(bytes).into_owned())
    }

    /// The header of a message: the stamp in s.
    fn header(&mut self) -> Result<f64, RecordingError> {
        if !self.is_aligned {
            // A counter, which ROS 2 no longer has.
            self.u32()?;
        }
        // Signed in ROS 2, unsigned in ROS 1: times before 1970 are none of a recording.
        let stamp_s = f64::from(self.u32()?) + f64::from(self.u32()?) * 1e-9;
        self.block()?;
        Ok(stamp_s)
    }
}

/// Types of a message's fields.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Primitive {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    U64,
    I64,
    F32,
    F64,
    Time,
    Text,
}

impl Primitive {
    fn of(name: &str) -> Option<Self> {
        Some(match name {
            "bool" | "uint8" | "byte" | "char" => Self::U8,
            "int8" => Self::I8,
            "uint16" => Self::U16,
            "int16" => Self::I16,
            "uint32" => Self::U32,
            "int32" => Self::I32,
            "uint64" => Self::U64,
            "int64" => Self::I64,
            "float32" => Self::F32,
            "float64" => Self::F64,
            "time" | "duration" | "builtin_interfaces/Time" => Self::Time,
            "string" => Self::Text,
            _ => return None,
        })
    }

    fn read(self, cursor: &mut Cursor<'_>) -> Result<f64, RecordingError> {
        Ok(match self {
            Self::U8 => cursor.u8()?.into(),
            Self::I8 => i8::from_le_bytes(cursor.array()?).into(),
            Self::U16 => u16::from_le_bytes(cursor.array()?).into(),
            Self::I16 => i16::from_le_bytes(cursor.array()?).into(),
            Self::U32 => cursor.u32()?.into(),
            Self::I32 => i32::from_le_bytes(cursor.array()?).into(),
            Self::U64 => u64::from_le_bytes(cursor.array()?) as f64,
            Self::I64 => i64::from_le_bytes(cursor.array()?) as f64,
            Self::F32 => f32::from_le_bytes(cursor.array()?).into(),
            Self::F64 => f64::from_le_bytes(cursor.array()?),
            Self::Time => f64::from(cursor.u32()?) + f64::from(cursor.u32()?) * 1e-9,
            Self::Text => {
                cursor.block()?;
                f64::NAN
            }
        })
    }
}

/// The values of a `RadarScan` that are used: the number of the point, then those of [`within_limits`].
const SCAN_VALUES: [&str; 6] = ["point_id", "x", "y", "z", "velocity", "intensity"];

/// The fields after the header where the bag has no definition: those of `ti_mmwave_rospkg/msg/RadarScan.msg`.
fn scan_fields() -> Vec<(String, Primitive)> {
    [
        ("point_id", Primitive::U16),
        ("x", Primitive::F32),
        ("y", Primitive::F32),
        ("z", Primitive::F32),
        ("range", Primitive::F32),
        ("velocity", Primitive::F32),
        ("doppler_bin", Primitive::U16),
        ("bearing", Primitive::F32),
        ("intensity", Primitive::F32),
    ]
    .map(|(name, kind)| (name.to_owned(), kind))
    .to_vec()
}

/// The fields after the header by the text of the message type; `Err` with the line that is not known.
fn scan_fields_of(definition: &str) -> Result<Vec<(String, Primitive)>, String> {
    let mut fields = Vec::new();
    let mut has_header = false;
    for line in definition.lines().take_while(|l| !l.starts_with("===")) {
        let line = line.split('#').next().unwrap_or_default().trim();
        if line.is_empty() || line.contains('=') {
            continue;
        }
        let mut words = line.split_whitespace();
        let (kind, name) = (words.next(), words.next());
        let (Some(kind), Some(name)) = (kind, name) else {
            return Err(line.to_owned());
        };
        if !has_header && fields.is_empty() && kind.ends_with("Header") {
            has_header = true;
        } else {
            let kind = Primitive::of(kind).ok_or_else(|| line.to_owned())?;
            fields.push((name.to_owned(), kind));
        }
    }
    let missing = |name: &&&str| !fields.iter().any(|(n, _)| n == **name);
    match SCAN_VALUES.iter().find(missing) {
        Some(name) => Err(format!("no {name}")),
        None if !has_header => Err("no Header".into()),
        None => Ok(fields),
    }
}

/// Reads `radar_msgs/RadarScan`: for each return the range in m, azimuth and elevation in rad, the velocity in m/s and the
/// amplitude in dB, all float32. Azimuths grow anticlockwise, to the left.
fn read_returns(cursor: &mut Cursor<'_>, axes: Axes) -> Result<Cloud, RecordingError> {
    let stamp_s = cursor.header()?;
    let mut points = Vec::new();
    let mut dropped = 0;
    for _ in 0..cursor.u32()? {
        let mut values = [0.0; 5];
        for value in &mut values {
            *value = Primitive::F32.read(cursor)?;
        }
        let [
            range_m,
            azimuth_rad,
            elevation_rad,
            velocity_mps,
            amplitude_db,
        ] = values;
        // In axes of which the second points to the left, as ROS has them.
        let azimuth_rad = match axes {
            Axes::ForwardLeftUp => azimuth_rad,
            Axes::RightForwardUp => -azimuth_rad,
        };
        let [x, y, z] = angles_to_position(axes, [range_m, azimuth_rad, elevation_rad]);
        match within_limits(axes, [x, y, z, velocity_mps, amplitude_db]) {
            Some(point) => points.push(point),
            None => dropped += 1,
        }
    }
    Ok(Cloud {
        stamp_s,
        points,
        dropped,
        has_intensity: true,
    })
}

/// A point of a scan.
struct Scan {
    stamp_s: f64,
    point_id: u64,
    values: [f64; 5],
}

fn read_scan(
    cursor: &mut Cursor<'_>,
    fields: &[(String, Primitive)],
) -> Result<Scan, RecordingError> {
    let stamp_s = cursor.header()?;
    let mut used = [f64::NAN; SCAN_VALUES.len()];
    for (name, kind) in fields {
        let value = kind.read(cursor)?;
        if let Some(place) = SCAN_VALUES.iter().position(|n| n == name) {
            used[place] = value;
        }
    }
    let [point_id, values @ ..] = used;
    Ok(Scan {
        stamp_s,
        point_id: point_id as u64,
        values,
    })
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

/// A cloud, with what its points lack.
struct Cloud {
    stamp_s: f64,
    points: Vec<RadarPoint>,
    dropped: u64,
    has_intensity: bool,
}

/// A field of a cloud with its meaning and name.
type NamedField = (Meaning, Field, String);

/// The fields of a cloud that are used. Of several for one quantity, the usual name is preferred, then the first.
#[derive(Default)]
struct Fields {
    used: Vec<NamedField>,
    all: Vec<String>,
}

impl Fields {
    fn add(&mut self, name: String, field: Field) {
        if let Some(meaning) = meaning(&name) {
            let same = |(m, ..): &&mut NamedField| m.column == meaning.column;
            match self.used.iter_mut().find(same) {
                None => self.used.push((meaning, field, name.clone())),
                Some(old) if meaning.rank() < old.0.rank() => {
                    *old = (meaning, field, name.clone());
                }
                Some(_) => {}
            }
        }
        self.all.push(name);
    }

    fn get(&self, column: Column) -> Option<&NamedField> {
        self.used.iter().find(|(m, ..)| m.column == column)
    }

    /// The field of a quantity with the factor to its unit, within points of `point_step` bytes.
    fn place(
        &self,
        at: Place,
        column: Column,
        point_step: usize,
    ) -> Result<Option<(Field, Unit)>, RecordingError> {
        let Some((meaning, field, name)) = self.get(column) else {
            return Ok(None);
        };
        let end = field.size().and_then(|size| field.offset.checked_add(size));
        if end.is_none_or(|end| end > point_step) {
            let found = format!("offset {}, type {}", field.offset, field.datatype);
            let expected = format!("`{}` within point_step {point_step}", printable(name));
            return Err(RecordingError::new(at, expected, &found));
        }
        let unit = match meaning.unit {
            // Drivers send the power in dB.
            Unit::Power if !meaning.states_unit => Unit::Scale(1.0),
            unit => unit,
        };
        Ok(Some((*field, unit)))
    }
}

fn read_cloud(cursor: &mut Cursor<'_>, axes: Axes) -> Result<Cloud, RecordingError> {
    let at = cursor.at;
    let stamp_s = cursor.header()?;
    let (height, width) = (cursor.u32()? as usize, cursor.u32()? as usize);
    let mut fields = Fields::default();
    for _ in 0..cursor.u32()? {
        let name = cursor.string()?;
        let offset = cursor.u32()? as usize;
        let datatype = cursor.u8()?;
        cursor.u32()?;
        fields.add(name, Field { offset, datatype });
    }
    let big_endian = cursor.u8()? != 0;
    let (point_step, row_step) = (cursor.u32()? as usize, cursor.u32()? as usize);
    let data = cursor.block()?;
    let has = |column| fields.get(column).is_some();
    let missing = missing_of_point(has);
    if !missing.is_empty() {
        let all: Vec<&str> = fields.all.iter().map(String::as_str).collect();
        let expected = format!("fields {}", listed(&missing));
        return Err(RecordingError::listing(at, expected, &all));
    }
    let flat = [Column::X, Column::Y, Column::Z];
    let is_flat = flat.into_iter().all(has);
    let [a, b, c] = match is_flat {
        true => flat,
        false => [Column::Range, Column::Azimuth, Column::Elevation],
    };
    let columns = [a, b, c, Column::Velocity, Column::Intensity];
    let mut places = [None; 5];
    for (place, column) in places.iter_mut().zip(columns) {
        *place = fields.place(at, column, point_step)?;
    }
    let row_fits = width.checked_mul(point_step).is_some_and(|n| n <= row_step);
    if !row_fits || row_step.checked_mul(height) != Some(data.len()) {
        let expected = format!(
            "row_step at least {width} x {point_step}, {height} rows in {} bytes",
            data.len()
        );
        return Err(RecordingError::new(
            at,
            expected,
            &format!("row_step {row_step}"),
        ));
    }
    let mut points = Vec::new();
    let mut dropped = 0;
    // Rows of no bytes hold no points, however many the message states.
    if width > 0 && height > 0 && point_step > 0 {
        for raw in data
            .chunks_exact(row_step)
            .flat_map(|row| row.chunks_exact(point_step).take(width))
        {
            let mut values = places.map(|place| match place {
                None => 0.0,
                Some((field, Unit::Scale(scale))) => field.value(raw, big_endian) * scale,
                Some((field, Unit::Amplitude)) => 20.0 * field.value(raw, big_endian).log10(),
                Some((field, Unit::Power)) => 10.0 * field.value(raw, big_endian).log10(),
            });
            if !is_flat {
                let [range_m, azimuth_rad, elevation_rad, ..] = values;
                let position = angles_to_position(axes, [range_m, azimuth_rad, elevation_rad]);
                values[..3].copy_from_slice(&position);
            }
            match within_limits(axes, values) {
                Some(point) => points.push(point),
                None => dropped += 1,
            }
        }
    }
    Ok(Cloud {
        stamp_s,
        points,
        dropped,
        has_intensity: has(Column::Intensity),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scans_are_laid_out_by_their_definition() {
        let definition = "Header header\nuint16 point_id # number\n\nfloat32 x\nfloat32 y\nfloat32 z\nfloat32 range\n\
                          float32 velocity\nuint16 doppler_bin\nfloat32 bearing\nfloat32 intensity\n\
                          ================\nMSG: std_msgs/Header\nuint32 seq\n";
        assert_eq!(scan_fields_of(definition), Ok(scan_fields()));
        let of_ros2 = definition.replace("Header header", "std_msgs/Header header\nuint8 KIND=3");
        assert_eq!(scan_fields_of(&of_ros2), Ok(scan_fields()));
        for (from, to, error) in [
            ("float32 range", "Range range", "Range range"),
            ("float32 intensity", "", "no intensity"),
            ("Header header", "", "no Header"),
            ("float32 x\n", "float32\n", "float32"),
        ] {
            let wrong = definition.replace(from, to);
            assert_eq!(scan_fields_of(&wrong), Err(error.into()));
        }
    }
}
