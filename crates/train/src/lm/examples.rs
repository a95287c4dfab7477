//! Builds token sequences from clips and tasks.

use rand::rngs::ChaCha8Rng;
use rand::seq::{IndexedRandom, SliceRandom};
use rand::{RngExt, SeedableRng};

use radarllm_base::random::normal_polar_f32;
use radarllm_facts::{Facts, facts, parse, swap_sides, write::Writer};
use radarllm_inference::lm::questions::{self, CLAIM, NOT_STATED, Question, YES};
use radarllm_inference::lm::templates::{Piece, Task, pieces};
use radarllm_inference::lm::{InputError, LmError, Source, Vocab};
use radarllm_inference::tokenizer::Encoded;

use super::clip::LmClip;
use super::config::LmTrainConfig;
use super::corrupt::choose_spans;

/// Kind of stage. Pretraining uses the first prompt of a task, instruction tuning uses any.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LmStageKind {
    /// Radar prediction, radar to text, text to radar, and text prediction if there are sentences.
    Pretrain,
    /// Prompt templates and sub-tasks.
    Instruct,
}

impl LmStageKind {
    /// Tasks of the stage.
    pub fn tasks(self) -> &'static [Task] {
        match self {
            Self::Pretrain => &Task::PRETRAINING,
            Self::Instruct => &Task::INSTRUCTION,
        }
    }
}

/// Definition of one training example. It can be packed into a number, by which the training loop refers to items.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Item {
    /// Index of the clip, or of the sentence in [`Task::TextPrediction`].
    pub clip: usize,
    /// The task.
    pub task: Task,
    /// Index of the simulation.
    pub variant: usize,
    /// Whether the clip is mirrored.
    pub flipped: bool,
    /// Index of the caption.
    pub caption: usize,
    /// Index of the prompt.
    pub prompt: usize,
}

const TASKS: [Task; 8] = [
    Task::RadarToText,
    Task::TextToRadar,
    Task::TextToLength,
    Task::RadarToLength,
    Task::Continuation,
    Task::RadarPrediction,
    Task::TextPrediction,
    Task::Question,
];

/// Maximum number of variants or captions of a clip that are used: they must fit their bits of an item number.
const MAX: usize = 256;

impl Item {
    /// Packs the item into a number.
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

    /// Unpacks an item from its number.
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
    /// Prompt: the input of the encoder, or the first tokens of a decoder-only model.
    pub source: Source,
    /// Target, including the end token.
    pub target: Vec<u32>,
    /// Task of the example.
    pub task: Task,
}

/// Token ids of a prompt before and after its placeholder, which is that of the radar in a prompt with two.
struct Prompt {
    before: Vec<u32>,
    after: Vec<u32>,
    /// Where a claim stands in `before` or, with the first number 1, in `after`.
    claim: Option<(usize, usize)>,
    question: Option<Question>,
}

/// What is known of a clip, to answer questions.
struct Known {
    /// What each caption states.
    facts: Vec<Facts>,
    /// Ids of the answer to each question of [`Question::ALL`]; `None` if no caption states one.
    answers: Vec<Option<Vec<u32>>>,
    /// Sentences about the whole clip and about a part of it, with what they state.
    claims: Vec<(Vec<u32>, Facts)>,
}

impl Known {
    fn new(vocab: &Vocab, captions: &[String]) -> Result<Self, LmError> {
        let answer = |question: Question| {
            let answer = question.answer(captions.iter().map(String::as_str));
            answer.map(|text| vocab.text_ids(&text)).transpose()
        };
        let answers = Question::ALL.into_iter().map(answer);
        let mut claims = Vec::new();
        for caption in captions {
            let clauses = parse(caption);
            let parts = clauses.iter().filter(|_| clauses.len() > 1);
            let parts = parts.map(|clause| clause.sentence());
            for text in parts.chain([caption.clone()]) {
                let stated = facts(&text);
                if stated.actions().next().is_some() {
                    claims.push((vocab.text_ids(&text)?, stated));
                }
            }
        }
        Ok(Self {
            facts: captions.iter().map(|caption| facts(caption)).collect(),
            answers: answers.collect::<Result<_, _>>()?,
            claims,
        })
    }
}

/// Clips with everything that does not change between epochs precomputed.
pub struct ExampleMaker {
    clips: Vec<LmClip>,
    /// Per clip and caption: ids of the caption and of its mirror image.
    captions: Vec<Vec<[Vec<u32>; 2]>>,
    /// Per clip: ids of "{seconds} seconds".
    lengths: Vec<Vec<u32>>,
    /// Per entry of [`TASKS`].
    prompts: Vec<Vec<Prompt>>,
    kind: LmStageKind,
    /// Ids of sentences without motions.
    sentences: Vec<Vec<u32>>,
    /// Per clip and caption: its facts and those of its mirror image; empty if captions are used as they are.
    facts: Vec<Vec<[Facts; 2]>>,
    writer: Writer,
    /// Per clip: what is known of it and of its mirror image; empty without the task of questions.
    known: Vec<[Known; 2]>,
    /// Ids of [`YES`] and of [`NOT_STATED`].
    yes_no: [Vec<u32>; 2],
}

fn seconds_text(seconds: f32) -> String {
    format!("{seconds:.1} seconds")
}

impl ExampleMaker {
    /// Checks clips and encodes their captions.
    ///
    /// # Errors
    /// If a clip has no caption or no codes, if codes and features do not fit the model, or if a text is rejected.
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
            let of_clip = clip.captions.iter().take(MAX).map(both);
            captions.push(of_clip.collect::<Result<Vec<_>, LmError>>()?);
            lengths.push(ids(&seconds_text(clip.seconds))?);
        }
        let mut prompts = Vec::new();
        for task in TASKS {
            let mut of_task = Vec::new();
            for prompt in task.prompts() {
                let (mut before, mut after, mut seen) = (Vec::new(), Vec::new(), false);
                let mut claim = None;
                for piece in pieces(prompt) {
                    match piece {
                        Piece::Placeholder(CLAIM) => {
                            let side: &Vec<u32> = if seen { &after } else { &before };
                            claim = Some((usize::from(seen), side.len()));
                        }
                        Piece::Placeholder(_) => seen = true,
                        Piece::Words(words) => {
                            let side = if seen { &mut after } else { &mut before };
                            side.extend(vocab.text_ids(words)?);
                        }
                    }
                }
                of_task.push(Prompt {
                    before,
                    after,
                    claim,
                    question: questions::question_of(prompt),
                });
            }
            prompts.push(of_task);
        }
        Ok(Self {
            clips: clips.to_vec(),
            captions,
            lengths,
            prompts,
            kind,
            sentences: Vec::new(),
            facts: Vec::new(),
            writer: Writer::new(),
            known: Vec::new(),
            yes_no: [vocab.text_ids(YES)?, vocab.text_ids(NOT_STATED)?],
        })
    }

    /// Reads what the captions answer, for [`Task::Question`].
    ///
    /// # Errors
    /// If an answer cannot be encoded.
    pub fn read_answers(&mut self, vocab: &Vocab) -> Result<(), LmError> {
        let both = |clip: &LmClip| {
            let captions: Vec<String> = clip.captions.iter().take(MAX).cloned().collect();
            let mirrored: Vec<String> = captions.iter().map(|text| swap_sides(text)).collect();
            Ok([Known::new(vocab, &captions)?, Known::new(vocab, &mirrored)?])
        };
        self.known = self
            .clips
            .iter()
            .map(both)
            .collect::<Result<_, LmError>>()?;
        Ok(())
    }

    /// The prompt of a question, preferably of one that the captions answer.
    fn draw_question(&self, clip: usize, flip: usize, rng: &mut ChaCha8Rng) -> usize {
        /// Draws at the most. Few captions state a count or a speed, and the answer would nearly always be that it is not
        /// stated.
        const DRAWS: usize = 3;
        let prompts = self.prompts_of(Task::Question);
        let mut drawn = 0;
        for _ in 0..DRAWS {
            drawn = rng.random_range(0..prompts.len());
            let asked = prompts[drawn].question.unwrap_or(Question::Claim);
            let is_answered = self.known[clip][flip].answers[asked as usize].is_some();
            if is_answered || asked == Question::Claim {
                break;
            }
        }
        drawn
    }

    /// A claim and whether it holds of a clip: one of its own, or another clip's that the captions refute. `None` if none was
    /// found.
    fn claim(&self, item: &Item, rng: &mut ChaCha8Rng) -> Option<(&[u32], bool)> {
        /// Clips that are asked for a claim that does not hold.
        const ATTEMPTS: usize = 20;
        let flip = usize::from(item.flipped);
        let own = &self.known[item.clip][flip];
        if rng.random::<bool>() {
            let (ids, _) = own.claims.choose(rng)?;
            return Some((ids, true));
        }
        // Half of the wrong claims are those of the mirror image, if the side decides.
        let mirrored = &self.known[item.clip][1 - flip].claims;
        let from_mirror = rng.random::<bool>();
        for attempt in 0..ATTEMPTS {
            let claims = match from_mirror && attempt < 4 {
                true => mirrored,
                false => &self.known[rng.random_range(0..self.known.len())][flip].claims,
            };
            let Some((ids, facts)) = claims.choose(rng) else {
                continue;
            };
            if questions::holds(facts, &own.facts) == Some(false) {
                return Some((ids, false));
            }
        }
        None
    }

    /// Adds sentences without motions, for text prediction.
    ///
    /// # Errors
    /// If a sentence cannot be encoded.
    pub fn add_sentences(&mut self, vocab: &Vocab, sentences: &[String]) -> Result<(), LmError> {
        for sentence in sentences {
            self.sentences.push(vocab.text_ids(sentence)?);
        }
        Ok(())
    }

    /// Reads the facts of all captions, so that [`Self::example`] can write others.
    pub fn read_facts(&mut self) {
        let both = |text: &String| [facts(text), facts(&swap_sides(text))];
        let of_clip = |clip: &LmClip| clip.captions.iter().take(MAX).map(both).collect();
        self.facts = self.clips.iter().map(of_clip).collect();
    }

    /// A sentence that is written from the facts of an item's caption, as often as the settings say. `None` for the
    /// caption itself.
    fn rewritten(
        &self,
        vocab: &Vocab,
        config: &LmTrainConfig,
        item: &Item,
        rng: &mut ChaCha8Rng,
    ) -> Result<Option<Vec<u32>>, LmError> {
        let has_caption = matches!(
            item.task,
            Task::RadarToText | Task::TextToRadar | Task::TextToLength
        );
        if !has_caption
            || config.rewrite_captions == 0.0
            || !rng.random_bool(config.rewrite_captions)
        {
            return Ok(None);
        }
        let seed = rng.random();
        let facts = self
            .facts
            .get(item.clip)
            .and_then(|of| of.get(item.caption));
        let facts = facts.map(|both| &both[usize::from(item.flipped)]);
        let written = facts.and_then(|facts| write_anew(&self.writer, facts, seed));
        written.map(|text| vocab.text_ids(&text)).transpose()
    }

    /// Keeps the first `n` captions of every clip, and at least one.
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

    /// Draws the items of an epoch. Their number depends on clips and settings only.
    pub fn draw_epoch(&self, config: &LmTrainConfig, seed: u64) -> Vec<Item> {
        let rng = &mut ChaCha8Rng::seed_from_u64(seed);
        let tasks = self.kind.tasks();
        let share = |task: &Task| match task {
            Task::TextPrediction if self.sentences.is_empty() => 0.0,
            task => config.sampling.of(*task),
        };
        let share = |task: &Task| match task {
            Task::Question if self.known.is_empty() => 0.0,
            task => share(task),
        };
        let shares: Vec<f64> = tasks.iter().map(share).collect();
        let total: f64 = shares.iter().sum();
        let mut items = Vec::new();
        for (i, clip) in self.clips.iter().enumerate() {
            let n_captions = self.captions[i].len();
            let n = if config.samples_per_clip == 0 {
                n_captions
            } else {
                config.samples_per_clip
            };
            // With fewer samples than captions, the chosen captions differ between epochs.
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
                if task == Task::TextPrediction {
                    items.push(Item {
                        clip: rng.random_range(0..self.sentences.len()),
                        task,
                        variant: 0,
                        flipped: false,
                        caption: 0,
                        prompt: 0,
                    });
                    continue;
                }
                let flipped = config.flip && !clip.flipped.is_empty() && rng.random::<bool>();
                let pool = if flipped {
                    &clip.flipped
                } else {
                    &clip.variants
                };
                let variant = rng.random_range(0..pool.len().min(MAX));
                // A single code can be neither masked nor continued.
                if pool[variant].codes.len() < 2
                    && matches!(task, Task::RadarPrediction | Task::Continuation)
                {
                    task = Task::RadarToText;
                }
                let prompt = match self.kind {
                    LmStageKind::Pretrain => 0,
                    LmStageKind::Instruct if task == Task::Question => {
                        self.draw_question(i, usize::from(flipped), rng)
                    }
                    LmStageKind::Instruct
                        if config.first_prompt > 0.0 && rng.random_bool(config.first_prompt) =>
                    {
                        0
                    }
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
        /// Number of batches that are sorted together. A larger number pads less, a smaller number shuffles better.
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
        // A sentence has no clip.
        if item.task == Task::TextPrediction {
            let words = self.sentences[item.clip].len();
            return (words / 2, words);
        }
        let codes = self.encoded(item).codes.len();
        let text = self.captions[item.clip][item.caption][0].len();
        let prompt = &self.prompts_of(item.task)[item.prompt];
        let words = prompt.before.len() + prompt.after.len();
        match item.task {
            Task::RadarToText | Task::TextPrediction => (text, words + codes),
            Task::TextToRadar => (codes, words + text),
            Task::TextToLength => (4, words + text),
            Task::RadarToLength | Task::Question => (4, words + codes),
            Task::Continuation => (codes / 2, words + codes / 2),
            Task::RadarPrediction => (codes / 4, words + codes),
        }
    }

    /// An example of text prediction: a sentence with masked spans, and the spans.
    fn sentence_example(
        &self,
        vocab: &Vocab,
        config: &LmTrainConfig,
        sentence: usize,
        rng: &mut ChaCha8Rng,
    ) -> Example {
        let layout = vocab.layout();
        let prompt = &self.prompts_of(Task::TextPrediction)[0];
        let ids = &self.sentences[sentence];
        let share = rng.random_range(config.mask_share..1.0);
        let spans = choose_spans(rng, ids.len(), share, config.mask_span);
        let (mut source, mut target) = (Source::default(), Vec::new());
        source.ids.extend(&prompt.before);
        let mut at = 0;
        for ((start, end), k) in spans.into_iter().zip(0..layout.n_sentinels) {
            let sentinel = layout.sentinel(k);
            source.ids.extend(&ids[at..start]);
            source.ids.push(sentinel);
            target.push(sentinel);
            target.extend(&ids[start..end]);
            at = end;
        }
        source.ids.extend(&ids[at..]);
        source.ids.extend(&prompt.after);
        source.ids.push(layout.end);
        target.push(layout.end);
        Example {
            source,
            target,
            task: Task::TextPrediction,
        }
    }

    /// Builds an example. Codes are augmented as the settings define.
    ///
    /// # Errors
    /// If a code is outside the codebook, or the context is missing.
    pub fn example(
        &self,
        vocab: &Vocab,
        config: &LmTrainConfig,
        item: &Item,
        rng: &mut ChaCha8Rng,
    ) -> Result<Example, LmError> {
        if item.task == Task::TextPrediction {
            return Ok(self.sentence_example(vocab, config, item.clip, rng));
        }
        let layout = vocab.layout();
        let encoded = self.encoded(item);
        let codes = vocab.radar_ids(&encoded.codes)?;
        let dim = encoded.features.len() / codes.len().max(1);
        let prompt = &self.prompts_of(item.task)[item.prompt];
        let written = self.rewritten(vocab, config, item, rng)?;
        let caption = written
            .as_ref()
            .unwrap_or(&self.captions[item.clip][item.caption][usize::from(item.flipped)]);
        let mut source = Source::default();
        let mut target = Vec::new();
        // A clip without a claim is asked whether it shows nothing that can be said.
        let claim = prompt.claim.and_then(|_| self.claim(item, rng));
        let words = |side: usize, ids: &[u32]| -> Vec<u32> {
            match (prompt.claim, claim) {
                (Some((own, at)), Some((claim, _))) if own == side => {
                    [&ids[..at], claim, &ids[at..]].concat()
                }
                _ => ids.to_vec(),
            }
        };
        source.ids.extend(words(0, &prompt.before));
        // Adds one code with its feature, possibly augmented.
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
        let context = vocab.context_ids(encoded)?;
        let end_radar = |source: &mut Source, rng: &mut ChaCha8Rng| {
            source.ids.push(layout.eom());
            for &id in &context {
                if config.drop_code == 0.0 || !rng.random_bool(config.drop_code) {
                    source.ids.push(id);
                }
            }
        };
        match item.task {
            Task::RadarToText | Task::RadarToLength => {
                source.ids.push(layout.som());
                (0..codes.len()).for_each(|i| push(&mut source, i, rng));
                end_radar(&mut source, rng);
                let answer = if item.task == Task::RadarToText {
                    caption
                } else {
                    &self.lengths[item.clip]
                };
                target.extend(answer);
            }
            Task::Question => {
                source.ids.push(layout.som());
                (0..codes.len()).for_each(|i| push(&mut source, i, rng));
                end_radar(&mut source, rng);
                let answers = &self.known[item.clip][usize::from(item.flipped)].answers;
                let asked = prompt.question.unwrap_or(Question::Claim) as usize;
                let answer = match claim {
                    Some((_, true)) => Some(&self.yes_no[0]),
                    _ => answers[asked].as_ref(),
                };
                target.extend(answer.unwrap_or(&self.yes_no[1]));
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
                end_radar(&mut source, rng);
                target.extend(&codes[cut..]);
            }
            Task::RadarPrediction => {
                let spans = choose_spans(rng, codes.len(), config.mask_share, config.mask_span);
                source.ids.push(layout.som());
                let mut at = 0;
                for (k, (start, end)) in spans.into_iter().enumerate() {
                    // More spans than sentinels would require much longer clips than the tokenizer produces. The
                    // remaining spans then remain visible.
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
                end_radar(&mut source, rng);
            }
            // Has no clip and is made above.
            Task::TextPrediction => {}
        }
        source.ids.extend(words(1, &prompt.after));
        source.ids.push(layout.end);
        target.push(layout.end);
        Ok(Example {
            source,
            target,
            task: item.task,
        })
    }
}

/// A sentence about facts; `None` if they hold no action or no wording is known.
fn write_anew(writer: &Writer, facts: &Facts, seed: u64) -> Option<String> {
    facts.actions().next()?;
    writer.write(facts, seed).map(|written| written.text)
}

/// Sentences that are written from the facts of captions, for their words: `n` of each.
pub fn samples_of_writing<'a>(
    captions: impl Iterator<Item = &'a str>,
    n: u64,
) -> impl Iterator<Item = String> {
    let writer = Writer::new();
    captions.flat_map(move |caption| {
        let facts = facts(caption);
        let written: Vec<String> = (0..n)
            .filter_map(|seed| write_anew(&writer, &facts, seed))
            .collect();
        written
    })
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
        vocab.context_ids(encoded)?;
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

    /// Reference values from the code of the first release: training results depend on them.
    #[test]
    fn feature_noise_never_changes() {
        let rng = &mut ChaCha8Rng::seed_from_u64(3);
        assert_eq!(
            [normal(rng), normal(rng)].map(f32::to_bits),
            [3199178398, 1067409848]
        );
    }
}
