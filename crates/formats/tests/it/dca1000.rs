//! Packets of the capture card: placed by their counters, whatever happened on the way.

use proptest::prelude::*;
use radarllm_formats::{
    adc::{CubeShape, FrameDecoder, FrameSource},
    dca1000::{
        AssembledFrame, Assembler, DATA_PORT, DataPacket, PacketFrames, PacketSource, PcapPackets,
        RecordReader, TransferSummary, starts_with_record,
    },
};

use crate::made::{self, I_FIRST, PcapStyle, bytes, datagram, datagrams, echo, two, words};

fn stream(n: usize) -> Vec<u8> {
    // Never zero, so that filled gaps are told from data.
    (0..n).map(|i| (i % 251) as u8 + 1).collect()
}

/// A list of one range.
fn gap(start: usize, end: usize) -> Vec<std::ops::Range<usize>> {
    std::iter::once(start..end).collect()
}

fn assemble(frame_bytes: usize, packets: &[Vec<u8>]) -> (Vec<AssembledFrame>, TransferSummary) {
    let mut assembler = Assembler::new(frame_bytes).unwrap();
    let mut frames = Vec::new();
    for p in packets {
        frames.extend(assembler.push(&DataPacket::parse(p).unwrap()));
    }
    frames.extend(assembler.finish());
    (frames, assembler.summary().clone())
}

/// Every byte is the stream's or marked missing and zero.
fn check_bytes(frames: &[AssembledFrame], stream: &[u8]) {
    for f in frames {
        let start = f.integrity.frame as usize * f.bytes.len();
        for (i, byte) in f.bytes.iter().enumerate() {
            let is_missing = f.integrity.missing.iter().any(|gap| gap.contains(&i));
            let expected = if is_missing { 0 } else { stream[start + i] };
            assert_eq!(*byte, expected, "frame {}, byte {i}", f.integrity.frame);
        }
    }
}

/// The second packet of a recording, byte for byte: number 2, 1456 bytes before it.
#[test]
fn packets_have_a_number_and_a_byte_count() {
    let second = &datagrams(&stream(4000), 1456)[1];
    assert_eq!(second[..10], [2, 0, 0, 0, 0xb0, 0x05, 0, 0, 0, 0]);
    let packet = DataPacket::parse(second).unwrap();
    assert_eq!(
        (packet.sequence, packet.byte_count, packet.payload.len()),
        (2, 1456, 1456)
    );
    for n in [0, 9, 10, 1467] {
        assert!(DataPacket::parse(&vec![0; n]).is_err(), "{n}");
    }
}

#[test]
fn a_lost_packet_is_a_gap_at_its_place() {
    let stream = stream(10_000);
    let mut packets = datagrams(&stream, 1456);
    packets.remove(2);
    let (frames, summary) = assemble(4000, &packets);
    check_bytes(&frames, &stream);
    // Bytes 2912 to 4368 are gone: the end of frame 0 and the start of frame 1.
    assert_eq!(frames[0].integrity.missing, gap(2912, 4000));
    assert_eq!(frames[1].integrity.missing, gap(0, 368));
    assert_eq!(
        (summary.lost, summary.damaged_frames, summary.trailing_bytes),
        (1, 2, 2000)
    );
    assert_eq!(
        (summary.first_sequence, summary.last_sequence),
        (Some(1), Some(7))
    );
}

#[test]
fn reordered_and_repeated_packets_do_no_harm() {
    let stream = stream(30_000);
    let mut packets = datagrams(&stream, 1456);
    packets.swap(3, 4);
    packets.swap(0, 1);
    packets.insert(9, packets[8].clone());
    let (frames, summary) = assemble(5000, &packets);
    check_bytes(&frames, &stream);
    assert!(frames.iter().all(|f| f.integrity.is_complete()));
    assert_eq!(frames.len(), 6);
    assert_eq!(
        (summary.out_of_order, summary.duplicates, summary.lost),
        (2, 1, 0)
    );
    let by_frame: Vec<_> = frames
        .iter()
        .map(|f| {
            (
                f.integrity.packets,
                f.integrity.out_of_order,
                f.integrity.duplicates,
            )
        })
        .collect();
    assert_eq!(by_frame[0], (4, 2, 0));
    // The repeated one included.
    assert_eq!(by_frame[2], (5, 0, 1));
}

#[test]
fn forged_counters_neither_allocate_nor_displace() {
    let stream = stream(100_000);
    let mut packets = datagrams(&stream, 1456);
    let n = packets.len();
    for (at, count) in [
        (0, 1 << 47),
        (5, (1 << 48) - 1),
        (20, 900_000_000_000),
        (50, 2_000_000),
    ] {
        packets.insert(at, datagram(7, count, &[9; 1456]));
    }
    let (frames, summary) = assemble(5000, &packets);
    check_bytes(&frames, &stream);
    assert_eq!(frames.len(), 20);
    assert!(
        frames.iter().all(|f| f.integrity.is_complete()),
        "{summary:?}"
    );
    assert_eq!((summary.refused, summary.lost), (4, 0));
    assert_eq!(summary.packets, n as u64 + 4);
}

#[test]
fn a_recording_that_starts_late_starts_at_its_place() {
    let stream = stream(40_000);
    let packets = datagrams(&stream, 1456)[10..].to_vec();
    let (frames, summary) = assemble(8000, &packets);
    check_bytes(&frames, &stream);
    // 14,560 bytes went before: frame 0 never came, frame 1 lacks its first 6,560 bytes.
    assert_eq!(frames[0].integrity.frame, 1);
    assert_eq!(frames[0].integrity.missing, gap(0, 6560));
    assert_eq!(
        (summary.first_sequence, summary.lost, frames.len()),
        (Some(11), 0, 4)
    );
}

#[test]
fn a_long_pause_is_counted_in_frames() {
    let stream = stream(3_000_000);
    let all = datagrams(&stream, 1456);
    let packets = [&all[..100], &all[1500..]].concat();
    let (frames, summary) = assemble(20_000, &packets);
    check_bytes(&frames, &stream);
    // 145,600 bytes came, then from 2,184,000 on: frames 8 to 108 never came at all.
    assert_eq!(
        (summary.lost, summary.lost_frames, summary.refused),
        (1400, 101, 0)
    );
    assert_eq!(frames[7].integrity.missing, gap(5600, 20_000));
    assert_eq!(
        (
            frames[8].integrity.frame,
            frames[8].integrity.missing.clone()
        ),
        (109, gap(0, 4000))
    );
    assert_eq!(frames.len() as u64, summary.frames);
}

#[test]
fn one_packet_is_a_recording_and_none_is_none() {
    let (frames, summary) = assemble(100, &datagrams(&stream(250), 1456));
    assert_eq!(
        (frames.len(), summary.trailing_bytes, summary.refused),
        (2, 50, 0)
    );
    let (frames, summary) = assemble(100, &[]);
    assert_eq!((frames.len(), summary), (0, TransferSummary::default()));
}

proptest! {
    /// Loss, repetition and reordering within the window, packets of any size, frames of any size.
    #[test]
    fn every_byte_is_right_or_marked(
        n in 1_usize..60_000, payload in 1_usize..=1456, frame_bytes in 1_usize..9000,
        fates in prop::collection::vec((0_u8..10, 0_usize..40), 0..300),
    ) {
        let payload = payload.max(n / 300 + 1).min(1456);
        let stream = stream(n);
        let mut sent: Vec<(usize, Vec<u8>)> = Vec::new();
        for (i, packet) in datagrams(&stream, payload).into_iter().enumerate() {
            let (fate, delay) = fates.get(i).copied().unwrap_or((5, 0));
            match fate {
                0 => {}
                1 => sent.extend([(i, packet.clone()), (i + delay, packet)]),
                2 => sent.push((i + delay, packet)),
                _ => sent.push((i, packet)),
            }
        }
        sent.sort_by_key(|(at, _)| *at);
        let packets: Vec<Vec<u8>> = sent.into_iter().map(|(_, p)| p).collect();
        let (frames, summary) = assemble(frame_bytes, &packets);
        check_bytes(&frames, &stream);
        prop_assert!(frames.windows(2).all(|f| f[0].integrity.frame < f[1].integrity.frame));
        prop_assert_eq!(summary.packets as usize, packets.len());
        prop_assert_eq!(summary.frames as usize, frames.len());
    }
}

#[test]
fn records_of_a_file_are_packets_and_are_recognised() {
    let shape = CubeShape {
        n_loops: 4,
        n_tx: 2,
        n_rx: 4,
        n_samples: 64,
    };
    let cubes: Vec<_> = (0..3).map(|i| echo(shape, 5.0, 20.0, i)).collect();
    let stream: Vec<u8> = cubes
        .iter()
        .flat_map(|c| bytes(&words(c, two(I_FIRST))))
        .collect();
    let file = made::records(&datagrams(&stream, 1456));
    // The symptom by which such files are known: words 1, 0, 1456, 0.
    assert_eq!(file[..8], [1, 0, 0, 0, 0xb0, 0x05, 0, 0]);
    assert!(
        starts_with_record(&file)
            && !starts_with_record(&stream)
            && !starts_with_record(&file[..13])
    );
    let decoder = FrameDecoder::new(shape, two(I_FIRST)).unwrap();
    let mut frames = PacketFrames::new(RecordReader::new(&file[..]), decoder).unwrap();
    let mut cube = shape.zeros().unwrap();
    for expected in &cubes {
        assert!(frames.next_frame(&mut cube).unwrap().unwrap().is_complete());
        assert_eq!(&cube, expected);
    }
    assert_eq!(frames.next_frame(&mut cube).unwrap(), None);
    let mut damaged = file.clone();
    damaged[1456 + 14 + 5] = 0xff;
    let mut reader = RecordReader::new(&damaged[..]);
    assert!(reader.next_packet().unwrap().is_some());
    let error = reader.next_packet().unwrap_err().to_string();
    assert!(
        error.starts_with("byte 1474: expected the length"),
        "{error}"
    );
}

fn packets_of(file: &[u8]) -> (Vec<Vec<u8>>, u64, u64) {
    let mut source = PcapPackets::new(file).unwrap();
    let mut found = Vec::new();
    while let Some(p) = source.next_packet().unwrap() {
        found.push(datagram(p.sequence, p.byte_count, p.payload));
    }
    (found, source.skipped(), source.pcap().others())
}

#[test]
fn pcap_files_of_all_kinds_give_the_same_packets() {
    let sent = datagrams(&stream(5000), 1456);
    let ip: Vec<Vec<u8>> = sent.iter().map(|d| made::ipv4(DATA_PORT, d)).collect();
    let ethernet = |tags| -> Vec<Vec<u8>> { ip.iter().map(|p| made::ethernet(tags, p)).collect() };
    let cooked: Vec<Vec<u8>> = ip
        .iter()
        .map(|p| [&[0; 14][..], &[8, 0], p].concat())
        .collect();
    let cooked_2: Vec<Vec<u8>> = ip
        .iter()
        .map(|p| [&[8, 0][..], &[0; 18], p].concat())
        .collect();
    let loopback: Vec<Vec<u8>> = ip.iter().map(|p| [&[2, 0, 0, 0][..], p].concat()).collect();
    for (link, packets) in [
        (1, ethernet(0)),
        (1, ethernet(1)),
        (1, ethernet(2)),
        (101, ip.clone()),
        (228, ip.clone()),
        (113, cooked),
        (276, cooked_2),
        (0, loopback),
    ] {
        for is_big_endian in [false, true] {
            for is_nanoseconds in [false, true] {
                let style = PcapStyle {
                    is_big_endian,
                    is_nanoseconds,
                    link,
                };
                let found = packets_of(&made::pcap(&style, &packets));
                assert_eq!(found, (sent.clone(), 0, 0), "link {link}");
            }
            let found = packets_of(&made::pcapng(is_big_endian, link as u16, &packets));
            assert_eq!(found, (sent.clone(), 0, 0), "pcapng, link {link}");
        }
    }
}

#[test]
fn other_traffic_is_counted_and_left_out() {
    let sent = datagrams(&stream(3000), 1456);
    let data = |d: &Vec<u8>| made::ethernet(0, &made::ipv4(DATA_PORT, d));
    let mut fragment = data(&sent[0]);
    fragment[14 + 6] = 0x20;
    let mut tcp = data(&sent[0]);
    tcp[14 + 9] = 6;
    let mut arp = data(&sent[0]);
    arp[13] = 6;
    let control = made::ethernet(0, &made::ipv4(4096, &[0x5a, 0xa5, 9, 0]));
    let cut = data(&sent[1])[..200].to_vec();
    let packets = [
        data(&sent[0]),
        fragment,
        tcp,
        arp,
        control,
        cut,
        data(&sent[2]),
        vec![],
    ];
    let style = PcapStyle {
        is_big_endian: false,
        is_nanoseconds: false,
        link: 1,
    };
    let mut file = made::pcap(&style, &packets);
    let found = packets_of(&file);
    assert_eq!(found, (vec![sent[0].clone(), sent[2].clone()], 1, 4));
    // A recorder that was stopped while it wrote.
    file.extend([0; 20]);
    let mut source = PcapPackets::new(&file[..file.len() - 8]).unwrap();
    while source.next_packet().unwrap().is_some() {}
    assert_eq!(source.pcap().cut_bytes(), 12);
    // Links and lengths that cannot be read are named with their place.
    let error = |file: &[u8]| match PcapPackets::new(file) {
        Err(e) => e.to_string(),
        Ok(mut source) => loop {
            match source.next_packet() {
                Err(e) => break e.to_string(),
                Ok(p) => assert!(p.is_some()),
            }
        },
    };
    let mut wifi = file.clone();
    wifi[20] = 105;
    assert!(error(&wifi).starts_with("byte 20: expected a link type"));
    let mut long = file.clone();
    long[24 + 11] = 0x7f;
    assert!(error(&long).starts_with("byte 32: expected the length of a packet"));
    assert!(error(b"RIFF....").starts_with("byte 0: expected the first bytes"));
}

#[test]
fn complete_frames_need_no_packets_after_them() {
    let stream = stream(5000);
    let packets = datagrams(&stream, 700);
    let mut assembler = Assembler::new(1000).unwrap();
    let mut frames = Vec::new();
    let mut n_given = Vec::new();
    for (i, p) in packets.iter().enumerate() {
        // One packet of the fourth frame arrives last.
        if i != 5 {
            assert!(assembler.push(&DataPacket::parse(p).unwrap()).is_empty());
            frames.extend(assembler.take_complete());
            n_given.push(frames.len());
        }
    }
    // The first packet waits for the second to confirm it.
    assert_eq!(n_given, [0, 1, 2, 2, 3, 3, 3]);
    assert!(
        assembler
            .push(&DataPacket::parse(&packets[5]).unwrap())
            .is_empty()
    );
    frames.extend(assembler.take_complete());
    assert_eq!(frames.len(), 5);
    check_bytes(&frames, &stream);
    assert!(assembler.finish().is_empty());
    assert_eq!(assembler.summary().trailing_bytes, 0);
    assert_eq!(
        (
            assembler.summary().frames,
            assembler.summary().damaged_frames
        ),
        (5, 0)
    );
}
