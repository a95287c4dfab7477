//! Points in, sentence out.

use std::path::Path;

use burn::tensor::Device;
use radarllm_base::PointFrame;
use radarllm_engine::{Engine, Precision};

use super::presence::{median_points, points_stay_together};
use super::{Allowed, GenerateOptions, LmError, RadarLm};
use crate::tokenizer::{FRAMES_PER_CODE, MAX_FRAMES, RadarTokenizer};

/// What is said when nobody can be seen.
pub const NO_PERSON: &str = "no person seen";

/// Radar frames a second that both networks were made for.
pub const FRAME_RATE_HZ: f32 = 10.0;

/// Radar tokenizer and language model, ready to describe.
pub struct Captioner {
    /// Points to codes.
    pub tokenizer: RadarTokenizer,
    /// Codes to words.
    pub lm: RadarLm,
    /// A window whose median frame has fewer points than this holds no person, unless the few stay together.
    pub min_median_points: usize,
    /// Fewer frames than this say nothing.
    pub min_frames: usize,
    /// The language model's weights packed for decoding; none when the training network decodes.
    engine: Option<Engine>,
}

/// What turns codes into words.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Decoder {
    /// The inference engine on these numbers. In f32 it says what the training network says; bytes are
    /// faster on large models and now and then choose another word.
    Engine(Precision),
    /// The network as it is trained.
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
    /// Loads `dir/tokenizer` and `dir/lm` on the CPU.
    ///
    /// # Errors
    /// If either is missing or damaged, or they do not belong together.
    pub fn load(dir: &Path) -> Result<Self, LmError> {
        let tokenizer = RadarTokenizer::load(&dir.join("tokenizer"))?;
        let lm = RadarLm::load(&dir.join("lm"), &Device::flex())?;
        Self::new(tokenizer, lm)
    }

    /// Puts two models together.
    ///
    /// # Errors
    /// If codebook size or feature width differ.
    pub fn new(tokenizer: RadarTokenizer, lm: RadarLm) -> Result<Self, LmError> {
        let (size, dim) = (
            tokenizer.config().codebook_size,
            tokenizer.config().code_dim,
        );
        if size != lm.config.n_codes || (lm.config.bypass && dim != lm.config.code_dim) {
            let problem = format!(
                "the tokenizer has {size} codes of width {dim}, the language model knows {} of {}",
                lm.config.n_codes, lm.config.code_dim
            );
            return Err(LmError::Config {
                field: "n_codes",
                problem,
            });
        }
        let mut captioner = Self {
            tokenizer,
            lm,
            min_median_points: 8,
            min_frames: 8,
            engine: None,
        };
        // The engine holds no decoder alone; there the training network decodes.
        if captioner.lm.net.t5().is_some() {
            captioner.set_decoder(Decoder::Engine(Precision::F32))?;
        }
        Ok(captioner)
    }

    /// Chooses what decodes; [`Precision::F32`] on the engine at first. Packs the present weights of
    /// [`Self::lm`]: to be called again if they change.
    ///
    /// # Errors
    /// If the engine cannot hold the language model.
    pub fn set_decoder(&mut self, decoder: Decoder) -> Result<(), LmError> {
        self.engine = match decoder {
            Decoder::Engine(precision) => Some(self.lm.engine(precision)?),
            Decoder::Training => None,
        };
        Ok(())
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
            .tokenizer
            .encode_batch(&windows)
            .map_err(|e| LmError::RadarTokenizer(e.to_string()))?;
        let sources: Vec<_> = encoded
            .iter()
            .map(|e| self.lm.describe_prompt(e))
            .collect::<Result<_, _>>()?;
        let options = GenerateOptions {
            beam,
            allowed: Allowed::Text,
            ..Default::default()
        };
        let generated = match &self.engine {
            Some(engine) => {
                let mut session = engine.session(threads(engine));
                self.lm.generate_on(&mut session, &sources, &options)?
            }
            None => self.lm.generate(&sources, &options)?,
        };
        // Per recording: last caption said, summed log-probability, scored tokens.
        let mut sums = vec![(String::new(), 0.0_f32, 0_usize); clips.len()];
        for ((owner, codes), result) in owners.iter().zip(&encoded).zip(&generated) {
            let text = self.lm.vocab.text(&result.ids);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lm::{LmPreset, Vocab, templates};
    use crate::tokenizer::TokenizerConfig;
    use crate::tokenizer::network::TokenizerNet;
    use radarllm_base::RadarPoint;

    /// Untrained networks: what they say is noise, how it is put together is not.
    fn captioner() -> Captioner {
        let device = Device::flex();
        let config = TokenizerConfig::small();
        let net = TokenizerNet::new(&config, &device);
        let texts = ["a person walks", "someone jumps twice"];
        let vocab = Vocab::learn(
            texts.into_iter(),
            templates::all_text(),
            600,
            4,
            config.codebook_size,
        );
        let shape = LmPreset::Small.config(config.codebook_size, config.code_dim);
        let lm = RadarLm::new(shape, vocab.unwrap(), 1, &device).unwrap();
        Captioner::new(RadarTokenizer::from_net(config, net), lm).unwrap()
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
        let mut captioner = captioner();
        let clip = frames(60, 20);
        let by_default = captioner.describe(&clip, 1.0, 2).unwrap();
        let mut with = |decoder| {
            captioner.set_decoder(decoder).unwrap();
            captioner.describe(&clip, 1.0, 2).unwrap()
        };
        let training = with(Decoder::Training);
        assert_eq!(with(Decoder::Engine(Precision::F32)), by_default);
        assert_eq!(training.caption, by_default.caption);
        assert!((training.confidence - by_default.confidence).abs() < 1e-5);
        assert_eq!(
            with(Decoder::Engine(Precision::Int8)).tokens,
            by_default.tokens
        );
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
