//! Points in, sentence out.

use std::path::Path;

use radarllm_base::PointFrame;
use radarllm_engine::{Engine, Generated, Precision};

use super::card::LmFiles;
use super::config::LmConfig;
use super::on_engine::EngineLm;
use super::presence::{median_points, points_stay_together};
#[cfg(feature = "train")]
use super::radar_lm::RadarLm;
use super::vocab::Vocab;
use super::{Allowed, GenerateOptions, LmError};
use crate::checkpoint::Checkpoint;
#[cfg(feature = "train")]
use crate::tokenizer::ReferenceTokenizer;
use crate::tokenizer::{
    EncodeError, Encoded, FRAMES_PER_CODE, MAX_FRAMES, RadarTokenizer, TokenizerConfig,
};

/// What is said when nobody can be seen.
pub const NO_PERSON: &str = "no person seen";

/// Radar frames a second that both networks were made for.
pub const FRAME_RATE_HZ: f32 = 10.0;

/// Radar tokenizer and language model, ready to describe.
pub struct Captioner {
    networks: Networks,
    /// A window whose median frame has fewer points than this holds no person, unless the few stay together.
    pub min_median_points: usize,
    /// Fewer frames than this say nothing.
    pub min_frames: usize,
}

/// Points to codes to words.
enum Networks {
    Engine(Box<RadarTokenizer>, Box<EngineLm>),
    #[cfg(feature = "train")]
    Training(Box<ReferenceTokenizer>, Box<RadarLm>),
}

/// What turns points into codes and codes into words.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Decoder {
    /// The inference engine, the language model on these numbers (the radar tokenizer always in f32). In
    /// f32 it says what the training networks say; bytes are faster on large models and now and then choose
    /// another word.
    Engine(Precision),
    /// The networks as they are trained.
    #[cfg(feature = "train")]
    Training,
}

/// Why there is no caption.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Abstained {
    /// The recording is too short.
    TooFewFrames {
        /// Frames found.
        found: usize,
        /// Frames needed.
        least: usize,
    },
    /// No window has enough points.
    TooFewPoints {
        /// Median points a frame in the best window.
        median: usize,
        /// Median needed.
        least: usize,
    },
}

impl std::fmt::Display for Abstained {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::TooFewFrames { found, least } => {
                write!(f, "{found} frames, at least {least} are needed")
            }
            Self::TooFewPoints { median, least } => {
                write!(
                    f,
                    "{median} points in the median frame, at least {least} are needed, or fewer that stay together"
                )
            }
        }
    }
}

/// What the model says about a recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Description {
    /// The sentence; exactly [`NO_PERSON`] when [`Self::abstained`] is set.
    pub caption: String,
    /// exp(mean token log-probability) over all windows, 0..=1; 0 when abstained.
    pub confidence: f32,
    /// Radar codes of all windows.
    pub tokens: Vec<u32>,
    /// Length of the recording at 10 frames a second, s.
    pub seconds: f32,
    /// Windows that were described.
    pub windows: usize,
    /// Why nothing is said, if so.
    pub abstained: Option<Abstained>,
}

impl Captioner {
    /// Loads `dir/tokenizer` and `dir/lm`; only the networks that `decoder` names are built.
    ///
    /// # Errors
    /// If either is missing or damaged, or they do not belong together.
    pub fn load(dir: &Path, decoder: Decoder) -> Result<Self, LmError> {
        let open = |part: &str| Checkpoint::open(&dir.join(part));
        Self::from_checkpoints(&open("tokenizer")?, open("lm")?, decoder)
    }

    /// Builds a tokenizer and a language model.
    ///
    /// # Errors
    /// As [`Self::load`].
    pub fn from_checkpoints(
        tokenizer: &Checkpoint,
        lm: Checkpoint,
        decoder: Decoder,
    ) -> Result<Self, LmError> {
        let lm = LmFiles::of(lm)?;
        match decoder {
            // The engine holds no decoder alone; what it would say in f32 the training network says.
            #[cfg(feature = "train")]
            Decoder::Engine(Precision::F32) if !lm.is_t5() => Self::load_training(tokenizer, lm),
            Decoder::Engine(precision) => Self::new(
                RadarTokenizer::from_checkpoint(tokenizer)?,
                EngineLm::from_files(lm, precision)?,
            ),
            #[cfg(feature = "train")]
            Decoder::Training => Self::load_training(tokenizer, lm),
        }
    }

    #[cfg(feature = "train")]
    fn load_training(tokenizer: &Checkpoint, lm: LmFiles) -> Result<Self, LmError> {
        Self::training(
            ReferenceTokenizer::from_checkpoint(tokenizer)?,
            RadarLm::from_files(lm, &super::Device::flex())?,
        )
    }

    /// Puts two models together.
    ///
    /// # Errors
    /// If codebook size or feature width differ.
    pub fn new(tokenizer: RadarTokenizer, lm: EngineLm) -> Result<Self, LmError> {
        check_pair(tokenizer.config(), lm.config())?;
        Ok(Self::of(Networks::Engine(tokenizer.into(), lm.into())))
    }

    /// Puts two models together that run as they are trained.
    ///
    /// # Errors
    /// As [`Self::new`].
    #[cfg(feature = "train")]
    pub fn training(tokenizer: ReferenceTokenizer, lm: RadarLm) -> Result<Self, LmError> {
        check_pair(tokenizer.config(), &lm.config)?;
        Ok(Self::of(Networks::Training(tokenizer.into(), lm.into())))
    }

    fn of(networks: Networks) -> Self {
        Self {
            networks,
            min_median_points: 8,
            min_frames: 8,
        }
    }

    /// Number of weights of both models.
    pub fn n_params(&self) -> usize {
        match &self.networks {
            Networks::Engine(tokenizer, lm) => tokenizer.n_params() + lm.n_params(),
            #[cfg(feature = "train")]
            Networks::Training(tokenizer, lm) => {
                let weights = crate::checkpoint::collect_params(&lm.net);
                let n_lm: usize = weights.values().map(|t| t.values.len()).sum();
                tokenizer.n_params() + n_lm
            }
        }
    }

    /// Ids of words.
    pub fn vocab(&self) -> &Vocab {
        match &self.networks {
            Networks::Engine(_, lm) => lm.vocab(),
            #[cfg(feature = "train")]
            Networks::Training(_, lm) => &lm.vocab,
        }
    }

    /// Codes of windows.
    fn encode(&self, windows: &[(&[PointFrame], f32)]) -> Result<Vec<Encoded>, EncodeError> {
        match &self.networks {
            Networks::Engine(tokenizer, _) => tokenizer.encode_batch(windows),
            #[cfg(feature = "train")]
            Networks::Training(tokenizer, _) => tokenizer.encode_batch(windows),
        }
    }

    /// What is said about each window's codes, and its words.
    fn say(
        &self,
        encoded: &[Encoded],
        options: &GenerateOptions,
    ) -> Result<Vec<(Generated, String)>, LmError> {
        let (generated, vocab) = match &self.networks {
            Networks::Engine(_, lm) => {
                let sources = encoded.iter().map(|e| lm.describe_prompt(e));
                let sources = sources.collect::<Result<Vec<_>, _>>()?;
                let mut session = lm.engine().session(threads(lm.engine()));
                (lm.generate(&mut session, &sources, options)?, lm.vocab())
            }
            #[cfg(feature = "train")]
            Networks::Training(_, lm) => {
                let sources = encoded.iter().map(|e| lm.describe_prompt(e));
                let sources = sources.collect::<Result<Vec<_>, _>>()?;
                (lm.generate(&sources, options)?, &lm.vocab)
            }
        };
        let with_text = |g: Generated| {
            let text = vocab.text(&g.ids);
            (g, text)
        };
        Ok(generated.into_iter().map(with_text).collect())
    }

    /// Describes one recording at 10 frames a second, of any length.
    ///
    /// Longer recordings are cut into equal windows of at most 96 frames whose captions are joined
    /// with ", then " where they differ. `beam` 1 is greedy.
    ///
    /// # Errors
    /// If a value is not finite.
    pub fn describe(
        &self,
        frames: &[PointFrame],
        radar_height_m: f32,
        beam: usize,
    ) -> Result<Description, LmError> {
        let mut all = self.describe_batch(&[(frames, radar_height_m)], beam)?;
        all.pop()
            .ok_or_else(|| LmError::Input("no recording".into()))
    }

    /// Describes many recordings, each with its radar's height, m.
    ///
    /// # Errors
    /// If a value is not finite.
    pub fn describe_batch(
        &self,
        clips: &[(&[PointFrame], f32)],
        beam: usize,
    ) -> Result<Vec<Description>, LmError> {
        let mut windows = Vec::new();
        let mut owners = Vec::new();
        let mut out = Vec::with_capacity(clips.len());
        for (i, (frames, height_m)) in clips.iter().enumerate() {
            let (kept, abstained) = self.usable_windows(frames);
            owners.extend(std::iter::repeat_n(i, kept.len()));
            windows.extend(kept.into_iter().map(|w| (w, *height_m)));
            out.push(Description {
                caption: if abstained.is_some() {
                    NO_PERSON.into()
                } else {
                    String::new()
                },
                confidence: 0.0,
                tokens: Vec::new(),
                seconds: frames.len() as f32 / FRAME_RATE_HZ,
                windows: 0,
                abstained,
            });
        }
        let encoded = self
            .encode(&windows)
            .map_err(|e| LmError::RadarTokenizer(e.to_string()))?;
        let options = GenerateOptions {
            beam,
            allowed: Allowed::Text,
            ..Default::default()
        };
        let generated = self.say(&encoded, &options)?;
        // Per recording: last caption said, summed log-probability, scored tokens.
        let mut sums = vec![(String::new(), 0.0_f32, 0_usize); clips.len()];
        for ((owner, codes), (result, text)) in owners.iter().zip(&encoded).zip(generated) {
            let description = &mut out[*owner];
            let (last, log_prob, n) = &mut sums[*owner];
            description.tokens.extend(&codes.codes);
            description.windows += 1;
            *log_prob += result.log_prob;
            *n += result.ids.len() + 1;
            description.confidence = (*log_prob / *n as f32).exp().clamp(0.0, 1.0);
            if text != *last && !text.is_empty() {
                if !description.caption.is_empty() {
                    // "walks., then turns." would read badly.
                    let len = description.caption.trim_end_matches('.').len();
                    description.caption.truncate(len);
                    description.caption.push_str(", then ");
                }
                description.caption.push_str(&text);
                *last = text;
            }
        }
        Ok(out)
    }

    /// The windows that may hold a person, or why there are none.
    fn usable_windows<'a>(
        &self,
        frames: &'a [PointFrame],
    ) -> (Vec<&'a [PointFrame]>, Option<Abstained>) {
        if frames.len() < self.min_frames.max(1) {
            let (found, least) = (frames.len(), self.min_frames.max(1));
            return (Vec::new(), Some(Abstained::TooFewFrames { found, least }));
        }
        let mut best = 0;
        let mut kept = Vec::new();
        for window in equal_windows(frames) {
            let median = median_points(window);
            best = best.max(median);
            if median >= self.min_median_points || points_stay_together(window) {
                kept.push(window);
            }
        }
        let abstained = kept.is_empty().then_some(Abstained::TooFewPoints {
            median: best,
            least: self.min_median_points,
        });
        (kept, abstained)
    }
}

/// Checks that the language model knows the tokenizer's codes and features.
fn check_pair(tokenizer: &TokenizerConfig, lm: &LmConfig) -> Result<(), LmError> {
    let (size, dim) = (tokenizer.codebook_size, tokenizer.code_dim);
    if size != lm.n_codes || (lm.bypass && dim != lm.code_dim) {
        let problem = format!(
            "the tokenizer has {size} codes of width {dim}, the language model knows {} of {}",
            lm.n_codes, lm.code_dim
        );
        return Err(LmError::Config {
            field: "n_codes",
            problem,
        });
    }
    Ok(())
}

/// Small models fit one core's caches and are fastest there; large ones wait for memory, which several
/// cores bring in faster.
fn threads(engine: &Engine) -> usize {
    const LARGE_BYTES: usize = 32 << 20;
    if engine.bytes() < LARGE_BYTES {
        return 1;
    }
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// Cuts frames into the fewest windows of at most [`MAX_FRAMES`], all about equally long and, but
/// for the last, of whole codes: a short tail would be described from almost nothing.
fn equal_windows(frames: &[PointFrame]) -> impl Iterator<Item = &[PointFrame]> {
    let n_windows = frames.len().div_ceil(MAX_FRAMES).max(1);
    let n_codes = frames.len().div_ceil(FRAMES_PER_CODE);
    let length = n_codes.div_ceil(n_windows).max(1) * FRAMES_PER_CODE;
    frames.chunks(length)
}

#[cfg(all(test, feature = "train"))]
mod tests {
    use super::*;
    use crate::lm::{Device, LmPreset, Vocab, templates};
    use crate::tokenizer::network::TokenizerNet;
    use radarllm_base::RadarPoint;

    /// Untrained networks: what they say is noise, how it is put together is not.
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
        let tokenizer = RadarTokenizer::from_net(config, net).unwrap();
        Captioner::new(tokenizer, EngineLm::of(language_model(), precision)).unwrap()
    }

    fn captioner() -> Captioner {
        let (config, net) = networks();
        on_engine(config, &net, Precision::F32)
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
            })
            .collect()
    }

    #[test]
    fn nobody_is_said_plainly() {
        let captioner = captioner();
        let said = captioner.describe(&frames(5, 30), 1.0, 1).unwrap();
        assert_eq!(
            said.abstained,
            Some(Abstained::TooFewFrames { found: 5, least: 8 })
        );
        // Few points far apart; the same few around one place may be somebody.
        let mut scattered = frames(40, 7);
        for point in scattered.iter_mut().flat_map(|f| &mut f.points) {
            point.x_m *= 12.0;
        }
        let clips = [frames(0, 0), frames(40, 0), scattered];
        for clip in &clips {
            let said = captioner.describe(clip, 1.0, 1).unwrap();
            assert_eq!((said.caption.as_str(), said.windows), (NO_PERSON, 0));
            assert!(said.abstained.is_some() && said.confidence == 0.0 && said.tokens.is_empty());
        }
        let together = captioner.describe(&frames(40, 7), 1.0, 1).unwrap();
        assert_eq!((together.abstained, together.windows), (None, 1));
        let few = captioner
            .describe(&clips[2], 1.0, 1)
            .unwrap()
            .abstained
            .unwrap();
        assert_eq!(
            few,
            Abstained::TooFewPoints {
                median: 7,
                least: 8
            }
        );
        assert_eq!(
            few.to_string(),
            "7 points in the median frame, at least 8 are needed, or fewer that stay together"
        );
    }

    #[test]
    fn long_recordings_are_described_window_by_window() {
        let captioner = captioner();
        let clips = [frames(40, 20), frames(200, 20), frames(3, 20)];
        let batch: Vec<(&[PointFrame], f32)> = clips.iter().map(|c| (c.as_slice(), 1.0)).collect();
        let together = captioner.describe_batch(&batch, 1).unwrap();
        assert_eq!(
            together.iter().map(|d| d.windows).collect::<Vec<_>>(),
            [1, 3, 0]
        );
        assert_eq!(
            together.iter().map(|d| d.tokens.len()).collect::<Vec<_>>(),
            [10, 50, 0]
        );
        assert!((together[1].seconds - 20.0).abs() < 1e-6);
        assert!(together[0].confidence > 0.0 && together[0].confidence <= 1.0);
        for (clip, together) in clips.iter().zip(&together) {
            let alone = captioner.describe(clip, 1.0, 1).unwrap();
            assert_eq!(
                (&alone.caption, &alone.tokens),
                (&together.caption, &together.tokens)
            );
        }
    }

    #[test]
    fn every_decoder_describes_and_f32_says_what_training_says() {
        let (config, net) = networks();
        let clip = frames(60, 20);
        let describe = |captioner: Captioner| captioner.describe(&clip, 1.0, 2).unwrap();
        let f32 = describe(on_engine(config.clone(), &net, Precision::F32));
        let int8 = describe(on_engine(config.clone(), &net, Precision::Int8));
        let tokenizer = ReferenceTokenizer::new(config, &net);
        let training = describe(Captioner::training(tokenizer, language_model()).unwrap());
        assert_eq!(training.caption, f32.caption);
        assert_eq!(training.tokens, f32.tokens);
        assert!((training.confidence - f32.confidence).abs() < 1e-5);
        assert_eq!(int8.tokens, f32.tokens);
    }

    /// The model that comes with the repository, from its folder by every decoder.
    #[test]
    fn folders_load_for_every_decoder() {
        let dir = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/default");
        let clip = frames(60, 40);
        let load = |decoder| Captioner::load(&dir, decoder).unwrap();
        let f32 = load(Decoder::Engine(Precision::F32));
        let training = load(Decoder::Training);
        assert_eq!(f32.n_params(), training.n_params());
        let (f32, training) = (
            f32.describe(&clip, 1.0, 1).unwrap(),
            training.describe(&clip, 1.0, 1).unwrap(),
        );
        assert_eq!(
            (&f32.caption, &f32.tokens),
            (&training.caption, &training.tokens)
        );
        assert!(f32.caption.len() > 10, "{}", f32.caption);
    }

    #[test]
    fn values_that_are_not_numbers_are_errors() {
        let mut clip = frames(20, 20);
        clip[3].points[0].x_m = f32::NAN;
        assert!(captioner().describe(&clip, 1.0, 1).is_err());
    }

    #[test]
    fn windows_are_equal_whole_and_complete() {
        for n in [1, 8, 95, 96, 97, 100, 192, 193, 1000] {
            let frames: Vec<PointFrame> = (0..n)
                .map(|i| PointFrame {
                    frame: i,
                    ..Default::default()
                })
                .collect();
            let windows: Vec<_> = equal_windows(&frames).collect();
            assert_eq!(windows.concat(), frames, "{n}");
            assert!(windows.iter().all(|w| w.len() <= MAX_FRAMES), "{n}");
            assert_eq!(windows.len(), (n as usize).div_ceil(MAX_FRAMES), "{n}");
            let shortest = windows.iter().map(|w| w.len()).min().unwrap();
            assert!(
                windows.len() == 1 || shortest >= MAX_FRAMES / 3,
                "{n}: {shortest}"
            );
        }
    }
}
