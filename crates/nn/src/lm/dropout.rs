//! Dropout whose masks are generated from an explicit seed. A resumed run draws the same masks as an uninterrupted
//! run, and a GPU draws the same masks as the CPU.

use burn::tensor::{DType, Device, Int, IntDType, Tensor, TensorData};

use crate::device::is_cpu;
use radarllm_base::random::{INCREMENT, MIX_FACTORS, step};

/// Number of elements that share a draw: 16 random bits each, so probabilities are rounded to 1/65536.
const SHARE: usize = 4;

/// Number of draws that a GPU makes at once, for many masks: a draw takes dozens of kernels, whatever its size.
const AHEAD: usize = 1 << 20;

/// Generator of dropout masks from an explicit seed.
pub struct DropoutRng {
    state: u64,
    /// What a GPU has drawn from `state` on.
    ahead: Option<Ahead>,
}

/// Elements of masks that were drawn on a GPU and are not used yet.
struct Ahead {
    /// 0 or `1 / (1 - p)`, `[n_draws * SHARE]`.
    elements: Tensor<1>,
    device: Device,
    threshold: u32,
    /// Number of draws that earlier masks took.
    n_used: usize,
    n_draws: usize,
}

impl DropoutRng {
    /// A generator with the given seed.
    pub fn new(seed: u64) -> Self {
        Self {
            state: seed,
            ahead: None,
        }
    }

    /// 0 with probability `p`, else `1 / (1 - p)`.
    pub(crate) fn mask<const D: usize>(
        &mut self,
        shape: [usize; D],
        p: f64,
        device: &Device,
    ) -> Tensor<D> {
        let len = shape.iter().product::<usize>();
        let threshold = (p * 65536.0).round() as u32;
        let keep = (1.0 / (1.0 - p)) as f32;
        let mask = if is_cpu(device) {
            let elements = TensorData::new(self.on_cpu(len, threshold, keep), [len]);
            Tensor::<1>::from_data(elements, device)
        } else {
            self.take_ahead(len, threshold, keep, device)
        };
        self.advance(len);
        mask.reshape(shape)
    }

    /// Moves the state beyond the draws of `len` elements.
    fn advance(&mut self, len: usize) {
        let n_draws = len.div_ceil(SHARE) as u64;
        self.state = self.state.wrapping_add(INCREMENT.wrapping_mul(n_draws));
    }

    /// `len` elements of what a GPU has drawn, or draws now.
    fn take_ahead(&mut self, len: usize, threshold: u32, keep: f32, device: &Device) -> Tensor<1> {
        let n_draws = len.div_ceil(SHARE);
        let fits = |a: &Ahead| {
            a.device == *device && a.threshold == threshold && a.n_draws - a.n_used >= n_draws
        };
        let mut ahead = self.ahead.take().filter(fits).unwrap_or_else(|| {
            let n_draws = n_draws.max(AHEAD);
            Ahead {
                elements: self.on_gpu(n_draws, threshold, keep, device),
                device: device.clone(),
                threshold,
                n_used: 0,
                n_draws,
            }
        });
        let elements = (ahead.elements.clone()).narrow(0, ahead.n_used * SHARE, len);
        ahead.n_used += n_draws;
        self.ahead = Some(ahead);
        elements
    }

    fn on_cpu(&self, len: usize, threshold: u32, keep: f32) -> Vec<f32> {
        let mut state = self.state;
        let mut out = vec![0.0; len.next_multiple_of(SHARE)];
        for four in out.chunks_exact_mut(SHARE) {
            // Masks take a large part of a training step, and need no better generator.
            let z = step(&mut state);
            for (i, value) in four.iter_mut().enumerate() {
                let kept = (z >> (16 * i)) & 0xffff >= u64::from(threshold);
                *value = if kept { keep } else { 0.0 };
            }
        }
        out.truncate(len);
        out
    }

    /// Generates the same numbers on the GPU, `[n_draws * SHARE]`. A mask is as large as the tensor that it is applied to,
    /// and would otherwise be the largest part of the data that is transferred to the GPU.
    fn on_gpu(&self, n_draws: usize, threshold: u32, keep: f32, device: &Device) -> Tensor<1> {
        // Backends without unsigned numbers have 64-bit ones.
        match device.supports_dtype(IntDType::U32) {
            true => self.in_halves(n_draws, threshold, keep, device),
            false => self.in_64_bits(n_draws, threshold, keep, device),
        }
    }

    fn in_halves(&self, n_draws: usize, threshold: u32, keep: f32, device: &Device) -> Tensor<1> {
        let range = 1..n_draws as i64 + 1;
        let lo = Tensor::<1, Int>::arange(range, (device, DType::U32));
        let hi = lo.zeros_like();
        let mut z = U64 { hi, lo }.times(INCREMENT).plus(self.state);
        z = z.xor_shifted(30).times(MIX_FACTORS[0]);
        z = z.xor_shifted(27).times(MIX_FACTORS[1]);
        z = z.xor_shifted(31);
        let low_half = |x: &Tensor<1, Int>| x.clone().bitwise_and_scalar(0xffff_u32);
        let high_half = |x: Tensor<1, Int>| x.bitwise_right_shift_scalar(16_u32);
        let parts = [
            low_half(&z.lo),
            high_half(z.lo),
            low_half(&z.hi),
            high_half(z.hi),
        ];
        let kept = parts.map(|bits| bits.greater_equal_elem(threshold).float() * keep);
        Tensor::stack::<2>(kept.to_vec(), 1).reshape([n_draws * SHARE])
    }

    fn in_64_bits(&self, n_draws: usize, threshold: u32, keep: f32, device: &Device) -> Tensor<1> {
        // Shifts of signed numbers repeat the sign, which is cut off.
        let shifted = |z: &Tensor<1, Int>, n: i64| {
            let bits = i64::MAX >> (n - 1);
            (z.clone().bitwise_right_shift_scalar(n)).bitwise_and_scalar(bits)
        };
        let xor_shifted = |z: Tensor<1, Int>, n: i64| z.clone().bitwise_xor(shifted(&z, n));
        let range = 1..n_draws as i64 + 1;
        let n = Tensor::<1, Int>::arange(range, (device, DType::I64));
        let z = n * INCREMENT.cast_signed() + self.state.cast_signed();
        let z = xor_shifted(z, 30) * MIX_FACTORS[0].cast_signed();
        let z = xor_shifted(z, 27) * MIX_FACTORS[1].cast_signed();
        let z = xor_shifted(z, 31);
        let parts = (0..SHARE as i64)
            .map(|i| (z.clone().bitwise_right_shift_scalar(16 * i)).bitwise_and_scalar(0xffff_i64));
        let bits = Tensor::stack::<2>(parts.collect(), 1).reshape([n_draws * SHARE]);
        bits.greater_equal_elem(threshold).float() * keep
    }
}

/// Unsigned 64-bit numbers in two 32-bit halves, because GPUs need not support more than 32 bits. All operations are
/// modulo 2^64.
struct U64 {
    hi: Tensor<1, Int>,
    lo: Tensor<1, Int>,
}

impl U64 {
    fn times(self, factor: u64) -> Self {
        let (factor_hi, factor_lo) = ((factor >> 32) as u32, factor as u32);
        let (b1, b0) = (factor_lo >> 16, factor_lo & 0xffff);
        let low = |x: &Tensor<1, Int>| x.clone().bitwise_and_scalar(0xffff_u32);
        let high = |x: &Tensor<1, Int>| x.clone().bitwise_right_shift_scalar(16_u32);
        let (a1, a0) = (high(&self.lo), low(&self.lo));
        // Long multiplication of the lower halves in digits of 16 bits; no sum exceeds 32.
        let p00 = a0.clone() * b0;
        let first = a0 * b1 + high(&p00);
        let second = a1.clone() * b0 + low(&first);
        let carried = a1 * b1 + high(&first) + high(&second);
        let hi = self.hi * factor_lo + self.lo * factor_hi + carried;
        let lo = second
            .bitwise_left_shift_scalar(16_u32)
            .bitwise_or(low(&p00));
        Self { hi, lo }
    }

    fn plus(self, term: u64) -> Self {
        let (term_hi, term_lo) = ((term >> 32) as u32, term as u32);
        let lo = self.lo.clone() + term_lo;
        // The top bit has a carry if both terms have the bit, or if one of them has it and the sum does not.
        let both = self.lo.clone().bitwise_and_scalar(term_lo);
        let one = self.lo.bitwise_or_scalar(term_lo);
        let carry = both.bitwise_or(one.bitwise_and(lo.clone().bitwise_not()));
        let hi = self.hi + term_hi + carry.bitwise_right_shift_scalar(31_u32);
        Self { hi, lo }
    }

    /// `z ^ (z >> n)`, n in 1..32.
    fn xor_shifted(self, n: u32) -> Self {
        let lo = (self.lo.clone().bitwise_right_shift_scalar(n))
            .bitwise_or(self.hi.clone().bitwise_left_shift_scalar(32 - n));
        let hi = self.hi.clone().bitwise_right_shift_scalar(n);
        Self {
            hi: self.hi.bitwise_xor(hi),
            lo: self.lo.bitwise_xor(lo),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Draws the masks as on GPUs, but with tensors on the CPU.
    #[test]
    fn tensors_draw_what_loops_draw() {
        for seed in [0, 1, 0xffff_ffff, 0x8000_0000_8000_0000, u64::MAX] {
            let rng = DropoutRng::new(seed);
            let loops = rng.on_cpu(4_100, 6_554, 1.25);
            let halves = rng.in_halves(1_025, 6_554, 1.25, &Device::flex());
            let whole = rng.in_64_bits(1_025, 6_554, 1.25, &Device::flex());
            assert_eq!(halves.into_data().try_into_vec::<f32>().unwrap(), loops);
            assert_eq!(whole.into_data().try_into_vec::<f32>().unwrap(), loops);
            let dropped = loops.iter().filter(|v| **v == 0.0).count();
            // A tenth of 4,100; the tolerance is five standard deviations of 19.
            assert!((315..505).contains(&dropped), "{dropped}");
        }
    }

    /// Masks that share a draw of a GPU are those that are drawn one by one, also where the draw ends or the probability
    /// changes.
    #[test]
    fn masks_that_are_drawn_ahead_do_not_change() {
        let device = Device::flex();
        let read = |t: Tensor<1>| t.into_data().try_into_vec::<f32>().unwrap();
        let (mut together, mut alone) = (DropoutRng::new(7), DropoutRng::new(7));
        for (len, p) in [
            (10, 0.5),
            (9, 0.5),
            (6, 0.125),
            (4_000_000, 0.125),
            (1_000_000, 0.125),
            (3, 0.5),
        ] {
            let expected = read(alone.mask([len], p, &device));
            let threshold = (p * 65536.0) as u32;
            let keep = (1.0 / (1.0 - p)) as f32;
            let found = read(together.take_ahead(len, threshold, keep, &device));
            together.advance(len);
            assert!(found == expected, "{len} {p}");
        }
    }

    #[test]
    fn masks_do_not_depend_on_how_they_are_cut() {
        let device = Device::flex();
        let read = |t: Tensor<1>| t.into_data().try_into_vec::<f32>().unwrap();
        let mut rng = DropoutRng::new(7);
        let mut pieces = read(rng.mask([8], 0.5, &device));
        pieces.extend(read(rng.mask([12], 0.5, &device)));
        assert_eq!(pieces, read(DropoutRng::new(7).mask([20], 0.5, &device)));
    }

    /// Taken from the first release's code, because resumed training runs depend on them.
    #[test]
    fn masks_never_change() {
        let mask = DropoutRng::new(7).on_cpu(64, 32_768, 1.0);
        let bits = mask
            .iter()
            .rev()
            .fold(0, |bits, v| bits << 1 | u64::from(*v != 0.0));
        assert_eq!(bits, 15918401032484342308);
    }
}
