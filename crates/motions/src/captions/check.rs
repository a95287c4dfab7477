//! Test-only caption checker: finds language errors and facts that do not match the request.

use super::speed_word;
use crate::request::{BuiltinRequest, Part};

/// Every word that captions may contain.
const WORDS: &str = include_str!("words.txt");

/// Rejects doubled words, wrong articles, unknown words, untidy spacing and unfilled templates.
pub fn language(caption: &str) -> Result<(), String> {
    if caption.is_empty() || caption.trim() != caption || caption.contains("  ") {
        return Err("empty or untidy".to_owned());
    }
    if caption
        .chars()
        .any(|c| !(c.is_ascii_lowercase() || " ,-".contains(c)))
    {
        return Err("a character that is no letter".to_owned());
    }
    let words: Vec<&str> = caption
        .split([' ', ','])
        .filter(|w| !w.is_empty())
        .collect();
    for pair in words.windows(2) {
        if pair[0] == pair[1] {
            return Err(format!("`{}` twice", pair[0]));
        }
        let vowel = pair[1].starts_with(['a', 'e', 'i', 'o', 'u']);
        if (pair[0] == "a" && vowel) || (pair[0] == "an" && !vowel) {
            // In this vocabulary only "one" would start with a vowel letter but a consonant sound.
            return Err(format!("`{} {}`", pair[0], pair[1]));
        }
        if matches!(pair[0], "a" | "an" | "the" | "their")
            && matches!(pair[1], "a" | "an" | "the" | "their" | "and" | "with")
        {
            return Err(format!("`{} {}`", pair[0], pair[1]));
        }
    }
    for word in &words {
        if !WORDS.split_whitespace().any(|w| w == *word) {
            return Err(format!("unknown word `{word}`"));
        }
    }
    if ![
        "a person",
        "someone",
        "the person",
        "a figure",
        "this person",
        "after ",
    ]
    .iter()
    .any(|s| caption.starts_with(s))
    {
        return Err("no subject".to_owned());
    }
    if words.len() < 2 || words.len() > 45 {
        return Err(format!("{} words", words.len()));
    }
    Ok(())
}

/// Rejects sides, directions, speeds and counts that the request has and the caption lacks, or the
/// reverse.
pub fn facts(caption: &str, request: &BuiltinRequest) -> Result<(), String> {
    let has = |word: &str| caption.split([' ', ',']).any(|w| w == word);
    let height_m = request.global.number("height_m");
    let parts: Vec<&Part> = request.parts().collect();
    let mentions = |part: &Part, word: &str| -> bool {
        let v = &part.values;
        let side = ["left", "right"][crate::motions::acting_side(v)];
        let acting = part.spec.key("side").is_some() && v.word("side") != "both" && side == word;
        let alternate = part.spec.name == "punch" && v.word("side") == "both";
        let sideways = part.spec.key("direction").is_some() && v.word("direction") == word;
        let both_ways = matches!(part.spec.name, "twist" | "side_bend");
        acting || alternate || sideways || both_ways
    };
    for part in &parts {
        let v = &part.values;
        let name = part.spec.name;
        if part.spec.key("side").is_some() && v.word("side") != "both" {
            let side = ["left", "right"][crate::motions::acting_side(v)];
            if !has(side) {
                return Err(format!("{name}: side {side} unsaid"));
            }
        }
        if part.spec.key("side").is_some()
            && v.word("side") == "both"
            && name != "punch"
            && !has("both")
        {
            return Err(format!("{name}: both unsaid"));
        }
        let direction = v.word("direction");
        let said = match (name, direction) {
            (_, "") => true,
            ("walk" | "run", "forward") => true,
            ("circle", "left") => has("left") || has("counterclockwise"),
            ("circle", "right") => has("right") || has("clockwise"),
            ("hop", "up") => true,
            ("jump" | "point", "up") => ["up", "upward", "air"].iter().any(|w| has(w)),
            ("walk", _) => ["backward", "backwards", "reverse"].iter().any(|w| has(w)),
            (_, "forward") => ["forward", "ahead"].iter().any(|w| has(w)),
            (_, other) => has(other),
        };
        if !said {
            return Err(format!("{name}: direction {direction} unsaid"));
        }
        match speed_word(part, height_m) {
            "slow" if !has("slowly") && !has("slow") => return Err(format!("{name}: slow unsaid")),
            "fast"
                if !["quickly", "rapidly", "fast", "quick"]
                    .iter()
                    .any(|w| has(w)) =>
            {
                return Err(format!("{name}: fast unsaid"));
            }
            _ => {}
        }
    }
    let any_speed = |word: &str| parts.iter().any(|p| speed_word(p, height_m) == word);
    if (has("slowly") || has("slow")) && !any_speed("slow") {
        return Err("slow without reason".to_owned());
    }
    if ["quickly", "rapidly", "fast", "quick"]
        .iter()
        .any(|w| has(w))
        && !any_speed("fast")
    {
        return Err("fast without reason".to_owned());
    }
    for word in ["left", "right"] {
        if has(word) && !parts.iter().any(|p| mentions(p, word)) {
            return Err(format!("{word} without reason"));
        }
    }
    for (word, n) in [
        ("once", 1),
        ("twice", 2),
        ("three", 3),
        ("four", 4),
        ("five", 5),
        ("six", 6),
        ("seven", 7),
        ("eight", 8),
    ] {
        if has(word)
            && !parts
                .iter()
                .any(|p| p.spec.key("repetitions").is_some() && p.values.count("repetitions") == n)
        {
            return Err(format!("{word} without reason"));
        }
    }
    let still_arms = |p: &Part| p.values.word("arms") == "still";
    if caption.contains("still arms") && !parts.iter().any(|p| still_arms(p)) {
        return Err("still arms without reason".to_owned());
    }
    if caption.contains("squat with the arms in front")
        && parts
            .iter()
            .all(|p| p.spec.name != "squat" || still_arms(p))
    {
        return Err("arms in front without reason".to_owned());
    }
    if (has("stooped") || has("hunched"))
        != parts.iter().any(|p| p.values.word("posture") == "stooped")
    {
        return Err("posture".to_owned());
    }
    Ok(())
}
