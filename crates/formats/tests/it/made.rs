//! Captures made by the tests: samples, words, packets, pcap files.

use num_complex::Complex32;
use radarllm_base::RadarCube;
use radarllm_formats::adc::{CubeShape, IqOrder, LvdsLanes, SampleKind, SampleLayout};

pub const I_FIRST: SampleKind = SampleKind::Complex {
    order: IqOrder::IFirst,
};
pub const Q_FIRST: SampleKind = SampleKind::Complex {
    order: IqOrder::QFirst,
};

/// 10 frames/s, 4.8 cm, 4.9 m/s, 500 KiB of cube and map: nothing to say about it.
pub const CLEAN_CFG: &str = "% Platform:xWR18xx
dfeDataOutputMode 1
channelCfg 15 7 0
adcCfg 2 1
adcbufCfg -1 0 1 1 1
profileCfg 0 77 7 7 58 0 0 67 1 256 5500 0 0 30
chirpCfg 0 0 0 0 0 0 0 1
chirpCfg 1 1 0 0 0 0 0 4
chirpCfg 2 2 0 0 0 0 0 2
frameCfg 0 2 40 0 100 1 0
guiMonitor -1 1 0 0 0 0 0
lvdsStreamCfg -1 0 0 0
sensorStart
";

pub fn two(data: SampleKind) -> SampleLayout {
    SampleLayout {
        lanes: LvdsLanes::Two,
        data,
    }
}

pub fn four(receivers: u8, data: SampleKind) -> SampleLayout {
    SampleLayout {
        lanes: LvdsLanes::Four { receivers },
        data,
    }
}

/// Words of whole numbers, as a device with this layout writes a cube; written from the description of
/// the format, not from the reader.
pub fn words(cube: &RadarCube, layout: SampleLayout) -> Vec<i16> {
    let mut words = Vec::new();
    let parts = |z: Complex32| match layout.data {
        Q_FIRST => [z.im as i16, z.re as i16],
        _ => [z.re as i16, z.im as i16],
    };
    for l in 0..cube.n_loops {
        for t in 0..cube.n_tx {
            match layout.lanes {
                LvdsLanes::Two => {
                    for r in 0..cube.n_rx {
                        let chirp = cube.chirp(l, t, r);
                        if layout.data == SampleKind::Real {
                            words.extend(chirp.iter().map(|z| z.re as i16));
                            continue;
                        }
                        for pair in chirp.chunks(2) {
                            words.extend(pair.iter().map(|z| parts(*z)[0]));
                            words.extend(pair.iter().map(|z| parts(*z)[1]));
                        }
                    }
                }
                LvdsLanes::Four { receivers } => {
                    for s in 0..cube.n_samples {
                        let mut lanes = [Complex32::ZERO; 4];
                        let mut rx = 0;
                        for (lane, value) in lanes.iter_mut().enumerate() {
                            if receivers >> lane & 1 == 1 {
                                *value = cube.chirp(l, t, rx)[s];
                                rx += 1;
                            }
                        }
                        words.extend(lanes.map(|z| parts(z)[0]));
                        if layout.data != SampleKind::Real {
                            words.extend(lanes.map(|z| parts(z)[1]));
                        }
                    }
                }
            }
        }
    }
    words
}

pub fn bytes(words: &[i16]) -> Vec<u8> {
    words.iter().flat_map(|w| w.to_le_bytes()).collect()
}

/// A cube of one echo at `bin` (cycles a chirp), 1000 counts, which turns a little from chirp to chirp,
/// with uniform noise of `noise` counts either way, rounded to whole counts.
pub fn echo(shape: CubeShape, bin: f64, noise: f64, seed: u64) -> RadarCube {
    let mut cube = shape.zeros().unwrap();
    let mut state = seed | 1;
    let mut random = || {
        // xorshift64*, Vigna 2016.
        state ^= state >> 12;
        state ^= state << 25;
        state ^= state >> 27;
        (state.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 11) as f64 / (1_u64 << 53) as f64 * 2.0 - 1.0
    };
    for (i, value) in cube.data.iter_mut().enumerate() {
        let (chirp, sample) = (i / shape.n_samples, i % shape.n_samples);
        let phase = std::f64::consts::TAU * bin * sample as f64 / shape.n_samples as f64
            + 0.1 * chirp as f64;
        *value = Complex32::new(
            (1000.0 * phase.cos() + noise * random()).round() as f32,
            (1000.0 * phase.sin() + noise * random()).round() as f32,
        );
    }
    cube
}

/// Datagrams of a stream, `payload` bytes each, numbered from 1.
pub fn datagrams(stream: &[u8], payload: usize) -> Vec<Vec<u8>> {
    stream
        .chunks(payload)
        .enumerate()
        .map(|(i, chunk)| datagram(i as u32 + 1, (i * payload) as u64, chunk))
        .collect()
}

pub fn datagram(sequence: u32, count: u64, payload: &[u8]) -> Vec<u8> {
    let mut bytes = sequence.to_le_bytes().to_vec();
    bytes.extend(&count.to_le_bytes()[..6]);
    bytes.extend(payload);
    bytes
}

/// The same as records of a file.
pub fn records(datagrams: &[Vec<u8>]) -> Vec<u8> {
    let mut file = Vec::new();
    for d in datagrams {
        file.extend(&d[..4]);
        file.extend(((d.len() - 10) as u32).to_le_bytes());
        file.extend(&d[4..]);
    }
    file
}

/// A UDP datagram over IPv4.
pub fn ipv4(port: u16, payload: &[u8]) -> Vec<u8> {
    let udp = 8 + payload.len() as u16;
    let mut p = vec![0x45, 0];
    p.extend((20 + udp).to_be_bytes());
    p.extend([0, 0, 0x40, 0, 64, 17, 0, 0]);
    p.extend([192, 168, 33, 180, 192, 168, 33, 30]);
    p.extend(port.to_be_bytes());
    p.extend(port.to_be_bytes());
    p.extend(udp.to_be_bytes());
    p.extend([0, 0]);
    p.extend(payload);
    p
}

/// The same in an Ethernet frame with VLAN tags.
pub fn ethernet(tags: usize, ip: &[u8]) -> Vec<u8> {
    let mut p = vec![2; 12];
    for _ in 0..tags {
        p.extend([0x81, 0x00, 0, 7]);
    }
    p.extend([0x08, 0x00]);
    p.extend(ip);
    p
}

pub struct PcapStyle {
    pub is_big_endian: bool,
    pub is_nanoseconds: bool,
    pub link: u32,
}

/// A classic pcap file.
pub fn pcap(style: &PcapStyle, packets: &[Vec<u8>]) -> Vec<u8> {
    let word = |v: u32| match style.is_big_endian {
        true => v.to_be_bytes(),
        false => v.to_le_bytes(),
    };
    let magic = if style.is_nanoseconds {
        0xa1b2_3c4d
    } else {
        0xa1b2_c3d4
    };
    let mut file = Vec::new();
    for v in [
        magic,
        if style.is_big_endian {
            0x0002_0004
        } else {
            0x0004_0002
        },
        0,
        0,
        65_535,
        style.link,
    ] {
        file.extend(word(v));
    }
    for p in packets {
        for v in [7, 9, p.len() as u32, p.len() as u32] {
            file.extend(word(v));
        }
        file.extend(p);
    }
    file
}

/// A pcapng file: a section, an interface, a name resolution block to skip, enhanced packets.
pub fn pcapng(is_big_endian: bool, link: u16, packets: &[Vec<u8>]) -> Vec<u8> {
    let word = |v: u32| match is_big_endian {
        true => v.to_be_bytes(),
        false => v.to_le_bytes(),
    };
    let half = |v: u16| match is_big_endian {
        true => v.to_be_bytes(),
        false => v.to_le_bytes(),
    };
    let block = |kind: u32, body: &[u8]| {
        let total = 12 + body.len().next_multiple_of(4);
        let mut b = word(kind).to_vec();
        b.extend(word(total as u32));
        b.extend(body);
        b.resize(total - 4, 0);
        b.extend(word(total as u32));
        b
    };
    let mut section = word(0x1a2b_3c4d).to_vec();
    section.extend(half(1));
    section.extend(half(0));
    section.extend([0xff; 8]);
    let mut file = block(0x0a0d_0d0a, &section);
    let mut interface = half(link).to_vec();
    interface.extend(half(0));
    interface.extend(word(65_535));
    file.extend(block(1, &interface));
    file.extend(block(4, &[0; 8]));
    for p in packets {
        let mut body = Vec::new();
        for v in [0, 1, 2, p.len() as u32, p.len() as u32] {
            body.extend(word(v));
        }
        body.extend(p);
        file.extend(block(6, &body));
    }
    file
}
