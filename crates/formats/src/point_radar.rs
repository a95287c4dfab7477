//! What recorded points need of a radar: frame rate, mounting and resolutions, without the shape of a cube.
//!
//! A chirp file serves two masters. Raw samples need the shape of the cube, which only frames of equal chirps have.
//! Points need no more than a [`PointRadar`], which every dialect of TI's chirp files gives.

use std::fmt;

use radarllm_base::{RadarConfig, SPEED_OF_LIGHT_MPS};

use crate::SensorPosition;

/// Shortest and longest frame period that is believed, s: a single chirp, and a day of a device that sleeps in between.
const FRAME_PERIODS_S: [f64; 2] = [1e-5, 86_400.0];

/// Dialect of a chirp file, by the commands that define its frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChirpDialect {
    /// `profileCfg`, `chirpCfg` and `frameCfg` of SDK 1 to 3 (xWR14xx, 16xx, 18xx, 64xx, 68xx).
    Sdk,
    /// `advFrameCfg` and `subFrameCfg` of the same SDKs: a frame of up to four sub-frames.
    AdvancedFrames,
    /// MCU+ SDK (xWR2944 and relatives): `frameCfg` with the number of samples as fifth of eight values.
    McuPlus,
    /// Low-power SDK (xWRL1432, xWRL6432, xWRL6844): `chirpComnCfg`, `chirpTimingCfg` and `frameCfg` of bursts.
    LowPower,
}

impl fmt::Display for ChirpDialect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            ChirpDialect::Sdk => "mmWave SDK 1 to 3",
            ChirpDialect::AdvancedFrames => "mmWave SDK 1 to 3 with advanced frames",
            ChirpDialect::McuPlus => "MCU+ SDK (xWR2944)",
            ChirpDialect::LowPower => "low-power SDK (xWRL1432, xWRL6432, xWRL6844)",
        })
    }
}

/// What recorded points need of a radar. `None` is what its description does not determine.
#[derive(Clone, Debug, PartialEq)]
pub struct PointRadar {
    /// Name of the board or device in reports.
    pub name: String,
    /// Dialect of the chirp file; `None` for other descriptions.
    pub dialect: Option<ChirpDialect>,
    /// Time from one frame to the next, s. A frame of sub-frames lasts as long as these together.
    pub frame_period_s: f64,
    /// Frequency in the middle of the ADC window, Hz.
    pub carrier_hz: Option<f64>,
    /// Bandwidth that is swept while the ADC samples, Hz.
    pub sampled_bandwidth_hz: Option<f64>,
    /// Width of a range bin, m.
    pub range_resolution_m: Option<f64>,
    /// End of the last range bin, m. Real samples have half as many bins as samples.
    pub max_range_m: Option<f64>,
    /// Width of a Doppler bin, m/s.
    pub velocity_resolution_mps: Option<f64>,
    /// Unambiguous radial speed, m/s.
    pub max_velocity_mps: Option<f64>,
    /// Height and angles of the sensor (`sensorPosition`).
    pub position: Option<SensorPosition>,
}

impl PointRadar {
    /// A radar of which only the frame period is known, s.
    ///
    /// # Errors
    /// A period that is not from ten microseconds to a day.
    pub(crate) fn new(
        name: String,
        dialect: ChirpDialect,
        frame_period_s: f64,
    ) -> Result<Self, String> {
        let [shortest_s, longest_s] = FRAME_PERIODS_S;
        if !(shortest_s..=longest_s).contains(&frame_period_s) {
            return Err(format!(
                "a frame period of {} ms: expected {} to {} ms",
                frame_period_s * 1e3,
                shortest_s * 1e3,
                longest_s * 1e3
            ));
        }
        Ok(Self {
            name,
            dialect: Some(dialect),
            frame_period_s,
            carrier_hz: None,
            sampled_bandwidth_hz: None,
            range_resolution_m: None,
            max_range_m: None,
            velocity_resolution_mps: None,
            max_velocity_mps: None,
            position: None,
        })
    }

    /// Adds the figures of range: R = c / (2 B) for the sampled bandwidth B = S N / f.
    pub(crate) fn set_range(&mut self, sampling: &Sampling) {
        let bandwidth_hz = sampling.slope_hz_per_s * sampling.window_s();
        let carrier_hz = sampling.carrier_hz();
        let is_possible = |v: f64| v.is_finite() && v > 0.0;
        if !(is_possible(bandwidth_hz) && is_possible(carrier_hz)) {
            return;
        }
        let bin_m = SPEED_OF_LIGHT_MPS / (2.0 * bandwidth_hz);
        let n_bins = match sampling.is_real {
            true => sampling.n_samples / 2,
            false => sampling.n_samples,
        };
        self.carrier_hz = Some(carrier_hz);
        self.sampled_bandwidth_hz = Some(bandwidth_hz);
        self.range_resolution_m = Some(bin_m);
        self.max_range_m = Some(bin_m * f64::from(n_bins));
    }

    /// Adds the figures of velocity: v = lambda / (4 T) either way in as many bins as loops, where T is the time from
    /// one loop to the next, s. Needs those of range.
    pub(crate) fn set_velocity(&mut self, loop_period_s: f64, n_loops: u32) {
        let Some(carrier_hz) = self.carrier_hz else {
            return;
        };
        let max_mps = SPEED_OF_LIGHT_MPS / (4.0 * carrier_hz * loop_period_s);
        if !(max_mps.is_finite() && max_mps > 0.0) || n_loops == 0 {
            return;
        }
        self.max_velocity_mps = Some(max_mps);
        self.velocity_resolution_mps = Some(2.0 * max_mps / f64::from(n_loops));
    }

    /// Frames per second.
    pub fn frame_rate_hz(&self) -> f64 {
        1.0 / self.frame_period_s
    }
}

/// Everything that a radar with a cube has; the dialect and the mounting are those of its description.
impl From<&RadarConfig> for PointRadar {
    fn from(radar: &RadarConfig) -> Self {
        Self {
            name: radar.name.clone(),
            dialect: None,
            frame_period_s: radar.frame_period_s,
            carrier_hz: Some(radar.carrier_hz()),
            sampled_bandwidth_hz: Some(radar.sampled_bandwidth_hz()),
            range_resolution_m: Some(radar.range_resolution_m()),
            max_range_m: Some(radar.max_range_m()),
            velocity_resolution_mps: Some(radar.velocity_resolution_mps()),
            max_velocity_mps: Some(radar.max_velocity_mps()),
            position: None,
        }
    }
}

/// A ramp and its ADC window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Sampling {
    pub start_hz: f64,
    pub slope_hz_per_s: f64,
    /// ADC start after the ramp start, s.
    pub adc_start_s: f64,
    pub n_samples: u32,
    pub sample_rate_hz: f64,
    /// Whether samples are real.
    pub is_real: bool,
}

impl Sampling {
    pub(crate) fn window_s(&self) -> f64 {
        f64::from(self.n_samples) / self.sample_rate_hz
    }

    fn carrier_hz(&self) -> f64 {
        self.start_hz + self.slope_hz_per_s * (self.adc_start_s + 0.5 * self.window_s())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_are_those_of_the_reference_radar() {
        let radar = RadarConfig::awr1843boost();
        let mut points =
            PointRadar::new(radar.name.clone(), ChirpDialect::Sdk, radar.frame_period_s).unwrap();
        points.set_range(&Sampling {
            start_hz: radar.start_hz,
            slope_hz_per_s: radar.slope_hz_per_s,
            adc_start_s: radar.adc_start_s,
            n_samples: 256,
            sample_rate_hz: radar.sample_rate_hz,
            is_real: false,
        });
        points.set_velocity(radar.loop_period_s(), 128);
        points.dialect = None;
        let expected = PointRadar::from(&radar);
        let figures = |p: &PointRadar| {
            [
                p.carrier_hz,
                p.sampled_bandwidth_hz,
                p.range_resolution_m,
                p.max_range_m,
                p.velocity_resolution_mps,
                p.max_velocity_mps,
            ]
            .map(Option::unwrap)
        };
        for (found, expected) in figures(&points).iter().zip(figures(&expected)) {
            assert!((found / expected - 1.0).abs() < 1e-12, "{found} {expected}");
        }
        assert_eq!(points.frame_rate_hz(), 10.0);
    }

    #[test]
    fn impossible_periods_and_ramps_are_not_believed() {
        let new = |period_s| PointRadar::new("r".into(), ChirpDialect::Sdk, period_s);
        for period_s in [0.0, -0.1, f64::NAN, f64::INFINITY, 1e-9, 1e9] {
            assert!(new(period_s).is_err(), "{period_s}");
        }
        let mut points = new(0.1).unwrap();
        for (slope_hz_per_s, sample_rate_hz) in
            [(0.0, 1e6), (-1e12, 1e6), (f64::NAN, 1e6), (1e12, 0.0)]
        {
            points.set_range(&Sampling {
                start_hz: 60e9,
                slope_hz_per_s,
                adc_start_s: 0.0,
                n_samples: 64,
                sample_rate_hz,
                is_real: true,
            });
            points.set_velocity(1e-3, 64);
            assert_eq!(points, new(0.1).unwrap());
        }
    }
}
