//! Detection on a Capon map of range and azimuth, as in the firmware of TI's 3D people tracking.
//!
//! For every range bin, the covariance of the virtual antennas over a frame's loops gives the power from each direction
//! by Capon's method (minimum variance distortionless response; Capon, Proc. IEEE 1969):
//! `P = 1 / (a^H R^-1 a)` with the steering vector `a` and the covariance `R`, whose diagonal is loaded. It separates
//! directions that the Fourier transform over eight antennas does not. Two passes of CFAR select cells: along range, and
//! then along azimuth, where only local maxima pass. Elevation is the maximum of a second Capon spectrum over all
//! antennas, and velocity that of the Doppler spectrum of the beam `R^-1 a`.
//!
//! The covariance is computed from the Doppler spectra: by Parseval's theorem it is that of the windowed loops. Static
//! echoes must have been removed, or they dominate it.

use std::f64::consts::TAU;

use num_complex::Complex64;
use radarllm_base::{RadarConfig, RadarPoint};

use crate::{
    array::{Element, VirtualArray, elements},
    direction::DirectionFinder,
    error::DspError,
    spectrum::{Spectrum, signed_doppler},
};

/// Options of the detection on a Capon map.
#[derive(Clone, Debug, PartialEq)]
pub struct CaponDetection {
    /// Azimuths of the map.
    pub azimuth: CaponScan,
    /// Elevations; all points have elevation 0 if absent.
    pub elevation: Option<CaponScan>,
    /// First pass, along range.
    pub range_cfar: MapCfar,
    /// Second pass, along azimuth; local maxima pass if absent.
    pub azimuth_cfar: Option<MapCfar>,
    /// Smallest power of a cell relative to the strongest azimuth of its range bin, 0..=1.
    pub sidelobe: f64,
    /// Step to which azimuth and elevation of a point are rounded, rad.
    pub angle_step_rad: f64,
}

/// Directions that a Capon spectrum scans.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CaponScan {
    /// Largest angle to either side, degrees, below 90.
    pub limit_deg: f64,
    /// Step, degrees.
    pub step_deg: f64,
    /// Addition to the diagonal of the covariance, relative to its mean.
    pub loading: f64,
}

/// A CFAR pass over the powers of the map. The noise is the smaller of the means of the training cells on both sides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MapCfar {
    /// Cells at the lower and the upper end that are never detected.
    pub skip: [usize; 2],
    /// Training cells on each side.
    pub train: usize,
    /// Guard cells on each side.
    pub guard: usize,
    /// Smallest ratio of a detected power to the noise.
    pub threshold: f64,
}

impl MapCfar {
    /// Ratio of cell `i` to the noise around it, if it is detected.
    fn ratio(&self, n: usize, i: usize, power: impl Fn(usize) -> f64) -> Option<f64> {
        if i < self.skip[0] || i + self.skip[1] >= n {
            return None;
        }
        let mean = |cells: std::ops::Range<usize>| {
            let n = cells.len() as f64;
            (n > 0.0).then(|| cells.map(&power).sum::<f64>() / n)
        };
        let below = i.saturating_sub(self.guard);
        let above = (i + self.guard + 1).min(n);
        let sides = [
            mean(below.saturating_sub(self.train)..below),
            mean(above..(above + self.train).min(n)),
        ];
        let noise = sides.into_iter().flatten().reduce(f64::min)?;
        let ratio = power(i) / noise.max(f64::MIN_POSITIVE);
        (ratio > self.threshold).then_some(ratio)
    }
}

/// Plan and workspace of the detection.
pub(crate) struct CaponDetector {
    options: CaponDetection,
    wavelength_m: f64,
    /// Antennas of the azimuth row.
    row: Vec<Element>,
    /// All antennas.
    all: Vec<Element>,
    /// Direction cosines `u_x` of the map's azimuths, from the left.
    azimuths: Vec<f64>,
    /// Steering vectors of the azimuth row for them.
    steering: Vec<Vec<Complex64>>,
    /// Elevations, rad.
    elevations_rad: Vec<f64>,
    /// Powers `[range bin of the gate][azimuth]`.
    map: Vec<f64>,
}

impl CaponDetector {
    /// Plans for a valid radar.
    pub(crate) fn new(radar: &RadarConfig, options: &CaponDetection) -> Result<Self, DspError> {
        let fail = |problem: &str| {
            Err(DspError::Option {
                field: "capon",
                problem: problem.into(),
            })
        };
        for scan in [Some(options.azimuth), options.elevation]
            .into_iter()
            .flatten()
        {
            let is_valid = scan.limit_deg > 0.0
                && scan.limit_deg < 90.0
                && scan.step_deg >= 0.1
                && scan.step_deg <= scan.limit_deg
                && scan.loading > 0.0
                && scan.loading <= 1e3;
            if !is_valid {
                return fail(
                    "angles must be in 0..90 degrees with steps of at least 0.1, and the loading in 0..=1000",
                );
            }
        }
        for pass in [Some(options.range_cfar), options.azimuth_cfar]
            .into_iter()
            .flatten()
        {
            if pass.train == 0 || !(pass.threshold > 0.0 && pass.threshold < 1e6) {
                return fail("CFAR needs training cells and a threshold in 0..1e6");
            }
        }
        if !(0.0..=1.0).contains(&options.sidelobe)
            || !(0.0..=0.5).contains(&options.angle_step_rad)
        {
            return fail("`sidelobe` must be in 0..=1 and `angle_step_rad` in 0..=0.5");
        }
        let array = VirtualArray::new(radar);
        if !array.has_azimuth() {
            return fail("the radar does not measure azimuth");
        }
        let angles = |scan: CaponScan| {
            let n = (scan.limit_deg / scan.step_deg).floor() as i32;
            (-n..=n).map(move |i| (f64::from(i) * scan.step_deg).to_radians())
        };
        let elevation = options.elevation.filter(|_| array.has_elevation());
        let wavelength_m = radar.wavelength_m();
        let azimuths: Vec<f64> = angles(options.azimuth).map(f64::sin).collect();
        let of_row = |u_x: &f64| steering(wavelength_m, &array.azimuth_row, *u_x, 0.0);
        Ok(Self {
            options: options.clone(),
            wavelength_m,
            steering: azimuths.iter().map(of_row).collect(),
            azimuths,
            elevations_rad: elevation.map_or_else(|| vec![0.0], |scan| angles(scan).collect()),
            row: array.azimuth_row,
            all: elements(&radar.tx, &radar.rx),
            map: Vec::new(),
        })
    }

    /// Points of the frame in `spectrum`, strongest first, at most `max_points`.
    pub(crate) fn points(
        &mut self,
        spectrum: &Spectrum,
        directions: &DirectionFinder,
        velocity_step_mps: f64,
        max_points: usize,
    ) -> Vec<RadarPoint> {
        let frame = Frame {
            spectrum,
            directions,
        };
        self.fill_map(&frame);
        let (n_range, n_azimuth) = (spectrum.gate.len(), self.azimuths.len());
        let power = |bin: usize, k: usize| self.map[bin * n_azimuth + k];
        let mut found: Vec<(usize, usize, f64)> = Vec::new();
        for bin in 0..n_range {
            let strongest = (0..n_azimuth).map(|k| power(bin, k)).fold(0.0, f64::max);
            for k in 0..n_azimuth {
                let own = power(bin, k);
                let is_peak = (k == 0 || own > power(bin, k - 1))
                    && (k + 1 == n_azimuth || own >= power(bin, k + 1));
                if !is_peak || own <= 0.0 || own < self.options.sidelobe * strongest {
                    continue;
                }
                let along_range = self.options.range_cfar.ratio(n_range, bin, |i| power(i, k));
                let Some(ratio) = along_range else { continue };
                let second = self.options.azimuth_cfar;
                if second.is_none_or(|pass| pass.ratio(n_azimuth, k, |i| power(bin, i)).is_some()) {
                    found.push((bin, k, ratio));
                }
            }
        }
        found.sort_by(|a, b| b.2.total_cmp(&a.2).then((a.0, a.1).cmp(&(b.0, b.1))));
        found.truncate(max_points);
        let points = found.into_iter();
        points
            .filter_map(|(bin, k, ratio)| {
                self.point(&frame, bin, self.azimuths[k], ratio, velocity_step_mps)
            })
            .collect()
    }

    fn fill_map(&mut self, frame: &Frame) {
        self.map.clear();
        for bin in 0..frame.spectrum.gate.len() {
            let inverse = frame.inverse(bin, &self.row, self.options.azimuth.loading);
            let power = |a: &Vec<Complex64>| match &inverse {
                Some(inverse) => 1.0 / quadratic(inverse, a).max(f64::MIN_POSITIVE),
                None => 0.0,
            };
            self.map.extend(self.steering.iter().map(power));
        }
    }

    /// The point of a detected cell of the map: elevation and velocity.
    fn point(
        &self,
        frame: &Frame,
        bin: usize,
        u_x: f64,
        ratio: f64,
        velocity_step_mps: f64,
    ) -> Option<RadarPoint> {
        let loading = self
            .options
            .elevation
            .unwrap_or(self.options.azimuth)
            .loading;
        let inverse = frame.inverse(bin, &self.all, loading)?;
        let elevations = self.elevations_rad.iter().map(|elevation_rad| {
            let a = steering(self.wavelength_m, &self.all, u_x, elevation_rad.sin());
            (*elevation_rad, quadratic(&inverse, &a), a)
        });
        let (elevation_rad, _, a) = elevations.min_by(|a, b| a.1.total_cmp(&b.1))?;
        let weights = product(&inverse, &a);
        let n_doppler = frame.spectrum.n_doppler();
        let of_beam = |d: usize| {
            let beam = self.all.iter().zip(&weights);
            let sum: Complex64 = beam.map(|(e, w)| w.conj() * frame.value(bin, *e, d)).sum();
            sum.norm_sqr()
        };
        let powers: Vec<f64> = (0..n_doppler).map(of_beam).collect();
        let doppler = (0..n_doppler).max_by(|a, b| powers[*a].total_cmp(&powers[*b]))?;
        let velocity_mps = signed_doppler(doppler, n_doppler) as f64 * velocity_step_mps;
        let step = self.options.angle_step_rad;
        let rounded = |angle_rad: f64| match step > 0.0 {
            true => (angle_rad / step).round() * step,
            false => angle_rad,
        };
        let azimuth_rad = rounded((u_x / elevation_rad.cos()).clamp(-1.0, 1.0).asin());
        let elevation_rad = rounded(elevation_rad);
        let range_m = (frame.spectrum.gate.start + bin) as f64 * frame.spectrum.range_step_m;
        Some(RadarPoint {
            x_m: (range_m * elevation_rad.cos() * azimuth_rad.sin()) as f32,
            y_m: (range_m * elevation_rad.cos() * azimuth_rad.cos()) as f32,
            z_m: (range_m * elevation_rad.sin()) as f32,
            range_m: range_m as f32,
            velocity_mps: velocity_mps as f32,
            intensity_db: (10.0 * ratio.log10()) as f32,
        })
    }
}

/// Phases of a far echo at the antennas; see [`VirtualArray`].
fn steering(wavelength_m: f64, elements: &[Element], u_x: f64, u_z: f64) -> Vec<Complex64> {
    let of = |e: &Element| Complex64::cis(-TAU / wavelength_m * (e.x_m * u_x + e.z_m * u_z));
    elements.iter().map(of).collect()
}

/// The spectra of a frame.
struct Frame<'a> {
    spectrum: &'a Spectrum,
    directions: &'a DirectionFinder,
}

impl Frame<'_> {
    fn value(&self, bin: usize, element: Element, doppler: usize) -> Complex64 {
        let n_doppler = self.spectrum.n_doppler();
        let value = self
            .spectrum
            .value(element.channel, bin * n_doppler + doppler);
        let value = value
            * self
                .directions
                .tdm_phase(element.channel, signed_doppler(doppler, n_doppler));
        Complex64::new(f64::from(value.re), f64::from(value.im))
    }

    /// Inverse of the loaded covariance of the antennas in a range bin; `None` without any power.
    fn inverse(&self, bin: usize, elements: &[Element], loading: f64) -> Option<Vec<Complex64>> {
        let n = elements.len();
        let mut covariance = vec![Complex64::ZERO; n * n];
        let n_doppler = self.spectrum.n_doppler();
        for doppler in 0..n_doppler {
            let x: Vec<Complex64> = elements
                .iter()
                .map(|e| self.value(bin, *e, doppler))
                .collect();
            for (i, a) in x.iter().enumerate() {
                for (j, b) in x.iter().enumerate() {
                    covariance[i * n + j] += a * b.conj() / n_doppler as f64;
                }
            }
        }
        let trace: f64 = (0..n).map(|i| covariance[i * n + i].re).sum();
        if trace <= 0.0 {
            return None;
        }
        for i in 0..n {
            covariance[i * n + i] += loading * trace / n as f64;
        }
        inverse(covariance, n)
    }
}

/// Inverse of a Hermitian positive definite matrix `[n][n]` by Gauss-Jordan elimination, which needs no pivoting for such
/// matrices; `None` if rounding has made it singular.
fn inverse(mut matrix: Vec<Complex64>, n: usize) -> Option<Vec<Complex64>> {
    let mut out = vec![Complex64::ZERO; n * n];
    (0..n).for_each(|i| out[i * n + i] = Complex64::ONE);
    for pivot in 0..n {
        let scale = matrix[pivot * n + pivot].re;
        if !(scale > 0.0 && scale.is_finite()) {
            return None;
        }
        for m in [&mut matrix, &mut out] {
            m[pivot * n..][..n].iter_mut().for_each(|v| *v /= scale);
        }
        for row in (0..n).filter(|row| *row != pivot) {
            let factor = matrix[row * n + pivot];
            for m in [&mut matrix, &mut out] {
                for k in 0..n {
                    let above = m[pivot * n + k];
                    m[row * n + k] -= factor * above;
                }
            }
        }
    }
    Some(out)
}

/// M a of a square matrix.
fn product(matrix: &[Complex64], a: &[Complex64]) -> Vec<Complex64> {
    let row = |row: &[Complex64]| row.iter().zip(a).map(|(m, a)| m * a).sum();
    matrix.chunks_exact(a.len()).map(row).collect()
}

/// a^H M a of a Hermitian matrix, which is real.
fn quadratic(matrix: &[Complex64], a: &[Complex64]) -> f64 {
    let of = product(matrix, a);
    of.iter().zip(a).map(|(m, a)| (a.conj() * m).re).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_power_of_one_echo_in_noise_is_the_closed_form() {
        // R = s I + p a a^H has a^H R^-1 a = n / (s + n p) by the Sherman-Morrison formula.
        let (n, noise, power) = (8, 0.3, 5.0);
        let phase = |u_x: f64| -> Vec<Complex64> {
            let element = |i: usize| Complex64::cis(-TAU * 0.5 * i as f64 * u_x);
            (0..n).map(element).collect()
        };
        let a = phase(0.4);
        let mut covariance = vec![Complex64::ZERO; n * n];
        for i in 0..n {
            for j in 0..n {
                covariance[i * n + j] = power * a[i] * a[j].conj();
            }
            covariance[i * n + i] += noise;
        }
        let inverse = inverse(covariance.clone(), n).unwrap();
        let found = 1.0 / quadratic(&inverse, &a);
        let expected = (noise + n as f64 * power) / n as f64;
        assert!((found / expected - 1.0).abs() < 1e-9, "{found} {expected}");
        // Where the steering vector is orthogonal, only noise is left.
        let away = phase(0.4 + 2.0 / n as f64);
        let found = 1.0 / quadratic(&inverse, &away);
        assert!((found / (noise / n as f64) - 1.0).abs() < 1e-9, "{found}");
        // M M^-1 = I.
        for i in 0..n {
            let column: Vec<Complex64> = (0..n).map(|j| inverse[j * n + i]).collect();
            for (j, v) in product(&covariance, &column).iter().enumerate() {
                let expected = if i == j { 1.0 } else { 0.0 };
                assert!((v - expected).norm() < 1e-9);
            }
        }
        assert_eq!(super::inverse(vec![Complex64::ZERO; 4], 2), None);
    }

    #[test]
    fn the_smaller_side_is_the_noise_and_ends_are_skipped() {
        let pass = MapCfar {
            skip: [2, 1],
            train: 2,
            guard: 1,
            threshold: 4.0,
        };
        let mut powers = [1.0; 10];
        powers[5] = 8.0;
        powers[8] = 100.0;
        let ratio = |powers: &[f64], i| pass.ratio(powers.len(), i, |i| powers[i]);
        // The mean above is 50.5, the one below is 1.
        assert_eq!(ratio(&powers, 5), Some(8.0));
        powers[0] = 100.0;
        powers[9] = 1000.0;
        assert_eq!((ratio(&powers, 0), ratio(&powers, 9)), (None, None));
        powers[5] = 4.0;
        assert_eq!(ratio(&powers, 5), None);
    }
}
