//! What a user may name as INPUT, and where it came from.

use std::path::Path;

use radarllm_base::{Motion, PointFrame, RadarConfig, Timeline, frames::Placement};
use radarllm_body::{loaders::load_motion_file, mesh::BodyShape, procedural, sample::canonicalize};
use radarllm_dataset::read_points;
use radarllm_formats::{DetectError, Format};
use radarllm_radar_dsp::{DspOptions, PointExtractor};
use radarllm_synth::{
    Method, Synthesizer,
    placement::{PlacementRange, draw_placement},
    synthesizer::builtin_shape,
};
use serde::Serialize;

use crate::{
    commands::{process, radar},
    error::{CliError, CliResult},
    recording::{self, RecordingArgs},
};

/// Radar of simulated inputs.
const DEFAULT_RADAR: &str = "awr1843boost";
/// Longest motion or recording handled at once, radar frames (about 17 minutes at 10 per second).
pub const MAX_FRAMES: usize = 10_000;

/// A motion with what its file or its parameters said.
pub struct MotionInput {
    /// The motion.
    pub motion: Motion,
    /// The body that performs it.
    pub shape: BodyShape,
    /// What `motion info` prints.
    pub info: MotionInfo,
}

/// Facts about a motion, as scripts read them.
#[derive(Clone, Debug, Serialize)]
pub struct MotionInfo {
    /// File format, or `builtin`.
    pub format: String,
    /// Poses.
    pub frames: usize,
    /// Poses per second.
    pub fps: f64,
    /// Length, s.
    pub duration_s: f64,
    /// Joints in the source.
    pub joints: usize,
    /// Unit of lengths in the source.
    pub unit: String,
    /// Standing height of the skeleton, m.
    pub height_m: f64,
    /// What the source holds and this project does not use.
    pub skipped: Vec<String>,
    /// What looked odd.
    pub warnings: Vec<String>,
    /// Captions of built-in motions.
    pub captions: Vec<String>,
}

/// True when the input names a built-in motion.
pub fn is_builtin(input: &str) -> bool {
    input.starts_with("builtin:")
}

/// Loads a motion file or renders a built-in motion.
pub fn motion(input: &str, seed: u64) -> CliResult<MotionInput> {
    if is_builtin(input) {
        return builtin(input, seed);
    }
    let loaded = load_motion_file(Path::new(input)).map_err(|e| {
        let text = e.to_string();
        let named = if text.contains(input) {
            text
        } else {
            format!("{input}: {text}")
        };
        CliError::new(named).hint(
            "motions: .bvh, .amc (with its .asf), AMASS .npz, HumanML3D .npy, or builtin:NAME",
        )
    })?;
    let info = MotionInfo {
        format: loaded.format.to_string(),
        frames: loaded.frames,
        fps: loaded.fps,
        duration_s: loaded.motion.duration_s(),
        joints: loaded.n_source_joints,
        unit: loaded.unit.clone(),
        height_m: f64::from(loaded.height_m),
        skipped: loaded.skipped.clone(),
        warnings: loaded.warnings.clone(),
        captions: Vec::new(),
    };
    let mut motion = loaded.motion;
    canonicalize(&mut motion);
    let shape = BodyShape {
        height_m: loaded.height_m.clamp(1.0, 2.0),
        ..BodyShape::default()
    };
    Ok(MotionInput {
        motion,
        shape,
        info,
    })
}

fn builtin(input: &str, seed: u64) -> CliResult<MotionInput> {
    let request = procedural::parse(input).map_err(|e| {
        CliError::new(format!("{input}: {e}"))
            .hint("`radarllm motion list` prints all motions with their keys")
    })?;
    let rendered = request.render(seed);
    let shape = builtin_shape(&rendered);
    let info = MotionInfo {
        format: "builtin".into(),
        frames: rendered.motion.len(),
        fps: rendered.motion.fps,
        duration_s: rendered.motion.duration_s(),
        joints: radarllm_base::skeleton::N_JOINTS,
        unit: "m".into(),
        height_m: f64::from(rendered.height_m),
        skipped: Vec::new(),
        warnings: Vec::new(),
        captions: rendered.captions,
    };
    Ok(MotionInput {
        motion: rendered.motion,
        shape,
        info,
    })
}

/// How to turn an input into points.
pub struct ClipOptions<'a> {
    /// Built-in name or file; [`DEFAULT_RADAR`] where a motion has to be simulated without one.
    pub radar: Option<&'a str>,
    /// Format of a capture; detected without it.
    pub format: Option<&'a str>,
    /// How a recording is to be understood.
    pub recording: &'a RecordingArgs,
    /// Used where the input does not say, m.
    pub radar_height_m: f32,
    /// Where motions stand, m.
    pub distance_m: f32,
    /// Seed of simulated inputs.
    pub seed: u64,
}

/// Points, with everything needed to describe or draw them.
pub struct Clip {
    /// Radar frames.
    pub frames: Vec<PointFrame>,
    /// Radar frames per second.
    pub frame_rate_hz: f64,
    /// Height of the radar above the floor, m.
    pub radar_height_m: f32,
    /// Where the points came from.
    pub provenance: Provenance,
    /// The motion, when the points were simulated just now.
    pub performed: Option<(MotionInput, Placement)>,
}

/// Where points came from.
#[derive(Clone, Debug, Serialize)]
pub struct Provenance {
    /// The input as named.
    pub source: String,
    /// Radar name.
    pub radar: String,
    /// True when a simulator made the points, now or earlier.
    pub synthetic: bool,
}

/// Points of any input: a points file, raw ADC samples, or a motion that is simulated now.
pub fn clip(input: &str, options: &ClipOptions) -> CliResult<Clip> {
    if input.ends_with(".parquet") {
        return points_clip(input, options);
    }
    if let Some(clip) = capture_clip(input, options)? {
        return Ok(clip);
    }
    let radar = radar::open(options.radar.unwrap_or(DEFAULT_RADAR))?;
    let performed = motion(input, options.seed)?;
    let placement = place(
        &performed.motion,
        options.distance_m,
        options.radar_height_m,
    );
    let mut synthesizer = synthesizer(&radar, Method::Fast)?;
    let frames = synthesizer.motion_to_points(
        &performed.motion,
        performed.shape,
        placement,
        MAX_FRAMES,
        options.seed,
    )?;
    Ok(Clip {
        frames,
        frame_rate_hz: radar.frame_rate_hz(),
        radar_height_m: options.radar_height_m,
        provenance: Provenance {
            source: input.into(),
            radar: radar.name,
            synthetic: true,
        },
        performed: Some((performed, placement)),
    })
}

/// Extensions that only motions have.
const MOTION_EXTENSIONS: [&str; 5] = ["bvh", "amc", "asf", "npz", "toml"];

/// Points of a capture; `None` when the input is a motion.
fn capture_clip(input: &str, options: &ClipOptions) -> CliResult<Option<Clip>> {
    let path = Path::new(input);
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("");
    let is_motion =
        is_builtin(input) || MOTION_EXTENSIONS.contains(&extension.to_lowercase().as_str());
    if (is_motion || !path.exists()) && options.format.is_none() {
        return Ok(None);
    }
    let detected = match recording::format_of(path, options.format)? {
        Ok(detected) => detected,
        // What no capture looks like may be a motion; the loader says what it wants.
        Err(DetectError::Unknown(_)) => return Ok(None),
        Err(e) => return Err(recording::detect_error(path, &e)),
    };
    match detected.format {
        Format::Points => return points_clip(input, options).map(Some),
        Format::Adc if extension == "npy" => return adc_clip(input, options).map(Some),
        Format::Adc | Format::Dca1000 => {
            return Err(
                CliError::new(format!("{input}: raw samples of a capture card"))
                    .hint("`radarllm process` makes points of them"),
            );
        }
        _ => {}
    }
    let opened = recording::open(path, &detected, options.radar, options.recording)?;
    for note in &opened.notes {
        eprintln!("{input}: {note}");
    }
    // The model hears time in frames of its own rate; gaps of the recording become empty frames.
    let rate_hz = f64::from(radarllm_inference::lm::FRAME_RATE_HZ);
    let line = recording::resample(&opened.timeline, rate_hz, options.recording.follow)?;
    Ok(Some(Clip {
        frames: line.frames,
        frame_rate_hz: line.frame_rate_hz,
        radar_height_m: options.radar_height_m,
        provenance: Provenance {
            source: input.into(),
            radar: opened.radar,
            synthetic: false,
        },
        performed: None,
    }))
}

/// A chain with the default signal processing.
pub fn synthesizer(radar: &RadarConfig, method: Method) -> CliResult<Synthesizer> {
    Ok(Synthesizer::new(radar, method, DspOptions::default())?)
}

/// Puts a motion at a distance on boresight, as it faces.
pub fn place(motion: &Motion, distance_m: f32, radar_height_m: f32) -> Placement {
    let range = PlacementRange {
        distance_m: [distance_m; 2],
        lateral_m: 0.0,
        heading_rad: 0.0,
        radar_height_m,
    };
    draw_placement(motion, &range, 0)
}

fn points_clip(input: &str, options: &ClipOptions) -> CliResult<Clip> {
    let file = read_points(Path::new(input))?;
    let line = Timeline::from_frames(file.frames, file.meta.frame_rate_hz);
    let line = recording::shape(line, options.recording)?;
    Ok(Clip {
        frames: line.frames,
        frame_rate_hz: line.frame_rate_hz,
        radar_height_m: file.meta.radar_height_m.unwrap_or(options.radar_height_m),
        provenance: Provenance {
            source: input.into(),
            radar: file.meta.radar,
            synthetic: file.meta.source.starts_with("simulated"),
        },
        performed: None,
    })
}

fn adc_clip(input: &str, options: &ClipOptions) -> CliResult<Clip> {
    let radar = radar::open(options.radar.unwrap_or(DEFAULT_RADAR))?;
    let mut extractor = PointExtractor::new(&radar, DspOptions::default())?;
    options.recording.check_for_samples()?;
    let frames = process::points_of_npy(Path::new(input), &radar, &mut extractor)?;
    let line = Timeline::from_frames(frames, radar.frame_rate_hz());
    let line = recording::shape(line, options.recording)?;
    Ok(Clip {
        frames: line.frames,
        frame_rate_hz: line.frame_rate_hz,
        radar_height_m: options.radar_height_m,
        provenance: Provenance {
            source: input.into(),
            radar: radar.name,
            synthetic: false,
        },
        performed: None,
    })
}
