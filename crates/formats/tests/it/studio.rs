//! Exports of mmWave Studio.

use radarllm_formats::{
    Board, TiCfg,
    adc::{IqOrder, LvdsLanes, SampleKind, SampleLayout, StudioCapture, StudioSetup},
};

/// The reference radar's chirps as mmWave Studio exports them: TX1, TX3, TX2.
pub const EXPORT: &str = include_str!("../data/awr1843.mmwave.json");

#[test]
fn an_export_is_the_radar_of_the_same_chirp_file() {
    let board = Some(Board::Xwr1843Boost);
    let export = StudioCapture::parse(EXPORT, board).unwrap();
    let cfg = "channelCfg 15 7 0\nadcCfg 2 1\nprofileCfg 0 77 7 6 65 0 0 60.012 1 256 4400 0 0 30\n\
        chirpCfg 0 0 0 0 0 0 0 1\nchirpCfg 1 1 0 0 0 0 0 4\nchirpCfg 2 2 0 0 0 0 0 2\nframeCfg 0 2 128 8 100 1 0\n";
    assert_eq!(export.radar, TiCfg::parse(cfg, board).unwrap().radar);
    // And that is the built-in one.
    let reference = radarllm_base::RadarConfig::awr1843boost();
    assert_eq!((export.radar.tx.len(), export.radar.n_loops), (3, 128));
    assert!((export.radar.carrier_hz() / reference.carrier_hz() - 1.0).abs() < 1e-9);
    assert_eq!(
        (export.adc_bits, export.n_frames, export.board_guessed),
        (16, 8, false)
    );
    let layout = SampleLayout {
        lanes: LvdsLanes::Two,
        data: SampleKind::Complex {
            order: IqOrder::IFirst,
        },
    };
    assert_eq!(export.layout, Some(layout));
}

#[test]
fn lanes_order_and_kind_follow_the_export() {
    let layout = |changes: &[(&str, &str)]| {
        let mut text = EXPORT.to_string();
        for (from, to) in changes {
            assert!(text.contains(from), "{from}");
            text = text.replace(from, to);
        }
        StudioCapture::parse(&text, Some(Board::Xwr1443Boost)).map(|e| e.layout.unwrap())
    };
    let four = [
        ("\"laneEn\": \"0x3\"", "\"laneEn\": 15"),
        ("\"chInterleave\": 1", "\"chInterleave\": \"0x0\""),
    ];
    let swapped = [
        four[0],
        four[1],
        ("\"iqSwapSel\": 0", "\"iqSwapSel\": 1"),
        ("\"0xF\"", "\"0xB\""),
    ];
    let found = layout(&swapped).unwrap();
    assert_eq!(found.lanes, LvdsLanes::Four { receivers: 0b1011 });
    let q_first = SampleKind::Complex {
        order: IqOrder::QFirst,
    };
    assert_eq!(found.data, q_first);
    let real = layout(&[("\"b2AdcOutFmt\": 1", "\"b2AdcOutFmt\": 0")]).unwrap();
    assert_eq!(real.data, SampleKind::Real);
    let path = |changes: &[(&str, &str)]| layout(changes).unwrap_err().path;
    assert!(path(&four[..1]).ends_with("rlDevLaneEnable_t"));
    assert!(
        path(&[(
            "\"transferFmtPkt0\": \"0x1\"",
            "\"transferFmtPkt0\": \"0x6\""
        )])
        .ends_with("transferFmtPkt0")
    );
}

#[test]
fn mistakes_are_named_with_their_place() {
    let error = |from: &str, to: &str| {
        assert!(EXPORT.contains(from), "{from}");
        StudioCapture::parse(&EXPORT.replace(from, to), None).unwrap_err()
    };
    for (from, to, path, problem) in [
        (
            "\"numLoops\": 128",
            "\"numLoops\": 300",
            "mmWaveDevices[0].rfConfig.rlFrameCfg_t",
            "`300`: loops",
        ),
        (
            "\"numLoops\": 128, ",
            "",
            "mmWaveDevices[0].rfConfig.rlFrameCfg_t",
            "`numLoops` is missing",
        ),
        (
            "\"txEnable\": \"0x4\"",
            "\"txEnable\": \"0x6\"",
            "mmWaveDevices[0].rfConfig.rlChirps[1].rlChirpCfg_t",
            "`6`",
        ),
        (
            "\"profileId\": 0, \"startFreqC",
            "\"profileId\": true, \"startFreqC",
            "mmWaveDevices[0].rfConfig.rlProfiles[0].rlProfileCfg_t.profileId",
            "must be a number",
        ),
        (
            "\"rampEndTime_usec\": 65.0",
            "\"rampEndTime_usec\": 60.0",
            "mmWaveDevices[0].rfConfig",
            "after the ramp's end",
        ),
        (
            "legacyFrameChirp",
            "advFrameChirp",
            "mmWaveDevices[0].rfConfig.waveformType",
            "legacyFrameChirp",
        ),
        (
            "\"rlBpmChirps\": []",
            "\"rlBpmChirps\": [1]",
            "mmWaveDevices[0].rfConfig.rlBpmChirps",
            "not supported",
        ),
    ] {
        let found = error(from, to);
        assert_eq!(found.path, path, "{found}");
        assert!(found.problem.contains(problem), "{found}");
    }
    assert_eq!(
        StudioCapture::parse("{", None).unwrap_err().path,
        "document"
    );
}

#[test]
fn a_setup_names_device_and_files() {
    let text = r#"{"captureHardware": "DCA1000", "mmWaveDevice": "awr1843", "configUsed": "C:\\radar\\test.mmwave.json",
        "DCA1000Config": {"dataLoggingMode": "raw"},
        "capturedFiles": {"fileBasePath": "C:\\radar", "files": [
            {"processedFileName": "adc_data.bin", "rawFileName": "D:/x/adc_data_Raw_0.bin"}]}}"#;
    let setup = StudioSetup::parse(text).unwrap();
    assert_eq!(setup.board, Some(Board::Xwr1843Boost));
    assert_eq!(setup.config.as_deref(), Some("test.mmwave.json"));
    assert_eq!(
        (setup.processed, setup.raw),
        (
            vec!["adc_data.bin".into()],
            vec!["adc_data_Raw_0.bin".into()]
        )
    );
    let multi = StudioSetup::parse(&text.replace("\"raw\"}", "\"multi\"}")).unwrap_err();
    assert_eq!(multi.path, "DCA1000Config.dataLoggingMode");
    assert!(StudioSetup::parse("{}").is_err());
}
