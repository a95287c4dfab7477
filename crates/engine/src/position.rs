//! Relative position buckets of T5.

/// Returns the bucket of a key at `relative = key position - query position`.
///
/// Half of the buckets hold one distance each. The others grow logarithmically up to `max_distance`; all larger
/// distances share the last bucket. The bidirectional form (encoder) uses half of the buckets for keys after the query.
/// The causal form (decoder) maps all such keys to bucket 0.
///
/// The computation uses f32 and the order of operations of the reference code, because the truncation of a logarithm
/// close to an integer decides the bucket. Raffel et al. 2020, section 2.1.
///
/// # Example
/// ```
/// use radarllm_engine::position::relative_bucket;
///
/// // 32 buckets up to a distance of 128, as in T5: 8 exact distances each way.
/// assert_eq!(relative_bucket(-5, true, 32, 128), 5);
/// assert_eq!(relative_bucket(5, true, 32, 128), 16 + 5);
/// // A decoder does not look ahead.
/// assert_eq!(relative_bucket(5, false, 32, 128), 0);
/// ```
pub fn relative_bucket(
    relative: i64,
    bidirectional: bool,
    buckets: usize,
    max_distance: usize,
) -> usize {
    let (buckets, base, distance) = if bidirectional {
        let half = buckets / 2;
        (
            half,
            if relative > 0 { half } else { 0 },
            relative.unsigned_abs() as usize,
        )
    } else {
        (buckets, 0, (-relative.min(0)) as usize)
    };
    let max_exact = buckets / 2;
    if distance < max_exact {
        return base + distance;
    }
    let ratio = (distance as f32 / max_exact as f32).ln()
        / (max_distance as f64 / max_exact as f64).ln() as f32;
    let large = max_exact + (ratio * (buckets - max_exact) as f32) as usize;
    base + large.min(buckets - 1)
}

/// Buckets of every (query, key) pair, `[n_queries, n_keys]`. The first query is at position `first_query`.
pub fn bucket_table(
    first_query: usize,
    n_queries: usize,
    n_keys: usize,
    bidirectional: bool,
    buckets: usize,
    max_distance: usize,
) -> Vec<i32> {
    let mut table = Vec::with_capacity(n_queries * n_keys);
    for query in first_query..first_query + n_queries {
        for key in 0..n_keys {
            let relative = key as i64 - query as i64;
            table.push(relative_bucket(relative, bidirectional, buckets, max_distance) as i32);
        }
    }
    table
}

#[cfg(test)]
mod tests {
    use super::relative_bucket;

    /// Expected values: the bucket function of `transformers` 4.46 (see tests/goldens/make_t5.py).
    #[test]
    fn causal_buckets_beyond_the_exact_range_match_the_reference() {
        let bucket = |d: i64| relative_bucket(-d, false, 32, 128);
        let expected = [
            (0, 0),
            (1, 1),
            (7, 7),
            (8, 8),
            (15, 15),
            (16, 16),
            (18, 16),
            (19, 17),
            (20, 17),
            (21, 18),
            (24, 19),
            (31, 21),
            (32, 21),
            (64, 26),
            (127, 31),
            (128, 31),
            (1000, 31),
        ];
        for (distance, want) in expected {
            assert_eq!(bucket(distance), want, "distance {distance}");
        }
        assert_eq!(
            relative_bucket(5, false, 32, 128),
            0,
            "keys after the query"
        );
    }

    #[test]
    fn bidirectional_buckets_match_the_reference() {
        let bucket = |r: i64| relative_bucket(r, true, 32, 128);
        let expected = [
            (0, 0),
            (-1, 1),
            (1, 17),
            (-7, 7),
            (-8, 8),
            (8, 24),
            (-11, 8),
            (-12, 9),
            (-16, 10),
            (16, 26),
            (-32, 12),
            (-64, 14),
            (64, 30),
            (-128, 15),
            (128, 31),
            (500, 31),
        ];
        for (relative, want) in expected {
            assert_eq!(bucket(relative), want, "relative {relative}");
        }
    }
}
