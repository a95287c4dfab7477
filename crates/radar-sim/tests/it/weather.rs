//! Rain and smoke against the radar equation.

use std::f64::consts::PI;

use glam::DVec3;
use num_complex::Complex64;
use radarllm_base::{RadarConfig, RadarCube, SPEED_OF_LIGHT_MPS};
use radarllm_radar_sim::weather::{rain_backscatter_per_m, rain_db_per_m};
use radarllm_radar_sim::{Noise, PointTarget, Scene, SimOptions, Simulator, Weather, reference};

const RAIN: Weather = Weather {
    rain_mm_per_h: 25.0,
    smoke_g_per_m3: 0.0,
};

fn options(weather: Weather) -> SimOptions {
    SimOptions {
        weather,
        ..SimOptions::default()
    }
}

fn scene(points: Vec<PointTarget>) -> Scene<'static> {
    Scene {
        surfaces: vec![],
        points,
        noise: Noise::Off,
    }
}

fn frame(config: &RadarConfig, weather: Weather, scene: &Scene<'_>, time_s: f64) -> RadarCube {
    let mut simulator = Simulator::new(config, options(weather)).unwrap();
    let mut cube = simulator.new_cube();
    simulator
        .simulate_frame(scene, 0, time_s, 7, &mut cube)
        .unwrap();
    cube
}

/// One antenna each, one chirp.
fn small() -> RadarConfig {
    let base = RadarConfig::awr1843boost();
    RadarConfig {
        tx: vec![base.tx[0]],
        rx: vec![base.rx[0]],
        n_loops: 1,
        ..base
    }
}

#[test]
fn a_range_cell_of_rain_has_the_power_of_the_radar_equation() {
    let config = small();
    let carrier_hz = SPEED_OF_LIGHT_MPS / config.wavelength_m();
    let mut simulator = Simulator::new(&config, options(RAIN)).unwrap();
    let mut cube = simulator.new_cube();
    let n = config.n_samples;
    // Bins 47 to 139: 2 to 6 m. A bin's rectangular window leaks from nearer, stronger cells by less
    // than 1 %.
    let bins = 47..140;
    let mut power_w = vec![0.0; n];
    let n_frames = 300;
    for frame in 0..n_frames {
        let time_s = 0.1 * f64::from(frame);
        simulator
            .simulate_frame(&scene(vec![]), 0, time_s, 7, &mut cube)
            .unwrap();
        for bin in bins.clone() {
            let turn = -2.0 * PI * bin as f64 / n as f64;
            let sum: Complex64 = cube
                .data
                .iter()
                .enumerate()
                .map(|(i, z)| {
                    Complex64::new(f64::from(z.re), f64::from(z.im))
                        * Complex64::from_polar(1.0, turn * i as f64)
                })
                .sum();
            power_w[bin] += sum.norm_sqr() / (n * n) as f64 / f64::from(n_frames);
        }
    }
    let power_in_w = 1e-3 * 10_f64.powf(0.1 * config.tx_power_dbm);
    let gain = 10_f64.powf(0.1 * config.antenna_gain_dbi);
    // Solid angle of the two-way pattern 2^(-2 (az/az_half)^2 - 2 (el/el_half)^2), by Gaussian
    // integrals: cos(elevation) takes 1 - s^2 / 2 of it, s the pattern's deviation, 0.147 rad.
    let [az, el] = [
        config.azimuth_half_width_rad,
        config.elevation_half_width_rad,
    ];
    let deviation = |half: f64| half / (4.0 * std::f64::consts::LN_2).sqrt();
    let beam_sr = 2.0 * PI * deviation(az) * deviation(el) * (-0.5 * deviation(el).powi(2)).exp();
    let mut ratio = 0.0;
    for bin in bins.clone() {
        let range_m = bin as f64 * config.range_resolution_m();
        let volume_m3 = config.range_resolution_m() * range_m * range_m * beam_sr;
        let loss = 10_f64.powf(-0.2 * rain_db_per_m(carrier_hz, 25.0) * range_m);
        let expected_w = power_in_w
            * gain
            * gain
            * config.wavelength_m().powi(2)
            * rain_backscatter_per_m(carrier_hz, 25.0)
            * volume_m3
            * loss
            / ((4.0 * PI).powi(3) * range_m.powi(4));
        ratio += power_w[bin] / expected_w / bins.len() as f64;
    }
    // 93 bins, 300 frames, 8 drops a cell: exponential powers, a deviation of 1 / sqrt(27,900) = 0.6 %;
    // neighbouring bins are independent. Five of them and 1 % of leakage.
    assert!((ratio - 1.0).abs() < 0.04, "{ratio}");
}

#[test]
fn drops_are_the_same_in_the_direct_sum_and_fall() {
    let config = RadarConfig {
        n_loops: 64,
        ..RadarConfig::awr1843boost()
    };
    let point = PointTarget::at(DVec3::new(0.2, 3.0, 0.1), 1e-4);
    let scene = scene(vec![point]);
    let fast = frame(&config, RAIN, &scene, 0.4);
    let mut slow = RadarCube::zeros(64, 3, 4, config.n_samples);
    let loops = [0, 40, 63];
    for l in loops {
        reference::simulate_loops(&config, &options(RAIN), &scene, 0.4, 7, l..l + 1, &mut slow)
            .unwrap();
    }
    let len = 3 * 4 * config.n_samples;
    let (mut error, mut peak) = (0.0_f32, 0.0_f32);
    for l in loops {
        let of = |cube: &RadarCube| cube.data[l * len..(l + 1) * len].to_vec();
        for (f, s) in of(&fast).iter().zip(of(&slow)) {
            error = error.max((f - s).norm());
            peak = peak.max(s.norm());
        }
    }
    let error_db = 20.0 * (error / peak).log10();
    println!("rain: {error_db:.1} dB");
    assert!(error_db < -60.0, "{error_db}");

    // Other frames and seeds have other drops; the same has the same.
    let clear = Weather::default();
    assert_eq!(frame(&config, RAIN, &scene, 0.4).data, fast.data);
    assert_ne!(frame(&config, RAIN, &scene, 0.5).data, fast.data);
    assert_ne!(frame(&config, clear, &scene, 0.4).data, fast.data);
}

#[test]
fn attenuation_is_exact() {
    let config = small();
    let carrier_hz = SPEED_OF_LIGHT_MPS / config.wavelength_m();
    let smoke = Weather {
        smoke_g_per_m3: 100.0,
        ..Weather::default()
    };
    for range_m in [2.0, 9.0] {
        let scene = scene(vec![PointTarget::at(DVec3::Y * range_m, 1.0)]);
        let clear = frame(&config, Weather::default(), &scene, 0.0);
        let dim = frame(&config, smoke, &scene, 0.0);
        let found = f64::from(dim.data[128].norm() / clear.data[128].norm());
        // The range from the array's centre, 1 cm aside, is 25 um longer at most; f32 arithmetic.
        let expected = 10_f64.powf(-smoke.smoke_db_per_m(carrier_hz) * 2.0 * range_m / 20.0);
        assert!((found / expected - 1.0).abs() < 1e-5, "{found} {expected}");
    }
}
