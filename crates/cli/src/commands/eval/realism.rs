//! `eval realism`: compares simulated with recorded points of the same movements.

use std::path::{Path, PathBuf};

use clap::Args;
use radarllm_eval::realism::{
    RealismConfig, calibrate, compare, compare_activities, mars, pairs, replay, report,
};
use radarllm_synth::SynthError;
use serde::Serialize;

use radarllm_files::bounded::{self as files, MAX_CONFIG_BYTES};

use crate::{
    error::{CliError, CliResult},
    output, threads,
};

/// `eval realism`.
#[derive(Args)]
pub(crate) struct RealismArgs {
    /// Radar, signal chain and impairments; see docs/results/realism.md.
    pub config: PathBuf,
    /// Folder of recordings: NAME.parquet with a scene file NAME.toml that describes what happened, or the MARS data set, subjectN/timesplit/{radar,kinect}_data_PART.csv.
    #[arg(long)]
    pub recordings: PathBuf,
    /// Use only this part (MARS: train, validate or test; own recordings: NAME). May be repeated.
    #[arg(long)]
    pub part: Vec<String>,
    /// Estimate threshold, elevation bias, origin and azimuth step from the recordings, and write the configuration with
    /// them to this file. It must be in the folder of the radar file that it names.
    #[arg(long, value_name = "OUT.toml", conflicts_with_all = ["out", "json"])]
    pub calibrate: Option<PathBuf>,
    /// Also write the report into this Markdown file.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Replace an existing report.
    #[arg(long)]
    pub force: bool,
    /// Threads; all cores if omitted.
    #[arg(long)]
    pub threads: Option<usize>,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// Runs the command.
pub(super) fn run(args: &RealismArgs) -> CliResult {
    for out in args.out.iter().chain(&args.calibrate) {
        output::check_free(out, args.force)?;
    }
    let text = files::read_text(&args.config, MAX_CONFIG_BYTES)?;
    let config = RealismConfig::from_toml(&text)
        .map_err(|e: SynthError| CliError::new(format!("{}: {e}", args.config.display())))?;
    let base = args.config.parent().unwrap_or(Path::new(""));
    threads::on_threads(args.threads, || run_with(args, &config, base))?
}

fn run_with(args: &RealismArgs, config: &RealismConfig, base: &Path) -> CliResult {
    if let Some(table) = &config.activities {
        if args.calibrate.is_some() || !args.part.is_empty() {
            return Err(CliError::new(
                "--calibrate and --part want recordings with joints or scenes, not [activities]",
            ));
        }
        let report = compare_activities(config, table, base, &args.recordings)?;
        let page = report::activities_markdown(&report, &args.config);
        return print(args, &report, &page);
    }
    let has_subjects = args.recordings.join("subject1").is_dir();
    let mut takes = if has_subjects {
        mars::read_takes(&args.recordings)?
    } else {
        pairs::read_takes(config, base, &args.recordings)?
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
        let found = calibrate(config, base, &takes, |r| {
            note!(
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
    let simulated = replay(config, base, &takes)?;
    let report = compare(config, &takes, &simulated);
    print(args, &report, &report::markdown(&report, &args.config))
}

/// Writes the page if requested, and prints the page or the JSON document.
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
