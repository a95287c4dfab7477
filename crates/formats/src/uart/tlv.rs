//! Contents of the TLVs.

use radarllm_base::{BoardTrack, RadarPoint};

use super::{Dialect, UartReport};

/// Maximum coordinate, m, and maximum speed, m/s. Larger values indicate damage.
const LIMIT: f32 = 1e3;

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

/// Content of one packet before SNR is assigned to points.
#[derive(Default)]
pub(super) struct Content {
    /// Points in the firmware's order with the SNR in dB, if the type contains it. `None` for a damaged point.
    pub points: Vec<Option<(RadarPoint, Option<f32>)>>,
    pub side_info: Vec<SideInfo>,
    pub static_points: Vec<Option<(RadarPoint, Option<f32>)>>,
    pub static_side_info: Vec<SideInfo>,
    pub range_profile: Vec<u16>,
    pub stats: Option<Stats>,
    pub temperatures: Option<Temperatures>,
    pub targets: Vec<Target>,
    pub heights: Vec<TargetHeight>,
    pub indices: Vec<u8>,
    pub presence: Option<u32>,
}

/// Meaning of a TLV in a dialect.
#[derive(Clone, Copy, PartialEq, Eq)]
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
    Heights,
    Indices,
    Presence,
    /// Known, but not used: heat maps and the noise profile.
    Unused,
}

impl Kind {
    /// Meaning of a TLV type; `None` if the dialect does not define it.
    pub(super) fn of(dialect: Dialect, number: u32) -> Option<Self> {
        Some(match (dialect, number) {
            (Dialect::Sdk3, 1) => Self::CartesianPoints,
            (Dialect::AreaScanner, 1) => Self::SphericalPoints,
            (Dialect::Sdk3 | Dialect::AreaScanner, 2) => Self::RangeProfile,
            (Dialect::Sdk3 | Dialect::AreaScanner, 3..=5) => Self::Unused,
            (Dialect::Sdk3 | Dialect::AreaScanner, 6) => Self::Stats,
            (Dialect::Sdk3 | Dialect::AreaScanner, 7) => Self::SideInfo,
            (Dialect::Sdk3, 8) => Self::Unused,
            (Dialect::Sdk3, 9) => Self::Temperatures,
            (Dialect::Sdk3, 301) => Self::CartesianCompact,
            (Dialect::Sdk3, 1010) => Self::Targets112,
            (Dialect::Sdk3, 1011) => Self::Indices,
            (Dialect::Sdk3, 1012) => Self::Heights,
            (Dialect::Sdk3, 1020) => Self::SphericalCompact,
            (Dialect::Sdk3, 1021) => Self::Presence,
            (Dialect::AreaScanner, 8) => Self::StaticPoints,
            (Dialect::AreaScanner, 9) => Self::StaticSideInfo,
            (Dialect::AreaScanner, 10) => Self::Targets40,
            (Dialect::AreaScanner, 11) => Self::Indices,
            (Dialect::PeopleCounting3d, 6) => Self::SphericalCompact,
            (Dialect::PeopleCounting3d, 7) => Self::Targets112,
            (Dialect::PeopleCounting3d, 11) => Self::Presence,
            (Dialect::PeopleCounting2d, 6) => Self::PolarPoints,
            (Dialect::PeopleCounting2dCompact, 6) => Self::PolarCompact,
            (Dialect::PeopleCounting2d | Dialect::PeopleCounting2dCompact, 7) => Self::Targets68,
            (
                Dialect::PeopleCounting3d
                | Dialect::PeopleCounting2d
                | Dialect::PeopleCounting2dCompact,
                8,
            ) => Self::Indices,
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
            Self::SphericalCompact => (20, 8),
            Self::CartesianCompact => (20, 10),
            Self::SideInfo | Self::StaticSideInfo => (0, 4),
            Self::RangeProfile => (0, 2),
            Self::Stats => (24, 0),
            Self::Temperatures => (28, 0),
            Self::Targets112 => (0, 112),
            Self::Targets68 => (0, 68),
            Self::Targets40 => (0, 40),
            Self::Heights => (0, 12),
            Self::Presence => (4, 0),
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
        if self == Self::CartesianCompact {
            // The payload contains major and minor points, which are counted separately.
            let count = |at: usize| usize::from(u16::from_le_bytes([units[at], units[at + 1]]));
            if count(16) + count(18) != items.len() / item {
                return None;
            }
        }
        Some((units, items.chunks_exact(item.max(1))))
    }
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

/// Checks a point. Returns `None` and increments a count if a value is not finite or out of range.
fn point(
    position_m: [f32; 3],
    velocity_mps: f32,
    snr_db: Option<f32>,
    report: &mut UartReport,
) -> Option<(RadarPoint, Option<f32>)> {
    let [x_m, y_m, z_m] = position_m;
    let values = [x_m, y_m, z_m, velocity_mps, snr_db.unwrap_or(0.0)];
    if values.iter().any(|v| !v.is_finite()) {
        report.points_not_finite += 1;
        return None;
    }
    if values.iter().any(|v| v.abs() > LIMIT) {
        report.points_out_of_range += 1;
        return None;
    }
    let point = RadarPoint {
        x_m,
        y_m,
        z_m,
        range_m: (x_m * x_m + y_m * y_m + z_m * z_m).sqrt(),
        velocity_mps,
        intensity_db: 0.0,
    };
    Some((point, snr_db))
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

/// A linear power ratio in dB; `None` for zero.
fn ratio_db(snr: f32) -> Option<f32> {
    (snr > 0.0).then(|| 10.0 * snr.log10())
}

/// Adds a payload of a kind to the content. The layout was checked by [`Kind::split`].
pub(super) fn decode(
    kind: Kind,
    units: &[u8],
    items: std::slice::ChunksExact<'_, u8>,
    content: &mut Content,
    report: &mut UartReport,
) {
    match kind {
        Kind::CartesianPoints | Kind::StaticPoints => {
            let points = items.map(|item| {
                let [x, y, z, v] = f32s(item);
                point([x, y, z], v, None, report)
            });
            if kind == Kind::StaticPoints {
                content.static_points.extend(points);
            } else {
                content.points.extend(points);
            }
        }
        Kind::SphericalPoints => content.points.extend(items.map(|item| {
            let [range, azimuth, elevation, v] = f32s(item);
            point(from_sphere(range, azimuth, elevation), v, None, report)
        })),
        Kind::PolarPoints => content.points.extend(items.map(|item| {
            let [range, azimuth, v, snr] = f32s(item);
            point(from_sphere(range, azimuth, 0.0), v, ratio_db(snr), report)
        })),
        Kind::PolarCompact => {
            let [azimuth, velocity, range, snr] = f32s(units);
            content.points.extend(items.map(|item| {
                let position_m = from_sphere(
                    range * u16_at(item, 2),
                    azimuth * f32::from(item[0] as i8),
                    0.0,
                );
                let v = velocity * f32::from(item[1] as i8);
                point(position_m, v, ratio_db(snr * u16_at(item, 4)), report)
            }));
        }
        Kind::SphericalCompact => {
            let [elevation, azimuth, velocity, range, snr] = f32s(units);
            content.points.extend(items.map(|item| {
                let position_m = from_sphere(
                    range * u16_at(item, 4),
                    azimuth * f32::from(item[1] as i8),
                    elevation * f32::from(item[0] as i8),
                );
                let v = velocity * f32::from(i16_at(item, 2));
                point(position_m, v, ratio_db(snr * u16_at(item, 6)), report)
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
        Kind::Heights => {
            for item in items {
                let [top_m, bottom_m] = f32s(&item[4..]);
                if !(f32::abs(top_m) <= LIMIT && f32::abs(bottom_m) <= LIMIT) {
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
        Kind::Unused => {}
    }
}

fn push_target(item: &[u8], v: [[f32; 3]; 3], content: &mut Content, report: &mut UartReport) {
    if !v.iter().flatten().all(|v| v.abs() <= LIMIT) {
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
    points: Vec<Option<(RadarPoint, Option<f32>)>>,
    side_info: &[SideInfo],
    report: &mut UartReport,
) -> Vec<RadarPoint> {
    let fits = side_info.len() == points.len();
    if !fits && !side_info.is_empty() {
        report.side_info_mismatches += 1;
    }
    let mut kept = Vec::with_capacity(points.len());
    for (i, slot) in points.into_iter().enumerate() {
        let Some((mut point, own_db)) = slot else {
            continue;
        };
        let listed_db = side_info
            .get(i)
            .filter(|_| fits)
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
