//! The decoder of radar codes: codes to points.
//!
//! The tokenizer reduces points to codes; a decoder that was trained on codes and points of the same clips gives points
//! back. What the codes do not hold, such as the exact place of each point, it fills with what is usual.

use std::path::Path;

use radarllm_base::{Clip, Clutter, PointFrame, Provenance, RadarPoint};
use radarllm_engine::point_decoder as engine;
use serde::{Deserialize, Serialize};

use super::FRAMES_PER_CODE;
use super::grouping::RANGE_SCALE_M;
use crate::checkpoint::{CONFIG_FILE, Checkpoint, CheckpointError, MODEL_FILE};
use crate::lm::LmError;
use crate::prepare::FRAME_RATE_HZ;

pub use radarllm_engine::point_decoder::POINT_DIM;

/// `kind` in a decoder's `config.json`.
pub const POINTS_KIND: &str = "radar_points";
/// Name of the radar in clips that a decoder made.
pub const GENERATED_RADAR: &str = "generated";

/// Height of the middle of a body above the floor, m: heights are relative to it.
const MIDDLE_M: f32 = 1.0;
/// Scale of the velocities, m/s.
const VELOCITY_SCALE_MPS: f32 = 2.0;
/// Scale of the intensities, dB. They are relative to the clip's median.
const INTENSITY_SCALE_DB: f32 = 10.0;
/// Scale of the logarithm of the number of points.
const COUNT_SCALE: f32 = 3.0;

/// Architecture of the decoder.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PointsConfig {
    /// Most points of a frame.
    pub points: usize,
    /// Width of the embedding of a code.
    pub width: usize,
    /// Number of codes before and after a code from which its points are computed.
    pub context: usize,
    /// Width of the hidden layers.
    pub hidden: usize,
}

impl Default for PointsConfig {
    fn default() -> Self {
        Self {
            points: 32,
            width: 32,
            context: 2,
            hidden: 256,
        }
    }
}

impl PointsConfig {
    /// Shape of the network for a codebook.
    pub fn shape(&self, n_codes: usize) -> engine::PointDecoderShape {
        engine::PointDecoderShape {
            n_codes,
            width: self.width,
            context: self.context,
            hidden: self.hidden,
            points: self.points,
        }
    }
}

/// `config.json` of a decoder.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PointsFile {
    /// [`POINTS_KIND`].
    pub kind: String,
    /// Architecture.
    pub model: PointsConfig,
    /// Number of radar codes.
    pub n_codes: usize,
    /// Hash of the weights of the tokenizer whose codes it decodes.
    pub tokenizer_blake3: String,
    /// Training settings, for the record; not read.
    #[serde(default)]
    pub training: serde_json::Value,
}

/// Hash of a tokenizer's weights, by which a decoder names the tokenizer to which it belongs.
///
/// # Errors
/// If the weights cannot be read.
pub fn tokenizer_hash(tokenizer: &Checkpoint) -> Result<String, CheckpointError> {
    let weights = tokenizer.bytes(MODEL_FILE)?;
    Ok(blake3::hash(&weights).to_hex().to_string())
}

/// A trained decoder.
pub struct PointDecoder {
    network: engine::PointDecoder,
}

impl PointDecoder {
    /// Loads the decoder in `dir` for the codes of `tokenizer`.
    ///
    /// # Errors
    /// If it is missing, damaged, not a decoder, or belongs to another tokenizer.
    pub fn load(dir: &Path, tokenizer: &Checkpoint) -> Result<Self, CheckpointError> {
        Self::of(&Checkpoint::open(dir)?, tokenizer)
    }

    /// As [`Self::load`], of an opened checkpoint.
    ///
    /// # Errors
    /// If it is damaged, not a decoder, or belongs to another tokenizer.
    pub fn of(checkpoint: &Checkpoint, tokenizer: &Checkpoint) -> Result<Self, CheckpointError> {
        let dir = checkpoint.dir();
        let path = dir.join(CONFIG_FILE);
        let file: PointsFile = checkpoint.config(
            POINTS_KIND,
            |f: &PointsFile| &f.kind,
            |f| {
                f.model
                    .shape(f.n_codes)
                    .validate()
                    .map_err(|e| e.to_string())
            },
        )?;
        let expected = tokenizer_hash(tokenizer)?;
        if file.tokenizer_blake3 != expected {
            let message = format!(
                "tokenizer_blake3: it decodes the codes of the tokenizer {:.12}, but {} is {:.12}",
                file.tokenizer_blake3,
                tokenizer.dir().display(),
                expected
            );
            return Err(CheckpointError::Config { path, message });
        }
        let weights = checkpoint.tensors(MODEL_FILE)?;
        let network = engine::PointDecoder::new(file.model.shape(file.n_codes), weights)
            .map_err(|e| CheckpointError::from_engine(e, &dir.join(MODEL_FILE)))?;
        Ok(Self { network })
    }

    /// The points of codes as a clip of a level radar at `radar_height_m`, with 4 frames a code. `origin` says what they
    /// were generated from.
    ///
    /// # Errors
    /// If a code is beyond the codebook, or an output is not finite.
    pub fn decode(
        &self,
        codes: &[u32],
        radar_height_m: f32,
        origin: &str,
    ) -> Result<Clip, LmError> {
        let shape = *self.network.shape();
        let outputs = self.network.decode(codes)?;
        let per_frame = outputs
            .iter()
            .flat_map(|of| of.chunks_exact(shape.frame_outputs()));
        let frame = |(index, values): (usize, &[f32])| PointFrame {
            frame: index as u32,
            time_s: index as f64 / f64::from(FRAME_RATE_HZ),
            points: points_of(values, radar_height_m),
            board: None,
        };
        Ok(Clip {
            frames: per_frame.enumerate().map(frame).collect(),
            frame_rate_hz: f64::from(FRAME_RATE_HZ),
            radar_height_m,
            is_height_assumed: false,
            radar: GENERATED_RADAR.into(),
            provenance: Provenance::Simulated {
                input: origin.into(),
                seed: None,
            },
            clutter: Clutter::Settled,
        })
    }
}

const _: () = assert!(FRAMES_PER_CODE == engine::FRAMES_PER_CODE);

/// The points that the outputs of a frame mean.
fn points_of(values: &[f32], radar_height_m: f32) -> Vec<RadarPoint> {
    let Some((log_count, points)) = values.split_last() else {
        return Vec::new();
    };
    let n_max = points.len() / POINT_DIM;
    let n = (log_count * COUNT_SCALE).exp_m1().round();
    let n = (n.max(0.0) as usize).min(n_max);
    // The points are a set in no order, all of which covers the person: evenly spaced members still do.
    let chosen = (0..n).map(|i| i * n_max / n.max(1));
    chosen
        .map(|i| point_of(&points[i * POINT_DIM..][..POINT_DIM], radar_height_m))
        .collect()
}

/// The point that scaled values mean. Values are limited to what a radar in a room can measure, so that damaged weights
/// give no absurd points.
fn point_of(values: &[f32], radar_height_m: f32) -> RadarPoint {
    let x_m = values[0].clamp(-20.0, 20.0);
    let y_m = (values[1] + RANGE_SCALE_M).clamp(0.0, 40.0);
    let z_m = (values[2] + MIDDLE_M).clamp(-1.0, 5.0) - radar_height_m;
    RadarPoint {
        x_m,
        y_m,
        z_m,
        range_m: (x_m * x_m + y_m * y_m + z_m * z_m).sqrt(),
        velocity_mps: (values[3] * VELOCITY_SCALE_MPS).clamp(-20.0, 20.0),
        intensity_db: (values[4] * INTENSITY_SCALE_DB).clamp(-100.0, 100.0),
    }
}

/// The scaled values of a point, which the decoder is trained to give; `median_db` is that of the clip.
pub fn scaled_point(p: &RadarPoint, radar_height_m: f32, median_db: f32) -> [f32; POINT_DIM] {
    [
        p.x_m,
        p.y_m - RANGE_SCALE_M,
        p.z_m + radar_height_m - MIDDLE_M,
        (p.velocity_mps / VELOCITY_SCALE_MPS).clamp(-4.0, 4.0),
        ((p.intensity_db - median_db) / INTENSITY_SCALE_DB).clamp(-4.0, 4.0),
    ]
}

/// The scaled number of points of a frame, which the decoder is trained to give.
pub fn scaled_count(n_points: usize) -> f32 {
    (n_points as f32).ln_1p() / COUNT_SCALE
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scaled_points_come_back() {
        let point = RadarPoint {
            x_m: -0.7,
            y_m: 2.5,
            z_m: 0.4,
            range_m: (0.49_f32 + 6.25 + 0.16).sqrt(),
            velocity_mps: -1.3,
            intensity_db: 5.0,
        };
        let mut values: Vec<f32> = scaled_point(&point, 1.2, 0.0).to_vec();
        // A second slot that is not used, and one point.
        values.extend([9.0; POINT_DIM]);
        values.push(scaled_count(1));
        let [found] = points_of(&values, 1.2)[..] else {
            panic!("one point")
        };
        for (found, expected) in [
            (found.x_m, point.x_m),
            (found.y_m, point.y_m),
            (found.z_m, point.z_m),
            (found.range_m, point.range_m),
            (found.velocity_mps, point.velocity_mps),
            (found.intensity_db, point.intensity_db),
        ] {
            assert!((found - expected).abs() < 1e-5, "{found}, {expected}");
        }
        for (log_count, n) in [
            (-9.0, 0),
            (scaled_count(0), 0),
            (scaled_count(2), 2),
            (99.0, 2),
        ] {
            *values.last_mut().unwrap() = log_count;
            assert_eq!(points_of(&values, 1.2).len(), n);
        }
    }
}
