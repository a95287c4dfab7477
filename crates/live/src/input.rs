//! Sources of frames, each on a thread of its own.

use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

use radarllm::{Clip, Error, Recording, Result};
use radarllm_base::{Clutter, PointFrame, Provenance, SourceInfo};
use radarllm_io::live::{LiveEvent, LiveSource};
use radarllm_monitor::liveness::Liveness;
use radarllm_monitor::pipeline::{Arrival, StreamInfo};
use radarllm_monitor::queue::{FrameQueue, Item, QueuedFrame, WhenFull};

use crate::local_time::now_ms;
use crate::metrics::Metrics;
use crate::resample::Resampler;
use crate::room::{Room, RoomOptions};

/// Longest time for which a source sleeps before it looks whether it is still wanted.
const NAP: Duration = Duration::from_millis(50);
/// Longest time for which a radar is waited for before the source looks whether it is still wanted.
const WAIT: Duration = Duration::from_millis(200);

/// Reads the time of day, milliseconds since 1970 in UTC.
pub type ReadTime = Arc<dyn Fn() -> i64 + Send + Sync>;

/// How fast a recording is replayed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Speed {
    /// As many times as fast as it was recorded.
    Times(f64),
    /// As fast as the pipeline is.
    Max,
}

/// Where frames come from.
pub struct Input {
    /// Name of the source, as in the memory.
    pub(crate) name: String,
    /// The stream behind the resampler.
    pub(crate) stream: StreamInfo,
    notes: Vec<String>,
    /// Time between two frames of the source, s.
    source_period_s: f64,
    /// The time at which frames arrive.
    now_ms: ReadTime,
    kind: Kind,
}

enum Kind {
    Replay {
        clip: Clip,
        speed: Speed,
        repeats: bool,
        /// Time of day of the first frame, milliseconds since 1970 in UTC.
        start_ms: Option<i64>,
    },
    Room(Box<Room>),
    Radar(Box<dyn LiveSource>),
}

/// What is known about a source, as the pipeline takes it.
fn stream_of(source: SourceInfo) -> StreamInfo {
    StreamInfo {
        frame_period_s: source.frame_period_s,
        radar_height_m: source.radar_height_m.into(),
        is_height_assumed: source.is_height_assumed,
        radar: source.radar,
        provenance: source.provenance,
        clutter: source.clutter,
    }
}

/// What a user should know of a radar whose height nobody states.
fn about_height(stream: &StreamInfo) -> Option<String> {
    stream.is_height_assumed.then(|| {
        format!(
            "the height of the radar is not stated (--radar-height-m): {} m are assumed, on which falls and postures depend",
            stream.radar_height_m
        )
    })
}

impl Input {
    fn new(name: &str, source: StreamInfo, kind: Kind) -> Self {
        let source_period_s = source.frame_period_s;
        let stream = StreamInfo {
            frame_period_s: Resampler::new(source_period_s).period_s(),
            ..source
        };
        Self {
            name: name.into(),
            stream,
            notes: Vec::new(),
            source_period_s,
            now_ms: Arc::new(now_ms),
            kind,
        }
    }

    /// The same input by another clock than that of the computer, for radars that run faster than time passes. A replay
    /// has the time of its recording.
    #[must_use]
    pub fn with_clock(self, now_ms: ReadTime) -> Self {
        Self { now_ms, ..self }
    }

    /// A replay whose first frame was recorded at this time of day, milliseconds since 1970 in UTC. Without it, a replay
    /// ends now, or later if it is slower than the recording.
    ///
    /// # Errors
    /// An input that is no replay.
    pub fn starting_at(mut self, utc_ms: i64) -> Result<Self> {
        match &mut self.kind {
            Kind::Replay { start_ms, .. } => *start_ms = Some(utc_ms),
            Kind::Room(_) | Kind::Radar(_) => {
                return Err(Error::input(format!(
                    "{}: only a recording has a start",
                    self.name
                )));
            }
        }
        Ok(self)
    }

    /// Notes for the user: how the format was detected, mounting angles, a buffer of the system that is too small.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// A running radar.
    pub fn radar(name: &str, source: Box<dyn LiveSource>) -> Self {
        let mut notes = source.notes().to_vec();
        let stream = stream_of(source.about());
        notes.extend(about_height(&stream));
        Self {
            notes,
            ..Self::new(name, stream, Kind::Radar(source))
        }
    }

    /// A recording, which is replayed.
    ///
    /// # Errors
    /// A recording without frames, one without a frame rate, and a speed that is not positive.
    pub fn replay(name: &str, recording: Recording, speed: Speed, repeats: bool) -> Result<Self> {
        let (clip, mut notes) = (recording.clip, recording.notes);
        if clip.frames.is_empty() {
            return Err(Error::input(format!("{name}: the recording has no frames")));
        }
        if let Speed::Times(times) = speed
            && !(times.is_finite() && (0.01..=1_000.0).contains(&times))
        {
            return Err(Error::input(format!(
                "the speed must be 0.01 to 1000 or `max`, found {times}"
            )));
        }
        let stream = stream_of(clip.source_info());
        notes.extend(about_height(&stream));
        let kind = Kind::Replay {
            clip,
            speed,
            repeats,
            start_ms: None,
        };
        Ok(Self {
            notes,
            ..Self::new(name, stream, kind)
        })
    }

    /// The simulated room. Everything that comes from it is marked as simulated.
    ///
    /// # Errors
    /// A radar that cannot be simulated.
    pub fn room(options: &RoomOptions) -> Result<Self> {
        let room = Room::new(options)?;
        let stream = StreamInfo {
            frame_period_s: room.frame_period_s(),
            radar_height_m: room.radar_height_m(),
            is_height_assumed: false,
            radar: room.radar().into(),
            provenance: Provenance::simulated("sim:", options.seed),
            clutter: Clutter::Settled,
        };
        Ok(Self::new("sim:", stream, Kind::Room(Box::new(room))))
    }

    /// What the queue behind this source does when it is full.
    pub(crate) fn when_full(&self) -> WhenFull {
        match self.kind {
            Kind::Replay { .. } => WhenFull::Wait,
            Kind::Room(_) | Kind::Radar(_) => WhenFull::DropOldest,
        }
    }

    /// Puts frames into the queue until there are no more or the queue is closed.
    ///
    /// # Errors
    /// What waiting for a radar cannot repair.
    pub(crate) fn run(
        self,
        queue: &FrameQueue,
        liveness: &Arc<Liveness>,
        metrics: &Metrics,
    ) -> Result<()> {
        let period_s = self.source_period_s;
        let mut sink = Sink {
            resampler: Resampler::new(period_s),
            queue,
            liveness,
        };
        let ended = match self.kind {
            Kind::Replay {
                clip,
                speed,
                repeats,
                start_ms,
            } => {
                replay(&clip, speed, repeats, start_ms, period_s, &mut sink);
                Ok(())
            }
            Kind::Room(room) => {
                run_room(*room, period_s, &mut sink, &self.now_ms);
                Ok(())
            }
            Kind::Radar(source) => run_radar(source, &mut sink, metrics, &self.now_ms),
        };
        sink.other(Item::End);
        ended
    }
}

/// The queue, with a resampler before it.
struct Sink<'a> {
    resampler: Resampler,
    queue: &'a FrameQueue,
    liveness: &'a Liveness,
}

impl Sink<'_> {
    /// A frame of the source. Returns false if nothing more is wanted.
    fn frame(&mut self, frame: PointFrame, arrival: Arrival) -> bool {
        self.liveness.frame_arrived();
        self.queue.arrived(frame.frame);
        let complete = self.resampler.push(frame, arrival);
        self.push(complete)
    }

    /// Something else. Returns false if nothing more is wanted.
    fn other(&mut self, item: Item) -> bool {
        let last = self.resampler.end();
        self.push(last);
        self.queue.push(item)
    }

    /// Every frame is pushed, also after the queue was closed: it counts them.
    fn push(&self, frames: impl IntoIterator<Item = QueuedFrame>) -> bool {
        let mut is_wanted = true;
        for frame in frames {
            is_wanted &= self.queue.push(Item::Frame(frame));
        }
        is_wanted
    }
}

fn replay(
    clip: &Clip,
    speed: Speed,
    repeats: bool,
    start_ms: Option<i64>,
    period_s: f64,
    sink: &mut Sink,
) {
    let began = Instant::now();
    let numbers = numbers(clip, period_s);
    let length = numbers.last().map_or(1, |last| last + 1);
    // A replay that is faster than the recording begins in the past, so that none of it is in the future.
    let length_s = f64::from(length) * period_s;
    let replay_s = match speed {
        Speed::Times(times) => length_s / times,
        Speed::Max => 0.0,
    };
    let ahead_s = (length_s - replay_s).max(0.0);
    let start_ms =
        start_ms.unwrap_or_else(|| now_ms().saturating_sub((ahead_s * 1e3).round() as i64));
    let mut first = 0u32;
    loop {
        for (number, frame) in numbers.iter().zip(&clip.frames) {
            let number = first.saturating_add(*number);
            if let Speed::Times(times) = speed {
                let due_s = f64::from(number) * period_s / times;
                if !sleep_until(began, due_s, sink.queue) {
                    return;
                }
            }
            let frame = PointFrame {
                frame: number,
                ..frame.clone()
            };
            if !sink.frame(frame, Arrival::Replayed(start_ms)) {
                return;
            }
        }
        // A gap of more than 2 s, so that nothing reaches from the end to the beginning.
        let pause = (3.0 / period_s).ceil() as u32;
        first = first.saturating_add(length).saturating_add(pause);
        if !repeats {
            return;
        }
    }
}

/// Numbers of the frames from 0, by their times: frames that the recording lacks stay gaps.
fn numbers(clip: &Clip, period_s: f64) -> Vec<u32> {
    let first_s = clip.frames.first().map_or(0.0, |f| f.time_s);
    let mut next = 0;
    let number = |frame: &PointFrame| {
        let number = ((frame.time_s - first_s) / period_s).round() as u32;
        let number = number.max(next);
        next = number + 1;
        number
    };
    clip.frames.iter().map(number).collect()
}

fn run_room(room: Room, period_s: f64, sink: &mut Sink, now_ms: &ReadTime) {
    let mut frames = room.frames();
    // Time begins when the first frame is simulated, so that no frame comes after its time from the beginning.
    let mut next = frames.next();
    let began = Instant::now();
    let mut number = 0;
    while let Some(points) = next {
        if !sleep_until(began, f64::from(number) * period_s, sink.queue) {
            return;
        }
        let frame = PointFrame {
            frame: number,
            time_s: 0.0,
            points,
            board: None,
        };
        if !sink.frame(frame, Arrival::At(now_ms())) {
            return;
        }
        next = frames.next();
        number = next_number(number, began.elapsed().as_secs_f64() / period_s);
    }
}

/// Number of the frame after one, when so many periods have passed. A simulation that is late leaves a gap, as a radar
/// whose frames are lost: frames in a burst would not be of the present.
fn next_number(number: u32, periods: f64) -> u32 {
    // The conversion saturates.
    number.saturating_add(1).max(periods as u32)
}

fn run_radar(
    mut source: Box<dyn LiveSource>,
    sink: &mut Sink,
    metrics: &Metrics,
    now_ms: &ReadTime,
) -> Result<()> {
    while !sink.queue.is_closed() {
        let at_ms = now_ms();
        let event = source.next(WAIT)?;
        let counts = source.counts();
        for (counter, n) in [
            (&metrics.reconnects, counts.reconnects),
            (&metrics.foreign_datagrams, counts.foreign_datagrams),
            (&metrics.refused_lines, counts.refused_lines),
            (&metrics.resynchronisations, counts.resynchronisations),
        ] {
            counter.raise_to(n);
        }
        metrics.source_problem.set(source.problem());
        let is_wanted = match event {
            None => continue,
            Some(LiveEvent::End) => return Ok(()),
            Some(LiveEvent::Frame(frame)) => sink.frame(frame, Arrival::At(now_ms())),
            Some(LiveEvent::Lost { reason }) => sink.other(Item::Lost { at_ms, reason }),
            Some(LiveEvent::Back) => sink.other(Item::Back { at_ms }),
        };
        if !is_wanted {
            return Ok(());
        }
    }
    Ok(())
}

/// Sleeps until a time after `began`. Returns false if the queue was closed meanwhile.
fn sleep_until(began: Instant, due_s: f64, queue: &FrameQueue) -> bool {
    loop {
        if queue.is_closed() {
            return false;
        }
        let left_s = due_s - began.elapsed().as_secs_f64();
        if left_s <= 0.0 {
            return true;
        }
        thread::sleep(NAP.min(Duration::from_secs_f64(left_s)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_late_simulation_leaves_a_gap_and_no_burst() {
        assert_eq!(next_number(7, 7.2), 8);
        assert_eq!(next_number(7, 8.9), 8);
        assert_eq!(next_number(7, 42.5), 42);
    }

    #[test]
    fn every_frame_of_a_fast_radar_has_one_fate() {
        let metrics = Arc::new(Metrics::default());
        let queue = FrameQueue::new(WhenFull::DropOldest, Arc::clone(&metrics.monitor));
        let liveness = Liveness::new(Duration::from_millis(100));
        let mut sink = Sink {
            resampler: Resampler::new(1.0 / 30.0),
            queue: &queue,
            liveness: &liveness,
        };
        let mut frame = |number: u32| {
            let frame = PointFrame {
                frame: number,
                ..PointFrame::default()
            };
            sink.frame(frame, Arrival::At(i64::from(number)))
        };
        let counts = || {
            let lost = metrics.monitor.frames_lost.get();
            (
                metrics.monitor.frames_used.get(),
                lost,
                metrics.monitor.frames_dropped.get(),
            )
        };
        // Merged by threes, but for the first two. Every eleventh frame does not arrive.
        let is_sent = |n: &u32| n % 11 != 5;
        assert!((0..302).filter(is_sent).all(&mut frame));
        // Of 101 merged frames the oldest 37 found no room: 110 frames, of which 10 did not arrive.
        assert_eq!(counts(), (0, 27, 100));
        let first = queue.pop(Duration::ZERO);
        assert!(matches!(first, Some(Item::Frame(queued)) if queued.frame.frame == 37));
        assert_eq!(counts(), (3, 27, 100));
        // Two frames wait to be merged, and one comes too late.
        assert!(frame(302) && frame(303));
        queue.close();
        assert!(!frame(304));
        let (used, lost, dropped) = counts();
        assert_eq!(used + lost + dropped, 305);
        // What waits to be merged is dropped at the end.
        assert!(frame(305) && !sink.other(Item::End));
        let (used, lost, dropped) = counts();
        assert_eq!(used + lost + dropped, 306);
    }

    #[test]
    fn frames_that_a_recording_lacks_stay_gaps() {
        let frame = |time_s: f64| PointFrame {
            time_s,
            ..PointFrame::default()
        };
        let clip = Clip {
            frames: [5.0, 5.1, 5.11, 5.5, 5.6].map(frame).to_vec(),
            frame_rate_hz: 10.0,
            radar_height_m: 1.0,
            is_height_assumed: false,
            radar: "test".into(),
            provenance: Provenance::recorded("csv", "test.csv"),
            clutter: Clutter::Settled,
        };
        assert_eq!(numbers(&clip, 0.1), [0, 1, 2, 5, 6]);
    }
}
