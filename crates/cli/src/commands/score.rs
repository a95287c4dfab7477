//! `score`: caption metrics alone.

use std::{fs, path::Path};

use radarllm_metrics::{Candidate, Protocol, Reference, ScoreOptions, score};
use serde::Deserialize;

use crate::{
    args::ScoreArgs,
    error::{CliError, CliResult},
    output,
};

#[derive(Deserialize)]
struct CandidateLine {
    id: serde_json::Value,
    text: String,
}

#[derive(Deserialize)]
struct ReferenceLine {
    id: serde_json::Value,
    texts: Vec<String>,
}

/// Runs the verb.
pub fn run(args: &ScoreArgs) -> CliResult {
    let _ = args.json;
    for (flag, given) in [
        ("--bert-score", args.bert_score.is_some()),
        ("--sim-cse", args.sim_cse.is_some()),
    ] {
        if given {
            return Err(CliError::new(format!("{flag}: not supported yet"))
                .hint("leave the flag out; the field is then null"));
        }
    }
    let protocol = Protocol::from_name(&args.protocol).ok_or_else(|| {
        CliError::new(format!("--protocol {}: unknown", args.protocol))
            .hint("plain, nlg-eval, coco or motiongpt")
    })?;
    let candidates: Vec<Candidate> = read_lines::<CandidateLine>(&args.candidates)?
        .into_iter()
        .map(|c| Candidate {
            id: id_text(&c.id),
            text: c.text,
        })
        .collect();
    let references: Vec<Reference> = read_lines::<ReferenceLine>(&args.references)?
        .into_iter()
        .map(|r| Reference {
            id: id_text(&r.id),
            texts: r.texts,
        })
        .collect();
    let options = ScoreOptions {
        protocol,
        max_references: args.max_references,
        seed: args.seed,
        ..ScoreOptions::default()
    };
    output::print_json(&score(&candidates, &references, &options)?)
}

fn id_text(id: &serde_json::Value) -> String {
    id.as_str().map_or_else(|| id.to_string(), String::from)
}

/// Reads JSON lines; blank lines are skipped, anything else malformed is an error with its line.
fn read_lines<T: for<'a> Deserialize<'a>>(path: &Path) -> CliResult<Vec<T>> {
    let text = fs::read_to_string(path).map_err(|e| CliError::io(path, e))?;
    text.lines()
        .enumerate()
        .filter(|(_, line)| !line.trim().is_empty())
        .map(|(index, line)| {
            serde_json::from_str(line)
                .map_err(|e| CliError::new(format!("{}:{}: {e}", path.display(), index + 1)))
        })
        .collect()
}
