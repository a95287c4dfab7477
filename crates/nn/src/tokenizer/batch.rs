//! Batches of clips: padded steps, and the tubes of all clips in one list.

use radarllm_inference::tokenizer::config::TokenizerConfig;
use radarllm_inference::tokenizer::doppler_profile::PROFILE_DIM;
use radarllm_inference::tokenizer::grouping::{
    Grouped, MaskedClip, NEIGHBOUR_DIM, STEP_DIM, TUBE_DIM, Tube,
};

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
    /// Tube in the list of [`ClipInput::hidden`].
    pub tube: usize,
}

/// A clip that joins a batch.
#[derive(Clone, Copy)]
pub struct ClipInput<'a> {
    /// The clip with all its points.
    pub clip: &'a Grouped,
    /// Whether the trajectory of each anchor is masked; empty if none is.
    pub masked: &'a [bool],
    /// What the mask leaves and hides, if it hides points and not only tubes.
    pub parts: Option<&'a MaskedClip>,
}

impl<'a> ClipInput<'a> {
    /// A clip without a mask.
    pub fn whole(clip: &'a Grouped) -> Self {
        Self {
            clip,
            masked: &[],
            parts: None,
        }
    }

    /// What the network sees, apart from masked tubes.
    fn visible(&self) -> &'a Grouped {
        self.parts.map_or(self.clip, |parts| &parts.visible)
    }

    /// What contains the points of masked tubes.
    pub fn hidden(&self) -> &'a Grouped {
        self.parts.map_or(self.clip, |parts| &parts.hidden)
    }
}

impl ClipBatch {
    /// Joins clips.
    ///
    /// A masked tube is left out of the batch. Without [`ClipInput::parts`], its points are still in the overlapping tubes
    /// of visible anchors and in the values of the steps; with them, hidden points are in neither. The network learns
    /// which cells have points only after the anchors' context, in the pooling.
    pub fn new(config: &TokenizerConfig, clips: &[ClipInput]) -> Self {
        let n_anchors = config.n_anchors();
        let longest = clips.iter().map(|c| c.clip.n_codes).max();
        let longest = longest.unwrap_or(1).max(1);
        let n_steps = longest * STEPS_PER_CODE;
        let n_cells = clips.len() * n_steps * n_anchors;
        let template = clips.iter().all(|c| c.clip.anchors.len() == n_anchors);
        let mut batch = Self {
            n_clips: clips.len(),
            n_steps,
            n_anchors,
            n_codes: clips.iter().map(|c| c.clip.n_codes).collect(),
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
        for (clip_idx, input) in clips.iter().enumerate() {
            let is_masked = |anchor: usize| input.masked.get(anchor).copied() == Some(true);
            let clip = input.visible();
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
            let cell_of =
                |tube: &Tube| (first_step + tube.step as usize) * n_anchors + tube.anchor as usize;
            for tube in &input.clip.tubes {
                batch.cell_filled[cell_of(tube)] = 1.0;
            }
            for (tube_idx, tube) in input.hidden().tubes.iter().enumerate() {
                if is_masked(tube.anchor as usize) {
                    batch.hidden.push(HiddenTube {
                        cell: cell_of(tube),
                        clip: clip_idx,
                        tube: tube_idx,
                    });
                }
            }
            let tubes = clip.tubes.iter();
            for tube in tubes.filter(|tube| !is_masked(tube.anchor as usize)) {
                batch.cell_source[cell_of(tube)] = batch.tubes.len() as i32;
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

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use radarllm_base::{PointFrame, RadarPoint};
    use radarllm_inference::tokenizer::grouping::{Hides, group, group_masked};

    use super::*;

    /// A hidden point reaches the batch through the tubes of visible anchors, unless the mask hides points.
    #[test]
    fn hidden_points_are_in_no_tube_of_the_batch() {
        // Every point has a range of its own, by which it is recognised among the neighbours.
        let frame = |f: usize| {
            let points = (0..20).map(|i| {
                let t = (f * 20 + i) as f32;
                RadarPoint {
                    x_m: 0.4 * (t * 2.399).sin(),
                    y_m: 3.0 + 0.2 * (t * 1.713).sin(),
                    z_m: 0.8 * (t * 0.917).sin(),
                    range_m: 2.0 + t / 64.0,
                    ..RadarPoint::default()
                }
            });
            PointFrame {
                points: points.collect(),
                ..PointFrame::default()
            }
        };
        let frames: Vec<PointFrame> = (0..8).map(frame).collect();
        let mut config = TokenizerConfig::small();
        config.grouping.k_per_frame = 128;
        let whole = group(&frames, 1.0, &config.grouping).unwrap();
        let masked: Vec<bool> = (0..config.n_anchors()).map(|a| a % 2 == 1).collect();
        let parts = group_masked(&frames, 1.0, &config.grouping, &masked, Hides::Nearest).unwrap();
        let points = |neighbours: &[[f32; NEIGHBOUR_DIM]]| -> BTreeSet<u32> {
            neighbours.iter().map(|n| n[4].to_bits()).collect()
        };
        let hidden = points(&parts.hidden.neighbours);
        assert!(hidden.len() > 40, "{}", hidden.len());
        let batch = |parts| {
            let input = ClipInput {
                clip: &whole,
                masked: &masked,
                parts,
            };
            ClipBatch::new(&config, &[input])
        };
        let (hiding, leaking) = (batch(Some(&parts)), batch(None));
        let seen = |batch: &ClipBatch| points(&batch.neighbours).intersection(&hidden).count();
        assert_eq!(seen(&hiding), 0);
        assert!(seen(&leaking) * 10 > hidden.len() * 9, "{}", seen(&leaking));
        assert!(hiding.steps != leaking.steps);
        // Cells count as filled by all points, and what is reconstructed is masked and hidden.
        assert_eq!(hiding.cell_filled, leaking.cell_filled);
        assert!(!hiding.hidden.is_empty());
        for tube in &hiding.hidden {
            assert!(masked[parts.hidden.tubes[tube.tube].anchor as usize]);
        }
        for (cell, source) in hiding.cell_source.iter().enumerate() {
            let is_masked = *source == hiding.tubes.len() as i32 + 1;
            assert_eq!(is_masked, masked[cell % config.n_anchors()], "cell {cell}");
        }
    }
}
