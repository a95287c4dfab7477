//! One clip of a radar-text data set.

use radarllm_base::PointFrame;
use serde::{Deserialize, Serialize};

/// The part of the data set that a clip belongs to. Splits are made by group, never by clip.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Split {
    /// Training set: used for fitting.
    Train,
    /// Validation set: used for model selection.
    Val,
    /// Test set: used once, for reporting.
    Test,
}

/// Width of a HumanML3D motion feature vector.
pub const MOTION_FEATURE_DIM: usize = 263;

/// [`ClipRecord::source`] of recorded radar.
pub const RECORDINGS: &str = "recordings";

/// One simulation (or recording) of one captioned motion.
#[derive(Clone, Debug, PartialEq)]
pub struct ClipRecord {
    /// Unique: `<motion id>#<variant>`.
    pub id: String,
    /// The motion this clip shows; all variants share it.
    pub motion_id: String,
    /// Group of motions that must be in the same split (same take, same actor block, mirrored copies).
    pub group: String,
    /// Split, the same for all clips of a group.
    pub split: Split,
    /// Action label, for example `walk`.
    pub action: String,
    /// Reference captions; at least one.
    pub captions: Vec<String>,
    /// Source of the motion: `procedural`, `bandai-namco`, ...
    pub source: String,
    /// Radar name.
    pub radar: String,
    /// Height of the radar above the floor, m.
    pub radar_height_m: f32,
    /// Seed of this clip's simulation.
    pub seed: u64,
    /// Radar frames at the radar's rate (10 per second for the reference radar), radar frame axes.
    pub frames: Vec<PointFrame>,
    /// Rate of `joints` and `motion_features`, 1/s (20).
    pub motion_fps: f32,
    /// 22 joints in the radar frame, m: `[motion frame][joint][xyz]`; empty when unknown.
    pub joints: Vec<[[f32; 3]; 22]>,
    /// HumanML3D features, `[motion frame][263]` flattened; empty when unknown.
    pub motion_features: Vec<f32>,
    /// Rotations of the 22 joints, `[motion frame][joint]`: the first two columns of the rotation matrix, x of the first
    /// column first. The pelvis is turned from the axes of the body at rest to those of the radar, every other joint
    /// relative to its parent. Empty when unknown, as in data sets of version 1.
    pub rotations6d: Vec<[[f32; 6]; 22]>,
    /// Standing height of the body, m; 0 when unknown.
    pub body_height_m: f32,
}

/// A clip without the rotations of its motion.
#[derive(Debug, thiserror::Error)]
#[error(
    "no rotations of its motion: data sets of version 1 of the layout lack them and have to be built anew"
)]
pub struct NoRotations;

impl ClipRecord {
    /// [`Self::rotations6d`] where it is known, one entry for each of [`Self::joints`].
    ///
    /// # Errors
    /// [`NoRotations`], also if the height of the body is unknown.
    pub fn known_rotations(&self) -> Result<&[[[f32; 6]; 22]], NoRotations> {
        let n = self.rotations6d.len();
        match n > 0 && n == self.joints.len() && self.body_height_m > 0.0 {
            true => Ok(&self.rotations6d),
            false => Err(NoRotations),
        }
    }

    /// Index of the frame of the motion that is nearest to a time, at most its last one.
    pub fn motion_frame_at(&self, time_s: f64) -> usize {
        let nearest = (time_s * f64::from(self.motion_fps)).round().max(0.0) as usize;
        nearest.min(self.joints.len().saturating_sub(1))
    }
}

/// An item that could not be generated.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FailedItem {
    /// Id of the requested clip.
    pub id: String,
    /// Why it is not in the data set.
    pub reason: String,
}
