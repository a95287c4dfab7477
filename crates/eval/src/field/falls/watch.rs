//! Frames through the watch of a running radar, without a model.

use radarllm_base::PointFrame;
use radarllm_monitor::falls::FallEvent;
use radarllm_monitor::watch::{Watch, WatchOptions};

use super::plan::FRAME_PERIOD_S;
use crate::EvalError;

/// Heights of the tracked people in a frame.
#[derive(Clone, Debug)]
pub(super) struct Heights {
    /// Time of the frame, s.
    pub t_s: f64,
    /// Everybody who is tracked: number and height above the floor, m, if there are enough points.
    pub people: Vec<(u32, Option<f64>)>,
}

/// A watched room, with what happened in it.
pub(super) struct WatchedRoom {
    watch: Watch,
    n_frames: u32,
    /// Events so far.
    pub events: Vec<FallEvent>,
}

impl WatchedRoom {
    /// A room without zones, watched with the default options of `live`.
    pub(super) fn new(radar_height_m: f32) -> Result<Self, EvalError> {
        let options = WatchOptions::default();
        let config = |e: radarllm_monitor::options::OptionError| EvalError::Config(e.to_string());
        Ok(Self {
            watch: Watch::new(&options, radar_height_m.into()).map_err(config)?,
            n_frames: 0,
            events: Vec::new(),
        })
    }

    /// The points of the next frame.
    pub(super) fn push(&mut self, frame: &PointFrame) -> Heights {
        let t_s = f64::from(self.n_frames) * FRAME_PERIOD_S;
        let seen = self.watch.push(&PointFrame {
            frame: self.n_frames,
            time_s: t_s,
            points: frame.points.clone(),
            board: None,
        });
        self.n_frames += 1;
        self.events.extend(seen.falls);
        let height = |id: u32| (id, self.watch.height_m(id));
        Heights {
            t_s,
            people: seen.people.iter().map(|one| height(one.person)).collect(),
        }
    }

    /// Whether a fall is suspected, but neither confirmed nor ended.
    pub(super) fn is_undecided(&self) -> bool {
        self.watch
            .open_falls()
            .iter()
            .any(|fall| !fall.is_confirmed)
    }
}
