//! Static objects around the person: furniture, walls and ceiling as point targets.
//!
//! A room in full costs ten times the simulation of a person. What it does to the points of firmware that does not remove
//! clutter is mostly this: strong echoes at many ranges, beside which slow movements are not detected. Point targets of
//! random place and cross section do the same for a fraction of the time; shadows and reflections are left out.

use std::f64::consts::FRAC_PI_3;

use glam::DVec3;
use radarllm_radar_sim::PointTarget;
use rand::{RngExt, SeedableRng, rngs::ChaCha8Rng};
use serde::{Deserialize, Serialize};

/// Most objects of a clip.
const MAX_OBJECTS: usize = 1000;
/// Height of the ceiling above the floor, m.
const CEILING_M: f64 = 2.5;

/// `[objects]` of a data set: how the objects of each clip are drawn.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectsFile {
    /// Fewest and most objects.
    pub count: [usize; 2],
    /// Smallest and largest radar cross section, dB relative to 1 m^2.
    pub rcs_dbsm: [f64; 2],
    /// Nearest and farthest range, m.
    pub range_m: [f64; 2],
}

impl ObjectsFile {
    /// Checks that the values are finite and ordered.
    ///
    /// # Errors
    /// The name of the first value that is not.
    pub fn check(&self) -> Result<(), String> {
        let [fewest, most] = self.count;
        if fewest > most || most > MAX_OBJECTS {
            return Err(format!(
                "[objects] count: must be [fewest, most], at most {MAX_OBJECTS}"
            ));
        }
        for (name, [low, high], bounds) in [
            ("rcs_dbsm", self.rcs_dbsm, -60.0..=40.0),
            ("range_m", self.range_m, 0.1..=100.0),
        ] {
            if !(low <= high && bounds.contains(&low) && bounds.contains(&high)) {
                return Err(format!(
                    "[objects] {name}: must be [low, high] in {bounds:?}"
                ));
            }
        }
        Ok(())
    }

    /// Draws the objects of a clip within 60 degrees of boresight, in radar axes.
    pub fn draw(&self, radar_height_m: f64, seed: u64) -> Vec<PointTarget> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut within = |[low, high]: [f64; 2]| low + (high - low) * rng.random::<f64>();
        let [fewest, most] = self.count.map(|n| n as f64);
        let n = within([fewest, most + 1.0]).floor().min(most) as usize;
        (0..n)
            .map(|_| {
                let range_m = within(self.range_m);
                let z_m = within([-radar_height_m, CEILING_M - radar_height_m])
                    .clamp(-0.9 * range_m, 0.9 * range_m);
                let along_m = (range_m * range_m - z_m * z_m).sqrt();
                let (sin, cos) = within([-FRAC_PI_3, FRAC_PI_3]).sin_cos();
                let rcs_dbsm = within(self.rcs_dbsm);
                let position_m = DVec3::new(along_m * sin, along_m * cos, z_m);
                PointTarget::at(position_m, 10.0_f64.powf(rcs_dbsm / 10.0))
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file() -> ObjectsFile {
        ObjectsFile {
            count: [20, 40],
            rcs_dbsm: [-20.0, 5.0],
            range_m: [0.5, 5.0],
        }
    }

    #[test]
    fn objects_lie_in_the_room() {
        for seed in 0..50 {
            let objects = file().draw(1.0, seed);
            assert!((20..=40).contains(&objects.len()));
            assert_eq!(objects, file().draw(1.0, seed));
            for object in objects {
                let at = object.position_m;
                assert!((0.49..=5.01).contains(&at.length()) && at.y > 0.0);
                assert!((-1.0..=1.5).contains(&at.z));
                assert!((0.01..=3.2).contains(&object.rcs_m2));
            }
        }
    }

    #[test]
    fn impossible_objects_are_named() {
        assert_eq!(file().check(), Ok(()));
        let wrong = |change: &dyn Fn(&mut ObjectsFile)| {
            let mut wrong = file();
            change(&mut wrong);
            wrong.check().unwrap_err()
        };
        assert!(wrong(&|o| o.count = [5, 3]).contains("count"));
        assert!(wrong(&|o| o.count = [5, 100_000]).contains("count"));
        assert!(wrong(&|o| o.range_m = [0.0, 3.0]).contains("range_m"));
        assert!(wrong(&|o| o.rcs_dbsm = [f64::NAN, 3.0]).contains("rcs_dbsm"));
    }
}
