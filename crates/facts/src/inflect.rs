//! Verb inflection. Templates write verbs as `[walk]`; the sentence determines the verb form.

/// Form of every `[verb]` of a clause.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// "walks".
    Third,
    /// "walking".
    Gerund,
    /// "walk".
    Base,
    /// "walked".
    Past,
}

/// Verbs with a past tense of their own.
const IRREGULAR: &[(&str, &str)] = &[
    ("go", "went"),
    ("run", "ran"),
    ("sit", "sat"),
    ("stand", "stood"),
    ("take", "took"),
    ("lie", "lay"),
    ("get", "got"),
    ("fall", "fell"),
    ("rise", "rose"),
    ("throw", "threw"),
    ("catch", "caught"),
    ("hold", "held"),
    ("swing", "swung"),
    ("spin", "spun"),
    ("kneel", "knelt"),
    ("bend", "bent"),
    ("bring", "brought"),
    ("make", "made"),
    ("do", "did"),
    ("come", "came"),
    ("lose", "lost"),
    ("put", "put"),
    ("set", "set"),
    ("cut", "cut"),
    ("hit", "hit"),
    ("shut", "shut"),
    ("swim", "swam"),
    ("sweep", "swept"),
    ("shake", "shook"),
    ("drink", "drank"),
    ("give", "gave"),
    ("begin", "began"),
    ("strike", "struck"),
    ("fling", "flung"),
    ("speak", "spoke"),
    ("write", "wrote"),
    ("draw", "drew"),
    ("dig", "dug"),
    ("shoot", "shot"),
    ("stride", "strode"),
    ("fight", "fought"),
];

/// Verbs that double their last letter before -ing.
const DOUBLING: &[&str] = &[
    "sit", "run", "clap", "hop", "jog", "step", "put", "get", "squat", "spin", "tap", "drop",
    "grab", "nod", "pat", "trip", "swat", "stop", "grip", "shrug", "mop", "swim", "cut", "sip",
    "lob", "chop", "jab", "skid", "skip", "dig", "flap", "strum", "drag", "spar", "shut", "set",
    "hit", "rub", "stir", "pet", "begin",
];

/// Replaces every `[verb]` with the requested form.
pub fn inflect(template: &str, form: Form) -> String {
    let mut out = String::with_capacity(template.len() + 8);
    let mut rest = template;
    while let Some((before, after)) = rest.split_once('[') {
        out.push_str(before);
        let (verb, tail) = after.split_once(']').unwrap_or((after, ""));
        match form {
            Form::Third => out.push_str(&third(verb)),
            Form::Gerund => out.push_str(&gerund(verb)),
            Form::Base => out.push_str(verb),
            Form::Past => out.push_str(&past(verb)),
        }
        rest = tail;
    }
    out.push_str(rest);
    out
}

fn third(verb: &str) -> String {
    let hissing = ["s", "x", "z", "ch", "sh", "o"]
        .iter()
        .any(|end| verb.ends_with(end));
    match verb.strip_suffix('y') {
        Some(stem) if !stem.ends_with(['a', 'e', 'o', 'u']) => format!("{stem}ies"),
        _ if hissing => format!("{verb}es"),
        _ => format!("{verb}s"),
    }
}

fn past(verb: &str) -> String {
    if let Some((_, past)) = IRREGULAR.iter().find(|(base, _)| *base == verb) {
        return (*past).to_string();
    }
    if DOUBLING.contains(&verb) {
        let last = &verb[verb.len() - 1..];
        return format!("{verb}{last}ed");
    }
    match (verb.strip_suffix('e'), verb.strip_suffix('y')) {
        (Some(stem), _) => format!("{stem}ed"),
        (_, Some(stem)) if !stem.ends_with(['a', 'e', 'o', 'u']) => format!("{stem}ied"),
        _ => format!("{verb}ed"),
    }
}

fn gerund(verb: &str) -> String {
    if let Some(stem) = verb.strip_suffix("ie") {
        return format!("{stem}ying");
    }
    if DOUBLING.contains(&verb) {
        let last = &verb[verb.len() - 1..];
        return format!("{verb}{last}ing");
    }
    match verb.strip_suffix('e') {
        Some(stem) if !stem.ends_with('e') => format!("{stem}ing"),
        _ => format!("{verb}ing"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verbs_take_their_english_forms() {
        for (verb, s, ing) in [
            ("walk", "walks", "walking"),
            ("sit", "sits", "sitting"),
            ("lie", "lies", "lying"),
            ("raise", "raises", "raising"),
            ("punch", "punches", "punching"),
            ("push", "pushes", "pushing"),
            ("do", "does", "doing"),
            ("carry", "carries", "carrying"),
            ("stay", "stays", "staying"),
            ("kneel", "kneels", "kneeling"),
            ("stretch", "stretches", "stretching"),
            ("trip", "trips", "tripping"),
        ] {
            assert_eq!(inflect(&format!("[{verb}]"), Form::Third), s);
            assert_eq!(inflect(&format!("[{verb}]"), Form::Gerund), ing);
        }
        for (verb, past) in [
            ("walk", "walked"),
            ("raise", "raised"),
            ("carry", "carried"),
            ("clap", "clapped"),
            ("throw", "threw"),
            ("play", "played"),
        ] {
            assert_eq!(inflect(&format!("[{verb}]"), Form::Past), past);
        }
        assert_eq!(
            inflect("[bend] down and [rise]", Form::Gerund),
            "bending down and rising"
        );
    }
}
