//! Points of one frame at a time into level axes, by the function that places the points of a recording.

use std::{collections::VecDeque, path::Path};

use radarllm_base::{PointFrame, Timeline};
use radarllm_formats::Mounting;
use radarllm_tracking::PointBackground;

use crate::{
    cleaning::about_background,
    error::Result,
    options::PointOptions,
    points::{Placement, place_with},
};

/// Removes slow points, accumulates frames, applies the mounting and removes the points of the empty scene.
pub struct Placing {
    placement: Placement,
    frame_rate_hz: f64,
    background: Option<PointBackground>,
    /// The last frames as they came, as many as are accumulated.
    recent: VecDeque<PointFrame>,
    /// Points that were placed, and those of the empty scene that were removed from them.
    n_points: usize,
    n_removed: usize,
}

impl Placing {
    pub(crate) fn new(
        options: &PointOptions,
        mounting: Mounting,
        frame_rate_hz: f64,
        background: Option<PointBackground>,
    ) -> Result<Self> {
        Ok(Self {
            placement: Placement::new(options, mounting)?,
            frame_rate_hz,
            background,
            recent: VecDeque::new(),
            n_points: 0,
            n_removed: 0,
        })
    }

    /// What the removal of an empty scene, recorded in `path`, did up to now; `None` if none is removed.
    pub(crate) fn about_background(&self, path: &Path) -> Option<String> {
        let background = self.background.as_ref()?;
        let (n_removed, n_points) = (self.n_removed, self.n_points);
        Some(about_background(background, path, n_removed, n_points))
    }

    /// Places the next frame.
    pub fn apply(&mut self, frame: PointFrame) -> PointFrame {
        let mut placed = match self.placement.n_accumulated {
            0 | 1 => self.placement.of_frame(frame),
            _ => self.accumulated(frame),
        };
        self.n_points += placed.points.len();
        if let Some(background) = &self.background {
            self.n_removed += background.remove(std::slice::from_mut(&mut placed));
        }
        placed
    }

    /// The next frame with the points of those before it.
    fn accumulated(&mut self, frame: PointFrame) -> PointFrame {
        let (number, time_s) = (frame.frame, frame.time_s);
        if self.recent.len() >= self.placement.n_accumulated {
            self.recent.pop_front();
        }
        self.recent.push_back(frame);
        // No frame before these is within the window of the newest one.
        let frames = self.recent.iter().cloned().collect();
        let timeline = Timeline::from_frames(frames, self.frame_rate_hz);
        let placed = place_with(timeline, &self.placement).frames.pop();
        placed.unwrap_or(PointFrame {
            frame: number,
            time_s,
            points: Vec::new(),
            board: None,
        })
    }
}
