//! Radars, scenes and measurements that the tests of closed forms share.

use radarllm_base::{MovingSurface, RadarConfig, RadarCube};
use radarllm_radar_sim::link::Link;
use radarllm_radar_sim::{Noise, Scene, SimOptions, Simulator};

pub fn frame(config: &RadarConfig, scene: &Scene<'_>, seed: u64) -> RadarCube {
    let mut simulator = Simulator::new(config, SimOptions::default()).unwrap();
    let mut cube = simulator.new_cube();
    simulator
        .simulate_frame(scene, 0, 0.0, seed, &mut cube)
        .unwrap();
    cube
}

pub fn surface(shape: &dyn MovingSurface) -> Scene<'_> {
    surfaces(&[shape])
}

pub fn surfaces<'a>(shapes: &[&'a dyn MovingSurface]) -> Scene<'a> {
    Scene {
        surfaces: shapes.to_vec(),
        points: vec![],
        noise: Noise::Off,
    }
}

/// A few loops are enough for what stands still.
pub fn short() -> RadarConfig {
    RadarConfig {
        n_loops: 2,
        ..RadarConfig::awr1843boost()
    }
}

/// One TX and one RX in the same place: angles of incidence are those of the array centre.
pub fn monostatic() -> RadarConfig {
    let antenna = RadarConfig::awr1843boost().tx[0];
    RadarConfig {
        tx: vec![antenna],
        rx: vec![antenna],
        ..short()
    }
}

/// The same with eight times as many samples in the same window, and so eight times the maximum range, 88 m, for targets
/// in the far field.
pub fn far_field() -> RadarConfig {
    let near = monostatic();
    RadarConfig {
        n_samples: 8 * near.n_samples,
        sample_rate_hz: 8.0 * near.sample_rate_hz,
        ..near
    }
}

/// Cross section from the sample at the ADC centre, where the model's wavelength is exact, m^2.
pub fn rcs_m2(config: &RadarConfig, cube: &RadarCube, range_m: f64) -> f64 {
    let amplitude = f64::from(cube.chirp(0, 0, 0)[config.n_samples / 2].norm());
    (amplitude * range_m * range_m / Link::new(config).amplitude_at_1m).powi(2)
}
