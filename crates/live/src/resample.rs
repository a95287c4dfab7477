//! Frames of a fast radar are merged into the ten a second that the models read.
//!
//! It is the push form of [`radarllm::Timeline::resample`] without motion compensation. A radar that reports few points a
//! frame is tracked only after merging.

use radarllm::PointFrame;
use radarllm::inference::{FRAME_RATE_HZ, RATE_TOLERANCE};
use radarllm_monitor::pipeline::Arrival;
use radarllm_monitor::queue::QueuedFrame;

/// Rounding of times in frame periods: a frame in the middle between two is not placed by the rounding of its time.
const ROUNDING: f64 = 1e-6;

/// Merges frames, one after the other.
#[derive(Debug)]
pub(crate) struct Resampler {
    /// Time between two frames of the source, s.
    source_period_s: f64,
    period_s: f64,
    /// The frame that more frames of the source may belong to.
    open: Option<QueuedFrame>,
}

impl Resampler {
    /// Frames of a slow source stay as they are.
    pub(crate) fn new(source_period_s: f64) -> Self {
        let model_hz = f64::from(FRAME_RATE_HZ);
        let is_fast = 1.0 / source_period_s > model_hz * (1.0 + RATE_TOLERANCE);
        Self {
            source_period_s,
            period_s: if is_fast {
                1.0 / model_hz
            } else {
                source_period_s
            },
            open: None,
        }
    }

    /// Time between two merged frames, s.
    pub(crate) fn period_s(&self) -> f64 {
        self.period_s
    }

    /// The next frame of the source. Returns the frames that are complete: none while more of the source belong to one,
    /// two if the source skipped the end of one.
    pub(crate) fn push(&mut self, frame: PointFrame, arrival: Arrival) -> Vec<QueuedFrame> {
        if self.period_s == self.source_period_s {
            return vec![QueuedFrame {
                frame,
                arrival,
                n_merged: 1,
            }];
        }
        let number = self.merged_number(frame.frame);
        let is_last = self.merged_number(frame.frame.saturating_add(1)) != number;
        let mut complete = Vec::new();
        match &mut self.open {
            Some(open) if open.frame.frame == number => {
                open.frame.points.extend(frame.points);
                open.frame.board = frame.board.or(open.frame.board.take());
                open.arrival = arrival;
                open.n_merged += 1;
            }
            _ => {
                let merged = PointFrame {
                    frame: number,
                    time_s: f64::from(number) * self.period_s,
                    points: frame.points,
                    board: frame.board,
                };
                complete.extend(self.end());
                self.open = Some(QueuedFrame {
                    frame: merged,
                    arrival,
                    n_merged: 1,
                });
            }
        }
        if is_last {
            complete.extend(self.end());
        }
        complete
    }

    /// The last frame, when no more frames belong to it.
    pub(crate) fn end(&mut self) -> Option<QueuedFrame> {
        let mut queued = self.open.take()?;
        queued.frame.sort_by_intensity();
        Some(queued)
    }

    /// Number of the merged frame that a frame of the source belongs to: the nearest one, of two the later one.
    fn merged_number(&self, number: u32) -> u32 {
        let exact = f64::from(number) * self.source_period_s / self.period_s;
        (exact + ROUNDING).round() as u32
    }
}

#[cfg(test)]
mod tests {
    use radarllm::{RadarPoint, Timeline};

    use super::*;

    fn frame(number: u32) -> PointFrame {
        let point = RadarPoint {
            x_m: number as f32,
            ..RadarPoint::default()
        };
        PointFrame {
            frame: number,
            time_s: 0.0,
            points: vec![point; 2],
            board: None,
        }
    }

    fn merged(rate_hz: f64, numbers: &[u32]) -> Vec<PointFrame> {
        let mut resampler = Resampler::new(1.0 / rate_hz);
        let arrival = |n: u32| Arrival::At(i64::from(n));
        let mut out: Vec<QueuedFrame> = numbers
            .iter()
            .flat_map(|&n| resampler.push(frame(n), arrival(n)))
            .collect();
        out.extend(resampler.end());
        let is_counted = |merged: &QueuedFrame| {
            // Two points a frame of the source.
            merged.frame.points.len() == 2 * merged.n_merged as usize
        };
        assert!(out.iter().all(is_counted));
        out.into_iter().map(|merged| merged.frame).collect()
    }

    #[test]
    fn merged_frames_are_those_of_the_batch_form() {
        // Without every eleventh frame, and without the first of the last second.
        let numbers: Vec<u32> = (0..100).filter(|n| n % 11 != 4 && *n != 90).collect();
        for rate_hz in [30.0, 18.18, 15.0, 11.0] {
            let frames: Vec<PointFrame> = numbers
                .iter()
                .map(|&n| PointFrame {
                    time_s: f64::from(n) / rate_hz,
                    ..frame(n)
                })
                .collect();
            let batch = Timeline::from_frames(frames, rate_hz).resample(10.0, false);
            let mut batch = batch.unwrap().frames;
            batch.retain(|f| !f.points.is_empty());
            // Which frame of the source each point is from.
            let points = |frames: &[PointFrame]| -> Vec<(u32, Vec<f32>)> {
                let from = |f: &PointFrame| (f.frame, f.points.iter().map(|p| p.x_m).collect());
                frames.iter().map(from).collect()
            };
            let found = merged(rate_hz, &numbers);
            assert!(points(&found) == points(&batch), "{rate_hz} frames/s");
        }
    }

    #[test]
    fn twenty_frames_a_second_are_merged_in_pairs() {
        let numbers: Vec<u32> = (1..2_001).collect();
        let merged = merged(20.0, &numbers);
        assert_eq!(merged.len(), 1_000);
        assert!(merged.iter().all(|f| f.points.len() == 4));
    }

    #[test]
    fn a_frame_is_complete_as_soon_as_no_other_can_belong_to_it() {
        let mut resampler = Resampler::new(1.0 / 30.0);
        assert_eq!(resampler.period_s(), 0.1);
        let n_complete: Vec<usize> = (0..8)
            .map(|n| resampler.push(frame(n), Arrival::At(0)).len())
            .collect();
        assert_eq!(n_complete, [0, 1, 0, 0, 1, 0, 0, 1]);
        // Frame 10 is lost, which would have completed the frame of 9.
        assert!(resampler.push(frame(9), Arrival::At(1)).is_empty());
        let complete = resampler.push(frame(13), Arrival::At(2));
        let found: Vec<(u32, Arrival, u32)> = complete
            .iter()
            .map(|merged| (merged.frame.frame, merged.arrival, merged.n_merged))
            .collect();
        assert_eq!(found, [(3, Arrival::At(1), 1), (4, Arrival::At(2), 1)]);
    }

    #[test]
    fn frames_of_a_slow_radar_stay() {
        assert_eq!(merged(10.2, &[0, 1, 5]), [0, 1, 5].map(frame));
        assert_eq!(Resampler::new(0.2).period_s(), 0.2);
    }

    #[test]
    fn numbers_that_begin_again_end_the_open_frame() {
        let numbers: Vec<u32> = merged(30.0, &[30, 0]).iter().map(|f| f.frame).collect();
        assert_eq!(numbers, [10, 0]);
        let _ = merged(1e6, &[u32::MAX, 0]);
    }
}
