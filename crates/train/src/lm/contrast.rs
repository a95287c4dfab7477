//! Contrastive loss between codes and captions, both encoded by the encoder: the codes of a clip and its caption should
//! be closer to each other than to the others of the batch (InfoNCE in both directions, Radford et al. 2021). The paper
//! has no such term.

use burn::tensor::{Tensor, TensorData};

use super::loss::cross_entropy;

/// Added to the score of a pair that is neither a positive nor a negative pair.
const LEFT_OUT: f32 = -1e9;

/// Means of groups of rows of `states`, `[groups, width]`. Every group must have at least one row.
pub fn mean_rows(states: Tensor<2>, groups: &[Vec<usize>]) -> Tensor<2> {
    let n_rows = states.dims()[0];
    let mut shares = vec![0.0_f32; groups.len() * n_rows];
    for (group, shares) in groups.iter().zip(shares.chunks_exact_mut(n_rows)) {
        group
            .iter()
            .for_each(|row| shares[*row] += 1.0 / group.len() as f32);
    }
    let shares = TensorData::new(shares, [groups.len(), n_rows]);
    Tensor::<2>::from_data(shares, &states.device()).matmul(states)
}

/// Mean over both directions of the cross-entropy for identifying the partner of a row, nats.
///
/// `radar` and `text` are `[n, width]`; the same row of both belongs to one clip. Scores are cosines divided by
/// `temperature`. Clips with equal captions are not negatives for each other: such pairs are left out.
/// Returns `[1]`.
pub fn contrast(
    radar: Tensor<2>,
    text: Tensor<2>,
    captions: &[&[u32]],
    temperature: f64,
) -> Tensor<1> {
    let n = captions.len();
    let scores = unit(radar).matmul(unit(text).swap_dims(0, 1)) / temperature;
    let alike = |i: usize, j: usize| i != j && captions[i] == captions[j];
    let bias: Vec<f32> = (0..n * n)
        .map(|k| if alike(k / n, k % n) { LEFT_OUT } else { 0.0 })
        .collect();
    let scores =
        scores.clone() + Tensor::from_data(TensorData::new(bias, [n, n]), &scores.device());
    let partners: Vec<u32> = (0..n as u32).collect();
    let weights = vec![1.0; n];
    let text_of_radar = cross_entropy(scores.clone(), &partners, &weights, 0.0);
    let radar_of_text = cross_entropy(scores.swap_dims(0, 1), &partners, &weights, 0.0);
    (text_of_radar + radar_of_text) * 0.5
}

/// Normalises rows to length 1.
fn unit(rows: Tensor<2>) -> Tensor<2> {
    let length = rows.clone().square().sum_dim(1).add_scalar(1e-12).sqrt();
    rows / length
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::Device;

    fn rows<const N: usize>(values: [[f32; 2]; N]) -> Tensor<2> {
        let data = TensorData::new(values.concat(), [N, 2]);
        Tensor::from_data(data, &Device::flex())
    }

    #[test]
    fn groups_are_averaged() {
        let means = mean_rows(
            rows([[1.0, 2.0], [3.0, 4.0], [10.0, 0.0]]),
            &[vec![0, 1], vec![2]],
        );
        let found: Vec<f32> = means.into_data().try_into_vec().unwrap();
        assert_eq!(found, [2.0, 3.0, 10.0, 0.0]);
    }

    /// Reference: the definition. Partners that are orthogonal to the others have the scores 1/t and 0.
    #[test]
    fn equals_the_definition() {
        let radar = rows([[2.0, 0.0], [0.0, 0.1]]);
        let text = rows([[5.0, 0.0], [0.0, 3.0]]);
        let t = 0.5_f64;
        let value = |captions: &[&[u32]], text: Tensor<2>| {
            f64::from(contrast(radar.clone(), text, captions, t).into_scalar::<f32>())
        };
        let right = (1.0 + (-1.0 / t).exp()).ln();
        assert!((value(&[&[1], &[2]], text.clone()) - right).abs() < 1e-6);
        let wrong = (1.0 + (1.0 / t).exp()).ln();
        let swapped = rows([[0.0, 3.0], [5.0, 0.0]]);
        assert!((value(&[&[1], &[2]], swapped.clone()) - wrong).abs() < 1e-6);
        // Two equal captions cannot be distinguished, and need not be.
        assert!(value(&[&[1], &[1]], swapped).abs() < 1e-6);
    }
}
