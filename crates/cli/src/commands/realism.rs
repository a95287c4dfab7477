//! `realism`: simulated beside recorded points of the same movements.

use std::path::Path;

use radarllm_synth::{
    SynthError,
    realism::{
        ActivityReport, RealismConfig, RealismReport, calibrate, compare,
        compare::{ClassifierResult, DistributionRow},
        compare_activities, mars, pairs, replay,
    },
};
use serde::Serialize;

use crate::{
    args::RealismArgs,
    commands,
    error::{CliError, CliResult},
    files::{self, MAX_CONFIG_BYTES},
    output,
};

/// Runs the verb.
pub fn run(args: &RealismArgs) -> CliResult {
    for out in args.out.iter().chain(&args.calibrate) {
        output::check_free(out, args.force)?;
    }
    let text = files::read_text(&args.config, MAX_CONFIG_BYTES)?;
    let config = RealismConfig::from_toml(&text)
        .map_err(|e: SynthError| CliError::new(format!("{}: {e}", args.config.display())))?;
    let base = args.config.parent().unwrap_or(Path::new(""));
    let threads = commands::threads(args.threads);
    if let Some(table) = &config.activities {
        if args.calibrate.is_some() || !args.part.is_empty() {
            return Err(CliError::new(
                "--calibrate and --part want recordings with joints or scenes, not [activities]",
            ));
        }
        let report = compare_activities(&config, table, base, &args.recordings, threads)?;
        let page = activities_page(&report, &args.config);
        return print(args, &report, &page);
    }
    let has_subjects = args.recordings.join("subject1").is_dir();
    let mut takes = if has_subjects {
        mars::read_takes(&args.recordings)?
    } else {
        pairs::read_takes(&config, base, &args.recordings)?
    };
    if !args.part.is_empty() {
        takes.retain(|t| args.part.contains(&t.part));
        if takes.is_empty() {
            return Err(CliError::new(format!(
                "--part {}: the recordings have no such part",
                args.part.join(" ")
            )));
        }
    }
    if let Some(out) = &args.calibrate {
        let found = calibrate(&config, base, &takes, threads, |r| {
            eprintln!(
                "round {}: {:.1} points a frame for {:.1}; recorded less simulated: range {:+.3} m, x/range \
                 {:+.3}, z/range {:+.3}; x = 0 in {:.1} % for {:.1} %",
                r.round,
                r.points[1],
                r.points[0],
                r.range_m,
                r.u_x,
                r.u_z,
                100.0 * r.on_boresight[1],
                100.0 * r.on_boresight[0]
            );
        })?;
        let page = format!(
            "# Found by `radarllm realism --calibrate` from {} takes.\n{}",
            takes.len(),
            found.to_toml()?
        );
        output::write_atomic(out, page.as_bytes())?;
        output::print_line(&format!("{}: written", out.display()));
        return Ok(());
    }
    let simulated = replay(&config, base, &takes, threads)?;
    let report = compare(&config, &takes, &simulated);
    print(args, &report, &markdown(&report, &args.config))
}

/// Writes the page if asked to, prints the page or the document.
fn print(args: &RealismArgs, report: &impl Serialize, page: &str) -> CliResult {
    if let Some(out) = &args.out {
        output::write_atomic(out, page.as_bytes())?;
    }
    if args.json {
        return output::print_json(report);
    }
    output::print_line(page);
    Ok(())
}

fn activities_page(report: &ActivityReport, config: &Path) -> String {
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

fn markdown(report: &RealismReport, config: &Path) -> String {
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
