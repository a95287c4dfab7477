//! Data sets built in a room.

use std::path::Path;

use radarllm_dataset::{BuildOptions, ClipRecord, Dataset, Overwrite, Split};
use radarllm_synth::{build::build, config::DatasetConfig};

fn clips(config: &str, threads: usize) -> Vec<ClipRecord> {
    let folder = tempfile::tempdir().unwrap();
    let config = DatasetConfig::from_toml(config).unwrap();
    let options = BuildOptions {
        threads,
        overwrite: Overwrite::Refuse,
        retry_failed: false,
    };
    build(&config, Path::new(""), folder.path(), options, |_| ()).unwrap();
    let dataset = Dataset::open(folder.path()).unwrap();
    dataset.read_split(Split::Train).unwrap()
}

/// Distance of the farthest joint, m.
fn reach_m(clip: &ClipRecord) -> f32 {
    let joints = clip.joints.iter().flatten();
    joints
        .map(|[x, y, z]| (x * x + y * y + z * z).sqrt())
        .fold(0.0, f32::max)
}

/// Points well behind the person: ghosts.
fn n_ghosts(clip: &ClipRecord) -> usize {
    let far_m = reach_m(clip) + 0.5;
    let points = clip.frames.iter().flat_map(|f| &f.points);
    points.filter(|p| p.range_m > far_m).count()
}

#[test]
fn a_room_adds_ghosts_and_nothing_else() {
    let plain = "max_frames = 4\n[[source]]\nkind = \"procedural\"\ntrain = 2\nval = 0\ntest = 0\n";
    // Metal, 1.2 m to either side: the person's images stand about a metre farther than the person.
    let room = format!("{plain}[room]\nwalls = \"metal\"\nleft_m = 1.2\nright_m = 1.2\n");
    let free = clips(plain, 1);
    let walled = clips(&room, 1);
    assert_eq!(walled, clips(&room, 2), "whatever the thread count");
    assert_eq!(free.len(), 2);
    for (free, walled) in free.iter().zip(&walled) {
        // The same person does the same thing in the same place.
        assert_eq!(free.joints, walled.joints);
        assert_eq!(free.motion_features, walled.motion_features);
        assert_ne!(free.frames, walled.frames);
    }
    let count = |clips: &[ClipRecord]| clips.iter().map(n_ghosts).sum::<usize>();
    // The chain allows one false alarm a frame anywhere.
    assert!(count(&free) <= 8, "{}", count(&free));
    assert!(count(&walled) > 40, "{}", count(&walled));
}
