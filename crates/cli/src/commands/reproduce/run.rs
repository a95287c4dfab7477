//! Data, trainings and evaluations of a scale, each resumed where it stopped.

use std::path::{Path, PathBuf};

use radarllm_dataset::{BuildOptions, Overwrite, Split};
use radarllm_eval::{instructions::InstructionOptions, round_trip::RoundTripOptions};
use radarllm_files::bounded::{self as files, MAX_CONFIG_BYTES};
use radarllm_synth::DatasetPlan;
use radarllm_train::recipe::RecipeStage;
use serde::Deserialize;
use toml::Value;

use super::{ReproduceVerb, page};
use crate::{
    commands::{
        ablate::PlannedGrid,
        dataset,
        eval::{captions, instructions},
    },
    error::{CliError, CliResult},
    model_args::DecoderName,
    output, threads,
};

/// The file of a scale. Paths are relative to it.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ScaleConfig {
    /// Data set that is trained on and evaluated.
    data: PathBuf,
    /// Grid of trainings; its first row is the whole system.
    grid: PathBuf,
    /// Wordings of questions.
    questions: PathBuf,
    /// Sentences of the round trip.
    round_trip: usize,
    /// What cannot be had from the repository: each a path and what it is.
    #[serde(default)]
    needs: Vec<Need>,
    /// What it took where it was run.
    took: String,
}

/// Something that a user has to get.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Need {
    path: PathBuf,
    what: String,
}

/// Runs the command.
pub(crate) fn run(verb: &ReproduceVerb) -> CliResult {
    let ReproduceVerb::Paper(args) = verb;
    let base = &args.configs;
    let path = base.join(format!("{}.toml", args.scale.name()));
    let text = files::read_text(&path, MAX_CONFIG_BYTES).map_err(|e| {
        CliError::new(e).hint("--configs names the folder configs/reproduce of a clone")
    })?;
    let config: ScaleConfig =
        toml::from_str(&text).map_err(|e| CliError::new(format!("{}: {e}", path.display())))?;
    for need in &config.needs {
        let place = base.join(&need.path);
        if !place.exists() {
            let missing = CliError::new(format!("{}: missing: {}", place.display(), need.what));
            return Err(missing.hint("docs/guides/reproduce.md says where it can be had"));
        }
    }
    let data = args.out.join("data");
    let plan = DatasetPlan::open(&base.join(&config.data))?;
    let (grid_out, all_data) = (absolute(&args.out.join("grid"))?, absolute(&data)?);
    let mut grid = PlannedGrid::open(&base.join(&config.grid), |grid| {
        let path = Value::String(all_data.display().to_string());
        grid.common.insert("data".into(), path);
        grid.out = grid_out;
    })?;
    if args.plan {
        output::print_line(&format!("{} clips are simulated", plan.n_clips()));
        grid.print_plan()?;
        output::print_line(&format!("it took {}", config.took));
        return Ok(());
    }
    let building = BuildOptions {
        threads: threads::threads(None),
        overwrite: Overwrite::Refuse,
        retry_failed: false,
    };
    dataset::build(&plan, &data, building, false)?;
    grid.plan_again()?;
    let (tables, ablations) = grid.run(args.jobs)?;

    let whole = grid.whole()?;
    if !whole.recipe.is_finished(RecipeStage::Points) {
        whole.recipe.run(RecipeStage::Points, true)?;
    }
    whole.assemble()?;
    let model = whole.recipe.model_dir();
    let trips = RoundTripOptions {
        split: Split::Test,
        count: config.round_trip,
        beam: Some(1),
        seed: 1,
    };
    let trips = captions::round_trip_into(
        &args.out.join("round-trip"),
        Some(&model),
        DecoderName::F32,
        &whole.data,
        &trips,
    )?;
    let asking = InstructionOptions {
        split: Split::Test,
        count: 0,
        seed: 1,
    };
    let wordings = base.join(&config.questions);
    let folder = args.out.join("instructions");
    let asked = instructions::evaluate_into(&folder, &model, &wordings, &whole.data, &asking)?;
    let report = whole.report().join("report.json");
    let report: serde_json::Value =
        serde_json::from_slice(&files::read_bytes(&report, MAX_CONFIG_BYTES)?)?;
    let text = page::of(&page::Parts {
        scale: args.scale.name(),
        clips: plan.n_clips(),
        report: &report,
        tables: &tables,
        ablations: &ablations,
        round_trip: &trips.0,
        instructions: &asked,
    });
    let page = args.out.join("paper.md");
    output::write_atomic(&page, text.as_bytes())?;
    output::print_line(&page.display().to_string());
    Ok(())
}

fn absolute(path: &Path) -> CliResult<PathBuf> {
    let problem = |e| CliError::new(format!("{}: {e}", path.display()));
    std::path::absolute(path).map_err(problem)
}
