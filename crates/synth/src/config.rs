//! The TOML configuration of `dataset build`.

use std::{
    ops::RangeInclusive,
    path::{Path, PathBuf},
};

use radarllm_base::RadarConfig;
use radarllm_dataset::Split;
use radarllm_radar_dsp::Detector;
use radarllm_radar_sim::{SimOptions, shapes::RigidSurface};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::{
    Method, SynthError, Synthesizer,
    corpus::{
        Corpus, CorpusItem,
        bandai_namco::BandaiNamco,
        files::{FilesConfig, MotionFiles},
        humanml3d::{self, HumanMl3dConfig},
        procedural::{ProceduralConfig, ProceduralCorpus},
    },
    impairments::ImpairmentsFile,
    objects::ObjectsFile,
    placement::PlacementRange,
    processing::ProcessingFile,
    room::{ROOM_RASTER, RoomFile},
    scene::NoiseFile,
    weather::WeatherFile,
};

/// All settings that determine the bytes of a data set.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DatasetConfig {
    /// Name recorded in the manifest.
    pub name: String,
    /// Seed of every random choice.
    pub seed: u64,
    /// Built-in radar name, or a `.toml` or `.cfg` file.
    pub radar: String,
    /// Number of simulations of every training motion; validation and test motions get one each.
    pub train_variants: usize,
    /// Names of the splits that are built; all of them if absent.
    #[serde(skip_serializing_if = "is_default")]
    pub splits: Option<Vec<String>>,
    /// Clips per Parquet shard.
    pub shard_clips: usize,
    /// Maximum clip length, in stored frames. Longer motions are cut to a window (drawn at random for training,
    /// the beginning otherwise).
    pub max_frames: usize,
    /// Training clips of continuous motions are cut to a random length between this and the maximum, s; to the maximum
    /// if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shortest_part_s: Option<f64>,
    /// Stored frames per second; the radar's own rate if absent. Frames of a faster radar are joined, in the same way
    /// as when its recordings are described.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frame_rate_hz: Option<f64>,
    /// Points slower than this are removed, m/s. This is for radars whose firmware reports the static surroundings,
    /// which are removed from their recordings too.
    #[serde(skip_serializing_if = "is_default")]
    pub slowest_mps: f32,
    /// Whether static points are removed as from a recording ([`radarllm_base::StaticCells`]). This is for firmware that
    /// reports the static surroundings with a fine Doppler resolution.
    #[serde(skip_serializing_if = "is_default")]
    pub remove_static_cells: bool,
    /// Maximum facet edge length of the simulated body, m. 0.02 is radar grade. 0.03 halves the number of facets
    /// and is good enough where the rough-surface term dominates, as on clothed bodies.
    pub facet_edge_m: f32,
    /// Standing heights of which each clip's person has one, m; those of four adults if absent.
    #[serde(skip_serializing_if = "is_default")]
    pub body_heights_m: Option<Vec<f32>>,
    /// Placement: distance of the path's middle, m; see [`PlacementRange`].
    pub distance_m: [f32; 2],
    /// Placement: sideways offset, m, drawn from +- this value.
    pub lateral_m: f32,
    /// Placement: heading of the first pose, degrees, drawn from +- this value; 0 faces the radar.
    pub heading_deg: f32,
    /// Height of the radar above the floor, m.
    pub radar_height_m: f32,
    /// Receiver impairments; none if absent.
    #[serde(skip_serializing_if = "is_default")]
    pub impairments: ImpairmentsFile,
    /// Receiver noise; the radar's thermal noise if absent.
    #[serde(skip_serializing_if = "is_default")]
    pub noise: NoiseFile,
    /// Rain and smoke; clear air if absent.
    #[serde(skip_serializing_if = "is_default")]
    pub weather: WeatherFile,
    /// The signal chain.
    #[serde(skip_serializing_if = "is_default")]
    pub processing: ProcessingFile,
    /// Smallest and largest change of the threshold of a `log_cfar` detector, dB; drawn for each clip.
    #[serde(skip_serializing_if = "is_default")]
    pub threshold_offset_db: [f64; 2],
    /// Static objects around the person, drawn anew for each clip; none if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub objects: Option<ObjectsFile>,
    /// Walls, floor and ceiling around radar and person; free space if absent. Its `radar_height_m` must be that of the
    /// data set.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub room: Option<RoomFile>,
    /// Boards of which each clip has one, drawn at random; the values above are those of boards that do not state their
    /// own. One board with the values above if absent.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub board: Vec<BoardConfig>,
    /// Sources of the motions.
    pub source: Vec<SourceConfig>,
}

/// A board of [`DatasetConfig::board`]: what differs from the values of the data set.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BoardConfig {
    /// As [`DatasetConfig::radar`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub radar: Option<String>,
    /// As [`DatasetConfig::radar_height_m`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub radar_height_m: Option<f32>,
    /// As [`DatasetConfig::slowest_mps`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub slowest_mps: Option<f32>,
    /// As [`DatasetConfig::remove_static_cells`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub remove_static_cells: Option<bool>,
    /// As [`DatasetConfig::impairments`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub impairments: Option<ImpairmentsFile>,
    /// As [`DatasetConfig::processing`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub processing: Option<ProcessingFile>,
    /// As [`DatasetConfig::threshold_offset_db`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub threshold_offset_db: Option<[f64; 2]>,
    /// As [`DatasetConfig::objects`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub objects: Option<ObjectsFile>,
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
    /// Any folder of motion files with sentences.
    Files(FilesConfig),
    /// HumanML3D, with motions of AMASS or of the CMU database.
    #[serde(rename = "humanml3d")]
    HumanMl3d(HumanMl3dConfig),
    /// Motions generated by this project.
    Procedural(ProceduralConfig),
}

impl Default for DatasetConfig {
    fn default() -> Self {
        let placement = PlacementRange::default();
        Self {
            name: "dataset".into(),
            seed: 1,
            radar: "awr1843boost".into(),
            train_variants: 1,
            splits: None,
            shard_clips: 64,
            max_frames: 96,
            shortest_part_s: None,
            frame_rate_hz: None,
            slowest_mps: 0.0,
            remove_static_cells: false,
            facet_edge_m: 0.02,
            body_heights_m: None,
            distance_m: placement.distance_m,
            lateral_m: placement.lateral_m,
            heading_deg: placement.heading_rad.to_degrees(),
            radar_height_m: placement.radar_height_m,
            impairments: ImpairmentsFile::default(),
            noise: NoiseFile::default(),
            weather: WeatherFile::default(),
            processing: ProcessingFile::default(),
            threshold_offset_db: [0.0, 0.0],
            objects: None,
            room: None,
            board: Vec::new(),
            source: Vec::new(),
        }
    }
}

/// Permitted standing heights of a simulated body, m.
const BODY_HEIGHT_M: RangeInclusive<f32> = 1.0..=2.0;
/// Most heights of a data set: each body is polygonised once and kept in memory.
const MAX_BODIES: usize = 8;

/// Most boards of a data set: the chain of each is planned once for each thread.
const MAX_BOARDS: usize = 64;

/// Permitted values of the maximum facet edge length of a simulated body, m: from a hundred thousand facets to a body
/// without hands.
pub const BODY_FACET_EDGE_M: RangeInclusive<f32> = 0.008..=0.05;

/// Upper bound of every count in a configuration, so that a typing error does not fill a disk.
const MAX_COUNT: usize = 10_000_000;

impl DatasetConfig {
    /// Reads a configuration.
    ///
    /// # Errors
    /// TOML errors with their position; values out of range with their name.
    pub fn from_toml(text: &str) -> Result<Self, SynthError> {
        let config: Self = toml::from_str(text).map_err(|e| SynthError::Config(e.to_string()))?;
        config.check()?;
        Ok(config)
    }

    /// The configurations of the boards: this one alone if it names none. The clips of a board are those of a data set
    /// with its configuration.
    pub fn boards(&self) -> Vec<Self> {
        let shared = || Self {
            board: Vec::new(),
            ..self.clone()
        };
        if self.board.is_empty() {
            return vec![shared()];
        }
        let with = |board: &BoardConfig| {
            let board = board.clone();
            let mut config = shared();
            config.radar = board.radar.unwrap_or(config.radar);
            config.radar_height_m = board.radar_height_m.unwrap_or(config.radar_height_m);
            config.slowest_mps = board.slowest_mps.unwrap_or(config.slowest_mps);
            config.remove_static_cells = board
                .remove_static_cells
                .unwrap_or(config.remove_static_cells);
            config.impairments = board.impairments.unwrap_or(config.impairments);
            config.processing = board.processing.unwrap_or(config.processing);
            config.threshold_offset_db = board
                .threshold_offset_db
                .unwrap_or(config.threshold_offset_db);
            config.objects = board.objects.or(config.objects);
            config
        };
        self.board.iter().map(with).collect()
    }

    /// Checks every value, those of each board together with the values that it shares with the others.
    fn check(&self) -> Result<(), SynthError> {
        if self.board.len() > MAX_BOARDS {
            return Err(SynthError::Config(format!(
                "[[board]]: at most {MAX_BOARDS} boards, found {}",
                self.board.len()
            )));
        }
        if !self.board.is_empty() && self.frame_rate_hz.is_none() {
            return Err(SynthError::Config(
                "[[board]]: state frame_rate_hz, the rate of the stored frames of all boards"
                    .into(),
            ));
        }
        let n_boards = self.board.len();
        for (i, config) in self.boards().iter().enumerate() {
            config.check_board().map_err(|error| match error {
                SynthError::Config(problem) if n_boards > 0 => {
                    SynthError::Config(format!("board {} of {n_boards}: {problem}", i + 1))
                }
                error => error,
            })?;
        }
        Ok(())
    }

    /// Checks the values of a configuration with one board.
    fn check_board(&self) -> Result<(), SynthError> {
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
        for name in self.splits.iter().flatten() {
            if Split::from_name(name).is_none() {
                return fail(format!(
                    "splits: no split `{name}`, but train, val and test"
                ));
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
        if let Some(part_s) = self.shortest_part_s
            && !(1.0..=60.0).contains(&part_s)
        {
            return fail(format!(
                "shortest_part_s: must be in 1..=60, found {part_s}"
            ));
        }
        if !BODY_FACET_EDGE_M.contains(&self.facet_edge_m) {
            return fail(format!(
                "facet_edge_m: must be in {BODY_FACET_EDGE_M:?}, found {}",
                self.facet_edge_m
            ));
        }
        if let Some(heights_m) = &self.body_heights_m {
            let is_valid = |height_m: &f32| BODY_HEIGHT_M.contains(height_m);
            if heights_m.is_empty()
                || heights_m.len() > MAX_BODIES
                || !heights_m.iter().all(is_valid)
            {
                return fail(format!(
                    "body_heights_m: must be 1 to {MAX_BODIES} heights in {BODY_HEIGHT_M:?}, found {heights_m:?}"
                ));
            }
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
        self.noise.check().map_err(SynthError::Config)?;
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
            // Ranges and material names do not depend on the radar.
            room.walls(77e9)?;
        }
        self.weather.check().map_err(SynthError::Config)?;
        let [low, high] = self.threshold_offset_db;
        if !(low <= high && (-60.0..=60.0).contains(&low) && (-60.0..=60.0).contains(&high)) {
            return fail("threshold_offset_db: must be [low, high] in -60..=60".into());
        }
        if [low, high] != [0.0, 0.0]
            && !matches!(self.processing.detector, Some(Detector::LogCfar { .. }))
        {
            return fail("threshold_offset_db: needs [processing] with a log_cfar detector".into());
        }
        if let Some(objects) = &self.objects {
            objects.check().map_err(SynthError::Config)?;
        }
        for source in &self.source {
            if let SourceConfig::Procedural(config) = source {
                let counts = [config.train, config.val, config.test];
                if counts.into_iter().any(|n| n > MAX_COUNT) {
                    return fail(format!(
                        "procedural: more than {MAX_COUNT} motions asked for"
                    ));
                }
                config.check().map_err(SynthError::Config)?;
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

    /// Whether the clips of a split are built.
    pub fn builds(&self, split: Split) -> bool {
        let names = self.splits.as_ref();
        names.is_none_or(|names| names.iter().any(|name| name == split.name()))
    }

    /// The placement settings.
    pub fn placement(&self) -> PlacementRange {
        PlacementRange {
            distance_m: self.distance_m,
            lateral_m: self.lateral_m,
            heading_rad: self.heading_deg.to_radians(),
            radar_height_m: self.radar_height_m,
        }
    }

    /// Checks that people can be seen at the distances of the configuration.
    ///
    /// # Errors
    /// As [`PlacementRange::check`].
    pub fn check_distance(&self, radar: &RadarConfig) -> Result<(), SynthError> {
        let checked = self.placement().check(radar);
        checked.map_err(|problem| SynthError::Config(format!("distance_m: {problem}")))
    }

    /// Simulator options. Reflections between surfaces are enabled if there is a room, with half the rays of a scene.
    /// This halves the time and makes the strengths of individual ghost points noisier.
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
    /// A radar that the simulator or the signal chain does not support.
    pub fn synthesizer(&self, radar: &RadarConfig) -> Result<Synthesizer, SynthError> {
        self.synthesizer_with(radar, self.sim_options(), Vec::new())
    }

    /// As [`Self::synthesizer`], with other simulator options and with surfaces in addition to those of the room.
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
        let radar = self.noise.radar(radar);
        let synthesizer = Synthesizer::with_simulation(&radar, Method::Fast, dsp, sim)?;
        Ok(synthesizer
            .with_impairments(impairments)
            .with_walls(walls)
            .with_noise(self.noise.resolve()))
    }

    /// Number of stored frames per second.
    ///
    /// # Errors
    /// A rate that is higher than the radar's.
    pub fn stored_rate_hz(&self, radar: &RadarConfig) -> Result<f64, SynthError> {
        let own_hz = radar.frame_rate_hz();
        let rate_hz = self.frame_rate_hz.unwrap_or(own_hz);
        // A rate that was rounded when written still counts as the radar's own.
        if rate_hz > own_hz * 1.001 {
            return Err(SynthError::Config(format!(
                "frame_rate_hz: {rate_hz}, but the radar `{}` makes {own_hz:.3} frames/s",
                radar.name
            )));
        }
        Ok(rate_hz)
    }

    /// Opens every source. Relative paths are resolved against `base`.
    ///
    /// # Errors
    /// A source that cannot be read.
    pub fn open_sources(&self, base: &Path) -> Result<Vec<Box<dyn Corpus>>, SynthError> {
        self.open_sources_until(base, &|| false)
    }

    /// As [`Self::open_sources`], but ends early once `stop` returns `true`: thousands of built-in motions take seconds.
    pub(crate) fn open_sources_until(
        &self,
        base: &Path,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Result<Vec<Box<dyn Corpus>>, SynthError> {
        self.source
            .iter()
            .map(|source| -> Result<Box<dyn Corpus>, SynthError> {
                let corpus: Box<dyn Corpus> = match source {
                    SourceConfig::BandaiNamco { path } => {
                        Box::new(BandaiNamco::open(&base.join(path))?)
                    }
                    SourceConfig::Files(files) => Box::new(MotionFiles::open(files, base)?),
                    SourceConfig::HumanMl3d(config) => Box::new(humanml3d::open(config, base)?),
                    SourceConfig::Procedural(config) => {
                        Box::new(ProceduralCorpus::new_until(config, self.seed, stop)?)
                    }
                };
                match stop() {
                    true => Err(SynthError::Interrupted),
                    false => Ok(corpus),
                }
            })
            .collect()
    }

    /// The sources with some of their items, which were opened before: one list for each source, of items and recipes
    /// ([`Corpus::recipe`]).
    ///
    /// # Errors
    /// A recipe of another source.
    pub fn reopen_sources(
        &self,
        base: &Path,
        items: Vec<Vec<(CorpusItem, Value)>>,
    ) -> Result<Vec<Box<dyn Corpus>>, SynthError> {
        let open = |(source, items): (&SourceConfig, Vec<(CorpusItem, Value)>)| {
            Ok::<Box<dyn Corpus>, SynthError>(match source {
                SourceConfig::BandaiNamco { path } => {
                    Box::new(BandaiNamco::of_items(&base.join(path), items)?)
                }
                SourceConfig::Files(config) => {
                    let folder = base.join(&config.path);
                    Box::new(MotionFiles::of_items(config.terms(), folder, items)?)
                }
                SourceConfig::HumanMl3d(config) => {
                    Box::new(MotionFiles::of_items(config.terms(), base.into(), items)?)
                }
                SourceConfig::Procedural(config) => {
                    Box::new(ProceduralCorpus::of_items(config.draw, items)?)
                }
            })
        };
        self.source.iter().zip(items).map(open).collect()
    }

    /// The radar.
    ///
    /// # Errors
    /// Unknown name, unreadable file, or an impossible radar.
    pub fn open_radar(&self, base: &Path) -> Result<RadarConfig, SynthError> {
        crate::synthesizer::open_radar(&self.radar, base)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::corpus::procedural::Draw;

    #[test]
    fn a_configuration_survives_a_round_trip() {
        let config = DatasetConfig {
            source: vec![SourceConfig::Procedural(ProceduralConfig {
                train: 3,
                val: 2,
                test: 1,
                draw: Draw::People,
                held_out: vec!["a person kicks".into()],
            })],
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
            ("[noise]\nsnr_db = nan", "snr_db"),
            ("[noise]\nsnr_db = 10.0\nnone = true", "exclude"),
            ("frame_rate_hz = 0.0", "frame_rate_hz"),
            ("shortest_part_s = 0.1", "shortest_part_s"),
            ("slowest_mps = -1.0", "slowest_mps"),
            (
                "radar_height_m = 1.5\n[room]\n",
                "[room] radar_height_m: 1 m",
            ),
            ("distance_m = [2.0, 7.0]\n[room]\n", "wall opposite"),
            ("[room]\nwalls = \"cheese\"", "cheese"),
            ("[room]\ndepth = 3.0", "depth"),
            (
                "[objects]\nn_strong = [3, 1]\nrange_m = [1.0, 2.0]",
                "n_strong",
            ),
        ] {
            let error = DatasetConfig::from_toml(text).unwrap_err().to_string();
            assert!(error.contains(word), "`{error}` should name `{word}`");
        }
    }
}
