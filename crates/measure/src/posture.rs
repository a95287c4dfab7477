//! Posture from how far a person is below the height at which the same site tracks a standing person.

use crate::site::STANDING_M;

/// A posture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Posture {
    /// Upright.
    Standing,
    /// On a seat, or as low as one who sits.
    Sitting,
    /// On the floor or on a bed.
    Lying,
}

/// Height below a standing person, m, at which standing and sitting are equally probable, and sitting and lying.
///
/// A seated head is 0.4 to 0.5 m below a standing one, one of somebody who sits on the floor 0.8 m, a lying one 1.4 m. The
/// heights that boards track spread less: the
/// middle between those who stand and those who sit is at 0.13 m on one board (IWRL6432) and at 0.15 m on another
/// (IWR6843ISK-ODS).
///
/// The lower limit is of a person who is tracked 1.65 m above the floor while standing, and in proportion of another one: who
/// lies is tracked near the floor, whatever part of the body the board tracks. It is the middle between sitting and lying on
/// the floor; on the IWRL6432, people who sit are tracked 0.5 to 0.9 m lower than their site's standing person, and those who
/// lie 1.3 to 1.4 m.
const SITTING_M: f32 = 0.15;
const LYING_M: f32 = 1.10;
/// Standard deviations of the error of a height, m, at the two limits.
const SITTING_ERROR_M: f32 = 0.12;
const LYING_ERROR_M: f32 = 0.20;

/// Probabilities of the postures, which add up to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PostureProbabilities {
    /// Of standing.
    pub standing: f32,
    /// Of sitting.
    pub sitting: f32,
    /// Of lying.
    pub lying: f32,
}

impl PostureProbabilities {
    /// The probabilities of a height below a standing person, m, who is tracked at `standing_m` above the floor.
    /// `site_error_m` is the standard deviation that the height has because the site is not known.
    pub fn of(below_standing_m: f32, standing_m: f32, site_error_m: f32) -> Self {
        let lying_m = LYING_M * standing_m / STANDING_M;
        let beyond = |limit_m: f32, error_m: f32| {
            normal_cdf((below_standing_m - limit_m) / error_m.hypot(site_error_m))
        };
        let lower = beyond(SITTING_M, SITTING_ERROR_M);
        let lying = beyond(lying_m, LYING_ERROR_M).min(lower);
        Self {
            standing: 1.0 - lower,
            sitting: lower - lying,
            lying,
        }
    }

    /// The mean of several, at least one.
    pub fn mean(all: &[Self]) -> Self {
        let n = all.len() as f32;
        let mean = |of: fn(&Self) -> f32| all.iter().map(of).sum::<f32>() / n;
        Self {
            standing: mean(|p| p.standing),
            sitting: mean(|p| p.sitting),
            lying: mean(|p| p.lying),
        }
    }

    /// The probability of a posture.
    pub fn of_posture(&self, posture: Posture) -> f32 {
        match posture {
            Posture::Standing => self.standing,
            Posture::Sitting => self.sitting,
            Posture::Lying => self.lying,
        }
    }

    /// The most probable posture with its probability.
    pub fn best(&self) -> (Posture, f32) {
        let all = [
            (Posture::Standing, self.standing),
            (Posture::Sitting, self.sitting),
            (Posture::Lying, self.lying),
        ];
        let first = all[0];
        all[1..]
            .iter()
            .fold(first, |best, one| if one.1 > best.1 { *one } else { best })
    }
}

/// Distribution function of the standard normal distribution, by the logistic approximation of Bowling et al. (2009), whose
/// error is below 2e-4.
fn normal_cdf(z: f32) -> f32 {
    1.0 / (1.0 + (-(1.5976 * z + 0.070_566 * z.powi(3))).exp())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn postures_follow_the_height() {
        for (below_m, posture) in [
            (-0.1, Posture::Standing),
            (0.0, Posture::Standing),
            (0.5, Posture::Sitting),
            (0.9, Posture::Sitting),
            (1.6, Posture::Lying),
        ] {
            let found = PostureProbabilities::of(below_m, STANDING_M, 0.0);
            assert_eq!(found.best().0, posture, "{below_m}");
            let sum = found.standing + found.sitting + found.lying;
            assert!(
                (sum - 1.0).abs() < 1e-6 && found.best().1 > 0.8,
                "{found:?}"
            );
        }
        // A child, or a board that tracks the chest.
        let low = PostureProbabilities::of(1.05, 1.2, 0.0);
        assert_eq!(low.best().0, Posture::Lying);
        let (_, at_the_limit) = PostureProbabilities::of(SITTING_M, STANDING_M, 0.0).best();
        assert!((at_the_limit - 0.5).abs() < 0.01);
    }

    #[test]
    fn the_distribution_function_has_known_values() {
        for (z, p) in [
            (0.0, 0.5),
            (1.0, 0.841_345),
            (-1.96, 0.024_998),
            (3.0, 0.998_65),
        ] {
            assert!((normal_cdf(z) - p).abs() < 2e-4, "{z}");
        }
    }
}
