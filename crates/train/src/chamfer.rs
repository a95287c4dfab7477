//! Chamfer distance between small point sets.

use burn::tensor::Tensor;
use serde::{Deserialize, Serialize};

/// Direction of the nearest-neighbour search.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ChamferSide {
    /// The nearest prediction of each target and the nearest target of each prediction. The two means are added.
    Symmetric,
    /// Only the nearest prediction of each target, as the paper's equation is printed. Stray predictions do not
    /// increase the loss.
    TargetToPrediction,
}

/// Added to the squared distance of padding targets.
const FAR: f64 = 1e6;

/// Mean over targets (and, if symmetric, over predictions) of the squared distance to the nearest point of the other
/// set.
///
/// # Shapes
/// - `predicted`: `[n, m, d]`
/// - `targets`: `[n, k, d]`
/// - `valid`: `[n, k]`, 1 for targets, 0 for padding; every row has at least one target
/// - returns: `[1]`
pub fn chamfer(
    predicted: Tensor<3>,
    targets: Tensor<3>,
    valid: Tensor<2>,
    side: ChamferSide,
) -> Tensor<1> {
    let [n, m, _] = predicted.dims();
    let [_, k, _] = targets.dims();
    let difference = predicted.unsqueeze_dim::<4>(2) - targets.unsqueeze_dim::<4>(1);
    let square = difference.square().sum_dim(3).reshape([n, m, k]);
    let nearest_prediction = square.clone().min_dim(1).reshape([n, k]);
    let count = valid.clone().sum().clamp_min(1.0);
    let targets_side = (nearest_prediction * valid.clone()).sum() / count;
    match side {
        ChamferSide::TargetToPrediction => targets_side,
        ChamferSide::Symmetric => {
            let absent = (valid.neg() + 1.0) * FAR;
            let nearest_target = (square + absent.unsqueeze_dim::<3>(1)).min_dim(2);
            targets_side + nearest_target.mean()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::Device;

    #[test]
    fn matches_a_case_worked_by_hand() {
        let device = Device::flex();
        let predicted = Tensor::<3>::from_data([[[0.0, 0.0], [3.0, 0.0]]], &device);
        let targets = Tensor::<3>::from_data([[[1.0, 0.0], [0.0, 2.0], [9.0, 9.0]]], &device);
        let valid = Tensor::<2>::from_data([[1.0, 1.0, 0.0]], &device);
        let run = |side| {
            chamfer(predicted.clone(), targets.clone(), valid.clone(), side).into_scalar::<f32>()
        };
        // Targets: 1 and 4, mean 2.5. Predictions: 1 and 4, mean 2.5. The third target is padding.
        assert!((run(ChamferSide::TargetToPrediction) - 2.5).abs() < 1e-6);
        assert!((run(ChamferSide::Symmetric) - 5.0).abs() < 1e-6);
    }
}
