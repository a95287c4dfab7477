//! `process`: recorded radar to points.

use std::{fs::File, io::BufReader, path::Path};

use num_complex::Complex32;
use radarllm_base::{PointFrame, RadarConfig, RadarCube};
use radarllm_capture::{Detected, Format};
use radarllm_dataset::{Overwrite, PointsMeta, write_points};
use radarllm_radar_dsp::{DspOptions, PointExtractor};
use serde::Serialize;

use crate::{
    args::ProcessArgs,
    commands::{pictures::Pictures, radar},
    error::{CliError, CliResult},
    input::MAX_FRAMES,
    output, recording,
};

#[derive(Serialize)]
struct Report {
    frames: usize,
    points_per_frame: f64,
    radar: String,
    out: String,
}

/// Runs the verb.
pub fn run(args: &ProcessArgs) -> CliResult {
    let detected = recording::format_of(&args.capture, args.format.as_deref())?
        .map_err(|e| recording::detect_error(&args.capture, &e))?;
    for path in std::iter::once(&args.out).chain(args.pictures.paths()) {
        output::check_free(path, args.force)?;
    }
    match detected.format {
        Format::Adc => {}
        Format::Dca1000 => {
            return Err(
                CliError::new("--format dca1000: not supported yet").hint("adc (npy complex64) is")
            );
        }
        Format::Points => {
            return Err(CliError::new(format!(
                "{}: a points file already",
                args.capture.display()
            )));
        }
        _ => return recorded_points(args, &detected),
    }
    let radar = args.radar.as_deref().ok_or_else(|| {
        CliError::new("raw samples need --radar").hint("the radar that recorded them")
    })?;
    let radar = radar::open(radar)?;
    let mut extractor = PointExtractor::new(&radar, DspOptions::default())?;
    let mut pictures = Pictures::new(&args.pictures);
    let frames = points_of_adc(
        &args.capture,
        &radar,
        &mut extractor,
        |extractor, cube, frame| pictures.push(extractor, cube, frame),
    )?;
    pictures.finish()?;
    let meta = PointsMeta {
        radar: radar.name.clone(),
        source: format!("recorded:{}", args.capture.display()),
        seed: None,
        version: env!("CARGO_PKG_VERSION").into(),
        radar_height_m: Some(args.radar_height_m),
        frame_rate_hz: radar.frame_rate_hz(),
    };
    write_points(&args.out, &meta, &frames, Overwrite::Replace)?;
    let report = Report {
        frames: frames.len(),
        points_per_frame: points_per_frame(&frames),
        radar: radar.name,
        out: args.out.display().to_string(),
    };
    if args.json {
        return output::print_json(&report);
    }
    output::print_line(&format!(
        "{}: {} frames, {:.1} points a frame",
        report.out, report.frames, report.points_per_frame
    ));
    Ok(())
}

#[derive(Serialize)]
struct RecordedReport {
    frames: usize,
    points_per_frame: f64,
    frame_rate_hz: f64,
    radar: String,
    source: String,
    notes: Vec<String>,
    out: String,
}

/// Points that another radar's firmware found.
fn recorded_points(args: &ProcessArgs, detected: &Detected) -> CliResult {
    if args.pictures.paths().next().is_some() {
        return Err(CliError::new(
            "pictures are made from raw samples; this capture holds points",
        ));
    }
    let opened = recording::open(
        &args.capture,
        detected,
        args.radar.as_deref(),
        &args.recording,
    )?;
    let line = match args.resample {
        Some(rate_hz) => recording::resample(&opened.timeline, rate_hz, args.recording.follow)?,
        None => opened.timeline,
    };
    let meta = PointsMeta {
        radar: opened.radar,
        source: opened.source,
        seed: None,
        version: env!("CARGO_PKG_VERSION").into(),
        radar_height_m: Some(args.radar_height_m),
        frame_rate_hz: line.rate_hz,
    };
    write_points(&args.out, &meta, &line.frames, Overwrite::Replace)?;
    let report = RecordedReport {
        frames: line.frames.len(),
        points_per_frame: points_per_frame(&line.frames),
        frame_rate_hz: line.rate_hz,
        radar: meta.radar,
        source: meta.source,
        notes: opened.notes,
        out: args.out.display().to_string(),
    };
    if args.json {
        return output::print_json(&report);
    }
    for note in &report.notes {
        output::print_line(note);
    }
    output::print_line(&format!(
        "{}: {} frames at {:.2} Hz, {:.1} points a frame",
        report.out, report.frames, report.frame_rate_hz, report.points_per_frame
    ));
    Ok(())
}

/// Mean number of points.
pub fn points_per_frame(frames: &[PointFrame]) -> f64 {
    frames.iter().map(|f| f.points.len()).sum::<usize>() as f64 / frames.len().max(1) as f64
}

type Npy = npyz::NpyFile<BufReader<File>>;

fn open_npy(path: &Path) -> CliResult<Npy> {
    let file = File::open(path).map_err(|e| CliError::io(path, e))?;
    npyz::NpyFile::new(BufReader::new(file)).map_err(|e| CliError::io(path, e))
}

/// Reads `[frame, loop, tx, rx, sample]` complex64 frame by frame and extracts points.
///
/// Memory holds one frame, whatever the file claims; a file shorter than its header says is an
/// error at the frame where it ends. `each` sees every cube with its points.
pub fn points_of_adc(
    path: &Path,
    radar: &RadarConfig,
    extractor: &mut PointExtractor,
    mut each: impl FnMut(&mut PointExtractor, &RadarCube, &PointFrame) -> CliResult,
) -> CliResult<Vec<PointFrame>> {
    let npy = open_npy(path)?;
    let shape = npy.shape().to_vec();
    let wanted = [
        radar.n_loops,
        radar.tx.len(),
        radar.rx.len(),
        radar.n_samples,
    ];
    if shape.len() != 5
        || shape[1..]
            .iter()
            .zip(wanted)
            .any(|(found, wanted)| *found != wanted as u64)
    {
        return Err(CliError::new(format!(
            "{}: shape {shape:?}, expected [frame, loop, tx, rx, sample] = [*, {}, {}, {}, {}] for radar `{}`",
            path.display(),
            wanted[0],
            wanted[1],
            wanted[2],
            wanted[3],
            radar.name
        ))
        .hint("--radar names the radar that recorded the file"));
    }
    if npy.order() != npyz::Order::C {
        return Err(CliError::new(format!(
            "{}: Fortran order, expected C order",
            path.display()
        )));
    }
    let n_frames = shape[0];
    if n_frames > MAX_FRAMES as u64 {
        return Err(CliError::new(format!(
            "{}: {n_frames} frames, at most {MAX_FRAMES} are handled",
            path.display()
        )));
    }
    let mut samples = npy
        .data::<Complex32>()
        .map_err(|e| CliError::new(format!("{}: {e}", path.display())))?;
    let mut cube = RadarCube::zeros(wanted[0], wanted[1], wanted[2], wanted[3]);
    let mut frames = Vec::new();
    for frame_idx in 0..n_frames as usize {
        for (sample_idx, slot) in cube.data.iter_mut().enumerate() {
            *slot = match samples.next() {
                Some(Ok(value)) => value,
                Some(Err(e)) => {
                    return Err(CliError::new(format!(
                        "{}: frame {frame_idx}, sample {sample_idx}: {e}",
                        path.display()
                    )));
                }
                None => {
                    return Err(CliError::new(format!(
                        "{}: ends in frame {frame_idx} of {n_frames}, at sample {sample_idx}",
                        path.display()
                    )));
                }
            };
        }
        cube.time_s = frame_idx as f64 * radar.frame_period_s;
        let mut frame = extractor
            .extract(&cube)
            .map_err(|e| CliError::new(format!("{}: frame {frame_idx}: {e}", path.display())))?;
        frame.frame = frame_idx as u32;
        each(extractor, &cube, &frame)?;
        frames.push(frame);
    }
    Ok(frames)
}
