//! The words that state an action.

/// A pattern of words, and the action that it states.
///
/// A pattern is a sequence of words separated by spaces, each with alternatives separated by `|`. A word that ends with
/// `*` matches every word that begins like it. The words must occur in this order, with at most [`MAX_GAP`] other words
/// between two of them. `+` before a word allows no other word before it. `?` before a pattern: it counts only where no
/// other pattern states anything in this part of the sentence.
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
    // What others do to the person.
    p(
        "pushed",
        "get|gets|getting|got|is|was|being|been|be|are|were +pushed|shoved|nudged",
    ),
    p(
        "pushed",
        "get|gets|getting|got|is|was|being|been|be +pulled|hit|bumped|knocked|kicked|struck",
    ),
    p("pushed", "as +if|though +pushed|shoved|bumped"),
    // Words that are parts of other actions elsewhere.
    p("tie_shoes", "tie|ties|tied|tying shoe*|lace*"),
    p("shake_hands", "shake|shakes|shaking +hands"),
    p("shake_hands", "shake|shakes|shaking someone*|other hand"),
    p(
        "shake_head",
        "shake|shakes|shaking +his|her|their|the|its head",
    ),
    p("jump_rope", "jump*|skip* +rope*"),
    p("jump_rope", "jump*|skip*|using a +rope"),
    p("nod", "nod|nods|nodded|nodding"),
    p("shrug", "shrug*"),
    p(
        "look",
        "turn*|rotat*|move|moves|moving|tilt* +his|her|their|its|the +head",
    ),
    p(
        "look",
        "look|looks|looking|looked +around|down|up|left|right|at|behind|over|back|to|through|out|for|side|from|into|in|both|under|across",
    ),
    p(
        "look",
        "stare*|staring|glanc*|gaz*|peer*|watches|search|searches|searching|inspect*|scan|scans|scanning",
    ),
    p(
        "look",
        "check|checks|checking +around|the|out|his|their|watch|time|behind|both",
    ),
    p(
        "arm_circles",
        "move|moves|moving|swing*|rotat*|raise*|wave|waves|waving hand*|arm* circular|circle|circles",
    ),
    p("arm_circles", "rotat*|roll* arm*|shoulder*|wrist*|elbow*"),
    p(
        "arm_circles",
        "move|moves|moving +it|them in circular|circle|circles",
    ),
    p("arm_circles", "windmill*"),
    p(
        "cross_legs",
        "cross|crosses|crossing|crossed +his|her|their|the|its legs",
    ),
    p("dribble", "dribbl*"),
    p("dribble", "bounc* ball|basketball"),
    p(
        "hit",
        "swing* golf|bat|racket|racquet|club|sword|baseball|tennis",
    ),
    p("hit", "play|plays|playing +tennis|golf|baseball"),
    p("hit", "tennis|golf|baseball +swing*|shot*|stroke*|serve*"),
    p("exercise", "warm|warms|warming +up|ups"),
    p("exercise", "work|works|working +out"),
    p("sit_up", "sit +ups"),
    p("push_up", "push +ups"),
    p("push_up", "push-up*|pushup*"),
    p(
        "play_instrument",
        "play|plays|played|playing a|an|the|on|air +violin|guitar|piano|drum*|flute|trumpet|instrument|fiddle|cello|saxophone|banjo|ukulele",
    ),
    p("play_instrument", "strum*"),
    p(
        "play_instrument",
        "play|plays|playing +violin|guitar|piano|drum*|flute|trumpet",
    ),
    p(
        "kneel",
        "get|gets|getting|got|go|goes|going|drop*|fall|falls on|onto|to all +fours",
    ),
    p(
        "kneel",
        "get|gets|getting|got|go|goes|going|drop* on|onto hands and knees",
    ),
    p("crawl", "walk*|move|moves|moving all +fours"),
    p("crawl", "walk*|move|moves|moving on hands +and knees"),
    p("side_step", "sidestepping"),
    // "Punches with both fists in turn" does not turn.
    p("punch", "punch* in +turn"),
    // Actions of the whole body that contain others.
    p(
        "jumping_jack",
        "exercis*|does|do|doing|perform* with jumping +jack*",
    ),
    p("jumping_jack", "jumping +jack*"),
    p("jumping_jack", "star +jump*"),
    p("crouch", "crouch* get|gets|getting up"),
    p("crouch", "crouch* stand|stands|standing up"),
    p("crouch", "crouch* rise|rises|rising"),
    p("crouch", "crouch*"),
    p("squat", "squat* paus* rise|rises|rising"),
    p("crouch", "duck|ducks|ducking|ducked +down"),
    p("squat", "bend* knees squat* rise|rises|rising"),
    p("squat", "squat* stand|stands|standing up"),
    p("squat", "squat* rise|rises|rising"),
    p("squat", "squat*"),
    p(
        "kneel",
        "kneel* knee get|gets|getting|rise|rises|rising +up|again",
    ),
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
    p(
        "pick_up",
        "picks|picking|picked something|object|item|it|things|the",
    ),
    p(
        "pick_up",
        "lift|lifts|lifting|lifted +up something|object|objects|item|items|box|it|weight*|thing*|ball|bowl",
    ),
    p(
        "pick_up",
        "lift|lifts|lifting|lifted +something|it|box|weights",
    ),
    p(
        "pick_up",
        "lift|lifts|lifting|lifted +a|an|the|some|and object|objects|item|items|box|weight*|thing*|ball|bowl|dumbbell*|barbell",
    ),
    p("pick_up", "pick* up"),
    p("pick_up", "lift*|grab* off|from floor|ground"),
    p("toe_touch", "bend* touch* toes"),
    p("toe_touch", "reach* toes"),
    p("toe_touch", "touch* toes"),
    p("toe_touch", "reach* touch* foot|feet"),
    p("bow", "bend* forward bow"),
    p("bow", "take|takes|taking|make|makes|making bow"),
    p("bow", "bow|bows|bowing|bowed"),
    p("bend", "bend* +over|down"),
    p("side_bend", "do|does|doing side +bend"),
    p("side_bend", "bend* upper +body"),
    p("side_bend", "bend*|lean* sideways"),
    p("side_bend", "bend*|lean* left|right"),
    p("twist", "turn*|rotat* upper +body"),
    p("twist", "turn*|rotat* torso|waist"),
    p("twist", "twist*"),
    p(
        "move_hips",
        "rotat*|roll*|mov*|thrust*|swing*|sway*|wiggl*|shak*|swivel*|gyrat* hip*",
    ),
    // Lying, sitting, standing.
    p(
        "stand_up",
        "stand|stands|standing|get|gets|getting +up from lying",
    ),
    p("stand_up", "stand|stands|standing|get|gets|getting +up"),
    p("stand_up", "rise|rises|rising from"),
    p("stand_up", "rise|rises|rising|rose +up|again"),
    p("stand_up", "rise|rises|rising|rose to"),
    p("stand_up", "stand|stands|standing +straight +up"),
    p(
        "stand_up",
        "stand|stands|standing +upright|tall +again|from",
    ),
    p("stand_up", "come|comes|coming +up"),
    p("stand_up", "straighten*"),
    p("stumble", "almost|nearly +fall|falls|falling|fell|trip*"),
    p("stumble", "los*|off balance|footing"),
    p(
        "stumble",
        "stumbl*|stagger*|trip|trips|tripping|tripped|wobbl*|totter*|teeter*|falter*|reel|reels",
    ),
    p("recover", "recover*|recovery"),
    p(
        "recover",
        "regain*|catch*|correct* balance|footing|composure|themself|themselves|himself|itself|herself",
    ),
    p("fall", "fall*|fell"),
    p("fall", "tumbl*"),
    p("fall", "collaps*"),
    p("lie_down", "lie|lies|lying|lay|lays|laying +down|back"),
    p("lie_still", "lie|lies|lying"),
    p("lie_still", "laying|lays on"),
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
    p("stomp", "stomp*|stamp|stamps|stamping|stump|stumps"),
    p("swing_leg", "swing* leg*|foot|feet"),
    p(
        "move_legs",
        "move|moves|moving|put|puts|putting|bring|brings|bringing|places|placing|extend*|spread|spreads|slide|slides leg|legs|foot|feet|knee",
    ),
    p("drag", "drag|drags|dragging|dragged +something|a|an|it"),
    p("step_over", "lift* leg step* +over"),
    p("leg_raise", "raise*|raising|lift* leg together arm"),
    p("leg_raise", "raise*|raising|lift* leg lower*"),
    p(
        "leg_raise",
        "raise*|raising|lift* leg*|foot|feet|knee|thigh",
    ),
    p("step_over", "step* +over"),
    p("step_over", "climb* over"),
    p("step_over", "high-step|high-steps over"),
    p("hop", "hop|hops|hopping|hopped"),
    p("skip", "skip|skips|skipping|skipped"),
    p("hop", "bounc*"),
    p(
        "flip",
        "flip|flips|flipping|backflip*|somersault*|summersault*",
    ),
    p("handstand", "handstand*|headstand*"),
    p("handstand", "hand +stand*"),
    p("climb", "climb*"),
    p(
        "climb",
        "step*|walk*|go|goes|going +up|down|onto stair*|step|steps|ladder|platform",
    ),
    p("climb", "ascend*|descend*"),
    p("climb", "stepping +up +onto|on"),
    p("jump", "jump*"),
    p("jump", "leap*"),
    // Locomotion.
    p("turn", "turn* on the +spot"),
    p("march", "lift* knees march*"),
    p("march", "march*"),
    p("march", "walk* in +place"),
    p("march", "walk* on the +spot"),
    p("march", "step* in +place"),
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
    p("pace", "move|moves|moving +back +and +forth"),
    p("pace", "walk*|move|moves|moving +side|front +to +side|back"),
    p(
        "pace",
        "walk*|move|moves|moving +from +side|front +to +side|back",
    ),
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
    p("side_step", "side +step|steps|stepping|stepped"),
    p("side_step", "shuffl*|straf*"),
    p(
        "circle",
        "go|goes|going|move|moves|moving in|around a +circle",
    ),
    p("circle", "?clockwise|counterclockwise circle"),
    p("run", "take|takes|taking running +steps|step"),
    p("run", "sprint*"),
    p("run", "rush|rushes|rushing|rushed|race|races|racing"),
    p("run", "run|runs|running|ran"),
    p("run", "jog|jogs|jogging"),
    p("walk", "walk*"),
    p("walk", "take|takes|taking steps|step"),
    p(
        "walk",
        "make|makes|making|does|do|doing|perform* steps|step",
    ),
    p(
        "walk",
        "stroll*|stride*|striding|strode|saunter*|wander*|strut*|tiptoes|tiptoeing|tiptoed|sneak*|creep*|amble*|trudge*|plod*|waddle*|stalk*|swagger*|hike*",
    ),
    p("walk", "moonwalk*"),
    p("walk", "stepping"),
    p(
        "walk",
        "advance*|wade*|proceed|proceeds +forward|backward|to|toward|towards",
    ),
    p("walk", "move|moves|moving +around"),
    p("walk", "?catwalk|runway|run-way"),
    p("turn", "make|makes|making turn"),
    p("turn", "chang* direction*"),
    p("turn", "fac* turn"),
    p("turn", "turn*"),
    p("turn", "spin|spins|spinning"),
    p("turn", "rotat*|pivot*|swivel*|twirl*|swerv*|veer*"),
    // Arms.
    p("salute", "raise*|raising hand* salut*"),
    p("salute", "give*|giving salut*"),
    p("salute", "salut*"),
    p("point", "stretch*|raise*|raising arm* point*"),
    p("point", "point*"),
    p("answer_phone", "hold*|lift*|answer*|make*|making phone"),
    p("drink", "bring* cup mouth drink*"),
    p("drink", "take|takes|taking drink"),
    p("drink", "drink*|sip|sips|sipping"),
    p("flap", "flap*"),
    p("flap", "wave|waves|waving +arms like wing*|bird|chicken"),
    p("wave", "raise*|raising|lift* hand*|arm* wave*|waving"),
    p("wave", "greet* wave"),
    p("wave", "wave|waves|waving|waved"),
    p("cross_arms", "cross*|fold* arms"),
    p("hands_on_hips", "put*|place*|placing|rest* hands hips"),
    p(
        "hands_on_hips",
        "put*|place*|placing|rest*|has|have|having hand*|arms hip|hips|waist",
    ),
    p(
        "hands_on_hips",
        "hand* +on|is|are his|her|their|the|its +hip|hips|waist",
    ),
    p("cross_arms", "cross*|fold* hands|arm"),
    p("cross_arms", "make|makes|making an|a +x"),
    p("uncross_arms", "uncross*|unfold* arm*"),
    p("arm_circles", "swing* arm* circles"),
    p("arm_circles", "make|makes|making circles arm*"),
    p("arm_circles", "circle*|circling arm*"),
    p("punch", "throw* hook*|punch*|uppercut*"),
    p("punch", "swing* hook* punch*"),
    p("punch", "swing* hook*"),
    p("punch", "punch*|jab|jabs|jabbing|jabbed"),
    p("punch", "box|boxes|boxing"),
    p("pull", "reach* out pull*"),
    p("pull", "pull*"),
    p("push", "push*"),
    p("knock", "knock*"),
    p("throw", "make|makes|making throw"),
    p("throw", "throw*"),
    p(
        "throw",
        "toss*|pitch|pitches|pitching|pitched|hurl*|lob|lobs|lobbing|bowls|fling*|cast|casts|casting|chuck*|thew",
    ),
    p("catch", "catch|catches|catching"),
    p("shoot", "shoot|shoots|shot|shooting"),
    p("shoot", "aim|aims|aiming"),
    p(
        "stir",
        "stir|stirs|stirred|stirring|mix|mixes|mixing|whisk*",
    ),
    p("pour", "pour|pours|poured|pouring"),
    p(
        "wipe",
        "wipe*|wiping|wash|washes|washing|scrub*|clean|cleans|cleaning|brush*|sweep*|polish*|dust|dusts|dusting|rins*|mop|mops|mopping|shower*",
    ),
    p("wipe", "dry|dries|drying"),
    p("scratch", "scratch*|itch*"),
    p(
        "rub",
        "rub|rubs|rubbed|rubbing|massag*|pat|pats|patting|pet|pets|petting|caress*",
    ),
    p(
        "write",
        "write|writes|wrote|writing|draw|draws|drawing|paint|paints|painting",
    ),
    p("type", "type|types|typed|typing"),
    p(
        "cut",
        "cut|cuts|cutting|slic*|chop|chops|chopping|saw|saws|sawing",
    ),
    p("dig", "dig|digs|dug|digging|shovel*"),
    p("swim", "swim|swims|swam|swimming|backstroke*|breaststroke*"),
    p("row", "row|rows|rowed|rowing|paddl*"),
    p(
        "slide",
        "slide|slides|sliding|slid|skid|skids|skidding|skat*|ski|skis|skiing|glid*",
    ),
    p(
        "dodge",
        "dodg*|duck|ducks|ducking|ducked|evad*|avoid|avoids|avoiding|flinch*",
    ),
    p(
        "defend",
        "defend*|defens*|block|blocks|blocking|shield*|protect*|guard|guards|guarding",
    ),
    p(
        "martial_arts",
        "karate|martial|kung|kungfu|tai|taekwondo|judo",
    ),
    p("fight", "fight|fights|fought|fighting|spar|spars|sparring"),
    p(
        "hit",
        "swip*|hit|hits|hitting|strike*|striking|slap*|smack*|swat|swats|swatting|chop*|hammer*|whack*|beat|beats|beating|slash*|stab|stabs|stabbing",
    ),
    p("clap", "clap*"),
    p("stretch", "reach* up stretch*"),
    p("stretch", "stretch*"),
    p("flex", "flex|flexes|flexed|flexing"),
    p("clench", "clench*"),
    p(
        "join_hands",
        "put*|puts|bring*|clasp*|hold* hands +together",
    ),
    p("join_hands", "clasp*|pray|prays|praying"),
    p("raise_arms", "spread* arms lower*"),
    p("raise_arms", "spread* arms sides lower*"),
    p("raise_arms", "raise*|raising|lift* arm*|hand* side lower*"),
    p("raise_arms", "raise*|raising|lift* arm*|hand* lower*"),
    p("raise_arms", "raise*|raising|lift* arm*|hand*"),
    p("raise_arms", "put* hand* up"),
    p(
        "raise_arms",
        "raise*|raising|lift*|lifting elbow*|fist*|wrist*|forearm*|it|them|shoulder*",
    ),
    p("raise_arms", "hand*|arm* +go|goes|going|raised|lifted +up"),
    p("bend_arms", "bend|bends|bending arm*|elbow*"),
    p("bend_knees", "bend|bends|bending knee|knees|leg|legs"),
    p(
        "lower_arms",
        "lower|lowers|lowering|lowered|drop|drops|dropping|dropped|lows arm*|hand*|it|them|elbow*|fist*|shoulder*",
    ),
    p(
        "lower_arms",
        "put*|bring*|let*|returns|returning arm*|hand*|it|them +down",
    ),
    p("grab", "get|gets|getting|take|takes|taking +hold"),
    p(
        "touch",
        "put*|place*|placing|rest*|hold|holds|holding|held hand|hands|arm|arms|finger* on|over|against|behind",
    ),
    p("touch", "touch*|tap|taps|tapping|tapped|adjust*"),
    p("touch", "pawing|paw|paws|feel|feels|feeling +at"),
    p(
        "swing_arms",
        "swing*|swung|sway*|dangl*|flail* arm*|hand*|it",
    ),
    p("swing_arms", "arm*|hand* swing*|swung|dangling|flailing"),
    p("swing_arms", "swing*|swung|flail*|armswing*"),
    p(
        "gesture",
        "mov*|use|uses|using hand|hands|arm to +beckon*|gestur*|signal*",
    ),
    p(
        "gesture",
        "gestur*|beckon*|jestur*|signal*|motions|motioning",
    ),
    p("gesture", "mov*|make|makes|making hand|hands gesture*"),
    p("greet", "greet*"),
    p("reach", "extend*|outstretch* arm*|hand*|wrist*|elbow*"),
    p(
        "move_arms",
        "mov*|put*|bring*|brought|wiggl*|roll*|circling|pump*|shak* hand|hands|arm|arms|elbow*|wrist*|forearm*|finger*|fist*|shoulder*",
    ),
    p(
        "move_object",
        "mov*|transfer*|relocat*|shift* something|object|objects|item|items|box|thing|it|them|from",
    ),
    p(
        "place",
        "put|puts|putting|set|sets|setting|placing|places|placed|drop|drops|dropping|dropped|lay|lays down|it|something|object|item|them|back|box|ball|on|in|away|thing|some",
    ),
    p(
        "place",
        "place|places|placing|placed +it|something|the|an|a|them|object|back|down|some",
    ),
    p("grab", "grab*|grasp*|grip*"),
    p(
        "grab",
        "take|takes|taking|took|get|gets +something|it|object|item|thing|them",
    ),
    p(
        "grab",
        "take|takes|taking|took|get|gets +a|an|the +object|item|thing|box|ball|bottle|cup|glass|book",
    ),
    p("answer_phone", "talk*|speak* +on phone"),
    p("answer_phone", "phone +call"),
    p(
        "talk",
        "talk|talks|talked|talking|speak|speaks|speaking|conversation",
    ),
    p("shout", "yell*|shout*|scream*"),
    p("laugh", "laugh*"),
    p("cough", "cough*|sneez*"),
    p("shake", "shak*"),
    p("open_door", "open* door"),
    p("open", "opens|opening|opened|unlock*"),
    p("close", "close +something|it"),
    p("open", "open +something|it"),
    p("close", "closed|closes|closing|shuts|shutting"),
    p("return", "return|returns|returning|returned|resum*"),
    p(
        "return",
        "go|goes|going|went|come|comes|coming|gets|moves +back +to|into|in",
    ),
    p("bump", "bump*|collid*|crash*"),
    p(
        "bump",
        "walk*|run|runs into +something|wall|an|a obstacle|wall|object|something",
    ),
    p(
        "exercise",
        "exercis*|excercis*|aerobic*|calisthenic*|workout",
    ),
    p("imitate", "?imitat*|mimic*|impersonat*|pretend*"),
    p("imitate", "?act|acts|acting +like|as|out"),
    p("imitate", "?acting +like"),
    p("pose", "pose|poses|posing|posed"),
    p(
        "pose",
        "assume*|assuming|strike*|take|takes|taking stance|position",
    ),
    p("sway", "sway*|rock|rocks|rocking|wiggl*"),
    p("raise_arms", "spread* arms"),
    // Actions that the motion library does not have.
    p("crawl", "crawl*|slither*"),
    p(
        "dance",
        "danc*|waltz*|salsa*|ballet*|tango*|macarena|cha-cha|chacha|ballroom|groov*|jig",
    ),
    p("dance", "cha +cha"),
    p("roll", "roll|rolls|rolling"),
    p("carry", "carry*|carries"),
    p("reach", "reach*|outstretch*"),
    p(
        "bend",
        "bend|bends|bending|dip|dips|dipping|stoop|stoops|stooping|hunch|hunches|hunching",
    ),
    p("bend", "is|are|was +bent"),
    p("lean", "lean*|tilt*"),
    p("lower_arms", "lower|lowers|lowering|lowered arm*|hand*"),
    p("hold", "hold|holds|holding|held|clutch*"),
    p("hold", "grip"),
    p(
        "walk",
        "move|moves|moving|go|goes|going|heads|heading|travel*|come|comes|coming forward|backward|up|around|away|toward|towards|ahead|straight|sideways|diagonally|across|left|right|diagonal|clockwise|counterclockwise|side|direction|circular|line|path|steps",
    ),
    p("walk", "approach*"),
    p("walk", "backs|backing|backed +up|away|into|off|from"),
    p("dodge", "?evasive"),
    p("stand_still", "stand|stands|standing"),
    p("stand_still", "remain* standing"),
    p(
        "stand_still",
        "stay*|remain*|keep|keeps +still|straight|standing|upright|stationary|in|at",
    ),
    p("stop", "stop|stops|stopping|stopped|halt*|standstill"),
    p("stop", "paus*"),
    p(
        "return",
        "?back|return|returning to|at|in original|starting|start|initial|same|position|center|where|beginning",
    ),
    p(
        "return",
        "?to original|starting|start|initial position|stance|place|spot",
    ),
    p("walk", "?steps|step|stepping"),
    p("walk", "?move|moves|moving|wanders"),
];

/// Phrases of words that elsewhere state actions, and here state none. They are matched before all patterns.
pub(crate) const IDIOMS: &[&str] = &[
    "fighting|fight|defensive|defense|boxing|defending +stance|position|pose",
    "standing|sitting|seated|kneeling|crouching|squatting|lying|resting|walking +position|pose|stance|posture",
    "box|circle +shape",
    "open|closed +pose",
    "step +by +step",
    "one +step +at +a +time",
    "from the +punch",
    "were|was previously|originally +standing|sitting",
    "where +they|he|she +is|are|was|were +walking|standing|facing",
];

/// Actions that no pattern states, so that notation of facts can name them.
const UNSTATED: [&str; 2] = ["cartwheel", "eat"];

/// Words that state attributes, and words that state nothing, one a line.
const OTHER_WORDS: &str = include_str!("../data/words.txt");

/// Whether a word of [`crate::words::words`] is in the lexicon: in a pattern, as an attribute, or as a word that states
/// nothing.
pub fn knows(word: &str) -> bool {
    let in_pattern = |pattern: &Pattern| {
        pattern.words.split([' ', '|']).any(|w| {
            let w = w.trim_start_matches(['+', '?']);
            match w.strip_suffix('*') {
                Some(start) => word.starts_with(start),
                None => word == w,
            }
        })
    };
    crate::words::number(word).is_some()
        || OTHER_WORDS.lines().any(|known| known == word)
        || PATTERNS.iter().any(in_pattern)
}

/// The name of an action as the lexicon has it; `None` if it has no such action.
pub fn name(name: &str) -> Option<&'static str> {
    let stated = PATTERNS.iter().map(|pattern| pattern.action);
    stated.chain(UNSTATED).find(|known| *known == name)
}
