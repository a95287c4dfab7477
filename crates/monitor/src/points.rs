//! Points as bytes: ten a point.
//!
//! A blob is a version byte and, for each frame, the time since the first frame (u32, ms), the number of points (u16)
//! and the points. A point is five little-endian `i16`: x, y and z in millimetres, radial velocity in centimetres per
//! second, intensity in tenths of a decibel. The distance to the radar follows from the position.

use radarllm_base::RadarPoint;

/// First byte of every blob.
const VERSION: u8 = 1;
/// Bytes of a point.
const POINT_BYTES: usize = 10;
/// Bytes before the points of a frame.
const FRAME_BYTES: usize = 6;
/// Longest blob, bytes. A minute of 80 points a frame at 10 Hz takes 0.5 MB.
pub const MAX_BLOB_BYTES: usize = 4 << 20;

/// The points of one frame.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct FramePoints {
    /// Time since the first frame, ms.
    pub offset_ms: u32,
    /// The points.
    pub points: Vec<RadarPoint>,
}

/// Points as bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Packed {
    /// The bytes, at most [`MAX_BLOB_BYTES`].
    pub blob: Vec<u8>,
    /// Number of points that have no such form and were left out: those farther than 32.767 m along an axis, faster than
    /// 327.67 m/s, or not finite.
    pub left_out: usize,
}

/// Why points have no bytes, or bytes are no points.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PointsError {
    /// The points take more than [`MAX_BLOB_BYTES`].
    #[error("points of {bytes} bytes, at most {max} are kept")]
    TooMany {
        /// Bytes of the blob.
        bytes: usize,
        /// Most bytes.
        max: usize,
    },
    /// A frame with more points than 65,535.
    #[error("frame {frame} has {points} points, at most 65535 are kept")]
    FrameTooLarge {
        /// Number of the frame, from 0.
        frame: usize,
        /// Its points.
        points: usize,
    },
    /// The first byte names another version.
    #[error("points of version {found}, expected {VERSION}")]
    Version {
        /// The version, or nothing if the blob is empty.
        found: u8,
    },
    /// The bytes end within a frame.
    #[error("points end within a frame, at byte {offset} of {bytes}")]
    Truncated {
        /// Byte at which the frame begins.
        offset: usize,
        /// Bytes of the blob.
        bytes: usize,
    },
}

/// Packs points.
///
/// # Errors
/// [`PointsError::TooMany`] and [`PointsError::FrameTooLarge`].
pub fn encode(frames: &[FramePoints]) -> Result<Packed, PointsError> {
    let n_points = frames.iter().map(|f| f.points.len()).sum::<usize>();
    let bytes = n_points
        .saturating_mul(POINT_BYTES)
        .saturating_add(frames.len().saturating_mul(FRAME_BYTES))
        .saturating_add(1);
    if bytes > MAX_BLOB_BYTES {
        return Err(PointsError::TooMany {
            bytes,
            max: MAX_BLOB_BYTES,
        });
    }
    let mut blob = Vec::with_capacity(bytes);
    blob.push(VERSION);
    let mut left_out = 0;
    for (frame, FramePoints { offset_ms, points }) in frames.iter().enumerate() {
        let packed: Vec<[i16; 5]> = points.iter().filter_map(pack).collect();
        left_out += points.len() - packed.len();
        let n_points = u16::try_from(packed.len()).map_err(|_| PointsError::FrameTooLarge {
            frame,
            points: packed.len(),
        })?;
        blob.extend(offset_ms.to_le_bytes());
        blob.extend(n_points.to_le_bytes());
        blob.extend(packed.iter().flatten().flat_map(|v| v.to_le_bytes()));
    }
    Ok(Packed { blob, left_out })
}

/// Unpacks points. What it allocates is bounded by the length of the blob.
///
/// # Errors
/// [`PointsError::Version`] and [`PointsError::Truncated`].
pub fn decode(blob: &[u8]) -> Result<Vec<FramePoints>, PointsError> {
    let found = blob.first().copied().unwrap_or(0);
    if found != VERSION {
        return Err(PointsError::Version { found });
    }
    let mut rest = &blob[1..];
    let mut frames = Vec::new();
    while !rest.is_empty() {
        let truncated = || PointsError::Truncated {
            offset: blob.len() - rest.len(),
            bytes: blob.len(),
        };
        let (header, after) = rest
            .split_first_chunk::<FRAME_BYTES>()
            .ok_or_else(truncated)?;
        let [a, b, c, d, e, f] = *header;
        let n_bytes = usize::from(u16::from_le_bytes([e, f])) * POINT_BYTES;
        let (bytes, after) = after.split_at_checked(n_bytes).ok_or_else(truncated)?;
        frames.push(FramePoints {
            offset_ms: u32::from_le_bytes([a, b, c, d]),
            points: bytes.chunks_exact(POINT_BYTES).map(unpack).collect(),
        });
        rest = after;
    }
    Ok(frames)
}

/// The bytes of the points of one frame without a header, ten a point, and the number of points that were left out
/// because they have no such form or come after `most`.
pub fn frame_bytes(points: &[RadarPoint], max: usize) -> (Vec<u8>, usize) {
    let packed: Vec<[i16; 5]> = points.iter().filter_map(pack).take(max).collect();
    let bytes = packed.iter().flatten().flat_map(|v| v.to_le_bytes());
    (bytes.collect(), points.len() - packed.len())
}

/// The five numbers of a point, or `None` if one does not fit.
fn pack(p: &RadarPoint) -> Option<[i16; 5]> {
    let scaled = [
        f64::from(p.x_m) * 1e3,
        f64::from(p.y_m) * 1e3,
        f64::from(p.z_m) * 1e3,
        f64::from(p.velocity_mps) * 1e2,
        f64::from(p.intensity_db) * 1e1,
    ];
    let mut packed = [0; 5];
    for (to, from) in packed.iter_mut().zip(scaled) {
        let rounded = from.round();
        if !(f64::from(i16::MIN)..=f64::from(i16::MAX)).contains(&rounded) {
            return None;
        }
        // In range by the check above.
        *to = rounded as i16;
    }
    Some(packed)
}

fn unpack(bytes: &[u8]) -> RadarPoint {
    let number = |i: usize| f32::from(i16::from_le_bytes([bytes[2 * i], bytes[2 * i + 1]]));
    let [x_m, y_m, z_m] = [0, 1, 2].map(|i| number(i) / 1e3);
    RadarPoint {
        x_m,
        y_m,
        z_m,
        range_m: x_m.hypot(y_m).hypot(z_m),
        velocity_mps: number(3) / 1e2,
        intensity_db: number(4) / 1e1,
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn point(x_m: f32, y_m: f32, z_m: f32, velocity_mps: f32, intensity_db: f32) -> RadarPoint {
        RadarPoint {
            x_m,
            y_m,
            z_m,
            range_m: x_m.hypot(y_m).hypot(z_m),
            velocity_mps,
            intensity_db,
        }
    }

    #[test]
    fn a_point_takes_ten_bytes_and_a_frame_six() {
        let points = vec![point(1.0, 2.0, -0.5, -1.25, 30.0); 7];
        let frames = [
            FramePoints {
                offset_ms: 0,
                points,
            },
            FramePoints {
                offset_ms: 100,
                points: Vec::new(),
            },
        ];
        let packed = encode(&frames).unwrap();
        assert_eq!((packed.blob.len(), packed.left_out), (1 + 2 * 6 + 70, 0));
        assert_eq!(decode(&packed.blob).unwrap(), frames);
    }

    #[test]
    fn points_that_do_not_fit_are_left_out_and_counted() {
        let good = point(-32.768, 32.767, 0.0, 327.67, 0.0);
        let points = vec![
            good,
            point(33.0, 1.0, 0.0, 0.0, 0.0),
            point(0.0, f32::NAN, 0.0, 0.0, 0.0),
            point(0.0, 1.0, 0.0, 400.0, 0.0),
            point(0.0, 1.0, 0.0, 0.0, f32::NEG_INFINITY),
        ];
        let frames = [FramePoints {
            offset_ms: 5,
            points,
        }];
        let packed = encode(&frames).unwrap();
        assert_eq!(packed.left_out, 4);
        let decoded = decode(&packed.blob).unwrap();
        assert_eq!(decoded.len(), 1);
        assert_eq!(decoded[0].points.len(), 1);
        assert!((decoded[0].points[0].x_m - good.x_m).abs() < 1e-3);
    }

    #[test]
    fn too_many_points_are_refused() {
        let frame = FramePoints {
            offset_ms: 0,
            points: vec![point(0.0, 1.0, 0.0, 0.0, 0.0); 65_536],
        };
        let error = encode(std::slice::from_ref(&frame)).unwrap_err();
        let expected = PointsError::FrameTooLarge {
            frame: 0,
            points: 65_536,
        };
        assert_eq!(error, expected);
        let error = encode(&vec![frame; 8]).unwrap_err();
        assert!(matches!(error, PointsError::TooMany { .. }), "{error}");
    }

    #[test]
    fn cut_blobs_are_refused_or_end_between_frames() {
        let frame = FramePoints {
            offset_ms: 9,
            points: vec![point(0.0, 1.0, 0.0, 0.0, 0.0); 2],
        };
        let blob = encode(&[frame.clone(), frame]).unwrap().blob;
        for n in 0..blob.len() {
            let decoded = decode(&blob[..n]);
            // 27 = the version byte and one frame of two points.
            assert_eq!(decoded.is_ok(), n == 1 || n == 27, "{n} bytes");
        }
    }

    proptest! {
        #[test]
        fn points_come_back_within_half_a_step(
            values in prop::collection::vec((-32.0f32..32.0, 0.0f32..32.0, -3.0f32..3.0, -20.0f32..20.0, -200.0f32..200.0), 0..50),
            offset_ms: u32,
        ) {
            let points = values.iter().map(|v| point(v.0, v.1, v.2, v.3, v.4)).collect();
            let frames = [FramePoints { offset_ms, points }];
            let packed = encode(&frames).unwrap();
            prop_assert_eq!(packed.left_out, 0);
            let decoded = decode(&packed.blob).unwrap();
            prop_assert_eq!(decoded[0].offset_ms, offset_ms);
            prop_assert_eq!(decoded[0].points.len(), frames[0].points.len());
            for (a, b) in frames[0].points.iter().zip(&decoded[0].points) {
                // Half a step, and the rounding of f32 at 32 m.
                prop_assert!((a.x_m - b.x_m).abs() < 0.000_51 && (a.y_m - b.y_m).abs() < 0.000_51);
                prop_assert!((a.z_m - b.z_m).abs() < 0.000_51 && (a.range_m - b.range_m).abs() < 0.001_5);
                prop_assert!((a.velocity_mps - b.velocity_mps).abs() < 0.005_1);
                prop_assert!((a.intensity_db - b.intensity_db).abs() < 0.051);
            }
            // What was packed once does not change any more.
            let again = encode(&decoded).unwrap();
            prop_assert_eq!(again.blob, packed.blob);
        }

        #[test]
        fn any_bytes_are_points_or_an_error(bytes in prop::collection::vec(any::<u8>(), 0..300), versioned: bool) {
            let mut bytes = bytes;
            if let (true, Some(first)) = (versioned, bytes.first_mut()) {
                *first = VERSION;
            }
            if let Ok(frames) = decode(&bytes) {
                let n_points: usize = frames.iter().map(|f| f.points.len()).sum();
                prop_assert_eq!(bytes.len(), 1 + frames.len() * FRAME_BYTES + n_points * POINT_BYTES);
            }
        }
    }
}
