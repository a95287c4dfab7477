//! Questions about the present, about a time as a whole, and about what cannot be told.
//!
//! What somebody does at present is known from the newest sentence, which says so itself. Whoever asks whether somebody
//! fell out of bed, or whether somebody was alone, is told that this is not known.

use std::collections::BTreeMap;

use radarllm_monitor::rows::ActivityRow;

use super::known::{Coverage, Kept, Now};
use super::sentence::{self, NO_MEDICAL_DEVICE, NOBODY_IDENTIFIED, SIMULATED, duration};
use super::verbs::{self, Named};
use super::what::{Kind, Understood};
use super::when::{self, Clock, When};
use super::{Answer, FALL, MAX_ROWS, STAND_UP, presence, words};
use crate::error::StoreError;
use crate::store::timeline::Order;
use crate::store::{ActivityQuery, Timeline};

/// Age up to which a sentence is about the present, ms: windows of a person who is hardly detected come at intervals.
const RECENT_MS: i64 = 30_000;
/// Longest time between two sentences about one stretch of an action, ms.
const SAME_MS: i64 = 60_000;
/// Actions of which a person does one at a time.
const POSTURES: [&str; 6] = [
    "walk",
    "pace",
    "stand_still",
    "sit_still",
    "lie_still",
    "fall",
];
/// Rows that are looked at for a stretch of an action.
const MAX_STRETCH_ROWS: usize = 500;

/// What is asked about.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Topic {
    /// What somebody does, or where somebody is.
    Doing,
    /// Whether, or how long, somebody has been doing something.
    Since(Named),
    /// Whether somebody is well, or lies on the floor.
    Well,
    /// Whether the radar works.
    Radar,
    /// How many people there are.
    People,
    /// Whether somebody fell out of bed.
    OutOfBed,
    /// Whether somebody nearly fell, or an alarm was a false one.
    FalseAlarm,
    /// Whether somebody got up after a fall.
    RoseAfterFall,
    /// What happened.
    Outline,
}

const FALLS: &[&str] = &["fall", "falls", "falling", "fell", "fallen"];
const BE: &[&str] = &["is", "are", "what's", "where's", "she's", "he's"];
/// Words about the present that change nothing.
const PRESENT: &[&str] = &[
    "still",
    "now",
    "right",
    "currently",
    "already",
    "long",
    "for",
    "moment",
];

/// The meaning of a question without its time; `None` if it is about something else.
fn topic(rest: &[String], has_time: bool) -> Option<Topic> {
    let has = |list: &[&str]| rest.iter().any(|w| list.contains(&w.as_str()));
    let at = |i: usize| rest.get(i).map_or("", String::as_str);
    let place = |list: &[&str]| rest.iter().position(|w| list.contains(&w.as_str()));
    if rest
        .iter()
        .any(|w| words::is_negation(w) || words::is_comparison(w))
    {
        return None;
    }
    if has(FALLS) && has(&["bed"]) && has(&["out", "from", "off"]) {
        return Some(Topic::OutOfBed);
    }
    if has(&["false"]) && has(&["alarm", "alarms"]) || has(&["almost", "nearly"]) && has(FALLS) {
        return Some(Topic::FalseAlarm);
    }
    if let (Some(after), Some(fall), Some(up)) = (place(&["after"]), place(FALLS), place(&["up"]))
        && up < after
        && after < fall
        && has(&["get", "got", "gotten", "stand", "stood", "rise", "rose"])
    {
        return Some(Topic::RoseAfterFall);
    }
    if has(&["happened", "happen", "unusual", "movement", "movements"])
        || at(0) == "any" && has(&["activity", "activities"])
        || at(0) == "what" && at(1) == "did" && has(&["do"])
    {
        return Some(Topic::Outline);
    }
    if has(&["alone"]) || at(0) == "how" && at(1) == "many" && has(&["people", "persons"]) {
        return Some(Topic::People);
    }
    // "Where was she last seen?"
    if !has_time && at(0) == "where" && has(&["seen", "see"]) {
        return Some(Topic::Doing);
    }
    // What follows is about the present.
    let is_progressive = at(0) == "how" && at(1) == "long" && has(&["is", "are", "been"])
        || ["has", "have"].contains(&at(0)) && has(&["been"]) && has(&["long"]);
    let is_present =
        BE.contains(&at(0)) || BE.contains(&at(1)) && ["what", "where", "how"].contains(&at(0));
    if has_time || has(&["since", "ago"]) || !(is_present || is_progressive || at(0) == "does") {
        return None;
    }
    const WORKING: &[&str] = &[
        "alive",
        "broken",
        "connected",
        "ok",
        "okay",
        "on",
        "online",
        "running",
        "silent",
        "work",
        "working",
        "works",
    ];
    if has(&["radar", "sensor"]) {
        return has(WORKING).then_some(Topic::Radar);
    }
    if has(&["doing"]) || at(0) == "where" || at(0) == "where's" {
        return Some(Topic::Doing);
    }
    if at(0) == "what" || at(0) == "what's" || at(0) == "does" {
        return None;
    }
    if is_present && at(0) == "how" {
        return Some(Topic::Well);
    }
    let mut verb: Vec<String> = rest.to_vec();
    verb.retain(|w| !PRESENT.contains(&w.as_str()) && !["how", "long"].contains(&w.as_str()));
    if is_present && (has(&["floor", "ground"]) || has(FALLS)) {
        return Some(Topic::Well);
    }
    if let Ok(named) = verbs::actions(&verb) {
        return Some(Topic::Since(named));
    }
    let is_state = has(&["ok", "okay", "alright", "well", "fine", "safe", "hurt"]);
    if is_present && is_state {
        return Some(Topic::Well);
    }
    (is_present && has(&["up", "bed", "awake", "asleep", "moving"])).then_some(Topic::Doing)
}

/// Answers such a question; `None` if it is about something else.
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
    let is_to_come = when.from_ms.is_some_and(|from_ms| from_ms >= when.to_ms);
    let Some(topic) = topic(&rest, !when.phrase.is_empty()).filter(|_| !is_to_come) else {
        return Ok(None);
    };
    match topic {
        Topic::OutOfBed => {
            let mut found = about(timeline, FALL, Kind::Did, when, clock)?;
            let text = "Whether somebody fell out of bed cannot be told: a fall is found by its beginning above 1 m.";
            found.answer = format!("{text} {}", found.answer);
            Ok(Some(found))
        }
        Topic::FalseAlarm => false_alarms(timeline, when, clock).map(Some),
        Topic::RoseAfterFall => rose_after_fall(timeline, when, clock).map(Some),
        Topic::Outline => outline(timeline, &rest, when, clock).map(Some),
        Topic::People => {
            let text = "How many people are or were there is not remembered.";
            at_present(timeline, clock, vec![text.into()], &[]).map(Some)
        }
        Topic::Radar => {
            let now = Now::of(timeline, clock)?;
            let text = now.map_or_else(|| "The memory is empty.".into(), |now| now.radar(clock));
            Ok(Some(Answer {
                answer: text,
                understood: Some(Understood::about(Kind::Did, "radar", clock.always())),
                ..Answer::default()
            }))
        }
        Topic::Well => {
            let now = Now::of(timeline, clock)?;
            let is_well = now.is_some_and(|now| now.is_watched() && !now.has_fall());
            let text = is_well.then(|| "No fall is suspected.".to_string());
            let mut answer = at_present(timeline, clock, text.into_iter().collect(), &[])?;
            answer.answer = format!("{} {NO_MEDICAL_DEVICE}", answer.answer);
            Ok(Some(answer))
        }
        Topic::Doing => at_present(timeline, clock, Vec::new(), &[]).map(Some),
        Topic::Since(named) => {
            at_present(timeline, clock, Vec::new(), &named.actions[..]).map(Some)
        }
    }
}

/// What is so at present: who is there, falls that have not ended, and the newest sentence. If actions are asked about, first
/// whether one of them is going on, and since when.
fn at_present(
    timeline: &Timeline,
    clock: &Clock,
    mut sentences: Vec<String>,
    actions: &[String],
) -> Result<Answer, StoreError> {
    let Some(now) = Now::of(timeline, clock)? else {
        return Ok(Answer {
            answer: "Nothing is known: the memory is empty.".into(),
            understood: Some(Understood::about(Kind::Did, "present", clock.always())),
            ..Answer::default()
        });
    };
    let query = ActivityQuery {
        to_ms: Some(clock.now_ms),
        ..ActivityQuery::default()
    };
    let rows = timeline.some_activities(&query, Order::NewestFirst, MAX_ROWS)?;
    // What everybody did last: several people may be there.
    let mut of_people: BTreeMap<u32, ActivityRow> = BTreeMap::new();
    for row in rows {
        let key = |row: &ActivityRow| (row.activity.end_ms, row.activity.start_ms);
        let known = of_people.get(&row.activity.person);
        if known.is_none_or(|known| key(&row) > key(known)) {
            of_people.insert(row.activity.person, row);
        }
    }
    let is_recent = |row: &ActivityRow| clock.now_ms - row.activity.end_ms <= RECENT_MS;
    let is_asked = |row: &ActivityRow| actions.contains(&row.activity.action) && is_recent(row);
    // Whoever does what was asked about, or else whoever was seen last.
    let newest = (of_people.into_values()).max_by_key(|row| (is_asked(row), row.activity.end_ms));
    let is_current = now.is_watched() && now.is_present && newest.as_ref().is_some_and(is_recent);
    let mut first_ms = None;
    if let (Some(action), Some(row)) = (actions.first(), newest.as_ref().filter(|_| is_current)) {
        let infinitive = verbs::infinitive(action);
        sentences.push(match actions.contains(&row.activity.action) {
            true => {
                let since_ms = stretch_begin(timeline, actions, row.activity.person, clock)?;
                let since_ms = since_ms.unwrap_or(row.activity.start_ms);
                first_ms = Some(since_ms);
                format!(
                    "Yes: somebody has been seen to {infinitive} since {} ({}).",
                    clock.moment(since_ms),
                    duration(row.activity.end_ms - since_ms)
                )
            }
            false => format!("Nobody is seen to {infinitive} at present."),
        });
    } else if let Some(action) = actions.first()
        && (now.is_present || !now.is_watched())
    {
        let infinitive = verbs::infinitive(action);
        sentences.push(format!(
            "Whether somebody is seen to {infinitive} at present is not known."
        ));
    }
    sentences.extend(now.sentences(clock));
    if let Some(row) = &newest {
        let activity = &row.activity;
        sentences.push(format!(
            "The newest sentence is \u{201c}{}\u{201d}, {}.",
            activity.caption,
            clock.between(activity.start_ms, activity.end_ms)
        ));
    }
    let synthetic = now.is_synthetic() || newest.as_ref().is_some_and(|row| row.origin.synthetic);
    if synthetic {
        sentences.push(SIMULATED.into());
    }
    sentences.push(NOBODY_IDENTIFIED.into());
    let action = actions.first().map_or("present", String::as_str);
    Ok(Answer {
        answer: sentences.join(" "),
        understood: Some(Understood::about(Kind::Did, action, clock.always())),
        count: u64::from(first_ms.is_some()),
        first_ms,
        last_ms: first_ms,
        total_ms: first_ms.map_or(0, |ms| clock.now_ms - ms),
        synthetic,
        rows: newest.into_iter().collect(),
        ..Answer::default()
    })
}

/// When the newest stretch began in which a person did one of some actions, and no other that excludes it.
fn stretch_begin(
    timeline: &Timeline,
    actions: &[String],
    person: u32,
    clock: &Clock,
) -> Result<Option<i64>, StoreError> {
    let query = ActivityQuery {
        to_ms: Some(clock.now_ms),
        person: Some(person),
        ..ActivityQuery::default()
    };
    let rows = timeline.some_activities(&query, Order::NewestFirst, MAX_STRETCH_ROWS)?;
    let mut begin_ms = None;
    for row in rows {
        let activity = row.activity;
        let is_asked = actions.contains(&activity.action);
        match begin_ms {
            Some(begin_ms) if begin_ms - activity.end_ms > SAME_MS => break,
            // A change is a moment at the edge of a posture.
            Some(begin_ms)
                if !is_asked
                    && POSTURES.contains(&activity.action.as_str())
                    && activity.end_ms <= begin_ms =>
            {
                break;
            }
            _ if is_asked => {
                begin_ms =
                    Some(begin_ms.map_or(activity.start_ms, |ms: i64| ms.min(activity.start_ms)));
            }
            _ => {}
        }
    }
    Ok(begin_ms)
}

/// The answer to a question about one action.
fn about(
    timeline: &Timeline,
    action: &str,
    kind: Kind,
    when: When,
    clock: &Clock,
) -> Result<Answer, StoreError> {
    super::answer_understood(timeline, Understood::about(kind, action, when), clock)
}

/// Suspicions that were dismissed.
fn false_alarms(timeline: &Timeline, when: When, clock: &Clock) -> Result<Answer, StoreError> {
    let understood = Understood::about(Kind::Did, FALL, when);
    let found = super::find(timeline, &understood, clock)?;
    let mut sentences = Vec::new();
    if found.coverage.is_nothing() && found.falls.is_empty() {
        sentences.push(found.coverage.nothing(clock));
    } else {
        let phrase = match understood.when.phrase.as_str() {
            "" => String::new(),
            phrase => format!(" {phrase}"),
        };
        let far = found.coverage.as_far(clock);
        sentences.push(match sentence::dismissed(&found, clock) {
            Some(text) => format!("{text}."),
            None => format!("No suspected fall was dismissed{phrase}{far}."),
        });
        sentences.extend(
            sentence::facts(&understood, &found, clock)
                .into_iter()
                .take(1),
        );
    }
    let dismissed = || found.falls.iter().filter(|fall| fall.is_dismissed());
    if found.synthetic {
        sentences.push(SIMULATED.into());
    }
    sentences.push(NOBODY_IDENTIFIED.into());
    sentences.push(NO_MEDICAL_DEVICE.into());
    Ok(Answer {
        answer: sentences.join(" "),
        count: dismissed().count() as u64,
        first_ms: dismissed().next().map(|fall| fall.at_ms),
        last_ms: dismissed().next_back().map(|fall| fall.at_ms),
        synthetic: found.synthetic,
        understood: Some(understood),
        known: found.coverage.known,
        ..Answer::default()
    })
}

/// Whether whoever fell got up.
fn rose_after_fall(timeline: &Timeline, when: When, clock: &Clock) -> Result<Answer, StoreError> {
    let understood = Understood::about(Kind::Did, FALL, when);
    let found = super::find(timeline, &understood, clock)?;
    let last = found
        .falls
        .iter()
        .rev()
        .find(|fall| found.counts(fall, clock));
    let text = match last.map(|fall| (fall.risen_ms(), fall.confirmed_ms)) {
        Some((Some(risen_ms), _)) => format!("Yes, at {}.", clock.moment(risen_ms)),
        Some((None, Some(_))) => "Nobody was seen to get up after it.".into(),
        Some((None, None)) => "Whether somebody got up after it is not known.".into(),
        None => String::new(),
    };
    let answer = super::answer_understood(timeline, understood, clock)?;
    Ok(Answer {
        answer: format!("{text} {}", answer.answer).trim_start().into(),
        ..answer
    })
}

/// What happened: presence, falls and getting up.
fn outline(
    timeline: &Timeline,
    rest: &[String],
    when: When,
    clock: &Clock,
) -> Result<Answer, StoreError> {
    let when = match when.phrase.as_str() {
        "" => clock.last_day_and_night(),
        _ => when,
    };
    let coverage = Coverage::of(timeline, &when, Kept::Presence, clock)?;
    let mut answer = Answer {
        synthetic: coverage.watched.synthetic,
        ..Answer::default()
    };
    let mut sentences = Vec::new();
    match coverage.is_nothing() {
        true => sentences.push(coverage.nothing(clock)),
        false => sentences.extend(presence::outline(&when.phrase, &coverage, clock)),
    }
    for action in [FALL, STAND_UP] {
        let understood = Understood::about(Kind::HowOften, action, when.clone());
        let found = super::find(timeline, &understood, clock)?;
        answer.synthetic |= found.synthetic;
        if !coverage.is_nothing() || found.count > 0 || !found.falls.is_empty() {
            sentences.extend(sentence::facts(&understood, &found, clock));
        }
        answer.events.extend(found.events);
    }
    sentences.extend(coverage.only(clock));
    if rest.iter().any(|w| w == "unusual") {
        sentences.push("What is usual is not known.".into());
    }
    let query = ActivityQuery {
        from_ms: when.from_ms,
        to_ms: Some(when.to_ms),
        ..ActivityQuery::default()
    };
    let tally = timeline.tally(&query)?;
    answer.rows = timeline.some_activities(&query, Order::NewestFirst, MAX_ROWS)?;
    (answer.count, answer.first_ms, answer.last_ms) = (tally.count, tally.first_ms, tally.last_ms);
    answer.total_ms = tally.total_ms;
    answer.synthetic |= tally.synthetic;
    if answer.synthetic {
        sentences.push(SIMULATED.into());
    }
    sentences.push(NOBODY_IDENTIFIED.into());
    sentences.push(NO_MEDICAL_DEVICE.into());
    answer.answer = sentences.join(" ");
    answer.known = coverage.known;
    answer.understood = Some(Understood::about(Kind::When, "any", when));
    Ok(answer)
}
