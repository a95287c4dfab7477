//! Height and tilt of a sensor as stated in a TI chirp file (`sensorPosition`).

use crate::{
    Mounting,
    ti_cfg::{Command, TiCfgError},
};

/// Maximum height accepted, m. Chirp files for traffic monitoring state 2 m, and no sensor is mounted above the height
/// of a lamp post.
const MAX_HEIGHT_M: f64 = 100.0;
/// Maximum tilt accepted, degrees. 90 is straight up or down.
const MAX_TILT_DEG: f64 = 180.0;

/// Mounting position of the sensor, as stated in a chirp file.
///
/// TI has two forms of the command:
///
/// - xWR14xx to xWR68xx: `sensorPosition HEIGHT AZIMUTH_TILT ELEVATION_TILT`, m and degrees;
/// - xWRLxxxx and xWR6844: `sensorPosition X Y HEIGHT AZIMUTH_TILT ELEVATION_TILT`.
///
/// Signs are those of TI's visualizer. It rotates a point by the elevation tilt E and then by the azimuth tilt A: y' =
/// y cos E + z sin E, z' = z cos E - y sin E, x'' = x cos A + y' sin A, y'' = y' cos A - x sin A. It then adds the
/// height to z. This equals [`Mounting`] with tilt E (positive looks down) and yaw A (positive is turned to the right).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorPosition {
    /// Height of the sensor above the floor, m.
    pub height_m: f64,
    /// Angle of the boresight to the right, rad.
    pub azimuth_tilt_rad: f64,
    /// Angle of the boresight below the horizon, rad.
    pub elevation_tilt_rad: f64,
    /// False for a five-value form with an elevation tilt. Files for cabins count it upwards, while the visualizer
    /// counts it downwards, so the file alone does not determine the sign.
    pub elevation_sign_is_certain: bool,
}

impl SensorPosition {
    /// Reads the last `sensorPosition` of a chirp file for any TI device; `None` if there is none.
    ///
    /// ```
    /// use radarllm_formats::SensorPosition;
    ///
    /// let position = SensorPosition::from_ti_cfg("% wall mount\nsensorPosition 2 0 15\nsensorStart\n")?.unwrap();
    /// assert_eq!(position.height_m, 2.0);
    /// // A point 3 m along the boresight lies lower than the sensor by 3 m x sin 15 degrees.
    /// let [_, _, z] = position.mounting().level([0.0, 3.0, 0.0]);
    /// assert!((z + 0.776).abs() < 1e-3);
    /// # Ok::<(), radarllm_formats::TiCfgError>(())
    /// ```
    ///
    /// # Errors
    /// [`TiCfgError::Line`]: neither three nor five values, a value that is not a number, a height beyond 100 m or a
    /// tilt beyond 180 degrees.
    pub fn from_ti_cfg(text: &str) -> Result<Option<Self>, TiCfgError> {
        let mut found = None;
        for (i, raw) in text.lines().enumerate() {
            if let Some(command) = Command::of_line(i + 1, raw)
                && command.name.text.eq_ignore_ascii_case("sensorPosition")
            {
                found = Some(read(&command)?);
            }
        }
        Ok(found)
    }

    /// Returns the rotation into level axes, which does not include the height.
    pub fn mounting(&self) -> Mounting {
        Mounting {
            tilt_rad: self.elevation_tilt_rad,
            yaw_rad: self.azimuth_tilt_rad,
            roll_rad: 0.0,
        }
    }
}

fn read(command: &Command) -> Result<SensorPosition, TiCfgError> {
    let (values, is_five) = match command.args.as_slice() {
        [height, azimuth, elevation] => ([height, azimuth, elevation], false),
        [x, y, height, azimuth, elevation] => {
            x.number("x, m")?;
            y.number("y, m")?;
            ([height, azimuth, elevation], true)
        }
        args => {
            let problem = format!(
                "expected 3 values (height, azimuth tilt, elevation tilt) or 5 (x, y, and these), found {}",
                args.len()
            );
            return Err(command.name.error(problem));
        }
    };
    let limits = [
        ("height, m", MAX_HEIGHT_M),
        ("azimuth tilt, degrees", MAX_TILT_DEG),
        ("elevation tilt, degrees", MAX_TILT_DEG),
    ];
    let mut numbers = [0.0; 3];
    for ((number, word), (what, limit)) in numbers.iter_mut().zip(values).zip(limits) {
        *number = word.number(what)?;
        if number.abs() > limit {
            return Err(word.error(format!("{what}, must be within +-{limit}")));
        }
    }
    let [height_m, azimuth_deg, elevation_deg] = numbers;
    Ok(SensorPosition {
        height_m,
        azimuth_tilt_rad: azimuth_deg.to_radians(),
        elevation_tilt_rad: elevation_deg.to_radians(),
        elevation_sign_is_certain: !is_five || elevation_deg == 0.0,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(text: &str) -> SensorPosition {
        SensorPosition::from_ti_cfg(text).unwrap().unwrap()
    }

    #[test]
    fn both_forms_are_read_and_the_last_line_counts() {
        let wall = of("sensorPosition 9 9 9\nsensorPosition 2 0 15 % wall\r\nsensorStart");
        assert_eq!((wall.height_m, wall.azimuth_tilt_rad), (2.0, 0.0));
        assert!((wall.elevation_tilt_rad - 15_f64.to_radians()).abs() < 1e-12);
        assert!(wall.elevation_sign_is_certain);
        let low_power = of("sensorPosition 0 0 1.44 0 0");
        assert_eq!(low_power.height_m, 1.44);
        assert!(low_power.elevation_sign_is_certain);
        assert!(!of("sensorPosition 0 0 2 0 -25").elevation_sign_is_certain);
        assert_eq!(SensorPosition::from_ti_cfg("sensorStart"), Ok(None));
        assert_eq!(
            SensorPosition::from_ti_cfg("% sensorPosition 2 0 15"),
            Ok(None)
        );
    }

    /// A ceiling sensor that looks straight down, as in TI's overhead file (2.9 m, 90 degrees). A point 1 m along the
    /// boresight is 1 m below the sensor; the sensor's "up" points forward.
    #[test]
    fn a_positive_elevation_tilt_looks_down() {
        let mounting = of("sensorPosition 2.9 0 90").mounting();
        let close = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12);
        assert!(close(mounting.level([0.0, 1.0, 0.0]), [0.0, 0.0, -1.0]));
        assert!(close(mounting.level([0.0, 0.0, 1.0]), [0.0, 1.0, 0.0]));
    }

    /// Compares with the visualizer's rotation for a simultaneous tilt and azimuth tilt. A positive azimuth tilt looks
    /// to the right.
    #[test]
    fn the_rotation_is_that_of_the_visualizer() {
        let mounting = of("sensorPosition 2 20 15").mounting();
        let (a, e) = (20_f64.to_radians(), 15_f64.to_radians());
        for [x, y, z] in [[0.0, 3.0, 0.0], [1.0, 2.0, 0.5], [-0.3, 4.0, -1.2]] {
            let expected = [
                a.cos() * x + e.cos() * a.sin() * y + e.sin() * a.sin() * z,
                -a.sin() * x + e.cos() * a.cos() * y + e.sin() * a.cos() * z,
                -e.sin() * y + e.cos() * z,
            ];
            for (found, expected) in mounting.level([x, y, z]).iter().zip(expected) {
                assert!((found - expected).abs() < 1e-12);
            }
        }
        assert!(mounting.level([0.0, 3.0, 0.0])[0] > 0.9);
    }

    #[test]
    fn mistakes_are_named_with_their_place() {
        for (text, part) in [
            ("sensorPosition", "found 0"),
            ("sensorPosition 2 0", "found 2"),
            ("sensorPosition 2 0 15 0", "found 4"),
            (
                "sensorPosition 2 0 nan",
                "elevation tilt, degrees must be a number",
            ),
            ("sensorPosition 2 0 1e9", "within +-180"),
            ("sensorPosition -101 0 0", "height, m, must be within +-100"),
            ("sensorPosition x 0 1 0 0", "x, m must be a number"),
        ] {
            let error = SensorPosition::from_ti_cfg(&format!("%\n{text}")).unwrap_err();
            let text = error.to_string();
            assert!(text.starts_with("line 2, columns "), "{text}");
            assert!(text.contains(part), "{text}");
        }
    }
}
