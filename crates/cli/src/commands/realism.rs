//! `realism`: simulated beside recorded points of the same movements.

use std::{fmt::Write as _, fs, path::Path};

use radarllm_synth::{
    SynthError,
    realism::{RealismConfig, RealismReport, calibrate, compare, mars, pairs, replay},
};

use crate::{
    args::RealismArgs,
    error::{CliError, CliResult},
    output,
};

/// Runs the verb.
pub fn run(args: &RealismArgs) -> CliResult {
    for out in args.out.iter().chain(&args.calibrate) {
        output::check_free(out, args.force)?;
    }
    let text = fs::read_to_string(&args.config).map_err(|e| CliError::io(&args.config, e))?;
    let config = RealismConfig::from_toml(&text)
        .map_err(|e: SynthError| CliError::new(format!("{}: {e}", args.config.display())))?;
    let base = args.config.parent().unwrap_or(Path::new(""));
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
    let threads = args
        .threads
        .unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from));
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
    if let Some(out) = &args.out {
        let page = markdown(&report, &args.config);
        output::write_atomic(out, page.as_bytes())?;
    }
    if args.json {
        return output::print_json(&report);
    }
    output::print_line(&markdown(&report, &args.config));
    Ok(())
}

fn markdown(report: &RealismReport, config: &Path) -> String {
    let mut page = String::new();
    // Writing into a String cannot fail.
    let mut line = |text: String| {
        let _ = writeln!(page, "{text}");
    };
    line(format!(
        "Simulated against recorded points, {} frames, configuration {}.\n",
        report.frames,
        config.display()
    ));
    line("| quantity | recorded 5 / 50 / 95 % | simulated 5 / 50 / 95 % | Wasserstein-1 | KS | KS between subjects |".into());
    line("|---|---|---|---|---|---|".into());
    for row in &report.distributions {
        let [r, s] =
            [row.recorded, row.simulated].map(|[a, b, c]| format!("{a:.2} / {b:.2} / {c:.2}"));
        let between = row
            .between_subjects
            .map_or_else(|| "-".into(), |v| format!("{v:.3}"));
        line(format!(
            "| {}, {} | {r} | {s} | {:.3} | {:.3} | {between} |",
            row.quantity,
            if row.unit.is_empty() { "-" } else { row.unit },
            row.wasserstein_1,
            row.kolmogorov_smirnov
        ));
    }
    line(format!(
        "\nPoints: {} recorded, {} simulated; {} simulated frames have none.",
        report.points[0], report.points[1], report.empty_simulated
    ));
    line(format!(
        "Chamfer distance, m: {:.3} simulated to recorded; {:.3} recorded to the next recorded frame; \
         {:.3} to another movement.",
        report.chamfer_m, report.chamfer_next_m, report.chamfer_other_m
    ));
    match &report.classifier {
        None => line("Classifier: not run, it needs two subjects and two classes.".into()),
        Some(c) => {
            let percent = |v: f64| format!("{:.1} %", 100.0 * v);
            line(format!(
                "Classifier, {} classes, {} recorded windows of subjects not trained on: trained on simulated \
                 {}, on recorded {}; simulated windows after training on simulated {}; chance {}.",
                c.n_classes,
                c.n_test,
                percent(c.simulated_to_recorded),
                percent(c.recorded_to_recorded),
                percent(c.simulated_to_simulated),
                percent(1.0 / c.n_classes as f64)
            ));
            line("\nTrue class (row) and predicted class, trained on simulated:\n".into());
            line(format!("|{}", " |".repeat(c.n_classes + 1)));
            line(format!("|{}", "---|".repeat(c.n_classes + 1)));
            for (class, row) in c.confusion.iter().enumerate() {
                let name = mars::MOVEMENTS.get(class).copied().unwrap_or("?");
                let cells: Vec<String> = row.iter().map(usize::to_string).collect();
                line(format!("| {name} | {} |", cells.join(" | ")));
            }
        }
    }
    page
}
