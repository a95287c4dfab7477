//! All stages of the training of a model, in order, configured by one TOML file.
//!
//! `motion -> tokenizer -> pretrain -> instruct`, and optionally `points` after the tokenizer. A comparison system that
//! describes motions (`pretrain.codes`) has `motion -> pose -> pretrain -> instruct` instead. Each stage reads the
//! results of earlier stages from the output folder of the recipe. The last stage writes `model/` (`tokenizer/` and
//! `lm/`), the folder that [`radarllm_inference::lm::Captioner::load`] opens.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

use radarllm_base::{
    PointFrame,
    disturb::{Pace, disturb},
    seed::derive_seed,
};
use radarllm_dataset::{ClipRecord, Columns, Dataset, Split};
use radarllm_inference::{
    FRAME_RATE_HZ,
    checkpoint::Checkpoint,
    tokenizer::{
        Encoded, FRAMES_PER_CODE, MAX_FRAMES, RadarTokenizer, context::context,
        points::tokenizer_hash,
    },
};
use radarllm_nn::{device::Processors, lm::RadarLm, pose::PoseEstimator};
use serde::{Deserialize, Serialize};

use crate::{
    evidence::{self, EvidenceTrainConfig},
    harness::{self, Ending, StopToken, TrainError},
    lm::{CodeSource, LmClip, LmTrainConfig, Motions, instruct, pretrain, pretrain_further},
    motion::{self, MotionTrainConfig},
    motion_codes::{MotionOf, half_of, motion_clips},
    pictures::picture_clips,
    points::{self, PointsTrainConfig},
    pose::{self, PoseTrainConfig},
    tokenizer::{self, TokenizerTrainConfig},
};

/// Stages, in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RecipeStage {
    /// The motion VQ-VAE, which supervises the tokenizer.
    Motion,
    /// The radar tokenizer.
    Tokenizer,
    /// Pretraining of the language model on three tasks.
    Pretrain,
    /// Instruction tuning of the language model.
    Instruct,
    /// The decoder of radar codes, which only generation needs.
    Points,
    /// The networks that read the points of a window as numbers, and weigh sentences where a model has them.
    Evidence,
    /// The pose network, of comparison systems.
    Pose,
    /// The pose network trained on the motions of one half, which estimates those of the other half.
    PoseFirstHalf,
    /// As [`Self::PoseFirstHalf`], with the halves exchanged.
    PoseSecondHalf,
}

impl RecipeStage {
    /// The stages of a model that describes, in order.
    pub const ALL: [Self; 4] = [
        Self::Motion,
        Self::Tokenizer,
        Self::Pretrain,
        Self::Instruct,
    ];

    /// All stages in groups: each stage depends on those of earlier groups alone.
    pub const GROUPS: [&[Self]; 4] = [
        &[Self::Motion],
        &[
            Self::Evidence,
            Self::Pose,
            Self::PoseFirstHalf,
            Self::PoseSecondHalf,
            Self::Tokenizer,
        ],
        &[Self::Points, Self::Pretrain],
        &[Self::Instruct],
    ];

    /// Whether the tokenizer of the model depends on this stage.
    fn shapes_tokenizer(self) -> bool {
        matches!(self, Self::Motion | Self::Tokenizer)
    }

    /// Name of the stage and of its folder.
    pub fn name(self) -> &'static str {
        match self {
            Self::Motion => "motion",
            Self::Tokenizer => "tokenizer",
            Self::Pretrain => "pretrain",
            Self::Instruct => "instruct",
            Self::Points => "points",
            Self::Evidence => "evidence",
            Self::Pose => "pose",
            Self::PoseFirstHalf => "pose_first_half",
            Self::PoseSecondHalf => "pose_second_half",
        }
    }
}

/// The values of all keys that a recipe does not set.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Preset {
    /// Networks of 2 million weights that two CPU cores train in an hour, with this project's additions to the paper.
    #[default]
    Small,
    /// Sizes, losses, batches, learning rates and epochs of the paper: 81 anchors, 512 codes of width 512, T5-small.
    Paper,
}

impl Preset {
    /// Name in recipes and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Small => "small",
            Self::Paper => "paper",
        }
    }
}

impl std::str::FromStr for Preset {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let all = [Self::Small, Self::Paper];
        let found = all.into_iter().find(|preset| preset.name() == text);
        found.ok_or_else(|| format!("`{text}`: expected small or paper"))
    }
}

/// A training configuration file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Recipe {
    /// Values of the keys that the file does not set.
    pub preset: Preset,
    /// Data set folder or folders, relative to the configuration file. Clips of one motion in several data sets are
    /// variants of each other: the same motion, measured by several radars.
    #[serde(with = "one_or_many")]
    pub data: Vec<PathBuf>,
    /// Folder for checkpoints, logs and the finished model, relative to the configuration file.
    pub out: PathBuf,
    /// Folder of a model (`tokenizer/` and `lm/`) with which the training goes on, relative to the configuration file: its
    /// tokenizer is kept, and [`RecipeStage::Pretrain`] continues with its language model and vocabulary.
    pub start: Option<PathBuf>,
    /// Number of simulations per training motion, the first ones; 0 uses all.
    pub simulations_per_motion: usize,
    /// Number of disturbed copies of every training clip from which the language model and the networks that weigh its
    /// sentences learn, beside the clip itself:
    /// [`radarllm_base::disturb`].
    pub disturbed_copies: usize,
    /// Processors for training: `"cpu"`, `"gpu"`, `"gpu:N"`, `"cuda"`, `"cuda:N"`, `"libtorch"`, `"libtorch:N"`,
    /// `"libtorch-cpu"`, or several of them, `"gpu:0,gpu:1"`.
    pub device: Processors,
    /// Settings of the motion VQ-VAE.
    pub motion: MotionTrainConfig,
    /// Settings of the radar tokenizer.
    pub tokenizer: TokenizerTrainConfig,
    /// Settings of the pretraining of the language model.
    pub pretrain: LmTrainConfig,
    /// Settings of instruction tuning.
    pub instruct: LmTrainConfig,
    /// Settings of the decoder of radar codes, with which `radarllm generate` makes points; none is trained if the table
    /// is absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub points: Option<PointsTrainConfig>,
    /// Settings of the networks that weigh sentences; none are trained if the table is absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub evidence: Option<EvidenceTrainConfig>,
    /// Settings of the pose network of comparison systems; none is trained if the table is absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pose: Option<PoseTrainConfig>,
    /// Stops a stage early; see [`StopToken`].
    #[serde(skip)]
    pub stop: StopToken,
    /// Folders of stages that are not in `out`, by the name of the stage. Runs that differ only in later stages can
    /// share the results of the earlier ones.
    #[serde(skip)]
    pub stage_folders: BTreeMap<&'static str, PathBuf>,
}

impl Default for Recipe {
    fn default() -> Self {
        Self {
            preset: Preset::Small,
            data: vec!["data".into()],
            out: "model".into(),
            start: None,
            simulations_per_motion: 0,
            disturbed_copies: 0,
            device: Processors::default(),
            motion: MotionTrainConfig::default(),
            tokenizer: TokenizerTrainConfig::default(),
            pretrain: LmTrainConfig::small(),
            instruct: LmTrainConfig::small().for_instruction(),
            points: None,
            evidence: None,
            pose: None,
            stop: StopToken::default(),
            stage_folders: BTreeMap::new(),
        }
    }
}

impl Recipe {
    /// The recipe of a preset.
    pub fn of(preset: Preset) -> Self {
        match preset {
            Preset::Small => Self::default(),
            Preset::Paper => Self {
                preset,
                motion: MotionTrainConfig::paper(),
                tokenizer: TokenizerTrainConfig::paper(),
                pretrain: LmTrainConfig::paper(),
                instruct: LmTrainConfig::paper_instruction(),
                ..Self::default()
            },
        }
    }

    /// Reads a recipe. Relative paths are resolved against `base`.
    ///
    /// # Errors
    /// TOML errors with their position; values out of range with their name.
    pub fn from_toml(text: &str, base: &Path) -> Result<Self, TrainError> {
        Self::from_toml_with(text, base, None)
    }

    /// As [`Self::from_toml`], with another preset than that of the file. Keys that the file sets keep their values.
    ///
    /// # Errors
    /// As [`Self::from_toml`].
    pub fn from_toml_with(
        text: &str,
        base: &Path,
        preset: Option<Preset>,
    ) -> Result<Self, TrainError> {
        let problem = |e: toml::de::Error| TrainError::Config {
            field: "file".into(),
            problem: e.to_string(),
        };
        // Also the recipes of other presets are read this way first, because only then do errors contain a position.
        let mut recipe: Self = toml::from_str(text).map_err(problem)?;
        let preset = preset.unwrap_or(recipe.preset);
        if preset != Preset::Small {
            let mut all = toml::Table::try_from(Self::of(preset))?;
            overlay(&mut all, toml::from_str(text).map_err(problem)?);
            recipe = all.try_into().map_err(problem)?;
        }
        recipe.preset = preset;
        let points = recipe.points.as_ref().map(PointsTrainConfig::validate);
        let evidence = recipe.evidence.as_ref().map(EvidenceTrainConfig::validate);
        let pose = recipe.pose.as_ref().map(PoseTrainConfig::validate);
        for (table, checked) in [
            ("motion", Some(recipe.motion.validate())),
            ("tokenizer", Some(recipe.tokenizer.validate())),
            ("pretrain", Some(recipe.pretrain.validate())),
            ("instruct", Some(recipe.instruct.validate())),
            ("points", points),
            ("evidence", evidence),
            ("pose", pose),
        ] {
            checked.unwrap_or(Ok(())).map_err(|e| e.in_table(table))?;
        }
        let problem = match recipe.pretrain.codes {
            CodeSource::Radar => None,
            _ if recipe.start.is_some() => {
                Some("of motions are no choice for a model that is trained further")
            }
            CodeSource::EstimatedMotion if recipe.pose.is_none() => {
                Some("of estimated motions need a table [pose]")
            }
            _ => None,
        };
        if let Some(problem) = problem {
            return Err(TrainError::Config {
                field: "pretrain.codes".into(),
                problem: problem.into(),
            });
        }
        // Instruction tuning continues with the network from pretraining.
        let tuned = &recipe.instruct;
        for (field, is_set) in [
            ("bypass", tuned.bypass.is_some()),
            ("codes", !tuned.codes.is_radar()),
            ("projected", tuned.projected),
            ("tie_embeddings", tuned.tie_embeddings.is_some()),
            ("dropout", tuned.dropout.is_some()),
            ("from", tuned.hf_folder.is_some()),
        ] {
            if is_set {
                return Err(TrainError::Config {
                    field: format!("instruct.{field}"),
                    problem: format!(
                        "shapes a new network, and tuning goes on with pretraining's: set `{field}` in [pretrain]"
                    ),
                });
            }
        }
        if !tuned.sentences.is_empty() {
            return Err(TrainError::Config {
                field: "instruct.sentences".into(),
                problem: "sentences are a task of pretraining: set `sentences` in [pretrain]"
                    .into(),
            });
        }
        if recipe.data.is_empty() {
            return Err(TrainError::Config {
                field: "data".into(),
                problem: "an empty list: name at least one data set".into(),
            });
        }
        for data in &mut recipe.data {
            *data = base.join(&data);
        }
        recipe.out = base.join(&recipe.out);
        recipe.start = recipe.start.map(|start| base.join(start));
        for lm in [&mut recipe.pretrain, &mut recipe.instruct] {
            lm.hf_folder = lm.hf_folder.take().map(|folder| base.join(folder));
            for path in &mut lm.sentences {
                *path = base.join(&path);
            }
        }
        Ok(recipe)
    }

    /// Returns the recipe with every default, as TOML.
    ///
    /// # Errors
    /// If a value cannot be expressed in TOML.
    pub fn to_toml(&self) -> Result<String, TrainError> {
        toml::to_string_pretty(self).map_err(TrainError::from)
    }

    /// Folder of a stage's log and checkpoints.
    pub fn stage_dir(&self, stage: RecipeStage) -> PathBuf {
        let elsewhere = self.stage_folders.get(stage.name());
        elsewhere.map_or_else(|| self.out.join(stage.name()), PathBuf::clone)
    }

    /// The stages of this recipe, in order: without motion and tokenizer if it goes on with a model, without tokenizer if the
    /// codes are those of motions, and with the decoder of radar codes, which needs the tokenizer only, and the pose network
    /// if these are configured.
    pub fn stages(&self) -> Vec<RecipeStage> {
        let codes = self.pretrain.codes;
        if codes == CodeSource::Pictures {
            return vec![RecipeStage::Pretrain, RecipeStage::Instruct];
        }
        if !codes.is_radar() {
            let mut stages = vec![RecipeStage::Motion];
            stages.extend(self.pose.as_ref().map(|_| RecipeStage::Pose));
            if codes == CodeSource::EstimatedMotion {
                stages.extend([RecipeStage::PoseFirstHalf, RecipeStage::PoseSecondHalf]);
            }
            stages.extend([RecipeStage::Pretrain, RecipeStage::Instruct]);
            return stages;
        }
        let has = |stage: &RecipeStage| self.start.is_none() || !stage.shapes_tokenizer();
        let mut stages: Vec<_> = RecipeStage::ALL.into_iter().filter(has).collect();
        if self.points.is_some() {
            let after = stages.iter().filter(|stage| stage.shapes_tokenizer());
            stages.insert(after.count(), RecipeStage::Points);
        }
        stages.extend(self.evidence.as_ref().map(|_| RecipeStage::Evidence));
        stages.extend(self.pose.as_ref().map(|_| RecipeStage::Pose));
        stages
    }

    /// Whether a stage has written a checkpoint for later stages: its best one, or its last one.
    pub fn is_finished(&self, stage: RecipeStage) -> bool {
        self.stage_dir(stage).join("final").is_dir()
    }

    /// Folder of the finished model.
    pub fn model_dir(&self) -> PathBuf {
        self.out.join("model")
    }

    /// Checks what the captions of the data sets show of later stages, before the first of `stages` is trained.
    ///
    /// # Errors
    /// Data that cannot be read, or from which a stage cannot learn.
    pub fn check_data(&self, stages: &[RecipeStage]) -> Result<(), TrainError> {
        match stages.contains(&RecipeStage::Evidence) {
            true => {
                let train = self.clips(Split::Train, Columns::Points)?;
                evidence::check_captions(&train, self.disturbed_copies)
            }
            false => Ok(()),
        }
    }

    /// Runs one stage. Returns `false` if [`Self::stop`] ended it early; it can then be continued with `resume`.
    ///
    /// # Errors
    /// If an earlier stage is missing, if the data are unusable, or if the stage fails.
    pub fn run(&self, stage: RecipeStage, resume: bool) -> Result<bool, TrainError> {
        let out = self.stage_dir(stage);
        let mut recipe = self.clone();
        let mut points = recipe.points.take().unwrap_or_default();
        let mut evidence = recipe.evidence.take().unwrap_or_default();
        let mut pose = recipe.pose.take().unwrap_or_default();
        if self.start.is_some() && stage.shapes_tokenizer() {
            return Err(TrainError::Config {
                field: "start".into(),
                problem: format!(
                    "keeps the tokenizer of a model, so there is no stage `{}`",
                    stage.name()
                ),
            });
        }
        let inputs = self.inputs(stage)?;
        for run in [
            &mut recipe.motion.run,
            &mut recipe.tokenizer.run,
            &mut recipe.pretrain.run,
            &mut recipe.instruct.run,
            &mut points.run,
            &mut evidence.run,
            &mut pose.run,
        ] {
            run.processors = self.device.clone();
            run.stop = self.stop.clone();
            run.inputs.clone_from(&inputs);
        }
        // A stage that was never started, or was stopped before its first checkpoint, starts from the beginning.
        let starts_afresh = resume && !harness::has_checkpoint(&out);
        if starts_afresh {
            harness::forget(&out)?;
        }
        let resume = resume && !starts_afresh;
        let ending = match stage {
            RecipeStage::Motion => {
                let train = self.clips(Split::Train, Columns::All)?;
                let val = self.clips(Split::Val, Columns::All)?;
                motion::train(&recipe.motion, &train, &val, &out, resume)?.ending
            }
            RecipeStage::Tokenizer => {
                let train = self.clips(Split::Train, Columns::All)?;
                let val = self.clips(Split::Val, Columns::All)?;
                let teacher = match self.tokenizer.loss.needs_teacher() {
                    true => Some(motion::load_teacher(&self.result(RecipeStage::Motion)?)?),
                    false => None,
                };
                tokenizer::train(
                    &recipe.tokenizer,
                    &train,
                    &val,
                    teacher.as_ref(),
                    &out,
                    resume,
                )?
                .ending
            }
            RecipeStage::Pretrain => {
                let (n_codes, train, val) = self.lm_data(self.pretrain.flip)?;
                match &self.start {
                    Some(start) => {
                        let (dir, device) = (start.join("lm"), harness::cpu_device());
                        let seed = recipe.pretrain.run.seed;
                        let lm = match recipe.pretrain.context {
                            true => RadarLm::load_with_context(&dir, seed, &device)?,
                            false => RadarLm::load(&dir, &device)?,
                        };
                        pretrain_further(&recipe.pretrain, lm, &train, &val, &out, resume)?
                    }
                    None => pretrain(&recipe.pretrain, n_codes, &train, &val, &out, resume)?,
                }
                .ending
            }
            RecipeStage::Instruct => {
                let start = self.result(RecipeStage::Pretrain)?;
                let lm = RadarLm::load(&start, &harness::cpu_device())?;
                let (_, train, val) = self.lm_data(self.instruct.flip)?;
                let ending = instruct(&recipe.instruct, lm, &train, &val, &out, resume)?.ending;
                if ending != Ending::Stopped {
                    self.assemble(RecipeStage::Instruct)?;
                }
                ending
            }
            RecipeStage::Points => {
                let start = Checkpoint::open(&self.result(RecipeStage::Tokenizer)?)?;
                let tokenizer = RadarTokenizer::from_checkpoint(&start)?;
                let train = self.clips(Split::Train, Columns::Points)?;
                let val = self.clips(Split::Val, Columns::Points)?;
                let hash = tokenizer_hash(&start)?;
                let ending =
                    points::train(&points, &tokenizer, &hash, &train, &val, &out, resume)?.ending;
                if ending != Ending::Stopped && self.model_dir().is_dir() {
                    self.add(RecipeStage::Points)?;
                }
                ending
            }
            RecipeStage::Evidence => {
                let train = self.clips(Split::Train, Columns::Points)?;
                let val = self.clips(Split::Val, Columns::Points)?;
                let ending =
                    evidence::train(&evidence, &train, self.disturbed_copies, &val, &out, resume)?
                        .ending;
                if ending != Ending::Stopped && self.model_dir().is_dir() {
                    self.add(RecipeStage::Evidence)?;
                }
                ending
            }
            RecipeStage::Pose | RecipeStage::PoseFirstHalf | RecipeStage::PoseSecondHalf => {
                let mut train = self.clips(Split::Train, Columns::All)?;
                let half = match stage {
                    RecipeStage::PoseFirstHalf => Some(0),
                    RecipeStage::PoseSecondHalf => Some(1),
                    _ => None,
                };
                if let Some(half) = half {
                    train.retain(|clip| half_of(&clip.motion_id) == half);
                }
                let val = self.clips(Split::Val, Columns::All)?;
                pose::train(&pose, &self.data_names()?, &train, &val, &out, resume)?.ending
            }
        };
        Ok(ending != Ending::Stopped)
    }

    /// Copies the tokenizer and the language model of the stage `lm` into the folder that inference opens.
    ///
    /// # Errors
    /// If a stage is missing or files cannot be copied.
    pub fn assemble(&self, lm: RecipeStage) -> Result<(), TrainError> {
        let codes = match self.pretrain.codes {
            CodeSource::Radar => Some((RecipeStage::Tokenizer, "tokenizer")),
            CodeSource::Motion | CodeSource::EstimatedMotion => {
                Some((RecipeStage::Motion, "motion"))
            }
            CodeSource::Pictures => None,
        };
        for (stage, name) in codes.into_iter().chain([(lm, "lm")]) {
            copy_files(&self.result(stage)?, &self.model_dir().join(name))?;
        }
        // A decoder of earlier codes would not fit this tokenizer.
        let _ = fs::remove_dir_all(self.model_dir().join(RecipeStage::Points.name()));
        let further = [RecipeStage::Points, RecipeStage::Evidence];
        let finished = further.into_iter().filter(|stage| self.is_finished(*stage));
        finished.into_iter().try_for_each(|stage| self.add(stage))
    }

    /// Copies what a model can have beside its members into the folder that inference opens.
    fn add(&self, stage: RecipeStage) -> Result<(), TrainError> {
        let from = self.result(stage)?;
        copy_files(&from, &self.model_dir().join(stage.name()))
    }

    /// Checkpoint of a finished stage: the best one by validation, or the last one.
    ///
    /// # Errors
    /// If the stage has written none.
    pub fn result(&self, stage: RecipeStage) -> Result<PathBuf, TrainError> {
        if let (Some(start), RecipeStage::Tokenizer) = (&self.start, stage) {
            return Ok(start.join("tokenizer"));
        }
        let out = self.stage_dir(stage);
        ["best", "final"]
            .iter()
            .map(|name| out.join(name))
            .find(|dir| dir.is_dir())
            .ok_or_else(|| TrainError::StageMissing {
                path: out.clone(),
                stage: stage.name(),
            })
    }

    fn clips(&self, split: Split, columns: Columns) -> Result<Vec<ClipRecord>, TrainError> {
        let mut clips = Vec::new();
        for dir in &self.data {
            let data = Dataset::open(dir)?;
            for clip in data.iter_split(split, columns) {
                clips.push(clip?);
            }
        }
        check_variants(&clips)?;
        if split == Split::Train && self.simulations_per_motion > 0 {
            keep_variants(&mut clips, self.simulations_per_motion);
        }
        Ok(clips)
    }

    /// Names of the data sets.
    fn data_names(&self) -> Result<Vec<String>, TrainError> {
        let name = |dir: &PathBuf| Ok(Dataset::open(dir)?.manifest().name.clone());
        self.data.iter().map(name).collect()
    }

    /// The number of codes, and the training and validation clips of the language model.
    fn lm_data(&self, flip: bool) -> Result<(usize, Vec<LmClip>, Vec<LmClip>), TrainError> {
        let codes = self.pretrain.codes;
        if codes == CodeSource::Pictures {
            let train = self.clips(Split::Train, Columns::Points)?;
            let val = self.clips(Split::Val, Columns::Points)?;
            return Ok((1, picture_clips(&train, flip), picture_clips(&val, false)));
        }
        if !codes.is_radar() {
            let teacher = motion::load_teacher(&self.result(RecipeStage::Motion)?)?;
            let estimator = |stage| Ok::<_, TrainError>(PoseEstimator::load(&self.result(stage)?)?);
            let (train, val) = match codes {
                CodeSource::EstimatedMotion => {
                    let whole = estimator(RecipeStage::Pose)?;
                    let first = estimator(RecipeStage::PoseFirstHalf)?;
                    let second = estimator(RecipeStage::PoseSecondHalf)?;
                    // Each half by the network that has not seen it, as the whole network has not seen the test split.
                    let train = self.clips(Split::Train, Columns::Points)?;
                    let crossed = MotionOf::Estimated([&second, &first]);
                    let train = motion_clips(&teacher, &train, &crossed, flip)?;
                    let val = self.clips(Split::Val, Columns::Points)?;
                    let of_val = MotionOf::Estimated([&whole, &whole]);
                    (train, motion_clips(&teacher, &val, &of_val, false)?)
                }
                _ => {
                    let train = self.clips(Split::Train, Columns::All)?;
                    let train = motion_clips(&teacher, &train, &MotionOf::Truth, flip)?;
                    let val = self.clips(Split::Val, Columns::All)?;
                    (
                        train,
                        motion_clips(&teacher, &val, &MotionOf::Truth, false)?,
                    )
                }
            };
            return Ok((teacher.n_codes(), train, val));
        }
        let dir = self.result(RecipeStage::Tokenizer)?;
        let tokenizer = RadarTokenizer::load(&dir)?;
        let clips = self.clips(Split::Train, Columns::Points)?;
        let train = lm_clips(&tokenizer, &clips, flip, self.disturbed_copies)?;
        let clips = self.clips(Split::Val, Columns::Points)?;
        let val = lm_clips(&tokenizer, &clips, false, 0)?;
        Ok((tokenizer.config().codebook_size, train, val))
    }
}

/// Replaces the values of `all` by those of `file`, key by key.
fn overlay(all: &mut toml::Table, file: toml::Table) {
    for (key, value) in file {
        match (all.get_mut(&key), value) {
            (Some(toml::Value::Table(all)), toml::Value::Table(file)) => overlay(all, file),
            (_, value) => {
                all.insert(key, value);
            }
        }
    }
}

/// A path, or a list of paths.
mod one_or_many {
    use std::path::PathBuf;

    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    #[derive(Deserialize)]
    #[serde(untagged, expecting = "a path or a list of paths")]
    enum Paths {
        One(PathBuf),
        Many(Vec<PathBuf>),
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(
        from: D,
    ) -> Result<Vec<PathBuf>, D::Error> {
        Ok(match Paths::deserialize(from)? {
            Paths::One(path) => vec![path],
            Paths::Many(paths) => paths,
        })
    }

    pub(super) fn serialize<S: Serializer>(paths: &[PathBuf], to: S) -> Result<S::Ok, S::Error> {
        match paths {
            [one] => one.serialize(to),
            many => many.serialize(to),
        }
    }
}

/// Checks that clips of one motion, which are variants of it even across data sets, have the same captions. If two data
/// sets used the same number for different motions, the captions of one would be trained with the radar data of the
/// other.
fn check_variants(clips: &[ClipRecord]) -> Result<(), TrainError> {
    let mut first: BTreeMap<&str, &ClipRecord> = BTreeMap::new();
    for clip in clips {
        let one = *first.entry(&clip.motion_id).or_insert(clip);
        if one.captions != clip.captions {
            let caption = |c: &ClipRecord| c.captions.first().cloned().unwrap_or_default();
            return Err(TrainError::Captions(format!(
                "motion {}: clip {} of radar {} says {:?}, clip {} of radar {} says {:?}; data sets that share ids \
                 must be made of the same motions by the same version of the program",
                clip.motion_id,
                one.id,
                one.radar,
                caption(one),
                clip.id,
                clip.radar,
                caption(clip),
            )));
        }
    }
    Ok(())
}

/// Keeps the first `n` clips of every motion.
fn keep_variants(clips: &mut Vec<ClipRecord>, n: usize) {
    let mut kept: BTreeMap<String, usize> = BTreeMap::new();
    clips.retain(|clip| {
        let kept = kept.entry(clip.motion_id.clone()).or_default();
        *kept += 1;
        *kept <= n
    });
}

/// Number of clips that are grouped and encoded at once.
const ENCODE_CLIPS: usize = 128;

/// Encodes clips and combines the variants of a motion; `flip` also encodes their mirror images. The first variants of a
/// motion are its clips, further ones are disturbed copies.
///
/// # Errors
/// If a clip cannot be encoded.
pub fn lm_clips(
    tokenizer: &RadarTokenizer,
    clips: &[ClipRecord],
    flip: bool,
    disturbed_copies: usize,
) -> Result<Vec<LmClip>, TrainError> {
    let points = |clip: &ClipRecord, copy: usize, mirrored: bool| {
        let mut frames = copy_of(clip, copy);
        if mirrored {
            frames.iter_mut().for_each(PointFrame::mirror);
        }
        frames
    };
    let encode = |copy: usize, mirrored: bool| {
        let mut encoded = Vec::with_capacity(clips.len());
        // Grouped clips need a hundred times as much memory as their codes, so only a few are processed at a time.
        for chunk in clips.chunks(ENCODE_CLIPS) {
            let points: Vec<Vec<PointFrame>> =
                chunk.iter().map(|c| points(c, copy, mirrored)).collect();
            let inputs: Vec<_> = points
                .iter()
                .zip(chunk)
                .map(|(f, c)| (f.as_slice(), c.radar_height_m))
                .collect();
            let codes = tokenizer.encode_batch(&inputs)?;
            encoded.extend(
                codes
                    .into_iter()
                    .zip(&points)
                    .map(|(codes, frames)| Encoded {
                        context: Some(context(frames)),
                        ..codes
                    }),
            );
        }
        Ok::<_, TrainError>(encoded)
    };
    let mut motions = Motions::default();
    for copy in 0..=disturbed_copies {
        let encoded = encode(copy, false)?;
        let mirrored = if flip {
            encode(copy, true)?
        } else {
            Vec::new()
        };
        for (index, (clip, codes)) in clips.iter().zip(encoded).enumerate() {
            let seconds = (codes.codes.len() * FRAMES_PER_CODE) as f32 / 10.0;
            motions.add(clip, seconds, codes, mirrored.get(index).cloned());
        }
    }
    Ok(motions.into_clips())
}

/// The frames of a clip, or of a disturbed copy of it from 1 on. A clip of which nothing would be left stays as it is.
pub(crate) fn copy_of(clip: &ClipRecord, copy: usize) -> Vec<PointFrame> {
    if copy == 0 {
        return clip.frames.clone();
    }
    let pace = Pace::UpTo {
        max_frames: MAX_FRAMES,
    };
    let seed = derive_seed(clip.seed, &format!("disturbed/{copy}"));
    let frames = disturb(&clip.frames, f64::from(FRAME_RATE_HZ), pace, seed);
    match frames.iter().all(|f| f.points.is_empty()) {
        true => clip.frames.clone(),
        false => frames,
    }
}

fn copy_files(from: &Path, to: &Path) -> Result<(), TrainError> {
    let io = |path: &Path| {
        let path = path.to_path_buf();
        move |source| TrainError::Io { path, source }
    };
    // An incomplete copy of a model must not be visible under the final name.
    let temporary = to.with_extension("tmp");
    let _ = fs::remove_dir_all(&temporary);
    fs::create_dir_all(&temporary).map_err(io(&temporary))?;
    for entry in fs::read_dir(from).map_err(io(from))? {
        let path = entry.map_err(io(from))?.path();
        if let (true, Some(name)) = (path.is_file(), path.file_name()) {
            fs::copy(&path, temporary.join(name)).map_err(io(&path))?;
        }
    }
    let _ = fs::remove_dir_all(to);
    fs::rename(&temporary, to).map_err(io(to))
}

#[cfg(test)]
mod tests {
    use radarllm_inference::lm::LmPreset;

    use super::*;

    #[test]
    fn the_printed_recipe_reads_back() {
        let recipe = Recipe::default();
        let text = recipe.to_toml().unwrap();
        assert_eq!(Recipe::from_toml(&text, Path::new("")).unwrap(), recipe);
    }

    #[test]
    fn presets_give_the_keys_that_a_recipe_does_not_set() {
        let read = |text: &str, preset| Recipe::from_toml_with(text, Path::new(""), preset);
        let text = "preset = \"paper\"\ndata = \"x\"\n[pretrain.loop]\nmax_steps = 7\n[tokenizer]\naugment = { flip = 0.5 }";
        let recipe = read(text, None).unwrap();
        let mut expected = Recipe::of(Preset::Paper);
        expected.data = vec!["x".into()];
        expected.pretrain.run.max_steps = 7;
        expected.tokenizer.augment.flip = 0.5;
        assert_eq!(recipe, expected);
        assert_eq!(recipe.tokenizer.model.n_anchors(), 81);
        let model = &recipe.tokenizer.model;
        assert_eq!((model.codebook_size, model.code_dim), (512, 512));
        assert_eq!(recipe.pretrain.preset, LmPreset::T5Small);
        assert_eq!(
            (recipe.pretrain.batch, recipe.pretrain.run.epochs),
            (16, 300)
        );
        assert_eq!(recipe.instruct.run.epochs, 100);
        // It reads back as it is printed, and the command line decides.
        let printed = recipe.to_toml().unwrap();
        assert_eq!(read(&printed, None).unwrap(), recipe);
        assert_eq!(read("data = \"x\"\n[pretrain.loop]\nmax_steps = 7\n[tokenizer]\naugment = { flip = 0.5 }", Some(Preset::Paper)).unwrap(), recipe);
        let small = read(text, Some(Preset::Small)).unwrap();
        assert_eq!(
            (small.preset, small.tokenizer.model.n_anchors()),
            (Preset::Small, 54)
        );
        assert_eq!(small.pretrain.run.max_steps, 7);
        let unknown = read("preset = \"huge\"", None).unwrap_err().to_string();
        assert!(
            unknown.contains("huge") && unknown.contains("paper"),
            "{unknown}"
        );
        let slip = read("preset = \"paper\"\n[pretrain]\nbach = 3", None)
            .unwrap_err()
            .to_string();
        assert!(slip.contains("bach") && slip.contains('3'), "{slip}");
        assert_eq!("paper".parse(), Ok(Preset::Paper));
        // Section "Implementation" of the paper: 3.5e-4, and 2e-4 for both stages of the language model.
        let rates = [
            recipe.tokenizer.run.learning_rate,
            recipe.pretrain.run.learning_rate,
            recipe.instruct.run.learning_rate,
        ];
        assert_eq!(rates, [3.5e-4, 2e-4, 2e-4]);
        assert!("big".parse::<Preset>().is_err());
    }

    #[test]
    fn a_recipe_names_one_data_set_or_several() {
        let data = |text: &str| Recipe::from_toml(text, Path::new("b")).map(|r| r.data);
        let path = |p: &str| Path::new("b").join(p);
        assert_eq!(data("data = \"x\"").unwrap(), [path("x")]);
        let two = Recipe::from_toml("data = [\"x\", \"y\"]", Path::new("b")).unwrap();
        assert_eq!(two.data, [path("x"), path("y")]);
        let again = Recipe::from_toml(&two.to_toml().unwrap(), Path::new("")).unwrap();
        assert_eq!(again.data, two.data);
        assert!(data("data = []").unwrap_err().to_string().contains("data"));
        assert!(
            data("data = 3")
                .unwrap_err()
                .to_string()
                .contains("list of paths")
        );
    }

    #[test]
    fn a_recipe_with_a_start_keeps_its_tokenizer() {
        let recipe = Recipe::from_toml("start = \"x\"", Path::new("b")).unwrap();
        assert_eq!(
            recipe.stages(),
            [RecipeStage::Pretrain, RecipeStage::Instruct]
        );
        assert_eq!(
            recipe.result(RecipeStage::Tokenizer).unwrap(),
            Path::new("b/x/tokenizer")
        );
        for stage in [RecipeStage::Motion, RecipeStage::Tokenizer] {
            let refused = recipe.run(stage, false).unwrap_err().to_string();
            assert!(refused.contains("start"), "{refused}");
        }
        assert_eq!(Recipe::default().stages(), RecipeStage::ALL);
    }

    #[test]
    fn variants_of_a_motion_say_the_same() {
        let clip = |variant: u32, radar: &str, caption: &str| ClipRecord {
            id: format!("walk-7#{variant}"),
            motion_id: "walk-7".into(),
            group: "walk-7".into(),
            split: Split::Train,
            action: "walk".into(),
            captions: vec![caption.into()],
            source: "procedural".into(),
            radar: radar.into(),
            radar_height_m: 1.0,
            seed: 1,
            frames: Vec::new(),
            motion_fps: 20.0,
            joints: Vec::new(),
            motion_features: Vec::new(),
            rotations6d: Vec::new(),
            body_height_m: 0.0,
        };
        let walks = "a person walks.";
        let mut two = vec![clip(0, "a", walks), clip(1, "b", walks)];
        check_variants(&two).unwrap();
        keep_variants(&mut two, 1);
        assert_eq!(two, [clip(0, "a", walks)]);
        let error = check_variants(&[clip(0, "a", walks), clip(1, "b", "a person sits.")]);
        let error = error.unwrap_err().to_string();
        for part in ["walk-7", "radar b", walks, "a person sits."] {
            assert!(error.contains(part), "{part}: {error}");
        }
    }

    #[test]
    fn a_slip_in_a_recipe_is_named() {
        for slip in [
            "bypass = true",
            "tie_embeddings = false",
            "dropout = 0.2",
            "from = \"x\"",
            "sentences = [\"x\"]",
        ] {
            let error = Recipe::from_toml(&format!("[instruct]\n{slip}"), Path::new(""));
            let error = error.unwrap_err().to_string();
            let field = format!("instruct.{}", slip.split(' ').next().unwrap());
            assert!(
                error.contains(&field) && error.contains("[pretrain]"),
                "{error}"
            );
        }
        let error = Recipe::from_toml("[tokenizer]\nbatch_sise = 3", Path::new("")).unwrap_err();
        assert!(error.to_string().contains("batch_sise"), "{error}");
        for table in ["motion", "tokenizer", "points", "evidence", "pose"] {
            let error = Recipe::from_toml(&format!("[{table}]\nbatch_size = 0"), Path::new(""));
            let error = error.unwrap_err().to_string();
            assert_eq!(
                error,
                format!("{table}.batch_size: must be in 1..=4096, found 0")
            );
            let text = format!("[{table}.loop]\nlearning_rate = 0.0");
            let error = Recipe::from_toml(&text, Path::new("")).unwrap_err();
            let field = format!("{table}.loop.learning_rate");
            assert!(error.to_string().contains(&field), "{error}");
        }
    }
}
