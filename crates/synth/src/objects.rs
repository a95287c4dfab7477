//! What stands still around the person: clutter from walls, floor and furniture, as point targets.
//!
//! A room in full costs ten times the simulation of a person. What it does to the points of firmware that does not remove
//! clutter is mostly this: weak echoes at all ranges raise the threshold of the detector for everything that is slower
//! than a Doppler bin or two, and a few strong ones hide slow movements at their range. Point targets do the same for a
//! fraction of the time; shadows and reflections are left out.

use std::f64::consts::FRAC_PI_3;

use glam::DVec3;
use radarllm_radar_sim::PointTarget;
use rand::{RngExt, SeedableRng, rngs::ChaCha8Rng};
use serde::{Deserialize, Serialize};

/// Most objects of a clip.
const MAX_OBJECTS: usize = 1000;
/// Height of the ceiling above the floor, m.
const CEILING_M: f64 = 2.5;

/// `[objects]` of a data set: how what stands still around the person is drawn for each clip.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ObjectsFile {
    /// Number of weak scatterers.
    pub n_clutter: usize,
    /// Mean radar cross section of a weak scatterer, dB relative to 1 m^2: smallest and largest value of a clip. Within a
    /// clip, cross sections are distributed exponentially.
    pub clutter_dbsm: [f64; 2],
    /// Fewest and most strong objects.
    pub n_strong: [usize; 2],
    /// Smallest and largest radar cross section of a strong object, dB relative to 1 m^2.
    pub strong_dbsm: [f64; 2],
    /// Nearest and farthest range, m.
    pub range_m: [f64; 2],
}

impl Default for ObjectsFile {
    /// No strong objects, and clutter of 50 scatterers a metre, 20 to 30 dB below the parts of a body.
    fn default() -> Self {
        Self {
            n_clutter: 250,
            clutter_dbsm: [-48.0, -34.0],
            n_strong: [0, 0],
            strong_dbsm: [-25.0, 0.0],
            range_m: [0.5, 5.5],
        }
    }
}

/// Any file that contains the table.
#[derive(Deserialize)]
struct WithObjects {
    objects: ObjectsFile,
}

impl ObjectsFile {
    /// Reads the `[objects]` table of a data set's configuration, or of a file with nothing else.
    ///
    /// # Errors
    /// Invalid TOML, a missing table, or an unknown field.
    pub fn from_toml(text: &str) -> Result<Self, toml::de::Error> {
        toml::from_str::<WithObjects>(text).map(|file| file.objects)
    }

    /// Nothing at all: free space.
    pub fn none() -> Self {
        Self {
            n_clutter: 0,
            ..Self::default()
        }
    }

    /// Surroundings of a living room: weak clutter and a dozen strong objects.
    pub fn furnished() -> Self {
        Self {
            n_strong: [12, 12],
            ..Self::default()
        }
    }

    /// Checks that the values are finite and ordered.
    ///
    /// # Errors
    /// The name of the first value that is not.
    pub fn check(&self) -> Result<(), String> {
        let [fewest, max] = self.n_strong;
        if fewest > max || max.max(self.n_clutter) > MAX_OBJECTS {
            return Err(format!(
                "[objects] n_strong: must be [fewest, most], at most {MAX_OBJECTS}, and n_clutter no more"
            ));
        }
        for (name, [low, high], bounds) in [
            ("clutter_dbsm", self.clutter_dbsm, -90.0..=40.0),
            ("strong_dbsm", self.strong_dbsm, -90.0..=40.0),
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
        let [fewest, max] = self.n_strong.map(|n| n as f64);
        let n_strong = within([fewest, max + 1.0]).floor().min(max) as usize;
        let clutter_dbsm = within(self.clutter_dbsm);
        (0..self.n_clutter + n_strong)
            .map(|i| {
                let range_m = within(self.range_m);
                let z_m = within([-radar_height_m, CEILING_M - radar_height_m])
                    .clamp(-0.9 * range_m, 0.9 * range_m);
                let along_m = (range_m * range_m - z_m * z_m).sqrt();
                let (sin, cos) = within([-FRAC_PI_3, FRAC_PI_3]).sin_cos();
                let rcs_dbsm = match i < self.n_clutter {
                    // Minus the logarithm of a uniform number is distributed exponentially with mean 1.
                    true => clutter_dbsm + 10.0 * (-within([1e-6, 1.0]).ln()).max(1e-6).log10(),
                    false => within(self.strong_dbsm),
                };
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
            n_clutter: 0,
            n_strong: [20, 40],
            strong_dbsm: [-20.0, 5.0],
            range_m: [0.5, 5.0],
            ..ObjectsFile::default()
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
    fn clutter_has_the_level_of_its_clip() {
        let mean_dbsm = |seed| {
            let objects = ObjectsFile::default().draw(1.0, seed);
            assert_eq!(objects.len(), 250);
            10.0 * (objects.iter().map(|o| o.rcs_m2).sum::<f64>() / 250.0).log10()
        };
        let levels: Vec<f64> = (0..40).map(mean_dbsm).collect();
        // The mean of 250 exponential values is within 20 % (0.8 dB) of its expectation, to three standard deviations.
        assert!(levels.iter().all(|l| (-49.0..=-33.0).contains(l)));
        let spread = |f: fn(f64, f64) -> f64| levels.iter().copied().reduce(f).unwrap();
        assert!(spread(f64::max) - spread(f64::min) > 8.0);
    }

    #[test]
    fn impossible_objects_are_named() {
        assert_eq!(file().check(), Ok(()));
        let wrong = |change: &dyn Fn(&mut ObjectsFile)| {
            let mut wrong = file();
            change(&mut wrong);
            wrong.check().unwrap_err()
        };
        assert!(wrong(&|o| o.n_strong = [5, 3]).contains("n_strong"));
        assert!(wrong(&|o| o.n_clutter = 100_000).contains("n_clutter"));
        assert!(wrong(&|o| o.range_m = [0.0, 3.0]).contains("range_m"));
        assert!(wrong(&|o| o.strong_dbsm = [f64::NAN, 3.0]).contains("strong_dbsm"));
        assert!(wrong(&|o| o.clutter_dbsm = [-30.0, -40.0]).contains("clutter_dbsm"));
    }
}
