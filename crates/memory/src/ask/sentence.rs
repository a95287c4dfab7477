//! Answers as sentences.

use super::known::open_fall;
use super::what::{Kind, Understood};
use super::when::{Clock, KNOWN_TIMES};
use super::{Answer, Found, verbs, words};
use crate::store::falls::Fall;

/// Most times that a sentence names one by one.
const MAX_TIMES: usize = 5;

/// Said with every answer that is about a person.
pub(super) const NOBODY_IDENTIFIED: &str = "Nobody is identified: this is about whoever was there.";
/// Said with every answer about a simulated radar.
pub(super) const SIMULATED: &str = "The radar was simulated.";
/// Said with every answer about falls.
pub(super) const NO_MEDICAL_DEVICE: &str = "This is not a medical device.";

/// The sentences for a question that was understood.
pub(super) fn answer(understood: &Understood, found: &Found, clock: &Clock) -> String {
    let mut sentences = facts(understood, found, clock);
    if found.count > 0 {
        sentences.extend(found.coverage.only(clock));
    }
    let ignored: Vec<String> = (understood.ignored.iter())
        .filter(|word| found.floor.is_empty() || !words::is_floor(word))
        .map(|word| format!("\u{201c}{word}\u{201d}"))
        .collect();
    if !ignored.is_empty() {
        let ignored = list(ignored.into_iter(), "and");
        sentences.push(format!("Not considered: {ignored}."));
    }
    if found.synthetic {
        sentences.push(SIMULATED.into());
    }
    sentences.push(NOBODY_IDENTIFIED.into());
    if found.is_about_falls {
        sentences.push(NO_MEDICAL_DEVICE.into());
    }
    sentences.join(" ")
}

/// The sentences about what was found.
pub(super) fn facts(understood: &Understood, found: &Found, clock: &Clock) -> Vec<String> {
    let what = &understood.what;
    let asked = &what.actions[..what.n_asked.min(what.actions.len())];
    let past = list(asked.iter().map(|a| verbs::past(a)), "or");
    let phrase = match understood.when.phrase.as_str() {
        "" => String::new(),
        phrase => format!(" {phrase}"),
    };
    let times = times(found.count);
    let (first, last) = (
        found
            .first_ms
            .map(|ms| clock.moment(ms))
            .unwrap_or_default(),
        found.last_ms.map(|ms| clock.moment(ms)).unwrap_or_default(),
    );
    let floor = floor(found, &phrase, clock);
    let mut sentences = match (what.kind, found.count) {
        (Kind::Did, _) if found.is_floor => vec!["Yes.".into()],
        _ if found.is_floor => Vec::new(),
        (_, 0) => denial(understood, found, &phrase, clock),
        (Kind::Did, 1) => vec![format!("Yes: someone {past} once{phrase}, at {last}.")],
        (Kind::Did, _) => vec![format!(
            "Yes: someone {past} {times}{phrase}, last at {last}."
        )],
        // How long somebody rose is not known.
        (Kind::HowLong, _) if found.total_ms == 0 => {
            vec![format!("Someone {past} {times}{phrase}, last at {last}.")]
        }
        (Kind::HowLong, 1) => {
            let total = duration(found.total_ms);
            vec![format!("Someone {past} for {total}{phrase}, at {last}.")]
        }
        (Kind::HowLong, n) => vec![format!(
            "Someone {past} for {total} in all{phrase}, in {n} stretches, the longest of {longest}.",
            total = duration(found.total_ms),
            longest = duration(found.longest_ms),
        )],
        (_, 1) => vec![format!("Someone {past} once{phrase}, at {last}.")],
        (Kind::Last, _) => vec![format!(
            "Someone last {past} at {last}, {times} in all{phrase}."
        )],
        (Kind::First, _) => vec![format!(
            "Someone first {past} at {first}, {times} in all{phrase}."
        )],
        (Kind::When, n)
            if n as usize == found.times_ms.len() && found.times_ms.len() <= MAX_TIMES =>
        {
            let at = list(found.times_ms.iter().map(|ms| clock.moment(*ms)), "and");
            vec![format!("Someone {past} {times}{phrase}: at {at}.")]
        }
        (Kind::When, _) => vec![format!(
            "Someone {past} {times}{phrase}, first at {first} and last at {last}."
        )],
        (Kind::HowOften, _) => vec![format!("Someone {past} {times}{phrase}, last at {last}.")],
    };
    sentences.extend(floor);
    if found.count > 0 && found.is_about_falls {
        sentences.extend(falls(found, clock));
    }
    sentences
}

/// The sentences where nothing was found. Only of a time in which somebody watched is anything denied.
fn denial(understood: &Understood, found: &Found, phrase: &str, clock: &Clock) -> Vec<String> {
    let open = found.falls.iter().filter(|fall| fall.is_suspicion());
    let mut sentences: Vec<String> = open
        .map(|fall| open_fall(fall, !found.coverage.goes_on(fall.at_ms, clock), clock))
        .collect();
    if !sentences.is_empty() {
        sentences.extend(dismissed(found, clock).map(|text| format!("{text}.")));
        sentences.extend(found.coverage.only(clock));
        return sentences;
    }
    if found.coverage.is_nothing() {
        return vec![found.coverage.nothing(clock)];
    }
    let what = &understood.what;
    let asked = &what.actions[..what.n_asked.min(what.actions.len())];
    let infinitive = list(asked.iter().map(|a| verbs::infinitive(a)), "or");
    let far = found.coverage.as_far(clock);
    let nobody = format!("obody was seen to {infinitive}{phrase}{far}.");
    let mut sentences = vec![match what.kind {
        Kind::Did => format!("No: n{nobody}"),
        _ => format!("N{nobody}"),
    }];
    sentences.extend(dismissed(found, clock).map(|text| format!("{text}.")));
    sentences.extend(found.open_before.iter().map(|fall| {
        let has_run_ended = !found.coverage.goes_on(fall.at_ms, clock);
        open_fall(fall, has_run_ended, clock)
    }));
    sentences
}

/// What is to be said of falls besides their number and their times.
fn falls(found: &Found, clock: &Clock) -> Vec<String> {
    let mut sentences = Vec::new();
    let confirmed = || {
        found
            .falls
            .iter()
            .filter(|fall| fall.confirmed_ms.is_some())
    };
    let n_alarms = confirmed().count() as u64;
    if n_alarms > 0 {
        sentences.push(format!("The fall alarm was confirmed {}.", times(n_alarms)));
    }
    if let Some(fall) = confirmed().next_back() {
        let fell = clock.moment(fall.at_ms);
        sentences.push(match (fall.risen_ms(), fall.end) {
            (Some(risen_ms), _) => format!(
                "Whoever fell at {fell} got up at {}, after {}.",
                clock.moment(risen_ms),
                duration(risen_ms - fall.at_ms)
            ),
            (None, Some(end)) => {
                format!("The alarm was acknowledged at {}.", clock.moment(end.at_ms))
            }
            (None, None) => open_fall(fall, false, clock),
        });
    }
    for fall in found.falls.iter().filter(|fall| fall.is_suspicion()) {
        let has_ended = !found.coverage.goes_on(fall.at_ms, clock);
        sentences.push(open_fall(fall, has_ended, clock));
    }
    sentences.extend(dismissed(found, clock).map(|text| format!("{text}.")));
    sentences
}

/// What is to be said of suspicions that were dismissed, without its full stop.
pub(super) fn dismissed(found: &Found, clock: &Clock) -> Option<String> {
    let dismissed: Vec<&Fall> = found.falls.iter().filter(|f| f.is_dismissed()).collect();
    let at = |fall: &Fall| clock.moment(fall.at_ms);
    match &dismissed[..] {
        [] => None,
        [one] => {
            let is_acknowledged = one.end.is_some_and(|end| end.is_acknowledged);
            let why = match is_acknowledged {
                true => "as no fall",
                false => "because the person rose",
            };
            Some(format!(
                "A suspected fall at {} was dismissed {why}",
                at(one)
            ))
        }
        many if many.len() <= MAX_TIMES => Some(format!(
            "Suspected falls at {} were dismissed",
            list(many.iter().map(|fall| at(fall)), "and")
        )),
        [.., last] => Some(format!(
            "{} suspected falls were dismissed, the last one at {}",
            dismissed.len(),
            at(last)
        )),
    }
}

/// The sentence about the time on the floor after falls, if there were some.
fn floor(found: &Found, phrase: &str, clock: &Clock) -> Option<String> {
    let total = duration(found.floor.iter().map(|s| s.end_ms - s.start_ms).sum());
    match &found.floor[..] {
        [] => None,
        [one] => Some(format!(
            "After a fall, someone lay on the floor for {total}{phrase}, {}.",
            clock.between(one.start_ms, one.end_ms)
        )),
        [.., last] => Some(format!(
            "After {} falls, someone lay on the floor for {total} in all{phrase}, last {}.",
            found.floor.len(),
            clock.between(last.start_ms, last.end_ms)
        )),
    }
}

/// The sentences for a question that was not understood.
pub(super) fn searched(why: &str, answer: &Answer, clock: &Clock) -> String {
    const EXAMPLES: &str = "Understood are questions such as \u{201c}when did she last get up?\u{201d}, \u{201c}how often \
         did she sit down today?\u{201d}, \u{201c}did she fall since 22:00?\u{201d}, \u{201c}how long did she walk \
         yesterday?\u{201d}, \u{201c}is anybody there?\u{201d}, \u{201c}how long was the room empty?\u{201d}, \u{201c}what is \
         she doing?\u{201d}, \u{201c}what happened last night?\u{201d} and \u{201c}is the radar working?\u{201d}.";
    let mut sentences = vec![format!("The question was not understood: {why}.")];
    if let Some(searched) = answer.searched.as_ref().filter(|_| answer.count > 0) {
        let words = searched
            .words
            .iter()
            .map(|w| format!("\u{201c}{w}\u{201d}"));
        let words = list(words, "and");
        let phrase = match searched.when.phrase.as_str() {
            "" => String::new(),
            phrase => format!(" {phrase}"),
        };
        let found = match (answer.count, answer.last_ms) {
            (1, Some(ms)) => {
                format!("One sentence{phrase} has {words}, of {}.", clock.moment(ms))
            }
            (n, Some(ms)) => {
                let last = clock.moment(ms);
                format!("{n} sentences{phrase} have {words}, the last one of {last}.")
            }
            (n, None) => format!("{n} sentences{phrase} have {words}."),
        };
        sentences.push(format!("Instead the sentences were searched. {found}"));
        if answer.synthetic {
            sentences.push(SIMULATED.into());
        }
        sentences.push(NOBODY_IDENTIFIED.into());
    }
    sentences.push(EXAMPLES.into());
    sentences.push(KNOWN_TIMES.into());
    sentences.join(" ")
}

pub(super) fn times(n: u64) -> String {
    match n {
        1 => "once".into(),
        2 => "twice".into(),
        n => format!("{n} times"),
    }
}

/// "a", "a or b", "a, b or c".
pub(super) fn list(items: impl Iterator<Item = String>, conjunction: &str) -> String {
    let mut items: Vec<String> = items.collect();
    match (items.pop(), items.is_empty()) {
        (None, _) => String::new(),
        (Some(only), true) => only,
        (Some(last), false) => format!("{} {conjunction} {last}", items.join(", ")),
    }
}

/// A duration to the second below ten minutes, to the minute above.
pub(super) fn duration(ms: i64) -> String {
    // Half a second rounds up.
    let s = ms.saturating_add(500) / 1_000;
    let minutes = s.saturating_add(30) / 60;
    match (s, minutes) {
        (..60, _) => format!("{s} s"),
        (..600, _) if s % 60 == 0 => format!("{} min", s / 60),
        (..600, _) => format!("{} min {} s", s / 60, s % 60),
        (_, ..60) => format!("{minutes} min"),
        (_, minutes) if minutes % 60 == 0 => format!("{} h", minutes / 60),
        (_, minutes) => format!("{} h {} min", minutes / 60, minutes % 60),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_have_one_or_two_units() {
        for (ms, expected) in [
            (0, "0 s"),
            (499, "0 s"),
            (59_499, "59 s"),
            (59_500, "1 min"),
            (91_800, "1 min 32 s"),
            (599_499, "9 min 59 s"),
            (629_000, "10 min"),
            (3_569_000, "59 min"),
            (3_570_000, "1 h"),
            (7_980_000, "2 h 13 min"),
            (i64::MAX, "2562047788015 h 13 min"),
        ] {
            assert_eq!(duration(ms), expected, "{ms}");
        }
    }

    #[test]
    fn lists_have_one_conjunction() {
        let of = |n: usize| {
            list(
                ["a", "b", "c"].iter().take(n).map(ToString::to_string),
                "or",
            )
        };
        assert_eq!(
            [of(0), of(1), of(2), of(3)],
            ["", "a", "a or b", "a, b or c"]
        );
    }
}
