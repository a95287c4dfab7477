//! `eval`: questions asked of a model or of the virtual radar.

mod boards;
pub(crate) mod captions;
mod falls;
pub(crate) mod instructions;
mod interventions;
mod page;
mod realism;
pub(crate) mod recordings;
mod robustness;

use std::ffi::OsString;

use clap::Subcommand;

use crate::error::CliResult;

/// `eval ...`.
#[derive(Subcommand)]
pub(crate) enum EvalVerb {
    /// Captions of a split of a data set, with all metrics, intervals and baselines.
    ///
    /// Example: radarllm eval captions --data work/data --out work/report
    Captions(captions::CaptionsArgs),
    /// Captions of recordings in folders by activity: how many name the recorded activity?
    ///
    /// Example: radarllm eval recordings configs/eval/recorded-radhar.toml --recordings radhar
    Recordings(Box<recordings::EvalRecordingsArgs>),
    /// Recordings of several boards in turn: presence, postures, falls and activities, with the mean over the boards that
    /// nothing was learned from.
    ///
    /// Example: radarllm eval boards configs/eval/boards.toml --data recordings
    Boards(boards::EvalBoardsArgs),
    /// Simulate falls and what looks like falls: how many does a running radar notice, and how often is it wrong?
    ///
    /// Example: radarllm eval falls configs/eval/falls.toml --recordings configs/eval/recorded-radhar.toml radhar
    Falls(falls::EvalFallsArgs),
    /// Change one parameter of a built-in motion and count how often the caption follows.
    ///
    /// Example: radarllm eval interventions --count 120
    Interventions(interventions::InterventionsArgs),
    /// Ask about the clips of a split, in words that no training had: which way, which side, how often, what first?
    ///
    /// Example: radarllm eval instructions configs/eval/instructions.toml --data work/data --out work/report
    Instructions(instructions::InstructionsArgs),
    /// Captions of the same motions under noise, distance, rain and other conditions, as tables and curves.
    ///
    /// Example: radarllm eval robustness configs/eval/robustness.toml --out robustness
    Robustness(robustness::RobustnessArgs),
    /// Compare simulated with recorded points of the same movements: how realistic is the virtual radar?
    ///
    /// Example: radarllm eval realism configs/eval/realism-mars.toml --recordings mars
    Realism(realism::RealismArgs),
}

/// The verbs of `eval` under the names that they had outside it. Scripts use them.
#[derive(Subcommand)]
pub(crate) enum FormerVerb {
    /// The same as `eval recordings`.
    #[command(hide = true)]
    EvalRecordings(Box<recordings::EvalRecordingsArgs>),
    /// The same as `eval falls`.
    #[command(hide = true)]
    EvalFalls(falls::EvalFallsArgs),
    /// The same as `eval interventions`.
    #[command(hide = true, alias = "edits")]
    Interventions(interventions::InterventionsArgs),
    /// The same as `eval robustness`.
    #[command(hide = true)]
    Robustness(robustness::RobustnessArgs),
    /// The same as `eval realism`.
    #[command(hide = true)]
    Realism(realism::RealismArgs),
}

impl From<FormerVerb> for EvalVerb {
    fn from(verb: FormerVerb) -> Self {
        match verb {
            FormerVerb::EvalRecordings(args) => Self::Recordings(args),
            FormerVerb::EvalFalls(args) => Self::Falls(args),
            FormerVerb::Interventions(args) => Self::Interventions(args),
            FormerVerb::Robustness(args) => Self::Robustness(args),
            FormerVerb::Realism(args) => Self::Realism(args),
        }
    }
}

/// Runs the command.
pub(crate) fn run(verb: &EvalVerb) -> CliResult {
    match verb {
        EvalVerb::Captions(args) => captions::run(args),
        EvalVerb::Recordings(args) => recordings::run(args),
        EvalVerb::Boards(args) => boards::run(args),
        EvalVerb::Falls(args) => falls::run(args),
        EvalVerb::Interventions(args) => interventions::run(args),
        EvalVerb::Instructions(args) => instructions::run(args),
        EvalVerb::Robustness(args) => robustness::run(args),
        EvalVerb::Realism(args) => realism::run(args),
    }
}

/// Arguments of the program in which `eval --data ...`, the former spelling of `eval captions --data ...`, is replaced.
pub(crate) fn with_verb(args: impl IntoIterator<Item = OsString>) -> Vec<OsString> {
    let mut args: Vec<OsString> = args.into_iter().collect();
    let is_flag = |arg: &OsString| arg.to_string_lossy().starts_with('-');
    let is_help = |arg: &OsString| arg == "-h" || arg == "--help";
    let is_former = args.get(1).is_some_and(|verb| verb == "eval")
        && args.get(2).is_some_and(|arg| is_flag(arg) && !is_help(arg));
    if is_former {
        args.insert(2, "captions".into());
    }
    args
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flags_after_eval_are_those_of_captions() {
        for (before, after) in [
            ("radarllm eval --data d", "radarllm eval captions --data d"),
            (
                "radarllm eval captions --data d",
                "radarllm eval captions --data d",
            ),
            ("radarllm eval realism x", "radarllm eval realism x"),
            ("radarllm eval --help", "radarllm eval --help"),
            ("radarllm eval", "radarllm eval"),
            (
                "radarllm describe eval --beam 2",
                "radarllm describe eval --beam 2",
            ),
        ] {
            let args = before.split(' ').map(OsString::from);
            let expected: Vec<OsString> = after.split(' ').map(OsString::from).collect();
            assert_eq!(with_verb(args), expected, "{before}");
        }
    }
}
