//! Parses JSON into frames row by row, without building a tree of the file. Every error names its frame and key.

use std::borrow::Cow;
use std::fmt;

use radarllm_base::RadarPoint;
use serde::de::{self, DeserializeSeed, IgnoredAny, MapAccess, SeqAccess, Visitor};

use super::{VisualizerCounts, VisualizerFrame, VisualizerPart};
use crate::recordings::{
    MAX_COORDINATE_M, MAX_VELOCITY_MPS, Place, RecordedFrame, RecordingError, is_in_range, point,
    printable,
};
use crate::uart::{Target, TargetHeight};

/// Most frames of a file; the visualizer writes 100.
const MAX_FRAMES: usize = 200_000;
/// Maximum number of unknown point clouds whose keys are kept for a note.
const MAX_UNREAD_CLOUDS: usize = 8;
/// Number of values in a row of `pointCloud` and of `pointCloudMinor`.
const POINT_NUMBERS: usize = 7;
/// Place of the noise in such a row.
const NOISE_AT: usize = 5;
/// Number of values in a row of `trackData` that are used; more may follow.
const TRACK_NUMBERS: usize = 10;
/// Number of values in a row of `heightData`.
const HEIGHT_NUMBERS: usize = 3;
/// Latest time stamp accepted, ms since 1970: the year 2286.
const MAX_STAMP_MS: f64 = 1e13;
/// Largest frame number accepted; the firmware has a 32-bit counter.
const MAX_NUMBER: f64 = u32::MAX as f64;

/// Reads a file. The intensity of its points is the SNR as stored in the file.
pub(super) fn part(text: &str) -> Result<VisualizerPart, RecordingError> {
    let text = without_nan(text.trim_start_matches('\u{feff}'));
    let mut part = VisualizerPart::default();
    let mut input = serde_json::Deserializer::from_str(&text);
    let read = FileSeed { part: &mut part }.deserialize(&mut input);
    let has_data = read
        .and_then(|has_data| input.end().map(|()| has_data))
        .map_err(|e| json_error(&e))?;
    if !has_data {
        let expected = "a recording of a TI visualizer, with `data`";
        return Err(RecordingError::new(Place::Line(1), expected, "no such key"));
    }
    Ok(part)
}

/// Deserialises the whole file; the result tells whether it has `data`.
struct FileSeed<'a> {
    part: &'a mut VisualizerPart,
}

impl<'de> DeserializeSeed<'de> for FileSeed<'_> {
    type Value = bool;

    fn deserialize<D: de::Deserializer<'de>>(self, input: D) -> Result<bool, D::Error> {
        input.deserialize_map(self)
    }
}

impl<'de> Visitor<'de> for FileSeed<'_> {
    type Value = bool;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an object with `data`, as a TI visualizer writes it")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<bool, A::Error> {
        let mut has_data = false;
        while let Some(key) = map.next_key::<String>()? {
            match key.as_str() {
                "cfg" => self.part.cfg = map.next_value_seed(Text { key: "cfg" })?,
                "demo" => self.part.demo = map.next_value_seed(Text { key: "demo" })?,
                "device" => self.part.device = map.next_value_seed(Text { key: "device" })?,
                "data" => {
                    has_data = true;
                    map.next_value_seed(FramesSeed { part: self.part })?;
                }
                _ => drop(map.next_value::<IgnoredAny>()?),
            }
        }
        Ok(has_data)
    }
}

/// Text, or an array of lines; `None` for null and for empty text.
struct Text {
    key: &'static str,
}

impl<'de> DeserializeSeed<'de> for Text {
    type Value = Option<String>;

    fn deserialize<D: de::Deserializer<'de>>(self, input: D) -> Result<Self::Value, D::Error> {
        input.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Text {
    type Value = Option<String>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "`{}` as a text or an array of lines", self.key)
    }

    fn visit_str<E: de::Error>(self, text: &str) -> Result<Self::Value, E> {
        Ok((!text.trim().is_empty()).then(|| text.to_owned()))
    }

    fn visit_unit<E: de::Error>(self) -> Result<Self::Value, E> {
        Ok(None)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut lines: A) -> Result<Self::Value, A::Error> {
        let mut text = String::new();
        while let Some(line) = lines.next_element::<String>()? {
            text.push_str(&line);
            if !line.ends_with('\n') {
                text.push('\n');
            }
        }
        self.visit_str(&text)
    }
}

/// The array of frames.
struct FramesSeed<'a> {
    part: &'a mut VisualizerPart,
}

impl<'de> DeserializeSeed<'de> for FramesSeed<'_> {
    type Value = ();

    fn deserialize<D: de::Deserializer<'de>>(self, input: D) -> Result<(), D::Error> {
        input.deserialize_seq(self)
    }
}

impl<'de> Visitor<'de> for FramesSeed<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("`data` as an array of frames")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut entries: A) -> Result<(), A::Error> {
        let VisualizerPart {
            frames,
            counts,
            has_noise,
            ..
        } = self.part;
        // If a key occurs twice, the last one is used, as in Python.
        frames.clear();
        *counts = VisualizerCounts::default();
        *has_noise = false;
        for index in 0.. {
            let mut entry = Entry::new(index, counts, has_noise);
            if entries.next_element_seed(&mut entry)?.is_none() {
                return Ok(());
            }
            if let Some(frame) = entry.finish() {
                frames.push(frame);
            }
            if frames.len() > MAX_FRAMES {
                let problem = format!("more frames, expected at most {MAX_FRAMES} in `data`");
                return Err(de::Error::custom(problem));
            }
        }
        Ok(())
    }
}

/// One element of `data` during parsing.
struct Entry<'a> {
    index: usize,
    counts: &'a mut VisualizerCounts,
    has_noise: &'a mut bool,
    has_error: bool,
    number: Option<u64>,
    stamp_s: Option<f64>,
    points: Vec<RadarPoint>,
    points_minor: Vec<RadarPoint>,
    tracks: Vec<Target>,
    heights: Vec<TargetHeight>,
}

impl<'a> Entry<'a> {
    fn new(index: usize, counts: &'a mut VisualizerCounts, has_noise: &'a mut bool) -> Self {
        Self {
            index,
            counts,
            has_noise,
            has_error: false,
            number: None,
            stamp_s: None,
            points: Vec::new(),
            points_minor: Vec::new(),
            tracks: Vec::new(),
            heights: Vec::new(),
        }
    }

    fn finish(mut self) -> Option<VisualizerFrame> {
        self.counts.frames_with_error += u64::from(self.has_error);
        let Some(number) = self.number else {
            self.counts.frames_without_number += 1;
            return None;
        };
        self.points.append(&mut self.points_minor);
        Some(VisualizerFrame {
            frame: RecordedFrame {
                number,
                stamp_s: self.stamp_s,
                points: self.points,
                board: None,
            },
            tracks: self.tracks,
            heights: self.heights,
        })
    }

    /// A number of the frame, checked against limits.
    fn number<'de, A: MapAccess<'de>>(
        &self,
        map: &mut A,
        key: &'static str,
        is_whole: bool,
        max: f64,
    ) -> Result<Option<f64>, A::Error> {
        let (frame, row) = (self.index, None);
        let value = map.next_value_seed(Number { key, frame, row })?;
        if value.is_nan() {
            return Ok(None);
        }
        if !(0.0..=max).contains(&value) || is_whole && value.fract() != 0.0 {
            let kind = if is_whole { "whole number" } else { "number" };
            let expected = format!("a {kind} from 0 to {max} as `{key}` of frame {frame}");
            let found = de::Unexpected::Float(value);
            return Err(de::Error::invalid_value(found, &expected.as_str()));
        }
        Ok(Some(value))
    }

    fn read_data<'de, A: MapAccess<'de>>(&mut self, mut map: A) -> Result<(), A::Error> {
        while let Some(key) = map.next_key::<String>()? {
            match key.as_str() {
                "error" => {
                    let (frame, row) = (self.index, None);
                    let value = map.next_value_seed(Number {
                        key: "error",
                        frame,
                        row,
                    })?;
                    self.has_error = value != 0.0;
                }
                "frameNum" => {
                    let number = self.number(&mut map, "frameNum", true, MAX_NUMBER)?;
                    self.number = number.map(|n| n as u64);
                }
                "pointCloud" => self.points = self.read_points(&mut map, "pointCloud")?,
                "pointCloudMinor" => {
                    self.points_minor = self.read_points(&mut map, "pointCloudMinor")?;
                }
                "trackData" => {
                    self.tracks.clear();
                    let seed = Rows {
                        key: "trackData",
                        frame: self.index,
                        n_used: TRACK_NUMBERS,
                        may_be_longer: true,
                        take: &mut |_, v| match track(v) {
                            Some(track) => self.tracks.push(track),
                            None => self.counts.tracks_dropped += 1,
                        },
                    };
                    map.next_value_seed(seed)?;
                }
                "heightData" => {
                    self.heights.clear();
                    let seed = Rows {
                        key: "heightData",
                        frame: self.index,
                        n_used: HEIGHT_NUMBERS,
                        may_be_longer: false,
                        take: &mut |_, v| match height(v) {
                            Some(height) => self.heights.push(height),
                            None => self.counts.tracks_dropped += 1,
                        },
                    };
                    map.next_value_seed(seed)?;
                }
                _ => {
                    let unread = &mut self.counts.unread_clouds;
                    if key.starts_with("pointCloud") && unread.len() < MAX_UNREAD_CLOUDS {
                        unread.insert(printable(&key));
                    }
                    map.next_value::<IgnoredAny>()?;
                }
            }
        }
        Ok(())
    }

    /// The points of an array of rows.
    fn read_points<'de, A: MapAccess<'de>>(
        &mut self,
        map: &mut A,
        key: &'static str,
    ) -> Result<Vec<RadarPoint>, A::Error> {
        let mut points = Vec::new();
        map.next_value_seed(Rows {
            key,
            frame: self.index,
            n_used: POINT_NUMBERS,
            may_be_longer: false,
            take: &mut |row, values| {
                take_point(&mut points, self.counts, key, self.index, row, values);
                // The visualizer marks points of slow motion by a 1 in the place of the noise.
                let noise = values.get(NOISE_AT).filter(|noise| noise.is_finite());
                *self.has_noise |= key == "pointCloud" && noise.is_some_and(|noise| *noise != 0.0);
            },
        })?;
        if key == "pointCloudMinor" {
            self.counts.points_minor += points.len() as u64;
        }
        Ok(points)
    }
}

/// Adds a row of points, or drops and counts it by the same rules as in a UART stream. The intensity is the SNR
/// as stored in the file.
fn take_point(
    points: &mut Vec<RadarPoint>,
    counts: &mut VisualizerCounts,
    key: &str,
    frame: usize,
    row: usize,
    values: &[f64],
) {
    let &[x, y, z, velocity_mps, snr, ..] = values else {
        return;
    };
    if [x, y, velocity_mps, snr] == [0.0; 4] {
        // z is ignored because the visualizer may have added the height of the sensor.
        counts.points_empty += 1;
        return;
    }
    let is_finite = [x, y, z, velocity_mps, snr].iter().all(|v| v.is_finite());
    let is_near = is_in_range([x, y, z])
        && velocity_mps.abs() <= MAX_VELOCITY_MPS
        && snr.abs() <= f64::from(f32::MAX);
    if is_finite && is_near {
        points.push(point([x, y, z], velocity_mps, snr));
        return;
    }
    match is_finite {
        true => counts.points_out_of_range += 1,
        false => counts.points_not_finite += 1,
    }
    counts
        .first_dropped
        .get_or_insert_with(|| format!("row {row} of `{key}` of frame {frame}"));
}

/// The number of a track. The firmware counts tracks from 0.
fn track_id(value: f64) -> Option<u32> {
    (value >= 0.0 && value <= f64::from(u32::MAX) && value.fract() == 0.0).then_some(value as u32)
}

fn within<const N: usize>(values: &[f64]) -> Option<[f32; N]> {
    let values: &[f64; N] = values.first_chunk()?;
    (values.iter().all(|v| v.abs() <= MAX_COORDINATE_M)).then(|| values.map(|v| v as f32))
}

fn track(values: &[f64]) -> Option<Target> {
    let (id, rest) = values.split_first()?;
    let [x, y, z, vx, vy, vz, ax, ay, az] = within(rest)?;
    Some(Target {
        id: track_id(*id)?,
        position_m: [x, y, z],
        velocity_mps: [vx, vy, vz],
        acceleration_mps2: [ax, ay, az],
    })
}

fn height(values: &[f64]) -> Option<TargetHeight> {
    let (id, rest) = values.split_first()?;
    let [top_m, bottom_m] = within(rest)?;
    Some(TargetHeight {
        id: track_id(*id)?,
        top_m,
        bottom_m,
    })
}

impl<'de> DeserializeSeed<'de> for &mut Entry<'_> {
    type Value = ();

    fn deserialize<D: de::Deserializer<'de>>(self, input: D) -> Result<(), D::Error> {
        input.deserialize_map(self)
    }
}

impl<'de> Visitor<'de> for &mut Entry<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "frame {} as an object with `frameData`", self.index)
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<(), A::Error> {
        while let Some(key) = map.next_key::<String>()? {
            match key.as_str() {
                "timestamp" => {
                    let stamp_ms = self.number(&mut map, "timestamp", false, MAX_STAMP_MS)?;
                    self.stamp_s = stamp_ms.map(|ms| ms * 1e-3);
                }
                "frameData" => map.next_value_seed(FrameDataSeed(self))?,
                _ => drop(map.next_value::<IgnoredAny>()?),
            }
        }
        Ok(())
    }
}

/// The object `frameData`.
struct FrameDataSeed<'a, 'b>(&'a mut Entry<'b>);

impl<'de> DeserializeSeed<'de> for FrameDataSeed<'_, '_> {
    type Value = ();

    fn deserialize<D: de::Deserializer<'de>>(self, input: D) -> Result<(), D::Error> {
        input.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for FrameDataSeed<'_, '_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "`frameData` of frame {} as an object", self.0.index)
    }

    fn visit_unit<E: de::Error>(self) -> Result<(), E> {
        Ok(())
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<(), A::Error> {
        self.0.read_data(map)
    }
}

/// An array of rows of numbers.
struct Rows<'a> {
    key: &'static str,
    frame: usize,
    /// Number of values of a row that are passed to `take`.
    n_used: usize,
    may_be_longer: bool,
    /// Receives the index of a row and its numbers; null becomes NaN.
    take: &'a mut dyn FnMut(usize, &[f64]),
}

impl<'de> DeserializeSeed<'de> for Rows<'_> {
    type Value = ();

    fn deserialize<D: de::Deserializer<'de>>(self, input: D) -> Result<(), D::Error> {
        input.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Rows<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "`{}` of frame {} as an array of rows",
            self.key, self.frame
        )
    }

    fn visit_unit<E: de::Error>(self) -> Result<(), E> {
        Ok(())
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut rows: A) -> Result<(), A::Error> {
        let mut values = Vec::with_capacity(self.n_used);
        for row in 0.. {
            values.clear();
            let seed = Row {
                rows: &self,
                row,
                values: &mut values,
            };
            if rows.next_element_seed(seed)?.is_none() {
                return Ok(());
            }
            (self.take)(row, &values);
        }
        Ok(())
    }
}

/// One row of numbers.
struct Row<'a, 'b> {
    rows: &'a Rows<'b>,
    row: usize,
    values: &'a mut Vec<f64>,
}

impl<'de> DeserializeSeed<'de> for Row<'_, '_> {
    type Value = ();

    fn deserialize<D: de::Deserializer<'de>>(self, input: D) -> Result<(), D::Error> {
        input.deserialize_seq(self)
    }
}

impl<'de> Visitor<'de> for Row<'_, '_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Rows {
            key,
            frame,
            n_used,
            may_be_longer,
            ..
        } = self.rows;
        let min = if *may_be_longer { "at least " } else { "" };
        write!(
            f,
            "{min}{n_used} numbers in row {} of `{key}` of frame {frame}",
            self.row
        )
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut row: A) -> Result<(), A::Error> {
        let number = || Number {
            key: self.rows.key,
            frame: self.rows.frame,
            row: Some(self.row),
        };
        let mut n = 0;
        while let Some(value) = row.next_element_seed(number())? {
            if n < self.rows.n_used {
                self.values.push(value);
            }
            n += 1;
        }
        if n < self.rows.n_used || n > self.rows.n_used && !self.rows.may_be_longer {
            return Err(de::Error::invalid_length(n, &self));
        }
        Ok(())
    }
}

/// A number. Null, which replaces numbers that are not finite, becomes NaN.
struct Number {
    key: &'static str,
    frame: usize,
    row: Option<usize>,
}

impl<'de> DeserializeSeed<'de> for Number {
    type Value = f64;

    fn deserialize<D: de::Deserializer<'de>>(self, input: D) -> Result<f64, D::Error> {
        input.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Number {
    type Value = f64;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a number in ")?;
        if let Some(row) = self.row {
            write!(f, "row {row} of ")?;
        }
        write!(f, "`{}` of frame {}", self.key, self.frame)
    }

    fn visit_f64<E: de::Error>(self, value: f64) -> Result<f64, E> {
        Ok(value)
    }

    fn visit_u64<E: de::Error>(self, value: u64) -> Result<f64, E> {
        Ok(value as f64)
    }

    fn visit_i64<E: de::Error>(self, value: i64) -> Result<f64, E> {
        Ok(value as f64)
    }

    fn visit_unit<E: de::Error>(self) -> Result<f64, E> {
        Ok(f64::NAN)
    }
}
/// Replaces NaN, Infinity and -Infinity by `null`. Python writes them although they are not valid JSON.
fn without_nan(text: &str) -> Cow<'_, str> {
    const WORDS: [&str; 3] = ["NaN", "Infinity", "-Infinity"];
    if !WORDS.iter().any(|word| text.contains(word)) {
        return Cow::Borrowed(text);
    }
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    // Outside of strings, copies the text up to the next quote or invalid number.
    while let Some(at) = rest.find(['"', 'N', 'I', '-']) {
        out.push_str(&rest[..at]);
        rest = &rest[at..];
        let len = if rest.starts_with('"') {
            let len = string_len(rest);
            out.push_str(&rest[..len]);
            len
        } else if let Some(word) = WORDS.iter().find(|word| rest.starts_with(**word)) {
            out.push_str("null");
            word.len()
        } else {
            out.push_str(&rest[..1]);
            1
        };
        rest = &rest[len..];
    }
    out.push_str(rest);
    Cow::Owned(out)
}

/// Length of the string at the start of a text, including both quotes, bytes.
fn string_len(text: &str) -> usize {
    let bytes = text.as_bytes();
    let mut at = 1;
    while let Some(byte) = bytes.get(at) {
        match byte {
            b'"' => return at + 1,
            b'\\' => at += 2,
            _ => at += 1,
        }
    }
    bytes.len()
}

/// Converts an error of the JSON parser, whose text is "PROBLEM, expected WHAT at line L column C".
fn json_error(error: &serde_json::Error) -> RecordingError {
    let text = error.to_string();
    let text = text
        .rsplit_once(" at line ")
        .map_or(text.as_str(), |(text, _)| text);
    let (found, expected) = text
        .split_once(", expected ")
        .unwrap_or((text, "JSON as a TI visualizer writes it"));
    let found = ["invalid type: ", "invalid value: "]
        .into_iter()
        .find_map(|prefix| found.strip_prefix(prefix))
        .unwrap_or(found);
    RecordingError::new(Place::Line(error.line().max(1)), expected, found)
}
