//! How many points, and which.

use radarllm_base::{RadarConfig, RadarCube};
use radarllm_radar_dsp::detect::Selector;
use radarllm_radar_dsp::{
    CfarSides, ClutterFilter, Detector, DopplerCfar, DspError, DspOptions, ImpossibleDirection,
    MapKind, PeakGrouping, PointExtractor,
};

use crate::synthetic::{Random, Target, add_noise, cube};

fn noise_cube(radar: &RadarConfig, random: &mut Random) -> RadarCube {
    let mut cube = RadarCube::zeros(
        radar.n_loops,
        radar.tx.len(),
        radar.rx.len(),
        radar.n_samples,
    );
    add_noise(&mut cube, 1.0, random);
    cube
}

#[test]
fn empty_frames_yield_the_designed_number_of_points() {
    let radar = RadarConfig::awr1843boost();
    let mut random = Random(7);
    let cubes: Vec<_> = (0..12).map(|_| noise_cube(&radar, &mut random)).collect();
    // Clamp so that cells with impossible directions are counted too.
    let options = |map, false_alarms_per_frame| DspOptions {
        map,
        detector: Detector::NoiseFloor {
            false_alarms_per_frame,
        },
        max_points: 10_000,
        impossible_direction: ImpossibleDirection::Clamp,
        ..DspOptions::default()
    };
    for (map, design) in [
        (MapKind::NonCoherent, 20.0),
        (MapKind::Coherent, 20.0),
        (MapKind::NonCoherent, 1.0),
    ] {
        let mut extractor = PointExtractor::new(&radar, options(map, design)).unwrap();
        let n: usize = cubes
            .iter()
            .map(|c| extractor.extract(c).unwrap().points.len())
            .sum();
        let expected = 12.0 * design;
        // Neighbouring cells share noise (Hamming), so false alarms come in clusters of up to about
        // two: four standard deviations of a doubled Poisson variance.
        let tolerance = 4.0 * (2.0 * expected).sqrt();
        assert!(
            (n as f64 - expected).abs() < tolerance,
            "{map:?}: {n} for {expected}"
        );
    }
    // The floor per cell and channel: sum of the squared windows times unit noise power.
    let mut extractor = PointExtractor::new(&radar, DspOptions::default()).unwrap();
    extractor.extract(&cubes[0]).unwrap();
    let energy = |n| {
        radarllm_radar_dsp::Window::Hamming
            .weights(n)
            .iter()
            .map(|w| f64::from(w * w))
            .sum::<f64>()
    };
    let floor = f64::from(extractor.noise_floor().unwrap()) / (energy(256) * energy(128));
    // The median of 30,000 cells of Gamma(12) is known to about 0.3 %.
    assert!((floor - 1.0).abs() < 0.02, "{floor}");
}

/// On independent cells the counts follow Poisson's law exactly.
#[test]
fn every_detector_keeps_its_false_alarm_rate() {
    let (n_range, n_doppler, n_channels) = (200, 100, 12);
    let mut random = Random(11);
    let pfa = 2e-3;
    for detector in [
        Detector::NoiseFloor {
            false_alarms_per_frame: pfa * 20_000.0,
        },
        Detector::CaCfar {
            guard: 2,
            train: 8,
            false_alarm_probability: pfa,
        },
        Detector::OsCfar {
            guard: 2,
            train: 8,
            rank: 0.75,
            false_alarm_probability: pfa,
        },
    ] {
        let options = DspOptions {
            detector,
            clutter: ClutterFilter::Off,
            ..DspOptions::default()
        };
        let mut selector = Selector::new(n_range, n_doppler, n_channels, &options).unwrap();
        let mut n = 0;
        for _ in 0..10 {
            let map: Vec<f32> = (0..n_range * n_doppler)
                .map(|_| -(0..n_channels).map(|_| random.uniform().ln()).sum::<f64>() as f32)
                .collect();
            n += selector.select(&map).len();
        }
        // 400 expected, standard deviation 20; CFAR thresholds shared by neighbours add a little.
        assert!((n as f64 - 400.0).abs() < 100.0, "{detector:?}: {n}");
    }
}

#[test]
fn two_targets_are_resolved_in_range_and_in_velocity() {
    let radar = RadarConfig::awr1843boost();
    let options = DspOptions {
        peak_grouping: PeakGrouping::Both,
        dynamic_range_db: Some(20.0),
        ..DspOptions::default()
    };
    let mut extractor = PointExtractor::new(&radar, options).unwrap();
    // Four bins apart: main lobes of a Hamming window are four bins wide from null to null.
    let pairs = [
        [
            Target::radial(3.0, 0.0, 0.0, 1.0),
            Target::radial(3.0 + 4.0 * 0.0429, 15.0, 0.0, 1.0),
        ],
        [
            Target::radial(3.0, 0.0, 0.0, 1.0),
            Target::radial(3.0, 15.0, 0.0, 1.0 + 4.0 * 0.0685),
        ],
    ];
    for pair in pairs {
        let mut cube = cube(&radar, &pair);
        add_noise(&mut cube, 0.01, &mut Random(3));
        let points = extractor.extract(&cube).unwrap().points;
        assert_eq!(points.len(), 2, "{points:?}");
        let mut azimuths: Vec<_> = points
            .iter()
            .map(|p| p.x_m.atan2(p.y_m).to_degrees())
            .collect();
        azimuths.sort_by(f32::total_cmp);
        // Leakage of the other target four bins away is under -40 dB: 0.01 rad of phase, 0.3 degrees.
        assert!(
            azimuths[0].abs() < 0.5 && (azimuths[1] - 15.0).abs() < 0.5,
            "{azimuths:?}"
        );
    }
}

#[test]
fn sidelobes_do_not_fill_the_frame() {
    let radar = RadarConfig::awr1843boost();
    let mut cube = cube(&radar, &[Target::radial(3.0, 0.0, 0.0, 1.0)]);
    add_noise(&mut cube, 1e-4, &mut Random(5));
    let points = |options| {
        PointExtractor::new(&radar, options)
            .unwrap()
            .extract(&cube)
            .unwrap()
            .points
    };
    let near = |p: &radarllm_base::RadarPoint| {
        (p.range_m - 3.014).abs() < 0.13 && (p.velocity_mps - 1.0).abs() < 0.21
    };
    let weighted = DspOptions {
        clutter: ClutterFilter::WeightedMean,
        ..DspOptions::default()
    };
    let limited = points(weighted);
    // A Hamming main lobe is within two bins of the peak each way: at most 5 x 5 cells.
    assert!(
        limited.len() <= 25 && limited.iter().all(near),
        "{}",
        limited.len()
    );
    // The plain mean adds the documented ghost at zero velocity, and nothing else.
    let ghost = |p: &radarllm_base::RadarPoint| p.velocity_mps.abs() < 0.1;
    let limited = points(DspOptions::default());
    assert!(limited.iter().all(|p| near(p) || ghost(p)));
    let ghost_db =
        limited.iter().find(|p| ghost(p)).unwrap().intensity_db - limited[0].intensity_db;
    // 1 / (14.6 pi) is -33.2 dB, times |sin(14.6 pi)| = 0.95: -33.7; half a bin of scalloping.
    assert!((ghost_db + 33.7).abs() < 2.0, "{ghost_db}");
    assert_eq!(
        points(DspOptions {
            dynamic_range_db: None,
            ..DspOptions::default()
        })
        .len(),
        128
    );
}

#[test]
fn mmmesh_mode_always_returns_128_points() {
    let radar = RadarConfig::awr1843boost();
    let options = DspOptions {
        impossible_direction: ImpossibleDirection::Clamp,
        ..DspOptions::mmmesh()
    };
    let mut extractor = PointExtractor::new(&radar, options).unwrap();
    let frame = extractor
        .extract(&noise_cube(&radar, &mut Random(1)))
        .unwrap();
    assert_eq!(frame.points.len(), 128);
    assert!(
        frame
            .points
            .windows(2)
            .all(|w| w[0].intensity_db >= w[1].intensity_db)
    );
}

/// The coherent map is a beam at boresight: radar.md's figures, the closed form of the 12 virtual
/// elements (8 in the row, 4 raised at 2..5).
#[test]
fn coherent_map_is_a_boresight_beam() {
    let radar = RadarConfig::awr1843boost();
    let ratio = radar.carrier_hz() / 77e9;
    let power_at = |azimuth_deg: f64| {
        let mut extractor = PointExtractor::new(&radar, DspOptions::mmmesh()).unwrap();
        // A whole number of Doppler bins is far enough; speed small so that slots stay in phase.
        let target = Target::radial(3.0, azimuth_deg, 0.0, 0.15);
        let values = extractor
            .range_doppler_map(&cube(&radar, &[target]))
            .unwrap()
            .values;
        f64::from(values.into_iter().fold(0.0, f32::max))
    };
    let boresight = power_at(0.0);
    for azimuth_deg in [10.0_f64, 14.5] {
        let step = std::f64::consts::PI * ratio * azimuth_deg.to_radians().sin();
        let sum: num_complex::Complex64 = (0..8)
            .chain(2..6)
            .map(|i| num_complex::Complex64::cis(-step * f64::from(i)))
            .sum();
        let expected_db = 20.0 * (sum.norm() / 12.0).log10();
        let found_db = 10.0 * (power_at(azimuth_deg) / boresight).log10();
        // Range and Doppler scalloping differ slightly by angle; slots dephase by 0.1 rad.
        assert!(
            (found_db - expected_db).abs() < 0.6,
            "{azimuth_deg}: {found_db} for {expected_db}"
        );
    }
}

fn ti_like(map: MapKind) -> DspOptions {
    DspOptions {
        map,
        detector: Detector::AlwaysTopK,
        dynamic_range_db: None,
        max_points: 1,
        ..DspOptions::default()
    }
}

/// Equal power in all 12 channels: the mean of logarithms is one channel's power, the sum twelve.
#[test]
fn the_mean_of_logarithms_is_the_sum_less_the_number_of_channels() {
    let radar = RadarConfig::awr1843boost();
    let target = Target::radial(3.0, 8.0, 2.0, 1.0);
    let cube = cube(&radar, &[target]);
    let strongest = |map| {
        let mut extractor = PointExtractor::new(&radar, ti_like(map)).unwrap();
        extractor.extract(&cube).unwrap().points[0]
    };
    let (sum, mean) = (strongest(MapKind::NonCoherent), strongest(MapKind::MeanLog));
    // f32 logarithms; channels differ by what the target moves between slots, under 0.01 dB.
    let difference = sum.intensity_db - mean.intensity_db - 10.0 * 12_f32.log10();
    assert!(difference.abs() < 0.02, "{difference}");
    assert_eq!(sum.range_m, mean.range_m);
    // Thresholds of the other detectors hold for sums of powers.
    let wrong = DspOptions {
        map: MapKind::MeanLog,
        ..DspOptions::default()
    };
    assert!(PointExtractor::new(&radar, wrong).is_err());
}

/// 256 samples padded to 1,024: a target between two bins of the plain transform stands within half
/// a bin of the fine one, and every range is a multiple of a quarter of the resolution.
#[test]
fn a_padded_range_transform_has_closer_bins() {
    let radar = RadarConfig::awr1843boost();
    let step_m = radar.range_resolution_m() / 4.0;
    // The plain transform would put it 0.3 bins off, more than a fine bin.
    let y_m = 70.3 * radar.range_resolution_m();
    let options = DspOptions {
        range_fft_len: Some(1024),
        clutter: ClutterFilter::Off,
        ..ti_like(MapKind::NonCoherent)
    };
    let mut extractor = PointExtractor::new(&radar, options).unwrap();
    let target = Target::radial(y_m, 0.0, 0.0, 0.0);
    let range_m = f64::from(extractor.extract(&cube(&radar, &[target])).unwrap().points[0].range_m);
    assert!((range_m - y_m).abs() < 0.51 * step_m, "{range_m} for {y_m}");
    let bins = range_m / step_m;
    assert!((bins - bins.round()).abs() < 1e-3, "{bins}");
    for range_fft_len in [Some(255), Some(usize::MAX)] {
        let options = DspOptions {
            range_fft_len,
            ..DspOptions::default()
        };
        assert!(PointExtractor::new(&radar, options).is_err());
    }
}

/// A column of ones with two cells of e^5, four apart: each lies among the other's training cells.
#[test]
fn the_smaller_side_of_a_log_cfar_is_not_masked_by_a_neighbour() {
    let mut map = vec![1.0_f32; 64];
    map[30] = 5_f32.exp();
    map[34] = 5_f32.exp();
    let found = |sides, threshold_db: f64| {
        let options = DspOptions {
            detector: Detector::LogCfar {
                guard: 1,
                train: 4,
                sides,
                threshold_db,
            },
            dynamic_range_db: None,
            ..DspOptions::default()
        };
        let mut selector = Selector::new(64, 1, 12, &options).unwrap();
        let mut cells = selector.select(&map).to_vec();
        cells.sort_unstable();
        cells
    };
    // A neighbour among four training cells lifts that side's mean to 5/4, both sides' to 5/8; the
    // margin is 5, 3.75 and 4.375 nepers of power for smaller, greater and both.
    let db = |nepers: f64| nepers * 10.0 / std::f64::consts::LN_10;
    for (sides, margin) in [
        (CfarSides::Smaller, 5.0),
        (CfarSides::Greater, 3.75),
        (CfarSides::Both, 4.375),
    ] {
        assert_eq!(found(sides, db(margin - 0.01)), [30, 34], "{sides:?}");
        assert!(found(sides, db(margin + 0.01)).is_empty(), "{sides:?}");
    }
}

/// A 5 x 4 map, range by Doppler, of which every cell passes the threshold.
#[test]
fn peak_grouping_keeps_the_tops_in_the_direction_asked_for() {
    #[rustfmt::skip]
    let map = [
        5.0, 1.0, 1.0, 4.0,
        1.0, 1.0, 1.0, 1.5,
        1.0, 2.0, 3.0, 1.0,
        1.0, 1.0, 1.2, 1.0,
        1.1, 1.0, 1.0, 1.0_f32,
    ];
    let kept = |peak_grouping| {
        let options = DspOptions {
            detector: Detector::AlwaysTopK,
            peak_grouping,
            ..DspOptions::default()
        };
        let mut cells = Selector::new(5, 4, 12, &options)
            .unwrap()
            .select(&map)
            .to_vec();
        cells.sort_unstable();
        cells
    };
    assert_eq!(kept(PeakGrouping::Off).len(), 20);
    // Row by row, the last column next to the first; equal neighbours both stay.
    assert_eq!(kept(PeakGrouping::Doppler), [0, 5, 7, 10, 12, 14, 16, 18]);
    // Column by column.
    assert_eq!(
        kept(PeakGrouping::Range),
        [0, 1, 2, 3, 8, 9, 10, 15, 16, 17, 19]
    );
    // All eight: 7 lies beside 0 across the edge of the columns, 14 below 10.
    assert_eq!(kept(PeakGrouping::Both), [0, 10, 16]);
}

/// 3 x 16 maps, range by Doppler: the second pass is cyclic, compares with the mean of both sides in decibels, and rejects
/// what is as wide as its window.
#[test]
fn the_second_pass_along_doppler_masks_extended_targets() {
    let select = |map: &[f32], doppler_cfar| {
        let options = DspOptions {
            detector: Detector::AlwaysTopK,
            doppler_cfar: Some(doppler_cfar),
            ..DspOptions::default()
        };
        let mut selector = Selector::new(3, 16, 12, &options)?;
        let mut cells = selector.select(map).to_vec();
        cells.sort_unstable();
        Ok::<_, DspError>(cells)
    };
    let cfar = DopplerCfar {
        guard: 2,
        train: 4,
        threshold_db: 15.0,
    };
    let mut map = [1.0_f32; 48];
    // 15.1 and 14.9 dB above the floor, at the edge of the row and in another row.
    map[0] = 10_f32.powf(1.51);
    map[16 + 8] = 10_f32.powf(1.49);
    // A person over twelve bins, 40 dB above the floor. The training cells hold the person, too: only where all four of
    // one side are free is the mean below 25 dB.
    map[32..44].fill(10_f32.powf(4.0));
    assert_eq!(select(&map, cfar).unwrap(), [0, 34, 41]);
    // One strong training cell of eight raises the mean of the decibels by an eighth of its level.
    let level_db = |db: f32| 10_f32.powf(db / 10.0);
    let mut map = [1.0_f32; 48];
    map[0] = level_db(19.9);
    map[13] = level_db(40.0);
    assert_eq!(select(&map, cfar).unwrap(), [13]);
    map[0] = level_db(20.1);
    assert_eq!(select(&map, cfar).unwrap(), [0, 13]);

    for wrong in [
        DopplerCfar { train: 0, ..cfar },
        DopplerCfar { train: 6, ..cfar },
        DopplerCfar {
            guard: usize::MAX,
            ..cfar
        },
        DopplerCfar {
            threshold_db: f64::NAN,
            ..cfar
        },
    ] {
        let error = select(&map, wrong).unwrap_err().to_string();
        assert!(error.contains("doppler_cfar"), "{error}");
    }
}
