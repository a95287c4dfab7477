//! Data sets of radars that are faster than what reads them.

use radarllm_base::Timeline;

use crate::train_clips;

const CONFIG: &str = "radar = \"iwr6843isk\"\nfacet_edge_m = 0.05\n";
const SOURCE: &str = "[[source]]\nkind = \"procedural\"\ntrain = 1\nval = 0\ntest = 0\n";

/// Stored at 10 frames/s is what a recording of the same radar becomes when it is brought to 10 frames/s.
#[test]
fn frames_of_a_faster_radar_are_joined() {
    let own = train_clips(&format!("{CONFIG}{SOURCE}"), 1);
    let stored = train_clips(
        &format!("{CONFIG}frame_rate_hz = 10.0\nslowest_mps = 0.3\n{SOURCE}"),
        1,
    );
    assert_eq!((own.len(), stored.len()), (1, 1));
    for (own, stored) in own.iter().zip(&stored) {
        let mut moving = own.frames.clone();
        for frame in &mut moving {
            frame.points.retain(|p| p.velocity_mps.abs() >= 0.3);
        }
        let line = Timeline::from_frames(moving, 1.0 / 0.055);
        let joined = line.resample(10.0, false).unwrap();
        assert!(joined.frames.len() >= 10);
        assert_eq!(stored.frames.len(), joined.frames.len());
        for (ours, theirs) in stored.frames.iter().zip(&joined.frames) {
            assert_eq!((ours.frame, ours.time_s), (theirs.frame, theirs.time_s));
            assert_eq!(ours.points.len(), theirs.points.len());
            assert!(
                ours.points
                    .is_sorted_by(|a, b| a.intensity_db >= b.intensity_db)
            );
            for point in &ours.points {
                assert!(theirs.points.contains(point));
            }
        }
    }
}

#[test]
fn a_rate_above_the_radar_s_is_refused() {
    let text = format!("{CONFIG}frame_rate_hz = 40.0\n{SOURCE}");
    let config = radarllm_synth::config::DatasetConfig::from_toml(&text).unwrap();
    let radar = config.open_radar(std::path::Path::new("")).unwrap();
    let error = config.stored_rate_hz(&radar).unwrap_err().to_string();
    assert!(
        error.contains("iwr6843isk") && error.contains("18.182"),
        "{error}"
    );
}
