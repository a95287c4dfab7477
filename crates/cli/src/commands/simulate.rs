//! `simulate`: motion or scene to points or raw samples.

use std::{
    fs,
    io::{BufWriter, Write},
    path::{Path, PathBuf},
    time::Instant,
};

use npyz::WriterBuilder;
use num_complex::Complex32;
use radarllm_base::{RadarConfig, SPEED_OF_LIGHT_MPS};
use radarllm_body::{
    MotionSampler,
    mesh::{BodyModel, PosedBody, SmplxBody, clothed_skin},
};
use radarllm_dataset::{Overwrite, PointsMeta, write_points};
use radarllm_radar_dsp::{DspOptions, Map};
use radarllm_radar_sim::{Noise, Scene};
use radarllm_synth::{
    Method, Synthesizer,
    scene::{OwnedScene, SceneFile},
    synthesizer::posed_builtin,
};
use radarllm_view::plot;
use rayon::prelude::*;
use serde::Serialize;

use crate::{
    args::{Emit, SimulateArgs},
    commands::radar,
    error::{CliError, CliResult},
    input::{self, MAX_FRAMES},
    output,
};

#[derive(Serialize)]
struct Report {
    inputs: usize,
    frames: usize,
    seconds: f64,
    frames_per_s: f64,
    points_per_frame: f64,
    outputs: Vec<String>,
}

/// What one input became.
struct Done {
    frames: usize,
    points: usize,
    out: PathBuf,
}

/// Runs the verb.
pub fn run(args: &SimulateArgs) -> CliResult {
    let radar = radar::open(&args.radar)?;
    let inputs = expand(&args.inputs)?;
    let outs = outputs(&inputs, args)?;
    for path in outs.iter().chain(&args.range_doppler) {
        output::check_free(path, args.force)?;
    }
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(args.threads.unwrap_or(0))
        .build()?;
    let started = Instant::now();
    let done: Vec<Done> = pool.install(|| {
        inputs
            .par_iter()
            .zip(&outs)
            .map(|(input, out)| simulate_one(input, out, &radar, args))
            .collect::<CliResult<_>>()
    })?;
    let frames: usize = done.iter().map(|d| d.frames).sum();
    let seconds = started.elapsed().as_secs_f64();
    let report = Report {
        inputs: inputs.len(),
        frames,
        seconds,
        frames_per_s: frames as f64 / seconds,
        points_per_frame: done.iter().map(|d| d.points).sum::<usize>() as f64
            / frames.max(1) as f64,
        outputs: done.iter().map(|d| d.out.display().to_string()).collect(),
    };
    if args.json {
        return output::print_json(&report);
    }
    output::print_line(&format!(
        "{} frames in {:.2} s ({:.1} frames/s), {:.1} points a frame",
        report.frames, report.seconds, report.frames_per_s, report.points_per_frame
    ));
    Ok(())
}

/// Folders become their motion files, sorted.
fn expand(inputs: &[String]) -> CliResult<Vec<String>> {
    let mut all = Vec::new();
    for input in inputs {
        let path = Path::new(input);
        if !input::is_builtin(input) && path.is_dir() {
            let mut files: Vec<String> = Vec::new();
            for entry in fs::read_dir(path).map_err(|e| CliError::io(path, e))? {
                let file = entry.map_err(|e| CliError::io(path, e))?.path();
                let known = file
                    .extension()
                    .is_some_and(|e| ["bvh", "amc", "npz", "npy"].iter().any(|k| e == *k));
                if known {
                    files.push(file.display().to_string());
                }
            }
            if files.is_empty() {
                return Err(CliError::new(format!(
                    "{input}: no .bvh, .amc, .npz or .npy file in this folder"
                )));
            }
            files.sort();
            all.extend(files);
        } else {
            all.push(input.clone());
        }
    }
    Ok(all)
}

/// One output per input: the file itself for one, files in a folder for several.
fn outputs(inputs: &[String], args: &SimulateArgs) -> CliResult<Vec<PathBuf>> {
    if let [_] = inputs {
        return Ok(vec![args.out.clone()]);
    }
    let extension = match args.emit {
        Emit::Points => "parquet",
        Emit::Adc => "npy",
    };
    fs::create_dir_all(&args.out).map_err(|e| CliError::io(&args.out, e))?;
    let mut names: Vec<PathBuf> = Vec::new();
    for input in inputs {
        let stem = if input::is_builtin(input) {
            input.replace(
                |c: char| !c.is_ascii_alphanumeric() && c != '.' && c != '-',
                "_",
            )
        } else {
            Path::new(input)
                .file_stem()
                .unwrap_or_default()
                .to_string_lossy()
                .into_owned()
        };
        let name = args.out.join(format!("{stem}.{extension}"));
        if names.contains(&name) {
            return Err(CliError::new(format!(
                "two inputs would both become {}",
                name.display()
            )));
        }
        names.push(name);
    }
    Ok(names)
}

fn simulate_one(
    input: &str,
    out: &Path,
    radar: &RadarConfig,
    args: &SimulateArgs,
) -> CliResult<Done> {
    let method = if args.reference {
        Method::Reference
    } else {
        Method::Fast
    };
    if input.ends_with(".toml") {
        let text = fs::read_to_string(input).map_err(|e| CliError::io(Path::new(input), e))?;
        let file =
            SceneFile::from_toml(&text).map_err(|e| CliError::new(format!("{input}: {e}")))?;
        let base = Path::new(input).parent().unwrap_or(Path::new(""));
        let owned = OwnedScene::open(&file, base, SPEED_OF_LIGHT_MPS / radar.wavelength_m())
            .map_err(|e| CliError::new(format!("{input}: {e}")))?;
        let mut synthesizer = Synthesizer::with_simulation(
            &file.radar(radar),
            method,
            DspOptions::default(),
            file.sim_options(),
        )?
        .with_impairments(
            file.impairments
                .resolve()
                .map_err(|e| CliError::new(format!("{input}: {e}")))?,
        );
        let frames = synthesizer.frames_in(file.duration_s).max(1);
        return run_scene(&mut synthesizer, &owned.scene(), frames, input, out, args);
    }
    let mut synthesizer = input::synthesizer(radar, method)?;
    let motion = input::motion(input, args.seed)?;
    let placement = input::place(&motion.motion, args.distance_m, args.radar_height_m);
    let body = match &args.body {
        Some(path) => {
            let model: std::sync::Arc<dyn BodyModel> =
                std::sync::Arc::new(SmplxBody::open(path, &[])?);
            PosedBody::new(
                model,
                MotionSampler::new(&motion.motion),
                placement,
                clothed_skin(),
            )
        }
        None => posed_builtin(&motion.motion, motion.shape, placement)?,
    };
    let scene = Scene {
        surfaces: vec![&body],
        points: Vec::new(),
        noise: Noise::Thermal,
    };
    let frames = synthesizer.frames_in(motion.motion.duration_s()).max(1);
    run_scene(&mut synthesizer, &scene, frames, input, out, args)
}

fn run_scene(
    synthesizer: &mut Synthesizer,
    scene: &Scene,
    n_frames: usize,
    input: &str,
    out: &Path,
    args: &SimulateArgs,
) -> CliResult<Done> {
    if n_frames > MAX_FRAMES {
        return Err(CliError::new(format!(
            "{input}: {n_frames} radar frames, at most {MAX_FRAMES} are handled"
        )));
    }
    if let Some(path) = &args.range_doppler {
        range_doppler_picture(synthesizer, scene, n_frames, path, args.seed)?;
    }
    match args.emit {
        Emit::Points => {
            let frames = synthesizer.scene_to_points(scene, n_frames, args.seed)?;
            let meta = PointsMeta {
                radar: synthesizer.radar().name.clone(),
                source: format!("simulated:{input}"),
                seed: Some(args.seed),
                version: env!("CARGO_PKG_VERSION").into(),
                radar_height_m: Some(args.radar_height_m),
                frame_rate_hz: synthesizer.radar().frame_rate_hz(),
            };
            write_points(out, &meta, &frames, Overwrite::Replace)?;
            let points = frames.iter().map(|f| f.points.len()).sum();
            Ok(Done {
                frames: n_frames,
                points,
                out: out.into(),
            })
        }
        Emit::Adc => {
            write_adc(synthesizer, scene, n_frames, out, args.seed)?;
            Ok(Done {
                frames: n_frames,
                points: 0,
                out: out.into(),
            })
        }
    }
}

/// npy complex64 `[frame, loop, tx, rx, sample]`, written frame by frame.
fn write_adc(
    synthesizer: &mut Synthesizer,
    scene: &Scene,
    n_frames: usize,
    out: &Path,
    seed: u64,
) -> CliResult {
    let radar = synthesizer.radar();
    let shape = [
        n_frames,
        radar.n_loops,
        radar.tx.len(),
        radar.rx.len(),
        radar.n_samples,
    ]
    .map(|n| n as u64);
    let temporary = out.with_extension(format!("npy.{}.tmp", std::process::id()));
    let mut write = || -> CliResult {
        let file = fs::File::create(&temporary).map_err(|e| CliError::io(&temporary, e))?;
        let mut buffered = BufWriter::new(file);
        let mut npy = npyz::WriteOptions::<Complex32>::new()
            .default_dtype()
            .shape(&shape)
            .writer(&mut buffered)
            .begin_nd()?;
        for frame_idx in 0..n_frames {
            npy.extend(
                synthesizer
                    .simulate(scene, frame_idx, seed)?
                    .data
                    .iter()
                    .copied(),
            )?;
        }
        npy.finish()?;
        buffered.flush()?;
        buffered
            .into_inner()
            .map_err(|e| CliError::new(e.to_string()))?
            .sync_all()?;
        fs::rename(&temporary, out).map_err(|e| CliError::io(out, e))
    };
    write().inspect_err(|_| {
        let _ = fs::remove_file(&temporary);
    })
}

/// The range-Doppler map of the frame whose points move most.
fn range_doppler_picture(
    synthesizer: &mut Synthesizer,
    scene: &Scene,
    n_frames: usize,
    path: &Path,
    seed: u64,
) -> CliResult {
    let mut best: Option<(f32, Map)> = None;
    for frame_idx in 0..n_frames {
        synthesizer.simulate(scene, frame_idx, seed)?;
        let movement: f32 = synthesizer
            .extract(frame_idx)?
            .points
            .iter()
            .map(|p| p.velocity_mps.abs())
            .sum();
        if best.as_ref().is_none_or(|(most, _)| movement > *most) {
            let (extractor, cube) = synthesizer.extractor();
            best = Some((movement, extractor.range_doppler_map(cube)?));
        }
    }
    let (_, map) = best.ok_or_else(|| CliError::new("no frame to draw"))?;
    output::write_atomic(
        path,
        &plot::map_png(
            &map_view(&map, 45.0),
            "Range-Doppler, dB below the strongest cell",
        )?,
    )
}

/// Range shown on either side of the strongest cell, m.
const SHOWN_RANGE_M: f64 = 1.5;

/// The rows around the strongest cell, dB relative to it.
fn map_view(map: &Map, depth_db: f32) -> plot::Heatmap {
    let values = map.to_db(-depth_db);
    let strongest = (0..values.len())
        .max_by(|a, b| values[*a].total_cmp(&values[*b]))
        .unwrap_or(0);
    let margin = (SHOWN_RANGE_M / map.rows.step.abs().max(1e-6)) as usize;
    let row = strongest / map.n_cols.max(1);
    let first = row.saturating_sub(margin);
    let last = (row + margin).min(map.n_rows - 1);
    let shown = values[first * map.n_cols..(last + 1) * map.n_cols]
        .iter()
        .map(|v| v - values[strongest])
        .collect();
    plot::Heatmap::new(last + 1 - first, map.n_cols, shown)
        .rows(
            &format!("{} ({})", map.rows.label, map.rows.unit),
            map.rows.at(first),
            map.rows.at(last),
        )
        .cols(
            &format!("{} ({})", map.cols.label, map.cols.unit),
            map.cols.start,
            map.cols.at(map.n_cols - 1),
        )
}
