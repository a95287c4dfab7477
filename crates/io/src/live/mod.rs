//! Radars while they run: frames of points as they arrive, from a TI demo on serial ports or from a capture card.
//!
//! A [`LiveSource`] gives the frames that [`read_recording`](crate::read_recording) gives for the same bytes, one at a
//! time, and says when the radar is lost and when it is back. It never waits longer than the caller allows, uses bounded
//! memory and counts what it drops.
//!
//! Frame numbers are those of the radar, counted from the first frame received, as in a recording. Lost frames leave
//! gaps. Numbers never fall back: after an interruption they go on by the time that has passed.
//!
//! ```no_run
//! use std::time::Duration;
//!
//! use radarllm_io::{
//!     CaptureOptions,
//!     live::{LiveEvent, LiveSource, TiBoard, TiBoardOptions},
//!     open_radar,
//! };
//!
//! let mut board = TiBoard::open(TiBoardOptions {
//!     data: "/dev/ttyACM1".into(),
//!     cli: Some("/dev/ttyACM0".into()),
//!     capture: CaptureOptions {
//!         radar: Some(open_radar("profile.cfg")?),
//!         ..CaptureOptions::default()
//!     },
//!     ..TiBoardOptions::default()
//! })?;
//! while let Some(event) = board.next(Duration::from_secs(10))? {
//!     match event {
//!         LiveEvent::Frame(frame) => println!("{:.1} s: {} points", frame.time_s, frame.points.len()),
//!         LiveEvent::Lost { reason } => println!("lost: {reason}"),
//!         LiveEvent::Back => println!("back"),
//!         LiveEvent::End => break,
//!     }
//! }
//! # Ok::<(), radarllm_io::Error>(())
//! ```
//!
//! Reading order: this module, `numbers` (frame numbers that only grow), `output` (events),
//! [`ti_board`] with `cli` (its command line), [`dca1000`] with `card` (its commands).

mod card;
mod cli;
pub mod dca1000;
mod numbers;
mod output;

pub mod ti_board;

use std::time::{Duration, Instant};

use radarllm_base::{PointFrame, SourceInfo};

pub use dca1000::{Dca1000, DcaOptions};
pub use ti_board::{TiBoard, TiBoardOptions};

use crate::error::Result;

/// What happened at a source.
#[derive(Clone, Debug, PartialEq)]
pub enum LiveEvent {
    /// A frame arrived. Points are in level axes, strongest first; the time is the number times the frame period.
    Frame(PointFrame),
    /// No more frames arrive until [`LiveEvent::Back`].
    Lost {
        /// The cause, for the user.
        reason: String,
    },
    /// Frames arrive again; the next event is one.
    Back,
    /// The source has ended. Radars never end.
    End,
}

/// A running radar.
pub trait LiveSource: Send {
    /// Waits at most `timeout` for the next event. `Ok(None)` if nothing happened.
    ///
    /// # Errors
    /// What waiting cannot repair. Nothing that a radar sends or does not send is such an error.
    fn next(&mut self, timeout: Duration) -> Result<Option<LiveEvent>>;

    /// What is constant for all frames.
    fn about(&self) -> SourceInfo;

    /// What was received and dropped up to now.
    fn counts(&self) -> LiveCounts;

    /// Why what arrives at present tells nothing about the scene, for the user: a dialect that is not clear, points in
    /// blocks of data that are not known. It may end with later data.
    fn problem(&self) -> Option<String> {
        None
    }

    /// Notes for the user: mounting angles, layout, a buffer of the system that is too small.
    fn notes(&self) -> &[String] {
        &[]
    }
}

/// Counts of a source since it was opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LiveCounts {
    /// Frames received.
    pub frames: u64,
    /// Frames missing between the radar's numbers.
    pub lost_frames: u64,
    /// Searches for the next packet after damage, and frames with a number that fits no other.
    pub resynchronisations: u64,
    /// How often the radar came back after it was lost.
    pub reconnects: u64,
    /// Datagrams of other senders, or that are no packets.
    pub foreign_datagrams: u64,
    /// Lines of the chirp file that the board refused after an interruption, or commands that the card refused.
    pub refused_lines: u64,
}

/// After how long a source acts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LiveTimeouts {
    /// Maximum time for the board's answer to a line of the chirp file.
    pub answer: Duration,
    /// Silence of an open port after which the chirp file is sent again.
    pub send_again: Duration,
    /// Silence after which the radar is lost.
    pub lost: Duration,
    /// Time before a lost port is opened again. It doubles with every failure.
    pub reopen_first: Duration,
    /// Maximum of that time.
    pub reopen_max: Duration,
}

impl Default for LiveTimeouts {
    fn default() -> Self {
        Self {
            answer: Duration::from_secs(1),
            send_again: Duration::from_secs(3),
            lost: Duration::from_secs(5),
            reopen_first: Duration::from_millis(500),
            reopen_max: Duration::from_secs(8),
        }
    }
}

/// The end of a wait. A timeout that no clock can hold ends after a day; the caller waits again.
fn deadline(timeout: Duration) -> Instant {
    let now = Instant::now();
    now.checked_add(timeout)
        .unwrap_or(now + Duration::from_secs(86_400))
}
