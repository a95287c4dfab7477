//! `teach` and `forget`: activities of the user's own.

use std::path::{Path, PathBuf};

use clap::Args;
use radarllm::teach::Memory;

use crate::{
    commands::describe::{self, Detail},
    error::{CliError, CliResult},
    output,
    recording_args::InputArgs,
    user_memory::memory_path,
};

/// `teach`.
#[derive(Args)]
pub(crate) struct TeachArgs {
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
pub(crate) struct ForgetArgs {
    /// Name of the activity.
    pub name: String,
    /// File with taught activities; the user's own if omitted.
    #[arg(long, value_name = "FILE")]
    pub memory: Option<PathBuf>,
}

/// Runs `teach`.
pub(crate) fn run(args: &TeachArgs) -> CliResult {
    let path = memory_path(args.memory.as_deref())?;
    let memory = match path.exists() {
        true => Memory::load(&path)?,
        false => Memory::default(),
    };
    let Some(name) = args.name.as_deref() else {
        return list(&path, &memory, args.json);
    };
    if args.recordings.is_empty() {
        return Err(CliError::new("no recordings to learn from")
            .hint("radarllm teach NAME --says SENTENCE RECORDING..."));
    }
    let known = memory.activities().iter().find(|a| a.name == name);
    let says = match (&args.says, known) {
        (Some(says), _) => says.clone(),
        (None, Some(known)) => known.says.clone(),
        (None, None) => {
            return Err(CliError::new(format!("what is said about `{name}`?"))
                .hint("--says \"a person sits down in the wheelchair\""));
        }
    };
    let options = args.input.options()?;
    // Recordings are read before the memory is locked, because that can take a while.
    let mut clips = Vec::new();
    for input in &args.recordings {
        let recording = radarllm::open(input)
            .with_options(options.clone())
            .points()?;
        let (clip, _) = describe::prepared(input, &recording, Detail::All)?;
        if clip.provenance.is_simulated() {
            note!("warning: {input}: simulated points; recordings of your own radar teach more");
        }
        clips.push(clip);
    }
    let memory = Memory::update(&path, |memory| -> CliResult<Memory> {
        for clip in &clips {
            for warning in memory.teach(name, &says, clip.moving())? {
                note!("warning: {warning}");
            }
        }
        Ok(memory.clone())
    })?;
    for warning in memory.doubts() {
        note!("warning: {warning}");
    }
    let taught = memory.activities().iter().find(|a| a.name == name);
    let n_examples = taught.map_or(0, |a| a.examples.len());
    if args.json {
        return list(&path, &memory, true);
    }
    output::print_line(&format!(
        "{name}: {n_examples} examples in {}{}",
        path.display(),
        match n_examples {
            0..=2 => "; three or more are recommended",
            _ => "",
        }
    ));
    Ok(())
}

/// Runs `forget`.
pub(crate) fn forget(args: &ForgetArgs) -> CliResult {
    let path = memory_path(args.memory.as_deref())?;
    if !path.exists() {
        // Says which file is missing; forgetting begins none.
        Memory::load(&path)?;
    }
    let forgotten = Memory::update(&path, |memory| -> CliResult<_> {
        Ok(memory.forget(&args.name)?)
    })?;
    output::print_line(&format!(
        "{}: {} examples forgotten, {}",
        forgotten.name,
        forgotten.examples.len(),
        path.display()
    ));
    Ok(())
}

fn list(path: &Path, memory: &Memory, json: bool) -> CliResult {
    if json {
        return output::print_json(&memory.overview());
    }
    if memory.activities().is_empty() {
        output::print_line(&format!("{}: nothing was taught", path.display()));
    }
    for taught in memory.activities() {
        output::print_line(&format!("{}: \"{}\"", taught.name, taught.says));
        for example in &taught.examples {
            output::print_line(&format!(
                "    {} ({:.1} s, radar {})",
                example.source, example.seconds, example.radar
            ));
        }
    }
    Ok(())
}
