//! The report as Markdown.

use super::{ProtocolResult, RadharReport, RadharRow, Spread};
use crate::Table;

/// Mean and standard deviation, %.
fn percent(spread: Spread) -> String {
    format!(
        "{:.1} ± {:.1}",
        100.0 * spread.mean,
        100.0 * spread.deviation
    )
}

/// Windows and recordings of a protocol.
fn cells(result: &ProtocolResult) -> [String; 2] {
    let recordings = format!(
        "{} ({}/{})",
        percent(result.recordings),
        result.recordings_right,
        result.recordings_tested
    );
    [percent(result.windows), recordings]
}

/// A finished row as a line of progress.
pub(super) fn line(row: &RadharRow) -> String {
    let results = row.results.iter().map(|result| {
        let [windows, recordings] = cells(result);
        let name = result.protocol.name();
        format!("{name} {windows} % of windows, {recordings} % of recordings")
    });
    let results: Vec<String> = results.collect();
    format!(
        "{}: {} ({:.0} s)",
        row.name,
        results.join("; "),
        row.seconds
    )
}

/// The report as a page; `config` is the name of the configuration.
pub fn markdown(report: &RadharReport, config: &str) -> String {
    let mut text = format!(
        "# RadHAR: supervised classifiers\n\n{} recordings, {} windows of 60 frames; configuration `{config}`.\n\n",
        report.recordings.iter().sum::<usize>(),
        report.windows
    );
    let mut head = vec!["session (prefix of file names)"];
    head.extend(report.activities.iter().map(String::as_str));
    let mut sessions = Table::new("", "", &head);
    let row = |name: &str, counts: &[usize]| -> Vec<String> {
        let counts = counts.iter().map(ToString::to_string);
        std::iter::once(name.to_owned()).chain(counts).collect()
    };
    for (session, counts) in &report.sessions {
        sessions.rows.push(row(session, counts));
    }
    sessions.rows.push(row("all", &report.recordings));
    text += &sessions.to_markdown();
    text += "\nPercent right, mean and standard deviation over folds; recordings also as counts over all folds.\n\n";
    let mut head = vec!["classifier".to_owned()];
    if let Some(row) = report.rows.first() {
        for result in &row.results {
            let name = result.protocol.name();
            head.push(format!("{name}: windows"));
            head.push("recordings".into());
        }
    }
    let head: Vec<&str> = head.iter().map(String::as_str).collect();
    let mut table = Table::new("", "", &head);
    for row in &report.rows {
        let cells = row.results.iter().flat_map(cells);
        table
            .rows
            .push(std::iter::once(row.name.clone()).chain(cells).collect());
    }
    for row in &report.not_run {
        let mut cells = vec![row.name.clone(), format!("not run: {}", row.reason)];
        cells.resize(head.len().max(2), "".into());
        if let (Some(reported), Some(last)) = (&row.reported, cells.last_mut()) {
            *last = format!("reported: {reported}");
        }
        table.rows.push(cells);
    }
    text += &table.to_markdown();
    for row in &report.rows {
        if let Some(explained) = row.explained
            && row.name.contains("MLP")
        {
            text += &format!(
                "\n{}: the components have {:.1} % of the variance.",
                row.name.split(':').next().unwrap_or_default(),
                100.0 * explained
            );
        }
        if row.unfinished > 0 {
            text += &format!(
                "\n{}: {} machines did not converge.",
                row.name, row.unfinished
            );
        }
    }
    text.trim_end().to_owned() + "\n"
}
