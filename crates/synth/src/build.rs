//! Builds a complete data set from a configuration: in parallel, resumably, on one machine or on several.

use std::{
    collections::HashMap,
    path::Path,
    sync::{Mutex, PoisonError},
};

use radarllm_base::{RadarConfig, seed::derive_seed};
use radarllm_dataset::{
    ClipRecord, Manifest, Overwrite, ShardEntry, SourceLicence, Split,
    builder::{BuildOptions, BuildPlan, BuildReport, Builder, BuiltShards, ItemId, Progress},
};
use radarllm_files::bounded::{self, MAX_CONFIG_BYTES};
use radarllm_io::{Error, Result};
use rand::{RngExt, SeedableRng, rngs::ChaCha8Rng};

use crate::{
    SynthError, Synthesizer, arithmetic::arithmetic, config::DatasetConfig, corpus::Corpus,
    record::make_record,
};

/// A data set that can be built: a configuration with its sources opened and its clips assigned to shards.
///
/// [`Self::build`] builds it in one process. To use several machines that share a folder, one process calls
/// [`Self::prepare`], then any process builds any shard with [`Self::build_shard`], and finally one process calls
/// [`Self::finish`]. The bytes are the same. A shard that was killed is built again by whoever comes next; shards that
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

impl DatasetPlan {
    /// Reads a configuration and opens its sources. Relative paths in it are resolved against its folder.
    ///
    /// # Errors
    /// A configuration, source or radar that cannot be used.
    pub fn open(path: &Path) -> Result<Self> {
        let text = bounded::read_text(path, MAX_CONFIG_BYTES)?;
        let config = DatasetConfig::from_toml(&text).map_err(|e| Error::wrap_in_file(path, e))?;
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
        let boards = config
            .boards()
            .into_iter()
            .map(|board| Board::open(board, base))
            .collect::<std::result::Result<Vec<_>, _>>()?;
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
            config_toml: toml::to_string(&config).map_err(|e| SynthError::Config(e.to_string()))?,
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
        if !(1..=n_parts).contains(&part) {
            return Err(Error::input(format!(
                "there is no part {part} of {n_parts}: parts are numbered from 1"
            )));
        }
        // Every n-th shard, so that each part has its share of the short shards at the end of splits.
        Ok((part - 1..self.n_shards()).step_by(n_parts).collect())
    }

    /// First step of a build by several processes: makes `dir` the folder of this data set, or of its build that was
    /// begun before. Leftovers of killed processes are removed.
    ///
    /// # Errors
    /// A folder that contains another data set (unless [`Overwrite::Replace`]) or anything else; another process that
    /// builds there; an object store or another file system without locks or renames.
    pub fn prepare(&self, dir: &Path, overwrite: Overwrite) -> Result {
        Ok(self.builder.prepare(dir, overwrite)?)
    }

    /// As [`Self::prepare`], unless another process has done that or is doing it: for processes that start at the same
    /// time and that no other program coordinates.
    ///
    /// # Errors
    /// As [`Self::prepare`].
    pub fn prepare_once(&self, dir: &Path) -> Result {
        Ok(self.builder.prepare_once(dir)?)
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
        Ok(self.builder.build(dir, options, make, progress, stop)?)
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
