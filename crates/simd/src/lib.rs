//! Sixteen `f32` lanes with run-time dispatch: three implementations of one trait, chosen at run time.
//!
//! Hot code is written once, as a function generic over [`Lanes`], and entered through a function
//! that [`dispatch!`] makes: it compiles the body for every level and calls the one asked for. Results
//! are equal to the byte on one [`SimdLevel`] and equal within rounding between levels: AVX-512 and
//! AVX2 fuse multiply and add, the portable level does not.

use num_complex::Complex32;

pub mod any_length;
pub mod fft;
pub mod lanes;

mod prefetch;

pub use prefetch::prefetch;

pub use lanes::{Lanes, SimdLevel, sin_cos_turns};

/// Number of lanes.
pub const LANES: usize = 16;

/// One complex number of sixteen rows, or channels, or bins.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(64))]
pub struct Cell {
    /// Real parts.
    pub re: [f32; LANES],
    /// Imaginary parts.
    pub im: [f32; LANES],
}

/// The memory of cells as complex numbers one after another: a buffer that starts on a cache line.
pub fn as_complex(cells: &mut [Cell]) -> &mut [num_complex::Complex32] {
    let n = cells.len() * LANES;
    // SAFETY: a cell is 2 * LANES floats and nothing else, a complex number two; its alignment is less; `cells` stays
    // borrowed.
    unsafe { std::slice::from_raw_parts_mut(cells.as_mut_ptr().cast(), n) }
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

    /// All numbers.
    pub fn numbers(&self) -> [Complex32; LANES] {
        std::array::from_fn(|lane| self.number(lane))
    }
}
