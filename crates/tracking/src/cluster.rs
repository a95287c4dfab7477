//! Clustering of the points of a frame: DBSCAN over position and radial velocity.

use radarllm_base::{RadarPoint, options::within, stats::median_upper};

use crate::OptionError;

/// Maximum number of points of a frame that are clustered, the strongest ones. The run time grows with the square of
/// this number.
pub const MAX_POINTS: usize = 1024;

/// Options of the clustering. Two points are neighbours if (dx^2 + dy^2) / place_m^2 + dz^2 / height_m^2 + dv^2 /
/// velocity_mps^2 <= 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClusterOptions {
    /// Maximum horizontal distance of neighbours, m.
    pub place_m: f64,
    /// Maximum vertical distance of neighbours, m. It is large because elevation is the least accurate coordinate and a
    /// person is tall.
    pub height_m: f64,
    /// Maximum difference of the radial velocities of neighbours, m/s. Limbs differ from the torso by more than this,
    /// but the points between them form a chain.
    pub velocity_mps: f64,
    /// Minimum number of neighbours, the point itself included, that makes a point a core point.
    pub min_points: usize,
}

impl Default for ClusterOptions {
    fn default() -> Self {
        Self {
            place_m: 0.5,
            height_m: 1.0,
            velocity_mps: 1.5,
            min_points: 3,
        }
    }
}

impl ClusterOptions {
    /// Checks every field.
    ///
    /// # Errors
    /// Names the first field that is out of range.
    pub fn validate(&self) -> Result<(), OptionError> {
        within("place_m", self.place_m, [0.01, 10.0], "0.01 to 10 m")?;
        within("height_m", self.height_m, [0.01, 100.0], "0.01 to 100 m")?;
        within(
            "velocity_mps",
            self.velocity_mps,
            [0.01, 100.0],
            "0.01 to 100 m/s",
        )?;
        within(
            "min_points",
            self.min_points as f64,
            [1.0, 1000.0],
            "1 to 1000",
        )
    }

    fn are_neighbours(&self, a: &RadarPoint, b: &RadarPoint) -> bool {
        let apart = |a: f32, b: f32, unit: f64| (f64::from(a - b) / unit).powi(2);
        apart(a.x_m, b.x_m, self.place_m)
            + apart(a.y_m, b.y_m, self.place_m)
            + apart(a.z_m, b.z_m, self.height_m)
            + apart(a.velocity_mps, b.velocity_mps, self.velocity_mps)
            <= 1.0
    }
}

/// Points of a frame that belong together.
#[derive(Clone, Debug, PartialEq)]
pub struct Cluster {
    /// Indices of the points in the frame, ascending.
    pub points: Vec<u32>,
    /// Mean position, m, to the right of the radar and away from it.
    pub place_m: [f64; 2],
    /// Median radial velocity, m/s. The median represents the torso rather than a limb.
    pub velocity_mps: f64,
}

impl Cluster {
    /// The cluster of the points with these indices; `None` if there are none.
    pub fn of(points: &[RadarPoint], indices: Vec<u32>) -> Option<Self> {
        let n = indices.len() as f64;
        let mut place_m = [0.0; 2];
        let mut velocities = Vec::with_capacity(indices.len());
        for i in &indices {
            let point = &points[*i as usize];
            place_m[0] += f64::from(point.x_m) / n;
            place_m[1] += f64::from(point.y_m) / n;
            velocities.push(point.velocity_mps);
        }
        let velocity_mps = f64::from(median_upper(velocities)?);
        Some(Self {
            points: indices,
            place_m,
            velocity_mps,
        })
    }
}

/// Finds clusters among the first [`MAX_POINTS`] points (points are sorted by strength, the strongest first) by DBSCAN
/// (Ester et al., KDD 1996).
/// A cluster consists of core points and their neighbours. Points without a core point in reach belong to no cluster.
/// Clusters are ordered by their first core point.
pub fn clusters(points: &[RadarPoint], options: &ClusterOptions) -> Vec<Cluster> {
    let points = &points[..points.len().min(MAX_POINTS)];
    let mut taken = vec![false; points.len()];
    let neighbours = |i: usize| -> Vec<usize> {
        (0..points.len())
            .filter(|&j| options.are_neighbours(&points[i], &points[j]))
            .collect()
    };
    let mut found = Vec::new();
    for start in 0..points.len() {
        if taken[start] {
            continue;
        }
        let mut ahead = neighbours(start);
        if ahead.len() < options.min_points {
            continue;
        }
        taken[start] = true;
        let mut members = vec![start as u32];
        while let Some(i) = ahead.pop() {
            if taken[i] {
                continue;
            }
            taken[i] = true;
            members.push(i as u32);
            let further = neighbours(i);
            if further.len() >= options.min_points {
                ahead.extend(further.into_iter().filter(|&j| !taken[j]));
            }
        }
        members.sort_unstable();
        found.extend(Cluster::of(points, members));
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x_m: f32, y_m: f32, velocity_mps: f32) -> RadarPoint {
        RadarPoint {
            x_m,
            y_m,
            velocity_mps,
            ..RadarPoint::default()
        }
    }

    #[test]
    fn chains_hold_together_loners_belong_nowhere_and_velocity_parts() {
        let options = ClusterOptions::default();
        let points = [
            at(0.0, 2.0, 0.2),
            at(5.0, 5.0, 0.0), // alone
            at(0.4, 2.0, 0.3),
            at(0.8, 2.0, 0.4),
            // The same position with the opposite direction of motion: the radial velocities differ by 2.0 m/s.
            at(0.2, 2.0, -2.0),
            at(0.3, 2.0, -2.1),
            at(0.4, 2.1, -1.9),
        ];
        let found = clusters(&points, &options);
        let members: Vec<&[u32]> = found.iter().map(|c| &c.points[..]).collect();
        // Points 0 and 3 are connected only through the core point between them.
        assert_eq!(members, [&[0, 2, 3][..], &[4, 5, 6]]);
        assert!((found[0].place_m[0] - 0.4).abs() < 1e-6 && found[1].velocity_mps == -2.0);
        assert!(clusters(&[], &options).is_empty());
        assert!(clusters(&points[..2], &options).is_empty());
    }

    #[test]
    fn order_of_points_changes_no_cluster() {
        let mut points = Vec::new();
        for i in 0..40 {
            let i = i as f32;
            points.push(at((i * 0.7).sin() * 2.0, 3.0 + (i * 1.3).cos() * 2.0, 0.1));
        }
        let sets = |points: &[RadarPoint]| {
            let options = ClusterOptions {
                min_points: 1, // Border points of two clusters could go either way.
                ..ClusterOptions::default()
            };
            let mut sets: Vec<Vec<u64>> = clusters(points, &options)
                .iter()
                .map(|c| {
                    let mut keys: Vec<u64> = c
                        .points
                        .iter()
                        .map(|i| {
                            let p = &points[*i as usize];
                            u64::from(p.x_m.to_bits()) << 32 | u64::from(p.y_m.to_bits())
                        })
                        .collect();
                    keys.sort_unstable();
                    keys
                })
                .collect();
            sets.sort();
            sets
        };
        let before = sets(&points);
        assert!(before.len() > 2);
        points.reverse();
        assert_eq!(sets(&points), before);
    }
}
