//! A small reproducible random number generator. Its output must never change, because data sets
//! record seeds.

use radarllm_base::random::SplitMix64;
use radarllm_base::seed::derive_seed;

/// Reproducible random draws.
#[derive(Clone, Debug)]
pub(crate) struct Dice(SplitMix64);

impl Dice {
    /// Creates the random stream identified by `seed` and `name`.
    pub(crate) fn new(seed: u64, name: &str) -> Self {
        Self(SplitMix64::new(derive_seed(seed, name)))
    }

    /// Next 64 random bits.
    pub(crate) fn bits(&mut self) -> u64 {
        self.0.next_u64()
    }

    /// Uniform in `low..high`.
    pub(crate) fn range(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.0.uniform_f32()
    }

    /// Uniform in the logarithm, in `low..high`, both above 0.
    pub(crate) fn log_range(&mut self, low: f32, high: f32) -> f32 {
        low * (high / low).powf(self.range(0.0, 1.0))
    }

    /// Bell-shaped distribution around zero, within -1..1, with a standard deviation of about 0.33.
    pub(crate) fn bell(&mut self) -> f32 {
        (self.range(-1.0, 1.0) + self.range(-1.0, 1.0) + self.range(-1.0, 1.0)) / 3.0
    }

    /// Uniform index below `n`, 0 for `n == 0`.
    pub(crate) fn index(&mut self, n: usize) -> usize {
        if n == 0 {
            0
        } else {
            (self.bits() % n as u64) as usize
        }
    }

    /// A uniformly chosen item of a non-empty list.
    pub(crate) fn pick<T: Copy>(&mut self, items: &[T]) -> T {
        items[self.index(items.len())]
    }

    /// An item drawn with a probability proportional to its positive weight; `None` for an empty list.
    pub(crate) fn weighted<T: Copy>(
        &mut self,
        items: &[T],
        weight: impl Fn(&T) -> f32,
    ) -> Option<T> {
        let mut left = self.range(0.0, items.iter().map(&weight).sum());
        let is_drawn = |item: &&T| {
            left -= weight(item);
            left < 0.0
        };
        let drawn = items.iter().find(is_drawn);
        // The sum of rounded weights may end below the drawn number.
        drawn.or(items.last()).copied()
    }

    /// Returns true with the given probability.
    pub(crate) fn chance(&mut self, probability: f32) -> bool {
        self.range(0.0, 1.0) < probability
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Reference values from the code of the first release; motions in existing data sets depend on
    /// them.
    #[test]
    fn draws_never_change() {
        let mut dice = Dice::new(1, "walk");
        let bits = dice.bits();
        let draws = [dice.range(-2.0, 3.0), dice.bell(), dice.range(0.5, 0.75)];
        let indices = [7, 1, 0, 1000].map(|n| dice.index(n));
        assert_eq!(
            (bits, draws.map(f32::to_bits), indices),
            (
                11604859111508711516,
                [3212825376, 1048267189, 1060039132],
                [3, 0, 0, 509]
            )
        );
    }
}
