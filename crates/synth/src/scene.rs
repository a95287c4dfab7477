//! Scene files: targets with known results, for checks against closed forms.

use std::path::Path;

use glam::{DQuat, DVec3, Vec3};
use radarllm_base::{
    Material, MovingSurface, RadarConfig, frames::Placement, materials::Substance,
};
use radarllm_body::{loaders::load_motion_file, mesh::BodyShape, sample::canonicalize};
use radarllm_radar_sim::{Noise, PointTarget, Scene, SimOptions, shapes::RigidSurface};
use serde::{Deserialize, Serialize};

use crate::{
    SynthError,
    config::BODY_FACET_EDGE_M,
    impairments::ImpairmentsFile,
    obj::read_obj,
    processing::ProcessingFile,
    room::{ROOM_RASTER, RoomFile, material},
    synthesizer::{builtin_shape, posed_builtin},
    weather::WeatherFile,
};

/// A scene as described in its TOML file.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneFile {
    /// Length of the scene, s.
    pub duration_s: f64,
    /// Targets in front of the radar.
    #[serde(default)]
    pub target: Vec<Target>,
    /// Receiver noise; the radar's own thermal noise if absent.
    #[serde(default)]
    pub noise: NoiseFile,
    /// Walls, floor and ceiling; free space if absent.
    pub room: Option<RoomFile>,
    /// Receiver impairments; none if absent.
    #[serde(default)]
    pub impairments: ImpairmentsFile,
    /// The signal chain.
    #[serde(default)]
    pub processing: ProcessingFile,
    /// Rain and smoke; clear air if absent.
    #[serde(default)]
    pub weather: WeatherFile,
    /// Maximum number of surfaces on a path, 1 to 4; 1 disables reflections between surfaces.
    #[serde(default = "default_bounces")]
    pub max_bounces: usize,
    /// Number of rays along each side of the field that contains mirrors. Fewer rays are faster and make the strengths
    /// of individual ghost points noisier.
    #[serde(default = "default_rays")]
    pub bounce_rays: usize,
}

fn default_rays() -> usize {
    SimOptions::default().bounce_rays
}

fn default_bounces() -> usize {
    3
}

/// One target.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Target {
    /// `point`, `sphere`, `plate`, `cylinder`, `box`, `dihedral`, `trihedral`, `mesh` or `motion`.
    pub kind: String,
    /// Centre in the radar frame, m. For corner reflectors this is the apex, for meshes their own origin, and for
    /// motions the position on the floor of the path's first pose.
    pub position_m: [f64; 3],
    /// Velocity, m/s.
    #[serde(default)]
    pub velocity_mps: [f64; 3],
    /// Direction that a plate or a corner's opening faces; towards the radar if absent.
    pub normal: Option<[f64; 3]>,
    /// Cross section of a point, m^2.
    pub rcs_m2: Option<f64>,
    /// Radius of a sphere or cylinder, m.
    pub radius_m: Option<f64>,
    /// Width and height of a plate or of a dihedral's wings, m. The second value is a cylinder's height;
    /// the first value is a trihedral's leg.
    pub size_m: Option<[f64; 2]>,
    /// Extent of a box along x, y, z, m.
    pub extent_m: Option<[f64; 3]>,
    /// Maximum facet edge length, m.
    pub facet_edge_m: Option<f64>,
    /// `metal` (the default), `clothed` (a dressed person) or another name of
    /// [`radarllm_base::materials::Substance`].
    pub material: Option<String>,
    /// Thickness of a thin wall that also transmits waves, m; the wall is opaque without this field and `loss_db`.
    /// Every facet that faces the radar is such a slab of `material`, at normal incidence.
    pub thickness_m: Option<f64>,
    /// One-way transmission loss, dB. It replaces the loss that follows from material and thickness.
    pub loss_db: Option<f64>,
    /// Motion file or builtin:NAME; for a mesh, its OBJ file.
    pub file: Option<String>,
}

/// The `[noise]` table of scenes and data sets; thermal noise of the radar's noise figure if it is absent.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct NoiseFile {
    /// No noise at all.
    pub none: bool,
    /// Signal-to-noise ratio, dB: the noise is this far below the mean power of the frame's samples (equation S2 of the
    /// RadarLLM paper).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub snr_db: Option<f64>,
    /// Noise figure that replaces the radar's own, dB.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub noise_figure_db: Option<f64>,
}

/// Permitted signal-to-noise ratios and noise figures, dB: far more than any radar has.
const NOISE_DB: std::ops::RangeInclusive<f64> = -100.0..=200.0;

impl NoiseFile {
    /// Checks that at most one kind of noise is named, and its value.
    ///
    /// # Errors
    /// What is wrong, with the key.
    pub fn check(&self) -> Result<(), String> {
        let kinds = [
            self.none,
            self.snr_db.is_some(),
            self.noise_figure_db.is_some(),
        ];
        if kinds.into_iter().filter(|set| *set).count() > 1 {
            return Err("[noise]: none, snr_db and noise_figure_db exclude one another".into());
        }
        for (key, value) in [
            ("snr_db", self.snr_db),
            ("noise_figure_db", self.noise_figure_db),
        ] {
            if let Some(value) = value.filter(|value| !NOISE_DB.contains(value)) {
                return Err(format!(
                    "[noise] {key}: must be in {NOISE_DB:?}, found {value}"
                ));
            }
        }
        Ok(())
    }

    /// The radar with the noise figure of the table, if specified.
    pub fn radar(&self, radar: &RadarConfig) -> RadarConfig {
        RadarConfig {
            noise_figure_db: self.noise_figure_db.unwrap_or(radar.noise_figure_db),
            ..radar.clone()
        }
    }

    /// The simulator's noise.
    pub fn resolve(&self) -> Noise {
        match (self.none, self.snr_db) {
            (true, _) => Noise::Off,
            (false, Some(snr_db)) => Noise::SnrDb(snr_db),
            (false, None) => Noise::Thermal,
        }
    }
}

/// Maximum duration of a scene, s.
const MAX_DURATION_S: f64 = 3600.0;
/// Maximum number of facets per target, so that an error in `facet_edge_m` does not exhaust the memory.
const MAX_FACETS: f64 = 2e6;
/// Maximum number of facets of a scene. A facet takes 190 bytes in the simulator, 450 with reflections between
/// surfaces, for a maximum of 5.4 GB (measured with 10 million facets: 1.9 and 4.5 GB, 5 and 19 s per frame on one
/// core).
const MAX_SCENE_FACETS: usize = 12_000_000;

impl SceneFile {
    /// Reads a scene.
    ///
    /// # Errors
    /// TOML errors with their position; values out of range with their name.
    pub fn from_toml(text: &str) -> Result<Self, SynthError> {
        let file: Self = toml::from_str(text).map_err(|e| SynthError::Config(e.to_string()))?;
        if !(file.duration_s > 0.0 && file.duration_s <= MAX_DURATION_S) {
            return Err(SynthError::Config(format!(
                "duration_s: must be in 0..={MAX_DURATION_S}, found {}",
                file.duration_s
            )));
        }
        file.impairments.resolve().map_err(SynthError::Config)?;
        file.weather.check().map_err(SynthError::Config)?;
        if file.room.is_some() && file.weather.rain_mm_per_h > 0.0 {
            return Err(SynthError::Config(
                "[weather] rain_mm_per_h and [room]: it does not rain indoors".into(),
            ));
        }
        file.noise.check().map_err(SynthError::Config)?;
        Ok(file)
    }

    /// The radar with the noise figure of `[noise]`, if specified.
    pub fn radar(&self, radar: &RadarConfig) -> RadarConfig {
        self.noise.radar(radar)
    }

    /// The simulator's options for this scene.
    pub fn sim_options(&self) -> SimOptions {
        SimOptions {
            max_bounces: self.max_bounces,
            bounce_rays: self.bounce_rays,
            weather: self.weather.resolve(),
            raster_size: match self.room {
                Some(_) => ROOM_RASTER,
                None => SimOptions::default().raster_size,
            },
            ..SimOptions::default()
        }
    }
}

/// A scene that owns its surfaces.
pub struct OwnedScene {
    /// Those of the targets, then the walls.
    surfaces: Vec<Box<dyn MovingSurface + Send>>,
    n_targets: usize,
    points: Vec<PointTarget>,
    noise: Noise,
}

impl OwnedScene {
    /// Opens the targets of a scene file for a radar of `frequency_hz`. Relative paths are resolved against `base`.
    ///
    /// # Errors
    /// Unknown kinds, missing or impossible values, with the target's number.
    pub fn open(file: &SceneFile, base: &Path, frequency_hz: f64) -> Result<Self, SynthError> {
        let mut scene = Self {
            surfaces: Vec::new(),
            n_targets: 0,
            points: Vec::new(),
            noise: file.noise.resolve(),
        };
        for (index, target) in file.target.iter().enumerate() {
            let fail = |problem| {
                SynthError::Config(format!(
                    "[[target]] number {} ({}): {problem}",
                    index + 1,
                    target.kind
                ))
            };
            scene.add(target, base, frequency_hz).map_err(fail)?;
            let n_facets = scene.scene().n_facets();
            if n_facets > MAX_SCENE_FACETS {
                return Err(fail(format!(
                    "{n_facets} facets in the scene so far, at most {MAX_SCENE_FACETS}"
                )));
            }
        }
        scene.n_targets = scene.surfaces.len();
        if let Some(room) = &file.room {
            for wall in room.walls(frequency_hz)? {
                scene.surfaces.push(Box::new(wall));
            }
        }
        Ok(scene)
    }

    /// Number of surfaces of targets, which come first; the others are the walls of the room.
    pub(crate) fn n_targets(&self) -> usize {
        self.n_targets
    }

    /// The scene in the simulator's form.
    pub fn scene(&self) -> Scene<'_> {
        Scene {
            surfaces: self
                .surfaces
                .iter()
                .map(|s| s.as_ref() as &dyn MovingSurface)
                .collect(),
            points: self.points.clone(),
            noise: self.noise,
        }
    }

    fn add(&mut self, target: &Target, base: &Path, frequency_hz: f64) -> Result<(), String> {
        let position = DVec3::from_array(target.position_m);
        let velocity = DVec3::from_array(target.velocity_mps);
        if !(position.is_finite() && velocity.is_finite()) {
            return Err("position_m and velocity_mps must be finite".into());
        }
        let is_surface = target.kind != "point" && target.kind != "motion";
        if !is_surface && (target.thickness_m.is_some() || target.loss_db.is_some()) {
            return Err("thickness_m and loss_db belong to surfaces".into());
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
            self.surfaces.push(Box::new(motion(target, base)?));
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
                RigidSurface::plate(width_m, height_m, edge_m).turned(facing(target)?)
            }
            "dihedral" => {
                let [width_m, height_m] = size(target)?;
                check(2.0 * width_m * height_m)?;
                RigidSurface::dihedral(width_m, height_m, edge_m).turned(facing(target)?)
            }
            "trihedral" => {
                let leg_m = size(target)?[0];
                check(1.5 * leg_m * leg_m)?;
                RigidSurface::trihedral(leg_m, edge_m).turned(facing(target)?)
            }
            "box" => {
                let extent = target.extent_m.ok_or("extent_m is missing")?;
                for value in extent {
                    positive("extent_m", Some(value))?;
                }
                let [x, y, z] = extent;
                check(2.0 * (x * y + y * z + z * x))?;
                RigidSurface::cuboid(DVec3::from_array(extent), edge_m)
            }
            "mesh" => {
                let file = target.file.as_deref().ok_or("file is missing")?;
                let left = MAX_SCENE_FACETS.saturating_sub(self.scene().n_facets());
                read_obj(&base.join(file), left)?
            }
            "cylinder" => {
                let radius_m = positive("radius_m", target.radius_m)?;
                let height_m = size(target)?[1];
                check(2.0 * std::f64::consts::PI * radius_m * (radius_m + height_m))?;
                RigidSurface::cylinder(radius_m, height_m, edge_m)
            }
            other => {
                return Err(format!(
                    "kind `{other}` is unknown; point, sphere, plate, cylinder, box, dihedral, \
                     trihedral, mesh and motion are known"
                ));
            }
        };
        let material = target_material(target, frequency_hz)?;
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

/// A target's material: opaque, or a slab that also transmits waves.
fn target_material(target: &Target, frequency_hz: f64) -> Result<Material, String> {
    let name = target.material.as_deref().unwrap_or("metal");
    let mut found = material(name, frequency_hz)?;
    if let Some(thickness_m) = target.thickness_m {
        if !(1e-6..=10.0).contains(&thickness_m) {
            return Err(format!(
                "thickness_m must be in 1e-6..=10, found {thickness_m}"
            ));
        }
        let substance = Substance::named(name)
            .ok_or_else(|| format!("thickness_m: material `{name}` has no permittivity"))?;
        found = substance.slab(frequency_hz, thickness_m);
    }
    if let Some(loss_db) = target.loss_db {
        if !(0.0..=300.0).contains(&loss_db) {
            return Err(format!("loss_db must be in 0..=300, found {loss_db}"));
        }
        found.power_transmission = 10_f64.powf(-0.1 * loss_db) as f32;
        let max = 1.0 - found.power_reflection;
        if found.power_transmission > max {
            return Err(format!(
                "loss_db: {name} reflects {:.3} of the power, so that {loss_db} dB cannot be all that \
                 is lost; at min {:.2} dB",
                found.power_reflection,
                -10.0 * max.log10()
            ));
        }
    }
    Ok(found)
}

/// Rotation from -y to the requested direction, or towards the radar.
fn facing(target: &Target) -> Result<DQuat, String> {
    let position = DVec3::from_array(target.position_m);
    let normal = target.normal.map_or(-position, DVec3::from_array);
    let normal = normal.try_normalize().ok_or("normal must not be zero")?;
    // Yaw, then pitch: a corner's edge remains upright, as on a tripod.
    let yaw = normal.x.atan2(-normal.y);
    let pitch = -normal.z.clamp(-1.0, 1.0).asin();
    Ok(DQuat::from_rotation_z(yaw) * DQuat::from_rotation_x(pitch))
}

fn motion(target: &Target, base: &Path) -> Result<radarllm_body::mesh::PosedBody, String> {
    let file = target.file.as_deref().ok_or("file is missing")?;
    let (motion, mut shape) = if file.starts_with("builtin:") {
        let rendered = radarllm_motions::parse(file)
            .map_err(|e| e.to_string())?
            .render(0);
        let shape = builtin_shape(&rendered);
        (rendered.motion, shape)
    } else {
        let mut loaded = load_motion_file(&base.join(file)).map_err(|e| e.to_string())?;
        canonicalize(&mut loaded.motion);
        (loaded.motion, BodyShape::default())
    };
    if let Some(edge_m) = target.facet_edge_m {
        shape.facet_edge_m = edge_m as f32;
        if !BODY_FACET_EDGE_M.contains(&shape.facet_edge_m) {
            return Err(format!(
                "facet_edge_m of a body must be in {BODY_FACET_EDGE_M:?}, found {edge_m}"
            ));
        }
    }
    let position = Vec3::from_array(target.position_m.map(|v| v as f32));
    // A scene's floor is at the target's own height; the radar is at the origin.
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
        let plate = "[[target]]\nkind = \"plate\"\nposition_m = [0.0, 3.0, 0.0]\n\
                     size_m = [1.0, 0.95]\nfacet_edge_m = 0.001\n";
        let many = format!("duration_s = 1.0\n{}", plate.repeat(7));
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
            (
                "duration_s = 1.0\n[weather]\nrain_mm_per_h = -3.0",
                "rain_mm_per_h",
            ),
            ("duration_s = 1.0\n[weather]\nhail = 1.0", "hail"),
            (
                "duration_s = 1.0\n[room]\n[weather]\nrain_mm_per_h = 3.0",
                "indoors",
            ),
            ("duration_s = 1.0\n[room]\nwalls = 1", "walls"),
            ("duration_s = 1.0\n[room]\nwalls = \"cheese\"", "cheese"),
            ("duration_s = 1.0\n[room]\nheight_m = 0.5", "height_m"),
            (
                "duration_s = 1.0\n[noise]\nnone = true\nsnr_db = 3.0",
                "exclude",
            ),
            (
                "duration_s = 1.0\n[[target]]\nkind = \"motion\"\nposition_m = [0.0, 3.0, -1.0]\nfile = \"builtin:walk\"\nfacet_edge_m = 0.5",
                "of a body",
            ),
            // Each of the seven is within the limit, but all of them together are not.
            (&many, "number 7"),
            (
                "duration_s = 1.0\n[[target]]\nkind = \"mesh\"\nposition_m = [0.0, 3.0, 0.0]\nfile = \"nowhere.obj\"",
                "nowhere.obj",
            ),
            (
                "duration_s = 1.0\n[[target]]\nkind = \"plate\"\nposition_m = [0.0, 3.0, 0.0]\nsize_m = [1.0, 1.0]\nloss_db = 3.0",
                "metal",
            ),
            (
                "duration_s = 1.0\n[[target]]\nkind = \"plate\"\nposition_m = [0.0, 3.0, 0.0]\nsize_m = [1.0, 1.0]\nmaterial = \"cloth\"\nloss_db = nan",
                "loss_db",
            ),
            (
                "duration_s = 1.0\n[[target]]\nkind = \"plate\"\nposition_m = [0.0, 3.0, 0.0]\nsize_m = [1.0, 1.0]\nmaterial = \"clothed\"\nthickness_m = 0.001",
                "clothed",
            ),
            (
                "duration_s = 1.0\n[[target]]\nkind = \"point\"\nposition_m = [0.0, 3.0, 0.0]\nrcs_m2 = 1.0\nthickness_m = 0.001",
                "surfaces",
            ),
        ] {
            let outcome = SceneFile::from_toml(text)
                .and_then(|f| OwnedScene::open(&f, Path::new(""), 79e9).map(|_| ()));
            let error = outcome.unwrap_err().to_string();
            assert!(error.contains(word), "`{error}` should name `{word}`");
        }
    }

    #[test]
    fn targets_become_surfaces_and_points() {
        let text = "duration_s = 1.0\n[[target]]\nkind = \"point\"\nposition_m = [0.0, 3.0, 0.0]\nrcs_m2 = 1.0\n\
                    [[target]]\nkind = \"plate\"\nposition_m = [0.0, 3.0, 0.0]\nsize_m = [0.1, 0.1]\n";
        let owned =
            OwnedScene::open(&SceneFile::from_toml(text).unwrap(), Path::new(""), 79e9).unwrap();
        let scene = owned.scene();
        assert_eq!((scene.surfaces.len(), scene.points.len()), (1, 1));
        assert_eq!(scene.noise, Noise::Thermal);
    }

    #[test]
    fn a_thin_wall_and_a_curtain_let_waves_through() {
        let of = |rest: &str| {
            let text = format!(
                "duration_s = 1.0\n[[target]]\nkind = \"plate\"\nposition_m = [0.0, 3.0, 0.0]\n\
                 size_m = [1.0, 1.0]\nfacet_edge_m = 0.1\n{rest}"
            );
            let file = SceneFile::from_toml(&text).unwrap();
            let owned = OwnedScene::open(&file, Path::new(""), 77e9).unwrap();
            owned.scene().surfaces[0].material()
        };
        assert_eq!(of("material = \"plaster\"").power_transmission, 0.0);
        let wall = of("material = \"plaster\"\nthickness_m = 0.0125");
        // 6.9 dB by the slab formula; materials.rs contains the manual calculation.
        let loss_db = -10.0 * wall.power_transmission.log10();
        assert!((loss_db - 6.86).abs() < 0.02, "{loss_db}");
        let curtain = of("material = \"cloth\"\nloss_db = 1.0");
        assert!((curtain.power_transmission - 0.794).abs() < 1e-3);
    }

    #[test]
    fn a_room_faces_inwards_and_a_mesh_keeps_its_triangles() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(
            dir.path().join("quad.obj"),
            "v -0.1 0 -0.1\nv 0.1 0 -0.1\nv 0.1 0 0.1\nv -0.1 0 0.1\nf 1 2 3 4\n",
        )
        .unwrap();
        let text = "duration_s = 1.0\n[room]\n[[target]]\nkind = \"mesh\"\nfile = \"quad.obj\"\n\
                    position_m = [0.0, 3.0, 0.0]\nmaterial = \"wood\"\n";
        let file = SceneFile::from_toml(text).unwrap();
        assert_eq!(file.sim_options().max_bounces, 3);
        let owned = OwnedScene::open(&file, dir.path(), 79e9).unwrap();
        let scene = owned.scene();
        assert_eq!(scene.surfaces.len(), 6);
        assert_eq!(scene.surfaces[0].triangles().len(), 2);
        for wall in &scene.surfaces[1..] {
            let mut at = vec![Vec3::ZERO; wall.n_vertices()];
            wall.positions_at(0.0, &mut at);
            for &[a, b, c] in wall.triangles() {
                let [a, b, c] = [a, b, c].map(|i| at[i as usize]);
                // The radar's position and the middle of the room are in front of every facet.
                let normal = (b - a).cross(c - a);
                assert!(normal.dot(Vec3::new(0.0, 3.0, 0.2) - a) > 0.0);
            }
        }
        // The other possible defects of a mesh are tested in `obj`.
        std::fs::write(dir.path().join("quad.obj"), "v 0 0 0\nv 0 0 nan\nf 1 1 1\n").unwrap();
        let error = OwnedScene::open(&file, dir.path(), 79e9)
            .map(|_| ())
            .unwrap_err();
        assert!(error.to_string().contains("quad.obj: line 2"), "{error}");
    }
}
