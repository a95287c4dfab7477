//! Decoding with the networks as trained: greedy for batches, beam search for quality, both with cached keys
//! and values.
//!
//! Scores are log-probabilities among the allowed tokens only: a sentence is never blamed for
//! probability that went to radar codes.

use super::config::NetworkConfig;
use super::decoder::DecoderPast;
use super::generate::{Allowed, GenerateOptions, Generated};
use super::radar_lm::RadarNet;
use super::t5::{DecoderCache, RadarT5, SourceBatch};
use super::vocab::PAD;
use super::{LmError, RadarDecoder, RadarLm, Source, hf};

/// A network and what it keeps between decoding steps.
enum Running<'a> {
    T5(&'a RadarT5, Box<DecoderCache>),
    Decoder(&'a RadarDecoder, DecoderPast),
}

impl Running<'_> {
    /// Logits `[rows, n_rows]` of the token after `last`.
    fn logits(&mut self, last: &[u32], n_rows: usize) -> Vec<f32> {
        hf::read(match self {
            Self::T5(net, cache) => net.t5.logits(net.t5.step(cache, last), n_rows),
            Self::Decoder(net, past) => {
                let states = net.step(past, last);
                net.decoder.logits(states, n_rows)
            }
        })
    }

    /// Keeps the given rows of the batch, in this order; rows may repeat.
    fn select(self, rows: &[usize]) -> Self {
        match self {
            Self::T5(net, cache) => Self::T5(net, cache.select(rows).into()),
            Self::Decoder(net, past) => Self::Decoder(net, past.select(rows)),
        }
    }

    /// The same for beams of one source.
    fn reorder(self, rows: &[usize]) -> Self {
        match self {
            Self::T5(net, cache) => Self::T5(net, cache.reorder(rows).into()),
            decoder => decoder.select(rows),
        }
    }
}

impl RadarLm {
    /// Decodes every source.
    ///
    /// # Errors
    /// If a source does not fit the model.
    pub fn generate(
        &self,
        sources: &[Source],
        options: &GenerateOptions,
    ) -> Result<Vec<Generated>, LmError> {
        for source in sources {
            self.check(source)?;
        }
        let steps = options.max_new_tokens.clamp(1, 512);
        if let Some(source) = sources.iter().max_by_key(|s| s.ids.len()) {
            self.check_room(source, steps)?;
        }
        let beam = options.beam.clamp(1, 64);
        let batch = (options.batch / beam).clamp(1, 1024);
        // Neighbours in length share a batch, so that little is padded.
        let mut order: Vec<usize> = (0..sources.len()).collect();
        order.sort_by_key(|i| sources[*i].ids.len());
        let mut out = vec![Generated::default(); sources.len()];
        for chunk in order.chunks(batch) {
            let picked: Vec<&Source> = chunk.iter().map(|i| &sources[*i]).collect();
            let (running, start) = self.start(&picked, steps);
            let results = if beam == 1 {
                self.greedy(running, start, steps, options.allowed)
            } else {
                self.beam(running, start, steps, beam, options)
            };
            for (i, result) in chunk.iter().zip(results) {
                out[*i] = result;
            }
        }
        Ok(out)
    }

    /// Makes sure that a prompt and `steps` tokens fit the network.
    fn check_room(&self, source: &Source, steps: usize) -> Result<(), LmError> {
        let longest = match &self.config.network {
            NetworkConfig::T5(_) => return Ok(()),
            NetworkConfig::Gpt2(c) => c.n_positions,
            NetworkConfig::Qwen2(c) => c.max_position_embeddings,
        };
        let n = source.ids.len();
        if n + steps <= longest {
            return Ok(());
        }
        Err(LmError::Input(format!(
            "a prompt of {n} tokens and {steps} new ones, but the network has {longest} positions"
        )))
    }

    /// Reads the prompts, and says what to decode first.
    fn start(&self, sources: &[&Source], steps: usize) -> (Running<'_>, Vec<u32>) {
        match &self.net {
            RadarNet::T5(net) => {
                let batch = SourceBatch::new(sources, self.config.code_dim, &self.net.device());
                let encoded = net.encode(&batch, None);
                let cache = net.t5.start_cache(&encoded, steps);
                (Running::T5(net, cache.into()), vec![PAD; sources.len()])
            }
            RadarNet::Decoder(net) => {
                let past = net.read(sources, self.config.code_dim, &self.net.device());
                // A prompt's last token is what the first word follows.
                let last = sources.iter().filter_map(|s| s.ids.last().copied());
                (Running::Decoder(net, past), last.collect())
            }
        }
    }

    /// Log-probabilities among allowed tokens, `[rows][n_rows]`, of the next token.
    fn next_log_probs(
        &self,
        running: &mut Running,
        last: &[u32],
        allowed: Allowed,
    ) -> (Vec<f32>, usize) {
        let layout = self.vocab.layout();
        let n_rows = allowed.n_rows(layout);
        let mut logits = running.logits(last, n_rows);
        let permitted: Vec<bool> = (0..n_rows as u32)
            .map(|id| allowed.permits(id, layout))
            .collect();
        for row in logits.chunks_exact_mut(n_rows) {
            for (logit, permitted) in row.iter_mut().zip(&permitted) {
                if !permitted {
                    *logit = f32::NEG_INFINITY;
                }
            }
            let most = row.iter().copied().fold(f32::NEG_INFINITY, f32::max);
            let total = row.iter().map(|l| (l - most).exp()).sum::<f32>().ln() + most;
            row.iter_mut().for_each(|l| *l -= total);
        }
        (logits, n_rows)
    }

    fn greedy(
        &self,
        mut running: Running,
        start: Vec<u32>,
        steps: usize,
        allowed: Allowed,
    ) -> Vec<Generated> {
        let (n, end) = (start.len(), self.vocab.layout().end);
        let mut out = vec![(Vec::new(), 0.0_f32, 0_usize); n];
        let mut alive: Vec<usize> = (0..n).collect();
        let mut last = start;
        for step in 0..steps {
            let (scores, n_rows) = self.next_log_probs(&mut running, &last, allowed);
            let mut kept = Vec::with_capacity(alive.len());
            let mut next = Vec::with_capacity(alive.len());
            for (row, scores) in scores.chunks_exact(n_rows).enumerate() {
                let (id, score) = argmax(scores, end);
                let (ids, sum, scored) = &mut out[alive[row]];
                *sum += score;
                *scored += 1;
                if id != end {
                    ids.push(id);
                    kept.push(row);
                    next.push(id);
                }
            }
            if kept.is_empty() || step + 1 == steps {
                break;
            }
            // Finished sequences leave the batch; the rest pay only for themselves.
            if kept.len() < alive.len() {
                running = running.select(&kept);
                alive = kept.iter().map(|row| alive[*row]).collect();
            }
            last = next;
        }
        out.into_iter()
            .map(|(ids, sum, scored)| Generated::new(ids, sum, scored))
            .collect()
    }

    fn beam(
        &self,
        running: Running,
        start: Vec<u32>,
        steps: usize,
        width: usize,
        options: &GenerateOptions,
    ) -> Vec<Generated> {
        struct Search {
            /// (tokens, log-probability), best first; `width` of them while running.
            open: Vec<(Vec<u32>, f32)>,
            /// (normalised score, result), best first.
            done: Vec<(f32, Generated)>,
            finished: bool,
        }
        let (n, end) = (start.len(), self.vocab.layout().end);
        let normal = |sum: f32, len: usize| sum / (len as f32).powf(options.length_penalty);
        let rows: Vec<usize> = (0..n).flat_map(|i| std::iter::repeat_n(i, width)).collect();
        let mut running = running.select(&rows);
        let mut last: Vec<u32> = rows.iter().map(|row| start[*row]).collect();
        // All beams start equal, so only the first may be extended at the first step.
        let start = || {
            (0..width)
                .map(|b| (Vec::new(), if b == 0 { 0.0 } else { f32::NEG_INFINITY }))
                .collect()
        };
        let mut searches: Vec<Search> = (0..n)
            .map(|_| Search {
                open: start(),
                done: Vec::new(),
                finished: false,
            })
            .collect();
        for step in 0..steps {
            let (scores, n_rows) = self.next_log_probs(&mut running, &last, options.allowed);
            let mut parents = Vec::with_capacity(n * width);
            let mut next = Vec::with_capacity(n * width);
            for (i, search) in searches.iter_mut().enumerate() {
                let first = i * width;
                if search.finished {
                    parents.extend(first..first + width);
                    next.extend(std::iter::repeat_n(end, width));
                    continue;
                }
                let mut candidates = Vec::new();
                for b in 0..width {
                    let sum = search.open[b].1;
                    if sum == f32::NEG_INFINITY {
                        continue;
                    }
                    let row = &scores[(first + b) * n_rows..(first + b + 1) * n_rows];
                    // Twice the width: even if every beam ends, enough of them go on.
                    candidates.extend(
                        top(row, 2 * width)
                            .into_iter()
                            .map(|(id, s)| (sum + s, b, id)),
                    );
                }
                candidates
                    .sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)).then(a.2.cmp(&b.2)));
                let mut open = Vec::with_capacity(width);
                for (rank, (sum, b, id)) in candidates.into_iter().enumerate() {
                    let tokens = &search.open[b].0;
                    if id == end {
                        // An end outside the best `width` would not have been a beam.
                        if rank < width {
                            let score = normal(sum, tokens.len() + 1);
                            let result = Generated::new(tokens.clone(), sum, tokens.len() + 1);
                            search.done.push((score, result));
                        }
                        continue;
                    }
                    if open.len() < width && sum > f32::NEG_INFINITY {
                        let mut tokens = tokens.clone();
                        tokens.push(id);
                        parents.push(first + b);
                        next.push(id);
                        open.push((tokens, sum));
                    }
                }
                while open.len() < width {
                    parents.push(first);
                    next.push(end);
                    open.push((Vec::new(), f32::NEG_INFINITY));
                }
                search.open = open;
                search.done.sort_by(|a, b| b.0.total_cmp(&a.0));
                search.done.truncate(width);
                // The best open beam, were it to end now at its present score, bounds what it can
                // reach under a penalty of at most 1 closely enough; the reference stops here too.
                let best_open = normal(search.open[0].1, step + 1);
                let worst_done = search.done.last().map_or(f32::NEG_INFINITY, |d| d.0);
                search.finished = search.done.len() >= width && worst_done >= best_open;
            }
            if searches.iter().all(|s| s.finished) || step + 1 == steps {
                break;
            }
            running = running.reorder(&parents);
            last = next;
        }
        searches
            .into_iter()
            .map(|search| {
                let open = search
                    .open
                    .into_iter()
                    .filter(|(_, sum)| *sum > f32::NEG_INFINITY);
                let cut = open.map(|(ids, sum)| {
                    let len = ids.len();
                    (normal(sum, len), Generated::new(ids, sum, len))
                });
                // Unfinished beams count only when nothing ended within the limit.
                let mut all = search.done;
                if all.is_empty() {
                    all.extend(cut);
                }
                let best = all.into_iter().max_by(|a, b| a.0.total_cmp(&b.0));
                best.map(|(_, result)| result).unwrap_or_default()
            })
            .collect()
    }
}

/// Id and value of the largest entry; the first of equals, `end` if there is none.
fn argmax(scores: &[f32], end: u32) -> (u32, f32) {
    let mut best = (end, f32::NEG_INFINITY);
    for (id, score) in scores.iter().enumerate() {
        if *score > best.1 {
            best = (id as u32, *score);
        }
    }
    best
}

/// The `k` largest entries, largest first.
fn top(scores: &[f32], k: usize) -> Vec<(u32, f32)> {
    let mut ids: Vec<u32> = (0..scores.len() as u32).collect();
    let by_score = |a: &u32, b: &u32| {
        scores[*b as usize]
            .total_cmp(&scores[*a as usize])
            .then(a.cmp(b))
    };
    if ids.len() > k {
        ids.select_nth_unstable_by(k, by_score);
        ids.truncate(k);
    }
    ids.sort_by(by_score);
    ids.into_iter()
        .map(|id| (id, scores[id as usize]))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lm::Source;
    use crate::lm::dropout::DropoutRng;
    use crate::lm::vocab::EOS;
    use crate::lm::{Backbone, FeedForward, LmPreset, Vocab, templates};
    use crate::tokenizer::Encoded;
    use burn::tensor::Device;

    /// A random model: its sentences are nonsense, but the same nonsense whatever the route.
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
                    n_points_used: 0,
                };
                lm.describe_prompt(&encoded).unwrap()
            })
            .collect()
    }

    /// The likeliest token that may stand in a text.
    fn likeliest_text(lm: &RadarLm, logits: &[f32]) -> u32 {
        (0..logits.len() as u32)
            .filter(|id| Allowed::Text.permits(*id, lm.vocab.layout()))
            .max_by(|a, b| logits[*a as usize].total_cmp(&logits[*b as usize]))
            .unwrap()
    }

    /// Greedy decoding without any cache: the whole prefix again for every token.
    fn slow_greedy(lm: &RadarLm, source: &Source, steps: usize) -> Vec<u32> {
        let batch = SourceBatch::new(&[source], lm.config.code_dim, &lm.net.device());
        let mut prefix = vec![PAD];
        for _ in 0..steps {
            let net = lm.net.t5().unwrap();
            let states = net.forward(&batch, &prefix, prefix.len(), None);
            let last = states.narrow(0, prefix.len() - 1, 1);
            let logits = hf::read(net.t5.logits(last, lm.config.network.vocab_size()));
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

    /// A random decoder alone.
    fn decoder(backbone: Backbone) -> RadarLm {
        let texts = ["a person walks to the left", "someone jumps"];
        let vocab = Vocab::learn(texts.into_iter(), templates::all_text(), 600, 4, 16).unwrap();
        let mut config = backbone.config(LmPreset::Tiny, 16, 8).unwrap();
        config.bypass = true;
        let mut lm = RadarLm::new(config, vocab, 3, &Device::flex()).unwrap();
        // Fresh rows give nearly equal logits; louder ones make sentences that differ.
        let mut params = crate::checkpoint::collect_params(&lm.net);
        for (_, tensor) in params
            .iter_mut()
            .filter(|(path, _)| path.contains("weight"))
        {
            let factor = if tensor.shape.len() == 2 { 4.0 } else { 1.0 };
            tensor.values.iter_mut().for_each(|v| *v *= factor);
        }
        lm.net = crate::checkpoint::replace_params(lm.net, params);
        lm
    }

    /// Greedy decoding of a decoder alone without cache, batch or padding.
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
            let logits = hf::read(net.decoder.logits(last, layout.size()));
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

    /// Whether beams change any sentence. When the score is the plain sum and sentences have the same length,
    /// they never end on a worse one than greedy decoding.
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
            // Same sums in another order; states are of order 1.
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
                    .encode(&batch, Some(&mut DropoutRng::new(seed)))
                    .states,
            )
        };
        assert_eq!(mask(1), mask(1));
        assert_ne!(mask(1), mask(2));
        let zeros = mask(1).iter().filter(|v| **v == 0.0).count() as f64;
        let share = zeros / mask(1).len() as f64;
        // 0.1 of about 250 values: standard deviation 0.02; four of them.
        assert!((share - 0.1).abs() < 0.08, "{share}");
    }
}
