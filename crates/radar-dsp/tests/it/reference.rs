//! Fast path against a naive DFT, Parseval, scaling, order.

use std::f64::consts::TAU;

use num_complex::Complex64;
use radarllm_base::RadarCube;
use radarllm_radar_dsp::Window;
use radarllm_radar_dsp::spectrum::{Spectrum, signed_doppler};
use radarllm_radar_dsp::{ClutterFilter, DspOptions, PointExtractor};

use crate::synthetic::{Random, Target, add_noise, cube, small_radar};

fn everything() -> DspOptions {
    DspOptions {
        min_range_m: 0.0,
        max_range_m: 1e6,
        ..DspOptions::default()
    }
}

fn random_cube(n_loops: usize, n_samples: usize) -> RadarCube {
    let mut cube = RadarCube::zeros(n_loops, 3, 4, n_samples);
    add_noise(&mut cube, 1.0, &mut Random(42));
    cube
}

#[test]
fn spectra_equal_the_naive_transform_for_odd_and_even_sizes() {
    for (n_loops, n_samples) in [(7, 12), (8, 13), (16, 16)] {
        let radar = small_radar(n_loops, n_samples);
        let cube = random_cube(n_loops, n_samples);
        for clutter in [
            ClutterFilter::Off,
            ClutterFilter::Mean,
            ClutterFilter::WeightedMean,
            ClutterFilter::ReceiverMean,
        ] {
            let options = DspOptions {
                clutter,
                ..everything()
            };
            let mut spectrum = Spectrum::new(&radar, &options).unwrap();
            spectrum.run(&cube).unwrap();
            let (wr, wd) = (
                Window::Hamming.weights(n_samples),
                Window::Hamming.weights(n_loops),
            );
            // One channel's spectrum of a range bin, without what is subtracted from all receivers.
            let of_channel = |channel: usize, r: usize| -> Vec<Complex64> {
                let slow: Vec<Complex64> = (0..n_loops)
                    .map(|l| {
                        let x = cube.chirp(l, channel / 4, channel % 4);
                        (0..n_samples)
                            .map(|n| {
                                let turn = -TAU * (r * n) as f64 / n_samples as f64;
                                let v = x[n] * wr[n];
                                Complex64::new(v.re.into(), v.im.into()) * Complex64::cis(turn)
                            })
                            .sum()
                    })
                    .collect();
                let weight = |l: usize| match clutter {
                    ClutterFilter::Off | ClutterFilter::ReceiverMean => 0.0,
                    ClutterFilter::Mean => 1.0 / n_loops as f64,
                    ClutterFilter::WeightedMean => {
                        f64::from(wd[l]) / wd.iter().map(|w| f64::from(*w)).sum::<f64>()
                    }
                };
                let mean: Complex64 = (0..n_loops).map(|l| slow[l] * weight(l)).sum();
                let at = |d: usize| -> Complex64 {
                    let turn = |l: usize| -TAU * (d * l) as f64 / n_loops as f64;
                    (0..n_loops)
                        .map(|l| (slow[l] - mean) * f64::from(wd[l]) * Complex64::cis(turn(l)))
                        .sum()
                };
                (0..n_loops).map(at).collect()
            };
            for channel in [0, 5, 11] {
                for r in 0..n_samples {
                    let mut expected = of_channel(channel, r);
                    if clutter == ClutterFilter::ReceiverMean {
                        for rx in 0..4 {
                            let other = of_channel(channel / 4 * 4 + rx, r);
                            for (value, other) in expected.iter_mut().zip(other) {
                                *value -= other / 4.0;
                            }
                        }
                    }
                    for (d, expected) in expected.into_iter().enumerate() {
                        let found = spectrum.value(channel, r * n_loops + d);
                        let error =
                            (Complex64::new(found.re.into(), found.im.into()) - expected).norm();
                        // Values of about 10; f32 has seven digits and the sums a few hundred terms.
                        assert!(
                            error < 1e-4,
                            "{n_loops}x{n_samples} ch {channel} r {r} d {d}: {error}"
                        );
                    }
                }
            }
        }
    }
}

#[test]
fn parseval_holds_for_the_map() {
    let radar = small_radar(32, 64);
    let cube = random_cube(32, 64);
    let options = DspOptions {
        clutter: ClutterFilter::Off,
        ..everything()
    };
    let mut spectrum = Spectrum::new(&radar, &options).unwrap();
    spectrum.run(&cube).unwrap();
    let (wr, wd) = (Window::Hamming.weights(64), Window::Hamming.weights(32));
    let mut energy = 0.0;
    for (i, v) in cube.data.iter().enumerate() {
        let w = f64::from(wr[i % 64]) * f64::from(wd[i / (64 * 12)]);
        energy += w * w * f64::from(v.norm_sqr());
    }
    let found: f64 = spectrum.map.iter().map(|p| f64::from(*p)).sum();
    // Unnormalised transforms multiply energy by their sizes; f32 rounding averages out.
    assert!((found / (energy * 64.0 * 32.0) - 1.0).abs() < 1e-5);
}

#[test]
fn ten_times_the_amplitude_is_twenty_decibels() {
    let radar = small_radar(32, 128);
    let target = Target::radial(2.0, 10.0, 0.0, 1.0);
    let mut extractor = PointExtractor::new(&radar, DspOptions::default()).unwrap();
    let weak = extractor.extract(&cube(&radar, &[target])).unwrap().points[0];
    let strong = extractor
        .extract(&cube(&radar, &[target.with_amplitude(10.0)]))
        .unwrap()
        .points[0];
    assert!((strong.intensity_db - weak.intensity_db - 20.0).abs() < 1e-3);
    // Rounding of the samples to f32 moves the refined azimuth by parts in a million.
    assert!((strong.x_m - weak.x_m).abs() < 1e-4 && strong.range_m == weak.range_m);
}

#[test]
fn a_plan_forgets_the_last_frame() {
    let radar = small_radar(32, 128);
    let mut extractor = PointExtractor::new(&radar, DspOptions::default()).unwrap();
    let mut cube = cube(&radar, &[Target::radial(2.0, 10.0, 0.0, 1.0)]);
    add_noise(&mut cube, 0.1, &mut Random(9));
    cube.time_s = 0.3;
    let first = extractor.extract(&cube).unwrap();
    assert!(
        extractor
            .extract(&RadarCube::zeros(32, 3, 4, 128))
            .unwrap()
            .points
            .is_empty()
    );
    assert_eq!(extractor.extract(&cube).unwrap(), first);
    assert_eq!((first.frame, first.time_s), (3, 0.3));
}

#[test]
fn doppler_order_is_that_of_an_fftshift() {
    let even: Vec<_> = (0..4).map(|i| signed_doppler(i, 4)).collect();
    let odd: Vec<_> = (0..5).map(|i| signed_doppler(i, 5)).collect();
    // numpy.fft.fftfreq(4) * 4 and fftfreq(5) * 5.
    assert_eq!(even, [0, 1, -2, -1]);
    assert_eq!(odd, [0, 1, 2, -2, -1]);
}
