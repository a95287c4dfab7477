//! Facts to sentences, drawn anew by a seed.
//!
//! Every sentence is read again by the parser before it is returned, so that it states nothing that the facts do not.
//! What is left out, how stretches are linked and how the person is called follow the frequencies of people's sentences
//! ([`Mix`]); the wording is the project's own.
//!
//! ```
//! use radarllm_facts::{Facts, facts, write::Writer};
//!
//! let motion: Facts = "person: walk forward slow; wave hand left x3".parse().unwrap();
//! let written = Writer::new().write(&motion, 7).unwrap();
//! assert_eq!(facts(&written.text), written.mentioned);
//! ```

mod mix;
mod phrases;

use radarllm_base::{random::SplitMix64, seed::derive_seed};

pub use mix::Mix;

use crate::{
    action::{
        Action, BodyPart, Count, Direction, Duration, Extent, Facts, Height, Kind, Path, Posture,
        Side, Subject, Tempo,
    },
    inflect::{Form, inflect},
    tables,
    words::number_word,
};

/// Attempts to write a sentence that the parser reads as it was meant.
const ATTEMPTS: usize = 80;
/// Attempts after which more and more is left out, so that something is written.
const PLAINER: usize = 40;

/// A sentence and what it states.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Written {
    /// The sentence, in lower case without a full stop at its end.
    pub text: String,
    /// What it states: the facts without what was left out.
    pub mentioned: Facts,
}

/// Writes sentences.
#[derive(Clone, Debug)]
pub struct Writer {
    mix: Mix,
}

impl Default for Writer {
    fn default() -> Self {
        Self::new()
    }
}

impl Writer {
    /// A writer that leaves out as much as people do.
    pub fn new() -> Self {
        Self {
            mix: Mix::of_people(),
        }
    }

    /// A sentence about the facts; the same seed gives the same sentence. `None` if no wording is known that the parser
    /// reads as it was meant, for example for an action without a verb.
    pub fn write(&self, facts: &Facts, seed: u64) -> Option<Written> {
        self.draw(facts, seed, true)
    }

    /// A sentence that leaves out only what has no wording.
    pub fn write_fully(&self, facts: &Facts, seed: u64) -> Option<Written> {
        self.draw(facts, seed, false)
    }

    fn draw(&self, facts: &Facts, seed: u64, omits: bool) -> Option<Written> {
        (0..ATTEMPTS).find_map(|attempt| {
            let mut pen = Pen {
                dice: SplitMix64::new(derive_seed(seed, &format!("sentence {attempt}"))),
                mix: &self.mix,
                subject: facts.subject,
            };
            let plainer = attempt.saturating_sub(PLAINER) as f64 / (ATTEMPTS - PLAINER) as f64;
            let chosen = pen.choose(facts, omits, plainer);
            let text = pen.sentence(&chosen, attempt >= PLAINER)?;
            let mentioned = crate::facts(&text);
            is_true(&mentioned, &chosen, facts).then_some(Written { text, mentioned })
        })
    }
}

/// Whether a sentence states what was chosen, and nothing that the facts do not state. The part of the body that carries
/// a side has to be named, whether the facts name it or not.
fn is_true(stated: &Facts, chosen: &Facts, facts: &Facts) -> bool {
    let (stated_actions, chosen_actions): (Vec<_>, Vec<_>) =
        (stated.actions().collect(), chosen.actions().collect());
    stated.subject == facts.subject
        && stated_actions.len() == chosen_actions.len()
        && stated_actions
            .iter()
            .zip(chosen_actions)
            .zip(facts.actions())
            .all(|((stated, chosen), fact)| {
                let (said, known) = (stated.attributes(), fact.attributes());
                stated.name == fact.name
                    && chosen.attributes().iter().all(|a| said.contains(a))
                    && said.iter().all(|a| {
                        known.contains(a) || a.0 == Kind::BodyPart && fact.body_part.is_none()
                    })
            })
}

/// One attempt at a sentence.
struct Pen<'a> {
    dice: SplitMix64,
    mix: &'a Mix,
    subject: Option<Subject>,
}

impl Pen<'_> {
    fn chance(&mut self, probability: f64) -> bool {
        self.dice.uniform_f64() < probability
    }

    fn pick<'s>(&mut self, from: &[&'s str]) -> &'s str {
        match from.len() {
            0 => "",
            n => from[self.dice.below(n)],
        }
    }

    /// A key of a table, with a probability in proportion to its count.
    fn weighted(&mut self, table: &[(&str, usize)]) -> String {
        let all: usize = table.iter().map(|(_, n)| n).sum();
        let mut left = self.dice.below(all.max(1));
        for (key, n) in table {
            if left < *n {
                return (*key).to_string();
            }
            left -= n;
        }
        String::new()
    }

    /// Leaves facts out as people do.
    fn choose(&mut self, facts: &Facts, omits: bool, plainer: f64) -> Facts {
        let mut chosen = facts.clone();
        for action in chosen.stretches.iter_mut().flatten() {
            let keeps = |pen: &mut Self, action: &Action, kind| {
                let share = match omits {
                    // Shares are of all mentions, also of those where there was nothing to mention.
                    true => (2.5 * pen.mix.share(action, kind)).clamp(0.05, 0.95),
                    false => 1.0,
                };
                pen.chance(share * (1.0 - plainer))
            };
            let own = *action;
            macro_rules! omit {
                ($($field:ident = $kind:ident),*) => {
                    $(if own.$field.is_some() && !keeps(self, &own, Kind::$kind) {
                        action.$field = None;
                    })*
                };
            }
            omit!(
                body_part = BodyPart,
                side = Side,
                direction = Direction,
                count = Count,
                tempo = Tempo,
                extent = Extent,
                height = Height,
                path = Path,
                posture = Posture,
                manner = Manner,
                duration = Duration
            );
        }
        chosen
    }

    fn possessive(&mut self) -> &'static str {
        let own = match self.subject {
            Some(Subject::Man) => "his",
            Some(Subject::Woman) => "her",
            Some(Subject::Figure) => "its",
            _ => "their",
        };
        if self.chance(0.25) { "the" } else { own }
    }

    /// How the person is called, and how the first verb is inflected.
    fn opening(&mut self) -> (String, Form) {
        let Some(subject) = self.subject else {
            let form = [Form::Third, Form::Gerund][self.dice.below(2)];
            return (String::new(), form);
        };
        let own: Vec<(&str, usize)> = self
            .mix
            .subjects
            .iter()
            .map(|(phrase, n)| (phrase.as_str(), *n))
            .filter(|(phrase, _)| crate::facts(phrase).subject == Some(subject))
            // Plural verbs have no form here.
            .filter(|(phrase, _)| *phrase != "they")
            .collect();
        let phrase = match own.is_empty() {
            true => format!("a {}", subject.word()),
            false => self.weighted(&own),
        };
        let forms: Vec<(&str, usize)> = self
            .mix
            .forms
            .iter()
            .map(|(form, n)| (form.as_str(), *n))
            .collect();
        match self.weighted(&forms).as_str() {
            "is_gerund" => (format!("{phrase} is"), Form::Gerund),
            "gerund" => (phrase, Form::Gerund),
            _ if self.chance(0.05) => (phrase, Form::Past),
            _ => (phrase, Form::Third),
        }
    }

    /// `separate` gives every action a stretch of its own.
    fn sentence(&mut self, facts: &Facts, separate: bool) -> Option<String> {
        let stretches: Vec<Vec<Action>> = match separate {
            true => facts.actions().map(|action| vec![*action]).collect(),
            false => facts.stretches.clone(),
        };
        let (opening, form) = self.opening();
        let mut out = opening;
        let links: Vec<(&str, usize)> = self
            .mix
            .links
            .iter()
            .map(|(link, n)| (link.as_str(), *n))
            .collect();
        let n_stretches = stretches.len();
        for (n, stretch) in stretches.iter().enumerate() {
            let mut form = form;
            if n == 0 {
                if !out.is_empty() {
                    out.push(' ');
                }
            } else {
                let mut link = self.weighted(&links);
                if link == " after " {
                    link = ", then ".into();
                }
                if matches!(link.as_str(), " before " | ", followed by ") {
                    form = Form::Gerund;
                }
                if link.starts_with('.') && self.subject.is_some() {
                    let pronoun = match self.subject {
                        Some(Subject::Man) => "he",
                        Some(Subject::Woman) => "she",
                        Some(Subject::Figure) => "the figure",
                        _ => "the person",
                    };
                    link.push_str(pronoun);
                    link.push_str(if form == Form::Gerund { " is " } else { " " });
                } else if n + 1 == n_stretches && n > 1 && self.chance(0.2) {
                    link = ", and finally ".into();
                    form = if form == Form::Gerund {
                        form
                    } else {
                        Form::Third
                    };
                }
                out.push_str(&link);
            }
            for (i, action) in stretch.iter().enumerate() {
                let mut form = form;
                if i > 0 {
                    // Stretches of people's sentences hold what "and" joins.
                    let (joint, gerund) = match self.dice.below(10) {
                        0..=5 => (" and ", false),
                        6 | 7 => (", ", true),
                        8 => (" whilst ", true),
                        _ => (" while ", true),
                    };
                    out.push_str(joint);
                    form = if gerund { Form::Gerund } else { form };
                }
                let phrase = self.phrase(action, form)?;
                out.push_str(&phrase);
            }
        }
        Some(out.trim().to_string())
    }

    /// A noun phrase of the acting part of the body.
    fn limb(&mut self, action: &Action) -> String {
        let part = action.body_part.unwrap_or(match action.name {
            "twist" | "stretch" => match action.side {
                Some(_) => BodyPart::Arm,
                None => BodyPart::Torso,
            },
            name => tables::action_words(name).map_or(BodyPart::Hand, |words| words.limb),
        });
        let (one, many) = match part {
            BodyPart::Hand => ("hand", "hands"),
            BodyPart::Arm => ("arm", "arms"),
            BodyPart::Elbow => ("elbow", "elbows"),
            BodyPart::Shoulder => ("shoulder", "shoulders"),
            BodyPart::Head => ("head", "head"),
            BodyPart::Torso => ("upper body", "upper body"),
            BodyPart::Hip => ("hip", "hips"),
            BodyPart::Leg => ("leg", "legs"),
            BodyPart::Knee => ("knee", "knees"),
            BodyPart::Foot => ("foot", "feet"),
        };
        let own = self.possessive();
        match action.side {
            Some(Side::Both) if self.chance(0.7) => format!("both {many}"),
            Some(Side::Both) => {
                format!("both of {} {many}", if own == "the" { "the" } else { own })
            }
            Some(side) => format!("{own} {} {one}", side.word()),
            None => format!("{own} {many}"),
        }
    }

    fn thing(&mut self) -> String {
        let things: Vec<&str> = phrases::THINGS.lines().collect();
        let thing = self.pick(&things).to_string();
        let phrase = match self.chance(0.35) {
            true => {
                let adjectives: Vec<&str> = phrases::ADJECTIVES.lines().collect();
                format!("{} {thing}", self.pick(&adjectives))
            }
            false => thing,
        };
        let vowel = phrase.starts_with(['a', 'e', 'i', 'o', 'u']);
        let article = match self.dice.below(4) {
            0 => "the",
            _ if vowel => "an",
            _ => "a",
        };
        format!("{article} {phrase}")
    }

    /// One action with its attributes, its verbs inflected.
    fn phrase(&mut self, action: &Action, form: Form) -> Option<String> {
        let verbs = &tables::action_words(action.name)?.phrases;
        if verbs.is_empty() {
            return None;
        }
        let mut template = self.pick(verbs).to_string();
        let mut tail: Vec<String> = Vec::new();
        let steps = matches!(action.name, "walk" | "side_step" | "run" | "march" | "limp");
        if let Some(count) = action.count {
            if action.name == "walk" && self.chance(0.6) {
                let size = match action.extent {
                    Some(Extent::Small) => self.pick(&["small ", "short ", "little "]),
                    Some(Extent::Large) => self.pick(&["big ", "large ", "long "]),
                    _ => "",
                };
                template = match count {
                    Count::Exactly(1) => format!("[take] a {size}step"),
                    Count::Exactly(n) => format!("[take] {} {size}steps", number_word(n)),
                    Count::Many => {
                        let some =
                            self.pick(&["a few", "several", "some", "multiple", "a couple of"]);
                        format!("[take] {some} {size}steps")
                    }
                };
            } else {
                tail.push(self.count(count, steps));
            }
        }
        if template.contains("{limb}") {
            let limb = self.limb(action);
            template = template.replace("{limb}", &limb);
        } else if action.side.is_some() || action.body_part.is_some() {
            let limb = self.limb(action);
            let preposition = match (action.name, action.body_part) {
                ("balance" | "hop" | "kneel" | "turn", _) => "on",
                _ => self.pick(&["with", "with", "using"]),
            };
            // "Claps the hands with the hands" says nothing more.
            let noun = limb.rsplit(' ').next().unwrap_or_default();
            if action.side.is_some() || !template.contains(noun) {
                tail.push(format!("{preposition} {limb}"));
            }
        }
        if template.contains("{thing}") {
            let thing = self.thing();
            template = template.replace("{thing}", &thing);
        }
        let way = action
            .direction
            .map(|d| self.direction(d))
            .unwrap_or_default();
        let path = action.path.map(|p| self.path(p)).unwrap_or_default();
        let extent = match action.extent {
            Some(_) if template.contains(" step") => String::new(),
            Some(extent) => self.extent(action, extent, &mut template),
            None => String::new(),
        };
        let height = action.height.map(|h| self.height(h)).unwrap_or_default();
        let posture = action.posture.map(|p| self.posture(p)).unwrap_or_default();
        let duration = action
            .duration
            .map(|d| self.duration(d))
            .unwrap_or_default();
        let mut before = String::new();
        let adverbs = [
            action.tempo.map(|t| self.tempo(t)),
            action
                .manner
                .map(|m| self.pick(tables::adverbs(m.word())).to_string()),
        ];
        for adverb in adverbs.into_iter().flatten() {
            let is_word = !adverb.contains(' ') && adverb.ends_with("ly");
            if before.is_empty() && is_word && self.chance(0.5) {
                before = format!("{adverb} ");
            } else {
                tail.push(adverb);
            }
        }
        tail.extend([height, posture, duration]);
        // Attributes after the direction come in any order.
        for i in (1..tail.len()).rev() {
            let j = self.dice.below(i + 1);
            tail.swap(i, j);
        }
        let core = inflect(&template, form);
        let starts = form == Form::Third && before.is_empty() && self.chance(0.08);
        let core = match starts {
            true => match self.dice.below(4) {
                0 => format!("starts {}", inflect(&template, Form::Gerund)),
                1 => format!("begins to {}", inflect(&template, Form::Base)),
                2 => format!("begins {}", inflect(&template, Form::Gerund)),
                _ => format!("starts to {}", inflect(&template, Form::Base)),
            },
            false => core,
        };
        let mut out = format!("{before}{core}");
        let rest = [extent, way, path].into_iter().chain(tail);
        for piece in rest.filter(|piece| !piece.is_empty()) {
            out.push(' ');
            out.push_str(&piece);
        }
        if matches!(
            action.name,
            "walk" | "run" | "crawl" | "dance" | "circle" | "pace"
        ) && self.chance(0.06)
        {
            let place = self.pick(&[
                "in the room",
                "across the room",
                "on a stage",
                "in a hallway",
                "through a garden",
                "in a yard",
                "across a field",
                "on the beach",
                "in a kitchen",
                "in the gym",
                "along a corridor",
                "on grass",
                "in the studio",
                "around the house",
                "through a forest",
                "along the river",
                "in the park",
            ]);
            out.push(' ');
            out.push_str(place);
        }
        Some(out)
    }

    fn count(&mut self, count: Count, steps: bool) -> String {
        match count {
            Count::Exactly(n) if steps => match self.chance(0.5) {
                _ if n == 1 => "for one step".into(),
                true => format!("for {} steps", number_word(n)),
                false => format!("{} steps", number_word(n)),
            },
            Count::Exactly(1) => self.pick(&["once", "one time"]).into(),
            Count::Exactly(2) => self.pick(&["twice", "two times"]).into(),
            Count::Exactly(n) => format!("{} times", number_word(n)),
            Count::Many if steps => self
                .pick(&["for a few steps", "for several steps", "a few steps"])
                .into(),
            Count::Many => self
                .pick(&[
                    "several times",
                    "a few times",
                    "repeatedly",
                    "multiple times",
                    "over and over",
                    "many times",
                    "a couple of times",
                    "again and again",
                    "continuously",
                ])
                .into(),
        }
    }

    fn direction(&mut self, direction: Direction) -> String {
        let own = self.possessive();
        match direction {
            Direction::Forward => self
                .pick(&["forward", "forward", "forwards", "ahead"])
                .into(),
            Direction::Backward => self.pick(&["backward", "backwards", "in reverse"]).into(),
            Direction::Left if self.chance(0.15) => "counterclockwise".into(),
            Direction::Right if self.chance(0.15) => "clockwise".into(),
            Direction::Left => format!("{} {own} left", self.pick(&["to", "to", "towards"])),
            Direction::Right => format!("{} {own} right", self.pick(&["to", "to", "towards"])),
            Direction::Up => self.pick(&["upward", "upwards"]).into(),
            Direction::Down => self.pick(&["downward", "downwards"]).into(),
            Direction::Sideways => self.pick(&["sideways", "to the side", "laterally"]).into(),
        }
    }

    fn path(&mut self, path: Path) -> String {
        let words: &[&str] = match path {
            Path::Straight => &["in a straight line", "straight"],
            Path::Circle => &["in a circle", "in circles", "in a circular path"],
            Path::Curve => &["in a curve", "in an arc", "along a curved path"],
            Path::Zigzag => &["in a zigzag", "in a zig zag pattern", "in zigzags"],
            Path::BackAndForth => &[
                "back and forth",
                "from side to side",
                "up and down",
                "to and fro",
            ],
            Path::Diagonal => &["diagonally", "in a diagonal line"],
        };
        self.pick(words).into()
    }

    fn extent(&mut self, action: &Action, extent: Extent, template: &mut String) -> String {
        match (extent, action.name) {
            (Extent::Small, _) => self.pick(&["slightly", "a little bit", "a bit"]).into(),
            (Extent::Large, "squat" | "bow" | "crouch" | "lunge" | "bend") => "deeply".into(),
            (Extent::Large, "circle") => {
                *template = "[walk] in a large circle".into();
                String::new()
            }
            (Extent::Large, _) => "far".into(),
            (Extent::Degrees(n), "circle") => {
                *template = match n {
                    90 => "[walk] in a quarter circle".into(),
                    180 => "[walk] in a half circle".into(),
                    n => format!("[walk] {n} degrees in a circle"),
                };
                String::new()
            }
            (Extent::Degrees(180), _) if self.chance(0.5) => "around".into(),
            (Extent::Degrees(90), _) if self.chance(0.3) => {
                *template = "[make] a quarter turn".into();
                String::new()
            }
            (Extent::Degrees(360), _) if self.chance(0.5) => {
                *template = "[make] a full turn".into();
                String::new()
            }
            (Extent::Degrees(n), _) => format!("{n} degrees"),
        }
    }

    fn height(&mut self, height: Height) -> String {
        let own = self.possessive();
        match height {
            Height::Floor => self
                .pick(&[
                    "from the floor",
                    "to the ground",
                    "on the floor",
                    "off the ground",
                ])
                .into(),
            Height::Knee => format!("{} {own} knees", self.pick(&["to", "at"])),
            Height::Waist => format!("{} {own} waist", self.pick(&["to", "at"])),
            Height::Chest => format!("{} {own} chest", self.pick(&["to", "at", "in front of"])),
            Height::Shoulder => self
                .pick(&[
                    "at shoulder height",
                    "to shoulder level",
                    "to shoulder height",
                ])
                .into(),
            Height::Head => format!("to {own} {}", self.pick(&["head", "face"])),
            Height::Overhead => format!("{} {own} head", self.pick(&["above", "over"])),
            Height::High => "high".into(),
            Height::Low => "low".into(),
        }
    }

    fn posture(&mut self, posture: Posture) -> String {
        let own = self.possessive();
        match posture {
            Posture::Upright => "upright".into(),
            Posture::Stooped => self
                .pick(&["hunched over", "with a hunched back", "with a stooped back"])
                .into(),
            Posture::Crouched => "crouched".into(),
            Posture::Seated => "seated".into(),
            Posture::Kneeling => "kneeling".into(),
            Posture::Lying => "lying".into(),
            Posture::AllFours => self.pick(&["on all fours", "on hands and knees"]).into(),
            Posture::ArmsOut => format!(
                "with {own} arms {}",
                self.pick(&["out", "outstretched", "extended"])
            ),
            Posture::ArmsDown => format!(
                "with {own} {} at {own} sides",
                self.pick(&["arms", "hands"])
            ),
            Posture::ArmsUp => format!("with {own} arms raised"),
            Posture::LegsApart => format!("with {own} {} apart", self.pick(&["legs", "feet"])),
        }
    }

    fn tempo(&mut self, tempo: Tempo) -> String {
        match tempo {
            Tempo::Slow => self.pick(&["slowly", "slowly", "at a slow pace"]).into(),
            Tempo::Moderate => self
                .pick(&["at a normal pace", "at a moderate pace", "at a steady pace"])
                .into(),
            Tempo::Fast => self
                .pick(&[
                    "quickly",
                    "quickly",
                    "rapidly",
                    "fast",
                    "briskly",
                    "swiftly",
                    "hurriedly",
                    "hastily",
                    "at a fast pace",
                ])
                .into(),
            Tempo::PerMinute(60) => "about once a second".into(),
            Tempo::PerMinute(120) => "about twice a second".into(),
            Tempo::PerMinute(n) if n % 60 == 0 => {
                format!("about {} times a second", number_word(n / 60))
            }
            Tempo::PerMinute(n) => format!("about {} times a minute", number_word(n)),
        }
    }

    fn duration(&mut self, duration: Duration) -> String {
        match duration {
            Duration::Seconds(1) => "for one second".into(),
            Duration::Seconds(n) => format!("for {} seconds", number_word(n)),
            Duration::Short => self
                .pick(&[
                    "for a moment",
                    "briefly",
                    "for a few seconds",
                    "momentarily",
                    "for a brief moment",
                ])
                .into(),
            Duration::Long => self.pick(&["for a while", "for a long time"]).into(),
        }
    }
}
