//! `baselines answers`: sentences of a video language model become the captions of a row. Nothing is cleaned and nothing cut.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

use clap::Args;
use serde::Serialize;

use super::{
    endpoint::Endpoint,
    prompts::{Answer, Render, Renders, file_name_of, read_answers},
};
use crate::{
    error::{CliError, CliResult},
    output,
};

/// Maximum length of the name of a row, characters.
const MAX_NAME_CHARS: usize = 80;

/// `baselines answers`.
#[derive(Args)]
pub(crate) struct AnswersArgs {
    /// Folder that `radarllm baselines render` wrote.
    pub renders: PathBuf,
    /// Answers, one JSON object a line: id, text, blake3 of the video, model, weights, commit.
    #[arg(required_unless_present = "endpoint", conflicts_with = "endpoint")]
    pub answers: Option<PathBuf>,
    /// Name of the row, which names the files too: letters, digits and `.`, `_`, `-`, `@`, `+`.
    #[arg(
        long = "as",
        value_name = "NAME",
        required_unless_present = "endpoint",
        conflicts_with = "endpoint"
    )]
    pub name: Option<String>,
    /// Data set folder of the videos.
    #[arg(long)]
    pub data: PathBuf,
    /// Folder: captions/NAME.jsonl and captions/NAME.json, which states what made them, are written in it.
    #[arg(long)]
    pub out: PathBuf,
    /// Write the first sentences too, as NAME-first-sentence: models say paragraphs where one sentence was asked for.
    #[arg(long)]
    pub first_sentence: bool,
    /// Ask a server with the interface of OpenAI's chat completions instead of reading answers, for example http://localhost:8000/v1.
    ///
    /// The row gets the name of the model that the server reports. The variable RADARLLM_ENDPOINT_TOKEN holds the bearer token, if one is needed. Answers are kept in OUT/answers, so that the same command continues after an interruption.
    #[arg(long, value_name = "URL")]
    pub endpoint: Option<String>,
    /// Model to ask for, if the server has several.
    #[arg(long, value_name = "MODEL", requires = "endpoint")]
    pub endpoint_model: Option<String>,
    /// Frames of each video that --endpoint sends as images, evenly spaced.
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u16).range(1..=256))]
    pub sample_frames: u16,
    /// Replace earlier captions.
    #[arg(long)]
    pub force: bool,
}

/// A caption.
#[derive(Serialize)]
struct Caption<'a> {
    id: &'a str,
    text: &'a str,
}

/// What made the captions.
#[derive(Serialize)]
struct Head<'a> {
    name: &'a str,
    model: &'a str,
    weights: &'a str,
    commit: &'a str,
    first_sentence: bool,
    /// BLAKE3 of render.json, which has the hashes of everything else.
    renders_blake3: &'a str,
    render: &'a Render,
}

/// Runs the command.
pub(crate) fn run(args: &AnswersArgs) -> CliResult {
    let renders = Renders::open(&args.renders)?;
    renders.check_data(&args.data)?;
    if let Some(name) = &args.name {
        check_name(name)?;
        check_files_free(args, name)?;
    }
    let (source, answers) = match (&args.endpoint, &args.answers) {
        (Some(url), _) => {
            let model = args.endpoint_model.as_deref();
            let endpoint = Endpoint::new(url, model, args.sample_frames.into())?;
            (url.clone(), endpoint.ask_all(&renders, &args.out)?)
        }
        (None, Some(path)) => (path.display().to_string(), read_answers(path)?),
        (None, None) => {
            return Err(CliError::new("no answers").hint("ANSWERS.jsonl, or --endpoint URL"));
        }
    };
    let answers = in_order(&source, &renders, answers)?;
    let Some(first) = answers.first() else {
        return Err(CliError::new(format!("{source}: no answers")));
    };
    let name = match &args.name {
        Some(name) => name.clone(),
        None => {
            let name: String = file_name_of(&first.model);
            name.trim_start_matches('.').to_string()
        }
    };
    check_name(&name)?;
    check_files_free(args, &name)?;
    for (name, is_first) in names(args, &name) {
        let captions = answers.iter().map(|answer| Caption {
            id: &answer.id,
            text: match is_first {
                true => first_sentence(&answer.text),
                false => &answer.text,
            },
        });
        let head = Head {
            name: &name,
            model: &first.model,
            weights: &first.weights,
            commit: &first.commit,
            first_sentence: is_first,
            renders_blake3: &renders.blake3,
            render: &renders.render,
        };
        let [lines_path, head_path] = files(&args.out, &name);
        // The head comes last: captions without it are not finished.
        let _ = fs::remove_file(&head_path);
        output::write_atomic(&lines_path, output::json_lines(captions)?.as_bytes())?;
        let head = serde_json::to_string_pretty(&head)?;
        output::write_atomic(&head_path, head.as_bytes())?;
        output::print_line(&format!(
            "{}: {} captions of {}",
            lines_path.display(),
            answers.len(),
            first.model
        ));
    }
    Ok(())
}

/// The names of what is written, and whether it has first sentences only.
fn names(args: &AnswersArgs, name: &str) -> Vec<(String, bool)> {
    let mut names = vec![(name.to_string(), false)];
    if args.first_sentence {
        names.push((format!("{name}-first-sentence"), true));
    }
    names
}

/// Captions and head of a name.
fn files(out: &Path, name: &str) -> [PathBuf; 2] {
    // Names may contain full stops, so that no extension is replaced.
    [".jsonl", ".json"].map(|end| out.join("captions").join(format!("{name}{end}")))
}

fn check_files_free(args: &AnswersArgs, name: &str) -> CliResult {
    for (name, _) in names(args, name) {
        for path in files(&args.out, &name) {
            output::check_free(&path, args.force)?;
        }
    }
    Ok(())
}

/// Refuses names that are no file names.
fn check_name(name: &str) -> CliResult {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "._-@+".contains(c);
    let starts_well = name.starts_with(|c: char| c.is_ascii_alphanumeric());
    if starts_well && name.chars().all(is_plain) && name.len() <= MAX_NAME_CHARS {
        return Ok(());
    }
    Err(CliError::new(format!("--as {name:?}: not a name of a row")).hint(format!(
        "1 to {MAX_NAME_CHARS} letters, digits and . _ - @ +, the first one a letter or digit: Video-LLaVA-7B@984e65b"
    )))
}

/// One answer for each prompt, in their order, all of one model about these videos. `source` names the answers in errors.
fn in_order(
    source: &str,
    renders: &Renders,
    answers: Vec<(usize, Answer)>,
) -> CliResult<Vec<Answer>> {
    let fail = |problem: String| Err(CliError::new(format!("{source}: {problem}")));
    let prompts_path = renders.prompts_path();
    let prompts_path = prompts_path.display();
    if let Some((_, first)) = answers.first() {
        for (line, answer) in &answers {
            for (what, own, other) in [
                ("model", &answer.model, &first.model),
                ("weights", &answer.weights, &first.weights),
                ("commit", &answer.commit, &first.commit),
            ] {
                if own.trim().is_empty() {
                    return fail(format!(
                        "line {line}: the answer about clip `{}` does not state its {what}",
                        answer.id
                    ));
                }
                if own != other {
                    return fail(format!(
                        "line {line}: the answer about clip `{}` states {what} `{own}`, the one about clip `{}` states `{other}`",
                        answer.id, first.id
                    ));
                }
            }
        }
    }
    let mut by_id: BTreeMap<String, (usize, Answer)> = BTreeMap::new();
    for (line, answer) in answers {
        if answer.text.trim().is_empty() {
            return fail(format!(
                "line {line}: the answer about clip `{}` is empty",
                answer.id
            ));
        }
        if let Some((earlier, _)) = by_id.get(&answer.id) {
            return fail(format!(
                "clip `{}` is answered in line {earlier} and in line {line}",
                answer.id
            ));
        }
        by_id.insert(answer.id.clone(), (line, answer));
    }
    let mut found = Vec::with_capacity(renders.prompts.len());
    for prompt in &renders.prompts {
        let Some((line, answer)) = by_id.remove(&prompt.id) else {
            return fail(format!(
                "no answer about clip `{}`, which {prompts_path} asks about with {}",
                prompt.id, prompt.video
            ));
        };
        if answer.blake3 != prompt.blake3 {
            return fail(format!(
                "line {line}: the answer about clip `{}` is about a video with BLAKE3 {}, and {prompts_path} states {} for {}",
                prompt.id, answer.blake3, prompt.blake3, prompt.video
            ));
        }
        found.push(answer);
    }
    match by_id.into_iter().next() {
        Some((id, (line, _))) => fail(format!(
            "line {line}: an answer about clip `{id}`, which {prompts_path} does not ask about"
        )),
        None => Ok(found),
    }
}

/// The text up to its first full stop, exclamation or question mark that ends a word.
fn first_sentence(text: &str) -> &str {
    let text = text.trim();
    let end = text.char_indices().find(|(at, c)| {
        let after = &text[at + c.len_utf8()..];
        matches!(c, '.' | '!' | '?') && (after.is_empty() || after.starts_with(char::is_whitespace))
    });
    end.map_or(text, |(at, c)| &text[..at + c.len_utf8()])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_sentence_ends_with_its_mark() {
        for (text, expected) in [
            (" A person walks. Then more.", "A person walks."),
            ("It moves 0.5 m! Yes", "It moves 0.5 m!"),
            ("no mark", "no mark"),
            ("...", "..."),
            ("é. ü", "é."),
        ] {
            assert_eq!(first_sentence(text), expected);
        }
    }

    #[test]
    fn names_of_rows_are_file_names() {
        for name in ["Video-LLaVA-7B@984e65b", "a", "gpt-4.1+x_1"] {
            assert!(check_name(name).is_ok(), "{name}");
        }
        let long = "a".repeat(MAX_NAME_CHARS + 1);
        for name in ["", ".", "..", "a/b", "a\\b", "-a", "a b", "é", "a\n", &long] {
            assert!(check_name(name).is_err(), "{name}");
        }
    }
}
