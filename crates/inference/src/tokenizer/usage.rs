//! How the codes of a codebook are used.

/// Statistics of the distribution of codes.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct CodeUsage {
    /// Share of the codebook that occurs, 0..=1.
    pub used: f64,
    /// Exponential of the entropy: the number of equally frequent codes with the same entropy.
    pub perplexity: f64,
}

/// Usage and perplexity of `codes` over a codebook of `n_codes`.
pub fn code_usage(codes: &[u32], n_codes: usize) -> CodeUsage {
    let mut counts = vec![0usize; n_codes];
    for &code in codes {
        if let Some(count) = counts.get_mut(code as usize) {
            *count += 1;
        }
    }
    let total = codes.len().max(1) as f64;
    let entropy: f64 = counts
        .iter()
        .filter(|c| **c > 0)
        .map(|c| *c as f64 / total)
        .map(|p| -p * p.ln())
        .sum();
    let used = counts.iter().filter(|c| **c > 0).count() as f64 / n_codes.max(1) as f64;
    CodeUsage {
        used,
        perplexity: entropy.exp(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_perplexity_of_equally_frequent_codes_is_their_number() {
        let usage = code_usage(&[0, 3, 3, 0, 5, 5], 8);
        assert!((usage.perplexity - 3.0).abs() < 1e-12);
        assert_eq!(usage.used, 3.0 / 8.0);
        let one = code_usage(&[7, 7], 8);
        assert!((one.perplexity - 1.0).abs() < 1e-12);
    }
}
