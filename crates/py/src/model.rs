//! `Model` and its sentences.

use std::{path::PathBuf, sync::Arc, time::Instant};

use numpy::PyArray1;
use pyo3::{IntoPyObjectExt, prelude::*, types::PyDict};
use radarllm::{
    Captioner, Choices, DescribeOptions, Description, Error, Model, ModelFiles, ModelOptions,
    Precision, Recording, Result, Segment,
};
use rayon::prelude::*;

use crate::{
    errors,
    html::{self, Said},
    memory::{self, PyMemory},
    options::check_range,
    points::PyPoints,
    work::{self, Stop, on_threads},
};

/// Most beams, as in the command.
const MAX_BEAM: usize = 64;

/// A model that describes points: one in this package, "features" (the default) or "tokens", which reads radar tokens alone, or
/// a folder made by `radarllm train all`.
///
/// `precision` is "f32" or "int8" (faster for large models, changes a word now and then). `choose` names activities; the
/// model then says which of them fits best, with the probabilities of all. `memory` is a `Memory`, or its file.
///
/// >>> model = Model()
/// >>> sentence = model.describe(simulate("builtin:walk?direction=backward"))
/// >>> sentence.segments[0].actions
/// ['walk']
/// >>> 0 < sentence.confidence <= 1
/// True
#[pyclass(frozen, name = "Model", module = "radarllm")]
pub struct PyModel {
    captioner: Captioner,
    notes: Vec<String>,
}

/// A memory as an argument: a `Memory` or a file.
#[derive(FromPyObject)]
enum MemoryArgument<'py> {
    Memory(Bound<'py, PyMemory>),
    File(PathBuf),
}

/// Points as an argument: one, or a list of them.
#[derive(FromPyObject)]
enum PointsArgument<'py> {
    One(Bound<'py, PyPoints>),
    Many(Vec<Bound<'py, PyPoints>>),
}

impl PointsArgument<'_> {
    fn recordings(&self) -> Vec<Arc<Recording>> {
        let recording = |points: &Bound<'_, PyPoints>| Arc::clone(&points.get().recording);
        match self {
            Self::One(points) => vec![recording(points)],
            Self::Many(points) => points.iter().map(recording).collect(),
        }
    }

    /// One result for one argument, a list for a list.
    fn answer<'py, T: IntoPyObject<'py>>(
        &self,
        py: Python<'py>,
        mut all: Vec<T>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let one = matches!(self, Self::One(_)).then(|| all.pop()).flatten();
        match one {
            Some(one) => one.into_bound_py_any(py),
            None => all.into_bound_py_any(py),
        }
    }
}

#[pymethods]
impl PyModel {
    #[new]
    #[pyo3(signature = (folder=None, *, precision="f32", choose=None, memory=None))]
    fn new(
        py: Python<'_>,
        folder: Option<PathBuf>,
        precision: &str,
        choose: Option<Vec<String>>,
        memory: Option<MemoryArgument<'_>>,
    ) -> PyResult<Self> {
        let precision = match precision {
            "f32" => Precision::F32,
            "int8" => Precision::Int8,
            other => {
                return Err(errors::input_with_hint(
                    format!("`precision` {other:?}: unknown"),
                    "\"f32\" or \"int8\"",
                ));
            }
        };
        let memory = match memory {
            None => None,
            Some(MemoryArgument::Memory(memory)) => Some(memory.get().copy()),
            Some(MemoryArgument::File(path)) => Some(memory::load(&path).map_err(errors::to_py)?),
        };
        work::run(py, |_| {
            let files = ModelFiles::of(folder.as_deref());
            if let ModelFiles::Folder(folder) = &files
                && !folder.exists()
            {
                let missing = std::io::Error::from(std::io::ErrorKind::NotFound);
                return Err(Error::io(folder, missing));
            }
            let options = ModelOptions {
                precision,
                ..ModelOptions::default()
            };
            let model = Model::load(files, &options)?;
            let mut captioner = Captioner::new(model);
            let mut notes = Vec::new();
            if let Some(names) = &choose {
                let choices = Choices::new(names.iter().map(String::as_str))?;
                let unknown = choices.unknown().iter();
                notes = unknown
                    .map(|name| {
                        format!(
                            "`{name}` names no action that the model learned; it is scored as text"
                        )
                    })
                    .collect();
                captioner = captioner.with_choices(choices);
            }
            if let Some(memory) = &memory {
                captioner = captioner.with_memory(memory);
            }
            Ok(Self { captioner, notes })
        })
    }

    /// Name in reports: the folder, or "default (embedded)"; with ", int8" after it for that precision.
    #[getter]
    fn name(&self) -> &str {
        self.captioner.name()
    }

    /// Notes for the user: chosen activities that the model did not learn.
    #[getter]
    fn notes(&self) -> Vec<String> {
        self.notes.clone()
    }

    /// Describes what the person does: a `Sentence` for `Points`, a list for a list.
    ///
    /// Points at another frame rate are resampled and static clutter of recordings is left out. With `beam`, the most
    /// probable sentence is searched for with that many beams, 1 being greedy, instead of a vote among drawn sentences. A list is described on `threads` threads, all cores if None, with the same result.
    #[pyo3(signature = (points, *, beam=None, threads=None))]
    fn describe<'py>(
        &self,
        py: Python<'py>,
        points: PointsArgument<'py>,
        beam: Option<usize>,
        threads: Option<usize>,
    ) -> PyResult<Bound<'py, PyAny>> {
        if let Some(beam) = beam {
            check_range("beam", beam, 1..=MAX_BEAM).map_err(errors::to_py)?;
        }
        let options = DescribeOptions {
            beam,
            ..DescribeOptions::default()
        };
        let sentences = self.each(py, &points, threads, |recording| {
            Sentence::new(&self.captioner, recording, &options)
        })?;
        points.answer(py, sentences)
    }

    /// The radar tokens of points: uint32, shape (n,), one for each 0.4 s; a list for a list.
    #[pyo3(signature = (points, *, threads=None))]
    fn tokenize<'py>(
        &self,
        py: Python<'py>,
        points: PointsArgument<'py>,
        threads: Option<usize>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let tokens = self.each(py, &points, threads, |recording| {
            let clip = recording.prepared()?.clip;
            let networks = self.captioner.model().networks()?;
            networks.tokenize(&clip).map_err(Error::wrap)
        })?;
        let arrays = tokens
            .into_iter()
            .map(|t| PyArray1::from_vec(py, t))
            .collect();
        points.answer(py, arrays)
    }

    fn __repr__(&self) -> String {
        format!("Model({:?})", self.name())
    }
}

impl PyModel {
    /// Works on every one of some points, in parallel if there are several.
    fn each<T: Send>(
        &self,
        py: Python<'_>,
        points: &PointsArgument<'_>,
        threads: Option<usize>,
        work: impl Fn(&Arc<Recording>) -> Result<T> + Sync + Send,
    ) -> PyResult<Vec<T>> {
        let recordings = points.recordings();
        let work = |stop: &Stop, recording| {
            stop.check()?;
            work(recording)
        };
        work::run(py, |stop| match &recordings[..] {
            [one] => Ok(vec![work(stop, one)?]),
            several => on_threads(threads, || {
                several.par_iter().map(|one| work(stop, one)).collect()
            }),
        })
    }
}

/// What a model says about points. `str(sentence)` is the caption.
#[pyclass(frozen, name = "Sentence", module = "radarllm")]
pub struct Sentence {
    recording: Arc<Recording>,
    described: Description,
    model: String,
    seconds: f64,
    frames: usize,
    clip_seconds: f64,
}

impl Sentence {
    fn new(
        captioner: &Captioner,
        recording: &Arc<Recording>,
        options: &DescribeOptions,
    ) -> Result<Self> {
        let clip = recording.prepared()?.clip;
        let started = Instant::now();
        let described = captioner.describe_prepared(&clip, options)?;
        Ok(Self {
            described,
            model: captioner.name().into(),
            seconds: started.elapsed().as_secs_f64(),
            frames: clip.frames.len(),
            clip_seconds: clip.duration_s(),
            recording: Arc::clone(recording),
        })
    }
}

#[pymethods]
impl Sentence {
    /// The sentence, or "no person seen".
    #[getter]
    fn caption(&self) -> &str {
        &self.described.caption
    }

    /// Why there is no sentence; None if there is one.
    #[getter]
    fn reason(&self) -> Option<String> {
        self.described.abstained.map(|why| why.to_string())
    }

    /// Mean of the confidences of the segments, 0 to 1; 0 where nothing was described.
    #[getter]
    fn confidence(&self) -> f32 {
        self.described.confidence
    }

    /// The recording or the simulated motion.
    #[getter]
    fn source(&self) -> &str {
        self.recording.clip.provenance.input()
    }

    /// Name of the radar.
    #[getter]
    fn radar(&self) -> &str {
        &self.recording.clip.radar
    }

    /// Whether a simulator made the points.
    #[getter]
    fn synthetic(&self) -> bool {
        self.recording.clip.provenance.is_simulated()
    }

    /// "simulated" or "recorded".
    #[getter]
    fn provenance(&self) -> &str {
        self.recording.clip.provenance.kind()
    }

    /// Name of the model.
    #[getter]
    fn model(&self) -> &str {
        &self.model
    }

    /// The sentences with their times, in order.
    #[getter]
    fn segments(&self) -> Vec<PySegment> {
        self.described
            .segments
            .iter()
            .map(PySegment::from)
            .collect()
    }

    /// The activities of `Model(choose=...)` with their probabilities, the most probable first.
    #[getter]
    fn choices(&self) -> Vec<(String, f32)> {
        let choices = self.described.choices.iter();
        choices
            .map(|c| (c.activity.clone(), c.probability))
            .collect()
    }

    /// Radar tokens read.
    #[getter]
    fn tokens(&self) -> Vec<u32> {
        self.described.tokens.clone()
    }

    /// Radar frames read.
    #[getter]
    fn frames(&self) -> usize {
        self.frames
    }

    /// Length of the points, s.
    #[getter]
    fn clip_seconds(&self) -> f64 {
        self.clip_seconds
    }

    /// Time from points to sentence, s.
    #[getter]
    fn seconds(&self) -> f64 {
        self.seconds
    }

    /// All fields, as `radarllm describe --json` prints them.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let row = PyDict::new(py);
        row.set_item("caption", self.caption())?;
        if let Some(reason) = self.reason() {
            row.set_item("reason", reason)?;
        }
        row.set_item("confidence", self.confidence())?;
        row.set_item("source", self.source())?;
        row.set_item("radar", self.radar())?;
        row.set_item("synthetic", self.synthetic())?;
        row.set_item("provenance", self.provenance())?;
        row.set_item("model", self.model())?;
        let segments = self.segments();
        let segments: PyResult<Vec<_>> = segments.iter().map(|s| s.to_dict(py)).collect();
        row.set_item("segments", segments?)?;
        if !self.described.choices.is_empty() {
            let choice = |(activity, probability): (String, f32)| -> PyResult<_> {
                let choice = PyDict::new(py);
                choice.set_item("activity", activity)?;
                choice.set_item("probability", probability)?;
                Ok(choice)
            };
            let choices: PyResult<Vec<_>> = self.choices().into_iter().map(choice).collect();
            row.set_item("choices", choices?)?;
        }
        row.set_item("tokens", self.tokens())?;
        row.set_item("frames", self.frames)?;
        row.set_item("clip_seconds", self.clip_seconds)?;
        row.set_item("seconds", self.seconds)?;
        Ok(row)
    }

    /// The page of the points and the sentence: one HTML file that needs nothing else.
    fn to_html(&self, py: Python<'_>) -> PyResult<String> {
        let by = format!("model {} · confidence {:.2}", self.model, self.confidence());
        work::run(py, |_| {
            let clip = self.recording.prepared()?.clip;
            let said = Said {
                caption: self.caption(),
                segments: &self.described.segments,
                by: &by,
            };
            Ok(html::page(&clip, Some(said)))
        })
    }

    fn _repr_html_(&self, py: Python<'_>) -> PyResult<String> {
        Ok(html::inline(&self.to_html(py)?))
    }

    fn __str__(&self) -> &str {
        self.caption()
    }

    fn __repr__(&self) -> String {
        format!(
            "Sentence({:?}, confidence {:.2}, {}, {})",
            self.caption(),
            self.confidence(),
            self.provenance(),
            self.source()
        )
    }
}

/// A part of the time and the sentence that describes it.
#[pyclass(frozen, get_all, name = "Segment", module = "radarllm")]
pub struct PySegment {
    /// Start on the clock of the frames, s.
    start_s: f64,
    /// End, s.
    end_s: f64,
    /// The sentence.
    caption: String,
    /// Names of the actions that the sentence states, in order.
    actions: Vec<&'static str>,
    /// How certain the model is, 0 to 1.
    confidence: f32,
    /// Probability of the stated sides, 0 to 1; None if there is none, for several windows and with `beam`.
    side_confidence: Option<f32>,
    /// Name of the taught activity that was recognised; None for a sentence of the model.
    taught: Option<String>,
    /// The sentence of the model, where it was too uncertain to be the caption.
    guess: Option<String>,
}

impl From<&Segment> for PySegment {
    fn from(segment: &Segment) -> Self {
        let segment = segment.clone();
        Self {
            start_s: segment.start_s,
            end_s: segment.end_s,
            caption: segment.caption,
            actions: segment.actions,
            confidence: segment.confidence,
            side_confidence: segment.side_confidence,
            taught: segment.taught,
            guess: segment.guess,
        }
    }
}

#[pymethods]
impl PySegment {
    /// All fields; `side_confidence`, `taught` and `guess` only where they are not None.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let row = PyDict::new(py);
        row.set_item("start_s", self.start_s)?;
        row.set_item("end_s", self.end_s)?;
        row.set_item("caption", &self.caption)?;
        row.set_item("actions", &self.actions)?;
        row.set_item("confidence", self.confidence)?;
        if let Some(side_confidence) = self.side_confidence {
            row.set_item("side_confidence", side_confidence)?;
        }
        if let Some(taught) = &self.taught {
            row.set_item("taught", taught)?;
        }
        if let Some(guess) = &self.guess {
            row.set_item("guess", guess)?;
        }
        Ok(row)
    }

    fn __repr__(&self) -> String {
        format!(
            "Segment({:.1} s to {:.1} s, {:?}, confidence {:.2})",
            self.start_s, self.end_s, self.caption, self.confidence
        )
    }
}
