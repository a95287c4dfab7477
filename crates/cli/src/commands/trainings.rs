//! Trainings of changed recipes that share their stages, for `ablate`, `reproduce` and `baselines`.
//!
//! The folder of a stage is named by all inputs of its result. Trainings that agree up to a stage therefore share it, and
//! what is restarted continues where it stopped.

use std::{
    collections::BTreeMap,
    fmt::Write as _,
    path::{Path, PathBuf},
    sync::Mutex,
};

use radarllm_base::hash::fnv_1a;
use radarllm_files::bounded::{self as files, MAX_CONFIG_BYTES};
use radarllm_train::{
    harness::StopToken,
    recipe::{Recipe, RecipeStage},
};
use toml::{Table, Value};

use crate::{
    error::{CliError, CliResult},
    interrupt, output, threads,
};

/// One training.
pub(crate) struct Run {
    /// What is trained.
    pub recipe: Recipe,
    /// Data set for evaluation: the first of those that the recipe trains on.
    pub data: PathBuf,
    /// Stages in order.
    pub stages: Vec<RecipeStage>,
    /// All inputs of the result.
    pub id: String,
}

impl Run {
    /// Folder of the report on its captions.
    pub(crate) fn report(&self) -> PathBuf {
        self.recipe.out.join("report")
    }

    /// Puts the results of the stages into the folder that inference opens.
    pub(crate) fn assemble(&self) -> CliResult {
        let last = *self.stages.last().unwrap_or(&RecipeStage::Instruct);
        Ok(self.recipe.assemble(last)?)
    }
}

/// How a training differs from a base recipe.
pub(crate) struct Change<'a> {
    /// Dotted keys with their values; a later one replaces an earlier one.
    pub set: Vec<(&'a String, &'a Value)>,
    /// Dotted keys that are left at their defaults.
    pub unset: &'a [String],
    /// Seed of all stages.
    pub seed: u64,
    /// The stages, in order; by default all of a model that describes.
    pub stages: Vec<RecipeStage>,
}

/// Reads a recipe as a table of keys.
pub(crate) fn read_recipe(path: &Path) -> CliResult<Table> {
    let text = files::read_text(path, MAX_CONFIG_BYTES)?;
    text.parse()
        .map_err(|e| CliError::new(format!("{}: {e}", path.display())))
}

/// The training of a changed recipe, whose paths are relative to `recipe_base`, with its folders in `out`. Data sets have to be
/// built already, because their content is a part of the names of the folders; those of a data set that is not built have
/// other names.
pub(crate) fn plan_run(
    change: &Change,
    recipe: &Table,
    recipe_base: &Path,
    out: &Path,
) -> CliResult<Run> {
    let mut changed = recipe.clone();
    for key in change.unset {
        unset(&mut changed, key)?;
    }
    for (key, value) in &change.set {
        set(&mut changed, key, (*value).clone())?;
    }
    let seed = change.seed;
    let configured = RecipeStage::ALL.map(RecipeStage::name);
    let pose = changed.contains_key("pose").then_some("pose");
    for table in configured.into_iter().chain(pose) {
        let seed = Value::Integer(i64::try_from(seed)?);
        set(&mut changed, &format!("{table}.loop.seed"), seed)?;
    }
    let mut recipe = Recipe::from_toml(&toml::to_string(&changed)?, recipe_base)?;
    let stages = change.stages.clone();
    // The name is derived from the recipe with all defaults, so that it changes when a default changes.
    let printed: Table = recipe.to_toml()?.parse()?;
    let all: Vec<String> = recipe
        .data
        .iter()
        .map(|data| data.display().to_string())
        .collect();
    let mut depends_on = format!(
        "{}, simulations of a motion: {}",
        all.join(", "),
        recipe.simulations_per_motion
    );
    if let Some(start) = &recipe.start {
        write!(depends_on, ", start: {}", start.display())?;
    }
    // Folders may get other content under the same name.
    let mut inputs = recipe.outside_inputs()?;
    let sentences = inputs.remove("sentences");
    write!(depends_on, ", content: {inputs:?}")?;
    let mut id = String::new();
    for &stage in &stages {
        if stage == RecipeStage::Pretrain && recipe.disturbed_copies > 0 {
            write!(
                depends_on,
                ", disturbed copies: {}",
                recipe.disturbed_copies
            )?;
        }
        if let (RecipeStage::Pretrain, Some(sentences)) = (stage, &sentences) {
            write!(depends_on, ", sentences: {sentences}")?;
        }
        let part = printed.get(stage.name()).map(ToString::to_string);
        write!(
            depends_on,
            "\n[{}] {}",
            stage.name(),
            part.unwrap_or_default()
        )?;
        id = format!(
            "{}-{seed}-{:016x}",
            stage.name(),
            fnv_1a(depends_on.as_bytes())
        );
        recipe.stage_folders.insert(stage.name(), out.join(&id));
    }
    recipe.out = out.join(format!("model-{id}"));
    let data = recipe
        .data
        .first()
        .cloned()
        .ok_or_else(|| CliError::new("data: names no data set"))?;
    Ok(Run {
        recipe,
        data,
        stages,
        id,
    })
}

/// Removes a dotted key.
fn unset(table: &mut Table, key: &str) -> CliResult {
    let found = match key.split_once('.') {
        None => table.remove(key).is_some(),
        Some((first, rest)) => match table.get_mut(first).and_then(Value::as_table_mut) {
            Some(inner) => return unset(inner, rest),
            None => false,
        },
    };
    match found {
        true => Ok(()),
        false => Err(CliError::new(format!(
            "unset: the recipe has no key `{key}`"
        ))),
    }
}

/// Sets a dotted key; missing parent tables are created.
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

/// Trains all stages that are missing, `jobs` at the same time.
pub(crate) fn train_all(unique: &BTreeMap<&str, &Run>, jobs: usize, stop: &StopToken) -> CliResult {
    for group in RecipeStage::GROUPS {
        // One job per folder: rows that share a stage train it once.
        let jobs_of_group: BTreeMap<PathBuf, (RecipeStage, &Run)> = group
            .iter()
            .flat_map(|stage| unique.values().map(|run| (*stage, *run)))
            .filter(|(stage, run)| run.stages.contains(stage) && !run.recipe.is_finished(*stage))
            .map(|(stage, run)| (run.recipe.stage_dir(stage), (stage, run)))
            .collect();
        side_by_side(
            jobs,
            jobs_of_group.into_iter().collect(),
            |(folder, (stage, run))| {
                if stop.is_stopped() {
                    return Ok(());
                }
                note!("{}: {}", stage.name(), folder.display());
                if !run.recipe.run(stage, true)? {
                    note!("{}: stopped early", folder.display());
                }
                Ok(())
            },
        )?;
        end_if_stopped(stop);
    }
    Ok(())
}

/// Ends the program after Ctrl-C.
pub(crate) fn end_if_stopped(stop: &StopToken) {
    if stop.is_stopped() {
        output::print_line("stopped early; the same command continues from here");
        interrupt::exit();
    }
}

/// Runs `jobs`, `n` at a time, and divides the cores equally among them. After the first error, no further job is
/// started.
pub(crate) fn side_by_side<J: Send>(
    n: usize,
    jobs: Vec<J>,
    work: impl Fn(J) -> CliResult + Sync,
) -> CliResult {
    let n = n.max(1);
    let threads_each = (threads::threads(None) / n).max(1);
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
                    let result = threads::on_threads(Some(threads_each), || work(job));
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

pub(crate) fn print_plan(unique: &BTreeMap<&str, &Run>) -> CliResult {
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Folders of the stages of a recipe with changed values.
    fn folders(set: &[(&str, Value)]) -> BTreeMap<&'static str, PathBuf> {
        folders_in(Path::new("base"), set)
    }

    /// The same of a recipe in a folder.
    fn folders_in(base: &Path, set: &[(&str, Value)]) -> BTreeMap<&'static str, PathBuf> {
        let set: Vec<(String, Value)> = (set.iter())
            .map(|(key, value)| ((*key).into(), value.clone()))
            .collect();
        let change = Change {
            set: set.iter().map(|(key, value)| (key, value)).collect(),
            unset: &[],
            seed: 1,
            stages: RecipeStage::ALL.to_vec(),
        };
        let recipe = "data = \"data\"\nout = \"out\"".parse().unwrap();
        let run = plan_run(&change, &recipe, base, Path::new("out")).unwrap();
        run.recipe.stage_folders
    }

    #[test]
    fn data_of_other_content_in_the_same_folder_have_other_trainings() {
        let base = tempfile::tempdir().unwrap();
        let data = base.path().join("data");
        let absent = folders_in(base.path(), &[]);
        std::fs::create_dir(&data).unwrap();
        let built = |blake3: &str| {
            let manifest = serde_json::json!({
                "schema_version": 2, "name": "d", "tool_version": "0", "radar": "awr1843boost",
                "frame_rate_hz": 10.0, "seed": 1, "config_blake3": "c", "config_toml": "",
                "licences": [], "n_clips": 1, "n_failed": 0,
                "shards": [{
                    "file": "data/train-00000-of-00001.parquet", "split": "train", "rows": 1,
                    "bytes": 1, "blake3": blake3, "ids": ["a#0"], "failed": [],
                }],
            });
            std::fs::write(data.join("manifest.json"), manifest.to_string()).unwrap();
            folders_in(base.path(), &[])
        };
        let first = built("0a");
        assert_eq!(built("0a"), first);
        for other in [absent, built("0b")] {
            assert!(first.iter().all(|(stage, folder)| other[stage] != *folder));
        }
        std::fs::write(data.join("manifest.json"), "{").unwrap();
        let change = Change {
            set: Vec::new(),
            unset: &[],
            seed: 1,
            stages: RecipeStage::ALL.to_vec(),
        };
        let recipe = "data = \"data\"".parse().unwrap();
        let Err(error) = plan_run(&change, &recipe, base.path(), Path::new("out")) else {
            panic!("a damaged manifest was taken");
        };
        assert!(error.cause.contains("manifest.json"), "{}", error.cause);
    }

    #[test]
    fn a_stage_has_a_folder_of_its_own_for_everything_that_it_depends_on() {
        let plain = folders(&[]);
        let count = |set: &[(&str, Value)]| {
            let changed = folders(set);
            assert_eq!(changed.len(), 4);
            plain
                .iter()
                .filter(|(name, dir)| changed[*name] != **dir)
                .count()
        };
        assert_eq!(count(&[]), 0);
        // Of motion, tokenizer, pretraining and instruction tuning:
        let one = || Value::Integer(1);
        assert_eq!(count(&[("simulations_per_motion", one())]), 4);
        assert_eq!(count(&[("data", "other".into())]), 4);
        assert_eq!(count(&[("start", "other".into())]), 4);
        assert_eq!(count(&[("tokenizer.loop.max_steps", one())]), 3);
        assert_eq!(count(&[("disturbed_copies", one())]), 2);
        assert_eq!(count(&[("pretrain.loop.max_steps", one())]), 2);
        assert_eq!(count(&[("instruct.loop.max_steps", one())]), 1);
        assert_eq!(count(&[("out", "other".into())]), 0);
    }
}
