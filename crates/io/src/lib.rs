//! Opens recordings of any radar, radar descriptions, serial ports and sockets.
//!
//! The input is a path. The output is a [`Clip`](radarllm_base::Clip) of points, a cube of raw samples or a radar, or
//! an [`Error`] with kind, message, hint, path and source. This is the only crate with sockets and serial ports, and the only
//! one that opens recordings. The parsers of their bytes are in `radarllm-formats`. This crate prints nothing, parses
//! no command line and has no global state.
//!
//! ```no_run
//! use radarllm_io::{CaptureOptions, open_radar, read_recording};
//!
//! let options = CaptureOptions {
//!     radar: Some(open_radar("profile.cfg")?),
//!     ..CaptureOptions::default()
//! };
//! let recording = read_recording(&["uart.dat".into()], &options)?;
//! println!(
//!     "{} frames at {:.1} Hz from radar {}",
//!     recording.clip.frames.len(),
//!     recording.clip.frame_rate_hz,
//!     recording.clip.radar
//! );
//! # Ok::<(), radarllm_io::Error>(())
//! ```
//!
//! Reading order: [`recording`] (any recording to points), [`opened`] (what a capture is), [`options`], [`radar`] (radar descriptions), [`points`]
//! (formats of points), [`stream`] (points frame by frame), `placing` (mounting), `visualizer` (folders of TI's visualizers), `ros2` (ROS 2 bags, feature `ros2`), [`samples`] and [`layout`] (raw samples),
//! `npy_cubes`, [`cleaning`] (background and leakage), [`firmware`] (the signal chain of a board's own firmware),
//! [`serial`], [`udp`], [`http`] (a client), [`mod@live`] (radars while they run), [`error`].

#![cfg_attr(test, allow(unreachable_pub, reason = "tests"))]
#![allow(
    clippy::disallowed_methods,
    reason = "this crate opens recordings, radars, ports and sockets for the others"
)]

pub mod cleaning;
mod compressed;
pub mod error;
pub mod firmware;
pub mod http;
pub mod layout;
pub mod live;
mod npy_cubes;
pub mod opened;
pub mod options;
pub mod placing;
pub mod points;
pub mod radar;
pub mod recording;
mod ros2;
pub mod samples;
pub mod serial;
pub mod stream;
pub mod udp;
mod visualizer;

pub use error::{Error, ErrorKind, Result};
pub use firmware::TiFirmware;
pub use npy_cubes::{ArrayDecoder, NpyFrames};
pub use opened::{Opened, RecordingKind};
pub use options::{
    CaptureFormat, CaptureOptions, CellOptions, CleaningOptions, IqChoice, LayoutOptions,
    PointOptions,
};
pub use radar::{
    LayoutHints, OpenedRadar, RadarSource, open_radar, open_radar_in, open_radar_text,
    read_radar_text,
};
pub use radarllm_formats::{DetectError, SampleFormat};
pub use recording::{ExtractedPoints, Recording, SampleRecording, read_opened, read_recording};
pub use samples::{SampleFiles, SampleFrames};
pub use stream::{PointStream, PointsFileStream, StreamEnd, UartStream};
