//! Settings of the stage `tokenizer`.

use radarllm_inference::tokenizer::TokenizerConfig;
pub use radarllm_inference::tokenizer::grouping::Hides;
use radarllm_nn::tokenizer::codebook::CodebookConfig;
use serde::{Deserialize, Serialize};

use crate::chamfer::ChamferSide;
use crate::data::AugmentConfig;
use crate::harness::{LoopConfig, TrainError};
use crate::loop_config::{check_count, check_weight};

/// Which tubes are reconstructed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Reconstruct {
    /// The masked tubes.
    Masked,
    /// Masked and visible tubes (ablation).
    All,
    /// None (ablation).
    Nothing,
}

/// Update rule of the codebook.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CodebookUpdate {
    /// Moving averages of the features assigned to a code.
    MovingAverage,
    /// The codebook term of the paper's commitment loss.
    Gradient,
}

/// How a feature finds its code.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Lookup {
    /// The nearest code (paper).
    #[default]
    Distance,
    /// The code of the largest cosine: features and codes have unit length (Yu et al., Vector-quantized Image Modeling with
    /// Improved VQGAN, ICLR 2022). Use it with a `model.code_dim` of 8 to 32.
    Cosine,
}

/// How the gradient of a code reaches the feature that it replaces.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CodeGradient {
    /// Copied (straight-through estimator; paper).
    #[default]
    Copy,
    /// Turned and scaled by the map that takes the feature to its code, so that features on different sides of a code are
    /// moved in different directions (Fifty et al., Restructuring Vector Quantization with the Rotation Trick, ICLR 2025).
    Rotate,
}

/// Features that are supervised by the motion teacher and by the caption words.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GuidanceOn {
    /// Before quantization (paper).
    Features,
    /// Before and after quantization, with half the weight each, so that the codes themselves represent the motion.
    FeaturesAndCodes,
}

/// Settings of masking and of the loss terms.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TokenizerLossConfig {
    /// Share of anchor trajectories that is masked; 0 disables masking (ablation).
    pub mask_ratio: f64,
    /// Share of the clips that is masked at all. Inference uses no mask, so some clips are trained without one.
    pub masked_clips: f64,
    /// Which points a mask hides: `tubes`, `nearest` or `reach`; see [`Hides`].
    pub hides: Hides,
    /// Which tubes are reconstructed.
    pub reconstruct: Reconstruct,
    /// Chamfer distance: one-sided or symmetric.
    pub chamfer: ChamferSide,
    /// Maximum number of tubes reconstructed per clip, drawn at random.
    pub tubes_per_clip: usize,
    /// Maximum number of target points per tube, drawn at random.
    pub targets_per_tube: usize,
    /// Weight of the reconstruction loss.
    pub reconstruction_weight: f64,
    /// Weight of the motion guidance; 0 disables it (ablation).
    pub guidance_weight: f64,
    /// Features that are compared with the teacher's.
    pub guidance_on: GuidanceOn,
    /// Weight of the caption words (see [`crate::caption_words`]); 0 disables them (paper).
    pub words_weight: f64,
    /// Additional weight of the words "left" and "right"; 0 treats them as any other word (paper: no caption words).
    pub sides_weight: f64,
    /// Weight of the cross-entropy of the motion teacher's code for each radar code; 0 disables it (paper).
    pub motion_codes_weight: f64,
    /// Weight of the captions that a small language model writes from the codes alone, and whose cross-entropy reaches the
    /// tokenizer through the codes ([`crate::code_captions`]); 0 disables it (paper).
    #[serde(skip_serializing_if = "is_zero")]
    pub captions_weight: f64,
    /// Weight of the term that spreads the features of a batch over the unit sphere, so that they need many codes (the
    /// uniformity of Wang and Isola, Understanding Contrastive Representation Learning, ICML 2020); 0 disables it (paper).
    /// Only with `lookup = "cosine"`.
    #[serde(skip_serializing_if = "is_zero")]
    pub spread_weight: f64,
    /// Weight of the commitment loss.
    pub commit_weight: f64,
    /// How a feature finds its code.
    #[serde(skip_serializing_if = "is_default")]
    pub lookup: Lookup,
    /// How the gradient of a code reaches its feature.
    #[serde(skip_serializing_if = "is_default")]
    pub code_gradient: CodeGradient,
    /// Update rule of the codebook.
    pub codebook_update: CodebookUpdate,
}

fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

impl Default for TokenizerLossConfig {
    fn default() -> Self {
        Self {
            mask_ratio: 0.5,
            masked_clips: 0.5,
            hides: Hides::Nearest,
            reconstruct: Reconstruct::Masked,
            chamfer: ChamferSide::Symmetric,
            tubes_per_clip: 48,
            targets_per_tube: 12,
            reconstruction_weight: 1.0,
            guidance_weight: 1.0,
            guidance_on: GuidanceOn::FeaturesAndCodes,
            words_weight: 0.05,
            sides_weight: 0.0,
            motion_codes_weight: 0.0,
            captions_weight: 0.0,
            spread_weight: 0.0,
            commit_weight: 0.02,
            lookup: Lookup::default(),
            code_gradient: CodeGradient::default(),
            codebook_update: CodebookUpdate::MovingAverage,
        }
    }
}

impl TokenizerLossConfig {
    /// Whether a loss term needs the motion teacher.
    pub fn needs_teacher(&self) -> bool {
        self.guidance_weight > 0.0 || self.motion_codes_weight > 0.0
    }
}

/// Settings of the stage.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TokenizerTrainConfig {
    /// Clips per batch.
    pub batch_size: usize,
    /// Maximum number of clips used for validation.
    pub validate_clips: usize,
    /// Settings of the network.
    pub model: TokenizerConfig,
    /// Masking and loss terms.
    pub loss: TokenizerLossConfig,
    /// Settings of the codebook.
    pub codebook: CodebookConfig,
    /// Augmentation of the points.
    pub augment: AugmentConfig,
    /// Settings of the training loop.
    #[serde(rename = "loop")]
    pub run: LoopConfig,
}

impl Default for TokenizerTrainConfig {
    fn default() -> Self {
        Self {
            batch_size: 16,
            validate_clips: 200,
            model: TokenizerConfig::default(),
            loss: TokenizerLossConfig::default(),
            codebook: CodebookConfig::default(),
            augment: AugmentConfig::default(),
            run: LoopConfig::default(),
        }
    }
}

impl TokenizerTrainConfig {
    /// The sizes and the loss as printed in the paper: all clips half masked, one-sided Chamfer distance, guidance
    /// before quantization, two-term commitment loss of weight 1, no augmentation.
    pub fn paper() -> Self {
        Self {
            model: TokenizerConfig::paper(),
            loss: TokenizerLossConfig {
                masked_clips: 1.0,
                chamfer: ChamferSide::TargetToPrediction,
                guidance_on: GuidanceOn::Features,
                words_weight: 0.0,
                sides_weight: 0.0,
                commit_weight: 1.0,
                codebook_update: CodebookUpdate::Gradient,
                ..TokenizerLossConfig::default()
            },
            augment: AugmentConfig::none(),
            ..Self::default()
        }
    }

    /// Checks every field.
    ///
    /// # Errors
    /// Names the first field that cannot be used.
    pub fn validate(&self) -> Result<(), TrainError> {
        let fail = |field: &str, problem: String| Err(TrainError::config(field, problem));
        self.run.validate()?;
        check_count("batch_size", self.batch_size, 4096)?;
        if self.model.residual_codes > 0 {
            return fail(
                "model.residual_codes",
                "a second codebook is fitted to a trained tokenizer: `radarllm lm tokens \
                 --residual-codes`"
                    .into(),
            );
        }
        let loss = &self.loss;
        for (field, value) in [
            ("loss.mask_ratio", loss.mask_ratio),
            ("loss.masked_clips", loss.masked_clips),
        ] {
            if !(0.0..=1.0).contains(&value) {
                return fail(field, format!("must be in 0..=1, found {value}"));
            }
        }
        for (field, value) in [
            ("loss.reconstruction_weight", loss.reconstruction_weight),
            ("loss.guidance_weight", loss.guidance_weight),
            ("loss.words_weight", loss.words_weight),
            ("loss.sides_weight", loss.sides_weight),
            ("loss.motion_codes_weight", loss.motion_codes_weight),
            ("loss.captions_weight", loss.captions_weight),
            ("loss.spread_weight", loss.spread_weight),
            ("loss.commit_weight", loss.commit_weight),
        ] {
            check_weight(field, value)?;
        }
        if loss.tubes_per_clip == 0 || loss.targets_per_tube == 0 {
            return fail(
                "loss.tubes_per_clip",
                "tubes and targets must be at least 1".into(),
            );
        }
        if loss.reconstruct == Reconstruct::Masked && loss.mask_ratio * loss.masked_clips == 0.0 {
            let problem = "`masked` reconstructs nothing without masking; use `all` or `nothing`";
            return fail("loss.reconstruct", problem.into());
        }
        if !self.model.quantize && loss.captions_weight > 0.0 {
            let problem = "captions are written from codes, and `model.quantize` is false";
            return fail("loss.captions_weight", problem.into());
        }
        if loss.lookup == Lookup::Cosine && loss.codebook_update == CodebookUpdate::Gradient {
            let problem = "`cosine` needs a codebook that is updated by moving averages";
            return fail("loss.lookup", problem.into());
        }
        if loss.lookup != Lookup::Cosine && loss.spread_weight > 0.0 {
            let problem = "needs features of unit length, which `loss.lookup = \"cosine\"` makes";
            return fail("loss.spread_weight", problem.into());
        }
        let config = |field: &str, problem: String| TrainError::config(field, problem);
        self.model.validate().map_err(|p| config("model", p))?;
        self.augment.validate().map_err(|p| config("augment", p))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_training_makes_one_codebook() {
        let mut config = TokenizerTrainConfig::default();
        config.validate().unwrap();
        config.model.residual_codes = 512;
        let error = config.validate().unwrap_err().to_string();
        assert!(error.contains("model.residual_codes"), "{error}");
        assert!(error.contains("--residual-codes"), "{error}");
    }
}
