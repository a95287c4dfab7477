//! Multipath over several surfaces: mirror reflections between the antennas and the scattering facet.
//!
//! Shooting and bouncing rays (Ling, Chou and Lee, IEEE T-AP 1989) determine which facets are illuminated via which
//! mirrors at the middle of a segment. Each such path is then followed in time by the image method: the scattering
//! facet is reflected through the planes of its mirrors, and its image replaces it for the transmitter. The phases,
//! Doppler shifts and arrival angles of ghost targets are therefore exact for flat mirrors in any motion.
//!
//! A mirror reflects with the coefficient -Gamma, reduced by its roughness. The last facet scatters by physical optics,
//! with the mean of the cosines of incidence and exit, and by its rough term. A rough facet also scatters along two
//! more paths: directly from the transmitter and back over the mirrors, and over the mirrors both ways. The rays that
//! end at the last facet do not include these. Polarisation is not modelled.

use std::collections::{BTreeMap, HashMap};

use glam::{DVec3, Vec3, Vec3A};
use obvhs::{
    BvhBuildParams, bvh2::Bvh2, bvh2::builder::build_bvh2, ray::Ray, ray::RayHit,
    triangle::Triangle,
};

use num_complex::Complex32;

use crate::link::Link;
use crate::scatter::{FacetPhases, Reflection};
use crate::scene::Scene;
use crate::simulator::SimOptions;
use crate::visibility::ScreenTransmission;

/// Maximum number of mirrors in a path.
pub(crate) const MAX_MIRRORS: usize = 3;
/// Marks an unused entry in a chain of mirrors.
const NO_FACET: u32 = u32::MAX;
/// Minimum amplitude (-16 dB) after all mirrors of a ray; weaker rays end. A ray continues after one plaster wall (-12
/// dB). It ends after two of them, and after a clothed body unless the incidence is grazing.
const MIN_GAIN: f32 = 0.15;
/// Distance from a facet at which its reflected ray starts, m.
const CLEARANCE_M: f32 = 1e-4;
/// Tolerance for facets of one surface to share a mirror plane: in normals (unitless) and offsets (m).
const SAME_PLANE: f32 = 1e-4;

/// The legs of the path that go over the mirrors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Legs {
    /// Transmitter leg over the mirrors, receiver leg direct. Coherent and rough terms.
    Out,
    /// Transmitter leg direct, receiver leg over the mirrors. Rough term only.
    Back,
    /// Both legs over the mirrors. Rough term only.
    Both,
}

/// A facet that is illuminated via mirrors.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bounce {
    /// Facets whose planes act as mirrors, starting at the array. Entries after the last mirror are [`NO_FACET`].
    mirrors: [u32; MAX_MIRRORS],
    /// The scattering facet.
    pub facet: u32,
    /// Illuminated area divided by the facet's area.
    pub share: f32,
    /// Amplitude factor of the screens along the path.
    passed: f32,
    /// The legs that go over the mirrors.
    pub legs: Legs,
}

/// The state of a bounce at one instant.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BounceState {
    /// Apparent position of the scattering point for the transmitters, relative to the array centre, m.
    pub seen_by_tx: DVec3,
    /// Apparent position of the scattering point for the receivers, relative to the array centre, m.
    pub seen_by_rx: DVec3,
    /// Two-way path lengths via the three corners minus the one via the centroid, m.
    pub corner_path_m: [f64; 3],
    /// Gain of the physical-optics term, sqrt(W).
    pub coherent: f32,
    /// Gain of the constant-phase term, sqrt(W).
    pub rough: f32,
}

/// Input of the ray tracer; see [`BouncingSurfaces`].
struct TraceJob<'a> {
    /// Vertices relative to the radar's origin, m.
    positions: &'a [Vec3],
    triangles: &'a [[u32; 3]],
    /// First facet and reflection properties of each surface, in order.
    surfaces: &'a [(usize, Reflection)],
    /// Directly visible share of every facet.
    coverage: &'a [f32],
    /// Direct two-way amplitude factor of the screens.
    transmission: &'a ScreenTransmission,
    centre: Vec3,
    /// Maximum number of surfaces on a path, including the scattering one; at least 2.
    max_bounces: usize,
    /// Number of rays along each side of the mirrors' bounding box.
    rays: usize,
}

impl TraceJob<'_> {
    fn reflection(&self, facet: u32) -> &Reflection {
        let after = self.surfaces.partition_point(|s| s.0 <= facet as usize);
        &self.surfaces[after - 1].1
    }

    fn corners(&self, facet: u32) -> [Vec3; 3] {
        self.triangles[facet as usize].map(|i| self.positions[i as usize])
    }

    /// Unit normal and twice the area; zero for a degenerate facet.
    fn normal(&self, facet: u32) -> (Vec3, f32) {
        let [a, b, c] = self.corners(facet);
        let cross = (b - a).cross(c - a);
        let length = cross.length();
        (cross / length.max(1e-20), length)
    }

    /// Bounding box of the possible mirrors in x/r and z/r: lower and upper bounds.
    fn box_of_mirrors(&self) -> Option<([f32; 2], [f32; 2])> {
        let (mut low, mut high) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
        for (i, (first, reflection)) in self.surfaces.iter().enumerate() {
            // At grazing incidence even a rough surface is a mirror, so that only Gamma is decisive here.
            if reflection.mirror(0.0) < MIN_GAIN {
                continue;
            }
            let end = self
                .surfaces
                .get(i + 1)
                .map_or(self.triangles.len(), |s| s.0);
            for &vertex in self.triangles[*first..end].iter().flatten() {
                let p = self.positions[vertex as usize] - self.centre;
                let r = p.length().max(1e-6);
                if p.y <= 0.0 {
                    // This facet extends behind the array, so that its projection can reach the limit of the view.
                    (low, high) = ([-1.0; 2], [1.0; 2]);
                }
                for (axis, value) in [p.x / r, p.z / r].into_iter().enumerate() {
                    low[axis] = low[axis].min(value);
                    high[axis] = high[axis].max(value);
                }
            }
        }
        (low[0] <= high[0]).then_some((low, high))
    }

    /// Returns all bounces in an order that depends only on the scene.
    fn trace(&self) -> Vec<Bounce> {
        let Some((low, high)) = self.box_of_mirrors() else {
            return Vec::new();
        };
        let tracer = Tracer::new(self);
        let n = self.rays;
        let cell: [f32; 2] = std::array::from_fn(|i| (high[i] - low[i]).max(1e-6) / n as f32);
        let mut lit: BTreeMap<([u32; MAX_MIRRORS], u32), Lit> = BTreeMap::new();
        let mut planes = HashMap::new();
        for row in 0..n {
            for column in 0..n {
                let u = low[0] + (column as f32 + 0.5) * cell[0];
                let w = low[1] + (row as f32 + 0.5) * cell[1];
                let y2 = 1.0 - u * u - w * w;
                // 87 degrees off boresight, as in the raster.
                if y2 < 0.0025 {
                    continue;
                }
                let direction = Vec3::new(u, y2.sqrt(), w);
                let solid_angle = cell[0] * cell[1] / direction.y;
                tracer.follow(
                    Shot::new(self.centre, direction),
                    solid_angle,
                    &mut planes,
                    &mut lit,
                );
            }
        }
        let mut out = Vec::new();
        for ((mirrors, facet), Lit { share, passed }) in lit {
            let seen = self.coverage[facet as usize];
            // One leg over the mirrors, one leg direct.
            let over_mirrors = passed / share;
            let direct = self.transmission.amplitude(facet as usize).sqrt();
            let mut push = |legs, share| {
                let passed = match legs {
                    Legs::Out | Legs::Back => over_mirrors * direct,
                    Legs::Both => over_mirrors * over_mirrors,
                };
                out.push(Bounce {
                    mirrors,
                    facet,
                    share,
                    passed,
                    legs,
                });
            };
            if seen > 0.0 {
                push(Legs::Out, share * seen);
            }
            if self.reflection(facet).rough > 0.0 {
                if seen > 0.0 {
                    push(Legs::Back, share * seen);
                }
                push(Legs::Both, share);
            }
        }
        out
    }
}

/// Illumination of a facet by the rays via one chain of mirrors.
#[derive(Clone, Copy, Default)]
struct Lit {
    /// Illuminated area divided by the facet's area.
    share: f32,
    /// The same, weighted with the amplitude that the screens transmit.
    passed: f32,
}

/// A ray during tracing.
#[derive(Clone, Copy)]
struct Shot {
    origin: Vec3,
    direction: Vec3,
    length_m: f32,
    /// Amplitude factor of the mirrors so far.
    mirrored: f32,
    /// Amplitude factor of the screens so far.
    passed: f32,
    mirrors: [u32; MAX_MIRRORS],
    n_mirrors: usize,
}

impl Shot {
    fn new(origin: Vec3, direction: Vec3) -> Self {
        Self {
            origin,
            direction,
            length_m: 0.0,
            mirrored: 1.0,
            passed: 1.0,
            mirrors: [NO_FACET; MAX_MIRRORS],
            n_mirrors: 0,
        }
    }
}

/// Quantised normal and offset in units of [`SAME_PLANE`], and the surface index.
type PlaneKey = ([i32; 4], usize);

struct Tracer<'a> {
    job: &'a TraceJob<'a>,
    bvh: Bvh2,
    triangles: Vec<Triangle>,
}

impl<'a> Tracer<'a> {
    fn new(job: &'a TraceJob<'a>) -> Self {
        let triangles: Vec<Triangle> = (0..job.triangles.len() as u32)
            .map(|facet| {
                let [v0, v1, v2] = job.corners(facet).map(Vec3A::from);
                Triangle { v0, v1, v2 }
            })
            .collect();
        let mut time = std::time::Duration::default();
        let bvh = build_bvh2(&triangles, BvhBuildParams::fast_build(), &mut time);
        Self {
            job,
            bvh,
            triangles,
        }
    }

    /// Nearest facet that faces the ray, and its distance, m.
    fn nearest(&self, origin: Vec3, direction: Vec3) -> Option<(u32, f32)> {
        let ray = Ray::new(origin.into(), direction.into(), CLEARANCE_M, f32::INFINITY);
        let mut hit = RayHit::none();
        let facet_of = |i: usize| self.bvh.primitive_indices[i];
        self.bvh.ray_traverse(ray, &mut hit, |ray, i| {
            let triangle = &self.triangles[facet_of(i) as usize];
            let cross = (triangle.v1 - triangle.v0).cross(triangle.v2 - triangle.v0);
            // Surfaces are one-sided: from the inside they are transparent, as in the raster.
            if cross.dot(ray.direction) >= 0.0 {
                return f32::INFINITY;
            }
            let t = triangle.intersect(ray);
            if t > CLEARANCE_M { t } else { f32::INFINITY }
        });
        hit.t
            .is_finite()
            .then(|| (facet_of(hit.primitive_id as usize), hit.t))
    }

    /// Follows one ray and accumulates the illumination after its first mirror. At a screen the ray splits into a
    /// transmitted and a reflected one.
    fn follow(
        &self,
        mut shot: Shot,
        solid_angle: f32,
        planes: &mut HashMap<PlaneKey, u32>,
        lit: &mut BTreeMap<([u32; MAX_MIRRORS], u32), Lit>,
    ) {
        let job = self.job;
        while shot.n_mirrors < job.max_bounces.min(MAX_MIRRORS + 1) {
            let Some((facet, t)) = self.nearest(shot.origin, shot.direction) else {
                return;
            };
            shot.length_m += t;
            let (normal, twice_area) = job.normal(facet);
            let cos = -normal.dot(shot.direction);
            if cos <= 1e-4 {
                return;
            }
            if shot.n_mirrors > 0 {
                let footprint_m2 = solid_angle * shot.length_m * shot.length_m / cos;
                let share = footprint_m2 / (0.5 * twice_area);
                let sum = lit.entry((shot.mirrors, facet)).or_default();
                sum.share += share;
                sum.passed += share * shot.passed;
            }
            shot.origin += shot.direction * t;
            let reflection = job.reflection(facet);
            let mirrored = shot.mirrored * reflection.mirror(cos);
            if mirrored >= MIN_GAIN && shot.n_mirrors < MAX_MIRRORS {
                let mut reflected = shot;
                reflected.mirrored = mirrored;
                reflected.mirrors[shot.n_mirrors] = self.plane_of(facet, normal, planes);
                reflected.n_mirrors += 1;
                reflected.direction = (shot.direction + 2.0 * cos * normal).normalize();
                self.follow(reflected, solid_angle, planes, lit);
            }
            shot.passed *= reflection.passes;
            if shot.passed < MIN_GAIN {
                return;
            }
        }
    }

    /// Returns the first facet found on this facet's plane, so that tessellation does not split a mirror.
    fn plane_of(&self, facet: u32, normal: Vec3, planes: &mut HashMap<PlaneKey, u32>) -> u32 {
        let offset = normal.dot(self.job.corners(facet)[0]);
        let key = [normal.x, normal.y, normal.z, offset].map(|v| (v / SAME_PLANE).round() as i32);
        let surface = self.job.surfaces.partition_point(|s| s.0 <= facet as usize);
        *planes.entry((key, surface)).or_insert(facet)
    }
}

/// The surfaces of a scene, prepared for bounces.
pub(crate) struct BouncingSurfaces {
    /// First facet and reflection properties of each surface, in order.
    surfaces: Vec<(usize, Reflection)>,
    phases: Vec<FacetPhases>,
}

impl BouncingSurfaces {
    /// Looks up the materials. `seed` determines the phases of the facets.
    pub(crate) fn new(scene: &Scene<'_>, link: &Link, seed: u64) -> Self {
        let mut first = 0;
        let mut surfaces = Vec::with_capacity(scene.surfaces.len());
        for surface in &scene.surfaces {
            surfaces.push((
                first,
                Reflection::new(surface.material(), link.wavelength_m),
            ));
            first += surface.triangles().len();
        }
        let phases = (0..surfaces.len())
            .map(|index| FacetPhases::new(seed, index))
            .collect();
        Self { surfaces, phases }
    }

    /// Finds the facets that are illuminated via mirrors for the vertices at `positions`.
    pub(crate) fn trace(
        &self,
        options: &SimOptions,
        link: &Link,
        positions: &[Vec3],
        triangles: &[[u32; 3]],
        coverage: &[f32],
        transmission: &ScreenTransmission,
    ) -> Vec<Bounce> {
        TraceJob {
            positions,
            triangles,
            surfaces: &self.surfaces,
            coverage,
            transmission,
            centre: link.array_centre_m.as_vec3(),
            max_bounces: options.max_bounces,
            rays: options.bounce_rays,
        }
        .trace()
    }

    fn surface_of(&self, facet: u32) -> usize {
        self.surfaces.partition_point(|s| s.0 <= facet as usize) - 1
    }

    /// Returns the state of a bounce for the vertices at `positions`.
    pub(crate) fn state(
        &self,
        bounce: &Bounce,
        link: &Link,
        positions: &[Vec3],
        triangles: &[[u32; 3]],
    ) -> BounceState {
        let reflection = |facet| self.surfaces[self.surface_of(facet)].1;
        bounce.at(link, positions, triangles, reflection)
    }

    /// Returns the rough-term phasor of a facet.
    pub(crate) fn phasor(&self, facet: u32) -> Complex32 {
        let surface = self.surface_of(facet);
        self.phases[surface].phasor(facet as usize - self.surfaces[surface].0)
    }
}

/// The plane of a facet.
#[derive(Clone, Copy)]
struct Plane {
    normal: DVec3,
    point: DVec3,
}

impl Plane {
    fn reflect(&self, p: DVec3) -> DVec3 {
        p - 2.0 * self.normal.dot(p - self.point) * self.normal
    }
}

impl Bounce {
    /// Returns the path for the vertices at `positions`.
    fn at(
        &self,
        link: &Link,
        positions: &[Vec3],
        triangles: &[[u32; 3]],
        reflection: impl Fn(u32) -> Reflection,
    ) -> BounceState {
        let corners_of = |facet: u32| {
            triangles[facet as usize]
                .map(|i| positions[i as usize].as_dvec3() - link.array_centre_m)
        };
        let chain = self.mirrors.iter().take_while(|m| **m != NO_FACET);
        let mut planes = [None; MAX_MIRRORS];
        for (plane, &facet) in planes.iter_mut().zip(chain) {
            let [a, b, c] = corners_of(facet);
            *plane = Some((
                Plane {
                    normal: (b - a).cross(c - a).normalize_or_zero(),
                    point: a,
                },
                reflection(facet),
            ));
        }
        let image = |p: DVec3| {
            let chain = planes.iter().rev().flatten();
            chain.fold(p, |p, (plane, _)| plane.reflect(p))
        };
        let corners = corners_of(self.facet);
        let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
        let mirrored = image(middle);

        // Unfold the path over the mirrors leg by leg.
        let mut direction = mirrored.normalize_or_zero();
        let mut over_mirrors = 1.0f32;
        for (plane, reflection) in planes.iter().flatten() {
            let cos = plane.normal.dot(direction);
            over_mirrors *= -reflection.mirror(cos.abs() as f32);
            direction -= 2.0 * cos * plane.normal;
        }
        let cross = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        let area = 0.5 * cross.length();
        let normal = cross / (2.0 * area).max(1e-20);
        let cos_mirrored = (-normal.dot(direction)).max(0.0) as f32;
        let cos_direct = (-normal.dot(middle.normalize_or_zero())).max(0.0) as f32;

        let (seen_by_tx, seen_by_rx, cos, mirrors_gain) = match self.legs {
            Legs::Out => (mirrored, middle, [cos_mirrored, cos_direct], over_mirrors),
            Legs::Back => (middle, mirrored, [cos_direct, cos_mirrored], over_mirrors),
            Legs::Both => (
                mirrored,
                mirrored,
                [cos_mirrored; 2],
                over_mirrors * over_mirrors,
            ),
        };
        let path_m = |p: DVec3| match self.legs {
            Legs::Out | Legs::Back => image(p).length() + p.length(),
            Legs::Both => 2.0 * image(p).length(),
        };
        let path_middle_m = path_m(middle);
        // Each leg contributes the square root of the two-way amplitude at its own apparent position.
        let amplitude =
            (link.amplitude(seen_by_tx.as_vec3()) * link.amplitude(seen_by_rx.as_vec3())).sqrt()
                * mirrors_gain
                * self.passed;
        let (coherent, rough) = reflection(self.facet).gains_between(cos, area as f32, self.share);
        BounceState {
            seen_by_tx,
            seen_by_rx,
            corner_path_m: corners.map(|p| path_m(p) - path_middle_m),
            coherent: match self.legs {
                Legs::Out => coherent * amplitude,
                Legs::Back | Legs::Both => 0.0,
            },
            rough: rough * amplitude,
        }
    }
}
