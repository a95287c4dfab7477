//! UART streams: every dialect there and back, damage of every kind, and two recorded streams.

use proptest::prelude::*;
use radarllm_formats::uart::{
    Dialect, MAGIC, UartError, UartFrame, UartParser, UartReport, recorded_frames,
};

use crate::{
    make::{floats, one_point, packet, stream, words},
    shared_data::shared_file,
};

fn read(dialect: Option<Dialect>, bytes: &[u8]) -> Result<(Vec<UartFrame>, UartReport), UartError> {
    read_pieces(dialect, [bytes])
}

fn read_pieces<'a>(
    dialect: Option<Dialect>,
    pieces: impl IntoIterator<Item = &'a [u8]>,
) -> Result<(Vec<UartFrame>, UartReport), UartError> {
    let mut parser = UartParser::new(dialect);
    let mut frames = Vec::new();
    for piece in pieces {
        frames.extend(parser.push(piece)?);
    }
    let (last, report, _) = parser.finish()?;
    frames.extend(last);
    Ok((frames, report))
}

fn adds_up(report: &UartReport) {
    assert_eq!(
        report.bytes,
        report.packet_bytes + report.skipped_bytes + report.trailing_bytes,
        "{report:?}"
    );
}

#[test]
fn every_dialect_is_recognised_and_read() {
    for dialect in Dialect::ALL {
        let bytes = stream(dialect, 12);
        let mut parser = UartParser::new(None).with_doppler_step(0.1);
        let mut frames = parser.push(&bytes).unwrap();
        let (last, report, guess) = parser.finish().unwrap();
        frames.extend(last);
        let guess = guess.unwrap();
        assert_eq!(guess.dialect, dialect, "{guess}");
        assert!(guess.certainty > 0.05, "{guess}");
        assert_eq!(frames.len(), 12);
        let elevation = match dialect {
            Dialect::PeopleCounting2d | Dialect::PeopleCounting2dCompact => 0.0_f32,
            _ => 10_f32.to_radians(),
        };
        for (i, frame) in frames.iter().enumerate() {
            assert_eq!(frame.number as usize, 100 + i);
            let p = frame.points[0];
            let flat = 2.0 * elevation.cos();
            assert!((p.x_m - flat * 0.5).abs() < 1e-3, "{dialect:?}: {p:?}");
            assert!(
                (p.y_m - flat * 0.75_f32.sqrt()).abs() < 1e-3,
                "{dialect:?}: {p:?}"
            );
            assert!(
                (p.z_m - 2.0 * elevation.sin()).abs() < 1e-3,
                "{dialect:?}: {p:?}"
            );
            assert!((p.range_m - 2.0).abs() < 1e-3);
            assert!((p.velocity_mps - 0.5).abs() < 1e-6);
            assert!((p.intensity_db - 20.0).abs() < 1e-3);
        }
        let n_static = if dialect == Dialect::AreaScanner {
            12
        } else {
            0
        };
        assert_eq!((report.packets, report.points), (12, 12 + n_static));
        assert_eq!(
            report.tlvs_unknown + report.tlvs_wrong_length + report.points_without_snr,
            0
        );
        adds_up(&report);
    }
}

#[test]
fn toolbox_types_come_out_in_units() {
    let mut compact = floats(&[0.01, 0.02, 0.5, 0.1]);
    compact.extend([1, 0, 1, 0]);
    compact.extend([100_i16, 200, -50, 4].iter().flat_map(|v| v.to_le_bytes()));
    compact.extend([25, 3]);
    compact.extend([0_i16, 100, 0, -4].iter().flat_map(|v| v.to_le_bytes()));
    compact.extend([10, 3]);
    let mut target = words(&[3]);
    target.extend(floats(&(0..27).map(|i| i as f32).collect::<Vec<_>>()));
    let mut height = words(&[3]);
    height.extend(floats(&[1.8, 0.1]));
    let mut temperatures = words(&[0, 1234]);
    temperatures.extend((40_i16..50).flat_map(i16::to_le_bytes));
    let bytes = packet(
        Dialect::Sdk3,
        1,
        &[
            (301, compact),
            (1010, target),
            (1011, vec![3, 255]),
            (1012, height),
            (1021, words(&[1])),
            (2, vec![0, 2, 0, 4]),
            (6, words(&[1, 2, 3, 4, 5, 6])),
            (9, temperatures),
            (4, vec![0; 16]),
        ],
    );
    let (frames, report) = read(None, &bytes).unwrap();
    let f = &frames[0];
    let p = f.points[0];
    assert_eq!([p.x_m, p.y_m, p.z_m], [1.0, 2.0, -0.5]);
    assert!((p.velocity_mps - 0.08).abs() < 1e-6);
    assert_eq!(p.intensity_db, 12.5);
    assert_eq!(f.points[1].intensity_db, 5.0);
    let t = f.targets[0];
    assert_eq!(
        (t.id, t.position_m, t.velocity_mps),
        (3, [0.0, 1.0, 2.0], [3.0, 4.0, 5.0])
    );
    assert_eq!(
        (f.heights[0].id, f.heights[0].top_m, f.heights[0].bottom_m),
        (3, 1.8, 0.1)
    );
    assert_eq!((f.indices.as_slice(), f.presence), (&[3, 255][..], Some(1)));
    assert_eq!(f.range_profile, [512, 1024]);
    assert_eq!(f.stats.unwrap().inter_frame_cpu_percent, 6);
    assert_eq!(f.temperatures.unwrap().digital_c, [48, 49]);
    assert_eq!((report.tlvs, report.tlvs_unused), (8, 1));
}

#[test]
fn what_is_dropped_is_counted() {
    let nan = [
        floats(&[f32::NAN, 1.0, 0.0, 0.0]),
        floats(&[0.5, 1.0, 0.0, 0.0]),
    ]
    .concat();
    let far = floats(&[0.0, 1e30, 0.0, 0.0]);
    let bytes = [
        vec![1, 2, 3],
        // The damaged point keeps its place: the second side info belongs to the second point.
        packet(
            Dialect::Sdk3,
            1,
            &[(1, nan.clone()), (7, vec![10, 0, 0, 0, 70, 0, 0, 0])],
        ),
        packet(Dialect::Sdk3, 2, &[(1, far)]),
        packet(Dialect::Sdk3, 5, &[(1, vec![0; 15])]),
        packet(Dialect::Sdk3, 6, &[(1, nan), (7, vec![0; 4])]),
        packet(Dialect::Sdk3, 7, &[(4242, vec![0; 4])]),
        packet(Dialect::Sdk3, 8, &[])[..20].to_vec(),
        packet(Dialect::Sdk3, 1, &[]),
        MAGIC.to_vec(),
        vec![0xFF; 40],
        packet(Dialect::Sdk3, 3, &[])[..30].to_vec(),
    ]
    .concat();
    let (frames, report) = read(Some(Dialect::Sdk3), &bytes).unwrap();
    assert_eq!(frames[0].points.len(), 1);
    assert_eq!(frames[0].points[0].intensity_db, 7.0);
    assert_eq!(report.points_not_finite, 2);
    assert_eq!(report.points_out_of_range, 1);
    assert_eq!((report.points, report.points_without_snr), (2, 1));
    assert_eq!(report.side_info_mismatches, 1);
    assert_eq!(report.tlvs_wrong_length, 1);
    assert_eq!(
        (report.tlvs_unknown, report.unknown_numbers.get(&4242)),
        (1, Some(&1))
    );
    // The cut packet 8 ends inside its header.
    assert_eq!(report.bad_headers, 2);
    assert_eq!((report.lost_frames, report.restarts), (2, 1));
    assert_eq!(report.trailing_bytes, 30);
    assert_eq!(report.packets, 6);
    assert_eq!(report.frames_without_points, 4);
    adds_up(&report);
}

#[test]
fn a_cut_packet_gives_its_number_and_no_points() {
    let mut bytes = stream(Dialect::Sdk3, 3);
    let length = bytes.len() / 3;
    bytes.drain(length + 60..length + 70);
    let (frames, report) = read(Some(Dialect::Sdk3), &bytes).unwrap();
    let seen: Vec<_> = frames
        .iter()
        .map(|f| (f.number, f.complete, f.points.len()))
        .collect();
    assert_eq!(seen, [(100, true, 1), (101, false, 0), (102, true, 1)]);
    assert_eq!(report.short_packets, 1);
    let numbers: Vec<u64> = recorded_frames(frames).iter().map(|f| f.number).collect();
    assert_eq!(numbers, [100, 102]);
    adds_up(&report);
}

#[test]
fn a_wrong_checksum_drops_the_packet() {
    let mut bytes = stream(Dialect::PeopleCounting3d, 3);
    let length = bytes.len() / 3;
    bytes[length + 21] ^= 4;
    let (frames, report) = read(Some(Dialect::PeopleCounting3d), &bytes).unwrap();
    assert_eq!(frames.len(), 2);
    assert_eq!((report.bad_checksums, report.lost_frames), (1, 1));
    adds_up(&report);
}

#[test]
fn no_packet_and_no_clear_dialect_are_errors() {
    assert_eq!(read(None, b"hello").unwrap_err(), UartError::NoPacket(5));
    // A header that every dialect without checksum can read, and bytes that are TLVs of none.
    let strange = [
        MAGIC.to_vec(),
        words(&[0, 128, 0, 1, 0, 0, 2, 0xABAB_ABAB, 0xABAB_ABAB]),
        vec![0xAB; 84],
    ]
    .concat();
    let error = read(None, &strange.repeat(3)).unwrap_err();
    assert!(matches!(error, UartError::Unclear(_)), "{error}");
    assert!(error.to_string().contains("area-scanner"));
    assert!(read(Some(Dialect::Sdk3), &strange).is_ok());
}

/// Bytes of a packet up to the end of its TLVs.
fn n_content_bytes(dialect: Dialect) -> usize {
    let tlvs = one_point(dialect);
    dialect.header_len()
        + tlvs
            .iter()
            .map(|(_, payload)| 8 + payload.len())
            .sum::<usize>()
}

#[test]
fn every_truncation_reads_what_is_whole() {
    for dialect in Dialect::ALL {
        let bytes = stream(dialect, 3);
        let length = bytes.len() / 3;
        let content = n_content_bytes(dialect);
        for end in 0..=bytes.len() {
            let (frames, report) = read(Some(dialect), &bytes[..end]).unwrap();
            // The last packet is whole if only padding is missing.
            let lacks_padding = usize::from(end % length >= content);
            let n_frames = end / length + lacks_padding;
            assert_eq!(frames.len(), n_frames, "{dialect:?} cut at {end}");
            assert!(frames.iter().all(|f| f.complete && f.points.len() == 1));
            let n_trailing = (1 - lacks_padding) * (end % length);
            assert_eq!(report.trailing_bytes as usize, n_trailing);
            adds_up(&report);
        }
    }
}

#[test]
fn recorded_demo_stream() {
    let name = "ti-mmwave-toolbox/xwr68xx_processed_stream_2019_12_04T21_44_51_663.dat";
    let Some(bytes) = shared_file(name) else {
        return;
    };
    let mut parser = UartParser::new(None);
    let mut frames = parser.push(&bytes).unwrap();
    let (last, report, guess) = parser.finish().unwrap();
    frames.extend(last);
    let guess = guess.unwrap();
    println!("{guess}");
    assert_eq!(guess.dialect, Dialect::Sdk3);
    assert_eq!(frames.len(), 101);
    assert!(frames.iter().map(|f| f.number).eq(209..=309));
    assert!(
        frames
            .iter()
            .all(|f| f.complete && f.stats.is_some() && f.range_profile.len() == 256)
    );
    // Sums over a plain struct.unpack of the file: 825 points, 4 frames without side info.
    assert_eq!(
        report.points + report.points_not_finite + report.points_out_of_range,
        825
    );
    assert_eq!(report.points, 825);
    let first = frames[0].points[1];
    assert_eq!(
        [first.x_m, first.y_m, first.z_m],
        [-0.122_642_204, 0.642_491_2, 0.0]
    );
    assert!((first.intensity_db - 24.8).abs() < 1e-4);
    assert_eq!(
        (
            report.lost_frames,
            report.short_packets,
            report.tlvs_wrong_length
        ),
        (0, 0, 0)
    );
    assert_eq!((report.skipped_bytes, report.trailing_bytes), (0, 0));
    adds_up(&report);
}

#[test]
fn recorded_stream_whose_packets_are_shorter_than_they_say() {
    let Some(bytes) = shared_file("ti-mmwave-toolbox/vital_signs_dataOutputFromEVM_AN.bin") else {
        return;
    };
    let (frames, report) = read(None, &bytes).unwrap();
    // Every header says 288 bytes, every packet has 256: no TLV after the header is believed.
    assert_eq!(frames.len(), 3095);
    assert!(frames.iter().all(|f| f.points.is_empty() && !f.complete));
    assert_eq!(report.short_packets, 3095);
    assert_eq!((frames[0].number, report.points), (663, 0));
    assert_eq!(report.trailing_bytes, 256);
    assert!(recorded_frames(frames).is_empty());
    adds_up(&report);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn pieces_of_any_size_give_the_same_frames(cuts in prop::collection::vec(1_usize..90, 1..60), which in 0..Dialect::ALL.len()) {
        let dialect = Dialect::ALL[which];
        let mut bytes = stream(dialect, 11);
        bytes.drain(300..333);
        let (whole, expected) = read(None, &bytes).unwrap();
        let mut parser = UartParser::new(None);
        let mut frames = Vec::new();
        let mut rest = bytes.as_slice();
        for cut in cuts.iter().cycle() {
            if rest.is_empty() {
                break;
            }
            let (piece, after) = rest.split_at((*cut).min(rest.len()));
            frames.extend(parser.push(piece).unwrap());
            rest = after;
        }
        let (last, report, _) = parser.finish().unwrap();
        frames.extend(last);
        prop_assert_eq!(frames, whole);
        prop_assert_eq!(report, expected);
    }

    #[test]
    fn damaged_streams_add_up(flips in prop::collection::vec((0_usize..1400, any::<u8>()), 0..40), which in 0..Dialect::ALL.len()) {
        let dialect = Dialect::ALL[which];
        let mut bytes = stream(dialect, 11);
        for (at, value) in flips {
            let n = bytes.len();
            bytes[at % n] = value;
        }
        let (frames, report) = read(Some(dialect), &bytes).unwrap();
        adds_up(&report);
        prop_assert_eq!(frames.len() as u64, report.packets + report.short_packets);
        prop_assert!(frames.iter().flat_map(|f| &f.points).all(|p| p.range_m <= 300.0 && p.intensity_db.is_finite()));
        let halves = bytes.split_at(bytes.len() / 2);
        prop_assert_eq!(read_pieces(Some(dialect), [halves.0, halves.1]), Ok((frames, report)));
        prop_assert_eq!(read_pieces(None, [halves.0, halves.1]), read(None, &bytes));
    }

    #[test]
    fn noise_with_magics_never_panics(mut bytes in prop::collection::vec(any::<u8>(), 0..2000), magics in prop::collection::vec(0_usize..1990, 0..12), which in 0..Dialect::ALL.len()) {
        for at in magics {
            if let Some(place) = bytes.get_mut(at..at + 8) {
                place.copy_from_slice(&MAGIC);
            }
        }
        for dialect in [Some(Dialect::ALL[which]), None] {
            let whole = read(dialect, &bytes);
            prop_assert_eq!(&read_pieces(dialect, bytes.chunks(100)), &whole);
            if let Ok((_, report)) = whole {
                adds_up(&report);
            }
        }
    }
}

/// Foreign bytes, a truncated packet and a bad header, in pieces of any size.
#[test]
fn searches_are_counted_alike_for_pieces_of_any_size() {
    let dialect = Dialect::Sdk3;
    let numbered = |n| packet(dialect, n, &one_point(dialect));
    let mut bytes = vec![9; 50];
    for n in 0..12 {
        match n {
            3 => bytes.extend([0xFF; 100]),
            5 => bytes.extend(&numbered(n)[..60]),
            // Damage without a whole packet in between is one search.
            7 => {
                bytes.extend(&numbered(n)[..45]);
                bytes.extend([1; 9]);
                bytes.extend(&numbered(n)[..9]);
            }
            _ => {}
        }
        bytes.extend(numbered(n));
    }
    let mut whole = None;
    for size in [1, 2, 7, 64, 1000, bytes.len()] {
        let mut parser = UartParser::new(Some(dialect));
        let mut frames = Vec::new();
        for piece in bytes.chunks(size) {
            frames.extend(parser.push(piece).unwrap());
        }
        assert_eq!(parser.dialect(), Some(dialect));
        assert_eq!(parser.report().resynchronisations, 3, "{size}");
        let (last, report, _) = parser.finish().unwrap();
        frames.extend(last);
        adds_up(&report);
        assert_eq!(
            whole.get_or_insert((frames.clone(), report.clone())),
            &(frames, report)
        );
    }
}

/// The seeds of the fuzz target. One of them, which the fuzzer made of others, has packets that are shorter than a header while
/// it is not clear which dialect they are.
#[test]
fn seeds_are_read_alike_in_two_pieces() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../fuzz/corpus/uart");
    let mut n_files = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let bytes = std::fs::read(entry.unwrap().path()).unwrap();
        n_files += 1;
        for dialect in Dialect::ALL.map(Some).into_iter().chain([None]) {
            let whole = read(dialect, &bytes);
            for at in (0..bytes.len()).step_by(97).chain([bytes.len() / 3]) {
                let (first, second) = bytes.split_at(at);
                assert_eq!(
                    read_pieces(dialect, [first, second]),
                    whole,
                    "{dialect:?}, {at}"
                );
            }
        }
    }
    assert!(n_files >= 10);
}

/// A flipped bit in a number is neither a restart nor a loss of thousands of frames; a real jump is.
#[test]
fn a_damaged_number_is_no_lost_frame_and_no_restart() {
    const NUMBER_AT: usize = 20;
    let whole = stream(Dialect::Sdk3, 9);
    let length = whole.len() / 9;
    for bit in 0..32 {
        let mut bytes = whole.clone();
        bytes[4 * length + NUMBER_AT + bit / 8] ^= 1 << (bit % 8);
        let (frames, report) = read(Some(Dialect::Sdk3), &bytes).unwrap();
        assert_eq!(frames.len(), 9);
        // Bits below this one leave a number that is near enough to be believed.
        if bit > 5 {
            assert_eq!((report.lost_frames, report.restarts), (0, 0), "bit {bit}");
        }
    }
    let gap = [
        &whole[..4 * length],
        &packet(Dialect::Sdk3, 5_000, &[])[..],
        &packet(Dialect::Sdk3, 5_001, &[]),
    ]
    .concat();
    let (_, report) = read(Some(Dialect::Sdk3), &gap).unwrap();
    assert_eq!((report.lost_frames, report.restarts), (4_896, 0));
    let last = [&whole[..4 * length], &packet(Dialect::Sdk3, 5, &[])[..]].concat();
    let (_, report) = read(Some(Dialect::Sdk3), &last).unwrap();
    assert_eq!((report.lost_frames, report.restarts), (0, 1));
}
