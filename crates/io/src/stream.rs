//! Recorded points frame by frame: what a recording of any length needs no memory for.
//!
//! A stream of packets is parsed while it is read, and each frame gets its time and its place before the next one is read. A
//! points file is read row group by row group.

use std::{collections::VecDeque, io::Read, path::PathBuf};

use radarllm_base::{
    Clip, Clutter, NumberClock, PointFrame, Provenance, RecordedFrame, Timeline, TimelineError,
    message::option,
};
use radarllm_dataset::PointsReader;
use radarllm_formats::{
    RecordingFormat,
    uart::{Guess, SubframeJoiner, UartError, UartParser, UartReport},
};

use crate::{
    cleaning,
    error::{Error, Result},
    opened::{Opened, RecordingKind},
    options::{CaptureOptions, DEFAULT_RADAR_HEIGHT_M},
    placing::Placing,
    points::{
        RecordedPoints, about_numbers, check_stream, explain_reasons, mounting, no_rate, radar_name,
    },
    radar::OpenedRadar,
    recording::{NO_SPEEDS, about_points_file, not_used_of},
    serial, visualizer,
};

/// Number of bytes read from a stream at a time.
const PIECE_BYTES: usize = 64 << 10;

/// A recording of points that is read frame by frame. The frames are those of [`crate::read_recording`].
pub enum PointStream {
    /// A stream of packets of a board.
    Uart(Box<UartStream>),
    /// A points file of this project.
    PointsFile(Box<PointsFileStream>),
}

impl PointStream {
    /// Begins to read a capture; `None` if it is read as a whole. Points of the empty scene are removed if the options name
    /// one.
    ///
    /// # Errors
    /// A file that cannot be opened, and any error in the options.
    pub fn open(capture: Opened, options: &CaptureOptions) -> Result<Option<Self>> {
        Ok(match capture.kind() {
            RecordingKind::PointsFile => {
                PointsFileStream::open(capture, options)?.map(|s| Self::PointsFile(Box::new(s)))
            }
            _ if UartStream::can_read(&capture) => {
                Some(Self::Uart(Box::new(UartStream::open(capture, options)?)))
            }
            _ => None,
        })
    }

    /// Share of the recording that was read, 0..=1; `None` where its length is not known.
    pub fn share_read(&self) -> Option<f64> {
        match self {
            Self::Uart(stream) => stream.share_read(),
            Self::PointsFile(stream) => Some(stream.reader.share_read()),
        }
    }

    /// What is known of the recording before its end, without frames.
    ///
    /// # Errors
    /// If neither the options nor the recording give the frame rate.
    pub fn about(&self) -> Result<Clip> {
        match self {
            Self::Uart(stream) => stream.about(),
            Self::PointsFile(stream) => Ok(stream.about.clone()),
        }
    }

    /// The next frame in level axes, strongest points first; `None` at the end.
    ///
    /// # Errors
    /// A file that cannot be read, a dialect that is not clear, a stream in which nothing of what was detected can be read, a
    /// missing frame rate, or too many frames.
    pub fn next_frame(&mut self) -> Result<Option<PointFrame>> {
        match self {
            Self::Uart(stream) => stream.next_frame(),
            Self::PointsFile(stream) => stream.next_frame(),
        }
    }

    /// What is known once the recording was read.
    ///
    /// # Errors
    /// A stream in which nothing of what was detected can be read.
    pub fn finish(self) -> Result<StreamEnd> {
        let mut end = match self {
            Self::Uart(stream) => stream.finish()?,
            Self::PointsFile(stream) => stream.finish(),
        };
        if !end.has_speeds {
            end.notes.push(NO_SPEEDS.into());
        }
        Ok(end)
    }
}

/// A points file that is read frame by frame.
pub struct PointsFileStream {
    reader: PointsReader,
    about: Clip,
    placing: Placing,
    /// Whether there are points, and one of them has a speed.
    has_points: bool,
    has_speed: bool,
    /// Options that are not used.
    warnings: Vec<String>,
    /// Recording of the empty scene, if points of it are removed.
    empty_scene: Option<PathBuf>,
}

impl PointsFileStream {
    fn open(mut capture: Opened, options: &CaptureOptions) -> Result<Option<Self>> {
        capture.only_path()?;
        let file = capture.take_first()?;
        let Some(reader) = PointsReader::open(file, capture.path())? else {
            return Ok(None);
        };
        let about = about_points_file(reader.meta(), options);
        let warnings = not_used_of(reader.meta(), options).into_iter().collect();
        let (points, background) = (&options.points, cleaning::point_background(options)?);
        Ok(Some(Self {
            reader,
            placing: Placing::new(points, points.mounting()?, about.frame_rate_hz, background)?,
            about,
            has_points: false,
            has_speed: false,
            warnings,
            empty_scene: options.cleaning.background.clone(),
        }))
    }

    fn next_frame(&mut self) -> Result<Option<PointFrame>> {
        let Some(frame) = self.reader.next_frame()? else {
            return Ok(None);
        };
        self.has_points |= !frame.points.is_empty();
        self.has_speed |= frame.points.iter().any(|p| p.velocity_mps != 0.0);
        Ok(Some(self.placing.apply(frame)))
    }

    fn finish(self) -> StreamEnd {
        let about = |path: PathBuf| self.placing.about_background(&path);
        let is_measured =
            !self.has_points || self.has_speed || self.about.provenance.measures_speeds();
        let mut notes: Vec<String> = self.empty_scene.and_then(about).into_iter().collect();
        notes.extend_from_slice(&self.warnings);
        StreamEnd {
            notes,
            warnings: self.warnings,
            has_speeds: self.reader.meta().has_speeds && is_measured,
        }
    }
}

/// A stream of packets that is parsed while it is read.
pub struct UartStream {
    path: PathBuf,
    provenance: Provenance,
    radar: Option<OpenedRadar>,
    /// Height of the radar above the floor, m, if the chirp file states it.
    radar_height_m: Option<f32>,
    /// The same by the options.
    stated_height_m: Option<f32>,
    clutter: Clutter,
    source: Box<dyn Read>,
    n_bytes: Option<u64>,
    n_read: u64,
    piece: Vec<u8>,
    /// `None` at the end of the stream.
    parser: Option<UartParser>,
    joiner: SubframeJoiner,
    /// Frames that were read and have no time yet.
    read: VecDeque<RecordedFrame>,
    /// Whether a frame was read, and whether the board stated a track in one.
    has_frames: bool,
    has_tracks: bool,
    /// Velocity of a Doppler bin, m/s, if it is known.
    doppler_step_mps: Option<f64>,
    /// [`TimelineError::NoRate`] if the frame rate is not known.
    clock: std::result::Result<NumberClock, TimelineError>,
    placing: Placing,
    /// Recording of the empty scene, if points of it are removed.
    empty_scene: Option<PathBuf>,
    end: Option<End>,
    /// Notes about the format, and about the radar and its mounting.
    format_note: String,
    radar_notes: Vec<String>,
    radar_warnings: Vec<String>,
}

/// What the parser reports at the end of a stream.
struct End {
    report: UartReport,
    guess: Option<Guess>,
}

/// What is known of a recording once it was read to its end.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StreamEnd {
    /// Notes for the user: how the format was detected, which data were dropped.
    pub notes: Vec<String>,
    /// What a user should know before trusting the points, a sentence each.
    pub warnings: Vec<String>,
    /// Whether a point has a speed. Where none has, none is known to be static, which is among the notes.
    pub has_speeds: bool,
}

impl UartStream {
    /// Whether a capture is a stream of packets.
    pub(crate) fn can_read(capture: &Opened) -> bool {
        matches!(capture.kind(), RecordingKind::Points(detected) if detected.format == RecordingFormat::Uart)
    }

    pub(crate) fn open(mut capture: Opened, options: &CaptureOptions) -> Result<Self> {
        let path = capture.only_path()?.to_path_buf();
        let reason = match capture.kind() {
            RecordingKind::Points(detected) if Self::can_read(&capture) => detected.reason.clone(),
            _ => return Err(Error::in_file(&path, "it is not read frame by frame")),
        };
        let format = RecordingFormat::Uart;
        let points = &options.points;
        points.check_for_format(format)?;
        let (mut notes, mut warnings) = (Vec::new(), Vec::new());
        let radar = match &options.radar {
            Some(radar) => Some(radar.clone()),
            None => {
                let beside =
                    visualizer::radar_beside(&path, points.frame_rate_hz.is_none(), &mut notes)?;
                if beside.is_none() {
                    warnings.extend_from_slice(&notes);
                }
                beside
            }
        };
        if let Some(radar) = &radar {
            explain_reasons(radar, &mut notes, &mut warnings);
        }
        let position = radar.as_ref().and_then(|radar| radar.points.position);
        let n_notes = notes.len();
        let mounting = mounting(points, position, &mut notes)?;
        // Angles of the chirp file that are not used.
        if mounting == points.mounting()? {
            warnings.extend_from_slice(&notes[n_notes..]);
        }
        let of_radar = radar.as_ref().map(|radar| radar.points.frame_rate_hz());
        let clock = match points.frame_rate_hz.or(of_radar) {
            Some(frame_rate_hz) => NumberClock::new(frame_rate_hz),
            None => Err(TimelineError::NoRate),
        };
        let frame_rate_hz = clock.as_ref().map_or(1.0, NumberClock::frame_rate_hz);
        let background = cleaning::point_background(options)?;
        let placing = Placing::new(points, mounting, frame_rate_hz, background)?;
        let mut n_bytes = None;
        let source: Box<dyn Read> = if serial::is_port(&path) {
            let seconds = points.listening_time_s()?;
            let port = serial::Port::open(&path, points.baud, seconds);
            Box::new(port.map_err(|e| Error::io(&path, e))?)
        } else {
            let file = capture.take_first()?;
            n_bytes = file.metadata().ok().map(|m| m.len()).filter(|n| *n > 0);
            Box::new(file)
        };
        Ok(Self {
            provenance: Provenance::recorded(format.name(), path.display()),
            radar_height_m: position.map(|p| p.height_m as f32),
            stated_height_m: options.radar_height_m,
            clutter: points.clutter(),
            doppler_step_mps: (radar.as_ref())
                .and_then(|radar| radar.points.velocity_resolution_mps)
                .filter(|step| step.is_finite()),
            radar,
            source,
            n_bytes,
            n_read: 0,
            piece: vec![0; PIECE_BYTES],
            // The velocity of a Doppler bin is that of the radar.
            parser: Some(UartParser::new(points.dialect).with_doppler_step(1.0)),
            joiner: SubframeJoiner::default(),
            read: VecDeque::new(),
            has_frames: false,
            has_tracks: false,
            clock,
            placing,
            empty_scene: options.cleaning.background.clone(),
            end: None,
            format_note: format!("format {} ({reason})", format.name()),
            radar_notes: notes,
            radar_warnings: warnings,
            path,
        })
    }

    /// Name of the radar, `unknown` if it is not stated.
    fn radar(&self) -> String {
        radar_name(RecordingFormat::Uart, self.radar.as_ref())
    }

    fn about(&self) -> Result<Clip> {
        let height_m = self.stated_height_m.or(self.radar_height_m);
        Ok(Clip {
            frames: Vec::new(),
            frame_rate_hz: self.frame_rate_hz()?,
            radar_height_m: height_m.unwrap_or(DEFAULT_RADAR_HEIGHT_M),
            is_height_assumed: height_m.is_none(),
            radar: self.radar(),
            provenance: self.provenance.clone(),
            clutter: self.clutter,
        })
    }

    fn share_read(&self) -> Option<f64> {
        Some((self.n_read as f64 / self.n_bytes? as f64).min(1.0))
    }

    fn frame_rate_hz(&self) -> Result<f64> {
        match &self.clock {
            Ok(clock) => Ok(clock.frame_rate_hz()),
            Err(error) => Err(no_rate(&self.path, error.clone())),
        }
    }

    fn next_frame(&mut self) -> Result<Option<PointFrame>> {
        loop {
            if let Some(frame) = self.next_timed()? {
                return Ok(Some(self.placing.apply(frame)));
            }
            if self.parser.is_none() {
                return Ok(None);
            }
            self.read_piece()?;
        }
    }

    /// The next frame with its time, if enough was read for it.
    fn next_timed(&mut self) -> Result<Option<PointFrame>> {
        let is_at_end = self.parser.is_none();
        let clock = match &mut self.clock {
            Ok(clock) => clock,
            // What is wrong with the stream is told before the missing frame rate.
            Err(error) if is_at_end => return Err(no_rate(&self.path, error.clone())),
            Err(_) => {
                self.read.clear();
                return Ok(None);
            }
        };
        let wrong = |e| no_rate(&self.path, e);
        while let Some(frame) = self.read.pop_front() {
            if let Some(frame) = clock.push(frame).map_err(wrong)? {
                return Ok(Some(frame));
            }
        }
        match is_at_end {
            true => clock.finish().map_err(wrong),
            false => Ok(None),
        }
    }

    /// Reads some more bytes, or the end.
    fn read_piece(&mut self) -> Result {
        let n = loop {
            match self.source.read(&mut self.piece) {
                Ok(n) => break n,
                Err(e) if e.kind() == std::io::ErrorKind::Interrupted => {}
                Err(e) => return Err(Error::io(&self.path, e)),
            }
        };
        self.n_read += n as u64;
        let path = &self.path;
        let wrong = |e: UartError| {
            Error::wrap_in_file(path, e).with_hint(option("dialect").text(" names it"))
        };
        let before = self.read.len();
        let Some(mut parser) = self.parser.take() else {
            return Ok(());
        };
        let mut has_doppler_bins = false;
        if n > 0 {
            let packets = parser.push(&self.piece[..n]).map_err(wrong)?;
            let joiner = &mut self.joiner;
            self.read
                .extend(packets.into_iter().filter_map(|p| joiner.push(p)));
            has_doppler_bins |= parser.report().points_of_doppler_bins > 0;
            self.parser = Some(parser);
        } else {
            let (last, report, guess) = parser.finish().map_err(wrong)?;
            let joiner = &mut self.joiner;
            self.read
                .extend(last.into_iter().filter_map(|p| joiner.push(p)));
            self.read.extend(self.joiner.finish());
            has_doppler_bins |= report.points_of_doppler_bins > 0;
            self.end = Some(End { report, guess });
        }
        for frame in self.read.range_mut(before..) {
            self.has_frames = true;
            self.has_tracks |= frame.board.as_ref().is_some_and(|b| !b.tracks.is_empty());
            if has_doppler_bins {
                let step_mps = self.doppler_step_mps.unwrap_or(0.0) as f32;
                for point in &mut frame.points {
                    // The sum turns -0 into 0.
                    point.velocity_mps = point.velocity_mps * step_mps + 0.0;
                }
            }
        }
        if let Some(end) = &self.end {
            let mut about = (Vec::new(), Vec::new());
            let (notes, warnings) = (&mut about.0, &mut about.1);
            check_stream(
                &self.path,
                &end.report,
                end.guess.as_ref(),
                self.has_tracks,
                notes,
                warnings,
            )?;
            if !self.has_frames {
                let notes = [std::slice::from_ref(&self.format_note), notes].concat();
                return Err(Error::in_file(
                    &self.path,
                    format!("no frame that can be used; {}", notes.join("; ")),
                ));
            }
        }
        Ok(())
    }

    fn finish(self) -> Result<StreamEnd> {
        let mut notes = vec![self.format_note];
        let mut warnings = Vec::new();
        let mut has_doppler_bins = false;
        if let Some(End { report, guess }) = &self.end {
            has_doppler_bins = report.points_of_doppler_bins > 0;
            let guess = guess.as_ref();
            check_stream(
                &self.path,
                report,
                guess,
                self.has_tracks,
                &mut notes,
                &mut warnings,
            )?;
        }
        notes.extend(self.radar_notes);
        warnings.extend(self.radar_warnings);
        if has_doppler_bins && self.doppler_step_mps.is_none() {
            warnings.push(
                "the demo sends Doppler bins instead of speeds: without a chirp file (`radar`) no point has a speed".into(),
            );
        }
        let clock = self.clock.as_ref().ok();
        let counts = clock.map_or((0, 0), |c| (c.mended_numbers(), c.restarts()));
        for text in about_numbers(counts.0, counts.1) {
            warnings.push(text.clone());
            notes.push(text);
        }
        let about = |path: PathBuf| self.placing.about_background(&path);
        notes.extend(self.empty_scene.and_then(about));
        Ok(StreamEnd {
            notes,
            warnings,
            // A demo that sends speeds measures them also where all are zero.
            has_speeds: !has_doppler_bins || self.doppler_step_mps.is_some(),
        })
    }

    /// Reads all frames into memory.
    pub(crate) fn read_all(mut self) -> Result<RecordedPoints> {
        let mut frames = Vec::new();
        while let Some(frame) = self.next_frame()? {
            frames.push(frame);
        }
        let timeline = Timeline::from_frames(frames, self.frame_rate_hz()?);
        let (radar, radar_height_m) = (self.radar(), self.radar_height_m);
        let provenance = self.provenance.clone();
        let StreamEnd {
            notes,
            warnings,
            has_speeds,
        } = self.finish()?;
        Ok(RecordedPoints {
            timeline,
            radar,
            provenance,
            radar_height_m,
            has_speeds,
            notes,
            warnings,
        })
    }
}
