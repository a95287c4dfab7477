//! On-chip detection of TI's out-of-box demo and of its 3D people tracking, as a chirp file of SDK 3 states it.

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
        let (mut cfar, mut limits, mut angles_deg) = ([None; 2], [None; 2], [None; 2]);
        let mut clutter_removal = false;
        for (i, raw) in text.lines().enumerate() {
            let Some(command) = Command::of_line(i + 1, raw) else {
                continue;
            };
            match command.name.text.as_str() {
                "flushCfg" => {
                    (cfar, limits, angles_deg) = ([None; 2], [None; 2], [None; 2]);
                    clutter_removal = false;
                }
                "cfarCfg" => {
                    let (direction, pass) = read_cfar(&command)?;
                    cfar[direction] = Some(pass);
                }
                "clutterRemoval" => {
                    clutter_removal = command.clutter_removal()?;
                }
                "cfarFovCfg" => {
                    let direction = command.whole(1, "direction", 0..2)? as usize;
                    limits[direction] = Some(interval(&command, 2)?);
                }
                "aoaFovCfg" => {
                    angles_deg = [interval(&command, 1)?, interval(&command, 3)?].map(Some);
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
            azimuth_deg: angles_deg[0],
            elevation_deg: angles_deg[1],
        })
    }
}

/// Commands of a chirp file that determine which points TI's 3D people tracking reports of somebody who moves. The order
/// of the arguments is that in which the demo's command line reads them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TiPeopleDetection {
    /// `dynamicRACfarCfg`: the pass along range.
    pub range_cfar: TiMapCfar,
    /// The same: the pass along azimuth.
    pub azimuth_cfar: TiMapCfar,
    /// The same: smallest power relative to the strongest azimuth of the range bin, 0..=1.
    pub sidelobe: f64,
    /// The same: whether the pass along azimuth is made.
    pub second_pass: bool,
    /// `dynamicRangeAngleCfg`: step of azimuth, degrees.
    pub azimuth_step_deg: f64,
    /// The same: addition to the diagonal of the covariance, relative.
    pub azimuth_loading: f64,
    /// `dynamic2DAngleCfg`: step of elevation, degrees.
    pub elevation_step_deg: f64,
    /// The same: addition to the diagonal of the covariance, relative.
    pub elevation_loading: f64,
    /// `fovCfg`: largest azimuth and elevation to either side, degrees.
    pub fov_deg: [f64; 2],
}

/// A CFAR pass over the powers of a range-azimuth map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TiMapCfar {
    /// Cells at the lower and the upper end that are not searched.
    pub skip: [usize; 2],
    /// Training cells on each side.
    pub train: usize,
    /// Guard cells on each side.
    pub guard: usize,
    /// Smallest ratio to the noise.
    pub threshold: f64,
}

impl TiPeopleDetection {
    /// Reads the detection commands of a chirp file. The last of equal commands applies.
    ///
    /// # Errors
    /// [`TiCfgError::Line`] for values out of range, and for a static detection that is switched on, which is not read;
    /// [`TiCfgError::Missing`] if a command is absent.
    pub fn from_ti_cfg(text: &str) -> Result<Self, TiCfgError> {
        let (mut cfar, mut azimuth, mut elevation, mut fov) = (None, None, None, None);
        for (i, raw) in text.lines().enumerate() {
            let Some(command) = Command::of_line(i + 1, raw) else {
                continue;
            };
            match command.name.text.as_str() {
                "flushCfg" => (cfar, azimuth, elevation, fov) = (None, None, None, None),
                "dynamicRACfarCfg" => cfar = Some(read_map_cfar(&command)?),
                "dynamicRangeAngleCfg" => {
                    if command.whole(3, "detection method", 0..256)? > 1 {
                        return Err(command.args[3].error(
                            "only detection methods 0 and 1 are read, which search elevation at the azimuth of the map",
                        ));
                    }
                    azimuth = Some((
                        within(&command, 1, "step, degrees", [0.1, 45.0])?,
                        within(&command, 2, "diagonal loading", [1e-9, 100.0])?,
                    ));
                }
                "dynamic2DAngleCfg" => {
                    elevation = Some((
                        within(&command, 1, "step, degrees", [0.1, 45.0])?,
                        within(&command, 2, "diagonal loading", [1e-9, 100.0])?,
                    ));
                }
                "staticRangeAngleCfg" if command.whole(1, "enabled", 0..2)? == 1 => {
                    return Err(command.args[1].error(
                        "static detection is switched on, which is not read: only points of moving people are",
                    ));
                }
                "fovCfg" => {
                    fov = Some([
                        within(&command, 1, "azimuth, degrees", [1.0, 89.0])?,
                        within(&command, 2, "elevation, degrees", [1.0, 89.0])?,
                    ]);
                }
                _ => {}
            }
        }
        let (range_cfar, azimuth_cfar, sidelobe, second_pass) =
            cfar.ok_or(TiCfgError::Missing("dynamicRACfarCfg"))?;
        let (azimuth_step_deg, azimuth_loading) =
            azimuth.ok_or(TiCfgError::Missing("dynamicRangeAngleCfg"))?;
        let (elevation_step_deg, elevation_loading) =
            elevation.ok_or(TiCfgError::Missing("dynamic2DAngleCfg"))?;
        Ok(Self {
            range_cfar,
            azimuth_cfar,
            sidelobe,
            second_pass,
            azimuth_step_deg,
            azimuth_loading,
            elevation_step_deg,
            elevation_loading,
            fov_deg: fov.ok_or(TiCfgError::Missing("fovCfg"))?,
        })
    }
}

/// The passes along range and azimuth, the limit for sidelobes, and whether the second pass is made.
fn read_map_cfar(command: &Command) -> Result<(TiMapCfar, TiMapCfar, f64, bool), TiCfgError> {
    let cells = |index, what| -> Result<usize, TiCfgError> {
        Ok(command.whole(index, what, 0..256)? as usize)
    };
    let pass = |skip: usize, axis: usize| -> Result<TiMapCfar, TiCfgError> {
        let train = command.whole(5 + axis, "training cells", 1..256)?;
        Ok(TiMapCfar {
            skip: [
                cells(skip, "cells skipped at the start")?,
                cells(skip + 1, "cells skipped at the end")?,
            ],
            train: train as usize,
            guard: cells(7 + axis, "guard cells")?,
            threshold: within(command, 9 + axis, "threshold", [1e-3, 1e5])?,
        })
    };
    Ok((
        pass(1, 0)?,
        pass(3, 1)?,
        within(command, 11, "sidelobe level", [0.0, 1.0])?,
        command.whole(12, "second pass", 0..2)? == 1,
    ))
}

/// A number in an interval.
fn within(
    command: &Command,
    index: usize,
    what: &str,
    [low, high]: [f64; 2],
) -> Result<f64, TiCfgError> {
    let value = command.number(index, what)?;
    match (low..=high).contains(&value) {
        true => Ok(value),
        false => Err(command.args[index].error(format!("{what} must be in {low}..={high}"))),
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

    /// Detection of 3D people tracking with made-up numbers.
    const PEOPLE: &str = "dynamicRACfarCfg -1 3 5 1 2 9 11 4 7 6.00 7.50 0.35 1 1\n\
        dynamicRangeAngleCfg -1 1.5 0.002 1 0\ndynamic2DAngleCfg -1 3 0.05 1 0 1 0.30 0.85 8.00\n\
        staticRangeAngleCfg -1 0 8 8\nfovCfg -1 65 25\n";

    #[test]
    fn commands_of_people_tracking_are_read() {
        let found = TiPeopleDetection::from_ti_cfg(PEOPLE).unwrap();
        let expected = TiPeopleDetection {
            range_cfar: TiMapCfar {
                skip: [3, 5],
                train: 9,
                guard: 4,
                threshold: 6.0,
            },
            azimuth_cfar: TiMapCfar {
                skip: [1, 2],
                train: 11,
                guard: 7,
                threshold: 7.5,
            },
            sidelobe: 0.35,
            second_pass: true,
            azimuth_step_deg: 1.5,
            azimuth_loading: 0.002,
            elevation_step_deg: 3.0,
            elevation_loading: 0.05,
            fov_deg: [65.0, 25.0],
        };
        assert_eq!(found, expected);
        for (from, to, problem) in [
            ("fovCfg -1 65 25", "", "no `fovCfg`"),
            ("7.50 0.35", "nan 0.35", "must be a number"),
            ("-1 3 5 1 2 9 11", "-1 3 5 1 2 0 11", "training cells"),
            ("0.35 1 1", "1.35 1 1", "sidelobe level must be in 0..=1"),
            ("fovCfg -1 65 25", "fovCfg -1 65", "argument 3"),
            ("0.002 1 0", "0.002 2 0", "detection methods 0 and 1"),
            (
                "staticRangeAngleCfg -1 0",
                "staticRangeAngleCfg -1 1",
                "static detection",
            ),
        ] {
            let error = TiPeopleDetection::from_ti_cfg(&PEOPLE.replace(from, to)).unwrap_err();
            assert!(error.to_string().contains(problem), "{to}: {error}");
        }
    }

    #[test]
    fn flush_cfg_discards_all_commands_before_it() {
        let before =
            "clutterRemoval -1 1\naoaFovCfg -1 -80 70 -20 30\ncfarFovCfg -1 0 0.2 8.92\nflushCfg\n";
        let after = format!("{RANGE}{DOPPLER}");
        assert_eq!(
            TiDetection::from_ti_cfg(&format!("{before}{after}")),
            TiDetection::from_ti_cfg(&after)
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
