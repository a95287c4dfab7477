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
pub(super) struct Placing {
    placement: Placement,
    frame_rate_hz: f64,
    background: Option<PointBackground>,
    /// The last frames as they came, as many as are accumulated.
    recent: VecDeque<PointFrame>,
}

impl Placing {
    pub(super) fn new(
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

    /// Places the next frame.
    pub(super) fn apply(&mut self, frame: PointFrame) -> PointFrame {
        let (number, time_s) = (frame.frame, frame.time_s);
        if self.recent.len() >= self.placement.n_accumulated {
            self.recent.pop_front();
        }
        self.recent.push_back(frame);
        // No frame before these is within the window of the newest one.
        let frames = self.recent.iter().cloned().collect();
        let timeline = Timeline::from_frames(frames, self.frame_rate_hz);
        let mut placed = place_with(timeline, &self.placement)
            .frames
            .pop()
            .unwrap_or(PointFrame {
                frame: number,
                time_s,
                points: Vec::new(),
                board: None,
            });
        if let Some(background) = &self.background {
            background.remove(std::slice::from_mut(&mut placed));
        }
        placed
    }
}
