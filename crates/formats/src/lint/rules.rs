//! Rules on chirp timing and on the requirements of a scene with people.

use radarllm_base::RadarConfig;

use super::{Report, Severity, Subject};
use crate::boards::Board;
use crate::point_radar::PointRadar;

/// Bands of the supported parts, Hz.
const BANDS_HZ: [(f64, f64); 2] = [(57e9, 64e9), (76e9, 81e9)];
/// Tolerance at the edges of a band, Hz. TI's own files end at the edge and exceed it by rounding.
const BAND_TOLERANCE_HZ: f64 = 1e6;
/// Maximum fraction of time on air. Above it, parts heat up and regulatory limits may be exceeded.
const MAX_DUTY: f64 = 0.5;
/// Minimum ADC start, s: TI's chirp timing advice for steep ramps, because synthesiser and filters need at least 3 us
/// to settle.
const MIN_ADC_START_S: f64 = 3e-6;
/// Minimum idle time after a ramp of less than this bandwidth, which the synthesiser needs to return: (Hz, s). TI
/// SWRA553A, "Programming chirp parameters in TI radar devices", table of idle times; the figures were not checked
/// against the document.
const RAMP_DOWN: [(f64, f64); 4] = [
    (1e9, 2e-6),
    (2e9, 3.5e-6),
    (3e9, 5e-6),
    (f64::INFINITY, 7e-6),
];
/// Speed of the hands and feet of a walking or punching person, m/s.
const BODY_SPEED_MPS: f64 = 3.0;
/// Range bin, m, above which a body covers fewer than about five bins, so that its shape is lost.
const BODY_RANGE_BIN_M: f64 = 0.1;
/// Velocity bin, m/s, above which limbs cannot be separated from the torso.
const BODY_VELOCITY_BIN_MPS: f64 = 0.3;
/// Size of a room, m.
const ROOM_M: f64 = 3.0;
/// Frame rate, Hz, below which gestures fall between frames.
const MIN_FRAME_RATE_HZ: f64 = 5.0;

/// Checks the chirp alone. The radar may be impossible; a radar with numbers that are not finite is skipped.
pub(super) fn chirp(report: &mut Report, subject: &Subject) {
    let radar = subject.radar;
    let ramp_hz = radar.slope_hz_per_s * radar.ramp_end_s;
    let end_hz = radar.start_hz + ramp_hz;
    if ![
        end_hz,
        radar.idle_s,
        radar.adc_start_s,
        radar.sample_rate_hz,
    ]
    .iter()
    .all(|v| v.is_finite())
    {
        return;
    }
    let fits = |(low, high): &(f64, f64)| {
        radar.start_hz >= low - BAND_TOLERANCE_HZ && end_hz <= high + BAND_TOLERANCE_HZ
    };
    let (inside, bands) = match subject.board {
        Some(board) => {
            let band = board.band_hz();
            let name = board.name();
            (
                fits(&band),
                format!(
                    "{:.0} to {:.0} GHz of the {name}",
                    band.0 / 1e9,
                    band.1 / 1e9
                ),
            )
        }
        None => (
            BANDS_HZ.iter().any(fits),
            "57 to 64 and 76 to 81 GHz".to_owned(),
        ),
    };
    if !inside {
        // Selects the value that causes the error: a start outside the band, or a ramp that leaves it.
        let start_is_outside = !(subject
            .board
            .map_or(BANDS_HZ.to_vec(), |b| vec![b.band_hz()]))
        .iter()
        .any(|(low, high)| (low - BAND_TOLERANCE_HZ..=*high).contains(&radar.start_hz));
        let message = format!(
            "the ramp runs from {:.3} to {:.3} GHz, outside {bands}",
            radar.start_hz / 1e9,
            end_hz / 1e9
        );
        let place = if start_is_outside {
            "start_hz"
        } else {
            "slope_hz_per_s"
        };
        report.add(subject.part_severity(), "band", place, message);
    }
    if radar.adc_start_s < MIN_ADC_START_S {
        let us = radar.adc_start_s * 1e6;
        let message = format!("sampling starts {us:.2} us into the ramp: it may not be settled");
        report.add(Severity::Warning, "adc-start", "adc_start_s", message);
    }
    let Some(limits) = subject.board.and_then(Board::limits) else {
        return;
    };
    // The table of the application note holds for these parts only.
    let ramp_down_s = RAMP_DOWN
        .iter()
        .find(|(below_hz, _)| ramp_hz < *below_hz)
        .map_or(0.0, |(_, s)| *s);
    // The tolerance covers the rounding of microseconds multiplied by 1e-6.
    if radar.idle_s < ramp_down_s - 1e-9 {
        let message = format!(
            "idle for {:.2} us, but the synthesiser needs {:.1} us back from a ramp of {:.2} GHz",
            radar.idle_s * 1e6,
            ramp_down_s * 1e6,
            ramp_hz / 1e9
        );
        report.add(Severity::Warning, "idle-time", "idle_s", message);
    }
    if radar.sample_rate_hz > limits.max_sample_rate_hz * (1.0 + 1e-9) {
        let message = format!(
            "{:.2} Msps, but the part behind {} gives at most {:.2} Msps of complex samples",
            radar.sample_rate_hz / 1e6,
            radar.name,
            limits.max_sample_rate_hz / 1e6
        );
        report.add(
            subject.part_severity(),
            "adc-rate",
            "sample_rate_hz",
            message,
        );
    }
}

/// Requirements of a scene with people on a valid radar.
pub(super) fn scene(report: &mut Report, radar: &RadarConfig) {
    let mut warn = |rule, place, message: String| {
        report.add(Severity::Warning, rule, place, message);
    };
    let on_air_s = radar.ramp_end_s * (radar.tx.len() * radar.n_loops) as f64;
    let duty = on_air_s / radar.frame_period_s;
    if duty > MAX_DUTY {
        let message = format!("transmitting {:.0} % of the time", duty * 100.0);
        warn("duty-cycle", "frame_period_s", message);
    }
    let mut seen = PointRadar::from(radar);
    if radar.n_loops < 2 {
        let message = "a single loop: no velocity, and static clutter cannot be removed";
        warn("single-loop", "n_loops", message.into());
        (seen.max_velocity_mps, seen.velocity_resolution_mps) = (None, None);
    }
    points(report, &seen, slow_part(radar));
    let mut warn = |rule, place, message: String| {
        report.add(Severity::Warning, rule, place, message);
    };
    let [width_m, height_m] = aperture_m(radar);
    // Antennas of a board are farther apart than a tenth of a millimetre.
    if width_m < 1e-4 {
        let message = "all virtual antennas share one column: no azimuth";
        warn("no-azimuth", "rx", message.into());
    }
    if height_m < 1e-4 {
        let message = "all virtual antennas share one height: points get z = 0";
        warn("no-elevation", "tx", message.into());
    }
}

/// Requirements of a scene with people on recorded points, as far as the figures are known. `slow_part` is the part of a
/// chirp that should be shortened to increase the maximum velocity.
pub(super) fn points(report: &mut Report, radar: &PointRadar, slow_part: &'static str) {
    let mut warn = |rule, place, message: String| {
        report.add(Severity::Warning, rule, place, message);
    };
    if let Some(m) = radar.range_resolution_m.filter(|m| *m > BODY_RANGE_BIN_M) {
        let message = format!("range bins of {m:.3} m: a body covers few of them");
        warn("range-resolution", "n_samples", message);
    }
    if let Some(m) = radar.max_range_m.filter(|m| *m < ROOM_M) {
        let message = format!("ranges end at {m:.2} m, and farther targets fold back");
        warn("range-ambiguity", "sample_rate_hz", message);
    }
    if let Some(v) = radar.max_velocity_mps.filter(|v| *v < BODY_SPEED_MPS) {
        let message = format!(
            "speeds beyond {v:.2} m/s fold to the other sign; limbs reach {BODY_SPEED_MPS} m/s"
        );
        warn("velocity-ambiguity", slow_part, message);
    }
    let bin_mps = radar.velocity_resolution_mps;
    if let Some(v) = bin_mps.filter(|v| *v > BODY_VELOCITY_BIN_MPS) {
        let message = format!("velocity bins of {v:.2} m/s merge limbs and torso");
        warn("velocity-resolution", "n_loops", message);
    }
    if radar.frame_rate_hz() < MIN_FRAME_RATE_HZ {
        let message = format!("{:.1} frames/s miss quick movements", radar.frame_rate_hz());
        warn("frame-rate", "frame_period_s", message);
    }
}

/// The longer part of a chirp, which should be shortened to increase the maximum velocity.
pub(super) fn slow_part(radar: &RadarConfig) -> &'static str {
    if radar.idle_s > radar.ramp_end_s {
        "idle_s"
    } else {
        "ramp_end_s"
    }
}

/// Extent of the virtual array along x and z, m.
pub(super) fn aperture_m(radar: &RadarConfig) -> [f64; 2] {
    let extent = |of: fn(&radarllm_base::radar_config::Antenna) -> f64| {
        let along = |antennas: &[radarllm_base::radar_config::Antenna]| {
            let (low, high) = antennas
                .iter()
                .map(of)
                .fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(v), h.max(v)));
            high - low
        };
        // Positions of virtual antennas are sums, so the extents add.
        along(&radar.tx) + along(&radar.rx)
    };
    [extent(|a| a.x_m), extent(|a| a.z_m)]
}
