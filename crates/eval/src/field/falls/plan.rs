//! What is asked of the fall monitor: radars, places, people, falls and what looks like falls.

use std::path::Path;

use radarllm_base::{RadarConfig, seed::derive_seed};
use radarllm_io::TiFirmware;
use radarllm_radar_dsp::DspOptions;
use radarllm_synth::{Method, SynthError, Synthesizer, placement::MIN_DISTANCE_M};
use serde::{Deserialize, Serialize};

use crate::EvalError;

/// Period of the frames that the fall monitor gets, s. Live frames are resampled to it.
pub const FRAME_PERIOD_S: f64 = 0.1;
/// Time in the last pose after a motion, s; the longest one of a request. Longer than the monitor remembers that somebody
/// was up.
pub(super) const AFTER_S: f32 = 10.0;

/// The configuration file (TOML).
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FallPlan {
    /// Seed of conditions, motions and noise.
    pub seed: u64,
    /// Trials of each fall and speed with each radar.
    pub fall_repeats: usize,
    /// Trials of each other motion and speed with each radar.
    pub other_repeats: usize,
    /// Longest edge of the body's facets, m.
    pub facet_edge_m: f32,
    /// How the radar is mounted.
    pub mounting: Vec<MountingFile>,
    /// Distances of the middle of the path from the radar along boresight, m.
    pub distance_m: Vec<f32>,
    /// Largest sideways offset of the middle of the path, m.
    pub lateral_m: f32,
    /// Headings of the first pose, degrees; 0 faces the radar.
    pub heading_deg: Vec<f32>,
    /// What everybody does before: parts of a request without `builtin:`.
    pub before: Vec<Before>,
    /// People.
    pub person: Vec<PersonFile>,
    /// Radars.
    pub radar: Vec<RadarFile>,
    /// Falls.
    pub fall: Vec<MotionFile>,
    /// What is not a fall.
    pub other: Vec<MotionFile>,
}

/// What somebody does before the fall, or before what is not a fall.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Before {
    /// Name in reports.
    pub name: String,
    /// Built-in motions, whose keys have the prefix of their motion: `walk?walk.distance_m=1.5`.
    pub motion: String,
}

/// How a radar is mounted on the wall.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MountingFile {
    /// Height above the floor, m.
    pub height_m: f32,
    /// Angle of the boresight below the horizon, degrees.
    #[serde(default)]
    pub tilt_deg: f32,
}

/// A person.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PersonFile {
    /// Standing height, m.
    pub height_m: f32,
    /// `slim`, `average` or `heavy`.
    pub build: String,
}

/// A radar.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RadarFile {
    /// Name in reports.
    pub name: String,
    /// Built-in name or radar file, relative to the configuration. It sends ten frames a second whatever it says itself.
    pub radar: String,
    /// Whether points are those of TI's out-of-box demo; otherwise those of the project's signal chain. Needs a `.cfg`.
    #[serde(default)]
    pub out_of_box: bool,
}

/// A motion at several speeds.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MotionFile {
    /// Name in reports.
    pub name: String,
    /// Built-in motions, whose keys have the prefix of their motion. `{speed}` is replaced by each speed.
    pub motion: String,
    /// Speeds; once without a speed if omitted.
    #[serde(default)]
    pub speed: Vec<f32>,
}

/// A motion under conditions.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Trial {
    /// Name of the motion.
    pub kind: String,
    /// Speed, where the motion has several.
    pub speed: Option<f32>,
    /// What was done before.
    pub before: String,
    /// The request that is rendered.
    pub request: String,
    /// Name of the radar.
    pub radar: String,
    /// Height of the radar above the floor, m.
    pub radar_height_m: f32,
    /// Angle of its boresight below the horizon, degrees.
    pub tilt_deg: f32,
    /// Distance of the middle of the path, m.
    pub distance_m: f32,
    /// Heading of the first pose, degrees.
    pub heading_deg: f32,
    /// Body height and build.
    pub person: String,
    /// Seed of motion, sideways offset and noise.
    pub seed: u64,
}

impl FallPlan {
    /// Reads a configuration.
    ///
    /// # Errors
    /// TOML errors with their place, empty lists, numbers out of range and motions that cannot be composed.
    pub fn from_toml(text: &str) -> Result<Self, EvalError> {
        let plan: Self = toml::from_str(text).map_err(|e| EvalError::Config(e.to_string()))?;
        plan.check()?;
        Ok(plan)
    }

    fn check(&self) -> Result<(), EvalError> {
        let fail = |problem: String| Err(EvalError::Config(problem));
        for (list, n) in [
            ("mounting", self.mounting.len()),
            ("distance_m", self.distance_m.len()),
            ("heading_deg", self.heading_deg.len()),
            ("before", self.before.len()),
            ("person", self.person.len()),
            ("radar", self.radar.len()),
        ] {
            if n == 0 {
                return fail(format!("{list}: at least one is needed"));
            }
        }
        if !(1..=1000).contains(&self.fall_repeats) || !(1..=1000).contains(&self.other_repeats) {
            return fail("fall_repeats, other_repeats: must be 1 to 1000".into());
        }
        if !(0.0..=3.0).contains(&self.lateral_m) {
            return fail("lateral_m: must be 0 to 3".into());
        }
        let heights_m = self.mounting.iter().map(|m| m.height_m).collect();
        let tilts_deg = self.mounting.iter().map(|m| m.tilt_deg).collect();
        for (name, values, range) in [
            ("height_m of a mounting", &heights_m, 0.1..=4.0),
            ("tilt_deg", &tilts_deg, -90.0..=90.0),
            ("distance_m", &self.distance_m, MIN_DISTANCE_M..=20.0),
            ("heading_deg", &self.heading_deg, -360.0..=360.0),
        ] {
            if let Some(value) = values.iter().find(|v| !range.contains(*v)) {
                return fail(format!("{name}: must be in {range:?}, found {value}"));
            }
        }
        for (i, radar) in self.radar.iter().enumerate() {
            if self.radar[..i].iter().any(|other| other.name == radar.name) {
                return fail(format!("radar `{}`: is given twice", radar.name));
            }
        }
        for trial in self.trials() {
            radarllm_motions::parse(&trial.request)
                .map_err(|e| EvalError::Config(format!("`{}`: {e}", trial.kind)))?;
        }
        Ok(())
    }

    /// All trials: falls, then what is not a fall. Every fall and every other motion is tried with every radar at every
    /// speed. Each of the other conditions takes all its values equally often, in an order that is drawn from the seed
    /// and independent of the others.
    pub fn trials(&self) -> Vec<Trial> {
        let mut trials = self.trials_of("fall", &self.fall, self.fall_repeats);
        trials.extend(self.trials_of("other", &self.other, self.other_repeats));
        trials
    }

    /// Number of trials of falls, which come first.
    pub(super) fn n_falls(&self) -> usize {
        self.trials_of("fall", &self.fall, self.fall_repeats).len()
    }

    fn trials_of(&self, group: &str, motions: &[MotionFile], n_repeats: usize) -> Vec<Trial> {
        let mut cells = Vec::new();
        for radar in &self.radar {
            for motion in motions {
                let speeds: Vec<Option<f32>> = match motion.speed.is_empty() {
                    true => vec![None],
                    false => motion.speed.iter().copied().map(Some).collect(),
                };
                for speed in speeds {
                    cells.extend((0..n_repeats).map(|_| (radar, motion, speed)));
                }
            }
        }
        let draw = |condition: &str, n_values: usize| {
            let seed = derive_seed(self.seed, &format!("{group}/{condition}"));
            balanced(cells.len(), n_values, seed)
        };
        let mountings = draw("mounting", self.mounting.len());
        let distances = draw("distance_m", self.distance_m.len());
        let headings = draw("heading_deg", self.heading_deg.len());
        let people = draw("person", self.person.len());
        let before = draw("before", self.before.len());
        let trial = |(i, (radar, motion, speed)): (usize, &(&RadarFile, &MotionFile, _))| {
            let person = &self.person[people[i]];
            let before = &self.before[before[i]];
            let heading_deg = self.heading_deg[headings[i]];
            Trial {
                kind: motion.name.clone(),
                speed: *speed,
                before: before.name.clone(),
                request: compose(&before.motion, motion, *speed, person, heading_deg),
                radar: radar.name.clone(),
                radar_height_m: self.mounting[mountings[i]].height_m,
                tilt_deg: self.mounting[mountings[i]].tilt_deg,
                distance_m: self.distance_m[distances[i]],
                heading_deg,
                person: format!("{} m, {}", person.height_m, person.build),
                seed: derive_seed(self.seed, &format!("{group}/{i}")),
            }
        };
        cells.iter().enumerate().map(trial).collect()
    }

    /// The radar of this name, ready to simulate.
    pub(super) fn open_radar(&self, name: &str, base: &Path) -> Result<OpenRadar, EvalError> {
        let unknown = || EvalError::Config(format!("radar `{name}`: not in the configuration"));
        let file = self.radar.iter().find(|radar| radar.name == name);
        let file = file.ok_or_else(unknown)?;
        let opened = radarllm_io::open_radar_in(&file.radar, base)?;
        let firmware = match file.out_of_box {
            true => Some(TiFirmware::out_of_box(&opened)?),
            false => None,
        };
        if firmware.as_ref().is_some_and(|f| f.reports_surroundings()) {
            let problem = "the firmware must remove static clutter: `clutterRemoval -1 1`";
            return Err(EvalError::Config(format!("radar `{name}`: {problem}")));
        }
        let config = RadarConfig {
            frame_period_s: FRAME_PERIOD_S,
            ..opened.into_config()?
        };
        let problem = |e| EvalError::Config(format!("radar `{name}` at 10 frames/s: {e}"));
        config.validate().map_err(problem)?;
        Ok(OpenRadar { config, firmware })
    }
}

/// A radar, ready to simulate.
pub(super) struct OpenRadar {
    config: RadarConfig,
    pub(super) firmware: Option<TiFirmware>,
}

impl OpenRadar {
    pub(super) fn synthesizer(&self) -> Result<Synthesizer, SynthError> {
        let own = DspOptions::default;
        let chain = self.firmware.as_ref().map_or_else(own, |f| f.chain.clone());
        Synthesizer::new(&self.config, Method::Fast, chain)
    }
}

/// `n` numbers below `n_values`, each equally often as far as `n` allows, in an order drawn from the seed.
fn balanced(n: usize, n_values: usize, seed: u64) -> Vec<usize> {
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by_key(|i| derive_seed(seed, &i.to_string()));
    order.into_iter().map(|i| i % n_values).collect()
}

/// One request: what is done before, the motion, the last pose.
fn compose(
    before: &str,
    motion: &MotionFile,
    speed: Option<f32>,
    person: &PersonFile,
    heading_deg: f32,
) -> String {
    let spoken = speed.map_or_else(String::new, |speed| speed.to_string());
    let motion = motion.motion.replace("{speed}", &spoken);
    let split = |text: &str| -> (String, String) {
        let (chain, query) = text.split_once('?').unwrap_or((text, ""));
        (chain.into(), query.into())
    };
    let ((first, first_query), (second, second_query)) = (split(before), split(&motion));
    let global = format!(
        "height_m={}&build={}&heading_deg={heading_deg}&after_s={AFTER_S}",
        person.height_m, person.build
    );
    let queries = [first_query, second_query, global];
    let queries: Vec<String> = queries.into_iter().filter(|q| !q.is_empty()).collect();
    format!("builtin:{first}+then+{second}?{}", queries.join("&"))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub const PLAN: &str = r#"
        seed = 1
        fall_repeats = 1
        other_repeats = 2
        facet_edge_m = 0.04
        distance_m = [2.5]
        lateral_m = 0.0
        heading_deg = [0, 90, 180]
        [[mounting]]
        height_m = 1.0
        [[mounting]]
        height_m = 1.5
        tilt_deg = 10
        [[before]]
        name = "walk"
        motion = "walk?walk.distance_m=1.5"
        [[person]]
        height_m = 1.7
        build = "average"
        [[radar]]
        name = "awr1843boost"
        radar = "awr1843boost"
        [[fall]]
        name = "fall forward"
        motion = "fall?fall.direction=forward&fall.speed={speed}"
        speed = [0.7, 1.0, 1.4]
        [[other]]
        name = "bow"
        motion = "bow"
    "#;

    #[test]
    fn every_motion_is_tried_at_every_speed_and_conditions_are_balanced() {
        let plan = FallPlan::from_toml(PLAN).unwrap();
        let trials = plan.trials();
        assert_eq!(trials.len(), 5);
        let speeds: Vec<Option<f32>> = trials.iter().map(|t| t.speed).collect();
        assert_eq!(speeds, [Some(0.7), Some(1.0), Some(1.4), None, None]);
        let headings = |range: std::ops::Range<usize>| {
            let mut all: Vec<f32> = trials[range].iter().map(|t| t.heading_deg).collect();
            all.sort_by(f32::total_cmp);
            all
        };
        assert_eq!(headings(0..3), [0.0, 90.0, 180.0]);
        let start = "builtin:walk+then+fall?walk.distance_m=1.5&fall.direction=forward&fall.speed=0.7&\
                     height_m=1.7&build=average&heading_deg=";
        assert!(
            trials[0].request.starts_with(start),
            "{}",
            trials[0].request
        );
        assert_eq!(plan.trials(), trials);
        let other = PLAN.replacen("seed = 1", "seed = 2", 1);
        assert_ne!(FallPlan::from_toml(&other).unwrap().trials(), trials);
    }

    #[test]
    fn mistakes_are_named() {
        for (from, to, word) in [
            ("seed = 1", "sead = 1", "sead"),
            (
                "heading_deg = [0, 90, 180]",
                "heading_deg = []",
                "heading_deg",
            ),
            ("distance_m = [2.5]", "distance_m = [0.2]", "distance_m"),
            ("height_m = 1.5", "height_m = 0.0", "height_m"),
            ("tilt_deg = 10", "tilt_deg = 91", "tilt_deg"),
            ("motion = \"bow\"", "motion = \"bown\"", "bown"),
            ("fall_repeats = 1", "fall_repeats = 0", "fall_repeats"),
            ("lateral_m = 0.0", "lateral_m = nan", "lateral_m"),
            ("build = \"average\"", "build = \"tall\"", "tall"),
        ] {
            let error = FallPlan::from_toml(&PLAN.replacen(from, to, 1)).unwrap_err();
            assert!(error.to_string().contains(word), "{error}");
        }
        let plan = PLAN.replacen(
            "radar = \"awr1843boost\"",
            "radar = \"awr1843boost\"\nout_of_box = true",
            1,
        );
        let plan = FallPlan::from_toml(&plan).unwrap();
        assert!(plan.open_radar("awr1843boost", Path::new("")).is_err());
    }
}
