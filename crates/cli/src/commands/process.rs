//! `process`: raw ADC samples to points.

use std::{fs::File, io::BufReader, path::Path};

use num_complex::Complex32;
use radarllm_base::{PointFrame, RadarConfig, RadarCube};
use radarllm_dataset::{Overwrite, PointsMeta, write_points};
use radarllm_radar_dsp::{DspOptions, PointExtractor};
use serde::Serialize;

use crate::{
    args::ProcessArgs,
    commands::{pictures::Pictures, radar},
    error::{CliError, CliResult},
    input::MAX_FRAMES,
    output,
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
    if let Some(format) = args
        .format
        .as_deref()
        .filter(|f| !["adc", "npy"].contains(f))
    {
        return Err(
            CliError::new(format!("--format {format}: not supported yet"))
                .hint("adc (npy complex64) is"),
        );
    }
    for path in std::iter::once(&args.out).chain(args.pictures.paths()) {
        output::check_free(path, args.force)?;
    }
    let radar = radar::open(&args.radar)?;
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

/// Mean number of points.
pub fn points_per_frame(frames: &[PointFrame]) -> f64 {
    frames.iter().map(|f| f.points.len()).sum::<usize>() as f64 / frames.len().max(1) as f64
}

/// True when a file is an npy array of complex64.
pub fn is_adc(path: &Path) -> bool {
    open_npy(path).is_ok_and(|npy| npy.dtype().descr().contains("c8"))
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
