//! How far a long task is, on a line of the terminal that is written over.

use std::{
    io::{IsTerminal as _, Write as _, stderr},
    time::{Duration, Instant},
};

/// Tasks that take less time show no progress.
const SILENT: Duration = Duration::from_secs(2);
/// Time between two lines.
const STEP: Duration = Duration::from_millis(500);

/// Progress of a task on standard error, if that is a terminal. The line is removed when this is dropped.
pub(crate) struct Progress<'a> {
    what: &'a str,
    started: Instant,
    shown: Option<Instant>,
}

impl<'a> Progress<'a> {
    /// Progress of a task that begins now.
    pub(crate) fn new(what: &'a str) -> Self {
        Self {
            what,
            started: Instant::now(),
            shown: None,
        }
    }

    /// Shows the share of the task that is done, 0..=1.
    pub(crate) fn show(&mut self, share: Option<f64>) {
        let is_due = match self.shown {
            None => self.started.elapsed() >= SILENT,
            Some(shown) => shown.elapsed() >= STEP,
        };
        if !is_due || !stderr().is_terminal() {
            return;
        }
        self.shown = Some(Instant::now());
        let line = line(self.what, share, self.started.elapsed());
        let _ = write!(stderr(), "\r\x1b[K{line}");
    }
}

impl Drop for Progress<'_> {
    fn drop(&mut self) {
        if self.shown.is_some() {
            let _ = write!(stderr(), "\r\x1b[K");
        }
    }
}

/// `walk.dat: 25 %, about 30 s left`.
fn line(what: &str, share: Option<f64>, elapsed: Duration) -> String {
    let Some(share) = share.filter(|share| *share > 0.0) else {
        return format!("{what}: {:.0} s", elapsed.as_secs_f64());
    };
    let left_s = elapsed.as_secs_f64() * (1.0 - share) / share;
    let left = match left_s {
        s if s < 90.0 => format!("{s:.0} s"),
        s if s < 5_400.0 => format!("{:.0} min", s / 60.0),
        s => format!("{:.1} h", s / 3_600.0),
    };
    format!("{what}: {:.0} %, about {left} left", 100.0 * share)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_left_follows_from_the_share() {
        let after = Duration::from_secs(60);
        assert_eq!(line("a", Some(0.25), after), "a: 25 %, about 3 min left");
        assert_eq!(line("a", Some(0.5), after), "a: 50 %, about 60 s left");
        assert_eq!(line("a", Some(0.001), after), "a: 0 %, about 16.6 h left");
        assert_eq!(line("a", None, after), "a: 60 s");
        assert_eq!(line("a", Some(0.0), after), "a: 60 s");
    }
}
