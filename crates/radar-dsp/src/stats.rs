//! Noise statistics: distributions of sums of exponentials, and the CFAR factors derived from them.
//!
//! |.|^2 of complex white noise is exponential. The sum over m channels is Gamma(m), here with unit mean per channel.
//! All functions are f64 and accurate to about 1e-10, which is far more than a noise floor estimated from one frame
//! requires.

/// P(X <= x) for X the sum of `m` unit exponentials (`m >= 1`): the regularised lower gamma function.
pub fn gamma_cdf(m: usize, x: f64) -> f64 {
    if x <= 0.0 {
        0.0
    } else if x < m as f64 + 1.0 {
        lower_series(m, x)
    } else {
        1.0 - upper_sum(m, x)
    }
}

/// P(X > x) for X the sum of `m` unit exponentials, accurate in the far tail.
pub fn gamma_tail(m: usize, x: f64) -> f64 {
    if x <= 0.0 {
        1.0
    } else if x < m as f64 + 1.0 {
        1.0 - lower_series(m, x)
    } else {
        upper_sum(m, x)
    }
}

/// The level that the sum of `m` unit exponentials exceeds with probability `tail` in (0, 1).
pub fn gamma_level(m: usize, tail: f64) -> f64 {
    let mut high = m as f64;
    while gamma_tail(m, high) > tail {
        high *= 2.0;
    }
    bisect(0.0, high, |x| gamma_tail(m, x) > tail)
}

/// Factor on the *sum* of `n` training cells for cell-averaging CFAR at the false-alarm probability `pfa`, where every
/// cell is the sum of `m` exponentials.
///
/// With X ~ Gamma(m), Y ~ Gamma(m n): P(X > f Y) = I_{1/(1+f)}(m n, m), and for integer m that is
/// sum_{i<m} C(mn - 1 + i, i) f^i (1 + f)^-(mn + i). For m = 1 it is the textbook (1 + f)^-n
/// (Richards, Fundamentals of Radar Signal Processing, cell-averaging CFAR).
pub fn ca_cfar_factor(m: usize, n: usize, pfa: f64) -> f64 {
    let k = (m * n) as f64;
    let tail = |f: f64| {
        let ratio = f / (1.0 + f);
        let mut log_term = -k * f.ln_1p();
        let mut sum = log_term.exp();
        for i in 1..m {
            log_term += ((k + i as f64 - 1.0) / i as f64 * ratio).ln();
            sum += log_term.exp();
        }
        sum
    };
    let mut high = 1.0;
    while tail(high) > pfa {
        high *= 2.0;
    }
    bisect(0.0, high, |f| tail(f) > pfa)
}

/// Factor on the `rank`-th smallest (from 1) of `n` training cells for ordered-statistic CFAR, where every cell is the
/// sum of `m` exponentials. It solves the integral of gamma_tail(m, f t) over the density of that order statistic. For
/// m = 1: Rohling, IEEE Trans. AES 19 (1983), eq. (25), product form.
pub fn os_cfar_factor(m: usize, n: usize, rank: usize, pfa: f64) -> f64 {
    // Density of the order statistic on a grid fine enough for the smooth integrand (Simpson).
    let high_t = gamma_level(m, 1e-12);
    let steps = 400;
    let h = high_t / steps as f64;
    let log_norm = (rank as f64).ln() + ln_binomial(n, rank);
    let ln_gamma_m: f64 = (1..m).map(|i| (i as f64).ln()).sum();
    let weights: Vec<(f64, f64)> = (1..steps)
        .map(|i| {
            let t = i as f64 * h;
            let log_pdf = (m as f64 - 1.0) * t.ln() - t - ln_gamma_m;
            let below = gamma_cdf(m, t).max(1e-300).ln() * (rank as f64 - 1.0);
            let above = gamma_tail(m, t).max(1e-300).ln() * (n - rank) as f64;
            let simpson = if i % 2 == 1 { 4.0 } else { 2.0 } * h / 3.0;
            (t, (log_norm + below + above + log_pdf).exp() * simpson)
        })
        .collect();
    let tail = |f: f64| {
        weights
            .iter()
            .map(|&(t, w)| w * gamma_tail(m, f * t))
            .sum::<f64>()
    };
    let mut high = 1.0;
    while tail(high) > pfa && high < 1e12 {
        high *= 2.0;
    }
    bisect(0.0, high, |f| tail(f) > pfa)
}

fn ln_binomial(n: usize, k: usize) -> f64 {
    (1..=k).map(|i| ((n - k + i) as f64 / i as f64).ln()).sum()
}

/// Smallest x in [low, high] at which a predicate that changes from true to false is false.
fn bisect(mut low: f64, mut high: f64, still_above: impl Fn(f64) -> bool) -> f64 {
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if still_above(middle) {
            low = middle
        } else {
            high = middle
        }
    }
    0.5 * (low + high)
}

/// x^m e^-x / m! * sum x^n / ((m+1)...(m+n)).
fn lower_series(m: usize, x: f64) -> f64 {
    let ln_factorial: f64 = (1..=m).map(|i| (i as f64).ln()).sum();
    let (mut term, mut sum, mut a) = (1.0, 1.0, m as f64);
    while term > sum * 1e-16 {
        a += 1.0;
        term *= x / a;
        sum += term;
    }
    (m as f64 * x.ln() - x - ln_factorial).exp() * sum
}

/// e^-x * sum_{i<m} x^i / i!, summed from the largest term down in the log domain.
fn upper_sum(m: usize, x: f64) -> f64 {
    let top = m as f64 - 1.0;
    let ln_factorial: f64 = (1..m).map(|i| (i as f64).ln()).sum();
    let (mut term, mut sum, mut i) = (1.0, 1.0, top);
    while i > 0.0 && term > 1e-18 {
        term *= i / x;
        sum += term;
        i -= 1.0;
    }
    (top * x.ln() - x - ln_factorial).exp() * sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_channel_is_the_exponential_law() {
        for x in [0.1, 0.7, 1.9, 2.1, 10.0, 40.0] {
            // exp(-x) is exact; the series keeps about 14 digits.
            assert!(
                (gamma_tail(1, x) / (-x).exp() - 1.0).abs() < 1e-9,
                "x = {x}"
            );
        }
        assert!((gamma_level(1, 0.5) - std::f64::consts::LN_2).abs() < 1e-12);
    }

    #[test]
    fn median_of_twelve_channels_follows_the_known_expansion() {
        // Median of Gamma(m): m - 1/3 + 8/(405 m) + 184/(25515 m^2) + ... (Ramanujan, Choi 1994).
        let m = 12.0_f64;
        let expected = m - 1.0 / 3.0 + 8.0 / (405.0 * m) + 184.0 / (25515.0 * m * m);
        // The next term is of order 3e-3 / m^3 = 2e-6.
        assert!((gamma_level(12, 0.5) - expected).abs() < 2e-6);
        assert!((gamma_cdf(12, gamma_level(12, 0.5)) - 0.5).abs() < 1e-12);
    }

    #[test]
    fn large_sums_do_not_overflow() {
        // 4096 channels: normal approximation, standard deviation 64; skewness shifts by O(1).
        let level = gamma_level(4096, 1e-3);
        assert!((level - (4096.0 + 3.0902 * 64.0)).abs() < 5.0, "{level}");
    }

    #[test]
    fn cfar_factors_match_the_single_channel_closed_forms() {
        // CA: (1 + f)^-n = pfa.
        let f = ca_cfar_factor(1, 16, 1e-4);
        assert!((f - (1e-4_f64.powf(-1.0 / 16.0) - 1.0)).abs() < 1e-9);
        // OS (Rohling): pfa = prod_{i<k} (n - i) / (n - i + f).
        let f = os_cfar_factor(1, 16, 12, 1e-4);
        let pfa: f64 = (0..12)
            .map(|i| (16.0 - i as f64) / (16.0 - i as f64 + f))
            .product();
        // Simpson on 400 points of a smooth integrand.
        assert!((pfa / 1e-4 - 1.0).abs() < 1e-4, "{pfa}");
    }
}
