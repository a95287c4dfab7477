//! The log of evaluations on judged recordings: every look is recorded, so that nobody can look until it fits.

use std::time::{SystemTime, UNIX_EPOCH};

use radarllm_base::civil::{self, Date};

use super::RecordingsReport;
use crate::falls::RecordingAlarms;

/// Head of the log, a CSV file.
pub const LOOKS_HEAD: &str =
    "date,configuration,model,fingerprint,right,recordings,false falls,hours,purpose\n";

/// The line of a report. `fingerprint` distinguishes models of one name.
pub fn look(report: &RecordingsReport, config: &str, fingerprint: u64, purpose: &str) -> String {
    format!(
        "{},{},{},{fingerprint:016x},{},{},{},{:.3},{}\n",
        today(),
        quoted(config),
        quoted(&report.model),
        report.right,
        report.recordings,
        report.false_falls.falls,
        report.false_falls.hours,
        quoted(purpose),
    )
}

/// The line of recordings without falls that were watched for falls by height alone. Right is whoever was not suspected.
pub fn look_for_falls(alarms: &RecordingAlarms, purpose: &str) -> String {
    let mut names: Vec<&str> = alarms.alarms.iter().map(|(name, _)| &name[..]).collect();
    names.sort_unstable();
    names.dedup();
    format!(
        "{},{},{},{:016x},{},{},{},{:.3},{}\n",
        today(),
        quoted(&alarms.config),
        quoted("none (falls by height alone)"),
        0,
        alarms.recordings - names.len(),
        alarms.recordings,
        alarms.suspected.n,
        alarms.suspected.hours,
        quoted(purpose),
    )
}

fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('"', "\"\"").replace('\n', " "))
}

fn today() -> String {
    let since = SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .unwrap_or_default();
    date((since.as_secs() / 86_400) as i64)
}

/// The date of a day since 1970-01-01, as `YYYY-MM-DD`.
fn date(days_since_1970: i64) -> String {
    let Date { year, month, day } = civil::date(days_since_1970);
    format!("{year:04}-{month:02}-{day:02}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::falls::DailyRate;
    use crate::recordings::Role;

    #[test]
    fn a_look_for_falls_counts_recordings_once() {
        let alarms = RecordingAlarms {
            config: "c.toml".into(),
            role: Role::Judged,
            recordings: 5,
            suspected: DailyRate::new(3, 0.25),
            confirmed: DailyRate::new(0, 0.25),
            undecided: 0,
            alarms: vec![("a".into(), 1.0), ("b".into(), 2.0), ("a".into(), 3.0)],
        };
        let line = look_for_falls(&alarms, "a \"new\" rule");
        let (_, rest) = line.split_once(',').unwrap();
        let expected = "\"c.toml\",\"none (falls by height alone)\",0000000000000000,3,5,3,0.250,\"a \"\"new\"\" rule\"\n";
        assert_eq!(rest, expected);
        assert_eq!(
            rest.matches(',').count() + 1,
            LOOKS_HEAD.matches(',').count()
        );
    }

    #[test]
    fn days_become_dates() {
        for (day, expected) in [
            (0, "1970-01-01"),
            (59, "1970-03-01"),
            (11_016, "2000-02-29"),
            (20_780, "2026-11-23"),
        ] {
            assert_eq!(date(day), expected);
        }
    }
}
