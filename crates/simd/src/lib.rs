//! Vector code that is written once and runs on AVX-512, AVX2 and any other processor.
//!
//! A hot loop is a function generic over [`SimdF32x16`], sixteen `f32` at once. [`dispatch!`] compiles it for every
//! instruction set and makes a function that takes a [`SimdLevel`], the proof that this processor has one:
//!
//! ```
//! use radarllm_simd::{SimdF32x16, SimdLevel, dispatch};
//!
//! #[inline(always)]
//! fn power_body<L: SimdF32x16>(signal: &[[f32; 16]]) -> f32 {
//!     let mut sum = L::splat(0.0);
//!     for x in signal {
//!         let x = L::load(x);
//!         sum = x.fma(x, sum);
//!     }
//!     sum.reduce_sum()
//! }
//! dispatch!(
//!     /// Sum of squares.
//!     fn power => power_body(signal: &[[f32; 16]]) -> f32
//! );
//!
//! let level = SimdLevel::detect();
//! assert_eq!(power(level, &[[0.5; 16]; 4]), 16.0);
//! ```
//!
//! # FFTs
//!
//! [`any_length`] transforms single rows of any length. [`fft`] transforms sixteen rows at once, one row per lane, for
//! lengths whose prime factors are at most 7. Kernels can combine its passes with the computations before and after
//! them. Both are forward, `exp(-j 2 pi k n / N)`, in natural order and not normalised:
//!
//! ```
//! use radarllm_simd::{Cell, SimdLevel, any_length, fft};
//! use num_complex::Complex32;
//!
//! // A tone in bin 3 of 12.
//! let tone = |n: usize| Complex32::cis(std::f32::consts::TAU * 3.0 * n as f32 / 12.0);
//! let mut row: Vec<Complex32> = (0..12).map(tone).collect();
//! any_length::forward(12).process(&mut row);
//! assert!((row[3] - 12.0).norm() < 1e-5 && row[4].norm() < 1e-5);
//!
//! // The same in all sixteen lanes: plan once, then transform from buffer to buffer.
//! let level = SimdLevel::detect();
//! let radices = fft::factors(12, level).ok_or("a prime factor above 7")?;
//! let passes = fft::passes(12, &radices);
//! let rows: Vec<Cell> = (0..12)
//!     .map(|n| Cell { re: [tone(n).re; 16], im: [tone(n).im; 16] })
//!     .collect();
//! let (mut out, mut spare) = (vec![Cell::ZERO; 12], vec![Cell::ZERO; 12]);
//! fft::all_cell_passes(level, &passes, &rows, &mut out, &mut spare);
//! assert!((out[3].number(15) - row[3]).norm() < 1e-5);
//! # Ok::<(), &str>(())
//! ```
//!
//! # Soundness
//!
//! Running an instruction that the processor lacks is undefined behaviour. Two rules prevent safe code from doing so. A
//! [`SimdLevel`] can be created only by checking the processor. The vector types have no public names: a [`Kernel`]
//! receives them as a type parameter from [`SimdLevel::run`].
//!
//! # Reproducibility
//!
//! Results are byte-identical on one [`SimdLevel`] and equal within rounding between levels: AVX-512 and AVX2 round
//! `a * b + c` once, the portable level twice.
//!
//! Reading order: [`SimdF32x16`], [`SimdLevel`] and [`dispatch!`], [`ByteDot`], [`fft`], [`any_length`].

#![cfg_attr(
    test,
    allow(clippy::disallowed_methods, unreachable_pub, reason = "tests")
)]

use num_complex::Complex32;

pub mod any_length;
pub mod fft;

mod byte_dot;
mod f32x16;
mod level;
mod portable;
mod prefetch;
#[cfg(target_arch = "x86_64")]
mod x86;

pub use byte_dot::ByteDot;
pub use f32x16::{SimdF32x16, sin_cos_turns};
pub use level::{ByteKernel, InstructionSet, Kernel, SimdLevel};
pub use prefetch::prefetch;

/// Number of lanes.
pub const LANES: usize = 16;

/// Restricts implementations of the vector traits to this crate.
mod sealed {
    pub trait Sealed {}
}

/// One complex number for each of sixteen rows, channels or bins.
///
/// Aligned to a cache line, because a vector that crosses a cache line boundary takes twice as long to load.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(64))]
pub struct Cell {
    /// Real parts.
    pub re: [f32; LANES],
    /// Imaginary parts.
    pub im: [f32; LANES],
}

impl Cell {
    /// All zero.
    pub const ZERO: Self = Self {
        re: [0.0; LANES],
        im: [0.0; LANES],
    };

    /// The number in one lane.
    pub fn number(&self, lane: usize) -> Complex32 {
        Complex32::new(self.re[lane], self.im[lane])
    }

    /// The numbers in all lanes.
    pub fn numbers(&self) -> [Complex32; LANES] {
        std::array::from_fn(|lane| self.number(lane))
    }
}
