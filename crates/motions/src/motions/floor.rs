//! Transitions between standing and lower postures: chairs, the floor, kneeling, falls.

use std::f32::consts::FRAC_PI_2;

use glam::Vec3;

use super::{ELBOW_BACK, ELBOW_OUT, film, reach, towards};
use crate::actor::Actor;
use crate::control::{Control, SIDE_SIGN};
use crate::track::Track;
use crate::values::Values;

/// Sits down on a chair behind the person.
pub(super) fn sit_down(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let (rest, seated) = (actor.standing(), actor.seated());
    let speed = v.speed();
    let lean = actor.a(0.55);
    let mut track = Track::new(rest);
    track.hold(0.15);
    track.to(actor.s(0.75, speed), |c| {
        c.hip = rest.hip.lerp(seated.hip, 0.6);
        c.balance = 0.25;
        c.pitch = lean;
        c.flex = 0.4;
        c.nod = -0.2;
        for side in 0..2 {
            reach(c, side, -0.95, 0.1, 0.86, ELBOW_BACK);
            c.feet[side].knee_out = 0.1;
        }
    });
    track.to(actor.s(0.5, speed), |c| {
        c.hip = seated.hip;
        c.balance = 0.0;
        c.pitch = 0.35;
        c.flex = 0.35;
        c.nod = -0.1;
    });
    track.to(actor.s(0.6, speed), |c| *c = seated);
    track.hold(0.5);
    film(&track, actor)
}

/// Stands up from a chair.
pub(super) fn stand_up(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let (rest, seated) = (actor.standing(), actor.seated());
    let speed = v.speed();
    let lean = actor.a(0.6);
    let mut track = Track::new(seated);
    track.hold(0.3);
    track.to(actor.s(0.55, speed), |c| {
        c.pitch = lean;
        c.flex = 0.5;
        c.nod = -0.3;
        for side in 0..2 {
            reach(c, side, -0.85, 0.0, 0.82, ELBOW_BACK);
        }
    });
    track.to(actor.s(0.45, speed), |c| {
        c.hip = seated.hip.lerp(rest.hip, 0.45);
        c.balance = 0.45;
        c.pitch = 0.7 * lean;
        c.flex = 0.4;
        for side in 0..2 {
            reach(c, side, -1.1, 0.1, 0.9, ELBOW_BACK);
        }
    });
    track.to(actor.s(0.65, speed), |c| *c = rest);
    track.hold(0.3);
    film(&track, actor)
}

/// Intermediate pose between standing and lying: seated on the floor, knees drawn up, hands behind.
fn on_the_floor(actor: &Actor, rest: &Control) -> Control {
    let mut c = *rest;
    c.hip = Vec3::new(0.0, actor.m(0.1), rest.feet[0].at.z - actor.m(0.5));
    c.pitch = -0.2;
    c.flex = 0.35;
    c.nod = 0.1;
    c.balance = 0.0;
    for (side, sign) in SIDE_SIGN.iter().enumerate() {
        c.feet[side].at.z = rest.feet[0].at.z;
        c.feet[side].knee_out = 0.12;
        let arm = &mut c.arms[side];
        arm.world = Vec3::new(sign * actor.m(0.32), actor.m(0.05), c.hip.z - actor.m(0.22));
        arm.world_weight = 1.0;
        arm.pole = Vec3::new(0.6, 0.2, -1.0);
    }
    c
}

/// A low squat with one hand reaching for the floor behind.
fn low_squat(actor: &Actor, rest: &Control, hand: usize) -> Control {
    let mut c = *rest;
    c.hip = Vec3::new(0.0, actor.m(0.33), rest.feet[0].at.z - actor.m(0.2));
    c.pitch = 0.3;
    c.flex = 0.55;
    c.nod = -0.2;
    c.balance = 0.4;
    for side in 0..2 {
        c.feet[side].knee_out = 0.25;
        c.feet[side].pitch = -0.15;
        reach(&mut c, side, -0.55, 0.2, 0.8, ELBOW_OUT);
    }
    let arm = &mut c.arms[hand];
    arm.world = Vec3::new(
        SIDE_SIGN[hand] * actor.m(0.36),
        actor.m(0.07),
        rest.feet[0].at.z - actor.m(0.5),
    );
    arm.world_weight = 0.85;
    arm.pole = Vec3::new(0.7, 0.2, -1.0);
    c
}

/// Lies down on the back.
pub(super) fn lie_down(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let (rest, lying) = (actor.standing(), actor.lying());
    let speed = v.speed();
    let hand = actor.dice.index(2);
    let squat = low_squat(actor, &rest, hand);
    let sitting = on_the_floor(actor, &rest);
    let mut track = Track::new(rest);
    track.hold(0.15);
    track.to(actor.s(0.95, speed), |c| *c = squat);
    track.to(actor.s(0.6, speed), |c| *c = sitting);
    track.to(actor.s(0.45, speed), |c| {
        c.pitch = -0.75;
        c.hip.z = 0.5 * (c.hip.z + lying.hip.z);
        c.flex = 0.45;
        c.nod = 0.3;
        for (side, sign) in SIDE_SIGN.iter().enumerate() {
            c.arms[side].world += Vec3::new(sign * actor.m(0.1), 0.0, -actor.m(0.05));
        }
    });
    track.to(actor.s(0.7, speed), |c| {
        let feet = c.feet;
        let arms = c.arms;
        *c = lying;
        for side in 0..2 {
            c.feet[side] = feet[side];
            c.feet[side].at.z += actor.m(0.12);
            c.feet[side].pitch = 0.15;
            c.arms[side].world = arms[side].world;
        }
    });
    track.to(actor.s(0.6, speed), |c| *c = lying);
    track.hold(0.5);
    film(&track, actor)
}

/// Gets up from lying on the back.
pub(super) fn get_up(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let (rest, lying) = (actor.standing(), actor.lying());
    let speed = v.speed();
    let hand = actor.dice.index(2);
    let sitting = on_the_floor(actor, &rest);
    let squat = low_squat(actor, &rest, hand);
    let mut track = Track::new(lying);
    track.hold(0.3);
    track.to(actor.s(0.65, speed), |c| {
        c.pitch = -1.0;
        c.flex = 0.55;
        c.nod = 0.45;
        c.hip.z = 0.5 * (c.hip.z + sitting.hip.z);
        for (side, sign) in SIDE_SIGN.iter().enumerate() {
            c.feet[side].at.z = sitting.feet[side].at.z + actor.m(0.12);
            c.feet[side].pitch = 0.15;
            c.feet[side].yaw = sitting.feet[side].yaw;
            c.arms[side].world =
                Vec3::new(sign * actor.m(0.4), actor.m(0.05), c.hip.z - actor.m(0.28));
            c.arms[side].world_weight = 1.0;
            c.arms[side].pole = sitting.arms[side].pole;
        }
    });
    track.to(actor.s(0.6, speed), |c| *c = sitting);
    track.to(actor.s(0.7, speed), |c| *c = squat);
    track.to(actor.s(0.85, speed), |c| *c = rest);
    track.hold(0.35);
    film(&track, actor)
}

/// Falls to the floor.
pub(super) fn fall(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let way = v.word("direction");
    let speed = v.speed();
    let mut track = Track::new(actor.standing());
    track.hold(0.3);
    match way {
        "forward" => fall_forward(&mut track, actor, speed),
        "backward" => fall_backward(&mut track, actor, speed),
        _ => fall_sideways(&mut track, actor, speed, towards(way).x),
    }
    track.hold(0.6);
    film(&track, actor)
}

fn fall_forward(track: &mut Track, actor: &mut Actor, speed: f32) {
    let rest = actor.standing();
    let foot_z = rest.feet[0].at.z;
    let mut tucked = rest.feet[0];
    tucked.pitch = -1.5;
    let prone_z = actor.rig.ankle(&tucked).0.z + 0.995 * actor.rig.leg_m + actor.m(0.073);
    track.to(actor.s(0.3, speed), |c| {
        c.balance = 0.0;
        c.hip = Vec3::new(0.0, 0.93 * rest.hip.y, foot_z + actor.m(0.22));
        c.pitch = 0.35;
        c.flex = 0.3;
        c.nod = -0.2;
        for side in 0..2 {
            reach(c, side, -0.5, 0.1, 0.85, ELBOW_OUT);
            c.feet[side].pitch = -0.45;
        }
    });
    track.to(actor.s(0.3, speed), |c| {
        c.hip = Vec3::new(0.0, actor.m(0.5), foot_z + actor.m(0.62));
        c.pitch = 0.95;
        c.flex = 0.2;
        c.nod = -0.4;
        for (side, sign) in SIDE_SIGN.iter().enumerate() {
            c.feet[side].pitch = -1.05;
            c.arms[side].world =
                Vec3::new(sign * actor.m(0.3), actor.m(0.06), c.hip.z + actor.m(0.66));
            c.arms[side].world_weight = 1.0;
            c.arms[side].pole = Vec3::new(1.0, 0.0, 0.0);
        }
    });
    let turn = 0.5 * actor.dice.bell();
    track.to(actor.s(0.3, speed), |c| {
        c.hip = Vec3::new(0.0, actor.m(0.115), prone_z);
        c.pitch = FRAC_PI_2;
        c.flex = -0.12;
        c.nod = -0.25;
        c.look = turn;
        for (side, sign) in SIDE_SIGN.iter().enumerate() {
            c.feet[side].pitch = -1.5;
            c.arms[side].world = Vec3::new(
                sign * actor.m(0.36),
                actor.m(0.045),
                c.hip.z + actor.m(0.62),
            );
        }
    });
    track.to(actor.s(0.4, speed), |c| {
        c.flex = 0.0;
        c.nod = -0.05;
        c.look = 2.0 * turn;
    });
}

fn fall_backward(track: &mut Track, actor: &mut Actor, speed: f32) {
    let (rest, lying) = (actor.standing(), actor.lying());
    track.to(actor.s(0.28, speed), |c| {
        c.balance = 0.0;
        c.hip = Vec3::new(0.0, 0.9 * rest.hip.y, rest.hip.z - actor.m(0.2));
        c.pitch = -0.12;
        c.flex = 0.35;
        c.nod = 0.25;
        for side in 0..2 {
            reach(c, side, -0.2, 0.4, 0.85, ELBOW_OUT);
            c.feet[side].pitch = 0.12;
        }
    });
    track.to(actor.s(0.32, speed), |c| {
        c.hip = Vec3::new(0.0, actor.m(0.3), lying.hip.z + actor.m(0.16));
        c.pitch = -0.4;
        c.flex = 0.5;
        c.nod = 0.4;
        for (side, sign) in SIDE_SIGN.iter().enumerate() {
            c.feet[side].pitch = 0.3;
            c.arms[side].world =
                Vec3::new(sign * actor.m(0.4), actor.m(0.1), c.hip.z - actor.m(0.3));
            c.arms[side].world_weight = 0.8;
        }
    });
    track.to(actor.s(0.14, speed), |c| {
        c.hip = Vec3::new(0.0, actor.m(0.11), lying.hip.z + actor.m(0.05));
        c.pitch = -0.85;
        c.flex = 0.5;
    });
    track.to(actor.s(0.3, speed), |c| {
        let feet = c.feet;
        *c = lying;
        for side in 0..2 {
            c.feet[side] = lying.feet[side];
            c.feet[side].at = feet[side].at.lerp(lying.feet[side].at, 0.5);
            c.feet[side].at.y = actor.m(0.1);
            c.feet[side].pitch = 0.75;
            reach(c, side, -0.75, 1.55, 0.94, ELBOW_OUT);
        }
    });
    track.to(actor.s(0.4, speed), |c| c.feet = lying.feet);
}

fn fall_sideways(track: &mut Track, actor: &mut Actor, speed: f32, sign: f32) {
    let rest = actor.standing();
    let low = usize::from(sign < 0.0);
    let high = 1 - low;
    track.to(actor.s(0.3, speed), |c| {
        c.balance = 0.0;
        c.hip = Vec3::new(sign * actor.m(0.24), 0.9 * rest.hip.y, 0.0);
        c.roll = -sign * 0.3;
        c.side = sign * 0.15;
        reach(c, low, -0.6, 1.4, 0.9, ELBOW_OUT);
        reach(c, high, -0.2, 1.2, 0.9, ELBOW_OUT);
        c.feet[high].roll = -sign * 0.2;
    });
    track.to(actor.s(0.32, speed), |c| {
        c.hip = Vec3::new(sign * actor.m(0.52), actor.m(0.42), 0.0);
        c.roll = -sign * 0.85;
        c.side = -sign * 0.1;
        c.flex = 0.25;
        c.arms[low].world = Vec3::new(c.hip.x + sign * actor.m(0.7), actor.m(0.06), actor.m(0.12));
        c.arms[low].world_weight = 1.0;
        for foot in &mut c.feet {
            foot.roll = -sign * 0.7;
        }
        reach(c, high, 0.0, 0.8, 0.85, ELBOW_OUT);
    });
    track.to(actor.s(0.3, speed), |c| {
        c.hip = Vec3::new(sign * actor.m(0.66), actor.m(0.16), 0.0);
        c.roll = -sign * FRAC_PI_2;
        c.side = -sign * 0.08;
        c.flex = 0.3;
        c.tilt = -sign * 0.1;
        c.arms[low].world = Vec3::new(
            c.hip.x + sign * actor.m(0.62),
            actor.m(0.045),
            actor.m(0.36),
        );
        c.arms[high].world =
            Vec3::new(c.hip.x + sign * actor.m(0.42), actor.m(0.05), actor.m(0.38));
        c.arms[high].world_weight = 1.0;
        for side in 0..2 {
            let z = actor.m(if side == low { 0.1 } else { 0.02 });
            let ankle = Vec3::new(c.hip.x - sign * actor.m(0.68), 0.0, z);
            let mut foot = actor.rig.foot_for_ankle(ankle, 0.0, 0.0, -sign * 1.45);
            // The upper foot rests on the lower one.
            foot.at.y = if side == high { actor.m(0.09) } else { 0.0 };
            c.feet[side] = foot;
        }
    });
    track.to(actor.s(0.4, speed), |c| c.nod = 0.15);
}

/// Crouches down, waits and rises.
pub(super) fn crouch(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let rest = actor.standing();
    let speed = v.speed();
    let depth = (0.58 * v.amplitude()).min(0.72) * actor.style.size.clamp(0.9, 1.08);
    let mut track = Track::new(rest);
    track.hold(0.15);
    track.to(actor.s(0.9, speed), |c| {
        c.hip.y = rest.hip.y * (1.0 - depth);
        c.pitch = 0.35;
        c.flex = 0.55;
        c.nod = -0.35;
        for side in 0..2 {
            c.feet[side].pitch = -0.28;
            c.feet[side].knee_out = 0.3;
            reach(c, side, -0.6, 0.0, 0.72, ELBOW_OUT);
        }
    });
    track.to(actor.s(0.9, speed), |c| c.flex += 0.05);
    track.to(actor.s(0.85, speed), |c| *c = rest);
    track.hold(0.3);
    film(&track, actor)
}

/// Kneels on one knee and rises.
pub(super) fn kneel(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let rest = actor.standing();
    let speed = v.speed();
    let side = v.sides()[0];
    let front = 1 - side;
    let back_m = actor.m(0.74);
    let mut behind = rest.feet[side];
    behind.at.z -= back_m;
    behind.pitch = -1.25;
    let over_knee_z = actor.rig.ankle(&behind).0.z + actor.m(0.41);
    let mut track = Track::new(rest);
    track.to(actor.s(0.35, speed), |c| {
        c.bias = super::weight_off(side);
        c.feet[side].at += Vec3::new(0.0, actor.m(0.07), -0.5 * back_m);
        c.feet[side].pitch = -0.5;
        c.pitch = 0.12;
    });
    track.to(actor.s(0.35, speed), |c| {
        c.bias = 0.5;
        c.hip.y = 0.86 * rest.hip.y;
        c.feet[side].at.y = 0.0;
        c.feet[side].at.z = rest.feet[side].at.z - back_m;
        c.feet[side].pitch = -0.8;
        c.pitch = 0.2;
        c.flex = 0.2;
    });
    let knee = actor.m(0.53);
    track.to(actor.s(0.7, speed), |c| {
        c.hip.y = knee;
        c.balance = 0.0;
        c.hip.x = 0.0;
        c.hip.z = over_knee_z;
        c.feet[side].pitch = -1.25;
        c.pitch = 0.06;
        c.flex = 0.15;
        reach(c, front, -0.75, 0.05, 0.8, ELBOW_BACK);
    });
    track.hold(actor.s(0.8, speed));
    track.to(actor.s(0.6, speed), |c| {
        c.hip.y = 0.86 * rest.hip.y;
        c.balance = 1.0;
        c.feet[side].pitch = -0.8;
        c.pitch = 0.3;
        c.flex = 0.25;
    });
    track.to(actor.s(0.35, speed), |c| {
        c.bias = super::weight_off(side);
        c.hip.y = 0.97 * rest.hip.y;
        c.feet[side].at += Vec3::new(0.0, actor.m(0.07), 0.5 * back_m);
        c.feet[side].pitch = -0.5;
        c.pitch = 0.12;
    });
    track.to(actor.s(0.4, speed), |c| *c = rest);
    track.hold(0.25);
    film(&track, actor)
}
