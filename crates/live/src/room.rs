//! A simulated room: a person who does one thing after another before the virtual radar.
//!
//! Every scene is a built-in motion, simulated with physics and noise as `radarllm simulate` does. Between scenes the
//! person stands still, which the radar does not see. Scenes are simulated ahead of time on a thread of their own.

use std::sync::mpsc::{Receiver, sync_channel};
use std::thread;

use radarllm::{Error, Result, SimulateOptions, radar_dsp::DspOptions};
use radarllm_base::{RadarConfig, RadarPoint, seed};
use radarllm_io::open_radar;
use radarllm_synth::simulate_motion;

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
/// Scenes that wait.
const AHEAD: usize = 2;

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
            radar: opened.config,
            radar_name: options.radar.clone(),
            simulation: SimulateOptions {
                processing: DspOptions::default(),
                ..SimulateOptions::default()
            },
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

    /// Points of one frame after the other, without end.
    pub fn frames(self) -> Frames {
        let (sender, scenes) = sync_channel(AHEAD);
        // The thread ends when the receiver is dropped.
        thread::spawn(move || {
            let mut script = Script::new(&self.options);
            loop {
                let scene = self.simulate(&script.next(self.frame_period_s()));
                script.passed_s += scene.len() as f64 * self.frame_period_s();
                if sender.send(scene).is_err() {
                    return;
                }
            }
        });
        Frames {
            scenes,
            scene: Vec::new().into_iter(),
        }
    }

    fn simulate(&self, scene: &Scene) -> Vec<Vec<RadarPoint>> {
        let options = SimulateOptions {
            seed: scene.seed,
            ..self.simulation.clone()
        };
        let input = format!("builtin:{}", scene.motion);
        // The motions are those of the list above, which a test simulates.
        let clip = simulate_motion(&input, &self.radar, &options).map(|s| s.clip.frames);
        let frames = clip.unwrap_or_default().into_iter().map(|f| f.points);
        let pause = std::iter::repeat_n(Vec::new(), scene.n_pause);
        frames.chain(pause).collect()
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
    scenes: Receiver<Vec<Vec<RadarPoint>>>,
    scene: std::vec::IntoIter<Vec<RadarPoint>>,
}

impl Iterator for Frames {
    type Item = Vec<RadarPoint>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Some(points) = self.scene.next() {
                return Some(points);
            }
            self.scene = self.scenes.recv().ok()?.into_iter();
        }
    }
}

#[cfg(test)]
mod tests {
    use radarllm_synth::simulate::open_motion;

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
