//! Animation controls: the few dozen numbers that describe one pose to an animator. They give the
//! position of the pelvis, the bend of the trunk, the feet and the hands. [`crate::rig`] converts
//! them into joint rotations.
//!
//! All values are in the *stage* frame: x to the left, y up, z forward of the person's start, and
//! the floor at y = 0. Side 0 is left and side 1 is right; `SIDE_SIGN` is the sign of x on each
//! side.

use glam::{Quat, Vec3};

/// Sign of x on the left (0) and right (1) sides.
pub(crate) const SIDE_SIGN: [f32; 2] = [1.0, -1.0];
/// Number of scalar channels of a [`Control`].
pub(crate) const N_CHANNELS: usize = 54;

/// Controls of one foot.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Foot {
    /// Position of the ankle of the flat foot, projected onto the floor; y is the height of the
    /// sole above the floor, m.
    pub at: Vec3,
    /// Yaw of the toe direction, rad; positive to the left.
    pub yaw: f32,
    /// Pitch, rad. Positive values lift the toes about the heel; negative values lift the heel
    /// about the ball of the foot.
    pub pitch: f32,
    /// Roll about the forward axis of the foot, rad.
    pub roll: f32,
    /// Outward rotation of the knee, rad.
    pub knee_out: f32,
}

/// Controls of one arm.
///
/// `elevation`, `azimuth` and `reach` give the wrist position in spherical coordinates about the
/// shoulder, in the chest's axes. Linear blending of these coordinates keeps the hand out of the
/// shoulder.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Arm {
    /// Elevation, rad: -pi/2 hangs down, 0 is horizontal, pi/2 is straight up; values below -pi/2
    /// swing behind the body.
    pub elevation: f32,
    /// Azimuth, rad: 0 is forward, pi/2 is outward, negative values are across the chest.
    pub azimuth: f32,
    /// Shoulder-to-wrist distance in arm lengths.
    pub reach: f32,
    /// Pole vector, the direction in which the elbow points: (outward, up, forward) in the chest's
    /// axes.
    pub pole: Vec3,
    /// Wrist target in the stage frame, m; weighted by `world_weight`.
    pub world: Vec3,
    /// Blend weight: 0 uses the chest-relative target, 1 uses the stage target.
    pub world_weight: f32,
    /// Wrist flexion towards the palm, rad.
    pub flex: f32,
    /// Wrist deviation towards the thumb, rad.
    pub deviate: f32,
    /// Elevation of the collar bone, rad.
    pub shrug: f32,
}

/// Controls of the whole body.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Control {
    /// Pelvis position, m.
    pub hip: Vec3,
    /// Pelvis heading, rad, positive to the left.
    pub yaw: f32,
    /// Forward lean of the pelvis, rad; positive is forward, pi/2 is face down.
    pub pitch: f32,
    /// Sideways lean of the pelvis, rad; positive is to the right.
    pub roll: f32,
    /// Forward bend of the spine, rad.
    pub flex: f32,
    /// Sideways bend of the spine, rad; positive is to the left.
    pub side: f32,
    /// Twist of the spine, rad; positive is to the left.
    pub twist: f32,
    /// Nod of the head, rad; positive is chin down.
    pub nod: f32,
    /// Turn of the head, rad; positive is to the left.
    pub look: f32,
    /// Tilt of the head, rad; positive brings the ear to the left shoulder.
    pub tilt: f32,
    /// Left and right foot.
    pub feet: [Foot; 2],
    /// Left and right arm.
    pub arms: [Arm; 2],
    /// Fraction of the pelvis shift that would bring the centre of mass over the support point,
    /// 0..1.
    pub balance: f32,
    /// Position of the support point between the right foot (0) and the left foot (1).
    pub bias: f32,
}

impl Control {
    /// Calls `f` on every channel, always in the same order.
    pub(crate) fn for_each(&mut self, mut f: impl FnMut(usize, &mut f32)) {
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
    pub(crate) fn channels(mut self) -> [f32; N_CHANNELS] {
        let mut out = [0.0; N_CHANNELS];
        self.for_each(|n, value| out[n] = *value);
        out
    }

    /// Inverse of [`Control::channels`].
    pub(crate) fn from_channels(channels: &[f32; N_CHANNELS]) -> Self {
        let mut out = Self::default();
        out.for_each(|n, value| *value = channels[n]);
        out
    }

    /// Linear blend of all channels.
    pub(crate) fn lerp(self, other: Self, weight: f32) -> Self {
        let (a, b) = (self.channels(), other.channels());
        Self::from_channels(&std::array::from_fn(|n| a[n] + (b[n] - a[n]) * weight))
    }

    /// Moves the whole person over the floor: rotates by `yaw`, then translates by `shift`.
    pub(crate) fn moved(mut self, yaw: f32, shift: Vec3) -> Self {
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

/// Returns true for channels of the head and arms, which follow the trunk with a delay of a few
/// frames.
pub(crate) fn is_upper(channel: usize) -> bool {
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
