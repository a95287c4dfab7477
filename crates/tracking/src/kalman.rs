//! Kalman filter with a constant-velocity model of a person's position and velocity on the floor.

/// Estimate of the state (x, y, vx, vy), m and m/s, with its covariance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Mean.
    pub mean: [f64; 4],
    /// Covariance.
    pub covariance: [[f64; 4]; 4],
}

impl Estimate {
    /// Initial estimate of a new track: position with the standard deviation `sigma_m`, velocity zero with the standard
    /// deviation `sigma_mps`.
    pub fn new(place_m: [f64; 2], sigma_m: f64, sigma_mps: f64) -> Self {
        let mut covariance = [[0.0; 4]; 4];
        for (i, row) in covariance.iter_mut().enumerate() {
            row[i] = if i < 2 { sigma_m } else { sigma_mps }.powi(2);
        }
        Self {
            mean: [place_m[0], place_m[1], 0.0, 0.0],
            covariance,
        }
    }

    /// Predicts the state `dt_s` later.
    ///
    /// The velocity is multiplied by `kept` (1: constant velocity). White acceleration noise adds a standard deviation
    /// of `acceleration_mps2` times 1 s to the velocity after one second (Bar-Shalom et al., Estimation with
    /// Applications to Tracking and Navigation, 2001, section 6.2: continuous white noise acceleration).
    pub fn predict(&mut self, dt_s: f64, kept: f64, acceleration_mps2: f64) {
        let [x, y, vx, vy] = self.mean;
        // Displacement for a velocity that decreases linearly from 1 to `kept`.
        let along = 0.5 * (1.0 + kept) * dt_s;
        self.mean = [x + along * vx, y + along * vy, kept * vx, kept * vy];
        let step = [
            [1.0, 0.0, along, 0.0],
            [0.0, 1.0, 0.0, along],
            [0.0, 0.0, kept, 0.0],
            [0.0, 0.0, 0.0, kept],
        ];
        self.covariance = product(&product(&step, &self.covariance), &transposed(&step));
        // Variance of the acceleration over this step. It makes the accumulated noise independent of the step length.
        let variance = acceleration_mps2 * acceleration_mps2 * dt_s;
        for i in 0..2 {
            self.covariance[i][i] += variance * dt_s * dt_s / 3.0;
            self.covariance[i][i + 2] += variance * dt_s / 2.0;
            self.covariance[i + 2][i] += variance * dt_s / 2.0;
            self.covariance[i + 2][i + 2] += variance;
        }
    }

    /// Squared Mahalanobis distance of a measured position with the standard deviation `sigma_m`.
    pub fn place_distance(&self, place_m: [f64; 2], sigma_m: f64) -> f64 {
        let c = &self.covariance;
        let variance = sigma_m * sigma_m;
        let (a, b, d) = (c[0][0] + variance, c[0][1], c[1][1] + variance);
        let (dx, dy) = (place_m[0] - self.mean[0], place_m[1] - self.mean[1]);
        (d * dx * dx - 2.0 * b * dx * dy + a * dy * dy) / (a * d - b * b)
    }

    /// Speed along the line of sight, m/s, positive when receding, and the unit vector of the line of sight.
    pub fn radial_mps(&self) -> (f64, [f64; 2]) {
        let [x, y, vx, vy] = self.mean;
        let range_m = x.hypot(y).max(1e-6);
        let sight = [x / range_m, y / range_m];
        (sight[0] * vx + sight[1] * vy, sight)
    }

    /// Squared Mahalanobis distance of a measured radial velocity.
    pub fn velocity_distance(&self, velocity_mps: f64, sigma_mps: f64) -> f64 {
        let (expected, sight) = self.radial_mps();
        let c = &self.covariance;
        let variance = sight[0] * sight[0] * c[2][2]
            + 2.0 * sight[0] * sight[1] * c[2][3]
            + sight[1] * sight[1] * c[3][3];
        (velocity_mps - expected).powi(2) / (variance + sigma_mps * sigma_mps)
    }

    /// Updates the estimate with a measured position, one coordinate after the other (their errors are independent).
    pub fn update_place(&mut self, place_m: [f64; 2], sigma_m: f64) {
        self.update([1.0, 0.0, 0.0, 0.0], place_m[0] - self.mean[0], sigma_m);
        self.update([0.0, 1.0, 0.0, 0.0], place_m[1] - self.mean[1], sigma_m);
    }

    /// Updates the estimate with a measured radial velocity.
    pub fn update_velocity(&mut self, velocity_mps: f64, sigma_mps: f64) {
        let (expected, sight) = self.radial_mps();
        let row = [0.0, 0.0, sight[0], sight[1]];
        self.update(row, velocity_mps - expected, sigma_mps);
    }

    /// Updates the estimate with the scalar measurement `row . state`, whose innovation is `apart`.
    fn update(&mut self, row: [f64; 4], apart: f64, sigma: f64) {
        let c = &self.covariance;
        let cross: [f64; 4] =
            std::array::from_fn(|i| (0..4).map(|j| c[i][j] * row[j]).sum::<f64>());
        let variance = (0..4).map(|i| row[i] * cross[i]).sum::<f64>() + sigma * sigma;
        let mean = self.mean.iter_mut().zip(cross);
        mean.for_each(|(mean, c)| *mean += c / variance * apart);
        for (row, a) in self.covariance.iter_mut().zip(cross) {
            let both = row.iter_mut().zip(cross);
            both.for_each(|(covariance, b)| *covariance -= a * b / variance);
        }
    }
}

type Matrix = [[f64; 4]; 4];

fn product(a: &Matrix, b: &Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..4).map(|k| a[i][k] * b[k][j]).sum::<f64>()))
}

fn transposed(a: &Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| a[j][i]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_steady_walk_is_learnt_as_a_least_squares_line_learns_it() {
        // Without process noise and with a vague prior, the filter is a linear regression. The variance of the position
        // at the last of n points is that of the end of the regression line, sigma^2 (4 n - 2) / (n (n + 1)).
        let (n, sigma_m) = (40, 0.2);
        let at = |i: usize| [0.3 + 0.08 * i as f64, 4.0 - 0.05 * i as f64];
        let mut estimate = Estimate::new(at(0), sigma_m, 100.0);
        for i in 1..n {
            estimate.predict(0.1, 1.0, 0.0);
            estimate.update_place(at(i), sigma_m);
        }
        for (found, expected) in estimate.mean.iter().zip([3.42, 2.05, 0.8, -0.5]) {
            // The prior variance of 100^2 m^2/s^2 is not infinite: its influence is of order 1e-5.
            assert!((found - expected).abs() < 1e-4, "{estimate:?}");
        }
        let n = n as f64;
        let expected = sigma_m * sigma_m * (4.0 * n - 2.0) / (n * (n + 1.0));
        assert!((estimate.covariance[0][0] / expected - 1.0).abs() < 1e-3);
    }

    #[test]
    fn steps_of_any_length_add_up_and_a_fading_velocity_stops() {
        let start = Estimate::new([1.0, 2.0], 0.2, 1.0);
        let (mut one, mut many) = (start, start);
        one.predict(0.5, 1.0, 1.5);
        (0..5).for_each(|_| many.predict(0.1, 1.0, 1.5));
        let both = one.covariance.as_flattened().iter();
        for (one, many) in both.zip(many.covariance.as_flattened()) {
            assert!((one - many).abs() < 1e-12);
        }
        let mut walker = Estimate {
            mean: [0.0, 2.0, 1.0, 0.0],
            ..start
        };
        (0..100).for_each(|_| walker.predict(0.1, (-0.1_f64).exp(), 0.0));
        // The integral of e^-t up to 10 s by the trapezoidal rule with steps of 0.1 s: (1 + e^-0.1) / 2 / (1 - e^-0.1)
        // * 0.1.
        assert!((walker.mean[0] - 1.0008).abs() < 1e-3, "{walker:?}");
    }

    #[test]
    fn radial_velocity_is_learnt_along_the_line_of_sight_only() {
        let mut estimate = Estimate::new([0.0, 3.0], 0.2, 1.0);
        for _ in 0..50 {
            estimate.update_velocity(-1.2, 0.3);
        }
        // 50 measurements with 0.3 m/s against a prior of 1 m/s: 0.2 % of the initial difference remains.
        assert!((estimate.mean[3] + 1.2).abs() < 0.01 && estimate.mean[2] == 0.0);
        assert!(estimate.covariance[2][2] == 1.0 && estimate.covariance[3][3] < 0.01);
        assert!(estimate.velocity_distance(-1.2, 0.3) < 0.01);
        assert!((estimate.place_distance([0.2, 3.0], 0.0) - 1.0).abs() < 1e-9);
    }
}
