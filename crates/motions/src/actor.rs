//! The simulated person: a rig, a personal style drawn from the seed, and resting poses.

use std::f32::consts::{FRAC_PI_2, TAU};

use glam::Vec3;

use crate::control::{Arm, Control, Foot, SIDE_SIGN};
use crate::dice::Dice;
use crate::rig::{Rig, smooth};
use crate::track::FPS;

/// Height of the chair seat above the floor, m. A person who is too short for it gets a lower seat.
pub(crate) const SEAT_M: f32 = 0.45;

/// Small personal deviations from the average adult; all are centred on zero.
#[derive(Clone, Debug)]
pub(crate) struct Style {
    /// Multiplies all durations.
    pub tempo: f32,
    /// Multiplies movement amplitudes.
    pub size: f32,
    /// Delay of head and arms behind the trunk, s.
    pub lag_s: f32,
    arm_azimuth: f32,
    arm_elevation: f32,
    arm_reach: [f32; 2],
    stance: f32,
    stagger: f32,
    toe_out: f32,
    lean: f32,
    flex: f32,
    nod: f32,
    wave: [(f32, f32); 6],
}

/// The rig, the style and the random stream of one rendered motion.
pub(crate) struct Actor {
    /// Measured skeleton.
    pub rig: Rig,
    /// Personal deviations.
    pub style: Style,
    /// Random stream for further draws, consumed in the order in which the motion requests them.
    pub dice: Dice,
    /// Amount of stooping: 0 is upright, 1 is stooped.
    pub stoop: f32,
}

impl Actor {
    /// Creates a person of the given height; the seed determines the style.
    pub(crate) fn new(height_m: f32, seed: u64) -> Self {
        let mut dice = Dice::new(seed, "actor");
        let style = Style {
            tempo: 1.0 + 0.07 * dice.bell(),
            size: 1.0 + 0.12 * dice.bell(),
            lag_s: dice.range(0.0, 0.05),
            arm_azimuth: 0.8 + 0.3 * dice.bell(),
            arm_elevation: -1.47 + 0.08 * dice.bell(),
            arm_reach: [0.97 + 0.025 * dice.bell(), 0.97 + 0.025 * dice.bell()],
            stance: 1.0 + 0.25 * dice.bell(),
            stagger: 0.03 * dice.bell(),
            toe_out: 0.13 + 0.1 * dice.bell(),
            lean: 0.02 * dice.bell(),
            flex: 0.06 + 0.06 * dice.bell(),
            nod: 0.02 + 0.1 * dice.bell(),
            wave: std::array::from_fn(|_| (dice.range(0.15, 0.45), dice.range(0.0, TAU))),
        };
        Self {
            rig: Rig::new(height_m),
            style,
            dice,
            stoop: 0.0,
        }
    }

    /// A person without personal deviations, used for planning.
    pub(crate) fn average(height_m: f32) -> Self {
        let mut actor = Self::new(height_m, 0);
        actor.style.tempo = 1.0;
        actor.style.size = 1.0;
        actor.style.lag_s = 0.0;
        actor
    }

    /// Scales an authored distance in metres to the size of this person.
    pub(crate) fn m(&self, authored_m: f32) -> f32 {
        authored_m * self.rig.scale
    }

    /// Scales a duration authored at speed 1 by the speed, the person's tempo and a little jitter,
    /// s.
    pub(crate) fn s(&mut self, authored_s: f32, speed: f32) -> f32 {
        authored_s * self.style.tempo * (1.0 + 0.06 * self.dice.bell()) / speed
    }

    /// Scales an authored amplitude by the person's size factor and a little jitter.
    pub(crate) fn a(&mut self, authored: f32) -> f32 {
        authored * self.style.size * (1.0 + 0.06 * self.dice.bell())
    }

    /// The arm hanging at the side.
    pub(crate) fn arm_down(&self, side: usize) -> Arm {
        Arm {
            // Arms hang vertically under gravity, independently of the tilt of the back.
            elevation: self.style.arm_elevation + self.stoop_tilt(),
            azimuth: self.style.arm_azimuth * (1.0 - 0.8 * self.stoop),
            reach: self.style.arm_reach[side],
            pole: Vec3::new(0.25, 0.0, -1.0),
            flex: 0.1,
            ..Arm::default()
        }
    }

    /// Tilt of the chest due to stooping, rad.
    pub(crate) fn stoop_tilt(&self) -> f32 {
        0.55 * self.stoop
    }

    /// Relaxed standing at the origin, facing +z.
    pub(crate) fn standing(&self) -> Control {
        let s = &self.style;
        let foot = |side: usize| Foot {
            at: Vec3::new(
                SIDE_SIGN[side] * self.rig.stance_m * s.stance,
                0.0,
                self.rig.foot_z_m() + SIDE_SIGN[side] * s.stagger * self.rig.scale,
            ),
            yaw: SIDE_SIGN[side] * s.toe_out,
            ..Foot::default()
        };
        Control {
            hip: Vec3::new(0.0, self.rig.pelvis_m * (0.991 - 0.03 * self.stoop), 0.0),
            pitch: s.lean + 0.12 * self.stoop,
            flex: s.flex + 0.45 * self.stoop,
            nod: s.nod - 0.2 * self.stoop,
            feet: [foot(0), foot(1)],
            arms: [self.arm_down(0), self.arm_down(1)],
            balance: 1.0,
            bias: 0.5,
            ..Control::default()
        }
    }

    /// Pelvis height when seated, m. The pelvis joint is a little above the seat.
    pub(crate) fn seated_pelvis_m(&self) -> f32 {
        SEAT_M.min(0.482 * self.rig.scale) + self.m(0.075)
    }

    /// Seated on a chair behind the standing position, with the hands on the thighs.
    pub(crate) fn seated(&self) -> Control {
        let mut c = self.standing();
        c.hip = Vec3::new(
            0.0,
            self.seated_pelvis_m(),
            self.rig.foot_z_m() - self.m(0.37),
        );
        c.pitch = -0.08 + self.style.lean;
        c.flex = 0.2 + self.style.flex;
        c.balance = 0.0;
        for side in 0..2 {
            c.feet[side].yaw = SIDE_SIGN[side] * self.style.toe_out;
            c.feet[side].knee_out = 0.12;
            c.arms[side].elevation = -0.98;
            c.arms[side].azimuth = -0.02;
            c.arms[side].reach = 0.8;
            c.arms[side].pole = Vec3::new(0.6, 0.0, -1.0);
        }
        c
    }

    /// Lying on the back behind the standing position, with the feet towards +z.
    pub(crate) fn lying(&self) -> Control {
        let mut c = self.standing();
        c.hip = Vec3::new(0.0, self.m(0.105), -self.m(0.62));
        c.pitch = -FRAC_PI_2;
        c.flex = 0.02;
        c.nod = 0.12;
        c.balance = 0.0;
        for side in 0..2 {
            let x = SIDE_SIGN[side] * self.m(0.13);
            let ankle = Vec3::new(x, 0.0, c.hip.z + 0.995 * self.rig.leg_m + self.m(0.072));
            c.feet[side] = self
                .rig
                .foot_for_ankle(ankle, SIDE_SIGN[side] * 0.35, 1.15, 0.0);
            c.arms[side].elevation = -1.2;
            c.arms[side].azimuth = 1.75;
            c.arms[side].reach = 0.96;
            c.arms[side].pole = Vec3::new(1.0, 0.0, -0.2);
        }
        c
    }

    /// Adds the sway of somebody who exercises: the trunk turns, and the returned offset of the centre of mass wanders by
    /// `sway_m` at 0.3 to 0.9 Hz. The feet stay where they are.
    pub(crate) fn add_sway(&mut self, frames: &mut [Control], sway_m: f32) -> Vec<Vec3> {
        if sway_m == 0.0 {
            return vec![Vec3::ZERO; frames.len()];
        }
        let mut wave = || {
            let (hz, phase) = (self.dice.range(0.3, 0.9), self.dice.range(0.0, TAU));
            move |time: f32| (TAU * hz * time + phase).sin()
        };
        let (across, along, turn) = (wave(), wave(), wave());
        let sway = |(frame, c): (usize, &mut Control)| {
            let time = (frame as f64 / FPS) as f32;
            c.twist += 2.0 * sway_m * c.balance.clamp(0.0, 1.0) * turn(time);
            sway_m * Vec3::new(across(time), 0.0, along(time))
        };
        frames.iter_mut().enumerate().map(sway).collect()
    }

    /// Adds the small steps of somebody who exercises: the whole body wanders by up to `wander_m` at 0.2 to 0.7 Hz, mostly
    /// along its facing, and the feet follow one after the other. The path is the same for all frames of free standing.
    pub(crate) fn add_steps(&mut self, frames: &mut [Control], wander_m: f32) {
        let mut wave = |share: f32| {
            let (hz, phase) = (self.dice.range(0.2, 0.7), self.dice.range(0.0, TAU));
            move |time: f32| share * (TAU * hz * time + phase).sin()
        };
        let (along, faster, across) = (wave(0.65), wave(0.35), wave(0.4));
        let start = Vec3::new(across(0.0), 0.0, along(0.0) + faster(0.0));
        let offset = |time: f32| {
            wander_m * (Vec3::new(across(time), 0.0, along(time) + faster(time)) - start)
        };
        // Each foot moves for half of the period, the left one in the first half.
        let period_s = self.dice.range(0.55, 0.9);
        for (frame, c) in frames.iter_mut().enumerate() {
            let time = (frame as f64 / FPS) as f32;
            let weight = c.balance.clamp(0.0, 1.0);
            c.hip += weight * offset(time);
            for side in 0..2 {
                let steps = time / period_s - 0.5 * side as f32;
                let (n, phase) = (steps.floor(), steps - steps.floor());
                // Where the body is in the middle between this step and the next one of the foot.
                let target = |n: f32| offset(((n + 1.0 + 0.5 * side as f32) * period_s).max(0.0));
                let (from, to) = (target(n - 1.0), target(n));
                let done = (2.0 * phase).min(1.0);
                let at = from.lerp(to, smooth(done));
                let lift_m =
                    (0.3 * from.distance(to)).min(self.m(0.05)) * 4.0 * done * (1.0 - done);
                c.feet[side].at += weight * (at + Vec3::Y * lift_m);
            }
        }
    }

    /// Adds breathing and slow postural sway to every frame.
    pub(crate) fn add_idle(&self, frames: &mut [Control]) {
        let gentle = |time: f32, n: usize| {
            let (hz, phase) = self.style.wave[n];
            (TAU * hz * time + phase).sin()
        };
        for (frame, c) in frames.iter_mut().enumerate() {
            let time = (frame as f64 / FPS) as f32;
            // Sway applies to free standing only; a lying or seated person only breathes.
            let sway = c.balance.clamp(0.0, 1.0);
            c.hip.x += self.m(0.006) * sway * gentle(time, 0);
            c.hip.z += self.m(0.007) * sway * gentle(time, 1);
            let breath = (TAU * 0.27 * time + self.style.wave[2].1).sin();
            c.flex -= 0.012 * breath;
            c.side += 0.010 * sway * gentle(time, 3);
            c.twist += 0.014 * sway * gentle(time, 4);
            c.look += 0.03 * gentle(time, 5);
            for arm in &mut c.arms {
                arm.shrug += 0.012 * breath;
            }
        }
    }
}
