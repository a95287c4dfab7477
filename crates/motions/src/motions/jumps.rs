//! Jumping motions. Crouch, arm swing and landing are keyframed. The flight is a ballistic parabola
//! that is added to the pelvis and the feet alike.

use glam::Vec3;

use super::{ELBOW_BACK, ELBOW_SIDE, ELBOW_UP, film, reach, towards, weight_off};
use crate::actor::Actor;
use crate::control::{Control, SIDE_SIGN};
use crate::track::{FPS, Track};
use crate::values::Values;

const GRAVITY_MPS2: f32 = 9.81;
/// Time by which the pelvis starts to rise before the toes leave the floor, s.
const HIP_LEAD_S: f32 = 0.07;

/// Jumps with both feet. Swinging arms make the jumps higher and longer. With still arms the jumps
/// are low, and each rebounds from the previous one.
pub(super) fn jump(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let rest = actor.standing();
    let way = towards(v.word("direction"));
    let size = v.amplitude();
    let swings = v.word("arms") != "still";
    // Share of the height, length, crouch and lean of a jump with swinging arms.
    let share = if swings { 1.0 } else { 0.45 };
    let crouch_s = if swings { 0.34 } else { 0.2 };
    // Gravity sets the time of flight: quick jumps are low. Swinging arms cannot go much faster than they do, so that only
    // the time on the floor changes, and less.
    let (speed, share_of_height) = match (swings, v.number("speed")) {
        (true, speed) => (speed.sqrt(), 1.0),
        (false, speed) => (speed, 1.0 / (speed * speed)),
    };
    let swing = |c: &mut Control, [elevation, azimuth, far]: [f32; 3], pole: Vec3| {
        for side in (0..2).filter(|_| swings) {
            reach(c, side, elevation, azimuth, far, pole);
        }
    };
    let mut track = Track::new(rest);
    let mut flights = Vec::new();
    let mut travelled = Vec3::ZERO;
    track.hold(0.15);
    for _ in 0..v.count("repetitions") {
        let height_m = actor.a(if way == Vec3::ZERO { 0.24 } else { 0.16 })
            * size
            * share
            * share_of_height
            * actor.rig.scale;
        let flight_s = flight_s(height_m);
        let length_m = actor.a(if way.x != 0.0 || way.z < 0.0 {
            0.38
        } else {
            0.6
        }) * size
            * share
            * actor.rig.scale;
        let from = travelled;
        travelled += way * length_m;
        let down = actor.s(crouch_s, speed);
        let dip = actor.m(0.2 + 0.08 * size) * share * share_of_height.min(1.0).sqrt();
        // Who rebounds quickly stays upright. A full lean is 0.5 rad.
        let lean = match v.given("lean_deg") {
            Some(lean_deg) => lean_deg.to_radians() / 0.5,
            None => share * share_of_height.min(1.0) * size.min(1.0),
        };
        let arm = actor.a(0.5);
        track.to(down, |c| {
            c.hip.y = rest.hip.y - dip;
            c.pitch = rest.pitch + (0.5 - rest.pitch) * lean;
            c.flex = rest.flex + (0.35 - rest.flex) * lean;
            c.nod = rest.nod + (-0.3 - rest.nod) * lean;
            swing(c, [-1.57 - arm, 0.0, 0.96], ELBOW_BACK);
            for foot in &mut c.feet {
                foot.pitch = -0.08;
            }
        });
        track.hold(0.03 / speed);
        track.to(0.22 / speed, |c| {
            c.hip.y = rest.hip.y + actor.m(0.005);
            c.pitch = 0.05;
            c.flex = 0.0;
            c.nod = 0.0;
            swing(c, [-0.1, 0.15, 0.93], ELBOW_UP);
            for foot in &mut c.feet {
                foot.pitch = -0.75;
            }
        });
        flights.push((track.end_s(), flight_s, height_m));
        let tuck = actor.m(0.05);
        track.to(0.5 * flight_s, |c| {
            for side in 0..2 {
                c.feet[side].at =
                    rest.feet[side].at + from + way * (0.5 * length_m) + Vec3::Y * tuck;
                c.feet[side].pitch = -0.55;
            }
            swing(c, [0.55, 0.2, 0.9], ELBOW_UP);
        });
        track.to(0.5 * flight_s, |c| {
            for side in 0..2 {
                c.feet[side].at = rest.feet[side].at + travelled;
                c.feet[side].pitch = -0.3;
            }
            swing(c, [-0.4, 0.3, 0.9], ELBOW_BACK);
            c.hip.y = rest.hip.y - actor.m(0.03);
        });
        track.to(0.17 / speed, |c| {
            c.hip.y = rest.hip.y - 0.75 * dip;
            c.pitch = rest.pitch + (0.4 - rest.pitch) * lean;
            c.flex = rest.flex + (0.3 - rest.flex) * lean;
            swing(c, [-1.1, 0.3, 0.93], ELBOW_BACK);
            for foot in &mut c.feet {
                foot.pitch = 0.0;
            }
        });
    }
    track.to(actor.s(0.5, 1.0), |c| *c = rest.moved(0.0, travelled));
    track.hold(0.15);
    let mut frames = film(&track, actor);
    add_flights(&mut frames, &flights, [true, true]);
    frames
}

/// Hops on one leg, in place or in a direction.
pub(super) fn hop(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let rest = actor.standing();
    let side = v.sides()[0];
    let other = 1 - side;
    let way = towards(v.word("direction"));
    let size = v.amplitude();
    let mut track = Track::new(rest);
    let mut flights = Vec::new();
    let mut travelled = Vec3::ZERO;
    let lifted = actor.m(0.22);
    track.to(actor.s(0.55, 1.0), |c| {
        c.bias = weight_off(other);
        c.feet[other].at += Vec3::new(0.0, lifted, -0.8 * lifted);
        c.feet[other].pitch = -0.9;
        for s in 0..2 {
            reach(c, s, -0.9, 0.9, 0.9, ELBOW_BACK);
        }
    });
    for _ in 0..v.count("repetitions") {
        let height_m = actor.a(0.09) * size * actor.rig.scale;
        let flight_s = flight_s(height_m);
        let length_m = actor.a(if way.z > 0.0 { 0.36 } else { 0.25 }) * size * actor.rig.scale;
        travelled += way * length_m;
        track.to(actor.s(0.2, 1.0), |c| {
            c.hip.y = rest.hip.y - actor.m(0.11);
            c.pitch = 0.22;
            c.flex = 0.15;
            c.feet[side].pitch = 0.0;
            for s in 0..2 {
                reach(c, s, -1.2, 0.7, 0.9, ELBOW_BACK);
            }
        });
        track.to(0.15, |c| {
            c.hip.y = rest.hip.y;
            c.pitch = 0.08;
            c.flex = 0.08;
            c.feet[side].pitch = -0.7;
            for s in 0..2 {
                reach(c, s, -0.55, 0.9, 0.88, ELBOW_BACK);
            }
        });
        flights.push((track.end_s(), flight_s, height_m));
        track.to(flight_s, |c| {
            for s in 0..2 {
                let at = rest.feet[s].at + travelled;
                c.feet[s].at = Vec3::new(at.x, c.feet[s].at.y, at.z);
            }
            c.feet[other].at.z -= 0.8 * lifted;
            c.feet[side].pitch = -0.35;
            c.hip.y = rest.hip.y - actor.m(0.03);
        });
    }
    track.to(0.2, |c| {
        c.hip.y = rest.hip.y - actor.m(0.09);
        c.feet[side].pitch = 0.0;
    });
    track.to(actor.s(0.5, 1.0), |c| *c = rest.moved(0.0, travelled));
    track.hold(0.2);
    let mut frames = film(&track, actor);
    add_flights(&mut frames, &flights, [true, true]);
    frames
}

/// Jumping jacks.
pub(super) fn jumping_jack(v: &Values, actor: &mut Actor) -> Vec<Control> {
    let rest = actor.standing();
    let speed = v.speed();
    let size = v.amplitude();
    let mut track = Track::new(rest);
    let mut flights = Vec::new();
    let open_m = actor.a(0.26) * size * actor.rig.scale;
    let high = (1.28 * actor.style.size).min(1.42) - 0.5 * (1.0 - size).max(0.0);
    track.to(actor.s(0.25, speed), |c| {
        c.hip.y -= actor.m(0.06);
        c.flex += 0.06;
    });
    for n in 0..2 * v.count("repetitions") {
        let opening = n % 2 == 0;
        let height_m = actor.m(0.05);
        let flight_s = flight_s(height_m).max(0.2);
        let push_s = actor.s(0.1, speed);
        track.to(push_s, |c| {
            c.hip.y = rest.hip.y;
            for side in 0..2 {
                c.feet[side].pitch = -0.5;
                // The arms move ahead of the feet, so that both halves meet in flight.
                let elevation = if opening { -0.9 } else { 0.9 };
                reach(c, side, elevation, 1.5, 0.95, ELBOW_SIDE);
            }
        });
        flights.push((track.end_s(), flight_s, height_m));
        track.to(flight_s, |c| {
            c.hip.y = rest.hip.y - actor.m(0.02);
            for (side, sign) in SIDE_SIGN.iter().enumerate() {
                c.feet[side].at = rest.feet[side].at;
                if opening {
                    c.feet[side].at.x += sign * open_m;
                }
                c.feet[side].pitch = -0.3;
                let elevation = if opening { high } else { -1.35 };

                reach(
                    c,
                    side,
                    elevation,
                    if opening { 1.5 } else { 1.2 },
                    0.96,
                    ELBOW_SIDE,
                );
            }
        });
        let land_s = actor.s(0.17, speed);
        track.to(land_s, |c| {
            c.hip.y = rest.hip.y - actor.m(if opening { 0.09 } else { 0.06 });
            for side in 0..2 {
                c.feet[side].pitch = 0.0;
            }
        });
    }
    track.to(actor.s(0.45, speed), |c| *c = rest);
    track.hold(0.2);
    let mut frames = film(&track, actor);
    add_flights(&mut frames, &flights, [true, true]);
    frames
}

/// Flight time of a jump of the given height, s.
fn flight_s(height_m: f32) -> f32 {
    2.0 * (2.0 * height_m / GRAVITY_MPS2).sqrt()
}

/// Adds the flight parabolas, each given as `(start s, duration s, height m)`.
fn add_flights(frames: &mut [Control], flights: &[(f32, f32, f32)], feet: [bool; 2]) {
    for (frame, c) in frames.iter_mut().enumerate() {
        let time = (frame as f64 / FPS) as f32;
        for (start_s, length_s, height_m) in flights {
            let arc = |from: f32, to: f32| {
                let u = ((time - from) / (to - from)).clamp(0.0, 1.0);
                4.0 * u * (1.0 - u) * height_m
            };
            c.hip.y += arc(start_s - HIP_LEAD_S, start_s + length_s + HIP_LEAD_S);
            for side in 0..2 {
                if feet[side] {
                    c.feet[side].at.y += arc(*start_s, start_s + length_s);
                }
            }
        }
    }
}
