//! Selection of the device (CPU or GPU) that computes the networks.

use std::collections::BTreeMap;
use std::fmt;
use std::str::FromStr;
use std::sync::{Mutex, PoisonError};

use burn::tensor::Device;
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// The device that runs training and the training implementation of the networks. There is no fallback to another
/// device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Processor {
    /// `"cpu"`.
    #[default]
    Cpu,
    /// `"gpu"`: the fastest GPU. `"gpu:1"`: a discrete GPU by number, from 0. The GPU is used through Vulkan, Metal,
    /// DirectX 12 or WebGPU.
    Gpu(Option<usize>),
    /// `"cuda"`: the first NVIDIA GPU. `"cuda:1"`: an NVIDIA GPU by number, from 0. The GPU is used through CUDA.
    Cuda(Option<usize>),
    /// `"libtorch-cpu"`: the CPU through PyTorch's library.
    LibTorchCpu,
    /// `"libtorch"`: the first NVIDIA GPU. `"libtorch:1"`: an NVIDIA GPU by number, from 0. The GPU is used through
    /// PyTorch's library.
    LibTorch(Option<usize>),
}

/// One or more devices, for example `"gpu:0,gpu:1"`. The first stores the weights; each computes one batch of an
/// update.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Processors(Vec<Processor>);

impl Processors {
    /// The device that stores the weights.
    pub fn first(&self) -> Processor {
        self.0.first().copied().unwrap_or_default()
    }

    /// Number of devices.
    pub fn count(&self) -> usize {
        self.0.len()
    }

    /// The framework's device handles, in order.
    ///
    /// # Errors
    /// See [`ProcessorError`].
    pub fn devices(&self) -> Result<Vec<Device>, ProcessorError> {
        self.0.iter().map(|processor| processor.device()).collect()
    }
}

impl Default for Processors {
    fn default() -> Self {
        Self(vec![Processor::default()])
    }
}

impl fmt::Display for Processors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names: Vec<String> = self.0.iter().map(Processor::to_string).collect();
        f.write_str(&names.join(","))
    }
}

impl FromStr for Processors {
    type Err = ProcessorError;

    fn from_str(names: &str) -> Result<Self, ProcessorError> {
        names
            .split(',')
            .map(str::parse)
            .collect::<Result<_, _>>()
            .map(Self)
    }
}

impl TryFrom<String> for Processors {
    type Error = ProcessorError;

    fn try_from(names: String) -> Result<Self, ProcessorError> {
        names.parse()
    }
}

impl From<Processors> for String {
    fn from(processors: Processors) -> Self {
        processors.to_string()
    }
}

/// Why a device cannot be used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ProcessorError {
    /// Not the name of a device.
    #[error(
        "`{0}` is no processor: `cpu`, `gpu`, `gpu:N` for the dedicated one with number N, from 0, `cuda`, `cuda:N`, \
         `libtorch`, `libtorch:N` or `libtorch-cpu`"
    )]
    Name(String),
    /// The program was built without the feature that the processor needs.
    #[error("`{processor}`: this program was built without the feature `{feature}`")]
    NotBuilt {
        /// The requested device.
        processor: Processor,
        /// The Cargo feature that adds support for it.
        feature: &'static str,
    },
    /// The machine has no such device, or its driver reports an error.
    #[error("`{processor}`: {message}")]
    Unavailable {
        /// The requested device.
        processor: Processor,
        /// The driver's message.
        message: String,
    },
}

/// Whether tensors on a device are in host memory, where loops over them need no copy.
pub fn is_cpu(device: &Device) -> bool {
    *device == Device::flex()
}

impl Processor {
    /// The framework's device handle. The first call opens a GPU and reports its name as a `tracing` event.
    ///
    /// # Errors
    /// See [`ProcessorError`].
    pub fn device(self) -> Result<Device, ProcessorError> {
        let (opened, is_new) = self.open()?;
        if self != Self::Cpu && is_new {
            tracing::info!("{self}: {}", opened.name);
        }
        Ok(opened.device)
    }

    /// The device name reported by the driver. A GPU is opened for this.
    ///
    /// # Errors
    /// See [`ProcessorError`].
    pub fn name(self) -> Result<String, ProcessorError> {
        Ok(self.open()?.0.name)
    }

    /// Opens the device. The flag is true if this call opened it.
    fn open(self) -> Result<(Opened, bool), ProcessorError> {
        // A device can be opened only once.
        static OPEN: Mutex<BTreeMap<Processor, Opened>> = Mutex::new(BTreeMap::new());
        let mut open = OPEN.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(opened) = open.get(&self) {
            return Ok((opened.clone(), false));
        }
        let opened = match self {
            // Named explicitly: the default would prefer any accelerator that was compiled in.
            Self::Cpu => Opened {
                device: Device::flex(),
                name: "CPU".into(),
            },
            Self::Gpu(number) => open_gpu(number)?,
            Self::Cuda(number) => open_cuda(number)?,
            Self::LibTorchCpu | Self::LibTorch(_) => open_libtorch(self)?,
        };
        open.insert(self, opened.clone());
        Ok((opened, true))
    }
}

#[derive(Clone)]
struct Opened {
    device: Device,
    name: String,
}

#[cfg(not(feature = "gpu"))]
fn open_gpu(number: Option<usize>) -> Result<Opened, ProcessorError> {
    Err(ProcessorError::NotBuilt {
        processor: Processor::Gpu(number),
        feature: "gpu",
    })
}

#[cfg(feature = "gpu")]
fn open_gpu(number: Option<usize>) -> Result<Opened, ProcessorError> {
    use burn::tensor::DeviceKind;

    let kind = number.map_or(DeviceKind::DefaultDevice, DeviceKind::DiscreteGpu);
    let (device, setup) = Device::wgpu_options()
        .device_kind(kind)
        .init_with_setup()
        .map_err(|e| ProcessorError::Unavailable {
            processor: Processor::Gpu(number),
            message: e.to_string(),
        })?;
    let info = setup.adapter.get_info();
    let name = format!("{} ({})", info.name, setup.backend);
    Ok(Opened { device, name })
}

#[cfg(not(feature = "cuda"))]
fn open_cuda(number: Option<usize>) -> Result<Opened, ProcessorError> {
    Err(ProcessorError::NotBuilt {
        processor: Processor::Cuda(number),
        feature: "cuda",
    })
}

#[cfg(feature = "cuda")]
fn open_cuda(number: Option<usize>) -> Result<Opened, ProcessorError> {
    use std::panic::{AssertUnwindSafe, catch_unwind};

    use burn::tensor::Tensor;

    let number = number.unwrap_or(0);
    let device = Device::cuda(number);
    // The first use opens the driver, and panics if there is none.
    let used = || Tensor::<1>::ones([1], &device).into_data();
    catch_unwind(AssertUnwindSafe(used)).map_err(|_| ProcessorError::Unavailable {
        processor: Processor::Cuda(Some(number)),
        message: "no NVIDIA driver, no CUDA, or no processor of this number".into(),
    })?;
    let name = format!("CUDA {number}");
    Ok(Opened { device, name })
}

#[cfg(not(feature = "libtorch"))]
fn open_libtorch(processor: Processor) -> Result<Opened, ProcessorError> {
    Err(ProcessorError::NotBuilt {
        processor,
        feature: "libtorch",
    })
}

// The framework intends to remove this backend. Until its own kernels for GPUs are as fast for small networks, no
// other one serves the purpose.
#[cfg(feature = "libtorch")]
#[allow(deprecated)]
fn open_libtorch(processor: Processor) -> Result<Opened, ProcessorError> {
    let Processor::LibTorch(number) = processor else {
        return Ok(Opened {
            device: Device::libtorch(),
            name: "CPU through LibTorch".into(),
        });
    };
    let number = number.unwrap_or(0);
    let n_gpus = usize::try_from(tch::Cuda::device_count()).unwrap_or(0);
    if number >= n_gpus {
        return Err(ProcessorError::Unavailable {
            processor,
            message: format!(
                "LibTorch finds {n_gpus} NVIDIA GPUs; it must be a build for CUDA, and the driver must be installed"
            ),
        });
    }
    Ok(Opened {
        device: Device::libtorch_cuda(number),
        name: format!("CUDA {number} through LibTorch"),
    })
}

impl fmt::Display for Processor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Cpu => f.write_str("cpu"),
            Self::Gpu(None) => f.write_str("gpu"),
            Self::Gpu(Some(number)) => write!(f, "gpu:{number}"),
            Self::Cuda(None) => f.write_str("cuda"),
            Self::Cuda(Some(number)) => write!(f, "cuda:{number}"),
            Self::LibTorchCpu => f.write_str("libtorch-cpu"),
            Self::LibTorch(None) => f.write_str("libtorch"),
            Self::LibTorch(Some(number)) => write!(f, "libtorch:{number}"),
        }
    }
}

impl FromStr for Processor {
    type Err = ProcessorError;

    fn from_str(name: &str) -> Result<Self, ProcessorError> {
        let (kind, number) = match name.split_once(':') {
            Some((kind, number)) => match number.parse() {
                Ok(number) => (kind, Some(number)),
                Err(_) => return Err(ProcessorError::Name(name.into())),
            },
            None => (name, None),
        };
        match (kind, number) {
            ("cpu", None) => Ok(Self::Cpu),
            ("gpu", number) => Ok(Self::Gpu(number)),
            ("cuda", number) => Ok(Self::Cuda(number)),
            ("libtorch-cpu", None) => Ok(Self::LibTorchCpu),
            ("libtorch", number) => Ok(Self::LibTorch(number)),
            _ => Err(ProcessorError::Name(name.into())),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_and_written() {
        for (name, processor) in [
            ("cpu", Processor::Cpu),
            ("gpu", Processor::Gpu(None)),
            ("gpu:2", Processor::Gpu(Some(2))),
            ("cuda", Processor::Cuda(None)),
            ("cuda:1", Processor::Cuda(Some(1))),
            ("libtorch-cpu", Processor::LibTorchCpu),
            ("libtorch", Processor::LibTorch(None)),
            ("libtorch:3", Processor::LibTorch(Some(3))),
        ] {
            assert_eq!(name.parse::<Processor>().unwrap(), processor);
            assert_eq!(processor.to_string(), name);
        }
        for name in [
            "",
            "GPU",
            "rocm",
            "gpu:",
            "gpu:-1",
            "gpu:x",
            "cpu:0",
            "cuda:",
            "libtorch:",
            "libtorch-cpu:0",
        ] {
            let error = name.parse::<Processor>().unwrap_err();
            assert!(matches!(error, ProcessorError::Name(_)), "{name}: {error}");
        }
    }

    #[test]
    fn several_are_read_and_written() {
        let names = "gpu:0,gpu:2,cpu";
        let processors: Processors = names.parse().unwrap();
        assert_eq!(processors.to_string(), names);
        assert_eq!(processors.count(), 3);
        assert_eq!(processors.first(), Processor::Gpu(Some(0)));
        for names in ["gpu:0,", ",gpu", "gpu:0 gpu:1", "gpu:0,1"] {
            assert!(names.parse::<Processors>().is_err(), "{names}");
        }
    }

    /// Each feature that is not compiled in is named by the error.
    #[test]
    fn a_program_without_a_backend_says_so() {
        let backends = [
            (cfg!(feature = "gpu"), Processor::Gpu(None), "gpu"),
            (cfg!(feature = "cuda"), Processor::Cuda(Some(1)), "cuda"),
            (
                cfg!(feature = "libtorch"),
                Processor::LibTorchCpu,
                "libtorch",
            ),
            (
                cfg!(feature = "libtorch"),
                Processor::LibTorch(None),
                "libtorch",
            ),
        ];
        for (_, processor, feature) in backends.into_iter().filter(|backend| !backend.0) {
            let error = processor.device().unwrap_err();
            assert!(
                matches!(error, ProcessorError::NotBuilt { feature: f, .. } if f == feature),
                "{error}"
            );
        }
    }
}
