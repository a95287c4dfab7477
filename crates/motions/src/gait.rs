//! Gaits and other stepping motions: walking, running, marching, turning, side steps, limping.
//!
//! Footprints are planned first. Each foot is placed where the body will be in the middle of the
//! coming stance phase. In the swing phase the foot moves between footprints; in the stance phase
//! it only rolls over the heel and the ball. The pelvis travels along the path, and the rig solves
//! the legs between pelvis and feet.

use std::f32::consts::{PI, TAU};

use glam::{Quat, Vec3};

use crate::actor::Actor;
use crate::control::{Arm, Control, SIDE_SIGN};
use crate::rig::smooth;
use crate::track::FPS;

/// Time from the first weight shift until the first foot leaves the floor, s.
const LEAD_IN_S: f32 = 0.25;
/// Time of standing still after the last step, s.
const SETTLE_S: f32 = 0.35;

/// Parameters of one continuous sequence of steps; lengths in m, angles in rad.
#[derive(Clone, Debug)]
pub(crate) struct Gait {
    /// Time between the starts of two consecutive swing phases, s.
    pub step_s: f32,
    /// Duration of one swing phase in steps: below 1 is walking, above 1 is running.
    pub swing_steps: f32,
    /// Number of swing phases.
    pub n_steps: usize,
    /// Side of the first swing.
    pub first: usize,
    /// Height of the sole in mid-swing.
    pub lift_m: f32,
    /// Foot pitch at heel strike, toes up (negative: the toes land first).
    pub strike: f32,
    /// Foot pitch at toe-off, heel up (negative pitch).
    pub toe_off: f32,
    /// Pitch of the hanging foot in mid-swing.
    pub hang: f32,
    /// Minimum share of `strike` and `toe_off` used when stepping in place; 1 for marching, 0 for
    /// shuffling.
    pub in_place: f32,
    /// Constant lowering of the pelvis.
    pub dip_m: f32,
    /// Additional lowering of the pelvis in double support (walking).
    pub bob_m: f32,
    /// Vertical pelvis motion, up in flight and down in stance (running).
    pub bounce_m: f32,
    /// Lateral shift of the pelvis over the stance foot.
    pub sway_m: f32,
    /// Rotation of the pelvis with the forward leg.
    pub pelvis_turn: f32,
    /// Drop of the pelvis on the side of the swing leg.
    pub list: f32,
    /// Forward lean of the trunk.
    pub lean: f32,
    /// Lean into a curve, to the left.
    pub bank: f32,
    /// Amplitude of the arm swing about the shoulder, in each direction.
    pub arm: f32,
    /// Elbow bend; `elbow_front` is the additional bend when the arm is in front.
    pub elbow: f32,
    /// See `elbow`.
    pub elbow_front: f32,
    /// Additional outward offset of each foot while in motion.
    pub spread_m: f32,
    /// Number of steps over which the body accelerates and decelerates.
    pub ramps: [f32; 2],
    /// Injured side, if any.
    pub limp: Option<usize>,
}

impl Gait {
    /// Ordinary walking at `speed` (1 is normal).
    pub(crate) fn walk(actor: &mut Actor, speed: f32) -> Self {
        let root = speed.sqrt();
        let size = actor.rig.scale;
        Self {
            step_s: 0.55 * size.sqrt() * actor.style.tempo / root,
            swing_steps: 0.78,
            n_steps: 4,
            first: actor.dice.index(2),
            lift_m: 0.035 * size,
            strike: 0.33 * root.min(1.1),
            toe_off: -0.95 * root.min(1.1),
            hang: 0.0,
            in_place: 0.25,
            dip_m: 0.008 * size,
            bob_m: 0.034 * size * root,
            bounce_m: 0.0,
            sway_m: actor.a(0.02) * size,
            pelvis_turn: actor.a(0.10) * root,
            list: actor.a(0.05),
            lean: 0.03 * speed,
            bank: 0.0,
            arm: actor.a(0.42) * root,
            elbow: 0.22 + 0.15 * actor.dice.range(0.0, 1.0),
            elbow_front: 0.3,
            spread_m: 0.0,
            ramps: [1.2, 1.6],
            limp: None,
        }
    }

    /// Chooses the number of steps and their timing so that covering `distance_m` takes the time
    /// given by the cruising speed and the two speed ramps.
    pub(crate) fn plan(&mut self, distance_m: f32, cruise_mps: f32) {
        let ramps = 0.5 * (self.ramps[0] + self.ramps[1]);
        let extra = self.swing_steps + 0.25 - 1.0 - ramps;
        let steps = (distance_m / cruise_mps - 0.05) / self.step_s - extra;
        self.n_steps = steps.round().clamp(2.0, 4000.0) as usize;
        self.step_s = (distance_m / cruise_mps - 0.05) / (self.n_steps as f32 + extra);
        self.step_s = self.step_s.clamp(0.18, 1.2);
    }

    /// Renders the steps along `path`, which maps progress 0..1 to a position and a heading.
    pub(crate) fn perform(&self, actor: &Actor, path: &dyn Fn(f32) -> (Vec3, f32)) -> Vec<Control> {
        let plan = Plan::new(self, actor, path);
        let n_frames = ((plan.end_s + SETTLE_S) as f64 * FPS) as usize + 1;
        (0..n_frames)
            .map(|f| self.control(actor, &plan, path, (f as f64 / FPS) as f32))
            .collect()
    }

    fn control(
        &self,
        actor: &Actor,
        plan: &Plan,
        path: &dyn Fn(f32) -> (Vec3, f32),
        time: f32,
    ) -> Control {
        let rest = actor.standing();
        let mut c = rest;
        let (place, heading) = path(plan.progress(time));
        c = c.moved(heading, place);
        for side in 0..2 {
            self.place_foot(plan, side, time, &mut c);
        }
        let going = plan.going(time, self.step_s);
        let theta = plan.theta(time) - 0.5 * self.swing_steps;
        let first = SIDE_SIGN[self.first];
        // +1 when the left leg is in front.
        let stride = first * (PI * theta).sin();
        // +1 when the left leg swings past the other.
        let passing = first * (PI * theta).cos();
        let limp = self.limp.map_or(0.0, |side| SIDE_SIGN[side] * -passing);
        c.hip.y -= going
            * (self.dip_m
                + self.bob_m * 0.5 * (1.0 - (TAU * theta).cos())
                + self.bounce_m * (TAU * theta).cos());
        c.hip.y -= going * limp.max(0.0) * actor.m(0.035);
        let lateral = Quat::from_rotation_y(heading) * Vec3::X;
        c.hip -= lateral * (self.sway_m * passing * going);
        c.yaw -= self.pelvis_turn * stride * going;
        c.twist += 1.7 * self.pelvis_turn * stride * going;
        c.look -= 0.6 * self.pelvis_turn * stride * going;
        c.roll += (self.list * -passing - self.bank) * going;
        c.side += (self.list * -passing * 1.1 + 0.3 * self.bank) * going;
        if let Some(side) = self.limp {
            // The trunk leans over the injured leg during its stance phase.
            c.side += SIDE_SIGN[side] * 0.24 * limp.max(0.0) * going;
            c.flex += 0.08 * going;
        }
        c.pitch += 0.4 * self.lean * going;
        c.flex += 0.6 * self.lean * going;
        c.nod -= 0.5 * self.lean * going;
        c.balance = 1.0 - going;
        // The head turns into a curve before the body does.
        let ahead = path(plan.progress(time + 0.35)).1 - heading;
        c.look += (0.8 * ahead).clamp(-0.7, 0.7);
        for (side, sign) in SIDE_SIGN.iter().enumerate() {
            let swing = -sign * stride * self.arm;
            let front = (swing / self.arm.max(1e-3)).max(0.0);
            let goal = swung_arm(0.05 + swing, self.elbow + self.elbow_front * front);
            let arm = &mut c.arms[side];
            arm.elevation += (goal.elevation + actor.stoop_tilt() - arm.elevation) * going;
            arm.azimuth += (goal.azimuth - arm.azimuth) * going;
            arm.reach += (goal.reach - arm.reach) * going;
        }
        c
    }

    fn place_foot(&self, plan: &Plan, side: usize, time: f32, c: &mut Control) {
        let foot = &mut c.feet[side];
        let (mut print, mut landed_s) = (plan.start[side], f32::NEG_INFINITY);
        for swing in &plan.swings {
            if swing.side != side {
                continue;
            }
            let next_vigour = swing.vigour;
            if time < swing.lift_s {
                let stance_s = if landed_s.is_finite() {
                    swing.lift_s - landed_s
                } else {
                    0.9 * self.step_s
                };
                let left = (swing.lift_s - time) / stance_s;
                let rise = (1.0 - left / 0.5).max(0.0);
                foot.pitch +=
                    plan.toe_off(self, side) * next_vigour * rise * rise * (1.5 - 0.5 * rise);
                break;
            }
            let u = (time - swing.lift_s) / swing.swing_s;
            if u < 1.0 {
                let eased = smooth(u);
                foot.at = print.0.lerp(swing.print.0, eased);
                foot.yaw = print.1 + (swing.print.1 - print.1) * eased;
                let early = u.powf(if self.swing_steps > 1.0 { 0.75 } else { 0.9 });
                let bump = 16.0 * early * early * (1.0 - early) * (1.0 - early);
                foot.at.y = bump * self.lift_m * plan.lift_share(self, side);
                foot.pitch = plan.toe_off(self, side) * swing.vigour * (1.0 - smooth(u / 0.6))
                    + self.strike * swing.vigour * smooth((u - 0.5) / 0.5)
                    + self.hang * bump;
                return;
            }
            print = swing.print;
            landed_s = swing.lift_s + swing.swing_s;
            let flat_s = 0.28 * self.step_s;
            foot.pitch = self.strike * swing.vigour * (1.0 - smooth((time - landed_s) / flat_s));
        }
        foot.at = print.0;
        foot.yaw = print.1;
    }
}

/// An arm whose upper arm hangs at angle `swing` (forward positive) and whose elbow is bent by
/// `elbow`.
pub(crate) fn swung_arm(swing: f32, elbow: f32) -> Arm {
    let (upper, lower) = (0.52, 0.48);
    let up = -swing.cos() * upper - (swing + elbow).cos() * lower;
    let forward = swing.sin() * upper + (swing + elbow).sin() * lower;
    let mut elevation = up.atan2(forward);
    if elevation > 0.6 * PI {
        elevation -= TAU;
    }
    Arm {
        elevation,
        azimuth: 0.0,
        reach: up.hypot(forward).min(0.985),
        pole: Vec3::new(0.25, 0.0, -1.0),
        flex: 0.1,
        ..Arm::default()
    }
}

struct Swing {
    side: usize,
    lift_s: f32,
    swing_s: f32,
    print: (Vec3, f32),
    /// Share of the foot roll that the step length requires.
    vigour: f32,
}

struct Plan {
    swings: Vec<Swing>,
    start: [(Vec3, f32); 2],
    begin_s: f32,
    end_s: f32,
    ramp_up_s: f32,
    ramp_down_s: f32,
}

impl Plan {
    fn new(gait: &Gait, actor: &Actor, path: &dyn Fn(f32) -> (Vec3, f32)) -> Self {
        let rest = actor.standing();
        let mut lift_s = LEAD_IN_S;
        let mut timing = Vec::with_capacity(gait.n_steps);
        for k in 0..gait.n_steps {
            let side = (gait.first + k) % 2;
            // The swing of the healthy leg is shorter while the injured leg bears weight.
            let hurry = gait
                .limp
                .map_or(1.0, |hurt| if side == hurt { 1.22 } else { 0.78 });
            timing.push((side, lift_s, gait.swing_steps * gait.step_s * hurry));
            lift_s += gait.step_s * hurry;
        }
        let last = timing.last().map_or(LEAD_IN_S, |t| t.1 + t.2);
        let mut plan = Self {
            swings: Vec::with_capacity(gait.n_steps),
            start: [0, 1].map(|s| (rest.feet[s].at, rest.feet[s].yaw)),
            begin_s: LEAD_IN_S - 0.05,
            end_s: last + 0.25 * gait.step_s,
            ramp_up_s: gait.ramps[0] * gait.step_s,
            ramp_down_s: gait.ramps[1] * gait.step_s,
        };
        let total_s = plan.end_s - plan.begin_s;
        let ramps = plan.ramp_up_s + plan.ramp_down_s;
        if ramps > 0.95 * total_s {
            plan.ramp_up_s *= 0.95 * total_s / ramps;
            plan.ramp_down_s *= 0.95 * total_s / ramps;
        }
        let mut last_print = plan.start;
        for (k, (side, lift_s, swing_s)) in timing.iter().copied().enumerate() {
            let closing = k + 2 >= gait.n_steps;
            let middle = lift_s + 0.5 * swing_s + gait.step_s;
            let progress = if closing { 1.0 } else { plan.progress(middle) };
            let (place, heading) = path(progress);
            let mut offset = rest.feet[side].at;
            if !closing {
                offset.x += SIDE_SIGN[side] * gait.spread_m;
            }
            let at = Quat::from_rotation_y(heading) * offset + place;
            let print = (at, rest.feet[side].yaw + heading);
            let length = (print.0 - last_print[side].0).length();
            let vigour = (length / actor.m(1.15)).clamp(gait.in_place.min(1.0), 1.1);
            last_print[side] = print;
            plan.swings.push(Swing {
                side,
                lift_s,
                swing_s,
                print,
                vigour,
            });
        }
        plan
    }

    /// Share of the path travelled at `time`, with smooth speed ramps and constant speed between
    /// them.
    fn progress(&self, time: f32) -> f32 {
        let total = self.end_s - self.begin_s;
        let speed = 1.0 / (total - 0.5 * (self.ramp_up_s + self.ramp_down_s));
        // Integral of the cubic step.
        let ramp = |x: f32| x * x * x - 0.5 * x * x * x * x;
        let t = (time - self.begin_s).clamp(0.0, total);
        if t < self.ramp_up_s {
            speed * self.ramp_up_s * ramp(t / self.ramp_up_s)
        } else if t > total - self.ramp_down_s {
            1.0 - speed * self.ramp_down_s * ramp((total - t) / self.ramp_down_s)
        } else {
            speed * (t - 0.5 * self.ramp_up_s)
        }
    }

    /// Continuous gait phase at `time`: the number of steps begun.
    fn theta(&self, time: f32) -> f32 {
        let next = self.swings.partition_point(|s| s.lift_s <= time);
        let step = |k: usize| self.swings[k + 1].lift_s - self.swings[k].lift_s;
        let n = self.swings.len();
        if n < 2 {
            return 0.0;
        }
        if next == 0 {
            return (time - self.swings[0].lift_s) / step(0);
        }
        let k = (next - 1).min(n - 2);
        k as f32 + (time - self.swings[k].lift_s) / step(k)
    }

    fn going(&self, time: f32, step_s: f32) -> f32 {
        smooth((time - 0.05) / (LEAD_IN_S + 0.6 * step_s))
            * smooth((self.end_s + 0.1 - time) / (1.1 * step_s))
    }

    fn toe_off(&self, gait: &Gait, side: usize) -> f32 {
        if gait.limp == Some(side) {
            0.3 * gait.toe_off
        } else {
            gait.toe_off
        }
    }

    fn lift_share(&self, gait: &Gait, side: usize) -> f32 {
        if gait.limp == Some(side) { 0.7 } else { 1.0 }
    }
}
