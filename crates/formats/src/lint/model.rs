//! Compares a radar with the training data of a model.

use radarllm_base::RadarConfig;

use super::{Report, Severity, rules};

/// Training data of a model, as far as they are known.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelExpectations {
    /// Name for reports.
    pub model: String,
    /// Frame rate that the model reads, Hz.
    pub frame_rate_hz: f64,
    /// Number of strongest points per frame that the model reads.
    pub max_points: usize,
    /// Radars of its training data, as far as they are recorded and known.
    pub radars: Vec<RadarConfig>,
}

/// Recordings whose frame rate differs from a model's by more than this fraction are resampled, because a model
/// measures time in frames.
const RATE_TOLERANCE: f64 = 0.05;
/// Bins coarser than in training by this factor change the appearance of a body.
const COARSER: f64 = 2.0;
/// A maximum speed or an array smaller by this factor makes a different radar.
const SMALLER: f64 = 0.75;

/// Compares a valid radar with the most similar one of the training data. If a rule for all models has already reported
/// a problem, no finding is added.
pub(super) fn compare(report: &mut Report, radar: &RadarConfig, model: &ModelExpectations) {
    let name = &model.model;
    let rate_hz = radar.frame_rate_hz();
    if rate_hz > model.frame_rate_hz * (1.0 + RATE_TOLERANCE) {
        let message = format!(
            "{rate_hz:.2} frames/s, but {name} reads {:.0}: `describe` joins frames",
            model.frame_rate_hz
        );
        report.add(
            Severity::Note,
            "model-frame-rate",
            "frame_period_s",
            message,
        );
    } else if rate_hz < model.frame_rate_hz * (1.0 - RATE_TOLERANCE) {
        let message = format!(
            "{rate_hz:.2} frames/s, but {name} reads {:.0}: frames between stay empty, as in none of its \
             training; a period of {:.0} ms fits",
            model.frame_rate_hz,
            1e3 / model.frame_rate_hz
        );
        report.add(
            Severity::Warning,
            "model-frame-rate",
            "frame_period_s",
            message,
        );
    }
    let all = model.radars.iter().map(|t| unlike(report, radar, t, name));
    match all.min_by_key(Vec::len) {
        Some(remarks) => {
            for (rule, place, message) in remarks {
                report.add(Severity::Warning, rule, place, message);
            }
        }
        None => {
            let message = format!(
                "{name} does not say which radar it was trained on: velocity, range and array are not compared"
            );
            report.add(Severity::Note, "model-radar", "name", message);
        }
    }
}

/// Rule, place and message of each property in which `trained` is better than `radar`.
fn unlike(
    report: &Report,
    radar: &RadarConfig,
    trained: &RadarConfig,
    name: &str,
) -> Vec<(&'static str, &'static str, String)> {
    let mut out = Vec::new();
    let moves = !report.has(&["single-loop"]);
    let coarse_velocity = report.has(&["velocity-resolution"]);
    let coarse_range = report.has(&["range-resolution"]);
    let folds = report.has(&["velocity-ambiguity"]);
    let flat = report.has(&["no-azimuth"]);
    let mut warn = |rule, place, message: String| out.push((rule, place, message));
    let (v, trained_v) = (radar.max_velocity_mps(), trained.max_velocity_mps());
    if moves && !folds && v < SMALLER * trained_v {
        let message = format!(
            "speeds fold at {v:.2} m/s, in the training of {name} at {trained_v:.2} m/s: quick limbs \
             come with the wrong sign"
        );
        warn("model-velocity", rules::slow_part(radar), message);
    }
    let (bin, trained_bin) = (
        radar.velocity_resolution_mps(),
        trained.velocity_resolution_mps(),
    );
    if moves && !coarse_velocity && bin > COARSER * trained_bin {
        let message = format!(
            "velocity bins of {bin:.3} m/s, in the training of {name} {trained_bin:.3} m/s: slow \
             movements vanish with the clutter"
        );
        warn("model-velocity-resolution", "n_loops", message);
    }
    let (bin, trained_bin) = (radar.range_resolution_m(), trained.range_resolution_m());
    if !coarse_range && bin > COARSER * trained_bin {
        let message = format!(
            "range bins of {bin:.3} m, in the training of {name} {trained_bin:.3} m: a body gives fewer \
             points"
        );
        warn("model-range-resolution", "slope_hz_per_s", message);
    }
    // Apertures are compared in wavelengths, because these determine the angular resolution.
    let aperture = |r: &RadarConfig| rules::aperture_m(r).map(|m| m / r.wavelength_m());
    let ([width, height], [trained_width, trained_height]) = (aperture(radar), aperture(trained));
    if height < 0.01 && trained_height > 0.01 {
        let message = format!(
            "the array sees no elevation, in the training of {name} it did: with every point at radar \
             height, sentences cannot be trusted"
        );
        warn("model-array", "tx", message);
    }
    if !flat && width < SMALLER * trained_width {
        let message = format!(
            "the array is {width:.1} wavelengths wide, in the training of {name} {trained_width:.1}: points \
             scatter more to the sides"
        );
        let place = if radar.rx.len() < trained.rx.len() {
            "rx"
        } else {
            "tx"
        };
        warn("model-array", place, message);
    }
    out
}
