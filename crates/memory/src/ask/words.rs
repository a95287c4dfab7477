//! Questions to words, and lists of words that mean something, or nothing, to the grammar.

/// The words of a question in lower case. Colons, hyphens and apostrophes stay within words: `07:30`, `2026-11-20`,
/// `didn't`.
pub(super) fn split(question: &str) -> Vec<String> {
    let text = question.to_lowercase().replace('\u{2019}', "'");
    let text = text.replace("a.m", "am").replace("p.m", "pm");
    text.split(|c: char| !c.is_alphanumeric() && !matches!(c, ':' | '-' | '\''))
        .map(|word| word.trim_matches(|c: char| !c.is_alphanumeric()))
        .filter(|word| !word.is_empty())
        .map(String::from)
        .collect()
}

/// Whether the words at a place are these.
pub(super) fn at(words: &[String], index: usize, wanted: &[&str]) -> bool {
    words.get(index..).is_some_and(|rest| {
        rest.len() >= wanted.len() && rest.iter().zip(wanted).all(|(a, b)| a == b)
    })
}

/// Removes these words where they first occur in a row. Returns whether they do.
pub(super) fn remove(words: &mut Vec<String>, wanted: &[&str]) -> bool {
    let found = (0..words.len()).find(|i| at(words, *i, wanted));
    if let Some(index) = found {
        words.drain(index..index + wanted.len());
    }
    found.is_some()
}

/// Words that change nothing: pronouns, articles, auxiliary verbs and fillers.
pub(super) fn is_filler(word: &str) -> bool {
    FILLERS.contains(&word)
}

#[rustfmt::skip]
const FILLERS: &[&str] = &[
    "a", "actually", "again", "all", "an", "and", "any", "anybody", "anyone", "around", "at", "be", "been", "being",
    "by", "did", "do", "does", "doing", "done", "down", "either", "else", "ever", "exactly", "for", "from", "had",
    "has", "have", "having", "he", "her", "here", "herself", "him", "himself", "his", "i", "in", "is", "it", "its",
    "just", "me", "my", "of", "off", "on", "or", "our", "out", "over", "people", "person", "please", "really",
    "room", "see", "seen", "she", "so", "some", "somebody", "someone", "something", "spend", "spent", "tell",
    "that", "the", "their", "them", "there", "they", "this", "time", "times", "to", "us", "was", "we", "were",
    "with", "you",
];

/// Words of a question that the grammar has no place for: asked for once more, they change the meaning.
pub(super) fn is_question_word(word: &str) -> bool {
    #[rustfmt::skip]
    const WORDS: [&str; 13] = [
        "when", "how", "what", "why", "where", "who", "whose", "whom", "which", "last", "first", "next", "will",
    ];
    WORDS.contains(&word)
}

/// Words that turn the meaning round, or ask for something other than what happened.
pub(super) fn is_negation(word: &str) -> bool {
    #[rustfmt::skip]
    const WORDS: [&str; 16] = [
        "not", "never", "no", "nobody", "none", "without", "cannot", "neither", "nor", "nothing", "always",
        "average", "usually", "normally", "typically", "stop",
    ];
    WORDS.contains(&word) || word.ends_with("n't") || word.starts_with("stopp")
}

/// Words for where somebody lies after a fall.
pub(super) fn is_floor(word: &str) -> bool {
    ["floor", "ground"].contains(&word)
}

/// Words that compare one time with another.
pub(super) fn is_comparison(word: &str) -> bool {
    ["more", "less", "fewer", "than", "longer", "compared"].contains(&word)
}

/// Words that state a time or a number. If one is left, the question is about another time than the one that was
/// understood. "March" is missing, because it is an action as well.
pub(super) fn is_time_word(word: &str) -> bool {
    #[rustfmt::skip]
    const WORDS: &[&str] = &[
        "before", "after", "until", "till", "between", "during", "ago", "since", "now", "currently", "noon",
        "midday", "midnight", "second", "seconds", "minute", "minutes", "hour", "hours", "day", "days", "daily",
        "week", "weeks", "weekend", "weekends", "month", "months", "year", "years", "night", "nights", "morning",
        "mornings", "afternoon", "evening", "today", "yesterday", "tonight", "tomorrow", "am", "pm", "o'clock",
        "twice", "thrice", "per", "every", "each", "then", "while", "earlier", "later", "recently", "january",
        "february", "april", "may", "june", "july", "august", "september", "october", "november", "december",
    ];
    let is_weekday = radarllm_base::civil::WEEKDAYS.iter().any(|day| {
        word.strip_suffix('s')
            .unwrap_or(word)
            .eq_ignore_ascii_case(day)
    });
    WORDS.contains(&word) || is_weekday || word.contains(|c: char| c.is_numeric())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_keep_times_dates_and_apostrophes() {
        let words = split("  Didn\u{2019}t she get up, at 07:30 (2026-11-20) -- or 7 p.m.? ");
        let expected = [
            "didn't",
            "she",
            "get",
            "up",
            "at",
            "07:30",
            "2026-11-20",
            "or",
            "7",
            "pm",
        ];
        assert_eq!(words, expected);
        assert!(split("... ?! ''").is_empty());
    }

    #[test]
    fn lists_do_not_overlap() {
        for word in FILLERS {
            assert!(
                !is_time_word(word)
                    && !is_question_word(word)
                    && !is_negation(word)
                    && !is_comparison(word),
                "{word}"
            );
        }
        assert!(is_time_word("Mondays") && is_time_word("monday") && is_time_word("3rd"));
        assert!(!is_time_word("march"));
    }
}
