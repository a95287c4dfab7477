//! The training implementation of the networks as a backend for the captioner of `radarllm-inference`.

use std::sync::atomic::AtomicBool;

use radarllm_base::PointFrame;
use radarllm_inference::backend::{Backend, EngineBackend, check_pair};
use radarllm_inference::checkpoint::Checkpoint;
use radarllm_inference::lm::ensemble::Member;
use radarllm_inference::lm::generate::{decode, draw, score};
use radarllm_inference::lm::{
    GenerateOptions, Generated, Learned, LmError, LmFiles, Precision, Source, Vocab, Watch,
};
use radarllm_inference::tokenizer::{EncodeError, Encoded};

use crate::Device;
use crate::lm::RadarLm;
use crate::lm::text::read_files;
use crate::params::collect_params;
use crate::tokenizer::ReferenceTokenizer;

/// Radar tokenizer and language model in burn, on the CPU.
///
/// It is slower than the engine, which is tested against it. It is the only backend that runs decoder-only language
/// models.
pub struct ReferenceBackend {
    tokenizer: ReferenceTokenizer,
    lm: RadarLm,
}

impl ReferenceBackend {
    /// Combines a radar tokenizer and a language model.
    ///
    /// # Errors
    /// If the codebook sizes or the feature widths differ.
    pub fn new(tokenizer: ReferenceTokenizer, lm: RadarLm) -> Result<Self, LmError> {
        check_pair(tokenizer.config(), &lm.config)?;
        Ok(Self { tokenizer, lm })
    }

    fn from_checkpoints(tokenizer: &Checkpoint, lm: LmFiles) -> Result<Self, LmError> {
        let tokenizer = ReferenceTokenizer::from_checkpoint(tokenizer)?;
        Self::new(tokenizer, RadarLm::from_files(lm, &Device::flex())?)
    }
}

impl Backend for ReferenceBackend {
    fn encode(&self, windows: &[(&[PointFrame], f32)]) -> Result<Vec<Encoded>, EncodeError> {
        self.tokenizer.encode_batch(windows)
    }

    fn generate(
        &self,
        prompts: &[Source],
        options: &GenerateOptions,
        watch: &mut Watch,
    ) -> Result<Vec<Generated>, LmError> {
        self.lm.check_positions(prompts, options)?;
        decode(
            &mut self.lm.decoding(),
            &self.lm.vocab,
            prompts,
            options,
            watch,
        )
    }

    fn draw(
        &self,
        prompts: &[Source],
        n: usize,
        options: &GenerateOptions,
        cancel: &AtomicBool,
    ) -> Result<Vec<Vec<Generated>>, LmError> {
        self.lm.check_positions(prompts, options)?;
        let mut decoding = self.lm.decoding();
        draw(&mut decoding, &self.lm.vocab, prompts, n, options, cancel)
    }

    fn score(&self, prompt: &Source, texts: &[Vec<u32>]) -> Result<Vec<f32>, LmError> {
        let options = GenerateOptions::default();
        self.lm
            .check_positions(std::slice::from_ref(prompt), &options)?;
        score(&mut self.lm.decoding(), &self.lm.vocab, prompt, texts)
    }

    fn vocab(&self) -> &Vocab {
        &self.lm.vocab
    }

    fn n_params(&self) -> usize {
        let weights = collect_params(&self.lm.net);
        let n_lm: usize = weights.values().map(|t| t.values.len()).sum();
        self.tokenizer.n_params() + n_lm
    }

    fn learned(&self) -> Option<&Learned> {
        self.lm.learned.as_ref()
    }
}

/// Loads a member on the networks as they are trained, which compute in f32 whatever the precision. It is the
/// [`LoadBackend`](radarllm_inference::backend::LoadBackend) of this implementation.
///
/// # Errors
/// If a file is missing or damaged, or if the networks do not fit together.
pub fn load_reference(member: Member, _: Precision) -> Result<Box<dyn Backend>, LmError> {
    let lm = LmFiles {
        cut: member.weights_cut()?,
        ..read_files(member.lm)?
    };
    let backend = ReferenceBackend::from_checkpoints(&member.tokenizer, lm)?;
    Ok(Box::new(backend))
}

/// Loads a member of any architecture: on the inference engine if the engine supports the language model, and otherwise
/// as [`load_reference`].
///
/// # Errors
/// As [`EngineBackend::from_files`]; [`LmError::NotT5`] for a decoder-only network and [`Precision::Int8`].
pub fn load_any(member: Member, precision: Precision) -> Result<Box<dyn Backend>, LmError> {
    let lm = LmFiles {
        cut: member.weights_cut()?,
        ..read_files(member.lm)?
    };
    if precision == Precision::F32 && !lm.is_t5() {
        let backend = ReferenceBackend::from_checkpoints(&member.tokenizer, lm)?;
        return Ok(Box::new(backend));
    }
    let backend = EngineBackend::from_files(&member.tokenizer, lm, precision)?;
    Ok(Box::new(backend))
}

#[cfg(test)]
mod tests {
    use std::ops::ControlFlow;
    use std::path::Path;

    use radarllm_base::{Clip, Clutter, Provenance, RadarPoint};
    use radarllm_inference::lm::captioner::{NO_PERSON, actions};
    use radarllm_inference::lm::ensemble::open_members;
    use radarllm_inference::lm::{Abstained, DescribeOptions, Description, LmPreset, templates};
    use radarllm_inference::tokenizer::TokenizerConfig;
    use radarllm_inference::{Captioner, PrepareError, PreparedClip};

    use super::*;
    use crate::tokenizer::network::TokenizerNet;
    use crate::tokenizer::pack;

    /// Untrained networks: their sentences are random, but the way in which results are assembled can be tested.
    fn networks() -> (TokenizerConfig, TokenizerNet) {
        let config = TokenizerConfig::small();
        let net = TokenizerNet::new(&config, &Device::flex());
        (config, net)
    }

    fn language_model() -> RadarLm {
        let texts = ["a person walks", "someone jumps twice"];
        let config = TokenizerConfig::small();
        let vocab = Vocab::learn(
            texts.into_iter(),
            templates::all_text(),
            600,
            4,
            config.codebook_size,
        );
        let shape = LmPreset::Small.config(config.codebook_size, config.code_dim);
        RadarLm::new(shape, vocab.unwrap(), 1, &Device::flex()).unwrap()
    }

    fn on_engine(config: TokenizerConfig, net: &TokenizerNet, precision: Precision) -> Captioner {
        let tokenizer = pack(config, net).unwrap();
        let lm = language_model().pack(precision).unwrap();
        Captioner::new(Box::new(EngineBackend::new(tokenizer, lm).unwrap()))
    }

    fn captioner() -> Captioner {
        let (config, net) = networks();
        on_engine(config, &net, Precision::F32)
    }

    /// A recording at 10 frames per second.
    fn clip(n: usize, n_points: usize) -> Clip {
        Clip {
            frames: frames(n, n_points),
            frame_rate_hz: 10.0,
            radar_height_m: 1.0,
            is_height_assumed: false,
            radar: "test".into(),
            provenance: Provenance::recorded("csv", "test.csv"),
            clutter: Clutter::Unchecked,
        }
    }

    fn describe(captioner: &Captioner, clip: &Clip) -> Description {
        captioner
            .describe(&prepared(clip), &DescribeOptions::default())
            .unwrap()
    }

    fn prepared(clip: &Clip) -> PreparedClip<'_> {
        PreparedClip::of(clip).unwrap()
    }

    fn frames(n: usize, n_points: usize) -> Vec<PointFrame> {
        let point = |f: usize, i: usize| {
            let t = (f * 31 + i * 7) as f32;
            let (x_m, y_m, z_m) = (0.4 * t.sin(), 3.0 + 0.3 * t.cos(), 0.7 * (t * 0.3).sin());
            RadarPoint {
                x_m,
                y_m,
                z_m,
                range_m: y_m,
                velocity_mps: 0.5,
                intensity_db: 20.0,
            }
        };
        (0..n)
            .map(|f| PointFrame {
                frame: f as u32,
                time_s: f as f64 * 0.1,
                points: (0..n_points).map(|i| point(f, i)).collect(),
                board: None,
            })
            .collect()
    }

    #[test]
    fn nobody_is_said_plainly() {
        let captioner = captioner();
        let said = describe(&captioner, &clip(5, 30));
        assert_eq!(
            said.abstained,
            Some(Abstained::TooFewFrames { found: 5, min: 8 })
        );
        // A few points far apart; the same number of points close together may be a person.
        let mut scattered = clip(40, 7);
        for point in scattered.frames.iter_mut().flat_map(|f| &mut f.points) {
            point.x_m *= 12.0;
        }
        let clips = [clip(0, 0), clip(40, 0), scattered];
        for clip in &clips {
            let said = describe(&captioner, clip);
            assert_eq!((said.caption.as_str(), said.windows), (NO_PERSON, 0));
            assert!(said.abstained.is_some() && said.confidence == 0.0 && said.tokens.is_empty());
        }
        let together = describe(&captioner, &clip(40, 7));
        assert_eq!((together.abstained, together.windows), (None, 1));
        let few = describe(&captioner, &clips[2]).abstained.unwrap();
        assert_eq!(few, Abstained::TooFewPoints { median: 7, min: 8 });
        assert_eq!(
            few.to_string(),
            "7 points in the median frame, at least 8 are needed, or fewer that stay together"
        );
    }

    #[test]
    fn long_recordings_are_described_window_by_window() {
        let captioner = captioner();
        let clips = [clip(40, 20), clip(200, 20), clip(3, 20)];
        let batch: Vec<PreparedClip> = clips.iter().map(prepared).collect();
        let batch: Vec<&PreparedClip> = batch.iter().collect();
        let options = DescribeOptions::default();
        let together = captioner.describe_batch(&batch, &options).unwrap();
        assert_eq!(
            together.iter().map(|d| d.windows).collect::<Vec<_>>(),
            [1, 12, 0]
        );
        assert_eq!(
            together.iter().map(|d| d.tokens.len()).collect::<Vec<_>>(),
            [10, 50, 0]
        );
        assert!((together[1].seconds - 20.0).abs() < 1e-6);
        assert!(together[0].confidence > 0.0 && together[0].confidence <= 1.0);
        for (clip, together) in clips.iter().zip(&together) {
            let alone = describe(&captioner, clip);
            assert_eq!(
                (&alone.caption, &alone.tokens),
                (&together.caption, &together.tokens)
            );
        }
    }

    #[test]
    fn every_decoder_describes_and_f32_says_what_training_says() {
        let (config, net) = networks();
        let clip = clip(60, 20);
        let options = DescribeOptions {
            beam: Some(2),
            ..Default::default()
        };
        let prepared = prepared(&clip);
        let describe = |captioner: Captioner| captioner.describe(&prepared, &options).unwrap();
        let f32 = describe(on_engine(config.clone(), &net, Precision::F32));
        let int8 = describe(on_engine(config.clone(), &net, Precision::Int8));
        let tokenizer = ReferenceTokenizer::new(config, &net);
        let reference = ReferenceBackend::new(tokenizer, language_model()).unwrap();
        let training = describe(Captioner::new(Box::new(reference)));
        assert_eq!(training.caption, f32.caption);
        assert_eq!(training.tokens, f32.tokens);
        assert!((training.confidence - f32.confidence).abs() < 1e-5);
        assert_eq!(int8.tokens, f32.tokens);
    }

    #[test]
    fn a_text_scores_the_same_on_both_backends_and_as_in_the_search() {
        let (config, net) = networks();
        let engine = on_engine(config.clone(), &net, Precision::F32);
        let tokenizer = ReferenceTokenizer::new(config, &net);
        let reference = ReferenceBackend::new(tokenizer, language_model()).unwrap();
        let training = Captioner::new(Box::new(reference));
        let clip = clip(60, 20);
        let described = describe(&engine, &clip);
        let words = described.caption.split(' ').count();
        assert!(words > 0);
        let texts: Vec<String> = ["a person walks", "someone jumps twice", ""]
            .map(String::from)
            .into_iter()
            // More texts than are scored together.
            .chain((0..100).map(|n| format!("a person {}", "walks ".repeat(n % 7))))
            .collect();
        let options = DescribeOptions::default();
        let clip = prepared(&clip);
        let a = engine.score_texts(&clip, &texts, &options).unwrap();
        let b = training.score_texts(&clip, &texts, &options).unwrap();
        assert_eq!((a.len(), a[0].len()), (1, texts.len()));
        for (a, b) in a[0].iter().zip(&b[0]) {
            assert!((a - b).abs() < 1e-4 && *a < 0.0, "{a} {b}");
        }
        // The texts differ, and the same text has the same score in another batch.
        assert!((a[0][0] - a[0][1]).abs() > 1e-3);
        assert!((a[0][4] - a[0][3 + 99]).abs() < 1e-5);
    }

    /// The model that is included in the repository, loaded from its folder by every decoder.
    #[test]
    fn folders_load_for_every_decoder() {
        let dir = Path::new(env!("CARGO_MANIFEST_DIR")).join("../model-default/weights");
        let clip = clip(60, 40);
        let f32 = Captioner::load(&dir, Precision::F32).unwrap();
        let members = open_members(&dir).unwrap();
        let training = Captioner::from_members(members, Precision::F32, load_reference).unwrap();
        assert_eq!(f32.n_params(), training.n_params());
        let searching = DescribeOptions {
            beam: Some(1),
            ..Default::default()
        };
        // Two draws on either side of a border may differ by rounding, and with them the words.
        let (a, b) = (describe(&f32, &clip), describe(&training, &clip));
        assert_eq!(actions(&a.caption), actions(&b.caption));
        assert!((a.confidence - b.confidence).abs() < 0.1);
        let [f32, training] =
            [f32, training].map(|c| c.describe(&prepared(&clip), &searching).unwrap());
        assert_eq!(
            (&f32.caption, &f32.tokens),
            (&training.caption, &training.tokens)
        );
        assert!(f32.caption.len() > 10, "{}", f32.caption);
    }

    #[test]
    fn values_that_are_not_numbers_are_errors() {
        let mut clip = clip(20, 20);
        clip.frames[3].points[0].x_m = f32::NAN;
        let expected = PrepareError::NotFinite { frame: 3, point: 0 };
        assert_eq!(PreparedClip::of(&clip), Err(expected));
    }

    /// Clips at another rate, or full of clutter, give the same description as clips that were prepared beforehand.
    #[test]
    fn clips_are_prepared_before_they_are_described() {
        let dir = Path::new(env!("CARGO_MANIFEST_DIR")).join("../model-default/weights");
        let captioner = Captioner::load(&dir, Precision::F32).unwrap();
        let mut raw = clip(120, 40);
        raw.frame_rate_hz = 20.0;
        for (i, frame) in raw.frames.iter_mut().enumerate() {
            frame.time_s = i as f64 / 20.0;
            frame.points[10..]
                .iter_mut()
                .for_each(|p| p.velocity_mps = 0.0);
        }
        let changed = radarllm_inference::prepare_for_model(raw.clone(), &Default::default());
        let changed = changed.unwrap();
        assert!(changed.removed_static.is_some() && changed.resampled_from_hz.is_some());
        let options = DescribeOptions::default();
        let expected = describe(&captioner, &changed.clip);
        assert_eq!(describe(&captioner, &raw), expected);
        let together = captioner.describe_batch(&[&prepared(&raw), &changed.clip], &options);
        assert_eq!(together.unwrap(), [expected.clone(), expected.clone()]);
        assert_eq!(
            captioner.tokenize(&prepared(&raw)).unwrap(),
            expected.tokens
        );
        raw.clutter = Clutter::Settled;
        let kept = captioner.describe(&prepared(&raw), &options).unwrap();
        assert_ne!(kept.tokens, expected.tokens);
    }

    #[test]
    fn a_streamed_caption_is_the_caption_and_can_be_stopped() {
        let dir = Path::new(env!("CARGO_MANIFEST_DIR")).join("../model-default/weights");
        let engine = Captioner::load(&dir, Precision::F32).unwrap();
        let member = Captioner::load(&dir.join("member-2"), Precision::F32).unwrap();
        assert!(engine.n_params() > member.n_params());
        let mut long = clip(60, 40);
        long.frames.extend(clip(150, 20).frames);
        // A recording of several windows, of which the first short one and the first long one show a person.
        let mut leaves = clip(120, 40);
        leaves.frames[20..]
            .iter_mut()
            .for_each(|f| f.points.clear());
        let described = engine
            .describe(&prepared(&leaves), &DescribeOptions::default())
            .unwrap();
        assert_eq!(described.windows, 2);
        for (engine, beam) in [(&engine, 1), (&member, 1), (&member, 3)] {
            let is_single = engine.n_params() == member.n_params();
            let options = DescribeOptions {
                beam: Some(beam),
                ..Default::default()
            };
            for clip in [&clip(60, 40), &long, &leaves, &clip(3, 3)] {
                let clip = &prepared(clip);
                let mut pieces = Vec::new();
                let streamed = engine.describe_streaming(clip, &options, |piece| {
                    pieces.push(piece.to_string());
                    ControlFlow::Continue(())
                });
                let expected = engine.describe(clip, &options).unwrap();
                assert_eq!(pieces.concat(), expected.caption);
                let n_words = expected.caption.split(' ').count();
                if clip.frames.len() == 60 && beam == 1 && is_single {
                    assert!(pieces.len() > n_words / 2, "{pieces:?}");
                }
                if !is_single {
                    assert_eq!(pieces.len(), 1, "the members decide at the end");
                }
                assert_eq!(streamed.unwrap(), Some(expected));
                let mut n_pieces = 0;
                let stopped = engine.describe_streaming(clip, &options, |_| {
                    n_pieces += 1;
                    ControlFlow::Break(())
                });
                assert_eq!((stopped.unwrap(), n_pieces), (None, 1));
            }
        }
    }
}
