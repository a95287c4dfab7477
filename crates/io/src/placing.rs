//! Points of one frame at a time into level axes, by the function that places the points of a recording.

use std::collections::VecDeque;

use radarllm_base::{PointFrame, Timeline};
use radarllm_formats::Mounting;
use radarllm_tracking::PointBackground;

use crate::{
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
        })
    }

    /// The points of the empty scene that are removed.
    pub(crate) fn background(&self) -> Option<&PointBackground> {
        self.background.as_ref()
    }

    /// Places the next frame. Returns also how many points of the empty scene were removed from it.
    pub fn apply(&mut self, frame: PointFrame) -> (PointFrame, usize) {
        let mut placed = match self.placement.n_accumulated {
            0 | 1 => self.placement.of_frame(frame),
            _ => self.accumulated(frame),
        };
        let n_removed = match &self.background {
            Some(background) => background.remove(std::slice::from_mut(&mut placed)),
            None => 0,
        };
        (placed, n_removed)
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
