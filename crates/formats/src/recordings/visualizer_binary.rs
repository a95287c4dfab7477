//! Binary recordings of TI's visualizers: a folder of `pHistBytes_N.bin`, which contain consecutive pieces of the UART
//! stream.

use super::pieces::{PiecesError, left_over, ordered};
use crate::uart::{Dialect, Guess, UartError, UartFrame, UartParser, UartReport};

/// Prefix of the file names, which is followed by the number and `.bin`.
pub const PREFIX: &str = "pHistBytes_";

/// A recording, joined from its pieces.
#[derive(Clone, Debug, PartialEq)]
pub struct VisualizerBinary {
    /// Packets, without those left over from the previous run. [`crate::uart::recorded_frames`] converts them to frames
    /// of points.
    pub frames: Vec<UartFrame>,
    /// Counts of all parsed data, including left-over frames.
    pub report: UartReport,
    /// Evidence for the dialect, if it was detected rather than given.
    pub guess: Option<Guess>,
    /// Notes for the user: missing pieces, dropped frames.
    pub notes: Vec<String>,
}

/// Reason why a folder is not a recording.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum VisualizerBinaryError {
    /// The pieces cannot be joined.
    #[error(transparent)]
    Pieces(#[from] PiecesError),
    /// No dialect explains the bytes.
    #[error(transparent)]
    Uart(#[from] UartError),
}

/// Joins pieces (number in the file name, bytes) in the order of their numbers and parses the packets. A packet may
/// start in one piece and end in the next. Packets truncated by the next packet are counted in the report.
///
/// # Errors
/// No pieces, two pieces with the same number, or bytes that no dialect explains.
pub fn read_visualizer_binary<B: AsRef<[u8]>>(
    pieces: Vec<(u64, B)>,
    dialect: Option<Dialect>,
) -> Result<VisualizerBinary, VisualizerBinaryError> {
    let (pieces, gaps) = ordered(pieces, |n| format!("{PREFIX}{n}.bin"))?;
    let mut notes: Vec<String> = gaps.into_iter().collect();
    let mut parser = UartParser::new(dialect);
    let mut frames = Vec::new();
    for (_, bytes) in &pieces {
        frames.extend(parser.push(bytes.as_ref())?);
    }
    let (last, report, guess) = parser.finish()?;
    frames.extend(last);
    if let Some((n, note)) = left_over(frames.iter().map(|f| u64::from(f.number))) {
        frames.drain(..n);
        notes.push(note);
    }
    Ok(VisualizerBinary {
        frames,
        report,
        guess,
        notes,
    })
}
