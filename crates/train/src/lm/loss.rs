//! Cross-entropy over target tokens.

use burn::tensor::{Int, Tensor, TensorData};

/// Weighted mean cross-entropy with label smoothing.
///
/// `logits` are `[rows, vocab]`, one row per target token (no padding). `weights` are the factors of the rows. With
/// label smoothing `e`, the target distribution of a row is `1 - e` on its token plus `e / vocab` everywhere.
/// Returns a scalar of shape `[1]`.
pub fn cross_entropy(
    logits: Tensor<2>,
    targets: &[u32],
    weights: &[f32],
    smoothing: f64,
) -> Tensor<1> {
    let device = logits.device();
    let [rows, vocab] = logits.dims();
    let ids: Vec<i32> = targets.iter().map(|t| *t as i32).collect();
    let ids = Tensor::<2, Int>::from_data(TensorData::new(ids, [rows, 1]), &device);
    // Subtracting the largest logit does not change the gradient, so it is detached from the autodiff graph.
    let shift = logits.clone().detach().max_dim(1);
    let shifted = logits - shift;
    let log_total = shifted.clone().exp().sum_dim(1).log();
    let own = shifted.clone().gather(1, ids);
    let mut loss = log_total - own.mul_scalar(1.0 - smoothing);
    if smoothing > 0.0 {
        loss = loss - shifted.sum_dim(1).mul_scalar(smoothing / vocab as f64);
    }
    let total: f32 = weights.iter().sum();
    let weights: Vec<f32> = weights
        .iter()
        .map(|w| w / total.max(f32::MIN_POSITIVE))
        .collect();
    let weights = Tensor::<2>::from_data(TensorData::new(weights, [rows, 1]), &device);
    (loss * weights).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::Device;

    fn value(logits: &[[f64; 3]], targets: &[u32], weights: &[f32], e: f64) -> f64 {
        let flat: Vec<f32> = logits.iter().flatten().map(|v| *v as f32).collect();
        let data = TensorData::new(flat, [logits.len(), 3]);
        let logits = Tensor::from_data(data, &Device::flex());
        f64::from(cross_entropy(logits, targets, weights, e).into_scalar::<f32>())
    }

    /// Reference: the definition, in f64. Tolerance: f32 rounding of values near 1.
    #[test]
    fn equals_the_definition() {
        let logits: [[f64; 3]; 2] = [[0.5, -1.0, 2.0], [80.0, 1.0, -80.0]];
        let (targets, weights, e) = ([2_u32, 1], [1.0_f32, 3.0], 0.1);
        let mut expected = 0.0;
        for (i, row) in logits.iter().enumerate() {
            let total: f64 = row.iter().map(|l| l.exp()).sum();
            for (j, l) in row.iter().enumerate() {
                let p = e / 3.0 + if targets[i] == j as u32 { 1.0 - e } else { 0.0 };
                expected -= p * (l - total.ln()) * f64::from(weights[i]) / 4.0;
            }
        }
        let found = value(&logits, &targets, &weights, e);
        assert!(
            (found - expected).abs() < 1e-4 * expected,
            "{found} {expected}"
        );
    }

    #[test]
    fn sure_and_right_costs_nothing() {
        assert!(value(&[[30.0, 0.0, 0.0]], &[0], &[1.0], 0.0).abs() < 1e-6);
        let uniform = value(&[[1.0, 1.0, 1.0]], &[1], &[1.0], 0.1);
        assert!((uniform - 3_f64.ln()).abs() < 1e-6);
    }
}
