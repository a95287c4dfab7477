//! Radar frames of mmBody (Chen et al., ACM Multimedia 2022): one `radar/frame_N.npy` per frame, of shape (points, 6)
//! with x right, y away, z up (m), velocity (m/s), amplitude, energy. The radar is an Arbe with thousands of points per
//! frame.
//!
//! The page of the data set states no unit of amplitude and energy. The amplitude is stored unchanged in
//! `intensity_db`; only its order is used. The frame rate is not stated either and must be specified by the user.

use radarllm_base::RadarPoint;

use super::{Axes, Place, RecordingError, checked_point};
use radarllm_files::{
    literal::{Literal, parse_literal},
    npy::NpyArray,
};

/// Number of points kept per frame, the strongest ones: the capacity of the radar tokenizer.
pub const MAX_POINTS: usize = 128;

/// The recording conditions that the data set distinguishes, as words in its folder names.
pub const SUBSETS: [&str; 4] = ["rain", "smoke", "lighting", "occlusion"];

/// The subset of a folder path: that of the deepest folder with a word in [`SUBSETS`]. For example, `poor_lighting` has
/// one and `train` has none.
pub fn subset(path: &str) -> Option<&'static str> {
    let path = path.to_lowercase();
    let mut words = path.split(|c: char| !c.is_alphanumeric()).rev();
    words.find_map(|word| SUBSETS.into_iter().find(|name| *name == word))
}

/// Reads one frame: the [`MAX_POINTS`] points of largest amplitude, in decreasing order.
///
/// # Errors
/// [`RecordingError`] with the row: another shape, pickled arrays, or a value out of range.
pub fn read_mmbody_frame(bytes: &[u8]) -> Result<Vec<RadarPoint>, RecordingError> {
    let array = NpyArray::new(bytes)?;
    if !matches!(array.header.shape.as_slice(), [_, 6]) || array.header.fields.len() != 1 {
        let found = format!("{:?}", array.header.shape);
        return Err(RecordingError::new(
            Place::Byte(0),
            "shape (points, 6)",
            &found,
        ));
    }
    let mut points = Vec::with_capacity(array.len() / 6);
    for row in 0..array.len() / 6 {
        let values = std::array::from_fn(|k| array.value(row * 6 + k, 0));
        points.push(checked_point(
            Place::Row(row),
            Axes::RightForwardUp,
            values,
        )?);
    }
    points.sort_by(|a, b| b.intensity_db.total_cmp(&a.intensity_db));
    points.truncate(MAX_POINTS);
    Ok(points)
}

/// A 4 x 4 matrix of `calib.txt`, from the axes of a sensor to those of the radar.
#[derive(Clone, Debug, PartialEq)]
pub struct Calibration {
    /// Path of keys to the matrix, joined with `.`.
    pub name: String,
    /// Rows.
    pub rows: [[f64; 4]; 4],
}

/// Reads every 4 x 4 matrix in `calib.txt`, a Python dictionary. The text is parsed as a literal, never evaluated.
///
/// # Errors
/// [`RecordingError`] for text that is not a literal or contains no matrix.
pub fn read_mmbody_calibration(text: &str) -> Result<Vec<Calibration>, RecordingError> {
    let literal = parse_literal(text.trim()).map_err(|e| {
        let end = text.trim().get(e.byte..).unwrap_or("");
        RecordingError::new(Place::Byte(e.byte as u64), e.expected, end)
    })?;
    let mut found = Vec::new();
    collect("", &literal, &mut found);
    if found.is_empty() {
        return Err(RecordingError::new(
            Place::Byte(0),
            "a dictionary with 4 x 4 matrices",
            "none",
        ));
    }
    Ok(found)
}

/// Collects matrices recursively. The parser limits the nesting depth of a literal.
fn collect(name: &str, literal: &Literal, found: &mut Vec<Calibration>) {
    match literal {
        Literal::Dict(entries) => {
            for (key, value) in entries {
                let key = key.text().unwrap_or("?");
                let path = if name.is_empty() {
                    key.to_owned()
                } else {
                    format!("{name}.{key}")
                };
                collect(&path, value, found);
            }
        }
        _ => {
            if let Some(rows) = matrix(literal) {
                found.push(Calibration {
                    name: name.to_owned(),
                    rows,
                });
            }
        }
    }
}

fn matrix(literal: &Literal) -> Option<[[f64; 4]; 4]> {
    let rows: &[Literal; 4] = literal.items()?.try_into().ok()?;
    let mut out = [[0.0; 4]; 4];
    for (out, row) in out.iter_mut().zip(rows) {
        let row: &[Literal; 4] = row.items()?.try_into().ok()?;
        for (out, value) in out.iter_mut().zip(row) {
            *out = value.number()?;
        }
    }
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn subsets_are_told_by_folders() {
        assert_eq!(
            subset("mmBody/test/poor_lighting/sequence_1/radar"),
            Some("lighting")
        );
        assert_eq!(subset("mmBody/test/rain/sequence_0"), Some("rain"));
        assert_eq!(subset("mmBody/train/sequence_0"), None);
    }

    #[test]
    fn calibrations_are_parsed_and_never_evaluated() {
        let text = "{'kinect': {'master': [[1, 0, 0, 0.5], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}, 'n': 3}\n";
        let found = read_mmbody_calibration(text).unwrap();
        assert_eq!(
            (found[0].name.as_str(), found[0].rows[0][3]),
            ("kinect.master", 0.5)
        );
        assert!(read_mmbody_calibration("{'a': 1}").is_err());
        let code = read_mmbody_calibration("{'a': open('x').read()}").unwrap_err();
        assert_eq!(code.at, Place::Byte(6));
    }
}
