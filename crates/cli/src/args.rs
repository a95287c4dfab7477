//! The command line: verbs and flags.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};

use crate::{
    commands::pictures::{PICTURES_HEADING, PictureArgs},
    recording_args::{CleaningArgs, InputArgs, LayoutArgs, PeopleArgs, RecordingArgs},
};

/// Turns millimetre-wave radar into language.
///
/// Example: radarllm describe "builtin:walk?direction=backward"
#[derive(Parser)]
#[command(
    name = "radarllm",
    version,
    about,
    long_about,
    arg_required_else_help = true
)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub verb: Verb,
}

/// All verbs.
#[derive(Subcommand)]
pub enum Verb {
    /// Built-in motions -> virtual radar -> points -> sentence, with the default model.
    ///
    /// Example: radarllm demo
    Demo(DemoArgs),
    /// Look at a motion file or a built-in motion.
    #[command(subcommand)]
    Motion(MotionVerb),
    /// List, show and check radars.
    #[command(subcommand)]
    Radar(RadarVerb),
    /// Motion or scene -> radar points (or raw ADC samples).
    ///
    /// Example: radarllm simulate "builtin:walk" --out walk.parquet
    Simulate(SimulateArgs),
    /// Recorded radar -> radar points.
    ///
    /// Example: radarllm process adc_data.bin --radar awr1843boost --iq i-first --out points.parquet
    ///
    /// Example: radarllm process uart.dat --radar profile.cfg --out points.parquet
    Process(Box<ProcessArgs>),
    /// Build, inspect and check radar-text data sets.
    #[command(subcommand)]
    Dataset(DatasetVerb),
    /// Train a stage of the model.
    ///
    /// Example: radarllm train tokenizer model.toml
    Train(TrainArgs),
    /// Points or motion -> sentence.
    ///
    /// Example: radarllm describe points.parquet "builtin:wave?side=left"
    Describe(DescribeArgs),
    /// Captions of a split of a data set, with all metrics, intervals and baselines.
    Eval(EvalArgs),
    /// Captions of recordings in folders by activity: how many name the recorded activity?
    ///
    /// Example: radarllm eval-recordings configs/recorded-radhar.toml --recordings radhar
    EvalRecordings(EvalRecordingsArgs),
    /// Change one parameter of a built-in motion and count how often the caption follows.
    ///
    /// Example: radarllm interventions --count 120
    #[command(alias = "edits")]
    Interventions(InterventionsArgs),
    /// Caption metrics alone, or errors of estimated bodies.
    ///
    /// Example: radarllm score --pose --candidates estimated.npz --references true.npz
    Score(ScoreArgs),
    /// One self-contained page: points in 3D over time, mesh, caption.
    ///
    /// Example: radarllm view "builtin:walk" --out walk.html
    View(ViewArgs),
    /// Compare simulated with recorded points of the same movements: how realistic is the virtual radar?
    ///
    /// Example: radarllm realism configs/realism-mars.toml --recordings mars
    Realism(RealismArgs),
    /// Train and evaluate a grid of changed configurations, and print its tables.
    ///
    /// Example: radarllm ablate configs/mocap-ablation.toml
    Ablate(AblateArgs),
    /// Captions of the same motions under noise, distance, rain and other conditions, as tables and curves.
    ///
    /// Example: radarllm robustness configs/robustness.toml --out robustness
    Robustness(RobustnessArgs),
    /// Networks of other architectures: T5, GPT-2, Qwen2, BERT, RoBERTa.
    #[command(subcommand)]
    Lm(LmVerb),
    /// What this machine has and what is missing.
    Doctor(JsonFlag),
    /// Print a completion script for a shell.
    ///
    /// Example: radarllm completions bash > ~/.local/share/bash-completion/completions/radarllm
    Completions {
        /// Shell.
        #[arg(value_enum)]
        shell: clap_complete::Shell,
    },
    /// Print the manual page, in the roff format of `man`.
    ///
    /// Example: radarllm man > radarllm.1 && man ./radarllm.1
    Man,
}

/// `--json` alone.
#[derive(Args)]
pub struct JsonFlag {
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// `demo`.
#[derive(Args)]
pub struct DemoArgs {
    /// Also write points and pages into this folder.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Motions to show instead of the three defaults.
    #[arg(value_name = "BUILTIN")]
    pub motions: Vec<String>,
    /// Model folder; the embedded default without it.
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// Seed of placement, small variations and noise.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Replace files in --out.
    #[arg(long)]
    pub force: bool,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// `motion ...`.
#[derive(Subcommand)]
pub enum MotionVerb {
    /// Format, length, unit and what was skipped.
    Info {
        /// BVH, AMC (with its ASF), AMASS npz, HumanML3D npy, or builtin:NAME?key=value.
        input: String,
        /// Print one JSON document.
        #[arg(long)]
        json: bool,
        /// Seed of a built-in motion's small variations.
        #[arg(long, default_value_t = 1)]
        seed: u64,
    },
    /// The moving body: npz (vertices, faces, joints, rotations), obj (first pose) or png (contact sheet).
    Mesh {
        /// Motion file or builtin:NAME?key=value.
        input: String,
        /// F.npz, F.obj or F.png.
        #[arg(long)]
        out: PathBuf,
        /// A user's own SMPL-X .npz; the built-in body without it.
        #[arg(long)]
        body: Option<PathBuf>,
        /// Replace an existing file.
        #[arg(long)]
        force: bool,
        /// Print one JSON document.
        #[arg(long)]
        json: bool,
        /// Seed of a built-in motion's small variations.
        #[arg(long, default_value_t = 1)]
        seed: u64,
    },
    /// All built-in motions with their keys.
    List {
        /// Print one JSON document.
        #[arg(long)]
        json: bool,
    },
}

/// `radar ...`.
#[derive(Subcommand)]
pub enum RadarVerb {
    /// Built-in radars.
    List(JsonFlag),
    /// Derived figures of a radar.
    Show {
        /// Built-in name, TI .cfg or our .toml.
        radar: String,
        /// Print one JSON document.
        #[arg(long)]
        json: bool,
    },
    /// Check a radar: timing, budgets, what people ask of it, what a model was trained on.
    ///
    /// Example: radarllm radar lint profile.cfg
    ///
    /// Exit code 1 if anything is an error, 0 if there are only warnings and notes.
    Lint {
        /// Built-in name, TI .cfg or our .toml.
        radar: String,
        /// Model folder to compare with; the embedded default without it.
        #[arg(long)]
        model: Option<PathBuf>,
        /// Print one JSON document.
        #[arg(long)]
        json: bool,
    },
    /// Gains of the virtual channels from raw samples of a corner reflector, for `process --calibration`.
    ///
    /// Example: radarllm radar calibrate corner.bin --radar awr1843boost --iq i-first --range-m 3 --out cal.toml
    Calibrate(CalibrateArgs),
}

/// `radar calibrate`.
#[derive(Args)]
pub struct CalibrateArgs {
    /// Raw samples of a corner reflector that stands still, as `process` reads them.
    #[arg(required = true)]
    pub capture: Vec<PathBuf>,
    /// Built-in name, TI .cfg, .json of mmWave Studio or our .toml.
    #[arg(long)]
    pub radar: String,
    /// Distance of the reflector, m; its echo is looked for within --search-m.
    #[arg(long)]
    pub range_m: f64,
    /// How far from there the strongest echo may be, m.
    #[arg(long, default_value_t = 0.3)]
    pub search_m: f64,
    /// Direction of the reflector, degrees to the right of boresight.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    pub azimuth_deg: f64,
    /// Direction of the reflector, degrees above boresight.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    pub elevation_deg: f64,
    /// Channel gains, TOML.
    #[arg(long)]
    pub out: PathBuf,
    /// adc, dca1000 or npy; detected if omitted.
    #[arg(long)]
    pub format: Option<String>,
    /// Sample layout of a raw capture.
    #[command(flatten)]
    pub layout: LayoutArgs,
    /// The same place without the reflector: its mean is subtracted.
    #[arg(long, value_name = "EMPTY")]
    pub background: Option<PathBuf>,
    /// Replace an existing file.
    #[arg(long)]
    pub force: bool,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// What `simulate` writes.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Emit {
    /// Parquet, one row a point.
    Points,
    /// npy complex64 `[frame, loop, tx, rx, sample]`.
    Adc,
}

/// `simulate`.
#[derive(Args)]
pub struct SimulateArgs {
    /// Motion files, folders of them, builtin:NAME?key=value, or one scene .toml.
    #[arg(required = true)]
    pub inputs: Vec<String>,
    /// Built-in name, TI .cfg or our .toml.
    #[arg(long, default_value = "awr1843boost")]
    pub radar: String,
    /// File; a folder when there are several inputs.
    #[arg(long)]
    pub out: PathBuf,
    /// What to write.
    #[arg(long, value_enum, default_value = "points")]
    pub emit: Emit,
    /// Use the slow exact path.
    #[arg(long)]
    pub reference: bool,
    /// Plots to write.
    #[command(flatten)]
    pub pictures: PictureArgs,
    /// A user's own SMPL-X .npz; the built-in body without it.
    #[arg(long)]
    pub body: Option<PathBuf>,
    /// Where motions stand: distance to the radar, m.
    #[arg(long, default_value_t = 3.0)]
    pub distance_m: f32,
    /// Height of the radar above the floor, m.
    #[arg(long, default_value_t = 1.0)]
    pub radar_height_m: f32,
    /// Seed of noise and small variations.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Only every n-th input from the i-th on, to share a folder among machines.
    #[arg(long, value_name = "I/N", value_parser = shard)]
    pub shard: Option<(usize, usize)>,
    /// Threads; all cores without it.
    #[arg(long)]
    pub threads: Option<usize>,
    /// Go on: inputs whose output exists are done.
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

/// `process`.
#[derive(Args)]
pub struct ProcessArgs {
    /// Raw words (adc_data.bin), records or pcap of a DCA1000, npy, where several files are parts of one
    /// recording; UART stream or port, data set file or folder, ROS bag, points table. `udp:4098` or
    /// `udp:ADDRESS:PORT` listens to a capture card.
    #[arg(required = true)]
    pub capture: Vec<PathBuf>,
    /// Built-in name, TI .cfg, .json of mmWave Studio or our .toml; raw samples need it.
    #[arg(long)]
    pub radar: Option<String>,
    /// Points, Parquet.
    #[arg(long)]
    pub out: PathBuf,
    /// Raw samples: adc, dca1000 or npy; points: uart, visualizer-json, visualizer-binary, radhar, mars, mmbody, mmfi,
    /// mat, csv, npy-points or bag; detected if omitted.
    #[arg(long)]
    pub format: Option<String>,
    /// Sample layout of a raw capture.
    #[command(flatten)]
    pub layout: LayoutArgs,
    /// Read only so many frames of raw samples.
    #[arg(long)]
    pub frames: Option<usize>,
    /// Signal chain of raw samples: the `[processing]` table of this file, a scene, a data set's configuration or one of
    /// its own; the default chain without it.
    #[arg(long, value_name = "F.toml")]
    pub processing: Option<PathBuf>,
    /// Frames per second of the points file; the recording's own without it.
    #[arg(long, value_name = "HZ")]
    pub resample: Option<f64>,
    /// How points are read, placed and joined.
    #[command(flatten)]
    pub recording: RecordingArgs,
    /// Background and leakage removal.
    #[command(flatten)]
    pub cleaning: CleaningArgs,
    /// People; their points go to OUT.person-1.parquet and so on, beside all points in --out.
    #[command(flatten)]
    pub people: PeopleArgs,
    /// Plots to write.
    #[command(flatten)]
    pub pictures: PictureArgs,
    /// Histogram of ADC values with saturation, offset and I/Q balance of each receiver, of raw samples; .svg.
    #[arg(long, value_name = "F.svg", help_heading = PICTURES_HEADING)]
    pub adc_statistics: Option<PathBuf>,
    /// Folder for all plots that the capture allows, as .svg.
    #[arg(long, value_name = "DIR", help_heading = PICTURES_HEADING)]
    pub all_pictures: Option<PathBuf>,
    /// Height of the radar above the floor, m; 1 m if omitted and the recording does not give it.
    #[arg(long)]
    pub radar_height_m: Option<f32>,
    /// Replace an existing file.
    #[arg(long)]
    pub force: bool,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// `dataset ...`.
#[derive(Subcommand)]
pub enum DatasetVerb {
    /// Motions and captions -> Parquet shards. Run again to resume.
    Build {
        /// Configuration; see docs/dataset.md.
        config: PathBuf,
        /// Folder of the data set.
        #[arg(long)]
        out: PathBuf,
        /// Threads; all cores without it.
        #[arg(long)]
        threads: Option<usize>,
        /// Start over in a folder that holds another data set.
        #[arg(long)]
        force: bool,
        /// Print one JSON document.
        #[arg(long)]
        json: bool,
    },
    /// Clips, hours, actions, points per frame.
    Info {
        /// Folder of the data set.
        dir: PathBuf,
        /// Print one JSON document.
        #[arg(long)]
        json: bool,
    },
    /// Hashes, rows, values, leakage between splits. Exit code 1 when there is a problem.
    Validate {
        /// Folder of the data set.
        dir: PathBuf,
        /// Print one JSON document.
        #[arg(long)]
        json: bool,
    },
}

/// Stages of `train`.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum, Debug)]
pub enum Stage {
    /// The motion VQ-VAE that guides the tokenizer.
    Motion,
    /// The radar tokenizer.
    Tokenizer,
    /// The language model on the three pretraining tasks.
    Pretrain,
    /// Instruction tuning.
    Instruct,
    /// Every stage in order.
    All,
}

/// `train`.
#[derive(Args)]
pub struct TrainArgs {
    /// Stage.
    #[arg(value_enum)]
    pub stage: Stage,
    /// Training configuration (TOML).
    #[arg(required_unless_present = "print_config")]
    pub config: Option<PathBuf>,
    /// Continue from the last checkpoint; finished stages are kept.
    #[arg(long)]
    pub resume: bool,
    /// Print the configuration with every default and stop.
    #[arg(long)]
    pub print_config: bool,
    /// Start over where a finished or begun training lies.
    #[arg(long)]
    pub force: bool,
    /// cpu, gpu, gpu:N, cuda, cuda:N or several, as gpu:0,gpu:1, instead of the configuration's device (docs/training-on-gpus.md).
    #[arg(long, value_name = "DEVICE")]
    pub device: Option<String>,
    /// Threads of a training on the CPU, which learns the same with any number; all cores without it.
    #[arg(long)]
    pub threads: Option<usize>,
}

/// What decodes sentences.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum DecoderName {
    /// The inference engine as trained, the default.
    F32,
    /// The inference engine with weights as bytes: faster on large models, sometimes another word.
    Int8,
    /// The networks that training uses (builds with the feature `train`): slow, say what `f32` says.
    Training,
}

impl DecoderName {
    /// As in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::F32 => "inference engine, f32",
            Self::Int8 => "inference engine, int8",
            Self::Training => "training network",
        }
    }
}

/// `describe`.
#[derive(Args)]
pub struct DescribeArgs {
    /// Recordings of any format, points files, motion files or builtin:NAME?key=value.
    #[arg(required = true)]
    pub inputs: Vec<String>,
    /// Model folder; the embedded default without it.
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// What decodes sentences.
    #[arg(long, value_enum, default_value = "f32")]
    pub decoder: DecoderName,
    /// Beam width; 1 is greedy.
    #[arg(long, default_value_t = 1)]
    pub beam: usize,
    /// How to read the inputs.
    #[command(flatten)]
    pub input: InputArgs,
    /// Tracking of people: one sentence for each, with the track's number and time.
    #[command(flatten)]
    pub people: PeopleArgs,
    /// Threads; all cores if omitted.
    #[arg(long)]
    pub threads: Option<usize>,
    /// Seed of simulated inputs.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// `eval`.
#[derive(Args)]
pub struct EvalArgs {
    /// Model folder; the embedded default without it.
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// Data set folder.
    #[arg(long)]
    pub data: PathBuf,
    /// Split to describe.
    #[arg(long, default_value = "test")]
    pub split: String,
    /// Folder for report.json, report.md, report.html and captions.jsonl.
    #[arg(long)]
    pub out: PathBuf,
    /// What decodes sentences.
    #[arg(long, value_enum, default_value = "f32")]
    pub decoder: DecoderName,
    /// Beam width; 1 is greedy.
    #[arg(long, default_value_t = 1)]
    pub beam: usize,
    /// Seed of bootstrap and shuffling.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Replace an earlier report.
    #[arg(long)]
    pub force: bool,
    /// Print the report as JSON.
    #[arg(long)]
    pub json: bool,
}

/// `interventions`.
#[derive(Args)]
pub struct InterventionsArgs {
    /// Model folder; the embedded default without it.
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// Number of interventions: side, direction and action take turns.
    #[arg(long, default_value_t = 60)]
    pub count: usize,
    /// Seed of motions, placement and noise.
    #[arg(long, default_value_t = 1000)]
    pub seed: u64,
    /// Threads that simulate; all cores without it.
    #[arg(long)]
    pub threads: Option<usize>,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// `eval-recordings`.
#[derive(Args)]
pub struct EvalRecordingsArgs {
    /// TOML with the activities and the words that name them.
    pub config: PathBuf,
    /// Folder with one folder of recordings for each activity.
    #[arg(long)]
    pub recordings: PathBuf,
    /// Model folder; the embedded default without it.
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// Built-in name, TI .cfg or our .toml of the recording radar.
    #[arg(long)]
    pub radar: Option<String>,
    /// uart, radhar, mars, mmbody, mmfi, csv, npy-points or bag; detected without it.
    #[arg(long)]
    pub format: Option<String>,
    /// Recorded points.
    #[command(flatten)]
    pub recording: RecordingArgs,
    /// Beams of the language model.
    #[arg(long, default_value_t = 1)]
    pub beam: usize,
    /// Also write the page, Markdown.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Replace an existing page.
    #[arg(long)]
    pub force: bool,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// `score`.
#[derive(Args)]
pub struct ScoreArgs {
    /// Lines {"id", "text"}; with --pose the estimated body.
    #[arg(long)]
    pub candidates: PathBuf,
    /// Lines {"id", "texts": [...]}; with --pose the true body.
    #[arg(long)]
    pub references: PathBuf,
    /// Compare bodies in place of captions: npz as `motion mesh` writes it, or npy of joints (T, J, 3) or
    /// rotations (T, J, 3, 3).
    #[arg(long, conflicts_with_all = ["protocol", "max_references", "meteor_data", "bert_score", "layer", "sim_cse", "pooling", "device", "seed"])]
    pub pose: bool,
    /// plain, nlg-eval, coco or motiongpt.
    #[arg(long, default_value = "plain")]
    pub protocol: String,
    /// References used per item; 0 means all. Protocol motiongpt always takes 3.
    #[arg(long, default_value_t = 3)]
    pub max_references: usize,
    /// METEOR's own data: function/english.words, nonbreaking/english.prefixes, data/paraphrase-en.gz.
    ///
    /// The first two from its jar, the third beside it; what is absent stays as built in (docs/metrics.md).
    #[arg(long, value_name = "DIR")]
    pub meteor_data: Option<PathBuf>,
    /// BERT or RoBERTa folder (config.json, model.safetensors, tokenizer.json) for BERTScore. Protocol
    /// motiongpt weights words by idf, the others do not.
    #[arg(long, value_name = "DIR")]
    pub bert_score: Option<PathBuf>,
    /// Layer for BERTScore, 17 for roberta-large.
    #[arg(long, requires = "bert_score")]
    pub layer: Option<usize>,
    /// F1 baseline that rescales BERTScore, 0.83122575 for layer 17 of roberta-large.
    #[arg(long, value_name = "F1", requires = "bert_score")]
    pub bert_baseline: Option<f64>,
    /// BERT or RoBERTa folder for SimCSE.
    #[arg(long, value_name = "DIR")]
    pub sim_cse: Option<PathBuf>,
    /// Pooling for SimCSE: pooler (supervised), cls (unsupervised) or mean.
    #[arg(long, requires = "sim_cse")]
    pub pooling: Option<String>,
    /// What BERT and RoBERTa are computed on: cpu (also without it), gpu, gpu:N, cuda or cuda:N (docs/training-on-gpus.md).
    #[arg(long)]
    pub device: Option<String>,
    /// Seed of the bootstrap.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Print one JSON document (also the default: scores have no other form).
    #[arg(long)]
    pub json: bool,
}

/// `view`.
#[derive(Args)]
pub struct ViewArgs {
    /// Recording of any format, points file, motion file or builtin:NAME?key=value.
    #[arg(value_name = "INPUT")]
    pub input_file: String,
    /// The page.
    #[arg(long)]
    pub out: PathBuf,
    /// Model folder; the embedded default without it.
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// How to read the input.
    #[command(flatten)]
    pub input: InputArgs,
    /// Seed of simulated inputs.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Replace an existing file.
    #[arg(long)]
    pub force: bool,
}

/// `ablate`.
#[derive(Args)]
pub struct AblateArgs {
    /// The grid: base recipe, seeds, tables and rows; see docs/ablations.md.
    pub config: PathBuf,
    /// Trainings that run side by side; they share the cores.
    #[arg(long, default_value_t = 1)]
    pub jobs: usize,
    /// Print what would run, and what has run already, and stop.
    #[arg(long)]
    pub plan: bool,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// `robustness`.
#[derive(Args)]
pub struct RobustnessArgs {
    /// Data set configuration, number of motions and conditions; see docs/robustness.md.
    pub config: PathBuf,
    /// Folder for robustness.json, robustness.md, curves and finished cells, which are kept.
    #[arg(long)]
    pub out: PathBuf,
    /// Model folder; the embedded default without it.
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// What decodes sentences.
    #[arg(long, value_enum, default_value = "f32")]
    pub decoder: DecoderName,
    /// Seed of the bootstrap.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Threads that simulate; all cores without it.
    #[arg(long)]
    pub threads: Option<usize>,
    /// Print the cells and which of them are done, and stop.
    #[arg(long)]
    pub plan: bool,
    /// Compute finished cells again.
    #[arg(long)]
    pub force: bool,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// `lm ...`.
#[derive(Subcommand)]
pub enum LmVerb {
    /// Forward pass: logits, or the last hidden states of BERT and RoBERTa.
    ///
    /// Example: radarllm lm logits --weights gpt2 --ids ids.json --out logits.npy
    Logits {
        /// Folder with config.json and model.safetensors (single or sharded).
        #[arg(long)]
        weights: PathBuf,
        /// JSON `{"input_ids": [[..]], "decoder_input_ids": [[..]]}`, rows of equal length;
        /// `attention_mask` (1 token, 0 padding) may stand beside them.
        #[arg(long)]
        ids: PathBuf,
        /// npy f32 `[batch, step, vocab]`, or `[batch, step, width]` of hidden states.
        #[arg(long)]
        out: PathBuf,
        /// Replace an existing file.
        #[arg(long)]
        force: bool,
        /// Print one JSON document.
        #[arg(long)]
        json: bool,
    },
    /// Folds the adapters of a trained GPT-2 or Qwen2 into its weights, for programs that know no adapters.
    ///
    /// Example: radarllm lm merge --model work/model/model/lm --out merged
    Merge {
        /// Folder of the language model: adapter_config.json and adapter_model.safetensors.
        #[arg(long)]
        model: PathBuf,
        /// New folder: config.json, tokenizer.json, model.safetensors.
        #[arg(long)]
        out: PathBuf,
    },
}

/// `realism`.
#[derive(Args)]
pub struct RealismArgs {
    /// Radar, signal chain and impairments; see docs/realism.md.
    pub config: PathBuf,
    /// Own recordings, NAME.parquet beside the scene file NAME.toml that says what happened; or the
    /// MARS data set, subjectN/timesplit/{radar,kinect}_data_PART.csv.
    #[arg(long)]
    pub recordings: PathBuf,
    /// Only takes of this part (MARS: train, validate, test; own: NAME). May be given several times.
    #[arg(long)]
    pub part: Vec<String>,
    /// Find threshold, elevation bias, origin and azimuth step from the recordings, and write the
    /// configuration with them to this file, beside the radar file it names.
    #[arg(long, value_name = "OUT.toml", conflicts_with_all = ["out", "json"])]
    pub calibrate: Option<PathBuf>,
    /// Also write the report into this Markdown file.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Replace an existing report.
    #[arg(long)]
    pub force: bool,
    /// Worker threads; all cores without it.
    #[arg(long)]
    pub threads: Option<usize>,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}
