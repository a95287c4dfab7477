//! Instructions in a user's own words.
//!
//! Instruction tuning asks for each task in the words of many templates. An instruction in other words asks for what the template
//! asks whose words are most alike, and the model gets that template: small models do not follow words that they were not tuned
//! on (docs/results/instructions.md). Only an instruction that places the radar codes itself reaches the model as it is. A
//! question whether somebody does something ("is she sitting down?") becomes a claim of what the lexicon reads in it.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::RangeInclusive;
use std::sync::LazyLock;

use radarllm_facts::{Facts, facts, words::number, write::Writer};

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
/// Words by which a question asks for what does not happen; `t` is what is left of "didn't". No training had such questions, and
/// the answer to the same one without them would be the opposite.
const NEGATIONS: &[&str] = &[
    "not", "t", "no", "nobody", "none", "noone", "never", "nothing", "neither", "nor", "without",
    "fail", "fails", "failed", "cannot", "hardly",
];
/// Phrases before a number, and what they ask of a count: how much is added to the number, and whether it is the smallest or the
/// largest one.
const BOUNDS: &[(&str, i32, bool)] = &[
    ("no fewer than", 0, true),
    ("no less than", 0, true),
    ("no more than", 0, false),
    ("at least", 0, true),
    ("at most", 0, false),
    ("more than", 1, true),
    ("over", 1, true),
    ("fewer than", -1, false),
    ("less than", -1, false),
    ("up to", 0, false),
];
/// Phrases after a number.
const BOUNDS_AFTER: &[(&str, bool)] = &[("or more", true), ("or fewer", false), ("or less", false)];
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
    counts: Option<RangeInclusive<u16>>,
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
        let (plain, counts) = without_bounds(text);
        let asked = words(&plain.replace("yes or no", " "));
        let mut negations = NEGATIONS.iter().filter(|word| asked.contains(**word));
        let is_question =
            text.contains('?') || has_any(&asked, &QUESTION_WORDS) || has_any(&asked, &AUXILIARIES);
        if n_radar == 0
            && is_question
            && let Some(word) = negations.next()
        {
            return refused(format!(
                "`{word}`: questions for what does not happen are not followed; ask whether it happens (\"did somebody fall?\")"
            ));
        }
        if n_radar == 0
            && let Some((claim, stated)) = claim_of(&plain)
        {
            let nearest = Question::Claim.prompts()[0];
            return Ok(Self {
                prompt: nearest.replace(CLAIM, &claim),
                task: Task::Question,
                question: Some(Question::Claim),
                claim: Some(stated),
                counts,
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
            counts: None,
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

    /// How often it must happen for the answer to be yes, if the question names a smallest or a largest number ("at least three
    /// squats?"). The claim has no number then.
    pub fn counts(&self) -> Option<&RangeInclusive<u16>> {
        self.counts.as_ref()
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
    let is_asked = has_any(&own, &AUXILIARIES) || has_any(&own, &["whether", "true"]);
    if has_any(&own, &QUESTION_WORDS) || !is_asked {
        return None;
    }
    let stated = facts(&lower);
    stated.actions().next()?;
    let claim = Writer::new().write_fully(&stated, 0)?.text;
    Some((claim, stated))
}

fn has_any(own: &BTreeSet<String>, list: &[&str]) -> bool {
    list.iter().any(|word| own.contains(*word))
}

/// A question without the smallest or largest number that it asks about, in lower case, and the numbers that are asked for; the
/// text as it is if it asks about none.
fn without_bounds(text: &str) -> (String, Option<RangeInclusive<u16>>) {
    let lower = text.trim().to_lowercase();
    let count = |word: &str| match word {
        "once" => Some(1),
        "twice" => Some(2),
        "thrice" => Some(3),
        word => word.parse().ok().or_else(|| number(word)),
    };
    let own: Vec<&str> = lower
        .split(|c: char| !c.is_alphanumeric() && c != '{' && c != '}')
        .filter(|word| !word.is_empty())
        .collect();
    let range = |n: i32, is_smallest: bool| {
        let n = n.clamp(0, i32::from(u16::MAX)) as u16;
        if is_smallest { n..=u16::MAX } else { 0..=n }
    };
    for at in 0..own.len() {
        let starts = |phrase: &str, at: usize| {
            let n = phrase.split(' ').count();
            (own.get(at..at + n)? == phrase.split(' ').collect::<Vec<&str>>()).then_some(n)
        };
        let before = BOUNDS.iter().find_map(|(phrase, more, is_smallest)| {
            let n = starts(phrase, at)?;
            let number = count(own.get(at + n)?)?;
            Some((at, n + 1, range(i32::from(number) + more, *is_smallest)))
        });
        let after = BOUNDS_AFTER.iter().find_map(|(phrase, is_smallest)| {
            let number = count(own[at])?;
            let n = 1 + usize::from(own.get(at + 1).is_some_and(|word| *word == "times"));
            let n = n + starts(phrase, at + n)?;
            Some((at, n, range(i32::from(number), *is_smallest)))
        });
        if let Some((start, n, range)) = before.or(after) {
            let times = usize::from(own.get(start + n).is_some_and(|word| *word == "times"));
            let rest = [&own[..start], &own[start + n + times..]].concat();
            return (rest.join(" "), Some(range));
        }
    }
    (text.to_string(), None)
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

    /// "Did nobody fall?" is not answered as "did somebody fall?".
    #[test]
    fn questions_for_what_does_not_happen_are_refused() {
        for text in [
            "Did nobody fall?",
            "Did no one fall?",
            "Was there no waving?",
            "Did he fail to wave?",
            "Didn't she fall?",
            "Did she walk without turning?",
            "Which hand does not move?",
        ] {
            let error = Instruction::parse(text).unwrap_err().to_string();
            assert!(error.contains("what does not happen"), "{text}: {error}");
        }
        Instruction::parse("yes or no: did she fall?").unwrap();
    }

    #[test]
    fn a_smallest_or_largest_number_is_asked_for() {
        for (text, claim, counts) in [
            (
                "Are there at least three squats?",
                "squat",
                Some(3..=u16::MAX),
            ),
            (
                "Did she squat more than twice?",
                "squat",
                Some(3..=u16::MAX),
            ),
            ("Did she squat fewer than five times?", "squat", Some(0..=4)),
            ("Did she wave no more than 2 times?", "wave", Some(0..=2)),
            (
                "Did she squat three times or more?",
                "squat",
                Some(3..=u16::MAX),
            ),
            (
                "Did she squat three or more times?",
                "squat",
                Some(3..=u16::MAX),
            ),
            ("Did she squat three times?", "squat x3", None),
        ] {
            let instruction = Instruction::parse(text).unwrap();
            assert_eq!(instruction.counts(), counts.as_ref(), "{text}");
            let asked = instruction.claim().unwrap().to_string();
            assert!(asked.ends_with(claim), "{text}: {asked}");
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
