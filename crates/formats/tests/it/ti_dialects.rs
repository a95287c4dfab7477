//! Dialects of chirp files: frame period, resolutions and mounting of files without a cube, against closed forms.

use radarllm_base::{SPEED_OF_LIGHT_MPS as C, radar_config::TxMultiplexing};
use radarllm_formats::{
    Board, BoardEvidence, ChirpDialect, PointRadar, Severity, TiCfg, TiCfgError, lint_ti_cfg,
    lint_ti_cfg_named, ti_cfg::TiCfgReading,
};

/// Two transmitters at 60 GHz; the samples take 32 us.
const SIMPLE: &str = "dfeDataOutputMode 1
channelCfg 15 5 0
adcCfg 2 1
adcbufCfg -1 0 1 1 1
profileCfg 0 60.5 20 8 44 0 0 70 1 128 4000 0 0 30
chirpCfg 0 0 0 0 0 0 0 1
chirpCfg 1 1 0 0 0 0 0 4
frameCfg 0 1 32 0 80 1 0
sensorPosition 1.5 10 20
sensorStart
";

const ADVANCED: &str = "dfeDataOutputMode 3
channelCfg 15 5 0
adcCfg 2 1
adcbufCfg -1 0 1 1 1
profileCfg 0 60.5 20 8 44 0 0 70 1 128 4000 0 0 30
profileCfg 1 60.5 20 8 84 0 0 35 1 128 2000 0 0 30
chirpCfg 0 0 0 0 0 0 0 1
chirpCfg 1 1 0 0 0 0 0 4
chirpCfg 2 3 1 0 0 0 0 1
advFrameCfg 2 0 0 1 0
subFrameCfg 0 0 0 2 32 30 0 1 1 30
subFrameCfg 1 0 2 2 32 20 0 1 1 22.5
sensorPosition 2 0 15
sensorStart
";

const RETENTION: &str = "% Platform:xWR68xx_AOP
dfeDataOutputMode 1
channelCfg 15 7 0
adcCfg 2 1
adcbufCfg -1 0 1 1 1
bpmCfg -1 1 1 2
profileCfg 0 60.5 20 8 44 0 0 70 1 128 4000 0 0 30
chirpCfg 0 0 0 0 0 0 0 1
chirpCfg 1 2 0 0 0 0 0 6
frameCfg 0 2 40 0 50 1 0
sensorStart
";

const MCU_PLUS: &str = "dfeDataOutputMode 1
channelCfg 15 15 0
adcCfg 2 0
adcbufCfg -1 1 0 1 1
profileCfg 0 76.5 6 5 24 0 0 12 0 400 25000 0 0 164
chirpCfg 0 5 0 0 0 0 0 15
frameCfg 0 5 64 0 400 40 1 0
sensorStart
";

/// Bursts of two chirps.
const BURSTS: &str = "sensorStop 0
channelCfg 7 3 0
chirpComnCfg 16 0 0 160 4 32 0
chirpTimingCfg 7 20 0 75 58
frameCfg 2 0 250 48 125 0
antGeometryCfg 1 0 0 1 1 2 1 1 0 2 1 3 2.4 2.5
sensorPosition 0 0 1.2 0 0
sensorStart 0 0 0 0
";

/// One burst of many chirps, of a device with two bits for each transmitter.
const MANY: &str = "sensorStop 0
channelCfg 153 63 0
chirpComnCfg 10 0 0 200 1 14 3
chirpTimingCfg 5 50 0 140 57.5
frameCfg 96 0 2000 1 200 0
antGeometryBoard xWRL6844EVM
sensorStart 0 0 0 0
";

const ALL: [&str; 6] = [SIMPLE, ADVANCED, RETENTION, MCU_PLUS, BURSTS, MANY];

fn points(text: &str) -> PointRadar {
    let reading = TiCfg::read(text, None);
    reading
        .points
        .unwrap_or_else(|| panic!("{:?}", reading.errors))
}

/// The only reason why there is no cube.
fn reason(text: &str) -> String {
    let reading = TiCfg::read(text, None);
    assert!(reading.cfg.is_none() && reading.points.is_some());
    let [error] = &reading.errors[..] else {
        panic!("{:?}", reading.errors);
    };
    assert!(error.is_unsupported(), "{error}");
    error.to_string()
}

fn close(found: Option<f64>, expected: f64) {
    let found = found.unwrap();
    assert!((found / expected - 1.0).abs() < 1e-9, "{found} {expected}");
}

/// Range resolution C / (2 S T) and maximum range of `n_bins` bins, for a slope S in Hz/s and a window T in s.
fn check_range(points: &PointRadar, slope: f64, window_s: f64, n_bins: f64) {
    close(points.sampled_bandwidth_hz, slope * window_s);
    close(points.range_resolution_m, C / (2.0 * slope * window_s));
    close(points.max_range_m, n_bins * C / (2.0 * slope * window_s));
}

/// Maximum speed C / (4 f T) and resolution for the carrier f in Hz and `n_loops` loops of T in s.
fn check_velocity(points: &PointRadar, carrier_hz: f64, loop_s: f64, n_loops: f64) {
    close(points.carrier_hz, carrier_hz);
    close(points.max_velocity_mps, C / (4.0 * carrier_hz * loop_s));
    close(
        points.velocity_resolution_mps,
        C / (2.0 * carrier_hz * loop_s * n_loops),
    );
}

#[test]
fn simple_frames_have_points_and_a_cube_with_equal_figures() {
    let reading = TiCfg::read(SIMPLE, None);
    let (cfg, points) = (reading.cfg.unwrap(), reading.points.unwrap());
    assert_eq!(reading.dialect, ChirpDialect::Sdk);
    assert_eq!(points.frame_rate_hz(), 12.5);
    check_range(&points, 70e12, 32e-6, 128.0);
    check_velocity(&points, 60.5e9 + 70e12 * 24e-6, 128e-6, 32.0);
    close(
        Some(cfg.radar.range_resolution_m()),
        points.range_resolution_m.unwrap(),
    );
    close(
        Some(cfg.radar.max_velocity_mps()),
        points.max_velocity_mps.unwrap(),
    );
    let position = points.position.unwrap();
    assert_eq!(position.height_m, 1.5);
    close(Some(position.elevation_tilt_rad), 20_f64.to_radians());
}

#[test]
fn an_advanced_frame_lasts_as_long_as_its_sub_frames() {
    let found = points(ADVANCED);
    assert_eq!(found.dialect, Some(ChirpDialect::AdvancedFrames));
    close(Some(found.frame_period_s), 0.0525);
    assert_eq!(found.position.unwrap().height_m, 2.0);
    // The sub-frames differ in their window, and so does the velocity.
    assert_eq!((found.max_range_m, found.max_velocity_mps), (None, None));
    assert!(reason(ADVANCED).starts_with("line 10, columns 1 to 12: `advFrameCfg`"));
    // Equal sub-frames share their figures.
    let equal = ADVANCED.replace("chirpCfg 2 3 1", "chirpCfg 2 3 0");
    let found = points(&equal);
    check_range(&found, 70e12, 32e-6, 128.0);
    check_velocity(&found, 60.5e9 + 70e12 * 24e-6, 128e-6, 32.0);
}

#[test]
fn sub_frames_that_do_not_add_up_are_refused_with_their_place() {
    for (from, to, part) in [
        (
            "subFrameCfg 1",
            "% 1",
            "line 10, columns 1 to 12: `advFrameCfg`: 2 sub-frames are stated, but no subFrameCfg 1",
        ),
        ("subFrameCfg 0", "subFrameCfg 1", "no subFrameCfg 0"),
        (
            "advFrameCfg 2",
            "advFrameCfg 1",
            "sub-frame 1 is defined, but advFrameCfg states 1",
        ),
        ("advFrameCfg 2", "advFrameCfg 5", "from 1 to 4"),
        ("advFrameCfg 2", "advFrameCfg 0", "from 1 to 4"),
        ("subFrameCfg 1", "subFrameCfg 4", "from 0 to 3"),
        (" 22.5", " 0", "sub-frame period, ms, must be positive"),
        (" 22.5", " -22.5", "must be positive"),
        (" 22.5", " nan", "must be a number"),
        (" 22.5", " 1e9", "a frame period of"),
        (" 22.5", "", "argument 10"),
        (
            " 22.5",
            " 2.5",
            "chirps take 6.66 ms but the frame lasts 2.50 ms",
        ),
        ("advFrameCfg", "%", "there is no `advFrameCfg` line"),
    ] {
        assert!(ADVANCED.contains(from), "{from}");
        let reading = TiCfg::read(&ADVANCED.replace(from, to), None);
        assert_eq!((&reading.points, &reading.cfg), (&None, &None), "{to}");
        let errors: Vec<String> = reading.errors.iter().map(TiCfgError::to_string).collect();
        assert!(errors.iter().any(|e| e.contains(part)), "{to}: {errors:?}");
        assert!(!reading.errors.iter().all(TiCfgError::is_unsupported));
    }
    // Chirps that nobody defined hide the figures, not the frame period.
    let reading = TiCfg::read(&ADVANCED.replace("chirpCfg 2 3", "chirpCfg 2 2"), None);
    assert!(
        reading
            .errors
            .iter()
            .any(|e| e.to_string().contains("chirps 2 to 3"))
    );
    close(reading.points.map(|p| p.frame_period_s), 0.0525);
}

#[test]
fn static_retention_gives_the_frame_rate_and_the_true_reason() {
    let found = points(RETENTION);
    assert_eq!(
        (found.frame_rate_hz(), found.name.as_str()),
        (20.0, "iwr6843aop")
    );
    check_range(&found, 70e12, 32e-6, 128.0);
    check_velocity(&found, 60.5e9 + 70e12 * 24e-6, 192e-6, 40.0);
    let reason = reason(RETENTION);
    assert!(
        reason.starts_with("line 6, columns 1 to 7: `bpmCfg`"),
        "{reason}"
    );
    assert!(reason.contains("1 and 2, and no others"), "{reason}");
    // The chirp of time division between the two others.
    let between = RETENTION
        .replace("bpmCfg -1 1 1 2", "bpmCfg -1 1 0 2")
        .replace("chirpCfg 0 0 0 0 0 0 0 1", "chirpCfg 0 0 0 0 0 0 0 5")
        .replace(
            "chirpCfg 1 2 0 0 0 0 0 6",
            "chirpCfg 1 1 0 0 0 0 0 2\nchirpCfg 2 2 0 0 0 0 0 5",
        );
    assert_eq!(points(&between).frame_rate_hz(), 20.0);
    assert!(self::reason(&between).contains("0 and 2, and no others"));
}

#[test]
fn profiles_that_differ_in_their_number_alone_are_one() {
    let two = SIMPLE
        .replace(
            "chirpCfg 0",
            "profileCfg 3 60.5 20 8 44 0 0 70 1 128 4000 1 1 48\nchirpCfg 0",
        )
        .replace("chirpCfg 1 1 0", "chirpCfg 1 1 3");
    let cfg = TiCfg::parse(&two, None).unwrap();
    assert_eq!(cfg.radar, TiCfg::parse(SIMPLE, None).unwrap().radar);
    assert_eq!(cfg.slots, [1, 3]);
    for (from, to) in [
        ("3 60.5 20", "3 60.5 21"),
        ("3 60.5", "3 60.6"),
        ("3 60.5 20 8 44 0 0 70 1 128", "3 60.5 20 8 44 0 0 70 1 64"),
        ("3 60.5 20 8 44 0", "3 60.5 20 8 44 6"),
        ("3 60.5 20 8 44 0 0", "3 60.5 20 8 44 0 64"),
    ] {
        let other = two.replace(from, to);
        assert_ne!(other, two);
        assert!(reason(&other).contains("differs from the others"), "{to}");
        assert_eq!(points(&other).frame_rate_hz(), 12.5);
    }
}

#[test]
fn frame_cfg_of_the_mcu_plus_sdk_has_the_samples_before_the_period() {
    let found = points(MCU_PLUS);
    assert_eq!(
        (found.frame_rate_hz(), found.name.as_str()),
        (25.0, "xwr2944")
    );
    // Real samples: half as many bins.
    check_range(&found, 12e12, 16e-6, 200.0);
    assert_eq!(found.max_velocity_mps, None);
    let reading = TiCfg::read(MCU_PLUS, None);
    assert_eq!(reading.dialect, ChirpDialect::McuPlus);
    let first = reading.errors[0].to_string();
    assert!(
        first.starts_with("line 7, columns 19 to 22: `400`: this is a chirp file of the MCU+ SDK"),
        "{first}"
    );
    assert!(
        reading.errors.iter().all(TiCfgError::is_unsupported),
        "{:?}",
        reading.errors
    );
    // Time division with complex samples.
    let tdm = SIMPLE.replace("frameCfg 0 1 32 0 80 1 0", "frameCfg 0 1 32 0 128 80 1 0");
    assert_eq!(points(&tdm).frame_rate_hz(), 12.5);
    assert!(reason(&tdm).contains("MCU+"));
    let nine = tdm.replace("80 1 0", "80 1 0 0");
    assert_eq!(points(&nine).frame_rate_hz(), 12.5);
    // More loops than SDK 3 has.
    assert_eq!(
        points(&tdm.replace("1 32 0 128", "1 400 0 128")).frame_rate_hz(),
        12.5
    );
    // The platform names it, too.
    let named = format!("% Platform:xWR2944\n{SIMPLE}");
    assert!(reason(&named).contains("MCU+"));
    assert_eq!(points(&named).name, "xWR2944");
    // A comment, or a value too many, is not an eighth value.
    for tail in ["80 1 0 # ten", "80 1 0 0", "80 1 0 0 0", "80 1 1 0"] {
        let simple = SIMPLE.replace("80 1 0", tail);
        assert_eq!(
            TiCfg::parse(&simple, None).unwrap().radar.frame_rate_hz(),
            12.5,
            "{tail}"
        );
    }
}

#[test]
fn bursts_of_the_low_power_sdk_have_the_figures_of_its_demo() {
    let found = points(BURSTS);
    assert_eq!(found.dialect, Some(ChirpDialect::LowPower));
    assert_eq!(
        (found.frame_rate_hz(), found.name.as_str()),
        (8.0, "iwrl6432")
    );
    assert_eq!(found.position.unwrap().height_m, 1.2);
    // 100 MHz / 16 gives 160 samples in 25.6 us, after 20 samples in 3.2 us.
    check_range(&found, 75e12, 25.6e-6, 80.0);
    check_velocity(&found, 58e9 + 75e12 * 16e-6, 250e-6, 48.0);
    let reason = reason(BURSTS);
    assert!(
        reason.starts_with(
            "line 3, columns 1 to 13: `chirpComnCfg`: this is a chirp file of the low-power SDK"
        ),
        "{reason}"
    );
    // Another pattern and decimation, hexadecimal masks.
    let other = BURSTS
        .replace("chirpComnCfg 16", "chirpComnCfg 20")
        .replace("channelCfg 7 3", "channelCfg 0x7 0x3");
    check_range(&points(&other), 75e12, 32e-6, 80.0);
}

#[test]
fn single_bursts_count_their_chirps_as_loops() {
    let found = points(MANY);
    assert_eq!(
        (found.frame_rate_hz(), found.name.as_str()),
        (5.0, "xwrl6844")
    );
    // 200 MHz / 10: 200 samples in 10 us after 2.5 us; three transmitters of 19 us in 32 loops.
    check_range(&found, 140e12, 10e-6, 100.0);
    check_velocity(&found, 57.5e9 + 140e12 * 7.5e-6, 57e-6, 32.0);
    // Every chirp four times.
    let accumulated = MANY.replace("96 0 2000", "96 4 8000");
    check_velocity(
        &points(&accumulated),
        57.5e9 + 140e12 * 7.5e-6,
        228e-6,
        32.0,
    );
    // Masks and the band show the device without its name.
    let unnamed = MANY.replace("antGeometryBoard", "%");
    assert_eq!(points(&unnamed).name, "xwrl6844");
    assert_eq!(points(&unnamed.replace("153 63", "7 3")).name, "iwrl6432");
    let at_77_ghz = BURSTS.replace(" 75 58", " 75 76.5");
    assert_eq!(points(&at_77_ghz).name, "xwrl1432");
    assert!(TiCfg::read(&at_77_ghz, None).equivalent.is_none());
    let stated = format!("% Platform:xWRL6844\n{BURSTS}");
    assert_eq!(points(&stated).name, "xwrl6844");
    // A mask that is no pairs of bits does not show the number of transmitters.
    let odd = MANY.replace("153 63", "153 37");
    assert_eq!(points(&odd).max_velocity_mps, None);
    // A slope of 0 gives no range.
    let flat = MANY.replace("0 140 57.5", "0 0 57.5");
    assert_eq!(
        (
            points(&flat).range_resolution_m,
            points(&flat).frame_rate_hz()
        ),
        (None, 5.0)
    );
}

/// A radar to be simulated in place of an xWRL6432 has its bins: half as many complex samples at half the rate.
#[test]
fn an_xwrl6432_can_be_simulated() {
    let reading = TiCfg::read(BURSTS, None);
    let (radar, points) = (reading.equivalent.unwrap(), reading.points.unwrap());
    radar.validate().unwrap();
    for (found, expected) in [
        (radar.range_resolution_m(), points.range_resolution_m),
        (radar.max_range_m(), points.max_range_m),
        (
            radar.velocity_resolution_mps(),
            points.velocity_resolution_mps,
        ),
        (radar.max_velocity_mps(), points.max_velocity_mps),
        (radar.carrier_hz(), points.carrier_hz),
    ] {
        close(Some(found), expected.unwrap());
    }
    assert_eq!(
        (radar.n_samples, radar.n_loops, radar.name.as_str()),
        (80, 48, "iwrl6432")
    );
    assert_eq!(radar.multiplexing, TxMultiplexing::Bpm);
    // Row and column of `antGeometryCfg` in steps of 2.4 mm and 2.5 mm.
    let virtual_places = |tx: usize, rx: usize| {
        let (t, r) = (radar.tx[tx], radar.rx[rx]);
        [(t.z_m + r.z_m) / 2.5e-3, (t.x_m + r.x_m) / 2.4e-3]
    };
    let expected = [
        [1.0, 0.0],
        [0.0, 1.0],
        [1.0, 2.0],
        [1.0, 1.0],
        [0.0, 2.0],
        [1.0, 3.0],
    ];
    for (i, expected) in expected.iter().enumerate() {
        let found = virtual_places(i / 3, i % 3);
        assert!(
            found
                .iter()
                .zip(expected)
                .all(|(a, b)| (a - b).abs() < 1e-9),
            "{i}: {found:?}"
        );
    }
    assert_eq!(reading.board_evidence, Some(BoardEvidence::Geometry));
    // Without a geometry, the antennas are those of the built-in radar.
    let reading = TiCfg::read(&BURSTS.replace("antGeometryCfg", "%"), None);
    let builtin = radarllm_formats::builtin_radar("iwrl6432").unwrap();
    assert_eq!(reading.equivalent.unwrap().tx, builtin.tx);
    assert_eq!(reading.board_evidence, Some(BoardEvidence::Guess));
    // One transmitter alone.
    let alone = BURSTS
        .replace("channelCfg 7 3", "channelCfg 5 2")
        .replace("frameCfg 2 0", "frameCfg 1 0");
    let radar = TiCfg::read(&alone, None).equivalent.unwrap();
    assert_eq!(
        (radar.tx.len(), radar.rx.len(), radar.multiplexing),
        (1, 2, TxMultiplexing::Tdm)
    );
    assert!((radar.tx[0].x_m - 2.4e-3).abs() < 1e-9);
    // Chirps that do not fit into the burst give no radar.
    let reading = TiCfg::read(&BURSTS.replace("2 0 250", "2 0 50"), None);
    assert!(reading.equivalent.is_none() && reading.points.is_some());
    let broken = BURSTS.replace("1 1 0 2 1 3 2.4", "1 1 0 2 1 4 2.4");
    let errors = TiCfg::read(&broken, None).errors;
    assert!(
        errors
            .iter()
            .any(|e| e.to_string().contains("second transmitter")),
        "{errors:?}"
    );
}

#[test]
fn mistakes_in_files_of_the_low_power_sdk_are_named_with_their_place() {
    for (from, to, part) in [
        (
            "frameCfg 2 0 250 48 125",
            "frameCfg 2 0 250 48 0",
            "line 5, columns 21 to 22: `0`: frame period, ms, must be positive",
        ),
        ("48 125 0", "48 -125 0", "must be positive"),
        ("48 125 0", "48 nan 0", "must be a number"),
        ("48 125 0", "48 1e300 0", "a frame period of"),
        ("48 125 0", "48", "argument 5"),
        (
            "48 125 0",
            "48 11 0",
            "48 bursts take 12.00 ms but the frame lasts 11.00 ms",
        ),
        ("2 0 250 48", "2 0 250 4e9", "bursts must be"),
        ("chirpComnCfg 16", "chirpComnCfg 0", "decimation must be"),
        ("160 4 32", "160 2 32", "transmit pattern"),
        (" 160 ", " 160.5 ", "samples must be"),
        (
            "chirpTimingCfg 7",
            "chirpTimingCfg -7",
            "must not be negative",
        ),
        ("channelCfg 7", "channelCfg 0", "receiver mask"),
        ("channelCfg 7", "channelCfg 0xzz", "receiver mask"),
        ("channelCfg", "%", "there is no `channelCfg` line"),
        ("frameCfg", "%", "there is no `frameCfg` line"),
        ("chirpTimingCfg", "%", "there is no `chirpTimingCfg` line"),
        ("2.4 2.5", "0 2.5", "spacing along x"),
        ("0 0 1.2 0 0", "0 0 inf 0 0", "height"),
    ] {
        assert!(BURSTS.contains(from), "{from}");
        let reading = TiCfg::read(&BURSTS.replace(from, to), None);
        let errors: Vec<String> = reading.errors.iter().map(TiCfgError::to_string).collect();
        assert!(errors.iter().any(|e| e.contains(part)), "{to}: {errors:?}");
        assert!(reading.cfg.is_none() && reading.equivalent.is_none());
        assert!(
            errors
                .iter()
                .all(|e| !e.contains("1 to 15") && !e.contains("loops"))
        );
    }
}

#[test]
fn masks_of_other_devices_hide_the_cube_and_not_the_points() {
    let wide = SIMPLE.replace("channelCfg 15 5", "channelCfg 153 255");
    assert_eq!(
        (points(&wide).frame_rate_hz(), points(&wide).name.as_str()),
        (12.5, "unknown")
    );
    let reason = reason(&wide);
    assert!(
        reason.contains("the mask 153 is of a device with more antennas"),
        "{reason}"
    );
}

#[test]
fn platforms_are_taken_by_their_whole_names() {
    let tried =
        |platform: &str, text: &str| TiCfg::read(&format!("% Platform:{platform}\n{text}"), None);
    let at_77_ghz = SIMPLE.replace("0 60.5", "0 77");
    for (platform, text, board, evidence) in [
        (
            "xWR68xx_AOP",
            SIMPLE,
            Board::Xwr6843Aop,
            BoardEvidence::Platform,
        ),
        (
            "xWR68xx_ODS",
            SIMPLE,
            Board::Xwr6843IskOds,
            BoardEvidence::Platform,
        ),
        (
            "xWR64xx_AOP",
            SIMPLE,
            Board::Xwr6843Aop,
            BoardEvidence::Platform,
        ),
        (
            "xWR68xx",
            SIMPLE,
            Board::Xwr6843Isk,
            BoardEvidence::Family("xWR68xx".into()),
        ),
        (
            "xWR18xx",
            &at_77_ghz,
            Board::Xwr1843Boost,
            BoardEvidence::Platform,
        ),
        // A platform of the other band says nothing.
        ("xWR16xx", SIMPLE, Board::Xwr6843Isk, BoardEvidence::Guess),
    ] {
        let cfg = tried(platform, text).cfg.unwrap();
        assert_eq!(
            (cfg.board, cfg.board_evidence),
            (board, evidence),
            "{platform}"
        );
    }
    for (platform, text) in [
        ("xWR18xx_AOP", at_77_ghz.as_str()),
        ("xWR68xx_NEW", SIMPLE),
        ("xWR1243", &at_77_ghz),
    ] {
        let reading = tried(platform, text);
        assert_eq!((&reading.cfg, &reading.board_evidence), (&None, &None));
        let reason = reading.errors[0].to_string();
        assert!(reason.starts_with("line 1, columns 1 to "), "{reason}");
        assert!(
            reason.contains(&format!("the antennas of {platform} are not known")),
            "{reason}"
        );
        let points = reading.points.unwrap();
        assert_eq!(
            (points.name.as_str(), points.frame_rate_hz()),
            (platform, 12.5)
        );
    }
}

#[test]
fn the_name_of_the_file_is_a_weaker_sign() {
    let aop = "xwr68xx_AOP_profile_2020_01_02T03_04_05_006.cfg";
    let cfg = |name: &str, text: &str| TiCfg::read_named(name, text).cfg.unwrap();
    let found = cfg(aop, SIMPLE);
    assert_eq!(
        (found.board, found.board_evidence),
        (Board::Xwr6843Aop, BoardEvidence::FileName)
    );
    let family = format!("% Platform:xWR68xx\n{SIMPLE}");
    assert_eq!(cfg(aop, &family).board, Board::Xwr6843Aop);
    let isk = format!("% Platform:xWR68xx_ISK\n{SIMPLE}");
    assert_eq!(cfg(aop, &isk).board, Board::Xwr6843Isk);
    // A name of the other band, or of another form, says nothing.
    let at_77_ghz = SIMPLE.replace("0 60.5", "0 77");
    assert_eq!(cfg(aop, &at_77_ghz).board, Board::Xwr1843Boost);
    assert_eq!(
        cfg("AOP_6m.cfg", SIMPLE).board_evidence,
        BoardEvidence::Guess
    );
    let unknown = TiCfg::read_named("xwr18xx_AOP_profile_1.cfg", &at_77_ghz);
    assert!(
        unknown.errors[0]
            .to_string()
            .contains("xwr18xx_AOP, which the file is named after")
    );
    assert_eq!(unknown.points.unwrap().name, "xwr18xx_AOP");
}

#[test]
fn geometries_are_compared_within_their_band() {
    // Columns and rows of the 1843 board, which those of the 6843 ISK equal.
    let geometry = "antGeometry0 0 -1 -2 -3 -2 -3 -4 -5 -4 -5 -6 -7\nantGeometry1 -1 -1 -1 -1 0 0 0 0 -1 -1 -1 -1\n";
    let board = |text: &str| {
        TiCfg::parse(&format!("{geometry}{text}"), None)
            .unwrap()
            .board
    };
    assert_eq!(board(SIMPLE), Board::Xwr6843Isk);
    let at_77_ghz = SIMPLE.replace("0 60.5", "0 77");
    assert_eq!(board(&at_77_ghz), Board::Xwr1843Boost);
    let named = format!("% Platform:xWR14xx\n{at_77_ghz}");
    assert_eq!(board(&named), Board::Xwr1443Boost);
}

#[test]
fn lint_recognises_dialects() {
    let rules = |text: &str| -> Vec<(&str, Severity)> {
        let findings = lint_ti_cfg(text, None);
        let mut rows: Vec<_> = findings.iter().map(|f| (f.rule, f.severity)).collect();
        rows.sort_unstable();
        rows
    };
    for text in [ADVANCED, RETENTION, MCU_PLUS, BURSTS, MANY] {
        let rows = rules(text);
        assert!(rows.iter().all(|row| row.1 != Severity::Error), "{rows:?}");
        assert!(
            rows.contains(&("unsupported", Severity::Warning)),
            "{rows:?}"
        );
        let is_simple = text == RETENTION;
        assert_eq!(
            rows.contains(&("dialect", Severity::Note)),
            !is_simple,
            "{rows:?}"
        );
        // A file that enables raw samples asks for what cannot be read.
        let raw = rules(&format!("{text}lvdsStreamCfg -1 0 1 0\n"));
        let is_low_power = [BURSTS, MANY].contains(&text);
        assert_eq!(
            raw.contains(&("unsupported", Severity::Error)),
            !is_low_power,
            "{raw:?}"
        );
    }
    // 250 us from loop to loop at 59.2 GHz are 5.06 m/s; 0.21 m/s a bin; 7.8 cm; 8 frames/s.
    assert_eq!(
        rules(BURSTS),
        [
            ("dialect", Severity::Note),
            ("unsupported", Severity::Warning)
        ]
    );
    let slow = BURSTS.replace("2 0 250", "2 0 900");
    assert!(rules(&slow).contains(&("velocity-ambiguity", Severity::Warning)));
    assert!(
        rules(&BURSTS.replace(" 125 0", " 500 0")).contains(&("frame-rate", Severity::Warning))
    );
    let broken = rules(&ADVANCED.replace("subFrameCfg 1", "%"));
    assert!(
        broken.contains(&("undefined-subframe", Severity::Error)),
        "{broken:?}"
    );
    let guess = |findings: Vec<radarllm_formats::Finding>| {
        let found = findings.into_iter().find(|f| f.rule == "board-guessed");
        found.map(|f| f.message)
    };
    let family = format!("% Platform:xWR68xx\n{SIMPLE}");
    assert!(
        guess(lint_ti_cfg(&family, None))
            .unwrap()
            .contains("xWR68xx stands for boards")
    );
    assert!(
        guess(lint_ti_cfg(SIMPLE, None))
            .unwrap()
            .contains("no `% Platform:` line")
    );
    let named = lint_ti_cfg_named("xwr68xx_AOP_profile_1.cfg", SIMPLE, None);
    assert!(
        guess(named)
            .unwrap()
            .contains("the name of the file names the board")
    );
    let stated = format!("% Platform:xWR68xx_AOP\n{SIMPLE}");
    assert_eq!(guess(lint_ti_cfg(&stated, None)), None);
}

/// What holds of every reading.
fn check_reading(reading: &TiCfgReading, text: &str) {
    assert_eq!(reading.cfg.is_some(), reading.errors.is_empty(), "{text}");
    if let Some(points) = &reading.points {
        assert!((1e-5..=86_400.0).contains(&points.frame_period_s), "{text}");
        let figures = [
            points.carrier_hz,
            points.range_resolution_m,
            points.max_range_m,
            points.max_velocity_mps,
            points.velocity_resolution_mps,
        ];
        assert!(
            figures.iter().flatten().all(|v| *v > 0.0 && !v.is_nan()),
            "{points:?}"
        );
    }
    for radar in reading
        .cfg
        .iter()
        .map(|c| &c.radar)
        .chain(&reading.equivalent)
    {
        radar.validate().unwrap();
    }
}

/// Every prefix, every change of one byte and every hostile value gives a reading, never a panic.
#[test]
fn damaged_files_of_every_dialect_never_panic() {
    for text in ALL {
        for end in 0..text.len() {
            check_reading(&TiCfg::read(&text[..end], None), &text[..end]);
        }
        let mut bytes = text.as_bytes().to_vec();
        for i in 0..bytes.len() {
            for replacement in [b' ', b'-', b'9', b'e', b'\n', b'%', 0, 0xff] {
                let old = std::mem::replace(&mut bytes[i], replacement);
                let damaged = String::from_utf8_lossy(&bytes);
                check_reading(&TiCfg::read(&damaged, None), &damaged);
                bytes[i] = old;
            }
        }
        let words: Vec<&str> = text.split_inclusive([' ', '\n']).collect();
        for i in 0..words.len() {
            for value in [
                "0",
                "-1",
                "nan",
                "inf",
                "-inf",
                "1e308",
                "1e-308",
                "4294967295",
                "0xffffffff",
                "0.5",
                "",
            ] {
                let mut changed: Vec<String> = words.iter().map(|w| (*w).to_owned()).collect();
                let end = if changed[i].ends_with('\n') {
                    "\n"
                } else {
                    " "
                };
                changed[i] = format!("{value}{end}");
                let changed = changed.concat();
                check_reading(&TiCfg::read(&changed, None), &changed);
                for finding in lint_ti_cfg(&changed, None) {
                    let n_lines = changed.lines().count();
                    assert!(finding.span.is_none_or(|s| (1..=n_lines).contains(&s.line)));
                }
            }
        }
    }
}
