//! Reflectivity of walls, furniture and skin, from published permittivities.
//!
//! Building materials: Recommendation ITU-R P.2040-2 (09/2021), Table 3: real part `a`, conductivity
//! `c f^d` S/m with f in GHz, valid to 100 GHz. Skin: the four-term Cole-Cole model of Gabriel, Lau
//! and Gabriel, *The dielectric properties of biological tissues: III*, Phys. Med. Biol. 41 (1996),
//! dry skin, whose slow relaxation terms are negligible at millimetre waves. Cloth: 1.5 (1 - 0.02 j), as measured for
//! woven cotton and polyester at 2.45 GHz (after Sankaralingam and Gupta, IEEE Trans. Instrum. Meas. 59
//! (2010), not checked against the paper). At millimetre waves it is only known that eight garment fabrics lose less
//! than 3 dB up to 300 GHz (Bjarnason et al., Appl. Phys. Lett. 85 (2004)); one millimetre of this cloth satisfies that
//! bound. Unless a thickness is given, slabs are assumed to be thick, and the reflection from the rear face is
//! neglected.

use num_complex::Complex64;

use crate::{Material, SPEED_OF_LIGHT_MPS};

/// Vacuum permittivity, F/m (CODATA 2018).
const VACUUM_PERMITTIVITY_F_PER_M: f64 = 8.854_187_812_8e-12;

/// A named material.
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
    /// Woven cloth: a curtain.
    Cloth,
}

impl Substance {
    /// All substances.
    pub const ALL: [Self; 7] = [
        Self::Metal,
        Self::Skin,
        Self::Plaster,
        Self::Concrete,
        Self::Wood,
        Self::Glass,
        Self::Cloth,
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
            Self::Cloth => "cloth",
        }
    }

    /// The substance with a given name.
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
            Self::Cloth => Some(Complex64::new(1.5, -1.5 * 0.02)),
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

    /// Power reflection coefficient |Gamma|^2 of a thick, smooth slab at normal incidence.
    pub fn power_reflection(self, frequency_hz: f64) -> f64 {
        self.permittivity(frequency_hz).map_or(1.0, |permittivity| {
            let n = permittivity.sqrt();
            ((1.0 - n) / (1.0 + n)).norm_sqr()
        })
    }

    /// Scattering parameters of a surface of this substance. The roughness and the rough term are this project's
    /// choices for painted plaster, cast concrete, planed wood and bare skin; no published values are known to us.
    pub fn material(self, frequency_hz: f64) -> Material {
        let (roughness_m, rough_albedo) = match self {
            Self::Metal | Self::Glass => (0.0, 0.0),
            // Threads and folds.
            Self::Cloth => (0.3e-3, 0.005),
            Self::Plaster => (0.15e-3, 0.005),
            Self::Wood => (0.1e-3, 0.005),
            Self::Concrete => (0.3e-3, 0.02),
            Self::Skin => (0.2e-3, 0.02),
        };
        Material {
            power_reflection: self.power_reflection(frequency_hz) as f32,
            roughness_m,
            rough_albedo,
            power_transmission: 0.0,
        }
    }

    /// Power reflection and transmission of a smooth slab in air at normal incidence, including multiple reflections
    /// between its faces: the single-layer slab of ITU-R P.2040-2.
    pub fn slab_powers(self, frequency_hz: f64, thickness_m: f64) -> [f64; 2] {
        let Some(permittivity) = self.permittivity(frequency_hz) else {
            return [1.0, 0.0];
        };
        let n = permittivity.sqrt();
        let face = (1.0 - n) / (1.0 + n);
        let q = std::f64::consts::TAU * frequency_hz * thickness_m / SPEED_OF_LIGHT_MPS * n;
        let once = (Complex64::new(0.0, -1.0) * q).exp();
        let echoes = 1.0 - face * face * once * once;
        let reflected = face * (1.0 - once * once) / echoes;
        let transmitted = (1.0 - face * face) * once / echoes;
        [reflected.norm_sqr(), transmitted.norm_sqr()]
    }

    /// A slab that also transmits waves, by [`Self::slab_powers`].
    pub fn slab(self, frequency_hz: f64, thickness_m: f64) -> Material {
        let [reflected, transmitted] = self.slab_powers(frequency_hz, thickness_m);
        Material {
            power_reflection: reflected as f32,
            power_transmission: transmitted as f32,
            ..self.material(frequency_hz)
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
    fn slabs_pass_what_the_formula_says() {
        let plaster = Substance::Plaster;
        let n = plaster.permittivity(77e9).unwrap().sqrt();
        let wavelength_m = SPEED_OF_LIGHT_MPS / 77e9;
        // A thick slab: two faces of (1 - |r|^2) each and exp(-2 k d |Im n|) between them; echoes
        // inside change it by 2 |r|^2 exp(-2 k d |Im n|) < 7 %.
        let r2 = plaster.power_reflection(77e9);
        let d = 0.0125;
        let decay = (2.0 * std::f64::consts::TAU / wavelength_m * d * n.im).exp();
        let [_, found] = plaster.slab_powers(77e9, d);
        let expected = (1.0 - r2).powi(2) * decay;
        assert!((found / expected - 1.0).abs() < 0.07, "{found} {expected}");
        // By hand: 0.503 S/m, n = 1.653 - 0.0356 j, exp(-1.435) and two faces of -0.27 dB: 6.8 dB.
        assert!((-10.0 * expected.log10() - 6.77).abs() < 0.02, "{expected}");
        // A slab half a wavelength thick (inside the material) reflects almost nothing. A quarter-wavelength slab has
        // the maximum reflection of a slab, ((1 - n^2) / (1 + n^2))^2.
        let half = 0.5 * wavelength_m / n.re;
        let [min, _] = Substance::Cloth.slab_powers(77e9, 0.5 * wavelength_m / 1.5_f64.sqrt());
        assert!(min < 1e-4, "{min}");
        let [max, _] = Substance::Cloth.slab_powers(77e9, 0.25 * wavelength_m / 1.5_f64.sqrt());
        assert!((max / (0.5_f64 / 2.5).powi(2) - 1.0).abs() < 0.05, "{max}");
        assert!(plaster.slab_powers(77e9, half)[0] < 0.3 * r2);
        // No slab amplifies; metal and a metre of concrete transmit nothing, and a thin film transmits everything.
        for substance in Substance::ALL {
            for d in [1e-6, 1e-4, 1.3e-3, 0.01, 0.2] {
                let [r, t] = substance.slab_powers(77e9, d);
                assert!(
                    r >= 0.0 && t >= 0.0 && r + t <= 1.0 + 1e-12,
                    "{substance:?} {d}: {r} {t}"
                );
            }
        }
        assert_eq!(Substance::Metal.slab_powers(77e9, 1e-3), [1.0, 0.0]);
        assert!(Substance::Concrete.slab_powers(77e9, 1.0)[1] < 1e-20);
        assert!(Substance::Glass.slab_powers(77e9, 1e-7)[1] > 0.999);
        // A millimetre of cloth satisfies the 3 dB bound of Bjarnason et al.
        assert!(Substance::Cloth.slab_powers(77e9, 1e-3)[1] > 0.5);
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
