//! Windows of points in JSON: `{"sequences": [{"frames": [..]}]}`, as tools for labelling windows write them.
//!
//! | key of a frame | content |
//! |---|---|
//! | `Frame Count: ` | number of the frame |
//! | `Time Stamp (ms)` | time, ms |
//! | `x_pos`, `y_pos`, `z_pos` | coordinates of the points, m: right, away, above the radar |
//! | `snr` | SNR of the points, dB |
//!
//! Spaces and colons at the ends of keys are ignored, other keys too. There are no speeds: the reader returns 0. Windows are
//! separated by [`WINDOW_GAP_S`], because nothing is known of the time between them.

use serde::Deserialize;
use serde_json::{Map, Value};

use super::{MAX_COORDINATE_M, MAX_INTENSITY_DB, Place, RecordedFrame, RecordingError, point};

/// Time between the windows of one file, s.
pub const WINDOW_GAP_S: f64 = 10.0;
/// Points of a frame that are read.
const MAX_POINTS: usize = 4096;

#[derive(Deserialize)]
struct File {
    sequences: Vec<Sequence>,
}

#[derive(Deserialize)]
struct Sequence {
    frames: Vec<Map<String, Value>>,
}

/// Reads the windows of a file as one recording.
///
/// # Errors
/// [`RecordingError`] with the line of invalid JSON, or naming window, frame and key (all from 0) of what is missing or no
/// list of numbers.
pub fn read_windows_json(text: &str) -> Result<Vec<RecordedFrame>, RecordingError> {
    let file: File = serde_json::from_str(text).map_err(|e| {
        RecordingError::new(
            Place::Line(e.line()),
            "`sequences` with `frames`",
            &e.to_string(),
        )
    })?;
    let mut frames: Vec<RecordedFrame> = Vec::new();
    for (w, sequence) in file.sequences.iter().enumerate() {
        let start_s = frames
            .last()
            .and_then(|f| f.stamp_s)
            .map_or(0.0, |last_s| last_s + WINDOW_GAP_S);
        let mut first_s = None;
        for (f, frame) in sequence.frames.iter().enumerate() {
            let wrong = |key: &str, expected: &str| {
                RecordingError::new(
                    Place::Row(w),
                    format!("{expected} at window {w}, frame {f}, key `{key}`"),
                    &frame.get(key).map_or("nothing".into(), Value::to_string),
                )
            };
            let find = |key: &str| {
                let named = |name: &&String| name.trim_matches([' ', ':']) == key;
                frame.keys().find(named).and_then(|name| frame.get(name))
            };
            let stamp_s = find("Time Stamp (ms)")
                .and_then(Value::as_f64)
                .filter(|ms| ms.is_finite() && ms.abs() < 1e15)
                .ok_or_else(|| wrong("Time Stamp (ms)", "a time, ms,"))?
                / 1000.0;
            let first_s = *first_s.get_or_insert(stamp_s);
            let since_s = stamp_s - first_s;
            let last_s = frames.last().and_then(|f| f.stamp_s).unwrap_or(0.0);
            if since_s < 0.0 || start_s + since_s < last_s {
                return Err(wrong("Time Stamp (ms)", "a time that does not go back"));
            }
            let numbers = |key: &str, limit: f64| -> Result<Vec<f64>, RecordingError> {
                let expected = format!("a list of numbers within +-{limit}");
                let list = find(key).and_then(Value::as_array);
                let list = list.filter(|list| list.len() <= MAX_POINTS);
                let list = list.ok_or_else(|| wrong(key, &expected))?;
                let values = list.iter().map(|v| v.as_f64().filter(|v| v.abs() <= limit));
                values
                    .collect::<Option<Vec<f64>>>()
                    .ok_or_else(|| wrong(key, &expected))
            };
            let x = numbers("x_pos", MAX_COORDINATE_M)?;
            let y = numbers("y_pos", MAX_COORDINATE_M)?;
            let z = numbers("z_pos", MAX_COORDINATE_M)?;
            let snr = numbers("snr", MAX_INTENSITY_DB)?;
            if [&y, &z, &snr].iter().any(|list| list.len() != x.len()) {
                return Err(wrong("x_pos", "as many coordinates as in the other lists"));
            }
            frames.push(RecordedFrame {
                number: frames.last().map_or(0, |f| f.number + 1),
                stamp_s: Some(start_s + since_s),
                points: (0..x.len())
                    .map(|i| point([x[i], y[i], z[i]], 0.0, snr[i]))
                    .collect(),
                board: None,
            });
        }
    }
    Ok(frames)
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = r#"{"sequences": [
        {"frames": [
            {"Frame Count: ": 7, "Time Stamp (ms)": 1000, "Num Points: ": 1, "x_pos": [0.5], "y_pos": [2], "z_pos": [-1], "snr": [20]},
            {"Frame Count: ": 8, "Time Stamp (ms)": 1250, "x_pos": [], "y_pos": [], "z_pos": [], "snr": []}]},
        {"frames": [{"Frame Count: ": 3, "Time Stamp (ms)": 90, "x_pos": [0], "y_pos": [1], "z_pos": [0], "snr": [9]}]}]}"#;

    #[test]
    fn windows_follow_each_other_with_a_gap() {
        let frames = read_windows_json(TEXT).unwrap();
        let stamps: Vec<f64> = frames.iter().filter_map(|f| f.stamp_s).collect();
        assert_eq!(stamps, [0.0, 0.25, 10.25]);
        let p = frames[0].points[0];
        assert_eq!(
            [p.x_m, p.y_m, p.z_m, p.intensity_db],
            [0.5, 2.0, -1.0, 20.0]
        );
        assert_eq!(frames[1].points, []);
    }

    #[test]
    fn damage_is_named() {
        let error = |text: String| read_windows_json(&text).unwrap_err().to_string();
        assert!(error(TEXT.replace("[2]", "[2, 3]")).contains("window 0, frame 0, key `x_pos`"));
        assert!(error(TEXT.replace("[2]", "[\"far\"]")).contains("key `y_pos`"));
        assert!(error(TEXT.replace("1250", "900")).contains("does not go back"));
        assert!(error(TEXT.replace("[20]", "[1e9]")).contains("+-1000"));
        assert!(error("{}".into()).contains("sequences"));
    }
}
