//! Architecture of the radar tokenizer.

use serde::{Deserialize, Serialize};

/// Placement of the anchors.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum AnchorMode {
    /// A rigid body-sized grid that follows the person.
    Template,
    /// Farthest-point sampling of each frame's points (ablation).
    FarthestPoint,
}

/// Smoothing of the centre over time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CentreSmoothing {
    /// Exponential moving average; lags behind a walking person by speed x period x (1 - a) / a.
    Causal,
    /// Mean of the averages run forwards and backwards, whose lags cancel.
    Symmetric,
}

/// Grouping of points around anchors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GroupingConfig {
    /// Placement of the anchors.
    pub anchors: AnchorMode,
    /// Anchors along x, y, z.
    pub counts: [usize; 3],
    /// Distance between anchors along x, y, z, m.
    pub step_m: [f32; 3],
    /// Height of the lowest anchors above the floor, m. In x and y the grid is centred.
    pub z_min_m: f32,
    /// Maximum distance of a neighbour from its anchor, m.
    pub radius_m: f32,
    /// Nearest neighbours kept per anchor and frame.
    pub k_per_frame: usize,
    /// Strongest points kept per frame.
    pub max_points: usize,
    /// Points farther than this from the tracked centre do not move it, m.
    pub gate_m: f32,
    /// Weight of a new centre in the moving average.
    pub centre_rate: f32,
    /// Kind of moving average.
    pub centre_smoothing: CentreSmoothing,
}

/// Architecture of the tokenizer network. There are 10 radar frames per second. A step has 2 frames, and a code has 4.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TokenizerConfig {
    /// Grouping of points around anchors.
    pub grouping: GroupingConfig,
    /// Channels C.
    pub width: usize,
    /// Factorised transformer layers.
    pub layers: usize,
    /// Attention heads.
    pub heads: usize,
    /// Hidden width of the feed-forward part, in units of C.
    pub ffn_ratio: usize,
    /// Queries of the attention pooling over anchors.
    pub pool_queries: usize,
    /// Number of channels of every anchor that are concatenated for the code, each with its own weights, in addition to
    /// the attention pooling; 0 pools by attention alone (paper). Not used with farthest-point anchors, which have no
    /// fixed positions.
    pub pool_per_anchor: usize,
    /// Add a profile of velocities, heights and sides of each step ([`super::doppler_profile`]) after the anchors; not
    /// in the paper.
    pub doppler_profile: bool,
    /// Add to each tube its number of points and mean velocity, which maximum pooling cannot represent.
    pub tube_statistics: bool,
    /// Width of a code.
    pub code_dim: usize,
    /// Number of codes K.
    pub codebook_size: usize,
    /// Number of codes of a second codebook, which is fitted to what the first one leaves of the features
    /// ([`super::residual`]). With it, a step has two codes, and the sum of their vectors takes the place of the feature. 0:
    /// one code, as in the paper.
    #[serde(skip_serializing_if = "is_zero")]
    pub residual_codes: usize,
    /// If false, features are passed on without quantization (ablation). Codes are still assigned.
    pub quantize: bool,
    /// Points predicted per masked tube.
    pub reconstruction_points: usize,
    /// Predict radial velocity in addition to position.
    pub reconstruct_velocity: bool,
    /// Width of the motion teacher's features; 0 trains without a teacher.
    pub guidance_dim: usize,
    /// Number of caption words that are predicted in training (not in the paper). 0 disables this task.
    pub caption_words: usize,
    /// Number of codes of the motion teacher, one of which is predicted in training (not in the paper). 0 disables this
    /// task.
    pub motion_codes: usize,
}

fn is_zero(value: &usize) -> bool {
    *value == 0
}

/// Maximum length of a clip, radar frames.
pub const MAX_FRAMES: usize = 96;
/// Radar frames per code.
pub const FRAMES_PER_CODE: usize = 4;
/// Radar frames per step.
pub const FRAMES_PER_STEP: usize = 2;
/// Number of steps of the longest clip.
pub const MAX_STEPS: usize = MAX_FRAMES / FRAMES_PER_STEP;

impl Default for GroupingConfig {
    fn default() -> Self {
        Self {
            anchors: AnchorMode::Template,
            counts: [3, 3, 6],
            step_m: [0.3, 0.3, 0.36],
            z_min_m: 0.05,
            radius_m: 0.45,
            k_per_frame: 8,
            max_points: 128,
            gate_m: 1.0,
            centre_rate: 0.3,
            centre_smoothing: CentreSmoothing::Symmetric,
        }
    }
}

impl Default for TokenizerConfig {
    fn default() -> Self {
        Self::small()
    }
}

impl TokenizerConfig {
    /// A configuration that can be trained on one CPU core: 54 anchors, 64 channels, 2 layers.
    pub fn small() -> Self {
        Self {
            grouping: GroupingConfig::default(),
            width: 64,
            layers: 2,
            heads: 4,
            ffn_ratio: 2,
            pool_queries: 4,
            pool_per_anchor: 8,
            doppler_profile: true,
            tube_statistics: true,
            code_dim: 128,
            codebook_size: 512,
            residual_codes: 0,
            quantize: true,
            reconstruction_points: 8,
            reconstruct_velocity: true,
            guidance_dim: 128,
            caption_words: 0,
            motion_codes: 0,
        }
    }

    /// The paper's sizes with the published grid of mmMesh: 81 anchors, 256 channels, 4 layers,
    /// 512 codes of 512.
    pub fn paper() -> Self {
        Self {
            grouping: GroupingConfig {
                counts: [3, 3, 9],
                step_m: [0.3; 3],
                z_min_m: -0.3,
                k_per_frame: 16,
                centre_smoothing: CentreSmoothing::Causal,
                ..GroupingConfig::default()
            },
            width: 256,
            layers: 4,
            heads: 8,
            ffn_ratio: 4,
            pool_queries: 1,
            pool_per_anchor: 0,
            doppler_profile: false,
            tube_statistics: false,
            code_dim: 512,
            codebook_size: 512,
            residual_codes: 0,
            quantize: true,
            reconstruction_points: 16,
            reconstruct_velocity: false,
            guidance_dim: 512,
            caption_words: 0,
            motion_codes: 0,
        }
    }

    /// Number of anchors.
    pub fn n_anchors(&self) -> usize {
        self.grouping.counts.iter().product()
    }

    /// [`Self::pool_per_anchor`] if anchors have fixed positions, otherwise 0.
    pub fn per_anchor_channels(&self) -> usize {
        match self.grouping.anchors {
            AnchorMode::Template => self.pool_per_anchor,
            AnchorMode::FarthestPoint => 0,
        }
    }

    /// Number of values per predicted point: anchor-relative position, and velocity if configured.
    pub fn reconstruction_dim(&self) -> usize {
        if self.reconstruct_velocity { 4 } else { 3 }
    }

    /// Checks every field. The limits are far above any practical value and prevent a hostile file from requesting
    /// terabytes.
    ///
    /// # Errors
    /// Names the first invalid field.
    pub fn validate(&self) -> Result<(), String> {
        let g = &self.grouping;
        for (field, value, max) in [
            ("grouping.counts[0]", g.counts[0], 16),
            ("grouping.counts[1]", g.counts[1], 16),
            ("grouping.counts[2]", g.counts[2], 32),
            ("grouping.k_per_frame", g.k_per_frame, 128),
            ("grouping.max_points", g.max_points, 4096),
            ("width", self.width, 2048),
            ("layers", self.layers, 32),
            ("heads", self.heads, 64),
            ("ffn_ratio", self.ffn_ratio, 16),
            ("pool_queries", self.pool_queries, 16),
            ("code_dim", self.code_dim, 4096),
            ("codebook_size", self.codebook_size, 65_536),
            ("reconstruction_points", self.reconstruction_points, 128),
        ] {
            if value == 0 || value > max {
                return Err(format!("{field}: must be in 1..={max}, found {value}"));
            }
        }
        if self.n_anchors() > 512 {
            return Err(format!(
                "grouping.counts: at most 512 anchors, found {}",
                self.n_anchors()
            ));
        }
        for (field, value, max) in [
            ("guidance_dim", self.guidance_dim, 4096),
            ("caption_words", self.caption_words, 4096),
            ("pool_per_anchor", self.pool_per_anchor, 4096),
            ("motion_codes", self.motion_codes, 65_536),
            ("residual_codes", self.residual_codes, 65_536),
        ] {
            if value > max {
                return Err(format!("{field}: at most {max}, found {value}"));
            }
        }
        if !self.width.is_multiple_of(self.heads) {
            return Err(format!(
                "width: {} is not a multiple of {} heads",
                self.width, self.heads
            ));
        }
        for (field, value) in [
            ("grouping.step_m[0]", g.step_m[0]),
            ("grouping.step_m[1]", g.step_m[1]),
            ("grouping.step_m[2]", g.step_m[2]),
            ("grouping.radius_m", g.radius_m),
            ("grouping.gate_m", g.gate_m),
            ("grouping.centre_rate", g.centre_rate),
        ] {
            if !(value > 0.0 && value <= 100.0) {
                return Err(format!(
                    "{field}: must be in 0..=100 and positive, found {value}"
                ));
            }
        }
        if g.centre_rate > 1.0 || !g.z_min_m.is_finite() || g.z_min_m.abs() > 10.0 {
            return Err("grouping.centre_rate must be at most 1, z_min_m within 10 m".into());
        }
        Ok(())
    }
}
