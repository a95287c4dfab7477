//! What the firmware of a board states beside its points.

/// A person or object that the firmware of a board tracks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoardTrack {
    /// Number of the track. Firmware reuses the numbers of tracks that ended.
    pub id: u32,
    /// Place on the floor, m: right of the radar, away from the radar.
    pub place_m: [f32; 2],
    /// Height above the radar, m; `None` from firmware that tracks in a plane.
    pub height_m: Option<f32>,
    /// Velocity, m/s: to the right, away from the radar, upward (0 without a height).
    pub velocity_mps: [f32; 3],
}

/// What the firmware of a board states about a frame. A frame without tracks, in which the firmware tracks nobody, differs
/// from a frame without a report, of which nothing is known.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BoardReport {
    /// Tracks, in the firmware's order.
    pub tracks: Vec<BoardTrack>,
    /// Whether the firmware detects somebody in its presence zones, if it states that.
    pub is_present: Option<bool>,
}

impl BoardReport {
    /// Keeps only tracks whose values are finite.
    pub fn retain_finite(&mut self) {
        self.tracks.retain(|track| {
            let height = track.height_m.iter();
            let values = track
                .place_m
                .iter()
                .chain(&track.velocity_mps)
                .chain(height);
            values.into_iter().all(|value| value.is_finite())
        });
    }

    /// Mirrors the tracks across the radar's vertical plane (x to -x).
    pub fn mirror(&mut self) {
        for track in &mut self.tracks {
            track.place_m[0] = -track.place_m[0];
            track.velocity_mps[0] = -track.velocity_mps[0];
        }
    }
}
