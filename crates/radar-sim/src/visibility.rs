//! What the radar sees: depth rasters, the visible share of every facet, and what the slabs in front of
//! it let through.
//!
//! The effort goes to what is small: in a room, where a person fills a thousandth of the view, the small
//! surfaces get a window of their own. What that costs and leaves of error: `examples/bench_sim.rs`.

use std::ops::Range;

use glam::Vec3;

use crate::rays::coverage_by_rays;
use radarllm_simd::{Lanes, SimdLevel, dispatch};

/// How the visible shares of facets are found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Sampling {
    /// One raster of even samples over everything.
    Uniform,
    /// A window of their own for surfaces that are small in the view; without such, the same as
    /// [`Self::Uniform`].
    #[default]
    Windows,
    /// This many squared rays a facet: the slow reference.
    Rays(u16),
}

/// Facets that belong together.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// Their indices.
    pub facets: Range<u32>,
    /// The indices of their vertices.
    pub vertices: Range<u32>,
    /// Power that passes through them, one way: what is more than 0 hides nothing. A facet has an
    /// outside: seen from behind it is not there.
    pub power_transmission: f32,
}

/// What is looked at, and from where.
#[derive(Clone, Copy, Debug)]
pub struct View<'a> {
    /// Vertices in the radar frame, m, finite.
    pub positions: &'a [Vec3],
    /// Indices into the vertices.
    pub triangles: &'a [[u32; 3]],
    /// All facets and vertices, in ascending order.
    pub parts: &'a [Part],
    /// The eye.
    pub centre: Vec3,
}

impl View<'_> {
    pub(crate) fn has_screens(&self) -> bool {
        self.parts.iter().any(|p| p.power_transmission > 0.0)
    }
}

/// What every facet's visible part keeps of the two-way amplitude behind screens: empty in a scene
/// without screens.
#[derive(Clone, Debug, Default)]
pub struct Through(Vec<f32>);

impl Through {
    /// Two-way amplitude factor of a facet: the product of the screens' one-way power transmissions,
    /// averaged over the facet's visible samples.
    #[inline(always)]
    pub fn of(&self, facet: usize) -> f32 {
        self.0.get(facet).copied().unwrap_or(1.0)
    }

    /// A factor of 1 for each of `n_facets` facets; 0 of them in a scene without screens.
    pub(crate) fn reset(&mut self, n_facets: usize) -> &mut [f32] {
        self.0.clear();
        self.0.resize(n_facets, 1.0);
        &mut self.0
    }
}

/// Finds visible shares, with buffers that are reused from frame to frame.
///
/// Perspective from the array centre on the plane y = 1, so that straight edges stay straight and 1/y is
/// affine over a facet. Facets behind the array or beyond 87 degrees off boresight are not seen.
pub struct DepthRaster {
    size: usize,
    sampling: Sampling,
    level: SimdLevel,
    /// x/y, z/y and 1/y of the vertices; 1/y is 0 where they cannot be seen.
    projected: Vec<[f32; 3]>,
    /// The same in samples of the window.
    in_window: Vec<[f32; 3]>,
    /// Low and high of each part's x/y and z/y.
    boxes: Vec<Window>,
    samples: Samples,
    counts: Counts,
    /// Facets turned to the eye.
    front: Vec<u32>,
}

/// Low and high of x/y and z/y.
#[derive(Clone, Copy, Debug)]
struct Window {
    low: [f32; 2],
    high: [f32; 2],
}

impl Window {
    const EMPTY: Self = Self {
        low: [f32::INFINITY; 2],
        high: [f32::NEG_INFINITY; 2],
    };

    fn is_empty(&self) -> bool {
        self.low[0] > self.high[0]
    }

    fn include(&mut self, low: [f32; 2], high: [f32; 2]) {
        for axis in 0..2 {
            self.low[axis] = self.low[axis].min(low[axis]);
            self.high[axis] = self.high[axis].max(high[axis]);
        }
    }

    fn area(&self) -> f32 {
        if self.is_empty() {
            return 0.0;
        }
        (self.high[0] - self.low[0]) * (self.high[1] - self.low[1])
    }
}

/// Depth samples, row by row.
#[derive(Default)]
struct Samples {
    /// Along each side.
    size: usize,
    /// Samples since the frame began.
    n_drawn: usize,
    /// 1/y of the nearest facet, 0 where there is none.
    nearness: Vec<f32>,
    /// The nearest facet.
    winner: Vec<u32>,
    /// Screens' samples, by sample and from near to far.
    fragments: Vec<Fragment>,
}

/// What a pass over the samples found, by facet.
#[derive(Default)]
struct Counts {
    covered: Vec<u32>,
    won: Vec<u32>,
    /// Sum over the won samples of what screens take; empty without screens.
    lost: Vec<f32>,
}

/// A sample of a screen that no opaque facet hides.
#[derive(Clone, Copy, Debug)]
struct Fragment {
    sample: u32,
    nearness: f32,
    facet: u32,
    power_transmission: f32,
}

dispatch!(fn coverage => coverage_body(
    raster: &mut DepthRaster, view: View<'_>, out: &mut Vec<f32>, through: &mut Through
));

/// Compiled per instruction set for its rounding instructions.
#[inline(always)]
#[expect(
    clippy::extra_unused_type_parameters,
    reason = "dispatched like bodies that compute with lanes"
)]
fn coverage_body<L: Lanes>(
    raster: &mut DepthRaster,
    view: View<'_>,
    out: &mut Vec<f32>,
    through: &mut Through,
) {
    raster.coverage_here(view, out, through);
}

const NOBODY: u32 = u32::MAX;
/// A sub-pixel facet counts as visible if no surface is nearer than it by more than this plus its
/// longest edge, m.
const SMALL_FACET_TOLERANCE_M: f32 = 0.02;
/// Parts whose boxes fill less than this of the view get a window of their own, if its box fills less
/// than four times as much.
const SMALL_PART: f32 = 1.0 / 256.0;

impl DepthRaster {
    /// A raster of about `size * size` samples.
    pub fn new(size: usize, sampling: Sampling) -> Self {
        Self {
            size,
            sampling,
            level: SimdLevel::detect(),
            projected: Vec::new(),
            in_window: Vec::new(),
            boxes: Vec::new(),
            samples: Samples::default(),
            counts: Counts::default(),
            front: Vec::new(),
        }
    }

    /// Visible share of every triangle, 0..=1: the samples it wins over the samples it covers.
    /// Facets turned away, and degenerate ones, get 0. A facet that covers no sample is seen or not
    /// by its centroid.
    ///
    /// `through` receives what screens leave of what lies behind them. Returns the number of samples
    /// drawn.
    pub fn coverage(&mut self, view: View<'_>, out: &mut Vec<f32>, through: &mut Through) -> usize {
        if let Sampling::Rays(per_edge) = self.sampling {
            return coverage_by_rays(view, usize::from(per_edge), out, through);
        }
        self.samples.n_drawn = 0;
        coverage(self.level, self, view, out, through);
        self.samples.n_drawn
    }

    #[inline(always)]
    fn coverage_here(&mut self, view: View<'_>, out: &mut Vec<f32>, through: &mut Through) {
        let n_facets = view.triangles.len();
        let through = through.reset(if view.has_screens() { n_facets } else { 0 });
        out.clear();
        out.resize(n_facets, 0.0);
        self.project(view);
        let mut all = Window::EMPTY;
        for part in &self.boxes {
            all.include(part.low, part.high);
        }
        if all.is_empty() {
            return;
        }
        let mut left = self.size * self.size;
        if self.sampling != Sampling::Uniform {
            let mut small = Window::EMPTY;
            for part in &self.boxes {
                if part.area() < SMALL_PART * all.area() {
                    small.include(part.low, part.high);
                }
            }
            if !small.is_empty() && small.area() < 4.0 * SMALL_PART * all.area() {
                self.look(view, all, self.size / 2, out, through);
                left -= (self.size / 2) * (self.size / 2);
                all = small;
            }
        }
        self.look(view, all, left.isqrt(), out, through);
    }

    /// Projects the vertices and finds the parts' boxes.
    #[inline(always)]
    fn project(&mut self, view: View<'_>) {
        self.projected.clear();
        self.projected.extend(view.positions.iter().map(|&p| {
            let p = p - view.centre;
            // Beyond 87 degrees, or behind.
            if p.y > 0.05 * p.length() {
                let nearness = 1.0 / p.y;
                [p.x * nearness, p.z * nearness, nearness]
            } else {
                [0.0; 3]
            }
        }));
        self.boxes.clear();
        for part in view.parts {
            let mut window = Window::EMPTY;
            let vertices = part.vertices.start as usize..part.vertices.end as usize;
            for &[x, z, nearness] in &self.projected[vertices] {
                if nearness > 0.0 {
                    window.include([x, z], [x, z]);
                }
            }
            self.boxes.push(window);
        }
    }

    /// Draws a window with `size * size` samples and writes the facets that lie wholly in it.
    #[inline(always)]
    fn look(
        &mut self,
        view: View<'_>,
        window: Window,
        size: usize,
        out: &mut [f32],
        through: &mut [f32],
    ) {
        // Samples lie at integer coordinates 0..size; the box ends half a sample outside.
        let scale: [f32; 2] =
            std::array::from_fn(|i| size as f32 / (window.high[i] - window.low[i]).max(1e-6));
        self.in_window.clear();
        self.in_window
            .extend(self.projected.iter().map(|&[x, z, nearness]| {
                [
                    (x - window.low[0]) * scale[0] - 0.5,
                    (z - window.low[1]) * scale[1] - 0.5,
                    nearness,
                ]
            }));
        self.samples.start(size);
        self.counts.start(view.triangles.len(), !through.is_empty());
        self.front.clear();
        // Opaque facets first: screens ask what they hide.
        for is_screen in [false, true] {
            for part in view.parts {
                if (part.power_transmission > 0.0) != is_screen {
                    continue;
                }
                for facet in part.facets.clone() {
                    let corners = self.corners(view, facet);
                    if is_front(corners) {
                        let passes = part.power_transmission;
                        self.front.push(facet);
                        self.counts.covered[facet as usize] =
                            self.samples.draw(facet, corners, passes);
                    }
                }
            }
        }
        self.samples.count(&mut self.counts);
        for &facet in &self.front {
            let corners = self.corners(view, facet);
            if !is_within(corners, size) {
                continue;
            }
            let (share, passed) = match self.counts.of(facet) {
                Some(seen) => seen,
                None => self.samples.see_centroid(corners, view, facet),
            };
            out[facet as usize] = share;
            if let Some(through) = through.get_mut(facet as usize) {
                *through = passed;
            }
        }
    }

    #[inline(always)]
    fn corners(&self, view: View<'_>, facet: u32) -> [[f32; 3]; 3] {
        view.triangles[facet as usize].map(|i| self.in_window[i as usize])
    }
}

/// Twice the signed area in samples; counter-clockwise seen from outside is counter-clockwise with x
/// right and z up.
#[inline(always)]
fn twice_area([a, b, c]: [[f32; 3]; 3]) -> f32 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// Can be seen, is turned to the eye, and has an area; never NaN, as positions are finite.
#[inline(always)]
fn is_front(corners: [[f32; 3]; 3]) -> bool {
    corners.iter().all(|p| p[2] > 0.0) && twice_area(corners) > 1e-12
}

/// Low and high of a facet's x and y.
#[inline(always)]
fn bounds([a, b, c]: [[f32; 3]; 3]) -> [[f32; 2]; 2] {
    std::array::from_fn(|i| [a[i].min(b[i]).min(c[i]), a[i].max(b[i]).max(c[i])])
}

#[inline(always)]
fn is_within(corners: [[f32; 3]; 3], size: usize) -> bool {
    // The window's edge is half a sample outside; the rest is rounding.
    bounds(corners)
        .iter()
        .all(|[low, high]| *low >= -0.51 && *high <= size as f32 - 0.49)
}

impl Counts {
    fn start(&mut self, n_facets: usize, has_screens: bool) {
        self.covered.clear();
        self.covered.resize(n_facets, 0);
        self.won.clear();
        self.won.resize(n_facets, 0);
        self.lost.clear();
        self.lost
            .resize(if has_screens { n_facets } else { 0 }, 0.0);
    }

    /// Visible share and transmission; `None` for a facet that covers no sample.
    #[inline(always)]
    fn of(&self, facet: u32) -> Option<(f32, f32)> {
        let (won, covered) = (self.won[facet as usize], self.covered[facet as usize]);
        if covered == 0 {
            return None;
        }
        let lost = self.lost.get(facet as usize).map_or(0.0, |l| *l);
        Some((won as f32 / covered as f32, 1.0 - lost / won.max(1) as f32))
    }
}

impl Samples {
    /// Forgets everything; `size * size` samples.
    fn start(&mut self, size: usize) {
        let n = size * size;
        self.size = size;
        self.n_drawn += n;
        self.nearness.clear();
        self.nearness.resize(n, 0.0);
        self.winner.clear();
        self.winner.resize(n, NOBODY);
        self.fragments.clear();
    }

    /// Adds the won samples, and what screens before them take.
    fn count(&mut self, counts: &mut Counts) {
        for &facet in &self.winner {
            if facet != NOBODY {
                counts.won[facet as usize] += 1;
            }
        }
        // Facets of one plane never share a sample, so that the order is complete.
        self.fragments.sort_unstable_by(|a, b| {
            (a.sample.cmp(&b.sample))
                .then(b.nearness.total_cmp(&a.nearness))
                .then(a.facet.cmp(&b.facet))
        });
        for stack in self.fragments.chunk_by(|a, b| a.sample == b.sample) {
            let mut passed = 1.0;
            let mut lose = |facet: u32, lost: f32| {
                counts.lost[facet as usize] += lost;
            };
            for fragment in stack {
                counts.won[fragment.facet as usize] += 1;
                lose(fragment.facet, 1.0 - passed);
                passed *= fragment.power_transmission;
            }
            let behind = self.winner[stack[0].sample as usize];
            if behind != NOBODY {
                lose(behind, 1.0 - passed);
            }
        }
    }

    /// Draws a facet turned to the eye; returns the number of samples that it covers.
    #[inline(always)]
    fn draw(&mut self, facet: u32, corners: [[f32; 3]; 3], power_transmission: f32) -> u32 {
        let [a, b, c] = corners;
        let (bx, by) = (b[0] - a[0], b[1] - a[1]);
        let (cx, cy) = (c[0] - a[0], c[1] - a[1]);
        let inverse = 1.0 / twice_area(corners);
        let (db, dc) = (b[2] - a[2], c[2] - a[2]);
        let step_x = (db * cy - dc * by) * inverse;
        let step_y = (dc * bx - db * cx) * inverse;
        let edges = [(a, b), (b, c), (c, a)].map(|(p, q)| {
            let down = q[1] < p[1];
            let (low, high) = if down { (q, p) } else { (p, q) };
            let dy = high[1] - low[1];
            let slope = if dy == 0.0 {
                0.0
            } else {
                (high[0] - low[0]) / dy
            };
            (low, slope, down, dy == 0.0)
        });
        // A sample on an edge belongs to one side only: rows and columns are half-open intervals,
        // and an edge crosses a row at the same place for both of its facets.
        let size = self.size as f32;
        let end = a[1].max(b[1]).max(c[1]).min(size);
        let mut covered = 0;
        let mut y = a[1].min(b[1]).min(c[1]).ceil().max(0.0);
        while y < end {
            // The inside lies right of edges that go down and left of those that go up.
            let (mut from, mut to) = (0.0_f32, size);
            for (low, slope, down, level) in edges {
                let x = low[0] + (y - low[1]) * slope;
                if level {
                    continue;
                }
                if down {
                    from = from.max(x);
                } else {
                    to = to.min(x);
                }
            }
            let (first, end) = (from.ceil(), to.ceil());
            if first < end {
                let row = y as usize * self.size;
                let mut near = a[2] + step_x * (first - a[0]) + step_y * (y - a[1]);
                let span = row + first as usize..row + end as usize;
                covered += span.len() as u32;
                if power_transmission > 0.0 {
                    for sample in span {
                        if near > self.nearness[sample] {
                            self.fragments.push(Fragment {
                                sample: sample as u32,
                                nearness: near,
                                facet,
                                power_transmission,
                            });
                        }
                        near += step_x;
                    }
                } else {
                    let depths = &mut self.nearness[span.clone()];
                    let winners = &mut self.winner[span];
                    for (depth, winner) in depths.iter_mut().zip(winners) {
                        if near > *depth {
                            *depth = near;
                            *winner = facet;
                        }
                        near += step_x;
                    }
                }
            }
            y += 1.0;
        }
        covered
    }

    /// Visible share and transmission of a facet too small to cover a sample.
    fn see_centroid(&self, [a, b, c]: [[f32; 3]; 3], view: View<'_>, facet: u32) -> (f32, f32) {
        let mean = |axis: usize| (a[axis] + b[axis] + c[axis]) / 3.0;
        let last = (self.size - 1) as f32;
        let [column, row] = [0, 1].map(|i| mean(i).round().clamp(0.0, last) as usize);
        let sample = row * self.size + column;
        let nearest = self.nearness[sample];
        let [p, q, r] = view.triangles[facet as usize].map(|i| view.positions[i as usize]);
        let edge = p.distance(q).max(q.distance(r)).max(r.distance(p));
        let depth = 1.0 / mean(2);
        let is_behind = |nearness: f32| depth > 1.0 / nearness + SMALL_FACET_TOLERANCE_M + edge;
        if nearest != 0.0 && is_behind(nearest) {
            return (0.0, 1.0);
        }
        let first = self
            .fragments
            .partition_point(|f| (f.sample as usize) < sample);
        let stack = self.fragments[first..].iter();
        let passed = stack
            .take_while(|f| f.sample as usize == sample && is_behind(f.nearness))
            .map(|f| f.power_transmission)
            .product();
        (1.0, passed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(y: f32, half: f32, first: u32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
        let corner = |x: f32, z: f32| Vec3::new(x * half, y, z * half);
        (
            vec![
                corner(-1.0, -1.0),
                corner(1.0, -1.0),
                corner(1.0, 1.0),
                corner(-1.0, 1.0),
            ],
            vec![[first, first + 1, first + 2], [first, first + 2, first + 3]],
        )
    }

    /// By both rasters, which agree on what these tests ask.
    fn shares(positions: &[Vec3], triangles: &[[u32; 3]]) -> Vec<f32> {
        let all = Part {
            facets: 0..triangles.len() as u32,
            vertices: 0..positions.len() as u32,
            power_transmission: 0.0,
        };
        let view = View {
            positions,
            triangles,
            parts: &[all],
            centre: Vec3::ZERO,
        };
        let [uniform, windows] = [Sampling::Uniform, Sampling::Windows].map(|sampling| {
            let mut out = Vec::new();
            let mut raster = DepthRaster::new(256, sampling);
            raster.coverage(view, &mut out, &mut Through::default());
            out
        });
        for (u, e) in uniform.iter().zip(&windows) {
            assert!((u - e).abs() < 2.0 / 256.0, "{uniform:?} {windows:?}");
        }
        uniform
    }

    #[test]
    fn what_stands_behind_is_hidden_in_proportion() {
        let (mut positions, mut triangles) = square(2.0, 0.5, 0);
        let (behind, more) = square(4.0, 2.0, 4);
        positions.extend(behind);
        triangles.extend(more);
        let out = shares(&positions, &triangles);
        assert_eq!(out[..2], [1.0, 1.0]);
        // The front square covers half of the rear one's angles in each axis: a quarter of its
        // area; two rows of 256 of sampling error.
        assert!(
            (out[2] - 0.75).abs() < 2.0 / 256.0 && (out[3] - 0.75).abs() < 2.0 / 256.0,
            "{out:?}"
        );
        // Fully hidden: the same rear square, shrunk into the shadow.
        for p in &mut positions[4..] {
            p.x *= 0.4;
            p.z *= 0.4;
        }
        assert_eq!(shares(&positions, &triangles)[2..], [0.0, 0.0]);
    }

    #[test]
    fn turned_away_and_degenerate_facets_are_not_seen() {
        let (positions, mut triangles) = square(2.0, 0.5, 0);
        triangles[0].swap(0, 1);
        triangles[1] = [1, 1, 2];
        assert_eq!(shares(&positions, &triangles), [0.0, 0.0]);
        let behind: Vec<Vec3> = positions
            .iter()
            .map(|p| Vec3::new(p.x, -p.y, p.z))
            .collect();
        assert_eq!(shares(&behind, &[[0, 2, 1], [0, 1, 2]]), [0.0, 0.0]);
    }

    #[test]
    fn a_facet_smaller_than_a_sample_is_tested_at_its_centroid() {
        let (mut positions, mut triangles) = square(4.0, 2.0, 0);
        for y in [3.0, 5.0] {
            let first = positions.len() as u32;
            let p = Vec3::new(0.0061, y, 0.0037);
            positions.extend([p, p + Vec3::X * 1e-4, p + Vec3::Z * 1e-4]);
            triangles.push([first, first + 1, first + 2]);
        }
        let out = shares(&positions, &triangles);
        assert_eq!(out[2..], [1.0, 0.0]);
    }
}
