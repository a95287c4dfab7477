//! The command line: all verbs. The flags of a verb are beside its command.

use clap::{Args, Parser, Subcommand};

use crate::commands::{
    ablate::AblateArgs,
    dataset::DatasetVerb,
    demo::DemoArgs,
    describe::DescribeArgs,
    generate::GenerateArgs,
    lm::LmVerb,
    motion::MotionVerb,
    process::ProcessArgs,
    radar::RadarVerb,
    score::ScoreArgs,
    simulate::SimulateArgs,
    site::SiteArgs,
    teach::{ForgetArgs, TeachArgs},
    train::TrainArgs,
    view::ViewArgs,
};

#[cfg(feature = "eval")]
use crate::commands::baselines::BaselinesVerb;
#[cfg(feature = "eval")]
use crate::commands::eval::{EvalVerb, FormerVerb};
#[cfg(feature = "live")]
use crate::commands::live::{AskArgs, LiveArgs};
#[cfg(feature = "eval")]
use crate::commands::reproduce::ReproduceVerb;

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
pub(crate) struct Cli {
    /// The verb.
    #[command(subcommand)]
    pub verb: Verb,
}

/// All verbs.
#[derive(Subcommand)]
pub(crate) enum Verb {
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
    /// Learn a site from recordings in which people walk: the tilt of the radar, and the height of a standing person.
    ///
    /// Example: radarllm site monday.dat tuesday.dat --radar people.cfg --out site.toml
    Site(SiteArgs),
    /// Teach an activity of your own by about three recordings; `describe` recognises it afterwards.
    ///
    /// Example: radarllm teach wheelchair --says "a person sits down in the wheelchair" a.dat b.dat c.dat
    Teach(TeachArgs),
    /// Forget a taught activity.
    ///
    /// Example: radarllm forget wheelchair
    Forget(ForgetArgs),
    #[cfg(feature = "live")]
    /// Describe what a radar sees while it happens, on a page, over MQTT and in a memory.
    ///
    /// Example: radarllm live /dev/ttyACM1 --cli-port /dev/ttyACM0 --radar profile.cfg --db live.db
    ///
    /// Example: radarllm live sim:
    Live(Box<LiveArgs>),
    #[cfg(feature = "live")]
    /// Answer a question about what `live` saw.
    ///
    /// Example: radarllm ask "when did she last get up?" --db live.db
    Ask(AskArgs),
    #[cfg(feature = "eval")]
    /// Ask questions of a model or of the virtual radar: captions, recordings, falls, interventions, robustness, realism.
    ///
    /// Example: radarllm eval captions --data work/data --out work/report
    #[command(subcommand)]
    Eval(EvalVerb),
    #[cfg(feature = "eval")]
    #[command(flatten)]
    FormerEval(FormerVerb),
    /// Compute caption metrics, or errors of estimated bodies.
    ///
    /// Example: radarllm score --pose --candidates estimated.npz --references true.npz
    Score(ScoreArgs),
    /// Write a self-contained page: points in 3D over time, mesh, caption.
    ///
    /// Example: radarllm view "builtin:walk" --out walk.html
    View(ViewArgs),
    /// Train and evaluate a grid of changed configurations, and print its tables.
    ///
    /// Example: radarllm ablate configs/train/mocap-ablation.toml
    Ablate(AblateArgs),
    #[cfg(feature = "eval")]
    /// Compare with other systems: estimated motions and language models, video language models, classifiers, floors.
    ///
    /// Example: radarllm baselines run configs/eval/baselines.toml
    #[command(subcommand)]
    Baselines(BaselinesVerb),
    #[cfg(feature = "eval")]
    /// Build, train and evaluate what the tables of a paper show, on one page.
    ///
    /// Example: radarllm reproduce paper --scale small --out work/paper
    #[command(subcommand)]
    Reproduce(ReproduceVerb),
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
pub(crate) struct JsonFlag {
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}
