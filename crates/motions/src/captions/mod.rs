//! Captions and attributes. They are generated from the parameters of the motion, so they match it.
//!
//! A clause is a template of [`phrases`] with an adverb of speed and a count. Clauses are joined by
//! "then", "before", "after" or "while"; [`radarllm_facts::inflect`] inflects the verbs.

mod phrases;

#[cfg(test)]
pub mod check;

use crate::dice::Dice;
use crate::motions;
use crate::request::{BuiltinRequest, Part, Segment};
use crate::values::Values;
use phrases::Counting;
use radarllm_facts::inflect::{Form, inflect};

const SUBJECTS: &[&str] = &[
    "a person",
    "a person",
    "a person",
    "someone",
    "the person",
    "a figure",
    "this person",
];
const NUMBERS: &[&str] = &[
    "zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten",
    "eleven", "twelve",
];
/// Maximum number of attempts to find another distinct sentence.
const ATTEMPTS: usize = 40;

/// Three to five different sentences in lower case without a full stop.
pub(crate) fn captions(request: &BuiltinRequest, seed: u64) -> Vec<String> {
    let mut dice = Dice::new(seed, "captions");
    let wanted = 3 + dice.index(3);
    let mut out: Vec<String> = Vec::with_capacity(wanted);
    for _ in 0..ATTEMPTS {
        let sentence = sentence(request, &mut dice);
        if !out.contains(&sentence) {
            out.push(sentence);
        }
        if out.len() == wanted {
            break;
        }
    }
    out
}

/// Attributes of a request: every key of every part with its effective value; the speed is given as
/// a word.
pub(crate) fn attributes(request: &BuiltinRequest) -> Vec<(String, String)> {
    let alone = request.parts().count() == 1;
    let height_m = request.global.number("height_m");
    let mut out: Vec<(String, String)> = Vec::new();
    for part in request.parts() {
        let v = &part.values;
        for key in part.spec.keys {
            let value = match key.name {
                "speed" => speed_word(part, height_m).to_owned(),
                "repetitions" => v.count("repetitions").to_string(),
                "side" if matches!(part.spec.name, "kick" | "lunge") => {
                    ["left", "right"][motions::acting_side(v)].to_owned()
                }
                "side" | "direction" | "style" | "from" | "posture" | "arms" => {
                    v.word(key.name).to_owned()
                }
                "distance_m" | "duration_s" | "lean_deg" | "aim_deg" | "stance_m" | "pause_s"
                | "hold_s"
                    if !v.is_set(key.name) && v.number(key.name) == 0.0 =>
                {
                    continue;
                }
                other => v.number(other).to_string(),
            };
            let name = if alone {
                key.name.to_owned()
            } else {
                format!("{}.{}", part.spec.name, key.name)
            };
            if !out.iter().any(|(n, _)| *n == name) {
                out.push((name, value));
            }
        }
    }
    for key in ["height_m", "heading_deg"] {
        out.push((key.to_owned(), request.global.number(key).to_string()));
    }
    out.push(("build".to_owned(), request.global.word("build").to_owned()));
    out
}

fn sentence(request: &BuiltinRequest, dice: &mut Dice) -> String {
    let subject = dice.pick(SUBJECTS);
    let height_m = request.global.number("height_m");
    let third =
        |segment: &Segment, dice: &mut Dice| segment_clause(segment, Form::Third, height_m, dice);
    let segments = &request.segments;
    if let [only] = segments.as_slice() {
        if dice.chance(0.15) {
            return format!(
                "{subject} is {}",
                segment_clause(only, Form::Gerund, height_m, dice)
            );
        }
        return format!("{subject} {}", third(only, dice));
    }
    if let [first, second] = segments.as_slice() {
        let simple = first.overlay.is_none() && second.overlay.is_none();
        let style = dice.index(if simple { 7 } else { 3 });
        let a = segment_clause(
            first,
            if style == 5 {
                Form::Gerund
            } else {
                Form::Third
            },
            height_m,
            dice,
        );
        let b = segment_clause(
            second,
            if style == 6 {
                Form::Gerund
            } else {
                Form::Third
            },
            height_m,
            dice,
        );
        return match style {
            0 | 3 => format!("{subject} {a}, then {b}"),
            1 => format!("{subject} {a} and then {b}"),
            2 | 4 => format!("{subject} first {a} and then {b}"),
            5 => format!("after {a}, {subject} {b}"),
            _ => format!("{subject} {a} before {b}"),
        };
    }
    let last = segments.len() - 1;
    let mut out = format!("{subject} ");
    for (n, segment) in segments.iter().enumerate() {
        let link = if n == 0 {
            ""
        } else if n == last {
            dice.pick(&[", and finally ", ", and then "])
        } else {
            ", then "
        };
        out.push_str(link);
        out.push_str(&third(segment, dice));
    }
    out
}

fn segment_clause(segment: &Segment, form: Form, height_m: f32, dice: &mut Dice) -> String {
    let Some(overlay) = &segment.overlay else {
        return clause(&segment.base, form, height_m, false, dice);
    };
    let base = clause(&segment.base, form, height_m, true, dice);
    let gesture = clause(overlay, Form::Gerund, height_m, true, dice);
    format!("{base} while {gesture}")
}

/// One inflected clause with its adverbs; `plain` avoids a "while" inside another "while" clause.
fn clause(part: &Part, form: Form, height_m: f32, plain: bool, dice: &mut Dice) -> String {
    let (name, v) = (part.spec.name, &part.values);
    let mut choices = phrases::clauses(name, v);
    if plain {
        choices.retain(|c| !c.contains("while"));
    }
    // "walks" alone does not state "forward"; this form is kept to a minority of the captions.
    let implicit_forward = |c: &String| name == "walk" && c == "[walk]";
    if !dice.chance(0.5) {
        choices.retain(|c| !implicit_forward(c));
    }
    let count = count_words(name, v, dice);
    if count.is_some() {
        // In "side to side, left first twice" the count would refer to the wrong phrase.
        choices.retain(|c| !c.contains(','));
    }
    if choices.is_empty() {
        return String::new();
    }
    let mut core = choices.swap_remove(dice.index(choices.len()));
    core = core.replace("{the}", dice.pick(&["the", "their"]));
    if v.word("posture") == "stooped" {
        core.push_str(dice.pick(&[
            " with a stooped back",
            " with a hunched back",
            " hunched over",
        ]));
    }
    // After "bends down and picks something up" a trailing adverb would modify the last verb only.
    let in_front = dice.chance(0.4)
        || v.word("posture") == "stooped"
        || core.contains(" and ")
        || core.contains(',');
    if let Some(adverb) = speed_adverb(part, height_m, in_front, dice) {
        if in_front {
            core = format!("{adverb} {core}");
        } else {
            core = format!("{core} {adverb}");
        }
    }
    if let Some(count) = count {
        core = format!("{core} {count}");
    }
    inflect(&core, form)
}

/// "slow", "normal" or "fast".
pub(crate) fn speed_word(part: &Part, height_m: f32) -> &'static str {
    match motions::pace(part.spec.name, &part.values, height_m) {
        s if s <= 0.8 => "slow",
        s if s >= 1.25 => "fast",
        _ => "normal",
    }
}

fn speed_adverb(
    part: &Part,
    height_m: f32,
    in_front: bool,
    dice: &mut Dice,
) -> Option<&'static str> {
    let paces = phrases::paces(part.spec.name);
    let words: &[&str] = match (speed_word(part, height_m), in_front, paces) {
        ("slow", false, true) => &["slowly", "slowly", "at a slow pace"],
        ("slow", ..) => &["slowly"],
        ("fast", false, true) => &["quickly", "fast", "at a fast pace", "at a quick pace"],
        ("fast", false, false) => &["quickly", "rapidly", "fast"],
        ("fast", true, _) => &["quickly", "rapidly"],
        _ => return None,
    };
    Some(dice.pick(words))
}

fn count_words(name: &str, v: &Values, dice: &mut Dice) -> Option<String> {
    let n = v.count("repetitions") as usize;
    let said = match phrases::counting(name, v) {
        Counting::Never => false,
        Counting::Times => n > 1 || dice.chance(0.1),
        Counting::Sometimes | Counting::Steps => n > 1 && dice.chance(0.5),
    };
    if !said || (n == 1 && matches!(name, "jumping_jack")) {
        return None;
    }
    if phrases::counting(name, v) == Counting::Steps || name == "jog_in_place" {
        return Some(match NUMBERS.get(n) {
            Some(number) => format!("for {number} steps"),
            None => "for many steps".to_owned(),
        });
    }
    Some(match n {
        1 => "once".to_owned(),
        2 => dice.pick(&["twice", "two times"]).to_owned(),
        n => match NUMBERS.get(n) {
            Some(number) => format!("{number} times"),
            None => "many times".to_owned(),
        },
    })
}
