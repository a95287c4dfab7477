//! The few dozen numbers an animator thinks in: where the pelvis is, how the trunk bends, where
//! the feet stand and where the hands are. [`crate::rig`] turns them into joint rotations.
//!
//! Everything is in the *stage* frame: x to the left, y up, z forward of the person's start, floor
//! at y = 0. Side 0 is left, side 1 right; `SIDE_SIGN` is the sign of x on each side.

use glam::{Quat, Vec3};

/// Sign of x on the left (0) and right (1) side.
pub const SIDE_SIGN: [f32; 2] = [1.0, -1.0];
/// Number of scalar channels of a [`Control`].
pub const N_CHANNELS: usize = 54;

/// One foot.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Foot {
    /// Floor projection of the ankle of the flat foot; y lifts the sole off the floor, m.
    pub at: Vec3,
    /// Direction of the toes, rad, positive to the left.
    pub yaw: f32,
    /// Rad, positive lifts the toes about the heel, negative the heel about the ball.
    pub pitch: f32,
    /// Rad, about the foot's forward axis.
    pub roll: f32,
    /// Outward turn of the knee, rad.
    pub knee_out: f32,
}

/// One arm. `elevation`, `azimuth` and `reach` place the wrist as seen from the shoulder in the
/// chest's axes; straight-line blending of these keeps the hand out of the shoulder.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Arm {
    /// Rad, -pi/2 hangs, 0 horizontal, pi/2 up; beyond -pi/2 swings behind.
    pub elevation: f32,
    /// Rad, 0 forward, pi/2 outward, negative across the chest.
    pub azimuth: f32,
    /// Shoulder-to-wrist distance in arm lengths.
    pub reach: f32,
    /// Where the elbow points: (outward, up, forward) in the chest's axes.
    pub pole: Vec3,
    /// Wrist goal in the stage, m, used with `world_weight`.
    pub world: Vec3,
    /// 0: the chest-relative goal, 1: the stage goal.
    pub world_weight: f32,
    /// Wrist bend towards the palm, rad.
    pub flex: f32,
    /// Wrist bend towards the thumb, rad.
    pub deviate: f32,
    /// Collar bone raised, rad.
    pub shrug: f32,
}

/// The whole body.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Control {
    /// Pelvis, m.
    pub hip: Vec3,
    /// Pelvis heading, rad, positive to the left.
    pub yaw: f32,
    /// Pelvis lean, rad, positive forward; pi/2 is face down.
    pub pitch: f32,
    /// Pelvis lean, rad, positive to the right.
    pub roll: f32,
    /// Spine, rad: forward bend.
    pub flex: f32,
    /// Spine, rad: bend to the left.
    pub side: f32,
    /// Spine, rad: turn to the left.
    pub twist: f32,
    /// Head, rad: chin down.
    pub nod: f32,
    /// Head, rad: turn to the left.
    pub look: f32,
    /// Head, rad: ear to the left shoulder.
    pub tilt: f32,
    /// Left and right foot.
    pub feet: [Foot; 2],
    /// Left and right arm.
    pub arms: [Arm; 2],
    /// How far the pelvis moves to bring the centre of mass over the support, 0..1.
    pub balance: f32,
    /// Support point between the right (0) and left (1) foot.
    pub bias: f32,
}

impl Control {
    /// Calls `f` on every channel, always in the same order.
    pub fn for_each(&mut self, mut f: impl FnMut(usize, &mut f32)) {
        let mut n = 0;
        let mut visit = |value: &mut f32| {
            f(n, value);
            n += 1;
        };
        let vec = |v: &mut Vec3, visit: &mut dyn FnMut(&mut f32)| {
            visit(&mut v.x);
            visit(&mut v.y);
            visit(&mut v.z);
        };
        vec(&mut self.hip, &mut visit);
        for angle in [
            &mut self.yaw,
            &mut self.pitch,
            &mut self.roll,
            &mut self.balance,
            &mut self.bias,
        ] {
            visit(angle);
        }
        for foot in &mut self.feet {
            vec(&mut foot.at, &mut visit);
            for angle in [
                &mut foot.yaw,
                &mut foot.pitch,
                &mut foot.roll,
                &mut foot.knee_out,
            ] {
                visit(angle);
            }
        }
        for angle in [
            &mut self.flex,
            &mut self.side,
            &mut self.twist,
            &mut self.nod,
            &mut self.look,
            &mut self.tilt,
        ] {
            visit(angle);
        }
        for arm in &mut self.arms {
            for value in [&mut arm.elevation, &mut arm.azimuth, &mut arm.reach] {
                visit(value);
            }
            vec(&mut arm.pole, &mut visit);
            vec(&mut arm.world, &mut visit);
            for value in [
                &mut arm.world_weight,
                &mut arm.flex,
                &mut arm.deviate,
                &mut arm.shrug,
            ] {
                visit(value);
            }
        }
    }

    /// All channels in order.
    pub fn channels(mut self) -> [f32; N_CHANNELS] {
        let mut out = [0.0; N_CHANNELS];
        self.for_each(|n, value| out[n] = *value);
        out
    }

    /// Inverse of [`Control::channels`].
    pub fn from_channels(channels: &[f32; N_CHANNELS]) -> Self {
        let mut out = Self::default();
        out.for_each(|n, value| *value = channels[n]);
        out
    }

    /// Straight-line blend of all channels.
    pub fn lerp(self, other: Self, weight: f32) -> Self {
        let (a, b) = (self.channels(), other.channels());
        Self::from_channels(&std::array::from_fn(|n| a[n] + (b[n] - a[n]) * weight))
    }

    /// Moves the whole person over the floor: turned by `yaw`, then shifted by `shift`.
    pub fn moved(mut self, yaw: f32, shift: Vec3) -> Self {
        let turn = Quat::from_rotation_y(yaw);
        self.hip = turn * self.hip + shift;
        self.yaw += yaw;
        for foot in &mut self.feet {
            foot.at = turn * foot.at + shift;
            foot.yaw += yaw;
        }
        for arm in &mut self.arms {
            arm.world = turn * arm.world + shift;
        }
        self
    }
}

/// True for channels of the head and arms, which trail the trunk by a few frames.
pub fn is_upper(channel: usize) -> bool {
    channel >= 25
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn channels_round_trip_and_are_all_visited() {
        let numbers: [f32; N_CHANNELS] = std::array::from_fn(|n| n as f32 + 0.5);
        let control = Control::from_channels(&numbers);
        assert_eq!(control.channels(), numbers);
        let mut count = 0;
        control.clone().for_each(|_, _| count += 1);
        assert_eq!(count, N_CHANNELS);
        assert_eq!(control.lerp(Control::default(), 1.0), Control::default());
    }
}
