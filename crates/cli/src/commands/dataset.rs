//! `dataset build|info|validate`.

use std::{
    path::Path,
    sync::{Mutex, PoisonError},
    time::{Duration, Instant},
};

use radarllm_dataset::{Dataset, Overwrite, builder::BuildOptions};
use radarllm_eval::held_out::validate_with_held_out;
use radarllm_synth::{build, config::DatasetConfig};

use radarllm_files::bounded::{self as files, MAX_CONFIG_BYTES};

use crate::{
    args::DatasetVerb,
    error::{CliError, CliResult},
    output, threads,
};

/// Time between progress lines.
const PROGRESS_EVERY: Duration = Duration::from_secs(5);

/// Runs the command.
pub fn run(verb: &DatasetVerb) -> CliResult {
    match verb {
        DatasetVerb::Build {
            config,
            out,
            threads,
            force,
            json,
        } => build(config, out, *threads, *force, *json),
        DatasetVerb::Info { dir, json } => info(dir, *json),
        DatasetVerb::Validate { dir, json } => validate(dir, *json),
    }
}

fn build(
    config_path: &Path,
    out: &Path,
    threads: Option<usize>,
    force: bool,
    json: bool,
) -> CliResult {
    let text = files::read_text(config_path, MAX_CONFIG_BYTES)?;
    let config = DatasetConfig::from_toml(&text)
        .map_err(|e| CliError::new(format!("{}: {e}", config_path.display())))?;
    let base = config_path.parent().unwrap_or(Path::new(""));
    let options = BuildOptions {
        threads: threads::threads(threads),
        overwrite: if force {
            Overwrite::Replace
        } else {
            Overwrite::Refuse
        },
        retry_failed: false,
    };
    let started = Instant::now();
    let last_line = Mutex::new(Instant::now());
    let report = build::build(&config, base, out, options, |progress| {
        let mut last = last_line.lock().unwrap_or_else(PoisonError::into_inner);
        if last.elapsed() < PROGRESS_EVERY {
            return;
        }
        *last = Instant::now();
        let seconds = started.elapsed().as_secs_f64();
        let left_s =
            seconds / progress.n_done.max(1) as f64 * (progress.n_items - progress.n_done) as f64;
        eprintln!(
            "{} of {} clips, {} failed, {} of {} shards, {:.1} clips/s, about {:.0} min left",
            progress.n_done,
            progress.n_items,
            progress.n_failed,
            progress.n_shards_done,
            progress.n_shards,
            progress.n_done as f64 / seconds,
            left_s / 60.0
        );
    })?;
    let manifest = &report.manifest;
    if json {
        return output::print_json(&serde_json::json!({
            "clips": manifest.n_clips,
            "failed": manifest.n_failed,
            "skipped": manifest.skipped.len(),
            "shards": manifest.shards.len(),
            "shards_made": report.n_made_shards,
            "seconds": started.elapsed().as_secs_f64(),
        }));
    }
    output::print_line(&format!(
        "{}: {} clips in {} shards ({} made now), {} failed",
        out.display(),
        manifest.n_clips,
        manifest.shards.len(),
        report.n_made_shards,
        manifest.n_failed
    ));
    for skipped in &manifest.skipped {
        eprintln!("left out: {}: {}", skipped.id, skipped.reason);
    }
    for failed in manifest.shards.iter().flat_map(|s| &s.failed) {
        eprintln!("failed: {}: {}", failed.id, failed.reason);
    }
    Ok(())
}

fn info(dir: &Path, json: bool) -> CliResult {
    let info = Dataset::open(dir)?.info()?;
    if json {
        return output::print_json(&info);
    }
    output::print_line(&serde_json::to_string_pretty(&info)?);
    Ok(())
}

fn validate(dir: &Path, json: bool) -> CliResult {
    let found = validate_with_held_out(dir)?;
    let lines: Vec<String> = found
        .problems
        .iter()
        .map(|p| {
            let id =
                p.id.as_ref()
                    .map(|id| format!(": {id}"))
                    .unwrap_or_default();
            format!("{}{id}: {}", p.file, p.problem)
        })
        .collect();
    if json {
        output::print_json(&serde_json::json!({ "problems": lines, "held_out": found.held_out }))?;
    } else {
        if lines.is_empty() {
            output::print_line("no problems");
        }
        for line in &lines {
            output::print_line(line);
        }
        let held_out = &found.held_out;
        if let Some([least, five, median]) = held_out.distances {
            output::print_line(&format!(
                "nearest training motion of {} held-out clips: distance {least:.4} rad at least, {five:.4} at 5 %, {median:.4} \
                 median; a leak is below {}",
                held_out.judged, held_out.leak_distance
            ));
        }
        if held_out.not_judged > 0 {
            output::print_line(&format!(
                "{} held-out clips could not be compared: no joints, too short, or hardly moving",
                held_out.not_judged
            ));
        }
    }
    match lines.len() {
        0 => Ok(()),
        n => Err(CliError::new(format!("{}: {n} problems", dir.display()))),
    }
}
