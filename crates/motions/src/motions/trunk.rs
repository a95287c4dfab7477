//! Motions of the whole trunk: bending, throwing, stretching.

use glam::Vec3;

use super::{ELBOW_BACK, ELBOW_DOWN, ELBOW_OUT, ELBOW_UP, film, reach, towards};
use crate::actor::Actor;
use crate::control::{Control, SIDE_SIGN};
use crate::track::Track;
use crate::values::Values;

/// Bends down and picks something up.
pub(super) fn pick_up(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let rest = actor.standing();
    let speed = v.speed();
    let knees = actor.dice.range(0.24, 0.36);
    let jitter = 0.04 * actor.dice.bell();
    let ahead = actor.m(0.3 + jitter);
    let mut track = Track::new(rest);
    track.hold(0.1);
    let both = v.sides().len() == 2;
    let lean: f32 = if both { 0.0 } else { SIDE_SIGN[v.sides()[0]] };
    track.to(actor.s(0.95, speed), |c| {
        c.hip.y = rest.hip.y - actor.m(knees);
        c.pitch = 0.95;
        c.flex = 0.75;
        c.nod = -0.1;
        c.twist = -0.22 * lean;
        c.side = 0.12 * lean;
        for side in 0..2 {
            c.feet[side].knee_out = 0.12;
            reach(c, side, -0.75, 0.1, 0.75, ELBOW_OUT);
        }
        for side in v.sides() {
            let x = SIDE_SIGN[*side] * actor.m(if both { 0.13 } else { 0.1 });
            c.arms[*side].world = Vec3::new(x, actor.m(0.2), ahead);
            c.arms[*side].world_weight = 1.0;
            c.arms[*side].pole = ELBOW_BACK;
        }
    });
    track.to(actor.s(0.3, speed), |c| {
        for side in v.sides() {
            c.arms[*side].world.y -= actor.m(0.03);
            c.arms[*side].flex = 0.4;
        }
    });
    track.to(actor.s(0.95, speed), |c| {
        let arms = c.arms;
        *c = rest;
        for side in v.sides() {
            c.arms[*side].world = arms[*side].world;
            reach(c, *side, -0.75, 0.0, 0.68, ELBOW_BACK);
        }
    });
    track.hold(actor.s(0.3, speed));
    track.to(actor.s(0.55, speed), |c| {
        let arms = c.arms;
        *c = rest;
        for side in 0..2 {
            c.arms[side].world = arms[side].world;
        }
    });
    track.hold(0.2);
    film(&track, actor)
}

/// Throws something forward.
pub(super) fn throw(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let rest = actor.standing();
    let speed = v.speed();
    let both = v.sides().len() == 2;
    let main = v.sides()[0];
    let sign = if both { 0.0 } else { SIDE_SIGN[main] };
    // The foot opposite to the throwing hand takes the step.
    let step = if both { actor.dice.index(2) } else { 1 - main };
    let under = v.word("style") == "underhand";
    let length = Vec3::Z * actor.m(0.34);
    let mut track = Track::new(rest);
    track.hold(0.1);
    for _ in 0..v.count("repetitions") {
        track.to(actor.s(0.6, speed), |c| {
            c.twist = 0.55 * sign;
            c.yaw = 0.15 * sign;
            c.bias = if step == 0 { 0.2 } else { 0.8 };
            c.flex = if under {
                rest.flex + 0.2
            } else {
                rest.flex - 0.12
            };
            for side in v.sides() {
                match (under, both) {
                    (true, _) => reach(c, *side, -2.2, -0.1, 0.96, ELBOW_BACK),
                    (false, true) => reach(c, *side, 1.75, 0.1, 0.62, ELBOW_UP),
                    (false, false) => reach(c, *side, 0.75, 1.75, 0.55, Vec3::new(1.0, -0.3, -0.1)),
                }
            }
            if !both {
                reach(c, 1 - main, -0.3, 0.3, 0.85, ELBOW_OUT);
            }
        });
        track.to(actor.s(0.2, speed), |c| {
            c.feet[step].at = rest.feet[step].at + length * 0.6 + Vec3::Y * actor.m(0.06);
            c.feet[step].pitch = 0.1;
        });
        track.to(actor.s(0.16, speed).max(0.12 * actor.rig.scale), |c| {
            c.feet[step].at = rest.feet[step].at + length;
            c.feet[step].pitch = 0.0;
            c.bias = 0.5;
            c.twist = 0.1 * sign;
            c.hip.y = rest.hip.y - actor.m(0.03);
            for side in v.sides() {
                match (under, both) {
                    (true, _) => reach(c, *side, -1.57, 0.0, 0.97, ELBOW_BACK),
                    _ => reach(c, *side, 1.0, 0.5, 0.72, ELBOW_OUT),
                }
            }
        });
        track.to(actor.s(0.16, speed).max(0.12 * actor.rig.scale), |c| {
            c.twist = -0.45 * sign;
            c.yaw = -0.1 * sign;
            c.pitch = rest.pitch + 0.2;
            c.flex = rest.flex + 0.2;
            c.bias = if step == 0 { 0.7 } else { 0.3 };
            c.feet[1 - step].pitch = -0.4;
            for side in v.sides() {
                reach(
                    c,
                    *side,
                    if under { 0.1 } else { 0.15 },
                    0.1,
                    0.96,
                    ELBOW_DOWN,
                );
            }
            if !both {
                reach(c, 1 - main, -1.1, 0.6, 0.8, ELBOW_BACK);
            }
        });
        track.to(actor.s(0.22, speed), |c| {
            for side in v.sides() {
                reach(
                    c,
                    *side,
                    if under { 0.4 } else { -0.75 },
                    -0.3 * sign.abs(),
                    0.9,
                    ELBOW_DOWN,
                );
            }
        });
        track.to(actor.s(0.35, speed), |c| {
            let feet = c.feet;
            *c = rest;
            c.feet[step] = feet[step];
            c.bias = super::weight_off(step);
        });
        track.to(actor.s(0.22, speed), |c| {
            c.feet[step].at = rest.feet[step].at + length * 0.5 + Vec3::Y * actor.m(0.06);
            c.feet[step].pitch = -0.1;
        });
        track.to(actor.s(0.3, speed), |c| *c = rest);
    }
    track.hold(0.2);
    film(&track, actor)
}

/// Bends over to touch the toes with straight knees.
pub(super) fn toe_touch(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let rest = actor.standing();
    let speed = v.speed();
    let mut track = Track::new(rest);
    track.hold(0.1);
    for n in 0..v.count("repetitions") {
        track.to(actor.s(1.0, speed), |c| {
            c.pitch = 1.15;
            c.flex = 1.1;
            c.nod = 0.15;
            c.hip.y = rest.hip.y - actor.m(0.02);
            for (side, sign) in SIDE_SIGN.iter().enumerate() {
                reach(c, side, -0.5, 0.05, 0.98, ELBOW_OUT);
                c.arms[side].world = Vec3::new(sign * actor.m(0.1), actor.m(0.16), actor.m(0.14));
                c.arms[side].world_weight = 1.0;
            }
        });
        track.hold(actor.s(0.25, speed));
        track.to(actor.s(1.0, speed), |c| {
            let arms = c.arms;
            *c = rest;
            for side in 0..2 {
                c.arms[side].world = arms[side].world;
            }
        });
        if n + 1 < v.count("repetitions") {
            track.hold(actor.s(0.15, speed));
        }
    }
    track.hold(0.2);
    film(&track, actor)
}

/// Bows.
pub(super) fn bow(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let rest = actor.standing();
    let speed = v.speed();
    let mut track = Track::new(rest);
    track.hold(0.15);
    for n in 0..v.count("repetitions") {
        let depth = actor.a(0.62) * v.amplitude();
        track.to(actor.s(0.85, speed), |c| {
            c.pitch = depth;
            c.flex = rest.flex + 0.5 * depth;
            c.nod = 0.15;
            for side in 0..2 {
                c.arms[side].elevation = rest.arms[side].elevation + 0.35 * depth;
                c.arms[side].azimuth = 0.5;
            }
        });
        track.hold(actor.s(0.45, speed));
        track.to(actor.s(0.85, speed), |c| *c = rest);
        if n + 1 < v.count("repetitions") {
            track.hold(actor.s(0.25, speed));
        }
    }
    track.hold(0.2);
    film(&track, actor)
}

/// Stretches both arms up with the back arched, on tiptoe.
pub(super) fn stretch(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let rest = actor.standing();
    let speed = v.speed();
    let size = v.amplitude();
    let mut track = Track::new(rest);
    track.hold(0.15);
    for n in 0..v.count("repetitions") {
        let high = 1.32 + 0.08 * actor.dice.bell();
        track.to(actor.s(1.1, speed), |c| {
            for side in 0..2 {
                reach(c, side, high, 0.5, 0.93, ELBOW_UP);
            }
            c.flex = rest.flex - 0.1 * size;
        });
        track.to(actor.s(0.7, speed), |c| {
            for side in 0..2 {
                reach(c, side, high + 0.12, 0.3, 0.985, ELBOW_UP);
                c.feet[side].pitch = -0.45 * size;
            }
            c.hip.y = rest.hip.y + actor.m(0.055) * size;
            c.flex = rest.flex - 0.28 * size;
            c.nod = rest.nod - 0.25;
        });
        track.hold(actor.s(0.6, speed));
        track.to(actor.s(1.1, speed), |c| *c = rest);
        if n + 1 < v.count("repetitions") {
            track.hold(actor.s(0.2, speed));
        }
    }
    track.hold(0.2);
    film(&track, actor)
}

/// Bends to one side with the other arm over the head.
pub(super) fn side_bend(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let rest = actor.standing();
    let speed = v.speed();
    let sign = towards(v.word("direction")).x;
    let over = usize::from(sign > 0.0);
    let mut track = Track::new(rest);
    track.hold(0.1);
    for n in 0..v.count("repetitions") {
        let bend = (actor.a(0.55) * v.amplitude()).min(0.85);
        track.to(actor.s(0.95, speed), |c| {
            c.side = sign * bend;
            c.roll = -sign * 0.12;
            c.tilt = sign * 0.2;
            reach(c, over, 1.25, -0.4, 0.9, ELBOW_UP);
            reach(c, 1 - over, -1.4, 1.2, 0.97, ELBOW_BACK);
        });
        track.hold(actor.s(0.3, speed));
        track.to(actor.s(0.85, speed), |c| *c = rest);
        if n + 1 < v.count("repetitions") {
            track.hold(actor.s(0.1, speed));
        }
    }
    track.hold(0.2);
    film(&track, actor)
}

/// Twists alternately to both sides, beginning with `direction`.
pub(super) fn twist(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let rest = actor.standing();
    let speed = v.speed();
    let first = towards(v.word("direction")).x;
    let mut track = Track::new(rest);
    let bent = -0.35 + 0.1 * actor.dice.bell();
    track.to(actor.s(0.5, speed), |c| {
        for side in 0..2 {
            reach(c, side, bent, 0.0, 0.55, ELBOW_OUT);
        }
    });
    for _ in 0..v.count("repetitions") {
        for sign in [first, -first] {
            let angle = (actor.a(0.75) * v.amplitude()).min(1.05);
            track.to(actor.s(0.6, speed), |c| {
                c.twist = sign * angle;
                c.yaw = sign * 0.22;
                c.look = sign * 0.25;
            });
        }
    }
    track.to(actor.s(0.6, speed), |c| *c = rest);
    track.hold(0.2);
    film(&track, actor)
}
