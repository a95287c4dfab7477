//! Questions about presence: whether somebody is there, when somebody came or left, and how long the room was empty.
//!
//! They are answered from the events of presence, not from sentences. The grammar is strict: every word must be one that it
//! knows, so that "is she walking" or "when did she last leave the chair" are none of these questions.

use radarllm_monitor::rows::EventKind;

use super::sentence::{NOBODY_IDENTIFIED, duration, list, times};
use super::what::{Kind, Understood, What};
use super::when::{self, Clock};
use super::{Answer, MAX_ROWS, words};
use crate::error::StoreError;
use crate::store::lanes::Stretch;
use crate::store::{EventQuery, Timeline};

/// Longest range that is looked at, ms.
const MAX_RANGE_MS: i64 = 32 * 86_400_000;
/// The answer names the newest time of the memory if it is older than this, ms.
const OLD_MS: i64 = 10 * 60_000;
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
    "a", "any", "anybody", "anyone", "dad", "everybody", "everyone", "father", "grandfather", "grandmother", "he",
    "i", "it", "mother", "mom", "mum", "my", "our", "people", "person", "she", "somebody", "someone", "the", "they",
    "we", "you",
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
        const FRAME: [&str; 28] = [
            "when", "what", "time", "times", "last", "first", "how", "long", "often", "many", "much", "did", "has", "have",
            "had", "was", "were", "is", "are", "now", "right", "still", "back", "go", "went", "see", "seen", "currently",
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
    let subject = if has(LEFT) || goes_out {
        Subject::Left
    } else if has(CAME) || has(&["go", "went"]) && has(&["back", "home"]) {
        Subject::Came
    } else if has(EMPTY) {
        Subject::Empty
    } else if has(THERE) || has(&["see", "seen"]) || has(&["in"]) && has(&["room", "house", "flat"])
    {
        Subject::There
    } else {
        return None;
    };
    if ["is", "are"].contains(&at(0)) {
        let is_state = matches!(subject, Subject::There | Subject::Empty) && !has(&["see", "seen"]);
        return is_state.then_some((Kind::Did, Subject::Now));
    }
    // What is so at present, however it is asked, is no question about the past.
    if ["has", "have"].contains(&at(0)) && has(LEFT) {
        return Some((Kind::Did, Subject::Now));
    }
    if !has(&["did", "was", "were", "had"]) {
        return None;
    }
    let kind = if ["did", "was", "were", "had"].contains(&at(0)) {
        Kind::Did
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
    let mut when = clock.always();
    if let Some((start, found)) = when::find(&rest, clock) {
        when = found.when;
        rest.drain(start..start + found.n_words);
    }
    let Some((kind, subject)) = meaning(&rest) else {
        return Ok(None);
    };
    // What is asked of the present has no other time, and a time to come is refused elsewhere.
    let is_to_come = when.from_ms.is_some_and(|from_ms| from_ms >= clock.now_ms);
    if is_to_come || (subject == Subject::Now && !when.phrase.is_empty()) {
        return Ok(None);
    }
    let (Some(oldest_ms), Some(newest_ms)) = (timeline.oldest_ms()?, timeline.newest_ms()?) else {
        return Ok(Some(Answer {
            answer: "The memory is empty.".into(),
            understood: Some(understood(kind, EventKind::Present, when)),
            ..Answer::default()
        }));
    };
    // Nothing is known of the time after the newest entry, such as after the end of `live`.
    let to_ms = when.to_ms.min(newest_ms.saturating_add(1));
    let from_ms = when
        .from_ms
        .unwrap_or(oldest_ms)
        .max(oldest_ms)
        .max(to_ms - MAX_RANGE_MS);
    if from_ms >= to_ms {
        let (first, last) = (clock.moment(oldest_ms), clock.moment(newest_ms));
        return Ok(Some(Answer {
            answer: format!("Nothing is known of that time: the memory is from {first} to {last}."),
            understood: Some(understood(kind, EventKind::Present, when)),
            ..Answer::default()
        }));
    }
    let (spans, mut synthetic) = timeline.presence([from_ms, to_ms])?;
    let is_open = spans.last().is_some_and(|span| span.end_ms == to_ms);
    let is_old = clock.now_ms.saturating_sub(newest_ms) > OLD_MS;
    let stretches = match subject {
        Subject::Empty => rest_of(&spans, [from_ms, to_ms]),
        _ => spans.clone(),
    };
    // Times at which it happened. The last stretch has not ended, and the first one may have begun before.
    let moments: Vec<i64> = match subject {
        Subject::Came => spans
            .iter()
            .map(|s| s.start_ms)
            .filter(|ms| *ms > from_ms || *ms == oldest_ms)
            .collect(),
        Subject::Left => spans
            .iter()
            .map(|s| s.end_ms)
            .filter(|ms| *ms < to_ms)
            .collect(),
        _ => stretches.iter().map(|s| s.start_ms).collect(),
    };
    let total_ms = stretches.iter().map(|s| s.end_ms - s.start_ms).sum();
    let longest_ms = stretches
        .iter()
        .map(|s| s.end_ms - s.start_ms)
        .max()
        .unwrap_or_default();
    let phrase = match when.phrase.as_str() {
        "" => String::new(),
        phrase => format!(" {phrase}"),
    };
    let n = moments.len() as u64;
    let moment = |ms: Option<&i64>| ms.map(|ms| clock.moment(*ms)).unwrap_or_default();
    let (first, last) = (moment(moments.first()), moment(moments.last()));
    let past = match subject {
        Subject::Came => "came",
        _ => "left",
    };
    let mut sentences = vec![match (subject, kind) {
        (Subject::Now, _) | (Subject::There, Kind::Last) if is_open && is_old => {
            let last = clock.moment(newest_ms);
            format!("Somebody was there at {last}, where the memory ends.")
        }
        (Subject::Now, _) if is_open => {
            format!(
                "Somebody is there, since {}.",
                moment(spans.last().map(|s| &s.start_ms))
            )
        }
        (Subject::There, Kind::Last) if is_open => {
            format!(
                "Somebody is there, since {}.",
                moment(spans.last().map(|s| &s.start_ms))
            )
        }
        (Subject::Now | Subject::There, Kind::Did | Kind::Last) => match spans.last() {
            None => format!("Nobody was there{phrase}."),
            Some(span) if subject == Subject::Now => {
                format!("Nobody is there, since {}.", clock.moment(span.end_ms))
            }
            Some(span) if kind == Kind::Last => {
                format!("Somebody was last there at {}.", clock.moment(span.end_ms))
            }
            Some(_) => format!(
                "Yes: somebody was there{phrase}, for {} in all.",
                duration(total_ms)
            ),
        },
        (Subject::There | Subject::Empty, _) => {
            let what = match subject {
                Subject::Empty => "The room was empty",
                _ => "Somebody was there",
            };
            match (stretches.len(), kind) {
                (0, _) if subject == Subject::Empty => format!("The room was not empty{phrase}."),
                (0, _) => format!("Nobody was there{phrase}."),
                (1, _) => format!(
                    "{what} for {}{phrase}, from {first} to {}.",
                    duration(total_ms),
                    moment(stretches.last().map(|s| &s.end_ms))
                ),
                (_, Kind::Last) => format!(
                    "{what} last from {last} to {}.",
                    moment(stretches.last().map(|s| &s.end_ms))
                ),
                (_, Kind::First) => format!("{what} first from {first} on."),
                (n, _) => format!(
                    "{what} for {} in all{phrase}, in {n} stretches, the longest of {}.",
                    duration(total_ms),
                    duration(longest_ms)
                ),
            }
        }
        (_, Kind::Did) if n == 0 => format!("No: nobody {past}{phrase}."),
        (_, _) if n == 0 => format!("Nobody {past}{phrase}."),
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
        (_, Kind::When) if moments.len() <= MAX_TIMES => {
            let at = list(moments.iter().map(|ms| clock.moment(*ms)), "and");
            format!("Somebody {past} {}{phrase}: at {at}.", times(n))
        }
        (_, Kind::Did) => format!("Yes: somebody {past} {}{phrase}, last at {last}.", times(n)),
        (_, _) => format!("Somebody {past} {}{phrase}, last at {last}.", times(n)),
    }];
    let query = EventQuery {
        from_ms: Some(from_ms),
        to_ms: Some(to_ms.saturating_add(1)),
        kinds: vec![EventKind::Present, EventKind::Absent],
        person: None,
    };
    let events = timeline.events(&query, None, MAX_ROWS)?.rows;
    synthetic |= events.iter().any(|row| row.origin.synthetic);
    if is_old {
        sentences.push(format!(
            "The newest entry of the memory is of {}.",
            clock.moment(newest_ms)
        ));
    }
    if when.from_ms.is_none_or(|from_ms| oldest_ms > from_ms) {
        sentences.push(format!("The memory begins at {}.", clock.moment(oldest_ms)));
    }
    if synthetic {
        sentences.push("The radar was simulated.".into());
    }
    sentences.push(NOBODY_IDENTIFIED.into());
    let name = match subject {
        Subject::Empty | Subject::Left => EventKind::Absent,
        _ => EventKind::Present,
    };
    Ok(Some(Answer {
        answer: sentences.join(" "),
        understood: Some(understood(kind, name, when)),
        searched: None,
        count: n,
        first_ms: moments.first().copied(),
        last_ms: moments.last().copied(),
        total_ms,
        synthetic,
        rows: Vec::new(),
        events,
    }))
}

/// The meaning for programs: the event of presence takes the place of an action.
fn understood(kind: Kind, event: EventKind, when: when::When) -> Understood {
    Understood {
        what: What {
            kind,
            actions: vec![event.name().into()],
            n_asked: 1,
        },
        when,
        ignored: Vec::new(),
    }
}

/// What is left of a range beside stretches in order of time.
fn rest_of(stretches: &[Stretch], [from_ms, to_ms]: [i64; 2]) -> Vec<Stretch> {
    let mut rest = Vec::new();
    let mut start_ms = from_ms;
    for stretch in stretches {
        let end_ms = stretch.start_ms;
        rest.push(Stretch { start_ms, end_ms });
        start_ms = stretch.end_ms;
    }
    rest.push(Stretch {
        start_ms,
        end_ms: to_ms,
    });
    rest.retain(|s| s.end_ms - s.start_ms >= MIN_REST_MS);
    rest
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::tests::{NOW_MS, event, new_store, origin};
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
            "how long has she been there",
            "how long is it to home",
            "when was the room empty",
            "there",
            "",
        ] {
            assert_eq!(of(question), None, "{question}");
        }
    }

    /// Minutes before the present time at which somebody came or left.
    fn memory(events: &[(i64, EventKind)]) -> (tempfile::TempDir, Store) {
        let (dir, mut store) = new_store();
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
        let (text, _) = answer.answer.split_once(" The memory begins").unwrap();
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
        for (question, expected) in [
            (
                "is anybody there?",
                format!("Somebody is there, since {}.", at(5)),
            ),
            (
                "when was she last seen?",
                format!("Somebody is there, since {}.", at(5)),
            ),
            (
                "how long was the room empty?",
                "The room was empty for 3 h 25 min in all, in 2 stretches, the longest of 2 h."
                    .into(),
            ),
            (
                "how long was she there?",
                "Somebody was there for 1 h 30 min in all, in 3 stretches, the longest of 1 h."
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
        ] {
            assert_eq!(says(&store, question), expected, "{question}");
        }
        let (_dir, store) = memory(&[(300, Present), (240, Absent)]);
        assert_eq!(
            says(&store, "is anybody there?"),
            format!(
                "Nobody is there, since {}. The newest entry of the memory is of {}.",
                at(240),
                at(240)
            )
        );
        assert!(
            says(&store, "when was she last seen")
                .starts_with(&format!("Somebody was last there at {}.", at(240)))
        );
        // The program ended while somebody was there, for 230 minutes of which nothing is known.
        let (_dir, store) = memory(&[
            (300, Present),
            (290, EventKind::Suspected),
            (60, Present),
            (50, Absent),
        ]);
        let there = says(&store, "how long was she there?");
        assert!(
            there.starts_with("Somebody was there for 20 min in all, in 2 stretches"),
            "{there}"
        );
        let (_dir, store) = memory(&[(300, Present)]);
        let now = says(&store, "is anybody there?");
        assert!(
            now.starts_with(&format!(
                "Somebody was there at {}, where the memory ends.",
                at(300)
            )),
            "{now}"
        );
        let before =
            super::super::ask(store.timeline(), "was anybody there on 2026-11-20?", CLOCK).unwrap();
        assert!(
            before.answer.starts_with("Nothing is known of that time"),
            "{}",
            before.answer
        );
        // Nothing was seen.
        let (_dir, store) = new_store();
        let empty = super::super::ask(store.timeline(), "is anybody there?", CLOCK).unwrap();
        assert_eq!(empty.answer, "The memory is empty.");
    }
}
