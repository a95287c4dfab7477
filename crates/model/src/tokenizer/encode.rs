//! The trained tokenizer: points in, codes out.

use std::path::Path;

use burn::module::Module;
use burn::tensor::Device;
use radarllm_base::PointFrame;
use serde::{Deserialize, Serialize};

use super::batch::ClipBatch;
use super::codebook::nearest_codes;
use super::config::TokenizerConfig;
use super::grouping::{Grouped, GroupingError, group};
use super::network::TokenizerNet;
use crate::checkpoint::{Checkpoint, CheckpointError, collect_params};

/// `kind` in a tokenizer's `config.json`.
pub const TOKENIZER_KIND: &str = "radar_tokenizer";
/// Clips encoded at once by [`RadarTokenizer::encode_batch`].
const BATCH: usize = 16;

/// `config.json` of a tokenizer checkpoint.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TokenizerFile {
    /// [`TOKENIZER_KIND`].
    pub kind: String,
    /// Architecture.
    pub model: TokenizerConfig,
    /// How it was trained, for the record. Encoding does not read it; `radar lint` compares with
    /// `radars`, the names of the radars of the training clips.
    #[serde(default)]
    pub training: serde_json::Value,
}

/// Codes of one clip.
#[derive(Clone, Debug, PartialEq)]
pub struct Encoded {
    /// One code per four frames (0.4 s), the last one perhaps of fewer.
    pub codes: Vec<u32>,
    /// Features before quantization, `[n_codes][code_dim]` flattened.
    pub features: Vec<f32>,
    /// Points within reach of an anchor.
    pub n_points_used: usize,
}

/// Why a clip cannot be encoded.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum EncodeError {
    /// The clip's points cannot be used.
    #[error("clip {clip}: {source}")]
    Clip {
        /// Position in the batch.
        clip: usize,
        /// Cause.
        source: GroupingError,
    },
    /// The network gave a value that is not finite: its weights are broken.
    #[error("clip {clip}: the tokenizer's output is not finite")]
    NotFinite {
        /// Position in the batch.
        clip: usize,
    },
}

/// A trained tokenizer ready to encode.
#[derive(Debug, Clone)]
pub struct RadarTokenizer {
    config: TokenizerConfig,
    net: TokenizerNet,
    codebook: Vec<f32>,
}

impl RadarTokenizer {
    /// Loads a checkpoint directory.
    ///
    /// # Errors
    /// If it is missing, damaged, not a tokenizer, or does not fit its own configuration.
    pub fn load(dir: &Path) -> Result<Self, CheckpointError> {
        let checkpoint = Checkpoint::open(dir)?;
        let file: TokenizerFile = checkpoint.config(
            TOKENIZER_KIND,
            |f: &TokenizerFile| &f.kind,
            |f| f.model.validate(),
        )?;
        let net = checkpoint.load_model(TokenizerNet::new(&file.model, &Device::flex()))?;
        Ok(Self::from_net(file.model, net))
    }

    /// Wraps a network that is already in memory.
    pub fn from_net(config: TokenizerConfig, net: TokenizerNet) -> Self {
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
        }
    }

    /// Architecture.
    pub fn config(&self) -> &TokenizerConfig {
        &self.config
    }

    /// Code vectors, `[codebook_size][code_dim]` flattened.
    pub fn codebook(&self) -> &[f32] {
        &self.codebook
    }

    /// Number of weights, codebook included.
    pub fn n_params(&self) -> usize {
        collect_params(&self.net)
            .values()
            .map(|t| t.values.len())
            .sum()
    }

    /// Codes of one clip of 1 to 96 frames at 10 per second.
    ///
    /// # Errors
    /// If there is no frame, too many, or a value is not finite.
    pub fn encode(
        &self,
        frames: &[PointFrame],
        radar_height_m: f32,
    ) -> Result<Encoded, EncodeError> {
        let mut encoded = self.encode_batch(&[(frames, radar_height_m)])?;
        encoded.pop().ok_or(EncodeError::Clip {
            clip: 0,
            source: GroupingError::Empty,
        })
    }

    /// Codes of several clips, each with its radar's height; clips do not influence one another.
    ///
    /// # Errors
    /// As [`Self::encode`], naming the clip.
    pub fn encode_batch(
        &self,
        clips: &[(&[PointFrame], f32)],
    ) -> Result<Vec<Encoded>, EncodeError> {
        let mut grouped = Vec::with_capacity(clips.len());
        for (clip, (frames, height_m)) in clips.iter().enumerate() {
            let result = group(frames, *height_m, &self.config.grouping);
            grouped.push(result.map_err(|source| EncodeError::Clip { clip, source })?);
        }
        self.encode_grouped(&grouped.iter().collect::<Vec<_>>())
    }

    /// Codes of clips that are grouped already.
    ///
    /// # Errors
    /// If the network's output is not finite.
    pub fn encode_grouped(&self, clips: &[&Grouped]) -> Result<Vec<Encoded>, EncodeError> {
        // Similar lengths together waste little on padding.
        let mut order: Vec<usize> = (0..clips.len()).collect();
        order.sort_by_key(|i| clips[*i].n_codes);
        let dim = self.config.code_dim;
        let mut out: Vec<Option<Encoded>> = vec![None; clips.len()];
        for chunk in order.chunks(BATCH) {
            let members: Vec<&Grouped> = chunk.iter().map(|i| clips[*i]).collect();
            let batch = ClipBatch::new(&self.config, &members, &[]);
            let features = self.net.forward(&batch).features.into_data();
            let features: Vec<f32> = features.try_into_vec().unwrap_or_default();
            let stride = batch.codes_per_clip() * dim;
            for ((&clip, own), grouped) in chunk.iter().zip(features.chunks(stride)).zip(&members) {
                let own = own[..grouped.n_codes * dim].to_vec();
                if !own.iter().all(|v| v.is_finite()) {
                    return Err(EncodeError::NotFinite { clip });
                }
                let codes = nearest_codes(&own, &self.codebook, dim);
                let n_points_used = grouped.n_points_used;
                out[clip] = Some(Encoded {
                    codes,
                    features: own,
                    n_points_used,
                });
            }
        }
        Ok(out.into_iter().flatten().collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tokenizer::config::AnchorMode;
    use burn::tensor::{Tensor, TensorData};
    use radarllm_base::RadarPoint;

    fn clip(n_frames: usize, n_points: usize, seed: usize) -> Vec<PointFrame> {
        let frame = |f: usize| {
            let points = (0..n_points).map(move |i| {
                let t = (seed * 1000 + f * n_points + i) as f32;
                let (x, y, z) = (
                    (t * 0.7).sin() * 0.5,
                    3.0 + (t * 0.3).cos() * 0.4,
                    (t * 0.9).sin() * 0.8,
                );
                RadarPoint {
                    x_m: x,
                    y_m: y,
                    z_m: z,
                    range_m: (x * x + y * y + z * z).sqrt(),
                    velocity_mps: (t * 0.11).sin(),
                    intensity_db: 20.0 + 5.0 * (t * 0.5).sin(),
                }
            });
            PointFrame {
                frame: f as u32,
                time_s: f as f64 * 0.1,
                points: points.collect(),
            }
        };
        (0..n_frames).map(frame).collect()
    }

    fn tokenizer(config: TokenizerConfig) -> RadarTokenizer {
        let device = Device::flex();
        device.seed(1);
        let mut net = TokenizerNet::new(&config, &device);
        let n = config.codebook_size * config.code_dim;
        let values: Vec<f32> = (0..n)
            .map(|i| ((i * 7919 % 1009) as f32 / 1009.0 - 0.5) * 0.2)
            .collect();
        let data = TensorData::new(values, [config.codebook_size, config.code_dim]);
        net.codebook = burn::module::Param::from_tensor(Tensor::from_data(data, &device));
        RadarTokenizer::from_net(config, net)
    }

    #[test]
    fn any_number_of_points_and_frames_encodes() {
        let tokenizer = tokenizer(TokenizerConfig::small());
        for (n_frames, n_points) in [(1, 0), (1, 1), (3, 20), (4, 0), (5, 1), (40, 20), (96, 3)] {
            let encoded = tokenizer.encode(&clip(n_frames, n_points, 0), 1.0).unwrap();
            assert_eq!(encoded.codes.len(), n_frames.div_ceil(4));
            assert_eq!(encoded.features.len(), encoded.codes.len() * 128);
            assert!(encoded.features.iter().all(|v| v.is_finite()));
        }
        assert!(tokenizer.encode(&[], 1.0).is_err());
        assert!(tokenizer.encode(&clip(97, 1, 0), 1.0).is_err());
    }

    #[test]
    fn neighbours_in_a_batch_and_padding_change_nothing() {
        for anchors in [AnchorMode::Template, AnchorMode::FarthestPoint] {
            let mut config = TokenizerConfig::small();
            config.grouping.anchors = anchors;
            let tokenizer = tokenizer(config);
            let clips = [clip(10, 30, 1), clip(37, 12, 2), clip(4, 5, 3)];
            let together: Vec<(&[PointFrame], f32)> =
                clips.iter().map(|c| (c.as_slice(), 1.0)).collect();
            let together = tokenizer.encode_batch(&together).unwrap();
            for (clip, joint) in clips.iter().zip(&together) {
                let alone = tokenizer.encode(clip, 1.0).unwrap();
                assert_eq!(alone.n_points_used, joint.n_points_used);
                for (a, b) in alone.features.iter().zip(&joint.features) {
                    // Products of other sizes add in another order.
                    assert!((a - b).abs() < 1e-5, "{a} {b}");
                }
            }
        }
    }

    #[test]
    fn hostile_configurations_are_refused() {
        for bad in [
            r#"{"width": 0}"#,
            r#"{"width": 65, "heads": 4}"#,
            r#"{"codebook_size": 1000000000}"#,
            r#"{"grouping": {"counts": [16, 16, 32]}}"#,
            r#"{"grouping": {"radius_m": -1.0}}"#,
        ] {
            let config: TokenizerConfig = serde_json::from_str(bad).unwrap();
            assert!(config.validate().is_err(), "{bad}");
        }
        assert!(serde_json::from_str::<TokenizerConfig>(r#"{"widht": 64}"#).is_err());
        TokenizerConfig::small().validate().unwrap();
        TokenizerConfig::paper().validate().unwrap();
    }
}
