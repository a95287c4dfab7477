//! Questions about presence: whether somebody is there, when somebody came or left, and how long the room was empty.
//!
//! They are answered from the events of presence, not from sentences, and only for the time in which a radar was watched
//! and heard. The grammar is strict: every word must be one that it knows, so that "is she walking" or "when did she last
//! leave the chair" are none of these questions.

use radarllm_monitor::rows::EventKind;

use super::known::{Coverage, Kept, Now};
use super::sentence::{NOBODY_IDENTIFIED, SIMULATED, duration, list, times};
use super::what::{Kind, Understood};
use super::when::{self, Clock};
use super::{Answer, MAX_ROWS, words};
use crate::error::StoreError;
use crate::store::lanes::Stretch;
use crate::store::runs::Known;
use crate::store::{EventQuery, Timeline};

/// Shortest time that the room is empty, ms.
const MIN_REST_MS: i64 = 1_000;
/// Most times that a sentence names one by one.
const MAX_TIMES: usize = 5;

/// What is asked about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Subject {
    /// Whether somebody is there at present.
    Now,
    /// That somebody was there.
    There,
    /// That nobody was there.
    Empty,
    /// That somebody came.
    Came,
    /// That everybody left.
    Left,
}

#[rustfmt::skip]
const WHO: &[&str] = &[
    "a", "any", "anybody", "anyone", "dad", "everybody", "everyone", "father", "grandfather", "grandma", "grandmother",
    "grandpa", "he", "her", "him", "i", "it", "mother", "mom", "mum", "my", "our", "people", "person", "she", "somebody",
    "someone", "the", "them", "they", "us", "we", "you",
];
#[rustfmt::skip]
const PLACES: &[&str] = &[
    "apartment", "at", "been", "flat", "from", "home", "house", "in", "inside", "of", "room", "to",
];
const THERE: &[&str] = &[
    "around", "here", "home", "inside", "occupied", "present", "there",
];
const EMPTY: &[&str] = &["away", "empty", "gone", "out", "unoccupied"];
const CAME: &[&str] = &[
    "arrive", "arrived", "came", "come", "enter", "entered", "return", "returned",
];
const LEFT: &[&str] = &["leave", "left"];

/// The meaning of a question about presence; `None` if it is about something else.
fn meaning(rest: &[String]) -> Option<(Kind, Subject)> {
    let has = |list: &[&str]| rest.iter().any(|w| list.contains(&w.as_str()));
    let at = |i: usize| rest.get(i).map_or("", String::as_str);
    let is_known = |w: &String| {
        let lists = [WHO, PLACES, THERE, EMPTY, CAME, LEFT];
        #[rustfmt::skip]
        const FRAME: [&str; 31] = [
            "when", "what", "time", "times", "last", "first", "how", "long", "often", "many", "much", "did", "has", "have",
            "had", "was", "were", "is", "are", "now", "right", "still", "back", "go", "went", "see", "seen", "currently",
            "ago", "already", "yet",
        ];
        lists.iter().any(|list| list.contains(&w.as_str())) || FRAME.contains(&w.as_str())
    };
    if !rest.iter().all(is_known) {
        return None;
    }
    let goes_out = has(&["go", "went", "come", "came"]) && has(&["out", "away"]);
    // To the left is a direction, and "how many people" no time.
    let is_direction = has(&["left"]) && has(&["go", "went", "to", "from", "right", "was", "were"]);
    let counts_people = has(&["many"]) && !has(&["times"]);
    if is_direction || counts_people || has(&["around"]) {
        return None;
    }
    let asks_present = ["is", "are"].contains(&at(0));
    let subject = if has(LEFT) || goes_out {
        Subject::Left
    } else if has(CAME) || has(&["go", "went"]) && has(&["back", "home"]) {
        Subject::Came
    } else if has(EMPTY) {
        Subject::Empty
    } else if has(THERE)
        || has(&["see", "seen"])
        || has(&["in"]) && has(&["room", "house", "flat"])
        || asks_present && (has(&["back"]) || has(&["in"]))
    {
        Subject::There
    } else {
        return None;
    };
    if asks_present {
        let is_state = matches!(subject, Subject::There | Subject::Empty) && !has(&["see", "seen"]);
        return is_state.then_some((Kind::Did, Subject::Now));
    }
    let is_perfect = has(&["has", "have"]);
    // What is so at present, however it is asked, is no question about the past.
    if ["has", "have"].contains(&at(0)) && (has(LEFT) || has(CAME) || has(&["back"])) {
        return Some((Kind::Did, Subject::Now));
    }
    if ["has", "have"].contains(&at(0)) && subject == Subject::There {
        return Some((Kind::Did, Subject::There));
    }
    // "How long has the room been empty", "how long is she already away".
    let is_state = matches!(subject, Subject::There | Subject::Empty);
    if at(0) == "how" && at(1) == "long" && is_state && !has(&["see", "seen"]) {
        let is_present =
            is_perfect && has(&["been"]) || has(&["is", "are"]) && has(&["already", "now"]);
        if is_present {
            return Some((Kind::HowLong, Subject::Now));
        }
    }
    if !has(&["did", "was", "were", "had"]) {
        return None;
    }
    let kind = if ["did", "was", "were", "had"].contains(&at(0)) {
        Kind::Did
    } else if has(&["ago"]) {
        Kind::Last
    } else if at(0) == "how" && has(&["often", "many"]) {
        Kind::HowOften
    } else if at(0) == "how" && has(&["long", "much"]) {
        Kind::HowLong
    } else if has(&["last"]) {
        Kind::Last
    } else if has(&["first"]) {
        Kind::First
    } else if at(0) == "when" || has(&["what"]) && has(&["time"]) {
        Kind::When
    } else {
        return None;
    };
    // Somebody comes and leaves at times, and is there for a time.
    let is_moment = matches!(subject, Subject::Came | Subject::Left);
    let fits = match kind {
        Kind::HowLong => !is_moment,
        Kind::Did => true,
        Kind::Last => is_moment || subject == Subject::There,
        _ => is_moment,
    };
    fits.then_some((kind, subject))
}

/// Answers a question about presence; `None` if it is about something else.
///
/// # Errors
/// A database that cannot be read.
pub(super) fn answer(
    timeline: &Timeline,
    question: &str,
    clock: &Clock,
) -> Result<Option<Answer>, StoreError> {
    let mut rest = words::split(question);
    let when = when::take(&mut rest, clock);
    let Some((kind, subject)) = meaning(&rest) else {
        return Ok(None);
    };
    // What is asked of the present has no other time, and a time to come is refused elsewhere.
    let is_to_come = when.from_ms.is_some_and(|from_ms| from_ms >= clock.now_ms);
    if is_to_come || (subject == Subject::Now && !when.phrase.is_empty()) {
        return Ok(None);
    }
    let coverage = Coverage::of(timeline, &when, Kept::Presence, clock)?;
    let now = Now::of(timeline, clock)?;
    let is_about_now = match subject {
        Subject::Now => true,
        // Who is there, or was when the memory ended, is seen last there.
        Subject::There => kind == Kind::Last && when.phrase.is_empty(),
        _ => false,
    };
    let about_now = now.filter(|now| is_about_now && (subject == Subject::Now || now.is_present));
    let reported = match &about_now {
        Some(now) => Reported {
            sentences: now.sentences(clock),
            ..Reported::default()
        },
        None if coverage.is_nothing() => Reported {
            sentences: vec![coverage.nothing(clock)],
            ..Reported::default()
        },
        None => tell(subject, kind, &when.phrase, &coverage, clock),
    };
    let [from_ms, to_ms] = coverage.range_ms;
    let query = EventQuery {
        from_ms: Some(from_ms),
        to_ms: Some(to_ms.saturating_add(1)),
        kinds: vec![EventKind::Present, EventKind::Absent],
        person: None,
    };
    let events = timeline.events(&query, None, MAX_ROWS)?.rows;
    let synthetic = coverage.watched.synthetic
        || about_now.is_some_and(|now| now.is_synthetic())
        || events.iter().any(|row| row.origin.synthetic);
    let mut sentences = reported.sentences;
    if synthetic {
        sentences.push(SIMULATED.into());
    }
    sentences.push(NOBODY_IDENTIFIED.into());
    let name = match subject {
        Subject::Empty | Subject::Left => EventKind::Absent,
        _ => EventKind::Present,
    };
    Ok(Some(Answer {
        answer: sentences.join(" "),
        understood: Some(Understood::about(kind, name.name(), when)),
        searched: None,
        count: reported.moments_ms.len() as u64,
        first_ms: reported.moments_ms.first().copied(),
        last_ms: reported.moments_ms.last().copied(),
        total_ms: reported.total_ms,
        synthetic,
        known: coverage.known,
        rows: Vec::new(),
        events,
    }))
}

/// An answer about presence.
#[derive(Default)]
struct Reported {
    sentences: Vec<String>,
    /// Times at which it happened, or began.
    moments_ms: Vec<i64>,
    total_ms: i64,
}

/// Answers from what is known of a range of time.
fn tell(
    subject: Subject,
    kind: Kind,
    phrase: &str,
    coverage: &Coverage,
    clock: &Clock,
) -> Reported {
    let known = &coverage.watched.known;
    let stretches: Vec<Stretch> = match subject {
        Subject::Empty => known.iter().flat_map(rest_of).collect(),
        _ => coverage.watched.presence(),
    };
    // What began or ended with the time of which something is known, may have begun before or lasted longer.
    let moments_ms: Vec<i64> = match subject {
        Subject::Came => {
            let came = |known: &Known| {
                let starts = known.presence.iter().map(|s| s.start_ms);
                let start_ms = known.stretch.start_ms;
                starts.filter(move |ms| *ms > start_ms).collect::<Vec<_>>()
            };
            known.iter().flat_map(came).collect()
        }
        Subject::Left => {
            let left = |known: &Known| {
                let n_left = known.presence.len() - usize::from(known.is_present_at_end);
                let ends = known.presence.iter().take(n_left).map(|s| s.end_ms);
                ends.collect::<Vec<_>>()
            };
            known.iter().flat_map(left).collect()
        }
        _ => stretches.iter().map(|s| s.start_ms).collect(),
    };
    let total_ms = stretches.iter().map(|s| s.end_ms - s.start_ms).sum();
    let longest_ms = stretches.iter().map(|s| s.end_ms - s.start_ms).max();
    let phrase = match phrase {
        "" => String::new(),
        phrase => format!(" {phrase}"),
    };
    let n = moments_ms.len() as u64;
    let moment = |ms: Option<&i64>| ms.map(|ms| clock.moment(*ms)).unwrap_or_default();
    let (first, last) = (moment(moments_ms.first()), moment(moments_ms.last()));
    let past = match subject {
        Subject::Came => "came",
        _ => "left",
    };
    let far = coverage.as_far(clock);
    let sentence = match (subject, kind) {
        (Subject::Now | Subject::There, _) if stretches.is_empty() => match kind {
            Kind::Did => format!("No: nobody was there{phrase}{far}."),
            _ => format!("Nobody was there{phrase}{far}."),
        },
        (Subject::Empty, _) if stretches.is_empty() => {
            format!("The room was not empty{phrase}{far}.")
        }
        (Subject::Now | Subject::There, Kind::Last) => {
            let last = moment(stretches.last().map(|s| &s.end_ms));
            format!("Somebody was last there{phrase} at {last}.")
        }
        (Subject::Now | Subject::There, Kind::Did) => {
            let total = duration(total_ms);
            format!("Yes: somebody was there{phrase}, for {total} in all.")
        }
        (Subject::Now | Subject::There | Subject::Empty, _) => {
            let what = match subject {
                Subject::Empty => "The room was empty",
                _ => "Somebody was there",
            };
            let total = duration(total_ms);
            match &stretches[..] {
                [one] => format!(
                    "{what} for {total}{phrase}, {}.",
                    clock.between(one.start_ms, one.end_ms)
                ),
                _ => format!(
                    "{what} for {total} in all{phrase}, in {} stretches, the longest of {}.",
                    stretches.len(),
                    duration(longest_ms.unwrap_or_default())
                ),
            }
        }
        (_, Kind::Did) if n == 0 => format!("No: nobody {past}{phrase}{far}."),
        (_, _) if n == 0 => format!("Nobody {past}{phrase}{far}."),
        (_, Kind::Did) if n == 1 => format!("Yes: somebody {past} once{phrase}, at {last}."),
        (_, _) if n == 1 => format!("Somebody {past} once{phrase}, at {last}."),
        (_, Kind::Last) => format!(
            "Somebody last {past} at {last}, {} in all{phrase}.",
            times(n)
        ),
        (_, Kind::First) => format!(
            "Somebody first {past} at {first}, {} in all{phrase}.",
            times(n)
        ),
        (_, Kind::When) if moments_ms.len() <= MAX_TIMES => {
            let at = list(moments_ms.iter().map(|ms| clock.moment(*ms)), "and");
            format!("Somebody {past} {}{phrase}: at {at}.", times(n))
        }
        (_, Kind::Did) => format!("Yes: somebody {past} {}{phrase}, last at {last}.", times(n)),
        (_, _) => format!("Somebody {past} {}{phrase}, last at {last}.", times(n)),
    };
    let mut sentences = vec![sentence];
    if n > 0 {
        sentences.extend(coverage.only(clock));
    }
    Reported {
        sentences,
        moments_ms,
        total_ms,
    }
}

/// Sentences about presence in a range of time.
pub(super) fn outline(phrase: &str, coverage: &Coverage, clock: &Clock) -> Vec<String> {
    let there = tell(Subject::There, Kind::HowLong, phrase, coverage, clock);
    let came = tell(Subject::Came, Kind::HowOften, phrase, coverage, clock);
    let left = tell(Subject::Left, Kind::HowOften, phrase, coverage, clock);
    let reported = [there, came, left].into_iter();
    reported
        .filter_map(|reported| reported.sentences.into_iter().next())
        .collect()
}

/// When nobody was there.
fn rest_of(known: &Known) -> Vec<Stretch> {
    let mut rest = Vec::new();
    let mut start_ms = known.stretch.start_ms;
    for presence in &known.presence {
        let end_ms = presence.start_ms;
        rest.push(Stretch { start_ms, end_ms });
        start_ms = presence.end_ms;
    }
    let end_ms = known.stretch.end_ms;
    rest.push(Stretch { start_ms, end_ms });
    rest.retain(|s| s.end_ms - s.start_ms >= MIN_REST_MS);
    rest
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::tests::{NOW_MS, event, new_store, origin, watch};
    use crate::store::{Batch, Store};

    const CLOCK: Clock = Clock {
        now_ms: NOW_MS,
        offset_s: 3_600,
    };
    const MINUTE_MS: i64 = 60_000;

    #[test]
    fn questions_have_their_meaning() {
        use Kind::*;
        use Subject::*;
        let of = |question: &str| meaning(&words::split(question));
        for (question, expected) in [
            ("Is anybody there?", (Did, Now)),
            ("is the room empty right now", (Did, Now)),
            ("is mum still at home?", (Did, Now)),
            ("when was she last seen?", (Last, There)),
            ("when did I last see anybody", (Last, There)),
            ("When did she leave?", (When, Left)),
            ("when did she last leave the room", (Last, Left)),
            ("when did he first come home", (First, Came)),
            ("what time did she come back?", (When, Came)),
            ("how often did she go out?", (HowOften, Left)),
            (
                "how many times did anybody enter the room",
                (HowOften, Came),
            ),
            ("how long was the room empty?", (HowLong, Empty)),
            ("how long was she away", (HowLong, Empty)),
            ("how long was somebody in the room", (HowLong, There)),
            ("was anybody there?", (Did, There)),
            ("did anyone come in", (Did, Came)),
            ("when did she come out of the room?", (When, Left)),
            ("has she left?", (Did, Now)),
            ("is she back?", (Did, Now)),
            ("is he in?", (Did, Now)),
            ("has anybody been here?", (Did, There)),
            ("have you seen her?", (Did, There)),
            ("when did you last see her?", (Last, There)),
            ("how long ago was she last seen?", (Last, There)),
            ("how long has the room been empty?", (HowLong, Now)),
            ("how long has she been there", (HowLong, Now)),
        ] {
            assert_eq!(of(question), Some(expected), "{question}");
        }
        // Questions about actions, and what is not known.
        for question in [
            "is she walking",
            "when did she last get up",
            "when did she last leave the chair",
            "was she there with the dog",
            "how long did she leave",
            "did she fall in the room",
            "is it raining",
            "did she go left",
            "how often did she go to the left",
            "how many people are there",
            "what time is it there",
            "how long is it to home",
            "when was the room empty",
            "there",
            "",
        ] {
            assert_eq!(of(question), None, "{question}");
        }
    }

    /// A memory of a radar that has been watched for 301 minutes, and minutes before the present time at which somebody came
    /// or left.
    fn memory(events: &[(i64, EventKind)]) -> (tempfile::TempDir, Store) {
        let (dir, mut store) = new_store();
        watch(&mut store, NOW_MS - 301 * MINUTE_MS, NOW_MS);
        let insert = |batch: &Batch<'_>| {
            for (minutes, kind) in events {
                batch.insert_event(&event(NOW_MS - minutes * MINUTE_MS, *kind), &origin())?;
            }
            Ok(())
        };
        store.write(insert).unwrap();
        (dir, store)
    }

    fn says(store: &Store, question: &str) -> String {
        let answer = super::super::ask(store.timeline(), question, CLOCK).unwrap();
        assert!(answer.understood.is_some(), "{question}: {}", answer.answer);
        let (text, _) = answer.answer.split_once(" Nobody is identified").unwrap();
        text.to_string()
    }

    #[test]
    fn answers_follow_from_the_events() {
        use EventKind::{Absent, Present};
        let events = [
            (300, Present),
            (240, Absent),
            (120, Present),
            (90, Absent),
            (5, Present),
        ];
        let (_dir, store) = memory(&events);
        let at = |minutes: i64| CLOCK.moment(NOW_MS - minutes * MINUTE_MS);
        let is_there = format!("Somebody is there, since {} (5 min).", at(5));
        for (question, expected) in [
            ("is anybody there?", is_there.clone()),
            ("how long has she been there?", is_there.clone()),
            ("when was she last seen?", is_there),
            (
                "how long was the room empty?",
                "The room was empty for 3 h 26 min in all, in 3 stretches, the longest of 2 h."
                    .into(),
            ),
            (
                "how long was she there?",
                "Somebody was there for 1 h 35 min in all, in 3 stretches, the longest of 1 h."
                    .into(),
            ),
            (
                "when did she last leave?",
                format!("Somebody last left at {}, twice in all.", at(90)),
            ),
            (
                "when did she come in?",
                format!(
                    "Somebody came 3 times: at {}, {} and {}.",
                    at(300),
                    at(120),
                    at(5)
                ),
            ),
            (
                "how often did she go out?",
                format!("Somebody left twice, last at {}.", at(90)),
            ),
            (
                "when was she last seen in the last 10 minutes",
                format!(
                    "Somebody was last there in the last 10 minutes at {}.",
                    at(0)
                ),
            ),
        ] {
            assert_eq!(says(&store, question), expected, "{question}");
        }
        let (_dir, store) = memory(&[(300, Present), (240, Absent)]);
        assert_eq!(
            says(&store, "is anybody there?"),
            format!("Nobody is there, since {} (4 h).", at(240))
        );
        assert_eq!(
            says(&store, "when was she last seen"),
            format!("Somebody was last there at {}.", at(240))
        );
        assert_eq!(
            says(&store, "has anybody been here in the last hour?"),
            "No: nobody was there in the last hour."
        );
        // Nothing was seen.
        let (_dir, store) = new_store();
        let empty = super::super::ask(store.timeline(), "is anybody there?", CLOCK).unwrap();
        let expected = "Nothing is known: the memory is empty.";
        assert!(empty.answer.starts_with(expected), "{}", empty.answer);
    }
}
