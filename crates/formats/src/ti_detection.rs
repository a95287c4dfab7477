//! On-chip detection of TI's out-of-box demo, as a chirp file of SDK 3 states it.

use crate::ti_cfg::{Command, TiCfgError};

/// Commands of a chirp file that determine which points the demo reports. Argument order: SDK 3 user guide,
/// "Configuration (.cfg) File Format".
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TiDetection {
    /// `cfarCfg` along range.
    pub range_cfar: TiCfar,
    /// `cfarCfg` along Doppler.
    pub doppler_cfar: TiCfar,
    /// `clutterRemoval`: whether the mean of each range bin is subtracted. False if not given.
    pub clutter_removal: bool,
    /// `cfarFovCfg`: nearest and farthest range, m.
    pub range_m: Option<[f64; 2]>,
    /// `cfarFovCfg`: smallest and largest radial velocity, m/s.
    pub velocity_mps: Option<[f64; 2]>,
    /// `aoaFovCfg`: smallest and largest azimuth, degrees.
    pub azimuth_deg: Option<[f64; 2]>,
    /// `aoaFovCfg`: smallest and largest elevation, degrees.
    pub elevation_deg: Option<[f64; 2]>,
}

/// A CFAR pass over the logarithms of the detection matrix.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TiCfar {
    /// How the two sides are combined.
    pub mode: TiCfarMode,
    /// Training cells on each side.
    pub train: usize,
    /// Guard cells on each side.
    pub guard: usize,
    /// Whether the pass wraps around at the ends.
    pub is_cyclic: bool,
    /// Threshold over the mean of the training cells, dB.
    pub threshold_db: f64,
    /// Whether only local maxima pass.
    pub peak_grouping: bool,
}

/// How a CFAR pass combines the means of its two sides.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TiCfarMode {
    /// Mean of both sides.
    Both,
    /// The larger mean.
    Greater,
    /// The smaller mean.
    Smaller,
}

impl TiDetection {
    /// Reads the detection commands of a chirp file. The last of equal commands applies.
    ///
    /// ```
    /// use radarllm_formats::TiDetection;
    ///
    /// let text = "cfarCfg -1 0 2 8 4 3 0 15 1\ncfarCfg -1 1 0 4 2 3 1 12.5 0\ncfarFovCfg -1 1 -1 1.00\n";
    /// let detection = TiDetection::from_ti_cfg(text)?;
    /// assert_eq!((detection.range_cfar.train, detection.doppler_cfar.threshold_db), (8, 12.5));
    /// assert_eq!(detection.velocity_mps, Some([-1.0, 1.0]));
    /// assert!(detection.range_cfar.peak_grouping && !detection.clutter_removal);
    /// # Ok::<(), radarllm_formats::TiCfgError>(())
    /// ```
    ///
    /// # Errors
    /// [`TiCfgError::Line`] for values out of range, and for `cfarCfg` in the forms of SDK 1 and 2, whose thresholds
    /// have another unit; [`TiCfgError::Missing`] if `cfarCfg` is absent for range or Doppler.
    pub fn from_ti_cfg(text: &str) -> Result<Self, TiCfgError> {
        let mut cfar = [None; 2];
        let (mut clutter_removal, mut limits) = (false, [None; 2]);
        let (mut azimuth_deg, mut elevation_deg) = (None, None);
        for (i, raw) in text.lines().enumerate() {
            let Some(command) = Command::of_line(i + 1, raw) else {
                continue;
            };
            match command.name.text.as_str() {
                "flushCfg" => (cfar, clutter_removal, limits) = ([None; 2], false, [None; 2]),
                "cfarCfg" => {
                    let (direction, pass) = read_cfar(&command)?;
                    cfar[direction] = Some(pass);
                }
                "clutterRemoval" => {
                    let index = command.args.len().saturating_sub(1).min(1);
                    clutter_removal = command.whole(index, "enabled", 0..2)? == 1;
                }
                "cfarFovCfg" => {
                    let direction = command.whole(1, "direction", 0..2)? as usize;
                    limits[direction] = Some(interval(&command, 2)?);
                }
                "aoaFovCfg" => {
                    azimuth_deg = Some(interval(&command, 1)?);
                    elevation_deg = Some(interval(&command, 3)?);
                }
                _ => {}
            }
        }
        let [Some(range_cfar), Some(doppler_cfar)] = cfar else {
            return Err(TiCfgError::Missing("cfarCfg"));
        };
        Ok(Self {
            range_cfar,
            doppler_cfar,
            clutter_removal,
            range_m: limits[0],
            velocity_mps: limits[1],
            azimuth_deg,
            elevation_deg,
        })
    }
}

/// The direction (0 is range, 1 is Doppler) and the pass of a `cfarCfg`.
fn read_cfar(command: &Command) -> Result<(usize, TiCfar), TiCfgError> {
    if command.args.len() != 9 {
        return Err(command.name.error(format!(
            "has {} arguments; only the form of SDK 3 is read, which has nine and states the threshold in dB",
            command.args.len()
        )));
    }
    let direction = command.whole(1, "direction", 0..2)? as usize;
    let mode = match command.whole(2, "mode", 0..3)? {
        0 => TiCfarMode::Both,
        1 => TiCfarMode::Greater,
        _ => TiCfarMode::Smaller,
    };
    let threshold_db = command.number(7, "threshold, dB")?;
    if !(threshold_db > 0.0 && threshold_db <= 100.0) {
        return Err(command.args[7].error("the threshold must be above 0 and at most 100 dB"));
    }
    let pass = TiCfar {
        mode,
        train: command.whole(3, "training cells", 1..256)? as usize,
        guard: command.whole(4, "guard cells", 0..256)? as usize,
        is_cyclic: command.whole(6, "cyclic", 0..2)? == 1,
        threshold_db,
        peak_grouping: command.whole(8, "peak grouping", 0..2)? == 1,
    };
    Ok((direction, pass))
}

/// Two numbers in order.
fn interval(command: &Command, first: usize) -> Result<[f64; 2], TiCfgError> {
    let low = command.number(first, "minimum")?;
    let high = command.number(first + 1, "maximum")?;
    match low < high {
        true => Ok([low, high]),
        false => Err(command.args[first].error("the minimum must be below the maximum")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RANGE: &str = "cfarCfg -1 0 2 8 4 3 0 15 1\n";
    const DOPPLER: &str = "cfarCfg -1 1 0 4 2 3 1 12 0\n";

    #[test]
    fn commands_of_the_demo_are_read() {
        let text = format!(
            "% comment\n{RANGE}{DOPPLER}clutterRemoval -1 1\naoaFovCfg -1 -80 70 -20 30\ncfarFovCfg -1 0 0.2 8.92\n"
        );
        let detection = TiDetection::from_ti_cfg(&text).unwrap();
        let range_cfar = TiCfar {
            mode: TiCfarMode::Smaller,
            train: 8,
            guard: 4,
            is_cyclic: false,
            threshold_db: 15.0,
            peak_grouping: true,
        };
        let doppler_cfar = TiCfar {
            mode: TiCfarMode::Both,
            train: 4,
            guard: 2,
            is_cyclic: true,
            threshold_db: 12.0,
            peak_grouping: false,
        };
        assert_eq!(
            detection,
            TiDetection {
                range_cfar,
                doppler_cfar,
                clutter_removal: true,
                range_m: Some([0.2, 8.92]),
                velocity_mps: None,
                azimuth_deg: Some([-80.0, 70.0]),
                elevation_deg: Some([-20.0, 30.0]),
            }
        );
    }

    #[test]
    fn other_forms_and_values_are_refused_with_their_place() {
        for (text, problem) in [
            (RANGE.to_owned(), "no `cfarCfg`"),
            (
                format!("{RANGE}cfarCfg -1 1 0 4 2 3 0 8534\n"),
                "line 2, columns 1 to 8: `cfarCfg`: has 8 arguments",
            ),
            (
                format!("{DOPPLER}cfarCfg -1 0 2 8 4 3 0 nan 1\n"),
                "must be a number",
            ),
            (format!("{DOPPLER}cfarCfg -1 0 2 8 4 3 0 -5 1\n"), "above 0"),
            (
                format!("{DOPPLER}cfarCfg -1 0 2 0 4 3 0 15 1\n"),
                "training cells",
            ),
            (
                format!("{RANGE}{DOPPLER}cfarFovCfg -1 0 3 1\n"),
                "below the maximum",
            ),
            (format!("{RANGE}{DOPPLER}aoaFovCfg -1 -90 90\n"), "missing"),
            (format!("{RANGE}{DOPPLER}flushCfg\n"), "no `cfarCfg`"),
        ] {
            let error = TiDetection::from_ti_cfg(&text).unwrap_err().to_string();
            assert!(error.contains(problem), "{text}: {error}");
        }
    }
}
