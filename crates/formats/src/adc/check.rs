//! Checks, before processing, whether a capture matches the radar that is named for it.

use radarllm_base::RadarConfig;

use super::{CubeShape, FrameDecoder, LvdsLanes, SampleKind, SampleLayout};
use crate::{
    boards::Board,
    lint::{Finding, Severity},
};

/// Compares a capture of `n_bytes` in `layout` with `radar`.
///
/// Rules: `capture-layout` (error: radar and layout are incompatible), `capture-short` (error: less than one frame),
/// `capture-size` (warning: not an integer number of frames; names a radar that would give one), `capture-lanes`
/// (warning: the board has another number of lanes), `capture-real` (note: half of the range remains empty). Errors of
/// the radar alone are reported by [`mod@crate::lint`].
pub fn check_capture(radar: &RadarConfig, n_bytes: u64, layout: SampleLayout) -> Vec<Finding> {
    let mut findings = Vec::new();
    let mut add = |field: &str, rule, severity, message: String| {
        findings.push(Finding {
            field: field.into(),
            rule,
            severity,
            message,
            span: None,
        });
    };
    let board = Board::ALL.into_iter().find(|b| b.name() == radar.name);
    if let Some(limits) = board.and_then(Board::limits) {
        let n_lanes = match layout.lanes {
            LvdsLanes::Two => 2,
            LvdsLanes::Four { .. } => 4,
        };
        if limits.lvds_lanes != n_lanes {
            let message = format!(
                "read as {n_lanes} lanes, but an {} has {}",
                radar.name, limits.lvds_lanes
            );
            add("name", "capture-lanes", Severity::Warning, message);
        }
    }
    if layout.data == SampleKind::Real {
        let message = format!(
            "real samples show ranges up to {:.2} m, the rest up to {:.2} m stays empty",
            0.5 * radar.max_range_m(),
            radar.max_range_m()
        );
        add("n_samples", "capture-real", Severity::Note, message);
    }
    let shape = CubeShape::of(radar);
    let frame_bytes = match FrameDecoder::new(shape, layout) {
        Ok(decoder) => decoder.frame_bytes() as u64,
        Err(error) => {
            add("rx", "capture-layout", Severity::Error, error.to_string());
            return findings;
        }
    };
    let (n_frames, rest) = (n_bytes / frame_bytes, n_bytes % frame_bytes);
    let size = format!(
        "{n_bytes} bytes, and a frame of {} loops x {} slots x {} receivers x {} samples has {frame_bytes}",
        shape.n_loops, shape.n_tx, shape.n_rx, shape.n_samples
    );
    if n_frames == 0 {
        add("n_loops", "capture-short", Severity::Error, size);
    } else if rest != 0 {
        let mut message = format!("{size}: {n_frames} frames and {rest} bytes more");
        let fitting = other_shapes(shape, n_bytes, layout);
        if !fitting.is_empty() {
            message += &format!("; the size would fit {}", fitting.join(" or "));
        }
        add("n_loops", "capture-size", Severity::Warning, message);
    }
    findings
}

/// Changes of a single parameter for which the size is an integer number of frames.
fn other_shapes(shape: CubeShape, n_bytes: u64, layout: SampleLayout) -> Vec<String> {
    let mut fitting = Vec::new();
    let mut try_shape = |other: CubeShape, what: String| {
        let fits = FrameDecoder::new(other, layout)
            .is_ok_and(|d| n_bytes.is_multiple_of(d.frame_bytes() as u64));
        if fits && other != shape {
            fitting.push(what);
        }
    };
    for n_tx in 1..=3 {
        try_shape(CubeShape { n_tx, ..shape }, format!("{n_tx} slots"));
    }
    if layout.lanes == LvdsLanes::Two {
        for n_rx in 1..=4 {
            try_shape(CubeShape { n_rx, ..shape }, format!("{n_rx} receivers"));
        }
    }
    for n_loops in [16, 32, 64, 128, 255] {
        try_shape(CubeShape { n_loops, ..shape }, format!("{n_loops} loops"));
    }
    for n_samples in [64, 128, 256, 512] {
        try_shape(
            CubeShape { n_samples, ..shape },
            format!("{n_samples} samples"),
        );
    }
    fitting
}
