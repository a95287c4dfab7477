//! Recordings in numbered pieces: their order, missing pieces, and frames left over from the previous run.

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
}

/// Pieces with the numbers in their file names.
pub(super) type Pieces<T> = Vec<(u64, T)>;

/// Sorts pieces by number; also returns a note on missing numbers between them.
pub(super) fn ordered<T>(
    mut pieces: Pieces<T>,
    name: impl Fn(u64) -> String,
) -> Result<(Pieces<T>, Option<String>), PiecesError> {
    pieces.sort_by_key(|(number, _)| *number);
    if pieces.is_empty() {
        return Err(PiecesError::Empty);
    }
    let mut gaps = Vec::new();
    for pair in pieces.windows(2) {
        let (before, after) = (pair[0].0, pair[1].0);
        match after - before {
            0 => return Err(PiecesError::SameNumber(after)),
            1 => {}
            2 => gaps.push(name(before + 1)),
            _ => gaps.push(format!("{} to {}", name(before + 1), name(after - 1))),
        }
    }
    /// Maximum number of gaps that are listed individually.
    const MAX_LISTED: usize = 10;
    let n_more = gaps.len().saturating_sub(MAX_LISTED);
    gaps.truncate(MAX_LISTED);
    let note = (!gaps.is_empty()).then(|| {
        let more = match n_more {
            0 => String::new(),
            n => format!(" and {n} more gaps"),
        };
        format!("missing pieces of the recording: {}{more}", gaps.join(", "))
    });
    Ok((pieces, note))
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
        let (pieces, note) = ordered(vec![(10, 'c'), (2, 'b'), (1, 'a')], name).unwrap();
        assert_eq!(pieces, [(1, 'a'), (2, 'b'), (10, 'c')]);
        assert_eq!(
            note.unwrap(),
            "missing pieces of the recording: p_3.bin to p_9.bin"
        );
        let (_, note) = ordered(vec![(4, ()), (6, ()), (7, ())], name).unwrap();
        assert_eq!(note.unwrap(), "missing pieces of the recording: p_5.bin");
        assert_eq!(ordered(vec![(7, ())], name).unwrap().1, None);
        let many: Vec<_> = (0..50).map(|n| (2 * n, ())).collect();
        let note = ordered(many, name).unwrap().1.unwrap();
        assert!(note.ends_with("p_19.bin and 39 more gaps"), "{note}");
        assert_eq!(
            ordered(vec![(3, ()), (3, ())], name).unwrap_err(),
            PiecesError::SameNumber(3)
        );
        assert_eq!(
            ordered(Vec::<(u64, ())>::new(), name).unwrap_err(),
            PiecesError::Empty
        );
        let (_, note) = ordered(vec![(0, ()), (u64::MAX, ())], name).unwrap();
        assert!(note.unwrap().contains("p_1.bin to p_"));
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
