//! Copies of training motions in the other splits of a data set on disk.

use radarllm_base::seed::derive_seed;
use radarllm_dataset::{
    BuildOptions, BuildPlan, ClipRecord, ItemId, Overwrite, SourceLicence, Split, build, validate,
};
use radarllm_eval::held_out::validate_with_held_out;

fn plan() -> BuildPlan {
    let splits = [
        Split::Train,
        Split::Train,
        Split::Train,
        Split::Val,
        Split::Test,
    ];
    BuildPlan {
        name: "test".into(),
        tool_version: "0".into(),
        arithmetic: "test".into(),
        radar: "awr1843boost".into(),
        frame_rate_hz: 10.0,
        seed: 7,
        config_toml: String::new(),
        skipped: Vec::new(),
        licences: vec![SourceLicence {
            source: "procedural".into(),
            licence: "MIT OR Apache-2.0".into(),
            attribution: "made here".into(),
            synthetic: true,
        }],
        shard_size: 8,
        // Two variants of a motion share its split.
        items: (0..20)
            .map(|i| ItemId {
                id: format!("m{}#{}", i / 2, i % 2),
                group: format!("g{}", i / 2),
                split: splits[i / 2 % 5],
            })
            .collect(),
    }
}

fn clip(item: &ItemId, joints: Vec<[[f32; 3]; 22]>) -> ClipRecord {
    ClipRecord {
        id: item.id.clone(),
        motion_id: item.id.split('#').next().unwrap().into(),
        group: item.group.clone(),
        split: item.split,
        action: "dance".into(),
        captions: vec!["a person dances".into()],
        source: "procedural".into(),
        radar: "awr1843boost".into(),
        radar_height_m: 1.0,
        seed: 1,
        frames: Vec::new(),
        motion_fps: 20.0,
        joints,
        motion_features: Vec::new(),
        rotations6d: Vec::new(),
        body_height_m: 0.0,
    }
}

#[test]
fn held_out_copies_of_training_motions_are_named_with_both_clips() {
    // Limbs that swing, each at its own pace: no two seeds alike.
    let dance = |seed: u64| -> Vec<[[f32; 3]; 22]> {
        let pace =
            |i: usize| 1.0 + (derive_seed(seed, &i.to_string()) >> 40) as f32 / (1 << 23) as f32;
        let paces: [[f32; 3]; 22] =
            std::array::from_fn(|j| std::array::from_fn(|axis| pace(3 * j + axis)));
        (0..80)
            .map(|i| {
                std::array::from_fn(|j| {
                    std::array::from_fn(|axis| {
                        let rest = [0.3 * ((j % 3) as f32 - 1.0), 3.0, 0.08 * j as f32][axis];
                        rest + 0.15 * (i as f32 * 0.05 * paces[j][axis] + j as f32).sin()
                    })
                })
            })
            .collect()
    };
    // A quarter turn about the radar.
    let turned = |joints: Vec<[[f32; 3]; 22]>| -> Vec<[[f32; 3]; 22]> {
        let turn = |[x, y, z]: [f32; 3]| [-y, x, z];
        joints.into_iter().map(|pose| pose.map(turn)).collect()
    };
    let made = |item: &ItemId| {
        let joints = match item.id.as_str() {
            "m0#0" => dance(1),
            "m1#0" => dance(2),
            "m3#0" => turned(dance(1))[10..70].to_vec(), // validation
            "m4#0" => dance(3),                          // test, captioned as all the others
            _ => Vec::new(),
        };
        Ok::<_, String>(clip(item, joints))
    };
    let dir = tempfile::tempdir().unwrap();
    let options = BuildOptions {
        threads: 1,
        overwrite: Overwrite::Refuse,
        retry_failed: false,
    };
    build(dir.path(), &plan(), options, made, |_| {}).unwrap();
    // Ids and groups are in order: only the motions show the copy.
    assert_eq!(validate(dir.path()).unwrap(), []);
    let found = validate_with_held_out(dir.path()).unwrap();
    let [problem] = found.problems.as_slice() else {
        panic!("{:?}", found.problems);
    };
    assert_eq!(problem.id.as_deref(), Some("m3#0"));
    assert!(problem.problem.contains("`m0#0`"), "{}", problem.problem);
    assert!(problem.file.starts_with("data/val"), "{}", problem.file);
    // Of eight held-out clips two have joints.
    let held_out = found.held_out;
    assert_eq!((held_out.judged, held_out.not_judged), (2, 6));
    let [min, _, _] = held_out.distances.unwrap();
    assert!(min < held_out.leak_distance);
}
