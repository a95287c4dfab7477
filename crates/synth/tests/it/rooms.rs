//! Data sets built in a room.

use radarllm_dataset::ClipRecord;

use crate::train_clips as clips;

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
