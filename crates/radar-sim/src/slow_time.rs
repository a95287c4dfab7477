//! Slow time on a coarse grid: sources of like radial velocity share Doppler groups.
//!
//! Within a group of centre frequency F, every source's slow-time signal times `exp(-j 2 pi F t)`
//! is narrow-band, so it need be spread only every `step` loops; the group's whole range grid is
//! then interpolated to every loop and turned back by `exp(j 2 pi F t)`. Acceleration and rotation
//! widen a source's band, which puts it on a finer level; the finest, `step` 1, takes anything.
//! TDM slots are interleaved grids of the same spacing, each sampled at its own times.

use std::f64::consts::PI;

use crate::gridding::solve;

/// Nodes used to interpolate one loop.
pub(crate) const TAPS: usize = 8;
/// Nodes before the first loop.
pub(crate) const LEAD: usize = TAPS / 2 - 1;
/// Half of the band in cycles per node for which the interpolation is designed. At 0.22 (2.3-fold
/// oversampling) eight least-squares taps leave -69 dB.
const HALF_BAND: f64 = 0.22;
/// Node spacings in loops, coarsest first.
const STEPS: [usize; 5] = [16, 8, 4, 2, 1];
/// Nodes of one block at most, besides the interpolation's margins.
const MOST_STEPS: usize = 32;

/// One spacing.
pub(crate) struct Level {
    /// Loops from node to node.
    pub step: usize,
    /// Loops of one block: a source is spread, and a group interpolated, block by block.
    pub block_loops: usize,
    /// Half of the usable band around a group's centre, Hz.
    pub half_width_hz: f64,
    /// Weights of the eight nodes around a loop, by loop index modulo `step`.
    pub weights: Vec<[f32; TAPS]>,
}

impl Level {
    /// Levels for segments of `segment_loops` loops, coarsest first; the last takes anything.
    pub fn all(segment_loops: usize, loop_period_s: f64) -> Vec<Self> {
        STEPS
            .into_iter()
            .filter(|&step| step == 1 || segment_loops > 2 * step)
            .map(|step| Self {
                step,
                block_loops: (step * MOST_STEPS).min(segment_loops),
                half_width_hz: HALF_BAND / (step as f64 * loop_period_s),
                weights: (0..step).map(|i| weights(i as f64 / step as f64)).collect(),
            })
            .collect()
    }

    /// Whether loops are nodes, without interpolation.
    pub fn is_direct(&self) -> bool {
        self.step == 1
    }

    /// Number of nodes for a block of `n_loops`.
    pub fn n_nodes(&self, n_loops: usize) -> usize {
        if self.is_direct() {
            n_loops
        } else {
            (n_loops - 1) / self.step + TAPS
        }
    }

    /// Loop coordinate of node `node` of a block that starts at loop 0.
    pub fn loop_of(&self, node: usize) -> f64 {
        if self.is_direct() {
            node as f64
        } else {
            (node as f64 - LEAD as f64) * self.step as f64
        }
    }

    /// Loop coordinate of the last node of the last block of `n_loops` loops.
    pub fn last_node_loop(&self, n_loops: usize) -> f64 {
        let last_block = n_loops - (n_loops - 1) % self.block_loops - 1;
        let nodes = self.n_nodes(n_loops - last_block);
        last_block as f64 + self.loop_of(nodes - 1)
    }
}

/// Least-squares weights that interpolate at `fraction` between nodes 3 and 4 of 0..8, over the band
/// |f| <= [`HALF_BAND`]. At 0 they are a unit vector.
fn weights(fraction: f64) -> [f32; TAPS] {
    let mut weights = [0.0; TAPS];
    if fraction == 0.0 {
        weights[LEAD] = 1.0;
        return weights;
    }
    let sinc = |x: f64| {
        if x == 0.0 {
            1.0
        } else {
            (PI * x).sin() / (PI * x)
        }
    };
    let x = LEAD as f64 + fraction;
    let mut rows = [[0.0; 9]; 8];
    for (i, row) in rows.iter_mut().enumerate() {
        for (j, value) in row[..8].iter_mut().enumerate() {
            *value = sinc(2.0 * HALF_BAND * (i as f64 - j as f64));
        }
        // Keeps the nearly singular system from buying 1e-6 of accuracy with weights of 10.
        row[i] += 1e-10;
        row[8] = sinc(2.0 * HALF_BAND * (x - i as f64));
    }
    for (weight, solution) in weights.iter_mut().zip(solve(&mut rows)) {
        *weight = solution as f32;
    }
    weights
}

#[cfg(test)]
mod tests {
    use super::*;
    use num_complex::Complex64;

    #[test]
    fn interpolation_is_better_than_68_db_over_the_band() {
        for sixteenth in 0..16 {
            let fraction = f64::from(sixteenth) / 16.0;
            let w = weights(fraction);
            for i in -100..=100 {
                let turn = 2.0 * PI * HALF_BAND * f64::from(i) / 100.0;
                let sum: Complex64 = (0..TAPS)
                    .map(|k| Complex64::from_polar(f64::from(w[k]), turn * k as f64))
                    .sum();
                let exact = Complex64::from_polar(1.0, turn * (LEAD as f64 + fraction));
                assert!(
                    (sum - exact).norm() < 4e-4,
                    "{fraction} {i} {}",
                    (sum - exact).norm()
                );
            }
        }
    }
}
