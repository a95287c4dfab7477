//! How often windows are described on a computer that is too slow for all of them.
//!
//! | after a minute of the stream in which | the stride of the windows |
//! |---|---|
//! | more than a tenth of the windows were left out | doubles, up to 8 s |
//! | no window was left out | halves, down to that of the options |
//!
//! While the stride is longer than that of the options, sentences are fewer than they should be, and the health says so.

/// Time over which windows are counted, s.
const MINUTE_S: f64 = 60.0;
/// Share of windows that are left out above which the stride doubles.
const TOO_MANY: f64 = 0.1;
/// Longest stride, s.
const LONGEST_S: f64 = 8.0;

/// Chooses the stride of the windows.
#[derive(Clone, Copy, Debug)]
pub struct Pace {
    shortest_s: f64,
    stride_s: f64,
    since_s: Option<f64>,
    n_described: u32,
    n_left_out: u32,
}

impl Pace {
    /// Begins with the stride of the options, s.
    pub fn new(stride_s: f64) -> Self {
        Self {
            shortest_s: stride_s,
            stride_s,
            since_s: None,
            n_described: 0,
            n_left_out: 0,
        }
    }

    /// The present stride, s.
    pub fn stride_s(&self) -> f64 {
        self.stride_s
    }

    /// Whether there are fewer windows than there should be.
    pub fn is_degraded(&self) -> bool {
        self.stride_s > self.shortest_s
    }

    /// Counts a window.
    pub fn count(&mut self, is_described: bool) {
        let n = match is_described {
            true => &mut self.n_described,
            false => &mut self.n_left_out,
        };
        *n = n.saturating_add(1);
    }

    /// Judges the last minute, if it ends at `t_s`. Returns whether the stride has changed.
    pub fn judge(&mut self, t_s: f64) -> bool {
        let since_s = *self.since_s.get_or_insert(t_s);
        if t_s - since_s < MINUTE_S {
            return false;
        }
        let (n_described, n_left_out) = (self.n_described, self.n_left_out);
        (self.since_s, self.n_described, self.n_left_out) = (Some(t_s), 0, 0);
        let n_windows = f64::from(n_described) + f64::from(n_left_out);
        let before_s = self.stride_s;
        if f64::from(n_left_out) > TOO_MANY * n_windows {
            self.stride_s = (2.0 * before_s).min(LONGEST_S).max(self.shortest_s);
        } else if n_left_out == 0 {
            self.stride_s = (0.5 * before_s).max(self.shortest_s);
        }
        self.stride_s != before_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A minute with windows. Returns the stride after it.
    fn minute(pace: &mut Pace, t_s: &mut f64, n_described: u32, n_left_out: u32) -> f64 {
        assert!(!pace.judge(*t_s + 59.9));
        (0..n_described).for_each(|_| pace.count(true));
        (0..n_left_out).for_each(|_| pace.count(false));
        *t_s += 60.0;
        let before_s = pace.stride_s();
        assert_eq!(pace.judge(*t_s), pace.stride_s() != before_s);
        pace.stride_s()
    }

    #[test]
    fn the_stride_doubles_above_a_tenth_and_comes_back() {
        let (mut pace, mut t_s) = (Pace::new(2.0), 5.0);
        pace.judge(t_s);
        let mut stride_s = |described, left_out| minute(&mut pace, &mut t_s, described, left_out);
        assert_eq!(stride_s(27, 3), 2.0);
        assert_eq!(stride_s(26, 4), 4.0);
        assert_eq!(stride_s(14, 1), 4.0);
        assert_eq!(stride_s(0, 15), 8.0);
        assert_eq!(stride_s(0, 8), 8.0);
        assert_eq!(stride_s(8, 0), 4.0);
        // Nobody was there.
        assert_eq!(stride_s(0, 0), 2.0);
        assert_eq!(stride_s(30, 0), 2.0);
        // A stride that is longer stays.
        let (mut pace, mut t_s) = (Pace::new(20.0), 0.0);
        pace.judge(t_s);
        assert_eq!(minute(&mut pace, &mut t_s, 0, 3), 20.0);
        assert!(!pace.is_degraded());
    }
}
