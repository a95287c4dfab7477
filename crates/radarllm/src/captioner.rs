//! The captioner: a clip in, a sentence out.

use std::path::Path;

use radarllm_base::{Clip, message::option};
use radarllm_files::bounded::{self, MAX_CONFIG_BYTES};
use radarllm_inference::{DescribeOptions, Description, Precision, prepare::prepared};
use radarllm_io::{Error, Result};

use radarllm_teach::{Memory, Recogniser};

use crate::{Choices, RecordedConfidence, bundled, insert_taught};

/// Describes clips with a trained model.
///
/// ```
/// let captioner = radarllm::Captioner::bundled()?;
/// let recording = radarllm::open("builtin:walk?direction=backward").points()?;
/// let description = captioner.describe(&recording.clip)?;
/// assert_eq!(description.segments[0].actions, ["walk"]);
/// # Ok::<(), radarllm::Error>(())
/// ```
pub struct Captioner {
    model: radarllm_inference::Captioner,
    name: String,
    recogniser: Option<Recogniser>,
    choices: Option<Choices>,
    confidence: Option<RecordedConfidence>,
}

impl Captioner {
    /// The model that comes with the library, with 32-bit weights.
    ///
    /// # Errors
    /// If the library was built without it.
    pub fn bundled() -> Result<Self> {
        Self::bundled_with(Precision::F32)
    }

    /// The model that comes with the library.
    ///
    /// # Errors
    /// If the library was built without it.
    pub fn bundled_with(precision: Precision) -> Result<Self> {
        let model = Self::new(bundled::load(precision)?, bundled::NAME.into());
        model.with_confidence_of(None)
    }

    /// A model folder made by training.
    ///
    /// # Errors
    /// A folder that is incomplete or damaged.
    pub fn load(folder: &Path, precision: Precision) -> Result<Self> {
        let model = radarllm_inference::Captioner::load(folder, precision).map_err(|e| {
            Error::wrap_in_file(folder, e)
                .with_hint(option("model").text(" wants a folder made by `radarllm train all`"))
        })?;
        Self::new(model, folder.display().to_string()).with_confidence_of(Some(folder))
    }

    /// The captioner with the calibrated confidence of a model folder, or of the bundled model, if it has one
    /// ([`RecordedConfidence::FILE`]).
    ///
    /// # Errors
    /// A damaged file.
    pub fn with_confidence_of(mut self, folder: Option<&Path>) -> Result<Self> {
        let read = |folder: &Path| -> Result<Option<String>> {
            let path = folder.join(RecordedConfidence::FILE);
            match path.exists() {
                true => bounded::read_text(&path, MAX_CONFIG_BYTES)
                    .map(Some)
                    .map_err(|e| Error::wrap_in_file(&path, e)),
                false => Ok(None),
            }
        };
        let text = match folder {
            Some(folder) => read(folder)?,
            None => bundled::file(RecordedConfidence::FILE)
                .map(|bytes| String::from_utf8_lossy(bytes).into_owned()),
        };
        let path = folder.unwrap_or(Path::new("models/default"));
        let parse = |text: &String| {
            RecordedConfidence::from_toml(text)
                .map_err(|e| Error::wrap_in_file(&path.join(RecordedConfidence::FILE), e))
        };
        self.confidence = text.as_ref().map(parse).transpose()?;
        Ok(self)
    }

    /// A captioner of any backend, with its name for reports.
    pub fn new(model: radarllm_inference::Captioner, name: String) -> Self {
        Self {
            model,
            name,
            recogniser: None,
            choices: None,
            confidence: None,
        }
    }

    /// The captioner with taught activities: where one is recognised, its own sentence is used.
    #[must_use]
    pub fn with_memory(mut self, memory: &Memory) -> Self {
        self.recogniser = Recogniser::new(memory);
        self
    }

    /// The captioner restricted to named activities: a clip gets a sentence of the one that fits best, and the
    /// probabilities of all.
    #[must_use]
    pub fn with_choices(self, choices: Choices) -> Self {
        Self {
            choices: Some(choices),
            ..self
        }
    }

    /// Name of the model in reports: its folder, or `default (embedded)`.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The captioner below, which describes batches and tokenizes.
    pub fn model(&self) -> &radarllm_inference::Captioner {
        &self.model
    }

    /// Describes a clip by a vote of drawn sentences. The clip is prepared for the model: resampled to its frame rate and, if recorded,
    /// without static clutter.
    ///
    /// # Errors
    /// Values that are not finite, or an impossible frame rate.
    pub fn describe(&self, clip: &Clip) -> Result<Description> {
        self.describe_with(clip, &DescribeOptions::default())
    }

    /// Describes a clip.
    ///
    /// # Errors
    /// As [`Self::describe`].
    pub fn describe_with(&self, clip: &Clip, options: &DescribeOptions) -> Result<Description> {
        let clip = prepared(clip).map_err(Error::wrap)?;
        let mut description = self.model.describe(&clip, options).map_err(Error::wrap)?;
        match (&self.choices, &self.confidence) {
            (Some(choices), _) => self.choose(&clip, choices, options, &mut description)?,
            (None, Some(confidence)) => confidence.apply(&clip, &mut description),
            (None, None) => {}
        }
        if let Some(recogniser) = &self.recogniser {
            insert_taught(&mut description, &clip, recogniser);
        }
        Ok(description)
    }
}
