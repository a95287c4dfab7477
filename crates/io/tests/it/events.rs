//! Events of a source, each within [`PATIENCE`].

use std::time::{Duration, Instant};

use radarllm_base::PointFrame;
use radarllm_io::live::{LiveEvent, LiveSource};

/// Maximum time that a test waits for anything.
pub const PATIENCE: Duration = Duration::from_secs(20);

/// The next event, or a failed test.
pub fn event(source: &mut dyn LiveSource) -> LiveEvent {
    let end = Instant::now() + PATIENCE;
    while Instant::now() < end {
        if let Some(event) = source.next(Duration::from_millis(100)).unwrap() {
            return event;
        }
    }
    panic!("no event; {:?}", source.counts());
}

pub fn frame(source: &mut dyn LiveSource) -> PointFrame {
    match event(source) {
        LiveEvent::Frame(frame) => frame,
        other => panic!("{other:?} instead of a frame"),
    }
}

pub fn lost(source: &mut dyn LiveSource) -> String {
    match event(source) {
        LiveEvent::Lost { reason } => reason,
        other => panic!("{other:?} instead of a loss"),
    }
}

/// Frames until the source is lost.
pub fn frames_until_lost(source: &mut dyn LiveSource) -> (Vec<PointFrame>, String) {
    let mut frames = Vec::new();
    loop {
        match event(source) {
            LiveEvent::Frame(frame) => frames.push(frame),
            LiveEvent::Lost { reason } => return (frames, reason),
            other => panic!("{other:?}"),
        }
    }
}
