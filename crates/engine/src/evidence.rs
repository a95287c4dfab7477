//! The networks that read a window's points as numbers: which actions they show, and with which side an action is made.
//!
//! Both are perceptrons of three layers. The names of their weights and their outputs are those of `radarllm-nn`, which
//! trains them.

use crate::EngineError;
use crate::dense::Dense;
use crate::weights::{NamedTensors, Taker};

/// Outputs of the network of sides: the logits of left, right and both.
pub const N_SIDES: usize = 3;

/// Shape of the networks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EvidenceShape {
    /// Number of values of the points.
    pub values: usize,
    /// Number of contents that a window can have, the outputs of the network of actions.
    pub contents: usize,
    /// Number of actions of which the network of sides knows the side.
    pub sided: usize,
    /// Widths of the two hidden layers of each network.
    pub hidden: [usize; 2],
}

impl EvidenceShape {
    /// Checks that the shape is valid.
    ///
    /// # Errors
    /// [`EngineError::Shape`] names the first field out of range.
    pub fn validate(&self) -> Result<(), EngineError> {
        for (field, value) in [
            ("values", self.values),
            ("contents", self.contents),
            ("sided", self.sided),
            ("hidden", self.hidden[0]),
            ("hidden", self.hidden[1]),
        ] {
            if !(1..=4096).contains(&value) {
                let problem = format!("must be in 1..=4096, found {value}");
                return Err(EngineError::Shape { field, problem });
            }
        }
        Ok(())
    }

    /// Number of weights of both networks.
    pub fn n_params(&self) -> usize {
        let [first, second] = self.hidden;
        let of = |inputs, outputs| {
            inputs * first + first + first * second + second + second * outputs + outputs
        };
        of(self.values, self.contents) + of(self.values + self.sided, N_SIDES)
    }
}

/// Three linear layers.
struct Perceptron([Dense; 3]);

impl Perceptron {
    fn take(
        weights: &mut Taker,
        name: &str,
        [inputs, first, second, outputs]: [usize; 4],
    ) -> Result<Self, EngineError> {
        let mut layer = |part, from, to| Dense::take(weights, &format!("{name}.{part}"), from, to);
        Ok(Self([
            layer("widen", inputs, first)?,
            layer("middle", first, second)?,
            layer("out", second, outputs)?,
        ]))
    }

    fn apply(&self, x: &[f32]) -> Vec<f32> {
        let [widen, middle, out] = &self.0;
        out.apply(&middle.apply_relu(&widen.apply_relu(x)))
    }
}

/// The weights of both networks.
pub struct EvidenceNetworks {
    shape: EvidenceShape,
    actions: Perceptron,
    sides: Perceptron,
}

impl EvidenceNetworks {
    /// Checks and takes the weights.
    ///
    /// # Errors
    /// If the shape is invalid, or a weight is missing, unknown, not finite or of another shape.
    pub fn new(shape: EvidenceShape, weights: NamedTensors) -> Result<Self, EngineError> {
        shape.validate()?;
        let mut weights = Taker(weights);
        let [first, second] = shape.hidden;
        let widths = |inputs, outputs| [inputs, first, second, outputs];
        let networks = Self {
            actions: Perceptron::take(
                &mut weights,
                "actions",
                widths(shape.values, shape.contents),
            )?,
            sides: Perceptron::take(
                &mut weights,
                "sides",
                widths(shape.values + shape.sided, N_SIDES),
            )?,
            shape,
        };
        weights.finish()?;
        Ok(networks)
    }

    /// The logits of the contents for as many values as the shape says.
    pub fn actions(&self, values: &[f32]) -> Vec<f32> {
        let mut x = values.to_vec();
        x.resize(self.shape.values, 0.0);
        self.actions.apply(&x)
    }

    /// The logits of left, right and both for values and the index of an action that has a side.
    pub fn sides(&self, values: &[f32], action: usize) -> [f32; N_SIDES] {
        let mut x = values.to_vec();
        x.resize(self.shape.values, 0.0);
        x.extend((0..self.shape.sided).map(|i| f32::from(u8::from(i == action))));
        let logits = self.sides.apply(&x);
        std::array::from_fn(|i| logits[i])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::HostTensor;

    const SHAPE: EvidenceShape = EvidenceShape {
        values: 2,
        contents: 2,
        sided: 2,
        hidden: [2, 1],
    };

    fn weights() -> NamedTensors {
        let tensor = |shape: &[usize], values: &[f32]| HostTensor {
            shape: shape.to_vec(),
            values: values.to_vec(),
        };
        let sides = [1.0, 0.0, 0.0, 1.0, 10.0, 0.0, 0.0, 20.0];
        [
            ("sides.widen.weight", tensor(&[4, 2], &sides)),
            ("sides.widen.bias", tensor(&[2], &[0.0, -1.0])),
            ("sides.middle.weight", tensor(&[2, 1], &[1.0, 1.0])),
            ("sides.middle.bias", tensor(&[1], &[0.5])),
            ("sides.out.weight", tensor(&[1, 3], &[1.0, -1.0, 2.0])),
            ("sides.out.bias", tensor(&[3], &[0.0, 1.0, 0.0])),
            (
                "actions.widen.weight",
                tensor(&[2, 2], &[1.0, 0.0, 0.0, -1.0]),
            ),
            ("actions.widen.bias", tensor(&[2], &[0.0, 0.0])),
            ("actions.middle.weight", tensor(&[2, 1], &[2.0, 1.0])),
            ("actions.middle.bias", tensor(&[1], &[0.0])),
            ("actions.out.weight", tensor(&[1, 2], &[1.0, -1.0])),
            ("actions.out.bias", tensor(&[2], &[0.0, 1.0])),
        ]
        .map(|(name, tensor)| (name.to_string(), tensor))
        .into()
    }

    #[test]
    fn logits_are_those_computed_by_hand() {
        let networks = EvidenceNetworks::new(SHAPE, weights()).unwrap();
        // Hidden: max(3 + 10, 0) and max(2 - 1, 0), then 13 + 1 + 0.5.
        assert_eq!(networks.sides(&[3.0, 2.0], 0), [14.5, -13.5, 29.0]);
        // The other action: max(3, 0) and max(2 + 20 - 1, 0).
        assert_eq!(networks.sides(&[3.0, 2.0], 1), [24.5, -23.5, 49.0]);
        assert_eq!(
            SHAPE.n_params(),
            (4 * 2 + 2 + 2 + 1 + 3 + 3) + (2 * 2 + 2 + 2 + 1 + 2 + 2)
        );
        // Hidden: max(3, 0) and max(-2, 0), then 6.
        assert_eq!(networks.actions(&[3.0, 2.0]), [6.0, -5.0]);
    }

    #[test]
    fn weights_that_do_not_fit_are_refused() {
        let refused = |change: &dyn Fn(&mut NamedTensors)| {
            let mut weights = weights();
            change(&mut weights);
            let error = EvidenceNetworks::new(SHAPE, weights).err().unwrap();
            error.to_string()
        };
        let missing = refused(&|w| drop(w.remove("sides.middle.bias")));
        assert!(missing.contains("sides.middle.bias"), "{missing}");
        let more = HostTensor::vector(vec![0.0]);
        let unknown = refused(&|w| drop(w.insert("more".into(), more.clone())));
        assert!(unknown.contains("more"), "{unknown}");
        let none = EvidenceShape { sided: 0, ..SHAPE };
        assert!(none.validate().unwrap_err().to_string().contains("sided"));
    }
}
