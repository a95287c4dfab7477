//! `robustness`: the same motions under changed conditions, one at a time, described and scored.
//!
//! Every cell shows the same clips with the same bodies, places and noise seeds, so that differences
//! between cells are differences of the condition. A finished cell is kept under a name made from
//! everything that it depends on; the same command goes on where it stopped.

use std::{
    cell::OnceCell,
    fmt::Write as _,
    path::Path,
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicUsize, Ordering},
    },
    time::Instant,
};

use glam::{DVec3, Quat};
use radarllm_base::{
    Motion, PointFrame, RadarConfig, SPEED_OF_LIGHT_MPS, materials::Substance, seed::derive_seed,
};
use radarllm_body::sample::{canonicalize, crop};
use radarllm_dataset::Split;
use radarllm_inference::lm::{Captioner, FRAME_RATE_HZ};
use radarllm_metrics::{
    ActionNamer, Candidate, Reference, ScoreOptions, bootstrap::units_of_ids, score,
};
use radarllm_radar_sim::{SimOptions, shapes::RigidSurface};
use radarllm_render::plot::{Series, lines_png};
use radarllm_synth::{
    Method, SynthError, Synthesizer,
    config::DatasetConfig,
    corpus::{Corpus, CorpusError, CorpusItem},
    record::make_record,
    synthesizer::open_radar,
};
use serde::{Deserialize, Serialize};

use crate::{
    args::RobustnessArgs,
    commands::{
        self, describe,
        judge::{ModelFiles, Share, fnv_1a},
    },
    error::{CliError, CliResult},
    files::{self, MAX_CONFIG_BYTES},
    output,
};

/// References counted of each clip, as in `eval`.
const MAX_REFERENCES: usize = 3;
/// Largest finished cell read, bytes.
const MAX_CELL_BYTES: u64 = 256 << 20;
/// Distance of a screen from the radar, m: nearer than any hand of a body whose pelvis keeps 1.3 m.
const SCREEN_M: f64 = 0.5;
/// Extent of a screen to each side, m: from where it stands it covers +-58 degrees.
const SCREEN_HALF_WIDTH_M: f64 = 0.8;
/// Extent of a screen upwards and downwards, m: +-50 degrees.
const SCREEN_HALF_HEIGHT_M: f64 = 0.6;
/// Finest facets of a screen, m.
const SCREEN_FACET_M: f64 = 0.02;
/// Depth raster of a scene that a screen fills, as for rooms: twice the default, which keeps the body
/// as finely sampled as in free space.
const SCREEN_RASTER: usize = 640;

/// The configuration file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Plan {
    /// Data set configuration, relative to this file: motions, placement, radar, seed.
    data: String,
    /// Split whose motions are shown.
    #[serde(default = "test_split")]
    split: String,
    /// Motions in every cell, spread evenly over the split.
    clips: usize,
    #[serde(rename = "axis")]
    axes: Vec<Axis>,
}

fn test_split() -> String {
    "test".into()
}

/// One condition and the values it takes.
#[derive(Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
enum Axis {
    /// Thermal noise above the radar's own, dB.
    Noise { extra_db: Vec<f64> },
    /// Distance of the path's middle, m.
    Distance { distance_m: Vec<f32> },
    /// Heading of the first pose, degrees; 0 faces the radar.
    Aspect { heading_deg: Vec<f32> },
    /// Strongest points kept of each frame.
    Points { at_most: Vec<usize> },
    /// Probability that a frame comes without points.
    FrameLoss { probability: Vec<f64> },
    /// Built-in radars or radar files.
    Radar { radars: Vec<String> },
    /// Rain, mm/h.
    Rain { rain_mm_per_h: Vec<f64> },
    /// Smoke particles, g/m^3.
    Smoke { smoke_g_per_m3: Vec<f64> },
    /// A sheet half a metre in front of the radar.
    Screen { screens: Vec<ScreenFile> },
}

#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct ScreenFile {
    material: String,
    thickness_m: f64,
}

/// What a cell changes.
#[derive(Clone, Debug, PartialEq)]
enum Change {
    Nothing,
    ExtraNoiseDb(f64),
    DistanceM(f32),
    HeadingDeg(f32),
    AtMostPoints(usize),
    FrameLoss(f64),
    Radar(String),
    RainMmPerH(f64),
    SmokeGPerM3(f64),
    Screen(ScreenFile),
}

impl Change {
    /// Made from the unchanged points rather than simulated anew.
    fn is_of_points(&self) -> bool {
        matches!(self, Self::AtMostPoints(_) | Self::FrameLoss(_))
    }

    fn label(&self) -> String {
        match self {
            Self::Nothing => "nothing changed".into(),
            Self::ExtraNoiseDb(v) => format!("{v} dB more noise"),
            Self::DistanceM(v) => format!("{v} m"),
            Self::HeadingDeg(v) => format!("{v} degrees"),
            Self::AtMostPoints(v) => format!("{v} points"),
            Self::FrameLoss(v) => format!("{} % of frames empty", v * 100.0),
            Self::Radar(name) => name.clone(),
            Self::RainMmPerH(v) => format!("{v} mm/h"),
            Self::SmokeGPerM3(v) => format!("{v} g/m^3"),
            Self::Screen(s) => format!("{} mm of {}", s.thickness_m * 1000.0, s.material),
        }
    }

    /// Place on the axis of a plot, if it has one.
    fn x(&self) -> Option<f64> {
        match self {
            Self::ExtraNoiseDb(v)
            | Self::FrameLoss(v)
            | Self::RainMmPerH(v)
            | Self::SmokeGPerM3(v) => Some(*v),
            Self::DistanceM(v) | Self::HeadingDeg(v) => Some(f64::from(*v)),
            Self::AtMostPoints(v) => Some(*v as f64),
            Self::Nothing | Self::Radar(_) | Self::Screen(_) => None,
        }
    }
}

impl Axis {
    fn name(&self) -> &'static str {
        match self {
            Self::Noise { .. } => "noise",
            Self::Distance { .. } => "distance",
            Self::Aspect { .. } => "aspect",
            Self::Points { .. } => "points",
            Self::FrameLoss { .. } => "frame-loss",
            Self::Radar { .. } => "radar",
            Self::Rain { .. } => "rain",
            Self::Smoke { .. } => "smoke",
            Self::Screen { .. } => "screen",
        }
    }

    fn about(&self) -> &'static str {
        match self {
            Self::Noise { .. } => "thermal noise above the radar's own, dB",
            Self::Distance { .. } => "distance of the path's middle, m",
            Self::Aspect { .. } => "heading of the first pose, degrees (0 faces the radar)",
            Self::Points { .. } => "strongest points kept of each frame",
            Self::FrameLoss { .. } => "share of frames that come without points",
            Self::Radar { .. } => "radar, at the frame rate of the base",
            Self::Rain { .. } => "rain on the whole path, mm/h",
            Self::Smoke { .. } => "smoke on the whole path, g/m^3",
            Self::Screen { .. } => "a sheet across the view, 0.5 m in front of the radar",
        }
    }

    fn changes(&self) -> Vec<Change> {
        fn all<T: Clone>(values: &[T], change: impl Fn(T) -> Change) -> Vec<Change> {
            values.iter().cloned().map(change).collect()
        }
        match self {
            Self::Noise { extra_db } => all(extra_db, Change::ExtraNoiseDb),
            Self::Distance { distance_m } => all(distance_m, Change::DistanceM),
            Self::Aspect { heading_deg } => all(heading_deg, Change::HeadingDeg),
            Self::Points { at_most } => all(at_most, Change::AtMostPoints),
            Self::FrameLoss { probability } => all(probability, Change::FrameLoss),
            Self::Radar { radars } => all(radars, Change::Radar),
            Self::Rain { rain_mm_per_h } => all(rain_mm_per_h, Change::RainMmPerH),
            Self::Smoke { smoke_g_per_m3 } => all(smoke_g_per_m3, Change::SmokeGPerM3),
            Self::Screen { screens } => all(screens, Change::Screen),
        }
    }

    /// Where the unchanged cell stands on a plot.
    fn x_of_nothing(&self) -> Option<f64> {
        match self {
            Self::Noise { .. }
            | Self::FrameLoss { .. }
            | Self::Rain { .. }
            | Self::Smoke { .. } => Some(0.0),
            _ => None,
        }
    }
}

/// What a finished cell keeps: everything that scores are computed from.
#[derive(Serialize, Deserialize)]
struct CellFile {
    condition: String,
    ids: Vec<String>,
    captions: Vec<String>,
    abstained: usize,
    points_per_frame: f64,
}

#[derive(Clone, Serialize)]
struct Cell {
    condition: String,
    /// Place on the axis; null for the unchanged cell of some axes and for names.
    x: Option<f64>,
    bleu_1: Share,
    rouge_l: Share,
    cider_d: Share,
    right_action: Share,
    /// Right here less right in the unchanged cell, clip by clip.
    right_action_change: Share,
    abstained: usize,
    points_per_frame: f64,
}

#[derive(Serialize)]
struct AxisReport {
    name: &'static str,
    about: &'static str,
    /// The unchanged cell first.
    cells: Vec<Cell>,
}

#[derive(Serialize)]
struct Report {
    model: String,
    data: String,
    split: String,
    clips: usize,
    protocol: &'static str,
    max_references: usize,
    seed: u64,
    /// Share of these clips' references whose action the namer finds.
    action_namer_on_references: f64,
    axes: Vec<AxisReport>,
    notes: Vec<&'static str>,
}

/// Said with every report.
const NOTES: [&str; 2] = [
    "Darkness: no cell. The simulator has no light in it, so darkness cannot change a number here.",
    "Simulated throughout; nothing here says how a recorded radar behaves.",
];

/// Runs the verb.
pub fn run(args: &RobustnessArgs) -> CliResult {
    let base = args.config.parent().unwrap_or(Path::new(""));
    let problem = |e: &dyn std::fmt::Display| {
        CliError::new(format!("{}: {e}", args.config.display())).hint("see docs/robustness.md")
    };
    let text = files::read_text(&args.config, MAX_CONFIG_BYTES)?;
    let plan: Plan = toml::from_str(&text).map_err(|e| problem(&e))?;
    check(&plan).map_err(|e| problem(&e))?;
    let split = Split::from_name(&plan.split)
        .ok_or_else(|| problem(&format!("split {}: unknown", plan.split)))?;
    let data_path = base.join(&plan.data);
    let data_base = data_path.parent().unwrap_or(Path::new(""));
    let config = DatasetConfig::from_toml(&files::read_text(&data_path, MAX_CONFIG_BYTES)?)
        .map_err(|e| CliError::new(format!("{}: {e}", data_path.display())))?;
    let (captioner, model) = describe::load_decoder(args.model.as_deref(), args.decoder)?;
    let corpora = config.open_sources(data_base)?;
    let clips = choose(&corpora, split, plan.clips).map_err(|e| problem(&e))?;
    let bench = Bench {
        radar: config.open_radar(data_base)?,
        base: data_base,
        config: &config,
        corpora: &corpora,
        clips: &clips,
        captioner: &captioner,
        threads: commands::threads(args.threads),
        unchanged: OnceCell::new(),
    };
    let depends_on = format!(
        "{}\n{}\n{:?}\n{model}\n{:016x}\n{:?}",
        env!("CARGO_PKG_VERSION"),
        toml::to_string(&config)?,
        bench.radar,
        ModelFiles::of(args.model.as_deref())?.fingerprint,
        clips
    );
    let cells_dir = args.out.join("cells");
    let mut todo: Vec<(Change, std::path::PathBuf)> = Vec::new();
    let changes = plan.axes.iter().flat_map(Axis::changes);
    for change in [Change::Nothing].into_iter().chain(changes) {
        let hash = fnv_1a(
            fnv_1a(0xcbf2_9ce4_8422_2325, depends_on.as_bytes()),
            format!("{change:?}").as_bytes(),
        );
        let path = cells_dir.join(format!("{hash:016x}.json"));
        if !todo.iter().any(|(known, _)| *known == change) {
            todo.push((change, path));
        }
    }
    let done = |path: &Path| path.is_file() && !args.force;
    if args.plan {
        for (change, path) in &todo {
            let state = if done(path) { "done " } else { "to do" };
            output::print_line(&format!("{state}  {}", change.label()));
        }
        return Ok(());
    }
    let mut files: Vec<(Change, CellFile)> = Vec::new();
    for (number, (change, path)) in todo.iter().enumerate() {
        if !done(path) {
            let started = Instant::now();
            let cell = bench.cell(change)?;
            output::write_atomic(path, serde_json::to_string_pretty(&cell)?.as_bytes())?;
            eprintln!(
                "{} of {}: {} ({:.0} s)",
                number + 1,
                todo.len(),
                change.label(),
                started.elapsed().as_secs_f64()
            );
        }
        let text = files::read_text(path, MAX_CELL_BYTES)?;
        let cell: CellFile = serde_json::from_str(&text).map_err(|e| {
            CliError::new(format!("{}: {e}", path.display())).hint("--force makes it anew")
        })?;
        if cell.captions.len() != clips.len() || cell.ids != bench.ids() {
            return Err(
                CliError::new(format!("{}: other clips than asked for", path.display()))
                    .hint("--force makes it anew"),
            );
        }
        files.push((change.clone(), cell));
    }
    let report = report(&plan, &bench, model, &files, args.seed)?;
    let markdown = markdown(&report)?;
    for (axis, axis_report) in plan.axes.iter().zip(&report.axes) {
        if let Some(png) = curve(axis, axis_report)? {
            output::write_atomic(
                &args.out.join(format!("robustness-{}.png", axis.name())),
                &png,
            )?;
        }
    }
    output::write_atomic(&args.out.join("robustness.md"), markdown.as_bytes())?;
    output::write_atomic(
        &args.out.join("robustness.json"),
        serde_json::to_string_pretty(&report)?.as_bytes(),
    )?;
    if args.json {
        return output::print_json(&report);
    }
    output::print_line(markdown.trim_end());
    Ok(())
}

fn check(plan: &Plan) -> Result<(), String> {
    if !(2..=100_000).contains(&plan.clips) {
        return Err(format!(
            "clips: must be in 2..=100000, found {}",
            plan.clips
        ));
    }
    if plan.axes.is_empty() {
        return Err("no [[axis]]".into());
    }
    let mut names: Vec<&str> = plan.axes.iter().map(Axis::name).collect();
    names.sort_unstable();
    if let Some(twice) = names.windows(2).find(|w| w[0] == w[1]) {
        return Err(format!("axis `{}` is given twice", twice[0]));
    }
    for axis in &plan.axes {
        let changes = axis.changes();
        if changes.is_empty() {
            return Err(format!("axis `{}` has no values", axis.name()));
        }
        for change in changes {
            let range = match change {
                Change::ExtraNoiseDb(_) => 0.0..=100.0,
                Change::DistanceM(_) => 0.5..=100.0,
                Change::HeadingDeg(_) => -360.0..=360.0,
                Change::AtMostPoints(_) => 1.0..=1e6,
                Change::FrameLoss(_) => 0.0..=1.0,
                Change::RainMmPerH(_) => 0.0..=200.0,
                Change::SmokeGPerM3(_) => 0.0..=100.0,
                Change::Screen(ref screen) => {
                    if Substance::named(&screen.material).is_none() {
                        let known = Substance::ALL.map(Substance::name).join(", ");
                        return Err(format!(
                            "axis `screen`: material `{}` is unknown; {known} are known",
                            screen.material
                        ));
                    }
                    if !(1e-6..=0.1).contains(&screen.thickness_m) {
                        return Err(format!(
                            "axis `screen`: thickness_m must be in 1e-6..=0.1, found {}",
                            screen.thickness_m
                        ));
                    }
                    continue;
                }
                Change::Nothing | Change::Radar(_) => continue,
            };
            if !change.x().is_some_and(|x| range.contains(&x)) {
                return Err(format!(
                    "axis `{}`: values must be in {range:?}, found {:?}",
                    axis.name(),
                    change.x()
                ));
            }
        }
    }
    Ok(())
}

/// (source, item) of `n` motions, spread evenly over a split.
fn choose(
    corpora: &[Box<dyn Corpus>],
    split: Split,
    n: usize,
) -> Result<Vec<(usize, usize)>, String> {
    let all: Vec<(usize, usize)> = corpora
        .iter()
        .enumerate()
        .flat_map(|(source, corpus)| {
            let items = corpus.items().iter().enumerate();
            items
                .filter(move |(_, item)| item.split == split)
                .map(move |(item, _)| (source, item))
        })
        .collect();
    if all.len() < n {
        return Err(format!(
            "clips: {n} asked for, split `{split}` has {}",
            all.len()
        ));
    }
    Ok((0..n).map(|i| all[i * all.len() / n]).collect())
}

/// Everything that cells share.
struct Bench<'a> {
    config: &'a DatasetConfig,
    base: &'a Path,
    radar: RadarConfig,
    corpora: &'a [Box<dyn Corpus>],
    clips: &'a [(usize, usize)],
    captioner: &'a Captioner,
    threads: usize,
    /// Points of the unchanged cell, made when first needed.
    unchanged: OnceCell<Vec<Vec<PointFrame>>>,
}

impl Bench<'_> {
    fn items(&self) -> impl Iterator<Item = &CorpusItem> {
        self.clips
            .iter()
            .map(|&(source, item)| &self.corpora[source].items()[item])
    }

    fn ids(&self) -> Vec<String> {
        self.items().map(|item| item.motion_id.clone()).collect()
    }

    fn cell(&self, change: &Change) -> CliResult<CellFile> {
        let points = if change.is_of_points() || *change == Change::Nothing {
            let unchanged = match self.unchanged.get() {
                Some(ready) => ready,
                None => {
                    let made = self.simulate(&Change::Nothing)?;
                    self.unchanged.get_or_init(|| made)
                }
            };
            let ids = self.ids();
            unchanged
                .iter()
                .zip(&ids)
                .map(|(frames, id)| {
                    change_points(frames, change, derive_seed(self.config.seed, id))
                })
                .collect()
        } else {
            self.simulate(change)?
        };
        let inputs: Vec<_> = points
            .iter()
            .map(|frames| (frames.as_slice(), self.config.radar_height_m))
            .collect();
        let described = self.captioner.describe_batch(&inputs, 1)?;
        let n_frames: usize = points.iter().map(Vec::len).sum();
        let n_points: usize = points.iter().flatten().map(|f| f.points.len()).sum();
        Ok(CellFile {
            condition: change.label(),
            ids: self.ids(),
            abstained: described.iter().filter(|d| d.abstained.is_some()).count(),
            captions: described.into_iter().map(|d| d.caption).collect(),
            points_per_frame: n_points as f64 / n_frames.max(1) as f64,
        })
    }

    /// Points of every clip under a change of what the radar sees.
    fn simulate(&self, change: &Change) -> CliResult<Vec<Vec<PointFrame>>> {
        let mut config = self.config.clone();
        let mut radar = self.radar.clone();
        let mut turned_rad = None;
        match change {
            Change::ExtraNoiseDb(extra) => radar.noise_figure_db += extra,
            Change::DistanceM(distance) => config.distance_m = [*distance; 2],
            Change::HeadingDeg(heading) => {
                config.heading_deg = 0.0;
                turned_rad = Some(heading.to_radians());
            }
            Change::Radar(name) => {
                radar = RadarConfig {
                    // The model hears time in frames.
                    frame_period_s: radar.frame_period_s,
                    ..open_radar(name, self.base)?
                };
                radar
                    .validate()
                    .map_err(|e| CliError::new(format!("axis `radar`: {name}: {e}")))?;
            }
            Change::RainMmPerH(rain) => config.weather.rain_mm_per_h = *rain,
            Change::SmokeGPerM3(smoke) => config.weather.smoke_g_per_m3 = *smoke,
            Change::Nothing
            | Change::AtMostPoints(_)
            | Change::FrameLoss(_)
            | Change::Screen(_) => {}
        }
        if (radar.frame_rate_hz() / f64::from(FRAME_RATE_HZ) - 1.0).abs() > 0.05 {
            return Err(CliError::new(format!(
                "radar {}: {:.2} frames/s, but the model reads {FRAME_RATE_HZ} frames/s",
                radar.name,
                radar.frame_rate_hz()
            )));
        }
        let frequency_hz = SPEED_OF_LIGHT_MPS / radar.wavelength_m();
        let mut walls = match &config.room {
            Some(room) => room.walls(frequency_hz)?,
            None => Vec::new(),
        };
        let mut sim = config.sim_options();
        if let Change::Screen(screen) = change {
            walls.push(sheet(screen, frequency_hz)?);
            sim = SimOptions {
                raster_size: sim.raster_size.max(SCREEN_RASTER),
                ..sim
            };
        }
        let impairments = config.impairments.resolve().map_err(SynthError::Config)?;
        let max_s = config.max_frames as f64 * radar.frame_period_s;
        let work = |index: usize, synthesizer: &mut Synthesizer| -> CliResult<Vec<PointFrame>> {
            let (source, item) = self.clips[index];
            let corpus = self.corpora[source].as_ref();
            let record = match turned_rad {
                None => make_record(synthesizer, corpus, item, 0, &config),
                Some(heading_rad) => {
                    let corpus = Turned {
                        corpus,
                        heading_rad,
                        max_s,
                    };
                    make_record(synthesizer, &corpus, item, 0, &config)
                }
            };
            record.map(|record| record.frames).map_err(|e| {
                CliError::new(format!(
                    "{}: {}: {e}",
                    change.label(),
                    corpus.items()[item].motion_id
                ))
            })
        };
        let results: Mutex<Vec<Option<CliResult<Vec<PointFrame>>>>> =
            Mutex::new((0..self.clips.len()).map(|_| None).collect());
        let next = AtomicUsize::new(0);
        let lock = || results.lock().unwrap_or_else(PoisonError::into_inner);
        let worker = || -> CliResult {
            let mut synthesizer = Synthesizer::with_simulation(
                &radar,
                Method::Fast,
                config.processing.resolve(&radar),
                sim.clone(),
            )?
            .with_impairments(impairments)
            .with_walls(walls.clone());
            loop {
                let index = next.fetch_add(1, Ordering::Relaxed);
                if index >= self.clips.len() {
                    return Ok(());
                }
                let made = work(index, &mut synthesizer);
                lock()[index] = Some(made);
            }
        };
        std::thread::scope(|scope| {
            let workers: Vec<_> = (0..self.threads.clamp(1, self.clips.len()))
                .map(|_| scope.spawn(worker))
                .collect();
            workers
                .into_iter()
                .map(|w| {
                    w.join()
                        .unwrap_or_else(|_| Err(CliError::new("a simulating thread gave up")))
                })
                .collect::<CliResult<Vec<()>>>()
        })?;
        results
            .into_inner()
            .unwrap_or_else(PoisonError::into_inner)
            .into_iter()
            .map(|made| made.unwrap_or_else(|| Err(CliError::new("a clip was not simulated"))))
            .collect()
    }
}

/// A sheet across the radar's view.
fn sheet(screen: &ScreenFile, frequency_hz: f64) -> CliResult<RigidSurface> {
    let substance = Substance::named(&screen.material)
        .ok_or_else(|| CliError::new(format!("material `{}` is unknown", screen.material)))?;
    Ok(RigidSurface::graded_plate(
        [-SCREEN_HALF_WIDTH_M, SCREEN_HALF_WIDTH_M],
        [-SCREEN_HALF_HEIGHT_M, SCREEN_HALF_HEIGHT_M],
        [0.0, 0.0],
        SCREEN_FACET_M,
    )
    .at(DVec3::Y * SCREEN_M)
    .of(substance.slab(frequency_hz, screen.thickness_m)))
}

/// The unchanged points with fewer points or frames.
fn change_points(frames: &[PointFrame], change: &Change, seed: u64) -> Vec<PointFrame> {
    let mut frames = frames.to_vec();
    for frame in &mut frames {
        match change {
            Change::AtMostPoints(most) => {
                // Stable, so that equally strong points stay in the order of the signal chain.
                frame
                    .points
                    .sort_by(|a, b| b.intensity_db.total_cmp(&a.intensity_db));
                frame.points.truncate(*most);
            }
            Change::FrameLoss(probability) => {
                // The same frames are lost at every higher probability.
                let draw = derive_seed(seed, &format!("frame-loss/{}", frame.frame));
                if ((draw >> 11) as f64) < probability * (1_u64 << 53) as f64 {
                    frame.points.clear();
                }
            }
            _ => {}
        }
    }
    frames
}

/// A source whose motions begin with a given heading.
struct Turned<'a> {
    corpus: &'a dyn Corpus,
    heading_rad: f32,
    /// Longer motions are cut first: cutting faces them to the radar again.
    max_s: f64,
}

impl Corpus for Turned<'_> {
    fn name(&self) -> &'static str {
        self.corpus.name()
    }

    fn licence(&self) -> &'static str {
        self.corpus.licence()
    }

    fn attribution(&self) -> &'static str {
        self.corpus.attribution()
    }

    fn items(&self) -> &[CorpusItem] {
        self.corpus.items()
    }

    fn motion(&self, item_idx: usize) -> Result<Motion, CorpusError> {
        let mut motion = self.corpus.motion(item_idx)?;
        if motion.duration_s() > self.max_s {
            motion = crop(&motion, 0.0, self.max_s);
            canonicalize(&mut motion);
        }
        let turn = Quat::from_rotation_z(self.heading_rad);
        for pose in &mut motion.poses {
            pose.root_in_world = turn * pose.root_in_world;
            pose.rotations[0] = (turn * pose.rotations[0]).normalize();
        }
        Ok(motion)
    }
}

fn report(
    plan: &Plan,
    bench: &Bench,
    model: String,
    files: &[(Change, CellFile)],
    seed: u64,
) -> CliResult<Report> {
    let pairs: Vec<(&str, &str)> = bench
        .corpora
        .iter()
        .flat_map(|corpus| corpus.items())
        .filter(|item| item.split == Split::Train)
        .flat_map(|item| {
            item.captions
                .iter()
                .map(|caption| (caption.as_str(), item.action.as_str()))
        })
        .collect();
    let namer = ActionNamer::fit(&pairs)
        .ok_or_else(|| CliError::new("the training split has no captions to name actions by"))?;
    let items: Vec<&CorpusItem> = bench.items().collect();
    let references: Vec<Reference> = items
        .iter()
        .map(|item| Reference {
            id: item.motion_id.clone(),
            texts: item.captions.clone(),
        })
        .collect();
    let right = |cell: &CellFile| -> Vec<f64> {
        let said = cell.captions.iter().zip(&items);
        said.map(|(text, item)| f64::from(u8::from(namer.name(text) == Some(&item.action))))
            .collect()
    };
    let (_, unchanged) = files
        .first()
        .ok_or_else(|| CliError::new("no cell was made"))?;
    let right_unchanged = right(unchanged);
    let units = units_of_ids(items.iter().map(|item| item.motion_id.as_str()));
    let options = ScoreOptions {
        seed,
        max_references: MAX_REFERENCES,
        ..ScoreOptions::default()
    };
    let judge = |change: &Change, cell: &CellFile| -> CliResult<Cell> {
        let candidates: Vec<Candidate> = items
            .iter()
            .zip(&cell.captions)
            .map(|(item, text)| Candidate {
                id: item.motion_id.clone(),
                text: text.clone(),
            })
            .collect();
        let scores = score(&candidates, &references, &options)?;
        let of = |name: &str, value: f64| {
            let [low, high] = scores.ci95.get(name).copied().unwrap_or([f64::NAN; 2]);
            Share { value, low, high }
        };
        let here = right(cell);
        let change_of: Vec<f64> = here
            .iter()
            .zip(&right_unchanged)
            .map(|(a, b)| a - b)
            .collect();
        let share = |values: &[f64]| {
            Share::of(values, &units, seed).ok_or_else(|| CliError::new("no clips to judge"))
        };
        Ok(Cell {
            condition: cell.condition.clone(),
            x: change.x(),
            bleu_1: of("bleu_1", scores.bleu_1),
            rouge_l: of("rouge_l", scores.rouge_l),
            cider_d: of("cider_d", scores.cider_d),
            right_action: share(&here)?,
            right_action_change: share(&change_of)?,
            abstained: cell.abstained,
            points_per_frame: cell.points_per_frame,
        })
    };
    let axes = plan
        .axes
        .iter()
        .map(|axis| {
            let wanted = axis.changes();
            let mut cells = vec![Cell {
                x: axis.x_of_nothing(),
                ..judge(&Change::Nothing, unchanged)?
            }];
            for change in &wanted {
                let (_, cell) = files
                    .iter()
                    .find(|(known, _)| known == change)
                    .ok_or_else(|| CliError::new(format!("{}: not made", change.label())))?;
                cells.push(judge(change, cell)?);
            }
            Ok(AxisReport {
                name: axis.name(),
                about: axis.about(),
                cells,
            })
        })
        .collect::<CliResult<Vec<_>>>()?;
    let hits: Vec<bool> = items
        .iter()
        .flat_map(|item| {
            let named = |caption: &String| namer.name(caption) == Some(&item.action);
            item.captions.iter().map(named)
        })
        .collect();
    Ok(Report {
        model,
        data: bench.config.name.clone(),
        split: plan.split.clone(),
        clips: items.len(),
        protocol: "plain",
        max_references: MAX_REFERENCES,
        seed,
        action_namer_on_references: hits.iter().filter(|hit| **hit).count() as f64
            / hits.len().max(1) as f64,
        axes,
        notes: NOTES.to_vec(),
    })
}

fn markdown(report: &Report) -> CliResult<String> {
    let mut text = String::new();
    writeln!(
        text,
        "Model {}, {} motions of split `{}` of `{}`, the same in every cell, described greedily. Protocol `{}`, at most {} \
         references, values x100 (CIDEr-D in its own scale), 95 % bootstrap intervals over motions. \"Change\" is right action \
         against the unchanged cell, clip by clip. The action namer is right on {:.0} % of these clips' own references.",
        report.model,
        report.clips,
        report.split,
        report.data,
        report.protocol,
        report.max_references,
        report.action_namer_on_references * 100.0
    )?;
    for axis in &report.axes {
        writeln!(text, "\n## {}: {}\n", axis.name, axis.about)?;
        writeln!(
            text,
            "| condition | BLEU-1 | ROUGE-L | CIDEr-D | right action | change | points a frame | said nothing |"
        )?;
        writeln!(text, "|---|---|---|---|---|---|---|---|")?;
        for cell in &axis.cells {
            let percent = |s: &Share| {
                let [v, l, h] = [s.value, s.low, s.high].map(|v| v * 100.0);
                format!("{v:.1} [{l:.1}, {h:.1}]")
            };
            let c = &cell.cider_d;
            let change = if cell.condition == Change::Nothing.label() {
                String::new()
            } else {
                let [v, l, h] = {
                    let s = &cell.right_action_change;
                    [s.value, s.low, s.high].map(|v| v * 100.0)
                };
                format!("{v:+.1} [{l:+.1}, {h:+.1}]")
            };
            writeln!(
                text,
                "| {} | {} | {} | {:.2} [{:.2}, {:.2}] | {} | {change} | {:.1} | {} |",
                cell.condition,
                percent(&cell.bleu_1),
                percent(&cell.rouge_l),
                c.value,
                c.low,
                c.high,
                percent(&cell.right_action),
                cell.points_per_frame,
                cell.abstained
            )?;
        }
    }
    writeln!(text)?;
    for note in &report.notes {
        writeln!(text, "- {note}")?;
    }
    Ok(text)
}

/// Curves of an axis with at least two places on it.
fn curve(axis: &Axis, report: &AxisReport) -> CliResult<Option<Vec<u8>>> {
    let mut cells: Vec<(f64, &Cell)> = report
        .cells
        .iter()
        .filter_map(|cell| Some((cell.x?, cell)))
        .collect();
    if cells.len() < 2 {
        return Ok(None);
    }
    cells.sort_by(|a, b| a.0.total_cmp(&b.0));
    let x: Vec<f64> = cells.iter().map(|(x, _)| *x).collect();
    let of = |value: &dyn Fn(&Cell) -> (Share, f64)| -> (Vec<f64>, Vec<[f64; 2]>) {
        cells
            .iter()
            .map(|(_, cell)| {
                let (share, scale) = value(cell);
                (share.value * scale, [share.low * scale, share.high * scale])
            })
            .unzip()
    };
    let curves = [
        ("right action, %", of(&|c| (c.right_action, 100.0))),
        ("BLEU-1 x100", of(&|c| (c.bleu_1, 100.0))),
        ("ROUGE-L x100", of(&|c| (c.rouge_l, 100.0))),
        ("CIDEr-D x10", of(&|c| (c.cider_d, 10.0))),
    ];
    let series: Vec<Series> = curves
        .iter()
        .map(|(name, (y, intervals))| Series {
            name,
            x: &x,
            y,
            intervals,
        })
        .collect();
    let title = format!("Captions against {}", axis.name());
    Ok(Some(lines_png(&series, axis.about(), "quality", &title)?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use radarllm_base::RadarPoint;

    fn plan(axis: &str) -> Result<Plan, String> {
        let text = format!("data = \"d.toml\"\nclips = 4\n[[axis]]\n{axis}");
        let plan: Plan = toml::from_str(&text).map_err(|e| e.to_string())?;
        check(&plan).map(|()| plan)
    }

    #[test]
    fn slips_in_a_configuration_are_named() {
        for (axis, word) in [
            ("kind = \"fog\"", "fog"),
            ("kind = \"noise\"\nextra_db = []", "no values"),
            ("kind = \"noise\"\nextra_db = [-3.0]", "-3"),
            ("kind = \"rain\"\nrain_mm_per_h = [nan]", "rain"),
            ("kind = \"points\"\nat_most = [0]", "points"),
            ("kind = \"frame-loss\"\nprobability = [1.5]", "frame-loss"),
            (
                "kind = \"screen\"\nscreens = [{ material = \"cheese\", thickness_m = 0.01 }]",
                "cheese",
            ),
            (
                "kind = \"rain\"\nrain_mm_per_h = [1]\n[[axis]]\nkind = \"rain\"\nrain_mm_per_h = [2]",
                "twice",
            ),
        ] {
            let error = plan(axis).err().unwrap_or_default();
            assert!(error.contains(word), "`{error}` should name `{word}`");
        }
        assert!(plan("kind = \"distance\"\ndistance_m = [2.0, 6.0]").is_ok());
    }

    #[test]
    fn fewer_points_are_the_strongest_and_lost_frames_are_nested() {
        let point = |intensity_db: f32| RadarPoint {
            intensity_db,
            ..Default::default()
        };
        let frames: Vec<PointFrame> = (0..500)
            .map(|frame| PointFrame {
                frame,
                time_s: f64::from(frame) * 0.1,
                points: [3.0, 9.0, 1.0, 7.0].map(point).to_vec(),
            })
            .collect();
        let two = change_points(&frames, &Change::AtMostPoints(2), 1);
        assert_eq!(two[0].points, [point(9.0), point(7.0)]);
        assert_eq!(change_points(&frames, &Change::Nothing, 1), frames);
        let lost = |p: f64| -> Vec<usize> {
            let changed = change_points(&frames, &Change::FrameLoss(p), 1);
            assert_eq!(changed.len(), frames.len());
            (0..500).filter(|&i| changed[i].points.is_empty()).collect()
        };
        let (few, many) = (lost(0.2), lost(0.5));
        // 500 draws: five standard deviations are 45 and 56.
        assert!(few.len().abs_diff(100) < 45 && many.len().abs_diff(250) < 56);
        assert!(few.iter().all(|i| many.contains(i)));
        assert!(lost(0.0).is_empty() && lost(1.0).len() == 500);
    }

    #[test]
    fn a_turned_source_turns_what_the_radar_sees_and_nothing_else() {
        let corpus = radarllm_synth::corpus::procedural::ProceduralCorpus::new([0, 0, 3], 5);
        for item in 0..3 {
            let plain = corpus.motion(item).unwrap();
            let turned = Turned {
                corpus: &corpus,
                heading_rad: std::f32::consts::FRAC_PI_2,
                max_s: 1000.0,
            };
            let turned = turned.motion(item).unwrap();
            let (a, b) = (plain.joints_in_world(), turned.joints_in_world());
            for (p, q) in a.iter().flatten().zip(b.iter().flatten()) {
                // A quarter turn counter-clockwise: x becomes y.
                let expected = glam::Vec3::new(-p.y, p.x, p.z);
                assert!(expected.distance(*q) < 1e-4, "{expected} {q}");
            }
        }
    }
}
