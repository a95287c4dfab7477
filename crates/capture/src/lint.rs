//! What may surprise the owner of a radar description that is otherwise possible.

use radarllm_base::RadarConfig;

/// One remark.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// Field or group of [`RadarConfig`].
    pub field: &'static str,
    /// What is wrong or weak, with numbers.
    pub message: String,
}

/// Legal bands of the supported parts, Hz.
const BANDS_HZ: [(f64, f64); 2] = [(57e9, 64e9), (76e9, 81e9)];
/// Above this share of time on air, parts heat up and regulators ask.
const MAX_DUTY: f64 = 0.5;
/// Hands and feet of a walking or punching person reach this, m/s.
const BODY_SPEED_MPS: f64 = 3.0;
/// A body seen in fewer than about five range bins has no shape, m.
const BODY_RANGE_BIN_M: f64 = 0.1;
/// Coarser Doppler than this merges limbs and torso, m/s.
const BODY_VELOCITY_BIN_MPS: f64 = 0.3;
/// A room, m.
const ROOM_M: f64 = 3.0;
/// Below this, gestures fall between frames, Hz.
const MIN_FRAME_RATE_HZ: f64 = 5.0;
/// TI's chirp timing advice for steep ramps: synthesiser and filters settle in 3 us or more, s.
const MIN_ADC_START_S: f64 = 3e-6;

/// Remarks on a radar meant for describing people; empty if there is nothing to say.
///
/// A radar that [`RadarConfig::validate`] refuses yields that one finding.
pub fn lint(radar: &RadarConfig) -> Vec<Finding> {
    if let Err(e) = radar.validate() {
        return vec![Finding {
            field: e.field,
            message: e.problem,
        }];
    }
    let mut findings = Vec::new();
    let mut say = |field, message: String| findings.push(Finding { field, message });

    let ramp_end_hz = radar.start_hz + radar.slope_hz_per_s * radar.ramp_end_s;
    if !BANDS_HZ
        .iter()
        .any(|(low, high)| radar.start_hz >= *low && ramp_end_hz <= *high)
    {
        say(
            "slope_hz_per_s",
            format!(
                "the ramp runs from {:.3} to {:.3} GHz, outside 57 to 64 and 76 to 81 GHz",
                radar.start_hz / 1e9,
                ramp_end_hz / 1e9
            ),
        );
    }
    if radar.adc_start_s < MIN_ADC_START_S {
        let us = radar.adc_start_s * 1e6;
        say(
            "adc_start_s",
            format!("sampling starts {us:.2} us into the ramp: it may not be settled"),
        );
    }
    let on_air_s = radar.ramp_end_s * (radar.tx.len() * radar.n_loops) as f64;
    let duty = on_air_s / radar.frame_period_s;
    if duty > MAX_DUTY {
        say(
            "frame_period_s",
            format!("transmitting {:.0} % of the time", duty * 100.0),
        );
    }
    if radar.range_resolution_m() > BODY_RANGE_BIN_M {
        let m = radar.range_resolution_m();
        say(
            "n_samples",
            format!("range bins of {m:.3} m: a body covers few of them"),
        );
    }
    if radar.max_range_m() < ROOM_M {
        say(
            "sample_rate_hz",
            format!(
                "ranges end at {:.2} m, and farther targets fold back",
                radar.max_range_m()
            ),
        );
    }
    if radar.n_loops < 2 {
        say(
            "n_loops",
            "a single loop: no velocity, and static clutter cannot be removed".into(),
        );
    } else {
        if radar.max_velocity_mps() < BODY_SPEED_MPS {
            let v = radar.max_velocity_mps();
            say(
                "idle_s",
                format!(
                    "speeds beyond {v:.2} m/s fold to the other sign; limbs reach {BODY_SPEED_MPS} m/s"
                ),
            );
        }
        if radar.velocity_resolution_mps() > BODY_VELOCITY_BIN_MPS {
            let v = radar.velocity_resolution_mps();
            say(
                "n_loops",
                format!("velocity bins of {v:.2} m/s merge limbs and torso"),
            );
        }
    }
    if radar.frame_rate_hz() < MIN_FRAME_RATE_HZ {
        say(
            "frame_period_s",
            format!("{:.1} frames/s miss quick movements", radar.frame_rate_hz()),
        );
    }
    let mut places: Vec<(f64, f64)> = radar
        .tx
        .iter()
        .flat_map(|t| radar.rx.iter().map(move |r| (t.x_m + r.x_m, t.z_m + r.z_m)))
        .collect();
    places.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let spread = |values: &dyn Fn(&(f64, f64)) -> f64| {
        let (low, high) = places
            .iter()
            .map(values)
            .fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(v), h.max(v)));
        high - low
    };
    // A tenth of a millimetre: no board has antennas that close.
    if spread(&|p| p.0) < 1e-4 {
        say(
            "rx",
            "all virtual antennas share one column: no azimuth".into(),
        );
    }
    if spread(&|p| p.1) < 1e-4 {
        say(
            "tx",
            "all virtual antennas share one height: points get z = 0".into(),
        );
    }
    findings
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fields(radar: RadarConfig) -> Vec<&'static str> {
        lint(&radar).into_iter().map(|f| f.field).collect()
    }

    #[test]
    fn the_reference_radar_is_clean_and_each_weakness_is_named() {
        let good = RadarConfig::awr1843boost;
        assert_eq!(fields(good()), [] as [&str; 0]);
        assert_eq!(
            fields(RadarConfig {
                frame_period_s: 0.03,
                ..good()
            }),
            ["frame_period_s"]
        );
        assert_eq!(
            fields(RadarConfig {
                idle_s: 100e-6,
                ..good()
            }),
            ["idle_s"]
        );
        assert_eq!(
            fields(RadarConfig {
                start_hz: 77.5e9,
                ..good()
            }),
            ["slope_hz_per_s"]
        );
        assert_eq!(
            fields(RadarConfig {
                adc_start_s: 1e-6,
                ..good()
            }),
            ["adc_start_s"]
        );
        assert_eq!(
            fields(RadarConfig {
                n_samples: 60,
                ..good()
            }),
            ["n_samples"]
        );
        assert_eq!(
            fields(RadarConfig {
                n_loops: 1,
                ..good()
            }),
            ["n_loops"]
        );
        let mut flat = good();
        flat.tx.truncate(2);
        assert_eq!(fields(flat), ["tx"]);
        assert_eq!(
            fields(RadarConfig {
                n_samples: 0,
                ..good()
            }),
            ["n_samples"]
        );
        let short = RadarConfig {
            sample_rate_hz: 20e6,
            adc_start_s: 6e-6,
            ..good()
        };
        assert_eq!(
            fields(RadarConfig {
                slope_hz_per_s: 61.5e12,
                sample_rate_hz: 1e6,
                n_samples: 57,
                ..good()
            }),
            ["sample_rate_hz"]
        );
        assert_eq!(fields(short), ["n_samples"]);
    }
}
