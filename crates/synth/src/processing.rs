//! The `[processing]` table of scenes and data sets: the signal chain from cube to points.

use radarllm_base::RadarConfig;
use radarllm_radar_dsp::{CfarSides, ClutterFilter, Detector, DspOptions, MapKind, PeakGrouping};
use serde::{Deserialize, Serialize};

/// Where the values start that the table does not name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ChainPreset {
    /// [`DspOptions::default`].
    #[default]
    Default,
    /// [`DspOptions::mmmesh`]: coherent sum, always the strongest cells, bin centres.
    Mmmesh,
    /// [`DspOptions::ti_demo`]: the out-of-box demo of TI's xWR14xx parts.
    TiDemo,
}

/// Channels to one map.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MapName {
    /// Sum of powers.
    NonCoherent,
    /// Power of the sum: a beam at boresight.
    Coherent,
    /// Mean of logarithms: with `log_cfar` or `top_k` only.
    MeanLog,
}

/// Training cells of `log_cfar`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SidesName {
    /// Mean of both sides.
    Both,
    /// The larger mean.
    Greater,
    /// The smaller mean.
    Smaller,
}

/// Removal of what stands still.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ClutterName {
    /// None.
    Off,
    /// Slow-time mean.
    Mean,
    /// Mean weighted by the Doppler window.
    WeightedMean,
}

/// Which neighbours a point must not be weaker than.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GroupingName {
    /// None.
    Off,
    /// Those in range.
    Range,
    /// Those in Doppler.
    Doppler,
    /// All eight.
    Both,
}

impl From<CfarSides> for SidesName {
    fn from(sides: CfarSides) -> Self {
        match sides {
            CfarSides::Both => Self::Both,
            CfarSides::Greater => Self::Greater,
            CfarSides::Smaller => Self::Smaller,
        }
    }
}

/// Which cells become points.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum DetectorFile {
    /// The strongest, whatever they are.
    TopK,
    /// Above the frame's own noise floor.
    NoiseFloor {
        /// Noise cells per frame on average.
        false_alarms_per_frame: f64,
    },
    /// Cell-averaging CFAR along range.
    CaCfar {
        /// Guard cells on each side.
        guard: usize,
        /// Training cells on each side.
        train: usize,
        /// Probability that a noise cell passes.
        false_alarm_probability: f64,
    },
    /// Ordered-statistic CFAR along range.
    OsCfar {
        /// Guard cells on each side.
        guard: usize,
        /// Training cells on each side.
        train: usize,
        /// Ordered value, as a fraction of the training cells.
        rank: f64,
        /// Probability that a noise cell passes.
        false_alarm_probability: f64,
    },
    /// CFAR along range over logarithms with a fixed threshold, as TI's accelerators do it.
    LogCfar {
        /// Guard cells on each side.
        guard: usize,
        /// Training cells on each side.
        train: usize,
        /// How the two sides combine.
        sides: SidesName,
        /// Over the training cells' mean, dB.
        threshold_db: f64,
    },
}

/// The table; see [`DspOptions`].
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ProcessingFile {
    /// Where unnamed values start.
    pub preset: ChainPreset,
    /// Channels to one map.
    pub map: Option<MapName>,
    /// Cell selection.
    pub detector: Option<DetectorFile>,
    /// Most points per frame.
    pub max_points: Option<usize>,
    /// Nearest range kept, m.
    pub min_range_m: Option<f64>,
    /// Farthest range kept, m.
    pub max_range_m: Option<f64>,
    /// Removal of what stands still.
    pub clutter: Option<ClutterName>,
    /// Undo the phase that a mover gathers between transmitters; false for firmware that does not.
    pub compensate_tdm: Option<bool>,
    /// Which neighbours a point must not be weaker than.
    pub peak_grouping: Option<GroupingName>,
    /// Step of the azimuth spectrum in fixed-point firmware; see [`DspOptions::azimuth_step_db`].
    pub azimuth_step_db: Option<f64>,
}

/// Any file with the table.
#[derive(Deserialize)]
struct WithProcessing {
    processing: ProcessingFile,
}

impl ProcessingFile {
    /// The `[processing]` table of a scene, of a data set's configuration, or of a file with nothing else.
    ///
    /// # Errors
    /// No TOML, no such table, or a field that it does not have.
    pub fn from_toml(text: &str) -> Result<Self, toml::de::Error> {
        toml::from_str::<WithProcessing>(text).map(|file| file.processing)
    }

    /// What the signal chain of a radar takes; it checks the values when it is planned.
    pub fn resolve(&self, radar: &RadarConfig) -> DspOptions {
        let mut out = match self.preset {
            ChainPreset::Default => DspOptions::default(),
            ChainPreset::Mmmesh => DspOptions::mmmesh(),
            ChainPreset::TiDemo => DspOptions::ti_demo(radar.n_samples),
        };
        if let Some(map) = self.map {
            out.map = match map {
                MapName::NonCoherent => MapKind::NonCoherent,
                MapName::Coherent => MapKind::Coherent,
                MapName::MeanLog => MapKind::MeanLog,
            };
        }
        if let Some(detector) = self.detector {
            out.detector = match detector {
                DetectorFile::TopK => Detector::AlwaysTopK,
                DetectorFile::NoiseFloor {
                    false_alarms_per_frame,
                } => Detector::NoiseFloor {
                    false_alarms_per_frame,
                },
                DetectorFile::CaCfar {
                    guard,
                    train,
                    false_alarm_probability,
                } => Detector::CaCfar {
                    guard,
                    train,
                    false_alarm_probability,
                },
                DetectorFile::OsCfar {
                    guard,
                    train,
                    rank,
                    false_alarm_probability,
                } => Detector::OsCfar {
                    guard,
                    train,
                    rank,
                    false_alarm_probability,
                },
                DetectorFile::LogCfar {
                    guard,
                    train,
                    sides,
                    threshold_db,
                } => Detector::LogCfar {
                    guard,
                    train,
                    sides: match sides {
                        SidesName::Both => CfarSides::Both,
                        SidesName::Greater => CfarSides::Greater,
                        SidesName::Smaller => CfarSides::Smaller,
                    },
                    threshold_db,
                },
            };
        }
        if let Some(clutter) = self.clutter {
            out.clutter = match clutter {
                ClutterName::Off => ClutterFilter::Off,
                ClutterName::Mean => ClutterFilter::Mean,
                ClutterName::WeightedMean => ClutterFilter::WeightedMean,
            };
        }
        out.max_points = self.max_points.unwrap_or(out.max_points);
        out.min_range_m = self.min_range_m.unwrap_or(out.min_range_m);
        out.max_range_m = self.max_range_m.unwrap_or(out.max_range_m);
        if let Some(grouping) = self.peak_grouping {
            out.peak_grouping = match grouping {
                GroupingName::Off => PeakGrouping::Off,
                GroupingName::Range => PeakGrouping::Range,
                GroupingName::Doppler => PeakGrouping::Doppler,
                GroupingName::Both => PeakGrouping::Both,
            };
        }
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
        assert!(resolve("max_point = 3").is_err());
        let table = "seed = 3\n[processing]\nmax_points = 64\n[room]\nwidth_m = 4";
        let file = ProcessingFile::from_toml(table).unwrap();
        assert_eq!(file.max_points, Some(64));
        assert!(ProcessingFile::from_toml("max_points = 64").is_err());
    }
}
