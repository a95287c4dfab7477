//! A sentence for measured facts: what happens is measured or recognised, and written by rules.

use std::collections::BTreeMap;

use radarllm_dataset::ClipRecord;
use radarllm_facts::{Action, Direction, Facts, Side, Subject, facts, lexicon, write::Writer};

use super::{classes::Classes, rules::measured};
use crate::{EvalError, descriptor::descriptor};

/// For each clip, a sentence written from facts that rules measure: the way of the points over the floor, the height of
/// their top, and where fast points are. A person is taken to face the radar. Nothing is learned here; the thresholds of
/// the rules were chosen on training clips of the motion library.
pub fn measured_captions(clips: &[ClipRecord], seed: u64) -> Vec<String> {
    let writer = Writer::new();
    clips
        .iter()
        .map(|clip| write(&writer, &measured(&clip.frames, clip.radar_height_m), seed))
        .collect()
}

/// The sentence of facts; their actions alone if there is no wording for all of them.
pub(super) fn write(writer: &Writer, all: &Facts, seed: u64) -> String {
    let plain = || Facts {
        subject: all.subject,
        stretches: all
            .stretches
            .iter()
            .map(|s| s.iter().map(|a| Action::named(a.name)).collect())
            .collect(),
    };
    let written = writer
        .write_fully(all, seed)
        .or_else(|| writer.write_fully(&plain(), seed));
    written.map_or_else(|| "a person moves".into(), |w| w.text)
}

/// For each clip, a sentence written from facts that forests recognise by [`descriptor`]: which actions in which order, and
/// their sides and directions. The forests learn from the facts of the first training captions.
///
/// # Errors
/// Training clips from which nothing can be learned.
pub fn forest_facts_captions(
    train: &[ClipRecord],
    clips: &[ClipRecord],
    seed: u64,
) -> Result<Vec<String>, EvalError> {
    let of = |clip: &ClipRecord| descriptor(&clip.frames, clip.radar_height_m);
    let (rows, stated): (Vec<Vec<f32>>, Vec<Facts>) = train
        .iter()
        .filter_map(|clip| {
            let facts = facts(clip.captions.first()?);
            facts.actions().next()?;
            Some((of(clip), facts))
        })
        .unzip();
    let classes = |name: &dyn Fn(&Facts) -> String| {
        let names: Vec<String> = stated.iter().map(name).collect();
        Classes::fit(&rows, &names, seed)
    };
    let orders = classes(&order)?;
    let sides = classes(&|facts| value(facts, |a| a.side.map(Side::word)))?;
    let directions = classes(&|facts| value(facts, |a| a.direction.map(Direction::word)))?;
    // How often the actions of an order have a side or a direction.
    let mut habits: BTreeMap<String, (usize, Vec<[usize; 2]>)> = BTreeMap::new();
    for facts in &stated {
        let n = facts.actions().count();
        let (count, of_actions) = habits.entry(order(facts)).or_insert((0, vec![[0; 2]; n]));
        *count += 1;
        for (habit, action) in of_actions.iter_mut().zip(facts.actions()) {
            habit[0] += usize::from(action.side.is_some());
            habit[1] += usize::from(action.direction.is_some());
        }
    }
    let writer = Writer::new();
    Ok(clips
        .iter()
        .map(|clip| {
            let row = of(clip);
            let found = orders.recognise(&row, |_| true);
            let mut facts = Facts {
                subject: Some(Subject::Person),
                stretches: found.split(';').map(actions_of).collect(),
            };
            let (count, of_actions) = habits.get(found).cloned().unwrap_or_default();
            for (action, habit) in facts.stretches.iter_mut().flatten().zip(of_actions) {
                if 2 * habit[0] > count {
                    let word = sides.recognise(&row, |word| word != NONE);
                    let _ = action.add(word);
                }
                if 2 * habit[1] > count {
                    let word = directions.recognise(&row, |word| word != NONE);
                    let _ = action.add(word);
                }
            }
            write(&writer, &facts, seed)
        })
        .collect())
}

/// Nothing stated.
const NONE: &str = "-";

/// The names of all actions in order: `walk;turn+wave`.
fn order(facts: &Facts) -> String {
    let stretches = facts.stretches.iter().map(|s| label(s));
    stretches.collect::<Vec<_>>().join(";")
}

/// Names of the actions of a stretch: `turn+wave`.
pub(super) fn label(actions: &[Action]) -> String {
    actions.iter().map(|a| a.name).collect::<Vec<_>>().join("+")
}

/// The actions of a [`label`].
pub(super) fn actions_of(label: &str) -> Vec<Action> {
    let names = label.split('+').filter_map(lexicon::name);
    names.map(Action::named).collect()
}

/// The first value of a kind that facts state.
fn value(facts: &Facts, of: impl Fn(&Action) -> Option<&'static str>) -> String {
    facts.actions().find_map(of).unwrap_or(NONE).into()
}

#[cfg(test)]
mod tests {
    use super::{super::retrieval::tests::clip, *};

    #[test]
    fn measured_facts_become_sentences_that_state_them() {
        let clips = [
            clip("x", "-", 40, |t| [0.0, 6.0 - 3.6 * t, 0.2]),
            clip("y", "-", 24, |t| [0.0, 3.0 + 0.4 * t, 0.4 - 0.4 * t]),
        ];
        let texts = measured_captions(&clips, 1);
        assert_eq!(facts(&texts[0]).to_string(), "person: walk forward");
        assert_eq!(facts(&texts[1]).to_string(), "person: sit_down");
        assert_eq!(texts, measured_captions(&clips, 1));
    }

    #[test]
    fn forests_recognise_what_captions_state() {
        let make = |i: usize| {
            let shift = 0.01 * i as f32;
            match i % 2 {
                0 => clip(&format!("{i}"), "a person walks forward", 40, move |t| {
                    [shift, 4.0 - 2.0 * t, 0.0]
                }),
                _ => clip(&format!("{i}"), "a person sits down", 40, move |t| {
                    [shift, 3.0, 0.4 - 0.8 * t]
                }),
            }
        };
        let train: Vec<ClipRecord> = (0..20).map(make).collect();
        let texts = forest_facts_captions(&train, &[make(30), make(31)], 1).unwrap();
        assert_eq!(facts(&texts[0]).to_string(), "person: walk forward");
        assert_eq!(facts(&texts[1]).to_string(), "person: sit_down");
        assert!(forest_facts_captions(&[], &[], 1).is_err());
    }
}
