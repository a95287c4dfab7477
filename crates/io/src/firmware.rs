//! The signal chain of a radar's own firmware, from its chirp configuration.

use radarllm_base::PointFrame;
use radarllm_formats::{TiDetection, ti_detection::TiCfarMode};
use radarllm_radar_dsp::{
    CfarSides, ClutterFilter, Detector, DopplerCfar, DspOptions, PeakGrouping,
};

use crate::{
    error::{Error, Result},
    radar::{OpenedRadar, RadarSource},
};

/// What TI's out-of-box demo of SDK 3 does with samples: both passes of CFAR, removal of clutter and limits of the field
/// of view as the chirp configuration states them.
///
/// Not modelled: the fixed-point arithmetic of range and Doppler FFT, the limit of the serial port, multi-object beam
/// forming and extended velocity.
#[derive(Clone, Debug, PartialEq)]
pub struct OutOfBoxFirmware {
    /// The signal chain.
    pub chain: DspOptions,
    detection: TiDetection,
}

impl OutOfBoxFirmware {
    /// Reads the detection commands of a radar's chirp configuration.
    ///
    /// # Errors
    /// A radar that is no chirp configuration, and detection commands that are absent or malformed.
    pub fn of(radar: &OpenedRadar) -> Result<Self> {
        let RadarSource::TiCfg(text) = &radar.source else {
            return Err(Error::input(
                "the out-of-box firmware is configured by a TI .cfg file, and this radar is not one",
            ));
        };
        let detection = TiDetection::from_ti_cfg(text).map_err(Error::input)?;
        let (range, doppler) = (detection.range_cfar, detection.doppler_cfar);
        let mut chain = DspOptions::ti_demo(radar.config.n_samples);
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
        Ok(Self { chain, detection })
    }

    /// Whether static echoes are reported.
    pub fn reports_surroundings(&self) -> bool {
        !self.detection.clutter_removal
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
            inside(p.velocity_mps, self.detection.velocity_mps)
                && inside(azimuth_deg, self.detection.azimuth_deg)
                && inside(elevation_deg, self.detection.elevation_deg)
        });
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
        let firmware = OutOfBoxFirmware::of(&radar).unwrap();
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
    fn radars_without_detection_commands_are_refused() {
        let error = OutOfBoxFirmware::of(&open_radar("awr1843boost").unwrap()).unwrap_err();
        assert!(error.to_string().contains("TI .cfg"), "{error}");
        let (bare, _) = CFG.split_once("cfarCfg").unwrap();
        let radar = open_radar_text(Path::new("demo.cfg"), bare).unwrap();
        let error = OutOfBoxFirmware::of(&radar).unwrap_err();
        assert!(error.to_string().contains("cfarCfg"), "{error}");
    }
}
