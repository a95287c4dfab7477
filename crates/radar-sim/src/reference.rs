//! The slow reference: a direct sum of the model over facets, channels and samples in f64.
//!
//! Nothing is interpolated. The vertices of the surfaces are evaluated at every chirp, distances are exact for every
//! channel, and the triangle integral is evaluated each time. Only what is visible and within the maximum range is
//! shared with the fast path, because it is part of the model (once per segment of a frame).

use std::f64::consts::TAU;
use std::ops::Range;

use glam::{DVec3, Vec3};
use num_complex::Complex64;
use radarllm_base::{RadarConfig, RadarCube, SPEED_OF_LIGHT_MPS};

use crate::bounce::{BouncingSurfaces, Seen};
use crate::error::SimError;
use crate::facets::facet_gains;
use crate::link::Link;
use crate::motion::{N_KEYS, Segment, chirp_time_s};
use crate::scatter::{FacetPhases, Reflection, divided_difference};
use crate::scene::{PointTarget, Scene};
use crate::simulator::{SimOptions, check_frame};
use crate::visibility::{DepthRaster, ScreenTransmission, View, leave_out_beyond_range};
use crate::weather::Rain;

/// Simulates `loops` of the frame that starts at `time_s` into `cube`, without noise. Other loops remain unchanged.
///
/// # Example
/// The fast path against it, on one loop:
/// ```
/// use glam::DVec3;
/// use radarllm_base::RadarConfig;
/// use radarllm_radar_sim::{Noise, PointTarget, Scene, SimOptions, Simulator, reference};
///
/// let target = PointTarget::at(DVec3::new(0.3, 4.0, 0.1), 1.0);
/// let scene = Scene { surfaces: vec![], points: vec![target], noise: Noise::Off };
/// let (radar, options) = (RadarConfig::awr1843boost(), SimOptions::default());
/// let mut simulator = Simulator::new(&radar, options.clone())?;
/// let (mut fast, mut exact) = (simulator.new_cube(), simulator.new_cube());
/// simulator.simulate_frame(&scene, 0, 0.0, 1, &mut fast)?;
/// reference::simulate_loops(&radar, &options, &scene, 0.0, 1, 0..1, &mut exact)?;
/// let one_loop = 3 * 4 * 256;
/// for (fast, exact) in fast.data[..one_loop].iter().zip(&exact.data) {
///     // 60 dB below.
///     assert!((fast - exact).norm() < 1e-3 * exact.norm());
/// }
/// # Ok::<(), radarllm_radar_sim::SimError>(())
/// ```
///
/// # Errors
/// As [`crate::Simulator::simulate_frame`], and an empty or too long range of loops as a bad shape.
pub fn simulate_loops(
    config: &RadarConfig,
    options: &SimOptions,
    scene: &Scene<'_>,
    time_s: f64,
    seed: u64,
    loops: Range<usize>,
    cube: &mut RadarCube,
) -> Result<(), SimError> {
    config.validate()?;
    check_frame(config, scene, time_s, cube)?;
    if loops.end > config.n_loops {
        return Err(SimError::Option {
            option: "loops",
            problem: format!("{loops:?} of a frame of {} loops", config.n_loops),
        });
    }
    cube.time_s = time_s;
    options.weather.validate()?;
    let link = Link::new(config).in_weather(&options.weather);
    let mut drops = Vec::new();
    if let Some(rain) = Rain::new(options, config, &link) {
        rain.draw(seed, time_s, &mut drops);
    }
    let centre = link.array_centre_m.as_vec3();
    let mut raster = DepthRaster::new(options.raster_size, options.sampling);
    let (mut positions, mut triangles, mut coverage) = (Vec::new(), Vec::new(), Vec::new());
    let (mut ranges, mut transmission) = (Vec::new(), ScreenTransmission::default());
    scene.concatenate_triangles(&mut triangles);
    scene.surface_ranges(&mut ranges);
    for segment in Segment::all(config) {
        let mine = segment.first_loop..segment.first_loop + segment.n_loops;
        let (from, to) = (loops.start.max(mine.start), loops.end.min(mine.end));
        if from >= to {
            continue;
        }
        let middle_s = time_s + segment.key_times_s()[N_KEYS / 2];
        scene.positions_at(middle_s, centre, options.min_range_m, &mut positions)?;
        let view = View {
            positions: &positions,
            triangles: &triangles,
            surfaces: &ranges,
            centre,
        };
        raster.coverage(view, &mut coverage, &mut transmission);
        leave_out_beyond_range(view, link.max_range_m, &mut coverage);
        let is_received = |point: &&PointTarget| {
            let from_centre = point.position_at(middle_s) - link.array_centre_m;
            from_centre.length() <= link.max_range_m
        };
        let points = scene.points.iter().chain(&drops);
        let points: Vec<&PointTarget> = points.filter(is_received).collect();
        let surfaces = BouncingSurfaces::new(scene, &link, seed);
        let bounces = match options.max_bounces {
            0 | 1 => Vec::new(),
            _ => {
                let seen = Seen {
                    positions: &positions,
                    triangles: &triangles,
                    coverage: &coverage,
                    transmission: &transmission,
                };
                surfaces.trace(options, &link, seen)
            }
        };
        for loop_idx in from..to {
            for slot in 0..config.tx.len() {
                let mut at = |now_s: f64| -> Result<Vec<Scatterer>, SimError> {
                    scene.positions_at(now_s, centre, options.min_range_m, &mut positions)?;
                    let seen = (&coverage[..], &transmission);
                    let mut found = scatterers(&link, scene, seed, &positions, &triangles, seen);
                    let points = points.iter();
                    found.extend(points.map(|point| point_scatterer(&link, point, now_s)));
                    for bounce in &bounces {
                        let states = surfaces.states(bounce, &link, &positions, &triangles);
                        let phasor = surfaces.phasor(bounce.facet);
                        let phasor = Complex64::new(f64::from(phasor.re), f64::from(phasor.im));
                        found.extend(bounce.paths().map(|path| {
                            let state = states[path];
                            let phases_rad =
                                state.corner_path_m.map(|p| TAU / link.wavelength_m * p);
                            Scatterer {
                                seen_by_tx: state.seen_by_tx + link.array_centre_m,
                                seen_by_rx: state.seen_by_rx + link.array_centre_m,
                                amplitude: f64::from(state.coherent)
                                    * divided_difference(phases_rad)
                                    + f64::from(state.rough) * phasor,
                            }
                        }));
                    }
                    Ok(found)
                };
                let now_s = time_s + chirp_time_s(config, loop_idx, slot);
                let scatterers = at(now_s)?;
                let (before, after) = (at(now_s - RATE_STEP_S)?, at(now_s + RATE_STEP_S)?);
                let middle_m = |s: &Scatterer| {
                    s.seen_by_tx.distance(link.array_centre_m)
                        + s.seen_by_rx.distance(link.array_centre_m)
                };
                let rates: Vec<f64> = before
                    .iter()
                    .zip(&after)
                    .map(|(b, a)| {
                        (middle_m(a) - middle_m(b)) / (2.0 * RATE_STEP_S * SPEED_OF_LIGHT_MPS)
                    })
                    .collect();
                for rx_idx in 0..config.rx.len() {
                    let chirp = loop_idx * config.tx.len() + slot;
                    let start = (chirp * config.rx.len() + rx_idx) * config.n_samples;
                    let samples = &mut cube.data[start..start + config.n_samples];
                    let mut sum = vec![Complex64::ZERO; config.n_samples];
                    for tx_idx in 0..config.tx.len() {
                        let weight = config.tx_weight(slot, tx_idx);
                        if weight != 0.0 {
                            let echoes = (&scatterers[..], &rates[..]);
                            add_echoes(config, echoes, tx_idx, rx_idx, weight, &mut sum);
                        }
                    }
                    for (sample, value) in samples.iter_mut().zip(sum) {
                        *sample = num_complex::Complex32::new(value.re as f32, value.im as f32);
                    }
                }
            }
        }
    }
    Ok(())
}

/// Half of the interval over which the reference measures the rate of a delay, s. It corresponds to half a millimetre
/// of motion at 5 m/s, far above the resolution of f32 positions.
const RATE_STEP_S: f64 = 1e-4;

/// A phase centre and its complex amplitude.
struct Scatterer {
    /// Apparent positions for transmitters and receivers in the radar frame, m. They are equal unless there are
    /// mirrors.
    seen_by_tx: DVec3,
    seen_by_rx: DVec3,
    /// sqrt(W).
    amplitude: Complex64,
}

fn scatterers(
    link: &Link,
    scene: &Scene<'_>,
    seed: u64,
    positions: &[Vec3],
    triangles: &[[u32; 3]],
    (coverage, transmission): (&[f32], &ScreenTransmission),
) -> Vec<Scatterer> {
    let mut out = Vec::new();
    let mut first = 0;
    for (surface_idx, surface) in scene.surfaces.iter().enumerate() {
        let reflection = Reflection::new(surface.material(), link.wavelength_m);
        let phases = FacetPhases::new(seed, surface_idx);
        for facet in 0..surface.triangles().len() {
            let share = coverage[first + facet];
            if share == 0.0 {
                continue;
            }
            let corners = triangles[first + facet]
                .map(|i| positions[i as usize].as_dvec3() - link.array_centre_m);
            let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
            // The IF phase grows with range (convention of the radar page): the field's
            // exp(-2jkr), conjugated.
            let phases_rad =
                corners.map(|p| 2.0 * TAU / link.wavelength_m * (p.length() - middle.length()));
            let (coherent, rough) =
                facet_gains(link, &reflection, corners.map(|p| p.as_vec3()), share);
            let phasor = phases.phasor(facet);
            let phasor = Complex64::new(f64::from(phasor.re), f64::from(phasor.im));
            let amplitude =
                f64::from(coherent) * divided_difference(phases_rad) + f64::from(rough) * phasor;
            let amplitude = amplitude * f64::from(transmission.amplitude(first + facet));
            out.push(Scatterer {
                seen_by_tx: middle + link.array_centre_m,
                seen_by_rx: middle + link.array_centre_m,
                amplitude,
            });
        }
        first += surface.triangles().len();
    }
    out
}

fn point_scatterer(link: &Link, point: &PointTarget, now_s: f64) -> Scatterer {
    let position = point.position_at(now_s);
    let amplitude =
        point.rcs_m2.sqrt() * f64::from(link.amplitude((position - link.array_centre_m).as_vec3()));
    Scatterer {
        seen_by_tx: position,
        seen_by_rx: position,
        amplitude: amplitude.into(),
    }
}

/// Adds the signal that one receiver records from one transmitter in a chirp, for scatterers and the rates of their
/// delays (s/s).
///
/// Within the chirp a changing delay rotates the carrier phase, f_c tau' (t - t_c). Its effect on the sweep, S tau' (t
/// - t_c)^2, is neglected: 0.01 rad at the ends of the chirp for 4.5 m/s and the reference radar.
fn add_echoes(
    config: &RadarConfig,
    (scatterers, rates): (&[Scatterer], &[f64]),
    tx_idx: usize,
    rx_idx: usize,
    weight: f64,
    out: &mut [Complex64],
) {
    let antenna = |a: radarllm_base::radar_config::Antenna| DVec3::new(a.x_m, 0.0, a.z_m);
    let (tx, rx) = (antenna(config.tx[tx_idx]), antenna(config.rx[rx_idx]));
    let centre_s = config.adc_start_s + (config.n_samples / 2) as f64 / config.sample_rate_hz;
    let centre_hz = config.start_hz + config.slope_hz_per_s * centre_s;
    for (scatterer, rate) in scatterers.iter().zip(rates) {
        let amplitude = weight * scatterer.amplitude;
        let path_m = scatterer.seen_by_tx.distance(tx) + scatterer.seen_by_rx.distance(rx);
        let tau_s = path_m / SPEED_OF_LIGHT_MPS;
        let slope = config.slope_hz_per_s;
        for (n, sample) in out.iter_mut().enumerate() {
            let t = config.adc_start_s + n as f64 / config.sample_rate_hz;
            let turns = (config.start_hz + slope * t - 0.5 * slope * tau_s) * tau_s
                + centre_hz * rate * (t - centre_s);
            *sample += amplitude * Complex64::from_polar(1.0, TAU * turns.fract());
        }
    }
}
