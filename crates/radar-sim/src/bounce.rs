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
//!
//! In a room nearly all paths are among walls and furniture. They are traced once ([`StillPaths`]); in a frame, only the
//! rays that a moving surface interrupts are traced again ([`BouncingSurfaces::trace_changes`]).

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
enum Legs {
    /// Transmitter leg over the mirrors, receiver leg direct. Coherent and rough terms.
    Out,
    /// Transmitter leg direct, receiver leg over the mirrors. Rough term only.
    Back,
    /// Both legs over the mirrors. Rough term only.
    Both,
}

/// A facet that is illuminated via mirrors, with the paths of [`ALL_LEGS`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bounce {
    /// Facets whose planes act as mirrors, starting at the array. Entries after the last mirror are [`NO_FACET`].
    mirrors: [u32; MAX_MIRRORS],
    /// The scattering facet.
    pub facet: u32,
    now: [Illuminated; ALL_LEGS.len()],
    /// What is taken away of the field, because it is among what the surfaces that stand still return without the others.
    kept: [Illuminated; ALL_LEGS.len()],
}

/// How much of a facet is illuminated along one path.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Illuminated {
    /// Illuminated area divided by the facet's area.
    share: f32,
    /// Amplitude factor of the screens along the path.
    passed: f32,
}

/// The paths of a bounce, in order.
const ALL_LEGS: [Legs; 3] = [Legs::Out, Legs::Back, Legs::Both];

/// The state of one path of a bounce at one instant.
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
    /// Half of the longest path that is received, m; see [`Link::max_range_m`].
    max_range_m: f64,
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

    /// Bounding box of the possible mirrors in x/r and z/r, or of those of some surfaces: lower and upper bounds.
    fn box_of_mirrors(&self, of: Option<&[bool]>) -> Option<([f32; 2], [f32; 2])> {
        let (mut low, mut high) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
        for (i, (first, reflection)) in self.surfaces.iter().enumerate() {
            // At grazing incidence even a rough surface is a mirror, so that only Gamma is decisive here.
            if reflection.mirror(0.0) < MIN_GAIN || of.is_some_and(|of| !of[i]) {
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

    /// The rays of the grid over the mirrors' bounding box: direction from the array, and solid angle.
    fn grid(&self, (low, high): ([f32; 2], [f32; 2])) -> impl Iterator<Item = (Vec3, f32)> {
        let n = self.rays;
        let cell: [f32; 2] = std::array::from_fn(|i| (high[i] - low[i]).max(1e-6) / n as f32);
        (0..n * n).filter_map(move |i| {
            let (row, column) = (i / n, i % n);
            let u = low[0] + (column as f32 + 0.5) * cell[0];
            let w = low[1] + (row as f32 + 0.5) * cell[1];
            let y2 = 1.0 - u * u - w * w;
            // 87 degrees off boresight, as in the raster.
            (y2 >= 0.0025).then(|| {
                let direction = Vec3::new(u, y2.sqrt(), w);
                (direction, cell[0] * cell[1] / direction.y)
            })
        })
    }

    /// Illumination of the facets of `mesh` by all rays of the grid, and the planes of its mirrors. `each` is called with every
    /// ray and what it meets.
    fn illumination(
        &self,
        mesh: &Mesh,
        bounds: ([f32; 2], [f32; 2]),
        mut each: impl FnMut((Vec3, f32), &mut RayPaths),
    ) -> (Illumination, Planes) {
        let tracer = Tracer {
            job: self,
            mesh,
            still: None,
        };
        let mut lit = Illumination::new();
        let mut planes = Planes::new();
        let mut ray = RayPaths::default();
        for grid_ray in self.grid(bounds) {
            tracer.follow_ray(grid_ray, &[], &mut planes, &mut ray);
            for hit in &ray.hits {
                lit.entry(hit.key).or_default().add(hit, 1);
            }
            each(grid_ray, &mut ray);
        }
        (lit, planes)
    }

    /// Returns all bounces in an order that depends only on the scene.
    fn trace(&self) -> Vec<Bounce> {
        let Some(bounds) = self.box_of_mirrors(None) else {
            return Vec::new();
        };
        let mesh = Mesh::new(self, 0..self.triangles.len() as u32);
        let (lit, _) = self.illumination(&mesh, bounds, |_, _| ());
        let bounces = lit.into_iter().map(|(key, lit)| self.bounce(key, lit));
        bounces.filter(Bounce::has_paths).collect()
    }

    /// Half the lengths of the paths over the centroid of a facet, m, with the legs of [`ALL_LEGS`].
    fn half_paths_m(&self, (mirrors, facet): Key) -> [f64; ALL_LEGS.len()] {
        let corners_of = |facet| {
            self.corners(facet)
                .map(|corner| (corner - self.centre).as_dvec3())
        };
        let [a, b, c] = corners_of(facet);
        let middle = (a + b + c) / 3.0;
        let n_mirrors = mirrors.iter().take_while(|m| **m != NO_FACET).count();
        let mirrored = mirrors[..n_mirrors]
            .iter()
            .rev()
            .fold(middle, |p, &mirror| {
                Plane::through(corners_of(mirror)).reflect(p)
            });
        let (over_mirrors_m, direct_m) = (mirrored.length(), middle.length());
        ALL_LEGS.map(|legs| match legs {
            Legs::Out | Legs::Back => 0.5 * (over_mirrors_m + direct_m),
            Legs::Both => over_mirrors_m,
        })
    }

    /// How a facet is illuminated via a chain of mirrors, with the legs of [`ALL_LEGS`]. Paths that are too long to be
    /// received are left out.
    fn illuminated(&self, key: Key, lit: Lit) -> [Illuminated; ALL_LEGS.len()] {
        let (_, facet) = key;
        if lit.n_rays == 0 {
            return Default::default();
        }
        let seen = self.coverage[facet as usize];
        // One leg over the mirrors, one leg direct.
        let (share, over_mirrors) = (lit.share as f32, (lit.passed / lit.share) as f32);
        let direct = self.transmission.amplitude(facet as usize).sqrt();
        let is_rough = self.reflection(facet).rough > 0.0;
        let half_paths_m = self.half_paths_m(key);
        std::array::from_fn(|path| {
            let legs = ALL_LEGS[path];
            let (share, passed) = match legs {
                Legs::Out | Legs::Back => (share * seen, over_mirrors * direct),
                Legs::Both => (share, over_mirrors * over_mirrors),
            };
            let is_received = half_paths_m[path] <= self.max_range_m;
            if is_received && share > 0.0 && (is_rough || legs == Legs::Out) {
                Illuminated { share, passed }
            } else {
                Illuminated::default()
            }
        })
    }

    /// The bounce of a facet that is illuminated via a chain of mirrors.
    fn bounce(&self, key: Key, lit: Lit) -> Bounce {
        let (mirrors, facet) = key;
        Bounce {
            mirrors,
            facet,
            now: self.illuminated(key, lit),
            kept: Default::default(),
        }
    }

    /// Traces the surfaces of `still` alone. `None` if the bounding box of their mirrors does not contain every mirror that
    /// may come, or if the paths would take too much memory.
    fn trace_still(&self, still: &[bool]) -> Option<StillPaths> {
        let (low, high) = self.box_of_mirrors(Some(still))?;
        if low != [-1.0; 2] || high != [1.0; 2] || self.rays > MAX_KEPT_RAYS {
            return None;
        }
        let mesh = Mesh::new(self, self.facets_of(still, true));
        let mut rays = Vec::new();
        let (mut legs, mut hits) = (Vec::new(), Vec::new());
        let (lit, planes) = self.illumination(
            &mesh,
            (low, high),
            |(direction, solid_angle), ray: &mut RayPaths| {
                legs.append(&mut ray.legs);
                hits.append(&mut ray.hits);
                rays.push(KeptRay {
                    direction,
                    solid_angle,
                    legs_end: legs.len(),
                    hits_end: hits.len(),
                });
            },
        );
        Some(StillPaths {
            mesh,
            rays,
            legs,
            hits,
            lit: lit.into_iter().collect(),
            planes,
        })
    }

    /// Facets of the surfaces that stand still, or of the others.
    fn facets_of(&self, still: &[bool], which: bool) -> impl Iterator<Item = u32> {
        let ends = self.surfaces.iter().skip(1).map(|s| s.0);
        let ends = ends.chain([self.triangles.len()]);
        let surfaces = self.surfaces.iter().zip(ends).zip(still);
        surfaces
            .filter(move |(_, still)| **still == which)
            .flat_map(|((surface, end), _)| surface.0 as u32..end as u32)
    }

    /// See [`BouncingSurfaces::trace_changes`].
    fn trace_changes(&self, still: &[bool], base: &StillBase<'_>) -> Changes {
        let paths = base.paths;
        let moving = Mesh::new(self, self.facets_of(still, false));
        let tracer = Tracer {
            job: self,
            mesh: &moving,
            still: Some(paths),
        };
        let mut changes = Illumination::new();
        let mut planes = Planes::new();
        let mut ray = RayPaths::default();
        let (mut first_leg, mut first_hit) = (0, 0);
        for kept in &paths.rays {
            let legs = &paths.legs[first_leg..kept.legs_end];
            let hits = &paths.hits[first_hit..kept.hits_end];
            (first_leg, first_hit) = (kept.legs_end, kept.hits_end);
            if !legs.iter().any(|leg| moving.interrupts(leg)) {
                continue;
            }
            for hit in hits {
                changes.entry(hit.key).or_default().add(hit, -1);
            }
            let grid_ray = (kept.direction, kept.solid_angle);
            tracer.follow_ray(grid_ray, legs, &mut planes, &mut ray);
            for hit in &ray.hits {
                changes.entry(hit.key).or_default().add(hit, 1);
            }
        }
        let was = TraceJob {
            coverage: base.coverage,
            transmission: base.transmission,
            ..*self
        };
        let mut of_still = Vec::new();
        let mut n_bounces = base.n_bounces;
        for &(key, lit) in &paths.lit {
            let (mirrors, facet) = key;
            let change = changes.remove(&key);
            let at = facet as usize;
            if change.is_none()
                && self.coverage[at] == base.coverage[at]
                && self.transmission.amplitude(at) == base.transmission.amplitude(at)
            {
                continue;
            }
            let bounce = Bounce {
                mirrors,
                facet,
                now: self.illuminated(key, lit.changed_by(change.unwrap_or_default())),
                kept: was.illuminated(key, lit),
            };
            n_bounces += count(&bounce.now);
            n_bounces -= count(&bounce.kept);
            if bounce.has_paths() {
                of_still.push(bounce);
            }
        }
        // What remains goes over a surface that does not stand still.
        let moving: Vec<Bounce> = (changes.into_iter())
            .filter(|(_, lit)| lit.n_rays > 0)
            .map(|(key, lit)| self.bounce(key, lit))
            .filter(Bounce::has_paths)
            .collect();
        Changes {
            n_bounces: n_bounces + n_paths(&moving),
            of_still,
            moving,
        }
    }
}

/// Number of paths of bounces.
pub(crate) fn n_paths(bounces: &[Bounce]) -> usize {
    bounces.iter().map(|bounce| count(&bounce.now)).sum()
}

/// Number of illuminated paths.
fn count(illuminated: &[Illuminated]) -> usize {
    illuminated.iter().filter(|i| i.share > 0.0).count()
}

/// What the surfaces that do not stand still change.
pub(crate) struct Changes {
    /// Differences of the bounces among the surfaces that stand still.
    pub of_still: Vec<Bounce>,
    /// Bounces over other surfaces.
    pub moving: Vec<Bounce>,
    /// Number of paths of the whole scene.
    pub n_bounces: usize,
}

/// Maximum number of rays along each side of the grid whose paths are kept, which bounds the memory: 50 MB in a room.
const MAX_KEPT_RAYS: usize = 512;

/// Chain of mirrors and illuminated facet.
type Key = ([u32; MAX_MIRRORS], u32);
/// Sorted, so that the order of the bounces depends only on the scene.
type Illumination = BTreeMap<Key, Lit>;
/// First facet found on each plane.
type Planes = HashMap<PlaneKey, u32>;

/// Everything that the rays of the grid meet among the surfaces that stand still.
pub(crate) struct StillPaths {
    mesh: Mesh,
    rays: Vec<KeptRay>,
    legs: Vec<Leg>,
    hits: Vec<Hit>,
    /// Sum of `hits`, in order.
    lit: Vec<(Key, Lit)>,
    planes: Planes,
}

/// A ray of the grid; its legs and hits end where those of the next one begin.
struct KeptRay {
    direction: Vec3,
    solid_angle: f32,
    legs_end: usize,
    hits_end: usize,
}

/// The surfaces that stand still as they are without the others.
pub(crate) struct StillBase<'a> {
    pub paths: &'a StillPaths,
    pub n_bounces: usize,
    pub coverage: &'a [f32],
    pub transmission: &'a ScreenTransmission,
}

/// What one ray of the grid meets, in all its branches.
#[derive(Default)]
struct RayPaths {
    legs: Vec<Leg>,
    hits: Vec<Hit>,
}

/// A straight part of a ray.
struct Leg {
    origin: Vec3,
    direction: Vec3,
    /// Infinite if it meets nothing.
    length_m: f32,
    /// The facet that it meets.
    facet: u32,
}

/// A facet that a ray illuminates via mirrors.
struct Hit {
    key: Key,
    share: f32,
    passed: f32,
}

/// Illumination of a facet by the rays via one chain of mirrors. In f64, so that rays can be taken away again.
#[derive(Clone, Copy, Default)]
struct Lit {
    /// Illuminated area divided by the facet's area.
    share: f64,
    /// The same, weighted with the amplitude that the screens transmit.
    passed: f64,
    n_rays: i32,
}

impl Lit {
    fn add(&mut self, hit: &Hit, sign: i32) {
        let share = f64::from(sign) * f64::from(hit.share);
        self.share += share;
        self.passed += share * f64::from(hit.passed);
        self.n_rays += sign;
    }

    fn changed_by(self, change: Self) -> Self {
        Self {
            share: self.share + change.share,
            passed: self.passed + change.passed,
            n_rays: self.n_rays + change.n_rays,
        }
    }
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

/// Facets in a hierarchy of boxes.
struct Mesh {
    bvh: Bvh2,
    triangles: Vec<Triangle>,
    /// Facet of each triangle.
    facets: Vec<u32>,
    low: Vec3,
    high: Vec3,
}

impl Mesh {
    fn new(job: &TraceJob<'_>, facets: impl Iterator<Item = u32>) -> Self {
        let facets: Vec<u32> = facets.collect();
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        let triangles: Vec<Triangle> = facets
            .iter()
            .map(|&facet| {
                let corners = job.corners(facet);
                for corner in corners {
                    (low, high) = (low.min(corner), high.max(corner));
                }
                let [v0, v1, v2] = corners.map(Vec3A::from);
                Triangle { v0, v1, v2 }
            })
            .collect();
        let mut time = std::time::Duration::default();
        let bvh = build_bvh2(&triangles, BvhBuildParams::fast_build(), &mut time);
        Self {
            bvh,
            triangles,
            facets,
            low,
            high,
        }
    }

    /// Nearest facet that faces the ray within `limit_m`, and its distance, m.
    fn nearest(&self, shot: &Shot, limit_m: f32) -> Option<(u32, f32)> {
        if self.triangles.is_empty() {
            return None;
        }
        let (origin, direction) = (shot.origin.into(), shot.direction.into());
        let ray = Ray::new(origin, direction, CLEARANCE_M, limit_m);
        let mut hit = RayHit::none();
        self.bvh
            .ray_traverse(ray, &mut hit, |ray, i| self.distance_m(ray, i));
        (hit.t < limit_m).then(|| {
            (
                self.facets[self.triangle_of(hit.primitive_id as usize)],
                hit.t,
            )
        })
    }

    fn triangle_of(&self, primitive: usize) -> usize {
        self.bvh.primitive_indices[primitive] as usize
    }

    /// Distance of a primitive of the hierarchy along the ray, m; infinite if the ray does not meet its front.
    fn distance_m(&self, ray: &Ray, primitive: usize) -> f32 {
        let triangle = &self.triangles[self.triangle_of(primitive)];
        let cross = (triangle.v1 - triangle.v0).cross(triangle.v2 - triangle.v0);
        // Surfaces are one-sided: from the inside they are transparent, as in the raster.
        if cross.dot(ray.direction) >= 0.0 {
            return f32::INFINITY;
        }
        let t = triangle.intersect(ray);
        if t > CLEARANCE_M { t } else { f32::INFINITY }
    }

    /// Whether a facet faces the leg before its end.
    fn interrupts(&self, leg: &Leg) -> bool {
        // Most legs miss the box of all facets.
        let divisor = |x: f32| if x.abs() < 1e-12 { 1e-12 } else { x };
        let inverse = Vec3::from_array(leg.direction.to_array().map(divisor)).recip();
        let (a, b) = (
            (self.low - leg.origin) * inverse,
            (self.high - leg.origin) * inverse,
        );
        let enters = a.min(b).max_element().max(0.0);
        let leaves = a.max(b).min_element().min(leg.length_m);
        if enters > leaves {
            return false;
        }
        let (origin, direction) = (leg.origin.into(), leg.direction.into());
        let ray = Ray::new(origin, direction, CLEARANCE_M, leg.length_m);
        !self
            .bvh
            .ray_traverse_miss(ray, |ray, i| self.distance_m(ray, i))
    }
}

struct Tracer<'a> {
    job: &'a TraceJob<'a>,
    mesh: &'a Mesh,
    /// What is known of the other surfaces, which stand still.
    still: Option<&'a StillPaths>,
}

impl Tracer<'_> {
    /// Nearest facet that faces the ray, and its distance, m. `known` are legs among the surfaces that stand still.
    fn nearest(&self, shot: &Shot, known: &[Leg]) -> Option<(u32, f32)> {
        let same = |leg: &&Leg| leg.origin == shot.origin && leg.direction == shot.direction;
        let found = match (known.iter().find(same), self.still) {
            (Some(leg), _) => (leg.facet != NO_FACET).then_some((leg.facet, leg.length_m)),
            (None, Some(still)) => still.mesh.nearest(shot, f32::INFINITY),
            (None, None) => None,
        };
        let limit_m = found.map_or(f32::INFINITY, |(_, t)| t);
        self.mesh.nearest(shot, limit_m).or(found)
    }

    /// Follows one ray of the grid into `paths`, which is overwritten.
    fn follow_ray(
        &self,
        (direction, solid_angle): (Vec3, f32),
        known: &[Leg],
        planes: &mut Planes,
        paths: &mut RayPaths,
    ) {
        paths.legs.clear();
        paths.hits.clear();
        let shot = Shot::new(self.job.centre, direction);
        self.follow(shot, solid_angle, known, planes, paths);
    }

    /// Follows one ray and collects the illumination after its first mirror. At a screen the ray splits into a
    /// transmitted and a reflected one.
    fn follow(
        &self,
        mut shot: Shot,
        solid_angle: f32,
        known: &[Leg],
        planes: &mut Planes,
        paths: &mut RayPaths,
    ) {
        let job = self.job;
        while shot.n_mirrors < job.max_bounces.min(MAX_MIRRORS + 1) {
            let found = self.nearest(&shot, known);
            paths.legs.push(Leg {
                origin: shot.origin,
                direction: shot.direction,
                length_m: found.map_or(f32::INFINITY, |(_, t)| t),
                facet: found.map_or(NO_FACET, |(facet, _)| facet),
            });
            let Some((facet, t)) = found else {
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
                paths.hits.push(Hit {
                    key: (shot.mirrors, facet),
                    share: footprint_m2 / (0.5 * twice_area),
                    passed: shot.passed,
                });
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
                self.follow(reflected, solid_angle, known, planes, paths);
            }
            shot.passed *= reflection.passes;
            if shot.passed < MIN_GAIN {
                return;
            }
        }
    }

    /// Returns the first facet found on this facet's plane, so that tessellation does not split a mirror.
    fn plane_of(&self, facet: u32, normal: Vec3, planes: &mut Planes) -> u32 {
        let offset = normal.dot(self.job.corners(facet)[0]);
        let key = [normal.x, normal.y, normal.z, offset].map(|v| (v / SAME_PLANE).round() as i32);
        let surface = self.job.surfaces.partition_point(|s| s.0 <= facet as usize);
        let key = (key, surface);
        let known = self.still.and_then(|still| still.planes.get(&key));
        known
            .copied()
            .unwrap_or_else(|| *planes.entry(key).or_insert(facet))
    }
}

/// A scene at one instant, and what the array sees of it directly.
#[derive(Clone, Copy)]
pub(crate) struct Seen<'a> {
    /// Vertices relative to the radar's origin, m.
    pub positions: &'a [Vec3],
    pub triangles: &'a [[u32; 3]],
    pub coverage: &'a [f32],
    pub transmission: &'a ScreenTransmission,
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
    pub(crate) fn trace(&self, options: &SimOptions, link: &Link, seen: Seen<'_>) -> Vec<Bounce> {
        self.job(options, link, seen).trace()
    }

    /// Keeps the paths among the surfaces of `still`, which stand still. `None` if they do not surround the array, or if
    /// that would take too much memory; see [`Self::trace`].
    pub(crate) fn trace_still(
        &self,
        options: &SimOptions,
        link: &Link,
        seen: Seen<'_>,
        still: &[bool],
    ) -> Option<(StillPaths, Vec<Bounce>)> {
        let job = self.job(options, link, seen);
        let paths = job.trace_still(still)?;
        let bounces = paths.lit.iter().map(|&(key, lit)| job.bounce(key, lit));
        let bounces = bounces.filter(Bounce::has_paths).collect();
        Some((paths, bounces))
    }

    /// The bounces that the surfaces that do not stand still add to those of `base` and take away from them.
    pub(crate) fn trace_changes(
        &self,
        options: &SimOptions,
        link: &Link,
        seen: Seen<'_>,
        still: &[bool],
        base: &StillBase<'_>,
    ) -> Changes {
        self.job(options, link, seen).trace_changes(still, base)
    }

    fn job<'a>(&'a self, options: &SimOptions, link: &Link, seen: Seen<'a>) -> TraceJob<'a> {
        TraceJob {
            positions: seen.positions,
            triangles: seen.triangles,
            surfaces: &self.surfaces,
            coverage: seen.coverage,
            transmission: seen.transmission,
            centre: link.array_centre_m.as_vec3(),
            max_range_m: link.max_range_m,
            max_bounces: options.max_bounces,
            rays: options.bounce_rays,
        }
    }

    fn surface_of(&self, facet: u32) -> usize {
        self.surfaces.partition_point(|s| s.0 <= facet as usize) - 1
    }

    /// Returns the states of the paths of a bounce for the vertices at `positions`.
    pub(crate) fn states(
        &self,
        bounce: &Bounce,
        link: &Link,
        positions: &[Vec3],
        triangles: &[[u32; 3]],
    ) -> [BounceState; ALL_LEGS.len()] {
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
    fn through([a, b, c]: [DVec3; 3]) -> Self {
        Self {
            normal: (b - a).cross(c - a).normalize_or_zero(),
            point: a,
        }
    }

    fn reflect(&self, p: DVec3) -> DVec3 {
        p - 2.0 * self.normal.dot(p - self.point) * self.normal
    }
}

impl Bounce {
    /// Indices of the paths that differ from what is kept.
    pub(crate) fn paths(&self) -> impl Iterator<Item = usize> {
        (0..ALL_LEGS.len()).filter(|&path| self.now[path] != self.kept[path])
    }

    fn has_paths(&self) -> bool {
        self.now != self.kept
    }

    /// Returns the paths for the vertices at `positions`.
    fn at(
        &self,
        link: &Link,
        positions: &[Vec3],
        triangles: &[[u32; 3]],
        reflection: impl Fn(u32) -> Reflection,
    ) -> [BounceState; ALL_LEGS.len()] {
        let corners_of = |facet: u32| {
            triangles[facet as usize]
                .map(|i| positions[i as usize].as_dvec3() - link.array_centre_m)
        };
        let chain = self.mirrors.iter().take_while(|m| **m != NO_FACET);
        let mut planes = [None; MAX_MIRRORS];
        for (plane, &facet) in planes.iter_mut().zip(chain) {
            *plane = Some((Plane::through(corners_of(facet)), reflection(facet)));
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

        // Each leg contributes the square root of the two-way amplitude at its own apparent position.
        let [via_mirrors, direct] = [mirrored, middle].map(|p| link.amplitude(p.as_vec3()).sqrt());
        let via_mirrors = via_mirrors * over_mirrors;
        let middle_m = [mirrored.length(), middle.length()];
        let corners_m =
            corners.map(|p| [image(p).length() - middle_m[0], p.length() - middle_m[1]]);
        let reflection = reflection(self.facet);
        std::array::from_fn(|path| {
            let legs = ALL_LEGS[path];
            let (seen_by_tx, seen_by_rx, cos, amplitude) = match legs {
                Legs::Out => {
                    let cos = [cos_mirrored, cos_direct];
                    (mirrored, middle, cos, via_mirrors * direct)
                }
                Legs::Back => {
                    let cos = [cos_direct, cos_mirrored];
                    (middle, mirrored, cos, via_mirrors * direct)
                }
                Legs::Both => {
                    let cos = [cos_mirrored; 2];
                    (mirrored, mirrored, cos, via_mirrors * via_mirrors)
                }
            };
            let gains = |of: Illuminated| {
                let (coherent, rough) = reflection.gains_between(cos, area as f32, of.share);
                (coherent * of.passed, rough * of.passed)
            };
            let (now, kept) = (gains(self.now[path]), gains(self.kept[path]));
            BounceState {
                seen_by_tx,
                seen_by_rx,
                corner_path_m: corners_m.map(|[via, direct]| match legs {
                    Legs::Out | Legs::Back => via + direct,
                    Legs::Both => 2.0 * via,
                }),
                coherent: match legs {
                    Legs::Out => (now.0 - kept.0) * amplitude,
                    Legs::Back | Legs::Both => 0.0,
                },
                rough: (now.1 - kept.1) * amplitude,
            }
        })
    }
}
