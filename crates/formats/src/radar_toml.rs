//! Radar descriptions in TOML, in SI units and with the field names of [`RadarConfig`].
//!
//! ```toml
//! base = "awr1843boost"   # optional: a built-in radar that fills what is left out
//! name = "mine"
//! n_loops = 64
//! tx = [{ x_m = 0.0, z_m = 0.0 }, { x_m = 0.00779, z_m = 0.0 }]   # firing order
//! firing = "bpm"          # or "tdm", the default: see [`TxMultiplexing`]
//! ```

use radarllm_base::RadarConfig;
use radarllm_base::radar_config::{Antenna, RadarConfigError, TxMultiplexing};
use serde::{Deserialize, Serialize};

use crate::builtin::{BUILTIN_NAMES, NameError, find_builtin};
use crate::span::{Places, Span};

/// Reason why a TOML radar is refused.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RadarTomlError {
    /// Invalid TOML, a field of the wrong type, or an unknown field; the message contains the line.
    #[error("{0}")]
    Syntax(String),
    /// There is no such built-in radar.
    #[error("base = \"{0}\" is not a built-in radar; they are {names}", names = BUILTIN_NAMES.join(", "))]
    Base(String),
    /// The name matches several built-in radars.
    #[error("base = \"{0}\" is short for several built-in radars: {names}", names = .1.join(", "))]
    AmbiguousBase(String, Vec<&'static str>),
    /// A field is missing and there is no `base` to take it from.
    #[error("field `{0}` is missing, and there is no `base` to take it from")]
    Missing(&'static str),
    /// The radar is impossible.
    #[error(transparent)]
    Radar(#[from] RadarConfigError),
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Place {
    x_m: f64,
    z_m: f64,
}

#[derive(Clone, Copy, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum MultiplexingName {
    Tdm,
    Bpm,
}

#[derive(Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Fields {
    base: Option<String>,
    name: Option<String>,
    start_hz: Option<f64>,
    slope_hz_per_s: Option<f64>,
    idle_s: Option<f64>,
    adc_start_s: Option<f64>,
    ramp_end_s: Option<f64>,
    n_samples: Option<usize>,
    sample_rate_hz: Option<f64>,
    n_loops: Option<usize>,
    frame_period_s: Option<f64>,
    tx_power_dbm: Option<f64>,
    antenna_gain_dbi: Option<f64>,
    azimuth_half_width_rad: Option<f64>,
    elevation_half_width_rad: Option<f64>,
    noise_figure_db: Option<f64>,
    #[serde(rename = "firing")]
    multiplexing: Option<MultiplexingName>,
    tx: Option<Vec<Place>>,
    rx: Option<Vec<Place>>,
}

/// Reads a radar and checks it.
///
/// # Errors
/// See [`RadarTomlError`]. A returned radar satisfies [`RadarConfig::validate`].
pub fn radar_from_toml(text: &str) -> Result<RadarConfig, RadarTomlError> {
    let radar = draft(text)?;
    match problems(&radar).into_iter().next() {
        Some(problem) => Err(problem.into()),
        None => Ok(radar),
    }
}

/// Reads a radar without checking whether it is possible.
pub(crate) fn draft(text: &str) -> Result<RadarConfig, RadarTomlError> {
    let file: Fields = toml::from_str(text).map_err(|e| RadarTomlError::Syntax(e.to_string()))?;
    let base = match &file.base {
        None => None,
        Some(name) => Some(find_builtin(name).map_err(|error| match error {
            NameError::Unknown => RadarTomlError::Base(name.clone()),
            NameError::Ambiguous(names) => RadarTomlError::AmbiguousBase(name.clone(), names),
        })?),
    };
    macro_rules! field {
        ($name:ident) => {
            match (file.$name, &base) {
                (Some(value), _) => value,
                (None, Some(base)) => base.$name.clone(),
                (None, None) => return Err(RadarTomlError::Missing(stringify!($name))),
            }
        };
    }
    let antennas = |places: Vec<Place>| -> Vec<Antenna> {
        places
            .into_iter()
            .map(|p| Antenna {
                x_m: p.x_m,
                z_m: p.z_m,
            })
            .collect()
    };
    let (tx, rx) = (file.tx.map(antennas), file.rx.map(antennas));
    let (tx, rx) = match (tx, rx, &base) {
        (Some(tx), Some(rx), _) => (tx, rx),
        (tx, rx, Some(base)) => (
            tx.unwrap_or_else(|| base.tx.clone()),
            rx.unwrap_or_else(|| base.rx.clone()),
        ),
        (None, _, None) => return Err(RadarTomlError::Missing("tx")),
        (_, None, None) => return Err(RadarTomlError::Missing("rx")),
    };
    let multiplexing = match (file.multiplexing, &base) {
        (Some(MultiplexingName::Tdm), _) => TxMultiplexing::Tdm,
        (Some(MultiplexingName::Bpm), _) => TxMultiplexing::Bpm,
        (None, base) => base
            .as_ref()
            .map_or(TxMultiplexing::Tdm, |b| b.multiplexing),
    };
    Ok(RadarConfig {
        multiplexing,
        name: field!(name),
        start_hz: field!(start_hz),
        slope_hz_per_s: field!(slope_hz_per_s),
        idle_s: field!(idle_s),
        adc_start_s: field!(adc_start_s),
        ramp_end_s: field!(ramp_end_s),
        n_samples: field!(n_samples),
        sample_rate_hz: field!(sample_rate_hz),
        n_loops: field!(n_loops),
        frame_period_s: field!(frame_period_s),
        tx_power_dbm: field!(tx_power_dbm),
        antenna_gain_dbi: field!(antenna_gain_dbi),
        azimuth_half_width_rad: field!(azimuth_half_width_rad),
        elevation_half_width_rad: field!(elevation_half_width_rad),
        noise_figure_db: field!(noise_figure_db),
        tx,
        rx,
    })
}

/// Problems that prevent the use of the radar; empty if there are none.
pub(crate) fn problems(radar: &RadarConfig) -> Vec<RadarConfigError> {
    let mut problems = radar.problems();
    let places = radar
        .tx
        .iter()
        .map(|a| ("tx", a))
        .chain(radar.rx.iter().map(|a| ("rx", a)));
    for (field, antenna) in places {
        // Ten metres exceed the size of any board, and keep products of positions finite.
        if !(antenna.x_m.abs() <= 10.0 && antenna.z_m.abs() <= 10.0) {
            problems.push(RadarConfigError {
                radar: radar.name.clone(),
                field,
                problem: format!("antenna at x {} m, z {} m", antenna.x_m, antenna.z_m),
            });
        }
    }
    problems
}

/// Positions of the values of a radar file by key; empty if the text is not valid TOML.
pub(crate) fn places(text: &str) -> Places {
    const KEYS: [&str; 19] = [
        "firing",
        "base",
        "name",
        "start_hz",
        "slope_hz_per_s",
        "idle_s",
        "adc_start_s",
        "ramp_end_s",
        "n_samples",
        "sample_rate_hz",
        "n_loops",
        "frame_period_s",
        "tx_power_dbm",
        "antenna_gain_dbi",
        "azimuth_half_width_rad",
        "elevation_half_width_rad",
        "noise_figure_db",
        "tx",
        "rx",
    ];
    let Ok(table) = toml::de::DeTable::parse(text) else {
        return Places::new();
    };
    let mut places = Places::new();
    for (key, value) in table.get_ref() {
        if let Some(known) = KEYS.into_iter().find(|k| *k == key.get_ref().as_ref()) {
            places.insert(known, Span::of_bytes(text, value.span(), known.into()));
        }
    }
    places
}

/// Message and position of a syntax error in a radar file.
pub(crate) fn syntax_error(text: &str) -> Option<(String, Option<Span>)> {
    let error = toml::from_str::<Fields>(text).err()?;
    let span = error
        .span()
        .map(|bytes| Span::of_bytes(text, bytes, String::new()));
    Some((error.message().to_owned(), span))
}

/// Formats all fields of a radar. [`radar_from_toml`] restores it unchanged.
///
/// # Errors
/// [`RadarTomlError::Syntax`] if a value cannot be expressed in TOML.
pub fn radar_to_toml(radar: &RadarConfig) -> Result<String, RadarTomlError> {
    let places = |antennas: &[Antenna]| {
        Some(
            antennas
                .iter()
                .map(|a| Place {
                    x_m: a.x_m,
                    z_m: a.z_m,
                })
                .collect(),
        )
    };
    let fields = Fields {
        base: None,
        name: Some(radar.name.clone()),
        start_hz: Some(radar.start_hz),
        slope_hz_per_s: Some(radar.slope_hz_per_s),
        idle_s: Some(radar.idle_s),
        adc_start_s: Some(radar.adc_start_s),
        ramp_end_s: Some(radar.ramp_end_s),
        n_samples: Some(radar.n_samples),
        sample_rate_hz: Some(radar.sample_rate_hz),
        n_loops: Some(radar.n_loops),
        frame_period_s: Some(radar.frame_period_s),
        tx_power_dbm: Some(radar.tx_power_dbm),
        antenna_gain_dbi: Some(radar.antenna_gain_dbi),
        azimuth_half_width_rad: Some(radar.azimuth_half_width_rad),
        elevation_half_width_rad: Some(radar.elevation_half_width_rad),
        noise_figure_db: Some(radar.noise_figure_db),
        multiplexing: Some(match radar.multiplexing {
            TxMultiplexing::Tdm => MultiplexingName::Tdm,
            TxMultiplexing::Bpm => MultiplexingName::Bpm,
        }),
        tx: places(&radar.tx),
        rx: places(&radar.rx),
    };
    toml::to_string(&fields).map_err(|e| RadarTomlError::Syntax(e.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn written_radars_read_back_bit_for_bit() {
        let phase_modulated = RadarConfig {
            multiplexing: TxMultiplexing::Bpm,
            ..crate::builtin_radar("awr1642boost").unwrap()
        };
        for radar in crate::builtin_radars().into_iter().chain([phase_modulated]) {
            let text = radar_to_toml(&radar).unwrap();
            assert_eq!(radar_from_toml(&text).unwrap(), radar, "{text}");
        }
    }

    #[test]
    fn base_fills_what_is_left_out() {
        let radar =
            radar_from_toml("base = \"awr1843boost\"\nname = \"m\"\nn_loops = 64\n").unwrap();
        let expected = RadarConfig {
            name: "m".into(),
            n_loops: 64,
            ..RadarConfig::awr1843boost()
        };
        assert_eq!(radar, expected);
    }

    #[test]
    fn mistakes_are_named() {
        let error = |text: &str| radar_from_toml(text).unwrap_err().to_string();
        assert!(error("base = \"nonsense\"").contains("nonsense"));
        assert!(error("base = \"iwr6843\"").contains("several built-in radars: iwr6843isk, "));
        assert!(
            error("name = \"x\"").contains("`tx`"),
            "{}",
            error("name = \"x\"")
        );
        assert!(error("base = \"awr1843boost\"\nloops = 3").contains("line 2"));
        assert!(error("base = \"awr1843boost\"\nn_loops = 0").contains("n_loops"));
        assert!(error("base = \"awr1843boost\"\nfiring = \"bpm\"").contains("two transmitters"));
        assert!(error("base = \"awr1843boost\"\nfiring = \"cdm\"").contains("line 2"));
        assert!(error("base = \"awr1843boost\"\nn_loops = -1").contains("line 2"));
        assert!(error("base = \"awr1843boost\"\nidle_s = nan").contains("idle_s"));
        assert!(error("base = \"awr1843boost\"\nrx = [{x_m = inf, z_m = 0}]").contains("rx"));
        assert!(error("base = \"awr1843boost\"\nrx = []").contains("rx"));
    }
}
