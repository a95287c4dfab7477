//! A clip of radar points with the metadata that every consumer needs.

use std::{convert::Infallible, fmt, str::FromStr};

use crate::{
    PointFrame, StaticCells,
    timeline::{Timeline, TimelineError},
};

/// Radial speeds below this value count as static, m/s. It is less than one velocity bin of every built-in radar.
pub const STATIC_SPEED_MPS: f32 = 0.05;

/// Radar frames with their frame rate, radar and provenance.
///
/// Models, trackers and pages take a clip, never bare frames. Without its frame rate, a frame sequence contains no
/// information about speed. Without its provenance, a generated sentence must not be shown to any user.
///
/// ```
/// use radarllm_base::{Clip, Clutter, PointFrame};
///
/// let clip = Clip {
///     frames: vec![PointFrame::default(); 25],
///     frame_rate_hz: 10.0,
///     radar_height_m: 1.0,
///     is_height_assumed: false,
///     radar: "awr1843boost".into(),
///     provenance: "recorded:uart:living-room.dat".parse().unwrap(),
///     clutter: Clutter::Unchecked,
/// };
/// assert_eq!(clip.duration_s(), 2.5);
/// assert!(!clip.provenance.is_simulated());
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Clip {
    /// Radar frames in order of time. Frames without a detection are present and empty.
    pub frames: Vec<PointFrame>,
    /// Radar frames per second.
    pub frame_rate_hz: f64,
    /// Height of the radar above the floor, m.
    pub radar_height_m: f32,
    /// Whether no source states this height, so that it is a usual one. Postures and falls are told by heights.
    pub is_height_assumed: bool,
    /// Name of the radar; `unknown` if no source specifies it.
    pub radar: String,
    /// Where the points come from.
    pub provenance: Provenance,
    /// Whether static clutter may still be among the points.
    pub clutter: Clutter,
}

/// What is known about frames of points, whether they come from a running radar or are a [`Clip`].
#[derive(Clone, Debug, PartialEq)]
pub struct SourceInfo {
    /// Name of the radar; `unknown` if no source specifies it.
    pub radar: String,
    /// Height of the radar above the floor, m.
    pub radar_height_m: f32,
    /// Whether no source states this height, so that it is a usual one.
    pub is_height_assumed: bool,
    /// Time between two frames, s.
    pub frame_period_s: f64,
    /// Whether static clutter may still be among the points.
    pub clutter: Clutter,
    /// Where the points come from.
    pub provenance: Provenance,
}

/// Whether static clutter may be among the points of a clip.
///
/// The clip carries this state so that clutter removal is decided once. A person who lies still has mostly static
/// points; the clip of a tracked person would otherwise lose them in a second removal.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Clutter {
    /// The points are as the source reported them.
    #[default]
    Unchecked,
    /// Static clutter has been removed, or every point is to be kept.
    Settled,
}

impl Clip {
    /// A clip of other frames with the metadata of this one.
    pub fn with_frames(&self, frames: Vec<PointFrame>) -> Self {
        Self {
            frames,
            frame_rate_hz: self.frame_rate_hz,
            radar_height_m: self.radar_height_m,
            is_height_assumed: self.is_height_assumed,
            radar: self.radar.clone(),
            provenance: self.provenance.clone(),
            clutter: self.clutter,
        }
    }

    /// The clip as a board would have sent it that tracks nobody.
    #[must_use]
    pub fn without_tracks(mut self) -> Self {
        for frame in &mut self.frames {
            frame.board = None;
        }
        self
    }

    /// What is known about the frames.
    pub fn source_info(&self) -> SourceInfo {
        SourceInfo {
            radar: self.radar.clone(),
            radar_height_m: self.radar_height_m,
            is_height_assumed: self.is_height_assumed,
            frame_period_s: 1.0 / self.frame_rate_hz,
            clutter: self.clutter,
            provenance: self.provenance.clone(),
        }
    }

    /// Length, s: number of frames divided by the frame rate.
    pub fn duration_s(&self) -> f64 {
        self.frames.len() as f64 / self.frame_rate_hz
    }

    /// Total number of points.
    pub fn n_points(&self) -> usize {
        self.frames.iter().map(|f| f.points.len()).sum()
    }

    /// Mean number of points per frame; 0 if there are no frames.
    pub fn points_per_frame(&self) -> f64 {
        self.n_points() as f64 / self.frames.len().max(1) as f64
    }

    /// Whether the speeds of the points are known: one of them has a speed, or there are no points at all, or the points come
    /// from a source that always measures speeds. Otherwise no point is known to be static.
    pub fn has_speeds(&self) -> bool {
        let mut points = self.frames.iter().flat_map(|f| &f.points).peekable();
        points.peek().is_none()
            || points.any(|p| p.velocity_mps != 0.0)
            || (self.clutter == Clutter::Unchecked && self.provenance.measures_speeds())
    }

    /// Resamples the points to another frame rate; see [`Timeline::resample`]. The strongest points of each frame come
    /// first.
    ///
    /// # Errors
    /// [`TimelineError`] for an impossible rate or too many frames.
    pub fn resample(
        self,
        frame_rate_hz: f64,
        motion_compensate: bool,
    ) -> Result<Self, TimelineError> {
        let timeline = Timeline::from_frames(self.frames, self.frame_rate_hz);
        let mut timeline = timeline.resample(frame_rate_hz, motion_compensate)?;
        timeline
            .frames
            .iter_mut()
            .for_each(PointFrame::sort_by_intensity);
        Ok(Self {
            frames: timeline.frames,
            frame_rate_hz: timeline.frame_rate_hz,
            ..self
        })
    }

    /// Counts the static points. Returns `Some` only if the clip shows static clutter rather than a person:
    /// [`StaticCells::clutter`].
    pub fn static_clutter(&self) -> Option<StaticClutter> {
        StaticClutter::of(&self.frames)
    }

    /// Removes the static points of an [`Clutter::Unchecked`] clip if they are more than half of all points or the radar
    /// reports the coupling between its antennas, and returns their number. Afterwards the clip is [`Clutter::Settled`].
    ///
    /// Models are trained on radars that remove static clutter from their samples. Firmware that does not remove it
    /// reports little else.
    pub fn remove_static_clutter(&mut self) -> Option<StaticClutter> {
        if std::mem::replace(&mut self.clutter, Clutter::Settled) == Clutter::Settled {
            return None;
        }
        let cells = StaticCells::of(&self.frames);
        let clutter = cells.clutter(&self.frames)?;
        cells.remove(&mut self.frames);
        Some(clutter)
    }
}

/// Share of static points in frames that show static clutter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StaticClutter {
    /// Static points: [`StaticCells::is_static`].
    pub n_static: usize,
    /// All points.
    pub n_points: usize,
}

impl StaticClutter {
    /// Counts static points. Returns `None` if they are no clutter: [`StaticCells::clutter`].
    pub fn of(frames: &[PointFrame]) -> Option<Self> {
        StaticCells::of(frames).clutter(frames)
    }
}

impl fmt::Display for StaticClutter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} of {} points are static",
            self.n_static, self.n_points
        )
    }
}

/// Origin of the points.
///
/// The text form is stored in points files and printed in outputs: `simulated:INPUT`, `recorded:FORMAT:PATH`, or
/// `recorded:PATH` if the format is not known. Every text can be parsed, and a parsed text prints unchanged.
///
/// ```
/// use radarllm_base::Provenance;
///
/// let provenance: Provenance = "simulated:builtin:walk?direction=backward".parse().unwrap();
/// assert!(provenance.is_simulated());
/// assert_eq!(provenance.input(), "builtin:walk?direction=backward");
/// assert_eq!(provenance.to_string(), "simulated:builtin:walk?direction=backward");
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Provenance {
    /// The virtual radar computed the points.
    Simulated {
        /// Input of the simulation: a motion file, a built-in motion or a scene.
        input: String,
        /// Seed of the simulation, where known.
        seed: Option<u64>,
    },
    /// A real radar measured them.
    Recorded {
        /// Name of the recording's format, where known.
        format: Option<String>,
        /// File, folder, port or address of the recording.
        path: String,
    },
}

impl Provenance {
    /// A recording of a named format.
    pub fn recorded(format: &str, path: impl fmt::Display) -> Self {
        Self::Recorded {
            format: Some(format.into()),
            path: path.to_string(),
        }
    }

    /// Points simulated from an input with a seed.
    pub fn simulated(input: impl fmt::Display, seed: u64) -> Self {
        Self::Simulated {
            input: input.to_string(),
            seed: Some(seed),
        }
    }

    /// Whether the points were computed by the virtual radar.
    pub fn is_simulated(&self) -> bool {
        matches!(self, Self::Simulated { .. })
    }

    /// `simulated` or `recorded`.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Simulated { .. } => "simulated",
            Self::Recorded { .. } => "recorded",
        }
    }

    /// The simulated input or the recording's path.
    pub fn input(&self) -> &str {
        match self {
            Self::Simulated { input, .. } => input,
            Self::Recorded { path, .. } => path,
        }
    }

    /// Whether every point of this source has a measured speed, so that one without a speed is static: simulated and raw
    /// samples, and streams of packets, whose points have speeds unless the clip says otherwise.
    pub fn measures_speeds(&self) -> bool {
        const FORMATS: [&str; 3] = ["adc", "dca1000", "uart"];
        match self {
            Self::Simulated { .. } => true,
            Self::Recorded { format, .. } => {
                (format.as_deref()).is_some_and(|format| FORMATS.contains(&format))
            }
        }
    }

    /// Name of the recording's format, where known.
    pub fn format(&self) -> Option<&str> {
        match self {
            Self::Simulated { .. } => None,
            Self::Recorded { format, .. } => format.as_deref(),
        }
    }

    /// Seed of the simulation; `None` for recordings.
    pub fn seed(&self) -> Option<u64> {
        match self {
            Self::Simulated { seed, .. } => *seed,
            Self::Recorded { .. } => None,
        }
    }
}

impl fmt::Display for Provenance {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Simulated { input, .. } => write!(f, "simulated:{input}"),
            Self::Recorded {
                format: Some(format),
                path,
            } => write!(f, "recorded:{format}:{path}"),
            Self::Recorded { format: None, path } => write!(f, "recorded:{path}"),
        }
    }
}

impl FromStr for Provenance {
    type Err = Infallible;

    /// Parses the text form. Text that does not begin with `simulated:` is a recording, so points of unknown origin are
    /// never classified as simulated. The seed is `None` because the text form does not contain it.
    fn from_str(text: &str) -> Result<Self, Infallible> {
        if let Some(input) = text.strip_prefix("simulated:") {
            return Ok(Self::Simulated {
                input: input.into(),
                seed: None,
            });
        }
        let rest = text.strip_prefix("recorded:").unwrap_or(text);
        let is_format = |name: &str| {
            !name.is_empty()
                && name
                    .chars()
                    .all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || "-()".contains(c))
        };
        Ok(match rest.split_once(':') {
            Some((format, path)) if is_format(format) => Self::recorded(format, path),
            _ => Self::Recorded {
                format: None,
                path: rest.into(),
            },
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{BoardReport, RadarPoint};

    fn clip(velocities: &[f32]) -> Clip {
        let points = velocities.iter().map(|v| RadarPoint {
            velocity_mps: *v,
            ..RadarPoint::default()
        });
        Clip {
            frames: vec![PointFrame {
                frame: 0,
                time_s: 0.0,
                points: points.collect(),
                board: None,
            }],
            frame_rate_hz: 10.0,
            radar_height_m: 1.0,
            is_height_assumed: false,
            radar: "unknown".into(),
            provenance: Provenance::recorded("csv", "room.csv"),
            clutter: Clutter::Unchecked,
        }
    }

    #[test]
    fn static_points_are_removed_only_where_they_are_the_majority() {
        let mut room = clip(&[0.0, 0.0, -0.6, 0.0, 0.6]);
        let clutter = room.remove_static_clutter().unwrap();
        assert_eq!(clutter.to_string(), "3 of 5 points are static");
        let settled = |velocities: &[f32]| Clip {
            clutter: Clutter::Settled,
            ..clip(velocities)
        };
        assert_eq!(room, settled(&[-0.6, 0.6]));
        // The removal is decided once: what is left of a room may be static.
        let mut lying = settled(&[0.0, 0.0, 0.6]);
        assert_eq!(lying.remove_static_clutter(), None);
        assert_eq!(lying, settled(&[0.0, 0.0, 0.6]));
        // A person who pauses is not clutter: half of the points may be static.
        let mut person = clip(&[0.0, 0.0, -0.6, 0.6]);
        assert_eq!(person.remove_static_clutter(), None);
        assert_eq!(person, settled(&[0.0, 0.0, -0.6, 0.6]));
        assert_eq!(clip(&[]).remove_static_clutter(), None);
    }

    #[test]
    fn without_tracks_only_the_reports_of_the_board_are_missing() {
        let points_alone = clip(&[0.0, 0.6]);
        let mut tracked = points_alone.clone();
        tracked.frames[0].board = Some(BoardReport {
            tracks: Vec::new(),
            is_present: Some(true),
        });
        assert_ne!(tracked, points_alone);
        assert_eq!(tracked.without_tracks(), points_alone);
    }

    #[test]
    fn provenance_survives_its_text_form() {
        for text in [
            "simulated:builtin:walk?side=left",
            "recorded:uart:room.dat",
            "recorded:mmbody(lab1):sequence_3",
            "recorded:a.bin+b.bin",
            "recorded:csv:room.csv (person 3)",
        ] {
            let provenance: Provenance = text.parse().unwrap();
            assert_eq!(provenance.to_string(), text);
            assert_eq!(provenance.is_simulated(), text.starts_with("simulated:"));
        }
        // Text without a known prefix is a recording: simulated points are always labelled.
        let Ok(unknown) = "somewhere".parse::<Provenance>();
        assert_eq!((unknown.kind(), unknown.input()), ("recorded", "somewhere"));
    }
}
