//! The same seed and configuration give the same bytes.

use glam::DVec3;
use radarllm_base::{Material, RadarConfig, RadarCube};
use radarllm_radar_sim::shapes::RigidSurface;
use radarllm_radar_sim::{Noise, Scene, SimOptions, SimdLevel, Simulator};

fn body() -> RigidSurface {
    let mut body = RigidSurface::ellipsoid(DVec3::new(0.15, 0.1, 0.3), 0.03)
        .at(DVec3::new(0.1, 2.5, 0.0))
        .moving(DVec3::new(0.2, -1.0, 0.1))
        .of(Material {
            power_reflection: 0.3,
            roughness_m: 5e-4,
            rough_albedo: 0.1,
            power_transmission: 0.0,
        });
    body.angular_velocity = DVec3::new(1.0, 0.0, 2.0);
    body
}

fn frames(simd: Option<SimdLevel>, seed: u64, noise: Noise) -> Vec<RadarCube> {
    let body = body();
    let scene = Scene {
        surfaces: vec![&body],
        points: vec![],
        noise,
    };
    let options = SimOptions {
        simd,
        ..Default::default()
    };
    let mut simulator = Simulator::new(&RadarConfig::awr1843boost(), options).unwrap();
    (0..3)
        .map(|frame| {
            let mut cube = simulator.new_cube();
            simulator
                .simulate_frame(&scene, frame, 0.1 * frame as f64, seed, &mut cube)
                .unwrap();
            cube
        })
        .collect()
}

#[test]
fn threads_and_reuse_do_not_change_a_byte() {
    let expected = frames(None, 9, Noise::Thermal);
    let handles: Vec<_> = (0..3)
        .map(|_| std::thread::spawn(|| frames(None, 9, Noise::Thermal)))
        .collect();
    for handle in handles {
        assert_eq!(handle.join().unwrap(), expected);
    }
    // A simulator that has seen other frames gives the same third frame.
    let body = body();
    let scene = Scene {
        surfaces: vec![&body],
        points: vec![],
        noise: Noise::Thermal,
    };
    let mut simulator =
        Simulator::new(&RadarConfig::awr1843boost(), SimOptions::default()).unwrap();
    let mut cube = simulator.new_cube();
    simulator
        .simulate_frame(&scene, 2, 0.2, 9, &mut cube)
        .unwrap();
    assert_eq!(cube, expected[2]);
}

#[test]
fn seeds_change_phases_and_noise() {
    let (a, b) = (frames(None, 1, Noise::Off), frames(None, 2, Noise::Off));
    assert_ne!(a[0].data, b[0].data);
    let noisy = frames(None, 1, Noise::Thermal);
    let noise = |i: usize| -> Vec<_> {
        noisy[i]
            .data
            .iter()
            .zip(&a[i].data)
            .map(|(x, y)| x - y)
            .collect()
    };
    let (first, second) = (noise(0), noise(1));
    let power = |x: &[num_complex::Complex32]| x.iter().map(|z| z.norm_sqr()).sum::<f32>();
    let cross: num_complex::Complex32 = first.iter().zip(&second).map(|(x, y)| x.conj() * y).sum();
    // Independent noise: correlation below five deviations, 5 / sqrt(393216).
    assert!(cross.norm() < 8e-3 * (power(&first) * power(&second)).sqrt());
}

#[test]
fn instruction_sets_agree_within_rounding() {
    let expected = frames(Some(SimdLevel::PORTABLE), 9, Noise::Off);
    let peak = expected[0]
        .data
        .iter()
        .map(|z| z.norm())
        .fold(0.0, f32::max);
    for level in SimdLevel::available() {
        let found = frames(Some(level), 9, Noise::Off);
        for (a, b) in found[0].data.iter().zip(&expected[0].data) {
            // f32 phases of a few turns (3e-7 each) through sums of 500 facets.
            assert!((a - b).norm() < 1e-5 * peak);
        }
    }
}
