//! Capture cards: the frames of the recording, foreign senders, lost packets, restarts.

use std::{
    fs,
    net::{IpAddr, Ipv4Addr, UdpSocket},
    time::Duration,
};

use radarllm_base::{PointFrame, RadarConfig};
use radarllm_formats::{adc::CubeShape, radar_to_toml};
use radarllm_io::{
    CaptureOptions, IqChoice, LayoutOptions, OpenedRadar,
    live::{Dca1000, DcaOptions, LiveEvent, LiveSource as _, LiveTimeouts},
    open_radar, read_recording,
};

use crate::{
    events::{PATIENCE, event, frame, frames_until_lost, lost},
    made::{self, I_FIRST, two},
};

/// Address of the card. Foreign datagrams come from the next one.
const CARD: IpAddr = IpAddr::V4(Ipv4Addr::LOCALHOST);
const FOREIGN: IpAddr = IpAddr::V4(Ipv4Addr::new(127, 0, 0, 2));

/// A radar whose frames are so small that the system's buffer holds every packet of a test.
fn small_radar() -> OpenedRadar {
    let radar = RadarConfig {
        name: "small".into(),
        n_samples: 32,
        n_loops: 8,
        slope_hz_per_s: 15e12,
        sample_rate_hz: 1.1e6,
        ..RadarConfig::awr1843boost()
    };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("small.toml");
    fs::write(&path, radar_to_toml(&radar).unwrap()).unwrap();
    open_radar(path.to_str().unwrap()).unwrap()
}

fn capture() -> CaptureOptions {
    let mut options = CaptureOptions {
        radar: Some(small_radar()),
        layout: LayoutOptions {
            iq: Some(IqChoice::IFirst),
            lanes: Some(2),
            ..LayoutOptions::default()
        },
        ..CaptureOptions::default()
    };
    options.points.mounting.tilt_rad = 0.2;
    options
}

/// Packets of `n` frames with an echo that comes nearer.
fn datagrams(n: usize) -> Vec<Vec<u8>> {
    let shape = CubeShape::of(capture().radar.unwrap().config().unwrap());
    let words = (0..n).flat_map(|i| {
        let cube = made::echo(shape, 12.0 - i as f64 / 2.0, 20.0, i as u64);
        made::words(&cube, two(I_FIRST))
    });
    made::datagrams(&made::bytes(&words.collect::<Vec<i16>>()), 1456)
}

/// Frames of the same packets in a file.
fn file_frames(packets: &[Vec<u8>]) -> Vec<PointFrame> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("adc_data_Raw_0.bin");
    fs::write(&path, made::records(packets)).unwrap();
    read_recording(&[path], &capture()).unwrap().clip.frames
}

fn open(card: Option<IpAddr>, lost: Duration) -> Dca1000 {
    Dca1000::open(DcaOptions {
        input: "udp:127.0.0.1:0".into(),
        card,
        configure: false,
        capture: capture(),
        timeouts: LiveTimeouts {
            lost,
            ..LiveTimeouts::default()
        },
    })
    .unwrap()
}

fn send(from: IpAddr, to: &Dca1000, packets: &[Vec<u8>]) {
    let socket = UdpSocket::bind((from, 0)).unwrap();
    for packet in packets {
        socket.send_to(packet, to.local_address()).unwrap();
    }
}

#[test]
fn packets_give_the_frames_of_the_recording() {
    let packets = datagrams(6);
    let expected = file_frames(&packets);
    assert_eq!(expected.len(), 6);
    assert!(expected.iter().all(|f| !f.points.is_empty()));
    let mut card = open(None, PATIENCE);
    send(CARD, &card, &packets);
    // The last frame does not wait for packets after it.
    let found: Vec<PointFrame> = (0..6).map(|_| frame(&mut card)).collect();
    assert_eq!(found, expected);
    let counts = card.counts();
    assert_eq!((counts.frames, counts.lost_frames), (6, 0));
    let about = card.about();
    assert_eq!(about.provenance.to_string(), "recorded:udp:127.0.0.1:0");
    assert_eq!(about.radar, "small");
}

#[test]
fn foreign_senders_are_skipped_and_counted() {
    let packets = datagrams(3);
    let mut card = open(Some(CARD), PATIENCE);
    // The same counters with other samples, before the card sends anything.
    let forged: Vec<Vec<u8>> = datagrams(4).iter().rev().take(7).cloned().collect();
    send(FOREIGN, &card, &forged);
    send(CARD, &card, &packets[..10]);
    send(FOREIGN, &card, &forged);
    send(CARD, &card, &[vec![1; 5], vec![2; 2000]]);
    send(CARD, &card, &packets[10..]);
    let found: Vec<PointFrame> = (0..3).map(|_| frame(&mut card)).collect();
    assert_eq!(found, file_frames(&packets));
    assert_eq!(card.counts().foreign_datagrams, 16);
    assert_eq!(card.counts().resynchronisations, 0);
}

#[test]
fn lost_packets_are_placed_by_the_byte_count() {
    let mut packets = datagrams(12);
    // Whole frames are lost, and one packet of another.
    packets.drain(20..40);
    packets.remove(50);
    packets.swap(3, 4);
    let mut card = open(None, Duration::from_millis(300));
    send(CARD, &card, &packets);
    let (found, reason) = frames_until_lost(&mut card);
    assert!(
        reason.contains("no packets of a card for 0.3 s"),
        "{reason}"
    );
    let recorded = file_frames(&packets);
    let numbers: Vec<u32> = found.iter().map(|f| f.frame).collect();
    let expected: Vec<PointFrame> = recorded
        .iter()
        .filter(|f| numbers.contains(&f.frame))
        .cloned()
        .collect();
    assert_eq!(found, expected);
    let n_lost = recorded.len() - found.len();
    assert!(n_lost > 0);
    assert_eq!(card.counts().lost_frames, n_lost as u64);
    assert!(numbers.windows(2).all(|w| w[0] < w[1]));
}

#[test]
fn a_card_that_starts_anew_is_followed() {
    let packets = datagrams(10);
    let mut card = open(None, Duration::from_millis(300));
    send(CARD, &card, &packets);
    let (before, _) = frames_until_lost(&mut card);
    assert_eq!(before.len(), 10);
    // After silence, every frame is used.
    assert_eq!(card.next(Duration::from_millis(10)).unwrap(), None);
    send(CARD, &card, &packets);
    assert_eq!(event(&mut card), LiveEvent::Back);
    let (after, _) = frames_until_lost(&mut card);
    assert_eq!(after.len(), 10);
    assert!(after[0].frame > before[9].frame);
    let points =
        |frames: &[PointFrame]| -> Vec<_> { frames.iter().map(|f| f.points.clone()).collect() };
    assert_eq!(points(&after), points(&before));
    assert_eq!(card.counts().reconnects, 1);

    // Without silence, the restart shows after the packets that could have been reordered: in the middle of frame 7.
    let mut card = open(None, PATIENCE);
    send(CARD, &card, &packets);
    let mut numbers: Vec<u32> = (0..10).map(|_| frame(&mut card).frame).collect();
    send(CARD, &card, &datagrams(18));
    numbers.push(frame(&mut card).frame);
    let whole = frame(&mut card);
    numbers.push(whole.frame);
    assert_eq!(whole.points, before[8].points);
    assert!(numbers.windows(2).all(|w| w[0] < w[1]), "{numbers:?}");
    assert_eq!(card.counts().resynchronisations, 1);
}

#[test]
fn a_silent_card_is_lost_once() {
    let mut card = open(None, Duration::from_millis(50));
    assert!(lost(&mut card).contains("udp:127.0.0.1:0"));
    assert_eq!(card.next(Duration::from_millis(150)).unwrap(), None);
    assert_eq!(card.counts().reconnects, 0);
}

#[test]
fn a_sender_without_usable_packets_makes_room_for_the_card() {
    let packets = datagrams(3);
    let mut card = open(None, Duration::from_millis(200));
    // Datagrams of the right length, whose counters fit no others.
    let noise: Vec<Vec<u8>> = (0..5_u32)
        .map(|i| made::datagram(i * 1000, u64::from(i * i) << 30, &[7; 100]))
        .collect();
    send(FOREIGN, &card, &noise);
    lost(&mut card);
    send(CARD, &card, &packets);
    assert_eq!(event(&mut card), LiveEvent::Back);
    let points: Vec<_> = (0..3).map(|_| frame(&mut card).points).collect();
    let expected: Vec<_> = file_frames(&packets)
        .into_iter()
        .map(|f| f.points)
        .collect();
    assert_eq!(points, expected);
}

#[test]
fn options_that_cannot_work_are_refused() {
    let refused = |change: fn(&mut DcaOptions)| {
        let mut options = DcaOptions {
            input: "udp:127.0.0.1:0".into(),
            capture: capture(),
            ..DcaOptions::default()
        };
        change(&mut options);
        Dca1000::open(options).err().unwrap().to_string()
    };
    assert!(refused(|o| o.input = "/dev/ttyACM0".into()).contains("no address"));
    assert!(refused(|o| o.capture.radar = None).contains("`radar`"));
    assert!(refused(|o| o.capture.layout.iq = None).contains("order of I and Q"));
    assert!(refused(|o| o.capture.points.seconds = Some(1.0)).contains("`seconds`"));
    assert!(refused(|o| o.capture.max_frames = Some(3)).contains("`frames`"));
    assert!(refused(|o| o.configure = true).contains("address"));
}
