//! Sentences about mirrored motions.

/// Words after `right` that make it an adverb or an angle: "right away", "right next to a wall", "a right angle".
const NOT_A_SIDE: [&str; 9] = [
    "away", "after", "before", "now", "next", "here", "angle", "angles", "angled",
];

/// The sentence about the mirrored motion: left and right, clockwise and counterclockwise are exchanged.
///
/// Only whole words are exchanged ("upright" is unchanged), and both parts of hyphenated ones, because a right-handed
/// throw is left-handed in the mirror image. Two exchanges give the same sentence, except that "counter-clockwise" and
/// "anticlockwise" become "counterclockwise".
///
/// ```
/// use radarllm_facts::swap_sides;
///
/// let text = "A person raises the Left hand, turns counter-clockwise and right away bows.";
/// assert_eq!(swap_sides(text), "A person raises the Right hand, turns clockwise and right away bows.");
/// ```
pub fn swap_sides(text: &str) -> String {
    let words = words(text);
    let mut out = String::with_capacity(text.len() + 16);
    let mut at = 0;
    let mut i = 0;
    while i < words.len() {
        let (start, word) = words[i];
        let lower = word.to_lowercase();
        out.push_str(&text[at..start]);
        at = start + word.len();
        let lower_at = |i: usize| words.get(i).map(|(_, word)| word.to_lowercase());
        let next = lower_at(i + 1).unwrap_or_default();
        let next_at = words.get(i + 1).map_or(text.len(), |(start, _)| *start);
        let is_against = matches!(lower.as_str(), "counter" | "anti");
        if is_against && next == "clockwise" {
            // Two words or one with a hyphen.
            let (start, second) = words[i + 1];
            at = start + second.len();
            out.push_str(&in_case_of(word, "clockwise"));
            i += 2;
            continue;
        }
        // "turns right, now left": with more than a space between, the next word belongs to another phrase.
        let is_adverb = (&text[at..next_at] == " "
            && (NOT_A_SIDE.contains(&next.as_str())
                || (next == "in" && lower_at(i + 2).is_some_and(|word| word == "front"))))
            || (i > 0 && lower_at(i - 1).is_some_and(|word| word == "all"));
        let is_side = !(lower == "right" && is_adverb);
        out.push_str(&match lower.as_str() {
            "counterclockwise" | "anticlockwise" => in_case_of(word, "clockwise"),
            "clockwise" => in_case_of(word, "counterclockwise"),
            other => match swapped(other).filter(|_| is_side) {
                Some(other) => in_case_of(word, &other),
                None => word.into(),
            },
        });
        i += 1;
    }
    out.push_str(&text[at..]);
    out
}

/// Runs of letters with their offsets, bytes.
fn words(text: &str) -> Vec<(usize, &str)> {
    let mut words = Vec::new();
    let mut start = None;
    for (i, c) in text.char_indices() {
        match (c.is_alphabetic(), start) {
            (true, None) => start = Some(i),
            (false, Some(from)) => {
                words.push((from, &text[from..i]));
                start = None;
            }
            _ => {}
        }
    }
    words.extend(start.map(|from| (from, &text[from..])));
    words
}

/// The word of the other side: `left`, `lefthand`, `leftward`; not `leftover`, `rightly`.
fn swapped(lower: &str) -> Option<String> {
    let (side, other) = match lower.starts_with("left") {
        true => ("left", "right"),
        false => ("right", "left"),
    };
    let rest = lower.strip_prefix(side)?;
    let part = ["", "s", "ward", "wards", "hand", "handed", "most", "side"];
    let limb = ["arm", "leg", "foot", "knee"];
    let is_known = part.contains(&rest) || limb.contains(&rest);
    is_known.then(|| format!("{other}{rest}"))
}

/// A word with the capitals of another: none, the first letter, or all.
fn in_case_of(like: &str, word: &str) -> String {
    let mut letters = like.chars();
    let first = letters.next().is_some_and(char::is_uppercase);
    let second = letters.next().is_some_and(char::is_uppercase);
    match (first, second) {
        (true, true) => word.to_uppercase(),
        (true, false) => word[..1].to_uppercase() + &word[1..],
        _ => word.into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sides_and_turns_are_exchanged() {
        for (text, mirrored) in [
            ("a man raises his left arm", "a man raises his right arm"),
            ("walks left, then right.", "walks right, then left."),
            ("turns right, then LEFT.", "turns left, then RIGHT."),
            ("turns right then left", "turns left then right"),
            ("turns right, now left", "turns left, now right"),
            ("Left foot, right foot", "Right foot, left foot"),
            ("steps leftwards", "steps rightwards"),
            ("walks clockwise", "walks counterclockwise"),
            ("walks counter clockwise", "walks clockwise"),
            (
                "stands upright and sits right away",
                "stands upright and sits right away",
            ),
            ("LEFT leg; Rightward step", "RIGHT leg; Leftward step"),
            ("turns anti clockwise", "turns clockwise"),
            ("turns Clockwise twice", "turns Counterclockwise twice"),
            ("walks counter-clockwise twice", "walks clockwise twice"),
            ("walks anticlockwise", "walks clockwise"),
            (
                "a right-handed throw to the left",
                "a left-handed throw to the right",
            ),
            (
                "turns right, right in a circle",
                "turns left, left in a circle",
            ),
            (
                "moves right in front of a wall",
                "moves right in front of a wall",
            ),
            ("sits right away, all right", "sits right away, all right"),
            ("bends at a right angle", "bends at a right angle"),
            ("stands upright, leftovers", "stands upright, leftovers"),
            ("brightly", "brightly"),
            ("", ""),
            ("ein Fuß links", "ein Fuß links"),
        ] {
            assert_eq!(swap_sides(text), mirrored);
        }
    }

    #[test]
    fn mirroring_twice_gives_the_same_sentence() {
        for text in [
            "a person kicks with the left foot and turns counterclockwise to the right",
            "é left ünïcödé right",
            "counterclockwise",
        ] {
            assert_eq!(swap_sides(&swap_sides(text)), text);
        }
    }
}
