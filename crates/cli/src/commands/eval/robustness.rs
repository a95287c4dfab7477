//! `eval robustness`: captions of the same motions under changed conditions. Finished cells are kept in `--out`.

use std::{
    path::{Path, PathBuf},
    time::Instant,
};

use clap::Args;
use radarllm_eval::{
    EvalError,
    robustness::{
        Cell, Change, Experiment, Plan, report,
        report::{AxisReport, curves, markdown},
    },
};
use radarllm_files::bounded::{self as files, MAX_CONFIG_BYTES};
use radarllm_render::plot::{self, CurvePoint, LinePlot, Markers, Series};
use radarllm_synth::config::DatasetConfig;

use crate::{
    error::{CliError, CliResult},
    model,
    model_args::DecoderName,
    output,
    threads::on_threads,
};

/// `eval robustness`.
#[derive(Args)]
pub(crate) struct RobustnessArgs {
    /// Data set configuration, number of motions and conditions; see docs/guides/robustness.md.
    pub config: PathBuf,
    /// Folder for robustness.json, robustness.md, curves and finished cells, which are kept.
    #[arg(long)]
    pub out: PathBuf,
    /// Model folder, or a bundled model: `features` (the default) or `tokens`.
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// Decoder of the language model.
    #[arg(long, value_enum, default_value = "f32")]
    pub decoder: DecoderName,
    /// Seed of the bootstrap.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Threads of the simulation; all cores if omitted.
    #[arg(long)]
    pub threads: Option<usize>,
    /// Print finished and missing cells, and exit.
    #[arg(long)]
    pub plan: bool,
    /// Compute finished cells again.
    #[arg(long)]
    pub force: bool,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// Maximum size of a finished cell, bytes.
const MAX_CELL_BYTES: u64 = 256 << 20;

/// Runs the command.
pub(super) fn run(args: &RobustnessArgs) -> CliResult {
    let base = args.config.parent().unwrap_or(Path::new(""));
    let problem = |e: EvalError| {
        CliError::new(format!("{}: {e}", args.config.display()))
            .hint("see docs/guides/robustness.md")
    };
    let text = files::read_text(&args.config, MAX_CONFIG_BYTES)?;
    let plan = Plan::from_toml(&text).map_err(problem)?;
    let data_path = base.join(&plan.data);
    let data_base = data_path.parent().unwrap_or(Path::new(""));
    let config = DatasetConfig::from_toml(&files::read_text(&data_path, MAX_CONFIG_BYTES)?)
        .map_err(|e| CliError::new(format!("{}: {e}", data_path.display())))?;
    let model = model::open(args.model.as_deref(), args.decoder)?;
    let info = model::info(&model, args.decoder)?;
    let corpora = config.open_sources(data_base)?;
    let experiment = Experiment::new(
        &plan,
        &config,
        data_base,
        &corpora,
        model.networks()?,
        &info,
    )
    .map_err(problem)?;
    let changes = plan
        .changes()
        .into_iter()
        .map(|change| {
            let name = format!("{}.json", experiment.cell_name(&change)?);
            Ok((change, args.out.join("cells").join(name)))
        })
        .collect::<CliResult<Vec<_>>>()?;
    let is_done = |path: &Path| path.is_file() && !args.force;
    if args.plan {
        for (change, path) in &changes {
            let state = if is_done(path) { "done " } else { "to do" };
            output::print_line(&format!("{state}  {}", change.label()));
        }
        return Ok(());
    }
    let cells = on_threads(args.threads, || cells(&experiment, &changes, is_done))??;
    let report = report(&plan, &experiment, &cells, args.seed)?;
    let markdown = markdown(&report);
    for axis in &report.axes {
        if let Some(plot) = plot(axis) {
            let name = format!("robustness-{}.svg", axis.name);
            output::write_atomic(&args.out.join(name), plot.to_svg().as_bytes())?;
        }
    }
    output::write_atomic(&args.out.join("robustness.md"), markdown.as_bytes())?;
    output::write_atomic(
        &args.out.join("robustness.json"),
        serde_json::to_string_pretty(&report)?.as_bytes(),
    )?;
    if args.json {
        return output::print_json(&report);
    }
    output::print_line(markdown.trim_end());
    Ok(())
}

/// Evaluates the cells that are missing and reads all of them.
fn cells(
    experiment: &Experiment,
    changes: &[(Change, PathBuf)],
    is_done: impl Fn(&Path) -> bool,
) -> CliResult<Vec<(Change, Cell)>> {
    let mut cells = Vec::new();
    for (number, (change, path)) in changes.iter().enumerate() {
        if !is_done(path) {
            let started = Instant::now();
            let cell = experiment.measure(change)?;
            output::write_atomic(path, serde_json::to_string_pretty(&cell)?.as_bytes())?;
            note!(
                "{} of {}: {} ({:.0} s)",
                number + 1,
                changes.len(),
                change.label(),
                started.elapsed().as_secs_f64()
            );
        }
        let unusable = |e: String| {
            CliError::new(format!("{}: {e}", path.display())).hint("--force computes it again")
        };
        let text = files::read_text(path, MAX_CELL_BYTES)?;
        let cell: Cell = serde_json::from_str(&text).map_err(|e| unusable(e.to_string()))?;
        experiment
            .check_cell(&cell)
            .map_err(|e| unusable(e.to_string()))?;
        cells.push((change.clone(), cell));
    }
    Ok(cells)
}

/// Plot of a condition whose levels have positions on an axis; `None` for other conditions.
fn plot(axis: &AxisReport) -> Option<LinePlot> {
    let curves = curves(axis);
    if curves.is_empty() {
        return None;
    }
    let series = curves.iter().map(|curve| {
        let points = curve.x.iter().zip(&curve.y).zip(&curve.intervals);
        let points = points.map(|((x, y), interval)| CurvePoint {
            x: *x,
            y: *y,
            interval: Some(*interval),
        });
        Series::new(curve.name, points)
    });
    Some(LinePlot {
        title: format!("Caption quality: {}", axis.name),
        x: plot::Axis::new(axis.about, ""),
        y: plot::Axis::new("Score (95 % interval)", ""),
        series: series.collect(),
        markers: Markers::EveryPoint,
        ..LinePlot::default()
    })
}
