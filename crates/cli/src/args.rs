//! The command line: verbs and flags.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};
use radarllm_eval::recordings::Role;

use crate::{
    commands::pictures::{PICTURES_HEADING, PictureArgs},
    live_args::{AskArgs, LiveArgs},
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
    /// The verb.
    #[command(subcommand)]
    pub verb: Verb,
}

/// All verbs.
#[derive(Subcommand)]
pub enum Verb {
    /// Describe built-in motions and the recording of a simulated board with the bundled model.
    ///
    /// Example: radarllm demo
    Demo(DemoArgs),
    /// Inspect a motion file or a built-in motion.
    #[command(subcommand)]
    Motion(MotionVerb),
    /// List, show, check and calibrate radars.
    #[command(subcommand)]
    Radar(RadarVerb),
    /// Simulate a motion or a scene: radar points or raw ADC samples.
    ///
    /// Example: radarllm simulate "builtin:walk" --out walk.parquet
    Simulate(SimulateArgs),
    /// Convert recorded radar data to radar points.
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
    /// Describe recordings, points files or motions in sentences.
    ///
    /// Example: radarllm describe points.parquet "builtin:wave?side=left"
    ///
    /// Example: radarllm describe walk.parquet --instruct "Where does the person go?" --model work/model/model
    Describe(DescribeArgs),
    /// Generate the radar points of a sentence, with a model that learned to do so.
    ///
    /// Example: radarllm generate "a person walks forward and waves" --model work/model/model --out walk.parquet --view walk.html
    Generate(GenerateArgs),
    /// Teach an activity of your own by about three recordings; `describe` recognises it afterwards.
    ///
    /// Example: radarllm teach wheelchair --says "a person sits down in the wheelchair" a.dat b.dat c.dat
    Teach(TeachArgs),
    /// Forget a taught activity.
    ///
    /// Example: radarllm forget wheelchair
    Forget(ForgetArgs),
    /// Describe what a radar sees while it happens, on a page, over MQTT and in a memory.
    ///
    /// Example: radarllm live /dev/ttyACM1 --cli-port /dev/ttyACM0 --radar profile.cfg --db live.db
    ///
    /// Example: radarllm live sim:
    Live(Box<LiveArgs>),
    /// Answer a question about what `live` saw.
    ///
    /// Example: radarllm ask "when did she last get up?" --db live.db
    Ask(AskArgs),
    /// Captions of a split of a data set, with all metrics, intervals and baselines.
    Eval(EvalArgs),
    /// Captions of recordings in folders by activity: how many name the recorded activity?
    ///
    /// Example: radarllm eval-recordings configs/eval/recorded-radhar.toml --recordings radhar
    EvalRecordings(EvalRecordingsArgs),
    /// Simulate falls and what looks like falls: how many does a running radar notice, and how often is it wrong?
    ///
    /// Example: radarllm eval-falls configs/eval/falls.toml --recordings configs/eval/recorded-radhar.toml radhar
    EvalFalls(EvalFallsArgs),
    /// Change one parameter of a built-in motion and count how often the caption follows.
    ///
    /// Example: radarllm interventions --count 120
    #[command(alias = "edits")]
    Interventions(InterventionsArgs),
    /// Compute caption metrics, or errors of estimated bodies.
    ///
    /// Example: radarllm score --pose --candidates estimated.npz --references true.npz
    Score(ScoreArgs),
    /// Write a self-contained page: points in 3D over time, mesh, caption.
    ///
    /// Example: radarllm view "builtin:walk" --out walk.html
    View(ViewArgs),
    /// Compare simulated with recorded points of the same movements: how realistic is the virtual radar?
    ///
    /// Example: radarllm realism configs/eval/realism-mars.toml --recordings mars
    Realism(RealismArgs),
    /// Train and evaluate a grid of changed configurations, and print its tables.
    ///
    /// Example: radarllm ablate configs/train/mocap-ablation.toml
    Ablate(AblateArgs),
    /// Captions of the same motions under noise, distance, rain and other conditions, as tables and curves.
    ///
    /// Example: radarllm robustness configs/eval/robustness.toml --out robustness
    Robustness(RobustnessArgs),
    /// Run pretrained language models: T5, GPT-2, Qwen2, BERT, RoBERTa.
    #[command(subcommand)]
    Lm(LmVerb),
    /// Report what this machine and this build can do.
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
    /// Motions to show instead of the default motions and the recording.
    #[arg(value_name = "BUILTIN")]
    pub motions: Vec<String>,
    /// Model folder; the bundled model if omitted.
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// Seed of placement, motion variations and noise.
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
    /// Print format, length, unit and skipped data of a motion.
    Info {
        /// BVH, AMC (with its ASF), AMASS npz, HumanML3D npy, or builtin:NAME?key=value.
        input: String,
        /// Print one JSON document.
        #[arg(long)]
        json: bool,
        /// Seed of the variations of a built-in motion.
        #[arg(long, default_value_t = 1)]
        seed: u64,
    },
    /// Write the moving body as npz (vertices, faces, joints, rotations), obj (first pose) or png (contact sheet).
    Mesh {
        /// Motion file or builtin:NAME?key=value.
        input: String,
        /// F.npz, F.obj or F.png.
        #[arg(long)]
        out: PathBuf,
        /// A user's own SMPL-X .npz; the built-in body if omitted.
        #[arg(long)]
        body: Option<PathBuf>,
        /// Replace an existing file.
        #[arg(long)]
        force: bool,
        /// Print one JSON document.
        #[arg(long)]
        json: bool,
        /// Seed of the variations of a built-in motion.
        #[arg(long, default_value_t = 1)]
        seed: u64,
    },
    /// List the built-in motions with their keys.
    List {
        /// Print one JSON document.
        #[arg(long)]
        json: bool,
    },
}

/// `radar ...`.
#[derive(Subcommand)]
pub enum RadarVerb {
    /// List the built-in radars.
    List(JsonFlag),
    /// Print the derived figures of a radar.
    Show {
        /// Radar: a built-in name, a TI .cfg or a radar .toml.
        radar: String,
        /// Print one JSON document.
        #[arg(long)]
        json: bool,
    },
    /// Check a radar: timing, data-rate and memory budgets, suitability for people, agreement with a model's training
    /// data.
    ///
    /// Example: radarllm radar lint profile.cfg
    ///
    /// Exit code 1 if anything is an error, 0 if there are only warnings and notes.
    Lint {
        /// Radar: a built-in name, a TI .cfg or a radar .toml.
        radar: String,
        /// Model folder to compare with; the bundled model if omitted.
        #[arg(long)]
        model: Option<PathBuf>,
        /// Print one JSON document.
        #[arg(long)]
        json: bool,
    },
    /// Estimate the gains of the virtual channels from raw samples of a corner reflector, for `process --calibration`.
    ///
    /// Example: radarllm radar calibrate corner.bin --radar awr1843boost --iq i-first --range-m 3 --out cal.toml
    Calibrate(CalibrateArgs),
}

/// `radar calibrate`.
#[derive(Args)]
pub struct CalibrateArgs {
    /// Raw samples of a static corner reflector, in any format that `process` reads.
    #[arg(required = true)]
    pub capture: Vec<PathBuf>,
    /// Radar: a built-in name, a TI .cfg, an export of mmWave Studio (.json) or a radar .toml.
    #[arg(long)]
    pub radar: String,
    /// Distance of the reflector, m. Its echo is searched within --search-m of it.
    #[arg(long)]
    pub range_m: f64,
    /// Half-width of the search interval around --range-m, m.
    #[arg(long, default_value_t = 0.3)]
    pub search_m: f64,
    /// Direction of the reflector, degrees to the right of boresight.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    pub azimuth_deg: f64,
    /// Direction of the reflector, degrees above boresight.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    pub elevation_deg: f64,
    /// Output file with the channel gains, TOML.
    #[arg(long)]
    pub out: PathBuf,
    /// adc, dca1000 or npy; detected if omitted.
    #[arg(long)]
    pub format: Option<String>,
    /// Sample layout of a raw capture.
    #[command(flatten)]
    pub layout: LayoutArgs,
    /// Recording of the same scene without the reflector, whose mean is subtracted.
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
    /// Radar points: Parquet, one row per point.
    Points,
    /// Raw samples: npy complex64 `[frame, loop, tx, rx, sample]`.
    Adc,
}

/// Whose signal chain `simulate` applies.
#[derive(Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub enum Firmware {
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
pub struct SimulateArgs {
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
    /// A user's own SMPL-X .npz; the built-in body if omitted.
    #[arg(long)]
    pub body: Option<PathBuf>,
    /// Distance from the radar to the middle of the motion's path, m.
    #[arg(long, default_value_t = 3.0)]
    pub distance_m: f32,
    /// Height of the radar above the floor, m.
    #[arg(long, default_value_t = 1.0)]
    pub radar_height_m: f32,
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

/// `process`.
#[derive(Args)]
pub struct ProcessArgs {
    /// Raw words (adc_data.bin), records or pcap of a DCA1000, npy, where several files are parts of one
    /// recording; UART stream or port, data set file or folder, ROS bag, points table. `udp:4098` or
    /// `udp:ADDRESS:PORT` listens to a capture card.
    #[arg(required = true)]
    pub capture: Vec<PathBuf>,
    /// Radar that recorded it: a built-in name, a TI .cfg, an export of mmWave Studio (.json) or a radar .toml. Required
    /// for raw samples.
    #[arg(long)]
    pub radar: Option<String>,
    /// Output file of points, Parquet.
    #[arg(long)]
    pub out: PathBuf,
    /// Raw samples: adc, dca1000 or npy; points: uart, visualizer-json, visualizer-binary, radhar, mars, mmbody, mmfi,
    /// mat, csv, npy-points or bag; detected if omitted.
    #[arg(long)]
    pub format: Option<String>,
    /// Sample layout of a raw capture.
    #[command(flatten)]
    pub layout: LayoutArgs,
    /// Read only this many frames of raw samples.
    #[arg(long)]
    pub frames: Option<usize>,
    /// Signal processing of raw samples: a TOML file with a `[processing]` table, such as a scene or a data set
    /// configuration; the default chain if omitted.
    #[arg(long, value_name = "F.toml")]
    pub processing: Option<PathBuf>,
    /// Frame rate of the points file, frames/s; that of the recording if omitted.
    #[arg(long, value_name = "HZ")]
    pub resample: Option<f64>,
    /// Recorded points.
    #[command(flatten)]
    pub recording: RecordingArgs,
    /// Background and leakage removal.
    #[command(flatten)]
    pub cleaning: CleaningArgs,
    /// Tracking of people. The points of each person are written to OUT.person-1.parquet and so on.
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
    /// Build a data set from motions with captions: Parquet shards. Run it again to resume.
    ///
    /// With --shard, several processes or machines that share the folder build a part each, and `dataset finish` completes
    /// the data set.
    ///
    /// Example: radarllm dataset build configs/data/default-data.toml --out work/data
    ///
    /// Example: radarllm dataset build configs/data/default-data.toml --out work/data --shard 3/8
    Build {
        /// Configuration (TOML); see docs/guides/dataset.md.
        config: PathBuf,
        /// Folder of the data set.
        #[arg(long)]
        out: PathBuf,
        /// Build only this part of the shards, for example 3/8: the third of eight parts.
        #[arg(long, value_name = "PART/PARTS", conflicts_with = "force")]
        shard: Option<Part>,
        /// Threads; all cores if omitted.
        #[arg(long)]
        threads: Option<usize>,
        /// Replace another data set in the folder.
        #[arg(long)]
        force: bool,
        /// Print one JSON document.
        #[arg(long)]
        json: bool,
    },
    /// Complete a data set whose parts were built with --shard. Exit code 1 if shards are missing, which are named.
    ///
    /// Example: radarllm dataset finish configs/data/default-data.toml --out work/data
    Finish {
        /// Configuration (TOML) of the parts.
        config: PathBuf,
        /// Folder of the data set.
        #[arg(long)]
        out: PathBuf,
        /// Print one JSON document.
        #[arg(long)]
        json: bool,
    },
    /// Copy a finished data set to a folder for the Hugging Face Hub: card, manifest and shards, with their hashes checked.
    ///
    /// Nothing is uploaded: `huggingface_hub.upload_folder` or git does that.
    ///
    /// Example: radarllm dataset export work/data --to hub
    Export {
        /// Folder of the data set.
        dir: PathBuf,
        /// Folder of the copy.
        #[arg(long)]
        to: PathBuf,
        /// Replace the data set in an existing copy; its other files stay.
        #[arg(long)]
        force: bool,
        /// Print one JSON document.
        #[arg(long)]
        json: bool,
    },
    /// Build a data set of recorded radar: recordings for tuning, with the sentences of their activities or with those of a
    /// model.
    ///
    /// A model that learns from recordings is no longer zero-shot. Judged recordings are never read.
    ///
    /// Example: radarllm dataset recordings configs/eval/recorded-radhar.toml --recordings radhar --out work/recorded-radhar
    Recordings(Box<DatasetRecordingsArgs>),
    /// Print clips, hours, actions and points per frame of a data set.
    Info {
        /// Folder of the data set.
        dir: PathBuf,
        /// Print one JSON document.
        #[arg(long)]
        json: bool,
    },
    /// Check hashes, rows, values and leakage between splits. Exit code 1 if there is a problem.
    Validate {
        /// Folder of the data set.
        dir: PathBuf,
        /// Print one JSON document.
        #[arg(long)]
        json: bool,
    },
}

/// Recordings of known activities, for `eval-recordings` and `dataset recordings`.
#[derive(Args)]
pub struct LabelledArgs {
    /// TOML with the activities, the actions that state them, and the roles of the recordings.
    pub config: PathBuf,
    /// Folder with the recordings, or a data set where the configuration says `simulated = true`.
    #[arg(long)]
    pub recordings: PathBuf,
    /// Radar that recorded them: a built-in name, a TI .cfg or a radar .toml.
    #[arg(long)]
    pub radar: Option<String>,
    /// uart, radhar, mars, mmbody, mmfi, csv, npy-points or bag; detected if omitted.
    #[arg(long)]
    pub format: Option<String>,
    /// Recorded points.
    #[command(flatten)]
    pub recording: RecordingArgs,
}

/// `dataset recordings`.
#[derive(Args)]
pub struct DatasetRecordingsArgs {
    /// Recordings; their activities need the sentence `says` unless --by-model is given.
    #[command(flatten)]
    pub labelled: LabelledArgs,
    /// Folder of the data set.
    #[arg(long)]
    pub out: PathBuf,
    /// Captions are what a model says about the recordings, instead of the sentences of their activities: adaptation without
    /// labels.
    #[arg(long)]
    pub by_model: bool,
    /// Model folder; the bundled model if omitted.
    #[arg(long, requires = "by_model")]
    pub model: Option<PathBuf>,
    /// Sentences of the model with less confidence are left out, 0 to 1.
    #[arg(long, default_value_t = 0.6, requires = "by_model")]
    pub min_confidence: f32,
    /// Replace another data set in the folder.
    #[arg(long)]
    pub force: bool,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// One of several parts of equal size, numbered from 1: `3/8`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Part {
    /// In `1..=of`.
    pub number: usize,
    /// Number of parts.
    pub of: usize,
}

impl std::str::FromStr for Part {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers = text
            .split_once('/')
            .map(|(number, of)| (number.parse::<usize>(), of.parse::<usize>()));
        match numbers {
            Some((Ok(number), Ok(of))) if (1..=of).contains(&number) => Ok(Self { number, of }),
            Some((Ok(_), Ok(of))) if of > 0 => {
                Err(format!("parts are numbered from 1/{of} to {of}/{of}"))
            }
            _ => Err("expected a part and the number of parts, for example 3/8".into()),
        }
    }
}

/// Values of the keys that a training configuration does not set.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum, Debug)]
pub enum Preset {
    /// Networks for CPU cores, with this project's additions to the paper.
    Small,
    /// Sizes, losses, batches, learning rates and epochs of the paper.
    Paper,
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
    /// The decoder of radar codes, which `radarllm generate` needs.
    Points,
    /// Every stage in order; `points` only if the configuration has a table [points].
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
    /// Values of the keys that the configuration does not set, instead of those of its own preset.
    #[arg(long, value_enum)]
    pub preset: Option<Preset>,
    /// Continue from the last checkpoint; finished stages are kept.
    #[arg(long)]
    pub resume: bool,
    /// Print the configuration with all defaults and exit.
    #[arg(long)]
    pub print_config: bool,
    /// Replace an earlier training in the output folder.
    #[arg(long)]
    pub force: bool,
    /// Device instead of the configuration's: cpu, gpu, gpu:N, cuda, cuda:N, or several, as gpu:0,gpu:1
    /// (docs/guides/training-on-gpus.md).
    #[arg(long, value_name = "DEVICE")]
    pub device: Option<String>,
    /// Threads of a training on the CPU; the result does not depend on their number; all cores if omitted.
    #[arg(long)]
    pub threads: Option<usize>,
}

/// Decoder of the language model.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum DecoderName {
    /// The inference engine with 32-bit weights.
    F32,
    /// The inference engine with 8-bit weights: faster for large models; sentences may differ.
    Int8,
    /// The networks used in training (feature `train`): slow; same sentences as `f32`.
    Training,
}

impl DecoderName {
    /// Name in reports.
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
    /// Model folder; the bundled model if omitted.
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// Decoder of the language model.
    #[arg(long, value_enum, default_value = "f32")]
    pub decoder: DecoderName,
    /// Search for the most probable sentence with N beams (1 is greedy) instead of a vote among drawn sentences.
    #[arg(long, value_name = "N")]
    pub beam: Option<usize>,
    /// File with taught activities; the user's own if omitted and there is one.
    #[arg(long, value_name = "FILE")]
    pub memory: Option<PathBuf>,
    /// Choose among these activities instead of describing freely: "boxing,squats,walking".
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    pub choose: Vec<String>,
    /// Follow this instruction instead of describing: a question or request about the motion, its length or its
    /// continuation, in words like those of instruction tuning. The model must have been tuned.
    #[arg(long, value_name = "TEXT", conflicts_with_all = ["choose", "memory"])]
    pub instruct: Option<String>,
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

/// `generate`.
#[derive(Args)]
pub struct GenerateArgs {
    /// The sentence.
    pub text: String,
    /// Output file of points, Parquet. Their source says that a model generated them.
    #[arg(long)]
    pub out: PathBuf,
    /// Also write a page with the points and what the model says of them, HTML.
    #[arg(long, value_name = "PAGE.html")]
    pub view: Option<PathBuf>,
    /// Model folder. The bundled model did not learn to generate.
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// Decoder of the language model.
    #[arg(long, value_enum, default_value = "f32")]
    pub decoder: DecoderName,
    /// Beam width; 1 is greedy.
    #[arg(long, default_value_t = 1)]
    pub beam: usize,
    /// Height of the radar above the floor, m.
    #[arg(long, default_value_t = 1.0)]
    pub radar_height_m: f32,
    /// Replace existing files.
    #[arg(long)]
    pub force: bool,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// `teach`.
#[derive(Args)]
pub struct TeachArgs {
    /// Name of the activity.
    #[arg(required_unless_present = "list")]
    pub name: Option<String>,
    /// Recordings of the activity and nothing else.
    pub recordings: Vec<String>,
    /// Sentence that describes it; that of the earlier examples if omitted.
    #[arg(long, value_name = "SENTENCE")]
    pub says: Option<String>,
    /// File with taught activities; the user's own if omitted.
    #[arg(long, value_name = "FILE")]
    pub memory: Option<PathBuf>,
    /// List what was taught.
    #[arg(long, conflicts_with_all = ["name", "recordings", "says"])]
    pub list: bool,
    /// How to read the recordings.
    #[command(flatten)]
    pub input: InputArgs,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// `forget`.
#[derive(Args)]
pub struct ForgetArgs {
    /// Name of the activity.
    pub name: String,
    /// File with taught activities; the user's own if omitted.
    #[arg(long, value_name = "FILE")]
    pub memory: Option<PathBuf>,
}

/// `eval`.
#[derive(Args)]
pub struct EvalArgs {
    /// Model folder; the bundled model if omitted.
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
    /// Decoder of the language model.
    #[arg(long, value_enum, default_value = "f32")]
    pub decoder: DecoderName,
    /// Search for the most probable sentence with N beams (1 is greedy) instead of a vote among drawn sentences.
    #[arg(long, value_name = "N")]
    pub beam: Option<usize>,
    /// Instead of captions: generate radar from the captions of N motions, and describe what was generated. The folder
    /// gets round-trip.json, round-trip.md and round-trip.jsonl.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(2..=1_000_000))]
    pub round_trip: Option<u64>,
    /// Sentence encoders.
    #[command(flatten)]
    pub encoders: EncoderArgs,
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
    /// Model folder; the bundled model if omitted.
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// Number of interventions: side, direction and action take turns.
    #[arg(long, default_value_t = 60)]
    pub count: usize,
    /// Seed of motions, placement and noise.
    #[arg(long, default_value_t = 1000)]
    pub seed: u64,
    /// Threads of the simulation; all cores if omitted.
    #[arg(long)]
    pub threads: Option<usize>,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// `eval-recordings`.
#[derive(Args)]
pub struct EvalRecordingsArgs {
    /// Recordings.
    #[command(flatten)]
    pub labelled: LabelledArgs,
    /// Which recordings are evaluated: those for `tuning`, which may be used to choose settings, or `judged` ones, which
    /// choose nothing and whose evaluations are logged.
    #[arg(long, default_value = "tuning")]
    pub role: Role,
    /// Log of evaluations of judged recordings.
    #[arg(long, value_name = "FILE", default_value = "docs/results/looks.csv")]
    pub looks: PathBuf,
    /// Reason for evaluating judged recordings, for the log.
    #[arg(long, value_name = "TEXT", required_if_eq("role", "judged"))]
    pub purpose: Option<String>,
    /// Instead of a model, a forest on simple features that is trained on the clips of these data sets: what their
    /// generator teaches, without training a network.
    #[arg(long, value_name = "DATA", num_args = 1.., conflicts_with_all = ["teach", "model"])]
    pub proxy: Vec<PathBuf>,
    /// Disturbed copies of every clip for the forest.
    #[arg(long, value_name = "N", default_value_t = 5, requires = "proxy")]
    pub proxy_copies: usize,
    /// Teach every activity by this many recordings for tuning, drawn at random, and evaluate the others. Counts also
    /// what is recognised in the recordings of each activity when all activities but this one are taught.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=100))]
    pub teach: Option<u64>,
    /// Draws of taught recordings.
    #[arg(long, value_name = "N", default_value_t = 3, requires = "teach")]
    pub draws: u64,
    /// Choose among these activities instead of describing freely: "boxing,squats,walking".
    #[arg(long, value_name = "LIST", value_delimiter = ',', conflicts_with_all = ["teach", "proxy"])]
    pub choose: Vec<String>,
    /// Model folder; the bundled model if omitted.
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// Search for the most probable sentence with N beams (1 is greedy) instead of a vote among drawn sentences.
    #[arg(long, value_name = "N")]
    pub beam: Option<usize>,
    /// Also write the report to this Markdown file.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Replace an existing report.
    #[arg(long)]
    pub force: bool,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// `eval-falls`.
#[derive(Args)]
pub struct EvalFallsArgs {
    /// TOML with radars, places, people, falls and other motions.
    pub config: PathBuf,
    /// Also count false alarms in recordings without falls: a configuration of `eval-recordings` and its folder. May be
    /// repeated.
    #[arg(long, num_args = 2, value_names = ["CONFIG", "DIR"])]
    pub recordings: Vec<PathBuf>,
    /// Which recordings are read: those for `tuning`, which may be used to choose settings, or `judged` ones, which choose
    /// nothing and whose evaluations are logged. May be repeated.
    #[arg(long, default_value = "tuning", requires = "recordings")]
    pub role: Vec<Role>,
    /// Log of evaluations of judged recordings.
    #[arg(long, value_name = "FILE", default_value = "docs/results/looks.csv")]
    pub looks: PathBuf,
    /// Reason for evaluating judged recordings, for the log.
    #[arg(long, value_name = "TEXT", required_if_eq("role", "judged"))]
    pub purpose: Option<String>,
    /// Simulate nothing: only count false alarms in recordings.
    #[arg(long, requires = "recordings")]
    pub recordings_only: bool,
    /// Threads of the simulation; all cores if omitted.
    #[arg(long)]
    pub threads: Option<usize>,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// Sentence encoders for BERTScore and SimCSE (feature `train`).
#[derive(Args)]
pub struct EncoderArgs {
    /// BERT or RoBERTa folder (config.json, model.safetensors, tokenizer.json) for BERTScore. Protocol
    /// motiongpt weights words by idf, the others do not.
    #[arg(long, value_name = "DIR")]
    pub bert_score: Option<PathBuf>,
    /// Layer for BERTScore, 17 for roberta-large, 6 for all-MiniLM-L6-v2.
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
    /// Device for BERT and RoBERTa: cpu (default), gpu, gpu:N, cuda or cuda:N (docs/guides/training-on-gpus.md).
    #[arg(long)]
    pub device: Option<String>,
}

impl EncoderArgs {
    /// Whether an encoder is named.
    pub fn are_given(&self) -> bool {
        self.bert_score.is_some() || self.sim_cse.is_some()
    }
}

/// `score`.
#[derive(Args)]
pub struct ScoreArgs {
    /// Candidates, JSON Lines {"id", "text"}; with --pose the estimated body.
    #[arg(long)]
    pub candidates: PathBuf,
    /// References, JSON Lines {"id", "texts": [...]}; with --pose the true body.
    #[arg(long)]
    pub references: PathBuf,
    /// Compare bodies instead of captions: npz as `motion mesh` writes it, or npy of joints (T, J, 3) or
    /// rotations (T, J, 3, 3).
    #[arg(long, conflicts_with_all = ["protocol", "max_references", "meteor_data", "bert_score", "layer", "sim_cse", "pooling", "device", "seed"])]
    pub pose: bool,
    /// plain, nlg-eval, coco or motiongpt.
    #[arg(long, default_value = "plain")]
    pub protocol: String,
    /// References used per item; 0 means all. The protocol motiongpt always uses 3.
    #[arg(long, default_value_t = 3)]
    pub max_references: usize,
    /// METEOR's own data: function/english.words, nonbreaking/english.prefixes, data/paraphrase-en.gz.
    ///
    /// The first two are in its jar, the third lies beside it. The built-in lists replace missing files (docs/reference/metrics.md).
    #[arg(long, value_name = "DIR")]
    pub meteor_data: Option<PathBuf>,
    /// Sentence encoders.
    #[command(flatten)]
    pub encoders: EncoderArgs,
    /// Seed of the bootstrap.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Print one JSON document, which is also the default.
    #[arg(long)]
    pub json: bool,
}

/// `view`.
#[derive(Args)]
pub struct ViewArgs {
    /// Recording of any format, points file, motion file or builtin:NAME?key=value.
    #[arg(value_name = "INPUT")]
    pub input_file: String,
    /// Output: a page with the points in motion (.html), or a figure of the points over time with the sentences (.svg).
    #[arg(long)]
    pub out: PathBuf,
    /// Model folder; the bundled model if omitted.
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
    /// The grid: base recipe, seeds, tables and rows; see docs/guides/ablations.md.
    pub config: PathBuf,
    /// Number of trainings that run at the same time and share the cores.
    #[arg(long, default_value_t = 1)]
    pub jobs: usize,
    /// Print finished and missing runs, and exit.
    #[arg(long)]
    pub plan: bool,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// `robustness`.
#[derive(Args)]
pub struct RobustnessArgs {
    /// Data set configuration, number of motions and conditions; see docs/guides/robustness.md.
    pub config: PathBuf,
    /// Folder for robustness.json, robustness.md, curves and finished cells, which are kept.
    #[arg(long)]
    pub out: PathBuf,
    /// Model folder; the bundled model if omitted.
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// Decoder of the language model.
    #[arg(long, value_enum, default_value = "f32")]
    pub decoder: DecoderName,
    /// Seed of the bootstrap.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Threads of the simulation; all cores if omitted.
    #[arg(long)]
    pub threads: Option<usize>,
    /// Print finished and missing cells, and exit.
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
    /// Run a forward pass: logits, or the last hidden states of BERT and RoBERTa.
    ///
    /// Example: radarllm lm logits --weights gpt2 --ids ids.json --out logits.npy
    Logits {
        /// Folder with config.json and model.safetensors (single or sharded).
        #[arg(long)]
        weights: PathBuf,
        /// JSON `{"input_ids": [[..]], "decoder_input_ids": [[..]]}`, rows of equal length;
        /// optional `attention_mask` of the same shape (1 token, 0 padding).
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
    /// Merge the adapters of a trained GPT-2 or Qwen2 into its weights, for programs without adapter support.
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
    /// Radar, signal chain and impairments; see docs/results/realism.md.
    pub config: PathBuf,
    /// Folder of recordings: NAME.parquet with a scene file NAME.toml that describes what happened, or the MARS data set, subjectN/timesplit/{radar,kinect}_data_PART.csv.
    #[arg(long)]
    pub recordings: PathBuf,
    /// Use only this part (MARS: train, validate or test; own recordings: NAME). May be repeated.
    #[arg(long)]
    pub part: Vec<String>,
    /// Estimate threshold, elevation bias, origin and azimuth step from the recordings, and write the configuration with
    /// them to this file. It must be in the folder of the radar file that it names.
    #[arg(long, value_name = "OUT.toml", conflicts_with_all = ["out", "json"])]
    pub calibrate: Option<PathBuf>,
    /// Also write the report into this Markdown file.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Replace an existing report.
    #[arg(long)]
    pub force: bool,
    /// Threads; all cores if omitted.
    #[arg(long)]
    pub threads: Option<usize>,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}
