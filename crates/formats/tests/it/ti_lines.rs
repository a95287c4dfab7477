//! Single lines of chirp files: comments, subsets of chirps, and everything that is refused.

use radarllm_formats::{Board, BoardEvidence, TiCfg, TiCfgError};

const GOOD: &str = "% Platform:xWR18xx
dfeDataOutputMode 1
channelCfg 15 7 0   % all
adcCfg 2 1
adcbufCfg -1 0 1 1 1
profileCfg 0 77 7 6 65 0 0 60.012 1 256 4400 0 0 30
chirpCfg 0 0 0 0 0 0 0 1
chirpCfg 1 1 0 0 0 0 0 4
chirpCfg 2 2 0 0 0 0 0 2
frameCfg 0 2 128 0 100 1 0
guiMonitor -1 1 1 0 0 0 1
clutterRemoval -1 0
lvdsStreamCfg -1 0 1 0
compRangeBiasAndRxChanPhase 0.05 1 0 0 1
sensorStart
";

fn refused(from: &str, to: &str) -> TiCfgError {
    assert!(GOOD.contains(from), "{from}");
    TiCfg::parse(&GOOD.replace(from, to), None).unwrap_err()
}

/// Asserts line and first column, and a word of the message.
fn refused_at(from: &str, to: &str, line: usize, column: usize, word: &str) {
    match refused(from, to) {
        TiCfgError::Line {
            line: l,
            columns,
            problem,
            text,
            ..
        } => {
            assert_eq!((l, columns.start), (line, column), "{text}: {problem}");
            assert!(problem.contains(word), "{problem}");
        }
        other => panic!("{other}"),
    }
}

#[test]
fn the_reference_chirp_gives_the_reference_radar() {
    let cfg = TiCfg::parse(GOOD, None).unwrap();
    let expected = radarllm_base::RadarConfig::awr1843boost();
    assert_eq!(cfg.slots, [1, 3, 2]);
    assert_eq!(
        (&cfg.radar.name, cfg.board, cfg.board_evidence),
        (&expected.name, Board::Xwr1843Boost, BoardEvidence::Platform)
    );
    for (a, b) in [
        (cfg.radar.carrier_hz(), expected.carrier_hz()),
        (
            cfg.radar.range_resolution_m(),
            expected.range_resolution_m(),
        ),
        (cfg.radar.max_velocity_mps(), expected.max_velocity_mps()),
        (cfg.radar.tx[1].x_m, expected.tx[1].x_m),
        (cfg.radar.tx[2].z_m, expected.tx[2].z_m),
    ] {
        // Units are scaled by powers of ten: rounding in the last bits.
        assert!((a / b - 1.0).abs() < 1e-12, "{a} {b}");
    }
    assert_eq!(
        (cfg.q_first, cfg.lvds_samples, cfg.firmware_clutter_removal),
        (Some(true), Some(true), Some(false))
    );
    assert_eq!(cfg.calibration, Some((0.05, vec![(1.0, 0.0), (0.0, 1.0)])));
    let unused: Vec<_> = cfg.unused.iter().map(|(l, n)| (*l, n.as_str())).collect();
    assert_eq!(unused, [(11, "guiMonitor"), (15, "sensorStart")]);
}

#[test]
fn frames_use_the_chirps_they_name_and_no_others() {
    let cfg = TiCfg::parse(&GOOD.replace("frameCfg 0 2", "frameCfg 0 1"), None).unwrap();
    assert_eq!((cfg.slots.as_slice(), cfg.radar.tx.len()), (&[1, 3][..], 2));
    // Two slots of 72 us instead of three: 4.386 * 3 / 2.
    assert!((cfg.radar.max_velocity_mps() - 6.579).abs() < 2e-3);
    let cfg = TiCfg::parse(&GOOD.replace("frameCfg 0 2", "frameCfg 2 2"), None).unwrap();
    assert_eq!(cfg.slots, [2]);
}

#[test]
fn one_chirp_line_can_define_several() {
    let text = GOOD
        .replace("chirpCfg 1 1 0", "chirpCfg 1 3 0")
        .replace("frameCfg 0 2", "frameCfg 0 3");
    assert_eq!(TiCfg::parse(&text, None).unwrap().slots, [1, 3, 2, 3]);
}

#[test]
fn equal_variations_shift_the_profile() {
    let mut text = GOOD.to_owned();
    for i in 0..3 {
        text = text.replace(
            &format!("chirpCfg {i} {i} 0 0 0 0 0"),
            &format!("chirpCfg {i} {i} 0 1e6 0 2 0"),
        );
    }
    let radar = TiCfg::parse(&text, None).unwrap().radar;
    assert!((radar.start_hz - 77.001e9).abs() < 1.0 && (radar.idle_s - 9e-6).abs() < 1e-12);
}

#[test]
fn masked_receivers_are_left_out() {
    let cfg = TiCfg::parse(&GOOD.replace("channelCfg 15", "channelCfg 5"), None).unwrap();
    assert_eq!(
        (cfg.receivers.as_slice(), cfg.radar.rx.len()),
        (&[1, 3][..], 2)
    );
}

/// SDK 3 user guide: both azimuth transmitters in both chirps, the second inverted in `chirp1Idx`.
#[test]
fn phase_modulation_takes_two_transmitters_in_two_chirps() {
    let text = GOOD
        .replace("0 0 0 0 0 0 0 1", "0 0 0 0 0 0 0 5")
        .replace("1 1 0 0 0 0 0 4", "1 1 0 0 0 0 0 5")
        .replace("frameCfg 0 2", "frameCfg 0 1")
        .replace("guiMonitor -1 1 1 0 0 0 1", "bpmCfg -1 1 0 1");
    let cfg = TiCfg::parse(&text, None).unwrap();
    assert_eq!(cfg.slots, [1, 3]);
    let reference = radarllm_base::RadarConfig::awr1843boost();
    assert_eq!(
        cfg.radar.multiplexing,
        radarllm_base::radar_config::TxMultiplexing::Bpm
    );
    for (a, b) in cfg.radar.tx.iter().zip(&reference.tx[..2]) {
        // Half a wavelength times 4, or 4 times half a wavelength.
        assert!((a.x_m - b.x_m).abs() < 1e-12 && (a.z_m - b.z_m).abs() < 1e-12);
    }
    let refused = |from: &str, to: &str| {
        assert!(text.contains(from), "{from}");
        TiCfg::parse(&text.replace(from, to), None)
            .unwrap_err()
            .to_string()
    };
    assert!(refused("1 1 0 0 0 0 0 5", "1 1 0 0 0 0 0 4").contains("two transmitters"));
    assert!(refused("1 1 0 0 0 0 0 5", "1 1 0 0 0 0 0 6").contains("same two"));
    assert!(refused("channelCfg 15 7", "channelCfg 15 3").contains("enables only"));
    assert!(refused("bpmCfg -1 1 0 1", "bpmCfg -1 1 0 2").contains("0 and 2"));
    assert!(refused("bpmCfg -1 1 0 1", "bpmCfg -1 1 0").contains("missing"));
    assert!(refused("bpmCfg -1 1 0 1", "bpmCfg -1 0 0 1").contains("one transmitter"));
}

#[test]
fn boards_can_be_stated() {
    let text = GOOD.replace("frameCfg 0 2", "frameCfg 0 0");
    let cfg = TiCfg::parse(&text, Some(Board::Xwr1642Boost)).unwrap();
    assert_eq!(
        (cfg.board, cfg.board_evidence),
        (Board::Xwr1642Boost, BoardEvidence::Stated)
    );
    assert!(
        TiCfg::parse(GOOD, Some(Board::Xwr1642Boost))
            .unwrap_err()
            .to_string()
            .contains("TX3")
    );
}

#[test]
fn what_cannot_be_a_cube_is_refused_with_its_place() {
    refused_at(
        "dfeDataOutputMode 1",
        "dfeDataOutputMode 3",
        2,
        19,
        "mode 1",
    );
    refused_at("adcCfg 2 1", "adcCfg 2 0", 4, 10, "complex");
    refused_at("adcbufCfg -1 0", "adcbufCfg -1 1", 5, 14, "complex");
    refused_at("7 6 65", "7 six 65", 6, 19, "ADC start");
    refused_at("77 7", "NaN 7", 6, 14, "number");
    refused_at(" 256 ", " 256.5 ", 6, 37, "whole");
    refused_at(" 256 ", " 4000000000 ", 6, 37, "8192");
    refused_at(
        "0 0 0 0 0 0 0 1",
        "0 0 0 0 0 0 0 3",
        7,
        24,
        "one transmitter",
    );
    refused_at("1 1 0 0 0 0 0 4", "1 1 0 5 0 0 0 4", 8, 24, "differs");
    refused_at("1 1 0 0 0 0 0 4", "1 0 0 0 0 0 0 4", 8, 12, "before");
    refused_at("1 1 0 0 0 0 0 4", "1 999999 0 0 0 0 0 4", 8, 12, "511");
    refused_at("15 7 0", "15 3 0", 8, 24, "enables only");
    refused_at("frameCfg 0 2", "frameCfg 0 3", 10, 12, "chirp 3");
    refused_at(
        "frameCfg 0 2 128 0 100 1 0",
        "frameCfg 0 2",
        10,
        1,
        "missing",
    );
    refused_at(
        "guiMonitor -1 1 1 0 0 0 1",
        "bpmCfg -1 1 0 1",
        11,
        1,
        "no others",
    );
    refused_at(
        "guiMonitor -1 1 1 0 0 0 1",
        "advFrameCfg 2 0",
        11,
        1,
        "advanced",
    );
    assert_eq!(
        refused("frameCfg", "%frameCfg"),
        TiCfgError::Missing("frameCfg")
    );
    assert_eq!(
        refused("profileCfg", "%"),
        TiCfgError::Missing("profileCfg")
    );
    assert_eq!(
        refused("sensorStart", "flushCfg"),
        TiCfgError::Missing("channelCfg")
    );
    assert!(
        matches!(refused(" 100 1 0", " 20 1 0"), TiCfgError::Radar(e) if e.field == "frame_period_s")
    );
    assert!(
        matches!(refused("7 6 65", "7 6 50"), TiCfgError::Radar(e) if e.field == "adc_start_s")
    );
}

/// Every prefix and every single-byte change gives a radar or an error, never a panic.
#[test]
fn damaged_files_never_panic() {
    for end in 0..GOOD.len() {
        let _ = TiCfg::parse(&GOOD[..end], None);
    }
    let mut bytes = GOOD.as_bytes().to_vec();
    let mut n_refused = 0;
    for i in 0..bytes.len() {
        for replacement in [b' ', b'-', b'9', b'e', b'\n', 0, 0xff] {
            let old = std::mem::replace(&mut bytes[i], replacement);
            if let Ok(cfg) = TiCfg::parse(&String::from_utf8_lossy(&bytes), None) {
                cfg.radar.validate().unwrap();
            } else {
                n_refused += 1;
            }
            bytes[i] = old;
        }
    }
    assert!(n_refused > 100, "{n_refused}");
    assert!(TiCfg::parse("", None).is_err());
    assert!(TiCfg::parse(&"9".repeat(100_000), None).is_err());
}
