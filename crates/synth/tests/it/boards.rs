//! Boards that a data set draws at random.

use radarllm_synth::config::DatasetConfig;

use crate::train_clips;

/// Values that both boards share, with six motions.
const SHARED: &str = "name = \"boards\"\nseed = 5\nmax_frames = 3\nfacet_edge_m = 0.05\nframe_rate_hz = 10.0\nheading_deg = 180.0\n";
const SOURCE: &str = "[[source]]\nkind = \"procedural\"\ntrain = 6\nval = 0\ntest = 0\n";
/// What the second board states, also as values of a data set.
const SECOND: &str = "radar = \"iwr6843isk\"\nradar_height_m = 1.6\nslowest_mps = 0.2\n\
                      processing = { preset = \"ti_demo\", max_points = 20 }\nimpairments = { preset = \"typical\" }\n";

#[test]
fn each_clip_is_that_of_a_data_set_of_its_board() {
    let first = train_clips(&format!("{SHARED}{SOURCE}"), 1);
    let second = train_clips(&format!("{SHARED}{SECOND}{SOURCE}"), 1);
    let drawn = train_clips(
        &format!("{SHARED}{SOURCE}[[board]]\n[[board]]\n{SECOND}"),
        2,
    );
    assert_eq!((first.len(), second.len(), drawn.len()), (6, 6, 6));
    let mut counts = [0, 0];
    for clip in &drawn {
        let of_same_motion = |clips: &[radarllm_dataset::ClipRecord]| {
            clips.iter().find(|other| other.id == clip.id).cloned()
        };
        let (first, second) = (of_same_motion(&first), of_same_motion(&second));
        match clip.radar.as_str() {
            "awr1843boost" => {
                counts[0] += 1;
                assert_eq!(Some(clip), first.as_ref());
            }
            _ => {
                counts[1] += 1;
                assert_eq!(clip.radar_height_m, 1.6);
                assert_eq!(Some(clip), second.as_ref());
            }
        }
    }
    assert!(counts.iter().all(|&n| n > 0), "{counts:?}");
}

#[test]
fn slips_in_a_board_are_named_with_its_number() {
    let board = |text: &str| DatasetConfig::from_toml(&format!("{SHARED}{SOURCE}{text}"));
    for (text, words) in [
        ("[[board]]\nradarr = \"x\"", ["radarr", "unknown field"]),
        (
            "[[board]]\n[[board]]\nradar_height_m = -1.0",
            ["board 2 of 2", "radar_height_m"],
        ),
        (
            "[[board]]\nthreshold_offset_db = [-1.0, 2.0]",
            ["board 1 of 1", "log_cfar"],
        ),
    ] {
        let error = board(text).unwrap_err().to_string();
        for word in words {
            assert!(error.contains(word), "`{error}` should name `{word}`");
        }
    }
    let without_rate = format!("{SOURCE}[[board]]\n[[board]]\n");
    let error = DatasetConfig::from_toml(&without_rate).unwrap_err();
    assert!(error.to_string().contains("frame_rate_hz"), "{error}");
    let many = "[[board]]\n".repeat(65);
    assert!(board(&many).unwrap_err().to_string().contains("64"));
}
