//! A comparison of simulated and recorded points as Markdown.

use std::path::Path;

use super::{
    ActivityReport, RealismReport,
    compare::{ClassifierResult, DistributionRow},
    mars,
};

/// The tables of a comparison by activity; `config` names the configuration.
pub fn activities_markdown(report: &ActivityReport, config: &Path) -> String {
    let mut page = format!(
        "Simulated against recorded moving points, {} recorded frames in {} recordings, {} simulated frames, \
         configuration {}.\n\n",
        report.frames[0],
        report.recordings.iter().sum::<usize>(),
        report.frames[1],
        config.display()
    );
    page += &distributions_table(&report.distributions, "between halves");
    page += &classifier_lines(
        report.classifier.as_ref(),
        "recordings of the other half",
        &report.activities,
    );
    page
}

/// The tables of a comparison by take; `config` names the configuration.
pub fn markdown(report: &RealismReport, config: &Path) -> String {
    let mut page = format!(
        "Simulated against recorded points, {} frames, configuration {}.\n\n",
        report.frames,
        config.display()
    );
    page += &distributions_table(&report.distributions, "between subjects");
    page += &format!(
        "\nPoints: {} recorded, {} simulated; {} simulated frames have none.\n\
         Chamfer distance, m: {:.3} simulated to recorded; {:.3} recorded to the next recorded frame; \
         {} to another movement.\n",
        report.points[0],
        report.points[1],
        report.empty_simulated,
        report.chamfer_m,
        report.chamfer_next_m,
        report
            .chamfer_other_m
            .map_or_else(|| "-".into(), |v| format!("{v:.3}"))
    );
    let names = mars::MOVEMENTS.map(String::from);
    page += &classifier_lines(
        report.classifier.as_ref(),
        "subjects not trained on",
        &names,
    );
    page
}

fn distributions_table(rows: &[DistributionRow], between: &str) -> String {
    let mut table = format!(
        "| quantity | recorded 5 / 50 / 95 % | simulated 5 / 50 / 95 % | Wasserstein-1 | KS | KS {between} |\n\
         |---|---|---|---|---|---|\n"
    );
    for row in rows {
        let [r, s] =
            [row.recorded, row.simulated].map(|[a, b, c]| format!("{a:.2} / {b:.2} / {c:.2}"));
        let between = row
            .between_subjects
            .map_or_else(|| "-".into(), |v| format!("{v:.3}"));
        table += &format!(
            "| {}, {} | {r} | {s} | {:.3} | {:.3} | {between} |\n",
            row.quantity,
            if row.unit.is_empty() { "-" } else { row.unit },
            row.wasserstein_1,
            row.kolmogorov_smirnov
        );
    }
    table
}

fn classifier_lines(result: Option<&ClassifierResult>, unseen: &str, names: &[String]) -> String {
    let Some(c) = result else {
        return "Classifier: not run, it needs two groups and two classes.\n".into();
    };
    let percent = |v: f64| format!("{:.1} %", 100.0 * v);
    let mut lines = format!(
        "Classifier, {} classes, {} recorded windows of {unseen}: trained on simulated {}, on recorded {}; \
         simulated windows after training on simulated {}; chance {}.\n\n\
         True class (row) and predicted class, trained on simulated:\n\n|{}\n|{}\n",
        c.n_classes,
        c.n_test,
        percent(c.simulated_to_recorded),
        percent(c.recorded_to_recorded),
        percent(c.simulated_to_simulated),
        percent(1.0 / c.n_classes as f64),
        " |".repeat(c.n_classes + 1),
        "---|".repeat(c.n_classes + 1)
    );
    for (class, row) in c.confusion.iter().enumerate() {
        let name = names.get(class).map_or("?", String::as_str);
        let cells: Vec<String> = row.iter().map(usize::to_string).collect();
        lines += &format!("| {name} | {} |\n", cells.join(" | "));
    }
    lines
}
