//! `simulate`.

use std::{path::PathBuf, sync::Mutex};

use numpy::{Complex32, PyArray1, PyArray4, PyArrayMethods};
use pyo3::prelude::*;
use radarllm::{
    Recording, SimulateOptions, SimulatedCubes, TiFirmware, inference::PrepareOptions,
    simulate_cubes, simulate_motion_until,
};
use radarllm_base::RadarCube;

use crate::{
    errors,
    options::{self, processing},
    points::PyPoints,
    radar::RadarArgument,
    work::{self, on_threads},
};

/// Simulates a motion before a radar.
///
/// `input` is a built-in motion ("builtin:walk?direction=backward"; `radarllm motion list` names them), a motion file
/// (BVH, AMC with its ASF, AMASS npz, HumanML3D npy), or a scene file (.toml). The middle of the motion's path is `distance_m`
/// (m) before the radar, which is `radar_height_m` (m) above the floor; distances at which the radar sees nobody are an error. `seed` determines the noise and the variations of a built-in motion; with
/// `own_noise` the noise is drawn from the seed and the name of the input, as the command `radarllm simulate` does.
/// `processing` is a TOML file with a table `[processing]`. The result does not depend on `threads`.
///
/// `firmware` is the signal chain of the board's own firmware, as the radar's TI .cfg sets it up: "out-of-box" or
/// "people-tracking". `body` is a user's own SMPL-X .npz, which performs the motion instead of the built-in body.
/// `objects` is what stands still around the person: "none", "furnished" or a TOML file with a table `[objects]`; if None,
/// furniture before firmware that reports it and nothing otherwise.
///
/// Returns `Points`; with `emit="cubes"` an iterator of raw samples, a complex64 array [loop, tx, rx, sample] for each
/// frame, in the square root of watts.
///
/// >>> points = simulate("builtin:walk?direction=backward", seed=1)
/// >>> points.radar, points.frame_rate_hz, points.source
/// ('awr1843boost', 10.0, 'simulated:builtin:walk?direction=backward')
#[pyfunction]
#[pyo3(signature = (input, *, radar=None, seed=1, distance_m=3.0, radar_height_m=1.0, own_noise=false, processing=None, firmware=None, body=None, objects=None, emit="points", threads=None))]
#[expect(clippy::too_many_arguments, reason = "all are keywords of Python")]
pub(crate) fn simulate<'py>(
    py: Python<'py>,
    input: PathBuf,
    radar: Option<RadarArgument>,
    seed: u64,
    distance_m: f32,
    radar_height_m: f32,
    own_noise: bool,
    processing: Option<PathBuf>,
    firmware: Option<&str>,
    body: Option<PathBuf>,
    objects: Option<PathBuf>,
    emit: &str,
    threads: Option<usize>,
) -> PyResult<Bound<'py, PyAny>> {
    let radar = options::radar_or_default(radar)?;
    let firmware = firmware.map(|name| TiFirmware::from_name(name, &radar));
    let firmware = firmware.transpose().map_err(errors::to_py)?;
    let radar = radar.into_config().map_err(errors::to_py)?;
    let objects = objects.as_deref().map(options::objects);
    for (name, value) in [
        ("distance_m", distance_m),
        ("radar_height_m", radar_height_m),
    ] {
        if !(value.is_finite() && (0.0..=1000.0).contains(&value)) {
            return Err(errors::input(format!(
                "`{name}` {value}: must be 0 to 1000 m"
            )));
        }
    }
    let input = input.to_string_lossy().into_owned();
    let mut simulation = SimulateOptions {
        seed,
        distance_m,
        radar_height_m,
        own_noise,
        firmware,
        body,
        objects: objects.transpose().map_err(errors::to_py)?,
        ..SimulateOptions::default()
    };
    if let Some(path) = processing {
        simulation.processing = Some(processing_of(&path, &radar)?);
    }
    match emit {
        "points" => {
            let points = work::run(py, |stop| {
                on_threads(threads, || {
                    let done =
                        simulate_motion_until(&input, &radar, &simulation, &|| stop.is_set())?;
                    Ok(Recording::simulated(done, PrepareOptions::default()))
                })
            })?;
            Ok(Bound::new(py, PyPoints::from(points))?.into_any())
        }
        "cubes" => {
            let cubes = work::run(py, |_| simulate_cubes(&input, &radar, &simulation))?;
            let cubes = PyCubes(Mutex::new(Some(cubes)));
            Ok(Bound::new(py, cubes)?.into_any())
        }
        other => Err(errors::input_with_hint(
            format!("`emit` {other:?}: unknown"),
            "\"points\" or \"cubes\"",
        )),
    }
}

fn processing_of(
    path: &std::path::Path,
    radar: &radarllm::RadarConfig,
) -> PyResult<radarllm::DspOptions> {
    Ok(processing(path).map_err(errors::to_py)?.resolve(radar))
}

/// Frames of raw samples of a simulation, one at a time.
#[pyclass(frozen, name = "Cubes", module = "radarllm")]
pub struct PyCubes(Mutex<Option<SimulatedCubes>>);

#[pymethods]
impl PyCubes {
    fn __iter__(this: PyRef<'_, Self>) -> PyRef<'_, Self> {
        this
    }

    fn __next__<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray4<Complex32>>>> {
        // Taken out while it works: a lock that is held without the interpreter's own could block both.
        let take = || {
            self.0
                .lock()
                .unwrap_or_else(std::sync::PoisonError::into_inner)
                .take()
        };
        let Some(mut cubes) = take() else {
            return Err(errors::input("these cubes are in use by another thread"));
        };
        let (cubes, found) = work::run(py, move |_| {
            let found = cubes.next().transpose();
            Ok((cubes, found))
        })?;
        *self
            .0
            .lock()
            .unwrap_or_else(std::sync::PoisonError::into_inner) = Some(cubes);
        let cube = found.map_err(errors::to_py)?;
        cube.map(|cube| array_of(py, cube)).transpose()
    }
}

/// A cube as an array `[loop, tx, rx, sample]`, which takes over its memory.
pub(crate) fn array_of<'py>(
    py: Python<'py>,
    cube: RadarCube,
) -> PyResult<Bound<'py, PyArray4<Complex32>>> {
    let shape = [cube.n_loops, cube.n_tx, cube.n_rx, cube.n_samples];
    PyArray1::from_vec(py, cube.data).reshape(shape)
}
