//! Radar frames of MM-Fi (Yang et al., NeurIPS 2023 Datasets and Benchmarks): one file per frame in a folder,
//! `frame001.bin` (f64 little-endian) or `frame001.npy`, with rows of x, y, z, Doppler, intensity.
//!
//! The data set documents neither the direction of its axes nor the unit of its intensity. The caller specifies the
//! axes. The intensity is interpreted as dB, as in the output of TI's ROS driver. The frame rate is 10 frames/s.

use radarllm_base::RadarPoint;

use super::{Axes, Place, RecordingError, checked_point};
use radarllm_files::npy::{NPY_MAGIC, NpyArray};

/// Frames per second of the data set.
pub const FRAME_RATE_HZ: f64 = 10.0;

/// Size of a row of a `.bin` file, bytes.
const ROW_BYTES: usize = 5 * 8;

/// Reads one frame; its first bytes determine whether it is `.bin` or `.npy`. An empty file is a frame without points.
///
/// # Errors
/// [`RecordingError`] with the row: a length that is not a whole number of rows, another shape, or values out of range.
pub fn read_mmfi_frame(bytes: &[u8], axes: Axes) -> Result<Vec<RadarPoint>, RecordingError> {
    if bytes.starts_with(NPY_MAGIC) {
        let array = NpyArray::new(bytes)?;
        if !matches!(array.header.shape.as_slice(), [_, 5]) || array.header.fields.len() != 1 {
            let found = format!("{:?}", array.header.shape);
            return Err(RecordingError::new(
                Place::Byte(0),
                "shape (points, 5)",
                &found,
            ));
        }
        return (0..array.len() / 5)
            .map(|row| {
                let values = std::array::from_fn(|k| array.value(row * 5 + k, 0));
                checked_point(Place::Row(row), axes, values)
            })
            .collect();
    }
    if !bytes.len().is_multiple_of(ROW_BYTES) {
        return Err(RecordingError::new(
            Place::Byte((bytes.len() - bytes.len() % ROW_BYTES) as u64),
            "rows of 40 bytes (5 x f64)",
            &format!("{} bytes more", bytes.len() % ROW_BYTES),
        ));
    }
    bytes
        .chunks_exact(ROW_BYTES)
        .enumerate()
        .map(|(row, raw)| {
            let mut values = [0.0; 5];
            for (value, word) in values.iter_mut().zip(raw.chunks_exact(8)) {
                let mut eight = [0; 8];
                eight.copy_from_slice(word);
                *value = f64::from_le_bytes(eight);
            }
            checked_point(Place::Row(row), axes, values)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_become_points_and_damage_is_named() {
        let row = [2.0, -0.5, 1.0, 0.25, 20.0];
        let bytes: Vec<u8> = row.iter().flat_map(|v: &f64| v.to_le_bytes()).collect();
        let p = read_mmfi_frame(&bytes, Axes::ForwardLeftUp).unwrap()[0];
        assert_eq!(
            [p.x_m, p.y_m, p.z_m, p.velocity_mps, p.intensity_db],
            [0.5, 2.0, 1.0, 0.25, 20.0]
        );
        let p = read_mmfi_frame(&bytes, Axes::RightForwardUp).unwrap()[0];
        assert_eq!((p.x_m, p.y_m), (2.0, -0.5));
        assert!(
            read_mmfi_frame(&[], Axes::RightForwardUp)
                .unwrap()
                .is_empty()
        );
        for end in 1..40 {
            let error = read_mmfi_frame(&bytes[..end], Axes::RightForwardUp).unwrap_err();
            assert_eq!(error.at, Place::Byte(0));
        }
        let nan = [bytes, f64::NAN.to_le_bytes().repeat(5)].concat();
        let error = read_mmfi_frame(&nan, Axes::RightForwardUp).unwrap_err();
        assert_eq!(error.at, Place::Row(1));
    }
}
