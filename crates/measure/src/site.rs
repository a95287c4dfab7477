//! What a site reveals about the mounting of its radar while people walk: the error of the tilt, and the height at which
//! the board tracks a standing person.
//!
//! People walk everywhere with one height. A height that falls with distance is therefore an error of the tilt, and the
//! upper end of the heights, corrected for it, is that of an upright person. No label is needed.

use radarllm_base::{PointFrame, stats::quantile_nearest};

use crate::people::{TrackedPerson, Tracker, tracked_people};

/// Height above the floor at which a standing person is tracked where nothing was learned, m: the middle of adults' heads.
pub const STANDING_M: f32 = 1.65;

/// Length of a stretch of walking, s, and the distance in it from which on somebody walks, m.
const STRETCH_S: f64 = 1.0;
const STRETCH_M: f32 = 0.4;
/// Longest walk of which the heights have a common error, s: somebody crosses a room in that time, and turns.
const MAX_WALK_S: f64 = 6.0;
/// Stretches that an estimate needs: 10 s of walking by tracks of the board, 30 s by tracks of points, which also jump between
/// parts of the body.
const MIN_STRETCHES: usize = 30;
const MIN_STRETCHES_BY_POINTS: usize = 90;
/// Distances from the radar between which the tilt can be estimated must span this much, m.
const MIN_SPAN_M: f32 = 1.0;
/// Width of the cells of distance, m, and the stretches that one needs.
const CELL_M: f32 = 0.5;
const MIN_IN_CELL: usize = 5;
/// Standard deviation of the error of a stated tilt, rad: of the one board whose chirp file states it 12 degrees were wrong.
const STATED_TILT_ERROR_RAD: f32 = 6.0 * (std::f32::consts::PI / 180.0);
/// Maximum error of a tilt, rad: 25 degrees. More is no error of a mounting.
const MAX_TILT_RAD: f32 = 0.4363;
/// Share of the stretches that are lower than an upright person: people who sit down, get up or bend walk, too.
const UPRIGHT: f32 = 0.9;

/// The mounting of a radar, as the people who walked before it show it.
#[derive(Clone, Debug, PartialEq)]
pub struct Site {
    /// Name of the radar.
    pub radar: String,
    /// Tilt to be added to the stated one, rad; positive when the radar looks farther down.
    pub tilt_rad: f32,
    /// Height at which a standing person is tracked, m above the radar, in level axes.
    pub standing_m: f32,
    /// Time in which somebody walked, s.
    pub walking_s: f32,
    /// How well it is known.
    pub error: SiteDeviation,
    /// Whether the height of the radar follows from neither people nor a statement.
    pub is_height_assumed: bool,
    /// Stated height of the radar above the floor, m.
    pub stated_height_m: Option<f32>,
}

/// Standard deviations of what is known of a site.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SiteDeviation {
    /// Of the tilt, rad.
    pub tilt_rad: f32,
    /// Of the height at which a standing person is tracked, m, at the distance at which it is known best.
    pub standing_m: f32,
    /// This distance from the radar, m.
    pub distance_m: f32,
}

impl SiteDeviation {
    /// Of a radar of which height and tilt are stated.
    const STATED: Self = Self {
        tilt_rad: STATED_TILT_ERROR_RAD,
        standing_m: 0.1,
        distance_m: 0.0,
    };
    /// Of one of which nobody states the height: radars stand on tables and hang below ceilings, 0.7 to 2.2 m high.
    const ASSUMED: Self = Self {
        standing_m: 0.4,
        ..Self::STATED
    };

    /// Of heights at a distance from the radar, m.
    fn height_m(&self, distance_m: f32) -> f32 {
        let by_tilt_m = self.tilt_rad * (distance_m - self.distance_m);
        self.standing_m.hypot(by_tilt_m)
    }
}

/// Why nothing can be said about a site.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SiteError {
    /// Nobody is tracked in height.
    #[error("neither tracks of the board nor points of people have heights")]
    NoHeights,
    /// Nobody walked for long enough.
    #[error("somebody walked for {found_s:.0} s; {needed_s:.0} s are needed")]
    TooLittleWalking {
        /// Time in which somebody walked, s.
        found_s: f32,
        /// Time that is needed, s.
        needed_s: f32,
    },
}

/// A stretch of walking.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Stretch {
    /// Distance along the boresight and height above the radar, m.
    at_m: [f32; 2],
    /// Which walk it belongs to: heights of a walk have a common error, of the person and of the track. A longer walk than
    /// [`MAX_WALK_S`] counts as several.
    walk: u32,
}

impl Site {
    /// What a radar with a stated height above the floor shows where nothing was learned.
    pub fn unlearned(radar: &str, radar_height_m: f32) -> Self {
        Self {
            radar: radar.into(),
            tilt_rad: 0.0,
            standing_m: STANDING_M - radar_height_m,
            walking_s: 0.0,
            error: SiteDeviation::STATED,
            is_height_assumed: false,
            stated_height_m: Some(radar_height_m),
        }
    }

    /// The same of a radar whose height above the floor nobody states.
    pub fn assumed(radar: &str, radar_height_m: f32) -> Self {
        Self {
            error: SiteDeviation::ASSUMED,
            is_height_assumed: true,
            stated_height_m: None,
            ..Self::unlearned(radar, radar_height_m)
        }
    }

    /// Learns a site from the tracks of people who walk. Where they do not walk to and fro, the tilt stays as stated.
    ///
    /// # Errors
    /// [`SiteError`]: no heights, or nobody walked for 30 s.
    pub fn learn(radar: &str, frames: &[PointFrame]) -> Result<Self, SiteError> {
        let mut learner = SiteLearner::default();
        learner.add(frames);
        learner.site(radar)
    }

    /// Turns distance along the boresight and height, m, by the tilt.
    pub fn level(&self, [y_m, z_m]: [f32; 2]) -> [f32; 2] {
        let (sin, cos) = self.tilt_rad.sin_cos();
        [y_m * cos - z_m * sin, z_m * cos + y_m * sin]
    }

    /// Standard deviation that heights at a distance from the radar have because height and tilt of the radar are not known
    /// well, m.
    pub fn height_error_m(&self, distance_m: f32) -> f32 {
        self.error.height_m(distance_m)
    }

    /// Whether heights at a distance from the radar, m, are known better than those of a track.
    pub fn is_known_at(&self, distance_m: f32) -> bool {
        const WELL_KNOWN_M: f32 = 0.1;
        self.height_error_m(distance_m) < WELL_KNOWN_M
    }

    /// Height above the floor at which a standing person is tracked, m: [`STANDING_M`] where nobody states the height of the
    /// radar.
    pub fn standing_above_floor_m(&self) -> f32 {
        /// Of a child to a tall adult's head.
        const POSSIBLE_M: [f32; 2] = [1.0, 2.0];
        let stated_m = self
            .stated_height_m
            .map(|height_m| height_m + self.standing_m);
        stated_m.map_or(STANDING_M, |m| m.clamp(POSSIBLE_M[0], POSSIBLE_M[1]))
    }

    /// Height of the radar above the floor, m, if a standing person is tracked at [`STANDING_M`].
    pub fn radar_height_m(&self) -> f32 {
        STANDING_M - self.standing_m
    }
}

/// Most stretches that are kept, 1.9 hours of walking: of more, the older half is forgotten.
const MAX_STRETCHES: usize = 20_000;

/// Learns a site from a recording that is read in parts, or from a radar that runs.
#[derive(Clone, Debug, Default)]
pub struct SiteLearner {
    has_heights: bool,
    is_by_points: bool,
    stretches: Vec<Stretch>,
    n_walks: u32,
    /// Beginning and end of the newest walk, s: one goes on where frames are added in parts.
    walk_s: Option<[f64; 2]>,
}

impl SiteLearner {
    /// Adds the frames of a part.
    pub fn add(&mut self, frames: &[PointFrame]) {
        self.add_people(&tracked_people(frames, None).unwrap_or_default());
    }

    /// Adds people who were tracked, with heights that no site corrected.
    pub fn add_people(&mut self, people: &[TrackedPerson]) {
        let has_height = |p: &TrackedPerson| p.samples.iter().any(|s| s.height_m.is_some());
        self.has_heights |= people.iter().any(has_height);
        self.is_by_points |= people.iter().any(|p| p.tracker == Tracker::Points);
        for person in people {
            self.add_walks(person);
        }
        if self.stretches.len() > MAX_STRETCHES {
            self.stretches
                .drain(..self.stretches.len() - MAX_STRETCHES / 2);
        }
    }

    /// What all parts show; see [`Site::learn`].
    ///
    /// # Errors
    /// [`SiteError`]: no heights, or nobody walked for 30 s.
    pub fn site(&self, radar: &str) -> Result<Site, SiteError> {
        let stretches = &self.stretches;
        if !self.has_heights {
            return Err(SiteError::NoHeights);
        }
        // A new stretch begins after a third of one.
        let walking_s = stretches.len() as f32 * STRETCH_S as f32 / 3.0;
        let needed = match self.is_by_points {
            true => MIN_STRETCHES_BY_POINTS,
            false => MIN_STRETCHES,
        };
        if stretches.len() < needed {
            return Err(SiteError::TooLittleWalking {
                found_s: walking_s,
                needed_s: needed as f32 * STRETCH_S as f32 / 3.0,
            });
        }
        let slope = Slope::of(stretches);
        let error = SiteDeviation {
            tilt_rad: slope.error,
            standing_m: 0.0,
            distance_m: slope.distance_m,
        };
        let mut site = Site {
            radar: radar.into(),
            tilt_rad: (-slope.slope).atan().clamp(-MAX_TILT_RAD, MAX_TILT_RAD),
            standing_m: 0.0,
            walking_s,
            error,
            is_height_assumed: false,
            stated_height_m: None,
        };
        let height_m = |stretch: &Stretch| site.level(stretch.at_m)[1];
        let standing_m = quantile_nearest(stretches.iter().map(height_m), UPRIGHT);
        let of_walks = stretches
            .chunk_by(|a, b| a.walk == b.walk)
            .map(|walk| quantile_nearest(walk.iter().map(height_m), 0.5).unwrap_or_default());
        site.error.standing_m = mean_error(&of_walks.collect::<Vec<_>>());
        site.standing_m = standing_m.unwrap_or_default();
        Ok(site)
    }
}

impl SiteLearner {
    /// Adds the stretches in which a person walked.
    fn add_walks(&mut self, person: &TrackedPerson) {
        let mut t_s = person.start_s();
        while t_s + STRETCH_S <= person.end_s() {
            let samples = person.between(t_s, t_s + STRETCH_S);
            let start_s = t_s;
            t_s += STRETCH_S / 3.0;
            let (Some(first), Some(last)) = (samples.first(), samples.last()) else {
                continue;
            };
            let [x_m, y_m] = first.place_m;
            let path_m = (last.place_m[0] - x_m).hypot(last.place_m[1] - y_m);
            let is_whole = last.t_s - first.t_s > 0.8 * STRETCH_S;
            let height = quantile_nearest(samples.iter().filter_map(|s| s.height_m), 0.5);
            let y_m = quantile_nearest(samples.iter().map(|s| s.place_m[1]), 0.5);
            if let (true, true, Some(height_m), Some(y_m)) =
                (path_m >= STRETCH_M, is_whole, height, y_m)
            {
                let end_s = start_s + STRETCH_S;
                let goes_on = |[from_s, to_s]: &[f64; 2]| {
                    (to_s - STRETCH_S..=to_s + STRETCH_S).contains(&start_s)
                        && end_s - from_s <= MAX_WALK_S
                };
                let from_s = self.walk_s.filter(goes_on).map(|walk_s| walk_s[0]);
                self.n_walks += u32::from(from_s.is_none());
                self.walk_s = Some([from_s.unwrap_or(start_s), end_s]);
                self.stretches.push(Stretch {
                    at_m: [y_m, height_m],
                    walk: self.n_walks,
                });
            }
        }
    }
}

/// Change of the height with distance, with its standard deviation, as far as stretches prove it.
#[derive(Clone, Copy, Debug)]
struct Slope {
    slope: f32,
    error: f32,
    /// Mean distance of the stretches, m.
    distance_m: f32,
}

impl Slope {
    /// The change of the median height.
    ///
    /// Tracks of people who walk sink and rise by themselves, so that few walks show a change that is none. The less they
    /// prove, the nearer is the result to the stated tilt: it is the mean of the posterior distribution, with
    /// [`STATED_TILT_ERROR_RAD`] as the standard deviation of the prior one.
    fn of(stretches: &[Stretch]) -> Self {
        let n = stretches.len().max(1) as f32;
        let distance_m = stretches.iter().map(|s| s.at_m[0]).sum::<f32>() / n;
        let prior = STATED_TILT_ERROR_RAD.tan();
        let (slope, error) = measured_slope(stretches).map_or((0.0, prior), |[slope, error]| {
            let share = prior * prior / (prior * prior + error * error);
            (slope * share, error * share.sqrt())
        });
        Self {
            slope,
            error,
            distance_m,
        }
    }
}

/// Change of the median height with distance, and its standard deviation; `None` if people walked at one distance only.
fn measured_slope(stretches: &[Stretch]) -> Option<[f32; 2]> {
    let share = |share| quantile_nearest(stretches.iter().map(|s| s.at_m[0]), share);
    if share(0.95)? - share(0.05)? < MIN_SPAN_M {
        return None;
    }
    let cell_of = |stretch: &Stretch| (stretch.at_m[0] / CELL_M).floor() as i64;
    let mut cells: Vec<i64> = stretches.iter().map(cell_of).collect();
    cells.sort_unstable();
    cells.dedup();
    // Each cell counts as often as somebody walked there: a median of many stretches is surer than one of few.
    let mut points: Vec<[f32; 3]> = Vec::new();
    for cell in cells {
        let inside = || stretches.iter().filter(|s| cell_of(s) == cell);
        let n = inside().count();
        if n < MIN_IN_CELL {
            continue;
        }
        let median_m = |axis: usize| quantile_nearest(inside().map(|s| s.at_m[axis]), 0.5);
        points.push([median_m(0)?, median_m(1)?, n as f32]);
    }
    let n: f32 = points.iter().map(|p| p[2]).sum();
    let mean = |axis: usize| points.iter().map(|p| p[2] * p[axis]).sum::<f32>() / n;
    let (mean_y_m, mean_z_m) = (mean(0), mean(1));
    let product = |of: &dyn Fn(&[f32; 3]) -> f32| points.iter().map(|p| p[2] * of(p)).sum::<f32>();
    let spread = product(&|p| (p[0] - mean_y_m).powi(2));
    if points.len() < 2 || spread <= 0.0 {
        return None;
    }
    let slope = product(&|p| (p[0] - mean_y_m) * (p[1] - mean_z_m)) / spread;
    // Errors of a walk go together, so that each walk counts as one observation.
    let of_walk = |walk: &[Stretch]| {
        let parts = walk.iter().map(|s| {
            let [y_m, z_m] = [s.at_m[0] - mean_y_m, s.at_m[1] - mean_z_m];
            y_m * (z_m - slope * y_m)
        });
        parts.sum::<f32>().powi(2)
    };
    let walks = stretches.chunk_by(|a, b| a.walk == b.walk);
    let n_walks = walks.clone().count() as f32;
    let sum: f32 = walks.map(of_walk).sum();
    let few = n_walks / (n_walks - 1.0).max(f32::MIN_POSITIVE);
    Some([slope, (few * sum).sqrt() / spread])
}

/// Standard deviation of the mean of values.
fn mean_error(values: &[f32]) -> f32 {
    let n = values.len().max(1) as f32;
    let mean = values.iter().sum::<f32>() / n;
    let sum: f32 = values.iter().map(|v| (v - mean).powi(2)).sum();
    (sum / (n - 1.0).max(f32::MIN_POSITIVE) / n).sqrt()
}

#[cfg(test)]
mod tests {
    use radarllm_base::random::nth_normal;

    use super::*;
    use crate::people::tests::frames;

    /// Walks between 1 and 4 m at 0.8 m/s; `tilt` is what the mounting states too little.
    fn walker(tilt_rad: f32) -> Vec<PointFrame> {
        let (sin, cos) = tilt_rad.sin_cos();
        frames(120.0, |t| {
            let phase = (t as f32 * 0.8).rem_euclid(6.0);
            let y_m = if phase < 3.0 {
                1.0 + phase
            } else {
                7.0 - phase
            };
            let z_m = -0.3;
            Some([y_m * cos + z_m * sin, z_m * cos - y_m * sin, 0.0])
        })
    }

    #[test]
    fn tilt_and_standing_height_follow_from_a_walk() {
        for degrees in [-10.0_f32, 0.0, 12.0] {
            let site = Site::learn("board", &walker(degrees.to_radians())).unwrap();
            assert!(
                (site.tilt_rad.to_degrees() - degrees).abs() < 1.0,
                "{site:?}"
            );
            assert!((site.standing_m + 0.3).abs() < 0.05, "{site:?}");
            assert!((site.radar_height_m() - 1.95).abs() < 0.05, "{site:?}");
        }
    }

    #[test]
    fn who_does_not_walk_reveals_nothing() {
        let still = frames(600.0, |_| Some([2.0, 0.3, 0.0]));
        let error = Site::learn("board", &still).unwrap_err();
        assert_eq!(
            error,
            SiteError::TooLittleWalking {
                found_s: 0.0,
                needed_s: 10.0
            }
        );
        let nobody = frames(600.0, |_| None);
        assert_eq!(
            Site::learn("board", &nobody).unwrap_err(),
            SiteError::NoHeights
        );
        // Along a circle around the radar the distance does not change: the tilt stays as stated.
        let mut circle = frames(60.0, |_| Some([2.0, 0.1, 0.0]));
        for frame in &mut circle {
            let angle = frame.time_s as f32 * 0.4;
            for track in frame.board.iter_mut().flat_map(|b| &mut b.tracks) {
                track.place_m = [2.0 * angle.sin(), 3.0 + 0.1 * angle.cos()];
            }
        }
        let site = Site::learn("board", &circle).unwrap();
        assert_eq!(site.tilt_rad, 0.0);
        assert!((site.standing_m - 0.1).abs() < 1e-6);
    }

    /// Heights that tremble by half a metre prove little in half a minute and all in ten.
    #[test]
    fn few_stretches_with_uncertain_heights_leave_the_tilt_nearly_as_stated() {
        let tilt_deg = |n: u32| {
            let stretch = |i: u32| {
                let y_m = 1.5 + (i % 8) as f32 * 0.25;
                let trembles_m = 0.5 * ((i * 7919 % 101) as f32 / 50.0 - 1.0);
                Stretch {
                    at_m: [y_m, 0.3 - 0.2 * y_m + trembles_m],
                    walk: i / 3,
                }
            };
            let stretches: Vec<Stretch> = (0..n).map(stretch).collect();
            let slope = Slope::of(&stretches);
            [(-slope.slope).atan(), slope.error].map(f32::to_degrees)
        };
        let [few, many] = [tilt_deg(48), tilt_deg(4_800)];
        assert!((2.0..8.0).contains(&few[0]), "{few:?}");
        assert!((3.0..6.0).contains(&few[1]), "{few:?}");
        assert!((10.5..12.0).contains(&many[0]), "{many:?}");
        assert!(many[1] < 1.0, "{many:?}");
    }

    /// The true slope is within two standard deviations of the measured one in four of five rooms or more, whatever differs from
    /// one walk to the next, and not much nearer either.
    #[test]
    fn the_stated_error_is_that_which_is_made() {
        let mut z = Vec::new();
        for room in 0..200u64 {
            let mut at = 0;
            let mut normal = || {
                at += 1;
                nth_normal(room, at) as f32
            };
            let mut stretches = Vec::new();
            for walk in 0..12 {
                // Of each walk, the person or the track is higher or lower, and it leads somewhere.
                let (own_m, from_m, way_m) = (0.12 * normal(), 2.5 + 0.8 * normal(), normal());
                stretches.extend((0..9).map(|i| {
                    let y_m = from_m + way_m * i as f32 / 9.0;
                    let z_m = -0.3 - 0.1 * y_m + own_m + 0.05 * normal();
                    Stretch {
                        at_m: [y_m, z_m],
                        walk,
                    }
                }));
            }
            let Some([slope, error]) = measured_slope(&stretches) else {
                continue;
            };
            z.push((slope + 0.1) / error);
        }
        let n = z.len() as f32;
        let within = z.iter().filter(|z| z.abs() < 2.0).count() as f32 / n;
        let rms = (z.iter().map(|z| z * z).sum::<f32>() / n).sqrt();
        assert!(n > 150.0 && within > 0.8, "{within} of {n}");
        assert!((0.8..1.8).contains(&rms), "{rms}");
    }
}
