//! What walls, furniture and skin reflect, from published permittivities.
//!
//! Building materials: Recommendation ITU-R P.2040-2 (09/2021), Table 3: real part `a`, conductivity
//! `c f^d` S/m with f in GHz, valid to 100 GHz. Skin: the four-term Cole-Cole model of Gabriel, Lau
//! and Gabriel, *The dielectric properties of biological tissues: III*, Phys. Med. Biol. 41 (1996),
//! dry skin, whose slow terms no longer count at millimetre waves. Thick slabs are assumed: what
//! comes back from a wall's rear face is left out.

use num_complex::Complex64;

use crate::Material;

/// Vacuum permittivity, F/m (CODATA 2018).
const VACUUM_PERMITTIVITY_F_PER_M: f64 = 8.854_187_812_8e-12;

/// A substance with a name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Substance {
    /// Perfect conductor.
    Metal,
    /// Bare skin.
    Skin,
    /// Plasterboard or plaster, painted.
    Plaster,
    /// Concrete.
    Concrete,
    /// Wood.
    Wood,
    /// Glass.
    Glass,
}

impl Substance {
    /// All of them.
    pub const ALL: [Self; 6] = [
        Self::Metal,
        Self::Skin,
        Self::Plaster,
        Self::Concrete,
        Self::Wood,
        Self::Glass,
    ];

    /// Name in configuration files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Metal => "metal",
            Self::Skin => "skin",
            Self::Plaster => "plaster",
            Self::Concrete => "concrete",
            Self::Wood => "wood",
            Self::Glass => "glass",
        }
    }

    /// The substance of a name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|s| s.name() == name)
    }

    /// Relative permittivity, `eps' - j eps''`; `None` for a perfect conductor.
    pub fn permittivity(self, frequency_hz: f64) -> Option<Complex64> {
        let angular = std::f64::consts::TAU * frequency_hz;
        let building = |a: f64, c: f64, d: f64| {
            let conductivity = c * (frequency_hz * 1e-9).powf(d);
            Complex64::new(a, -conductivity / (angular * VACUUM_PERMITTIVITY_F_PER_M))
        };
        match self {
            Self::Metal => None,
            Self::Plaster => Some(building(2.73, 0.0085, 0.9395)),
            Self::Concrete => Some(building(5.24, 0.0462, 0.7822)),
            Self::Wood => Some(building(1.99, 0.0047, 1.0718)),
            Self::Glass => Some(building(6.31, 0.0036, 1.3394)),
            Self::Skin => {
                // (strength, relaxation time s, broadening); eps_infinity 4, 2e-4 S/m.
                let term = |strength: f64, tau_s: f64, alpha: f64| {
                    let x = Complex64::new(0.0, angular * tau_s).powf(1.0 - alpha);
                    strength / (1.0 + x)
                };
                let ohmic = Complex64::new(0.0, -2e-4 / (angular * VACUUM_PERMITTIVITY_F_PER_M));
                Some(4.0 + term(32.0, 7.234e-12, 0.0) + term(1100.0, 32.48e-9, 0.2) + ohmic)
            }
        }
    }

    /// |Gamma|^2 of a thick, smooth slab at normal incidence.
    pub fn power_reflection(self, frequency_hz: f64) -> f64 {
        self.permittivity(frequency_hz).map_or(1.0, |permittivity| {
            let n = permittivity.sqrt();
            ((1.0 - n) / (1.0 + n)).norm_sqr()
        })
    }

    /// How a surface of it scatters. Roughness and the rough term are this project's choices for
    /// painted plaster, cast concrete, planed wood and bare skin: no published figure is known to us.
    pub fn material(self, frequency_hz: f64) -> Material {
        let (roughness_m, rough_albedo) = match self {
            Self::Metal | Self::Glass => (0.0, 0.0),
            Self::Plaster => (0.15e-3, 0.005),
            Self::Wood => (0.1e-3, 0.005),
            Self::Concrete => (0.3e-3, 0.02),
            Self::Skin => (0.2e-3, 0.02),
        };
        Material {
            power_reflection: self.power_reflection(frequency_hz) as f32,
            roughness_m,
            rough_albedo,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_lead_back() {
        for substance in Substance::ALL {
            assert_eq!(Substance::named(substance.name()), Some(substance));
        }
        assert_eq!(Substance::named("unobtainium"), None);
    }

    #[test]
    fn permittivities_are_the_published_ones() {
        let near = |found: Option<Complex64>, re: f64, im: f64| {
            let found = found.unwrap();
            assert!(
                (found.re - re).abs() < 0.03 && (found.im - im).abs() < 0.03,
                "{found} instead of {re} {im}"
            );
        };
        // By hand from the formulas: one dominant term, 32 / (1 + j w tau), w tau = 3.500 at 77 GHz.
        near(Substance::Skin.permittivity(77e9), 6.56, -8.93);
        // 0.0085 * 60^0.9395 = 0.398 S/m; over w eps0 = 3.338 S/m.
        near(Substance::Plaster.permittivity(60e9), 2.73, -0.119);
        near(Substance::Concrete.permittivity(77e9), 5.24, -0.322);
        near(Substance::Wood.permittivity(24e9), 1.99, -0.106);
        near(Substance::Glass.permittivity(77e9), 6.31, -0.283);
    }

    #[test]
    fn reflections_follow_from_them() {
        // (sqrt(2.73) - 1)^2 / (sqrt(2.73) + 1)^2 = 0.0605: the loss adds 1 % of it.
        assert!((Substance::Plaster.power_reflection(60e9) - 0.0607).abs() < 5e-4);
        assert_eq!(Substance::Metal.power_reflection(24e9), 1.0);
        // Skin reflects about a third of the power at 77 GHz, more at 24 GHz.
        let skin = [77e9, 60e9, 24e9].map(|f| Substance::Skin.power_reflection(f));
        assert!((skin[0] - 0.34).abs() < 0.01, "{skin:?}");
        assert!(skin[0] < skin[1] && skin[1] < skin[2], "{skin:?}");
    }
}
