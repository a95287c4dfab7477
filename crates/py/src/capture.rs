//! `Capture`: recordings of any radar.

use std::{
    path::{Path, PathBuf},
    sync::{Mutex, MutexGuard, PoisonError},
};

use numpy::{Complex32, PyArray4};
use pyo3::{prelude::*, types::PyDict};
use radarllm::{
    CaptureOptions, Error, Recording, Result, SampleRecording,
    inference::PrepareOptions,
    io::{Opened, RecordingKind, SampleFormat, read_opened, udp},
};
use radarllm_base::{RadarCube, message::option};
use serde_json::json;

use crate::{
    errors,
    options::{CaptureKeywords, processing},
    points::PyPoints,
    score::to_python,
    simulate::array_of,
    work::{self, Stop},
};

/// A recording of any radar: raw samples or points. Made by `open_capture`.
///
/// Iterating gives the frames of raw samples, corrected as asked for, as complex64 arrays [loop, tx, rx, sample] in ADC
/// counts; memory holds one frame. Each `iter()` begins with the first frame again, except of a radar that is running.
/// `points()` gives the points. `close()`, or the end of a `with` block, ends the use.
#[pyclass(frozen, name = "Capture", module = "radarllm")]
pub struct PyCapture(Mutex<State>);

/// What a capture is doing. Work takes it out: a lock that is held without the interpreter's own could block both.
enum State {
    Open(Box<Reading>),
    Busy,
    Closed,
}

struct Reading {
    capture: Opened,
    options: CaptureOptions,
    /// Raw samples that are open.
    samples: Option<SampleRecording>,
    /// Frames that were taken from them.
    n_taken: usize,
    report: serde_json::Value,
    notes: Vec<String>,
}

impl Reading {
    fn new(
        inputs: Vec<PathBuf>,
        mut options: CaptureOptions,
        chain: Option<&Path>,
    ) -> Result<Self> {
        if let Some(path) = inputs.iter().find(|path| is_missing(path)) {
            let missing = std::io::Error::from(std::io::ErrorKind::NotFound);
            return Err(Error::io(path, missing));
        }
        let capture = Opened::open(&inputs, &options)?;
        set_chain(&mut options, chain)?;
        let mut opened = Self {
            capture,
            options,
            samples: None,
            n_taken: 0,
            report: serde_json::Value::Null,
            notes: Vec::new(),
        };
        opened.open_samples()?;
        Ok(opened)
    }

    /// Opens raw samples, at their first frame.
    fn open_samples(&mut self) -> Result {
        let RecordingKind::Samples(format) = *self.capture.kind() else {
            return Ok(());
        };
        // Before it is opened again: a port cannot be bound twice.
        self.samples = None;
        let samples = SampleRecording::open(self.take_capture(), &self.options)?;
        self.report = json!({ "format": format.name(), "radar": samples.radar().points.name });
        self.notes = samples.notes();
        self.samples = Some(samples);
        self.n_taken = 0;
        Ok(())
    }

    /// The capture for one reading; it is opened again for the next one.
    fn take_capture(&mut self) -> Opened {
        let again = self.capture.again();
        std::mem::replace(&mut self.capture, again)
    }

    fn is_running(&self) -> bool {
        *self.capture.kind() == RecordingKind::Samples(SampleFormat::Udp)
    }

    fn restart(&mut self) -> Result {
        match self.samples.is_some() && (self.n_taken == 0 || self.is_running()) {
            true => Ok(()),
            false => self.open_samples(),
        }
    }

    fn next_cube(&mut self) -> Result<Option<RadarCube>> {
        let Some(samples) = &mut self.samples else {
            return Err(Error::input(
                "this capture holds points, not raw samples that could be iterated over",
            )
            .with_hint("`points()` returns them"));
        };
        if self
            .options
            .max_frames
            .is_some_and(|max| self.n_taken >= max)
        {
            return Ok(None);
        }
        let mut cube = samples.new_cube()?;
        let found = samples.next_cube(&mut cube)?;
        self.notes = samples.notes();
        Ok(found.map(|_| {
            self.n_taken += 1;
            cube
        }))
    }

    fn points(&mut self, stop: &Stop) -> Result<Recording> {
        let prepare = PrepareOptions {
            motion_compensate: self.options.points.motion_compensate,
        };
        let RecordingKind::Samples(format) = *self.capture.kind() else {
            let read = read_opened(self.take_capture(), &self.options)?;
            return Ok(self.take_points(read, prepare));
        };
        self.restart()?;
        let Some(mut samples) = self.samples.take() else {
            return Err(Error::input("no raw samples"));
        };
        let extracted = samples.extract_points(|_, _, _| stop.check())?;
        let (n_damaged, n_lost) = (extracted.n_damaged, extracted.n_lost);
        let trailing_bytes = samples.trailing_bytes();
        let transfer = samples.frames().transfer().map(|(t, skipped)| {
            json!({
                "packets": t.packets, "lost": t.lost, "out_of_order": t.out_of_order,
                "duplicates": t.duplicates, "late": t.late, "refused": t.refused,
                "skipped": skipped,
            })
        });
        let read = samples.into_recording(extracted)?;
        let recording = self.take_points(read, prepare);
        // As the command prints them: of raw samples the files are known.
        if let Some(report) = self.report.as_object_mut() {
            report.remove("source");
        }
        self.report["format"] = json!(format.name());
        self.report["damaged_frames"] = json!(n_damaged);
        self.report["lost_frames"] = json!(n_lost);
        self.report["trailing_bytes"] = json!(trailing_bytes);
        self.report["transfer"] = json!(transfer);
        Ok(recording)
    }

    fn take_points(&mut self, read: radarllm::io::Recording, prepare: PrepareOptions) -> Recording {
        let clip = &read.clip;
        self.notes = read.notes.clone();
        self.report = json!({
            "frames": clip.frames.len(),
            "points_per_frame": clip.points_per_frame(),
            "frame_rate_hz": clip.frame_rate_hz,
            "radar": clip.radar,
            "source": clip.provenance.to_string(),
            "notes": read.notes,
        });
        Recording::new(read.clip, read.notes, prepare)
    }
}

/// Whether an input is named like a file that does not exist.
fn is_missing(path: &Path) -> bool {
    udp::address(&path.to_string_lossy()).is_none() && !path.exists()
}

fn set_chain(options: &mut CaptureOptions, chain: Option<&Path>) -> Result {
    let Some(path) = chain else {
        return Ok(());
    };
    let Some(radar) = &options.radar else {
        return Err(Error::input(
            option("processing").text(" needs ").option("radar"),
        ));
    };
    options.processing = Some(processing(path)?.resolve(radar.config()?));
    Ok(())
}

impl PyCapture {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn take(&self) -> PyResult<Box<Reading>> {
        let mut state = self.lock();
        match std::mem::replace(&mut *state, State::Busy) {
            State::Open(opened) => Ok(opened),
            State::Busy => Err(errors::input("this capture is in use by another thread")),
            State::Closed => {
                *state = State::Closed;
                Err(errors::input_with_hint(
                    "this capture is closed",
                    "use it within its `with` block, or open it again",
                ))
            }
        }
    }

    /// Runs work on the opened recording, which is there again afterwards.
    fn with<T: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut Reading, &Stop) -> Result<T> + Send,
    ) -> PyResult<T> {
        let mut opened = self.take()?;
        let outcome = work::run(py, |stop| Ok(work(&mut opened, stop)));
        let mut state = self.lock();
        // Another thread may have closed it meanwhile.
        if matches!(*state, State::Busy) {
            *state = State::Open(opened);
        }
        drop(state);
        outcome?.map_err(errors::to_py)
    }
}

#[pymethods]
impl PyCapture {
    /// Opens a recording; `keywords` are those of `open_capture`.
    #[staticmethod]
    fn _open(
        py: Python<'_>,
        inputs: Vec<PathBuf>,
        processing: Option<PathBuf>,
        keywords: CaptureKeywords,
    ) -> PyResult<Self> {
        let options = keywords.options().map_err(errors::to_py)?;
        let opened = work::run(py, |_| Reading::new(inputs, options, processing.as_deref()))?;
        Ok(Self(Mutex::new(State::Open(Box::new(opened)))))
    }

    /// Reads all frames and returns their points.
    ///
    /// `background` is a recording of the same scene without people: of raw samples its mean is subtracted, of points
    /// its occupied cells are removed. `processing` is a TOML file with a table `[processing]`, for raw samples.
    #[pyo3(signature = (*, background=None, processing=None))]
    fn points(
        &self,
        py: Python<'_>,
        background: Option<PathBuf>,
        processing: Option<PathBuf>,
    ) -> PyResult<PyPoints> {
        let recording = self.with(py, |opened, stop| {
            if background.is_none() && processing.is_none() {
                return opened.points(stop);
            }
            let before = opened.options.clone();
            opened.options.cleaning.background = background.or(before.cleaning.background.clone());
            let chain = set_chain(&mut opened.options, processing.as_deref());
            opened.samples = None;
            let recording = chain.and_then(|()| opened.points(stop));
            opened.options = before;
            opened.samples = None;
            recording
        })?;
        Ok(recording.into())
    }

    /// What is known of the recording: format and radar; after `points()` also the numbers of frames, damaged and lost
    /// frames, packets and bytes after the last frame, as `radarllm process --json` prints them.
    #[getter]
    fn report<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let report = self.with(py, |opened, _| {
            let mut report = opened.report.clone();
            if report.is_object() {
                report["notes"] = json!(opened.notes);
            }
            Ok(report)
        })?;
        match report.is_null() {
            true => Ok(PyDict::new(py).into_any()),
            false => to_python(py, &report),
        }
    }

    /// Notes for the user: layout, background, signal health, lost packets.
    #[getter]
    fn notes(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        self.with(py, |opened, _| Ok(opened.notes.clone()))
    }

    /// Whether `close` was called.
    #[getter]
    fn closed(&self) -> bool {
        matches!(*self.lock(), State::Closed)
    }

    /// Ends the use of the recording; may be called again.
    fn close(&self) {
        *self.lock() = State::Closed;
    }

    fn __enter__(this: PyRef<'_, Self>) -> PyResult<PyRef<'_, Self>> {
        match this.closed() {
            true => Err(errors::input("this capture is closed")),
            false => Ok(this),
        }
    }

    fn __exit__(
        &self,
        _kind: &Bound<'_, PyAny>,
        _error: &Bound<'_, PyAny>,
        _trace: &Bound<'_, PyAny>,
    ) {
        self.close();
    }

    fn __iter__<'py>(this: PyRef<'py, Self>) -> PyResult<PyRef<'py, Self>> {
        this.with(this.py(), |opened, _| opened.restart())?;
        Ok(this)
    }

    fn __next__<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray4<Complex32>>>> {
        let cube = self.with(py, |opened, _| opened.next_cube())?;
        cube.map(|cube| array_of(py, cube)).transpose()
    }

    fn __repr__(&self) -> String {
        match &*self.lock() {
            State::Open(opened) => {
                let names = opened
                    .capture
                    .captures()
                    .iter()
                    .map(|p| p.display().to_string());
                format!("Capture({})", names.collect::<Vec<_>>().join(", "))
            }
            State::Busy => "Capture(in use)".into(),
            State::Closed => "Capture(closed)".into(),
        }
    }
}
