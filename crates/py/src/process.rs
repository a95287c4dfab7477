//! `process`: arrays of raw samples to points.

use std::path::{Path, PathBuf};

use numpy::{
    Complex32, Complex64, Element, PyReadonlyArrayDyn, PyUntypedArray, PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use radarllm::{
    Clip, Clutter, DspOptions, Error, PointExtractor, PointFrame, Provenance, RadarConfig,
    io::{
        ArrayDecoder,
        options::{DEFAULT_RADAR_HEIGHT_M, MAX_FRAMES},
    },
};
use radarllm_base::RadarCube;

use crate::{
    capture::PyCapture,
    errors,
    options::processing as read_processing,
    points::{PyPoints, provenance},
    radar::RadarArgument,
    work,
};

/// Axes of one frame where the caller names none.
const AXES_OF_CUBE: &str = "loop,tx,rx,sample";
/// The axis of frames.
const FRAME: &str = "frame";

/// Raw samples in arrays to points, by the chain of `radarllm process`.
///
/// `cubes` is one array of all frames, or an iterable with an array for each frame. `axes` names the axes of the array,
/// or of the arrays, slowest first: frame, loop, tx, chirp (all slots of all loops), rx, virtual (all receivers of all
/// slots), sample, iq (of length 2); "frame,loop,tx,rx,sample" where it is left out, without "frame" of an iterable. The
/// elements are complex64, complex128, int16, uint16, float32 or float64 in any memory layout. A frame is copied before it
/// is processed without Python's lock.
///
/// `synthetic` says whether a simulator made the samples, and `source` where they come from. `processing` is a TOML file
/// with a table `[processing]`.
///
/// >>> cubes = simulate("builtin:walk", emit="cubes")
/// >>> from itertools import islice
/// >>> points = process(islice(cubes, 3), radar="awr1843boost", synthetic=True, source="three frames")
/// >>> len(points)
/// 3
#[pyfunction]
#[pyo3(signature = (cubes, *, radar, axes=None, processing=None, synthetic=None, source=None, seed=None, radar_height_m=None))]
#[expect(clippy::too_many_arguments, reason = "all are keywords of Python")]
pub(crate) fn process(
    cubes: &Bound<'_, PyAny>,
    radar: RadarArgument,
    axes: Option<String>,
    processing: Option<PathBuf>,
    synthetic: Option<bool>,
    source: Option<String>,
    seed: Option<u64>,
    radar_height_m: Option<f32>,
) -> PyResult<PyPoints> {
    let py = cubes.py();
    if cubes.cast::<PyCapture>().is_ok() {
        return Err(errors::input_with_hint(
            "process: takes arrays; a capture knows its own layout",
            "capture.points(processing=...) does the same",
        ));
    }
    if let Some(height_m) = radar_height_m.filter(|height_m| !height_m.is_finite()) {
        return Err(errors::input(format!("`radar_height_m` is {height_m}")));
    }
    let provenance = provenance(synthetic, source, seed)?;
    let radar = radar.0.into_config().map_err(errors::to_py)?;
    let dsp = match processing {
        Some(path) => read_processing(&path)
            .map_err(errors::to_py)?
            .resolve(&radar),
        None => DspOptions::default(),
    };
    let mut chain = work::run(py, |_| Chain::new(&radar, dsp))?;
    let numpy = py.import("numpy")?;
    let is_array = cubes.hasattr("shape")?;
    let mut names: Vec<&str> = match &axes {
        Some(axes) => axes.split(',').map(str::trim).collect(),
        None => AXES_OF_CUBE.split(',').collect(),
    };
    if axes.is_none() && is_array {
        names.insert(0, FRAME);
    }
    let place = names.iter().position(|name| *name == FRAME);
    let axes_of_frame = || {
        let rest: Vec<&str> = names
            .iter()
            .copied()
            .filter(|name| *name != FRAME)
            .collect();
        rest.join(",")
    };
    match (is_array, place) {
        (true, Some(place)) => {
            let ndim: usize = cubes.getattr("ndim")?.extract()?;
            if ndim != names.len() {
                let shape = cubes.getattr("shape")?;
                return Err(errors::input_with_hint(
                    format!(
                        "process: shape {shape}, expected {} axes: {}",
                        names.len(),
                        names.join(",")
                    ),
                    "`axes` names the axes of the array, slowest first",
                ));
            }
            let frames = numpy.call_method1("moveaxis", (cubes, place, 0))?;
            for frame in frames.try_iter()? {
                chain.push(&numpy, &frame?, &axes_of_frame())?;
            }
        }
        (true, None) => chain.push(&numpy, cubes, &axes_of_frame())?,
        (false, Some(_)) => {
            return Err(errors::input_with_hint(
                "process: the arrays of an iterable are frames, and have no axis `frame`",
                "`axes` names the axes of one of them",
            ));
        }
        (false, None) => {
            for frame in cubes.try_iter()? {
                chain.push(&numpy, &frame?, &axes_of_frame())?;
            }
        }
    }
    chain.finish(provenance, radar_height_m)
}

/// The chain from arrays to points.
struct Chain {
    radar: RadarConfig,
    extractor: PointExtractor,
    cube: RadarCube,
    frames: Vec<PointFrame>,
    /// Shape and type of the first frame, and how they become cubes.
    decoder: Option<(Vec<usize>, String, ArrayDecoder)>,
}

impl Chain {
    fn new(radar: &RadarConfig, dsp: DspOptions) -> radarllm::Result<Self> {
        Ok(Self {
            extractor: PointExtractor::new(radar, dsp)?,
            cube: radarllm_formats::adc::CubeShape::of(radar).zeros()?,
            radar: radar.clone(),
            frames: Vec::new(),
            decoder: None,
        })
    }

    fn push(
        &mut self,
        numpy: &Bound<'_, PyModule>,
        frame: &Bound<'_, PyAny>,
        axes: &str,
    ) -> PyResult<()> {
        let py = frame.py();
        let index = self.frames.len();
        if index as u64 == MAX_FRAMES {
            return Err(errors::input(format!(
                "more than {MAX_FRAMES} frames, which are the most that are handled"
            )));
        }
        let array = numpy.call_method1("asarray", (frame,))?;
        let array = array.cast::<PyUntypedArray>()?;
        let dtype = array.dtype();
        let kind: String = dtype.getattr("kind")?.extract()?;
        let code = format!("{kind}{}", dtype.getattr("itemsize")?.extract::<usize>()?);
        let shape = array.shape().to_vec();
        let (first_shape, first_code, decoder) = match &mut self.decoder {
            Some(known) => known,
            none => {
                let lengths: Vec<u64> = shape.iter().map(|&n| n as u64).collect();
                let name = Path::new("process");
                let decoder =
                    ArrayDecoder::new(name, &lengths, false, &code, &self.radar, Some(axes))
                        .map_err(errors::to_py)?;
                none.insert((shape.clone(), code.clone(), decoder))
            }
        };
        if *first_shape != shape || *first_code != code {
            return Err(errors::input(format!(
                "process: frame {index} has shape {shape:?} and elements {code}, the first one {first_shape:?} and \
                 {first_code}"
            )));
        }
        // Steps of any size and sign, Fortran order and the other byte order become plain memory here.
        let plain = numpy.call_method1("ascontiguousarray", (array, &code))?;
        let mut numbers = numbers_of(&plain, &code)?;
        if let Some(at) = numbers
            .iter()
            .position(|z| !z.re.is_finite() || !z.im.is_finite())
        {
            return Err(errors::input(format!(
                "process: frame {index}, element {at} is {}",
                numbers[at]
            )));
        }
        let (cube, extractor) = (&mut self.cube, &mut self.extractor);
        cube.time_s = index as f64 * self.radar.frame_period_s;
        let mut points = work::run(py, |_| {
            let decoded = decoder.decode(&mut numbers, cube);
            decoded.map_err(|e| Error::input(format!("frame {index}: {e}")).caused_by(e))?;
            let extracted = extractor.extract(cube);
            extracted.map_err(|e| Error::input(format!("frame {index}: {e}")).caused_by(e))
        })?;
        points.frame = index as u32;
        self.frames.push(points);
        Ok(())
    }

    fn finish(self, provenance: Provenance, radar_height_m: Option<f32>) -> PyResult<PyPoints> {
        if self.frames.is_empty() {
            return Err(errors::input("process: no frame"));
        }
        Ok(PyPoints::from(Clip {
            frame_rate_hz: self.radar.frame_rate_hz(),
            frames: self.frames,
            radar_height_m: radar_height_m.unwrap_or(DEFAULT_RADAR_HEIGHT_M),
            is_height_assumed: radar_height_m.is_none(),
            radar: self.radar.name,
            provenance,
            clutter: Clutter::Unchecked,
        }))
    }
}

/// The elements of a plain array of a known type.
fn numbers_of(plain: &Bound<'_, PyAny>, code: &str) -> PyResult<Vec<Complex32>> {
    fn all<T: Element + Copy>(
        plain: &Bound<'_, PyAny>,
        number: impl Fn(T) -> Complex32,
    ) -> PyResult<Vec<Complex32>> {
        let array: PyReadonlyArrayDyn<'_, T> = plain.extract()?;
        let values = array.as_slice().map_err(errors::input)?;
        Ok(values.iter().map(|&v| number(v)).collect())
    }
    match code {
        "c8" => all(plain, |z: Complex32| z),
        "c16" => all(plain, |z: Complex64| {
            Complex32::new(z.re as f32, z.im as f32)
        }),
        "i2" => all(plain, |v: i16| Complex32::from(f32::from(v))),
        // Samples are signed. Recorders that declare them as unsigned write the same bits.
        "u2" => all(plain, |v: u16| Complex32::from(f32::from(v as i16))),
        "f4" => all(plain, |v: f32| Complex32::from(v)),
        "f8" => all(plain, |v: f64| Complex32::from(v as f32)),
        other => Err(errors::input(format!("process: elements {other}"))),
    }
}
