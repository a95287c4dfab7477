//! Answers as sentences.

use super::what::{Kind, Understood};
use super::when::Clock;
use super::{Answer, Found, verbs};

/// Most times that a sentence names one by one.
const MAX_TIMES: usize = 5;

/// Said with every answer that is about a person.
pub(super) const NOBODY_IDENTIFIED: &str = "Nobody is identified: this is about whoever was there.";
/// Said with every answer about falls.
const NO_MEDICAL_DEVICE: &str = "This is not a medical device.";

/// The sentences for a question that was understood.
pub(super) fn answer(understood: &Understood, found: &Found, clock: &Clock) -> String {
    let what = &understood.what;
    let asked = &what.actions[..what.n_asked.min(what.actions.len())];
    let infinitive = list(asked.iter().map(|a| verbs::infinitive(a)), "or");
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
    let mut sentences = vec![match (what.kind, found.count) {
        (Kind::Did, 0) => format!("No: nobody was seen to {infinitive}{phrase}."),
        (_, 0) => format!("Nobody was seen to {infinitive}{phrase}."),
        (Kind::Did, 1) => format!("Yes: someone {past} once{phrase}, at {last}."),
        (Kind::Did, _) => format!("Yes: someone {past} {times}{phrase}, last at {last}."),
        (Kind::HowLong, 1) => {
            let total = duration(found.total_ms);
            format!("Someone {past} for {total}{phrase}, at {last}.")
        }
        (Kind::HowLong, n) => format!(
            "Someone {past} for {total} in all{phrase}, in {n} stretches, the longest of {longest}.",
            total = duration(found.total_ms),
            longest = duration(found.longest_ms),
        ),
        (_, 1) => format!("Someone {past} once{phrase}, at {last}."),
        (Kind::Last, _) => format!("Someone last {past} at {last}, {times} in all{phrase}."),
        (Kind::First, _) => format!("Someone first {past} at {first}, {times} in all{phrase}."),
        (Kind::When, n)
            if n as usize == found.times_ms.len() && found.times_ms.len() <= MAX_TIMES =>
        {
            let at = list(found.times_ms.iter().map(|ms| clock.moment(*ms)), "and");
            format!("Someone {past} {times}{phrase}: at {at}.")
        }
        (Kind::When, _) => {
            format!("Someone {past} {times}{phrase}, first at {first} and last at {last}.")
        }
        (Kind::HowOften, _) => format!("Someone {past} {times}{phrase}, last at {last}."),
    }];
    if found.n_alarms > 0 {
        let alarms = self::times(found.n_alarms);
        sentences.push(format!("The fall alarm was confirmed {alarms}."));
    }
    match found.oldest_ms {
        None => sentences.push("The memory is empty.".into()),
        Some(ms) if understood.when.from_ms.is_none_or(|from_ms| ms > from_ms) => {
            sentences.push(format!("The memory begins at {}.", clock.moment(ms)));
        }
        Some(_) => {}
    }
    if !understood.ignored.is_empty() {
        let ignored = understood
            .ignored
            .iter()
            .map(|w| format!("\u{201c}{w}\u{201d}"));
        sentences.push(format!("Not considered: {}.", list(ignored, "and")));
    }
    if found.synthetic {
        sentences.push("The radar was simulated.".into());
    }
    sentences.push(NOBODY_IDENTIFIED.into());
    if found.is_about_falls {
        sentences.push(NO_MEDICAL_DEVICE.into());
    }
    sentences.join(" ")
}

/// The sentences for a question that was not understood.
pub(super) fn searched(why: &str, answer: &Answer, clock: &Clock) -> String {
    const EXAMPLES: &str = "Questions such as \u{201c}when did she last get up?\u{201d}, \u{201c}how often did she sit \
         down today?\u{201d}, \u{201c}did she fall since 22:00?\u{201d} and \u{201c}is anybody there?\u{201d} are understood.";
    let mut sentences = vec![format!("The question was not understood: {why}.")];
    if let Some(searched) = &answer.searched {
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
            (0, _) => format!("No sentence{phrase} has {words}."),
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
            sentences.push("The radar was simulated.".into());
        }
        sentences.push(NOBODY_IDENTIFIED.into());
    }
    sentences.push(EXAMPLES.into());
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

/// A duration to the second below a minute, to the minute above.
pub(super) fn duration(ms: i64) -> String {
    // Half a second rounds up.
    let s = ms.saturating_add(500) / 1_000;
    let minutes = s.saturating_add(30) / 60;
    match (s, minutes) {
        (..60, _) => format!("{s} s"),
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
            (89_000, "1 min"),
            (90_000, "2 min"),
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
