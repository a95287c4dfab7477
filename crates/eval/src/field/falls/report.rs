//! Counts of trials by condition, and the report as Markdown.

use std::collections::BTreeMap;

use radarllm_base::stats::median_mean;
use serde::Serialize;

use super::{
    counts::{DailyRate, Proportion},
    plan::FallPlan,
    recordings::RecordingAlarms,
    score::Missed,
    trial::TrialRow,
};
use crate::table::Table;

/// A condition and its value in a trial.
type Condition = (&'static str, fn(&TrialRow) -> Option<String>);

/// The conditions of the tables.
const CONDITIONS: [Condition; 10] = [
    ("all", |_| Some("all".into())),
    ("motion", |row| Some(row.trial.kind.clone())),
    ("speed", |row| row.trial.speed.map(|v| v.to_string())),
    ("before", |row| Some(row.trial.before.clone())),
    ("radar", |row| Some(row.trial.radar.clone())),
    ("mounting", |row| Some(mounting(row))),
    ("radar and mounting", |row| {
        Some(format!("{}, {}", row.trial.radar, mounting(row)))
    }),
    ("distance", |row| {
        Some(format!("{} m", row.trial.distance_m))
    }),
    ("heading", |row| {
        Some(format!("{} degrees", row.trial.heading_deg))
    }),
    ("person", |row| Some(row.trial.person.clone())),
];

/// Falls under one condition.
#[derive(Clone, Debug, Serialize)]
pub struct FallCounts {
    /// The condition.
    pub condition: &'static str,
    /// Its value.
    pub value: String,
    /// Falls that were suspected.
    pub suspected: Proportion,
    /// Falls that were confirmed.
    pub confirmed: Proportion,
    /// Median time from the impact to the suspicion, s.
    pub median_delay_s: Option<f64>,
    /// Longest time from the impact to the suspicion, s.
    pub max_delay_s: Option<f64>,
    /// Suspicions before the fall.
    pub false_suspected: usize,
    /// Confirmed suspicions before the fall.
    pub false_confirmed: usize,
    /// Further suspicions of the same fall.
    pub repeated: usize,
    /// What `describe` states, if it was asked.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub described: Option<DescribedFalls>,
}

/// What `describe` states of falls.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct DescribedFalls {
    /// Falls that it states.
    pub stated: Proportion,
    /// Falls that it states besides.
    pub besides: usize,
    /// The mean share of the time after the falls that it states in which it states that the person lies.
    pub lying_share: Option<f64>,
}

/// What is not a fall, under one condition.
#[derive(Clone, Debug, Serialize)]
pub struct OtherCounts {
    /// The condition.
    pub condition: &'static str,
    /// Its value.
    pub value: String,
    /// Trials with a suspicion.
    pub suspected: Proportion,
    /// Trials with a confirmed suspicion.
    pub confirmed: Proportion,
    /// Suspicions a day of such motions without a pause.
    pub suspected_per_day: DailyRate,
    /// Confirmed suspicions a day of such motions without a pause.
    pub confirmed_per_day: DailyRate,
    /// Trials in which `describe` states a fall, if it was asked.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub described: Option<Proportion>,
}

/// All trials, and recordings without falls.
#[derive(Clone, Debug, Serialize)]
pub struct FallReport {
    /// Seed of the trials.
    pub seed: u64,
    /// Falls by condition.
    pub falls: Vec<FallCounts>,
    /// Other motions by condition.
    pub others: Vec<OtherCounts>,
    /// Falls that were not suspected, by reason.
    pub missed: BTreeMap<Missed, usize>,
    /// Falls that were suspected and not confirmed.
    pub dismissed: usize,
    /// Recordings without falls.
    pub recordings: Vec<RecordingAlarms>,
    /// Every trial.
    pub rows: Vec<TrialRow>,
}

impl FallReport {
    pub(super) fn new(seed: u64, rows: Vec<TrialRow>) -> Self {
        let (falls, others): (Vec<&TrialRow>, Vec<&TrialRow>) =
            rows.iter().partition(|row| row.truth.is_some());
        let mut missed = BTreeMap::new();
        for reason in falls.iter().filter_map(|row| row.missed) {
            *missed.entry(reason).or_default() += 1;
        }
        let is_dismissed =
            |row: &&&TrialRow| row.score.suspected_s.is_some() && row.score.confirmed_s.is_none();
        Self {
            seed,
            falls: by_condition(&falls, fall_counts),
            others: by_condition(&others, other_counts),
            missed,
            dismissed: falls.iter().filter(is_dismissed).count(),
            recordings: Vec::new(),
            rows,
        }
    }

    /// A report of a plan without any trial, for recordings alone.
    pub fn without_trials(plan: &FallPlan) -> Self {
        Self::new(plan.seed, Vec::new())
    }

    /// The report as Markdown.
    pub fn to_markdown(&self) -> String {
        if self.rows.is_empty() {
            return recording_table(&self.recordings).to_markdown();
        }
        let missed = |(reason, n): (&Missed, &usize)| format!("{n} x {}", reason.label());
        let missed: Vec<String> = self.missed.iter().map(missed).collect();
        let missed = match missed.is_empty() {
            true => "none".into(),
            false => missed.join("; "),
        };
        let mut page = format!(
            "Simulated falls, by height alone, seed {}. Delays are from the impact to the suspicion.\n\n{}\n\
             Missed: {missed}. Suspected and not confirmed: {}.\n\n\
             Simulated motions that are not falls; a day is one of such motions without a pause:\n\n{}",
            self.seed,
            fall_table(&self.falls).to_markdown(),
            self.dismissed,
            other_table(&self.others).to_markdown(),
        );
        if !self.recordings.is_empty() {
            let table = recording_table(&self.recordings).to_markdown();
            page += &format!("\nRecordings without falls:\n\n{table}");
        }
        page
    }
}

/// How the radar of a trial is mounted, in words.
fn mounting(row: &TrialRow) -> String {
    let height_m = row.trial.radar_height_m;
    match row.trial.tilt_deg {
        0.0 => format!("{height_m} m, level"),
        tilt_deg => format!("{height_m} m, tilted by {tilt_deg} degrees"),
    }
}

/// Counts of the rows under every value of every condition, in the order in which the values occur.
fn by_condition<T>(
    rows: &[&TrialRow],
    count: impl Fn(&'static str, String, &[&TrialRow]) -> T,
) -> Vec<T> {
    let mut all = Vec::new();
    for (condition, value_of) in CONDITIONS {
        let mut values: Vec<String> = Vec::new();
        for value in rows.iter().filter_map(|row| value_of(row)) {
            if !values.contains(&value) {
                values.push(value);
            }
        }
        for value in values {
            let is_own = |row: &&&TrialRow| value_of(row).as_ref() == Some(&value);
            let own: Vec<&TrialRow> = rows.iter().filter(is_own).copied().collect();
            all.push(count(condition, value, &own));
        }
    }
    all
}

fn fall_counts(condition: &'static str, value: String, rows: &[&TrialRow]) -> FallCounts {
    let sum = |of: fn(&TrialRow) -> usize| rows.iter().map(|row| of(row)).sum::<usize>();
    let proportion = |of: fn(&TrialRow) -> bool| {
        Proportion::new(rows.iter().filter(|row| of(row)).count(), rows.len())
    };
    let delays: Vec<f64> = rows.iter().filter_map(|row| row.delay_s()).collect();
    FallCounts {
        condition,
        value,
        suspected: proportion(|row| row.score.suspected_s.is_some()),
        confirmed: proportion(|row| row.score.confirmed_s.is_some()),
        max_delay_s: delays.iter().copied().reduce(f64::max),
        median_delay_s: median_mean(delays),
        false_suspected: sum(|row| row.score.false_suspected),
        false_confirmed: sum(|row| row.score.false_confirmed),
        repeated: sum(|row| row.score.repeated),
        described: is_described(rows).then(|| DescribedFalls {
            stated: proportion(TrialRow::is_described),
            besides: sum(TrialRow::falsely_described),
            lying_share: {
                let stated = rows.iter().filter(|row| row.is_described());
                let shares: Vec<f64> = stated.filter_map(|row| row.lying_share()).collect();
                (!shares.is_empty()).then(|| shares.iter().sum::<f64>() / shares.len() as f64)
            },
        }),
    }
}

fn other_counts(condition: &'static str, value: String, rows: &[&TrialRow]) -> OtherCounts {
    let hours = rows.iter().map(|row| row.seconds).sum::<f64>() / 3600.0;
    let count = |of: fn(&TrialRow) -> usize| {
        let with_any = rows.iter().filter(|row| of(row) > 0).count();
        let total = rows.iter().map(|row| of(row)).sum();
        (
            Proportion::new(with_any, rows.len()),
            DailyRate::new(total, hours),
        )
    };
    let (suspected, suspected_per_day) = count(|row| row.score.false_suspected);
    let (confirmed, confirmed_per_day) = count(|row| row.score.false_confirmed);
    OtherCounts {
        condition,
        value,
        suspected,
        confirmed,
        suspected_per_day,
        confirmed_per_day,
        described: is_described(rows).then(|| count(TrialRow::falsely_described).0),
    }
}

fn is_described(rows: &[&TrialRow]) -> bool {
    rows.iter().any(|row| row.described.is_some())
}

fn fall_table(counts: &[FallCounts]) -> Table {
    let mut head = vec![
        "condition",
        "value",
        "suspected",
        "confirmed",
        "median delay, s",
        "longest delay, s",
        "false before the fall: suspected",
        "confirmed",
        "repeated",
    ];
    if counts.iter().any(|row| row.described.is_some()) {
        head.extend([
            "stated by `describe`",
            "stated besides",
            "lies afterwards, %",
        ]);
    }
    let mut table = Table::new("", "", &head);
    let seconds = |value: Option<f64>| value.map_or_else(String::new, |v| format!("{v:.2}"));
    for row in counts {
        let mut cells = vec![
            row.condition.into(),
            row.value.clone(),
            row.suspected.to_text(),
            row.confirmed.to_text(),
            seconds(row.median_delay_s),
            seconds(row.max_delay_s),
            row.false_suspected.to_string(),
            row.false_confirmed.to_string(),
            row.repeated.to_string(),
        ];
        if let Some(described) = row.described {
            let share = |share: f64| format!("{:.0}", 100.0 * share);
            cells.extend([
                described.stated.to_text(),
                described.besides.to_string(),
                described.lying_share.map_or_else(String::new, share),
            ]);
        }
        table.rows.push(cells);
    }
    table
}

fn other_table(counts: &[OtherCounts]) -> Table {
    let mut head = vec![
        "condition",
        "value",
        "trials with a false suspicion",
        "confirmed",
        "false suspicions a day",
        "confirmed a day",
    ];
    if counts.iter().any(|row| row.described.is_some()) {
        head.push("stated by `describe`");
    }
    let mut table = Table::new("", "", &head);
    for row in counts {
        let mut cells = vec![
            row.condition.into(),
            row.value.clone(),
            row.suspected.to_text(),
            row.confirmed.to_text(),
            row.suspected_per_day.to_text(),
            row.confirmed_per_day.to_text(),
        ];
        cells.extend(row.described.map(Proportion::to_text));
        table.rows.push(cells);
    }
    table
}

fn recording_table(recordings: &[RecordingAlarms]) -> Table {
    let head = [
        "configuration",
        "role",
        "recordings",
        "suspected",
        "confirmed",
        "undecided at the end",
    ];
    let mut table = Table::new("", "", &head);
    for row in recordings {
        table.rows.push(vec![
            row.config.clone(),
            row.role.name().into(),
            row.recordings.to_string(),
            row.suspected.to_text(),
            row.confirmed.to_text(),
            row.undecided.to_string(),
        ]);
    }
    let sum = |of: fn(&RecordingAlarms) -> usize| recordings.iter().map(of).sum::<usize>();
    let hours = recordings.iter().map(|row| row.suspected.hours).sum();
    table.rows.push(vec![
        "all".into(),
        String::new(),
        sum(|row| row.recordings).to_string(),
        DailyRate::new(sum(|row| row.suspected.n), hours).to_text(),
        DailyRate::new(sum(|row| row.confirmed.n), hours).to_text(),
        sum(|row| row.undecided).to_string(),
    ]);
    table
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::falls::{
        plan::{Trial, tests::PLAN},
        score::{Score, TrueFall},
    };

    fn row(trial: &Trial, is_fall: bool, score: Score) -> TrialRow {
        TrialRow {
            trial: trial.clone(),
            truth: is_fall.then_some(TrueFall {
                onset_s: 4.0,
                impact_s: 5.0,
            }),
            seconds: 36.0,
            points_per_frame: 10.0,
            missed: (is_fall && score.suspected_s.is_none()).then_some(Missed::NotSeenDown),
            heights: Vec::new(),
            score,
            described: None,
        }
    }

    #[test]
    fn counts_add_up_by_condition() {
        let trials = FallPlan::from_toml(PLAN).unwrap().trials();
        let at = |suspected_s: f64, confirmed_s: Option<f64>| Score {
            suspected_s: Some(suspected_s),
            confirmed_s,
            ..Score::default()
        };
        let alarm = Score {
            false_suspected: 2,
            false_confirmed: 1,
            ..Score::default()
        };
        let scores = [
            at(5.2, Some(25.2)),
            at(5.6, None),
            Score::default(),
            alarm,
            Score::default(),
        ];
        let rows = trials.iter().zip(scores).enumerate();
        let rows = rows.map(|(i, (trial, score))| row(trial, i < 3, score));
        let report = FallReport::new(7, rows.collect());
        let all = &report.falls[0];
        assert_eq!(
            (all.suspected.n, all.suspected.of, all.confirmed.n),
            (2, 3, 1)
        );
        assert!((all.median_delay_s.unwrap() - 0.4).abs() < 1e-9);
        assert!((all.max_delay_s.unwrap() - 0.6).abs() < 1e-9);
        assert_eq!(report.missed[&Missed::NotSeenDown], 1);
        assert_eq!(report.dismissed, 1);
        let slow = report
            .falls
            .iter()
            .find(|c| c.condition == "speed")
            .unwrap();
        assert_eq!((slow.value.as_str(), slow.suspected.of), ("0.7", 1));
        let other = &report.others[0];
        // Two suspicions in one of two trials of 36 s.
        assert_eq!((other.suspected.n, other.suspected.of), (1, 2));
        assert_eq!(
            (other.suspected_per_day.n, other.confirmed_per_day.n),
            (2, 1)
        );
        assert!((other.suspected_per_day.hours - 0.02).abs() < 1e-9);
        let page = report.to_markdown();
        for part in [
            "| all | all | 2 of 3 (66.7 %",
            "| motion | bow | 1 of 2",
            "1 x no two",
        ] {
            assert!(page.contains(part), "{part}: {page}");
        }
        // Recordings alone, with their sum.
        let alarms = |n_suspected: usize, hours: f64| RecordingAlarms {
            config: "c.toml".into(),
            role: crate::recordings::Role::Tuning,
            recordings: 4,
            suspected: DailyRate::new(n_suspected, hours),
            confirmed: DailyRate::new(0, hours),
            undecided: 0,
            alarms: Vec::new(),
        };
        let mut report = FallReport::without_trials(&FallPlan::from_toml(PLAN).unwrap());
        report.recordings = vec![alarms(1, 0.25), alarms(2, 0.75)];
        let page = report.to_markdown();
        assert!(page.contains("| all |  | 8 | 3 in 1.00 h"), "{page}");
        assert!(!page.contains("Simulated"), "{page}");
    }
}
