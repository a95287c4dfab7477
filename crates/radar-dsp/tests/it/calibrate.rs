//! Channel gains from a corner reflector, and what they are good for.

use num_complex::{Complex32, Complex64};
use radarllm_base::radar_config::TxMultiplexing;
use radarllm_base::{RadarConfig, RadarCube, RadarPoint};
use radarllm_radar_dsp::{
    CalibrateError, ChannelGains, CornerCalibrator, Corrections, Corrector, DspOptions,
    PointExtractor, Reflector,
};

use crate::synthetic::{Random, Target, add_noise, cube, small_radar};

fn radar() -> RadarConfig {
    small_radar(32, 128)
}

fn place(range_m: f64, azimuth_deg: f64, elevation_deg: f64) -> Reflector {
    Reflector {
        range_m,
        azimuth_rad: azimuth_deg.to_radians(),
        elevation_rad: elevation_deg.to_radians(),
        search_m: 0.3,
    }
}

/// 20 degrees and 1 dB of standard deviation, drawn once.
fn mismatch(random: &mut Random) -> Vec<Complex64> {
    (0..12)
        .map(|_| {
            let z = random.complex() * std::f64::consts::SQRT_2;
            Complex64::from_polar(10_f64.powf(z.re / 20.0), z.im * 20_f64.to_radians())
        })
        .collect()
}

fn through(gains: &[Complex64], mut cube: RadarCube) -> RadarCube {
    let n_samples = cube.n_samples;
    let chirps = cube.data.chunks_exact_mut(n_samples);
    for (chirp, gain) in chirps.zip(gains.iter().cycle()) {
        let gain = Complex32::new(gain.re as f32, gain.im as f32);
        chirp.iter_mut().for_each(|z| *z *= gain);
    }
    cube
}

fn calibrate(
    radar: &RadarConfig,
    reflector: Reflector,
    frames: &[RadarCube],
) -> Result<ChannelGains, CalibrateError> {
    let mut calibrator = CornerCalibrator::new(radar, reflector)?;
    for frame in frames {
        calibrator.push(frame)?;
    }
    calibrator.finish()
}

#[test]
fn a_reflector_tells_the_channels_and_another_target_comes_out_where_it_is() {
    let radar = radar();
    let mut random = Random(13);
    let gains = mismatch(&mut random);
    // Off every grid and off boresight; wavefronts at 1.8 m are curved by 0.1 rad over the array.
    let corner = Target::radial(1.837, 12.0, 4.0, 0.0);
    let frames: Vec<RadarCube> = (0..4)
        .map(|_| {
            let mut frame = through(&gains, cube(&radar, &[corner]));
            add_noise(&mut frame, 0.01, &mut random);
            frame
        })
        .collect();
    let found = calibrate(&radar, place(1.7, 12.0, 4.0), &frames).unwrap();
    assert!((found.range_m - 1.837).abs() < 0.005, "{}", found.range_m);
    assert_eq!(found.n_frames, 4);
    // 20 dB a sample; a Hamming window over 128 samples gains 19.7 dB (1.37 of 21.1 lost), 128 loops 21.1 dB; the
    // weakest of twelve gains of 1 dB lies some 2 dB lower.
    assert!((57.0..61.0).contains(&found.snr_db), "{}", found.snr_db);
    // Noise of a half frame against the mean of eight: the mean SNR, 9 dB less.
    assert!(
        found.residual < 0.01 && found.residual > 1e-4,
        "{}",
        found.residual
    );
    assert!(found.above_surroundings_db > 30.0);
    let unit = found.gains[0] / gains[0];
    let unit = unit / unit.norm();
    let level = (gains.iter().map(|g| g.norm().ln()).sum::<f64>() / 12.0).exp();
    for (found, gain) in found.gains.iter().zip(&gains) {
        // 57 dB leave 0.0014 on each of two; a range step of a sixteenth of a bin leaves the curvature unchanged.
        assert!(
            (found / (gain / level * unit) - 1.0).norm() < 0.01,
            "{found} {gain}"
        );
    }

    let corrections = Corrections {
        channel_gains: found.gains,
        ..Corrections::default()
    };
    let corrector = Corrector::new(&radar, corrections).unwrap();
    let mut extractor = PointExtractor::new(&radar, DspOptions::default()).unwrap();
    let speed_mps = 8.0 * radar.velocity_resolution_mps();
    let mut worst = [0.0_f64; 2];
    for (azimuth_deg, elevation_deg) in [(-35.0, 0.0), (-10.0, 8.0), (0.0, 0.0), (25.0, -10.0)] {
        let target = Target::radial(3.0, azimuth_deg, elevation_deg, speed_mps);
        let ideal = cube(&radar, &[target]);
        let mut seen = through(&gains, ideal.clone());
        let mut strongest = |cube: &RadarCube| extractor.extract(cube).unwrap().points[0];
        let (truth, uncalibrated) = (strongest(&ideal), strongest(&seen));
        corrector.apply(&mut seen).unwrap();
        let apart = |p: RadarPoint| {
            [
                f64::from((p.x_m - truth.x_m) / truth.range_m).abs(),
                f64::from((p.z_m - truth.z_m) / truth.range_m).abs(),
            ]
        };
        let [x, z] = apart(strongest(&seen));
        // Errors of 0.01 in every gain at worst: 0.01 rad between the rows is 0.01 lambda / (2 pi h) = 0.0031 of
        // z/R, and less of x/R, where eight elements share it.
        assert!(
            x < 0.003 && z < 0.0035,
            "{azimuth_deg} {elevation_deg}: {x} {z}"
        );
        let [x, z] = apart(uncalibrated);
        worst = [worst[0].max(x), worst[1].max(z)];
    }
    eprintln!("x/R and z/R without calibration: {worst:?}");
    assert!(
        worst[0] > 0.01 && worst[1] > 0.03,
        "the mismatch matters: {worst:?}"
    );
}

#[test]
fn what_is_no_reflector_is_refused_by_name() {
    let radar = radar();
    let mut random = Random(5);
    let noise: Vec<RadarCube> = (0..2)
        .map(|_| {
            let mut frame = cube(&radar, &[]);
            add_noise(&mut frame, 1.0, &mut random);
            frame
        })
        .collect();
    let weak = calibrate(&radar, place(2.0, 0.0, 0.0), &noise).unwrap_err();
    assert!(
        matches!(
            weak,
            CalibrateError::Weak { .. } | CalibrateError::NoPeak { .. }
        ),
        "{weak}"
    );
    assert_eq!(
        calibrate(&radar, place(2.0, 0.0, 0.0), &[]),
        Err(CalibrateError::NoFrames)
    );
    // A walker, and somebody who drifts within the bin of zero velocity.
    for speed_mps in [-0.8, 0.06] {
        let walker = [cube(&radar, &[Target::radial(2.0, 0.0, 0.0, speed_mps)])];
        let moving = calibrate(&radar, place(2.0, 0.0, 0.0), &walker).unwrap_err();
        let CalibrateError::Moving { velocity_mps, .. } = moving else {
            panic!("{moving}")
        };
        // The phase itself, not a Doppler bin: exact but for the change of range within the lobe.
        assert!((velocity_mps - speed_mps).abs() < 0.01, "{velocity_mps}");
    }
    // Breathing: 1 mm from frame to frame.
    let breath: Vec<RadarCube> = [2.0, 2.001, 2.0, 2.001]
        .map(|r| cube(&radar, &[Target::radial(r, 0.0, 0.0, 0.0)]))
        .into();
    let unsteady = calibrate(&radar, place(2.0, 0.0, 0.0), &breath).unwrap_err();
    assert!(
        matches!(unsteady, CalibrateError::Unsteady { .. }),
        "{unsteady}"
    );
    // The reflector stands elsewhere: its flank is no peak.
    let corner = [cube(&radar, &[Target::radial(2.0, 0.0, 0.0, 0.0)])];
    let flank = calibrate(&radar, place(1.65, 0.0, 0.0), &corner).unwrap_err();
    assert!(matches!(flank, CalibrateError::NoPeak { .. }), "{flank}");
    // A receiver that hears nothing.
    let mut deaf = corner[0].clone();
    for (i, chirp) in deaf.data.chunks_exact_mut(128).enumerate() {
        if i % 4 == 2 {
            chirp.fill(Complex32::ZERO);
        }
    }
    let weak = calibrate(&radar, place(2.0, 0.0, 0.0), &[deaf]).unwrap_err();
    assert!(
        matches!(
            weak,
            CalibrateError::Weak {
                channel: 2,
                receiver: 2,
                ..
            }
        ),
        "{weak}"
    );

    let mut phase_modulated = RadarConfig {
        multiplexing: TxMultiplexing::Bpm,
        ..radar.clone()
    };
    phase_modulated.tx.truncate(2);
    assert!(CornerCalibrator::new(&phase_modulated, place(2.0, 0.0, 0.0)).is_err());
    for reflector in [
        place(0.2, 0.0, 0.0),
        place(1e9, 0.0, 0.0),
        place(f64::NAN, 0.0, 0.0),
        place(2.0, 90.0, 0.0),
    ] {
        assert!(CornerCalibrator::new(&radar, reflector).is_err());
    }
}
