//! Trains and describes what is missing of a comparison, and writes its table.
//!
//! | name | contents |
//! |---|---|
//! | `captions/ROW.jsonl` | `{"id", "text"}` of every clip, as `radarllm score` reads it |
//! | `references.jsonl` | `{"id", "texts"}` of every clip |
//! | `captions/ROW.json` | inputs of these captions and their cost; written after them |
//! | `pose.json` | errors of the estimated bodies |
//! | `table.json`, `table.md` | the comparison |

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use radarllm::Model;
use radarllm_base::hash::fnv_1a;
use radarllm_dataset::{BuildOptions, ClipRecord, Columns, Dataset, Overwrite, Split};
use radarllm_eval::{
    captions::one_of_each_motion,
    comparison::{
        Compared, ComparisonConfig, ComparisonReport, ComparisonRow, Cost, Embedded, RowCaptions,
        RowKind, compare, markdown,
    },
    pose_table::{self, pose_table},
};
use radarllm_files::bounded::{self as files, MAX_CONFIG_BYTES};
use radarllm_nn::pose::PoseEstimator;
use radarllm_synth::DatasetPlan;
use radarllm_train::{inputs::data_hash, lm::CodeSource, recipe::RecipeStage};
use serde::{Deserialize, Serialize};
use toml::Table;

use super::{
    RunArgs,
    captions::{self, Read},
};
use crate::{
    commands::{
        dataset,
        eval::captions::adder,
        trainings::{self, Change, Run, end_if_stopped, plan_run, train_all},
    },
    error::{CliError, CliResult},
    interrupt, model,
    model_args::DecoderName,
    output, threads,
};

/// Most bytes of a file of captions.
const MAX_CAPTIONS_BYTES: u64 = 64 << 20;

/// A caption of a clip.
#[derive(Serialize, Deserialize)]
pub(super) struct Line {
    pub id: String,
    pub text: String,
}

/// The references of a clip.
#[derive(Serialize)]
struct ReferenceLine<'a> {
    id: &'a str,
    texts: &'a [String],
}

/// `captions/ROW.json`.
#[derive(Serialize, Deserialize, PartialEq)]
struct Head {
    /// The row.
    name: String,
    /// All inputs of the captions.
    inputs: String,
    /// What the system costs.
    cost: Cost,
}

/// Runs the command.
pub(super) fn run(args: &RunArgs) -> CliResult {
    let base = args.config.parent().unwrap_or(Path::new(""));
    let text = files::read_text(&args.config, MAX_CONFIG_BYTES)?;
    let mut config = ComparisonConfig::from_toml(&text).map_err(|e| {
        CliError::new(format!("{}: {e}", args.config.display()))
            .hint("see docs/guides/baselines.md")
    })?;
    config.out = base.join(&config.out);
    let unknown = |name: &&String| !config.rows.iter().any(|row| row.name == name.as_str());
    if let Some(name) = args.only.iter().find(unknown) {
        let names: Vec<&str> = config.rows.iter().map(|row| row.name.as_str()).collect();
        let hint = format!("rows are {}", names.join(", "));
        return Err(CliError::new(format!("--only {name}: no row of this name")).hint(hint));
    }
    let wanted = |row: &ComparisonRow| {
        args.only.is_empty() || args.only.contains(&row.name) || row.name == config.rows[0].name
    };
    check_files(&config)?;
    let mut planned = Planned::new(&config, base, &wanted)?;
    if args.plan {
        return planned.print(&config, base, &wanted);
    }
    let stop = interrupt::stop_on_ctrl_c()?;
    if let Some(data) = &config.data {
        build_data(&base.join(data), &planned.data)?;
        // The content of the data set is a part of the names of the trainings' folders.
        planned = Planned::new(&config, base, &wanted)?;
    }
    for run in planned.all_mut() {
        run.recipe.stop = stop.clone();
    }
    train_all(&planned.unique(), args.jobs, &stop)?;
    end_if_stopped(&stop);

    let data = Dataset::open(&planned.data)?;
    let read = |split: Split| -> CliResult<Vec<ClipRecord>> {
        Ok(data
            .iter_split(split, Columns::All)
            .collect::<Result<_, _>>()?)
    };
    let clips = one_of_each_motion(read(config.split)?);
    let train = read(Split::Train)?;
    if clips.is_empty() || train.is_empty() {
        return Err(CliError::new(format!(
            "{}: no clips in split `{}` or `train`",
            planned.data.display(),
            config.split
        )));
    }
    let references = clips.iter().map(|clip| ReferenceLine {
        id: &clip.id,
        texts: &clip.captions,
    });
    let references = output::json_lines(references)?;
    output::write_atomic(&config.out.join("references.jsonl"), references.as_bytes())?;
    let about_data = planned.about_data(&config)?;
    let mut all: Vec<RowCaptions> = Vec::with_capacity(config.rows.len());
    for (index, row) in config.rows.iter().enumerate() {
        let captions = match wanted(row) {
            false => left_out(),
            true => {
                note!("{}", row.name);
                let ours = all.first().and_then(|ours| ours.texts.as_ref().ok());
                let ours = ours.map_or(&[][..], Vec::as_slice);
                planned.captions(&config, base, index, &about_data, &clips, &train, ours)?
            }
        };
        all.push(captions);
        end_if_stopped(&stop);
    }
    let compared = Compared {
        data: &data.manifest().name,
        clips: &clips,
        train: &train,
        embedded: planned.embedded(&config, &clips, &all)?,
    };
    let adding = adder(&args.encoders, config.seed)?;
    let report = compare(&config, &compared, &all, adding.as_ref())?;
    let mut text = markdown(&report);
    if let Some(pose) = &planned.pose {
        text += "\n";
        text += &planned.pose_errors(&config, pose, &about_data, &compared)?;
    }
    write(&config.out, &report, &text)?;
    if args.json {
        return output::print_json(&report);
    }
    output::print_line(text.trim_end());
    Ok(())
}

fn write(out: &Path, report: &ComparisonReport, text: &str) -> CliResult {
    let json = serde_json::to_string_pretty(report)?;
    output::write_atomic(&out.join("table.json"), json.as_bytes())?;
    output::write_atomic(&out.join("table.md"), text.as_bytes())
}

fn left_out() -> RowCaptions {
    RowCaptions {
        texts: Err("left out by --only".into()),
        cost: Cost::default(),
    }
}

/// The trainings of a comparison.
struct Planned {
    /// One for each row that needs a training.
    runs: Vec<Option<Run>>,
    /// The pose network, if a row reads what it estimates.
    pose: Option<Run>,
    data: PathBuf,
}

impl Planned {
    fn new(
        config: &ComparisonConfig,
        base: &Path,
        wanted: &dyn Fn(&ComparisonRow) -> bool,
    ) -> CliResult<Self> {
        let path = base.join(&config.base);
        let recipe = trainings::read_recipe(&path)?;
        let recipe_base = path.parent().unwrap_or(Path::new(""));
        let mut runs = Vec::with_capacity(config.rows.len());
        for row in &config.rows {
            let run = match row.kind.is_trained() && wanted(row) {
                false => None,
                true => Some(
                    plan_row(config, row, &recipe, recipe_base)
                        .map_err(|e| CliError::new(format!("row `{}`: {}", row.name, e.cause)))?,
                ),
            };
            runs.push(run);
        }
        let reads_poses = |row: &ComparisonRow| row.kind == RowKind::EstimatedMotion && wanted(row);
        let pose = match config.rows.iter().any(reads_poses) {
            false => None,
            true => {
                let change = Change {
                    set: config.common.iter().collect(),
                    unset: &[],
                    seed: config.seed,
                    stages: vec![RecipeStage::Motion, RecipeStage::Pose],
                };
                let run = plan_run(&change, &recipe, recipe_base, &config.out)?;
                if run.recipe.pose.is_none() {
                    let problem = format!("{}: no table [pose]", path.display());
                    return Err(CliError::new(problem).hint("rows of estimated motion need it"));
                }
                Some(run)
            }
        };
        let data = match runs.iter().flatten().next() {
            Some(run) => run.data.clone(),
            // Nothing is trained.
            None => {
                let change = Change {
                    set: config.common.iter().collect(),
                    unset: &[],
                    seed: config.seed,
                    stages: Vec::new(),
                };
                plan_run(&change, &recipe, recipe_base, &config.out)?.data
            }
        };
        if let Some(other) = runs.iter().flatten().find(|run| run.data != data) {
            return Err(CliError::new(format!(
                "rows on the data sets {} and {}: all rows of a table describe the same clips",
                data.display(),
                other.data.display()
            )));
        }
        Ok(Self { runs, pose, data })
    }

    fn all(&self) -> impl Iterator<Item = &Run> {
        self.runs.iter().flatten().chain(&self.pose)
    }

    fn all_mut(&mut self) -> impl Iterator<Item = &mut Run> {
        self.runs.iter_mut().flatten().chain(&mut self.pose)
    }

    fn unique(&self) -> BTreeMap<&str, &Run> {
        self.all().map(|run| (run.id.as_str(), run)).collect()
    }

    /// Prints finished and missing stages and captions.
    fn print(
        &self,
        config: &ComparisonConfig,
        base: &Path,
        wanted: &dyn Fn(&ComparisonRow) -> bool,
    ) -> CliResult {
        trainings::print_plan(&self.unique())?;
        let about_data = self.about_data(config)?;
        // Captions of the first row, which another row shuffles.
        let mut ours: Option<Vec<String>> = None;
        for (index, row) in config.rows.iter().enumerate() {
            let is_done = match (row.kind, &row.captions) {
                (RowKind::NotRun, _) => None,
                _ if !wanted(row) => None,
                (RowKind::Answers, Some(path)) => Some(base.join(path).is_file()),
                (RowKind::Shuffled, _) if ours.is_none() => Some(false),
                _ => {
                    let model = open_model(row, base)?;
                    let first = ours.as_deref().unwrap_or_default();
                    let inputs = self.inputs(row, index, &about_data, model.as_ref(), first)?;
                    let done = done_captions(config, row, &inputs)?;
                    let is_done = done.is_some();
                    if index == 0 {
                        let texts = |line: Line| line.text;
                        ours = done.map(|(lines, _)| lines.into_iter().map(texts).collect());
                    }
                    Some(is_done)
                }
            };
            let state = match is_done {
                None => "no   ",
                Some(true) => "done ",
                Some(false) => "to do",
            };
            output::print_line(&format!("{state}  captions: {}", row.name));
        }
        Ok(())
    }

    /// The clips that are described, by their content, and the seed.
    fn about_data(&self, config: &ComparisonConfig) -> CliResult<String> {
        let hash = data_hash(&self.data)?;
        Ok(format!("{hash} {} {}", config.split, config.seed))
    }

    /// The training of a row.
    fn run_of(&self, index: usize) -> Option<&Run> {
        self.runs.get(index).and_then(Option::as_ref)
    }

    /// The pose network, if the row reads what it estimates.
    fn pose_of(&self, row: &ComparisonRow) -> Option<&Run> {
        let pose = self.pose.as_ref();
        pose.filter(|_| row.kind == RowKind::EstimatedMotion)
    }

    /// All inputs of the captions of a row.
    fn inputs(
        &self,
        row: &ComparisonRow,
        index: usize,
        about_data: &str,
        model: Option<&Model>,
        ours: &[String],
    ) -> CliResult<String> {
        let mut inputs = format!("{:?} {about_data}", row.kind);
        for run in self.run_of(index).into_iter().chain(self.pose_of(row)) {
            inputs += &format!(" {}", run.id);
        }
        if let Some(model) = model {
            inputs += &format!(" {}", model.fingerprint()?.hash);
        }
        if row.kind == RowKind::Shuffled {
            inputs += &format!(" {:016x}", fnv_1a(ours.join("\n").as_bytes()));
        }
        Ok(inputs)
    }

    /// Captions of a row: those of an earlier run if they have the same inputs.
    #[expect(clippy::too_many_arguments, reason = "all of it decides the captions")]
    fn captions(
        &self,
        config: &ComparisonConfig,
        base: &Path,
        index: usize,
        about_data: &str,
        clips: &[ClipRecord],
        train: &[ClipRecord],
        ours: &[String],
    ) -> CliResult<RowCaptions> {
        let row = &config.rows[index];
        if row.kind == RowKind::NotRun {
            let reason = row.reason.clone().unwrap_or_default();
            return Ok(RowCaptions {
                texts: Err(reason),
                cost: Cost::default(),
            });
        }
        if let (RowKind::Answers, Some(path)) = (row.kind, &row.captions) {
            return captions::of_answers(&base.join(path), row.reason.as_deref(), clips);
        }
        let model = open_model(row, base)?;
        let inputs = self.inputs(row, index, about_data, model.as_ref(), ours)?;
        let [lines_path, head_path] = caption_files(&config.out, &row.name);
        if let Some((lines, cost)) = done_captions(config, row, &inputs)? {
            return Ok(RowCaptions {
                texts: Ok(in_order(&lines_path, lines, clips)?),
                cost,
            });
        }
        let (run, pose) = (self.run_of(index), self.pose_of(row));
        let found = match (row.kind, run, &model) {
            (_, _, Some(model)) => captions::of_model(model, clips)?,
            (RowKind::Radar, Some(run), _) => captions::of_radar(run, clips)?,
            (RowKind::TrueMotion, Some(run), _) => {
                captions::of_codes(run, Read::TrueMotion, clips)?
            }
            (RowKind::Pictures, Some(run), _) => captions::of_codes(run, Read::Pictures, clips)?,
            (RowKind::EstimatedMotion, Some(run), _) => {
                let pose = pose.ok_or_else(|| CliError::new("no pose network was planned"))?;
                captions::of_codes(run, Read::EstimatedMotion(pose), clips)?
            }
            (kind, ..) => captions::of_floor(kind, clips, train, ours, config.seed)?,
        };
        if let Ok(texts) = &found.texts {
            let lines = clips.iter().zip(texts).map(|(clip, text)| Line {
                id: clip.id.clone(),
                text: text.clone(),
            });
            // The head comes last: captions without it are not taken for done.
            let _ = std::fs::remove_file(&head_path);
            output::write_atomic(&lines_path, output::json_lines(lines)?.as_bytes())?;
            let head = Head {
                name: row.name.clone(),
                inputs,
                cost: found.cost,
            };
            output::write_atomic(&head_path, serde_json::to_string_pretty(&head)?.as_bytes())?;
        }
        Ok(found)
    }

    /// Motions and captions, embedded by the first language model on true motions that read tokens; none without one.
    fn embedded(
        &self,
        config: &ComparisonConfig,
        clips: &[ClipRecord],
        captions: &[RowCaptions],
    ) -> CliResult<Option<Embedded>> {
        let is_judge = |(row, run): &(&ComparisonRow, &Run)| {
            let lm = &run.recipe.pretrain;
            row.kind == RowKind::TrueMotion && !lm.projected && lm.contrastive_weight > 0.0
        };
        let rows = config.rows.iter().zip(&self.runs);
        let mut trained = rows.filter_map(|(row, run)| Some((row, run.as_ref()?)));
        match trained.find(is_judge) {
            None => Ok(None),
            Some((row, run)) => captions::embedded(&row.name, run, clips, captions).map(Some),
        }
    }

    /// The errors of the estimated bodies as Markdown; `pose.json` is written.
    fn pose_errors(
        &self,
        config: &ComparisonConfig,
        pose: &Run,
        about_data: &str,
        compared: &Compared,
    ) -> CliResult<String> {
        let estimator = PoseEstimator::load(&pose.recipe.result(RecipeStage::Pose)?)?;
        let mut motions = Vec::with_capacity(compared.clips.len());
        for clip in compared.clips {
            let motion = estimator.estimate(&clip.frames, clip.radar_height_m);
            motions.push(motion.map_err(|e| CliError::new(format!("clip {}: {e}", clip.id)))?);
        }
        let table = pose_table(
            compared.data,
            config.split.name(),
            compared.clips,
            compared.train,
            &motions,
            config.seed,
        )?;
        let json =
            serde_json::json!({ "inputs": format!("{about_data} {}", pose.id), "table": table });
        let json = serde_json::to_string_pretty(&json)?;
        output::write_atomic(&config.out.join("pose.json"), json.as_bytes())?;
        Ok(pose_table::markdown(&table))
    }
}

/// Builds the data set that a comparison configures.
fn build_data(config: &Path, folder: &Path) -> CliResult {
    let plan = DatasetPlan::open(config)?;
    let options = BuildOptions {
        threads: threads::threads(None),
        overwrite: Overwrite::Refuse,
        retry_failed: false,
    };
    dataset::build_quietly(&plan, folder, options)
}

/// The finished model that a row names.
fn open_model(row: &ComparisonRow, base: &Path) -> CliResult<Option<Model>> {
    let Some(model) = &row.model else {
        return Ok(None);
    };
    let folder = base.join(model);
    let folder = if folder.is_dir() { &folder } else { model };
    model::open(Some(folder), DecoderName::F32).map(Some)
}

/// The captions of an earlier run with the same inputs, and their cost.
fn done_captions(
    config: &ComparisonConfig,
    row: &ComparisonRow,
    inputs: &str,
) -> CliResult<Option<(Vec<Line>, Cost)>> {
    let [lines_path, head_path] = caption_files(&config.out, &row.name);
    match read_head(&head_path) {
        Some(head) if head.inputs == inputs && lines_path.is_file() => {
            Ok(Some((read_lines(&lines_path)?, head.cost)))
        }
        _ => Ok(None),
    }
}

/// Refuses rows whose captions would be written to the same file.
fn check_files(config: &ComparisonConfig) -> CliResult {
    let mut names = BTreeMap::new();
    for row in &config.rows {
        let [lines, _] = caption_files(&config.out, &row.name);
        if let Some(other) = names.insert(lines.clone(), &row.name) {
            let problem = format!(
                "rows `{other}` and `{}`: the captions of both are {}",
                row.name,
                lines.display()
            );
            return Err(
                CliError::new(problem).hint("give them names that differ in letters or digits")
            );
        }
    }
    Ok(())
}

/// The training of a row.
fn plan_row(
    config: &ComparisonConfig,
    row: &ComparisonRow,
    recipe: &Table,
    recipe_base: &Path,
) -> CliResult<Run> {
    let with = |stages: &[RecipeStage]| {
        let change = Change {
            set: config.common.iter().chain(&row.set).collect(),
            unset: &row.unset,
            seed: config.seed,
            stages: stages.to_vec(),
        };
        plan_run(&change, recipe, recipe_base, &config.out)
    };
    use RecipeStage::{Instruct, Motion, Pose, PoseFirstHalf, PoseSecondHalf, Pretrain, Tokenizer};
    let run = with(&[Motion, Pretrain, Instruct])?;
    match (row.kind, run.recipe.pretrain.codes) {
        (RowKind::Pictures, CodeSource::Pictures) => with(&[Pretrain, Instruct]),
        (RowKind::Pictures, _) | (_, CodeSource::Pictures) => Err(CliError::new(
            "kind = \"pictures\" and `pretrain.codes` = \"pictures\" go together",
        )),
        (RowKind::Radar, CodeSource::Radar) => with(&[Motion, Tokenizer, Pretrain, Instruct]),
        (RowKind::Radar, _) => Err(CliError::new(
            "kind = \"radar\" reads radar codes, and `pretrain.codes` are those of motions",
        )),
        (_, CodeSource::Radar) => Err(CliError::new(
            "its language model reads motions: set `pretrain.codes` to \"motion\" or \"estimated_motion\"",
        )),
        (_, CodeSource::Motion) => Ok(run),
        (_, CodeSource::EstimatedMotion) => with(&[
            Motion,
            Pose,
            PoseFirstHalf,
            PoseSecondHalf,
            Pretrain,
            Instruct,
        ]),
    }
}

/// Files of the captions of a row: the captions, and the head.
fn caption_files(out: &Path, name: &str) -> [PathBuf; 2] {
    let plain = |c: char| {
        if c.is_ascii_alphanumeric() {
            c.to_ascii_lowercase()
        } else {
            '-'
        }
    };
    let mut stem = String::new();
    for c in name.chars().map(plain) {
        if c != '-' || !(stem.is_empty() || stem.ends_with('-')) {
            stem.push(c);
        }
    }
    let stem = stem.trim_end_matches('-');
    let folder = out.join("captions");
    [".jsonl", ".json"].map(|end| folder.join(format!("{stem}{end}")))
}

/// The head of captions; `None` if there is none that can be read.
fn read_head(path: &Path) -> Option<Head> {
    let bytes = files::read_bytes(path, MAX_CONFIG_BYTES).ok()?;
    serde_json::from_slice(&bytes).ok()
}

/// The lines of a file of captions.
pub(super) fn read_lines(path: &Path) -> CliResult<Vec<Line>> {
    let text = files::read_text(path, MAX_CAPTIONS_BYTES)?;
    let lines = text
        .lines()
        .enumerate()
        .filter(|(_, line)| !line.trim().is_empty());
    lines
        .map(|(number, line)| {
            serde_json::from_str(line).map_err(|e| {
                let place = format!("{}, line {}: {e}", path.display(), number + 1);
                CliError::new(place).hint("expected {\"id\": \"...\", \"text\": \"...\"}")
            })
        })
        .collect()
}

/// The texts of captions in the order of the clips.
pub(super) fn in_order(
    path: &Path,
    lines: Vec<Line>,
    clips: &[ClipRecord],
) -> CliResult<Vec<String>> {
    let mut by_id = BTreeMap::new();
    for line in lines {
        if by_id.insert(line.id.clone(), line.text).is_some() {
            let problem = format!("{}: clip {} occurs twice", path.display(), line.id);
            return Err(CliError::new(problem));
        }
    }
    let texts: Vec<String> = clips
        .iter()
        .map(|clip| {
            by_id.remove(&clip.id).ok_or_else(|| {
                CliError::new(format!(
                    "{}: no caption of clip {}",
                    path.display(),
                    clip.id
                ))
            })
        })
        .collect::<CliResult<_>>()?;
    match by_id.into_keys().next() {
        Some(id) => Err(CliError::new(format!(
            "{}: clip {id} is none of those that are described",
            path.display()
        ))),
        None => Ok(texts),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_rows_become_names_of_files() {
        let [lines, head] = caption_files(Path::new("o"), "MotionGPT-like (true motion)");
        assert_eq!(
            lines,
            Path::new("o/captions/motiongpt-like-true-motion.jsonl")
        );
        assert_eq!(
            head,
            Path::new("o/captions/motiongpt-like-true-motion.json")
        );
    }
}
