//! The radar equation, the element pattern and thermal noise.

use std::f64::consts::PI;

use crate::weather::Weather;
use glam::{DVec3, Vec3};
use radarllm_base::{BOLTZMANN_J_PER_K, RadarConfig, SPEED_OF_LIGHT_MPS, STANDARD_TEMPERATURE_K};

/// Constants of one radar that convert sqrt(sigma) to amplitude and delay to phase.
#[derive(Clone, Debug)]
pub struct Link {
    /// sqrt(P G G lambda^2 / (4 pi)^3): amplitude of 1 m^2 at 1 m on boresight, sqrt(W).
    pub amplitude_at_1m: f64,
    /// Frequency at the ADC sample number `n_samples / 2`, Hz.
    pub centre_hz: f64,
    /// Wavelength at `centre_hz`, m.
    pub wavelength_m: f64,
    /// Half-power half-widths of one element, azimuth then elevation, rad.
    pub half_widths_rad: [f64; 2],
    /// Mean of the mean TX and the mean RX position. Amplitudes are computed from ranges and angles relative to it.
    pub array_centre_m: DVec3,
    /// Two-way amplitude attenuation by the air per metre of range, as a power of 2.
    pub air_octaves_per_m: f32,
    /// Noise power k T0 B F, where B is the sample rate, W.
    pub noise_w: f64,
    /// Half of the longest path whose beat frequency is below the sample rate, m. Echoes from farther away are not in the
    /// samples.
    pub max_range_m: f64,
}

impl Link {
    /// Constants of `config`, which must be valid.
    pub fn new(config: &RadarConfig) -> Self {
        let middle_s = config.adc_start_s + (config.n_samples / 2) as f64 / config.sample_rate_hz;
        let centre_hz = config.start_hz + config.slope_hz_per_s * middle_s;
        let wavelength_m = SPEED_OF_LIGHT_MPS / centre_hz;
        let power_w = 10_f64.powf((config.tx_power_dbm - 30.0) / 10.0);
        let gain = 10_f64.powf(config.antenna_gain_dbi / 10.0);
        let mean = |antennas: &[radarllm_base::radar_config::Antenna]| {
            let sum = antennas
                .iter()
                .map(|a| DVec3::new(a.x_m, 0.0, a.z_m))
                .sum::<DVec3>();
            sum / antennas.len() as f64
        };
        Self {
            amplitude_at_1m: (power_w * gain * gain * wavelength_m * wavelength_m
                / (4.0 * PI).powi(3))
            .sqrt(),
            centre_hz,
            wavelength_m,
            half_widths_rad: [
                config.azimuth_half_width_rad,
                config.elevation_half_width_rad,
            ],
            array_centre_m: 0.5 * (mean(&config.tx) + mean(&config.rx)),
            air_octaves_per_m: 0.0,
            noise_w: BOLTZMANN_J_PER_K
                * STANDARD_TEMPERATURE_K
                * config.sample_rate_hz
                * 10_f64.powf(config.noise_figure_db / 10.0),
            max_range_m: config.max_range_m(),
        }
    }

    /// The same radar in rain or smoke.
    #[must_use]
    pub fn in_weather(self, weather: &Weather) -> Self {
        // One-way decibels of power are two-way decibels of amplitude.
        let db_per_m = weather.db_per_m(self.centre_hz);
        Self {
            air_octaves_per_m: (db_per_m / (10.0 * 2_f64.log10())) as f32,
            ..self
        }
    }

    /// Amplitude of a target of 1 m^2, sqrt(W), at `from_centre` (relative to the array centre).
    ///
    /// The element pattern is Gaussian in dB: each of TX and RX loses 3.01 dB at the half-width, so
    /// the two-way amplitude is `2^-((az / az_half)^2 + (el / el_half)^2)`. Zero behind the array.
    #[inline(always)]
    pub fn amplitude(&self, from_centre: Vec3) -> f32 {
        let Vec3 { x, y, z } = from_centre;
        let horizontal_square = x * x + y * y;
        let front = y.max(f32::MIN_POSITIVE);
        let horizontal = horizontal_square.sqrt().max(f32::MIN_POSITIVE);
        let azimuth = arc_tangent(x / front) * (1.0 / self.half_widths_rad[0] as f32);
        let elevation = arc_tangent(z / horizontal) * (1.0 / self.half_widths_rad[1] as f32);
        let square = horizontal_square + z * z;
        let air = self.air_octaves_per_m * square.sqrt();
        let loss = exp2_of_negative(-(azimuth * azimuth + elevation * elevation + air));
        let amplitude = self.amplitude_at_1m as f32 * loss / square;
        if y > 0.0 { amplitude } else { 0.0 }
    }
}

/// Arc tangent without branches, so that loops over facets are vectorised. The error is below 3e-7 rad.
///
/// Polynomial: Abramowitz and Stegun 4.4.49.
#[inline(always)]
pub(crate) fn arc_tangent(t: f32) -> f32 {
    let size = t.abs();
    let steep = size > 1.0;
    let x = if steep { 1.0 / size } else { size };
    let y = x * x;
    let mut p = 0.002_866_225_7_f32;
    for c in [
        -0.016_165_737,
        0.042_909_614,
        -0.075_289_64,
        0.106_562_64,
        -0.142_089,
        0.199_935_51,
        -0.333_331_45,
        1.0,
    ] {
        p = p * y + c;
    }
    let angle = p * x;
    let angle = if steep {
        std::f32::consts::FRAC_PI_2 - angle
    } else {
        angle
    };
    angle.copysign(t)
}

/// 2^x for x <= 0 without branches. The relative error is below 3e-7. Results are not below 2^-120.
#[inline(always)]
pub(crate) fn exp2_of_negative(x: f32) -> f32 {
    let x = x.max(-120.0);
    // Adding 1.5 * 2^23 rounds to the nearest integer and leaves it in the low bits.
    const MAGIC: f32 = 12_582_912.0;
    let shifted = x + MAGIC;
    let whole = shifted - MAGIC;
    // (ln 2)^k / k!: 2^f for |f| <= 1/2, remainder (ln 2 / 2)^7 / 7! = 1.2e-7.
    let f = x - whole;
    let mut p = 1.540_353e-4_f32;
    for c in [
        1.333_355_8e-3,
        9.618_129e-3,
        5.550_411e-2,
        0.240_226_5,
        std::f32::consts::LN_2,
        1.0,
    ] {
        p = p * f + c;
    }
    let power = (shifted.to_bits() as i32)
        .wrapping_sub(MAGIC.to_bits() as i32)
        .wrapping_add(127);
    p * f32::from_bits((power << 23) as u32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn elementary_functions_are_accurate() {
        for i in -40_000_i32..=40_000 {
            let t = 1.5_f32.powf(i as f32 / 1000.0) * if i % 2 == 0 { 1.0 } else { -1.0 };
            assert!((arc_tangent(t) - t.atan()).abs() < 4e-7, "{t}");
            let x = i.abs() as f32 * -2.9e-3;
            assert!((exp2_of_negative(x) / x.exp2() - 1.0).abs() < 1e-6, "{x}");
        }
        assert_eq!(arc_tangent(0.0), 0.0);
        assert!(exp2_of_negative(-1e9) < 1e-35);
    }

    #[test]
    fn pattern_loses_three_db_per_way_at_the_half_width() {
        let config = RadarConfig::awr1843boost();
        let link = Link::new(&config);
        let at = |azimuth: f32, elevation: f32| {
            let (s, c) = azimuth.sin_cos();
            let (se, ce) = elevation.sin_cos();
            link.amplitude(Vec3::new(s * ce, c * ce, se)) / link.amplitude(Vec3::Y)
        };
        // The half power on each way is half of the two-way amplitude.
        assert!((at(config.azimuth_half_width_rad as f32, 0.0) - 0.5).abs() < 1e-5);
        assert!((at(0.0, config.elevation_half_width_rad as f32) - 0.5).abs() < 1e-5);
        assert_eq!(link.amplitude(-Vec3::Y), 0.0);
        // 12 dBm, 10.5 dBi twice, 3.79 mm: P G^2 lambda^2 / (4 pi)^3 = 1.443e-8 W by hand.
        assert!(
            (link.amplitude_at_1m.powi(2) / 1.4456e-8 - 1.0).abs() < 2e-3,
            "{}",
            link.amplitude_at_1m.powi(2)
        );
    }
}
