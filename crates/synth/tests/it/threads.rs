//! One motion on several threads, as points and as raw samples.

use std::{
    path::Path,
    sync::atomic::{AtomicUsize, Ordering},
};

use radarllm_radar_dsp::{DspOptions, PointExtractor};
use radarllm_synth::{
    DatasetPlan, SimulateOptions, SynthError, config::DatasetConfig, simulate::noise_seed,
    simulate_cubes, simulate_motion, simulate_motion_until,
};

#[test]
fn one_motion_gives_the_same_points_on_any_number_of_threads() {
    let radar = radarllm_io::open_radar("iwr6843isk")
        .unwrap()
        .into_config()
        .unwrap();
    let clip = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        let input = "builtin:clap?repetitions=2";
        pool.install(|| simulate_motion(input, &radar, &SimulateOptions::default()))
            .unwrap()
            .clip
    };
    let one = clip(1);
    assert!(one.frames.len() > 8 && one.n_points() > 50);
    assert_eq!(clip(2), one);
    assert_eq!(clip(3), one);
}

#[test]
fn cubes_are_those_of_the_points() {
    let radar = radarllm_io::open_radar("iwr6843isk")
        .unwrap()
        .into_config()
        .unwrap();
    let options = SimulateOptions::default();
    let input = "builtin:clap?repetitions=2";
    let clip = simulate_motion(input, &radar, &options).unwrap().clip;
    let mut chain = PointExtractor::new(&radar, DspOptions::default()).unwrap();
    let mut cubes = simulate_cubes(input, &radar, &options).unwrap();
    for (cube, frame) in cubes.by_ref().zip(&clip.frames[..3]) {
        assert_eq!(chain.extract(&cube.unwrap()).unwrap().points, frame.points);
    }
    assert_eq!(cubes.count(), clip.frames.len() - 4);
}

#[test]
fn motions_have_noise_of_their_own_if_asked_for() {
    let radar = radarllm_io::open_radar("iwr6843isk")
        .unwrap()
        .into_config()
        .unwrap();
    let input = "builtin:clap?repetitions=2";
    let options = SimulateOptions {
        own_noise: true,
        ..SimulateOptions::default()
    };
    let own = simulate_motion(input, &radar, &options).unwrap().clip;
    let seed = noise_seed(input, 1);
    assert_eq!(own.provenance.seed(), Some(seed));
    assert_ne!(seed, noise_seed("builtin:wave", 1));
    assert_eq!(noise_seed("a/take.bvh", 1), noise_seed("b/take.bvh", 1));
    let shared = simulate_motion(input, &radar, &SimulateOptions::default());
    assert_ne!(own.frames, shared.unwrap().clip.frames);
}

#[test]
fn a_stopped_simulation_is_an_interruption() {
    let radar = radarllm_io::open_radar("iwr6843isk")
        .unwrap()
        .into_config()
        .unwrap();
    let n_asked = AtomicUsize::new(0);
    let stop = || n_asked.fetch_add(1, Ordering::Relaxed) >= 2;
    let options = SimulateOptions::default();
    let error = simulate_motion_until("builtin:clap", &radar, &options, &stop).unwrap_err();
    assert_eq!(error.kind, radarllm_io::ErrorKind::Interrupted);
    assert!(n_asked.into_inner() < 20);
}

#[test]
fn a_plan_stopped_while_it_draws_motions_is_an_interruption() {
    let text =
        "name = \"many\"\n[[source]]\nkind = \"procedural\"\ntrain = 1000000\nval = 1\ntest = 1\n";
    let config = DatasetConfig::from_toml(text).unwrap();
    let n_asked = AtomicUsize::new(0);
    let stop = || n_asked.fetch_add(1, Ordering::Relaxed) >= 2;
    let found = DatasetPlan::new_until(config, Path::new(""), &stop);
    assert!(matches!(found.err(), Some(SynthError::Interrupted)));
}
