//! All chirp files at hand, with the figures worked out by hand from their numbers.

use std::path::PathBuf;

use radarllm_formats::{Board, BoardEvidence, SensorPosition, TiCfg};

pub fn shared() -> Option<PathBuf> {
    let path = std::env::var_os("RADARLLM_SHARED").map_or_else(
        || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared"),
        PathBuf::from,
    );
    path.is_dir().then_some(path)
}

/// (file, board, transmitters in firing order, receivers, loops, samples, range resolution in m).
///
/// Range resolution is c * rate / (2 * slope * samples): for the first, 299792458 * 12.5e6 / (2 * 20e12 *
/// 256) = 0.3660 m.
type Row = (&'static str, Board, &'static [u8], usize, usize, usize, f64);

const FILES: [Row; 21] = [
    (
        "18xx_traffic_monitoring_70m_MIMO_2D",
        Board::Xwr1843Boost,
        &[1, 3],
        4,
        64,
        256,
        0.3660,
    ),
    (
        "18xx_traffic_monitoring_70m_MIMO_3D",
        Board::Xwr1843Boost,
        &[1, 3, 2],
        4,
        40,
        256,
        0.3660,
    ),
    (
        "68xx_traffic_monitoring_70m_MIMO_3D",
        Board::Xwr6843Isk,
        &[1, 3, 2],
        4,
        40,
        256,
        0.3660,
    ),
    (
        "AOP_6m_default",
        Board::Xwr6843Aop,
        &[1, 2, 3],
        4,
        96,
        96,
        0.0842,
    ),
    (
        "ISK_6m_default",
        Board::Xwr6843Isk,
        &[1, 2, 3],
        4,
        96,
        96,
        0.0842,
    ),
    (
        "ODS_6m_default",
        Board::Xwr6843IskOds,
        &[1, 2, 3],
        4,
        96,
        96,
        0.0842,
    ),
    (
        "area_scanner_68xx_ISK",
        Board::Xwr6843Isk,
        &[1, 3, 2],
        4,
        32,
        256,
        0.0703,
    ),
    (
        "gesture_LRswipes_6443",
        Board::Xwr6843Isk,
        &[1, 2, 3],
        4,
        32,
        96,
        0.0451,
    ),
    (
        "high_accuracy_demo_14xx",
        Board::Xwr1843Boost,
        &[1],
        1,
        1,
        1024,
        0.0400,
    ),
    (
        "high_accuracy_demo_16xx",
        Board::Xwr1843Boost,
        &[1],
        1,
        10,
        512,
        0.0434,
    ),
    (
        "high_accuracy_demo_68xx",
        Board::Xwr6843Isk,
        &[1],
        1,
        10,
        512,
        0.0434,
    ),
    (
        "pc_6843_3d_aop_overhead_3m_radial",
        Board::Xwr6843Aop,
        &[1, 2, 3],
        4,
        224,
        64,
        0.0848,
    ),
    (
        "people_detection_and_tracking_50m_3D",
        Board::Xwr6843Isk,
        &[1, 3, 2],
        4,
        96,
        125,
        0.4996,
    ),
    (
        "profile_2d_VitalSigns_20fps",
        Board::Xwr1642Boost,
        &[1],
        4,
        2,
        200,
        0.0428,
    ),
    (
        "profile_3d_automated_doors_AOP",
        Board::Xwr6843Isk,
        &[1, 2, 3],
        4,
        32,
        256,
        0.0703,
    ),
    (
        "profile_3d_automated_doors_ISK",
        Board::Xwr6843Isk,
        &[1, 3, 2],
        4,
        32,
        256,
        0.0703,
    ),
    (
        "sense_and_direct_68xx",
        Board::Xwr6843Isk,
        &[1, 3],
        4,
        128,
        128,
        0.0898,
    ),
    (
        "xwr1642_profile_VitalSigns_20fps_Front",
        Board::Xwr6843Isk,
        &[1],
        4,
        2,
        200,
        0.0461,
    ),
    (
        "1843RangeDoppler",
        Board::Xwr1843Boost,
        &[1, 3, 2],
        4,
        16,
        96,
        0.0441,
    ),
    (
        "AWR1843config",
        Board::Xwr1843Boost,
        &[1, 3],
        4,
        16,
        256,
        0.0436,
    ),
    (
        "gesture_profile_1443_1642",
        Board::Xwr1642Boost,
        &[1, 2],
        4,
        16,
        384,
        0.0390,
    ),
];

/// Height, m, and elevation tilt, degrees, of the files that state them.
const POSITIONS: [(&str, f64, f64); 9] = [
    ("18xx_traffic_monitoring_70m_MIMO_2D", 2.0, 0.0),
    ("18xx_traffic_monitoring_70m_MIMO_3D", 2.0, 0.0),
    ("68xx_traffic_monitoring_70m_MIMO_3D", 2.0, 0.0),
    ("AOP_6m_default", 2.0, 15.0),
    ("ISK_6m_default", 2.0, 15.0),
    ("ODS_6m_default", 2.0, 15.0),
    ("gesture_LRswipes_6443", 0.0, 0.0),
    ("pc_6843_3d_aop_overhead_3m_radial", 2.9, 90.0),
    ("people_detection_and_tracking_50m_3D", 2.0, 0.0),
];

#[test]
fn every_file_is_read_with_its_own_figures() {
    let Some(shared) = shared() else {
        println!("skipped: no shared data");
        return;
    };
    let mut n_found = 0;
    for folder in ["data/ti-mmwave-toolbox/cfg", "data/cfg-other"] {
        for entry in std::fs::read_dir(shared.join(folder)).unwrap() {
            let path = entry.unwrap().path();
            let name = path.file_stem().unwrap().to_str().unwrap().to_owned();
            let row = FILES
                .iter()
                .find(|f| f.0 == name)
                .unwrap_or_else(|| panic!("unknown {name}"));
            let &(_, board, slots, n_rx, n_loops, n_samples, bin_m) = row;
            let text = std::fs::read_to_string(&path).unwrap();
            let cfg = TiCfg::parse(&text, None).unwrap_or_else(|e| panic!("{name}: {e}"));
            assert_eq!(cfg.board, board, "{name}");
            assert_eq!(cfg.slots, slots, "{name}");
            let position = SensorPosition::from_ti_cfg(&text).unwrap();
            let row = POSITIONS.iter().find(|(file, ..)| *file == name);
            assert_eq!(
                position.map(|p| (p.height_m, p.elevation_tilt_rad.to_degrees().round())),
                row.map(|(_, height_m, tilt_deg)| (*height_m, *tilt_deg)),
                "{name}"
            );
            assert!(position.is_none_or(|p| p.azimuth_tilt_rad == 0.0), "{name}");
            let r = &cfg.radar;
            assert_eq!(
                (r.rx.len(), r.n_loops, r.n_samples),
                (n_rx, n_loops, n_samples),
                "{name}"
            );
            // Expected values are rounded to four decimals.
            assert!(
                (r.range_resolution_m() - bin_m).abs() < 6e-5,
                "{name}: {}",
                r.range_resolution_m()
            );
            n_found += 1;
        }
    }
    assert_eq!(n_found, FILES.len());
}

#[test]
fn people_counting_files_state_board_and_power() {
    let Some(shared) = shared() else {
        println!("skipped: no shared data");
        return;
    };
    for (file, board, power_dbm) in [
        // Back-off 394758 = 0x060606: 6 dB each; 657930 = 0x0a0a0a: 10 dB.
        ("AOP_6m_default", Board::Xwr6843Aop, 6.0),
        ("ISK_6m_default", Board::Xwr6843Isk, 2.0),
        ("ODS_6m_default", Board::Xwr6843IskOds, 2.0),
    ] {
        let path = shared.join(format!("data/ti-mmwave-toolbox/cfg/{file}.cfg"));
        let cfg = TiCfg::parse(&std::fs::read_to_string(path).unwrap(), None).unwrap();
        assert_eq!(cfg.board_evidence, BoardEvidence::Geometry, "{file}");
        assert_eq!(
            (cfg.board, cfg.radar.tx_power_dbm),
            (board, power_dbm),
            "{file}"
        );
        assert_eq!(cfg.phase_rotation.len(), 12, "{file}");
        let builtin = radarllm_formats::builtin_radar(board.name()).unwrap();
        assert_eq!(cfg.radar.tx, builtin.tx, "{file}");
        // Parsing 59.10 us and 59.1e-6 differ in the last bit.
        assert!(
            (cfg.radar.max_velocity_mps() - builtin.max_velocity_mps()).abs() < 1e-9,
            "{file}"
        );
    }
}
