//! Arm gestures. All of them can be combined with walking or standing.

use std::f32::consts::{FRAC_PI_2, PI};

use glam::Vec3;

use super::{ELBOW_BACK, ELBOW_DOWN, ELBOW_OUT, ELBOW_SIDE, ELBOW_UP, film, reach};
use crate::actor::Actor;
use crate::control::{Control, SIDE_SIGN};
use crate::track::Track;
use crate::values::Values;

/// Time in which lively people raise a hand above the head, s.
const FASTEST_RAISE_S: f32 = 0.3;

/// How the rest of the body takes part in a gesture: nobody moves an arm alone.
struct Involvement {
    flex: f32,
    side: f32,
    twist: f32,
    nod: f32,
    /// Elevation and azimuth of an arm that the gesture does not name, rad.
    other_arm: [f32; 2],
    /// Bend of the knees from which a lively person springs up with the arms, m; 0 for others.
    crouch_m: f32,
    /// Time for raising the arms, as a share of what others take.
    raising_time: f32,
}

impl Involvement {
    fn draw(actor: &mut Actor) -> Self {
        let dice = &mut actor.dice;
        // Some move little but the arm, others much.
        let share = dice.range(0.0, 1.0);
        let (crouch_m, raising_time) = match dice.chance(0.3) {
            true => (dice.range(0.03, 0.13), dice.log_range(0.35, 0.9)),
            false => (0.0, 1.0),
        };
        Self {
            flex: -0.1 * share * dice.bell(),
            side: 0.12 * share * dice.bell(),
            twist: 0.25 * share * dice.bell(),
            nod: 0.2 * share * dice.bell(),
            other_arm: [
                0.4 * share * dice.range(0.0, 1.0),
                0.5 * share * dice.bell(),
            ],
            crouch_m,
            raising_time,
        }
    }

    /// Time for raising the arms, s; others take `others_s`.
    fn raising_s(&self, others_s: f32) -> f32 {
        (self.raising_time * others_s).max(others_s.min(FASTEST_RAISE_S))
    }

    /// The pose before the arms are raised.
    fn before(&self, rest: &Control) -> Control {
        let mut c = *rest;
        c.hip.y -= self.crouch_m;
        c.flex += self.crouch_m;
        c
    }

    /// Adds the share of the rest of the body to a pose of the arms `named`.
    fn apply(&self, c: &mut Control, rest: &Control, named: &[usize]) {
        c.hip = rest.hip;
        c.flex = rest.flex + self.flex;
        c.side = rest.side + self.side;
        c.twist = rest.twist + self.twist;
        c.nod = rest.nod + self.nod;
        for side in (0..2).filter(|side| !named.contains(side)) {
            c.arms[side].elevation = rest.arms[side].elevation + self.other_arm[0];
            c.arms[side].azimuth = rest.arms[side].azimuth + self.other_arm[1];
        }
    }
}

/// Waves a raised hand.
pub(super) fn wave(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let rest = actor.standing();
    let speed = v.speed();
    // Some move the forearm, others little more than the hand.
    let swing = actor.a(0.26) * v.amplitude() * actor.dice.log_range(0.4, 1.5);
    // In front of the shoulder, beside it or between.
    let azimuth = actor.dice.range(0.0, 1.25);
    // From shoulder height to above the head; the higher the hand, the straighter the arm.
    let up = actor.dice.range(0.0, 1.0);
    let height = -0.05 + 1.2 * up;
    let stretched = (0.5 + 0.35 * up + 0.14 * actor.dice.bell()).clamp(0.4, 0.95);
    let pole = if azimuth + height < 0.9 {
        ELBOW_DOWN
    } else {
        ELBOW_OUT
    };
    let body = Involvement::draw(actor);
    let mut track = Track::new(body.before(&rest));
    track.hold(0.1);
    let pose = |c: &mut Control, lean: f32| {
        for side in v.sides() {
            reach(
                c,
                *side,
                height - 0.12 * lean,
                azimuth + swing * lean,
                stretched,
                pole,
            );
            c.arms[*side].deviate = -0.35 * lean;
            c.arms[*side].flex = 0.0;
        }
        body.apply(c, &rest, v.sides());
    };
    let raising_s = body.raising_s(actor.s(0.6, speed));
    track.to(raising_s, |c| pose(c, -0.6));
    for _ in 0..v.count("repetitions") {
        track.to(actor.s(0.24, speed), |c| pose(c, 1.0));
        track.to(actor.s(0.24, speed), |c| pose(c, -1.0));
    }
    track.to(actor.s(0.65, speed), |c| *c = rest);
    track.hold(0.2);
    film(&track, actor)
}

/// Raises arms and lowers them.
pub(super) fn raise_arms(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let rest = actor.standing();
    let speed = v.speed();
    // People raise their arms to any height, mostly above the head, and between the front and the side.
    let up = actor.dice.range(0.0, 1.0).sqrt();
    // The higher a hand is put up, the straighter the arm.
    let stretched = match v.word("style") {
        "hand" => (0.36 + 0.55 * up + 0.15 * actor.dice.bell()).clamp(0.3, 0.975),
        _ => actor.dice.range(0.62, 0.975),
    };
    let body = Involvement::draw(actor);
    let hold_s = v.given("hold_s").unwrap_or(0.35);
    let (elevation, azimuth) = match v.word("style") {
        "forward" => (-0.15 + 0.5 * up, 0.03 + 0.15 * actor.dice.bell()),
        "sideways" => (-0.15 + 0.6 * up, 1.4 + 0.15 * actor.dice.bell()),
        "hand" => (-0.35 + 1.8 * up, actor.dice.range(0.0, 1.45)),
        _ => (0.85 + 0.58 * up, actor.dice.range(0.1, 1.4)),
    };
    // A raised hand may be above the head instead of the shoulder. Most people swing it out to the side and past the
    // vertical, others up the middle.
    let (elevation, azimuth) = match elevation > 1.1 {
        true => match actor.dice.range(0.0, 1.0) {
            0.0..0.15 => (elevation, -actor.dice.range(0.3, 1.5)),
            0.15..0.5 => (PI - elevation, azimuth),
            _ => (elevation, azimuth),
        },
        false => (elevation, azimuth),
    };
    let is_overhead = v.word("style") == "overhead";
    let pole = match (elevation >= 0.85, azimuth > 0.7) {
        (true, true) => ELBOW_SIDE,
        (true, false) => ELBOW_UP,
        _ => ELBOW_DOWN,
    };
    let mut track = Track::new(body.before(&rest));
    track.hold(0.1);
    for n in 0..v.count("repetitions") {
        let raising_s = body.raising_s(actor.s(0.85, speed));
        track.to(raising_s, |c| {
            for side in v.sides() {
                reach(c, *side, elevation, azimuth, stretched, pole);
                c.arms[*side].flex = 0.0;
            }
            body.apply(c, &rest, v.sides());
            c.flex -= if is_overhead { 0.06 } else { 0.0 };
        });
        // How long the arms stay up does not depend on how fast they are moved.
        track.hold(hold_s);
        track.to(actor.s(0.8, speed), |c| *c = rest);
        if n + 1 < v.count("repetitions") {
            track.hold(actor.s(0.1, speed));
        }
    }
    track.hold(0.2);
    film(&track, actor)
}

/// Claps in front of the chest.
pub(super) fn clap(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let rest = actor.standing();
    let speed = v.speed();
    let height = -0.18 + 0.12 * actor.dice.bell();
    let open = 0.12 + actor.a(0.22) * v.amplitude();
    let mut track = Track::new(rest);
    let pose = |c: &mut Control, apart: f32| {
        for side in 0..2 {
            reach(c, side, height, -0.47 + apart, 0.66, ELBOW_DOWN);
            c.arms[side].flex = 0.0;
        }
    };
    track.hold(0.1);
    track.to(actor.s(0.55, speed), |c| pose(c, open));
    for n in 0..v.count("repetitions") {
        track.to(actor.s(0.15, speed), |c| pose(c, 0.0));
        if n + 1 < v.count("repetitions") {
            track.to(actor.s(0.2, speed), |c| pose(c, open));
        }
    }
    track.to(actor.s(0.2, speed), |c| pose(c, 0.6 * open));
    track.to(actor.s(0.55, speed), |c| *c = rest);
    track.hold(0.2);
    film(&track, actor)
}

/// Punches from a boxer's guard, alternating sides when both hands are requested.
pub(super) fn punch(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let rest = actor.standing();
    let speed = v.speed();
    let style = v.word("style");
    let lean = v.given("lean_deg").map_or(0.08, f32::to_radians);
    let aim = v.given("aim_deg").map_or(0.05, f32::to_radians);
    let pause_s = v.given("pause_s").unwrap_or(0.1);
    // In a boxer's stance one foot is in front of the other, and the weight moves with each punch.
    let stance_m = v.given("stance_m").unwrap_or(0.0);
    let lead = if stance_m > 0.0 {
        actor.dice.index(2)
    } else {
        0
    };
    let mut guard = rest;
    guard.feet[lead].at.z += 0.5 * stance_m;
    guard.feet[1 - lead].at.z -= 0.5 * stance_m;
    // A bias of 1 is all weight on the left foot.
    let bias_on_lead = |share: f32| match (stance_m > 0.0, lead) {
        (false, _) => 0.5,
        (true, 0) => share,
        (true, _) => 1.0 - share,
    };
    guard.hip.y -= actor.m(0.04);
    guard.flex += 0.12;
    for side in 0..2 {
        reach(&mut guard, side, 0.12, -0.28, 0.5, ELBOW_DOWN);
        guard.arms[side].flex = 0.0;
    }
    let mut track = Track::new(rest);
    track.to(actor.s(0.5, speed), |c| *c = guard);
    track.hold(actor.s(0.1, speed));
    for n in 0..v.count("repetitions") as usize {
        let side = v.sides()[n % v.sides().len()];
        let sign = SIDE_SIGN[side];
        let turn = actor.a(0.5).min(0.65);
        track.to(actor.s(0.14, speed), |c| {
            c.twist = sign * 0.3 * turn;
            c.bias = bias_on_lead(0.25);
            match style {
                "hook" => reach(c, side, 0.0, 0.9, 0.62, ELBOW_OUT),
                "uppercut" => reach(c, side, -0.95, 0.1, 0.6, ELBOW_BACK),
                _ => reach(c, side, 0.08, -0.2, 0.45, ELBOW_DOWN),
            }
        });
        track.to(actor.s(0.17, speed), |c| {
            c.twist = -sign * turn;
            c.yaw = -sign * 0.2 * turn;
            c.pitch = rest.pitch + lean;
            c.bias = bias_on_lead(0.95);
            match style {
                "hook" => reach(c, side, 0.1, -0.55, 0.7, Vec3::new(1.0, 0.0, -0.3)),
                "uppercut" => reach(c, side, 0.55, -0.2, 0.66, Vec3::new(0.4, -1.0, 0.0)),
                _ => reach(c, side, aim, 0.25, 0.98, ELBOW_DOWN),
            }
        });
        track.to(actor.s(0.24, speed), |c| *c = guard);
        track.hold(actor.s(pause_s, speed));
    }
    track.to(actor.s(0.5, speed), |c| *c = rest);
    track.hold(0.2);
    film(&track, actor)
}

/// Pushes away with both palms.
pub(super) fn push(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let rest = actor.standing();
    let speed = v.speed();
    let size = v.amplitude();
    let mut track = Track::new(rest);
    let near = |c: &mut Control| {
        for side in 0..2 {
            reach(c, side, -0.15, 0.0, 0.42, ELBOW_DOWN);
            c.arms[side].flex = -0.9;
        }
        c.flex = rest.flex;
        c.pitch = rest.pitch - 0.03;
    };
    track.to(actor.s(0.6, speed), near);
    for _ in 0..v.count("repetitions") {
        let far = (0.62 + 0.33 * size).min(0.97);
        track.to(actor.s(0.5, speed), |c| {
            for side in 0..2 {
                reach(c, side, 0.02, 0.02, far, ELBOW_DOWN);
            }
            c.pitch = rest.pitch + 0.14 * size;
            c.flex = rest.flex + 0.1;
        });
        track.hold(actor.s(0.2, speed));
        track.to(actor.s(0.5, speed), near);
    }
    track.to(actor.s(0.55, speed), |c| *c = rest);
    track.hold(0.2);
    film(&track, actor)
}

/// Reaches out, grips and pulls back.
pub(super) fn pull(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let rest = actor.standing();
    let speed = v.speed();
    let mut track = Track::new(rest);
    let twist: f32 = v.sides().iter().map(|s| SIDE_SIGN[*s]).sum();
    let out = |c: &mut Control| {
        for side in v.sides() {
            reach(c, *side, -0.12, 0.02, 0.95, ELBOW_DOWN);
        }
        c.pitch = rest.pitch + 0.1;
        c.flex = rest.flex + 0.12;
        c.twist = -0.3 * twist;
    };
    track.to(actor.s(0.7, speed), out);
    for n in 0..v.count("repetitions") {
        track.hold(actor.s(0.15, speed));
        track.to(actor.s(0.6, speed), |c| {
            for side in v.sides() {
                reach(c, *side, -0.75, 0.1, 0.42, ELBOW_BACK);
            }
            c.pitch = rest.pitch - 0.12;
            c.flex = rest.flex;
            c.twist = 0.3 * twist;
        });
        if n + 1 < v.count("repetitions") {
            track.to(actor.s(0.6, speed), out);
        }
    }
    track.hold(actor.s(0.2, speed));
    track.to(actor.s(0.6, speed), |c| *c = rest);
    track.hold(0.2);
    film(&track, actor)
}

/// Knocks at face height.
pub(super) fn knock(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let rest = actor.standing();
    let speed = v.speed();
    let side = v.sides()[0];
    let mut track = Track::new(rest);
    let pose = |c: &mut Control, out: f32| {
        reach(c, side, 0.22, -0.05, 0.56 + 0.14 * out, ELBOW_DOWN);
        c.arms[side].flex = 0.35 - 0.5 * out;
    };
    track.hold(0.1);
    track.to(actor.s(0.6, speed), |c| pose(c, 0.0));
    for _ in 0..v.count("repetitions") {
        track.to(actor.s(0.13, speed), |c| pose(c, 1.0));
        track.to(actor.s(0.17, speed), |c| pose(c, 0.0));
    }
    track.to(actor.s(0.15, speed), |c| pose(c, 0.1));
    track.to(actor.s(0.6, speed), |c| *c = rest);
    track.hold(0.2);
    film(&track, actor)
}

/// Points and holds the pose.
pub(super) fn point(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let rest = actor.standing();
    let speed = v.speed();
    let side = v.sides()[0];
    let sign = SIDE_SIGN[side];
    let aside = match v.word("direction") {
        "left" => 1.0,
        "right" => -1.0,
        _ => 0.0,
    };
    let (elevation, azimuth, length, pole) = match (v.word("direction"), aside * sign) {
        ("up", _) => (1.2, 0.15, 0.97, ELBOW_UP),
        (_, across) if across > 0.0 => (0.05, 1.45, 0.97, ELBOW_DOWN),
        (_, across) if across < 0.0 => (0.05, -1.0, 0.86, ELBOW_DOWN),
        _ => (0.05, 0.05, 0.97, ELBOW_DOWN),
    };
    let jitter = 0.08 * actor.dice.bell();
    let mut track = Track::new(rest);
    track.hold(0.1);
    track.to(actor.s(0.6, speed), |c| {
        reach(c, side, elevation + jitter, azimuth, length, pole);
        c.arms[side].flex = 0.0;
        c.look = 0.7 * aside;
        c.twist = 0.25 * aside + if aside * sign < 0.0 { 0.2 * aside } else { 0.0 };
        if v.word("direction") == "up" {
            c.nod = -0.35;
        }
    });
    track.to(actor.s(0.9, speed), |c| c.arms[side].elevation += 0.02);
    track.to(actor.s(0.65, speed), |c| *c = rest);
    track.hold(0.2);
    film(&track, actor)
}

/// Drinks from a cup.
pub(super) fn drink(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let rest = actor.standing();
    let speed = v.speed();
    let side = v.sides()[0];
    let mut track = Track::new(rest);
    track.hold(0.1);
    track.to(actor.s(0.7, speed), |c| {
        reach(c, side, -0.35, -0.15, 0.62, ELBOW_DOWN);
    });
    track.to(actor.s(0.5, speed), |c| {
        reach(c, side, 0.62, -0.62, 0.5, Vec3::new(0.5, -1.0, 0.0));
        c.nod = rest.nod;
    });
    track.to(actor.s(0.35, speed), |c| {
        c.arms[side].elevation += 0.08;
        c.nod = -0.42;
        c.flex = rest.flex - 0.05;
    });
    track.hold(actor.s(0.7, speed));
    track.to(actor.s(0.5, speed), |c| {
        reach(c, side, -0.35, -0.15, 0.62, ELBOW_DOWN);
        c.nod = rest.nod;
        c.flex = rest.flex;
    });
    track.to(actor.s(0.65, speed), |c| *c = rest);
    track.hold(0.2);
    film(&track, actor)
}

/// Holds a phone to the ear.
pub(super) fn answer_phone(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let to_ear = |c: &mut Control, side: usize| {
        reach(c, side, 1.08, -0.35, 0.44, Vec3::new(0.6, -1.0, 0.3));
        c.tilt = SIDE_SIGN[side] * 0.12;
        c.nod = 0.1;
    };
    hold_gesture(v, actor, 0.75, 1.6, to_ear)
}

/// Salutes.
pub(super) fn salute(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let to_brow = |c: &mut Control, side: usize| {
        reach(c, side, 0.95, -0.05, 0.55, Vec3::new(1.0, -0.3, 0.2));
        c.flex -= 0.05;
    };
    hold_gesture(v, actor, 0.5, 0.9, to_brow)
}

/// Folds the arms in front of the chest.
pub(super) fn cross_arms(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let upper = actor.dice.index(2);
    let folded = move |c: &mut Control, side: usize| {
        let above = if side == upper { 0.1 } else { 0.0 };
        reach(
            c,
            side,
            -0.62 + above,
            -0.95,
            0.5 + above,
            Vec3::new(0.8, -0.6, 0.1),
        );
    };
    hold_gesture(v, actor, 0.75, 1.3, folded)
}

/// Puts the hands on the hips.
pub(super) fn hands_on_hips(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let akimbo = |c: &mut Control, side: usize| {
        reach(c, side, -1.42, 0.3, 0.74, Vec3::new(1.0, 0.0, -0.45));
        c.arms[side].flex = -0.4;
    };
    hold_gesture(v, actor, 0.7, 1.5, akimbo)
}

fn hold_gesture(
    v: &Values,
    actor: &mut Actor,
    raise_s: f32,
    hold_s: f32,
    pose: impl Fn(&mut Control, usize),
) -> Vec<Control> {
    let rest = actor.standing();
    let speed = v.speed();
    let mut track = Track::new(rest);
    track.hold(0.15);
    track.to(actor.s(raise_s, speed), |c| {
        for side in v.sides() {
            pose(c, *side);
        }
    });
    track.to(actor.s(hold_s, speed), |c| c.flex += 0.02);
    track.to(actor.s(raise_s, speed), |c| *c = rest);
    track.hold(0.25);
    film(&track, actor)
}

/// Circles the straight arms beside the body.
pub(super) fn arm_circles(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let rest = actor.standing();
    let speed = v.speed();
    // In forward circles the arms rise behind the back and descend in front.
    let sense = if v.word("direction") == "forward" {
        -1.0
    } else {
        1.0
    };
    let mut track = Track::new(rest);
    track.to(actor.s(0.3, speed), |c| {
        for side in v.sides() {
            reach(c, *side, -FRAC_PI_2, 0.2, 0.97, ELBOW_OUT);
        }
    });
    for _ in 0..v.count("repetitions") {
        let quarter_s = actor.s(0.24, speed);
        for _ in 0..4 {
            track.to(quarter_s, |c| {
                for side in v.sides() {
                    let arm = &mut c.arms[*side];
                    arm.elevation += sense * FRAC_PI_2;
                    // The shoulder has a greater range of motion to the side than straight back.
                    let back = arm.elevation.cos() < -0.5;
                    arm.azimuth = if back { -0.55 } else { 0.3 };
                    arm.pole = ELBOW_OUT;
                }
            });
        }
    }
    let turns = sense * std::f32::consts::TAU * v.count("repetitions") as f32;
    track.to(actor.s(0.3, speed), |c| {
        *c = rest;
        for side in v.sides() {
            c.arms[*side].elevation += turns;
        }
    });
    track.hold(0.2);
    film(&track, actor)
}
