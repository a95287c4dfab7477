//! Radar description: chirp timing, geometry and link budget.

use crate::SPEED_OF_LIGHT_MPS;

/// One antenna's phase centre in the radar frame, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Antenna {
    /// Right of the array origin, m.
    pub x_m: f64,
    /// Above the array origin, m.
    pub z_m: f64,
}

/// How the transmitters share the slots of a loop.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TxMultiplexing {
    /// Time division: transmitter i alone in slot i.
    #[default]
    Tdm,
    /// Binary phase modulation of two transmitters: both transmit in every slot, the second inverted in slot
    /// 1 (2 x 2 Hadamard code). Every echo is received twice per loop, a gain of 3 dB for each virtual channel.
    Bpm,
}

/// An FMCW MIMO radar. Build with [`RadarConfig::awr1843boost`] or a loader, then call
/// [`RadarConfig::validate`].
#[derive(Clone, Debug, PartialEq)]
pub struct RadarConfig {
    /// Name of the radar in reports.
    pub name: String,
    /// Frequency at the ramp start, Hz.
    pub start_hz: f64,
    /// Chirp slope, Hz/s.
    pub slope_hz_per_s: f64,
    /// Idle time before each ramp, s.
    pub idle_s: f64,
    /// ADC start after the ramp start, s.
    pub adc_start_s: f64,
    /// Ramp length, s.
    pub ramp_end_s: f64,
    /// Complex samples per chirp.
    pub n_samples: usize,
    /// ADC rate, samples/s.
    pub sample_rate_hz: f64,
    /// Loops of the firing sequence per frame.
    pub n_loops: usize,
    /// Frame period, s.
    pub frame_period_s: f64,
    /// Transmitters, as many as slots in a loop; with [`TxMultiplexing::Tdm`] entry i fires in slot i.
    pub tx: Vec<Antenna>,
    /// Which transmitters fire in which slot.
    pub multiplexing: TxMultiplexing,
    /// Receivers.
    pub rx: Vec<Antenna>,
    /// Transmit power per antenna, dBm.
    pub tx_power_dbm: f64,
    /// Gain of each transmit and each receive antenna at boresight, dBi.
    pub antenna_gain_dbi: f64,
    /// Half-power half-width of the element pattern in azimuth, rad.
    pub azimuth_half_width_rad: f64,
    /// Half-power half-width of the element pattern in elevation, rad.
    pub elevation_half_width_rad: f64,
    /// Receiver noise figure, dB.
    pub noise_figure_db: f64,
}

/// Why a radar configuration is impossible.
#[derive(Clone, Debug, thiserror::Error, PartialEq)]
#[error("radar `{radar}`: {field}: {problem}")]
pub struct RadarConfigError {
    /// Name of the radar.
    pub radar: String,
    /// Offending field or group.
    pub field: &'static str,
    /// Description of the problem, with numbers.
    pub problem: String,
}

impl RadarConfig {
    /// TI AWR1843BOOST with the chirp of the RadarLLM paper: 3 TX (TDM, order TX1, TX3, TX2),
    /// 4 RX, 77 GHz, 60.012 MHz/us, 256 samples at 4.4 Msps, 128 loops, 10 frames/s.
    ///
    /// Geometry in half wavelengths at 77 GHz (board user guide): azimuth elements 0..7 from TX1
    /// and TX3, TX2's elements 2..5 raised by one. Power 12 dBm and noise figure 15 dB are the
    /// AWR1843 data sheet's typical values.
    pub fn awr1843boost() -> Self {
        let half = 0.5 * SPEED_OF_LIGHT_MPS / 77e9;
        let antenna = |x: f64, z: f64| Antenna {
            x_m: x * half,
            z_m: z * half,
        };
        Self {
            name: "awr1843boost".into(),
            start_hz: 77e9,
            slope_hz_per_s: 60.012e12,
            idle_s: 7e-6,
            adc_start_s: 6e-6,
            ramp_end_s: 65e-6,
            n_samples: 256,
            sample_rate_hz: 4.4e6,
            n_loops: 128,
            frame_period_s: 0.1,
            tx: vec![antenna(0.0, 0.0), antenna(4.0, 0.0), antenna(2.0, 1.0)],
            multiplexing: TxMultiplexing::Tdm,
            rx: (0..4).map(|i| antenna(f64::from(i), 0.0)).collect(),
            tx_power_dbm: 12.0,
            antenna_gain_dbi: 10.5,
            azimuth_half_width_rad: 28_f64.to_radians(),
            elevation_half_width_rad: 14_f64.to_radians(),
            noise_figure_db: 15.0,
        }
    }

    /// Time from one chirp to the next, s.
    pub fn chirp_period_s(&self) -> f64 {
        self.idle_s + self.ramp_end_s
    }

    /// Time from one loop to the next, s.
    pub fn loop_period_s(&self) -> f64 {
        self.chirp_period_s() * self.tx.len() as f64
    }

    /// Start of the ramp of (loop, slot) after the frame start, s.
    pub fn ramp_start_s(&self, loop_idx: usize, slot: usize) -> f64 {
        self.chirp_period_s() * (loop_idx * self.tx.len() + slot) as f64 + self.idle_s
    }

    /// Factor of transmitter `tx_idx` in `slot`: 1, 0 or -1.
    pub fn tx_weight(&self, slot: usize, tx_idx: usize) -> f64 {
        match self.multiplexing {
            TxMultiplexing::Tdm => f64::from(u8::from(slot == tx_idx)),
            TxMultiplexing::Bpm if slot == 1 && tx_idx == 1 => -1.0,
            TxMultiplexing::Bpm => 1.0,
        }
    }

    /// Bandwidth swept while the ADC samples, Hz.
    pub fn sampled_bandwidth_hz(&self) -> f64 {
        self.slope_hz_per_s * self.n_samples as f64 / self.sample_rate_hz
    }

    /// Frequency at the middle of the ADC window, Hz. Velocities and angles refer to it.
    pub fn carrier_hz(&self) -> f64 {
        let middle_s = self.adc_start_s + 0.5 * self.n_samples as f64 / self.sample_rate_hz;
        self.start_hz + self.slope_hz_per_s * middle_s
    }

    /// Wavelength at [`Self::carrier_hz`], m.
    pub fn wavelength_m(&self) -> f64 {
        SPEED_OF_LIGHT_MPS / self.carrier_hz()
    }

    /// Range bin width, m.
    pub fn range_resolution_m(&self) -> f64 {
        SPEED_OF_LIGHT_MPS / (2.0 * self.sampled_bandwidth_hz())
    }

    /// End of the last range bin, m.
    pub fn max_range_m(&self) -> f64 {
        self.range_resolution_m() * self.n_samples as f64
    }

    /// Unambiguous radial speed, m/s.
    pub fn max_velocity_mps(&self) -> f64 {
        self.wavelength_m() / (4.0 * self.loop_period_s())
    }

    /// Doppler bin width, m/s.
    pub fn velocity_resolution_mps(&self) -> f64 {
        2.0 * self.max_velocity_mps() / self.n_loops as f64
    }

    /// Frames per second.
    pub fn frame_rate_hz(&self) -> f64 {
        1.0 / self.frame_period_s
    }

    /// Number of frames that fit into a duration.
    pub fn frames_in(&self, duration_s: f64) -> usize {
        // The small term keeps 1.0 s at 0.1 s per frame from losing a frame to rounding.
        (duration_s / self.frame_period_s + 1e-6).floor().max(0.0) as usize
    }

    /// Checks that the radar is possible.
    ///
    /// # Errors
    /// The first of [`Self::problems`].
    pub fn validate(&self) -> Result<(), RadarConfigError> {
        match self.problems().into_iter().next() {
            Some(problem) => Err(problem),
            None => Ok(()),
        }
    }

    /// Every field that is not finite, not positive or too large. If there is none: every timing that does not fit.
    /// Empty if the radar is possible.
    pub fn problems(&self) -> Vec<RadarConfigError> {
        let mut problems = Vec::new();
        let error = |field, problem: String| RadarConfigError {
            radar: self.name.clone(),
            field,
            problem,
        };
        for (field, value) in [
            ("start_hz", self.start_hz),
            ("slope_hz_per_s", self.slope_hz_per_s),
            ("ramp_end_s", self.ramp_end_s),
            ("sample_rate_hz", self.sample_rate_hz),
            ("frame_period_s", self.frame_period_s),
            ("azimuth_half_width_rad", self.azimuth_half_width_rad),
            ("elevation_half_width_rad", self.elevation_half_width_rad),
        ] {
            if !(value.is_finite() && value > 0.0) {
                problems.push(error(
                    field,
                    format!("must be finite and positive, found {value}"),
                ));
            }
        }
        for (field, value) in [
            ("idle_s", self.idle_s),
            ("adc_start_s", self.adc_start_s),
            ("tx_power_dbm", self.tx_power_dbm + 1e3),
            ("antenna_gain_dbi", self.antenna_gain_dbi + 1e3),
            ("noise_figure_db", self.noise_figure_db + 1e3),
        ] {
            if !(value.is_finite() && value >= 0.0) {
                problems.push(error(field, "must be finite and not negative".into()));
            }
        }
        // The limits are far above any part on the market; they keep a hostile file from requesting terabytes of
        // memory.
        for (field, value, max) in [
            ("n_samples", self.n_samples, 8192),
            ("n_loops", self.n_loops, 4096),
            ("tx", self.tx.len(), 64),
            ("rx", self.rx.len(), 64),
        ] {
            if value == 0 || value > max {
                problems.push(error(field, format!("must be in 1..={max}, found {value}")));
            }
        }
        if self.multiplexing == TxMultiplexing::Bpm && self.tx.len() != 2 {
            let problem = format!(
                "binary phase modulation takes two transmitters, found {}",
                self.tx.len()
            );
            problems.push(error("firing", problem));
        }
        if !problems.is_empty() {
            return problems;
        }
        let window_end_s = self.adc_start_s + self.n_samples as f64 / self.sample_rate_hz;
        if window_end_s > self.ramp_end_s {
            problems.push(error(
                "adc_start_s",
                format!(
                    "the ADC window ends at {:.2} us, after the ramp's end at {:.2} us",
                    window_end_s * 1e6,
                    self.ramp_end_s * 1e6
                ),
            ));
        }
        let active_s = self.loop_period_s() * self.n_loops as f64;
        if active_s > self.frame_period_s {
            problems.push(error(
                "frame_period_s",
                format!(
                    "chirps take {:.2} ms but the frame lasts {:.2} ms",
                    active_s * 1e3,
                    self.frame_period_s * 1e3
                ),
            ));
        }
        problems
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Expected figures: computed by hand from the chirp, see CONVENTIONS.md.
    #[test]
    fn reference_radar_has_the_derived_figures() {
        let radar = RadarConfig::awr1843boost();
        radar.validate().unwrap();
        assert!((radar.sampled_bandwidth_hz() / 3.4916e9 - 1.0).abs() < 1e-4);
        assert!((radar.range_resolution_m() - 0.042_93).abs() < 1e-5);
        assert!((radar.max_range_m() - 10.99).abs() < 0.01);
        assert!((radar.loop_period_s() - 216e-6).abs() < 1e-12);
        // Referred to the centre of the ADC window, 79.11 GHz: 4.386 m/s (4.506 at 77 GHz).
        assert!((radar.carrier_hz() / 79.106e9 - 1.0).abs() < 1e-4);
        assert!((radar.max_velocity_mps() - 4.386).abs() < 2e-3);
    }

    #[test]
    fn window_beyond_the_ramp_is_refused() {
        let radar = RadarConfig {
            adc_start_s: 10e-6,
            ..RadarConfig::awr1843boost()
        };
        assert_eq!(radar.validate().unwrap_err().field, "adc_start_s");
        let worse = RadarConfig {
            frame_period_s: 0.01,
            ..radar
        };
        assert_eq!(fields(&worse), ["adc_start_s", "frame_period_s"]);
    }

    #[test]
    fn phase_modulation_is_a_hadamard_code_of_two() {
        let mut radar = RadarConfig {
            multiplexing: TxMultiplexing::Bpm,
            ..RadarConfig::awr1843boost()
        };
        assert_eq!(fields(&radar), ["firing"]);
        radar.tx.truncate(2);
        assert_eq!(fields(&radar), [] as [&str; 0]);
        let code = [0, 1].map(|slot| [0, 1].map(|tx| radar.tx_weight(slot, tx)));
        assert_eq!(code, [[1.0, 1.0], [1.0, -1.0]]);
        let tdm = RadarConfig::awr1843boost();
        let slots = [0, 1, 2].map(|slot| [0, 1, 2].map(|tx| tdm.tx_weight(slot, tx)));
        assert_eq!(slots, [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
    }

    fn fields(radar: &RadarConfig) -> Vec<&'static str> {
        radar.problems().iter().map(|p| p.field).collect()
    }
}
