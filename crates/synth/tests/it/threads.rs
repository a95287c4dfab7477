//! One motion on several threads.

use radarllm_synth::{SimulateOptions, simulate_motion};

#[test]
fn one_motion_gives_the_same_points_on_any_number_of_threads() {
    let radar = radarllm_io::open_radar("iwr6843isk").unwrap().config;
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
