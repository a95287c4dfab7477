//! Sentences to clauses.

use crate::{
    action::{Action, Facts, Subject},
    attributes,
    lexicon::{idioms, stating},
    words::{Word, words},
};

/// A part of a sentence that covers one stretch of time.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Clause {
    /// The words, in lower case.
    pub text: String,
    /// The actions that happen in this stretch, in the order in which they are named, but what somebody stops doing before
    /// the stop. Several happen at once ("walks while waving"). Empty if no action is recognised.
    pub actions: Vec<Action>,
}

/// Words between which one clause ends and the next begins. Longer ones stand before their parts.
const SEPARATORS: [&str; 8] = [
    ", and finally ",
    ", and then ",
    ", followed by ",
    " and then ",
    ", then ",
    " then ",
    "; ",
    ". ",
];

/// Returns the clauses of a sentence in order of time. "After sitting, a person waves" and "a person sits before
/// waving" both state `sit` first. A sentence without a known word has one clause without actions.
pub fn parse(sentence: &str) -> Vec<Clause> {
    let text = sentence.to_lowercase();
    let text = text.trim().trim_end_matches('.');
    let mut parts = vec![text];
    for separator in SEPARATORS {
        parts = parts.iter().flat_map(|p| p.split(separator)).collect();
    }
    let mut clauses: Vec<Clause> = parts
        .into_iter()
        .flat_map(in_order_of_time)
        .map(clause)
        .collect();
    for i in 1..clauses.len() {
        let (before, rest) = clauses.split_at_mut(i);
        if let (Some(last), [own, ..]) = (before[i - 1].actions.last(), rest)
            && own.actions.is_empty()
        {
            own.actions.extend(elided(last, &own.text));
        }
    }
    clauses
}

/// What a sentence states: its subject, and its actions by stretch of time.
///
/// ```
/// use radarllm_facts::facts;
///
/// let stated = facts("A man slowly takes four steps back, then waves twice with his left hand.");
/// assert_eq!(
///     stated.to_string(),
///     "man: walk backward x4 slow; wave hand left x2"
/// );
/// ```
pub fn facts(sentence: &str) -> Facts {
    let clauses = parse(sentence);
    Facts {
        subject: subject(&words(&sentence.to_lowercase())),
        stretches: clauses
            .into_iter()
            .map(|clause| clause.actions)
            .filter(|actions| !actions.is_empty())
            .collect(),
    }
}

/// The first word that names somebody.
fn subject(words: &[Word]) -> Option<Subject> {
    words.iter().find_map(|word| {
        Some(match word.text.as_str() {
            "person" | "someone" | "somebody" | "human" | "subject" | "individual" | "they"
            | "people" | "user" | "actor" | "performer" | "walker" | "dancer" | "participant"
            | "model" | "player" => Subject::Person,
            "man" | "he" | "guy" | "boy" | "male" | "gentleman" => Subject::Man,
            "woman" | "she" | "girl" | "lady" | "female" => Subject::Woman,
            "figure" | "sim" | "toon" | "character" | "stickman" | "animation" | "mannequin"
            | "avatar" | "robot" => Subject::Figure,
            _ => return None,
        })
    })
}

/// The action before, repeated without its verb: "walks to the left, then to the right".
fn elided(last: &Action, text: &str) -> Option<Action> {
    let words = words(text);
    let words: Vec<&str> = words.iter().map(|w| w.text.as_str()).collect();
    let mut action = Action::named(last.name);
    attributes::fill(&mut action, &words, 0);
    let starts_with_way = words.first().is_some_and(|w| {
        matches!(
            *w,
            "to" | "back" | "backward" | "backwards" | "forward" | "left" | "right" | "the"
        )
    });
    let says_way =
        action.direction.is_some() || action.side.is_some_and(|side| Some(side) != last.side);
    (starts_with_way && says_way).then_some(action)
}

/// Whether two actions of one name state different values of the same kind, so that they are two.
fn contradicts(a: &Action, b: &Action) -> bool {
    let differ = |x: Option<u8>, y: Option<u8>| matches!((x, y), (Some(x), Some(y)) if x != y);
    differ(a.side.map(|s| s as u8), b.side.map(|s| s as u8))
        || differ(a.direction.map(|d| d as u8), b.direction.map(|d| d as u8))
}

/// Splits at "before" and "after".
fn in_order_of_time(part: &str) -> Vec<&str> {
    if let Some(rest) = part.strip_prefix("after ")
        && let Some((first, second)) = rest.split_once(',')
    {
        // "After squatting, pausing and rising, a person waves": the comma before the subject.
        let starts = |text: &str| SUBJECTS.iter().any(|s| text.trim_start().starts_with(s));
        let commas = rest.match_indices(',').map(|(at, _)| rest.split_at(at));
        let mut before_subject = commas.filter(|(_, second)| starts(&second[1..]));
        return match before_subject.next() {
            Some((first, second)) => vec![first, &second[1..]],
            None => vec![first, second],
        };
    }
    if let Some((first, second)) = part.split_once(" before ") {
        return vec![first, second];
    }
    match part.split_once(" after ") {
        // "Sits and after a few seconds gets up."
        Some((_, second)) if is_lapse(second) && second.split(' ').count() < 6 => vec![part],
        Some((first, second)) if is_lapse(second) => vec![first, second],
        // "Faces to the left after a quarter turn" is one action, also if more words follow.
        Some((second, first))
            if first.ends_with("turn")
                || first.starts_with("a quarter turn") && second.contains(" faces ") =>
        {
            vec![part]
        }
        Some((second, first)) => vec![first, second],
        _ => vec![part],
    }
}

/// Whether a text begins with a lapse of time or way rather than with an action.
fn is_lapse(text: &str) -> bool {
    let words: Vec<&str> = text.split_whitespace().take(5).collect();
    let unit = |w: &&str| {
        let w = w.trim_end_matches([',', '.']);
        matches!(
            w,
            "second" | "seconds" | "moment" | "moments" | "while" | "steps" | "time"
        )
    };
    matches!(words.first(), Some(&("which" | "that" | "this"))) || words.iter().any(unit)
}

/// Words before a verb that belong to it: "and slowly starts to walk".
fn leads(word: &str) -> bool {
    word.len() > 4 && word.ends_with("ly")
        || matches!(
            word,
            "also"
                | "starts"
                | "begins"
                | "starting"
                | "to"
                | "is"
                | "are"
                | "he"
                | "she"
                | "they"
                | "it"
                | "person"
                | "man"
                | "a"
                | "the"
                | "continues"
                | "finally"
                | "again"
                | "immediately"
                | "proceeds"
                | "his"
                | "her"
                | "their"
                | "its"
                | "left"
                | "right"
                | "both"
                | "quick"
                | "slow"
                | "first"
                | "this"
                | "then"
        )
}

/// Where the words of an action begin: before its adverbs, after the "and" or the comma before them.
fn beginning(words: &[Word], start: usize, after: usize) -> usize {
    let mut at = start;
    while at > after {
        if words[at].after_comma || words[at - 1].text == "and" {
            return at;
        }
        if !leads(&words[at - 1].text) {
            break;
        }
        at -= 1;
    }
    // Without a boundary only adverbs move over.
    while at < start && !words[at].text.ends_with("ly") {
        at += 1;
    }
    at
}

/// Gerunds of what follows a stop: who "stops facing left" has not faced left before.
const AFTER_A_STOP: [&str; 5] = ["facing", "standing", "looking", "sitting", "lying"];

/// Indices of the actions of a clause, of which first word, last word and name are given, in the order in which they
/// happen: who "stops walking" has walked before.
fn by_time(found: &[(usize, usize, &'static str)], words: &[Word]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..found.len()).collect();
    for (i, pair) in found.windows(2).enumerate() {
        let [(_, stop, _), (next, ..)] = pair else {
            continue;
        };
        let word = &words[*next];
        if words[*stop].text.starts_with("stop")
            && *next == stop + 1
            && !word.after_comma
            && word.text.ends_with("ing")
            && !AFTER_A_STOP.contains(&word.text.as_str())
        {
            order.swap(i, i + 1);
        }
    }
    order
}

fn clause(text: &str) -> Clause {
    let mut actions: Vec<Action> = Vec::new();
    for part in text.split(" while ").flat_map(|p| p.split(" whilst ")) {
        let words = words(part);
        let texts: Vec<&str> = words.iter().map(|w| w.text.as_str()).collect();
        // First and last word of each action, and its name.
        let mut found: Vec<(usize, usize, &'static str)> = Vec::new();
        let mut used = vec![false; words.len()];
        for idiom in idioms().candidates(&texts) {
            while let Some(at) = idiom.find(&texts, &used) {
                at.iter().for_each(|i| used[*i] = true);
            }
        }
        for pattern in stating().candidates(&texts) {
            if pattern.only_alone && !found.is_empty() {
                continue;
            }
            while let Some(at) = pattern.find(&texts, &used) {
                at.iter().for_each(|i| used[*i] = true);
                let end = at.last().copied().unwrap_or_default();
                found.push((at[0], end, pattern.action));
            }
        }
        // "Without bending the knees" states no bending.
        found.retain(|(start, ..)| !matches!(texts[..*start], [.., "without" | "not" | "never"]));
        found.sort_unstable();
        for i in by_time(&found, &words) {
            let (start, _, name) = &found[i];
            // Attributes stand between an action and the next one. Those before the first belong to it.
            let from = match i {
                0 => 0,
                _ => beginning(&words, *start, found[i - 1].0 + 1),
            };
            let to = found
                .get(i + 1)
                .map_or(words.len(), |next| beginning(&words, next.0, start + 1));
            let own = &texts[from..to.max(start + 1)];
            let mut action = Action::named(name);
            attributes::fill(&mut action, own, start - from);
            let arms_are_held = action.name == "hold" && action.posture.is_some();
            match actions.last_mut() {
                // "Walks, holding the arms out".
                Some(last) if arms_are_held && last.posture.is_none() => {
                    last.posture = action.posture;
                }
                Some(last) if last.name == *name && !contradicts(last, &action) => {
                    last.merge(&action);
                }
                _ => actions.push(action),
            }
        }
    }
    Clause {
        text: text.trim().to_string(),
        actions,
    }
}

/// Subjects of the sentences of the motion library, and of many that people write.
const SUBJECTS: [&str; 7] = [
    "a person",
    "the person",
    "this person",
    "someone",
    "somebody",
    "a figure",
    "the figure",
];

/// Words of counts.
const NUMBERS: [&str; 13] = [
    "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve",
    "several", "many",
];

impl Clause {
    /// The clause without its subject: "a person first walks forward" becomes "walks forward".
    pub fn predicate(&self) -> &str {
        let mut text = self.text.as_str();
        for subject in SUBJECTS {
            if let Some(rest) = text.strip_prefix(subject).and_then(|t| t.strip_prefix(' ')) {
                text = rest;
            }
        }
        text.strip_prefix("first ").unwrap_or(text)
    }

    /// The clause without its count: "claps three times" becomes "claps". A count is true of the time that it was counted
    /// in, and of no longer one.
    #[must_use]
    pub fn without_count(&self) -> Self {
        let words: Vec<&str> = self.text.split(' ').collect();
        let is_number = |word: &str| NUMBERS.contains(&word);
        let mut kept = Vec::with_capacity(words.len());
        let mut i = 0;
        while i < words.len() {
            match words[i..] {
                ["once" | "twice", ..] => i += 1,
                [number, "times", ..] if is_number(number) => i += 2,
                ["for", number, "steps", ..] if is_number(number) => i += 3,
                _ => {
                    kept.push(words[i]);
                    i += 1;
                }
            }
        }
        Self {
            text: kept.join(" "),
            actions: self.actions.clone(),
        }
    }

    /// The clause as a sentence of its own: "sitting down" becomes "a person is sitting down".
    pub fn sentence(&self) -> String {
        let predicate = self.predicate();
        let starts_with_gerund = predicate
            .split(' ')
            .next()
            .is_some_and(|word| word.ends_with("ing"));
        match starts_with_gerund {
            true => format!("a person is {predicate}"),
            false => format!("a person {predicate}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Direction, Side};

    fn names(sentence: &str) -> Vec<Vec<&'static str>> {
        let clauses = parse(sentence);
        let names = |c: &Clause| c.actions.iter().map(|a| a.name).collect();
        clauses.iter().map(names).collect()
    }

    #[test]
    fn compound_actions_are_one_action() {
        for (sentence, expected) in [
            ("a person raises the right hand and waves", "wave"),
            (
                "a person bends down and picks something up with both hands",
                "pick_up",
            ),
            (
                "someone bends over and grabs something from the ground",
                "pick_up",
            ),
            (
                "a person goes down on the left knee and stands up again",
                "kneel",
            ),
            ("a person crouches low and stands up again", "crouch"),
            ("the person reaches out and pulls with both hands", "pull"),
            (
                "a person lifts the left leg and steps over an obstacle",
                "step_over",
            ),
            ("a person throws a hook with the right hand", "punch"),
            ("a person stands up from lying on the floor", "stand_up"),
            (
                "a person lifts a phone to the ear with the left hand",
                "answer_phone",
            ),
            (
                "a person lifts the knees high while marching in place",
                "march",
            ),
            ("a person does star jumps", "jumping_jack"),
        ] {
            assert_eq!(names(sentence), [[expected]], "{sentence}");
        }
    }

    #[test]
    fn clauses_are_in_order_of_time() {
        let two = [["sit_down"], ["wave"]];
        for sentence in [
            "a person sits down, then waves",
            "a person first sits down and then waves",
            "after sitting down, a person waves",
            "a person sits down before waving",
            "a person waves after sitting down",
            "A person sits down. The person waves.",
        ] {
            assert_eq!(names(sentence), two, "{sentence}");
        }
        let turns = parse("the person faces to the right after a quarter turn hunched over");
        let [
            Action {
                name: "turn",
                direction,
                ..
            },
        ] = turns[0].actions[..]
        else {
            panic!("{turns:?}")
        };
        assert_eq!((turns.len(), direction), (1, Some(Direction::Right)));
        assert_eq!(
            names("a person walks while waving both hands, then kicks, and finally bows"),
            [vec!["walk", "wave"], vec!["kick"], vec!["bow"]]
        );
    }

    #[test]
    fn who_stops_doing_something_has_done_it_before() {
        for sentence in [
            "a person stops walking",
            "a person walks forward and stops walking",
        ] {
            assert_eq!(names(sentence), [["walk", "stop"]], "{sentence}");
        }
        assert_eq!(names("a person stops, walking"), [["stop", "walk"]]);
    }

    #[test]
    fn who_moves_a_box_does_not_box() {
        for sentence in [
            "a person moves a box",
            "someone is moving the heavy boxes to the left",
            "a person moves a chair",
            "the person shifts the table",
        ] {
            assert_eq!(names(sentence), [["move_object"]], "{sentence}");
        }
        for sentence in ["a person boxes", "a person moves around while boxing"] {
            assert!(names(sentence).concat().contains(&"punch"), "{sentence}");
        }
    }

    #[test]
    fn sides_and_directions_belong_to_their_action() {
        let clauses = parse("a person walks backward while waving the left hand");
        let [walk, wave] = &clauses[0].actions[..] else {
            panic!("{clauses:?}")
        };
        assert_eq!(
            (walk.side, walk.direction),
            (None, Some(Direction::Backward))
        );
        assert_eq!((wave.side, wave.direction), (Some(Side::Left), None));
        let turn = &parse("a person spins around to the right")[0].actions[0];
        assert_eq!((turn.side, turn.direction), (None, Some(Direction::Right)));
        for both in [
            "a person throws hooks with alternating hands",
            "a person throws punches with the left and right hand two times",
        ] {
            assert_eq!(parse(both)[0].actions[0].side, Some(Side::Both), "{both}");
        }
    }

    #[test]
    fn clauses_are_sentences_of_their_own() {
        let sentences = |text: &str| parse(text).iter().map(Clause::sentence).collect::<Vec<_>>();
        for (text, expected) in [
            (
                "someone first walks and then sits down",
                ["a person walks", "a person sits down"],
            ),
            (
                "after sitting down, a person waves",
                ["a person is sitting down", "a person waves"],
            ),
            (
                "this person slowly bows before waving",
                ["a person slowly bows", "a person is waving"],
            ),
        ] {
            assert_eq!(sentences(text), expected);
        }
        assert_eq!(sentences("a person is walking"), ["a person is walking"]);
    }

    #[test]
    fn counts_can_be_left_out() {
        for (text, expected) in [
            ("a person claps three times", "a person claps"),
            (
                "a person quickly waves twice with the left hand",
                "a person quickly waves with the left hand",
            ),
            (
                "a person marches in place for eight steps",
                "a person marches in place",
            ),
            ("a person jumps many times", "a person jumps"),
            (
                "a person steps over something",
                "a person steps over something",
            ),
        ] {
            assert_eq!(parse(text)[0].without_count().text, expected);
        }
    }

    #[test]
    fn unknown_words_state_nothing() {
        for sentence in [
            "",
            "no person seen",
            "a person performs a cartwheel",
            "..., then ",
        ] {
            assert!(names(sentence).iter().all(Vec::is_empty), "{sentence}");
        }
    }
}
