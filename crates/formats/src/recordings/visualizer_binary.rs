//! Binary recordings of TI's visualizers: a folder of `pHistBytes_N.bin`, which contain consecutive pieces of the UART
//! stream.

use super::pieces::{Pieces, PiecesError, Run, Runs, gaps, left_over, ordered};
use crate::uart::{Dialect, Guess, UartError, UartFrame, UartParser, UartReport};

/// Smallest number of steps of the board's clock from which its rate is taken.
const MIN_STEPS: usize = 8;
/// Share of the steps that have to agree with their median within half of it, for a clock to be believed. Low-power
/// boards stop theirs between frames.
const MIN_REGULAR: f64 = 0.9;
/// Largest difference of frame numbers over which the board's clock is extrapolated, frames. It is never extrapolated
/// further than it was observed, so that the error remains as small as the jitter.
const MAX_EXTRAPOLATED: u32 = 250;
/// Largest step of a clock that is believed, cycles. It counts modulo 2^32; a clock with larger steps would agree with
/// that of another run too often by chance.
const MAX_STEP: u32 = 1 << 28;
/// Deviation from the extrapolated clock from which a frame is of another run, steps. Two recorded streams of the xWR6843
/// and the xWR1642 deviate by 0.003 steps within 99 frames. The clock of another run agrees by chance in one step of 2^32
/// cycles: in one case of 400 at 200 MHz and 20 frames/s.
const MAX_DEVIATION: f64 = 0.5;

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
/// No pieces, two pieces with the same number, pieces of several runs (see [`read_visualizer_binary_run`]), or bytes that
/// no dialect explains.
pub fn read_visualizer_binary<B: AsRef<[u8]>>(
    pieces: Vec<(u64, B)>,
    dialect: Option<Dialect>,
) -> Result<VisualizerBinary, VisualizerBinaryError> {
    read_visualizer_binary_run(pieces, dialect, None)
}

/// [`read_visualizer_binary`] for one of several runs that wrote into the same folder, counted from 1 for the oldest. A
/// new run begins at a piece whose first frame has a smaller number than the last one of the piece before it, or a cycle
/// counter that does not go on from there.
///
/// # Errors
/// As [`read_visualizer_binary`]; also if there is no such run.
pub fn read_visualizer_binary_run<B: AsRef<[u8]>>(
    pieces: Vec<(u64, B)>,
    dialect: Option<Dialect>,
    run: Option<usize>,
) -> Result<VisualizerBinary, VisualizerBinaryError> {
    let pieces = ordered(pieces)?;
    let (dialect, guess) = decide(&pieces, dialect)?;
    let parsed = parse(&pieces, dialect)?;
    let runs = runs(pieces, &parsed.frames);
    let is_one = runs.runs.len() == 1;
    let (pieces, chosen) = runs.choose(run)?;
    let Parsed { frames, report } = match is_one {
        true => parsed,
        false => parse(&pieces, dialect)?,
    };
    let mut notes: Vec<String> = chosen.into_iter().chain(gaps(&pieces, name)).collect();
    let mut frames: Vec<UartFrame> = frames.into_iter().map(|(_, frame)| frame).collect();
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

fn name(number: u64) -> String {
    format!("{PREFIX}{number}.bin")
}

/// The dialect of the pieces, with the evidence for it if it is not given.
fn decide<B: AsRef<[u8]>>(
    pieces: &Pieces<B>,
    dialect: Option<Dialect>,
) -> Result<(Dialect, Option<Guess>), UartError> {
    if let Some(dialect) = dialect {
        return Ok((dialect, None));
    }
    let mut parser = UartParser::new(None);
    for (_, bytes) in pieces {
        parser.push(bytes.as_ref())?;
        if let (Some(dialect), Some(guess)) = (parser.dialect(), parser.guess()) {
            return Ok((dialect, Some(guess.clone())));
        }
    }
    let n_bytes = pieces.iter().map(|(_, bytes)| bytes.as_ref().len()).sum();
    let (_, _, guess) = parser.finish()?;
    let dialect = guess.as_ref().map(|guess| guess.dialect);
    Ok((dialect.ok_or(UartError::NoPacket(n_bytes))?, guess))
}

/// The packets of all pieces.
struct Parsed {
    /// Packets, each with the index of the piece in which it ends.
    frames: Vec<(usize, UartFrame)>,
    report: UartReport,
}

fn parse<B: AsRef<[u8]>>(pieces: &Pieces<B>, dialect: Dialect) -> Result<Parsed, UartError> {
    let mut parser = UartParser::new(Some(dialect));
    let mut frames = Vec::new();
    for (piece, (_, bytes)) in pieces.iter().enumerate() {
        let ended = parser.push(bytes.as_ref())?;
        frames.extend(ended.into_iter().map(|frame| (piece, frame)));
    }
    let (ended, report, _) = parser.finish()?;
    let last = pieces.len().saturating_sub(1);
    frames.extend(ended.into_iter().map(|frame| (last, frame)));
    Ok(Parsed { frames, report })
}

/// Splits sorted pieces where the frame numbers or the board's clock show another run.
fn runs<B>(pieces: Pieces<B>, frames: &[(usize, UartFrame)]) -> Runs<B> {
    let clock = board_clock(frames);
    let whole = || frames.iter().filter(|(_, f)| is_whole(f));
    let mut begins = vec![0];
    let mut evidence = None;
    for ((before, a), (after, b)) in whole().zip(whole().skip(1)) {
        if before == after {
            continue;
        }
        let Some(problem) = break_between(a, b, clock) else {
            continue;
        };
        // A piece between them without a whole packet belongs to the run before it.
        begins.push(*after);
        if let (Some((before, _)), Some((after, _))) = (pieces.get(*before), pieces.get(*after)) {
            evidence.get_or_insert_with(|| {
                format!("{problem} from {} to {}", name(*before), name(*after))
            });
        }
    }
    let mut runs: Vec<Pieces<B>> = Vec::new();
    for (i, piece) in pieces.into_iter().enumerate() {
        match runs.last_mut() {
            Some(run) if !begins.contains(&i) => run.push(piece),
            _ => runs.push(vec![piece]),
        }
    }
    let mut first_index = 0;
    let described = runs.into_iter().map(|run| {
        let indices = first_index..first_index + run.len();
        first_index = indices.end;
        let frames = whole().filter(|(piece, _)| indices.contains(piece));
        let numbers: Vec<u64> = frames.map(|(_, f)| u64::from(f.number)).collect();
        let piece = |piece: Option<&(u64, B)>| piece.map(|(n, _)| name(*n)).unwrap_or_default();
        let described = Run {
            first_piece: piece(run.first()),
            last_piece: piece(run.last()),
            n_frames: numbers.len(),
            frame_numbers: numbers.first().copied().zip(numbers.last().copied()),
            stamps_ms: None,
        };
        (described, run)
    });
    Runs {
        runs: described.collect(),
        evidence,
    }
}

/// Whether a packet tells the time of its frame: it is complete and the first sub-frame.
fn is_whole(frame: &UartFrame) -> bool {
    frame.complete && frame.subframe == 0
}

/// What shows that two packets, the last of one piece and the first of the next, are of different runs.
fn break_between(a: &UartFrame, b: &UartFrame, clock: Option<Clock>) -> Option<String> {
    let Some(n) = b.number.checked_sub(a.number) else {
        return Some(format!(
            "the frame numbers fall back from {} to {}",
            a.number, b.number
        ));
    };
    let (Clock { step, n_steps }, a_cycles, b_cycles) = (clock?, a.cycles?, b.cycles?);
    if n > MAX_EXTRAPOLATED || n as usize > n_steps {
        return None;
    }
    // At most 250 steps of 2^28 cycles; the counter wraps at 2^32.
    let expected = a_cycles.wrapping_add((step * f64::from(n)) as u64 as u32);
    let ahead = b_cycles.wrapping_sub(expected);
    let deviation = ahead.min(ahead.wrapping_neg());
    (f64::from(deviation) > MAX_DEVIATION * step).then(|| {
        format!(
            "the board's clock does not go on from frame {} to frame {}",
            a.number, b.number
        )
    })
}

/// The cycle counter of a board.
#[derive(Clone, Copy)]
struct Clock {
    /// Mean step from one frame to the next, cycles.
    step: f64,
    /// Number of steps from which it was taken.
    n_steps: usize,
}

/// The clock in the packets, if it has a steady one. Times of frames vary by some milliseconds, which cancel in the sum of
/// steps that follow on each other.
fn board_clock(frames: &[(usize, UartFrame)]) -> Option<Clock> {
    let whole: Vec<_> = frames.iter().filter(|(_, f)| is_whole(f)).collect();
    let pairs = whole.iter().zip(whole.iter().skip(1));
    let mut steps: Vec<u32> = pairs
        .filter(|(a, b)| a.0 == b.0 && a.1.number.checked_add(1) == Some(b.1.number))
        .filter_map(|(a, b)| Some(b.1.cycles?.wrapping_sub(a.1.cycles?)))
        .collect();
    steps.sort_unstable();
    let median = *steps.get(steps.len() / 2)?;
    let is_regular = |step: &&u32| step.abs_diff(median) <= median / 2;
    let regular: Vec<f64> = steps
        .iter()
        .filter(is_regular)
        .map(|s| f64::from(*s))
        .collect();
    let is_steady = steps.len() >= MIN_STEPS
        && regular.len() as f64 >= MIN_REGULAR * steps.len() as f64
        && (1..=MAX_STEP).contains(&median);
    is_steady.then(|| Clock {
        step: regular.iter().sum::<f64>() / regular.len() as f64,
        n_steps: regular.len(),
    })
}
