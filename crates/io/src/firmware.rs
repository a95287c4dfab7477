//! The signal chain of a radar's own firmware, from its chirp configuration.

use radarllm_base::{PointFrame, message::option};
use radarllm_formats::{
    TiDetection, TiPeopleDetection,
    ti_detection::{TiCfarMode, TiMapCfar},
};
use radarllm_radar_dsp::{
    CaponDetection, CaponScan, CfarSides, ClutterFilter, Detector, DopplerCfar, DspOptions,
    MapCfar, PeakGrouping, Window,
};

use crate::{
    error::{Error, Result},
    radar::{OpenedRadar, RadarSource},
};

/// Step of azimuth and elevation in the points of 3D people tracking, rad.
const PEOPLE_ANGLE_STEP_RAD: f64 = 0.01;

/// What the firmware of a TI board does with samples, as its chirp configuration states it.
#[derive(Clone, Debug, PartialEq)]
pub struct TiFirmware {
    /// The signal chain.
    pub chain: DspOptions,
    view: FieldOfView,
    reports_static: bool,
}

/// Limits of the reported points; `None` is no limit.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct FieldOfView {
    velocity_mps: Option<[f64; 2]>,
    azimuth_deg: Option<[f64; 2]>,
    elevation_deg: Option<[f64; 2]>,
}

impl TiFirmware {
    /// Names of the modelled firmwares.
    pub const NAMES: [&str; 2] = ["out-of-box", "people-tracking"];

    /// The firmware of one of [`Self::NAMES`].
    ///
    /// # Errors
    /// An unknown name, and those of [`Self::out_of_box`].
    pub fn from_name(name: &str, radar: &OpenedRadar) -> Result<Self> {
        match name {
            "out-of-box" => Self::out_of_box(radar),
            "people-tracking" => Self::people_tracking(radar),
            other => Err(
                Error::input(option("firmware").text(format!(" {other:?}: unknown")))
                    .with_hint(Self::NAMES.join(" or ")),
            ),
        }
    }

    /// TI's out-of-box demo of SDK 3: both passes of CFAR, removal of clutter and limits of the field of view.
    ///
    /// Not modelled: the fixed-point arithmetic of range and Doppler FFT, the limit of the serial port, multi-object beam
    /// forming and extended velocity.
    ///
    /// # Errors
    /// A radar that is no chirp configuration, and detection commands that are absent, malformed or not modelled.
    pub fn out_of_box(radar: &OpenedRadar) -> Result<Self> {
        let text = chirp_configuration(radar, "out-of-box")?;
        let detection = TiDetection::from_ti_cfg(text).map_err(Error::wrap)?;
        let (range, doppler) = (detection.range_cfar, detection.doppler_cfar);
        if range.is_cyclic || !doppler.is_cyclic || doppler.mode != TiCfarMode::Both {
            return Err(Error::input(
                "`cfarCfg` is modelled as the demo's own files state it: along range without wrapping around (cyclic mode 0), along Doppler with wrapping around (cyclic mode 1) and the mean of both sides (averaging mode 0)",
            ));
        }
        let mut chain = DspOptions::ti_demo(radar.config()?.n_samples);
        chain.detector = Detector::LogCfar {
            guard: range.guard,
            train: range.train,
            sides: match range.mode {
                TiCfarMode::Both => CfarSides::Both,
                TiCfarMode::Greater => CfarSides::Greater,
                TiCfarMode::Smaller => CfarSides::Smaller,
            },
            threshold_db: range.threshold_db,
        };
        chain.doppler_cfar = Some(DopplerCfar {
            guard: doppler.guard,
            train: doppler.train,
            threshold_db: doppler.threshold_db,
        });
        chain.peak_grouping = match (range.peak_grouping, doppler.peak_grouping) {
            (false, false) => PeakGrouping::Off,
            (true, false) => PeakGrouping::Range,
            (false, true) => PeakGrouping::Doppler,
            (true, true) => PeakGrouping::Both,
        };
        chain.clutter = match detection.clutter_removal {
            true => ClutterFilter::Mean,
            false => ClutterFilter::Off,
        };
        if let Some([nearest_m, farthest_m]) = detection.range_m {
            chain.min_range_m = nearest_m.max(0.0);
            chain.max_range_m = farthest_m.min(chain.max_range_m);
        }
        Ok(Self {
            chain,
            view: FieldOfView {
                velocity_mps: detection.velocity_mps,
                azimuth_deg: detection.azimuth_deg,
                elevation_deg: detection.elevation_deg,
            },
            reports_static: !detection.clutter_removal,
        })
    }

    /// TI's 3D people tracking for the xWR6843: mean removed, Capon map of range and azimuth with two passes of CFAR,
    /// elevation by a second Capon spectrum, angles in steps of 0.01 rad.
    ///
    /// Not modelled: the fixed-point arithmetic, detection of static people, several elevations of one cell, the
    /// tracker, and the order in which points are dropped where the serial port is too slow. Assumed: the noise of both
    /// passes is the smaller of both sides, thresholds are ratios of powers, and the phases between transmitters are not
    /// corrected for motion. No recording of this firmware was compared.
    ///
    /// # Errors
    /// As [`Self::out_of_box`].
    pub fn people_tracking(radar: &OpenedRadar) -> Result<Self> {
        let text = chirp_configuration(radar, "people-tracking")?;
        let detection = TiPeopleDetection::from_ti_cfg(text).map_err(Error::wrap)?;
        let pass = |cfar: TiMapCfar| MapCfar {
            skip: cfar.skip,
            train: cfar.train,
            guard: cfar.guard,
            threshold: cfar.threshold,
        };
        let [azimuth_deg, elevation_deg] = detection.fov_deg;
        let chain = DspOptions {
            clutter: ClutterFilter::Mean,
            range_window: Window::Hann,
            doppler_window: Window::Hann,
            range_fft_len: Some(radar.config()?.n_samples.next_power_of_two()),
            compensate_tdm: false,
            correct_range_doppler_coupling: false,
            capon: Some(CaponDetection {
                azimuth: CaponScan {
                    limit_deg: azimuth_deg,
                    step_deg: detection.azimuth_step_deg,
                    loading: detection.azimuth_loading,
                },
                elevation: Some(CaponScan {
                    limit_deg: elevation_deg,
                    step_deg: detection.elevation_step_deg,
                    loading: detection.elevation_loading,
                }),
                range_cfar: pass(detection.range_cfar),
                azimuth_cfar: detection.second_pass.then(|| pass(detection.azimuth_cfar)),
                sidelobe: detection.sidelobe,
                angle_step_rad: PEOPLE_ANGLE_STEP_RAD,
            }),
            ..DspOptions::default()
        };
        Ok(Self {
            chain,
            view: FieldOfView::default(),
            reports_static: false,
        })
    }

    /// Whether static echoes are reported.
    pub fn reports_surroundings(&self) -> bool {
        self.reports_static
    }

    /// Removes the points outside the field of view.
    pub fn limit(&self, frame: &mut PointFrame) {
        let inside = |value: f32, limits: Option<[f64; 2]>| match limits {
            Some([low, high]) => (low..=high).contains(&f64::from(value)),
            None => true,
        };
        frame.points.retain(|p| {
            let azimuth_deg = p.x_m.atan2(p.y_m).to_degrees();
            let elevation_deg = p.z_m.atan2(p.x_m.hypot(p.y_m)).to_degrees();
            inside(p.velocity_mps, self.view.velocity_mps)
                && inside(azimuth_deg, self.view.azimuth_deg)
                && inside(elevation_deg, self.view.elevation_deg)
        });
    }
}

/// Text of the chirp configuration of a radar.
fn chirp_configuration<'a>(radar: &'a OpenedRadar, firmware: &str) -> Result<&'a str> {
    match &radar.source {
        RadarSource::TiCfg(text) => Ok(text),
        _ => Err(Error::input(format!(
            "the {firmware} firmware is configured by a TI .cfg file, and this radar is not one"
        ))),
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use radarllm_base::RadarPoint;

    use super::*;
    use crate::{open_radar, open_radar_text};

    const CFG: &str = "channelCfg 15 7 0\nadcCfg 2 1\nprofileCfg 0 60.25 350 6 58 0 0 60 1 224 4500 0 0 30\n\
        chirpCfg 0 0 0 0 0 0 0 1\nchirpCfg 1 1 0 0 0 0 0 4\nchirpCfg 2 2 0 0 0 0 0 2\nframeCfg 0 2 16 0 100 1 0\n\
        cfarCfg -1 0 2 8 4 3 0 15 1\ncfarCfg -1 1 0 4 2 3 1 12 1\ncfarFovCfg -1 0 0 6\ncfarFovCfg -1 1 -0.5 0.5\n\
        aoaFovCfg -1 -45 45 -20 20\n";

    #[test]
    fn the_chain_and_the_field_of_view_are_those_of_the_file() {
        let radar = open_radar_text(Path::new("demo.cfg"), CFG).unwrap();
        let firmware = TiFirmware::out_of_box(&radar).unwrap();
        assert!(firmware.reports_surroundings());
        let chain = &firmware.chain;
        assert_eq!(
            (chain.peak_grouping, chain.max_range_m),
            (PeakGrouping::Both, 6.0)
        );
        assert_eq!(
            chain.doppler_cfar,
            Some(DopplerCfar {
                guard: 2,
                train: 4,
                threshold_db: 12.0
            })
        );
        let point = |x_m: f32, z_m: f32, velocity_mps: f32| RadarPoint {
            x_m,
            y_m: 2.0,
            z_m,
            velocity_mps,
            ..RadarPoint::default()
        };
        let kept = point(0.0, 0.5, -0.4);
        let mut frame = PointFrame {
            points: vec![
                kept,
                point(2.1, 0.0, 0.0),
                point(0.0, -0.9, 0.0),
                point(0.0, 0.0, 0.6),
            ],
            ..PointFrame::default()
        };
        firmware.limit(&mut frame);
        assert_eq!(frame.points, [kept]);
    }

    #[test]
    fn passes_of_cfar_that_are_not_modelled_are_refused() {
        for (stated, other) in [
            ("cfarCfg -1 0 2 8 4 3 0", "cfarCfg -1 0 2 8 4 3 1"),
            ("cfarCfg -1 1 0 4 2 3 1", "cfarCfg -1 1 0 4 2 3 0"),
            ("cfarCfg -1 1 0 4 2 3 1", "cfarCfg -1 1 2 4 2 3 1"),
        ] {
            let radar =
                open_radar_text(Path::new("demo.cfg"), &CFG.replace(stated, other)).unwrap();
            let error = TiFirmware::out_of_box(&radar).unwrap_err();
            assert!(
                error.to_string().contains("cyclic mode"),
                "{other}: {error}"
            );
        }
    }

    #[test]
    fn people_tracking_is_read_from_its_own_commands() {
        let (chirps, _) = CFG.split_once("cfarCfg").unwrap();
        let text = format!(
            "{chirps}dynamicRACfarCfg -1 4 4 2 2 8 12 4 8 5.00 8.00 0.40 0 1\n\
             dynamicRangeAngleCfg -1 0.75 0.0010 1 0\ndynamic2DAngleCfg -1 1.5 0.0300 1 0 1 0.30 0.85 8.00\n\
             fovCfg -1 70.0 20.0\n"
        );
        let radar = open_radar_text(Path::new("people.cfg"), &text).unwrap();
        let firmware = TiFirmware::people_tracking(&radar).unwrap();
        assert!(!firmware.reports_surroundings());
        let capon = firmware.chain.capon.unwrap();
        assert_eq!((capon.azimuth.limit_deg, capon.azimuth_cfar), (70.0, None));
        assert_eq!(capon.range_cfar.threshold, 5.0);
        let demo = open_radar_text(Path::new("demo.cfg"), CFG).unwrap();
        let error = TiFirmware::people_tracking(&demo).unwrap_err();
        assert!(error.to_string().contains("dynamicRACfarCfg"), "{error}");
    }

    #[test]
    fn radars_without_detection_commands_are_refused() {
        let error = TiFirmware::out_of_box(&open_radar("awr1843boost").unwrap()).unwrap_err();
        assert!(error.to_string().contains("TI .cfg"), "{error}");
        let (bare, _) = CFG.split_once("cfarCfg").unwrap();
        let radar = open_radar_text(Path::new("demo.cfg"), bare).unwrap();
        let error = TiFirmware::out_of_box(&radar).unwrap_err();
        assert!(error.to_string().contains("cfarCfg"), "{error}");
    }
}
