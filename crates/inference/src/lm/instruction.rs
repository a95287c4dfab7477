//! Instructions in a user's own words.
//!
//! Instruction tuning asks for each task in the words of many templates. An instruction in other words asks for what the template
//! asks whose words are most alike, and the model gets that template: small models do not follow words that they were not tuned
//! on (docs/results/instructions.md). Only an instruction that places the radar codes itself reaches the model as it is. A
//! question whether somebody does something ("is she sitting down?") becomes a claim of what the lexicon reads in it.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::LazyLock;

use radarllm_facts::{Facts, facts, write::Writer};

use super::InputError;
use super::questions::{CLAIM, Question, question_of};
use super::templates::{Piece, Task, pieces};

/// Tasks whose prompts contain radar codes and that instruction tuning teaches.
const TASKS: [Task; 4] = [
    Task::RadarToText,
    Task::RadarToLength,
    Task::Continuation,
    Task::Question,
];
/// What a cue asks for.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Asked {
    Length,
    Fact(Question),
}

impl Asked {
    fn task(self) -> Task {
        match self {
            Self::Length => Task::RadarToLength,
            Self::Fact(_) => Task::Question,
        }
    }

    fn prompts(self) -> &'static [&'static str] {
        match self {
            Self::Length => Task::RadarToLength.prompts(),
            Self::Fact(question) => question.prompts(),
        }
    }
}

/// Words of questions that are not answered by yes or no.
const QUESTION_WORDS: [&str; 8] = [
    "what", "which", "how", "where", "when", "why", "who", "whose",
];
/// Words of questions that are answered by yes or no.
const AUXILIARIES: [&str; 8] = ["is", "are", "was", "were", "does", "do", "did", "has"];
/// Words that tell what a question asks, in the order in which they decide: "how long did the last one take" asks for a length.
/// An entry of several words stands for all of them together.
const CUES: [(Asked, &[&str]); 7] = [
    (
        Asked::Length,
        &[
            "how long",
            "long last",
            "duration",
            "length",
            "seconds",
            "how much time",
            "total time",
        ],
    ),
    (
        Asked::Fact(Question::Count),
        &[
            "how many",
            "how often",
            "number times",
            "once several",
            "repetitions",
            "repetition",
            "reps",
            "repeated",
            "count",
        ],
    ),
    (
        Asked::Fact(Question::Tempo),
        &[
            "fast", "slow", "slowly", "quick", "quickly", "speed", "pace", "tempo", "hurry",
            "rushing",
        ],
    ),
    (
        Asked::Fact(Question::Side),
        &[
            "which hand",
            "which arm",
            "which leg",
            "which foot",
            "which side",
            "which limb",
            "left hand",
            "right hand",
            "left arm",
            "right arm",
            "left leg",
            "right leg",
            "left right both",
            "one both",
            "hand left",
            "side body",
        ],
    ),
    (
        Asked::Fact(Question::Direction),
        &[
            "direction",
            "which way",
            "what way",
            "forward backward",
            "forwards backwards",
            "heading",
            "headed",
            "clockwise",
            "facing towards",
        ],
    ),
    (
        Asked::Fact(Question::First),
        &[
            "first",
            "begin",
            "began",
            "start",
            "started",
            "beginning",
            "initially",
            "initial",
            "before anything",
        ],
    ),
    (
        Asked::Fact(Question::Last),
        &[
            "last",
            "end",
            "ended",
            "finish",
            "finished",
            "final",
            "finally",
            "ending",
            "afterwards everything",
        ],
    ),
];
/// Words that every question may hold, whatever it asks.
const FUNCTION_WORDS: [&str; 27] = [
    "the", "a", "an", "of", "in", "is", "was", "were", "are", "did", "does", "do", "it", "this",
    "that", "person", "you", "me", "to", "she", "he", "they", "someone", "somebody", "be", "been",
    "will",
];
/// Words about what radar tokens do not hold: they are relative to the person, and see neither identity nor surface.
const NOT_HELD: &[&str] = &[
    "who",
    "whose",
    "age",
    "old",
    "young",
    "tall",
    "gender",
    "sex",
    "colour",
    "color",
    "wear",
    "wears",
    "wearing",
    "clothes",
    "shirt",
    "shoes",
    "glasses",
    "hair",
    "face",
    "heart",
    "breathing",
    "metres",
    "meters",
    "distance",
    "room",
    "kitchen",
    "bathroom",
    "bedroom",
    "house",
    "sad",
    "angry",
    "mood",
    "feel",
    "feeling",
    "thinking",
    "why",
    "yesterday",
    "tomorrow",
    "week",
    "weather",
    "recipe",
    "medicine",
    "tablets",
];
const RADAR: &str = "{radar}";
/// Minimum likeness to a template, as [`likeness`] measures it.
const MIN_ALIKE: f32 = 0.25;
/// Maximum length, bytes. Templates have at most twelve words.
const MAX_BYTES: usize = 500;

/// An instruction about a radar recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Instruction {
    prompt: String,
    task: Task,
    question: Option<Question>,
    claim: Option<Facts>,
    nearest: &'static str,
    likeness: f32,
}

impl Instruction {
    /// Reads an instruction. The radar codes take the place of `{radar}`; without it, the words are those of the most similar
    /// template.
    ///
    /// # Errors
    /// If the text has no words, is very long, has other placeholders, or is like no template.
    pub fn parse(text: &str) -> Result<Self, InputError> {
        let refused = |problem: String| Err(InputError::Instruction { problem });
        if text.len() > MAX_BYTES {
            return refused(format!("{} bytes, at most {MAX_BYTES}", text.len()));
        }
        let (mut n_radar, mut others) = (0, Vec::new());
        for piece in pieces(text) {
            match piece {
                Piece::Placeholder(RADAR) => n_radar += 1,
                Piece::Placeholder(other) => others.push(other),
                Piece::Words(words) if words.contains(['{', '}']) => others.push(words),
                Piece::Words(_) => {}
            }
        }
        if let Some(other) = others.first() {
            return refused(format!("`{other}`: the only placeholder is {RADAR}"));
        }
        if n_radar > 1 {
            return refused(format!("{RADAR} occurs {n_radar} times, at most once"));
        }
        let own = words(text);
        if own.is_empty() {
            return refused("it has no words".into());
        }
        // "Name the motion" asks for something else than "what is her name".
        let asks_name = own.contains("name") && !text.trim().to_lowercase().starts_with("name");
        let mut not_held = NOT_HELD.iter().filter(|word| own.contains(**word));
        if let Some(word) = not_held.next().or(asks_name.then_some(&"name")) {
            return refused(format!(
                "`{word}`: radar tokens hold how a person moves, not who it is or where in the room; ask what the person does, \
                 which way, with which side, how often, how fast, how long or in which order"
            ));
        }
        if n_radar == 0
            && let Some((claim, stated)) = claim_of(text)
        {
            let nearest = Question::Claim.prompts()[0];
            return Ok(Self {
                prompt: nearest.replace(CLAIM, &claim),
                task: Task::Question,
                question: Some(Question::Claim),
                claim: Some(stated),
                nearest,
                likeness: likeness(&own, &words(&claim)),
            });
        }
        let templates = TASKS
            .into_iter()
            .flat_map(|task| task.prompts().iter().map(move |prompt| (task, *prompt)))
            .filter(|(_, prompt)| !prompt.contains(CLAIM));
        let rated = templates.map(|(task, prompt)| (likeness(&own, &words(prompt)), task, prompt));
        // Of equally likely ones the first is taken.
        let best = rated.reduce(|best, next| if next.0 > best.0 { next } else { best });
        // The words of a template ask for what it asks.
        let cue = cue_of(&own).filter(|_| best.is_none_or(|best| best.0 < 1.0));
        let best = match cue {
            Some(cue) => {
                let prompts = cue.prompts().iter();
                let rated =
                    prompts.map(|prompt| (likeness(&own, &words(prompt)), cue.task(), *prompt));
                rated.reduce(|best, next| if next.0 > best.0 { next } else { best })
            }
            None => best.filter(|best| best.0 >= MIN_ALIKE),
        };
        let Some((likeness, task, nearest)) = best else {
            return refused(format!(
                "`{text}` is like none of the instructions for describing, timing, continuing or asking about a motion, for \
                 example `{}`",
                Task::RadarToText.prompts()[17]
            ));
        };
        let prompt = match n_radar {
            0 => nearest.to_string(),
            _ => text.trim().to_string(),
        };
        Ok(Self {
            prompt,
            task,
            question: question_of(nearest).filter(|_| task == Task::Question),
            claim: None,
            nearest,
            likeness,
        })
    }

    /// The prompt, with `{radar}` in the place of the radar codes.
    pub fn prompt(&self) -> &str {
        &self.prompt
    }

    /// Task that is asked for.
    pub fn task(&self) -> Task {
        self.task
    }

    /// Question that is asked, if it is one about a single fact.
    pub fn question(&self) -> Option<Question> {
        self.question
    }

    /// What is claimed, if the question is whether something is so.
    pub fn claim(&self) -> Option<&Facts> {
        self.claim.as_ref()
    }

    /// The most similar template.
    pub fn nearest(&self) -> &'static str {
        self.nearest
    }

    /// Likeness to the most similar template, 0..=1; 1 for the same words.
    pub fn likeness(&self) -> f32 {
        self.likeness
    }

    /// Whether these are the words of pretraining.
    pub(super) fn is_of_pretraining(&self) -> bool {
        self.task.prompts()[0] == self.nearest && self.likeness == 1.0
    }
}

/// The claim of a question that is answered by yes or no, as a sentence and as facts: "did she fall?" asks whether "a person
/// falls".
fn claim_of(text: &str) -> Option<(String, Facts)> {
    let lower = text.trim().to_lowercase().replace("yes or no", " ");
    // "Is it slow or fast?" asks which.
    if lower.contains(" or ") {
        return None;
    }
    let own = words(&lower);
    let has = |list: &[&str]| list.iter().any(|word| own.contains(*word));
    if has(&QUESTION_WORDS) || !(has(&AUXILIARIES) || has(&["whether", "true"])) {
        return None;
    }
    let stated = facts(&lower);
    stated.actions().next()?;
    let claim = Writer::new().write_fully(&stated, 0)?.text;
    Some((claim, stated))
}

/// What the words of an instruction tell that it asks for.
fn cue_of(own: &BTreeSet<String>) -> Option<Asked> {
    let holds = |cue: &&str| cue.split(' ').all(|word| own.contains(word));
    let found = CUES.iter().find(|(_, cues)| cues.iter().any(holds));
    found.map(|(asked, _)| *asked)
}

fn words(text: &str) -> BTreeSet<String> {
    let text = text.replace(RADAR, " ").replace(CLAIM, " ").to_lowercase();
    let words = text.split(|c: char| !c.is_alphanumeric());
    words.filter(|w| !w.is_empty()).map(String::from).collect()
}

/// Common words in relation to the mean of all different words (Dice's coefficient), where words that say little weigh little:
/// those of many templates and [`FUNCTION_WORDS`].
fn likeness(a: &BTreeSet<String>, b: &BTreeSet<String>) -> f32 {
    let weight = |word: &String| {
        let n_prompts = n_prompts().get(word).copied().unwrap_or(1);
        match FUNCTION_WORDS.contains(&word.as_str()) {
            true => 0.1,
            false => 1.0 / (n_prompts as f32).sqrt(),
        }
    };
    let sum = |words: &BTreeSet<String>| words.iter().map(weight).sum::<f32>();
    let common: f32 = a.intersection(b).map(weight).sum();
    2.0 * common / (sum(a) + sum(b)).max(f32::MIN_POSITIVE)
}

/// In how many templates each word occurs.
fn n_prompts() -> &'static BTreeMap<String, usize> {
    static COUNTS: LazyLock<BTreeMap<String, usize>> = LazyLock::new(|| {
        let mut counts = BTreeMap::new();
        for prompt in TASKS.iter().flat_map(|task| task.prompts()) {
            for word in words(prompt) {
                *counts.entry(word).or_default() += 1;
            }
        }
        counts
    });
    &COUNTS
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn instructions_get_the_task_that_they_ask_for() {
        for (text, task) in [
            ("Which way does she go?", Task::Question),
            ("With which hand?", Task::Question),
            ("How many times did he do it?", Task::Question),
            ("How fast is the person?", Task::Question),
            ("What did she do first?", Task::Question),
            ("What is she doing?", Task::RadarToText),
            ("Describe the movement, please", Task::RadarToText),
            ("How long does the recording last?", Task::RadarToLength),
            ("How many seconds is it?", Task::RadarToLength),
            ("what happens next?", Task::Continuation),
            ("Continue the motion", Task::Continuation),
        ] {
            let instruction = Instruction::parse(text).unwrap();
            assert_eq!(
                instruction.task(),
                task,
                "{text}: {}",
                instruction.nearest()
            );
            assert_eq!(instruction.prompt(), instruction.nearest());
            let own = Instruction::parse(&format!("{text} {{radar}}")).unwrap();
            assert_eq!(own.prompt(), format!("{text} {{radar}}"));
        }
    }

    #[test]
    fn yes_or_no_asks_for_a_claim() {
        for (text, claim) in [
            ("Did she fall?", "fall"),
            ("Is somebody sitting down?", "sit_down"),
            ("does the person wave with the left hand", "wave hand left"),
            ("Are they walking backwards?", "walk backward"),
        ] {
            let instruction = Instruction::parse(text).unwrap();
            assert_eq!(instruction.question(), Some(Question::Claim), "{text}");
            let asked = facts(instruction.prompt()).to_string();
            assert!(asked.ends_with(claim), "{text}: {asked}");
        }
        for text in ["Is it slow or fast?", "Is it the left or the right side?"] {
            let instruction = Instruction::parse(text).unwrap();
            assert_eq!(instruction.task(), Task::Question, "{text}");
            assert_ne!(instruction.question(), Some(Question::Claim), "{text}");
        }
    }

    #[test]
    fn what_tokens_do_not_hold_is_refused() {
        for text in [
            "Who is it?",
            "What is the person wearing?",
            "Where in the room does the person stand?",
            "How old is the person?",
            "Was macht die Person?",
            "\u{4eba}\u{5728}\u{505a}\u{4ec0}\u{4e48}",
        ] {
            assert!(Instruction::parse(text).is_err(), "{text}");
        }
    }

    #[test]
    fn every_template_is_its_own_nearest() {
        for task in TASKS {
            for prompt in task.prompts().iter().filter(|p| !p.contains(CLAIM)) {
                let instruction = Instruction::parse(prompt).unwrap();
                assert_eq!(instruction.likeness(), 1.0, "{prompt}");
                assert_eq!(instruction.prompt(), *prompt);
                assert_eq!(instruction.task(), task, "{prompt}");
            }
            assert!(
                Instruction::parse(task.prompts()[0])
                    .unwrap()
                    .is_of_pretraining()
            );
            assert!(
                !Instruction::parse(task.prompts()[1])
                    .unwrap()
                    .is_of_pretraining()
            );
        }
    }

    #[test]
    fn other_texts_are_refused_with_their_reason() {
        let long = "word ".repeat(200);
        for (text, reason) in [
            ("", "no words"),
            (" ?! {radar}", "no words"),
            ("colorless green ideas", "is like none"),
            ("describe {caption}", "{caption}"),
            ("describe {radar} and {radar}", "2 times"),
            ("describe { this", "{ this"),
            (long.as_str(), "at most 500"),
        ] {
            let error = Instruction::parse(text).unwrap_err().to_string();
            assert!(error.contains(reason), "{text:?}: {error}");
        }
    }
}
