//! Spreads sources onto the range grid: the inner loops of the fast path.
//!
//! This is a non-uniform FFT in two dimensions. In range, a source is between grid cells and is spread over six of them
//! with the taps of a kernel. The range transform divides the kernel's shape out again. In slow time, sources of
//! similar Doppler form a group, whose common phase is removed. The residual changes so slowly that a few nodes
//! represent all loops.
//!
//! A frame of a person has some 8,000 sources. The two loops that process each source at each node take most of the
//! simulator's time: [`fill_phasors`] and [`Batch::add_compact`]. The design optimises these loops:
//! - SIMD lanes are channels, sixteen at a time, because all channels of a source need the same operations with
//!   slightly different numbers.
//! - Sources are processed in batches whose phasors fit into the first-level cache. The two loops can then run
//!   separately, each with its own registers.
//! - Sources of a group are sorted by range, so that the sums of six cells remain in registers over several sources.
//!
//! Per node, the phase of a channel is the reference phase plus a quartic for the channel's path difference and TDM
//! delay. Groups are then interpolated to the nodes of their family, and families to the loops.

use glam::Vec3;

use crate::gridding::{Kernel, NARROW_CELLS, SLACK_CELLS, Taps, WIDTH};
use crate::groups::{Family, Group, GroupGrid};
use crate::motion::{N_KEYS, QUARTIC, Source, max_slope};
use crate::slow_time::{Level, MAX_NODES, QUAD};
use radarllm_simd::{Cell, LANES, SimdF32x16, dispatch, prefetch, sin_cos_turns};

/// The channels of one pass, at most one per SIMD lane.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(crate) struct ChannelBlock {
    /// TX offsets from the array centre, m.
    tx_x: [f32; LANES],
    tx_z: [f32; LANES],
    /// RX offsets from the array centre, m.
    rx_x: [f32; LANES],
    rx_z: [f32; LANES],
    /// Squares of the offsets' lengths, m^2.
    tx_square: [f32; LANES],
    rx_square: [f32; LANES],
    /// Delay of the lane's TDM slot, s.
    slot_s: [f32; LANES],
    /// Delay of the lane's slot divided by that of the last slot, 0..=1.
    slot_share: [f32; LANES],
    /// Index of the first channel, `tx * n_rx + rx`.
    pub first: usize,
    /// Number of lanes that hold channels. The remaining lanes repeat the last channel.
    pub len: usize,
    pub reach: Reach,
}

/// Maximum offsets of the channels from the array centre.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Reach {
    /// Maximum path difference of any channel, m.
    reach_m: f32,
    /// Maximum sum of a channel's TX and RX offsets along x and along z, m.
    reach_x_m: f32,
    reach_z_m: f32,
    /// Maximum TX offset and maximum RX offset along x and along z, m.
    tx_m: [f32; 2],
    rx_m: [f32; 2],
    /// Maximum slot delay, s.
    max_slot_s: f32,
}

impl ChannelBlock {
    /// All channels of a radar, sixteen at a time.
    pub(crate) fn all(config: &radarllm_base::RadarConfig, centre: glam::DVec3) -> Vec<Self> {
        let n = config.tx.len() * config.rx.len();
        (0..n)
            .step_by(LANES)
            .map(|first| {
                let len = LANES.min(n - first);
                let lane = |i: usize| {
                    let channel = first + i.min(len - 1);
                    let (tx, rx) = (channel / config.rx.len(), channel % config.rx.len());
                    (tx, config.tx[tx], config.rx[rx])
                };
                let tx_x = std::array::from_fn(|i| (lane(i).1.x_m - centre.x) as f32);
                let tx_z = std::array::from_fn(|i| (lane(i).1.z_m - centre.z) as f32);
                let rx_x = std::array::from_fn(|i| (lane(i).2.x_m - centre.x) as f32);
                let rx_z = std::array::from_fn(|i| (lane(i).2.z_m - centre.z) as f32);
                let square = |x: &[f32; LANES], z: &[f32; LANES]| {
                    std::array::from_fn(|i| x[i] * x[i] + z[i] * z[i])
                };
                let (tx_square, rx_square) = (square(&tx_x, &tx_z), square(&rx_x, &rx_z));
                let slot_s =
                    std::array::from_fn(|i| (lane(i).0 as f64 * config.chirp_period_s()) as f32);
                let reach_m = (0..LANES)
                    .map(|i: usize| tx_square[i].sqrt() + rx_square[i].sqrt())
                    .fold(0.0, f32::max);
                let max_sum = |tx: &[f32; LANES], rx: &[f32; LANES]| {
                    tx.iter()
                        .zip(rx)
                        .map(|(a, b)| (a + b).abs())
                        .fold(0.0, f32::max)
                };
                let (reach_x_m, reach_z_m) = (max_sum(&tx_x, &rx_x), max_sum(&tx_z, &rx_z));
                let none = [0.0; LANES];
                let tx_m = [&tx_x, &tx_z].map(|tx| max_sum(tx, &none));
                let rx_m = [&rx_x, &rx_z].map(|rx| max_sum(&none, rx));
                let max_slot_s = slot_s.iter().copied().fold(0.0, f32::max);
                let slot_share = slot_s.map(|s: f32| s / max_slot_s.max(f32::MIN_POSITIVE));
                Self {
                    first,
                    len,
                    tx_x,
                    tx_z,
                    rx_x,
                    rx_z,
                    tx_square,
                    rx_square,
                    slot_s,
                    slot_share,
                    reach: Reach {
                        reach_m,
                        reach_x_m,
                        reach_z_m,
                        tx_m,
                        rx_m,
                        max_slot_s,
                    },
                }
            })
            .collect()
    }
}

impl Reach {
    /// Maxima over all channels of a radar.
    pub(crate) fn of(blocks: &[ChannelBlock]) -> Self {
        blocks.iter().fold(Self::default(), |reach, block| Self {
            reach_m: reach.reach_m.max(block.reach.reach_m),
            reach_x_m: reach.reach_x_m.max(block.reach.reach_x_m),
            reach_z_m: reach.reach_z_m.max(block.reach.reach_z_m),
            tx_m: std::array::from_fn(|i| reach.tx_m[i].max(block.reach.tx_m[i])),
            rx_m: std::array::from_fn(|i| reach.rx_m[i].max(block.reach.rx_m[i])),
            max_slot_s: reach.max_slot_s.max(block.reach.max_slot_s),
        })
    }

    /// Upper bound of the frequency that the channels' path differences and delays add to a source, turns per unit of
    /// u. `ramp` is the change of the frequency.
    pub(crate) fn extra_band(&self, source: &Source, ramp: f32, half_s: f32) -> f32 {
        source.turns_per_m * self.reach_m * source.turn_rad + ramp.abs() * self.max_slot_s / half_s
    }

    /// Upper bound of the change of a source's wavefront curvature over the array for |u| <= 1, turns.
    pub(crate) fn max_bend_turns(&self, source: &Source) -> f32 {
        // The curvature term is at most a^2 / 2r for every antenna. It changes with direction and range.
        let bend_m = 0.5 * self.reach_m * self.reach_m * source.per_m;
        // The next term, a^3 / 2 r^2, is neglected entirely.
        let next_m = bend_m * self.reach_m * source.per_m;
        source.turns_per_m * (3.0 * bend_m * source.turn_rad + next_m)
    }

    /// Upper bound of a channel's distance from the reference position, cells.
    pub(crate) fn cells(
        &self,
        source: &Source,
        tx_rows: &[[Vec3; N_KEYS]],
        cells_per_turn: f32,
        half_s: f32,
    ) -> f32 {
        // |p - a| - |p| is within |n.a| + 2 a^2 / r, where n is the direction at u = 0, plus the effect of its change.
        let [[x, ..], [z, ..]] = source.direction;
        let (along_m, per_m) = if source.tx_row.is_some() {
            let tx = source.seen_by_tx(tx_rows)[N_KEYS / 2];
            let tx_per_m = tx.length_recip();
            let along =
                |reach_m: [f32; 2], x: f32, z: f32| reach_m[0] * x.abs() + reach_m[1] * z.abs();
            let of_tx = along(self.tx_m, tx.x * tx_per_m, tx.z * tx_per_m);
            (of_tx + along(self.rx_m, x, z), source.per_m.max(tx_per_m))
        } else {
            let along_m = self.reach_x_m * x.abs() + self.reach_z_m * z.abs();
            (along_m, source.per_m)
        };
        let path_m = along_m + self.reach_m * (source.turn_rad + 2.0 * self.reach_m * per_m);
        let walk_cells = max_slope(source.cells) * self.max_slot_s / half_s;
        source.turns_per_m * path_m * cells_per_turn + walk_cells
    }
}

/// Input and output of one pass.
pub(crate) struct SpreadJob<'a> {
    pub sources: &'a [Source],
    /// Amplitude that is negligible.
    pub negligible: f32,
    /// See [`Source::seen_by_tx`].
    pub tx_rows: &'a [[Vec3; N_KEYS]],
    pub order: &'a [u32],
    pub groups: &'a [Group],
    pub families: &'a [Family],
    pub levels: &'a [Level],
    pub channels: &'a ChannelBlock,
    pub kernel: &'a Kernel,
    /// Cells per turn of phase.
    pub cells_per_turn: f32,
    /// Half of the segment's length, s.
    pub half_s: f64,
    /// u of loop 0, and the step of u per loop.
    pub u_first: f64,
    pub u_per_loop: f64,
    pub n_loops: usize,
    /// Grids of one group and of one family, `[node][cell]`.
    pub grid: &'a mut Vec<Cell>,
    pub family_grid: &'a mut Vec<Cell>,
    /// The segment's grid, `[loop][cell]`, cells from `first_cell`; overwritten.
    pub out: &'a mut Vec<Cell>,
    pub first_cell: i32,
    pub n_cells: usize,
}

dispatch!(
    /// Spreads all groups and interpolates them into `out`.
    pub(crate) fn spread => spread_body(job: SpreadJob<'_>)
);

/// A source at the nodes of one block.
///
/// Aligned like all data that is loaded as vectors. A vector that crosses a cache line boundary takes twice as long to
/// load.
#[repr(C, align(64))]
struct Nodes {
    u: NodeLanes,
    /// Reference phase minus that of the group, turns in -1/2..1/2. It is reduced in f64, so that f32 holds it to 3e-8
    /// turns.
    turns: NodeLanes,
    /// Amplitude at TDM slot 0.
    re: NodeLanes,
    im: NodeLanes,
    /// Change of the amplitude up to the last slot.
    delta_re: NodeLanes,
    delta_im: NodeLanes,
    cells: NodeLanes,
}

/// One value per node, as vectors whose lanes are nodes.
///
/// With at most [`HALF_LANES`] nodes, the upper half of the first vector would be unused. It then holds the same nodes
/// at the time of the last TDM slot.
type NodeLanes = [[f32; LANES]; MAX_NODES / LANES];

/// Half of a vector's lanes.
const HALF_LANES: usize = LANES / 2;

/// Number of phasors that are buffered before they are added to the grid: 64 of 192 bytes. They fit into the
/// first-level cache together with the grid rows to which they are added.
const BATCH_PHASORS: usize = 2 * MAX_NODES;
/// Maximum number of sources in a batch, for any number of nodes.
const BATCH: usize = 8;

/// Buffers for a batch of sources.
struct BatchBuffers {
    nodes: Nodes,
    /// `[source][node]`.
    phasors: [Phasor; BATCH_PHASORS],
    cells: [NodeLanes; BATCH],
}

#[inline(always)]
fn spread_body<L: SimdF32x16>(job: SpreadJob<'_>) {
    job.out.clear();
    job.out.resize(job.n_loops * job.n_cells, Cell::ZERO);
    let zero: NodeLanes = [[0.0; LANES]; MAX_NODES / LANES];
    let mut buffers = BatchBuffers {
        nodes: Nodes {
            u: zero,
            turns: zero,
            re: zero,
            im: zero,
            delta_re: zero,
            delta_im: zero,
            cells: zero,
        },
        phasors: [Phasor {
            re: [0.0; LANES],
            im: [0.0; LANES],
            d: [0.0; LANES],
        }; BATCH_PHASORS],
        cells: [zero; BATCH],
    };
    let mut grid = std::mem::take(job.grid);
    let mut family_grid = std::mem::take(job.family_grid);
    let mut out = std::mem::take(job.out);
    for family in job.families {
        let to = &family.grid;
        let level = &job.levels[to.level];
        let (n_loops, n_cells) = (job.n_loops, job.n_cells);
        if level.is_direct() {
            // Fast Doppler changes: every loop is a node, so that no interpolation is needed. Sources are added
            // directly to the output, for as many loops at a time as there are nodes in a block.
            for group in &job.groups[family.first..family.end] {
                for first_loop in (0..n_loops).step_by(level.block_loops) {
                    let n_nodes = level.block_loops.min(n_loops - first_loop);
                    let block = &mut out[first_loop * n_cells..(first_loop + n_nodes) * n_cells];
                    let window = (job.first_cell, n_cells);
                    spread_group::<L>(
                        &job,
                        group,
                        first_loop,
                        n_nodes,
                        window,
                        &mut buffers,
                        block,
                    );
                }
            }
            continue;
        }
        // A family of one group is identical to that group. Its grid is interpolated directly to the loops.
        let several = family.end - family.first > 1;
        if several {
            family_grid.clear();
            family_grid.resize(level.nodes.len() * to.n_cells, Cell::ZERO);
        }
        for group in &job.groups[family.first..family.end] {
            let own = &group.grid;
            let n_nodes = job.levels[own.level].nodes.len();
            grid.clear();
            grid.resize(n_nodes * own.n_cells, Cell::ZERO);
            let window = (own.first_cell, own.n_cells);
            spread_group::<L>(&job, group, 0, n_nodes, window, &mut buffers, &mut grid);
            if several {
                // Phase of the group relative to its family at the family's nodes.
                let turns = [0, 1].map(|i| own.turns[i] - to.turns[i]);
                let offset = (own.first_cell - to.first_cell) as usize;
                let into = (&mut family_grid[offset..], to.n_cells);
                interpolate_group::<L>(&job, &grid, own, turns, Some(to.level), into);
            }
        }
        let rows = if several { &family_grid } else { &grid };
        let offset = (to.first_cell - job.first_cell) as usize;
        interpolate_group::<L>(
            &job,
            rows,
            to,
            to.turns,
            None,
            (&mut out[offset..], n_cells),
        );
    }
    (*job.grid, *job.family_grid, *job.out) = (grid, family_grid, out);
}

/// Adds a group's sources to `grid`, `[node][cell]` with cells from `window.0` and `window.1` of them.
#[inline(always)]
fn spread_group<L: SimdF32x16>(
    job: &SpreadJob<'_>,
    group: &Group,
    first_loop: usize,
    n_nodes: usize,
    (first_cell, width): (i32, usize),
    BatchBuffers {
        nodes,
        phasors,
        cells,
    }: &mut BatchBuffers,
    grid: &mut [Cell],
) {
    let (channels, order) = (job.channels, job.order);
    let half_s = job.half_s as f32;
    let last_slot_u = channels.reach.max_slot_s / half_s;
    let slot = L::load(&channels.slot_share);
    let places = &job.levels[group.grid.level].nodes;
    let mut u = [[0.0_f64; LANES]; MAX_NODES / LANES];
    // With few nodes, the free half of the lanes holds the times of the last slot. The change of the amplitude then
    // takes no extra time.
    let with_last_slot = n_nodes <= HALF_LANES;
    for (lane, u) in u.as_flattened_mut().iter_mut().enumerate() {
        let (node, later) = if with_last_slot {
            (
                lane % HALF_LANES,
                if lane < HALF_LANES { 0.0 } else { last_slot_u },
            )
        } else {
            (lane, 0.0)
        };
        let at = first_loop as f64 + places[node.min(n_nodes - 1)];
        *u = job.u_first + at * job.u_per_loop + f64::from(later);
    }
    for (to, from) in nodes.u.as_flattened_mut().iter_mut().zip(u.as_flattened()) {
        *to = *from as f32;
    }
    let (kernel, scale) = (job.kernel, job.cells_per_turn);
    let max_sources = BATCH.min(BATCH_PHASORS / n_nodes);
    let mut first = group.first;
    while first < group.end {
        let batch = first..group.end.min(first + max_sources);
        let n_sources = batch.len();
        let mut reach_cells = [0.0; BATCH];
        for (k, i) in batch.enumerate() {
            let source = &job.sources[order[i] as usize];
            // Neighbours in the order can be anywhere in memory, and a source takes five cache lines. Without a
            // prefetch, each access would wait for memory.
            if let Some(&soon) = order.get(i + 2) {
                prefetch(std::slice::from_ref(&job.sources[soon as usize]));
            }
            // Most sources keep their amplitude from slot to slot, which saves half of the amplitude computation.
            let changes = source.change_per_u * last_slot_u > job.negligible;
            evaluate::<L>(source, &u, group.grid.turns, n_nodes, nodes);
            if changes && with_last_slot {
                slot_change_from_upper_half(nodes);
            } else if changes {
                evaluate_change::<L>(source, last_slot_u, n_nodes, nodes);
            }
            let lanes = channel_turns::<L>(source, job.tx_rows, channels, half_s);
            let phasors = &mut phasors[k * n_nodes..(k + 1) * n_nodes];
            fill_phasors::<L>(nodes, &lanes, changes.then_some(slot), phasors);
            cells[k] = nodes.cells;
            reach_cells[k] = if source.reach_cells <= SLACK_CELLS {
                source.reach_cells
            } else {
                // The source's own bound holds for all channels of the array. The bound for this block can be smaller.
                channels.reach.cells(source, job.tx_rows, scale, half_s)
            };
        }
        let (phasors, cells) = (&phasors[..n_sources * n_nodes], &cells[..n_sources]);
        // The choice is made once per batch, by its widest source. A choice per source would prevent keeping the sums
        // in registers.
        let reach = reach_cells.iter().copied().fold(0.0, f32::max);
        let all = Batch {
            phasors,
            cells,
            n_nodes,
        };
        if reach <= NARROW_CELLS {
            all.add_compact::<L, 3>(&kernel.narrow, scale, first_cell, width, grid);
        } else if reach <= SLACK_CELLS {
            all.add_compact::<L, 4>(&kernel.wide, scale, first_cell, width, grid);
        } else {
            for (k, reach) in reach_cells[..n_sources].iter().enumerate() {
                let one = all.only(k);
                if *reach <= SLACK_CELLS {
                    one.add_compact::<L, 4>(&kernel.wide, scale, first_cell, width, grid);
                } else {
                    one.add_wide(kernel, scale, first_cell, width, grid);
                }
            }
        }
        first += n_sources;
    }
}

/// Interpolates a grid's `rows` from its nodes to the loops, or to the nodes of level `to`, multiplies them by the
/// phasors of a parabola and adds them to `out`, whose loops are `stride` cells apart.
#[inline(always)]
fn interpolate_group<L: SimdF32x16>(
    job: &SpreadJob<'_>,
    rows: &[Cell],
    grid: &GroupGrid,
    turns: [f64; 2],
    to: Option<usize>,
    (out, stride): (&mut [Cell], usize),
) {
    let places = to.map(|level| &job.levels[level].nodes[..]);
    let n_places = places.map_or(job.n_loops, |p| p.len());
    for first in (0..n_places).step_by(QUAD) {
        let phasors: [[f32; 2]; QUAD] = std::array::from_fn(|i| {
            let l = (first + i).min(n_places - 1);
            let u = job.u_first + places.map_or(l as f64, |p| p[l]) * job.u_per_loop;
            let turns = (turns[1] * u + turns[0]) * u;
            let angle = (turns - turns.round()) * std::f64::consts::TAU;
            let (sin, cos) = angle.sin_cos();
            [cos as f32, sin as f32]
        });
        interpolate_loops::<L>(
            rows,
            grid.n_cells,
            job.levels[grid.level].weights(to, first / QUAD),
            &phasors[..QUAD.min(n_places - first)],
            &mut out[first * stride..],
            stride,
        );
    }
}

/// Phase, amplitude and position of a source at all nodes of a block; lanes are nodes.
#[inline(always)]
fn evaluate<L: SimdF32x16>(
    source: &Source,
    u: &[[f64; LANES]; MAX_NODES / LANES],
    group_turns: [f64; 2],
    n_nodes: usize,
    nodes: &mut Nodes,
) {
    let c = &source.turns;
    let (c1, c2) = (c[1] - group_turns[0], c[2] - group_turns[1]);
    let values = n_nodes.div_ceil(LANES);
    for (buffers, u) in u[..values].iter().enumerate() {
        let t = L::load(&nodes.u[buffers]);
        for (to, &t) in nodes.turns[buffers].iter_mut().zip(u) {
            let phase = (((c[4] * t + c[3]) * t + c2) * t + c1) * t + c[0];
            // Adding 1.5 * 2^52 rounds to the nearest integer in any vector width.
            const MAGIC: f64 = 6_755_399_441_055_744.0;
            *to = (phase - ((phase + MAGIC) - MAGIC)) as f32;
        }
        t.polynomial(&source.cells).store(&mut nodes.cells[buffers]);
        let (re, im) = amplitude(source, t);
        re.store(&mut nodes.re[buffers]);
        im.store(&mut nodes.im[buffers]);
    }
}

/// Computes the change of the amplitude up to the last TDM slot. A rotating facet changes its phases between the slots
/// of one loop (by 0.1 rad for a kicking limb). The change is assumed to be linear in between, with an error of an
/// eighth of its square.
#[inline(always)]
fn evaluate_change<L: SimdF32x16>(
    source: &Source,
    last_slot_u: f32,
    n_nodes: usize,
    nodes: &mut Nodes,
) {
    for buffers in 0..n_nodes.div_ceil(LANES) {
        let t = L::load(&nodes.u[buffers]).add(L::splat(last_slot_u));
        let (re, im) = amplitude(source, t);
        re.sub(L::load(&nodes.re[buffers]))
            .store(&mut nodes.delta_re[buffers]);
        im.sub(L::load(&nodes.im[buffers]))
            .store(&mut nodes.delta_im[buffers]);
    }
}

/// As [`evaluate_change`], if [`evaluate`] has computed the amplitude at the last slot in the upper half of the lanes.
#[inline(always)]
fn slot_change_from_upper_half(nodes: &mut Nodes) {
    for node in 0..HALF_LANES {
        nodes.delta_re[0][node] = nodes.re[0][HALF_LANES + node] - nodes.re[0][node];
        nodes.delta_im[0][node] = nodes.im[0][HALF_LANES + node] - nodes.im[0][node];
    }
}

/// Amplitude relative to the reference phase, sqrt(W).
#[inline(always)]
fn amplitude<L: SimdF32x16>(source: &Source, t: L) -> (L, L) {
    let rough = t.polynomial(&source.rough);
    let re = rough.mul(L::splat(source.rough_phasor[0]));
    let im = rough.mul(L::splat(source.rough_phasor[1]));
    if source.coherent == [0.0; 3] {
        return (re, im);
    }
    let [p, q, r] = &source.corners;
    let (dd_re, dd_im) = divided_difference([t.polynomial(p), t.polynomial(q), t.polynomial(r)]);
    let gain = t.polynomial(&source.coherent);
    (gain.fma(dd_re, re), gain.fma(dd_im, im))
}

/// [`crate::scatter::divided_difference`] for sixteen phase triples in turns.
#[inline(always)]
pub(crate) fn divided_difference<L: SimdF32x16>([p, q, r]: [L; 3]) -> (L, L) {
    let tau = L::splat(std::f32::consts::TAU);
    let half = L::splat(0.5);
    let low = p.min(q);
    let high = p.max(q);
    let a = low.min(r);
    let c = high.max(r);
    let b = low.max(high.min(r));
    let (ab_re, ab_im, cos, sin) = first_difference(a, b);
    let (bc_re, bc_im, _, _) = first_difference(b, c);
    let span = c.sub(a).mul(tau);
    let inverse = L::splat(1.0).div(span.max(L::splat(1e-3)));
    let re = bc_im.sub(ab_im).mul(inverse);
    let im = ab_re.sub(bc_re).mul(inverse);
    // For nearly equal phases, the result is e^{j mean} (1/2 - sum (phi - mean)^2 / 48). The phasor of (a + b)/2 is at
    // most 0.03 rad away from that of the mean and is rotated to it by a series.
    let mean = a.add(b).add(c).mul(L::splat(1.0 / 3.0));
    let turn = mean.sub(a.add(b).mul(half)).mul(tau);
    let size = deviation(a, mean)
        .add(deviation(b, mean))
        .add(deviation(c, mean));
    let size = size.fnma(L::splat(1.0 / 48.0), half);
    let near_one = turn.mul(turn).fnma(half, L::splat(1.0));
    let near_re = cos.mul(near_one).sub(sin.mul(turn)).mul(size);
    let near_im = sin.mul(near_one).add(cos.mul(turn)).mul(size);
    let limit = L::splat(0.06);
    (
        span.select_lt(limit, near_re, re),
        span.select_lt(limit, near_im, im),
    )
}

/// Upper bound of the divided difference's derivative for corners whose phases change by at most `rate` per unit of
/// time, both in turns. It is the product of the rate and the envelope of the divided difference, which is small if the
/// sides are many turns long.
#[inline(always)]
pub(crate) fn max_divided_slope<L: SimdF32x16>([p, q, r]: [L; 3], rate: L) -> L {
    let tau = L::splat(std::f32::consts::TAU);
    let (one, two) = (L::splat(1.0), L::splat(2.0 / std::f32::consts::TAU));
    let low = p.min(q).min(r);
    let high = p.max(q).max(r);
    let middle = p.add(q).add(r).sub(low).sub(high);
    let side = |gap: L| one.min(two.div(gap.max(L::splat(1e-3))));
    let sides = side(middle.sub(low)).add(side(high.sub(middle)));
    let span = high.sub(low).mul(tau).max(L::splat(1e-3));
    sides.div(span).min(L::splat(0.5)).mul(rate).mul(tau)
}

/// First divided difference of `exp` at two phases, and the phasor of their mean.
#[inline(always)]
fn first_difference<L: SimdF32x16>(a: L, b: L) -> (L, L, L, L) {
    let half = L::splat(0.5);
    let (sin, cos) = sin_cos_turns(a.add(b).mul(half));
    // sin(x)/x of half the difference. The lower bound avoids 0/0 and is exact in f32.
    let x = b.sub(a).mul(half).max(L::splat(1e-6));
    let sinc = sin_cos_turns(x)
        .0
        .div(x.mul(L::splat(std::f32::consts::TAU)));
    (cos.mul(sinc), sin.mul(sinc), cos, sin)
}

/// Squared distance of two phases in turns, rad^2.
#[inline(always)]
fn deviation<L: SimdF32x16>(x: L, mean: L) -> L {
    let d = x.sub(mean).mul(L::splat(std::f32::consts::TAU));
    d.mul(d)
}

/// `|p - a| - |p|` for antennas at (x, 0, z) with `square = x^2 + z^2`, without cancellation:
/// `(a^2 - 2 p.a) / (|p - a| + |p|)`.
#[inline(always)]
fn path_difference<L: SimdF32x16>(p: Vec3, r2: f32, r: f32, x: L, z: L, square: L) -> L {
    let excess = x.fma(L::splat(-2.0 * p.x), z.fma(L::splat(-2.0 * p.z), square));
    excess.div(excess.add(L::splat(r2)).sqrt().add(L::splat(r)))
}

/// [`path_difference`] as a series in e = (a^2 - 2 p.a) / r^2, which takes a sixth of the time. For r > 40 |a|, |e| <
/// 0.051 and the next term is 7/256 r e^5 < 1e-8 r.
#[inline(always)]
fn path_difference_far<L: SimdF32x16>(p: Vec3, r: f32, x: L, z: L, square: L) -> L {
    let inverse = 1.0 / r;
    let c = -2.0 * inverse * inverse;
    let e = square.mul(L::splat(inverse * inverse));
    let e = x.fma(L::splat(c * p.x), z.fma(L::splat(c * p.z), e));
    let series = e.polynomial(&[0.5 * r, -0.125 * r, 0.0625 * r, -0.039_062_5 * r]);
    series.mul(e)
}

#[inline(always)]
fn scaled<L: SimdF32x16>(x: L, by: f32) -> L {
    x.mul(L::splat(by))
}

/// Quartics of every channel's path difference, turns, for a source with [`Source::is_flat`]. They are the projections
/// of the array's offsets on its direction, plus the wavefront curvature at u = 0.
#[inline(always)]
fn flat_turns<L: SimdF32x16>(source: &Source, channels: &ChannelBlock) -> [L; N_KEYS] {
    let (tx_x, tx_z) = (L::load(&channels.tx_x), L::load(&channels.tx_z));
    let (rx_x, rx_z) = (L::load(&channels.rx_x), L::load(&channels.rx_z));
    let squares = L::load(&channels.tx_square).add(L::load(&channels.rx_square));
    let (x, z) = (tx_x.add(rx_x), tx_z.add(rx_z));
    let scale = -source.turns_per_m;
    let mut path = [L::splat(0.0); N_KEYS];
    for (path, (&along_x, &along_z)) in path
        .iter_mut()
        .zip(source.direction[0].iter().zip(&source.direction[1]))
    {
        *path = x.fma(L::splat(scale * along_x), scaled(z, scale * along_z));
    }
    // |p - a| - |p| = -n.a + (a^2 - (n.a)^2) / 2r, where n is the direction.
    let (nx, nz) = (
        L::splat(source.direction[0][0]),
        L::splat(source.direction[1][0]),
    );
    let (tx, rx) = (tx_x.fma(nx, tx_z.mul(nz)), rx_x.fma(nx, rx_z.mul(nz)));
    let bend = rx.fnma(rx, tx.fnma(tx, squares));
    let half_per_r = 0.5 * source.turns_per_m * source.per_m;
    path[0] = bend.fma(L::splat(half_per_r), path[0]);
    path
}

/// As [`flat_turns`], for any source.
#[inline(always)]
fn bent_turns<L: SimdF32x16>(
    source: &Source,
    tx_rows: &[[Vec3; N_KEYS]],
    channels: &ChannelBlock,
) -> [L; N_KEYS] {
    let (tx_x, tx_z) = (L::load(&channels.tx_x), L::load(&channels.tx_z));
    let (rx_x, rx_z) = (L::load(&channels.rx_x), L::load(&channels.rx_z));
    let (tx_square, rx_square) = (L::load(&channels.tx_square), L::load(&channels.rx_square));
    let scale = L::splat(source.turns_per_m);
    let mut v = [L::splat(0.0); N_KEYS];
    let places = source.seen_by_tx(tx_rows).iter().zip(&source.from_centre);
    for (v, (&p, &q)) in v.iter_mut().zip(places) {
        let (p2, q2) = (p.length_squared(), q.length_squared());
        let (p_m, q_m) = (p2.sqrt(), q2.sqrt());
        *v = if p_m.min(q_m) > 40.0 * channels.reach.reach_m {
            path_difference_far(p, p_m, tx_x, tx_z, tx_square)
                .add(path_difference_far(q, q_m, rx_x, rx_z, rx_square))
        } else {
            path_difference(p, p2, p_m, tx_x, tx_z, tx_square)
                .add(path_difference(q, q2, q_m, rx_x, rx_z, rx_square))
        }
        .mul(scale);
    }
    quartic_lanes(v)
}

/// Quartics of every channel's phase relative to the reference channel's, turns: the path difference, plus the change
/// of the reference phase during the channel's TDM delay.
#[inline(always)]
fn channel_turns<L: SimdF32x16>(
    source: &Source,
    tx_rows: &[[Vec3; N_KEYS]],
    channels: &ChannelBlock,
    half_s: f32,
) -> [L; N_KEYS] {
    let path: [L; N_KEYS] = if source.is_flat {
        flat_turns(source, channels)
    } else {
        bent_turns(source, tx_rows, channels)
    };
    // P(u + h) - P(u) from the derivatives of P, where h is the delay of the lane's slot in units of u. h is at most a
    // few per cent where it matters. The expansion is exact for a quartic.
    let h = L::load(&channels.slot_s).mul(L::splat(1.0 / half_s));
    let mut p = path;
    for (p, &turns) in p.iter_mut().zip(&source.turns) {
        *p = p.add(L::splat(turns as f32));
    }
    let d0 = h.mul(p[1].add(h.mul(p[2].add(h.mul(p[3].add(h.mul(p[4])))))));
    let d1 = h.mul(scaled(p[2], 2.0).add(h.mul(scaled(p[3], 3.0).add(scaled(h.mul(p[4]), 4.0)))));
    let d2 = h.mul(scaled(p[3], 3.0).add(scaled(h.mul(p[4]), 6.0)));
    let d3 = scaled(h.mul(p[4]), 4.0);
    [
        path[0].add(d0),
        path[1].add(d1),
        path[2].add(d2),
        path[3].add(d3),
        path[4],
    ]
}

/// [`crate::motion::quartic`] for sixteen channels.
#[inline(always)]
fn quartic_lanes<L: SimdF32x16>(v: [L; N_KEYS]) -> [L; N_KEYS] {
    let half = L::splat(0.5);
    let (odd_inner, odd_outer) = (v[3].sub(v[1]).mul(half), v[4].sub(v[0]).mul(half));
    let even_inner = v[1].add(v[3]).fma(half, L::splat(0.0).sub(v[2]));
    let even_outer = v[0].add(v[4]).fma(half, L::splat(0.0).sub(v[2]));
    let [[odd1, odd3], [even2, even4]] = QUARTIC;
    [
        v[2],
        applied(odd1, odd_inner, odd_outer),
        applied(even2, even_inner, even_outer),
        applied(odd3, odd_inner, odd_outer),
        applied(even4, even_inner, even_outer),
    ]
}

#[inline(always)]
fn applied<L: SimdF32x16>(m: [f64; 2], inner: L, outer: L) -> L {
    inner.fma(L::splat(m[0] as f32), scaled(outer, m[1] as f32))
}

/// A source at one node; lanes are channels.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
struct Phasor {
    re: [f32; LANES],
    im: [f32; LANES],
    /// Distance from the reference channel, turns.
    d: [f32; LANES],
}

/// Computes the phasors of all channels at all nodes.
///
/// This is a separate loop, because sine and cosine are long chains of dependent instructions. The chains of several
/// nodes overlap only if no update of the grid is between them, because the addresses of such updates depend on the
/// nodes.
#[inline(always)]
fn fill_phasors<L: SimdF32x16>(
    nodes: &Nodes,
    lanes: &[L; N_KEYS],
    changing_to: Option<L>,
    out: &mut [Phasor],
) {
    for (node, out) in out.iter_mut().enumerate() {
        let t = at::<L>(&nodes.u, node);
        let d = lanes[4]
            .fma(t, lanes[3])
            .fma(t, lanes[2])
            .fma(t, lanes[1])
            .fma(t, lanes[0]);
        let (sin, cos) = sin_cos_turns(d.add(at(&nodes.turns, node)));
        let (mut re, mut im) = (at::<L>(&nodes.re, node), at::<L>(&nodes.im, node));
        if let Some(slot) = changing_to {
            re = slot.fma(at(&nodes.delta_re, node), re);
            im = slot.fma(at(&nodes.delta_im, node), im);
        }
        im.fnma(sin, re.mul(cos)).store(&mut out.re);
        im.fma(cos, re.mul(sin)).store(&mut out.im);
        d.store(&mut out.d);
    }
}

#[inline(always)]
fn at<L: SimdF32x16>(values: &NodeLanes, node: usize) -> L {
    L::splat(values.as_flattened()[node])
}

/// Sources at the nodes of their group.
#[derive(Clone, Copy)]
struct Batch<'a> {
    /// `[source][node]`.
    phasors: &'a [Phasor],
    cells: &'a [NodeLanes],
    n_nodes: usize,
}

impl<'a> Batch<'a> {
    fn only(self, k: usize) -> Self {
        Self {
            phasors: &self.phasors[k * self.n_nodes..][..self.n_nodes],
            cells: &self.cells[k..k + 1],
            ..self
        }
    }

    /// Adds sources all of whose channels are within the distance for which `taps` were fitted.
    ///
    /// The outer loop is over nodes instead of sources. Sources of a group are sorted by range, so that several
    /// consecutive ones use the same cells, whose sums remain in registers. The channels of a source share its cells
    /// and differ only in the argument of the taps.
    #[inline(always)]
    fn add_compact<L: SimdF32x16, const N: usize>(
        self,
        taps: &Taps<N>,
        cells_per_turn: f32,
        first_cell: i32,
        width: usize,
        grid: &mut [Cell],
    ) {
        let cells_per_turn = L::splat(cells_per_turn);
        for node in 0..self.n_nodes {
            let mut start = usize::MAX;
            let mut sums = [(L::splat(0.0), L::splat(0.0)); WIDTH];
            for (phasors, cells) in self.phasors.chunks_exact(self.n_nodes).zip(self.cells) {
                let (position, phasor) = (cells.as_flattened()[node], &phasors[node]);
                let cell = position.floor();
                let (row, off) = taps.row(position - cell);
                // A checked conversion would saturate, which takes four more instructions in the innermost loop.
                // SAFETY: `cell` is finite and within two widths of the grid, far inside i32: the simulator refuses a
                // segment (`SimError::TooFast`) in which a source's cells are not finite or change by half the grid for
                // |u| <= 2, and folds their middle into the grid.
                let cell: i32 = unsafe { cell.to_int_unchecked() };
                let at = node * width + (cell - first_cell - 2) as usize;
                if at != start {
                    store_sums(&sums, start, grid);
                    let Some(cells) = grid.get(at..at + WIDTH) else {
                        start = usize::MAX;
                        continue;
                    };
                    for (sum, cell) in sums.iter_mut().zip(cells) {
                        *sum = (L::load(&cell.re), L::load(&cell.im));
                    }
                    start = at;
                }
                let (re, im) = (L::load(&phasor.re), L::load(&phasor.im));
                let x = L::load(&phasor.d).fma(cells_per_turn, L::splat(off));
                for (sum, weight) in sums.iter_mut().zip(row) {
                    let weight = x.polynomial(weight);
                    *sum = (weight.fma(re, sum.0), weight.fma(im, sum.1));
                }
            }
            store_sums(&sums, start, grid);
        }
    }

    /// Adds sources whose channels are in different cells (wide apertures, high speeds), lane by lane.
    #[inline(always)]
    fn add_wide(
        self,
        kernel: &Kernel,
        cells_per_turn: f32,
        first_cell: i32,
        width: usize,
        grid: &mut [Cell],
    ) {
        for (phasors, cells) in self.phasors.chunks_exact(self.n_nodes).zip(self.cells) {
            let positions = cells.as_flattened().iter();
            for (node, (&position, Phasor { re, im, d })) in positions.zip(phasors).enumerate() {
                for lane in 0..LANES {
                    let position = position + d[lane] * cells_per_turn;
                    let cell = position.floor();
                    let start = node * width + (cell as i32 - first_cell) as usize - 2;
                    let taps = kernel.taps(position - cell);
                    for (target, weight) in grid[start..start + WIDTH].iter_mut().zip(taps) {
                        target.re[lane] += weight * re[lane];
                        target.im[lane] += weight * im[lane];
                    }
                }
            }
        }
    }
}

/// Writes the sums of the cells from `start` on. A `start` of `usize::MAX` means that there are none.
#[inline(always)]
fn store_sums<L: SimdF32x16>(sums: &[(L, L); WIDTH], start: usize, grid: &mut [Cell]) {
    if start == usize::MAX {
        return;
    }
    for ((re, im), cell) in sums.iter().zip(&mut grid[start..start + WIDTH]) {
        re.store(&mut cell.re);
        im.store(&mut cell.im);
    }
}

/// Adds up to four loops of a group: the weighted sums of all nodes' rows, multiplied by `phasors`. Loops of `out` are
/// `stride` cells apart.
#[inline(always)]
fn interpolate_loops<L: SimdF32x16>(
    rows: &[Cell],
    width: usize,
    weights: &[[f32; QUAD]],
    phasors: &[[f32; 2]],
    out: &mut [Cell],
    stride: usize,
) {
    for i in 0..width {
        let (mut re, mut im) = ([L::splat(0.0); QUAD], [L::splat(0.0); QUAD]);
        for (row, weights) in rows.chunks_exact(width).zip(weights) {
            let (cell_re, cell_im) = (L::load(&row[i].re), L::load(&row[i].im));
            for k in 0..QUAD {
                let weight = L::splat(weights[k]);
                re[k] = weight.fma(cell_re, re[k]);
                im[k] = weight.fma(cell_im, im[k]);
            }
        }
        for (k, &[cos, sin]) in phasors.iter().enumerate() {
            let target = &mut out[k * stride + i];
            turn_into(target, re[k], im[k], L::splat(cos), L::splat(sin));
        }
    }
}

/// `target += (re + j im) (cos + j sin)`.
#[inline(always)]
fn turn_into<L: SimdF32x16>(target: &mut Cell, re: L, im: L, cos: L, sin: L) {
    let (to_re, to_im) = (L::load(&target.re), L::load(&target.im));
    im.fnma(sin, re.fma(cos, to_re)).store(&mut target.re);
    im.fma(cos, re.fma(sin, to_im)).store(&mut target.im);
}

#[cfg(test)]
mod tests {
    use super::*;
    use radarllm_simd::SimdLevel;

    #[inline(always)]
    fn dd_body<L: SimdF32x16>(phi: &[[f32; 16]; 3], out: &mut [[f32; 16]; 2]) {
        let (re, im) = divided_difference([L::load(&phi[0]), L::load(&phi[1]), L::load(&phi[2])]);
        re.store(&mut out[0]);
        im.store(&mut out[1]);
    }
    dispatch!(fn dd => dd_body(phi: &[[f32; 16]; 3], out: &mut [[f32; 16]; 2]));

    #[test]
    fn lanes_of_the_divided_difference_equal_the_scalar_one() {
        let turn = std::f64::consts::TAU;
        for level in SimdLevel::available() {
            for step in 0..400 {
                // Spans from 1e-5 to 5 turns, with the corners in every order, and equal corners.
                let size = 1e-5 * 10_f32.powf(step as f32 * 5.7 / 400.0);
                let phi: [[f32; 16]; 3] = std::array::from_fn(|corner| {
                    std::array::from_fn(|lane| {
                        let x = ((lane * 7 + corner * 11 + step * 3) as f32 * 0.618_034).fract();
                        if lane == 3 { 0.125 } else { 0.125 + size * x }
                    })
                });
                let mut out = [[0.0; 16]; 2];
                dd(level, &phi, &mut out);
                for lane in 0..16 {
                    let exact = crate::scatter::divided_difference(std::array::from_fn(|corner| {
                        turn * f64::from(phi[corner][lane])
                    }));
                    let error = (f64::from(out[0][lane]) - exact.re)
                        .hypot(f64::from(out[1][lane]) - exact.im);
                    // The error is largest for a span of 0.06 rad: rounding errors of 3e-7 divided by 0.06, and the
                    // next term of the series, 0.06^3 / 500.
                    assert!(error < 1e-5, "{level:?} {size} lane {lane}: {error}");
                }
            }
        }
    }
}
