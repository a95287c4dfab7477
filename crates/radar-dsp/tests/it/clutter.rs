//! Static clutter goes, movers stay, whatever their angle.

use radarllm_base::RadarConfig;
use radarllm_radar_dsp::{ClutterFilter, DspOptions, PointExtractor};

use crate::synthetic::{Target, cube};

const FILTERS: [ClutterFilter; 2] = [ClutterFilter::Mean, ClutterFilter::WeightedMean];

fn map(radar: &RadarConfig, clutter: ClutterFilter, targets: &[Target]) -> Vec<f32> {
    let options = DspOptions {
        clutter,
        ..DspOptions::default()
    };
    let mut extractor = PointExtractor::new(radar, options).unwrap();
    extractor
        .range_doppler_map(&cube(radar, targets))
        .unwrap()
        .values
}

#[test]
fn static_targets_vanish() {
    let radar = RadarConfig::awr1843boost();
    let peak = |values: Vec<f32>| values.into_iter().fold(0.0, f32::max);
    for azimuth_deg in [0.0, 35.0] {
        let target = [Target::radial(3.0, azimuth_deg, 0.0, 0.0)];
        let unfiltered = peak(map(&radar, ClutterFilter::Off, &target));
        for filter in FILTERS {
            let loss_db = 10.0 * (unfiltered / peak(map(&radar, filter, &target))).log10();
            // Removal is exact; f32 rounding leaves about (2^-24)^2 of the power, -140 dB. The
            // promise is 40 dB.
            assert!(loss_db > 100.0, "{filter:?} at {azimuth_deg}: {loss_db} dB");
        }
    }
}

#[test]
fn movers_keep_their_power_at_every_angle() {
    let radar = RadarConfig::awr1843boost();
    for azimuth_deg in [-45.0, -14.5, 0.0, 20.0, 60.0] {
        let target = [Target::radial(3.0, azimuth_deg, 0.0, 0.9)];
        let without = map(&radar, ClutterFilter::Off, &target);
        let cell = (0..without.len())
            .max_by(|&a, &b| without[a].total_cmp(&without[b]))
            .unwrap();
        for filter in FILTERS {
            let loss_db = 10.0 * (without[cell] / map(&radar, filter, &target)[cell]).log10();
            // The mean of 13 turns over the frame is at most 1 / (13 pi) of the amplitude, and the
            // window keeps under 1 % of that in the mover's own bin.
            assert!(
                loss_db.abs() < 0.01,
                "{filter:?} at {azimuth_deg}: {loss_db} dB"
            );
        }
    }
}

#[test]
fn a_mover_beside_strong_clutter_is_found() {
    let radar = RadarConfig::awr1843boost();
    let wall = Target::radial(3.0, 5.0, 0.0, 0.0).with_amplitude(300.0);
    let mover = Target::radial(3.0, -20.0, 0.0, 1.0);
    let mut extractor = PointExtractor::new(&radar, DspOptions::default()).unwrap();
    let point = extractor
        .extract(&cube(&radar, &[wall, mover]))
        .unwrap()
        .points[0];
    // 50 dB of static clutter in the same range bin do not shift the point: sin -20 degrees.
    assert!(
        (point.x_m / point.range_m + 0.342).abs() < 0.003,
        "{point:?}"
    );
    assert!((point.velocity_mps - 1.0).abs() < 0.036, "{point:?}");
}
