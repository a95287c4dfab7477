//! Batches of clips: padded steps, and the tubes of all clips in one list.

use radarllm_inference::tokenizer::config::TokenizerConfig;
use radarllm_inference::tokenizer::doppler_profile::PROFILE_DIM;
use radarllm_inference::tokenizer::grouping::{Grouped, NEIGHBOUR_DIM, STEP_DIM, TUBE_DIM};

/// Steps per code.
const STEPS_PER_CODE: usize = 2;

/// A batch in host memory. Cells are (clip, step, anchor), anchor fastest.
#[derive(Clone, Debug, PartialEq)]
pub struct ClipBatch {
    /// Clips B.
    pub n_clips: usize,
    /// Steps S of the longest clip, a whole number of codes.
    pub n_steps: usize,
    /// Anchors A.
    pub n_anchors: usize,
    /// Codes of each clip.
    pub n_codes: Vec<usize>,
    /// Neighbours of the tubes that are visible to the network.
    pub neighbours: Vec<[f32; NEIGHBOUR_DIM]>,
    /// Neighbour range of each visible tube.
    pub tubes: Vec<(u32, u32)>,
    /// Statistics of each visible tube.
    pub tube_statistics: Vec<[f32; TUBE_DIM]>,
    /// Per cell: row of its tube, `n_tubes` where there is no point, `n_tubes + 1` where masked.
    pub cell_source: Vec<i32>,
    /// Per cell: 1 if it has points (masked or not).
    pub cell_filled: Vec<f32>,
    /// `[B, S]` times [`STEP_DIM`].
    pub steps: Vec<f32>,
    /// `[B, S]` times [`PROFILE_DIM`].
    pub profiles: Vec<f32>,
    /// `[B, S]`: 1 for steps of the clip, 0 for padding.
    pub step_valid: Vec<f32>,
    /// Anchor positions, m: `[A]` for a template, `[B, S, A]` otherwise.
    pub anchors: Vec<[f32; 3]>,
    /// Masked cells that have points: cell and clip-local tube number, to be reconstructed.
    pub hidden: Vec<HiddenTube>,
}

/// A tube that the network must reconstruct.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HiddenTube {
    /// Cell number in the batch.
    pub cell: usize,
    /// Clip in the batch.
    pub clip: usize,
    /// Tube in the clip's list.
    pub tube: usize,
}

impl ClipBatch {
    /// Joins clips; `masked[clip][anchor]` hides whole anchor trajectories (empty: hides none).
    ///
    /// A masked tube's points are left out of the batch. The network receives no information about them except
    /// that the cell is not empty.
    pub fn new(config: &TokenizerConfig, clips: &[&Grouped], masked: &[Vec<bool>]) -> Self {
        let n_anchors = config.n_anchors();
        let longest = clips.iter().map(|c| c.n_codes).max().unwrap_or(1).max(1);
        let n_steps = longest * STEPS_PER_CODE;
        let n_cells = clips.len() * n_steps * n_anchors;
        let template = clips.iter().all(|c| c.anchors.len() == n_anchors);
        let mut batch = Self {
            n_clips: clips.len(),
            n_steps,
            n_anchors,
            n_codes: clips.iter().map(|c| c.n_codes).collect(),
            neighbours: Vec::new(),
            tubes: Vec::new(),
            tube_statistics: Vec::new(),
            cell_source: vec![EMPTY; n_cells],
            cell_filled: vec![0.0; n_cells],
            steps: vec![0.0; clips.len() * n_steps * STEP_DIM],
            profiles: vec![0.0; clips.len() * n_steps * PROFILE_DIM],
            step_valid: vec![0.0; clips.len() * n_steps],
            anchors: Vec::new(),
            hidden: Vec::new(),
        };
        for (clip_idx, clip) in clips.iter().enumerate() {
            let is_masked = |anchor: usize| {
                masked.get(clip_idx).and_then(|m| m.get(anchor)).copied() == Some(true)
            };
            let first_step = clip_idx * n_steps;
            for step in 0..clip.n_steps {
                batch.step_valid[first_step + step] = 1.0;
                let at = (first_step + step) * STEP_DIM;
                batch.steps[at..at + STEP_DIM].copy_from_slice(&clip.steps[step]);
                let at = (first_step + step) * PROFILE_DIM;
                batch.profiles[at..at + PROFILE_DIM].copy_from_slice(&clip.profiles[step]);
            }
            for anchor in (0..n_anchors).filter(|a| is_masked(*a)) {
                for step in 0..n_steps {
                    batch.cell_source[(first_step + step) * n_anchors + anchor] = MASKED;
                }
            }
            for (tube_idx, tube) in clip.tubes.iter().enumerate() {
                let cell = (first_step + tube.step as usize) * n_anchors + tube.anchor as usize;
                batch.cell_filled[cell] = 1.0;
                if is_masked(tube.anchor as usize) {
                    batch.hidden.push(HiddenTube {
                        cell,
                        clip: clip_idx,
                        tube: tube_idx,
                    });
                    continue;
                }
                batch.cell_source[cell] = batch.tubes.len() as i32;
                let start = batch.neighbours.len() as u32;
                let own = &clip.neighbours[tube.start as usize..tube.end as usize];
                batch.neighbours.extend_from_slice(own);
                batch.tubes.push((start, batch.neighbours.len() as u32));
                batch.tube_statistics.push(tube.statistics);
            }
            if template {
                batch.anchors.clone_from(&clip.anchors);
            } else {
                batch.anchors.extend_from_slice(&clip.anchors);
                let missing = (n_steps - clip.n_steps) * n_anchors;
                batch
                    .anchors
                    .resize(batch.anchors.len() + missing, [0.0; 3]);
            }
        }
        let n_tubes = batch.tubes.len() as i32;
        for source in &mut batch.cell_source {
            match *source {
                EMPTY => *source = n_tubes,
                MASKED => *source = n_tubes + 1,
                _ => {}
            }
        }
        batch
    }

    /// Codes of the padded batch, L.
    pub fn codes_per_clip(&self) -> usize {
        self.n_steps / STEPS_PER_CODE
    }

    /// Row numbers, in `[B, L]`, of the codes that are not padding, clip by clip.
    pub fn code_rows(&self) -> Vec<usize> {
        let per_clip = self.codes_per_clip();
        (0..self.n_clips)
            .flat_map(|b| (0..self.n_codes[b]).map(move |l| b * per_clip + l))
            .collect()
    }
}

const EMPTY: i32 = -1;
const MASKED: i32 = -2;
