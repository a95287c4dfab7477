//! Packed weights, and their products with rows of activations.
//!
//! A matrix `[k, n]` is split into panels of 64 columns that are stored consecutively, so that a product reads the
//! weights sequentially. Every sum runs over k in one fixed order. The result of a row therefore depends neither on the
//! other rows nor on the number of threads.

use std::marker::PhantomData;
use std::ops::Range;

use crate::Precision;
use crate::pool::Pool;
use radarllm_simd::{ByteDot, SimdF32x16, SimdLevel, dispatch};

/// Columns of a panel.
const PANEL: usize = 64;
/// Vectors of a panel.
const VECTORS: usize = PANEL / 16;
/// Maximum size of the activations of a block of rows, in bytes. The block stays in the second-level cache while all
/// panels are processed.
const ROWS_BYTES: usize = 256 << 10;

/// Rounds up to the next multiple of the vector width.
pub(crate) fn padded(n: usize) -> usize {
    n.next_multiple_of(16)
}

/// Prefetch distance of the weights, in steps of a panel (256 bytes each). The value was measured.
const AHEAD: usize = 24;

/// 64 bytes, aligned to a cache line.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
struct Line<T>(T);

/// How a product is written to the output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Then {
    /// Overwrite the output.
    Store,
    /// Add the product to the output.
    Add,
    /// Overwrite the output with the positive part (ReLU).
    Relu,
}

/// A packed matrix `[k, n]`, zero-padded to a multiple of 16 in both dimensions.
pub(crate) struct Matrix {
    k: usize,
    n: usize,
    data: Data,
}

enum Data {
    /// For each panel and each k: 64 columns.
    F32(Vec<Line<[f32; 16]>>),
    /// For each panel and each group of four k: 64 columns of four weights, offset by 128. Also the scale of each
    /// column.
    I8(Vec<Line<[u8; 64]>>, Vec<Line<[f32; 16]>>),
}

/// Scratch buffer for activations quantized to bytes.
#[derive(Default)]
pub(crate) struct Quantised {
    bytes: Vec<[i8; 16]>,
    /// For each row: the scale, and 128 times the sum of the bytes.
    rows: Vec<(f32, i32)>,
}

impl Quantised {
    /// Reserves memory for `rows` rows of `k` values, so that later products do not allocate.
    pub(crate) fn reserve(&mut self, rows: usize, k: usize) {
        grow(&mut self.bytes, rows * k / 16, [0; 16]);
        grow(&mut self.rows, rows, (0.0, 0));
    }
}

/// Grows a buffer to at least `len` elements.
pub(crate) fn grow<T: Clone>(buffer: &mut Vec<T>, len: usize, value: T) {
    if buffer.len() < len {
        buffer.resize(len, value);
    }
}

/// The output of a product, shared by threads that write different columns.
#[derive(Clone, Copy)]
struct Out<'a> {
    start: *mut f32,
    stride: usize,
    /// Keeps the output borrowed while threads write to it.
    out: PhantomData<&'a mut [f32]>,
}
// SAFETY: an `Out` represents a `&mut [f32]`, which may be sent to another thread. Only `f32_tile` and `i8_tile`
// dereference its pointer, in the columns of their panel, and `Matrix::product` gives every panel to one thread.
unsafe impl Send for Out<'_> {}
// SAFETY: as above.
unsafe impl Sync for Out<'_> {}

impl Matrix {
    /// Packs the matrix `[k, n]` whose value at (row, column) is `value(row, column)`.
    ///
    /// In [`Precision::Int8`] each column has its own scale, which maps its largest absolute value to 127.
    pub(crate) fn pack(
        k: usize,
        n: usize,
        precision: Precision,
        value: impl Fn(usize, usize) -> f32,
    ) -> Self {
        let (k_padded, n_padded) = (padded(k), padded(n));
        let n_panels = n_padded.div_ceil(PANEL);
        let data = match precision {
            Precision::F32 => {
                let mut lines = vec![Line([0.0; 16]); n_panels * k_padded * VECTORS];
                for column in 0..n {
                    let (panel, at) = (column / PANEL, column % PANEL);
                    for row in 0..k {
                        let line = (panel * k_padded + row) * VECTORS + at / 16;
                        lines[line].0[at % 16] = value(row, column);
                    }
                }
                Data::F32(lines)
            }
            Precision::Int8 => {
                // 128 represents zero.
                let mut lines = vec![Line([128; 64]); n_panels * (k_padded / 4) * VECTORS];
                let mut scales = vec![Line([0.0; 16]); n_panels * VECTORS];
                for column in 0..n {
                    let largest = (0..k)
                        .map(|row| value(row, column).abs())
                        .fold(0.0, f32::max);
                    let (scale, factor) = (largest / 127.0, 127.0 / largest);
                    if !factor.is_finite() {
                        continue; // All values are zero or negligible.
                    }
                    let (panel, at) = (column / PANEL, column % PANEL);
                    scales[panel * VECTORS + at / 16].0[at % 16] = scale;
                    for row in 0..k {
                        let byte = (value(row, column) * factor).round_ties_even() as i32 + 128;
                        let line = (panel * (k_padded / 4) + row / 4) * VECTORS + at / 16;
                        lines[line].0[at % 16 * 4 + row % 4] = byte as u8;
                    }
                }
                Data::I8(lines, scales)
            }
        };
        Self {
            k: k_padded,
            n: n_padded,
            data,
        }
    }

    /// Number of columns, including padding.
    pub(crate) fn width(&self) -> usize {
        self.n
    }

    /// Size of the packed weights in bytes.
    pub(crate) fn bytes(&self) -> usize {
        match &self.data {
            Data::F32(lines) => std::mem::size_of_val(&lines[..]),
            Data::I8(lines, scales) => {
                std::mem::size_of_val(&lines[..]) + std::mem::size_of_val(&scales[..])
            }
        }
    }

    /// Computes `out = x W` for the first `n` columns, rounded up to 16. `then` selects how the product is written.
    ///
    /// `x` is `[rows, k]` and `out` is `[rows, stride]`, both padded.
    #[allow(clippy::too_many_arguments)]
    pub(crate) fn product(
        &self,
        level: SimdLevel,
        pool: &mut Pool,
        scratch: &mut Quantised,
        x: &[f32],
        n: usize,
        then: Then,
        out: &mut [f32],
        stride: usize,
    ) {
        let (k, n) = (self.k, padded(n));
        let rows = x.len() / k;
        // The kernels write through pointers. These assertions check the conditions that they rely on.
        assert!(x.len() == rows * k && n <= self.n && n <= stride && out.len() >= rows * stride);
        if rows == 0 {
            return;
        }
        let out = Out {
            start: out.as_mut_ptr(),
            stride,
            out: PhantomData,
        };
        let n_panels = n.div_ceil(PANEL);
        match &self.data {
            Data::F32(lines) => {
                let job = F32Job {
                    x,
                    k,
                    lines,
                    n,
                    then,
                    out,
                };
                pool.split(n_panels, rows * k * n, &|_, panels| {
                    f32_panels(level, &job, panels)
                });
            }
            Data::I8(lines, scales) => {
                scratch.reserve(rows, k);
                let (bytes, sums) = (
                    &mut scratch.bytes[..rows * k / 16],
                    &mut scratch.rows[..rows],
                );
                quantise(level, x, k, bytes, sums);
                let job = I8Job {
                    x: bytes.as_flattened(),
                    rows: sums,
                    k,
                    lines,
                    scales,
                    n,
                    then,
                    out,
                };
                pool.split(n_panels, rows * k * n / 4, &|_, panels| {
                    i8_panels(level, &job, panels)
                });
            }
        }
    }
}

struct F32Job<'a> {
    x: &'a [f32],
    k: usize,
    lines: &'a [Line<[f32; 16]>],
    n: usize,
    then: Then,
    out: Out<'a>,
}

struct I8Job<'a> {
    x: &'a [i8],
    rows: &'a [(f32, i32)],
    k: usize,
    lines: &'a [Line<[u8; 64]>],
    scales: &'a [Line<[f32; 16]>],
    n: usize,
    then: Then,
    out: Out<'a>,
}

/// Writes 16 products.
///
/// # Safety
/// `to` must point to 16 floats that no other thread reads or writes during the call.
#[inline(always)]
unsafe fn write<L: SimdF32x16>(to: *mut f32, product: L, then: Then) {
    // SAFETY: guaranteed by the caller.
    let to = unsafe { &mut *to.cast::<[f32; 16]>() };
    match then {
        Then::Store => product.store(to),
        Then::Add => L::load(to).add(product).store(to),
        Then::Relu => product.max(L::splat(0.0)).store(to),
    }
}

/// Calls `$tile::<.., M, N>(row, vector)` for all rows and vectors of a panel.
macro_rules! tiles {
    ($lanes:ty, $rows:expr, $tile:ident) => {{
        let (tall, wide) = <$lanes>::TILE;
        for vector in (0..VECTORS).step_by(wide) {
            let mut rows: Range<usize> = $rows;
            while rows.start < rows.end {
                let left = rows.end - rows.start;
                let at = rows.start;
                rows.start += match (wide, left.min(tall)) {
                    (4, 6..) => $tile!(6, 4, at, vector),
                    (4, 4..) => $tile!(4, 4, at, vector),
                    (4, 2..) => $tile!(2, 4, at, vector),
                    (4, _) => $tile!(1, 4, at, vector),
                    (_, 4..) => $tile!(4, 1, at, vector),
                    (_, 2..) => $tile!(2, 1, at, vector),
                    (_, _) => $tile!(1, 1, at, vector),
                };
            }
        }
    }};
}

#[inline(always)]
fn f32_body<L: SimdF32x16>(job: &F32Job, panels: Range<usize>) {
    let k = job.k;
    let n_rows = job.x.len() / k;
    let chunk = (ROWS_BYTES / (4 * k)).max(6).next_multiple_of(6);
    for first in (0..n_rows).step_by(chunk) {
        let rows = first..(first + chunk).min(n_rows);
        for panel in panels.clone() {
            let lines = &job.lines[panel * k * VECTORS..(panel + 1) * k * VECTORS];
            macro_rules! tile {
                ($m:literal, $n:literal, $row:expr, $vector:expr) => {{
                    f32_tile::<L, $m, $n>(job, lines, $row, panel, $vector);
                    $m
                }};
            }
            tiles!(L, rows.clone(), tile);
        }
    }
}
dispatch!(fn f32_panels => f32_body(job: &F32Job<'_>, panels: Range<usize>));

/// Computes M rows by 16 N columns of a panel.
#[inline(always)]
fn f32_tile<L: SimdF32x16, const M: usize, const N: usize>(
    job: &F32Job,
    lines: &[Line<[f32; 16]>],
    row: usize,
    panel: usize,
    vector: usize,
) {
    let k = job.k;
    let x: [&[f32]; M] = std::array::from_fn(|m| &job.x[(row + m) * k..(row + m + 1) * k]);
    let mut sums = [[L::splat(0.0); N]; M];
    for (t, weights) in lines.as_chunks::<VECTORS>().0.iter().enumerate().take(k) {
        if M == 1 {
            ahead(weights);
        }
        let weights: [L; N] = std::array::from_fn(|i| L::load(&weights[vector + i].0));
        for m in 0..M {
            // SAFETY: t < k, the length of every row.
            let a = L::splat(unsafe { *x[m].get_unchecked(t) });
            for i in 0..N {
                sums[m][i] = a.fma(weights[i], sums[m][i]);
            }
        }
    }
    for (m, sums) in sums.iter().enumerate() {
        for (i, sum) in sums.iter().enumerate() {
            let column = panel * PANEL + (vector + i) * 16;
            if column < job.n {
                // SAFETY: row + m is a row of the input and column + 16 <= n, which are inside the output
                // (`Matrix::product` has checked its length); the panel's columns are this thread's.
                unsafe {
                    let to = job.out.start.add((row + m) * job.out.stride + column);
                    write(to, *sum, job.then);
                }
            }
        }
    }
}

/// Prefetches weights that are needed soon. With a single row the product is limited by memory latency, and the
/// hardware prefetcher does not cross page boundaries.
#[inline(always)]
fn ahead<T>(weights: &[Line<T>; VECTORS]) {
    // Every x86-64 processor has this instruction. Miri does not support it.
    #[cfg(all(target_arch = "x86_64", not(miri)))]
    for i in 0..VECTORS {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        let later = weights.as_ptr().wrapping_add(AHEAD * VECTORS + i);
        // SAFETY: a prefetch hint reads no value and never faults, whatever the address.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(later.cast()) };
    }
    #[cfg(not(all(target_arch = "x86_64", not(miri))))]
    let _ = weights;
}

#[inline(always)]
fn i8_body<L: SimdF32x16, D: ByteDot>(job: &I8Job, panels: Range<usize>) {
    let k = job.k;
    let n_rows = job.rows.len();
    let chunk = (ROWS_BYTES / k).max(6).next_multiple_of(6);
    for first in (0..n_rows).step_by(chunk) {
        let rows = first..(first + chunk).min(n_rows);
        for panel in panels.clone() {
            let len = k / 4 * VECTORS;
            let lines = &job.lines[panel * len..(panel + 1) * len];
            macro_rules! tile {
                ($m:literal, $n:literal, $row:expr, $vector:expr) => {{
                    i8_tile::<L, D, $m, $n>(job, lines, $row, panel, $vector);
                    $m
                }};
            }
            tiles!(L, rows.clone(), tile);
        }
    }
}
dispatch!(bytes fn i8_panels => i8_body(job: &I8Job<'_>, panels: Range<usize>));

/// Computes M rows by 16 N columns of a panel.
#[inline(always)]
fn i8_tile<L: SimdF32x16, D: ByteDot, const M: usize, const N: usize>(
    job: &I8Job,
    lines: &[Line<[u8; 64]>],
    row: usize,
    panel: usize,
    vector: usize,
) {
    let k = job.k;
    let x: [&[[i8; 4]]; M] =
        std::array::from_fn(|m| job.x[(row + m) * k..(row + m + 1) * k].as_chunks::<4>().0);
    let mut sums = [[D::zero(); N]; M];
    for (t, weights) in lines
        .as_chunks::<VECTORS>()
        .0
        .iter()
        .enumerate()
        .take(k / 4)
    {
        if M == 1 {
            ahead(weights);
        }
        for m in 0..M {
            // SAFETY: t < k / 4, the length of every row.
            let a = unsafe { *x[m].get_unchecked(t) };
            for i in 0..N {
                sums[m][i] = sums[m][i].add_dot(&weights[vector + i].0, a);
            }
        }
    }
    for (m, sums) in sums.iter().enumerate() {
        let (scale, offset) = job.rows[row + m];
        for (i, sum) in sums.iter().enumerate() {
            let column = panel * PANEL + (vector + i) * 16;
            if column < job.n {
                let mut product = [0.0; 16];
                sum.store_minus(offset, &mut product);
                let scales = L::load(&job.scales[column / 16].0).mul(L::splat(scale));
                // SAFETY: row + m is a row of the input and column + 16 <= n, which are inside the output
                // (`Matrix::product` has checked its length); the panel's columns are this thread's.
                unsafe {
                    let to = job.out.start.add((row + m) * job.out.stride + column);
                    write(to, L::load(&product).mul(scales), job.then);
                }
            }
        }
    }
}

/// Rows quantized to bytes, each with the scale that maps its largest absolute value to 127.
#[inline(always)]
fn quantise_body<L: SimdF32x16>(
    x: &[f32],
    k: usize,
    bytes: &mut [[i8; 16]],
    rows: &mut [(f32, i32)],
) {
    let all = x.chunks_exact(k).zip(bytes.chunks_exact_mut(k / 16));
    for ((x, bytes), row) in all.zip(rows) {
        let x = x.as_chunks::<16>().0;
        let mut largest = L::splat(0.0);
        for x in x {
            largest = largest.max(L::load(x).abs());
        }
        let largest = largest.reduce_max();
        // Rows of zeros, and rows so small that the reciprocal would overflow, become zeros.
        let factor = if largest > 1e-30 {
            127.0 / largest
        } else {
            0.0
        };
        // At most 127 * 65536 in total, which is exact in f32.
        let mut sum = L::splat(0.0);
        for (x, bytes) in x.iter().zip(bytes) {
            let rounded = L::load(x).mul(L::splat(factor)).round();
            sum = sum.add(rounded);
            rounded.store_bytes(bytes);
        }
        *row = (largest / 127.0, 128 * sum.reduce_sum() as i32);
    }
}
dispatch!(fn quantise => quantise_body(
    x: &[f32], k: usize, bytes: &mut [[i8; 16]], rows: &mut [(f32, i32)],
));

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::Random;

    /// Product in f64, either of the original values or of values rounded to bytes in the same way as in the int8 path.
    fn naive(x: &[f32], rows: usize, k: usize, n: usize, w: &[f32], p: Precision) -> Vec<f64> {
        let round = |values: &[f32]| -> Vec<f64> {
            let largest = values.iter().fold(0.0_f32, |a, b| a.max(b.abs()));
            match p {
                Precision::F32 => values.iter().map(|v| f64::from(*v)).collect(),
                Precision::Int8 if largest == 0.0 => vec![0.0; values.len()],
                Precision::Int8 => values
                    .iter()
                    .map(|v| {
                        f64::from((v * (127.0 / largest)).round_ties_even() * (largest / 127.0))
                    })
                    .collect(),
            }
        };
        let columns: Vec<Vec<f64>> = (0..n)
            .map(|c| round(&(0..k).map(|r| w[r * n + c]).collect::<Vec<_>>()))
            .collect();
        let mut out = Vec::new();
        for row in 0..rows {
            let x = round(&x[row * k..(row + 1) * k]);
            for w in &columns {
                out.push(x.iter().zip(w).map(|(a, b)| a * b).sum());
            }
        }
        out
    }

    /// Compares every SIMD level, precision, tile height and odd size with the plain sum.
    #[test]
    fn products_are_the_plain_sums() {
        let mut random = Random(1);
        for (rows, k, n) in [
            (1, 16, 16),
            (1, 40, 130),
            (2, 33, 64),
            (3, 16, 17),
            (5, 64, 100),
            (13, 96, 70),
            (50, 20, 40),
        ] {
            // Miri is about a thousand times slower.
            if cfg!(miri) && rows > 5 {
                continue;
            }
            let x: Vec<f32> = (0..rows * k).map(|_| random.normal()).collect();
            let w: Vec<f32> = (0..k * n).map(|_| random.normal()).collect();
            let (kp, stride) = (padded(k), padded(n) + 16);
            let mut wide = vec![0.0; rows * kp];
            for row in 0..rows {
                wide[row * kp..row * kp + k].copy_from_slice(&x[row * k..(row + 1) * k]);
            }
            for precision in [Precision::F32, Precision::Int8] {
                let expected = naive(&x, rows, k, n, &w, precision);
                let matrix = Matrix::pack(k, n, precision, |r, c| w[r * n + c]);
                for level in SimdLevel::available() {
                    for (threads, then) in [(1, Then::Store), (2, Then::Add), (1, Then::Relu)] {
                        let mut out = vec![2.0; rows * stride];
                        matrix.product(
                            level,
                            &mut Pool::new(threads),
                            &mut Quantised::default(),
                            &wide,
                            n,
                            then,
                            &mut out,
                            stride,
                        );
                        for (row, out) in out.chunks(stride).enumerate() {
                            for (column, found) in out[..n].iter().enumerate() {
                                let sum = expected[row * n + column];
                                let wanted = match then {
                                    Then::Store => sum,
                                    Then::Add => sum + 2.0,
                                    Then::Relu => sum.max(0.0),
                                };
                                // Sums of up to 96 terms of order 1 in f32. The int8 sums are exact except for the
                                // rounding of the scales.
                                let error = (f64::from(*found) - wanted).abs();
                                assert!(
                                    error < 2e-5,
                                    "{level:?} {precision:?} {then:?} {rows}x{k}x{n}: {found}, {wanted}"
                                );
                            }
                            assert!(out[padded(n)..].iter().all(|v| *v == 2.0), "beyond the row");
                        }
                    }
                }
            }
        }
    }

    /// Bit-exact comparison: the result of a sequence must not depend on its neighbours.
    #[test]
    fn a_row_does_not_depend_on_its_batch() {
        let mut random = Random(2);
        let (k, n, rows) = (64, 96, 11);
        let x: Vec<f32> = (0..rows * k).map(|_| random.normal()).collect();
        for precision in [Precision::F32, Precision::Int8] {
            let w: Vec<f32> = (0..k * n).map(|_| random.normal()).collect();
            let matrix = Matrix::pack(k, n, precision, |r, c| w[r * n + c]);
            let level = SimdLevel::detect();
            let product = |x: &[f32]| {
                let mut out = vec![0.0; x.len() / k * n];
                let (pool, scratch) = (&mut Pool::new(1), &mut Quantised::default());
                matrix.product(level, pool, scratch, x, n, Then::Store, &mut out, n);
                out
            };
            let together = product(&x);
            for row in 0..rows {
                let alone = product(&x[row * k..(row + 1) * k]);
                assert_eq!(alone, together[row * n..(row + 1) * n]);
            }
        }
    }

    #[test]
    fn rows_of_zeros_and_of_tiny_values_are_finite() {
        let matrix = Matrix::pack(16, 16, Precision::Int8, |r, c| (r + c) as f32);
        for value in [0.0, 1e-38, 1e-45] {
            let mut out = [f32::NAN; 16];
            let (pool, scratch) = (&mut Pool::new(1), &mut Quantised::default());
            let level = SimdLevel::detect();
            matrix.product(
                level,
                pool,
                scratch,
                &[value; 16],
                16,
                Then::Store,
                &mut out,
                16,
            );
            assert!(out.iter().all(|v| v.abs() < 1e-34), "{out:?}");
        }
    }
}
