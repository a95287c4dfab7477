//! Scattering by one triangle: closed-form physical optics and a rough term with a phase fixed to the surface.

use std::f64::consts::PI;

use crate::link::exp2_of_negative;
use num_complex::{Complex32, Complex64};
use radarllm_base::{Material, random::nth, seed::derive_seed};

/// Second divided difference of `exp` at `j phi_0, j phi_1, j phi_2`: half the mean of
/// `exp(j phi)` over a triangle on which phi is linear with these values at the corners.
///
/// Gordon, *Far-field approximations to the Kirchhoff-Helmholtz representations of scattered fields*, IEEE T-AP 1975.
/// Exact vertex distances extend it to the near field.
pub fn divided_difference(mut phi: [f64; 3]) -> Complex64 {
    phi.sort_by(f64::total_cmp);
    let [a, b, c] = phi;
    if c - a < 1e-2 {
        let mean = (a + b + c) / 3.0;
        let squares: f64 = phi.iter().map(|p| (p - mean) * (p - mean)).sum();
        return Complex64::from_polar(0.5 - squares / 48.0, mean);
    }
    let first = |a: f64, b: f64| Complex64::from_polar(sinc(0.5 * (b - a)), 0.5 * (a + b));
    (first(b, c) - first(a, b)) / Complex64::new(0.0, c - a)
}

fn sinc(x: f64) -> f64 {
    if x.abs() < 1e-4 {
        1.0 - x * x / 6.0
    } else {
        x.sin() / x
    }
}

/// Scattering parameters of a material at one wavelength.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reflection {
    /// (4 sqrt(pi) / lambda) Gamma: PO field per `A cos(theta)` and divided difference, 1/m.
    pub coherent_per_m: f32,
    /// 2 (k sigma_h)^2: the coherent amplitude falls as exp(-this cos^2).
    pub roughness: f32,
    /// 2 sqrt(rho): rough field is this times `sqrt(A) cos(theta)`.
    pub rough: f32,
    /// |Gamma|, the amplitude that a smooth mirror of this material reflects.
    gamma: f32,
    /// One-way amplitude transmission, 0..=1.
    pub passes: f32,
}

impl Reflection {
    pub(crate) fn new(material: Material, wavelength_m: f64) -> Self {
        let k = 2.0 * PI / wavelength_m;
        let gamma = f64::from(material.power_reflection).sqrt();
        Self {
            coherent_per_m: (4.0 * PI.sqrt() / wavelength_m * gamma) as f32,
            roughness: (2.0 * (k * f64::from(material.roughness_m)).powi(2)) as f32,
            rough: 2.0 * material.rough_albedo.sqrt(),
            gamma: gamma as f32,
            passes: material.power_transmission.sqrt(),
        }
    }

    /// Amplitude reflection of a mirror at an angle of incidence, 0..=1.
    #[inline(always)]
    pub(crate) fn mirror(&self, cos: f32) -> f32 {
        self.gamma * exp2_of_negative(-self.roughness * std::f32::consts::LOG2_E * cos * cos)
    }

    /// [`Self::gains`] for two different directions, given the cosines of incidence and exit. The coherent term and its
    /// roughness use the mean of the cosines, the rough term their geometric mean. Equal cosines give [`Self::gains`].
    #[inline(always)]
    pub(crate) fn gains_between(&self, cos: [f32; 2], area: f32, coverage: f32) -> (f32, f32) {
        let mean = 0.5 * (cos[0] + cos[1]);
        let (coherent, _) = self.gains(mean * area, area, coverage);
        (
            coherent,
            self.rough * (area * coverage * cos[0] * cos[1]).sqrt(),
        )
    }

    /// Gains at one instant: `(coherent, rough)` in m, so that sqrt(sigma) =
    /// coherent * divided_difference + rough * exp(j psi).
    ///
    /// `area_cos` is `A cos(theta)`, m^2, signed; `coverage` the visible share.
    #[inline(always)]
    pub(crate) fn gains(&self, area_cos: f32, area: f32, coverage: f32) -> (f32, f32) {
        let cos = area_cos / area;
        let smooth = exp2_of_negative(-self.roughness * std::f32::consts::LOG2_E * cos * cos);
        // The coherent field is proportional to the visible area, and so is the incoherent power.
        let coherent = self.coherent_per_m * smooth * area_cos * coverage;
        (coherent, self.rough * (area * coverage).sqrt() * cos)
    }
}

/// Constant unit phasor of a facet: the phase of its rough term.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FacetPhases {
    surface_seed: u64,
}

impl FacetPhases {
    pub(crate) fn new(seed: u64, surface_idx: usize) -> Self {
        // The index is written in decimal without an allocation, because this runs in every frame.
        let mut digits = [0; 20];
        let mut first = digits.len();
        let mut rest = surface_idx;
        loop {
            first -= 1;
            digits[first] = b'0' + (rest % 10) as u8;
            rest /= 10;
            if rest == 0 {
                break;
            }
        }
        let name = std::str::from_utf8(&digits[first..]).unwrap_or_default();
        Self {
            surface_seed: derive_seed(derive_seed(seed, "facet phase"), name),
        }
    }

    #[inline]
    pub(crate) fn phase_turns(&self, facet_idx: usize) -> f32 {
        (nth(self.surface_seed, facet_idx as u64) >> 40) as f32 * (1.0 / (1u64 << 24) as f32)
    }

    pub(crate) fn phasor(&self, facet_idx: usize) -> Complex32 {
        Complex32::from_polar(1.0, std::f32::consts::TAU * self.phase_turns(facet_idx))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The definition, evaluated numerically: the integral over the unit simplex of exp(j phi).
    fn by_quadrature(phi: [f64; 3], n: usize) -> Complex64 {
        let mut sum = Complex64::ZERO;
        let h = 1.0 / n as f64;
        for i in 0..n {
            for j in 0..n - i {
                // Centroids of the two sub-triangles of each lattice cell, weight h^2 / 2.
                for (third, inside) in [(1.0 / 3.0, true), (2.0 / 3.0, j + 1 < n - i)] {
                    if inside {
                        let (s, t) = ((i as f64 + third) * h, (j as f64 + third) * h);
                        let p = phi[0] + s * (phi[1] - phi[0]) + t * (phi[2] - phi[0]);
                        sum += Complex64::from_polar(0.5 * h * h, p);
                    }
                }
            }
        }
        sum
    }

    #[test]
    fn divided_difference_is_the_integral_over_the_triangle() {
        for phi in [
            [0.0, 0.0, 0.0],
            [0.3, 0.3, 0.3],
            [1.0, 5.0, -3.0],
            [0.0, 8.0, 8.0],
            [2.0, 2.001, 2.003],
            [20.0, -3.0, 1.0],
        ] {
            let n = 600;
            let error = (divided_difference(phi) - by_quadrature(phi, n)).norm();
            // Mid-point rule: error below |phi|^2 h^2 / 24 (second derivative), here 5e-5 at most.
            let span = phi.iter().fold(1.0_f64, |m, p| m.max((p - phi[0]).abs()));
            assert!(
                error < span * span / (24.0 * (n * n) as f64) + 1e-9,
                "{phi:?}: {error}"
            );
        }
    }

    #[test]
    fn facet_phases_are_uniform_and_fixed() {
        let phases = FacetPhases::new(7, 0);
        let n = 10_000;
        let mean: Complex32 = (0..n).map(|i| phases.phasor(i)).sum::<Complex32>() / n as f32;
        // The mean of n unit phasors has an rms of 1/sqrt(n) = 0.01. The limit of 0.04 is four deviations.
        assert!(mean.norm() < 0.04, "{mean}");
        assert_eq!(phases.phasor(3), FacetPhases::new(7, 0).phasor(3));
        assert_ne!(phases.phasor(3), FacetPhases::new(7, 1).phasor(3));
        for surface_idx in [0, 9, 10, 305] {
            let name = surface_idx.to_string();
            assert_eq!(
                FacetPhases::new(7, surface_idx).surface_seed,
                derive_seed(derive_seed(7, "facet phase"), &name)
            );
        }
    }
}
