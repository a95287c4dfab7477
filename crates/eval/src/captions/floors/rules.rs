//! Facts of a clip that rules measure: ways over the floor, heights, and where the fast points are.
//!
//! The thresholds were chosen on training clips of the motion library, before the reference radar, by the actions that
//! their labels name. Nothing is learned when the rules are applied.

use std::f32::consts::{PI, TAU};

use radarllm_base::{PointFrame, RadarPoint, stats::quantile_linear};
use radarllm_facts::{Action, Count, Direction, Facts, Side, Subject, Tempo};

/// Radar frames of a step: 0.4 s.
const FRAMES_PER_STEP: usize = 4;
const STEP_S: f32 = 0.4;

/// Faster than this, the middle of the points is walking, m/s.
const WALKING_MPS: f32 = 0.4;
/// Faster than this, it is running, m/s.
const RUNNING_MPS: f32 = 1.4;
/// Slower than this, walking is slow, m/s.
const SLOW_MPS: f32 = 0.68;
/// Faster than this, walking is fast, m/s.
const FAST_WALKING_MPS: f32 = 1.1;
/// Steps that walking lasts.
const MIN_WALKING_STEPS: usize = 3;
/// Steps that anything beside walking lasts.
const MIN_STILL_STEPS: usize = 4;
/// Shorter ways are swaying, m.
const MIN_WAY_M: f32 = 0.8;
/// Ways that lead back are longer than this, m.
const MIN_RETURN_M: f32 = 2.2;
/// Share of a way by which it has to move on, for it not to lead back.
const RETURN_SHARE: f32 = 0.4;
/// Ratio of the variances along and across a way that leads back, above which it is a circle.
const CIRCLE_RATIO: f32 = 0.12;
/// Change of heading that is a turn, rad.
const TURN_RAD: f32 = 0.6;

/// Height of the top of somebody who lies, m.
const LYING_M: f32 = 0.78;
/// Height of the top of somebody who has stood up again, m.
const RISEN_M: f32 = 1.0;
/// Faster than this, the top of somebody who gets to the floor falls, m/s.
const FALL_MPS: f32 = 0.55;

/// Points that are faster than this belong to limbs, m/s.
const FAST_MPS: f32 = 0.5;
/// Points that are slower than this do not move, m/s.
const MOVING_MPS: f32 = 0.15;
/// Fast points above this height are arms, m.
const ARM_M: f32 = 1.2;
/// Fast points below this height are legs, m.
const LEG_M: f32 = 0.7;

/// The facts of a clip, in order of time. A person is taken to face the radar.
///
/// # Shapes
/// - `frames`: `[frame]`, 10 per second, points in the radar frame
/// - `radar_height_m`: height of the radar above the floor, m
pub(super) fn measured(frames: &[PointFrame], radar_height_m: f32) -> Facts {
    let steps = steps(frames, radar_height_m);
    let lies = |step: &Step| step.top_m < LYING_M;
    let mut actions = Vec::new();
    match (steps.iter().position(lies), steps.iter().rposition(lies)) {
        (Some(first), Some(last)) => {
            if first > 1 {
                // Where the way down begins.
                let begin = (0..first)
                    .rev()
                    .find(|i| *i == 0 || steps[i - 1].top_m <= steps[*i].top_m + 0.02)
                    .unwrap_or_default();
                if begin > 6 {
                    actions = upright(frames, radar_height_m, &steps[..begin]);
                }
                let seconds = (first - begin) as f32 * STEP_S;
                let speed_mps = (steps[begin].top_m - steps[first].top_m) / seconds.max(STEP_S);
                actions.push(Action::named(match speed_mps > FALL_MPS {
                    true => "fall",
                    false => "lie_down",
                }));
            }
            let ends_high = steps.last().is_some_and(|step| step.top_m > RISEN_M);
            if last + 2 < steps.len() && ends_high {
                actions.push(Action::named("stand_up"));
            }
        }
        _ => actions = upright(frames, radar_height_m, &steps),
    }
    if actions.len() > 1 {
        actions.retain(|action| action.name != "stand");
    }
    if actions.is_empty() {
        actions.push(Action::named("stand"));
    }
    Facts {
        subject: Some(Subject::Person),
        stretches: actions.into_iter().map(|action| vec![action]).collect(),
    }
}

/// What 0.4 s show, smoothed over 1.2 s.
#[derive(Clone, Copy)]
struct Step {
    /// Median of the points, m.
    x_m: f32,
    y_m: f32,
    /// 90 % quantile of the heights above the floor, m.
    top_m: f32,
    /// Index of its first frame.
    frame: usize,
}

impl Step {
    fn distance_m(&self, other: &Self) -> f32 {
        (self.x_m - other.x_m).hypot(self.y_m - other.y_m)
    }
}

/// The steps that have points.
fn steps(frames: &[PointFrame], radar_height_m: f32) -> Vec<Step> {
    let of_step = |(n, frames): (usize, &[PointFrame])| {
        let points: Vec<&RadarPoint> = frames.iter().flat_map(|f| &f.points).collect();
        Some(Step {
            x_m: quantile(points.iter().map(|p| p.x_m), 0.5)?,
            y_m: quantile(points.iter().map(|p| p.y_m), 0.5)?,
            top_m: quantile(points.iter().map(|p| p.z_m + radar_height_m), 0.9)?,
            frame: n * FRAMES_PER_STEP,
        })
    };
    let raw: Vec<Step> = frames
        .chunks(FRAMES_PER_STEP)
        .enumerate()
        .filter_map(of_step)
        .collect();
    (0..raw.len())
        .map(|i| {
            let near = &raw[i.saturating_sub(1)..(i + 2).min(raw.len())];
            let mean = |of: fn(&Step) -> f32| near.iter().map(of).sum::<f32>() / near.len() as f32;
            Step {
                x_m: mean(|s| s.x_m),
                y_m: mean(|s| s.y_m),
                top_m: mean(|s| s.top_m),
                frame: raw[i].frame,
            }
        })
        .collect()
}

fn quantile(values: impl Iterator<Item = f32>, share: f64) -> Option<f32> {
    let mut values: Vec<f64> = values.map(f64::from).collect();
    values.sort_unstable_by(f64::total_cmp);
    quantile_linear(&values, share).map(|v| v as f32)
}

/// A stretch of steps, `first..=last`.
#[derive(Clone, Copy)]
struct Stretch {
    first: usize,
    last: usize,
    walks: bool,
}

impl Stretch {
    fn len(&self) -> usize {
        self.last - self.first
    }
}

/// Stretches of walking and of staying, in turns; what is too short for either belongs to what is before it, or after it at
/// the start.
fn stretches(steps: &[Step]) -> Vec<Stretch> {
    let walks: Vec<bool> = steps
        .windows(2)
        .map(|w| w[1].distance_m(&w[0]) > WALKING_MPS * STEP_S)
        .collect();
    let mut all: Vec<Stretch> = Vec::new();
    for run in walks.chunk_by(|a, b| a == b) {
        let first = all.last().map_or(0, |s: &Stretch| s.last);
        let next = Stretch {
            first,
            last: first + run.len(),
            walks: run[0] && run.len() >= MIN_WALKING_STEPS,
        };
        match all.last_mut() {
            Some(before)
                if before.walks == next.walks || !next.walks && next.len() < MIN_STILL_STEPS =>
            {
                before.last = next.last;
            }
            Some(before) if next.walks && before.len() < MIN_STILL_STEPS => {
                before.last = next.last;
                before.walks = true;
            }
            _ => all.push(next),
        }
    }
    let mut merged: Vec<Stretch> = Vec::new();
    for next in all {
        match merged.last_mut() {
            Some(before) if before.walks == next.walks => before.last = next.last,
            _ => merged.push(next),
        }
    }
    merged
}

/// The actions of somebody who does not lie.
fn upright(frames: &[PointFrame], radar_height_m: f32, steps: &[Step]) -> Vec<Action> {
    let all = stretches(steps);
    let mut actions: Vec<Action> = Vec::new();
    for stretch in &all {
        let own = &steps[stretch.first..=stretch.last];
        let way = stretch.walks.then(|| way(own)).flatten();
        let found = way.unwrap_or_else(|| {
            let last = (own[own.len() - 1].frame + FRAMES_PER_STEP).min(frames.len());
            in_place(&frames[own[0].frame..last], radar_height_m, own)
        });
        for action in found {
            let rests = action.name == "stand" && all.len() > 1;
            if !rests && actions.last().map(|a| a.name) != Some(action.name) {
                actions.push(action);
            }
        }
    }
    actions
}

fn length_m(steps: &[Step]) -> f32 {
    steps.windows(2).map(|w| w[1].distance_m(&w[0])).sum()
}

/// A way of the middle of the points over the floor; `None` if it is too short.
fn way(steps: &[Step]) -> Option<Vec<Action>> {
    let (first, last) = (steps.first()?, steps.last()?);
    let length_m = length_m(steps);
    if length_m < MIN_WAY_M || steps.len() < 3 {
        return None;
    }
    // The median, because smoothing shortens the first and the last step.
    let speeds = steps.windows(2).map(|w| w[1].distance_m(&w[0]) / STEP_S);
    let speed_mps = quantile(speeds, 0.5)?;
    let tempo = match speed_mps {
        v if v < SLOW_MPS => Some(Tempo::Slow),
        v if (FAST_WALKING_MPS..RUNNING_MPS).contains(&v) => Some(Tempo::Fast),
        _ => None,
    };
    let edge = (steps.len() / 4).clamp(2, steps.len() - 1);
    let heading = |a: &Step, b: &Step| (b.y_m - a.y_m).atan2(b.x_m - a.x_m);
    let begin = heading(first, &steps[edge]);
    let end = heading(&steps[steps.len() - 1 - edge], last);
    // Counter-clockwise seen from above, which is to the left of whoever walks forward.
    let turned = (end - begin + PI).rem_euclid(TAU) - PI;

    if first.distance_m(last) < RETURN_SHARE * length_m && length_m > MIN_RETURN_M {
        let is_round = roundness(steps) > CIRCLE_RATIO;
        let mut action = Action::named(if is_round { "circle" } else { "pace" });
        action.tempo = tempo;
        action.direction = is_round.then(|| match signed_area_m2(steps) > 0.0 {
            true => Direction::Left,
            false => Direction::Right,
        });
        return Some(vec![action]);
    }
    let mut action = Action::named(match speed_mps > RUNNING_MPS {
        true => "run",
        false => "walk",
    });
    action.tempo = tempo;
    let comes = steps[edge].y_m < first.y_m;
    action.direction = (action.name == "walk").then_some(match comes {
        true => Direction::Forward,
        false => Direction::Backward,
    });
    if action.name == "run" || turned.abs() < TURN_RAD {
        return Some(vec![action]);
    }
    // Nobody turns at the end of a way backward: it was a way forward, away from the radar.
    action.direction = Some(Direction::Forward);
    let mut turn = Action::named("turn");
    turn.direction = Some(match turned > 0.0 {
        true => Direction::Left,
        false => Direction::Right,
    });
    Some(vec![action, turn])
}

/// Ratio of the smaller to the larger principal variance of the places.
fn roundness(steps: &[Step]) -> f32 {
    let n = steps.len().max(1) as f32;
    let mean = |of: &dyn Fn(&Step) -> f32| steps.iter().map(of).sum::<f32>() / n;
    let (x, y) = (mean(&|s| s.x_m), mean(&|s| s.y_m));
    let xx = mean(&|s| (s.x_m - x).powi(2));
    let yy = mean(&|s| (s.y_m - y).powi(2));
    let xy = mean(&|s| (s.x_m - x) * (s.y_m - y));
    let (middle, radius) = (0.5 * (xx + yy), (0.25 * (xx - yy).powi(2) + xy * xy).sqrt());
    (middle - radius) / (middle + radius).max(f32::MIN_POSITIVE)
}

/// The area that a way encloses; positive counter-clockwise, seen from above.
fn signed_area_m2(steps: &[Step]) -> f32 {
    let from = |s: &Step| (s.x_m - steps[0].x_m, s.y_m - steps[0].y_m);
    let cross = |w: &[Step]| {
        let ((ax, ay), (bx, by)) = (from(&w[0]), from(&w[1]));
        0.5 * (ax * by - bx * ay)
    };
    steps.windows(2).map(cross).sum()
}

/// What the points of a stretch show.
struct Profile {
    /// Share of points that are fast, and of points that move, 0..=1.
    fast: f32,
    moving: f32,
    /// Shares of the fast points that are high and low, 0..=1.
    high: f32,
    low: f32,
    /// Median height of the points, and of the fast ones, m.
    middle_m: f32,
    fast_m: f32,
    /// 95 % quantile of the absolute radial velocities, m/s.
    top_speed_mps: f32,
    /// Standard deviation of the places along x, m.
    width_m: f32,
    /// Share of the fast points that are at the left of somebody who faces the radar, 0..=1.
    left: f32,
}

impl Profile {
    fn of(frames: &[PointFrame], radar_height_m: f32) -> Option<Self> {
        let points: Vec<&RadarPoint> = frames.iter().flat_map(|f| &f.points).collect();
        let height = |p: &RadarPoint| p.z_m + radar_height_m;
        let fast: Vec<&RadarPoint> = points
            .iter()
            .copied()
            .filter(|p| p.velocity_mps.abs() > FAST_MPS)
            .collect();
        let share = |n: usize, of: usize| n as f32 / of.max(1) as f32;
        let centre_m = quantile(points.iter().map(|p| p.x_m), 0.5)?;
        let mean = points.iter().map(|p| p.x_m).sum::<f32>() / points.len() as f32;
        let variance = points.iter().map(|p| (p.x_m - mean).powi(2)).sum::<f32>();
        let of_fast = |test: &dyn Fn(&RadarPoint) -> bool| {
            share(fast.iter().filter(|p| test(p)).count(), fast.len())
        };
        let moves = |p: &&&RadarPoint| p.velocity_mps.abs() > MOVING_MPS;
        Some(Self {
            fast: share(fast.len(), points.len()),
            moving: share(points.iter().filter(moves).count(), points.len()),
            high: of_fast(&|p| height(p) > ARM_M),
            low: of_fast(&|p| height(p) < LEG_M),
            middle_m: quantile(points.iter().map(|p| height(p)), 0.5)?,
            fast_m: quantile(fast.iter().map(|p| height(p)), 0.5).unwrap_or_default(),
            top_speed_mps: quantile(points.iter().map(|p| p.velocity_mps.abs()), 0.95)?,
            width_m: (variance / points.len() as f32).sqrt(),
            left: of_fast(&|p| p.x_m > centre_m),
        })
    }
}

/// What somebody does who stays in one place.
fn in_place(frames: &[PointFrame], radar_height_m: f32, steps: &[Step]) -> Vec<Action> {
    let (Some(first), Some(last)) = (steps.first(), steps.last()) else {
        return Vec::new();
    };
    let edge = steps.len().min(2);
    let top = |steps: &[Step]| steps.iter().map(|s| s.top_m).sum::<f32>() / edge as f32;
    let (before_m, after_m) = (top(&steps[..edge]), top(&steps[steps.len() - edge..]));
    let lowest_m = steps.iter().map(|s| s.top_m).fold(f32::MAX, f32::min);
    let dip_m = before_m.min(after_m) - lowest_m;
    let way_m = steps
        .iter()
        .map(|s| s.distance_m(first))
        .fold(0.0, f32::max);
    // A seat is behind the place where one stands.
    if first.distance_m(last) > 0.22 && (after_m - before_m).abs() > 0.04 {
        return vec![Action::named(match after_m > before_m {
            true => "stand_up",
            false => "sit_down",
        })];
    }
    if way_m > 0.25 && dip_m > 0.1 {
        return vec![Action::named("sit_down"), Action::named("stand_up")];
    }
    if dip_m > 0.22 {
        return vec![Action::named("pick_up")];
    }
    let Some(profile) = Profile::of(frames, radar_height_m) else {
        return Vec::new();
    };
    let name = limbs(&profile, steps);
    let mut action = Action::named(name);
    let is_of_arms = matches!(name, "raise_arms" | "wave" | "arm_circles" | "punch");
    if is_of_arms || matches!(name, "kick" | "leg_raise" | "hop" | "side_bend") {
        action.side = match profile.left {
            share if share > 0.6 => Some(Side::Left),
            share if share < 0.4 => Some(Side::Right),
            _ => is_of_arms.then_some(Side::Both),
        };
    }
    if !matches!(name, "stand" | "turn" | "march" | "jog_in_place") && cycles(frames).is_some() {
        action.count = Some(Count::Many);
    }
    vec![action]
}

/// The action of limbs or of the whole body in one place.
fn limbs(p: &Profile, steps: &[Step]) -> &'static str {
    let n = steps.len().max(1) as f32;
    let swaying_mps = length_m(steps) / ((steps.len().max(2) - 1) as f32 * STEP_S);
    let highest_m = steps.iter().map(|s| s.top_m).fold(f32::MIN, f32::max);
    let lowest_m = steps.iter().map(|s| s.top_m).fold(f32::MAX, f32::min);
    let mean_m = steps.iter().map(|s| s.top_m).sum::<f32>() / n;
    let variance = steps
        .iter()
        .map(|s| (s.top_m - mean_m).powi(2))
        .sum::<f32>()
        / n;
    let top_spread_m = variance.sqrt();

    if p.fast < 0.012 {
        return "stand";
    }
    if p.fast > 0.33 && swaying_mps > 0.115 {
        return if p.high > 0.47 {
            "arm_circles"
        } else {
            "punch"
        };
    }
    if p.middle_m < 0.8 && swaying_mps > 0.12 && p.fast < 0.3 {
        return "lunge";
    }
    // The whole body.
    if p.middle_m < 1.03 {
        if p.low * p.fast < 0.07 {
            return match () {
                () if lowest_m < 1.2 => "squat",
                () if p.high < 0.09 => "turn",
                () if p.moving < 0.49 => "leg_raise",
                () => "hop",
            };
        }
        return match () {
            () if p.fast > 0.2 && p.width_m > 0.19 && highest_m > 1.3 && swaying_mps < 0.11 => {
                "jumping_jack"
            }
            () if p.fast_m > 0.79 && p.low < 0.31 && p.top_speed_mps > 1.5 => "march",
            () if p.fast_m > 0.79 => "jog_in_place",
            () if p.width_m < 0.18 => "jump",
            () => "kick",
        };
    }
    // Arms and trunk.
    if top_spread_m < 0.04 {
        return match () {
            () if swaying_mps > 0.125 => "punch",
            () if p.high > 0.9 => "twist",
            () if highest_m > 1.54 => "wave",
            () => "clap",
        };
    }
    match () {
        () if p.moving > 0.65 => "arm_circles",
        () if swaying_mps > 0.1 && p.fast > 0.22 && top_spread_m > 0.06 => "side_bend",
        () if p.high > 0.55 && p.fast_m > 1.37 => "wave",
        () => "raise_arms",
    }
}

/// Cycles of a motion that repeats itself: the first peak of the autocorrelation of the mean radial velocity, from 0.4 s to
/// two thirds of the stretch. `None` without a clear peak.
fn cycles(frames: &[PointFrame]) -> Option<f32> {
    const MIN_LAG: usize = 4;
    const MIN_CORRELATION: f32 = 0.4;
    const MIN_DEVIATION_MPS: f32 = 0.03;
    let n = frames.len();
    let velocity = |f: &PointFrame| {
        f.points.iter().map(|p| p.velocity_mps).sum::<f32>() / f.points.len().max(1) as f32
    };
    let raw: Vec<f32> = frames.iter().map(velocity).collect();
    let mean = raw.iter().sum::<f32>() / n.max(1) as f32;
    let series: Vec<f32> = raw.iter().map(|v| v - mean).collect();
    let power = series.iter().map(|v| v * v).sum::<f32>() / n.max(1) as f32;
    if n < 3 * MIN_LAG || power.sqrt() < MIN_DEVIATION_MPS {
        return None;
    }
    let correlation = |lag: usize| {
        let products = series.iter().zip(&series[lag..]).map(|(a, b)| a * b);
        products.sum::<f32>() / ((n - lag) as f32 * power)
    };
    let all: Vec<f32> = (0..=2 * n / 3).map(correlation).collect();
    (MIN_LAG..all.len() - 1)
        .find(|&i| all[i] > MIN_CORRELATION && all[i] >= all[i - 1] && all[i] >= all[i + 1])
        .map(|lag| n as f32 / lag as f32)
}

#[cfg(test)]
mod tests {
    use super::{super::retrieval::tests::clip, *};

    fn said(n_frames: usize, at: impl Fn(f32) -> [f32; 3]) -> String {
        let clip = clip("x", "-", n_frames, at);
        measured(&clip.frames, clip.radar_height_m).to_string()
    }

    #[test]
    fn ways_over_the_floor_have_direction_speed_and_turns() {
        // Towards the radar at 0.9 m/s and at 1.2 m/s, away from it at 0.45 m/s, and at 1.6 m/s.
        assert_eq!(
            said(40, |t| [0.0, 6.0 - 3.6 * t, 0.2]),
            "person: walk forward"
        );
        assert_eq!(
            said(40, |t| [0.0, 6.0 - 4.8 * t, 0.2]),
            "person: walk forward fast"
        );
        assert_eq!(
            said(40, |t| [0.0, 2.0 + 1.8 * t, 0.2]),
            "person: walk backward slow"
        );
        assert_eq!(said(40, |t| [0.0, 8.0 - 6.4 * t, 0.2]), "person: run");
        // Towards the radar, then to positive x: the left of whoever faces the radar.
        let corner = |t: f32| [(4.8 * t - 2.4).max(0.0), 6.0 - (4.8 * t).min(2.4), 0.2];
        assert_eq!(said(60, corner), "person: walk forward; turn to_left");
        let circle = |t: f32| {
            let (sin, cos) = (TAU * t).sin_cos();
            [0.8 * cos, 3.0 + 0.8 * sin, 0.2]
        };
        assert_eq!(said(60, circle), "person: circle to_left");
        let to_and_fro = |t: f32| [0.0, 4.0 + 2.0 * (TAU * t).sin(), 0.2];
        assert_eq!(said(80, to_and_fro), "person: pace");
    }

    #[test]
    fn heights_tell_falls_from_lying_down() {
        // From 1.6 m to 0.2 m within 1.2 s, and within 4 s.
        let down = |begin: f32, end: f32| {
            move |t: f32| {
                let share = ((t - begin) / (end - begin)).clamp(0.0, 1.0);
                [0.0, 3.0, 0.6 - 1.4 * share]
            }
        };
        assert_eq!(said(60, down(0.4, 0.6)), "person: fall");
        assert_eq!(said(60, down(0.1, 0.9)), "person: lie_down");
        let down_and_up = |t: f32| [0.0, 3.0, 0.6 - 1.4 * (0.5 * TAU * t).sin()];
        assert_eq!(said(80, down_and_up), "person: lie_down; stand_up");
        assert_eq!(
            said(24, |t| [0.0, 3.0 + 0.4 * t, 0.4 - 0.4 * t]),
            "person: sit_down"
        );
        assert_eq!(
            said(24, |t| [0.0, 3.4 - 0.4 * t, 0.4 * t]),
            "person: stand_up"
        );
        assert_eq!(said(40, |_| [0.0, 3.0, 0.2]), "person: stand");
    }

    #[test]
    fn what_is_before_a_fall_is_stated_before_it() {
        let walk_and_fall = |t: f32| {
            let height_m = 0.6 - 1.4 * ((t - 0.7) / 0.1).clamp(0.0, 1.0);
            [0.0, 6.0 - 4.5 * t.min(0.6), height_m]
        };
        assert_eq!(said(80, walk_and_fall), "person: walk forward slow; fall");
    }

    #[test]
    fn cycles_are_those_of_the_velocity() {
        let five = clip("x", "-", 60, |t| {
            [0.0, 3.0 + 0.1 * (5.0 * TAU * t).sin(), 0.2]
        });
        assert_eq!(cycles(&five.frames), Some(5.0));
        let still = clip("x", "-", 60, |_| [0.0, 3.0, 0.2]);
        assert_eq!(cycles(&still.frames), None);
        assert_eq!(cycles(&[]), None);
    }
}
