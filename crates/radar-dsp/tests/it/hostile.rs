//! Bad cubes and options are refused by name.

use num_complex::Complex32;
use radarllm_base::{RadarConfig, RadarCube};
use radarllm_radar_dsp::{ClutterFilter, Detector, DspError, DspOptions, PointExtractor};

use crate::synthetic::small_radar;

#[test]
fn values_that_are_not_finite_are_named() {
    let radar = small_radar(16, 32);
    let mut extractor = PointExtractor::new(&radar, DspOptions::default()).unwrap();
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let mut cube = RadarCube::zeros(16, 3, 4, 32);
        // Loop 5, slot 2, receiver 1, sample 7.
        cube.data[((5 * 3 + 2) * 4 + 1) * 32 + 7] = Complex32::new(0.0, bad);
        let expected = DspError::NotFinite {
            index: [5, 2, 1, 7],
        };
        assert_eq!(extractor.extract(&cube).unwrap_err(), expected);
        assert_eq!(extractor.range_profile(&cube).unwrap_err(), expected);
    }
    let mut cube = RadarCube::zeros(16, 3, 4, 32);
    cube.time_s = f64::NAN;
    assert_eq!(extractor.extract(&cube).unwrap_err(), DspError::Time);
}

#[test]
fn powers_beyond_f32_are_an_error_and_not_infinite_points() {
    let radar = small_radar(16, 32);
    let mut extractor = PointExtractor::new(&radar, DspOptions::default()).unwrap();
    let mut cube = RadarCube::zeros(16, 3, 4, 32);
    cube.data[40] = Complex32::new(1e30, 0.0);
    assert!(matches!(
        extractor.extract(&cube),
        Err(DspError::Overflow { .. })
    ));
}

#[test]
fn shapes_are_checked_before_anything_is_read() {
    let radar = small_radar(16, 32);
    let mut extractor = PointExtractor::new(&radar, DspOptions::default()).unwrap();
    let error = extractor
        .extract(&RadarCube::zeros(16, 3, 4, 31))
        .unwrap_err();
    assert_eq!(
        error,
        DspError::Shape {
            expected: [16, 3, 4, 32],
            found: [16, 3, 4, 31]
        }
    );
    let mut short = RadarCube::zeros(16, 3, 4, 32);
    short.data.pop();
    let error = extractor.extract(&short).unwrap_err();
    assert!(
        matches!(
            error,
            DspError::Length {
                expected: 6144,
                found: 6143,
                ..
            }
        ),
        "{error}"
    );
}

#[test]
fn senseless_options_are_refused() {
    let radar = RadarConfig::awr1843boost();
    let ok = DspOptions::default;
    let cfar = |guard, train, pfa| Detector::CaCfar {
        guard,
        train,
        false_alarm_probability: pfa,
    };
    let os = |rank| Detector::OsCfar {
        guard: 2,
        train: 8,
        rank,
        false_alarm_probability: 1e-3,
    };
    for (field, options) in [
        (
            "min_range_m",
            DspOptions {
                min_range_m: f64::NAN,
                ..ok()
            },
        ),
        (
            "min_range_m",
            DspOptions {
                min_range_m: 5.0,
                max_range_m: 4.0,
                ..ok()
            },
        ),
        (
            "max_range_m",
            DspOptions {
                max_range_m: -1.0,
                ..ok()
            },
        ),
        (
            "max_points",
            DspOptions {
                max_points: 0,
                ..ok()
            },
        ),
        (
            "dynamic_range_db",
            DspOptions {
                dynamic_range_db: Some(f64::NAN),
                ..ok()
            },
        ),
        (
            "false_alarms_per_frame",
            DspOptions {
                detector: Detector::NoiseFloor {
                    false_alarms_per_frame: 0.0,
                },
                ..ok()
            },
        ),
        (
            "train",
            DspOptions {
                detector: cfar(2, 0, 1e-3),
                ..ok()
            },
        ),
        (
            "train",
            DspOptions {
                detector: cfar(usize::MAX, 8, 1e-3),
                ..ok()
            },
        ),
        (
            "false_alarm_probability",
            DspOptions {
                detector: cfar(2, 8, f64::NAN),
                ..ok()
            },
        ),
        (
            "rank",
            DspOptions {
                detector: os(0.0),
                ..ok()
            },
        ),
    ] {
        match PointExtractor::new(&radar, options) {
            Err(DspError::Option { field: found, .. }) => assert_eq!(found, field),
            other => panic!("{field}: {:?}", other.err()),
        }
    }
    let one_loop = RadarConfig {
        n_loops: 1,
        ..radar.clone()
    };
    assert!(PointExtractor::new(&one_loop, ok()).is_err());
    let options = DspOptions {
        clutter: ClutterFilter::Off,
        ..ok()
    };
    assert!(PointExtractor::new(&one_loop, options).is_ok());
    let impossible = RadarConfig {
        n_samples: 0,
        ..radar
    };
    assert!(matches!(
        PointExtractor::new(&impossible, ok()),
        Err(DspError::Radar(_))
    ));
}
