//! Converts visible facets to [`Source`]s, sixteen at a time so that the arithmetic is vectorised.

use glam::{DVec3, Vec3};
use radarllm_base::SPEED_OF_LIGHT_MPS;

use crate::link::Link;
use crate::motion::{KEYS_U, N_KEYS, RangeScale, Source, max_slope, parabola, quartic};
use crate::scatter::{FacetPhases, Reflection};
use crate::spread::{divided_difference, max_divided_slope};
use crate::visibility::ScreenTransmission;
use radarllm_simd::{SimdF32x16, dispatch, sin_cos_turns};

/// Facets per batch.
const BATCH: usize = 16;
/// Keys at which gains are evaluated.
const GAIN_KEYS: [usize; 3] = [0, 2, 4];

/// Visible facets of one surface.
pub(crate) struct FacetJob<'a> {
    pub link: &'a Link,
    pub scale: &'a RangeScale,
    pub reflection: &'a Reflection,
    pub phases: &'a FacetPhases,
    /// Positions at the key times, radar frame, m.
    pub keys: &'a [Vec<Vec3>; N_KEYS],
    /// The surface's triangles, with indices into `keys`.
    pub triangles: &'a [[u32; 3]],
    /// Visible shares of the triangles.
    pub coverage: &'a [f32],
    /// Transmission of the screens, by facet of the whole scene.
    pub transmission: &'a ScreenTransmission,
    /// Index of the surface's first facet in the scene.
    pub first_facet: usize,
    /// Facets with a share above 0.
    pub visible: &'a [u32],
    /// Receives one source per visible facet, in order.
    pub out: &'a mut Vec<Source>,
    /// Facets with a larger extent in range are counted as too coarse, m.
    pub coarse_m: f64,
    pub n_coarse: &'a mut usize,
    /// Receives the sum of the sources' powers at the segment's centre.
    pub power_w: &'a mut f64,
}

dispatch!(
    /// Appends the sources of a surface's visible facets.
    pub(crate) fn facet_sources => facet_sources_body(job: FacetJob<'_>)
);

type Row = [f32; BATCH];
type DoubleRow = [f64; BATCH];

#[inline(always)]
fn facet_sources_body<L: SimdF32x16>(job: FacetJob<'_>) {
    let centre = job.link.array_centre_m;
    // `[key][corner, with the centroid last][axis][facet]`, relative to the array centre.
    let mut points = [[[[0.0_f32; BATCH]; 3]; 4]; N_KEYS];
    let mut ranges = [[[0.0_f64; BATCH]; 4]; N_KEYS];
    for batch in job.visible.chunks(BATCH) {
        let (mut share, mut transmission, mut turns): (Row, Row, Row) =
            ([0.0; BATCH], [0.0; BATCH], [0.0; BATCH]);
        for i in 0..BATCH {
            // A short last batch is filled up with copies of its last facet.
            let facet = batch[i.min(batch.len() - 1)] as usize;
            share[i] = job.coverage[facet];
            transmission[i] = job.transmission.amplitude(job.first_facet + facet);
            turns[i] = job.phases.phase_turns(facet);
            let corners = job.triangles[facet];
            for (at_key, key) in points.iter_mut().zip(job.keys) {
                for (corner, &vertex) in corners.iter().enumerate() {
                    let p = key[vertex as usize];
                    at_key[corner][0][i] = p.x;
                    at_key[corner][1][i] = p.y;
                    at_key[corner][2][i] = p.z;
                }
            }
        }
        for (at_key, range) in points.iter_mut().zip(&mut ranges) {
            measure(at_key, range, centre);
        }
        let (sin, cos) = sin_cos_turns(L::load(&turns));
        let (mut rough_sin, mut rough_cos) = ([0.0; BATCH], [0.0; BATCH]);
        sin.store(&mut rough_sin);
        cos.store(&mut rough_cos);

        let (mut coherent, mut rough) = ([[0.0; BATCH]; 3], [[0.0; BATCH]; 3]);
        for (slot, key) in GAIN_KEYS.into_iter().enumerate() {
            let p = &points[key];
            for i in 0..BATCH {
                let corner = |c: usize| Vec3::new(p[c][0][i], p[c][1][i], p[c][2][i]);
                let gains = facet_gains(
                    job.link,
                    job.reflection,
                    [corner(0), corner(1), corner(2)],
                    share[i],
                );
                coherent[slot][i] = gains.0 * transmission[i];
                rough[slot][i] = gains.1 * transmission[i];
            }
        }
        let fit = fit(&points, &ranges, job.link, job.scale);
        let [p, q, r] = &fit.corners;
        let corners = [L::load(&p[0]), L::load(&q[0]), L::load(&r[0])];
        let (dd_re, dd_im) = divided_difference(corners);
        let slope = max_divided_slope(corners, L::load(&fit.corner_turns_per_u)).array();
        let (smooth, diffuse) = (L::load(&coherent[1]), L::load(&rough[1]));
        let re = smooth.fma(dd_re, diffuse.mul(cos)).array();
        let im = smooth.fma(dd_im, diffuse.mul(sin)).array();
        for i in 0..batch.len() {
            let nearest = ranges[2][0][i].min(ranges[2][1][i]).min(ranges[2][2][i]);
            let farthest = ranges[2][0][i].max(ranges[2][1][i]).max(ranges[2][2][i]);
            *job.n_coarse += usize::from(farthest - nearest > job.coarse_m);
            *job.power_w += f64::from(re[i] * re[i] + im[i] * im[i]);
            let of = |rows: &[Row; 3]| [rows[0][i], rows[1][i], rows[2][i]];
            let mut source = Source {
                turns: std::array::from_fn(|p| fit.turns[p][i]),
                cells: std::array::from_fn(|p| fit.cells[p][i]),
                corners: std::array::from_fn(|c| std::array::from_fn(|p| fit.corners[c][p][i])),
                corner_turns_per_u: fit.corner_turns_per_u[i],
                coherent: parabola(of(&coherent)),
                rough: parabola(of(&rough)),
                change_per_u: 0.0,
                rough_phasor: [rough_cos[i], rough_sin[i]],
                from_centre: std::array::from_fn(|k| {
                    let p = &points[k][3];
                    Vec3::new(p[0][i], p[1][i], p[2][i])
                }),
                turn_rad: fit.turn_rad[i],
                per_m: fit.per_m[i],
                direction: std::array::from_fn(|axis| {
                    std::array::from_fn(|p| fit.direction[axis][p][i])
                }),
                is_flat: false,
                reach_cells: 0.0,
                tx_row: None,
                turns_per_m: fit.turns_per_m[i],
            };
            source.bound_change(slope[i]);
            job.out.push(source);
        }
    }
}

/// Coherent and rough gains of a facet with corners relative to the array centre, sqrt(W). There are no branches, so
/// that loops over this function are vectorised.
#[inline(always)]
pub(crate) fn facet_gains(
    link: &Link,
    reflection: &Reflection,
    [a, b, c]: [Vec3; 3],
    coverage: f32,
) -> (f32, f32) {
    let normal = 0.5 * (b - a).cross(c - a);
    let middle = (a + b + c) * (1.0 / 3.0);
    // The lower bound avoids 0/0. A facet without area has gains of 0.
    let area = normal.length_squared().sqrt().max(1e-20);
    let area_cos = -normal.dot(middle) / middle.length_squared().sqrt();
    let (coherent, rough) = reflection.gains(area_cos, area, coverage);
    let amplitude = link.amplitude(middle);
    (coherent * amplitude, rough * amplitude)
}

/// Converts positions to positions relative to `centre`, adds the centroids, and writes all ranges, m.
#[inline(always)]
fn measure(points: &mut [[Row; 3]; 4], ranges: &mut [DoubleRow; 4], centre: DVec3) {
    for i in 0..BATCH {
        let mut sum = [0.0; 3];
        for corner in 0..3 {
            let mut square = 0.0;
            for (axis, offset) in [centre.x, centre.y, centre.z].into_iter().enumerate() {
                let x = f64::from(points[corner][axis][i]) - offset;
                points[corner][axis][i] = x as f32;
                sum[axis] += x;
                square += x * x;
            }
            ranges[corner][i] = square.sqrt();
        }
        let mut square = 0.0;
        for axis in 0..3 {
            let x = sum[axis] * (1.0 / 3.0);
            points[3][axis][i] = x as f32;
            square += x * x;
        }
        ranges[3][i] = square.sqrt();
    }
}

/// Polynomials of a batch.
struct Fit {
    turns: [DoubleRow; N_KEYS],
    cells: [Row; N_KEYS],
    corners: [[Row; N_KEYS]; 3],
    turn_rad: Row,
    per_m: Row,
    direction: [[Row; N_KEYS]; 2],
    corner_turns_per_u: Row,
    turns_per_m: Row,
}

/// The arithmetic of [`RangeScale::source`] for sixteen facets.
#[inline(always)]
#[expect(
    clippy::needless_range_loop,
    reason = "the facet is the last of several indices"
)]
fn fit(
    points: &[[[Row; 3]; 4]; N_KEYS],
    ranges: &[[DoubleRow; 4]; N_KEYS],
    link: &Link,
    scale: &RangeScale,
) -> Fit {
    let mut fit = Fit {
        turns: [[0.0; BATCH]; N_KEYS],
        cells: [[0.0; BATCH]; N_KEYS],
        corners: [[[0.0; BATCH]; N_KEYS]; 3],
        turn_rad: [0.0; BATCH],
        per_m: [0.0; BATCH],
        direction: [[[0.0; BATCH]; N_KEYS]; 2],
        corner_turns_per_u: [0.0; BATCH],
        turns_per_m: [0.0; BATCH],
    };
    let delay = 2.0 / SPEED_OF_LIGHT_MPS;
    for i in 0..BATCH {
        let tau = [
            delay * ranges[0][3][i],
            delay * ranges[1][3][i],
            delay * ranges[2][3][i],
            delay * ranges[3][3][i],
            delay * ranges[4][3][i],
        ];
        let turns = quartic([
            scale.turns(tau[0]),
            scale.turns(tau[1]),
            scale.turns(tau[2]),
            scale.turns(tau[3]),
            scale.turns(tau[4]),
        ]);
        let cells = scale.cells(quartic(tau));
        for p in 0..N_KEYS {
            fit.turns[p][i] = turns[p];
            fit.cells[p][i] = cells[p] as f32;
        }
        fit.turns_per_m[i] =
            ((scale.centre_hz - scale.slope_hz_per_s * tau[2]) * (0.5 * delay)) as f32;
    }
    for i in 0..BATCH {
        let mut largest = 0.0_f32;
        for k in 1..N_KEYS {
            let step = |axis: usize| points[k][3][axis][i] - points[k - 1][3][axis][i];
            let (x, y, z) = (step(0), step(1), step(2));
            let per_u = (1.0 / (KEYS_U[k] - KEYS_U[k - 1])) as f32;
            largest = largest.max((x * x + y * y + z * z).sqrt() * per_u);
        }
        fit.per_m[i] = (1.0 / ranges[N_KEYS / 2][3][i]) as f32;
        fit.turn_rad[i] = largest * fit.per_m[i];
    }
    for (axis, direction) in [0, 2].into_iter().zip(&mut fit.direction) {
        for i in 0..BATCH {
            let of_key = |k: usize| f64::from(points[k][3][axis][i]) / ranges[k][3][i];
            let c = quartic([of_key(0), of_key(1), of_key(2), of_key(3), of_key(4)]);
            for p in 0..N_KEYS {
                direction[p][i] = c[p] as f32;
            }
        }
    }
    // Two-way wave number in turns.
    let turns_per_m = 2.0 / link.wavelength_m;
    for corner in 0..3 {
        for i in 0..BATCH {
            let relative = quartic([
                turns_per_m * (ranges[0][corner][i] - ranges[0][3][i]),
                turns_per_m * (ranges[1][corner][i] - ranges[1][3][i]),
                turns_per_m * (ranges[2][corner][i] - ranges[2][3][i]),
                turns_per_m * (ranges[3][corner][i] - ranges[3][3][i]),
                turns_per_m * (ranges[4][corner][i] - ranges[4][3][i]),
            ]);
            for p in 0..N_KEYS {
                fit.corners[corner][p][i] = relative[p] as f32;
            }
            let largest = &mut fit.corner_turns_per_u[i];
            *largest = largest.max(max_slope(relative.map(|c| c as f32)));
        }
    }
    fit
}
