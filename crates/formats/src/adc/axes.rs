//! Arrays of other tools: conversion into a cube from axes that are named and may be in any order.
//!
//! Names: `frame`, `loop`, `tx`, `chirp` (all slots of all loops in firing order, or only the loops if there is also a
//! `tx` or `virtual` axis), `rx`, `virtual` (all receivers of the first transmitter, then of the next), `sample`, and
//! `iq` (of length 2: I, then Q, for arrays of real numbers). An array without `frame` is one frame. Otherwise, frames
//! must be the slowest axis in memory, so that they can be read one at a time.

use num_complex::Complex32;
use radarllm_base::RadarCube;

use super::{AdcError, CubeShape, layout::AnalyticSignal};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Axis {
    Frame,
    Loop,
    Tx,
    /// Loops and slots combined.
    Chirp,
    Rx,
    /// Slots and receivers combined.
    Virtual,
    Sample,
    Iq,
}

const NAMES: [(&str, Axis); 8] = [
    ("frame", Axis::Frame),
    ("loop", Axis::Loop),
    ("tx", Axis::Tx),
    ("chirp", Axis::Chirp),
    ("rx", Axis::Rx),
    ("virtual", Axis::Virtual),
    ("sample", Axis::Sample),
    ("iq", Axis::Iq),
];

/// Axes of an array, slowest first as in a NumPy shape.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AxisOrder {
    axes: Vec<Axis>,
}

impl AxisOrder {
    /// Parses names separated by commas, such as `frame,chirp,rx,sample`.
    ///
    /// # Errors
    /// [`AdcError::Layout`] for an unknown or a repeated name, and for axes that do not make a cube.
    pub fn parse(text: &str) -> Result<Self, AdcError> {
        let mut axes = Vec::new();
        for name in text.split(',').map(str::trim) {
            let Some((_, axis)) = NAMES.iter().find(|(n, _)| *n == name) else {
                let known = NAMES.map(|(n, _)| n).join(", ");
                let name: String = name.chars().filter(|c| !c.is_control()).take(20).collect();
                return Err(AdcError::Layout(format!(
                    "axis `{name}` is none of {known}"
                )));
            };
            if axes.contains(axis) {
                return Err(AdcError::Layout(format!("axis `{name}` comes twice")));
            }
            axes.push(*axis);
        }
        let has = |axis| axes.contains(&axis);
        let slots = usize::from(has(Axis::Tx)) + usize::from(has(Axis::Virtual));
        let loops = usize::from(has(Axis::Loop)) + usize::from(has(Axis::Chirp));
        let receivers = usize::from(has(Axis::Rx)) + usize::from(has(Axis::Virtual));
        if !has(Axis::Sample) || slots > 1 || loops > 1 || receivers > 1 {
            return Err(AdcError::Layout(format!(
                "axes `{text}`: a cube has `sample`, at max one of `loop` and `chirp`, of `tx` and `virtual`, \
                 and of `rx` and `virtual`"
            )));
        }
        if has(Axis::Chirp)
            && slots == 1
            && let Some(axis) = axes.iter_mut().find(|a| **a == Axis::Chirp)
        {
            *axis = Axis::Loop;
        }
        Ok(Self { axes })
    }

    /// Returns whether the real and imaginary parts are an axis.
    pub fn has_iq(&self) -> bool {
        self.axes.contains(&Axis::Iq)
    }

    /// Fits the axes to an array of `shape`, whose frames have the shape of `cube`. With `is_fortran`, the first axis
    /// is the fastest in memory.
    ///
    /// # Errors
    /// [`AdcError::Layout`] if the lengths differ from those of the cube, or if frames are not the slowest axis.
    pub fn fit(
        &self,
        shape: &[u64],
        is_fortran: bool,
        cube: CubeShape,
    ) -> Result<FrameLayout, AdcError> {
        let n_values = cube.n_values()?;
        let wanted = |axis: Axis| -> Option<usize> {
            Some(match axis {
                Axis::Frame => return None,
                Axis::Loop => cube.n_loops,
                Axis::Tx => cube.n_tx,
                Axis::Chirp => cube.n_loops * cube.n_tx,
                Axis::Rx => cube.n_rx,
                Axis::Virtual => cube.n_tx * cube.n_rx,
                Axis::Sample => cube.n_samples,
                Axis::Iq => 2,
            })
        };
        let mut expected = 1_usize;
        let fits = shape.len() == self.axes.len()
            && self.axes.iter().zip(shape).all(|(axis, found)| {
                wanted(*axis).is_none_or(|w| {
                    expected = expected.saturating_mul(w);
                    w as u64 == *found
                })
            });
        let n_parts = if self.has_iq() { 2 } else { 1 };
        if !fits || expected != n_values * n_parts {
            let axes: Vec<String> = self
                .axes
                .iter()
                .map(|axis| {
                    let name = NAMES.iter().find(|(_, a)| a == axis).map_or("", |(n, _)| n);
                    wanted(*axis).map_or(format!("{name} *"), |n| format!("{name} {n}"))
                })
                .collect();
            return Err(AdcError::Layout(format!(
                "shape {shape:?}, expected [{}] for a radar of {} loops, {} slots, {} receivers and {} samples",
                axes.join(", "),
                cube.n_loops,
                cube.n_tx,
                cube.n_rx,
                cube.n_samples
            )));
        }
        // Sorted from the slowest to the fastest axis in memory.
        let mut axes: Vec<(Axis, u64)> = self
            .axes
            .iter()
            .copied()
            .zip(shape.iter().copied())
            .collect();
        if is_fortran {
            axes.reverse();
        }
        let n_frames = match axes.iter().position(|(axis, _)| *axis == Axis::Frame) {
            None => 1,
            Some(0) => axes.remove(0).1,
            Some(_) => {
                return Err(AdcError::Layout(
                    "frames must be the slowest axis in memory: save the array with frames first"
                        .into(),
                ));
            }
        };
        // Length and stride of the parts of [loop, tx, rx, sample] that each axis comprises.
        let strides = [
            cube.n_tx * cube.n_rx * cube.n_samples,
            cube.n_rx * cube.n_samples,
            cube.n_samples,
            1,
        ];
        let mut parts: Vec<(usize, usize)> = Vec::new();
        let mut iq_stride = None;
        let mut inner = n_values * n_parts;
        for (axis, length) in axes {
            inner /= (length as usize).max(1);
            match axis {
                Axis::Frame => {}
                Axis::Loop => parts.push((cube.n_loops, strides[0])),
                Axis::Tx => parts.push((cube.n_tx, strides[1])),
                Axis::Chirp => parts.extend([(cube.n_loops, strides[0]), (cube.n_tx, strides[1])]),
                Axis::Rx => parts.push((cube.n_rx, strides[2])),
                Axis::Virtual => parts.extend([(cube.n_tx, strides[1]), (cube.n_rx, strides[2])]),
                Axis::Sample => parts.push((cube.n_samples, 1)),
                Axis::Iq => iq_stride = Some(inner),
            }
        }
        Ok(FrameLayout {
            n_frames,
            parts: parts.into_iter().filter(|(n, _)| *n > 1).collect(),
            iq_stride,
            shape: cube,
        })
    }
}

/// Memory layout of the numbers of a frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FrameLayout {
    n_frames: u64,
    /// Length and cube stride of every axis but `iq`, slowest first.
    parts: Vec<(usize, usize)>,
    /// Numbers between I and Q, if they are an axis.
    iq_stride: Option<usize>,
    shape: CubeShape,
}

impl FrameLayout {
    /// Number of frames of the array.
    pub fn n_frames(&self) -> u64 {
        self.n_frames
    }

    /// Number of values of a frame, as stored in the array.
    pub fn n_numbers(&self) -> usize {
        let n = self.parts.iter().map(|(n, _)| n).product::<usize>();
        n * if self.iq_stride.is_some() { 2 } else { 1 }
    }

    /// Fills a cube from the numbers of a frame as stored in the array. Real numbers without an `iq` axis (`is_real`)
    /// are converted to the analytic signal.
    ///
    /// # Errors
    /// [`AdcError::Layout`] for a wrong number of values, a cube of another shape, or complex numbers with an `iq`
    /// axis.
    pub fn fill(
        &self,
        numbers: &[Complex32],
        is_real: bool,
        cube: &mut RadarCube,
    ) -> Result<(), AdcError> {
        let n_values = self.shape.n_values()?;
        if numbers.len() != self.n_numbers() || cube.data.len() != n_values {
            return Err(AdcError::Layout(format!(
                "expected {} numbers for a cube of {n_values}, found {} for {}",
                self.n_numbers(),
                numbers.len(),
                cube.data.len()
            )));
        }
        if self.iq_stride.is_some() && !is_real {
            return Err(AdcError::Layout("complex numbers have no `iq` axis".into()));
        }
        // Increments the indices of the axes like an odometer, and tracks the index in the cube.
        let mut index = vec![0_usize; self.parts.len()];
        let mut place = 0;
        for i in 0..n_values {
            cube.data[place] = match self.iq_stride {
                None => numbers[i],
                Some(stride) => {
                    let at = i / stride * 2 * stride + i % stride;
                    Complex32::new(numbers[at].re, numbers[at + stride].re)
                }
            };
            for (k, (length, stride)) in index.iter_mut().zip(&self.parts).rev() {
                *k += 1;
                place += stride;
                if *k < *length {
                    break;
                }
                place -= length * stride;
                *k = 0;
            }
        }
        if is_real && self.iq_stride.is_none() {
            let mut analytic = AnalyticSignal::new(self.shape.n_samples);
            for chirp in cube.data.chunks_exact_mut(self.shape.n_samples) {
                analytic.run(chirp);
            }
        }
        Ok(())
    }
}

/// Returns whether complex numbers are actually unsigned 16-bit words whose sign was lost: integers from 0 to 65,535 in
/// both parts, some of them beyond 32,767. A signal around zero never has this form.
pub fn are_unsigned_words(numbers: &[Complex32]) -> bool {
    numbers.iter().all(|z| is_word(z.re) && is_word(z.im))
        && numbers.iter().any(|z| z.re > 32_767.0 || z.im > 32_767.0)
}

fn is_word(value: f32) -> bool {
    value.fract() == 0.0 && (0.0..=65_535.0).contains(&value)
}

/// Restores the sign of unsigned words: 32,768 to 65,535 become -32,768 to -1.
///
/// # Errors
/// [`AdcError::Layout`] for a number that is not such a word, with its index; numbers before it have been changed.
pub fn sign_words(numbers: &mut [Complex32]) -> Result<(), AdcError> {
    for (i, z) in numbers.iter_mut().enumerate() {
        if !(is_word(z.re) && is_word(z.im)) {
            return Err(AdcError::Layout(format!(
                "number {i} is {z}, and the numbers so far were unsigned 16-bit words"
            )));
        }
        for part in [&mut z.re, &mut z.im] {
            if *part > 32_767.0 {
                *part -= 65_536.0;
            }
        }
    }
    Ok(())
}
