//! `radar list|show|lint`.

use std::path::Path;

use radarllm_base::RadarConfig;
use serde::Serialize;

use crate::{
    args::RadarVerb,
    error::{CliError, CliResult},
    output,
};

/// Derived figures, as scripts read them.
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
            carrier_hz: radar.carrier_hz(),
            sampled_bandwidth_hz: radar.sampled_bandwidth_hz(),
        }
    }
}

/// Opens a radar by built-in name or file, with a hint on failure.
pub fn open(name: &str) -> CliResult<RadarConfig> {
    radarllm_synth::synthesizer::open_radar(name, Path::new("")).map_err(|e| {
        CliError::new(e)
            .hint("`radarllm radar list` names the built-in radars; files end in .toml or .cfg")
    })
}

/// Runs the verb.
pub fn run(verb: &RadarVerb) -> CliResult {
    match verb {
        RadarVerb::List(args) => list(args.json),
        RadarVerb::Show { radar, json } => show(&open(radar)?, *json),
        RadarVerb::Lint { radar, json } => lint(&open(radar)?, *json),
    }
}

fn list(json: bool) -> CliResult {
    let figures: Vec<Figures> = radarllm_capture::builtin_radars()
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

fn show(radar: &RadarConfig, json: bool) -> CliResult {
    let f = Figures::from(radar);
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
        "{:<36} {} TX x {} RX, {} loops, {} samples",
        "cube", f.n_tx, f.n_rx, f.n_loops, f.n_samples
    ));
    Ok(())
}

fn lint(radar: &RadarConfig, json: bool) -> CliResult {
    let findings = radarllm_capture::lint(radar);
    if json {
        let rows: Vec<_> = findings
            .iter()
            .map(|f| serde_json::json!({"field": f.field, "message": f.message}))
            .collect();
        return output::print_json(&rows);
    }
    if findings.is_empty() {
        output::print_line("nothing to complain about");
    }
    for finding in findings {
        output::print_line(&format!("{}: {}", finding.field, finding.message));
    }
    Ok(())
}
