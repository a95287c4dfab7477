//! Frame numbers that only grow, from the numbers of a radar that may restart, lose frames or send damaged headers.

/// Maximum step between two numbers that needs no confirmation: 5 s at 10 frames/s.
const MAX_STEP: u64 = 50;

/// Numbers the frames of a radar from 0, as a recording of them is numbered.
///
/// A number that falls back, or is far ahead, is held until the next frame confirms it. A single damaged header
/// therefore moves no later frame.
#[derive(Debug)]
pub(super) struct Numbers<T> {
    /// The radar's number of the last frame, and ours.
    last: Option<(u64, u64)>,
    held: Option<(u64, T)>,
    /// Frame periods that passed during an interruption, until the first frame after it.
    interruption: Option<u64>,
    /// Numbers missing between frames.
    pub lost: u64,
    /// Frames dropped because no other frame fits their number.
    pub unconfirmed: u64,
}

impl<T> Default for Numbers<T> {
    fn default() -> Self {
        Self {
            last: None,
            held: None,
            interruption: None,
            lost: 0,
            unconfirmed: 0,
        }
    }
}

impl<T> Numbers<T> {
    /// Adds a frame with the radar's number. Returns the frames that can be given out, with their numbers.
    pub(super) fn push(&mut self, number: u64, item: T) -> impl Iterator<Item = (u64, T)> + use<T> {
        let mut out = [None, None];
        let Some((last, at)) = self.last else {
            self.last = Some((number, 0));
            out[0] = Some((0, item));
            return out.into_iter().flatten();
        };
        if let Some(passed) = self.interruption.take() {
            // The radar's own step is exact if it kept counting. Otherwise it restarted.
            let slack = 2 + passed / 8;
            let step = number
                .checked_sub(last)
                .filter(|step| *step > 0 && step.abs_diff(passed) <= slack);
            let step = match step {
                Some(step) => self.step(step),
                None => passed.max(1),
            };
            out[0] = Some((self.accept(number, at.saturating_add(step)), item));
            return out.into_iter().flatten();
        }
        if let Some((held, held_item)) = self.held.take() {
            // A number that fits both belongs to the nearer one.
            if follows(held, number) && (held > last || !follows(last, number)) {
                // The held number was right: a restart, whose frames follow on, or many lost frames.
                let jump = match held.checked_sub(last) {
                    Some(step) if step > 0 => self.step(step),
                    _ => 1,
                };
                let held_at = at.saturating_add(jump);
                let step = self.step(number - held);
                out[0] = Some((held_at, held_item));
                out[1] = Some((self.accept(number, held_at.saturating_add(step)), item));
                return out.into_iter().flatten();
            }
            self.unconfirmed += 1;
        }
        if follows(last, number) {
            let step = self.step(number - last);
            out[0] = Some((self.accept(number, at.saturating_add(step)), item));
        } else {
            self.held = Some((number, item));
        }
        out.into_iter().flatten()
    }

    /// Frames stopped for `passed` frame periods. A frame that waits for confirmation is dropped.
    pub(super) fn interrupt(&mut self, passed: u64) {
        self.unconfirmed += u64::from(self.held.take().is_some());
        self.interruption = Some(passed);
    }

    fn step(&mut self, step: u64) -> u64 {
        self.lost = self.lost.saturating_add(step.saturating_sub(1));
        step
    }

    fn accept(&mut self, number: u64, at: u64) -> u64 {
        self.last = Some((number, at));
        at
    }
}

fn follows(before: u64, number: u64) -> bool {
    number > before && number - before <= MAX_STEP
}

#[cfg(test)]
mod tests {
    use super::*;

    fn given(numbers: &mut Numbers<u64>, radar: &[u64]) -> Vec<(u64, u64)> {
        radar.iter().flat_map(|n| numbers.push(*n, *n)).collect()
    }

    #[test]
    fn lost_frames_leave_gaps_and_restarts_follow_on() {
        let mut numbers = Numbers::default();
        let found = given(&mut numbers, &[5, 6, 9, 2, 3, 500, 501]);
        // Those of a recording: crates/base/src/timeline.rs.
        assert_eq!(
            found,
            [
                (0, 5),
                (1, 6),
                (4, 9),
                (5, 2),
                (6, 3),
                (503, 500),
                (504, 501)
            ]
        );
        assert_eq!((numbers.lost, numbers.unconfirmed), (2 + 496, 0));
        // The number of 32 bits overflows.
        let mut numbers = Numbers::default();
        let end = u64::from(u32::MAX);
        let found = given(&mut numbers, &[end, 0, 1]);
        assert_eq!(found, [(0, end), (1, 0), (2, 1)]);
    }

    #[test]
    fn a_damaged_number_moves_no_other_frame() {
        let mut numbers = Numbers::default();
        let found = given(&mut numbers, &[7, 4_000_000_000, 9, 3, 3, 10, u64::MAX, 11]);
        assert_eq!(found, [(0, 7), (2, 9), (3, 10), (4, 11)]);
        assert_eq!((numbers.lost, numbers.unconfirmed), (1, 4));
    }

    #[test]
    fn numbers_go_on_after_an_interruption() {
        let mut numbers = Numbers::default();
        given(&mut numbers, &[100, 101]);
        // The radar kept counting.
        numbers.interrupt(30);
        assert_eq!(given(&mut numbers, &[132, 133]), [(32, 132), (33, 133)]);
        assert_eq!(numbers.lost, 30);
        // It restarted: the time counts.
        numbers.interrupt(40);
        assert_eq!(given(&mut numbers, &[0, 1]), [(73, 0), (74, 1)]);
        // At once, and with a damaged number.
        numbers.interrupt(0);
        assert_eq!(given(&mut numbers, &[1_000_000]), [(75, 1_000_000)]);
        assert_eq!(numbers.lost, 30);
    }
}
