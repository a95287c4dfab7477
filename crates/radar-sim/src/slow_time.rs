//! Slow-time sampling at a few nodes. Sources of similar radial velocity share Doppler groups.
//!
//! Within a group with the reference phase P(t), a parabola, every source's slow-time signal times `exp(-j 2 pi P(t))`
//! is narrow-band. It therefore has to be spread only at a few nodes of the segment. The range grid of the group is
//! then interpolated to every loop and multiplied by `exp(j 2 pi P(t))`. Rotation and jerk widen the band of a source,
//! which then requires a level with more nodes. In the last level every loop is a node, so that it supports any band.
//! There are many levels, so that no source is spread more often than necessary. TDM slots share the nodes, each slot
//! shifted by its own delay.
//!
//! A signal of time-bandwidth product B over an interval has about B degrees of freedom there, and a few more for every
//! 20 dB of accuracy. Chebyshev nodes, which are denser towards the ends, come close to that number. They are inside
//! the segment, where the sources' polynomials are valid. Equidistant nodes would need margins beyond both ends: 23
//! nodes instead of 15 for a B of 7.

use std::f64::consts::PI;

/// Maximum number of nodes of a block.
pub(crate) const MAX_NODES: usize = 32;
/// Number of loops that are interpolated together.
pub(crate) const QUAD: usize = 4;
/// Numbers of nodes, and the time-bandwidth products that they represent with an error below -68 dB (4e-4).
const LEVELS: [(usize, f64); 21] = [
    (4, 0.445),
    (5, 0.87),
    (6, 1.37),
    (7, 1.96),
    (8, 2.58),
    (9, 3.25),
    (10, 3.93),
    (11, 4.64),
    (12, 5.36),
    (13, 6.08),
    (14, 6.82),
    (15, 7.57),
    (16, 8.32),
    (18, 9.83),
    (20, 11.35),
    (22, 12.88),
    (24, 14.37),
    (26, 15.8),
    (28, 16.8),
    (30, 18.3),
    (32, 19.8),
];
/// Distance of the outermost nodes from the middle of the segment, as a fraction of the distance of its ends.
const STRETCH: f64 = 0.98;

/// One density of nodes.
pub(crate) struct Level {
    /// Number of loops of a block. Sources are spread, and groups are interpolated, block by block.
    pub block_loops: usize,
    /// Half of the usable band around a group's centre, Hz.
    pub half_width_hz: f64,
    /// Loop coordinates of the nodes, counted from the block's first loop.
    pub nodes: Vec<f64>,
    /// Weights of every node in four consecutive loops, `[loop / 4][node]`. Empty if the loops themselves are the
    /// nodes.
    weights: Vec<[f32; QUAD]>,
    /// The same for the nodes of every level except the last.
    between: Vec<Vec<[f32; QUAD]>>,
}

impl Level {
    /// Levels for a segment of `n_loops` loops, coarsest first. The last one supports any band.
    pub(crate) fn all(n_loops: usize, loop_period_s: f64) -> Vec<Self> {
        let usable = LEVELS.into_iter().filter(|&(n, _)| n_loops >= 2 * n);
        let all_nodes: Vec<Vec<f64>> = usable.clone().map(|(n, _)| nodes(n, n_loops)).collect();
        let loops: Vec<f64> = (0..n_loops).map(|l| l as f64).collect();
        let coarse = usable.zip(&all_nodes).map(|((_, cycles), nodes)| {
            let half_band = 0.5 * cycles / (n_loops - 1) as f64;
            let places: Vec<&[f64]> = [&loops[..]]
                .into_iter()
                .chain(all_nodes.iter().map(|n| &n[..]))
                .collect();
            let mut weights = weights(nodes, &places, half_band);
            Self {
                block_loops: n_loops,
                half_width_hz: half_band / loop_period_s,
                between: weights.split_off(1),
                weights: weights.swap_remove(0),
                nodes: nodes.clone(),
            }
        });
        let block_loops = n_loops.min(MAX_NODES);
        coarse
            .chain([Self {
                block_loops,
                half_width_hz: 0.5 / loop_period_s,
                nodes: (0..block_loops).map(|l| l as f64).collect(),
                weights: Vec::new(),
                between: Vec::new(),
            }])
            .collect()
    }

    /// Whether the loops themselves are the nodes, so that there is no interpolation.
    pub(crate) fn is_direct(&self) -> bool {
        self.weights.is_empty()
    }

    /// Number of nodes for a block of `n_loops`. Only blocks whose loops are the nodes may be shorter than the others.
    pub(crate) fn n_nodes(&self, n_loops: usize) -> usize {
        if self.is_direct() {
            n_loops
        } else {
            self.nodes.len()
        }
    }

    /// Weights by node for the loops from `QUAD * quad` on, or for those nodes of another level.
    pub(crate) fn weights(&self, to: Option<usize>, quad: usize) -> &[[f32; QUAD]] {
        let weights = to.map_or(&self.weights, |level| &self.between[level]);
        &weights[quad * self.nodes.len()..][..self.nodes.len()]
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

/// Least-squares weights that interpolate from `nodes` over the band |f| <= `half_band`, cycles per loop, to each list
/// of `places` (loop coordinates).
fn weights(nodes: &[f64], places: &[&[f64]], half_band: f64) -> Vec<Vec<[f32; QUAD]>> {
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
            let to = nodes.iter().chain(places.iter().copied().flatten());
            let mut row: Vec<f64> = to.map(|y| sinc(2.0 * half_band * (x - y))).collect();
            // Regularisation. Without it, weights of 10 would improve the accuracy of the nearly singular system by
            // only 1e-6.
            row[i] += 1e-10;
            row
        })
        .collect();
    solve(&mut rows);
    let mut first = n;
    places
        .iter()
        .map(|places| {
            let from = first;
            first += places.len();
            (0..places.len().div_ceil(QUAD))
                .flat_map(|quad| {
                    let rows = &rows;
                    (0..n).map(move |node| {
                        std::array::from_fn(|i| {
                            // Positions beyond the last one are computed but not used.
                            rows[node][from + (QUAD * quad + i).min(places.len() - 1)] as f32
                        })
                    })
                })
                .collect()
        })
        .collect()
}

/// Gauss-Jordan elimination with partial pivoting. The columns beyond the square part become the solutions.
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
            let levels = Level::all(n_loops, 1.0);
            for level in &levels {
                if level.is_direct() {
                    continue;
                }
                let inside = 0.0..=(n_loops - 1) as f64;
                assert!(level.nodes.iter().all(|x| inside.contains(x)));
                let loops: Vec<f64> = (0..n_loops).map(|l| l as f64).collect();
                // Interpolation to the loops, and to the nodes of the finest level.
                let finest = levels.len() - 2;
                for (to, places) in [(None, &loops), (Some(finest), &levels[finest].nodes)] {
                    for (k, place) in places.iter().enumerate() {
                        let w = level.weights(to, k / QUAD);
                        for i in -100..=100 {
                            let turn = 2.0 * PI * level.half_width_hz * f64::from(i) / 100.0;
                            let sum: Complex64 = (level.nodes.iter().zip(w))
                                .map(|(x, w)| {
                                    Complex64::from_polar(f64::from(w[k % QUAD]), turn * x)
                                })
                                .sum();
                            let exact = Complex64::from_polar(1.0, turn * place);
                            let error = (sum - exact).norm();
                            assert!(
                                error < 4e-4,
                                "{n_loops} loops, {} nodes, place {place}, {i} %: {error}",
                                level.nodes.len()
                            );
                        }
                    }
                }
            }
        }
    }
}
