//! Radar points: the output of the signal chain and the input of the tokenizer.

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

/// All points of one radar frame. It may be empty.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct PointFrame {
    /// Frame number, from 0.
    pub frame: u32,
    /// Time of the frame's first chirp, s.
    pub time_s: f64,
    /// Points, strongest first.
    pub points: Vec<RadarPoint>,
}

impl PointFrame {
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
    }
}
