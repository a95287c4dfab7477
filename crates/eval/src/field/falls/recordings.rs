//! False alarms in recordings without falls.

use radarllm_base::Clip;
use radarllm_monitor::falls::FallState;
use serde::Serialize;

use super::{counts::DailyRate, watch::WatchedRoom};
use crate::{
    EvalError,
    recordings::{LabelledRecording, RecordingsConfig, Role},
};

/// The action that states a fall.
const FALL: &str = "fall";

/// False alarms in the recordings of one configuration.
#[derive(Clone, Debug, Serialize)]
pub struct RecordingAlarms {
    /// Name of the configuration.
    pub config: String,
    /// Role of the recordings.
    pub role: Role,
    /// Number of recordings.
    pub recordings: usize,
    /// Falls that were suspected.
    pub suspected: DailyRate,
    /// Falls that were confirmed.
    pub confirmed: DailyRate,
    /// Suspicions that were neither confirmed nor dismissed when the recording ended.
    pub undecided: usize,
    /// Recordings with a suspicion, and when it began, s.
    pub alarms: Vec<(String, f64)>,
}

/// Watches every recording from its beginning to its end. Recordings of falls are left out.
///
/// # Errors
/// Simulated points, and points that are not at ten frames a second.
pub fn recording_alarms(
    name: &str,
    config: &RecordingsConfig,
    role: Role,
    recordings: &[LabelledRecording],
) -> Result<RecordingAlarms, EvalError> {
    let is_fall = |recording: &LabelledRecording| {
        let own = config
            .activity
            .iter()
            .find(|a| a.name == recording.activity);
        own.is_some_and(|a| a.actions.iter().any(|action| action == FALL))
    };
    let (mut n, mut n_frames, mut n_confirmed, mut undecided) = (0, 0, 0, 0);
    let mut alarms = Vec::new();
    for recording in recordings.iter().filter(|r| !is_fall(r)) {
        let watch = watch(&recording.clip)?;
        n += 1;
        n_frames += recording.clip.frames.len();
        undecided += usize::from(watch.is_undecided());
        for event in &watch.events {
            match event.state {
                FallState::Suspected => alarms.push((recording.name.clone(), event.at_s)),
                FallState::Confirmed => n_confirmed += 1,
                FallState::Dismissed | FallState::Recovered => {}
            }
        }
    }
    let hours = n_frames as f64 * super::plan::FRAME_PERIOD_S / 3600.0;
    Ok(RecordingAlarms {
        config: name.into(),
        role,
        recordings: n,
        suspected: DailyRate::new(alarms.len(), hours),
        confirmed: DailyRate::new(n_confirmed, hours),
        undecided,
        alarms,
    })
}

fn watch(clip: &Clip) -> Result<WatchedRoom, EvalError> {
    if clip.provenance.is_simulated() {
        return Err(EvalError::Simulated(clip.provenance.input().into()));
    }
    if (clip.frame_rate_hz * super::plan::FRAME_PERIOD_S - 1.0).abs() > 0.01 {
        return Err(EvalError::Config(format!(
            "{}: {} frames/s, but falls are watched at 10 frames/s",
            clip.provenance.input(),
            clip.frame_rate_hz
        )));
    }
    let mut watch = WatchedRoom::new(clip.radar_height_m)?;
    for frame in &clip.frames {
        watch.push(frame);
    }
    Ok(watch)
}

#[cfg(test)]
mod tests {
    use radarllm_base::{Clutter, PointFrame, Provenance, RadarPoint};
    use radarllm_inference::{PrepareOptions, prepare_for_model};

    use super::*;

    const CONFIG: &str = r#"
        radar_height_m = 1.0
        [roles]
        tuning = ["*"]
        [[activity]]
        name = "walk"
        actions = ["walk"]
        [[activity]]
        name = "fall"
        actions = ["fall"]
    "#;

    /// Somebody 3 m away who is up for 3 s and down from then on.
    fn recording(activity: &str, seconds: usize) -> LabelledRecording {
        let frame = |i: usize| PointFrame {
            frame: i as u32,
            time_s: 0.1 * i as f64,
            points: (0..12)
                .map(|k| RadarPoint {
                    y_m: 3.0,
                    z_m: if i < 30 { 0.5 } else { -0.8 } + 0.01 * k as f32,
                    range_m: 3.0,
                    velocity_mps: 0.5,
                    intensity_db: 20.0,
                    ..RadarPoint::default()
                })
                .collect(),
            board: None,
        };
        let clip = Clip {
            frames: (0..10 * seconds).map(frame).collect(),
            frame_rate_hz: 10.0,
            radar_height_m: 1.0,
            is_height_assumed: false,
            radar: "r".into(),
            provenance: Provenance::recorded("csv", "x.csv"),
            clutter: Clutter::Settled,
        };
        labelled(activity, seconds, clip)
    }

    fn labelled(activity: &str, seconds: usize, clip: Clip) -> LabelledRecording {
        let prepared = prepare_for_model(clip, &PrepareOptions::default());
        LabelledRecording {
            name: format!("{activity} {seconds}"),
            activity: activity.into(),
            clip: prepared.unwrap().clip,
        }
    }

    #[test]
    fn suspicions_in_recordings_are_false_alarms() {
        let config = RecordingsConfig::from_toml(CONFIG).unwrap();
        let count = |recordings: &[LabelledRecording]| {
            recording_alarms("c", &config, Role::Tuning, recordings).unwrap()
        };
        let found = count(&[
            recording("walk", 2),
            recording("walk", 10),
            recording("walk", 30),
            recording("fall", 30),
        ]);
        assert_eq!((found.recordings, found.undecided), (3, 1));
        assert_eq!((found.suspected.n, found.confirmed.n), (2, 1));
        assert!((found.suspected.hours - 42.0 / 3600.0).abs() < 1e-9);
        let names: Vec<&str> = found.alarms.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(names, ["walk 10", "walk 30"]);
        let quiet = count(&[recording("walk", 2)]);
        assert_eq!((quiet.suspected.n, quiet.suspected.low_per_day), (0, 0.0));
    }

    #[test]
    fn simulated_points_and_other_rates_are_refused() {
        let config = RecordingsConfig::from_toml(CONFIG).unwrap();
        let refused = |change: fn(&mut Clip)| {
            let mut clip = recording("walk", 2).clip.into_clip();
            change(&mut clip);
            let one = labelled("walk", 2, clip);
            recording_alarms("c", &config, Role::Tuning, &[one])
                .unwrap_err()
                .to_string()
        };
        assert!(refused(|clip| clip.frame_rate_hz = 10.4).contains("10.4"));
        let simulated = refused(|clip| clip.provenance = Provenance::simulated("walk", 1));
        assert!(simulated.contains("simulated"), "{simulated}");
    }
}
