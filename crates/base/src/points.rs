//! Radar points: the output of the signal chain and the input of the tokenizer.

use crate::BoardReport;

/// One detected point in the radar frame.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct RadarPoint {
    /// Right of the radar, m.
    pub x_m: f32,
    /// Away from the radar, m.
    pub y_m: f32,
    /// Above the radar, m.
    pub z_m: f32,
    /// Distance to the radar, m.
    pub range_m: f32,
    /// Radial velocity, m/s, positive when receding.
    pub velocity_mps: f32,
    /// 10 log10 of the detection map at the point's cell, dB.
    pub intensity_db: f32,
}

/// Points nearer to the radar than this, m, are leakage from its transmitters to its receivers: they say nothing about the
/// room. In an empty room they are nearly all that firmware with a low threshold reports.
pub const LEAKAGE_M: f32 = 0.3;

impl RadarPoint {
    /// Whether the point is leakage ([`LEAKAGE_M`]).
    pub fn is_leakage(&self) -> bool {
        self.x_m.hypot(self.y_m).hypot(self.z_m) < LEAKAGE_M
    }
}

/// All points of one radar frame. It may be empty.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct PointFrame {
    /// Frame number, from 0.
    pub frame: u32,
    /// Time of the frame's first chirp, s.
    pub time_s: f64,
    /// Points, strongest first.
    pub points: Vec<RadarPoint>,
    /// What the firmware of the board states beside the points; `None` if it states nothing.
    pub board: Option<BoardReport>,
}

impl PointFrame {
    /// The same frame with other points.
    pub fn with_points(&self, points: Vec<RadarPoint>) -> Self {
        Self {
            frame: self.frame,
            time_s: self.time_s,
            points,
            board: self.board.clone(),
        }
    }

    /// Sorts the points by decreasing intensity, the order that every points file and model expects. Points of equal
    /// intensity keep their order.
    pub fn sort_by_intensity(&mut self) {
        self.points
            .sort_by(|a, b| b.intensity_db.total_cmp(&a.intensity_db));
    }

    /// Removes points whose radial speed is below a minimum, m/s.
    pub fn remove_slower_than(&mut self, min_speed_mps: f32) {
        self.points
            .retain(|p| p.velocity_mps.abs() >= min_speed_mps);
    }

    /// Mirrors the points across the radar's vertical plane (x to -x). Range and radial velocity do not change.
    ///
    /// In a sentence about the points, left and right, and clockwise and counterclockwise, must be exchanged.
    pub fn mirror(&mut self) {
        for point in &mut self.points {
            point.x_m = -point.x_m;
        }
        if let Some(board) = &mut self.board {
            board.mirror();
        }
    }
}
