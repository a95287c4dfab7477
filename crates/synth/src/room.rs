//! The `[room]` table of scenes and data sets.

use glam::{DQuat, DVec3};
use radarllm_base::{Material, materials::Substance};
use radarllm_radar_sim::shapes::RigidSurface;
use serde::{Deserialize, Serialize};

use crate::SynthError;

/// The `[room]` table: a box around the radar, open behind it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RoomFile {
    /// Distance of the left wall from the radar, m.
    pub left_m: f64,
    /// Distance of the right wall, m.
    pub right_m: f64,
    /// Distance of the far wall, m.
    pub depth_m: f64,
    /// Height of the radar above the floor, m.
    pub radar_height_m: f64,
    /// Height of the ceiling above the floor, m.
    pub height_m: f64,
    /// Material of the walls and the ceiling.
    pub walls: String,
    /// Material of the floor.
    pub floor: String,
    /// Minimum facet edge length, around the foot of each perpendicular from the radar, m.
    pub facet_edge_m: f64,
}

impl Default for RoomFile {
    fn default() -> Self {
        Self {
            left_m: 2.5,
            right_m: 2.5,
            depth_m: 6.0,
            radar_height_m: 1.0,
            height_m: 2.5,
            walls: "plaster".into(),
            floor: "wood".into(),
            facet_edge_m: 0.02,
        }
    }
}

impl RoomFile {
    /// Left, right and far wall, floor and ceiling, facing inwards, for a radar of `frequency_hz`.
    ///
    /// # Errors
    /// The first value that is out of range, by name.
    pub fn walls(&self, frequency_hz: f64) -> Result<Vec<RigidSurface>, SynthError> {
        walls(self, frequency_hz)
            .map_err(|problem| SynthError::Config(format!("[room]: {problem}")))
    }
}

fn walls(room: &RoomFile, frequency_hz: f64) -> Result<Vec<RigidSurface>, String> {
    for (name, value) in [
        ("left_m", room.left_m),
        ("right_m", room.right_m),
        ("depth_m", room.depth_m),
        ("radar_height_m", room.radar_height_m),
        ("height_m", room.height_m),
    ] {
        if !(0.1..=100.0).contains(&value) {
            return Err(format!("{name}: must be in 0.1..=100, found {value}"));
        }
    }
    if room.height_m <= room.radar_height_m + 0.1 {
        return Err("height_m: the ceiling must be above the radar".into());
    }
    if !(0.005..=1.0).contains(&room.facet_edge_m) {
        return Err(format!(
            "facet_edge_m: must be in 0.005..=1, found {}",
            room.facet_edge_m
        ));
    }
    let (wall, floor) = (
        material(&room.walls, frequency_hz)?,
        material(&room.floor, frequency_hz)?,
    );
    let (down, up) = (-room.radar_height_m, room.height_m - room.radar_height_m);
    let (across, along) = ([-room.left_m, room.right_m], [0.0, room.depth_m]);
    let back = [-room.depth_m, 0.0];
    // Each is a plate facing -y around the foot of the radar's perpendicular, turned and shifted.
    let plate = |x, z, turn: DQuat, at: DVec3, material| {
        RigidSurface::graded_plate(x, z, [0.0, 0.0], room.facet_edge_m)
            .turned(turn)
            .at(at)
            .of(material)
    };
    let quarter = std::f64::consts::FRAC_PI_2;
    Ok(vec![
        plate(
            along,
            [down, up],
            DQuat::from_rotation_z(quarter),
            DVec3::X * -room.left_m,
            wall,
        ),
        plate(
            back,
            [down, up],
            DQuat::from_rotation_z(-quarter),
            DVec3::X * room.right_m,
            wall,
        ),
        plate(
            across,
            [down, up],
            DQuat::IDENTITY,
            DVec3::Y * room.depth_m,
            wall,
        ),
        plate(
            across,
            along,
            DQuat::from_rotation_x(-quarter),
            DVec3::Z * down,
            floor,
        ),
        plate(
            across,
            back,
            DQuat::from_rotation_x(quarter),
            DVec3::Z * up,
            wall,
        ),
    ])
}

/// Side of the depth raster for a scene with walls, samples. The cube's error falls from -14 dB at 320 to
/// -20 dB, at a cost of 3 ms of the 250 to 500 ms per frame (`bench_visibility`).
pub(crate) const ROOM_RASTER: usize = 640;

/// A scene material by name, for a radar of `frequency_hz`.
pub(crate) fn material(name: &str, frequency_hz: f64) -> Result<Material, String> {
    if name == "clothed" {
        return Ok(radarllm_body::mesh::clothed_skin());
    }
    let substance = Substance::named(name).ok_or_else(|| {
        let known: Vec<&str> = Substance::ALL.iter().map(|s| s.name()).collect();
        format!(
            "material `{name}` is unknown; clothed, {} are known",
            known.join(", ")
        )
    })?;
    Ok(substance.material(frequency_hz))
}
