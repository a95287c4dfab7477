//! A pure function from (corpus item, variant, seed) to a [`ClipRecord`].

use glam::{Mat3, Quat};
use radarllm_base::{
    Motion, PointFrame, Pose, StaticCells, Timeline, seed::derive_seed, skeleton::N_JOINTS,
};
use radarllm_body::{
    features::humanml3d_features,
    mesh::{BodyModel, BodyShape, Build, pose_on_body},
    sample::{crop, resample},
};
use radarllm_dataset::record::{ClipRecord, Split};
use radarllm_radar_dsp::Detector;
use rand::{RngExt, SeedableRng, rngs::ChaCha8Rng};

use crate::{
    SynthError, Synthesizer,
    config::DatasetConfig,
    corpus::{Corpus, CorpusItem},
    placement::draw_placement,
    synthesizer::builtin_body,
};

/// Rate of stored joints and motion features, 1/s: that of HumanML3D.
pub const MOTION_FPS: f64 = 20.0;

/// Heights of the bodies that perform a data set's motions, m. The set is small because every body is
/// polygonised once and kept in memory.
const BODY_HEIGHTS_M: [f32; 4] = [1.58, 1.68, 1.78, 1.88];

/// Simulates one variant of one motion.
///
/// The result depends only on the arguments: the same call gives the same record in any process.
///
/// # Errors
/// A motion or a radar frame that cannot be computed, with the motion's id.
pub fn make_record(
    synthesizer: &mut Synthesizer,
    corpus: &dyn Corpus,
    item_idx: usize,
    variant: usize,
    config: &DatasetConfig,
) -> Result<ClipRecord, SynthError> {
    let item = &corpus.items()[item_idx];
    let id = format!("{}#{variant}", item.motion_id);
    let seed = derive_seed(config.seed, &id);
    let mut rng = ChaCha8Rng::seed_from_u64(derive_seed(seed, "choices"));

    let motion = corpus.motion(item_idx)?;
    let rate_hz = config.stored_rate_hz(synthesizer.radar())?;
    let longest_s = config.max_frames as f64 / rate_hz;
    let part_s = part_s(item, longest_s, config, seed);
    let motion = cut_window(&motion, item, part_s, &mut rng);
    let heights_m = config.body_heights_m.as_deref().unwrap_or(&BODY_HEIGHTS_M);
    let shape = BodyShape {
        height_m: heights_m[rng.random_range(0..heights_m.len())],
        build: [Build::Slim, Build::Average, Build::Heavy][rng.random_range(0..3)],
        facet_edge_m: config.facet_edge_m,
    };
    // From here on, the motion is that of the body: a taller body walks a longer path, which changes the placement,
    // the joints and the features.
    let motion = motion_on_body(&motion, builtin_body(shape)?.as_ref());
    let placement = draw_placement(&motion, &config.placement(), derive_seed(seed, "placement"));
    let max_frames = synthesizer.radar().frames_in(longest_s);
    let objects = config.objects.as_ref().map(|objects| {
        let height_m = f64::from(placement.radar_height_m);
        objects.draw(height_m, derive_seed(seed, "objects"))
    });
    let [low_db, high_db] = config.threshold_offset_db;
    if config.threshold_offset_db != [0.0, 0.0] {
        let mut rng = ChaCha8Rng::seed_from_u64(derive_seed(seed, "threshold"));
        let offset_db = low_db + (high_db - low_db) * rng.random::<f64>();
        let mut dsp = config.processing.resolve(synthesizer.radar());
        if let Detector::LogCfar { threshold_db, .. } = &mut dsp.detector {
            *threshold_db += offset_db;
        }
        if let Some(cfar) = &mut dsp.doppler_cfar {
            cfar.threshold_db += offset_db;
        }
        synthesizer.set_processing(dsp)?;
    }
    synthesizer.set_objects(objects.unwrap_or_default())?;
    let frames = synthesizer.motion_to_points(&motion, shape, placement, max_frames, seed)?;
    let frames = stored_frames(frames, synthesizer.radar().frame_rate_hz(), config, rate_hz)?;

    let at_20_fps = resample(&motion, MOTION_FPS).map_err(|e| SynthError::Config(e.to_string()))?;
    let radar_from_world = placement.radar_from_world_rotation();
    let rotations6d = at_20_fps
        .poses
        .iter()
        .map(|pose| rotations6d(pose, radar_from_world))
        .collect();
    let joints = at_20_fps
        .joints_in_world()
        .iter()
        .map(|pose| pose.map(|joint| placement.radar_from_world(joint).to_array()))
        .collect();
    Ok(ClipRecord {
        id,
        motion_id: item.motion_id.clone(),
        group: item.group.clone(),
        split: item.split,
        action: item.action.clone(),
        captions: item.captions.clone(),
        source: corpus.name().into(),
        radar: synthesizer.radar().name.clone(),
        radar_height_m: placement.radar_height_m,
        seed,
        frames,
        motion_fps: MOTION_FPS as f32,
        joints,
        motion_features: humanml3d_features(&motion),
        rotations6d,
        body_height_m: shape.height_m,
    })
}

/// The first two columns of every joint's rotation matrix, that of the pelvis in the axes of the radar.
fn rotations6d(pose: &Pose, radar_from_world: Quat) -> [[f32; 6]; N_JOINTS] {
    std::array::from_fn(|joint| {
        let rotation = match joint {
            0 => radar_from_world * pose.rotations[0],
            _ => pose.rotations[joint],
        };
        let matrix = Mat3::from_quat(rotation);
        let (x, y) = (matrix.x_axis, matrix.y_axis);
        [x.x, x.y, x.z, y.x, y.y, y.z]
    })
}

/// The stored frames: moving points, at the stored rate, the strongest first.
fn stored_frames(
    mut frames: Vec<PointFrame>,
    radar_hz: f64,
    config: &DatasetConfig,
    rate_hz: f64,
) -> Result<Vec<PointFrame>, SynthError> {
    if config.remove_static_cells {
        StaticCells::of(&frames).remove(&mut frames);
    }
    if config.slowest_mps > 0.0 {
        for frame in &mut frames {
            frame.remove_slower_than(config.slowest_mps);
        }
    }
    if config.frame_rate_hz.is_none() {
        return Ok(frames);
    }
    let radar = Timeline::from_frames(frames, radar_hz);
    let mut frames = radar
        .resample(rate_hz, false)
        .map_err(|e| SynthError::Config(format!("frame_rate_hz: {e}")))?
        .frames;
    // The end of the last frame may be nearer to one more frame.
    frames.truncate(config.max_frames);
    frames.iter_mut().for_each(PointFrame::sort_by_intensity);
    Ok(frames)
}

/// Retargets a motion to a body: the same rotations on the body's bones.
fn motion_on_body(motion: &Motion, body: &dyn BodyModel) -> Motion {
    Motion {
        fps: motion.fps,
        skeleton: body.skeleton().clone(),
        poses: motion
            .poses
            .iter()
            .map(|pose| pose_on_body(pose, &motion.skeleton, body))
            .collect(),
    }
}

/// Longest part of a motion that becomes a clip, s.
fn part_s(item: &CorpusItem, longest_s: f64, config: &DatasetConfig, seed: u64) -> f64 {
    match config.shortest_part_s {
        Some(shortest_s) if item.is_continuous && item.split == Split::Train => {
            let mut rng = ChaCha8Rng::seed_from_u64(derive_seed(seed, "length"));
            shortest_s + rng.random::<f64>() * (longest_s - shortest_s).max(0.0)
        }
        _ => longest_s,
    }
}

/// No more than `max_s` of a motion: a randomly drawn window for training, the beginning otherwise.
fn cut_window(motion: &Motion, item: &CorpusItem, max_s: f64, rng: &mut ChaCha8Rng) -> Motion {
    let spare_s = motion.duration_s() - max_s;
    let share = rng.random::<f64>();
    if spare_s <= 0.0 {
        return motion.clone();
    }
    let start_s = if item.split == Split::Train {
        share * spare_s
    } else {
        0.0
    };
    let mut window = crop(motion, start_s, start_s + max_s);
    radarllm_body::sample::canonicalize(&mut window);
    window
}
