//! `doctor`: reports for each feature what this machine provides and what is missing.

use radarllm::Model;
use serde::Serialize;

use crate::{args::JsonFlag, error::CliResult, output, threads};

#[derive(Serialize)]
struct Report {
    version: &'static str,
    architecture: &'static str,
    os: &'static str,
    threads: usize,
    cpu_features: Vec<&'static str>,
    checks: Vec<Check>,
}

#[derive(Serialize)]
struct Check {
    feature: &'static str,
    ok: bool,
    detail: String,
}

/// Runs the command.
pub(crate) fn run(args: &JsonFlag) -> CliResult {
    let report = Report {
        version: env!("CARGO_PKG_VERSION"),
        architecture: std::env::consts::ARCH,
        os: std::env::consts::OS,
        threads: threads::threads(None),
        cpu_features: cpu_features(),
        checks: vec![default_model(), training(), gpu()],
    };
    if args.json {
        return output::print_json(&report);
    }
    output::print_line(&format!(
        "radarllm {} on {} {}",
        report.version, report.os, report.architecture
    ));
    output::print_line(&format!(
        "threads: {}; vector units: {}",
        report.threads,
        report.cpu_features.join(" ")
    ));
    for check in &report.checks {
        let mark = if check.ok { "ok     " } else { "missing" };
        output::print_line(&format!("{mark}  {}: {}", check.feature, check.detail));
    }
    Ok(())
}

fn cpu_features() -> Vec<&'static str> {
    #[cfg(target_arch = "x86_64")]
    {
        let mut found = vec!["sse2"];
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
            found.push("avx2+fma");
        }
        if is_x86_feature_detected!("avx512f") {
            found.push("avx512f");
        }
        found
    }
    #[cfg(target_arch = "aarch64")]
    {
        vec!["neon"]
    }
    #[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
    {
        vec!["portable"]
    }
}

fn default_model() -> Check {
    let loaded = Model::bundled().and_then(|model| model.networks().map(|_| ()));
    Check {
        feature: "default model (demo, describe, view)",
        ok: loaded.is_ok(),
        detail: match loaded {
            Ok(()) => "embedded, loads and is ready".into(),
            Err(error) => error.to_string(),
        },
    }
}

fn training() -> Check {
    let ok = cfg!(feature = "train");
    Check {
        feature: "training (train, ablate, lm, --decoder training, BERTScore, SimCSE)",
        ok,
        detail: match ok {
            true => "in this build".into(),
            false => "cargo build --release --locked -p radarllm-cli --features train".into(),
        },
    }
}

#[cfg(not(any(feature = "gpu", feature = "cuda", feature = "libtorch")))]
fn gpu() -> Check {
    Check {
        feature: "GPU training",
        ok: false,
        detail: "this build runs on the CPU; nothing above needs a GPU".into(),
    }
}

/// Whether a GPU can be opened, and its name.
#[cfg(any(feature = "gpu", feature = "cuda", feature = "libtorch"))]
fn gpu() -> Check {
    use radarllm_nn::device::Processor;

    let processor = if cfg!(feature = "gpu") {
        Processor::Gpu(None)
    } else if cfg!(feature = "cuda") {
        Processor::Cuda(None)
    } else {
        Processor::LibTorch(None)
    };
    let (ok, detail) = match processor.name() {
        Ok(name) => (true, format!("--device {processor}: {name}")),
        Err(e) => (false, e.to_string()),
    };
    Check {
        feature: "GPU training",
        ok,
        detail,
    }
}
