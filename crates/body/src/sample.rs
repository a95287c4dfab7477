//! Interpolation between frames and operations on whole motions.

use crate::proportions::{SOLE_BELOW_FOOT, standing_height_m};
use glam::{Quat, Vec2, Vec3, Vec4};
use radarllm_base::skeleton::N_JOINTS;
use radarllm_base::{Joint, Motion, Pose, Skeleton};

/// A motion as a smooth, twice continuously differentiable function of time.
///
/// Root positions are a cubic spline through the frames. Rotations are cubic splines of the four
/// quaternion components, normalised afterwards. Linear interpolation has velocity jumps at each
/// frame, which cause spurious Doppler lines. The spline velocity is continuous and accurate to
/// fourth order in the frame period: a 2 Hz motion at 30 fps is accurate to 0.1 %, while central
/// differences lose 3 %.
#[derive(Clone, Debug)]
pub struct MotionSampler {
    fps: f64,
    skeleton: Skeleton,
    roots: Vec<Vec3>,
    root_slopes: Vec<Vec3>,
    /// `[frame][joint]`, with signs chosen so that consecutive quaternions are close.
    rotations: Vec<[Vec4; N_JOINTS]>,
    rotation_slopes: Vec<[Vec4; N_JOINTS]>,
}

impl MotionSampler {
    /// Computes the spline coefficients of a motion; memory use is a few times the size of the
    /// motion.
    pub fn new(motion: &Motion) -> Self {
        let roots: Vec<Vec3> = motion.poses.iter().map(|p| p.root_in_world).collect();
        let mut rotations: Vec<[Vec4; N_JOINTS]> = Vec::with_capacity(motion.len());
        for pose in &motion.poses {
            let mut row = pose.rotations.map(Vec4::from);
            if let Some(previous) = rotations.last() {
                for (q, before) in row.iter_mut().zip(previous) {
                    if q.dot(*before) < 0.0 {
                        *q = -*q;
                    }
                }
            }
            rotations.push(row);
        }
        let root_slopes = spline_slopes(roots.len(), |i| [roots[i]])
            .into_iter()
            .map(|[m]| m)
            .collect();
        let rotation_slopes = spline_slopes(rotations.len(), |i| rotations[i]);
        Self {
            fps: motion.fps,
            skeleton: motion.skeleton.clone(),
            roots,
            root_slopes,
            rotations,
            rotation_slopes,
        }
    }

    /// Bone vectors of the skeleton.
    pub fn skeleton(&self) -> &Skeleton {
        &self.skeleton
    }

    /// Time of the last frame, s.
    pub fn end_s(&self) -> f64 {
        self.roots.len().saturating_sub(1) as f64 / self.fps
    }

    /// Pose at `time_s`. Times before the first or after the last frame give that frame.
    ///
    /// A motion without poses gives the T-pose at the origin.
    pub fn sample(&self, time_s: f64) -> Pose {
        let Some(last) = self.roots.len().checked_sub(1) else {
            return Pose {
                root_in_world: Vec3::ZERO,
                rotations: [Quat::IDENTITY; N_JOINTS],
            };
        };
        // NaN does not clamp to either end; it is treated as the start.
        let position = (time_s * self.fps).max(0.0).min(last as f64);
        let i = (position as usize).min(last.saturating_sub(1));
        let k = (i + 1).min(last);
        let u = (position - i as f64) as f32;
        let root_in_world = hermite(
            self.roots[i],
            self.roots[k],
            self.root_slopes[i],
            self.root_slopes[k],
            u,
        );
        let mut rotations = [Quat::IDENTITY; N_JOINTS];
        for (j, rotation) in rotations.iter_mut().enumerate() {
            let (a, b) = (self.rotations[i][j], self.rotations[k][j]);
            let q = hermite(
                a,
                b,
                self.rotation_slopes[i][j],
                self.rotation_slopes[k][j],
                u,
            );
            // The spline comes near zero only if the data have glitches of half a turn between
            // frames.
            *rotation = if q.length_squared() > 0.05 {
                Quat::from_vec4(q.normalize())
            } else {
                Quat::from_vec4(a)
                    .normalize()
                    .slerp(Quat::from_vec4(b).normalize(), u)
            };
        }
        Pose {
            root_in_world,
            rotations,
        }
    }
}

/// Vector operations required by the spline.
trait Linear:
    Copy
    + std::ops::Add<Output = Self>
    + std::ops::Sub<Output = Self>
    + std::ops::Mul<f32, Output = Self>
{
}
impl Linear for Vec3 {}
impl Linear for Vec4 {}

/// Cubic Hermite interpolation with given end values and slopes per frame, at fraction `u`.
fn hermite<V: Linear>(a: V, b: V, slope_a: V, slope_b: V, u: f32) -> V {
    let (u2, u3) = (u * u, u * u * u);
    a * (2.0 * u3 - 3.0 * u2 + 1.0)
        + slope_a * (u3 - 2.0 * u2 + u)
        + b * (3.0 * u2 - 2.0 * u3)
        + slope_b * (u3 - u2)
}

/// Slopes per frame that make the piecewise cubic twice differentiable: m[i-1] + 4 m[i] + m[i+1] =
/// 3 (p[i+1] - p[i-1]), solved by Thomas elimination. At the ends the slope is that of the parabola
/// through the three outermost points.
fn spline_slopes<V: Linear, const N: usize>(n: usize, at: impl Fn(usize) -> [V; N]) -> Vec<[V; N]> {
    let combine = |terms: &[(usize, f32)]| -> [V; N] {
        let mut sum = at(terms[0].0).map(|v| v * terms[0].1);
        for (i, weight) in &terms[1..] {
            for (s, v) in sum.iter_mut().zip(at(*i)) {
                *s = *s + v * *weight;
            }
        }
        sum
    };
    match n {
        0 => return Vec::new(),
        1 => return vec![combine(&[(0, 0.0)])],
        2 => return vec![combine(&[(1, 1.0), (0, -1.0)]); 2],
        _ => {}
    }
    let mut slopes = vec![combine(&[(0, -1.5), (1, 2.0), (2, -0.5)])];
    let mut factors = vec![0.0_f32];
    for i in 1..n - 1 {
        let factor = 1.0 / (4.0 - factors[i - 1]);
        let mut row = combine(&[(i + 1, 3.0), (i - 1, -3.0)]);
        for (r, before) in row.iter_mut().zip(slopes[i - 1]) {
            *r = (*r - before) * factor;
        }
        slopes.push(row);
        factors.push(factor);
    }
    slopes.push(combine(&[(n - 1, 1.5), (n - 2, -2.0), (n - 3, 0.5)]));
    for i in (1..n - 1).rev() {
        let after = slopes[i + 1];
        let factor = factors[i];
        for (m, next) in slopes[i].iter_mut().zip(after) {
            *m = *m - next * factor;
        }
    }
    slopes
}

/// A frame rate outside the supported range.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("{fps} frames a second: a motion has 0.1 to 10000")]
pub struct FrameRateError {
    /// The requested frame rate, frames per second.
    pub fps: f64,
}

/// Checks a frame rate in frames per second and returns it if it is supported.
///
/// # Errors
/// [`FrameRateError`] below 0.1, above 10,000, and for NaN.
pub fn check_fps(fps: f64) -> Result<f64, FrameRateError> {
    if (0.1..=10_000.0).contains(&fps) {
        Ok(fps)
    } else {
        Err(FrameRateError { fps })
    }
}

/// Resamples the motion to another frame rate with [`MotionSampler`]. The result covers the same
/// time from first to last frame.
///
/// # Errors
/// [`FrameRateError`] for a rate that [`check_fps`] rejects.
pub fn resample(motion: &Motion, fps: f64) -> Result<Motion, FrameRateError> {
    Ok(resample_unchecked(motion, check_fps(fps)?))
}

/// Like [`resample`], for a rate that is known to be in range.
pub(crate) fn resample_unchecked(motion: &Motion, fps: f64) -> Motion {
    if motion.is_empty() || fps == motion.fps {
        return Motion {
            fps,
            ..motion.clone()
        };
    }
    let sampler = MotionSampler::new(motion);
    // The millionth of a frame prevents integer ratios (120 to 20 fps) from losing their last
    // frame.
    let n = (sampler.end_s() * fps + 1e-6).floor() as usize + 1;
    let poses = (0..n).map(|i| sampler.sample(i as f64 / fps)).collect();
    Motion {
        fps,
        skeleton: motion.skeleton.clone(),
        poses,
    }
}

/// The frames from `start_s` (inclusive) to `end_s` (exclusive); at least one frame is kept.
pub fn crop(motion: &Motion, start_s: f64, end_s: f64) -> Motion {
    let n = motion.len();
    let frame = |time_s: f64| (time_s * motion.fps - 1e-6).ceil().max(0.0) as usize;
    let start = frame(start_s).min(n.saturating_sub(1));
    let end = frame(end_s).clamp((start + 1).min(n), n);
    Motion {
        fps: motion.fps,
        skeleton: motion.skeleton.clone(),
        poses: motion.poses[start..end].to_vec(),
    }
}

/// Mirrors the motion: left and right are exchanged and x changes sign.
pub fn mirror(motion: &Motion) -> Motion {
    let flip = |v: Vec3| Vec3::new(-v.x, v.y, v.z);
    // A rotation axis is a pseudovector, so reflection in x changes the sign of its y and z
    // components.
    let flip_rotation = |q: Quat| Quat::from_xyzw(q.x, -q.y, -q.z, q.w);
    let mut skeleton = motion.skeleton.clone();
    for joint in Joint::ALL {
        skeleton.offsets[joint as usize] = flip(motion.skeleton.offsets[opposite(joint) as usize]);
    }
    let poses = motion
        .poses
        .iter()
        .map(|pose| {
            let mut rotations = pose.rotations;
            for joint in Joint::ALL {
                rotations[joint as usize] = flip_rotation(pose.rotations[opposite(joint) as usize]);
            }
            Pose {
                root_in_world: flip(pose.root_in_world),
                rotations,
            }
        })
        .collect();
    Motion {
        fps: motion.fps,
        skeleton,
        poses,
    }
}

/// Shortest way whose path can be bent, m.
pub const SHORTEST_BENT_M: f32 = 1.5;
/// Largest distance of the pelvis from the line between the ends of a path that counts as straight, as a share of its
/// length.
const STRAIGHT: f32 = 0.15;

/// A path that cannot be bent.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PathError {
    /// The ends are too close to each other.
    #[error(
        "the pelvis moves by {way_m:.2} m, at least {SHORTEST_BENT_M} m are needed to bend its path"
    )]
    Short {
        /// Distance between first and last pelvis position on the floor, m.
        way_m: f32,
    },
    /// The path is not straight.
    #[error("the path is not straight: {aside_m:.2} m beside a line of {way_m:.2} m")]
    Curved {
        /// Largest distance from the line between the ends, m.
        aside_m: f32,
        /// Distance between the ends, m.
        way_m: f32,
    },
}

/// Bends a straight path to the left by `angle_rad`, or to the right if it is negative: who walked straight ahead turns
/// in the middle, within a third of the way, at most 2 m (path editing; Gleicher, 2001).
///
/// Every pose is moved and turned as a whole, so that the gait stays as it was recorded. Feet on the floor slide by what
/// the path turns during a step.
///
/// # Errors
/// [`PathError`] for a path that is short or not straight.
pub fn bend_path(motion: &Motion, angle_rad: f32) -> Result<Motion, PathError> {
    let place = |pose: &Pose| pose.root_in_world.truncate();
    let ends = motion.poses.first().zip(motion.poses.last());
    let (start, end) = ends.map_or((Vec2::ZERO, Vec2::ZERO), |(a, b)| (place(a), place(b)));
    let way_m = start.distance(end);
    // NaN is short, too.
    if way_m.is_nan() || way_m < SHORTEST_BENT_M {
        return Err(PathError::Short { way_m });
    }
    let ahead = (end - start) / way_m;
    // Distance along the line and to the left of it, m.
    let along = |at: Vec2| (at - start).dot(ahead);
    let beside = |at: Vec2| ahead.perp_dot(at - start);
    let aside_m = motion
        .poses
        .iter()
        .map(|pose| beside(place(pose)).abs())
        .fold(0.0, f32::max);
    if aside_m > STRAIGHT * way_m {
        return Err(PathError::Curved { aside_m, way_m });
    }
    let curve_m = (way_m / 3.0).min(2.0);
    let before_m = 0.5 * (way_m - curve_m);
    let radius_m = curve_m / angle_rad;
    // Place and direction of the bent path after `s` m, in a frame that looks ahead from the start.
    let bent = |s: f32| {
        let turned = angle_rad * ((s - before_m) / curve_m).clamp(0.0, 1.0);
        let (first_m, last_m) = (s.min(before_m), (s - before_m - curve_m).max(0.0));
        // Chord of the arc; a straight path has no radius.
        let (sin_m, cos_m) = match angle_rad == 0.0 {
            true => ((s - before_m).clamp(0.0, curve_m), 0.0),
            false => (radius_m * turned.sin(), radius_m * (1.0 - turned.cos())),
        };
        let on = Vec2::new(first_m + sin_m, cos_m) + last_m * Vec2::from_angle(turned);
        (on, turned)
    };
    let poses = motion
        .poses
        .iter()
        .map(|pose| {
            let at = place(pose);
            let (on, turned) = bent(along(at));
            let on = on + beside(at) * Vec2::from_angle(turned).perp();
            let moved = start + ahead.rotate(on);
            let turn = Quat::from_rotation_z(turned);
            let mut rotations = pose.rotations;
            rotations[0] = (turn * rotations[0]).normalize();
            Pose {
                root_in_world: moved.extend(pose.root_in_world.z),
                rotations,
            }
        })
        .collect();
    Ok(Motion {
        fps: motion.fps,
        skeleton: motion.skeleton.clone(),
        poses,
    })
}

/// The corresponding joint on the other side of the body.
pub fn opposite(joint: Joint) -> Joint {
    use Joint::*;
    match joint {
        LeftHip => RightHip,
        RightHip => LeftHip,
        LeftKnee => RightKnee,
        RightKnee => LeftKnee,
        LeftAnkle => RightAnkle,
        RightAnkle => LeftAnkle,
        LeftFoot => RightFoot,
        RightFoot => LeftFoot,
        LeftCollar => RightCollar,
        RightCollar => LeftCollar,
        LeftShoulder => RightShoulder,
        RightShoulder => LeftShoulder,
        LeftElbow => RightElbow,
        RightElbow => LeftElbow,
        LeftWrist => RightWrist,
        RightWrist => LeftWrist,
        middle => middle,
    }
}

/// Moves a motion to the canonical placement: the first pelvis position above the origin, the first
/// heading along -y, and the floor at z = 0.
pub fn canonicalize(motion: &mut Motion) {
    ground(motion);
    let Some(first) = motion.poses.first() else {
        return;
    };
    let forward = heading(&motion.skeleton, first);
    // Angle that rotates `forward` to -y.
    let yaw_rad = -std::f32::consts::FRAC_PI_2 - forward.y.atan2(forward.x);
    let turn = Quat::from_rotation_z(yaw_rad);
    let start = Vec3::new(first.root_in_world.x, first.root_in_world.y, 0.0);
    for pose in &mut motion.poses {
        pose.root_in_world = turn * (pose.root_in_world - start);
        pose.rotations[0] = (turn * pose.rotations[0]).normalize();
    }
}

/// Horizontal heading of a pose from hips and shoulders, as HumanML3D defines it.
fn heading(skeleton: &Skeleton, pose: &Pose) -> Vec3 {
    let (p, q) = skeleton.forward(pose);
    let across = |l: Joint, r: Joint| (p[l as usize] - p[r as usize]).normalize_or_zero();
    let left =
        across(Joint::LeftHip, Joint::RightHip) + across(Joint::LeftShoulder, Joint::RightShoulder);
    // Left cross up is forward. A person lying on one side has no such direction. In that case the
    // pelvis' forward axis is used, or its upward axis if the person is lying on the back or face.
    [
        left.cross(Vec3::Z),
        (q[0] * Vec3::Z).reject_from(Vec3::Z),
        (q[0] * Vec3::Y).reject_from(Vec3::Z),
    ]
    .into_iter()
    .find(|v| v.length() > 0.2)
    .unwrap_or(Vec3::NEG_Y)
    .normalize()
}

/// Moves the motion vertically so that the floor is at z = 0.
///
/// The floor is the height of the lowest body part in the lowest twentieth of the frames. Each
/// joint is lowered by the thickness of the flesh below it.
pub(crate) fn ground(motion: &mut Motion) {
    let floor_m = floor_height_m(motion);
    for pose in &mut motion.poses {
        pose.root_in_world.z -= floor_m;
    }
}

fn floor_height_m(motion: &Motion) -> f32 {
    let height_m = standing_height_m(&motion.skeleton);
    // At most about 4096 to 8192 frames are evaluated: enough for a percentile and fast for hours
    // of motion.
    let step = (motion.len() / 4096).max(1);
    let mut lows: Vec<f32> = motion
        .poses
        .iter()
        .step_by(step)
        .map(|pose| {
            let (p, _) = motion.skeleton.forward(pose);
            Joint::ALL
                .into_iter()
                .map(|j| p[j as usize].z - flesh_below(j) * height_m)
                .fold(f32::INFINITY, f32::min)
        })
        .collect();
    lows.sort_by(f32::total_cmp);
    lows.get(lows.len() / 20)
        .copied()
        .filter(|z| z.is_finite())
        .unwrap_or(0.0)
}

/// Distance from a joint to the skin below it when that body part rests on the floor, as a share of
/// the height.
fn flesh_below(joint: Joint) -> f32 {
    match joint {
        Joint::LeftFoot | Joint::RightFoot => SOLE_BELOW_FOOT,
        // The ankles rest on the heel.
        Joint::LeftAnkle | Joint::RightAnkle => 0.054,
        Joint::LeftWrist | Joint::RightWrist | Joint::LeftElbow | Joint::RightElbow => 0.02,
        Joint::LeftKnee | Joint::RightKnee => 0.035,
        _ => 0.05,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::proportions::canonical_skeleton;
    use radarllm_base::frames::world_from_rest_facing_radar;
    use std::f64::consts::TAU;

    fn still(n: usize, fps: f64) -> Motion {
        let mut rotations = [Quat::IDENTITY; N_JOINTS];
        rotations[0] = world_from_rest_facing_radar();
        let pose = Pose {
            root_in_world: Vec3::new(0.3, -0.2, 1.0),
            rotations,
        };
        Motion {
            fps,
            skeleton: canonical_skeleton(1.72),
            poses: vec![pose; n],
        }
    }

    /// A walk of 4 m along x within 4 s, with a sway of 3 cm.
    fn walking() -> Motion {
        let mut motion = still(121, 30.0);
        for (t, pose) in motion.poses.iter_mut().enumerate() {
            let time_s = t as f32 / 30.0;
            pose.root_in_world.x += time_s;
            pose.root_in_world.y += 0.03 * (TAU as f32 * time_s).sin();
        }
        motion
    }

    #[test]
    fn a_bent_path_keeps_its_length_and_turns_by_the_angle() {
        let motion = walking();
        let direction = |m: &Motion, i: usize| {
            let step = m.poses[i + 30].root_in_world - m.poses[i].root_in_world;
            step.y.atan2(step.x)
        };
        for angle in [-2.0_f32, -0.6, 0.0, 1.2, 3.0] {
            let bent = bend_path(&motion, angle).unwrap();
            let turned = direction(&bent, 90) - direction(&bent, 0);
            assert!((turned - angle).abs() < 1e-3, "{turned} for {angle}");
            // Positive is to the left, as seen from above with z up.
            let aside_m = bent.poses[120].root_in_world.y - bent.poses[0].root_in_world.y;
            assert!(aside_m * angle >= -1e-6, "{aside_m} for {angle}");
            for (i, pair) in bent.poses.windows(2).enumerate() {
                let step_m = pair[0].root_in_world.distance(pair[1].root_in_world);
                let own = &motion.poses[i..=i + 1];
                let own_m = own[0].root_in_world.distance(own[1].root_in_world);
                assert!((step_m / own_m - 1.0).abs() < 0.15, "{step_m} for {own_m}");
            }
            let yaw = bent.poses[120].rotations[0] * motion.poses[120].rotations[0].inverse();
            assert!(yaw.angle_between(Quat::from_rotation_z(angle)) < 1e-3);
        }
        let same = bend_path(&motion, 0.0).unwrap();
        assert!(
            same.poses
                .iter()
                .zip(&motion.poses)
                .all(|(a, b)| { a.root_in_world.distance(b.root_in_world) < 1e-5 })
        );
    }

    #[test]
    fn short_and_curved_paths_are_not_bent() {
        let short = bend_path(&still(30, 30.0), 1.0);
        assert_eq!(short, Err(PathError::Short { way_m: 0.0 }));
        let curved = bend_path(&bend_path(&walking(), 2.0).unwrap(), 1.0);
        assert!(
            matches!(curved, Err(PathError::Curved { .. })),
            "{curved:?}"
        );
        let mut lost = walking();
        lost.poses[120].root_in_world.x = f32::NAN;
        assert!(bend_path(&lost, 1.0).is_err());
    }

    /// A 2 Hz oscillation of the shoulder and the root at 30 fps.
    fn swinging() -> Motion {
        let mut motion = still(61, 30.0);
        for (t, pose) in motion.poses.iter_mut().enumerate() {
            let phase = (TAU * 2.0 * t as f64 / 30.0) as f32;
            pose.root_in_world.x = 0.1 * phase.sin();
            pose.rotations[Joint::LeftShoulder as usize] = Quat::from_rotation_y(0.8 * phase.sin());
        }
        motion
    }

    /// Maximum error of the sampled velocity against the exact derivative, relative to its peak.
    fn worst_velocity_error(sample: impl Fn(f64) -> (f32, f32)) -> (f64, f64) {
        let step_s = 2e-3;
        let peak = TAU * 2.0;
        let (mut root, mut angle) = (0.0_f64, 0.0_f64);
        for k in 200..1800 {
            let t = f64::from(k) * 1e-3;
            let (a, b) = (sample(t - step_s), sample(t + step_s));
            let exact = peak * (peak * t).cos();
            root = root
                .max((f64::from(b.0 - a.0) / (2.0 * step_s) - 0.1 * exact).abs() / (0.1 * peak));
            angle = angle
                .max((f64::from(b.1 - a.1) / (2.0 * step_s) - 0.8 * exact).abs() / (0.8 * peak));
        }
        (root, angle)
    }

    #[test]
    fn velocity_of_a_swing_is_right_between_frames() {
        let motion = swinging();
        let sampler = MotionSampler::new(&motion);
        let angle_of = |q: Quat| 2.0 * q.y.atan2(q.w);
        let (root, angle) = worst_velocity_error(|t| {
            let pose = sampler.sample(t);
            (
                pose.root_in_world.x,
                angle_of(pose.rotations[Joint::LeftShoulder as usize]),
            )
        });
        let (linear_root, linear_angle) = worst_velocity_error(|t| {
            let i = (t * 30.0) as usize;
            let u = (t * 30.0 - i as f64) as f32;
            let (a, b) = (&motion.poses[i], &motion.poses[i + 1]);
            let s = Joint::LeftShoulder as usize;
            (
                a.root_in_world.x + u * (b.root_in_world.x - a.root_in_world.x),
                angle_of(a.rotations[s].slerp(b.rotations[s], u)),
            )
        });
        // The spline's velocity error is largest between frames, about (w h)^3 / 72 = 0.1 % at
        // w h = 0.42; the test's own difference quotient adds (w dt)^2 / 6 = 0.01 %, rounding
        // 0.05 %. Chords are off by w h / 2 = 21 %.
        assert!(root < 0.005 && angle < 0.01, "{root} {angle}");
        assert!(
            linear_root > 0.1 && linear_angle > 0.1,
            "{linear_root} {linear_angle}"
        );
    }

    #[test]
    fn samples_pass_through_frames_and_clamp() {
        let motion = swinging();
        let sampler = MotionSampler::new(&motion);
        for (i, pose) in motion.poses.iter().enumerate() {
            let sampled = sampler.sample(i as f64 / 30.0);
            // f32 rounding of the time within a frame times the speed.
            assert!(sampled.root_in_world.distance(pose.root_in_world) < 1e-5);
        }
        assert_eq!(sampler.sample(-5.0), sampler.sample(0.0));
        assert_eq!(sampler.sample(1e9), sampler.sample(sampler.end_s()));
        assert!(sampler.sample(f64::NAN).root_in_world.is_finite());
        for n in 1..4 {
            let short = still(n, 10.0);
            assert!(
                MotionSampler::new(&short)
                    .sample(0.05)
                    .root_in_world
                    .distance(short.poses[0].root_in_world)
                    < 1e-6
            );
        }
    }

    #[test]
    fn quaternion_signs_do_not_matter() {
        let motion = swinging();
        let mut flipped = motion.clone();
        for pose in flipped.poses.iter_mut().step_by(2) {
            pose.rotations = pose.rotations.map(|q| -q);
        }
        let (a, b) = (MotionSampler::new(&motion), MotionSampler::new(&flipped));
        for k in 0..100 {
            let (p, q) = (a.sample(f64::from(k) * 0.02), b.sample(f64::from(k) * 0.02));
            for j in 0..N_JOINTS {
                assert!(p.rotations[j].dot(q.rotations[j]).abs() > 1.0 - 1e-5);
            }
        }
    }

    #[test]
    fn canonical_motion_starts_at_the_origin_facing_the_radar() {
        let mut motion = still(5, 10.0);
        for pose in &mut motion.poses {
            pose.rotations[0] = Quat::from_rotation_z(2.1) * pose.rotations[0];
        }
        canonicalize(&mut motion);
        let first = &motion.poses[0];
        assert!(first.root_in_world.truncate().length() < 1e-6);
        // Standing height of the pelvis by construction of the skeleton.
        assert!(
            (first.root_in_world.z - 0.560 * 1.72).abs() < 1e-4,
            "{}",
            first.root_in_world.z
        );
        assert!((first.rotations[0] * Vec3::Z).distance(Vec3::NEG_Y) < 1e-5);
        assert!((first.rotations[0] * Vec3::X).distance(Vec3::X) < 1e-5);
    }

    #[test]
    fn mirroring_reflects_every_joint_and_undoes_itself() {
        let motion = swinging();
        let mirrored = mirror(&motion);
        let (a, b) = (motion.joints_in_world(), mirrored.joints_in_world());
        for (p, q) in a.iter().zip(&b) {
            for joint in Joint::ALL {
                let expected = p[opposite(joint) as usize] * Vec3::new(-1.0, 1.0, 1.0);
                // f32 rounding along a chain of eight joints.
                assert!(q[joint as usize].distance(expected) < 1e-5);
            }
        }
        assert_eq!(mirror(&mirrored), motion);
    }

    #[test]
    fn resampling_and_cropping_count_frames() {
        let motion = swinging();
        assert_eq!(resample(&motion, 20.0).unwrap().len(), 41);
        assert_eq!(resample(&motion, 120.0).unwrap().len(), 241);
        for fps in [0.0, -20.0, 1e6, f64::NAN] {
            assert!(resample(&motion, fps).is_err(), "{fps}");
        }
        assert_eq!(crop(&motion, 0.5, 1.0).len(), 15);
        assert_eq!(crop(&motion, 0.5, 1.0).poses[0], motion.poses[15]);
        assert_eq!(crop(&motion, 50.0, 60.0).len(), 1);
        assert_eq!(crop(&motion, 1.0, 0.5).len(), 1);
    }
}
