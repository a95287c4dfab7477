//! Thermal noise of the virtual radar as the signal chain sees it.

use radarllm_base::{BOLTZMANN_J_PER_K, RadarConfig};
use radarllm_radar_dsp::{Detector, DspOptions, ImpossibleDirection, Window};
use radarllm_radar_sim::Scene;
use radarllm_synth::{Method, Synthesizer, config::DatasetConfig, record::make_record};

/// k T0 B F through both windows, and the number of false alarms that was asked for.
#[test]
fn noise_floor_and_false_alarms_are_those_of_k_t_b_f() {
    for noise_figure_db in [15.0, 6.0] {
        let radar = RadarConfig {
            noise_figure_db,
            ..RadarConfig::awr1843boost()
        };
        let design = 20.0;
        let options = DspOptions {
            detector: Detector::NoiseFloor {
                false_alarms_per_frame: design,
            },
            max_points: 10_000,
            // So that cells with impossible directions are counted too.
            impossible_direction: ImpossibleDirection::Clamp,
            ..DspOptions::default()
        };
        let mut chain = Synthesizer::new(&radar, Method::Fast, options).unwrap();
        let n_frames = 12;
        let frames = chain
            .scene_to_points(&Scene::default(), n_frames, 5)
            .unwrap();
        let alarms: usize = frames.iter().map(|f| f.points.len()).sum();
        let expected = design * n_frames as f64;
        // Neighbouring cells share noise through the windows, so that false alarms come in clusters of
        // up to about two: four deviations of a doubled Poisson variance.
        assert!(
            (alarms as f64 - expected).abs() < 4.0 * (2.0 * expected).sqrt(),
            "{alarms} for {expected}"
        );
        let energy = |n| {
            Window::Hamming
                .weights(n)
                .iter()
                .map(|w| f64::from(w * w))
                .sum::<f64>()
        };
        let noise_w =
            BOLTZMANN_J_PER_K * 290.0 * radar.sample_rate_hz * 10_f64.powf(0.1 * noise_figure_db);
        let floor = f64::from(chain.extractor().0.noise_floor().unwrap());
        let ratio = floor / (noise_w * energy(radar.n_samples) * energy(radar.n_loops));
        // The median of 30,000 correlated cells of Gamma(12) is known to 0.3 %; the slow-time mean
        // takes 1/128 of the noise away around zero velocity.
        assert!((ratio - 1.0).abs() < 0.015, "{noise_figure_db} dB: {ratio}");
    }
}

/// Equation S2 of the RadarLLM paper in the configuration of a data set, and the paper's chain beside it.
#[test]
fn data_sets_have_noise_of_a_signal_to_noise_ratio_and_the_papers_chain() {
    let record = |tables: &str| {
        let text = format!(
            "facet_edge_m = 0.05\nmax_frames = 3\n{tables}\n[[source]]\nkind = \"procedural\"\ntrain = 1\nval = 0\ntest = 0\n"
        );
        let config = DatasetConfig::from_toml(&text).unwrap();
        let radar = config.open_radar(std::path::Path::new("")).unwrap();
        let mut chain = config.synthesizer(&radar).unwrap();
        let sources = config.open_sources(std::path::Path::new("")).unwrap();
        let record = make_record(&mut chain, sources[0].as_ref(), 0, 0, &config).unwrap();
        (record, chain.extractor().0.noise_floor())
    };
    let (thermal, _) = record("");
    let (weak, weak_floor) = record("[noise]\nsnr_db = -10.0");
    let (strong, strong_floor) = record("[noise]\nsnr_db = -30.0");
    assert_eq!(thermal.motion_features, weak.motion_features);
    assert!(thermal.frames != weak.frames && weak.frames != strong.frames);
    // The noise is the same random numbers with 20 dB more power. The floor, a median, contains little of the person.
    let ratio = strong_floor.unwrap() / weak_floor.unwrap();
    assert!((ratio / 100.0 - 1.0).abs() < 0.02, "{ratio}");
    let (printed, floor) = record("[noise]\nsnr_db = 20.0\n[processing]\npreset = \"paper\"");
    assert_eq!(floor, None);
    assert!(printed.frames.iter().all(|f| f.points.len() == 128));
    let (figure, _) = record("[noise]\nnoise_figure_db = 40.0");
    assert!(figure.frames != thermal.frames);
}
