//! FFTs of sixteen rows at once: a row to a lane, so that no butterfly shuffles lanes.
//!
//! Stockham's self-sorting algorithm, decimation in frequency: one pass a factor, from one buffer to
//! the other. Lengths with other prime factors than 2, 3, 5 and 7 go through `rustfft` row by row.
//! Forward (`exp(-j 2 pi k n / N)`), not normalised.

use std::f32::consts::FRAC_1_SQRT_2;
use std::f64::consts::TAU;
use std::sync::Arc;

use num_complex::Complex32;
use radarllm_simd::{Cell, LANES, Lanes, SimdLevel, dispatch};
use rustfft::{Fft, FftPlanner};

/// The plan of a length.
pub(crate) struct LaneFft {
    len: usize,
    passes: Option<Vec<Pass>>,
    /// For lengths that have no passes.
    rows: Option<Rows>,
}

struct Rows {
    fft: Arc<dyn Fft<f32>>,
    row: Vec<Complex32>,
    scratch: Vec<Complex32>,
}

/// One factor.
pub(crate) struct Pass {
    radix: usize,
    /// Distance of the butterflies' inputs and of its outputs' neighbours, cells.
    stride: usize,
    /// `[p][k - 1]` (cos, sin) of `-2 pi p k / length left`, k in 1..radix; none in the last pass.
    twiddles: Vec<[f32; 2]>,
}

impl LaneFft {
    /// Plans transforms of `len` numbers.
    pub fn new(len: usize) -> Self {
        let passes = factors(len).map(|radices| passes(len, &radices));
        let rows = passes.is_none().then(|| {
            let fft = FftPlanner::new().plan_fft_forward(len);
            Rows {
                row: vec![Complex32::ZERO; len],
                scratch: vec![Complex32::ZERO; fft.get_inplace_scratch_len()],
                fft,
            }
        });
        Self { len, passes, rows }
    }

    /// Whether [`Self::process`] wants its input in `spare`, rather than in `out`.
    pub fn starts_in_spare(&self) -> bool {
        self.passes.as_ref().is_some_and(|p| p.len() % 2 == 1)
    }

    /// Transforms from `out`, or from `spare` if [`Self::starts_in_spare`], to `out`. What `spare` holds
    /// afterwards means nothing.
    ///
    /// # Panics
    /// If a buffer is shorter than the length.
    pub fn process(&mut self, level: SimdLevel, out: &mut [Cell], spare: &mut [Cell]) {
        let (out, spare) = (&mut out[..self.len], &mut spare[..self.len]);
        if let Some(passes) = &self.passes {
            if passes.len() % 2 == 1 {
                all_passes(level, passes, spare, out);
            } else {
                all_passes(level, passes, out, spare);
            }
        }
        if let Some(Rows { fft, row, scratch }) = &mut self.rows {
            for lane in 0..LANES {
                for (to, from) in row.iter_mut().zip(&*out) {
                    *to = Complex32::new(from.re[lane], from.im[lane]);
                }
                fft.process_with_scratch(row, scratch);
                for (to, from) in out.iter_mut().zip(&*row) {
                    (to.re[lane], to.im[lane]) = (from.re, from.im);
                }
            }
        }
    }
}

/// Radices whose product is `len`, largest first; `None` if a prime is too large.
pub(crate) fn factors(len: usize) -> Option<Vec<usize>> {
    let mut rest = len.max(1);
    let mut radices = vec![];
    for radix in [16, 8, 4, 6, 2, 3, 5, 7] {
        // 16 x 2 is better done as 8 x 4.
        while rest.is_multiple_of(radix) && (radix, rest) != (16, 32) {
            radices.push(radix);
            rest /= radix;
        }
    }
    (rest == 1).then_some(radices)
}

/// (cos, sin) of `-2 pi index / len`.
pub(crate) fn root(index: usize, len: usize) -> [f32; 2] {
    let (sin, cos) = (-TAU * (index % len) as f64 / len as f64).sin_cos();
    [cos as f32, sin as f32]
}

/// Passes of a transform of `len` with these radices.
pub(crate) fn passes(len: usize, radices: &[usize]) -> Vec<Pass> {
    let (mut left, mut stride) = (len, 1);
    radices
        .iter()
        .map(|&radix| {
            let m = left / radix;
            let twiddles = if m == 1 {
                vec![]
            } else {
                (0..m)
                    .flat_map(|p| (1..radix).map(move |k| root(p * k, left)))
                    .collect()
            };
            let pass = Pass {
                radix,
                stride,
                twiddles,
            };
            left = m;
            stride *= radix;
            pass
        })
        .collect()
}

dispatch!(fn all_passes => all_passes_body(
    passes: &[Pass], data: &mut [Cell], spare: &mut [Cell]
));

/// Ends in `data` after an even number of passes, else in `spare`.
#[inline(always)]
pub(crate) fn all_passes_body<L: Lanes>(passes: &[Pass], data: &mut [Cell], spare: &mut [Cell]) {
    for (i, pass) in passes.iter().enumerate() {
        let (from, to): (&[Cell], &mut [Cell]) = if i % 2 == 0 {
            (&*data, &mut *spare)
        } else {
            (&*spare, &mut *data)
        };
        match pass.radix {
            2 => run_pass::<L, 2>(pass, from, to, dft2),
            3 => run_pass::<L, 3>(pass, from, to, dft3),
            4 => run_pass::<L, 4>(pass, from, to, dft4),
            5 => run_pass::<L, 5>(pass, from, to, dft5),
            6 => run_pass::<L, 6>(pass, from, to, dft6),
            8 => run_pass::<L, 8>(pass, from, to, dft8),
            16 => run_pass::<L, 16>(pass, from, to, dft16),
            7 => run_pass::<L, 7>(pass, from, to, dft7),
            other => unreachable!("no pass of radix {other}"),
        }
    }
}

/// One pass: butterflies over the inputs `stride * m` apart, outputs turned and laid `stride` apart.
#[inline(always)]
fn run_pass<L: Lanes, const R: usize>(
    pass: &Pass,
    from: &[Cell],
    to: &mut [Cell],
    dft: impl Fn([C<L>; R]) -> [C<L>; R],
) {
    let s = pass.stride;
    let n = from.len().min(to.len());
    let (from, to) = (&from[..n], &mut to[..n]);
    let m = n / (R * s);
    for p in 0..m {
        let twiddles = pass.twiddles.get(p * (R - 1)..(p + 1) * (R - 1));
        let rows = &mut to[p * R * s..(p + 1) * R * s];
        for q in 0..s {
            let a = std::array::from_fn(|k| C::load(&from[q + s * (p + m * k)]));
            let b = dft(a);
            match twiddles {
                // The first group's twiddles are all one, and so are those of the last pass.
                Some(twiddles) if p > 0 => {
                    b[0].store(&mut rows[q]);
                    for k in 1..R {
                        let z = b[k].turned(twiddles[k - 1]);
                        z.store(&mut rows[q + s * k]);
                    }
                }
                _ => {
                    for (k, z) in b.into_iter().enumerate() {
                        z.store(&mut rows[q + s * k]);
                    }
                }
            }
        }
    }
}

/// Sixteen complex numbers in registers.
#[derive(Clone, Copy)]
pub(crate) struct C<L> {
    pub re: L,
    pub im: L,
}

impl<L: Lanes> C<L> {
    #[inline(always)]
    pub fn load(cell: &Cell) -> Self {
        Self {
            re: L::load(&cell.re),
            im: L::load(&cell.im),
        }
    }

    #[inline(always)]
    pub fn store(self, cell: &mut Cell) {
        self.re.store(&mut cell.re);
        self.im.store(&mut cell.im);
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self {
            re: self.re.add(other.re),
            im: self.im.add(other.im),
        }
    }

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self {
            re: self.re.sub(other.re),
            im: self.im.sub(other.im),
        }
    }

    /// `self - j other`.
    #[inline(always)]
    fn sub_j(self, other: Self) -> Self {
        Self {
            re: self.re.add(other.im),
            im: self.im.sub(other.re),
        }
    }

    /// `self + j other`.
    #[inline(always)]
    fn add_j(self, other: Self) -> Self {
        Self {
            re: self.re.sub(other.im),
            im: self.im.add(other.re),
        }
    }

    #[inline(always)]
    fn scaled(self, factor: f32) -> Self {
        let factor = L::splat(factor);
        Self {
            re: self.re.mul(factor),
            im: self.im.mul(factor),
        }
    }

    /// `self + factor * other`.
    #[inline(always)]
    fn plus_scaled(self, factor: f32, other: Self) -> Self {
        let factor = L::splat(factor);
        Self {
            re: factor.fma(other.re, self.re),
            im: factor.fma(other.im, self.im),
        }
    }

    #[inline(always)]
    fn turned(self, [cos, sin]: [f32; 2]) -> Self {
        let (cos, sin) = (L::splat(cos), L::splat(sin));
        Self {
            re: self.im.fnma(sin, self.re.mul(cos)),
            im: self.im.fma(cos, self.re.mul(sin)),
        }
    }

    /// Times `exp(-j pi / 4)`.
    #[inline(always)]
    fn eighth(self) -> Self {
        Self {
            re: self.re.add(self.im),
            im: self.im.sub(self.re),
        }
        .scaled(FRAC_1_SQRT_2)
    }

    /// Times `exp(-j 3 pi / 4)`.
    #[inline(always)]
    fn three_eighths(self) -> Self {
        Self {
            re: self.im.sub(self.re).mul(L::splat(FRAC_1_SQRT_2)),
            im: self.im.add(self.re).mul(L::splat(-FRAC_1_SQRT_2)),
        }
    }

    /// Times `-j`.
    #[inline(always)]
    fn quarter(self) -> Self {
        Self {
            re: self.im,
            im: L::splat(0.0).sub(self.re),
        }
    }
}

#[inline(always)]
fn dft2<L: Lanes>([a, b]: [C<L>; 2]) -> [C<L>; 2] {
    [a.add(b), a.sub(b)]
}

#[inline(always)]
fn dft3<L: Lanes>([a, b, c]: [C<L>; 3]) -> [C<L>; 3] {
    let (sum, difference) = (b.add(c), b.sub(c));
    let middle = a.plus_scaled(-0.5, sum);
    let side = difference.scaled(0.866_025_4);
    [a.add(sum), middle.sub_j(side), middle.add_j(side)]
}

#[inline(always)]
fn dft4<L: Lanes>([a, b, c, d]: [C<L>; 4]) -> [C<L>; 4] {
    let (ac, ac_minus) = (a.add(c), a.sub(c));
    let (bd, bd_minus) = (b.add(d), b.sub(d));
    [
        ac.add(bd),
        ac_minus.sub_j(bd_minus),
        ac.sub(bd),
        ac_minus.add_j(bd_minus),
    ]
}

#[inline(always)]
fn dft5<L: Lanes>([a, b, c, d, e]: [C<L>; 5]) -> [C<L>; 5] {
    // cos and sin of 2 pi / 5 and 4 pi / 5.
    const C1: f32 = 0.309_017;
    const C2: f32 = -0.809_017;
    const S1: f32 = 0.951_056_5;
    const S2: f32 = 0.587_785_25;
    let (be, be_minus) = (b.add(e), b.sub(e));
    let (cd, cd_minus) = (c.add(d), c.sub(d));
    let near = a.plus_scaled(C1, be).plus_scaled(C2, cd);
    let far = a.plus_scaled(C2, be).plus_scaled(C1, cd);
    let near_side = be_minus.scaled(S1).plus_scaled(S2, cd_minus);
    let far_side = be_minus.scaled(S2).plus_scaled(-S1, cd_minus);
    [
        a.add(be).add(cd),
        near.sub_j(near_side),
        far.sub_j(far_side),
        far.add_j(far_side),
        near.add_j(near_side),
    ]
}

/// Good and Thomas: 2 and 3 have no common factor, so there are no twiddles.
#[inline(always)]
fn dft6<L: Lanes>([a, b, c, d, e, f]: [C<L>; 6]) -> [C<L>; 6] {
    let [x0, x4, x2] = dft3([a, c, e]);
    let [y0, y4, y2] = dft3([d, f, b]);
    let ([z0, z3], [z4, z1], [z2, z5]) = (dft2([x0, y0]), dft2([x4, y4]), dft2([x2, y2]));
    [z0, z1, z2, z3, z4, z5]
}

#[inline(always)]
fn dft8<L: Lanes>([a, b, c, d, e, f, g, h]: [C<L>; 8]) -> [C<L>; 8] {
    let [e0, e1, e2, e3] = dft4([a, c, e, g]);
    let [o0, o1, o2, o3] = dft4([b, d, f, h]);
    let (o1, o3) = (o1.eighth(), o3.three_eighths());
    [
        e0.add(o0),
        e1.add(o1),
        e2.sub_j(o2),
        e3.add(o3),
        e0.sub(o0),
        e1.sub(o1),
        e2.add_j(o2),
        e3.sub(o3),
    ]
}

#[inline(always)]
pub(crate) fn dft16<L: Lanes>(a: [C<L>; 16]) -> [C<L>; 16] {
    // cos and sin of pi / 8.
    const C1: f32 = 0.923_879_5;
    const S1: f32 = 0.382_683_43;
    let [p0, p1, p2, p3] = dft4([a[0], a[4], a[8], a[12]]);
    let [q0, q1, q2, q3] = dft4([a[1], a[5], a[9], a[13]]);
    let [r0, r1, r2, r3] = dft4([a[2], a[6], a[10], a[14]]);
    let [s0, s1, s2, s3] = dft4([a[3], a[7], a[11], a[15]]);
    let [b0, b4, b8, b12] = dft4([p0, q0, r0, s0]);
    let [b1, b5, b9, b13] = dft4([p1, q1.turned([C1, -S1]), r1.eighth(), s1.turned([S1, -C1])]);
    let [b2, b6, b10, b14] = dft4([p2, q2.eighth(), r2.quarter(), s2.three_eighths()]);
    let [b3, b7, b11, b15] = dft4([
        p3,
        q3.turned([S1, -C1]),
        r3.three_eighths(),
        s3.turned([-C1, S1]),
    ]);
    [
        b0, b1, b2, b3, b4, b5, b6, b7, b8, b9, b10, b11, b12, b13, b14, b15,
    ]
}

#[inline(always)]
fn dft7<L: Lanes>([a, b, c, d, e, f, g]: [C<L>; 7]) -> [C<L>; 7] {
    // cos and sin of 2 pi / 7, 4 pi / 7 and 6 pi / 7.
    const C: [f32; 3] = [0.623_489_8, -0.222_520_93, -0.900_968_9];
    const S: [f32; 3] = [0.781_831_5, 0.974_927_9, 0.433_883_74];
    let (bg, bg_minus) = (b.add(g), b.sub(g));
    let (cf, cf_minus) = (c.add(f), c.sub(f));
    let (de, de_minus) = (d.add(e), d.sub(e));
    let even = |i: usize, j: usize, k: usize| {
        a.plus_scaled(C[i], bg)
            .plus_scaled(C[j], cf)
            .plus_scaled(C[k], de)
    };
    let (e1, e2, e3) = (even(0, 1, 2), even(1, 2, 0), even(2, 0, 1));
    let odd = |s: [f32; 3]| {
        bg_minus
            .scaled(s[0])
            .plus_scaled(s[1], cf_minus)
            .plus_scaled(s[2], de_minus)
    };
    let o1 = odd([S[0], S[1], S[2]]);
    let o2 = odd([S[1], -S[2], -S[0]]);
    let o3 = odd([S[2], -S[0], S[1]]);
    [
        a.add(bg).add(cf).add(de),
        e1.sub_j(o1),
        e2.sub_j(o2),
        e3.sub_j(o3),
        e3.add_j(o3),
        e2.add_j(o2),
        e1.add_j(o1),
    ]
}

/// Numbers in -1..1 for tests.
#[cfg(test)]
pub(crate) fn uniform(seed: u32) -> impl FnMut() -> f32 {
    let mut state = seed;
    move || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1 << 23) as f32 - 1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every lane another signal.
    fn signal(len: usize) -> Vec<Cell> {
        let mut next = uniform(1);
        (0..len)
            .map(|_| Cell {
                re: std::array::from_fn(|_| next()),
                im: std::array::from_fn(|_| next()),
            })
            .collect()
    }

    /// Largest error of any lane against the definition in f64, relative to the largest value.
    fn error(len: usize, level: SimdLevel) -> f64 {
        let input = signal(len);
        let mut fft = LaneFft::new(len);
        let (mut out, mut spare) = (vec![Cell::ZERO; len], vec![Cell::ZERO; len]);
        if fft.starts_in_spare() {
            spare.copy_from_slice(&input);
        } else {
            out.copy_from_slice(&input);
        }
        fft.process(level, &mut out, &mut spare);
        let (mut worst, mut peak) = (0.0_f64, 0.0_f64);
        for (k, cell) in out.iter().enumerate() {
            for lane in 0..LANES {
                let (mut re, mut im) = (0.0, 0.0);
                for (n, x) in input.iter().enumerate() {
                    let (sin, cos) = (-TAU * (k * n % len) as f64 / len as f64).sin_cos();
                    let (x_re, x_im) = (f64::from(x.re[lane]), f64::from(x.im[lane]));
                    re += x_re * cos - x_im * sin;
                    im += x_re * sin + x_im * cos;
                }
                peak = peak.max(re.hypot(im));
                let (found_re, found_im) = (f64::from(cell.re[lane]), f64::from(cell.im[lane]));
                worst = worst.max((found_re - re).hypot(found_im - im));
            }
        }
        worst / peak
    }

    #[test]
    fn every_length_equals_the_definition() {
        // All radices alone and together, usual numbers of loops, primes that have no pass.
        for len in (1..=50).chain([64, 96, 100, 112, 128, 225, 251, 255, 256, 512]) {
            let error = error(len, SimdLevel::detect());
            // Rounding grows with the number of passes, 6e-8 each.
            assert!(error < 1e-6, "{len}: {error}");
        }
    }

    #[test]
    fn levels_agree() {
        for level in [SimdLevel::Avx2, SimdLevel::Portable] {
            for len in [12, 35, 37, 256] {
                let error = error(len, level);
                assert!(error < 1e-6, "{level:?} {len}: {error}");
            }
        }
    }
}
