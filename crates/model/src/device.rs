//! Where the networks are computed.

use std::fmt;
use std::str::FromStr;

use burn::tensor::Device;
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// The processor that training and the networks as trained run on. Nothing falls back to another one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Processor {
    /// `"cpu"`.
    #[default]
    Cpu,
    /// `"gpu"`: the fastest graphics processor; `"gpu:1"`: a dedicated one by number, from 0. Through Vulkan, Metal,
    /// DirectX 12 or WebGPU.
    Gpu(Option<usize>),
}

/// One processor or several, `"gpu:0,gpu:1"`. The first keeps the weights; each takes a batch of an update.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Processors(Vec<Processor>);

impl Processors {
    /// The one that keeps the weights.
    pub fn first(&self) -> Processor {
        self.0.first().copied().unwrap_or_default()
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.0.len()
    }

    /// The framework's handles, in order.
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

/// A processor that cannot be used.
#[derive(Debug, Error)]
pub enum ProcessorError {
    /// Not a name of one.
    #[error(
        "`{0}` is no processor: `cpu`, `gpu`, or `gpu:N` for the dedicated one with number N, from 0"
    )]
    Name(String),
    /// The program lacks the code.
    #[error(
        "`{0}`: this program was built without graphics processors; `cargo build --release -p radarllm-cli --features gpu` \
         builds it with them"
    )]
    NotBuilt(Processor),
    /// The machine lacks it, or its driver refuses.
    #[error("`{processor}`: {message}")]
    Unavailable {
        /// What was asked for.
        processor: Processor,
        /// The driver's words.
        message: String,
    },
}

impl Processor {
    /// The framework's handle. A graphics processor is opened by the first call, which prints its name to the log.
    ///
    /// # Errors
    /// See [`ProcessorError`].
    pub fn device(self) -> Result<Device, ProcessorError> {
        match self {
            // Named explicitly: the default would prefer whatever accelerator was compiled in.
            Self::Cpu => Ok(Device::flex()),
            Self::Gpu(number) => open_gpu(number),
        }
    }
}

#[cfg(not(feature = "gpu"))]
fn open_gpu(number: Option<usize>) -> Result<Device, ProcessorError> {
    Err(ProcessorError::NotBuilt(Processor::Gpu(number)))
}

#[cfg(feature = "gpu")]
fn open_gpu(number: Option<usize>) -> Result<Device, ProcessorError> {
    use std::collections::BTreeMap;
    use std::sync::{Mutex, PoisonError};

    use burn::tensor::DeviceKind;

    // A processor can be opened once.
    static OPEN: Mutex<BTreeMap<Option<usize>, Device>> = Mutex::new(BTreeMap::new());
    let mut open = OPEN.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(device) = open.get(&number) {
        return Ok(device.clone());
    }
    let kind = number.map_or(DeviceKind::DefaultDevice, DeviceKind::DiscreteGpu);
    let (device, setup) = Device::wgpu_options()
        .device_kind(kind)
        .init_with_setup()
        .map_err(|e| ProcessorError::Unavailable {
            processor: Processor::Gpu(number),
            message: e.to_string(),
        })?;
    let info = setup.adapter.get_info();
    eprintln!(
        "{}: {} ({})",
        Processor::Gpu(number),
        info.name,
        setup.backend
    );
    open.insert(number, device.clone());
    Ok(device)
}

impl fmt::Display for Processor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Cpu => f.write_str("cpu"),
            Self::Gpu(None) => f.write_str("gpu"),
            Self::Gpu(Some(number)) => write!(f, "gpu:{number}"),
        }
    }
}

impl FromStr for Processor {
    type Err = ProcessorError;

    fn from_str(name: &str) -> Result<Self, ProcessorError> {
        match (name, name.strip_prefix("gpu:").map(str::parse)) {
            ("cpu", _) => Ok(Self::Cpu),
            ("gpu", _) => Ok(Self::Gpu(None)),
            (_, Some(Ok(number))) => Ok(Self::Gpu(Some(number))),
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
        ] {
            assert_eq!(name.parse::<Processor>().unwrap(), processor);
            assert_eq!(processor.to_string(), name);
        }
        for name in ["", "GPU", "cuda", "gpu:", "gpu:-1", "gpu:x", "cpu:0"] {
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

    #[cfg(not(feature = "gpu"))]
    #[test]
    fn a_program_without_graphics_processors_says_so() {
        let error = Processor::Gpu(None).device().unwrap_err();
        assert!(matches!(error, ProcessorError::NotBuilt(_)), "{error}");
    }
}
