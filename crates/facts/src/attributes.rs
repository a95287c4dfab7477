//! The attributes of an action, from the words around it.

use crate::{
    action::{
        Action, BodyPart, Count, Direction, Duration, Extent, Height, Manner, Path, Posture, Side,
        Tempo,
    },
    words::number,
};

/// Parts of the body whose side is the acting side.
const LIMBS: [&str; 30] = [
    "hand", "hands", "arm", "arms", "fist", "fists", "leg", "legs", "foot", "feet", "knee", "ear",
    "knees", "elbow", "elbows", "forearm", "forearms", "wrist", "wrists", "shoulder", "toe",
    "toes", "heel", "hip", "thigh", "ankle", "finger", "palm", "calf", "hooks",
];

/// Fills in what the words state of an action. `at` is the place of its first word among them.
pub(crate) fn fill(action: &mut Action, words: &[&str], at: usize) {
    action.side = side(action.name, words, at);
    action.direction = direction(action.name, words, at);
    action.posture = posture(action.name, words);
    action.height = height(action.name, words);
    action.body_part = body_part(action, words);
    action.tempo = tempo(words);
    action.count = count(action.name, words);
    action.extent = extent(action.name, words);
    action.path = path(action.name, words);
    action.manner = manner(words);
    action.duration = duration(words);
}

fn any(words: &[&str], wanted: &[&str]) -> bool {
    words.iter().any(|w| wanted.contains(w))
}

/// Whether the words contain a phrase: words separated by spaces, alternatives by `|`, `_` is any word.
fn phrase(words: &[&str], phrase: &str) -> bool {
    let wanted: Vec<&str> = phrase.split(' ').collect();
    words.windows(wanted.len()).any(|window| {
        window.iter().zip(&wanted).all(|(word, alternatives)| {
            *alternatives == "_" || alternatives.split('|').any(|a| a == *word)
        })
    })
}

fn side(name: &str, words: &[&str], at: usize) -> Option<Side> {
    let with_limb = |side: &str| {
        words.iter().enumerate().any(|(i, w)| {
            *w == side
                && words[i + 1..].iter().take(2).enumerate().any(|(n, next)| {
                    // "To the left with his hand" states no side of the hand.
                    LIMBS.contains(next)
                        && !(name == "turn" && *next == "shoulder")
                        && (n == 0 || !PREPOSITIONS.contains(&words[i + 1]))
                })
        })
    };
    let alternating = any(
        words,
        &["alternating", "alternately", "alternates", "alternate"],
    ) && !matches!(name, "walk" | "run");
    let two = phrase(words, "two hands|arms|fists|feet|legs")
        || phrase(words, "both of _ hands|arms|feet|legs|knees")
        || phrase(words, "left and right hand|hands|arm|arms|fist|fists")
        || matches!(name, "kneel") && phrase(words, "on both");
    let (left, right) = (with_limb("left"), with_limb("right"));
    // "A left kick", "left-handed".
    let before = words[..at].last().copied().unwrap_or_default();
    let is_strike = matches!(name, "kick" | "punch" | "lunge" | "hit" | "throw");
    let left =
        left || any(
            words,
            &[
                "left-handed",
                "left-hand",
                "lefthand",
                "left-legged",
                "left-foot",
            ],
        ) || is_strike && before == "left";
    let right = right
        || any(
            words,
            &[
                "right-handed",
                "right-hand",
                "righthand",
                "right-legged",
                "right-foot",
            ],
        )
        || is_strike && before == "right";
    match (left, right) {
        _ if with_limb("both") || alternating || two => Some(Side::Both),
        (true, true) => Some(Side::Both),
        (true, false) => Some(Side::Left),
        (false, true) => Some(Side::Right),
        (false, false) => None,
    }
}

const PREPOSITIONS: [&str; 17] = [
    "with", "and", "while", "then", "to", "in", "as", "on", "using", "for", "at", "before",
    "after", "away", "behind", "from", "by",
];

/// Actions after which "left" and "right" alone are directions: "turns left".
fn goes_somewhere(name: &str) -> bool {
    matches!(
        name,
        "walk"
            | "run"
            | "turn"
            | "side_step"
            | "jump"
            | "hop"
            | "skip"
            | "lean"
            | "look"
            | "crawl"
            | "stumble"
            | "side_bend"
            | "twist"
            | "dodge"
            | "slide"
            | "circle"
            | "sway"
            | "march"
            | "step_over"
    )
}

fn direction(name: &str, words: &[&str], at: usize) -> Option<Direction> {
    let mut sideways = None;
    for (i, word) in words.iter().enumerate() {
        let next = words.get(i + 1).copied().unwrap_or_default();
        let before = |n: usize| i.checked_sub(n).map_or("", |k| words[k]);
        let is_place = i > 0
            && matches!(
                before(1),
                "the" | "his" | "her" | "their" | "its" | "your" | "to" | "towards" | "toward"
            )
            && !LIMBS.contains(&next)
            && (matches!(before(2), "to" | "towards" | "toward" | "into") || before(1) == "to")
            // "From side to side, left" and "left to right" end where they end.
            && !matches!(before(1), "towards" if LIMBS.contains(&next));
        let alone = goes_somewhere(name)
            && i > at
            && (next.is_empty()
                || PREPOSITIONS.contains(&next)
                || matches!(next, "side" | "again" | "slightly" | "slowly" | "turn"))
            && !matches!(
                before(1),
                "the" | "his" | "her" | "their" | "its" | "your" | "from"
            )
            && !matches!(
                (*word, next),
                ("right", "after" | "before" | "away" | "at" | "in")
            );
        let turn = name == "turn" && ["turn", "face"].contains(&next);
        let towards = |d: Direction| match is_place || alone || turn {
            true => Some(d),
            false => None,
        };
        let found = match *word {
            "forward" | "ahead" => Some(Direction::Forward),
            "forwards" | "front-kicks" | "front-kick" => Some(Direction::Forward),
            "backward" | "backwards" | "reverse" => Some(Direction::Backward),
            "backwardly" => Some(Direction::Backward),
            "back"
                if steps_back(name, words)
                    && !matches!(next, "to" | "and" | "of" | "leg" | "foot")
                    && !matches!(before(1), "the" | "his" | "her" | "their" | "its") =>
            {
                Some(Direction::Backward)
            }
            "counterclockwise" => Some(Direction::Left),
            "clockwise" => Some(Direction::Right),
            "leftwards" => Some(Direction::Left),
            "rightwards" => Some(Direction::Right),
            "upward" | "upwards" | "overhead" => Some(Direction::Up),
            "downward" | "downwards" => Some(Direction::Down),
            "left" => towards(Direction::Left),
            "right" => towards(Direction::Right),
            "sideways" => {
                sideways = Some(Direction::Sideways);
                None
            }
            "side"
                if matches!(before(1), "the" | "their" | "his" | "her" | "one")
                    && matches!(before(2), "to" | "on")
                    && next != "to" =>
            {
                sideways = Some(Direction::Sideways);
                None
            }
            _ => None,
        };
        if found.is_some() {
            return found;
        }
    }
    sideways.filter(|_| name != "side_step")
}

/// Whether "back" means backward: "steps back", but not "walks back".
fn steps_back(name: &str, words: &[&str]) -> bool {
    match name {
        "walk" => any(words, &["stepping", "step", "steps", "moves", "backs"]),
        "jump" | "hop" | "lean" | "stumble" | "skip" | "fall" | "kick" => true,
        _ => false,
    }
}

fn is_locomotion(name: &str) -> bool {
    matches!(
        name,
        "walk"
            | "run"
            | "crawl"
            | "skip"
            | "hop"
            | "march"
            | "limp"
            | "jump"
            | "stumble"
            | "side_step"
            | "dance"
            | "pace"
            | "circle"
            | "slide"
            | "swim"
    )
}

fn is_of_arms(name: &str) -> bool {
    matches!(
        name,
        "raise_arms"
            | "lower_arms"
            | "move_arms"
            | "swing_arms"
            | "bend_arms"
            | "wave"
            | "reach"
            | "cross_arms"
            | "uncross_arms"
            | "arm_circles"
            | "touch"
            | "stretch"
            | "flap"
            | "clap"
            | "hands_on_hips"
            | "join_hands"
            | "gesture"
            | "hold"
            | "point"
    )
}

fn posture(name: &str, words: &[&str]) -> Option<Posture> {
    const OWNER: &str = "his|her|their|its|the|both|your|out";
    let of_limbs = |limbs: &str, what: &str| {
        (0..3).any(|gap| {
            let fill = "_ ".repeat(gap);
            phrase(words, &format!("{limbs} {fill}{what}"))
        })
    };
    let arms = "arms|hands|arm";
    if any(words, &["tpose"]) {
        return Some(Posture::ArmsOut);
    }
    if phrase(words, "all fours") || phrase(words, "hands and knees") {
        return Some(Posture::AllFours).filter(|_| name != "crawl");
    }
    if of_limbs("legs|feet", "apart|wide") || phrase(words, "wide|wider stance|stances") {
        return Some(Posture::LegsApart);
    }
    if any(
        words,
        &[
            "hunched",
            "stooped",
            "slouched",
            "hunching",
            "doubled",
            "doubled-over",
            "slumped",
        ],
    ) || name != "bend" && phrase(words, "bent over|forward")
    {
        return Some(Posture::Stooped);
    }
    if any(words, &["crouched"]) {
        return Some(Posture::Crouched).filter(|_| name != "crouch");
    }
    let starts_from = phrase(words, "from standing|sitting|lying");
    if !starts_from && any(words, &["upright"])
        || phrase(words, "stands|standing|stand straight|tall")
    {
        return Some(Posture::Upright);
    }
    if matches!(name, "stand_still" | "stand_up") && any(words, &["straight"]) {
        return Some(Posture::Upright);
    }
    if !is_of_arms(name) || name == "hold" && !any(words, &["left", "right"]) {
        if phrase(
            words,
            &format!("{arms} at|by|beside|near {OWNER} sides|side|hips"),
        ) || phrase(
            words,
            &format!("{arms} down at|by|beside {OWNER} sides|side|hips"),
        ) || of_limbs(arms, "hanging|drooping")
            || phrase(words, &format!("{arms} to {OWNER} sides"))
        {
            return Some(Posture::ArmsDown);
        }
        if of_limbs(arms, "out|outstretched|extended|spread|outwards|outward")
            || phrase(words, "outstretched|extended|spread arms|hands")
        {
            return Some(Posture::ArmsOut);
        }
        if of_limbs(arms, "up|raised") && !any(words, &["down"])
            || phrase(words, "raised arms|hands")
        {
            return Some(Posture::ArmsUp);
        }
    }
    None
}

fn height(name: &str, words: &[&str]) -> Option<Height> {
    const TO: &str =
        "to|at|near|towards|toward|around|over|on|in|of|behind|against|up|holds|holding|holding";
    const OWNER: &str = "his|her|their|the|its|your|both";
    let reaches = |what: &str| {
        phrase(words, &format!("{TO} {OWNER} {what}"))
            || phrase(words, &format!("{TO} {what}"))
            || phrase(words, &format!("{what} height|level|high|length"))
    };
    if any(words, &["overhead"])
        || phrase(words, &format!("above|over|overtop {OWNER} head|heads"))
        || phrase(words, "above|over head")
    {
        return Some(Height::Overhead);
    }
    let with_arms = is_of_arms(name)
        || matches!(
            name,
            "pick_up"
                | "place"
                | "grab"
                | "move_object"
                | "throw"
                | "catch"
                | "drink"
                | "shake"
                | "walk"
                | "rub"
                | "wipe"
                | "scratch"
                | "swing_arms"
                | "shout"
                | "answer_phone"
                | "kick"
                | "leg_raise"
                | "bend"
                | "crouch"
                | "look"
        );
    if with_arms && name != "look" {
        if reaches("face|mouth|head|ear|ears|eye|eyes|chin|nose|forehead|hair|cheek") {
            return Some(Height::Head);
        }
        if reaches("shoulder|shoulders") {
            return Some(Height::Shoulder);
        }
        if reaches("chest|breast|heart") {
            return Some(Height::Chest);
        }
        if name != "hands_on_hips" && reaches("waist|hip|hips") {
            return Some(Height::Waist);
        }
        if reaches("knee|knees") {
            return Some(Height::Knee);
        }
    }
    let to_floor = matches!(
        name,
        "pick_up"
            | "place"
            | "touch"
            | "move_arms"
            | "bend"
            | "reach"
            | "crouch"
            | "look"
            | "grab"
            | "lower_arms"
            | "kneel"
    );
    if to_floor
        && phrase(
            words,
            "from|off|on|to|at|of|onto|touches|touching the|floor|ground floor|ground|floors",
        )
    {
        return Some(Height::Floor);
    }
    if any(words, &["high", "higher", "high-steps", "highly"]) {
        return Some(Height::High);
    }
    any(words, &["low", "lower"])
        .then_some(Height::Low)
        .filter(|_| !matches!(name, "lower_arms" | "raise_arms" | "leg_raise" | "lunge"))
}

fn body_part(action: &Action, words: &[&str]) -> Option<BodyPart> {
    let limbs_of_posture = matches!(
        action.posture,
        Some(
            Posture::ArmsOut
                | Posture::ArmsDown
                | Posture::ArmsUp
                | Posture::AllFours
                | Posture::LegsApart
        )
    );
    for (i, word) in words.iter().enumerate() {
        let before = |n: usize| i.checked_sub(n).map_or("", |k| words[k]);
        let owned = matches!(
            before(1),
            "his" | "her" | "their" | "the" | "its" | "your" | "both" | "left" | "right"
        );
        let preposition = before(if owned { 2 } else { 1 });
        let is_goal = matches!(
            preposition,
            "to" | "above"
                | "over"
                | "at"
                | "near"
                | "behind"
                | "on"
                | "toward"
                | "towards"
                | "of"
                | "around"
                | "against"
                | "touch"
                | "touches"
                | "touching"
        );
        let next = words.get(i + 1).copied().unwrap_or_default();
        if matches!(next, "height" | "level" | "high" | "length") {
            continue;
        }
        let part = match *word {
            "hand" | "hands" | "fist" | "fists" | "wrist" | "wrists" | "palm" | "palms"
            | "finger" | "fingers" | "right-handed" | "left-handed" | "handed" | "one-handed" => {
                BodyPart::Hand
            }
            "arm" | "arms" | "forearm" | "forearms" => BodyPart::Arm,
            "elbow" | "elbows" if !is_goal => BodyPart::Elbow,
            "shoulder" | "shoulders" if !is_goal => BodyPart::Shoulder,
            "head" if !is_goal => BodyPart::Head,
            "torso" | "waist" if !is_goal => BodyPart::Torso,
            "body" if before(1) == "upper" => BodyPart::Torso,
            "hip" | "hips" if !is_goal => BodyPart::Hip,
            "leg" | "legs" | "thigh" | "right-legged" | "left-legged" => BodyPart::Leg,
            "knee" | "knees" if !is_goal || preposition == "on" => BodyPart::Knee,
            "foot" | "feet" | "heel" | "toe" => BodyPart::Foot,
            _ => continue,
        };
        // "Walks with drooping shoulders" is no motion of the shoulders.
        if is_locomotion(action.name)
            && matches!(
                part,
                BodyPart::Shoulder | BodyPart::Head | BodyPart::Torso | BodyPart::Hip
            )
        {
            continue;
        }
        let is_posture = limbs_of_posture
            && match part {
                BodyPart::Arm | BodyPart::Hand => !is_of_arms(action.name),
                BodyPart::Leg | BodyPart::Foot => action.posture == Some(Posture::LegsApart),
                BodyPart::Knee => action.posture == Some(Posture::AllFours),
                _ => false,
            };
        if !is_posture {
            return Some(part);
        }
    }
    None
}

fn tempo(words: &[&str]) -> Option<Tempo> {
    if let Some(rate) = rate(words) {
        return Some(Tempo::PerMinute(rate));
    }
    words.iter().enumerate().find_map(|(i, word)| match *word {
        "slowly" | "slow" | "slower" | "slowing" => Some(Tempo::Slow),
        "quickly" | "fast" | "quick" | "rapidly" | "rapid" | "briskly" | "brisk" | "swiftly"
        | "hurriedly" | "fastly" | "faster" | "speedily" | "hurried" | "quicker" | "hastily"
        | "sprints" | "sprint" | "sprinting" | "sprinted" | "rushes" | "rushing" | "swift" => {
            Some(Tempo::Fast)
        }
        "normally" | "moderately" => Some(Tempo::Moderate),
        "normal" | "moderate" | "regular" | "medium" | "steady" | "average"
            if matches!(
                words.get(i + 1).copied(),
                Some("pace" | "speed" | "paced" | "tempo" | "rate" | "walking")
            ) =>
        {
            Some(Tempo::Moderate)
        }
        _ => None,
    })
}

/// Repetitions per minute: "twice a second", "thirty times a minute".
fn rate(words: &[&str]) -> Option<u16> {
    words.iter().enumerate().find_map(|(i, word)| {
        let per = match (*word, words.get(i + 1).copied()) {
            ("a" | "per" | "every" | "each", Some("second")) => 60,
            ("a" | "per" | "every" | "each", Some("minute")) => 1,
            _ => return None,
        };
        let times = match words[..i] {
            [.., "once"] => 1,
            [.., "twice"] => 2,
            [.., n, "times" | "time"] => number(n)?,
            _ => return None,
        };
        times.checked_mul(per)
    })
}

/// Nouns of things that are counted.
fn is_counted(word: &str) -> bool {
    matches!(
        word.trim_end_matches('s'),
        "time"
            | "step"
            | "jack"
            | "jump"
            | "hop"
            | "squat"
            | "kick"
            | "clap"
            | "circle"
            | "lap"
            | "rep"
            | "skip"
            | "leap"
            | "wave"
            | "bow"
            | "turn"
            | "pace"
            | "swing"
            | "stroke"
            | "shot"
            | "repetition"
            | "punche"
            | "punch"
            | "lunge"
            | "spin"
            | "rotation"
            | "push"
            | "point"
            | "stride"
            | "throw"
            | "set"
            | "bounce"
            | "twirl"
            | "curl"
            | "knock"
            | "jab"
            | "sidestep"
            | "uppercut"
            | "hook"
    )
}

fn count(name: &str, words: &[&str]) -> Option<Count> {
    let is_rate = rate(words).is_some();
    for (i, word) in words.iter().enumerate() {
        let after: Vec<&str> = words[i + 1..].iter().take(4).copied().collect();
        let next = after.first().copied().unwrap_or_default();
        let before = i.checked_sub(1).map_or("", |k| words[k]);
        // The counted noun, with at most two adjectives before it.
        let noun = after
            .iter()
            .take(4)
            .take_while(|w| !LIMBS.contains(w) && !PREPOSITIONS.contains(w))
            .find(|w| is_counted(w));
        match *word {
            "once"
                if !is_rate
                    && before != "at"
                    && !matches!(next, "again" | "more" | "the" | "he" | "she" | "they" | "a") =>
            {
                return Some(Count::Exactly(1));
            }
            "twice" if !is_rate => return Some(Count::Exactly(2)),
            "repeatedly" | "continuously" | "continually" => return Some(Count::Many),
            "several" | "some" | "few" | "multiple" | "couple" | "many" | "various"
            | "numerous" | "series"
                if noun.is_some() || word == &"series" && after.iter().any(|w| is_counted(w)) =>
            {
                return Some(Count::Many);
            }
            "couple"
                if after.starts_with(&["of", "times"]) || after.starts_with(&["of", "steps"]) =>
            {
                return Some(Count::Many);
            }
            "over" if after.starts_with(&["and", "over"]) => return Some(Count::Many),
            "again" if after.starts_with(&["and", "again"]) => return Some(Count::Many),
            "single" if noun.is_some() => return Some(Count::Exactly(1)),
            "a" | "an" | "another"
                if is_step_action(name)
                    && name != "step_over"
                    && !after.iter().take(2).any(|w| matches!(*w, "few" | "couple"))
                    && after.iter().take(3).any(|w| *w == "step")
                    && !after.contains(&"time") =>
            {
                return Some(Count::Exactly(1));
            }
            _ => {}
        }
        let Some(n) = number(word) else { continue };
        let is_time = matches!(noun, Some(&"time" | &"times"));
        if noun.is_some() && !(is_rate && is_time) {
            // "One more time" and "first one time" count too; "one step at a time" does not.
            if !phrase(words, "one step at a time") {
                return Some(Count::Exactly(n));
            }
        } else if is_step_action(name) && next == "to" && n < 20 {
            return Some(Count::Exactly(n));
        }
    }
    None
}

fn is_step_action(name: &str) -> bool {
    matches!(
        name,
        "walk"
            | "side_step"
            | "stumble"
            | "skip"
            | "run"
            | "march"
            | "hop"
            | "jump"
            | "step_over"
            | "climb"
    )
}

fn extent(name: &str, words: &[&str]) -> Option<Extent> {
    for (i, word) in words.iter().enumerate() {
        let next = words.get(i + 1).copied().unwrap_or_default();
        if let Some(n) = number(word)
            && next.starts_with("degree")
        {
            return Some(Extent::Degrees(n));
        }
        if let Some(digits) = word
            .strip_suffix("-degree")
            .or_else(|| word.strip_suffix('\u{b0}'))
            .or_else(|| word.strip_suffix("-degrees"))
            && let Some(n) = number(digits)
        {
            return Some(Extent::Degrees(n));
        }
    }
    let round = matches!(
        name,
        "turn" | "circle" | "walk" | "run" | "jump" | "hop" | "side_step"
    );
    if round {
        let arc = "turn|circle|turns|spin|rotation|of|circles";
        if phrase(words, &format!("quarter {arc}"))
            || any(words, &["quarter-turn", "quarter-circle"])
        {
            return Some(Extent::Degrees(90));
        }
        if phrase(words, &format!("half {arc}"))
            || any(words, &["semicircle", "uturn", "half-turn"])
        {
            return Some(Extent::Degrees(180));
        }
        if name == "turn"
            && (phrase(words, "full|complete|whole circle|turn|rotation|spin")
                || phrase(words, "all the way around")
                || phrase(words, "in a circle")
                || phrase(words, "in a counterclockwise|clockwise circle"))
        {
            return Some(Extent::Degrees(360));
        }
    }
    let spins = any(words, &["spins", "spin", "spinning", "twirls", "rotates"]);
    if name == "turn"
        && !spins
        && (any(words, &["around"]) || any(words, &["opposite"]))
        && !phrase(words, "around a|the|his|her|their|its")
    {
        return Some(Extent::Degrees(180));
    }
    if name == "turn" && phrase(words, "opposite|other direction|way") {
        return Some(Extent::Degrees(180));
    }
    for (i, word) in words.iter().enumerate() {
        let extent = match *word {
            "slightly" | "partially" | "barely" => return Some(Extent::Small),
            "deeply" | "widely" | "far" if words.get(i + 1) != Some(&"apart") => {
                return Some(Extent::Large);
            }
            "bit" => return Some(Extent::Small),
            "little" if matches!(words.get(i.wrapping_sub(1)), Some(&"a")) => Extent::Small,
            "small" | "short" | "tiny" | "slight" | "little" | "smaller" | "shallow" | "tight"
            | "half" => Extent::Small,
            "big" | "large" | "wide" | "huge" | "giant" | "long" | "larger" | "deep" | "great"
            | "greater" | "bigger" => Extent::Large,
            _ => continue,
        };
        let of_motion = words[i + 1..].iter().take(3).any(|w| {
            is_counted(w)
                || matches!(
                    *w,
                    "stride"
                        | "strides"
                        | "distance"
                        | "motion"
                        | "motions"
                        | "arc"
                        | "movement"
                        | "movements"
                        | "bend"
                        | "semicircle"
                        | "curve"
                        | "circular"
                )
        });
        if of_motion && !phrase(&words[i..], "long|short time") {
            return Some(extent);
        }
        if extent == Extent::Small && phrase(words, "a little") && i + 1 == words.len() {
            return Some(extent);
        }
    }
    None
}

fn path(name: &str, words: &[&str]) -> Option<Path> {
    let moves = is_locomotion(name);
    for (i, word) in words.iter().enumerate() {
        let before = i.checked_sub(1).map_or("", |k| words[k]);
        let path = match *word {
            "zigzag" | "zig" => Path::Zigzag,
            w if w.starts_with("diagonal") => Path::Diagonal,
            w if moves
                && (w.starts_with("curv")
                    || w.starts_with("arc")
                    || w.starts_with("weav")
                    || w == "winding"
                    || w == "wavy"
                    || w.starts_with("serpent")) =>
            {
                Path::Curve
            }
            "shape" | "shaped" if moves && matches!(before, "s" | "u" | "c") => Path::Curve,
            "non" if words.get(i + 1) == Some(&"straight") => Path::Curve,
            "circle" | "circles" | "circular"
                if moves
                    && !matches!(name, "circle" | "dance")
                    && !matches!(before, "half" | "quarter") =>
            {
                Path::Circle
            }
            "straight" if moves && words.get(i + 1) != Some(&"up") => Path::Straight,
            "back" | "to" if phrase(&words[i..], "back|to and forth|forward|forwards|fro") => {
                Path::BackAndForth
            }
            "side" if phrase(&words[i..], "side to side") => Path::BackAndForth,
            "up" if phrase(&words[i..], "up and down") => Path::BackAndForth,
            _ => continue,
        };
        let of_arms = is_of_arms(name)
            || matches!(
                name,
                "look"
                    | "sway"
                    | "move_hips"
                    | "rub"
                    | "wipe"
                    | "shake"
                    | "jump"
                    | "run"
                    | "walk"
                    | "hop"
                    | "side_step"
                    | "dance"
                    | "swing_leg"
                    | "kick"
                    | "turn"
                    | "twist"
                    | "crawl"
                    | "march"
                    | "throw"
            );
        if path == Path::BackAndForth && (name == "pace" || !of_arms) {
            continue;
        }
        return Some(path);
    }
    None
}

fn manner(words: &[&str]) -> Option<Manner> {
    words.iter().find_map(|word| {
        Some(match *word {
            "carefully" | "careful" | "cautiously" | "caution" | "cautious" | "gingerly"
            | "suspiciously" | "sneaks" | "sneaking" | "sneakily" | "stealthily" | "tiptoes"
            | "tiptoe" | "tiptoeing" | "creeps" | "creeping" | "hesitantly" | "warily" => {
                Manner::Careful
            }
            "casually" | "casual" | "leisurely" | "relaxed" | "calmly" | "calm" | "lazily"
            | "loosely" | "nonchalantly" | "strolls" | "strolling" | "saunters" | "sauntering" => {
                Manner::Casual
            }
            "drunk" | "drunkenly" | "drunken" | "unsteadily" | "unsteady" | "unbalanced"
            | "dizzy" | "wobbly" | "unstable" | "off-balance" | "dizzily" => Manner::Unsteady,
            "forcefully" | "aggressively" | "vigorously" | "energetically" | "powerfully"
            | "hard" | "angrily" | "angry" | "aggressive" | "force" | "energetic" | "strongly"
            | "violently" | "vigorous" => Manner::Forceful,
            "lightly" | "gently" | "softly" | "gentle" | "smoothly" | "gracefully" => {
                Manner::Gentle
            }
            "stiffly" | "stiff" | "robot" | "robotic" | "robotically" | "rigidly" | "zombie"
            | "mechanically" => Manner::Stiff,
            "confidently" | "proudly" | "struts" | "strutting" | "confident" | "confidence"
            | "sexy" | "catwalk" | "swagger" | "purposefully" | "purposeful" | "swaggers" => {
                Manner::Proud
            }
            "suddenly" | "abruptly" | "sudden" | "sharply" | "abrupt" | "immediately" => {
                Manner::Sudden
            }
            "happily" | "happy" | "joyfully" | "playfully" | "cheerfully" | "excitedly" => {
                Manner::Happy
            }
            "tired" | "tiredly" | "sad" | "sadly" | "exhausted" | "sluggishly" | "wearily" => {
                Manner::Tired
            }
            "awkwardly" | "awkward" | "clumsily" | "clumsy" | "sloppily" | "oddly" | "weirdly" => {
                Manner::Awkward
            }
            _ => return None,
        })
    })
}

fn duration(words: &[&str]) -> Option<Duration> {
    for (i, word) in words.iter().enumerate() {
        let next = words.get(i + 1).copied().unwrap_or_default();
        let before = i.checked_sub(1).map_or("", |k| words[k]);
        match *word {
            "briefly" | "momentarily" => return Some(Duration::Short),
            "moment" | "moments" => return Some(Duration::Short),
            "few" | "couple" | "several" if matches!(next, "seconds" | "second" | "moments") => {
                return Some(Duration::Short);
            }
            "couple" if phrase(&words[i..], "couple of seconds") => return Some(Duration::Short),
            "second" if before == "a" && phrase(words, "for a second") => {
                return Some(Duration::Short);
            }
            "while" if before == "a" => return Some(Duration::Long),
            "time" if matches!(before, "long" | "some") => return Some(Duration::Long),
            _ => {}
        }
        if let Some(n) = number(word)
            && matches!(next, "seconds" | "second" | "secs")
        {
            return Some(Duration::Seconds(n));
        }
    }
    None
}
