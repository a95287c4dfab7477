//! The `[processing]` table of scenes and data sets: the signal chain from cube to points.

use radarllm_base::RadarConfig;
use radarllm_radar_dsp::{ClutterFilter, Detector, DopplerCfar, DspOptions, MapKind, PeakGrouping};
use serde::{Deserialize, Serialize};

/// Source of the values that the table does not specify.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ChainPreset {
    /// [`DspOptions::default`].
    #[default]
    Default,
    /// [`DspOptions::mmmesh`]: coherent sum, always the strongest cells, bin centres.
    Mmmesh,
    /// [`DspOptions::paper`]: clutter removal and selection as the RadarLLM paper prints them.
    Paper,
    /// [`DspOptions::ti_demo`]: the out-of-box demo of TI's xWR14xx parts.
    TiDemo,
}

/// The table; see [`DspOptions`].
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ProcessingFile {
    /// Source of unspecified values.
    pub preset: ChainPreset,
    /// How the channels are combined into one map.
    pub map: Option<MapKind>,
    /// Cell selection.
    pub detector: Option<Detector>,
    /// Second CFAR of the detected cells, along Doppler.
    pub doppler_cfar: Option<DopplerCfar>,
    /// Maximum number of points per frame.
    pub max_points: Option<usize>,
    /// Minimum range kept, m.
    pub min_range_m: Option<f64>,
    /// Maximum range kept, m.
    pub max_range_m: Option<f64>,
    /// Removal of static clutter.
    pub clutter: Option<ClutterFilter>,
    /// Whether to compensate the phase that a moving target accumulates between transmitters; false for firmware that
    /// does not.
    pub compensate_tdm: Option<bool>,
    /// Which neighbours a point is compared with: a point must not be weaker than any of them.
    pub peak_grouping: Option<PeakGrouping>,
    /// Step of the azimuth spectrum in fixed-point firmware; see [`DspOptions::azimuth_step_db`].
    pub azimuth_step_db: Option<f64>,
}

/// Any file that contains the table.
#[derive(Deserialize)]
struct WithProcessing {
    processing: ProcessingFile,
}

impl ProcessingFile {
    /// Reads the `[processing]` table of a scene, of a data set's configuration, or of a file with nothing else.
    ///
    /// # Errors
    /// Invalid TOML, a missing table, or an unknown field.
    pub fn from_toml(text: &str) -> Result<Self, toml::de::Error> {
        toml::from_str::<WithProcessing>(text).map(|file| file.processing)
    }

    /// Signal chain options for a radar. The signal chain checks the values when it is planned.
    pub fn resolve(&self, radar: &RadarConfig) -> DspOptions {
        let mut out = match self.preset {
            ChainPreset::Default => DspOptions::default(),
            ChainPreset::Mmmesh => DspOptions::mmmesh(),
            ChainPreset::Paper => DspOptions::paper(),
            ChainPreset::TiDemo => DspOptions::ti_demo(radar.n_samples),
        };
        out.map = self.map.unwrap_or(out.map);
        out.detector = self.detector.unwrap_or(out.detector);
        out.doppler_cfar = self.doppler_cfar.or(out.doppler_cfar);
        out.clutter = self.clutter.unwrap_or(out.clutter);
        out.max_points = self.max_points.unwrap_or(out.max_points);
        out.min_range_m = self.min_range_m.unwrap_or(out.min_range_m);
        out.max_range_m = self.max_range_m.unwrap_or(out.max_range_m);
        out.peak_grouping = self.peak_grouping.unwrap_or(out.peak_grouping);
        out.azimuth_step_db = self.azimuth_step_db.or(out.azimuth_step_db);
        out.compensate_tdm = self.compensate_tdm.unwrap_or(out.compensate_tdm);
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn presets_and_fields_reach_the_chain() {
        let resolve = |text: &str| {
            let radar = RadarConfig::awr1843boost();
            toml::from_str::<ProcessingFile>(text).map(|f| f.resolve(&radar))
        };
        assert_eq!(resolve("").unwrap(), DspOptions::default());
        assert_eq!(
            resolve("preset = \"mmmesh\"").unwrap(),
            DspOptions::mmmesh()
        );
        assert_eq!(resolve("preset = \"paper\"").unwrap(), DspOptions::paper());
        let filter = resolve("clutter = \"receiver_mean\"").unwrap().clutter;
        assert_eq!(filter, ClutterFilter::ReceiverMean);
        let options = resolve(
            "compensate_tdm = false\nmax_points = 64\nclutter = \"off\"\n\
             detector = { kind = \"os_cfar\", guard = 2, train = 8, rank = 0.75, false_alarm_probability = 1e-4 }",
        )
        .unwrap();
        assert!(!options.compensate_tdm);
        assert_eq!(
            (options.max_points, options.clutter),
            (64, ClutterFilter::Off)
        );
        assert!(matches!(
            options.detector,
            Detector::OsCfar { train: 8, .. }
        ));
        let demo = resolve("preset = \"ti_demo\"\nmax_points = 64").unwrap();
        assert_eq!(
            demo,
            DspOptions {
                max_points: 64,
                ..DspOptions::ti_demo(256)
            }
        );
        assert!(resolve("detector = { kind = \"magic\" }").is_err());
        assert!(resolve("detector = { kind = \"noise_floor\", rank = 1 }").is_err());
        let named = resolve(
            "map = \"mean_log\"\npeak_grouping = \"doppler\"\nclutter = \"weighted_mean\"\n\
             detector = { kind = \"log_cfar\", guard = 4, train = 8, sides = \"smaller\", threshold_db = 15.0 }",
        )
        .unwrap();
        assert_eq!(named.map, MapKind::MeanLog);
        assert_eq!(named.peak_grouping, PeakGrouping::Doppler);
        assert_eq!(named.clutter, ClutterFilter::WeightedMean);
        assert_eq!(named.detector, DspOptions::ti_demo(256).detector);
        let top = resolve("detector = { kind = \"top_k\" }").unwrap();
        assert_eq!(top.detector, Detector::AlwaysTopK);
        assert!(resolve("max_point = 3").is_err());
        let table = "seed = 3\n[processing]\nmax_points = 64\n[room]\nwidth_m = 4";
        let file = ProcessingFile::from_toml(table).unwrap();
        assert_eq!(file.max_points, Some(64));
        assert!(ProcessingFile::from_toml("max_points = 64").is_err());
    }
}
