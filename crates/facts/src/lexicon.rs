//! The words that state an action.

/// A pattern of words, and the action that it states.
///
/// A pattern is a sequence of words separated by spaces, each with alternatives separated by `|`. A word that ends with
/// `*` matches every word that begins like it. The words must occur in this order, with at most [`MAX_GAP`] other words
/// between two of them. `+` before a word allows no other word before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pattern {
    /// Name of the action.
    pub action: &'static str,
    /// The words.
    pub words: &'static str,
}

/// Words that may stand between two words of a pattern: "raises *the right* hand *and* waves".
pub const MAX_GAP: usize = 4;

const fn p(action: &'static str, words: &'static str) -> Pattern {
    Pattern { action, words }
}

/// All patterns in order of precedence. The words of a match are not matched again, so that a compound action
/// ("raises a hand and waves") stands before its parts ("raises a hand").
pub const PATTERNS: &[Pattern] = &[
    // "Punches with both fists in turn" does not turn.
    p("punch", "punch* in +turn"),
    // Actions of the whole body that contain others.
    p("jumping_jack", "jumping +jack*"),
    p("jumping_jack", "star +jump*"),
    p("crouch", "crouch* get|gets|getting up"),
    p("crouch", "crouch* stand|stands|standing up"),
    p("crouch", "crouch* rise|rises|rising"),
    p("crouch", "crouch*"),
    p("squat", "squat* paus* rise|rises|rising"),
    p("squat", "bend* knees squat* rise|rises|rising"),
    p("squat", "squat* stand|stands|standing up"),
    p("squat", "squat* rise|rises|rising"),
    p("squat", "squat*"),
    p("kneel", "kneel* get|gets|getting up"),
    p("kneel", "kneel* stand|stands|standing up"),
    p("kneel", "kneel* rise|rises|rising"),
    p("kneel", "kneel*"),
    p(
        "kneel",
        "go|goes|going +down knee* stand|stands|standing up",
    ),
    p("kneel", "go|goes|going +down knee*"),
    p("lunge", "step* into lunge*"),
    p("lunge", "lunge*|lunging"),
    p(
        "pick_up",
        "bend*|stoop*|reach* down|over|and pick*|grab*|lift* up|off|from",
    ),
    p("pick_up", "stoop* lift* from"),
    p("pick_up", "bend* pick*|grab*"),
    p("pick_up", "reach* pick*|grab*"),
    p("pick_up", "pick* up"),
    p("pick_up", "lift*|grab* off|from floor|ground"),
    p("toe_touch", "bend* touch* toes"),
    p("toe_touch", "reach* toes"),
    p("toe_touch", "touch* toes"),
    p("bow", "bend* forward bow"),
    p("bow", "take|takes|taking|make|makes|making bow"),
    p("bow", "bow|bows|bowing|bowed"),
    p("side_bend", "do|does|doing side +bend"),
    p("side_bend", "bend* upper +body"),
    p("side_bend", "bend*|lean* sideways"),
    p("side_bend", "bend*|lean* left|right"),
    p("twist", "turn*|rotat* upper +body"),
    p("twist", "twist*"),
    // Lying, sitting, standing.
    p(
        "stand_up",
        "stand|stands|standing|get|gets|getting +up from lying",
    ),
    p("stand_up", "stand|stands|standing|get|gets|getting +up"),
    p("stand_up", "rise|rises|rising from"),
    p("fall", "fall*|fell"),
    p("fall", "tumbl*"),
    p("fall", "collaps*"),
    p("lie_down", "lie|lies|lying|lay|lays|laying +down|back"),
    p("lie_still", "lie|lies|lying"),
    p("sit_down", "sit|sits|sitting +down"),
    p("sit_down", "take|takes|taking seat"),
    p("sit_still", "sit|sits|sitting"),
    p("sit_still", "remain*|stay* seated"),
    // Legs.
    p(
        "balance",
        "stand|stands|standing on +leg|foot|one|the leg|foot|left|right|one",
    ),
    p("balance", "balanc*"),
    p("kick", "swing* leg kick"),
    p("kick", "kick*"),
    p("step_over", "lift* leg step* +over"),
    p("leg_raise", "raise*|raising|lift* leg together arm"),
    p("leg_raise", "raise*|raising|lift* leg lower*"),
    p("leg_raise", "raise*|raising|lift* leg*"),
    p("step_over", "step* +over"),
    p("step_over", "climb* over"),
    p("hop", "hop|hops|hopping|hopped"),
    p("hop", "bounc*"),
    p("jump", "jump*"),
    p("jump", "leap*"),
    // Locomotion.
    p("march", "lift* knees march*"),
    p("march", "march*"),
    p("march", "walk* in +place"),
    p("march", "walk* on the +spot"),
    p(
        "jog_in_place",
        "jog|jogs|jogging|run|runs|running +in +place",
    ),
    p(
        "jog_in_place",
        "jog|jogs|jogging|run|runs|running +on the +spot",
    ),
    p("circle", "walk* circle*"),
    p("circle", "walk* counterclockwise|clockwise"),
    p("pace", "walk* back|up|to +and +forth|down|fro"),
    p("pace", "paces|pacing|paced"),
    p("limp", "walk* limp"),
    p("limp", "limp*"),
    p("limp", "hobbl*"),
    p("side_step", "take|takes|taking side +steps"),
    p(
        "side_step",
        "step|steps|stepping|move|moves|moving sideways",
    ),
    p("side_step", "side-step*|sidestep*"),
    p("side_step", "shuffl*"),
    p("run", "run|runs|running"),
    p("run", "jog|jogs|jogging"),
    p("walk", "walk*"),
    p("walk", "take|takes|taking steps|step"),
    p("turn", "make|makes|making turn"),
    p("turn", "fac* turn"),
    p("turn", "turn*"),
    p("turn", "spin|spins|spinning"),
    p("turn", "rotat*"),
    // Arms.
    p("salute", "raise*|raising hand* salut*"),
    p("salute", "give*|giving salut*"),
    p("salute", "salut*"),
    p("point", "stretch*|raise*|raising arm* point*"),
    p("point", "point*"),
    p("answer_phone", "hold*|lift*|answer*|make*|making phone"),
    p("drink", "bring* cup mouth drink*"),
    p("drink", "take|takes|taking drink"),
    p("drink", "drink*"),
    p("wave", "raise*|raising|lift* hand*|arm* wave*|waving"),
    p("wave", "greet* wave"),
    p("wave", "wave|waves|waving|waved"),
    p("cross_arms", "cross*|fold* arms"),
    p("hands_on_hips", "put*|place*|placing|rest* hands hips"),
    p("arm_circles", "swing* arm* circles"),
    p("arm_circles", "make|makes|making circles arm*"),
    p("arm_circles", "circle*|circling arm*"),
    p("punch", "throw* hook*|punch*|uppercut*"),
    p("punch", "swing* hook* punch*"),
    p("punch", "swing* hook*"),
    p("punch", "punch*"),
    p("punch", "box|boxes|boxing"),
    p("pull", "reach* out pull*"),
    p("pull", "pull*"),
    p("push", "push*"),
    p("knock", "knock*"),
    p("throw", "make|makes|making throw"),
    p("throw", "throw*"),
    p("throw", "toss*"),
    p("clap", "clap*"),
    p("stretch", "reach* up stretch*"),
    p("stretch", "stretch*"),
    p("raise_arms", "raise*|raising|lift* arm*|hand* lower*"),
    p("raise_arms", "raise*|raising|lift* arm*|hand*"),
    p("raise_arms", "put* hand* up"),
    p("raise_arms", "spread* arms lower*"),
    p("raise_arms", "spread* arms"),
    // Actions that the motion library does not have.
    p("crawl", "crawl*"),
    p("dance", "danc*"),
    p("roll", "roll|rolls|rolling"),
    p("carry", "carry*|carries"),
    p("open_door", "open* door"),
    p("reach", "reach*"),
    p("bend", "bend|bends|bending"),
    p("stand_still", "stand|stands|standing"),
    p("stand_still", "remain* standing"),
];
