//! Verb inflection. Templates write verbs as `[walk]`; the sentence determines the verb form.

/// Form of every `[verb]` of a clause.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// "walks".
    Third,
    /// "walking".
    Gerund,
}

/// Verbs that double their last letter before -ing.
const DOUBLING: &[&str] = &[
    "sit", "run", "clap", "hop", "jog", "step", "put", "get", "squat", "spin", "tap", "drop",
    "grab",
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
        ] {
            assert_eq!(inflect(&format!("[{verb}]"), Form::Third), s);
            assert_eq!(inflect(&format!("[{verb}]"), Form::Gerund), ing);
        }
        assert_eq!(
            inflect("[bend] down and [rise]", Form::Gerund),
            "bending down and rising"
        );
    }
}
