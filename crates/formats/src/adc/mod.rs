//! Raw ADC samples of TI radars: bytes in, one [`radarllm_base::RadarCube`] a frame out.
//!
//! Reading order: [`layout`] (what the words of a capture mean), [`reader`] (frames of a file),
//! [`iq`] (order of I and Q), [`stats`] (signal statistics), [`check`] (whether the file fits the radar), [`studio`] and [`log_csv`] (what mmWave Studio writes beside a
//! capture), [`axes`] (arrays of other tools). Packets of the capture card are in [`crate::dca1000`].
//!
//! Everything streams: memory holds one frame, whatever a file claims. Values of a cube are ADC counts.

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

/// Why raw samples cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum AdcError {
    /// The radar and the layout do not go together.
    #[error("{0}")]
    Layout(String),
    /// The bytes are not what they should be.
    #[error("byte {offset}: expected {expected}, found {found}")]
    Format {
        /// Where, from the start of the input, bytes.
        offset: u64,
        /// What the format asks for.
        expected: String,
        /// What is there.
        found: String,
    },
    /// The input could not be read.
    #[error("byte {offset}: {source}")]
    Read {
        /// Where, bytes.
        offset: u64,
        /// Why.
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
