//! UART streams that were read wrongly: empty rooms, older SDKs, lost bytes, impossible and unknown contents.
//!
//! Expected values are those that went into the packets, by the layouts of TI's headers.

use radarllm_formats::uart::{
    Dialect, Guess, MAGIC, UartError, UartFrame, UartParser, UartReport, recorded_frames,
};

use crate::make::{floats, one_point, packet, packet_of, spherical_compact, stream, words};

type Tlvs = Vec<(u32, Vec<u8>)>;

/// Frames, counts and evidence of a stream, which are the same for pieces of any size.
fn read_all(
    dialect: Option<Dialect>,
    bytes: &[u8],
) -> Result<(Vec<UartFrame>, UartReport, Option<Guess>), UartError> {
    let in_pieces = |size: usize| {
        let mut parser = UartParser::new(dialect).with_doppler_step(0.1);
        let mut frames = Vec::new();
        for piece in bytes.chunks(size) {
            frames.extend(parser.push(piece)?);
        }
        let (last, report, guess) = parser.finish()?;
        frames.extend(last);
        Ok((frames, report, guess))
    };
    let whole = in_pieces(bytes.len().max(1));
    for size in [1, 61, 1000] {
        assert_eq!(in_pieces(size), whole, "pieces of {size} bytes");
    }
    if let Ok((frames, report, _)) = &whole {
        let parts = report.packet_bytes + report.skipped_bytes + report.trailing_bytes;
        assert_eq!(report.bytes, parts, "{report:?}");
        let n_frames = report.packets + report.short_packets;
        assert_eq!(frames.len() as u64, n_frames, "{report:?}");
    }
    whole
}

fn read(bytes: &[u8]) -> (Vec<UartFrame>, UartReport, Guess) {
    let (frames, report, guess) = read_all(None, bytes).unwrap();
    (frames, report, guess.unwrap())
}

/// Packets with consecutive numbers from 0.
fn numbered(dialect: Dialect, contents: impl IntoIterator<Item = Tlvs>) -> Vec<u8> {
    let packets = contents.into_iter().zip(0..);
    packets
        .flat_map(|(tlvs, n)| packet(dialect, n, &tlvs))
        .collect()
}

#[test]
fn an_empty_room_at_the_start_is_no_evidence() {
    for dialect in Dialect::ALL {
        for n_empty in [1, 12, 300] {
            let empty = std::iter::repeat_n(Vec::new(), n_empty);
            let seen = std::iter::repeat_n(one_point(dialect), 9);
            let bytes = numbered(dialect, empty.chain(seen));
            let (frames, report, guess) = read(&bytes);
            assert_eq!(guess.dialect, dialect, "{guess}");
            assert!(!guess.is_assumed);
            assert_eq!(frames.len(), n_empty + 9);
            let n_points = |f: &UartFrame| f.points.len();
            assert!(
                frames[..n_empty]
                    .iter()
                    .all(|f| f.complete && n_points(f) == 0)
            );
            assert!(frames[n_empty..].iter().all(|f| n_points(f) == 1));
            assert!(frames.iter().map(|f| f.number).eq(0..n_empty as u32 + 9));
            assert_eq!((report.lost_frames, report.skipped_bytes), (0, 0));
        }
    }
}

#[test]
fn packets_of_an_empty_room_are_returned_before_the_dialect_is_known() {
    let mut parser = UartParser::new(None);
    let empty = numbered(Dialect::Sdk3, std::iter::repeat_n(Vec::new(), 1000));
    let mut frames = Vec::new();
    for piece in empty.chunks(100) {
        frames.extend(parser.push(piece).unwrap());
    }
    // The last one may lack its end.
    assert_eq!((frames.len(), parser.dialect()), (999, None));
    assert_eq!(parser.n_begun(), 1000);
    assert_eq!(parser.unclear(), None);
    let frames: Vec<u32> = frames.iter().map(|f| f.subframe).collect();
    assert!(frames.iter().all(|subframe| *subframe == 0));
}

#[test]
fn a_stream_without_content_is_of_the_common_dialect() {
    for (dialect, expected) in [
        (Dialect::Sdk3, Dialect::Sdk3),
        // Version and platform of the header say what the content does not.
        (Dialect::Sdk2, Dialect::Sdk2),
        (Dialect::PeopleTracking6844, Dialect::PeopleTracking6844),
        (Dialect::PeopleCounting3d, Dialect::PeopleCounting3d),
        // The header is the same, and so are the frames.
        (Dialect::PeopleCounting2dCompact, Dialect::PeopleCounting2d),
        (Dialect::Overhead3d, Dialect::PeopleCounting2d),
    ] {
        let bytes = numbered(dialect, std::iter::repeat_n(Vec::new(), 20));
        let (frames, report, guess) = read(&bytes);
        assert_eq!(guess.dialect, expected, "{guess}");
        let is_alone =
            dialect == Dialect::PeopleCounting3d || dialect == Dialect::PeopleTracking6844;
        assert_eq!(guess.is_assumed, !is_alone, "{guess}");
        assert_eq!(frames.len(), 20);
        assert!(frames.iter().all(|f| f.complete && f.points.is_empty()));
        assert_eq!(report.no_points_because(), None);
    }
}

#[test]
fn rare_points_among_empty_packets_do_not_hold_them_up() {
    // One packet with a point, then an empty room for a minute.
    let dialect = Dialect::Sdk3;
    let content = std::iter::once(one_point(dialect)).chain(std::iter::repeat_n(Vec::new(), 900));
    let bytes = numbered(dialect, content);
    let mut parser = UartParser::new(None);
    let n_bytes = packet(dialect, 0, &one_point(dialect)).len() + 40 * 64;
    let frames = parser.push(&bytes[..n_bytes]).unwrap();
    assert!(frames.len() > 30, "{}", frames.len());
    assert_eq!(
        (parser.dialect(), frames[0].points.len()),
        (Some(dialect), 1)
    );
    assert_eq!(read(&bytes).0.len(), 901);
}

/// A stream that no dialect explains: the parser keeps a part of it, and reads what follows.
#[test]
fn unclear_content_ends_nothing_and_is_not_kept() {
    let strange = |n: u32| {
        let mut bytes = MAGIC.to_vec();
        bytes.extend(words(&[0x0306_0000, 2000, 0xA6843, n, 0, 3, 2, 2, 2]));
        bytes.resize(2000, 0xAB);
        bytes
    };
    let mut parser = UartParser::new(None);
    for n in 0..2000 {
        let frames = parser.push(&strange(n)).unwrap();
        assert!(frames.is_empty());
    }
    assert_eq!(parser.n_begun(), 2000);
    let why = parser.unclear().unwrap();
    assert!(why.to_string().contains("not clear"), "{why}");
    let report = parser.report();
    assert!(report.unclear_packets > 1900, "{report:?}");
    assert_eq!(report.skipped_bytes, 2000 * report.unclear_packets);
    // Packets that can be read decide later.
    let mut frames = Vec::new();
    for piece in stream(Dialect::Sdk3, 200).chunks(500) {
        frames.extend(parser.push(piece).unwrap());
    }
    assert_eq!(parser.dialect(), Some(Dialect::Sdk3));
    assert_eq!(parser.unclear(), None);
    let n_points = frames.iter().filter(|f| f.points.len() == 1).count();
    assert!(n_points > 100, "{n_points}");
}

/// Objects of SDK 1 and 2: range bin, Doppler bin, peak, x, y, z.
fn objects(places: u16, objects: &[(u16, i16, u16, [i16; 3])]) -> Vec<u8> {
    let mut payload = [objects.len() as u16, places]
        .map(u16::to_le_bytes)
        .concat();
    for (range_bin, doppler_bin, peak, place) in objects {
        payload.extend(range_bin.to_le_bytes());
        payload.extend(doppler_bin.to_le_bytes());
        payload.extend(peak.to_le_bytes());
        payload.extend(place.iter().flat_map(|v| v.to_le_bytes()));
    }
    payload
}

#[test]
fn objects_of_sdk_1_and_2_come_out_in_units() {
    for dialect in [Dialect::Sdk1, Dialect::Sdk2] {
        // All lengths, among them those of 16 n bytes that would be floats (1, 5 and 9 objects).
        let bytes: Vec<u8> = (1..=16_u16)
            .flat_map(|n| {
                let object = |k: u16| {
                    let k_signed = k as i16;
                    (
                        40 + k,
                        k_signed - 3,
                        9 * (k + 1),
                        [-256 * k_signed, 1024, 384],
                    )
                };
                let payload = objects(9, &(0..n).map(object).collect::<Vec<_>>());
                let tlvs = [(1, payload), (2, vec![0; 64]), (6, words(&[1; 6]))];
                packet_of(dialect, n.into(), [n.into(), 0], &tlvs)
            })
            .collect();
        let (frames, report, guess) = read(&bytes);
        assert_eq!(guess.dialect, dialect, "{guess}");
        assert!(guess.certainty > 0.1, "{guess}");
        assert_eq!((report.points, report.points_of_doppler_bins), (136, 136));
        assert_eq!(report.tlvs_wrong_length + report.tlvs_impossible, 0);
        for (frame, n) in frames.iter().zip(1..) {
            assert_eq!(frame.points.len(), n);
            for (k, point) in frame.points.iter().enumerate() {
                let k = k as f32;
                // 9 binary places: 512 to a metre.
                assert_eq!([point.x_m, point.y_m, point.z_m], [-0.5 * k, 2.0, 0.75]);
                assert!((point.velocity_mps - 0.1 * (k - 3.0)).abs() < 1e-6);
                assert!((point.intensity_db - 10.0 * (9.0 * k + 10.0).log10()).abs() < 1e-4);
            }
        }
        // Without the velocity of a bin there are no speeds.
        let mut parser = UartParser::new(Some(dialect));
        let mut frames = parser.push(&bytes).unwrap();
        frames.extend(parser.finish().unwrap().0);
        assert!(
            frames
                .iter()
                .flat_map(|f| &f.points)
                .all(|p| p.velocity_mps == 0.0)
        );
        assert!(dialect.has_doppler_bins());
    }
}

#[test]
fn counts_and_binary_places_of_objects_are_checked() {
    let good = objects(9, &[(1, 0, 9, [0, 512, 0])]);
    let more = [[5, 0], [9, 0]].concat();
    let with_wrong_count = [&more[..], &good[4..]].concat();
    let many_places = objects(16, &[(1, 0, 9, [0, 512, 0])]);
    // 512 m.
    let far = objects(0, &[(1, 0, 9, [0, 512, 0])]);
    let bytes = numbered(
        Dialect::Sdk2,
        [good, with_wrong_count, many_places, far].map(|payload| vec![(1, payload)]),
    );
    let (frames, report, _) = read_all(Some(Dialect::Sdk2), &bytes).unwrap();
    let n_points: Vec<usize> = frames.iter().map(|f| f.points.len()).collect();
    assert_eq!(n_points, [1, 0, 0, 0]);
    assert_eq!((report.tlvs_wrong_length, report.tlvs_impossible), (1, 2));
    assert_eq!(
        (report.points_not_finite, report.points_out_of_range),
        (1, 1)
    );
}

#[test]
fn targets_and_points_of_overhead_counting_come_out_in_units() {
    let points = floats(&[2.0, 0.5, -0.25, -0.75, 200.0, 3.0, -0.5, 0.25, 1.5, 0.0]);
    let mut targets = words(&[7]);
    targets.extend(floats(&(1..=9).map(|i| i as f32).collect::<Vec<_>>()));
    let tlvs = vec![
        (6, points),
        (7, targets),
        (8, vec![7, 255]),
        (9, words(&[1, 2, 3, 4, 5, 6])),
    ];
    let (frames, report, guess) = read(&numbered(Dialect::Overhead3d, vec![tlvs; 10]));
    assert_eq!(guess.dialect, Dialect::Overhead3d, "{guess}");
    assert_eq!((report.tlvs, report.points_without_snr), (40, 10));
    let [first, second] = frames[3].points[..] else {
        panic!("{:?}", frames[3].points);
    };
    let flat = 2.0 * 0.25_f32.cos();
    let expected = [
        flat * 0.5_f32.sin(),
        flat * 0.5_f32.cos(),
        -2.0 * 0.25_f32.sin(),
    ];
    for (found, expected) in [first.x_m, first.y_m, first.z_m].into_iter().zip(expected) {
        assert!((found - expected).abs() < 1e-6);
    }
    assert_eq!((first.velocity_mps, second.velocity_mps), (-0.75, 1.5));
    assert!((first.intensity_db - 10.0 * 200_f32.log10()).abs() < 1e-5);
    let target = frames[3].targets[0];
    assert_eq!(
        (
            target.id,
            target.position_m,
            target.velocity_mps,
            target.acceleration_mps2
        ),
        (7, [1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [7.0, 8.0, 9.0])
    );
    assert_eq!(frames[3].stats.unwrap().inter_frame_cpu_percent, 6);
}

/// The labs with a header of 52 bytes, told apart by content, whatever the numbers of points.
#[test]
fn labs_with_the_same_header_are_told_apart_by_possible_values() {
    let many = |n: usize, item: &[f32]| floats(&item.repeat(n));
    // 4 and 8 points of 20 bytes are as long as 5 and 10 of 16 bytes.
    for n in [4, 8] {
        let overhead = vec![(6, many(n, &[2.5, 0.3, -0.2, 0.4, 90.0]))];
        let (frames, _, guess) = read(&numbered(Dialect::Overhead3d, vec![overhead; 9]));
        assert_eq!(guess.dialect, Dialect::Overhead3d, "{guess}");
        assert_eq!(frames[0].points.len(), n);
        let flat = vec![(6, many(n * 5 / 4, &[2.5, 0.3, 0.4, 90.0]))];
        let (frames, _, guess) = read(&numbered(Dialect::PeopleCounting2d, vec![flat; 9]));
        assert_eq!(guess.dialect, Dialect::PeopleCounting2d, "{guess}");
        assert_eq!(frames[0].points.len(), n * 5 / 4);
    }
    // 8 points of 6 bytes behind 16 bytes of units are as long as 4 points of 16 bytes.
    let mut compact = floats(&[0.03, 0.28, 0.0025, 0.04]);
    for k in 0..8_u8 {
        compact.extend([10 + k, 250, 100, 4, 60, 30 + k]);
    }
    let tlvs = vec![(6, compact), (8, vec![255; 8])];
    let (frames, _, guess) = read(&numbered(Dialect::PeopleCounting2dCompact, vec![tlvs; 9]));
    assert_eq!(guess.dialect, Dialect::PeopleCounting2dCompact, "{guess}");
    let point = frames[0].points[0];
    // Range 0.0025 (100 + 4 256) = 2.81 m, azimuth 0.3 rad, velocity -6 0.28 m/s, SNR 0.04 (60 + 30 256).
    assert!((point.range_m - 2.81).abs() < 1e-4, "{point:?}");
    assert!((point.x_m - 2.81 * 0.3_f32.sin()).abs() < 1e-4);
    assert!((point.velocity_mps + 1.68).abs() < 1e-5);
    assert!((point.intensity_db - 10.0 * 309.6_f32.log10()).abs() < 1e-4);
}

#[test]
fn impossible_values_are_not_believed_whatever_their_length() {
    let impossible: [(&str, [f32; 4]); 6] = [
        (
            "integers",
            [f32::from_bits(0x0028_0005), f32::from_bits(0xFE), 0.0, 0.0],
        ),
        ("tiny", [1e-38, 2.0, 0.0, 0.0]),
        ("far", [0.0, 301.0, 0.0, 0.0]),
        ("fast", [0.0, 2.0, 0.0, 61.0]),
        ("no number", [f32::NAN, 2.0, 0.0, 0.0]),
        ("infinite", [0.0, f32::INFINITY, 0.0, 0.0]),
    ];
    for (what, values) in impossible {
        // Two of three: nothing of the payload is used.
        let payload = [&values[..], &values, &[0.5, 2.0, 0.0, 0.1]].concat();
        let bytes = packet(Dialect::Sdk3, 1, &[(1, floats(&payload))]);
        let (frames, report, _) = read_all(Some(Dialect::Sdk3), &bytes).unwrap();
        assert!(frames[0].points.is_empty(), "{what}");
        assert_eq!((report.tlvs, report.tlvs_impossible), (0, 1), "{what}");
        // One of three: the others are used.
        let payload = [&values[..], &[0.5, 2.0, 0.0, 0.1], &[0.5, 3.0, 0.0, 0.1]].concat();
        let bytes = packet(Dialect::Sdk3, 1, &[(1, floats(&payload))]);
        let (frames, report, _) = read_all(Some(Dialect::Sdk3), &bytes).unwrap();
        assert_eq!(frames[0].points.len(), 2, "{what}");
        assert_eq!((report.tlvs, report.tlvs_impossible), (1, 0), "{what}");
        assert_eq!(
            report.points_not_finite + report.points_out_of_range,
            1,
            "{what}"
        );
    }
    // An SNR of 3,000 dB, and a negative ratio.
    let snr = [
        (1, floats(&[0.5, 2.0, 0.0, 0.1])),
        (7, vec![0x30, 0x75, 0, 0]),
    ];
    let (frames, report, _) =
        read_all(Some(Dialect::Sdk3), &packet(Dialect::Sdk3, 1, &snr)).unwrap();
    assert_eq!(frames[0].points[0].intensity_db, 0.0);
    assert_eq!((report.tlvs_impossible, report.points_without_snr), (1, 1));
    let dialect = Dialect::PeopleCounting2d;
    let ratio = [(6, floats(&[2.0, 0.1, 0.1, -5.0]))];
    let (frames, _, _) = read_all(Some(dialect), &packet(dialect, 1, &ratio)).unwrap();
    assert!(frames[0].points.is_empty());
}

#[test]
fn a_stated_dialect_that_does_not_fit_is_reported() {
    let objects = objects(9, &[(40, 0, 500, [0, 1024, -256]); 5]);
    let overhead = floats(&[2.0, 0.5, -0.25, -0.75, 200.0].repeat(8));
    let cases = [
        (Dialect::Sdk2, (1, objects), Dialect::Sdk3),
        (
            Dialect::Overhead3d,
            (6, overhead.clone()),
            Dialect::PeopleCounting2d,
        ),
        (
            Dialect::Overhead3d,
            (6, overhead),
            Dialect::PeopleCounting2dCompact,
        ),
    ];
    for (dialect, tlv, stated) in cases {
        let bytes = numbered(dialect, vec![vec![tlv]; 20]);
        let (_, report, _) = read_all(Some(stated), &bytes).unwrap();
        assert_eq!(report.points, 0, "{report:?}");
        assert!(report.is_misread());
        let why = report.no_points_because().unwrap();
        assert!(
            why.starts_with("no point could be read from 20 packets"),
            "{why}"
        );
    }
}

#[test]
fn points_that_are_not_as_many_as_the_header_counts_are_not_believed() {
    let point = [0.5, 2.0, 0.0, 0.1];
    let with_points = |n: usize| vec![(1, floats(&point.repeat(n)))];
    let counts = [(2, 2), (3, 3), (16, 4), (1, 1), (0, 2), (2, 3)];
    let bytes: Vec<u8> = counts
        .into_iter()
        .zip(0..)
        .flat_map(|((stated, n), i)| packet_of(Dialect::Sdk3, i, [stated, 0], &with_points(n)))
        .collect();
    let (frames, report, _) = read_all(Some(Dialect::Sdk3), &bytes).unwrap();
    let seen: Vec<(bool, usize)> = frames
        .iter()
        .map(|f| (f.complete, f.points.len()))
        .collect();
    let expected = [
        (true, 2),
        (true, 3),
        (false, 0),
        (true, 1),
        (true, 2),
        (false, 0),
    ];
    assert_eq!(seen, expected);
    assert_eq!((report.count_mismatches, report.counts_never_right), (2, 0));
    // Firmware that counts something else from the beginning.
    let bytes: Vec<u8> = (0..10)
        .flat_map(|i| packet_of(Dialect::Sdk3, i, [16, 0], &with_points(4)))
        .collect();
    let (_, report, _) = read(&bytes);
    assert_eq!((report.points, report.counts_never_right), (40, 10));
}

/// A packet of SDK 3 that is not padded, as some labs send it.
fn unpadded(number: u32, n_objects: u32, tlvs: &[(u32, Vec<u8>)]) -> Vec<u8> {
    let mut bytes = packet_of(Dialect::Sdk3, number, [n_objects, 0], tlvs);
    let n_content = 40
        + tlvs
            .iter()
            .map(|(_, payload)| 8 + payload.len())
            .sum::<usize>();
    bytes.truncate(n_content);
    bytes[12..16].copy_from_slice(&(n_content as u32).to_le_bytes());
    bytes
}

/// 3D people tracking with vital signs: packets without padding, whose last blocks are short.
#[test]
fn packets_without_padding_are_read_with_and_without_losses() {
    let mut points = spherical_compact(10.0, 30.0);
    points.extend([20, 40, 50, 0, 208, 7, 232, 3].repeat(7));
    let target = [words(&[3]), floats(&[0.5; 27])].concat();
    let tlvs = [
        (1020, points),
        (1010, target),
        (1011, vec![3, 3, 3, 3, 255, 255, 0, 0]),
        (1021, words(&[1])),
        (1040, vec![0; 136]),
    ];
    let bytes: Vec<u8> = (0..20).flat_map(|n| unpadded(n, 8, &tlvs)).collect();
    let (frames, report, guess) = read(&bytes);
    assert_eq!(guess.dialect, Dialect::Sdk3, "{guess}");
    assert_eq!(
        (report.points, report.tlvs, report.tlvs_unused),
        (160, 80, 20)
    );
    let (points, targets) = (frames[0].points.clone(), frames[0].targets.clone());
    let length = unpadded(0, 8, &tlvs).len();
    for n_lost in [1, 3, 8] {
        for place in 8..=length - n_lost {
            let packets = (0..10).map(|n| {
                let mut packet = unpadded(n, 8, &tlvs);
                if n == 4 {
                    packet.drain(place..place + n_lost);
                }
                packet
            });
            let mut parser = UartParser::new(Some(Dialect::Sdk3));
            let mut frames = parser.push(&packets.collect::<Vec<_>>().concat()).unwrap();
            frames.extend(parser.finish().unwrap().0);
            let good: Vec<&UartFrame> = frames.iter().filter(|f| f.complete).collect();
            let n_good = good.iter().filter(|f| f.number != 4).count();
            assert_eq!(n_good, 9, "{n_lost} bytes lost at {place}");
            for frame in good {
                assert_eq!(frame.points, points, "{n_lost} bytes lost at {place}");
                let is_right = frame.targets.is_empty() || frame.targets == targets;
                assert!(
                    is_right,
                    "{n_lost} bytes lost at {place}: {:?}",
                    frame.targets
                );
            }
        }
    }
}

/// What people lose on a serial line: `n` bytes at a place of every tenth packet.
#[test]
fn a_packet_that_lacks_bytes_does_not_destroy_the_next_one() {
    let point = |k: f32| [0.2 + 0.01 * k, 2.0 + 0.1 * k, -0.6, 0.3];
    for dialect in [Dialect::Sdk3, Dialect::PeopleCounting2d] {
        let tlvs: Tlvs = match dialect {
            Dialect::Sdk3 => vec![
                (
                    1,
                    floats(&(0..8).flat_map(|k| point(k as f32)).collect::<Vec<_>>()),
                ),
                (7, [150, 0, 44, 1].repeat(8)),
                (2, vec![7; 64]),
            ],
            _ => vec![
                (6, floats(&[2.0, 0.3, 0.1, 99.0].repeat(8))),
                (8, vec![255; 8]),
            ],
        };
        let whole = packet(dialect, 0, &tlvs);
        let expected = read_all(Some(dialect), &whole).unwrap().0[0].points.clone();
        assert_eq!(expected.len(), 8);
        for n_lost in [1, 2, 3, 4, 5, 6, 7, 8, 9, 31] {
            for place in 8..=whole.len() - n_lost {
                let mut bytes = Vec::new();
                for number in 0..30 {
                    let mut packet = packet(dialect, number, &tlvs);
                    if number % 10 == 5 {
                        packet.drain(place..place + n_lost);
                    }
                    bytes.extend(packet);
                }
                let mut parser = UartParser::new(Some(dialect));
                let mut frames = parser.push(&bytes).unwrap();
                frames.extend(parser.finish().unwrap().0);
                let good: Vec<&UartFrame> = frames.iter().filter(|f| f.complete).collect();
                let undamaged = |f: &&&UartFrame| f.number < 30 && f.number % 10 != 5;
                let n_good = good.iter().filter(undamaged).count();
                assert_eq!(n_good, 27, "{n_lost} bytes lost at {place}");
                // Nothing is shifted: a point is right or not there.
                for frame in good {
                    assert_eq!(frame.points, expected, "{n_lost} bytes lost at {place}");
                }
            }
        }
    }
}

#[test]
fn packets_that_lack_only_padding_are_used() {
    for dialect in Dialect::ALL {
        let tlvs = one_point(dialect);
        let n_content = dialect.header_len()
            + tlvs
                .iter()
                .map(|(_, payload)| 8 + payload.len())
                .sum::<usize>();
        let length = packet(dialect, 0, &tlvs).len();
        for n_lost in 1..=length - n_content {
            let bytes: Vec<u8> = (0..60)
                .flat_map(|n| packet(dialect, n, &tlvs)[..length - n_lost].to_vec())
                .collect();
            let (frames, report, guess) = read(&bytes);
            assert_eq!(guess.dialect, dialect, "{guess}");
            assert_eq!(frames.len(), 60, "{dialect:?}, {n_lost} bytes less");
            assert!(frames.iter().all(|f| f.complete && f.points.len() == 1));
            assert_eq!(report.short_packets_used, 60);
            assert_eq!(report.resynchronisations, 0);
        }
    }
}

#[test]
fn what_follows_a_loss_in_a_packet_is_not_believed() {
    let tlvs = [
        (1, floats(&[0.5, 2.0, 0.0, 0.25])),
        (7, vec![200, 0, 50, 0]),
        (1010, [words(&[3]), floats(&[0.5; 27])].concat()),
        (1011, vec![3]),
    ];
    let whole = packet(Dialect::Sdk3, 0, &tlvs);
    // Within the targets: the points and their SNR are certain.
    let mut short = packet(Dialect::Sdk3, 1, &tlvs);
    short.remove(40 + 24 + 12 + 30);
    let bytes = [whole.clone(), short, packet(Dialect::Sdk3, 2, &tlvs)].concat();
    let (frames, report, _) = read_all(Some(Dialect::Sdk3), &bytes).unwrap();
    assert!(frames.iter().all(|f| f.complete));
    assert_eq!(frames[1].points, frames[0].points);
    let n_targets: Vec<usize> = frames.iter().map(|f| f.targets.len()).collect();
    assert_eq!(n_targets, [1, 0, 1]);
    assert_eq!((report.short_packets, report.short_packets_used), (1, 1));
    assert!(report.tlvs_uncertain > 0);
    // Within the SNR: the points would have none.
    let mut short = packet(Dialect::Sdk3, 1, &tlvs);
    short.remove(40 + 24 + 9);
    let bytes = [whole, short, packet(Dialect::Sdk3, 2, &tlvs)].concat();
    let (frames, report, _) = read_all(Some(Dialect::Sdk3), &bytes).unwrap();
    assert!(!frames[1].complete && frames[1].points.is_empty());
    assert_eq!((report.short_packets, report.short_packets_used), (1, 0));
    assert_eq!(recorded_frames(frames).len(), 2);
}

/// The first bytes of a magic at the end of a packet: it waits for what follows, and is not lost.
#[test]
fn packets_that_end_like_a_magic_are_read() {
    for n in 1..8 {
        let mut bytes = Vec::new();
        for number in 0..5 {
            let mut packet = packet(Dialect::Sdk3, number, &one_point(Dialect::Sdk3));
            let length = packet.len();
            packet[length - n..].copy_from_slice(&MAGIC[..n]);
            bytes.extend(packet);
        }
        let (frames, report, _) = read_all(Some(Dialect::Sdk3), &bytes).unwrap();
        assert_eq!(
            (frames.len(), report.packets, report.points),
            (5, 5, 5),
            "{n}"
        );
    }
}

#[test]
fn spherical_and_compressed_points_of_the_toolbox_come_out_in_units() {
    let spherical = vec![
        (
            1000,
            floats(&[2.0, 30_f32.to_radians(), 10_f32.to_radians(), 0.5]),
        ),
        (7, vec![200, 0, 50, 0]),
    ];
    let compressed = vec![(3001, spherical_compact(10.0, 30.0))];
    let expected = {
        let flat = 2.0 * 10_f32.to_radians().cos();
        [
            flat * 0.5,
            flat * 0.75_f32.sqrt(),
            2.0 * 10_f32.to_radians().sin(),
        ]
    };
    for tlvs in [spherical, compressed] {
        let (frames, report, guess) = read(&numbered(Dialect::Sdk3, vec![tlvs; 9]));
        assert_eq!(guess.dialect, Dialect::Sdk3, "{guess}");
        let p = frames[0].points[0];
        for (found, expected) in [p.x_m, p.y_m, p.z_m].into_iter().zip(expected) {
            assert!((found - expected).abs() < 1e-3, "{p:?}");
        }
        assert!((p.velocity_mps - 0.5).abs() < 1e-6 && (p.intensity_db - 20.0).abs() < 1e-3);
        assert_eq!((report.points, report.tlvs_unknown), (9, 0));
    }
}

#[test]
fn the_xwrl6844_counts_points_of_minor_motion_by_themselves() {
    let dialect = Dialect::PeopleTracking6844;
    let tlvs = [
        (1020, spherical_compact(10.0, 30.0)),
        (
            3001,
            [
                spherical_compact(-10.0, 20.0),
                vec![20, 40, 50, 0, 208, 7, 232, 3],
            ]
            .concat(),
        ),
        (1010, [words(&[3]), floats(&[0.5; 27])].concat()),
        (1011, vec![255]),
    ];
    let bytes: Vec<u8> = (0..10)
        .flat_map(|n| packet_of(dialect, n, [1, 2], &tlvs))
        .collect();
    let (frames, report, guess) = read(&bytes);
    assert_eq!(guess.dialect, dialect, "{guess}");
    assert_eq!((report.points, report.counts_never_right), (30, 0));
    assert_eq!(
        (
            frames[9].number,
            frames[9].subframe,
            frames[9].targets.len()
        ),
        (9, 0, 1)
    );
    let heights: Vec<f32> = frames[0].points.iter().map(|p| p.z_m).collect();
    let z_m = 2.0 * 10_f32.to_radians().sin();
    for (found, expected) in heights.into_iter().zip([z_m, -z_m, -z_m]) {
        assert!((found - expected).abs() < 1e-3);
    }
    // Minor points alone: the number of TLVs is read from the right place.
    let tlvs = [(3001, spherical_compact(-10.0, 20.0))];
    let bytes: Vec<u8> = (0..10)
        .flat_map(|n| packet_of(dialect, n, [0, 1], &tlvs))
        .collect();
    let (_, report, guess) = read(&bytes);
    assert_eq!((guess.dialect, report.points), (dialect, 10));
}

#[test]
fn the_low_power_demo_is_read_with_presence_and_targets() {
    let mut compact = floats(&[0.01, 0.02, 0.5, 0.1]);
    compact.extend([1, 0, 1, 0]);
    for x in [100_i16, -40] {
        compact.extend([x, 200, -50, 4].iter().flat_map(|v| v.to_le_bytes()));
        compact.extend([25, 3]);
    }
    let tlvs = vec![
        (301, compact),
        (306, vec![0; 24]),
        (308, [words(&[3]), floats(&[0.5; 27])].concat()),
        (309, vec![3, 255]),
        // Five zones: empty, minor motion, empty, major motion, minor motion.
        (315, vec![5, 0b1000_0100, 0b0000_0001]),
        (317, vec![100, 28]),
    ];
    let bytes: Vec<u8> = (0..10)
        .flat_map(|n| packet_of(Dialect::Sdk3, n, [2, 0], &tlvs))
        .collect();
    let (frames, report, guess) = read(&bytes);
    assert_eq!(guess.dialect, Dialect::Sdk3, "{guess}");
    let f = &frames[4];
    let xs: Vec<f32> = f.points.iter().map(|p| p.x_m).collect();
    assert!((xs[0] - 1.0).abs() < 1e-6 && (xs[1] + 0.4).abs() < 1e-6);
    assert_eq!((xs.len(), f.targets[0].id), (2, 3));
    assert_eq!(
        (f.indices.as_slice(), f.occupied_zones),
        (&[3, 255][..], Some(0b11010))
    );
    // Zones are no tracks: the frame does not say that nobody is tracked.
    let presence_alone = [(301, tlvs[0].1.clone()), tlvs[4].clone()];
    let bytes: Vec<u8> = (0..10)
        .flat_map(|n| packet_of(Dialect::Sdk3, n, [2, 0], &presence_alone))
        .collect();
    assert!(
        recorded_frames(read(&bytes).0)
            .iter()
            .all(|f| f.board.is_none())
    );
    assert_eq!(
        (report.tlvs, report.tlvs_unused, report.tlvs_unknown),
        (40, 20, 0)
    );
    let unused = report.unused_tlvs().unwrap();
    assert_eq!(
        unused,
        "306 (statistics, 10 times), 317 (classes, 10 times)"
    );
}

#[test]
fn unknown_points_are_named_and_are_not_an_empty_room() {
    let tlvs = vec![(4242, vec![1; 96]), (1040, vec![0; 136])];
    let bytes: Vec<u8> = (0..60)
        .flat_map(|n| packet_of(Dialect::Sdk3, n, [8, 0], &tlvs))
        .collect();
    let (frames, report, guess) = read(&bytes);
    assert_eq!((guess.dialect, frames.len()), (Dialect::Sdk3, 60));
    let why = report.no_points_because().unwrap();
    assert_eq!(
        why,
        "no point could be read from 60 packets, although their headers count 480 objects; unknown TLVs: 4242 (60 times); \
         TLVs that are known and not used: 1040 (vital signs, 60 times)"
    );
    // Header counts that are damaged now and then do not speak against an empty room.
    let mut bytes = numbered(Dialect::Sdk3, std::iter::repeat_n(Vec::new(), 300));
    bytes[28] = 9;
    assert_eq!(read(&bytes).1.no_points_because(), None);
}

#[test]
fn truncation_and_damage_of_every_new_layout_is_survived() {
    let layouts: [(Dialect, Tlvs); 5] = [
        (
            Dialect::Sdk2,
            vec![(1, objects(9, &[(40, 1, 500, [0, 1024, -256]); 3]))],
        ),
        (
            Dialect::Overhead3d,
            vec![
                (6, floats(&[2.0, 0.5, -0.25, -0.75, 200.0])),
                (7, [words(&[1]), floats(&[0.5; 9])].concat()),
            ],
        ),
        (
            Dialect::PeopleTracking6844,
            vec![
                (1020, spherical_compact(1.0, 2.0)),
                (3001, spherical_compact(1.0, 2.0)),
            ],
        ),
        (
            Dialect::Sdk3,
            vec![(1000, floats(&[2.0, 0.1, 0.1, 0.5])), (315, vec![3, 7])],
        ),
        (Dialect::Sdk1, one_point(Dialect::Sdk1)),
    ];
    for (dialect, tlvs) in layouts {
        let bytes = numbered(dialect, vec![tlvs; 3]);
        for end in 0..bytes.len() {
            for stated in [Some(dialect), None] {
                let mut parser = UartParser::new(stated);
                let mut frames = parser.push(&bytes[..end]).unwrap();
                let Ok((last, report, _)) = parser.finish() else {
                    continue;
                };
                frames.extend(last);
                let parts = report.packet_bytes + report.skipped_bytes + report.trailing_bytes;
                assert_eq!(parts, end as u64);
            }
        }
        for at in 0..bytes.len() {
            for value in [0, 1, 0x7F, 0xFF] {
                let mut damaged = bytes.clone();
                damaged[at] = value;
                let mut parser = UartParser::new(Some(dialect));
                let mut frames = parser.push(&damaged).unwrap();
                frames.extend(parser.finish().unwrap().0);
                let mut points = frames.iter().flat_map(|f| &f.points);
                assert!(points.all(|p| p.range_m <= 300.0 && p.intensity_db.is_finite()));
            }
        }
    }
}

/// Dialects that read the same from the first packets: nothing waits, and the first difference decides.
#[test]
fn packets_that_dialects_read_alike_are_returned_at_once() {
    let targets = || [words(&[3]), floats(&[0.5; 16])].concat();
    let alike = vec![vec![(7, targets()), (8, vec![])]; 100];
    let dialect = Dialect::PeopleCounting2dCompact;
    let bytes = numbered(dialect, alike.clone());
    let mut parser = UartParser::new(None);
    let frames = parser.push(&bytes).unwrap();
    assert!(frames.len() > 80, "{}", frames.len());
    assert!(frames.iter().all(|f| f.targets.len() == 1));
    assert_eq!((parser.dialect(), parser.unclear()), (None, None));
    let (_, _, guess) = read(&bytes);
    assert!(
        guess.is_assumed && guess.dialect == Dialect::PeopleCounting2d,
        "{guess}"
    );
    let contents = alike.into_iter().chain(vec![one_point(dialect); 20]);
    let (frames, report, guess) = read(&numbered(dialect, contents));
    assert_eq!(guess.dialect, dialect, "{guess}");
    assert_eq!(
        (frames.len(), report.points, report.lost_frames),
        (120, 20, 0)
    );

    // TLVs that are not known, in packets whose version says nothing.
    let unknown = |n| {
        let mut bytes = packet(Dialect::Sdk3, n, &[(4242, vec![1; 96])]);
        bytes[8..12].fill(0);
        bytes
    };
    let mut bytes: Vec<u8> = (0..200).flat_map(unknown).collect();
    let (frames, report, guess) = read(&bytes);
    assert!(
        guess.is_assumed && guess.dialect == Dialect::Sdk3,
        "{guess}"
    );
    assert_eq!((frames.len(), report.tlvs_unknown), (200, 200));
    for n in 200..220 {
        bytes.extend(packet(Dialect::Sdk2, n, &one_point(Dialect::Sdk2)));
    }
    let (frames, report, guess) = read(&bytes);
    assert_eq!((guess.dialect, guess.is_assumed), (Dialect::Sdk2, false));
    assert_eq!((frames.len(), report.points), (220, 20));
}
