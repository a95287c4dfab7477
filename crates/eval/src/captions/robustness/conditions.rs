//! What can be changed: the conditions of an experiment, and the values they take.

use radarllm_base::materials::Substance;
use serde::Deserialize;

use crate::EvalError;

/// The configuration file (TOML).
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plan {
    /// Data set configuration, relative to this file: motions, placement, radar, seed.
    pub data: String,
    /// Split whose motions are shown.
    #[serde(default = "test_split")]
    pub split: String,
    /// Motions in every cell, spread evenly over the split.
    pub clips: usize,
    /// Conditions.
    #[serde(rename = "axis")]
    pub axes: Vec<Axis>,
}

fn test_split() -> String {
    "test".into()
}

impl Plan {
    /// Reads a configuration.
    ///
    /// # Errors
    /// TOML errors with their place; values out of range with the axis.
    pub fn from_toml(text: &str) -> Result<Self, EvalError> {
        let plan: Self = toml::from_str(text).map_err(|e| EvalError::Config(e.to_string()))?;
        check(&plan).map_err(EvalError::Config)?;
        Ok(plan)
    }

    /// Every change once, the unchanged cell first.
    pub fn changes(&self) -> Vec<Change> {
        let mut changes = vec![Change::Nothing];
        for change in self.axes.iter().flat_map(Axis::changes) {
            if !changes.contains(&change) {
                changes.push(change);
            }
        }
        changes
    }
}

/// One condition and the values it takes.
#[derive(Clone, Debug, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Axis {
    /// Thermal noise above the radar's own, dB.
    Noise {
        /// Values.
        extra_db: Vec<f64>,
    },
    /// Distance of the path's middle, m.
    Distance {
        /// Values.
        distance_m: Vec<f32>,
    },
    /// Heading of the first pose, degrees; 0 faces the radar.
    Aspect {
        /// Values.
        heading_deg: Vec<f32>,
    },
    /// Speed of the motion as a multiple of its own.
    Tempo {
        /// Values.
        factor: Vec<f64>,
    },
    /// Standing height of the person, m.
    BodyHeight {
        /// Values.
        height_m: Vec<f32>,
    },
    /// Strongest points kept of each frame.
    Points {
        /// Values.
        at_most: Vec<usize>,
    },
    /// Probability that a frame comes without points.
    FrameLoss {
        /// Values.
        probability: Vec<f64>,
    },
    /// A second person, who performs the motion of another clip. Both are tracked and described apart, beginning with the
    /// person alone.
    SecondPerson {
        /// Angle between both, seen from the radar, degrees.
        apart_deg: Vec<f64>,
    },
    /// Built-in radars or radar files.
    Radar {
        /// Values.
        radars: Vec<String>,
    },
    /// Rain, mm/h.
    Rain {
        /// Values.
        rain_mm_per_h: Vec<f64>,
    },
    /// Smoke particles, g/m^3.
    Smoke {
        /// Values.
        smoke_g_per_m3: Vec<f64>,
    },
    /// A sheet half a metre in front of the radar.
    Screen {
        /// Values.
        screens: Vec<ScreenFile>,
    },
}

/// A sheet of material.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScreenFile {
    /// Name of the material.
    pub material: String,
    /// Thickness, m.
    pub thickness_m: f64,
}

/// What a cell changes. Its debug form is part of the names of kept cells.
#[derive(Clone, Debug, PartialEq)]
pub enum Change {
    /// The clips as they are.
    Nothing,
    /// Thermal noise above the radar's own, dB.
    ExtraNoiseDb(f64),
    /// Distance of the path's middle, m.
    DistanceM(f32),
    /// Heading of the first pose, degrees.
    HeadingDeg(f32),
    /// Speed of the motion as a multiple of its own.
    Tempo(f64),
    /// Standing height of the person, m.
    BodyHeightM(f32),
    /// Strongest points kept of each frame.
    AtMostPoints(usize),
    /// Probability that a frame comes without points.
    FrameLoss(f64),
    /// The person alone, tracked as if there were others.
    Tracked,
    /// A second person at this angle, seen from the radar, degrees.
    SecondPersonDeg(f64),
    /// Another radar.
    Radar(String),
    /// Rain, mm/h.
    RainMmPerH(f64),
    /// Smoke, g/m^3.
    SmokeGPerM3(f64),
    /// A sheet in front of the radar.
    Screen(ScreenFile),
}

impl Change {
    /// Whether the points are made from the unchanged points rather than simulated.
    pub(super) fn is_of_points(&self) -> bool {
        match self {
            Self::Nothing | Self::AtMostPoints(_) | Self::FrameLoss(_) => true,
            _ => self.is_tracked(),
        }
    }

    /// Whether people are tracked and described apart.
    pub(super) fn is_tracked(&self) -> bool {
        matches!(self, Self::Tracked | Self::SecondPersonDeg(_))
    }

    /// In words.
    pub fn label(&self) -> String {
        match self {
            Self::Nothing => "nothing changed".into(),
            Self::ExtraNoiseDb(v) => format!("{v} dB more noise"),
            Self::DistanceM(v) => format!("{v} m"),
            Self::HeadingDeg(v) => format!("{v} degrees"),
            Self::Tempo(v) => format!("{v} times as fast"),
            Self::BodyHeightM(v) => format!("{v} m tall"),
            Self::AtMostPoints(v) => format!("{v} points"),
            Self::FrameLoss(v) => format!("{} % of frames empty", v * 100.0),
            Self::Tracked => "alone, tracked".into(),
            Self::SecondPersonDeg(v) => format!("another person {v} degrees apart"),
            Self::Radar(name) => name.clone(),
            Self::RainMmPerH(v) => format!("{v} mm/h"),
            Self::SmokeGPerM3(v) => format!("{v} g/m^3"),
            Self::Screen(s) => format!("{} mm of {}", s.thickness_m * 1000.0, s.material),
        }
    }

    /// Place on the axis of a plot, if it has one.
    pub fn x(&self) -> Option<f64> {
        match self {
            Self::ExtraNoiseDb(v)
            | Self::Tempo(v)
            | Self::FrameLoss(v)
            | Self::SecondPersonDeg(v)
            | Self::RainMmPerH(v)
            | Self::SmokeGPerM3(v) => Some(*v),
            Self::DistanceM(v) | Self::HeadingDeg(v) | Self::BodyHeightM(v) => Some(f64::from(*v)),
            Self::AtMostPoints(v) => Some(*v as f64),
            Self::Nothing | Self::Tracked | Self::Radar(_) | Self::Screen(_) => None,
        }
    }
}

impl Axis {
    /// Name in reports and files.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Noise { .. } => "noise",
            Self::Distance { .. } => "distance",
            Self::Aspect { .. } => "aspect",
            Self::Tempo { .. } => "tempo",
            Self::BodyHeight { .. } => "body-height",
            Self::Points { .. } => "points",
            Self::FrameLoss { .. } => "frame-loss",
            Self::SecondPerson { .. } => "second-person",
            Self::Radar { .. } => "radar",
            Self::Rain { .. } => "rain",
            Self::Smoke { .. } => "smoke",
            Self::Screen { .. } => "screen",
        }
    }

    /// What is varied, with its unit.
    pub fn about(&self) -> &'static str {
        match self {
            Self::Noise { .. } => "thermal noise above the radar's own, dB",
            Self::Distance { .. } => "distance of the path's middle, m",
            Self::Aspect { .. } => "heading of the first pose, degrees (0 faces the radar)",
            Self::Tempo { .. } => "speed of the motion as a multiple of its own",
            Self::BodyHeight { .. } => "standing height of the person, m",
            Self::Points { .. } => "strongest points kept of each frame",
            Self::FrameLoss { .. } => "share of frames that come without points",
            Self::SecondPerson { .. } => {
                "angle to a second person, seen from the radar, degrees; both tracked"
            }
            Self::Radar { .. } => "radar, at the frame rate of the base",
            Self::Rain { .. } => "rain on the whole path, mm/h",
            Self::Smoke { .. } => "smoke on the whole path, g/m^3",
            Self::Screen { .. } => "a sheet across the view, 0.5 m in front of the radar",
        }
    }

    /// The values.
    pub fn changes(&self) -> Vec<Change> {
        fn all<T: Clone>(values: &[T], change: impl Fn(T) -> Change) -> Vec<Change> {
            values.iter().cloned().map(change).collect()
        }
        match self {
            Self::Noise { extra_db } => all(extra_db, Change::ExtraNoiseDb),
            Self::Distance { distance_m } => all(distance_m, Change::DistanceM),
            Self::Aspect { heading_deg } => all(heading_deg, Change::HeadingDeg),
            Self::Tempo { factor } => all(factor, Change::Tempo),
            Self::BodyHeight { height_m } => all(height_m, Change::BodyHeightM),
            Self::Points { at_most } => all(at_most, Change::AtMostPoints),
            Self::FrameLoss { probability } => all(probability, Change::FrameLoss),
            Self::SecondPerson { apart_deg } if apart_deg.is_empty() => Vec::new(),
            Self::SecondPerson { apart_deg } => {
                let mut changes = vec![Change::Tracked];
                changes.extend(all(apart_deg, Change::SecondPersonDeg));
                changes
            }
            Self::Radar { radars } => all(radars, Change::Radar),
            Self::Rain { rain_mm_per_h } => all(rain_mm_per_h, Change::RainMmPerH),
            Self::Smoke { smoke_g_per_m3 } => all(smoke_g_per_m3, Change::SmokeGPerM3),
            Self::Screen { screens } => all(screens, Change::Screen),
        }
    }

    /// Place of the unchanged cell on the axis of a plot, if it has one.
    pub(super) fn x_of_nothing(&self) -> Option<f64> {
        match self {
            Self::Noise { .. }
            | Self::FrameLoss { .. }
            | Self::Rain { .. }
            | Self::Smoke { .. } => Some(0.0),
            Self::Tempo { .. } => Some(1.0),
            _ => None,
        }
    }
}

fn check(plan: &Plan) -> Result<(), String> {
    if !(2..=100_000).contains(&plan.clips) {
        return Err(format!(
            "clips: must be in 2..=100000, found {}",
            plan.clips
        ));
    }
    if plan.axes.is_empty() {
        return Err("no [[axis]]".into());
    }
    let mut names: Vec<&str> = plan.axes.iter().map(Axis::name).collect();
    names.sort_unstable();
    if let Some(twice) = names.windows(2).find(|w| w[0] == w[1]) {
        return Err(format!("axis `{}` is given twice", twice[0]));
    }
    for axis in &plan.axes {
        let changes = axis.changes();
        if changes.is_empty() {
            return Err(format!("axis `{}` has no values", axis.name()));
        }
        for change in changes {
            let range = match change {
                Change::ExtraNoiseDb(_) => 0.0..=100.0,
                Change::DistanceM(_) => 0.5..=100.0,
                Change::HeadingDeg(_) => -360.0..=360.0,
                Change::Tempo(_) => 0.25..=4.0,
                Change::BodyHeightM(_) => 1.0..=2.0,
                Change::AtMostPoints(_) => 1.0..=1e6,
                Change::FrameLoss(_) => 0.0..=1.0,
                Change::SecondPersonDeg(_) => 1.0..=180.0,
                Change::RainMmPerH(_) => 0.0..=200.0,
                Change::SmokeGPerM3(_) => 0.0..=100.0,
                Change::Screen(ref screen) => {
                    if Substance::named(&screen.material).is_none() {
                        let known = Substance::ALL.map(Substance::name).join(", ");
                        return Err(format!(
                            "axis `screen`: material `{}` is unknown; {known} are known",
                            screen.material
                        ));
                    }
                    if !(1e-6..=0.1).contains(&screen.thickness_m) {
                        return Err(format!(
                            "axis `screen`: thickness_m must be in 1e-6..=0.1, found {}",
                            screen.thickness_m
                        ));
                    }
                    continue;
                }
                Change::Nothing | Change::Tracked | Change::Radar(_) => continue,
            };
            if !change.x().is_some_and(|x| range.contains(&x)) {
                return Err(format!(
                    "axis `{}`: values must be in {range:?}, found {:?}",
                    axis.name(),
                    change.x()
                ));
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(axis: &str) -> Result<Plan, String> {
        let text = format!("data = \"d.toml\"\nclips = 4\n[[axis]]\n{axis}");
        Plan::from_toml(&text).map_err(|e| e.to_string())
    }

    #[test]
    fn mistakes_in_a_configuration_are_named() {
        for (axis, word) in [
            ("kind = \"fog\"", "fog"),
            ("kind = \"noise\"\nextra_db = []", "no values"),
            ("kind = \"noise\"\nextra_db = [-3.0]", "-3"),
            ("kind = \"rain\"\nrain_mm_per_h = [nan]", "rain"),
            ("kind = \"points\"\nat_most = [0]", "points"),
            ("kind = \"tempo\"\nfactor = [0.0]", "tempo"),
            ("kind = \"body-height\"\nheight_m = [nan]", "body-height"),
            (
                "kind = \"second-person\"\napart_deg = [0.0]",
                "second-person",
            ),
            ("kind = \"second-person\"\napart_deg = []", "no values"),
            ("kind = \"frame-loss\"\nprobability = [1.5]", "frame-loss"),
            (
                "kind = \"screen\"\nscreens = [{ material = \"cheese\", thickness_m = 0.01 }]",
                "cheese",
            ),
            (
                "kind = \"rain\"\nrain_mm_per_h = [1]\n[[axis]]\nkind = \"rain\"\nrain_mm_per_h = [2]",
                "twice",
            ),
        ] {
            let error = plan(axis).err().unwrap_or_default();
            assert!(error.contains(word), "`{error}` should name `{word}`");
        }
        assert!(plan("kind = \"distance\"\ndistance_m = [2.0, 6.0]").is_ok());
    }
}
