//! Span masking on radar codes.

use rand::RngExt;
use rand::rngs::ChaCha8Rng;

/// Chooses spans to mask: about `share` of `len` positions, in spans of mean length `mean_span`.
///
/// Returns non-empty, increasing half-open ranges that do not touch and leave at least one position visible. Returns no
/// ranges if `len < 2`.
///
/// The numbers of masked positions and spans follow the span corruption of Raffel et al. 2020, 3.1.4. Their code always
/// ends with a masked span, which would mask the end of ten codes (one span) every time. Here spans may be anywhere.
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
    // Visible parts before, between and after the spans. The first and the last may be empty.
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

/// Divides `total` into `parts` positive numbers. All divisions are equally likely.
fn partition(rng: &mut ChaCha8Rng, total: usize, parts: usize) -> Vec<usize> {
    // Chooses parts - 1 cut points among total - 1 gaps by selection sampling.
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

    /// One span of two codes among ten has nine positions, each of which should occur in a ninth of the draws. 9000
    /// draws give 1000 per position with a standard deviation of 30. The tolerance is six standard deviations.
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
