//! `radar list|show|lint`.

use std::path::{Path, PathBuf};

use clap::Subcommand;
use radarllm::{BundledModel, ModelFiles, OpenedRadar};
use radarllm_base::{RadarConfig, radar_config::TxMultiplexing};
use radarllm_formats::{Finding, ModelExpectations, Severity, Span};
use radarllm_inference::{FRAME_RATE_HZ, tokenizer::encode::TokenizerFile};
use radarllm_io::{RadarSource, read_radar_text};
use serde::Serialize;

use crate::{
    args::JsonFlag,
    commands::calibrate::{self, CalibrateArgs},
    error::{CliError, CliResult},
    output,
    radar_file::{open, unknown},
};

/// `radar ...`.
#[derive(Subcommand)]
pub(crate) enum RadarVerb {
    /// List the built-in radars.
    List(JsonFlag),
    /// Print the derived figures of a radar. Of a chirp file without a cube, print what points need and why there is none.
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
        /// Model folder to compare with, or a bundled model: `features` (the default) or `tokens`.
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

/// Maximum length of a quotation from a source line, characters.
const MAX_EXCERPT: usize = 100;

/// Derived figures for the JSON output.
#[derive(Serialize)]
struct Figures {
    name: String,
    range_resolution_m: f64,
    max_range_m: f64,
    velocity_resolution_mps: f64,
    max_velocity_mps: f64,
    frame_rate_hz: f64,
    n_tx: usize,
    n_rx: usize,
    n_loops: usize,
    n_samples: usize,
    #[serde(rename = "firing")]
    multiplexing: &'static str,
    carrier_hz: f64,
    sampled_bandwidth_hz: f64,
}

impl From<&RadarConfig> for Figures {
    fn from(radar: &RadarConfig) -> Self {
        Self {
            name: radar.name.clone(),
            range_resolution_m: radar.range_resolution_m(),
            max_range_m: radar.max_range_m(),
            velocity_resolution_mps: radar.velocity_resolution_mps(),
            max_velocity_mps: radar.max_velocity_mps(),
            frame_rate_hz: radar.frame_rate_hz(),
            n_tx: radar.tx.len(),
            n_rx: radar.rx.len(),
            n_loops: radar.n_loops,
            n_samples: radar.n_samples,
            multiplexing: match radar.multiplexing {
                TxMultiplexing::Tdm => "tdm",
                TxMultiplexing::Bpm => "bpm",
            },
            carrier_hz: radar.carrier_hz(),
            sampled_bandwidth_hz: radar.sampled_bandwidth_hz(),
        }
    }
}

/// Runs the command.
pub(crate) fn run(verb: &RadarVerb) -> CliResult {
    match verb {
        RadarVerb::List(args) => list(args.json),
        RadarVerb::Show { radar, json } => show(radar, &open(radar)?, *json),
        RadarVerb::Lint { radar, model, json } => lint(radar, model.as_deref(), *json),
        RadarVerb::Calibrate(args) => calibrate::run(args),
    }
}

fn list(json: bool) -> CliResult {
    let figures: Vec<Figures> = radarllm_formats::builtin_radars()
        .iter()
        .map(Figures::from)
        .collect();
    if json {
        return output::print_json(&figures);
    }
    for f in figures {
        output::print_line(&format!(
            "{:<16} {} TX x {} RX, {:.2} GHz, range {:.3} m up to {:.2} m, velocity {:.3} m/s up to {:.2} m/s",
            f.name,
            f.n_tx,
            f.n_rx,
            f.carrier_hz / 1e9,
            f.range_resolution_m,
            f.max_range_m,
            f.velocity_resolution_mps,
            f.max_velocity_mps
        ));
    }
    Ok(())
}

/// What is known of a chirp file without a cube, for the JSON output.
#[derive(Serialize)]
struct PointFigures<'a> {
    name: &'a str,
    dialect: Option<String>,
    frame_rate_hz: f64,
    range_resolution_m: Option<f64>,
    max_range_m: Option<f64>,
    velocity_resolution_mps: Option<f64>,
    max_velocity_mps: Option<f64>,
    carrier_hz: Option<f64>,
    sampled_bandwidth_hz: Option<f64>,
    radar_height_m: Option<f64>,
    tilt_deg: Option<f64>,
    yaw_deg: Option<f64>,
    /// A radar with the same bins that is simulated.
    simulated: Option<Figures>,
    /// Why there is no cube.
    no_cube: Vec<String>,
}

impl<'a> PointFigures<'a> {
    fn of(radar: &'a OpenedRadar) -> Self {
        let points = &radar.points;
        let position = points.position;
        Self {
            name: &points.name,
            dialect: points.dialect.map(|d| d.to_string()),
            frame_rate_hz: points.frame_rate_hz(),
            range_resolution_m: points.range_resolution_m,
            max_range_m: points.max_range_m,
            velocity_resolution_mps: points.velocity_resolution_mps,
            max_velocity_mps: points.max_velocity_mps,
            carrier_hz: points.carrier_hz,
            sampled_bandwidth_hz: points.sampled_bandwidth_hz,
            radar_height_m: position.map(|p| p.height_m),
            tilt_deg: position.map(|p| p.elevation_tilt_rad.to_degrees()),
            yaw_deg: position.map(|p| p.azimuth_tilt_rad.to_degrees()),
            simulated: radar.config().ok().map(Figures::from),
            no_cube: radar.reasons().iter().map(ToString::to_string).collect(),
        }
    }
}

/// Prints what points need. A mistake in the file is an error in the end.
fn show_points(name: &str, radar: &OpenedRadar, json: bool) -> CliResult {
    let f = PointFigures::of(radar);
    if json {
        output::print_json(&f)?;
    } else {
        let printable = |text: &str| -> String { text.chars().map(printable).collect() };
        let row = |name: &str, value: &str| {
            output::print_line(&format!("{name:<36} {}", printable(value)));
        };
        row("device or board", f.name);
        row("dialect", f.dialect.as_deref().unwrap_or("not known"));
        let hz = |value: Option<f64>| value.map(|v| v / 1e9);
        for (name, value, unit) in [
            ("range resolution", f.range_resolution_m, "m"),
            ("maximum range", f.max_range_m, "m"),
            ("velocity resolution", f.velocity_resolution_mps, "m/s"),
            ("maximum velocity", f.max_velocity_mps, "m/s, either way"),
            ("frame rate", Some(f.frame_rate_hz), "frames/s"),
            (
                "carrier (centre of the ADC window)",
                hz(f.carrier_hz),
                "GHz",
            ),
            ("sampled bandwidth", hz(f.sampled_bandwidth_hz), "GHz"),
            ("radar height", f.radar_height_m, "m"),
            ("tilt", f.tilt_deg, "degrees"),
            ("yaw", f.yaw_deg, "degrees"),
        ] {
            match value {
                Some(value) => row(name, &format!("{value:.4} {unit}")),
                None => row(name, "not known"),
            }
        }
        if let Some(s) = &f.simulated {
            row(
                "simulated with the same bins as",
                &format!(
                    "{} TX ({}) x {} RX, {} loops, {} complex samples",
                    s.n_tx, s.multiplexing, s.n_rx, s.n_loops, s.n_samples
                ),
            );
        }
        for reason in &f.no_cube {
            row("no cube", reason);
        }
    }
    match radar.reasons().iter().find(|e| !e.is_unsupported()) {
        None => Ok(()),
        Some(mistake) => Err(CliError::new(format!("{name}: {mistake}")).hint(format!(
            "`radarllm radar lint {name}` shows the place in the file"
        ))),
    }
}

fn show(name: &str, radar: &OpenedRadar, json: bool) -> CliResult {
    let Ok(config) = radar.sample_config() else {
        return show_points(name, radar, json);
    };
    let f = Figures::from(config);
    if json {
        return output::print_json(&f);
    }
    for (name, value, unit) in [
        ("range resolution", f.range_resolution_m, "m"),
        ("maximum range", f.max_range_m, "m"),
        ("velocity resolution", f.velocity_resolution_mps, "m/s"),
        ("maximum velocity", f.max_velocity_mps, "m/s, either way"),
        ("frame rate", f.frame_rate_hz, "frames/s"),
        (
            "carrier (centre of the ADC window)",
            f.carrier_hz / 1e9,
            "GHz",
        ),
        ("sampled bandwidth", f.sampled_bandwidth_hz / 1e9, "GHz"),
    ] {
        output::print_line(&format!("{name:<36} {value:.4} {unit}"));
    }
    output::print_line(&format!(
        "{:<36} {} TX ({}) x {} RX, {} loops, {} samples",
        "cube", f.n_tx, f.multiplexing, f.n_rx, f.n_loops, f.n_samples
    ));
    Ok(())
}

fn lint(name: &str, model: Option<&Path>, json: bool) -> CliResult {
    let expected = expectations(model)?;
    let (text, findings) = match read_radar_text(name).map_err(unknown)? {
        Some(RadarSource::TiCfg(text)) => {
            let file = Path::new(name).file_name().unwrap_or_default();
            let file = file.to_string_lossy();
            let findings = radarllm_formats::lint_ti_cfg_named(&file, &text, Some(&expected));
            (text, findings)
        }
        Some(RadarSource::Toml(text)) => {
            let findings = radarllm_formats::lint_radar_toml(&text, Some(&expected));
            (text, findings)
        }
        // There is no text to quote: built-in radars have none, and exports of mmWave Studio are not edited by hand.
        _ => (
            String::new(),
            radarllm_formats::lint(open(name)?.config()?, Some(&expected)),
        ),
    };
    let count = |severity| findings.iter().filter(|f| f.severity == severity).count();
    let summary = [Severity::Error, Severity::Warning, Severity::Note]
        .map(|severity| match count(severity) {
            1 => format!("1 {severity}"),
            n => format!("{n} {severity}s"),
        })
        .join(", ");
    if json {
        let rows: Vec<Remark> = findings.iter().map(Remark::from).collect();
        output::print_json(&rows)?;
    } else {
        for finding in &findings {
            print_finding(name, &text, finding);
        }
        output::print_line(match findings.is_empty() {
            true => "nothing to complain about",
            false => &summary,
        });
    }
    match count(Severity::Error) {
        0 => Ok(()),
        _ => Err(CliError::new(format!("{name} does not pass: {summary}"))),
    }
}

/// Training data of a model folder or of the embedded model. Only the configuration is read.
fn expectations(model: Option<&Path>) -> CliResult<ModelExpectations> {
    const CONFIG: &str = "tokenizer/config.json";
    let files = ModelFiles::of(model);
    let text = files.text(CONFIG).map_err(|e| {
        CliError::from(e).hint("--model wants a folder made by `radarllm train all`")
    })?;
    let file: TokenizerFile = serde_json::from_str(&text)
        .map_err(|e| CliError::new(format!("{}/{CONFIG}: {e}", files.name())))?;
    let names = file.training["radars"].as_array();
    let names = names.into_iter().flatten().filter_map(|n| n.as_str());
    let radars = names.filter_map(radarllm_formats::builtin_radar).collect();
    Ok(ModelExpectations {
        model: match &files {
            ModelFiles::Folder(folder) => format!("the model in {}", folder.display()),
            ModelFiles::Bundled(BundledModel::Features) => "the default model".into(),
            ModelFiles::Bundled(bundled) => format!("the bundled model `{}`", bundled.name()),
        },
        frame_rate_hz: f64::from(FRAME_RATE_HZ),
        max_points: file.model.grouping.max_points,
        radars,
    })
}

/// A finding for the JSON output.
#[derive(Serialize)]
struct Remark<'a> {
    field: &'a str,
    rule: &'a str,
    severity: String,
    message: &'a str,
    line: Option<usize>,
    column: Option<usize>,
    length: Option<usize>,
    /// The command or key, and which of its values.
    value: Option<&'a str>,
}

impl<'a> From<&'a Finding> for Remark<'a> {
    fn from(finding: &'a Finding) -> Self {
        let span = finding.span.as_ref();
        Self {
            field: &finding.field,
            rule: finding.rule,
            severity: finding.severity.to_string(),
            message: &finding.message,
            line: span.map(|s| s.line),
            column: span.map(|s| s.columns.start),
            length: span.map(|s| s.columns.len()),
            value: span.map(|s| s.what.as_str()),
        }
    }
}

fn print_finding(name: &str, text: &str, finding: &Finding) {
    let place = finding.span.as_ref().map_or(String::new(), |s| {
        format!(":{}:{}", s.line, s.columns.start)
    });
    // Messages may quote the file, which may contain control characters.
    let message: String = finding.message.chars().map(printable).collect();
    output::print_line(&format!(
        "{name}{place}: {}[{}]: {message}",
        finding.severity, finding.rule
    ));
    if let Some(span) = &finding.span {
        let (excerpt, marks) = excerpt(text.lines().nth(span.line - 1).unwrap_or(""), span);
        output::print_line(&format!("{:>5} | {excerpt}", span.line));
        output::print_line(&format!("{:>5} | {marks}", ""));
    }
}

/// A character that occupies one column and that terminals do not interpret as a control character.
fn printable(c: char) -> char {
    match c {
        '\t' => ' ',
        c if c.is_control() => '\u{fffd}',
        c => c,
    }
}

/// The part of a line around a span, and the line of carets and name below it.
fn excerpt(line: &str, span: &Span) -> (String, String) {
    let skipped = (span.columns.start - 1).saturating_sub(MAX_EXCERPT / 2);
    let shown: String = line
        .chars()
        .skip(skipped)
        .take(MAX_EXCERPT)
        .map(printable)
        .collect();
    let indent = span.columns.start - 1 - skipped;
    let length = span.columns.len().min(MAX_EXCERPT - indent).max(1);
    let what: String = span.what.chars().map(printable).collect();
    let marks = format!("{}{} {what}", " ".repeat(indent), "^".repeat(length));
    (shown, marks.trim_end().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn carets_stand_below_their_value() {
        let span = |columns| Span {
            line: 1,
            columns,
            what: "cfg value".into(),
        };
        let (line, marks) = excerpt("cfg\t12 \u{1b}34", &span(5..7));
        assert_eq!(line, "cfg 12 \u{fffd}34");
        assert_eq!(marks, "    ^^ cfg value");
        let long = "x".repeat(300);
        let (line, marks) = excerpt(&long, &span(201..300));
        assert_eq!(line.len(), 100);
        assert_eq!(marks.matches('^').count(), 50);
    }
}
