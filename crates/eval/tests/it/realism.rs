//! Realism with recordings made by the simulator itself: the answers are known.

use std::path::Path;

use radarllm_base::PointFrame;
use radarllm_dataset::{Overwrite, PointsMeta, write_points};
use radarllm_eval::realism::{RealismConfig, Take, calibrate, compare, pairs, replay};
use radarllm_radar_dsp::Detector;

/// A small radar: 32 loops of 128 samples up to 5.5 m, two transmitters of which one is raised.
const RADAR: &str = r#"
base = "awr1843boost"
name = "small"
n_loops = 32
n_samples = 128
sample_rate_hz = 2.2e6
tx = [{ x_m = 0.0, z_m = 0.0 }, { x_m = 0.0039, z_m = 0.00195 }]
"#;

const SCENE: &str = r#"
duration_s = 3.0
max_bounces = 1
[[target]]
kind = "motion"
file = "builtin:walk?direction=forward&distance_m=1.5"
position_m = [0.2, 3.0, -1.0]
"#;

fn config(threshold_db: f64, rest: &str) -> RealismConfig {
    RealismConfig::from_toml(&format!(
        r#"
radar = "small.toml"
crop_m = [[-3.0, 3.0], [0.0, 8.0], [-3.0, 3.0]]
{rest}
[processing]
preset = "ti_demo"
detector = {{ kind = "log_cfar", guard = 2, train = 6, sides = "smaller", threshold_db = {threshold_db:.1} }}
"#
    ))
    .unwrap()
}

/// Two recordings of 30 frames, written as a user would have them.
fn record(folder: &Path, truth: &RealismConfig) -> Vec<Take> {
    std::fs::write(folder.join("small.toml"), RADAR).unwrap();
    for (name, seed) in [("walk-1", 5), ("walk-2", 6)] {
        std::fs::write(folder.join(format!("{name}.toml")), SCENE).unwrap();
        let empty: Vec<PointFrame> = (0..30)
            .map(|frame| PointFrame {
                frame,
                time_s: f64::from(frame) * 0.1,
                points: Vec::new(),
                board: None,
            })
            .collect();
        let meta = PointsMeta {
            radar: "small".into(),
            source: "recorded:test".into(),
            seed: None,
            version: "0".into(),
            radar_height_m: None,
            frame_rate_hz: 10.0,
            has_speeds: true,
        };
        let file = folder.join(format!("{name}.parquet"));
        // One point a frame keeps the frame in the file; the real points replace it.
        let mut frames = empty;
        for frame in &mut frames {
            frame.points.push(radarllm_base::RadarPoint {
                x_m: 0.0,
                y_m: 1.0,
                z_m: 0.0,
                range_m: 1.0,
                velocity_mps: 0.0,
                intensity_db: 0.0,
            });
        }
        write_points(&file, &meta, &frames, Overwrite::Replace).unwrap();
        let takes = pairs::read_takes(truth, folder, folder).unwrap();
        let own = RealismConfig {
            seed,
            ..truth.clone()
        };
        let simulated = replay(&own, folder, &takes).unwrap();
        write_points(&file, &meta, simulated.last().unwrap(), Overwrite::Replace).unwrap();
    }
    pairs::read_takes(truth, folder, folder).unwrap()
}

#[test]
fn a_calibration_finds_the_threshold_and_the_bias_that_made_the_recording() {
    let folder = tempfile::tempdir().unwrap();
    let truth = config(16.0, "elevation_bias = 0.08");
    let takes = record(folder.path(), &truth);
    assert_eq!(takes.len(), 2);
    let start = config(11.0, "");
    let mut rounds = Vec::new();
    let found = calibrate(&start, folder.path(), &takes, |r| rounds.push(*r)).unwrap();

    let radar = radarllm_formats::radar_from_toml(RADAR).unwrap();
    let Detector::LogCfar { threshold_db, .. } = found.processing.resolve(&radar).detector else {
        panic!("{:?}", found.processing);
    };
    let last = rounds.last().unwrap();
    // The noise differs between recording and simulation; about 300 points a take leave 5 % of their
    // number, a tenth of a halving: 0.4 dB at the usual 4 dB a halving. Twice that.
    assert!((threshold_db - 16.0).abs() < 0.8, "{threshold_db} {last:?}");
    // z / range scatters by 0.2 a point: 0.01 over 600.
    assert!((found.elevation_bias - 0.08).abs() < 0.02, "{found:?}");
    assert_eq!(found.processing.azimuth_step_db, None);
    // The start was far off, so the test can fail.
    assert!(
        rounds[0].points[1] > 1.2 * rounds[0].points[0],
        "{rounds:?}"
    );
}

#[test]
fn a_simulation_equals_itself_for_any_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let truth = config(14.0, "");
    let mut takes = record(folder.path(), &truth);
    let simulated = replay(&truth, folder.path(), &takes).unwrap();
    let three = rayon::ThreadPoolBuilder::new()
        .num_threads(3)
        .build()
        .unwrap();
    let again = three.install(|| replay(&truth, folder.path(), &takes).unwrap());
    assert_eq!(simulated, again);
    for (take, frames) in takes.iter_mut().zip(&simulated) {
        take.frames.clone_from(frames);
    }
    let report = compare(&truth, &takes, &simulated);
    assert_eq!(report.frames, 60);
    assert_eq!(report.points[0], report.points[1]);
    for row in &report.distributions {
        assert_eq!(row.kolmogorov_smirnov, 0.0, "{row:?}");
        assert_eq!(row.wasserstein_1, 0.0, "{row:?}");
    }
    assert_eq!(report.chamfer_m, 0.0);
    assert!(report.chamfer_next_m > 0.0);
    assert!(report.classifier.is_none());
}
