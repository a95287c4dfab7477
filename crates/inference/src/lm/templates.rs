//! Prompts of the language model, worded by this project.
//!
//! A template is a prompt and an answer with the placeholders `{radar}` (codes between `/som` and `/eom` in a prompt),
//! `{caption}`, `{seconds}`, for continuation `{rest}`, and for questions `{claim}` and `{answer}`. Prompts are short, because every word takes time in the
//! encoder. Captions are not quoted, because the model would learn to generate the quotation marks.

use serde::{Deserialize, Serialize};

use super::questions;

/// The sub-tasks of pretraining and instruction tuning.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Task {
    /// Describe a motion: the main task.
    RadarToText,
    /// Produce the radar codes of a described motion.
    TextToRadar,
    /// Estimate the duration of a described motion.
    TextToLength,
    /// State the duration of a radar recording.
    RadarToLength,
    /// Continue a motion.
    Continuation,
    /// Answer a question about a motion ([`super::questions`]).
    Question,
    /// Restore masked spans of codes (pretraining only).
    RadarPrediction,
    /// Restore masked spans of a sentence (pretraining only, with sentences that have no motion).
    TextPrediction,
}

/// The prompt of evaluation and `describe`. It is the first of the prompts for [`Task::RadarToText`] and the one that
/// pretraining uses, so that the model sees it in every stage of training.
pub const EVALUATION_PROMPT: &str = "describe {radar}";

impl Task {
    /// Tasks of instruction tuning.
    pub const INSTRUCTION: [Task; 6] = [
        Task::RadarToText,
        Task::TextToRadar,
        Task::TextToLength,
        Task::RadarToLength,
        Task::Continuation,
        Task::Question,
    ];
    /// Tasks of pretraining.
    pub const PRETRAINING: [Task; 4] = [
        Task::RadarPrediction,
        Task::RadarToText,
        Task::TextToRadar,
        Task::TextPrediction,
    ];

    /// Name of the task, as in the keys of a recipe.
    pub fn name(self) -> &'static str {
        match self {
            Task::RadarToText => "radar_to_text",
            Task::TextToRadar => "text_to_radar",
            Task::TextToLength => "text_to_length",
            Task::RadarToLength => "radar_to_length",
            Task::Continuation => "continuation",
            Task::Question => "question",
            Task::RadarPrediction => "radar_prediction",
            Task::TextPrediction => "text_prediction",
        }
    }

    /// The placeholder that every prompt of the task contains.
    pub fn prompt_placeholder(self) -> &'static str {
        match self {
            Task::TextToRadar | Task::TextToLength | Task::TextPrediction => "{caption}",
            _ => "{radar}",
        }
    }

    /// Template of the answer.
    pub fn answer(self) -> &'static str {
        match self {
            Task::RadarToText => "{caption}",
            Task::TextToRadar => "{radar}",
            Task::TextToLength | Task::RadarToLength => "{seconds} seconds",
            Task::Continuation => "{rest}",
            Task::Question => "{answer}",
            Task::RadarPrediction | Task::TextPrediction => "{spans}",
        }
    }

    /// Prompts of the task. The first one is the short prompt of pretraining.
    pub fn prompts(self) -> &'static [&'static str] {
        match self {
            Task::RadarToText => RADAR_TO_TEXT,
            Task::TextToRadar => TEXT_TO_RADAR,
            Task::TextToLength => TEXT_TO_LENGTH,
            Task::RadarToLength => RADAR_TO_LENGTH,
            Task::Continuation => CONTINUATION,
            Task::Question => questions::prompts(),
            Task::RadarPrediction => RADAR_PREDICTION,
            Task::TextPrediction => TEXT_PREDICTION,
        }
    }
}

/// All words that prompts and answers use, for the vocabulary.
pub fn all_text() -> impl Iterator<Item = &'static str> {
    let tasks = [Task::RadarPrediction, Task::TextPrediction]
        .into_iter()
        .chain(Task::INSTRUCTION);
    let templates = tasks.flat_map(|task| task.prompts().iter().copied().chain([task.answer()]));
    templates.chain([questions::YES, questions::NOT_STATED])
}

/// A piece of a template.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Piece<'a> {
    /// Literal words.
    Words(&'a str),
    /// A placeholder, braces included.
    Placeholder(&'a str),
}

/// Splits a template into words and placeholders. Spaces around placeholders are dropped.
pub fn pieces(template: &str) -> Vec<Piece<'_>> {
    let mut out = Vec::new();
    let mut rest = template;
    while let Some(start) = rest.find('{') {
        let Some(len) = rest[start..].find('}') else {
            break;
        };
        let words = rest[..start].trim();
        if !words.is_empty() {
            out.push(Piece::Words(words));
        }
        out.push(Piece::Placeholder(&rest[start..=start + len]));
        rest = &rest[start + len + 1..];
    }
    let words = rest.trim();
    if !words.is_empty() {
        out.push(Piece::Words(words));
    }
    out
}

const RADAR_PREDICTION: &[&str] = &["fill {radar}"];

const TEXT_PREDICTION: &[&str] = &["fill {caption}"];

const RADAR_TO_TEXT: &[&str] = &[
    EVALUATION_PROMPT,
    "describe the motion {radar}",
    "describe this motion: {radar}",
    "describe what happens in {radar}",
    "describe what the person does: {radar}",
    "describe the action in {radar}",
    "describe the movement {radar} in words",
    "describe {radar} in one sentence",
    "describe {radar} in plain words",
    "describe the activity shown by {radar}",
    "describe how the person moves in {radar}",
    "describe the human motion behind {radar}",
    "please describe {radar}",
    "please describe the motion in {radar}",
    "please describe what the radar saw: {radar}",
    "what happens in {radar}?",
    "what happens here: {radar}?",
    "what is happening in {radar}?",
    "what is the person doing in {radar}?",
    "what is the person doing? {radar}",
    "what does the person do in {radar}?",
    "what does {radar} show?",
    "what does the radar see in {radar}?",
    "what does this recording show: {radar}?",
    "what motion is {radar}?",
    "what motion does {radar} show?",
    "what movement does {radar} hold?",
    "what action is seen in {radar}?",
    "what activity do you see in {radar}?",
    "what did the radar see? {radar}",
    "what did the person do in {radar}?",
    "what can be seen in {radar}?",
    "what kind of motion is {radar}?",
    "what kind of movement is this: {radar}?",
    "which motion does {radar} show?",
    "which action is this: {radar}?",
    "which action does {radar} belong to?",
    "which movement is recorded in {radar}?",
    "which activity is behind {radar}?",
    "how does the person move in {radar}?",
    "how is the person moving? {radar}",
    "how would you describe {radar}?",
    "how would you put {radar} into words?",
    "can you describe {radar}?",
    "can you describe the motion {radar}?",
    "can you tell what happens in {radar}?",
    "can you say what the person does in {radar}?",
    "can you explain the movement {radar}?",
    "can you put {radar} into words?",
    "can you caption {radar}?",
    "could you describe the action {radar}?",
    "could you tell me what {radar} shows?",
    "could you say what is going on in {radar}?",
    "could you sum up the motion {radar}?",
    "tell me what happens in {radar}",
    "tell me what the person does: {radar}",
    "tell me what {radar} shows",
    "tell me about the motion {radar}",
    "tell me how the person moves in {radar}",
    "tell what is going on in {radar}",
    "say what happens in {radar}",
    "say what the person is doing: {radar}",
    "say in words what {radar} shows",
    "say in one sentence what happens: {radar}",
    "say which motion {radar} is",
    "explain the motion {radar}",
    "explain what the person does in {radar}",
    "explain what is going on: {radar}",
    "explain {radar} in simple words",
    "explain the recorded movement {radar}",
    "caption {radar}",
    "caption this motion: {radar}",
    "caption the radar recording {radar}",
    "caption the movement in {radar}",
    "give a caption for {radar}",
    "give a short caption: {radar}",
    "give a description of {radar}",
    "give a description of the motion {radar}",
    "give one sentence about {radar}",
    "give the action in {radar} as a sentence",
    "give the meaning of {radar} in words",
    "write a caption for {radar}",
    "write a sentence about {radar}",
    "write a description of the motion {radar}",
    "write down what happens in {radar}",
    "write down what the person does: {radar}",
    "write in one sentence what {radar} shows",
    "write what the radar saw in {radar}",
    "report what happens in {radar}",
    "report the activity in {radar}",
    "report what the person did: {radar}",
    "report the observed motion {radar}",
    "summarize {radar}",
    "summarize the motion {radar}",
    "summarize the movement of the person in {radar}",
    "summarize what the radar recorded: {radar}",
    "sum up {radar} in a sentence",
    "sum up what happens in {radar}",
    "translate {radar} into words",
    "translate the radar codes {radar} into a sentence",
    "translate this motion into text: {radar}",
    "translate {radar} to text",
    "turn {radar} into words",
    "turn {radar} into a sentence",
    "turn the recording {radar} into text",
    "turn this motion into a caption: {radar}",
    "put {radar} into words",
    "put the motion {radar} into a sentence",
    "read {radar} and describe it",
    "read the radar codes {radar} and say what happens",
    "read {radar} and write a caption",
    "read the motion {radar} aloud",
    "look at {radar} and describe the motion",
    "look at {radar} and say what the person does",
    "look at the recording {radar}. what happens?",
    "look at this motion {radar}. describe it",
    "given {radar}, describe the motion",
    "given {radar}, what does the person do?",
    "given the radar codes {radar}, write a caption",
    "given the motion {radar}, say what happens",
    "given {radar}, tell me the action",
    "from {radar}, describe the motion",
    "from {radar}, say what the person is doing",
    "from the recording {radar}, write a sentence",
    "from the radar codes {radar}, tell what happens",
    "here is a motion: {radar}. describe it",
    "here is a recording: {radar}. what happens?",
    "here is {radar}. what does the person do?",
    "here are radar codes: {radar}. put them into words",
    "this is a motion: {radar}. what is it?",
    "this is {radar}. describe the action",
    "this is what the radar saw: {radar}. explain it",
    "the radar saw {radar}. what happened?",
    "the radar saw {radar}. describe the person",
    "the radar recorded {radar}. write a caption",
    "the person moved like {radar}. describe it",
    "the motion is {radar}. say it in words",
    "{radar} what is this motion?",
    "{radar} what happens here?",
    "{radar} what is the person doing?",
    "{radar} describe this",
    "{radar} describe the motion in one sentence",
    "{radar} say what you see",
    "{radar} give a caption",
    "{radar} write what happens",
    "{radar} tell me what the person did",
    "{radar} in words",
    "{radar} means what?",
    "{radar} shows what?",
    "name the motion in {radar}",
    "name the action the person does: {radar}",
    "name what happens in {radar}",
    "recognize the motion {radar}",
    "recognize what the person does in {radar}",
    "interpret {radar}",
    "interpret the radar recording {radar}",
    "interpret the motion {radar} in a sentence",
    "identify the motion in {radar}",
    "identify what the person is doing: {radar}",
    "make a caption for {radar}",
    "make a sentence out of {radar}",
    "find words for {radar}",
    "find a caption for the motion {radar}",
    "state what happens in {radar}",
    "state the action shown by {radar}",
    "motion: {radar} caption:",
    "radar: {radar} text:",
    "recording: {radar} description:",
    "question: what happens in {radar}? answer:",
];

const TEXT_TO_RADAR: &[&str] = &[
    "show {caption}",
    "show the radar codes of: {caption}",
    "show me the motion: {caption}",
    "show how this looks to a radar: {caption}",
    "generate the motion: {caption}",
    "generate radar codes for: {caption}",
    "generate a recording of: {caption}",
    "create radar codes for: {caption}",
    "create the motion: {caption}",
    "make a radar recording of: {caption}",
    "make a motion where {caption}",
    "give the radar codes for: {caption}",
    "give me the motion: {caption}",
    "write the radar codes of: {caption}",
    "translate into radar codes: {caption}",
    "translate to motion: {caption}",
    "turn into a motion: {caption}",
    "turn this text into radar codes: {caption}",
    "what would a radar see? {caption}",
    "what does the radar record if {caption}?",
    "which radar codes mean: {caption}?",
    "how does this look to the radar: {caption}?",
    "can you show {caption}?",
    "can you generate the motion {caption}?",
    "could you make radar codes for: {caption}?",
    "given the text, write the codes: {caption}",
    "from text to radar: {caption}",
    "simulate: {caption}",
    "simulate what the radar sees: {caption}",
    "imagine that {caption}. what does the radar see?",
    "{caption}. show it",
    "{caption}. give the radar codes",
    "text: {caption} radar:",
];

const TEXT_TO_LENGTH: &[&str] = &[
    "length of {caption}",
    "how long is this motion: {caption}?",
    "how long does it take: {caption}?",
    "how long would this last: {caption}?",
    "how many seconds does this take: {caption}?",
    "how many seconds is the motion: {caption}?",
    "guess how long this takes: {caption}",
    "guess the length of the motion: {caption}",
    "estimate the seconds for: {caption}",
    "estimate how long this lasts: {caption}",
    "give the length of: {caption}",
    "give the time for: {caption}",
    "what is the length of: {caption}?",
    "what time does this need: {caption}?",
    "tell me how long this is: {caption}",
    "say how many seconds this takes: {caption}",
    "{caption}. how long is it?",
    "{caption}. how many seconds?",
    "text: {caption} length:",
];

const RADAR_TO_LENGTH: &[&str] = &[
    "length of {radar}",
    "how long is {radar}?",
    "how long is the motion {radar}?",
    "how long is the recording {radar}?",
    "how long did the radar look: {radar}?",
    "how many seconds does {radar} last?",
    "how many seconds is {radar}?",
    "give the length of {radar}",
    "give the time of the motion {radar}",
    "what is the length of {radar}?",
    "what time does {radar} take?",
    "tell me how long {radar} is",
    "tell the length of the recording {radar}",
    "say how many seconds {radar} lasts",
    "estimate the length of {radar}",
    "{radar} how long is this?",
    "{radar} how many seconds?",
    "{radar} give its length",
    "motion: {radar} length:",
];

const CONTINUATION: &[&str] = &[
    "continue {radar}",
    "continue the motion {radar}",
    "continue this recording: {radar}",
    "continue the radar codes {radar}",
    "go on: {radar}",
    "go on with the motion {radar}",
    "what comes after {radar}?",
    "what happens next: {radar}?",
    "what does the radar see next? {radar}",
    "what follows {radar}?",
    "how does {radar} go on?",
    "how does the motion {radar} end?",
    "finish the motion {radar}",
    "finish the recording {radar}",
    "complete {radar}",
    "complete the motion that starts with {radar}",
    "the motion starts with {radar}. continue",
    "given the start {radar}, give the rest",
    "predict what follows {radar}",
    "predict the rest of {radar}",
    "{radar} and then?",
    "{radar} what comes next?",
    "start: {radar} rest:",
];

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn every_prompt_holds_its_placeholder_once_and_no_quotes() {
        for task in Task::INSTRUCTION.into_iter().chain(Task::PRETRAINING) {
            let unique: BTreeSet<_> = task.prompts().iter().collect();
            assert_eq!(
                unique.len(),
                task.prompts().len(),
                "{task:?}: a prompt appears twice"
            );
            for prompt in task.prompts() {
                let mut found = pieces(prompt);
                found.retain(|p| {
                    matches!(p, Piece::Placeholder(_)) && *p != Piece::Placeholder(questions::CLAIM)
                });
                assert_eq!(
                    found,
                    [Piece::Placeholder(task.prompt_placeholder())],
                    "{prompt}"
                );
                assert!(!prompt.contains(['"', '\'']), "{prompt}");
                assert!(
                    prompt.split_whitespace().count() <= 12,
                    "too long: {prompt}"
                );
            }
        }
    }

    #[test]
    fn the_main_task_has_enough_wordings_and_holds_the_evaluation_prompt() {
        assert!(
            Task::RadarToText.prompts().len() >= 150,
            "{}",
            Task::RadarToText.prompts().len()
        );
        assert_eq!(Task::RadarToText.prompts()[0], EVALUATION_PROMPT);
    }

    /// No opening word may dominate, because the model would then learn a single wording.
    #[test]
    fn wordings_are_balanced() {
        let prompts = Task::RadarToText.prompts();
        let mut counts = std::collections::BTreeMap::new();
        for prompt in prompts {
            *counts
                .entry(prompt.split_whitespace().next())
                .or_insert(0_usize) += 1;
        }
        let max = counts.values().max().unwrap();
        assert!(max * 8 <= prompts.len(), "{counts:?}");
        assert!(counts.len() >= 30, "{} openings", counts.len());
    }

    #[test]
    fn templates_split_into_words_and_placeholders() {
        assert_eq!(
            pieces("what does {radar} show?"),
            [
                Piece::Words("what does"),
                Piece::Placeholder("{radar}"),
                Piece::Words("show?")
            ]
        );
        assert_eq!(pieces("plain"), [Piece::Words("plain")]);
        assert_eq!(pieces("open {brace"), [Piece::Words("open {brace")]);
    }
}
