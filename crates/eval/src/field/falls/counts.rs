//! Counts with 95 % intervals.

use serde::Serialize;

/// Quantile of the normal distribution for a 95 % interval.
const Z: f64 = 1.959_963_984_540_054;
/// Steps of the search for an exact limit: enough for `f64`.
const N_HALVINGS: usize = 200;

/// A proportion with its Wilson interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Proportion {
    /// Number of successes.
    pub n: usize,
    /// Number of trials.
    pub of: usize,
    /// Lower limit, 0..=1.
    pub low: f64,
    /// Upper limit, 0..=1.
    pub high: f64,
}

impl Proportion {
    /// `n` of `of`; without trials nothing is known, and the interval is everything.
    ///
    /// ```
    /// use radarllm_eval::falls::Proportion;
    ///
    /// assert_eq!(Proportion::new(15, 20).to_text(), "15 of 20 (75.0 % [53.1, 88.8])");
    /// ```
    pub fn new(n: usize, of: usize) -> Self {
        if of == 0 {
            let [low, high] = [0.0, 1.0];
            return Self { n, of, low, high };
        }
        let (trials, share) = (of as f64, n as f64 / of as f64);
        let middle = share + Z * Z / (2.0 * trials);
        let half = Z * (share * (1.0 - share) / trials + (Z / (2.0 * trials)).powi(2)).sqrt();
        let limit = |value: f64| (value / (1.0 + Z * Z / trials)).clamp(0.0, 1.0);
        Self {
            n,
            of,
            low: limit(middle - half),
            high: limit(middle + half),
        }
    }

    /// `n of N (p % [low, high])`.
    pub fn to_text(self) -> String {
        let Self { n, of, low, high } = self;
        if of == 0 {
            return "0 of 0".into();
        }
        let [share, low, high] = [n as f64 / of as f64, low, high].map(|v| 100.0 * v);
        format!("{n} of {of} ({share:.1} % [{low:.1}, {high:.1}])")
    }
}

/// Events in a time, as a rate a day.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct DailyRate {
    /// Number of events.
    pub n: usize,
    /// Observed time, h.
    pub hours: f64,
    /// Lower limit, events a day.
    pub low_per_day: f64,
    /// Upper limit, events a day.
    pub high_per_day: f64,
}

impl DailyRate {
    /// `n` events in a time, as a Poisson process. Without events, the upper limit is that of the rule of three: a larger
    /// rate would have shown an event with a probability of 95 %. Otherwise the interval is the exact one (Garwood 1936).
    ///
    /// ```
    /// use radarllm_eval::falls::DailyRate;
    ///
    /// assert_eq!(DailyRate::new(0, 24.0).to_text(), "0 in 24.00 h (0.0 a day, less than 3.0)");
    /// assert_eq!(DailyRate::new(4, 24.0).to_text(), "4 in 24.00 h (4.0 a day [1.1, 10.2])");
    /// ```
    pub fn new(n: usize, hours: f64) -> Self {
        let [low, high] = match n {
            0 => [0.0, 3.0],
            _ => [
                limit(|mean| 1.0 - at_most(n - 1, mean) < 0.025, n),
                limit(|mean| at_most(n, mean) > 0.025, n),
            ],
        };
        let per_day = |count: f64| match hours > 0.0 {
            true => count * 24.0 / hours,
            false => f64::INFINITY,
        };
        Self {
            n,
            hours,
            low_per_day: if low > 0.0 { per_day(low) } else { 0.0 },
            high_per_day: per_day(high),
        }
    }

    /// `n in H h (r a day [low, high])`.
    pub fn to_text(self) -> String {
        let Self { n, hours, .. } = self;
        if hours <= 0.0 {
            return "no time".into();
        }
        let rate = n as f64 * 24.0 / hours;
        let interval = match n {
            0 => format!(", less than {:.1}", self.high_per_day),
            _ => format!(" [{:.1}, {:.1}]", self.low_per_day, self.high_per_day),
        };
        format!("{n} in {hours:.2} h ({rate:.1} a day{interval})")
    }
}

/// Probability that a Poisson variable is at most `n`.
fn at_most(n: usize, mean: f64) -> f64 {
    // Logarithms, so that large means do not underflow.
    let mut log_term = -mean;
    let mut sum = log_term.exp();
    for i in 1..=n {
        log_term += (mean / i as f64).ln();
        sum += log_term.exp();
    }
    sum.min(1.0)
}

/// The mean below which `is_below` holds.
fn limit(is_below: impl Fn(f64) -> bool, n: usize) -> f64 {
    let (mut low, mut high) = (0.0, 10.0 + 5.0 * n as f64);
    for _ in 0..N_HALVINGS {
        let middle = 0.5 * (low + high);
        match is_below(middle) {
            true => low = middle,
            false => high = middle,
        }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn assert_near(found: f64, expected: f64) {
        assert!((found - expected).abs() < 1e-3, "{found} {expected}");
    }

    #[test]
    fn wilson_intervals_are_those_of_the_literature() {
        // Newcombe (1998), table I: 81 of 263, 15 of 148, 0 of 20, 1 of 29.
        for (n, of, low, high) in [
            (81, 263, 0.2553, 0.3662),
            (15, 148, 0.0624, 0.1605),
            (0, 20, 0.0, 0.1611),
            (1, 29, 0.0061, 0.1718),
        ] {
            let found = Proportion::new(n, of);
            assert_near(found.low, low);
            assert_near(found.high, high);
        }
        let all = Proportion::new(64, 64);
        assert!(all.high == 1.0 && all.low > 0.94);
        let nothing = Proportion::new(0, 0);
        assert_eq!((nothing.low, nothing.high), (0.0, 1.0));
        assert_eq!(nothing.to_text(), "0 of 0");
    }

    #[test]
    fn rates_have_exact_intervals_and_none_has_the_rule_of_three() {
        // Limits of Poisson means, from tables of the chi-squared distribution.
        for (n, low, high) in [
            (1, 0.0253, 5.5716),
            (3, 0.6187, 8.7673),
            (10, 4.7954, 18.3904),
            (100, 81.3640, 121.6272),
        ] {
            let found = DailyRate::new(n, 24.0);
            assert_near(found.low_per_day, low);
            assert_near(found.high_per_day, high);
        }
        let none = DailyRate::new(0, 0.5);
        assert_eq!((none.low_per_day, none.high_per_day), (0.0, 144.0));
        assert!(DailyRate::new(0, 0.0).high_per_day.is_infinite());
        assert_eq!(DailyRate::new(1, 0.0).to_text(), "no time");
    }
}
