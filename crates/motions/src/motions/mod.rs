//! The individual motions. Each converts checked values into [`Control`] frames at
//! [`crate::track::FPS`] and starts and ends in one of the actor's resting poses.

mod arms;
mod floor;
mod hold;
mod jumps;
mod legs;
mod locomotion;
mod trunk;

pub(crate) use locomotion::resulting_speed as pace;

use glam::Vec3;

use crate::actor::Actor;
use crate::control::Control;
use crate::error::BuiltinError;
use crate::track::Track;
use crate::values::Values;

/// Maximum natural duration of one part, s.
const LIMIT_S: f32 = 130.0;

/// Pole vector for elbows pointing backward, as in hanging arms.
const ELBOW_BACK: Vec3 = Vec3::new(0.25, 0.0, -1.0);
/// Pole vector for elbows pointing to the side.
const ELBOW_OUT: Vec3 = Vec3::new(1.0, -0.25, -0.15);
/// Pole vector for the elbows of arms raised sideways.
const ELBOW_SIDE: Vec3 = Vec3::new(0.1, -0.15, -1.0);
/// Pole vector for elbows pointing down.
const ELBOW_DOWN: Vec3 = Vec3::new(0.55, -1.0, -0.1);
/// Pole vector for the elbows of raised arms.
const ELBOW_UP: Vec3 = Vec3::new(0.9, 0.0, 0.35);

/// Renders one motion; `name` is one of [`crate::specs`].
pub(crate) fn perform(name: &str, v: &Values, actor: &mut Actor) -> Vec<Control> {
    actor.stoop = if v.word("posture") == "stooped" {
        1.0
    } else {
        0.0
    };
    let frames = match name {
        "walk" => locomotion::walk(v, actor),
        "run" => locomotion::run(v, actor),
        "turn" => locomotion::turn(v, actor),
        "circle" => locomotion::circle(v, actor),
        "pace" => locomotion::back_and_forth(v, actor),
        "walk_turn" => locomotion::walk_turn(v, actor),
        "side_step" => locomotion::side_step(v, actor),
        "march" => locomotion::march(v, actor),
        "jog_in_place" => locomotion::jog_in_place(v, actor),
        "limp" => locomotion::limp(v, actor),
        "step_over" => legs::step_over(v, actor),
        "hop" => jumps::hop(v, actor),
        "jump" => jumps::jump(v, actor),
        "jumping_jack" => jumps::jumping_jack(v, actor),
        "stand_still" => hold::stand_still(v, actor),
        "sit_still" => hold::sit_still(v, actor),
        "sit_down" => floor::sit_down(v, actor),
        "stand_up" if v.word("from") == "floor" => floor::get_up(v, actor),
        "stand_up" => floor::stand_up(v, actor),
        "lie_down" => floor::lie_down(v, actor),
        "fall" => floor::fall(v, actor),
        "crouch" => floor::crouch(v, actor),
        "kneel" => floor::kneel(v, actor),
        "squat" => legs::squat(v, actor),
        "lunge" => legs::lunge(v, actor),
        "kick" => legs::kick(v, actor),
        "leg_raise" => legs::leg_raise(v, actor),
        "balance" => legs::balance(v, actor),
        "wave" => arms::wave(v, actor),
        "raise_arms" => arms::raise_arms(v, actor),
        "clap" => arms::clap(v, actor),
        "punch" => arms::punch(v, actor),
        "push" => arms::push(v, actor),
        "pull" => arms::pull(v, actor),
        "knock" => arms::knock(v, actor),
        "point" => arms::point(v, actor),
        "drink" => arms::drink(v, actor),
        "answer_phone" => arms::answer_phone(v, actor),
        "salute" => arms::salute(v, actor),
        "cross_arms" => arms::cross_arms(v, actor),
        "hands_on_hips" => arms::hands_on_hips(v, actor),
        "arm_circles" => arms::arm_circles(v, actor),
        "throw" => trunk::throw(v, actor),
        "pick_up" => trunk::pick_up(v, actor),
        "toe_touch" => trunk::toe_touch(v, actor),
        "bow" => trunk::bow(v, actor),
        "stretch" => trunk::stretch(v, actor),
        "side_bend" => trunk::side_bend(v, actor),
        "twist" => trunk::twist(v, actor),
        _ => vec![actor.standing()],
    };
    hold::fit_duration(frames, v)
}

/// Arms that the motion needs when it is used as an overlay.
pub(crate) fn arms_used(name: &str, v: &Values) -> [bool; 2] {
    let named = [v.sides().contains(&0), v.sides().contains(&1)];
    // In a punch the other hand keeps the guard up.
    if name == "punch" || !v.knows("side") {
        [true, true]
    } else {
        named
    }
}

/// Checks that keys do not contradict each other and that the total duration is valid; `name` is
/// one of the specs.
///
/// # Errors
/// [`BuiltinError::Conflict`], with values that would be possible.
pub(crate) fn check(name: &'static str, v: &Values, height_m: f32) -> Result<(), BuiltinError> {
    let conflict = |reason: String| {
        Err(BuiltinError::Conflict {
            motion: name,
            reason,
        })
    };
    let direction = v.word("direction");
    if matches!(name, "kick" | "lunge")
        && v.is_set("side")
        && matches!(direction, "left" | "right")
        && direction != v.word("side")
    {
        return conflict(format!(
            "the {} leg cannot go to the {direction}; give only one of side and direction, or equal ones",
            v.word("side")
        ));
    }
    if v.is_set("distance_m")
        && v.is_set("speed")
        && v.is_set("duration_s")
        && matches!(name, "walk" | "run")
    {
        return conflict("give at most two of distance_m, speed and duration_s".to_owned());
    }
    if let Some(reason) = locomotion::impossible_pace(name, v, height_m) {
        return conflict(reason);
    }
    if let Some(wanted_s) = v
        .given("duration_s")
        .filter(|_| !locomotion::length_follows_duration(name, v))
    {
        let mut natural = v.clone();
        natural.forget("duration_s");
        let natural_s = perform(name, &natural, &mut Actor::average(height_m)).len() as f32
            / crate::track::FPS as f32;
        if wanted_s < 0.97 * natural_s {
            return conflict(format!(
                "takes {natural_s:.1} s, which does not fit into duration_s={wanted_s}; give a longer duration, a higher speed or fewer repetitions"
            ));
        }
    }
    if v.count("repetitions") > 3 {
        let mut once = v.clone();
        once.forget("duration_s");
        let natural_s = perform(name, &once, &mut Actor::average(height_m)).len() as f32
            / crate::track::FPS as f32;
        if natural_s > LIMIT_S {
            return conflict(format!(
                "takes {natural_s:.0} s, more than {LIMIT_S} s; give fewer repetitions or a higher speed"
            ));
        }
    }
    Ok(())
}

/// Side of the acting leg, from `side` or from a sideways `direction`.
pub(crate) fn acting_side(v: &Values) -> usize {
    match (v.is_set("side"), v.word("direction")) {
        (false, "left") => 0,
        (false, "right") => 1,
        _ => v.sides()[0],
    }
}

/// Unit vector sideways or ahead for `direction`; zero for "up".
fn towards(direction: &str) -> Vec3 {
    match direction {
        "forward" => Vec3::Z,
        "backward" => Vec3::NEG_Z,
        "left" => Vec3::X,
        "right" => Vec3::NEG_X,
        _ => Vec3::ZERO,
    }
}

fn reach(c: &mut Control, side: usize, elevation: f32, azimuth: f32, reach: f32, pole: Vec3) {
    let arm = &mut c.arms[side];
    arm.elevation = elevation;
    arm.azimuth = azimuth;
    arm.reach = reach;
    arm.pole = pole;
    arm.world_weight = 0.0;
}

/// Value of [`Control::bias`] that puts the weight on the leg opposite to `side`.
fn weight_off(side: usize) -> f32 {
    if side == 0 { 0.0 } else { 1.0 }
}

/// Renders a finished track with the actor's own timing.
fn film(track: &Track, actor: &Actor) -> Vec<Control> {
    track.render(actor.style.lag_s)
}
