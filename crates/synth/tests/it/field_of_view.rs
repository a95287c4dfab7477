//! Point targets come back where they were put: every built-in radar, over its whole field of view.

use std::f64::consts::{PI, TAU};

use glam::DVec3;
use radarllm_base::radar_config::Antenna;
use radarllm_base::{RadarConfig, RadarPoint};
use radarllm_formats::builtin_radars;
use radarllm_radar_dsp::{DspOptions, array::Element, array::VirtualArray};
use radarllm_radar_sim::{Noise, PointTarget, Scene};
use radarllm_synth::{Method, Synthesizer};

/// The strongest point of a target that moves radially from the radar's origin.
fn found(chain: &mut Synthesizer, at: DVec3, radial_mps: f64) -> RadarPoint {
    let scene = Scene {
        points: vec![PointTarget {
            position_m: at,
            velocity_mps: at.normalize() * radial_mps,
            rcs_m2: 1.0,
        }],
        noise: Noise::Off,
        ..Scene::default()
    };
    let frames = chain.scene_to_points(&scene, 1, 1).unwrap();
    frames[0].points[0]
}

fn direction(azimuth_deg: f64, elevation_deg: f64) -> DVec3 {
    let (azimuth, elevation) = (azimuth_deg.to_radians(), elevation_deg.to_radians());
    DVec3::new(
        azimuth.sin() * elevation.cos(),
        azimuth.cos() * elevation.cos(),
        elevation.sin(),
    )
}

/// What the array can know of a place, and how well.
struct Geometry<'a> {
    radar: &'a RadarConfig,
    array: VirtualArray,
    /// Half the mean place of the azimuth row: directions are seen from here.
    centre_m: DVec3,
}

impl<'a> Geometry<'a> {
    fn new(radar: &'a RadarConfig) -> Self {
        let array = VirtualArray::new(radar);
        let row = &array.azimuth_row;
        let n = row.len() as f64;
        let centre_m = DVec3::new(
            0.5 * row.iter().map(|e| e.x_m).sum::<f64>() / n,
            0.0,
            0.5 * row[0].z_m,
        );
        Self {
            radar,
            array,
            centre_m,
        }
    }

    /// Largest difference between channels of the phase that a plane wave leaves out, rad.
    fn curvature_rad(&self, place: DVec3) -> f64 {
        let to = place - self.centre_m;
        let (range_m, u) = (to.length(), to.normalize());
        let n_rx = self.radar.rx.len();
        let leg_m = |a: &Antenna| {
            let antenna = DVec3::new(a.x_m, 0.0, a.z_m) - self.centre_m;
            (to - antenna).length() - (range_m - u.dot(antenna))
        };
        let path_m = |e: &Element| {
            leg_m(&self.radar.tx[e.channel / n_rx]) + leg_m(&self.radar.rx[e.channel % n_rx])
        };
        let all = self
            .array
            .azimuth_row
            .iter()
            .chain(&self.array.elevation_row);
        let (low, high) = all
            .map(path_m)
            .fold((f64::MAX, f64::MIN), |(l, h), p| (l.min(p), h.max(p)));
        TAU / self.radar.wavelength_m() * (high - low)
    }

    /// Most that u_x and u_z can be off.
    ///
    /// Phase errors within epsilon over n elements tilt the straight line through them by 1.5 epsilon /
    /// n at most (least squares against a step). Epsilon: half a Doppler bin that TDM compensation
    /// leaves, pi / loops over a whole loop, and the wave front's curvature. The parabola through the
    /// spectrum's log leaves 0.03 of an FFT bin. Between the rows epsilon counts as it is, and an error
    /// of u_x as often as the rows' middles lie apart in heights.
    fn tolerance(&self, place: DVec3) -> [f64; 2] {
        let row = &self.array.azimuth_row;
        let epsilon = PI / self.radar.n_loops as f64 + self.curvature_rad(place);
        let per_rad = |apart_m: f64| self.radar.wavelength_m() / (TAU * apart_m);
        let bin = TAU / 64.0;
        let x = (1.5 * epsilon / row.len() as f64 + 0.03 * bin) * per_rad(self.array.spacing_m);
        let middle = |row: &[Element]| row.iter().map(|e| e.x_m).sum::<f64>() / row.len() as f64;
        let height_m = self.array.height_m.abs();
        let z = if self.array.has_elevation() {
            let apart_m = (middle(&self.array.elevation_row) - middle(row)).abs();
            epsilon * per_rad(height_m) + apart_m / height_m * x
        } else {
            f64::INFINITY
        };
        [x, z]
    }
}

#[test]
fn every_radar_finds_points_over_its_field_of_view() {
    for radar in builtin_radars() {
        let geometry = Geometry::new(&radar);
        let mut chain = Synthesizer::new(&radar, Method::Fast, DspOptions::default()).unwrap();
        let farthest_m = 10.0_f64.min(0.93 * radar.max_range_m());
        // The cascade's 17 cm reach to 2 D^2 / lambda = 15 m with their near field: a target at 0.5 m
        // sends it nothing like the plane wave that direction finding looks for.
        let nearest_m = if radar.tx.len() > 3 { 5.0 } else { 0.5 };
        let mut count = 0;
        for azimuth_deg in [-60.0, -40.0, -20.0, 0.0, 20.0, 40.0, 60.0] {
            for elevation_deg in [-30.0, -14.0, 0.0, 9.0, 30.0] {
                // Ranges and speeds run through their spans, at every place in a bin.
                let turn = |step: f64| (f64::from(count) * step).fract();
                let range_m = nearest_m * (farthest_m / nearest_m).powf(turn(0.618_034));
                // Both signs, from a twentieth of the ambiguity to half a bin below it.
                let bins = 3.0 + (0.5 * radar.n_loops as f64 - 3.6) * turn(0.754_878);
                let sign = if count % 2 == 0 { 1.0 } else { -1.0 };
                let radial_mps = sign * bins * radar.velocity_resolution_mps();
                count += 1;
                let u = direction(azimuth_deg, elevation_deg);
                let point = found(&mut chain, u * range_m, radial_mps);

                let middle_s = 0.5 * radar.loop_period_s() * radar.n_loops as f64;
                let place = u * (range_m + radial_mps * middle_s);
                let to = place - geometry.centre_m;
                let label = format!(
                    "{}: {azimuth_deg} {elevation_deg} deg, {range_m:.2} m, {radial_mps:.2} m/s",
                    radar.name
                );
                // Bin centres: half a bin, and two hundredths where two bins are equally strong: then the
                // target's walk and the removed mean decide.
                let range_error_m = f64::from(point.range_m) - to.length();
                assert!(
                    range_error_m.abs() < 0.52 * radar.range_resolution_m(),
                    "{label}: range off by {range_error_m}"
                );
                let speed_error = f64::from(point.velocity_mps) - radial_mps;
                assert!(
                    speed_error.abs() < 0.51 * radar.velocity_resolution_mps(),
                    "{label}: velocity off by {speed_error}"
                );
                let [x, z] = geometry.tolerance(place);
                let seen = [point.x_m, point.z_m].map(|c| f64::from(c / point.range_m));
                let errors = [seen[0] - to.x / to.length(), seen[1] - to.z / to.length()];
                assert!(
                    errors[0].abs() < x,
                    "{label}: u_x off by {} of {x}",
                    errors[0]
                );
                if geometry.array.has_elevation() {
                    assert!(
                        errors[1].abs() < z,
                        "{label}: u_z off by {} of {z}",
                        errors[1]
                    );
                } else {
                    assert_eq!(point.z_m, 0.0, "{label}");
                }
                assert!(point.y_m > 0.0);
            }
        }
    }
}

/// Beyond the ambiguity a mover comes out at v - 2 n v_max, at its true range, and in a wrong
/// direction: TDM compensation then leaves a phase of 2 pi n / 3 per slot, which the array takes for an
/// angle.
#[test]
fn speeds_beyond_the_ambiguity_fold_and_turn_the_direction() {
    let radar = RadarConfig::awr1843boost();
    let geometry = Geometry::new(&radar);
    let mut chain = Synthesizer::new(&radar, Method::Fast, DspOptions::default()).unwrap();
    let per_fold = 2.0 * radar.max_velocity_mps();
    for (radial_mps, folds) in [(6.0, 1.0), (-7.3, -1.0), (10.0, 1.0), (15.5, 2.0)] {
        let u = direction(10.0, 5.0);
        let point = found(&mut chain, u * 4.0, radial_mps);
        let middle_s = 0.5 * radar.loop_period_s() * radar.n_loops as f64;
        let range_m = 4.0 + radial_mps * middle_s;
        let folded_mps = radial_mps - folds * per_fold;
        assert!(
            (f64::from(point.velocity_mps) - folded_mps).abs()
                < 0.51 * radar.velocity_resolution_mps(),
            "{radial_mps}: {point:?}"
        );
        // A target that walks several bins has a flat top: its strongest bin is half a walk off at most.
        let walk_m = radial_mps.abs() * 2.0 * middle_s;
        let range_error_m = f64::from(point.range_m) - range_m;
        assert!(
            range_error_m.abs() < 0.5 * (radar.range_resolution_m() + walk_m),
            "{radial_mps}: {range_error_m}"
        );
        // The array factor with the phases that are left, on a fine grid: the beam's peak is u_x, the
        // rows' difference u_z.
        let k = TAU / radar.wavelength_m();
        let phase = |e: &Element| {
            let slot = (e.channel / radar.rx.len()) as f64;
            -k * (e.x_m * u.x + e.z_m * u.z) + TAU * folds * slot / 3.0
        };
        let beam = |row: &[Element], ux: f64| {
            row.iter().fold((0.0, 0.0), |(re, im), e| {
                let (sin, cos) = (phase(e) + k * e.x_m * ux).sin_cos();
                (re + cos, im + sin)
            })
        };
        let row = &geometry.array.azimuth_row;
        let power = |ux: f64| {
            let (re, im) = beam(row, ux);
            re * re + im * im
        };
        let ux = (-9000..=9000)
            .map(|i| f64::from(i) * 1e-4)
            .max_by(|a, b| power(*a).total_cmp(&power(*b)))
            .unwrap();
        let angle = |(re, im): (f64, f64)| im.atan2(re);
        let between = angle(beam(&geometry.array.elevation_row, ux)) - angle(beam(row, ux));
        let wrapped = (between + PI).rem_euclid(TAU) - PI;
        let uz = -wrapped / (k * geometry.array.height_m);
        let [x, z] = geometry.tolerance(u * range_m);
        let seen = [point.x_m, point.z_m].map(|c| f64::from(c / point.range_m));
        assert!(
            (seen[0] - ux).abs() < x + 1e-4,
            "{radial_mps}: {seen:?} {ux}"
        );
        assert!(
            (seen[1] - uz).abs() < z + 1e-4,
            "{radial_mps}: {seen:?} {uz}"
        );
        assert!((ux - u.x).hypot(uz - u.z) > 0.1, "the direction is wrong");
    }
}
