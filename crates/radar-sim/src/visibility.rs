//! Visibility: the visible share of every facet, computed with a depth buffer, and the transmission of the screens in
//! front of it.
//!
//! The scene is projected from the centre of the array onto a plane and sampled by a raster. The visible share of a
//! facet is the fraction of its covered samples in which no other facet is nearer. Facets that cover no sample are
//! tested at their centroid.
//!
//! Design decisions:
//! - A single raster over everything would spend its samples on walls. A person in a room fills a thousandth of the
//!   view. Surfaces that are small in the view therefore get a window of their own ([`Sampling::Windows`]).
//! - The depth buffer holds 1/y instead of y, because 1/y is affine over a projected facet. It is stepped along a row
//!   without a division per sample.
//! - A sample belongs to exactly one facet of a closed surface, on every instruction set. Otherwise a facet would cover
//!   samples that it cannot win, and the share of a fully visible surface would be below 1.
//! - Screens (facets that transmit) do not write the depth buffer. Their samples are kept in a list and multiplied in
//!   afterwards, from near to far.
//!
//! `benches/bench_sim.rs` measures the sampling error and the computing time.

use std::ops::Range;

use glam::Vec3;

use crate::rays::coverage_by_rays;
use radarllm_simd::{LANES, SimdF32x16, SimdLevel, dispatch};

/// Method for computing the visible shares of facets.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Sampling {
    /// One raster of evenly spaced samples over everything.
    Uniform,
    /// A separate window for surfaces that are small in the view. Without such surfaces, the same as [`Self::Uniform`].
    #[default]
    Windows,
    /// The square of this number of rays per facet. This is the slow reference.
    Rays(u16),
}

/// The facets and vertices of one surface, as ranges of the scene's indices.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfaceRange {
    /// Indices of the facets.
    pub facets: Range<u32>,
    /// Indices of the vertices.
    pub vertices: Range<u32>,
    /// One-way power transmission. Facets with a transmission above zero do not occlude others. Facets are one-sided
    /// and transparent from behind.
    pub power_transmission: f32,
}

/// The scene geometry and the viewpoint.
#[derive(Clone, Copy, Debug)]
pub struct View<'a> {
    /// Vertices in the radar frame, m, finite.
    pub positions: &'a [Vec3],
    /// Indices into the vertices.
    pub triangles: &'a [[u32; 3]],
    /// The surfaces of all facets and vertices, in ascending order.
    pub surfaces: &'a [SurfaceRange],
    /// The viewpoint.
    pub centre: Vec3,
}

impl View<'_> {
    pub(crate) fn has_screens(&self) -> bool {
        self.surfaces.iter().any(|p| p.power_transmission > 0.0)
    }
}

/// Takes away the coverage of the facets that are farther than the radar receives ([`crate::link::Link::max_range_m`]). They
/// hide what is behind them all the same.
pub(crate) fn leave_out_beyond_range(view: View<'_>, max_range_m: f64, coverage: &mut [f32]) {
    let max_square = (max_range_m * max_range_m) as f32;
    for (share, triangle) in coverage.iter_mut().zip(view.triangles) {
        if *share > 0.0 {
            let [a, b, c] = triangle.map(|i| view.positions[i as usize]);
            let middle = (a + b + c) / 3.0 - view.centre;
            if middle.length_squared() > max_square {
                *share = 0.0;
            }
        }
    }
}

/// Two-way amplitude transmission of the screens for every facet's visible part. Empty in a scene without screens.
#[derive(Clone, Debug, Default)]
pub struct ScreenTransmission(Vec<f32>);

impl ScreenTransmission {
    /// Two-way amplitude factor of a facet: the product of the screens' one-way power transmissions,
    /// averaged over the facet's visible samples.
    #[inline(always)]
    pub fn amplitude(&self, facet: usize) -> f32 {
        self.0.get(facet).copied().unwrap_or(1.0)
    }

    /// Sets a factor of 1 for each of `n_facets` facets; `n_facets` is 0 in a scene without screens.
    pub(crate) fn reset(&mut self, n_facets: usize) -> &mut [f32] {
        self.0.clear();
        self.0.resize(n_facets, 1.0);
        &mut self.0
    }
}

/// Computes visible shares, with buffers that are reused from frame to frame.
///
/// The results are the same on every [`SimdLevel`].
///
/// The projection is a perspective from the array centre onto the plane y = 1, so that straight edges remain straight
/// and 1/y is affine over a facet. Facets behind the array or beyond 87 degrees off boresight are not visible.
pub struct DepthRaster {
    size: usize,
    sampling: Sampling,
    level: SimdLevel,
    /// x/y, z/y and 1/y of the vertices; 1/y is 0 where they cannot be seen.
    projected: Vec<[f32; 3]>,
    /// The same with x/y and z/y in samples of the window that is being drawn.
    in_window: Vec<[f32; 3]>,
    /// Bounds of each surface's x/y and z/y.
    boxes: Vec<Window>,
    samples: Samples,
    counts: Counts,
    front_facets: Vec<FrontFacet>,
}

/// A facet that faces the viewpoint and is completely inside the window.
#[derive(Clone, Copy, Debug)]
struct FrontFacet {
    facet: u32,
    /// Number of samples that it covers.
    covered: f32,
}

/// A rectangle of the projection plane: bounds of x/y and z/y.
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

/// Depth samples.
#[derive(Default)]
struct Samples {
    /// Along each side.
    size: usize,
    /// Samples since the frame began.
    n_drawn: usize,
    /// Blocks per row. The last block may extend beyond the window. Its samples there are drawn like the others, which
    /// saves a mask. Only facets that extend beyond the window win them, and such facets are not evaluated in it.
    n_blocks: usize,
    /// Row by row.
    blocks: Vec<Block>,
    /// Samples of screens. After [`Self::count`] they are sorted by sample, and from near to far.
    fragments: Vec<Fragment>,
}

/// Adjacent samples of one row.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
struct Block {
    /// 1/y of the nearest facet, 0 where there is none.
    inverse_depth: [f32; LANES],
    /// The bits of the nearest facet's index plus 1, 0 where there is none. Stored as floats, so that depth and winner are
    /// selected by the same comparison in the same vector type.
    winner: [f32; LANES],
}

impl Block {
    const EMPTY: Self = Self {
        inverse_depth: [0.0; LANES],
        winner: [0.0; LANES],
    };

    fn winner(&self, lane: usize) -> Option<usize> {
        (self.winner[lane].to_bits() as usize).checked_sub(1)
    }
}

/// Result of a pass over the samples, by facet index.
#[derive(Default)]
struct Counts {
    won: Vec<u32>,
    /// Sum over the won samples of the share that the screens in front absorb. Empty without screens.
    lost: Vec<f32>,
}

/// A sample of a screen that is nearer than the nearest opaque facet.
#[derive(Clone, Copy, Debug)]
struct Fragment {
    sample: u32,
    inverse_depth: f32,
    facet: u32,
    power_transmission: f32,
}

dispatch!(fn coverage => coverage_body(
    raster: &mut DepthRaster, view: View<'_>, out: &mut Vec<f32>, transmission: &mut ScreenTransmission
));

#[inline(always)]
fn coverage_body<L: SimdF32x16>(
    raster: &mut DepthRaster,
    view: View<'_>,
    out: &mut Vec<f32>,
    transmission: &mut ScreenTransmission,
) {
    raster.coverage_in_lanes::<L>(view, out, transmission);
}

/// A sub-pixel facet counts as visible if no surface is nearer than it by more than this plus its
/// longest edge, m.
const SMALL_FACET_TOLERANCE_M: f32 = 0.02;
/// Surfaces whose boxes fill less than this of the view get a window of their own, if its box fills less
/// than four times as much.
const SMALL_SURFACE: f32 = 1.0 / 256.0;

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
            front_facets: Vec::new(),
        }
    }

    /// Returns the visible share of every triangle, 0..=1: the number of samples it wins divided by the number of
    /// samples it covers. Facets that face away and degenerate facets get 0. A facet that covers no sample is tested at
    /// its centroid.
    ///
    /// `transmission` receives the screens' transmission for every facet. Returns the number of samples drawn.
    pub fn coverage(
        &mut self,
        view: View<'_>,
        out: &mut Vec<f32>,
        transmission: &mut ScreenTransmission,
    ) -> usize {
        if let Sampling::Rays(per_edge) = self.sampling {
            return coverage_by_rays(view, usize::from(per_edge), out, transmission);
        }
        self.samples.n_drawn = 0;
        coverage(self.level, self, view, out, transmission);
        self.samples.n_drawn
    }

    #[inline(always)]
    fn coverage_in_lanes<L: SimdF32x16>(
        &mut self,
        view: View<'_>,
        out: &mut Vec<f32>,
        transmission: &mut ScreenTransmission,
    ) {
        let n_facets = view.triangles.len();
        let transmission = transmission.reset(if view.has_screens() { n_facets } else { 0 });
        out.clear();
        out.resize(n_facets, 0.0);
        self.project(view);
        let mut all = Window::EMPTY;
        for surface in &self.boxes {
            all.include(surface.low, surface.high);
        }
        if all.is_empty() {
            return;
        }
        // The window of the small surfaces takes three quarters of the samples. Facets that are completely inside it
        // are evaluated with these samples. All others are evaluated with the remaining quarter, which covers
        // everything.
        let mut left = self.size * self.size;
        if self.sampling != Sampling::Uniform {
            let mut small = Window::EMPTY;
            for surface in &self.boxes {
                if surface.area() < SMALL_SURFACE * all.area() {
                    small.include(surface.low, surface.high);
                }
            }
            if !small.is_empty() && small.area() < 4.0 * SMALL_SURFACE * all.area() {
                self.draw_window::<L>(view, all, self.size / 2, out, transmission);
                left -= (self.size / 2) * (self.size / 2);
                all = small;
            }
        }
        self.draw_window::<L>(view, all, left.isqrt(), out, transmission);
    }

    /// Projects the vertices and computes the surfaces' bounding boxes.
    #[inline(always)]
    fn project(&mut self, view: View<'_>) {
        self.projected.clear();
        self.projected.extend(view.positions.iter().map(|&p| {
            let p = p - view.centre;
            // Beyond 87 degrees off boresight, or behind the array, the projection would be far outside or mirrored.
            // 1/y = 0 marks such vertices.
            if p.y > 0.05 * p.length() {
                let inverse_depth = 1.0 / p.y;
                [p.x * inverse_depth, p.z * inverse_depth, inverse_depth]
            } else {
                [0.0; 3]
            }
        }));
        self.boxes.clear();
        for surface in view.surfaces {
            let mut window = Window::EMPTY;
            let vertices = surface.vertices.start as usize..surface.vertices.end as usize;
            for &[x, z, inverse_depth] in &self.projected[vertices] {
                if inverse_depth > 0.0 {
                    window.include([x, z], [x, z]);
                }
            }
            self.boxes.push(window);
        }
    }

    /// Draws a window with `size * size` samples and writes the results of the facets that are completely inside it.
    #[inline(always)]
    fn draw_window<L: SimdF32x16>(
        &mut self,
        view: View<'_>,
        window: Window,
        size: usize,
        out: &mut [f32],
        transmission: &mut [f32],
    ) {
        // Samples have integer coordinates 0..size. The box extends half a sample beyond them.
        let scale: [f32; 2] =
            std::array::from_fn(|i| size as f32 / (window.high[i] - window.low[i]).max(1e-6));
        self.in_window.clear();
        self.in_window
            .extend(self.projected.iter().map(|&[x, z, inverse_depth]| {
                [
                    (x - window.low[0]) * scale[0] - 0.5,
                    (z - window.low[1]) * scale[1] - 0.5,
                    inverse_depth,
                ]
            }));
        self.samples.start(size);
        self.counts
            .start(view.triangles.len(), !transmission.is_empty());
        self.front_facets.clear();
        // Opaque facets are drawn first, because a sample of a screen counts only in front of the nearest opaque facet.
        for is_screen in [false, true] {
            for surface in view.surfaces {
                if (surface.power_transmission > 0.0) != is_screen {
                    continue;
                }
                for facet in surface.facets.clone() {
                    let corners = self.corners(view, facet);
                    if is_front(corners) {
                        let covered =
                            (self.samples).draw::<L>(facet, corners, surface.power_transmission);
                        // A facet that the window cuts would be evaluated by a part of itself. It still occludes what
                        // is behind it, and gets its share in the window over everything.
                        if is_within(corners, size) {
                            self.front_facets.push(FrontFacet { facet, covered });
                        }
                    }
                }
            }
        }
        self.samples.count(&mut self.counts);
        for &FrontFacet { facet, covered } in &self.front_facets {
            let (share, passed) = if covered > 0.0 {
                self.counts.of(facet, covered)
            } else {
                let corners = self.corners(view, facet);
                self.samples.test_centroid(corners, view, facet)
            };
            out[facet as usize] = share;
            if let Some(transmission) = transmission.get_mut(facet as usize) {
                *transmission = passed;
            }
        }
    }

    #[inline(always)]
    fn corners(&self, view: View<'_>, facet: u32) -> [[f32; 3]; 3] {
        view.triangles[facet as usize].map(|i| self.in_window[i as usize])
    }
}

/// Twice the signed area in samples. Facets that are counter-clockwise as seen from outside are counter-clockwise with
/// x to the right and z up.
#[inline(always)]
fn twice_area([a, b, c]: [[f32; 3]; 3]) -> f32 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// Whether the facet is visible, faces the viewpoint, and has an area. The positions are finite, so that no value is
/// NaN.
#[inline(always)]
fn is_front(corners: [[f32; 3]; 3]) -> bool {
    corners.iter().all(|p| p[2] > 0.0) && twice_area(corners) > 1e-12
}

/// Lower and upper bounds of a facet's x and y.
#[inline(always)]
fn bounds([a, b, c]: [[f32; 3]; 3]) -> [[f32; 2]; 2] {
    std::array::from_fn(|i| [a[i].min(b[i]).min(c[i]), a[i].max(b[i]).max(c[i])])
}

#[inline(always)]
fn is_within(corners: [[f32; 3]; 3], size: usize) -> bool {
    // The window's edge is half a sample outside. The rest of the margin allows for rounding.
    bounds(corners)
        .iter()
        .all(|[low, high]| *low >= -0.51 && *high <= size as f32 - 0.49)
}

impl Counts {
    fn start(&mut self, n_facets: usize, has_screens: bool) {
        self.won.clear();
        self.won.resize(n_facets, 0);
        self.lost.clear();
        self.lost
            .resize(if has_screens { n_facets } else { 0 }, 0.0);
    }

    /// Visible share and transmission of a facet that covers `covered` samples.
    #[inline(always)]
    fn of(&self, facet: u32, covered: f32) -> (f32, f32) {
        let won = self.won[facet as usize];
        let lost = self.lost.get(facet as usize).map_or(0.0, |l| *l);
        (won as f32 / covered, 1.0 - lost / won.max(1) as f32)
    }
}

/// Offset of each lane within its block.
const PLACES: [f32; LANES] = [
    0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0,
];
/// Larger than any sample coordinate, and larger than the coordinate at which an almost level edge crosses any row.
const FAR: f32 = 1e30;

/// An edge of a facet in counter-clockwise order. The inside is to the right of downward edges and to the left of
/// upward edges.
#[derive(Clone, Copy)]
struct Edge {
    low_x: f32,
    low_y: f32,
    /// dx / dy.
    slope: f32,
    /// Offsets that turn the position at which the edge crosses a row into a lower and an upper bound: 0 for the bound
    /// that the edge sets, and a very large value otherwise. An addition is cheaper than a selection.
    to_low: f32,
    to_high: f32,
}

impl Edge {
    #[inline(always)]
    fn new(from: [f32; 3], to: [f32; 3]) -> Self {
        let down = to[1] < from[1];
        let dy = to[1] - from[1];
        // A level edge sets no bound within a row. The row range of the facet provides it.
        let level = dy == 0.0;
        Self {
            // The two facets of an edge traverse it in opposite directions. Both compute from its lower end, so that
            // both round to the same position.
            low_x: if down { to[0] } else { from[0] },
            low_y: if down { to[1] } else { from[1] },
            slope: if level { 0.0 } else { (to[0] - from[0]) / dy },
            to_low: if down { 0.0 } else { -FAR },
            to_high: if down | level { FAR } else { 0.0 },
        }
    }
}

/// The samples that a facet covers in sixteen rows.
#[repr(C, align(64))]
struct Rows {
    /// Lower and upper bounds of the covered samples.
    low: [f32; LANES],
    high: [f32; LANES],
    /// 1/y at the first corner's column.
    near: [f32; LANES],
}

impl Rows {
    /// Computes the bounds between samples, starting at row `first`.
    ///
    /// An edge crosses a row at the same position for both of its facets. That position is moved to the middle between
    /// two samples. No sample is then on an edge, and every sample belongs to exactly one side.
    #[inline(always)]
    fn write<L: SimdF32x16>(&mut self, first: usize, edges: [Edge; 3]) {
        let y = L::load(&PLACES).add(L::splat(first as f32));
        let half = L::splat(0.5);
        let (mut low, mut high) = (L::splat(-FAR), L::splat(FAR));
        for edge in edges {
            // Products and sums are separate, here and below. With fused operations, the SIMD levels that have them
            // would find other facets visible than the levels without them.
            let rise = y.sub(L::splat(edge.low_y)).mul(L::splat(edge.slope));
            let x = rise.add(L::splat(edge.low_x));
            let between = x.sub(half).round().add(half);
            low = low.max(between.add(L::splat(edge.to_low)));
            high = high.min(between.add(L::splat(edge.to_high)));
        }
        low.store(&mut self.low);
        high.store(&mut self.high);
    }
}

impl Samples {
    /// Clears the buffers for a raster of `size * size` samples.
    fn start(&mut self, size: usize) {
        self.size = size;
        self.n_drawn += size * size;
        self.n_blocks = size.div_ceil(LANES);
        self.blocks.clear();
        self.blocks.resize(self.n_blocks * size, Block::EMPTY);
        self.fragments.clear();
    }

    /// Counts the won samples, and adds the absorption by the screens in front of them.
    fn count(&mut self, counts: &mut Counts) {
        for block in &self.blocks {
            for lane in 0..LANES {
                if let Some(facet) = block.winner(lane) {
                    counts.won[facet] += 1;
                }
            }
        }
        // Sort by sample, then from near to far. Ties cannot change a result, because facets of one plane never share a
        // sample.
        self.fragments.sort_unstable_by(|a, b| {
            (a.sample.cmp(&b.sample))
                .then(b.inverse_depth.total_cmp(&a.inverse_depth))
                .then(a.facet.cmp(&b.facet))
        });
        // Each screen in the stack over one sample loses the share that the screens in front of it absorb. The winner
        // behind them loses the share that all of them absorb.
        for stack in self.fragments.chunk_by(|a, b| a.sample == b.sample) {
            let mut passed = 1.0;
            for fragment in stack {
                let facet = fragment.facet as usize;
                counts.won[facet] += 1;
                counts.lost[facet] += 1.0 - passed;
                passed *= fragment.power_transmission;
            }
            let sample = stack[0].sample as usize;
            if let Some(behind) = self.blocks[sample / LANES].winner(sample % LANES) {
                counts.lost[behind] += 1.0 - passed;
            }
        }
    }

    /// Draws a facet that faces the viewpoint and returns the number of samples that it covers.
    #[inline(always)]
    fn draw<L: SimdF32x16>(
        &mut self,
        facet: u32,
        corners: [[f32; 3]; 3],
        power_transmission: f32,
    ) -> f32 {
        let [a, b, c] = corners;
        let (bx, by) = (b[0] - a[0], b[1] - a[1]);
        let (cx, cy) = (c[0] - a[0], c[1] - a[1]);
        let inverse = 1.0 / twice_area(corners);
        let (db, dc) = (b[2] - a[2], c[2] - a[2]);
        let step_x = (db * cy - dc * by) * inverse;
        let step_y = (dc * bx - db * cx) * inverse;
        let edges = [Edge::new(a, b), Edge::new(b, c), Edge::new(c, a)];
        let [[low_x, high_x], [low_y, high_y]] = bounds(corners);
        // Rows and columns of the facet's bounding box, as half-open intervals.
        let start = |low: f32| low.ceil().max(0.0) as u32 as usize;
        let (first_row, end_row) = (start(low_y), start(high_y).min(self.size));
        let first_block = start(low_x) / LANES;
        let end_block = start(high_x).div_ceil(LANES).min(self.n_blocks);
        let (zero, one) = (L::splat(0.0), L::splat(1.0));
        let mut covered = zero;
        let mut rows = Rows {
            low: [0.0; LANES],
            high: [0.0; LANES],
            near: [0.0; LANES],
        };
        for first in (first_row..end_row).step_by(LANES) {
            // Lanes are rows here: the bounds of sixteen rows at once. Below, lanes are samples of one row.
            rows.write::<L>(first, edges);
            let y = L::load(&PLACES).add(L::splat(first as f32));
            y.sub(L::splat(a[1]))
                .mul(L::splat(step_y))
                .add(L::splat(a[2]))
                .store(&mut rows.near);
            for row in first..end_row.min(first + LANES) {
                let [low, high, near] =
                    [&rows.low, &rows.high, &rows.near].map(|r| L::splat(r[row - first]));
                for block_idx in first_block..end_block {
                    let x = L::load(&PLACES).add(L::splat((LANES * block_idx) as f32));
                    let inside = x.sub(low).min(high.sub(x));
                    covered = covered.add(zero.select_lt(inside, one, zero));
                    let near = x.sub(L::splat(a[0])).mul(L::splat(step_x)).add(near);
                    let near = zero.select_lt(inside, near, zero);
                    let block_idx = row * self.n_blocks + block_idx;
                    if power_transmission > 0.0 {
                        self.add_fragments(block_idx, &near.array(), facet, power_transmission);
                        continue;
                    }
                    let block = &mut self.blocks[block_idx];
                    let (nearest, name) = (
                        L::load(&block.inverse_depth),
                        L::splat(f32::from_bits(facet + 1)),
                    );
                    nearest
                        .select_lt(near, name, L::load(&block.winner))
                        .store(&mut block.winner);
                    nearest.max(near).store(&mut block.inverse_depth);
                }
            }
        }
        covered.reduce_sum()
    }

    /// Adds a screen's samples of one block, with an inverse depth of 0 where there is none.
    ///
    /// Not inlined: few scenes have screens, and the loop that calls it is the hottest of this file.
    #[cold]
    #[inline(never)]
    fn add_fragments(
        &mut self,
        block_idx: usize,
        near: &[f32; LANES],
        facet: u32,
        power_transmission: f32,
    ) {
        let nearest = &self.blocks[block_idx].inverse_depth;
        for (lane, (&inverse_depth, &nearest)) in near.iter().zip(nearest).enumerate() {
            if inverse_depth > nearest {
                self.fragments.push(Fragment {
                    sample: (block_idx * LANES + lane) as u32,
                    inverse_depth,
                    facet,
                    power_transmission,
                });
            }
        }
    }

    /// Visible share and transmission of a facet too small to cover a sample.
    fn test_centroid(&self, [a, b, c]: [[f32; 3]; 3], view: View<'_>, facet: u32) -> (f32, f32) {
        let mean = |axis: usize| (a[axis] + b[axis] + c[axis]) / 3.0;
        let last = (self.size - 1) as f32;
        let [column, row] = [0, 1].map(|i| mean(i).round().clamp(0.0, last) as usize);
        let sample = row * self.n_blocks * LANES + column;
        let nearest = self.blocks[sample / LANES].inverse_depth[sample % LANES];
        let [p, q, r] = view.triangles[facet as usize].map(|i| view.positions[i as usize]);
        let edge = p.distance(q).max(q.distance(r)).max(r.distance(p));
        let depth = 1.0 / mean(2);
        let is_behind =
            |inverse_depth: f32| depth > 1.0 / inverse_depth + SMALL_FACET_TOLERANCE_M + edge;
        if nearest != 0.0 && is_behind(nearest) {
            return (0.0, 1.0);
        }
        let first = self
            .fragments
            .partition_point(|f| (f.sample as usize) < sample);
        let stack = self.fragments[first..].iter();
        let passed = stack
            .take_while(|f| f.sample as usize == sample && is_behind(f.inverse_depth))
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

    /// Computes the shares with both rasters, which must agree in these tests.
    fn shares(positions: &[Vec3], triangles: &[[u32; 3]]) -> Vec<f32> {
        let all = SurfaceRange {
            facets: 0..triangles.len() as u32,
            vertices: 0..positions.len() as u32,
            power_transmission: 0.0,
        };
        let view = View {
            positions,
            triangles,
            surfaces: &[all],
            centre: Vec3::ZERO,
        };
        let [uniform, windows] = [Sampling::Uniform, Sampling::Windows].map(|sampling| {
            let mut out = Vec::new();
            let mut raster = DepthRaster::new(256, sampling);
            raster.coverage(view, &mut out, &mut ScreenTransmission::default());
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
        // The front square covers half of the rear one's angles in each axis, which is a quarter of its area. The
        // tolerance is two of 256 rows.
        assert!(
            (out[2] - 0.75).abs() < 2.0 / 256.0 && (out[3] - 0.75).abs() < 2.0 / 256.0,
            "{out:?}"
        );
        // The same rear square, shrunk into the shadow, is fully hidden.
        for p in &mut positions[4..] {
            p.x *= 0.4;
            p.z *= 0.4;
        }
        assert_eq!(shares(&positions, &triangles)[2..], [0.0, 0.0]);
    }

    #[inline(always)]
    fn draw_all_body<L: SimdF32x16>(
        samples: &mut Samples,
        facets: &[[[f32; 3]; 3]],
        covered: &mut Vec<f32>,
    ) {
        for (facet, &corners) in facets.iter().enumerate() {
            covered.push(samples.draw::<L>(facet as u32, corners, 0.0));
        }
    }
    dispatch!(fn draw_all => draw_all_body(
        samples: &mut Samples, facets: &[[[f32; 3]; 3]], covered: &mut Vec<f32>
    ));

    #[test]
    fn every_sample_of_a_surface_belongs_to_one_facet() {
        // A sheet over all samples. Half of its inner vertices are displaced by multiples of a quarter sample, so that
        // some edges pass through samples and some run along rows. The others are displaced arbitrarily.
        let (size, n) = (48, 12);
        let random = |i: usize| ((i * 7 + 3) as f32 * 0.618_034).fract();
        let corner = |column: usize, row: usize| {
            let inner = |i: usize| i > 0 && i < n;
            let place = row * 31 + column;
            let moved = |along: usize, k: usize| {
                let quarters = 9.0 * random(place + 997 * k) - 4.0;
                let quarters = if place.is_multiple_of(2) {
                    quarters.round()
                } else {
                    quarters
                };
                4.0 * along as f32 - 0.5 + if inner(along) { 0.25 * quarters } else { 0.0 }
            };
            [moved(column, 0), moved(row, 1), 1.0 + random(place + 3)]
        };
        let mut facets = vec![];
        for row in 0..n {
            for column in 0..n {
                let [a, b] = [corner(column, row), corner(column + 1, row)];
                let [c, d] = [corner(column + 1, row + 1), corner(column, row + 1)];
                facets.extend([[a, b, c], [a, c, d]]);
            }
        }
        assert!(facets.iter().all(|&f| is_front(f)));
        let mut expected = None;
        for level in SimdLevel::available() {
            let mut samples = Samples::default();
            samples.start(size);
            let mut covered = vec![];
            draw_all(level, &mut samples, &facets, &mut covered);
            assert_eq!(
                covered.iter().sum::<f32>(),
                (size * size) as f32,
                "{level:?}"
            );
            let mut counts = Counts::default();
            counts.start(facets.len(), false);
            samples.count(&mut counts);
            // A facet that covers a sample without winning it would share it with another facet.
            for (&covered, &won) in covered.iter().zip(&counts.won) {
                assert_eq!(covered, won as f32, "{level:?}");
            }
            // The results are bitwise equal, including the depths.
            let found: Vec<_> = (samples.blocks.iter())
                .map(|b| {
                    (
                        b.inverse_depth.map(f32::to_bits),
                        b.winner.map(f32::to_bits),
                    )
                })
                .collect();
            let expected = expected.get_or_insert_with(|| found.clone());
            assert!(*expected == found, "{level:?}");
        }
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
