//! Finds what a recording tells about its radar: the board's direction bias, the place of the joints'
//! origin, the detector's threshold, the step of its azimuth spectrum.
//!
//! Every round simulates the takes, compares a few means, and corrects each value by the difference it
//! causes. The values are found on one part of the recordings and judged on another.

use std::path::Path;

use radarllm_base::{PointFrame, RadarPoint, stats::median_upper};
use radarllm_radar_dsp::Detector;
use radarllm_synth::synthesizer::open_radar;

use super::{RealismConfig, RealismError, Take, replay};

/// Corrections; the last rounds change little.
const ROUNDS: usize = 5;
/// A threshold this many dB higher is expected to halve the number of points, until a second round
/// tells better.
const HALVING_DB: f64 = 4.0;
/// Share of points exactly on boresight above the simulation's own that only fixed-point firmware
/// explains.
const PILE: f64 = 0.03;

/// What one round saw.
#[derive(Clone, Copy, Debug)]
pub struct Round {
    /// Number, from 1.
    pub round: usize,
    /// Points a frame, recorded and simulated.
    pub points: [f64; 2],
    /// Recorded less simulated mean range, m.
    pub range_m: f64,
    /// Recorded less simulated mean x / range.
    pub u_x: f64,
    /// Recorded less simulated mean z / range.
    pub u_z: f64,
    /// Share of points with x = 0, recorded and simulated.
    pub on_boresight: [f64; 2],
}

/// Means over the points of frames.
struct Means {
    per_frame: f64,
    range_m: f64,
    u_x: f64,
    u_z: f64,
    on_boresight: f64,
    median_db: f64,
}

/// A copy of the configuration with the values found; `seen` is called after every round.
///
/// The threshold is found for the detector `log_cfar` only; the others keep theirs.
///
/// # Errors
/// As [`replay()`]; a round without any simulated or recorded point.
pub fn calibrate(
    config: &RealismConfig,
    base: &Path,
    takes: &[Take],
    mut seen: impl FnMut(&Round),
) -> Result<RealismConfig, RealismError> {
    let mut config = config.clone();
    let options = config.processing.resolve(&open_radar(&config.radar, base)?);
    let log_cfar = matches!(options.detector, Detector::LogCfar { .. });
    let mut detector = log_cfar.then_some(options.detector);
    let recorded: Vec<PointFrame> = takes
        .iter()
        .flat_map(|t| t.frames.iter().cloned())
        .collect();
    let real = means(&config, &recorded)?;
    let mut last_threshold: Option<(f64, f64)> = None;
    let mut last_step: Option<(f64, f64)> = None;
    for round in 1..=ROUNDS {
        let simulated: Vec<PointFrame> = replay(&config, base, takes)?
            .into_iter()
            .flatten()
            .collect();
        let ours = means(&config, &simulated)?;
        seen(&Round {
            round,
            points: [real.per_frame, ours.per_frame],
            range_m: real.range_m - ours.range_m,
            u_x: real.u_x - ours.u_x,
            u_z: real.u_z - ours.u_z,
            on_boresight: [real.on_boresight, ours.on_boresight],
        });
        config.elevation_bias += real.u_z - ours.u_z;
        config.joints_origin_m[0] += ((real.u_x - ours.u_x) * real.range_m) as f32;
        config.joints_origin_m[1] += (real.range_m - ours.range_m) as f32;

        if let Some(Detector::LogCfar {
            threshold_db: threshold,
            ..
        }) = &mut detector
        {
            let missing = (real.per_frame / ours.per_frame).log2();
            let halvings = ours.per_frame.log2();
            let db_per_halving = slope(last_threshold, (*threshold, -halvings), HALVING_DB);
            last_threshold = Some((*threshold, -halvings));
            *threshold = (*threshold - missing * db_per_halving).clamp(3.0, 60.0);
            config.processing.detector = detector;
        }
        let excess = real.on_boresight - ours.on_boresight;
        match config.processing.azimuth_step_db {
            // A first guess a little below the median amplitude, then by what it does.
            None if excess > PILE => {
                config.processing.azimuth_step_db = Some(ours.median_db - 16.0)
            }
            None => {}
            Some(step_db) => {
                let db_per_share = slope(last_step, (step_db, ours.on_boresight), 60.0);
                last_step = Some((step_db, ours.on_boresight));
                config.processing.azimuth_step_db =
                    Some(step_db + (excess * db_per_share).clamp(-6.0, 6.0));
            }
        }
    }
    Ok(config)
}

/// Change of the knob per change of its effect since the last round, if that is sensible (positive
/// and within a factor of four of `usual`).
fn slope(last: Option<(f64, f64)>, now: (f64, f64), usual: f64) -> f64 {
    last.map(|l| (now.0 - l.0) / (now.1 - l.1))
        .filter(|s| (usual / 4.0..=usual * 4.0).contains(s))
        .unwrap_or(usual)
}

fn means(config: &RealismConfig, frames: &[PointFrame]) -> Result<Means, RealismError> {
    let mut kept = Vec::new();
    for frame in frames {
        let mut frame = frame.clone();
        config.crop(&mut frame);
        kept.extend(frame.points);
    }
    let n = kept.len() as f64;
    let mean = |value: &dyn Fn(&RadarPoint) -> f64| kept.iter().map(value).sum::<f64>() / n;
    let per_range =
        |v: f32, p: &RadarPoint| f64::from(v) / f64::from(p.range_m).max(f64::MIN_POSITIVE);
    let median_db =
        median_upper(kept.iter().map(|p| p.intensity_db)).ok_or(RealismError::NoPoints)?;
    Ok(Means {
        per_frame: n / frames.len() as f64,
        range_m: mean(&|p| f64::from(p.range_m)),
        u_x: mean(&|p| per_range(p.x_m, p)),
        u_z: mean(&|p| per_range(p.z_m, p)),
        on_boresight: mean(&|p| f64::from(u8::from(p.x_m == 0.0))),
        median_db: f64::from(median_db),
    })
}
