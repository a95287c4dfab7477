//! Cubes from the formula, sample by sample in f64: slow, and independent of the simulator.

#![allow(dead_code)] // Shared by two test binaries, each of which uses a part.

use std::f64::consts::TAU;

use num_complex::{Complex32, Complex64};
use radarllm_base::{RadarConfig, RadarCube, SPEED_OF_LIGHT_MPS, random::step};

/// A point target with constant velocity.
#[derive(Clone, Copy, Debug)]
pub struct Target {
    /// Position at the frame start, m.
    pub position_m: [f64; 3],
    /// Velocity, m/s.
    pub velocity_mps: [f64; 3],
    /// Amplitude of its IF signal, sample units.
    pub amplitude: f64,
}

impl Target {
    /// A target in direction (azimuth, elevation) from boresight that moves radially.
    ///
    /// Azimuth is positive to the right (+x), elevation upwards.
    pub fn radial(range_m: f64, azimuth_deg: f64, elevation_deg: f64, speed_mps: f64) -> Self {
        let u = unit(azimuth_deg, elevation_deg);
        Self {
            position_m: u.map(|c| c * range_m),
            velocity_mps: u.map(|c| c * speed_mps),
            amplitude: 1.0,
        }
    }

    pub fn with_amplitude(self, amplitude: f64) -> Self {
        Self { amplitude, ..self }
    }

    pub fn at(&self, time_s: f64) -> [f64; 3] {
        [0, 1, 2].map(|i| self.position_m[i] + self.velocity_mps[i] * time_s)
    }

    /// Distance from the origin in the middle of the frame's active time, m.
    pub fn middle_range_m(&self, radar: &RadarConfig) -> f64 {
        norm(self.at(0.5 * radar.loop_period_s() * radar.n_loops as f64))
    }
}

pub fn unit(azimuth_deg: f64, elevation_deg: f64) -> [f64; 3] {
    let (az, el) = (azimuth_deg.to_radians(), elevation_deg.to_radians());
    [el.cos() * az.sin(), el.cos() * az.cos(), el.sin()]
}

pub fn norm(v: [f64; 3]) -> f64 {
    v.iter().map(|c| c * c).sum::<f64>().sqrt()
}

/// Sum over targets of a * exp j[2 pi f0 tau + 2 pi S t tau - pi S tau^2], tau the two-way delay from
/// each firing transmitter over the target's place at the very moment to each receiver.
pub fn cube(radar: &RadarConfig, targets: &[Target]) -> RadarCube {
    let mut cube = RadarCube::zeros(
        radar.n_loops,
        radar.tx.len(),
        radar.rx.len(),
        radar.n_samples,
    );
    let mut i = 0;
    for loop_idx in 0..radar.n_loops {
        for slot in 0..radar.tx.len() {
            for rx in &radar.rx {
                for n in 0..radar.n_samples {
                    let t = radar.adc_start_s + n as f64 / radar.sample_rate_hz;
                    let now_s = radar.ramp_start_s(loop_idx, slot) + t;
                    let mut sum = Complex64::ZERO;
                    for target in targets {
                        let [x, y, z] = target.at(now_s);
                        for (tx_idx, tx) in radar.tx.iter().enumerate() {
                            let weight = radar.tx_weight(slot, tx_idx);
                            if weight == 0.0 {
                                continue;
                            }
                            let out_m = norm([x - tx.x_m, y, z - tx.z_m]);
                            let back_m = norm([x - rx.x_m, y, z - rx.z_m]);
                            let tau = (out_m + back_m) / SPEED_OF_LIGHT_MPS;
                            let turns = (radar.start_hz + radar.slope_hz_per_s * t) * tau
                                - 0.5 * radar.slope_hz_per_s * tau * tau;
                            let phasor = Complex64::from_polar(1.0, TAU * turns.fract());
                            sum += weight * target.amplitude * phasor;
                        }
                    }
                    cube.data[i] = Complex32::new(sum.re as f32, sum.im as f32);
                    i += 1;
                }
            }
        }
    }
    cube
}

/// Enough randomness for noise tests, and always the same.
pub struct Random(pub u64);

impl Random {
    /// Uniform in (0, 1].
    pub fn uniform(&mut self) -> f64 {
        (step(&mut self.0) >> 11) as f64 / (1_u64 << 53) as f64 + f64::EPSILON
    }

    /// Complex white noise of power 1.
    pub fn complex(&mut self) -> Complex64 {
        let radius = (-self.uniform().ln()).sqrt();
        Complex64::from_polar(radius, TAU * self.uniform())
    }
}

/// Adds complex white noise of the given power per sample.
pub fn add_noise(cube: &mut RadarCube, power: f64, random: &mut Random) {
    let scale = power.sqrt();
    for value in &mut cube.data {
        let noise = random.complex() * scale;
        *value += Complex32::new(noise.re as f32, noise.im as f32);
    }
}

/// A small radar with the reference geometry, for tests that need many or odd-sized cubes.
pub fn small_radar(n_loops: usize, n_samples: usize) -> RadarConfig {
    RadarConfig {
        n_loops,
        n_samples,
        name: "small".into(),
        ..RadarConfig::awr1843boost()
    }
}
