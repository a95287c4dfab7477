//! Files of channel gains: gain and phase of each virtual channel of one radar, measured with a corner reflector.
//!
//! ```toml
//! radar = "awr1843boost"
//! source = "recorded:corner.bin"
//! range_m = 3.02            # where the reflector stood
//! azimuth_deg = 0.0
//! elevation_deg = 0.0
//! snr_db = 62.1             # of the weakest channel's mean
//! above_surroundings_db = 31.0
//! residual = 0.002          # rms change of the gains between half frames, 1 = the gain itself
//! frames = 20
//!
//! [[channel]]               # slot and receiver count from 0, receivers fastest
//! slot = 0
//! receiver = 0
//! x_m = 0.0                 # of the virtual antenna: a file for another board is refused
//! z_m = 0.0
//! gain_db = 0.12            # what the channel does to a signal; samples are divided by it
//! phase_deg = -3.4
//! ```

use num_complex::Complex64;
use radarllm_base::RadarConfig;
use serde::{Deserialize, Serialize};

/// Virtual antennas closer together than this are identical, m.
const SAME_M: f64 = 5e-5;
/// Maximum gain of a channel relative to the mean, dB. A channel beyond it is defective rather than mismatched.
const MAX_GAIN_DB: f64 = 40.0;

/// Reasons why a calibration cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CalibrationError {
    /// Not TOML, a field of the wrong type, missing or unknown; the message has the line.
    #[error("{0}")]
    Syntax(String),
    /// A number out of range.
    #[error("channel {channel}: {field}: expected {expected}, found {found}")]
    Value {
        /// Index of the `[[channel]]`.
        channel: usize,
        /// Field.
        field: &'static str,
        /// Allowed values.
        expected: &'static str,
        /// Value found.
        found: f64,
    },
    /// The calibration belongs to another radar.
    #[error("made with radar `{found}`, not `{expected}`")]
    Radar {
        /// Name of the radar in use.
        expected: String,
        /// Name in the file.
        found: String,
    },
    /// The channels differ from those of the radar in number or order.
    #[error("channel {channel}: expected {expected}, found {found}")]
    Channel {
        /// Index of the `[[channel]]`.
        channel: usize,
        /// Channel of the radar at this index.
        expected: String,
        /// Channel of the file at this index.
        found: String,
    },
}

/// A calibration with its metadata.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Calibration {
    /// Name of the radar.
    pub radar: String,
    /// Capture from which it was computed.
    pub source: String,
    /// Range of the reflector, m.
    pub range_m: f64,
    /// Angle of the reflector to the right of boresight, degrees.
    pub azimuth_deg: f64,
    /// Angle of the reflector above boresight, degrees.
    pub elevation_deg: f64,
    /// SNR of the mean of the weakest channel, dB.
    pub snr_db: f64,
    /// Power of the reflector relative to the strongest static echo near it, dB.
    pub above_surroundings_db: f64,
    /// Rms change of the gains between half frames.
    pub residual: f64,
    /// Number of frames used.
    pub frames: usize,
    /// Channels, with the receiver index fastest.
    pub channel: Vec<CalibratedChannel>,
}

/// One virtual channel.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CalibratedChannel {
    /// Slot, from 0.
    pub slot: usize,
    /// Receiver, from 0.
    pub receiver: usize,
    /// Position to the right of the array origin, m: transmitter plus receiver.
    pub x_m: f64,
    /// Position above the array origin, m.
    pub z_m: f64,
    /// Amplitude relative to the geometric mean of the channels, dB.
    pub gain_db: f64,
    /// Phase relative to the mean of the channels, degrees.
    pub phase_deg: f64,
}

impl CalibratedChannel {
    /// Channels of a radar with the given gains, in their order.
    pub fn all(radar: &RadarConfig, gains: &[Complex64]) -> Vec<Self> {
        places(radar)
            .zip(gains)
            .map(|((slot, receiver, x_m, z_m), gain)| Self {
                slot,
                receiver,
                x_m,
                z_m,
                gain_db: 20.0 * gain.norm().log10(),
                phase_deg: gain.arg().to_degrees(),
            })
            .collect()
    }
}

fn places(radar: &RadarConfig) -> impl Iterator<Item = (usize, usize, f64, f64)> {
    radar.tx.iter().enumerate().flat_map(|(slot, tx)| {
        let receivers = radar.rx.iter().enumerate();
        receivers.map(move |(receiver, rx)| (slot, receiver, tx.x_m + rx.x_m, tx.z_m + rx.z_m))
    })
}

impl Calibration {
    /// Reads a file.
    ///
    /// # Errors
    /// [`CalibrationError::Syntax`], [`CalibrationError::Value`].
    pub fn from_toml(text: &str) -> Result<Self, CalibrationError> {
        let file: Self =
            toml::from_str(text).map_err(|e| CalibrationError::Syntax(e.to_string()))?;
        for (channel, c) in file.channel.iter().enumerate() {
            let wrong = |field, expected, found| {
                Err(CalibrationError::Value {
                    channel,
                    field,
                    expected,
                    found,
                })
            };
            if !(-MAX_GAIN_DB..=MAX_GAIN_DB).contains(&c.gain_db) {
                return wrong("gain_db", "-40 to 40 dB", c.gain_db);
            }
            if !(-360.0..=360.0).contains(&c.phase_deg) {
                return wrong("phase_deg", "-360 to 360 degrees", c.phase_deg);
            }
        }
        Ok(file)
    }

    /// Formats the calibration as a file.
    ///
    /// # Errors
    /// [`CalibrationError::Syntax`] from the TOML writer.
    pub fn to_toml(&self) -> Result<String, CalibrationError> {
        toml::to_string(self).map_err(|e| CalibrationError::Syntax(e.to_string()))
    }

    /// Complex gains of the channels of a radar, `slot * n_rx + rx`.
    ///
    /// # Errors
    /// A calibration of another radar, or of the same one with other slots.
    pub fn gains(&self, radar: &RadarConfig) -> Result<Vec<Complex64>, CalibrationError> {
        if self.radar != radar.name {
            return Err(CalibrationError::Radar {
                expected: radar.name.clone(),
                found: self.radar.clone(),
            });
        }
        let n = radar.tx.len() * radar.rx.len();
        if self.channel.len() != n {
            return Err(CalibrationError::Channel {
                channel: self.channel.len().min(n),
                expected: format!("{n} channels in all"),
                found: format!("{} channels", self.channel.len()),
            });
        }
        let pairs = places(radar).zip(&self.channel).enumerate();
        for (channel, ((slot, receiver, x_m, z_m), c)) in pairs {
            let is_same = slot == c.slot
                && receiver == c.receiver
                && (x_m - c.x_m).abs() < SAME_M
                && (z_m - c.z_m).abs() < SAME_M;
            if !is_same {
                let text = |slot, receiver, x_m: f64, z_m: f64| {
                    format!(
                        "slot {slot}, receiver {receiver} at ({:.2}, {:.2}) mm",
                        x_m * 1e3,
                        z_m * 1e3
                    )
                };
                return Err(CalibrationError::Channel {
                    channel,
                    expected: text(slot, receiver, x_m, z_m),
                    found: text(c.slot, c.receiver, c.x_m, c.z_m),
                });
            }
        }
        let gain = |c: &CalibratedChannel| {
            Complex64::from_polar(10_f64.powf(c.gain_db / 20.0), c.phase_deg.to_radians())
        };
        Ok(self.channel.iter().map(gain).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file() -> (RadarConfig, Vec<Complex64>, Calibration) {
        let radar = RadarConfig::awr1843boost();
        let gains: Vec<Complex64> = (0..12)
            .map(|i| Complex64::from_polar(0.8 + 0.03 * f64::from(i), 0.4 - 0.1 * f64::from(i)))
            .collect();
        let calibration = Calibration {
            radar: radar.name.clone(),
            source: "recorded:corner.bin".into(),
            range_m: 3.0,
            azimuth_deg: 0.0,
            elevation_deg: 0.0,
            snr_db: 60.0,
            above_surroundings_db: 30.0,
            residual: 0.002,
            frames: 10,
            channel: CalibratedChannel::all(&radar, &gains),
        };
        (radar, gains, calibration)
    }

    #[test]
    fn gains_come_back_from_the_file() {
        let (radar, gains, calibration) = file();
        let read = Calibration::from_toml(&calibration.to_toml().unwrap()).unwrap();
        for (read, gain) in read.gains(&radar).unwrap().iter().zip(&gains) {
            assert!((read - gain).norm() < 1e-12);
        }
    }

    #[test]
    fn other_boards_and_odd_numbers_are_refused_with_their_place() {
        let (radar, _, calibration) = file();
        let text = calibration.to_toml().unwrap();
        let mut swapped = radar.clone();
        swapped.tx.swap(1, 2);
        let error = calibration.gains(&swapped).unwrap_err().to_string();
        assert!(
            error.contains("channel 4: expected slot 1, receiver 0"),
            "{error}"
        );
        let mut fewer = radar.clone();
        fewer.tx.truncate(2);
        assert!(
            calibration
                .gains(&fewer)
                .unwrap_err()
                .to_string()
                .contains("8 channels")
        );
        let other = RadarConfig {
            name: "iwr6843isk".into(),
            ..radar
        };
        assert!(
            calibration
                .gains(&other)
                .unwrap_err()
                .to_string()
                .contains("iwr6843isk")
        );
        for (from, to, expected) in [
            ("frames = 10", "frames = -1", "frames"),
            ("frames = 10", "frames = 10\nleg = 1", "leg"),
            ("slot = 0", "", "slot"),
            ("radar = ", "radar ", "line 1"),
        ] {
            let error = Calibration::from_toml(&text.replacen(from, to, 1)).unwrap_err();
            assert!(error.to_string().contains(expected), "{error}");
        }
        for (field, value) in [
            ("gain_db", "nan"),
            ("gain_db", "41.0"),
            ("phase_deg", "inf"),
        ] {
            let line = text.lines().rfind(|l| l.starts_with(field)).unwrap();
            let damaged = text.replace(line, &format!("{field} = {value}"));
            let error = Calibration::from_toml(&damaged).unwrap_err().to_string();
            assert!(
                error.contains("channel 11") && error.contains(field),
                "{error}"
            );
        }
    }
}
