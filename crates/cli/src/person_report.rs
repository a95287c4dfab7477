//! Persons and ghosts as scripts read them.

use radarllm_base::PointFrame;
use radarllm_tracking::{Ghost, GhostPath, Person, Track};
use serde::Serialize;

/// A person.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct PersonReport {
    /// Number of the track, from 1.
    pub id: u32,
    /// Start of the first frame in which the person was seen, s.
    pub start_s: f64,
    /// Start of the last frame in which the person was seen, s.
    pub end_s: f64,
    /// Points over all frames.
    pub points: usize,
}

impl PersonReport {
    /// Of a track through these frames.
    pub(crate) fn of_track(track: &Track, frames: &[PointFrame]) -> Self {
        let (start_s, end_s) = track.span_s(frames);
        Self {
            id: track.id,
            start_s,
            end_s,
            points: track.n_points(),
        }
    }
}

impl From<&Person> for PersonReport {
    fn from(person: &Person) -> Self {
        Self {
            id: person.id,
            start_s: person.start_s,
            end_s: person.end_s,
            points: person.n_points,
        }
    }
}

/// A track that is a multipath reflection.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct GhostReport {
    /// Number of the track.
    pub id: u32,
    /// Number of the track that it reflects.
    pub of: u32,
    /// `one way` or `both ways` over the wall.
    pub path: &'static str,
    /// Direction of the wall, degrees to the right.
    pub wall_azimuth_deg: f64,
    /// Distance of the wall, m.
    pub wall_m: f64,
    /// Loss against the person after removing the effect of range, dB.
    pub loss_db: f64,
}

impl From<&Ghost> for GhostReport {
    fn from(ghost: &Ghost) -> Self {
        Self {
            id: ghost.id,
            of: ghost.of,
            path: match ghost.path {
                GhostPath::BothWays => "both ways",
                GhostPath::OneWay => "one way",
            },
            wall_azimuth_deg: ghost.wall_azimuth_rad.to_degrees(),
            wall_m: ghost.wall_m,
            loss_db: ghost.loss_db,
        }
    }
}

impl std::fmt::Display for GhostReport {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "track {} is a reflection of track {}: {} over a wall {:.1} m away at {:+.0} degrees, {:.0} dB weaker",
            self.id, self.of, self.path, self.wall_m, self.wall_azimuth_deg, self.loss_db
        )
    }
}
