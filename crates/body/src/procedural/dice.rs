//! A tiny reproducible source of variation (SplitMix64), stable for ever: data sets record seeds.

use radarllm_base::seed::derive_seed;

/// Reproducible random draws.
#[derive(Clone, Debug)]
pub struct Dice(u64);

impl Dice {
    /// A stream for the thing called `name`.
    pub fn new(seed: u64, name: &str) -> Self {
        Self(derive_seed(seed, name))
    }

    /// Next 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in `low..high`.
    pub fn range(&mut self, low: f32, high: f32) -> f32 {
        let unit = (self.bits() >> 40) as f32 / (1_u64 << 24) as f32;
        low + (high - low) * unit
    }

    /// Bell-shaped around zero, within -1..1, standard deviation about 0.33.
    pub fn bell(&mut self) -> f32 {
        (self.range(-1.0, 1.0) + self.range(-1.0, 1.0) + self.range(-1.0, 1.0)) / 3.0
    }

    /// Uniform index below `n`, 0 for `n == 0`.
    pub fn index(&mut self, n: usize) -> usize {
        if n == 0 {
            0
        } else {
            (self.bits() % n as u64) as usize
        }
    }

    /// A uniformly chosen item of a non-empty list.
    pub fn pick<T: Copy>(&mut self, items: &[T]) -> T {
        items[self.index(items.len())]
    }

    /// True with that probability.
    pub fn chance(&mut self, probability: f32) -> bool {
        self.range(0.0, 1.0) < probability
    }
}
