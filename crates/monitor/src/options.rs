//! Options that are numbers, and comparisons of times.

pub use radarllm_base::options::OptionError;
pub(crate) use radarllm_base::options::within;

/// Times are multiples of a frame period as `f64`; within a microsecond two of them are equal.
const ROUNDING_S: f64 = 1e-6;

/// Whether at least `duration_s` have passed since `from_s`.
pub(crate) fn has_passed(from_s: f64, now_s: f64, duration_s: f64) -> bool {
    now_s - from_s >= duration_s - ROUNDING_S
}

/// Whether more than `duration_s` have passed since `from_s`.
pub(crate) fn is_over(from_s: f64, now_s: f64, duration_s: f64) -> bool {
    now_s - from_s > duration_s + ROUNDING_S
}
