//! Clause templates that describe each motion with every applicable attribute.
//!
//! `[verb]` is inflected later. `{side}` and `{way}` are filled from the values, `{the}` is "the"
//! or "their".

use crate::values::Values;

/// How a caption expresses the number of repetitions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Counting {
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
pub fn counting(name: &str, v: &Values) -> Counting {
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

/// Templates that describe an unusual amplitude; empty if the amplitude is ordinary or has no
/// suitable word.
fn with_extent(name: &str, v: &Values) -> Vec<&'static str> {
    let size = v.amplitude();
    let (large, small) = (size >= 1.2, size <= 0.8);
    match (name, v.word("direction")) {
        ("squat", _) if large => vec!["[squat] deeply", "[squat] down deep", "[do] a deep squat"],
        ("squat", _) if small => vec!["[squat] slightly", "[do] a shallow squat"],
        ("bow", _) if large => vec!["[bow] deeply", "[take] a deep bow"],
        ("bow", _) if small => vec!["[bow] slightly", "[make] a small bow"],
        ("crouch", _) if large => vec!["[crouch] down deeply and [get] back up"],
        ("lunge", _) if large => vec![
            "[lunge] deeply {way} with the {side} leg",
            "[do] a deep lunge {way} with the {side} leg",
        ],
        ("jump", "up") if large => vec![
            "[jump] up high",
            "[jump] high into the air",
            "[leap] up high",
        ],
        ("jump", "up") if small => vec!["[jump] up a little", "[make] a small jump up"],
        ("jump", _) if large => vec!["[jump] far {way}", "[make] a big jump {way}"],
        ("jump", _) if small => vec!["[make] a small jump {way}", "[jump] a little {way}"],
        ("kick", "forward" | "backward") if large => vec![
            "[kick] high {way} with the {side} leg",
            "[kick] high {way} with the {side} foot",
        ],
        ("kick", "forward" | "backward") if small => vec![
            "[kick] low {way} with the {side} leg",
            "[kick] low {way} with the {side} foot",
        ],
        ("side_bend", _) if large => vec!["[bend] far {way}", "[bend] sideways far {way}"],
        ("side_bend", _) if small => vec!["[bend] slightly {way}", "[lean] slightly {way}"],
        _ => vec![],
    }
}

/// Returns true if "at a slow pace" is idiomatic for this motion.
pub fn paces(name: &str) -> bool {
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

/// Clause templates of a motion; each states the side, direction and style where they apply.
pub fn clauses(name: &str, v: &Values) -> Vec<String> {
    let both = v.word("side") == "both";
    let side = v.word("side");
    let direction = v.word("direction");
    let way = match direction {
        "left" => "to the left",
        "right" => "to the right",
        other => other,
    };
    let plain: Vec<&str> = match (name, direction) {
        ("walk", "backward") => vec![
            "[walk] backward",
            "[walk] backwards",
            "[take] steps backward",
            "[walk] in reverse",
        ],
        ("walk", _) => vec![
            "[walk] forward",
            "[walk] straight ahead",
            "[walk] ahead",
            "[walk] forward in a straight line",
            "[walk]",
        ],
        ("run", _) => vec![
            "[run] forward",
            "[run] straight ahead",
            "[jog] forward",
            "[run] ahead",
        ],
        ("turn", _) => match v.number("angle_deg") {
            a if (80.0..=100.0).contains(&a) => vec![
                "[turn] {way}",
                "[make] a quarter turn {way}",
                "[turn] ninety degrees {way}",
                "[face] {way} after a quarter turn",
            ],
            a if (165.0..=195.0).contains(&a) => vec![
                "[turn] around {way}",
                "[make] a half turn {way}",
                "[turn] around over the {dir} shoulder",
            ],
            a if (340.0..=380.0).contains(&a) => vec![
                "[make] a full turn {way}",
                "[spin] around {way} in a full circle",
                "[turn] all the way around {way}",
            ],
            _ => vec![
                "[turn] on the spot {way}",
                "[turn] {way} on the spot",
                "[rotate] {way} on the spot",
            ],
        },
        ("circle", "left") => match v.number("radius_m") {
            r if r <= 0.55 => vec![
                "[walk] in a small counterclockwise circle",
                "[walk] in a tight circle to the left",
                "[walk] around in a small circle to the left",
            ],
            r if r >= 1.1 => vec![
                "[walk] in a large counterclockwise circle",
                "[walk] in a wide circle to the left",
                "[walk] around in a big circle to the left",
            ],
            _ => vec![
                "[walk] in a counterclockwise circle",
                "[walk] in a circle to the left",
                "[walk] counterclockwise in a circle",
                "[walk] around in a circle to the left",
            ],
        },
        ("circle", _) => match v.number("radius_m") {
            r if r <= 0.55 => vec![
                "[walk] in a small clockwise circle",
                "[walk] in a tight circle to the right",
                "[walk] around in a small circle to the right",
            ],
            r if r >= 1.1 => vec![
                "[walk] in a large clockwise circle",
                "[walk] in a wide circle to the right",
                "[walk] around in a big circle to the right",
            ],
            _ => vec![
                "[walk] in a clockwise circle",
                "[walk] in a circle to the right",
                "[walk] clockwise in a circle",
                "[walk] around in a circle to the right",
            ],
        },
        ("side_step", _) => vec![
            "[step] sideways {way}",
            "[side-step] {way}",
            "[move] sideways {way}",
            "[shuffle] {way}",
            "[take] side steps {way}",
        ],
        ("march", _) if v.number("distance_m") >= 0.3 => vec![
            "[march] forward",
            "[march] forward with high knees",
            "[march] ahead like a soldier",
        ],
        ("march", _) => vec![
            "[march] in place",
            "[march] on the spot",
            "[march] in place with high knees",
            "[lift] {the} knees high while marching in place",
        ],
        ("jog_in_place", _) => vec![
            "[jog] in place",
            "[run] in place",
            "[run] on the spot",
            "[jog] on the spot",
        ],
        ("pace", _) => vec![
            "[walk] back and forth",
            "[walk] up and down",
            "[walk] to and fro",
        ],
        ("walk_turn", _) => match v.number("angle_deg") {
            a if a >= 150.0 => vec![
                "[walk] forward, then [turn] around {way}",
                "[walk] ahead and then [turn] around {way}",
                "[walk] and then [turn] back {way}",
            ],
            _ => vec![
                "[walk] forward, then [turn] {way}",
                "[walk] ahead and then [turn] {way}",
                "[walk] and then [turn] {way}",
            ],
        },
        ("limp", _) => vec![
            "[limp] forward with a hurt {side} leg",
            "[limp] forward, sparing the {side} leg",
            "[walk] forward with a limp in the {side} leg",
            "[hobble] forward on a bad {side} leg",
        ],
        ("step_over", _) => vec![
            "[step] over something with the {side} leg first",
            "[step] over an obstacle, {side} foot first",
            "[lift] {the} {side} leg and [step] over an obstacle",
            "[climb] over a low obstacle, leading with the {side} leg",
        ],
        ("hop", "up") => vec![
            "[hop] on the {side} leg",
            "[hop] on the {side} foot",
            "[hop] in place on the {side} leg",
            "[bounce] in place on the {side} foot",
        ],
        ("hop", _) => vec![
            "[hop] {way} on the {side} leg",
            "[hop] {way} on the {side} foot",
            "[hop] on the {side} leg {way}",
        ],
        ("jump", "up") if v.word("arms") == "still" => vec![
            "[jump] up",
            "[jump] up with still arms",
            "[jump] up and down in place",
            "[jump] up on the spot",
        ],
        ("jump", _) if v.word("arms") == "still" => vec![
            "[jump] {way}",
            "[jump] {way} with still arms",
            "[jump] {way} with both feet",
        ],
        ("jump", "up") => vec![
            "[jump] up",
            "[jump] up in place",
            "[jump] straight up",
            "[jump] into the air",
            "[leap] up",
        ],
        ("jump", _) => vec![
            "[jump] {way}",
            "[jump] {way} with both feet",
            "[leap] {way}",
            "[jump] {way} from both feet",
        ],
        ("jumping_jack", _) => {
            if v.count("repetitions") == 1 {
                vec![
                    "[do] a jumping jack",
                    "[perform] a jumping jack",
                    "[make] a jumping jack",
                ]
            } else {
                vec![
                    "[do] jumping jacks",
                    "[perform] jumping jacks",
                    "[do] star jumps",
                    "[exercise] with jumping jacks",
                ]
            }
        }
        ("stand_still", _) => vec![
            "[stand] still",
            "[stand] in place",
            "[stand] quietly",
            "[remain] standing",
            "[stand] without moving",
        ],
        ("sit_still", _) => vec![
            "[sit] still",
            "[sit] on a chair",
            "[sit] quietly on a chair",
            "[remain] seated",
        ],
        ("sit_down", _) => vec![
            "[sit] down",
            "[sit] down on a chair",
            "[take] a seat",
            "[sit] down on a seat behind",
        ],
        ("stand_up", _) if v.word("from") == "floor" => vec![
            "[get] up from the floor",
            "[stand] up from lying on the floor",
            "[rise] from the floor",
            "[get] up off the ground",
        ],
        ("stand_up", _) => vec![
            "[stand] up from a chair",
            "[get] up from a chair",
            "[stand] up from a seat",
            "[rise] from a chair",
        ],
        ("lie_down", _) => vec![
            "[lie] down on the floor",
            "[lie] down on the back",
            "[lie] down on the ground",
            "[lie] back on the floor",
        ],
        ("fall", _) => vec![
            "[fall] {way}",
            "[fall] {way} to the floor",
            "[fall] down {way}",
            "[tumble] {way} onto the floor",
            "[collapse] {way} onto the ground",
        ],
        ("crouch", _) => vec![
            "[crouch] down and [get] back up",
            "[crouch] and [rise] again",
            "[crouch] low and [stand] up again",
            "[squat] down low, [pause] and [rise]",
        ],
        ("squat", _) if v.word("arms") == "still" => vec![
            "[squat]",
            "[squat] down and up",
            "[squat] with still arms",
            "[bend] {the} knees into a squat and [rise]",
        ],
        ("squat", _) => vec![
            "[squat]",
            "[squat] down and up",
            "[squat] with the arms in front",
            "[bend] {the} knees into a squat and [rise]",
        ],
        ("kneel", _) => vec![
            "[kneel] down on the {side} knee and [get] back up",
            "[go] down on the {side} knee and [stand] up again",
            "[kneel] on the {side} knee and [rise] again",
        ],
        ("lunge", _) => vec![
            "[lunge] {way} with the {side} leg",
            "[step] {way} into a lunge with the {side} leg",
            "[do] a lunge {way} with the {side} leg",
            "[lunge] {way} on the {side} leg",
        ],
        ("kick", "left" | "right") => vec![
            "[kick] sideways {way} with the {side} leg",
            "[kick] out {way} with the {side} foot",
            "[do] a side kick {way} with the {side} leg",
            "[kick] {the} {side} leg out {way}",
        ],
        ("kick", _) => vec![
            "[kick] {way} with the {side} leg",
            "[kick] {way} with the {side} foot",
            "[kick] {the} {side} leg {way}",
            "[swing] {the} {side} leg {way} in a kick",
        ],
        ("leg_raise", _) if v.word("arm") == "raised" => vec![
            "[raise] {the} {side} arm and leg {way}",
            "[lift] {the} {side} arm and leg {way}",
            "[raise] {the} {side} leg {way} together with {the} {side} arm",
        ],
        ("leg_raise", _) => vec![
            "[raise] {the} {side} leg {way}",
            "[lift] {the} {side} leg {way}",
            "[lift] {the} straight {side} leg {way} and [lower] it",
        ],
        ("balance", _) => vec![
            "[balance] on the {side} leg",
            "[stand] on the {side} leg",
            "[stand] on one leg, the {side} one",
            "[balance] on the {side} foot with {the} arms out",
        ],
        ("wave", _) if both => vec![
            "[wave] with both hands",
            "[wave] both hands",
            "[wave] both arms in the air",
            "[raise] both hands and [wave]",
        ],
        ("wave", _) => vec![
            "[wave] with the {side} hand",
            "[wave] {the} {side} hand",
            "[raise] {the} {side} hand and [wave]",
            "[greet] with a wave of the {side} hand",
        ],
        ("raise_arms", _) => match (v.word("style"), both) {
            ("hand", true) => vec![
                "[raise] both hands",
                "[raise] both hands and [lower] them",
                "[lift] both hands",
                "[put] both hands up",
            ],
            ("hand", false) => vec![
                "[raise] {the} {side} hand",
                "[raise] {the} {side} hand and [lower] it",
                "[lift] {the} {side} hand",
                "[put] {the} {side} hand up",
            ],
            ("forward", true) => vec![
                "[raise] both arms forward",
                "[lift] both arms in front",
                "[lift] both arms out in front and [lower] them",
            ],
            ("forward", false) => vec![
                "[raise] {the} {side} arm forward",
                "[lift] {the} {side} arm in front",
                "[lift] {the} {side} arm out in front and [lower] it",
            ],
            ("sideways", true) => vec![
                "[raise] both arms to the sides",
                "[lift] both arms sideways",
                "[spread] both arms out to the sides and [lower] them",
            ],
            ("sideways", false) => vec![
                "[raise] {the} {side} arm to the side",
                "[lift] {the} {side} arm sideways",
                "[lift] {the} {side} arm out to the side and [lower] it",
            ],
            (_, true) => vec![
                "[raise] both arms",
                "[raise] both arms overhead",
                "[lift] both arms above the head",
                "[put] both hands up in the air",
            ],
            (_, false) => vec![
                "[raise] {the} {side} arm",
                "[raise] {the} {side} arm overhead",
                "[lift] {the} {side} arm above the head",
                "[put] {the} {side} hand up in the air",
            ],
        },
        ("clap", _) => vec![
            "[clap]",
            "[clap] {the} hands",
            "[clap] both hands together",
            "[clap] {the} hands in front of the chest",
        ],
        ("punch", _) => {
            let alternating = both && v.count("repetitions") > 1;
            match (v.word("style"), alternating) {
                ("hook", true) => vec![
                    "[throw] hooks with alternating hands",
                    "[throw] hook punches with both hands",
                ],
                ("hook", false) => vec![
                    "[throw] a hook with the {side} hand",
                    "[swing] a hook punch with the {side} fist",
                ],
                ("uppercut", true) => vec![
                    "[throw] uppercuts with alternating hands",
                    "[throw] uppercuts with both hands",
                ],
                ("uppercut", false) => vec![
                    "[throw] an uppercut with the {side} hand",
                    "[punch] upward with the {side} fist",
                ],
                (_, true) => vec![
                    "[punch] forward with alternating hands",
                    "[punch] forward with both fists in turn",
                    "[throw] punches with the left and right hand",
                ],
                (_, false) => vec![
                    "[punch] forward with the {side} hand",
                    "[punch] with the {side} fist",
                    "[throw] a straight punch with the {side} hand",
                    "[punch] straight ahead with the {side} hand",
                ],
            }
        }
        ("push", _) => vec![
            "[push] forward with both hands",
            "[push] something away with both hands",
            "[push] something forward with both arms",
        ],
        ("pull", _) if both => vec![
            "[pull] something with both hands",
            "[pull] something back with both arms",
            "[reach] out and [pull] with both hands",
        ],
        ("pull", _) => vec![
            "[pull] something with the {side} hand",
            "[pull] something back with the {side} arm",
            "[reach] out and [pull] with the {side} hand",
        ],
        ("knock", _) => vec![
            "[knock] on a door with the {side} hand",
            "[knock] with the {side} hand",
            "[knock] at a door with the {side} fist",
        ],
        ("point", "left" | "right") => vec![
            "[point] {way} with the {side} hand",
            "[point] {the} {side} arm {way}",
            "[stretch] out {the} {side} arm and [point] {way}",
        ],
        ("point", "up") => vec![
            "[point] up with the {side} hand",
            "[point] upward with the {side} arm",
            "[raise] {the} {side} arm and [point] up",
        ],
        ("point", _) => vec![
            "[point] forward with the {side} hand",
            "[point] straight ahead with the {side} arm",
            "[stretch] out {the} {side} arm and [point] forward",
        ],
        ("drink", _) => vec![
            "[drink] from a cup with the {side} hand",
            "[take] a drink with the {side} hand",
            "[bring] a cup to the mouth with the {side} hand and [drink]",
            "[drink] something with the {side} hand",
        ],
        ("answer_phone", _) => vec![
            "[answer] the phone with the {side} hand",
            "[hold] a phone to the {side} ear",
            "[lift] a phone to the ear with the {side} hand",
            "[make] a phone call with the {side} hand",
        ],
        ("salute", _) => vec![
            "[salute] with the {side} hand",
            "[give] a salute with the {side} hand",
            "[raise] {the} {side} hand in a salute",
        ],
        ("cross_arms", _) => vec![
            "[cross] {the} arms",
            "[cross] {the} arms in front of the chest",
            "[fold] {the} arms over the chest",
        ],
        ("hands_on_hips", _) => vec![
            "[put] {the} hands on the hips",
            "[place] both hands on the hips",
            "[rest] {the} hands on the hips",
        ],
        ("arm_circles", _) if both => vec![
            "[circle] both arms {way}",
            "[swing] both arms in {way} circles",
            "[make] {way} circles with both arms",
        ],
        ("arm_circles", _) => vec![
            "[circle] {the} {side} arm {way}",
            "[swing] {the} {side} arm in {way} circles",
            "[make] {way} circles with the {side} arm",
        ],
        ("throw", _) => match (v.word("style"), both) {
            ("underhand", true) => vec![
                "[throw] something forward underhand with both hands",
                "[toss] something underhand with both hands",
            ],
            ("underhand", false) => vec![
                "[throw] something underhand with the {side} hand",
                "[toss] something forward underhand with the {side} hand",
                "[make] an underhand throw with the {side} arm",
            ],
            (_, true) => vec![
                "[throw] something forward with both hands from overhead",
                "[throw] a ball overhead with both hands",
            ],
            (_, false) => vec![
                "[throw] something with the {side} hand",
                "[throw] a ball forward with the {side} hand",
                "[make] an overhand throw with the {side} arm",
                "[throw] something forward with the {side} arm",
            ],
        },
        ("pick_up", _) if both => vec![
            "[bend] down and [pick] something up with both hands",
            "[pick] something up from the floor with both hands",
            "[lift] something off the ground with both hands",
            "[stoop] and [lift] something from the floor with both hands",
        ],
        ("pick_up", _) => vec![
            "[bend] down and [pick] something up with the {side} hand",
            "[pick] something up from the floor with the {side} hand",
            "[reach] down and [pick] up an object with the {side} hand",
            "[bend] over and [grab] something from the ground with the {side} hand",
        ],
        ("toe_touch", _) => vec![
            "[bend] down and [touch] {the} toes",
            "[bend] over to touch {the} toes",
            "[reach] down to the toes with both hands",
            "[touch] {the} toes",
        ],
        ("bow", _) => vec![
            "[bow]",
            "[bow] forward",
            "[take] a bow",
            "[bend] forward in a bow",
        ],
        ("stretch", _) => vec![
            "[stretch] both arms up",
            "[stretch] upward on tiptoe",
            "[stretch] {the} arms overhead",
            "[reach] up and [stretch] {the} whole body",
        ],
        ("side_bend", _) => vec![
            "[bend] sideways {way}",
            "[bend] {the} upper body {way}",
            "[lean] sideways {way} with the {other} arm overhead",
            "[do] a side bend {way}",
        ],
        ("twist", _) => vec![
            "[twist] {the} upper body to the {dir} and to the {other}",
            "[turn] {the} upper body to the {dir} and to the {other}",
            "[turn] {the} upper body from side to side, {dir} first",
            "[twist] at the waist from side to side, starting to the {dir}",
        ],
        _ => vec![],
    };
    let leg = if matches!(name, "kick" | "lunge") {
        ["left", "right"][crate::motions::acting_side(v)]
    } else {
        side
    };
    let other = if direction == "left" { "right" } else { "left" };
    let lone = if both { "right" } else { leg };
    with_extent(name, v)
        .iter()
        .chain(&plain)
        .map(|c| {
            let side = if name == "punch" && both {
                "left"
            } else {
                lone
            };
            c.replace("{side}", side)
                .replace("{way}", way)
                .replace("{dir}", direction)
                .replace("{other}", other)
        })
        .collect()
}
