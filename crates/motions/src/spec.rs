//! Table of the built-in motions: names, keys, ranges and defaults.

use crate::values::Values;

/// Keys that apply to the whole request instead of one part.
pub const GLOBAL_KEYS: &[KeySpec] = &[
    KeySpec {
        name: "height_m",
        kind: KeyKind::Number {
            min: 1.0,
            max: 2.0,
            default: 1.72,
        },
    },
    KeySpec {
        name: "build",
        kind: KeyKind::Word {
            allowed: &["slim", "average", "heavy"],
            default: "average",
        },
    },
    KeySpec {
        name: "heading_deg",
        kind: KeyKind::Number {
            min: -360.0,
            max: 360.0,
            default: 0.0,
        },
    },
    // Amplitude of the pelvis' sway: people who exercise do not keep it still.
    KeySpec {
        name: "sway_m",
        kind: KeyKind::Number {
            min: 0.0,
            max: 0.15,
            default: 0.0,
        },
    },
    // Pauses in the first and in the last pose.
    KeySpec {
        name: "before_s",
        kind: KeyKind::Number {
            min: 0.0,
            max: 10.0,
            default: 0.0,
        },
    },
    KeySpec {
        name: "after_s",
        kind: KeyKind::Number {
            min: 0.0,
            max: 10.0,
            default: 0.0,
        },
    },
    // How far the whole body wanders in small steps: people who box or dance do not stay on the spot.
    KeySpec {
        name: "wander_m",
        kind: KeyKind::Number {
            min: 0.0,
            max: 0.6,
            default: 0.0,
        },
    },
];

/// Specification of a motion that [`crate::parse`] accepts.
#[derive(Debug)]
pub struct MotionSpec {
    /// Snake-case name.
    pub name: &'static str,
    /// One-line description for `motion list`.
    pub about: &'static str,
    /// Keys in addition to [`GLOBAL_KEYS`].
    pub keys: &'static [KeySpec],
    /// Initial posture.
    pub starts: Posture,
    /// Whether the motion is allowed before `+while+`.
    pub carries: bool,
    /// Whether the motion is allowed after `+while+`.
    pub overlays: bool,
}

/// A key of a motion.
#[derive(Debug, PartialEq)]
pub struct KeySpec {
    /// Name as written in a request.
    pub name: &'static str,
    /// Values that the key accepts.
    pub kind: KeyKind,
}

/// Type and range of the values of a key.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum KeyKind {
    /// One of these words.
    Word {
        /// Accepted words.
        allowed: &'static [&'static str],
        /// Used when the key is not given.
        default: &'static str,
    },
    /// A finite number in `min..=max`.
    Number {
        /// Minimum value.
        min: f32,
        /// Maximum value.
        max: f32,
        /// Used when the key is not given.
        default: f32,
    },
    /// A finite number in `min..=max`. If it is not given, the motion determines a natural value.
    Optional {
        /// Minimum value.
        min: f32,
        /// Maximum value.
        max: f32,
    },
    /// A whole number in `1..=max`.
    Count {
        /// Maximum value.
        max: u32,
        /// Used when the key is not given.
        default: u32,
    },
    /// A multiplier in 0.4..=2, or the words slow (0.7), normal (1) and fast (1.45).
    Speed,
}

/// Posture at the seam between two motions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Posture {
    /// Standing on both feet.
    Standing,
    /// Seated on a chair.
    Seated,
    /// Lying on the back.
    Lying,
    /// On the floor in any other posture; no motion can follow.
    Fallen,
    /// Initial posture of `stand_up`: seated or lying, as given by its key `from`.
    SeatedOrLying,
}

impl MotionSpec {
    /// Returns the key with the given name.
    pub fn key(&self, name: &str) -> Option<&'static KeySpec> {
        self.keys.iter().find(|k| k.name == name)
    }

    /// Final posture, which may depend on the values.
    pub fn ends(&self, values: &Values) -> Posture {
        match self.name {
            "sit_down" | "sit_still" => Posture::Seated,
            "lie_down" => Posture::Lying,
            "fall" if values.word("direction") == "backward" => Posture::Lying,
            "fall" => Posture::Fallen,
            _ => Posture::Standing,
        }
    }
}

impl KeyKind {
    /// Description of the accepted values, for messages and `motion list`.
    pub fn describe(&self) -> String {
        match self {
            KeyKind::Word { allowed, default } => {
                format!("{} (default {default})", allowed.join("|"))
            }
            KeyKind::Number { min, max, default } => format!("{min}..{max} (default {default})"),
            KeyKind::Optional { min, max } => format!("{min}..{max} (default: natural)"),
            KeyKind::Count { max, default } => format!("1..{max} (default {default})"),
            KeyKind::Speed => "0.4..2 or slow|normal|fast (default 1)".to_owned(),
        }
    }
}

/// All motions, in the order of `motion list`.
pub fn specs() -> &'static [MotionSpec] {
    SPECS
}

/// Returns the motion with the given name.
pub fn spec(name: &str) -> Option<&'static MotionSpec> {
    SPECS.iter().find(|s| s.name == name)
}

const fn word(name: &'static str, allowed: &'static [&'static str]) -> KeySpec {
    KeySpec {
        name,
        kind: KeyKind::Word {
            allowed,
            default: allowed[0],
        },
    }
}
const fn number(name: &'static str, min: f32, max: f32, default: f32) -> KeySpec {
    KeySpec {
        name,
        kind: KeyKind::Number { min, max, default },
    }
}
const fn times(default: u32) -> KeySpec {
    KeySpec {
        name: "repetitions",
        kind: KeyKind::Count { max: 50, default },
    }
}
const fn optional(name: &'static str, min: f32, max: f32) -> KeySpec {
    KeySpec {
        name,
        kind: KeyKind::Optional { min, max },
    }
}

const SPEED: KeySpec = KeySpec {
    name: "speed",
    kind: KeyKind::Speed,
};
const AMPLITUDE: KeySpec = number("amplitude", 0.5, 1.4, 1.0);
const DURATION: KeySpec = optional("duration_s", 0.5, 60.0);
// How far the trunk leans forward: people differ much more in it than in anything else they repeat.
const LEAN: KeySpec = optional("lean_deg", 0.0, 45.0);
// Elevation of the arm at the end of a punch.
const AIM: KeySpec = optional("aim_deg", -40.0, 30.0);
const ONE_SIDE: KeySpec = word("side", &["right", "left"]);
const ANY_SIDE: KeySpec = word("side", &["right", "left", "both"]);
const BOTH_FIRST: KeySpec = word("side", &["both", "left", "right"]);
const LEFT_RIGHT: KeySpec = word("direction", &["left", "right"]);
const FORE_AFT: KeySpec = word("direction", &["forward", "backward"]);
const FOUR_WAYS: KeySpec = word("direction", &["forward", "backward", "left", "right"]);
const FIVE_WAYS: KeySpec = word("direction", &["up", "forward", "backward", "left", "right"]);
const POSTURE: KeySpec = word("posture", &["upright", "stooped"]);

const fn motion(name: &'static str, about: &'static str, keys: &'static [KeySpec]) -> MotionSpec {
    MotionSpec {
        name,
        about,
        keys,
        starts: Posture::Standing,
        carries: false,
        overlays: false,
    }
}
const fn carrier(name: &'static str, about: &'static str, keys: &'static [KeySpec]) -> MotionSpec {
    MotionSpec {
        carries: true,
        ..motion(name, about, keys)
    }
}
const fn gesture(name: &'static str, about: &'static str, keys: &'static [KeySpec]) -> MotionSpec {
    MotionSpec {
        overlays: true,
        ..motion(name, about, keys)
    }
}
const fn from(starts: Posture, spec: MotionSpec) -> MotionSpec {
    MotionSpec { starts, ..spec }
}

static SPECS: &[MotionSpec] = &[
    carrier(
        "walk",
        "walks in a straight line",
        &[
            FORE_AFT,
            SPEED,
            optional("distance_m", 0.5, 20.0),
            AMPLITUDE,
            POSTURE,
            DURATION,
        ],
    ),
    motion(
        "run",
        "runs or jogs in a straight line",
        &[
            SPEED,
            optional("distance_m", 1.0, 20.0),
            AMPLITUDE,
            DURATION,
        ],
    ),
    carrier(
        "turn",
        "turns on the spot with small steps",
        &[
            LEFT_RIGHT,
            number("angle_deg", 45.0, 720.0, 180.0),
            SPEED,
            POSTURE,
            DURATION,
        ],
    ),
    carrier(
        "circle",
        "walks in a circle",
        &[
            LEFT_RIGHT,
            number("radius_m", 0.4, 2.0, 0.7),
            SPEED,
            times(1),
            POSTURE,
            DURATION,
        ],
    ),
    carrier(
        "pace",
        "walks back and forth",
        &[
            SPEED,
            number("distance_m", 0.5, 10.0, 1.6),
            times(2),
            AMPLITUDE,
            POSTURE,
            DURATION,
        ],
    ),
    motion(
        "walk_turn",
        "walks, turns while walking and walks on",
        &[
            LEFT_RIGHT,
            number("angle_deg", 45.0, 180.0, 90.0),
            SPEED,
            number("distance_m", 1.0, 20.0, 4.0),
            AMPLITUDE,
            POSTURE,
            DURATION,
        ],
    ),
    carrier(
        "side_step",
        "steps sideways without turning",
        &[
            LEFT_RIGHT,
            SPEED,
            number("distance_m", 0.3, 20.0, 1.2),
            POSTURE,
            DURATION,
        ],
    ),
    carrier(
        "march",
        "marches with high knees, in place or forward",
        &[
            SPEED,
            number("distance_m", 0.0, 20.0, 0.0),
            times(8),
            AMPLITUDE,
            DURATION,
        ],
    ),
    motion(
        "jog_in_place",
        "runs on the spot",
        &[SPEED, times(10), AMPLITUDE, DURATION],
    ),
    motion(
        "limp",
        "walks forward sparing one leg",
        &[
            ONE_SIDE,
            SPEED,
            number("distance_m", 0.8, 20.0, 2.0),
            POSTURE,
            DURATION,
        ],
    ),
    motion(
        "step_over",
        "steps over an obstacle, one leg leading",
        &[ONE_SIDE, SPEED, AMPLITUDE, DURATION],
    ),
    motion(
        "hop",
        "hops on one leg",
        &[ONE_SIDE, FIVE_WAYS, times(3), AMPLITUDE, DURATION],
    ),
    motion(
        "jump",
        "jumps with both feet; with still arms again and again, and lower",
        &[
            FIVE_WAYS,
            word("arms", &["swinging", "still"]),
            SPEED,
            times(1),
            AMPLITUDE,
            LEAN,
            DURATION,
        ],
    ),
    motion(
        "jumping_jack",
        "jumping jacks",
        &[SPEED, times(4), AMPLITUDE, DURATION],
    ),
    carrier(
        "stand_still",
        "stands quietly",
        &[POSTURE, number("duration_s", 0.5, 60.0, 3.0)],
    ),
    from(
        Posture::Seated,
        carrier(
            "sit_still",
            "sits quietly on a chair",
            &[number("duration_s", 0.5, 60.0, 3.0)],
        ),
    ),
    motion("sit_down", "sits down on a chair", &[SPEED, DURATION]),
    from(
        Posture::SeatedOrLying,
        motion(
            "stand_up",
            "stands up from a chair or from the floor",
            &[word("from", &["chair", "floor"]), SPEED, DURATION],
        ),
    ),
    motion("lie_down", "lies down on the back", &[SPEED, DURATION]),
    motion("fall", "falls to the floor", &[FOUR_WAYS, SPEED, DURATION]),
    motion(
        "crouch",
        "crouches down, stays a moment and gets back up",
        &[SPEED, AMPLITUDE, DURATION],
    ),
    motion(
        "squat",
        "squats with the arms in front, or hanging still",
        &[
            word("arms", &["front", "still"]),
            SPEED,
            times(3),
            AMPLITUDE,
            LEAN,
            DURATION,
        ],
    ),
    motion(
        "kneel",
        "kneels down on one knee and gets back up",
        &[ONE_SIDE, SPEED, DURATION],
    ),
    motion(
        "lunge",
        "steps into a lunge and back, or lowers and raises the body with the feet in place",
        &[
            ONE_SIDE,
            FOUR_WAYS,
            word("feet", &["stepping", "in_place"]),
            SPEED,
            times(1),
            AMPLITUDE,
            DURATION,
        ],
    ),
    motion(
        "leg_raise",
        "raises one straight leg and lowers it, alone or with the arm of that side",
        &[
            ONE_SIDE,
            word("direction", &["sideways", "forward", "backward"]),
            word("arm", &["still", "raised"]),
            SPEED,
            times(1),
            AMPLITUDE,
            DURATION,
        ],
    ),
    motion(
        "kick",
        "kicks with one leg",
        &[ONE_SIDE, FOUR_WAYS, SPEED, times(1), AMPLITUDE, DURATION],
    ),
    motion("balance", "stands on one leg", &[ONE_SIDE, DURATION]),
    gesture(
        "wave",
        "waves with raised hand",
        &[ANY_SIDE, SPEED, times(4), AMPLITUDE, DURATION],
    ),
    gesture(
        "raise_arms",
        "raises one arm or both and lowers again",
        &[
            BOTH_FIRST,
            word("style", &["overhead", "forward", "sideways", "hand"]),
            SPEED,
            times(1),
            optional("hold_s", 0.0, 3.0),
            DURATION,
        ],
    ),
    gesture(
        "clap",
        "claps the hands",
        &[SPEED, times(5), AMPLITUDE, DURATION],
    ),
    gesture(
        "punch",
        "punches forward",
        &[
            ANY_SIDE,
            word("style", &["straight", "hook", "uppercut"]),
            SPEED,
            times(2),
            LEAN,
            AIM,
            optional("stance_m", 0.0, 0.7),
            optional("pause_s", 0.0, 3.0),
            DURATION,
        ],
    ),
    gesture(
        "push",
        "pushes forward with both hands",
        &[SPEED, times(1), AMPLITUDE, DURATION],
    ),
    gesture(
        "pull",
        "pulls something towards the body",
        &[BOTH_FIRST, SPEED, times(1), DURATION],
    ),
    gesture(
        "knock",
        "knocks on a door",
        &[ONE_SIDE, SPEED, times(3), DURATION],
    ),
    gesture(
        "point",
        "points with an outstretched arm",
        &[
            ONE_SIDE,
            word("direction", &["forward", "left", "right", "up"]),
            SPEED,
            DURATION,
        ],
    ),
    gesture(
        "drink",
        "brings a cup to the mouth and drinks",
        &[ONE_SIDE, SPEED, DURATION],
    ),
    gesture(
        "answer_phone",
        "holds a phone to the ear",
        &[ONE_SIDE, SPEED, DURATION],
    ),
    gesture("salute", "salutes", &[ONE_SIDE, SPEED, DURATION]),
    gesture(
        "cross_arms",
        "crosses the arms in front of the chest",
        &[SPEED, DURATION],
    ),
    gesture(
        "hands_on_hips",
        "puts the hands on the hips",
        &[SPEED, DURATION],
    ),
    gesture(
        "arm_circles",
        "circles the straight arms",
        &[BOTH_FIRST, FORE_AFT, SPEED, times(3), DURATION],
    ),
    motion(
        "throw",
        "throws something forward",
        &[
            ANY_SIDE,
            word("style", &["overhand", "underhand"]),
            SPEED,
            times(1),
            DURATION,
        ],
    ),
    motion(
        "pick_up",
        "bends down and picks something up",
        &[ANY_SIDE, SPEED, DURATION],
    ),
    motion(
        "toe_touch",
        "bends over and touches the toes",
        &[SPEED, times(2), DURATION],
    ),
    motion("bow", "bows", &[SPEED, times(1), AMPLITUDE, DURATION]),
    motion(
        "stretch",
        "stretches both arms up",
        &[SPEED, times(1), AMPLITUDE, DURATION],
    ),
    motion(
        "side_bend",
        "bends sideways with one arm overhead",
        &[LEFT_RIGHT, SPEED, times(2), AMPLITUDE, DURATION],
    ),
    motion(
        "twist",
        "twists the upper body to both sides",
        &[LEFT_RIGHT, SPEED, times(2), AMPLITUDE, DURATION],
    ),
];
