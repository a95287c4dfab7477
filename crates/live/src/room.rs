//! A simulated room: a person who does one thing after another before the virtual radar.
//!
//! Every scene is a built-in motion, simulated with physics and noise as `radarllm simulate` does. Between scenes the
//! person stands still, which the radar does not see. Frames are simulated one after the other on a thread of their own, a
//! few seconds ahead: the room begins after the first frame, and holds one frame of raw samples and one body.

use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread;

use radarllm::{Error, Result, SimulateOptions, radar_sim};
use radarllm_base::{RadarConfig, RadarPoint, seed};
use radarllm_io::open_radar;
use radarllm_synth::{
    Synthesizer,
    simulate::{open_motion, place},
    synthesizer::posed_builtin,
};

/// What the person does in turn, unless it is time to fall.
const SCENES: [&str; 10] = [
    "pace?repetitions=2",
    "wave?side=left&repetitions=8",
    "squat?repetitions=4",
    "walk+then+sit_down",
    "stand_up+then+walk",
    "clap?repetitions=10",
    "jumping_jack?repetitions=6",
    "walk+then+pick_up",
    "punch?repetitions=8",
    "raise_arms?repetitions=3",
];
const FALL: &str = "pace+then+fall?pace.repetitions=1";
/// Time between two scenes, s.
const PAUSE_S: f64 = 1.5;
/// Time on the floor after a fall, s: longer than the dwell after which a fall is confirmed.
const LYING_S: f64 = 30.0;
/// Frames that wait.
const AHEAD: usize = 50;

/// Options of the simulated room.
#[derive(Clone, Debug, PartialEq)]
pub struct RoomOptions {
    /// Name of a built-in radar, or a file.
    pub radar: String,
    /// Seed of motions and noise.
    pub seed: u64,
    /// Time after which the person falls again, s; `None` for never.
    pub fall_every_s: Option<f64>,
}

impl Default for RoomOptions {
    fn default() -> Self {
        Self {
            radar: radarllm::DEFAULT_RADAR.into(),
            seed: 1,
            fall_every_s: None,
        }
    }
}

/// The simulated room.
pub struct Room {
    radar: RadarConfig,
    radar_name: String,
    simulation: SimulateOptions,
    options: RoomOptions,
}

impl Room {
    /// Opens the radar, and simulates nothing yet.
    ///
    /// # Errors
    /// An unknown radar, and a time between falls that is no positive number.
    pub fn new(options: &RoomOptions) -> Result<Self> {
        if let Some(every_s) = options.fall_every_s
            && !(every_s.is_finite() && every_s > 0.0)
        {
            return Err(Error::input(format!(
                "the time between falls must be positive, found {every_s} s"
            )));
        }
        let opened = open_radar(&options.radar)?;
        Ok(Self {
            radar: opened.into_config()?,
            radar_name: options.radar.clone(),
            simulation: SimulateOptions::default(),
            options: options.clone(),
        })
    }

    /// Time between two frames, s.
    pub fn frame_period_s(&self) -> f64 {
        1.0 / self.radar.frame_rate_hz()
    }

    /// Height of the radar above the floor, m.
    pub fn radar_height_m(&self) -> f64 {
        self.simulation.radar_height_m.into()
    }

    /// Name of the radar.
    pub fn radar(&self) -> &str {
        &self.radar_name
    }

    /// Points of one frame after the other, without end, or until the radar cannot be simulated.
    pub fn frames(self) -> Frames {
        let (sender, points) = sync_channel(AHEAD);
        // The thread ends when the receiver is dropped.
        thread::spawn(move || self.simulate(&sender));
        Frames { points }
    }

    /// Simulates until nobody receives any more.
    fn simulate(&self, sender: &SyncSender<Vec<RadarPoint>>) -> Result {
        let simulation = &self.simulation;
        let processing = simulation.processing.clone().unwrap_or_default();
        let mut synthesizer = Synthesizer::new(&self.radar, simulation.method, processing)?;
        let mut script = Script::new(&self.options);
        loop {
            let scene = script.next(self.frame_period_s());
            let n_frames = match self.simulate_scene(&scene, &mut synthesizer, sender)? {
                Some(n_frames) => n_frames,
                None => return Ok(()),
            };
            script.passed_s += n_frames as f64 * self.frame_period_s();
        }
    }

    /// Simulates a scene with its pause. Returns the number of its frames, or `None` if nobody receives them any more.
    fn simulate_scene(
        &self,
        scene: &Scene,
        synthesizer: &mut Synthesizer,
        sender: &SyncSender<Vec<RadarPoint>>,
    ) -> Result<Option<usize>> {
        let simulation = &self.simulation;
        let input = open_motion(&format!("builtin:{}", scene.motion), scene.seed)?;
        let n_frames = self.radar.frames_in(input.motion.duration_s()).max(1);
        let at = place(
            &input.motion,
            simulation.distance_m,
            simulation.radar_height_m,
        );
        let body = posed_builtin(&input.motion, input.shape, at)?;
        let surfaces = radar_sim::Scene {
            surfaces: vec![&body],
            points: Vec::new(),
            noise: radar_sim::Noise::Thermal,
        };
        for n in 0..n_frames + scene.n_pause {
            let points = if n < n_frames {
                synthesizer.simulate(&surfaces, n, scene.seed)?;
                synthesizer.extract(n)?.points
            } else {
                Vec::new()
            };
            if sender.send(points).is_err() {
                return Ok(None);
            }
        }
        Ok(Some(n_frames + scene.n_pause))
    }
}

struct Scene {
    motion: &'static str,
    seed: u64,
    n_pause: usize,
}

/// Which scene is next.
struct Script {
    options: RoomOptions,
    n_scenes: u64,
    passed_s: f64,
    /// When the person falls next.
    fall_at_s: Option<f64>,
}

impl Script {
    fn new(options: &RoomOptions) -> Self {
        Self {
            options: options.clone(),
            n_scenes: 0,
            passed_s: 0.0,
            fall_at_s: options.fall_every_s,
        }
    }

    fn next(&mut self, period_s: f64) -> Scene {
        let index = self.n_scenes;
        self.n_scenes += 1;
        let falls = self.fall_at_s.is_some_and(|at_s| self.passed_s >= at_s);
        let (motion, pause_s) = match falls {
            true => {
                let every_s = self.options.fall_every_s;
                self.fall_at_s = every_s.map(|every_s| self.passed_s + LYING_S + every_s);
                (FALL, LYING_S)
            }
            false => (SCENES[(index % SCENES.len() as u64) as usize], PAUSE_S),
        };
        Scene {
            motion,
            seed: seed::derive_seed(self.options.seed, &format!("room/{index}")),
            n_pause: (pause_s / period_s).round() as usize,
        }
    }
}

/// Points of the frames of a room.
pub struct Frames {
    points: Receiver<Vec<RadarPoint>>,
}

impl Iterator for Frames {
    type Item = Vec<RadarPoint>;

    fn next(&mut self) -> Option<Self::Item> {
        self.points.recv().ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_scenes_are_motions() {
        for scene in SCENES.iter().chain([&FALL]) {
            let motion = open_motion(&format!("builtin:{scene}"), 1).unwrap().motion;
            // Long enough for a sentence.
            let seconds = motion.poses.len() as f64 / motion.fps;
            assert!((4.5..20.0).contains(&seconds), "{scene}: {seconds} s");
        }
    }

    #[test]
    fn the_room_begins_with_the_first_scene_and_goes_on() {
        let room = Room::new(&RoomOptions::default()).unwrap();
        assert_eq!(room.frame_period_s(), 0.1);
        let frames: Vec<Vec<RadarPoint>> = room.frames().take(60).collect();
        let n_points: usize = frames.iter().map(Vec::len).sum();
        assert!(n_points > 600, "{n_points}");
        // They are those of `radarllm simulate`.
        let options = SimulateOptions {
            seed: seed::derive_seed(1, "room/0"),
            ..SimulateOptions::default()
        };
        let radar = open_radar(radarllm::DEFAULT_RADAR)
            .unwrap()
            .into_config()
            .unwrap();
        let input = format!("builtin:{}", SCENES[0]);
        let clip = radarllm_synth::simulate_motion(&input, &radar, &options)
            .unwrap()
            .clip;
        let expected = clip.frames.into_iter().map(|f| f.points);
        assert!(frames.into_iter().eq(expected.take(60)));
    }

    #[test]
    fn falls_come_when_they_are_due() {
        let options = RoomOptions {
            fall_every_s: Some(20.0),
            ..RoomOptions::default()
        };
        let mut script = Script::new(&options);
        let mut scenes = Vec::new();
        for _ in 0..12 {
            let scene = script.next(0.1);
            script.passed_s += if scene.motion == FALL { 35.0 } else { 8.0 };
            scenes.push((scene.motion == FALL, scene.n_pause));
        }
        let falls: Vec<usize> = (0..12).filter(|i| scenes[*i].0).collect();
        assert_eq!(falls, [3, 6, 9]);
        assert!(
            scenes
                .iter()
                .all(|(falls, n)| *n == if *falls { 300 } else { 15 })
        );
        let bad = RoomOptions {
            fall_every_s: Some(0.0),
            ..options
        };
        assert!(Room::new(&bad).is_err());
    }
}
