//! Encoder and decoder of the motion VQ-VAE.
//!
//! Arrays are `[clip, time, channel]`. A convolution over time is computed as a matrix product with the window laid out
//! along the channels, which is as fast as a matrix product.

use burn::module::{Module, Param};
use burn::nn::{Initializer, Linear, LinearConfig};
use burn::tensor::activation::relu;
use burn::tensor::{Device, Tensor};
use serde::{Deserialize, Serialize};

use super::MOTION_DIM;

/// Architecture of the motion VQ-VAE.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MotionVqVaeConfig {
    /// Number of channels, which is also the width of a feature and of a code.
    pub width: usize,
    /// Number of residual blocks after each downsampling by 2.
    pub depth: usize,
    /// Block i has the dilation `dilation^i`, largest first in the encoder.
    pub dilation: usize,
    /// Number of downsamplings by 2; 3 gives one feature per 8 frames.
    pub down: usize,
    /// Number of codes.
    pub codebook_size: usize,
}

impl Default for MotionVqVaeConfig {
    fn default() -> Self {
        Self::small()
    }
}

impl MotionVqVaeConfig {
    /// A network that can be trained on one CPU core.
    pub fn small() -> Self {
        Self {
            width: 128,
            depth: 3,
            dilation: 3,
            down: 3,
            codebook_size: 512,
        }
    }

    /// A network of T2M-GPT's width.
    pub fn paper() -> Self {
        Self {
            width: 512,
            ..Self::small()
        }
    }

    /// Checks every field.
    ///
    /// # Errors
    /// Names the first field that cannot be used.
    pub fn validate(&self) -> Result<(), String> {
        for (field, value, max) in [
            ("width", self.width, 2048),
            ("depth", self.depth, 8),
            ("dilation", self.dilation, 4),
            ("codebook_size", self.codebook_size, 65_536),
        ] {
            if value == 0 || value > max {
                return Err(format!("{field}: must be in 1..={max}, found {value}"));
            }
        }
        if self.down != 3 {
            // Any other rate would not be aligned with radar codes of 0.4 s.
            return Err(format!(
                "down: must be 3 (8 motion frames per code), found {}",
                self.down
            ));
        }
        Ok(())
    }
}

/// Convolution of kernel 3 over time with zero padding.
#[derive(Module, Debug)]
struct Conv3 {
    linear: Linear,
    #[module(skip)]
    dilation: usize,
}

impl Conv3 {
    fn new(from: usize, to: usize, dilation: usize, device: &Device) -> Self {
        Self {
            linear: LinearConfig::new(3 * from, to).init(device),
            dilation,
        }
    }

    fn forward(&self, x: Tensor<3>) -> Tensor<3> {
        let [n, t, c] = x.dims();
        let d = self.dilation;
        let zeros = Tensor::<3>::zeros([n, d, c], &x.device());
        let padded = Tensor::cat(vec![zeros.clone(), x.clone(), zeros], 1);
        let left = padded.clone().slice([0..n, 0..t, 0..c]);
        let right = padded.slice([0..n, 2 * d..2 * d + t, 0..c]);
        self.linear.forward(Tensor::cat(vec![left, x, right], 2))
    }
}

/// Convolution of kernel 4, stride 2, padding 1.
#[derive(Module, Debug)]
struct Halve {
    linear: Linear,
}

impl Halve {
    fn forward(&self, x: Tensor<3>) -> Tensor<3> {
        let [n, t, c] = x.dims();
        let zero = Tensor::<3>::zeros([n, 1, c], &x.device());
        let padded = Tensor::cat(vec![zero.clone(), x, zero], 1);
        // A window of four frames consists of two neighbouring pairs.
        let pairs = padded.reshape([n, t / 2 + 1, 2 * c]);
        let first = pairs.clone().slice([0..n, 0..t / 2, 0..2 * c]);
        let second = pairs.slice([0..n, 1..t / 2 + 1, 0..2 * c]);
        self.linear.forward(Tensor::cat(vec![first, second], 2))
    }
}

#[derive(Module, Debug)]
struct ResBlock {
    conv: Conv3,
    mix: Linear,
}

impl ResBlock {
    fn forward(&self, x: Tensor<3>) -> Tensor<3> {
        let hidden = self.conv.forward(relu(x.clone()));
        x + self.mix.forward(relu(hidden))
    }
}

fn res_blocks(config: &MotionVqVaeConfig, device: &Device) -> Vec<ResBlock> {
    let w = config.width;
    (0..config.depth)
        .rev()
        .map(|i| ResBlock {
            conv: Conv3::new(w, w, config.dilation.pow(i as u32), device),
            mix: LinearConfig::new(w, w).init(device),
        })
        .collect()
}

/// Encoder, decoder and codebook.
#[derive(Module, Debug)]
pub struct MotionNet {
    encode_in: Conv3,
    halves: Vec<Halve>,
    encode_blocks: Vec<Vec<ResBlock>>,
    encode_out: Conv3,
    decode_in: Conv3,
    decode_blocks: Vec<Vec<ResBlock>>,
    doubles: Vec<Conv3>,
    decode_mix: Conv3,
    decode_out: Conv3,
    /// Codes, `[K, width]`, updated by exponential moving averages.
    pub codebook: Param<Tensor<2>>,
}

impl MotionNet {
    /// Random weights, drawn from `device`'s generator.
    pub fn new(config: &MotionVqVaeConfig, device: &Device) -> Self {
        let w = config.width;
        let stages = || 0..config.down;
        Self {
            encode_in: Conv3::new(MOTION_DIM, w, 1, device),
            halves: stages()
                .map(|_| Halve {
                    linear: LinearConfig::new(4 * w, w).init(device),
                })
                .collect(),
            encode_blocks: stages().map(|_| res_blocks(config, device)).collect(),
            encode_out: Conv3::new(w, w, 1, device),
            decode_in: Conv3::new(w, w, 1, device),
            decode_blocks: stages().map(|_| res_blocks(config, device)).collect(),
            doubles: stages().map(|_| Conv3::new(w, w, 1, device)).collect(),
            decode_mix: Conv3::new(w, w, 1, device),
            decode_out: Conv3::new(w, MOTION_DIM, 1, device),
            codebook: Initializer::Zeros.init([config.codebook_size, w], device),
        }
    }

    /// Standardised motion `[n, 8 L, 263]` to features `[n, L, width]`.
    pub fn encode(&self, motion: Tensor<3>) -> Tensor<3> {
        let mut x = relu(self.encode_in.forward(motion));
        for (half, blocks) in self.halves.iter().zip(&self.encode_blocks) {
            x = half.forward(x);
            for block in blocks {
                x = block.forward(x);
            }
        }
        self.encode_out.forward(x)
    }

    /// Features or codes `[n, L, width]` to standardised motion `[n, 8 L, 263]`.
    pub fn decode(&self, features: Tensor<3>) -> Tensor<3> {
        let mut x = relu(self.decode_in.forward(features));
        for (double, blocks) in self.doubles.iter().zip(&self.decode_blocks) {
            for block in blocks {
                x = block.forward(x);
            }
            let [n, t, c] = x.dims();
            // Nearest-neighbour upsampling: every frame is repeated once.
            let twice = x
                .reshape([n, t, 1, c])
                .repeat_dim(2, 2)
                .reshape([n, 2 * t, c]);
            x = double.forward(twice);
        }
        self.decode_out.forward(relu(self.decode_mix.forward(x)))
    }
}
