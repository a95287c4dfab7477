//! Span masking on radar codes.

use rand::RngExt;
use rand::rngs::ChaCha8Rng;

/// Chooses spans to mask: about `share` of `len` positions, spans of mean length `mean_span`.
///
/// Returns non-empty, increasing, non-touching half-open ranges that leave at least one position
/// visible. Empty when `len < 2`.
///
/// Counts follow the span corruption of Raffel et al. 2020, 3.1.4. Their code always ends with a
/// masked span, which on ten codes (one span) would mask the end every time; here spans may lie
/// anywhere.
pub fn choose_spans(
    rng: &mut ChaCha8Rng,
    len: usize,
    share: f64,
    mean_span: f64,
) -> Vec<(usize, usize)> {
    if len < 2 {
        return Vec::new();
    }
    let n_masked = ((len as f64 * share).round() as usize).clamp(1, len - 1);
    let n_visible = len - n_masked;
    let n_spans =
        ((n_masked as f64 / mean_span.max(1.0)).round() as usize).clamp(1, n_masked.min(n_visible));
    let masked = partition(rng, n_masked, n_spans);
    // Parts before, between and after the spans; the outer two may be empty.
    let mut visible = partition(rng, n_visible + 2, n_spans + 1);
    visible[0] -= 1;
    let mut at = 0;
    let mut spans = Vec::with_capacity(n_spans);
    for (visible, masked) in visible.into_iter().zip(masked) {
        spans.push((at + visible, at + visible + masked));
        at += visible + masked;
    }
    spans
}

/// Splits `total` into `parts` positive numbers, every split equally likely.
fn partition(rng: &mut ChaCha8Rng, total: usize, parts: usize) -> Vec<usize> {
    // Choose parts - 1 cut points among total - 1 gaps by selection sampling.
    let mut sizes = Vec::with_capacity(parts);
    let mut size = 1;
    let mut cuts_left = parts - 1;
    for gap in 0..total - 1 {
        let gaps_left = total - 1 - gap;
        if cuts_left > 0 && rng.random_range(0..gaps_left) < cuts_left {
            sizes.push(size);
            size = 1;
            cuts_left -= 1;
        } else {
            size += 1;
        }
    }
    sizes.push(size);
    sizes
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn spans_cover_the_share_and_leave_the_rest() {
        let rng = &mut ChaCha8Rng::seed_from_u64(1);
        for len in 2..100 {
            for _ in 0..20 {
                let spans = choose_spans(rng, len, 0.15, 3.0);
                let masked: usize = spans.iter().map(|(s, e)| e - s).sum();
                let expected = ((len as f64 * 0.15).round() as usize).clamp(1, len - 1);
                assert_eq!(masked, expected, "len {len}");
                assert_eq!(spans.len(), ((masked as f64 / 3.0).round() as usize).max(1));
                assert!(spans.iter().all(|(s, e)| s < e && *e <= len));
                assert!(
                    spans.windows(2).all(|w| w[0].1 < w[1].0),
                    "spans touch: {spans:?}"
                );
            }
        }
        assert!(choose_spans(rng, 1, 0.15, 3.0).is_empty());
        assert!(choose_spans(rng, 0, 0.15, 3.0).is_empty());
    }

    /// One span of two in ten codes has nine places; each should come up in a ninth of the draws.
    /// 9000 draws give 1000 a place with a standard deviation of 30; six of them are allowed.
    #[test]
    fn every_place_is_masked_equally_often() {
        let rng = &mut ChaCha8Rng::seed_from_u64(2);
        let mut starts = [0_i32; 9];
        for _ in 0..9000 {
            let spans = choose_spans(rng, 10, 0.15, 3.0);
            assert_eq!(spans.len(), 1);
            assert_eq!(spans[0].1 - spans[0].0, 2);
            starts[spans[0].0] += 1;
        }
        assert!(starts.iter().all(|n| (n - 1000).abs() < 180), "{starts:?}");
    }
}
