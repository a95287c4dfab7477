//! Points of motions, simulated once and replayed at other places.

use radarllm::radar_sim::{Noise, Scene};
use radarllm::{DEFAULT_RADAR, DspOptions};
use radarllm_base::{Motion, RadarConfig, RadarPoint};
use radarllm_synth::simulate::{open_motion, place};
use radarllm_synth::synthesizer::{posed_builtin, scene_to_points_in_parallel};
use radarllm_synth::{Method, Synthesizer};

/// Height of the radar above the floor, m.
pub const RADAR_M: f32 = 1.2;
/// Frames a second.
pub const RATE_HZ: f64 = 10.0;
/// Distance of the middle of a path before it is moved elsewhere, m.
const DISTANCE_M: f32 = 3.0;
/// Longest edge of the body's facets, m, as in the evaluation of falls.
const FACET_EDGE_M: f32 = 0.03;
/// Frames at the end in which somebody only breathes, if the motion holds its last pose for longer.
const HELD: usize = 90;

/// Points of a motion before the radar.
pub struct Clip {
    frames: Vec<Vec<RadarPoint>>,
    /// Where the person is in the first and in the last frame, m.
    pub start_m: [f32; 2],
    pub end_m: [f32; 2],
    /// The frame in which the pelvis is nearly as low as it will be.
    pub impact: u32,
}

/// Another place for a clip: everything is turned about the radar and moved away from it, which changes neither the
/// radial velocities nor the visible side of the body.
#[derive(Clone, Copy, Debug, Default)]
pub struct Elsewhere {
    pub is_mirrored: bool,
    pub turn_rad: f32,
    pub away_m: f32,
}

impl Elsewhere {
    pub fn of(&self, [x_m, y_m]: [f32; 2]) -> [f32; 2] {
        let x_m = if self.is_mirrored { -x_m } else { x_m };
        let (distance_m, turn_rad) = polar([x_m, y_m]);
        let (distance_m, turn_rad) = (distance_m + self.away_m, turn_rad + self.turn_rad);
        [distance_m * turn_rad.sin(), distance_m * turn_rad.cos()]
    }

    /// The place at which a clip begins where another one has ended.
    pub fn from(at_m: [f32; 2], start_m: [f32; 2], is_mirrored: bool) -> Self {
        let (to_m, to_rad) = polar(at_m);
        let mirrored = Self {
            is_mirrored,
            ..Self::default()
        };
        let (from_m, from_rad) = polar(mirrored.of(start_m));
        Self {
            is_mirrored,
            turn_rad: to_rad - from_rad,
            away_m: to_m - from_m,
        }
    }
}

fn polar([x_m, y_m]: [f32; 2]) -> (f32, f32) {
    (x_m.hypot(y_m), x_m.atan2(y_m))
}

impl Clip {
    pub fn len(&self) -> u32 {
        self.frames.len() as u32
    }

    /// Points of a frame elsewhere. After the end, the last seconds are repeated backwards and forwards in turn.
    pub fn points(&self, n: u32, elsewhere: &Elsewhere) -> Vec<RadarPoint> {
        let (n, last) = (n as usize, self.frames.len() - 1);
        let n = if n <= last {
            n
        } else {
            let loop_length = HELD.min(last);
            let into = (n - last) % (2 * loop_length);
            last - into.min(2 * loop_length - into)
        };
        let moved = |p: &RadarPoint| {
            let [x_m, y_m] = elsewhere.of([p.x_m, p.y_m]);
            RadarPoint {
                x_m,
                y_m,
                range_m: x_m.hypot(y_m).hypot(p.z_m),
                ..*p
            }
        };
        self.frames[n].iter().map(moved).collect()
    }
}

/// Simulates a built-in motion with physics and noise.
pub fn simulate(radar: &RadarConfig, request: &str, seed: u64) -> Clip {
    let input = open_motion(&format!("builtin:{request}"), seed).unwrap();
    let motion = input.motion;
    let mut shape = input.shape;
    shape.facet_edge_m = FACET_EDGE_M;
    let at = place(&motion, DISTANCE_M, RADAR_M);
    let place_of = |n: usize| {
        let place = at.radar_from_world(motion.poses[n].root_in_world);
        [place.x, place.y]
    };
    let (start_m, end_m) = (place_of(0), place_of(motion.poses.len() - 1));
    let impact = (lowest_s(&motion) * RATE_HZ).round() as u32;
    let body = posed_builtin(&motion, shape, at).unwrap();
    let scene = Scene {
        surfaces: vec![&body],
        points: Vec::new(),
        noise: Noise::Thermal,
    };
    let plan = || Synthesizer::new(radar, Method::Fast, DspOptions::default());
    let n_frames = radar.frames_in(motion.duration_s());
    let frames = scene_to_points_in_parallel(plan, &scene, n_frames, seed).unwrap();
    Clip {
        frames: frames.into_iter().map(|f| f.points).collect(),
        start_m,
        end_m,
        impact,
    }
}

/// When the pelvis is first within 5 cm of its lowest height, s.
fn lowest_s(motion: &Motion) -> f64 {
    let heights = motion.poses.iter().map(|pose| pose.root_in_world.z);
    let lowest_m = heights.clone().fold(f32::INFINITY, f32::min);
    let first = heights.clone().position(|z_m| z_m < lowest_m + 0.05);
    first.unwrap() as f64 / motion.fps
}

/// The radar of the soak.
pub fn radar() -> RadarConfig {
    let radar = radarllm_io::open_radar(DEFAULT_RADAR)
        .unwrap()
        .into_config()
        .unwrap();
    assert_eq!(radar.frame_rate_hz(), RATE_HZ);
    radar
}
