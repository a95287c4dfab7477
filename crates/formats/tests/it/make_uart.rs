//! Made-up packets of TI's demos.

use radarllm_formats::uart::{Dialect, MAGIC};

pub fn words(values: &[u32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

pub fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// A packet as the firmware sends it, padded to 32 bytes.
pub fn packet(dialect: Dialect, number: u32, tlvs: &[(u32, Vec<u8>)]) -> Vec<u8> {
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
    bytes.extend(match dialect {
        Dialect::Sdk3 => words(&[0x0306_0000, total, 0xA6843, number, 77, 0, n, 0]),
        Dialect::AreaScanner => words(&[0x0306_0000, total, 0xA6843, number, 77, 0, n, 0, 0]),
        Dialect::PeopleCounting3d => {
            words(&[0x0306_0000, total, 0xA6843, number, 0, 9, 9, 9, 9, n])
        }
        _ => words(&[0x0306_0000, 0xA6843, 77, total, number, 0, 9, 9, 9, 9, n]),
    });
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

/// A point at range 2 m, azimuth 30 degrees, elevation `elevation` degrees, 0.5 m/s, 20 dB, in a dialect's own form.
pub fn one_point(dialect: Dialect) -> Vec<(u32, Vec<u8>)> {
    let azimuth = 30_f32.to_radians();
    let elevation = 10_f32.to_radians();
    match dialect {
        Dialect::Sdk3 => {
            let flat = 2.0 * elevation.cos();
            let xyz = [
                flat * azimuth.sin(),
                flat * azimuth.cos(),
                2.0 * elevation.sin(),
                0.5,
            ];
            vec![(1, floats(&xyz)), (7, vec![200, 0, 50, 0])]
        }
        Dialect::AreaScanner => vec![
            (1, floats(&[2.0, azimuth, elevation, 0.5])),
            (7, vec![200, 0, 50, 0]),
            (8, floats(&[1.0, 3.0, 0.0, 0.0])),
            (9, vec![100, 0, 50, 0]),
        ],
        Dialect::PeopleCounting3d => {
            let mut payload = floats(&[
                10_f32.to_radians() / 20.0,
                30_f32.to_radians() / 40.0,
                0.01,
                0.001,
                0.1,
            ]);
            payload.extend([20, 40, 50, 0]);
            payload.extend(2000_u16.to_le_bytes());
            payload.extend(1000_u16.to_le_bytes());
            vec![(6, payload), (8, vec![255]), (11, words(&[1]))]
        }
        Dialect::PeopleCounting2d => vec![(6, floats(&[2.0, azimuth, 0.5, 100.0])), (8, vec![255])],
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
