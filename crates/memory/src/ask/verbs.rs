//! Actions to verbs and verbs to actions.

use radarllm_facts::{parse, tables::action_words};

use super::words::is_filler;

/// Actions that a verb names besides the one of the lexicon: who sits has sat down, who paces walks.
const INCLUDED: [(&str, &[&str]); 3] = [
    ("sit_still", &["sit_down"]),
    ("lie_still", &["lie_down"]),
    ("walk", &["pace", "circle", "limp"]),
];

/// Past forms that the lexicon, which is made for captions in the present tense, does not have, and words of questions that
/// no caption has: whoever wakes up is seen to get up, and an alarm is about a fall.
const PAST_FORMS: [(&str, &str); 36] = [
    ("wake", "get"),
    ("wakes", "get"),
    ("woke", "get"),
    ("woken", "get"),
    ("alarm", "fall"),
    ("alarms", "fall"),
    ("got", "get"),
    ("gotten", "get"),
    ("stood", "stand"),
    ("sat", "sit"),
    ("lay", "lie"),
    ("lain", "lie"),
    ("laid", "lie"),
    ("knelt", "kneel"),
    ("bent", "bend"),
    ("ran", "run"),
    ("drank", "drink"),
    ("drunk", "drink"),
    ("threw", "throw"),
    ("thrown", "throw"),
    ("took", "take"),
    ("taken", "take"),
    ("rose", "rise"),
    ("risen", "rise"),
    ("swung", "swing"),
    ("went", "go"),
    ("gone", "go"),
    ("made", "make"),
    ("held", "hold"),
    ("spun", "spin"),
    ("jogged", "jog"),
    ("rolled", "roll"),
    ("stepped", "step"),
    ("boxed", "box"),
    ("moved", "move"),
    ("carried", "carry"),
];

/// Words after a verb that give it another meaning.
const OTHER_MEANINGS: [(&[&str], &[&str]); 2] = [
    (
        &["fall", "falls", "falling", "fell", "fallen"],
        &["asleep", "ill", "sick", "silent", "quiet", "behind"],
    ),
    (&["turn", "turns", "turned", "turning"], &["on", "off"]),
];

/// The actions that a verb phrase names.
#[derive(Clone, Debug, PartialEq, Eq, Default)]
pub(super) struct Named {
    /// Their names: first what was asked for, then what it includes.
    pub actions: Vec<String>,
    /// How many of the names were asked for.
    pub n_asked: usize,
    /// Words that no action needs and that are no fillers.
    pub ignored: Vec<String>,
}

/// Why a verb phrase names no action.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Unnamed {
    /// No word of it states an action.
    Nothing,
    /// It states a sequence or a combination of actions.
    Several,
}

/// The actions of alternatives ("walk or sit down"). Each names one.
pub(super) fn actions(words: &[String]) -> Result<Named, Unnamed> {
    let words = present_tense(words);
    if has_other_meaning(&words) {
        return Err(Unnamed::Nothing);
    }
    let mut named = Named::default();
    for piece in words.split(|w| *w == "or") {
        match action(piece)? {
            Some(name) if named.actions.iter().all(|a| a != name) => {
                named.actions.push(name.into());
            }
            Some(_) => {}
            // "He or she".
            None if piece.iter().all(|w| is_filler(w)) => continue,
            None => return Err(Unnamed::Nothing),
        }
        named.ignored.extend(ignored(piece));
    }
    named.n_asked = named.actions.len();
    for (name, included) in INCLUDED {
        if named.actions.iter().any(|a| a == name) {
            let more = included.iter().map(|a| a.to_string());
            let more: Vec<String> = more.filter(|a| !named.actions.contains(a)).collect();
            named.actions.extend(more);
        }
    }
    match named.n_asked {
        0 => Err(Unnamed::Nothing),
        _ => Ok(named),
    }
}

/// Completes "was up", which is to have got up.
pub(super) fn complete(words: &mut Vec<String>) {
    let up = words.iter().position(|w| w == "up");
    let is_incomplete = words.iter().all(|w| w == "up" || is_filler(w));
    if let Some(up) = up.filter(|_| is_incomplete) {
        words.insert(up, "get".into());
    }
}

/// The one action of a phrase.
fn action(words: &[&str]) -> Result<Option<&'static str>, Unnamed> {
    let clauses = parse(&words.join(" "));
    let mut actions = clauses.iter().flat_map(|c| &c.actions);
    match (actions.next(), actions.next()) {
        (Some(action), None) => Ok(Some(action.name)),
        (None, _) => Ok(None),
        (Some(_), Some(_)) => Err(Unnamed::Several),
    }
}

/// The words that no action needs, without fillers. Of "raise a hand and wave", which is to wave, no word is left over:
/// without "wave" the others state an action as well.
fn ignored(words: &[&str]) -> Vec<String> {
    let Ok(Some(name)) = action(words) else {
        let content = words.iter().filter(|w| !is_filler(w));
        return content.map(ToString::to_string).collect();
    };
    let is_needed = |i: usize| action(&[&words[..i], &words[i + 1..]].concat()) != Ok(Some(name));
    let rest: Vec<&str> = (0..words.len())
        .filter(|i| !is_needed(*i))
        .map(|i| words[i])
        .collect();
    match rest.len() < words.len() {
        true => ignored(&rest),
        // The same action twice: "walk, walk".
        false => Vec::new(),
    }
}

fn present_tense(words: &[String]) -> Vec<&str> {
    let mut present = Vec::with_capacity(words.len());
    for word in words {
        let known = PAST_FORMS.iter().find(|(form, _)| form == word);
        present.push(known.map_or(word.as_str(), |(_, infinitive)| infinitive));
        // "Get out of bed" is to get up.
        if let [.., get, "out", "of", "bed"] = present[..]
            && get.starts_with("get")
        {
            present.truncate(present.len() - 3);
            present.push("up");
        }
        // "Go to bed" is to lie down.
        if let [.., go, "to", "bed"] = present[..]
            && ["go", "goes", "going"].contains(&go)
        {
            present.truncate(present.len() - 3);
            present.extend(["lie", "down"]);
        }
    }
    present
}

fn has_other_meaning(words: &[&str]) -> bool {
    words.windows(2).any(|pair| {
        let changes = |(verbs, after): &(&[&str], &[&str])| {
            verbs.contains(&pair[0]) && after.contains(&pair[1])
        };
        OTHER_MEANINGS.iter().any(changes)
    })
}

/// The infinitive of an action: "get up".
pub(super) fn infinitive(action: &str) -> String {
    match action_words(action).and_then(|words| words.infinitive) {
        Some(infinitive) => infinitive.to_string(),
        None => format!("do \u{201c}{}\u{201d}", action.replace('_', " ")),
    }
}

/// The past tense of an action: "got up".
pub(super) fn past(action: &str) -> String {
    match action_words(action).and_then(|words| words.past) {
        Some(past) => past.to_string(),
        None => format!("did \u{201c}{}\u{201d}", action.replace('_', " ")),
    }
}

#[cfg(test)]
mod tests {
    use radarllm_facts::tables::all_actions;

    use super::*;

    fn named(phrase: &str) -> Result<Named, Unnamed> {
        actions(&super::super::words::split(phrase))
    }

    #[test]
    fn the_verbs_of_every_action_name_it() {
        for action in all_actions() {
            for form in [action.infinitive, action.past].into_iter().flatten() {
                let found = named(form).unwrap_or_else(|e| panic!("{form}: {e:?}"));
                assert_eq!(found.actions[0], action.name, "{form}");
                assert_eq!(found.n_asked, 1, "{form}");
            }
        }
    }

    #[test]
    fn alternatives_are_united_and_sequences_refused() {
        let both = named("walk or get up").unwrap();
        assert_eq!(both.actions, ["walk", "stand_up", "pace", "circle", "limp"]);
        assert_eq!(both.n_asked, 2);
        assert_eq!(named("he or she fell").unwrap().actions, ["fall"]);
        assert_eq!(named("walk and sit down"), Err(Unnamed::Several));
        assert_eq!(named("walk while waving"), Err(Unnamed::Several));
        assert_eq!(named("sit down then wave"), Err(Unnamed::Several));
        for phrase in [
            "eat",
            "",
            "she",
            "fall asleep",
            "turn on the light",
            "walk or eat",
            "or",
        ] {
            assert_eq!(named(phrase), Err(Unnamed::Nothing), "{phrase}");
        }
        assert_eq!(named("raise a hand and wave").unwrap().actions, ["wave"]);
    }

    #[test]
    fn words_that_no_action_needs_are_named() {
        for (phrase, expected) in [
            ("did she get up", vec![]),
            ("anna slowly got up", vec!["anna", "slowly"]),
            ("wave the left hand", vec!["left", "hand"]),
            ("pick something up", vec![]),
            ("raise a hand and wave", vec![]),
            ("anna raise a hand and wave", vec!["anna"]),
            ("walk walk", vec![]),
        ] {
            assert_eq!(named(phrase).unwrap().ignored, expected, "{phrase}");
        }
        assert_eq!(named("got out of bed").unwrap().actions, ["stand_up"]);
    }

    #[test]
    fn unknown_actions_keep_their_names() {
        assert_eq!(
            infinitive("do_the_dishes"),
            "do \u{201c}do the dishes\u{201d}"
        );
        assert_eq!(past("yoga"), "did \u{201c}yoga\u{201d}");
    }
}
