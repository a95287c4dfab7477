//! The requirements of the model on a clip, and the preparation of clips that do not meet them.
//!
//! The model reads frames without their times: a clip at another frame rate would appear to move at another speed. The
//! model was trained on radars that remove static clutter from their samples. Firmware that does not remove it reports
//! mostly static points. Both differences are corrected here, in one place, so that no caller silently gets a wrong
//! sentence.

use std::{borrow::Cow, ops::Deref};

use radarllm_base::{Clip, Clutter, PointFrame, RadarPoint, StaticClutter, TimelineError};

/// Radar frames per second that the model was trained on.
pub const FRAME_RATE_HZ: f32 = 10.0;

/// Clips whose frame rate differs from [`FRAME_RATE_HZ`] by at most this fraction are not resampled.
pub const RATE_TOLERANCE: f64 = 0.05;

/// Maximum frame rate accepted, in Hz.
pub const MAX_FRAME_RATE_HZ: f64 = 1000.0;

/// Options for the preparation of a clip.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PrepareOptions {
    /// When resampling, move points along their radial velocity to the time of their new frame.
    pub motion_compensate: bool,
}

/// A clip that the model can read: all values are finite, the frame rate is [`FRAME_RATE_HZ`] within [`RATE_TOLERANCE`],
/// and static clutter is removed. Whoever has one need not look at its points again.
///
/// It is a copy only where a change was necessary.
#[derive(Clone, Debug, PartialEq)]
pub struct PreparedClip<'a> {
    clip: Cow<'a, Clip>,
    parted: Option<Box<Parted>>,
}

/// Other selections of the points of a clip of which static ones were removed.
#[derive(Clone, Debug, PartialEq)]
struct Parted {
    /// What has a speed; `None` if nothing has.
    moving: Option<Clip>,
    /// Everything that the board reported, at its own frame rate.
    reported: Clip,
}

impl<'a> PreparedClip<'a> {
    /// Prepares a clip without motion compensation; see [`prepare_for_model`].
    ///
    /// # Errors
    /// Those of [`prepare_for_model`].
    pub fn of(clip: &'a Clip) -> Result<Self, PrepareError> {
        if needs_preparation(clip) {
            let prepared = prepare_for_model(clip.clone(), &PrepareOptions::default())?;
            return Ok(prepared.clip);
        }
        check(clip)?;
        Ok(Self {
            clip: Cow::Borrowed(clip),
            parted: None,
        })
    }

    /// The clip with every point that has a speed, however slow it is.
    ///
    /// Static clutter is judged by the places and the majority of a recording, so that of two recordings of the same
    /// activity one may lose the slow points of the person and the other not. Recordings that are compared with each other
    /// need the same points of both.
    pub fn moving(&self) -> &Clip {
        let parted = self.parted.as_ref();
        let moving = parted.and_then(|parted| parted.moving.as_ref());
        moving.unwrap_or(&self.clip)
    }

    /// The clip with every point that the board reported, the static ones of the room and of somebody who keeps still as well,
    /// at the frame rate of the board; `None` if no static point was removed.
    pub fn reported(&self) -> Option<&Clip> {
        self.parted.as_ref().map(|parted| &parted.reported)
    }

    /// The clip, copied if it is somebody else's.
    pub fn into_clip(self) -> Clip {
        self.clip.into_owned()
    }

    /// The clip with what the board reported in its time at the same frame rate, for a clip whose static points were removed
    /// elsewhere, and slow ones of the person with them.
    #[must_use]
    pub fn with_reported(self, reported: Clip) -> Self {
        let moving = self.parted.and_then(|parted| parted.moving);
        let moving = moving.or_else(|| with_speed(&reported));
        Self {
            parted: Some(Box::new(Parted { moving, reported })),
            ..self
        }
    }

    /// The prepared clip by [`Clip::without_tracks`].
    pub fn without_tracks(&self) -> PreparedClip<'static> {
        let of = |clip: &Clip| clip.clone().without_tracks();
        let parted = self.parted.as_ref().map(|parted| {
            Box::new(Parted {
                moving: parted.moving.as_ref().map(of),
                reported: of(&parted.reported),
            })
        });
        PreparedClip {
            clip: Cow::Owned(of(&self.clip)),
            parted,
        }
    }

    /// A part of the clip: `n_frames` from a frame on, or as many as there are, with their times.
    pub fn part(&self, first: usize, n_frames: usize) -> PreparedClip<'static> {
        let within = |clip: &Clip| {
            let frames = clip.frames.iter().skip(first).take(n_frames);
            clip.with_frames(frames.cloned().collect())
        };
        let clip = within(&self.clip);
        let parted = self.parted.as_ref().map(|parted| {
            let from_s = clip.frames.first().map_or(f64::INFINITY, |f| f.time_s);
            let end = self.clip.frames.get(first.saturating_add(n_frames));
            let to_s = end.map_or(f64::INFINITY, |f| f.time_s);
            let frames = parted.reported.frames.iter();
            let frames = frames.filter(|f| (from_s..to_s).contains(&f.time_s));
            Box::new(Parted {
                moving: parted.moving.as_ref().map(within),
                reported: parted.reported.with_frames(frames.cloned().collect()),
            })
        });
        PreparedClip {
            clip: Cow::Owned(clip),
            parted,
        }
    }
}

impl Deref for PreparedClip<'_> {
    type Target = Clip;

    fn deref(&self) -> &Clip {
        &self.clip
    }
}

/// A clip that the model can read, and a record of the changes.
#[derive(Clone, Debug, PartialEq)]
pub struct Prepared {
    /// The clip.
    pub clip: PreparedClip<'static>,
    /// The static clutter that was removed.
    pub removed_static: Option<StaticClutter>,
    /// The frame rate before resampling, Hz, if the clip was resampled.
    pub resampled_from_hz: Option<f64>,
}

/// Reasons why the model cannot read a clip.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PrepareError {
    /// The frame rate is outside the range of real radars.
    #[error("a frame rate of {found_hz} Hz: expected more than 0, at most {MAX_FRAME_RATE_HZ}")]
    FrameRate {
        /// Frame rate found, in Hz.
        found_hz: f64,
    },
    /// The height of the radar is NaN or infinite.
    #[error("radar height {found_m} m is not finite")]
    RadarHeight {
        /// Height found, in m.
        found_m: f32,
    },
    /// The time of a frame is NaN or infinite.
    #[error("frame {frame}: time is not finite")]
    TimeNotFinite {
        /// Index of the frame.
        frame: usize,
    },
    /// A coordinate, velocity or intensity is NaN or infinite.
    #[error("frame {frame}, point {point}: value is not finite")]
    NotFinite {
        /// Index of the frame.
        frame: usize,
        /// Index of the point in its frame.
        point: usize,
    },
    /// The clip cannot be resampled.
    #[error(transparent)]
    Timeline(#[from] TimelineError),
}

/// Prepares a clip for the model: removes the static clutter of an [`Clutter::Unchecked`] recording, and resamples a
/// frame rate that differs from [`FRAME_RATE_HZ`] by more than [`RATE_TOLERANCE`].
///
/// The prepared clip is [`Clutter::Settled`], and preparing it again changes nothing. The points of the
/// project's own chain are hardly ever static, so that simulated clips lose some only if their firmware reports the room.
///
/// ```
/// use radarllm_base::{Clip, Clutter, PointFrame};
/// use radarllm_inference::{PrepareOptions, prepare_for_model};
///
/// let frame = |i: u32| PointFrame { frame: i, time_s: f64::from(i) / 20.0, points: Vec::new(), board: None };
/// let clip = Clip {
///     frames: (0..40).map(frame).collect(),
///     frame_rate_hz: 20.0,
///     radar_height_m: 1.0,
///     is_height_assumed: false,
///     radar: "unknown".into(),
///     provenance: "recorded:csv:room.csv".parse().unwrap(),
///     clutter: Clutter::Unchecked,
/// };
/// let prepared = prepare_for_model(clip, &PrepareOptions::default())?;
/// assert_eq!(prepared.resampled_from_hz, Some(20.0));
/// assert_eq!((prepared.clip.frame_rate_hz, prepared.clip.frames.len()), (10.0, 21));
/// # Ok::<(), radarllm_inference::PrepareError>(())
/// ```
///
/// # Errors
/// [`PrepareError`]: a value that is not finite, or a frame rate outside the range of real radars.
pub fn prepare_for_model(
    mut clip: Clip,
    options: &PrepareOptions,
) -> Result<Prepared, PrepareError> {
    check(&clip)?;
    let mut removed_static = None;
    let mut parted = is_parted(&clip).then(|| {
        Box::new(Parted {
            moving: with_speed(&clip),
            reported: clip.clone(),
        })
    });
    if removes_static(&clip) {
        removed_static = clip.remove_static_clutter();
    }
    clip.clutter = Clutter::Settled;
    let mut resampled_from_hz = None;
    if is_other_rate(clip.frame_rate_hz) {
        resampled_from_hz = Some(clip.frame_rate_hz);
        let resample =
            |clip: Clip| clip.resample(f64::from(FRAME_RATE_HZ), options.motion_compensate);
        clip = resample(clip)?;
        if let Some(parted) = &mut parted {
            parted.moving = parted.moving.take().map(resample).transpose()?;
        }
    }
    Ok(Prepared {
        clip: PreparedClip {
            clip: Cow::Owned(clip),
            parted,
        },
        removed_static,
        resampled_from_hz,
    })
}

/// Whether [`prepare_for_model`] would change the frames of the clip.
fn needs_preparation(clip: &Clip) -> bool {
    is_other_rate(clip.frame_rate_hz) || is_parted(clip)
}

fn is_moving(point: &RadarPoint) -> bool {
    point.velocity_mps != 0.0
}

/// Whether the points that the model reads differ from those of [`PreparedClip::moving`] or from all points.
fn is_parted(clip: &Clip) -> bool {
    let points = || clip.frames.iter().flat_map(|f| &f.points);
    let has_both = || points().any(is_moving) && !points().all(is_moving);
    removes_static(clip) && (has_both() || clip.static_clutter().is_some())
}

/// The clip without the points whose speed is exactly zero; `None` if no point has a speed.
fn with_speed(clip: &Clip) -> Option<Clip> {
    let mut points = clip.frames.iter().flat_map(|f| &f.points);
    if !points.any(is_moving) {
        return None;
    }
    let frame = |frame: &PointFrame| {
        let points = frame.points.iter().filter(|p| is_moving(p));
        frame.with_points(points.copied().collect())
    };
    Some(Clip {
        clutter: Clutter::Settled,
        ..clip.with_frames(clip.frames.iter().map(frame).collect())
    })
}

fn removes_static(clip: &Clip) -> bool {
    clip.clutter == Clutter::Unchecked
}

fn is_other_rate(frame_rate_hz: f64) -> bool {
    (frame_rate_hz / f64::from(FRAME_RATE_HZ) - 1.0).abs() > RATE_TOLERANCE
}

fn check(clip: &Clip) -> Result<(), PrepareError> {
    let found_hz = clip.frame_rate_hz;
    // Written so that NaN fails the check.
    if !(found_hz > 0.0 && found_hz <= MAX_FRAME_RATE_HZ) {
        return Err(PrepareError::FrameRate { found_hz });
    }
    let found_m = clip.radar_height_m;
    if !found_m.is_finite() {
        return Err(PrepareError::RadarHeight { found_m });
    }
    for (frame, content) in clip.frames.iter().enumerate() {
        if !content.time_s.is_finite() {
            return Err(PrepareError::TimeNotFinite { frame });
        }
        if let Some(point) = position_not_finite(content) {
            return Err(PrepareError::NotFinite { frame, point });
        }
    }
    Ok(())
}

/// Finds the first point with a value that is not finite.
fn position_not_finite(frame: &PointFrame) -> Option<usize> {
    frame.points.iter().position(|p| {
        let values = [
            p.x_m,
            p.y_m,
            p.z_m,
            p.range_m,
            p.velocity_mps,
            p.intensity_db,
        ];
        !values.iter().all(|v| v.is_finite())
    })
}

#[cfg(test)]
mod tests {
    use radarllm_base::Provenance;

    use super::*;

    /// One second of frames, each with points of these radial velocities.
    fn clip(frame_rate_hz: f64, velocities: &[f32], provenance: Provenance) -> Clip {
        let point = |v: &f32| RadarPoint {
            y_m: 2.0,
            range_m: 2.0,
            velocity_mps: *v,
            ..RadarPoint::default()
        };
        let frame = |i: u32| PointFrame {
            frame: i,
            time_s: f64::from(i) / frame_rate_hz,
            points: velocities.iter().map(point).collect(),
            board: None,
        };
        Clip {
            frames: (0..frame_rate_hz as u32).map(frame).collect(),
            frame_rate_hz,
            radar_height_m: 1.0,
            is_height_assumed: false,
            radar: "unknown".into(),
            provenance,
            clutter: Clutter::Unchecked,
        }
    }

    fn recorded(frame_rate_hz: f64, velocities: &[f32]) -> Clip {
        clip(
            frame_rate_hz,
            velocities,
            Provenance::recorded("csv", "room.csv"),
        )
    }

    fn settled(mut clip: Clip) -> Clip {
        clip.clutter = Clutter::Settled;
        clip
    }

    fn prepare(clip: Clip) -> Prepared {
        prepare_for_model(clip, &PrepareOptions::default()).unwrap()
    }

    #[test]
    fn static_clutter_is_removed_unless_it_is_settled() {
        let velocities = [0.0, 0.0, 0.01, 0.8];
        let prepared = prepare(recorded(10.0, &velocities));
        assert_eq!(*prepared.clip, settled(recorded(10.0, &[0.8])));
        let removed = prepared.removed_static.unwrap();
        assert_eq!((removed.n_static, removed.n_points), (30, 40));
        // Simulated firmware may report the room, too; the project's own chain reports few static points.
        let simulated =
            |velocities: &[f32]| clip(10.0, velocities, Provenance::simulated("builtin:walk", 1));
        let prepared = prepare(simulated(&velocities));
        assert_eq!(*prepared.clip, settled(simulated(&[0.8])));
        let mostly_moving = [0.0, 0.3, 0.8];
        let prepared = prepare(simulated(&mostly_moving));
        assert_eq!(*prepared.clip, settled(simulated(&mostly_moving)));
        assert_eq!(prepared.removed_static, None);
        let all = settled(recorded(10.0, &velocities));
        let kept = prepare(all.clone());
        assert_eq!((kept.clip.into_clip(), kept.removed_static), (all, None));
    }

    #[test]
    fn slow_points_are_kept_beside_what_the_model_reads() {
        for rate_hz in [10.0, 15.0] {
            let clip = recorded(rate_hz, &[0.0, 0.0, 0.01, 0.8]);
            let prepared = PreparedClip::of(&clip).unwrap();
            let n_frames = prepared.frames.len();
            assert_eq!(prepared.n_points(), rate_hz as usize);
            assert_eq!(prepared.moving().n_points(), 2 * rate_hz as usize);
            assert_eq!(prepared.moving().frames.len(), n_frames);
        }
        // Of what is hardly ever static nothing is removed for the model.
        let clip = recorded(10.0, &[0.0, 0.3, 0.8]);
        let prepared = PreparedClip::of(&clip).unwrap();
        assert_eq!(
            (prepared.n_points(), prepared.moving().n_points()),
            (30, 20)
        );
        // Points without any speed, and points whose clutter is settled, are all there is.
        for clip in [recorded(10.0, &[0.0]), settled(recorded(10.0, &[0.0, 0.8]))] {
            let prepared = PreparedClip::of(&clip).unwrap();
            assert_eq!(prepared.moving(), &*prepared);
        }
    }

    #[test]
    fn other_frame_rates_are_resampled_and_near_ones_read_as_they_are() {
        for (rate_hz, n_frames) in [(9.6, 9), (10.0, 10), (10.4, 10)] {
            let prepared = prepare(recorded(rate_hz, &[0.8]));
            assert_eq!(prepared.resampled_from_hz, None, "{rate_hz}");
            assert_eq!(prepared.clip.frames.len(), n_frames);
        }
        for rate_hz in [5.0, 9.0, 11.0, 20.0, 30.0] {
            let prepared = prepare(recorded(rate_hz, &[0.8]));
            assert_eq!(prepared.resampled_from_hz, Some(rate_hz));
            assert_eq!(prepared.clip.frame_rate_hz, 10.0);
            // No frame is lost or repeated.
            assert_eq!(prepared.clip.n_points(), rate_hz as usize);
        }
    }

    #[test]
    fn motion_compensation_moves_points_to_their_new_frame() {
        let options = PrepareOptions {
            motion_compensate: true,
        };
        let moved = prepare_for_model(recorded(20.0, &[1.0]), &options).unwrap();
        let places: Vec<f32> = moved.clip.frames[1].points.iter().map(|p| p.y_m).collect();
        // Frames 0.05 s before and 0 s from the new frame; a point recedes at 1 m/s.
        assert!(
            places.iter().any(|y| (y - 2.05).abs() < 1e-5) && places.contains(&2.0),
            "{places:?}"
        );
    }

    #[test]
    fn preparing_again_changes_nothing() {
        for clip in [
            recorded(10.0, &[0.0, 0.0, 0.8]),
            recorded(25.0, &[0.0, 0.0, 0.8]),
            recorded(25.0, &[0.0, 0.8]),
            recorded(10.0, &[]),
        ] {
            let once = prepare(clip);
            assert!(!needs_preparation(&once.clip));
            let twice = prepare(once.clip.clone().into_clip());
            assert_eq!(
                (twice.removed_static, twice.resampled_from_hz),
                (None, None)
            );
            assert_eq!(*twice.clip, *once.clip);
        }
    }

    #[test]
    fn nothing_is_copied_when_nothing_changes() {
        let good = recorded(10.0, &[0.8]);
        assert!(matches!(
            PreparedClip::of(&good).unwrap().clip,
            Cow::Borrowed(_)
        ));
        let fast = recorded(20.0, &[0.8]);
        assert!(matches!(
            PreparedClip::of(&fast).unwrap().clip,
            Cow::Owned(_)
        ));
    }

    #[test]
    fn values_that_no_radar_reports_are_refused() {
        let refuse = |change: &dyn Fn(&mut Clip)| {
            let mut bad = recorded(10.0, &[0.8, 0.7]);
            change(&mut bad);
            let by_reference = PreparedClip::of(&bad).map(|_| ()).unwrap_err();
            let error = prepare_for_model(bad, &PrepareOptions::default()).unwrap_err();
            // NaN is not equal to itself, so the test compares the text.
            assert_eq!(by_reference.to_string(), error.to_string());
            error
        };
        for rate_hz in [0.0, -10.0, 1e4, f64::NAN, f64::INFINITY] {
            let error = refuse(&|clip| clip.frame_rate_hz = rate_hz);
            assert!(matches!(error, PrepareError::FrameRate { .. }), "{error}");
        }
        let error = refuse(&|clip| clip.radar_height_m = f32::NAN);
        assert!(matches!(error, PrepareError::RadarHeight { .. }), "{error}");
        let error = refuse(&|clip| clip.frames[3].time_s = f64::NAN);
        assert_eq!(error, PrepareError::TimeNotFinite { frame: 3 });
        let error = refuse(&|clip| clip.frames[3].points[1].z_m = f32::INFINITY);
        assert_eq!(error, PrepareError::NotFinite { frame: 3, point: 1 });
    }

    #[test]
    fn what_the_board_reported_is_kept_at_its_own_rate_and_cut_with_the_clip() {
        let clip = recorded(20.0, &[0.0, 0.0, 0.0, 0.8]);
        let prepared = prepare(clip.clone()).clip;
        assert_eq!(prepared.reported(), Some(&clip));
        assert_eq!(prepare(recorded(20.0, &[0.8])).clip.reported(), None);
        let part = prepared.part(4, 3);
        assert_eq!(part.frames[..], prepared.frames[4..7]);
        assert_eq!(part.moving().frames.len(), 3);
        let reported = &part.reported().unwrap().frames;
        assert!(reported.len() >= 5 && reported.iter().all(|f| f.points.len() == 4));
        let until_s = prepared.frames[7].time_s;
        assert!(
            reported
                .iter()
                .all(|f| (part.frames[0].time_s..until_s).contains(&f.time_s))
        );
        assert_eq!(prepared.part(0, usize::MAX), prepared);
        assert_eq!(prepared.part(50, 3).frames, []);
    }
}
