//! Values stored with the weights to which they belong: in host memory on the CPU, otherwise in the memory of the
//! GPU. An update then copies nothing between the two.

use burn::tensor::{Device, Tensor, TensorData};
use radarllm_inference::checkpoint::HostTensor;
use radarllm_nn::device::is_cpu;

/// Values of one parameter, of its gradient or of a moment, as a flat array.
#[derive(Clone, Debug)]
#[expect(clippy::large_enum_variant, reason = "one a parameter")]
pub(crate) enum Values {
    /// In host memory.
    Cpu(Vec<f32>),
    /// On a GPU.
    Gpu(Tensor<1>),
}

impl Values {
    /// The values of an untracked tensor, on the device of the tensor.
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

    /// `self + other`, on the device of `self`.
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

    /// A copy in host memory, for a file.
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

/// Values of a tensor. Weights, gradients and moments are always f32.
pub(crate) fn host(data: TensorData) -> Vec<f32> {
    data.try_into_vec().unwrap_or_default()
}
