//! Chirp files of TI's low-power SDK (xWRL1432, xWRL6432, xWRL6844).
//!
//! Arguments and formulas are those of the command line of TI's motion and presence detection demo (MMWAVE-L-SDK 5 and 6,
//! `motion_detect.c` and `mmw_cli.c`):
//!
//! - `channelCfg RX TX 0`: masks; the xWRL6844 has two bits for each transmitter.
//! - `chirpComnCfg DECIMATION BITS FILTER SAMPLES PATTERN RAMP_END_US HIGH_PASS`: the sample rate is 100 MHz / DECIMATION,
//!   on the xWRL6844 200 MHz / DECIMATION; samples are real; pattern 0 or 1 is time division, 4 is binary phase modulation.
//! - `chirpTimingCfg IDLE_US SKIPPED_SAMPLES TX_START_US SLOPE_MHZ_PER_US START_GHZ`.
//! - `frameCfg CHIRPS_IN_BURST ACCUMULATED BURST_PERIOD_US BURSTS FRAME_PERIOD_MS FRAMES`: with several bursts, a loop is a
//!   burst; with a single one, its chirps are the loops, each repeated ACCUMULATED times if that is not 0.
//! - `antGeometryCfg ROW COLUMN ... X_MM Z_MM`: places of the virtual antennas, starting with the receivers of TX1.
//! - `antGeometryBoard NAME`: the board.

use std::collections::BTreeSet;

use radarllm_base::{
    RadarConfig,
    radar_config::{Antenna, TxMultiplexing},
};

use crate::{
    boards::{Board, Platform, X_PER_ELEMENT},
    point_radar::{ChirpDialect, PointRadar, Sampling},
    span::Places,
    ti_cfg::{Command, TiCfgError, Word},
};

/// Commands that no other dialect has.
const OWN_COMMANDS: [&str; 2] = ["chirpComnCfg", "chirpTimingCfg"];
/// Receivers of an xWRL1432 and an xWRL6432.
const N_RX: usize = 3;

/// Device of the low-power family.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Device {
    L1432,
    L6432,
    L6844,
}

impl Device {
    fn from_name(name: &str) -> Option<Self> {
        let name = name.to_ascii_lowercase();
        [
            ("l1432", Self::L1432),
            ("l6432", Self::L6432),
            ("l6844", Self::L6844),
        ]
        .into_iter()
        .find_map(|(part, device)| name.contains(part).then_some(device))
    }

    fn name(self) -> &'static str {
        match self {
            Self::L1432 => "xwrl1432",
            Self::L6432 => Board::Iwrl6432.name(),
            Self::L6844 => "xwrl6844",
        }
    }

    /// Sample rate with decimation 1, samples/s.
    fn clock_hz(self) -> f64 {
        match self {
            Self::L6844 => 200e6,
            _ => 100e6,
        }
    }

    /// Number of transmitters of a mask; `None` if the mask does not show it.
    fn n_tx(self, mask: u32) -> Option<u32> {
        match self {
            Self::L6844 => {
                let pairs = mask & (mask >> 1) & 0x5555;
                (pairs | pairs << 1 == mask).then_some(pairs.count_ones())
            }
            _ => Some(mask.count_ones()),
        }
    }
}

struct Common {
    decimation: u32,
    n_samples: u32,
    pattern: u32,
    ramp_end_s: f64,
    command: Command,
}

struct Timing {
    idle_s: f64,
    n_skipped: u32,
    slope_hz_per_s: f64,
    start_hz: f64,
}

struct Frame {
    n_chirps: u32,
    n_accumulated: u32,
    burst_s: f64,
    n_bursts: u32,
    period_s: f64,
    command: Command,
}

/// Transmitters and receivers of the device.
type Antennas = (Vec<Antenna>, Vec<Antenna>);

/// What a file of the low-power SDK says.
pub(crate) struct LowPowerReading {
    /// Everything wrong, and why there is no cube; never empty.
    pub errors: Vec<TiCfgError>,
    pub points: Option<PointRadar>,
    /// A radar with the same bins for simulation.
    pub equivalent: Option<RadarConfig>,
    /// Whether the antennas of `equivalent` are assumed.
    pub antennas_assumed: bool,
    pub places: Places,
}

#[derive(Default)]
struct File {
    /// First command that no other dialect has.
    own: Option<Word>,
    device: Option<Device>,
    /// Receivers and transmitters.
    masks: Option<(u32, u32)>,
    common: Option<Common>,
    timing: Option<Timing>,
    frame: Option<Frame>,
    antennas: Option<Antennas>,
    places: Places,
}

/// Reads a file if it has commands of the low-power SDK.
pub(crate) fn read(text: &str, platform: Option<&str>) -> Option<LowPowerReading> {
    let mut file = File {
        device: platform.and_then(Device::from_name),
        ..File::default()
    };
    let mut errors = Vec::new();
    let mut broken = BTreeSet::new();
    for (i, raw) in text.lines().enumerate() {
        let Some(command) = Command::of_line(i + 1, raw) else {
            continue;
        };
        let name = command.name.text.clone();
        if let Err(error) = file.read_command(command) {
            errors.push(error);
            broken.insert(name);
        }
    }
    let own = file.own.clone()?;
    for (name, is_missing) in [
        ("channelCfg", file.masks.is_none()),
        ("chirpComnCfg", file.common.is_none()),
        ("chirpTimingCfg", file.timing.is_none()),
        ("frameCfg", file.frame.is_none()),
    ] {
        if is_missing && !broken.contains(name) {
            errors.push(TiCfgError::Missing(name));
        }
    }
    let mut reading = LowPowerReading {
        errors: vec![own.refuse(
            "unsupported",
            "this is a chirp file of the low-power SDK, whose devices give real samples: points can be read, raw samples \
             cannot",
        )],
        points: None,
        equivalent: None,
        antennas_assumed: false,
        places: std::mem::take(&mut file.places),
    };
    reading.points = file.points(&mut errors);
    if errors.is_empty()
        && let Some(points) = &reading.points
    {
        reading.equivalent = file.equivalent(points);
        reading.antennas_assumed = reading.equivalent.is_some() && file.antennas.is_none();
    }
    reading.errors.extend(errors);
    Some(reading)
}

impl File {
    fn read_command(&mut self, command: Command) -> Result<(), TiCfgError> {
        let c = &command;
        let name = c.name.text.as_str();
        if self.own.is_none() && OWN_COMMANDS.contains(&name) {
            self.own = Some(c.name.clone());
        }
        match name {
            "channelCfg" => {
                self.places.insert("rx", c.span(0, "receiver mask"));
                self.places.insert("tx", c.span(1, "transmitter mask"));
                self.masks = Some((
                    c.mask(0, "receiver mask", 1..1 << 16)?,
                    c.mask(1, "transmitter mask", 1..1 << 16)?,
                ));
            }
            "chirpComnCfg" => {
                for (index, field, what) in [
                    (0, "sample_rate_hz", "decimation"),
                    (3, "n_samples", "samples"),
                    (5, "ramp_end_s", "ramp end, us"),
                ] {
                    self.places.insert(field, c.span(index, what));
                }
                self.common = Some(Common {
                    decimation: c.whole(0, "decimation", 1..256)?,
                    n_samples: c.whole(3, "samples", 2..4097)?,
                    pattern: c.whole(4, "transmit pattern", 0..256)?,
                    ramp_end_s: c.positive(5, "ramp end, us")? * 1e-6,
                    command,
                });
            }
            "chirpTimingCfg" => {
                for (index, field, what) in [
                    (0, "idle_s", "idle time, us"),
                    (1, "adc_start_s", "skipped samples"),
                    (3, "slope_hz_per_s", "slope, MHz/us"),
                    (4, "start_hz", "start frequency, GHz"),
                ] {
                    self.places.insert(field, c.span(index, what));
                }
                let idle_us = c.number(0, "idle time, us")?;
                if idle_us < 0.0 {
                    return Err(c.args[0].error("idle time, us, must not be negative"));
                }
                self.timing = Some(Timing {
                    idle_s: idle_us * 1e-6,
                    n_skipped: c.whole(1, "skipped samples", 0..65_536)?,
                    // Identification of targets uses a slope of 0, which gives no range.
                    slope_hz_per_s: c.number(3, "slope, MHz/us")? * 1e12,
                    start_hz: c.positive(4, "start frequency, GHz")? * 1e9,
                });
            }
            "frameCfg" => {
                self.places.insert("n_loops", c.span(3, "bursts"));
                let period = c.span(4, "frame period, ms");
                self.places.insert("frame_period_s", period);
                self.frame = Some(Frame {
                    n_chirps: c.whole(0, "chirps in a burst", 1..65_536)?,
                    n_accumulated: c.whole(1, "accumulated chirps", 0..256)?,
                    burst_s: c.positive(2, "burst period, us")? * 1e-6,
                    n_bursts: c.whole(3, "bursts", 1..65_536)?,
                    period_s: c.positive(4, "frame period, ms")? * 1e-3,
                    command,
                });
            }
            "antGeometryCfg" => self.antennas = antennas(c)?,
            "antGeometryBoard" => {
                let board = c.args.first().map(|word| word.text.as_str());
                self.device = board.and_then(Device::from_name).or(self.device);
            }
            _ => {}
        }
        Ok(())
    }

    /// The device: the one that the file names, or else the one that its band and its masks fit.
    fn device(&self) -> Option<Device> {
        if self.device.is_some() {
            return self.device;
        }
        let timing = self.timing.as_ref()?;
        if timing.start_hz > 70e9 {
            return Some(Device::L1432);
        }
        let (rx, tx) = self.masks?;
        if rx > 7 || tx > 3 {
            return Some(Device::L6844);
        }
        Some(Device::L6432)
    }

    fn sampling(&self) -> Option<Sampling> {
        let (common, timing) = (self.common.as_ref()?, self.timing.as_ref()?);
        let sample_rate_hz = self.device()?.clock_hz() / f64::from(common.decimation);
        Some(Sampling {
            start_hz: timing.start_hz,
            slope_hz_per_s: timing.slope_hz_per_s,
            adc_start_s: f64::from(timing.n_skipped) / sample_rate_hz,
            n_samples: common.n_samples,
            sample_rate_hz,
            is_real: true,
        })
    }

    /// Time from one loop to the next, s, and number of loops; `None` if the frame has no loops of equal distance.
    fn loops(&self) -> Option<(f64, u32)> {
        let (common, timing) = (self.common.as_ref()?, self.timing.as_ref()?);
        let frame = self.frame.as_ref()?;
        let n_tx = self.device()?.n_tx(self.masks?.1).filter(|n| *n > 0)?;
        match frame.n_bursts {
            1 if frame.n_chirps % n_tx == 0 => {
                let chirp_s = timing.idle_s + common.ramp_end_s;
                let n_chirps = n_tx * frame.n_accumulated.max(1);
                Some((chirp_s * f64::from(n_chirps), frame.n_chirps / n_tx))
            }
            n if n > 1 && frame.n_chirps == n_tx => Some((frame.burst_s, n)),
            _ => None,
        }
    }

    /// Frame period and what is known of range and velocity.
    fn points(&self, errors: &mut Vec<TiCfgError>) -> Option<PointRadar> {
        let frame = self.frame.as_ref()?;
        let word = frame.command.args.get(4).unwrap_or(&frame.command.name);
        let name = self.device().map_or("xwrl", Device::name).to_owned();
        let mut points = match PointRadar::new(name, ChirpDialect::LowPower, frame.period_s) {
            Ok(points) => points,
            Err(problem) => {
                errors.push(word.error(problem));
                return None;
            }
        };
        // The chirps of a single burst determine its length.
        let chirps_s = match (frame.n_bursts, self.loops()) {
            (1, Some((period_s, n_loops))) => period_s * f64::from(n_loops),
            _ => 0.0,
        };
        let active_s = chirps_s.max(frame.burst_s * f64::from(frame.n_bursts));
        // The tolerance covers the rounding of microseconds.
        if active_s > frame.period_s * (1.0 + 1e-9) {
            errors.push(word.error(format!(
                "{} bursts take {:.2} ms but the frame lasts {:.2} ms",
                frame.n_bursts,
                active_s * 1e3,
                frame.period_s * 1e3
            )));
            return None;
        }
        if let Some(sampling) = self.sampling() {
            points.set_range(&sampling);
        }
        if let Some((period_s, n_loops)) = self.loops() {
            points.set_velocity(period_s, n_loops);
        }
        if let Some(common) = &self.common
            && ![0, 1, 4].contains(&common.pattern)
        {
            let word = common.command.args.get(4).unwrap_or(&common.command.name);
            errors.push(word.error(
                "transmit pattern must be 0 or 1 (time division) or 4 (binary phase modulation)",
            ));
        }
        Some(points)
    }

    /// A radar with the same range and Doppler bins and complex samples: half as many at half the rate. Its chirps are
    /// spread evenly over a burst, because a [`RadarConfig`] has no pause between loops. `None` for devices whose
    /// antennas or link budget are not known, and for what no radar can be.
    fn equivalent(&self, points: &PointRadar) -> Option<RadarConfig> {
        if self.device()? != Device::L6432 {
            return None;
        }
        let (rx_mask, tx_mask) = self.masks?;
        let (loop_s, n_loops) = self.loops()?;
        let (common, sampling) = (self.common.as_ref()?, self.sampling()?);
        let figures = Board::Iwrl6432.figures();
        let (tx, rx) = self
            .antennas
            .clone()
            .unwrap_or_else(|| (figures.tx.clone(), figures.rx.clone()));
        let enabled = |antennas: Vec<Antenna>, mask: u32| -> Vec<Antenna> {
            let bits = antennas.into_iter().enumerate();
            bits.filter(|(i, _)| mask >> i & 1 == 1)
                .map(|(_, a)| a)
                .collect()
        };
        let (tx, rx) = (enabled(tx, tx_mask), enabled(rx, rx_mask));
        let radar = RadarConfig {
            name: points.name.clone(),
            start_hz: sampling.start_hz,
            slope_hz_per_s: sampling.slope_hz_per_s,
            idle_s: loop_s / tx.len() as f64 - common.ramp_end_s,
            adc_start_s: sampling.adc_start_s,
            ramp_end_s: common.ramp_end_s,
            n_samples: sampling.n_samples as usize / 2,
            sample_rate_hz: 0.5 * sampling.sample_rate_hz,
            n_loops: n_loops as usize,
            frame_period_s: points.frame_period_s,
            multiplexing: match (common.pattern, tx.len()) {
                (4, 2) => TxMultiplexing::Bpm,
                _ => TxMultiplexing::Tdm,
            },
            tx,
            rx,
            tx_power_dbm: figures.tx_power_dbm,
            antenna_gain_dbi: figures.antenna_gain_dbi,
            azimuth_half_width_rad: figures.azimuth_half_width_rad,
            elevation_half_width_rad: figures.elevation_half_width_rad,
            noise_figure_db: figures.noise_figure_db,
        };
        radar.problems().is_empty().then_some(radar)
    }
}

/// Antennas of an `antGeometryCfg` of two transmitters and three receivers; `None` for other devices. Rows count
/// upwards here; this was not verified on hardware.
fn antennas(command: &Command) -> Result<Option<Antennas>, TiCfgError> {
    const N_PAIRS: usize = 2 * N_RX;
    if command.args.len() != 2 * N_PAIRS + 2 {
        return Ok(None);
    }
    let step_m = |index, what| -> Result<f64, TiCfgError> {
        let step_mm = command.positive(index, what)?;
        match step_mm <= 100.0 {
            true => Ok(step_mm * 1e-3),
            false => Err(command.args[index].error(format!("{what}, must be at most 100"))),
        }
    };
    let x_m = step_m(2 * N_PAIRS, "spacing along x, mm")?;
    let z_m = step_m(2 * N_PAIRS + 1, "spacing along z, mm")?;
    let mut places = [Antenna { x_m: 0.0, z_m: 0.0 }; N_PAIRS];
    for (i, place) in places.iter_mut().enumerate() {
        let row = command.whole(2 * i, "row", 0..256)?;
        let column = command.whole(2 * i + 1, "column", 0..256)?;
        *place = Antenna {
            x_m: X_PER_ELEMENT * f64::from(column) * x_m,
            z_m: f64::from(row) * z_m,
        };
    }
    let (first, second) = places.split_at(N_RX);
    let step = Antenna {
        x_m: second[0].x_m - first[0].x_m,
        z_m: second[0].z_m - first[0].z_m,
    };
    let is_sum = first.iter().zip(second).all(|(a, b)| {
        (b.x_m - a.x_m - step.x_m).abs() < 1e-9 && (b.z_m - a.z_m - step.z_m).abs() < 1e-9
    });
    if !is_sum {
        return Err(command.name.refuse(
            "antenna-geometry",
            "the antennas of the second transmitter are not those of the first one, moved",
        ));
    }
    let origin = Antenna { x_m: 0.0, z_m: 0.0 };
    Ok(Some((vec![origin, step], first.to_vec())))
}

/// Whether a comment or a name of a file names a device of the low-power family.
pub(crate) fn platform_name(platform: Option<&Platform>) -> Option<&str> {
    match platform? {
        Platform::UnknownAntennas { name } => Some(name),
        _ => None,
    }
}
