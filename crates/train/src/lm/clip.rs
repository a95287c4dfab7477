//! A captioned motion as training data of the language model, and mirroring of captions.

use radarllm_inference::tokenizer::Encoded;

/// Codes and captions of one motion.
#[derive(Clone, Debug, PartialEq)]
pub struct LmClip {
    /// Motion id, for messages.
    pub id: String,
    /// Action label.
    pub action: String,
    /// Captions; at least one.
    pub captions: Vec<String>,
    /// Codes of each simulation of the motion; at least one.
    pub variants: Vec<Encoded>,
    /// Codes of the same simulations with points mirrored in x, or empty.
    pub flipped: Vec<Encoded>,
    /// Length of the motion, s.
    pub seconds: f32,
}

/// Words that mirroring exchanges, in both directions.
const PAIRS: [(&str, &str); 7] = [
    ("left", "right"),
    ("lefts", "rights"),
    ("leftward", "rightward"),
    ("leftwards", "rightwards"),
    ("leftmost", "rightmost"),
    ("clockwise", "counterclockwise"),
    ("clockwise", "anticlockwise"),
];

/// Words before or after which "right" does not mean a side.
const NO_SIDE_BEFORE: [&str; 9] = [
    "away", "now", "angle", "angles", "angled", "after", "before", "then", "here",
];
const NO_SIDE_AFTER: [&str; 2] = ["all", "alright"];

/// Returns the caption of the mirrored motion: left and right, clockwise and counterclockwise exchanged.
///
/// Only whole words are exchanged ("upright" is unchanged). The parts of hyphenated words count as words, because a
/// right-handed throw is left-handed in the mirror image. "right away", "right angle", "all right" and similar phrases
/// are unchanged. "counter-clockwise" and "anticlockwise" become "counterclockwise" after two swaps. A leading capital
/// letter is kept.
pub fn swap_sides(caption: &str) -> String {
    let spans = word_spans(caption);
    let lower: Vec<String> = spans
        .iter()
        .map(|(s, e)| caption[*s..*e].to_lowercase())
        .collect();
    let mut out = String::with_capacity(caption.len() + 8);
    let mut copied = 0;
    let mut i = 0;
    while i < spans.len() {
        let (start, mut end) = spans[i];
        let mut used = 1;
        let next = lower.get(i + 1).map(String::as_str);
        let word = lower[i].as_str();
        let between = |j: usize| &caption[spans[j].1..spans[j + 1].0];
        let swapped = if matches!(word, "counter" | "anti")
            && next == Some("clockwise")
            && matches!(between(i), "-" | " ")
        {
            end = spans[i + 1].1;
            used = 2;
            Some("clockwise")
        } else if word == "right"
            && (next.is_some_and(|n| NO_SIDE_BEFORE.contains(&n) && between(i) == " ")
                || (i > 0 && NO_SIDE_AFTER.contains(&lower[i - 1].as_str())))
        {
            None
        } else {
            PAIRS.iter().find_map(|(a, b)| match word {
                w if w == *a => Some(*b),
                w if w == *b => Some(*a),
                _ => None,
            })
        };
        if let Some(swapped) = swapped {
            out.push_str(&caption[copied..start]);
            let capital = caption[start..end].starts_with(char::is_uppercase);
            let mut letters = swapped.chars();
            match letters.next() {
                Some(first) if capital => out.extend(first.to_uppercase()),
                Some(first) => out.push(first),
                None => {}
            }
            out.push_str(letters.as_str());
            copied = end;
        }
        i += used;
    }
    out.push_str(&caption[copied..]);
    out
}

/// Byte ranges of runs of letters.
pub(crate) fn word_spans(text: &str) -> Vec<(usize, usize)> {
    let mut spans = Vec::new();
    let mut start = None;
    for (at, c) in text.char_indices().chain([(text.len(), ' ')]) {
        match (c.is_alphabetic(), start) {
            (true, None) => start = Some(at),
            (false, Some(s)) => {
                spans.push((s, at));
                start = None;
            }
            _ => {}
        }
    }
    spans
}

#[cfg(test)]
mod tests {
    use super::swap_sides;

    #[test]
    fn sides_and_turns_are_exchanged_as_whole_words() {
        for (text, mirrored) in [
            ("a man raises his left arm", "a man raises his right arm"),
            ("turns right, then LEFT.", "turns left, then Right."),
            ("walks clockwise", "walks counterclockwise"),
            ("walks counter-clockwise twice", "walks clockwise twice"),
            ("walks counter clockwise", "walks clockwise"),
            ("walks anticlockwise", "walks clockwise"),
            (
                "a right-handed throw to the left",
                "a left-handed throw to the right",
            ),
            (
                "stands upright and sits right away",
                "stands upright and sits right away",
            ),
            ("bends at a right angle", "bends at a right angle"),
            ("steps leftwards", "steps rightwards"),
            ("Left foot, right foot", "Right foot, left foot"),
            ("", ""),
            ("brightly", "brightly"),
        ] {
            assert_eq!(swap_sides(text), mirrored, "{text}");
        }
    }

    #[test]
    fn two_swaps_are_none() {
        for text in [
            "a person kicks with the right leg and turns clockwise to the left",
            "é left ünïcödé right",
            "counterclockwise",
        ] {
            assert_eq!(swap_sides(&swap_sides(text)), text);
        }
    }
}
