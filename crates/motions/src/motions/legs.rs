//! Leg motions performed while standing.

use glam::Vec3;

use super::{ELBOW_BACK, ELBOW_DOWN, ELBOW_OUT, acting_side, film, reach, towards, weight_off};
use crate::actor::Actor;
use crate::control::{Control, SIDE_SIGN};
use crate::track::Track;
use crate::values::Values;

/// Squats with the arms in front.
pub(super) fn squat(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let rest = actor.standing();
    let speed = v.speed();
    let depth = (0.42 * v.amplitude()).min(0.6);
    let mut track = Track::new(rest);
    let wide = actor.m(0.04);
    let in_front = v.word("arms") != "still";
    track.hold(0.1);
    for _ in 0..v.count("repetitions") {
        let depth = actor.a(depth).clamp(0.18, 0.62);
        track.to(actor.s(0.8, speed), |c| {
            c.hip.y = rest.hip.y * (1.0 - depth);
            let lean = v.given("lean_deg").map(f32::to_radians);
            c.pitch = lean.unwrap_or(0.35 + 0.5 * depth);
            c.flex = 0.18;
            c.nod = -0.35;
            for side in 0..2 {
                c.feet[side].knee_out = 0.3;
                if in_front {
                    reach(c, side, 0.35, 0.02, 0.95, ELBOW_DOWN);
                }
            }
        });
        track.to(actor.s(0.15, speed), |c| c.hip.y -= 0.2 * wide);
        track.to(actor.s(0.75, speed), |c| {
            let arms = c.arms;
            *c = rest;
            for side in (0..2).filter(|_| in_front) {
                c.arms[side].elevation =
                    0.5 * (arms[side].elevation + rest.arms[side].elevation) - 0.4;
            }
        });
        track.hold(0.05);
    }
    track.to(actor.s(0.3, speed), |c| *c = rest);
    track.hold(0.2);
    film(&track, actor)
}

/// Steps out with one leg, lowers the body and steps back.
pub(super) fn lunge(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let rest = actor.standing();
    let speed = v.speed();
    let side = acting_side(v);
    let other = 1 - side;
    let way = towards(v.word("direction"));
    let sideways = way.x != 0.0;
    let size = v.amplitude();
    let mut track = Track::new(rest);
    track.hold(0.1);
    let in_place = v.word("feet") == "in_place";
    // With the feet in place, the front foot is also beside the other one, and the body moves over it.
    let aside = match in_place && way.z > 0.0 {
        true => actor.dice.range(0.0, 1.05),
        false => 0.0,
    };
    let way = match aside > 0.0 {
        true => Vec3::new(SIDE_SIGN[side] * aside.sin(), 0.0, aside.cos()),
        false => way,
    };
    // Many hardly lower the body. Some hold their hands in front of the chest, others let the arms hang.
    let depth = actor.dice.range(0.35, 1.05);
    let arms = match actor.dice.index(3) {
        0 => Some((-0.3, -0.2, 0.5)),
        1 => Some((-0.9, 0.35, 0.72)),
        _ => None,
    };
    // The deeper somebody goes to the side, the more the trunk leans.
    let lean = if sideways {
        actor.dice.range(0.2, 1.0) * depth
    } else {
        1.0
    };
    // Who does not step takes more time for each repetition.
    let slower = if in_place {
        actor.dice.range(1.0, 2.0)
    } else {
        1.0
    };
    let times = v.count("repetitions");
    for n in 0..times {
        // With the feet in place only the first repetition steps out and only the last one steps back.
        let (steps_out, steps_back) = (!in_place || n == 0, !in_place || n + 1 == times);
        let length_m =
            actor.a(if sideways { 0.62 } else { 0.78 }) * size.clamp(0.6, 1.15) * actor.rig.scale;
        let sink_m = actor.a(if sideways { 0.24 } else { 0.3 }) * depth * size * actor.rig.scale;
        if steps_out {
            track.to(actor.s(0.38, speed), |c| {
                c.bias = weight_off(side);
                c.feet[side].at =
                    rest.feet[side].at + way * (0.5 * length_m) + Vec3::Y * actor.m(0.1);
                c.feet[side].pitch = if way.z > 0.0 { 0.1 } else { -0.4 };
            });
            track.to(actor.s(0.34, speed), |c| {
                c.bias = if side == 0 { 0.4 } else { 0.6 };
                c.feet[side].at = rest.feet[side].at + way * length_m;
                c.feet[side].pitch = if way.z < 0.0 { -0.55 } else { 0.0 };
                if way.z > 0.0 {
                    c.feet[other].pitch = -0.35;
                }
                c.hip.y = rest.hip.y - 0.4 * sink_m;
            });
        }
        track.to(actor.s(0.5 * slower, speed), |c| {
            c.hip.y = rest.hip.y - sink_m;
            c.pitch = if sideways { 0.4 * lean } else { 0.1 };
            c.flex = if sideways { 0.25 * lean } else { 0.08 };
            // In a sideways lunge the weight shifts over the bent leg; otherwise it remains between
            // the feet.
            c.bias = match (sideways, side) {
                (true, 0) => 0.78,
                (true, _) => 0.22,
                (false, 0) => 0.5 + 0.25 * aside.sin(),
                (false, _) => 0.5 - 0.25 * aside.sin(),
            };
            if way.z > 0.0 {
                c.feet[other].pitch = -0.9;
            } else if way.z < 0.0 {
                c.feet[side].pitch = -0.95;
            }
            if let Some((elevation, azimuth, stretched)) = arms {
                for s in 0..2 {
                    reach(c, s, elevation, azimuth, stretched, ELBOW_BACK);
                }
            }
        });
        track.hold(actor.s(0.15 * slower, speed));
        track.to(actor.s(0.42 * slower, speed), |c| {
            c.hip.y = rest.hip.y - 0.35 * sink_m;
            c.bias = if side == 0 { 0.3 } else { 0.7 };
            c.feet[other].pitch = if way.z > 0.0 { -0.35 } else { 0.0 };
            c.pitch = 0.1;
        });
        if steps_back {
            track.to(actor.s(0.3, speed), |c| {
                c.bias = weight_off(side);
                c.hip.y = rest.hip.y;
                c.feet[side].at =
                    rest.feet[side].at + way * (0.45 * length_m) + Vec3::Y * actor.m(0.09);
                c.feet[side].pitch = -0.2;
                c.feet[other].pitch = 0.0;
            });
            track.to(actor.s(0.4, speed), |c| *c = rest);
            track.hold(0.08);
        }
    }
    track.hold(0.15);
    film(&track, actor)
}

/// Kicks with one leg.
pub(super) fn kick(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let rest = actor.standing();
    let speed = v.speed();
    let side = acting_side(v);
    let other = 1 - side;
    let sign = SIDE_SIGN[side];
    let way = towards(v.word("direction"));
    let mut track = Track::new(rest);
    track.to(actor.s(0.35, speed), |c| {
        c.bias = weight_off(side);
        c.hip.y -= actor.m(0.025);
        for s in 0..2 {
            reach(c, s, -0.95, 0.6, 0.72, ELBOW_BACK);
        }
    });
    for n in 0..v.count("repetitions") {
        let size = v.amplitude() * (actor.a(1.0)).clamp(0.85, 1.15);
        let home = rest.feet[side].at;
        // Chamber phase: the knee is raised, or the leg swings back first.
        track.to(actor.s(0.3, speed), |c| {
            let chamber = match (way.z > 0.0, way.z < 0.0) {
                (true, _) => Vec3::new(0.0, 0.2, -0.22),
                (_, true) => Vec3::new(0.0, 0.28, 0.12),
                _ => Vec3::new(0.05 * sign, 0.34, 0.08),
            };
            c.feet[side].at = home + chamber * actor.rig.scale;
            c.feet[side].pitch = if way.z < 0.0 { -0.1 } else { -0.7 };
            c.pitch = if way.z < 0.0 { 0.15 } else { 0.0 };
            reach(c, other, -0.8, 0.3, 0.75, ELBOW_BACK);
            reach(c, side, -1.0, 0.7, 0.75, ELBOW_BACK);
        });
        // Lower limit on the duration of the leg swing at any requested speed.
        track.to(actor.s(0.22, speed).max(0.17 * actor.rig.scale), |c| {
            let goal = match (way.z > 0.0, way.z < 0.0) {
                (true, _) => Vec3::new(0.0, 0.5 * size, 0.72),
                (_, true) => Vec3::new(0.0, 0.38 * size, -0.72),
                _ => Vec3::new(0.72 * sign, 0.48 * size, 0.05),
            };
            c.feet[side].at = home + goal * actor.rig.scale;
            c.feet[side].pitch = if way.z > 0.0 {
                0.25
            } else if way.z < 0.0 {
                -0.9
            } else {
                0.0
            };
            if way.x != 0.0 {
                c.roll = sign * 0.32 * size;
                c.side = -sign * 0.1;
                c.feet[side].roll = sign * 0.5;
            } else {
                c.pitch = if way.z > 0.0 {
                    -0.14 * size
                } else {
                    0.42 * size
                };
                c.flex = if way.z > 0.0 { 0.22 } else { 0.1 };
                c.yaw = -sign * 0.18 * way.z;
            }
            reach(c, other, -0.45, 0.25, 0.8, ELBOW_OUT);
            reach(c, side, -1.0, 1.2, 0.85, ELBOW_BACK);
        });
        track.to(actor.s(0.3, speed), |c| {
            c.feet[side].at = home + Vec3::new(0.0, 0.2, 0.1 * way.z) * actor.rig.scale;
            c.feet[side].pitch = -0.3;
            c.feet[side].roll = 0.0;
            (c.roll, c.side, c.yaw, c.pitch, c.flex) = (0.0, 0.0, 0.0, rest.pitch, rest.flex);
        });
        if n + 1 < v.count("repetitions") {
            track.to(actor.s(0.25, speed), |c| {
                c.feet[side].at = home + Vec3::Y * actor.m(0.02);
                c.feet[side].pitch = -0.2;
            });
        }
    }
    track.to(actor.s(0.25, speed), |c| {
        c.feet[side].at = rest.feet[side].at;
        c.feet[side].pitch = 0.0;
    });
    track.to(actor.s(0.4, speed), |c| *c = rest);
    track.hold(0.2);
    film(&track, actor)
}

/// Raises one straight leg and lowers it, alone or with the arm of that side.
pub(super) fn leg_raise(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let rest = actor.standing();
    let speed = v.speed();
    let side = v.sides()[0];
    let other = 1 - side;
    let sign = SIDE_SIGN[side];
    let direction = v.word("direction");
    let arm_up = actor.dice.range(0.0, 0.9);
    let stretched = actor.dice.range(0.65, 0.95);
    let mut track = Track::new(rest);
    let mut ready = rest;
    ready.bias = weight_off(side);
    track.to(actor.s(0.4, speed), |c| *c = ready);
    for n in 0..v.count("repetitions") {
        let size = v.amplitude() * actor.a(1.0).clamp(0.85, 1.15);
        let goal = match direction {
            "forward" => Vec3::new(0.0, 0.24 * size, 0.46),
            "backward" => Vec3::new(0.0, 0.2 * size, -0.44),
            _ => Vec3::new(0.46 * sign, 0.24 * size, 0.03),
        };
        track.to(actor.s(0.85, speed), |c| {
            c.feet[side].at = rest.feet[side].at + goal * actor.rig.scale;
            match direction {
                "forward" => {
                    c.feet[side].pitch = 0.3;
                    c.pitch = rest.pitch - 0.08 * size;
                }
                "backward" => {
                    c.feet[side].pitch = -0.8;
                    c.pitch = rest.pitch + 0.25 * size;
                }
                _ => {
                    c.feet[side].roll = 0.3 * sign;
                    c.roll = 0.14 * sign * size;
                    c.side = -0.06 * sign;
                }
            }
            if v.word("arm") == "raised" {
                let azimuth = if direction == "sideways" { 1.4 } else { 0.2 };
                reach(c, side, arm_up, azimuth, stretched, ELBOW_DOWN);
                reach(c, other, -1.1, 0.4, 0.85, ELBOW_BACK);
            }
        });
        track.hold(actor.s(0.15, speed));
        track.to(actor.s(0.85, speed), |c| *c = ready);
        if n + 1 < v.count("repetitions") {
            track.hold(actor.s(0.1, speed));
        }
    }
    track.to(actor.s(0.4, speed), |c| *c = rest);
    track.hold(0.2);
    film(&track, actor)
}

/// Stands on the leg of `side` with the other leg lifted.
pub(super) fn balance(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let rest = actor.standing();
    let speed = v.speed();
    let stands = v.sides()[0];
    let lifted = 1 - stands;
    let mut track = Track::new(rest);
    track.to(actor.s(0.5, speed), |c| {
        c.bias = weight_off(lifted);
        for side in 0..2 {
            reach(c, side, -0.7, 1.35, 0.95, ELBOW_BACK);
        }
    });
    let height_m = actor.a(0.34) * actor.rig.scale;
    track.to(actor.s(0.6, speed), |c| {
        c.feet[lifted].at += Vec3::new(0.0, height_m, actor.m(0.1));
        c.feet[lifted].pitch = -0.4;
        for side in 0..2 {
            reach(c, side, -0.25, 1.45, 0.96, ELBOW_OUT);
        }
    });
    for n in 0..3 {
        let wobble = if n % 2 == 0 { 0.05 } else { -0.05 } * actor.style.size;
        track.to(actor.s(0.55, speed), |c| {
            c.side = wobble;
            c.arms[0].elevation = -0.25 + 2.0 * wobble;
            c.arms[1].elevation = -0.25 - 2.0 * wobble;
        });
    }
    track.to(actor.s(0.55, speed), |c| {
        let bias = c.bias;
        *c = rest;
        c.bias = bias;
    });
    track.to(actor.s(0.35, speed), |c| *c = rest);
    track.hold(0.2);
    film(&track, actor)
}

/// Steps over a knee-high obstacle in front; the leg of `side` leads.
pub(super) fn step_over(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let rest = actor.standing();
    let speed = v.speed();
    let lead = v.sides()[0];
    let trail = 1 - lead;
    let length = Vec3::Z * actor.m(0.68);
    let lift_m = actor.a(0.34) * v.amplitude() * actor.rig.scale;
    let mut track = Track::new(rest);
    let arms = |c: &mut Control| {
        for side in 0..2 {
            reach(c, side, -1.0, 0.8, 0.85, ELBOW_BACK);
        }
    };
    track.to(actor.s(0.45, speed), |c| {
        c.bias = weight_off(lead);
        c.nod = 0.35;
        c.flex = rest.flex + 0.1;
        arms(c);
    });
    track.to(actor.s(0.5, speed), |c| {
        c.feet[lead].at = rest.feet[lead].at + length * 0.42 + Vec3::Y * lift_m;
        c.feet[lead].pitch = 0.15;
    });
    track.to(actor.s(0.45, speed), |c| {
        c.feet[lead].at = rest.feet[lead].at + length;
        c.feet[lead].pitch = 0.1;
        c.bias = if lead == 0 { 0.35 } else { 0.65 };
        c.hip.y = rest.hip.y - actor.m(0.05);
        c.feet[trail].pitch = -0.35;
    });
    track.to(actor.s(0.4, speed), |c| {
        c.feet[lead].pitch = 0.0;
        c.bias = weight_off(trail);
        c.hip.y = rest.hip.y - actor.m(0.02);
        c.feet[trail].pitch = -0.8;
    });
    track.to(actor.s(0.4, speed), |c| {
        c.feet[trail].at = rest.feet[trail].at + length * 0.45 + Vec3::Y * lift_m;
        c.feet[trail].pitch = -0.75;
        c.hip.y = rest.hip.y;
    });
    track.to(actor.s(0.45, speed), |c| {
        c.feet[trail].at = rest.feet[trail].at + length;
        c.feet[trail].pitch = 0.0;
    });
    track.to(actor.s(0.4, speed), |c| *c = rest.moved(0.0, length));
    track.hold(0.2);
    film(&track, actor)
}
