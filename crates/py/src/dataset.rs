//! `DatasetPlan` and `Dataset`.

use std::{
    path::{Path, PathBuf},
    sync::{Arc, Mutex, OnceLock, PoisonError},
    thread,
    time::{Duration, Instant},
};

use arrow_array::RecordBatchIterator;
use numpy::{PyArray1, PyArray3, PyArrayMethods};
use pyo3::{
    prelude::*,
    types::{PyCapsule, PyDict},
};
use radarllm::{
    Clip, Clutter, DatasetPlan, Error, ErrorKind, Overwrite, Provenance, Result,
    dataset::{
        BatchIter, BuildOptions, ClipIter, ClipRecord, Columns, Dataset, Manifest, Split, validate,
    },
    synth::config::DatasetConfig,
};
use radarllm_files::bounded::{self, MAX_CONFIG_BYTES};

use crate::{
    arrow,
    clip_points::PyClipPoints,
    errors,
    options::check_range,
    points::PyPoints,
    score::to_python,
    work::{self, Stop, on_threads},
};

/// Most threads of a build, as in the library.
const MAX_THREADS: usize = 1024;
/// Time between two attempts to have a folder alone.
const LOCK_POLL: Duration = Duration::from_millis(50);
/// Joints of a pose, and coordinates of a joint.
const POSE: [usize; 2] = [22, 3];

/// The configuration of a data set, a TOML file as in `configs/data/default-data.toml`.
///
/// `build` does everything in this process. To use several processes or machines that share a folder, one calls
/// `prepare`, then any of them `build_shard`, and at the end one `finish`; the bytes are the same. `radarllm.ray.build`
/// does this on a Ray cluster.
#[pyclass(frozen, name = "DatasetPlan", module = "radarllm")]
pub struct PyDatasetPlan {
    path: PathBuf,
    text: String,
    config: DatasetConfig,
    /// The sources, opened once: thousands of motions take seconds.
    plan: OnceLock<DatasetPlan>,
}

impl PyDatasetPlan {
    fn parse(path: PathBuf, text: String) -> Result<Self> {
        let config = DatasetConfig::from_toml(&text).map_err(|e| Error::wrap_in_file(&path, e))?;
        Ok(Self {
            path,
            text,
            config,
            plan: OnceLock::new(),
        })
    }

    fn plan(&self, is_stopped: &(dyn Fn() -> bool + Sync)) -> Result<&DatasetPlan> {
        if let Some(plan) = self.plan.get() {
            return Ok(plan);
        }
        let base = self.path.parent().unwrap_or(Path::new(""));
        let config = self.config.clone();
        let opened = on_threads(None, || {
            Ok(DatasetPlan::new_until(config, base, is_stopped)?)
        })?;
        Ok(self.plan.get_or_init(|| opened))
    }

    /// Some shards of a folder that was prepared, chosen by their number, without opening the sources; the whole plan where
    /// it is open already or where the folder has no index for it.
    fn with_shards<T>(
        &self,
        out: &Path,
        choose: impl FnOnce(usize) -> Vec<usize>,
        is_stopped: &(dyn Fn() -> bool + Sync),
        work: impl FnOnce(&DatasetPlan) -> Result<T>,
    ) -> Result<T> {
        if self.plan.get().is_none() {
            let base = self.path.parent().unwrap_or(Path::new(""));
            let choose = |n_shards| Ok(choose(n_shards));
            if let Some(part) = DatasetPlan::of_prepared(self.config.clone(), base, out, choose)? {
                return work(&part);
            }
        }
        work(self.plan(is_stopped)?)
    }

    /// Opens the sources and reads something of the plan.
    fn of_plan<T: Send>(
        &self,
        py: Python<'_>,
        read: impl FnOnce(&DatasetPlan) -> T + Send,
    ) -> PyResult<T> {
        work::run(py, |stop| self.plan(&|| stop.is_set()).map(read))
    }
}

#[pymethods]
impl PyDatasetPlan {
    #[new]
    fn new(path: PathBuf) -> PyResult<Self> {
        let read = || Self::parse(path.clone(), bounded::read_text(&path, MAX_CONFIG_BYTES)?);
        read().map_err(errors::to_py)
    }

    /// Name of the data set.
    #[getter]
    fn name(&self) -> &str {
        &self.config.name
    }

    /// Number of clips that are asked for. Opens the sources, which takes seconds for thousands of motions.
    #[getter]
    fn n_clips(&self, py: Python<'_>) -> PyResult<usize> {
        self.of_plan(py, DatasetPlan::n_clips)
    }

    /// Number of shards. They are numbered from 0, those of the training split first. Opens the sources.
    #[getter]
    fn n_shards(&self, py: Python<'_>) -> PyResult<usize> {
        self.of_plan(py, DatasetPlan::n_shards)
    }

    /// Hash of everything that determines the content: processes with the same one build the same data set. Opens the
    /// sources.
    #[getter]
    fn fingerprint(&self, py: Python<'_>) -> PyResult<String> {
        self.of_plan(py, |plan| plan.fingerprint().to_string())
    }

    /// Builds the data set in the folder `out`, or goes on with a build that was interrupted.
    ///
    /// The bytes do not depend on `threads`, which are as many as cores if None. Another data set in the folder is
    /// refused, unless `overwrite` is true. `retry_failed` also builds shards with failed clips again. Ctrl-C leaves
    /// complete shards only.
    ///
    /// Returns the numbers that `radarllm dataset build --json` prints: clips, failed, skipped, shards, shards_made and
    /// seconds.
    #[pyo3(signature = (out, *, threads=None, overwrite=false, retry_failed=false))]
    fn build<'py>(
        &self,
        py: Python<'py>,
        out: PathBuf,
        threads: Option<usize>,
        overwrite: bool,
        retry_failed: bool,
    ) -> PyResult<Bound<'py, PyDict>> {
        let options = build_options(threads, overwrite, retry_failed)?;
        let started = Instant::now();
        let report = work::run(py, |stop| {
            let is_stopped = || stop.is_set();
            let plan = self.plan(&is_stopped)?;
            plan.build(&out, options, |_| (), &is_stopped)
        })?;
        let numbers = numbers(py, &report.manifest)?;
        numbers.set_item("shards_made", report.n_made_shards)?;
        numbers.set_item("seconds", started.elapsed().as_secs_f64())?;
        Ok(numbers)
    }

    /// First step of a build by several processes: makes `out` the folder of this data set, or of its build that was
    /// begun before. Nobody else may work in the folder at that time; if somebody does, waits `wait_s` seconds for the
    /// end of that.
    ///
    /// Another data set in the folder is refused, unless `overwrite` is true, and so is an object store.
    #[pyo3(signature = (out, *, overwrite=false, wait_s=0.0))]
    fn prepare(&self, py: Python<'_>, out: PathBuf, overwrite: bool, wait_s: f64) -> PyResult<()> {
        let wait = duration("wait_s", wait_s)?;
        work::run(py, |stop| {
            let plan = self.plan(&|| stop.is_set())?;
            alone(stop, wait, || plan.prepare(&out, on_existing(overwrite)))
        })
    }

    /// Second step: builds one shard in a prepared folder, or keeps it if it is there and its hash fits. Any number of
    /// processes may do this at the same time. The clips of the shard are read from the index of the folder, so that the
    /// sources need not be opened.
    ///
    /// A folder that was prepared with another configuration, by another version of this package or on a machine that
    /// rounds differently is refused. Ctrl-C leaves no file of an incomplete shard under its final name.
    ///
    /// Returns file, split, rows, bytes, blake3, ids, failed (clips that could not be made, with the reason) and made
    /// (false if the shard was kept).
    #[pyo3(signature = (out, shard, *, threads=1))]
    fn build_shard<'py>(
        &self,
        py: Python<'py>,
        out: PathBuf,
        shard: usize,
        threads: usize,
    ) -> PyResult<Bound<'py, PyAny>> {
        let options = build_options(Some(threads), false, false)?;
        let (entry, made) = work::run(py, |stop| {
            let is_stopped = || stop.is_set();
            let only = |_| vec![shard];
            let built = self.with_shards(&out, only, &is_stopped, |plan| {
                plan.build_shards(&out, [shard], options, |_| (), &is_stopped)
            })?;
            let entry = built.entries.into_iter().next();
            let entry = entry.ok_or_else(|| Error::bug(format!("shard {shard} was not built")))?;
            Ok((entry, built.n_kept == 0))
        })?;
        let entry = to_python(py, &entry)?;
        entry.set_item("made", made)?;
        Ok(entry)
    }

    /// Last step: reads every hash again and writes the card and the manifest. Nobody else may work in the folder at
    /// that time; if somebody does, waits `wait_s` seconds for the end of that.
    ///
    /// Missing and damaged shards are named in the error. Returns clips, failed, skipped and shards.
    #[pyo3(signature = (out, *, wait_s=0.0))]
    fn finish<'py>(
        &self,
        py: Python<'py>,
        out: PathBuf,
        wait_s: f64,
    ) -> PyResult<Bound<'py, PyDict>> {
        let wait = duration("wait_s", wait_s)?;
        let manifest = work::run(py, |stop| {
            let all = |n_shards| (0..n_shards).collect();
            self.with_shards(&out, all, &|| stop.is_set(), |plan| {
                alone(stop, wait, || plan.finish(&out))
            })
        })?;
        numbers(py, &manifest)
    }

    /// Makes a plan from the text of its file, on another machine where only its sources need to exist.
    #[staticmethod]
    fn _restore(path: PathBuf, text: String) -> PyResult<Self> {
        Self::parse(path, text).map_err(errors::to_py)
    }

    fn __reduce__<'py>(
        this: &Bound<'py, Self>,
    ) -> PyResult<(Bound<'py, PyAny>, (PathBuf, String))> {
        let restore = this.get_type().getattr("_restore")?;
        let path = std::path::absolute(&this.get().path)?;
        Ok((restore, (path, this.get().text.clone())))
    }

    fn __repr__(&self) -> String {
        format!("DatasetPlan({:?})", self.path.display().to_string())
    }
}

fn duration(name: &str, seconds: f64) -> PyResult<Duration> {
    Duration::try_from_secs_f64(seconds)
        .map_err(|_| errors::input(format!("`{name}` {seconds}: must be 0 or more seconds")))
}

/// Does what needs the folder alone, again and again while another process is in it.
fn alone<T>(stop: &Stop, wait: Duration, attempt: impl Fn() -> Result<T>) -> Result<T> {
    let started = Instant::now();
    loop {
        match attempt() {
            Err(e) if e.kind == ErrorKind::Locked && started.elapsed() < wait => {
                stop.check()?;
                thread::sleep(LOCK_POLL);
            }
            outcome => return outcome,
        }
    }
}

fn on_existing(overwrite: bool) -> Overwrite {
    match overwrite {
        true => Overwrite::Replace,
        false => Overwrite::Refuse,
    }
}

fn build_options(
    threads: Option<usize>,
    overwrite: bool,
    retry_failed: bool,
) -> PyResult<BuildOptions> {
    let cores = || std::thread::available_parallelism().map_or(1, usize::from);
    let threads = threads.unwrap_or_else(cores);
    check_range("threads", threads, 1..=MAX_THREADS).map_err(errors::to_py)?;
    Ok(BuildOptions {
        threads,
        overwrite: on_existing(overwrite),
        retry_failed,
    })
}

fn numbers<'py>(py: Python<'py>, manifest: &Manifest) -> PyResult<Bound<'py, PyDict>> {
    let numbers = PyDict::new(py);
    numbers.set_item("clips", manifest.n_clips)?;
    numbers.set_item("failed", manifest.n_failed)?;
    numbers.set_item("skipped", manifest.skipped.len())?;
    numbers.set_item("shards", manifest.shards.len())?;
    Ok(numbers)
}

/// A finished radar-text data set in a folder.
///
/// `split("train")`, `split("val")` and `split("test")` give its clips. A shard whose bytes are not those of the manifest is
/// refused when it is read. `close()`, or the end of a `with` block, ends the use.
#[pyclass(frozen, name = "Dataset", module = "radarllm")]
pub struct PyDataset(Mutex<Option<Dataset>>);

impl PyDataset {
    fn dataset(&self) -> PyResult<Dataset> {
        let dataset = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        dataset.clone().ok_or_else(|| {
            errors::input_with_hint(
                "this data set is closed",
                "use it within its `with` block, or open it again",
            )
        })
    }
}

#[pymethods]
impl PyDataset {
    #[new]
    fn new(folder: PathBuf) -> PyResult<Self> {
        let opened = Dataset::open(&folder).map_err(|e| {
            errors::to_py(Error::from(e).with_hint(
                "a folder that `DatasetPlan.build` or `radarllm dataset build` finished",
            ))
        })?;
        Ok(Self(Mutex::new(Some(opened.checking_hashes()))))
    }

    /// Name of the data set.
    #[getter]
    fn name(&self) -> PyResult<String> {
        Ok(self.dataset()?.manifest().name.clone())
    }

    /// Name of the radar.
    #[getter]
    fn radar(&self) -> PyResult<String> {
        Ok(self.dataset()?.manifest().radar.clone())
    }

    /// Frames per second, Hz.
    #[getter]
    fn frame_rate_hz(&self) -> PyResult<f64> {
        Ok(self.dataset()?.manifest().frame_rate_hz)
    }

    /// Counts of clips, frames, points and captions, as `radarllm dataset info` prints them.
    fn info<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let dataset = self.dataset()?;
        let info = work::run(py, |_| Ok(dataset.info()?))?;
        to_python(py, &info)
    }

    /// Reads everything and returns the problems found: hashes, sizes, values, ids, splits. An empty list is good.
    fn validate(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        let dataset = self.dataset()?;
        let problems = work::run(py, |_| Ok(validate(dataset.dir())?))?;
        let line = |p: radarllm::dataset::Problem| {
            let id = p.id.map(|id| format!(": {id}")).unwrap_or_default();
            format!("{}{id}: {}", p.file, p.problem)
        };
        Ok(problems.into_iter().map(line).collect())
    }

    /// The clips of a split: "train", "val" or "test".
    fn split(&self, name: &str) -> PyResult<PySplit> {
        let split = Split::from_name(name).ok_or_else(|| {
            errors::input_with_hint(format!("split {name:?}: unknown"), "train, val or test")
        })?;
        Ok(PySplit {
            dataset: self.dataset()?,
            split,
        })
    }

    /// Whether `close` was called.
    #[getter]
    fn closed(&self) -> bool {
        self.dataset().is_err()
    }

    /// Ends the use of the data set; may be called again.
    fn close(&self) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = None;
    }

    fn __enter__(this: PyRef<'_, Self>) -> PyResult<PyRef<'_, Self>> {
        this.dataset()?;
        Ok(this)
    }

    fn __exit__(
        &self,
        _kind: &Bound<'_, PyAny>,
        _error: &Bound<'_, PyAny>,
        _trace: &Bound<'_, PyAny>,
    ) {
        self.close();
    }

    fn __repr__(&self) -> String {
        match self.dataset() {
            Ok(dataset) => format!("Dataset({:?})", dataset.dir().display().to_string()),
            Err(_) => "Dataset(closed)".into(),
        }
    }
}

/// The clips of a split. Iterating reads one after the other; any Arrow library reads the rows:
/// `pyarrow.table(split)`, or `pyarrow.RecordBatchReader.from_stream(split)` for one batch after the other.
#[pyclass(frozen, name = "Split", module = "radarllm")]
pub struct PySplit {
    dataset: Dataset,
    split: Split,
}

#[pymethods]
impl PySplit {
    /// Name of the split.
    #[getter]
    fn name(&self) -> &'static str {
        self.split.name()
    }

    fn __len__(&self) -> usize {
        usize::try_from(self.dataset.n_clips(self.split)).unwrap_or(usize::MAX)
    }

    fn __iter__(&self) -> PyClips {
        self.clips(self.dataset.iter_split(self.split, Columns::All))
    }

    /// Number of clips of each shard, and its hash by the manifest.
    #[getter]
    fn _shards(&self) -> Vec<(u64, String)> {
        let shards = self.dataset.shards(self.split);
        shards.map(|s| (s.rows, s.blake3.clone())).collect()
    }

    /// The clips of one shard, without their joints.
    fn _shard_clips(&self, shard: usize) -> PyResult<PyClips> {
        let clips = self.dataset.iter_shard(self.split, shard, Columns::Points);
        Ok(self.clips(clips.map_err(|e| errors::to_py(e.into()))?))
    }

    /// The points of one shard, in pieces of at most 32 clips.
    fn _shard_points(&self, py: Python<'_>, shard: usize) -> PyResult<Vec<PyClipPoints>> {
        work::run(py, |stop| {
            let batches = self
                .dataset
                .iter_shard_batches(self.split, shard, Columns::Points)?;
            batches
                .map(|batch| {
                    stop.check()?;
                    PyClipPoints::new(batch?)
                })
                .collect()
        })
    }

    #[pyo3(signature = (requested_schema=None))]
    fn __arrow_c_stream__<'py>(
        &self,
        py: Python<'py>,
        requested_schema: Option<Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyCapsule>> {
        // The protocol allows a producer to keep its own types where it cannot convert.
        let _ = requested_schema;
        let batches = self.dataset.iter_batches(self.split);
        let external = |e| arrow_schema::ArrowError::ExternalError(Box::new(e));
        let batches = batches.map(move |rows| arrow::batch_of(rows.map_err(external)?));
        let schema = Arc::new(arrow::schema_of(&BatchIter::no_rows()));
        arrow::capsule(py, Box::new(RecordBatchIterator::new(batches, schema)))
    }

    fn __repr__(&self) -> String {
        format!("Split({}, {} clips)", self.split.name(), self.__len__())
    }
}

impl PySplit {
    fn clips(&self, clips: ClipIter) -> PyClips {
        PyClips {
            clips: Mutex::new(Some(clips)),
            frame_rate_hz: self.dataset.manifest().frame_rate_hz,
        }
    }
}

/// Iterator over the clips of a split.
#[pyclass(frozen, name = "Clips", module = "radarllm")]
pub struct PyClips {
    clips: Mutex<Option<ClipIter>>,
    frame_rate_hz: f64,
}

#[pymethods]
impl PyClips {
    fn __iter__(this: PyRef<'_, Self>) -> PyRef<'_, Self> {
        this
    }

    fn __next__(&self, py: Python<'_>) -> PyResult<Option<PyClip>> {
        // Taken out while it works: a lock that is held without the interpreter's own could block both.
        let taken = self
            .clips
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .take();
        let Some(mut clips) = taken else {
            return Err(errors::input("this iterator is in use by another thread"));
        };
        let (clips, found) = work::run(py, move |_| {
            let found = clips.next().transpose();
            Ok((clips, found))
        })?;
        *self.clips.lock().unwrap_or_else(PoisonError::into_inner) = Some(clips);
        let record = found.map_err(|e| errors::to_py(e.into()))?;
        record
            .map(|record| PyClip::new(py, record, self.frame_rate_hz))
            .transpose()
    }
}

/// One simulation or recording of one motion with its captions.
#[pyclass(frozen, get_all, name = "Clip", module = "radarllm")]
pub struct PyClip {
    /// Unique in the data set.
    id: String,
    /// The motion; all variants of it share it.
    motion_id: String,
    /// Group of motions that are in the same split.
    group: String,
    /// "train", "val" or "test".
    split: &'static str,
    /// Action label.
    action: String,
    /// Reference captions.
    captions: Vec<String>,
    /// Source of the motion.
    source: String,
    /// The points.
    points: Py<PyPoints>,
    /// Rate of `joints`, 1/s.
    motion_fps: f32,
    /// Joints of the body in the radar's axes, m: float32, shape (n_poses, 22, 3); no poses where they are unknown.
    joints: Py<PyArray3<f32>>,
}

impl PyClip {
    fn new(py: Python<'_>, record: ClipRecord, frame_rate_hz: f64) -> PyResult<Self> {
        let joints: Vec<f32> = record.joints.iter().flatten().flatten().copied().collect();
        let shape = [record.joints.len(), POSE[0], POSE[1]];
        let points = PyPoints::from(Clip {
            frames: record.frames,
            frame_rate_hz,
            radar_height_m: record.radar_height_m,
            is_height_assumed: false,
            radar: record.radar,
            // Clips of data sets are simulated, without clutter.
            provenance: Provenance::simulated(&record.id, record.seed),
            clutter: Clutter::Settled,
        });
        Ok(Self {
            points: Py::new(py, points)?,
            joints: PyArray1::from_vec(py, joints).reshape(shape)?.unbind(),
            id: record.id,
            motion_id: record.motion_id,
            group: record.group,
            split: record.split.name(),
            action: record.action,
            captions: record.captions,
            source: record.source,
            motion_fps: record.motion_fps,
        })
    }
}

#[pymethods]
impl PyClip {
    fn __repr__(&self) -> String {
        let caption = self.captions.first().map_or("", String::as_str);
        format!("Clip({:?}, {caption:?})", self.id)
    }
}
