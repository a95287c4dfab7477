//! Decoding with the training implementation of the networks, by the engine's search, with cached keys and values.

use radarllm_engine::search::{self, DecodingBackend, SearchOptions};
use radarllm_inference::lm::config::NetworkConfig;
use radarllm_inference::lm::generate::{GenerateOptions, Generated, decode_all};
use radarllm_inference::lm::{InputError, LmError, Source};

use super::hf;
use super::radar_lm::{RadarLm, RadarNet};
use super::t5::{DecoderCache, RadarT5, SourceBatch};
use crate::precision::ProductPrecision;
use crate::pretrained::decoder::{DecoderPast, RadarDecoder};

/// A network and its state between decoding steps.
enum State<'a> {
    T5(&'a RadarT5, Box<DecoderCache>),
    DecoderOnly(&'a RadarDecoder, DecoderPast),
}

impl State<'_> {
    /// Logits `[rows, n]` of the token after `last`.
    fn logits(&mut self, last: &[u32], n: usize) -> Vec<f32> {
        hf::read(match self {
            Self::T5(net, cache) => {
                net.t5
                    .logits(net.t5.step(cache, last), n, ProductPrecision::F32)
            }
            Self::DecoderOnly(net, past) => {
                let states = net.step(past, last);
                net.decoder.logits(states, n, ProductPrecision::F32)
            }
        })
    }

    /// Keeps the given rows of the batch, in this order; rows may repeat.
    fn select(self, rows: &[usize]) -> Self {
        match self {
            Self::T5(net, cache) => Self::T5(net, cache.select(rows).into()),
            Self::DecoderOnly(net, past) => Self::DecoderOnly(net, past.select(rows)),
        }
    }

    /// As `select`, for rows that keep their sources: the cross-attention keys and values are not reordered.
    fn reorder(self, rows: &[usize]) -> Self {
        match self {
            Self::T5(net, cache) => Self::T5(net, cache.reorder(rows).into()),
            decoder_only => decoder_only.select(rows),
        }
    }
}

/// A language model during decoding.
pub struct Decoding<'a> {
    lm: &'a RadarLm,
    /// Present between [`DecodingBackend::start`] and the end of the batch.
    state: Option<State<'a>>,
    n_rows: usize,
    log_probs: Vec<f32>,
}

impl DecodingBackend for Decoding<'_> {
    type Error = LmError;

    fn vocab_size(&self) -> usize {
        self.lm.config.network.vocab_size()
    }

    fn check(&self, _index: usize, source: &Source) -> Result<(), LmError> {
        self.lm.check(source)
    }

    fn start(
        &mut self,
        sources: &[&Source],
        options: &SearchOptions,
        last: &mut Vec<u32>,
    ) -> Result<(), LmError> {
        let width = options.beam;
        let code_dim = self.lm.config.code_dim;
        let device = self.lm.net.device();
        let rows: Vec<usize> = (0..sources.len())
            .flat_map(|i| std::iter::repeat_n(i, width))
            .collect();
        let state = match &self.lm.net {
            RadarNet::T5(net) => {
                let batch = SourceBatch::new(sources, code_dim, &device);
                let encoded = net.encode(&batch, None);
                let cache = net.t5.start_cache(&encoded, options.max_new_tokens);
                last.resize(rows.len(), options.start);
                State::T5(net, cache.into())
            }
            RadarNet::Decoder(net) => {
                let past = net.read(sources, code_dim, &device);
                // The first word follows the last token of the prompt.
                last.extend(rows.iter().filter_map(|i| sources[*i].ids.last().copied()));
                State::DecoderOnly(net, past)
            }
        };
        self.n_rows = rows.len();
        self.state = Some(if width > 1 {
            state.select(&rows)
        } else {
            state
        });
        Ok(())
    }

    fn log_probs(&mut self, last: &[u32], mask: &[f32]) -> &[f32] {
        // Logits after the last allowed id are not needed.
        let n = mask.iter().rposition(|m| *m == 0.0).map_or(1, |i| i + 1);
        self.log_probs.clear();
        self.log_probs
            .resize(last.len() * mask.len(), f32::NEG_INFINITY);
        let Some(state) = &mut self.state else {
            return &self.log_probs;
        };
        let logits = state.logits(last, n);
        let rows = self.log_probs.chunks_exact_mut(mask.len());
        for (row, logits) in rows.zip(logits.chunks_exact(n)) {
            for ((out, logit), mask) in row.iter_mut().zip(logits).zip(mask) {
                *out = logit + mask;
            }
            let max = row.iter().copied().fold(f32::NEG_INFINITY, f32::max);
            let total = row.iter().map(|l| (l - max).exp()).sum::<f32>().ln() + max;
            row.iter_mut().for_each(|l| *l -= total);
        }
        &self.log_probs
    }

    fn keep(&mut self, rows: &[usize]) {
        self.state = self
            .state
            .take()
            .map(|state| match rows.len() == self.n_rows {
                true => state.reorder(rows),
                false => state.select(rows),
            });
        self.n_rows = rows.len();
    }
}

impl RadarLm {
    /// The decoding backend that the engine's search uses.
    pub fn decoding(&self) -> Decoding<'_> {
        Decoding {
            lm: self,
            state: None,
            n_rows: 0,
            log_probs: Vec::new(),
        }
    }

    /// Decodes every prompt.
    ///
    /// # Errors
    /// If a prompt does not fit the model.
    pub fn generate(
        &self,
        prompts: &[Source],
        options: &GenerateOptions,
    ) -> Result<Vec<Generated>, LmError> {
        self.check_positions(prompts, options)?;
        decode_all(&mut self.decoding(), &self.vocab, prompts, options)
    }

    /// Checks that every prompt and the tokens to generate fit the positions of the network.
    ///
    /// # Errors
    /// [`InputError::Positions`].
    pub fn check_positions(
        &self,
        prompts: &[Source],
        options: &GenerateOptions,
    ) -> Result<(), LmError> {
        let positions = match &self.config.network {
            NetworkConfig::T5(_) => return Ok(()),
            NetworkConfig::Gpt2(c) => c.n_positions,
            NetworkConfig::Qwen2(c) => c.max_position_embeddings,
        };
        let steps = options.max_new_tokens.clamp(1, search::MAX_NEW_TOKENS);
        let found = prompts.iter().map(|p| p.ids.len()).max().unwrap_or(0);
        if found + steps <= positions || prompts.is_empty() {
            return Ok(());
        }
        Err(InputError::Positions {
            found,
            steps,
            positions,
        }
        .into())
    }
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;
    use radarllm_inference::lm::vocab::{EOS, PAD};
    use radarllm_inference::lm::{Allowed, Backbone, FeedForward, LmPreset, Vocab, templates};
    use radarllm_inference::tokenizer::Encoded;

    use super::*;
    use crate::lm::TrainingPass;

    /// A random model: its sentences are meaningless, but must be the same by every implementation.
    fn model(preset: LmPreset) -> RadarLm {
        let texts = ["a person walks to the left", "someone jumps"];
        let vocab = Vocab::learn(texts.into_iter(), templates::all_text(), 600, 4, 16).unwrap();
        let mut config = preset.config(16, 8);
        let NetworkConfig::T5(t5) = &mut config.network else {
            panic!("not a T5");
        };
        t5.d_model = 32;
        t5.d_kv = 8;
        t5.n_heads = 4;
        t5.d_ff = 48;
        t5.n_encoder_layers = 2;
        t5.n_decoder_layers = 2;
        RadarLm::new(config, vocab, 3, &Device::flex()).unwrap()
    }

    fn sources(lm: &RadarLm) -> Vec<Source> {
        (1..6)
            .map(|n| {
                let codes: Vec<u32> = (0..n * 3).map(|i| (i * n) % 16).collect();
                let features = (0..codes.len() * 8)
                    .map(|i| (i as f32 * 0.7).sin())
                    .collect();
                let encoded = Encoded {
                    codes,
                    features,
                    ..Encoded::default()
                };
                lm.describe_prompt(&encoded).unwrap()
            })
            .collect()
    }

    /// The most likely token that may occur in a text.
    fn likeliest_text(lm: &RadarLm, logits: &[f32]) -> u32 {
        (0..logits.len() as u32)
            .filter(|id| Allowed::Text.permits(*id, lm.vocab.layout()))
            .max_by(|a, b| logits[*a as usize].total_cmp(&logits[*b as usize]))
            .unwrap()
    }

    /// Greedy decoding without a cache: the whole prefix is recomputed for every token.
    fn slow_greedy(lm: &RadarLm, source: &Source, steps: usize) -> Vec<u32> {
        let batch = SourceBatch::new(&[source], lm.config.code_dim, &lm.net.device());
        let mut prefix = vec![PAD];
        for _ in 0..steps {
            let net = lm.net.t5().unwrap();
            let states = net.forward(&batch, &prefix, prefix.len(), None);
            let last = states.narrow(0, prefix.len() - 1, 1);
            let logits = hf::read(net.t5.logits(
                last,
                lm.config.network.vocab_size(),
                ProductPrecision::F32,
            ));
            let best = likeliest_text(lm, &logits);
            if best == EOS {
                break;
            }
            prefix.push(best);
        }
        prefix.split_off(1)
    }

    #[test]
    fn cached_batched_decoding_equals_the_slow_way() {
        for preset in [LmPreset::Small, LmPreset::FlanT5Small] {
            let lm = model(preset);
            assert_eq!(
                lm.config.t5().unwrap().feed_forward == FeedForward::GatedGelu,
                preset == LmPreset::FlanT5Small
            );
            let sources = sources(&lm);
            let options = GenerateOptions {
                max_new_tokens: 30,
                batch: 3,
                ..Default::default()
            };
            let fast = lm.generate(&sources, &options).unwrap();
            for (source, fast) in sources.iter().zip(&fast) {
                assert_eq!(slow_greedy(&lm, source, 30), fast.ids);
            }
        }
    }

    /// A random decoder-only network.
    fn decoder(backbone: Backbone) -> RadarLm {
        let texts = ["a person walks to the left", "someone jumps"];
        let vocab = Vocab::learn(texts.into_iter(), templates::all_text(), 600, 4, 16).unwrap();
        let mut config = backbone.config(LmPreset::Tiny, 16, 8).unwrap();
        config.bypass = true;
        let mut lm = RadarLm::new(config, vocab, 3, &Device::flex()).unwrap();
        // Freshly drawn rows give nearly equal logits; rows of larger magnitude give sentences that differ.
        let mut params = crate::params::collect_params(&lm.net);
        for (_, tensor) in params
            .iter_mut()
            .filter(|(path, _)| path.contains("weight"))
        {
            let factor = if tensor.shape.len() == 2 { 4.0 } else { 1.0 };
            tensor.values.iter_mut().for_each(|v| *v *= factor);
        }
        lm.net = crate::params::replace_params(lm.net, params);
        lm
    }

    /// Greedy decoding of a decoder-only network without cache, batching or padding.
    fn slow_greedy_alone(lm: &RadarLm, source: &Source, steps: usize) -> Vec<u32> {
        let layout = lm.vocab.layout();
        let RadarNet::Decoder(net) = &lm.net else {
            panic!("a decoder");
        };
        let mut said = Vec::new();
        for _ in 0..steps {
            let target = [said.as_slice(), &[PAD]].concat();
            let states = net.target_states(&[(source, &target)], 8, None).unwrap();
            let last = states.narrow(0, said.len(), 1);
            let logits = hf::read(
                net.decoder
                    .logits(last, layout.size(), ProductPrecision::F32),
            );
            let best = likeliest_text(lm, &logits);
            if best == EOS {
                break;
            }
            said.push(best);
        }
        said
    }

    #[test]
    fn a_decoder_alone_says_the_same_with_cache_and_padding_as_without() {
        for backbone in [Backbone::Gpt2, Backbone::Qwen2] {
            let lm = decoder(backbone);
            let sources = sources(&lm);
            let options = GenerateOptions {
                max_new_tokens: 20,
                ..Default::default()
            };
            let together = lm.generate(&sources, &options).unwrap();
            let mut different = std::collections::BTreeSet::new();
            for (source, together) in sources.iter().zip(&together) {
                assert_eq!(
                    slow_greedy_alone(&lm, source, 20),
                    together.ids,
                    "{backbone:?}"
                );
                different.insert(&together.ids);
            }
            assert!(
                different.len() > 1,
                "{backbone:?}: the prompt never mattered"
            );
            for beam in [1, 4] {
                let options = GenerateOptions {
                    beam,
                    ..options.clone()
                };
                let together = lm.generate(&sources, &options).unwrap();
                for (source, together) in sources.iter().zip(&together) {
                    let alone = lm.generate(std::slice::from_ref(source), &options).unwrap();
                    assert_eq!(alone[0].ids, together.ids, "{backbone:?} beam {beam}");
                    assert!((alone[0].log_prob - together.log_prob).abs() < 1e-3);
                }
            }
        }
    }

    /// Whether beam search changes any sentence. If the score is the plain sum and sentences have the same length,
    /// beam search never gives a lower score than greedy decoding.
    fn beams_find_at_least_what_greedy_finds(lm: &RadarLm) -> bool {
        let sources = sources(lm);
        let options = |beam| GenerateOptions {
            beam,
            max_new_tokens: 6,
            length_penalty: 0.0,
            ..Default::default()
        };
        let greedy = lm.generate(&sources, &options(1)).unwrap();
        let beams = lm.generate(&sources, &options(5)).unwrap();
        for (greedy, beam) in greedy.iter().zip(&beams) {
            if greedy.ids.len() == beam.ids.len() {
                assert!(beam.log_prob >= greedy.log_prob - 1e-4);
            }
            assert!(beam.confidence > 0.0 && beam.confidence <= 1.0);
        }
        greedy.iter().zip(&beams).any(|(g, b)| g.ids != b.ids)
    }

    #[test]
    fn beams_of_a_decoder_alone_are_no_worse_than_greedy() {
        beams_find_at_least_what_greedy_finds(&decoder(Backbone::Gpt2));
    }

    #[test]
    fn beams_are_no_worse_than_greedy() {
        assert!(
            beams_find_at_least_what_greedy_finds(&model(LmPreset::Small)),
            "beams never mattered"
        );
    }

    #[test]
    fn cached_states_equal_teacher_forcing_at_every_step() {
        let lm = model(LmPreset::Small);
        let source = sources(&lm).remove(2);
        let batch = SourceBatch::new(&[&source, &source], 8, &lm.net.device());
        let steps = 24; // beyond the exact position buckets
        let ids: Vec<u32> = (0..steps as u32).map(|i| i * 7 % 50).collect();
        let net = lm.net.t5().unwrap();
        let all = hf::read(net.forward(&batch, &[ids.clone(), ids.clone()].concat(), steps, None));
        let encoded = net.encode(&batch, None);
        let mut cache = net.t5.start_cache(&encoded, steps);
        for (t, id) in ids.iter().enumerate() {
            let step = hf::read(net.t5.step(&mut cache, &[*id, *id]));
            // The same sums in another order; states are of order 1.
            let close = |a: &[f32], b: &[f32]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-4);
            assert!(close(&step[..32], &all[t * 32..(t + 1) * 32]), "step {t}");
            assert!(
                close(&step[32..], &all[(steps + t) * 32..(steps + t + 1) * 32]),
                "step {t}"
            );
        }
    }

    #[test]
    fn only_allowed_tokens_come_out() {
        let lm = model(LmPreset::Small);
        let layout = lm.vocab.layout().clone();
        let sources = sources(&lm);
        for beam in [1, 3] {
            for allowed in [Allowed::Text, Allowed::Radar] {
                let options = GenerateOptions {
                    allowed,
                    beam,
                    max_new_tokens: 8,
                    ..Default::default()
                };
                for result in lm.generate(&sources, &options).unwrap() {
                    assert!(result.ids.iter().all(|id| allowed.permits(*id, &layout)));
                    assert!(result.ids.len() <= 8 && !result.ids.contains(&EOS));
                }
            }
        }
    }

    #[test]
    fn inputs_that_do_not_fit_are_refused() {
        let lm = model(LmPreset::Small);
        let good = sources(&lm).remove(0);
        let refuse = |change: &dyn Fn(&mut Source)| {
            let mut bad = good.clone();
            change(&mut bad);
            assert!(lm.generate(&[bad], &GenerateOptions::default()).is_err());
        };
        refuse(&|s| s.ids.clear());
        refuse(&|s| s.ids[0] = u32::MAX);
        refuse(&|s| s.features.truncate(1));
        refuse(&|s| s.features[0] = f32::NAN);
        refuse(&|s| s.feature_positions[0] = 1 << 20);
        refuse(&|s| s.ids = vec![3; 100_000]);
        assert!(
            lm.generate(&[], &GenerateOptions::default())
                .unwrap()
                .is_empty()
        );
    }

    #[test]
    fn a_saved_model_says_the_same() {
        let lm = model(LmPreset::Small);
        let dir = std::env::temp_dir().join(format!("radarllm-lm-save-{}", std::process::id()));
        lm.save(&dir).unwrap();
        let back = RadarLm::load(&dir, &Device::flex()).unwrap();
        let options = GenerateOptions::default();
        let sources = sources(&lm);
        assert_eq!(
            lm.generate(&sources, &options).unwrap(),
            back.generate(&sources, &options).unwrap()
        );
        std::fs::remove_dir_all(dir).unwrap();
    }

    #[test]
    fn dropout_keeps_the_mean_and_its_seed() {
        let mask = |seed| {
            let lm = model(LmPreset::Small);
            let source = sources(&lm).remove(0);
            let batch = SourceBatch::new(&[&source], 8, &lm.net.device());
            hf::read(
                lm.net
                    .t5()
                    .unwrap()
                    .encode(
                        &batch,
                        Some(&mut TrainingPass::new(seed, ProductPrecision::F32)),
                    )
                    .states,
            )
        };
        assert_eq!(mask(1), mask(1));
        assert_ne!(mask(1), mask(2));
        let zeros = mask(1).iter().filter(|v| **v == 0.0).count() as f64;
        let share = zeros / mask(1).len() as f64;
        // 0.1 of about 250 values: the standard deviation is 0.02, and the tolerance is four of them.
        assert!((share - 0.1).abs() < 0.08, "{share}");
    }
}
