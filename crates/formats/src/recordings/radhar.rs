//! Text recordings of the RadHAR data set (Singh et al., mmNets 2019): an IWR1443 at about 30 frames/s, as printed by
//! the ROS driver.
//!
//! A record contains one point in `key: value` lines and ends with `---`. `point_id: 0` starts a frame. The driver's
//! axes are x forward, y to the *left* (it negates the sensor's lateral axis) and z up, whereas the page of the data
//! set states that y points right. This reader follows the driver: x = -y and y = x. The recordings themselves do not
//! decide between the two.

use radarllm_base::RadarPoint;

use super::{
    MAX_COORDINATE_M, MAX_VELOCITY_MPS, Place, RecordedFrame, RecordingError, number, point,
};

/// Keys that are used, in the order of [`Record::values`].
const KEYS: [&str; 5] = ["x", "y", "z", "velocity", "intensity"];

#[derive(Default)]
struct Record {
    values: [Option<f64>; KEYS.len()],
    point_id: Option<u64>,
    secs: Option<f64>,
    nsecs: Option<f64>,
    any: bool,
}

/// Reads a recording.
///
/// # Errors
/// [`RecordingError`] for a record without a required key, or a value that is not a number. An incomplete last record
/// is also an error, because the file was truncated.
pub fn read_radhar_points(text: &str) -> Result<Vec<RecordedFrame>, RecordingError> {
    let mut frames: Vec<RecordedFrame> = Vec::new();
    let mut record = Record::default();
    let mut last_line = 0;
    for (i, row) in text.lines().enumerate() {
        let line = i + 1;
        last_line = line;
        let row = row.trim();
        if row == "---" {
            finish(line, std::mem::take(&mut record), &mut frames)?;
            continue;
        }
        if row.is_empty() {
            continue;
        }
        let Some((key, value)) = row.split_once(':') else {
            return Err(RecordingError::new(
                Place::Line(line),
                "`key: value` or `---`",
                row,
            ));
        };
        record.any = true;
        let whole = |limit| number(line, key, value, limit);
        match key {
            "point_id" => {
                let id = whole(1e9)?;
                if id < 0.0 || id.fract() != 0.0 {
                    return Err(RecordingError::new(
                        Place::Line(line),
                        "point_id, from 0",
                        value,
                    ));
                }
                record.point_id = Some(id as u64);
            }
            "secs" => record.secs = Some(whole(1e12)?),
            "nsecs" => record.nsecs = Some(whole(1e9)?),
            _ => {
                if let Some(k) = KEYS.iter().position(|name| *name == key) {
                    let limit = match k {
                        0..=2 => MAX_COORDINATE_M,
                        3 => MAX_VELOCITY_MPS,
                        _ => 1e3,
                    };
                    record.values[k] = Some(number(line, key, value, limit)?);
                }
            }
        }
    }
    if record.any {
        finish(last_line, record, &mut frames)?;
    }
    if frames.is_empty() {
        return Err(RecordingError::new(
            Place::Line(last_line.max(1)),
            "records of `point_id`, x, y, z, velocity, intensity",
            "none",
        ));
    }
    Ok(frames)
}

fn finish(
    line: usize,
    record: Record,
    frames: &mut Vec<RecordedFrame>,
) -> Result<(), RecordingError> {
    if !record.any {
        return Ok(());
    }
    let missing = |key: &str| {
        RecordingError::new(
            Place::Line(line),
            format!("`{key}` in the record that ends here"),
            "none",
        )
    };
    let point_id = record.point_id.ok_or_else(|| missing("point_id"))?;
    let mut values = [0.0; KEYS.len()];
    for ((out, value), key) in values.iter_mut().zip(record.values).zip(KEYS) {
        *out = value.ok_or_else(|| missing(key))?;
    }
    let [forward, left, up, velocity_mps, intensity_db] = values;
    let point = point([-left, forward, up], velocity_mps, intensity_db);
    let stamp_s = record
        .secs
        .map(|s| s + record.nsecs.unwrap_or_default() * 1e-9);
    add_point(frames, point_id, stamp_s, Some(point));
    Ok(())
}

/// Adds a message of the driver, which sends one for each point: point 0 starts a frame. A point that cannot be used is
/// `None`.
pub(super) fn add_point(
    frames: &mut Vec<RecordedFrame>,
    point_id: u64,
    stamp_s: Option<f64>,
    point: Option<RadarPoint>,
) {
    match frames.last_mut() {
        Some(frame) if point_id != 0 => frame.points.extend(point),
        _ => frames.push(RecordedFrame {
            number: frames.len() as u64,
            stamp_s,
            points: point.into_iter().collect(),
            board: None,
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(id: u32, x: &str) -> String {
        format!(
            "header: \n  seq: 9\n  stamp: \n    secs: 100\n    nsecs: 250000000\n  frame_id: \"r\"\n\
             point_id: {id}\nx: {x}\ny: -0.5\nz: 0.25\nrange: 1.2\nvelocity: 0.6\ndoppler_bin: 8\n\
             bearing: -20.0\nintensity: 30.5\n---\n"
        )
    }

    #[test]
    fn point_zero_starts_a_frame_and_axes_are_ours() {
        let text = [record(0, "1.0"), record(1, "2.0"), record(0, "3.0")].concat();
        let frames = read_radhar_points(&text).unwrap();
        let sizes: Vec<usize> = frames.iter().map(|f| f.points.len()).collect();
        assert_eq!(sizes, [2, 1]);
        assert_eq!(frames[0].stamp_s, Some(100.25));
        let p = frames[0].points[1];
        assert_eq!(
            [p.x_m, p.y_m, p.z_m, p.velocity_mps, p.intensity_db],
            [0.5, 2.0, 0.25, 0.6, 30.5]
        );
    }

    #[test]
    fn damage_is_named_with_its_line() {
        let good = record(0, "1.0");
        let line = |text: String| match read_radhar_points(&text).unwrap_err().at {
            Place::Line(line) => line,
            other => panic!("{other}"),
        };
        assert_eq!(line(good.replace("x: 1.0", "x: one")), 8);
        assert_eq!(line(good.replace("x: 1.0\n", "")), 15);
        assert_eq!(line(good.replace("point_id: 0", "point_id: -1")), 7);
        assert_eq!(line(good.replace("velocity: 0.6", "inf")), 12);
        assert_eq!(line(String::new()), 1);
        assert_eq!(line(good.split_at(good.len() / 2).0.into()), 8);
    }
}
