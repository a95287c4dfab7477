//! How many falls does a running radar notice, how late, and how often does it raise a false alarm?
//!
//! Falls and what looks like falls are simulated frame by frame and go through tracker, presence and fall monitor as in a
//! running radar, by height alone: no model names anything. Recordings without falls add false alarms of real radars.
//!
//! Reading order: [`FallPlan`] (conditions), [`Trial`], [`TrueFall`] and [`Score`] (events against the truth),
//! [`FallReport`] (counts with intervals), [`recording_alarms`].

mod counts;
mod plan;
mod recordings;
mod report;
mod score;
mod trial;
mod watch;

use std::path::Path;

use radarllm_base::Clip;
use rayon::prelude::*;
use serde::Serialize;

use crate::EvalError;
pub use counts::{DailyRate, Proportion};
pub use plan::{
    Before, FRAME_PERIOD_S, FallPlan, MotionFile, MountingFile, PersonFile, RadarFile, Trial,
};
pub use recordings::{RecordingAlarms, recording_alarms};
pub use report::{DescribedFalls, FallCounts, FallReport, OtherCounts};
pub use score::{Missed, Score, TrueFall};
pub use trial::TrialRow;

/// A time, s, in which an action is stated.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StatedAction {
    /// Its name.
    pub action: String,
    /// Beginning.
    pub start_s: f64,
    /// End.
    pub end_s: f64,
}

/// What is stated in a clip.
pub type DescribeTrial<'a> = dyn Fn(Clip) -> Result<Vec<StatedAction>, EvalError> + Sync + 'a;

/// Runs all trials on the threads of the rayon pool from which this is called. Radar files are relative to `base`. With
/// `describe`, the points of each trial are described as well.
///
/// # Errors
/// A radar that cannot be opened or simulated, and what `describe` refuses.
pub fn evaluate_falls(
    plan: &FallPlan,
    base: &Path,
    describe: Option<&DescribeTrial>,
) -> Result<FallReport, EvalError> {
    let n_falls = plan.n_falls();
    let trials: Vec<(bool, Trial)> = plan
        .trials()
        .into_iter()
        .enumerate()
        .map(|(i, trial)| (i < n_falls, trial))
        .collect();
    let mut rows = Vec::new();
    for file in &plan.radar {
        let radar = plan.open_radar(&file.name, base)?;
        let own: Vec<&(bool, Trial)> = trials
            .iter()
            .filter(|(_, trial)| trial.radar == file.name)
            .collect();
        let found: Result<Vec<TrialRow>, EvalError> = own
            .into_par_iter()
            .map_init(
                || None,
                |synthesizer, (is_fall, trial)| {
                    let synthesizer = match synthesizer {
                        Some(ready) => ready,
                        None => synthesizer.insert(radar.synthesizer()?),
                    };
                    trial::run(plan, trial, *is_fall, &radar, synthesizer, describe)
                },
            )
            .collect();
        rows.extend(found?);
    }
    Ok(FallReport::new(plan.seed, rows))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fall_is_suspected_and_confirmed_and_a_bow_is_not() {
        let text = plan::tests::PLAN
            .replacen("speed = [0.7, 1.0, 1.4]", "speed = [1.0]", 1)
            .replacen("other_repeats = 2", "other_repeats = 1", 1)
            .replacen("heading_deg = [0, 90, 180]", "heading_deg = [0]", 1)
            .replacen(
                "[[mounting]]\n        height_m = 1.5\n        tilt_deg = 10",
                "",
                1,
            );
        let plan = FallPlan::from_toml(&text).unwrap();
        // Whoever describes sees the points of a trial in order of time, and states a fall long after each, and that
        // somebody lies in the last second of it.
        let describe = |clip: Clip| {
            assert!(clip.frames.windows(2).all(|w| w[0].time_s < w[1].time_s));
            let end_s = clip.frames.len() as f64 * FRAME_PERIOD_S;
            let stated = |action: &str, start_s, end_s| StatedAction {
                action: action.into(),
                start_s,
                end_s,
            };
            Ok(vec![
                stated("lie_still", end_s - 1.0, end_s),
                stated("fall", end_s + 98.0, end_s + 100.0),
            ])
        };
        let report = evaluate_falls(&plan, Path::new(""), Some(&describe)).unwrap();
        let [fall, bow] = &report.rows[..] else {
            panic!("two trials")
        };
        let delay_s = fall.delay_s().unwrap();
        assert!((-1.0..=2.0).contains(&delay_s), "{delay_s}");
        let dwell_s = fall.score.confirmed_s.unwrap() - fall.score.suspected_s.unwrap();
        assert!((dwell_s - 20.0).abs() < 0.11, "{dwell_s}");
        assert_eq!((bow.truth, &bow.score), (None, &Score::default()));
        assert_eq!((fall.is_described(), fall.falsely_described()), (false, 1));
        assert_eq!((bow.is_described(), bow.falsely_described()), (false, 1));
        let after_s = fall.seconds - fall.truth.unwrap().impact_s - score::LATEST_S;
        let share = fall.lying_share().unwrap();
        assert!((share - 1.0 / after_s).abs() < 1e-9, "{share}");
        assert_eq!(bow.lying_share(), None);
        let page = report.to_markdown();
        assert_eq!(page.matches("stated by `describe`").count(), 2, "{page}");
        // What is decided is not simulated further.
        assert!(bow.seconds < 20.0 && fall.seconds > 20.0);
    }
}
