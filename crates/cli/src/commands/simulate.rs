//! `simulate`: computes points or raw samples from a motion or a scene.

use std::{
    collections::HashSet,
    fs,
    io::{BufWriter, Write},
    path::{Path, PathBuf},
    sync::{Mutex, PoisonError},
    time::Instant,
};

use clap::{Args, ValueEnum};
use radarllm::{SimulateOptions, Simulation, TiFirmware};
use radarllm_base::{PointFrame, RadarConfig};
use radarllm_dataset::{Overwrite, write_clip};
use radarllm_files::npy::NpyWriter;
use radarllm_formats::Severity;
use radarllm_synth::{
    Method, Synthesizer,
    placement::MIN_DISTANCE_M,
    simulate::{is_builtin, is_scene, motion_files},
};
use rayon::prelude::*;
use serde::Serialize;

use crate::{
    commands::pictures::{PictureArgs, Pictures},
    error::{CliError, CliResult},
    output, radar_file,
    threads::on_threads,
};

/// What `simulate` writes.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Emit {
    /// Radar points: Parquet, one row per point.
    Points,
    /// Raw samples: npy complex64 `[frame, loop, tx, rx, sample]`.
    Adc,
}

/// Whose signal chain `simulate` applies.
#[derive(Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub(crate) enum Firmware {
    /// This project's chain, which removes static clutter.
    #[default]
    None,
    /// TI's out-of-box demo of SDK 3, as the chirp configuration sets it up: both passes of CFAR, clutter removal and
    /// field of view. Where it reports static echoes, a motion is surrounded by random objects.
    OutOfBox,
    /// TI's 3D people tracking for the xWR6843, as the chirp configuration sets it up: Capon map of range and azimuth,
    /// two passes of CFAR, elevation by a second Capon spectrum. Only what moves is reported.
    PeopleTracking,
}

/// `simulate`.
#[derive(Args)]
pub(crate) struct SimulateArgs {
    /// Motion files, folders of them, builtin:NAME?key=value, or one scene .toml.
    #[arg(required = true)]
    pub inputs: Vec<String>,
    /// Radar: a built-in name, a TI .cfg or a radar .toml.
    #[arg(long, default_value = "awr1843boost")]
    pub radar: String,
    /// Output file, or a folder for several inputs.
    #[arg(long)]
    pub out: PathBuf,
    /// What to compute.
    #[arg(long, value_enum, default_value = "points")]
    pub emit: Emit,
    /// Signal chain of the points: this project's, or that of the board's own firmware (for a TI .cfg).
    #[arg(long, value_enum, default_value_t)]
    pub firmware: Firmware,
    /// Use the exact direct sum, which is hundreds of times slower.
    #[arg(long)]
    pub reference: bool,
    /// Plots to write.
    #[command(flatten)]
    pub pictures: PictureArgs,
    /// A user's own SMPL-X .npz for motions; the built-in body if omitted.
    #[arg(long)]
    pub body: Option<PathBuf>,
    /// Distance from the radar to the middle of a motion's path, m, from 1.3 to the radar's maximum range; 3 if omitted. A
    /// long path is moved away until its near end is at 1.3 m.
    #[arg(long)]
    pub distance_m: Option<f32>,
    /// Height of the radar above the floor, m; that of a scene's room, otherwise 1, if omitted.
    #[arg(long)]
    pub radar_height_m: Option<f32>,
    /// Seed of noise and motion variations.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Process only every N-th input, starting with the I-th, to divide a folder among machines.
    #[arg(long, value_name = "I/N", value_parser = shard)]
    pub shard: Option<(usize, usize)>,
    /// Threads; all cores if omitted.
    #[arg(long)]
    pub threads: Option<usize>,
    /// Skip inputs whose output exists.
    #[arg(long, conflicts_with = "force")]
    pub resume: bool,
    /// Replace existing files.
    #[arg(long)]
    pub force: bool,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// `2/5`: the second of five parts.
fn shard(text: &str) -> Result<(usize, usize), String> {
    let parts = text.split_once('/');
    let number = |t: &str| t.parse::<usize>().ok();
    match parts.and_then(|(i, n)| number(i).zip(number(n))) {
        Some((i, n)) if (1..=n).contains(&i) => Ok((i, n)),
        _ => Err("must be I/N with 1 <= I <= N, as in 2/5".into()),
    }
}

/// Seconds between lines of progress.
const PROGRESS_EVERY_S: u64 = 5;

#[derive(Serialize)]
struct Report {
    inputs: usize,
    /// Inputs whose output existed (`--resume`).
    skipped: usize,
    failed: Vec<Failure>,
    frames: usize,
    /// Frames with parts beyond the radar's maximum range, of which nothing is received.
    frames_beyond_range: usize,
    seconds: f64,
    frames_per_s: f64,
    points_per_frame: f64,
    outputs: Vec<String>,
}

/// An input that could not be simulated.
#[derive(Serialize)]
struct Failure {
    input: String,
    error: String,
}

/// What one input became.
struct Done {
    frames: usize,
    frames_beyond_range: usize,
    /// Distance of the middle of a path that is too deep for the one asked for, m.
    moved_to_m: Option<f32>,
    points: usize,
    out: PathBuf,
}

/// Runs the command.
pub(crate) fn run(args: &SimulateArgs) -> CliResult {
    let radar = radar_file::open(&args.radar)?;
    let firmware = match (args.firmware, args.emit) {
        (Firmware::None, _) => None,
        (Firmware::OutOfBox, Emit::Points) => Some(TiFirmware::out_of_box(&radar)?),
        (Firmware::PeopleTracking, Emit::Points) => Some(TiFirmware::people_tracking(&radar)?),
        (Firmware::OutOfBox | Firmware::PeopleTracking, Emit::Adc) => {
            return Err(CliError::new("firmware reports points, not samples")
                .hint("leave out --firmware or --emit adc"));
        }
    };
    let usual = SimulateOptions::default();
    let options = SimulateOptions {
        seed: args.seed,
        distance_m: args.distance_m.unwrap_or(usual.distance_m),
        radar_height_m: args.radar_height_m.unwrap_or(usual.radar_height_m),
        firmware,
        body: args.body.clone(),
        method: match args.reference {
            true => Method::Reference,
            false => Method::Fast,
        },
        own_noise: true,
        ..usual
    };
    let radar = radar.into_config()?;
    // Radars with warnings are simulated all the same, and the warnings are printed.
    let findings = radarllm_formats::lint(&radar, None);
    for finding in findings.iter().filter(|f| f.severity != Severity::Note) {
        note!("note: radar {}: {}", radar.name, finding.message);
    }
    let inputs = expand(&args.inputs)?;
    if let Some(scene) = inputs.iter().find(|input| is_scene(input)) {
        let (distance_m, body) = (args.distance_m.is_some(), args.body.is_some());
        for (flag, is_given) in [("--distance-m", distance_m), ("--body", body)] {
            if is_given {
                let problem =
                    format!("{scene}: {flag} is for motions; a scene states what stands where");
                return Err(CliError::new(problem).hint("leave it out"));
            }
        }
    }
    let outs = outputs(&inputs, args)?;
    let (shard, shards) = args.shard.unwrap_or((1, 1));
    let mut jobs: Vec<(String, PathBuf)> = inputs
        .into_iter()
        .zip(outs)
        .skip(shard - 1)
        .step_by(shards)
        .collect();
    let n_inputs = jobs.len();
    if args.resume {
        // Outputs are written atomically, so that an existing output is complete.
        jobs.retain(|(_, out)| !out.exists());
    }
    if n_inputs > 1 && args.pictures.paths().next().is_some() {
        return Err(CliError::new("plots are made of one input at a time"));
    }
    if args.pictures.tracks.is_some() {
        let problem = "--tracks shows people whom `radarllm process --people auto` tracks";
        return Err(CliError::new(problem).hint("leave it out, or process what is simulated"));
    }
    args.pictures.check()?;
    for path in jobs.iter().map(|job| &job.1).chain(args.pictures.paths()) {
        output::check_free(path, args.force).map_err(|error| match n_inputs {
            1 => error,
            _ => error.hint("--resume goes on with what is missing, --force replaces all; or give another --out"),
        })?;
    }
    let started = Instant::now();
    let progress = Progress::new(jobs.len());
    let results: Vec<CliResult<Done>> = on_threads(args.threads, || {
        jobs.par_iter()
            .map(|(input, out)| {
                let result = simulate_one(input, out, &radar, &options, args);
                progress.one_more();
                result
            })
            .collect()
    })?;
    let (mut done, mut failed) = (Vec::new(), Vec::new());
    for (result, (input, _)) in results.into_iter().zip(&jobs) {
        match result {
            Ok(one) => done.push(one),
            // With a single input, its error and hint are returned unchanged.
            Err(error) if n_inputs == 1 => return Err(naming(input, error)),
            Err(error) => failed.push(Failure {
                input: input.clone(),
                error: error.cause,
            }),
        }
    }
    let frames: usize = done.iter().map(|d| d.frames).sum();
    let seconds = started.elapsed().as_secs_f64();
    let report = Report {
        inputs: n_inputs,
        skipped: n_inputs - jobs.len(),
        failed,
        frames,
        frames_beyond_range: done.iter().map(|d| d.frames_beyond_range).sum(),
        seconds,
        frames_per_s: frames as f64 / seconds,
        points_per_frame: done.iter().map(|d| d.points).sum::<usize>() as f64
            / frames.max(1) as f64,
        outputs: done.iter().map(|d| d.out.display().to_string()).collect(),
    };
    if args.json {
        output::print_json(&report)?;
    } else {
        output::print_line(&format!(
            "{} frames in {:.2} s ({:.1} frames/s), {:.1} points a frame",
            report.frames, report.seconds, report.frames_per_s, report.points_per_frame
        ));
        if report.skipped > 0 {
            output::print_line(&format!("{} done before", report.skipped));
        }
    }
    note_distances(&done, &report, &options, &radar);
    for failure in &report.failed {
        note!("failed: {}: {}", failure.input, failure.error);
    }
    match report.failed.len() {
        0 => Ok(()),
        n => Err(CliError::new(format!(
            "{n} of {n_inputs} inputs failed; the others are written"
        ))),
    }
}

/// Says where bodies are not where they were asked for, or where the radar receives nothing of them.
fn note_distances(done: &[Done], report: &Report, options: &SimulateOptions, radar: &RadarConfig) {
    let asked_m = options.distance_m;
    let moved: Vec<f32> = done.iter().filter_map(|d| d.moved_to_m).collect();
    match (moved.as_slice(), done.len()) {
        ([], _) => {}
        ([to_m], 1) => note!(
            "note: the middle of the path is {to_m:.2} m away, not {asked_m} m, so that its near end is at {MIN_DISTANCE_M} m"
        ),
        (moved, n) => note!(
            "note: {} of {n} paths are too long for {asked_m} m and farther away, so that their near ends are at \
             {MIN_DISTANCE_M} m",
            moved.len()
        ),
    }
    if report.frames_beyond_range > 0 {
        note!(
            "note: in {} of {} frames, parts are beyond the maximum range of the radar, {:.2} m, and are not received",
            report.frames_beyond_range,
            report.frames,
            radar.max_range_m()
        );
    }
}

/// The error with the input's name, unless it has it.
fn naming(input: &str, error: CliError) -> CliError {
    if error.cause.contains(input) {
        return error;
    }
    CliError {
        cause: format!("{input}: {}", error.cause),
        ..error
    }
}

/// Counts finished inputs and prints the progress at intervals.
struct Progress {
    n_jobs: usize,
    started: Instant,
    /// Finished jobs, and when the last line was written.
    state: Mutex<(usize, Instant)>,
}

impl Progress {
    fn new(n_jobs: usize) -> Self {
        let started = Instant::now();
        Self {
            n_jobs,
            started,
            state: Mutex::new((0, started)),
        }
    }

    fn one_more(&self) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.0 += 1;
        if self.n_jobs > 1 && state.1.elapsed().as_secs() >= PROGRESS_EVERY_S {
            state.1 = Instant::now();
            let rate = state.0 as f64 / self.started.elapsed().as_secs_f64();
            let left_min = (self.n_jobs - state.0) as f64 / rate / 60.0;
            note!(
                "{} of {} inputs, {rate:.1} inputs/s, about {left_min:.0} min left",
                state.0,
                self.n_jobs
            );
        }
    }
}

/// Folders become their motion files, sorted.
fn expand(inputs: &[String]) -> CliResult<Vec<String>> {
    let mut all = Vec::new();
    for input in inputs {
        let path = Path::new(input);
        match !is_builtin(input) && path.is_dir() {
            true => all.extend(motion_files(path)?),
            false => all.push(input.clone()),
        }
    }
    Ok(all)
}

/// One output per input: the file itself for one, files in a folder for several.
fn outputs(inputs: &[String], args: &SimulateArgs) -> CliResult<Vec<PathBuf>> {
    let extension = match args.emit {
        Emit::Points => "parquet",
        Emit::Adc => "npy",
    };
    if let [_] = inputs {
        output::check_extension(&args.out, extension)?;
        return Ok(vec![args.out.clone()]);
    }
    fs::create_dir_all(&args.out).map_err(|e| CliError::io(&args.out, e))?;
    let mut names: Vec<PathBuf> = Vec::new();
    let mut taken: HashSet<PathBuf> = HashSet::new();
    for input in inputs {
        let stem = if is_builtin(input) {
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
        if !taken.insert(name.clone()) {
            return Err(CliError::new(format!(
                "two inputs would both become {}",
                name.display()
            )));
        }
        names.push(name);
    }
    Ok(names)
}

/// Simulates an input and writes points or samples.
fn simulate_one(
    input: &str,
    out: &Path,
    radar: &RadarConfig,
    options: &SimulateOptions,
    args: &SimulateArgs,
) -> CliResult<Done> {
    let simulation = Simulation::open(input, radar, options)?;
    let height_m = simulation.radar_height_m();
    if let Some(asked_m) = args.radar_height_m.filter(|asked_m| *asked_m != height_m) {
        // Another height than the default is refused by the library.
        let problem = format!(
            "{input}: [room] radar_height_m is {height_m} m, but --radar-height-m is {asked_m} m"
        );
        return Err(CliError::new(problem).hint("state it in [room] alone"));
    }
    let mut pictures = Pictures::new(&args.pictures);
    let draws = args.pictures.paths().next().is_some();
    let n_points = match args.emit {
        Emit::Points => {
            let frames = match draws {
                true => draw_each(&simulation, &mut pictures)?,
                false => simulation.points(&|| false)?,
            };
            pictures.finish(&frames, None)?;
            let clip = simulation.clip(frames);
            write_clip(out, &clip, Overwrite::Replace)?;
            clip.n_points()
        }
        Emit::Adc => {
            let mut frames = Vec::new();
            write_adc(&simulation, out, |synthesizer, frame_idx| {
                if draws {
                    frames.push(draw(synthesizer, frame_idx, &mut pictures)?);
                }
                Ok(())
            })?;
            pictures.finish(&frames, None)?;
            0
        }
    };
    Ok(Done {
        frames: simulation.n_frames(),
        frames_beyond_range: simulation.frames_beyond_range(),
        moved_to_m: simulation.moved_to_m(),
        points: n_points,
        out: out.into(),
    })
}

/// Points of all frames; plots see the samples of every frame in order.
fn draw_each(simulation: &Simulation, pictures: &mut Pictures) -> CliResult<Vec<PointFrame>> {
    let mut synthesizer = simulation.plan()?;
    let one = |frame_idx| {
        simulation.cube(&mut synthesizer, frame_idx)?;
        let mut frame = draw(&mut synthesizer, frame_idx, pictures)?;
        simulation.limit(&mut frame);
        Ok(frame)
    };
    (0..simulation.n_frames()).map(one).collect()
}

/// npy complex64 `[frame, loop, tx, rx, sample]`, written frame by frame.
fn write_adc(
    simulation: &Simulation,
    out: &Path,
    mut after_frame: impl FnMut(&mut Synthesizer, usize) -> CliResult,
) -> CliResult {
    let (radar, mut synthesizer) = (simulation.radar(), simulation.plan()?);
    let shape = [
        simulation.n_frames(),
        radar.n_loops,
        radar.tx.len(),
        radar.rx.len(),
        radar.n_samples,
    ];
    let io_error = |e| CliError::io(out, e);
    output::write_atomic_with(out, |file| {
        let mut buffered = BufWriter::new(file);
        let mut npy = NpyWriter::new(&mut buffered, &shape).map_err(io_error)?;
        for frame_idx in 0..simulation.n_frames() {
            let cube = simulation.cube(&mut synthesizer, frame_idx)?;
            npy.extend(cube.data.iter().map(|c| [c.re, c.im]))
                .map_err(io_error)?;
            after_frame(&mut synthesizer, frame_idx)?;
        }
        npy.finish().map_err(io_error)?;
        buffered.flush().map_err(io_error)
    })
}

/// Extracts the points of the simulated frame, and adds the frame to the plots.
fn draw(
    synthesizer: &mut Synthesizer,
    frame_idx: usize,
    pictures: &mut Pictures,
) -> CliResult<PointFrame> {
    let frame = synthesizer.extract(frame_idx)?;
    let (extractor, cube) = synthesizer.extractor();
    pictures.push(extractor, cube, &frame)?;
    Ok(frame)
}
