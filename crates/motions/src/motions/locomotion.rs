//! Stepping motions, implemented as parameter sets for [`Gait`].

use std::f32::consts::{PI, TAU};

use glam::Vec3;

use super::towards;
use crate::actor::Actor;
use crate::control::Control;
use crate::gait::Gait;
use crate::rig::AUTHORED_HEIGHT_M;
use crate::values::Values;

/// Cruising speed of normal walking for a person of the authored height, m/s.
pub(super) const WALK_MPS: f32 = 1.2;
/// Cruising speed of walking backward for the same person, m/s.
pub(super) const BACKWARD_MPS: f32 = 0.85;
/// Cruising speed of running for the same person, m/s: a jog.
pub(super) const RUN_MPS: f32 = 2.5;
const LIMP_MPS: f32 = 0.75;
const MARCH_MPS: f32 = 0.8;
const WALK_M: f32 = 2.5;
const RUN_M: f32 = 4.0;
/// Duration of a gait in excess of distance / speed, s: lead-in, speed ramps and settling.
const OVERHEAD_S: f32 = 1.4;

/// Walks forward or backward.
pub(super) fn walk(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let back = v.word("direction") == "backward";
    let base = if back { BACKWARD_MPS } else { WALK_MPS } * actor.rig.scale.sqrt();
    let (distance_m, speed) = pace(v, base, WALK_M);
    let mut gait = Gait::walk(actor, speed);
    let size = v.amplitude() * if actor.stoop > 0.0 { 0.8 } else { 1.0 };
    gait.arm *= size;
    gait.lift_m *= v.amplitude();
    gait.strike *= size;
    if back {
        gait.strike = -0.35;
        gait.toe_off = 0.12;
        gait.step_s *= 1.05;
        gait.arm *= 0.5;
        gait.lean = 0.02;
        gait.pelvis_turn *= -0.6;
        gait.lift_m = actor.m(0.07);
        gait.dip_m = actor.m(0.02);
        gait.bob_m *= 0.6;
    }
    gait.step_s *= size.sqrt();
    gait.plan(distance_m, base * speed);
    straight(&gait, actor, towards(v.word("direction")) * distance_m)
}

/// Runs forward.
pub(super) fn run(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let base = RUN_MPS * actor.rig.scale.sqrt();
    let (distance_m, speed) = pace(v, base, RUN_M);
    let mut gait = running(actor, speed, v.amplitude());
    gait.plan(distance_m, base * speed);
    straight(&gait, actor, Vec3::Z * distance_m)
}

/// Turns on the spot.
pub(super) fn turn(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let angle = v.number("angle_deg").to_radians() * towards(v.word("direction")).x;
    let speed = v.speed();
    let mut gait = Gait::walk(actor, speed);
    gait.first = usize::from(angle < 0.0);
    gait.step_s *= 0.95;
    gait.strike = 0.05;
    gait.toe_off = -0.5;
    gait.in_place = 0.8;
    gait.lift_m = actor.m(0.05);
    gait.arm *= 0.35;
    gait.pelvis_turn *= 0.4;
    gait.bob_m *= 0.3;
    gait.spread_m = actor.m(0.02);
    // About 50 degrees per step at normal speed.
    gait.n_steps = ((angle.abs() / (0.85 * speed.sqrt())).round() as usize + 1).max(2);
    gait.perform(actor, &|p| (Vec3::ZERO, angle * p))
}

/// Walks around one or more full circles.
pub(super) fn circle(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let sign = towards(v.word("direction")).x;
    let radius_m = v.number("radius_m");
    let turns = v.count("repetitions") as f32;
    let speed = v.speed();
    let tight = (radius_m / actor.m(0.9)).clamp(0.55, 1.0);
    let mut gait = Gait::walk(actor, speed);
    gait.step_s *= tight.sqrt();
    gait.toe_off *= tight;
    gait.first = usize::from(sign < 0.0);
    gait.bank = 0.06 * sign * speed;
    let cruise = WALK_MPS * actor.rig.scale.sqrt() * speed * tight;
    gait.plan(TAU * radius_m * turns, cruise);
    gait.perform(actor, &|p| {
        let angle = TAU * turns * p;
        let place = Vec3::new(
            sign * radius_m * (1.0 - angle.cos()),
            0.0,
            radius_m * angle.sin(),
        );
        (place, sign * angle)
    })
}

/// Walks back and forth: straight lines with tight turns at their ends.
pub(super) fn back_and_forth(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let line_m = v.number("distance_m");
    let laps = v.count("repetitions") as f32;
    let speed = v.speed();
    let radius_m = actor.m(0.22);
    let (lap_m, curve_m) = (2.0 * (line_m + PI * radius_m), PI * radius_m);
    // Each turn is to the left or to the right, and all of one person are alike.
    let sign = if actor.dice.chance(0.5) { 1.0 } else { -1.0 };
    let mut gait = Gait::walk(actor, speed);
    let size = v.amplitude() * if actor.stoop > 0.0 { 0.8 } else { 1.0 };
    gait.arm *= 0.8 * size;
    gait.lift_m *= v.amplitude();
    gait.strike *= 0.7 * size;
    gait.toe_off *= 0.7;
    gait.step_s *= (0.85 * size).sqrt();
    gait.first = usize::from(sign < 0.0);
    let cruise = 0.8 * WALK_MPS * actor.rig.scale.sqrt() * speed;
    gait.plan(lap_m * laps, cruise);
    gait.perform(actor, &|p| {
        let along_m = lap_m * laps * p;
        let lap = (along_m / lap_m).floor();
        let at_m = along_m - lap * lap_m;
        let side = |angle: f32| sign * radius_m * (1.0 - angle.cos());
        let (x_m, z_m, angle) = if at_m < line_m {
            (0.0, at_m, 0.0)
        } else if at_m < line_m + curve_m {
            let angle = (at_m - line_m) / radius_m;
            (side(angle), line_m + radius_m * angle.sin(), angle)
        } else if at_m < 2.0 * line_m + curve_m {
            let back_m = at_m - line_m - curve_m;
            (2.0 * sign * radius_m, line_m - back_m, PI)
        } else {
            let angle = PI + (at_m - 2.0 * line_m - curve_m) / radius_m;
            (side(angle), radius_m * angle.sin(), angle)
        };
        (Vec3::new(x_m, 0.0, z_m), sign * (angle + TAU * lap))
    })
}

/// Walks along two straight lines with a curve between them.
pub(super) fn walk_turn(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let distance_m = v.number("distance_m");
    let angle = v.number("angle_deg").to_radians();
    let sign = towards(v.word("direction")).x;
    let speed = v.speed();
    // Some turn within one step, others along a curve of 2 m.
    let bend_m = actor.dice.log_range(0.25, 2.2);
    let radius_m = actor.m(bend_m / angle.max(1.0));
    let curve_m = angle * radius_m;
    let before_m = actor.dice.range(0.35, 0.65) * (distance_m - curve_m).max(0.6);
    let after_m = (distance_m - curve_m - before_m).max(0.3);
    let mut gait = Gait::walk(actor, speed);
    let size = v.amplitude() * if actor.stoop > 0.0 { 0.8 } else { 1.0 };
    gait.arm *= size;
    gait.lift_m *= v.amplitude();
    gait.strike *= size;
    gait.toe_off *= 0.85;
    gait.step_s *= size.sqrt();
    gait.first = usize::from(sign < 0.0);
    let total_m = before_m + curve_m + after_m;
    gait.plan(total_m, 0.95 * WALK_MPS * actor.rig.scale.sqrt() * speed);
    gait.perform(actor, &|p| {
        let along_m = total_m * p;
        let turned = ((along_m - before_m) / radius_m).clamp(0.0, angle);
        let straight_m = along_m - turned * radius_m;
        let (first_m, second_m) = (straight_m.min(before_m), (straight_m - before_m).max(0.0));
        let place = Vec3::new(
            sign * (radius_m * (1.0 - turned.cos()) + second_m * turned.sin()),
            0.0,
            first_m + radius_m * turned.sin() + second_m * turned.cos(),
        );
        (place, sign * turned)
    })
}

/// Steps to the side without crossing the feet.
pub(super) fn side_step(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let distance_m = v.number("distance_m");
    let way = towards(v.word("direction"));
    let speed = v.speed();
    let mut gait = Gait::walk(actor, speed);
    let cruise = 0.7 * speed * actor.rig.scale.sqrt();
    gait.first = usize::from(way.x < 0.0);
    gait.strike = 0.0;
    gait.toe_off = -0.35;
    gait.in_place = 0.5;
    gait.lift_m = actor.m(0.055);
    gait.pelvis_turn = 0.0;
    gait.arm = 0.04;
    gait.sway_m = 0.0;
    gait.list *= 0.4;
    gait.dip_m = actor.m(0.02);
    gait.bob_m = actor.m(0.015);
    gait.step_s = 0.46 * actor.style.tempo / speed.sqrt();
    gait.plan(distance_m, cruise);
    gait.n_steps += gait.n_steps % 2;
    // The trailing foot stops at a small gap from the leading foot instead of crossing it.
    gait.spread_m = (0.25 * cruise * gait.step_s - actor.m(0.01)).max(0.0);
    straight(&gait, actor, way * distance_m)
}

/// Marches in place or forward.
pub(super) fn march(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let speed = v.speed();
    let size = v.amplitude();
    let mut gait = Gait::walk(actor, speed);
    gait.step_s = 0.52 * actor.style.tempo / speed;
    gait.swing_steps = 0.86;
    gait.lift_m = actor.a(0.26) * size * actor.rig.scale;
    gait.hang = -0.5;
    gait.strike = 0.0;
    gait.toe_off = -0.5;
    gait.in_place = 0.6;
    gait.arm = actor.a(0.75) * size;
    gait.elbow = 0.15;
    gait.elbow_front = 0.45;
    gait.sway_m = actor.m(0.035);
    gait.bob_m = actor.m(0.01);
    gait.dip_m = 0.0;
    gait.lean = -0.02;
    let distance_m = v.number("distance_m");
    if distance_m >= 0.3 {
        gait.plan(distance_m, MARCH_MPS * speed * actor.rig.scale.sqrt());
    } else {
        gait.n_steps = steps_in(v, gait.step_s);
    }
    straight(&gait, actor, Vec3::Z * distance_m)
}

/// Runs on the spot.
pub(super) fn jog_in_place(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let speed = v.speed();
    let mut gait = running(actor, speed, v.amplitude());
    gait.step_s = 0.33 * actor.style.tempo / speed.sqrt();
    gait.in_place = 0.55;
    gait.lift_m = actor.a(0.22) * v.amplitude() * actor.rig.scale;
    gait.lean = 0.04;
    gait.strike = -0.2;
    gait.n_steps = steps_in(v, gait.step_s);
    straight(&gait, actor, Vec3::ZERO)
}

/// Walks with a limp, sparing one leg.
pub(super) fn limp(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let speed = v.speed();
    let mut gait = Gait::walk(actor, speed);
    let hurt = v.sides()[0];
    gait.limp = Some(hurt);
    gait.first = hurt;
    gait.step_s *= 1.1;
    gait.arm *= 0.5;
    gait.list *= 0.6;
    gait.bob_m *= 0.5;
    gait.dip_m = actor.m(0.02);
    gait.strike = 0.12;
    let distance_m = v.number("distance_m");
    gait.plan(distance_m, LIMP_MPS * speed * actor.rig.scale.sqrt());
    straight(&gait, actor, Vec3::Z * distance_m)
}

/// Returns true if `duration_s` determines the distance or the number of steps.
pub(super) fn length_follows_duration(name: &str, v: &Values) -> bool {
    match name {
        "walk" | "run" => true,
        "march" => v.number("distance_m") < 0.3 && !v.is_set("repetitions"),
        "jog_in_place" => !v.is_set("repetitions"),
        "stand_still" | "sit_still" => true,
        _ => false,
    }
}

/// Returns the reason why `distance_m` cannot be covered in `duration_s`, if there is one.
pub(super) fn impossible_pace(name: &str, v: &Values, height_m: f32) -> Option<String> {
    let base = match (name, v.word("direction")) {
        ("walk", "backward") => BACKWARD_MPS,
        ("walk", _) => WALK_MPS,
        ("run", _) => RUN_MPS,
        _ => return None,
    } * (height_m / AUTHORED_HEIGHT_M).sqrt();
    let duration_s = v.given("duration_s")?;
    let (shortest, longest) = (0.4, if name == "run" { 1.7 } else { 1.8 });
    let Some(distance_m) = v.given("distance_m") else {
        let min_s = OVERHEAD_S + 1.0;
        return (duration_s < min_s).then(|| format!("needs duration_s of at least {min_s:.1}"));
    };
    let moving_s = duration_s - OVERHEAD_S;
    if moving_s <= 0.0 || distance_m / moving_s > longest * base {
        let min = OVERHEAD_S + distance_m / (longest * base);
        return Some(format!(
            "{distance_m} m need at least {min:.1} s, not duration_s={duration_s}"
        ));
    }
    (distance_m / moving_s < shortest * base).then(|| {
        let max = OVERHEAD_S + distance_m / (shortest * base);
        format!("{distance_m} m take at most {max:.1} s, not duration_s={duration_s}; leave out distance_m or let stand_still follow")
    })
}

/// Distance and speed multiplier, derived from whichever of distance_m, speed and duration_s are
/// given.
fn pace(v: &Values, base_mps: f32, default_m: f32) -> (f32, f32) {
    match (v.given("distance_m"), v.given("duration_s")) {
        (Some(distance_m), Some(duration_s)) => {
            let moving_s = (duration_s - OVERHEAD_S).max(0.2);
            (
                distance_m,
                (distance_m / moving_s / base_mps).clamp(0.4, 1.8),
            )
        }
        (None, Some(duration_s)) => {
            let speed = v.speed();
            (
                ((duration_s - OVERHEAD_S) * base_mps * speed).max(0.5),
                speed,
            )
        }
        (distance_m, None) => (distance_m.unwrap_or(default_m), v.speed()),
    }
}

/// Speed multiplier that results from speed, distance_m and duration_s.
pub(crate) fn resulting_speed(name: &str, v: &Values, height_m: f32) -> f32 {
    let (base, natural_m) = match (name, v.word("direction")) {
        ("walk", "backward") => (BACKWARD_MPS, WALK_M),
        ("walk", _) => (WALK_MPS, WALK_M),
        ("run", _) => (RUN_MPS, RUN_M),
        _ => return v.speed(),
    };
    pace(v, base * (height_m / AUTHORED_HEIGHT_M).sqrt(), natural_m).1
}

fn running(actor: &mut Actor, speed: f32, size: f32) -> Gait {
    let mut gait = Gait::walk(actor, 1.0);
    let root = speed.sqrt();
    gait.step_s = 0.37 * actor.rig.scale.sqrt() * actor.style.tempo / speed.powf(0.42);
    gait.swing_steps = 1.32;
    gait.ramps = [2.0, 2.8];
    gait.lift_m = actor.a(0.20) * root * size * actor.rig.scale;
    gait.hang = -0.75;
    gait.strike = 0.1;
    gait.toe_off = -0.9;
    gait.in_place = 0.4;
    gait.dip_m = actor.m(0.045);
    gait.bob_m = 0.0;
    gait.bounce_m = actor.m(0.03);
    gait.sway_m = actor.m(0.01);
    gait.pelvis_turn = 0.12;
    gait.lean = 0.14 * root;
    gait.arm = actor.a(0.55) * root * size;
    gait.elbow = 1.45;
    gait.elbow_front = 0.25;
    gait
}

fn steps_in(v: &Values, step_s: f32) -> usize {
    match v.given("duration_s") {
        Some(duration_s) if !v.is_set("repetitions") => {
            (((duration_s - OVERHEAD_S) / step_s).floor().max(2.0)) as usize
        }
        _ => v.count("repetitions").max(2) as usize,
    }
}

fn straight(gait: &Gait, actor: &Actor, travel: Vec3) -> Vec<Control> {
    gait.perform(actor, &|p| (travel * p, 0.0))
}
