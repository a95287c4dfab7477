//! Rendering of a request: renders the parts, joins them and solves every frame.

use glam::{Quat, Vec3};
use radarllm_base::frames::world_from_rest_facing_radar;
use radarllm_base::{Motion, Pose};
use radarllm_body::mesh::Build;

use crate::actor::Actor;
use crate::captions;
use crate::control::{Control, N_CHANNELS};
use crate::motions;
use crate::request::{BuiltinRequest, Part, Segment};
use crate::rig::{Rig, smooth, wrap};
use crate::track::FPS;

/// Time over which the difference between two parts fades out at their seam, s.
const SEAM_S: f32 = 0.35;
/// Standard deviation of the temporal smoothing of all channels except the feet, frames.
const SMOOTHING_FRAMES: f32 = 1.5;

/// Half width of the window over which the pelvis is lowered before and after a long step, frames.
const DROP_FRAMES: usize = 5;

/// A rendered built-in motion with its captions and attributes.
#[derive(Clone, Debug)]
pub struct Procedural {
    /// The motion in canonical placement: it starts at x = y = 0 and faces -y rotated by
    /// `heading_deg`.
    pub motion: Motion,
    /// "walk", "walk then sit_down", "march while clap".
    pub action: String,
    /// Three to five different sentences.
    pub captions: Vec<String>,
    /// Canonical form of the request.
    pub request: String,
    /// Attributes in the vocabulary of the captions: `("side", "left")`, `("speed", "fast")`. In a
    /// composition each key is prefixed with its motion: `("walk.speed", "fast")`.
    pub attributes: Vec<(String, String)>,
    /// Standing height, m.
    pub height_m: f32,
    /// Body build for the mesh.
    pub build: Build,
}

impl BuiltinRequest {
    /// Renders the request. The seed slightly varies posture, timing, amplitude and wording. The
    /// same seed gives the same result.
    pub fn render(&self, seed: u64) -> Procedural {
        let height_m = self.global.number("height_m");
        let mut actor = Actor::new(height_m, seed);
        let mut frames = self.controls(&mut actor);
        actor.add_idle(&mut frames);
        let sway = actor.add_sway(&mut frames, self.global.number("sway_m"));
        let wander_m = self.global.number("wander_m");
        if wander_m > 0.0 {
            actor.add_steps(&mut frames, wander_m);
        }
        let start = Vec3::new(frames[0].hip.x, 0.0, frames[0].hip.z);
        let heading_rad = self.global.number("heading_deg").to_radians();
        let world_from_stage = Quat::from_rotation_z(heading_rad) * world_from_rest_facing_radar();
        let frames = settle(&frames, &sway, &actor.rig);
        let mut poses: Vec<Pose> = frames
            .iter()
            .map(|control| {
                let mut pose = actor.rig.pose(control);
                pose.root_in_world = world_from_stage * (pose.root_in_world - start);
                pose.rotations[0] = (world_from_stage * pose.rotations[0]).normalize();
                pose
            })
            .collect();
        // Balancing shifts the pelvis by millimetres; this offset makes the motion start exactly at
        // the origin.
        let off = Vec3::new(poses[0].root_in_world.x, poses[0].root_in_world.y, 0.0);
        for pose in &mut poses {
            pose.root_in_world -= off;
        }
        let build = match self.global.word("build") {
            "slim" => Build::Slim,
            "heavy" => Build::Heavy,
            _ => Build::Average,
        };
        Procedural {
            motion: Motion {
                fps: FPS,
                skeleton: actor.rig.skeleton.clone(),
                poses,
            },
            action: self.action(),
            captions: captions::captions(self, seed),
            request: self.to_string(),
            attributes: captions::attributes(self),
            height_m,
            build,
        }
    }

    /// Returns the captions that [`BuiltinRequest::render`] gives for the same seed, without
    /// rendering the motion.
    pub fn captions(&self, seed: u64) -> Vec<String> {
        captions::captions(self, seed)
    }

    /// Duration without the personal variation of tempo, s.
    pub fn nominal_duration_s(&self) -> f32 {
        let mut actor = Actor::average(self.global.number("height_m"));
        self.n_frames(&mut actor) as f32 / FPS as f32
    }

    /// Number of frames of [`Self::controls`], without smoothing and blending, which do not change it.
    fn n_frames(&self, actor: &mut Actor) -> usize {
        let mut n_frames = 0;
        for segment in &self.segments {
            let mut perform =
                |part: &Part| motions::perform(part.spec.name, &part.values, actor).len();
            let base = perform(&segment.base);
            let gesture = segment.overlay.as_ref().map_or(0, perform);
            // Clips share the frame where they meet.
            n_frames += base.max(gesture) - usize::from(n_frames > 0);
        }
        match n_frames {
            0 => 0,
            n => n + self.pause_frames("before_s") + self.pause_frames("after_s"),
        }
    }

    /// Number of frames of a pause.
    fn pause_frames(&self, key: &str) -> usize {
        (self.global.number(key) * FPS as f32).round() as usize
    }

    /// Name of the action: "walk then sit_down", "march while clap".
    pub fn action(&self) -> String {
        let names: Vec<String> = self
            .segments
            .iter()
            .map(|s| match &s.overlay {
                Some(overlay) => format!("{} while {}", s.base.spec.name, overlay.spec.name),
                None => s.base.spec.name.to_owned(),
            })
            .collect();
        names.join(" then ")
    }

    fn controls(&self, actor: &mut Actor) -> Vec<Control> {
        let mut all: Vec<Control> = Vec::new();
        for segment in &self.segments {
            let clip = perform_segment(segment, actor);
            join(&mut all, clip);
        }
        if let (Some(first), Some(last)) = (all.first().copied(), all.last().copied()) {
            all.resize(all.len() + self.pause_frames("after_s"), last);
            all.splice(0..0, vec![first; self.pause_frames("before_s")]);
        }
        all
    }
}

fn perform_part(part: &Part, actor: &mut Actor) -> Vec<Control> {
    let mut frames = motions::perform(part.spec.name, &part.values, actor);
    smooth_upper(&mut frames);
    for c in &mut frames {
        for arm in &mut c.arms {
            // Arm circles accumulate full turns; from here on only the direction matters.
            arm.elevation = wrap(arm.elevation + 1.0) - 1.0;
        }
    }
    frames
}

fn perform_segment(segment: &Segment, actor: &mut Actor) -> Vec<Control> {
    let mut frames = perform_part(&segment.base, actor);
    let Some(overlay) = &segment.overlay else {
        return frames;
    };
    let gesture = perform_part(overlay, actor);
    let used = motions::arms_used(overlay.spec.name, &overlay.values);
    if gesture.len() > frames.len() {
        let last = frames[frames.len() - 1];
        frames.resize(gesture.len(), last);
    }
    let first = (frames.len() - gesture.len()) / 2;
    let rest = gesture[0];
    let fade = ((0.35 * FPS as f32) as usize).min(gesture.len() / 3).max(1);
    for (n, g) in gesture.iter().enumerate() {
        let c = &mut frames[first + n];
        let from_edge = n.min(gesture.len() - 1 - n);
        let weight = smooth(from_edge as f32 / fade as f32);
        let target = c.lerp(*g, weight);
        for side in 0..2 {
            if used[side] {
                c.arms[side] = target.arms[side];
            }
        }
        c.flex += g.flex - rest.flex;
        c.side += g.side - rest.side;
        c.twist += 0.7 * (g.twist - rest.twist);
        c.nod += g.nod - rest.nod;
        c.look += g.look - rest.look;
        c.tilt += g.tilt - rest.tilt;
    }
    frames
}

/// Appends a clip, moved to the position and heading at the end of the preceding frames.
fn join(all: &mut Vec<Control>, clip: Vec<Control>) {
    let Some(last) = all.last().copied() else {
        *all = clip;
        return;
    };
    let turn = last.yaw - clip[0].yaw;
    let shift = last.hip - Quat::from_rotation_y(turn) * clip[0].hip;
    let shift = Vec3::new(shift.x, 0.0, shift.z);
    let start = clip[0].moved(turn, shift).channels();
    let end = last.channels();
    for (n, control) in clip.into_iter().enumerate().skip(1) {
        let fade = 1.0 - smooth(n as f32 / (SEAM_S * FPS as f32));
        let mut channels = control.moved(turn, shift).channels();
        for c in 0..N_CHANNELS {
            channels[c] += (end[c] - start[c]) * fade;
        }
        all.push(Control::from_channels(&channels));
    }
}

/// Balances every frame and lowers the pelvis, smoothly over time, until both legs reach the feet.
fn settle(frames: &[Control], sway: &[Vec3], rig: &Rig) -> Vec<Control> {
    let settled: Vec<(Control, f32)> = frames
        .iter()
        .zip(sway)
        .map(|(c, sway)| rig.settle(c, *sway))
        .collect();
    // Maximum drop around each frame, averaged over the same window, so the result is never less
    // than required.
    let near =
        |n: usize, radius: usize| n.saturating_sub(radius)..(n + radius + 1).min(settled.len());
    let enough: Vec<f32> = (0..settled.len())
        .map(|n| {
            near(n, DROP_FRAMES)
                .map(|k| settled[k].1)
                .fold(0.0, f32::max)
        })
        .collect();
    (0..settled.len())
        .map(|n| {
            let window = near(n, DROP_FRAMES);
            let weight = |k: usize| {
                1.0 + (std::f32::consts::PI * (k as f32 - n as f32) / (DROP_FRAMES + 1) as f32)
                    .cos()
            };
            let total: f32 = window.clone().map(weight).sum();
            let drop_m: f32 = window.map(|k| enough[k] * weight(k)).sum::<f32>() / total;
            let mut control = settled[n].0;
            control.hip.y -= drop_m;
            control
        })
        .collect()
}

/// Gaussian smoothing of all channels except the feet, which must keep their exact positions.
fn smooth_upper(frames: &mut [Control]) {
    let radius = (3.0 * SMOOTHING_FRAMES).ceil() as i64;
    let weights: Vec<f32> = (-radius..=radius)
        .map(|k| (-0.5 * (k as f32 / SMOOTHING_FRAMES).powi(2)).exp())
        .collect();
    let total: f32 = weights.iter().sum();
    let before: Vec<[f32; N_CHANNELS]> = frames.iter().map(|c| c.channels()).collect();
    let last = before.len() as i64 - 1;
    for (n, control) in frames.iter_mut().enumerate() {
        let feet = control.feet;
        let mut channels = [0.0; N_CHANNELS];
        for (k, weight) in weights.iter().enumerate() {
            let at = (n as i64 + k as i64 - radius).clamp(0, last) as usize;
            for c in 0..N_CHANNELS {
                channels[c] += before[at][c] * weight / total;
            }
        }
        *control = Control::from_channels(&channels);
        control.feet = feet;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{pair_request, people_request, random_request};

    #[test]
    fn frames_are_counted_without_smoothing() {
        for seed in 0..200 {
            let people = people_request(seed).request;
            for request in [random_request(seed), pair_request(seed), people] {
                let actor = || Actor::average(request.global.number("height_m"));
                let n_frames = request.controls(&mut actor()).len();
                assert_eq!(request.n_frames(&mut actor()), n_frames, "{request}");
            }
        }
    }
}
