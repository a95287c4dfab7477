//! Paths over several surfaces: mirrors between the antennas and the facet that scatters.
//!
//! Shooting and bouncing rays (Ling, Chou and Lee, IEEE T-AP 1989) find which facet is lit over which
//! mirrors at the middle of a segment; then each such path is followed in time by the image method:
//! the scattering facet is reflected through the planes of its mirrors, and stands for the
//! transmitter where its image stands. So phases, Doppler and arrival angles of ghosts are exact for
//! flat mirrors, however they move.
//!
//! A mirror reflects with -Gamma and what its roughness leaves. The last facet scatters by physical
//! optics with the mean of the cosines of incidence and exit, and by its rough term. A rough facet
//! also answers over the mirrors (out directly, back over them; and over them both ways), which rays
//! that end at the last facet do not count. Polarisation is not modelled.

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

/// Most mirrors of a path.
pub(crate) const MAX_MIRRORS: usize = 3;
/// Marks an unused place in a chain.
const NO_FACET: u32 = u32::MAX;
/// Rays whose mirrors together leave less than this amplitude (-16 dB) end: one plaster wall (-12 dB)
/// goes on, two of them, or a clothed body that is not met at grazing incidence, do not.
const MIN_GAIN: f32 = 0.15;
/// A reflected ray starts this far from the facet it left, m.
const CLEARANCE_M: f32 = 1e-4;
/// Facets of one surface mirror alike when normals and offsets agree to this, 1 and m.
const SAME_PLANE: f32 = 1e-4;

/// Which legs go over the mirrors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Legs {
    /// From the transmitter; back directly. Coherent and rough.
    Out,
    /// Out directly, back over the mirrors. Rough alone.
    Back,
    /// Both. Rough alone.
    Both,
}

/// A facet lit over mirrors.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bounce {
    /// Facets whose planes mirror, from the array on; [`NO_FACET`] behind the last.
    mirrors: [u32; MAX_MIRRORS],
    /// The facet that scatters.
    pub facet: u32,
    /// Lit area over the facet's area.
    pub share: f32,
    /// What screens on the way leave of the amplitude.
    passed: f32,
    /// Which legs go over the mirrors.
    pub legs: Legs,
}

/// A bounce at one instant.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BounceState {
    /// Where the scattering point stands for the transmitters, relative to the array centre, m.
    pub seen_by_tx: DVec3,
    /// The same for the receivers, m.
    pub seen_by_rx: DVec3,
    /// Path lengths out and back over the corners less that over the middle, m.
    pub corner_path_m: [f64; 3],
    /// Gain of the physical-optics term, sqrt(W).
    pub coherent: f32,
    /// Gain of the constant-phase term, sqrt(W).
    pub rough: f32,
}

/// What the tracer looks at; see [`BouncingSurfaces`].
struct TraceJob<'a> {
    /// Vertices relative to the radar's origin, m.
    positions: &'a [Vec3],
    triangles: &'a [[u32; 3]],
    /// First facet and reflection of each surface, in order.
    surfaces: &'a [(usize, Reflection)],
    /// Directly visible share of every facet.
    coverage: &'a [f32],
    /// What screens leave of the direct two-way amplitude.
    transmission: &'a ScreenTransmission,
    centre: Vec3,
    /// Most surfaces on a path, the scattering one included; 2 or more.
    max_bounces: usize,
    /// Rays along each side of the bounding box of the mirrors.
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

    /// Unit normal and twice the area; zero for a facet without area.
    fn normal(&self, facet: u32) -> (Vec3, f32) {
        let [a, b, c] = self.corners(facet);
        let cross = (b - a).cross(c - a);
        let length = cross.length();
        (cross / length.max(1e-20), length)
    }

    /// Bounding box, in x/r and z/r, of what may be a mirror: low and high.
    fn box_of_mirrors(&self) -> Option<([f32; 2], [f32; 2])> {
        let (mut low, mut high) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
        for (i, (first, reflection)) in self.surfaces.iter().enumerate() {
            // At grazing incidence even a rough surface mirrors: Gamma alone decides here.
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
                    // Reaches behind the array: its edge lies somewhere at the rim.
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

    /// All bounces, in an order that depends on nothing but the scene.
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
                // 87 degrees off boresight, as the raster.
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
            // One way over the mirrors, one way directly.
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

/// What rays over one chain of mirrors bring to a facet.
#[derive(Clone, Copy, Default)]
struct Lit {
    /// Lit area over the facet's area.
    share: f32,
    /// The same, weighted with the amplitude that screens let through.
    passed: f32,
}

/// A ray on its way.
#[derive(Clone, Copy)]
struct Shot {
    origin: Vec3,
    direction: Vec3,
    length_m: f32,
    /// Amplitude that the mirrors left.
    mirrored: f32,
    /// Amplitude that the screens left.
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

/// Normal and offset in units of [`SAME_PLANE`], and the surface.
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
            // Surfaces have an outside; from within they are not there, as in the raster.
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

    /// Follows one ray and adds what it lights behind its first mirror. At a screen the ray parts:
    /// one goes on, one is reflected.
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

    /// The first facet found on this facet's plane: tessellation must not split a mirror.
    fn plane_of(&self, facet: u32, normal: Vec3, planes: &mut HashMap<PlaneKey, u32>) -> u32 {
        let offset = normal.dot(self.job.corners(facet)[0]);
        let key = [normal.x, normal.y, normal.z, offset].map(|v| (v / SAME_PLANE).round() as i32);
        let surface = self.job.surfaces.partition_point(|s| s.0 <= facet as usize);
        *planes.entry((key, surface)).or_insert(facet)
    }
}

/// The surfaces of a scene as bounces need them.
pub(crate) struct BouncingSurfaces {
    /// First facet and reflection of each surface, in order.
    surfaces: Vec<(usize, Reflection)>,
    phases: Vec<FacetPhases>,
}

impl BouncingSurfaces {
    /// Looks up the materials; `seed` fixes the facets' phases.
    pub fn new(scene: &Scene<'_>, link: &Link, seed: u64) -> Self {
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

    /// Which facets are lit over mirrors when the vertices are at `positions`.
    pub fn trace(
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

    /// A bounce when the vertices are at `positions`.
    pub fn state(
        &self,
        bounce: &Bounce,
        link: &Link,
        positions: &[Vec3],
        triangles: &[[u32; 3]],
    ) -> BounceState {
        let reflection = |facet| self.surfaces[self.surface_of(facet)].1;
        bounce.at(link, positions, triangles, reflection)
    }

    /// The rough term's phasor of a facet.
    pub fn phasor(&self, facet: u32) -> Complex32 {
        let surface = self.surface_of(facet);
        self.phases[surface].phasor(facet as usize - self.surfaces[surface].0)
    }
}

/// A plane through a facet.
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
    /// The path when the vertices are where `positions` has them.
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

        // The way over the mirrors, folded back.
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
        // Each way has the square root of the two-way amplitude at its own apparent place.
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
