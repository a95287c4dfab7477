//! Sentences to clauses.

use crate::lexicon::{MAX_GAP, PATTERNS};

/// A part of a sentence that covers one stretch of time.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Clause {
    /// The words, in lower case.
    pub text: String,
    /// The actions that happen in this stretch, in the order in which they are named. Several happen at once
    /// ("walks while waving"). Empty if no action is recognised.
    pub actions: Vec<Action>,
}

/// An action with its attributes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Action {
    /// Name, for example `sit_down`.
    pub name: &'static str,
    /// The acting side of the body, if the sentence states it.
    pub side: Option<Side>,
    /// The direction, if the sentence states it.
    pub direction: Option<Direction>,
}

/// The acting side of the body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// The person's left.
    Left,
    /// The person's right.
    Right,
    /// Both sides.
    Both,
}

/// A direction as seen by the person.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// To the front.
    Forward,
    /// To the back.
    Backward,
    /// To the left; also counterclockwise.
    Left,
    /// To the right; also clockwise.
    Right,
    /// Up.
    Up,
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

/// Parts of the body whose side is the acting side.
const LIMBS: [&str; 12] = [
    "hand", "hands", "arm", "arms", "fist", "fists", "leg", "legs", "foot", "feet", "knee", "ear",
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
    parts
        .into_iter()
        .flat_map(in_order_of_time)
        .map(clause)
        .collect()
}

/// Splits at "before" and "after".
fn in_order_of_time(part: &str) -> Vec<&str> {
    if let Some(rest) = part.strip_prefix("after ")
        && let Some((first, second)) = rest.split_once(',')
    {
        return vec![first, second];
    }
    if let Some((first, second)) = part.split_once(" before ") {
        return vec![first, second];
    }
    match part.split_once(" after ") {
        // "Faces to the left after a quarter turn" is one action.
        Some((second, first)) if !first.ends_with("turn") => vec![first, second],
        _ => vec![part],
    }
}

fn clause(text: &str) -> Clause {
    let mut actions: Vec<Action> = Vec::new();
    for part in text.split(" while ") {
        let words: Vec<&str> = part
            .split(|c: char| c.is_whitespace() || c == ',')
            .map(|w| w.trim_matches(|c: char| !c.is_alphanumeric()))
            .filter(|w| !w.is_empty())
            .collect();
        let mut found: Vec<(usize, &'static str)> = Vec::new();
        let mut used = vec![false; words.len()];
        for pattern in PATTERNS {
            while let Some(at) = find(&words, &used, pattern.words) {
                at.iter().for_each(|i| used[*i] = true);
                if found.iter().all(|(_, name)| *name != pattern.action) {
                    found.push((at[0], pattern.action));
                }
            }
        }
        found.sort_unstable();
        for (i, (start, name)) in found.iter().enumerate() {
            // Attributes stand between an action and the next one. Those before the first belong to it.
            let from = if i == 0 { 0 } else { *start };
            let to = found.get(i + 1).map_or(words.len(), |next| next.0);
            let own = &words[from..to];
            if actions.iter().all(|a| a.name != *name) {
                actions.push(Action {
                    name,
                    side: side(own),
                    direction: direction(own),
                });
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

/// Positions of the words of a pattern among the unused words of a clause.
fn find(words: &[&str], used: &[bool], pattern: &str) -> Option<Vec<usize>> {
    let pattern: Vec<&str> = pattern.split(' ').collect();
    (0..words.len()).find_map(|start| {
        let mut at = Vec::with_capacity(pattern.len());
        let mut next = start..start + 1;
        for word in &pattern {
            let (word, adjacent) = match word.strip_prefix('+') {
                Some(word) => (word, true),
                None => (*word, false),
            };
            if adjacent {
                next.end = next.end.min(next.start + 1);
            }
            let end = next.end.min(words.len());
            let found = (next.start..end).find(|i| !used[*i] && matches(words[*i], word))?;
            at.push(found);
            next = found + 1..found + 2 + MAX_GAP;
        }
        Some(at)
    })
}

fn matches(word: &str, alternatives: &str) -> bool {
    alternatives.split('|').any(|a| match a.strip_suffix('*') {
        Some(start) => word.starts_with(start),
        None => word == a,
    })
}

fn side(words: &[&str]) -> Option<Side> {
    let with_limb = |side: &str| {
        words.iter().enumerate().any(|(i, w)| {
            *w == side
                && words[i + 1..]
                    .iter()
                    .take(2)
                    .any(|next| LIMBS.contains(next))
        })
    };
    let alternating = words.contains(&"alternating");
    match (with_limb("left"), with_limb("right")) {
        _ if with_limb("both") || alternating => Some(Side::Both),
        (true, true) => Some(Side::Both),
        (true, false) => Some(Side::Left),
        (false, true) => Some(Side::Right),
        (false, false) => None,
    }
}

fn direction(words: &[&str]) -> Option<Direction> {
    let to_the = |side: &str| words.windows(3).any(|w| w == ["to", "the", side]);
    for (i, word) in words.iter().enumerate() {
        let direction = match *word {
            "forward" | "forwards" | "ahead" => Direction::Forward,
            "backward" | "backwards" | "reverse" => Direction::Backward,
            "counterclockwise" | "anticlockwise" => Direction::Left,
            "clockwise" => Direction::Right,
            "upward" | "upwards" | "overhead" => Direction::Up,
            "to" if to_the("left") && words.get(i + 2) == Some(&"left") => Direction::Left,
            "to" if to_the("right") && words.get(i + 2) == Some(&"right") => Direction::Right,
            _ => continue,
        };
        return Some(direction);
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

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
        assert_eq!(
            names("a person walks while waving both hands, then kicks, and finally bows"),
            [vec!["walk", "wave"], vec!["kick"], vec!["bow"]]
        );
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
        let hook = &parse("a person throws hooks with alternating hands")[0].actions[0];
        assert_eq!(hook.side, Some(Side::Both));
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
