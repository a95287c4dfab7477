//! Made-up packets of TI's demos.

use radarllm_formats::uart::{Dialect, MAGIC};

pub fn words(values: &[u32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

pub fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// A packet as the firmware sends it, padded to 32 bytes. Its header counts no objects.
pub fn packet(dialect: Dialect, number: u32, tlvs: &[(u32, Vec<u8>)]) -> Vec<u8> {
    packet_of(dialect, number, [0, 0], tlvs)
}

/// A packet whose header counts objects, and points of minor motion or static points, where the dialect has such counts.
pub fn packet_of(
    dialect: Dialect,
    number: u32,
    [n_objects, n_more]: [u32; 2],
    tlvs: &[(u32, Vec<u8>)],
) -> Vec<u8> {
    let own = if dialect.tlv_length_includes_header() {
        8
    } else {
        0
    };
    let mut body = Vec::new();
    for (kind, payload) in tlvs {
        body.extend(words(&[*kind, payload.len() as u32 + own]));
        body.extend(payload);
    }
    let total = (dialect.header_len() + body.len()).next_multiple_of(32) as u32;
    let n = tlvs.len() as u32;
    let mut bytes = MAGIC.to_vec();
    let [version, platform] = match dialect {
        Dialect::Sdk1 => [0x0101_0004, 0xA1443],
        Dialect::Sdk2 => [0x0201_0004, 0xA1642],
        Dialect::PeopleTracking6844 => [0x0100_0005, 0xA6844],
        _ => [0x0306_0000, 0xA6843],
    };
    let start = [version, total, platform, number, 77, n_objects];
    bytes.extend(words(&match dialect {
        Dialect::Sdk1 => [&start[..], &[n]].concat(),
        Dialect::Sdk2 | Dialect::Sdk3 => [&start[..], &[n, 0]].concat(),
        Dialect::AreaScanner => [&start[..], &[n, 0, n_more]].concat(),
        Dialect::PeopleTracking6844 => [&start[..], &[n_more, n, 0]].concat(),
        Dialect::PeopleCounting3d => vec![version, total, platform, number, 0, 9, 9, 9, 9, n],
        Dialect::PeopleCounting2d | Dialect::PeopleCounting2dCompact | Dialect::Overhead3d => {
            vec![version, platform, 77, total, number, 0, 9, 9, 9, 9, n]
        }
    }));
    if dialect.has_checksum() {
        let end = dialect.header_len() - 2;
        let mut sum: u32 = bytes[..end]
            .chunks_exact(2)
            .map(|w| u32::from(u16::from_le_bytes([w[0], w[1]])))
            .sum();
        sum = (sum & 0xFFFF) + (sum >> 16);
        bytes[end..].copy_from_slice(&(!(sum as u16)).to_le_bytes());
    }
    bytes.extend(body);
    bytes.resize(total as usize, 0);
    bytes
}

/// Units and one point of TLV 1020: elevation and azimuth in degrees, range 2 m, 0.5 m/s, 20 dB.
pub fn spherical_compact(elevation_deg: f32, azimuth_deg: f32) -> Vec<u8> {
    let mut payload = floats(&[
        elevation_deg.to_radians() / 20.0,
        azimuth_deg.to_radians() / 40.0,
        0.01,
        0.001,
        0.1,
    ]);
    payload.extend([20, 40, 50, 0]);
    payload.extend(2000_u16.to_le_bytes());
    payload.extend(1000_u16.to_le_bytes());
    payload
}

/// A point at range 2 m, azimuth 30 degrees, elevation 10 degrees (0 in a plane), 0.5 m/s, 20 dB, in a dialect's own form.
/// Where velocities are Doppler bins, it is 5 of them.
pub fn one_point(dialect: Dialect) -> Vec<(u32, Vec<u8>)> {
    let azimuth = 30_f32.to_radians();
    let elevation = 10_f32.to_radians();
    let flat = 2.0 * elevation.cos();
    let [x, y, z] = [
        flat * azimuth.sin(),
        flat * azimuth.cos(),
        2.0 * elevation.sin(),
    ];
    match dialect {
        Dialect::Sdk3 => vec![(1, floats(&[x, y, z, 0.5])), (7, vec![200, 0, 50, 0])],
        Dialect::Sdk2 | Dialect::Sdk1 => {
            // One object, 13 binary places; range bin, Doppler bin and peak, 10 log10(99 + 1) = 20.
            let mut payload = [1_u16, 13, 46, 5, 99].map(u16::to_le_bytes).concat();
            payload.extend(
                [x, y, z]
                    .iter()
                    .flat_map(|v| ((8192.0 * v).round() as i16).to_le_bytes()),
            );
            vec![(1, payload), (2, vec![0, 2, 0, 4])]
        }
        Dialect::AreaScanner => vec![
            (1, floats(&[2.0, azimuth, elevation, 0.5])),
            (7, vec![200, 0, 50, 0]),
            (8, floats(&[1.0, 3.0, 0.0, 0.0])),
            (9, vec![100, 0, 50, 0]),
        ],
        Dialect::PeopleTracking6844 => {
            vec![(1020, spherical_compact(10.0, 30.0)), (1011, vec![255])]
        }
        Dialect::PeopleCounting3d => vec![
            (6, spherical_compact(10.0, 30.0)),
            (8, vec![255]),
            (11, words(&[1])),
        ],
        Dialect::PeopleCounting2d => vec![(6, floats(&[2.0, azimuth, 0.5, 100.0])), (8, vec![255])],
        Dialect::Overhead3d => vec![
            (6, floats(&[2.0, azimuth, elevation, 0.5, 100.0])),
            (8, vec![255]),
        ],
        Dialect::PeopleCounting2dCompact => {
            let mut payload = floats(&[30_f32.to_radians() / 40.0, 0.01, 0.001, 0.1]);
            payload.extend([40, 50]);
            payload.extend(2000_u16.to_le_bytes());
            payload.extend(1000_u16.to_le_bytes());
            vec![(6, payload), (8, vec![255])]
        }
    }
}

pub fn stream(dialect: Dialect, n: u32) -> Vec<u8> {
    (0..n)
        .flat_map(|i| packet(dialect, 100 + i, &one_point(dialect)))
        .collect()
}
