//! `ablate`: a grid of trainings that differ in single settings, evaluated, in tables.
//!
//! A stage's folder is named by everything that its result depends on, so rows that agree up to a stage
//! share it, and a grid that is started again goes on where it stopped.

use std::{
    collections::BTreeMap,
    fmt::Write as _,
    fs,
    path::{Path, PathBuf},
    sync::Mutex,
};

use radarllm_train::recipe::{Recipe, RecipeStage};
use serde::{Deserialize, Serialize};
use toml::{Table, Value};

use crate::{
    args::{AblateArgs, DecoderName, EvalArgs},
    commands::{self, eval},
    error::{CliError, CliResult},
    files::{self, MAX_CONFIG_BYTES},
    output,
};

/// Metrics a table may show: key in report.json, heading, factor for print.
const METRICS: [(&str, &str, f64); 9] = [
    ("rouge_1", "ROUGE-1", 100.0),
    ("rouge_l", "ROUGE-L", 100.0),
    ("bleu_1", "BLEU-1", 100.0),
    ("bleu_4", "BLEU-4", 100.0),
    ("meteor", "METEOR", 100.0),
    ("cider_d", "CIDEr-D", 1.0),
    ("self_bleu", "Self-BLEU", 100.0),
    ("bert_score", "BERTScore", 100.0),
    ("right_action", "right action", 100.0),
];

/// The grid's file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Grid {
    /// Recipe that every row changes, relative to this file.
    base: PathBuf,
    /// Folder for everything, relative to this file.
    out: PathBuf,
    /// Split to evaluate on.
    #[serde(default = "test_split")]
    split: String,
    /// Every row is trained once with each.
    seeds: Vec<u64>,
    /// Changes to the base recipe for all rows: dotted key to value.
    #[serde(default)]
    common: Table,
    #[serde(rename = "table")]
    tables: Vec<GridTable>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct GridTable {
    title: String,
    /// Keys of [`METRICS`].
    columns: Vec<String>,
    #[serde(rename = "row")]
    rows: Vec<Row>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Row {
    name: String,
    /// Changes to the common recipe: dotted key to value.
    #[serde(default)]
    set: Table,
    /// False leaves instruction tuning out.
    #[serde(default = "yes")]
    instruct: bool,
    /// Published values, as printed there.
    #[serde(default)]
    reported: BTreeMap<String, f64>,
    /// Why some of them are doubtful: printed below the table, and a mark beside the value.
    #[serde(default)]
    doubted: BTreeMap<String, String>,
}

fn test_split() -> String {
    "test".into()
}

fn yes() -> bool {
    true
}

/// One training of one row.
struct Run {
    recipe: Recipe,
    /// The data set that it learns from and is evaluated on.
    data: PathBuf,
    /// Stages in order.
    stages: Vec<RecipeStage>,
    /// Everything that the result depends on.
    id: String,
}

impl Run {
    fn report(&self) -> PathBuf {
        self.recipe.out.join("report")
    }
}

/// A value over the seeds.
#[derive(Clone, Debug, Serialize)]
struct Spread {
    mean: f64,
    /// Standard deviation of the sample; none of a single seed.
    deviation: Option<f64>,
}

#[derive(Serialize)]
struct RowReport {
    name: String,
    seeds: Vec<u64>,
    ours: BTreeMap<String, Option<Spread>>,
    reported: BTreeMap<String, f64>,
    doubted: BTreeMap<String, String>,
}

#[derive(Serialize)]
struct TableReport {
    title: String,
    columns: Vec<String>,
    rows: Vec<RowReport>,
}

/// Runs the verb.
pub fn run(args: &AblateArgs) -> CliResult {
    let base = args.config.parent().unwrap_or(Path::new(""));
    let text = files::read_text(&args.config, MAX_CONFIG_BYTES)?;
    let problem = |e: &dyn std::fmt::Display| {
        CliError::new(format!("{}: {e}", args.config.display())).hint("see docs/ablations.md")
    };
    let grid: Grid = toml::from_str(&text).map_err(|e| problem(&e))?;
    check(&grid).map_err(|e| problem(&e))?;
    let plan = plan(&grid, base)?;
    let unique: BTreeMap<&str, &Run> = plan
        .iter()
        .flatten()
        .flatten()
        .map(|run| (run.id.as_str(), run))
        .collect();
    if args.plan {
        return print_plan(&unique);
    }
    for stage in RecipeStage::ALL {
        // One job per folder: rows that share a stage train it once.
        let jobs: BTreeMap<PathBuf, &Run> = unique
            .values()
            .filter(|run| run.stages.contains(&stage) && !run.recipe.is_finished(stage))
            .map(|run| (run.recipe.stage_dir(stage), *run))
            .collect();
        side_by_side(args.jobs, jobs.into_iter().collect(), |(folder, run)| {
            eprintln!("{}: {}", stage.name(), folder.display());
            match run.recipe.run(stage, true)? {
                true => Ok(()),
                false => Err(
                    CliError::new(format!("{}: stopped early", folder.display()))
                        .hint("the same command goes on from there"),
                ),
            }
        })?;
    }
    let missing: Vec<&Run> = unique
        .values()
        .filter(|run| !run.report().join("report.json").is_file())
        .copied()
        .collect();
    side_by_side(args.jobs, missing, |run| {
        let last = *run.stages.last().unwrap_or(&RecipeStage::Instruct);
        run.recipe.assemble(last)?;
        eval::evaluate(&EvalArgs {
            model: Some(run.recipe.model_dir()),
            data: run.data.clone(),
            split: grid.split.clone(),
            out: run.report(),
            beam: 1,
            decoder: DecoderName::F32,
            seed: 1,
            force: true,
            json: false,
        })
        .map(|_| ())
    })?;
    let tables = grid
        .tables
        .iter()
        .zip(&plan)
        .map(|(table, rows)| table_report(&grid, table, rows))
        .collect::<CliResult<Vec<_>>>()?;
    let markdown = markdown(&grid, &tables)?;
    let out = base.join(&grid.out);
    output::write_atomic(
        &out.join("ablation.json"),
        serde_json::to_string_pretty(&tables)?.as_bytes(),
    )?;
    output::write_atomic(&out.join("ablation.md"), markdown.as_bytes())?;
    if args.json {
        return output::print_json(&tables);
    }
    output::print_line(markdown.trim_end());
    Ok(())
}

fn check(grid: &Grid) -> Result<(), String> {
    if grid.seeds.is_empty() {
        return Err("seeds: at least one is needed".into());
    }
    if grid.tables.iter().all(|table| table.rows.is_empty()) {
        return Err("no table has a row".into());
    }
    for table in &grid.tables {
        let known = |key: &String| METRICS.iter().any(|m| m.0 == key);
        let reported = table.rows.iter().flat_map(|row| row.reported.keys());
        for row in &table.rows {
            if let Some(key) = row.doubted.keys().find(|k| !row.reported.contains_key(*k)) {
                return Err(format!(
                    "row `{}`: {key} is doubted, but not reported",
                    row.name
                ));
            }
        }
        if let Some(key) = table.columns.iter().chain(reported).find(|k| !known(k)) {
            let names: Vec<&str> = METRICS.iter().map(|m| m.0).collect();
            return Err(format!("{key}: unknown; columns are {}", names.join(", ")));
        }
    }
    Ok(())
}

/// `[table][row][seed]`.
fn plan(grid: &Grid, base: &Path) -> CliResult<Vec<Vec<Vec<Run>>>> {
    let path = base.join(&grid.base);
    let text = files::read_text(&path, MAX_CONFIG_BYTES)?;
    let recipe: Table = text
        .parse()
        .map_err(|e| CliError::new(format!("{}: {e}", path.display())))?;
    let recipe_base = path.parent().unwrap_or(Path::new(""));
    let out = base.join(&grid.out);
    let rows_of = |table: &GridTable| -> CliResult<Vec<Vec<Run>>> {
        table
            .rows
            .iter()
            .map(|row| {
                grid.seeds
                    .iter()
                    .map(|&seed| {
                        plan_run(grid, row, seed, &recipe, recipe_base, &out)
                            .map_err(|e| CliError::new(format!("row `{}`: {}", row.name, e.cause)))
                    })
                    .collect()
            })
            .collect()
    };
    grid.tables.iter().map(rows_of).collect()
}

fn plan_run(
    grid: &Grid,
    row: &Row,
    seed: u64,
    recipe: &Table,
    recipe_base: &Path,
    out: &Path,
) -> CliResult<Run> {
    let mut changed = recipe.clone();
    for (key, value) in grid.common.iter().chain(&row.set) {
        set(&mut changed, key, value.clone())?;
    }
    for stage in RecipeStage::ALL {
        let seed = i64::try_from(seed)?;
        set(
            &mut changed,
            &format!("{}.loop.seed", stage.name()),
            Value::Integer(seed),
        )?;
    }
    let mut recipe = Recipe::from_toml(&toml::to_string(&changed)?, recipe_base)?;
    let mut stages = RecipeStage::ALL.to_vec();
    if !row.instruct {
        stages.pop();
    }
    // The printed recipe has every default, so that a changed default changes the name too.
    let printed: Table = recipe.to_toml()?.parse()?;
    let [data] = recipe.data.as_slice() else {
        return Err(CliError::new(format!(
            "data: {} data sets, but rows are evaluated on one",
            recipe.data.len()
        )));
    };
    let mut depends_on = format!(
        "{}, simulations of a motion: {}",
        data.display(),
        recipe.simulations_per_motion
    );
    let mut id = String::new();
    for &stage in &stages {
        let part = printed.get(stage.name()).map(ToString::to_string);
        write!(
            depends_on,
            "\n[{}] {}",
            stage.name(),
            part.unwrap_or_default()
        )?;
        id = format!("{}-{seed}-{:016x}", stage.name(), fingerprint(&depends_on));
        recipe.stage_folders.insert(stage.name(), out.join(&id));
    }
    recipe.out = out.join(format!("model-{id}"));
    let data = data.clone();
    Ok(Run {
        recipe,
        data,
        stages,
        id,
    })
}

/// FNV-1a, 64 bit: names folders, protects nothing.
fn fingerprint(text: &str) -> u64 {
    text.bytes().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
    })
}

/// Sets a dotted key; tables on the way are made.
fn set(table: &mut Table, key: &str, value: Value) -> CliResult {
    match key.split_once('.') {
        None => {
            table.insert(key.into(), value);
            Ok(())
        }
        Some((first, rest)) => {
            let inner = table
                .entry(first)
                .or_insert_with(|| Value::Table(Table::new()));
            match inner.as_table_mut() {
                Some(inner) => set(inner, rest, value),
                None => Err(CliError::new(format!("{key}: `{first}` is no table"))),
            }
        }
    }
}

/// Works through `jobs`, `n` at a time, which share the cores; the first error stops what has not begun.
fn side_by_side<J: Send>(
    n: usize,
    jobs: Vec<J>,
    work: impl Fn(J) -> CliResult + Sync,
) -> CliResult {
    let n = n.max(1);
    let threads_each = (commands::threads(None) / n).max(1);
    let queue = Mutex::new((jobs.into_iter(), None));
    std::thread::scope(|scope| {
        for _ in 0..n {
            scope.spawn(|| {
                loop {
                    let job = {
                        let mut queue = queue.lock().unwrap_or_else(|e| e.into_inner());
                        if queue.1.is_some() {
                            return;
                        }
                        queue.0.next()
                    };
                    let Some(job) = job else { return };
                    let result = commands::on_threads(Some(threads_each), || work(job));
                    if let Err(error) = result.and_then(|result| result) {
                        let mut queue = queue.lock().unwrap_or_else(|e| e.into_inner());
                        queue.1.get_or_insert(error);
                    }
                }
            });
        }
    });
    match queue.into_inner().unwrap_or_else(|e| e.into_inner()).1 {
        None => Ok(()),
        Some(error) => Err(error),
    }
}

fn print_plan(unique: &BTreeMap<&str, &Run>) -> CliResult {
    let mut stages = BTreeMap::new();
    for run in unique.values() {
        for &stage in &run.stages {
            let folder = run.recipe.stage_dir(stage);
            stages.insert(folder, run.recipe.is_finished(stage));
        }
    }
    for (folder, finished) in &stages {
        let state = if *finished { "done " } else { "to do" };
        output::print_line(&format!("{state}  {}", folder.display()));
    }
    let done = stages.values().filter(|done| **done).count();
    output::print_line(&format!(
        "{} models; {} stages, {done} done",
        unique.len(),
        stages.len()
    ));
    Ok(())
}

fn table_report(grid: &Grid, table: &GridTable, rows: &[Vec<Run>]) -> CliResult<TableReport> {
    let rows = table
        .rows
        .iter()
        .zip(rows)
        .map(|(row, runs)| {
            let reports = runs
                .iter()
                .map(|run| {
                    let path = run.report().join("report.json");
                    let bytes = fs::read(&path).map_err(|e| CliError::io(&path, e))?;
                    Ok(serde_json::from_slice(&bytes)?)
                })
                .collect::<CliResult<Vec<serde_json::Value>>>()?;
            let ours = table
                .columns
                .iter()
                .map(|key| {
                    let values: Option<Vec<f64>> =
                        reports.iter().map(|report| metric(report, key)).collect();
                    (key.clone(), values.and_then(|v| spread(&v)))
                })
                .collect();
            Ok(RowReport {
                name: row.name.clone(),
                seeds: grid.seeds.clone(),
                ours,
                reported: row.reported.clone(),
                doubted: row.doubted.clone(),
            })
        })
        .collect::<CliResult<Vec<_>>>()?;
    Ok(TableReport {
        title: table.title.clone(),
        columns: table.columns.clone(),
        rows,
    })
}

/// A metric of the model on its own radar; `None` where it was not run.
fn metric(report: &serde_json::Value, key: &str) -> Option<f64> {
    let model = &report["systems"][0];
    match key {
        "right_action" => model["right_action"]["value"].as_f64(),
        _ => model["scores"][key].as_f64(),
    }
}

fn spread(values: &[f64]) -> Option<Spread> {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let squares: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
    (!values.is_empty()).then(|| Spread {
        mean,
        deviation: (values.len() > 1).then(|| (squares / (n - 1.0)).sqrt()),
    })
}

fn markdown(grid: &Grid, tables: &[TableReport]) -> CliResult<String> {
    let mut text = String::new();
    writeln!(
        text,
        "Split `{}`, protocol `plain`, greedy; values x100 (CIDEr-D in its own scale); seeds {:?}, mean and standard \
         deviation over them. *reported*: the paper's figure, on other data at another size.",
        grid.split, grid.seeds
    )?;
    for table in tables {
        let shown: Vec<(&str, &str, f64)> = METRICS
            .into_iter()
            .filter(|m| table.columns.iter().any(|c| c == m.0))
            .collect();
        writeln!(text, "\n## {}\n", table.title)?;
        write!(text, "| |")?;
        for (_, heading, _) in &shown {
            write!(text, " {heading} | *reported* |")?;
        }
        writeln!(text, "\n|---|{}", "---|---|".repeat(shown.len()))?;
        for row in &table.rows {
            write!(text, "| {} |", row.name)?;
            for (key, _, factor) in &shown {
                match row.ours.get(*key).and_then(Option::as_ref) {
                    None => write!(text, " not run |")?,
                    Some(Spread { mean, deviation }) => {
                        let digits = if *factor == 1.0 { 3 } else { 1 };
                        write!(text, " {:.digits$}", mean * factor)?;
                        if let Some(deviation) = deviation {
                            write!(text, " +- {:.digits$}", deviation * factor)?;
                        }
                        write!(text, " |")?;
                    }
                }
                match (row.reported.get(*key), row.doubted.get(*key)) {
                    (Some(value), None) => write!(text, " *{value}* |")?,
                    (Some(value), Some(_)) => write!(text, " *{value}* (?) |")?,
                    (None, _) => write!(text, " |")?,
                }
            }
            writeln!(text)?;
        }
        let mut reasons: BTreeMap<&str, Vec<String>> = BTreeMap::new();
        for row in &table.rows {
            for (key, heading, _) in &shown {
                if let Some(reason) = row.doubted.get(*key) {
                    let place = format!("{}, {heading}", row.name);
                    reasons.entry(reason).or_default().push(place);
                }
            }
        }
        for (reason, places) in reasons {
            writeln!(text, "\n(?) {}: {reason}", places.join("; "))?;
        }
    }
    Ok(text)
}

#[cfg(test)]
mod tests {
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
"#;

    fn planned() -> Vec<Vec<Run>> {
        let dir = tempfile::tempdir().unwrap();
        fs::write(dir.path().join("model.toml"), "data = \"data\"\n").unwrap();
        let grid: Grid = toml::from_str(GRID).unwrap();
        check(&grid).unwrap();
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
        // Another seed shares nothing, and no two models have one folder.
        assert!(folder(0, 0, Motion) != folder(0, 1, Motion));
        let mut outs: Vec<_> = rows.iter().flatten().map(|r| &r.recipe.out).collect();
        outs.sort();
        outs.dedup();
        assert_eq!(outs.len(), 8);
        let recipe = &rows[1][1].recipe;
        assert_eq!(recipe.tokenizer.model.codebook_size, 64);
        assert_eq!(
            (recipe.tokenizer.run.max_steps, recipe.tokenizer.run.seed),
            (3, 2)
        );
    }

    #[test]
    fn slips_in_a_grid_are_named() {
        let bad = GRID.replace("codebook_size\" = 64", "codebook_sise\" = 64");
        let dir = tempfile::tempdir().unwrap();
        fs::write(dir.path().join("model.toml"), "").unwrap();
        let grid: Grid = toml::from_str(&bad).unwrap();
        let Err(error) = plan(&grid, dir.path()) else {
            panic!("a wrong key was taken");
        };
        assert!(error.cause.contains("one codebook") && error.cause.contains("codebook_sise"));
        let grid: Grid = toml::from_str(&GRID.replace("meteor", "metoer")).unwrap();
        assert!(check(&grid).unwrap_err().contains("metoer"));
    }

    #[test]
    fn tables_show_what_was_run_and_what_was_reported() {
        let report = serde_json::json!({"systems": [{
            "scores": {"bleu_1": 0.5, "meteor": null}, "right_action": {"value": 0.25}
        }]});
        assert_eq!(metric(&report, "bleu_1"), Some(0.5));
        assert_eq!(metric(&report, "meteor"), None);
        assert_eq!(metric(&report, "right_action"), Some(0.25));
        let s = spread(&[0.4, 0.6]).unwrap();
        assert!((s.mean - 0.5).abs() < 1e-12);
        assert!((s.deviation.unwrap() - 0.02_f64.sqrt()).abs() < 1e-12);
        let grid: Grid = toml::from_str(GRID).unwrap();
        let table = TableReport {
            title: "Parts".into(),
            columns: vec!["bleu_1".into(), "meteor".into()],
            rows: vec![RowReport {
                name: "whole".into(),
                seeds: vec![1, 2],
                ours: [("bleu_1".into(), Some(s)), ("meteor".into(), None)].into(),
                reported: [("bleu_1".into(), 48.0), ("meteor".into(), 33.7)].into(),
                doubted: [("meteor".into(), "differs elsewhere.".into())].into(),
            }],
        };
        let text = markdown(&grid, &[table]).unwrap();
        assert!(
            text.contains("| whole | 50.0 +- 14.1 | *48* | not run | *33.7* (?) |"),
            "{text}"
        );
        assert!(
            text.ends_with("\n(?) whole, METEOR: differs elsewhere.\n"),
            "{text}"
        );
        let stray = GRID.replace("bleu_1 = 48.0, meteor = 33.7", "bleu_1 = 48.0");
        let grid: Grid = toml::from_str(&stray).unwrap();
        assert!(check(&grid).unwrap_err().contains("meteor is doubted"));
    }
}
