//! The `radarllm` command, as a function: the binary and the Python package run it.
//!
//! Exit codes: 0 done, 1 the user can fix it (cause and `hint:` on stderr), 2 unexpected, 130 interrupted. The allocator
//! is absent: the binary chooses it, because the process of a Python package belongs to others too.

#![cfg_attr(
    test,
    allow(clippy::disallowed_methods, unreachable_pub, reason = "tests")
)]

/// Writes a line to stderr. Where nobody reads it, the work goes on.
macro_rules! note {
    ($($text:tt)*) => {
        $crate::output::note(format_args!($($text)*))
    };
}

mod args;
mod commands;
mod error;
#[cfg(feature = "train")]
mod interrupt;
#[cfg(feature = "train")]
mod log;
mod memory;
mod model;
#[cfg_attr(not(feature = "train"), allow(dead_code))]
mod model_args;
mod output;
mod person_report;
mod progress;
mod radar_file;
mod recording_args;
mod threads;
mod user_memory;

use std::{ffi::OsString, io::ErrorKind, panic};

use args::{Cli, Verb};
use clap::Parser;

/// Runs the command with these arguments, of which the first is the name of the program, and returns the exit code.
pub fn run(args: impl IntoIterator<Item = OsString>) -> u8 {
    #[cfg(feature = "eval")]
    let args = commands::eval::with_verb(args);
    let cli = match Cli::try_parse_from(args) {
        Ok(cli) => cli,
        Err(error) => {
            let printed = error.print();
            // clap's own exit code for a usage error is 2. Here the code 1 denotes errors that the user can fix.
            return match printed {
                Err(problem) if !error.use_stderr() && problem.kind() != ErrorKind::BrokenPipe => {
                    output::stdout_error(&problem).report();
                    1
                }
                _ => u8::from(error.use_stderr()),
            };
        }
    };
    #[cfg(feature = "train")]
    log::to_stderr();
    let outcome = panic::catch_unwind(|| match cli.verb {
        Verb::Demo(args) => commands::demo::run(&args),
        Verb::Motion(verb) => commands::motion::run(&verb),
        Verb::Radar(verb) => commands::radar::run(&verb),
        Verb::Simulate(args) => commands::simulate::run(&args),
        Verb::Process(args) => commands::process::run(&args),
        Verb::Dataset(verb) => commands::dataset::run(&verb),
        Verb::Train(args) => commands::train::run(&args),
        Verb::Describe(args) => commands::describe::run(&args),
        Verb::Generate(args) => commands::generate::run(&args),
        Verb::Site(args) => commands::site::run(&args),
        Verb::Teach(args) => commands::teach::run(&args),
        Verb::Forget(args) => commands::teach::forget(&args),
        #[cfg(feature = "live")]
        Verb::Live(args) => commands::live::run(&args),
        #[cfg(feature = "live")]
        Verb::Ask(args) => commands::live::answer(&args),
        #[cfg(feature = "eval")]
        Verb::Eval(verb) => commands::eval::run(&verb),
        #[cfg(feature = "eval")]
        Verb::FormerEval(verb) => commands::eval::run(&verb.into()),
        Verb::Score(args) => commands::score::run(&args),
        Verb::View(args) => commands::view::run(&args),
        Verb::Ablate(args) => commands::ablate::run(&args),
        #[cfg(feature = "eval")]
        Verb::Baselines(verb) => commands::baselines::run(&verb),
        #[cfg(feature = "eval")]
        Verb::Reproduce(verb) => commands::reproduce::run(&verb),
        Verb::Lm(verb) => commands::lm::run(&verb),
        Verb::Doctor(args) => commands::doctor::run(&args),
        Verb::Completions { shell } => commands::shell::completions(shell),
        Verb::Man => commands::shell::manual(),
    });
    match outcome {
        Ok(Ok(())) => 0,
        Ok(Err(error)) => {
            error.report();
            if error.is_bug {
                note!("this is a bug of radarllm, not of your input");
                return 2;
            }
            1
        }
        Err(_) => {
            note!("error: this is a bug of radarllm, not of your input; the lines above say where");
            2
        }
    }
}
