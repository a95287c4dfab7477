//! Settings of the language-model stages.

use std::path::PathBuf;

use radarllm_inference::lm::templates::Task;
use radarllm_inference::lm::{Backbone, LmConfig, LmError, LmPreset, NetworkConfig};
use radarllm_nn::precision::ProductPrecision;
use radarllm_nn::pretrained::LoraConfig;
use serde::{Deserialize, Serialize};

use super::examples::LmStageKind;
use crate::adamw::AdamWConfig;
use crate::harness::{LoopConfig, TrainError};
use crate::loop_config::{check_count, check_weight};

/// One weight for each task.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TaskWeights {
    /// Span masking on radar codes; pretraining only.
    pub radar_prediction: f64,
    /// A caption from codes, the main task.
    pub radar_to_text: f64,
    /// Codes from a caption.
    pub text_to_radar: f64,
    /// Length from a caption; instruction tuning only.
    pub text_to_length: f64,
    /// Length from codes; instruction tuning only.
    pub radar_to_length: f64,
    /// The remaining codes of a motion from its first ones; instruction tuning only.
    pub continuation: f64,
    /// Answers to questions about a motion ([`radarllm_inference::lm::questions`]); instruction tuning only.
    #[serde(skip_serializing_if = "is_one")]
    pub question: f64,
    /// Span masking on [`LmTrainConfig::sentences`]; pretraining only, and only if there are any.
    #[serde(skip_serializing_if = "is_one")]
    pub text_prediction: f64,
}

impl Default for TaskWeights {
    fn default() -> Self {
        Self {
            radar_prediction: 1.0,
            radar_to_text: 1.0,
            text_to_radar: 1.0,
            text_to_length: 1.0,
            radar_to_length: 1.0,
            continuation: 1.0,
            question: 1.0,
            text_prediction: 1.0,
        }
    }
}

impl TaskWeights {
    /// Returns the weight of a task.
    pub fn of(&self, task: Task) -> f64 {
        match task {
            Task::RadarPrediction => self.radar_prediction,
            Task::RadarToText => self.radar_to_text,
            Task::TextToRadar => self.text_to_radar,
            Task::TextToLength => self.text_to_length,
            Task::RadarToLength => self.radar_to_length,
            Task::Continuation => self.continuation,
            Task::Question => self.question,
            Task::TextPrediction => self.text_prediction,
        }
    }
}

/// What the codes of the language model are codes of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CodeSource {
    /// The radar tokenizer's, of the points of a clip.
    #[default]
    Radar,
    /// The motion VQ-VAE's, of the true motion of a clip.
    Motion,
    /// The motion VQ-VAE's, of the motion that a pose network estimates from the points. Each training clip is estimated by a
    /// network that was trained on the other half of the motions.
    EstimatedMotion,
    /// None: pictures of range, velocity and azimuth over time are features of codes that are all alike
    /// ([`crate::pictures`]).
    Pictures,
}

impl CodeSource {
    /// Whether these are the codes of the radar tokenizer.
    pub fn is_radar(&self) -> bool {
        *self == Self::Radar
    }
}

/// Settings of pretraining or instruction tuning.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LmTrainConfig {
    /// Architecture of a new network, or of the one that is loaded.
    pub backbone: Backbone,
    /// Size of a new network; ignored if a network is given or loaded. GPT-2 and Qwen2 support `tiny`, `small` and
    /// `medium`.
    pub preset: LmPreset,
    /// Overrides whether the network has a continuous bypass, which the preset defines.
    pub bypass: Option<bool>,
    /// What the codes are codes of; instruction tuning goes on with those of pretraining.
    #[serde(skip_serializing_if = "CodeSource::is_radar")]
    pub codes: CodeSource,
    /// Codes in prompts are read as their projected vectors alone; their ids are only written. It needs `bypass`. T5 only.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub projected: bool,
    /// The network is told the context of a clip ([`radarllm_inference::tokenizer::context`]). A T5 that was trained
    /// without gets new rows for it.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub context: bool,
    /// Overrides whether the input and output embeddings of a new T5 are tied. With tied embeddings, the logits change
    /// `d_model^0.5` times more slowly at the same learning rate.
    pub tie_embeddings: Option<bool>,
    /// Overrides the preset's dropout.
    pub dropout: Option<f64>,
    /// Folder of a pretrained network in Hugging Face layout, from which training starts.
    #[serde(rename = "from", alias = "hf_folder")]
    pub hf_folder: Option<PathBuf>,
    /// Trains only adapters, the embeddings of new ids and the bypass. Available for GPT-2 and Qwen2 that start from a
    /// folder.
    pub lora: Option<LoraConfig>,
    /// Precision of matrix products. All other operations are in f32.
    pub precision: ProductPrecision,
    /// Number of sequences in a batch.
    pub batch: usize,
    /// Number of examples drawn from a motion in an epoch; 0 takes one for each of its captions.
    pub samples_per_clip: usize,
    /// Number of captions per training motion, the first ones; 0 uses all.
    pub captions_per_motion: usize,
    /// Probability that an example's caption is replaced by a sentence that is written from the caption's facts, another
    /// one each time ([`radarllm_facts::write`]); 0 uses the captions as they are. A caption without a known action stays
    /// as it is.
    #[serde(skip_serializing_if = "is_zero")]
    pub rewrite_captions: f64,
    /// Files of sentences without motions, from which the language model learns to complete masked sentences: UTF-8 text
    /// with a sentence on each line ([`super::sentences`]). Pretraining only.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub sentences: Vec<PathBuf>,
    /// Probability that an example of instruction tuning has the first prompt of its task, which is that of pretraining and
    /// of `describe`, and not one of all.
    #[serde(skip_serializing_if = "is_zero")]
    pub first_prompt: f64,
    /// Relative sampling frequency of each task.
    pub sampling: TaskWeights,
    /// Factor on the loss of each task (the paper's lambdas).
    pub lambda: TaskWeights,
    /// Label smoothing: share of the target probability that is spread over the whole vocabulary.
    pub label_smoothing: f64,
    /// Weight of the contrastive loss between the encoder's states of a clip's codes and of its caption
    /// ([`super::contrast`]); 0 disables it (paper). T5 only.
    pub contrastive_weight: f64,
    /// Temperature of the contrastive loss, by which the cosines are divided.
    pub contrastive_temperature: f64,
    /// Trains half of the examples on the mirrored clip, with left and right exchanged in the caption.
    pub flip: bool,
    /// Share of codes masked in radar prediction, and least share of words masked in sentences: their share is drawn
    /// between this and 1, so that the decoder learns to repair sentences and to write them.
    pub mask_share: f64,
    /// Mean length of a masked span, codes or words.
    pub mask_span: f64,
    /// Probability that an input code is replaced by a random one and its feature is dropped.
    pub replace_code: f64,
    /// Probability that an input code, or a token of the context, is dropped.
    pub drop_code: f64,
    /// Standard deviation of the noise added to features, relative to their rms.
    pub feature_noise: f64,
    /// Decay of the moving average of the weights used for validation and inference; 0 disables it.
    pub average_decay: f64,
    /// Number of validation motions decoded for the quick ROUGE-L; 0 disables it.
    pub quick_score_clips: usize,
    /// Settings of the training loop.
    #[serde(rename = "loop")]
    pub run: LoopConfig,
}

fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

fn is_one(value: &f64) -> bool {
    *value == 1.0
}

impl Default for LmTrainConfig {
    fn default() -> Self {
        Self::small()
    }
}

impl LmTrainConfig {
    /// Settings for pretraining the small preset on one core.
    pub fn small() -> Self {
        Self {
            backbone: Backbone::T5,
            preset: LmPreset::Small,
            bypass: None,
            codes: CodeSource::Radar,
            projected: false,
            context: false,
            tie_embeddings: None,
            dropout: None,
            hf_folder: None,
            lora: None,
            precision: ProductPrecision::F32,
            batch: 32,
            samples_per_clip: 0,
            captions_per_motion: 0,
            rewrite_captions: 0.0,
            sentences: Vec::new(),
            first_prompt: 0.0,
            sampling: TaskWeights::default(),
            lambda: TaskWeights::default(),
            label_smoothing: 0.1,
            contrastive_weight: 0.0,
            contrastive_temperature: 0.1,
            flip: true,
            mask_share: 0.15,
            mask_span: 3.0,
            replace_code: 0.05,
            drop_code: 0.05,
            feature_noise: 0.1,
            average_decay: 0.999,
            quick_score_clips: 64,
            run: LoopConfig {
                learning_rate: 1e-3,
                epochs: 60,
                warmup_steps: 200,
                log_every: 50,
                adamw: AdamWConfig {
                    weight_decay: 0.01,
                    ..AdamWConfig::default()
                },
                ..LoopConfig::default()
            },
        }
    }

    /// Settings for pretraining as stated in the paper.
    pub fn paper() -> Self {
        Self {
            preset: LmPreset::T5Small,
            batch: 16,
            label_smoothing: 0.0,
            flip: false,
            replace_code: 0.0,
            drop_code: 0.0,
            feature_noise: 0.0,
            average_decay: 0.0,
            run: LoopConfig {
                learning_rate: 2e-4,
                epochs: 300,
                adamw: AdamWConfig {
                    beta_2: 0.999,
                    ..AdamWConfig::default()
                },
                ..LoopConfig::default()
            },
            ..Self::small()
        }
    }

    /// Settings for instruction tuning as stated in the paper: the learning rate of pretraining, for a third of its epochs.
    pub fn paper_instruction() -> Self {
        let paper = Self::paper();
        let learning_rate = paper.run.learning_rate;
        let mut tuning = paper.for_instruction();
        tuning.run.learning_rate = learning_rate;
        tuning
    }

    /// Returns the same settings for instruction tuning: half of the examples are of the main task, the learning rate
    /// is halved, and the number of epochs is a third.
    pub fn for_instruction(mut self) -> Self {
        self.sampling = TaskWeights {
            radar_to_text: 4.0,
            ..TaskWeights::default()
        };
        self.run.learning_rate *= 0.5;
        self.run.epochs = self.run.epochs.div_ceil(3);
        self
    }

    /// Tasks of a stage that have examples with a loss.
    pub fn trained_tasks(&self, kind: LmStageKind) -> impl Iterator<Item = Task> {
        let tasks = kind.tasks().iter().copied();
        tasks.filter(|task| {
            let has_examples = *task != Task::TextPrediction || !self.sentences.is_empty();
            has_examples && self.sampling.of(*task) > 0.0 && self.lambda.of(*task) > 0.0
        })
    }

    /// Returns the configuration of the network.
    ///
    /// # Errors
    /// If the backbone does not have this preset.
    pub fn lm_config(&self, n_codes: usize, code_dim: usize) -> Result<LmConfig, LmError> {
        let mut config = self.backbone.config(self.preset, n_codes, code_dim)?;
        config.bypass = self.bypass.unwrap_or(config.bypass);
        config.projected = self.projected;
        if let (Some(tie), NetworkConfig::T5(t5)) = (self.tie_embeddings, &mut config.network) {
            t5.tie_embeddings = tie;
        }
        if let Some(dropout) = self.dropout {
            config.network.set_dropout(dropout);
        }
        Ok(config)
    }

    /// Checks every field.
    ///
    /// # Errors
    /// Names the first field that cannot be used.
    pub fn validate(&self) -> Result<(), TrainError> {
        self.run.validate()?;
        let fail = |field: &str, problem: &str| Err(TrainError::config(field, problem));
        if self.hf_folder.is_none() {
            self.backbone.config(self.preset, 1, 1)?;
        }
        if let Some(lora) = &self.lora {
            lora.validate()?;
            if self.backbone == Backbone::T5 {
                return fail("lora", "T5 is trained whole; gpt2 and qwen2 take adapters");
            }
        }
        if self.tie_embeddings.is_some()
            && (self.backbone != Backbone::T5 || self.hf_folder.is_some())
        {
            return fail("tie_embeddings", "is a choice for a new t5 only");
        }
        if self.projected && (self.backbone != Backbone::T5 || self.bypass != Some(true)) {
            return fail("projected", "needs backbone = \"t5\" and bypass = true");
        }
        if self.codes == CodeSource::Pictures {
            let of_codes = [
                self.sampling.text_to_radar,
                self.sampling.radar_prediction,
                self.sampling.continuation,
            ];
            if !self.projected || of_codes != [0.0; 3] {
                let problem = "= \"pictures\" needs projected = true, and no task that writes codes: text_to_radar, \
                               radar_prediction and continuation are 0 in `sampling`";
                return fail("codes", problem);
            }
        }
        if !self.codes.is_radar() && (self.context || self.hf_folder.is_some()) {
            return fail(
                "codes",
                "of motions have no context and train a new network",
            );
        }
        if self.context && self.hf_folder.is_some() {
            return fail("context", "is no choice for a pretrained network");
        }
        check_count("batch", self.batch, 65_536)?;
        if self.samples_per_clip > 10_000 {
            return fail("samples_per_clip", "must be at most 10000");
        }
        for (field, share) in [
            ("label_smoothing", self.label_smoothing),
            ("replace_code", self.replace_code),
            ("drop_code", self.drop_code),
            ("average_decay", self.average_decay),
            ("dropout", self.dropout.unwrap_or(0.0)),
        ] {
            if !(0.0..1.0).contains(&share) {
                return fail(field, "must be in 0..1");
            }
        }
        for (field, probability) in [
            ("rewrite_captions", self.rewrite_captions),
            ("first_prompt", self.first_prompt),
        ] {
            if !(0.0..=1.0).contains(&probability) {
                return fail(field, "must be in 0..=1");
            }
        }
        if !(self.mask_share > 0.0 && self.mask_share < 1.0) {
            return fail("mask_share", "must be above 0 and below 1");
        }
        if !(self.mask_span >= 1.0 && self.mask_span.is_finite()) {
            return fail("mask_span", "must be at least 1");
        }
        check_weight("contrastive_weight", self.contrastive_weight)?;
        if self.contrastive_weight > 0.0 && self.backbone != Backbone::T5 {
            let problem = "needs an encoder that reads codes and captions alike, which only t5 has";
            return fail("contrastive_weight", problem);
        }
        if !(self.contrastive_temperature > 0.0 && self.contrastive_temperature <= 100.0) {
            return fail("contrastive_temperature", "must be above 0 and at most 100");
        }
        check_weight("feature_noise", self.feature_noise)?;
        for (field, weights) in [("sampling", &self.sampling), ("lambda", &self.lambda)] {
            let all = Task::INSTRUCTION.into_iter().chain(Task::PRETRAINING);
            if !all
                .map(|t| weights.of(t))
                .all(|w| w.is_finite() && w >= 0.0)
            {
                return fail(field, "weights must be finite and not negative");
            }
            if weights.radar_to_text <= 0.0 {
                return fail(field, "radar_to_text must be positive: it is the main task");
            }
        }
        Ok(())
    }
}
