//! `ablate`: trains and evaluates a grid of modified recipes. This module contains the training. The crate `eval`,
//! which needs no learning framework, creates the tables.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use radarllm_dataset::Split;
use radarllm_eval::{
    ablation::{Grid, GridTable, TableReport, markdown},
    captions::EvaluationOptions,
};
use radarllm_files::bounded::{self as files, MAX_CONFIG_BYTES};
use radarllm_train::{harness::StopToken, recipe::RecipeStage};

use super::AblateArgs;
use crate::{
    commands::{
        eval::captions,
        trainings::{self, Change, Run, end_if_stopped, plan_run, side_by_side, train_all},
    },
    error::{CliError, CliResult},
    interrupt,
    model_args::DecoderName,
    output,
};

/// A grid with the trainings that it needs.
pub(crate) struct PlannedGrid {
    grid: Grid,
    /// Folder of the grid's file, to which its paths are relative.
    base: PathBuf,
    /// `[table][row][seed]`.
    runs: Vec<Vec<Vec<Run>>>,
    stop: StopToken,
}

/// Runs the command.
pub(crate) fn run(args: &AblateArgs) -> CliResult {
    let planned = PlannedGrid::open(&args.config, |_| ())?;
    if args.plan {
        return planned.print_plan();
    }
    let (tables, markdown) = planned.run(args.jobs)?;
    if args.json {
        return output::print_json(&tables);
    }
    output::print_line(markdown.trim_end());
    Ok(())
}

impl PlannedGrid {
    /// Reads a grid, which `change` may change, and plans its trainings.
    pub(crate) fn open(path: &Path, change: impl FnOnce(&mut Grid)) -> CliResult<Self> {
        let base = path.parent().unwrap_or(Path::new(""));
        let text = files::read_text(path, MAX_CONFIG_BYTES)?;
        let mut grid = Grid::from_toml(&text).map_err(|e| {
            CliError::new(format!("{}: {e}", path.display())).hint("see docs/guides/ablations.md")
        })?;
        change(&mut grid);
        grid.out = base.join(&grid.out);
        let mut planned = Self {
            base: base.into(),
            runs: Vec::new(),
            stop: interrupt::stop_on_ctrl_c()?,
            grid,
        };
        planned.plan_again()?;
        Ok(planned)
    }

    /// Plans the trainings anew, after a data set was built.
    pub(crate) fn plan_again(&mut self) -> CliResult {
        self.runs = plan(&self.grid, &self.base)?;
        for run in self.runs.iter_mut().flatten().flatten() {
            run.recipe.stop = self.stop.clone();
        }
        Ok(())
    }

    /// The runs without those that stand in several tables, by all inputs of their results.
    fn unique(&self) -> BTreeMap<&str, &Run> {
        let all = self.runs.iter().flatten().flatten();
        all.map(|run| (run.id.as_str(), run)).collect()
    }

    /// Prints finished and missing stages.
    pub(crate) fn print_plan(&self) -> CliResult {
        trainings::print_plan(&self.unique())
    }

    /// The first row of the first table with the first seed: the model that the others change.
    pub(crate) fn whole(&self) -> CliResult<&Run> {
        let first = self.runs.iter().flatten().flatten().next();
        first.ok_or_else(|| CliError::new("the grid has no row"))
    }

    /// Trains and evaluates what is missing, and writes `ablation.json` and `ablation.md`.
    pub(crate) fn run(&self, jobs: usize) -> CliResult<(Vec<TableReport>, String)> {
        let (unique, stop) = (self.unique(), &self.stop);
        train_all(&unique, jobs, stop)?;
        let options = EvaluationOptions {
            split: self.grid.split,
            // Greedy, so that rows of different dates are decided alike.
            beam: Some(1),
            ..EvaluationOptions::default()
        };
        let missing: Vec<&Run> = unique
            .values()
            .filter(|run| !has_report(run, self.grid.split))
            .copied()
            .collect();
        side_by_side(jobs, missing, |run| {
            if stop.is_stopped() {
                return Ok(());
            }
            run.assemble()?;
            captions::evaluate_into(
                &run.report(),
                Some(&run.recipe.model_dir()),
                DecoderName::F32,
                &run.data,
                &options,
                &|_, _, _| Ok(()),
            )
            .map(|_| ())
        })?;
        end_if_stopped(stop);
        let tables = self
            .grid
            .tables
            .iter()
            .zip(&self.runs)
            .map(|(table, rows)| table_report(&self.grid, table, rows))
            .collect::<CliResult<Vec<_>>>()?;
        let markdown = markdown(&self.grid, &tables)?;
        output::write_atomic(
            &self.grid.out.join("ablation.json"),
            serde_json::to_string_pretty(&tables)?.as_bytes(),
        )?;
        output::write_atomic(&self.grid.out.join("ablation.md"), markdown.as_bytes())?;
        Ok((tables, markdown))
    }
}

/// Whether a run was evaluated on the split.
fn has_report(run: &Run, split: Split) -> bool {
    read_report(run).is_ok_and(|report| report["split"] == split.name())
}

/// Expands the grid, whose folder `out` is not relative to `base`, into runs: `[table][row][seed]`.
fn plan(grid: &Grid, base: &Path) -> CliResult<Vec<Vec<Vec<Run>>>> {
    let path = base.join(&grid.base);
    let recipe = trainings::read_recipe(&path)?;
    let recipe_base = path.parent().unwrap_or(Path::new(""));
    let rows_of = |table: &GridTable| -> CliResult<Vec<Vec<Run>>> {
        table
            .rows
            .iter()
            .map(|row| {
                grid.seeds
                    .iter()
                    .map(|&seed| {
                        let mut stages = RecipeStage::ALL.to_vec();
                        if !row.instruct {
                            stages.pop();
                        }
                        let change = Change {
                            set: grid.common.iter().chain(&row.set).collect(),
                            unset: &row.unset,
                            seed,
                            stages,
                        };
                        plan_run(&change, &recipe, recipe_base, &grid.out)
                            .map_err(|e| CliError::new(format!("row `{}`: {}", row.name, e.cause)))
                    })
                    .collect()
            })
            .collect()
    };
    grid.tables.iter().map(rows_of).collect()
}

fn table_report(grid: &Grid, table: &GridTable, rows: &[Vec<Run>]) -> CliResult<TableReport> {
    let reports = rows
        .iter()
        .map(|runs| runs.iter().map(read_report).collect())
        .collect::<CliResult<Vec<Vec<serde_json::Value>>>>()?;
    Ok(table.report(&grid.seeds, |row, seed, key| {
        metric(&reports[row][seed], key)
    }))
}

fn read_report(run: &Run) -> CliResult<serde_json::Value> {
    let path = run.report().join("report.json");
    let bytes = files::read_bytes(&path, MAX_CONFIG_BYTES)?;
    Ok(serde_json::from_slice(&bytes)?)
}

/// A metric of the model on its own radar; `None` where it was not computed.
fn metric(report: &serde_json::Value, key: &str) -> Option<f64> {
    let model = &report["systems"][0];
    match key {
        // The old name of the field is accepted too, so that models need not be evaluated again.
        "action_accuracy" => ["action_accuracy", "right_action"]
            .into_iter()
            .find_map(|name| model[name]["value"].as_f64()),
        _ => model["scores"][key].as_f64(),
    }
}

#[cfg(test)]
mod tests {
    use std::{fs, path::PathBuf};

    use super::*;

    const GRID: &str = r#"
base = "model.toml"
out = "grid"
seeds = [1, 2]
common = { "tokenizer.loop.max_steps" = 3 }

[[table]]
title = "Parts"
columns = ["bleu_1", "meteor"]

[[table.row]]
name = "whole"
reported = { bleu_1 = 48.0, meteor = 33.7 }
doubted = { meteor = "differs elsewhere." }

[[table.row]]
name = "one codebook"
set = { "tokenizer.model.codebook_size" = 64 }

[[table.row]]
name = "whole again, untuned"
instruct = false

[[table.row]]
name = "one task"
set = { "pretrain.sampling.text_to_radar" = 0.0 }
unset = ["pretrain.flip"]
"#;

    fn planned() -> Vec<Vec<Run>> {
        let dir = tempfile::tempdir().unwrap();
        fs::write(
            dir.path().join("model.toml"),
            "data = \"data\"\n[pretrain]\nflip = false\n",
        )
        .unwrap();
        let grid = Grid::from_toml(GRID).unwrap();
        plan(&grid, dir.path()).unwrap().remove(0)
    }

    #[test]
    fn rows_share_the_stages_in_which_they_agree() {
        let rows = planned();
        let folder = |row: usize, seed: usize, stage| rows[row][seed].recipe.stage_dir(stage);
        let same = |row: usize, stage| folder(row, 0, stage) == folder(0, 0, stage);
        use RecipeStage::{Instruct, Motion, Pretrain, Tokenizer};
        assert!(same(1, Motion) && !same(1, Tokenizer) && !same(1, Pretrain));
        assert!(same(2, Tokenizer) && same(2, Pretrain));
        assert_eq!(rows[2][0].stages, [Motion, Tokenizer, Pretrain]);
        assert!(same(3, Tokenizer) && !same(3, Pretrain) && !same(3, Instruct));
        let flips = [0, 3].map(|row| rows[row][0].recipe.pretrain.flip);
        assert_eq!(flips, [false, true]);
        // Runs with different seeds share no stage, and every model has its own folder.
        assert!(folder(0, 0, Motion) != folder(0, 1, Motion));
        let mut outs: Vec<_> = rows.iter().flatten().map(|r| &r.recipe.out).collect();
        outs.sort();
        outs.dedup();
        assert_eq!(outs.len(), 8);
        // The folder of a grid is relative to its file already.
        assert!(rows[0][0].recipe.out.starts_with("grid"));
        let recipe = &rows[1][1].recipe;
        assert_eq!(recipe.tokenizer.model.codebook_size, 64);
        assert_eq!(
            (recipe.tokenizer.run.max_steps, recipe.tokenizer.run.seed),
            (3, 2)
        );
    }

    #[test]
    fn rows_learn_all_data_sets_and_are_evaluated_on_the_first() {
        let of = |data: &str| {
            let dir = tempfile::tempdir().unwrap();
            let recipe = format!("data = {data}\n[pretrain]\nflip = false\n");
            fs::write(dir.path().join("model.toml"), recipe).unwrap();
            let grid = Grid::from_toml(GRID).unwrap();
            let run = plan(&grid, dir.path())
                .unwrap()
                .remove(0)
                .remove(0)
                .remove(0);
            let name = |path: &PathBuf| path.file_name().unwrap().to_str().unwrap().to_string();
            let all: Vec<_> = run.recipe.data.iter().map(name).collect();
            (name(&run.data), all)
        };
        assert_eq!(of(r#""a""#), ("a".into(), vec!["a".into()]));
        assert_eq!(
            of(r#"["a", "b"]"#),
            ("a".into(), vec!["a".into(), "b".into()])
        );
    }

    #[test]
    fn a_report_on_another_split_is_made_anew() {
        let dir = tempfile::tempdir().unwrap();
        let mut run = planned().remove(0).remove(0);
        run.recipe.out = dir.path().into();
        assert!(!has_report(&run, Split::Val));
        fs::create_dir(run.report()).unwrap();
        fs::write(run.report().join("report.json"), "{\"split\": \"val\"}").unwrap();
        assert!(has_report(&run, Split::Val) && !has_report(&run, Split::Test));
    }

    #[test]
    fn slips_in_a_grid_are_named() {
        let bad = GRID.replace("codebook_size\" = 64", "codebook_sise\" = 64");
        let dir = tempfile::tempdir().unwrap();
        fs::write(dir.path().join("model.toml"), "").unwrap();
        let grid = Grid::from_toml(&bad).unwrap();
        let Err(error) = plan(&grid, dir.path()) else {
            panic!("a wrong key was taken");
        };
        assert!(error.cause.contains("one codebook") && error.cause.contains("codebook_sise"));
    }

    #[test]
    fn metrics_are_found_in_reports_of_either_name() {
        let report = |field: &str| {
            serde_json::json!({"systems": [{
                "scores": {"bleu_1": 0.5, "meteor": null}, field: {"value": 0.25}
            }]})
        };
        for field in ["action_accuracy", "right_action"] {
            assert_eq!(metric(&report(field), "bleu_1"), Some(0.5));
            assert_eq!(metric(&report(field), "meteor"), None);
            assert_eq!(metric(&report(field), "action_accuracy"), Some(0.25));
        }
    }
}
