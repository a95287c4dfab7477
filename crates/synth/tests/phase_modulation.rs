//! Binary phase modulation from the simulator through the signal chain.

#![allow(clippy::unwrap_used, reason = "a test")]

use glam::DVec3;
use radarllm_base::radar_config::TxMultiplexing;
use radarllm_base::{RadarConfig, RadarCube};
use radarllm_radar_dsp::{ClutterFilter, DspOptions, spectrum::Spectrum};
use radarllm_radar_sim::{Noise, PointTarget, Scene};
use radarllm_synth::{Method, Synthesizer};

/// TX1 and the raised TX2 of the reference board: elevation is the phase between the two.
fn radar(multiplexing: TxMultiplexing) -> RadarConfig {
    let mut radar = RadarConfig {
        multiplexing,
        ..RadarConfig::awr1843boost()
    };
    radar.tx = vec![radar.tx[0], radar.tx[2]];
    radar
}

fn scene(points: Vec<PointTarget>, noise: Noise) -> Scene<'static> {
    Scene {
        points,
        noise,
        ..Scene::default()
    }
}

fn mover() -> PointTarget {
    PointTarget {
        position_m: DVec3::new(0.5, 2.8, 0.6),
        velocity_mps: DVec3::new(0.6, 3.4, 0.7),
        rcs_m2: 0.1,
    }
}

fn cube(radar: &RadarConfig, scene: &Scene) -> RadarCube {
    let mut synthesizer =
        Synthesizer::new(radar, Method::Reference, DspOptions::default()).unwrap();
    synthesizer.simulate(scene, 0, 11).unwrap().clone()
}

#[test]
fn a_mover_is_found_where_it_is() {
    let radar = radar(TxMultiplexing::Bpm);
    let mut synthesizer = Synthesizer::new(&radar, Method::Fast, DspOptions::default()).unwrap();
    let mover = mover();
    let frames = synthesizer
        .scene_to_points(&scene(vec![mover], Noise::Thermal), 1, 11)
        .unwrap();
    let point = frames[0].points[0];
    // Points describe the middle of the active time.
    let middle_s = 0.5 * radar.loop_period_s() * radar.n_loops as f64;
    let truth = mover.position_m + middle_s * mover.velocity_mps;
    let speed_mps = mover.velocity_mps.dot(truth) / truth.length();
    // Half a bin each in range and velocity.
    let range_error_m = f64::from(point.range_m) - truth.length();
    assert!(range_error_m.abs() < 0.51 * radar.range_resolution_m() + 0.001);
    let speed_error_mps = f64::from(point.velocity_mps) - speed_mps;
    assert!(speed_error_mps.abs() < 0.51 * radar.velocity_resolution_mps());
    // 3.0 m times: 0.0123 rad of half a Doppler bin and as much of the other transmitter's rest, over
    // pi; the parabola over four elements; 4 mm between antennas; half a range bin of 0.02 m.
    for (found, wanted) in [
        (point.x_m, truth.x),
        (point.y_m, truth.y),
        (point.z_m, truth.z),
    ] {
        assert!(
            (f64::from(found) - wanted).abs() < 0.035,
            "{point:?}, {truth}"
        );
    }
}

/// Both transmitters are heard in both slots, so that the decoded echo is as strong as in time
/// division and the noise of two slots is averaged: 10 log10 2 = 3.01 dB for every virtual channel.
#[test]
fn every_virtual_channel_gains_three_decibels_over_time_division() {
    let options = DspOptions {
        clutter: ClutterFilter::Off,
        ..DspOptions::default()
    };
    let spectra = |radar: &RadarConfig, cube: &RadarCube| {
        let mut spectrum = Spectrum::new(radar, &options).unwrap();
        spectrum.run(cube).unwrap();
        let n_cells = spectrum.map.len();
        let power =
            |channel: usize, cell: usize| f64::from(spectrum.value(channel, cell).norm_sqr());
        (0..spectrum.n_channels())
            .map(|channel| (0..n_cells).map(|cell| power(channel, cell)).collect())
            .collect::<Vec<Vec<f64>>>()
    };
    // Echo: the strongest cell without noise. Noise: the mean over all cells of an empty scene.
    let snr_db = |multiplexing: TxMultiplexing| -> Vec<f64> {
        let radar = radar(multiplexing);
        let echo = spectra(&radar, &cube(&radar, &scene(vec![mover()], Noise::Off)));
        let noise = spectra(&radar, &cube(&radar, &scene(vec![], Noise::Thermal)));
        echo.iter()
            .zip(&noise)
            .map(|(echo, noise)| {
                let mean = noise.iter().sum::<f64>() / noise.len() as f64;
                let peak = echo.iter().copied().fold(0.0, f64::max);
                10.0 * (peak / mean).log10()
            })
            .collect()
    };
    let gains: Vec<f64> = snr_db(TxMultiplexing::Bpm)
        .iter()
        .zip(snr_db(TxMultiplexing::Tdm))
        .map(|(bpm, tdm)| bpm - tdm)
        .collect();
    assert_eq!(gains.len(), 8);
    for gain_db in &gains {
        // 30,000 noise cells, a third of them independent under the windows: 0.04 dB each way; the
        // echo loses under 0.06 dB to the other transmitter (-44 dB, in phase at worst).
        assert!((gain_db - 3.01).abs() < 0.2, "{gains:?}");
    }
}
