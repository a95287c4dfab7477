//! Still postures, and extension of a motion's final pose to the requested duration.

use crate::actor::Actor;
use crate::control::Control;
use crate::track::FPS;
use crate::values::Values;

/// Quiet standing.
pub(super) fn stand_still(v: &Values, actor: &mut Actor) -> Vec<Control> {
    vec![actor.standing(); frames_in(v.number("duration_s"))]
}

/// Quiet sitting.
pub(super) fn sit_still(v: &Values, actor: &mut Actor) -> Vec<Control> {
    vec![actor.seated(); frames_in(v.number("duration_s"))]
}

/// Holds the last pose until `duration_s`. If the personal timing exceeds it, the motion is played
/// slightly faster.
pub(super) fn fit_duration(mut frames: Vec<Control>, v: &Values) -> Vec<Control> {
    let Some(wanted_s) = v.given("duration_s") else {
        return frames;
    };
    let wanted = frames_in(wanted_s);
    if frames.len() > wanted {
        let ratio = (frames.len() - 1) as f32 / (wanted - 1).max(1) as f32;
        return (0..wanted)
            .map(|n| {
                let at = n as f32 * ratio;
                let k = (at as usize).min(frames.len() - 2);
                frames[k].lerp(frames[k + 1], at - k as f32)
            })
            .collect();
    }
    let last = frames[frames.len() - 1];
    frames.resize(wanted, last);
    frames
}

fn frames_in(duration_s: f32) -> usize {
    ((f64::from(duration_s) * FPS).round() as usize).max(2)
}
