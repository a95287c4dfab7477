//! Slow time at a few nodes: sources of like radial velocity share Doppler groups.
//!
//! Within a group of centre frequency F, every source's slow-time signal times `exp(-j 2 pi F t)`
//! is narrow-band, so it need be spread only at a few nodes of the segment; the group's whole range
//! grid is then interpolated to every loop and turned back by `exp(j 2 pi F t)`. Acceleration and
//! rotation widen a source's band, which puts it on a finer level; the finest takes anything. Levels
//! are many, so that no source is spread much more often than it must; where few sources need a
//! level, they join those of the next one, since every group has its own interpolation.
//! TDM slots share the nodes, each slot shifted by its own delay.
//!
//! A signal of time-bandwidth product B over an interval has about B degrees of freedom there, and a
//! few more for every 20 dB of accuracy. Nodes spaced as Chebyshev's, denser towards the ends, come
//! near that count and stay inside the segment, where the sources' polynomials hold. Equidistant
//! nodes would need margins beyond both ends instead: 23 for a B of 7 rather than 15.

use std::f64::consts::PI;

/// Most nodes of a block.
pub(crate) const MOST_NODES: usize = 32;
/// Loops that are interpolated together.
pub(crate) const QUAD: usize = 4;
/// Nodes, and the time-bandwidth product that they carry with an error below -68 dB (4e-4).
const LEVELS: [(usize, f64); 9] = [
    (8, 2.5),
    (10, 3.8),
    (12, 5.3),
    (14, 6.7),
    (16, 8.2),
    (18, 9.7),
    (22, 12.8),
    (26, 15.7),
    (32, 18.5),
];
/// Distance of the groups' centre frequencies, turns per unit of u: 1.9 cycles over a segment, which is two units.
pub(crate) const SPACING_TURNS_PER_U: f64 = 0.95;
/// The outermost nodes lie at this share of the way to the ends.
const STRETCH: f64 = 0.98;

/// One density of nodes.
pub(crate) struct Level {
    /// Loops of one block: a source is spread, and a group interpolated, block by block.
    pub block_loops: usize,
    /// Half of the usable band around a group's centre, Hz.
    pub half_width_hz: f64,
    /// Loop coordinates of the nodes, counted from the block's first loop.
    pub nodes: Vec<f64>,
    /// Weights of every node in four consecutive loops, `[loop / 4][node]`; empty where loops are
    /// nodes.
    weights: Vec<[f32; QUAD]>,
}

impl Level {
    /// Levels for a segment of `n_loops` loops, coarsest first; the last takes anything.
    pub fn all(n_loops: usize, loop_period_s: f64) -> Vec<Self> {
        let coarse = LEVELS
            .into_iter()
            .filter(|&(n_nodes, _)| n_loops >= 2 * n_nodes)
            .map(|(n_nodes, cycles)| {
                let half_band = 0.5 * cycles / (n_loops - 1) as f64;
                let nodes = nodes(n_nodes, n_loops);
                Self {
                    block_loops: n_loops,
                    half_width_hz: half_band / loop_period_s,
                    weights: weights(&nodes, n_loops, half_band),
                    nodes,
                }
            });
        let block_loops = n_loops.min(MOST_NODES);
        coarse
            .chain([Self {
                block_loops,
                half_width_hz: 0.5 / loop_period_s,
                nodes: (0..block_loops).map(|l| l as f64).collect(),
                weights: Vec::new(),
            }])
            .collect()
    }

    /// Whether loops are nodes, without interpolation.
    pub fn is_direct(&self) -> bool {
        self.weights.is_empty()
    }

    /// Number of nodes for a block of `n_loops`; only blocks of loops that are nodes may be short.
    pub fn n_nodes(&self, n_loops: usize) -> usize {
        if self.is_direct() {
            n_loops
        } else {
            self.nodes.len()
        }
    }

    /// Weights by node of the loops `QUAD * quad..`.
    pub fn weights(&self, quad: usize) -> &[[f32; QUAD]] {
        &self.weights[quad * self.nodes.len()..][..self.nodes.len()]
    }
}

/// Loop coordinates of `n` Chebyshev nodes over the loops `0..n_loops`.
fn nodes(n: usize, n_loops: usize) -> Vec<f64> {
    let half = 0.5 * (n_loops - 1) as f64;
    let angle = |i: f64| (PI * (i + 0.5) / n as f64).cos();
    (0..n)
        .map(|i| half * (1.0 - STRETCH * angle(i as f64) / angle(0.0)))
        .collect()
}

/// Least-squares weights that interpolate from `nodes` to every loop over the band
/// |f| <= `half_band`, cycles per loop.
fn weights(nodes: &[f64], n_loops: usize, half_band: f64) -> Vec<[f32; QUAD]> {
    let sinc = |x: f64| {
        if x == 0.0 {
            1.0
        } else {
            (PI * x).sin() / (PI * x)
        }
    };
    let n = nodes.len();
    let mut rows: Vec<Vec<f64>> = nodes
        .iter()
        .enumerate()
        .map(|(i, &x)| {
            let mut row: Vec<f64> = nodes
                .iter()
                .map(|y| sinc(2.0 * half_band * (x - y)))
                .collect();
            // Keeps the nearly singular system from buying 1e-6 of accuracy with weights of 10.
            row[i] += 1e-10;
            row.extend((0..n_loops).map(|l| sinc(2.0 * half_band * (x - l as f64))));
            row
        })
        .collect();
    solve(&mut rows);
    (0..n_loops.div_ceil(QUAD))
        .flat_map(|quad| {
            let rows = &rows;
            (0..n).map(move |node| {
                std::array::from_fn(|i| {
                    // Loops beyond the last are computed and thrown away.
                    let l = (QUAD * quad + i).min(n_loops - 1);
                    rows[node][n + l] as f32
                })
            })
        })
        .collect()
}

/// Gauss-Jordan elimination with partial pivoting: leaves the solutions in the columns beyond the
/// square part.
pub(crate) fn solve(rows: &mut [Vec<f64>]) {
    let n = rows.len();
    for col in 0..n {
        let pivot = (col..n)
            .max_by(|&a, &b| rows[a][col].abs().total_cmp(&rows[b][col].abs()))
            .unwrap_or(col);
        rows.swap(col, pivot);
        let lead = rows[col][col];
        rows[col].iter_mut().for_each(|x| *x /= lead);
        let lead = rows[col].clone();
        for (r, row) in rows.iter_mut().enumerate() {
            if r != col {
                let factor = row[col];
                for (x, l) in row.iter_mut().zip(&lead) {
                    *x -= factor * l;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use num_complex::Complex64;

    #[test]
    fn interpolation_is_better_than_68_db_over_the_band() {
        for n_loops in [20, 37, 44, 128] {
            for level in Level::all(n_loops, 1.0) {
                if level.is_direct() {
                    continue;
                }
                let inside = 0.0..=(n_loops - 1) as f64;
                assert!(level.nodes.iter().all(|x| inside.contains(x)));
                for l in 0..n_loops {
                    let w = level.weights(l / QUAD);
                    for i in -100..=100 {
                        let turn = 2.0 * PI * level.half_width_hz * f64::from(i) / 100.0;
                        let sum: Complex64 = (level.nodes.iter().zip(w))
                            .map(|(x, w)| Complex64::from_polar(f64::from(w[l % QUAD]), turn * x))
                            .sum();
                        let exact = Complex64::from_polar(1.0, turn * l as f64);
                        let error = (sum - exact).norm();
                        assert!(
                            error < 4e-4,
                            "{n_loops} loops, {} nodes, loop {l}, {i} %: {error}",
                            level.nodes.len()
                        );
                    }
                }
            }
        }
    }
}
