//! Numbers beside the weights they belong to: in the program's memory on the CPU, on a graphics processor else, so
//! that an update moves nothing between the two.

use burn::tensor::{Device, Tensor, TensorData};
use radarllm_inference::checkpoint::HostTensor;
use radarllm_nn::device::is_cpu;

/// The numbers of one parameter, its gradient or a moment, flat.
#[derive(Clone, Debug)]
#[expect(clippy::large_enum_variant, reason = "one a parameter")]
pub(crate) enum Values {
    /// In the program's own memory.
    Cpu(Vec<f32>),
    /// On a graphics processor.
    Gpu(Tensor<1>),
}

impl Values {
    /// Of a tensor that is not tracked, where it is.
    pub(crate) fn of<const D: usize>(tensor: Tensor<D>) -> Self {
        if is_cpu(&tensor.device()) {
            return Self::Cpu(host(tensor.into_data()));
        }
        let n = tensor.shape().num_elements();
        Self::Gpu(tensor.reshape([n]))
    }

    pub(crate) fn zeros_like(other: &Self) -> Self {
        match other {
            Self::Cpu(values) => Self::Cpu(vec![0.0; values.len()]),
            Self::Gpu(tensor) => Self::Gpu(tensor.zeros_like()),
        }
    }

    /// `self + other`, where `self` is.
    pub(crate) fn plus(self, other: Self) -> Self {
        match self {
            Self::Cpu(mut sum) => {
                let other = other.into_vec();
                sum.iter_mut().zip(&other).for_each(|(s, o)| *s += o);
                Self::Cpu(sum)
            }
            Self::Gpu(sum) => {
                let other = other.into_tensor(&sum.device());
                Self::Gpu(sum + other)
            }
        }
    }

    /// A copy in the program's memory, for a file.
    pub(crate) fn to_host(&self, shape: &[usize]) -> HostTensor {
        HostTensor {
            shape: shape.to_vec(),
            values: self.clone().into_vec(),
        }
    }

    pub(crate) fn into_vec(self) -> Vec<f32> {
        match self {
            Self::Cpu(values) => values,
            Self::Gpu(tensor) => host(tensor.into_data()),
        }
    }

    pub(crate) fn into_tensor(self, device: &Device) -> Tensor<1> {
        match self {
            Self::Cpu(values) => {
                let n = values.len();
                Tensor::from_data(TensorData::new(values, [n]), device)
            }
            Self::Gpu(tensor) => tensor.to_device(device),
        }
    }
}

/// A tensor's values; weights, gradients and moments are f32 everywhere.
pub(crate) fn host(data: TensorData) -> Vec<f32> {
    data.try_into_vec().unwrap_or_default()
}
