//! Detection on a Capon map.

use radarllm_base::{RadarConfig, RadarPoint};
use radarllm_radar_dsp::{
    CaponDetection, CaponScan, ClutterFilter, DspError, DspOptions, MapCfar, PointExtractor,
};

use crate::synthetic::{Target, cube};

fn options() -> DspOptions {
    DspOptions {
        capon: Some(CaponDetection {
            azimuth: CaponScan {
                limit_deg: 70.0,
                step_deg: 0.75,
                loading: 0.001,
            },
            elevation: Some(CaponScan {
                limit_deg: 20.0,
                step_deg: 1.5,
                loading: 0.03,
            }),
            range_cfar: MapCfar {
                skip: [4, 4],
                train: 8,
                guard: 4,
                threshold: 5.0,
            },
            azimuth_cfar: Some(MapCfar {
                skip: [2, 2],
                train: 12,
                guard: 8,
                threshold: 8.0,
            }),
            sidelobe: 0.4,
            angle_step_rad: 0.01,
        }),
        clutter: ClutterFilter::Mean,
        ..DspOptions::default()
    }
}

fn points(targets: &[Target]) -> Vec<RadarPoint> {
    let radar = RadarConfig::awr1843boost();
    let mut extractor = PointExtractor::new(&radar, options()).unwrap();
    extractor.extract(&cube(&radar, targets)).unwrap().points
}

#[test]
fn reflectors_are_where_they_are_and_as_fast_as_they_are() {
    for (range_m, azimuth_deg, elevation_deg, speed_mps) in [
        (2.0, 0.0, 0.0, 0.5),
        (3.0, 30.0, 9.0, -1.0),
        (4.5, -45.0, -12.0, 1.5),
    ] {
        let found = points(&[Target::radial(
            range_m,
            azimuth_deg,
            elevation_deg,
            speed_mps,
        )]);
        let point = found[0];
        let azimuth = f64::from(point.x_m)
            .atan2(f64::from(point.y_m))
            .to_degrees();
        let elevation = (f64::from(point.z_m) / f64::from(point.range_m))
            .asin()
            .to_degrees();
        // Half a range bin, a step of the scans and half a step of 0.01 rad, a Doppler bin.
        assert!(
            (f64::from(point.range_m) - range_m).abs() < 0.06,
            "{point:?}"
        );
        assert!(
            (azimuth - azimuth_deg).abs() < 1.5,
            "{azimuth} {azimuth_deg}"
        );
        assert!(
            (elevation - elevation_deg).abs() < 2.5,
            "{elevation} {elevation_deg}"
        );
        assert!(
            (f64::from(point.velocity_mps) - speed_mps).abs() < 0.1,
            "{point:?}"
        );
        // Angles are in steps of 0.01 rad.
        let steps = azimuth.to_radians() / 0.01;
        assert!((steps - steps.round()).abs() < 1e-3, "{steps}");
    }
}

#[test]
fn two_in_a_range_bin_are_two_points_and_who_stands_still_is_none() {
    let two = points(&[
        Target::radial(3.0, -12.0, 0.0, 0.9),
        Target::radial(3.0, 12.0, 0.0, -0.6),
    ]);
    let near = |azimuth_deg: f64, speed_mps: f64| {
        two.iter().any(|p| {
            let azimuth = f64::from(p.x_m).atan2(f64::from(p.y_m)).to_degrees();
            (azimuth - azimuth_deg).abs() < 2.0
                && (f64::from(p.velocity_mps) - speed_mps).abs() < 0.15
        })
    };
    assert!(near(-12.0, 0.9) && near(12.0, -0.6), "{two:?}");
    let still = points(&[Target::radial(3.0, 10.0, 0.0, 0.0)]);
    let there = |p: &&RadarPoint| (p.range_m - 3.0).abs() < 0.2;
    assert_eq!(still.iter().filter(there).count(), 0, "{still:?}");
}

#[test]
fn options_that_cannot_be_used_are_refused() {
    let with = |change: &dyn Fn(&mut CaponDetection)| {
        let mut options = options();
        change(options.capon.as_mut().unwrap());
        PointExtractor::new(&RadarConfig::awr1843boost(), options).map(|_| ())
    };
    assert_eq!(with(&|_| ()), Ok(()));
    for change in [
        &|c: &mut CaponDetection| c.azimuth.step_deg = 0.0,
        &|c: &mut CaponDetection| c.azimuth.limit_deg = f64::NAN,
        &|c: &mut CaponDetection| c.range_cfar.train = 0,
        &|c: &mut CaponDetection| c.range_cfar.threshold = -1.0,
        &|c: &mut CaponDetection| c.sidelobe = 1.5,
        &|c: &mut CaponDetection| c.angle_step_rad = f64::INFINITY,
    ] as [&dyn Fn(&mut CaponDetection); 6]
    {
        let refused = with(change);
        assert!(
            matches!(refused, Err(DspError::Option { field: "capon", .. })),
            "{refused:?}"
        );
    }
    let mut single = RadarConfig::awr1843boost();
    single.tx.truncate(1);
    single.rx.truncate(1);
    assert!(PointExtractor::new(&single, options()).is_err());
}
