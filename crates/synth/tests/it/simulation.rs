//! Motions and scenes through `SimulateOptions`, with firmware, body and objects.

use std::{fs, path::Path};

use radarllm_base::Clutter;
use radarllm_io::{TiFirmware, open_radar, open_radar_text};
use radarllm_radar_dsp::DspOptions;
use radarllm_synth::{
    Method, SimulateOptions, Simulation, Synthesizer,
    objects::ObjectsFile,
    scene::{OwnedScene, SceneFile},
    simulate_cubes, simulate_motion,
};

const SCENE: &str = "duration_s = 0.3\n[[target]]\nkind = \"point\"\nposition_m = [0.0, 3.0, 0.2]\n\
    velocity_mps = [0.0, 1.0, 0.0]\nrcs_m2 = 1.0\n[processing]\nmax_points = 4\n";

/// A board whose firmware keeps clutter.
const CFG: &str = "channelCfg 15 7 0\nadcCfg 2 1\nprofileCfg 0 60.25 350 6 58 0 0 60 1 224 4500 0 0 30\n\
    chirpCfg 0 0 0 0 0 0 0 1\nchirpCfg 1 1 0 0 0 0 0 4\nchirpCfg 2 2 0 0 0 0 0 2\nframeCfg 0 2 16 0 100 1 0\n\
    cfarCfg -1 0 2 8 4 3 0 15 1\ncfarCfg -1 1 0 4 2 3 1 15 1\ncfarFovCfg -1 0 0 6\n";

#[test]
fn a_scene_is_simulated_by_the_same_call() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.toml");
    fs::write(&path, SCENE).unwrap();
    let radar = open_radar("awr1843boost").unwrap().into_config().unwrap();
    let options = SimulateOptions {
        seed: 7,
        ..SimulateOptions::default()
    };
    let simulated = simulate_motion(&path.to_string_lossy(), &radar, &options).unwrap();
    assert!(simulated.performed.is_none());
    let file = SceneFile::from_toml(SCENE).unwrap();
    let scene = OwnedScene::open(&file, folder.path(), radar.carrier_hz()).unwrap();
    let mut chain = Synthesizer::with_simulation(
        &radar,
        Method::Fast,
        file.processing.resolve(&radar),
        file.sim_options(),
    )
    .unwrap();
    let expected = chain.scene_to_points(&scene.scene(), 3, 7).unwrap();
    assert_eq!(simulated.clip.frames, expected);
    assert!(simulated.clip.n_points() > 0);
    let all = SimulateOptions {
        processing: Some(DspOptions::default()),
        ..options.clone()
    };
    let all = simulate_motion(&path.to_string_lossy(), &radar, &all).unwrap();
    assert!(all.clip.n_points() > simulated.clip.n_points());
    let cubes = simulate_cubes(&path.to_string_lossy(), &radar, &options).unwrap();
    assert_eq!(cubes.count(), 3);
    fs::write(&path, "duration_s = 0.3\ntarget = 1\n").unwrap();
    let error = simulate_motion(&path.to_string_lossy(), &radar, &options).unwrap_err();
    assert!(error.to_string().contains("scene.toml"), "{error}");
}

#[test]
fn a_scene_has_the_height_of_its_room_and_refuses_options_of_motions() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.toml");
    let radar = open_radar("awr1843boost").unwrap().into_config().unwrap();
    let simulate =
        |options: SimulateOptions| simulate_motion(&path.to_string_lossy(), &radar, &options);
    let height_m = |radar_height_m| SimulateOptions {
        radar_height_m,
        ..SimulateOptions::default()
    };
    fs::write(&path, SCENE).unwrap();
    assert_eq!(simulate(height_m(0.7)).unwrap().clip.radar_height_m, 0.7);
    let room = "[room]\nradar_height_m = 1.8\nfacet_edge_m = 0.5\n";
    fs::write(&path, format!("max_bounces = 1\n{SCENE}{room}")).unwrap();
    for options in [SimulateOptions::default(), height_m(1.8)] {
        assert_eq!(simulate(options).unwrap().clip.radar_height_m, 1.8);
    }
    let body = SimulateOptions {
        body: Some("no-such-body.npz".into()),
        ..SimulateOptions::default()
    };
    let distance = SimulateOptions {
        distance_m: 2.0,
        ..SimulateOptions::default()
    };
    let cfg = open_radar_text(Path::new("demo.cfg"), CFG).unwrap();
    let firmware = SimulateOptions {
        firmware: Some(TiFirmware::from_name("out-of-box", &cfg).unwrap()),
        ..SimulateOptions::default()
    };
    for (options, words) in [
        (height_m(0.7), &["1.8 m", "`radar_height_m` is 0.7 m"][..]),
        (body, &["`body`"]),
        (distance, &["`distance_m`"]),
        (firmware, &["`firmware`", "[processing]"]),
    ] {
        let error = simulate(options).unwrap_err().to_string();
        assert!(error.contains("scene.toml"), "{error}");
        assert!(words.iter().all(|word| error.contains(word)), "{error}");
    }
}

#[test]
fn a_person_is_at_the_distance_that_was_asked_for_or_refused() {
    // Its maximum range is 10.99 m.
    let radar = open_radar("awr1843boost").unwrap().into_config().unwrap();
    let open = |input: &str, distance_m: f32| {
        let options = SimulateOptions {
            distance_m,
            ..SimulateOptions::default()
        };
        Simulation::open(input, &radar, &options)
    };
    for distance_m in [0.0, 1.2, 11.0, 200.0, f32::NAN] {
        let error = open("builtin:walk", distance_m).err().unwrap().to_string();
        let words = ["`distance_m`", "1.3 m", "10.99 m"];
        assert!(words.iter().all(|word| error.contains(word)), "{error}");
    }
    let far = open("builtin:walk?distance_m=1", 9.0).unwrap();
    assert_eq!((far.moved_to_m(), far.frames_beyond_range()), (None, 0));
    let farther = open("builtin:walk?distance_m=1", 10.9).unwrap();
    let n_beyond = farther.frames_beyond_range();
    assert!(n_beyond > 0 && n_beyond <= farther.n_frames());
    // The near end of a path of about 4 m is at 1.3 m.
    let near = open("builtin:walk?distance_m=4", 1.5).unwrap();
    let moved_to_m = near.moved_to_m().unwrap();
    assert!((3.0..3.6).contains(&moved_to_m), "{moved_to_m}");
}

#[test]
fn firmware_that_reports_its_surroundings_is_simulated_among_objects() {
    let radar = open_radar_text(Path::new("demo.cfg"), CFG).unwrap();
    let firmware = TiFirmware::from_name("out-of-box", &radar).unwrap();
    assert!(firmware.reports_surroundings());
    let simulate = |objects: Option<ObjectsFile>| {
        let options = SimulateOptions {
            firmware: Some(firmware.clone()),
            objects,
            ..SimulateOptions::default()
        };
        simulate_motion(
            "builtin:wave?repetitions=1",
            radar.config().unwrap(),
            &options,
        )
        .unwrap()
        .clip
    };
    let (room, alone) = (simulate(None), simulate(Some(ObjectsFile::none())));
    assert_eq!(room, simulate(Some(ObjectsFile::furnished())));
    assert!(room.n_points() > alone.n_points());
    assert_eq!(room.clutter, Clutter::Unchecked);
}

#[test]
fn options_that_exclude_one_another_are_refused() {
    let radar = open_radar_text(Path::new("demo.cfg"), CFG).unwrap();
    let firmware = TiFirmware::from_name("out-of-box", &radar).unwrap();
    let options = SimulateOptions {
        firmware: Some(firmware),
        ..SimulateOptions::default()
    };
    let input = "builtin:clap";
    let error = simulate_cubes(input, radar.config().unwrap(), &options)
        .err()
        .unwrap();
    assert!(error.to_string().contains("points, not samples"), "{error}");
    let both = SimulateOptions {
        processing: Some(DspOptions::default()),
        ..options
    };
    let error = simulate_motion(input, radar.config().unwrap(), &both).unwrap_err();
    assert!(error.to_string().contains("signal chain"), "{error}");
    let error = TiFirmware::from_name("mine", &radar).unwrap_err();
    assert!(
        error
            .hint
            .is_some_and(|hint| hint.to_string().contains("out-of-box"))
    );
    let body = SimulateOptions {
        body: Some("no-such-body.npz".into()),
        ..SimulateOptions::default()
    };
    let error = simulate_motion(input, radar.config().unwrap(), &body).unwrap_err();
    assert!(error.to_string().contains("no-such-body.npz"), "{error}");
}
