//! The `[weather]` table of scenes and data sets.

use radarllm_radar_sim::Weather;
use serde::{Deserialize, Serialize};

/// The table. Its fields are those of [`Weather`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct WeatherFile {
    /// Rain rate, mm/h.
    pub rain_mm_per_h: f64,
    /// Concentration of smoke particles in the air, g/m^3.
    pub smoke_g_per_m3: f64,
}

impl WeatherFile {
    /// Converts the table to the simulator's type.
    pub fn resolve(&self) -> Weather {
        Weather {
            rain_mm_per_h: self.rain_mm_per_h,
            smoke_g_per_m3: self.smoke_g_per_m3,
        }
    }

    /// Checks the values.
    ///
    /// # Errors
    /// The first value that is out of range, by name.
    pub fn check(&self) -> Result<(), String> {
        self.resolve()
            .validate()
            .map_err(|e| format!("[weather]: {e}"))
    }
}
