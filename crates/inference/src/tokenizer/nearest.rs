//! The code nearest to a feature.

/// Index of the nearest code (L2) of every row of `inputs`; both are `[n][dim]` flattened.
pub fn nearest_codes(inputs: &[f32], codebook: &[f32], dim: usize) -> Vec<u32> {
    if dim == 0 || codebook.is_empty() {
        return Vec::new();
    }
    // |x - c|^2 = |x|^2 - 2 x.c + |c|^2; |x|^2 does not change the position of the minimum.
    let squares: Vec<f32> = codebook
        .chunks_exact(dim)
        .map(|c| c.iter().map(|v| v * v).sum())
        .collect();
    // Eight inputs at a time share one pass over the codebook, which is larger than the cache.
    let mut codes = Vec::with_capacity(inputs.len() / dim);
    for block in inputs.chunks(8 * dim) {
        let mut best = [(f32::INFINITY, 0u32); 8];
        for (k, (code, square)) in codebook.chunks_exact(dim).zip(&squares).enumerate() {
            for (x, best) in block.chunks_exact(dim).zip(best.iter_mut()) {
                let distance = square - 2.0 * dot(x, code);
                if distance < best.0 {
                    *best = (distance, k as u32);
                }
            }
        }
        codes.extend(best.iter().take(block.len() / dim).map(|b| b.1));
    }
    codes
}

/// Sixteen partial sums let the compiler keep vectors in registers.
fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut sums = [0.0f32; 16];
    let (a_blocks, b_blocks) = (a.chunks_exact(16), b.chunks_exact(16));
    let rest: f32 = a_blocks
        .remainder()
        .iter()
        .zip(b_blocks.remainder())
        .map(|(x, y)| x * y)
        .sum();
    for (x, y) in a_blocks.zip(b_blocks) {
        for i in 0..16 {
            sums[i] += x[i] * y[i];
        }
    }
    sums.iter().sum::<f32>() + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nearest_is_the_nearest() {
        let cloud = |n: usize, seed: u32| -> Vec<f32> {
            let value =
                |i: usize| ((i as u32).wrapping_mul(2_654_435_761).wrapping_add(seed) >> 8) as f32;
            (0..n * 19).map(|i| value(i) / 8_388_608.0 - 1.0).collect()
        };
        let (x, c) = (cloud(37, 1), cloud(11, 77_777_777));
        let found = nearest_codes(&x, &c, 19);
        assert_eq!(found.len(), 37);
        for (x, k) in x.chunks_exact(19).zip(found) {
            let square = |c: &[f32]| x.iter().zip(c).map(|(a, b)| (a - b) * (a - b)).sum::<f32>();
            let min = c.chunks_exact(19).map(square).fold(f32::INFINITY, f32::min);
            // The two formulas round differently: distances of order 10, a few ulp.
            assert!(square(&c[k as usize * 19..][..19]) <= min + 1e-5);
        }
    }
}
