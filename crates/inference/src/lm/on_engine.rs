//! The language model on [`radarllm_engine`]: packed weights, no learning framework.

use std::path::Path;

use radarllm_engine::{Engine, Precision, SearchOptions, Session, Shape, Source};

use super::LmError;
use super::card::LmFiles;
use super::config::{FeedForward, LmConfig};
use super::generate::{GenerateOptions, Generated};
use super::templates::EVALUATION_PROMPT;
use super::vocab::{PAD, Vocab};
use crate::checkpoint::{Checkpoint, CheckpointError};
use crate::tokenizer::Encoded;

impl LmConfig {
    /// The network's shape as the engine sees it; none of a decoder alone, which it does not hold.
    pub fn engine_shape(&self) -> Option<Shape> {
        let c = self.t5()?;
        Some(Shape {
            vocab_size: c.vocab_size,
            d_model: c.d_model,
            d_kv: c.d_kv,
            n_heads: c.n_heads,
            d_ff: c.d_ff,
            n_encoder_layers: c.n_encoder_layers,
            n_decoder_layers: c.n_decoder_layers,
            gated: c.feed_forward == FeedForward::GatedGelu,
            tied: c.tie_embeddings,
            scaled: c.scales_outputs(),
            relative_buckets: c.relative_buckets,
            relative_max_distance: c.relative_max_distance,
            norm_eps: c.norm_eps as f32,
            bypass: self.bypass.then_some(self.code_dim),
        })
    }
}

/// The language model on packed weights.
pub struct EngineLm {
    config: LmConfig,
    vocab: Vocab,
    engine: Engine,
    n_params: usize,
}

impl EngineLm {
    /// Opens a checkpoint: `config.json`, `tokenizer.json` and the weights it names.
    ///
    /// # Errors
    /// If a file is missing or damaged, or weights do not fit the configuration.
    pub fn load(dir: &Path, precision: Precision) -> Result<Self, LmError> {
        Self::from_files(LmFiles::of(Checkpoint::open(dir)?)?, precision)
    }

    pub(super) fn from_files(files: LmFiles, precision: Precision) -> Result<Self, LmError> {
        let Some(shape) = files.card.lm.engine_shape() else {
            return Err(not_t5(&files.card.lm));
        };
        let (weights, path) = files.t5_weights()?;
        let n_params = weights.values().map(|t| t.values.len()).sum();
        let engine = Engine::new(shape, precision, weights)
            .map_err(|e| CheckpointError::from_engine(e, &path))?;
        Ok(Self {
            config: files.card.lm,
            vocab: files.vocab,
            engine,
            n_params,
        })
    }

    /// Shape.
    pub fn config(&self) -> &LmConfig {
        &self.config
    }

    /// Ids.
    pub fn vocab(&self) -> &Vocab {
        &self.vocab
    }

    /// The packed weights.
    pub fn engine(&self) -> &Engine {
        &self.engine
    }

    /// Number of weights.
    pub fn n_params(&self) -> usize {
        self.n_params
    }

    /// The prompt that asks for a description: the one training always holds.
    ///
    /// # Errors
    /// If a code is beyond the codebook or features do not fit codes.
    pub fn describe_prompt(&self, radar: &Encoded) -> Result<Source, LmError> {
        self.vocab.prompt(EVALUATION_PROMPT, Some(radar), None)
    }

    /// Decodes every source on a session of [`Self::engine`].
    ///
    /// # Errors
    /// If a source does not fit the model.
    pub fn generate(
        &self,
        session: &mut Session,
        sources: &[Source],
        options: &GenerateOptions,
    ) -> Result<Vec<Generated>, LmError> {
        decode(session, &self.vocab, sources, options)
    }
}

fn not_t5(config: &LmConfig) -> LmError {
    LmError::Config {
        field: "decoder",
        problem: format!(
            "the inference engine holds T5 only, this is a {}; a build with the feature `train` decodes it with \
             `--decoder f32` or `training`",
            config.network.backbone().name()
        ),
    }
}

fn decode(
    session: &mut Session,
    vocab: &Vocab,
    sources: &[Source],
    options: &GenerateOptions,
) -> Result<Vec<Generated>, LmError> {
    let layout = vocab.layout();
    let n_rows = options.allowed.n_rows(layout) as u32;
    let allowed: Vec<bool> = (0..n_rows)
        .map(|id| options.allowed.permits(id, layout))
        .collect();
    let search = SearchOptions {
        max_new_tokens: options.max_new_tokens.clamp(1, 512),
        beam: options.beam.clamp(1, 64),
        length_penalty: options.length_penalty,
        batch: options.batch,
        start: PAD,
        end: layout.end,
        allowed: &allowed,
    };
    Ok(session.generate(sources, &search)?)
}

#[cfg(feature = "train")]
impl super::RadarLm {
    /// Packs this model's present weights.
    ///
    /// # Errors
    /// If the engine cannot hold the shape.
    pub fn engine(&self, precision: Precision) -> Result<Engine, LmError> {
        let (Some(shape), Some(net)) = (self.config.engine_shape(), self.net.t5()) else {
            return Err(not_t5(&self.config));
        };
        let weights = crate::checkpoint::collect_params(net);
        Ok(Engine::new(shape, precision, weights)?)
    }

    /// Decodes every source as [`Self::generate`] does, on a session of [`Self::engine`].
    ///
    /// # Errors
    /// If a source does not fit the model.
    pub fn generate_on(
        &self,
        session: &mut Session,
        sources: &[Source],
        options: &GenerateOptions,
    ) -> Result<Vec<Generated>, LmError> {
        decode(session, &self.vocab, sources, options)
    }
}

#[cfg(all(test, feature = "train"))]
impl EngineLm {
    /// A model in memory, packed.
    pub(super) fn of(lm: super::RadarLm, precision: Precision) -> Self {
        let weights = crate::checkpoint::collect_params(lm.net.t5().unwrap());
        Self {
            n_params: weights.values().map(|t| t.values.len()).sum(),
            engine: lm.engine(precision).unwrap(),
            config: lm.config,
            vocab: lm.vocab,
        }
    }
}

#[cfg(all(test, feature = "train"))]
mod tests {
    use burn::tensor::Device;
    use rand::rngs::ChaCha8Rng;
    use rand::{RngExt, SeedableRng};

    use super::*;
    use crate::lm::vocab::EOS;
    use crate::lm::{Allowed, LmPreset, NetworkConfig, RadarLm, hf, templates};

    /// The model that comes with the repository.
    fn default_model() -> RadarLm {
        let dir = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/default/lm");
        RadarLm::load(&dir, &Device::flex()).unwrap()
    }

    /// Prompts of 1 to 24 codes with features of the tokenizer's kind, and prompts of random words.
    fn prompts(lm: &RadarLm, n: usize, seed: u64) -> Vec<Source> {
        let rng = &mut ChaCha8Rng::seed_from_u64(seed);
        let (n_codes, dim) = (lm.config.n_codes as u32, lm.config.code_dim);
        (0..n)
            .map(|i| {
                let len = rng.random_range(1..=24);
                let mut code = rng.random_range(0..n_codes);
                let codes: Vec<u32> = (0..len)
                    .map(|_| {
                        // Real codes stay for a while.
                        if rng.random::<f32>() < 0.6 {
                            code = rng.random_range(0..n_codes);
                        }
                        code
                    })
                    .collect();
                let features = (0..len * dim)
                    .map(|_| 2.0 * rng.random::<f32>() - 1.0)
                    .collect();
                if i % 4 == 3 {
                    let n_text = lm.vocab.layout().n_text;
                    let mut ids: Vec<u32> = (0..len).map(|_| rng.random_range(3..n_text)).collect();
                    ids.push(EOS);
                    return Source {
                        ids,
                        ..Source::default()
                    };
                }
                let radar = Encoded {
                    codes,
                    features,
                    n_points_used: 0,
                };
                lm.describe_prompt(&radar).unwrap()
            })
            .collect()
    }

    /// Sentences, scores and confidences; scores are sums of up to 40 terms in f32.
    fn assert_same(expected: &[Generated], found: &[Generated]) {
        assert_eq!(expected.len(), found.len());
        for (i, (e, f)) in expected.iter().zip(found).enumerate() {
            assert_eq!(e.ids, f.ids, "input {i}");
            assert!((e.log_prob - f.log_prob).abs() < 2e-4, "{i}: {e:?} {f:?}");
            assert!(
                (e.confidence - f.confidence).abs() < 1e-5,
                "{i}: {e:?} {f:?}"
            );
        }
    }

    #[test]
    fn the_default_model_says_the_same_greedily_and_with_beams() {
        let lm = default_model();
        let engine = lm.engine(Precision::F32).unwrap();
        let mut session = engine.session(1);
        for (beam, n, allowed) in [
            (1, 400, Allowed::Text),
            (4, 100, Allowed::Text),
            (8, 20, Allowed::Text),
            (1, 60, Allowed::Radar),
            (3, 20, Allowed::Radar),
        ] {
            let sources = prompts(&lm, n, beam as u64);
            let options = GenerateOptions {
                beam,
                allowed,
                ..Default::default()
            };
            let expected = lm.generate(&sources, &options).unwrap();
            assert!(
                expected.iter().any(|e| e.ids.len() > 5),
                "sentences, not silence"
            );
            assert_same(
                &expected,
                &lm.generate_on(&mut session, &sources, &options).unwrap(),
            );
        }
    }

    /// Penalties, limits and batch sizes change what is said; both sides must change alike.
    #[test]
    fn options_mean_the_same() {
        let lm = default_model();
        let engine = lm.engine(Precision::F32).unwrap();
        let mut session = engine.session(2);
        let sources = prompts(&lm, 12, 77);
        for (beam, length_penalty, max_new_tokens, batch) in [
            (1, 1.0, 3, 5),
            (2, 0.0, 40, 64),
            (4, 2.0, 12, 7),
            (5, -1.0, 20, 1),
            (4, 1.0, 1, 64),
            (64, 1.0, 4, 64),
        ] {
            let options = GenerateOptions {
                beam,
                length_penalty,
                max_new_tokens,
                batch,
                allowed: Allowed::Text,
            };
            let expected = lm.generate(&sources, &options).unwrap();
            assert_same(
                &expected,
                &lm.generate_on(&mut session, &sources, &options).unwrap(),
            );
        }
    }

    /// A network of each kind with odd widths, drawn at random, so that nothing fits a vector.
    #[test]
    fn both_kinds_of_t5_with_odd_widths_say_the_same() {
        let texts = ["a person walks to the left", "someone jumps"];
        for preset in [LmPreset::T5Small, LmPreset::FlanT5Small, LmPreset::Small] {
            let vocab = Vocab::learn(texts.into_iter(), templates::all_text(), 600, 4, 16).unwrap();
            let mut config = preset.config(16, 9);
            let NetworkConfig::T5(t5) = &mut config.network else {
                panic!("not a T5");
            };
            t5.d_model = 36;
            t5.d_kv = 10;
            t5.n_heads = 3;
            t5.d_ff = 50;
            t5.n_encoder_layers = 2;
            t5.n_decoder_layers = 3;
            let lm = RadarLm::new(config, vocab, 5, &Device::flex()).unwrap();
            let engine = lm.engine(Precision::F32).unwrap();
            let sources = prompts(&lm, 20, 9);
            for beam in [1, 3] {
                let options = GenerateOptions {
                    beam,
                    ..Default::default()
                };
                let expected = lm.generate(&sources, &options).unwrap();
                let found = lm.generate_on(&mut engine.session(1), &sources, &options);
                assert_same(&expected, &found.unwrap());
            }
        }
    }

    /// Largest difference of logits on the default model, teacher-forced on what it says itself.
    #[test]
    fn logits_of_the_default_model_agree() {
        let lm = default_model();
        let engine = lm.engine(Precision::F32).unwrap();
        let mut session = engine.session(1);
        let net = lm.net.t5().unwrap();
        let vocab = lm.config.network.vocab_size();
        let mut most = 0.0_f32;
        for source in prompts(&lm, 30, 11) {
            let said = lm.generate(std::slice::from_ref(&source), &GenerateOptions::default());
            let mut ids = vec![PAD];
            ids.extend(&said.unwrap()[0].ids);
            let batch =
                crate::lm::SourceBatch::new(&[&source], lm.config.code_dim, &lm.net.device());
            let states = net.forward(&batch, &ids, ids.len(), None);
            let expected = hf::read(net.t5.logits(states, vocab));
            session.start(&[&source], 1, ids.len()).unwrap();
            for (id, expected) in ids.iter().zip(expected.chunks_exact(vocab)) {
                let found = session.logits(&[*id], vocab);
                most = expected
                    .iter()
                    .zip(found)
                    .map(|(e, f)| (e - f).abs())
                    .fold(most, f32::max);
            }
        }
        println!("largest difference of logits: {most:.1e}");
        assert!(most < 1e-4, "{most}");
    }

    /// int8 is an approximation: how good is measured here and bounded from below.
    #[test]
    fn bytes_mostly_say_the_same() {
        let lm = default_model();
        let sources: Vec<Source> = prompts(&lm, 400, 21);
        let options = GenerateOptions::default();
        let expected = lm.generate(&sources, &options).unwrap();
        let engine = lm.engine(Precision::Int8).unwrap();
        let found = lm
            .generate_on(&mut engine.session(1), &sources, &options)
            .unwrap();
        let same = expected
            .iter()
            .zip(&found)
            .filter(|(e, f)| e.ids == f.ids)
            .count();
        let share = same as f64 / sources.len() as f64;
        println!(
            "int8: {same} of {} sentences are those of f32",
            sources.len()
        );
        assert!(share > 0.7 && share < 1.0, "{share}");
    }
}
