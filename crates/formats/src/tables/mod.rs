//! Points in plain tables: CSV with a header, and npy with named columns or with seven unnamed ones.
//!
//! Columns are identified by name, in any order; other columns are ignored. The names are `frame` and `t_s` (one of the
//! two is sufficient), `x, y, z` in m, `velocity` in m/s and `intensity` in dB. Common alternatives such as `x_mm`,
//! `t_ms`, `doppler`, `snr_db` and `amplitude` are accepted; `meaning` in `columns.rs` lists them. A plain npy array
//! has the columns of [`PLAIN_COLUMNS`].

mod columns;

pub use columns::PLAIN_COLUMNS;
pub(crate) use columns::is_point_column;
use columns::{Columns, FrameBuilder};
use radarllm_files::npy::NpyArray;

use crate::recordings::{Axes, Place, RecordedFrame, RecordingError};

/// Reads a CSV table with a header line. Cells are separated by `,`, `;` or tab, whichever the header uses.
///
/// # Errors
/// [`RecordingError`] with the line: missing columns by name, rows of another length, or values that are not numbers.
pub fn read_points_csv(text: &str, axes: Axes) -> Result<Vec<RecordedFrame>, RecordingError> {
    let mut lines = text.lines().enumerate();
    let (_, header) = lines.next().unwrap_or_default();
    let separator = [',', ';', '\t']
        .into_iter()
        .max_by_key(|s| header.matches(*s).count())
        .unwrap_or(',');
    let names: Vec<&str> = header.split(separator).collect();
    let columns = Columns::find(Place::Line(1), names.iter().copied())?;
    let mut builder = FrameBuilder::new(columns, axes);
    for (i, row) in lines {
        let place = Place::Line(i + 1);
        if row.trim().is_empty() {
            continue;
        }
        let cells: Vec<&str> = row.split(separator).collect();
        if cells.len() != names.len() {
            let expected = format!("{} cells", names.len());
            return Err(RecordingError::new(place, expected, row));
        }
        builder.push(place, |column| {
            let cell = cells[column].trim();
            cell.parse::<f64>().map_err(|_| {
                let expected = format!("a number for `{}`", names[column].trim());
                RecordingError::new(place, expected, cell)
            })
        })?;
    }
    Ok(builder.finish())
}

/// Reads an npy table: a structured array with named columns, or a plain array of shape (rows, 7).
///
/// # Errors
/// [`RecordingError`] with the byte or row, as for [`read_points_csv`]; also for pickled arrays.
pub fn read_points_npy(bytes: &[u8], axes: Axes) -> Result<Vec<RecordedFrame>, RecordingError> {
    let array = NpyArray::new(bytes)?;
    let shape = array.header.shape.clone();
    let named = !array.header.fields[0].name.is_empty();
    let names: Vec<&str> = if named {
        array
            .header
            .fields
            .iter()
            .map(|f| f.name.as_str())
            .collect()
    } else {
        PLAIN_COLUMNS.to_vec()
    };
    let n_rows = match (named, shape.as_slice()) {
        (true, [_]) => array.len(),
        (false, [_, 7]) => array.len() / 7,
        _ => {
            return Err(RecordingError::new(
                Place::Byte(0),
                "named columns and one dimension, or shape (rows, 7)",
                &format!("{shape:?}"),
            ));
        }
    };
    let columns = Columns::find(Place::Byte(0), names.iter().copied())?;
    let mut builder = FrameBuilder::new(columns, axes);
    for row in 0..n_rows {
        builder.push(Place::Row(row), |column| {
            Ok(if named {
                array.value(row, column)
            } else {
                array.value(row * 7 + column, 0)
            })
        })?;
    }
    Ok(builder.finish())
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: &str = "frame,t_ms,X [m],y_mm,z,Doppler (m/s),snr_db,note\n\
                        3,100,0.5,2000,-1,0.25,20,a\n\
                        3,100,0,1000,0,0,10,b\n\
                        5,300,0,1000,0,0,10,c\n";

    #[test]
    fn names_and_units_are_understood() {
        let frames = read_points_csv(GOOD, Axes::RightForwardUp).unwrap();
        assert_eq!(frames.len(), 2);
        assert_eq!((frames[0].number, frames[0].stamp_s), (3, Some(0.1)));
        let p = frames[0].points[0];
        assert_eq!(
            [p.x_m, p.y_m, p.z_m, p.velocity_mps, p.intensity_db],
            [0.5, 2.0, -1.0, 0.25, 20.0]
        );
        let turned = read_points_csv(GOOD, Axes::ForwardLeftUp).unwrap();
        assert_eq!(
            (turned[0].points[0].x_m, turned[0].points[0].y_m),
            (-2.0, 0.5)
        );
        let semicolons = GOOD.replace(',', ";");
        assert_eq!(
            read_points_csv(&semicolons, Axes::RightForwardUp).unwrap(),
            frames
        );
    }

    /// TI's example script for the out-of-box demo writes SNR and noise as the firmware sends them.
    #[test]
    fn tables_with_detobj_have_tenths_of_decibels() {
        let text = "frame,DetObj#,x,y,z,v,snr,noise\n0,0,0,3,-0.8,0.1,150,700\n";
        let frames = read_points_csv(text, Axes::RightForwardUp).unwrap();
        assert_eq!(frames[0].points[0].intensity_db, 15.0);
    }

    #[test]
    fn missing_columns_are_named() {
        let error = read_points_csv("frame,x,y\n", Axes::RightForwardUp).unwrap_err();
        assert!(
            error.to_string().contains("columns z, velocity, intensity"),
            "{error}"
        );
        let error = read_points_csv("x,y,z,v,snr\n", Axes::RightForwardUp).unwrap_err();
        assert!(error.to_string().contains("frame or t_s"), "{error}");
        let error = read_points_csv("frame,x,y,z,v,snr,x_mm\n", Axes::RightForwardUp).unwrap_err();
        assert!(error.to_string().contains("one column for X"), "{error}");
    }

    #[test]
    fn damage_is_named_with_its_line() {
        let at = |text: String| read_points_csv(&text, Axes::RightForwardUp).unwrap_err().at;
        assert_eq!(at(GOOD.replace("2000", "far")), Place::Line(2));
        assert_eq!(at(GOOD.replace("2000", "nan")), Place::Line(2));
        assert_eq!(at(GOOD.replace("10,b", "10")), Place::Line(3));
        assert_eq!(at(GOOD.replace("5,300", "2,300")), Place::Line(4));
        assert_eq!(at(GOOD.replace("5,300", "5.5,300")), Place::Line(4));
    }
}
