//! The time of a stream of frames.
//!
//! Frames are counted by the radar, so that `t_s`, the number of a frame times the frame period, is free of the delays
//! of ports and queues. The time of day (UTC) is anchored to it at the first frame, and again when the two have moved
//! apart. The caller reads the clock of the computer.

use crate::options::{OptionError, has_passed, is_over, within};

/// Difference between the clocks above which the time of day is anchored again, ms. A row of the timeline is several
/// seconds long, and a quartz drifts by 1 s in some hours.
const MAX_DRIFT_MS: i64 = 1_000;
/// Time for which frames must be late before it is the clock that has moved, s. Ports and queues deliver a frame late
/// and the next ones in a burst, but never early.
const LATE_S: f64 = 2.0;
/// Longest gap within a window or a row, s.
pub const MAX_GAP_S: f64 = 2.0;
/// Longest silence that is counted in frames when a radar starts again, ms: a year.
const MAX_SILENCE_MS: i64 = 31_536_000_000;

/// The time of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tick {
    /// Time of the stream, s. It never decreases.
    pub t_s: f64,
    /// Time of day, milliseconds since 1970 in UTC.
    pub utc_ms: i64,
    /// Whether windows and rows end before this frame: frames of more than [`MAX_GAP_S`] are missing, nothing was heard
    /// for so long, the radar counts anew, or the time of day went back.
    pub is_after_gap: bool,
    /// By how much the time of day was moved, ms, if it was anchored again.
    pub step_ms: Option<i64>,
}

/// The clock of a stream.
#[derive(Clone, Debug)]
pub struct StreamClock {
    period_s: f64,
    anchor: Option<Anchor>,
    last: Option<Last>,
    /// Added to the number of a frame, modulo 2^64: not zero after a radar has begun to count anew.
    offset: u64,
    late: Option<Late>,
    n_steps: u64,
}

#[derive(Clone, Copy, Debug)]
struct Anchor {
    t_s: f64,
    utc_ms: i64,
}

/// The last frame.
#[derive(Clone, Copy, Debug)]
struct Last {
    /// Number after the offset.
    number: u64,
    now_ms: Option<i64>,
}

/// Frames that came late without exception.
#[derive(Clone, Copy, Debug)]
struct Late {
    since_s: f64,
    min_ms: i64,
}

impl Anchor {
    fn utc_ms(&self, t_s: f64) -> i64 {
        // A conversion of a float saturates.
        self.utc_ms
            .saturating_add(((t_s - self.t_s) * 1e3).round() as i64)
    }
}

impl StreamClock {
    /// A clock for frames of a period.
    ///
    /// # Errors
    /// If the period is not within 0.001 to 10 s.
    pub fn new(period_s: f64) -> Result<Self, OptionError> {
        within("period_s", period_s, [1e-3, 10.0], "0.001 to 10 s")?;
        Ok(Self {
            period_s,
            anchor: None,
            last: None,
            offset: 0,
            late: None,
            n_steps: 0,
        })
    }

    /// The time of the next frame, which arrived at `now_ms`. Numbers rise; a number that does not is that of a radar
    /// which was started again, and time goes on from the last frame.
    pub fn frame(&mut self, number: u64, now_ms: i64) -> Tick {
        self.tick(number, Some(now_ms), now_ms)
    }

    /// The time of the next frame of a replay, whose first frame was at `start_ms`. The clock of the computer has no
    /// part in it.
    pub fn replayed(&mut self, number: u64, start_ms: i64) -> Tick {
        self.tick(number, None, start_ms)
    }

    /// How often the time of day was anchored again.
    pub fn n_steps(&self) -> u64 {
        self.n_steps
    }

    /// Time of day of a time of the stream, milliseconds since 1970 in UTC; `None` before the first frame.
    pub fn utc_ms(&self, t_s: f64) -> Option<i64> {
        Some(self.anchor?.utc_ms(t_s))
    }

    fn tick(&mut self, number: u64, now_ms: Option<i64>, first_ms: i64) -> Tick {
        let heard_ms = self.last.and_then(|last| last.now_ms).zip(now_ms);
        let silence_ms = heard_ms.map_or(0, |(last, now)| now.saturating_sub(last));
        let mut at = number.wrapping_add(self.offset);
        let mut is_after_gap = false;
        if let Some(last) = self.last {
            // Also where a large number wraps around.
            if at <= last.number {
                let silence_s = silence_ms.clamp(0, MAX_SILENCE_MS) as f64 / 1e3;
                let missed = (silence_s / self.period_s).round().max(1.0) as u64;
                at = last.number.saturating_add(missed);
                self.offset = at.wrapping_sub(number);
                is_after_gap = true;
            }
            let passed_s = (at - last.number) as f64 * self.period_s;
            is_after_gap |= is_over(0.0, passed_s, MAX_GAP_S)
                || is_over(passed_s, silence_ms as f64 / 1e3, MAX_GAP_S);
        }
        self.last = Some(Last { number: at, now_ms });
        let t_s = at as f64 * self.period_s;
        let first = Anchor {
            t_s,
            utc_ms: first_ms,
        };
        let anchor = *self.anchor.get_or_insert(first);
        let apart_ms = now_ms.map_or(0, |now| now.saturating_sub(anchor.utc_ms(t_s)));
        let step_ms = self.step_ms(t_s, apart_ms);
        if let Some(step_ms) = step_ms {
            self.anchor = Some(Anchor {
                t_s,
                utc_ms: anchor.utc_ms(t_s).saturating_add(step_ms),
            });
            self.late = None;
            self.n_steps = self.n_steps.saturating_add(1);
            is_after_gap |= step_ms < (-1e3 * MAX_GAP_S) as i64;
        }
        let anchor = self.anchor.unwrap_or(first);
        Tick {
            t_s,
            utc_ms: anchor.utc_ms(t_s),
            is_after_gap,
            step_ms,
        }
    }

    /// By how much the time of day is to be moved for a frame that is late by `apart_ms`.
    fn step_ms(&mut self, t_s: f64, apart_ms: i64) -> Option<i64> {
        if apart_ms <= MAX_DRIFT_MS {
            self.late = None;
            return (apart_ms < -MAX_DRIFT_MS).then_some(apart_ms);
        }
        let late = self.late.get_or_insert(Late {
            since_s: t_s,
            min_ms: apart_ms,
        });
        late.min_ms = late.min_ms.min(apart_ms);
        let min_ms = late.min_ms;
        has_passed(late.since_s, t_s, LATE_S).then_some(min_ms)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const START_MS: i64 = 1_795_455_492_000;

    /// Ticks of frames at 10 Hz that arrive `late_ms` after their time.
    fn ticks(clock: &mut StreamClock, frames: impl Iterator<Item = (u64, i64)>) -> Vec<Tick> {
        frames
            .map(|(n, late_ms)| clock.frame(n, START_MS + 100 * n as i64 + late_ms))
            .collect()
    }

    #[test]
    fn time_is_the_number_times_the_period() {
        let mut clock = StreamClock::new(0.1).unwrap();
        // Frames come up to 0.9 s late.
        let found = ticks(&mut clock, (0..50).map(|n| (n, (n as i64 * 37) % 900)));
        for (n, tick) in found.iter().enumerate() {
            let expected = Tick {
                t_s: n as f64 * 0.1,
                utc_ms: START_MS + 100 * n as i64,
                is_after_gap: false,
                step_ms: None,
            };
            assert_eq!(*tick, expected);
        }
        assert_eq!(clock.n_steps(), 0);
        assert_eq!(clock.utc_ms(1.0), Some(START_MS + 1_000));
        assert!(StreamClock::new(f64::NAN).is_err() && StreamClock::new(0.0).is_err());
    }

    #[test]
    fn a_gap_is_more_than_two_seconds_of_frames() {
        let mut clock = StreamClock::new(0.1).unwrap();
        let found = ticks(&mut clock, [0, 20, 41].map(|n| (n, 0)).into_iter());
        assert_eq!(found.map_gaps(), [false, false, true]);
        // Nothing was heard for 2 s and a frame, then for longer, as when the computer was suspended.
        let mut clock = StreamClock::new(0.1).unwrap();
        let found = ticks(&mut clock, [(0, 0), (1, 2_000), (2, 4_001)].into_iter());
        assert_eq!(found.map_gaps(), [false, false, true]);
    }

    trait Gaps {
        fn map_gaps(&self) -> Vec<bool>;
    }

    impl Gaps for Vec<Tick> {
        fn map_gaps(&self) -> Vec<bool> {
            self.iter().map(|t| t.is_after_gap).collect()
        }
    }

    #[test]
    fn drift_is_corrected_after_a_second_and_counted() {
        // The radar's frames take 101 ms: the clocks are more than 1 s apart after each 1,001 frames.
        let mut clock = StreamClock::new(0.1).unwrap();
        let mut n_steps = 0;
        for n in 0..5_000u64 {
            let now_ms = START_MS + 101 * n as i64;
            let tick = clock.frame(n, now_ms);
            assert!((tick.utc_ms - now_ms).abs() <= 1_021, "frame {n}");
            assert!(!tick.is_after_gap);
            n_steps += u64::from(tick.step_ms.is_some());
        }
        assert_eq!((n_steps, clock.n_steps()), (4, 4));
    }

    #[test]
    fn a_late_burst_moves_nothing() {
        let mut clock = StreamClock::new(0.1).unwrap();
        // Frames 20 to 38 come together at the time of frame 38.
        let late = |n: u64| {
            if (20..39).contains(&n) {
                100 * (38 - n as i64)
            } else {
                0
            }
        };
        let found = ticks(&mut clock, (0..100).map(|n| (n, late(n))));
        assert!(found.iter().all(|t| t.step_ms.is_none()));
    }

    #[test]
    fn a_step_of_the_computer_is_followed() {
        // An hour ahead from frame 50 on: after 2 s the time of day follows.
        let mut clock = StreamClock::new(0.1).unwrap();
        let ahead = |n: u64| if n >= 50 { 3_600_000 } else { 0 };
        let found = ticks(&mut clock, (0..100).map(|n| (n, ahead(n))));
        let steps: Vec<usize> = (0..100).filter(|&n| found[n].step_ms.is_some()).collect();
        assert_eq!(steps, [70]);
        assert_eq!(found[70].step_ms, Some(3_600_000));
        assert_eq!(found[99].utc_ms, START_MS + 9_900 + 3_600_000);
        let gaps: Vec<usize> = (0..100).filter(|&n| found[n].is_after_gap).collect();
        assert_eq!(gaps, [50]);
        // Exactly 1 s behind is drift that may stay; more is followed at once.
        let mut clock = StreamClock::new(0.1).unwrap();
        let behind = [(0, 0), (1, -1_000), (2, -1_001), (3, -5_000)];
        let found = ticks(&mut clock, behind.into_iter());
        let steps: Vec<Option<i64>> = found.iter().map(|t| t.step_ms).collect();
        assert_eq!(steps, [None, None, Some(-1_001), Some(-3_999)]);
        assert_eq!(found.map_gaps(), [false, false, false, true]);
        assert_eq!(clock.n_steps(), 2);
    }

    #[test]
    fn a_radar_that_counts_anew_goes_on() {
        let mut clock = StreamClock::new(0.1).unwrap();
        clock.frame(500, START_MS);
        // Unplugged for 30 s.
        let tick = clock.frame(0, START_MS + 30_000);
        assert!((tick.t_s - 80.0).abs() < 1e-9 && tick.is_after_gap);
        assert_eq!((tick.utc_ms, tick.step_ms), (START_MS + 30_000, None));
        let tick = clock.frame(1, START_MS + 30_100);
        assert!((tick.t_s - 80.1).abs() < 1e-9 && !tick.is_after_gap);
    }

    #[test]
    fn a_replay_does_not_look_at_the_computer() {
        let mut clock = StreamClock::new(0.05).unwrap();
        let found: Vec<i64> = [7, 8, 9, 107]
            .map(|n| clock.replayed(n, START_MS).utc_ms)
            .into();
        assert_eq!(found, [0, 50, 100, 5_000].map(|ms| START_MS + ms));
    }

    proptest! {
        #[test]
        fn time_never_goes_back(frames in prop::collection::vec((any::<u64>(), any::<i64>(), 0u64..50), 1..60)) {
            let mut clock = StreamClock::new(0.1).unwrap();
            let mut last_s = 0.0;
            let mut number = 0;
            for (any, now_ms, step) in frames {
                number = if step == 0 { any } else { number + step };
                number %= u64::MAX / 2;
                let tick = clock.frame(number, now_ms);
                prop_assert!(tick.t_s >= last_s);
                last_s = tick.t_s;
            }
        }
    }
}
