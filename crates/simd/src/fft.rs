//! FFTs of sixteen rows at once, one row per lane, so that butterflies need no shuffles.
//!
//! Stockham's self-sorting algorithm with decimation in frequency: one pass per factor, from one buffer to the other.
//! The transform is forward (`exp(-j 2 pi k n / N)`) and not normalised. Exchanging real and imaginary parts before and
//! after it gives the inverse.

use std::f32::consts::FRAC_1_SQRT_2;
use std::f64::consts::TAU;

use crate::{Cell, InstructionSet, SimdF32x16, SimdLevel, dispatch};

/// The pass of one factor.
pub struct Pass {
    radix: usize,
    /// Distance between the outputs of a butterfly, cells. Its inputs are `stride * n_groups` apart.
    stride: usize,
    /// Number of groups of `stride` butterflies that share twiddle factors.
    n_groups: usize,
    /// `[p][k - 1]`: (cos, sin) of `-2 pi p k / rest`, with k in 1..radix and the length `rest` that earlier passes
    /// have left. Empty in the last pass.
    twiddles: Vec<[f32; 2]>,
}

/// Source of the inputs of a pass.
pub trait Source<L> {
    /// Returns number `i` of every row.
    fn at(&self, i: usize) -> C<L>;
}

/// Destination of the outputs of a pass.
pub trait Sink<L> {
    /// Whether only the last pass of a transform writes here.
    const IS_LAST: bool = false;

    /// Stores `z` as number `i` of every row.
    fn put(&mut self, i: usize, z: C<L>);
}

impl<L: SimdF32x16> Source<L> for &[Cell] {
    #[inline(always)]
    fn at(&self, i: usize) -> C<L> {
        C::load(&self[i])
    }
}

impl<L: SimdF32x16> Sink<L> for &mut [Cell] {
    #[inline(always)]
    fn put(&mut self, i: usize, z: C<L>) {
        z.store(&mut self[i]);
    }
}

/// Radices whose product is `len`, in the order of the passes. `None` if `len` has a prime factor above 7.
pub fn factors(len: usize, level: SimdLevel) -> Option<Vec<usize>> {
    let mut rest = len.max(1);
    let mut radices = vec![];
    // Without vector instructions, the sixteen lanes of a few numbers already fill all registers.
    let radices_at_hand: &[usize] = match level.instruction_set() {
        InstructionSet::Portable => &[4, 2, 3, 5, 7],
        _ => &[16, 8, 4, 6, 2, 3, 5, 7],
    };
    for &radix in radices_at_hand {
        // 8 x 4 is faster than 16 x 2.
        while rest.is_multiple_of(radix) && (radix, rest) != (16, 32) {
            radices.push(radix);
            rest /= radix;
        }
    }
    (rest == 1).then_some(radices)
}

/// (cos, sin) of `-2 pi index / len`.
pub fn root(index: usize, len: usize) -> [f32; 2] {
    let (sin, cos) = (-TAU * (index % len) as f64 / len as f64).sin_cos();
    [cos as f32, sin as f32]
}

/// Plans the passes of a transform of length `len` with these radices.
pub fn passes(len: usize, radices: &[usize]) -> Vec<Pass> {
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
                n_groups: m,
                twiddles,
            };
            left = m;
            stride *= radix;
            pass
        })
        .collect()
}

/// Runs all passes from `source` to `out`. `source`, `out` and `spare` have the length of the transform. The content of
/// `spare` is unspecified afterwards. `level` is that of `L`.
#[inline(always)]
pub fn all_passes<L: SimdF32x16, S: Source<L>>(
    level: SimdLevel,
    passes: &[Pass],
    source: S,
    out: &mut [Cell],
    spare: &mut [Cell],
) {
    let [first, rest @ ..] = passes else {
        for (i, to) in out.iter_mut().enumerate() {
            source.at(i).store(to);
        }
        return;
    };
    let (from, to) = buffers(rest, out, spare);
    run_pass::<L, _, _>(first, source, &mut *from);
    rest_passes(level, rest, from, to);
}

/// [`all_passes`] with cells as the source.
pub fn all_cell_passes(
    level: SimdLevel,
    passes: &[Pass],
    source: &[Cell],
    out: &mut [Cell],
    spare: &mut [Cell],
) {
    let [first, rest @ ..] = passes else {
        out.copy_from_slice(source);
        return;
    };
    let (from, to) = buffers(rest, out, spare);
    cell_pass(level, first, source, from);
    rest_passes(level, rest, from, to);
}

/// The buffers to which the first two passes write. They are chosen so that the last pass writes to `out`.
fn buffers<'a>(
    rest: &[Pass],
    out: &'a mut [Cell],
    spare: &'a mut [Cell],
) -> (&'a mut [Cell], &'a mut [Cell]) {
    if rest.len().is_multiple_of(2) {
        (out, spare)
    } else {
        (spare, out)
    }
}

fn rest_passes<'a>(
    level: SimdLevel,
    rest: &[Pass],
    mut from: &'a mut [Cell],
    mut to: &'a mut [Cell],
) {
    for pass in rest {
        cell_pass(level, pass, from, to);
        std::mem::swap(&mut from, &mut to);
    }
}

dispatch!(
    /// A pass from buffer to buffer. It is a separate function, so that the many butterflies are compiled once.
    fn cell_pass => cell_pass_body(pass: &Pass, from: &[Cell], to: &mut [Cell])
);

#[inline(always)]
fn cell_pass_body<L: SimdF32x16>(pass: &Pass, from: &[Cell], to: &mut [Cell]) {
    run_pass::<L, _, _>(pass, from, to);
}

/// Runs one pass.
#[inline(always)]
pub fn run_pass<L: SimdF32x16, S: Source<L>, K: Sink<L>>(pass: &Pass, from: S, to: K) {
    // `factors` uses these radices only with vector instructions.
    if L::HAS_VECTORS {
        match pass.radix {
            6 => return butterflies::<L, Dft6, S, K>(pass, from, to),
            8 => return butterflies::<L, Dft8, S, K>(pass, from, to),
            16 => return butterflies::<L, Dft16, S, K>(pass, from, to),
            _ => {}
        }
    }
    match pass.radix {
        2 => butterflies::<L, Dft2, S, K>(pass, from, to),
        3 => butterflies::<L, Dft3, S, K>(pass, from, to),
        4 => butterflies::<L, Dft4, S, K>(pass, from, to),
        5 => butterflies::<L, Dft5, S, K>(pass, from, to),
        7 => butterflies::<L, Dft7, S, K>(pass, from, to),
        other => unreachable!("no pass of radix {other}"),
    }
}

/// Butterflies with inputs `stride * n_groups` apart. The outputs are multiplied by twiddle factors and written
/// `stride` apart.
#[inline(always)]
fn butterflies<L: SimdF32x16, R: Radix<L>, S: Source<L>, K: Sink<L>>(
    pass: &Pass,
    from: S,
    mut to: K,
) {
    // A last pass has a single group, whose twiddle factors are all one.
    let (s, m) = (pass.stride, if K::IS_LAST { 1 } else { pass.n_groups });
    for p in 0..m {
        // The twiddle factors of the first group of every pass are also one.
        let twiddles = if p > 0 && !K::IS_LAST {
            &pass.twiddles[p * (R::N - 1)..(p + 1) * (R::N - 1)]
        } else {
            &[]
        };
        for q in 0..s {
            R::butterfly(
                &from,
                q + s * p,
                s * m,
                &mut to,
                q + s * p * R::N,
                s,
                twiddles,
            );
        }
    }
}

/// A transform of a few numbers.
trait Radix<L> {
    const N: usize;

    /// Computes one butterfly with inputs `first_in + k step_in` and outputs `first_out + k step_out`. All outputs
    /// except the first are multiplied by twiddle factors, unless there are none.
    fn butterfly<S: Source<L>, K: Sink<L>>(
        from: &S,
        first_in: usize,
        step_in: usize,
        to: &mut K,
        first_out: usize,
        step_out: usize,
        twiddles: &[[f32; 2]],
    );
}

/// Written out number by number, because the compiler turns closures and loops over arrays in registers into calls and
/// copies.
macro_rules! radix {
    ($name:ident, $n:literal, $dft:ident, $($k:literal $z:ident)*) => {
        struct $name;

        impl<L: SimdF32x16> Radix<L> for $name {
            const N: usize = $n;

            #[inline(always)]
            fn butterfly<S: Source<L>, K: Sink<L>>(
                from: &S,
                first_in: usize,
                step_in: usize,
                to: &mut K,
                first_out: usize,
                step_out: usize,
                twiddles: &[[f32; 2]],
            ) {
                let [z0, $($z),*] = $dft([from.at(first_in), $(from.at(first_in + step_in * $k)),*]);
                to.put(first_out, z0);
                if let Some(twiddles) = twiddles.first_chunk::<{ $n - 1 }>() {
                    $(to.put(first_out + step_out * $k, $z.turned(twiddles[$k - 1]));)*
                } else {
                    $(to.put(first_out + step_out * $k, $z);)*
                }
            }
        }
    };
}

radix!(Dft2, 2, dft2, 1 z1);
radix!(Dft3, 3, dft3, 1 z1 2 z2);
radix!(Dft4, 4, dft4, 1 z1 2 z2 3 z3);
radix!(Dft5, 5, dft5, 1 z1 2 z2 3 z3 4 z4);
radix!(Dft6, 6, dft6, 1 z1 2 z2 3 z3 4 z4 5 z5);
radix!(Dft7, 7, dft7, 1 z1 2 z2 3 z3 4 z4 5 z5 6 z6);
radix!(Dft8, 8, dft8, 1 z1 2 z2 3 z3 4 z4 5 z5 6 z6 7 z7);
radix!(Dft16, 16, dft16, 1 z1 2 z2 3 z3 4 z4 5 z5 6 z6 7 z7 8 z8 9 z9 10 z10 11 z11 12 z12 13 z13 14 z14 15 z15);

/// Sixteen complex numbers in registers.
#[derive(Clone, Copy)]
pub struct C<L> {
    /// Real parts.
    pub re: L,
    /// Imaginary parts.
    pub im: L,
}

impl<L: SimdF32x16> C<L> {
    /// From memory.
    #[inline(always)]
    pub fn load(cell: &Cell) -> Self {
        Self {
            re: L::load(&cell.re),
            im: L::load(&cell.im),
        }
    }

    /// To memory.
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

    /// Times `cos + j sin`.
    #[inline(always)]
    pub fn turned(self, [cos, sin]: [f32; 2]) -> Self {
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
fn dft2<L: SimdF32x16>([a, b]: [C<L>; 2]) -> [C<L>; 2] {
    [a.add(b), a.sub(b)]
}

#[inline(always)]
fn dft3<L: SimdF32x16>([a, b, c]: [C<L>; 3]) -> [C<L>; 3] {
    let (sum, difference) = (b.add(c), b.sub(c));
    let middle = a.plus_scaled(-0.5, sum);
    let side = difference.scaled(0.866_025_4);
    [a.add(sum), middle.sub_j(side), middle.add_j(side)]
}

#[inline(always)]
fn dft4<L: SimdF32x16>([a, b, c, d]: [C<L>; 4]) -> [C<L>; 4] {
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
fn dft5<L: SimdF32x16>([a, b, c, d, e]: [C<L>; 5]) -> [C<L>; 5] {
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

/// Good-Thomas algorithm: 2 and 3 have no common factor, so that there are no twiddle factors.
#[inline(always)]
fn dft6<L: SimdF32x16>([a, b, c, d, e, f]: [C<L>; 6]) -> [C<L>; 6] {
    let [x0, x4, x2] = dft3([a, c, e]);
    let [y0, y4, y2] = dft3([d, f, b]);
    let ([z0, z3], [z4, z1], [z2, z5]) = (dft2([x0, y0]), dft2([x4, y4]), dft2([x2, y2]));
    [z0, z1, z2, z3, z4, z5]
}

#[inline(always)]
fn dft8<L: SimdF32x16>([a, b, c, d, e, f, g, h]: [C<L>; 8]) -> [C<L>; 8] {
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

/// The transform of sixteen numbers in registers.
#[inline(always)]
pub fn dft16<L: SimdF32x16>(a: [C<L>; 16]) -> [C<L>; 16] {
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
fn dft7<L: SimdF32x16>([a, b, c, d, e, f, g]: [C<L>; 7]) -> [C<L>; 7] {
    // cos and sin of 2 pi / 7, 4 pi / 7 and 6 pi / 7.
    const C: [f32; 3] = [0.623_489_8, -0.222_520_93, -0.900_968_9];
    const S: [f32; 3] = [0.781_831_5, 0.974_927_9, 0.433_883_74];
    let (bg, bg_minus) = (b.add(g), b.sub(g));
    let (cf, cf_minus) = (c.add(f), c.sub(f));
    let (de, de_minus) = (d.add(e), d.sub(e));
    let (e1, e2, e3) = (
        even7(a, [bg, cf, de], [C[0], C[1], C[2]]),
        even7(a, [bg, cf, de], [C[1], C[2], C[0]]),
        even7(a, [bg, cf, de], [C[2], C[0], C[1]]),
    );
    let sides = [bg_minus, cf_minus, de_minus];
    let o1 = odd7(sides, [S[0], S[1], S[2]]);
    let o2 = odd7(sides, [S[1], -S[2], -S[0]]);
    let o3 = odd7(sides, [S[2], -S[0], S[1]]);
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

#[inline(always)]
fn even7<L: SimdF32x16>(a: C<L>, [b, c, d]: [C<L>; 3], cos: [f32; 3]) -> C<L> {
    a.plus_scaled(cos[0], b)
        .plus_scaled(cos[1], c)
        .plus_scaled(cos[2], d)
}

#[inline(always)]
fn odd7<L: SimdF32x16>([b, c, d]: [C<L>; 3], sin: [f32; 3]) -> C<L> {
    b.scaled(sin[0])
        .plus_scaled(sin[1], c)
        .plus_scaled(sin[2], d)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_length_equals_the_definition_at_every_level() {
        let random = |i: usize| ((i * 7 + 3) as f32 * 0.618_034).fract() - 0.5;
        for level in SimdLevel::available() {
            for len in [1, 2, 3, 5, 7, 8, 12, 16, 30, 32, 64, 96, 125, 140, 256] {
                if cfg!(miri) && len > 30 {
                    continue; // Miri is some thousand times slower.
                }
                let from: Vec<Cell> = (0..len)
                    .map(|i| Cell {
                        re: std::array::from_fn(|lane| random(32 * i + lane)),
                        im: std::array::from_fn(|lane| random(32 * i + lane + 16)),
                    })
                    .collect();
                let radices = factors(len, level).unwrap();
                let (mut out, mut spare) = (vec![Cell::ZERO; len], vec![Cell::ZERO; len]);
                all_cell_passes(level, &passes(len, &radices), &from, &mut out, &mut spare);
                for (k, found) in out.iter().enumerate() {
                    for lane in [0, 5, 15] {
                        let (mut re, mut im) = (0.0, 0.0);
                        for (i, x) in from.iter().enumerate() {
                            let (sin, cos) = (-TAU * (k * i % len) as f64 / len as f64).sin_cos();
                            let (x_re, x_im) = (f64::from(x.re[lane]), f64::from(x.im[lane]));
                            re += x_re * cos - x_im * sin;
                            im += x_re * sin + x_im * cos;
                        }
                        let (found_re, found_im) = (found.re[lane], found.im[lane]);
                        let error = (f64::from(found_re) - re).hypot(f64::from(found_im) - im);
                        // Sums of `len` numbers of about 0.4, each pass rounded to 6e-8 of them.
                        let limit = 1e-6 * (len as f64).sqrt();
                        assert!(error < limit, "{level:?} {len} {k}: {error}");
                    }
                }
            }
        }
        assert_eq!(factors(22, SimdLevel::PORTABLE), None);
    }
}
