//! Medians and quantiles.
//!
//! Five rules exist beside each other, because numbers of trained weights and of published tables depend on the rule of
//! the place that computed them. They differ where the quantile lies between two values:
//!
//! | rule | median of 1, 2, 3, 10 |
//! |---|---|
//! | [`median_upper`] | 3, the upper one of the two in the middle |
//! | [`median_mean`] | 2.5, the mean of the two in the middle |
//! | [`quantile_nearest`] | 3, the value of the nearest rank (1.5, rounded up) |
//! | [`quantile_lower`] | 2, the value of the rank below |
//! | [`quantile_linear`] | 2.5, interpolated between the ranks |
//!
//! The rank of a share `q` among `n` values is `q (n - 1)`, counted from 0. Values are ordered by IEEE 754's total order,
//! in which NaN is larger than all others. Every function returns `None` without values.

use std::cmp::Ordering;

/// Numbers with a total order.
pub trait TotalOrder: Copy {
    /// The order of two values. Values that are equal in it have equal bits.
    fn order(&self, other: &Self) -> Ordering;
}

/// Real numbers, in whose own precision ranks are computed.
pub trait Real: TotalOrder {
    /// `share` times `last`, the last index of the sorted values.
    fn rank(share: Self, last: usize) -> Self;
    /// The nearest index. Halves are rounded up.
    fn nearest(self) -> usize;
    /// The index below.
    fn lower(self) -> usize;
}

impl TotalOrder for usize {
    fn order(&self, other: &Self) -> Ordering {
        self.cmp(other)
    }
}

macro_rules! real {
    ($real:ty) => {
        impl TotalOrder for $real {
            fn order(&self, other: &Self) -> Ordering {
                self.total_cmp(other)
            }
        }

        impl Real for $real {
            fn rank(share: Self, last: usize) -> Self {
                share * last as $real
            }

            fn nearest(self) -> usize {
                self.round() as usize
            }

            fn lower(self) -> usize {
                self as usize
            }
        }
    };
}

real!(f32);
real!(f64);

/// The value in the middle; of an even number of values, the upper one of the two in the middle.
pub fn median_upper<T: TotalOrder>(values: impl IntoIterator<Item = T>) -> Option<T> {
    let values: Vec<T> = values.into_iter().collect();
    let middle = values.len() / 2;
    nth(values, middle)
}

/// The value in the middle; of an even number of values, the mean of the two in the middle.
pub fn median_mean(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.into_iter().collect();
    values.sort_unstable_by(f64::total_cmp);
    let n = values.len();
    let upper = *values.get(n / 2)?;
    match n % 2 {
        0 => Some(0.5 * (values[n / 2 - 1] + upper)),
        _ => Some(upper),
    }
}

/// The value of the nearest rank ([`rank_nearest`]).
pub fn quantile_nearest<T: Real>(values: impl IntoIterator<Item = T>, share: T) -> Option<T> {
    let values: Vec<T> = values.into_iter().collect();
    let last = values.len().checked_sub(1)?;
    nth(values, rank_nearest(share, last))
}

/// Index of a quantile among sorted values, of which `last` is the last index: `share` times `last`, rounded.
pub fn rank_nearest<T: Real>(share: T, last: usize) -> usize {
    T::rank(share, last).nearest().min(last)
}

/// The value of the rank below: its fraction is cut off.
pub fn quantile_lower<T: Real>(values: impl IntoIterator<Item = T>, share: T) -> Option<T> {
    let values: Vec<T> = values.into_iter().collect();
    let last = values.len().checked_sub(1)?;
    nth(values, T::rank(share, last).lower().min(last))
}

/// Quantile of sorted values, interpolated between the ranks around it.
pub fn quantile_linear(sorted: &[f64], share: f64) -> Option<f64> {
    let last = sorted.len().checked_sub(1)?;
    let rank = f64::rank(share, last);
    let below = *sorted.get(rank as usize)?;
    let above = *sorted.get(rank.ceil() as usize)?;
    Some(below + rank.fract() * (above - below))
}

/// The value with this index in sorted order.
fn nth<T: TotalOrder>(mut values: Vec<T>, index: usize) -> Option<T> {
    if index >= values.len() {
        return None;
    }
    Some(*values.select_nth_unstable_by(index, T::order).1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::SplitMix64;

    const ODD: [f64; 5] = [9.0, 1.0, 4.0, 25.0, 16.0];
    const EVEN: [f64; 4] = [10.0, 2.0, 1.0, 3.0];

    #[test]
    fn the_upper_median_of_an_even_number_is_the_upper_one_of_two() {
        assert_eq!(median_upper(ODD), Some(9.0));
        assert_eq!(median_upper(EVEN), Some(3.0));
        assert_eq!(median_upper([7.0f32, 5.0]), Some(7.0));
        assert_eq!(median_upper([4usize, 0, 2, 2]), Some(2));
        assert_eq!(median_upper([f32::NAN, 1.0, 2.0]), Some(2.0));
    }

    #[test]
    fn the_mean_median_of_an_even_number_is_the_mean_of_two() {
        assert_eq!(median_mean(ODD), Some(9.0));
        assert_eq!(median_mean(EVEN), Some(2.5));
        assert_eq!(median_mean([4.0]), Some(4.0));
    }

    #[test]
    fn the_nearest_rank_is_rounded_and_halves_up() {
        // Ranks of five values: 0.1 * 4 = 0.4, 0.125 * 4 = 0.5, 0.95 * 4 = 3.8.
        for (share, expected) in [
            (0.0, 1.0),
            (0.1, 1.0),
            (0.125, 4.0),
            (0.5, 9.0),
            (0.95, 25.0),
            (1.0, 25.0),
        ] {
            assert_eq!(quantile_nearest(ODD, share), Some(expected), "{share}");
        }
        // 0.5 * 3 = 1.5.
        assert_eq!(quantile_nearest(EVEN, 0.5), Some(3.0));
        assert_eq!(quantile_nearest([1.0f32, 2.0], 0.5), Some(2.0));
        assert_eq!(rank_nearest(2.0, 3), 3);
        assert_eq!(rank_nearest(0.7, 10), 7);
    }

    #[test]
    fn ranks_are_computed_in_the_precision_of_the_values() {
        // 1 - 0.9 is 0.100000024 in f32 and 0.09999999999999998 in f64, so that the ranks 1.5 of 16 values and 0.5 of 6
        // values are reached in f32 alone.
        assert_eq!(rank_nearest(1.0f32 - 0.9, 15), 2);
        assert_eq!(rank_nearest(1.0f64 - 0.9, 15), 1);
        assert_eq!(rank_nearest(1.0f32 - 0.9, 5), 1);
        assert_eq!(rank_nearest(1.0f64 - 0.9, 5), 0);
    }

    #[test]
    fn the_lower_rank_is_cut_off() {
        // 0.95 * 4 = 3.8, 0.5 * 3 = 1.5.
        assert_eq!(quantile_lower(ODD, 0.95), Some(16.0));
        assert_eq!(quantile_lower(EVEN, 0.5), Some(2.0));
        assert_eq!(quantile_lower(EVEN, 1.0), Some(10.0));
    }

    #[test]
    fn linear_quantiles_lie_between_their_ranks() {
        let sorted = [1.0, 4.0, 9.0, 16.0, 25.0];
        // 0.1 * 4 = 0.4: 1 + 0.4 * 3. 0.9 * 4 = 3.6: 16 + 0.6 * 9.
        for (share, expected) in [
            (0.0, 1.0),
            (0.1, 2.2),
            (0.25, 4.0),
            (0.9, 21.4),
            (1.0, 25.0),
        ] {
            let found = quantile_linear(&sorted, share).unwrap();
            assert!((found - expected).abs() < 1e-12, "{share}: {found}");
        }
        assert_eq!(quantile_linear(&[1.0, 2.0, 3.0, 10.0], 0.5), Some(2.5));
        // A neighbour that does not count does not change the value.
        assert_eq!(quantile_linear(&[1.0, 2.0, f64::INFINITY], 0.5), Some(2.0));
    }

    #[test]
    fn nothing_has_no_quantile() {
        assert_eq!(median_upper::<f32>([]), None);
        assert_eq!(median_mean([]), None);
        assert_eq!(quantile_nearest::<f64>([], 0.5), None);
        assert_eq!(quantile_lower::<f32>([], 0.5), None);
        assert_eq!(quantile_linear(&[], 0.5), None);
    }

    #[test]
    fn selected_values_are_those_of_the_sorted_ones() {
        let mut rng = SplitMix64::new(11);
        for n in 1..60usize {
            let values: Vec<f32> = (0..n).map(|_| rng.below(25) as f32 - 12.0).collect();
            let mut sorted = values.clone();
            sorted.sort_by(f32::total_cmp);
            let bits = |value: Option<f32>| value.map(f32::to_bits);
            let median = median_upper(values.iter().copied());
            assert_eq!(bits(median), Some(sorted[n / 2].to_bits()));
            for share in [0.0, 0.02, 0.25, 0.5, 0.95, 1.0] {
                let rank = share * (n - 1) as f32;
                let nearest = quantile_nearest(values.iter().copied(), share);
                assert_eq!(bits(nearest), Some(sorted[rank.round() as usize].to_bits()));
                let lower = quantile_lower(values.iter().copied(), share);
                assert_eq!(bits(lower), Some(sorted[rank as usize].to_bits()));
            }
        }
    }
}
