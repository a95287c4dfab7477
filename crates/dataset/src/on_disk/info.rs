//! Statistics of a data set.

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;

use super::shard::{ClipSummary, read_summaries};
use crate::{Dataset, DatasetError, SourceLicence};

/// Summary of a data set.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Info {
    /// Name.
    pub name: String,
    /// Radar name.
    pub radar: String,
    /// Radar frames per second.
    pub frame_rate_hz: f64,
    /// Data set seed.
    pub seed: u64,
    /// Version of the program that built the data set.
    pub tool_version: String,
    /// Hash of the configuration.
    pub config_blake3: String,
    /// Number of shards.
    pub n_shards: usize,
    /// Size of all shards, bytes.
    pub bytes: u64,
    /// Number of items that could not be generated.
    pub failed: u64,
    /// Counts of the whole data set.
    pub total: Counts,
    /// Counts by split name.
    pub splits: BTreeMap<String, Counts>,
    /// Number of clips by action label.
    pub actions: BTreeMap<String, u64>,
    /// Number of clips by source.
    pub sources: BTreeMap<String, u64>,
    /// Licences by source.
    pub licences: Vec<SourceLicence>,
}

/// Counts over a set of clips.
#[derive(Clone, Debug, PartialEq, Default, Serialize)]
pub struct Counts {
    /// Number of clips.
    pub clips: u64,
    /// Number of distinct motions.
    pub motions: u64,
    /// Total radar time, hours.
    pub hours: f64,
    /// Number of radar frames.
    pub frames: u64,
    /// Number of radar points.
    pub points: u64,
    /// Mean number of points per frame; 0 if there are no frames.
    pub points_per_frame: f64,
    /// Number of captions, including repetitions.
    pub captions: u64,
    /// Number of distinct captions.
    pub distinct_captions: u64,
    /// Mean number of whitespace-separated words per caption; 0 if there are no captions.
    pub words_per_caption: f64,
    /// Number of distinct lower-cased words.
    pub vocabulary: u64,
}

impl Dataset {
    /// Computes all statistics. Reads ids, captions and counts of all shards, but no points.
    ///
    /// # Errors
    /// Unreadable shards.
    pub fn info(&self) -> Result<Info, DatasetError> {
        let manifest = self.manifest();
        let mut total = Counter::default();
        let mut splits: BTreeMap<String, Counter> = BTreeMap::new();
        let mut actions: BTreeMap<String, u64> = BTreeMap::new();
        let mut sources: BTreeMap<String, u64> = BTreeMap::new();
        for shard in &manifest.shards {
            for clip in read_summaries(&shard.path(self.dir()))? {
                total.add(&clip);
                splits
                    .entry(clip.split.name().into())
                    .or_default()
                    .add(&clip);
                *actions.entry(clip.action).or_default() += 1;
                *sources.entry(clip.source).or_default() += 1;
            }
        }
        Ok(Info {
            name: manifest.name.clone(),
            radar: manifest.radar.clone(),
            frame_rate_hz: manifest.frame_rate_hz,
            seed: manifest.seed,
            tool_version: manifest.tool_version.clone(),
            config_blake3: manifest.config_blake3.clone(),
            n_shards: manifest.shards.len(),
            bytes: manifest.shards.iter().map(|s| s.bytes).sum(),
            failed: manifest.n_failed,
            total: total.finish(),
            splits: splits
                .into_iter()
                .map(|(name, c)| (name, c.finish()))
                .collect(),
            actions,
            sources,
            licences: manifest.licences.clone(),
        })
    }
}

#[derive(Default)]
struct Counter {
    counts: Counts,
    seconds: f64,
    n_words: u64,
    motions: BTreeSet<String>,
    captions: BTreeSet<String>,
    words: BTreeSet<String>,
}

impl Counter {
    fn add(&mut self, clip: &ClipSummary) {
        self.counts.clips += 1;
        self.counts.frames += u64::from(clip.n_frames);
        self.counts.points += u64::from(clip.n_points);
        self.seconds += f64::from(clip.duration_s);
        self.motions.insert(clip.motion_id.clone());
        for caption in &clip.captions {
            self.counts.captions += 1;
            for word in caption.split_whitespace() {
                self.n_words += 1;
                let word = word
                    .trim_matches(|c: char| c.is_ascii_punctuation())
                    .to_lowercase();
                if !word.is_empty() {
                    self.words.insert(word);
                }
            }
            if !self.captions.contains(caption) {
                self.captions.insert(caption.clone());
            }
        }
    }

    fn finish(self) -> Counts {
        let ratio = |a: u64, b: u64| if b == 0 { 0.0 } else { a as f64 / b as f64 };
        Counts {
            motions: self.motions.len() as u64,
            hours: self.seconds / 3600.0,
            points_per_frame: ratio(self.counts.points, self.counts.frames),
            distinct_captions: self.captions.len() as u64,
            words_per_caption: ratio(self.n_words, self.counts.captions),
            vocabulary: self.words.len() as u64,
            ..self.counts
        }
    }
}
