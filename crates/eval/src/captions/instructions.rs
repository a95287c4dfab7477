//! Does a model answer questions about a motion that are asked in words that it was not tuned on?
//!
//! Every clip of a split is asked every kind of question, in wordings that a file lists. What the captions of the motion state
//! is the right answer; where they state none, the model should say so. Two other answers stand beside the model's: those that
//! follow from its sentence about the clip, and the most frequent right answer of all.

use std::collections::{BTreeMap, BTreeSet};

use radarllm_base::{Clip, random::SplitMix64};
use radarllm_dataset::{ClipRecord, Dataset, Split};
use radarllm_facts::{Facts, facts, score::is_same_action, tables::action_words};
use radarllm_inference::{
    Captioner, DescribeOptions, FRAME_RATE_HZ, LmError, PreparedClip,
    lm::{
        Instruction,
        captioner::NO_ANSWER,
        questions::{NOT_STATED, Question, YES, holds},
        templates::Task,
    },
};
use radarllm_metrics::bootstrap::units_of_ids;
use serde::{Deserialize, Serialize};

use super::{facts::same_actions, read, take_clip};
use crate::{Estimate, EvalError, captioner::caption_clips, table::Table};

/// Placeholder of an action in a wording of a question that is answered by yes or no.
const ACTION: &str = "{action}";
/// Answers to how long a motion lasts that differ by less from its length are right, s.
const LENGTH_TOLERANCE_S: f64 = 0.5;

/// Wordings of questions that no training had.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Wordings {
    /// Wordings by kind of question: the names of [`Question`], `describe` and `length`.
    pub ask: BTreeMap<String, Vec<String>>,
    /// What the tokens do not hold, to be refused.
    pub refuse: Vec<String>,
}

impl Wordings {
    /// Reads the file of wordings.
    ///
    /// # Errors
    /// Text that is not TOML of this shape, and kinds of questions that there are not.
    pub fn from_toml(text: &str) -> Result<Self, EvalError> {
        let wordings: Self = toml::from_str(text).map_err(|e| EvalError::Config(e.to_string()))?;
        let mut kinds = wordings.ask.keys();
        kinds.try_for_each(|name| Kind::named(name).map(|_| ()))?;
        Ok(wordings)
    }
}

/// Which clips are asked.
#[derive(Clone, Debug)]
pub struct InstructionOptions {
    /// Split whose clips are asked.
    pub split: Split,
    /// Number of motions, the first ones; all if 0.
    pub count: usize,
    /// Seed of claims and of the bootstrap.
    pub seed: u64,
}

/// Answers to one kind of question.
#[derive(Clone, Debug, Serialize)]
pub struct QuestionRow {
    /// Kind of question.
    pub question: String,
    /// Clips whose captions state an answer.
    pub stated: usize,
    /// Share of these that the model answers right, 0..=1.
    pub right: Option<Estimate>,
    /// The same of the answers that follow from the model's sentence.
    pub by_sentence: Option<Estimate>,
    /// The same of the most frequent right answer.
    pub most_frequent: Option<f64>,
    /// Clips whose captions state none.
    pub not_stated: usize,
    /// Of these, clips of which the model says so.
    pub said_so: usize,
}

/// One question about one clip.
#[derive(Clone, Debug, Serialize)]
pub struct AskedLine {
    /// Name of the clip.
    pub id: String,
    /// Kind of question.
    pub question: String,
    /// The words.
    pub asked: String,
    /// Answers that are right; none if the captions state none.
    pub expected: BTreeSet<String>,
    /// The model's answer.
    pub answer: String,
    /// The answer that follows from the model's sentence.
    pub by_sentence: String,
    /// Whether the answer is right; `None` if there is no right one.
    pub right: Option<bool>,
}

/// A model's answers.
#[derive(Clone, Debug, Serialize)]
pub struct InstructionReport {
    /// Name of the data set.
    pub data: String,
    /// Name of the split.
    pub split: String,
    /// Name of the model.
    pub model: String,
    /// Clips that were asked.
    pub clips: usize,
    /// By kind of question.
    pub rows: Vec<QuestionRow>,
    /// Questions that the tokens cannot answer, and how many of them were refused.
    pub refused: [usize; 2],
    /// Questions of `refuse` that were not refused.
    pub not_refused: Vec<String>,
}

/// What a question expects.
enum Expected {
    /// One of these texts.
    Texts(BTreeSet<String>),
    /// A sentence with the actions of one of these.
    Actions(Vec<String>),
    /// A length, s.
    Seconds(f64),
}

/// Asks every clip of a split every kind of question of `wordings`.
///
/// # Errors
/// A data set that cannot be read, wordings of an unknown kind or that are no instruction, a model that was not tuned.
pub fn evaluate_instructions(
    captioner: &Captioner,
    model: &str,
    data: &Dataset,
    wordings: &Wordings,
    options: &InstructionOptions,
) -> Result<(InstructionReport, Vec<AskedLine>), EvalError> {
    let kinds = wordings
        .ask
        .iter()
        .map(|(name, texts)| Ok((Kind::named(name)?, texts)));
    let kinds = kinds.collect::<Result<Vec<_>, EvalError>>()?;
    let mut records = read(data, options.split)?;
    if options.count > 0 {
        records.truncate(options.count);
    }
    if records.is_empty() {
        return Err(EvalError::Empty(format!(
            "{}: no clips in split `{}`",
            data.dir().display(),
            options.split
        )));
    }
    let clips: Vec<Clip> = records
        .iter_mut()
        .map(|record| take_clip(record, f64::from(FRAME_RATE_HZ)))
        .collect();
    let sentences = caption_clips(captioner, &clips.iter().collect::<Vec<_>>(), None)?;
    let describing = DescribeOptions::default();
    let mut dice = SplitMix64::new(options.seed);
    let mut lines = Vec::new();
    for (kind, texts) in &kinds {
        for (n, (record, clip)) in records.iter().zip(&clips).enumerate() {
            let Some(wording) = texts.get(n % texts.len().max(1)) else {
                continue;
            };
            let Some((asked, expected)) = kind.ask(wording, (record, clip), &records, &mut dice)
            else {
                continue;
            };
            let instruction = Instruction::parse(&asked).map_err(LmError::from)?;
            if !kind.is_of(&instruction) {
                return Err(EvalError::Config(format!(
                    "`{asked}` is understood as `{}`, not as a question of the kind {}",
                    instruction.nearest(),
                    kind.name()
                )));
            }
            let prepared = PreparedClip::of(clip).map_err(LmError::from)?;
            let answer = captioner.answer(&prepared, &instruction, &describing)?;
            let texts = answer.parts.into_iter().map(|part| part.text);
            let answer = texts.collect::<Vec<_>>().join("; ");
            let by_sentence = kind.by_sentence(&sentences[n].caption, &asked);
            lines.push(AskedLine {
                id: record.id.clone(),
                question: kind.name().into(),
                right: expected.is_right(&answer),
                expected: expected.texts(),
                asked,
                answer,
                by_sentence,
            });
        }
    }
    let rows = kinds
        .iter()
        .map(|(kind, _)| row(*kind, &lines, &records, options.seed));
    let refused = |text: &&String| Instruction::parse(text).is_err();
    let n_refused = wordings.refuse.iter().filter(refused).count();
    let open = wordings.refuse.iter().filter(|text| !refused(text));
    Ok((
        InstructionReport {
            data: data.manifest().name.clone(),
            split: options.split.to_string(),
            model: model.into(),
            clips: records.len(),
            rows: rows.collect(),
            refused: [n_refused, wordings.refuse.len()],
            not_refused: open.cloned().collect(),
        },
        lines,
    ))
}

/// A kind of question.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Describe,
    Length,
    Asks(Question),
}

impl Kind {
    fn named(name: &str) -> Result<Self, EvalError> {
        let all = Question::ALL.into_iter().map(Self::Asks);
        let mut all = all.chain([Self::Describe, Self::Length]);
        all.find(|kind| kind.name() == name)
            .ok_or_else(|| EvalError::Config(format!("`ask.{name}`: no such kind of question")))
    }

    fn name(self) -> &'static str {
        match self {
            Self::Describe => "describe",
            Self::Length => "length",
            Self::Asks(question) => question.name(),
        }
    }

    /// Whether an instruction asks this.
    fn is_of(self, instruction: &Instruction) -> bool {
        match self {
            Self::Describe => instruction.task() == Task::RadarToText,
            Self::Length => instruction.task() == Task::RadarToLength,
            Self::Asks(question) => instruction.question() == Some(question),
        }
    }

    /// The words of a question about a clip, and what is right; `None` for a claim that the captions do not decide.
    fn ask(
        self,
        wording: &str,
        (record, clip): (&ClipRecord, &Clip),
        others: &[ClipRecord],
        dice: &mut SplitMix64,
    ) -> Option<(String, Expected)> {
        let captions = || record.captions.iter().map(String::as_str);
        let texts = |question: Question| {
            let each = captions().filter_map(|caption| question.answer([caption]));
            each.collect::<BTreeSet<String>>()
        };
        let expected = match self {
            Self::Describe => Expected::Actions(record.captions.clone()),
            Self::Length => Expected::Seconds(clip.frames.len() as f64 / clip.frame_rate_hz),
            Self::Asks(question @ (Question::First | Question::Last)) => {
                Expected::Actions(texts(question).into_iter().collect())
            }
            Self::Asks(Question::Claim) => {
                let own: Vec<Facts> = captions().map(facts).collect();
                let claimed = claimed(&own, others, dice)?;
                let asked = wording.replace(ACTION, action_words(claimed)?.infinitive?);
                let is_true = holds(&facts(&asked), &own)?;
                let answer = if is_true { YES } else { NOT_STATED };
                return Some((asked, Expected::Texts([answer.to_string()].into())));
            }
            Self::Asks(question) => Expected::Texts(texts(question)),
        };
        Some((wording.into(), expected))
    }

    /// The answer to this question that a sentence gives.
    fn by_sentence(self, sentence: &str, asked: &str) -> String {
        match self {
            Self::Describe => sentence.into(),
            Self::Length => String::new(),
            Self::Asks(Question::Claim) => match holds(&facts(asked), &[facts(sentence)]) {
                Some(true) => YES.into(),
                _ => NOT_STATED.into(),
            },
            Self::Asks(question) => question.answer([sentence]).unwrap_or(NO_ANSWER.into()),
        }
    }
}

/// The name of an action that a claim is about: half of the time one of the motion, else one of another.
fn claimed(own: &[Facts], others: &[ClipRecord], dice: &mut SplitMix64) -> Option<&'static str> {
    let names = |facts: &[Facts]| -> Vec<&'static str> {
        let all = facts
            .iter()
            .flat_map(Facts::actions)
            .map(|action| action.name);
        all.filter(|name| action_words(name).is_some_and(|words| words.infinitive.is_some()))
            .collect()
    };
    let mut draw = |n: usize| dice.below(n);
    let own = names(own);
    if draw(2) == 0 {
        return own.get(draw(own.len())).copied();
    }
    for _ in 0..20 {
        let other = &others[draw(others.len())];
        let stated: Vec<Facts> = other.captions.iter().map(|text| facts(text)).collect();
        let names = names(&stated);
        let Some(name) = names.get(draw(names.len())) else {
            continue;
        };
        if !own.iter().any(|known| is_same_action(known, name)) {
            return Some(name);
        }
    }
    None
}

impl Expected {
    /// The right answers as texts.
    fn texts(&self) -> BTreeSet<String> {
        match self {
            Self::Texts(texts) => texts.clone(),
            Self::Actions(sentences) => sentences.iter().cloned().collect(),
            Self::Seconds(seconds) => [format!("{seconds:.1} seconds")].into(),
        }
    }

    /// Whether an answer is right; `None` if there is no right one.
    fn is_right(&self, answer: &str) -> Option<bool> {
        match self {
            Self::Texts(texts) if texts.is_empty() => None,
            Self::Actions(sentences) if sentences.is_empty() => None,
            Self::Texts(texts) => Some(texts.contains(answer)),
            Self::Actions(sentences) => Some(same_actions(answer, sentences) > 0.0),
            Self::Seconds(seconds) => {
                let stated = answer.split_whitespace().next().unwrap_or_default();
                let stated: Option<f64> = stated.parse().ok();
                Some(stated.is_some_and(|s| (s - seconds).abs() < LENGTH_TOLERANCE_S))
            }
        }
    }
}

/// The row of one kind of question.
fn row(kind: Kind, lines: &[AskedLine], records: &[ClipRecord], seed: u64) -> QuestionRow {
    let own: Vec<&AskedLine> = lines.iter().filter(|l| l.question == kind.name()).collect();
    let stated: Vec<&&AskedLine> = own.iter().filter(|l| l.right.is_some()).collect();
    let motions: BTreeMap<&str, &str> = records
        .iter()
        .map(|r| (r.id.as_str(), r.motion_id.as_str()))
        .collect();
    let units = units_of_ids(stated.iter().map(|l| motions[l.id.as_str()]));
    let estimate = |is_right: &dyn Fn(&AskedLine) -> bool| {
        let values: Vec<f64> = stated
            .iter()
            .map(|line| f64::from(u8::from(is_right(line))))
            .collect();
        Estimate::of_mean(&values, &units, seed)
    };
    let by_sentence = |line: &AskedLine| match kind {
        Kind::Asks(Question::First | Question::Last) | Kind::Describe => {
            let expected: Vec<String> = line.expected.iter().cloned().collect();
            same_actions(&line.by_sentence, &expected) > 0.0
        }
        _ => line.expected.contains(&line.by_sentence),
    };
    let mut counts: BTreeMap<&String, usize> = BTreeMap::new();
    for line in &stated {
        line.expected
            .iter()
            .for_each(|text| *counts.entry(text).or_default() += 1);
    }
    let is_word = matches!(kind, Kind::Asks(question) if !matches!(question, Question::First | Question::Last));
    let most_frequent = counts.values().max().filter(|_| is_word);
    let not_stated = own.iter().filter(|line| line.right.is_none());
    QuestionRow {
        question: kind.name().into(),
        stated: stated.len(),
        right: estimate(&|line| line.right == Some(true)),
        by_sentence: match kind {
            Kind::Length => None,
            _ => estimate(&by_sentence),
        },
        most_frequent: most_frequent.map(|n| *n as f64 / stated.len() as f64),
        not_stated: not_stated.clone().count(),
        said_so: not_stated.filter(|line| line.answer == NO_ANSWER).count(),
    }
}

/// The report as Markdown.
pub fn markdown(report: &InstructionReport) -> String {
    let mut table = Table::new(
        "Questions",
        "",
        &[
            "question",
            "clips whose captions answer it",
            "right, %",
            "by its sentence, %",
            "most frequent answer, %",
            "clips whose captions do not",
            "says so",
        ],
    );
    let percent = |e: Option<Estimate>| e.map_or("-".into(), |e| e.to_text(100.0, 1));
    for row in &report.rows {
        let share = row.most_frequent;
        table.rows.push(vec![
            row.question.clone(),
            row.stated.to_string(),
            percent(row.right),
            percent(row.by_sentence),
            share.map_or("-".into(), |share| format!("{:.1}", 100.0 * share)),
            row.not_stated.to_string(),
            row.said_so.to_string(),
        ]);
    }
    let [refused, asked] = report.refused;
    let mut text = format!(
        "# Questions about {} clips of {} ({}), model {}\n\n{}\nRefused, because the tokens do not hold it: {refused} of {asked}.\n",
        report.clips,
        report.data,
        report.split,
        report.model,
        table.to_markdown()
    );
    for asked in &report.not_refused {
        text += &format!("Not refused: {asked}\n");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use radarllm_inference::lm::templates::all_text;

    /// The wordings of `configs/eval/instructions.toml`.
    fn wordings() -> Wordings {
        let path = concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/../../configs/eval/instructions.toml"
        );
        Wordings::from_toml(&std::fs::read_to_string(path).unwrap()).unwrap()
    }

    #[test]
    fn held_out_wordings_are_in_no_template_and_understood() {
        let plain = |text: &str| -> String {
            let words = text.replace("{radar}", " ").to_lowercase();
            let words = words.split(|c: char| !c.is_alphanumeric() && c != '{' && c != '}');
            let words: Vec<&str> = words.filter(|word| !word.is_empty()).collect();
            words.join(" ")
        };
        let trained: BTreeSet<String> = all_text().map(plain).collect();
        let wordings = wordings();
        for (name, texts) in &wordings.ask {
            let kind = Kind::named(name).unwrap();
            assert!(!texts.is_empty(), "{name}");
            for text in texts {
                assert!(!trained.contains(&plain(text)), "{text}");
                let asked = text.replace(ACTION, "sit down");
                let instruction = Instruction::parse(&asked).unwrap();
                assert!(
                    kind.is_of(&instruction),
                    "{asked}: {}",
                    instruction.nearest()
                );
            }
        }
        for text in &wordings.refuse {
            assert!(Instruction::parse(text).is_err(), "{text}");
        }
    }

    #[test]
    fn right_answers_are_those_of_any_caption() {
        let texts = Expected::Texts(["left".to_string(), "both".to_string()].into());
        assert_eq!(texts.is_right("both"), Some(true));
        assert_eq!(texts.is_right("right"), Some(false));
        assert_eq!(Expected::Texts(BTreeSet::new()).is_right("left"), None);
        let actions = Expected::Actions(vec!["a person sits down".into()]);
        assert_eq!(actions.is_right("somebody takes a seat"), Some(true));
        assert_eq!(actions.is_right("a person stands up"), Some(false));
        assert_eq!(Expected::Seconds(4.8).is_right("5.2 seconds"), Some(true));
        assert_eq!(Expected::Seconds(4.8).is_right("5.6 seconds"), Some(false));
        assert_eq!(Expected::Seconds(4.8).is_right("long"), Some(false));
    }

    #[test]
    fn unknown_kinds_are_named() {
        let error = Wordings::from_toml("refuse = []\n[ask]\nplace = [\"where?\"]").unwrap_err();
        assert!(error.to_string().contains("ask.place"), "{error}");
    }
}
