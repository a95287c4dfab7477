//! Radar tables and feature maps of the MARS data set (An and Ogras, ACM TECS 2021): an IWR1443 at 10 frames/s.
//!
//! Tables are comma-separated with one point per row: `Frame #, # Obj, X, Y, Z, Doppler, Intensity, Abs Time`.
//! Consecutive rows with equal frame numbers are one frame. X is lateral (to the right when looking along Y, because it
//! follows that of the Kinect), Y points away from the radar, Z up, m, with the radar at the origin; Doppler is in m/s.
//! Intensity is the firmware's linear peak value, interpreted as an amplitude: dB = 20 log10. `Abs Time` is not used
//! because it is rounded to minutes.

use super::{
    Axes, MAX_COORDINATE_M, MAX_VELOCITY_MPS, Place, RecordedFrame, RecordingError, checked_point,
    number, point,
};
use radarllm_base::RadarPoint;
use radarllm_files::npy::NpyArray;

/// Columns that are used, by their names in the header.
const COLUMNS: [&str; 6] = ["Frame #", "X", "Y", "Z", "Doppler", "Intensity"];

/// Reads a table.
///
/// # Errors
/// [`RecordingError`] for a header without a required column, a row of another length, or a value that is not a number.
pub fn read_mars_points(text: &str) -> Result<Vec<RecordedFrame>, RecordingError> {
    let mut lines = text.lines().enumerate();
    let (_, header) = lines.next().unwrap_or_default();
    let header = header.trim_start_matches('\u{feff}');
    let names: Vec<&str> = header.split(',').map(str::trim).collect();
    let mut columns = [0; COLUMNS.len()];
    for (column, name) in columns.iter_mut().zip(COLUMNS) {
        *column = names.iter().position(|n| *n == name).ok_or_else(|| {
            RecordingError::new(Place::Line(1), format!("a column `{name}`"), header)
        })?;
    }
    let mut frames: Vec<RecordedFrame> = Vec::new();
    for (i, row) in lines {
        let line = i + 1;
        if row.trim().is_empty() {
            continue;
        }
        let cells: Vec<&str> = row.split(',').collect();
        if cells.len() != names.len() {
            return Err(RecordingError::new(
                Place::Line(line),
                format!("{} cells", names.len()),
                row,
            ));
        }
        let value =
            |column: usize, limit| number(line, COLUMNS[column], cells[columns[column]], limit);
        let frame = value(0, 1e15)?;
        if frame < 0.0 || frame.fract() != 0.0 {
            return Err(RecordingError::new(
                Place::Line(line),
                "a frame number",
                cells[columns[0]],
            ));
        }
        let position_m = [
            value(1, MAX_COORDINATE_M)?,
            value(2, MAX_COORDINATE_M)?,
            value(3, MAX_COORDINATE_M)?,
        ];
        let intensity_db = peak_db(value(5, 1e12)?);
        let point = point(position_m, value(4, MAX_VELOCITY_MPS)?, intensity_db);
        let number = frame as u64;
        push_point(&mut frames, number, point);
    }
    Ok(frames)
}

/// Adds the point of a row to the last frame if that has the row's number, or begins a frame.
pub(super) fn push_point(frames: &mut Vec<RecordedFrame>, number: u64, point: RadarPoint) {
    match frames.last_mut() {
        Some(last) if last.number == number => last.points.push(point),
        _ => frames.push(RecordedFrame {
            number,
            stamp_s: None,
            points: vec![point],
            board: None,
        }),
    }
}

/// Peak value in dB. A peak of zero is treated as one, the smallest step of the firmware.
pub(super) fn peak_db(peak: f64) -> f64 {
    20.0 * peak.max(1.0).log10()
}

/// Reads the feature maps of the data set: npy of shape (frames, 8, 8, 5) or (frames, 64, 5), whose last axis contains
/// x, y, z, velocity, intensity as in the tables. Rows of five zeros are padding and are omitted. Frames have neither
/// numbers nor time stamps: they are numbered from 0, at 10 frames/s.
///
/// # Errors
/// [`RecordingError`] with the frame as row: another shape, pickled arrays, or a value out of range.
pub fn read_mars_features(bytes: &[u8]) -> Result<Vec<RecordedFrame>, RecordingError> {
    let array = NpyArray::new(bytes)?;
    let fits = array.header.fields[0].name.is_empty()
        && matches!(array.header.shape.as_slice(), [_, 8, 8, 5] | [_, 64, 5]);
    if !fits {
        let found = format!("{:?}", array.header.shape);
        let expected = "shape (frames, 8, 8, 5) or (frames, 64, 5)";
        return Err(RecordingError::new(Place::Byte(0), expected, &found));
    }
    let mut frames = Vec::new();
    for frame in 0..array.len() / 320 {
        let mut points = Vec::new();
        for place in 0..64 {
            let mut values: [f64; 5] =
                std::array::from_fn(|k| array.value((frame * 64 + place) * 5 + k, 0));
            if values == [0.0; 5] {
                continue;
            }
            values[4] = peak_db(values[4]);
            points.push(checked_point(
                Place::Row(frame),
                Axes::RightForwardUp,
                values,
            )?);
        }
        frames.push(RecordedFrame {
            number: frame as u64,
            stamp_s: None,
            points,
            board: None,
        });
    }
    Ok(frames)
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: &str = "Frame #,# Obj,X,Y,Z,Doppler,Intensity,Abs Time\n\
                        7,2,0.5,2,-1,0.356,10,1.6e+09\n\
                        7,2,-0.25,1.5,0,-0.712,1,1.6e+09\n\
                        9,1,0,1,0,0,0,1.6e+09\n";

    #[test]
    fn rows_become_frames_in_si_units_and_decibels() {
        let frames = read_mars_points(GOOD).unwrap();
        let numbers: Vec<u64> = frames.iter().map(|f| f.number).collect();
        assert_eq!(numbers, [7, 9]);
        let p = frames[0].points[0];
        assert_eq!(
            [p.x_m, p.y_m, p.z_m, p.velocity_mps],
            [0.5, 2.0, -1.0, 0.356]
        );
        assert!((p.range_m - 5.25_f32.sqrt()).abs() < 1e-6);
        assert_eq!(p.intensity_db, 20.0);
        assert_eq!(frames[0].points.len(), 2);
        assert_eq!(frames[1].points[0].intensity_db, 0.0);
    }

    #[test]
    fn damage_is_named_with_its_line() {
        let line = |text: &str| match read_mars_points(text).unwrap_err().at {
            Place::Line(line) => line,
            other => panic!("{other}"),
        };
        assert_eq!(line(""), 1);
        assert_eq!(line(&GOOD.replace("Doppler", "Speed")), 1);
        assert_eq!(line(&GOOD.replace("0.712", "fast")), 3);
        assert_eq!(line(&GOOD.replace("-0.25", "nan")), 3);
        assert_eq!(line(&GOOD.replace("9,1,0", "9.5,1,0")), 4);
        assert_eq!(line(&GOOD.replace(",1.6e+09\n9", "\n9")), 3);
        let long = format!("{GOOD}{}", "\u{7}".repeat(1 << 16));
        assert!(read_mars_points(&long).unwrap_err().found.len() < 60);
    }
}
