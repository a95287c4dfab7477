//! Clips and plans made from a counter: cheap, varied, reproducible.

use std::collections::BTreeMap;
use std::path::Path;

use radarllm_base::seed::derive_seed;
use radarllm_base::{PointFrame, RadarPoint};
use radarllm_dataset::{
    BuildOptions, BuildPlan, ClipRecord, DatasetError, ItemId, MOTION_FEATURE_DIM, Overwrite,
    PointsFile, PointsReader, SourceLicence, Split, read_points,
};

/// SplitMix64 by way of `derive_seed`.
pub struct Draw {
    seed: u64,
    n: u64,
}

impl Draw {
    pub fn new(seed: u64) -> Self {
        Self { seed, n: 0 }
    }

    pub fn u64(&mut self) -> u64 {
        self.n += 1;
        derive_seed(self.seed, &self.n.to_string())
    }

    pub fn below(&mut self, n: u64) -> u64 {
        self.u64() % n
    }

    /// Uniform in -1..1.
    pub fn f32(&mut self) -> f32 {
        (self.u64() >> 40) as f32 / (1_u64 << 23) as f32 - 1.0
    }
}

pub fn frames(draw: &mut Draw, n: u64) -> Vec<PointFrame> {
    (0..n as u32)
        .map(|frame| PointFrame {
            frame,
            time_s: f64::from(frame) * 0.1,
            points: (0..draw.below(5))
                .map(|_| RadarPoint {
                    x_m: draw.f32(),
                    y_m: 3.0 + draw.f32(),
                    z_m: draw.f32(),
                    range_m: 3.0 + draw.f32(),
                    velocity_mps: 2.0 * draw.f32(),
                    intensity_db: -60.0 + 20.0 * draw.f32(),
                })
                .collect(),
            board: None,
        })
        .collect()
}

pub fn clip(item: &ItemId) -> ClipRecord {
    let mut draw = Draw::new(derive_seed(7, &item.id));
    let n_poses = draw.below(4);
    ClipRecord {
        id: item.id.clone(),
        motion_id: item.id.split('#').next().unwrap().into(),
        group: item.group.clone(),
        split: item.split,
        action: ["walk", "fall", "wave"][draw.below(3) as usize].into(),
        captions: (0..1 + draw.below(3))
            .map(|i| format!("a person moves, caption {i} of {} é", item.id))
            .collect(),
        source: "procedural".into(),
        radar: "awr1843boost".into(),
        radar_height_m: 1.0,
        seed: draw.u64(),
        frames: {
            let n = draw.below(6);
            frames(&mut draw, n)
        },
        motion_fps: 20.0,
        joints: (0..n_poses)
            .map(|_| std::array::from_fn(|_| std::array::from_fn(|_| draw.f32())))
            .collect(),
        motion_features: (0..n_poses as usize * MOTION_FEATURE_DIM)
            .map(|_| draw.f32())
            .collect(),
        rotations6d: (0..n_poses)
            .map(|_| std::array::from_fn(|_| std::array::from_fn(|_| draw.f32())))
            .collect(),
        body_height_m: draw.f32().abs(),
    }
}

pub fn plan(n_items: usize) -> BuildPlan {
    BuildPlan {
        name: "test".into(),
        tool_version: "0".into(),
        arithmetic: "test".into(),
        radar: "awr1843boost".into(),
        frame_rate_hz: 10.0,
        seed: 7,
        config_toml: "variants = 2\n".into(),
        skipped: Vec::new(),
        licences: vec![SourceLicence {
            source: "procedural".into(),
            licence: "MIT OR Apache-2.0".into(),
            attribution: "made here".into(),
            synthetic: true,
        }],
        shard_size: 8,
        items: (0..n_items)
            .map(|i| {
                // Two variants of a motion share its group and therefore its split.
                let motion = i / 2;
                let split = [
                    Split::Train,
                    Split::Train,
                    Split::Train,
                    Split::Val,
                    Split::Test,
                ][motion % 5];
                ItemId {
                    id: format!("m{motion}#{}", i % 2),
                    group: format!("g{motion}"),
                    split,
                }
            })
            .collect(),
    }
}

pub fn options(threads: usize) -> BuildOptions {
    BuildOptions {
        threads,
        overwrite: Overwrite::Refuse,
        retry_failed: false,
    }
}

pub fn make(item: &ItemId) -> Result<ClipRecord, String> {
    Ok(clip(item))
}

/// Every file below `dir` with its bytes.
pub fn tree(dir: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut files = BTreeMap::new();
    let mut todo = vec![dir.to_path_buf()];
    while let Some(d) = todo.pop() {
        for entry in std::fs::read_dir(&d).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                todo.push(path);
            } else {
                let name = path
                    .strip_prefix(dir)
                    .unwrap()
                    .to_string_lossy()
                    .into_owned();
                files.insert(name, std::fs::read(&path).unwrap());
            }
        }
    }
    files
}

/// Reads a points file as a whole, and frame by frame, which must give the same.
pub fn read_both(path: &Path) -> Result<PointsFile, DatasetError> {
    let whole = read_points(path);
    let one_by_one = || -> Result<Option<PointsFile>, DatasetError> {
        let file = std::fs::File::open(path).map_err(|source| DatasetError::Io {
            path: path.into(),
            operation: "open",
            source,
        })?;
        let Some(mut reader) = PointsReader::open(file, path)? else {
            return Ok(None);
        };
        let mut frames = Vec::new();
        while let Some(frame) = reader.next_frame()? {
            frames.push(frame);
        }
        assert!((0.0..=1.0).contains(&reader.share_read()));
        let meta = reader.meta().clone();
        Ok(Some(PointsFile { meta, frames }))
    };
    match (&whole, one_by_one()) {
        (Ok(whole), Ok(Some(found))) => assert_eq!(&found, whole),
        // Without a frame rate or a number of frames, only the whole tells them.
        (_, Ok(None)) => {}
        (whole, found) => assert_eq!(whole.is_err(), found.is_err(), "{}", path.display()),
    }
    whole
}
