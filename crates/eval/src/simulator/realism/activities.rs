//! Recordings without joints: what was done is known, not how. Built-in motions stand in, and a
//! classifier trained on them is tested on the recordings (RadHAR).

use std::{fs, path::Path};

use radarllm_base::{PointFrame, seed::derive_seed};
use radarllm_formats::read_radhar_points;
use radarllm_synth::{
    SynthError,
    placement::{PlacementRange, draw_placement},
    synthesizer::builtin_shape,
};
use serde::{Deserialize, Serialize};

use super::compare::{ClassifierResult, Clip, DistributionRow, distributions, transfer};
use super::{RealismConfig, RealismError, read_text, replay::for_each_job};

/// What was done, and the built-in motions that show it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Activity {
    /// Folder of the recordings.
    pub name: String,
    /// `builtin:NAME?key=value`, taken in turn.
    pub motions: Vec<String>,
}

/// The `[activities]` table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Activities {
    /// Classes.
    pub activity: Vec<Activity>,
    /// Simulated clips of each.
    pub clips: usize,
    /// Where people stand: distance, m.
    pub distance_m: [f32; 2],
    /// Sideways, m, +- this.
    pub lateral_m: f32,
    /// Heading, degrees, +- this.
    pub heading_deg: f32,
    /// Height of the radar above the floor, m.
    pub radar_height_m: f32,
    /// Points slower than this are left out on both sides, m/s: the recordings' rooms are unknown.
    pub slowest_mps: f32,
}

impl Default for Activities {
    fn default() -> Self {
        Self {
            activity: Vec::new(),
            clips: 16,
            distance_m: [1.3, 2.0],
            lateral_m: 0.2,
            heading_deg: 15.0,
            radar_height_m: 1.0,
            slowest_mps: 0.1,
        }
    }
}

/// What became of it.
#[derive(Clone, Debug, Serialize)]
pub struct ActivityReport {
    /// Classes, in the order of the confusion table.
    pub activities: Vec<String>,
    /// Recordings of each.
    pub recordings: Vec<usize>,
    /// Recorded and simulated frames.
    pub frames: [usize; 2],
    /// Distributions of the moving points.
    pub distributions: Vec<DistributionRow>,
    /// Each half of the recordings is tested by classifiers trained on the other half, or on the
    /// simulated clips.
    pub classifier: Option<ClassifierResult>,
}

/// Simulates the activities of `table` and compares them with the recordings in `folder/NAME/*.txt`.
///
/// # Errors
/// Unreadable recordings, motions that do not exist, or whatever the chain refuses.
pub fn compare_activities(
    config: &RealismConfig,
    table: &Activities,
    base: &Path,
    folder: &Path,
) -> Result<ActivityReport, RealismError> {
    let mut recorded = Vec::new();
    let mut recordings = Vec::new();
    for (class, activity) in table.activity.iter().enumerate() {
        let clips = read_recordings(&folder.join(&activity.name), class)?;
        recordings.push(clips.len());
        recorded.extend(clips);
    }
    let mut simulated = simulate(config, table, base)?;
    for frame in recorded
        .iter_mut()
        .chain(&mut simulated)
        .flat_map(|c| &mut c.frames)
    {
        config.crop(frame);
        frame
            .points
            .retain(|p| p.velocity_mps.abs() >= table.slowest_mps);
    }
    let frames = |clips: &[Clip], keep: &dyn Fn(&Clip) -> bool| -> Vec<PointFrame> {
        clips
            .iter()
            .filter(|c| keep(c))
            .flat_map(|c| c.frames.iter().cloned())
            .collect()
    };
    let all_recorded = frames(&recorded, &|_| true);
    let all_simulated = frames(&simulated, &|_| true);
    let halves = [0, 1].map(|half| frames(&recorded, &|c| c.group == half));
    Ok(ActivityReport {
        activities: table.activity.iter().map(|a| a.name.clone()).collect(),
        recordings,
        frames: [all_recorded.len(), all_simulated.len()],
        distributions: distributions([&all_recorded, &all_simulated, &halves[0], &halves[1]]),
        classifier: transfer(config, &recorded, &simulated),
    })
}

/// Recordings of one activity; every second one belongs to the other half.
fn read_recordings(folder: &Path, class: usize) -> Result<Vec<Clip>, RealismError> {
    let mut files: Vec<_> = fs::read_dir(folder)
        .map_err(|e| RealismError::io(folder, &e))?
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| path.extension().is_some_and(|e| e == "txt"))
        .collect();
    files.sort();
    let mut clips = Vec::new();
    for file in files {
        let wrong = |problem: String| RealismError::File {
            file: file.display().to_string(),
            problem,
        };
        let frames = read_radhar_points(&read_text(&file)?)
            .map_err(|e| wrong(e.to_string()))?
            .into_iter()
            .enumerate()
            .map(|(i, frame)| PointFrame {
                frame: i as u32,
                time_s: frame.stamp_s.unwrap_or_default(),
                points: frame.points,
                board: None,
            })
            .collect();
        clips.push(Clip {
            group: clips.len() % 2,
            class,
            frames,
        });
    }
    Ok(clips)
}

fn simulate(
    config: &RealismConfig,
    table: &Activities,
    base: &Path,
) -> Result<Vec<Clip>, RealismError> {
    let jobs: Vec<(usize, usize)> = (0..table.activity.len())
        .flat_map(|class| (0..table.clips).map(move |clip| (class, clip)))
        .collect();
    let range = PlacementRange {
        distance_m: table.distance_m,
        lateral_m: table.lateral_m,
        heading_rad: table.heading_deg.to_radians(),
        radar_height_m: table.radar_height_m,
    };
    for_each_job(config, base, jobs.len(), |chain, _, i| {
        let (class, clip) = jobs[i];
        let activity = &table.activity[class];
        let name = &activity.motions[clip % activity.motions.len()];
        let seed = derive_seed(config.seed, &format!("{}-{clip:06}", activity.name));
        let request = radarllm_motions::parse(name)
            .map_err(|e| RealismError::Synth(SynthError::Config(format!("{name}: {e}"))))?;
        let rendered = request.render(seed);
        let placement = draw_placement(&rendered.motion, &range, derive_seed(seed, "place"));
        let mut frames = chain.motion_to_points(
            &rendered.motion,
            builtin_shape(&rendered),
            placement,
            usize::MAX,
            seed,
        )?;
        super::replay::lift(&mut frames, config.elevation_bias);
        Ok(Clip {
            group: clip % 2,
            class,
            frames,
        })
    })
}
