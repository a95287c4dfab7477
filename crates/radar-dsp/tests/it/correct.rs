//! Corrections of raw samples, measured against closed forms.

use num_complex::{Complex32, Complex64};
use radarllm_base::{RadarConfig, RadarCube, RadarPoint};
use radarllm_radar_dsp::{
    ClutterFilter, Corrections, Corrector, DspError, DspOptions, EmptyRoom, PointExtractor, Window,
};
use radarllm_radar_sim::Impairments;
use radarllm_radar_sim::impairments::Leakage;

use crate::synthetic::{Random, Target, add_noise, cube, small_radar};

fn still_kept() -> DspOptions {
    DspOptions {
        clutter: ClutterFilter::Off,
        ..DspOptions::default()
    }
}

/// Detection power at a range and velocity.
fn power(extractor: &mut PointExtractor, cube: &RadarCube, range_m: f64, speed_mps: f64) -> f64 {
    let map = extractor.range_doppler_map(cube).unwrap();
    let row = ((range_m - map.rows.start) / map.rows.step).round() as usize;
    let col = ((speed_mps - map.cols.start) / map.cols.step).round() as usize;
    f64::from(map.values[row * map.n_cols + col])
}

fn noisy(radar: &RadarConfig, targets: &[Target], variance: f64, random: &mut Random) -> RadarCube {
    let mut cube = cube(radar, targets);
    add_noise(&mut cube, variance, random);
    cube
}

#[test]
fn the_empty_room_goes_down_to_the_noise_of_its_mean_and_movers_stay() {
    let radar = small_radar(64, 128);
    let (n_empty, n_frames, variance) = (4, 6, 0.01);
    let mut random = Random(7);
    let wall = Target::radial(3.0, 10.0, 0.0, 0.0).with_amplitude(10.0);
    let walker = Target::radial(4.5, -15.0, 0.0, 1.1);
    // In the wall's range and angle: only the velocity tells them apart.
    let passer = Target::radial(3.0, 10.0, 0.0, -0.9);
    let mut room = EmptyRoom::new(&radar);
    for _ in 0..n_empty {
        room.push(&noisy(&radar, &[wall], variance, &mut random))
            .unwrap();
    }
    let background = room.finish().unwrap();
    assert_eq!(background.n_frames, n_empty);
    // A frame's mean differs from the mean of all by noise only: variance / loops * (1 - 1 / frames) over 100.
    let expected_db = 10.0 * (variance / 64.0 * 0.75 / 100.0).log10();
    // 1536 samples times three free frames: 1.5 %.
    assert!((background.drift_db.unwrap() - expected_db).abs() < 0.3);
    let corrections = Corrections {
        background: Some(background),
        ..Corrections::default()
    };
    let corrector = Corrector::new(&radar, corrections).unwrap();
    let mut extractor = PointExtractor::new(&radar, still_kept()).unwrap();
    let is_wall = |p: &RadarPoint| (p.range_m - 3.0).abs() < 0.3 && p.velocity_mps.abs() < 0.3;
    let strongest = |points: &[RadarPoint], range_m: f32, speed_mps: f32| {
        let near = |p: &&RadarPoint| {
            (p.range_m - range_m).abs() < 0.15 && (p.velocity_mps - speed_mps).abs() < 0.2
        };
        points.iter().find(near).copied()
    };
    let (mut before, mut after) = (0.0, 0.0);
    for _ in 0..n_frames {
        let mut with_wall = noisy(&radar, &[wall, walker, passer], variance, &mut random);
        let points = extractor.extract(&with_wall).unwrap().points;
        assert!(points.iter().any(is_wall));
        corrector.apply(&mut with_wall).unwrap();
        let points = extractor.extract(&with_wall).unwrap().points;
        assert!(!points.iter().any(is_wall), "{points:?}");
        // The movers are where they are in a room without a wall.
        let alone = cube(&radar, &[walker, passer]);
        let expected = extractor.extract(&alone).unwrap().points;
        for (range_m, speed_mps) in [(4.5, 1.1), (3.0, -0.9)] {
            let found = strongest(&points, range_m, speed_mps).unwrap();
            let expected = strongest(&expected, range_m, speed_mps).unwrap();
            assert_eq!(found.range_m, expected.range_m);
            assert_eq!(found.velocity_mps, expected.velocity_mps);
            // 30 dB of signal over noise after the transforms and more: 0.02 of x/R at most.
            assert!((found.x_m - expected.x_m).abs() < 0.02 * range_m);
        }
    }
    // Without the passer, whose sidelobe at zero velocity would stand above the floor.
    for _ in 0..n_frames {
        let mut still = noisy(&radar, &[wall, walker], variance, &mut random);
        before += power(&mut extractor, &still, 3.0, 0.0) / n_frames as f64;
        corrector.apply(&mut still).unwrap();
        after += power(&mut extractor, &still, 3.0, 0.0) / n_frames as f64;
    }
    // What is left of the wall's cell: the frame's noise, and the noise of the mean, which adds up coherently.
    let sums = |n: usize| {
        let w = Window::Hamming.weights(n);
        let w = w.iter().map(|w| f64::from(*w));
        (w.clone().sum::<f64>(), w.map(|w| w * w).sum::<f64>())
    };
    let (doppler, doppler_squares) = sums(64);
    let (_, range_squares) = sums(128);
    let floor = 12.0
        * variance
        * range_squares
        * (doppler_squares + doppler * doppler / (n_empty * 64) as f64);
    let (found_db, expected_db) = (
        10.0 * (before / after).log10(),
        10.0 * (before / floor).log10(),
    );
    // 12 exponentials in 6 frames (0.5 dB), those of the mean once only: three standard deviations.
    assert!(
        (found_db - expected_db).abs() < 1.7,
        "{found_db:.2} dB, expected {expected_db:.2} dB"
    );
    assert!(found_db > 50.0);
    eprintln!("static echo down by {found_db:.1} dB, by the noise of the mean {expected_db:.1} dB");
}

#[test]
fn offsets_of_receivers_go_and_targets_stay() {
    let radar = small_radar(16, 128);
    let target = Target::radial(2.0, 5.0, 0.0, 0.0);
    let mut options = still_kept();
    options.min_range_m = 0.0;
    let mut extractor = PointExtractor::new(&radar, options).unwrap();
    let clean = cube(&radar, &[target]);
    let mut offset = clean.clone();
    for (i, chirp) in offset.data.chunks_exact_mut(128).enumerate() {
        let dc = [(30.0, -10.0), (0.0, 5.0), (-20.0, 2.0), (1.0, 0.0)][i % 4];
        chirp
            .iter_mut()
            .for_each(|z| *z += Complex32::new(dc.0, dc.1));
    }
    let corrections = Corrections {
        remove_offset: true,
        ..Corrections::default()
    };
    let corrector = Corrector::new(&radar, corrections).unwrap();
    let mut corrected = offset.clone();
    corrector.apply(&mut corrected).unwrap();
    let mut at = |cube: &RadarCube, range_m| power(&mut extractor, cube, range_m, 0.0);
    let down_db = 10.0 * (at(&offset, 0.0) / at(&corrected, 0.0)).log10();
    // What is left in bin zero is what the target itself has there, over which the offset stood by 1430 / 4 to 1 and
    // 85 dB: a Hamming sidelobe 23 bins away is below -45 dB.
    assert!(down_db > 60.0, "{down_db}");
    let change_db = 10.0 * (at(&corrected, 2.0) / at(&clean, 2.0)).log10();
    assert!(change_db.abs() < 0.01, "{change_db}");
    eprintln!("offset down by {down_db:.1} dB, target changed by {change_db:.4} dB");
}

#[test]
fn leakage_of_the_simulator_goes_and_what_stands_behind_it_stays() {
    let radar = small_radar(16, 256);
    let target = Target::radial(1.2, 5.0, 0.0, 0.0);
    let clean = cube(&radar, &[target]);
    // Leakage of 12 dBm less 40 dB, in square-root watts, is to be 1000 times the target's amplitude.
    let scale = 10_f64.powf((radar.tx_power_dbm - 30.0 - 40.0) / 20.0) / 1000.0;
    let mut leaky = clean.clone();
    leaky.data.iter_mut().for_each(|z| *z *= scale as f32);
    let impairments = Impairments {
        leakage: Some(Leakage {
            isolation_db: 40.0,
            path_m: 0.05,
        }),
        ..Impairments::default()
    };
    impairments.apply(&radar, &mut leaky, 3, 0).unwrap();
    leaky
        .data
        .iter_mut()
        .for_each(|z| *z *= (1.0 / scale) as f32);
    let corrections = Corrections {
        leakage_m: Some(0.15),
        ..Corrections::default()
    };
    let mut corrected = leaky.clone();
    Corrector::new(&radar, corrections)
        .unwrap()
        .apply(&mut corrected)
        .unwrap();
    let mut extractor = PointExtractor::new(&radar, still_kept()).unwrap();
    let mut at = |cube: &RadarCube, range_m| power(&mut extractor, cube, range_m, 0.0);
    // Between leakage and target only sidelobes of the leakage stand: -43 dB of 60 dB above the target.
    let down_db = 10.0 * (at(&leaky, 0.4) / at(&corrected, 0.4)).log10();
    assert!(down_db > 40.0, "{down_db}");
    let change_db = 10.0 * (at(&corrected, 1.2) / at(&clean, 1.2)).log10();
    assert!(change_db.abs() < 0.1, "{change_db}");
    eprintln!(
        "leakage at 0.4 m down by {down_db:.1} dB, target at 1.2 m changed by {change_db:.3} dB"
    );
}

#[test]
fn lost_chirps_stay_lost_and_wrong_shapes_are_named() {
    let radar = small_radar(16, 64);
    let frame = cube(&radar, &[Target::radial(1.0, 0.0, 0.0, 0.0)]);
    let mut room = EmptyRoom::new(&radar);
    room.push(&frame).unwrap();
    let background = room.finish().unwrap();
    assert_eq!(background.drift_db, None);
    let corrections = Corrections {
        background: Some(background),
        ..Corrections::default()
    };
    let corrector = Corrector::new(&radar, corrections.clone()).unwrap();
    let mut damaged = frame.clone();
    damaged.data[64..128].fill(Complex32::ZERO);
    corrector.apply(&mut damaged).unwrap();
    assert!(damaged.data[64..128].iter().all(|z| *z == Complex32::ZERO));
    // A cube that is its own mean over 16 loops vanishes but for rounding.
    assert!(damaged.data.iter().all(|z| z.norm() < 1e-6));
    let other = small_radar(32, 64);
    let error = Corrector::new(&other, corrections).err().unwrap();
    assert!(matches!(
        error,
        DspError::Option {
            field: "background",
            ..
        }
    ));
    assert!(matches!(
        corrector.apply(&mut RadarCube::zeros(16, 3, 4, 65)),
        Err(DspError::Shape { .. })
    ));
    let mut bad = frame;
    bad.data[(3 * 12 + 5) * 64 + 9].im = f32::NAN;
    let index = [3, 1, 1, 9];
    assert_eq!(
        EmptyRoom::new(&radar).push(&bad),
        Err(DspError::NotFinite { index })
    );
    assert!(EmptyRoom::new(&radar).finish().is_none());
    for (gains, leakage_m) in [
        (vec![Complex64::ONE; 11], None),
        (vec![Complex64::ZERO; 12], None),
        (vec![], Some(0.0)),
        (vec![], Some(1e9)),
        (vec![], Some(f64::NAN)),
    ] {
        let corrections = Corrections {
            channel_gains: gains,
            leakage_m,
            ..Corrections::default()
        };
        assert!(Corrector::new(&radar, corrections).is_err());
    }
}
