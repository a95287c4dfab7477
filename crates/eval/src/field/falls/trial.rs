//! One trial: a motion in front of a virtual radar, watched frame by frame.

use glam::{Quat, Vec3};
use radarllm_base::{Clip, Clutter, Material, Motion, MovingSurface, PointFrame, Provenance};
use radarllm_formats::Mounting;
use radarllm_monitor::falls::FallOptions;
use radarllm_radar_sim::{Noise, Scene};
use radarllm_synth::{
    SynthError, Synthesizer, open_motion,
    placement::{PlacementRange, draw_placement},
    synthesizer::posed_builtin,
};
use serde::Serialize;

use super::{
    DescribeTrial, StatedAction,
    plan::{FRAME_PERIOD_S, FallPlan, OpenRadar, Trial},
    score::{LATEST_S, Missed, Score, TrueFall, score, why_missed},
    watch::{Heights, WatchedRoom},
};
use crate::EvalError;

/// Time that is simulated after the end of the motion in any case, s. No suspicion by height can begin later, because the
/// monitor must have seen the person up at most 1.5 s before.
const REST_S: f64 = 4.0;
/// Time that the pose after the motion is repeated from, s: a little less than the request holds it.
const LOOP_S: f64 = 9.0;

/// A trial and its result.
#[derive(Clone, Debug, Serialize)]
pub struct TrialRow {
    /// Motion and conditions.
    #[serde(flatten)]
    pub trial: Trial,
    /// When the person falls, if it is a fall.
    pub truth: Option<TrueFall>,
    /// Simulated time, s.
    pub seconds: f64,
    /// Mean number of points a frame.
    pub points_per_frame: f64,
    /// What the monitor said.
    pub score: Score,
    /// What `describe` states; `None` if it was not asked.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub described: Option<Vec<StatedAction>>,
    /// Why a fall was missed.
    pub missed: Option<Missed>,
    /// Heights, m above the floor, from 2 s before the onset to 3 s after the impact of a missed fall, with their times,
    /// s; `null` where a tracked person has too few points.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub heights: Vec<(f64, Vec<Option<f64>>)>,
}

impl TrialRow {
    /// Time from the impact to the suspicion, s; negative before the impact.
    pub fn delay_s(&self) -> Option<f64> {
        Some(self.score.suspected_s? - self.truth?.impact_s)
    }

    /// Whether `describe` states the fall.
    pub fn is_described(&self) -> bool {
        self.falls_described().any(|is_the_fall| is_the_fall)
    }

    /// How many falls `describe` states without one.
    pub fn falsely_described(&self) -> usize {
        (self.falls_described())
            .filter(|is_the_fall| !is_the_fall)
            .count()
    }

    /// Of every fall that `describe` states, whether it is the one of the trial.
    fn falls_described(&self) -> impl Iterator<Item = bool> {
        self.stated("fall").map(|[start_s, end_s]| {
            let at_s = f64::midpoint(start_s, end_s);
            self.truth.is_some_and(|truth| truth.includes(at_s))
        })
    }

    /// The share of the time after a fall, from 3 s after the impact on, in which `describe` states that the person
    /// lies.
    pub fn lying_share(&self) -> Option<f64> {
        let from_s = self.truth?.impact_s + LATEST_S;
        let within_s = |[start_s, end_s]: [f64; 2]| end_s.min(self.seconds) - start_s.max(from_s);
        let lying_s = (self.stated("lie_still").map(within_s)).fold(0.0, |sum, s| sum + s.max(0.0));
        Some(lying_s / (self.seconds - from_s))
    }

    /// When `describe` states an action, s.
    fn stated(&self, action: &str) -> impl Iterator<Item = [f64; 2]> {
        let stated = self.described.iter().flatten();
        (stated.filter(move |one| one.action == action)).map(|one| [one.start_s, one.end_s])
    }
}

/// Simulates and watches a trial. Frames are simulated until nothing can change any more: [`REST_S`] after the motion, and
/// as long as a suspicion is undecided.
pub(super) fn run(
    plan: &FallPlan,
    trial: &Trial,
    is_fall: bool,
    radar: &OpenRadar,
    synthesizer: &mut Synthesizer,
    describe: Option<&DescribeTrial>,
) -> Result<TrialRow, EvalError> {
    let input = open_motion(&trial.request, trial.seed)?;
    let mut shape = input.shape;
    shape.facet_edge_m = plan.facet_edge_m;
    let mut motion = input.motion;
    let truth = is_fall.then(|| TrueFall::of(&motion));
    let range = PlacementRange {
        distance_m: [trial.distance_m; 2],
        lateral_m: plan.lateral_m,
        heading_rad: 0.0,
        radar_height_m: trial.radar_height_m,
    };
    let placement = draw_placement(&motion, &range, trial.seed);
    let held_s = f64::from(super::plan::AFTER_S);
    let rest_s = motion.duration_s() - held_s + REST_S;
    // Those of `live` that are not changed.
    let options = FallOptions::default();
    let longest_s = rest_s + options.fall_dwell_s + 1.0;
    hold(&mut motion, longest_s);
    let fail = |source: SynthError| EvalError::Simulation {
        what: format!("{}: {}", trial.radar, trial.request),
        source: source.into(),
    };
    let body = posed_builtin(&motion, shape, placement).map_err(fail)?;
    let tilt_rad = trial.tilt_deg.to_radians();
    let body = Tilted::new(&body, tilt_rad);
    let mounting = Mounting {
        tilt_rad: tilt_rad.into(),
        ..Mounting::default()
    };
    let scene = Scene {
        surfaces: vec![&body],
        points: Vec::new(),
        noise: Noise::Thermal,
    };
    let mut watch = WatchedRoom::new(trial.radar_height_m)?;
    let (mut seen, mut n_points): (Vec<Heights>, usize) = (Vec::new(), 0);
    let mut frames: Vec<PointFrame> = Vec::new();
    let n_frames = |seconds: f64| (seconds / FRAME_PERIOD_S).ceil() as usize;
    while seen.len() < n_frames(rest_s)
        || (watch.is_undecided() && seen.len() < n_frames(longest_s))
    {
        let simulated = synthesizer.simulate(&scene, seen.len(), trial.seed);
        simulated.map_err(fail)?;
        let mut frame = synthesizer.extract(seen.len()).map_err(fail)?;
        if let Some(firmware) = &radar.firmware {
            firmware.limit(&mut frame);
        }
        mounting.apply(std::slice::from_mut(&mut frame));
        n_points += frame.points.len();
        seen.push(watch.push(&frame));
        if describe.is_some() {
            frame.frame = frames.len() as u32;
            frame.time_s = f64::from(frame.frame) * FRAME_PERIOD_S;
            frames.push(frame);
        }
    }
    let clip = || Clip {
        frames,
        frame_rate_hz: 1.0 / FRAME_PERIOD_S,
        radar_height_m: trial.radar_height_m,
        is_height_assumed: false,
        radar: trial.radar.clone(),
        provenance: Provenance::simulated(&trial.request, trial.seed),
        clutter: Clutter::Unchecked,
    };
    let described = describe.map(|describe| describe(clip())).transpose()?;
    let score = score(truth, &watch.events);
    let missed_fall = truth.filter(|_| score.suspected_s.is_none());
    let heights = |truth: TrueFall| {
        let range = truth.onset_s - 2.0..=truth.impact_s + LATEST_S;
        let near = seen.iter().filter(|s| range.contains(&s.t_s));
        near.map(|s| (s.t_s, s.people.iter().map(|(_, h)| *h).collect()))
            .collect()
    };
    Ok(TrialRow {
        trial: trial.clone(),
        truth,
        seconds: seen.len() as f64 * FRAME_PERIOD_S,
        points_per_frame: n_points as f64 / seen.len() as f64,
        missed: missed_fall.map(|truth| why_missed(truth, &seen, options.fall_height_m)),
        heights: missed_fall.map(heights).unwrap_or_default(),
        score,
        described,
    })
}

/// A surface as a radar sees it that looks down.
struct Tilted<'a> {
    level: &'a dyn MovingSurface,
    sensor_from_level: Quat,
}

impl<'a> Tilted<'a> {
    /// `tilt_rad` is the angle of the boresight below the horizon.
    fn new(level: &'a dyn MovingSurface, tilt_rad: f32) -> Self {
        Self {
            level,
            sensor_from_level: Quat::from_rotation_x(tilt_rad),
        }
    }
}

impl MovingSurface for Tilted<'_> {
    fn triangles(&self) -> &[[u32; 3]] {
        self.level.triangles()
    }

    fn n_vertices(&self) -> usize {
        self.level.n_vertices()
    }

    fn positions_at(&self, time_s: f64, out: &mut [Vec3]) {
        self.positions_at_times(&[time_s], &mut [out]);
    }

    fn positions_at_times(&self, times_s: &[f64], out: &mut [&mut [Vec3]]) {
        self.level.positions_at_times(times_s, out);
        for position in out.iter_mut().flat_map(|one| one.iter_mut()) {
            *position = self.sensor_from_level * *position;
        }
    }

    fn material(&self) -> Material {
        self.level.material()
    }
}

/// Prolongs a motion: its last seconds, in which somebody only breathes, backwards and forwards in turn.
fn hold(motion: &mut Motion, until_s: f64) {
    let n_loop = ((LOOP_S * motion.fps) as usize).min(motion.poses.len() - 1);
    let n = (until_s * motion.fps).ceil() as usize;
    while motion.poses.len() < n {
        let end = motion.poses.len() - 1;
        let back = motion.poses[end - n_loop..end].to_vec();
        motion.poses.extend(back.into_iter().rev());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct OnePoint(Vec3);

    impl MovingSurface for OnePoint {
        fn triangles(&self) -> &[[u32; 3]] {
            &[]
        }

        fn n_vertices(&self) -> usize {
            1
        }

        fn positions_at(&self, _: f64, out: &mut [Vec3]) {
            out[0] = self.0;
        }

        fn material(&self) -> Material {
            Material::PEC
        }
    }

    /// What a tilted radar sees is where it was when the mounting angles of `live` are applied to it.
    #[test]
    fn a_tilted_radar_looks_down() {
        let level = Vec3::new(0.4, 2.898, -0.776);
        let mut seen = [Vec3::ZERO];
        Tilted::new(&OnePoint(level), 15_f32.to_radians()).positions_at(0.0, &mut seen);
        // CONVENTIONS.md: 3 m along a boresight that is tilted by 15 degrees.
        assert!(
            seen[0].distance(Vec3::new(0.4, 3.0, 0.0)) < 1e-3,
            "{seen:?}"
        );
        let mounting = Mounting {
            tilt_rad: 15_f64.to_radians(),
            ..Mounting::default()
        };
        let back = mounting.level(seen[0].to_array().map(f64::from));
        let back = Vec3::from_array(back.map(|v| v as f32));
        assert!(back.distance(level) < 1e-5, "{back}");
    }

    #[test]
    fn a_held_motion_is_continuous_and_stays_where_it_is() {
        let render = |after_s: f64| {
            let request = format!("fall?direction=left&after_s={after_s}");
            radarllm_motions::parse(&request).unwrap().render(3).motion
        };
        let mut motion = render(10.0);
        let before = motion.clone();
        hold(&mut motion, 40.0);
        assert!(motion.duration_s() >= 39.9);
        assert_eq!(motion.poses[..before.poses.len()], before.poses);
        let n = before.poses.len();
        let last = &before.poses[n - 1];
        for pair in motion.poses[n - 1..].windows(2) {
            let step_m = pair[0].root_in_world.distance(pair[1].root_in_world);
            let away_m = pair[1].root_in_world.distance(last.root_in_world);
            assert!(step_m < 0.002 && away_m < 0.05, "{step_m} {away_m}");
            let turn = pair[0].rotations[3].angle_between(pair[1].rotations[3]);
            assert!(turn < 0.01, "{turn}");
        }
    }
}
