//! The scene in front of the radar: surfaces, point targets, and receiver noise.

use glam::{DVec3, Vec3};
use radarllm_base::MovingSurface;

use crate::error::SimError;
use crate::visibility::SurfaceRange;

/// All objects in front of the radar during a frame. Radar frame: x right, y along the boresight, z up.
#[derive(Default)]
pub struct Scene<'a> {
    /// Triangle surfaces. They shadow one another, or attenuate if their material transmits waves.
    pub surfaces: Vec<&'a dyn MovingSurface>,
    /// Isotropic point targets. They neither cast shadows nor are shadowed.
    pub points: Vec<PointTarget>,
    /// Receiver noise.
    pub noise: Noise,
}

/// An isotropic point target of fixed radar cross section and constant velocity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointTarget {
    /// Position at time 0 of the scene's clock, which is not the start of the frame, m.
    pub position_m: DVec3,
    /// Velocity, m/s.
    pub velocity_mps: DVec3,
    /// Radar cross section, m^2.
    pub rcs_m2: f64,
}

impl PointTarget {
    /// Creates a static target.
    pub fn at(position_m: DVec3, rcs_m2: f64) -> Self {
        Self {
            position_m,
            velocity_mps: DVec3::ZERO,
            rcs_m2,
        }
    }

    /// Returns the position at `time_s`, m.
    pub fn position_at(&self, time_s: f64) -> DVec3 {
        self.position_m + self.velocity_mps * time_s
    }
}

/// Receiver noise: white, circular complex Gaussian.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Noise {
    /// Thermal noise of power k T0 B F, with B the sample rate and F the radar's noise figure.
    #[default]
    Thermal,
    /// Noise power this many dB below the mean signal power of the cube (the relative mode of the RadarLLM paper). An
    /// empty scene gets no noise.
    SnrDb(f64),
    /// No noise.
    Off,
}

/// Maximum distance of a position. Farther positions are rejected, because the range phase would lose its precision.
const FARTHEST_M: f32 = 1000.0;

impl Scene<'_> {
    /// Checks everything that does not depend on time: indices, materials, point targets, and noise.
    ///
    /// # Errors
    /// Returns an error for the first item that cannot be simulated.
    pub fn validate(&self) -> Result<(), SimError> {
        for (surface, shape) in self.surfaces.iter().enumerate() {
            let m = shape.material();
            for (field, value, max) in [
                ("power_reflection", m.power_reflection, 1.0),
                ("roughness_m", m.roughness_m, 1.0),
                ("rough_albedo", m.rough_albedo, 100.0),
                ("power_transmission", m.power_transmission, 1.0),
                // Tolerance for rounding in the case of a lossless slab.
                (
                    "power_reflection + power_transmission",
                    m.power_reflection + m.power_transmission,
                    1.0 + 1e-6,
                ),
            ] {
                if !(0.0..=max).contains(&value) {
                    return Err(SimError::Material {
                        surface,
                        field,
                        value,
                    });
                }
            }
            let n_vertices = shape.n_vertices();
            for (triangle, indices) in shape.triangles().iter().enumerate() {
                if let Some(&vertex) = indices.iter().find(|&&i| i as usize >= n_vertices) {
                    return Err(SimError::TriangleIndex {
                        surface,
                        triangle,
                        vertex,
                        n_vertices,
                    });
                }
            }
        }
        for (point, target) in self.points.iter().enumerate() {
            let near = |v: DVec3, max: f64| v.is_finite() && v.length() <= max;
            if !near(target.position_m, 1e6) {
                return Err(SimError::Point {
                    point,
                    field: "position_m",
                });
            }
            if !near(target.velocity_mps, 1e4) {
                return Err(SimError::Point {
                    point,
                    field: "velocity_mps",
                });
            }
            if !(0.0..=1e12).contains(&target.rcs_m2) {
                return Err(SimError::Point {
                    point,
                    field: "rcs_m2",
                });
            }
        }
        if let Noise::SnrDb(snr_db) = self.noise
            && !(-200.0..=200.0).contains(&snr_db)
        {
            return Err(SimError::Snr { snr_db });
        }
        let count = self
            .surfaces
            .iter()
            .map(|s| s.n_vertices().max(s.triangles().len()))
            .sum();
        let limit = 1 << 26;
        if count > limit {
            return Err(SimError::TooMany { count, limit });
        }
        Ok(())
    }

    /// Returns the number of triangles of all surfaces.
    pub fn n_facets(&self) -> usize {
        self.surfaces.iter().map(|s| s.triangles().len()).sum()
    }

    /// Writes the triangles of all surfaces with indices into [`Self::positions_at`].
    pub(crate) fn concatenate_triangles(&self, out: &mut Vec<[u32; 3]>) {
        out.clear();
        let mut first = 0;
        for shape in &self.surfaces {
            out.extend(shape.triangles().iter().map(|t| t.map(|i| i + first)));
            first += shape.n_vertices() as u32;
        }
    }

    /// Writes the facet and vertex ranges of all surfaces for the visibility raster.
    pub(crate) fn surface_ranges(&self, out: &mut Vec<SurfaceRange>) {
        out.clear();
        let (mut facet, mut vertex) = (0, 0);
        for shape in &self.surfaces {
            let facets = facet..facet + shape.triangles().len() as u32;
            let vertices = vertex..vertex + shape.n_vertices() as u32;
            (facet, vertex) = (facets.end, vertices.end);
            out.push(SurfaceRange {
                facets,
                vertices,
                power_transmission: shape.material().power_transmission,
            });
        }
    }

    /// [`Self::positions_at_times`] for one time.
    pub(crate) fn positions_at(
        &self,
        time_s: f64,
        array_centre: Vec3,
        min_range_m: f64,
        out: &mut Vec<Vec3>,
    ) -> Result<(), SimError> {
        let out = std::array::from_mut(out);
        self.positions_at_times([time_s], array_centre, min_range_m, out)
    }

    /// Writes the vertices of all surfaces, one surface after another, at each of `times_s`.
    ///
    /// # Errors
    /// Returns an error for a vertex that is NaN, infinite, beyond a kilometre, or nearer than `min_range_m` to
    /// `array_centre`.
    pub(crate) fn positions_at_times<const N: usize>(
        &self,
        times_s: [f64; N],
        array_centre: Vec3,
        min_range_m: f64,
        out: &mut [Vec<Vec3>; N],
    ) -> Result<(), SimError> {
        let n_vertices = self.surfaces.iter().map(|s| s.n_vertices()).sum();
        for out in out.iter_mut() {
            out.resize(n_vertices, Vec3::ZERO);
        }
        let mut first = 0;
        for (surface, shape) in self.surfaces.iter().enumerate() {
            let mine = first..first + shape.n_vertices();
            first = mine.end;
            let mut parts = out.each_mut().map(|out| &mut out[mine.clone()]);
            let mut n_different = N;
            if shape.is_still()
                && let Some((one, others)) = parts.split_first_mut()
            {
                shape.positions_at(times_s[0], one);
                for other in others {
                    other.copy_from_slice(one);
                }
                n_different = 1;
            } else {
                shape.positions_at_times(&times_s, &mut parts);
            }
            for (part, time_s) in parts.iter().zip(times_s).take(n_different) {
                check_positions(surface, part, time_s, array_centre, min_range_m)?;
            }
        }
        Ok(())
    }
}

/// Checks the positions of one surface at one time for [`Scene::positions_at_times`].
fn check_positions(
    surface: usize,
    part: &[Vec3],
    time_s: f64,
    array_centre: Vec3,
    min_range_m: f64,
) -> Result<(), SimError> {
    // Valid positions take a single pass without branches. An invalid vertex is searched for afterwards.
    let (mut nearest, mut farthest) = (f32::INFINITY, 0.0_f32);
    let mut not_finite = false;
    for p in part.iter() {
        let d2 = p.distance_squared(array_centre);
        nearest = nearest.min(d2);
        farthest = farthest.max(d2);
        not_finite |= d2.is_nan();
    }
    if not_finite || farthest > FARTHEST_M * FARTHEST_M {
        let bad = |p: &Vec3| {
            let d2 = p.distance_squared(array_centre);
            d2.is_nan() || d2 > FARTHEST_M * FARTHEST_M
        };
        let vertex = part.iter().position(bad).unwrap_or(0);
        let position = part[vertex].to_array();
        return Err(SimError::Position {
            surface,
            vertex,
            time_s,
            position,
        });
    }
    let range_m = f64::from(nearest.sqrt());
    if range_m < min_range_m {
        return Err(SimError::TooClose {
            what: "surface",
            index: surface,
            range_m,
            min_range_m,
            time_s,
        });
    }
    Ok(())
}
