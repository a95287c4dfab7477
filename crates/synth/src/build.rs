//! Builds a complete data set from a configuration: in parallel, resumably, on one machine or on several.

use std::{
    collections::HashMap,
    path::Path,
    sync::{Mutex, PoisonError},
};

use radarllm_base::{RadarConfig, seed::derive_seed};
use radarllm_dataset::{
    ClipRecord, Manifest, Overwrite, PreparedPlan, ShardEntry, SourceLicence, Split,
    builder::{BuildOptions, BuildPlan, BuildReport, Builder, BuiltShards, ItemId, Progress},
};
use radarllm_files::bounded::{self, MAX_CONFIG_BYTES};
use radarllm_io::{Error, Result};
use rand::{RngExt, SeedableRng, rngs::ChaCha8Rng};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::{
    SynthError, Synthesizer,
    arithmetic::arithmetic,
    config::DatasetConfig,
    corpus::{Corpus, CorpusItem},
    record::make_record,
};

/// A data set that can be built: a configuration with its sources opened and its clips assigned to shards.
///
/// [`Self::build`] builds it in one process. To use several machines that share a folder, one process calls
/// [`Self::prepare`], then any process builds any shard with [`Self::build_shard`], and finally one process calls
/// [`Self::finish`]. The bytes are the same. In a folder that was prepared, [`Self::of_prepared`] opens some shards without
/// opening the sources, which takes as long as the whole data set is large. A shard that was killed is built again by whoever comes next; shards that
/// are complete are kept. Every process compares its version, its configuration and its arithmetic with those that
/// `prepare` recorded in the folder.
///
/// ```
/// use radarllm_dataset::{Dataset, Overwrite, Split};
/// use radarllm_synth::DatasetPlan;
///
/// # let folder = tempfile::tempdir()?;
/// # let file = folder.path().join("data.toml");
/// # let out = folder.path().join("data");
/// std::fs::write(&file, r#"
/// name = "small"
/// shard_clips = 1
/// max_frames = 2
/// facet_edge_m = 0.05
/// [[source]]
/// kind = "procedural"
/// train = 2
/// val = 1
/// test = 0
/// "#)?;
/// let plan = DatasetPlan::open(&file)?;
/// assert_eq!(plan.n_shards(), 3);
/// plan.prepare(&out, Overwrite::Refuse)?;
/// // In any order, in any process, on any machine with the same folder:
/// for shard in [2, 0, 1] {
///     plan.build_shard(&out, shard, 1)?;
/// }
/// assert_eq!(plan.finish(&out)?.n_clips, 3);
/// assert_eq!(Dataset::open(&out)?.n_clips(Split::Train), 2);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct DatasetPlan {
    config: DatasetConfig,
    boards: Vec<Board>,
    corpora: Vec<Box<dyn Corpus>>,
    /// By clip: corpus, item and variant.
    places: HashMap<String, (usize, usize, usize)>,
    builder: Builder,
}

/// A board of the data set with its chains.
struct Board {
    config: DatasetConfig,
    radar: RadarConfig,
    /// Planned chains that no thread uses at present: planning FFTs takes milliseconds.
    idle: Mutex<Vec<Synthesizer>>,
}

impl Board {
    fn open(config: DatasetConfig, base: &Path) -> std::result::Result<Self, SynthError> {
        let radar = config.open_radar(base)?;
        config.stored_rate_hz(&radar)?;
        config.check_distance(&radar)?;
        Ok(Self {
            config,
            radar,
            idle: Mutex::default(),
        })
    }
}

/// What a clip is made of, as the index of a data set has it.
#[derive(Serialize, Deserialize)]
struct ClipRecipe {
    /// Number of the source in the configuration.
    source: usize,
    variant: usize,
    motion_id: String,
    action: String,
    captions: Vec<String>,
    is_continuous: bool,
    /// For the source.
    motion: Value,
}

fn read_config(path: &Path) -> Result<DatasetConfig> {
    let text = bounded::read_text(path, MAX_CONFIG_BYTES)?;
    DatasetConfig::from_toml(&text).map_err(|e| Error::wrap_in_file(path, e))
}

/// The configuration as data sets record it.
fn text_of(config: &DatasetConfig) -> std::result::Result<String, SynthError> {
    toml::to_string(config).map_err(|e| SynthError::Config(e.to_string()))
}

fn open_boards(config: &DatasetConfig, base: &Path) -> std::result::Result<Vec<Board>, SynthError> {
    let boards = config.boards().into_iter();
    boards.map(|board| Board::open(board, base)).collect()
}

/// Numbers of the shards of a part.
fn shards_of_part(n_shards: usize, part: usize, n_parts: usize) -> Result<Vec<usize>> {
    if !(1..=n_parts).contains(&part) {
        return Err(Error::input(format!(
            "there is no part {part} of {n_parts}: parts are numbered from 1"
        )));
    }
    // Every n-th shard, so that each part has its share of the short shards at the end of splits.
    Ok((part - 1..n_shards).step_by(n_parts).collect())
}

impl DatasetPlan {
    /// Reads a configuration and opens its sources. Relative paths in it are resolved against its folder.
    ///
    /// # Errors
    /// A configuration, source or radar that cannot be used.
    pub fn open(path: &Path) -> Result<Self> {
        let config = read_config(path)?;
        Ok(Self::new(config, path.parent().unwrap_or(Path::new("")))?)
    }

    /// Opens the sources of a configuration. Relative paths in it are resolved against the folder `base`.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub fn new(config: DatasetConfig, base: &Path) -> std::result::Result<Self, SynthError> {
        Self::new_until(config, base, &|| false)
    }

    /// As [`Self::new`], but ends early once `stop` returns `true`: thousands of built-in motions take seconds.
    ///
    /// # Errors
    /// As [`Self::new`]; [`SynthError::Interrupted`] if it was stopped.
    pub fn new_until(
        config: DatasetConfig,
        base: &Path,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> std::result::Result<Self, SynthError> {
        let boards = open_boards(&config, base)?;
        let first = boards
            .first()
            .ok_or_else(|| SynthError::Config("no board".into()))?;
        let frame_rate_hz = first.config.stored_rate_hz(&first.radar)?;
        let mut names: Vec<&str> = Vec::new();
        for board in &boards {
            if !names.contains(&&*board.radar.name) {
                names.push(&board.radar.name);
            }
        }
        let radars = names.join(", ");
        let corpora = config.open_sources_until(base, stop)?;
        let mut places: HashMap<String, (usize, usize, usize)> = HashMap::new();
        let mut items = Vec::new();
        for (corpus_idx, corpus) in corpora.iter().enumerate() {
            let items_of_splits = corpus.items().iter().enumerate();
            for (item_idx, item) in items_of_splits.filter(|(_, item)| config.builds(item.split)) {
                let variants = if item.split == Split::Train {
                    config.train_variants
                } else {
                    1
                };
                for variant in 0..variants {
                    let id = format!("{}#{variant}", item.motion_id);
                    if places
                        .insert(id.clone(), (corpus_idx, item_idx, variant))
                        .is_some()
                    {
                        return Err(SynthError::Config(format!(
                            "two sources hold a motion `{}`",
                            item.motion_id
                        )));
                    }
                    items.push(ItemId {
                        id,
                        group: item.group.clone(),
                        split: item.split,
                    });
                }
            }
        }
        let plan = BuildPlan {
            name: config.name.clone(),
            tool_version: env!("CARGO_PKG_VERSION").into(),
            arithmetic: arithmetic(),
            radar: radars,
            frame_rate_hz,
            seed: config.seed,
            config_toml: text_of(&config)?,
            items,
            shard_size: config.shard_clips,
            licences: corpora
                .iter()
                .map(|c| SourceLicence {
                    source: c.name().into(),
                    licence: c.licence().into(),
                    attribution: c.attribution().into(),
                    synthetic: true,
                })
                .collect(),
            skipped: corpora.iter().flat_map(|c| c.skipped().to_vec()).collect(),
        };
        Ok(Self {
            config,
            boards,
            corpora,
            places,
            builder: Builder::new(plan)?,
        })
    }

    /// Some shards of a folder that was prepared for a configuration, chosen by their number in the whole data set. Returns
    /// nothing if the folder was not prepared, or for another configuration, or by a version without an index: then open the
    /// whole plan, which tells why. Other shards cannot be built, and it cannot prepare; with all shards, it can finish.
    ///
    /// # Errors
    /// What `choose` returns; a shard that there is not; an index that is damaged; a radar that cannot be used.
    pub fn of_prepared(
        config: DatasetConfig,
        base: &Path,
        dir: &Path,
        choose: impl FnOnce(usize) -> Result<Vec<usize>>,
    ) -> Result<Option<Self>> {
        let Some(prepared) = PreparedPlan::read(dir)? else {
            return Ok(None);
        };
        if prepared.config_toml() != text_of(&config)? {
            return Ok(None);
        }
        let shards = choose(prepared.n_shards())?;
        let version = env!("CARGO_PKG_VERSION").into();
        let (builder, recipes) = Builder::of_part(prepared, &shards, version, arithmetic())?;
        let mut items = vec![Vec::new(); config.source.len()];
        let mut places = HashMap::new();
        for (id, recipe) in builder.plan().items.iter().zip(recipes) {
            let recipe: ClipRecipe = serde_json::from_value(recipe)
                .map_err(|e| Error::input(format!("{}: {}: {e}", dir.display(), id.id)))?;
            let Some(of_source) = items.get_mut(recipe.source) else {
                let (dir, source) = (dir.display(), recipe.source);
                let problem = format!("{dir}: {}: there is no source {source}", id.id);
                return Err(Error::input(problem));
            };
            places.insert(
                id.id.clone(),
                (recipe.source, of_source.len(), recipe.variant),
            );
            let item = CorpusItem {
                motion_id: recipe.motion_id,
                group: id.group.clone(),
                split: id.split,
                action: recipe.action,
                captions: recipe.captions,
                is_continuous: recipe.is_continuous,
            };
            of_source.push((item, recipe.motion));
        }
        Ok(Some(Self {
            boards: open_boards(&config, base)?,
            corpora: config.reopen_sources(base, items)?,
            config,
            places,
            builder,
        }))
    }

    /// Opens one of `n_parts` parts of equal size, numbered from 1, of the data set of a configuration file: of a folder that
    /// was prepared for it, that part alone, which does not take longer for larger data sets.
    ///
    /// # Errors
    /// As [`Self::open`] and [`Self::of_prepared`]; a part that is not in `1..=n_parts`.
    pub fn open_part(path: &Path, dir: &Path, part: usize, n_parts: usize) -> Result<Self> {
        let choose = |n_shards| shards_of_part(n_shards, part, n_parts);
        Self::open_prepared(path, dir, choose)
    }

    /// Opens the data set of a configuration file to finish it: of a folder that was prepared for it, without its sources.
    ///
    /// # Errors
    /// As [`Self::open`] and [`Self::of_prepared`].
    pub fn open_all(path: &Path, dir: &Path) -> Result<Self> {
        Self::open_prepared(path, dir, |n_shards| Ok((0..n_shards).collect()))
    }

    fn open_prepared(
        path: &Path,
        dir: &Path,
        choose: impl FnOnce(usize) -> Result<Vec<usize>>,
    ) -> Result<Self> {
        let config = read_config(path)?;
        let base = path.parent().unwrap_or(Path::new(""));
        match Self::of_prepared(config.clone(), base, dir, choose)? {
            Some(plan) => Ok(plan),
            None => Ok(Self::new(config, base)?),
        }
    }

    /// The configuration.
    pub fn config(&self) -> &DatasetConfig {
        &self.config
    }

    /// Number of clips that are asked for.
    pub fn n_clips(&self) -> usize {
        self.builder.plan().items.len()
    }

    /// Number of shards. They are numbered from 0, train first.
    pub fn n_shards(&self) -> usize {
        self.builder.n_shards()
    }

    /// Hash of everything that determines the content: two processes with the same one build the same data set.
    pub fn fingerprint(&self) -> &str {
        self.builder.fingerprint()
    }

    /// Numbers of the shards of one of `n_parts` parts of equal size; parts are numbered from 1. A part has no shards
    /// where there are more parts than shards.
    ///
    /// # Errors
    /// A part that is not in `1..=n_parts`.
    pub fn part(&self, part: usize, n_parts: usize) -> Result<Vec<usize>> {
        shards_of_part(self.n_shards(), part, n_parts)
    }

    /// First step of a build by several processes: makes `dir` the folder of this data set, or of its build that was
    /// begun before. Leftovers of killed processes are removed.
    ///
    /// # Errors
    /// A folder that contains another data set (unless [`Overwrite::Replace`]) or anything else; another process that
    /// builds there; an object store or another file system without locks or renames.
    pub fn prepare(&self, dir: &Path, overwrite: Overwrite) -> Result {
        Ok(self
            .builder
            .prepare(dir, overwrite, &|id| self.recipe(id))?)
    }

    /// As [`Self::prepare`], unless another process has done that or is doing it: for processes that start at the same
    /// time and that no other program coordinates.
    ///
    /// # Errors
    /// As [`Self::prepare`].
    pub fn prepare_once(&self, dir: &Path) -> Result {
        Ok(self.builder.prepare_once(dir, &|id| self.recipe(id))?)
    }

    /// Builds one shard in a prepared folder, or keeps it if it is there and its hash fits.
    ///
    /// # Errors
    /// A shard that there is not; a folder that was not prepared, or with another version, configuration or arithmetic.
    /// Motions that fail are listed in the entry instead.
    pub fn build_shard(&self, dir: &Path, shard: usize, threads: usize) -> Result<ShardEntry> {
        let options = BuildOptions {
            threads,
            overwrite: Overwrite::Refuse,
            retry_failed: false,
        };
        let built = self.build_shards(dir, [shard], options, |_| (), &|| false)?;
        let entry = built.entries.into_iter().next();
        entry.ok_or_else(|| Error::bug(format!("shard {shard} was not built")))
    }

    /// As [`Self::build_shard`], for several shards whose clips share the threads. `stop` is asked before every clip and
    /// ends the work when it returns `true`.
    ///
    /// # Errors
    /// As [`Self::build_shard`]; an error of the kind [`radarllm_io::ErrorKind::Interrupted`] if it was stopped.
    pub fn build_shards(
        &self,
        dir: &Path,
        shards: impl IntoIterator<Item = usize>,
        options: BuildOptions,
        progress: impl Fn(Progress) + Sync,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Result<BuiltShards> {
        let make = |id: &ItemId| self.make(id);
        let builder = &self.builder;
        Ok(builder.build_shards(dir, shards, options, make, progress, stop)?)
    }

    /// Last step of a build by several processes: reads every hash again and writes the card and the manifest.
    ///
    /// # Errors
    /// Missing or damaged shards, which are named; other processes that still build; a folder that was not prepared, or
    /// with another version or configuration.
    pub fn finish(&self, dir: &Path) -> Result<Manifest> {
        Ok(self.builder.finish(dir)?)
    }

    /// Builds the data set in one process, or resumes its build. `stop` is asked before every clip and ends the work
    /// when it returns `true`.
    ///
    /// # Errors
    /// As [`Self::prepare`] and [`Self::build_shards`].
    pub fn build(
        &self,
        dir: &Path,
        options: BuildOptions,
        progress: impl Fn(Progress) + Sync,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Result<BuildReport> {
        let make = |id: &ItemId| self.make(id);
        let recipe = |id: &ItemId| self.recipe(id);
        let builder = &self.builder;
        Ok(builder.build(dir, options, &recipe, make, progress, stop)?)
    }

    /// What a clip is made of, for the index.
    fn recipe(&self, id: &ItemId) -> Value {
        let (source, item_idx, variant) = self.places[&id.id];
        let corpus = &self.corpora[source];
        let item = &corpus.items()[item_idx];
        serde_json::json!(ClipRecipe {
            source,
            variant,
            motion_id: item.motion_id.clone(),
            action: item.action.clone(),
            captions: item.captions.clone(),
            is_continuous: item.is_continuous,
            motion: corpus.recipe(item_idx),
        })
    }

    fn make(&self, id: &ItemId) -> std::result::Result<ClipRecord, SynthError> {
        let (corpus_idx, item_idx, variant) = self.places[&id.id];
        let board = &self.boards[self.board_of(&id.id)];
        let idle = || board.idle.lock().unwrap_or_else(PoisonError::into_inner);
        let ready = idle().pop();
        let mut synthesizer = match ready {
            Some(ready) => ready,
            None => board.config.synthesizer(&board.radar)?,
        };
        let corpus: &dyn Corpus = self.corpora[corpus_idx].as_ref();
        let record = make_record(&mut synthesizer, corpus, item_idx, variant, &board.config);
        idle().push(synthesizer);
        record
    }

    /// The board of a clip, drawn from its name and the seed of the data set.
    fn board_of(&self, id: &str) -> usize {
        let clip = derive_seed(self.config.seed, id);
        let mut rng = ChaCha8Rng::seed_from_u64(derive_seed(clip, "board"));
        rng.random_range(0..self.boards.len())
    }
}

#[cfg(test)]
mod tests {
    use std::{collections::BTreeMap, fs};

    use super::*;
    use crate::corpus::files::tests::bvh;

    const CONFIG: &str = r#"
        name = "all"
        shard_clips = 2
        max_frames = 2
        facet_edge_m = 0.05
        train_variants = 2
        [[source]]
        kind = "procedural"
        train = 2
        val = 1
        test = 1
        draw = "sides"
        held_out = ["a person kicks"]
        [[source]]
        kind = "files"
        path = "motions"
        captions = "captions.jsonl"
        licence = "own"
        [[source]]
        kind = "humanml3d"
        path = "texts"
        motions = "cmu"
        trials = "trials.csv"
        licence = "own"
        [[source]]
        kind = "bandai-namco"
        path = "bandai"
    "#;

    /// Files of all kinds of sources.
    fn sources() -> tempfile::TempDir {
        let dir = tempfile::tempdir().unwrap();
        let put = |name: &str, text: &str| {
            let path = dir.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        };
        put("motions/a/walk.bvh", &bvh(30, 3.0));
        put(
            "motions/captions.jsonl",
            r#"{"file": "a/walk.bvh", "captions": ["a person walks"], "split": "train", "mirror": true}"#,
        );
        put(
            "texts/texts.jsonl",
            r#"{"id": "1", "split": "test", "source_path": "./pose_data/CMU/07/07_01_poses.npy", "cmu": "x", "start_frame": 0, "end_frame": -1, "sentences": [{"text": "he steps", "start": 1.0, "end": 9.5}]}"#,
        );
        put(
            "trials.csv",
            "trial,file,kind,true_fps,skip_first_frames\n07_01,a,bvh,20,1\n",
        );
        put("cmu/bvh/07/07_01.bvh", &bvh(122, 5.0));
        put("bandai/x/clip.bvh", &bvh(40, 1.0));
        put(
            "bandai/captions.jsonl",
            r#"{"clip": "clip", "content": "walk", "style": "normal", "captions": ["a person walks"]}"#,
        );
        put("bandai/splits.csv", "clip,split,group\nclip,val,g\n");
        dir
    }

    fn files_of(dir: &Path) -> BTreeMap<String, Vec<u8>> {
        let mut found = BTreeMap::new();
        for folder in ["", "data", ".shards"] {
            for entry in fs::read_dir(dir.join(folder)).unwrap() {
                let path = entry.unwrap().path();
                let name = path.strip_prefix(dir).unwrap().display().to_string();
                if path.is_file() && name != ".shards/lock" {
                    found.insert(name, fs::read(path).unwrap());
                }
            }
        }
        found
    }

    #[test]
    fn shards_of_a_prepared_folder_need_no_list_of_motions_and_have_the_same_bytes() {
        let sources = sources();
        let base = sources.path();
        let config = DatasetConfig::from_toml(CONFIG).unwrap();
        let options = BuildOptions {
            threads: 2,
            overwrite: Overwrite::Refuse,
            retry_failed: false,
        };
        let out = tempfile::tempdir().unwrap();
        let [whole, parts] = ["whole", "parts"].map(|name| out.path().join(name));
        let plan = DatasetPlan::new(config.clone(), base).unwrap();
        assert!(plan.builder.plan().skipped.is_empty());
        plan.build(&whole, options, |_| (), &|| false).unwrap();

        let of = |config: &DatasetConfig, choose: Vec<usize>| {
            DatasetPlan::of_prepared(config.clone(), base, &parts, |_| Ok(choose))
        };
        assert!(of(&config, vec![0]).unwrap().is_none(), "not prepared");
        plan.prepare(&parts, Overwrite::Refuse).unwrap();
        for list in ["motions/captions.jsonl", "texts/texts.jsonl", "trials.csv"] {
            fs::remove_file(base.join(list)).unwrap();
        }
        fs::remove_file(base.join("bandai/splits.csv")).unwrap();
        for shard in 0..plan.n_shards() {
            let part = of(&config, vec![shard]).unwrap().unwrap();
            assert_eq!(part.n_shards(), plan.n_shards());
            assert!(part.n_clips() <= 2);
            part.build_shard(&parts, shard, 1).unwrap();
            let error = part.build_shard(&parts, (shard + 1) % part.n_shards(), 1);
            assert!(error.is_err(), "not part of it");
            assert!(
                part.finish(&parts).is_err() && part.prepare(&parts, Overwrite::Refuse).is_err()
            );
        }
        let all = of(&config, (0..plan.n_shards()).collect())
            .unwrap()
            .unwrap();
        all.finish(&parts).unwrap();
        let (whole, parts) = (files_of(&whole), files_of(&parts));
        assert_eq!(
            whole.keys().collect::<Vec<_>>(),
            parts.keys().collect::<Vec<_>>()
        );
        assert!(whole == parts);

        let other = DatasetConfig {
            seed: 9,
            ..config.clone()
        };
        assert!(
            of(&other, vec![0]).unwrap().is_none(),
            "another configuration"
        );
        assert!(of(&config, vec![99]).is_err_and(|e| e.to_string().contains("no shard 99")));
    }

    #[test]
    fn a_damaged_index_is_named() {
        let config =
            "max_frames = 2\n[[source]]\nkind = \"procedural\"\ntrain = 2\nval = 1\ntest = 1";
        let config = DatasetConfig::from_toml(config).unwrap();
        let dir = tempfile::tempdir().unwrap();
        let plan = DatasetPlan::new(config.clone(), Path::new("")).unwrap();
        plan.prepare(dir.path(), Overwrite::Refuse).unwrap();
        let open = || {
            let all = |n_shards: usize| Ok((0..n_shards).collect());
            DatasetPlan::of_prepared(config.clone(), Path::new(""), dir.path(), all)
        };
        assert!(open().unwrap().is_some());
        for (name, word) in [("items.jsonl", "hash"), ("index.json", "index.json")] {
            let path = dir.path().join(".shards").join(name);
            let whole = fs::read(&path).unwrap();
            for cut in [0, 1, whole.len() / 2, whole.len() - 2] {
                fs::write(&path, &whole[..cut]).unwrap();
                let error = open().map(drop).unwrap_err().to_string();
                assert!(error.contains(name) && error.contains(word), "{error}");
            }
            let mut changed = whole.clone();
            changed[whole.len() / 2] ^= 1;
            fs::write(&path, &changed).unwrap();
            // Of the index, a changed letter may be the name of something.
            assert!(open().is_err() || name == "index.json");
            fs::write(&path, &whole).unwrap();
        }
        // An index that names more than there is.
        let path = dir.path().join(".shards/index.json");
        let index = fs::read_to_string(&path).unwrap();
        let bytes = index.split("\"bytes\": ").nth(1).unwrap();
        let bytes = bytes.split(',').next().unwrap();
        let huge = index.replacen(
            &format!("\"bytes\": {bytes}"),
            "\"bytes\": 18446744073709551615",
            1,
        );
        fs::write(&path, huge).unwrap();
        assert!(open().map(drop).unwrap_err().to_string().contains("limit"));
    }
}
