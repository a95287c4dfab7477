//! What a stage learns from besides its settings: data sets, models, files of sentences and results of earlier stages, each
//! by a hash of its content.
//!
//! A folder may get other content under the same name. Hashes tell that apart, so that a checkpoint is resumed only on what
//! it was trained on.

use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::Path;

use radarllm_base::hash::{Fnv1a, fnv_1a};
use radarllm_dataset::{Dataset, DatasetError};
use radarllm_files::bounded;
use radarllm_inference::checkpoint::CHECKSUM_FILE;

use crate::error::TrainError;
use crate::lm::{CodeSource, sentences::MAX_SENTENCES_BYTES};
use crate::recipe::{Recipe, RecipeStage};

/// Hashes by the name of the input: `data`, `start` and `sentences` as in a recipe, or the name of a stage.
pub type Inputs = BTreeMap<String, String>;

/// Maximum size of a list of checksums, bytes.
const MAX_CHECKSUM_BYTES: u64 = 1 << 20;
/// Hash of what does not exist, as of a data set that is not built yet.
const ABSENT: &str = "absent";

/// Hash of the clips of a data set, by the hashes of its shards; `absent` if it is not built.
///
/// # Errors
/// A manifest that cannot be read.
pub fn data_hash(dir: &Path) -> Result<String, TrainError> {
    let data = match Dataset::open(dir) {
        Err(DatasetError::Io { source, .. }) if source.kind() == ErrorKind::NotFound => {
            return Ok(ABSENT.into());
        }
        data => data?,
    };
    let mut hash = Fnv1a::new();
    for shard in &data.manifest().shards {
        hash.write(shard.blake3.as_bytes());
    }
    Ok(text_of(hash.finish()))
}

/// Hash of a checkpoint, by the checksums of its files; `absent` if there is none.
fn checkpoint_hash(dir: &Path) -> Result<String, TrainError> {
    file_hash(&dir.join(CHECKSUM_FILE), MAX_CHECKSUM_BYTES)
}

fn file_hash(path: &Path, max_bytes: u64) -> Result<String, TrainError> {
    if !path.exists() {
        return Ok(ABSENT.into());
    }
    let bytes = bounded::read_bytes(path, max_bytes).map_err(|e| TrainError::Io {
        path: path.into(),
        source: e.into_io(),
    })?;
    Ok(text_of(fnv_1a(&bytes)))
}

fn text_of(hash: u64) -> String {
    format!("{hash:016x}")
}

/// Hash of several inputs in their order.
fn joined(hashes: impl Iterator<Item = Result<String, TrainError>>) -> Result<String, TrainError> {
    let all = hashes.collect::<Result<Vec<_>, _>>()?;
    Ok(match all.as_slice() {
        [one] => one.clone(),
        all => text_of(fnv_1a(all.join(" ").as_bytes())),
    })
}

impl Recipe {
    /// What the trainings of this recipe read: `data`, and `start` and `sentences` if it names them.
    ///
    /// # Errors
    /// Files that exist and cannot be read.
    pub fn outside_inputs(&self) -> Result<Inputs, TrainError> {
        let data = joined(self.data.iter().map(|dir| data_hash(dir)))?;
        let mut inputs = Inputs::from([("data".to_string(), data)]);
        if let Some(start) = &self.start {
            let parts = ["tokenizer", "lm"];
            let hash = joined(parts.iter().map(|part| checkpoint_hash(&start.join(part))))?;
            inputs.insert("start".into(), hash);
        }
        let sentences = &self.pretrain.sentences;
        if !sentences.is_empty() {
            let hashes = sentences
                .iter()
                .map(|path| file_hash(path, MAX_SENTENCES_BYTES));
            inputs.insert("sentences".into(), joined(hashes)?);
        }
        Ok(inputs)
    }

    /// What a stage learns from besides its settings.
    ///
    /// # Errors
    /// An earlier stage that has no result; files that cannot be read.
    pub(crate) fn inputs(&self, stage: RecipeStage) -> Result<Inputs, TrainError> {
        use RecipeStage::{Instruct, Points, Pretrain};
        let mut inputs = self.outside_inputs()?;
        let reads = |name: &str| match name {
            "start" => matches!(stage, Pretrain | Instruct | Points),
            "sentences" => stage == Pretrain,
            _ => true,
        };
        inputs.retain(|name, _| reads(name));
        for earlier in self.learned_from(stage) {
            let hash = checkpoint_hash(&self.result(earlier)?)?;
            inputs.insert(earlier.name().into(), hash);
        }
        Ok(inputs)
    }

    /// The earlier stages of whose results a stage learns.
    fn learned_from(&self, stage: RecipeStage) -> Vec<RecipeStage> {
        use RecipeStage::{
            Instruct, Motion, Points, Pose, PoseFirstHalf, PoseSecondHalf, Pretrain, Tokenizer,
        };
        // The tokenizer of a model with which the training goes on is no result of a stage.
        let tokenizer = || match self.start {
            Some(_) => Vec::new(),
            None => vec![Tokenizer],
        };
        match stage {
            Tokenizer if self.tokenizer.loss.needs_teacher() => vec![Motion],
            Points => tokenizer(),
            Pretrain => match self.pretrain.codes {
                CodeSource::Radar => tokenizer(),
                CodeSource::Motion => vec![Motion],
                CodeSource::EstimatedMotion => vec![Motion, Pose, PoseFirstHalf, PoseSecondHalf],
                CodeSource::Pictures => Vec::new(),
            },
            Instruct => [self.learned_from(Pretrain), vec![Pretrain]].concat(),
            _ => Vec::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn inputs_of_a_stage_are_what_it_reads_by_content() {
        let dir = std::env::temp_dir().join(format!("radarllm-inputs-{}", std::process::id()));
        let _ = fs::remove_dir_all(&dir);
        let checkpoint = |stage: &str, content: &str| {
            let best = dir.join("model").join(stage).join("best");
            fs::create_dir_all(&best).unwrap();
            fs::write(best.join(CHECKSUM_FILE), content).unwrap();
        };
        fs::create_dir_all(&dir).unwrap();
        fs::write(dir.join("words.txt"), "a person walks").unwrap();
        let text = "[pretrain]\nsentences = [\"words.txt\"]";
        let recipe = Recipe::from_toml(text, &dir).unwrap();
        for stage in ["motion", "tokenizer", "pretrain"] {
            checkpoint(stage, "{}");
        }
        let names = |stage| -> Vec<String> { recipe.inputs(stage).unwrap().into_keys().collect() };
        assert_eq!(names(RecipeStage::Motion), ["data"]);
        assert_eq!(names(RecipeStage::Tokenizer), ["data", "motion"]);
        assert_eq!(names(RecipeStage::Evidence), ["data"]);
        assert_eq!(names(RecipeStage::Points), ["data", "tokenizer"]);
        assert_eq!(
            names(RecipeStage::Pretrain),
            ["data", "sentences", "tokenizer"]
        );
        assert_eq!(
            names(RecipeStage::Instruct),
            ["data", "pretrain", "tokenizer"]
        );

        let changed = |change: &dyn Fn()| -> Vec<String> {
            let before = recipe.inputs(RecipeStage::Pretrain).unwrap();
            change();
            let after = recipe.inputs(RecipeStage::Pretrain).unwrap();
            let differs = |name: &String| after[name] != before[name];
            after.keys().filter(|name| differs(name)).cloned().collect()
        };
        assert!(changed(&|| checkpoint("tokenizer", "{}")).is_empty());
        assert_eq!(changed(&|| checkpoint("tokenizer", "{ }")), ["tokenizer"]);
        let words = || fs::write(dir.join("words.txt"), "a person sits").unwrap();
        assert_eq!(changed(&words), ["sentences"]);

        // A recipe that goes on with a model reads its tokenizer.
        let recipe = Recipe::from_toml("start = \"base\"", &dir).unwrap();
        let inputs = recipe.inputs(RecipeStage::Pretrain).unwrap();
        assert_eq!(inputs.into_keys().collect::<Vec<_>>(), ["data", "start"]);
        fs::remove_dir_all(dir).unwrap();
    }
}
