//! Examples of taught activities, and their file.

use std::path::Path;

use radarllm_base::Clip;
use radarllm_files::{
    atomic::{self, Existing},
    bounded,
    lock::Lock,
};
use serde::{Deserialize, Serialize};

use crate::shape::{N_FEATURES, windows};

/// The `format` of every memory file.
const FORMAT: &str = "radarllm memory";
/// Version of the file and of the features in it.
const VERSION: u32 = 4;
/// Largest memory file, bytes: some thousand examples.
const MAX_BYTES: u64 = 64 << 20;
/// Most windows of one example; of a longer recording these are taken at equal distances.
const MAX_WINDOWS: usize = 60;
/// Longest name, characters.
const MAX_NAME: usize = 60;
/// Longest sentence, characters.
const MAX_SAYS: usize = 300;

/// Activities with their examples.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Memory {
    format: String,
    version: u32,
    activities: Vec<Taught>,
}

/// A taught activity.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Taught {
    /// Name.
    pub name: String,
    /// The sentence that describes it.
    pub says: String,
    /// Its recordings.
    pub examples: Vec<Example>,
}

/// A recording of an activity, as features.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Example {
    /// The recording.
    pub source: String,
    /// The radar.
    pub radar: String,
    /// Height of the radar above the floor, m.
    pub radar_height_m: f32,
    /// Length of the recording, s.
    pub seconds: f64,
    /// Features of its windows, `[windows][N_FEATURES]`.
    pub windows: Vec<Vec<f32>>,
}

/// A taught activity in a list.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TaughtOverview<'a> {
    /// Name.
    pub name: &'a str,
    /// The sentence that describes it.
    pub says: &'a str,
    /// Its recordings.
    pub examples: Vec<ExampleOverview<'a>>,
}

/// An example in a list.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ExampleOverview<'a> {
    /// The recording.
    pub source: &'a str,
    /// The radar.
    pub radar: &'a str,
    /// Length of the recording, s.
    pub seconds: f64,
    /// Number of windows.
    pub windows: usize,
}

/// Why an example was not taken, or a file not read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TeachError {
    /// The recording has no window with enough points.
    #[error("{recording}: {points} points in {seconds:.1} s are too few to learn from")]
    TooFewPoints {
        /// The recording.
        recording: String,
        /// Number of points in it.
        points: usize,
        /// Its length, s.
        seconds: f64,
    },
    /// The board tracks nobody in the recording.
    #[error("{recording}: the board, which tracks people, tracks nobody in it")]
    Nobody {
        /// The recording.
        recording: String,
    },
    /// A name or sentence that cannot be kept.
    #[error("{what}: must have 1 to {max} characters, without line breaks")]
    Text {
        /// `name` or `says`.
        what: &'static str,
        /// Most characters.
        max: usize,
    },
    /// The recording is an example of this or another activity already.
    #[error("{recording} is an example of `{activity}` already")]
    Duplicate {
        /// The recording.
        recording: String,
        /// The activity that has it.
        activity: String,
    },
    /// Another process wrote the file since it was read.
    #[error(
        "{path}: another program changed this memory since it was read; read it again and teach once more, or write another \
         file"
    )]
    Changed {
        /// The file.
        path: String,
    },
    /// No activity of this name.
    #[error("nothing named `{name}` was taught{}", list_of(.known))]
    Unknown {
        /// The name.
        name: String,
        /// The names in the memory.
        known: Vec<String>,
    },
    /// A file that is no memory, or a damaged one.
    #[error("{path}: {problem}")]
    Invalid {
        /// The file.
        path: String,
        /// What is wrong.
        problem: String,
    },
    /// A file that cannot be read or written.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: String,
        /// Cause.
        source: std::io::Error,
    },
}

fn list_of(known: &[String]) -> String {
    match known.is_empty() {
        true => ": the memory is empty".into(),
        false => format!("; known are {}", known.join(", ")),
    }
}

/// Something about an example that the user should know. The example is taken all the same.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Warning {
    /// Other examples were recorded by another radar.
    #[error(
        "{recording} was recorded by radar `{found}`, other examples by `{expected}`: points of different boards differ, teach each board by itself"
    )]
    OtherRadar {
        /// The recording.
        recording: String,
        /// Its radar.
        found: String,
        /// Radar of the examples before.
        expected: String,
    },
    /// The sentence of an activity was replaced.
    #[error("`{name}` said \"{before}\" before")]
    OtherSentence {
        /// Name of the activity.
        name: String,
        /// The sentence before.
        before: String,
    },
    /// The points resemble another activity more than this one.
    #[error(
        "{recording} resembles `{other}` more than `{name}`: the examples may contradict each other"
    )]
    Contradiction {
        /// The recording.
        recording: String,
        /// Name of the activity.
        name: String,
        /// The activity that it resembles.
        other: String,
    },
    /// No other activity was taught by examples of this kind, events of a few seconds or what goes on for longer.
    #[error(
        "`{name}` is the only activity that was taught by such recordings, so that {what_happens}: teach also what else happens there, by three recordings each"
    )]
    OnlyActivity {
        /// Name of the activity.
        name: String,
        /// What comes of it.
        what_happens: &'static str,
    },
}

impl Default for Memory {
    fn default() -> Self {
        Self {
            format: FORMAT.into(),
            version: VERSION,
            activities: Vec::new(),
        }
    }
}

impl Memory {
    /// The activities, in the order in which they were taught.
    pub fn activities(&self) -> &[Taught] {
        &self.activities
    }

    /// Adds a clip as an example of an activity: at the model's frame rate, with every point that has a speed
    /// (`PreparedClip::moving` of `radarllm-inference`), as the clips in which it is to be recognised.
    ///
    /// # Errors
    /// Too few points, a board that tracks nobody in it, a text that cannot be kept, or a recording that is an example already. The memory is unchanged
    /// then.
    pub fn teach(
        &mut self,
        name: &str,
        says: &str,
        clip: &Clip,
    ) -> Result<Vec<Warning>, TeachError> {
        check_text("name", name, MAX_NAME)?;
        check_text("says", says, MAX_SAYS)?;
        let example = Example::of(clip)?;
        let duplicate =
            |taught: &&Taught| taught.examples.iter().any(|e| e.windows == example.windows);
        if let Some(taught) = self.activities.iter().find(duplicate) {
            return Err(TeachError::Duplicate {
                recording: example.source,
                activity: taught.name.clone(),
            });
        }
        let mut warnings = Vec::new();
        let mut others = self.activities.iter().flat_map(|a| &a.examples);
        if let Some(other) = others.find(|e| e.radar != example.radar) {
            warnings.push(Warning::OtherRadar {
                recording: example.source.clone(),
                found: example.radar.clone(),
                expected: other.radar.clone(),
            });
        }
        let index = match self.activities.iter().position(|a| a.name == name) {
            Some(index) => index,
            None => {
                self.activities.push(Taught {
                    name: name.into(),
                    says: says.into(),
                    examples: Vec::new(),
                });
                self.activities.len() - 1
            }
        };
        let taught = &mut self.activities[index];
        if taught.says != says {
            warnings.push(Warning::OtherSentence {
                name: name.into(),
                before: std::mem::replace(&mut taught.says, says.into()),
            });
        }
        taught.examples.push(example);
        Ok(warnings)
    }

    /// The activities and their examples without features, for lists.
    pub fn overview(&self) -> Vec<TaughtOverview<'_>> {
        let activities = self.activities.iter();
        activities
            .map(|a| TaughtOverview {
                name: &a.name,
                says: &a.says,
                examples: a.examples.iter().map(Example::overview).collect(),
            })
            .collect()
    }

    /// Forgets an activity.
    ///
    /// # Errors
    /// [`TeachError::Unknown`].
    pub fn forget(&mut self, name: &str) -> Result<Taught, TeachError> {
        match self.activities.iter().position(|a| a.name == name) {
            Some(index) => Ok(self.activities.remove(index)),
            None => Err(TeachError::Unknown {
                name: name.into(),
                known: self.activities.iter().map(|a| a.name.clone()).collect(),
            }),
        }
    }

    /// Reads a memory file.
    ///
    /// # Errors
    /// A file that cannot be read, or that is no memory.
    pub fn load(path: &Path) -> Result<Self, TeachError> {
        let invalid = |problem: String| TeachError::Invalid {
            path: path.display().to_string(),
            problem,
        };
        let text = bounded::read_text(path, MAX_BYTES).map_err(|e| invalid(e.to_string()))?;
        let memory: Self = serde_json::from_str(&text).map_err(|e| invalid(e.to_string()))?;
        memory.check().map_err(invalid)?;
        Ok(memory)
    }

    /// Reads a memory file, or begins an empty memory if there is none; changes it; and writes it. Other processes that
    /// change the file this way wait meanwhile, so that nobody's examples are lost. Nothing is written if `change` fails.
    ///
    /// # Errors
    /// Those of [`Self::load`], of [`Self::save`] and of `change`, and a file that cannot be locked.
    pub fn update<T, E: From<TeachError>>(
        path: &Path,
        change: impl FnOnce(&mut Self) -> Result<T, E>,
    ) -> Result<T, E> {
        let _lock = Lock::wait(path).map_err(|(path, source)| TeachError::Io {
            path: path.display().to_string(),
            source,
        })?;
        let mut memory = match path.exists() {
            true => Self::load(path)?,
            false => Self::default(),
        };
        let changed = change(&mut memory)?;
        memory.save(path)?;
        Ok(changed)
    }

    /// Writes the memory over the file that `read` was read from, if no other process has changed it since, so that
    /// nobody's examples are lost.
    ///
    /// # Errors
    /// [`TeachError::Changed`]; those of [`Self::save`], and a file that cannot be locked or read.
    pub fn save_over(&self, path: &Path, read: &Self) -> Result<(), TeachError> {
        let _lock = Lock::wait(path).map_err(|(path, source)| TeachError::Io {
            path: path.display().to_string(),
            source,
        })?;
        if path.exists() && Self::load(path)? != *read {
            return Err(TeachError::Changed {
                path: path.display().to_string(),
            });
        }
        self.save(path)
    }

    /// Writes the memory. The file is replaced as a whole or not at all. What another process wrote since it was read is
    /// replaced too: [`Self::update`] keeps it, and [`Self::save_over`] refuses.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn save(&self, path: &Path) -> Result<(), TeachError> {
        let io = |source| TeachError::Io {
            path: path.display().to_string(),
            source,
        };
        if let Some(folder) = path.parent().filter(|p| !p.as_os_str().is_empty()) {
            std::fs::create_dir_all(folder).map_err(io)?;
        }
        let text = serde_json::to_string(self).map_err(|e| io(e.into()))?;
        atomic::write_bytes(path, Existing::Replace, text.as_bytes())
            .map_err(|e| io(std::io::Error::other(e)))
    }

    /// The activities whose examples are short, or the others.
    pub(crate) fn of_length(&self, is_short: bool) -> Self {
        let mut part = self.clone();
        part.activities.retain(|a| a.is_short() == is_short);
        part
    }

    /// The memory without one example of an activity.
    pub(crate) fn without_example(&self, name: &str, index: usize) -> Self {
        let mut rest = self.clone();
        for taught in rest.activities.iter_mut().filter(|a| a.name == name) {
            taught.examples.remove(index);
        }
        rest
    }

    fn check(&self) -> Result<(), String> {
        if self.format != FORMAT {
            return Err(format!("format `{}`, expected `{FORMAT}`", self.format));
        }
        if self.version != VERSION {
            return Err(format!(
                "version {}, expected {VERSION}; delete it and teach the activities again",
                self.version
            ));
        }
        for (i, taught) in self.activities.iter().enumerate() {
            if self.activities[..i]
                .iter()
                .any(|other| other.name == taught.name)
            {
                return Err(format!("`{}` occurs twice", taught.name));
            }
            check_text("name", &taught.name, MAX_NAME).map_err(|e| e.to_string())?;
            check_text("says", &taught.says, MAX_SAYS).map_err(|e| e.to_string())?;
            for example in &taught.examples {
                let fits = |w: &Vec<f32>| w.len() == N_FEATURES && w.iter().all(|v| v.is_finite());
                if example.windows.is_empty() || !example.windows.iter().all(fits) {
                    return Err(format!(
                        "`{}`, {}: expected windows of {N_FEATURES} finite numbers",
                        taught.name, example.source
                    ));
                }
            }
        }
        Ok(())
    }
}

/// Examples with at most as many windows in the mean are short: they show single events.
const SHORT_WINDOWS: usize = 3;

impl Taught {
    /// Whether the examples are of a few seconds.
    pub(crate) fn is_short(&self) -> bool {
        let n_windows: usize = self.examples.iter().map(|e| e.windows.len()).sum();
        n_windows <= SHORT_WINDOWS * self.examples.len()
    }
}

impl Example {
    fn overview(&self) -> ExampleOverview<'_> {
        ExampleOverview {
            source: &self.source,
            radar: &self.radar,
            seconds: self.seconds,
            windows: self.windows.len(),
        }
    }

    fn of(clip: &Clip) -> Result<Self, TeachError> {
        let mut features: Vec<Vec<f32>> = windows(clip)
            .into_iter()
            .filter_map(|w| w.features)
            .collect();
        let source = clip.provenance.input().to_string();
        let mut reports = clip.frames.iter().flat_map(|frame| &frame.board).peekable();
        if reports.peek().is_some() && reports.all(|report| report.tracks.is_empty()) {
            return Err(TeachError::Nobody { recording: source });
        }
        if features.is_empty() {
            return Err(TeachError::TooFewPoints {
                recording: source,
                points: clip.n_points(),
                seconds: clip.duration_s(),
            });
        }
        if features.len() > MAX_WINDOWS {
            let n = features.len();
            features = (0..MAX_WINDOWS)
                .map(|i| features[i * n / MAX_WINDOWS].clone())
                .collect();
        }
        Ok(Self {
            source,
            radar: clip.radar.clone(),
            radar_height_m: clip.radar_height_m,
            seconds: clip.duration_s(),
            windows: features,
        })
    }
}

fn check_text(what: &'static str, text: &str, max: usize) -> Result<(), TeachError> {
    let n = text.chars().count();
    match (1..=max).contains(&n) && !text.chars().any(char::is_control) {
        true => Ok(()),
        false => Err(TeachError::Text { what, max }),
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use radarllm_base::BoardReport;
    use radarllm_base::{Clutter, PointFrame, Provenance, RadarPoint};

    use super::*;

    fn clip(source: &str, radar: &str, height_m: f32) -> Clip {
        let frame = |i: u32| PointFrame {
            frame: i,
            time_s: f64::from(i) / 10.0,
            points: vec![
                RadarPoint {
                    y_m: 2.0,
                    z_m: height_m + 0.001 * i as f32,
                    range_m: 2.0,
                    ..RadarPoint::default()
                };
                4
            ],
            board: None,
        };
        Clip {
            frames: (0..100).map(frame).collect(),
            frame_rate_hz: 10.0,
            radar_height_m: 1.0,
            is_height_assumed: false,
            radar: radar.into(),
            provenance: Provenance::recorded("csv", source),
            clutter: Clutter::Settled,
        }
    }

    fn taught() -> Memory {
        let mut memory = Memory::default();
        for (source, height_m) in [("a", 0.1), ("b", 0.12), ("c", 0.09)] {
            let warnings = memory.teach("sit", "a person sits", &clip(source, "isk", height_m));
            assert_eq!(warnings.unwrap(), []);
        }
        memory
    }

    #[test]
    fn a_memory_survives_its_file() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("new/memory.json");
        taught().save(&path).unwrap();
        assert_eq!(Memory::load(&path).unwrap(), taught());
    }

    #[test]
    fn a_file_that_another_process_changed_is_not_replaced() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("memory.json");
        let read = taught();
        read.save_over(&path, &Memory::default()).unwrap(); // There is no file yet.
        let mut ours = read.clone();
        ours.forget("sit").unwrap();
        Memory::default().save(&path).unwrap();
        let error = ours.save_over(&path, &read).unwrap_err();
        assert!(matches!(error, TeachError::Changed { .. }), "{error}");
        assert_eq!(Memory::load(&path).unwrap(), Memory::default());
        read.save(&path).unwrap();
        ours.save_over(&path, &read).unwrap();
        assert_eq!(Memory::load(&path).unwrap(), ours);
    }

    #[test]
    fn damaged_files_are_named() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("memory.json");
        let text = serde_json::to_string(&taught()).unwrap();
        for (damaged, expected) in [
            (text[..text.len() / 2].to_string(), "EOF"),
            (text.replace("radarllm memory", "other"), "format `other`"),
            (text.replace("\"version\":4", "\"version\":9"), "version 9"),
            (
                text.replace("\"windows\":[[", "\"windows\":[[1.0],["),
                "windows of 349",
            ),
            (text.replace("\"says\"", "\"sais\""), "sais"),
            ("[]".into(), "expected struct"),
        ] {
            fs::write(&path, &damaged).unwrap();
            let error = Memory::load(&path).unwrap_err().to_string();
            assert!(
                error.contains("memory.json") && error.contains(expected),
                "{error}"
            );
        }
    }

    #[test]
    fn what_cannot_be_learnt_leaves_the_memory_as_it_was() {
        let mut memory = taught();
        let before = memory.clone();
        let mut empty = clip("d", "isk", 0.1);
        empty.frames.iter_mut().for_each(|f| f.points.clear());
        let error = memory.teach("lie", "a person lies", &empty).unwrap_err();
        assert!(
            matches!(error, TeachError::TooFewPoints { points: 0, .. }),
            "{error}"
        );
        // Noise of an empty room before a board that tracks people.
        let mut noise = clip("d", "isk", 0.1);
        for frame in &mut noise.frames {
            frame.board = Some(BoardReport::default());
        }
        let error = memory.teach("lie", "a person lies", &noise).unwrap_err();
        assert!(matches!(error, TeachError::Nobody { .. }), "{error}");
        let error = memory
            .teach("lie", "a person lies", &clip("a", "isk", 0.1))
            .unwrap_err();
        assert!(matches!(error, TeachError::Duplicate { .. }), "{error}");
        for (name, says) in [("", "x"), ("x", ""), ("x", "two\nlines")] {
            let error = memory
                .teach(name, says, &clip("d", "isk", 0.2))
                .unwrap_err();
            assert!(matches!(error, TeachError::Text { .. }), "{error}");
        }
        let error = memory.forget("stand").unwrap_err().to_string();
        assert!(
            error.contains("`stand`") && error.contains("sit"),
            "{error}"
        );
        assert_eq!(memory, before);
        assert_eq!(memory.forget("sit").unwrap().examples.len(), 3);
        assert_eq!(memory.activities(), []);
    }

    #[test]
    fn another_radar_and_another_sentence_are_warned_about() {
        let mut memory = taught();
        let warnings = memory
            .teach("sit", "she sits", &clip("d", "ods", 0.15))
            .unwrap();
        assert!(
            matches!(warnings[0], Warning::OtherRadar { .. }),
            "{warnings:?}"
        );
        assert!(
            matches!(warnings[1], Warning::OtherSentence { .. }),
            "{warnings:?}"
        );
        assert_eq!(memory.activities()[0].says, "she sits");
    }

    #[test]
    fn examples_under_the_wrong_name_contradict() {
        let mut memory = taught();
        for (source, height_m) in [("d", -0.8), ("e", -0.82), ("f", -0.79)] {
            memory
                .teach("lie", "a person lies", &clip(source, "isk", height_m))
                .unwrap();
        }
        assert_eq!(memory.doubts(), []);
        let alone = |w: &Warning| matches!(w, Warning::OnlyActivity { name, .. } if name == "sit");
        assert!(matches!(&taught().doubts()[..], [one] if alone(one)));
        memory
            .teach("lie", "a person lies", &clip("g", "isk", 0.11))
            .unwrap();
        let found = memory.doubts();
        let wrong = |w: &Warning| matches!(w, Warning::Contradiction { recording, other, .. } if recording == "g" && other == "sit");
        assert!(found.iter().any(wrong), "{found:?}");
    }
}
