//! Recordings in numbered pieces: their order, missing pieces, the runs of the visualizer that they are of, and frames
//! left over from the previous run.
//!
//! TI's visualizers number the pieces of every run from 1. A shorter run that writes into the folder of a longer one
//! overwrites its first pieces and leaves the others, whose clock is then earlier.

use std::fmt;

use radarllm_base::civil::utc_text;

/// If the frame number decreases within this many frames at the start of a recording, the frames before the decrease
/// are left over from the previous run. The buffer of a serial port holds a few of them, and a visualizer that is
/// started late reads them first.
const MAX_LEFT_OVER: usize = 20;

/// Reason why pieces cannot be joined to one recording.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum PiecesError {
    /// There are no pieces.
    #[error("no pieces of a recording")]
    Empty,
    /// Two files have the same number.
    #[error("two files have the number {0}: which of them belongs to the recording is not known")]
    SameNumber(u64),
    /// Two pieces belong to different recordings.
    #[error(
        "these are several recordings: {what} of {first} and of {second} differ; name one file, or a folder with the \
         files of one recording"
    )]
    SeveralRecordings {
        /// The key that differs.
        what: &'static str,
        /// File name of the first piece.
        first: String,
        /// File name of the second piece.
        second: String,
    },
    /// The pieces are of several runs of the visualizer, and none was chosen.
    #[error("the pieces are of {} runs ({evidence}): {}", .runs.len(), list(.runs))]
    SeveralRuns {
        /// What shows it, with the names of two pieces.
        evidence: String,
        /// The runs, the oldest first.
        runs: Vec<Run>,
    },
    /// The chosen run does not exist.
    #[error("no run {wanted}: the pieces are of {} ({})", n_runs(.runs), list(.runs))]
    NoSuchRun {
        /// The chosen run, from 1.
        wanted: usize,
        /// The runs, the oldest first.
        runs: Vec<Run>,
    },
}

fn list(runs: &[Run]) -> String {
    /// Maximum number of runs that are listed individually.
    const MAX_LISTED: usize = 10;
    let listed = runs.iter().take(MAX_LISTED).enumerate();
    let mut lines: Vec<String> = listed
        .map(|(i, run)| format!("run {}: {run}", i + 1))
        .collect();
    if runs.len() > MAX_LISTED {
        lines.push(format!("and {} more", runs.len() - MAX_LISTED));
    }
    lines.join("; ")
}

fn n_runs(runs: &[Run]) -> String {
    match runs.len() {
        1 => "one run".into(),
        n => format!("{n} runs"),
    }
}

/// What is known of one run of a visualizer whose pieces lie in a folder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Run {
    /// File name of the first piece.
    pub first_piece: String,
    /// File name of the last piece.
    pub last_piece: String,
    /// Number of frames in the pieces.
    pub n_frames: usize,
    /// Numbers of the first and of the last frame; `None` without frames.
    pub frame_numbers: Option<(u64, u64)>,
    /// Time stamps of the first and of the last frame that have one, ms since 1970.
    pub stamps_ms: Option<(i64, i64)>,
}

impl fmt::Display for Run {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.first_piece)?;
        if self.last_piece != self.first_piece {
            write!(f, " to {}", self.last_piece)?;
        }
        write!(f, ", {} frames", self.n_frames)?;
        if let Some((first, last)) = self.frame_numbers {
            write!(f, " numbered {first} to {last}")?;
        }
        if let Some((first_ms, last_ms)) = self.stamps_ms {
            write!(f, ", {} to {}", utc_text(first_ms), utc_text(last_ms))?;
        }
        Ok(())
    }
}

/// Pieces of several runs, split where one run ends and another begins.
pub(super) struct Runs<T> {
    /// The runs in the order of their pieces, each with its description.
    pub runs: Vec<(Run, Pieces<T>)>,
    /// What shows that there are several.
    pub evidence: Option<String>,
}

impl<T> Runs<T> {
    /// The pieces of the run `wanted`, counted from 1 for the oldest, with a note where there are others; the only run if
    /// none is chosen. Runs without a clock are older the higher their pieces are numbered, because a later run
    /// overwrites the first pieces of an earlier one.
    pub(super) fn choose(
        mut self,
        wanted: Option<usize>,
    ) -> Result<(Pieces<T>, Option<String>), PiecesError> {
        self.runs.reverse();
        if self.runs.iter().all(|(run, _)| run.stamps_ms.is_some()) {
            self.runs.sort_by_key(|(run, _)| run.stamps_ms);
        }
        let n = self.runs.len();
        let described =
            |runs: Vec<(Run, Pieces<T>)>| runs.into_iter().map(|(run, _)| run).collect();
        let chosen = match (wanted, n) {
            (_, 0) => return Err(PiecesError::Empty),
            (None, 1) => 0,
            (None, _) => {
                return Err(PiecesError::SeveralRuns {
                    evidence: self.evidence.unwrap_or_default(),
                    runs: described(self.runs),
                });
            }
            (Some(wanted), _) if !(1..=n).contains(&wanted) => {
                return Err(PiecesError::NoSuchRun {
                    wanted,
                    runs: described(self.runs),
                });
            }
            (Some(wanted), _) => wanted - 1,
        };
        let (run, pieces) = self.runs.swap_remove(chosen);
        let note = (n > 1).then(|| format!("run {} of {n}: {run}", chosen + 1));
        Ok((pieces, note))
    }
}

/// Pieces with the numbers in their file names.
pub(super) type Pieces<T> = Vec<(u64, T)>;

/// Sorts pieces by number.
pub(super) fn ordered<T>(mut pieces: Pieces<T>) -> Result<Pieces<T>, PiecesError> {
    pieces.sort_by_key(|(number, _)| *number);
    if pieces.is_empty() {
        return Err(PiecesError::Empty);
    }
    match pieces.windows(2).find(|pair| pair[0].0 == pair[1].0) {
        Some(pair) => Err(PiecesError::SameNumber(pair[0].0)),
        None => Ok(pieces),
    }
}

/// A note on the numbers that are missing between sorted pieces.
pub(super) fn gaps<T>(pieces: &Pieces<T>, name: impl Fn(u64) -> String) -> Option<String> {
    let mut gaps = Vec::new();
    for pair in pieces.windows(2) {
        let (before, after) = (pair[0].0, pair[1].0);
        match after - before {
            0 | 1 => {}
            2 => gaps.push(name(before + 1)),
            _ => gaps.push(format!("{} to {}", name(before + 1), name(after - 1))),
        }
    }
    /// Maximum number of gaps that are listed individually.
    const MAX_LISTED: usize = 10;
    let n_more = gaps.len().saturating_sub(MAX_LISTED);
    gaps.truncate(MAX_LISTED);
    (!gaps.is_empty()).then(|| {
        let more = match n_more {
            0 => String::new(),
            n => format!(" and {n} more gaps"),
        };
        format!("missing pieces of the recording: {}{more}", gaps.join(", "))
    })
}

/// Number of frames at the start that belong to the previous run, with a note for the user. These are the frames before
/// the last decrease of the frame number among the first [`MAX_LEFT_OVER`].
pub(super) fn left_over(numbers: impl Iterator<Item = u64>) -> Option<(usize, String)> {
    let first: Vec<u64> = numbers.take(MAX_LEFT_OVER + 1).collect();
    let last_old = first.windows(2).rposition(|w| w[1] < w[0])?;
    let note = format!(
        "{} frames at the start (numbers {} to {}) are left over from the run before and dropped: the recording starts \
         at frame {}",
        last_old + 1,
        first[0],
        first[last_old],
        first[last_old + 1]
    );
    Some((last_old + 1, note))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn name(n: u64) -> String {
        format!("p_{n}.bin")
    }

    #[test]
    fn pieces_follow_by_number_and_gaps_are_named() {
        let note = |pieces: Pieces<()>| gaps(&ordered(pieces).unwrap(), name);
        let pieces = ordered(vec![(10, 'c'), (2, 'b'), (1, 'a')]).unwrap();
        assert_eq!(pieces, [(1, 'a'), (2, 'b'), (10, 'c')]);
        assert_eq!(
            gaps(&pieces, name).unwrap(),
            "missing pieces of the recording: p_3.bin to p_9.bin"
        );
        assert_eq!(
            note(vec![(4, ()), (6, ()), (7, ())]).unwrap(),
            "missing pieces of the recording: p_5.bin"
        );
        assert_eq!(note(vec![(7, ())]), None);
        let note_of_many = note((0..50).map(|n| (2 * n, ())).collect()).unwrap();
        assert!(
            note_of_many.ends_with("p_19.bin and 39 more gaps"),
            "{note_of_many}"
        );
        assert_eq!(
            ordered(vec![(3, ()), (3, ())]).unwrap_err(),
            PiecesError::SameNumber(3)
        );
        assert_eq!(
            ordered(Vec::<(u64, ())>::new()).unwrap_err(),
            PiecesError::Empty
        );
        let note = note(vec![(0, ()), (u64::MAX, ())]).unwrap();
        assert!(note.contains("p_1.bin to p_"));
    }

    fn run(piece: u64, stamps_ms: Option<(i64, i64)>) -> (Run, Pieces<u64>) {
        let described = Run {
            first_piece: name(piece),
            last_piece: name(piece),
            n_frames: 3,
            frame_numbers: Some((piece, piece + 2)),
            stamps_ms,
        };
        (described, vec![(piece, piece)])
    }

    #[test]
    fn runs_count_from_the_oldest_and_several_need_a_choice() {
        let with_clock = || Runs {
            runs: vec![
                run(1, Some((90_000, 91_000))),
                run(2, Some((5_000, 6_000))),
                run(3, Some((1_000, 2_000))),
            ],
            evidence: Some("the clock falls back".into()),
        };
        for (wanted, piece) in [(1, 3), (2, 2), (3, 1)] {
            let (pieces, note) = with_clock().choose(Some(wanted)).unwrap();
            assert_eq!(pieces, [(piece, piece)]);
            let begin = format!("run {wanted} of 3: p_{piece}.bin, 3 frames");
            assert!(note.unwrap().starts_with(&begin));
        }
        let error = with_clock().choose(None).unwrap_err().to_string();
        assert_eq!(
            error,
            "the pieces are of 3 runs (the clock falls back): \
             run 1: p_3.bin, 3 frames numbered 3 to 5, 1970-01-01T00:00:01.000Z to 1970-01-01T00:00:02.000Z; \
             run 2: p_2.bin, 3 frames numbered 2 to 4, 1970-01-01T00:00:05.000Z to 1970-01-01T00:00:06.000Z; \
             run 3: p_1.bin, 3 frames numbered 1 to 3, 1970-01-01T00:01:30.000Z to 1970-01-01T00:01:31.000Z"
        );
        for wanted in [0, 4, usize::MAX] {
            let error = with_clock().choose(Some(wanted)).unwrap_err();
            assert!(matches!(error, PiecesError::NoSuchRun { .. }), "{error}");
        }
        // Without a clock, the pieces with the highest numbers are what remains of the oldest run.
        let without_clock = Runs {
            runs: vec![run(1, None), run(2, Some((1, 2)))],
            evidence: None,
        };
        assert_eq!(without_clock.choose(Some(1)).unwrap().0, [(2, 2)]);
        let only = || Runs {
            runs: vec![run(1, None)],
            evidence: None,
        };
        assert_eq!(only().choose(None).unwrap(), (vec![(1, 1)], None));
        assert_eq!(only().choose(Some(1)).unwrap(), (vec![(1, 1)], None));
        let error = only().choose(Some(2)).unwrap_err().to_string();
        assert!(error.starts_with("no run 2: the pieces are of one run (run 1: p_1.bin"));
        let many = Runs {
            runs: (1..=30).map(|n| run(n, None)).collect(),
            evidence: None,
        };
        let error = many.choose(None).unwrap_err().to_string();
        assert!(
            error.ends_with("; and 20 more") && error.len() < 1000,
            "{error}"
        );
    }

    #[test]
    fn frames_before_an_early_fall_are_left_over() {
        let count = |numbers: &[u64]| left_over(numbers.iter().copied()).map(|(n, _)| n);
        assert_eq!(count(&[900, 901, 1, 2, 3]), Some(2));
        assert_eq!(count(&[900, 7, 901, 1, 2]), Some(3));
        // Sub-frames repeat a number; a lost frame increases it by more than 1.
        assert_eq!(count(&[1, 1, 2, 9]), None);
        assert_eq!(count(&[]), None);
        assert_eq!(count(&[5]), None);
        // A restart in the middle of the recording does not count.
        let mut late: Vec<u64> = (100..100 + MAX_LEFT_OVER as u64 + 1).collect();
        late.push(1);
        assert_eq!(count(&late), None);
        let (_, note) = left_over([900, 901, 1].into_iter()).unwrap();
        assert!(
            note.contains("numbers 900 to 901") && note.ends_with("at frame 1"),
            "{note}"
        );
    }
}
