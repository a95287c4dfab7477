//! The report of recordings as Markdown.

use radarllm_base::seed::derive_seed;

use super::{RecordingRow, RecordingsReport, Role, calibration::Calibration};
use crate::{captioner::decision, table::Table};

/// Sentences shown in the text form of a report.
const N_SHOWN: usize = 20;

/// The report as Markdown; `config` names the configuration.
pub fn markdown(report: &RecordingsReport, beam: Option<usize>, config: &str) -> String {
    let role = match report.role {
        Role::Tuning => "recordings for tuning",
        Role::Judged => "judged recordings, which chose nothing",
    };
    let falls = report.false_falls;
    let with_side = report.right_with_side.map_or(String::new(), |right| {
        format!(
            " {right} ({:.1} %) are described with the right side, too, where they have one.",
            percent(right, report.recordings)
        )
    });
    let height = match report.radar_height_m {
        Some(height_m) => format!("radar {height_m} m above the floor"),
        None => "height of the radar not known".into(),
    };
    let mut page = format!(
        "Model {}, {}, configuration {config}, {height}, {role}. **{} of {} recordings ({:.1} %) \
         are described right.** A recording is described right if its sentences state the activity for half of the \
         time or longer, and no other action as long.{with_side}\n\n{}\n\
         Recordings (row) by what their sentences state (column):\n\n{}\n\
         False falls: {} in {:.2} h of recordings without a fall ({}).\n",
        report.model,
        decision(beam),
        report.right,
        report.recordings,
        percent(report.right, report.recordings),
        counts(report).to_markdown(),
        confusion(report).to_markdown(),
        falls.falls,
        falls.hours,
        match falls.hours > 0.0 {
            true => format!("{:.1} per hour", falls.falls as f64 / falls.hours),
            false => "no such recordings".into(),
        },
    );
    if let Some(calibration) = &report.calibration {
        page += &calibration_text(calibration);
    }
    let (n_shown, sentences) = sentences(&report.rows);
    page += &format!(
        "\n{n_shown} recordings, sampled by their names, with their sentences:\n\n{}",
        sentences.to_markdown()
    );
    page
}

fn percent(part: usize, whole: usize) -> f64 {
    100.0 * part as f64 / whole.max(1) as f64
}

fn counts(report: &RecordingsReport) -> Table {
    let head = [
        "activity",
        "recordings",
        "described right",
        "with the right side",
        "without caption",
    ];
    let mut table = Table::new("", "", &head);
    for a in &report.activities {
        table.rows.push(vec![
            a.activity.clone(),
            a.recordings.to_string(),
            format!("{} ({:.1} %)", a.right, percent(a.right, a.recordings)),
            a.with_side.map_or(String::new(), |n| n.to_string()),
            a.abstained.to_string(),
        ]);
    }
    table
}

fn confusion(report: &RecordingsReport) -> Table {
    let mut head = vec![""];
    head.extend(report.activities.iter().map(|a| a.activity.as_str()));
    head.extend(["another action", "nothing for half of the time"]);
    let mut table = Table::new("", "", &head);
    for a in &report.activities {
        let mut row = vec![a.activity.clone()];
        row.extend(a.confusion.iter().map(usize::to_string));
        row.extend([a.other, a.none].map(|n| n.to_string()));
        table.rows.push(row);
    }
    table
}

fn calibration_text(calibration: &Calibration) -> String {
    let mut table = Table::new(
        "",
        "",
        &["confidence", "sentences", "mean confidence", "right"],
    );
    for bin in &calibration.bins {
        table.rows.push(vec![
            format!("{:.1} to {:.1}", bin.confidence[0], bin.confidence[1]),
            bin.n.to_string(),
            format!("{:.2}", bin.mean_confidence),
            format!("{:.1} %", 100.0 * bin.right),
        ]);
    }
    let coverage = calibration.right_at_coverage.map(|(coverage, right)| {
        format!(
            "{:.0} % of the most confident {:.0} %",
            100.0 * right,
            100.0 * coverage
        )
    });
    format!(
        "\nConfidence of single sentences against the share of right ones (expected calibration error {:.3}):\n\n{}\n\
         Right: {}.\n",
        calibration.expected_error,
        table.to_markdown(),
        coverage.join(", "),
    )
}

/// Sentences of a sample of recordings, which is the same for every model.
fn sentences(rows: &[RecordingRow]) -> (usize, Table) {
    let mut drawn: Vec<&RecordingRow> = rows.iter().collect();
    drawn.sort_by_key(|r| derive_seed(1, &r.recording));
    drawn.truncate(N_SHOWN);
    let mut table = Table::new("", "", &["recording", "right", "sentences"]);
    for row in &drawn {
        let sentences: Vec<String> = row
            .segments
            .iter()
            .map(|s| {
                format!(
                    "{:.0}-{:.0} s: {} ({:.2})",
                    s.start_s, s.end_s, s.caption, s.confidence
                )
            })
            .collect();
        table.rows.push(vec![
            row.recording.clone(),
            if row.right { "yes" } else { "no" }.into(),
            match sentences.is_empty() {
                true => "no person seen".into(),
                false => sentences.join("; "),
            },
        ]);
    }
    (drawn.len(), table)
}
