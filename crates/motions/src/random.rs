//! Random requests for synthetic data sets.

use crate::dice::Dice;
use crate::parse;
use crate::request::{BuiltinRequest, Part, Segment};
use crate::spec::{KeyKind, KeySpec, MotionSpec, Posture, specs};
use crate::values::Values;

/// Maximum duration of a random request, s.
pub const LONGEST_S: f32 = 9.5;
/// Safety factor on the duration for the personal tempo (up to 7 %) and jitter.
const TEMPO_MARGIN: f32 = 1.07;
/// Share of single repeated motions that continue for the full length allowed for a request. People
/// exercise for longer than the input window of the model.
const GOES_ON: f32 = 0.25;
/// Motions of [`people_request`] alone.
const OF_PEOPLE: [&str; 3] = ["leg_raise", "pace", "walk_turn"];
/// Share of the motions of [`side_request`] that people repeat which are repeated for longer than a window.
const SIDES_GO_ON: f32 = 0.4;
/// Share of motions made once, and of pairs, with pauses before and after.
const PAUSED: f32 = 0.35;
/// Maximum number of draws before a plain walk is returned; in practice a tenth of them always
/// suffices.
const ATTEMPTS: u64 = 200;

/// Draws a request evenly from all motions. Three quarters are single motions, some of them
/// repeated until the time limit. One fifth are two motions in sequence, and the rest are gestures
/// combined with another motion. A request lasts at most [`LONGEST_S`]. The same seed gives the
/// same request.
pub fn random_request(rng_seed: u64) -> BuiltinRequest {
    let mut dice = Dice::new(rng_seed, "request");
    let kind = dice.range(0.0, 1.0);
    for _ in 0..ATTEMPTS {
        let text = match kind {
            k if k < 0.75 => single(Shares::Even, GOES_ON, &mut dice),
            k if k < 0.95 => sequence(Shares::Even, &mut dice),
            _ => overlay(&mut dice),
        };
        // Parsing the text checks seams, contradictions and ranges in one place.
        if let Some(request) = text.and_then(|t| parse(&t).ok())
            && request.nominal_duration_s() * TEMPO_MARGIN <= LONGEST_S
        {
            return request;
        }
    }
    let walk = Part {
        spec: &specs()[0],
        values: Values::of(&specs()[0]),
    };
    BuiltinRequest {
        segments: vec![Segment {
            base: walk,
            overlay: None,
        }],
        global: Values::global(),
    }
}

/// Draws a request with the pace and size of people's own motions, most of them repeated for longer than a window of the
/// model. [`random_request`] covers the library evenly instead.
///
/// 50 % are continuous ([`PeopleRequest::is_continuous`]), 20 % are short motions that people make once, without a pause
/// before and after, 13 % other single motions, 13 % sequences and 4 % gestures combined with other motions.
pub fn people_request(rng_seed: u64) -> PeopleRequest {
    let mut dice = Dice::new(rng_seed, "people");
    let kind = dice.range(0.0, 1.0);
    let is_continuous = kind < 0.5;
    let is_short = (0.5..0.7).contains(&kind);
    for _ in 0..ATTEMPTS {
        let text = match kind {
            _ if is_continuous => continuous(&mut dice),
            _ if is_short => once(1, &mut dice),
            k if k < 0.83 => {
                with_any_pace_and_size(single(Shares::Everyday, 0.0, &mut dice), &mut dice)
            }
            k if k < 0.96 => sequence(Shares::Everyday, &mut dice),
            _ => overlay(&mut dice),
        };
        let text = match is_continuous || is_short {
            true => text,
            false => text.and_then(|t| with_pauses(t, &mut dice)),
        };
        if let Some(request) = text.and_then(|t| PeopleRequest::that_fits(&t, is_continuous)) {
            return request;
        }
    }
    PeopleRequest::once(random_request(rng_seed))
}

/// Draws a short motion that people make once, such as raising a hand, a third of them with pauses before and after. Of
/// [`people_request`], a fifth are such motions, without pauses.
pub fn once_request(rng_seed: u64) -> BuiltinRequest {
    let mut dice = Dice::new(rng_seed, "once");
    let has_pauses = dice.chance(PAUSED);
    // Who moves a hand to and fro only once might as well raise it.
    first_that_fits(&mut dice, has_pauses, |dice| once(2, dice))
        .unwrap_or_else(|| random_request(rng_seed))
}

/// Draws two motions in sequence, as often as they occur in everyday life, a third of them with pauses before and after.
pub fn pair_request(rng_seed: u64) -> BuiltinRequest {
    let mut dice = Dice::new(rng_seed, "pair");
    let has_pauses = dice.chance(PAUSED);
    let sway = drawn_sway_m(&mut dice).map_or(String::new(), |m| format!("&sway_m={m:.3}"));
    first_that_fits(&mut dice, has_pauses, |dice| {
        Some(sequence(Shares::Everyday, dice)? + &sway)
    })
    .unwrap_or_else(|| random_request(rng_seed))
}

/// Draws one motion of a hand, an arm or a leg, or of both of them: every kind of motion and every side equally often, with
/// the pace and size of people's own motions, many of them repeated for longer than a window or with pauses before and
/// after.
pub fn side_request(rng_seed: u64) -> PeopleRequest {
    let mut dice = Dice::new(rng_seed, "side");
    let is_repeated = dice.chance(SIDES_GO_ON);
    let has_pauses = dice.chance(0.4);
    for _ in 0..ATTEMPTS {
        let Some((text, is_continuous)) = one_sided(is_repeated, &mut dice) else {
            continue;
        };
        let text = match has_pauses && !is_continuous {
            true => with_pauses(text, &mut dice),
            false => Some(text),
        };
        if let Some(request) = text.and_then(|t| PeopleRequest::that_fits(&t, is_continuous)) {
            return request;
        }
    }
    PeopleRequest::once(random_request(rng_seed))
}

/// A motion of one side or of both, and whether it is continuous.
fn one_sided(is_repeated: bool, dice: &mut Dice) -> Option<(String, bool)> {
    let sided: Vec<_> = specs().iter().filter(|s| s.key("side").is_some()).collect();
    let spec = (!sided.is_empty()).then(|| dice.pick(&sided))?;
    let mut own = keys(spec, true, dice);
    let is_continuous = is_repeated && REPEATED.iter().any(|(name, _)| *name == spec.name);
    if is_continuous {
        let [few, max] = MANY;
        let times = few + dice.index((max - few) as usize) as u32;
        set_key(&mut own, "repetitions", &times.to_string());
    }
    set_hold(spec, &mut own, 0.7, 1.5, dice);
    let mut all = globals(dice);
    if let Some(sway_m) = drawn_sway_m(dice) {
        all.push(("sway_m".to_owned(), format!("{sway_m:.3}")));
    }
    let text = format!("{}?{}", spec.name, query(&[own, all]));
    Some((with_any_pace_and_size(Some(text), dice)?, is_continuous))
}

/// The first drawn request that is valid and, with pauses before and after it if asked for, not longer than a window.
fn first_that_fits(
    dice: &mut Dice,
    has_pauses: bool,
    draw: impl Fn(&mut Dice) -> Option<String>,
) -> Option<BuiltinRequest> {
    (0..ATTEMPTS).find_map(|_| {
        let text = draw(dice)?;
        let text = match has_pauses {
            true => with_pauses(text, dice)?,
            false => text,
        };
        let request = parse(&text).ok()?;
        (request.nominal_duration_s() * TEMPO_MARGIN <= LONGEST_S).then_some(request)
    })
}

/// Sway of people who do not exercise, m: the pelvis of those who raise an arm moves at 0.01 to 0.12 m/s.
fn drawn_sway_m(dice: &mut Dice) -> Option<f32> {
    dice.chance(0.7).then(|| dice.log_range(0.004, 0.05))
}

/// A request of [`people_request`].
#[derive(Clone, Debug)]
pub struct PeopleRequest {
    /// The motion.
    pub request: BuiltinRequest,
    /// Whether it repeats one action for longer than any window, so that any part of it shows the action.
    pub is_continuous: bool,
}

impl PeopleRequest {
    /// A motion that is not continuous.
    fn once(request: BuiltinRequest) -> Self {
        Self {
            request,
            is_continuous: false,
        }
    }

    /// The motion of a text; `None` if it is not valid, or longer than a window and not continuous.
    fn that_fits(text: &str, is_continuous: bool) -> Option<Self> {
        let request = parse(text).ok()?;
        let fits = request.nominal_duration_s() * TEMPO_MARGIN <= LONGEST_S;
        (is_continuous || fits).then_some(Self {
            request,
            is_continuous,
        })
    }
}

/// Repetitions of a continuous motion. Captions count to twelve and say "many times" above.
const MANY: [u32; 2] = [14, 24];

/// Motions that people repeat continuously: exercise, locomotion in place, gestures. People do not bow or throw
/// continuously. The number is how often each is drawn: exercises that most people know are more frequent than others.
///
/// Walking and running have no repetitions: any part of a long way shows them.
const REPEATED: [(&str, f32); 20] = [
    ("arm_circles", 1.0),
    ("circle", 1.0),
    ("clap", 1.0),
    ("hop", 0.6),
    ("jog_in_place", 1.0),
    ("jump", 1.5),
    ("jumping_jack", 1.8),
    ("kick", 0.8),
    ("leg_raise", 0.8),
    ("lunge", 0.9),
    ("march", 1.0),
    ("pace", 1.2),
    ("punch", 1.5),
    ("raise_arms", 1.4),
    ("run", 0.7),
    ("side_bend", 1.0),
    ("squat", 1.8),
    ("twist", 0.8),
    ("walk", 2.0),
    ("wave", 1.4),
];

fn continuous(dice: &mut Dice) -> Option<String> {
    let (spec, mut own) = drawn(&REPEATED, dice)?;
    own.retain(|(k, _)| k != "repetitions" && k != "distance_m");
    let is_sideways = own
        .iter()
        .any(|(k, v)| k == "direction" && (v == "left" || v == "right"));
    let mut set = |key: &str, value: &str| set_key(&mut own, key, value);
    // Who jumps again and again stays in place and hardly swings the arms; who boxes uses both hands.
    match spec.name {
        "jump" => {
            set("direction", "up");
            if dice.chance(0.85) {
                set("arms", "still");
                set("lean_deg", &format!("{:.0}", dice.range(0.0, 7.0)));
            } else {
                set("arms", "swinging");
            }
        }
        "hop" => set("direction", "up"),
        "squat" => {
            if dice.chance(0.7) {
                set("arms", "still");
            }
            set("lean_deg", &format!("{:.0}", dice.range(2.0, 40.0)));
        }
        "lunge" if is_sideways && dice.chance(0.4) => set("feet", "in_place"),
        // As far as a room is long.
        "walk" | "run" => set("distance_m", &format!("{:.1}", dice.range(3.5, 7.0))),
        // People exercise with their feet apart, and lower and raise the body only.
        // Without a step, a lunge backward is a lunge forward with the other leg.
        "lunge" if !is_sideways && dice.chance(0.6) => {
            set("feet", "in_place");
            set("direction", "forward");
        }
        "punch" => {
            if dice.chance(0.8) {
                set("side", "both");
            }
            set("lean_deg", &format!("{:.0}", dice.range(0.0, 22.0)));
            set("aim_deg", &format!("{:.0}", dice.range(-30.0, 8.0)));
            set("stance_m", &format!("{:.2}", dice.range(0.1, 0.6)));
            set("pause_s", &format!("{:.2}", dice.range(0.0, 1.2)));
        }
        _ => {}
    }
    set_hold(spec, &mut own, 0.5, 1.0, dice);
    if spec.key("repetitions").is_some() {
        let [few, max] = MANY;
        let times = few + dice.index((max - few) as usize) as u32;
        set_key(&mut own, "repetitions", &times.to_string());
    }
    let mut all = globals(dice);
    // Those who move their arms or one leg stand firmly.
    let (share, max_m) = match spec.name {
        "arm_circles" | "clap" | "leg_raise" | "lunge" | "raise_arms" | "side_bend" | "wave" => {
            (0.4, 0.02)
        }
        _ => (0.7, 0.06),
    };
    if dice.chance(share) {
        let sway_m = dice.range(0.005, max_m);
        all.push(("sway_m".to_owned(), format!("{sway_m:.3}")));
    }
    // Who boxes moves to and fro; others wander a little while they repeat a motion on the spot.
    let (share, max_m) = match spec.name {
        "punch" => (0.8, 0.4),
        "circle" | "march" | "pace" | "run" | "walk" => (0.0, 0.0),
        _ => (0.2, 0.1),
    };
    if dice.chance(share) {
        let wander_m = dice.range(0.02, max_m);
        all.push(("wander_m".to_owned(), format!("{wander_m:.3}")));
    }
    let text = format!("{}?{}", spec.name, query(&[own, all]));
    with_any_pace_and_size(Some(text), dice)
}

/// Motions that take a few seconds and are made once, and how often each is drawn.
const ONCE: [(&str, f32); 15] = [
    ("answer_phone", 0.4),
    ("bow", 0.6),
    ("clap", 0.6),
    ("drink", 0.6),
    ("fall", 0.6),
    ("knock", 0.6),
    ("pick_up", 0.6),
    ("point", 0.6),
    ("raise_arms", 5.0),
    ("salute", 0.6),
    ("sit_down", 0.6),
    ("stand_up", 0.6),
    ("turn", 1.0),
    ("walk_turn", 4.0),
    ("wave", 2.5),
];

/// A short motion from its beginning to its end; who waves moves the hand to and fro at least `fewest_waves` times.
fn once(fewest_waves: usize, dice: &mut Dice) -> Option<String> {
    let (spec, mut own) = drawn(&ONCE, dice)?;
    let few = |(k, v): &(String, String)| {
        k == "repetitions" && v.parse().is_ok_and(|n: usize| n < fewest_waves)
    };
    if spec.name == "wave" && own.iter().any(few) {
        let times = fewest_waves + dice.index(4);
        set_key(&mut own, "repetitions", &times.to_string());
    }
    if spec.name == "raise_arms" {
        let times = if dice.chance(0.8) {
            1
        } else {
            2 + dice.index(2)
        };
        set_key(&mut own, "repetitions", &times.to_string());
        let style = dice.pick(&[
            "hand", "hand", "hand", "overhead", "overhead", "forward", "sideways",
        ]);
        set_key(&mut own, "style", style);
    }
    set_hold(spec, &mut own, 0.9, 2.2, dice);
    let mut all = globals(dice);
    if let Some(sway_m) = drawn_sway_m(dice) {
        all.push(("sway_m".to_owned(), format!("{sway_m:.3}")));
    }
    let text = format!("{}?{}", spec.name, query(&[own, all]));
    with_any_pace_and_size(Some(text), dice)
}

/// A motion of a table of names and shares, with its drawn keys.
fn drawn(
    table: &[(&'static str, f32)],
    dice: &mut Dice,
) -> Option<(&'static MotionSpec, Vec<(String, String)>)> {
    let (name, _) = dice.weighted(table, |(_, share)| *share)?;
    let spec = by_name(name)?;
    Some((spec, keys(spec, true, dice)))
}

/// Sets a key, in place of its drawn value if it has one.
fn set_key(own: &mut Vec<(String, String)>, key: &str, value: &str) {
    own.retain(|(k, _)| k != key);
    own.push((key.to_owned(), value.to_owned()));
}

/// People hold up what they raised as long as they like.
fn set_hold(
    spec: &MotionSpec,
    own: &mut Vec<(String, String)>,
    share: f32,
    longest_s: f32,
    dice: &mut Dice,
) {
    if spec.key("hold_s").is_some() && dice.chance(share) {
        let hold_s = dice.range(0.0, longest_s);
        set_key(own, "hold_s", &format!("{hold_s:.2}"));
    }
}

/// Adds pauses before and after a motion that is not continuous: a window shows what is in it from any moment on.
fn with_pauses(text: String, dice: &mut Dice) -> Option<String> {
    let free_s = LONGEST_S - parse(&text).ok()?.nominal_duration_s() * TEMPO_MARGIN;
    if free_s < 0.5 || dice.chance(0.3) {
        return Some(text);
    }
    let pauses_s = dice.range(0.0, 0.98 * free_s) / TEMPO_MARGIN;
    let before_s = dice.range(0.0, pauses_s);
    let after_s = pauses_s - before_s;
    Some(format!(
        "{text}&before_s={before_s:.2}&after_s={after_s:.2}"
    ))
}

/// Replaces speed and amplitude of a single motion by values of continuous distributions.
fn with_any_pace_and_size(text: Option<String>, dice: &mut Dice) -> Option<String> {
    let text = text?;
    let (name, query) = text.split_once('?')?;
    let spec = by_name(name)?;
    let mut values: Vec<(String, String)> = query
        .split('&')
        .filter_map(|pair| pair.split_once('='))
        .map(|(k, v)| (k.to_owned(), v.to_owned()))
        .filter(|(k, _)| k != "speed" && k != "amplitude")
        .collect();
    if spec.key("speed").is_some() {
        // Jumps with still arms rebound at 1.3 to 2.2 Hz.
        let [low, high]: [f32; 2] = match name {
            "jump" => [1.0, 2.0],
            "punch" => [0.8, 2.0],
            "leg_raise" => [0.5, 1.5],
            "lunge" => [0.45, 1.4],
            // An arm is up within 0.3 to 2.1 s.
            "raise_arms" => [0.4, 2.6],
            // Running is faster than walking.
            "run" => [0.75, 1.7],
            "walk" | "walk_turn" | "pace" => [0.45, 1.6],
            "wave" => [0.35, 1.8],
            "arm_circles" | "side_bend" | "twist" => [0.45, 1.6],
            _ => [0.55, 1.9],
        };
        let speed = dice.log_range(low, high);
        values.push(("speed".to_owned(), format!("{speed:.2}")));
    }
    if spec.key("amplitude").is_some() && dice.chance(0.7) {
        let amplitude = dice.range(0.5, 1.3);
        values.push(("amplitude".to_owned(), format!("{amplitude:.2}")));
    }
    let pairs: Vec<String> = values.iter().map(|(k, v)| format!("{k}={v}")).collect();
    Some(format!("{name}?{}", pairs.join("&")))
}

/// How often each motion is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Shares {
    /// All motions equally often.
    Even,
    /// As in everyday life: [`everyday`].
    Everyday,
}

/// How much more often than others a motion occurs in everyday life.
fn everyday(name: &str) -> f32 {
    match name {
        "walk" => 5.0,
        "walk_turn" => 4.0,
        "raise_arms" | "wave" => 3.0,
        "pick_up" | "run" | "sit_down" | "stand_up" | "turn" => 2.0,
        "fall" => 1.5,
        "toe_touch" => 0.6,
        "limp" => 0.3,
        _ => 1.0,
    }
}

fn single(shares: Shares, goes_on: f32, dice: &mut Dice) -> Option<String> {
    let spec = any(shares, dice, |_| true)?;
    let mut own = keys(spec, true, dice);
    let global = globals(dice);
    let text = |own: Vec<_>| format!("{}?{}", spec.name, query(&[own, global.clone()]));
    if spec.key("repetitions").is_none() || !dice.chance(goes_on) {
        return Some(text(own));
    }
    own.retain(|(k, _)| k != "repetitions");
    let with = |n: u32| {
        let times = ("repetitions".to_owned(), n.to_string());
        text(own.iter().cloned().chain([times]).collect())
    };
    let long_s = |n: u32| Some(parse(&with(n)).ok()?.nominal_duration_s());
    let (two_s, four_s) = (long_s(2)?, long_s(4)?);
    let more = 2.0 * (LONGEST_S / TEMPO_MARGIN - two_s) / (four_s - two_s).max(0.1);
    Some(with(2 + more.max(0.0) as u32))
}

fn sequence(shares: Shares, dice: &mut Dice) -> Option<String> {
    let standing = |s: &MotionSpec| s.starts == Posture::Standing;
    // Stand-up motions need a preceding seated or lying posture, so these pairs get a share of
    // their own.
    let (first, second) = match dice.index(12) {
        0 => (by_name("sit_down")?, by_name("stand_up")?),
        1 => (by_name("stand_up")?, any(shares, dice, standing)?),
        2 => (by_name("lie_down")?, by_name("stand_up")?),
        3 => (by_name("fall")?, by_name("stand_up")?),
        _ => (any(shares, dice, standing)?, any(shares, dice, standing)?),
    };
    if first.name == second.name {
        return None;
    }
    let named = |spec: &'static MotionSpec, dice: &mut Dice| {
        keys(spec, false, dice)
            .iter()
            .map(|(k, v)| (format!("{}.{k}", spec.name), v.clone()))
            .collect()
    };
    let (a, mut b): (Vec<_>, Vec<_>) = (named(first, dice), named(second, dice));
    b.retain(|(k, _)| k != "stand_up.from");
    Some(format!(
        "{}+then+{}?{}",
        first.name,
        second.name,
        query(&[a, b, globals(dice)])
    ))
}

fn overlay(dice: &mut Dice) -> Option<String> {
    let base = any(Shares::Even, dice, |s| s.carries)?;
    let gesture = any(Shares::Even, dice, |s| s.overlays)?;
    let named = |spec: &'static MotionSpec, dice: &mut Dice| {
        keys(spec, false, dice)
            .iter()
            .map(|(k, v)| (format!("{}.{k}", spec.name), v.clone()))
            .collect()
    };
    let (a, b): (Vec<_>, Vec<_>) = (named(base, dice), named(gesture, dice));
    let text = format!(
        "{}+while+{}?{}",
        base.name,
        gesture.name,
        query(&[a, b, globals(dice)])
    );
    // Both parts must have about the same duration for the word "while" to be true.
    let request = parse(&text).ok()?;
    let alone = |part: &Part| {
        let lone = BuiltinRequest {
            segments: vec![Segment {
                base: part.clone(),
                overlay: None,
            }],
            global: request.global.clone(),
        };
        lone.nominal_duration_s()
    };
    let segment = request.segments.first()?;
    let ratio = alone(segment.overlay.as_ref()?) / alone(&segment.base);
    (0.45..=1.05).contains(&ratio).then_some(text)
}

fn any(
    shares: Shares,
    dice: &mut Dice,
    fits: impl Fn(&MotionSpec) -> bool,
) -> Option<&'static MotionSpec> {
    let is_allowed =
        |s: &&MotionSpec| (shares == Shares::Everyday || !OF_PEOPLE.contains(&s.name)) && fits(s);
    let candidates: Vec<&'static MotionSpec> = specs().iter().filter(is_allowed).collect();
    match shares {
        Shares::Even => (!candidates.is_empty()).then(|| dice.pick(&candidates)),
        Shares::Everyday => dice.weighted(&candidates, |s| everyday(s.name)),
    }
}

fn by_name(name: &str) -> Option<&'static MotionSpec> {
    crate::spec::spec(name)
}

fn keys(spec: &'static MotionSpec, single: bool, dice: &mut Dice) -> Vec<(String, String)> {
    let mut out = Vec::new();
    for key in spec.keys {
        if let Some(value) = draw(spec, key, single, dice) {
            out.push((key.name.to_owned(), value));
        }
    }
    let sideways = out
        .iter()
        .any(|(k, v)| k == "direction" && (v == "left" || v == "right"));
    if sideways && matches!(spec.name, "kick" | "lunge") {
        out.retain(|(k, _)| k != "side");
    }
    out
}

fn draw(spec: &MotionSpec, key: &KeySpec, single: bool, dice: &mut Dice) -> Option<String> {
    let number = |x: f32| Some(format!("{:.2}", x));
    match (spec.name, key.name, key.kind) {
        // Set by `people_request` only.
        ("lunge", "feet", _) => None,
        (_, "posture", _) => dice.chance(0.15).then(|| "stooped".to_owned()),
        (_, _, KeyKind::Word { allowed, .. }) => Some(dice.pick(allowed).to_owned()),
        // Drawn by `people_request` only.
        ("jump", _, KeyKind::Speed) => None,
        ("run", _, KeyKind::Speed) => match dice.index(4) {
            0 => number(dice.range(0.75, 0.8)),
            1 => number(dice.range(1.35, 1.6)),
            _ => number(dice.range(0.9, 1.1)),
        },
        (_, _, KeyKind::Speed) => match dice.index(4) {
            0 => number(dice.range(0.6, 0.75)),
            1 => number(dice.range(1.35, 1.6)),
            _ => number(dice.range(0.9, 1.1)),
        },
        (_, "amplitude", _) => match dice.index(10) {
            0 | 1 => number(dice.range(0.6, 0.75)),
            2..=4 => number(dice.range(1.2, 1.35)),
            _ => None,
        },
        ("jog_in_place", "repetitions", _) => Some((8 + dice.index(9)).to_string()),
        ("march", "repetitions", _) => Some((4 + dice.index(7)).to_string()),
        ("circle", "repetitions", _) => dice.chance(0.15).then(|| "2".to_owned()),
        (_, "repetitions", KeyKind::Count { default, .. }) => {
            let max = if single {
                2 * default.max(2)
            } else {
                default.max(2)
            } as usize;
            Some((1 + dice.index(max)).to_string())
        }
        ("walk", "distance_m", _) => number(dice.range(1.2, if single { 4.0 } else { 2.5 })),
        ("run", "distance_m", _) => number(dice.range(2.0, 5.0)),
        ("side_step", "distance_m", _) => number(dice.range(0.7, 2.0)),
        ("limp", "distance_m", _) => number(dice.range(1.2, 2.6)),
        ("march", "distance_m", _) => dice
            .chance(0.35)
            .then(|| format!("{:.2}", dice.range(1.2, 2.5))),
        ("turn", "angle_deg", _) => Some(dice.pick(&["90", "180", "180", "270", "360"]).to_owned()),
        ("pace", "distance_m", _) => number(dice.range(0.6, 3.0)),
        ("walk_turn", "distance_m", _) => number(dice.range(2.0, if single { 7.0 } else { 3.0 })),
        ("walk_turn", "angle_deg", _) => number(dice.range(50.0, 180.0)),
        ("circle", "radius_m", _) => number(dice.range(0.45, 1.2)),
        ("stand_still" | "sit_still", "duration_s", _) => {
            number(dice.range(2.0, if single { 6.0 } else { 4.0 }))
        }
        _ => None,
    }
}

fn globals(dice: &mut Dice) -> Vec<(String, String)> {
    let height_m = (1.71 + 0.3 * dice.bell()).clamp(1.45, 2.0);
    let heading = match dice.chance(0.9) {
        true => dice.range(-40.0, 40.0),
        false => dice.range(-180.0, 180.0),
    };
    let build = dice.pick(&["slim", "average", "average", "heavy"]);
    vec![
        ("height_m".to_owned(), format!("{height_m:.2}")),
        ("build".to_owned(), build.to_owned()),
        ("heading_deg".to_owned(), format!("{heading:.1}")),
    ]
}

fn query(groups: &[Vec<(String, String)>]) -> String {
    groups
        .iter()
        .flatten()
        .map(|(k, v)| format!("{k}={v}"))
        .collect::<Vec<_>>()
        .join("&")
}
