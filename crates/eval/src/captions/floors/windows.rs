//! Facts by a forest of windows and rules, written by rules: what happens in each window is recognised, and its order is read
//! off.

use radarllm_base::PointFrame;
use radarllm_dataset::ClipRecord;
use radarllm_facts::{Facts, Subject, facts, write::Writer};

use super::{
    classes::Classes,
    classifier::likeliest,
    facts::{actions_of, label, write},
    rules::measured,
};
use crate::{
    EvalError,
    descriptor::{STEP_DIM, steps},
};

/// Radar frames of a window: 1.6 s.
const WINDOW_FRAMES: usize = 16;
/// Radar frames between the starts of two windows: 0.8 s.
const HOP_FRAMES: usize = 8;
/// Radar frames of a step: 0.4 s.
const FRAMES_PER_STEP: usize = 4;
/// What a change of the action between two windows costs, in natural logarithms of probabilities.
const CHANGE_COST: f32 = 2.0;
/// Lowest probability, so that no single window excludes an action.
const MIN_PROBABILITY: f32 = 0.01;

/// For each clip, a sentence written from facts that a forest and rules find. The forest recognises the actions of windows
/// of 1.6 s; the likeliest order with a price on every change is found by dynamic programming (Viterbi, 1967). Sides,
/// directions, speeds and counts are those that rules measure of the same action. Windows are labelled by the actions of
/// the first caption of their training clip, which are taken to last equally long.
///
/// # Errors
/// No training clip with frames whose caption states an action.
pub fn window_facts_captions(
    train: &[ClipRecord],
    clips: &[ClipRecord],
    seed: u64,
) -> Result<Vec<String>, EvalError> {
    let mut rows: Vec<Vec<f32>> = Vec::new();
    let mut of_rows: Vec<String> = Vec::new();
    for clip in train {
        let Some(stated) = clip.captions.first().map(|text| facts(text)) else {
            continue;
        };
        let stretches: Vec<String> = stated.stretches.iter().map(|s| label(s)).collect();
        let windows = windows(&clip.frames, clip.radar_height_m);
        let n = windows.len();
        for (i, row) in windows.into_iter().enumerate() {
            // The stretch in which the middle of the window is.
            if let Some(name) = stretches.get((2 * i + 1) * stretches.len() / (2 * n)) {
                rows.push(row);
                of_rows.push(name.clone());
            }
        }
    }
    let classes = Classes::fit(&rows, &of_rows, seed)?;
    let writer = Writer::new();
    let text = |clip: &ClipRecord| {
        let windows = windows(&clip.frames, clip.radar_height_m);
        let probabilities: Vec<Vec<f32>> = windows
            .iter()
            .map(|row| classes.probabilities(row))
            .collect();
        let mut found = Facts {
            subject: Some(Subject::Person),
            stretches: likeliest_order(&probabilities)
                .into_iter()
                .filter_map(|class| classes.name(class))
                .map(actions_of)
                .collect(),
        };
        let measured = measured(&clip.frames, clip.radar_height_m);
        for action in found.stretches.iter_mut().flatten() {
            if let Some(same) = measured.actions().find(|m| m.name == action.name) {
                *action = *same;
            }
        }
        write(&writer, &found, seed)
    };
    Ok(clips.iter().map(text).collect())
}

/// A row for each window: the numbers of its four steps, [`steps`], one step after the other. Steps after the end of a
/// short clip are zero.
fn windows(frames: &[PointFrame], radar_height_m: f32) -> Vec<Vec<f32>> {
    const N_STEPS: usize = WINDOW_FRAMES / FRAMES_PER_STEP;
    let all = steps(frames, radar_height_m, FRAMES_PER_STEP);
    if all.is_empty() {
        return Vec::new();
    }
    let last = all.len().saturating_sub(N_STEPS);
    (0..=last)
        .step_by(HOP_FRAMES / FRAMES_PER_STEP)
        .map(|first| {
            let own = &all[first..(first + N_STEPS).min(all.len())];
            let mut row = own.as_flattened().to_vec();
            row.resize(N_STEPS * STEP_DIM, 0.0);
            row
        })
        .collect()
}

/// The likeliest order of classes, each once for all windows in a row that it lasts.
///
/// # Shapes
/// - `probabilities`: `[window][class]`
fn likeliest_order(probabilities: &[Vec<f32>]) -> Vec<usize> {
    let Some(first) = probabilities.first() else {
        return Vec::new();
    };
    let log = |p: &f32| p.max(MIN_PROBABILITY).ln();
    let mut scores: Vec<f32> = first.iter().map(log).collect();
    // `[window - 1][class]`: the class before.
    let mut before: Vec<Vec<usize>> = Vec::new();
    for window in &probabilities[1..] {
        let best = likeliest(&scores);
        let changed = scores.get(best).map_or(0.0, |s| s - CHANGE_COST);
        let from = |class: usize| match scores[class] >= changed {
            true => class,
            false => best,
        };
        before.push((0..scores.len()).map(from).collect());
        scores = scores
            .iter()
            .zip(window)
            .map(|(score, p)| score.max(changed) + log(p))
            .collect();
    }
    let mut classes = vec![likeliest(&scores)];
    for from in before.iter().rev() {
        let class = from.get(classes[classes.len() - 1]).copied();
        classes.extend(class);
    }
    classes.reverse();
    classes.dedup();
    classes
}

#[cfg(test)]
mod tests {
    use super::{super::retrieval::tests::clip, *};

    #[test]
    fn a_single_window_changes_nothing_and_a_lasting_change_does() {
        let window = |class: usize, p: f32| -> Vec<f32> {
            (0..3)
                .map(|c| if c == class { p } else { 0.5 * (1.0 - p) })
                .collect()
        };
        let noisy = [window(0, 0.8), window(1, 0.6), window(0, 0.8)];
        assert_eq!(likeliest_order(&noisy), [0]);
        let changes = [
            window(0, 0.8),
            window(0, 0.8),
            window(2, 0.9),
            window(2, 0.9),
        ];
        assert_eq!(likeliest_order(&changes), [0, 2]);
        assert!(likeliest_order(&[]).is_empty());
    }

    #[test]
    fn the_order_of_windows_is_that_of_the_sentence() {
        let shift = |i: usize| 0.01 * i as f32;
        let walk = move |i| move |t: f32| [shift(i), 5.0 - 2.8 * t, 0.2];
        let sit = move |i| move |t: f32| [shift(i), 3.0, 0.4 - 0.8 * t];
        let both = move |t: f32| match t < 0.5 {
            true => walk(30)(2.0 * t),
            false => sit(30)(2.0 * t - 1.0),
        };
        let train: Vec<ClipRecord> = (0..40)
            .map(|i| match i % 2 {
                0 => clip(&format!("{i}"), "a person walks forward", 48, walk(i)),
                _ => clip(&format!("{i}"), "a person sits down", 48, sit(i)),
            })
            .collect();
        let clips = [
            clip("x", "-", 48, walk(30)),
            clip("y", "-", 48, sit(31)),
            clip("z", "-", 96, both),
            clip("short", "-", 8, walk(30)),
        ];
        let texts = window_facts_captions(&train, &clips, 1).unwrap();
        let orders: Vec<Vec<&str>> = texts
            .iter()
            .map(|text| facts(text).actions().map(|a| a.name).collect())
            .collect();
        assert_eq!(orders[0], ["walk"]);
        assert_eq!(orders[1], ["sit_down"]);
        assert_eq!(orders[2], ["walk", "sit_down"]);
        assert_eq!(orders[3].len(), 1);
        assert!(window_facts_captions(&[], &clips, 1).is_err());
    }
}
