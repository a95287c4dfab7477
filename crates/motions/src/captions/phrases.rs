//! Clauses that describe each motion with every applicable attribute, from the templates of the table of captions
//! (`crates/facts/data/captions.tsv`, [`radarllm_facts::tables::caption_rows`]).

use radarllm_facts::tables::{CaptionRow, Expected, Test, caption_rows};

use crate::values::Values;

/// How a caption expresses the number of repetitions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Counting {
    /// The count is never stated.
    Never,
    /// "three times", always when above one.
    Times,
    /// The same, but only in half of the sentences, because the count does not define the
    /// motion.
    Sometimes,
    /// "for eight steps", in half of the sentences.
    Steps,
}

/// How captions of this motion express the count.
pub(super) fn counting(name: &str, v: &Values) -> Counting {
    match name {
        "wave" | "arm_circles" | "jog_in_place" => Counting::Sometimes,
        "pace" => Counting::Never,
        "march" if v.number("distance_m") >= 0.3 => Counting::Never,
        "march" if v.is_set("duration_s") && !v.is_set("repetitions") => Counting::Never,
        "march" => Counting::Steps,
        _ if v.knows("repetitions") => Counting::Times,
        _ => Counting::Never,
    }
}

/// Returns true if "at a slow pace" is idiomatic for this motion.
pub(super) fn paces(name: &str) -> bool {
    matches!(
        name,
        "walk"
            | "walk_turn"
            | "run"
            | "circle"
            | "pace"
            | "march"
            | "limp"
            | "side_step"
            | "jog_in_place"
    )
}

/// Key whose rows describe an unusual size, in addition to the others.
const AMPLITUDE: &str = "amplitude";

fn holds(test: &Test, v: &Values) -> bool {
    let number = || match test.key {
        AMPLITUDE => v.amplitude(),
        "repetitions" => v.count(test.key) as f32,
        key => v.number(key),
    };
    match &test.is {
        Expected::Word(words) => words.contains(&v.word(test.key)),
        Expected::Min(min) => number() >= *min,
        Expected::Max(max) => number() <= *max,
    }
}

/// Clauses of a motion; each states the side, direction and style where they apply. `{the}` is left to be filled, and
/// verbs to be inflected.
pub(super) fn clauses(name: &str, v: &Values) -> Vec<String> {
    let first = |is_sized: bool| {
        let tests_size = |row: &&CaptionRow| row.tests.iter().any(|t| t.key == AMPLITUDE);
        let mut rows = caption_rows(name).filter(|row| tests_size(row) == is_sized);
        rows.find(|row| row.tests.iter().all(|test| holds(test, v)))
    };
    let templates = [first(true), first(false)].into_iter().flatten();
    let both = v.word("side") == "both";
    let direction = v.word("direction");
    let way = match direction {
        "left" => "to the left",
        "right" => "to the right",
        other => other,
    };
    let other = if direction == "left" { "right" } else { "left" };
    let side = match (name, both) {
        // Fists punch in turn, beginning with the left one.
        ("punch", true) => "left",
        (_, true) => "right",
        ("kick" | "lunge", false) => ["left", "right"][crate::motions::acting_side(v)],
        (_, false) => v.word("side"),
    };
    templates
        .flat_map(|row| &row.phrases)
        .map(|template| {
            template
                .replace("{side}", side)
                .replace("{way}", way)
                .replace("{dir}", direction)
                .replace("{other}", other)
        })
        .collect()
}
