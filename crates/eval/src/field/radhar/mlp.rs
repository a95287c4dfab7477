//! A multilayer perceptron with one hidden layer, trained by Adam.

use radarllm_base::{
    random::{SplitMix64, nth_normal},
    seed::derive_seed,
};

/// How it is trained.
#[derive(Clone, Copy, Debug, PartialEq, serde::Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MlpConfig {
    /// Units of the hidden layer.
    pub hidden: usize,
    /// Passes over the training rows.
    pub epochs: usize,
    /// Rows of an update.
    pub batch: usize,
    /// Learning rate of Adam.
    pub learning_rate: f64,
}

impl Default for MlpConfig {
    fn default() -> Self {
        Self {
            hidden: 64,
            epochs: 30,
            batch: 20,
            learning_rate: 1e-3,
        }
    }
}

/// A trained network: rectified linear units, then a softmax.
#[derive(Clone, Debug)]
pub struct Mlp {
    n_inputs: usize,
    n_hidden: usize,
    n_classes: usize,
    /// `[hidden][input, then bias]`, then `[class][hidden, then bias]`.
    weights: Vec<f64>,
}

impl Mlp {
    /// Trains on rows of one width, which should have a mean of about zero and a variance of about one.
    ///
    /// `None` without rows, for rows of different widths or a label that is not below `n_classes`.
    pub fn train(
        rows: &[Vec<f64>],
        labels: &[usize],
        n_classes: usize,
        config: &MlpConfig,
        seed: u64,
    ) -> Option<Self> {
        let n_inputs = rows.first()?.len();
        let fits = rows.len() == labels.len()
            && rows.iter().all(|row| row.len() == n_inputs)
            && labels.iter().all(|label| *label < n_classes);
        if !fits || config.hidden == 0 || config.batch == 0 {
            return None;
        }
        let mut model = Self::initial(n_inputs, config.hidden, n_classes, seed);
        let n_weights = model.weights.len();
        let (mut first, mut second) = (vec![0.0; n_weights], vec![0.0; n_weights]);
        let mut gradient = vec![0.0; n_weights];
        let mut order: Vec<usize> = (0..rows.len()).collect();
        let mut rng = SplitMix64::new(derive_seed(seed, "order"));
        let mut update = 0;
        for _ in 0..config.epochs {
            for i in (1..order.len()).rev() {
                order.swap(i, rng.below(i + 1));
            }
            for batch in order.chunks(config.batch) {
                gradient.fill(0.0);
                for row in batch {
                    model.add_gradient(&rows[*row], labels[*row], &mut gradient);
                }
                update += 1;
                // Kingma and Ba, ICLR 2015, with their constants.
                let [beta1, beta2, epsilon] = [0.9_f64, 0.999_f64, 1e-8];
                let correction = (1.0 - beta2.powi(update)).sqrt() / (1.0 - beta1.powi(update));
                let rate = config.learning_rate * correction;
                for (((weight, g), m), v) in model
                    .weights
                    .iter_mut()
                    .zip(&gradient)
                    .zip(&mut first)
                    .zip(&mut second)
                {
                    let g = g / batch.len() as f64;
                    *m = beta1 * *m + (1.0 - beta1) * g;
                    *v = beta2 * *v + (1.0 - beta2) * g * g;
                    *weight -= rate * *m / (v.sqrt() + epsilon);
                }
            }
        }
        Some(model)
    }

    /// Normal weights of variance 2 / inputs (He et al., ICCV 2015) and no biases.
    fn initial(n_inputs: usize, n_hidden: usize, n_classes: usize, seed: u64) -> Self {
        let seed = derive_seed(seed, "weights");
        let mut weights = Vec::new();
        for (n_rows, n) in [(n_hidden, n_inputs), (n_classes, n_hidden)] {
            let deviation = (2.0 / n.max(1) as f64).sqrt();
            for _ in 0..n_rows {
                for _ in 0..n {
                    weights.push(deviation * nth_normal(seed, weights.len() as u64));
                }
                weights.push(0.0);
            }
        }
        Self {
            n_inputs,
            n_hidden,
            n_classes,
            weights,
        }
    }

    /// Number of weights and biases.
    pub fn n_parameters(&self) -> usize {
        self.weights.len()
    }

    /// The likeliest class of a row.
    pub fn predict(&self, row: &[f64]) -> usize {
        let (_, probabilities) = self.forward(row);
        (0..self.n_classes)
            .max_by(|a, b| probabilities[*a].total_cmp(&probabilities[*b]))
            .unwrap_or_default()
    }

    /// Weights of the two layers, each with its width.
    fn layers(&self) -> [(&[f64], usize); 2] {
        let (hidden, output) = self.weights.split_at(self.n_hidden * (self.n_inputs + 1));
        [(hidden, self.n_inputs + 1), (output, self.n_hidden + 1)]
    }

    /// Values of the hidden units, and the probabilities.
    fn forward(&self, row: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let apply = |(weights, width): (&[f64], usize), input: &[f64]| -> Vec<f64> {
            let sum = |unit: &[f64]| {
                let products = unit.iter().zip(input).map(|(w, x)| w * x);
                products.sum::<f64>() + unit[width - 1]
            };
            weights.chunks_exact(width).map(sum).collect()
        };
        let [hidden_layer, output_layer] = self.layers();
        let mut hidden = apply(hidden_layer, row);
        hidden.iter_mut().for_each(|v| *v = v.max(0.0));
        let logits = apply(output_layer, &hidden);
        let max = logits.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let powers: Vec<f64> = logits.iter().map(|v| (v - max).exp()).collect();
        let sum: f64 = powers.iter().sum();
        (hidden, powers.into_iter().map(|p| p / sum).collect())
    }

    /// Adds the gradient of the cross-entropy of a row.
    fn add_gradient(&self, row: &[f64], label: usize, gradient: &mut [f64]) {
        let (hidden, mut errors) = self.forward(row);
        errors[label] -= 1.0;
        let [(hidden_weights, input_width), (output, width)] = self.layers();
        let (to_hidden, to_output) = gradient.split_at_mut(hidden_weights.len());
        let mut back = vec![0.0; self.n_hidden];
        for ((error, unit), gradient) in errors
            .iter()
            .zip(output.chunks_exact(width))
            .zip(to_output.chunks_exact_mut(width))
        {
            for k in 0..self.n_hidden {
                gradient[k] += error * hidden[k];
                back[k] += error * unit[k];
            }
            gradient[width - 1] += error;
        }
        let units = hidden.iter().zip(&back);
        for ((value, error), gradient) in units.zip(to_hidden.chunks_exact_mut(input_width)) {
            if *value <= 0.0 {
                continue;
            }
            for (g, x) in gradient.iter_mut().zip(row) {
                *g += error * x;
            }
            gradient[input_width - 1] += error;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_gradient_is_the_slope_of_the_cross_entropy() {
        let model = Mlp::initial(3, 4, 3, 5);
        let row = [0.3, -1.2, 0.7];
        let loss = |model: &Mlp| -model.forward(&row).1[2].ln();
        let mut gradient = vec![0.0; model.n_parameters()];
        model.add_gradient(&row, 2, &mut gradient);
        assert_eq!(model.n_parameters(), 4 * 4 + 3 * 5);
        for (k, g) in gradient.iter().enumerate() {
            let moved = |by: f64| {
                let mut moved = model.clone();
                moved.weights[k] += by;
                loss(&moved)
            };
            // Central differences: the error is of the order of the squared step.
            let slope = (moved(1e-5) - moved(-1e-5)) / 2e-5;
            assert!((slope - g).abs() < 1e-8, "{k}: {slope} {g}");
        }
    }

    #[test]
    fn exclusive_or_is_learned_by_the_hidden_layer() {
        let rows: Vec<Vec<f64>> = (0..4)
            .map(|i| vec![f64::from(i & 1) * 2.0 - 1.0, f64::from(i >> 1) * 2.0 - 1.0])
            .collect();
        let labels = [0, 1, 1, 0];
        let config = MlpConfig {
            hidden: 16,
            epochs: 1000,
            batch: 4,
            learning_rate: 1e-2,
        };
        let model = Mlp::train(&rows, &labels, 2, &config, 1).unwrap();
        for (row, label) in rows.iter().zip(labels) {
            assert_eq!(model.predict(row), label);
        }
        assert!(Mlp::train(&[], &[], 2, &config, 1).is_none());
        assert!(Mlp::train(&rows, &[0, 1, 2, 0], 2, &config, 1).is_none());
    }
}
