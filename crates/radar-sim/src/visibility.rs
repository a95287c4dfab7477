//! What the radar sees: a depth raster, the visible share of every facet, and what the slabs in front
//! of it let through.

use std::ops::Range;

use glam::Vec3;

use crate::simd::{Lanes, SimdLevel, dispatch};

/// Facets that waves also pass through.
#[derive(Clone, Debug, PartialEq)]
pub struct Screen {
    /// Their indices.
    pub facets: Range<u32>,
    /// Power that passes, one way.
    pub power_transmission: f32,
}

/// What is looked at, and from where.
#[derive(Clone, Copy, Debug)]
pub struct View<'a> {
    /// Vertices in the radar frame, m, finite.
    pub positions: &'a [Vec3],
    /// Indices into the vertices.
    pub triangles: &'a [[u32; 3]],
    /// Facets that hide nothing, in ascending order. A screen has an outside like any facet: seen from
    /// behind it is not there.
    pub screens: &'a [Screen],
    /// The eye.
    pub centre: Vec3,
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

/// A sample of a screen that no opaque facet hides.
#[derive(Clone, Copy, Debug)]
struct Fragment {
    sample: u32,
    nearness: f32,
    facet: u32,
    power_transmission: f32,
}

/// Depth raster over the angular bounding box of the surfaces, reused from frame to frame.
///
/// Perspective from the array centre on the plane y = 1, so that straight edges stay straight and
/// 1/y is affine over a facet. Facets behind the array or beyond 87 degrees off boresight are not
/// seen.
pub struct DepthRaster {
    size: usize,
    level: SimdLevel,
    /// 1/y of the nearest facet, 0 where there is none.
    nearness: Vec<f32>,
    /// The nearest facet.
    winner: Vec<u32>,
    projected: Vec<[f32; 3]>,
    covered: Vec<u32>,
    won: Vec<u32>,
    /// Facets too small to cover a sample.
    small: Vec<u32>,
    /// Screens' samples, by sample and from near to far.
    fragments: Vec<Fragment>,
}

dispatch!(fn coverage => coverage_body(
    raster: &mut DepthRaster, view: View<'_>, out: &mut Vec<f32>, through: &mut Through
));

/// Compiled per instruction set for its rounding instructions.
#[inline(always)]
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

impl DepthRaster {
    /// A raster of `size` by `size` samples.
    pub fn new(size: usize) -> Self {
        Self {
            size,
            level: SimdLevel::detect(),
            nearness: vec![0.0; size * size],
            winner: vec![NOBODY; size * size],
            projected: Vec::new(),
            covered: Vec::new(),
            won: Vec::new(),
            small: Vec::new(),
            fragments: Vec::new(),
        }
    }

    /// Visible share of every triangle, 0..=1: the samples it wins over the samples it covers.
    /// Facets turned away, and degenerate ones, get 0. A facet that covers no sample is seen or not
    /// by its centroid.
    ///
    /// `through` receives what screens leave of what lies behind them.
    pub fn coverage(&mut self, view: View<'_>, out: &mut Vec<f32>, through: &mut Through) {
        coverage(self.level, self, view, out, through);
    }

    #[inline(always)]
    fn coverage_here(&mut self, view: View<'_>, out: &mut Vec<f32>, through: &mut Through) {
        let View {
            positions,
            triangles,
            screens,
            centre,
        } = view;
        let passed = through.reset(if screens.is_empty() {
            0
        } else {
            triangles.len()
        });
        out.clear();
        out.resize(triangles.len(), 0.0);
        self.projected.clear();
        self.projected.extend(positions.iter().map(|&p| {
            let p = p - centre;
            // Beyond 87 degrees, or behind.
            if p.y > 0.05 * p.length() {
                let nearness = 1.0 / p.y;
                [p.x * nearness, p.z * nearness, nearness]
            } else {
                [0.0; 3]
            }
        }));
        let (mut low, mut high) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
        for p in self.projected.iter().filter(|p| p[2] > 0.0) {
            for axis in 0..2 {
                low[axis] = low[axis].min(p[axis]);
                high[axis] = high[axis].max(p[axis]);
            }
        }
        if low[0] > high[0] {
            return;
        }
        // Samples lie at integer coordinates 0..size; the box ends half a sample outside.
        let scale: [f32; 2] =
            std::array::from_fn(|i| self.size as f32 / (high[i] - low[i]).max(1e-6));
        for p in &mut self.projected {
            for axis in 0..2 {
                p[axis] = (p[axis] - low[axis]) * scale[axis] - 0.5;
            }
        }
        self.nearness.fill(0.0);
        self.winner.fill(NOBODY);
        self.covered.clear();
        self.covered.resize(triangles.len(), 0);
        self.won.clear();
        self.won.resize(triangles.len(), 0);
        self.small.clear();
        self.fragments.clear();
        let mut first = 0;
        for screen in screens {
            self.draw_facets::<false>(first..screen.facets.start, triangles, 1.0);
            first = screen.facets.end;
        }
        self.draw_facets::<false>(first..triangles.len() as u32, triangles, 1.0);
        for screen in screens {
            self.draw_facets::<true>(screen.facets.clone(), triangles, screen.power_transmission);
        }
        for &facet in &self.winner {
            if facet != NOBODY {
                self.won[facet as usize] += 1;
            }
        }
        self.look_through_screens(passed);
        for ((share, &won), &covered) in out.iter_mut().zip(&self.won).zip(&self.covered) {
            if covered > 0 {
                *share = won as f32 / covered as f32;
            }
        }
        for &facet in &self.small {
            let triangle = triangles[facet as usize];
            let (share, through) = self.see_centroid(triangle, positions);
            out[facet as usize] = share;
            if let Some(passed) = passed.get_mut(facet as usize) {
                *passed = through;
            }
        }
    }

    /// Counts the screens' samples as won and takes from every facet's factor of 1 what its samples
    /// lose on the average.
    fn look_through_screens(&mut self, factors: &mut [f32]) {
        // Facets of one plane never share a sample, so that the order is complete.
        self.fragments.sort_unstable_by(|a, b| {
            (a.sample.cmp(&b.sample))
                .then(b.nearness.total_cmp(&a.nearness))
                .then(a.facet.cmp(&b.facet))
        });
        for stack in self.fragments.chunk_by(|a, b| a.sample == b.sample) {
            let mut passed = 1.0;
            for fragment in stack {
                self.won[fragment.facet as usize] += 1;
                factors[fragment.facet as usize] -= 1.0 - passed;
                passed *= fragment.power_transmission;
            }
            let behind = self.winner[stack[0].sample as usize];
            if behind != NOBODY {
                factors[behind as usize] -= 1.0 - passed;
            }
        }
        for (factor, &won) in factors.iter_mut().zip(&self.won) {
            *factor = 1.0 - (1.0 - *factor) / won.max(1) as f32;
        }
    }

    #[inline(always)]
    fn draw_facets<const SCREEN: bool>(
        &mut self,
        facets: Range<u32>,
        triangles: &[[u32; 3]],
        power_transmission: f32,
    ) {
        for facet in facets {
            let [a, b, c] = triangles[facet as usize].map(|i| self.projected[i as usize]);
            if a[2] > 0.0 && b[2] > 0.0 && c[2] > 0.0 {
                self.draw::<SCREEN>(facet, a, b, c, power_transmission);
            }
        }
    }

    #[inline(always)]
    fn draw<const SCREEN: bool>(
        &mut self,
        facet: u32,
        a: [f32; 3],
        b: [f32; 3],
        c: [f32; 3],
        power_transmission: f32,
    ) {
        // Counter-clockwise seen from outside is counter-clockwise with x right and z up.
        let (bx, by) = (b[0] - a[0], b[1] - a[1]);
        let (cx, cy) = (c[0] - a[0], c[1] - a[1]);
        let twice_area = bx * cy - by * cx;
        // Also refuses zero area; never NaN, as positions are finite.
        if twice_area <= 1e-12 {
            return;
        }
        // A sample on an edge belongs to one side only: rows and columns are half-open intervals,
        // and an edge crosses a row at the same place for both of its facets.
        let size = self.size as f32;
        let y_first = a[1].min(b[1]).min(c[1]).ceil().max(0.0);
        let y_end = a[1].max(b[1]).max(c[1]).min(size);
        let inverse = 1.0 / twice_area;
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
        let mut covered = 0;
        let mut y = y_first;
        while y < y_end {
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
                if SCREEN {
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
                    covered += (end - first) as u32;
                    y += 1.0;
                    continue;
                }
                let depths = &mut self.nearness[span.clone()];
                let winners = &mut self.winner[span];
                for (depth, winner) in depths.iter_mut().zip(winners) {
                    if near > *depth {
                        *depth = near;
                        *winner = facet;
                    }
                    near += step_x;
                }
                covered += (end - first) as u32;
            }
            y += 1.0;
        }
        self.covered[facet as usize] = covered;
        if covered == 0 {
            self.small.push(facet);
        }
    }

    /// Visible share and transmission of a small facet.
    fn see_centroid(&self, triangle: [u32; 3], positions: &[Vec3]) -> (f32, f32) {
        let [a, b, c] = triangle.map(|i| self.projected[i as usize]);
        let mean = |axis: usize| (a[axis] + b[axis] + c[axis]) / 3.0;
        let last = (self.size - 1) as f32;
        let column = mean(0).round().clamp(0.0, last) as usize;
        let row = mean(1).round().clamp(0.0, last) as usize;
        let sample = row * self.size + column;
        let nearest = self.nearness[sample];
        let [p, q, r] = triangle.map(|i| positions[i as usize]);
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

    fn shares(positions: &[Vec3], triangles: &[[u32; 3]]) -> Vec<f32> {
        let mut out = Vec::new();
        let view = View {
            positions,
            triangles,
            screens: &[],
            centre: Vec3::ZERO,
        };
        DepthRaster::new(256).coverage(view, &mut out, &mut Through::default());
        out
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
