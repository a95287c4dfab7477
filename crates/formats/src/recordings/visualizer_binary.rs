//! Recordings of TI's visualizers in binary form: a folder of `pHistBytes_N.bin`, the bytes of the UART in pieces.

use super::pieces::{PiecesError, left_over, ordered};
use crate::uart::{Dialect, Guess, UartError, UartFrame, UartParser, UartReport};

/// Start of the names of the pieces; the number and `.bin` follow.
pub const PREFIX: &str = "pHistBytes_";

/// A recording out of its pieces.
#[derive(Clone, Debug, PartialEq)]
pub struct VisualizerBinary {
    /// Packets, without those left over from the run before; [`crate::uart::recorded_frames`] makes frames of points.
    pub frames: Vec<UartFrame>,
    /// Counts of everything that was parsed, left-over frames included.
    pub report: UartReport,
    /// How the dialect was found, if it was guessed.
    pub guess: Option<Guess>,
    /// What a user should know: missing pieces, dropped frames.
    pub notes: Vec<String>,
}

/// Why a folder is no recording.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum VisualizerBinaryError {
    /// The pieces do not fit together.
    #[error(transparent)]
    Pieces(#[from] PiecesError),
    /// No dialect explains the bytes.
    #[error(transparent)]
    Uart(#[from] UartError),
}

/// Joins pieces (number in the file's name, bytes) in the order of their numbers and parses the packets. A packet may
/// start in one piece and end in the next. Packets that the next one cuts short are counted in the report.
///
/// # Errors
/// No pieces, two with one number, or bytes that no dialect explains.
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
