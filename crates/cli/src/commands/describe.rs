//! `describe`: points, capture or motion to a sentence.

use std::{path::Path, time::Instant};

use radarllm_base::Timeline;
use radarllm_inference::lm::{Captioner, Decoder, Description, Precision};
use serde::Serialize;

use crate::{
    args::{DecoderName, DescribeArgs},
    commands::eval::peak_memory_mb,
    error::{CliError, CliResult},
    input::{self, Clip, ClipOptions, Provenance},
    output,
    people::Person,
    recording,
};

/// Frame rates that differ by less than this share are heard as they are.
const RATE_TOLERANCE: f64 = 0.05;

/// One described input, as scripts read it.
#[derive(Serialize)]
pub struct Row {
    /// The sentence, or `no person seen`.
    pub caption: String,
    /// Why there is no sentence, when there is none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// exp(mean log-probability of the words), 0..1; 0 when nothing was described.
    pub confidence: f32,
    /// The input and how it came to be.
    #[serde(flatten)]
    pub provenance: Provenance,
    /// Model name.
    pub model: String,
    /// Radar tokens read.
    pub tokens: Vec<u32>,
    /// Radar frames read.
    pub frames: usize,
    /// Length of the clip, s.
    pub clip_seconds: f64,
    /// Time from points to sentence, s.
    pub seconds: f64,
    /// Most memory that this process has held, MB (Linux).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub peak_memory_mb: Option<f64>,
    /// Whom it is about, with `--people`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub person: Option<Person>,
}

/// Name of a model in reports.
pub fn model_name(model: Option<&Path>) -> String {
    model.map_or_else(
        || "default (embedded)".into(),
        |path| path.display().to_string(),
    )
}

/// Loads a model folder, or the default that the binary carries, for the f32 engine.
pub fn load_captioner(model: Option<&Path>) -> CliResult<Captioner> {
    load_for(model, Decoder::Engine(Precision::F32))
}

fn load_for(model: Option<&Path>, decoder: Decoder) -> CliResult<Captioner> {
    match model {
        Some(path) => Captioner::load(path, decoder).map_err(|e| {
            CliError::new(format!("{}: {e}", path.display()))
                .hint("--model wants a folder made by `radarllm train all`")
        }),
        None => crate::default_model::load(decoder),
    }
}

/// Loads a model for a decoder, with the model's name, which tells when it is an approximation.
pub fn load_decoder(model: Option<&Path>, decoder: DecoderName) -> CliResult<(Captioner, String)> {
    let name = model_name(model);
    let (decoder, name) = match decoder {
        DecoderName::F32 => (Decoder::Engine(Precision::F32), name),
        DecoderName::Int8 => (Decoder::Engine(Precision::Int8), format!("{name}, int8")),
        #[cfg(feature = "train")]
        DecoderName::Training => (Decoder::Training, name),
        #[cfg(not(feature = "train"))]
        DecoderName::Training => return Err(crate::error::needs_training("--decoder training")),
    };
    Ok((load_for(model, decoder)?, name))
}

/// An input as models hear it: at their frame rate, and of a recording what moves.
///
/// # Errors
/// An input that cannot be read, a rate that cannot be.
pub fn heard(input: &str, options: &ClipOptions) -> CliResult<Clip> {
    let recording = options.recording;
    let mut clip = input::clip(input, options)?;
    // Points that somebody kept by saying so stay.
    if !clip.provenance.synthetic
        && recording.slowest.is_none()
        && let Some(note) = recording::leave_out_surroundings(&mut clip.frames)
    {
        eprintln!("{}: {note}", clip.provenance.source);
    }
    let rate_hz = f64::from(radarllm_inference::lm::FRAME_RATE_HZ);
    if (clip.frame_rate_hz / rate_hz - 1.0).abs() > RATE_TOLERANCE {
        let line = Timeline::from_frames(clip.frames, clip.frame_rate_hz);
        let line = recording::resample(&line, rate_hz, recording.follow)?;
        clip.frames = line.frames;
        clip.frame_rate_hz = line.frame_rate_hz;
    }
    Ok(clip)
}

/// Describes a clip.
pub fn describe(captioner: &Captioner, clip: &Clip, model: String, beam: usize) -> CliResult<Row> {
    let started = Instant::now();
    // A model hears time in frames: a clip at another rate would be a lie about speed.
    let rate_hz = f64::from(radarllm_inference::lm::FRAME_RATE_HZ);
    if (clip.frame_rate_hz / rate_hz - 1.0).abs() > RATE_TOLERANCE {
        return Err(CliError::new(format!(
            "{}: {:.2} frames/s, but the model reads {rate_hz:.2} frames/s",
            clip.provenance.source, clip.frame_rate_hz
        ))
        .hint("for recorded points: `radarllm process CAPTURE --resample 10`"));
    }
    let described: Description = captioner.describe(&clip.frames, clip.radar_height_m, beam)?;
    Ok(Row {
        caption: described.caption,
        reason: described.abstained.map(|why| why.to_string()),
        confidence: described.confidence,
        provenance: clip.provenance.clone(),
        model,
        tokens: described.tokens,
        frames: clip.frames.len(),
        clip_seconds: clip.frames.len() as f64 / clip.frame_rate_hz,
        seconds: started.elapsed().as_secs_f64(),
        peak_memory_mb: peak_memory_mb(),
        person: None,
    })
}

/// One line for people.
pub fn print_row(row: &Row) {
    let kind = if row.provenance.synthetic {
        "simulated"
    } else {
        "recorded"
    };
    let who = row.person.as_ref().map_or(String::new(), |p| {
        format!(" (person {}, {:.1} s to {:.1} s)", p.id, p.start_s, p.end_s)
    });
    output::print_line(&format!(
        "{}{who}\n    {}",
        row.provenance.source, row.caption
    ));
    let why = row
        .reason
        .as_ref()
        .map(|r| format!("; {r}"))
        .unwrap_or_default();
    output::print_line(&format!(
        "    [{kind}, radar {}, {:.1} s, confidence {:.2}, model {}{why}]",
        row.provenance.radar, row.clip_seconds, row.confidence, row.model
    ));
}

/// Runs the verb.
pub fn run(args: &DescribeArgs) -> CliResult {
    if !(1..=64).contains(&args.beam) {
        return Err(CliError::new(format!(
            "--beam {}: must be in 1..=64",
            args.beam
        )));
    }
    let (captioner, model) = load_decoder(args.model.as_deref(), args.decoder)?;
    let options = ClipOptions {
        radar: args.radar.as_deref(),
        format: args.format.as_deref(),
        recording: &args.recording,
        radar_height_m: args.radar_height_m,
        distance_m: 3.0,
        seed: args.seed,
    };
    let mut rows = Vec::new();
    for input in &args.inputs {
        let clip = heard(input, &options)?;
        for (person, clip) in args.people.clips(clip)? {
            let mut row = describe(&captioner, &clip, model.clone(), args.beam)?;
            row.person = person;
            if !args.json {
                print_row(&row);
            }
            rows.push(row);
        }
    }
    if args.json {
        return output::print_json(&rows);
    }
    Ok(())
}
