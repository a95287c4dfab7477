//! The report as Markdown.

use super::{BoardReport, BoardsReport, PresenceTruth};
use crate::{recordings::Judged, table::Table};

/// Percent with one digit, or a dash.
fn percent(share: Option<f64>) -> String {
    share.map_or("-".into(), |share| format!("{:.1}", 100.0 * share))
}

/// A table of boards, one of presence, and one of activities.
pub fn markdown(report: &BoardsReport) -> String {
    let mut boards = Table::new(
        "Boards",
        format!(
            "Share of recordings described right, strictly: their activity is stated for at least half of the time and no \
             other action for as long; a fall is right if it is stated at all. Mean over the activities of each board. \
             Recordings for {}.",
            report.role.name()
        ),
        &[
            "board",
            "learned from",
            "recordings",
            "right, %",
            "false falls",
            "calibration error",
        ],
    );
    for board in &report.boards {
        boards.rows.push(vec![
            board.board.clone(),
            if board.learned { "yes" } else { "no" }.into(),
            board.rows.len().to_string(),
            percent(board.right()),
            false_falls(board),
            board
                .calibration
                .as_ref()
                .map_or("-".into(), |c| format!("{:.2}", c.expected_error)),
        ]);
    }
    let mut presence = Table::new(
        "Presence",
        "Seconds an hour for which a sentence states somebody.",
        &[
            "board",
            "part",
            "truth",
            "hours",
            "stated, s/h",
            "stated, %",
            "falls",
        ],
    );
    let mut activities = Table::new(
        "Activities",
        "Recordings of each activity, and what was stated of those that were not described right.",
        &["board", "activity", "right", "of", "otherwise"],
    );
    let mut timelines = Table::new(
        "Timelines",
        "Sentences with their times against labelled times, aligned in order of time: F1 of the temporal intersection over \
         union of all sentences, of those that state the labelled activity, and weighted with their METEOR (SODA_c), x100. \
         What is said outside of labelled times is left out.",
        &[
            "board",
            "recording",
            "labelled times",
            "sentences",
            "times",
            "right activity",
            "SODA_c",
        ],
    );
    for board in &report.boards {
        for row in &board.timelines {
            timelines.rows.push(vec![
                board.board.clone(),
                row.recording.clone(),
                row.labels.to_string(),
                row.sentences.to_string(),
                percent(Some(row.times.f1)),
                percent(Some(row.actions.f1)),
                percent(row.soda.map(|soda| soda.f1)),
            ]);
        }
        for row in &board.presence {
            presence.rows.push(vec![
                board.board.clone(),
                row.name.clone(),
                match row.truth {
                    PresenceTruth::Nobody => "nobody",
                    PresenceTruth::Somebody => "somebody",
                    PresenceTruth::Unknown => "not known",
                }
                .into(),
                format!("{:.2}", row.seconds / 3600.0),
                format!("{:.0}", 3600.0 * row.stated_s / row.seconds),
                format!("{:.1}", 100.0 * row.stated_s / row.seconds),
                row.falls.to_string(),
            ]);
        }
        activities.rows.extend(activity_rows(board));
    }
    let mut text = format!("Model: {}.\n\n", report.model);
    if let Some(mean) = report.unknown_boards() {
        text += &format!(
            "**Mean over the boards that nothing was learned from: {:.1} %**\n\n",
            100.0 * mean
        );
    }
    if let Some(error) = report.calibration_error() {
        text += &format!("Mean of their calibration errors: {error:.3}\n\n");
    }
    for table in [boards, presence, timelines, activities] {
        if !table.rows.is_empty() {
            text += &format!(
                "## {}\n\n{}\n\n{}\n",
                table.title,
                table.about,
                table.to_markdown()
            );
        }
    }
    text
}

/// Falls that are stated of recordings without one.
fn false_falls(board: &BoardReport) -> String {
    let others = board.rows.iter().filter(|r| r.judged != Judged::Event);
    let (mut n, mut wrong) = (0, 0);
    for row in others {
        n += 1;
        wrong += usize::from(row.segments.iter().any(|s| s.actions.contains(&"fall")));
    }
    format!("{wrong} of {n}")
}

fn activity_rows(board: &BoardReport) -> Vec<Vec<String>> {
    let mut names: Vec<&str> = board.rows.iter().map(|r| r.activity.as_str()).collect();
    names.sort_unstable();
    names.dedup();
    let row = |name: &&str| {
        let own: Vec<_> = board.rows.iter().filter(|r| r.activity == **name).collect();
        let mut stated: Vec<(String, usize)> = Vec::new();
        for row in own.iter().filter(|r| !r.right) {
            let what = row.stated.clone().unwrap_or_else(|| "nothing".into());
            match stated.iter_mut().find(|(other, _)| *other == what) {
                Some((_, n)) => *n += 1,
                None => stated.push((what, 1)),
            }
        }
        stated.sort_by(|a, b| b.1.cmp(&a.1).then(a.0.cmp(&b.0)));
        let otherwise: Vec<String> = stated
            .iter()
            .map(|(what, n)| format!("{what} {n}"))
            .collect();
        vec![
            board.board.clone(),
            (*name).to_string(),
            own.iter().filter(|r| r.right).count().to_string(),
            own.len().to_string(),
            otherwise.join(", "),
        ]
    };
    names.iter().map(row).collect()
}
