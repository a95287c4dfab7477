//! Recorded frames with times, from time stamps or frame numbers. Frames can be resampled to another rate and
//! accumulated over several frames.

use std::collections::VecDeque;

use crate::{BoardReport, PointFrame, RadarPoint};

/// One frame as stored by a recorder, before it is assigned a time on the recording's clock.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordedFrame {
    /// The recorder's own frame number.
    pub number: u64,
    /// The recorder's own time stamp, s; `None` if the format has no usable clock.
    pub stamp_s: Option<f64>,
    /// Points in the recorder's order.
    pub points: Vec<RadarPoint>,
    /// What the firmware of the board states beside the points; `None` if it states nothing.
    pub board: Option<BoardReport>,
}

/// Maximum number of frames in a timeline: two days at 10 frames/s.
pub const MAX_FRAMES: u64 = 2_000_000;

/// Why frames cannot be assigned times.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TimelineError {
    /// There are neither time stamps nor a frame rate.
    #[error("the recording has no clock: its frame rate must be named")]
    NoRate,
    /// An impossible frame rate.
    #[error("a frame rate of {0} Hz: expected more than 0, at most 1000")]
    Rate(f64),
    /// The time stamps decrease.
    #[error("frame {frame}: time {time_s} s follows {before_s} s")]
    Backwards {
        /// Index of the frame.
        frame: usize,
        /// Its stamp, s.
        time_s: f64,
        /// The preceding time stamp, s.
        before_s: f64,
    },
    /// More frames than any recording has.
    #[error(
        "{0} frames from first to last, at most {MAX_FRAMES} are handled: is the recording cut together?"
    )]
    TooLong(u64),
}

/// Frames with times.
#[derive(Clone, Debug, PartialEq)]
pub struct Timeline {
    /// Frames in order. Frames that the recording lost are absent.
    pub frames: Vec<PointFrame>,
    /// Frames per second.
    pub frame_rate_hz: f64,
    /// Number of times that the frame number decreased (a restarted device). The later frames are appended.
    pub restarts: u64,
    /// Number of frames whose number contradicted both neighbours and was replaced by one between them: a damaged header.
    pub mended_numbers: u64,
}

/// Largest step between the neighbours of a damaged frame number: 5 s at 10 frames/s.
const MAX_MENDED_STEP: u64 = 50;
/// Largest step from the first number of a recording and to its last one, which have one neighbour: a minute at 10 frames/s.
const MAX_END_STEP: u64 = 600;

/// Gives frames that arrive one by one their times by the recorder's frame numbers: number n is at the time of n periods.
///
/// A number that contradicts both neighbours, where these two follow each other, is replaced: one flipped bit would otherwise
/// make a recording hours long, or reorder it. A frame is therefore returned when the next one has arrived, and the first one
/// when two have.
#[derive(Clone, Debug)]
pub struct NumberClock {
    frame_rate_hz: f64,
    /// Frames whose numbers are not certain yet, at most two. The number of the first one is mended already, unless it is the
    /// first of the recording.
    held: VecDeque<RecordedFrame>,
    is_first: bool,
    /// Number of the frame that was returned last, and its place on the clock.
    last: Option<(u64, u64)>,
    restarts: u64,
    mended_numbers: u64,
}

impl NumberClock {
    /// A clock that starts at 0 with the first frame.
    ///
    /// # Errors
    /// [`TimelineError::Rate`].
    pub fn new(frame_rate_hz: f64) -> Result<Self, TimelineError> {
        check_frame_rate(frame_rate_hz)?;
        Ok(Self {
            frame_rate_hz,
            held: VecDeque::new(),
            is_first: true,
            last: None,
            restarts: 0,
            mended_numbers: 0,
        })
    }

    /// Frames per second.
    pub fn frame_rate_hz(&self) -> f64 {
        self.frame_rate_hz
    }

    /// Number of times that the frame number decreased up to now; see [`Timeline::restarts`].
    pub fn restarts(&self) -> u64 {
        self.restarts
    }

    /// Number of frames whose number was replaced up to now; see [`Timeline::mended_numbers`].
    pub fn mended_numbers(&self) -> u64 {
        self.mended_numbers
    }

    /// Takes the next frame and returns one whose time is certain.
    ///
    /// # Errors
    /// [`TimelineError::TooLong`].
    pub fn push(&mut self, frame: RecordedFrame) -> Result<Option<PointFrame>, TimelineError> {
        if let [before, at] = self.held.make_contiguous() {
            let step = frame.number.checked_sub(before.number);
            let has_room = step.is_some_and(|step| (2..=MAX_MENDED_STEP).contains(&step));
            if has_room && !(before.number..=frame.number).contains(&at.number) {
                at.number = before.number + 1;
                self.mended_numbers += 1;
            }
        }
        self.held.push_back(frame);
        match self.held.len() {
            0..=2 => Ok(None),
            _ => self.take(),
        }
    }

    /// Returns one of the last frames after the end of the recording; `None` when all were returned.
    ///
    /// # Errors
    /// [`TimelineError::TooLong`].
    pub fn finish(&mut self) -> Result<Option<PointFrame>, TimelineError> {
        // The last number has one neighbour: the frame before, unless that is the first one, whose number gives way.
        if let [before, last] = self.held.make_contiguous()
            && !self.is_first
            && is_far(before.number, last.number)
        {
            last.number = before.number + 1;
            self.mended_numbers += 1;
        }
        self.take()
    }

    /// The first of the held frames with its time.
    fn take(&mut self) -> Result<Option<PointFrame>, TimelineError> {
        let Some(mut frame) = self.held.pop_front() else {
            return Ok(None);
        };
        if std::mem::take(&mut self.is_first)
            && let Some(next) = self.held.front()
            && is_far(frame.number, next.number)
        {
            frame.number = next.number - 1;
            self.mended_numbers += 1;
        }
        let at = match self.last {
            None => 0,
            Some((number, at)) => match frame.number.checked_sub(number) {
                Some(step) if step > 0 => at.saturating_add(step),
                _ => {
                    self.restarts += 1;
                    at + 1
                }
            },
        };
        if at >= MAX_FRAMES {
            return Err(TimelineError::TooLong(at));
        }
        self.last = Some((frame.number, at));
        Ok(Some(PointFrame {
            frame: at as u32,
            time_s: at as f64 / self.frame_rate_hz,
            points: frame.points,
            board: frame.board,
        }))
    }
}

/// Whether a number is farther ahead than the first or the last number of a recording is.
fn is_far(from: u64, to: u64) -> bool {
    to.checked_sub(from).is_some_and(|step| step > MAX_END_STEP)
}

/// Estimates the frame rate from the steps between time stamps, s. If half of the other steps are similar to the median
/// step, the rate is that of the median step, which lost frames do not change. Stamps that come in bursts (a serial
/// port that is read intermittently) have no such step; the rate is then that of the mean step without pauses.
fn rate_of_steps(mut steps: Vec<f64>) -> f64 {
    steps.sort_by(f64::total_cmp);
    let at = |share: f64| steps[(share * (steps.len() - 1) as f64) as usize];
    let median_s = at(0.5);
    if at(0.25) > 0.8 * median_s && median_s > 0.8 * at(0.75) {
        return 1.0 / median_s;
    }
    let n = steps.partition_point(|s| *s <= 3.0 * at(0.9));
    n as f64 / steps[..n].iter().sum::<f64>()
}

fn check_frame_rate(frame_rate_hz: f64) -> Result<(), TimelineError> {
    if frame_rate_hz > 0.0 && frame_rate_hz <= 1000.0 {
        Ok(())
    } else {
        Err(TimelineError::Rate(frame_rate_hz))
    }
}

impl Timeline {
    /// A timeline of frames that already have their times, at `frame_rate_hz` frames per second.
    pub fn from_frames(frames: Vec<PointFrame>, frame_rate_hz: f64) -> Self {
        Self {
            frames,
            frame_rate_hz,
            restarts: 0,
            mended_numbers: 0,
        }
    }

    /// Assigns times to recorded frames on a clock that starts at 0.
    ///
    /// With `frame_rate_hz`, the recorder's frame number n is at the time of n periods. Without it, the time stamps are
    /// the times, and the rate is the inverse of their median step.
    ///
    /// # Errors
    /// [`TimelineError`]: no clock, a clock that runs backwards, or a recording that is too long.
    pub fn new(
        frames: Vec<RecordedFrame>,
        frame_rate_hz: Option<f64>,
    ) -> Result<Self, TimelineError> {
        match frame_rate_hz {
            Some(frame_rate_hz) => Self::by_number(frames, frame_rate_hz),
            None => Self::by_stamp(frames),
        }
    }

    fn by_number(frames: Vec<RecordedFrame>, frame_rate_hz: f64) -> Result<Self, TimelineError> {
        let mut clock = NumberClock::new(frame_rate_hz)?;
        let mut timed = Vec::with_capacity(frames.len());
        for frame in frames {
            timed.extend(clock.push(frame)?);
        }
        while let Some(frame) = clock.finish()? {
            timed.push(frame);
        }
        Ok(Self {
            frames: timed,
            frame_rate_hz,
            restarts: clock.restarts,
            mended_numbers: clock.mended_numbers,
        })
    }

    fn by_stamp(frames: Vec<RecordedFrame>) -> Result<Self, TimelineError> {
        let stamps: Option<Vec<f64>> = frames.iter().map(|f| f.stamp_s).collect();
        let stamps = stamps
            .filter(|s| s.len() > 1)
            .ok_or(TimelineError::NoRate)?;
        let mut steps = Vec::with_capacity(stamps.len());
        for (i, pair) in stamps.windows(2).enumerate() {
            let step_s = pair[1] - pair[0];
            if step_s.is_nan() || step_s < 0.0 {
                return Err(TimelineError::Backwards {
                    frame: i + 1,
                    time_s: pair[1],
                    before_s: pair[0],
                });
            }
            steps.push(step_s);
        }
        let frame_rate_hz = rate_of_steps(steps);
        check_frame_rate(frame_rate_hz)?;
        if frames.len() as u64 > MAX_FRAMES {
            return Err(TimelineError::TooLong(frames.len() as u64));
        }
        let start_s = stamps[0];
        let frames = frames
            .into_iter()
            .zip(&stamps)
            .enumerate()
            .map(|(i, (frame, stamp_s))| PointFrame {
                frame: i as u32,
                time_s: stamp_s - start_s,
                points: frame.points,
                board: frame.board,
            })
            .collect();
        Ok(Self {
            frames,
            frame_rate_hz,
            restarts: 0,
            mended_numbers: 0,
        })
    }

    /// Resamples the points to another frame rate. Every frame is assigned to the nearest new frame, new frames without
    /// any remain empty, and no points are repeated. With `motion_compensate`, points move along their radial velocity
    /// to the time of their new frame.
    ///
    /// # Errors
    /// [`TimelineError`] for an impossible rate or too many frames.
    pub fn resample(
        &self,
        frame_rate_hz: f64,
        motion_compensate: bool,
    ) -> Result<Self, TimelineError> {
        check_frame_rate(frame_rate_hz)?;
        let start_s = self.frames.first().map_or(0.0, |f| f.time_s);
        let mut out: Vec<PointFrame> = Vec::new();
        for frame in &self.frames {
            let nearest = ((frame.time_s - start_s) * frame_rate_hz).round().max(0.0);
            if nearest >= MAX_FRAMES as f64 {
                return Err(TimelineError::TooLong(nearest as u64));
            }
            while out.len() <= nearest as usize {
                out.push(PointFrame {
                    frame: out.len() as u32,
                    time_s: out.len() as f64 / frame_rate_hz,
                    points: Vec::new(),
                    board: None,
                });
            }
            if let Some(target) = out.last_mut() {
                if frame.board.is_some() {
                    target.board.clone_from(&frame.board);
                }
                let ahead_s = target.time_s - (frame.time_s - start_s);
                extend(
                    &mut target.points,
                    &frame.points,
                    ahead_s,
                    motion_compensate,
                );
            }
        }
        Ok(Self {
            frames: out,
            frame_rate_hz,
            restarts: self.restarts,
            mended_numbers: self.mended_numbers,
        })
    }

    /// Adds to every frame the points of the `n - 1` frame periods before it, for devices that report few points. With
    /// `motion_compensate`, points move along their radial velocity to the time of the frame they join.
    pub fn accumulate(&self, n: usize, motion_compensate: bool) -> Self {
        // Half a period of tolerance, so that frames with jittering stamps do not fall out of the window.
        let window_s = (n.max(1) as f64 - 0.5) / self.frame_rate_hz;
        let mut frames = Vec::with_capacity(self.frames.len());
        let mut first = 0;
        for (i, frame) in self.frames.iter().enumerate() {
            while frame.time_s - self.frames[first].time_s >= window_s && first < i {
                first += 1;
            }
            let mut points = frame.points.clone();
            for before in &self.frames[first..i] {
                extend(
                    &mut points,
                    &before.points,
                    frame.time_s - before.time_s,
                    motion_compensate,
                );
            }
            frames.push(PointFrame {
                frame: frame.frame,
                time_s: frame.time_s,
                points,
                board: frame.board.clone(),
            });
        }
        Self {
            frames,
            frame_rate_hz: self.frame_rate_hz,
            restarts: self.restarts,
            mended_numbers: self.mended_numbers,
        }
    }
}

fn extend(
    points: &mut Vec<RadarPoint>,
    more: &[RadarPoint],
    ahead_s: f64,
    motion_compensate: bool,
) {
    if motion_compensate {
        points.extend(more.iter().map(|p| moved(p, ahead_s)));
    } else {
        points.extend_from_slice(more);
    }
}

/// Position of a point after `ahead_s` if it keeps its radial velocity and moves along the line of sight. A point never
/// passes through the radar.
pub fn moved(point: &RadarPoint, ahead_s: f64) -> RadarPoint {
    let range_m = f64::from(point.range_m);
    let scale = if range_m > 0.0 {
        (1.0 + f64::from(point.velocity_mps) * ahead_s / range_m).max(0.0) as f32
    } else {
        1.0
    };
    RadarPoint {
        x_m: point.x_m * scale,
        y_m: point.y_m * scale,
        z_m: point.z_m * scale,
        range_m: point.range_m * scale,
        ..*point
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(number: u64, stamp_s: Option<f64>, y_m: f32) -> RecordedFrame {
        RecordedFrame {
            number,
            stamp_s,
            points: vec![RadarPoint {
                y_m,
                range_m: y_m,
                velocity_mps: 1.0,
                ..RadarPoint::default()
            }],
            board: None,
        }
    }

    #[test]
    fn numbers_leave_gaps_and_survive_a_restart() {
        let frames = [5, 6, 9, 2, 3].map(|n| frame(n, None, 1.0)).to_vec();
        let line = Timeline::new(frames.clone(), Some(20.0)).unwrap();
        let numbers: Vec<u32> = line.frames.iter().map(|f| f.frame).collect();
        assert_eq!((numbers, line.restarts), (vec![0, 1, 4, 5, 6], 1));
        assert_eq!(line.frames[2].time_s, 0.2);
        assert_eq!(
            Timeline::new(frames, None).unwrap_err(),
            TimelineError::NoRate
        );
        let far = [0, 1, u64::MAX - 1, u64::MAX]
            .map(|n| frame(n, None, 1.0))
            .to_vec();
        assert!(matches!(
            Timeline::new(far, Some(10.0)),
            Err(TimelineError::TooLong(_))
        ));
    }

    /// Every bit of every number, one at a time: no frame is lost, none changes its place in the order, and a recording does
    /// not become longer than a lost last frame makes it.
    #[test]
    fn a_flipped_bit_of_a_number_neither_moves_a_frame_nor_makes_the_recording_longer() {
        let whole: Vec<u64> = (1_000..1_040).filter(|n| n % 7 != 3).collect();
        for at in 0..whole.len() {
            for bit in 0..32 {
                let mut numbers = whole.clone();
                numbers[at] ^= 1 << bit;
                let frames: Vec<_> = numbers
                    .iter()
                    .enumerate()
                    .map(|(i, n)| frame(*n, None, i as f32))
                    .collect();
                let line = Timeline::new(frames, Some(10.0)).unwrap();
                let order: Vec<f32> = line.frames.iter().map(|f| f.points[0].y_m).collect();
                assert!(
                    order.is_sorted() && order.len() == whole.len(),
                    "{at} {bit}"
                );
                // The first and the last number have one neighbour.
                let is_end = at == 0 || at == whole.len() - 1;
                let last_s = 3.9
                    + if is_end {
                        MAX_END_STEP as f64 / 10.0
                    } else {
                        0.0
                    };
                let length_s = line.frames.last().unwrap().time_s;
                assert!(length_s <= last_s + 1e-9, "{at} {bit}: {length_s} s");
                assert!(line.frames.is_sorted_by(|a, b| a.frame < b.frame));
            }
        }
        // Sub-frames repeat a number, also about a lost frame.
        let frames = [5, 5, 7, 7].map(|n| frame(n, None, 1.0)).to_vec();
        assert_eq!(Timeline::new(frames, Some(10.0)).unwrap().mended_numbers, 0);
    }

    #[test]
    fn bursts_of_stamps_give_the_mean_rate_and_lost_frames_do_not_count() {
        let frame_rate_hz = |stamps: Vec<f64>| {
            let frames = stamps.iter().map(|&t| frame(0, Some(t), 1.0)).collect();
            Timeline::new(frames, None).unwrap().frame_rate_hz
        };
        // Two frames every 66.7 ms, the second 8 ms after the first; the recorder paused for a minute.
        let burst = |n: u32| f64::from(n / 2) / 15.0 + 0.008 * f64::from(n % 2);
        let pause = |n: u32| burst(n) + if n < 150 { 0.0 } else { 60.0 };
        assert!((frame_rate_hz((0..301).map(pause).collect()) - 30.0).abs() < 0.3);
        // Every sixth frame of a steady 20 per second is lost.
        let steady = (0..300).filter(|n| n % 6 != 0);
        assert!((frame_rate_hz(steady.map(|n| f64::from(n) / 20.0).collect()) - 20.0).abs() < 1e-6);
    }

    #[test]
    fn stamps_give_times_and_the_median_rate() {
        let stamps = [100.0, 100.1, 100.2, 100.7];
        let frames = stamps.map(|t| frame(0, Some(t), 1.0)).to_vec();
        let line = Timeline::new(frames, None).unwrap();
        assert!((line.frame_rate_hz - 10.0).abs() < 1e-6);
        assert!((line.frames[3].time_s - 0.7).abs() < 1e-9);
        let back = vec![frame(0, Some(1.0), 1.0), frame(1, Some(0.5), 1.0)];
        assert!(matches!(
            Timeline::new(back, None),
            Err(TimelineError::Backwards { frame: 1, .. })
        ));
        let nan = vec![frame(0, Some(1.0), 1.0), frame(1, Some(f64::NAN), 1.0)];
        assert!(Timeline::new(nan, None).is_err());
    }

    /// 30 to 10 frames/s and back: every point occurs once, gaps are empty, nothing is repeated.
    #[test]
    fn resampling_keeps_every_point_once() {
        let mut frames: Vec<_> = (0..30)
            .map(|n| frame(n, None, 2.0 + n as f32 / 30.0))
            .collect();
        frames.drain(12..18);
        let line = Timeline::new(frames, Some(30.0)).unwrap();
        for frame_rate_hz in [10.0, 30.0, 47.0, 100.0] {
            let other = line.resample(frame_rate_hz, true).unwrap();
            let sum: usize = other.frames.iter().map(|f| f.points.len()).sum();
            assert_eq!(sum, 24, "{frame_rate_hz}");
            for (k, f) in other.frames.iter().enumerate() {
                assert_eq!(f.frame as usize, k);
                // All points recede at 1 m/s from 2 m: moved points are where the target is at the frame's time.
                for p in &f.points {
                    let target_m = 2.0 + f.time_s as f32;
                    assert!((p.y_m - target_m).abs() < 1e-5, "{} at {}", p.y_m, f.time_s);
                }
            }
        }
        let ten = line.resample(10.0, false).unwrap();
        let sizes: Vec<usize> = ten.frames.iter().map(|f| f.points.len()).collect();
        assert_eq!(sizes, [2, 3, 3, 3, 1, 0, 2, 3, 3, 3, 1]);
        assert!(line.resample(f64::NAN, false).is_err());
        assert!(matches!(
            line.resample(0.0, false),
            Err(TimelineError::Rate(_))
        ));
    }

    #[test]
    fn merged_frames_follow_their_points() {
        let frames: Vec<_> = (0..5)
            .map(|n| frame(n, None, 2.0 + n as f32 / 10.0))
            .collect();
        let line = Timeline::new(frames, Some(10.0)).unwrap();
        let merged = line.accumulate(3, true);
        let sizes: Vec<usize> = merged.frames.iter().map(|f| f.points.len()).collect();
        assert_eq!(sizes, [1, 2, 3, 3, 3]);
        assert!(
            merged.frames[4]
                .points
                .iter()
                .all(|p| (p.y_m - 2.4).abs() < 1e-5)
        );
        let still = line.accumulate(3, false);
        let nearest = still.frames[4]
            .points
            .iter()
            .map(|p| p.y_m)
            .fold(9.0, f32::min);
        assert!((nearest - 2.2).abs() < 1e-6);
        assert_eq!(line.accumulate(1, true), line);
    }
}
