//! Damaged and random input: an error or a result, never a panic, and never more memory than the input
//! and one frame account for (the readers grow their buffers with what they read; see the limits there).

use proptest::prelude::*;
use radarllm_formats::{
    adc::{
        AdcReader, AxisOrder, CubeShape, FrameDecoder, FrameSource, RecordLog, StudioCapture,
        StudioSetup,
    },
    dca1000::{Assembler, DataPacket, PacketFrames, PacketSource, PcapPackets, RecordReader},
    pcap::PcapReader,
};

use crate::{
    made::{self, I_FIRST, PcapStyle, datagrams, four, two},
    studio::EXPORT,
};

const SHAPE: CubeShape = CubeShape {
    n_loops: 2,
    n_tx: 2,
    n_rx: 4,
    n_samples: 8,
};

/// Runs a parser over input and counts what came out.
type Parser = fn(&[u8]) -> u64;

fn adc_bin(input: &[u8]) -> u64 {
    let mut n = 0;
    for layout in [two(I_FIRST), four(15, I_FIRST)] {
        let mut reader = AdcReader::new(input, FrameDecoder::new(SHAPE, layout).unwrap());
        let mut cube = SHAPE.zeros().unwrap();
        while let Ok(Some(_)) = reader.next_frame(&mut cube) {
            n += 1;
        }
        assert!(reader.trailing_bytes() < 512);
    }
    n
}

/// Datagrams of random length cut out of the input.
fn packets(input: &[u8]) -> u64 {
    let mut assembler = Assembler::new(700).unwrap();
    let mut rest = input;
    let mut n = 0;
    while let Some((first, tail)) = rest.split_first_chunk::<2>() {
        let length = usize::from(u16::from_le_bytes(*first) % 1500).min(tail.len());
        let (datagram, tail) = tail.split_at(length);
        if let Ok(packet) = DataPacket::parse(datagram) {
            n += assembler.push(&packet).len() as u64;
        }
        rest = tail;
    }
    n + assembler.finish().len() as u64
}

fn records(input: &[u8]) -> u64 {
    let decoder = FrameDecoder::new(SHAPE, two(I_FIRST)).unwrap();
    drain(RecordReader::new(input), decoder)
}

fn pcap(input: &[u8]) -> u64 {
    let mut n = 0;
    if let Ok(mut reader) = PcapReader::new(input) {
        let mut datagram = Vec::new();
        while let Ok(Some(_)) = reader.next_udp(&mut datagram) {
            assert!(datagram.len() <= input.len());
            n += 1;
        }
    }
    match PcapPackets::new(input) {
        Ok(source) => n + drain(source, FrameDecoder::new(SHAPE, two(I_FIRST)).unwrap()),
        Err(_) => n,
    }
}

fn drain(source: impl PacketSource, decoder: FrameDecoder) -> u64 {
    let mut frames = PacketFrames::new(source, decoder).unwrap();
    let mut cube = SHAPE.zeros().unwrap();
    let mut n = 0;
    while let Ok(Some(integrity)) = frames.next_frame(&mut cube) {
        assert!(integrity.missing_bytes() < integrity.frame_bytes);
        n += 1;
    }
    n
}

fn texts(input: &[u8]) -> u64 {
    let text = String::from_utf8_lossy(input);
    u64::from(RecordLog::parse(&text).is_ok_and(|log| !log.problems().is_empty()))
        + u64::from(StudioCapture::parse(&text, None).is_ok())
        + u64::from(StudioSetup::parse(&text).is_ok())
        + u64::from(AxisOrder::parse(&text).is_ok())
}

const PARSERS: [Parser; 5] = [adc_bin, packets, records, pcap, texts];

/// Whole files of every kind.
fn seeds() -> Vec<Vec<u8>> {
    let stream: Vec<u8> = (0..5000_u32).map(|i| i as u8).collect();
    let sent = datagrams(&stream, 1456);
    let framed: Vec<Vec<u8>> = sent
        .iter()
        .map(|d| made::ethernet(1, &made::ipv4(4098, d)))
        .collect();
    let style = PcapStyle {
        is_big_endian: true,
        is_nanoseconds: false,
        link: 1,
    };
    let lengths: Vec<u8> = sent
        .iter()
        .flat_map(|d| [&(d.len() as u16).to_le_bytes()[..], d].concat())
        .collect();
    vec![
        stream.clone(),
        lengths,
        made::records(&sent),
        made::pcap(&style, &framed),
        made::pcapng(false, 1, &framed),
        EXPORT.into(),
        b"Raw Data :\nOut of sequence count - 3\nNumber of received packets - 9\n".to_vec(),
    ]
}

/// The seeds must reach the parsers' insides: each is accepted by one of them.
#[test]
fn every_seed_is_accepted_whole() {
    for (i, seed) in seeds().iter().enumerate() {
        let parser = [0, 1, 2, 3, 3, 4, 4][i];
        assert!(PARSERS[parser](seed) > 0, "seed {i}");
    }
}

#[test]
fn files_cut_anywhere_are_survived() {
    for seed in seeds() {
        for end in 0..seed.len() {
            // Every place of the headers, then every seventh.
            if end < 200 || end % 7 == 0 {
                for parser in PARSERS {
                    parser(&seed[..end]);
                }
            }
        }
    }
}

proptest! {
    #[test]
    fn random_bytes_are_survived(input in prop::collection::vec(any::<u8>(), 0..3000)) {
        for parser in PARSERS {
            parser(&input);
        }
    }

    #[test]
    fn changed_files_are_survived(
        index in 0_usize..7,
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..9),
    ) {
        let mut file = seeds().swap_remove(index);
        for (at, value) in changes {
            let at = at.index(file.len());
            file[at] = value;
        }
        for parser in PARSERS {
            parser(&file);
        }
    }

    /// Words that mean something to one of the text formats, in any order.
    #[test]
    fn shuffled_text_is_survived(
        words in prop::collection::vec(prop::sample::select(vec![
            "{", "}", "[", "]", ":", ",", "\"mmWaveDevices\"", "\"rfConfig\"", "\"0x", "1e308", "-1", "null",
            "Out of sequence count", " - ", "\n", "Raw Data :", "sample", "frame", "99999999999999999999",
        ]), 0..60),
    ) {
        texts(words.concat().as_bytes());
    }
}
