//! Opens any recording: raw samples, which the signal chain turns into points, or points.

use std::path::{Path, PathBuf};

use radarllm_base::{
    Clip, Clutter, PointFrame, Provenance, RadarConfig, RadarCube, Timeline,
    message::{option, text},
};
use radarllm_dataset::{PointsFile, PointsMeta, read_points, read_points_from};
use radarllm_formats::{
    SampleFormat,
    adc::{AdcStats, CubeShape, FrameIntegrity, FrameSource, IqAnswer, IqCheck},
};
use radarllm_radar_dsp::{Corrector, PointExtractor};

use crate::{
    cleaning,
    error::{Error, Result},
    layout::open_samples,
    opened::{Opened, RecordingKind},
    options::{CaptureOptions, DEFAULT_RADAR_HEIGHT_M, MAX_FRAMES},
    placing::Placing,
    points::{RecordedPoints, open_points, place},
    radar::OpenedRadar,
    samples::SampleFrames,
};

/// Every how many frames one frame is tested for the order of I and Q.
const IQ_STEP: usize = 32;

/// The note about a recording without speeds.
pub(crate) const NO_SPEEDS: &str =
    "no point has a speed: static points are not removed, because none is known to be static";

/// A recording as points, ready for tracking or for a model.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    /// The points, at the frame rate of the recording, in level axes, strongest first.
    pub clip: Clip,
    /// Notes for the user: how the format was detected, which data were dropped.
    pub notes: Vec<String>,
    /// What a user should know before trusting the points, a sentence each.
    pub warnings: Vec<String>,
}

/// Opens any recording and returns its points.
///
/// Several paths are parts of one recording of raw samples. Raw samples are processed by the signal chain of `options`.
///
/// # Errors
/// Any error in the files or the options, with the name of the file and a hint.
pub fn read_recording(captures: &[PathBuf], options: &CaptureOptions) -> Result<Recording> {
    read_opened(Opened::open(captures, options)?, options)
}

/// Returns the points of a capture that is opened already.
///
/// # Errors
/// Those of [`read_recording`].
pub fn read_opened(opened: Opened, options: &CaptureOptions) -> Result<Recording> {
    match opened.kind() {
        RecordingKind::Samples(_) => {
            let mut samples = SampleRecording::open(opened, options)?;
            let taken = samples.extract_points(|_, _, _| Ok(()))?;
            samples.into_recording(taken)
        }
        RecordingKind::Points(_) => read_recorded_points(opened, options),
        RecordingKind::PointsFile => read_opened_points_file(opened, options),
    }
}

/// Reads recorded points. Points of the empty scene are removed if the options name one.
///
/// # Errors
/// Those of [`read_recording`].
pub fn read_recorded_points(opened: Opened, options: &CaptureOptions) -> Result<Recording> {
    options.check_for_points()?;
    let RecordedPoints {
        mut timeline,
        radar,
        provenance,
        radar_height_m,
        has_speeds,
        mut notes,
        warnings,
    } = open_points(opened, options.radar.as_ref(), &options.points)?;
    cleaning::remove_background(&mut timeline.frames, options, &mut notes)?;
    let height_m = options.radar_height_m.or(radar_height_m);
    let mut clip = Clip {
        frames: timeline.frames,
        frame_rate_hz: timeline.frame_rate_hz,
        radar_height_m: height_m.unwrap_or(DEFAULT_RADAR_HEIGHT_M),
        is_height_assumed: height_m.is_none(),
        radar,
        provenance,
        clutter: options.points.clutter(),
    };
    keep_all_without_speeds(&mut clip, has_speeds, &mut notes);
    Ok(Recording {
        clip,
        notes,
        warnings,
    })
}

/// Where no speeds are known, no point is known to be static, and all are kept.
fn keep_all_without_speeds(clip: &mut Clip, are_measured: bool, notes: &mut Vec<String>) {
    if !are_measured || !clip.has_speeds() {
        notes.push(NO_SPEEDS.into());
        clip.clutter = Clutter::Settled;
    }
}

/// Opens a points file of this project.
///
/// # Errors
/// Those of [`read_recording`].
pub fn read_points_file(path: &Path, options: &CaptureOptions) -> Result<Recording> {
    points_file(read_points(path)?, options)
}

/// As [`read_points_file`], of a capture that is opened already.
fn read_opened_points_file(mut opened: Opened, options: &CaptureOptions) -> Result<Recording> {
    opened.only_path()?;
    let file = opened.take_first()?;
    points_file(read_points_from(file, opened.path())?, options)
}

fn points_file(file: PointsFile, options: &CaptureOptions) -> Result<Recording> {
    let mut notes = Vec::new();
    let about = about_points_file(&file.meta, options);
    let mut timeline = Timeline::from_frames(file.frames, about.frame_rate_hz);
    timeline = place(timeline, &options.points, options.points.mounting()?)?;
    cleaning::remove_background(&mut timeline.frames, options, &mut notes)?;
    let mut clip = about.with_frames(timeline.frames);
    keep_all_without_speeds(&mut clip, file.meta.has_speeds, &mut notes);
    let warnings: Vec<String> = not_used_of(&file.meta, options).into_iter().collect();
    notes.extend_from_slice(&warnings);
    Ok(Recording {
        clip,
        notes,
        warnings,
    })
}

/// The options that a points file does not use, because it states what they are about; `None` if there are none.
pub(crate) fn not_used_of(meta: &PointsMeta, options: &CaptureOptions) -> Option<String> {
    let rate_hz = options.points.frame_rate_hz;
    let radar = options.radar.as_ref().map(|radar| &radar.points.name);
    let not_used = [
        (
            "frame_rate",
            rate_hz.is_some_and(|rate_hz| rate_hz != meta.frame_rate_hz),
        ),
        ("orientation", options.points.orientation.is_some()),
        ("radar", radar.is_some_and(|name| *name != meta.radar)),
    ];
    let names: Vec<String> = (not_used.into_iter().filter(|(_, is_given)| *is_given))
        .map(|(name, _)| format!("`{name}`"))
        .collect();
    (!names.is_empty()).then(|| {
        format!(
            "not used: {}, because a points file states its radar ({}), its frame rate ({:.2} Hz) and has axes of its own",
            names.join(", "),
            meta.radar,
            meta.frame_rate_hz
        )
    })
}

/// What a points file states of its recording, without frames.
pub(crate) fn about_points_file(meta: &PointsMeta, options: &CaptureOptions) -> Clip {
    let Ok(provenance) = meta.source.parse::<Provenance>();
    let height_m = options.radar_height_m.or(meta.radar_height_m);
    Clip {
        frames: Vec::new(),
        frame_rate_hz: meta.frame_rate_hz,
        radar_height_m: height_m.unwrap_or(DEFAULT_RADAR_HEIGHT_M),
        is_height_assumed: height_m.is_none(),
        radar: meta.radar.clone(),
        provenance: match (provenance, meta.seed) {
            (Provenance::Simulated { input, .. }, seed) => Provenance::Simulated { input, seed },
            (recorded, _) => recorded,
        },
        clutter: options.points.clutter(),
    }
}

/// Points extracted from raw samples, and the numbers of damaged and lost frames.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ExtractedPoints {
    /// One frame for each frame period, starting with the first one. Lost frames are empty.
    pub frames: Vec<PointFrame>,
    /// Number of frames with missing bytes, whose samples are set to zero.
    pub n_damaged: usize,
    /// Number of frames that never arrived.
    pub n_lost: usize,
}

/// A recording of raw samples with its signal chain.
pub struct SampleRecording {
    captures: Vec<PathBuf>,
    format: SampleFormat,
    radar: OpenedRadar,
    config: RadarConfig,
    frames: SampleFrames,
    corrector: Corrector,
    extractor: PointExtractor,
    health: Health,
    options: CaptureOptions,
    notes: Vec<String>,
    /// What the size of the files shows; it is among the notes, too.
    warnings: Vec<String>,
    /// Memory of a frame.
    cube: Option<RadarCube>,
    /// Number of the first frame that was read.
    first_frame: Option<u64>,
    /// A frame that was read, before which others are lost.
    ahead: Option<PointFrame>,
    n_returned: usize,
    n_damaged: usize,
    n_lost: usize,
}

impl SampleRecording {
    /// Takes over a capture of raw samples, determines its layout and plans the signal chain.
    ///
    /// # Errors
    /// A missing radar, a layout that cannot be determined, or files that do not fit.
    pub fn open(opened: Opened, options: &CaptureOptions) -> Result<Self> {
        let format = opened.sample_format()?;
        let captures = opened.captures().to_vec();
        let radar = options.radar.clone().ok_or_else(|| {
            Error::input(text("raw samples need ").option("radar"))
                .with_hint("the radar that recorded them")
        })?;
        options.points.check_for_samples()?;
        // Arrays are what `simulate` writes; their shape is checked.
        let config = match format {
            SampleFormat::Npy => radar.config()?.clone(),
            _ => radar.sample_config()?.clone(),
        };
        let mut notes = Vec::new();
        let corrector = cleaning::corrector(
            &options.cleaning,
            &radar,
            options.format,
            &options.layout,
            &mut notes,
        )?;
        let dsp = options.processing.clone().unwrap_or_default();
        let extractor = PointExtractor::new(&config, cleaning::chain(&options.cleaning, dsp))?;
        let mut warnings = Vec::new();
        let layout = &options.layout;
        let frames = open_samples(opened, &radar, layout, &mut notes, &mut warnings)?;
        Ok(Self {
            captures,
            format,
            health: Health::new(&config, format),
            radar,
            config,
            frames,
            corrector,
            extractor,
            options: options.clone(),
            notes,
            warnings,
            cube: None,
            first_frame: None,
            ahead: None,
            n_returned: 0,
            n_damaged: 0,
            n_lost: 0,
        })
    }

    /// The radar.
    pub fn radar(&self) -> &OpenedRadar {
        &self.radar
    }

    /// Storage format of the samples.
    pub fn format(&self) -> SampleFormat {
        self.format
    }

    /// The frame reader, for access to its counters.
    pub fn frames(&self) -> &SampleFrames {
        &self.frames
    }

    /// Number of bytes after the last complete frame.
    pub fn trailing_bytes(&self) -> usize {
        self.frames.trailing_bytes()
    }

    /// Statistics of the samples read so far.
    pub fn stats(&self) -> &AdcStats {
        &self.health.stats
    }

    /// Reads the next frame of corrected samples; `None` at the end. Its time is based on the radar's frame period.
    ///
    /// # Errors
    /// A frame that cannot be read or corrected.
    pub fn next_cube(&mut self, cube: &mut RadarCube) -> Result<Option<u64>> {
        let Some(integrity) = self.read_frame(cube)? else {
            return Ok(None);
        };
        cube.time_s = integrity.frame as f64 * self.config.frame_period_s;
        self.corrector.apply(cube)?;
        Ok(Some(integrity.frame))
    }

    /// Reads the next frame of samples as recorded; `None` at the end.
    fn read_frame(&mut self, cube: &mut RadarCube) -> Result<Option<FrameIntegrity>> {
        let read = self.frames.next_frame(cube);
        read.map_err(|e| Error::wrap_in_file(&self.captures[0], e))
    }

    /// Allocates a cube of the radar's shape for [`Self::next_cube`].
    ///
    /// # Errors
    /// A radar whose frames are empty or too large.
    pub fn new_cube(&self) -> Result<RadarCube> {
        Ok(CubeShape::of(&self.config).zeros()?)
    }

    /// Extracts the points of all frames, or of [`CaptureOptions::max_frames`]. `each` is called with every corrected
    /// cube and its points.
    ///
    /// # Errors
    /// Those of [`Self::next_points`].
    pub fn extract_points(
        &mut self,
        mut each: impl FnMut(&mut PointExtractor, &RadarCube, &PointFrame) -> Result,
    ) -> Result<ExtractedPoints> {
        let mut frames = Vec::new();
        while let Some(frame) = self.next_points(&mut each)? {
            frames.push(frame);
        }
        Ok(ExtractedPoints {
            frames,
            n_damaged: self.n_damaged,
            n_lost: self.n_lost,
        })
    }

    /// Extracts the points of the next frame period, as the signal chain returns them; `None` at the end, or after
    /// [`CaptureOptions::max_frames`]. `each` is called with the corrected cube and its points, unless the frame is lost.
    ///
    /// # Errors
    /// A frame that cannot be read or processed, more than [`MAX_FRAMES`] frames, or an error of `each`.
    pub fn next_points(
        &mut self,
        mut each: impl FnMut(&mut PointExtractor, &RadarCube, &PointFrame) -> Result,
    ) -> Result<Option<PointFrame>> {
        let limit = self.options.max_frames.unwrap_or(usize::MAX);
        if self.n_returned >= limit {
            return Ok(None);
        }
        if self.ahead.is_none() {
            self.ahead = self.extract_next(&mut each)?;
        }
        let Some(frame) = self.ahead.take() else {
            return Ok(None);
        };
        let index = self.n_returned;
        self.n_returned += 1;
        if frame.frame as usize == index {
            return Ok(Some(frame));
        }
        self.ahead = Some(frame);
        self.n_lost += 1;
        Ok(Some(PointFrame {
            frame: index as u32,
            time_s: index as f64 * self.config.frame_period_s,
            points: Vec::new(),
            board: None,
        }))
    }

    /// Extracts the points of the next frame that is there.
    fn extract_next(
        &mut self,
        each: &mut impl FnMut(&mut PointExtractor, &RadarCube, &PointFrame) -> Result,
    ) -> Result<Option<PointFrame>> {
        let mut cube = match self.cube.take() {
            Some(cube) => cube,
            None => self.new_cube()?,
        };
        let Some(integrity) = self.read_frame(&mut cube)? else {
            return Ok(None);
        };
        let path = &self.captures[0];
        let index = integrity.frame - *self.first_frame.get_or_insert(integrity.frame);
        if index >= MAX_FRAMES {
            let n_frames = index.saturating_add(1);
            return Err(Error::in_file(
                path,
                format!("{n_frames} frames, at most {MAX_FRAMES} are handled"),
            )
            .with_hint(option("frames").text(" N reads only the first ones")));
        }
        self.n_damaged += usize::from(!integrity.is_complete());
        cube.time_s = index as f64 * self.config.frame_period_s;
        self.health.push(&cube);
        self.corrector.apply(&mut cube)?;
        let mut frame = self
            .extractor
            .extract(&cube)
            .map_err(|e| Error::in_file(path, format!("frame {index}: {e}")).caused_by(e))?;
        frame.frame = index as u32;
        each(&mut self.extractor, &cube, &frame)?;
        self.cube = Some(cube);
        Ok(Some(frame))
    }

    /// Number of frames with missing bytes up to now, whose samples are set to zero, and of frames that never arrived.
    pub fn n_damaged_and_lost(&self) -> [usize; 2] {
        [self.n_damaged, self.n_lost]
    }

    /// Rotates frames into level axes one by one, strongest points first, as [`Self::into_recording`] does.
    ///
    /// # Errors
    /// Options that cannot be applied.
    pub fn placing(&self) -> Result<Placing> {
        let points = &self.options.points;
        Placing::new(
            points,
            points.mounting()?,
            self.config.frame_rate_hz(),
            None,
        )
    }

    /// What is known of the recording, without frames.
    pub fn about(&self) -> Clip {
        let names: Vec<String> = self
            .captures
            .iter()
            .map(|p| p.display().to_string())
            .collect();
        let height_m = self.options.radar_height_m;
        Clip {
            frames: Vec::new(),
            frame_rate_hz: self.config.frame_rate_hz(),
            radar_height_m: height_m.unwrap_or(DEFAULT_RADAR_HEIGHT_M),
            is_height_assumed: height_m.is_none(),
            radar: self.config.name.clone(),
            provenance: Provenance::Recorded {
                format: None,
                path: names.join("+"),
            },
            clutter: self.options.points.clutter(),
        }
    }

    /// Refuses a recording of which no frame was read.
    ///
    /// # Errors
    /// If no frame was read.
    pub fn check_has_frames(&self) -> Result {
        if self.first_frame.is_some() {
            return Ok(());
        }
        Err(Error::in_file(
            &self.captures[0],
            format!(
                "not one whole frame of radar `{}` ({} bytes of one)",
                self.config.name,
                self.frames.trailing_bytes()
            ),
        ))
    }

    /// Notes for the user up to now: layout, background, signal health, lost packets.
    pub fn notes(&self) -> Vec<String> {
        let mut notes = self.notes.clone();
        notes.extend(self.while_read());
        notes
    }

    /// The notes of which a user should know before trusting the points: size of the files, signal health, lost packets.
    pub fn warnings(&self) -> Vec<String> {
        let mut warnings = self.warnings.clone();
        warnings.extend(self.while_read());
        warnings
    }

    /// What was seen while frames were read.
    fn while_read(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        self.health.report(&self.frames, &mut warnings);
        if self.frames.overruns() > 0 {
            warnings.push(format!(
                "{} packets came faster than they were processed",
                self.frames.overruns()
            ));
        }
        warnings
    }

    /// Returns the extracted points as a recording.
    ///
    /// # Errors
    /// No complete frame, or options that cannot be applied.
    pub fn into_recording(self, extracted: ExtractedPoints) -> Result<Recording> {
        self.check_has_frames()?;
        let (notes, warnings) = (self.notes(), self.warnings());
        let about = self.about();
        let timeline = Timeline::from_frames(extracted.frames, about.frame_rate_hz);
        let points = &self.options.points;
        let timeline = place(timeline, points, points.mounting()?)?;
        Ok(Recording {
            clip: about.with_frames(timeline.frames),
            notes,
            warnings,
        })
    }
}

/// Statistics of raw samples that show whether they were recorded and read correctly.
struct Health {
    n_frames: usize,
    iq: IqCheck,
    stats: AdcStats,
    /// Whether the samples are ADC counts.
    are_counts: bool,
}

impl Health {
    fn new(radar: &RadarConfig, format: SampleFormat) -> Self {
        Self {
            n_frames: 0,
            iq: IqCheck::new(radar.n_samples),
            stats: AdcStats::new(radar.rx.len(), 16),
            are_counts: format != SampleFormat::Npy,
        }
    }

    fn push(&mut self, cube: &RadarCube) {
        // The order of I and Q does not change within a capture.
        if self.n_frames.is_multiple_of(IQ_STEP) {
            self.iq.push(cube);
        }
        self.n_frames += 1;
        self.stats.push(cube);
    }

    fn report(&self, frames: &SampleFrames, notes: &mut Vec<String>) {
        if let SampleFrames::Npy(npy) = frames
            && npy.were_words()
        {
            notes.push("the numbers were unsigned 16-bit words and were read as signed".into());
        }
        let verdict = self.iq.verdict();
        if verdict.answer == IqAnswer::Swapped {
            notes.push(format!(
                "I/Q order looks swapped: {:+.1} dB at positive against negative range",
                verdict.positive_over_negative_db
            ));
        }
        if self.are_counts {
            notes.extend(self.stats.problems());
        }
    }
}
