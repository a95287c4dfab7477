//! Rain and smoke: the attenuation of every path, and the backscatter of falling drops.
//!
//! **Attenuation by rain** is the specific attenuation k R^alpha of Recommendation ITU-R P.838-3, as the mean of both
//! linear polarisations. **Backscatter** is computed by Mie theory (Bohren and Huffman, *Absorption and Scattering of
//! Light by Small Particles*, 1983) for water spheres at 10 degrees C (Liebe, Hufford and Manabe, Int. J. Infrared
//! Millim. Waves 12, 1991), with the drop size distribution of Marshall and Palmer, J. Meteor. 5, 1948. Drops fall
//! vertically at the speeds of Atlas, Srivastava and Sekhon, Rev. Geophys. 11, 1973. There is no wind.
//!
//! **Equivalent drops.** A cubic metre of rain holds thousands of drops. They are replaced by [`DROPS_PER_CELL`] points
//! in every range resolution cell, drawn anew for every frame, with the mean power of all drops of the cell. The points
//! are uniform in range within the cell, and their angles follow the density of the two-way pattern. The cross section
//! of each point compensates for that density. Its speed is that of a drop drawn with a probability proportional to its
//! share of the backscatter. The mean power in every range, angle and Doppler cell is therefore that of the rain. The
//! amplitude of a cell is nearly Gaussian, as it is for many drops. Frames are independent, while real drops remain in
//! the beam for two or three frames. Not modelled: rain nearer than [`NEAREST_M`], where a cell holds few drops, rain
//! beyond the unambiguous range, and shadows of and on the rain (points neither cast shadows nor are shadowed).
//!
//! **Smoke** particles are far smaller than the wavelength, so that Rayleigh's formulas hold. Their permittivity is
//! generally unknown. [`Weather::smoke_db_per_m`] is therefore the maximum attenuation for particles of any
//! permittivity with a real part of at least 1. The echo of smoke is at most [`Weather::smoke_backscatter_per_m`]. It
//! is below thermal noise and is not modelled. Turbulence of hot air, which also disturbs phases, is not simulated.

use std::f64::consts::{LN_2, LN_10, PI};

use glam::DVec3;
use num_complex::Complex64;
use radarllm_base::{
    RadarConfig, SPEED_OF_LIGHT_MPS,
    random::{normal_polar, nth},
    seed::derive_seed,
};

use crate::error::SimError;
use crate::link::Link;
use crate::motion::chirp_time_s;
use crate::scene::PointTarget;
use crate::simulator::SimOptions;

/// Number of points that represent the drops of a range resolution cell.
pub const DROPS_PER_CELL: usize = 8;
/// Minimum range of simulated rain, m.
pub const NEAREST_M: f64 = 1.0;

/// Diameters of the drop size distribution: minimum, maximum and step, mm.
const DROPS_MM: [f64; 3] = [0.1, 6.0, 0.02];
/// Terminal speed that the largest drops approach, m/s.
const FASTEST_MPS: f64 = 9.65;
/// Temperature of rain, K.
const RAIN_K: f64 = 283.15;
/// Density of smoke particles, kg/m^3. The value is that of tar droplets. Soot is denser and therefore scatters less
/// per gram.
const SMOKE_KG_PER_M3: f64 = 1000.0;
/// Diameter of smoke particles, m. The value is at the upper end of the sizes that fires produce.
const SMOKE_M: f64 = 1e-6;

/// Rain and smoke in the air. The default is clear air, which takes no computing time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Weather {
    /// Rain rate, mm/h, 0..=200.
    pub rain_mm_per_h: f64,
    /// Mass of smoke particles in the air, g/m^3, 0..=100.
    pub smoke_g_per_m3: f64,
}

impl Weather {
    /// Checks the fields.
    ///
    /// # Errors
    /// Returns an error that names the first field that is out of range.
    pub fn validate(&self) -> Result<(), SimError> {
        for (option, value, max) in [
            ("rain_mm_per_h", self.rain_mm_per_h, 200.0),
            ("smoke_g_per_m3", self.smoke_g_per_m3, 100.0),
        ] {
            if !(0.0..=max).contains(&value) {
                return Err(SimError::Option {
                    option,
                    problem: format!("{value} is not in 0..={max}"),
                });
            }
        }
        Ok(())
    }

    /// Returns the one-way power attenuation, dB/m.
    pub fn db_per_m(&self, frequency_hz: f64) -> f64 {
        rain_db_per_m(frequency_hz, self.rain_mm_per_h) + self.smoke_db_per_m(frequency_hz)
    }

    /// Returns the maximum attenuation by smoke, dB/m. It is the absorption 6 pi f Im(-K) / lambda of the volume
    /// fraction f (Bohren and Huffman, eq. 5.11) with K = (eps - 1) / (eps + 2). The magnitude of the imaginary part of
    /// K is at most 1/2 if the real part of eps is at least 1. The particle size has no influence.
    pub fn smoke_db_per_m(&self, frequency_hz: f64) -> f64 {
        let wavelength_m = SPEED_OF_LIGHT_MPS / frequency_hz;
        let volume_fraction = 1e-3 * self.smoke_g_per_m3 / SMOKE_KG_PER_M3;
        10.0 / LN_10 * 6.0 * PI * volume_fraction * 0.5 / wavelength_m
    }

    /// Returns the maximum backscatter of smoke, m^2/m^3: pi^5 |K|^2 N D^6 / lambda^4 with |K| = 1 and particles of one
    /// micrometre diameter.
    pub fn smoke_backscatter_per_m(&self, frequency_hz: f64) -> f64 {
        let wavelength_m = SPEED_OF_LIGHT_MPS / frequency_hz;
        let volume_fraction = 1e-3 * self.smoke_g_per_m3 / SMOKE_KG_PER_M3;
        PI.powi(5) * 6.0 / PI * volume_fraction * SMOKE_M.powi(3) / wavelength_m.powi(4)
    }
}

/// Returns the specific attenuation of rain, dB/m: k R^alpha of P.838-3, valid from 1 GHz to 1 THz, as the mean of
/// horizontal and vertical polarisation (equations 4 and 5 of P.838-3 at a tilt of 45 degrees).
pub fn rain_db_per_m(frequency_hz: f64, rain_mm_per_h: f64) -> f64 {
    if rain_mm_per_h <= 0.0 {
        return 0.0;
    }
    let [[k_h, alpha_h], [k_v, alpha_v]] = p838(frequency_hz);
    let k = 0.5 * (k_h + k_v);
    let alpha = 0.5 * (k_h * alpha_h + k_v * alpha_v) / k;
    1e-3 * k * rain_mm_per_h.powf(alpha)
}

/// Returns k and alpha for horizontal, then for vertical polarisation: P.838-3, equations 2 and 3, Tables 1 to 4.
fn p838(frequency_hz: f64) -> [[f64; 2]; 2] {
    let log_f = (frequency_hz * 1e-9).log10();
    let sum = |terms: &[[f64; 3]], m: f64, c: f64| {
        let bells = terms
            .iter()
            .map(|[a, b, c]| a * (-((log_f - b) / c).powi(2)).exp());
        bells.sum::<f64>() + m * log_f + c
    };
    let k_h = [
        [-5.33980, -0.10008, 1.13098],
        [-0.35351, 1.26970, 0.45400],
        [-0.23789, 0.86036, 0.15354],
        [-0.94158, 0.64552, 0.16817],
    ];
    let k_v = [
        [-3.80595, 0.56934, 0.81061],
        [-3.44965, -0.22911, 0.51059],
        [-0.39902, 0.73042, 0.11899],
        [0.50167, 1.07319, 0.27195],
    ];
    let alpha_h = [
        [-0.14318, 1.82442, -0.55187],
        [0.29591, 0.77564, 0.19822],
        [0.32177, 0.63773, 0.13164],
        [-5.37610, -0.96230, 1.47828],
        [16.1721, -3.29980, 3.43990],
    ];
    let alpha_v = [
        [-0.07771, 2.33840, -0.76284],
        [0.56727, 0.95545, 0.54039],
        [-0.20238, 1.14520, 0.26809],
        [-48.2991, 0.791669, 0.116226],
        [48.5833, 0.791459, 0.116479],
    ];
    [
        [
            10_f64.powf(sum(&k_h, -0.18961, 0.71147)),
            sum(&alpha_h, 0.67849, -1.95537),
        ],
        [
            10_f64.powf(sum(&k_v, -0.16398, 0.63297)),
            sum(&alpha_v, -0.053739, 0.83433),
        ],
    ]
}

/// Falling drops in front of one radar.
pub(crate) struct Rain {
    /// Volume reflectivity, m^2/m^3.
    backscatter_per_m: f64,
    /// Cumulative share of the backscatter from drops up to each speed, m/s.
    speeds: Vec<(f64, f64)>,
    /// Standard deviations of the two-way power pattern, azimuth and elevation, rad.
    spread_rad: [f64; 2],
    centre_m: DVec3,
    /// Time from the start of a frame to its middle, s.
    middle_s: f64,
    nearest_m: f64,
    farthest_m: f64,
    cell_m: f64,
}

impl Rain {
    /// Returns `None` if there is no rain.
    pub(crate) fn new(options: &SimOptions, config: &RadarConfig, link: &Link) -> Option<Self> {
        let rate = options.weather.rain_mm_per_h;
        if rate <= 0.0 {
            return None;
        }
        let frequency_hz = link.centre_hz;
        let middle_s = chirp_time_s(config, config.n_loops / 2, 0);
        let mut sum: f64 = 0.0;
        let mut speeds: Vec<(f64, f64)> = drop_sizes(rate)
            .map(|(diameter_mm, per_m3)| {
                sum += per_m3 * drop_sections_m2(diameter_mm, frequency_hz).back;
                (sum, fall_mps(diameter_mm))
            })
            .collect();
        for (share, _) in &mut speeds {
            *share /= sum;
        }
        // exp(-2 ln 2 (angle / half width)^2): at the half width, the power is halved on each way.
        let spread = |half_width: f64| half_width / (4.0 * LN_2).sqrt();
        Some(Self {
            backscatter_per_m: sum,
            speeds,
            spread_rad: [
                spread(config.azimuth_half_width_rad),
                spread(config.elevation_half_width_rad),
            ],
            centre_m: link.array_centre_m,
            middle_s,
            // No drop can reach the antenna during the frame.
            nearest_m: NEAREST_M.max(options.min_range_m + 2.0 * FASTEST_MPS * middle_s),
            farthest_m: config.max_range_m(),
            cell_m: config.range_resolution_m(),
        })
    }

    /// Writes the equivalent drops of the frame that starts at `time_s`.
    pub(crate) fn draw(&self, seed: u64, time_s: f64, out: &mut Vec<PointTarget>) {
        out.clear();
        let middle_s = time_s + self.middle_s;
        let n_cells = ((self.farthest_m - self.nearest_m) / self.cell_m).floor();
        let n_cells = n_cells.max(0.0) as usize;
        let stream = nth(derive_seed(seed, "rain"), (middle_s + 0.0).to_bits());
        let mut index = 0;
        // Uniform numbers in the open interval (0, 1).
        let mut uniform = || {
            index += 1;
            ((nth(stream, index) >> 12) as f64 + 0.5) / (1_u64 << 52) as f64
        };
        for cell in 0..n_cells {
            for _ in 0..DROPS_PER_CELL {
                let range_m = self.nearest_m + (cell as f64 + uniform()) * self.cell_m;
                let (radius, angle_rad) = normal_polar(uniform(), uniform());
                let (sin, cos) = angle_rad.sin_cos();
                let speed = uniform();
                let angles = [radius * cos, radius * sin];
                let [azimuth, elevation] = [0, 1].map(|i| angles[i] * self.spread_rad[i]);
                // The Gaussian model of the pattern is cut off at the plane of the array.
                if azimuth.abs() >= 0.5 * PI || elevation.abs() >= 0.5 * PI {
                    continue;
                }
                let density_per_sr = (-0.5 * radius * radius).exp()
                    / (2.0 * PI * self.spread_rad[0] * self.spread_rad[1] * elevation.cos());
                let volume_m3 =
                    self.cell_m * range_m * range_m / (density_per_sr * DROPS_PER_CELL as f64);
                let (sin_azimuth, cos_azimuth) = azimuth.sin_cos();
                let (sin_elevation, cos_elevation) = elevation.sin_cos();
                let direction = DVec3::new(
                    sin_azimuth * cos_elevation,
                    cos_azimuth * cos_elevation,
                    sin_elevation,
                );
                let at = self.speeds.partition_point(|s| s.0 < speed);
                let velocity_mps = -DVec3::Z * self.speeds[at.min(self.speeds.len() - 1)].1;
                out.push(PointTarget {
                    position_m: self.centre_m + range_m * direction - middle_s * velocity_mps,
                    velocity_mps,
                    rcs_m2: self.backscatter_per_m * volume_m3,
                });
            }
        }
    }
}

/// Returns the volume reflectivity of rain, m^2/m^3.
pub fn rain_backscatter_per_m(frequency_hz: f64, rain_mm_per_h: f64) -> f64 {
    if rain_mm_per_h <= 0.0 {
        return 0.0;
    }
    drop_sizes(rain_mm_per_h)
        .map(|(diameter_mm, per_m3)| per_m3 * drop_sections_m2(diameter_mm, frequency_hz).back)
        .sum()
}

/// Drop size distribution of Marshall and Palmer: diameters, mm, and the number of drops per diameter step, 1/m^3.
fn drop_sizes(rain_mm_per_h: f64) -> impl Iterator<Item = (f64, f64)> {
    let [from, to, step] = DROPS_MM;
    let slope_per_mm = 4.1 * rain_mm_per_h.powf(-0.21);
    let count = ((to - from) / step).round() as usize;
    (0..count).map(move |i| {
        let diameter_mm = from + (i as f64 + 0.5) * step;
        (
            diameter_mm,
            8000.0 * (-slope_per_mm * diameter_mm).exp() * step,
        )
    })
}

/// Terminal speed near the ground, m/s, by Atlas, Srivastava and Sekhon.
fn fall_mps(diameter_mm: f64) -> f64 {
    (FASTEST_MPS - 10.3 * (-0.6 * diameter_mm).exp()).max(0.0)
}

/// Relative permittivity of water, eps' - j eps'': the double Debye model of Liebe et al.
fn water_permittivity(frequency_hz: f64, temperature_k: f64) -> Complex64 {
    let warmth = 1.0 - 300.0 / temperature_k;
    let low = 77.66 - 103.3 * warmth;
    let (middle, high) = (0.0671 * low, 3.52 + 7.52 * warmth);
    let first_hz = 1e9 * (20.20 + 146.4 * warmth + 316.0 * warmth * warmth);
    let relaxation =
        |strength: f64, at_hz: f64| strength / Complex64::new(1.0, frequency_hz / at_hz);
    high + relaxation(low - middle, first_hz) + relaxation(middle - high, 39.8 * first_hz)
}

fn drop_sections_m2(diameter_mm: f64, frequency_hz: f64) -> Sections {
    let size = PI * 1e-3 * diameter_mm * frequency_hz / SPEED_OF_LIGHT_MPS;
    let area_m2 = 0.25 * PI * (1e-3 * diameter_mm).powi(2);
    let index = water_permittivity(frequency_hz, RAIN_K).sqrt();
    let efficiency = mie(size, index);
    Sections {
        extinction: efficiency.extinction * area_m2,
        back: efficiency.back * area_m2,
    }
}

/// Extinction and radar cross sections of a sphere. The unit is that of the caller.
struct Sections {
    extinction: f64,
    back: f64,
}

/// Mie efficiencies (cross sections divided by the geometric cross section) of a sphere whose circumference is `size`
/// wavelengths and whose refractive index is `index` (n - j kappa): Bohren and Huffman, section 4.4, with the
/// logarithmic derivative by downward recurrence.
fn mie(size: f64, index: Complex64) -> Sections {
    // The time dependence of Bohren and Huffman has n + j kappa.
    let inside = index.conj() * size;
    let n_terms = (size + 4.0 * size.cbrt() + 2.0).ceil() as usize;
    let n_down = n_terms.max(inside.norm().ceil() as usize) + 16;
    let mut derivative = vec![Complex64::ZERO; n_down + 1];
    for n in (1..=n_down).rev() {
        let step = n as f64 / inside;
        derivative[n - 1] = step - 1.0 / (derivative[n] + step);
    }
    let (mut psi, mut psi_before) = (size.sin(), size.cos());
    let (mut chi, mut chi_before) = (size.cos(), -size.sin());
    let (mut extinction, mut back) = (0.0, Complex64::ZERO);
    for (n, derivative) in derivative.into_iter().enumerate().take(n_terms + 1).skip(1) {
        let order = n as f64;
        let factor = (2.0 * order - 1.0) / size;
        (psi, psi_before) = (factor * psi - psi_before, psi);
        (chi, chi_before) = (factor * chi - chi_before, chi);
        let (xi, xi_before) = (
            Complex64::new(psi, -chi),
            Complex64::new(psi_before, -chi_before),
        );
        let part = |by: Complex64| (by * psi - psi_before) / (by * xi - xi_before);
        let a = part(derivative / index.conj() + order / size);
        let b = part(derivative * index.conj() + order / size);
        let weight = 2.0 * order + 1.0;
        extinction += weight * (a + b).re;
        let sign = if n % 2 == 0 { 1.0 } else { -1.0 };
        back += sign * weight * (a - b);
    }
    Sections {
        extinction: 2.0 / (size * size) * extinction,
        back: back.norm_sqr() / (size * size),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mie_has_the_published_values() {
        // Bohren and Huffman, Appendix A: index 1.55, radius 0.525 um, wavelength 0.6328 um.
        let found = mie(2.0 * PI * 0.525 / 0.6328, Complex64::new(1.55, 0.0));
        assert!(
            (found.extinction - 3.10543).abs() < 1e-4,
            "{}",
            found.extinction
        );
        assert!((found.back - 2.92534).abs() < 1e-4, "{}", found.back);
        // Rayleigh limit: 4 x^4 |K|^2 for backscatter, 4 x Im K for absorption.
        let water = water_permittivity(77e9, RAIN_K);
        let k = (water - 1.0) / (water + 2.0);
        let found = mie(1e-3, water.sqrt());
        assert!((found.back / (4e-12 * k.norm_sqr()) - 1.0).abs() < 1e-4);
        assert!((found.extinction / (4e-3 * -k.im) - 1.0).abs() < 1e-3);
        // The static permittivity of water is 87.9 at 0 degrees C and 80 at 20 degrees C.
        assert!((water_permittivity(1e6, 293.15).re - 80.0).abs() < 0.5);
    }

    #[test]
    fn attenuation_is_the_recommendation_s() {
        // P.838-3, Table 5: kH, alphaH, kV, alphaV.
        for (ghz, table) in [
            (25.0, [0.1571, 0.9991, 0.1533, 0.9491]),
            (60.0, [0.8606, 0.7656, 0.8515, 0.7486]),
            (80.0, [1.1704, 0.7115, 1.1668, 0.7021]),
        ] {
            let [h, v] = p838(ghz * 1e9);
            for (found, expected) in [h[0], h[1], v[0], v[1]].iter().zip(table) {
                assert!((found - expected).abs() < 1e-4, "{ghz}: {found} {expected}");
            }
        }
        assert_eq!(Weather::default().db_per_m(77e9), 0.0);
        // Compare with the extinction of the drops. The recommendation is based on other drop sizes and temperatures,
        // so that a difference of a third is expected. A wrong unit or a factor of 2 would exceed it.
        for (ghz, rate) in [
            (24.0, 10.0),
            (60.0, 25.0),
            (77.0, 5.0),
            (77.0, 25.0),
            (77.0, 100.0),
        ] {
            let sum: f64 = drop_sizes(rate)
                .map(|(d, n)| n * drop_sections_m2(d, ghz * 1e9).extinction)
                .sum();
            let ratio = 10.0 / LN_10 * sum / rain_db_per_m(ghz * 1e9, rate);
            println!(
                "{ghz} GHz, {rate} mm/h: {:.2} dB/km, drops {ratio:.2} of it, backscatter {:.1} dB m^2/m^3",
                1e3 * rain_db_per_m(ghz * 1e9, rate),
                10.0 * rain_backscatter_per_m(ghz * 1e9, rate).log10()
            );
            assert!(
                (0.7..1.4).contains(&ratio),
                "{ghz} GHz, {rate} mm/h: {ratio}"
            );
        }
    }

    #[test]
    fn smoke_is_next_to_nothing() {
        let smoke = Weather {
            smoke_g_per_m3: 1.0,
            ..Weather::default()
        };
        // Computed by hand: 10 / ln 10 * 3 pi * 1e-6 / 3.893 mm = 10.5 dB/km at 77 GHz.
        assert!((1e3 * smoke.smoke_db_per_m(77e9) - 10.51).abs() < 0.02);
        // Even the densest smoke allowed scatters less than the noise of a whole frame's coherent sum, in the nearest
        // and strongest cell.
        let config = RadarConfig::awr1843boost();
        let link = crate::link::Link::new(&config);
        let thick = Weather {
            smoke_g_per_m3: 100.0,
            ..Weather::default()
        };
        let [az, el] = [
            config.azimuth_half_width_rad,
            config.elevation_half_width_rad,
        ];
        let volume_m3 = config.range_resolution_m() * NEAREST_M.powi(2) * PI * az * el;
        let echo_w = link.amplitude_at_1m.powi(2) / NEAREST_M.powi(4)
            * thick.smoke_backscatter_per_m(link.centre_hz)
            * volume_m3;
        let n = (config.n_loops * config.tx.len() * config.rx.len() * config.n_samples) as f64;
        let below_db = 10.0 * (link.noise_w / n / echo_w).log10();
        assert!(below_db > 10.0, "{below_db}");
    }

    #[test]
    fn values_out_of_range_are_named() {
        for (weather, word) in [
            (
                Weather {
                    rain_mm_per_h: -1.0,
                    ..Weather::default()
                },
                "rain_mm_per_h",
            ),
            (
                Weather {
                    smoke_g_per_m3: f64::NAN,
                    ..Weather::default()
                },
                "smoke_g_per_m3",
            ),
        ] {
            let error = weather.validate().unwrap_err().to_string();
            assert!(error.contains(word), "{error}");
        }
    }

    /// Values from the first release's code. They must not change, because data sets depend on them.
    #[test]
    fn drops_never_change() {
        let config = RadarConfig::awr1843boost();
        let options = SimOptions {
            weather: Weather {
                rain_mm_per_h: 10.0,
                ..Weather::default()
            },
            ..SimOptions::default()
        };
        let rain = Rain::new(&options, &config, &crate::link::Link::new(&config)).unwrap();
        let mut drops = Vec::new();
        rain.draw(3, 0.2, &mut drops);
        let first = drops[0].position_m.to_array().map(f64::to_bits);
        let all = drops.iter().flat_map(|d| d.position_m.to_array());
        let all = all.fold(0, |sum: u64, v| sum.rotate_left(1) ^ v.to_bits());
        assert_eq!(
            (first, all),
            (
                [
                    13821665830241535075,
                    4606969770539499956,
                    4603903536866982002
                ],
                15652050466649233350
            )
        );
    }
}
