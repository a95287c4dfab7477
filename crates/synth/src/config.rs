//! The TOML file of `dataset build`.

use std::{
    ops::RangeInclusive,
    path::{Path, PathBuf},
};

use radarllm_base::RadarConfig;
use radarllm_radar_sim::{SimOptions, shapes::RigidSurface};
use serde::{Deserialize, Serialize};

use crate::{
    Method, SynthError, Synthesizer,
    corpus::{Corpus, bandai_namco::BandaiNamco, procedural::ProceduralCorpus},
    impairments::ImpairmentsFile,
    placement::PlacementRange,
    processing::ProcessingFile,
    room::{ROOM_RASTER, RoomFile},
    weather::WeatherFile,
};

/// Everything that decides the bytes of a data set.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DatasetConfig {
    /// Name recorded in the manifest.
    pub name: String,
    /// Seed of every random choice.
    pub seed: u64,
    /// Built-in radar name, or a `.toml` or `.cfg` file.
    pub radar: String,
    /// Simulations of every training motion; validation and test motions get one each.
    pub train_variants: usize,
    /// Clips per Parquet shard.
    pub shard_clips: usize,
    /// Longest clip, stored frames; longer motions are cut to a window (drawn for training,
    /// the beginning otherwise).
    pub max_frames: usize,
    /// Stored frames per second; the radar's own without it. Frames of a faster radar are joined, as they
    /// are when its recordings are described.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frame_rate_hz: Option<f64>,
    /// Points slower than this are left out, m/s: for radars whose firmware reports the static
    /// surroundings, which are left out of their recordings too.
    #[serde(skip_serializing_if = "is_default")]
    pub slowest_mps: f32,
    /// Longest facet edge of the simulated body, m. 0.02 is radar grade; 0.03 halves the facets
    /// and is good enough where the rough-surface term dominates, as on clothed bodies.
    pub facet_edge_m: f32,
    /// Placement: distance of the path's middle, m.
    pub distance_m: [f32; 2],
    /// Placement: sideways offset, m, drawn from +- this.
    pub lateral_m: f32,
    /// Placement: heading of the first pose, degrees, drawn from +- this; 0 faces the radar.
    pub heading_deg: f32,
    /// Height of the radar above the floor, m.
    pub radar_height_m: f32,
    /// Faults of the receiver; none without it.
    #[serde(skip_serializing_if = "is_default")]
    pub impairments: ImpairmentsFile,
    /// Rain and smoke; clear air without it.
    #[serde(skip_serializing_if = "is_default")]
    pub weather: WeatherFile,
    /// The signal chain.
    #[serde(skip_serializing_if = "is_default")]
    pub processing: ProcessingFile,
    /// Walls, floor and ceiling around radar and person; free space without it. Its
    /// `radar_height_m` must be the data set's.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub room: Option<RoomFile>,
    /// Where the motions come from.
    pub source: Vec<SourceConfig>,
}

fn is_default<T: Default + PartialEq>(table: &T) -> bool {
    *table == T::default()
}

/// One source of captioned motions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum SourceConfig {
    /// The Bandai-Namco Research motion data sets with captions and splits.
    BandaiNamco {
        /// Folder with the archives, `captions.jsonl` and `splits.csv`; relative to the
        /// configuration file.
        path: PathBuf,
    },
    /// The project's own motions.
    Procedural {
        /// Number of training motions.
        train: usize,
        /// Number of validation motions.
        val: usize,
        /// Number of test motions.
        test: usize,
    },
}

impl Default for DatasetConfig {
    fn default() -> Self {
        let placement = PlacementRange::default();
        Self {
            name: "dataset".into(),
            seed: 1,
            radar: "awr1843boost".into(),
            train_variants: 1,
            shard_clips: 64,
            max_frames: 96,
            frame_rate_hz: None,
            slowest_mps: 0.0,
            facet_edge_m: 0.02,
            distance_m: placement.distance_m,
            lateral_m: placement.lateral_m,
            heading_deg: placement.heading_rad.to_degrees(),
            radar_height_m: placement.radar_height_m,
            impairments: ImpairmentsFile::default(),
            weather: WeatherFile::default(),
            processing: ProcessingFile::default(),
            room: None,
            source: Vec::new(),
        }
    }
}

/// Longest facet edges that a simulated body may have, m: from a hundred thousand facets to a body without
/// hands.
pub const BODY_FACET_EDGE_M: RangeInclusive<f32> = 0.008..=0.05;

/// Upper bound of every count in a configuration: a typing slip must not fill a disk.
const MAX_COUNT: usize = 10_000_000;

impl DatasetConfig {
    /// Reads a configuration.
    ///
    /// # Errors
    /// TOML errors with their place; values out of range with their name.
    pub fn from_toml(text: &str) -> Result<Self, SynthError> {
        let config: Self = toml::from_str(text).map_err(|e| SynthError::Config(e.to_string()))?;
        config.check()?;
        Ok(config)
    }

    fn check(&self) -> Result<(), SynthError> {
        let fail = |problem: String| Err(SynthError::Config(problem));
        for (name, value) in [
            ("train_variants", self.train_variants),
            ("shard_clips", self.shard_clips),
            ("max_frames", self.max_frames),
        ] {
            if value == 0 || value > MAX_COUNT {
                return fail(format!("{name}: must be in 1..={MAX_COUNT}, found {value}"));
            }
        }
        for (name, value) in [
            ("distance_m[0]", self.distance_m[0]),
            ("distance_m[1]", self.distance_m[1]),
            ("lateral_m", self.lateral_m),
            ("heading_deg", self.heading_deg),
            ("radar_height_m", self.radar_height_m),
            ("slowest_mps", self.slowest_mps),
        ] {
            if !(value.is_finite() && (0.0..=360.0).contains(&value)) {
                return fail(format!("{name}: must be in 0..=360, found {value}"));
            }
        }
        if !BODY_FACET_EDGE_M.contains(&self.facet_edge_m) {
            return fail(format!(
                "facet_edge_m: must be in {BODY_FACET_EDGE_M:?}, found {}",
                self.facet_edge_m
            ));
        }
        if let Some(rate_hz) = self.frame_rate_hz
            && !(0.5..=1000.0).contains(&rate_hz)
        {
            return fail(format!(
                "frame_rate_hz: must be in 0.5..=1000, found {rate_hz}"
            ));
        }
        if self.distance_m[0] > self.distance_m[1] {
            return fail(format!(
                "distance_m: {:?} is not [near, far]",
                self.distance_m
            ));
        }
        self.impairments.resolve().map_err(SynthError::Config)?;
        if let Some(room) = &self.room {
            let own_m = f64::from(self.radar_height_m);
            if (room.radar_height_m - own_m).abs() > 1e-6 {
                return fail(format!(
                    "[room] radar_height_m: {} m, but the data set's radar_height_m is {} m",
                    room.radar_height_m, self.radar_height_m
                ));
            }
            if f64::from(self.distance_m[1]) >= room.depth_m {
                return fail(format!(
                    "distance_m: {:?} reaches the wall opposite, [room] depth_m = {}",
                    self.distance_m, room.depth_m
                ));
            }
            if self.weather.rain_mm_per_h > 0.0 {
                return fail("[weather] rain_mm_per_h and [room]: it does not rain indoors".into());
            }
            // Ranges and names of materials do not depend on the radar.
            room.walls(77e9)?;
        }
        self.weather.check().map_err(SynthError::Config)?;
        for source in &self.source {
            if let SourceConfig::Procedural { train, val, test } = source
                && [train, val, test].into_iter().any(|n| *n > MAX_COUNT)
            {
                return fail(format!(
                    "procedural: more than {MAX_COUNT} motions asked for"
                ));
            }
        }
        if self.source.is_empty() {
            return fail(
                "no [[source]]: name at least one, kind = \"procedural\" or \"bandai-namco\""
                    .into(),
            );
        }
        Ok(())
    }

    /// The placement part.
    pub fn placement(&self) -> PlacementRange {
        PlacementRange {
            distance_m: self.distance_m,
            lateral_m: self.lateral_m,
            heading_rad: self.heading_deg.to_radians(),
            radar_height_m: self.radar_height_m,
        }
    }

    /// Options of the simulator: reflections between surfaces where there is a room, at half the rays
    /// of a scene, which halves the time and leaves the strengths of single ghost points noisier.
    pub fn sim_options(&self) -> SimOptions {
        let free = SimOptions {
            weather: self.weather.resolve(),
            ..SimOptions::default()
        };
        match self.room {
            Some(_) => SimOptions {
                max_bounces: 3,
                bounce_rays: 128,
                raster_size: ROOM_RASTER,
                ..free
            },
            None => free,
        }
    }

    /// Plans the chain that simulates this data set's motions for a radar.
    ///
    /// # Errors
    /// A radar that simulator or signal chain cannot serve.
    pub fn synthesizer(&self, radar: &RadarConfig) -> Result<Synthesizer, SynthError> {
        self.synthesizer_with(radar, self.sim_options(), Vec::new())
    }

    /// As [`Self::synthesizer`], with other options of the simulator and with surfaces beside those of the room.
    ///
    /// # Errors
    /// As [`Self::synthesizer`].
    pub fn synthesizer_with(
        &self,
        radar: &RadarConfig,
        sim: SimOptions,
        surfaces: Vec<RigidSurface>,
    ) -> Result<Synthesizer, SynthError> {
        let impairments = self.impairments.resolve().map_err(SynthError::Config)?;
        let mut walls = match &self.room {
            Some(room) => room.walls(radar.carrier_hz())?,
            None => Vec::new(),
        };
        walls.extend(surfaces);
        let dsp = self.processing.resolve(radar);
        let synthesizer = Synthesizer::with_simulation(radar, Method::Fast, dsp, sim)?;
        Ok(synthesizer.with_impairments(impairments).with_walls(walls))
    }

    /// Frames per second that are stored.
    ///
    /// # Errors
    /// More than the radar makes.
    pub fn stored_rate_hz(&self, radar: &RadarConfig) -> Result<f64, SynthError> {
        let own_hz = radar.frame_rate_hz();
        let rate_hz = self.frame_rate_hz.unwrap_or(own_hz);
        // A rate that was rounded when written is still the radar's own.
        if rate_hz > own_hz * 1.001 {
            return Err(SynthError::Config(format!(
                "frame_rate_hz: {rate_hz}, but the radar `{}` makes {own_hz:.3} frames/s",
                radar.name
            )));
        }
        Ok(rate_hz)
    }

    /// Opens every source; relative paths start at `base`.
    ///
    /// # Errors
    /// Whatever keeps a source from being read.
    pub fn open_sources(&self, base: &Path) -> Result<Vec<Box<dyn Corpus>>, SynthError> {
        self.source
            .iter()
            .map(|source| -> Result<Box<dyn Corpus>, SynthError> {
                Ok(match source {
                    SourceConfig::BandaiNamco { path } => {
                        Box::new(BandaiNamco::open(&base.join(path))?)
                    }
                    SourceConfig::Procedural { train, val, test } => {
                        Box::new(ProceduralCorpus::new([*train, *val, *test], self.seed))
                    }
                })
            })
            .collect()
    }

    /// The radar.
    ///
    /// # Errors
    /// Unknown name, unreadable file, or a radar that cannot exist.
    pub fn open_radar(&self, base: &Path) -> Result<RadarConfig, SynthError> {
        crate::synthesizer::open_radar(&self.radar, base)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_configuration_survives_a_round_trip() {
        let config = DatasetConfig {
            source: vec![SourceConfig::Procedural {
                train: 3,
                val: 2,
                test: 1,
            }],
            ..Default::default()
        };
        let text = toml::to_string(&config).unwrap();
        assert_eq!(DatasetConfig::from_toml(&text).unwrap(), config);
    }

    #[test]
    fn slips_are_named() {
        for (text, word) in [
            ("seeed = 1", "seeed"),
            (
                "max_frames = 0\n[[source]]\nkind = \"procedural\"\ntrain = 1\nval = 1\ntest = 1",
                "max_frames",
            ),
            (
                "distance_m = [4.0, 2.0]\n[[source]]\nkind = \"procedural\"\ntrain = 1\nval = 1\ntest = 1",
                "distance_m",
            ),
            ("[weather]\nrain_mm_per_h = nan", "rain_mm_per_h"),
            ("seed = 1", "source"),
            ("lateral_m = nan", "lateral_m"),
            ("frame_rate_hz = 0.0", "frame_rate_hz"),
            ("slowest_mps = -1.0", "slowest_mps"),
            (
                "radar_height_m = 1.5\n[room]\n",
                "[room] radar_height_m: 1 m",
            ),
            ("distance_m = [2.0, 7.0]\n[room]\n", "wall opposite"),
            ("[room]\nwalls = \"cheese\"", "cheese"),
            ("[room]\ndepth = 3.0", "depth"),
        ] {
            let error = DatasetConfig::from_toml(text).unwrap_err().to_string();
            assert!(error.contains(word), "`{error}` should name `{word}`");
        }
    }
}
