//! The `[impairments]` table of scenes and data sets.

use radarllm_radar_sim::Impairments;
use radarllm_radar_sim::impairments::{Adc, Leakage};
use serde::{Deserialize, Serialize};

/// Source of the values that the table does not specify.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Preset {
    /// An ideal receiver.
    #[default]
    Off,
    /// [`Impairments::typical`].
    Typical,
}

/// An impairment that can be disabled by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Impairment {
    /// Transmitter leakage.
    Leakage,
    /// Phase noise.
    PhaseNoise,
    /// Channel phase and gain errors.
    Mismatch,
    /// Rounding and clipping.
    Adc,
    /// Lost packets.
    PacketLoss,
    /// Jitter of the frame start.
    StartJitter,
}

/// The table. Its fields are those of [`Impairments`], with angles in degrees.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ImpairmentsFile {
    /// Source of unspecified values.
    pub preset: Preset,
    /// Impairments that are disabled, regardless of preset and fields.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub off: Vec<Impairment>,
    /// Ratio of transmitted power to leaked power, dB.
    pub leakage_isolation_db: Option<f64>,
    /// Length of the leaking path, m.
    pub leakage_path_m: Option<f64>,
    /// Phase noise at 1 MHz offset, dBc/Hz.
    pub phase_noise_dbc_per_hz_at_1_mhz: Option<f64>,
    /// Standard deviation of the channels' phases, degrees.
    pub channel_phase_deg: Option<f64>,
    /// Standard deviation of the channels' gains, dB.
    pub channel_gain_db: Option<f64>,
    /// Bits of each of I and Q.
    pub adc_bits: Option<u32>,
    /// Power of a tone that just reaches full scale, dBm.
    pub adc_full_scale_dbm: Option<f64>,
    /// Probability that a packet is lost.
    pub packet_loss: Option<f64>,
    /// Standard deviation of the frame's start, s.
    pub start_jitter_s: Option<f64>,
}

impl ImpairmentsFile {
    /// Converts the table to the simulator's type.
    ///
    /// # Errors
    /// The first value that is out of range, by name.
    pub fn resolve(&self) -> Result<Impairments, String> {
        let typical = Impairments::typical();
        let mut out = match self.preset {
            Preset::Off => Impairments::default(),
            Preset::Typical => typical,
        };
        // If a parameter of a disabled impairment is specified, its other parameters take their typical values.
        let is_named = self.leakage_isolation_db.is_some() || self.leakage_path_m.is_some();
        if let Some(start) = out.leakage.or(typical.leakage.filter(|_| is_named)) {
            out.leakage = Some(Leakage {
                isolation_db: self.leakage_isolation_db.unwrap_or(start.isolation_db),
                path_m: self.leakage_path_m.unwrap_or(start.path_m),
            });
        }
        let is_named = self.adc_bits.is_some() || self.adc_full_scale_dbm.is_some();
        if let Some(start) = out.adc.or(typical.adc.filter(|_| is_named)) {
            out.adc = Some(Adc {
                bits: self.adc_bits.unwrap_or(start.bits),
                full_scale_dbm: self.adc_full_scale_dbm.unwrap_or(start.full_scale_dbm),
            });
        }
        if let Some(level) = self.phase_noise_dbc_per_hz_at_1_mhz {
            out.phase_noise_dbc_per_hz_at_1_mhz = Some(level);
        }
        if let Some(degrees) = self.channel_phase_deg {
            out.channel_phase_rad = degrees.to_radians();
        }
        out.channel_gain_db = self.channel_gain_db.unwrap_or(out.channel_gain_db);
        out.packet_loss = self.packet_loss.unwrap_or(out.packet_loss);
        out.start_jitter_s = self.start_jitter_s.unwrap_or(out.start_jitter_s);
        for off in &self.off {
            match off {
                Impairment::Leakage => out.leakage = None,
                Impairment::PhaseNoise => out.phase_noise_dbc_per_hz_at_1_mhz = None,
                Impairment::Mismatch => {
                    (out.channel_phase_rad, out.channel_gain_db) = (0.0, 0.0);
                }
                Impairment::Adc => out.adc = None,
                Impairment::PacketLoss => out.packet_loss = 0.0,
                Impairment::StartJitter => out.start_jitter_s = 0.0,
            }
        }
        out.validate().map_err(|e| format!("[impairments]: {e}"))?;
        Ok(out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn resolve(text: &str) -> Result<Impairments, String> {
        let file: ImpairmentsFile = toml::from_str(text).map_err(|e| e.to_string())?;
        file.resolve()
    }

    #[test]
    fn an_empty_table_is_an_ideal_receiver() {
        assert_eq!(resolve("").unwrap(), Impairments::default());
        assert_eq!(
            resolve("preset = \"typical\"").unwrap(),
            Impairments::typical()
        );
    }

    #[test]
    fn fields_override_and_names_switch_off() {
        let typical = Impairments::typical();
        let found = resolve(
            "preset = \"typical\"\noff = [\"leakage\", \"mismatch\"]\nadc_bits = 12\npacket_loss = 0.01",
        )
        .unwrap();
        assert_eq!(found.leakage, None);
        assert_eq!(found.channel_gain_db, 0.0);
        assert_eq!(found.packet_loss, 0.01);
        let adc = found.adc.unwrap();
        assert_eq!(adc.bits, 12);
        assert_eq!(
            Some(adc.full_scale_dbm),
            typical.adc.map(|a| a.full_scale_dbm)
        );
        // Specifying one parameter enables the whole impairment.
        let found = resolve("leakage_path_m = 0.1").unwrap();
        assert_eq!(found.leakage.map(|l| l.path_m), Some(0.1));
        assert_eq!(found.adc, None);
    }

    #[test]
    fn slips_are_named() {
        for (text, word) in [
            ("packet_loss = 2.0", "packet_loss"),
            ("adc_bits = 40", "adc.bits"),
            ("off = [\"gravity\"]", "gravity"),
            ("jitter = 1.0", "jitter"),
        ] {
            let error = resolve(text).unwrap_err();
            assert!(error.contains(word), "{error}");
        }
    }
}
