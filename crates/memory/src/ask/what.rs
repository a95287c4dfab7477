//! Questions to their meaning.

use serde::{Deserialize, Serialize};

use super::verbs::{self, Unnamed};
use super::when::{self, Clock, When};
use super::words;

/// Most words of a question that the grammar reads.
const MAX_WORDS: usize = 40;

/// What a question asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// When it happened last.
    Last,
    /// When it happened first.
    First,
    /// All times at which it happened.
    When,
    /// How many times it happened.
    HowOften,
    /// How long it lasted in all.
    HowLong,
    /// Whether it happened.
    Did,
}

/// The meaning of a question.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Understood {
    /// What is asked about what.
    pub what: What,
    /// When.
    pub when: When,
    /// Words of the question that were not considered: names, manners, places.
    pub ignored: Vec<String>,
}

impl Understood {
    /// The meaning of a question about one action, or about an event or a topic that takes its place.
    pub(super) fn about(kind: Kind, action: &str, when: When) -> Self {
        Self {
            what: What {
                kind,
                actions: vec![action.into()],
                n_asked: 1,
            },
            when,
            ignored: Vec::new(),
        }
    }
}

/// What is asked about what.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct What {
    /// The question.
    pub kind: Kind,
    /// Names of the actions that count: first those that were asked for, then those that they include.
    pub actions: Vec<String>,
    /// How many of the actions were asked for.
    pub n_asked: usize,
}

/// A question outside the grammar.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct NotUnderstood {
    /// Why, as a clause: "it names no known action".
    pub why: &'static str,
    /// The time, as far as it was understood.
    pub when: When,
    /// The words that are worth a search.
    pub words: Vec<String>,
}

/// The meaning of a question.
pub(super) fn understand(question: &str, clock: &Clock) -> Result<Understood, NotUnderstood> {
    let mut rest = words::split(question);
    let n_words = rest.len();
    let when = when::take(&mut rest, clock);
    let of_interest = |rest: &[String]| {
        let is_content = |w: &&String| !words::is_filler(w) && !words::is_question_word(w);
        rest.iter().filter(is_content).cloned().collect()
    };
    let refuse = |why: &'static str, when: When, rest: &[String]| NotUnderstood {
        why,
        when,
        words: of_interest(rest),
    };
    if n_words > MAX_WORDS {
        return Err(refuse("it has too many words", when, &rest));
    }
    if when.from_ms.is_some_and(|from_ms| from_ms >= when.to_ms) {
        return Err(refuse("its time has not begun", clock.always(), &rest));
    }
    if rest.iter().any(|w| words::is_comparison(w)) {
        return Err(refuse("it compares times with each other", when, &rest));
    }
    words::remove(&mut rest, &["can", "you", "tell", "me"]);
    if rest.iter().any(|w| words::is_negation(w)) {
        return Err(refuse(
            "it asks for what did not happen, or for what is usual",
            when,
            &rest,
        ));
    }
    let manner = take_manner(&mut rest);
    let kind = match manner {
        Some(_) => Some(Kind::When),
        None => take_kind(&mut rest),
    };
    let Some(kind) = kind else {
        let why = "it does not ask when, how often, how long or whether";
        return Err(refuse(why, when, &rest));
    };
    if rest.iter().any(|w| words::is_time_word(w)) {
        return Err(refuse(
            "it names a time in words that are not known",
            when,
            &rest,
        ));
    }
    if rest.iter().any(|w| words::is_question_word(w)) {
        return Err(refuse("it asks for several things", when, &rest));
    }
    // For how long somebody was up is not known from the times of getting up.
    if kind != Kind::HowLong {
        verbs::complete(&mut rest);
    }
    match verbs::actions(&rest) {
        Ok(named) => Ok(Understood {
            what: What {
                kind,
                actions: named.actions,
                n_asked: named.n_asked,
            },
            when,
            ignored: manner.into_iter().chain(named.ignored).collect(),
        }),
        Err(Unnamed::Nothing) => Err(refuse("it names no known action", when, &rest)),
        Err(Unnamed::Several) => Err(refuse("it names a combination of actions", when, &rest)),
    }
}

/// Takes "where", "how" or "who" of "where did she fall": what the memory does not tell, unlike when it happened.
fn take_manner(rest: &mut Vec<String>) -> Option<String> {
    let past = ["did", "has", "have", "had", "was", "were"];
    let is_past = |i: usize| rest.get(i).is_some_and(|w| past.contains(&w.as_str()));
    let is_manner = match rest.first()?.as_str() {
        "where" | "how" => is_past(1),
        // "Who fell", and not "who she fell with".
        "who" => is_past(1) || verbs::actions(&rest[1..]).is_ok(),
        _ => false,
    };
    is_manner.then(|| rest.remove(0))
}

/// Takes the words that say what is asked for.
fn take_kind(rest: &mut Vec<String>) -> Option<Kind> {
    let is_long_ago = words::remove(rest, &["how", "long", "ago"])
        || words::remove(rest, &["how", "long", "since"])
        || words::remove(rest, &["how", "long", "is", "it", "since"])
        || words::remove(rest, &["how", "long", "has", "it", "been", "since"]);
    if is_long_ago {
        words::remove(rest, &["last"]);
        return Some(Kind::Last);
    }
    if words::remove(rest, &["how", "many", "falls"])
        || words::remove(rest, &["how", "many", "alarms"])
        || words::remove(rest, &["number", "of", "falls"])
    {
        *rest = vec!["fall".into()];
        return Some(Kind::HowOften);
    }
    if words::remove(rest, &["how", "often"])
        || words::remove(rest, &["how", "many", "times"])
        || words::remove(rest, &["how", "frequently"])
    {
        return Some(Kind::HowOften);
    }
    if words::remove(rest, &["how", "long"])
        || words::remove(rest, &["how", "much", "time"])
        || words::remove(rest, &["how", "many", "minutes"])
        || words::remove(rest, &["how", "many", "hours"])
    {
        return Some(Kind::HowLong);
    }
    let is_when = words::remove(rest, &["when"])
        || words::remove(rest, &["at", "what", "time"])
        || words::remove(rest, &["what", "time"]);
    if words::remove(rest, &["last"]) {
        words::remove(rest, &["what"]);
        return Some(Kind::Last);
    }
    if words::remove(rest, &["first"]) {
        words::remove(rest, &["what"]);
        return Some(Kind::First);
    }
    if is_when {
        return Some(Kind::When);
    }
    // "Any falls", "was there an alarm", "whether she fell".
    let is_noun = |w: &String| ["falls", "alarm", "alarms"].contains(&w.as_str());
    if rest.iter().any(is_noun) {
        rest.retain(|w| !words::is_filler(w));
        return Some(Kind::Did);
    }
    if ["whether", "if"].contains(&rest.first()?.as_str()) {
        rest.remove(0);
        return Some(Kind::Did);
    }
    // "Is she walking" asks about the present.
    let past = ["did", "has", "have", "had", "was", "were"];
    let first = rest.first()?;
    past.contains(&first.as_str()).then_some(Kind::Did)
}
