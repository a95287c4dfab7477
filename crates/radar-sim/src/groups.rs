//! Grouping of sources with similar phase curves in slow time into Doppler groups.
//!
//! A group's reference phase is a parabola in time. Its frequency and its ramp (the rate of the frequency) are in the
//! middle of those of its sources. The residual phase of the sources determines the number of nodes at which they are
//! spread ([`crate::slow_time`]). The grids of neighbouring groups are interpolated to the nodes of a family, which has
//! more of them, and only the grids of the families are interpolated to the loops.
//!
//! Sources are sorted along a Z curve over (frequency, ramp), on which every square of that plane is a contiguous run.
//! Starting from the smallest squares, two neighbours are merged into one group, or one family, wherever this has the
//! lowest cost.

use crate::gridding::WIDTH;
use crate::slow_time::Level;

/// Side of the smallest squares, turns per unit of u for the frequency and per unit of u squared for the ramp.
const SIDE: f32 = 0.2;
/// Class limits of the frequency deviation that remains after removal of the parabola, turns per unit of u. They are
/// near the quartiles over the facets of a walking body.
const RESTS: [f32; 3] = [0.15, 0.35, 0.7];

/// Length of the range zones into which paths over several surfaces are divided, cells.
const ZONE_CELLS: f32 = 20.0;

/// Costs in cycles: of a source at a node; of a grid cell in a loop for each node; and of a grid cell in a loop
/// regardless of the nodes. They were measured with bench_sim on Zen 4 with and without each part. They only select
/// among groupings, all of which have the accuracy of their levels.
const NODE_CYCLES: f32 = 80.0;
const WEIGHT_CYCLES: f32 = 1.5;
const TURN_CYCLES: f32 = 5.0;
/// Number of nodes of a family that is assumed when the cost of its groups is estimated.
const FAMILY_NODES: f32 = 14.0;

/// Sources of one Doppler group.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Group {
    pub grid: GroupGrid,
    /// Range of indices into [`Grouping::order`].
    pub first: usize,
    pub end: usize,
}

/// Groups that are interpolated to the loops together.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Family {
    /// Grid of the family. A family of one group has the grid of that group.
    pub grid: GroupGrid,
    /// Range of indices into [`Grouping::groups`].
    pub first: usize,
    pub end: usize,
}

/// Nodes and cells of a group or family.
#[derive(Clone, Copy, Debug)]
pub(crate) struct GroupGrid {
    pub level: usize,
    /// Reference phase, turns: `turns[0] u + turns[1] u^2`.
    pub turns: [f64; 2],
    /// First cell and number of the cells that sources may write.
    pub first_cell: i32,
    pub n_cells: usize,
}

/// The properties of a source that determine its group.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Band {
    /// Frequency at u = 0, turns per unit of u.
    pub frequency: f32,
    /// Change of the frequency per unit of u.
    pub ramp: f32,
    /// Maximum deviation of the frequencies of its corners and channels from `frequency` and `ramp` for |u| <= 1, turns
    /// per unit of u.
    pub rest: f32,
    /// Range of the cells that it may write, for all channels and |u| <= 1.
    pub cells: [f32; 2],
    /// Whether it is a path over several surfaces. Such paths end far beyond the surfaces that are seen directly.
    pub is_bounce: bool,
}

impl Band {
    /// Position on the curve. Groups form within squares of eight sides. Within such a square, sources are ordered by
    /// class of `rest` first, because a single source with a large `rest` would require many nodes for all sources of
    /// its group.
    fn place(&self) -> u32 {
        // The bins saturate far beyond the speeds of radar targets. Saturation costs nodes, not accuracy.
        let bin = |x: f32| ((x * (1.0 / SIDE)).floor() as i32 + (1 << 12)).clamp(0, 0x1fff);
        let square = spaced(bin(self.frequency) as u32) << 1 | spaced(bin(self.ramp) as u32);
        let class = RESTS.iter().filter(|&&rest| self.rest > rest).count() as u32;
        let zone = match self.is_bounce {
            true => 1 + (self.cells[0] / ZONE_CELLS).clamp(0.0, 14.0) as u32,
            false => 0,
        };
        zone << 28 | square >> 6 << 8 | class << 6 | square & 0x3f
    }
}

/// Finds groups. Buffers are reused from segment to segment.
#[derive(Default)]
pub(crate) struct Grouping {
    pub bands: Vec<Band>,
    /// Position on the curve in the upper half, and index of the source in the lower half.
    sorting: Vec<u64>,
    /// Indices of the sources, group by group.
    pub order: Vec<u32>,
    pub groups: Vec<Group>,
    pub families: Vec<Family>,
}

impl Grouping {
    /// Groups the sources of `bands`, for a segment of `n_loops` loops and a duration of twice `half_s`.
    pub(crate) fn group(&mut self, levels: &[Level], half_s: f64, n_loops: usize) {
        self.sorting.clear();
        self.sorting.extend(
            (self.bands.iter().enumerate())
                .map(|(index, band)| u64::from(band.place()) << 32 | index as u64),
        );
        self.sorting.sort_unstable();
        self.order.clear();
        self.order.extend(self.sorting.iter().map(|s| *s as u32));
        self.groups.clear();
        self.families.clear();
        let costs = Costs {
            levels,
            half_s: half_s as f32,
            n_loops: n_loops as f32,
        };
        if !self.sorting.is_empty() {
            self.partition(&costs, 0, self.sorting.len());
        }
        // Within a group, sources are sorted by range, so that the few cells in use stay in the first-level cache.
        for group in &self.groups {
            let keys = &mut self.sorting[group.first..group.end];
            for (key, &index) in keys.iter_mut().zip(&self.order[group.first..group.end]) {
                let cell = self.bands[index as usize].cells[0] as u32;
                *key = u64::from(cell) << 32 | u64::from(index);
            }
            keys.sort_unstable();
        }
        self.order.clear();
        self.order.extend(self.sorting.iter().map(|s| *s as u32));
    }

    /// Divides the run `first..end` into groups and families at the lowest cost, and appends them to `groups` and
    /// `families`.
    fn partition(&mut self, costs: &Costs<'_>, first: usize, end: usize) -> Partition {
        let place = |i: usize| (self.sorting[i] >> 32) as u32;
        let differ = place(first) ^ place(end - 1);
        let before = (self.groups.len(), self.families.len());
        if differ == 0 {
            let bands = self.order[first..end]
                .iter()
                .map(|&i| &self.bands[i as usize]);
            let run = Run::new(first, end, bands);
            return self.one_group(costs, run, before);
        }
        // The highest bit in which the ends of the run differ separates the two halves of the square.
        let bit = 1 << (31 - differ.leading_zeros());
        let middle =
            first + self.sorting[first..end].partition_point(|s| (*s >> 32) as u32 & bit == 0);
        let left = self.partition(costs, first, middle);
        let right = self.partition(costs, middle, end);
        let run = left.run.with(&right.run);
        let level = costs.level_of(&run);
        let groups_cycles = left.groups_cycles + right.groups_cycles;
        let apart = groups_cycles + left.families_cycles + right.families_cycles;
        let together = groups_cycles + costs.family(&run, level);
        if costs.group(&run, level) + costs.family(&run, level) <= apart.min(together) {
            return self.one_group(costs, run, before);
        }
        if together <= apart && level.is_some() {
            self.families.truncate(before.1);
            self.families.push(Family {
                grid: run.grid(level, costs),
                first: before.0,
                end: self.groups.len(),
            });
            return Partition {
                run,
                groups_cycles,
                families_cycles: together - groups_cycles,
            };
        }
        Partition {
            run,
            groups_cycles,
            families_cycles: apart - groups_cycles,
        }
    }

    /// Turns the run into one group and one family.
    fn one_group(&mut self, costs: &Costs<'_>, run: Run, before: (usize, usize)) -> Partition {
        let level = costs.level_of(&run);
        let grid = run.grid(level, costs);
        self.groups.truncate(before.0);
        self.groups.push(Group {
            grid,
            first: run.first,
            end: run.end,
        });
        self.families.truncate(before.1);
        self.families.push(Family {
            grid,
            first: before.0,
            end: before.0 + 1,
        });
        Partition {
            run,
            groups_cycles: costs.group(&run, level),
            families_cycles: costs.family(&run, level),
        }
    }
}

/// A run, and the costs of its groups and families.
struct Partition {
    run: Run,
    groups_cycles: f32,
    families_cycles: f32,
}

/// Spreads the lower sixteen bits, with a zero bit between neighbours.
fn spaced(x: u32) -> u32 {
    let mut x = x & 0xffff;
    for (shift, mask) in [
        (8, 0x00ff_00ff),
        (4, 0x0f0f_0f0f),
        (2, 0x3333_3333),
        (1, 0x5555_5555),
    ] {
        x = (x | x << shift) & mask;
    }
    x
}

/// Bounds of the properties of consecutive sources.
#[derive(Clone, Copy)]
struct Run {
    first: usize,
    end: usize,
    frequency: [f32; 2],
    ramp: [f32; 2],
    rest: f32,
    cells: [f32; 2],
}

impl Run {
    fn new<'a>(first: usize, end: usize, bands: impl Iterator<Item = &'a Band>) -> Self {
        let none = [f32::INFINITY, f32::NEG_INFINITY];
        let mut run = Self {
            first,
            end,
            frequency: none,
            ramp: none,
            rest: 0.0,
            cells: none,
        };
        for band in bands {
            run.frequency = hull(run.frequency, [band.frequency; 2]);
            run.ramp = hull(run.ramp, [band.ramp; 2]);
            run.rest = run.rest.max(band.rest);
            run.cells = hull(run.cells, band.cells);
        }
        run
    }

    /// Merges this run with the next one.
    fn with(&self, next: &Self) -> Self {
        Self {
            first: self.first,
            end: next.end,
            frequency: hull(self.frequency, next.frequency),
            ramp: hull(self.ramp, next.ramp),
            rest: self.rest.max(next.rest),
            cells: hull(self.cells, next.cells),
        }
    }

    /// Maximum difference of a frequency from the middle one, turns per unit of u.
    fn half_width(&self) -> f32 {
        let half = |[low, high]: [f32; 2]| 0.5 * (high - low);
        half(self.frequency) + half(self.ramp) + self.rest
    }

    fn grid(&self, level: Option<usize>, costs: &Costs<'_>) -> GroupGrid {
        let middle = |[low, high]: [f32; 2]| 0.5 * (f64::from(low) + f64::from(high));
        let first_cell = self.cells[0].floor() as i32 - WIDTH as i32 / 2;
        let last_cell = self.cells[1].floor() as i32 + WIDTH as i32 / 2 + 1;
        GroupGrid {
            level: level.unwrap_or(costs.levels.len() - 1),
            turns: match level {
                Some(_) => [middle(self.frequency), 0.5 * middle(self.ramp)],
                None => [0.0; 2],
            },
            first_cell,
            n_cells: (last_cell - first_cell + 1) as usize,
        }
    }
}

fn hull(a: [f32; 2], b: [f32; 2]) -> [f32; 2] {
    [a[0].min(b[0]), a[1].max(b[1])]
}

/// Cost model of groups and families for the available levels.
struct Costs<'a> {
    levels: &'a [Level],
    half_s: f32,
    n_loops: f32,
}

impl Costs<'_> {
    /// The cheapest level whose band contains the run, or `None` if every loop must be a node.
    fn level_of(&self, run: &Run) -> Option<usize> {
        let half_width_hz = run.half_width() / self.half_s;
        let last = self.levels.len() - 1;
        self.levels[..last]
            .iter()
            .position(|l| half_width_hz <= l.half_width_hz as f32)
    }

    /// Cycles to spread the run as one group and interpolate it to the nodes of a family.
    fn group(&self, run: &Run, level: Option<usize>) -> f32 {
        let n = (run.end - run.first) as f32;
        match level {
            None => NODE_CYCLES * n * self.n_loops,
            Some(level) => {
                let nodes = self.levels[level].nodes.len() as f32;
                NODE_CYCLES * n * nodes + interpolation(run, nodes, FAMILY_NODES)
            }
        }
    }

    /// Cycles to interpolate the run as one family to the loops.
    fn family(&self, run: &Run, level: Option<usize>) -> f32 {
        level.map_or(0.0, |level| {
            interpolation(run, self.levels[level].nodes.len() as f32, self.n_loops)
        })
    }
}

fn interpolation(run: &Run, nodes: f32, to: f32) -> f32 {
    let cells = run.cells[1] - run.cells[0] + WIDTH as f32;
    cells * to * (WEIGHT_CYCLES * nodes + TURN_CYCLES)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_source_is_in_one_group_that_carries_it() {
        let levels = Level::all(128, 216e-6);
        let half_s = 0.0137;
        let mut grouping = Grouping::default();
        // Three clusters of frequencies, as of limbs and a trunk, and some outliers.
        let random = |i: usize, k: usize| ((i * 31 + k * 17 + 3) as f32 * 0.618_034).fract();
        grouping.bands = (0..500)
            .map(|i| {
                let at = [-3.0, 0.4, 60.0][i % 3];
                // Some of them are paths over several surfaces, in several zones.
                let ghost = if i % 5 == 0 {
                    300.0 * random(i, 4)
                } else {
                    0.0
                };
                Band {
                    frequency: at + 2.0 * random(i, 0),
                    ramp: 0.5 * at * random(i, 1),
                    rest: if i % 97 == 0 {
                        100.0
                    } else {
                        0.2 * random(i, 2)
                    },
                    cells: [40.0 + 10.0 * random(i, 3), 53.0].map(|c| c + ghost),
                    is_bounce: ghost > 0.0,
                }
            })
            .collect();
        grouping.group(&levels, half_s, 128);
        let families = &grouping.families;
        assert!(families.windows(2).all(|f| f[0].end == f[1].first));
        assert_eq!(families.last().unwrap().end, grouping.groups.len());
        for family in families {
            let own = &grouping.groups[family.first..family.end];
            assert!(own.iter().all(|g| {
                let end = |g: &GroupGrid| g.first_cell + g.n_cells as i32;
                g.grid.first_cell >= family.grid.first_cell && end(&g.grid) <= end(&family.grid)
            }));
        }
        let mut seen = vec![0; 500];
        let mut next = 0;
        for (group_idx, group) in grouping.groups.iter().enumerate() {
            assert_eq!(group.first, next);
            next = group.end;
            let level = &levels[group.grid.level];
            for &i in &grouping.order[group.first..group.end] {
                seen[i as usize] += 1;
                let band = &grouping.bands[i as usize];
                assert!(f64::from(band.cells[0]) - f64::from(group.grid.first_cell) >= 3.0);
                if level.is_direct() {
                    assert!(band.rest == 100.0 || group.grid.turns == [0.0; 2]);
                    continue;
                }
                let family = families.iter().find(|f| f.end > group_idx).unwrap();
                for grid in [&group.grid, &family.grid] {
                    for u in [-1.0, 0.3, 1.0] {
                        let own = f64::from(band.frequency) + f64::from(band.ramp) * u;
                        let middle = grid.turns[0] + 2.0 * grid.turns[1] * u;
                        let off = (own - middle).abs() + f64::from(band.rest);
                        assert!(off <= levels[grid.level].half_width_hz * half_s * 1.00001);
                    }
                }
            }
        }
        assert_eq!(next, 500);
        assert!(seen.iter().all(|&n| n == 1));
        // Paths over several surfaces do not widen the grids of what is seen directly.
        let is_direct = |g: &&Group| {
            let mut own = grouping.order[g.first..g.end].iter();
            own.all(|&i| !grouping.bands[i as usize].is_bounce)
        };
        let in_direct_groups: usize = (grouping.groups.iter().filter(is_direct))
            .map(|g| g.end - g.first)
            .sum();
        assert!(in_direct_groups > 380, "{in_direct_groups} of 400");
        // Merging pays: there are fewer groups than squares, and fewer families than groups but more than two.
        let (n_groups, n_families) = (grouping.groups.len(), families.len());
        assert!(
            n_groups < 150 && n_families < n_groups && n_families > 2,
            "{n_groups} {n_families}"
        );
    }
}
