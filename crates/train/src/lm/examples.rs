//! From clips and tasks to token sequences.

use rand::rngs::ChaCha8Rng;
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};

use radarllm_base::random::normal_polar_f32;
use radarllm_inference::lm::templates::{Piece, Task, pieces};
use radarllm_inference::lm::{InputError, LmError, Source, Vocab};
use radarllm_inference::tokenizer::Encoded;

use super::clip::{LmClip, swap_sides};
use super::config::LmTrainConfig;
use super::corrupt::choose_spans;

/// Which stage: pretraining asks with the first prompt of a task, instruction tuning with any.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LmStageKind {
    /// Radar prediction, radar to text, text to radar.
    Pretrain,
    /// Templates and sub-tasks.
    Instruct,
}

impl LmStageKind {
    fn tasks(self) -> &'static [Task] {
        match self {
            Self::Pretrain => &Task::PRETRAINING,
            Self::Instruct => &Task::INSTRUCTION,
        }
    }
}

/// What one training example is made of. Packs into a number, which is how the loop names items.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Item {
    /// Index of the clip.
    pub clip: usize,
    /// The task.
    pub task: Task,
    /// Index of the simulation.
    pub variant: usize,
    /// The mirrored clip.
    pub flipped: bool,
    /// Index of the caption.
    pub caption: usize,
    /// Index of the prompt.
    pub prompt: usize,
}

const TASKS: [Task; 6] = [
    Task::RadarToText,
    Task::TextToRadar,
    Task::TextToLength,
    Task::RadarToLength,
    Task::Continuation,
    Task::RadarPrediction,
];

/// Most variants or captions of a clip that are used: they must fit their bits of an item number.
const MOST: usize = 256;

impl Item {
    /// The number.
    pub fn pack(self) -> usize {
        let task = TASKS.iter().position(|t| *t == self.task).unwrap_or(0);
        let fields = [
            (self.flipped as usize, 1),
            (self.variant, 8),
            (self.caption, 8),
            (self.prompt, 9),
        ];
        fields
            .into_iter()
            .fold((self.clip << 3) | task, |n, (value, bits)| {
                (n << bits) | value
            })
    }

    /// Back from the number.
    pub fn unpack(mut n: usize) -> Self {
        let mut take = |bits: u32| {
            let value = n & ((1 << bits) - 1);
            n >>= bits;
            value
        };
        let (prompt, caption, variant, flipped) = (take(9), take(8), take(8), take(1) == 1);
        let task = TASKS[take(3) % TASKS.len()];
        Self {
            clip: n,
            task,
            variant,
            flipped,
            caption,
            prompt,
        }
    }
}

/// One training example.
#[derive(Clone, Debug, PartialEq)]
pub struct Example {
    /// Prompt: the encoder's input, or what a decoder alone reads first.
    pub source: Source,
    /// Target, end token included.
    pub target: Vec<u32>,
    /// Its task.
    pub task: Task,
}

/// A prompt as ids around its placeholder.
struct Prompt {
    before: Vec<u32>,
    after: Vec<u32>,
}

/// Clips with everything that does not change between epochs worked out.
pub struct ExampleMaker {
    clips: Vec<LmClip>,
    /// Per clip and caption: ids of the caption and of its mirror image.
    captions: Vec<Vec<[Vec<u32>; 2]>>,
    /// Per clip: ids of "{seconds} seconds".
    lengths: Vec<Vec<u32>>,
    /// Per entry of [`TASKS`].
    prompts: Vec<Vec<Prompt>>,
    kind: LmStageKind,
}

fn seconds_text(seconds: f32) -> String {
    format!("{seconds:.1} seconds")
}

impl ExampleMaker {
    /// Checks clips and encodes their captions.
    ///
    /// # Errors
    /// If a clip has no caption or no codes, codes and features do not fit the model, or a text is
    /// refused.
    pub fn new(
        vocab: &Vocab,
        code_dim: usize,
        clips: &[LmClip],
        kind: LmStageKind,
    ) -> Result<Self, LmError> {
        let mut captions = Vec::with_capacity(clips.len());
        let mut lengths = Vec::with_capacity(clips.len());
        for clip in clips {
            check_clip(vocab, code_dim, clip)?;
            let ids = |text: &str| vocab.text_ids(text);
            let both = |text: &String| Ok([ids(text)?, ids(&swap_sides(text))?]);
            let of_clip = clip.captions.iter().take(MOST).map(both);
            captions.push(of_clip.collect::<Result<Vec<_>, LmError>>()?);
            lengths.push(ids(&seconds_text(clip.seconds))?);
        }
        let mut prompts = Vec::new();
        for task in TASKS {
            let mut of_task = Vec::new();
            for prompt in task.prompts() {
                let (mut before, mut after, mut seen) = (Vec::new(), Vec::new(), false);
                for piece in pieces(prompt) {
                    match piece {
                        Piece::Placeholder(_) => seen = true,
                        Piece::Words(words) => {
                            let side = if seen { &mut after } else { &mut before };
                            side.extend(vocab.text_ids(words)?);
                        }
                    }
                }
                of_task.push(Prompt { before, after });
            }
            prompts.push(of_task);
        }
        Ok(Self {
            clips: clips.to_vec(),
            captions,
            lengths,
            prompts,
            kind,
        })
    }

    /// Leaves the first `n` captions of every clip, and at least one.
    pub fn keep_captions(&mut self, n: usize) {
        let captions = &mut self.captions;
        captions.iter_mut().for_each(|c| c.truncate(n.max(1)));
    }

    /// The clips.
    pub fn clips(&self) -> &[LmClip] {
        &self.clips
    }

    fn prompts_of(&self, task: Task) -> &[Prompt] {
        TASKS
            .iter()
            .position(|t| *t == task)
            .map_or(&[], |i| self.prompts[i].as_slice())
    }

    fn encoded(&self, item: &Item) -> &Encoded {
        let clip = &self.clips[item.clip];
        if item.flipped {
            &clip.flipped[item.variant]
        } else {
            &clip.variants[item.variant]
        }
    }

    /// Draws the items of an epoch: their number depends on clips and settings alone.
    pub fn draw_epoch(&self, config: &LmTrainConfig, seed: u64) -> Vec<Item> {
        let rng = &mut ChaCha8Rng::seed_from_u64(seed);
        let tasks = self.kind.tasks();
        let shares: Vec<f64> = tasks.iter().map(|t| config.sampling.of(*t)).collect();
        let total: f64 = shares.iter().sum();
        let mut items = Vec::new();
        for (i, clip) in self.clips.iter().enumerate() {
            let n_captions = self.captions[i].len();
            let n = if config.samples_per_clip == 0 {
                n_captions
            } else {
                config.samples_per_clip
            };
            // With fewer samples than captions, another choice of captions every epoch.
            let first = rng.random_range(0..n_captions);
            for k in 0..n {
                let mut left = rng.random::<f64>() * total;
                let mut task = Task::RadarToText;
                for (candidate, share) in tasks.iter().zip(&shares) {
                    if left < *share {
                        task = *candidate;
                        break;
                    }
                    left -= share;
                }
                let flipped = config.flip && !clip.flipped.is_empty() && rng.random::<bool>();
                let pool = if flipped {
                    &clip.flipped
                } else {
                    &clip.variants
                };
                let variant = rng.random_range(0..pool.len().min(MOST));
                // A single code can be neither masked nor continued.
                if pool[variant].codes.len() < 2
                    && matches!(task, Task::RadarPrediction | Task::Continuation)
                {
                    task = Task::RadarToText;
                }
                let prompt = match self.kind {
                    LmStageKind::Pretrain => 0,
                    LmStageKind::Instruct => rng.random_range(0..task.prompts().len()),
                };
                let caption = (first + k) % n_captions;
                items.push(Item {
                    clip: i,
                    task,
                    variant,
                    flipped,
                    caption,
                    prompt,
                });
            }
        }
        items
    }

    /// Groups items into batches of similar length, in random order.
    pub fn batches(&self, mut items: Vec<Item>, batch: usize, seed: u64) -> Vec<Vec<Item>> {
        /// Batches sorted together: more pads less, fewer mixes better.
        const POOL: usize = 16;
        let rng = &mut ChaCha8Rng::seed_from_u64(seed);
        items.shuffle(rng);
        for pool in items.chunks_mut(batch * POOL) {
            pool.sort_by_key(|item| self.lengths_of(item));
        }
        let mut batches: Vec<Vec<Item>> = items.chunks(batch).map(<[Item]>::to_vec).collect();
        batches.shuffle(rng);
        batches
    }

    /// Approximate (target, source) length of an item, tokens.
    fn lengths_of(&self, item: &Item) -> (usize, usize) {
        let codes = self.encoded(item).codes.len();
        let text = self.captions[item.clip][item.caption][0].len();
        let prompt = &self.prompts_of(item.task)[item.prompt];
        let words = prompt.before.len() + prompt.after.len();
        match item.task {
            Task::RadarToText => (text, words + codes),
            Task::TextToRadar => (codes, words + text),
            Task::TextToLength => (4, words + text),
            Task::RadarToLength => (4, words + codes),
            Task::Continuation => (codes / 2, words + codes / 2),
            Task::RadarPrediction => (codes / 4, words + codes),
        }
    }

    /// Builds an example; codes are disturbed as the settings say.
    ///
    /// # Errors
    /// If a code is beyond the codebook.
    pub fn example(
        &self,
        vocab: &Vocab,
        config: &LmTrainConfig,
        item: &Item,
        rng: &mut ChaCha8Rng,
    ) -> Result<Example, LmError> {
        let layout = vocab.layout();
        let encoded = self.encoded(item);
        let codes = vocab.radar_ids(&encoded.codes)?;
        let dim = encoded.features.len() / codes.len().max(1);
        let prompt = &self.prompts_of(item.task)[item.prompt];
        let caption = &self.captions[item.clip][item.caption][usize::from(item.flipped)];
        let mut source = Source::default();
        let mut target = Vec::new();
        source.ids.extend(&prompt.before);
        // One code with its feature, perhaps disturbed.
        let push = |source: &mut Source, i: usize, rng: &mut ChaCha8Rng| {
            if config.drop_code > 0.0 && rng.random_bool(config.drop_code) {
                return;
            }
            if config.replace_code > 0.0 && rng.random_bool(config.replace_code) {
                source
                    .ids
                    .push(layout.code(rng.random_range(0..layout.n_codes)));
                return;
            }
            source.feature_positions.push(source.ids.len() as u32);
            source.ids.push(codes[i]);
            let feature = &encoded.features[i * dim..(i + 1) * dim];
            if config.feature_noise > 0.0 {
                let rms = (feature.iter().map(|v| v * v).sum::<f32>() / dim as f32).sqrt();
                let size = rms * config.feature_noise as f32;
                source
                    .features
                    .extend(feature.iter().map(|v| v + size * normal(rng)));
            } else {
                source.features.extend_from_slice(feature);
            }
        };
        match item.task {
            Task::RadarToText | Task::RadarToLength => {
                source.ids.push(layout.som());
                (0..codes.len()).for_each(|i| push(&mut source, i, rng));
                source.ids.push(layout.eom());
                let answer = if item.task == Task::RadarToText {
                    caption
                } else {
                    &self.lengths[item.clip]
                };
                target.extend(answer);
            }
            Task::TextToRadar => {
                source.ids.extend(caption);
                target.extend(&codes);
            }
            Task::TextToLength => {
                source.ids.extend(caption);
                target.extend(&self.lengths[item.clip]);
            }
            Task::Continuation => {
                let cut = rng.random_range(1..codes.len().max(2)).min(codes.len());
                source.ids.push(layout.som());
                (0..cut).for_each(|i| push(&mut source, i, rng));
                source.ids.push(layout.eom());
                target.extend(&codes[cut..]);
            }
            Task::RadarPrediction => {
                let spans = choose_spans(rng, codes.len(), config.mask_share, config.mask_span);
                source.ids.push(layout.som());
                let mut at = 0;
                for (k, (start, end)) in spans.into_iter().enumerate() {
                    // More spans than sentinels would need far longer clips than the tokenizer
                    // makes; the rest then stays visible.
                    if k as u32 >= layout.n_sentinels {
                        break;
                    }
                    (at..start).for_each(|i| push(&mut source, i, rng));
                    let sentinel = layout.sentinel(k as u32);
                    source.ids.push(sentinel);
                    target.push(sentinel);
                    target.extend(&codes[start..end]);
                    at = end;
                }
                (at..codes.len()).for_each(|i| push(&mut source, i, rng));
                source.ids.push(layout.eom());
            }
        }
        source.ids.extend(&prompt.after);
        source.ids.push(layout.end);
        target.push(layout.end);
        Ok(Example {
            source,
            target,
            task: item.task,
        })
    }
}

/// A standard normal number (Box-Muller).
fn normal(rng: &mut ChaCha8Rng) -> f32 {
    let (radius, angle_rad) = normal_polar_f32(1.0 - rng.random::<f32>(), rng.random::<f32>());
    radius * angle_rad.cos()
}

fn check_clip(vocab: &Vocab, code_dim: usize, clip: &LmClip) -> Result<(), LmError> {
    let fail = |problem: String| {
        let id = clip.id.clone();
        Err(InputError::Clip { id, problem }.into())
    };
    if clip.captions.is_empty() || clip.variants.is_empty() {
        return fail("needs a caption and a simulation at least".into());
    }
    if !(clip.seconds.is_finite() && clip.seconds >= 0.0) {
        return fail(format!("length of {} s", clip.seconds));
    }
    for encoded in clip.variants.iter().chain(&clip.flipped) {
        vocab.radar_ids(&encoded.codes)?;
        if encoded.codes.is_empty() || encoded.codes.len() > 1024 {
            return fail(format!("{} codes, expected 1..=1024", encoded.codes.len()));
        }
        if encoded.features.len() != encoded.codes.len() * code_dim {
            let (found, codes) = (encoded.features.len(), encoded.codes.len());
            return fail(format!(
                "{found} feature values for {codes} codes of width {code_dim}"
            ));
        }
        if encoded.features.iter().any(|v| !v.is_finite()) {
            return fail("a feature is not finite".into());
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Taken from the first release's code: trainings depend on them.
    #[test]
    fn feature_noise_never_changes() {
        let rng = &mut ChaCha8Rng::seed_from_u64(3);
        assert_eq!(
            [normal(rng), normal(rng)].map(f32::to_bits),
            [3199178398, 1067409848]
        );
    }
}
