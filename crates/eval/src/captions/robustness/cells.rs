//! One cell of an experiment: all clips under one change, simulated and captioned.

use std::{path::Path, sync::OnceLock};

use glam::{DVec3, Quat};
use radarllm_base::{
    Clip, Clutter, Motion, PointFrame, Provenance, RadarConfig, RadarPoint, hash::fnv_1a,
    materials::Substance, seed::derive_seed,
};
use radarllm_body::sample::{canonicalize, crop};
use radarllm_dataset::Split;
use radarllm_inference::{Captioner, FRAME_RATE_HZ};
use radarllm_radar_sim::{SimOptions, shapes::RigidSurface};
use radarllm_synth::{
    Synthesizer,
    config::DatasetConfig,
    corpus::{Corpus, CorpusError, CorpusItem},
    record::make_record,
    synthesizer::open_radar,
};
use radarllm_tracking::{OptionError, PeopleOptions, Person, track_people};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::conditions::{Change, Plan, ScreenFile};
use crate::{EvalError, ModelInfo, captioner::caption_clips};

/// Distance of a screen from the radar, m: nearer than any hand of a body whose pelvis keeps the minimum distance.
const SCREEN_M: f64 = 0.5;
/// Extent of a screen to each side, m: from where it stands it covers +-58 degrees.
const SCREEN_HALF_WIDTH_M: f64 = 0.8;
/// Extent of a screen upwards and downwards, m: +-50 degrees.
const SCREEN_HALF_HEIGHT_M: f64 = 0.6;
/// Finest facets of a screen, m.
const SCREEN_FACET_M: f64 = 0.02;
/// Most points of a frame, as radars of the data sets report.
const MAX_POINTS: usize = 128;
/// Depth raster of a scene that a screen fills, as for rooms: twice the default, which keeps the body
/// as finely sampled as in free space.
const SCREEN_RASTER: usize = 640;

/// A finished cell: everything that scores are computed from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Cell {
    /// The change in words.
    pub condition: String,
    /// Motions shown.
    pub ids: Vec<String>,
    /// Their captions.
    pub captions: Vec<String>,
    /// Clips without a caption.
    pub abstained: usize,
    /// Mean number of points per frame.
    pub points_per_frame: f64,
}

/// Everything that the cells of an experiment share.
pub struct Experiment<'a> {
    pub(super) config: &'a DatasetConfig,
    /// Folder in which radar files are looked for.
    base: &'a Path,
    radar: RadarConfig,
    pub(super) corpora: &'a [Box<dyn Corpus>],
    /// (source, item) of every clip.
    clips: Vec<(usize, usize)>,
    captioner: &'a Captioner,
    pub(super) model: &'a ModelInfo,
    /// Points of the unchanged cell, computed when first needed.
    unchanged: OnceLock<Vec<Vec<PointFrame>>>,
}

impl<'a> Experiment<'a> {
    /// Chooses the clips: as many motions as the plan says, spread evenly over its split. `base` is the folder of the
    /// data set configuration, `corpora` are its sources.
    ///
    /// # Errors
    /// An unknown split, too few motions, a radar that cannot be opened.
    pub fn new(
        plan: &Plan,
        config: &'a DatasetConfig,
        base: &'a Path,
        corpora: &'a [Box<dyn Corpus>],
        captioner: &'a Captioner,
        model: &'a ModelInfo,
    ) -> Result<Self, EvalError> {
        let split = Split::from_name(&plan.split)
            .ok_or_else(|| EvalError::Config(format!("split {}: unknown", plan.split)))?;
        if !config.board.is_empty() {
            return Err(EvalError::Config(
                "data: every clip has the same board, and this data set draws boards ([[board]])"
                    .into(),
            ));
        }
        let radar = config.open_radar(base)?;
        for change in plan.changes() {
            if let Change::DistanceM(distance_m) = change {
                at_distance(config, distance_m).check_distance(&radar)?;
            }
        }
        Ok(Self {
            config,
            base,
            radar,
            corpora,
            clips: choose(corpora, split, plan.clips)?,
            captioner,
            model,
            unchanged: OnceLock::new(),
        })
    }

    /// The motions shown in every cell.
    pub(super) fn items(&self) -> impl Iterator<Item = &CorpusItem> {
        self.clips
            .iter()
            .map(|&(source, item)| &self.corpora[source].items()[item])
    }

    fn ids(&self) -> Vec<String> {
        self.items().map(|item| item.motion_id.clone()).collect()
    }

    /// A name for a cell, made from everything that it depends on: a kept cell of this name need not be computed again.
    ///
    /// # Errors
    /// A configuration that cannot be written as TOML.
    pub fn cell_name(&self, change: &Change) -> Result<String, EvalError> {
        let depends_on = format!(
            "{}\n{}\n{:?}\n{}\n{:016x}\n{:?}",
            env!("CARGO_PKG_VERSION"),
            toml::to_string(self.config).map_err(|e| EvalError::Config(e.to_string()))?,
            self.radar,
            self.model.name,
            self.model.fingerprint,
            self.clips
        );
        let hash = fnv_1a(format!("{depends_on}{change:?}").as_bytes());
        Ok(format!("{hash:016x}"))
    }

    /// Refuses a kept cell that shows other clips.
    ///
    /// # Errors
    /// [`EvalError::Stale`].
    pub fn check_cell(&self, cell: &Cell) -> Result<(), EvalError> {
        if cell.captions.len() != self.clips.len() || cell.ids != self.ids() {
            return Err(EvalError::Stale("holds other clips than this plan".into()));
        }
        Ok(())
    }

    /// Simulates and captions all clips under a change. Simulations run on the threads of the rayon pool from which
    /// this is called, with the same result for any number of threads.
    ///
    /// # Errors
    /// A clip that cannot be simulated, or that the model refuses.
    pub fn measure(&self, change: &Change) -> Result<Cell, EvalError> {
        let points = if change.is_of_points() {
            let unchanged = match self.unchanged.get() {
                Some(ready) => ready,
                None => {
                    let made = self.simulate(&Change::Nothing)?;
                    self.unchanged.get_or_init(|| made)
                }
            };
            let n = unchanged.len();
            let of_clip = |(i, item): (usize, &CorpusItem)| match change {
                Change::SecondPersonDeg(apart_deg) => {
                    let other = &unchanged[(i + n / 2) % n];
                    with_second_person(&unchanged[i], other, *apart_deg)
                }
                _ => {
                    let seed = derive_seed(self.config.seed, &item.motion_id);
                    change_points(&unchanged[i], change, seed)
                }
            };
            self.items().enumerate().map(of_clip).collect()
        } else {
            self.simulate(change)?
        };
        let n_frames: usize = points.iter().map(Vec::len).sum();
        let n_points: usize = points.iter().flatten().map(|f| f.points.len()).sum();
        let mut clips: Vec<Clip> = points
            .into_iter()
            .zip(self.items())
            .map(|(frames, item)| Clip {
                frames,
                frame_rate_hz: self.radar.frame_rate_hz(),
                radar_height_m: self.config.radar_height_m,
                is_height_assumed: false,
                radar: self.radar.name.clone(),
                provenance: Provenance::simulated(&item.motion_id, self.config.seed),
                clutter: Clutter::Settled,
            })
            .collect();
        if let (true, Some(unchanged)) = (change.is_tracked(), self.unchanged.get()) {
            for (clip, own) in clips.iter_mut().zip(unchanged) {
                *clip = tracked_person(clip, own).map_err(|e| EvalError::Config(e.to_string()))?;
            }
        }
        let described = caption_clips(self.captioner, &clips.iter().collect::<Vec<_>>(), None)?;
        Ok(Cell {
            condition: change.label(),
            ids: self.ids(),
            abstained: described.iter().filter(|d| d.abstained.is_some()).count(),
            captions: described.into_iter().map(|d| d.caption).collect(),
            points_per_frame: n_points as f64 / n_frames.max(1) as f64,
        })
    }

    /// Points of every clip under a change of what the radar sees.
    fn simulate(&self, change: &Change) -> Result<Vec<Vec<PointFrame>>, EvalError> {
        let mut config = self.config.clone();
        let mut radar = self.radar.clone();
        let mut of_motion = None;
        match change {
            Change::ExtraNoiseDb(extra) => radar.noise_figure_db += extra,
            Change::DistanceM(distance_m) => config = at_distance(&config, *distance_m),
            Change::HeadingDeg(heading) => {
                config.heading_deg = 0.0;
                of_motion = Some(MotionChange::HeadingRad(heading.to_radians()));
            }
            Change::Tempo(factor) => of_motion = Some(MotionChange::Tempo(*factor)),
            // As many as there are by default, so that the draws of a clip are the same.
            Change::BodyHeightM(height_m) => config.body_heights_m = Some(vec![*height_m; 4]),
            Change::Radar(name) => {
                radar = RadarConfig {
                    // The model measures time in frames.
                    frame_period_s: radar.frame_period_s,
                    ..open_radar(name, self.base)?
                };
                radar
                    .validate()
                    .map_err(|e| EvalError::Config(format!("axis `radar`: {name}: {e}")))?;
            }
            Change::RainMmPerH(rain) => config.weather.rain_mm_per_h = *rain,
            Change::SmokeGPerM3(smoke) => config.weather.smoke_g_per_m3 = *smoke,
            Change::Nothing
            | Change::AtMostPoints(_)
            | Change::FrameLoss(_)
            | Change::Tracked
            | Change::SecondPersonDeg(_)
            | Change::Screen(_) => {}
        }
        if (radar.frame_rate_hz() / f64::from(FRAME_RATE_HZ) - 1.0).abs() > 0.05 {
            return Err(EvalError::Config(format!(
                "radar {}: {:.2} frames/s, but the model reads {FRAME_RATE_HZ} frames/s",
                radar.name,
                radar.frame_rate_hz()
            )));
        }
        config.check_distance(&radar)?;
        let plan = || -> Result<Synthesizer, EvalError> {
            let sim = config.sim_options();
            Ok(match change {
                Change::Screen(screen) => config.synthesizer_with(
                    &radar,
                    SimOptions {
                        raster_size: sim.raster_size.max(SCREEN_RASTER),
                        ..sim
                    },
                    vec![sheet(screen, radar.carrier_hz())?],
                )?,
                _ => config.synthesizer(&radar)?,
            })
        };
        let max_s = config.max_frames as f64 * radar.frame_period_s;
        self.clips
            .par_iter()
            .map_init(
                || None,
                |synthesizer, &(source, item)| {
                    let synthesizer = match synthesizer {
                        Some(ready) => ready,
                        None => synthesizer.insert(plan()?),
                    };
                    let corpus = self.corpora[source].as_ref();
                    let record = match of_motion {
                        None => make_record(synthesizer, corpus, item, 0, &config),
                        Some(change) => {
                            let corpus = Changed {
                                corpus,
                                change,
                                max_s,
                            };
                            make_record(synthesizer, &corpus, item, 0, &config)
                        }
                    };
                    let motion = &corpus.items()[item].motion_id;
                    record
                        .map(|record| record.frames)
                        .map_err(|e| EvalError::Simulation {
                            what: format!("{}: {motion}", change.label()),
                            source: e.into(),
                        })
                },
            )
            .collect()
    }
}

/// The data set with the middle of every path at one distance.
fn at_distance(config: &DatasetConfig, distance_m: f32) -> DatasetConfig {
    DatasetConfig {
        distance_m: [distance_m; 2],
        ..config.clone()
    }
}

/// (source, item) of `n` motions, spread evenly over a split.
fn choose(
    corpora: &[Box<dyn Corpus>],
    split: Split,
    n: usize,
) -> Result<Vec<(usize, usize)>, EvalError> {
    let all: Vec<(usize, usize)> = corpora
        .iter()
        .enumerate()
        .flat_map(|(source, corpus)| {
            let items = corpus.items().iter().enumerate();
            items
                .filter(move |(_, item)| item.split == split)
                .map(move |(item, _)| (source, item))
        })
        .collect();
    if all.len() < n {
        return Err(EvalError::Config(format!(
            "clips: {n} asked for, split `{split}` has {}",
            all.len()
        )));
    }
    Ok((0..n).map(|i| all[i * all.len() / n]).collect())
}

/// A sheet across the radar's view.
fn sheet(screen: &ScreenFile, frequency_hz: f64) -> Result<RigidSurface, EvalError> {
    let substance = Substance::named(&screen.material)
        .ok_or_else(|| EvalError::Config(format!("material `{}` is unknown", screen.material)))?;
    Ok(RigidSurface::graded_plate(
        [-SCREEN_HALF_WIDTH_M, SCREEN_HALF_WIDTH_M],
        [-SCREEN_HALF_HEIGHT_M, SCREEN_HALF_HEIGHT_M],
        [0.0, 0.0],
        SCREEN_FACET_M,
    )
    .at(DVec3::Y * SCREEN_M)
    .of(substance.slab(frequency_hz, screen.thickness_m)))
}

/// The points of two people: the second one turned about the radar, which keeps ranges and velocities exact. Neither masks
/// the other; a frame keeps its strongest points.
fn with_second_person(own: &[PointFrame], other: &[PointFrame], apart_deg: f64) -> Vec<PointFrame> {
    let (sin, cos) = (apart_deg.to_radians() as f32).sin_cos();
    let mut frames = own.to_vec();
    for (frame, other) in frames.iter_mut().zip(other) {
        let turned = other.points.iter().map(|p| RadarPoint {
            x_m: cos * p.x_m - sin * p.y_m,
            y_m: sin * p.x_m + cos * p.y_m,
            ..*p
        });
        frame.points.extend(turned);
        frame.sort_by_intensity();
        frame.points.truncate(MAX_POINTS);
    }
    frames
}

/// The track that has most points of a person, as `describe --people auto` finds it; without points if there is none.
fn tracked_person(clip: &Clip, own: &[PointFrame]) -> Result<Clip, OptionError> {
    let people = track_people(clip.clone(), &PeopleOptions::default())?;
    let own_points = |person: &Person| -> usize {
        let of_frame = |frame: &PointFrame| {
            let of_person = own.iter().find(|f| f.frame == frame.frame);
            let of_person = of_person.map_or(&[][..], |f| &f.points);
            frame
                .points
                .iter()
                .filter(|p| of_person.contains(p))
                .count()
        };
        person.clip.frames.iter().map(of_frame).sum()
    };
    let counted = people
        .into_iter()
        .map(|person| (own_points(&person), person));
    let max = counted.filter(|(n, _)| *n > 0).max_by_key(|(n, _)| *n);
    let without_points = |f: &PointFrame| f.with_points(Vec::new());
    let nobody = || clip.with_frames(own.iter().map(without_points).collect());
    Ok(max.map_or_else(nobody, |(_, person)| person.clip))
}

/// The unchanged points with fewer points or frames.
fn change_points(frames: &[PointFrame], change: &Change, seed: u64) -> Vec<PointFrame> {
    let mut frames = frames.to_vec();
    for frame in &mut frames {
        match change {
            Change::AtMostPoints(max) => {
                // Stable, so that equally strong points stay in the order of the signal chain.
                frame.sort_by_intensity();
                frame.points.truncate(*max);
            }
            Change::FrameLoss(probability) => {
                // The same frames are lost at every higher probability.
                let draw = derive_seed(seed, &format!("frame-loss/{}", frame.frame));
                if ((draw >> 11) as f64) < probability * (1_u64 << 53) as f64 {
                    frame.points.clear();
                }
            }
            _ => {}
        }
    }
    frames
}

/// A change of the motions.
#[derive(Clone, Copy, Debug)]
enum MotionChange {
    /// Heading of the first pose, rad; 0 faces the radar.
    HeadingRad(f32),
    /// Speed as a multiple of the motion's own.
    Tempo(f64),
}

/// A source with changed motions.
struct Changed<'a> {
    corpus: &'a dyn Corpus,
    change: MotionChange,
    /// Longer motions are cut before they are turned: cutting faces them to the radar again.
    max_s: f64,
}

impl Corpus for Changed<'_> {
    fn name(&self) -> &str {
        self.corpus.name()
    }

    fn licence(&self) -> &str {
        self.corpus.licence()
    }

    fn attribution(&self) -> &str {
        self.corpus.attribution()
    }

    fn items(&self) -> &[CorpusItem] {
        self.corpus.items()
    }

    fn motion(&self, item_idx: usize) -> Result<Motion, CorpusError> {
        let mut motion = self.corpus.motion(item_idx)?;
        match self.change {
            MotionChange::HeadingRad(heading_rad) => {
                if motion.duration_s() > self.max_s {
                    motion = crop(&motion, 0.0, self.max_s);
                    canonicalize(&mut motion);
                }
                let turn = Quat::from_rotation_z(heading_rad);
                for pose in &mut motion.poses {
                    pose.root_in_world = turn * pose.root_in_world;
                    pose.rotations[0] = (turn * pose.rotations[0]).normalize();
                }
            }
            MotionChange::Tempo(factor) => motion.fps *= factor,
        }
        Ok(motion)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use radarllm_base::RadarPoint;

    #[test]
    fn fewer_points_are_the_strongest_and_lost_frames_are_nested() {
        let point = |intensity_db: f32| RadarPoint {
            intensity_db,
            ..Default::default()
        };
        let frames: Vec<PointFrame> = (0..500)
            .map(|frame| PointFrame {
                frame,
                time_s: f64::from(frame) * 0.1,
                points: [3.0, 9.0, 1.0, 7.0].map(point).to_vec(),
                board: None,
            })
            .collect();
        let two = change_points(&frames, &Change::AtMostPoints(2), 1);
        assert_eq!(two[0].points, [point(9.0), point(7.0)]);
        assert_eq!(change_points(&frames, &Change::Nothing, 1), frames);
        let lost = |p: f64| -> Vec<usize> {
            let changed = change_points(&frames, &Change::FrameLoss(p), 1);
            assert_eq!(changed.len(), frames.len());
            (0..500).filter(|&i| changed[i].points.is_empty()).collect()
        };
        let (few, many) = (lost(0.2), lost(0.5));
        // 500 draws: five standard deviations are 45 and 56.
        assert!(few.len().abs_diff(100) < 45 && many.len().abs_diff(250) < 56);
        assert!(few.iter().all(|i| many.contains(i)));
        assert!(lost(0.0).is_empty() && lost(1.0).len() == 500);
    }

    #[test]
    fn the_person_is_found_beside_another() {
        // Two people who step from one foot to the other at 3 m, with three points each.
        let person = |x_m: f32| -> Vec<PointFrame> {
            let frame = |i: u32| {
                let sway_m = 0.1 * (i as f32 * 0.6).sin();
                let point = |j: u32| {
                    let (x_m, y_m) = (x_m + sway_m, 3.0 + 0.1 * j as f32);
                    RadarPoint {
                        x_m,
                        y_m,
                        z_m: 0.3 * j as f32,
                        range_m: x_m.hypot(y_m),
                        velocity_mps: 0.3,
                        intensity_db: (10 * j) as f32,
                    }
                };
                PointFrame {
                    frame: i,
                    time_s: f64::from(i) / 10.0,
                    points: (0..3).map(point).collect(),
                    board: None,
                }
            };
            (0..60).map(frame).collect()
        };
        let own = person(0.0);
        let both = with_second_person(&own, &person(0.0), 40.0);
        assert!(both.iter().all(|frame| frame.points.len() == 6));
        for (frame, own) in both.iter().zip(&own) {
            let turned: Vec<&RadarPoint> = frame
                .points
                .iter()
                .filter(|p| !own.points.contains(p))
                .collect();
            assert_eq!(turned.len(), 3);
            // To the left, with the same range and velocity.
            assert!(turned.iter().all(|p| p.x_m < -1.0));
            let range_m = |p: &RadarPoint| p.x_m.hypot(p.y_m);
            assert!(turned.iter().all(|p| (range_m(p) - p.range_m).abs() < 1e-5));
        }
        let clip = Clip {
            frames: both,
            frame_rate_hz: 10.0,
            radar_height_m: 1.0,
            is_height_assumed: false,
            radar: "board".into(),
            provenance: Provenance::simulated("test", 1),
            clutter: Clutter::Settled,
        };
        let found = tracked_person(&clip, &own).unwrap();
        let points = found.frames.iter().flat_map(|f| &f.points);
        assert!(points.clone().all(|p| p.x_m > -0.5) && points.count() > 120);
        // Nobody is found where the person has no points.
        let nobody = tracked_person(&clip.with_frames(own.clone()), &person(9.0)).unwrap();
        assert_eq!((nobody.frames.len(), nobody.n_points()), (60, 0));
    }

    #[test]
    fn motions_are_turned_and_sped_up() {
        use radarllm_synth::corpus::procedural::{ProceduralConfig, ProceduralCorpus};
        let config = ProceduralConfig {
            test: 3,
            ..Default::default()
        };
        let corpus = ProceduralCorpus::new(&config, 5).unwrap();
        let changed = |item, change| {
            let changed = Changed {
                corpus: &corpus,
                change,
                max_s: 1000.0,
            };
            changed.motion(item).unwrap()
        };
        for item in 0..3 {
            let plain = corpus.motion(item).unwrap();
            let a = plain.joints_in_world();
            let quick = changed(item, MotionChange::Tempo(2.0));
            assert!((quick.duration_s() * 2.0 - plain.duration_s()).abs() < 1e-9);
            assert_eq!(quick.joints_in_world(), a);
            let quarter = MotionChange::HeadingRad(std::f32::consts::FRAC_PI_2);
            let b = changed(item, quarter).joints_in_world();
            for (p, q) in a.iter().flatten().zip(b.iter().flatten()) {
                // A quarter turn counter-clockwise: x becomes y.
                let expected = glam::Vec3::new(-p.y, p.x, p.z);
                assert!(expected.distance(*q) < 1e-4, "{expected} {q}");
            }
        }
    }
}
