//! A trained model: the one that comes with the library, or a folder made by training.

use std::{
    path::{Path, PathBuf},
    sync::{Mutex, OnceLock, PoisonError},
};

use radarllm_base::{
    hash::Fnv1a,
    message::{option, text},
};
use radarllm_files::bounded::{self, MAX_CONFIG_BYTES};
use radarllm_inference::{
    Captioner, LmError, LoadBackend, Precision,
    backend::load_engine,
    checkpoint::{Checkpoint, CheckpointError, visit_files},
    evidence::Evidence,
    lm::{
        RadarCut,
        ensemble::{Member, member_folders, open_members},
    },
    tokenizer::points::PointDecoder,
};
use radarllm_io::{Error, ErrorKind, Result};
use radarllm_model_default::{self as bundled, Bundled};

use crate::RecordedConfidence;

/// Folder of the decoder of radar tokens in the folder of a model.
const POINTS: &str = "points";
/// Folder of the networks that weigh sentences.
const EVIDENCE: &str = "evidence";
/// The model card in the folder of a model.
const CARD: &str = "README.md";

/// How a model is computed.
#[derive(Clone, Copy, Debug)]
pub struct ModelOptions {
    /// Precision of the weights of the language model.
    pub precision: Precision,
    /// What creates the networks of each member. [`load_engine`] is the inference engine; `radarllm-nn` has backends that
    /// run the networks as they are trained.
    pub backend: LoadBackend,
    /// What is cut between radar and language model, to measure what it is worth; nothing in models that describe.
    pub cut: Option<RadarCut>,
}

impl Default for ModelOptions {
    /// The inference engine with 32-bit weights.
    fn default() -> Self {
        Self {
            precision: Precision::F32,
            backend: load_engine,
            cut: None,
        }
    }
}

/// A model that comes with the library.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BundledModel {
    /// The default: an ensemble of two that reads radar tokens, the features beside them and the context. It describes.
    #[default]
    Features,
    /// It reads its radar tokens alone, as in the published method. It describes, follows instructions, and generates radar.
    Tokens,
}

impl BundledModel {
    /// All bundled models.
    pub const ALL: [Self; 2] = [Self::Features, Self::Tokens];

    /// The name by which a user chooses it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Features => "features",
            Self::Tokens => "tokens",
        }
    }

    fn files(self) -> &'static Bundled {
        match self {
            Self::Features => &bundled::FEATURES,
            Self::Tokens => &bundled::TOKENS,
        }
    }
}

/// Where the files of a model are.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ModelFiles {
    /// In the program.
    Bundled(BundledModel),
    /// In a folder made by training.
    Folder(PathBuf),
}

impl ModelFiles {
    /// The files of the bundled model of that name or of a folder; of the default model if none is named. A folder that has the
    /// name of a bundled model is named with its path: `./tokens`.
    pub fn of(model: Option<&Path>) -> Self {
        let Some(model) = model else {
            return Self::Bundled(BundledModel::default());
        };
        let mut all = BundledModel::ALL.into_iter();
        match all.find(|bundled| model.as_os_str() == bundled.name()) {
            Some(bundled) => Self::Bundled(bundled),
            None => Self::Folder(model.into()),
        }
    }

    /// Name in reports: the folder, or `default (embedded)`.
    pub fn name(&self) -> String {
        self.path("").display().to_string()
    }

    /// Reads a configuration or another small text.
    ///
    /// # Errors
    /// A file that is missing, too large or not UTF-8.
    pub fn text(&self, file: &str) -> Result<String> {
        let path = self.path(file);
        match self {
            Self::Folder(_) => Ok(bounded::read_text(&path, MAX_CONFIG_BYTES)?),
            Self::Bundled(model) => match model.files().file(file) {
                Some(bytes) => Ok(String::from_utf8_lossy(bytes).into_owned()),
                None => {
                    let missing = "not part of the bundled model";
                    Err(Error::in_file(&path, missing).of_kind(ErrorKind::NotFound))
                }
            },
        }
    }

    /// As [`Self::text`], for a file that a model may lack.
    fn optional_text(&self, file: &str) -> Result<Option<String>> {
        let exists = match self {
            Self::Folder(folder) => folder.join(file).exists(),
            Self::Bundled(model) => model.files().file(file).is_some(),
        };
        exists.then(|| self.text(file)).transpose()
    }

    /// Place of a file, for errors.
    fn path(&self, file: &str) -> PathBuf {
        let folder = match self {
            Self::Folder(folder) => folder.as_path(),
            Self::Bundled(model) => Path::new(model.files().name),
        };
        match file {
            "" => folder.into(),
            file => folder.join(file),
        }
    }

    /// The checkpoint in a folder of the model, `None` if there is no such folder.
    fn part(&self, part: &str) -> std::result::Result<Option<Checkpoint>, CheckpointError> {
        match self {
            Self::Folder(folder) => {
                let folder = folder.join(part);
                folder
                    .is_dir()
                    .then(|| Checkpoint::open(&folder))
                    .transpose()
            }
            Self::Bundled(model) => {
                let found = bundled_checkpoint(*model, part);
                Ok((!found.names().is_empty()).then_some(found))
            }
        }
    }

    fn members(&self) -> std::result::Result<Vec<Member>, LmError> {
        match self {
            Self::Folder(folder) => Ok(open_members(folder)?),
            Self::Bundled(model) => {
                let member = |folder: &&str| Member {
                    tokenizer: bundled_checkpoint(*model, &format!("{folder}tokenizer")),
                    lm: bundled_checkpoint(*model, &format!("{folder}lm")),
                    cut: None,
                };
                Ok(model.files().members.iter().map(member).collect())
            }
        }
    }
}

/// A checkpoint of a bundled model. Its files are not hashed at every start; a test does.
fn bundled_checkpoint(model: BundledModel, part: &str) -> Checkpoint {
    let model = model.files();
    let inside = |(path, bytes): &(&'static str, &'static [u8])| {
        let name = path.strip_prefix(part)?.strip_prefix('/')?;
        Some((name.to_string(), *bytes))
    };
    let named = model.files.iter().filter_map(inside);
    Checkpoint::carried(&Path::new(model.name).join(part), named)
}

/// Size and hash of the files that a model consists of, which distinguish models of one name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fingerprint {
    /// Size of all files, bytes.
    pub bytes: u64,
    /// FNV-1a hash of names and contents.
    pub hash: u64,
}

/// A trained model: radar tokenizers and language models that describe together, how certain they are on recordings, and the
/// files that they came from.
///
/// A [`Captioner`](crate::Captioner) describes with it, and adds what a user teaches or chooses.
///
/// The networks of a folder are loaded at once, so that a damaged folder is named before anything is computed. Those of a
/// bundled model are loaded when they are first asked: a recording of a board that they did not learn is described without
/// them, and clearing and filling their memory would be most of the time to its sentence.
///
/// ```
/// let model = radarllm::Model::bundled()?;
/// assert_eq!(model.name(), "default (embedded)");
/// assert!(model.card()?.is_some_and(|card| card.starts_with("# Model card")));
/// # Ok::<(), radarllm::Error>(())
/// ```
pub struct Model {
    files: ModelFiles,
    name: String,
    options: ModelOptions,
    networks: OnceLock<Captioner>,
    /// Held while the networks are loaded, so that threads that ask at once load them once.
    loading: Mutex<()>,
    confidence: Option<RecordedConfidence>,
}

impl Model {
    /// The model that comes with the library, on the inference engine with 32-bit weights.
    ///
    /// # Errors
    /// If its files do not belong together, which a test excludes.
    pub fn bundled() -> Result<Self> {
        Self::load(ModelFiles::of(None), &ModelOptions::default())
    }

    /// The model in a folder made by training, on the inference engine with 32-bit weights.
    ///
    /// # Errors
    /// A folder that is incomplete or damaged.
    pub fn open(folder: &Path) -> Result<Self> {
        Self::load(ModelFiles::of(Some(folder)), &ModelOptions::default())
    }

    /// Opens a model, and loads its networks if they are in a folder.
    ///
    /// # Errors
    /// Files that are missing, damaged or do not belong together, and what the backend cannot compute.
    pub fn load(files: ModelFiles, options: &ModelOptions) -> Result<Self> {
        let networks = match files {
            ModelFiles::Folder(_) => OnceLock::from(load_networks(&files, options)?),
            ModelFiles::Bundled(_) => OnceLock::new(),
        };
        let file = RecordedConfidence::FILE;
        let confidence = files.optional_text(file)?.map(|text| {
            let parsed = RecordedConfidence::from_toml(&text);
            parsed.map_err(|e| Error::wrap_in_file(&files.path(file), e))
        });
        let mut name = files.name();
        if options.precision == Precision::Int8 {
            name += ", int8";
        }
        Ok(Self {
            confidence: confidence.transpose()?,
            files,
            name,
            options: *options,
            networks,
            loading: Mutex::new(()),
        })
    }

    /// Name in reports: the folder, or `default (embedded)`; with `, int8` after it if the weights are rounded to bytes,
    /// because sentences may differ.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Where the files of the model are.
    pub fn files(&self) -> &ModelFiles {
        &self.files
    }

    /// The networks, which describe batches, tokenize, score sentences and follow instructions.
    ///
    /// # Errors
    /// For a bundled model, what the backend cannot compute; those of a folder are loaded already.
    pub fn networks(&self) -> Result<&Captioner> {
        if let Some(loaded) = self.networks.get() {
            return Ok(loaded);
        }
        let _loading = self.loading.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(loaded) = self.networks.get() {
            return Ok(loaded);
        }
        let loaded = load_networks(&self.files, &self.options)?;
        Ok(self.networks.get_or_init(|| loaded))
    }

    /// How certain the model is on recordings, if that was fitted ([`RecordedConfidence::FILE`]).
    pub fn confidence(&self) -> Option<&RecordedConfidence> {
        self.confidence.as_ref()
    }

    /// The decoder of radar tokens, which makes points of them. It is read at every call.
    ///
    /// # Errors
    /// A model without one, or one that is damaged or belongs to other tokens.
    pub fn points(&self) -> Result<PointDecoder> {
        let place = self.files.path(POINTS);
        let part = |part| self.files.part(part).map_err(Error::wrap);
        let (Some(decoder), Some(tokenizer)) = (part(POINTS)?, part("tokenizer")?) else {
            let missing = "the model has no decoder of radar tokens, which makes points of them";
            return Err(Error::in_file(&place, missing).with_hint(
                "`radarllm train points RECIPE` trains it with the recipe of the model and adds it to the model's folder",
            ));
        };
        PointDecoder::of(&decoder, &tokenizer).map_err(Error::wrap)
    }

    /// The model card, in Markdown, if the model has one (`README.md`).
    ///
    /// # Errors
    /// A file that cannot be read.
    pub fn card(&self) -> Result<Option<String>> {
        match &self.files {
            ModelFiles::Bundled(model) => Ok(Some(model.files().card.into())),
            folder => folder.optional_text(CARD),
        }
    }

    /// Size and hash of the files of all members. They are read at every call.
    ///
    /// # Errors
    /// Files that cannot be read.
    pub fn fingerprint(&self) -> Result<Fingerprint> {
        let (mut bytes, mut hash) = (0, Fnv1a::new());
        let mut add = |name: &str, content: &[u8]| {
            bytes += content.len() as u64;
            hash.write(name.as_bytes());
            hash.write(content);
        };
        match &self.files {
            ModelFiles::Bundled(model) => {
                for (name, content) in model.files().files {
                    add(name, content);
                }
            }
            ModelFiles::Folder(folder) => {
                let mut add = |path: &Path, content: &[u8]| {
                    let name = path.strip_prefix(folder).unwrap_or(path);
                    add(&name.to_string_lossy(), content);
                };
                for member in member_folders(folder) {
                    for part in Member::PARTS {
                        visit_files(&member.join(part), &mut add).map_err(Error::wrap)?;
                    }
                }
                if folder.join(EVIDENCE).is_dir() {
                    visit_files(&folder.join(EVIDENCE), &mut add).map_err(Error::wrap)?;
                }
            }
        }
        let hash = hash.finish();
        Ok(Fingerprint { bytes, hash })
    }
}

/// Loads the networks of a model.
fn load_networks(files: &ModelFiles, options: &ModelOptions) -> Result<Captioner> {
    let members = files.members();
    let networks = members.and_then(|all| {
        let cut = |member| Member {
            cut: options.cut,
            ..member
        };
        let all = all.into_iter().map(cut);
        let networks = Captioner::from_members(all, options.precision, options.backend)?;
        // Without what the language model reads of the radar, nothing else may tell it either.
        match files.part(EVIDENCE)?.filter(|_| options.cut.is_none()) {
            Some(evidence) => Ok(networks.with_evidence(Evidence::of(&evidence)?)),
            None => Ok(networks),
        }
    });
    networks.map_err(|error| match files {
        ModelFiles::Bundled(_) => Error::wrap(error),
        ModelFiles::Folder(folder) => {
            let hint = match error {
                LmError::NotT5 { .. } => text(NOT_T5),
                _ => option("model").text(NO_MODEL),
            };
            Error::wrap_in_file(folder, error).with_hint(hint)
        }
    })
}

/// Hint for a folder that is no model, after the name of the option.
const NO_MODEL: &str = " wants a folder made by `radarllm train all`";
/// Hint for a language model that the inference engine does not run.
const NOT_T5: &str = "a build with training runs other language models, in 32 bits";

#[cfg(test)]
mod tests {
    use super::*;

    /// The folder from which the bundled model is made.
    fn weights() -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../model-default/weights")
    }

    /// Bundled files are not hashed at every start; here they are, once.
    #[test]
    fn checksums_of_the_bundled_files_agree() {
        for (part, weights_file) in [
            ("tokenizer", "model.safetensors"),
            ("lm", "average.safetensors"),
            ("evidence", "model.safetensors"),
            ("member-2/tokenizer", "model.safetensors"),
            ("member-2/lm", "average.safetensors"),
        ] {
            let written = Checkpoint::open(&weights().join(part)).unwrap();
            let bundled = bundled_checkpoint(BundledModel::Features, part);
            assert_eq!(
                written.bytes("config.json").unwrap(),
                bundled.bytes("config.json").unwrap()
            );
            assert_eq!(
                written.tensors(weights_file).unwrap(),
                bundled.tensors(weights_file).unwrap()
            );
        }
    }

    #[test]
    fn the_folder_of_the_bundled_model_is_the_same_model() {
        let (bundled, folder) = (Model::bundled().unwrap(), Model::open(&weights()).unwrap());
        assert_eq!(
            bundled.networks().unwrap().n_params(),
            folder.networks().unwrap().n_params()
        );
        assert_eq!(bundled.confidence(), folder.confidence());
        assert!(bundled.confidence().is_some());
        assert_eq!(bundled.card().unwrap(), folder.card().unwrap());
        assert_eq!(folder.name(), weights().display().to_string());
        // The folder has checksums, too.
        assert!(folder.fingerprint().unwrap().bytes > bundled.fingerprint().unwrap().bytes);
        let int8 = ModelOptions {
            precision: Precision::Int8,
            ..ModelOptions::default()
        };
        let int8 = Model::load(ModelFiles::of(None), &int8).unwrap();
        assert_eq!(int8.name(), "default (embedded), int8");
        for model in [&bundled, &folder] {
            let error = model.points().err().unwrap();
            assert!(error.to_string().contains("no decoder"), "{error}");
            assert!(error.hint.is_some());
        }
    }

    #[test]
    fn bundled_models_are_chosen_by_name_and_folders_by_path() {
        for (name, expected) in [
            (None, ModelFiles::Bundled(BundledModel::Features)),
            (
                Some("features"),
                ModelFiles::Bundled(BundledModel::Features),
            ),
            (Some("tokens"), ModelFiles::Bundled(BundledModel::Tokens)),
            (Some("./tokens"), ModelFiles::Folder("./tokens".into())),
            (
                Some("work/tokens"),
                ModelFiles::Folder("work/tokens".into()),
            ),
        ] {
            assert_eq!(ModelFiles::of(name.map(Path::new)), expected);
        }
    }

    /// The model of the published method: three tasks and instructions, and nothing but tokens.
    #[test]
    fn the_model_tokens_reads_tokens_alone_and_learned_all_tasks() {
        use radarllm_inference::lm::templates::Task;

        let model = Model::load(
            ModelFiles::of(Some(Path::new("tokens"))),
            &ModelOptions::default(),
        );
        let model = model.unwrap();
        assert_eq!(model.name(), "tokens (embedded)");
        let networks = model.networks().unwrap();
        assert_eq!(networks.vocab().layout().n_context, 0);
        for (task, tuned) in [
            (Task::RadarToText, true),
            (Task::TextToRadar, true),
            (Task::RadarPrediction, false),
            (Task::Question, true),
        ] {
            networks.require(task, tuned).unwrap();
        }
        let codes = networks
            .codes_of_sentences(&["a person walks forward"], 1)
            .unwrap();
        let clip = model
            .points()
            .unwrap()
            .decode(&codes[0], 1.0, "a test")
            .unwrap();
        assert_eq!(clip.frames.len(), 4 * codes[0].len());
    }

    #[test]
    fn a_folder_without_a_model_is_named() {
        let error = Model::open(Path::new("no-such-folder")).err().unwrap();
        assert!(error.to_string().starts_with("no-such-folder: "), "{error}");
        assert!(error.hint.unwrap().to_string().ends_with(NO_MODEL));
        let error = ModelFiles::of(None).text("lm/missing.json").unwrap_err();
        assert_eq!(
            error.to_string(),
            "default (embedded)/lm/missing.json: not part of the bundled model"
        );
    }

    #[test]
    fn what_a_carried_checkpoint_lacks_or_has_damaged_is_named() {
        let bytes = bundled::FEATURES
            .file("tokenizer/model.safetensors")
            .unwrap();
        let cut = Checkpoint::carried(
            Path::new("here"),
            [("model.safetensors".to_string(), &bytes[..bytes.len() - 1])],
        );
        let error = cut.tensors("model.safetensors").unwrap_err().to_string();
        assert!(
            error.contains("here/model.safetensors") && error.contains("the header lists"),
            "{error}"
        );
        let error = cut.bytes("config.json").unwrap_err().to_string();
        assert_eq!(error, "here/config.json: missing from the checkpoint");
    }
}
