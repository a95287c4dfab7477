//! What a sentence can state: a subject, and actions with their attributes.

use std::{fmt, str::FromStr};

use crate::lexicon;

/// A list of words, each of which is one value.
macro_rules! values {
    ($(#[$about:meta])* $name:ident { $($(#[$doc:meta])* $value:ident = $word:literal),* $(,)? }) => {
        $(#[$about])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
        pub enum $name {
            $($(#[$doc])* $value),*
        }

        impl $name {
            /// All values.
            pub const ALL: &'static [Self] = &[$(Self::$value),*];

            /// The word of the notation.
            pub const fn word(self) -> &'static str {
                match self {
                    $(Self::$value => $word),*
                }
            }

            pub(crate) fn from_word(word: &str) -> Option<Self> {
                Self::ALL.iter().copied().find(|value| value.word() == word)
            }
        }
    };
}

values! {
    /// Who acts.
    Subject {
        /// A person, someone, they.
        Person = "person",
        /// A man, he.
        Man = "man",
        /// A woman, she.
        Woman = "woman",
        /// A figure, a character.
        Figure = "figure",
    }
}

values! {
    /// The acting side of the body.
    Side {
        /// The person's left.
        Left = "left",
        /// The person's right.
        Right = "right",
        /// Both sides.
        Both = "both",
    }
}

values! {
    /// A direction as seen by the person.
    Direction {
        /// To the front.
        Forward = "forward",
        /// To the back.
        Backward = "backward",
        /// To the left; also counterclockwise.
        Left = "to_left",
        /// To the right; also clockwise.
        Right = "to_right",
        /// Up.
        Up = "up",
        /// Down.
        Down = "down",
        /// To a side that is not said.
        Sideways = "sideways",
    }
}

values! {
    /// The acting part of the body.
    BodyPart {
        /// Hand, fist, wrist, finger.
        Hand = "hand",
        /// Arm, forearm.
        Arm = "arm",
        /// Elbow.
        Elbow = "elbow",
        /// Shoulder.
        Shoulder = "shoulder",
        /// Head.
        Head = "head",
        /// Upper body, waist.
        Torso = "torso",
        /// Hip.
        Hip = "hip",
        /// Leg.
        Leg = "leg",
        /// Knee.
        Knee = "knee",
        /// Foot, heel, toe.
        Foot = "foot",
    }
}

values! {
    /// Where something happens, or what it reaches.
    Height {
        /// On the floor.
        Floor = "at_floor",
        /// Knees.
        Knee = "at_knee",
        /// Waist, hips.
        Waist = "at_waist",
        /// Chest.
        Chest = "at_chest",
        /// Shoulders.
        Shoulder = "at_shoulder",
        /// Head, face.
        Head = "at_head",
        /// Above the head.
        Overhead = "overhead",
        /// High.
        High = "high",
        /// Low.
        Low = "low",
    }
}

values! {
    /// The shape of the way of the body, or of a limb that goes to and fro.
    Path {
        /// A straight line.
        Straight = "straight",
        /// A circle.
        Circle = "circular",
        /// A curve, part of a circle.
        Curve = "curved",
        /// Zigzag.
        Zigzag = "zigzag",
        /// To and fro.
        BackAndForth = "back_and_forth",
        /// Obliquely.
        Diagonal = "diagonal",
    }
}

values! {
    /// How the body is held.
    Posture {
        /// Upright.
        Upright = "upright",
        /// Bent forward, hunched.
        Stooped = "stooped",
        /// With bent knees.
        Crouched = "crouched",
        /// On a seat.
        Seated = "seated",
        /// On the knees.
        Kneeling = "kneeling",
        /// Lying.
        Lying = "lying",
        /// On hands and knees.
        AllFours = "all_fours",
        /// Arms away from the body.
        ArmsOut = "arms_out",
        /// Arms at the sides.
        ArmsDown = "arms_down",
        /// Arms raised.
        ArmsUp = "arms_up",
        /// Legs apart.
        LegsApart = "legs_apart",
    }
}

values! {
    /// In what manner.
    Manner {
        /// With care, sneaking.
        Careful = "careful",
        /// Relaxed, without hurry.
        Casual = "casual",
        /// Drunk, without balance.
        Unsteady = "unsteady",
        /// With force.
        Forceful = "forceful",
        /// Lightly, softly.
        Gentle = "gentle",
        /// Like a robot.
        Stiff = "stiff",
        /// With confidence.
        Proud = "proud",
        /// Suddenly.
        Sudden = "sudden",
        /// Happily.
        Happy = "happy",
        /// Tired, sad.
        Tired = "tired",
        /// Clumsily.
        Awkward = "awkward",
    }
}

/// How often, or how many steps.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Count {
    /// So many times.
    Exactly(u16),
    /// More than once, without a number.
    Many,
}

/// How fast.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Tempo {
    /// Slowly.
    Slow,
    /// At a normal pace.
    Moderate,
    /// Quickly.
    Fast,
    /// Repetitions per minute.
    PerMinute(u16),
}

/// How far.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Extent {
    /// A little.
    Small,
    /// Much.
    Large,
    /// By an angle, degrees.
    Degrees(u16),
}

/// How long.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Duration {
    /// So many seconds.
    Seconds(u16),
    /// Briefly.
    Short,
    /// For a long time.
    Long,
}

/// An action with what is stated of it. An attribute that is not stated is `None`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Action {
    /// Name, for example `sit_down`.
    pub name: &'static str,
    /// The acting side of the body.
    pub side: Option<Side>,
    /// The direction.
    pub direction: Option<Direction>,
    /// The acting part of the body.
    pub body_part: Option<BodyPart>,
    /// Number of repetitions or steps.
    pub count: Option<Count>,
    /// How fast.
    pub tempo: Option<Tempo>,
    /// How far.
    pub extent: Option<Extent>,
    /// At which height.
    pub height: Option<Height>,
    /// Along which way.
    pub path: Option<Path>,
    /// In which posture.
    pub posture: Option<Posture>,
    /// In what manner.
    pub manner: Option<Manner>,
    /// How long.
    pub duration: Option<Duration>,
}

impl Action {
    /// An action of which nothing more is stated.
    pub const fn named(name: &'static str) -> Self {
        Self {
            name,
            side: None,
            direction: None,
            body_part: None,
            count: None,
            tempo: None,
            extent: None,
            height: None,
            path: None,
            posture: None,
            manner: None,
            duration: None,
        }
    }

    /// Adds an attribute that is not stated yet, written in the notation.
    ///
    /// # Errors
    /// The word is no attribute, or its kind is stated already.
    pub fn add(&mut self, word: &str) -> Result<(), String> {
        let taken = || format!("`{word}`: a second value of one kind");
        macro_rules! try_value {
            ($field:ident, $value:expr) => {
                if let Some(value) = $value {
                    return match self.$field {
                        Some(_) => Err(taken()),
                        None => {
                            self.$field = Some(value);
                            Ok(())
                        }
                    };
                }
            };
        }
        try_value!(side, Side::from_word(word));
        try_value!(direction, Direction::from_word(word));
        try_value!(body_part, BodyPart::from_word(word));
        try_value!(height, Height::from_word(word));
        try_value!(path, Path::from_word(word));
        try_value!(posture, Posture::from_word(word));
        try_value!(manner, Manner::from_word(word));
        try_value!(count, count_of(word));
        try_value!(tempo, tempo_of(word));
        try_value!(extent, extent_of(word));
        try_value!(duration, duration_of(word));
        Err(format!("`{word}` is no attribute"))
    }
}

fn count_of(word: &str) -> Option<Count> {
    match word.strip_prefix('x')? {
        "many" => Some(Count::Many),
        number => number.parse().ok().map(Count::Exactly),
    }
}

fn tempo_of(word: &str) -> Option<Tempo> {
    match word {
        "slow" => Some(Tempo::Slow),
        "moderate" => Some(Tempo::Moderate),
        "fast" => Some(Tempo::Fast),
        _ => word
            .strip_suffix("/min")?
            .parse()
            .ok()
            .map(Tempo::PerMinute),
    }
}

fn extent_of(word: &str) -> Option<Extent> {
    match word {
        "small" => Some(Extent::Small),
        "large" => Some(Extent::Large),
        _ => word.strip_suffix("deg")?.parse().ok().map(Extent::Degrees),
    }
}

fn duration_of(word: &str) -> Option<Duration> {
    match word {
        "short" => Some(Duration::Short),
        "long" => Some(Duration::Long),
        _ => word.strip_suffix('s')?.parse().ok().map(Duration::Seconds),
    }
}

impl fmt::Display for Count {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Exactly(n) => write!(f, "x{n}"),
            Self::Many => f.write_str("xmany"),
        }
    }
}

impl fmt::Display for Tempo {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Slow => f.write_str("slow"),
            Self::Moderate => f.write_str("moderate"),
            Self::Fast => f.write_str("fast"),
            Self::PerMinute(n) => write!(f, "{n}/min"),
        }
    }
}

impl fmt::Display for Extent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Small => f.write_str("small"),
            Self::Large => f.write_str("large"),
            Self::Degrees(n) => write!(f, "{n}deg"),
        }
    }
}

impl fmt::Display for Duration {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Seconds(n) => write!(f, "{n}s"),
            Self::Short => f.write_str("short"),
            Self::Long => f.write_str("long"),
        }
    }
}

/// Kinds of facts, in the order of tables.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// Who acts.
    Subject,
    /// The name of an action, in its place in the order of time.
    Action,
    /// The acting part of the body.
    BodyPart,
    /// The acting side.
    Side,
    /// The direction.
    Direction,
    /// Number of repetitions or steps.
    Count,
    /// How fast.
    Tempo,
    /// How far.
    Extent,
    /// At which height.
    Height,
    /// Along which way.
    Path,
    /// In which posture.
    Posture,
    /// In what manner.
    Manner,
    /// How long.
    Duration,
}

impl Kind {
    /// All kinds.
    pub const ALL: [Self; 13] = [
        Self::Subject,
        Self::Action,
        Self::BodyPart,
        Self::Side,
        Self::Direction,
        Self::Count,
        Self::Tempo,
        Self::Extent,
        Self::Height,
        Self::Path,
        Self::Posture,
        Self::Manner,
        Self::Duration,
    ];

    /// Name in tables and reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Subject => "subject",
            Self::Action => "action",
            Self::BodyPart => "body_part",
            Self::Side => "side",
            Self::Direction => "direction",
            Self::Count => "count",
            Self::Tempo => "tempo",
            Self::Extent => "extent",
            Self::Height => "height",
            Self::Path => "path",
            Self::Posture => "posture",
            Self::Manner => "manner",
            Self::Duration => "duration",
        }
    }
}

impl Action {
    /// The attributes that are stated, with their kinds, written in the notation.
    pub fn attributes(&self) -> Vec<(Kind, String)> {
        fn own<T: ToString>(kind: Kind, value: Option<T>) -> Option<(Kind, String)> {
            value.map(|v| (kind, v.to_string()))
        }
        [
            own(Kind::BodyPart, self.body_part.map(BodyPart::word)),
            own(Kind::Side, self.side.map(Side::word)),
            own(Kind::Direction, self.direction.map(Direction::word)),
            own(Kind::Count, self.count),
            own(Kind::Tempo, self.tempo),
            own(Kind::Extent, self.extent),
            own(Kind::Height, self.height.map(Height::word)),
            own(Kind::Path, self.path.map(Path::word)),
            own(Kind::Posture, self.posture.map(Posture::word)),
            own(Kind::Manner, self.manner.map(Manner::word)),
            own(Kind::Duration, self.duration),
        ]
        .into_iter()
        .flatten()
        .collect()
    }
}

impl Action {
    /// Takes over what another mention of the same action states in addition.
    pub(crate) fn merge(&mut self, other: &Self) {
        self.side = self.side.or(other.side);
        self.direction = self.direction.or(other.direction);
        self.body_part = self.body_part.or(other.body_part);
        self.count = self.count.or(other.count);
        self.tempo = self.tempo.or(other.tempo);
        self.extent = self.extent.or(other.extent);
        self.height = self.height.or(other.height);
        self.path = self.path.or(other.path);
        self.posture = self.posture.or(other.posture);
        self.manner = self.manner.or(other.manner);
        self.duration = self.duration.or(other.duration);
    }
}

impl fmt::Display for Action {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name)?;
        self.attributes()
            .iter()
            .try_for_each(|(_, word)| write!(f, " {word}"))
    }
}

/// What a sentence states.
///
/// The notation of a line: `man: walk forward x4; wave right hand + look`. A semicolon separates stretches of time, a
/// plus sign the actions of one; `-` is no subject.
///
/// ```
/// use radarllm_facts::{Facts, Side};
///
/// let facts: Facts = "person: walk forward slow; wave left hand x3".parse().unwrap();
/// assert_eq!(facts.stretches[1][0].side, Some(Side::Left));
/// assert_eq!(facts.to_string(), "person: walk forward slow; wave hand left x3");
/// ```
#[derive(Clone, Debug, PartialEq, Eq, Default)]
pub struct Facts {
    /// Who acts, if the sentence says it.
    pub subject: Option<Subject>,
    /// The actions of each stretch of time.
    pub stretches: Vec<Vec<Action>>,
}

impl Facts {
    /// All actions in order of time.
    pub fn actions(&self) -> impl Iterator<Item = &Action> {
        self.stretches.iter().flatten()
    }
}

impl fmt::Display for Facts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:", self.subject.map_or("-", Subject::word))?;
        for (n, stretch) in self.stretches.iter().enumerate() {
            f.write_str(if n == 0 { " " } else { "; " })?;
            for (i, action) in stretch.iter().enumerate() {
                write!(f, "{}{action}", if i == 0 { "" } else { " + " })?;
            }
        }
        Ok(())
    }
}

impl FromStr for Facts {
    type Err = String;

    /// Reads the notation.
    ///
    /// # Errors
    /// No colon, an unknown subject, action or attribute, or two attributes of one kind.
    fn from_str(text: &str) -> Result<Self, String> {
        let (subject, rest) = text.split_once(':').ok_or("no colon after the subject")?;
        let subject = match subject.trim() {
            "-" => None,
            word => Some(Subject::from_word(word).ok_or(format!("`{word}` is no subject"))?),
        };
        let mut stretches = Vec::new();
        for stretch in rest.split(';').map(str::trim).filter(|s| !s.is_empty()) {
            let mut actions = Vec::new();
            for text in stretch.split('+') {
                let mut words = text.split_whitespace();
                let name = words.next().ok_or("an action without a name")?;
                let name = lexicon::name(name).ok_or(format!("`{name}` is no action"))?;
                let mut action = Action::named(name);
                words.try_for_each(|word| action.add(word))?;
                actions.push(action);
            }
            stretches.push(actions);
        }
        Ok(Self { subject, stretches })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_notation_comes_back() {
        for line in [
            "person: walk forward slow; wave hand left x3 + look",
            "-: turn to_right 180deg",
            "figure:",
            "man: clap 120/min 6s; kick leg both xmany fast large high",
            "woman: walk x2 moderate small at_knee back_and_forth arms_out careful long",
        ] {
            assert_eq!(line.parse::<Facts>().unwrap().to_string(), line);
        }
    }

    #[test]
    fn what_is_no_notation_is_refused_with_the_word() {
        for (line, problem) in [
            ("person walk", "no colon after the subject"),
            ("robot: walk", "`robot` is no subject"),
            ("person: fly", "`fly` is no action"),
            ("person: walk purple", "`purple` is no attribute"),
            (
                "person: walk slow fast",
                "`fast`: a second value of one kind",
            ),
            ("person: walk x70000", "`x70000` is no attribute"),
            ("person: walk + ", "an action without a name"),
        ] {
            assert_eq!(line.parse::<Facts>().unwrap_err(), problem);
        }
    }
}
