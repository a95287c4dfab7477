//! What a request will show, as facts: the same values that its captions are made of.

use radarllm_facts::{
    Action, BodyPart, Count, Direction, Extent, Facts, Path, Posture, Side, Tempo, lexicon,
};

use crate::{
    captions::speed_word,
    motions,
    request::{BuiltinRequest, Part},
};

impl BuiltinRequest {
    /// The facts of the motion: its actions with everything that the values of the request determine. Nobody is named.
    pub fn facts(&self) -> Facts {
        let height_m = self.global.number("height_m");
        let stretches = self.segments.iter().flat_map(|segment| {
            if segment.base.spec.name == "walk_turn" {
                return walk_and_turn(&segment.base, height_m);
            }
            let parts = std::iter::once(&segment.base).chain(&segment.overlay);
            vec![parts.filter_map(|part| action(part, height_m)).collect()]
        });
        Facts {
            subject: None,
            stretches: stretches.collect(),
        }
    }
}

/// The actions of "walks forward, then turns left", one after the other.
fn walk_and_turn(part: &Part, height_m: f32) -> Vec<Vec<Action>> {
    let stooped = (part.values.word("posture") == "stooped").then_some(Posture::Stooped);
    let named = |name| lexicon::name(name).map(Action::named);
    let walk = named("walk").map(|walk| Action {
        direction: Some(Direction::Forward),
        tempo: Some(tempo(part, height_m)),
        posture: stooped,
        ..walk
    });
    let turn = named("turn").map(|turn| Action {
        direction: Some(match part.values.word("direction") {
            "left" => Direction::Left,
            _ => Direction::Right,
        }),
        ..turn
    });
    [walk, turn]
        .into_iter()
        .flatten()
        .map(|action| vec![action])
        .collect()
}

fn tempo(part: &Part, height_m: f32) -> Tempo {
    match speed_word(part, height_m) {
        "slow" => Tempo::Slow,
        "fast" => Tempo::Fast,
        _ => Tempo::Moderate,
    }
}

fn action(part: &Part, height_m: f32) -> Option<Action> {
    let v = &part.values;
    let mut action = Action::named(lexicon::name(part.spec.name)?);
    // Fists punch in turn, beginning with the left one.
    let is_single_punch = action.name == "punch" && v.count("repetitions") == 1;
    action.side = part.spec.key("side").map(|_| match v.word("side") {
        "both" if is_single_punch => Side::Left,
        "both" => Side::Both,
        _ => [Side::Left, Side::Right][motions::acting_side(v)],
    });
    action.body_part = match action.name {
        "wave" | "salute" | "knock" | "throw" | "pick_up" | "drink" | "answer_phone" | "punch" => {
            Some(BodyPart::Hand)
        }
        "raise_arms" if v.word("style") == "hand" => Some(BodyPart::Hand),
        "raise_arms" | "arm_circles" | "point" => Some(BodyPart::Arm),
        "kick" | "balance" | "leg_raise" | "hop" => Some(BodyPart::Leg),
        _ => None,
    };
    action.direction = match v.word("direction") {
        "forward" => Some(Direction::Forward),
        "backward" => Some(Direction::Backward),
        "left" => Some(Direction::Left),
        "right" => Some(Direction::Right),
        "sideways" => Some(Direction::Sideways),
        _ => None,
    };
    action.count = part
        .spec
        .key("repetitions")
        .map(|_| v.count("repetitions"))
        .filter(|_| !matches!(action.name, "pace" | "circle"))
        .and_then(|n| u16::try_from(n).ok())
        .map(Count::Exactly);
    action.tempo = part.spec.key("speed").map(|_| tempo(part, height_m));
    action.extent = match action.name {
        // Angles between the named ones are not known to a reader.
        "turn" => Some(Extent::Degrees(v.number("angle_deg").round() as u16)),
        _ if part.spec.key("amplitude").is_some() => match v.amplitude() {
            a if a >= 1.2 => Some(Extent::Large),
            a if a <= 0.8 => Some(Extent::Small),
            _ => None,
        },
        _ => None,
    };
    action.path = match action.name {
        "walk" | "run" | "limp" => Some(Path::Straight),
        _ => None,
    };
    action.posture = (v.word("posture") == "stooped").then_some(Posture::Stooped);
    Some(action)
}

#[cfg(test)]
mod tests {
    #[test]
    fn requests_know_their_facts() {
        for (request, expected) in [
            (
                "walk?direction=backward&speed=slow",
                "-: walk backward slow straight",
            ),
            (
                "wave?side=left&repetitions=3",
                "-: wave hand left x3 moderate",
            ),
            (
                "turn?direction=right&angle_deg=90&speed=fast",
                "-: turn to_right fast 90deg",
            ),
            (
                "walk+then+sit_down?walk.posture=stooped",
                "-: walk forward moderate straight stooped; sit_down moderate",
            ),
            (
                "punch?side=both&repetitions=1",
                "-: punch hand left x1 moderate",
            ),
            (
                "march+while+clap",
                "-: march x8 moderate + clap x5 moderate",
            ),
        ] {
            let facts = crate::parse(request).unwrap().facts();
            assert_eq!(facts.to_string(), expected);
        }
    }
}
