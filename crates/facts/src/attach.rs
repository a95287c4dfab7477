//! Whether a sentence that somebody wrote about one motion may describe another one.

use crate::{
    action::{Action, Direction, Extent, Facts, Kind},
    score::{contradictions, is_same_action},
};

/// Why a sentence does not describe a motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Disagreement {
    /// It states no action.
    Nothing,
    /// It states other actions, or the same in another order.
    Actions,
    /// It states an attribute that the motion does not have.
    Attribute(Kind),
}

/// Checks whether a motion does everything that a sentence states, and nothing of importance besides: the same actions
/// in the same order, and every attribute of the sentence known of the motion.
///
/// What a sentence leaves out agrees. Who acts is not compared, because a motion has no sex. An angle within 30 degrees
/// agrees, and walking forward is walking without a direction. The body part of a motion is compared where both state
/// it.
///
/// ```
/// use radarllm_facts::{Facts, Kind, attach::{Disagreement, agrees}, facts};
///
/// let motion: Facts = "-: kick leg left forward x2 fast".parse().unwrap();
/// assert_eq!(agrees(&facts("someone kicks twice with his left leg"), &motion), Ok(()));
/// assert_eq!(
///     agrees(&facts("a man kicks slowly"), &motion),
///     Err(Disagreement::Attribute(Kind::Tempo))
/// );
/// ```
///
/// # Errors
/// The first disagreement.
pub fn agrees(sentence: &Facts, motion: &Facts) -> Result<(), Disagreement> {
    let (said, done): (Vec<&Action>, Vec<&Action>) =
        (sentence.actions().collect(), motion.actions().collect());
    if said.is_empty() {
        return Err(Disagreement::Nothing);
    }
    let same = said.len() == done.len()
        && said
            .iter()
            .zip(&done)
            .all(|(a, b)| is_same_action(a.name, b.name));
    if !same {
        return Err(Disagreement::Actions);
    }
    for (said, done) in said.iter().zip(&done) {
        attributes_agree(said, done).map_err(Disagreement::Attribute)?;
    }
    Ok(())
}

/// Whether a motion does what a claim states, perhaps among other things: the actions of the claim in their order, each with its
/// attributes. `None` if the facts of the motion do not decide it, because they do not state an attribute that the claim
/// states, and for a claim without an action.
///
/// ```
/// use radarllm_facts::{attach::holds, facts};
///
/// let motion = facts("a person walks forward, then waves with the left hand");
/// assert_eq!(holds(&facts("a person waves"), &motion), Some(true));
/// assert_eq!(holds(&facts("a person waves with the right hand"), &motion), Some(false));
/// assert_eq!(holds(&facts("a person waves twice"), &motion), None);
/// assert_eq!(holds(&facts("a person sits down"), &motion), Some(false));
/// ```
pub fn holds(claim: &Facts, motion: &Facts) -> Option<bool> {
    let mut said = claim.actions().peekable();
    said.peek()?;
    let all: Vec<&Action> = motion.actions().collect();
    let (mut at, mut is_open) = (0, false);
    for said in said {
        let same = |done: &Action| is_same_action(said.name, done.name);
        let agrees = |done: &Action| same(done) && attributes_agree(said, done).is_ok();
        if let Some(next) = all[at..].iter().position(|done| agrees(done)) {
            at += next + 1;
            continue;
        }
        let may_be = |done: &&Action| same(done) && contradictions(said, done).is_empty();
        if !all.iter().copied().any(|done| may_be(&done)) {
            return Some(false);
        }
        is_open = true;
    }
    (!is_open).then_some(true)
}

fn attributes_agree(said: &Action, done: &Action) -> Result<(), Kind> {
    let known = done.attributes();
    for (kind, word) in said.attributes() {
        let agrees = match kind {
            Kind::BodyPart => done.body_part.is_none() || known.contains(&(kind, word)),
            Kind::Extent => match (said.extent, done.extent) {
                (Some(Extent::Degrees(a)), Some(Extent::Degrees(b))) => a.abs_diff(b) <= 30,
                (a, b) => a == b,
            },
            Kind::Direction => {
                said.direction == done.direction
                    || done.direction.is_none()
                        && said.direction == Some(Direction::Forward)
                        && matches!(done.name, "walk" | "run" | "limp" | "march")
            }
            _ => known.contains(&(kind, word)),
        };
        if !agrees {
            return Err(kind);
        }
    }
    match contradictions(said, done).first() {
        // Angles were compared with their tolerance.
        Some(kind) if *kind != Kind::Extent => Err(*kind),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_said_must_be_done_and_what_is_left_out_agrees() {
        let motion = "-: walk; turn to_left 180deg; wave hand right x3";
        for (sentence, expected) in [
            ("-: walk; turn; wave", Ok(())),
            ("man: walk forward; turn 160deg; wave right", Ok(())),
            ("-: walk; wave", Err(Disagreement::Actions)),
            ("-: turn; walk; wave", Err(Disagreement::Actions)),
            ("-:", Err(Disagreement::Nothing)),
            (
                "-: walk backward; turn; wave",
                Err(Disagreement::Attribute(Kind::Direction)),
            ),
            (
                "-: walk; turn 90deg; wave",
                Err(Disagreement::Attribute(Kind::Extent)),
            ),
            (
                "-: walk; turn; wave xmany",
                Err(Disagreement::Attribute(Kind::Count)),
            ),
            (
                "-: walk; turn; wave arm",
                Err(Disagreement::Attribute(Kind::BodyPart)),
            ),
            (
                "-: walk; turn; wave left",
                Err(Disagreement::Attribute(Kind::Side)),
            ),
        ] {
            let (sentence, motion): (Facts, Facts) =
                (sentence.parse().unwrap(), motion.parse().unwrap());
            assert_eq!(agrees(&sentence, &motion), expected, "{sentence}");
        }
    }
}
