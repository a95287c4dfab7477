//! Loss scaling in half precision.

use serde::{Deserialize, Serialize};

/// Dynamic loss scale, which prevents small gradients from underflowing in f16. The factor is as large as possible
/// without an overflow and is adapted during training (Micikevicius et al., *Mixed Precision Training*, ICLR 2018).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct LossScale {
    /// The factor is a power of two, so that it does not change the digits of values that do not overflow.
    pub factor: f64,
    /// Number of updates since the factor changed.
    good: u32,
}

/// Number of updates without an overflow after which a larger factor is tried.
const PATIENCE: u32 = 2000;
const START: f64 = 65_536.0;
const MAX: f64 = 16_777_216.0;

impl Default for LossScale {
    /// A constant factor of 1, which is sufficient for f32 and bf16.
    fn default() -> Self {
        Self {
            factor: 1.0,
            good: 0,
        }
    }
}

impl LossScale {
    /// The initial scale for f16.
    pub(crate) fn start() -> Self {
        Self {
            factor: START,
            good: 0,
        }
    }

    /// Whether the factor is adapted.
    pub(crate) fn is_adaptive(self) -> bool {
        self.factor > 1.0
    }

    /// Returns whether the gradient of an update can be used, from its norm, and adapts the factor. `None` means that
    /// the gradient overflows for every factor.
    pub(crate) fn usable(&mut self, norm: f64) -> Option<bool> {
        if norm.is_finite() {
            self.good += 1;
            if self.is_adaptive() && self.good >= PATIENCE {
                *self = Self {
                    factor: (2.0 * self.factor).min(MAX),
                    good: 0,
                };
            }
            return Some(true);
        }
        if self.factor <= 2.0 {
            return None;
        }
        *self = Self {
            factor: 0.5 * self.factor,
            good: 0,
        };
        Some(false)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn overflows_halve_the_factor_and_patience_doubles_it() {
        let mut scale = LossScale::start();
        assert_eq!(scale.usable(f64::INFINITY), Some(false));
        assert_eq!(scale.factor, START / 2.0);
        for _ in 0..PATIENCE {
            assert_eq!(scale.usable(1.0), Some(true));
        }
        assert_eq!(scale.factor, START);
        let mut n = 0;
        while scale.usable(f64::NAN) == Some(false) {
            n += 1;
        }
        assert_eq!((n, scale.factor), (15, 2.0));
    }

    #[test]
    fn without_a_factor_nothing_overflows_quietly() {
        let mut scale = LossScale::default();
        for _ in 0..2 * PATIENCE {
            assert_eq!(scale.usable(1.0), Some(true));
        }
        assert_eq!(scale.factor, 1.0);
        assert_eq!(scale.usable(f64::NAN), None);
    }
}
