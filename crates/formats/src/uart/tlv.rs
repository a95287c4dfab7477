//! Contents of the TLVs.

use radarllm_base::{BoardTrack, RadarPoint};

use super::{Dialect, UartReport, packet::Header};

/// Maximum range, m. The long-range demos of the 77 GHz chips state 150 to 250 m.
const MAX_RANGE_M: f32 = 300.0;
/// Maximum speed, m/s: 216 km/h. No demo measures more without ambiguity.
const MAX_SPEED_MPS: f32 = 60.0;
/// Range of believable SNR, dB. Side information has steps of 0.1 dB and values of 0 to 60 dB.
const SNR_DB: std::ops::RangeInclusive<f32> = -50.0..=150.0;
/// Smaller values other than 0 are no measurement, but integers that are read as floats.
const MIN_MAGNITUDE: f32 = 1e-20;
/// Maximum acceleration of a target, m/s^2.
const MAX_ACCELERATION_MPS2: f32 = 1e3;

/// A tracked object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target {
    /// Track number of the firmware.
    pub id: u32,
    /// Position in the axes of the sensor (x right, y away, z up), m.
    pub position_m: [f32; 3],
    /// Velocity, m/s.
    pub velocity_mps: [f32; 3],
    /// Acceleration, m/s^2.
    pub acceleration_mps2: [f32; 3],
}

impl Target {
    /// The track in the types of the project, in the axes of the sensor.
    pub fn track(&self) -> BoardTrack {
        let [x_m, y_m, z_m] = self.position_m;
        BoardTrack {
            id: self.id,
            place_m: [x_m, y_m],
            // Firmware that tracks in a plane sends 0.
            height_m: (z_m != 0.0).then_some(z_m),
            velocity_mps: self.velocity_mps,
        }
    }
}

/// Vertical extent of a tracked object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TargetHeight {
    /// Track number of the firmware.
    pub id: u32,
    /// Top, m.
    pub top_m: f32,
    /// Bottom, m.
    pub bottom_m: f32,
}

/// Processing times of the out-of-box demo (type 6).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stats {
    /// Processing time between frames, us.
    pub inter_frame_processing_us: u32,
    /// Transmission time of the previous packet, us.
    pub transmit_us: u32,
    /// Spare time between frames, us.
    pub inter_frame_margin_us: u32,
    /// Spare time between chirps, us.
    pub inter_chirp_margin_us: u32,
    /// CPU load during chirps, percent.
    pub active_cpu_percent: u32,
    /// CPU load between frames, percent.
    pub inter_frame_cpu_percent: u32,
}

/// Temperatures on the chip (type 9), degrees Celsius.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Temperatures {
    /// Receivers 0 to 3.
    pub rx_c: [i16; 4],
    /// Transmitters 0 to 2.
    pub tx_c: [i16; 3],
    /// Power management block.
    pub pm_c: i16,
    /// Digital blocks.
    pub digital_c: [i16; 2],
}

/// SNR and noise of a point (type 7), 0.1 dB.
type SideInfo = [i16; 2];

/// A point with the SNR in dB, if its type contains it. `None` for a damaged point.
type Slot = Option<(RadarPoint, Option<f32>)>;

/// Content of one packet before SNR is assigned to points.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Content {
    /// Points in the firmware's order.
    pub points: Vec<Slot>,
    /// How many of the points are of minor motion.
    pub n_minor: usize,
    pub side_info: Vec<SideInfo>,
    pub static_points: Vec<Slot>,
    pub static_side_info: Vec<SideInfo>,
    pub range_profile: Vec<u16>,
    pub stats: Option<Stats>,
    pub temperatures: Option<Temperatures>,
    pub targets: Vec<Target>,
    pub heights: Vec<TargetHeight>,
    pub indices: Vec<u8>,
    pub presence: Option<u32>,
    pub occupied_zones: Option<u32>,
}

impl Content {
    /// Removes everything and keeps the memory.
    pub(super) fn clear(&mut self) {
        let Self {
            points,
            n_minor,
            side_info,
            static_points,
            static_side_info,
            range_profile,
            stats,
            temperatures,
            targets,
            heights,
            indices,
            presence,
            occupied_zones,
        } = self;
        points.clear();
        *n_minor = 0;
        side_info.clear();
        static_points.clear();
        static_side_info.clear();
        range_profile.clear();
        (*stats, *temperatures) = (None, None);
        (*presence, *occupied_zones) = (None, None);
        targets.clear();
        heights.clear();
        indices.clear();
    }

    /// Whether there is something that a description uses: points, tracks or presence.
    pub(super) fn has_scene(&self) -> bool {
        !(self.points.is_empty() && self.static_points.is_empty() && self.targets.is_empty())
            || self.presence.is_some()
            || self.occupied_zones.is_some()
    }

    /// Whether there are as many points as the header counts, or the header counts none.
    pub(super) fn agrees_with(&self, head: &Header) -> bool {
        let count = |n: Option<u32>| n.unwrap_or(0) as usize;
        let n_objects = count(head.n_objects);
        let n_points = self.points.len();
        if n_objects == 0 || n_points == 0 {
            return true;
        }
        // Streams of the xWRL6844 count points of minor motion by themselves.
        n_objects == n_points || n_objects == n_points - self.n_minor.min(n_points)
    }

    /// Whether every point that is kept has an SNR.
    pub(super) fn has_snr(&self) -> bool {
        let own = |slots: &[Slot]| slots.iter().flatten().all(|(_, snr_db)| snr_db.is_some());
        (own(&self.points) || self.side_info.len() == self.points.len())
            && (own(&self.static_points) || self.static_side_info.len() == self.static_points.len())
    }
}

/// How much of a payload is possible.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Belief {
    /// Items of the payload.
    pub items: usize,
    /// Items with values that no radar measures.
    pub impossible: usize,
}

impl Belief {
    /// A payload of which more than half is impossible is something else.
    pub(super) fn is_believed(self) -> bool {
        2 * self.impossible <= self.items
    }
}

/// Meaning of a TLV in a dialect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// 4 floats: x, y, z, velocity.
    CartesianPoints,
    /// 4 floats: range, azimuth, elevation, velocity.
    SphericalPoints,
    /// Layout of [`Self::CartesianPoints`], for static points.
    StaticPoints,
    /// 4 floats: range, azimuth, velocity, SNR.
    PolarPoints,
    /// 4 floats (units), then per point i8 azimuth, i8 velocity, u16 range, u16 SNR.
    PolarCompact,
    /// 5 floats (units), then per point i8 elevation, i8 azimuth, i16 velocity, u16 range, u16 SNR.
    SphericalCompact,
    /// Layout of [`Self::SphericalCompact`], for points of minor motion.
    MinorSphericalCompact,
    /// 5 floats: range, azimuth, elevation, velocity, SNR.
    SphericalPointsWithSnr,
    /// u16 number of objects and u16 binary places, then per object u16 range bin, i16 Doppler bin, u16 peak, i16 x, y, z.
    DetectedObjects,
    /// 4 floats (units) and 2 u16 counts, then per point i16 x, y, z, velocity, u8 SNR, u8 noise.
    CartesianCompact,
    SideInfo,
    StaticSideInfo,
    RangeProfile,
    Stats,
    Temperatures,
    /// u32 id, then position, velocity, acceleration (x, y, z each), 18 more floats: 112 bytes.
    Targets112,
    /// u32 id, x, y, vx, vy, ax, ay, 10 more floats: 68 bytes.
    Targets68,
    /// u32 id, x, y, vx, vy, ax, ay, z, vz, az: 40 bytes.
    Targets40,
    /// u32 id, then position, velocity, acceleration (x, y, z each): 40 bytes.
    OverheadTargets,
    Heights,
    Indices,
    Presence,
    /// u8 number of zones, then 2 bits per zone: 0 for an empty one.
    ZonePresence,
    /// Known, but not used: see [`tlv_name`].
    Unused,
}

impl Kind {
    /// Meaning of a TLV type; `None` if the dialect does not define it.
    pub(super) fn of(dialect: Dialect, number: u32) -> Option<Self> {
        match dialect {
            Dialect::Sdk3 => Some(match number {
                1 => Self::CartesianPoints,
                2 => Self::RangeProfile,
                6 => Self::Stats,
                7 => Self::SideInfo,
                9 => Self::Temperatures,
                _ => return Self::of_toolbox(number).or_else(|| unused(dialect, number)),
            }),
            Dialect::PeopleTracking6844 => Some(match number {
                3001 => Self::MinorSphericalCompact,
                _ => return Self::of_toolbox(number).or_else(|| unused(dialect, number)),
            }),
            Dialect::Sdk1 | Dialect::Sdk2 => Some(match number {
                1 => Self::DetectedObjects,
                2 => Self::RangeProfile,
                6 => Self::Stats,
                _ => return unused(dialect, number),
            }),
            Dialect::AreaScanner => Some(match number {
                1 => Self::SphericalPoints,
                2 => Self::RangeProfile,
                6 => Self::Stats,
                7 => Self::SideInfo,
                8 => Self::StaticPoints,
                9 => Self::StaticSideInfo,
                10 => Self::Targets40,
                11 => Self::Indices,
                _ => return unused(dialect, number),
            }),
            Dialect::PeopleCounting3d
            | Dialect::PeopleCounting2d
            | Dialect::PeopleCounting2dCompact
            | Dialect::Overhead3d => Some(match (dialect, number) {
                (Dialect::PeopleCounting3d, 6) => Self::SphericalCompact,
                (Dialect::PeopleCounting3d, 7) => Self::Targets112,
                (Dialect::PeopleCounting3d, 11) => Self::Presence,
                (Dialect::PeopleCounting2d, 6) => Self::PolarPoints,
                (Dialect::PeopleCounting2dCompact, 6) => Self::PolarCompact,
                (Dialect::Overhead3d, 6) => Self::SphericalPointsWithSnr,
                (Dialect::Overhead3d, 7) => Self::OverheadTargets,
                (Dialect::Overhead3d, 9) => Self::Stats,
                (_, 7) => Self::Targets68,
                (_, 8) => Self::Indices,
                _ => return None,
            }),
        }
    }

    /// Types of the Radar Toolbox and of the low-power SDK.
    fn of_toolbox(number: u32) -> Option<Self> {
        Some(match number {
            301 => Self::CartesianCompact,
            308 | 1010 => Self::Targets112,
            309 | 1011 => Self::Indices,
            315 => Self::ZonePresence,
            1000 => Self::SphericalPoints,
            1012 => Self::Heights,
            1020 | 3001 => Self::SphericalCompact,
            1021 => Self::Presence,
            _ => return None,
        })
    }

    /// Size of the part before the items, and of one item, bytes.
    fn layout(self) -> (usize, usize) {
        match self {
            Self::CartesianPoints
            | Self::SphericalPoints
            | Self::StaticPoints
            | Self::PolarPoints => (0, 16),
            Self::PolarCompact => (16, 6),
            Self::SphericalCompact | Self::MinorSphericalCompact => (20, 8),
            Self::SphericalPointsWithSnr => (0, 20),
            Self::DetectedObjects => (4, 12),
            Self::CartesianCompact => (20, 10),
            Self::SideInfo | Self::StaticSideInfo => (0, 4),
            Self::RangeProfile => (0, 2),
            Self::Stats => (24, 0),
            Self::Temperatures => (28, 0),
            Self::Targets112 => (0, 112),
            Self::Targets68 => (0, 68),
            Self::Targets40 | Self::OverheadTargets => (0, 40),
            Self::Heights => (0, 12),
            Self::Presence => (4, 0),
            Self::ZonePresence => (1, 1),
            Self::Indices | Self::Unused => (0, 1),
        }
    }

    /// Whether the payload is a single item of fixed length.
    pub(super) fn is_single(self) -> bool {
        self.layout().1 == 0
    }

    /// Splits a payload into units and items; `None` if its length is invalid.
    pub(super) fn split(self, payload: &[u8]) -> Option<(&[u8], std::slice::ChunksExact<'_, u8>)> {
        let (head, item) = self.layout();
        let (units, items) = payload.split_at_checked(head)?;
        if item == 0 && !items.is_empty() || item > 0 && items.len() % item != 0 {
            return None;
        }
        let count = |at: usize| usize::from(u16::from_le_bytes([units[at], units[at + 1]]));
        let n_stated = match self {
            // The payload contains major and minor points, which are counted separately.
            Self::CartesianCompact => Some(count(16) + count(18)),
            Self::DetectedObjects => Some(count(0)),
            Self::ZonePresence => Some(usize::from(units[0]).div_ceil(4)),
            _ => None,
        };
        if n_stated.is_some_and(|n| n != items.len() / item) {
            return None;
        }
        Some((units, items.chunks_exact(item.max(1))))
    }
}

/// The name of a TLV type of the SDK's demos, the Radar Toolbox or the low-power SDK, whether its content is used or not.
/// The numbers are those of the visualizer of the Radar Toolbox (`tlv_defines.py`).
pub(super) fn tlv_name(number: u32) -> Option<&'static str> {
    Some(match number {
        1 => "points",
        2 => "range profile",
        3 => "noise profile",
        4 => "azimuth heat map",
        5 => "range-Doppler heat map",
        6 => "statistics",
        7 => "side information",
        8 => "azimuth-elevation heat map",
        9 => "temperatures",
        12 => "intrusion detection",
        13 => "intrusion detection matrix",
        14 => "intrusion SNR",
        301 => "compressed points",
        302 | 303 => "range profile",
        304 | 305 => "range-azimuth heat map",
        306 => "statistics",
        307 => "presence",
        308 => "targets",
        309 => "target indices",
        310 => "micro-Doppler data",
        311 => "micro-Doppler features",
        312 | 313 => "radar cube",
        314 => "point indices",
        315 => "presence in zones",
        316 => "raw samples",
        317 => "classes",
        318 => "channel compensation",
        319 => "quick evaluation",
        320 => "antenna symbols",
        350 => "gesture features",
        351 => "gesture",
        352 | 353 => "gesture presence",
        354..=357 => "gesture indices",
        360 => "points of gestures, Cartesian",
        361 => "points of gestures, spherical",
        362 => "minor points of gestures",
        363 => "range-Doppler map",
        364 => "classifier variables",
        368 => "gesture position",
        410 => "model flag",
        1000 => "spherical points",
        1010 => "targets",
        1011 => "target indices",
        1012 => "target heights",
        1020 => "compressed spherical points",
        1021 => "presence",
        1030 => "occupied zones",
        1031 => "class of the points",
        1033 => "velocity",
        1034 => "statistics of blind spot detection",
        1035 => "targets of blind spot detection",
        1040 => "vital signs",
        1041 => "occupancy classes",
        1042 => "occupancy heights",
        1050 | 1051 => "gesture",
        1060 => "mode switch",
        1061 => "camera switch",
        1062 => "clusters",
        1070 => "level sensing",
        1080 => "sleep",
        2000..=2010 => "debug data",
        3000 => "camera triggers",
        3001 => "compressed points of minor motion",
        3002 => "occupancy features",
        10312 => "surface class",
        _ => return None,
    })
}

/// [`Kind::Unused`] for types that a dialect defines and that are not used.
fn unused(dialect: Dialect, number: u32) -> Option<Kind> {
    let is_defined = match dialect {
        Dialect::Sdk3 => tlv_name(number).is_some(),
        // The numbers of the demo are not used there, and those below 300 have other meanings.
        Dialect::PeopleTracking6844 => number >= 300 && tlv_name(number).is_some(),
        Dialect::Sdk1 | Dialect::Sdk2 | Dialect::AreaScanner => (2..=5).contains(&number),
        _ => false,
    };
    is_defined.then_some(Kind::Unused)
}

fn f32s<const N: usize>(bytes: &[u8]) -> [f32; N] {
    let mut values = [f32::NAN; N];
    for (value, word) in values.iter_mut().zip(bytes.chunks_exact(4)) {
        *value = f32::from_le_bytes([word[0], word[1], word[2], word[3]]);
    }
    values
}

fn u32s<const N: usize>(bytes: &[u8]) -> [u32; N] {
    let mut values = [0; N];
    for (value, word) in values.iter_mut().zip(bytes.chunks_exact(4)) {
        *value = u32::from_le_bytes([word[0], word[1], word[2], word[3]]);
    }
    values
}

fn i16_at(item: &[u8], at: usize) -> i16 {
    i16::from_le_bytes([item[at], item[at + 1]])
}

fn u16_at(item: &[u8], at: usize) -> f32 {
    f32::from(u16::from_le_bytes([item[at], item[at + 1]]))
}

/// Checks a point. Returns `None` and increments a count if a value is not finite or impossible.
fn point(
    position_m: [f32; 3],
    velocity_mps: f32,
    snr_db: Option<f32>,
    report: &mut UartReport,
) -> Slot {
    let [x_m, y_m, z_m] = position_m;
    let values = [x_m, y_m, z_m, velocity_mps, snr_db.unwrap_or(0.0)];
    if values.iter().any(|v| !v.is_finite()) {
        report.points_not_finite += 1;
        return None;
    }
    let range_m = (x_m * x_m + y_m * y_m + z_m * z_m).sqrt();
    let is_possible = range_m <= MAX_RANGE_M
        && velocity_mps.abs() <= MAX_SPEED_MPS
        && snr_db.is_none_or(|db| SNR_DB.contains(&db));
    if !is_possible {
        report.points_out_of_range += 1;
        return None;
    }
    let point = RadarPoint {
        x_m,
        y_m,
        z_m,
        range_m,
        velocity_mps,
        intensity_db: 0.0,
    };
    Some((point, snr_db))
}

/// [`point`] for values that were sent as floats.
fn float_point(
    values: &[f32],
    position_m: [f32; 3],
    velocity_mps: f32,
    snr_db: Option<f32>,
    report: &mut UartReport,
) -> Slot {
    if values.iter().any(|v| *v != 0.0 && v.abs() < MIN_MAGNITUDE) {
        report.points_out_of_range += 1;
        return None;
    }
    point(position_m, velocity_mps, snr_db, report)
}

/// [`from_sphere`], not finite for a negative range or angles beyond a full turn.
fn from_floats(range_m: f32, azimuth_rad: f32, elevation_rad: f32) -> [f32; 3] {
    use std::f32::consts::{FRAC_PI_2, PI};
    let is_possible = range_m >= 0.0
        && azimuth_rad.abs() <= 1.001 * PI
        && elevation_rad.abs() <= 1.001 * FRAC_PI_2;
    match is_possible {
        true => from_sphere(range_m, azimuth_rad, elevation_rad),
        false
            if [range_m, azimuth_rad, elevation_rad]
                .iter()
                .all(|v| v.is_finite()) =>
        {
            [f32::MAX; 3]
        }
        false => [f32::NAN; 3],
    }
}

/// Cartesian position of a range, an azimuth (positive to the right) and an elevation (positive upwards), rad.
fn from_sphere(range_m: f32, azimuth_rad: f32, elevation_rad: f32) -> [f32; 3] {
    let flat_m = range_m * elevation_rad.cos();
    [
        flat_m * azimuth_rad.sin(),
        flat_m * azimuth_rad.cos(),
        range_m * elevation_rad.sin(),
    ]
}

/// A linear power ratio in dB; `None` for zero. What is no ratio is not finite or beyond [`SNR_DB`].
fn ratio_db(snr: f32) -> Option<f32> {
    match snr {
        0.0 => None,
        snr if snr > 0.0 => Some(10.0 * snr.log10()),
        snr if snr.is_nan() => Some(snr),
        _ => Some(f32::MIN),
    }
}

/// Whether an SNR of the side information, 0.1 dB, is possible.
fn is_listed_snr(info: &SideInfo) -> bool {
    SNR_DB.contains(&(0.1 * f32::from(info[0])))
}

/// Adds a payload of a kind to the content. The layout was checked by [`Kind::split`]. Nothing is added if more than half
/// of the items are impossible. `doppler_step_mps` is the velocity of a Doppler bin.
pub(super) fn decode(
    kind: Kind,
    units: &[u8],
    items: std::slice::ChunksExact<'_, u8>,
    doppler_step_mps: f32,
    content: &mut Content,
    report: &mut UartReport,
) -> Belief {
    let n_items = items.len();
    let (n_points, n_static, n_targets, n_heights) = (
        content.points.len(),
        content.static_points.len(),
        content.targets.len(),
        content.heights.len(),
    );
    let (n_info, n_static_info) = (content.side_info.len(), content.static_side_info.len());
    let n_dropped = report.targets_dropped;
    decode_items(kind, units, items, doppler_step_mps, content, report);
    let n_bad = |slots: &[Slot]| slots.iter().filter(|slot| slot.is_none()).count();
    let n_bad_info = |infos: &[SideInfo]| infos.iter().filter(|i| !is_listed_snr(i)).count();
    let belief = Belief {
        items: n_items,
        impossible: n_bad(&content.points[n_points..])
            + n_bad(&content.static_points[n_static..])
            + n_bad_info(&content.side_info[n_info..])
            + n_bad_info(&content.static_side_info[n_static_info..])
            + (report.targets_dropped - n_dropped) as usize,
    };
    if !belief.is_believed() {
        content.points.truncate(n_points);
        content.static_points.truncate(n_static);
        content.side_info.truncate(n_info);
        content.static_side_info.truncate(n_static_info);
        content.targets.truncate(n_targets);
        content.heights.truncate(n_heights);
    } else if kind == Kind::MinorSphericalCompact {
        content.n_minor += n_items;
    }
    belief
}

fn decode_items(
    kind: Kind,
    units: &[u8],
    items: std::slice::ChunksExact<'_, u8>,
    doppler_step_mps: f32,
    content: &mut Content,
    report: &mut UartReport,
) {
    match kind {
        Kind::CartesianPoints | Kind::StaticPoints => {
            let points = items.map(|item| {
                let values @ [x, y, z, v] = f32s(item);
                float_point(&values, [x, y, z], v, None, report)
            });
            if kind == Kind::StaticPoints {
                content.static_points.extend(points);
            } else {
                content.points.extend(points);
            }
        }
        Kind::SphericalPoints => content.points.extend(items.map(|item| {
            let values @ [range, azimuth, elevation, v] = f32s(item);
            let position_m = from_floats(range, azimuth, elevation);
            float_point(&values, position_m, v, None, report)
        })),
        Kind::PolarPoints => content.points.extend(items.map(|item| {
            let values @ [range, azimuth, v, snr] = f32s(item);
            let position_m = from_floats(range, azimuth, 0.0);
            float_point(&values, position_m, v, ratio_db(snr), report)
        })),
        Kind::SphericalPointsWithSnr => content.points.extend(items.map(|item| {
            let values @ [range, azimuth, elevation, v, snr] = f32s(item);
            let position_m = from_floats(range, azimuth, elevation);
            float_point(&values, position_m, v, ratio_db(snr), report)
        })),
        Kind::PolarCompact => {
            let [azimuth, velocity, range, snr] = f32s(units);
            content.points.extend(items.map(|item| {
                let position_m = from_floats(
                    range * u16_at(item, 2),
                    azimuth * f32::from(item[0] as i8),
                    0.0,
                );
                let v = velocity * f32::from(item[1] as i8);
                point(position_m, v, ratio_db(snr * u16_at(item, 4)), report)
            }));
        }
        Kind::SphericalCompact | Kind::MinorSphericalCompact => {
            let [elevation, azimuth, velocity, range, snr] = f32s(units);
            content.points.extend(items.map(|item| {
                let position_m = from_floats(
                    range * u16_at(item, 4),
                    azimuth * f32::from(item[1] as i8),
                    elevation * f32::from(item[0] as i8),
                );
                let v = velocity * f32::from(i16_at(item, 2));
                point(position_m, v, ratio_db(snr * u16_at(item, 6)), report)
            }));
        }
        Kind::DetectedObjects => {
            // The second word is the number of binary places, at most 15 for 16 bits.
            let places = i32::from(i16_at(units, 2));
            let step_m = match (0..=15).contains(&places) {
                true => 0.5_f32.powi(places),
                false => f32::NAN,
            };
            content.points.extend(items.map(|item| {
                let at = |i: usize| step_m * f32::from(i16_at(item, i));
                // 10 log10(peak + 1), as TI's ROS driver computes the intensity.
                let peak_db = 10.0 * (u16_at(item, 4) + 1.0).log10();
                let slot = point([at(6), at(8), at(10)], 0.0, Some(peak_db), report);
                slot.map(|(mut point, snr_db)| {
                    // The sum turns -0 into 0.
                    point.velocity_mps = doppler_step_mps * f32::from(i16_at(item, 2)) + 0.0;
                    (point, snr_db)
                })
            }));
        }
        Kind::CartesianCompact => {
            let [position, velocity, snr, _noise] = f32s(units);
            content.points.extend(items.map(|item| {
                let at = |i: usize| position * f32::from(i16_at(item, i));
                let v = velocity * f32::from(i16_at(item, 6));
                let snr_db = snr * f32::from(item[8]);
                point([at(0), at(2), at(4)], v, Some(snr_db), report)
            }));
        }
        Kind::SideInfo | Kind::StaticSideInfo => {
            let info = items.map(|item| [i16_at(item, 0), i16_at(item, 2)]);
            if kind == Kind::StaticSideInfo {
                content.static_side_info.extend(info);
            } else {
                content.side_info.extend(info);
            }
        }
        Kind::RangeProfile => content
            .range_profile
            .extend(items.map(|item| u16::from_le_bytes([item[0], item[1]]))),
        Kind::Stats => {
            let [
                inter_frame_processing_us,
                transmit_us,
                inter_frame_margin_us,
                inter_chirp_margin_us,
                active_cpu_percent,
                inter_frame_cpu_percent,
            ] = u32s(units);
            content.stats = Some(Stats {
                inter_frame_processing_us,
                transmit_us,
                inter_frame_margin_us,
                inter_chirp_margin_us,
                active_cpu_percent,
                inter_frame_cpu_percent,
            });
        }
        Kind::Temperatures => {
            // The payload starts with a validity code (0 means valid) and the time of the device.
            let [invalid, _time_ms] = u32s(units);
            let at = |i: usize| i16_at(units, 8 + 2 * i);
            content.temperatures = (invalid == 0).then(|| Temperatures {
                rx_c: std::array::from_fn(at),
                tx_c: std::array::from_fn(|i| at(4 + i)),
                pm_c: at(7),
                digital_c: [at(8), at(9)],
            });
        }
        Kind::Targets112 => {
            for item in items {
                let v: [f32; 9] = f32s(&item[4..]);
                let xyz = |at: usize| [v[at], v[at + 1], v[at + 2]];
                push_target(item, [xyz(0), xyz(3), xyz(6)], content, report);
            }
        }
        Kind::Targets68 => {
            for item in items {
                let v: [f32; 6] = f32s(&item[4..]);
                let xy = |at: usize| [v[at], v[at + 1], 0.0];
                push_target(item, [xy(0), xy(2), xy(4)], content, report);
            }
        }
        Kind::Targets40 => {
            for item in items {
                let v: [f32; 9] = f32s(&item[4..]);
                let xyz = |at: usize, z: usize| [v[at], v[at + 1], v[z]];
                push_target(item, [xyz(0, 6), xyz(2, 7), xyz(4, 8)], content, report);
            }
        }
        Kind::OverheadTargets => {
            for item in items {
                let v: [f32; 9] = f32s(&item[4..]);
                let xyz = |at: usize| [v[at], v[at + 1], v[at + 2]];
                push_target(item, [xyz(0), xyz(3), xyz(6)], content, report);
            }
        }
        Kind::Heights => {
            for item in items {
                let [top_m, bottom_m] = f32s(&item[4..]);
                if !(f32::abs(top_m) <= MAX_RANGE_M && f32::abs(bottom_m) <= MAX_RANGE_M) {
                    report.targets_dropped += 1;
                    continue;
                }
                let [id] = u32s(item);
                content.heights.push(TargetHeight {
                    id,
                    top_m,
                    bottom_m,
                });
            }
        }
        Kind::Indices => content.indices.extend(items.flatten()),
        Kind::Presence => content.presence = Some(u32s::<1>(units)[0]),
        Kind::ZonePresence => {
            // The flags have room for 32 zones; the demo has at most as many.
            let zones = items
                .flatten()
                .flat_map(|four| [0, 2, 4, 6].map(|shift| four >> shift & 3))
                .take(usize::from(units[0]).min(32));
            let flags = zones.enumerate().filter(|(_, state)| *state != 0);
            content.occupied_zones = Some(flags.fold(0, |all, (zone, _)| all | 1 << zone));
        }
        Kind::Unused => {}
    }
}

fn push_target(item: &[u8], v: [[f32; 3]; 3], content: &mut Content, report: &mut UartReport) {
    let limits = [MAX_RANGE_M, MAX_SPEED_MPS, MAX_ACCELERATION_MPS2];
    let is_possible =
        |v: &f32, limit: f32| v.abs() <= limit && (*v == 0.0 || v.abs() >= MIN_MAGNITUDE);
    let mut vectors = v.iter().zip(limits);
    if !vectors.all(|(v, limit)| v.iter().all(|v| is_possible(v, limit))) {
        report.targets_dropped += 1;
        return;
    }
    let [id] = u32s(item);
    content.targets.push(Target {
        id,
        position_m: v[0],
        velocity_mps: v[1],
        acceleration_mps2: v[2],
    });
}

/// Assigns SNR to points and removes damaged points. The side information is used only if it has one entry per point.
pub(super) fn with_snr(
    points: &[Slot],
    side_info: &[SideInfo],
    report: &mut UartReport,
) -> Vec<RadarPoint> {
    let fits = side_info.len() == points.len();
    if !fits && !side_info.is_empty() {
        report.side_info_mismatches += 1;
    }
    let mut kept = Vec::with_capacity(points.iter().flatten().count());
    for (i, slot) in points.iter().enumerate() {
        let Some((mut point, own_db)) = *slot else {
            continue;
        };
        let listed_db = side_info
            .get(i)
            .filter(|info| fits && is_listed_snr(info))
            .map(|[snr, _]| f32::from(*snr) * 0.1);
        match own_db.or(listed_db) {
            Some(db) => point.intensity_db = db,
            None => report.points_without_snr += 1,
        }
        kept.push(point);
    }
    report.points += kept.len() as u64;
    kept
}
