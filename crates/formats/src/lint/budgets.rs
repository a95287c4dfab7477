//! Budgets of memory, LVDS and the serial port.

use super::{ModelExpectations, Report, Severity, Subject};
use crate::boards::Board;
use crate::ti_cfg::GuiMonitor;

/// Size of a complex sample on the chip and over LVDS, bytes: two 16-bit numbers.
const SAMPLE_BYTES: u64 = 4;
/// Lane rate of TI's firmware and default of mmWave Studio, bit/s.
const LVDS_LANE_BPS: f64 = 600e6;
/// Ethernet data rate of the DCA1000 with its default packet delay of 25 us and with the shortest of 5 us, bit/s. TI
/// SPRUIJ4, "DCA1000EVM data capture card", table of packet delays; the figures were not checked against the document.
const ETHERNET_DEFAULT_BPS: f64 = 325e6;
const MAX_ETHERNET_BPS: f64 = 706e6;
/// Data port of the demos: 921,600 baud with ten bits per byte, bytes/s.
const UART_BYTES_PER_S: f64 = 92_160.0;
/// Frame header of TI's SDK 3 demo and maximum padding to a multiple of 32, bytes.
const UART_HEADER_BYTES: u64 = 40 + 31;
/// Size of type and length before every block, bytes.
const TLV_BYTES: u64 = 8;
/// Size of a point, bytes: x, y, z, velocity as f32.
const POINT_BYTES: u64 = 16;
/// Size of SNR and noise of a point as i16, bytes.
const SIDE_INFO_BYTES: u64 = 4;
/// Size of the timing statistics, bytes.
const STATS_BYTES: u64 = 24;
/// Usual limit of the tokenizer, used if no model is available.
const DEFAULT_MAX_POINTS: usize = 128;

/// Number of range bins of the demos: samples padded to a power of two.
fn range_bins(subject: &Subject) -> u64 {
    subject.radar.n_samples.next_power_of_two() as u64
}

/// Number of Doppler bins of the demos: loops padded to a power of two.
fn doppler_bins(subject: &Subject) -> u64 {
    subject.radar.n_loops.next_power_of_two() as u64
}

/// Compares the radar cube and the detection matrix of TI's demos with the memory of the chip. Sizes are those that
/// `objectdetection.c` of the demo allocates (TI forum thread 772813).
pub(super) fn memory(report: &mut Report, subject: &Subject) {
    let Some(limits) = subject.board.and_then(Board::limits) else {
        return;
    };
    let radar = subject.radar;
    let channels = (radar.tx.len() * radar.rx.len()) as u64;
    let cube = range_bins(subject) * radar.n_loops as u64 * channels * SAMPLE_BYTES;
    let detection = range_bins(subject) * doppler_bins(subject) * 2;
    if cube + detection > limits.l3_bytes {
        // Without raw samples, the firmware must do all processing.
        let severity = match subject.lvds_samples {
            Some(false) => Severity::Warning,
            _ => Severity::Note,
        };
        let message = format!(
            "cube and detection matrix take {} KiB of the chip's {} KiB: TI's firmware cannot process \
             such frames, only pass on raw samples",
            (cube + detection).div_ceil(1024),
            limits.l3_bytes / 1024
        );
        report.add(severity, "l3-memory", "n_loops", message);
    }
}

/// Compares the rate of raw samples with that of the LVDS lanes during chirps, and with that of Ethernet over the
/// frame.
pub(super) fn lvds(report: &mut Report, subject: &Subject) {
    let Some(limits) = subject.board.and_then(Board::limits) else {
        return;
    };
    let radar = subject.radar;
    let severity = match subject.lvds_samples {
        Some(true) => subject.part_severity(),
        Some(false) => Severity::Note,
        None => Severity::Warning,
    };
    let chirp_bits = (radar.rx.len() * radar.n_samples) as f64 * (SAMPLE_BYTES * 8) as f64;
    let link_bps = f64::from(limits.lvds_lanes) * LVDS_LANE_BPS;
    let burst_bps = chirp_bits / radar.chirp_period_s();
    if burst_bps > link_bps {
        let message = format!(
            "raw samples come at {:.0} Mbit/s during the chirps, and {} LVDS lanes carry {:.0}",
            burst_bps / 1e6,
            limits.lvds_lanes,
            link_bps / 1e6
        );
        report.add(severity, "lvds-budget", "n_samples", message);
    }
    let chirps = (radar.tx.len() * radar.n_loops) as f64;
    let mean_bps = chirp_bits * chirps / radar.frame_period_s;
    if mean_bps > MAX_ETHERNET_BPS {
        let message = format!(
            "raw samples come at {:.0} Mbit/s on average, and a DCA1000 sends at most {:.0}",
            mean_bps / 1e6,
            MAX_ETHERNET_BPS / 1e6
        );
        report.add(severity, "lvds-budget", "frame_period_s", message);
    } else if mean_bps > ETHERNET_DEFAULT_BPS {
        let message = format!(
            "raw samples come at {:.0} Mbit/s on average: the DCA1000's packet delay must be shorter \
             than its default of 25 us, which carries {:.0}",
            mean_bps / 1e6,
            ETHERNET_DEFAULT_BPS / 1e6
        );
        let severity = severity.max(Severity::Warning);
        report.add(severity, "lvds-budget", "frame_period_s", message);
    }
}

/// Compares the points of TI's out-of-box demo with the capacity of its serial port.
pub(super) fn uart(report: &mut Report, subject: &Subject, model: Option<&ModelExpectations>) {
    let radar = subject.radar;
    let gui = subject.gui_monitor.unwrap_or(GuiMonitor {
        points: true,
        side_info: true,
        range_profile: false,
        noise_profile: false,
        azimuth_map: false,
        doppler_map: false,
        stats: false,
    });
    // If raw samples are sent, sending points is optional.
    let severity = match subject.lvds_samples {
        Some(true) => Severity::Note,
        _ => Severity::Warning,
    };
    if !gui.points {
        let message = "guiMonitor sends no points over the serial port";
        report.add(severity, "no-points", "points", message);
    }
    let channels = (radar.tx.len() * radar.rx.len()) as u64;
    let maps = [
        (gui.range_profile, "points", range_bins(subject) * 2),
        (gui.noise_profile, "points", range_bins(subject) * 2),
        (
            gui.azimuth_map,
            "azimuth_map",
            range_bins(subject) * channels * SAMPLE_BYTES,
        ),
        (
            gui.doppler_map,
            "doppler_map",
            range_bins(subject) * doppler_bins(subject) * 2,
        ),
        (gui.stats, "points", STATS_BYTES),
    ];
    let sent = maps.iter().filter(|(on, _, _)| *on);
    let fixed: u64 = UART_HEADER_BYTES + sent.clone().map(|m| TLV_BYTES + m.2).sum::<u64>();
    let budget = UART_BYTES_PER_S * radar.frame_period_s;
    // The finding refers to the largest block, or to the frame period if no block exceeds a tenth of the budget.
    let largest = sent
        .max_by_key(|m| m.2)
        .filter(|m| m.2 as f64 > 0.1 * budget);
    let place = largest.map_or("frame_period_s", |m| m.1);
    if fixed as f64 > budget {
        let message = format!(
            "{fixed} bytes a frame before the first point, and 921,600 baud carry {budget:.0}"
        );
        report.add(severity, "uart-budget", place, message);
        return;
    }
    if !gui.points {
        return;
    }
    let (blocks, bytes) = if gui.side_info {
        (2, POINT_BYTES + SIDE_INFO_BYTES)
    } else {
        (1, POINT_BYTES)
    };
    let left = (budget - (fixed + blocks * TLV_BYTES) as f64).max(0.0);
    let n_points = (left / bytes as f64) as usize;
    let wanted = model.map_or(DEFAULT_MAX_POINTS, |m| m.max_points);
    if n_points < wanted {
        let message = format!(
            "at {:.1} frames/s 921,600 baud carry {n_points} points a frame; up to {wanted} are used",
            radar.frame_rate_hz()
        );
        report.add(severity, "uart-budget", place, message);
    }
}
