//! Operations on single rows: norms, activation functions, attention of one query, softmax.

use radarllm_simd::{SimdF32x16, dispatch};

/// RMS norm: `x * gain / rms(x)` of every row. The first `width` values of a row are used; the others are padding.
#[inline(always)]
fn rms_norm_body<L: SimdF32x16>(x: &[f32], gain: &[f32], width: usize, eps: f32, out: &mut [f32]) {
    let stride = gain.len();
    for (x, out) in x.chunks_exact(stride).zip(out.chunks_exact_mut(stride)) {
        let (x, gain) = (x.as_chunks::<16>().0, gain.as_chunks::<16>().0);
        let mut sum = L::splat(0.0);
        for x in x {
            let x = L::load(x);
            sum = x.fma(x, sum);
        }
        let inverse = L::splat((sum.reduce_sum() / width as f32 + eps).sqrt().recip());
        for ((x, gain), out) in x.iter().zip(gain).zip(out.as_chunks_mut::<16>().0) {
            L::load(x).mul(inverse).mul(L::load(gain)).store(out);
        }
    }
}
dispatch!(pub(crate) fn rms_norm => rms_norm_body(
    x: &[f32], gain: &[f32], width: usize, eps: f32, out: &mut [f32],
));

/// Layer norm: `(x - mean) / deviation * gain + offset` of every row. The first `width` values of a row are used; the
/// others must be zero in `x`, `gain` and `offset`.
#[inline(always)]
fn layer_norm_body<L: SimdF32x16>(
    x: &[f32],
    gain: &[f32],
    offset: &[f32],
    width: usize,
    eps: f32,
    out: &mut [f32],
) {
    let stride = gain.len();
    let (gain, offset) = (gain.as_chunks::<16>().0, offset.as_chunks::<16>().0);
    for (x, out) in x.chunks_exact(stride).zip(out.chunks_exact_mut(stride)) {
        let x = x.as_chunks::<16>().0;
        let mut sum = L::splat(0.0);
        for x in x {
            sum = L::load(x).add(sum);
        }
        let mean = sum.reduce_sum() / width as f32;
        let mut squares = L::splat(0.0);
        for x in x {
            let x = L::load(x).sub(L::splat(mean));
            squares = x.fma(x, squares);
        }
        // Each zero of the padding contributed the square of the mean.
        let padding = (stride - width) as f32 * mean * mean;
        let variance = ((squares.reduce_sum() - padding) / width as f32).max(0.0);
        let inverse = L::splat((variance + eps).sqrt().recip());
        let rows = x.iter().zip(gain).zip(offset);
        for (((x, gain), offset), out) in rows.zip(out.as_chunks_mut::<16>().0) {
            let x = L::load(x).sub(L::splat(mean)).mul(inverse);
            x.fma(L::load(gain), L::load(offset)).store(out);
        }
    }
}
dispatch!(pub(crate) fn layer_norm => layer_norm_body(
    x: &[f32], gain: &[f32], offset: &[f32], width: usize, eps: f32, out: &mut [f32],
));

/// `relu(max(points W) + bias)`. `weight` is `[7, width]`, and `width` is a multiple of 16.
#[inline(always)]
fn tube_maximum_body<L: SimdF32x16>(
    points: &[[f32; 7]],
    weight: &[f32],
    bias: &[f32],
    out: &mut [f32],
) {
    let vectors = bias.len() / 16;
    let (weight, bias) = (weight.as_chunks::<16>().0, bias.as_chunks::<16>().0);
    for (i, out) in out.as_chunks_mut::<16>().0.iter_mut().enumerate() {
        let weight: [L; 7] = std::array::from_fn(|j| L::load(&weight[j * vectors + i]));
        let mut largest = L::splat(f32::NEG_INFINITY);
        for point in points {
            let mut sum = L::splat(point[0]).mul(weight[0]);
            for j in 1..7 {
                sum = L::splat(point[j]).fma(weight[j], sum);
            }
            largest = largest.max(sum);
        }
        largest.add(L::load(&bias[i])).max(L::splat(0.0)).store(out);
    }
}
dispatch!(pub(crate) fn tube_maximum => tube_maximum_body(
    points: &[[f32; 7]], weight: &[f32], bias: &[f32], out: &mut [f32],
));

/// Gated GELU in its tanh form: `gelu(x[..half]) * x[half..]` of every row. Rows of `x` have `2 half` values, rows of
/// `out` have `half`.
#[inline(always)]
fn gated_gelu_body<L: SimdF32x16>(x: &[f32], half: usize, out: &mut [f32]) {
    for (x, out) in x.chunks_exact(2 * half).zip(out.chunks_exact_mut(half)) {
        let (x, gate) = x.split_at(half);
        let pairs = x.as_chunks::<16>().0.iter().zip(gate.as_chunks::<16>().0);
        for ((x, gate), out) in pairs.zip(out.as_chunks_mut::<16>().0) {
            let x = L::load(x);
            // 0.5 (1 + tanh u) = 1 / (1 + exp(-2 u)), u = sqrt(2 / pi) (x + 0.044715 x^3).
            let cubic = x.mul(x).fma(L::splat(0.044_715), L::splat(1.0)).mul(x);
            let share = cubic.mul(L::splat(-1.595_769)).exp().add(L::splat(1.0));
            x.div(share).mul(L::load(gate)).store(out);
        }
    }
}
dispatch!(pub(crate) fn gated_gelu => gated_gelu_body(x: &[f32], half: usize, out: &mut [f32]));

/// Softmax: turns scores into weights that sum to 1. Scores beyond `n` are padding and get the weight 0.
#[inline(always)]
fn softmax<L: SimdF32x16>(scores: &mut [f32], n: usize) {
    scores[n..].fill(f32::NEG_INFINITY);
    let scores = scores.as_chunks_mut::<16>().0;
    let mut largest = L::load(&scores[0]);
    for s in &scores[1..] {
        largest = largest.max(L::load(s));
    }
    let largest = L::splat(largest.reduce_max());
    let mut sum = L::splat(0.0);
    for s in scores.iter_mut() {
        let e = L::load(s).sub(largest).exp();
        e.store(s);
        sum = sum.add(e);
    }
    // The padding adds at most 16 times 1e-38, which is below rounding.
    let inverse = L::splat(sum.reduce_sum().recip());
    for s in scores.iter_mut() {
        L::load(s).mul(inverse).store(s);
    }
}

/// Keys and values of one head that one query attends to.
#[derive(Clone, Copy)]
pub(crate) struct Columns<'a> {
    /// Keys, with consecutive positions adjacent in memory, `[d, n_padded]`.
    pub keys: &'a [f32],
    /// Values, from the first value of the head on. Rows are `stride` values apart.
    pub values: &'a [f32],
    pub stride: usize,
    /// Number of positions.
    pub n: usize,
}

/// Attention of one head's query, `[d]`, over all positions of `columns`, with a bias for each position.
///
/// `scores` must have room for the positions, padded to 16.
#[inline(always)]
fn attend_columns_body<L: SimdF32x16>(
    query: &[f32],
    columns: Columns,
    bias: Option<&[f32]>,
    scores: &mut [f32],
    out: &mut [f32],
) {
    let n_padded = columns.n.next_multiple_of(16);
    let scores = &mut scores[..n_padded];
    let mut first = 0;
    // Processes four vectors of positions at a time, which gives enough independent sums to keep the execution units
    // busy.
    while n_padded - first >= 64 {
        score_columns::<L, 4>(query, columns.keys, n_padded, first, scores);
        first += 64;
    }
    while first < n_padded {
        score_columns::<L, 1>(query, columns.keys, n_padded, first, scores);
        first += 16;
    }
    if let Some(bias) = bias {
        for (score, bias) in scores.iter_mut().zip(&bias[..columns.n]) {
            *score += bias;
        }
    }
    softmax::<L>(scores, columns.n);
    let rows = scores[..columns.n]
        .iter()
        .zip(columns.values.chunks(columns.stride));
    mix::<L>(rows, out);
}
dispatch!(pub(crate) fn attend_columns => attend_columns_body(
    query: &[f32], columns: Columns<'_>, bias: Option<&[f32]>, scores: &mut [f32], out: &mut [f32],
));

/// Average of rows, weighted with the softmax of `scores`, of which the first `n` are used. Each row has `out.len()`
/// values, and rows are `stride` values apart.
#[inline(always)]
fn average_body<L: SimdF32x16>(
    scores: &mut [f32],
    n: usize,
    rows: &[f32],
    stride: usize,
    out: &mut [f32],
) {
    softmax::<L>(scores, n);
    mix::<L>(scores[..n].iter().zip(rows.chunks(stride)), out);
}
dispatch!(pub(crate) fn average => average_body(
    scores: &mut [f32], n: usize, rows: &[f32], stride: usize, out: &mut [f32],
));

#[inline(always)]
fn score_columns<L: SimdF32x16, const N: usize>(
    query: &[f32],
    keys: &[f32],
    n_padded: usize,
    first: usize,
    scores: &mut [f32],
) {
    let mut sums = [L::splat(0.0); N];
    for (q, keys) in query.iter().zip(keys.chunks_exact(n_padded)) {
        let keys = keys[first..first + 16 * N].as_chunks::<16>().0;
        for i in 0..N {
            sums[i] = L::splat(*q).fma(L::load(&keys[i]), sums[i]);
        }
    }
    let scores = scores[first..first + 16 * N].as_chunks_mut::<16>().0;
    for i in 0..N {
        sums[i].store(&mut scores[i]);
    }
}

/// Weighted sum of rows, `[d]`.
#[inline(always)]
fn mix<'a, L: SimdF32x16>(
    rows: impl Iterator<Item = (&'a f32, &'a [f32])> + Clone,
    out: &mut [f32],
) {
    let n_vectors = out.len() / 16;
    let mut first = 0;
    while n_vectors - first >= 4 {
        mix_vectors::<L, 4>(rows.clone(), first, out);
        first += 4;
    }
    while first < n_vectors {
        mix_vectors::<L, 1>(rows.clone(), first, out);
        first += 1;
    }
}

#[inline(always)]
fn mix_vectors<'a, L: SimdF32x16, const N: usize>(
    rows: impl Iterator<Item = (&'a f32, &'a [f32])>,
    first: usize,
    out: &mut [f32],
) {
    let mut sums = [L::splat(0.0); N];
    for (weight, row) in rows {
        let row = row[16 * first..16 * (first + N)].as_chunks::<16>().0;
        for i in 0..N {
            sums[i] = L::splat(*weight).fma(L::load(&row[i]), sums[i]);
        }
    }
    let out = out[16 * first..16 * (first + N)].as_chunks_mut::<16>().0;
    for i in 0..N {
        sums[i].store(&mut out[i]);
    }
}

/// The decoder's cached self-attention keys and values of one block: `[step, row, head, d]`.
#[derive(Clone, Copy)]
pub(crate) struct History<'a> {
    pub keys: &'a [f32],
    pub values: &'a [f32],
    /// Number of values of one step.
    pub step: usize,
    /// Number of values of one row.
    pub row: usize,
    /// For each step, the row that holds it for this sentence.
    pub rows: &'a [u32],
    /// Index of the first value of the head.
    pub head: usize,
}

impl History<'_> {
    #[inline(always)]
    fn at(&self, step: usize, d: usize) -> std::ops::Range<usize> {
        let start = step * self.step + self.rows[step] as usize * self.row + self.head;
        start..start + d
    }
}

/// Attention of one head's query over all steps so far.
#[inline(always)]
fn attend_history_body<L: SimdF32x16>(
    query: &[f32],
    history: History,
    bias: &[f32],
    scores: &mut [f32],
    out: &mut [f32],
) {
    let (d, n) = (query.len(), history.rows.len());
    for step in 0..n {
        let key = &history.keys[history.at(step, d)];
        let mut sum = L::splat(0.0);
        for (q, k) in query
            .as_chunks::<16>()
            .0
            .iter()
            .zip(key.as_chunks::<16>().0)
        {
            sum = L::load(q).fma(L::load(k), sum);
        }
        scores[step] = sum.reduce_sum() + bias[step];
    }
    let scores = &mut scores[..n.next_multiple_of(16)];
    softmax::<L>(scores, n);
    let values = |(step, weight)| (weight, &history.values[history.at(step, d)]);
    mix::<L>(scores[..n].iter().enumerate().map(values), out);
}
dispatch!(pub(crate) fn attend_history => attend_history_body(
    query: &[f32], history: History<'_>, bias: &[f32], scores: &mut [f32], out: &mut [f32],
));

/// Converts logits to log-probabilities among the ids whose `mask` is 0. The other ids have a `mask` of negative
/// infinity, which becomes their log-probability. The output is padded to 16 with forbidden entries.
#[inline(always)]
fn log_softmax_body<L: SimdF32x16>(logits: &mut [f32], mask: &[f32]) {
    let logits = logits.as_chunks_mut::<16>().0;
    let mut largest = L::splat(f32::NEG_INFINITY);
    for (logit, mask) in logits.iter_mut().zip(mask.as_chunks::<16>().0) {
        let masked = L::load(logit).add(L::load(mask));
        masked.store(logit);
        largest = largest.max(masked);
    }
    let largest = largest.reduce_max();
    let mut sum = L::splat(0.0);
    for logit in logits.iter() {
        sum = sum.add(L::load(logit).sub(L::splat(largest)).exp());
    }
    let total = L::splat(sum.reduce_sum().ln() + largest);
    for logit in logits.iter_mut() {
        L::load(logit).sub(total).store(logit);
    }
}
dispatch!(pub(crate) fn log_softmax => log_softmax_body(logits: &mut [f32], mask: &[f32]));

/// Index and value of the largest entry, the first one in a tie. The length must be a multiple of 16.
#[inline(always)]
fn argmax_body<L: SimdF32x16>(values: &[f32]) -> Option<(usize, f32)> {
    let mut largest = L::splat(f32::NEG_INFINITY);
    for v in values.as_chunks::<16>().0 {
        largest = largest.max(L::load(v));
    }
    let largest = largest.reduce_max();
    // If all entries are NaN or negative infinity, none is the largest.
    (largest > f32::NEG_INFINITY)
        .then(|| values.iter().position(|v| *v == largest))
        .flatten()
        .map(|index| (index, largest))
}
dispatch!(pub(crate) fn argmax => argmax_body(values: &[f32]) -> Option<(usize, f32)>);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::Random;
    use radarllm_simd::SimdLevel;

    fn close(found: &[f32], expected: &[f64], tolerance: f64) {
        assert_eq!(found.len(), expected.len());
        for (f, e) in found.iter().zip(expected) {
            assert!((f64::from(*f) - e).abs() < tolerance, "{f}, expected {e}");
        }
    }

    fn softmax64(scores: &[f64]) -> Vec<f64> {
        let largest = scores.iter().copied().fold(f64::MIN, f64::max);
        let sum: f64 = scores.iter().map(|s| (s - largest).exp()).sum();
        scores.iter().map(|s| (s - largest).exp() / sum).collect()
    }

    /// Compares both forms of attention with the formula in f64, at every SIMD level and at odd sizes.
    #[test]
    fn attention_is_the_formula() {
        let mut random = Random(3);
        for level in SimdLevel::available() {
            for (n, d) in [(1, 16), (7, 32), (16, 64), (40, 80), (150, 16)] {
                if cfg!(miri) && n > 16 {
                    continue; // Miri is some thousand times slower.
                }
                let mut draw =
                    |len: usize| -> Vec<f32> { (0..len).map(|_| random.normal()).collect() };
                let (query, keys, values, bias) = (draw(d), draw(n * d), draw(n * d), draw(n));
                let score = |i: usize| {
                    let dot = query.iter().zip(&keys[i * d..(i + 1) * d]);
                    dot.map(|(a, b)| f64::from(a * b)).sum::<f64>() + f64::from(bias[i])
                };
                let weights = softmax64(&(0..n).map(score).collect::<Vec<_>>());
                let expected: Vec<f64> = (0..d)
                    .map(|j| {
                        (0..n)
                            .map(|i| weights[i] * f64::from(values[i * d + j]))
                            .sum()
                    })
                    .collect();
                let n_padded = n.next_multiple_of(16);
                let mut columns = vec![0.0; d * n_padded];
                for i in 0..n {
                    for j in 0..d {
                        columns[j * n_padded + i] = keys[i * d + j];
                    }
                }
                let mut scores = vec![0.0; n_padded];
                let mut out = vec![0.0; d];
                let all = Columns {
                    keys: &columns,
                    values: &values,
                    stride: d,
                    n,
                };
                attend_columns(level, &query, all, Some(&bias), &mut scores, &mut out);
                close(&out, &expected, 2e-5);
                let history = History {
                    keys: &keys,
                    values: &values,
                    step: d,
                    row: 1,
                    rows: &vec![0; n],
                    head: 0,
                };
                out.fill(0.0);
                attend_history(level, &query, history, &bias, &mut scores, &mut out);
                close(&out, &expected, 2e-5);
            }
        }
    }

    #[test]
    fn norms_and_gates_are_the_formulas() {
        let mut random = Random(4);
        for level in SimdLevel::available() {
            // 20 used values, 12 of padding.
            let mut x: Vec<f32> = (0..64).map(|_| 3.0 * random.normal()).collect();
            let gain: Vec<f32> = (0..32).map(|_| random.normal()).collect();
            x[20..32].fill(0.0);
            x[52..].fill(0.0);
            let mut out = vec![0.0; 64];
            rms_norm(level, &x, &gain, 20, 1e-6, &mut out);
            for row in 0..2 {
                let x: Vec<f64> = x[row * 32..row * 32 + 32]
                    .iter()
                    .map(|v| f64::from(*v))
                    .collect();
                let rms = (x.iter().map(|v| v * v).sum::<f64>() / 20.0 + 1e-6).sqrt();
                let expected: Vec<f64> = x
                    .iter()
                    .zip(&gain)
                    .map(|(x, g)| x / rms * f64::from(*g))
                    .collect();
                close(&out[row * 32..row * 32 + 32], &expected, 1e-5);
            }
            gated_gelu(level, &x, 32, &mut out[..32]);
            let expected: Vec<f64> = (0..32)
                .map(|i| {
                    let (x, gate) = (f64::from(x[i]), f64::from(x[32 + i]));
                    let u = (2.0 / std::f64::consts::PI).sqrt() * (x + 0.044_715 * x.powi(3));
                    0.5 * x * (1.0 + u.tanh()) * gate
                })
                .collect();
            close(&out[..32], &expected, 2e-5);
        }
    }

    /// Compares layer norm, the maximum over a tube and weighted means with their formulas in f64.
    #[test]
    fn the_tokenizer_s_rows_are_the_formulas() {
        let mut random = Random(6);
        for level in SimdLevel::available() {
            // 20 used values of 32. They are far from zero, so that a mean that includes the padding would differ.
            let mut draw = |n: usize| -> Vec<f32> { (0..n).map(|_| random.normal()).collect() };
            let (mut x, mut gain, mut offset) = (draw(32), draw(32), draw(32));
            x.iter_mut().for_each(|x| *x += 5.0);
            for padded in [&mut x, &mut gain, &mut offset] {
                padded[20..].fill(0.0);
            }
            let mean = x.iter().map(|v| f64::from(*v)).sum::<f64>() / 20.0;
            let square = |v: &f32| (f64::from(*v) - mean).powi(2);
            let deviation = (x[..20].iter().map(square).sum::<f64>() / 20.0 + 1e-5).sqrt();
            let expected: Vec<f64> = (0..32)
                .map(|i| match i < 20 {
                    true => {
                        let x = (f64::from(x[i]) - mean) / deviation;
                        x * f64::from(gain[i]) + f64::from(offset[i])
                    }
                    false => 0.0,
                })
                .collect();
            let mut out = vec![7.0; 32];
            layer_norm(level, &x, &gain, &offset, 20, 1e-5, &mut out);
            close(&out, &expected, 2e-5);

            let points: Vec<[f32; 7]> = (0..5)
                .map(|_| std::array::from_fn(|_| random.normal()))
                .collect();
            let mut draw = |n: usize| -> Vec<f32> { (0..n).map(|_| random.normal()).collect() };
            let (weight, bias) = (draw(7 * 32), draw(32));
            let expected: Vec<f64> = (0..32)
                .map(|c| {
                    let value = |p: &[f32; 7]| -> f64 {
                        let term = |j: usize| f64::from(p[j]) * f64::from(weight[j * 32 + c]);
                        (0..7).map(term).sum()
                    };
                    let largest = points.iter().map(value).fold(f64::MIN, f64::max);
                    (largest + f64::from(bias[c])).max(0.0)
                })
                .collect();
            tube_maximum(level, &points, &weight, &bias, &mut out);
            close(&out, &expected, 1e-5);

            // Seven rows of 32 values, with a stride of 40. One of them is masked.
            let (rows, mut scores) = (draw(7 * 40), draw(16));
            scores[2] = f32::NEG_INFINITY;
            let kept: Vec<f64> = scores[..7].iter().map(|s| f64::from(*s)).collect();
            let weights = softmax64(&kept);
            let expected: Vec<f64> = (0..32)
                .map(|c| {
                    let term = |i: usize| weights[i] * f64::from(rows[i * 40 + c]);
                    (0..7).map(term).sum()
                })
                .collect();
            average(level, &mut scores, 7, &rows, 40, &mut out);
            close(&out, &expected, 1e-5);
        }
    }

    #[test]
    fn probabilities_are_among_the_allowed() {
        let mut random = Random(5);
        for level in SimdLevel::available() {
            let logits: Vec<f32> = (0..48).map(|_| 5.0 * random.normal()).collect();
            let mut mask = vec![0.0; 48];
            mask[3] = f32::NEG_INFINITY;
            mask[40..].fill(f32::NEG_INFINITY);
            let allowed: Vec<usize> = (0..40).filter(|i| *i != 3).collect();
            let kept: Vec<f64> = allowed.iter().map(|i| f64::from(logits[*i])).collect();
            let expected: Vec<f64> = softmax64(&kept).iter().map(|p| p.ln()).collect();
            let mut found = logits.clone();
            log_softmax(level, &mut found, &mask);
            let scores: Vec<f32> = allowed.iter().map(|i| found[*i]).collect();
            close(&scores, &expected, 1e-5);
            assert!(found[3] == f32::NEG_INFINITY && found[40] == f32::NEG_INFINITY);
            // In a tie the first entry wins. Without a valid entry the result is empty.
            found[9] = 1.0;
            found[30] = 1.0;
            assert_eq!(argmax(level, &found), Some((9, 1.0)));
            assert_eq!(argmax(level, &[f32::NEG_INFINITY; 16]), None);
        }
    }
}
