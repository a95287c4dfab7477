//! The words of a sentence in the forms that the lexicon knows.

/// Frequent misspellings and past forms of people's descriptions, and the form that stands for them. None of them is a
/// word of the project's own sentences.
const FORMS: &[(&str, &str)] = &[
    ("foward", "forward"),
    ("forwad", "forward"),
    ("forawrd", "forward"),
    ("foreward", "forward"),
    ("forwards", "forward"),
    ("fowards", "forward"),
    ("forwrd", "forward"),
    ("forard", "forward"),
    ("forwars", "forward"),
    ("frontwards", "forward"),
    ("frontward", "forward"),
    ("backard", "backward"),
    ("backwords", "backward"),
    ("bakwards", "backward"),
    ("rigth", "right"),
    ("rihgt", "right"),
    ("righ", "right"),
    ("lef", "left"),
    ("leftward", "leftwards"),
    ("rightward", "rightwards"),
    ("perosn", "person"),
    ("peron", "person"),
    ("peson", "person"),
    ("preson", "person"),
    ("persoon", "person"),
    ("persn", "person"),
    ("pereson", "person"),
    ("persons", "person"),
    ("lerson", "person"),
    ("person's", "person"),
    ("someones", "someone"),
    ("thier", "their"),
    ("there's", "there"),
    ("soemthing", "something"),
    ("somthing", "something"),
    ("somthign", "something"),
    ("smoething", "something"),
    ("quater", "quarter"),
    ("infront", "front"),
    ("hight", "height"),
    ("waste", "waist"),
    ("waiste", "waist"),
    ("sholder", "shoulder"),
    ("sholders", "shoulders"),
    ("shoulde", "shoulder"),
    ("should", "shoulder"),
    ("chests", "chest"),
    ("postion", "position"),
    ("posistion", "position"),
    ("positon", "position"),
    ("orginal", "original"),
    ("origional", "original"),
    ("stoping", "stopping"),
    ("siting", "sitting"),
    ("standng", "standing"),
    ("wlaks", "walks"),
    ("waks", "walks"),
    ("waling", "walking"),
    ("wlking", "walking"),
    ("walkes", "walks"),
    ("runing", "running"),
    ("jogsp", "jogs"),
    ("diagnolly", "diagonally"),
    ("diagnally", "diagonally"),
    ("diagonaly", "diagonally"),
    ("diaganally", "diagonally"),
    ("diagnol", "diagonal"),
    ("diaganol", "diagonal"),
    ("ballance", "balance"),
    ("balence", "balance"),
    ("crosss", "cross"),
    ("waives", "waves"),
    ("waiving", "waving"),
    ("jesture", "gesture"),
    ("jestures", "gestures"),
    ("squad", "squat"),
    ("squads", "squats"),
    ("squating", "squatting"),
    ("sitestep", "sidestep"),
    ("sitesteps", "sidesteps"),
    ("sidewards", "sideways"),
    ("sidewars", "sideways"),
    ("laterally", "sideways"),
    ("lateral", "sideways"),
    ("sprinst", "sprints"),
    ("kness", "knees"),
    ("hans", "hands"),
    ("hend", "hand"),
    ("had", "has"),
    ("al", "all"),
    ("foots", "foot"),
    ("anticlockwise", "counterclockwise"),
    ("counter-clockwise", "counterclockwise"),
    ("anti-clockwise", "counterclockwise"),
    ("counter-clock", "counterclockwise"),
    ("couterclockwise", "counterclockwise"),
    ("conterclockwise", "counterclockwise"),
    ("counterclock", "counterclockwise"),
    ("clock-wise", "clockwise"),
    ("clockwises", "clockwise"),
    ("zig-zag", "zigzag"),
    ("zig-zags", "zigzag"),
    ("zigzags", "zigzag"),
    ("zagging", "zigzag"),
    ("semi-circle", "semicircle"),
    ("semi-circular", "semicircle"),
    ("half-circle", "semicircle"),
    ("u-turn", "uturn"),
    ("t-pose", "tpose"),
    ("t-shape", "tpose"),
    ("hand's", "hand"),
    ("stood", "stands"),
    ("sat", "sits"),
    ("threw", "throws"),
    ("thrown", "throws"),
    ("thew", "throws"),
    ("knelt", "kneels"),
    ("took", "takes"),
    ("made", "makes"),
    ("went", "goes"),
    ("came", "comes"),
    ("held", "holds"),
    ("spun", "spins"),
    ("brought", "brings"),
    ("drank", "drinks"),
    ("caught", "catches"),
    ("shook", "shakes"),
    ("crept", "creeps"),
    ("swept", "sweeps"),
    ("rose", "rises"),
    ("swung", "swings"),
    ("fell", "falls"),
    ("ran", "runs"),
    ("jogged", "jogs"),
];

/// Numbers as words.
const NUMBERS: [&str; 21] = [
    "zero",
    "one",
    "two",
    "three",
    "four",
    "five",
    "six",
    "seven",
    "eight",
    "nine",
    "ten",
    "eleven",
    "twelve",
    "thirteen",
    "fourteen",
    "fifteen",
    "sixteen",
    "seventeen",
    "eighteen",
    "nineteen",
    "twenty",
];

/// The number that a word states.
pub fn number(word: &str) -> Option<u16> {
    match word {
        "thirty" => return Some(30),
        "forty" => return Some(40),
        "fifty" => return Some(50),
        "sixty" => return Some(60),
        "ninety" => return Some(90),
        _ => {}
    }
    let spelt = NUMBERS.iter().position(|n| *n == word);
    spelt
        .and_then(|n| u16::try_from(n).ok())
        .or_else(|| match word.len() {
            1..=4 => word.parse().ok(),
            _ => None,
        })
}

/// The word of a number, or its figures.
pub fn number_word(number: u16) -> String {
    NUMBERS
        .get(usize::from(number))
        .map_or_else(|| number.to_string(), |word| (*word).to_string())
}

/// A word of a part of a sentence.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Word {
    /// The form that the lexicon knows.
    pub text: String,
    /// Whether a comma stands before it.
    pub after_comma: bool,
}

/// Words after which "step" is a noun.
fn makes_noun(before: &str) -> bool {
    number(before).is_some()
        || matches!(
            before,
            "a" | "an"
                | "the"
                | "few"
                | "some"
                | "several"
                | "many"
                | "multiple"
                | "couple"
                | "of"
                | "more"
                | "another"
                | "each"
                | "single"
                | "first"
                | "second"
                | "third"
                | "last"
                | "small"
                | "big"
                | "large"
                | "larger"
                | "smaller"
                | "short"
                | "long"
                | "wide"
                | "giant"
                | "huge"
                | "tiny"
                | "little"
                | "quick"
                | "slow"
                | "slight"
                | "fast"
                | "high"
                | "normal"
                | "medium"
                | "running"
                | "walking"
                | "half"
                | "side"
                | "baby"
                | "careful"
                | "forward"
                | "backward"
                | "backwards"
                | "back"
                | "great"
                | "greater"
                | "dance"
                | "take"
                | "takes"
                | "taking"
                | "make"
                | "makes"
                | "making"
                | "does"
                | "his"
                | "her"
                | "their"
                | "its"
                | "sideways"
        )
}

/// The words of a text in lower case.
pub fn words(text: &str) -> Vec<Word> {
    let mut all: Vec<Word> = Vec::new();
    // "Back-and-forth", "side-to-side".
    let text = text.replace("-and-", " and ").replace("-to-", " to ");
    for (n, piece) in text.split(',').enumerate() {
        let mut after_comma = n > 0;
        for raw in piece.split_whitespace() {
            let raw = raw.trim_matches(|c: char| !c.is_alphanumeric());
            if raw.is_empty() {
                continue;
            }
            let form = FORMS.iter().find(|(form, _)| *form == raw);
            let word = form.map_or(raw, |(_, known)| known);
            let before = all.last().map(|w| w.text.clone()).unwrap_or_default();
            let before = before.as_str();
            let joined = match (before, word) {
                ("counter" | "anti", "clockwise" | "clock") => Some("counterclockwise"),
                ("clock", "wise") => Some("clockwise"),
                ("counterclockwise", "wise") => Some("counterclockwise"),
                ("zig", "zag" | "zags" | "zagging") => Some("zigzag"),
                ("side", "ways") => Some("sideways"),
                ("semi", "circle" | "circular") => Some("semicircle"),
                ("u", "turn") => Some("uturn"),
                ("t", "pose" | "shape" | "position") => Some("tpose"),
                // "Gets back up" is to get up.
                ("back", "up" | "down") => Some(word),
                _ => None,
            };
            if let Some(joined) = joined
                && let Some(last) = all.last_mut()
            {
                last.text = joined.to_string();
                continue;
            }
            // "A sexy step": a noun after an adjective as well.
            let earlier = match all.len() {
                0 | 1 => "",
                n => all[n - 2].text.as_str(),
            };
            let has_article = number(earlier).is_some()
                || matches!(
                    earlier,
                    "a" | "an" | "few" | "take" | "takes" | "taking" | "some"
                );
            let is_subject = matches!(
                before,
                "person" | "man" | "figure" | "and" | "woman" | "then"
            );
            let is_noun = makes_noun(before) || has_article && !is_subject;
            let text = match word {
                "step" | "steps" | "stepped" if !is_noun => "stepping",
                "paces" | "strides" if is_noun && !matches!(before, "the" | "a") => "steps",
                other => other,
            };
            all.push(Word {
                text: text.to_string(),
                after_comma,
            });
            after_comma = false;
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texts(text: &str) -> Vec<String> {
        words(text).into_iter().map(|w| w.text).collect()
    }

    #[test]
    fn forms_are_united() {
        assert_eq!(
            texts("a perosn walkes foward, counter clock wise"),
            ["a", "person", "walks", "forward", "counterclockwise"]
        );
        assert_eq!(texts("gets back up"), ["gets", "up"]);
        assert_eq!(texts("takes two steps"), ["takes", "two", "steps"]);
        assert_eq!(texts("he steps back"), ["he", "stepping", "back"]);
        assert!(words("sits, stands")[1].after_comma);
    }

    #[test]
    fn numbers_are_words_and_figures() {
        assert_eq!((number("twelve"), number("180")), (Some(12), Some(180)));
        assert_eq!((number("few"), number("99999")), (None, None));
        assert_eq!(number_word(7), "seven");
        assert_eq!(number_word(37), "37");
    }
}
