//! Builds a complete data set from a configuration, in parallel and resumably.

use std::{
    collections::HashMap,
    path::Path,
    sync::{Mutex, PoisonError},
};

use radarllm_dataset::{
    SourceLicence,
    builder::{self, BuildOptions, BuildPlan, BuildReport, ItemId, Progress},
    record::Split,
};

use crate::{SynthError, Synthesizer, config::DatasetConfig, corpus::Corpus, record::make_record};

/// Builds the data set of a configuration, or resumes its build.
///
/// Relative paths in the configuration are resolved against the folder `base`.
///
/// # Errors
/// A configuration, source or radar that cannot be used, or a folder that cannot be written.
/// Motions that fail are listed in the manifest instead.
pub fn build(
    config: &DatasetConfig,
    base: &Path,
    out: &Path,
    options: BuildOptions,
    progress: impl Fn(Progress) + Sync,
) -> Result<BuildReport, SynthError> {
    let radar = config.open_radar(base)?;
    let corpora = config.open_sources(base)?;
    let mut places: HashMap<String, (usize, usize, usize)> = HashMap::new();
    let mut items = Vec::new();
    for (corpus_idx, corpus) in corpora.iter().enumerate() {
        for (item_idx, item) in corpus.items().iter().enumerate() {
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
        radar: radar.name.clone(),
        frame_rate_hz: config.stored_rate_hz(&radar)?,
        seed: config.seed,
        config_toml: toml::to_string(config).map_err(|e| SynthError::Config(e.to_string()))?,
        items,
        shard_size: config.shard_clips,
        licences: corpora
            .iter()
            .map(|c| SourceLicence {
                source: c.name().into(),
                licence: c.licence().into(),
                attribution: c.attribution().into(),
            })
            .collect(),
        skipped: corpora.iter().flat_map(|c| c.skipped().to_vec()).collect(),
    };
    let pool: Mutex<Vec<Synthesizer>> = Mutex::default();
    let take = || pool.lock().unwrap_or_else(PoisonError::into_inner).pop();
    let make = |id: &ItemId| {
        let (corpus_idx, item_idx, variant) = places[&id.id];
        // Planning FFTs takes milliseconds, so all threads share a pool of planned chains.
        let mut synthesizer = match take() {
            Some(ready) => ready,
            None => config.synthesizer(&radar)?,
        };
        let corpus: &dyn Corpus = corpora[corpus_idx].as_ref();
        let record = make_record(&mut synthesizer, corpus, item_idx, variant, config);
        pool.lock()
            .unwrap_or_else(PoisonError::into_inner)
            .push(synthesizer);
        record
    };
    Ok(builder::build(out, &plan, options, make, progress)?)
}
