//! Words into cubes, and what can be told from them.

use num_complex::Complex32;
use proptest::prelude::*;
use radarllm_base::{RadarConfig, RadarCube};
use radarllm_formats::adc::{
    AdcReader, AdcStats, AxisOrder, Chained, CubeShape, FrameDecoder, FrameSource, IqAnswer,
    IqCheck, SampleKind, SampleLayout, axes, check_capture, iq::compare_layouts,
    layout::AnalyticSignal,
};

use crate::made::{I_FIRST, Q_FIRST, bytes, echo, four, two, words};

fn shape(n_loops: usize, n_tx: usize, n_rx: usize, n_samples: usize) -> CubeShape {
    CubeShape {
        n_loops,
        n_tx,
        n_rx,
        n_samples,
    }
}

fn decode(words: &[i16], shape: CubeShape, layout: SampleLayout) -> RadarCube {
    let mut cube = shape.zeros().unwrap();
    FrameDecoder::new(shape, layout)
        .unwrap()
        .decode(&bytes(words), &mut cube)
        .unwrap();
    cube
}

fn z(re: i32, im: i32) -> Complex32 {
    Complex32::new(re as f32, im as f32)
}

/// By hand from TI SWRA581B: two receivers, two samples.
#[test]
fn two_lanes_hold_pairs_receiver_by_receiver() {
    let file = [1, 2, -3, -4, 5, 6, -7, i16::MIN];
    let expected = [z(1, -3), z(2, -4), z(5, -7), z(6, -32_768)];
    assert_eq!(
        decode(&file, shape(1, 1, 2, 2), two(I_FIRST)).data,
        expected
    );
    let swapped = expected.map(|v| Complex32::new(v.im, v.re));
    assert_eq!(decode(&file, shape(1, 1, 2, 2), two(Q_FIRST)).data, swapped);
}

/// Likewise: sample by sample, I of all lanes, then Q; RX3 is off, its lane zero.
#[test]
fn four_lanes_hold_all_receivers_sample_by_sample() {
    let file = [1, 2, 0, 4, -1, -2, 0, -4, 11, 12, 0, 14, -11, -12, 0, -14];
    let expected = [
        z(1, -1),
        z(11, -11),
        z(2, -2),
        z(12, -12),
        z(4, -4),
        z(14, -14),
    ];
    let found = decode(&file, shape(1, 1, 3, 2), four(0b1011, I_FIRST));
    assert_eq!(found.data, expected);
}

#[test]
fn layouts_that_cannot_be_are_refused() {
    let refused = |s, l| FrameDecoder::new(s, l).err().unwrap().to_string();
    assert!(refused(shape(1, 1, 2, 3), two(I_FIRST)).contains("pairs"));
    assert!(refused(shape(1, 1, 2, 4), four(0b1011, I_FIRST)).contains("0b1011"));
    assert!(refused(shape(1, 1, 1, 4), four(0b1_0000, I_FIRST)).contains("lanes"));
    assert!(refused(shape(0, 1, 2, 4), two(I_FIRST)).contains("empty"));
    assert!(refused(shape(usize::MAX, 2, 2, 4), two(I_FIRST)).contains("larger"));
}

fn layout_for(n_rx: usize, index: usize) -> SampleLayout {
    let data = [I_FIRST, Q_FIRST][index % 2];
    match index / 2 {
        0 => two(data),
        _ => four([0, 0b0100, 0b1001, 0b1101, 0b1111][n_rx], data),
    }
}

proptest! {
    #[test]
    fn what_a_device_writes_is_read_back(
        n_loops in 1_usize..4, n_tx in 1_usize..4, n_rx in 1_usize..=4, half in 1_usize..5,
        index in 0_usize..4, seed in any::<u64>(),
    ) {
        let shape = shape(n_loops, n_tx, n_rx, 2 * half);
        let cube = echo(shape, 0.3, 30_000.0, seed);
        let layout = layout_for(n_rx, index);
        // Rounding to words: what the device would have sampled.
        let mut sampled = cube.clone();
        for v in &mut sampled.data {
            *v = Complex32::new(f32::from(v.re as i16), f32::from(v.im as i16));
        }
        prop_assert_eq!(decode(&words(&cube, layout), shape, layout), sampled);
    }
}

#[test]
fn real_samples_become_the_analytic_signal() {
    let n = 64;
    let phase = |i: usize| std::f32::consts::TAU * 5.0 * i as f32 / n as f32 + 0.4;
    // An offset, 5 cycles, and the alternating sequence, which is real in every sense.
    let mut chirp: Vec<Complex32> = (0..n)
        .map(|i| Complex32::from(3.0 + 2.0 * phase(i).cos() + [1.0, -1.0][i % 2]))
        .collect();
    AnalyticSignal::new(n).run(&mut chirp);
    for (i, v) in chirp.iter().enumerate() {
        let expected = Complex32::from_polar(2.0, phase(i)) + 3.0 + [1.0, -1.0][i % 2];
        assert!(
            (v - expected).norm() < 1e-5,
            "{i}: {v}, expected {expected}"
        );
    }
    // The real part of what the reader makes is what was sampled, on both kinds of devices.
    let shape = shape(2, 1, 4, 16);
    let cube = echo(shape, 3.0, 5.0, 1);
    for layout in [two(SampleKind::Real), four(0b1111, SampleKind::Real)] {
        let found = decode(&words(&cube, layout), shape, layout);
        for (a, b) in found.data.iter().zip(&cube.data) {
            assert!((a.re - b.re).abs() < 1e-3);
        }
    }
}

#[test]
fn a_capture_split_in_mid_chirp_is_one_and_its_rest_is_reported() {
    let shape = shape(2, 2, 4, 8);
    let layout = two(I_FIRST);
    let cubes: Vec<RadarCube> = (0..3).map(|i| echo(shape, 1.0, 9.0, i + 1)).collect();
    let mut file: Vec<u8> = cubes
        .iter()
        .flat_map(|c| bytes(&words(c, layout)))
        .collect();
    file.extend([1, 2, 3]);
    for cut in [0, 1, 5, 300, 512, 1000, file.len()] {
        let (a, b) = file.split_at(cut);
        let decoder = FrameDecoder::new(shape, layout).unwrap();
        assert_eq!(decoder.frame_bytes(), 512);
        let mut reader = AdcReader::new(Chained::new(vec![a, b, &[]]), decoder);
        let mut cube = shape.zeros().unwrap();
        for (i, expected) in cubes.iter().enumerate() {
            let integrity = reader.next_frame(&mut cube).unwrap().unwrap();
            assert_eq!((integrity.frame, integrity.is_complete()), (i as u64, true));
            assert_eq!(&cube, expected);
        }
        assert_eq!(reader.next_frame(&mut cube).unwrap(), None);
        assert_eq!(reader.trailing_bytes(), 3);
    }
}

/// An echo of 12 cycles a chirp, 17 dB above the noise.
#[test]
fn swapped_i_and_q_are_noticed_and_noise_is_not_judged() {
    let shape = shape(16, 2, 4, 128);
    let judge = |cube: &RadarCube| {
        let mut check = IqCheck::new(128);
        check.push(cube);
        check.verdict()
    };
    let cube = echo(shape, 12.0, 170.0, 5);
    let file = words(&cube, two(I_FIRST));
    let right = judge(&decode(&file, shape, two(I_FIRST)));
    assert_eq!(right.answer, IqAnswer::AsRead);
    assert_eq!((right.positive_share, right.n_chirps), (1.0, 128));
    let wrong = judge(&decode(&file, shape, two(Q_FIRST)));
    assert_eq!(wrong.answer, IqAnswer::Swapped);
    assert!((wrong.positive_over_negative_db + right.positive_over_negative_db).abs() < 0.5);
    // Closed form. The tone, through a Hann window, has N/2 of its amplitude in bin 12 and N/4 in its
    // neighbours. White noise of variance v has 3/8 N v in every bin, of which 1/16 in bin 1 goes with the
    // mean.
    let (n, a, v) = (128.0_f64, 1000.0_f64, 2.0 * 170.0_f64.powi(2) / 3.0);
    let tone = (n * a).powi(2) * (0.25 / 144.0 + 0.0625 / 121.0 + 0.0625 / 169.0);
    let weights: f64 = (1..64).map(|k| 1.0 / f64::from(k * k)).sum();
    let noise = n * v * (0.375 * weights - 0.0625);
    let expected = 10.0 * (1.0 + tone / noise).log10();
    assert!(
        (right.positive_over_negative_db - expected).abs() < 0.7,
        "{right:?}, expected {expected}"
    );

    let mut noise_only = echo(shape, 12.0, 500.0, 6);
    for (v, tone) in noise_only
        .data
        .iter_mut()
        .zip(&echo(shape, 12.0, 0.0, 6).data)
    {
        *v -= tone;
    }
    assert_eq!(judge(&noise_only).answer, IqAnswer::Unclear);
    assert_eq!(judge(&shape.zeros().unwrap()).answer, IqAnswer::Unclear);
}

#[test]
fn the_layout_of_a_frame_is_found_among_all() {
    let shape = shape(16, 2, 4, 128);
    let cube = echo(shape, 9.0, 100.0, 7);
    for layout in [
        two(I_FIRST),
        two(Q_FIRST),
        four(15, I_FIRST),
        four(15, Q_FIRST),
    ] {
        let scores = compare_layouts(&bytes(&words(&cube, layout)), shape).unwrap();
        assert_eq!(scores.len(), 4);
        assert_eq!(scores[0].layout, layout, "{scores:?}");
        assert!(
            scores[0].verdict.positive_over_negative_db
                > scores[1].verdict.positive_over_negative_db + 6.0
        );
    }
}

#[test]
fn statistics_are_those_the_signal_was_made_with() {
    let shape = shape(8, 1, 4, 256);
    let mut cube = shape.zeros().unwrap();
    let (gain, error_rad) = (1.5_f32, 0.2_f32);
    for (i, value) in cube.data.iter_mut().enumerate() {
        // Eight cycles a chirp, three cycles from the first loop to the last.
        let (sample, loop_idx) = (i % 256, i / 1024);
        let cycles = sample as f32 * 8.0 / 256.0 + loop_idx as f32 * 3.0 / 8.0;
        let phase = std::f32::consts::TAU * cycles;
        *value = match i / 256 % 4 {
            0 => Complex32::from_polar(100.0, phase),
            1 => Complex32::new(gain * phase.cos() + 5.0, (phase + error_rad).sin() - 9.0) * 100.0,
            // Every 16th sample is at the end of a 16-bit ADC.
            2 if i % 16 == 0 => z(32_767, 0),
            2 => Complex32::from_polar(5000.0, phase),
            _ => Complex32::ZERO,
        };
    }
    let mut stats = AdcStats::new(4, 16);
    stats.push(&cube);
    let channels = stats.channels();
    let close = |found: f64, expected: f64| {
        assert!(
            (found - expected).abs() < 1e-3 * expected.abs().max(1.0),
            "{found}, expected {expected}"
        );
    };
    close(channels[0].rms, 100.0);
    close(channels[0].gain_imbalance_db, 0.0);
    close(channels[1].mean[0], 500.0);
    close(channels[1].mean[1], -900.0);
    close(
        channels[1].gain_imbalance_db,
        20.0 * f64::from(gain).log10(),
    );
    close(channels[1].phase_imbalance_rad, f64::from(error_rad));
    close(channels[2].saturated, 1.0 / 16.0);
    assert_eq!((channels[3].rms, channels[3].n_samples), (0.0, 2048));
    let problems = stats.problems().join("\n");
    for part in [
        "channel 4 is silent",
        "saturated in 6.2 %",
        "channel 2 has an offset of 1029.6",
        "I and Q of channel 2 differ by +3.5 dB and miss a right angle by +11.5 degrees",
    ] {
        assert!(problems.contains(part), "no `{part}` in\n{problems}");
    }
    assert!(!problems.contains("of channel 1 "), "{problems}");
}

#[test]
fn a_capture_of_another_size_is_noticed_and_what_would_fit_is_named() {
    let radar = RadarConfig::awr1843boost();
    let frame = 128 * 3 * 4 * 256 * 4;
    let rules = |n: u64, layout| -> Vec<(&str, String)> {
        check_capture(&radar, n, layout)
            .into_iter()
            .map(|f| (f.rule, f.message))
            .collect()
    };
    assert_eq!(rules(10 * frame, two(I_FIRST)), []);
    let odd = rules(10 * frame / 3 * 2, two(I_FIRST));
    assert_eq!(odd[0].0, "capture-size");
    assert!(
        odd[0].1.contains("1 slots") && odd[0].1.contains("2 slots"),
        "{odd:?}"
    );
    assert_eq!(rules(frame - 1, two(I_FIRST))[0].0, "capture-short");
    assert_eq!(rules(frame, four(0b1111, I_FIRST))[0].0, "capture-lanes");
    assert_eq!(rules(frame, four(0b0111, I_FIRST))[1].0, "capture-layout");
    let real = rules(frame / 2, two(SampleKind::Real));
    assert_eq!(real[0].0, "capture-real");
    assert!(real[0].1.contains("5.50 m"), "{real:?}");
}

/// Every order of the axes: the array that NumPy's transpose would give comes back as the cube.
#[test]
fn axes_in_any_order_give_the_same_cube() {
    let cube_shape = shape(3, 2, 4, 6);
    let cube = echo(cube_shape, 1.0, 50.0, 3);
    let at = |l: usize, t: usize, r: usize, s: usize| cube.chirp(l, t, r)[s];
    let orders: [(&str, [usize; 4]); 4] = [
        ("loop,tx,rx,sample", [0, 1, 2, 3]),
        ("sample,rx,tx,loop", [3, 2, 1, 0]),
        ("rx,loop,sample,tx", [2, 0, 3, 1]),
        ("tx,sample,loop,rx", [1, 3, 0, 2]),
    ];
    let lengths = [3, 2, 4, 6];
    for (names, order) in orders {
        let mut numbers = Vec::new();
        let n = order.map(|axis| lengths[axis]);
        for a in 0..n[0] {
            for b in 0..n[1] {
                for c in 0..n[2] {
                    for d in 0..n[3] {
                        let mut index = [0; 4];
                        for (axis, i) in order.iter().zip([a, b, c, d]) {
                            index[*axis] = i;
                        }
                        numbers.push(at(index[0], index[1], index[2], index[3]));
                    }
                }
            }
        }
        let axes = AxisOrder::parse(names).unwrap();
        let lengths = n.map(|n| n as u64);
        let layout = axes.fit(&lengths, false, cube_shape).unwrap();
        let mut found = cube_shape.zeros().unwrap();
        layout.fill(&numbers, false, &mut found).unwrap();
        assert_eq!(found, cube, "{names}");
        // The same memory in Fortran order has the axes the other way round.
        let mut reversed: Vec<&str> = names.split(',').collect();
        reversed.reverse();
        let mut lengths = lengths;
        lengths.reverse();
        let axes = AxisOrder::parse(&reversed.join(",")).unwrap();
        let fortran = axes.fit(&lengths, true, cube_shape).unwrap();
        fortran.fill(&numbers, false, &mut found).unwrap();
        assert_eq!(found, cube, "{names}, Fortran");
    }
}

#[test]
fn joined_axes_and_parts_are_taken_apart() {
    let cube_shape = shape(3, 2, 4, 6);
    let cube = echo(cube_shape, 1.0, 50.0, 4);
    // As it lies in memory already.
    for (names, lengths) in [
        ("frame,chirp,rx,sample", vec![5, 6, 4, 6]),
        ("chirp,virtual,sample", vec![3, 8, 6]),
        ("loop,virtual,sample", vec![3, 8, 6]),
        ("chirp,tx,rx,sample", vec![3, 2, 4, 6]),
    ] {
        let layout = AxisOrder::parse(names)
            .unwrap()
            .fit(&lengths, false, cube_shape)
            .unwrap();
        assert_eq!(
            layout.n_frames(),
            if lengths.len() == 4 && lengths[0] == 5 {
                5
            } else {
                1
            }
        );
        let mut found = cube_shape.zeros().unwrap();
        layout.fill(&cube.data, false, &mut found).unwrap();
        assert_eq!(found, cube, "{names}");
    }
    // I and Q as an axis, last and in the middle.
    let real: Vec<Complex32> = cube
        .data
        .iter()
        .flat_map(|v| [v.re.into(), v.im.into()])
        .collect();
    let planes: Vec<Complex32> = cube
        .data
        .chunks(6)
        .flat_map(|c| {
            c.iter()
                .map(|v| v.re.into())
                .chain(c.iter().map(|v| v.im.into()))
        })
        .collect();
    for (names, lengths, numbers) in [
        ("chirp,rx,sample,iq", [6, 4, 6, 2], &real),
        ("chirp,rx,iq,sample", [6, 4, 2, 6], &planes),
    ] {
        let layout = AxisOrder::parse(names)
            .unwrap()
            .fit(&lengths, false, cube_shape)
            .unwrap();
        let mut found = cube_shape.zeros().unwrap();
        layout.fill(numbers, true, &mut found).unwrap();
        assert_eq!(found, cube, "{names}");
        assert!(layout.fill(numbers, false, &mut found).is_err());
    }
}

#[test]
fn axes_that_make_no_cube_are_refused() {
    for names in [
        "",
        "loop",
        "sample,sample",
        "sample,time",
        "tx,virtual,sample",
        "loop,chirp,sample",
    ] {
        assert!(AxisOrder::parse(names).is_err(), "{names}");
    }
    let cube = shape(3, 2, 4, 6);
    let fit =
        |names: &str, lengths: &[u64]| AxisOrder::parse(names).unwrap().fit(lengths, false, cube);
    let error = fit("chirp,rx,sample", &[6, 3, 6]).unwrap_err().to_string();
    assert!(
        error.contains("[6, 3, 6]") && error.contains("[chirp 6, rx 4, sample 6]"),
        "{error}"
    );
    assert!(fit("chirp,rx,sample", &[6, 4]).is_err());
    assert!(fit("rx,sample", &[4, 6]).is_err());
    assert!(
        fit("chirp,frame,rx,sample", &[6, 9, 4, 6])
            .unwrap_err()
            .to_string()
            .contains("slowest")
    );
    assert_eq!(
        fit("frame,chirp,rx,sample", &[u64::MAX, 6, 4, 6])
            .unwrap()
            .n_frames(),
        u64::MAX
    );
}

#[test]
fn words_without_a_sign_get_it_back() {
    let mut numbers = [z(0, 65_535), z(32_767, 32_768)];
    assert!(axes::are_unsigned_words(&numbers));
    axes::sign_words(&mut numbers).unwrap();
    assert_eq!(numbers, [z(0, -1), z(32_767, -32_768)]);
    assert!(axes::sign_words(&mut numbers).is_err());
    assert!(!axes::are_unsigned_words(&[z(5, 32_767)]));
    assert!(!axes::are_unsigned_words(&[z(65_535, 65_536)]));
    assert!(!axes::are_unsigned_words(&[z(40_000, -1)]));
    assert!(!axes::are_unsigned_words(&[Complex32::new(40_000.5, 0.0)]));
}
