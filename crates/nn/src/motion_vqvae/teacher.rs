//! The frozen teacher.

use std::path::Path;

use burn::module::Module;
use burn::tensor::{Device, Tensor, TensorData};
use serde::{Deserialize, Serialize};

use super::network::{MotionNet, MotionVqVaeConfig};
use super::{FRAMES_PER_FEATURE, MOTION_DIM};
use crate::params::load_model;
use crate::tokenizer::codebook::nearest_codes;
use radarllm_inference::checkpoint::{Checkpoint, CheckpointError};

/// `kind` in a motion VQ-VAE's `config.json`.
pub const MOTION_KIND: &str = "motion_vqvae";
/// The arrays `mean` and `std` of the training set, 263 values each.
pub const STATISTICS_FILE: &str = "statistics.safetensors";

/// `config.json` of a motion VQ-VAE checkpoint.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MotionFile {
    /// [`MOTION_KIND`].
    pub kind: String,
    /// Architecture.
    pub model: MotionVqVaeConfig,
    /// How the network was trained, as a record; this field is not read.
    #[serde(default)]
    pub training: serde_json::Value,
}

/// Why a motion cannot be encoded.
#[derive(Debug, thiserror::Error, PartialEq)]
#[non_exhaustive]
pub enum MotionError {
    /// The length is not a whole, positive number of frames.
    #[error("motion features: {found} values are not a positive multiple of {MOTION_DIM}")]
    Length {
        /// Number of values.
        found: usize,
    },
    /// More frames than any clip has.
    #[error("motion features: {found} frames, at most {MAX_MOTION_FRAMES}")]
    TooLong {
        /// Number of frames.
        found: usize,
    },
    /// A value is NaN or infinite.
    #[error("motion features: frame {frame}, value {value} is not finite")]
    NotFinite {
        /// Frame.
        frame: usize,
        /// Index of the value within the frame.
        value: usize,
    },
}

/// Maximum length of a motion that is encoded at once, frames (ten minutes).
pub const MAX_MOTION_FRAMES: usize = 12_000;

/// A trained motion VQ-VAE used as a source of features.
#[derive(Debug, Clone)]
pub struct MotionTeacher {
    config: MotionVqVaeConfig,
    net: MotionNet,
    codebook: Vec<f32>,
    mean: Vec<f32>,
    std: Vec<f32>,
}

impl MotionTeacher {
    /// Loads a checkpoint directory.
    ///
    /// # Errors
    /// If it is missing, damaged, not a motion VQ-VAE, or inconsistent with its own configuration.
    pub fn load(dir: &Path) -> Result<Self, CheckpointError> {
        let checkpoint = Checkpoint::open(dir)?;
        let file: MotionFile = checkpoint.config(
            MOTION_KIND,
            |f: &MotionFile| &f.kind,
            |f| f.model.validate(),
        )?;
        let net = load_model(&checkpoint, MotionNet::new(&file.model, &Device::flex()))?;
        let mut statistics = checkpoint.tensors(STATISTICS_FILE)?;
        let mut take = |name: &str| {
            let path = dir.join(STATISTICS_FILE);
            let expected = vec![MOTION_DIM];
            let tensor = name.to_string();
            match statistics.remove(name) {
                Some(t) if t.shape == expected => Ok(t.values),
                Some(t) => Err(CheckpointError::Shape {
                    path,
                    tensor,
                    expected,
                    found: t.shape,
                }),
                None => Err(CheckpointError::MissingTensor {
                    path,
                    tensor,
                    expected,
                }),
            }
        };
        let (mean, std) = (take("mean")?, take("std")?);
        if let Some(i) = std.iter().position(|s| *s <= 0.0) {
            let message = format!("std[{i}] = {} is not positive", std[i]);
            return Err(CheckpointError::Config {
                path: dir.join(STATISTICS_FILE),
                message,
            });
        }
        Ok(Self::from_net(file.model, net, mean, std))
    }

    /// Wraps a network that is already in memory; `mean` and `std` have 263 values.
    pub fn from_net(
        config: MotionVqVaeConfig,
        net: MotionNet,
        mean: Vec<f32>,
        std: Vec<f32>,
    ) -> Self {
        let net = net.valid();
        let codebook = net
            .codebook
            .val()
            .into_data()
            .try_into_vec()
            .unwrap_or_default();
        Self {
            config,
            net,
            codebook,
            mean,
            std,
        }
    }

    /// Width of a feature.
    pub fn width(&self) -> usize {
        self.config.width
    }

    /// Features before quantization: `[ceil(frames / 8)][width]` flattened.
    ///
    /// `motion` is `[frame][263]` flattened at 20 frames per second. The last frame is repeated to
    /// obtain a whole number of features.
    ///
    /// # Errors
    /// If the length is wrong or a value is not finite.
    pub fn features(&self, motion: &[f32]) -> Result<Vec<f32>, MotionError> {
        let n_frames = motion.len() / MOTION_DIM;
        if n_frames == 0 || !motion.len().is_multiple_of(MOTION_DIM) {
            return Err(MotionError::Length {
                found: motion.len(),
            });
        }
        if n_frames > MAX_MOTION_FRAMES {
            return Err(MotionError::TooLong { found: n_frames });
        }
        if let Some(i) = motion.iter().position(|v| !v.is_finite()) {
            return Err(MotionError::NotFinite {
                frame: i / MOTION_DIM,
                value: i % MOTION_DIM,
            });
        }
        let padded = n_frames.div_ceil(FRAMES_PER_FEATURE) * FRAMES_PER_FEATURE;
        let values = standardised(motion, &self.mean, &self.std, padded);
        let x = Tensor::<3>::from_data(
            TensorData::new(values, [1, padded, MOTION_DIM]),
            &Device::flex(),
        );
        Ok(self
            .net
            .encode(x)
            .into_data()
            .try_into_vec()
            .unwrap_or_default())
    }

    /// Codes of features returned by [`Self::features`], one each.
    pub fn codes(&self, features: &[f32]) -> Vec<u32> {
        nearest_codes(features, &self.codebook, self.config.width)
    }

    /// Vectors of codes, `[code][width]` flattened.
    pub fn vectors(&self, codes: &[u32]) -> Vec<f32> {
        let width = self.config.width;
        let vector = |code: &u32| &self.codebook[*code as usize * width..][..width];
        codes.iter().flat_map(vector).copied().collect()
    }

    /// Number of parameters of the encoder and the codebook.
    pub fn n_encoder_params(&self) -> usize {
        let shapes = crate::params::param_shapes(&self.net);
        let encoder = shapes
            .iter()
            .filter(|(path, _)| !path.starts_with("decode") && !path.starts_with("doubles"));
        encoder
            .map(|(_, shape)| shape.iter().product::<usize>())
            .sum()
    }

    /// Number of codes.
    pub fn n_codes(&self) -> usize {
        self.config.codebook_size
    }
}

/// Standardises `[frame][263]` values and repeats the last frame up to `n_frames`.
pub fn standardised(motion: &[f32], mean: &[f32], std: &[f32], n_frames: usize) -> Vec<f32> {
    let last = motion.len().saturating_sub(MOTION_DIM);
    let mut out = Vec::with_capacity(n_frames * MOTION_DIM);
    for frame in 0..n_frames {
        let at = (frame * MOTION_DIM).min(last);
        let values = motion[at..].iter().zip(mean.iter().zip(std));
        // Extreme outliers are capture faults; they must not dominate the loss.
        out.extend(
            values
                .take(MOTION_DIM)
                .map(|(v, (m, s))| ((v - m) / s).clamp(-10.0, 10.0)),
        );
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::params::param_shapes;

    fn teacher() -> MotionTeacher {
        let config = MotionVqVaeConfig {
            width: 16,
            ..MotionVqVaeConfig::small()
        };
        let device = Device::flex();
        device.seed(3);
        let net = MotionNet::new(&config, &device);
        assert!(param_shapes(&net).contains_key("encode_blocks.0.0.conv.linear.weight"));
        MotionTeacher::from_net(config, net, vec![0.0; MOTION_DIM], vec![1.0; MOTION_DIM])
    }

    #[test]
    fn eight_frames_make_one_feature() {
        let teacher = teacher();
        let motion: Vec<f32> = (0..192 * MOTION_DIM)
            .map(|i| (i as f32 * 0.013).sin())
            .collect();
        let features = teacher.features(&motion).unwrap();
        assert_eq!(features.len(), 24 * 16);
        assert_eq!(
            teacher.features(&motion[..9 * MOTION_DIM]).unwrap().len(),
            2 * 16
        );
        assert_eq!(teacher.codes(&features).len(), 24);
        assert_eq!(teacher.features(&[]), Err(MotionError::Length { found: 0 }));
        assert_eq!(
            teacher.features(&motion[..5]),
            Err(MotionError::Length { found: 5 })
        );
        let mut bad = motion[..2 * MOTION_DIM].to_vec();
        bad[MOTION_DIM + 2] = f32::NAN;
        assert_eq!(
            teacher.features(&bad),
            Err(MotionError::NotFinite { frame: 1, value: 2 })
        );
    }

    /// Shifting the motion by one feature's length shifts the features, except near the ends.
    #[test]
    fn features_move_with_the_motion() {
        let teacher = teacher();
        let value = |frame: usize, d: usize| ((frame * 37 + d * 11) as f32 * 0.01).sin();
        let motion = |from: usize| -> Vec<f32> {
            (from..from + 800)
                .flat_map(|f| (0..MOTION_DIM).map(move |d| value(f, d)))
                .collect()
        };
        let a = teacher.features(&motion(0)).unwrap();
        let b = teacher.features(&motion(8)).unwrap();
        // Receptive field per side: blocks of dilation 9 + 3 + 1 at strides 2, 4, 8, below 25
        // features; feature 50 of 100 depends on neither end.
        for c in 0..16 {
            let (x, y) = (a[50 * 16 + c], b[49 * 16 + c]);
            assert!((x - y).abs() < 1e-4, "{x} {y}");
        }
    }
}
