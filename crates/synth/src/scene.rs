//! Scene files: targets with known answers, for checks against closed forms.

use std::path::Path;

use glam::{DQuat, DVec3, Vec3};
use radarllm_base::{Material, MovingSurface, frames::Placement};
use radarllm_body::{loaders::load_motion_file, mesh::BodyShape, procedural, sample::canonicalize};
use radarllm_radar_sim::{Noise, PointTarget, Scene, shapes::RigidSurface};
use serde::Deserialize;

use crate::{
    SynthError,
    synthesizer::{builtin_shape, posed_builtin},
};

/// A scene as its TOML says it.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneFile {
    /// Length of the scene, s.
    pub duration_s: f64,
    /// Things in front of the radar.
    #[serde(default)]
    pub target: Vec<Target>,
    /// Receiver noise; the radar's own thermal noise without it.
    #[serde(default)]
    pub noise: NoiseFile,
    /// Room; not supported yet and refused.
    #[serde(default)]
    pub room: Option<toml::Table>,
}

/// One target.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Target {
    /// `point`, `sphere`, `plate`, `cylinder` or `motion`.
    pub kind: String,
    /// Centre in the radar frame, m; for motions the place on the floor where the path's first pose stands.
    pub position_m: [f64; 3],
    /// Velocity, m/s.
    #[serde(default)]
    pub velocity_mps: [f64; 3],
    /// Direction a plate faces; towards the radar without it.
    pub normal: Option<[f64; 3]>,
    /// Cross section of a point, m^2.
    pub rcs_m2: Option<f64>,
    /// Radius of a sphere or cylinder, m.
    pub radius_m: Option<f64>,
    /// Width and height of a plate; the second one is a cylinder's height, m.
    pub size_m: Option<[f64; 2]>,
    /// Longest facet edge, m.
    pub facet_edge_m: Option<f64>,
    /// `metal` (the default) or `skin`.
    pub material: Option<String>,
    /// Motion file or builtin:NAME.
    pub file: Option<String>,
}

/// The `[noise]` table.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NoiseFile {
    /// No noise at all.
    #[serde(default)]
    pub none: bool,
    /// Noise this far below the signal, dB.
    pub snr_db: Option<f64>,
}

/// Longest scene, s.
const MAX_DURATION_S: f64 = 3600.0;
/// Most facets per target: a slip in `facet_edge_m` must not fill the memory.
const MAX_FACETS: f64 = 2e6;

impl SceneFile {
    /// Reads a scene.
    ///
    /// # Errors
    /// TOML errors with their place; values out of range with their name.
    pub fn from_toml(text: &str) -> Result<Self, SynthError> {
        let file: Self = toml::from_str(text).map_err(|e| SynthError::Config(e.to_string()))?;
        if !(file.duration_s > 0.0 && file.duration_s <= MAX_DURATION_S) {
            return Err(SynthError::Config(format!(
                "duration_s: must be in 0..={MAX_DURATION_S}, found {}",
                file.duration_s
            )));
        }
        if file.room.is_some() {
            return Err(SynthError::Config(
                "[room]: not supported yet; a scene without it is free space".into(),
            ));
        }
        Ok(file)
    }
}

/// A scene that owns its surfaces.
pub struct OwnedScene {
    surfaces: Vec<Box<dyn MovingSurface>>,
    points: Vec<PointTarget>,
    noise: Noise,
}

impl OwnedScene {
    /// Makes the targets of a scene file.
    ///
    /// # Errors
    /// Unknown kinds, missing or impossible values, with the target's number.
    pub fn open(file: &SceneFile) -> Result<Self, SynthError> {
        let noise = match (file.noise.none, file.noise.snr_db) {
            (true, _) => Noise::Off,
            (false, Some(snr_db)) => Noise::SnrDb(snr_db),
            (false, None) => Noise::Thermal,
        };
        let mut scene = Self {
            surfaces: Vec::new(),
            points: Vec::new(),
            noise,
        };
        for (index, target) in file.target.iter().enumerate() {
            scene.add(target).map_err(|problem| {
                SynthError::Config(format!(
                    "[[target]] number {} ({}): {problem}",
                    index + 1,
                    target.kind
                ))
            })?;
        }
        Ok(scene)
    }

    /// What the simulator takes.
    pub fn scene(&self) -> Scene<'_> {
        Scene {
            surfaces: self.surfaces.iter().map(AsRef::as_ref).collect(),
            points: self.points.clone(),
            noise: self.noise,
        }
    }

    fn add(&mut self, target: &Target) -> Result<(), String> {
        let position = DVec3::from_array(target.position_m);
        let velocity = DVec3::from_array(target.velocity_mps);
        if !(position.is_finite() && velocity.is_finite()) {
            return Err("position_m and velocity_mps must be finite".into());
        }
        if target.kind == "point" {
            let rcs_m2 = positive("rcs_m2", target.rcs_m2)?;
            self.points.push(PointTarget {
                position_m: position,
                velocity_mps: velocity,
                rcs_m2,
            });
            return Ok(());
        }
        if target.kind == "motion" {
            self.surfaces.push(Box::new(motion(target)?));
            return Ok(());
        }
        let edge_m = target
            .facet_edge_m
            .map_or(Ok(0.01), |e| positive("facet_edge_m", Some(e)))?;
        let check = |area_m2: f64| match area_m2 / (edge_m * edge_m) {
            n if n <= MAX_FACETS => Ok(()),
            n => Err(format!(
                "{n:.0} facets: facet_edge_m is too small for this size"
            )),
        };
        let mesh = match target.kind.as_str() {
            "sphere" => {
                let radius_m = positive("radius_m", target.radius_m)?;
                check(4.0 * std::f64::consts::PI * radius_m * radius_m)?;
                RigidSurface::sphere(radius_m, edge_m)
            }
            "plate" => {
                let [width_m, height_m] = size(target)?;
                check(width_m * height_m)?;
                let normal = target.normal.map_or(-position, DVec3::from_array);
                let normal = normal.try_normalize().ok_or("normal must not be zero")?;
                // The mesh faces -y; turn that onto the asked direction.
                RigidSurface::plate(width_m, height_m, edge_m)
                    .turned(DQuat::from_rotation_arc(-DVec3::Y, normal))
            }
            "cylinder" => {
                let radius_m = positive("radius_m", target.radius_m)?;
                let height_m = size(target)?[1];
                check(2.0 * std::f64::consts::PI * radius_m * (radius_m + height_m))?;
                RigidSurface::cylinder(radius_m, height_m, edge_m)
            }
            other => {
                return Err(format!(
                    "kind `{other}` is not supported yet; point, sphere, plate, cylinder and motion are"
                ));
            }
        };
        let material = material(target.material.as_deref())?;
        self.surfaces
            .push(Box::new(mesh.at(position).moving(velocity).of(material)));
        Ok(())
    }
}

fn positive(name: &str, value: Option<f64>) -> Result<f64, String> {
    match value {
        Some(v) if v.is_finite() && v > 0.0 => Ok(v),
        Some(v) => Err(format!("{name} must be finite and positive, found {v}")),
        None => Err(format!("{name} is missing")),
    }
}

fn size(target: &Target) -> Result<[f64; 2], String> {
    let [a, b] = target.size_m.ok_or("size_m is missing")?;
    Ok([
        positive("size_m[0]", Some(a))?,
        positive("size_m[1]", Some(b))?,
    ])
}

fn material(name: Option<&str>) -> Result<Material, String> {
    match name {
        None | Some("metal") => Ok(Material::PEC),
        Some("skin") => Ok(radarllm_body::mesh::clothed_skin()),
        Some(other) => Err(format!("material `{other}` is unknown; metal and skin are")),
    }
}

fn motion(target: &Target) -> Result<radarllm_body::mesh::PosedBody, String> {
    let file = target.file.as_deref().ok_or("file is missing")?;
    let (motion, shape) = if file.starts_with("builtin:") {
        let rendered = procedural::parse(file)
            .map_err(|e| e.to_string())?
            .render(0);
        let shape = builtin_shape(&rendered);
        (rendered.motion, shape)
    } else {
        let mut loaded = load_motion_file(Path::new(file)).map_err(|e| e.to_string())?;
        canonicalize(&mut loaded.motion);
        (loaded.motion, BodyShape::default())
    };
    let position = Vec3::from_array(target.position_m.map(|v| v as f32));
    // A scene's floor lies at the target's own height; the radar is at the origin.
    let placement = Placement {
        position_m: [position.x, position.y],
        heading_rad: 0.0,
        radar_height_m: -position.z,
    };
    posed_builtin(&motion, shape, placement).map_err(|e| e.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slips_in_scenes_are_named() {
        for (text, word) in [
            ("duration_s = -1.0", "duration_s"),
            (
                "duration_s = 1.0\n[[target]]\nkind = \"point\"\nposition_m = [0.0, 3.0, 0.0]",
                "rcs_m2",
            ),
            (
                "duration_s = 1.0\n[[target]]\nkind = \"cube\"\nposition_m = [0.0, 3.0, 0.0]",
                "cube",
            ),
            (
                "duration_s = 1.0\n[[target]]\nkind = \"sphere\"\nposition_m = [0.0, 3.0, 0.0]\nradius_m = 1.0\nfacet_edge_m = 1e-6",
                "facet_edge_m",
            ),
            ("duration_s = 1.0\n[room]\nwalls = 1", "room"),
        ] {
            let outcome = SceneFile::from_toml(text).and_then(|f| OwnedScene::open(&f).map(|_| ()));
            let error = outcome.unwrap_err().to_string();
            assert!(error.contains(word), "`{error}` should name `{word}`");
        }
    }

    #[test]
    fn targets_become_surfaces_and_points() {
        let text = "duration_s = 1.0\n[[target]]\nkind = \"point\"\nposition_m = [0.0, 3.0, 0.0]\nrcs_m2 = 1.0\n\
                    [[target]]\nkind = \"plate\"\nposition_m = [0.0, 3.0, 0.0]\nsize_m = [0.1, 0.1]\n";
        let owned = OwnedScene::open(&SceneFile::from_toml(text).unwrap()).unwrap();
        let scene = owned.scene();
        assert_eq!((scene.surfaces.len(), scene.points.len()), (1, 1));
        assert_eq!(scene.noise, Noise::Thermal);
    }
}
