//! `Points`.

use std::{
    path::PathBuf,
    sync::{Arc, OnceLock},
};

use arrow_array::{
    RecordBatch,
    cast::AsArray,
    types::{Float32Type, Float64Type, UInt32Type},
};
use numpy::{
    PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2, PyUntypedArray, PyUntypedArrayMethods,
    ndarray::ArrayView1,
};
use pyo3::{
    prelude::*,
    types::{PyCapsule, PyDict, PyTuple},
};
use radarllm::{
    Clip, Clutter, Overwrite, PointFrame, PointsMeta, Provenance, RadarPoint, Recording,
    inference::PrepareOptions, io::options::DEFAULT_RADAR_HEIGHT_M,
    io::recording::read_points_file, point_columns, points_to_table, table::Table, write_clip,
};
use radarllm_base::{BoardReport, BoardTrack};

use crate::{arrow, errors, html, work};

/// Columns of the points, in their order.
pub(crate) const COLUMNS: [&str; 8] = [
    "frame",
    "t_s",
    "x_m",
    "y_m",
    "z_m",
    "range_m",
    "velocity_mps",
    "intensity_db",
];
/// Values of a point in an array.
const N_VALUES: usize = 6;
/// Most frames and points, those of a points file.
const MAX_FRAMES: usize = 2_000_000;
const MAX_POINTS: usize = 20_000_000;
/// What `source` is where the caller does not name one.
const UNNAMED: &str = "array";

/// Radar points of a recording or a simulation, frame by frame, with the radar, the frame rate and the provenance.
///
/// `points[name]` is a column over all points: "x_m" (right of the radar), "y_m" (away from it), "z_m" (above it),
/// "range_m", all in m, "velocity_mps" (m/s, positive when receding) and "intensity_db" as float32, "frame" as uint32 and
/// "t_s" (s) as float64. Columns have shape (n_points,), share memory with this object and are read-only. The points of
/// frame i are those from `offsets[i]` to `offsets[i + 1]`.
///
/// Any Arrow library reads points without a copy: `pyarrow.table(points)`, `polars.DataFrame(points)`.
///
/// >>> points = simulate("builtin:wave?side=left")
/// >>> points["x_m"].dtype, points["x_m"].flags.writeable
/// (dtype('float32'), False)
/// >>> points.offsets[-1] == points.n_points == len(points["x_m"])
/// True
/// >>> points.synthetic
/// True
#[pyclass(frozen, name = "Points", module = "radarllm")]
pub struct PyPoints {
    pub recording: Arc<Recording>,
    table: OnceLock<RecordBatch>,
    columns: OnceLock<RecordBatch>,
    frames: OnceLock<Frames>,
}

/// Values of the frames.
struct Frames {
    offsets: Vec<i64>,
    times_s: Vec<f64>,
    numbers: Vec<u32>,
}

impl From<Recording> for PyPoints {
    fn from(recording: Recording) -> Self {
        Self {
            recording: Arc::new(recording),
            table: OnceLock::new(),
            columns: OnceLock::new(),
            frames: OnceLock::new(),
        }
    }
}

impl From<Clip> for PyPoints {
    fn from(clip: Clip) -> Self {
        Recording::new(clip, Vec::new(), PrepareOptions::default()).into()
    }
}

fn arrow_batch(table: Table) -> radarllm::Result<RecordBatch> {
    arrow::batch_of(table).map_err(|e| radarllm::Error::input(e.to_string()))
}

impl PyPoints {
    pub fn clip(&self) -> &Clip {
        &self.recording.clip
    }

    /// The table of a points file, made once.
    fn table(&self, py: Python<'_>) -> PyResult<&RecordBatch> {
        if let Some(table) = self.table.get() {
            return Ok(table);
        }
        let clip = self.clip();
        let table = work::run(py, |_| {
            arrow_batch(points_to_table(&PointsMeta::of(clip), &clip.frames)?)
        })?;
        Ok(self.table.get_or_init(|| table))
    }

    /// The columns of the points, made once: those of the table, unless it has rows that are no points.
    fn point_table(&self, py: Python<'_>) -> PyResult<&RecordBatch> {
        if let Some(columns) = self.columns.get() {
            return Ok(columns);
        }
        let (clip, table) = (self.clip(), self.table(py)?);
        let columns = match table.num_rows() == clip.n_points() {
            true => table.clone(),
            false => work::run(py, |_| {
                arrow_batch(point_columns(&PointsMeta::of(clip), &clip.frames)?)
            })?,
        };
        Ok(self.columns.get_or_init(|| columns))
    }

    fn frames(&self) -> &Frames {
        self.frames.get_or_init(|| {
            let frames = &self.clip().frames;
            let mut end = 0;
            let ends = frames.iter().map(|f| {
                end += f.points.len() as i64;
                end
            });
            Frames {
                offsets: [0].into_iter().chain(ends).collect(),
                times_s: frames.iter().map(|f| f.time_s).collect(),
                numbers: frames.iter().map(|f| f.frame).collect(),
            }
        })
    }
}

/// A read-only array on memory of `owner`.
///
/// # Safety
/// `owner` must keep `values` in place and unchanged as long as it lives.
pub(crate) unsafe fn view<'py, T: numpy::Element>(
    values: &[T],
    owner: Bound<'py, PyAny>,
) -> Bound<'py, PyArray1<T>> {
    // SAFETY: guaranteed by the caller.
    let array = unsafe { PyArray1::borrow_from_array(&ArrayView1::from(values), owner) };
    array.readwrite().make_nonwriteable();
    array
}

#[pymethods]
impl PyPoints {
    /// Reads a points file, written by this package, by the command or by any program with the same columns.
    #[staticmethod]
    fn read(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let read = work::run(py, |_| {
            let file = read_points_file(&path, &radarllm::CaptureOptions::default())?;
            Ok(Recording::new(
                file.clip,
                file.notes,
                PrepareOptions::default(),
            ))
        })?;
        Ok(read.into())
    }

    /// Makes points from NumPy arrays, one of shape (n, 6) for each frame: x, y, z, range in m, radial velocity in m/s
    /// (positive when receding), intensity in dB. Any layout and any real dtype will do; the values are copied.
    ///
    /// `synthetic` says whether a simulator made the points. It must be given: it stands in every output. `times_s` are
    /// the times of the frames, s; frame i is at i / `frame_rate_hz` without them. The points of a frame are kept with
    /// the strongest first, which is the order of points files.
    #[staticmethod]
    #[pyo3(signature = (frames, *, frame_rate_hz, radar, synthetic=None, source=None, seed=None, radar_height_m=None, times_s=None))]
    #[expect(clippy::too_many_arguments, reason = "all are keywords of Python")]
    fn from_numpy(
        frames: &Bound<'_, PyAny>,
        frame_rate_hz: f64,
        radar: String,
        synthetic: Option<bool>,
        source: Option<String>,
        seed: Option<u64>,
        radar_height_m: Option<f32>,
        times_s: Option<Vec<f64>>,
    ) -> PyResult<Self> {
        let provenance = provenance(synthetic, source, seed)?;
        if !(frame_rate_hz.is_finite() && frame_rate_hz > 0.0) {
            return Err(errors::input(format!(
                "`frame_rate_hz` {frame_rate_hz}: must be finite and positive"
            )));
        }
        if let Some(height_m) = radar_height_m.filter(|height_m| !height_m.is_finite()) {
            return Err(errors::input(format!("`radar_height_m` is {height_m}")));
        }
        let mut out: Vec<PointFrame> = Vec::new();
        let mut n_points = 0;
        for (index, values) in frames.try_iter()?.enumerate() {
            let points = points_of(index, &values?)?;
            n_points += points.len();
            if index >= MAX_FRAMES || n_points > MAX_POINTS {
                return Err(errors::input(format!(
                    "more than {MAX_FRAMES} frames or {MAX_POINTS} points"
                )));
            }
            let mut frame = PointFrame {
                frame: index as u32,
                time_s: index as f64 / frame_rate_hz,
                points,
                board: None,
            };
            frame.sort_by_intensity();
            out.push(frame);
        }
        if let Some(times_s) = times_s {
            set_times(&mut out, &times_s)?;
        }
        Ok(Self::from(Clip {
            frames: out,
            frame_rate_hz,
            radar_height_m: radar_height_m.unwrap_or(DEFAULT_RADAR_HEIGHT_M),
            is_height_assumed: radar_height_m.is_none(),
            radar,
            provenance,
            clutter: Clutter::Unchecked,
        }))
    }

    /// Makes points from an Arrow table of any library, with the columns of `points[name]`: one row for each point.
    ///
    /// The radar, the frame rate, the provenance and frames without points are read from the metadata of the schema,
    /// which `pyarrow.table(points)` has. What it lacks must be given, as in `from_numpy`.
    #[staticmethod]
    #[pyo3(signature = (table, *, radar=None, frame_rate_hz=None, synthetic=None, source=None, seed=None, radar_height_m=None))]
    fn from_arrow(
        table: &Bound<'_, PyAny>,
        radar: Option<String>,
        frame_rate_hz: Option<f64>,
        synthetic: Option<bool>,
        source: Option<String>,
        seed: Option<u64>,
        radar_height_m: Option<f32>,
    ) -> PyResult<Self> {
        let file = arrow::points_from(table, |metadata| {
            if synthetic.is_some() || !metadata.contains_key("source") {
                let provenance = provenance(synthetic, source, seed)?;
                metadata.insert("source".into(), provenance.to_string());
                metadata.remove("seed");
                if let Some(seed) = provenance.seed() {
                    metadata.insert("seed".into(), seed.to_string());
                }
            }
            let given = [
                ("radar", radar),
                ("frame_rate", frame_rate_hz.map(|rate| rate.to_string())),
                (
                    "radar_height_m",
                    radar_height_m.map(|height| height.to_string()),
                ),
            ];
            for (key, value) in given {
                metadata.extend(value.map(|value| (key.to_string(), value)));
            }
            match metadata.contains_key("radar") {
                true => Ok(()),
                false => Err(errors::input_with_hint(
                    "from_arrow: the table does not say which radar made the points",
                    "radar=\"name\", and frame_rate_hz=... unless the times tell it",
                )),
            }
        })?;
        let Ok(parsed) = file.meta.source.parse::<Provenance>();
        let provenance = match parsed {
            Provenance::Simulated { input, .. } => Provenance::Simulated {
                input,
                seed: file.meta.seed,
            },
            recorded => recorded,
        };
        let mut frames = file.frames;
        frames.iter_mut().for_each(PointFrame::sort_by_intensity);
        // As in files: where no point has a speed, none is known to be static.
        let mut clip = Clip {
            frames,
            frame_rate_hz: file.meta.frame_rate_hz,
            radar_height_m: file.meta.radar_height_m.unwrap_or(DEFAULT_RADAR_HEIGHT_M),
            is_height_assumed: file.meta.radar_height_m.is_none(),
            radar: file.meta.radar,
            provenance,
            clutter: Clutter::Unchecked,
        };
        if !file.meta.has_speeds || !clip.has_speeds() {
            clip.clutter = Clutter::Settled;
        }
        Ok(Self::from(clip))
    }

    /// Writes a points file (Parquet), complete or not at all. Raises `FileExistsError` if the file exists, unless
    /// `overwrite` is true.
    #[pyo3(signature = (path, *, overwrite=false))]
    fn write(&self, py: Python<'_>, path: PathBuf, overwrite: bool) -> PyResult<()> {
        let how = match overwrite {
            true => Overwrite::Replace,
            false => Overwrite::Refuse,
        };
        work::run(py, |_| Ok(write_clip(&path, self.clip(), how)?))
    }

    /// Name of the radar.
    #[getter]
    fn radar(&self) -> &str {
        &self.clip().radar
    }

    /// Frames per second, Hz.
    #[getter]
    fn frame_rate_hz(&self) -> f64 {
        self.clip().frame_rate_hz
    }

    /// Height of the radar above the floor, m.
    #[getter]
    fn radar_height_m(&self) -> f32 {
        self.clip().radar_height_m
    }

    /// Where the points come from: `simulated:INPUT` or `recorded:FORMAT:PATH`.
    #[getter]
    fn source(&self) -> String {
        self.clip().provenance.to_string()
    }

    /// Whether a simulator made the points.
    #[getter]
    fn synthetic(&self) -> bool {
        self.clip().provenance.is_simulated()
    }

    /// Seed of the simulation; None for recordings.
    #[getter]
    fn seed(&self) -> Option<u64> {
        self.clip().provenance.seed()
    }

    /// What the reader of the recording noted: how the format was detected, what was dropped.
    #[getter]
    fn notes(&self) -> Vec<String> {
        self.recording.notes.clone()
    }

    /// Captions of the simulated built-in motion; empty for anything else.
    #[getter]
    fn captions(&self) -> Vec<String> {
        let performed = self.recording.performed.as_ref();
        performed.map_or_else(Vec::new, |p| p.motion.info.captions.clone())
    }

    /// Number of points in all frames.
    #[getter]
    fn n_points(&self) -> usize {
        self.clip().n_points()
    }

    /// Length, s: number of frames divided by the frame rate.
    #[getter]
    fn duration_s(&self) -> f64 {
        self.clip().duration_s()
    }

    /// Names of the columns.
    #[classattr]
    fn columns(py: Python<'_>) -> PyResult<Bound<'_, PyTuple>> {
        PyTuple::new(py, COLUMNS)
    }

    /// First point of each frame and the end: int64, shape (n_frames + 1,), read-only.
    #[getter]
    fn offsets<'py>(this: &Bound<'py, Self>) -> Bound<'py, PyArray1<i64>> {
        // SAFETY: the vector is made once and never changed.
        unsafe { view(&this.get().frames().offsets, this.clone().into_any()) }
    }

    /// Times of the frames, s: float64, shape (n_frames,), read-only.
    #[getter]
    fn times_s<'py>(this: &Bound<'py, Self>) -> Bound<'py, PyArray1<f64>> {
        // SAFETY: the vector is made once and never changed.
        unsafe { view(&this.get().frames().times_s, this.clone().into_any()) }
    }

    /// Numbers of the frames: uint32, shape (n_frames,), read-only. Frames that the recording lost are missing.
    #[getter]
    fn frame_numbers<'py>(this: &Bound<'py, Self>) -> Bound<'py, PyArray1<u32>> {
        // SAFETY: the vector is made once and never changed.
        unsafe { view(&this.get().frames().numbers, this.clone().into_any()) }
    }

    /// Points of frame `index`: float32, shape (n, 6), a copy. The values are x, y, z, range in m, radial velocity in
    /// m/s and intensity in dB; the strongest point is the first. A negative index counts from the end.
    fn frame<'py>(&self, py: Python<'py>, index: isize) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let frames = &self.clip().frames;
        let from_start = match index {
            0.. => Some(index as usize),
            _ => frames.len().checked_sub(index.unsigned_abs()),
        };
        let Some(frame) = from_start.and_then(|i| frames.get(i)) else {
            return Err(pyo3::exceptions::PyIndexError::new_err(format!(
                "frame {index} of {}",
                frames.len()
            )));
        };
        let values: Vec<f32> = frame.points.iter().flat_map(values_of).collect();
        PyArray1::from_vec(py, values).reshape([frame.points.len(), N_VALUES])
    }

    /// The people whom the firmware of the board tracks, in order of time: arrays of equal length by name, `frame`, `t_s`,
    /// `id`, place and height above the radar `x_m`, `y_m`, `z_m` (NaN where it tracks in a plane), and velocity `vx_mps`,
    /// `vy_mps`, `vz_mps`. Empty for boards that report points alone.
    #[getter]
    fn tracks<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let tracks = || {
            let frames = self.clip().frames.iter();
            frames.flat_map(|f| {
                f.board
                    .iter()
                    .flat_map(move |b| b.tracks.iter().map(move |t| (f, t)))
            })
        };
        let all = PyDict::new(py);
        let numbers = tracks().map(|(frame, _)| frame.frame);
        all.set_item("frame", PyArray1::from_iter(py, numbers))?;
        all.set_item(
            "t_s",
            PyArray1::from_iter(py, tracks().map(|(frame, _)| frame.time_s)),
        )?;
        all.set_item(
            "id",
            PyArray1::from_iter(py, tracks().map(|(_, track)| track.id)),
        )?;
        type Member = fn(&BoardTrack) -> f32;
        let members: [(&str, Member); 6] = [
            ("x_m", |t| t.place_m[0]),
            ("y_m", |t| t.place_m[1]),
            ("z_m", |t| t.height_m.unwrap_or(f32::NAN)),
            ("vx_mps", |t| t.velocity_mps[0]),
            ("vy_mps", |t| t.velocity_mps[1]),
            ("vz_mps", |t| t.velocity_mps[2]),
        ];
        for (name, member) in members {
            let values = tracks().map(|(_, track)| member(track));
            all.set_item(name, PyArray1::from_iter(py, values))?;
        }
        Ok(all)
    }

    /// The page of the points: one HTML file that needs nothing else.
    fn to_html(&self, py: Python<'_>) -> PyResult<String> {
        work::run(py, |_| Ok(html::page(self.clip(), None)))
    }

    fn _repr_html_(&self, py: Python<'_>) -> PyResult<String> {
        Ok(html::inline(&self.to_html(py)?))
    }

    fn __getitem__<'py>(this: &Bound<'py, Self>, column: &str) -> PyResult<Bound<'py, PyAny>> {
        let points = this.get();
        let batch = points.point_table(this.py())?;
        let Some(values) = batch.column_by_name(column) else {
            return Err(pyo3::exceptions::PyKeyError::new_err(format!(
                "{column}: the columns are {}",
                COLUMNS.join(", ")
            )));
        };
        let owner = this.clone().into_any();
        // SAFETY: of all three arrays: the batch is made once and never changed or replaced.
        let array = unsafe {
            match column {
                "frame" => view(values.as_primitive::<UInt32Type>().values(), owner).into_any(),
                "t_s" => view(values.as_primitive::<Float64Type>().values(), owner).into_any(),
                _ => view(values.as_primitive::<Float32Type>().values(), owner).into_any(),
            }
        };
        Ok(array)
    }

    fn __len__(&self) -> usize {
        self.clip().frames.len()
    }

    fn __eq__(&self, other: &Bound<'_, PyAny>) -> bool {
        other
            .cast::<Self>()
            .is_ok_and(|other| self.clip() == other.get().clip())
    }

    #[pyo3(signature = (requested_schema=None))]
    fn __arrow_c_stream__<'py>(
        &self,
        py: Python<'py>,
        requested_schema: Option<Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyCapsule>> {
        // The protocol allows a producer to keep its own types where it cannot convert.
        let _ = requested_schema;
        arrow::capsule_of_batch(py, self.table(py)?)
    }

    fn __repr__(&self) -> String {
        let clip = self.clip();
        format!(
            "Points({} frames at {} Hz, {} points, radar {:?}, {})",
            clip.frames.len(),
            clip.frame_rate_hz,
            clip.n_points(),
            clip.radar,
            clip.provenance
        )
    }

    /// For copies and other processes: the points themselves, without the motion that was simulated.
    fn __reduce__<'py>(
        this: &Bound<'py, Self>,
    ) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyDict>,))> {
        let py = this.py();
        let points = this.get();
        let clip = points.clip();
        let state = PyDict::new(py);
        let values: Vec<f32> = clip
            .frames
            .iter()
            .flat_map(|f| &f.points)
            .flat_map(values_of)
            .collect();
        state.set_item("values", PyArray1::from_vec(py, values))?;
        state.set_item(
            "offsets",
            PyArray1::from_slice(py, &points.frames().offsets),
        )?;
        state.set_item(
            "times_s",
            PyArray1::from_slice(py, &points.frames().times_s),
        )?;
        state.set_item(
            "numbers",
            PyArray1::from_slice(py, &points.frames().numbers),
        )?;
        let reports = clip.frames.iter().map(|f| f.board.as_ref().map(state_of));
        state.set_item("reports", reports.collect::<Vec<_>>())?;
        state.set_item("frame_rate_hz", clip.frame_rate_hz)?;
        state.set_item("radar", &clip.radar)?;
        state.set_item("radar_height_m", clip.radar_height_m)?;
        state.set_item("is_height_assumed", clip.is_height_assumed)?;
        state.set_item("source", clip.provenance.to_string())?;
        state.set_item("seed", clip.provenance.seed())?;
        state.set_item("settled", clip.clutter == Clutter::Settled)?;
        state.set_item("notes", &points.recording.notes)?;
        Ok((this.get_type().getattr("_restore")?, (state,)))
    }

    /// The inverse of `__reduce__`.
    #[staticmethod]
    fn _restore(state: &Bound<'_, PyDict>) -> PyResult<Self> {
        fn field<'py, T>(state: &Bound<'py, PyDict>, name: &str) -> PyResult<T>
        where
            for<'a> T: FromPyObject<'a, 'py, Error: Into<PyErr>>,
        {
            let missing = || errors::input(format!("no points: `{name}` is missing"));
            let value = state.get_item(name)?.ok_or_else(missing)?;
            value.extract().map_err(Into::into)
        }
        let values: Vec<f32> = field(state, "values")?;
        let offsets: Vec<usize> = field(state, "offsets")?;
        let times_s: Vec<f64> = field(state, "times_s")?;
        let numbers: Vec<u32> = field(state, "numbers")?;
        let reports: Vec<Option<ReportState>> = field(state, "reports")?;
        let (rows, rest) = values.as_chunks::<N_VALUES>();
        let fits = rest.is_empty()
            && offsets.first() == Some(&0)
            && offsets.last() == Some(&rows.len())
            && offsets.is_sorted()
            && times_s.len() == numbers.len()
            && offsets.len() == times_s.len() + 1
            && reports.len() == times_s.len();
        if !fits {
            return Err(errors::input("no points: the lengths of the parts differ"));
        }
        let frames = offsets.windows(2).zip(times_s).zip(numbers).zip(reports);
        let frames = frames.map(|(((ends, time_s), frame), report)| PointFrame {
            frame,
            time_s,
            points: rows[ends[0]..ends[1]].iter().map(point_of).collect(),
            board: report.map(report_of),
        });
        let source: String = field(state, "source")?;
        let Ok(parsed) = source.parse::<Provenance>();
        let settled: bool = field(state, "settled")?;
        let clip = Clip {
            frames: frames.collect(),
            frame_rate_hz: field(state, "frame_rate_hz")?,
            radar_height_m: field(state, "radar_height_m")?,
            is_height_assumed: field(state, "is_height_assumed")?,
            radar: field(state, "radar")?,
            provenance: match parsed {
                Provenance::Simulated { input, .. } => Provenance::Simulated {
                    input,
                    seed: field(state, "seed")?,
                },
                recorded => recorded,
            },
            clutter: match settled {
                true => Clutter::Settled,
                false => Clutter::Unchecked,
            },
        };
        let notes = field(state, "notes")?;
        Ok(Recording::new(clip, notes, PrepareOptions::default()).into())
    }
}

fn values_of(p: &RadarPoint) -> [f32; N_VALUES] {
    [
        p.x_m,
        p.y_m,
        p.z_m,
        p.range_m,
        p.velocity_mps,
        p.intensity_db,
    ]
}

fn point_of(values: &[f32; N_VALUES]) -> RadarPoint {
    let [x_m, y_m, z_m, range_m, velocity_mps, intensity_db] = *values;
    RadarPoint {
        x_m,
        y_m,
        z_m,
        range_m,
        velocity_mps,
        intensity_db,
    }
}

/// The provenance that a caller states.
pub(crate) fn provenance(
    synthetic: Option<bool>,
    source: Option<String>,
    seed: Option<u64>,
) -> PyResult<Provenance> {
    let source = source.unwrap_or_else(|| UNNAMED.into());
    match synthetic {
        Some(true) => Ok(Provenance::Simulated {
            input: source,
            seed,
        }),
        Some(false) if seed.is_some() => Err(errors::input("`seed`: a recording has none")),
        Some(false) => Ok(Provenance::Recorded {
            format: None,
            path: source,
        }),
        None => Err(errors::input_with_hint(
            "where the points come from is not known",
            "synthetic=True if a simulator made them, synthetic=False if a radar recorded them",
        )),
    }
}

/// The points in the array of a frame.
fn points_of(index: usize, values: &Bound<'_, PyAny>) -> PyResult<Vec<RadarPoint>> {
    let numpy = values.py().import("numpy")?;
    let array = numpy.call_method1("asarray", (values,))?;
    let untyped = array.cast::<PyUntypedArray>()?;
    let shape = untyped.shape();
    if untyped.len() == 0 && (shape == [0] || shape == [0, N_VALUES]) {
        return Ok(Vec::new());
    }
    let dtype = untyped.dtype();
    let kind: String = dtype.getattr("kind")?.extract()?;
    if !["f", "i", "u"].contains(&kind.as_str()) {
        return Err(errors::input_with_hint(
            format!("frame {index}: elements {dtype}, expected real numbers"),
            "an array of float32 of shape (n, 6) for each frame",
        ));
    }
    if shape.len() != 2 || shape[1] != N_VALUES {
        return Err(errors::input_with_hint(
            format!("frame {index}: shape {shape:?}, expected (n, {N_VALUES})"),
            "x, y, z, range in m, velocity in m/s, intensity in dB for each point",
        ));
    }
    if shape[0] > MAX_POINTS {
        return Err(errors::input(format!(
            "frame {index}: {} points, at most {MAX_POINTS} are handled",
            shape[0]
        )));
    }
    // Also makes negative steps, Fortran order and the other byte order disappear.
    let plain = numpy.call_method1("ascontiguousarray", (array, "f4"))?;
    let plain: PyReadonlyArray2<'_, f32> = plain.extract()?;
    let (rows, _) = plain
        .as_slice()
        .map_err(errors::input)?
        .as_chunks::<N_VALUES>();
    let wrong = |row: &[f32; N_VALUES]| row.iter().position(|v| !v.is_finite());
    let at = rows
        .iter()
        .enumerate()
        .find_map(|(i, row)| Some((i, wrong(row)?)));
    if let Some((row, column)) = at {
        return Err(errors::input(format!(
            "frame {index}, point {row}: `{}` is {}",
            COLUMNS[2 + column],
            rows[row][column]
        )));
    }
    Ok(rows.iter().map(point_of).collect())
}

/// A report of a board as Python pickles it: number, place, height and velocity of each track, and presence.
type ReportState = (Vec<(u32, [f32; 2], Option<f32>, [f32; 3])>, Option<bool>);

fn state_of(report: &BoardReport) -> ReportState {
    let tracks = report.tracks.iter();
    let tracks = tracks.map(|t| (t.id, t.place_m, t.height_m, t.velocity_mps));
    (tracks.collect(), report.is_present)
}

fn report_of((tracks, is_present): ReportState) -> BoardReport {
    let track = |(id, place_m, height_m, velocity_mps)| BoardTrack {
        id,
        place_m,
        height_m,
        velocity_mps,
    };
    BoardReport {
        tracks: tracks.into_iter().map(track).collect(),
        is_present,
    }
}

fn set_times(frames: &mut [PointFrame], times_s: &[f64]) -> PyResult<()> {
    if times_s.len() != frames.len() {
        return Err(errors::input(format!(
            "`times_s`: {} times for {} frames",
            times_s.len(),
            frames.len()
        )));
    }
    let mut before_s = f64::NEG_INFINITY;
    for (index, (frame, &time_s)) in frames.iter_mut().zip(times_s).enumerate() {
        if !time_s.is_finite() || time_s < before_s {
            return Err(errors::input(format!(
                "`times_s`: frame {index} is at {time_s} s after {before_s} s"
            )));
        }
        before_s = time_s;
        frame.time_s = time_s;
    }
    Ok(())
}
