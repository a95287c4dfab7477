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

/// The printed formula of the RadarLLM paper: with the phase step phi from one of four receivers to the next, what is left of
/// the power of an echo is 1 - |m|^2, where m is the mean of e^(j phi k).
#[test]
fn the_mean_over_receivers_takes_echoes_of_one_direction_away_and_not_static_ones() {
    let radar = RadarConfig::awr1843boost();
    let peak = |values: Vec<f32>| values.into_iter().fold(0.0, f32::max);
    for velocity_mps in [0.0, 0.9] {
        for azimuth_deg in [0.0_f64, 12.0, 35.0] {
            let target = [Target::radial(9.0, azimuth_deg, 0.0, velocity_mps)];
            let whole = f64::from(peak(map(&radar, ClutterFilter::Off, &target)));
            let left = f64::from(peak(map(&radar, ClutterFilter::ReceiverMean, &target)));
            // Half a wavelength at 77 GHz, seen at the carrier: CONVENTIONS.md, "Array sign".
            let phi =
                std::f64::consts::PI * radar.carrier_hz() / 77e9 * azimuth_deg.to_radians().sin();
            let sum = (0..4).fold([0.0, 0.0], |[re, im], k| {
                let angle = phi * f64::from(k);
                [re + angle.cos() / 4.0, im + angle.sin() / 4.0]
            });
            let expected = 1.0 - sum[0] * sum[0] - sum[1] * sum[1];
            // The receivers are up to 6 mm from where the direction is measured: less than a thousandth of a radian at 9 m.
            assert!(
                (left / whole - expected).abs() < 2e-3,
                "{azimuth_deg} degrees: {} for {expected}",
                left / whole
            );
        }
    }
    let one = RadarConfig {
        rx: radar.rx[..1].to_vec(),
        ..radar
    };
    let error = PointExtractor::new(&one, DspOptions::paper())
        .err()
        .unwrap();
    assert!(error.to_string().contains("single receiver"), "{error}");
}

#[test]
fn the_papers_chain_always_gives_128_points() {
    let radar = RadarConfig::awr1843boost();
    let mut extractor = PointExtractor::new(&radar, DspOptions::paper()).unwrap();
    let mover = Target::radial(3.0, -20.0, 0.0, 1.0);
    let frame = extractor.extract(&cube(&radar, &[mover])).unwrap();
    assert_eq!(frame.points.len(), 128);
    let strongest = frame.points[0];
    assert!((strongest.range_m - 3.0).abs() < 0.05, "{strongest:?}");
    assert!(
        (strongest.velocity_mps - 1.0).abs() < 0.036,
        "{strongest:?}"
    );
}
