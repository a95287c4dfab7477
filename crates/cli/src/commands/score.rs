//! `score`: caption metrics alone.

use std::{
    io::{BufRead, BufReader, Read},
    path::{Path, PathBuf},
};

use clap::Args;
use flate2::read::GzDecoder;
use radarllm::CaptionScores;
use radarllm_files::bounded;
use radarllm_metrics::{
    Candidate, Protocol, Reference, ScoreOptions,
    meteor::{Paraphrases, Resources},
    score_with,
};
use serde::Deserialize;

#[cfg(feature = "train")]
use crate::commands::model_scores;
#[cfg(feature = "eval")]
use crate::commands::pose_scores;
use crate::{
    error::{CliError, CliResult},
    model_args::EncoderArgs,
    output,
};

/// `score`.
#[derive(Args)]
pub(crate) struct ScoreArgs {
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

/// Maximum length of a line of a captions file, bytes.
const MAX_LINE_BYTES: u64 = 16 << 20;
/// Maximum size of a list of words or abbreviations, bytes.
const MAX_LIST_BYTES: u64 = 1 << 20;

/// First bytes of some files of UTF-8.
const BYTE_ORDER_MARK: &[u8] = "\u{feff}".as_bytes();

#[derive(Deserialize)]
struct CandidateLine {
    id: Id,
    text: String,
}

#[derive(Deserialize)]
struct ReferenceLine {
    id: Id,
    texts: Vec<String>,
}

/// A text or an integer, which are equivalent.
#[derive(Deserialize)]
#[serde(untagged, expecting = "`id` must be text or a whole number")]
enum Id {
    Text(String),
    Number(i64),
}

impl Id {
    fn into_text(self) -> String {
        match self {
            Id::Text(text) => text,
            Id::Number(number) => number.to_string(),
        }
    }
}

/// Runs the command.
pub(crate) fn run(args: &ScoreArgs) -> CliResult {
    let _ = args.json;
    if args.pose {
        #[cfg(feature = "eval")]
        return pose_scores::run(&args.candidates, &args.references);
        #[cfg(not(feature = "eval"))]
        return Err(CliError::new(
            "--pose needs a build with the feature `eval`, which this binary lacks",
        )
        .hint("cargo build --release --locked -p radarllm-cli --features eval"));
    }
    let with_model = args.encoders.are_given();
    if args.encoders.device.is_some() && !with_model {
        return Err(
            CliError::new("--device: only --bert-score and --sim-cse compute on a device")
                .hint("leave it out, or name a checkpoint"),
        );
    }
    #[cfg(not(feature = "train"))]
    if with_model {
        return Err(crate::error::needs_training("--bert-score or --sim-cse"));
    }
    let protocol = Protocol::from_name(&args.protocol).ok_or_else(|| {
        CliError::new(format!("--protocol {}: unknown", args.protocol))
            .hint("plain, nlg-eval, coco or motiongpt")
    })?;
    if args.meteor_data.is_some() && protocol == Protocol::MotionGpt {
        return Err(CliError::new(
            "--meteor-data: protocol motiongpt has nltk's METEOR, which does not use it",
        )
        .hint("leave the flag out, or take another protocol"));
    }
    let resources = args
        .meteor_data
        .as_deref()
        .map_or_else(|| Ok(Resources::default()), read_meteor_data)?;
    let candidates: Vec<Candidate> = read_lines(&args.candidates, |c: CandidateLine| Candidate {
        id: c.id.into_text(),
        text: c.text,
    })?;
    let references: Vec<Reference> = read_lines(&args.references, |r: ReferenceLine| Reference {
        id: r.id.into_text(),
        texts: r.texts,
    })?;
    let options = ScoreOptions {
        protocol,
        max_references: args.max_references,
        seed: args.seed,
        ..ScoreOptions::default()
    };
    #[cfg_attr(
        not(feature = "train"),
        expect(unused_mut, reason = "nothing is added")
    )]
    let mut scores = score_with(&candidates, &references, &options, &resources)?;
    #[cfg(feature = "train")]
    if let Some(encoders) = model_scores::Encoders::open(&args.encoders)? {
        encoders.add(&mut scores, &candidates, &references, args.seed)?;
    }
    output::print_json(&CaptionScores::new(scores, &candidates, &references))
}

/// Reads JSON lines and skips blank lines and the byte order mark that some editors write. The error names the first invalid line and the number of the others.
fn read_lines<L: for<'a> Deserialize<'a>, T>(
    path: &Path,
    item: impl Fn(L) -> T,
) -> CliResult<Vec<T>> {
    let io = |e| CliError::io(path, e);
    let mut file = BufReader::new(bounded::open(path)?);
    let (mut items, mut line) = (Vec::new(), Vec::new());
    let (mut first_error, mut n_errors) = (None, 0_usize);
    for number in 1_usize.. {
        line.clear();
        let n = (&mut file)
            .take(MAX_LINE_BYTES + 1)
            .read_until(b'\n', &mut line)
            .map_err(io)?;
        if n == 0 {
            break;
        }
        if n as u64 > MAX_LINE_BYTES {
            return Err(CliError::new(format!(
                "{}:{number}: longer than 16 MiB",
                path.display()
            )));
        }
        let bytes = match number {
            1 => line.strip_prefix(BYTE_ORDER_MARK).unwrap_or(&line),
            _ => &line,
        };
        let parsed = match std::str::from_utf8(bytes) {
            Ok(text) if text.trim().is_empty() => continue,
            Ok(text) => serde_json::from_str(text).map_err(|e| e.to_string()),
            Err(e) => Err(format!("not UTF-8 after {} bytes", e.valid_up_to())),
        };
        match parsed {
            Ok(parsed) => items.push(item(parsed)),
            Err(e) => {
                n_errors += 1;
                first_error.get_or_insert_with(|| format!("{}:{number}: {e}", path.display()));
            }
        }
    }
    match first_error {
        None => Ok(items),
        Some(cause) if n_errors == 1 => Err(CliError::new(cause)),
        Some(cause) => Err(CliError::new(format!(
            "{cause} ({n_errors} lines are wrong)"
        ))),
    }
}

/// Reads METEOR's word lists from a folder, which must contain at least one of them.
fn read_meteor_data(folder: &Path) -> CliResult<Resources> {
    let mut resources = Resources::default();
    let mut found = false;
    if let Some(text) = read_list(&folder.join("function/english.words"))? {
        (resources, found) = (resources.with_function_words(&text), true);
    }
    if let Some(text) = read_list(&folder.join("nonbreaking/english.prefixes"))? {
        (resources, found) = (resources.with_abbreviations(&text), true);
    }
    let path = folder.join("data/paraphrase-en.gz");
    if path.exists() {
        let file = bounded::open(&path)?;
        let table = Paraphrases::read(BufReader::new(GzDecoder::new(file)))
            .map_err(|e| CliError::new(format!("{}: {e}", path.display())))?;
        (resources, found) = (resources.with_paraphrases(table), true);
    }
    if found {
        return Ok(resources);
    }
    Err(CliError::new(format!("--meteor-data {}: holds none of METEOR's files", folder.display())).hint(
        "expected function/english.words, nonbreaking/english.prefixes or data/paraphrase-en.gz in it",
    ))
}

fn read_list(path: &Path) -> CliResult<Option<String>> {
    if !path.exists() {
        return Ok(None);
    }
    let io = |e| CliError::io(path, e);
    let mut text = String::new();
    let n = bounded::open(path)?
        .take(MAX_LIST_BYTES + 1)
        .read_to_string(&mut text)
        .map_err(io)?;
    if n as u64 > MAX_LIST_BYTES {
        return Err(CliError::new(format!(
            "{}: larger than 1 MiB",
            path.display()
        )));
    }
    Ok(Some(text))
}
