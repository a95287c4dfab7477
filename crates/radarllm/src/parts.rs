//! Recordings of any length, read in parts.
//!
//! A part has the frames of half a minute before and after it, so that what happens at its ends is seen as what happens in its
//! middle. Memory is that of a part.

use radarllm_base::{Clip, Clutter, PointFrame};
use radarllm_inference::{PrepareOptions, Prepared, prepare_for_model};
use radarllm_io::{CaptureOptions, Error, Opened, PointStream, RecordingKind, Result, StreamEnd};
use radarllm_measure::{Site, SiteError, SiteLearner};

use crate::{Recording, learn_from};

/// Recordings of at most this many frames are read as a whole: an hour at 10 frames/s.
const MAX_WHOLE_FRAMES: usize = 36_000;
/// The same for points.
const MAX_WHOLE_POINTS: usize = 2_000_000;
/// Frames of a part, and points after which it ends earlier, but not before [`MIN_PART_S`].
const PART_FRAMES: usize = 18_000;
const PART_POINTS: usize = 1_000_000;
const MIN_PART_S: f64 = 60.0;
/// Length of the times before and after a part that are read with it, s.
const MARGIN_S: f64 = 30.0;

/// An input that was read: as a whole, or too long for that.
#[derive(Debug)]
pub enum Input {
    /// All of it.
    Whole(Box<Recording>),
    /// A long recording, to be read in parts.
    Long(Box<LongRecording>),
}

/// A recording that is too long to be kept in memory as a whole. It was read once, for what is known at its end alone;
/// [`LongRecording::parts`] reads it again.
#[derive(Debug)]
pub struct LongRecording {
    source: LongSource,
    prepare: PrepareOptions,
    /// What is known of the recording, without its frames.
    pub about: Clip,
    /// Notes for the user: how the format was detected, what was dropped.
    pub notes: Vec<String>,
    /// What a user should know before trusting the points, a sentence each.
    pub warnings: Vec<String>,
    /// What people who walk show of the site; `None` if the board tracks nobody and the points do not show it.
    pub site: Option<std::result::Result<Site, SiteError>>,
}

/// Where the frames of a long recording come from.
enum LongSource {
    /// A file that is read again.
    File(Box<(Opened, CaptureOptions)>),
    /// The frames of a format that is read as a whole.
    Memory(Vec<PointFrame>),
}

impl std::fmt::Debug for LongSource {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::File(_) => "File",
            Self::Memory(_) => "Memory",
        })
    }
}

/// A part of a long recording.
#[derive(Debug)]
pub struct Part {
    /// The part as the model expects it, with the times before and after it. Its first frame is at 0 s.
    pub prepared: Prepared,
    /// Time of its first frame on the clock of the recording, s.
    pub offset_s: f64,
    /// Beginning and end of the part itself on the clock of the recording, s.
    pub span_s: [f64; 2],
}

impl Input {
    /// An input that is in memory.
    pub(crate) fn of(recording: Recording, prepare: PrepareOptions) -> Self {
        let clip = &recording.clip;
        let is_short = clip.frames.len() <= MAX_WHOLE_FRAMES && clip.n_points() <= MAX_WHOLE_POINTS;
        // Motions that were simulated just now are what was performed as a whole.
        if is_short || recording.performed.is_some() {
            return Self::Whole(Box::new(recording));
        }
        let mut survey = Survey::default();
        let mut about = recording.clip;
        let frames = std::mem::take(&mut about.frames);
        frames.chunks(PART_FRAMES).for_each(|part| survey.add(part));
        Self::Long(Box::new(LongRecording {
            source: LongSource::Memory(frames),
            prepare,
            site: survey.site(&about.radar),
            about,
            notes: recording.notes,
            warnings: recording.warnings,
        }))
    }

    /// Reads a file frame by frame, and keeps the frames of one that is not long. `again` is the same file.
    pub(crate) fn of_stream(
        mut stream: PointStream,
        again: Opened,
        options: &CaptureOptions,
        prepare: PrepareOptions,
    ) -> Result<Self> {
        let mut frames: Vec<PointFrame> = Vec::new();
        let mut survey: Option<Survey> = None;
        let mut n_points = 0;
        while let Some(frame) = stream.next_frame()? {
            n_points += frame.points.len();
            frames.push(frame);
            let max_frames = match survey {
                Some(_) => PART_FRAMES,
                None => MAX_WHOLE_FRAMES,
            };
            if frames.len() > max_frames || n_points > MAX_WHOLE_POINTS {
                survey.get_or_insert_default().add(&frames);
                frames.clear();
                n_points = 0;
            }
        }
        let mut about = stream.about()?;
        let StreamEnd {
            notes,
            warnings,
            has_speeds,
        } = stream.finish()?;
        if !has_speeds {
            about.clutter = Clutter::Settled;
        }
        let Some(mut survey) = survey else {
            about.frames = frames;
            let recording = radarllm_io::Recording {
                clip: about,
                notes,
                warnings,
            };
            return Ok(Self::Whole(Box::new(Recording::of(recording, prepare))));
        };
        survey.add(&frames);
        Ok(Self::Long(Box::new(LongRecording {
            source: LongSource::File(Box::new((again, options.clone()))),
            prepare,
            site: survey.site(&about.radar),
            about,
            notes,
            warnings,
        })))
    }
}

/// Whether a capture of points is in a file, which can be read twice.
pub(crate) fn is_read_twice(opened: &Opened) -> bool {
    let holds_points = !matches!(opened.kind(), RecordingKind::Samples(_));
    holds_points && opened.captures().iter().all(|path| path.is_file())
}

/// What is learned while a long recording is read for the first time.
#[derive(Default)]
struct Survey {
    has_tracks: bool,
    learner: SiteLearner,
    /// What people show whom the points alone show.
    by_points: SiteLearner,
}

impl Survey {
    fn add(&mut self, frames: &[PointFrame]) {
        let mut reports = frames.iter().flat_map(|f| &f.board);
        if reports.any(|report| !report.tracks.is_empty()) {
            self.has_tracks = true;
            self.learner.add(frames);
        } else if !self.has_tracks {
            learn_from(&mut self.by_points, frames);
        }
    }

    fn site(&self, radar: &str) -> Option<std::result::Result<Site, SiteError>> {
        match self.has_tracks {
            true => Some(self.learner.site(radar)),
            false => self.by_points.site(radar).ok().map(Ok),
        }
    }
}

impl LongRecording {
    /// The parts, in order.
    ///
    /// # Errors
    /// A file that cannot be opened again.
    pub fn parts(self) -> Result<Parts> {
        let frames = match self.source {
            LongSource::File(file) => {
                let (opened, options) = *file;
                let stream = PointStream::open(opened, &options)?;
                Frames::File(Box::new(stream.ok_or_else(changed)?))
            }
            LongSource::Memory(frames) => Frames::Memory {
                n_frames: frames.len(),
                rest: frames.into_iter(),
            },
        };
        Ok(Parts {
            frames,
            about: self.about,
            prepare: self.prepare,
            held: Vec::new(),
            first: 0,
            is_over: false,
        })
    }
}

/// The error of a recording that is another one when it is read again.
fn changed() -> Error {
    Error::input("the recording changed while it was read")
}

/// The frames of a long recording, one after the other.
enum Frames {
    File(Box<PointStream>),
    Memory {
        n_frames: usize,
        rest: std::vec::IntoIter<PointFrame>,
    },
}

/// The parts of a long recording.
pub struct Parts {
    frames: Frames,
    about: Clip,
    prepare: PrepareOptions,
    /// Frames that were read: of the margin before the next part, and of the part itself from `first` on.
    held: Vec<PointFrame>,
    first: usize,
    is_over: bool,
}

impl Parts {
    /// Share of the recording that was read, 0..=1, if it is known.
    pub fn share_read(&self) -> Option<f64> {
        match &self.frames {
            Frames::File(stream) => stream.share_read(),
            Frames::Memory { n_frames, rest } => {
                Some(1.0 - rest.len() as f64 / (*n_frames).max(1) as f64)
            }
        }
    }

    /// Reads one more frame into `held`; false at the end.
    fn read(&mut self) -> Result<bool> {
        let next = match &mut self.frames {
            Frames::File(stream) => stream.next_frame()?,
            Frames::Memory { rest, .. } => rest.next(),
        };
        let is_some = next.is_some();
        self.held.extend(next);
        Ok(is_some)
    }

    /// Reads until the part from `first` on is complete. Returns the index of the frame after it, which is that of the first
    /// frame of the next part.
    fn read_part(&mut self) -> Result<usize> {
        let mut end = self.first;
        let mut n_points = 0;
        loop {
            if end == self.held.len() && !self.read()? {
                return Ok(end);
            }
            let length_s = self.held[end].time_s - self.held[self.first].time_s;
            let is_full = end - self.first >= PART_FRAMES || n_points >= PART_POINTS;
            if is_full && length_s >= MIN_PART_S {
                return Ok(end);
            }
            n_points += self.held[end].points.len();
            end += 1;
        }
    }

    fn next_part(&mut self) -> Result<Option<Part>> {
        if self.is_over {
            return Ok(None);
        }
        let end = self.read_part()?;
        if end == self.first {
            self.is_over = true;
            return Ok(None);
        }
        let start_s = self.held[self.first].time_s;
        let end_s = self.held.get(end).map(|f| f.time_s);
        while let (Some(end_s), Some(last)) = (end_s, self.held.last())
            && last.time_s < end_s + MARGIN_S
        {
            if !self.read()? {
                self.is_over = true;
                break;
            }
        }
        // What is left after the part is shorter than the margin: it belongs to the part.
        self.is_over |= end_s.is_none();
        let span_s = match end_s.filter(|_| !self.is_over) {
            Some(end_s) => [start_s, end_s],
            None => [start_s, f64::INFINITY],
        };
        let before_s = span_s[1] - MARGIN_S;
        let kept = self.held.partition_point(|f| f.time_s < before_s);
        let next = self.held[kept..].to_vec();
        self.first = end - kept.min(end);
        let frames = std::mem::replace(&mut self.held, next);
        let offset_s = frames.first().map_or(0.0, |f| f.time_s);
        let first = frames.first().map_or(0, |f| f.frame);
        let from_its_start = |frame: PointFrame| PointFrame {
            frame: frame.frame - first,
            time_s: frame.time_s - offset_s,
            ..frame
        };
        let clip = self
            .about
            .with_frames(frames.into_iter().map(from_its_start).collect());
        Ok(Some(Part {
            prepared: prepare_for_model(clip, &self.prepare).map_err(Error::wrap)?,
            offset_s,
            span_s,
        }))
    }
}

impl Iterator for Parts {
    type Item = Result<Part>;

    fn next(&mut self) -> Option<Self::Item> {
        let part = self.next_part();
        self.is_over |= part.is_err();
        part.transpose()
    }
}

#[cfg(test)]
mod tests {
    use radarllm_base::{BoardReport, BoardTrack, RadarPoint};
    use radarllm_inference::DescribeOptions;

    use super::*;
    use crate::Captioner;

    /// A recording at 10 frames/s of a board that tracks people.
    fn recording(n_frames: u32, frame: impl Fn(f64) -> Option<[f32; 3]>) -> Recording {
        let frame = |i: u32| {
            let time_s = f64::from(i) / 10.0;
            let track = |[y_m, z_m, up_mps]: [f32; 3]| BoardTrack {
                id: 3,
                place_m: [0.0, y_m],
                height_m: Some(z_m),
                velocity_mps: [0.0, 0.0, up_mps],
            };
            PointFrame {
                frame: i,
                time_s,
                points: vec![RadarPoint {
                    y_m: i as f32,
                    velocity_mps: 1.0,
                    ..RadarPoint::default()
                }],
                board: Some(BoardReport {
                    tracks: frame(time_s).into_iter().map(track).collect(),
                    is_present: None,
                }),
            }
        };
        let clip = Clip {
            frames: (0..n_frames).map(frame).collect(),
            frame_rate_hz: 10.0,
            radar_height_m: 1.0,
            is_height_assumed: false,
            radar: "board".into(),
            provenance: "recorded:csv:x".parse().unwrap(),
            clutter: Clutter::Unchecked,
        };
        Recording::new(clip, Vec::new(), PrepareOptions::default())
    }

    fn long(recording: Recording) -> LongRecording {
        match Input::of(recording, PrepareOptions::default()) {
            Input::Long(long) => *long,
            Input::Whole(_) => panic!("the recording is not long"),
        }
    }

    #[test]
    fn every_frame_is_in_one_part_with_what_is_around_it() {
        for n_frames in [36_001, 36_200, 54_000, 54_100, 54_301] {
            let mut all = recording(n_frames, |_| None);
            // An hour without frames, and the clock of a restarted board.
            for frame in &mut all.clip.frames[20_000..] {
                frame.frame += 36_000;
                frame.time_s += 3_600.0;
            }
            let whole = all.clip.frames.clone();
            let mut n_seen = 0;
            let mut before_s = 0.0;
            for part in long(all).parts().unwrap() {
                let part = part.unwrap();
                let [start_s, end_s] = part.span_s;
                assert!(start_s == before_s || start_s == before_s + 3_600.0);
                before_s = end_s;
                let frames = &part.prepared.clip.frames;
                let first_s = frames[0].time_s + part.offset_s;
                assert!(n_seen == 0 || start_s - first_s <= MARGIN_S);
                let own = frames
                    .iter()
                    .filter(|f| (start_s..end_s).contains(&(f.time_s + part.offset_s + 1e-9)));
                for frame in own {
                    let expected = &whole[n_seen];
                    assert!((frame.time_s + part.offset_s - expected.time_s).abs() < 1e-6);
                    assert_eq!(frame.points, expected.points);
                    n_seen += 1;
                }
            }
            assert_eq!((n_seen, before_s), (whole.len(), f64::INFINITY));
        }
    }

    /// Somebody walks, sits, falls where one part ends and the next one begins, and lies for the rest of the time.
    #[test]
    fn a_long_recording_is_described_like_one_in_memory() {
        let boundary_s = PART_FRAMES as f64 / 10.0;
        let fall_s = boundary_s - 0.5;
        let at = |t: f64| {
            let to_and_fro = (t as f32 * 0.8).rem_euclid(6.0);
            let y_m = 1.0 + (3.0 - (to_and_fro - 3.0).abs());
            match t {
                t if t < 300.0 => Some([y_m, 0.6, 0.0]),
                t if t < fall_s - 20.0 => Some([2.0, 0.1, 0.0]),
                t if t < fall_s => Some([2.0, 0.6, 0.0]),
                t if t < fall_s + 1.0 => Some([2.0, 0.6 - 1.4 * (t - fall_s) as f32, -1.4]),
                _ => Some([2.0, -0.8, 0.0]),
            }
        };
        let n_frames = 40_000;
        let captioner = Captioner::bundled().unwrap();
        let options = DescribeOptions::default();
        let whole = captioner.describe(&recording(n_frames, at).clip).unwrap();
        let mut shares = Vec::new();
        let parts = captioner
            .describe_long(long(recording(n_frames, at)), &options, |share| {
                shares.extend(share);
            })
            .unwrap();
        let segments = &parts.description.segments;
        let actions: Vec<_> = segments.iter().map(|s| &s.actions[..]).collect();
        assert_eq!(
            actions,
            [
                ["pace"],
                ["sit_still"],
                ["stand_still"],
                ["fall"],
                ["lie_still"]
            ],
            "{segments:?}"
        );
        assert_eq!(segments.len(), whole.segments.len());
        for (a, b) in segments.iter().zip(&whole.segments) {
            assert_eq!(a.caption, b.caption);
            assert!((a.start_s - b.start_s).abs() <= 1.0 && (a.end_s - b.end_s).abs() <= 1.0);
            assert!((a.confidence - b.confidence).abs() < 0.05, "{a:?} {b:?}");
        }
        assert_eq!(parts.frames, n_frames as usize);
        assert_eq!((parts.seconds, parts.gaps), (4_000.0, Vec::new()));
        assert!(shares.is_sorted());
        assert_eq!((shares.len(), shares[2]), (3, 1.0));
    }

    /// A packet of the out-of-box demo with one point; every tenth packet has none.
    #[cfg(feature = "parquet")]
    fn packet(number: u32) -> Vec<u8> {
        let n_points = u32::from(!number.is_multiple_of(10));
        let length = 40 + n_points * 56;
        let mut bytes = vec![2, 1, 4, 3, 6, 5, 8, 7];
        let words = [
            0x0306_0000,
            length,
            0xA6843,
            number,
            0,
            n_points,
            n_points,
            0,
        ];
        bytes.extend(words.iter().flat_map(|w: &u32| w.to_le_bytes()));
        if n_points > 0 {
            bytes.extend([1_u32, 16].iter().flat_map(|w| w.to_le_bytes()));
            let values = [0.5, 2.0, number as f32 / 1e4, -0.5];
            bytes.extend(values.iter().flat_map(|v: &f32| v.to_le_bytes()));
        }
        bytes.resize(length as usize, 0);
        bytes
    }

    #[test]
    #[cfg(feature = "parquet")]
    fn long_streams_and_points_files_are_read_in_parts_as_they_are_read_as_a_whole() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("long.dat");
        // Lost packets, a damaged number and a restart of the board.
        let numbers = (0..40_000_u32).filter(|n| n % 97 != 5);
        let numbers = numbers.map(|n| match n {
            9_000 => 9_000 | 1 << 20,
            n if n > 30_000 => n - 30_000,
            n => n,
        });
        std::fs::write(&path, numbers.flat_map(packet).collect::<Vec<u8>>()).unwrap();
        let mut options = CaptureOptions::default();
        options.points.frame_rate_hz = Some(10.0);
        let source = || crate::open(&path).with_options(options.clone());
        let whole = source().points().unwrap();
        let long = match source().read().unwrap() {
            Input::Long(long) => *long,
            Input::Whole(_) => panic!("the recording is not long"),
        };
        assert_eq!(long.notes, whole.notes);
        assert_eq!(long.warnings, whole.warnings);
        assert!(
            long.warnings
                .iter()
                .any(|w| w.contains("went back 1 times"))
        );
        let mut about = whole.clip.clone();
        about.frames.clear();
        assert_eq!((&long.about, long.site.is_none()), (&about, true));
        let mut read = Vec::new();
        for part in long.parts().unwrap() {
            let Part {
                prepared,
                offset_s,
                span_s: [start_s, end_s],
            } = part.unwrap();
            let frames = prepared.clip.into_clip().frames.into_iter();
            let own = |f: &PointFrame| (start_s..end_s).contains(&(f.time_s + offset_s + 1e-9));
            read.extend(frames.filter(own).map(|f| f.points));
        }
        let expected: Vec<_> = whole.clip.frames.iter().map(|f| f.points.clone()).collect();
        assert_eq!(read, expected);

        // The same points as a points file.
        let points = dir.path().join("long.parquet");
        crate::write_clip(&points, &whole.clip, crate::Overwrite::Refuse).unwrap();
        let Input::Long(long) = crate::open(&points).read().unwrap() else {
            panic!("the points file is not long")
        };
        assert_eq!(long.about, about);
        let n_frames = long.parts().unwrap().map(|part| {
            let Part {
                prepared,
                offset_s,
                span_s: [start_s, end_s],
            } = part.unwrap();
            let times = prepared.clip.frames.iter().map(|f| f.time_s);
            let own = |t_s: &f64| (start_s..end_s).contains(&(t_s + offset_s + 1e-9));
            times.filter(own).count()
        });
        assert_eq!(n_frames.sum::<usize>(), expected.len());

        // What is wrong with a stream is told of a long one, too.
        let no_rate = crate::open(&path).read().unwrap_err();
        assert_eq!(
            no_rate.to_string(),
            crate::open(&path).points().unwrap_err().to_string()
        );
    }
}
