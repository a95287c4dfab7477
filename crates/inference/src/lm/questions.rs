//! Questions about a motion, with the answers that captions give.
//!
//! Instruction tuning asks them of clips whose captions state the answer, and of others, for which the answer is
//! [`NOT_STATED`]: a model that was tuned so says when its tokens do not hold an answer.

use std::{ops::RangeInclusive, sync::LazyLock};

use radarllm_facts::{
    Action, Count, Direction, Facts, Side, Tempo, attach, parse, score::is_same_action,
    words::number_word,
};

/// What the model writes if the captions of such a motion state no answer.
pub const NOT_STATED: &str = "no";
/// The answer to a claim that holds.
pub const YES: &str = "yes";
/// Placeholder of a claim in a prompt.
pub const CLAIM: &str = "{claim}";

/// What is asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Question {
    /// Which way: forward, to the left, up.
    Direction,
    /// Which side of the body acts.
    Side,
    /// How many times.
    Count,
    /// How fast.
    Tempo,
    /// What happens first.
    First,
    /// What happens last.
    Last,
    /// Whether a sentence holds.
    Claim,
}

impl Question {
    /// All questions.
    pub const ALL: [Self; 7] = [
        Self::Direction,
        Self::Side,
        Self::Count,
        Self::Tempo,
        Self::First,
        Self::Last,
        Self::Claim,
    ];

    /// Name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Direction => "direction",
            Self::Side => "side",
            Self::Count => "count",
            Self::Tempo => "tempo",
            Self::First => "first",
            Self::Last => "last",
            Self::Claim => "claim",
        }
    }

    /// The wordings of instruction tuning.
    pub fn prompts(self) -> &'static [&'static str] {
        match self {
            Self::Direction => DIRECTION,
            Self::Side => SIDE,
            Self::Count => COUNT,
            Self::Tempo => TEMPO,
            Self::First => FIRST,
            Self::Last => LAST,
            Self::Claim => CLAIMS,
        }
    }

    /// The answer that the captions of a motion give: of the first caption that states one. `None` if none does, and for a
    /// claim, which [`holds`] decides.
    ///
    /// ```
    /// use radarllm_inference::lm::questions::Question;
    ///
    /// let captions = ["a person walks", "a person slowly walks backward, then waves twice with the left hand"];
    /// let answer = |question: Question| question.answer(captions);
    /// assert_eq!(answer(Question::Direction).as_deref(), Some("backward"));
    /// assert_eq!(answer(Question::Side).as_deref(), Some("left"));
    /// assert_eq!(answer(Question::Count).as_deref(), Some("two times"));
    /// assert_eq!(answer(Question::Tempo).as_deref(), Some("slowly"));
    /// assert_eq!(answer(Question::Last).as_deref(), Some("a person walks"));
    /// ```
    pub fn answer<'a>(self, captions: impl IntoIterator<Item = &'a str>) -> Option<String> {
        captions.into_iter().find_map(|caption| self.of(caption))
    }

    /// Whether the sentence that all members of an ensemble say together answers the question better than one member that is
    /// asked: docs/results/instructions.md has the shares of validation clips that chose.
    pub(super) fn is_of_all_members(self) -> bool {
        matches!(self, Self::Side | Self::First | Self::Last)
    }

    /// The answer that one caption gives.
    fn of(self, caption: &str) -> Option<String> {
        let mut clauses = parse(caption);
        clauses.retain(|clause| !clause.actions.is_empty());
        let all = |value: fn(&Action) -> Option<String>| {
            let actions = clauses.iter().flat_map(|clause| &clause.actions);
            let mut values: Vec<String> = actions.filter_map(value).collect();
            values.dedup();
            (!values.is_empty()).then(|| values.join(", then "))
        };
        match self {
            Self::Direction => all(|action| action.direction.map(way)),
            Self::Side => all(|action| action.side.map(side)),
            Self::Count => all(|action| action.count.map(times)),
            Self::Tempo => all(|action| action.tempo.map(pace)),
            Self::First => clauses.first().map(|clause| clause.sentence()),
            Self::Last => clauses.last().map(|clause| clause.sentence()),
            Self::Claim => None,
        }
    }
}

/// The prompts of all questions, in the order of [`Question::ALL`].
pub(super) fn prompts() -> &'static [&'static str] {
    static ALL: LazyLock<Vec<&'static str>> = LazyLock::new(|| {
        let each = Question::ALL.into_iter();
        each.flat_map(|question| question.prompts().iter().copied())
            .collect()
    });
    &ALL
}

/// The question that a prompt asks; `None` if it is no prompt of [`Question::prompts`].
pub fn question_of(prompt: &str) -> Option<Question> {
    let mut all = Question::ALL.into_iter();
    all.find(|question| question.prompts().contains(&prompt))
}

/// Whether a claim holds of a motion, by the captions of the motion; `None` if they do not decide it.
pub fn holds(claim: &Facts, motion: &[Facts]) -> Option<bool> {
    let found: Vec<Option<bool>> = motion
        .iter()
        .map(|caption| attach::holds(claim, caption))
        .collect();
    match found.contains(&Some(true)) {
        true => Some(true),
        false => found
            .iter()
            .all(|found| *found == Some(false))
            .then_some(false),
    }
}

/// Whether a claim holds of a motion as often as it is asked for, by a sentence about the motion; `None` if the sentence does not
/// say how often.
pub(super) fn holds_so_often(
    claim: &Facts,
    motion: &Facts,
    counts: &RangeInclusive<u16>,
) -> Option<bool> {
    if !holds(claim, std::slice::from_ref(motion))? {
        return Some(counts.contains(&0));
    }
    let asked = claim.actions().next()?;
    let mut done = motion
        .actions()
        .filter(|done| is_same_action(asked.name, done.name));
    match done.next()?.count? {
        Count::Exactly(n) => Some(counts.contains(&n)),
        // More than once, and nothing else is known.
        Count::Many if *counts.start() <= 2 && *counts.end() == u16::MAX => Some(true),
        Count::Many if *counts.end() <= 1 => Some(false),
        Count::Many => None,
    }
}

fn way(direction: Direction) -> String {
    let words = match direction {
        Direction::Forward => "forward",
        Direction::Backward => "backward",
        Direction::Left => "to the left",
        Direction::Right => "to the right",
        Direction::Up => "up",
        Direction::Down => "down",
        Direction::Sideways => "sideways",
    };
    words.into()
}

fn side(side: Side) -> String {
    side.word().into()
}

fn times(count: Count) -> String {
    match count {
        Count::Exactly(1) => "once".into(),
        Count::Exactly(n) => format!("{} times", number_word(n)),
        Count::Many => "many times".into(),
    }
}

fn pace(tempo: Tempo) -> String {
    match tempo {
        Tempo::Slow => "slowly".into(),
        Tempo::Moderate => "at a normal pace".into(),
        Tempo::Fast => "quickly".into(),
        Tempo::PerMinute(n) => format!("{n} times a minute"),
    }
}

const DIRECTION: &[&str] = &[
    "direction of {radar}",
    "which way: {radar}",
    "which way does the person go? {radar}",
    "which way does the person move in {radar}?",
    "which way is it? {radar}",
    "in which direction does the person move? {radar}",
    "in what direction is the motion {radar}?",
    "what is the direction of {radar}?",
    "tell me the direction of {radar}",
    "tell me which way the person goes: {radar}",
    "say which way the person turns or moves: {radar}",
    "{radar} which way?",
];

const SIDE: &[&str] = &[
    "side of {radar}",
    "left or right? {radar}",
    "which hand is it? {radar}",
    "which arm does the person use? {radar}",
    "which leg does the person use? {radar}",
    "which side of the body moves in {radar}?",
    "which arm or leg moves? {radar}",
    "is it the left or the right? {radar}",
    "with which hand or foot? {radar}",
    "tell me which hand or leg it is: {radar}",
    "say left, right or both: {radar}",
    "{radar} which side?",
];

const COUNT: &[&str] = &[
    "count {radar}",
    "how many times? {radar}",
    "how often? {radar}",
    "how often does the person do it? {radar}",
    "how many times does it happen in {radar}?",
    "how many times does the person do this? {radar}",
    "number of times: {radar}",
    "count how often it happens: {radar}",
    "tell me how often the person moves: {radar}",
    "say how many times: {radar}",
    "{radar} how many times?",
];

const TEMPO: &[&str] = &[
    "speed of {radar}",
    "how fast? {radar}",
    "how fast is it? {radar}",
    "how fast does the person move in {radar}?",
    "is it slow or fast? {radar}",
    "what is the speed of the motion {radar}?",
    "at what pace does the person move? {radar}",
    "tell me the speed of {radar}",
    "say slow or fast: {radar}",
    "{radar} how fast?",
];

const FIRST: &[&str] = &[
    "first of {radar}",
    "what happens first? {radar}",
    "what does the person do first? {radar}",
    "what comes first in {radar}?",
    "what is the first action in {radar}?",
    "how does {radar} start?",
    "how does the motion {radar} begin?",
    "tell me what happens first: {radar}",
    "say what the person does first: {radar}",
    "{radar} what was first?",
];

const LAST: &[&str] = &[
    "last of {radar}",
    "what happens last? {radar}",
    "what does the person do last? {radar}",
    "what does the person do at the end? {radar}",
    "what comes last in {radar}?",
    "what is the last action in {radar}?",
    "tell me what happens last: {radar}",
    "say what the person does in the end: {radar}",
    "{radar} what was last?",
];

const CLAIMS: &[&str] = &[
    "true? {claim}: {radar}",
    "is it true that {claim}? {radar}",
    "is this true: {claim}? {radar}",
    "does {radar} show that {claim}?",
    "does it happen that {claim}? {radar}",
    "can you see that {claim}? {radar}",
    "yes or no: {claim}? {radar}",
    "check {claim}: {radar}",
];

#[cfg(test)]
mod tests {
    use super::*;
    use radarllm_facts::facts;

    #[test]
    fn answers_are_what_the_captions_state() {
        for (question, captions, answer) in [
            (
                Question::Direction,
                "a person walks forward, then turns to the left",
                Some("forward, then to the left"),
            ),
            (Question::Direction, "a person claps", None),
            (
                Question::Side,
                "a person raises both hands, then kicks with the right leg",
                Some("both, then right"),
            ),
            (
                Question::Count,
                "a person squats three times",
                Some("three times"),
            ),
            (Question::Count, "a person squats", None),
            (
                Question::Tempo,
                "a person runs forward quickly",
                Some("quickly"),
            ),
            (
                Question::First,
                "a person sits down, then waves with the left hand",
                Some("a person sits down"),
            ),
            (
                Question::Last,
                "a person sits down, then waves with the left hand",
                Some("a person waves with the left hand"),
            ),
            (Question::First, "colourless green ideas", None),
        ] {
            assert_eq!(
                question.answer([captions]).as_deref(),
                answer,
                "{question:?} {captions}"
            );
        }
        let captions = ["a person squats", "a person squats twice"];
        assert_eq!(
            Question::Count.answer(captions).as_deref(),
            Some("two times")
        );
    }

    #[test]
    fn claims_hold_by_any_caption_and_fail_by_all() {
        let motion = [
            facts("a person waves"),
            facts("a person waves with the left hand"),
        ];
        let asked = |claim: &str| holds(&facts(claim), &motion);
        assert_eq!(asked("a person waves"), Some(true));
        assert_eq!(asked("a person waves with the left hand"), Some(true));
        assert_eq!(asked("a person jumps"), Some(false));
        // The first caption says nothing about the side.
        assert_eq!(asked("a person waves with the right hand"), None);
    }

    #[test]
    fn a_claim_with_a_smallest_or_largest_number_is_compared_with_the_sentence() {
        let squats = facts("a person squats four times");
        let claim = facts("a person squats");
        for (counts, expected) in [
            (3..=u16::MAX, Some(true)),
            (5..=u16::MAX, Some(false)),
            (0..=4, Some(true)),
            (0..=3, Some(false)),
        ] {
            assert_eq!(holds_so_often(&claim, &squats, &counts), expected);
        }
        let waves = facts("a person waves");
        assert_eq!(holds_so_often(&claim, &waves, &(0..=2)), Some(true));
        assert_eq!(holds_so_often(&claim, &waves, &(1..=u16::MAX)), Some(false));
        assert_eq!(
            holds_so_often(&facts("a person waves"), &waves, &(0..=2)),
            None
        );
        let many = facts("a person squats many times");
        assert_eq!(holds_so_often(&claim, &many, &(2..=u16::MAX)), Some(true));
        assert_eq!(holds_so_often(&claim, &many, &(5..=u16::MAX)), None);
    }

    #[test]
    fn every_prompt_asks_one_question() {
        for question in Question::ALL {
            for prompt in question.prompts() {
                assert_eq!(question_of(prompt), Some(question), "{prompt}");
                assert_eq!(
                    prompt.contains(CLAIM),
                    question == Question::Claim,
                    "{prompt}"
                );
            }
        }
        assert_eq!(question_of("describe {radar}"), None);
        let n: usize = Question::ALL.iter().map(|q| q.prompts().len()).sum();
        assert_eq!(prompts().len(), n);
    }
}
