//! `baselines render`: videos of bodies, and prompts, for video language models elsewhere.

use std::{
    fs,
    path::{Path, PathBuf},
};

use clap::{Args, ValueEnum};
use glam::Vec3;
use radarllm_base::{Motion, Pose};
use radarllm_body::{
    canonical_skeleton,
    mesh::{BodyModel, BodyShape, BuiltinBody},
    proportions::standing_height_m,
    sample::resample,
};
use radarllm_dataset::{ClipRecord, Columns, Dataset};
use radarllm_eval::{captions::one_of_each_motion, pose_table::pose_at};
use radarllm_render::{
    avi::Video,
    raster::{Camera, Image, Scene, Shading},
};
use rayon::prelude::*;

use super::{
    estimated,
    prompts::{
        FrameKind, PROMPTS_FILE, Prompt, RENDER_FILE, Render, file_name_of, frame_name, hash_of,
        hash_of_all,
    },
};
use crate::{
    commands::eval::captions::split,
    error::{CliError, CliResult},
    output,
};

/// What video models are asked, one prompt for all.
const PROMPT: &str =
    "The video shows one person. Describe in one short sentence what the person does.";
/// Pixels of a side: what CLIP ViT-L/14-336 takes without scaling.
const SIZE: usize = 336;
/// Frames per second, the rate of the motions of a data set.
const FPS: u32 = 20;
/// Longest edge of the mesh, m.
const EDGE_M: f32 = 0.05;
/// Colour of the body.
const GREY: Vec3 = Vec3::new(0.62, 0.62, 0.64);
/// Half of what a camera sees at the person, m.
const HALF_VIEW_M: f32 = 1.35;
/// Half of the side of the floor grid, m: farther than a radar sees a person.
const FLOOR_M: f32 = 12.0;
/// Heights of bodies that are drawn, m. An estimate outside is drawn as the nearest one.
const HEIGHTS_M: [f32; 2] = [1.0, 2.0];

/// `baselines render`.
#[derive(Args)]
pub(crate) struct RenderArgs {
    /// Data set folder.
    pub data: PathBuf,
    /// Split to show.
    #[arg(long, default_value = "test")]
    pub split: String,
    /// Checkpoint of a pose network (`best` or `final` of `radarllm train pose`), which estimates the bodies from the points.
    #[arg(long, value_name = "DIR", required_unless_present = "true_motion")]
    pub pose: Option<PathBuf>,
    /// Show the true motions instead.
    #[arg(long = "true", conflicts_with = "pose")]
    pub true_motion: bool,
    /// Folder for the videos, prompts.jsonl and render.json.
    #[arg(long)]
    pub out: PathBuf,
    /// Kind of the videos.
    #[arg(long, value_enum, default_value = "avi")]
    pub frames: FrameKind,
    /// Where the camera is.
    #[arg(long, value_enum, default_value = "radar")]
    pub camera: CameraPlace,
    /// Number of clips, the first ones; all if omitted.
    #[arg(long, value_name = "N")]
    pub count: Option<usize>,
    /// Replace earlier videos.
    #[arg(long)]
    pub force: bool,
}

/// Where the camera is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum CameraPlace {
    /// At the radar.
    Radar,
    /// In front of a person who faces the radar, a little to the side and above.
    ThreeQuarter,
}

impl CameraPlace {
    fn name(self) -> &'static str {
        match self {
            Self::Radar => "radar",
            Self::ThreeQuarter => "three-quarter",
        }
    }
}

/// A body that moves.
#[derive(Debug)]
struct PosedClip {
    id: String,
    /// Standing height of the body, m.
    height_m: f32,
    radar_height_m: f32,
    /// [`FPS`] poses a second: axes of the radar, z above the floor.
    poses: Vec<Pose>,
}

/// Runs the command.
pub(crate) fn run(args: &RenderArgs) -> CliResult {
    let render_path = args.out.join(RENDER_FILE);
    output::check_free(&render_path, args.force)?;
    let data = Dataset::open(&args.data)?;
    let bodies = posed_clips(args, &data)?;
    // Until render.json is there again, nothing in the folder counts as finished.
    let _ = fs::remove_file(&render_path);
    let prompts: Vec<Prompt> = bodies
        .par_iter()
        .enumerate()
        .map(|(index, body)| write_video(args, index, body))
        .collect::<CliResult<_>>()?;
    let lines = output::json_lines(&prompts)?;
    output::write_atomic(&args.out.join(PROMPTS_FILE), lines.as_bytes())?;
    let manifest = data.manifest();
    let render = Render {
        data: manifest.name.clone(),
        seed: manifest.seed,
        split: args.split.clone(),
        bodies: match args.pose {
            Some(_) => "estimated".into(),
            None => "true".into(),
        },
        pose_blake3: args.pose.as_deref().map(estimated::hash).transpose()?,
        camera: args.camera.name().into(),
        frames: args.frames,
        size: SIZE,
        fps: FPS,
        prompt: PROMPT.into(),
        count: prompts.len(),
        prompts_blake3: hash_of(lines.as_bytes()),
    };
    let render = serde_json::to_string_pretty(&render)?;
    output::write_atomic(&render_path, render.as_bytes())?;
    output::print_line(&format!("{}: {} videos", args.out.display(), prompts.len()));
    Ok(())
}

/// The bodies to show: of one clip of each motion, as captions are scored.
fn posed_clips(args: &RenderArgs, data: &Dataset) -> CliResult<Vec<PosedClip>> {
    let clips: Vec<ClipRecord> = data
        .iter_split(split(&args.split)?, Columns::All)
        .collect::<Result<_, _>>()?;
    let mut clips = one_of_each_motion(clips);
    clips.truncate(args.count.unwrap_or(usize::MAX));
    if clips.is_empty() {
        let problem = match args.count {
            Some(0) => "--count 0: no clips to show".into(),
            _ => format!(
                "{}: no clips in split `{}`",
                args.data.display(),
                args.split
            ),
        };
        return Err(CliError::new(problem));
    }
    match &args.pose {
        Some(pose) => estimated_poses(pose, &data.manifest().name, &clips),
        None => clips.iter().map(true_poses).collect(),
    }
}

/// The bodies that a pose network estimates from the points of clips of the data set `data`.
fn estimated_poses(model: &Path, data: &str, clips: &[ClipRecord]) -> CliResult<Vec<PosedClip>> {
    let motions = estimated::bodies(model, data, clips)?;
    motions
        .iter()
        .zip(clips)
        .map(|(motion, clip)| {
            let height_m = standing_height_m(&motion.skeleton);
            posed(clip, motion, height_m.clamp(HEIGHTS_M[0], HEIGHTS_M[1]))
        })
        .collect()
}

/// The true body of a clip.
fn true_poses(clip: &ClipRecord) -> CliResult<PosedClip> {
    let rotations = clip.known_rotations().map_err(|e| {
        CliError::new(format!("clip `{}`: {e}", clip.id))
            .hint("build the data set again: `radarllm dataset build`")
    })?;
    let motion = Motion {
        fps: clip.motion_fps.into(),
        skeleton: canonical_skeleton(clip.body_height_m),
        poses: (0..rotations.len())
            .map(|frame| pose_at(clip, frame))
            .collect(),
    };
    posed(clip, &motion, clip.body_height_m)
}

/// The body of a motion, whose z is above the floor.
fn posed(clip: &ClipRecord, motion: &Motion, height_m: f32) -> CliResult<PosedClip> {
    let poses = match motion.fps == f64::from(FPS) {
        true => motion.poses.clone(),
        false => {
            resample(motion, f64::from(FPS))
                .map_err(|e| CliError::new(format!("clip `{}`: {e}", clip.id)))?
                .poses
        }
    };
    Ok(PosedClip {
        id: clip.id.clone(),
        height_m,
        radar_height_m: clip.radar_height_m,
        poses,
    })
}

/// Draws and writes the video of a body.
fn write_video(args: &RenderArgs, index: usize, clip: &PosedClip) -> CliResult<Prompt> {
    let fail = |e: &dyn std::fmt::Display| CliError::new(format!("clip `{}`: {e}", clip.id));
    // The number keeps names apart that differ in other characters only; prompts.jsonl says whose video it is.
    let stem = format!("{index:05}-{}", file_name_of(&clip.id));
    let (video, blake3) = match args.frames {
        FrameKind::Avi => {
            let mut video = Video::new([SIZE; 2], FPS);
            draw(clip, args.camera, |image| {
                video.push(&image).map_err(|e| fail(&e))
            })?;
            let file = video.finish().map_err(|e| fail(&e))?;
            let name = format!("{stem}.avi");
            output::write_atomic(&args.out.join(&name), &file)?;
            (name, hash_of(&file))
        }
        FrameKind::Png => {
            let mut frames = Vec::new();
            draw(clip, args.camera, |image| {
                frames.push(image.to_png().map_err(|e| fail(&e))?);
                Ok(())
            })?;
            let folder = args.out.join(&stem);
            for (i, frame) in frames.iter().enumerate() {
                output::write_atomic(&folder.join(frame_name(i)), frame)?;
            }
            // Frames of an earlier, longer video would be taken for frames of this one.
            for i in frames.len().. {
                if fs::remove_file(folder.join(frame_name(i))).is_err() {
                    break;
                }
            }
            (stem, hash_of_all(&frames))
        }
    };
    Ok(Prompt {
        id: clip.id.clone(),
        video,
        prompt: PROMPT.into(),
        blake3,
    })
}

/// Draws a body frame by frame.
fn draw(
    clip: &PosedClip,
    place: CameraPlace,
    mut show: impl FnMut(Image) -> CliResult,
) -> CliResult {
    let shape = BodyShape {
        height_m: clip.height_m,
        facet_edge_m: EDGE_M,
        ..BodyShape::default()
    };
    let body =
        BuiltinBody::new(&shape).map_err(|e| CliError::new(format!("clip `{}`: {e}", clip.id)))?;
    let mut vertices = vec![Vec3::ZERO; body.n_vertices()];
    let camera = camera_of(clip, place);
    for pose in &clip.poses {
        body.pose_into(pose, &mut vertices);
        let mut scene = Scene::new(&camera, [SIZE; 2]);
        scene.floor_grid(FLOOR_M, 0.5);
        scene.mesh(&vertices, body.triangles(), GREY, Shading::Smooth);
        show(scene.finish())?;
    }
    Ok(())
}

/// A camera that stands still and looks at the middle of the places where the person is.
fn camera_of(clip: &PosedClip, place: CameraPlace) -> Camera {
    let roots = clip.poses.iter().map(|pose| pose.root_in_world);
    let (low, high) = roots.fold((Vec3::MAX, Vec3::MIN), |(low, high), root| {
        (low.min(root), high.max(root))
    });
    let middle = (0.5 * (low + high)).with_z(0.5 * clip.height_m);
    let half_way_m = 0.5 * (high - low).truncate().length();
    match place {
        CameraPlace::ThreeQuarter => {
            // The camera sees the tangent of half of its field of view, 0.3 rad, of its distance on each side.
            Camera::orbit(middle, (HALF_VIEW_M + half_way_m) / 0.3_f32.tan(), 0.6, 0.2)
        }
        CameraPlace::Radar => {
            let eye_m = Vec3::new(0.0, 0.0, clip.radar_height_m);
            // The nearest place has to fit.
            let near_m = (middle.distance(eye_m) - half_way_m).max(0.8);
            Camera {
                eye_m,
                target_m: middle,
                field_of_view_rad: (2.0 * (HALF_VIEW_M / near_m).atan()).min(1.9),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use radarllm_base::{frames::world_from_rest_facing_radar, skeleton::N_JOINTS};

    use super::*;

    /// A person who stands at these places and faces the radar.
    fn clip(places: &[[f32; 2]]) -> PosedClip {
        let mut rotations = [glam::Quat::IDENTITY; N_JOINTS];
        rotations[0] = world_from_rest_facing_radar();
        let pose = |&[x, y]: &[f32; 2]| Pose {
            root_in_world: Vec3::new(x, y, 0.95),
            rotations,
        };
        PosedClip {
            id: "a#0".into(),
            height_m: 1.7,
            radar_height_m: 1.0,
            poses: places.iter().map(pose).collect(),
        }
    }

    /// Columns and rows that contain the body.
    fn extent(image: &Image) -> [std::ops::RangeInclusive<usize>; 2] {
        let is_body = |x: usize, y: usize| {
            // Lit skin is brighter in no channel than the bluish background and the lines, and never bluish itself.
            image
                .pixel(x, y)
                .is_some_and(|[r, _, b]| b.saturating_sub(r) <= 5)
        };
        let cells = (0..SIZE).flat_map(|y| (0..SIZE).map(move |x| (x, y)));
        let body: Vec<(usize, usize)> = cells.filter(|&(x, y)| is_body(x, y)).collect();
        let range = |of: fn(&(usize, usize)) -> usize| {
            let (low, high) = (body.iter().map(of).min(), body.iter().map(of).max());
            low.unwrap()..=high.unwrap()
        };
        [range(|p| p.0), range(|p| p.1)]
    }

    #[test]
    fn the_body_is_whole_in_the_picture_near_far_and_at_the_side() {
        for place in [CameraPlace::Radar, CameraPlace::ThreeQuarter] {
            for at in [[0.0, 3.0], [0.0, 6.0], [1.5, 2.0]] {
                let mut images = Vec::new();
                draw(&clip(&[at]), place, |image| {
                    images.push(image);
                    Ok(())
                })
                .unwrap();
                let [columns, rows] = extent(&images[0]);
                let margin = 5..SIZE - 5;
                for end in [columns.start(), columns.end(), rows.start(), rows.end()] {
                    assert!(
                        margin.contains(end),
                        "{place:?} {at:?}: {columns:?} {rows:?}"
                    );
                }
                // Half of the height at least: 1.7 of 2.7 m.
                assert!(
                    rows.end() - rows.start() > SIZE / 2,
                    "{place:?} {at:?}: {rows:?}"
                );
            }
        }
    }

    #[test]
    fn a_clip_of_an_old_data_set_is_named() {
        let old = ClipRecord {
            id: "walk:3#0".into(),
            motion_id: "walk:3".into(),
            group: "walk:3".into(),
            split: radarllm_dataset::Split::Test,
            action: "walk".into(),
            captions: vec!["a person walks".into()],
            source: "procedural".into(),
            radar: "awr1843boost".into(),
            radar_height_m: 1.0,
            seed: 1,
            frames: Vec::new(),
            motion_fps: 20.0,
            joints: vec![[[0.0, 3.0, 0.0]; N_JOINTS]],
            motion_features: Vec::new(),
            rotations6d: Vec::new(),
            body_height_m: 0.0,
        };
        let error = true_poses(&old).unwrap_err();
        assert!(error.cause.contains("walk:3#0"), "{}", error.cause);
        assert!(error.hint.unwrap().contains("build the data set again"));
        let upright = ClipRecord {
            rotations6d: vec![[[1.0, 0.0, 0.0, 0.0, 1.0, 0.0]; N_JOINTS]],
            body_height_m: 1.7,
            ..old
        };
        let clip = true_poses(&upright).unwrap();
        assert_eq!(clip.poses[0].root_in_world, Vec3::new(0.0, 3.0, 1.0));
    }

    #[test]
    fn the_camera_at_the_radar_has_the_right_hand_side_of_the_radar_on_the_right() {
        let clip = clip(&[[-0.8, 3.0], [0.8, 3.0]]);
        let mut centres = Vec::new();
        draw(&clip, CameraPlace::Radar, |image| {
            let [columns, _] = extent(&image);
            centres.push(columns.start() + columns.end());
            Ok(())
        })
        .unwrap();
        assert!(centres[0] < SIZE && centres[1] > SIZE, "{centres:?}");
    }
}
