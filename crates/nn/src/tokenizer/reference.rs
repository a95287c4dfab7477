//! Encoding with the training implementation of the tokenizer's network: the reference that the engine is compared
//! with.

use std::path::Path;

use burn::module::Module;
use burn::tensor::Device;
use radarllm_base::PointFrame;

use super::batch::{ClipBatch, ClipInput};
use super::codebook::nearest_codes;
use super::network::TokenizerNet;
use crate::params::{collect_params, load_model};
use radarllm_inference::checkpoint::{Checkpoint, CheckpointError};
use radarllm_inference::tokenizer::RadarTokenizer;
use radarllm_inference::tokenizer::config::TokenizerConfig;
use radarllm_inference::tokenizer::encode::{EncodeError, Encoded, TokenizerFile, group_all};
use radarllm_inference::tokenizer::grouping::Grouped;
use radarllm_inference::tokenizer::residual::TwoCodebooks;

/// Number of clips encoded at once.
const BATCH: usize = 16;

/// A trained tokenizer in burn.
pub struct ReferenceTokenizer {
    config: TokenizerConfig,
    net: TokenizerNet,
    codebook: Vec<f32>,
    /// If each step has a second code.
    codebooks: Option<TwoCodebooks>,
}

impl ReferenceTokenizer {
    /// Loads a checkpoint directory.
    ///
    /// # Errors
    /// As [`RadarTokenizer::load`].
    pub fn load(dir: &Path) -> Result<Self, CheckpointError> {
        Self::from_checkpoint(&Checkpoint::open(dir)?)
    }

    /// Builds the network of a checkpoint.
    ///
    /// # Errors
    /// As [`Self::load`].
    pub fn from_checkpoint(checkpoint: &Checkpoint) -> Result<Self, CheckpointError> {
        let file = TokenizerFile::read(checkpoint)?;
        let net = load_model(checkpoint, TokenizerNet::new(&file.model, &Device::flex()))?;
        let codebooks = TwoCodebooks::read(checkpoint, &file.model)?;
        Ok(Self {
            codebooks,
            ..Self::new(file.model, &net)
        })
    }

    /// Wraps a network that is already in memory.
    pub fn new(config: TokenizerConfig, net: &TokenizerNet) -> Self {
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
            codebooks: None,
        }
    }

    /// Architecture.
    pub fn config(&self) -> &TokenizerConfig {
        &self.config
    }

    /// Number of weights, including the codebook and the parts that only training needs.
    pub fn n_params(&self) -> usize {
        let weights = collect_params(&self.net);
        weights.values().map(|t| t.values.len()).sum()
    }

    /// Codes of several clips, each with its radar's height.
    ///
    /// # Errors
    /// As [`RadarTokenizer::encode`], naming the clip.
    pub fn encode_batch(
        &self,
        clips: &[(&[PointFrame], f32)],
    ) -> Result<Vec<Encoded>, EncodeError> {
        let grouped = group_all(clips, &self.config)?;
        self.encode_grouped(&grouped.iter().collect::<Vec<_>>())
    }

    /// Codes of clips that are grouped already.
    ///
    /// # Errors
    /// If the network's output is not finite.
    pub fn encode_grouped(&self, clips: &[&Grouped]) -> Result<Vec<Encoded>, EncodeError> {
        // Grouping similar lengths wastes little on padding.
        let mut order: Vec<usize> = (0..clips.len()).collect();
        order.sort_by_key(|i| clips[*i].n_codes);
        let dim = self.config.code_dim;
        let mut out: Vec<Option<Encoded>> = vec![None; clips.len()];
        for chunk in order.chunks(BATCH) {
            let members: Vec<ClipInput> =
                chunk.iter().map(|i| ClipInput::whole(clips[*i])).collect();
            let batch = ClipBatch::new(&self.config, &members);
            let features = self.net.forward(&batch).features.into_data();
            let features: Vec<f32> = features.try_into_vec().unwrap_or_default();
            let stride = batch.codes_per_clip() * dim;
            for ((&clip, own), grouped) in chunk.iter().zip(features.chunks(stride)).zip(&members) {
                let own = own[..grouped.clip.n_codes * dim].to_vec();
                if !own.iter().all(|v| v.is_finite()) {
                    return Err(EncodeError::NotFinite { clip });
                }
                let codes = nearest_codes(&own, &self.codebook, dim);
                let n_points_used = grouped.clip.n_points_used;
                let mut encoded = Encoded {
                    codes,
                    features: own,
                    n_points_used,
                    ..Encoded::default()
                };
                if let Some(codebooks) = &self.codebooks {
                    codebooks.quantise(&mut encoded);
                }
                out[clip] = Some(encoded);
            }
        }
        Ok(out.into_iter().flatten().collect())
    }
}

/// Packs the weights of a network in memory for the inference engine.
///
/// # Errors
/// If the network does not fit `config`.
pub fn pack(
    config: TokenizerConfig,
    net: &TokenizerNet,
) -> Result<RadarTokenizer, CheckpointError> {
    let file = Path::new("tokenizer in memory");
    RadarTokenizer::from_weights(config, collect_params(net), file)
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;
    use crate::params::{collect_params, replace_params};
    use radarllm_base::RadarPoint;
    use radarllm_inference::checkpoint::{HostTensor, NamedTensors};
    use radarllm_inference::tokenizer::config::{AnchorMode, CentreSmoothing};
    use rand::rngs::ChaCha8Rng;
    use rand::{RngExt, SeedableRng};

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
                board: None,
            }
        };
        (0..n_frames).map(frame).collect()
    }

    /// A network with the same weights in every run, independent of other draws from the device's generator, and a
    /// codebook of about its features' magnitude.
    fn network(config: &TokenizerConfig) -> TokenizerNet {
        let net = TokenizerNet::new(config, &Device::flex());
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let mut weights = collect_params(&net);
        for (name, tensor) in &mut weights {
            let (centre, reach) = match &tensor.shape[..] {
                _ if name == "codebook" => (0.0, 0.1),
                // Gains of a norm; every other parameter with one axis is a bias.
                [_] if tensor.values.iter().all(|v| *v == 1.0) => (1.0, 0.2),
                [_] => (0.0, 0.1),
                [inputs, ..] => (0.0, 1.5 * (*inputs as f32).sqrt().recip()),
                [] => (0.0, 0.0),
            };
            for v in &mut tensor.values {
                *v = centre + reach * (2.0 * rng.random::<f32>() - 1.0);
            }
        }
        replace_params(net, weights)
    }

    fn tokenizer(config: TokenizerConfig) -> RadarTokenizer {
        let net = network(&config);
        pack(config, &net).unwrap()
    }

    /// A clip of a person who walks about: 1 to 96 frames of 0 to 60 points, some frames empty, some of one
    /// point, some points far away.
    fn wanderer(rng: &mut ChaCha8Rng) -> Vec<PointFrame> {
        let n_frames = rng.random_range(1..=96);
        let max = [0, 1, 3, 20, 60][rng.random_range(0..5)];
        let mut at = [rng.random_range(-1.5..1.5), rng.random_range(1.5..5.0)];
        let mut frame = |f: u32| {
            for x in &mut at {
                *x += rng.random_range(-0.15..0.15f32);
            }
            let n_points = match rng.random_range(0..10) {
                0 => 0,
                1 => max.min(1),
                _ => rng.random_range(0..=max),
            };
            let mut point = || {
                let reach = if rng.random_range(0..12) == 0 {
                    4.0
                } else {
                    0.5
                };
                let (x, y): (f32, f32) = (
                    at[0] + rng.random_range(-reach..reach),
                    at[1] + rng.random_range(-reach..reach),
                );
                let z: f32 = rng.random_range(-1.0..1.0);
                RadarPoint {
                    x_m: x,
                    y_m: y,
                    z_m: z,
                    range_m: (x * x + y * y + z * z).sqrt(),
                    velocity_mps: rng.random_range(-3.0..3.0),
                    intensity_db: rng.random_range(5.0..40.0),
                }
            };
            PointFrame {
                frame: f,
                time_s: f64::from(f) * 0.1,
                points: (0..n_points).map(|_| point()).collect(),
                board: None,
            }
        };
        (0..n_frames).map(&mut frame).collect()
    }

    /// Features agree within 1e-4 of the largest of their clip. Codes are equal, except for the few whose features are
    /// so close to the middle between two codes that the rounding of features decides ([`is_tie`]). Rounding
    /// depends on the machine's instructions. Returns the worst ratio and the number of codes.
    fn assert_same(
        reference: &ReferenceTokenizer,
        engine: &RadarTokenizer,
        n_clips: usize,
        seed: u64,
    ) -> (f32, usize) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let clips: Vec<_> = (0..n_clips).map(|_| wanderer(&mut rng)).collect();
        let inputs: Vec<(&[PointFrame], f32)> = clips.iter().map(|c| (&c[..], 1.0)).collect();
        let expected = reference.encode_batch(&inputs).unwrap();
        let found = engine.encode_batch(&inputs).unwrap();
        assert_eq!(found.len(), n_clips);
        let (mut worst, mut n_codes, mut n_ties) = (0.0f32, 0, 0);
        let mut occurring: HashSet<u32> = HashSet::new();
        for (i, (e, f)) in expected.iter().zip(&found).enumerate() {
            assert_eq!(e.n_points_used, f.n_points_used);
            assert_eq!(e.features.len(), f.features.len());
            assert_eq!(e.codes.len(), f.codes.len());
            let max = e.features.iter().fold(0.0f32, |a, v| a.max(v.abs()));
            for (e, f) in e.features.iter().zip(&f.features) {
                worst = worst.max((e - f).abs() / max);
            }
            let dim = reference.config.code_dim;
            let features = e.features.chunks(dim).zip(f.features.chunks(dim));
            for (step, ((a, b), x)) in e.codes.iter().zip(&f.codes).zip(features).enumerate() {
                let code = |k: u32| &reference.codebook[k as usize * dim..][..dim];
                if a != b {
                    assert!(
                        is_tie(x, [code(*a), code(*b)]),
                        "clip {i}, step {step}: code {a}, then {b}, {:?}",
                        reference.config()
                    );
                    n_ties += 1;
                }
            }
            n_codes += e.codes.len();
            occurring.extend(&e.codes);
        }
        // Codes that are all the same would agree trivially.
        let n_occurring = occurring.len();
        let min = reference.config.codebook_size.min(10);
        assert!(n_occurring >= min, "only {n_occurring} codes occur");
        assert!(worst < 1e-4, "{worst}, {:?}", reference.config());
        // A rate above one tie in five hundred codes would indicate a defect rather than ties.
        assert!(500 * n_ties <= n_codes.max(500), "{n_ties} of {n_codes}");
        (worst, n_codes)
    }

    /// Whether features x that were rounded to x' can have code a nearest where x' has code b. The difference
    /// of squared distances changes by no more than 2 |x - x'| |a - b|, and each implementation computes it with the
    /// rounding of as many terms as a code has values.
    fn is_tie((x, rounded): (&[f32], &[f32]), [a, b]: [&[f32]; 2]) -> bool {
        let dot = |u: &dyn Fn(usize) -> f64, v: &dyn Fn(usize) -> f64| -> f64 {
            (0..x.len()).map(|i| u(i) * v(i)).sum()
        };
        let apart = |i: usize| f64::from(a[i]) - f64::from(b[i]);
        let middle = |i: usize| f64::from(x[i]) - 0.5 * (f64::from(a[i]) + f64::from(b[i]));
        let moved = |i: usize| f64::from(x[i]) - f64::from(rounded[i]);
        let size = |i: usize| f64::from(x[i].abs() + a[i].abs().max(b[i].abs()));
        let gap = 2.0 * dot(&middle, &apart).abs();
        let by_features = 2.0 * (dot(&moved, &moved) * dot(&apart, &apart)).sqrt();
        let by_sums = 2.0 * f64::from(f32::EPSILON) * x.len() as f64 * dot(&size, &size);
        gap <= by_features + by_sums
    }

    #[test]
    fn only_features_between_two_codes_are_ties() {
        let codes: [&[f32]; 2] = [&[1.0, 0.0], &[-1.0, 0.0]];
        assert!(is_tie((&[1e-4, 3.0], &[-1e-4, 3.0]), codes));
        assert!(!is_tie((&[1e-3, 3.0], &[9e-4, 3.0]), codes));
    }

    #[test]
    fn the_default_model_s_codes_are_those_of_the_network_as_trained() {
        let dir = Path::new(env!("CARGO_MANIFEST_DIR")).join("../model-default/weights/tokenizer");
        let reference = ReferenceTokenizer::load(&dir).unwrap();
        let engine = RadarTokenizer::load(&dir).unwrap();
        assert_eq!(reference.n_params(), engine.n_params());
        let (worst, n_codes) = assert_same(&reference, &engine, 520, 1);
        println!("{n_codes} codes of 520 clips agree; largest difference of features {worst:.1e}");
    }

    /// Every option that a checkpoint can contain, and widths that are not a multiple of a SIMD vector.
    #[test]
    fn every_configuration_encodes_as_the_network_does() {
        let small = TokenizerConfig::small;
        let mut farthest = small();
        farthest.grouping.anchors = AnchorMode::FarthestPoint;
        let mut causal = small();
        causal.grouping.centre_smoothing = CentreSmoothing::Causal;
        causal.grouping.k_per_frame = 3;
        let mut odd = small();
        odd.grouping.counts = [2, 1, 5];
        odd.grouping.max_points = 17;
        let odd = TokenizerConfig {
            width: 36,
            heads: 3,
            layers: 3,
            ffn_ratio: 3,
            pool_queries: 3,
            pool_per_anchor: 5,
            code_dim: 21,
            codebook_size: 77,
            ..odd
        };
        let mut odd_farthest = odd.clone();
        odd_farthest.grouping.anchors = AnchorMode::FarthestPoint;
        let bare = TokenizerConfig {
            pool_per_anchor: 0,
            doppler_profile: false,
            tube_statistics: false,
            pool_queries: 1,
            guidance_dim: 0,
            ..small()
        };
        let bypass = TokenizerConfig {
            quantize: false,
            codebook_size: 1,
            caption_words: 40,
            reconstruct_velocity: false,
            ..small()
        };
        let heads = TokenizerConfig {
            heads: 64,
            codebook_size: 1000,
            ..small()
        };
        for (i, config) in [farthest, causal, odd, odd_farthest, bare, bypass, heads]
            .into_iter()
            .enumerate()
        {
            let net = network(&config);
            let engine = pack(config.clone(), &net).unwrap();
            let reference = ReferenceTokenizer::new(config, &net);
            assert_same(&reference, &engine, 40, 10 + i as u64);
        }
    }

    /// The paper's sizes, on few clips because the training implementation is slow at these sizes.
    #[test]
    fn the_paper_s_sizes_encode_as_the_network_does() {
        let config = TokenizerConfig::paper();
        let net = network(&config);
        let engine = pack(config.clone(), &net).unwrap();
        assert_same(&ReferenceTokenizer::new(config, &net), &engine, 4, 30);
    }

    #[test]
    fn weights_that_do_not_fit_are_named() {
        let config = TokenizerConfig::small();
        let weights = collect_params(&network(&config));
        let load = |change: &dyn Fn(&mut NamedTensors)| {
            let mut weights = weights.clone();
            change(&mut weights);
            RadarTokenizer::from_weights(config.clone(), weights, Path::new("f"))
                .err()
                .map(|e| e.to_string())
        };
        assert_eq!(load(&|_| {}), None);
        let lost = |name: &'static str| load(&move |w| drop(w.remove(name))).unwrap();
        assert_eq!(
            lost("layers.1.time.key.bias"),
            "f: tensor `layers.1.time.key.bias` of shape [64] is missing"
        );
        // The parts that only training needs belong to a checkpoint too.
        assert_eq!(
            lost("head_in.weight"),
            "f: tensor `head_in.weight` of shape [64, 64] is missing"
        );
        let narrow = load(&|w| {
            w.get_mut("merge.bias").unwrap().shape = vec![255];
        });
        assert_eq!(
            narrow.unwrap(),
            "f: tensor `merge.bias`: shape [255], expected [256]"
        );
        let more = load(&|w| {
            w.insert("words.bias".into(), HostTensor::vector(vec![0.0]));
        });
        assert_eq!(
            more.unwrap(),
            "f: tensor `words.bias` is not part of this model"
        );
        let broken = load(&|w| w.get_mut("time").unwrap().values[3] = f32::NAN);
        assert_eq!(broken.unwrap(), "f: tensor `time`: value 3 is not finite");
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
                    // Products of other sizes are summed in another order.
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
