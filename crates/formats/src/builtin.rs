//! Built-in radars: typical boards with a chirp that is suitable for people indoors.

use radarllm_base::RadarConfig;

use crate::boards::Board;

/// Full names of the built-in radars.
pub const BUILTIN_NAMES: [&str; 8] = [
    "awr1843boost",
    "awr1642boost",
    "iwr1443boost",
    "iwr6843isk",
    "iwr6843isk-ods",
    "iwr6843aop",
    "awr2243-cascade",
    "iwrl6432",
];

/// Reasons why a name does not identify a built-in radar.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum NameError {
    /// No built-in radar has a name with this prefix.
    #[error("no built-in radar is called so; they are {}", BUILTIN_NAMES.join(", "))]
    Unknown,
    /// Several names have this prefix.
    #[error("the name is short for several built-in radars: {}", .0.join(", "))]
    Ambiguous(Vec<&'static str>),
}

/// Finds a built-in radar by name. The name may be abbreviated to any unambiguous prefix, and case is ignored.
///
/// ```
/// use radarllm_formats::{NameError, find_builtin};
///
/// assert_eq!(find_builtin("awr1843")?.name, "awr1843boost");
/// // Three antenna layouts share this chip.
/// let error = find_builtin("iwr6843").unwrap_err();
/// assert_eq!(error, NameError::Ambiguous(vec!["iwr6843isk", "iwr6843isk-ods", "iwr6843aop"]));
/// # Ok::<(), NameError>(())
/// ```
///
/// The 77 GHz boards have the reference chirp of [`RadarConfig::awr1843boost`]. The 60 GHz boards have the chirp of
/// TI's 6 m people-counting files (96 samples, 96 loops, 55 ms frames, TX1, TX2, TX3). The cascade has the chirp of
/// TI's MIMO configuration script (64 loops of 12 transmitters, fired from TX12 to TX1). The IWRL6432 has a short-range
/// chirp chosen by this project, with its real samples as complex ones.
///
/// # Errors
/// [`NameError`]: no name has this prefix, or several do.
pub fn find_builtin(name: &str) -> Result<RadarConfig, NameError> {
    let name = name.to_ascii_lowercase();
    // A full name takes precedence over longer names that start with it, such as those that start with `iwr6843isk`.
    if let Some(radar) = by_full_name(&name) {
        return Ok(radar);
    }
    let candidates: Vec<&'static str> = BUILTIN_NAMES
        .into_iter()
        .filter(|known| !name.is_empty() && known.starts_with(&name))
        .collect();
    match candidates.as_slice() {
        [] => Err(NameError::Unknown),
        [only] => by_full_name(only).ok_or(NameError::Unknown),
        _ => Err(NameError::Ambiguous(candidates)),
    }
}

/// Like [`find_builtin`], for callers that do not need the reason of a failure.
pub fn builtin_radar(name: &str) -> Option<RadarConfig> {
    find_builtin(name).ok()
}

fn by_full_name(name: &str) -> Option<RadarConfig> {
    match name {
        "awr1843boost" => Some(RadarConfig::awr1843boost()),
        "awr1642boost" => Some(with_board(RadarConfig::awr1843boost(), Board::Xwr1642Boost)),
        "iwr1443boost" => {
            let mut radar = with_board(RadarConfig::awr1843boost(), Board::Xwr1443Boost);
            // The raised transmitter fires last, as in the reference radar.
            radar.tx.swap(1, 2);
            Some(radar)
        }
        "iwr6843isk" => Some(people_counting(Board::Xwr6843Isk)),
        "iwr6843isk-ods" => Some(people_counting(Board::Xwr6843IskOds)),
        "iwr6843aop" => Some(people_counting(Board::Xwr6843Aop)),
        "awr2243-cascade" => {
            let chirp = RadarConfig {
                start_hz: 77e9,
                slope_hz_per_s: 79.0327e12,
                idle_s: 5e-6,
                adc_start_s: 6e-6,
                ramp_end_s: 40e-6,
                n_samples: 256,
                sample_rate_hz: 8e6,
                n_loops: 64,
                frame_period_s: 0.1,
                ..RadarConfig::awr1843boost()
            };
            let mut radar = with_board(chirp, Board::Awr2243Cascade);
            radar.tx.reverse();
            Some(radar)
        }
        "iwrl6432" => {
            let chirp = RadarConfig {
                start_hz: 60e9,
                slope_hz_per_s: 90e12,
                idle_s: 10e-6,
                adc_start_s: 5e-6,
                ramp_end_s: 40e-6,
                n_samples: 128,
                sample_rate_hz: 4e6,
                n_loops: 128,
                frame_period_s: 0.1,
                ..RadarConfig::awr1843boost()
            };
            Some(with_board(chirp, Board::Iwrl6432))
        }
        _ => None,
    }
}

/// All built-in radars, in the order of [`BUILTIN_NAMES`].
pub fn builtin_radars() -> Vec<RadarConfig> {
    BUILTIN_NAMES
        .iter()
        .filter_map(|name| by_full_name(name))
        .collect()
}

/// The chirp of one radar on another board, transmitters in device order.
fn with_board(radar: RadarConfig, board: Board) -> RadarConfig {
    let figures = board.figures();
    RadarConfig {
        name: board.name().into(),
        tx: figures.tx,
        rx: figures.rx,
        tx_power_dbm: figures.tx_power_dbm,
        antenna_gain_dbi: figures.antenna_gain_dbi,
        azimuth_half_width_rad: figures.azimuth_half_width_rad,
        elevation_half_width_rad: figures.elevation_half_width_rad,
        noise_figure_db: figures.noise_figure_db,
        ..radar
    }
}

fn people_counting(board: Board) -> RadarConfig {
    let chirp = RadarConfig {
        start_hz: 60.75e9,
        slope_hz_per_s: 54.71e12,
        idle_s: 30e-6,
        adc_start_s: 25e-6,
        ramp_end_s: 59.1e-6,
        n_samples: 96,
        sample_rate_hz: 2.95e6,
        n_loops: 96,
        frame_period_s: 0.055,
        ..RadarConfig::awr1843boost()
    };
    with_board(chirp, board)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_gives_a_radar_that_can_exist_and_bears_it() {
        for name in BUILTIN_NAMES {
            let radar = builtin_radar(name).unwrap();
            assert_eq!(radar.name, name);
            radar.validate().unwrap();
        }
        assert_eq!(builtin_radars().len(), BUILTIN_NAMES.len());
        assert!(builtin_radar("awr9999").is_none());
    }

    #[test]
    fn names_may_be_shortened_where_unambiguous() {
        for (short, full) in [
            ("awr1843", "awr1843boost"),
            ("AWR1642", "awr1642boost"),
            ("iwr1443", "iwr1443boost"),
            ("iwr6843isk", "iwr6843isk"),
            ("iwr6843isk-", "iwr6843isk-ods"),
            ("iwr6843a", "iwr6843aop"),
            ("awr2243", "awr2243-cascade"),
            ("iwrl", "iwrl6432"),
        ] {
            assert_eq!(find_builtin(short).unwrap().name, full, "{short}");
            assert_eq!(builtin_radar(short).unwrap().name, full, "{short}");
        }
        let error = find_builtin("awr1").unwrap_err();
        assert_eq!(
            error.to_string(),
            "the name is short for several built-in radars: awr1843boost, awr1642boost"
        );
        for unknown in ["", "awr9999", "boost", "awr1843boost2", "\u{7}"] {
            let error = find_builtin(unknown).unwrap_err();
            assert_eq!(error, NameError::Unknown, "{unknown:?}");
            assert!(error.to_string().contains("iwr6843aop"), "{error}");
        }
    }
}
