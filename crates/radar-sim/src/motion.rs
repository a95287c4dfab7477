//! Sources as polynomials of time over a segment of the frame.
//!
//! Vertices are evaluated at five Chebyshev key times. Distances and phases follow quartics through them, and gains
//! follow parabolas through three of them. For a limb at 50 m/s^2 with a jerk of 1000 m/s^3 and a fifth derivative of
//! 1e5 m/s^5, the error over 30 ms is 1e-4 rad.

use std::f64::consts::TAU;

use glam::{DVec3, Vec3};
use num_complex::Complex64;
use radarllm_base::{RadarConfig, SPEED_OF_LIGHT_MPS};

use crate::scatter::divided_difference;

/// Maximum duration of a segment, which one set of polynomials describes, s.
const LONGEST_SEGMENT_S: f64 = 0.03;
/// Maximum number of loops in a segment (bounds the workspace).
const MAX_SEGMENT_LOOPS: usize = 128;
/// Key times per segment.
pub(crate) const N_KEYS: usize = 5;
/// The outer and the inner key times of either side, in units of `u`. With Chebyshev times the error for a smooth path
/// is half of that with equidistant times. The fifth key time is 0.
const OUTER_U: f64 = 0.951_056_516_295_153_5;
const INNER_U: f64 = 0.587_785_252_292_473_1;
/// All key times, in units of `u`.
pub(crate) const KEYS_U: [f64; N_KEYS] = [-OUTER_U, -INNER_U, 0.0, INNER_U, OUTER_U];

/// A run of consecutive loops with its own visibility and polynomials. Its unit of time `u` runs
/// from -1 at the first chirp to 1 at the last; polynomials are in `u`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Segment {
    pub first_loop: usize,
    pub n_loops: usize,
    /// Centre of the segment after the frame start, s.
    pub centre_s: f64,
    /// Half of its length, s.
    pub half_s: f64,
    loop_period_s: f64,
}

impl Segment {
    /// Loops per segment for `config`.
    pub(crate) fn loops_of(config: &RadarConfig) -> usize {
        // 1 ppm of tolerance: 30 ms of loops that fit exactly must not round down.
        let fit = (LONGEST_SEGMENT_S / config.loop_period_s() * 1.000_001) as usize;
        fit.clamp(8, MAX_SEGMENT_LOOPS).min(config.n_loops)
    }

    /// All segments of a frame.
    pub(crate) fn all(config: &RadarConfig) -> Vec<Self> {
        let step = Self::loops_of(config);
        (0..config.n_loops)
            .step_by(step)
            .map(|first_loop| Self::new(config, first_loop, step.min(config.n_loops - first_loop)))
            .collect()
    }

    /// The first loop of a frame alone.
    pub(crate) fn of_one_loop(config: &RadarConfig) -> Self {
        Self::new(config, 0, 1)
    }

    fn new(config: &RadarConfig, first_loop: usize, n_loops: usize) -> Self {
        let first_s = chirp_time_s(config, first_loop, 0);
        let last_s = chirp_time_s(config, first_loop + n_loops - 1, config.tx.len() - 1);
        Self {
            first_loop,
            n_loops,
            centre_s: 0.5 * (first_s + last_s),
            // A single chirp has no length, but polynomials need a unit.
            half_s: (0.5 * (last_s - first_s)).max(0.5 * config.chirp_period_s()),
            loop_period_s: config.loop_period_s(),
        }
    }

    /// Key times after the frame start, s.
    pub(crate) fn key_times_s(&self) -> [f64; N_KEYS] {
        KEYS_U.map(|u| self.centre_s + self.half_s * u)
    }

    /// `u` of TX slot 0 of a (fractional) loop, counted from the segment's first loop.
    pub(crate) fn unit_time(&self, first_chirp_s: f64, loop_coordinate: f64) -> f64 {
        (first_chirp_s + loop_coordinate * self.loop_period_s - self.centre_s) / self.half_s
    }
}

/// Time at which targets are evaluated for (loop, TX slot): the centre of its ADC window, relative to the frame start,
/// s.
pub(crate) fn chirp_time_s(config: &RadarConfig, loop_idx: usize, tx_idx: usize) -> f64 {
    config.ramp_start_s(loop_idx, tx_idx)
        + config.adc_start_s
        + (config.n_samples / 2) as f64 / config.sample_rate_hz
}

/// Coefficients of the quartic through values at the key times.
#[inline(always)]
pub(crate) fn quartic(v: [f64; N_KEYS]) -> [f64; N_KEYS] {
    let [to_odd, to_even] = QUARTIC;
    // Odd and even parts at the inner and the outer keys.
    let odd = [0.5 * (v[3] - v[1]), 0.5 * (v[4] - v[0])];
    let even = [0.5 * (v[1] + v[3]) - v[2], 0.5 * (v[0] + v[4]) - v[2]];
    let apply = |m: [f64; 2], x: [f64; 2]| m[0] * x[0] + m[1] * x[1];
    [
        v[2],
        apply(to_odd[0], odd),
        apply(to_even[0], even),
        apply(to_odd[1], odd),
        apply(to_even[1], even),
    ]
}

/// Matrices that [`quartic`] applies to odd parts (rows for u and u^3) and even parts (rows for u^2 and u^4).
pub(crate) const QUARTIC: [[[f64; 2]; 2]; 2] = {
    let (a2, b2) = (INNER_U * INNER_U, OUTER_U * OUTER_U);
    let d = b2 - a2;
    [
        [
            [b2 / (INNER_U * d), -a2 / (OUTER_U * d)],
            [-1.0 / (INNER_U * d), 1.0 / (OUTER_U * d)],
        ],
        [
            [b2 / (a2 * d), -a2 / (b2 * d)],
            [-1.0 / (a2 * d), 1.0 / (b2 * d)],
        ],
    ]
};

/// Coefficients of the parabola through values at the outer key times and the middle one.
#[inline(always)]
pub(crate) fn parabola(v: [f32; 3]) -> [f32; 3] {
    const ODD: f32 = (0.5 / OUTER_U) as f32;
    const EVEN: f32 = (1.0 / (OUTER_U * OUTER_U)) as f32;
    [
        v[1],
        ODD * (v[2] - v[0]),
        EVEN * (0.5 * (v[0] + v[2]) - v[1]),
    ]
}

/// Upper bound of the derivative of a polynomial for |u| <= 1.
#[inline(always)]
pub(crate) fn max_slope(c: [f32; N_KEYS]) -> f32 {
    c[1].abs() + 2.0 * c[2].abs() + 3.0 * c[3].abs() + 4.0 * c[4].abs()
}

/// One facet or point over a segment.
#[derive(Clone, Debug)]
pub(crate) struct Source {
    /// Phase of the reference channel (both antennas at the array centre) at the ADC centre, turns.
    pub turns: [f64; N_KEYS],
    /// Position on the range grid, cells, folded into 0..M at u = 0.
    pub cells: [f32; N_KEYS],
    /// Phases of the three corners relative to `turns`, turns.
    pub corners: [[f32; N_KEYS]; 3],
    /// Upper bound of their derivatives for |u| <= 1, turns per unit of u.
    pub corner_turns_per_u: f32,
    /// Gain of the physical-optics term, sqrt(W).
    pub coherent: [f32; 3],
    /// Gain of the constant-phase term, sqrt(W).
    pub rough: [f32; 3],
    /// Upper bound of the amplitude's derivative for |u| <= 1, sqrt(W) per unit of u. The phases of the corners are
    /// those at u = 0.
    pub change_per_u: f32,
    /// cos and sin of the constant phase.
    pub rough_phasor: [f32; 2],
    /// Apparent position of the centroid for the receivers at the key times, relative to the array centre, m.
    pub from_centre: [Vec3; N_KEYS],
    /// Upper bound of its speed divided by its range, per unit of u. This bounds the rotation of its direction, rad,
    /// and the change of the logarithm of its range.
    pub turn_rad: f32,
    /// Reciprocal of its range at u = 0, 1/m.
    pub per_m: f32,
    /// x and z of the unit vector towards it, as quartics.
    pub direction: [[f32; N_KEYS]; 2],
    /// Whether the channels' path differences are those of a plane wave plus a constant, that is, whether the change of
    /// the wavefront curvature over the segment is negligible.
    pub is_flat: bool,
    /// Upper bound of a channel's distance from the reference position, cells.
    pub reach_cells: f32,
    /// Index of the transmitters' apparent positions, if these differ from the receivers' (a path over mirrors).
    pub tx_row: Option<u32>,
    /// d(phase) / d(path length) in turns per metre, the residual video phase included.
    pub turns_per_m: f32,
}

/// Constants that convert delays to phases and grid positions.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RangeScale {
    pub centre_hz: f64,
    pub slope_hz_per_s: f64,
    /// Grid cells per second of delay.
    pub cells_per_s: f64,
    /// Grid cells.
    pub n_cells: usize,
    /// f_c / S in units of `u`. A delay that changes at a rate tau' shifts the beat frequency by f_c tau'. To first
    /// order, the grid position is then that of a time f_c / S later.
    pub advance_u: f64,
}

impl RangeScale {
    /// Phase of a path of `tau_s` at the ADC centre, turns: f_c tau - S tau^2 / 2.
    #[inline(always)]
    pub(crate) fn turns(&self, tau_s: f64) -> f64 {
        (self.centre_hz - 0.5 * self.slope_hz_per_s * tau_s) * tau_s
    }

    /// Polynomial of the position on the range grid, folded at u = 0, from that of the delay in s.
    #[inline(always)]
    pub(crate) fn cells(&self, tau_s: [f64; N_KEYS]) -> [f64; N_KEYS] {
        let [a, b, c, d, e] = tau_s.map(|c| c * self.cells_per_s);
        let later = self.advance_u;
        let mut cells = [
            a + later * b,
            b + later * 2.0 * c,
            c + later * 3.0 * d,
            d + later * 4.0 * e,
            e,
        ];
        let n = self.n_cells as f64;
        cells[0] -= (cells[0] / n).floor() * n;
        cells
    }

    /// A source from its phase centre, relative to the array centre, at the key times.
    pub(crate) fn source(&self, from_centre: [DVec3; N_KEYS]) -> Source {
        self.source_between(&from_centre, &from_centre)
    }

    /// A source with different apparent positions for transmitters and receivers. The caller sets [`Source::tx_row`].
    pub(crate) fn source_between(&self, tx: &[DVec3; N_KEYS], rx: &[DVec3; N_KEYS]) -> Source {
        let tau_s: [f64; N_KEYS] =
            std::array::from_fn(|k| (tx[k].length() + rx[k].length()) / SPEED_OF_LIGHT_MPS);
        let cells = self.cells(quartic(tau_s));
        let turn = |p: &[DVec3; N_KEYS]| {
            let steps = p.windows(2).zip(KEYS_U.windows(2));
            let speeds = steps.map(|(p, u)| p[0].distance(p[1]) / (u[1] - u[0]));
            speeds.fold(0.0, f64::max) / p[2].length()
        };
        Source {
            turns: quartic(tau_s.map(|t| self.turns(t))),
            cells: cells.map(|c| c as f32),
            corners: [[0.0; N_KEYS]; 3],
            corner_turns_per_u: 0.0,
            coherent: [0.0; 3],
            rough: [0.0; 3],
            change_per_u: 0.0,
            rough_phasor: [1.0, 0.0],
            from_centre: rx.map(|p| p.as_vec3()),
            turn_rad: turn(tx).max(turn(rx)) as f32,
            per_m: (1.0 / rx[N_KEYS / 2].length()) as f32,
            direction: [
                quartic(rx.map(|p| p.x / p.length())),
                quartic(rx.map(|p| p.z / p.length())),
            ]
            .map(|c| c.map(|c| c as f32)),
            is_flat: false,
            reach_cells: 0.0,
            tx_row: None,
            turns_per_m: ((self.centre_hz - self.slope_hz_per_s * tau_s[2]) / SPEED_OF_LIGHT_MPS)
                as f32,
        }
    }
}

impl Source {
    /// Apparent positions for the transmitters. `rows` are all those of the frame that differ from the receivers'.
    #[inline(always)]
    pub(crate) fn seen_by_tx<'a>(&'a self, rows: &'a [[Vec3; N_KEYS]]) -> &'a [Vec3; N_KEYS] {
        self.tx_row
            .and_then(|row| rows.get(row as usize))
            .unwrap_or(&self.from_centre)
    }

    /// Power at u = 0, W.
    pub(crate) fn power_w(&self) -> f64 {
        let corners = self.corners.map(|c| TAU * f64::from(c[0]));
        let coherent = f64::from(self.coherent[0]) * divided_difference(corners);
        let [re, im] = self.rough_phasor.map(f64::from);
        (coherent + f64::from(self.rough[0]) * Complex64::new(re, im)).norm_sqr()
    }

    /// Sets [`Self::change_per_u`] from the gains and an upper bound of the divided difference's derivative.
    #[inline(always)]
    pub(crate) fn bound_change(&mut self, max_divided_slope: f32) {
        let slope = |c: [f32; 3]| c[1].abs() + 2.0 * c[2].abs();
        self.change_per_u = self.coherent[0].abs() * max_divided_slope
            + 0.5 * slope(self.coherent)
            + slope(self.rough);
    }

    /// Upper bound of the difference between the corners' frequencies and the frequency of the parabola in `turns` for
    /// |u| <= 1, turns per unit of u.
    #[inline]
    pub(crate) fn rest_turns_per_u(&self) -> f32 {
        self.corner_turns_per_u + (3.0 * self.turns[3].abs() + 4.0 * self.turns[4].abs()) as f32
    }

    /// Interval of grid positions for |u| <= `reach`, cells.
    #[inline]
    pub(crate) fn cell_range(&self, reach: f32) -> (f32, f32) {
        let c = &self.cells;
        let width =
            reach * (c[1].abs() + reach * (c[2].abs() + reach * (c[3].abs() + reach * c[4].abs())));
        (c[0] - width, c[0] + width)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn polynomials_pass_through_their_values() {
        let p = |c: &[f64], u: f64| c.iter().rev().fold(0.0, |s, &c| s * u + c);
        let values = [0.3, -1.0, 2.0, 0.7, 5.0];
        let c = quartic(values);
        for (u, v) in KEYS_U.into_iter().zip(values) {
            assert!((p(&c, u) - v).abs() < 1e-14);
        }
        let c = parabola([1.0, 4.0, -2.0]);
        for (u, v) in [(-OUTER_U, 1.0), (0.0, 4.0), (OUTER_U, -2.0)] {
            let c = c.map(f64::from);
            assert!((p(&c, u) - v).abs() < 1e-6);
        }
    }

    #[test]
    fn the_reference_frame_is_one_segment_and_long_frames_are_cut() {
        assert_eq!(Segment::all(&RadarConfig::awr1843boost()).len(), 1);
        let long = RadarConfig {
            n_loops: 400,
            ..RadarConfig::awr1843boost()
        };
        let segments = Segment::all(&long);
        assert_eq!(segments.iter().map(|s| s.n_loops).sum::<usize>(), 400);
        assert!(segments.iter().all(|s| 2.0 * s.half_s <= LONGEST_SEGMENT_S));
    }
}
