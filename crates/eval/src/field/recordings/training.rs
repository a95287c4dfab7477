//! A data set of recorded radar, with the sentences of the recorded activities or with those of a model.
//!
//! A model that learns from recordings is no longer zero-shot. Two questions need such a data set: what would labelled
//! recordings of a board add, and does a model gain from its own sentences about recordings without labels?

use std::{collections::HashMap, convert::Infallible, path::Path};

use radarllm_base::{Clip, PointFrame, hash::Fnv1a, seed::derive_seed};
use radarllm_dataset::{
    BuildOptions, BuildPlan, BuildReport, Builder, ClipRecord, DatasetError, ItemId, Overwrite,
    RECORDINGS, SourceLicence, Split, builder::no_recipe,
};
use radarllm_inference::{Segment, lm::WINDOWS};

use super::{LabelledRecording, RecordingsConfig, Role, file_of};
use crate::EvalError;

/// One in so many recordings is for validation.
const VALIDATION: u64 = 10;
/// Shorter stretches are left out, frames.
const SHORTEST: usize = 20;
/// Clips in a shard.
const SHARD_CLIPS: usize = 256;

/// A stretch of a recording, and what is said of all of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Stretch {
    /// First frame.
    pub start: usize,
    /// Frame after the last one.
    pub end: usize,
    /// The sentence.
    pub caption: String,
}

/// The sentence by which the activity of a recording is taught, for all of it.
///
/// # Errors
/// An activity without `says`.
pub fn by_activity(
    config: &RecordingsConfig,
    recording: &LabelledRecording,
) -> Result<Vec<Stretch>, EvalError> {
    let mut own = config.activity.iter();
    let own = own.find(|a| a.name == recording.activity);
    let says = own.and_then(|activity| {
        let side = config.side_of(activity, &recording.name);
        let of_side = side.and_then(|side| activity.says_of_side.get(&side));
        of_side.or(activity.says.as_ref()).cloned()
    });
    let says = says.ok_or_else(|| {
        let problem = format!("activity `{}`: no `says`", recording.activity);
        EvalError::Config(problem)
    })?;
    Ok(vec![Stretch {
        start: 0,
        end: recording.clip.frames.len(),
        caption: says,
    }])
}

/// The sentences of a model's description that it was certain enough of.
pub fn by_model(clip: &Clip, segments: &[Segment], min_confidence: f32) -> Vec<Stretch> {
    let start_s = clip.frames.first().map_or(0.0, |frame| frame.time_s);
    let frame = |time_s: f64| {
        let frames = ((time_s - start_s) * clip.frame_rate_hz).round();
        (frames.max(0.0) as usize).min(clip.frames.len())
    };
    let certain = segments
        .iter()
        .filter(|s| s.confidence >= min_confidence && s.guess.is_none() && s.taught.is_none());
    certain
        .map(|s| Stretch {
            start: frame(s.start_s),
            end: frame(s.end_s),
            caption: s.caption.clone(),
        })
        .filter(|stretch| stretch.start + SHORTEST <= stretch.end)
        .collect()
}

/// The clips of a recording: windows as `describe` cuts them that lie in one stretch, or the whole of a shorter stretch.
/// Empty if nobody is seen.
pub fn clips(recording: &LabelledRecording, stretches: &[Stretch]) -> Vec<ClipRecord> {
    let mut all = Vec::new();
    let mut add = |start: usize, end: usize, caption: &str| {
        let frames = &recording.clip.frames[start..end];
        if frames.iter().any(|frame| !frame.points.is_empty()) {
            all.push(record(recording, start, frames, caption));
        }
    };
    for stretch in stretches {
        let n_frames = stretch.end - stretch.start;
        if (SHORTEST..WINDOWS[0].0).contains(&n_frames) {
            add(stretch.start, stretch.end, &stretch.caption);
        }
        for (length, every) in WINDOWS {
            let starts = (stretch.start..stretch.end).step_by(every);
            for start in starts.filter(|start| start + length <= stretch.end) {
                add(start, start + length, &stretch.caption);
            }
        }
    }
    all
}

fn record(
    recording: &LabelledRecording,
    start: usize,
    frames: &[PointFrame],
    caption: &str,
) -> ClipRecord {
    // Parts of one recording are of one group.
    let (name, group) = (&recording.name, file_of(&recording.name));
    let split = match derive_seed(1, group).is_multiple_of(VALIDATION) {
        true => Split::Val,
        false => Split::Train,
    };
    let motion_id = format!("{name}@{start}+{}", frames.len());
    let seed = derive_seed(1, &motion_id);
    ClipRecord {
        id: format!("{motion_id}#0"),
        motion_id,
        group: group.into(),
        split,
        action: recording.activity.clone(),
        captions: vec![caption.into()],
        source: RECORDINGS.into(),
        radar: recording.clip.radar.clone(),
        radar_height_m: recording.clip.radar_height_m,
        seed,
        frames: frames.to_vec(),
        motion_fps: 20.0,
        joints: Vec::new(),
        motion_features: Vec::new(),
        rotations6d: Vec::new(),
        body_height_m: 0.0,
    }
}

/// Writes the clips of recordings for tuning as a data set. `sentences` says where the captions come from, for the card.
///
/// # Errors
/// No clips; a folder with another data set, unless it is to be replaced; a file system error.
pub fn write(
    out: &Path,
    clips: Vec<ClipRecord>,
    frame_rate_hz: f64,
    sentences: &str,
    overwrite: Overwrite,
) -> Result<BuildReport, DatasetError> {
    let Some(first) = clips.first() else {
        let problem = "no stretch of the recordings has a sentence".into();
        return Err(DatasetError::Plan { problem });
    };
    let items = clips.iter().map(|clip| ItemId {
        id: clip.id.clone(),
        group: clip.group.clone(),
        split: clip.split,
    });
    // The points are in no configuration, so that the plan tells other recordings apart by a hash.
    let table: toml::Table = [
        ("sentences", sentences.to_owned()),
        ("role", Role::Tuning.name().into()),
        ("content", format!("{:016x}", hash(&clips))),
    ]
    .map(|(key, value)| (key.to_owned(), toml::Value::String(value)))
    .into_iter()
    .collect();
    let plan = BuildPlan {
        name: RECORDINGS.into(),
        tool_version: env!("CARGO_PKG_VERSION").into(),
        arithmetic: "none".into(),
        radar: first.radar.clone(),
        frame_rate_hz,
        seed: 0,
        config_toml: table.to_string(),
        licences: vec![SourceLicence {
            source: RECORDINGS.into(),
            licence: "that of the recordings".into(),
            attribution: sentences.into(),
            synthetic: false,
        }],
        skipped: Vec::new(),
        shard_size: SHARD_CLIPS,
        items: items.collect(),
    };
    let options = BuildOptions {
        threads: 1,
        overwrite,
        retry_failed: false,
    };
    let by_id: HashMap<&str, &ClipRecord> = clips.iter().map(|c| (c.id.as_str(), c)).collect();
    let make = |item: &ItemId| Ok::<_, Infallible>(by_id[item.id.as_str()].clone());
    let builder = Builder::new(plan)?;
    builder.build(out, options, &no_recipe, make, |_| (), &|| false)
}

fn hash(clips: &[ClipRecord]) -> u64 {
    let mut hash = Fnv1a::new();
    for clip in clips {
        hash.write(clip.id.as_bytes());
        hash.write(clip.captions[0].as_bytes());
        hash.write(clip.radar.as_bytes());
        hash.write(&clip.seed.to_le_bytes());
        hash.write(&clip.radar_height_m.to_le_bytes());
        for frame in &clip.frames {
            hash.write(&frame.time_s.to_le_bytes());
            for p in &frame.points {
                for value in [p.x_m, p.y_m, p.z_m, p.velocity_mps, p.intensity_db] {
                    hash.write(&value.to_le_bytes());
                }
            }
        }
    }
    hash.finish()
}

#[cfg(test)]
mod tests {
    use radarllm_base::{Clutter, Provenance, RadarPoint};
    use radarllm_dataset::{Columns, Dataset};
    use radarllm_inference::{PrepareOptions, PreparedClip, prepare_for_model};

    use super::*;

    fn prepared(clip: Clip) -> PreparedClip<'static> {
        let prepared = prepare_for_model(clip, &PrepareOptions::default());
        prepared.unwrap().clip
    }

    fn recording(name: &str, n_frames: usize) -> LabelledRecording {
        let frame = |i: usize| PointFrame {
            frame: i as u32,
            time_s: 3.0 + i as f64 / 10.0,
            points: vec![RadarPoint {
                x_m: 1.0,
                ..Default::default()
            }],
            board: None,
        };
        let clip = Clip {
            frames: (0..n_frames).map(frame).collect(),
            frame_rate_hz: 10.0,
            radar_height_m: 1.2,
            is_height_assumed: false,
            radar: "board".into(),
            provenance: Provenance::recorded("csv", name),
            clutter: Clutter::Settled,
        };
        LabelledRecording {
            name: name.into(),
            activity: "walk".into(),
            clip: prepared(clip),
        }
    }

    fn stretch(start: usize, end: usize) -> Stretch {
        Stretch {
            start,
            end,
            caption: "a person walks".into(),
        }
    }

    #[test]
    fn recordings_of_a_side_and_their_parts_have_the_sentence_of_the_side() {
        let config = RecordingsConfig::from_toml(
            "radar_height_m = 1.0\nroles = { tuning = [] }\n[[activity]]\nname = \"walk\"\nactions = [\"walk\"]\nsays = \"a person turns\"\n\
             sides = { left = [\"*/l.csv\"], right = [\"*/r.csv\"] }\n\
             says_of_side = { left = \"a person turns left\" }\n",
        )
        .unwrap();
        let said = |name: &str| {
            let stretches = by_activity(&config, &recording(name, 30)).unwrap();
            assert_eq!((stretches[0].start, stretches[0].end), (0, 30));
            stretches[0].caption.clone()
        };
        for name in ["walk/l.csv", "walk/l.csv from 19 s"] {
            assert_eq!(said(name), "a person turns left");
        }
        for name in ["walk/r.csv", "walk/other.csv"] {
            assert_eq!(said(name), "a person turns");
        }
        let mut unsaid = config.clone();
        unsaid.activity[0].says = None;
        let error = by_activity(&unsaid, &recording("walk/r.csv", 30)).unwrap_err();
        assert!(error.to_string().contains("no `says`"), "{error}");
    }

    #[test]
    fn only_certain_sentences_of_the_model_become_captions() {
        let clip = recording("a", 100).clip;
        let segment = |start_s: f64, end_s: f64, confidence: f32| Segment {
            start_s,
            end_s,
            caption: "a person walks".into(),
            actions: vec!["walk"],
            confidence,
            side_confidence: None,
            taught: None,
            guess: None,
        };
        let segments = [
            segment(3.0, 7.0, 0.6),
            segment(7.0, 9.0, 0.59),
            // A sentence that was withheld, and one of a taught activity.
            Segment {
                guess: Some("a person runs".into()),
                ..segment(3.0, 7.0, 0.9)
            },
            Segment {
                taught: Some("ours".into()),
                ..segment(3.0, 7.0, 0.9)
            },
            // Shorter than the shortest clip; and beyond the end of the recording.
            segment(3.0, 4.9, 0.9),
            segment(9.0, 99.0, 0.9),
        ];
        assert_eq!(
            by_model(&clip, &segments, 0.6),
            [stretch(0, 40), stretch(60, 100)]
        );
    }

    #[test]
    fn windows_lie_in_their_stretch() {
        let own = recording("a", 200);
        let places = |stretches: &[Stretch]| -> Vec<(u32, usize)> {
            let all = clips(&own, stretches);
            all.iter()
                .map(|c| (c.frames[0].frame, c.frames.len()))
                .collect()
        };
        assert_eq!(places(&[stretch(40, 80)]), [(40, 40)]);
        assert_eq!(places(&[stretch(40, 59)]), []);
        assert_eq!(
            places(&[stretch(40, 145)]),
            [(40, 60), (60, 60), (80, 60), (40, 96)]
        );
        let mut empty = own.clip.clone().into_clip();
        for frame in &mut empty.frames {
            frame.points.clear();
        }
        let nobody = LabelledRecording {
            clip: prepared(empty),
            ..own
        };
        assert_eq!(clips(&nobody, &[stretch(0, 200)]), []);
    }

    #[test]
    fn the_data_set_is_read_back_with_parts_of_a_recording_in_one_split() {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("data");
        let names: Vec<String> = (0..30)
            .flat_map(|i| [format!("r{i} from 0 s"), format!("r{i} from 19 s")])
            .collect();
        let of = |names: &[String]| -> Vec<ClipRecord> {
            let all = names.iter().map(|name| recording(name, 60));
            all.flat_map(|r| clips(&r, &[stretch(0, 60)])).collect()
        };
        let save = |names: &[String], overwrite| {
            write(
                &out,
                of(names),
                10.0,
                "sentences of the activities",
                overwrite,
            )
        };
        let report = save(&names, Overwrite::Refuse).unwrap();
        assert_eq!(report.manifest.n_clips, 60);
        assert!(!report.manifest.licences[0].synthetic);
        let data = Dataset::open(&out).unwrap();
        let mut seen = Vec::new();
        for split in Split::ALL {
            for clip in data.iter_split(split, Columns::All) {
                let clip = clip.unwrap();
                assert_eq!(clip.split, split);
                seen.push(clip);
            }
        }
        assert!(data.n_clips(Split::Val) > 0 && data.n_clips(Split::Test) == 0);
        seen.sort_by(|a, b| a.id.cmp(&b.id));
        let mut all = of(&names);
        all.sort_by(|a, b| a.id.cmp(&b.id));
        assert_eq!(seen, all);
        assert!(all.chunks(2).all(|parts| parts[0].split == parts[1].split));
        // Other recordings are another data set, and none are none.
        assert!(save(&names[..2], Overwrite::Refuse).is_err());
        let mut higher = of(&names);
        higher.iter_mut().for_each(|clip| clip.radar_height_m = 1.5);
        let sentences = "sentences of the activities";
        assert!(write(&out, higher, 10.0, sentences, Overwrite::Refuse).is_err());
        let few = save(&names[..2], Overwrite::Replace).unwrap();
        assert_eq!(few.manifest.n_clips, 2);
        let error = save(&[], Overwrite::Replace).unwrap_err().to_string();
        assert!(error.contains("no stretch"), "{error}");
    }
}
