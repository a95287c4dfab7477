//! Detection: selects the cells of the detection map that become points.

use radarllm_simd::{LANES, SimdLevel};

use crate::error::DspError;
use crate::kernels::{count_below, peak};
use crate::options::{CfarSides, Detector, DopplerCfar, DspOptions, MapKind, PeakGrouping};
use crate::stats::{ca_cfar_factor, gamma_level, os_cfar_factor};

/// Maximum number of training cells per side. It bounds the computing time for an unreasonable option.
const MAX_TRAIN: usize = 256;

/// Plan and workspace of the cell selection.
pub struct Selector {
    n_range: usize,
    n_doppler: usize,
    plan: Plan,
    dynamic_range: Option<f32>,
    doppler_cfar: Option<DopplerCfar>,
    peak_grouping: PeakGrouping,
    /// Whether to skip column 0 and its neighbours, which carry less noise after the slow-time mean is removed.
    skip_notch: bool,
    candidates: Vec<u32>,
    values: Vec<f32>,
    noise_floor: Option<f32>,
}

enum Plan {
    TopK,
    /// Median and detection threshold, both for noise of unit power.
    NoiseFloor {
        median: f64,
        level: f64,
    },
    Ca {
        guard: usize,
        train: usize,
        factors: Vec<f32>,
    },
    /// (rank, factor), indexed by the number of training cells.
    Os {
        guard: usize,
        train: usize,
        factors: Vec<(usize, f32)>,
    },
    /// Threshold on the natural logarithm of the power.
    Log {
        guard: usize,
        train: usize,
        sides: CfarSides,
        threshold_ln: f32,
    },
}

impl Selector {
    /// Plans the detection on maps `[n_range, n_doppler]` summed over `n_channels`.
    ///
    /// # Errors
    /// [`DspError::Option`] for an invalid probability or CFAR window.
    pub fn new(
        n_range: usize,
        n_doppler: usize,
        n_channels: usize,
        options: &DspOptions,
    ) -> Result<Self, DspError> {
        if options.map == MapKind::MeanLog
            && !matches!(
                options.detector,
                Detector::LogCfar { .. } | Detector::AlwaysTopK
            )
        {
            return Err(DspError::Option {
                field: "detector",
                problem:
                    "a map of mean logarithms wants log_cfar or top_k: the others' thresholds \
                          hold for sums of powers"
                        .into(),
            });
        }
        // For noise, |sum|^2 of the coherent map is exponentially distributed. The sum of |.|^2 adds one exponential
        // per channel.
        let m = if options.map == MapKind::Coherent {
            1
        } else {
            n_channels
        };
        let n_cells = n_range * n_doppler;
        let plan = match options.detector {
            Detector::AlwaysTopK => Plan::TopK,
            Detector::NoiseFloor {
                false_alarms_per_frame,
            } => {
                let tail = false_alarms_per_frame / n_cells as f64;
                if !(tail > 1e-200 && tail < 0.5) {
                    return Err(DspError::Option {
                        field: "false_alarms_per_frame",
                        problem: format!(
                            "must be positive and under half of the {n_cells} cells, \
                             found {false_alarms_per_frame}"
                        ),
                    });
                }
                Plan::NoiseFloor {
                    median: gamma_level(m, 0.5),
                    level: gamma_level(m, tail),
                }
            }
            Detector::CaCfar {
                guard,
                train,
                false_alarm_probability,
            } => {
                check_cfar(n_range, guard, train)?;
                check_probability(false_alarm_probability)?;
                let factors = (0..=2 * train)
                    .map(|n| {
                        if n == 0 {
                            f32::MAX
                        } else {
                            ca_cfar_factor(m, n, false_alarm_probability) as f32
                        }
                    })
                    .collect();
                Plan::Ca {
                    guard,
                    train,
                    factors,
                }
            }
            Detector::OsCfar {
                guard,
                train,
                rank,
                false_alarm_probability,
            } => {
                check_cfar(n_range, guard, train)?;
                check_probability(false_alarm_probability)?;
                if !(rank > 0.0 && rank <= 1.0) {
                    let problem = format!("must be in (0, 1], found {rank}");
                    return Err(DspError::Option {
                        field: "rank",
                        problem,
                    });
                }
                let factors = (0..=2 * train)
                    .map(|n| {
                        let k = ((rank * n as f64).ceil() as usize).max(1);
                        // check_cfar has ensured that there is always at least one full side of training cells.
                        if n < train {
                            (k, f32::MAX)
                        } else {
                            (k, os_cfar_factor(m, n, k, false_alarm_probability) as f32)
                        }
                    })
                    .collect();
                Plan::Os {
                    guard,
                    train,
                    factors,
                }
            }
            Detector::LogCfar {
                guard,
                train,
                sides,
                threshold_db,
            } => {
                check_cfar(n_range, guard, train)?;
                if !(threshold_db.is_finite() && threshold_db > 0.0) {
                    let problem = format!("must be finite and positive, found {threshold_db}");
                    return Err(DspError::Option {
                        field: "threshold_db",
                        problem,
                    });
                }
                Plan::Log {
                    guard,
                    train,
                    sides,
                    threshold_ln: (threshold_db / 10.0 * std::f64::consts::LN_10) as f32,
                }
            }
        };
        let dynamic_range = match options.dynamic_range_db {
            None => None,
            Some(db) if db.is_finite() && db > 0.0 => Some(10_f64.powf(-db / 10.0) as f32),
            Some(db) => {
                let problem = format!("must be finite and positive, found {db}");
                return Err(DspError::Option {
                    field: "dynamic_range_db",
                    problem,
                });
            }
        };
        if let Some(cfar) = &options.doppler_cfar {
            check_doppler_cfar(n_doppler, cfar)?;
        }
        Ok(Self {
            n_range,
            n_doppler,
            plan,
            dynamic_range,
            doppler_cfar: options.doppler_cfar,
            peak_grouping: options.peak_grouping,
            skip_notch: options.clutter.removes_static() && n_doppler > 8,
            candidates: Vec::with_capacity(n_cells),
            values: Vec::with_capacity(n_cells.max(2 * MAX_TRAIN)),
            noise_floor: None,
        })
    }

    /// Mean noise power per channel, estimated from the median of the last frame. `None` unless the detector is
    /// [`Detector::NoiseFloor`].
    pub fn noise_floor(&self) -> Option<f32> {
        self.noise_floor
    }

    /// Returns the indices of the selected cells in unspecified order. `map` is `[n_range, n_doppler]` power with
    /// finite values.
    pub fn select(&mut self, map: &[f32]) -> &mut [u32] {
        self.candidates.clear();
        let floor = match (&self.plan, self.dynamic_range) {
            (Plan::TopK, _) | (_, None) => 0.0,
            (_, Some(ratio)) => {
                let mut largest = 0.0;
                peak(SimdLevel::detect(), map, &mut largest);
                largest * ratio
            }
        };
        match &self.plan {
            Plan::TopK => push_above(&mut self.candidates, map, 0.0),
            &Plan::NoiseFloor { median, level } => {
                let found = median_of(map, self.n_doppler, self.skip_notch, &mut self.values);
                let per_channel = f64::from(found) / median;
                self.noise_floor = Some(per_channel as f32);
                push_above(
                    &mut self.candidates,
                    map,
                    floor.max((per_channel * level) as f32),
                );
            }
            Plan::Ca {
                guard,
                train,
                factors,
            } => {
                for d in 0..self.n_doppler {
                    cfar_column(
                        &mut self.candidates,
                        Column {
                            map,
                            d,
                            n_doppler: self.n_doppler,
                            n_range: self.n_range,
                        },
                        (*guard, *train),
                        floor,
                        |sides, column| {
                            let n = sides.iter().map(|s| s.len()).sum::<usize>();
                            let sum: f32 = sides
                                .iter()
                                .flat_map(|s| s.clone())
                                .map(|r| column.at(r))
                                .sum();
                            sum * factors[n]
                        },
                    );
                }
            }
            Plan::Os {
                guard,
                train,
                factors,
            } => {
                let values = &mut self.values;
                for d in 0..self.n_doppler {
                    cfar_column(
                        &mut self.candidates,
                        Column {
                            map,
                            d,
                            n_doppler: self.n_doppler,
                            n_range: self.n_range,
                        },
                        (*guard, *train),
                        floor,
                        |sides, column| {
                            values.clear();
                            values
                                .extend(sides.iter().flat_map(|s| s.clone()).map(|r| column.at(r)));
                            let (rank, factor) = factors[values.len()];
                            if values.is_empty() {
                                return f32::MAX;
                            }
                            let idx = rank.min(values.len()) - 1;
                            *values.select_nth_unstable_by(idx, f32::total_cmp).1 * factor
                        },
                    );
                }
            }
            &Plan::Log {
                guard,
                train,
                sides,
                threshold_ln,
            } => {
                let values = &mut self.values;
                for d in 0..self.n_doppler {
                    values.clear();
                    values.extend(
                        (0..self.n_range)
                            .map(|r| map[r * self.n_doppler + d].max(f32::MIN_POSITIVE).ln()),
                    );
                    log_cfar_column(values, (guard, train), sides, threshold_ln, |r| {
                        let cell = r * self.n_doppler + d;
                        if map[cell] > floor {
                            self.candidates.push(cell as u32);
                        }
                    });
                }
            }
        }
        if let Some(cfar) = self.doppler_cfar {
            let n_doppler = self.n_doppler;
            self.candidates.retain(|&cell| {
                let (row, d) = (cell as usize / n_doppler, cell as usize % n_doppler);
                passes_doppler(&map[row * n_doppler..][..n_doppler], d, &cfar)
            });
        }
        // Steps in range and Doppler to the neighbours that are compared.
        let [range, doppler] = match self.peak_grouping {
            PeakGrouping::Off => [0, 0],
            PeakGrouping::Range => [1, 0],
            PeakGrouping::Doppler => [0, 1],
            PeakGrouping::Both => [1, 1],
        };
        if range + doppler > 0 {
            let (n_range, n_doppler) = (self.n_range, self.n_doppler);
            self.candidates.retain(|&c| {
                is_local_maximum(map, [n_range, n_doppler], [range, doppler], c as usize)
            });
        }
        &mut self.candidates
    }
}

/// One Doppler column of a map.
struct Column<'a> {
    map: &'a [f32],
    d: usize,
    n_doppler: usize,
    n_range: usize,
}

impl Column<'_> {
    fn at(&self, range_idx: usize) -> f32 {
        self.map[range_idx * self.n_doppler + self.d]
    }
}

fn check_cfar(n_range: usize, guard: usize, train: usize) -> Result<(), DspError> {
    if train == 0 || train > MAX_TRAIN || guard.saturating_mul(2).saturating_add(train) >= n_range {
        return Err(DspError::Option {
            field: "train",
            problem: format!(
                "needs 1..={MAX_TRAIN} training cells a side that fit with twice {guard} guard cells \
                 into {n_range} range bins, found {train}"
            ),
        });
    }
    Ok(())
}

fn check_doppler_cfar(n_doppler: usize, cfar: &DopplerCfar) -> Result<(), DspError> {
    let used = cfar.guard.saturating_add(cfar.train).saturating_mul(2);
    let problem = if cfar.train == 0 || used >= n_doppler {
        format!(
            "needs at min one training cell a side, and fewer than {n_doppler} training and guard cells in all, \
             found {} and {} a side",
            cfar.train, cfar.guard
        )
    } else if !(cfar.threshold_db.is_finite() && cfar.threshold_db > 0.0) {
        format!(
            "threshold_db must be finite and positive, found {}",
            cfar.threshold_db
        )
    } else {
        return Ok(());
    };
    Err(DspError::Option {
        field: "doppler_cfar",
        problem,
    })
}

/// Whether a cell of a row of Doppler bins exceeds the mean of its training cells by the threshold, in logarithms. The
/// row is cyclic.
fn passes_doppler(row: &[f32], d: usize, cfar: &DopplerCfar) -> bool {
    let n = row.len();
    let ln_at = |bin: usize| row[bin % n].max(f32::MIN_POSITIVE).ln();
    let sides = (cfar.guard + 1..=cfar.guard + cfar.train).map(|k| ln_at(d + k) + ln_at(d + n - k));
    let mean = sides.sum::<f32>() / (2 * cfar.train) as f32;
    let threshold_ln = (cfar.threshold_db / 10.0 * std::f64::consts::LN_10) as f32;
    ln_at(d) > mean + threshold_ln
}

fn check_probability(pfa: f64) -> Result<(), DspError> {
    if !(pfa > 1e-100 && pfa < 0.5) {
        let problem = format!("must be in (0, 0.5), found {pfa}");
        return Err(DspError::Option {
            field: "false_alarm_probability",
            problem,
        });
    }
    Ok(())
}

fn push_above(candidates: &mut Vec<u32>, map: &[f32], threshold: f32) {
    // The comparison is strict, so that a map of zeros has no detections. Nearly all cells are below the threshold, and
    // sixteen cells at once are skipped quickly.
    for (chunk, first) in map.chunks(LANES).zip((0_u32..).step_by(LANES)) {
        if chunk.iter().fold(false, |any, p| any | (*p > threshold)) {
            let cells = chunk.iter().zip(first..);
            candidates.extend(cells.filter(|(p, _)| **p > threshold).map(|(_, i)| i));
        }
    }
}

fn cfar_column(
    candidates: &mut Vec<u32>,
    column: Column,
    (guard, train): (usize, usize),
    floor: f32,
    mut threshold: impl FnMut(&[std::ops::Range<usize>; 2], &Column) -> f32,
) {
    for r in 0..column.n_range {
        let power = column.at(r);
        if power <= floor {
            continue;
        }
        let before = r.saturating_sub(guard + train)..r.saturating_sub(guard);
        let after =
            (r + guard + 1).min(column.n_range)..(r + guard + train + 1).min(column.n_range);
        if power > threshold(&[before, after], &column) {
            candidates.push((r * column.n_doppler + column.d) as u32);
        }
    }
}

/// Calls `pass` for the cells of one column of logarithms that exceed the mean of their training cells by more than
/// `threshold`. Near the ends of the column one side has fewer training cells or none. Without any, the other side
/// alone decides.
fn log_cfar_column(
    values: &[f32],
    (guard, train): (usize, usize),
    sides: CfarSides,
    threshold: f32,
    mut pass: impl FnMut(usize),
) {
    let n = values.len();
    let mean = |range: std::ops::Range<usize>| -> Option<f32> {
        (!range.is_empty()).then(|| values[range.clone()].iter().sum::<f32>() / range.len() as f32)
    };
    for (r, &value) in values.iter().enumerate() {
        let before = mean(r.saturating_sub(guard + train)..r.saturating_sub(guard));
        let after = mean((r + guard + 1).min(n)..(r + guard + train + 1).min(n));
        let level = match (before, after) {
            (Some(a), Some(b)) => match sides {
                CfarSides::Both => 0.5 * (a + b),
                CfarSides::Greater => a.max(b),
                CfarSides::Smaller => a.min(b),
            },
            (Some(a), None) | (None, Some(a)) => a,
            // check_cfar has ensured that the column is longer than the guard and training cells.
            (None, None) => continue,
        };
        if value > level + threshold {
            pass(r);
        }
    }
}

/// Median of the map's cells, without the three columns around zero Doppler if `skip_notch`. For an even number of
/// cells this is the upper of the two middle values. The values are finite and not negative.
///
/// Counting the values below a guess is much faster than moving values. After a few guesses so few values remain in the
/// interval that only these are selected from.
fn median_of(map: &[f32], n_doppler: usize, skip_notch: bool, values: &mut Vec<f32>) -> f32 {
    const FEW: usize = 64;
    /// Number of guesses after which the interval is halved.
    const MAX_GUESSES: usize = 8;
    let is_kept = |cell: usize| !skip_notch || (2..n_doppler - 1).contains(&(cell % n_doppler));
    values.clear();
    if skip_notch {
        let rows = map.chunks_exact(n_doppler);
        values.extend(rows.flat_map(|row| [row[0], row[1], row[n_doppler - 1]]));
    }
    let rank = (map.len() - values.len()) / 2;
    let simd = SimdLevel::detect();
    let n_below = |limit: f32| {
        let [mut all, mut left_out] = [0; 2];
        count_below(simd, map, limit, &mut all);
        count_below(simd, values, limit, &mut left_out);
        all - left_out
    };
    let sample = sample_of(map);
    // The median is one of the n_high - n_low values in the half-open interval from `low` to `high`.
    let (mut low, mut n_low) = (0.0_f32, 0);
    let (mut high, mut n_high) = (f32::INFINITY, map.len() - values.len());
    let mut n_guesses = 0;
    loop {
        // Finite floats that are not negative have the same order as their bit patterns.
        let (low_bits, high_bits) = (low.to_bits(), high.to_bits());
        if n_high - n_low <= FEW || high_bits - low_bits <= 1 {
            break;
        }
        let limit = match sample.get(n_guesses) {
            Some(&value) => value,
            None if n_guesses < MAX_GUESSES => {
                let share = (rank - n_low) as f32 / (n_high - n_low) as f32;
                low + share * (high - low)
            }
            None => f32::from_bits(low_bits + (high_bits - low_bits) / 2),
        };
        n_guesses += 1;
        if !(limit > low && limit < high) {
            continue;
        }
        let n = n_below(limit);
        if n <= rank {
            (low, n_low) = (limit, n);
        } else {
            (high, n_high) = (limit, n);
        }
    }
    values.clear();
    for (chunk, first) in map.chunks(LANES).zip((0..).step_by(LANES)) {
        let is_between = |x: f32| (low <= x) & (x < high);
        if chunk.iter().fold(false, |any, x| any | is_between(*x)) {
            let cells = chunk.iter().zip(first..);
            let between = cells.filter(|&(x, cell)| is_between(*x) && is_kept(cell));
            values.extend(between.map(|(x, _)| *x));
        }
    }
    match values.get(rank - n_low) {
        Some(_) => {
            *values
                .select_nth_unstable_by(rank - n_low, f32::total_cmp)
                .1
        }
        // Without NaN, the interval contains the median, so that this is not reached.
        None => low,
    }
}

/// Two values, slightly below and slightly above the median of a sample.
fn sample_of(map: &[f32]) -> [f32; 2] {
    const SAMPLE: usize = 128;
    // The sample is spread evenly over the map, with a step that is not a multiple of the column length.
    let mut sample: [f32; SAMPLE] =
        std::array::from_fn(|i| map[(2 * i + 1) * map.len() / (2 * SAMPLE + 1)]);
    sample.sort_unstable_by(f32::total_cmp);
    // Two standard deviations of the sample's median.
    [SAMPLE / 2 - 12, SAMPLE / 2 + 12].map(|i| sample[i])
}

fn is_local_maximum(
    map: &[f32],
    [n_range, n_doppler]: [usize; 2],
    [range, doppler]: [usize; 2],
    cell: usize,
) -> bool {
    let (r, d) = (cell / n_doppler, cell % n_doppler);
    let power = map[cell];
    (r.saturating_sub(range)..(r + range + 1).min(n_range)).all(|row| {
        // Doppler is cyclic, range is not.
        (0..=2 * doppler).all(|shift| {
            map[row * n_doppler + (d + n_doppler + shift - doppler) % n_doppler] <= power
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::uniform;

    #[test]
    fn the_median_is_the_middle_of_the_sorted_values() {
        let mut next = uniform(3);
        let mut noise = |n: usize| -> Vec<f32> { (0..n).map(|_| next().abs()).collect() };
        let mut maps: Vec<(usize, Vec<f32>)> = [(1, 1), (2, 3), (9, 1), (16, 20), (128, 256)]
            .map(|(n_doppler, n_range)| (n_doppler, noise(n_doppler * n_range)))
            .to_vec();
        // Noise powers with echoes a million times as strong, a few different values, a single value, and only zeros.
        maps.push((
            128,
            noise(128 * 64).iter().map(|x| x.powi(8) * 1e12).collect(),
        ));
        maps.push((
            128,
            noise(128 * 64).iter().map(|x| (x * 3.0).floor()).collect(),
        ));
        maps.push((128, vec![2.5; 128 * 64]));
        maps.push((128, vec![0.0; 128 * 64]));
        let mut half = vec![0.0; 128 * 64];
        half[4096..].fill(f32::MAX);
        maps.push((128, half));
        for (n_doppler, map) in maps {
            for skip_notch in [false, n_doppler > 8] {
                let kept = if skip_notch {
                    2..n_doppler - 1
                } else {
                    0..n_doppler
                };
                let rows = map.chunks_exact(n_doppler);
                let mut expected: Vec<f32> = rows.flat_map(|r| r[kept.clone()].to_vec()).collect();
                expected.sort_by(f32::total_cmp);
                let found = median_of(&map, n_doppler, skip_notch, &mut vec![]);
                assert_eq!(
                    found,
                    expected[expected.len() / 2],
                    "{n_doppler} {skip_notch}"
                );
            }
        }
    }
}
