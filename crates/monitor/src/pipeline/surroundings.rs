//! Static clutter of a running radar: what stands still is removed while it is most of what the radar reports,
//! and while the radar reports the coupling between its antennas.
//!
//! A recording is judged as a whole ([`radarllm_base::static_cells`]). A stream is judged by its last minute: static
//! points are removed from when they are more than half of all points until they are fewer than three tenths. The cells
//! are found anew every 2 s. Nothing is removed in the first 2 s.

use std::collections::VecDeque;

use radarllm_base::{Clutter, PointFrame, RadarPoint, static_cells::StaticCells};

/// Time over which the room is judged, s.
const JUDGED_S: f64 = 60.0;
/// Time before the first judgement, s.
const FIRST_S: f64 = 2.0;
/// Time between two judgements, s.
const EVERY_S: f64 = 2.0;
/// Share of static points above which they are removed.
const ON: f64 = 0.5;
/// Share of static points below which all points are kept again.
const OFF: f64 = 0.3;
/// Most points that are judged, so that memory is bounded: 5 MB.
const MAX_POINTS: usize = 200_000;

/// The static points of the last minute.
#[derive(Debug)]
pub struct Surroundings {
    is_checked: bool,
    frames: VecDeque<PointFrame>,
    n_points: usize,
    cells: StaticCells,
    is_removing: bool,
    first_s: Option<f64>,
    judged_s: f64,
}

impl Surroundings {
    /// Nothing is known yet. Points whose clutter is settled are never removed.
    pub fn new(clutter: Clutter) -> Self {
        Self {
            is_checked: clutter == Clutter::Unchecked,
            frames: VecDeque::new(),
            n_points: 0,
            cells: StaticCells::default(),
            is_removing: false,
            first_s: None,
            judged_s: f64::NEG_INFINITY,
        }
    }

    /// Whether static points are removed at present.
    pub fn is_removing(&self) -> bool {
        self.is_removing
    }

    /// Whether a point is static.
    pub fn is_static(&self, point: &RadarPoint) -> bool {
        self.cells.is_static(point)
    }

    /// Removes the static points of the next frame, if they are clutter. Returns whether this has just begun, so that
    /// frames before it still have theirs.
    pub fn clean(&mut self, frame: &mut PointFrame) -> bool {
        if !self.is_checked {
            return false;
        }
        let was_removing = self.is_removing;
        let t_s = frame.time_s;
        self.remember(frame.clone());
        let first_s = *self.first_s.get_or_insert(t_s);
        if t_s - first_s >= FIRST_S && t_s - self.judged_s >= EVERY_S {
            self.judge(t_s);
        }
        if self.is_removing {
            frame.points.retain(|p| !self.cells.is_static(p));
        }
        self.is_removing && !was_removing
    }

    fn remember(&mut self, frame: PointFrame) {
        let oldest_s = frame.time_s - JUDGED_S;
        self.n_points += frame.points.len();
        self.frames.push_back(frame);
        let is_old = |f: &PointFrame| f.time_s < oldest_s;
        while self.frames.front().is_some_and(is_old)
            || (self.n_points > MAX_POINTS && self.frames.len() > 1)
        {
            let gone = self.frames.pop_front();
            self.n_points -= gone.map_or(0, |f| f.points.len());
        }
    }

    fn judge(&mut self, t_s: f64) {
        self.judged_s = t_s;
        let frames = self.frames.make_contiguous();
        self.cells = StaticCells::of(frames);
        let points = frames.iter().flat_map(|f| &f.points);
        let n_static = points.filter(|p| self.cells.is_static(p)).count();
        let share = n_static as f64 / self.n_points.max(1) as f64;
        let min = if self.is_removing { OFF } else { ON };
        self.is_removing = share > min || self.cells.reports_coupling();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A frame with a chair, which does not move, and somebody who does.
    fn frame(n: u32, n_static: usize, n_moving: usize) -> PointFrame {
        let point = |x_m: f32, velocity_mps: f32| RadarPoint {
            x_m,
            y_m: 2.0,
            velocity_mps,
            ..RadarPoint::default()
        };
        let mut points = vec![point(1.0, 0.0); n_static];
        points.extend(vec![point(-1.0, 0.8); n_moving]);
        PointFrame {
            frame: n,
            time_s: f64::from(n) / 10.0,
            points,
            board: None,
        }
    }

    fn kept(surroundings: &mut Surroundings, n: u32, n_static: usize) -> usize {
        let mut frame = frame(n, n_static, 4);
        surroundings.clean(&mut frame);
        frame.points.len()
    }

    #[test]
    fn static_points_are_removed_while_they_are_most_points() {
        let mut surroundings = Surroundings::new(Clutter::Unchecked);
        for n in 0..20 {
            assert_eq!(kept(&mut surroundings, n, 8), 12, "{n}");
        }
        assert!(surroundings.clean(&mut frame(20, 8, 4)));
        for n in 21..700 {
            assert_eq!(kept(&mut surroundings, n, 8), 4, "{n}");
        }
        // Three of seven points: fewer than one half, more than three tenths.
        for n in 700..1_400 {
            assert_eq!(kept(&mut surroundings, n, 3), 4, "{n}");
        }
        // One of five: the minute forgets the chair.
        for n in 1_400..2_100 {
            kept(&mut surroundings, n, 1);
        }
        assert!(!surroundings.is_removing());
        assert_eq!(kept(&mut surroundings, 2_100, 1), 5);
    }

    #[test]
    fn settled_points_are_kept_and_memory_is_bounded() {
        let mut settled = Surroundings::new(Clutter::Settled);
        assert!((0..300).all(|n| kept(&mut settled, n, 8) == 12));
        let mut many = Surroundings::new(Clutter::Unchecked);
        for n in 0..100 {
            let mut frame = frame(n, 10_000, 0);
            many.clean(&mut frame);
        }
        assert!(many.n_points <= MAX_POINTS && many.frames.len() == 20);
    }
}
