//! What sources have in common after a frame was received: its number, its place, its turn among the events.

use std::{
    collections::VecDeque,
    time::{Duration, Instant},
};

use radarllm_base::{BoardReport, PointFrame, RadarPoint};

use super::{LiveCounts, LiveEvent, LiveTimeouts, numbers::Numbers};
use crate::placing::Placing;

/// Time of frame n. Recordings of points divide by the rate, recordings of samples multiply by the period; the last
/// digits differ.
#[derive(Clone, Copy, Debug)]
pub(super) enum Clock {
    RateHz(f64),
    PeriodS(f64),
}

impl Clock {
    fn time_s(self, at: u64) -> f64 {
        match self {
            Self::RateHz(rate_hz) => at as f64 / rate_hz,
            Self::PeriodS(period_s) => at as f64 * period_s,
        }
    }

    fn periods_in(self, time: Duration) -> u64 {
        let periods = match self {
            Self::RateHz(rate_hz) => time.as_secs_f64() * rate_hz,
            Self::PeriodS(period_s) => time.as_secs_f64() / period_s,
        };
        periods.round() as u64
    }
}

/// Points of a frame, and what the firmware states beside them.
#[derive(Default)]
pub(super) struct FrameContent {
    pub points: Vec<RadarPoint>,
    pub board: Option<BoardReport>,
}

/// Events of a source, and whether its radar is lost.
pub(super) struct Output {
    clock: Clock,
    placing: Placing,
    numbers: Numbers<FrameContent>,
    events: VecDeque<LiveEvent>,
    is_lost: bool,
    /// The stream was interrupted since the last frame.
    is_interrupted: bool,
    last_frame: Option<Instant>,
    /// Time before a lost radar is tried again: the first one, the present one, the maximum.
    delays: [Duration; 3],
    frames: u64,
    reconnects: u64,
}

impl Output {
    pub(super) fn new(clock: Clock, placing: Placing, timeouts: &LiveTimeouts) -> Self {
        Self {
            clock,
            placing,
            numbers: Numbers::default(),
            events: VecDeque::new(),
            is_lost: false,
            is_interrupted: false,
            last_frame: None,
            delays: [
                timeouts.reopen_first,
                timeouts.reopen_first,
                timeouts.reopen_max,
            ],
            frames: 0,
            reconnects: 0,
        }
    }

    /// Numbers and places a frame with the radar's number.
    pub(super) fn give(&mut self, number: u64, content: FrameContent) {
        let now = Instant::now();
        if std::mem::take(&mut self.is_interrupted)
            && let Some(last) = self.last_frame
        {
            let passed = now.saturating_duration_since(last);
            self.numbers.interrupt(self.clock.periods_in(passed));
        }
        self.last_frame = Some(now);
        for (at, content) in self.numbers.push(number, content) {
            if std::mem::take(&mut self.is_lost) {
                self.reconnects += 1;
                self.events.push_back(LiveEvent::Back);
            }
            self.delays[1] = self.delays[0];
            self.frames += 1;
            let frame = self.placing.apply(PointFrame {
                frame: u32::try_from(at).unwrap_or(u32::MAX),
                time_s: self.clock.time_s(at),
                points: content.points,
                board: content.board,
            });
            self.events.push_back(LiveEvent::Frame(frame));
        }
    }

    /// The numbers of later frames may begin anywhere.
    pub(super) fn interrupt(&mut self) {
        self.is_interrupted = true;
    }

    /// Tells a loss, once until frames arrive again.
    pub(super) fn lose(&mut self, source: impl std::fmt::Display, reason: &str) {
        self.is_interrupted = true;
        if !std::mem::replace(&mut self.is_lost, true) {
            let reason = format!("{source}: {reason}");
            self.events.push_back(LiveEvent::Lost { reason });
        }
    }

    pub(super) fn is_lost(&self) -> bool {
        self.is_lost
    }

    /// When to try again. Each time is twice as far away until a frame arrives.
    pub(super) fn next_try(&mut self) -> Instant {
        let now = Instant::now();
        let [_, delay, longest] = &mut self.delays;
        let at = now.checked_add(*delay).unwrap_or(now);
        *delay = (2 * *delay).min(*longest);
        at
    }

    pub(super) fn next_event(&mut self) -> Option<LiveEvent> {
        self.events.pop_front()
    }

    /// Counts of frames, losses and reconnections; `resynchronisations` are frames whose number fitted no other.
    pub(super) fn counts(&self) -> LiveCounts {
        LiveCounts {
            frames: self.frames,
            lost_frames: self.numbers.lost,
            resynchronisations: self.numbers.unconfirmed,
            reconnects: self.reconnects,
            ..LiveCounts::default()
        }
    }
}
