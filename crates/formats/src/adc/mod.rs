//! Raw ADC samples of TI radars: decodes bytes into one [`radarllm_base::RadarCube`] per frame.
//!
//! Reading order: [`layout`] (meaning of the words of a capture), [`reader`] (frames of a file), [`iq`] (order of I and
//! Q), [`stats`] (signal statistics), [`check`] (whether the file fits the radar), [`studio`] and [`log_csv`] (files
//! that mmWave Studio writes beside a capture), [`axes`] (arrays of other tools). Packets of the capture card are in
//! [`crate::dca1000`].
//!
//! All input is streamed: memory holds one frame, regardless of the size that a file declares. Values of a cube are ADC
//! counts.

pub mod axes;
pub mod check;
pub mod iq;
pub mod layout;
pub mod log_csv;
pub mod reader;
pub mod stats;
pub mod studio;

pub use axes::{AxisOrder, FrameLayout};
pub use check::check_capture;
pub use iq::{IqAnswer, IqCheck, IqVerdict};
pub use layout::{CubeShape, FrameDecoder, IqOrder, LvdsLanes, SampleKind, SampleLayout};
pub use log_csv::RecordLog;
pub use reader::{AdcReader, Chained, FrameIntegrity, FrameSource};
pub use stats::{AdcStats, ChannelStats, HISTOGRAM_BINS};
pub use studio::{StudioCapture, StudioError, StudioSetup};

/// Reasons why raw samples cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AdcError {
    /// The radar and the layout are incompatible.
    #[error("{0}")]
    Layout(String),
    /// The bytes violate the format.
    #[error("byte {offset}: expected {expected}, found {found}")]
    Format {
        /// Byte offset from the start of the input.
        offset: u64,
        /// What the format requires.
        expected: String,
        /// What was found.
        found: String,
    },
    /// The input could not be read.
    #[error("byte {offset}: {source}")]
    Read {
        /// Byte offset.
        offset: u64,
        /// Cause.
        source: std::io::Error,
    },
}

impl AdcError {
    pub(crate) fn format(
        offset: u64,
        expected: impl Into<String>,
        found: impl Into<String>,
    ) -> Self {
        Self::Format {
            offset,
            expected: expected.into(),
            found: found.into(),
        }
    }
}
