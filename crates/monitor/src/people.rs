//! The people of a frame, as presence and falls look at them.

use radarllm_base::{BoardTrack, RadarPoint};

/// Number of a person who cannot be tracked: too few points a frame, which stay together over seconds. Tracks are numbered
/// from 1.
pub const UNTRACKED: u32 = 0;

/// A tracked person in one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct PersonFrame {
    /// Number of the track. New people have larger numbers than all before them.
    pub person: u32,
    /// Position, m, to the right of the radar and away from it.
    pub place_m: [f64; 2],
    /// The person's points; empty if the person is not detected in this frame.
    pub points: Vec<RadarPoint>,
    /// The track of the board, if the board tracks people.
    pub board: Option<BoardTrack>,
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A person with eight points at one height above a radar.
    pub fn person(person: u32, place_m: [f64; 2], z_m: f32) -> PersonFrame {
        let point = RadarPoint {
            x_m: place_m[0] as f32,
            y_m: place_m[1] as f32,
            z_m,
            ..RadarPoint::default()
        };
        PersonFrame {
            person,
            place_m,
            points: vec![point; 8],
            board: None,
        }
    }

    /// A person who is tracked but not detected.
    pub fn unseen(person: u32, place_m: [f64; 2]) -> PersonFrame {
        PersonFrame {
            person,
            place_m,
            points: Vec::new(),
            board: None,
        }
    }
}
